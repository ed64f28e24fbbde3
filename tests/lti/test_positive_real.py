"""The exact test of positive realness: closed forms, points that disprove it, roots of mpmath."""

import math
from fractions import Fraction

import mpmath
import pytest
from flint import fmpq, fmpq_poly
from hypothesis import assume, given
from hypothesis import strategies as st

from dynid.lti.positive_real import find_violation, lowest_terms


def poly(*descending):
    """Return a polynomial of coefficients in descending powers."""
    exact = map(Fraction, reversed(descending))
    return fmpq_poly([fmpq(c.numerator, c.denominator) for c in exact])


def violation(numerator, denominator):
    return find_violation(*lowest_terms(poly(*numerator), poly(*denominator)))


def at(descending, s):
    """Return the value of a polynomial at s by Horner's rule; s as a pair of fractions for a complex one."""
    real, imag = Fraction(0), Fraction(0)
    for c in map(Fraction, descending):
        real, imag = real * s[0] - imag * s[1] + c, real * s[1] + imag * s[0]
    return real, imag


def real_part_at(numerator, denominator, omega):
    """Return the exact sign-giving Re(N conj D) at a rational frequency."""
    (a, b), (c, d) = at(numerator, (0, omega)), at(denominator, (0, omega))
    return a * c + b * d


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([0], [1]),
        ([5], [1]),
        ([1, 0], [1]),
        ([1], [1, 0]),
        ([1, 0], [1, 0, 1]),
        ([1, 0, 1], [1, 0]),
        ([1, 0, 3, 0], [1, 0, 10, 0, 9]),  # a zero between two pairs of poles
        ([1, 1, 1], [1, 1, 4]),  # touches Re Z = 0 at ω = sqrt(2)
        ([1, 2, 2, 1], [1, 2, 5, 4]),  # the common factor s + 1
        ([1, -2, 5], [1, -2, 5]),  # the common factor hides roots in the right half-plane
        ([1, "1e-30"], [1, 0]),
    ],
)
def test_a_positive_real_function_has_no_violation(numerator, denominator):
    assert violation(numerator, denominator) is None


@pytest.mark.parametrize(
    ("numerator", "denominator", "kind", "omega", "text"),
    [
        ([-5], [1], "real part", 1, "its real part is -5 at ω = 1 rad/s"),
        ([1, 0, 0], [1], "real part", 1, "its real part is -1 at ω = 1 rad/s"),
        ([1, 0, 0, 0], [1], "pole", math.inf, "it grows as s^3: its pole at infinity is multiple"),
        ([-1, 1], [1], "residue", math.inf, "it grows as -1 s: the residue at infinity is negative"),
        ([-1], [1, 0], "residue", 0, "the residue of its pole at s = 0 is -1"),
        ([-1, 0], [1, 0, 1], "residue", 1, "the residue of its poles at s = ±1j is -0.5"),
        ([1, 0, 5, 0], [1, 0, 3, 0, 2], "residue", math.sqrt(2), "s = ±1.41421j is -1.5"),
        ([1, 0, 2, 0], [1, 0, 2, 0, 1], "pole", 1, "s = ±1j on the imaginary axis has multiplicity 2"),
        ([1], [1, 0, 0, 0], "pole", 0, "its pole at s = 0 on the imaginary axis has multiplicity 3"),
        (
            [1, 0, 3, 0],
            [1, 0, 1, 0, 2],
            "pole",
            0.978318,
            "0.676097 ± 0.978318j lies in the right half-plane",
        ),
        (["-1e300", 0], ["1e-300"], "residue", math.inf, "it grows as -inf s"),
        ([1, 0], [1, 0, -1], "pole", 0, "its pole at s = 1 lies in the right half-plane"),
    ],
)
def test_a_violation_names_what_is_wrong_and_where(numerator, denominator, kind, omega, text):
    found = violation(numerator, denominator)
    assert (found.kind, float(found.omega)) == (kind, pytest.approx(omega, rel=1e-5))
    assert text in found.sentence


@pytest.mark.parametrize("digits", [6, 12, 30])
def test_a_dip_below_zero_is_found_however_small(digits):
    """Re Z of (s² + a s + 1)/(s² + s + 4) touches 0 for a = 1, as (sqrt(4) - sqrt(1))² = 1 · a says."""
    small = Fraction(1, 10**digits)
    assert violation([1, 1 + small, 1], [1, 1, 4]) is None
    found = violation([1, 1 - small, 1], [1, 1, 4])
    assert found.kind == "real part"
    assert real_part_at([1, 1 - small, 1], [1, 1, 4], found.omega) < 0
    assert float(found.omega) == pytest.approx(math.sqrt(2), abs=10 ** (-digits / 2.2))


def test_the_sign_of_a_tiny_residue_is_decided():
    """s (s² + r)/(s⁴ + 3 s² + 1) has poles ω² = (3 ± sqrt(5))/2; r has to lie between them."""
    fibonacci = [1, 1]
    while len(fibonacci) < 302:
        fibonacci.append(fibonacci[-1] + fibonacci[-2])
    below, above = sorted(Fraction(fibonacci[k], fibonacci[k + 2]) for k in (298, 299))  # of the lower pole
    assert 0 < above - below < Fraction(1, 10**120)
    assert violation([1, 0, above, 0], [1, 0, 3, 0, 1]) is None
    found = violation([1, 0, below, 0], [1, 0, 3, 0, 1])
    assert (found.kind, found.omega) == ("residue", pytest.approx(math.sqrt((3 - math.sqrt(5)) / 2)))
    assert -1e-100 < found.value < 0


