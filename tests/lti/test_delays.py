"""Quasi-polynomials and margins with delays, against closed forms, contours and dense grids."""

import math
import random
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from flint import fmpz_poly
from scipy.special import lambertw

from dynid.errors import Undecided
from dynid.lti.delay_margins import delay_margins
from dynid.lti.delay_stability import rightmost_roots, roots_right_of, stability
from dynid.lti.quasi_polynomials import Delay, QuasiPolynomial, common_factor, on_axis, refined_root
from tests.sample import sample

ZERO = Fraction(0)


def integrator(gain, delay=Fraction(1)):
    """Return L = K exp(-s τ)/s."""
    gain = Fraction(gain)
    top = QuasiPolynomial({delay: fmpz_poly([gain.numerator])})
    return top, QuasiPolynomial({ZERO: fmpz_poly([0, gain.denominator])})


def random_loop(rng):
    """Return numerator, denominator and delay of a loop; its plant may be unstable."""
    bottom = fmpz_poly([1])
    for _ in range(rng.randint(1, 3)):
        damping = rng.randint(1, 5) * rng.choice([1, 1, 1, -1])
        bottom *= fmpz_poly(rng.choice([[0, 1], [rng.randint(1, 9), 1], [rng.randint(1, 40), damping, 1]]))
    top = fmpz_poly([rng.randint(1, 60)])
    if bottom.degree() > 1 and rng.random() < 0.5:
        top *= fmpz_poly([rng.randint(1, 9), rng.choice([-1, 1])])
    return top, bottom, Fraction(rng.randint(1, 30), 20)


def descending(polynomial):
    return [float(int(c)) for c in polynomial.coeffs()][::-1]


def turns(function, radius, line=0.0):
    """Return the turns of a function around 0 along a half circle right of a line, by sampling."""
    arc = line + radius * np.exp(1j * np.linspace(-np.pi / 2, np.pi / 2, 10_001))
    upper = np.concatenate([np.linspace(radius, 40, 10_001)[:-1], np.geomspace(40, 1e-4, 10_001)])
    height = np.concatenate([upper, -upper[::-1]])
    values = function(np.concatenate([arc, line + 1j * height]))
    return np.angle(values[1:] / values[:-1]).sum() / (2 * np.pi)


@pytest.mark.parametrize("gain", ["1", "3/2", "157/100", "15708/10000", "158/100", "5", "10", "50"])
def test_roots_of_an_integrator_with_a_delay_are_those_of_lambert(gain):
    """s + K exp(-s) = 0 at s = W(-K)."""
    exact = np.array([lambertw(-float(Fraction(gain)), branch) for branch in range(-60, 60)])
    top, bottom = integrator(gain)
    closed = top + bottom
    assert roots_right_of(closed) == np.count_nonzero(exact.real > 0)
    assert roots_right_of(closed, -1.5) == np.count_nonzero(exact.real > -1.5)
    starts = exact[np.abs(exact) < 40] * 1.02
    found, line = rightmost_roots(closed, starts, 8)
    assert math.isfinite(line)
    assert len(found) == np.count_nonzero(exact.real > line)
    for root in found:
        assert np.abs(root.value - exact).min() <= root.radius + 1e-14


@pytest.mark.parametrize("delay", [Fraction(1, 10), Fraction(3, 4)])
def test_margins_of_an_integrator_with_a_delay(delay):
    """L = K exp(-s τ)/s: gain margin π/(2 K τ), phase margin π/2 - K τ at ω = K."""
    gain = Fraction(3, 2)
    found = delay_margins(*integrator(gain, delay))
    late = float(gain * delay)
    assert found.stable
    assert found.gain == pytest.approx(math.pi / 2 / late, rel=1e-14)
    assert found.phase == pytest.approx(90 - math.degrees(late), rel=1e-13)
    assert found.delay == pytest.approx((math.pi / 2 - late) / 1.5, rel=1e-13)
    assert found.gain_crossover == pytest.approx(1.5, rel=1e-14)
    assert found.phase_crossover == pytest.approx(math.pi / 2 / float(delay), rel=1e-14)


