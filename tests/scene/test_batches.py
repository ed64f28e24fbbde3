"""Samples of a scene run together are those that each gives alone: the same numbers, or the same error."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dynid
from dynid.errors import UsageError
from dynid.native import VARIABLE
from dynid.result import Result, Selection
from dynid.scene.batch import run_alone, run_batch, why_alone
from dynid.scene.kind import KINDS
from dynid.scene.load import check_source
from dynid.scene.outcomes import gather
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

CONFIGS = Path(__file__).parents[2] / "configs"
CHANNEL = "bond_graph/transfer_function/m_s.f/v_in"
VARIED = ("parameters.m_s", "parameters.b", "parameters.A_p", "parameters.C_a")
TYPICAL = (10.0, 50.0, 0.01, 1e-8)


@pytest.fixture(scope="module")
def isolator():
    return dynid.load_scene(CONFIGS / "isolator.yaml", ["analysis.results=[zeros, poles, properties]"])


def scene(text):
    return check_source(parse_source("dynid: 1\nkind: bond-graph\n" + text, "scene.yaml"))


def assert_same(template, overrides, collect=(), *, together=True):
    """Check samples against each alone, and that they are run together or not."""
    assert (why_alone(template, tuple(overrides[0]), collect) == "") == together
    outcomes = run_batch(template, overrides, collect)
    assert len(outcomes) == len(overrides)
    for override, outcome in zip(overrides, outcomes, strict=True):
        alone = run_alone(template, override, collect)
        assert (outcome.error, outcome.exit_code) == (alone.error, alone.exit_code)
        assert outcome.values.keys() == alone.values.keys()
        for path, variable in alone.values.items():
            assert outcome.values[path].equals(variable), path
    return outcomes


FACTOR = st.floats(0.1, 10)


def test_samples_are_run_together_without_the_library(isolator, monkeypatch):
    monkeypatch.setenv(VARIABLE, "0")
    assert_same(isolator, [{"parameters.m_s": mass} for mass in (9.0, 11.0)])


@settings(max_examples=10, deadline=None)
@given(st.lists(st.tuples(FACTOR, FACTOR, FACTOR, FACTOR), min_size=1, max_size=4))
def test_samples_of_the_isolator(isolator, factors):
    overrides = [
        {path: value * factor for path, value, factor in zip(VARIED, TYPICAL, row, strict=True)}
        for row in factors
    ]
    assert_same(isolator, overrides)
    assert_same(isolator, overrides, (f"{CHANNEL}/zeros", f"{CHANNEL}/poles", f"{CHANNEL}/zero_error_bound"))


@pytest.mark.parametrize(
    "odd",
    [
        0.0,
        -50.0,
        math.inf,
        math.nan,
        1e-320,
        1e300,
        10**5000,
        "2*25",
        "A_p*0",
        "1/0",
        "nobody",
        "",
        True,
        None,
        [1],
    ],
    ids=lambda value: repr(value) if not isinstance(value, int) else "integer",
)
def test_an_odd_value_gives_what_it_gives_alone(isolator, odd):
    outcomes = assert_same(isolator, [{"parameters.b": value} for value in (50, odd, 49.5)])
    assert not outcomes[0].error
    assert not outcomes[2].error


def test_a_failing_sample_is_a_row_with_the_error_that_it_has_alone(isolator):
    outcomes = assert_same(isolator, [{"parameters.A_p": 0.02}, {"parameters.A_p": 0}])
    assert not outcomes[0].error
    assert "modulus" in outcomes[1].error
    assert outcomes[1].exit_code == 2


@pytest.mark.parametrize("overrides", [[{"parameters.b": 40}, {"parameters.m_s": 5}], [{}, {}]])
def test_samples_that_differ_in_other_places_each_are_run_one_by_one(isolator, overrides):
    outcomes = run_batch(isolator, overrides, ())
    for override, outcome in zip(overrides, outcomes, strict=True):
        alone = run_alone(isolator, override, ())
        assert not alone.error
        assert all(outcome.values[path].equals(variable) for path, variable in alone.values.items())


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (MemoryError(), 3, "this needs more memory than there is"),
        (FileNotFoundError(2, "No such file", "k.mtx"), 4, "k.mtx cannot be read or written: No such file"),
        (OSError("gone"), 4, "a file cannot be read or written: gone"),
        (KeyError("k"), 3, "this is a fault of dynid itself (KeyError 'k'). Please report it"),
    ],
    ids=lambda part: type(part).__name__,
)
def test_whatever_a_sample_fails_of_is_its_outcome(isolator, monkeypatch, error, code, said):
    def fail(*_):
        raise error

    monkeypatch.setattr("dynid.scene.batch.check_source", fail)
    outcome = run_alone(isolator, {"parameters.b": 40}, ())
    assert (outcome.exit_code, outcome.error) == (code, said)


def test_outcomes_are_a_sequence(isolator):
    outcomes = run_batch(isolator, [{"parameters.b": b} for b in (40, 0, 50)], ())
    assert [one.values.keys() for one in outcomes[::-2]] == [
        outcomes[2].values.keys(),
        outcomes[0].values.keys(),
    ]
    assert outcomes[3:] == []


def test_why_samples_share_nothing_is_said(isolator):
    assert why_alone(isolator, ("expect.0.value",), ()) == "what is expected varies"
    said = why_alone(isolator, ("parameters.b.start",), ())  # b is a number, known
    assert said == "parameters.b.start is no parameter, no value of an element and no stored energy"
    synthesis = dynid.load_scene(next(iter(sorted(CONFIGS.glob("*synthesis*.yaml")))))
    said = why_alone(synthesis, ("parameters.c",), ())
    assert said == "scenes of kind synthesis share nothing"


def test_what_is_collected_comes_with_the_coordinates_of_its_axes():
    result = Result("bond-graph")
    result.add_axis("a/time", np.arange(3.0), "s")
    result.add("a/mode", np.zeros(()))
    result.add("a/b/x", np.zeros((3, 2)), ("time", "mode"))  # 'mode' above is no coordinate of two modes
    result.add("y", np.zeros(3), ("time",))  # and above 'y' there is no time
    assert set(gather(result, ("a/b/x",))) == {"a/b/x", "a/time"}
    assert set(gather(result, ("y",))) == {"y"}


def test_a_table_has_no_place_in_a_study():
    result = Result("bond-graph")
    result.add("a/steps", np.zeros(2, [("rule", object), ("place", int)]), ("step",))
    result.add("a/x", np.zeros(2), ("step",))
    with pytest.raises(UsageError, match="a/steps is a table"):
        gather(result, ("a/steps",))
    assert set(gather(result, ("a",))) == {"a/x"}


def test_only_what_is_wanted_is_kept():
    kept, source = Selection("bond-graph", ("a/*",)), Result("bond-graph")
    source.add_axis("b/time", np.arange(2.0), "s")
    source.add("a/x", np.ones(2), ("time",))
    source.add("b/x", np.ones(2), ("time",))
    for path, variable in source.items():
        kept.put(path, variable)
    assert set(kept) == {"a/x", "b/time"}


def test_groups_are_passed_over_where_nothing_is_collected_of_them():
    kept = Selection("bond-graph", ("", "a/x*"))
    asked = ("bond_graph/properties", "bond_graph", "a", "b")
    assert [kept.wants_below(group) for group in asked] == [True, False, True, False]


def test_the_chunks_do_not_matter(isolator):
    overrides = [{"parameters.m_s": 5 + 0.1 * k, "parameters.b": 20.0 + k} for k in range(12)]
    whole = run_batch(isolator, overrides, ())
    parts = [
        one for start in range(0, 12, 5) for one in run_batch(isolator, overrides[start : start + 5], ())
    ]
    for one, other in zip(whole, parts, strict=True):
        assert one.values.keys() == other.values.keys()
        assert all(one.values[path].equals(other.values[path]) for path in one.values)


FUNCTIONS = """
parameters: {w: 3, z: 0.1, m: 2, k: m*w**2, r: 2*z*sqrt(k*m), cap: 1/k}
graph:
  nodes: {F: Se, v: 1, m: {type: I, value: m}, r: {type: R, value: r}, k: {type: C, value: cap}}
  bonds: [F -> v, v -> m, v -> r, v -> k]
