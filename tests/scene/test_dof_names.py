"""One DOF by its number, its label, or node and direction with a sign: the results are those of the DOF."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from dynid.errors import SceneError, UsageError
from dynid.result import is_cost
from dynid.scene.kinds.planning import run_plan
from dynid.scene.load import check_source, load_scene
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import parse_source
from tests.scene.example_scenes import faults_of

BEAM = """\
dynid: 1
kind: identification
structure:
  beam: {elements: 4, length: 4, EI: 1723.3, rhoA: 0.1, supports: [{node: 1, fix: [w]}], damping: {alpha: 2}}
joints:
  turn: {dofs: [theta_1], k: {start: 2.5e3, true: 5.0e3}}
  link: {dofs: [w_4], k: {start: 0.5e4, true: 1.0e4}, c: {start: 10, true: 20}}
excitation: [{dof: w_3, kind: multisine, amplitude: [100, 100], frequency: [41, 132]}]
"""
RECORD = """\
measurement:
  step: 0.002
  samples: 200
  channels: [{dof: w_3, quantity: velocity}, {dof: w_4, quantity: acceleration}]
"""
MOTION = "analysis: {outputs: [{dof: w_4, quantity: displacement}], time: {stop: 0.004, step: 0.001}}\n"
SIMULATED = BEAM + RECORD + "  simulate: {noise_ratio: 0.05, seed: 1}\n"
NAMES = {"w_3": "3:y", "w_4": "4:y", "theta_1": "1:rz"}


def renamed(text, names):
    for old, new in names.items():
        text = text.replace(old, new)
    return text


def run(text, folder=None):
    if folder is None:
        return run_scene(check_source(parse_source(text, "s.yaml")))
    (folder / "s.yaml").write_text(text)
    return run_scene(load_scene(folder / "s.yaml"))


def assert_same(result, other):
    assert set(result) == set(other)
    for path in result:
        if not is_cost(path):
            np.testing.assert_array_equal(result[path].data, other[path].data, err_msg=path)


def estimates(result):
    group = "identification/parameters"
    return np.array([result[f"{group}/{name}"].data for name in ("estimate", "standard_error")])


@pytest.fixture(scope="module")
def by_label():
    return run(SIMULATED)


def test_node_and_direction_give_the_results_of_the_label_and_show_it(by_label):
    result = run(renamed(SIMULATED, NAMES))
    assert_same(result, by_label)
    assert list(result["identification/measurement/channel"].data) == ["w_3.velocity", "w_4.acceleration"]


def test_numbers_stay_in_results():
    result = run(renamed(SIMULATED, {"w_3": "4", "w_4": "6"}))
    assert list(result["identification/measurement/channel"].data) == ["4.velocity", "6.acceleration"]


@pytest.fixture(scope="module")
def of_a_file(tmp_path_factory, by_label):
    """What is identified from the record in a file."""
    folder = tmp_path_factory.mktemp("plain")
    recorded = by_label["identification/measurement/measured"].data
    np.savetxt(folder / "plain.csv", recorded, delimiter=",", fmt="%.17g")
    return run(BEAM + RECORD + "  file: {path: plain.csv}\n", folder)


@pytest.mark.parametrize(
    ("channel", "sign"),
    [
        ("{dof: w_4, quantity: acceleration}", 1),
        ("{dof: 4:y, quantity: acceleration}", 1),
        ("{dof: 4:+y, quantity: acceleration}", 1),
        ("{dof: 4:-y, quantity: acceleration}", -1),
        ("{dof: w_4, gain: -1, quantity: acceleration}", -1),
        ("{dof: 6, gain: -1, quantity: acceleration}", -1),
        ("{dof: 4:-y, gain: -1, quantity: acceleration}", 1),
    ],
)
def test_a_reversed_sensor_is_a_sign_or_a_gain(tmp_path, by_label, of_a_file, channel, sign):
    recorded = by_label["identification/measurement/measured"].data * [1, sign]
    np.savetxt(tmp_path / "r.csv", recorded, delimiter=",", header="3:y,4:-y", comments="", fmt="%.17g")
    text = BEAM + RECORD.replace("{dof: w_4, quantity: acceleration}", channel)
    text += '  file: {path: r.csv, columns: ["3:y", "4:-y"]}\n'
    second = run(text, tmp_path)
    # With a gain the estimator evaluates another form of the model, and stops elsewhere near the optimum.
    rtol = 1e-8 if "gain" in channel else 1e-12
    np.testing.assert_allclose(estimates(second), estimates(of_a_file), rtol=rtol)
    name = "4:-y.acceleration" if "-y" in channel else None
    assert name is None or second["identification/measurement/channel"].data[1] == name


FRF = (
    BEAM[: BEAM.index("excitation")]
    + """\