def test_two_dips_around_a_double_root_are_distinguished():
    # Re(N conj D) = (w + 2)² (w + 3)² - tiny has two narrow dips; with + tiny it has none
    even = poly(1, 2) ** 2 * poly(1, 3) ** 2
    assert find_violation(*from_even_part(even + poly(Fraction(1, 10**20)))) is None
    found = find_violation(*from_even_part(even - poly(Fraction(1, 10**20))))
    assert found.kind == "real part"
    assert min(abs(float(found.omega) ** 2 - x) for x in (2, 3)) < 1e-8


def from_even_part(even):
    """Return N/D with D = (s + 1)^4 and Re(N conj D) = P(-ω²): the equations for N, solved."""
    from flint import fmpq_mat

    denominator = poly(1, 1) ** 4
    mirrored = poly(1, -1) ** 4
    size = denominator.degree() + 1
    rows, right = fmpq_mat(size, size), fmpq_mat(size, 1)
    for k in range(size):
        power = fmpq_poly([0] * k + [1])
        both = power * mirrored + power * (-1) ** k * denominator
        for i in range(size):
            rows[i, k] = both[2 * i]
    for i in range(size):
        right[i, 0] = 2 * even[i]
    solved = rows.solve(right)
    return fmpq_poly([solved[i, 0] for i in range(size)]), denominator


_SMALL = st.integers(0, 12)


@given(*[_SMALL] * 6)
def test_biquadratic_functions_obey_the_closed_form(a2, a1, a0, d2, d1, d0):
    """With coefficients >= 0: (sqrt(a2 d0) - sqrt(a0 d2))² <= a1 d1 (Chen & Smith 2009)."""
    assume(d2 and d1 and d0 and (a2 or a1 or a0))  # the poles lie in the left half-plane
    # left: a2 d0 + a0 d2 - 2 sqrt(a2 d0 a0 d2) <= a1 d1
    excess = a2 * d0 + a0 * d2 - a1 * d1
    positive_real = excess <= 0 or excess**2 <= 4 * a2 * d0 * a0 * d2
    assert (violation([a2, a1, a0], [d2, d1, d0]) is None) == positive_real


@given(*[st.fractions(min_value=Fraction(1, 9), max_value=9, max_denominator=20)] * 5)
def test_smiths_suspension_admittance_obeys_its_conditions(k, a0, a1, d0, d1):
    """k (a0 s² + a1 s + 1)/(s (d0 s² + d1 s + 1)): a0 d1 >= a1 d0, a0 >= d0, a1 >= d1 (Smith 2002)."""
    found = violation([k * a0, k * a1, k], [d0, d1, 1, 0])
    assert (found is None) == (a0 * d1 >= a1 * d0 and a0 >= d0 and a1 >= d1)


_COEFFICIENTS = st.lists(st.integers(-3, 9), min_size=1, max_size=5)


@given(_COEFFICIENTS, _COEFFICIENTS)
def test_random_functions_agree_with_roots_of_sixty_digits(numerator, denominator):
    assume(any(denominator) and any(numerator))
    above, below = lowest_terms(poly(*numerator), poly(*denominator))
    found = find_violation(above, below)
    descending = [[Fraction(str(c)) for c in reversed(p.coeffs())] for p in (above, below)]
    if found is None:
        assert not _disproved(*descending)
    elif found.kind == "real part":
        assert real_part_at(*descending, found.omega) < 0
        ratio = complex(*map(float, _quotient(*descending, found.omega)))
        assert ratio.real == pytest.approx(found.value, rel=1e-12)
    else:
        assert _disproved(*descending)


def _quotient(numerator, denominator, omega):
    (a, b), (c, d) = at(numerator, (0, omega)), at(denominator, (0, omega))
    size = c * c + d * d
    return (a * c + b * d) / size, (b * c - a * d) / size


def _disproved(numerator, denominator):
    """Return True where poles, residues or the real part in mpmath show that N/D is not positive real."""
    with mpmath.workdps(60):
        n, d = ([mpmath.mpf(c.numerator) / c.denominator for c in p] for p in (numerator, denominator))
        if len(n) - len(d) > 1 or (len(n) == len(d) + 1 and n[0] / d[0] < 0):
            return True
        tiny = mpmath.mpf("1e-15")
        poles = mpmath.polyroots(d, maxsteps=2000, extraprec=800) if len(d) > 1 else []
        slope = [c * (len(d) - 1 - k) for k, c in enumerate(d[:-1])]
        for pole in poles:
            if mpmath.re(pole) > tiny:
                return True
            if abs(mpmath.re(pole)) < tiny:
                steep = mpmath.polyval(slope, pole)
                if abs(steep) < tiny or mpmath.re(mpmath.polyval(n, pole) / steep) < 0:
                    return True
        for k in range(-60, 61):
            omega = mpmath.mpf(10) ** (mpmath.mpf(k) / 20) * (1 + mpmath.mpf("1e-3"))
            value = mpmath.polyval(n, 1j * omega) * mpmath.conj(mpmath.polyval(d, 1j * omega))
            if mpmath.re(value) < -tiny:
                return True
    return False
