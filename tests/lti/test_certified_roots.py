"""Certified roots: exact multiplicities, exact sides of the axis, error bounds that hold."""

import json
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
from flint import fmpq, fmpq_poly, fmpz_poly
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dynid.errors import NumericalError, Undecided, UsageError
from dynid.lti.axis_boxes import Work
from dynid.lti.certified_roots import certified_roots, integer_polynomial, repeated, root_balls, roots
from dynid.lti.enclosures import EVALUATIONS

FILE = Path(__file__).parents[2] / "../shared/data/zeros/transfer_function.json"
CASES = {case["name"]: case for case in json.loads(FILE.read_text(encoding="utf-8"))} if FILE.exists() else {}
published = pytest.mark.skipif(not CASES, reason=f"the published functions are not at {FILE}")


def assert_same(found, expected):
    """Compare roots with [re, im, multiplicity]: multiplicities exactly, values to 1e-14 relative."""
    left = list(found)
    assert len(left) == len(expected)
    for re, im, multiplicity in expected:
        nearest = min(left, key=lambda root: abs(root.value - complex(re, im)))
        assert nearest.multiplicity == multiplicity
        assert abs(nearest.value - complex(re, im)) <= 1e-14 * abs(complex(re, im))
        left.remove(nearest)


@published
@pytest.mark.parametrize("name", CASES)
def test_published_functions_read_exactly(name):
    case = CASES[name]
    found = roots(case["num_exact"], case["den_exact"])
    assert_same(found.zero_roots, case["zeros"])
    assert_same(found.pole_roots, case["poles"])


@published
@pytest.mark.parametrize("name", CASES)
def test_published_functions_read_as_binary_floats(name):
    case = CASES[name]
    found = roots(case["num"], case["den"])
    assert_same(found.zero_roots, case["zeros_of_float64"])
    assert_same(found.pole_roots, case["poles_of_float64"])


# --- polynomials built from their roots ---------------------------------------------------------

parts = st.fractions(min_value=-1000, max_value=1000, max_denominator=1000)
factors = st.dictionaries(st.tuples(parts, parts.map(abs)), st.integers(1, 4), min_size=1, max_size=4)


def built(factors):
    """Return the integer polynomial with roots re ± i im of the given multiplicities."""
    product = fmpq_poly([1])
    for (re, im), multiplicity in factors.items():
        a, b = fmpq(re.numerator, re.denominator), fmpq(im.numerator, im.denominator)
        factor = fmpq_poly([-a, 1]) if im == 0 else fmpq_poly([a * a + b * b, -2 * a, 1])
        product *= factor**multiplicity
    return product.numer()


def expected_roots(factors):
    """Return {(re, im): multiplicity}, both of a conjugate pair."""
    return {(re, sign): m for (re, im), m in factors.items() for sign in ({im, -im})}


@settings(deadline=None)
@given(factors)
def test_known_roots_come_back_correctly_rounded_with_multiplicity_and_side(factors):
    expected = expected_roots(factors)
    found = certified_roots(built(factors))
    assert len(found) == len(expected)
    for root in found:
        matches = [
            (re, im)
            for re, im in expected
            if abs(complex(re, im) - root.value) <= 4e-16 * abs(root.value)
            and (re > 0) - (re < 0) == root.side
        ]
        assert any(expected[match] == root.multiplicity for match in matches)
        re, im = min(matches, key=lambda m: distance_squared(root.value, m))
        assert distance_squared(root.value, (re, im)) <= Fraction(root.radius) ** 2
        assert root.radius <= 2.3e-16 * abs(root.value)
        if root.side == 0:
            assert root.value.real == 0.0


def distance_squared(value, exact):
    return (Fraction(value.real) - exact[0]) ** 2 + (Fraction(value.imag) - exact[1]) ** 2


@pytest.mark.thorough
@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(-(10**6), 10**6), min_size=2, max_size=12))
def test_error_bounds_hold_against_sixty_digits(coefficients):
    assume(any(coefficients[1:]))
    polynomial = fmpz_poly(coefficients)
    with mpmath.workdps(60):
        square_free = [factor for factor, _ in polynomial.factor_squarefree()[1]]
        exact = [
            root
            for factor in square_free
            for root in mpmath.polyroots(
                [int(c) for c in reversed(factor.coeffs())], maxsteps=500, extraprec=500
            )
        ]
        found = certified_roots(polynomial)
        assert len(found) == len(exact)
        for root in found:
            nearest = min(abs(other - mpmath.mpc(root.value)) for other in exact)
            assert nearest <= root.radius + mpmath.mpf(10) ** -50
    assert sum(root.multiplicity for root in found) == polynomial.degree()


