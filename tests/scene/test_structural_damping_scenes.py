"""Scenes with structural damping: keys, refusals, equivalent dampers, joints between points."""

import numpy as np
import pytest
import yaml

import dynid
from dynid.errors import SceneError, UsageError
from dynid.scene.kinds.explain_identification import explain
from dynid.scene.kinds.parts import structure_of
from dynid.scene.load import load_scene

CHAIN = """
dynid: 1
kind: identification
structure:
  lumped:
    masses: [1, 1.1, 1.2]
    links: [{dofs: [1], k: 5.0e4, eta: 0.01}, {dofs: [2, 3], k: 5.0e4}]
    damping: {eta: 0.002}
joints:
  bolt: {dofs: [1, 2], k: {start: 1.5e4, true: 2.0e4}, eta: {start: 0.02, true: 0.08}}
analysis:
  outputs: [{dof: 3, quantity: displacement}]
  inputs: [1]
  frequency: {start: 1, stop: 60, points: 20, unit: Hz}
  modes: {count: 3}
"""
MEASURED = """
measurement:
  channels:
    - {dof: 2, quantity: displacement, reference: {dof: 1}}
    - {dof: 3, quantity: displacement, reference: {dof: 1}}
  frf:
    simulate: {lines: {start: 3, stop: 60, points: 100, scale: linear, unit: Hz}, noise_ratio: 0.02, seed: 1}
"""


def scene(tmp_path, change=dict.copy, text=CHAIN):
    data = yaml.safe_load(text)
    change(data)
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False))
    return path


def test_links_whole_and_joints_dissipate(tmp_path):
    result = dynid.run(scene(tmp_path))
    found = result["structure/frequency_response/response"].data[:, 0, 0]
    chain = 5e4 * np.array([[1, 0, 0], [0, 1, -1], [0, -1, 1]])
    first = 5e4 * np.diag([1.0, 0, 0])
    joint = 2e4 * np.array([[1, -1, 0], [-1, 1, 0], [0, 0, 0]])
    K = chain + joint + 1j * (0.002 * chain + 0.01 * first + 0.08 * joint)
    M = np.diag([1, 1.1, 1.2])
    omega = result["structure/frequency_response/omega"].data
    wanted = [np.linalg.solve(K - w**2 * M, [1, 0, 0])[2] for w in omega]
    np.testing.assert_allclose(found, wanted, rtol=1e-10)
    loss = result["structure/complex_modes/loss_factor"].data
    mu = np.linalg.eigvals(np.linalg.solve(M, K))
    mu = mu[np.argsort(abs(mu))]
    np.testing.assert_allclose(loss, mu.imag / mu.real, rtol=1e-10)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda d: d["joints"]["bolt"].pop("k"),
            "'eta' is the loss factor of a stiffness 'k', which is absent",
        ),
        (
            lambda d: d["joints"]["bolt"]["eta"].update(start=3),
            "a loss factor lies between 0 and 2, not at 3",
        ),
        (lambda d: d["joints"]["bolt"].update(eta={"x": 0.1}), "'eta' has directions that 'k' has not"),
        (lambda d: d["joints"]["bolt"].update(eta=[[0.1]]), "'eta' is a number"),
        (lambda d: d["structure"]["lumped"]["links"][0].update(eta=2.5), "between 0 and 2, not at 2.5"),
        (lambda d: d["structure"]["lumped"]["links"][0].pop("k"), "'eta' is the loss factor of a stiffness"),
        (lambda d: d["structure"]["lumped"]["damping"].update(ratio=0.01), "either proportional"),
        (lambda d: d["structure"]["lumped"].update(damping={}), "either proportional"),
    ],
)
def test_what_makes_no_sense_is_said_at_its_place(tmp_path, change, said):
    with pytest.raises(SceneError, match=said):
        load_scene(scene(tmp_path, change))


def with_time(data):
    data["analysis"] = {
        "outputs": [{"dof": 3, "quantity": "displacement"}],
        "time": {"stop": 0.1, "step": 0.01},
    }
    data["excitation"] = [{"dof": 1, "kind": "sine", "amplitude": 1, "frequency": 3}]


def test_motion_in_time_takes_equivalent_dampers_which_are_named(tmp_path):
    with pytest.raises(UsageError, match="is not causal: it has no time response"):
        dynid.run(scene(tmp_path, with_time))

    def equivalent(data):
        with_time(data)
        data["structure"]["lumped"]["damping"]["equivalent"] = {"at": 20, "unit": "Hz"}

    result = dynid.run(scene(tmp_path, equivalent))
    assert np.isfinite(result["structure/time_response/response"].data).all()
    said = result.group_attrs["structure/damping"]["doubt"]
    assert said.startswith("dampers eta k / omega of 125.664 rad/s (20 Hz) stand for the structural damping")


