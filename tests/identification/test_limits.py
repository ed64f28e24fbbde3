"""Limits of unknown parameters are those of a uniform prior: estimates, intervals, redundancy, messages."""

import re

import numpy as np
import pytest
import scipy.stats

from dynid.identification.diagnosis.intervals import LimitedPosterior
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.likelihood.priors import Priors
from dynid.identification.records.modal_measurement import ModalMeasurement, Scatter
from dynid.parameters import Parameter
from dynid.report.content.identification import cautions
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from tests.identification.cases import LINKS, MASSES, diagnostic, parameter, run, simulated
from tests.identification.modal_cases import chain, measured

pytestmark = pytest.mark.thorough

ESTIMATORS = [Auto(), OutputError(), Filter(2), InvariantImbedding(tolerance=1e-3)]
each = pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: estimator.name)
EXACT = Scatter(0.0, 0.0, 0.0)


# The posterior within limits.


@pytest.mark.parametrize(("low", "high"), [(-0.2, 1.5), (0.0, np.inf), (-np.inf, -0.4), (1.0, 1.3)])
def test_one_coordinate_has_the_truncated_normal_distribution(low, high):
    """Mean 0, deviation 1, the estimate being the likeliest value within the limits."""
    at = float(np.clip(0.0, low, high))
    found = LimitedPosterior.of(
        np.array([at]), np.ones(1), np.ones((1, 1)), np.array([-at]), (np.array([low]), np.array([high]))
    )
    exact = scipy.stats.truncnorm(low, high)
    assert found.deviations[0] == pytest.approx(exact.std(), rel=0.03)
    assert found.low[0] == pytest.approx(exact.ppf(0.025), abs=0.06 * exact.std())
    assert found.high[0] == pytest.approx(exact.ppf(0.975), abs=0.06 * exact.std())
    assert np.all((found.samples >= low) & (found.samples <= high))