@settings(deadline=None)
@given(st.lists(st.integers(-50, 50), min_size=2, max_size=10))
def test_conjugates_come_in_exact_pairs(coefficients):
    assume(any(coefficients[1:]))
    values = repeated(certified_roots(fmpz_poly(coefficients)))
    assert sorted(values, key=key) == sorted(values.conj(), key=key)


def key(value):
    return value.real, value.imag


# --- the imaginary axis --------------------------------------------------------------------------


@pytest.mark.parametrize("exponent", [10, 30, 100, 300])
@pytest.mark.parametrize("side", [-1, 1])
def test_the_side_is_decided_exactly_however_close_the_axis_is(exponent, side):
    """(s^2 - 2 a s + a^2 + w^2) with a = ±10^-exponent."""
    a, w = Fraction(side, 10**exponent), Fraction(7)
    found = certified_roots(integer_polynomial([1, -2 * a, a * a + w * w]))
    assert [root.side for root in found] == [side, side]
    assert sorted(root.value.imag for root in found) == [-7.0, 7.0]
    assert [root.value.real for root in found] == [pytest.approx(float(a), rel=1e-15)] * 2


def test_a_root_on_the_axis_has_no_real_part_and_one_beside_it_has():
    """On and 1e-30 off the axis at the same frequency, in one polynomial."""
    a = Fraction(1, 10**30)
    product = integer_polynomial([1, 0, 49]) * integer_polynomial([1, 2 * a, a * a + 49])
    found = certified_roots(product)
    assert sorted(root.side for root in found) == [-1, -1, 0, 0]
    assert all((root.value.real == 0) is (root.side == 0) for root in found)


def test_an_irrational_frequency_on_the_axis_is_recognised():
    found = certified_roots(fmpz_poly([2, 0, 1]) * fmpz_poly([1, 1]))
    assert [(root.side, root.value) for root in found if root.side == 0] == [
        (0, complex(0, -(2**0.5))),
        (0, complex(0, 2**0.5)),
    ]


def test_roots_symmetric_about_the_axis_are_on_either_side():
    """s^4 + 1 and s^2 - 4 are even, yet have no root on the axis."""
    found = certified_roots(fmpz_poly([1, 0, 0, 0, 1]) * fmpz_poly([-4, 0, 1]))
    assert sorted(root.side for root in found) == [-1, -1, -1, 1, 1, 1]
    assert all((root.value.real > 0) is (root.side > 0) for root in found)


def test_a_root_at_the_origin_keeps_its_multiplicity():
    (zero, other) = certified_roots(fmpz_poly([0, 0, 0, 5, 1]))
    assert (zero.value, zero.multiplicity, zero.side, zero.radius) == (0j, 3, 0, 0.0)
    assert (other.value, other.multiplicity, other.side) == (-5, 1, -1)


# --- the interface -------------------------------------------------------------------------------


def test_coefficients_may_be_floats_fractions_or_text():
    found = roots([1, "3125/47"], [1.0, Fraction(1, 3), 0])
    assert found.zeros.tolist() == [-3125 / 47]
    assert found.poles.tolist() == [0, -1 / 3]
    assert found.zeros.dtype == np.complex128


def test_a_float_means_its_binary_value():
    assert roots([1], [1, -0.1]).poles.tolist() == [0.1]
    (exact,) = roots([1], [3, "-0.3"]).pole_roots
    (binary,) = roots([1], [3, -0.3]).pole_roots
    assert exact.value == 0.1
    assert binary.value == float(Fraction(0.3) / 3)


def test_a_float_may_mean_its_shortest_decimal():
    assert roots([1], [3, -0.3], reading="decimal").poles.tolist() == [0.1]
    found = roots([1, -0.3], np.array([1, -0.5, 0.06]), reading="decimal")
    assert (found.zeros.tolist(), found.poles.tolist()) == ([0.3], [0.2, 0.3])


@pytest.mark.parametrize("coefficient", [float("nan"), float("inf"), "1/0", "one", None, 1j, "1e999999999"])
def test_a_coefficient_that_is_no_number_is_refused(coefficient):
    with pytest.raises(UsageError, match=r"numerator"):
        roots([1, coefficient], [1, 2])


def test_starts_change_nothing():
    """Good, repeated, foreign, too few and no starts."""
    polynomial = built(
        {(Fraction(1, 3), Fraction(2)): 2, (Fraction(-5), Fraction(0)): 1, (Fraction(7), Fraction(1)): 1}
    )
    expected = certified_roots(polynomial)
    close = [root.value * (1 + 1e-9) for root in expected]
    for starts in (close, [1.0] * 7, [9j, *close, -40.0, 0.0], close[:2], []):
        found = certified_roots(polynomial, starts)
        assert [(r.value, r.multiplicity, r.side) for r in found] == [
            (r.value, r.multiplicity, r.side) for r in expected
        ]


