"""The identified scene: `dynid export --scene`."""

import json

import numpy as np
import pytest

import dynid
from dynid.errors import UsageError
from dynid.result import Result
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


@pytest.mark.usefixtures("complete")
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


@pytest.mark.usefixtures("complete")
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


FRF = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [1, 2], links: [{dofs: [1], k: 300, c: 2}]}
joints:
  link: {dofs: [1, 2], k: {start: 100, true: 200}, c: {start: 2, true: 1}}
measurement:
  channels:
    - {dof: 1, quantity: acceleration, reference: {dof: 2}}
    - {dof: 2, quantity: acceleration, reference: {dof: 2}}
  frf: {simulate: {lines: {start: 3, stop: 30, points: 40}, noise_ratio: 0.02, seed: 3}}

# Far below the first mode.
analysis: {frequency: {start: 1, stop: 20, points: 7}}
"""


def test_frequency_responses_keep_the_forces_to_which_they_are_referred(tmp_path):
    result = kept(FRF, tmp_path)
    text = identified_scene(result)
    assert "\n# Far below the first mode.\nanalysis:" in text
    again = run(text, tmp_path, "identified.yaml")
    path = "structure/frequency_response/response"
    np.testing.assert_allclose(again[path].data, result[path].data, rtol=1e-9)
    assert again["structure/frequency_response/input"].data.tolist() == ["2"]


def test_a_graph_has_the_inputs_of_all_its_records_or_responses(tmp_path):
    head = """\
dynid: 1
kind: identification
parameters:
  J: {start: 2.0e-3, true: 1.0e-3}
graph:
  nodes: {U: Se, one: 1, R: {type: R, value: 2}, J: {type: I, value: J}, T: Se}
  bonds: [U -> one, T -> one, one -> R, one -> J]
"""
    sine = "kind: sine, amplitude: 1, frequency: 500"
    records = f"""\
measurement:
  step: 0.0005
  samples: 100
  channels: [{{output: J.f}}, {{output: R.e}}]
  simulate: {{noise_ratio: 0.02, seed: 1}}
  records:
    - {{excitation: {{source: T, {sine}}}}}
    - {{excitation: [{{source: U, {sine}}}, {{source: T, {sine}}}]}}
"""
    frf = """\
measurement:
  channels: [{output: J.f, reference: {source: T}}]
  frf: {simulate: {lines: {start: 100, stop: 5000, points: 9}, noise_ratio: 0.02}}
"""
    asked = "analysis: {outputs: [R.e], results: [poles]}\n"

    def analysis(text):
        result = kept(head + text, tmp_path)
        text = identified_scene(result)
        run(text, tmp_path, "identified.yaml")
        return parse_source(text).data["analysis"]

    assert analysis(records) == {"inputs": ["T", "U"], "outputs": ["J.f", "R.e"]}
    assert analysis(frf) == {"inputs": ["T"], "outputs": ["J.f"]}
    assert analysis(records + asked) == {"inputs": ["T", "U"], "outputs": ["R.e"], "results": ["poles"]}


def test_expectations_of_the_model_stay(tmp_path):
    own = "  - {path: structure/modes/omega, min: 1}\n"
    asked = "analysis: {modes: {count: 1}}\n"
    both = parse_source(identified_scene(kept(SCENE + own + asked, tmp_path))).data
    assert both["expect"] == [{"path": "structure/modes/omega", "min": 1}]
    assert both["analysis"] == {"modes": {"count": 1}}
    alone = SCENE[: SCENE.index("expect")] + "expect:\n" + own + asked
    text = identified_scene(kept(alone, tmp_path))
    assert text.endswith("expect:\n" + own + asked)


def test_the_initial_motion_stays_where_a_time_response_shows_it(tmp_path):
    initial = "initial: {1: {x: 0.01}}\n"
    free = SCENE + initial + "analysis: {time: {stop: 0.1, step: 0.01}}\n"
    result = kept(free, tmp_path)
    again = run(identified_scene(result), tmp_path, "identified.yaml")
    path = "structure/time_response/response"
    np.testing.assert_allclose(again[path].data, result[path].data, rtol=1e-9, atol=1e-12)
    assert "initial" not in parse_source(identified_scene(kept(SCENE + initial, tmp_path))).data


def test_a_scene_in_one_mapping_of_flow_style_is_written_anew(tmp_path):
    result = run(SCENE, tmp_path)
    result.attrs["scene"] = json.dumps(parse_source(SCENE.replace("[1, 2], k: k0", "[1, 2], k: 2*k0")).data)
    data = parse_source(identified_scene(result)).data
    assert data["joints"]["bolt"]["k"] == "2*k0"
    assert isinstance(data["parameters"]["k0"], float)
    assert "measurement" not in data


def test_a_result_without_its_scene_is_refused(tmp_path):
    result = run(SCENE, tmp_path)
    result.attrs["scene"] = ""
    with pytest.raises(UsageError, match=r"bolt\.h5 holds no scene"):
        identified_scene(result, "bolt.h5")


def test_parameters_of_laws_stand_in_their_laws():
    laws = (
        "laws: [{kind: cubic, k3: {start: 2.0e9}}, {kind: power, d: 2, a: {start: 1.0e5}}, "
        "{kind: power, d: 1, v: 1, signed: [v], a: {start: 300}}], offset: {start: 1.0e-4}"
    )
    result, group = Result("identification"), "identification/parameters"
    names = ["k0", "bolt.k3", "bolt.a", "bolt.power_2.a", "bolt.offset"]
    result.add_axis(f"{group}/parameter", names)
    values = {"name": names, "estimate": [1.5e4, -1e9, 2e5, 500.0, 2e-4], "standard_error": np.ones(5)}
    result.add_all(group, ("parameter",), **values)
    result.attrs["scene"] = SCENE.replace("c: {start: 2, true: 3}}", f"c: 3, {laws}}}")
    written = identified_scene(result)
    bolt = parse_source(written).data["joints"]["bolt"]
    assert [bolt["laws"][0]["k3"], bolt["laws"][1]["a"], bolt["laws"][2]["a"]] == [-1e9, 2e5, 500.0]
    assert bolt["offset"] == 2e-4
    assert "# Two masses with a bolt." in written
