"""Joints identified with reduced models, from records of the full structure."""

import importlib
from collections import Counter

import numpy as np
import pytest

import dynid
from dynid.errors import DynidError
from dynid.identification.estimators import filter_passes, multi_start
from dynid.scene.kinds.identification import interest_of, reduction_of, responding_structure
from dynid.scene.run import preparation_errors
from dynid.structure.reduction.mode_selection import Interest
from tests.scene.example_scenes import JOINTS, check, faults_of

identify_module = importlib.import_module("dynid.identification.identify")
BEAM = """\
dynid: 1
kind: identification
structure:
  beam: {elements: 7, length: 7, EI: 1723.3, rhoA: 0.1, supports: [{node: 1, fix: [w]}],
    damping: {alpha: 0.1}}
joints:
  root: {dofs: [1], k: {start: 2.5e3, true: 5.0e3}}
  support: {dofs: [10], k: {start: 5.0e3, true: 1.0e4}, c: {start: 10, true: 20}}
reduction: {method: joint-aware, modes: {count: 8}, residuals: none}
excitation: [{dof: 6, kind: multisine, amplitude: [100, 100, 100], frequency: [45, 250, 300]}]
measurement:
  step: 0.002
  samples: 800
  channels: [{dof: 6, quantity: velocity}, {dof: 10, quantity: velocity}]
  simulate: {noise_ratio: 0, settle: 20, model: full}
estimator: {method: filter, passes: 2}
"""
AWARE = "{method: joint-aware, modes: {count: 8}, residuals: none}"
SEREP = "{method: serep, masters: [1, 6, 10], modes: [2, 3, 4]}"


def errors(text):
    result = dynid.run(check(text))
    return result, result["identification/parameters/error_percent"].data


def test_a_basis_that_follows_the_joints_finds_them_where_the_papers_does_not():
    result, aware = errors(BEAM)
    # Excited where the paper's own basis is wrong (its Table 5 has 17 to 42 %).
    assert aware.max() < 0.5
    assert len(result["identification/history/component"].data) == 16
    start = result["identification/parameters/start"].data
    np.testing.assert_array_equal(start, [2.5e3, 5e3, 10])
    assert result.value("identification/diagnostics/passes") > 2  # the basis was made anew
    _, paper = errors(BEAM.replace(AWARE, SEREP))
    assert paper.max() > 20


def test_a_rebuilt_basis_costs_its_own_fits_and_no_search_again(monkeypatch):
    """However often it is rebuilt: one filter pass, and a comparison of models at the first and last."""
    counts = Counter()

    def counted(module, name):
        function = getattr(module, name)

        def call(*args, **kwargs):
            counts[name] += 1
            return function(*args, **kwargs)

        monkeypatch.setattr(module, name, call)

    counted(filter_passes, "filter_pass")
    counted(multi_start, "compare_models")
    counted(identify_module, "_estimated")
    text = BEAM.replace("{method: filter, passes: 2}", "{method: auto}")
    noisy = text.replace("noise_ratio: 0,", "noise_ratio: 0.05,").replace("model: full", "model: reduced")
    result, error = errors(noisy)
    assert counts["_estimated"] > 1
    assert (counts["filter_pass"], counts["compare_models"]) == (1, 1)
    assert result.value("identification/diagnostics/converged")
    assert result["identification/diagnostics/distance_to_optimum"].data.max() < 1e-4
    assert error.max() < 10


@pytest.mark.thorough
def test_joints_get_residual_vectors_where_neither_these_nor_masters_are_named():
    def coordinates(text):
        result, found = errors(text.replace("samples: 800", "samples: 400"))
        return len(result["identification/history/component"].data) / 2, found

    size, found = coordinates(BEAM.replace(", residuals: none", ""))
    assert size == 8 + 3  # DOFs 1, 6 and 10, of joints, sensors and the force
    assert found.max() < 1e-4  # 0.29 without
    np.testing.assert_array_equal(found, coordinates(BEAM.replace("none", "auto"))[1])
    short = BEAM.replace("samples: 800", "samples: 60").replace("passes: 2", "passes: 1")
    for plain in (
        "residuals: []",
        "residuals: none",
        "residuals: none, masters: {count: 8}",
        "masters: {count: 8}",
    ):
        assert coordinates(short.replace("residuals: none", plain))[0] == 8


