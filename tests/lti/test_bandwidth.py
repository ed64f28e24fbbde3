"""Bandwidth and resonance against closed forms."""

import math
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpz_poly
from hypothesis import given
from hypothesis import strategies as st

from dynid.lti.margins import bandwidth


def of(numerator, denominator):
    return bandwidth(fmpz_poly(numerator[::-1]), fmpz_poly(denominator[::-1]))


def test_a_first_order_lag_has_the_bandwidth_of_its_pole():
    found = of([6], [2, 6])
    assert (found.bandwidth, found.peak_gain, found.peak_frequency) == (3, 1, 0)
    assert (found.half_power_low, found.half_power_high) == (0, 3)


@pytest.mark.parametrize("permille", [1, 50, 300, 700, 900])
def test_an_oscillator_has_the_textbook_bandwidth_and_resonance(permille):
    z = permille / 1000
    found = of([1000], [1000, 2 * permille, 1000])
    middle = 1 - 2 * z * z
    assert found.bandwidth == pytest.approx(math.sqrt(middle + math.sqrt(middle**2 + 1)), rel=1e-14)
    if z < math.sqrt(0.5):
        assert found.peak_gain == pytest.approx(1 / (2 * z * math.sqrt(1 - z * z)), rel=1e-14)
        assert found.peak_frequency == pytest.approx(math.sqrt(middle), rel=1e-14)
        spread = 2 * z * math.sqrt(1 - z * z)
        assert found.half_power_high == pytest.approx(math.sqrt(middle + spread), rel=1e-13)
        low = middle - spread
        assert found.half_power_low == pytest.approx(math.sqrt(low) if low > 0 else 0, rel=1e-12)
    else:
        assert (found.peak_gain, found.peak_frequency) == (1, 0)


def test_a_channel_that_never_falls_has_no_upper_limit():
    assert of([2, 1], [1, 1]).bandwidth == math.inf
    assert of([-1, 1], [1, 1]).bandwidth == math.inf
    found = of([3], [2])
    assert (found.bandwidth, found.peak_gain, found.peak_frequency) == (math.inf, 1.5, 0)


def test_a_band_pass_has_half_power_frequencies_only():
    found = of([1, 0], [10, 1, 10])
    assert found.status.startswith("partly defined: T(0) is 0")
    assert found.bandwidth is None
    assert (found.peak_gain, found.peak_frequency) == (1, 1)
    assert found.half_power_high - found.half_power_low == pytest.approx(0.1, rel=1e-14)


def test_a_high_pass_has_its_peak_at_infinity():
    found = of([2, 0], [1, 3])
    assert (found.peak_gain, found.peak_frequency) == (2, math.inf)
    assert (found.half_power_low, found.half_power_high) == (3, math.inf)


@pytest.mark.parametrize(
    ("numerator", "denominator", "at"),
    [([1], [1, 0], 0), ([1], [1, 0, 4], 2), ([1, 0, 1], [1, 1], math.inf)],
)
def test_an_infinite_peak_has_its_place(numerator, denominator, at):
    found = of(numerator, denominator)
    assert (found.peak_gain, found.peak_frequency) == (math.inf, at)
    assert (found.half_power_low, found.half_power_high) == (None, None)


def test_no_way_to_the_output_has_no_bandwidth():
    assert of([0], [1]).status == "undefined: the input does not reach the output"


def test_touching_the_level_is_no_crossing():
    """|T|² = 1/2 + (x - 1)² / (2 (1 + x)²), with x = ω², touches half of T(0)² at ω = 1."""
    # T = (s² + √… ) cannot be had in integers: take |N|² = x² + 1 and |D|² = (1 + x)²
    found = of([1, 0, 1], [1, 2, 1])  # |T|² = (1 - x)²/(1 + x)²: crosses 1/2 twice
    assert found.bandwidth == pytest.approx(math.sqrt(2) - 1, rel=1e-14)


coefficients = st.lists(st.integers(1, 50), min_size=1, max_size=5)


@given(coefficients, coefficients)
def test_the_response_at_the_bandwidth_is_half_the_power(above, below):
    found = of(above, below)
    size = lambda w: abs(np.polyval(above, 1j * w) / np.polyval(below, 1j * w))  # noqa: E731
    if 0 < found.bandwidth < math.inf:
        assert size(found.bandwidth) == pytest.approx(size(0) / math.sqrt(2), rel=1e-9)
        grid = np.linspace(0, found.bandwidth * (1 - 1e-6), 200)
        assert (size(grid) >= size(0) / math.sqrt(2) * (1 - 1e-9)).all()
    if found.peak_gain < math.inf:
        assert (size(np.geomspace(1e-3, 1e3, 200)) <= found.peak_gain * (1 + 1e-9)).all()


@pytest.mark.parametrize(("kp", "ki", "delay"), [("1.5", "0.7", "0.5"), ("1", "0.9", "0.6")])
def test_delays_are_in_the_bandwidth_as_they_are(kp, ki, delay):
    """T of (kp s + ki) exp(-s τ)/(s (s + 1)^2), closed, whose levels and maximum mpmath refines."""
    import mpmath as mp

    from dynid.lti.delay_bandwidth import delayed_bandwidth
    from dynid.lti.quasi_polynomials import QuasiPolynomial

    p, i, tau = Fraction(kp), Fraction(ki), Fraction(delay)
    above = QuasiPolynomial({tau: fmpz_poly([int(10 * i), int(10 * p)])})
    below = QuasiPolynomial({Fraction(0): fmpz_poly([0, 10, 20, 10])}) + above
    band = delayed_bandwidth(above, below)
    with mp.workdps(40):

        def size(omega):
            s = mp.mpc(0, omega)
            L = (mp.mpf(kp) + mp.mpf(ki) / s) * mp.exp(-s * mp.mpf(delay)) / (s + 1) ** 2
            return abs(L / (1 + L))

        rest = mp.mpf(1)
        assert abs(size(band.bandwidth) / (rest / mp.sqrt(2)) - 1) < 1e-14
        assert all(size(omega) > rest / mp.sqrt(2) for omega in mp.linspace(0.01, band.bandwidth * 0.999, 60))
        assert abs(size(band.peak_frequency) / band.peak_gain - 1) < 1e-14
        assert all(size(omega) <= band.peak_gain * (1 + 1e-14) for omega in mp.linspace(0.01, 12, 400))
        assert abs(size(band.half_power_high) / (band.peak_gain / mp.sqrt(2)) - 1) < 1e-14
