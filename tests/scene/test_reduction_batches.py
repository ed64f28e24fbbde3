"""Samples of a reduction side by side are those that each gives alone, within rounding of the matrices."""

import math

import numpy as np
import pytest

from dynid.result import NUMBERS
from dynid.scene.batch import run_alone, run_batch, why_alone
from dynid.scene.explanation import explain
from dynid.scene.kind import KINDS
from dynid.scene.load import check_source
from dynid.scene.run import scene_doubts
from dynid.scene.yaml.source import parse_source

BEAM = """
dynid: 1
kind: reduction
parameters: {EI: 1700, rhoA: 0.1, width: 2, area: 'width * 0.05', kb: 3.0e4}
structure:
  beam:
    elements: 7
    length: 7
    EI: EI
    rhoA: area
    supports: [{node: 1, fix: [w]}, {node: 8, fix: [w, theta]}]
    masses: [{node: 4, m: 0.2}]
    damping: {alpha: 0.1, beta: 1.0e-5}
joints: {bearing: {dofs: [theta_1], k: kb, c: 0.5}}
reduction:
  - {method: serep, masters: [1, 4, 8, 12], modes: [1, 2, 3, 4]}
  - {method: joint-aware, masters: [1, 4, 8], modes: {count: 3}}
  - {method: joint-aware, modes: [1, 3, 4]}
  - {method: joint-aware, modes: [1, 3], residuals: auto}
  - {method: guyan, masters: [1, 2, 6, 10]}
  - {method: guyan}
  - {method: dynamic, masters: [1, 2, 6, 10], frequency: 2, unit: Hz}
  - {method: dynamic, masters: [1, 2, 6]}
  - {method: craig-bampton, masters: [1, 6], modes: {count: 3}}
  - {method: craig-bampton, masters: [1, 6], modes: {count: 0}}
  - {method: modal, modes: {count: 4}}
  - {method: modal, modes: [1, 2], residuals: [w_4, w_6]}
  - {method: modal, modes: [1, 2], residuals: none}
  - {method: irs, masters: [1, 6, 10]}
  - {method: irs, masters: [1, 6, 10], iterations: 4}
frequency: {start: 1, stop: 60, points: 5}
inputs: [w_4]
outputs: [{dof: w_6, quantity: acceleration}]
"""
MATRICES = ("T", "mass", "damping", "stiffness", "mass_without_joints", "stiffness_without_joints")
MODES = ("frequencies", "reference", "frequency_error", "frequency_uncertainty", "reference_uncertainty")
OTHERS = ("mac", "orthogonality", "masters", "modes", "condition", "energy_error")
COLLECT = (*(f"reduction/*/{key}" for key in (*MATRICES, *MODES, *OTHERS)), "reduction/frf")
VARIED = {
    "parameters.EI": (1500.0, 2200.0),
    "parameters.width": (1.5, 3.0),
    "parameters.kb": (1e3, 1e5),
    "structure.beam.masses.0.m": (0.05, 0.5),
    "structure.beam.length": (6.0, 9.0),
    "joints.bearing.c": (0.1, 2.0),
}


def scene(text):
    return check_source(parse_source(text.strip("\n"), "scene.yaml"))


def overrides(varied, count=4):
    random = np.random.default_rng(1)
    return [{path: float(random.uniform(*limits)) for path, limits in varied.items()} for _ in range(count)]


def assert_together(template, samples, collect=COLLECT, pending=(), rounding=2e-13):
    """Check that samples are run together, but for the pending ones, and agree with each alone."""
    assert why_alone(template, tuple(samples[0]), collect) == ""
    plan = KINDS["reduction"].load("samples")(template, tuple(samples[0]), collect)
    outcomes = plan.run(samples)
    assert outcomes.pending == list(pending)
    whole = run_batch(template, samples, collect)
    for sample, outcome in zip(samples, whole, strict=True):
        alone = run_alone(template, sample, collect)
        assert (outcome.error, outcome.exit_code) == (alone.error, alone.exit_code)
        assert outcome.values.keys() == alone.values.keys()
        for path, one in alone.values.items():
            other = outcome.values[path]
            assert (other.dims, other.units, other.data.dtype) == (one.dims, one.units, one.data.dtype)
            if one.data.dtype.kind not in "fc":
                assert np.array_equal(one.data, other.data), path
                continue
            size = 1.0 if path.endswith("error") else np.abs(one.data).max()
            assert np.abs(one.data - other.data).max() <= 1e-9 * size, path
            if path.endswith("/frequencies"):
                open_by = alone.values[path.replace("frequencies", "frequency_uncertainty")].data
                assert np.all(np.abs(one.data - other.data) <= 8 * open_by + rounding * one.data)
    return outcomes


@pytest.mark.thorough
def test_all_methods_of_a_jointed_beam():
    assert_together(scene(BEAM), overrides(VARIED))


