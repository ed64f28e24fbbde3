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


def test_more_than_three_delays_are_decided_by_sums_and_corners_or_not_at_all():
    each = {frozenset({k}): Fraction(1, 5) for k in range(4)}
    assert separation({NONE: Fraction(1), **each}) == Fraction(1, 5)
    assert separation({NONE: Fraction(1), **{key: value * 2 for key, value in each.items()}}) == 0
    coefficients = {NONE: Fraction(1)}
    for name in range(4):
        for key, value in list(coefficients.items()):
            coefficients[key | {name}] = value * Fraction(3, 5)
    assert separation(coefficients) is None