reduction: {method: craig-bampton, masters: [w_3, w_4, theta_1], modes: {count: 3}}
measurement:
  channels:
    - {dof: w_3, quantity: acceleration, reference: {dof: w_3}}
    - {dof: w_4, quantity: acceleration, reference: {dof: w_3}}
  frf:
    simulate: {lines: {start: 2, stop: 60, points: 60, scale: linear, unit: Hz}, noise: 0.1, seed: 1}
derived: []
"""
)


@pytest.mark.thorough
def test_references_and_sensors_of_frequency_responses_have_signs():
    first = run(FRF)
    every = run(renamed(FRF, NAMES))
    turned = run(
        FRF.replace("{dof: w_4, q", "{dof: 4:-y, q").replace(
            "{dof: w_3, quantity: acceleration, reference: {dof: w_3}}",
            "{dof: 3:-y, quantity: acceleration, reference: {dof: 3:-y}}",
        )
    )
    np.testing.assert_array_equal(estimates(every), estimates(first))
    names = turned["identification/measurement/channel"].data
    assert list(names) == ["3:-y.acceleration/3:-y", "4:-y.acceleration/w_3"]
    true = first["identification/parameters/true"].data
    np.testing.assert_allclose(turned["identification/parameters/estimate"].data, true, rtol=0.02)


RESPONSES = """\
dynid: 1
kind: identification
structure:
  beam: {elements: 2, length: 1, EI: 10, rhoA: 0.5, supports: [{node: 1, fix: [w]}], damping: {alpha: 1}}
joints: {k: {dofs: [w_3], k: 100.0, c: 1}}
analysis:
  inputs: [INPUT]
  outputs: [{dof: OUTPUT, quantity: velocity}, {dofs: [OUTPUT, theta_2], quantity: displacement}]
  frequency: {start: 1, stop: 20, points: 7}
  time: {stop: 0.1, step: 0.001, input: {kind: sine, frequency: 30, LOAD}}
"""


@pytest.mark.parametrize(
    "load", ["dof: LOADED", "dof: LOADED, motion: displacement", "dof: LOADED, motion: velocity"]
)
def test_loads_prescribed_motions_and_outputs_have_signs(load):
    def responses(given, shown, loaded):
        text = RESPONSES.replace("LOAD}", load.replace("LOADED", loaded) + "}")
        result = run(renamed(text, {"INPUT": given, "OUTPUT": shown}))
        return [result[f"structure/{kind}_response/response"].data for kind in ("frequency", "time")]

    (H, y), (same, also) = responses("w_2", "w_3", "w_2"), responses("2:y", "3:y", "2:y")
    np.testing.assert_array_equal(same, H)
    np.testing.assert_array_equal(also, y)
    H1, y1 = responses("2:-y", "3:y", "2:-y")
    np.testing.assert_allclose(H1, -H, rtol=1e-12)
    np.testing.assert_allclose(y1, -y, rtol=1e-12, atol=1e-15)
    H2, y2 = responses("w_2", "3:-y", "2:-y")
    np.testing.assert_allclose(H2[:, 0], -H[:, 0], rtol=1e-12)
    np.testing.assert_allclose(y2[:, 0], y[:, 0], rtol=1e-12, atol=1e-15)


def test_an_initial_motion_is_given_by_node_and_direction():
    text = (
        RESPONSES.replace("INPUT", "w_2")
        .replace("OUTPUT", "w_3")
        .replace(", input: {kind: sine, frequency: 30, LOAD}", "")
    )
    first, second = (run(text + f"initial: {{{name}: {{x: 0.01, v: 2}}}}\n") for name in ("w_2", '"2:y"'))
    path = "structure/time_response/response"
    np.testing.assert_array_equal(second[path].data, first[path].data)
    with pytest.raises(UsageError, match="by two of its names"):
        run(text + "initial: {w_2: {x: 0.01}, '2:y': {x: 0.01}}\n")


def test_reductions_and_their_responses_are_named_by_node_and_direction():
    text = (
        BEAM[: BEAM.index("joints")].replace("identification", "reduction")
        + """\
joints: {turn: {dofs: [theta_1], k: 5.0e3}}
reduction:
  - {method: guyan, masters: [w_3, w_4]}
  - {method: modal, modes: [1, 2], residuals: [w_4]}
frequency: {start: 1, stop: 20, points: 7}
inputs: [w_3]
outputs: [{dof: w_4, quantity: velocity}]
substructures: {end: [w_4]}
"""
    )
    first, second = run(text), run(renamed(text, NAMES))
    assert_same(second, first)


def test_a_plan_names_candidates_by_node_and_direction():
    plan = """\