analysis: {outputs: [k.q], results: [transfer_function, zeros, poles, properties, hidden_modes]}
"""


@settings(max_examples=10, deadline=None)
@given(st.lists(st.tuples(st.floats(-2, 5), st.floats(-0.5, 2)), min_size=1, max_size=4))
def test_parameters_that_depend_on_others_follow(pairs):
    assert_same(scene(FUNCTIONS), [{"parameters.w": w, "parameters.z": z} for w, z in pairs])


def test_a_domain_error_is_that_of_its_sample_alone():
    outcomes = assert_same(scene(FUNCTIONS), [{"parameters.m": m} for m in (1, -1, 0, 4)])
    assert [bool(outcome.error) for outcome in outcomes] == [False, False, True, False]


def test_what_depends_on_a_value_that_does_not_exist_fails_alike():
    text = FUNCTIONS.replace("r: 2*z*sqrt(k*m)", "inverse: 1/z, r: 2*inverse + m")
    outcomes = assert_same(scene(text), [{"parameters.z": z} for z in (4, 0, 9)])
    assert [bool(outcome.error) for outcome in outcomes] == [False, True, False]


RESPONSES = """
parameters: {c: 0.25}
graph:
  nodes: {F: Se, v: 1, m: {type: I, value: 2}, r: {type: R, value: 0.4}, k: {type: C, value: c}}
  bonds: [F -> v, v -> m, v -> r, v -> k]