@pytest.mark.thorough
def test_without_joints_a_basis_of_modes_is_compared_with_these():
    text = BEAM.replace("joints:", "substructures: {} #").replace("modes: [1, 3, 4]", "modes: [1, 3]")
    text = text.replace("  - {method: guyan}\n", "")
    varied = {path: limits for path, limits in VARIED.items() if "joints" not in path}
    collect = tuple(path for path in COLLECT if "without" not in path)
    assert_together(scene(text), overrides(varied), collect)


@pytest.mark.parametrize(
    ("structure", "path"),
    [
        (
            "lumped: {masses: [1, 2, 3], links: [{dofs: [1], k: 10, c: 1}, {dofs: [1, 2], k: 20}, "
            "{dofs: [2, 3], k: 30}]}",
            "structure.lumped.links.1.k",
        ),
        (
            "frame: {nodes: [[0, 0], [0, 2], [2, 2]], members: ["
            "{nodes: [1, 2], EA: 1e6, EI: 1e3, rhoA: 1, elements: 2}, "
            "{nodes: [2, 3], EA: 1e6, EI: 1e3, rhoA: 1}], supports: [{node: 1, fix: [u, w, theta]}]}",
            "structure.frame.members.1.EI",
        ),
        (
            "frame: {nodes: [[0, 0], [0, 2], [2, 2]], members: ["
            "{nodes: [1, 2], EA: 1e6, EI: 1e3, rhoA: 1, elements: 2}, "
            "{nodes: [2, 3], EA: 1e6, EI: 1e3, rhoA: 1}], supports: [{node: 1, fix: [u, w, theta]}]}",
            "structure.frame.nodes.2.0",
        ),
    ],
)
def test_other_structures(structure, path):
    text = (
        f"dynid: 1\nkind: reduction\nstructure:\n  {structure}\nreduction: [{{method: guyan, masters: [1]}}]"
    )
    samples = [{path: value} for value in (5.0, 25.0, 40.0)]
    assert_together(
        scene(text), samples, ("reduction/guyan/frequencies", "reduction/guyan/frequency_uncertainty")
    )


#: The first of the reductions alone.
SEREP = BEAM[: BEAM.index("  - {method: joint-aware")] + BEAM[BEAM.index("frequency: {start") :]


@pytest.mark.parametrize("odd", [0.0, -1.0, math.nan, 1e300, 1e-320, "2*kb", "nobody", True, None, 0.5])
def test_an_odd_value_gives_what_it_gives_alone(odd):
    template, path = scene(SEREP), "structure.beam.masses.0.m"
    pending = [] if odd in (0.5, 1e-320) else [1]
    outcomes = assert_together(
        template,
        [{path: 0.2}, {path: odd}, {path: 0.3}],
        ("reduction/serep/T", "reduction/serep/mac"),
        pending,
    )
    assert [one.error for one in (outcomes[0], outcomes[2])] == ["", ""]


def test_expectations_are_counted():
    text = BEAM + "expect: [{path: reduction/serep/condition, max: 1.0e9}]\n"
    template = scene(text)
    from dynid.study.work import meets

    samples = overrides(VARIED, 2)
    outcomes = run_batch(template, samples, ("reduction/serep/T",), meets)
    assert [one.expectations for one in outcomes] == [(True,), (True,)]
    assert [list(one.values) for one in outcomes] == [
        list(run_alone(template, samples[0], ("reduction/serep/T",)).values)
    ] * 2


SOLID = "reduction/serep/frequencies"


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("old", "new", "method"),
    [
        ("{node: 8, fix: [w, theta]}", "{node: 8, fix: [theta]}", ""),
        ("alpha: 0.1, beta: 1.0e-5", "alpha: 0.1", ""),
        ("modes: [1, 2, 3, 4]", "modes: {below: 100}", "serep"),
        ("modes: [1, 2, 3, 4]", "modes: [1, 2, 3]", "serep"),
        ("masters: [1, 4, 8, 12]", "masters: {count: 4}", "serep"),
        ("masters: [1, 4, 8, 12]", "masters: {choose: effective-independence}", "serep"),
        ("masters: [1, 2, 6, 10]", "masters: {count: 4}", "guyan"),
        ("masters: [1, 6], modes: {count: 3}", "masters: [1, 6], modes: {below: 400}", "craig-bampton"),
        ("joint-aware, modes: [1, 3, 4]", "joint-aware, modes: {below: 150}", "joint-aware"),
        ("modal, modes: {count: 4}", "modal", ""),
    ],
)
def test_samples_with_equal_choices_of_a_method_are_run_together(old, new, method):
    assert old in BEAM
    collect = tuple(path.replace("*", f"{method}*") for path in COLLECT if not method or "*" in path)
    assert_together(scene(BEAM.replace(old, new, 1)), overrides(VARIED, 4), collect, rounding=1e-12)