def test_residual_vectors_at_the_joints_find_them_better_with_as_many_coordinates():
    text = BEAM.replace("modes: {count: 8}, residuals: none", "modes: {count: 5}, residuals: [1, 6, 10]")
    result, found = errors(text)
    assert len(result["identification/history/component"].data) == 16
    assert found.max() < 0.01  # 0.29 without
    with_masters = BEAM.replace("modes: {count: 8}, residuals: none", "masters: [1, 6], residuals: [1]")
    assert faults_of(with_masters)[0].startswith("9:12: with residual vectors the coordinates are modal")


@pytest.mark.parametrize(
    "reduction", [SEREP, "{method: craig-bampton, masters: [1, 6, 10], modes: {count: 3}}"]
)
def test_records_of_the_reduced_model_itself_are_explained_by_it(reduction):
    text = BEAM.replace(AWARE, reduction)
    result, found = errors(text.replace("model: full", "model: reduced"))
    assert found.max() < 0.05
    assert result.value("identification/diagnostics/converged")


def test_masters_and_modes_come_from_the_scene_where_they_are_not_given():
    result, found = errors(BEAM.replace(AWARE, "{method: craig-bampton}"))
    components = list(result["identification/history/component"].data)
    # The ends of the joints, then the sensors and the force, then the modes inside.
    assert components[:3] == ["theta_1.displacement", "w_6.displacement", "w_4.displacement"]
    assert components[3] == "fixed_mode_1.displacement"
    assert found.max() < 1


def test_responses_are_those_of_the_reduced_model():
    text = BEAM[: BEAM.index("measurement:")].replace(AWARE, SEREP)
    text += "analysis:\n  outputs: [{dof: 3, quantity: displacement}]\n"
    text += "  frequency: {start: 30, stop: 60, points: 3}\n  time: {stop: 0.1, step: 0.01}\n"
    reduced = dynid.run(check(text))["structure/frequency_response/response"].data
    full = dynid.run(check(text.replace(f"reduction: {SEREP}\n", "")))
    full = full["structure/frequency_response/response"].data
    assert reduced.shape == full.shape
    assert np.abs(reduced / full - 1).max() > 0.1  # as wrong as that basis is


def test_the_force_of_a_time_response_is_a_master():
    text = BEAM[: BEAM.index("excitation:")].replace("{start: 2.5e3, true: 5.0e3}", "5.0e3")
    text = text.replace("{start: 5.0e3, true: 1.0e4}", "1.0e4").replace("{start: 10, true: 20}", "20")
    text += "analysis:\n  outputs: [{dof: 3, quantity: displacement}]\n"
    text += "  time: {stop: 0.1, step: 0.01, input: {kind: step, dof: 7, amplitude: 1}}\n"
    chosen, named = (
        dynid.run(check(text.replace(AWARE, f"{{method: guyan{masters}}}")))[
            "structure/time_response/response"
        ]
        for masters in ("", ", masters: [1, 10, 3, 7]")
    )
    np.testing.assert_allclose(chosen.data, named.data, rtol=1e-9)


def test_an_initial_motion_of_the_reduced_model_is_the_nearest_one():
    text = JOINTS[: JOINTS.index("excitation")].replace("{start: 1.0e4, true: 2.0e4}", "2.0e4")
    text = text.replace("{start: 10, true: 20}", "20").replace(
        "{dofs: [4, 5]", "{dofs: [3, 4], k: 1.0e4}, {dofs: [4, 5]"
    )
    text += "reduction: {method: joint-aware, modes: [1, 2, 3, 4, 5]}\n"
    text += "analysis: {outputs: [{dof: 2}, {dof: 5}], time: {stop: 0.1, step: 0.01}}\n"
    text += "initial: {2: {x: 0.01}, 5: {v: 1}}\n"
    reduced = dynid.run(check(text))["structure/time_response/response"].data
    full = dynid.run(check(text.replace("reduction: {method: joint-aware, modes: [1, 2, 3, 4, 5]}\n", "")))
    np.testing.assert_allclose(reduced, full["structure/time_response/response"].data, atol=1e-12)


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("modes: {count: 8}", "masters: [1, 16]", "9:47: there is no DOF 16; the structure has 15"),
        ("modes: {count: 8}", "masters: [1, 6, 6]", "9:43: DOF 6 is listed twice"),
        ("joint-aware", "joint-awair", "9:21: 'method' cannot be 'joint-awair'; it is one of serep, guyan,"),
        ("modes: {count", "mods: {count", "9:34: 'mods' is not a key of reduction; did you mean 'modes'?"),
    ],
)
def test_a_mistake_in_a_reduction_is_one_sentence_at_its_place(right, wrong, fault):
    found = faults_of(BEAM.replace(right, wrong))
    assert len(found) == 1, found
    assert found[0].startswith(fault), found