analysis:
  outputs: [m.f]
  frequency: {start: 0.1, stop: 10, points: 5}
  time: {stop: 1, step: 0.25}
  results: [frequency_response, time_response]
initial: {m: {f: 0.5}, k: {e: 2*c}}
"""


def test_values_of_elements_stored_energies_and_responses():
    overrides = [
        {"graph.nodes.r.value": r, "initial.m.f": f, "parameters.c": c}
        for r, f, c in ((0.4, 1, 0.1), (1, 0, 0.2), (0, 2.5, 1 / 3))
    ]
    assert_same(scene(RESPONSES), overrides, ("bond_graph/*_response/response",))


def test_stored_energy_that_varies_itself_is_not_what_its_expression_says():
    overrides = [{"parameters.c": c, "initial.k.e": e} for c, e in ((0.1, 3), (0.5, 0))]
    assert_same(scene(RESPONSES), overrides, ("bond_graph/time_response/response",))


@pytest.mark.parametrize("w", [1e-200, 1e200])
def test_a_value_that_leaves_double_precision_is_an_error_of_its_sample(w):
    """Parameters are exact; it is a node that cannot hold the reciprocal of m w^2."""
    outcomes = assert_same(scene(FUNCTIONS), [{"parameters.w": one} for one in (2, w)])
    assert [bool(outcome.error) for outcome in outcomes] == [False, True]


@pytest.mark.parametrize("reading", ["binary", "decimal"])
def test_either_reading_of_numbers(reading):
    text = FUNCTIONS.replace("outputs:", f"reading: {reading}, outputs:")
    assert_same(scene(text), [{"parameters.w": 0.1 * k, "graph.nodes.r.value": 0.3} for k in range(1, 4)])


@pytest.mark.parametrize(
    ("override", "collect"),
    [
        ({"analysis.frequency.points": 7}, ("bond_graph/frequency_response/response",)),  # a grid
        ({"initial.k.f": 1}, ("bond_graph/frequency_response/response",)),  # not there in the scene
        ({"parameters.c": 0.5}, ("bond_graph/frequency_response/nothing",)),  # no such result
        ({"parameters.d": 0.5}, ("bond_graph/frequency_response/response",)),  # no such parameter
    ],
)
def test_what_shares_too_little_is_run_one_by_one(override, collect):
    assert_same(scene(RESPONSES), [override], collect, together=False)


def test_a_grid_that_follows_a_varied_parameter_is_run_one_by_one():
    text = RESPONSES.replace("stop: 10,", "stop: 40*c,")
    override = [{"parameters.c": c} for c in (0.3, 0.5)]
    assert_same(scene(text), override, ("bond_graph/frequency_response/response",), together=False)


def test_what_is_written_in_the_graph_follows_an_integer_name():
    text = FUNCTIONS.replace("m: {type: I", "7: {type: I").replace("v -> m", "v -> 7")
    assert_same(scene(text), [{"graph.nodes.7.value": value} for value in (1, 2.5)])


@pytest.fixture(scope="module")
def suspension():
    return dynid.load_scene(
        CONFIGS / "table2.yaml", ["measurement.samples=150", "measurement.simulate.settle=0"]
    )


@pytest.mark.parametrize(
    "overrides",
    [
        [{"measurement.simulate.seed": seed} for seed in (1, 7, -1, 2.5)],
        [
            {"measurement.simulate.noise_ratio": ratio, "measurement.simulate.seed": 3}
            for ratio in (0.02, 0, -1, "0.1")
        ],
        [{"joints.upper.k.start": start, "joints.lower.c.start": 15} for start in (8e3, 0, 1e-310)],
        [{"joints.upper.k.start": start} for start in (8e3, None, [1], 10**400, "8e3")],
        [{"joints.upper.k.true": 2.1e4, "measurement.simulate.seed": 4}],
    ],
    ids=["seed", "noise", "start", "odd", "true"],
)
@pytest.mark.usefixtures("poor_starts")
def test_identifications_are_those_of_each_sample(suspension, overrides):
    outcomes = assert_same(suspension, overrides)
    assert not outcomes[0].error


def test_identifications_that_differ_in_other_places_each_are_run_one_by_one(suspension):
    overrides = [{"measurement.simulate.seed": 2}, {"joints.upper.k.start": 9e3}]
    for override, outcome in zip(overrides, run_batch(suspension, overrides, ()), strict=True):
        alone = run_alone(suspension, override, ())
        assert not alone.error
        assert all(outcome.values[path].equals(variable) for path, variable in alone.values.items())


def test_of_an_identification_any_part_can_be_collected(suspension):
    collect = (
        "identification/diagnostics/converged",
        "identification/hist*/estimate",
        "identification/states",
    )
    outcomes = assert_same(suspension, [{"measurement.simulate.seed": 5}], collect)
    assert "identification/history/time" in outcomes[0].values
    assert "identification/parameters/estimate" not in outcomes[0].values


@pytest.mark.parametrize(
    "override", [{"measurement.samples": 160}, {"structure.lumped.masses": [2, 2, 1.5, 1, 2]}]
)
def test_identifications_of_other_records_are_run_one_by_one(suspension, override):
    assert_same(suspension, [override], together=False)


NODE = """\
dynid: 1
kind: identification
structure:
  lumped:
    masses: [1, 1, 1]
    links: [{dofs: [1], k: 1}, {dofs: [1, 2], k: 1}, {dofs: [3], k: 1}]