def test_methods_of_which_nothing_is_collected_are_not_run():
    """Mode 2 of three equal masses between walls has a node at the master: SEREP is singular."""
    template = scene(
        "dynid: 1\nkind: reduction\n"
        "structure: {lumped: {masses: [1, 1, 1], links: [{dofs: [1], k: 1}, {dofs: [1, 2], k: 1}, "
        "{dofs: [2, 3], k: 1}, {dofs: [3], k: 1}]}}\n"
        "reduction: [{method: guyan, masters: [2]}, {method: serep, masters: [2], modes: [2]}]"
    )
    samples = [{"structure.lumped.masses": [mass, 1, mass]} for mass in (1, 2)]
    outcomes = run_batch(template, samples, ("reduction/guyan/frequencies",))
    assert [one.error for one in outcomes] == ["", ""]
    assert [one.exit_code for one in run_batch(template, samples, ("reduction/serep/frequencies",))] == [3, 3]


@pytest.mark.thorough
@pytest.mark.parametrize("area", ["-(-width) * 0.05", "sqrt(width**3) / 20"])
def test_what_is_computed_of_parameters_varies_with_them(area):
    assert_together(scene(BEAM.replace("width * 0.05", area)), overrides(VARIED), rounding=1e-12)


def test_masters_with_and_without_spaces_are_no_decimal_commas():
    assert scene_doubts(scene(BEAM.replace("masters: [1, 2, 6, 10]", "masters: [1,2, 6,10]"))) == []


def test_a_reduction_that_cannot_be_made_is_an_obstacle():
    template = scene(BEAM.replace("modes: [1, 2, 3, 4]", "modes: [1, 2, 3, 99]"))
    assert "99" in str(explain(template).obstacle)


@pytest.mark.thorough
def test_a_rigid_body_mode_that_no_method_keeps_is_no_obstacle():
    """Without its joint the beam turns freely about its pinned end."""
    text = BEAM.replace("{node: 8, fix: [w, theta]}", "").replace(
        "modes: [1, 2, 3, 4]", "modes: [2, 3, 4, 5]"
    )
    assert_together(scene(text), overrides(VARIED), rounding=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "collect", "why"),
    [
        ("alpha: 0.1, beta: 1.0e-5", "ratio: 0.01", "reduction/serep/frequencies", ""),
        ("alpha: 0.1, beta: 1.0e-5", "ratio: 0.01", "reduction/serep/damping", "modal damping is computed"),
        # All nodes have one mass: which of them are masters is a matter of rounding.
        ("masters: [1, 2, 6, 10]", "masters: {count: 4, choose: mass}", "reduction/guyan/T", "no usual case"),
        ("stop: 60", "stop: EI", "reduction/serep/T", "more than numbers of the structure and its joints"),
        (
            "alpha: 0.1, beta: 1.0e-5",
            "eta: 0.01",
            "reduction/serep/T",
            "structural damping is computed",
        ),
    ],
)
def test_why_samples_of_a_scene_are_run_alone(old, new, collect, why):
    text = BEAM.replace(old, new, 1)
    found = why_alone(scene(text), ("parameters.EI",), (collect,))
    assert (why in found) if why else found == ""


@pytest.mark.parametrize(
    ("elements", "fix", "mode", "why"),
    [
        (120, "w, theta", 3, "structures of more than 200 DOFs are reduced one by one"),
        (3, "theta", 1, "the scene as it stands is no usual case: rigid-body motions"),
        (3, "w", 99, "the scene as it stands cannot be run"),
    ],
)
def test_structures_that_are_reduced_one_by_one(elements, fix, mode, why):
    beam = f"elements: {elements}, length: 1, EI: 1, rhoA: 1, supports: [{{node: 1, fix: [{fix}]}}]"
    template = scene(
        f"dynid: 1\nkind: reduction\nstructure: {{beam: {{{beam}}}}}\n"
        f"reduction: [{{method: modal, modes: [{mode}]}}]"
    )
    found = why_alone(template, ("structure.beam.EI",), ("reduction/modal/frequencies",))
    assert found.startswith(why)


@pytest.mark.parametrize(
    ("path", "collect", "why"),
    [
        ("structure.beam.elements", "frequencies", "more than numbers of the structure and its joints"),
        ("title", "frequencies", "title is no number of the structure or its joints"),
        ("structure", "frequencies", "structure is no number of the structure or its joints"),
    ],
)
def test_why_samples_over_a_path_are_run_alone(path, collect, why):
    template = scene(f"title: a beam{BEAM}")
    assert why in why_alone(template, (path,), (f"reduction/serep/{collect}",))


def test_samples_of_which_nothing_is_collected_are_run_together():
    assert_together(scene(BEAM), overrides({"parameters.kb": VARIED["parameters.kb"]}), collect=(NUMBERS,))