def test_a_record_of_a_reduced_model_needs_one():
    found = faults_of(JOINTS.replace("model: full", "model: reduced"))
    assert found == ["1:1: the record is to be simulated with the reduced model, but there is no 'reduction'"]


def test_what_is_wrong_with_samples_is_said_where_they_stand():
    text = BEAM.replace("{method: joint-aware, modes: {count: 8}, residuals: none}", "{method: guyan}")
    text = text.replace("multisine, amplitude: [100, 100, 100], frequency: [45, 250, 300]", "random")
    for wrong, line in (("samples: 1", 13), ("step: 1.0e-300", 12)):
        scene = check(text.replace("samples: 800" if line == 13 else "step: 0.002", wrong))
        with pytest.raises(DynidError) as caught:
            dynid.run(scene)
        assert scene.locate(caught.value).line == line


RESPONDING = """\
dynid: 1
kind: identification
structure:
  lumped:
    masses: [1, 1, 1, 1, 1]
    links: [{dofs: [1], k: 1}, {dofs: [1, 2], k: STIFF}, {dofs: [2, 3], k: STIFF}, {dofs: [3, 4], k: STIFF},
            {dofs: [4, 5], k: STIFF}]
joints:
  end: {dofs: [3], k: {start: 1, true: 2}}
reduction: {method: modal, modes: {count: 1}}
analysis: {frequency: {start: 0.1, stop: 0.5, points: 5}, inputs: [1], outputs: [{dof: 3}]}
"""


def test_the_band_of_a_reduced_response_is_that_of_its_frequencies():
    text = RESPONDING.replace("STIFF", "100")
    scene = check(text)
    assert interest_of(scene) == Interest((1, 3), 0.5)
    unreduced = text[: text.index("reduction")] + text[text.index("analysis") :]
    path = "structure/frequency_response/response"
    reduced = dynid.run(scene)
    # The next mode is far above: residual vectors stand for it.
    np.testing.assert_allclose(reduced[path].data, dynid.run(check(unreduced))[path].data, rtol=1e-7)
    assert reduced["structure/frequency_response/omega"].data[-1] == 0.5
    assert preparation_errors(scene) == []
    structure, values = responding_structure(scene)
    assert values == {"end.k": 2}
    assert structure.size == 3  # of 5: the mode, and residual vectors at the force and the joint
    modes = text[: text.index("analysis")] + "analysis: {modes: {count: 1}}\n"
    assert interest_of(check(modes)).band is None


def test_a_doubtful_basis_is_told():
    text = RESPONDING.replace("STIFF", "1e13").replace("{count: 1}", "{count: 1}, residuals: none")
    result = dynid.run(check(text.replace("start: 1, true: 2", "start: 1.0e-3, true: 1.0e-3")))
    said = "rounding of the stiffness leaves the frequency of mode 1 open"
    assert result.group_attrs["structure"]["doubt"].startswith(said)


def test_a_basis_for_a_record_of_its_whole_band_has_no_residual_vectors():
    text = BEAM.replace(", residuals: none", "")
    # Excited up to 300 rad/s; half the sampling rate is 314 rad/s, then 157 rad/s.
    assert reduction_of(check(text.replace("step: 0.002", "step: 0.01"))).residuals is not None
    assert reduction_of(check(text.replace("step: 0.002", "step: 0.02"))).residuals is None
