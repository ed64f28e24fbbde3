"""Optima far beyond the error bars: stiff arms of symmetric structures, against SciPy from the truth."""

import re

import numpy as np
import pytest

from tests.identification.maximum_likelihood import Element, Force, Problem, Record
from tests.identification.random_structures import Case, suite
from tests.sample import sample

pytestmark = pytest.mark.thorough

GROUP = "identification/parameters"
#: Of seed 0 a local search ends at another optimum than that of the true values.
SEEDS = (0, 1, 2, 3, 4, 5)


FREQUENCIES = np.array([22.0, 28.0, 29.0, 33.0, 85.0, 178.0, 182.0, 185.0])
MODEL = Problem(
    np.array([1.5, 1.6, 1.6]),
    (Element((0,), 4.2e3, 6.8), Element((0, 1), 5.2e4, 1.8), Element((0, 2), 1.45e4, 1.8)),
    ((1, "k"), (2, "k")),
    Force(0, "sines", np.full(8, 30.0), FREQUENCIES),
    0.0045,
    1200,
    ((0, 0),),
)


def arms(seed):
    """A mass on a spring, with two equal masses on it, one of them on a stiff spring."""
    rng = np.random.default_rng([314, seed])
    k = np.exp(MODEL.truth + 0.02 * rng.uniform(-1, 1, 2)).tolist()
    springs = [each._replace(k=value) for each, value in zip(MODEL.elements[1:], k, strict=True)]
    problem = MODEL._replace(elements=(MODEL.elements[0], *springs))
    forced, _ = problem.response(problem.truth)
    values = forced + 0.05 * np.sqrt(np.mean(forced**2, axis=0)) * rng.standard_normal(forced.shape)
    start = problem.truth + 0.5 * rng.uniform(-1, 1, 2)
    return Case(seed, problem, start, 0.05, Record(problem, values), "two equal arms")


@pytest.mark.parametrize("seed", sample(SEEDS, 0, 1))
def test_the_estimate_is_the_best_of_several_optima(seed):
    # there may be a dozen within 5 of the logarithm of the likelihood, of which not all are listed
    this = arms(seed)
    result = suite(this)
    deviation, least, _, optima = compared(this, result)
    assert deviation < least + 0.1
    assert len(optima) > 2  # more than the two that the equal arms make
    assert not result.value("identification/diagnostics/converged")


def test_the_optimum_of_the_true_values_is_listed():
    this = arms(0)
    deviation, least, distances, _ = compared(this, suite(this))
    assert least < deviation + 9.5
    assert distances.min() < 0.1


def compared(this, result):
    """Return -2 log L of the estimate and of SciPy's fit from the truth, and the optima beside the latter."""
    order = [list(result.value(f"{GROUP}/name")).index(f"j{k}.k") for k, _ in this.problem.unknowns]
    estimate = np.log(result.value(f"{GROUP}/estimate"))[order]
    deviation, noise = this.record.deviance(estimate)
    end, least = this.record.fit(this.problem.truth, noise)
    optima = np.log(result.value("identification/equivalent_optima/estimate"))[:, order]
    distances = np.abs(optima - end) / this.record.deviations(end, noise)
    return deviation, least, distances.max(axis=1), optima


def stiff_arm(seed):
    """A stiff arm of three unequal masses, measured at the hub: its likelihood ripples."""
    rng = np.random.default_rng([2718, seed])
    problem = MODEL._replace(masses=np.array([1.5, 1.6, 1.1]), unknowns=((1, "k"),))
    forced, _ = problem.response(problem.truth)
    values = forced + 0.08 * np.sqrt(np.mean(forced**2, axis=0)) * rng.standard_normal(forced.shape)
    start = problem.truth + 0.3 * rng.uniform(-1, 1, 1)
    return Case(seed, problem, start, 0.08, Record(problem, values), "a stiff arm")


@pytest.mark.parametrize("seed", sample((0, 5, 6, 7, 8), 0, 0, 2))
def test_error_bars_that_the_likelihood_contradicts_are_those_of_its_profile(seed):
    """The likelihood at the value that the warning names and at the ends of the interval, by SciPy."""
    this = stiff_arm(seed)
    result = suite(this)
    said = [one for one in result.value("identification/diagnostics/warnings") if "too narrow" in one]
    assert len(said) == 1
    numbers = re.search(r"j1\.k = ([\d ]+), .* lower by ([\d.]+), where they predict ([\d.]+)", said[0])
    value, fall, predicted = (float(each.replace(" ", "")) for each in numbers.groups())
    estimate = result.value(f"{GROUP}/estimate")[0]
    low, high = (result.value(f"{GROUP}/{end}")[0] for end in ("low", "high"))
    best = this.record.deviance(np.log([estimate]))[0]
    assert (this.record.deviance(np.log([value]))[0] - best) / 2 == pytest.approx(fall, rel=0.05)
    assert predicted == pytest.approx(600 * np.log1p(16 / 1200), rel=0.05)
    assert fall < predicted / 2
    # beyond either end is 2.5 % of the likelihood, or of the Gaussian of the information if that is wider
    centre, deviation = np.log(estimate), abs(np.log(value / estimate)) / 4
    eta = centre + deviation * np.linspace(-24, 24, 1201)
    density = np.exp([(best - this.record.deviance(np.array([each]))[0]) / 2 for each in eta])
    lower, upper = np.interp([0.025, 0.975], np.cumsum(density) / density.sum(), eta)
    assert (np.log(low) - centre) / deviation == pytest.approx(
        min((lower - centre) / deviation, -1.96), abs=0.08
    )
    assert (np.log(high) - centre) / deviation == pytest.approx(
        max((upper - centre) / deviation, 1.96), abs=0.08
    )
    assert max(upper - centre, centre - lower) > 1.96 * deviation
    assert "profile likelihood" in result.group_attrs[GROUP]["error_bars"]


def test_error_bars_that_the_likelihood_bears_out_have_no_such_warning():
    for seed in (2, 4):
        said = suite(stiff_arm(seed)).value("identification/diagnostics/warnings")
        assert not any("too narrow" in one for one in said)


def test_another_optimum_without_a_symmetry_is_reported_with_its_odds():
    this = stiff_arm(9)
    result = suite(this)
    assert result.value("identification/diagnostics/equivalent_optima") == 2
    assert not result.value("identification/diagnostics/converged")
    optima = np.log(result.value("identification/equivalent_optima/estimate"))
    ends = [this.record.fit(each, this.record.deviance(each)[1]) for each in optima]
    np.testing.assert_allclose([end for end, _ in ends], optima, atol=2e-4)
    gain = result.value("identification/equivalent_optima/log_likelihood")
    assert gain[1] == pytest.approx((ends[0][1] - ends[1][1]) / 2, abs=0.02)
    said = " ".join(result.value("identification/diagnostics/warnings"))
    odds = np.exp(-gain[1])
    assert ("equally well (id" if odds < 1.1 else f"odds of {odds:.2g} to 1") in said
