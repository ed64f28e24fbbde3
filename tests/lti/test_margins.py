"""Margins of rational loops with L(∞) ≠ 0, against Hurwitz's determinants in exact arithmetic."""

import math
import random
from fractions import Fraction

import pytest
from flint import fmpz_poly

from dynid.lti.margins import margins
from tests.sample import sample


def hurwitz(coefficients):
    """Return whether all roots of a polynomial lie in the open left half-plane (Hurwitz 1895).

    The coefficients are in descending powers; a leading one of 0 is a root at infinity.
    """
    if coefficients[0] <= 0:
        coefficients = [-c for c in coefficients]
    if min(coefficients) <= 0:
        return False
    degree = len(coefficients) - 1

    def entry(row, column):
        place = 2 * (column + 1) - (row + 1)
        return Fraction(coefficients[place]) if 0 <= place <= degree else Fraction(0)

    matrix = [[entry(row, column) for column in range(degree)] for row in range(degree)]
    for k in range(degree):  # leading minors are positive where all pivots are
        if matrix[k][k] <= 0:
            return False
        for row in range(k + 1, degree):
            share = matrix[row][k] / matrix[k][k]
            matrix[row] = [a - share * b for a, b in zip(matrix[row], matrix[k], strict=True)]
    return True


def biproper(rng):
    """Return numerator and denominator, coefficients in descending powers, of a stable closed loop."""
    while True:
        degree = rng.randint(1, 5)
        bottom = [1]
        for _ in range(degree):
            root = rng.choice([-1, 1, 1, 2, 5, 10, 20])
            bottom = [a + root * b for a, b in zip([*bottom, 0], [0, *bottom], strict=True)]
        top = [rng.choice([-3, -1, 1, 2]) * rng.randint(1, 40) for _ in range(degree + 1)]
        weight = rng.randint(2, 60)
        bottom = [weight * b for b in bottom]
        if top[0] + bottom[0] and hurwitz([a + b for a, b in zip(top, bottom, strict=True)]):
            return top, bottom


def closed(loop, gain):
    return [b + Fraction(gain) * a for a, b in zip(*loop, strict=True)]


def coprime(loop):
    top, bottom = (fmpz_poly(part[::-1]) for part in loop)
    shared = top.gcd(bottom)
    return top // shared, bottom // shared


@pytest.mark.parametrize("seed", sample(range(500), 40))
def test_loops_are_stable_for_every_gain_between_their_margins_and_unstable_beyond(seed):
    rng = random.Random(seed)
    loop = biproper(rng)
    found = margins(*coprime(loop))
    assert found.stable
    low, high = found.gain_reduction, min(found.gain, 1e6)
    assert 0 <= low < 1 < high
    for share in [1e-6, *(rng.random() for _ in range(20)), 1 - 1e-6]:
        assert hurwitz(closed(loop, low + share * (high - low))), share
    if math.isfinite(found.gain):
        assert not hurwitz(closed(loop, found.gain * (1 + 1e-9)))
    if low:
        assert not hurwitz(closed(loop, low * (1 - 1e-9)))


@pytest.mark.parametrize(
    ("top", "bottom", "stable", "above", "below"),
    [
        ([-1, -1], [7, 90], True, 7, 0),  # 7 - k changes its sign at 7, 90 - k later
        ([1, 2], [5, 1], True, math.inf, 0),  # L(∞) > 0: nothing happens at infinity
        ([-1, -9, -8], [4, 60, 33], True, 4, 0),  # 60 - 9 k and 33 - 8 k change theirs later
        ([-3, -1], [2, 5], False, 5, 2 / 3),  # 2 - 3 k changes its sign below 1, 5 - k above
    ],
)
def test_gains_at_which_a_pole_passes_through_infinity(top, bottom, stable, above, below):
    found = margins(*coprime((top, bottom)))
    assert found.stable == stable
    assert (found.gain, found.gain_reduction) == pytest.approx((above, below))
    if stable and math.isfinite(above):
        assert found.phase_crossover == math.inf


def test_a_loop_whose_gain_is_one_at_infinity_has_its_phase_margin_there():
    """L = (s + 1)/(s + 2): |L| < 1 up to infinity, where L = 1 lags 180 degrees behind -1."""
    found = margins(fmpz_poly([1, 1]), fmpz_poly([2, 1]))
    assert (found.phase, found.gain_crossover) == (180, math.inf)
    assert found.delay == 0