@pytest.mark.parametrize("seed", sample(range(50), 25))
def test_random_loops_have_the_roots_that_a_contour_counts(seed):
    top, bottom, delay = random_loop(random.Random(seed))
    closed = QuasiPolynomial({ZERO: bottom, delay: top})
    n, d, late = descending(top), descending(bottom), float(delay)

    def function(s):
        return np.polyval(d, s) + np.polyval(n, s) * np.exp(-s * late)

    assert roots_right_of(closed) == pytest.approx(turns(function, 600.0), abs=1e-3)
    # Roots from the Padé approximant of order 5, as an engineer has them.
    p = np.array([30240, 15120, 3360, 420, 30, 1.0])[::-1] * late ** np.arange(5, -1, -1)
    q = p * (-1.0) ** np.arange(5, -1, -1)
    found, line = rightmost_roots(closed, np.roots(np.polyadd(np.polymul(d, p), np.polymul(n, q))), 6)
    for root in found:
        exact = mpmath.findroot(
            lambda s: mpmath.polyval(d, s) + mpmath.polyval(n, s) * mpmath.exp(-late * s), root.value
        )
        assert abs(complex(exact) - root.value) <= root.radius + 1e-12 * abs(root.value)
    if math.isfinite(line):
        assert turns(function, 600.0, line) == pytest.approx(len(found), abs=1e-3)


@pytest.mark.parametrize("seed", range(8))
def test_margins_with_delays_are_those_of_a_dense_grid(seed):
    top, bottom, delay = random_loop(random.Random(1000 + seed))
    found = delay_margins(QuasiPolynomial({delay: top}), QuasiPolynomial({ZERO: bottom}))
    omega = np.geomspace(1e-4, 1e4, 100_001)
    s = 1j * omega
    with np.errstate(all="ignore"):
        loop = np.polyval(descending(top), s) / np.polyval(descending(bottom), s) * np.exp(-s * float(delay))
        sensitivity = np.nan_to_num(np.abs(1 / (1 + loop)), nan=0.0)
        complement = np.abs(loop / (1 + loop))
    left = (loop.real < 0) & (np.abs(loop) < 1e6)
    crossing = np.flatnonzero((loop.imag[1:] * loop.imag[:-1] < 0) & left[1:] & left[:-1])
    factors = -1 / loop.real[crossing]
    assert min(found.gain, 1e6) == pytest.approx(min(factors[factors > 1], default=1e6), rel=2e-3)
    steady = -1 / (loop[0].real) if int(bottom[0]) else 0.0  # at rest
    reductions = [*factors[factors < 1], *([steady] if 0 < steady < 1 else [])]
    assert found.gain_reduction == pytest.approx(max(reductions, default=0.0), rel=2e-3, abs=1e-6)
    unit = np.flatnonzero((np.abs(loop[1:]) > 1) != (np.abs(loop[:-1]) > 1))
    lags = np.mod(np.degrees(np.angle(-loop[unit])), 360)
    assert found.phase == pytest.approx(min(lags, default=math.inf), abs=0.6)
    assert found.delay == pytest.approx(min(np.radians(lags) / omega[unit], default=math.inf), rel=2e-2)
    assert found.modulus == pytest.approx(min(1 / sensitivity.max(), 1.0), abs=5e-3)
    assert found.modulus * found.Ms == pytest.approx(1, rel=1e-14)
    assert 1 / found.Mt == pytest.approx(1 / complement.max(), abs=5e-3)


def test_a_loop_without_delay_keeps_its_margins():
    """Both ways to the margins of one loop, whose delay is 0."""
    from dynid.lti.margins import margins

    top, bottom = fmpz_poly([40, 3]), fmpz_poly([0, 30, 11, 1])
    exact = margins(top, bottom)
    found = delay_margins(QuasiPolynomial({ZERO: top}), QuasiPolynomial({ZERO: bottom}))
    for name in ("gain", "phase", "delay", "modulus", "Mt", "gain_crossover", "modulus_at"):
        assert getattr(found, name) == pytest.approx(getattr(exact, name), rel=1e-8), name
    assert found.stable
    assert exact.stable


@pytest.mark.parametrize(
    ("gain", "verdict"),
    [(4, "infinitely many roots"), (2, "roots come as near to the imaginary axis")],
)
def test_a_delay_in_a_loop_of_gain_one_at_high_frequencies_is_not_stable(gain, verdict):
    """L = K (s + 1)/(2 s + 1) exp(-s): without the delay stable for every K > 0."""
    top = QuasiPolynomial({Fraction(1): fmpz_poly([gain, gain])})
    found = delay_margins(top, QuasiPolynomial({ZERO: fmpz_poly([1, 2])}))
    assert not found.stable
    assert verdict in found.stability
    assert found.delay == 0
    assert found.gain_reduction == pytest.approx(2 / gain)
    assert found.unstable_poles == math.inf