def test_correlated_coordinates_have_the_distribution_of_a_fine_grid():
    rows, residual = np.array([[3.0, -2.0], [0.2, 0.7]]), np.array([0.4, 0.3])
    low, high = np.array([-0.3, -1.0]), np.array([1.2, 0.5])
    axes = [np.linspace(a, b, 600) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    density = np.exp(-0.5 * np.sum((residual - grid @ rows.T) ** 2, axis=-1))
    deviations = np.sqrt(np.linalg.inv(rows.T @ rows).diagonal())
    found = LimitedPosterior.of(np.zeros(2), deviations, rows, residual, (low, high))
    for k in range(2):
        marginal = density.sum(axis=1 - k)
        marginal /= marginal.sum()
        mean = marginal @ axes[k]
        deviation = np.sqrt(marginal @ (axes[k] - mean) ** 2)
        ends = np.interp([0.025, 0.975], np.cumsum(marginal), axes[k])
        assert found.samples[:, k].mean() == pytest.approx(mean, abs=0.06 * deviation)
        assert found.deviations[k] == pytest.approx(deviation, rel=0.04)
        np.testing.assert_allclose([found.low[k], found.high[k]], ends, atol=0.12 * deviation)


def test_direction_that_is_open_is_uniform():
    """Only the sum is measured, to a thousandth: the difference is uniform between the limits."""
    rows = np.array([[1e3, 1e3], [1e-3, 0.0], [0.0, 1e-3]])
    found = LimitedPosterior.of(
        np.zeros(2), np.full(2, 700.0), rows, np.zeros(3), (np.full(2, -1.0), np.full(2, 1.0))
    )
    np.testing.assert_allclose(found.deviations, 1 / np.sqrt(3), rtol=0.04)
    np.testing.assert_allclose(found.samples.sum(axis=1), 0.0, atol=6e-3)
    np.testing.assert_allclose(found.high, 0.95, atol=0.02)


def test_limits_far_away_change_nothing():
    found = LimitedPosterior.of(
        np.array([1.0]), np.array([0.1]), np.full((1, 1), 10.0), np.zeros(1), (np.zeros(1), np.full(1, 2.0))
    )
    assert found.samples is None
    np.testing.assert_allclose([found.low[0], found.high[0]], scipy.stats.norm(1, 0.1).interval(0.95))


@pytest.mark.parametrize("seed", range(5))
def test_nearest_coordinates_satisfy_the_optimality_conditions(seed):
    """The gradient vanishes inside, and points outwards at a limit."""
    rng = np.random.default_rng(seed)
    unknowns = [Parameter(f"p{k}", 1.0, low=0.5, high=3.0) for k in range(4)]
    priors = Priors.of(unknowns)
    rows, right = rng.standard_normal((6, 4)), 3 * rng.standard_normal(6)
    eta = priors.nearest(rows, right)
    gradient = rows.T @ (rows @ eta - right)
    inside = ~priors.at_bound(eta)
    np.testing.assert_allclose(gradient[inside], 0.0, atol=1e-9)
    assert np.all(np.where(eta <= priors.low, gradient >= 0, True))
    assert np.all(np.where(eta >= priors.high, gradient <= 0, True))


# Records of time.


def suspension(low=None, high=None, start=1.8e4, c=None):
    k = JointParameter(start=start, true=2e4, low=low, high=high)
    return lumped(
        MASSES,
        [*LINKS, Link((2, 3), 2e4, 20)],
        [Joint("j3", (3, 4), k, c or JointParameter(start=15.0, true=20.0))],
    )


@each
def test_intervals_end_at_the_limits(estimator):
    """The likelihood is wider than the limits: 30 % of noise on 60 samples, limits of 1 %."""
    limits = {"low": 1.99e4, "high": 2.01e4}
    result = run(suspension(start=2e4, **limits), simulated(0.3, samples=60), estimator=estimator)
    names = ("estimate", "low", "high", "standard_error")
    estimate, low, high, error = (float(parameter(result, name)[0]) for name in names)
    assert 1.99e4 <= low < high <= 2.01e4
    assert 1.99e4 <= estimate <= 2.01e4
    assert error == pytest.approx(200 / np.sqrt(12), rel=0.1)
    assert str(parameter(result, "decided_by")[0]) == "limits"
    assert "does not decide j3.k" in "\n".join(diagnostic(result, "warnings"))


def test_what_a_record_leaves_open_is_the_middle_of_its_limits():
    """Twins of which it shows the sum: their difference lies in the middle, on the logarithmic scale."""

    def twins(limits, start):
        unknown = {"start": start, "true": 1e4} | limits
        joints = [Joint(name, (3, 4), JointParameter(**unknown), 10.0) for name in ("a", "b")]
        return lumped(MASSES, [*LINKS, Link((2, 3), 2e4, 20)], joints)

    for start in (0.6e4, 1.4e4):
        result = run(twins({"low": 0.5e4, "high": 2e4}, start), simulated(0.02, samples=200))
        assert parameter(result, "estimate").sum() == pytest.approx(2e4, rel=0.01)
        np.testing.assert_allclose(parameter(result, "estimate"), 1e4, rtol=0.01)
        assert parameter(result, "decided_by").tolist() == ["limits", "limits"]
        assert np.all(parameter(result, "low") < 0.7e4)
        assert np.all(parameter(result, "high") > 1.4e4)
        assert np.isinf(parameter(result, "cramer_rao")).all()


def test_limits_do_not_count_in_the_redundancy():
    free, limited = (
        run(suspension(**limits), simulated(0.05, samples=200))
        for limits in ({}, {"low": 1.9e4, "high": 2.1e4, "start": 2e4})
    )
    assert diagnostic(limited, "redundancy") == diagnostic(free, "redundancy")


# Measured modes.


def grounded(rng, factor, start=1.0, masses=7):
    """Masses in a row, all springs between them and to the ground unknown within a factor."""
    links, true = [], {}
    for k in range(1, masses + 1):
        for name, dofs, size in ((f"k{k}", (k,) if k == 1 else (k - 1, k), 8e3), (f"g{k}", (k,), 1.5e3)):
            true[name] = size * factor ** rng.uniform(-0.9, 0.9)
            limits = {"low": size / factor, "high": size * factor}
            joint = JointParameter(start=start * size, true=true[name], **limits)
            links.append(Joint(name, dofs, joint))
    return lumped([1.0 + 0.1 * k for k in range(masses)], [], links), true


def survey(true, rng, modes=3, sensors=(1, 3, 6), masses=7, scatter=(0.002, 0.02)):
    """Modes by the eigenvalues of matrices that are put together here."""
    K = np.zeros((masses, masses))
    for name, value in true.items():
        k = int(name[1:]) - 1
        b = np.zeros(masses)
        b[k] = 1.0
        if name[0] == "k" and k:
            b[k - 1] = -1.0
        K += value * np.outer(b, b)
    square, shapes = scipy.linalg.eigh(K, np.diag([1.0 + 0.1 * k for k in range(masses)]))
    omega, at = np.sqrt(square[:modes]), shapes[[dof - 1 for dof in sensors]][:, :modes]
    at = at / np.abs(at).max(axis=0)
    return ModalMeasurement(
        omega * (1 + scatter[0] * rng.standard_normal(modes)),
        tuple(sensors),
        at + scatter[1] * rng.standard_normal(at.shape),
        omega_std=scatter[0] * omega,
        shape_std=np.full(at.shape, scatter[1]),
        floors=EXACT,
    )


@pytest.mark.parametrize("starts", [(0.7,), pytest.param((0.7, 1.0, 1.4), marks=pytest.mark.slow)])
def test_fewer_values_than_unknowns_within_limits(starts):
    """14 unknowns, 12 values, 3 of them scales: intervals from the limits, the same from other starts."""
    found = []
    for start in starts:
        rng = np.random.default_rng(6)
        model, true = grounded(rng, 1.6, start)
        result = identify(model, survey(true, rng))
        assert diagnostic(result, "optimum")
        assert diagnostic(result, "redundancy") == 0
        assert not diagnostic(result, "converged")
        low, high = parameter(result, "low"), parameter(result, "high")
        size = np.array([8e3, 1.5e3] * 7)
        assert np.all((low >= size / 1.6) & (high <= size * 1.6) & (low < high))
        by = parameter(result, "decided_by").tolist()
        assert set(by) == {"data", "limits"}
        said = next(one for one in diagnostic(result, "warnings") if "does not decide" in one)
        named = re.search(r"does not decide (.*?):.*it decides (.*)", said)
        names = np.array([str(one) for one in parameter(result, "name")])
        assert named.group(1).split(", ") == names[np.array(by) == "limits"].tolist()
        assert named.group(2).split(", ") == names[np.array(by) == "data"].tolist()
        found.append(np.log(parameter(result, "estimate")))
    assert np.ptp(found, axis=0).max() < 0.02


def test_messages_of_modal_surveys_speak_of_modes():
    rng = np.random.default_rng(2)
    model, true = grounded(rng, 1.6)
    model = lumped(
        [1.0 + 0.1 * k for k in range(7)],
        [],
        [Joint(name, dofs_of(name), JointParameter(start=value)) for name, value in true.items()],
    )
    result = identify(model, survey(true, rng))
    said = " ".join([*diagnostic(result, "warnings"), *cautions(result), diagnostic(result, "verdict")])
    assert "modes or sensors" in said
    for word in ("sample", "initial state", "record", "excit", "channel"):
        assert word not in said


def dofs_of(name):
    k = int(name[1:])
    return (k,) if name[0] == "g" or k == 1 else (k - 1, k)


def limited_chain(rng, width):
    """The chain of the modal cases, its joints within limits in which the true values are at random."""
    true = {"upper": 2e4, "lower": 1.2e4}
    joints = []
    for name, dofs in (("upper", (2, 3)), ("lower", (3, 4))):
        low = true[name] * np.exp(-width * rng.uniform())
        limits = {"low": low, "high": low * np.exp(width), "start": low * np.exp(width / 2)}
        joints.append(Joint(name, dofs, JointParameter(true=true[name], **limits)))
    whole = chain()
    links = [Link((1,), 2e4, 0.0), Link((1, 2), 3e4, 0.0), Link((4, 5), 2e4, 0.0), Link((5, 6), 1.5e4, 0.0)]
    return lumped([2.0, 2.0, 1.5, 1.0, 1.0, 0.7], links, joints), whole


@pytest.mark.slow
def test_intervals_of_modes_at_limits_cover():
    """200 surveys, limits about as wide as the intervals: 95 % of the true values lie inside."""
    inside = []
    for seed in range(200):
        rng = np.random.default_rng([seed, 12])
        model, whole = limited_chain(rng, 0.06)
        result = identify(model, measured(whole, seed, scatter=(0.004, 0.05, 0.04)))
        true = parameter(result, "true")
        inside += ((parameter(result, "low") <= true) & (true <= parameter(result, "high"))).tolist()
    assert 0.93 <= np.mean(inside) <= 0.97


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ESTIMATORS[:3], ids=lambda estimator: estimator.name)
def test_intervals_of_records_at_limits_cover(estimator):
    """200 records, the limits about as wide as the interval, the true value anywhere between them."""
    inside = []
    for seed in range(200):
        rng = np.random.default_rng([seed, 13])
        low = 2e4 * np.exp(-0.02 * rng.uniform())
        limits = {"low": low, "high": low * np.exp(0.02), "start": low * np.exp(0.01)}
        model = suspension(**limits, c=JointParameter(value=20.0))
        result = run(model, simulated(0.1, samples=150, seed=seed), estimator=estimator)
        inside.append(parameter(result, "low")[0] <= 2e4 <= parameter(result, "high")[0])
    assert 0.92 <= np.mean(inside) <= 0.98
