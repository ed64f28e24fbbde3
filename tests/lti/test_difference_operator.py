"""Difference operators with delays that are sums, against their values on a dense grid of the torus."""

import itertools
import math
import random
from fractions import Fraction

import numpy as np
import pytest

from dynid.lti.difference_operator import critical_gains, gap, least_separation, separation
from tests.sample import sample

NONE = frozenset()


def products(rng, variables):
    """Return a product of 1 + a q, and its least size: all |a| < 1 or some above."""
    coefficients, least = {NONE: Fraction(1)}, 1.0
    for name in range(variables):
        share = Fraction(rng.randint(-120, 120), 100)
        least = min(least, 1 - abs(float(share)))
        for key, value in list(coefficients.items()):
            coefficients[key | {name}] = value * share
    return coefficients, least


def multiaffine(rng, variables):
    keys = itertools.chain.from_iterable(
        itertools.combinations(range(variables), size) for size in range(variables + 1)
    )
    coefficients = {frozenset(key): Fraction(rng.randint(-50, 50), 100) for key in keys}
    coefficients[NONE] = Fraction(rng.choice([-1, 1]) * rng.randint(20, 200), 100)
    return coefficients


def on_torus(coefficients, variables, points=60):
    angles = np.linspace(0, 2 * np.pi, points, endpoint=False)
    grids = np.meshgrid(*[np.exp(1j * angles)] * variables, indexing="ij")
    terms = (float(v) * math.prod((grids[k] for k in key), start=1) for key, v in coefficients.items())
    return sum(np.broadcast_to(term, grids[0].shape) for term in terms)


def free_on_diagonal(coefficients, variables):
    """Return whether D(q, …, q) has no zero in the unit disc."""
    powers = np.zeros(variables + 1)
    for key, value in coefficients.items():
        powers[len(key)] += float(value)
    roots = np.roots(powers[::-1])
    return not len(roots) or np.abs(roots).min() > 1


@pytest.mark.parametrize("seed", sample(range(400), 40))
def test_zeros_in_the_polydisc_are_those_of_grids(seed):
    """D has none if D(q, …, q) has none, and D none on the torus (DeCarlo, Murray & Saeks 1977)."""
    rng = random.Random(seed)
    variables = rng.randint(1, 3)
    if rng.random() < 0.5:
        coefficients, least = products(rng, variables)
        assert (separation(coefficients) > 0) == (least > 0)
    else:
        coefficients = multiaffine(rng, variables)
    apart, size = separation(coefficients), np.abs(on_torus(coefficients, variables)).min()
    steepness = sum(abs(float(value)) * len(key) for key, value in coefficients.items())
    if apart:
        assert free_on_diagonal(coefficients, variables)
        assert float(apart) <= size * (1 + 1e-12)
    else:
        assert not free_on_diagonal(coefficients, variables) or size < steepness * np.pi / 60


@pytest.mark.parametrize("seed", sample(range(100), 15))
def test_gains_at_which_zeros_enter_the_polydisc_are_those_of_a_scan(seed):
    rng = random.Random(1000 + seed)
    variables = rng.randint(1, 3)
    larger, smaller = multiaffine(rng, variables), multiaffine(rng, variables)
    smaller = {key: value * 4 for key, value in smaller.items()}

    def free(gain):
        return separation({key: larger[key] + Fraction(gain) * smaller[key] for key in larger}) > 0

    now = free(1)
    low, high = critical_gains(smaller, larger)
    for gain in np.linspace(low * 1.001 + 0.001, min(high, 50) * 0.999, 25):
        assert free(float(gain)) == now
    if low:
        assert free(low * (1 - 1e-6)) != now
    if high < math.inf:
        assert free(high * (1 + 1e-6)) != now


def test_gaps_and_ranges_of_gains():
    half = {frozenset({1}): Fraction(1, 2)}
    one = {NONE: Fraction(1)}
    assert gap(one, half) == Fraction(1, 2)
    assert gap(half, one) == 0
    assert 0 < gap({**one, **half}, {frozenset({2}): Fraction(2, 5)}) <= Fraction(1, 10)
    assert gap({**one, **half}, {frozenset({2}): Fraction(3, 5)}) == 0
    assert least_separation(half, one, 0.5, 1.5) == pytest.approx(0.25, rel=0.9)
    assert least_separation(half, one, 1, 3) == 0


@pytest.mark.parametrize("seed", sample(range(300), 25))
def test_more_than_three_delays_are_decided_on_the_torus(seed):
    rng = random.Random(5000 + seed)
    variables = rng.randint(4, 5)
    if rng.random() < 0.5:
        coefficients, least = products(rng, variables)
        apart = separation(coefficients)
        assert (apart == 0) if least <= 0 else (apart != 0)
        angles = np.random.default_rng(seed).uniform(0, 2 * np.pi, (1000, variables))
        sizes = [
            abs(sum(float(v) * np.exp(1j * sum(at[k] for k in key)) for key, v in coefficients.items()))
            for at in angles
        ]
        assert float(apart or 0) <= min(sizes)
        return
    coefficients = multiaffine(rng, 4)
    coefficients[NONE] *= 4
    apart, size = separation(coefficients), np.abs(on_torus(coefficients, 4, 16)).min()
    if apart:
        assert free_on_diagonal(coefficients, 4)
        assert float(apart) <= size * (1 + 1e-12)
    elif apart == 0:
        steepness = sum(abs(float(value)) * len(key) for key, value in coefficients.items())
        assert not free_on_diagonal(coefficients, 4) or size < steepness * np.pi / 16


@pytest.mark.parametrize("count", [4, 5, 6])
def test_gains_of_sums_of_many_delays(count):
    """1 + k Σ c_i q_i has its first zero at k = 1/Σ |c_i|; k + Σ c_i q_i at k = Σ |c_i|, with none above."""
    shares = [Fraction((-1) ** k, 3 * count + k) for k in range(count)]
    terms = {frozenset({k}): share for k, share in enumerate(shares)}
    total = sum(map(abs, shares))
    assert critical_gains(terms, {NONE: Fraction(1)}) == (0, pytest.approx(float(1 / total)))
    assert critical_gains({NONE: Fraction(1)}, terms) == (pytest.approx(float(total)), math.inf)
    assert separation({NONE: total, **terms}) == 0
    assert separation({NONE: total * Fraction(1001, 1000), **terms}) == total / 1000


def test_a_zero_at_the_limit_away_from_real_values_is_not_taken_for_none():
    """1 + Σ q_i q_(i+1) / 5 about a cycle of five is 0 where all q are j."""
    pairs = {frozenset({k, (k + 1) % 5}): Fraction(1, 5) for k in range(5)}
    assert not separation({NONE: Fraction(1), **pairs})
    assert separation({NONE: Fraction(101, 100), **pairs})