def test_a_loop_that_differentiates_is_unstable_with_a_delay():
    found = delay_margins(
        QuasiPolynomial({Fraction(1, 100): fmpz_poly([0, 0, 1])}), QuasiPolynomial({ZERO: fmpz_poly([1, 1])})
    )
    assert not found.stable
    assert "infinitely many" in found.stability


def test_a_biproper_loop_with_small_gain_is_decided():
    """L = (s + 2)/(3 s + 1) exp(-s): its gain is 1/3 at high frequencies, so that the margin is at most 3."""
    found = delay_margins(
        QuasiPolynomial({Fraction(1): fmpz_poly([2, 1])}), QuasiPolynomial({ZERO: fmpz_poly([1, 3])})
    )
    assert found.stable
    assert 1 < found.gain < 3
    assert found.Ms > 1.5


def test_a_root_on_the_axis_is_undecided_and_not_stable():
    """s + (π/2) exp(-s) has a root at ±jπ/2; with the nearest rational number one next to it."""
    top, bottom = integrator(_half_pi())
    with pytest.raises(Undecided, match=r"imaginary axis near 1\.5708"):
        roots_right_of(top + bottom)
    found = delay_margins(*integrator(_half_pi()))
    assert not found.stable
    assert "imaginary axis" in found.stability
    assert found.gain == pytest.approx(1, abs=1e-12)


def _half_pi():
    with mpmath.workdps(80):
        return Fraction(int(mpmath.pi / 2 * 10**70), 10**70)


def test_a_root_at_the_origin_is_not_stable():
    """L = -exp(-s): at rest 1 + L = 0."""
    found = delay_margins(
        QuasiPolynomial({Fraction(1): fmpz_poly([-2])}), QuasiPolynomial({ZERO: fmpz_poly([2, 1])})
    )
    assert not found.stable
    assert "origin" in found.stability
    assert found.Ms == math.inf
    closed = QuasiPolynomial({ZERO: fmpz_poly([2, 1]), Fraction(1): fmpz_poly([-2])})
    roots, line = rightmost_roots(closed, [1e-9, -1 + 6j, -2 + 13j], 4)
    assert roots[0].value == 0
    assert line < 0
    assert roots_right_of(closed, line) == len(roots)


def test_a_multiple_root_is_not_refined():
    """s + exp(-s - 1) has a double root at -1."""
    double = QuasiPolynomial({ZERO: fmpz_poly([1, 2, 1])})
    assert refined_root(double, -1.0 + 0.001j) is None
    assert refined_root(QuasiPolynomial({ZERO: fmpz_poly([1])}), 1.0) is None


def test_values_and_common_factors():
    shared = fmpz_poly([3, 1])
    top = QuasiPolynomial({Fraction(1, 2): shared * 2})
    bottom = QuasiPolynomial({ZERO: shared * fmpz_poly([0, 1])})
    assert common_factor([top, bottom]) == shared
    assert common_factor([]) == fmpz_poly([1])
    values = on_axis(top, bottom, [0.0, 2.0])
    assert values[0].real == math.inf
    assert values[1] == pytest.approx(2 * np.exp(-1j) / 2j, rel=1e-15)
    assert on_axis(QuasiPolynomial({}), bottom, [2.0]) == [0]
    assert top(1 + 1j) == pytest.approx(2 * (4 + 1j) * np.exp(-(1 + 1j) / 2), rel=1e-15)


@pytest.mark.parametrize(
    ("terms", "start"),
    [
        ({0: [1, 0, 1]}, 0j),  # no slope: s^2 + 1 at 0
        ({0: [1], 1: [1]}, 0j),  # 1 + exp(-s) moves from 0 along the real axis
        ({1: [1]}, 0j),  # exp(-s) has no root
        ({0: [1, 2, 1]}, 1 + 1j),  # a double root is not isolated
    ],
)
def test_a_start_that_leads_to_no_simple_root_finds_none(terms, start):
    given = QuasiPolynomial({Fraction(delay): fmpz_poly(part) for delay, part in terms.items()})
    assert refined_root(given, start) is None


def test_starts_below_the_axis_or_of_a_known_root_add_none():
    given = QuasiPolynomial({ZERO: fmpz_poly([10, 2, 1]) * fmpz_poly([4, 1])})
    found, line = rightmost_roots(given, [-1 + 3j, -1.1 + 3j, -1 - 3j, -4.2 + 0j, -4 + 1e-9j], 5)
    assert [one.value for one in found] == pytest.approx([-1 + 3j, -1 - 3j], abs=1e-12)
    assert line == pytest.approx(-2.5)  # between them and the last one, which bounds where none is missing