joints:
  j: {dofs: [2, 3], k: {start: 1, true: 1}}
reduction: {method: serep, masters: [2], modes: [2]}
excitation: {dof: 2, kind: sine, frequency: 1}
measurement:
  step: 0.1
  samples: 20
  channels: [{dof: 2, quantity: velocity}]
  simulate: {seed: 1}
"""


@pytest.mark.parametrize(
    ("path", "change", "said"),
    [
        (
            "measurement.samples",
            "seed=1",
            "measurement.samples is no seed, noise, or start or true value of a joint",
        ),
        (
            "joints.upper.m.start",
            "seed=1",
            "joints.upper.m.start is no seed, noise, or start or true value of a joint",
        ),
        (
            "joints.upper.k.prior.value",
            "seed=1",
            "joints.upper.k.prior.value is no seed, noise, or start or true value of a joint",
        ),
        (
            "measurement.simulate.noise",
            "seed=1",
            "measurement.simulate.noise is no seed, noise, or start or true value of a joint",
        ),
        ("joints.upper.k.min", "seed=1", "joints.upper.k.min is no seed"),
        ("measurement.simulate.seed", "identifiability=true", "more than an identification from records"),
    ],
)
def test_why_identifications_are_run_one_by_one_is_said(path, change, said):
    settings_ = ["measurement.samples=150", change.replace("seed", "measurement.simulate.seed")]
    template = dynid.load_scene(CONFIGS / "table2.yaml", settings_)
    assert why_alone(template, (path,), ()).startswith(said)


def test_a_scene_that_cannot_be_run_says_so_of_each_sample(tmp_path):
    """Mode 2 of three equal masses between walls has a node at the master: the reduction is singular."""
    (tmp_path / "node.yaml").write_text(NODE)
    template = dynid.load_scene(tmp_path / "node.yaml")
    paths = ("measurement.simulate.seed",)
    assert why_alone(template, paths, ()) == "the scene as it stands cannot be run"
    outcomes = assert_same(template, [{paths[0]: seed} for seed in (1, 2)], together=False)
    assert [outcome.exit_code for outcome in outcomes] == [3, 3]


GENERAL = """\
dynid: 1
kind: identification
parameters:
  k: {start: 250, true: 300}
  m: {start: 2.2, true: 2}
  offset: {start: 0, true: 0.002, scale: linear}
