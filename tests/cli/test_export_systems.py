"""`dynid export` of systems: other programs read what the result holds."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, mmread

import dynid as package
from dynid.result import Result
from dynid.store import write_result

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture
def motor(folder):
    scene = package.load_scene(
        CONFIGS / "dc_motor.yaml", ["analysis.results=[transfer_function,zeros,poles,state_space]"]
    )
    result = package.run(scene)
    write_result(result, folder / "motor.h5")
    return result


@pytest.fixture
def beam(folder):
    result = package.run(CONFIGS / "beam_reduction.yaml")
    write_result(result, folder / "beam.h5")
    return result


def test_transfer_functions_as_json(dynid, folder, motor):
    assert dynid("export", "motor.h5", "--json")[0] == 0
    document = json.loads((folder / "motor.json").read_text())
    group = "bond_graph/transfer_function"
    channels = {
        path.rpartition("/")[0] for path in motor if path.startswith(group) and path.endswith("numerator")
    }
    assert len(channels) == sum(len(inputs) for inputs in document["transfer_functions"].values())
    for channel in channels:
        output, source = channel.removeprefix(f"{group}/").split("/")
        found = document["transfer_functions"][output][source]
        assert found["denominator"] == list(motor[f"{channel}/denominator"].data)
        assert [complex(*pole) for pole in found["poles"]] == list(motor[f"{channel}/poles"].data)


def test_state_equations_for_matlab(dynid, folder, motor):
    assert dynid("export", "motor.h5", "--mat", "-o", "system.mat")[0] == 0
    found = loadmat(folder / "system.mat")
    for name in "ABCD":
        assert np.array_equal(found[name], motor[f"bond_graph/state_space/{name}"].data)
    names = [str(cell[0]) for cell in found["states"].ravel()]
    assert names == list(motor["bond_graph/state_space/state"].data)


def test_the_same_result_gives_the_same_bytes(dynid, folder, motor):  # noqa: ARG001
    for form in ("--json", "--mat"):
        written = []
        for name in ("a", "b"):
            assert dynid("export", "motor.h5", form, "-o", name)[0] == 0
            written.append((folder / name).read_bytes())
        assert written[0] == written[1]


@pytest.mark.thorough
def test_reduced_models_as_matrices(dynid, folder, beam):
    assert dynid("export", "beam.h5", "--mtx", "-o", "models")[0] == 0
    methods = {path.split("/")[1] for path in beam if path.endswith("/mass")}
    assert {path.name for path in (folder / "models").iterdir()} == {
        f"{method}.{part}.mtx"
        for method in methods
        for part in ("mass", "stiffness", "damping", "T")
        if f"reduction/{method}/{part}" in beam
    }
    for method in methods:
        for part in ("mass", "stiffness", "T"):
            found = mmread(folder / "models" / f"{method}.{part}.mtx")
            assert np.array_equal(found, beam[f"reduction/{method}/{part}"].data)
    assert dynid("export", "beam.h5", "--mat")[0] == 0
    assert np.array_equal(
        loadmat(folder / "beam.mat")["serep"]["mass"][0, 0], beam["reduction/serep/mass"].data
    )


@pytest.mark.parametrize(
    ("option", "said"),
    [
        ("--json", "no transfer functions. Add transfer_function to analysis.results of a bond graph."),
        ("--mat", "no state equations and no reduced model. Add state_space to analysis.results of a bond"),
    ],
)
def test_what_was_not_computed_cannot_be_handed_over(dynid, folder, option, said):
    result = Result("bond-graph")
    result.add("bond_graph/poles", [-1.0, -2.0], ("pole",))
    write_result(result, folder / "poles.h5")
    code, _, err = dynid("export", "poles.h5", option)
    assert code == 2
    assert said in err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--mtx"], "holds no reduced model"),
        (["--json", "-o", "motor.h5"], "would overwrite the result"),
        (["--json", "-o", "nowhere/x.json"], "there is no folder"),
    ],
)
def test_what_cannot_be_handed_over_is_said(dynid, folder, motor, options, said):  # noqa: ARG001
    before = (folder / "motor.h5").read_bytes()
    code, _, err = dynid("export", "motor.h5", *options)
    assert (code in (2, 4), said in err) == (True, True)
    assert (folder / "motor.h5").read_bytes() == before


DELAYED = """
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, j: 1, m: {type: I, value: 1}, b: {type: R, value: 0.4}, k: {type: C, value: 1}, act: Se}
  bonds: [u -> j, act -> j, j -> m, j -> b, j -> k]
analysis: {inputs: [u, w], outputs: [k.q, j.f], results: [properties]}
control:
  loops:
  - from: k.q
    to: act
    controller: {pid: {kp: 1, ki: 0.3, kd: 0.4, tf: 0.05}, delay: 0.3}
    setpoint: w
