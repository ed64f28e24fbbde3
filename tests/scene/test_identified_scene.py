"""The identified scene: `dynid export --scene`."""

import numpy as np
import pytest

import dynid
from dynid.errors import UsageError
from dynid.scene.identified import identified_scene
from dynid.scene.yaml.source import parse_source

SCENE = """\
# Two masses with a bolt.
dynid: 1
kind: identification
title: Bolt
structure:
  lumped:
    masses: [1.2, 0.8]   # kg
    links: [{dofs: [1], k: 1.5e4, c: 4}]
parameters:
  k0: {start: 1.0e4, true: 2.0e4}
  area: 1.0e-4           # m^2
joints:
  bolt: {dofs: [1, 2], k: k0, c: {start: 2, true: 3}}   # M8
excitation: [{dof: 2, kind: multisine, amplitude: [10, 10], frequency: [60, 150]}]
# How it was measured.
measurement:
  step: 0.005
  samples: 200
  channels: [{dof: 1, quantity: velocity}]
  simulate: {noise_ratio: 0.02, seed: 1}
estimator: {method: auto}
expect:
  - {path: identification/diagnostics/converged, value: true}
"""


def run(text, tmp_path, name="scene.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return dynid.run(dynid.load_scene(path))


def kept(text, tmp_path):
    """Return the result of a text as a file keeps it: with its scene."""
    result = run(text, tmp_path)
    result.attrs["scene"] = text
    return result


def test_the_estimates_stand_in_place_of_the_unknowns_to_the_last_digit(tmp_path):
    result = kept(SCENE, tmp_path)
    text = identified_scene(result)
    data = parse_source(text).data
    k0, c = result["identification/parameters/estimate"].data[
        [list(result["identification/parameters/name"].data).index(name) for name in ("k0", "bolt.c")]
    ]
    assert data["parameters"] == {"k0": k0, "area": 1e-4}
    assert data["joints"]["bolt"] == {"dofs": [1, 2], "k": "k0", "c": c}
    assert not {"measurement", "estimator", "expect"} & data.keys()
    for comment in ("# Two masses with a bolt.", "# kg", "# M8", "# m^2", "standard error: k0 "):
        assert comment in text
    order = ["dynid", "kind", "title", "structure", "parameters", "joints", "excitation", "analysis"]
    assert list(data) == order


def test_the_identified_scene_has_the_modes_of_the_estimate(tmp_path):
    result = kept(SCENE, tmp_path)
    again = run(identified_scene(result), tmp_path, "identified.yaml")
    np.testing.assert_allclose(
        again["structure/modes/omega"].data,
        result["identification/derived/modes/frequency/value"].data,
        rtol=1e-3,  # modes of the undamped structure, sizes of the poles of the damped one
    )


def test_the_analysis_stays_with_the_outputs_of_the_record(tmp_path):
    text = SCENE + "analysis: {frequency: {start: 1, stop: 50, points: 5}}\n"
    data = parse_source(identified_scene(kept(text, tmp_path))).data
    assert data["analysis"]["outputs"] == [{"dof": 1, "quantity": "velocity"}]
    assert data["analysis"]["frequency"] == {"start": 1, "stop": 50, "points": 5}
    run(identified_scene(kept(text, tmp_path)), tmp_path, "identified.yaml")


def test_a_factor_of_a_matrix_stays_one(tmp_path):
    text = SCENE.replace("c: {start: 2, true: 3}", "c: {start: 2, true: 3, matrix: [[1, -1], [-1, 1]]}")
    result = kept(text, tmp_path)
    written = parse_source(identified_scene(result)).data["joints"]["bolt"]["c"]
    assert written["matrix"] == [[1, -1], [-1, 1]]
    again = run(identified_scene(result), tmp_path, "identified.yaml")
    reference = run(identified_scene(kept(SCENE, tmp_path)), tmp_path, "identified.yaml")
    np.testing.assert_allclose(
        again["structure/modes/damping"].data, reference["structure/modes/damping"].data, rtol=1e-6
    )


def test_a_graph_becomes_a_bond_graph(tmp_path):
    text = """\
dynid: 1
kind: identification
parameters:
  J: {start: 2.0e-3, true: 1.0e-3}
graph:
  nodes: {U: Se, one: 1, R: {type: R, value: 2}, J: {type: I, value: J}}
  bonds: [U -> one, one -> R, one -> J]
excitation: [{source: U, kind: sine, amplitude: 1, frequency: 500}]
measurement:
  step: 0.0005
  samples: 100
  channels: [{output: J.f}]
  simulate: {noise_ratio: 0.02, seed: 1}
"""
    result = kept(text, tmp_path)
    data = parse_source(identified_scene(result)).data
    assert data["kind"] == "bond-graph"
    assert data["analysis"] == {"inputs": ["U"], "outputs": ["J.f"]}
    again = run(identified_scene(result), tmp_path, "identified.yaml")
    pole = again["bond_graph/transfer_function/J.f/U/poles"].data
    np.testing.assert_allclose(pole, result["identification/derived/poles/value"].data, rtol=1e-12)


def test_a_result_without_an_identification_is_refused(tmp_path):
    text = SCENE[: SCENE.index("excitation")] + "analysis: {modes: {count: 2}}\n"
    result = kept(text, tmp_path)
    with pytest.raises(UsageError, match=r"bolt\.h5 holds no identification"):
        identified_scene(result, "bolt.h5")


def test_scenes_in_one_line_or_with_long_values_are_written_anew(tmp_path):
    text = SCENE.replace("k0: {start: 1.0e4, true: 2.0e4}", "k0:\n    start: 1.0e4\n    true: 2.0e4")
    data = parse_source(identified_scene(kept(text, tmp_path))).data
    assert isinstance(data["parameters"]["k0"], float)