plan:
  sensors: 1
  lines: 1
  candidates: [{dof: w_2, quantity: velocity}, {dof: w_4, quantity: velocity}]
  excitation: {dofs: [w_2, w_3]}
"""
    names = {**NAMES, "w_2": "2:y"}
    first, second, turned = (
        run_plan(check_source(parse_source(text, "s.yaml")))
        for text in (
            SIMULATED + plan,
            renamed(SIMULATED + plan, names),
            SIMULATED + plan.replace("{dof: w_2, q", "{dof: 2:-y, q").replace("[w_2, w_3]", "[2:-y, 3:-y]"),
        )
    )
    assert_same(second, first)
    for path, variable in first.items():
        if variable.data.dtype.kind == "f":
            np.testing.assert_allclose(turned[path].data, variable.data, rtol=1e-9, err_msg=path)


GRAPH = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    f: Se
    arm:
      type: structure
      structure: {beam: {elements: 2, length: 1, EI: 10, rhoA: 0.5, supports: [{node: 1, fix: [w, theta]}]}}
      REDUCTION
      ports: {tip: TIP}
  bonds: [f -> arm.tip]
analysis: {outputs: [arm.tip.f], frequency: {start: 1, stop: 20, points: 7}}
"""


@pytest.mark.parametrize("reduction", ["", "reduction: {method: modal, modes: {count: 3}}"])
def test_ports_of_a_graph_are_named_by_node_and_direction(reduction):
    text = GRAPH.replace("REDUCTION", reduction)
    first, second = (run(text.replace("TIP", tip)) for tip in ("w_3", "3:y"))
    path = "bond_graph/frequency_response/response"
    np.testing.assert_array_equal(second[path].data, first[path].data)
    assert faults_of(text.replace("TIP", "3:-y")) == [
        "10:20: '3:-y' has a sign, which only channels, loads and reference DOFs can have; write '3:y'"
    ]


SIGN = "has a sign, which only channels, loads and reference DOFs can have; write "


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("dofs: [w_4]", "dofs: [4:-y]", f"7:17: '4:-y' {SIGN}'4:y'"),
        ("dofs: [theta_1]", "dofs: [1:-rz]", f"6:17: '1:-rz' {SIGN}'1:rz'"),
        ("dof: w_4", "dof: 9:y", "12:52: there is no DOF '9:y'; there are DOFs at the nodes 1, 2, 3, 4, 5"),
        ("dof: w_4", "dof: 9:-y", "12:52: there is no DOF '9:-y'; there are DOFs at the nodes 1, 2, 3, 4, 5"),
        ("dof: w_4", "dof: 1:-y", "12:52: there is no DOF '1:-y'; node 1 has theta_1 (rz) only"),
        ("dof: w_4", "dof: 4:z", "12:52: there is no DOF '4:z'; node 4 has w_4 (y), theta_4 (rz) only"),
        ("dof: w_4", "dof: 4:UY", "12:52: there is no DOF '4:UY'; did you mean '4:y'?"),
        ("dof: w_4", "dof: 4:Y", "12:52: there is no DOF '4:Y'; did you mean '4:y'?"),
        ("dof: w_4", "dof: 4:up", "directions are x, y, z, rx, ry, rz, and node 4 has w_4 (y), theta_4 (rz)"),
        ("dof: w_4", "dof: -w_4", "12:52: there is no DOF '-w_4'; did you mean 'w_4'?"),
        ("dof: w_4", "dof: 4-y", "12:52: there is no DOF '4-y'; write '4:-y'"),
        ("dof: w_3, kind", "dof: 3:-z, kind", "8:20: there is no DOF '3:-z'; node 3 has w_3 (y), theta"),
    ],
)  # fmt: skip
def test_names_of_no_dof_are_located(old, new, said):
    found = faults_of(SIMULATED.replace(old, new))
    assert len(found) == 1
    assert said in found[0]


def test_one_dof_under_two_names_is_one():
    with pytest.raises(UsageError, match="they are one DOF"):
        run(SIMULATED.replace("{dof: w_4, q", "{dofs: [w_4, 4:y], q"))
    with pytest.raises(UsageError, match=r"the channel w_3\.velocity is listed twice"):
        run(SIMULATED.replace("{dof: w_4, quantity: acceleration}", "{dof: 3:y, quantity: velocity}"))
    with pytest.raises(UsageError, match=r"the channel 4\.velocity is listed twice"):
        run(SIMULATED.replace("{dof: w_4, quantity: acceleration}", "{dof: 4, quantity: velocity}"))
    with pytest.raises(UsageError, match="they are one DOF"):
        run(SIMULATED.replace("{dof: w_4, q", "{dofs: [w_4, 6], q"))
    with pytest.raises(UsageError, match="the initial motion of a DOF is given twice"):
        run(BEAM.partition("joints")[0] + "initial: {6: {x: 0.01}, w_4: {x: 0.02}}\n" + MOTION)
    with pytest.raises(UsageError, match="names a DOF in two ways"):
        run(SIMULATED.replace("dofs: [w_4]", "dofs: [w_4, 4:y]"))