def quasi(terms):
    return QuasiPolynomial({Fraction(delay): fmpz_poly(part) for delay, part in terms.items()})


@pytest.mark.parametrize(
    ("terms", "kind", "count"),
    [
        ({0: [1, 2], "1/2": [0, 0, 3]}, "unstable", math.inf),  # advanced
        ({0: [1, 2], 1: [0, 3], "3/2": [0, 0, 1]}, "unstable", math.inf),  # advanced by a later term alone
        ({0: [1, 2], 1: [1, 3]}, "unstable", math.inf),  # neutral, 3 > 2
        ({0: [1, 2], 1: [1, 2]}, "at the limit", math.nan),  # neutral, 2 = 2
        (
            {0: [5, 2], 1: [1, 1], 2: [0, 2]},
            "at the limit",
            math.nan,
        ),  # a zero of D on |q| = 1 at these delays
        ({0: [6, 5], 1: [1, 4], 2: [1, 4]}, "at the limit", 0),  # 5 + 4 z + 4 z² has |z| = 1.12
        ({0: [0, 1, 1], 1: [0, 1]}, "marginal", 0),
        ({0: [2, 1], 1: [-3]}, "unstable", 1),  # s + 2 = 3 e^-s at s > 0
        ({0: [3, 1], 1: [-2]}, "stable", 0),
    ],
)
def test_verdicts_follow_from_degrees_and_leading_coefficients(terms, kind, count):
    found = stability(quasi({Fraction(delay): part for delay, part in terms.items()}))
    assert found.kind == kind
    assert found.unstable_poles == pytest.approx(count, nan_ok=True)
    assert found.stable == (kind == "stable")


def test_two_loops_that_do_not_act_on_each_other_are_stable_if_both_are():
    """1 + 0.7 q1, 1 + 0.7 q2: the sizes of D add up to more than 1, but it is a product."""
    first, second = Delay(Fraction(1), 0), Delay(Fraction(7, 10), 1)
    sizes = {(): 100, (first,): 70, (second,): 70, (first, second): 49}
    product = QuasiPolynomial({frozenset(key): fmpz_poly([size, 2 * size]) for key, size in sizes.items()})
    assert stability(product).kind == "stable"
    lone = QuasiPolynomial(dict(product.terms))  # without knowing which delays add up
    assert stability(lone).kind == "at the limit"


def test_a_search_that_costs_too_much_is_undecided_with_the_reason():
    late = quasi({0: [1, 1, 1], 10**7: [0, 3]})
    found = stability(late)
    assert (found.kind, math.isnan(found.unstable_poles)) == ("undecided", True)
    assert "delay times bandwidth" in found.reason


def test_a_long_delay_is_counted():
    """s² + s + 1 + 3 s e^(-1000 s): |3 s| exceeds |s² + s + 1| between 0.38 and 2.6 rad/s."""
    right = roots_right_of(quasi({0: [1, 1, 1], 1000: [0, 3]}))

    def function(s):
        return s * s + s + 1 + 3 * s * np.exp(-1000 * s)

    height = np.linspace(0, 4, 400_001) * 1j
    arc = 4 * np.exp(1j * np.linspace(0, np.pi / 2, 100_001))
    turned = [np.angle(values[1:] / values[:-1]).sum() for values in (function(arc), function(height))]
    assert right == pytest.approx((turned[0] - turned[1]) / np.pi, abs=1e-3)


@pytest.mark.parametrize("factor", [10**400, 3**900])
def test_verdicts_and_margins_do_not_depend_on_a_common_factor(factor):
    """Irrational values have coefficients beyond the range of doubles."""
    parts = {0: [30, 20], 1: [7, 5], 2: [3, 4]}
    plain, scaled = (quasi({d: [k * c for c in p] for d, p in parts.items()}) for k in (1, factor))
    assert stability(scaled) == stability(plain)
    loops = [
        delay_margins(quasi({1: [7 * k, 5 * k]}), quasi({0: [30 * k, 20 * k], 2: [3 * k, 4 * k]}))
        for k in (1, factor)
    ]
    assert loops[0].stable
    for name in ("gain", "phase", "delay", "Ms", "Mt"):
        assert getattr(loops[1], name) == pytest.approx(getattr(loops[0], name), rel=1e-9, nan_ok=True), name
