"""Lack of fit: records without response, wrong models, and records that could contradict no model."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.errors import NumericalError
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.likelihood.lack_of_fit import _count_beyond
from dynid.identification.likelihood.saturated_model import (
    ChannelColumns,
    RegressorKind,
    Regressors,
    saturated_coordinates,
    saturated_directions,
)
from dynid.identification.records.measurement import Experiment, Simulation
from dynid.identification.statistics import log_f_tail
from dynid.identification.systems.record_values import simulated
from dynid.lti.signals import Multisine, Sampled, Sine
from dynid.parameters import ParameterPrior
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Load
from tests.identification.cases import diagnostic
from tests.identification.structures import (
    MULTISINE,
    Rig,
    accelerations,
    chain,
    pair,
    rigs,
    suspension,
    velocities,
)
from tests.sample import sample

pytestmark = pytest.mark.thorough

RIGS = rigs()
# The beam with all its modes takes seconds.
QUICK = [name for name in RIGS if not name.startswith("beam")]


def verdicts(result):
    return {
        name: diagnostic(result, name)
        for name in ("converged", "optimum", "explained", "redundancy", "signal_p", "lack_of_fit_p")
    }


def noise_only(rig, seed, noise=None):
    return verdicts(identify(rig.model, Experiment(rig.loads, rig.measured(rig.noise(seed), noise))))


def recorded(rig, ratio=0.02, seed=7, truth=None, loads=None):
    """Return a record that another structure or other loads gave, with noise."""
    given = rig.simulated(0.0, 0)
    clean = simulated(truth or rig.model, loads or rig.loads, given).outputs
    size = np.sqrt(np.mean(clean**2, axis=0))
    return clean + ratio * size * np.random.default_rng(seed).standard_normal(clean.shape)


def found(rig, values, **options):
    start = replace(rig.measured(values), start=rig.settle)
    return identify(rig.model, Experiment(rig.loads, start), OutputError(), **options)


# --- the tail of Fisher's F -----------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [1, 2, 5, 40, 300])
@pytest.mark.parametrize("left", [1.0, 3.5, 20.0, 600.0, 1.5e5])
def test_the_tail_of_f_is_that_of_scipy(degrees, left):
    stats = pytest.importorskip("scipy.stats")
    for ratio in (0.01, 0.5, 1.0, 1.7, 6.0, 90.0):
        known = stats.f.logsf(ratio, degrees, left)
        if known > -600:  # beyond, scipy's own underflows
            # The logarithms of three gamma functions cancel: their rounding grows with the degrees.
            assert log_f_tail(degrees, left, ratio) == pytest.approx(known, rel=1e-8, abs=1e-12)
    assert log_f_tail(degrees, left, 0.0) == 0.0


def test_the_tail_of_f_goes_on_where_probabilities_underflow():
    # P(F > x) of 2 and n degrees is (1 + 2 x / n)^(-n / 2).
    assert log_f_tail(2, 4000.0, 1e4) == pytest.approx(-2000 * math.log1p(2e4 / 4000))


# --- noise alone ----------------------------------------------------------------------------------


SEVERAL_LINES = [name for name in QUICK if "sine" not in name or "suspension, sine" in name]


#: All attempts on these are searched to their end.
LONG = [name for name in SEVERAL_LINES if name in ("chain, random", "chain, impact")]


@pytest.mark.parametrize(
    ("name", "noise"),
    [
        *((name, None) for name in SEVERAL_LINES if name not in LONG),
        *(pytest.param(name, None, marks=pytest.mark.slow) for name in LONG),
        *((name, 1.0) for name in SEVERAL_LINES[1::4]),
    ],
)
@pytest.mark.usefixtures("poor_starts")
def test_noise_alone_is_no_response(name, noise):
    said = noise_only(RIGS[name], 3, noise)
    assert not said["converged"]
    assert not said["explained"]
    assert said["signal_p"] > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", RIGS)
def test_two_hundred_records_of_noise_are_all_rejected(name):
    for seed in range(20):
        said = noise_only(RIGS[name], 100 + seed, None if seed % 2 else 1.0)
        assert not said["converged"], seed
        assert said["signal_p"] > 1e-4, seed


@pytest.mark.slow
def test_sixty_seeds_of_noise_on_the_suspension_with_one_sine():
    rig = RIGS["suspension, sine"]
    assert not any(noise_only(rig, seed)["converged"] for seed in range(60))


@pytest.mark.usefixtures("poor_starts")
@pytest.mark.parametrize("records", [1, pytest.param(12, marks=pytest.mark.slow)])
def test_a_p_value_of_no_response_is_uniform_at_a_line(records):
    """At an excited frequency nothing is chosen: of 200 records of noise some 20 are below 0.1."""
    rig = RIGS["suspension, sine"]
    p = [noise_only(rig._replace(samples=200), seed)["signal_p"] for seed in range(records)]
    assert min(p) > 1e-3


# --- redundancy -----------------------------------------------------------------------------------


def one_line(omega, channels):
    return Rig(pair(), [Load(1, Sine(20, omega))], channels, 0.002, 900, 8.0)


@pytest.mark.parametrize("omega", [140.0, 150.0, 210.0])
@pytest.mark.parametrize("wrong", ["mass", "delay", "nothing"])
def test_one_line_in_one_channel_cannot_contradict_two_unknowns(omega, wrong):
    rig = one_line(omega, accelerations(2))
    truth = pair((1.2, 1.0)) if wrong == "mass" else None
    loads = [Load(1, Sine(20, omega, -0.002 * omega))] if wrong == "delay" else None
    said = verdicts(found(rig, recorded(rig, truth=truth, loads=loads)))
    assert said["redundancy"] == 0
    assert not said["converged"]
    assert said["signal_p"] < 1e-4


@pytest.mark.parametrize(("lines", "channels", "redundancy"), [(1, 2, 0), (2, 2, 4), (3, 2, 8), (1, 3, 2)])
def test_redundancy_counts_two_numbers_a_line_and_channel(lines, channels, redundancy):
    """Four unknowns in a steady state: the motion at the start has died."""
    force = Multisine([100] * lines, [70, 110, 250][:lines])
    rig = Rig(suspension(), [Load(5, force)], velocities(2, 3, 4)[:channels], 0.002, 800, 15.0)
    assert verdicts(found(rig, recorded(rig, 0.001)))["redundancy"] == redundancy


def test_a_decay_that_is_seen_is_redundant():
    """From rest one line in one channel shows the poles as well, which two unknowns must make right."""
    rig = one_line(150.0, accelerations(2))._replace(settle=0.0)
    said = verdicts(found(rig, recorded(rig)))
    assert said["redundancy"] > 0
    assert said["converged"]


def test_a_prior_that_tells_more_than_the_record_leaves_no_unknown():
    rig = one_line(150.0, accelerations(2))
    values = recorded(rig)
    assert verdicts(found(rig, values))["redundancy"] == 0
    bolt = rig.model.joints[0]
    sure = JointParameter(start=bolt.c.start, prior=ParameterPrior(3.0, 1e-4))
    model = lumped((1.2, 0.8), [Link((1,), 1.5e4, 4)], [Joint("bolt", (1, 2), bolt.k, sure)])
    assert verdicts(found(rig._replace(model=model), values))["redundancy"] == 1


# --- lack of fit ----------------------------------------------------------------------------------

FAULTS = {
    "a mass": {"truth": suspension((2, 2, 1.5, 1.2, 1))},
    "a delay": {"loads": [Load(5, Multisine([100] * 3, [70, 110, 250], [-0.14, -0.22, -0.5]))]},
    "a gain": {"loads": [Load(5, Multisine([110] * 3, [70, 110, 250]))]},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_enough_lines_and_channels_show_a_fault(fault):
    rig = RIGS["suspension, multisine"]
    said = verdicts(found(rig, recorded(rig, **FAULTS[fault])))
    assert said["lack_of_fit_p"] < 1e-6
    assert verdicts(found(rig, recorded(rig)))["lack_of_fit_p"] > 1e-3


@pytest.mark.parametrize("name", ["chain, random", "chain, impact", "pair, impact"])
@pytest.mark.parametrize("fault", sample(["mass", "delay", "gain", "sign"], 2))
def test_broadband_forces_show_a_fault(name, fault):
    rig = RIGS[name]
    y = recorded(rig, 0.02)
    if fault == "mass":
        masses = (1.2, 0.95) if name.startswith("pair") else (1.7, 1.8, 3.1, 1.1)
        y = recorded(rig, 0.02, truth=pair(masses) if name.startswith("pair") else chain(masses))
    y = {"gain": 1.2 * y, "sign": -y, "delay": np.roll(y, 1, axis=0)}.get(fault, y)
    try:
        result = found(rig, y)
    except NumericalError:  # a refusal is an answer, too
        return
    assert diagnostic(result, "lack_of_fit_p") < 1e-6
    said = " ".join(diagnostic(result, "warnings"))
    assert not diagnostic(result, "explained") or "the model lacks fit" in said


def test_a_fault_in_one_channel_is_found_there():
    rig = RIGS["suspension, multisine"]
    y = recorded(rig)
    y[:, 1] *= 1.15
    result = found(rig, y)
    p = result["identification/diagnostics/channel_lack_of_fit_p"].data
    assert p.min() < 1e-6
    assert diagnostic(result, "lack_of_fit_p") < 1e-6


@pytest.mark.parametrize("name", QUICK)
@pytest.mark.parametrize("ratio", sample([0.0, 0.1], 0, 0.1))
def test_a_right_model_explains_its_record(name, ratio):
    rig = RIGS[name]
    result = identify(rig.model, Experiment(rig.loads, rig.simulated(ratio, 12)))
    said = verdicts(result)
    assert said["converged"] == (said["optimum"] and said["explained"] and said["redundancy"] > 0)
    assert said["converged"], said
    assert said["lack_of_fit_p"] > 1e-3
    assert diagnostic(result, "signal_explained") > 0.98


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in QUICK if name != "suspension, random"])
def test_a_right_model_is_called_lacking_as_rarely_as_the_level_says(name):
    """Small p-values of 60 records are no more frequent than the level allows.

    `lack_of_fit_p` is twice the smaller of two p-values (Bonferroni) and at most 1, so it is not uniform: for
    two independent tests P(p ≤ x) = x - x²/4 below 1, and one record in four has p = 1. Only an excess of
    small values contradicts the level; the one-sided Kolmogorov–Smirnov test looks for it.
    """
    rig = RIGS[name]
    said = [
        verdicts(identify(rig.model, Experiment(rig.loads, rig.simulated(0.1, 50 + seed))))
        for seed in range(60)
    ]
    p = np.sort([each["lack_of_fit_p"] for each in said])
    assert p.min() > 1e-5
    # Of 60 uniform numbers this distance exceeds sqrt(log(1000) / 120) = 0.24 once in a thousand.
    assert np.max(np.arange(1, 61) / 60 - p) < 0.24
    assert all(each["explained"] for each in said)


def test_missing_samples_and_several_records():
    rig = RIGS["suspension, multisine"]
    y, other = recorded(rig, seed=1), recorded(rig, seed=2)
    y[100:160, 0] = np.nan
    y[::7, 1] = np.nan
    records = [
        Experiment(rig.loads, replace(rig.measured(values), start=rig.settle)) for values in (y, other)
    ]
    said = verdicts(identify(rig.model, records, OutputError()))
    assert said["converged"]
    assert said["redundancy"] == 2 * 12 - 4
    other[:, 0] *= 1.2
    assert verdicts(identify(rig.model, records[:1], OutputError()))["lack_of_fit_p"] > 1e-3
    records[1] = Experiment(rig.loads, replace(rig.measured(other), start=rig.settle))
    assert verdicts(identify(rig.model, records, OutputError()))["lack_of_fit_p"] < 1e-6


def test_a_force_by_samples_and_many_lines_count_as_broadband():
    rig = RIGS["chain, random"]
    force = rig.loads[0].signal.sampled(rig.simulated(0.0, 0).record)
    assert isinstance(force, Sampled)
    y = recorded(rig, 0.05)
    said = verdicts(found(rig._replace(loads=[Load(4, force)]), y))
    assert said["converged"]
    lines = np.linspace(5, 120, 90)
    many = Multisine([5.0] * 90, lines.tolist(), (lines**2).tolist())
    rig = rig._replace(loads=[Load(4, many)], samples=700)
    assert verdicts(found(rig, recorded(rig, 0.05)))["converged"]


def test_units_do_not_matter():
    rig = RIGS["suspension, multisine"]
    y = recorded(rig)
    small = [Load(5, Multisine([1e-7] * 3, MULTISINE.frequency))]
    one, other = found(rig, y), found(rig._replace(loads=small), 1e-9 * y)
    for name in ("signal_p", "lack_of_fit_p", "signal_explained"):
        assert diagnostic(other, name) == pytest.approx(diagnostic(one, name), rel=1e-3, abs=1e-12)
    assert diagnostic(other, "redundancy") == diagnostic(one, "redundancy")


def test_a_channel_that_sees_nothing_but_noise_does_not_spoil_the_others():
    rig = RIGS["suspension, multisine"]._replace(model=suspension(damped=False))
    silent = Simulation([0.02, 30.0], 1, rig.settle)
    measurement = replace(rig.simulated(0.0, 0), source=silent)
    said = verdicts(identify(rig.model, Experiment(rig.loads, measurement), OutputError()))
    assert said["converged"]
    assert said["redundancy"] == 4  # three lines in the other channel, two unknowns


def test_columns_that_nearly_depend_on_each_other_keep_their_digits():
    """The rest of each column is all of the next one: rounding of their products grows with each."""
    rng = np.random.default_rng(3)
    Q = np.linalg.qr(rng.standard_normal((200, 3)))[0]
    values = np.column_stack([Q[:, 0], Q[:, :2] + 2e-5 * Q[:, 1:]])
    residual, predicted = rng.standard_normal(200), values.sum(axis=1)
    shared = Regressors.of(RegressorKind.LINE, [values], 200)
    columns = np.column_stack([predicted, predicted + residual, residual])
    channel = ChannelColumns.of(shared, columns, (0, 0, 0, 0))
    ranges = saturated_directions(shared.factors[1], 3)
    found = saturated_coordinates(shared, ranges, channel, 200.0)
    np.testing.assert_allclose(np.abs(found.residual), np.abs(Q.T @ residual), rtol=1e-5, atol=1e-6)
    assert found.left == pytest.approx(np.sum(residual**2))


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 12), st.integers(0, 8), st.integers(0, 2**31 - 1))
def test_resolved_numbers_are_counted_by_inertia(rows, columns, seed):
    """As many as the singular values of the amplitudes off the states that exceed the level."""
    rng = np.random.default_rng(seed)
    U = np.linalg.qr(rng.standard_normal((rows, min(rows, columns))))[0]
    shown = np.where(rng.random(rows) < 0.3, 0.0, 3.0 * (1 + rng.exponential(size=rows)))
    values = np.linalg.svd((np.eye(rows) - U @ U.T) * shown, compute_uv=False)
    assert _count_beyond(U, shown, 3.0) == np.count_nonzero(values > 3.0)