@pytest.mark.parametrize("gap", [1e-9, 1e-20, 1e-60])
def test_roots_that_nearly_meet_are_told_apart(gap):
    """1 and 1 ± gap, and a pair of conjugates as near to the real axis at 3."""
    gap = Fraction(gap)
    product = (
        integer_polynomial([1, -1]) * integer_polynomial([1, -1 - gap]) * integer_polynomial([1, -1 + gap])
    )
    found = certified_roots(product * integer_polynomial([1, -6, 9 + gap**2]))
    assert [root.multiplicity for root in found] == [1] * 5
    assert sum(root.value.imag == 0 for root in found) == 3
    assert sorted(root.value.imag for root in found if root.value.imag) == [-float(gap), float(gap)]


def test_a_wilkinson_polynomial_of_degree_60():
    product = fmpz_poly([1])
    for k in range(1, 61):
        product *= fmpz_poly([k, 1])
    assert [root.value for root in certified_roots(product)] == [-k for k in range(1, 61)]


def test_common_factors_are_kept():
    found = roots([1, 1], [1, 3, 2])
    assert found.zeros.tolist() == [-1]
    assert found.poles.tolist() == [-1, -2]


def test_leading_zeros_do_not_count():
    assert roots([0, 0, 1, 5], [0, 2]).zeros.tolist() == [-5]


@pytest.mark.parametrize(("numerator", "denominator"), [([0], [1]), ([1], [0, 0]), ([1], [])])
def test_the_zero_polynomial_is_refused(numerator, denominator):
    with pytest.raises(ValueError, match="every number is a root"):
        roots(numerator, denominator)


def test_constants_have_no_roots():
    found = roots([3], [4])
    assert found.zeros.shape == found.poles.shape == (0,)


def test_wide_ranges_of_magnitude_lose_nothing():
    """Roots from 1e-150 to 1e150 in one polynomial."""
    sizes = [Fraction(10) ** k for k in (-150, -20, 0, 20, 150)]
    product = fmpq_poly([1])
    for size in sizes:
        product *= fmpq_poly([fmpq(size.numerator, size.denominator), 1])
    assert [root.value for root in certified_roots(product.numer())] == [-float(size) for size in sizes]


def test_roots_is_offered_by_the_package():
    import dynid.lti

    zeros, poles, *_ = dynid.lti.roots(["1", "3125/47"], [1.0, 0.0, 4.0])
    assert zeros.tolist() == [-3125 / 47]
    assert sorted(poles.tolist(), key=lambda pole: pole.imag) == [-2j, 2j]


@pytest.mark.parametrize("denominator", [[1, "1e400"], ["1e400", 1], [1, 0, "1e-700"]])
def test_a_root_that_is_no_double_is_refused(denominator):
    with pytest.raises(NumericalError, match="beyond the range of double precision"):
        roots([1], denominator)


def test_a_part_that_is_no_double_leaves_its_side_and_a_bound():
    above, below = roots([1], [1, "1e-400", 1]).pole_roots
    assert {above.value, below.value} == {1j, -1j}
    assert above.side == below.side == -1
    assert above.radius > 0


@pytest.mark.parametrize("exponents", [(0, 1, 2), (-40, 7, 55), (-120, 3, 130)])
def test_roots_of_widely_different_size_come_with_their_multiplicities(exponents):
    exact = [Fraction(0), *(Fraction(3) ** exponent * sign for exponent in exponents for sign in (-1, 2))]
    polynomial, expected = fmpq_poly([1]), []
    for count, root in enumerate(exact, 1):
        polynomial *= fmpq_poly([fmpq(-root.numerator, root.denominator), 1]) ** (count % 3 + 1)
        expected += [float(root)] * (count % 3 + 1)
    balls = root_balls(polynomial.numer())
    assert all(ball.imag == 0 for ball in balls)
    np.testing.assert_allclose(sorted(complex(ball).real for ball in balls), sorted(expected), rtol=1e-15)


@pytest.mark.parametrize("degree", [5, 17])
def test_roots_that_cost_more_than_a_limit_are_undecided(degree):
    polynomial = fmpz_poly([7**k + k for k in range(degree + 1)])
    for limit, ends in ((degree, True), (10_000_000, False)):
        if ends:
            with pytest.raises(Undecided, match=f"more than {limit} multiplications"):
                certified_roots(polynomial, work=Work(limit, EVALUATIONS))
        else:
            assert len(certified_roots(polynomial, work=Work(limit, EVALUATIONS))) == degree