structure: {lumped: {masses: [1, m], links: [{dofs: [1], k: k, c: 1}, {dofs: [2], k: k/3}]}}
joints:
  tip: {dofs: [1, 2], k: {start: 120, true: 150}, c: {start: 0.8, true: 1}}
excitation: [{dof: 1, kind: multisine, amplitude: [5, 5, 5], frequency: [7, 14, 24]}]
measurement:
  step: 0.03
  samples: 150
  channels: [{dof: 1, quantity: velocity}, {dof: 2, quantity: displacement, offset: offset}]
  simulate: {noise_ratio: 0.02, seed: 1}
"""


@pytest.fixture(scope="module")
def general():
    return check_source(parse_source(GENERAL, "general.yaml"))


@pytest.mark.parametrize(
    ("overrides", "together"),
    [
        ([{"measurement.simulate.seed": seed} for seed in (1, 8)], True),
        ([{"measurement.simulate.noise_ratio": 0.05, "joints.tip.k.start": k} for k in (100, 200)], True),
        ([{"parameters.k.start": start} for start in (220, 360)], False),
        ([{"parameters.k.true": true, "measurement.simulate.seed": 3} for true in (280, -1)], False),
    ],
    ids=["seed", "joint", "start", "true"],
)
def test_identifications_of_any_unknowns_are_those_of_each_sample(general, overrides, together):
    outcomes = assert_same(general, overrides, together=together)
    estimates = [one.values["identification/parameters/estimate"].data for one in outcomes if not one.error]
    assert len(estimates) == 2 - ("parameters.k.true" in overrides[0])
    if "parameters.k.start" in overrides[0]:
        np.testing.assert_allclose(*estimates, rtol=1e-6)


def test_an_undefined_characteristic_is_missing_with_the_reason():
    properties = "bond_graph/properties/k.q/F"
    template = scene(
        "parameters: {b: 1}\n"
        "graph:\n"
        "  nodes: {F: Se, j: 1, m: {type: I, value: 1}, b: {type: R, value: b}, k: {type: C, value: 0.01}}\n"
        "  bonds: [F -> j, j -> m, j -> b, j -> k]\n"
        "analysis: {inputs: [F], outputs: [k.q], results: [step_info, bandwidth, properties]}\n"
    )
    overrides = [{"parameters.b": b} for b in (1.0, -1.0)]
    for collect in ((f"{properties}/settling_time",), ("bond_graph/properties/*/settling_time",)):
        stable, unstable = run_batch(template, overrides, collect)
        assert stable.values[f"{properties}/step_status"].data == "defined"
        assert math.isclose(stable.values[f"{properties}/settling_time"].data, 7.601, rel_tol=1e-4)
        assert (unstable.error, list(unstable.values)) == ("", [f"{properties}/step_status"])
        said = str(unstable.values[f"{properties}/step_status"].data)
        assert said.startswith("undefined: there is no steady state; unstable")
        assert said.endswith("stabilise it by damping or by the gains of a feedback, or take a time response")
    both = run_batch(template, overrides, ())  # every number, and the status of those that may be missing
    assert [f"{properties}/step_status" in one.values for one in both] == [True, True]
    assert (
        f"{properties}/step_status"
        not in run_batch(template, overrides, (f"{properties}/dc_gain",))[0].values
    )


def test_irrational_values_are_run_alone():
    text = FUNCTIONS.replace("r: 2*z*sqrt(k*m)", "r: 2*z*sqrt(k)")
    assert_same(scene(text), [{"parameters.z": z} for z in (0.5, 2)], together=False)


@pytest.mark.parametrize(
    "name", ["isolator_controlled", "half_car", "quarter_car", "table2", "beam_reduction"]
)
def test_what_is_collected_of_one_group_is_what_a_whole_run_holds(name):
    template = dynid.load_scene(CONFIGS / f"{name}.yaml")
    whole = KINDS[template.kind].load("run")(template)
    groups = {path.rpartition("/")[0] for path in whole if whole[path].data.dtype.names is None}
    for collect in [(), *((group,) for group in sorted(groups)[::4])]:
        collected = gather(whole, collect)
        outcome = run_alone(template, {}, collect)
        assert outcome.values.keys() == collected.keys()
        assert all(outcome.values[path].equals(variable) for path, variable in collected.items())