@pytest.mark.parametrize("labels", [["7:UX", "7:UY", "9:UX"], ["7:1", "7:2", "9:1"], ["7:x", "7:y", "9:x"]])
def test_dofs_of_files_are_named_by_node_and_direction(tmp_path, labels):
    K = np.array([[5.0, 1, -2], [1, 6, 0], [-2, 0, 4]])
    savemat(tmp_path / "model.mat", {"M": np.eye(3), "K": K})
    text = f"""\
dynid: 1
kind: identification
structure: {{matrices: {{mass: model.mat, stiffness: model.mat, labels: {labels}}}}}
analysis:
  inputs: ["9:-x"]
  outputs: [{{dof: "7:y"}}, {{dof: "7:-x"}}]
  frequency: {{start: 0.1, stop: 1, points: 3}}
"""
    result = run(text, tmp_path)
    group = "structure/frequency_response"
    H = result[f"{group}/response"].data[:, :, 0]
    for omega, found in zip(result[f"{group}/omega"].data, H, strict=True):
        column = np.linalg.solve(K - omega**2 * np.eye(3), [0, 0, -1.0])
        np.testing.assert_allclose(found, column[[1, 0]] * [1, -1], rtol=1e-12)
    assert list(result[f"{group}/input"].data) == ["9:-x"]
    assert list(result[f"{group}/output"].data) == [f"{labels[1]}.displacement", "7:-x.displacement"]
    wrong = text.replace('"7:-x"', '"9:-y"').replace('["9:-x"]', '["8:x"]')
    with pytest.raises(SceneError) as refused:
        run(wrong, tmp_path)
    first, second = (str(fault) for fault in refused.value.faults)
    assert "5:12: there is no DOF '8:x'; there are DOFs at the nodes 7, 9" in first
    assert "6:33: there is no DOF '9:-y'; node 9 has " in second


def frame_scene(nodes, names):
    """Write an identification of a frame; `names` gives each direction of the record as NODE:DIR."""
    return f"""\
dynid: 1
kind: identification
structure:
  frame:
    nodes: {nodes}
    supports: [{{node: 1, fix: [u, w, theta]}}]
    members:
      - {{nodes: [1, 2], EA: 1.0e5, EI: 80, rhoA: 2}}
      - {{nodes: [2, 3], EA: 1.0e5, EI: 80, rhoA: 2}}
    damping: {{alpha: 2, beta: 0}}
joints:
  a: {{dofs: [{names["3x"].replace("-", "")}], k: {{start: 150, true: 400}}}}
  b: {{dofs: ["2:rz"], k: {{start: 20, true: 50}}}}
excitation: [{{dof: {names["2y"]}, kind: multisine, amplitude: [10, 10], frequency: [7, 23]}}]
measurement:
  step: 0.01
  samples: 120
  channels: [{{dof: {names["3x"]}, quantity: velocity}}, {{dof: {names["3y"]}, quantity: acceleration}}]
  simulate: {{noise_ratio: 0.02, seed: 3, settle: 2}}
"""


QUARTERS = [("x", "y", 1, 1), ("y", "-x", 0, 1), ("-x", "-y", -1, 1), ("-y", "x", 0, -1)]


@settings(max_examples=2, deadline=None)
@given(places=st.lists(st.floats(-0.4, 0.4), min_size=4, max_size=4), turns=st.integers(1, 3))
def test_a_frame_turned_by_quarters_is_the_same_frame(places, turns):
    """Its directions have other names and signs then; the record and the estimates stay."""
    x2, y2, x3, y3 = (float(round(one, 3)) for one in places)
    points = np.array([[0, 0], [x2, 1 + y2], [1.2 + x3, 1.1 + y3]])
    found = []
    for turn in (0, turns):
        c, s = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])[turn]
        nodes = (points @ np.array([[c, s], [-s, c]])).tolist()
        across, up = QUARTERS[turn][:2]
        names = {key: f'"{key[0]}:{ {"x": across, "y": up}[key[1]] }"' for key in ("2y", "3x", "3y")}
        found.append(run(frame_scene(nodes, names)))
    first, second = found
    path = "identification/measurement/measured"
    np.testing.assert_allclose(
        second[path].data, first[path].data, rtol=1e-9, atol=1e-9 * np.abs(first[path].data).max()
    )
    np.testing.assert_allclose(estimates(second), estimates(first), rtol=1e-6)