def test_modal_ratios_beside_a_loss_factor_are_refused(tmp_path):
    def ratios(data):
        data["structure"]["lumped"]["damping"] = {"ratio": 0.01}

    with pytest.raises(UsageError, match="damping ratios of modes stand beside loss factors"):
        dynid.run(scene(tmp_path, ratios))


def test_a_narrow_band_is_said_before_the_test(tmp_path):
    def both(data):
        data.update(yaml.safe_load(MEASURED))
        del data["analysis"]
        data["joints"]["bolt"]["c"] = {"start": 1.0, "true": 3.0}
        data["measurement"]["frf"]["simulate"]["lines"].update(start=20, stop=22)

    said = [fact.text for fact in explain(load_scene(scene(tmp_path, both))).facts if fact.topic == "damping"]
    assert len(said) == 1
    assert said[0].startswith("warning: bolt.eta and bolt.c can hardly be distinguished between")

    def one(data):
        both(data)
        del data["joints"]["bolt"]["c"]

    facts = explain(load_scene(scene(tmp_path, one))).facts
    assert not [fact for fact in facts if fact.topic == "damping"]


def test_reductions_have_the_projected_matrix(tmp_path):
    text = """
dynid: 1
kind: reduction
structure:
  beam:
    {elements: 4, length: 1, EI: 100, rhoA: 1, eta: [0.1, 0.2, 0.3, 0.4], supports: [{node: 1, fix: [w]}]}
joints: {tip: {dofs: [w_5], k: 50, eta: 0.5}}
reduction: [{method: guyan, masters: [w_3, w_5]}]
frequency: {start: 1, stop: 5, points: 5, unit: Hz}
"""
    result = dynid.run(scene(tmp_path, text=text))
    T, full = result["reduction/guyan/T"].data, result["reduction/frf/full"].data
    H = result["reduction/guyan/structural_damping"].data
    assert np.linalg.eigvalsh(H).min() > 0
    assert np.iscomplexobj(full)
    assert [*result["reduction/dof"].data][7] == "w_5"
    joint = 25 * np.outer(T[7], T[7])
    assert np.linalg.eigvalsh(H - joint).min() > 0


POINTS = """
dynid: 1
kind: identification
structures:
  a:
    space_frame: &frame
      nodes: [[0, 0, 0], [1, 0, 0]]
      members: [{nodes: [1, 2], EA: 1.0e6, EIy: 1000, EIz: 2000, GJ: 500, rhoA: 1, rhoJ: 0.01, eta: 0.01}]
      supports: [{node: 1, fix: [x, y, z, rx, ry, rz]}]
  b: {space_frame: *frame}
points: {p: {part: a, node: 2}, q: {part: b, node: 2}}
joints:
  bolt: {points: [p, q], k: {x: 1.0e4, rz: {start: 1000}}, eta: {x: 0.3, rz: {start: 0.1}}}
analysis:
  inputs: [a.2:x]
  outputs: [{dof: b.2:x, quantity: displacement}]
  frequency: {start: 1, stop: 5, points: 3, unit: Hz}
"""


def test_a_joint_between_points_has_loss_factors_by_direction(tmp_path):
    data = yaml.safe_load(POINTS)
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(data))
    structure = structure_of(load_scene(path))
    assert [item.name for item in structure.unknowns] == ["bolt.k.rz", "bolt.eta.rz"]
    at = {item.name: item.start for item in structure.unknowns}
    bare = structure.joined(())
    H = structure.with_joints(at, loss=True)[2].imag - bare.with_joints(loss=True)[2].imag
    wanted = np.zeros_like(H)
    for along, size in (("x", 3e3), ("rz", 100.0)):
        row = structure.row(f"a.2:{along}") - structure.row(f"b.2:{along}")
        wanted += size * np.outer(row, row)
    np.testing.assert_allclose(H, wanted, atol=1e-9)
    np.testing.assert_allclose(bare.H, 0.01 * bare.K, atol=1e-9)
    data["joints"]["bolt"]["eta"] = {"start": 0.1}
    path.write_text(yaml.safe_dump(data))
    with pytest.raises(UsageError, match="one unknown eta for k of several directions"):
        structure_of(load_scene(path))
    data["joints"]["bolt"]["eta"] = 0.2
    path.write_text(yaml.safe_dump(data))
    structure = structure_of(load_scene(path))
    names = {term.name for joint in structure.joints for term in joint.terms}
    assert {"bolt.eta.x", "bolt.eta.rz"} <= names
    data["joints"]["bolt"] = {
        "points": ["p", "q"],
        "k": {"matrix": np.diag([1e4, 1e4, 1e4]).tolist()},
        "eta": 0.2,
    }
    path.write_text(yaml.safe_dump(data))
    structure = structure_of(load_scene(path))
    H = structure.with_joints(loss=True)[2].imag - bare.H
    row = structure.row("a.2:y") - structure.row("b.2:y")
    assert row @ H @ row == pytest.approx(4 * 2e3, rel=1e-9)