expect: [{path: bond_graph/system/stable, value: true}]
"""


def transfer(s):
    """T from u and w to k.q and j.f of `DELAYED`, by hand."""
    controller = (1 + 0.3 / s + 0.4 * s / (0.05 * s + 1)) * np.exp(-0.3 * s)
    below = s**2 + 0.4 * s + 1 + controller
    return np.array([[1, controller], [s, s * controller]]) / below


@pytest.mark.parametrize("name", ["plant.mat", "plant.npz"])
def test_state_equations_of_a_scene_with_delays_are_a_linear_fractional_form(dynid, folder, name):
    (folder / "late.yaml").write_text(DELAYED)
    assert dynid("export", "late.yaml", "--state-space", "-o", name)[0] == 0
    if name.endswith(".mat"):
        found = loadmat(folder / name)
        inputs = [str(cell[0]) for cell in found["inputs"].ravel()]
    else:
        with np.load(folder / name) as archive:
            found = dict(archive)
        inputs = found["inputs"].tolist()
    assert inputs == ["u", "w", "act.delayed"]
    s, tau = 0.7j, found["tau"].ravel()
    assert tau.tolist() == [0.3]
    inner = np.linalg.inv(s * np.eye(4) - found["A"])
    G = {
        f"{row}{column}": found[f"C{row}"] @ inner @ found[f"B{column}"] + found[f"D{row}{column}"]
        for row in (1, 2)
        for column in (1, 2)
    }
    late = np.diag(np.exp(-s * tau))
    response = G["11"] + G["12"] @ late @ np.linalg.solve(np.eye(1) - G["22"] @ late, G["21"])
    np.testing.assert_allclose(response, transfer(s), rtol=1e-13)


def test_state_equations_of_a_result_and_what_cannot_be_exported(dynid, folder, motor, beam):  # noqa: ARG001
    assert dynid("export", "motor.h5", "--state-space")[0] == 0
    assert np.array_equal(loadmat(folder / "motor.mat")["A"], motor["bond_graph/state_space/A"].data)
    for arguments, message in (
        (["motor.h5", "--state-space", "-o", "motor.csv"], "not written as '.csv'"),
        (["beam.h5", "--state-space", "-o", "a.mat"], "holds no state equations"),
        ([str(CONFIGS / "beam_reduction.yaml"), "--state-space"], "kind reduction"),
    ):
        status, _, error = dynid("export", *arguments)
        assert status
        assert message in error


def test_python_control_has_the_linear_fractional_form():
    from dynid.scene.load import check_source
    from dynid.scene.yaml.source import parse_source

    scene = check_source(parse_source(DELAYED.replace("[properties]", "[state_space, time_response], "
        "time: {stop: 3, step: 0.5}").replace("expect:", "#"), "late.yaml"))  # fmt: skip
    result = package.run(scene)
    system = result.to_control()
    assert system.input_labels == ["u", "w", "act_delayed"]
    assert (system.nstates, result["bond_graph/state_space/delay"].data.tolist()) == (4, [0.3])


def test_outputs_that_follow_derivatives_of_inputs_have_their_feedthrough(dynid, folder):
    """The effort of a mass driven by a velocity is m dv/dt: order 1 of the feedthrough is m."""
    (folder / "driven.yaml").write_text(
        "dynid: 1\nkind: bond-graph\ngraph:\n  nodes: {v: Sf, m: {type: I, value: 2.5}}\n"
        "  bonds: [v -> m]\nanalysis: {outputs: [m.e]}\n"
    )
    assert dynid("export", "driven.yaml", "--state-space", "-o", "driven.npz")[0] == 0
    with np.load(folder / "driven.npz") as archive:
        assert archive["feedthrough"][1].tolist() == [[2.5]]


def test_modes_as_data_sets_55(dynid, folder, beam):  # noqa: ARG001
    modal = Path(__file__).parents[2] / "data/chain_modal.h5"
    assert dynid("export", str(modal), "--uff", "-o", "modes.uff")[0] == 0
    lines = (folder / "modes.uff").read_text().splitlines()
    result = package.open_result(modal)
    starts = [k for k, line in enumerate(lines) if line == f"{55:6d}"]
    assert len(starts) == len(result["modal/frequency"].data)
    for mode, start in enumerate(starts):
        assert lines[start - 1] == f"{-1:6d}"
        real, imaginary = map(float, lines[start + 8].split()[:2])
        omega, damping = (result[f"modal/{name}"].data[mode] for name in ("frequency", "damping"))
        assert complex(real, imaginary) == pytest.approx(
            complex(-damping * omega, omega * np.sqrt(1 - damping**2)), rel=1e-5
        )
    code, _, err = dynid("export", "beam.h5", "--uff", "-o", "a.uff")
    assert code == 2
    assert "holds no modes of a modal analysis" in err
