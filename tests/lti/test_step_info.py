"""Characteristics of step responses against closed forms, and dense sampling with 40 digits."""

import math
import random
from dataclasses import fields
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from flint import fmpz_poly

from dynid.lti import step_info as module
from dynid.lti.exponential_sums import ExponentialSum
from dynid.lti.step_info import StepInfo, step_info

control = pytest.importorskip("control")


def polynomial(descending):
    """Return integer coefficients for descending ones, times a common factor, and that factor."""
    exact = [Fraction(str(c)) for c in descending]
    factor = math.lcm(*(c.denominator for c in exact))
    return fmpz_poly([int(c * factor) for c in reversed(exact)]), factor


def of(numerator, denominator):
    (above, up), (below, down) = polynomial(numerator), polynomial(denominator)
    above, below = above * down, below * up
    common = above.gcd(below)
    return step_info(above // common, below // common)


@pytest.mark.parametrize("zeta", ["0.001", "0.1", "0.5", "0.7", "0.9", "0.95"])
def test_an_oscillator_has_the_textbook_overshoot_and_peak_time(zeta):
    found = of([4], [1, 4 * Fraction(zeta), 4])
    with mpmath.workdps(40):
        z = mpmath.mpf(zeta)
        damped = mpmath.sqrt(1 - z**2)
        overshoot = 100 * mpmath.exp(-mpmath.pi * z / damped)
        peak_time = mpmath.pi / (2 * damped)
    assert found.overshoot == pytest.approx(float(overshoot), rel=1e-14)
    assert found.peak_time == pytest.approx(float(peak_time), rel=1e-14)
    assert found.peak == pytest.approx(1 + found.overshoot / 100, rel=1e-14)
    assert found.status == "defined"


@pytest.mark.parametrize("zeta", [0.02, 0.4, 0.8])
def test_an_oscillator_rises_and_settles_where_its_response_crosses_the_levels(zeta):
    found = of([1], [1, 2 * Fraction(str(zeta)), 1])
    with mpmath.workdps(30):
        z = mpmath.mpf(str(zeta))
        damped = mpmath.sqrt(1 - z**2)

        def difference(t):
            return -mpmath.exp(-z * t) * (mpmath.cos(damped * t) + z / damped * mpmath.sin(damped * t))

        low = mpmath.findroot(lambda t: difference(t) + mpmath.mpf("0.9"), 0.5)
        high = mpmath.findroot(lambda t: difference(t) + mpmath.mpf("0.1"), 1.5)
        # the last half wave that leaves the band: its extreme at k pi / damped exceeds 2 %
        k = int(mpmath.floor(-mpmath.log("0.02") * damped / (mpmath.pi * z)))
        peak, following = k * mpmath.pi / damped, (k + 1) * mpmath.pi / damped
        sign = (-1) ** (k + 1)
        last = mpmath.findroot(
            lambda t: difference(t) - sign * mpmath.mpf("0.02"), (peak, following), solver="anderson"
        )
    assert found.rise_time == pytest.approx(float(high - low), rel=1e-13)
    assert found.settling_time == pytest.approx(float(last), rel=1e-13)
    assert found.transient_time == found.settling_time


def test_a_first_order_lag_takes_logarithms():
    found = of([-3], [2, 1])
    assert found.rise_time == pytest.approx(2 * math.log(9), rel=1e-15)
    assert found.settling_time == pytest.approx(2 * math.log(50), rel=1e-15)
    assert (found.overshoot, found.undershoot, found.peak, found.peak_time) == (0, 0, -3, math.inf)


def test_poles_of_any_multiplicity_are_those_of_the_erlang_distribution():
    """The step response of (s + 1)^-n is the regularised incomplete gamma function P(n, t)."""
    for n in (2, 5, 20):
        found = of([1], np.array(fmpz_poly([1, 1]) ** n).tolist()[::-1])
        with mpmath.workdps(30):
            at = [
                mpmath.findroot(
                    lambda t, q=q, n=n: mpmath.gammainc(n, 0, t, regularized=True) - mpmath.mpf(q),
                    (mpmath.mpf(n) / 10, 5 * mpmath.mpf(n)),
                    solver="illinois",
                )
                for q in ("0.1", "0.9", "0.98")
            ]
        assert found.rise_time == pytest.approx(float(at[1] - at[0]), rel=1e-13)
        assert found.settling_time == pytest.approx(float(at[2]), rel=1e-13)
        assert found.overshoot == 0


def test_a_right_half_plane_zero_undershoots():
    """(1 - s)/(1 + s)^2: y = 1 - (1 + 2t) exp(-t), least at t = 1/2."""
    found = of([-1, 1], [1, 2, 1])
    assert found.undershoot == pytest.approx(100 * (2 * math.exp(-0.5) - 1), rel=1e-14)
    assert found.peak_time == math.inf
    deep = of([-9, 1], [1, 2, 1])  # y = 1 - (1 + 10 t) exp(-t), least at t = 0.9
    assert deep.peak_time == pytest.approx(0.9, rel=1e-14)
    assert deep.peak == pytest.approx(1 - 10 * math.exp(-0.9), rel=1e-14)


def test_a_jump_counts_as_the_first_value():
    found = of([3, 1], [1, 1])  # y = 1 + 2 exp(-t)
    assert (found.initial_value, found.peak, found.peak_time, found.rise_time) == (3, 3, 0, 0)
    assert found.overshoot == 200
    assert found.settling_time == pytest.approx(math.log(100), rel=1e-15)


def test_without_a_final_value_the_relative_ones_are_left_out():
    found = of([1, 0], [1, 2, 1])  # y = t exp(-t)
    assert found.status.startswith("partly defined: rise time")
    assert found.peak == pytest.approx(math.exp(-1), rel=1e-15)
    assert found.peak_time == pytest.approx(1, rel=1e-15)
    with mpmath.workdps(30):
        last = mpmath.findroot(lambda t: t * mpmath.exp(-t) - mpmath.exp(-1) / 50, 6.8)
    assert found.transient_time == pytest.approx(float(last), rel=1e-14)
    assert (found.rise_time, found.settling_time, found.overshoot) == (None, None, None)


@pytest.mark.parametrize(
    ("numerator", "denominator", "reason"),
    [
        ([1], [1, 0], "no steady state; marginal"),
        ([1], [1, 0, 1], "no steady state; marginal"),
        ([1], [1, -1], "no steady state; unstable"),
        ([1, 0, 0], [1, 1], "improper"),
        ([0], [1], "does not reach"),
    ],
)
def test_what_is_not_defined_has_its_reason(numerator, denominator, reason):
    found = of(numerator, denominator)
    assert reason in found.status
    assert all(getattr(found, field.name) is None for field in fields(StepInfo) if field.name != "status")


def test_a_static_channel_has_arrived_at_once():
    found = of([5], [2])
    assert (found.final_value, found.rise_time, found.settling_time, found.overshoot) == (2.5, 0, 0, 0)
    assert (found.peak, found.peak_time) == (2.5, 0)


def test_a_resonance_of_a_hundred_million_periods_beside_fast_modes_is_followed():
    slow = fmpz_poly([10**8, 1, 10**8])
    found = of([1], np.array(slow * fmpz_poly([10**6, 1])).tolist()[::-1])
    zeta, gain = 0.5e-8, 1e-14
    assert found.final_value == pytest.approx(gain)
    # the envelope exp(-ζ t) falls to 2 %; the last crossing lies within half a period of it
    assert abs(found.settling_time + math.log(0.02) / zeta) < 4
    assert found.overshoot == pytest.approx(100, rel=1e-5)


def dense(numerator, denominator, horizon):
    """Return times and the step response on a dense grid, by partial fractions with 60 digits."""
    with mpmath.workdps(60):
        poles = mpmath.polyroots([mpmath.mpf(c) for c in denominator], maxsteps=500, extraprec=500)
        slope = [c * k for c, k in zip(denominator, range(len(denominator) - 1, 0, -1), strict=False)]
        residues = [mpmath.polyval(numerator, p) / (p * mpmath.polyval(slope, p)) for p in poles]
        final = mpmath.mpf(numerator[-1]) / denominator[-1]
        poles, residues = (np.array([complex(x) for x in part]) for part in (poles, residues))
    times = np.linspace(0, horizon, 40001)
    return times, float(final) + (np.exp(np.outer(times, poles)) @ residues).real


@pytest.mark.parametrize("seed", range(12))
def test_random_channels_are_those_of_a_dense_grid(seed):
    rng = random.Random(seed)
    denominator = fmpz_poly([1])
    for _ in range(rng.randint(1, 3)):
        denominator *= fmpz_poly([rng.randint(1, 60), rng.randint(1, 9), rng.randint(1, 6)])
    if rng.random() < 0.5:
        denominator *= fmpz_poly([rng.randint(1, 9), rng.randint(1, 9)])
    numerator = fmpz_poly(
        [rng.randint(5, 40), *(rng.randint(-9, 9) for _ in range(denominator.degree() - 1))]
    )
    found = step_info(numerator, denominator)
    above, below = ([int(c) for c in part.coeffs()][::-1] for part in (numerator, denominator))
    times, values = dense(above, below, 1.2 * max(found.settling_time, found.transient_time))
    final, step = found.final_value, times[1]
    values = np.append(values, final)  # approached at infinity
    assert found.peak == pytest.approx(values[np.argmax(np.abs(values))], rel=1e-4)
    assert found.overshoot == pytest.approx(max(0, 100 * (np.max(values / final) - 1)), rel=1e-3, abs=1e-3)
    assert found.undershoot == pytest.approx(max(0, -100 * np.min(values / final)), rel=1e-3, abs=1e-3)
    outside = times[np.abs(values[:-1] - final) > 0.02 * abs(final)]
    assert found.settling_time == pytest.approx(outside[-1], abs=2 * step)
    rise = [times[np.argmax(values / final >= part)] for part in (0.1, 0.9)]
    assert found.rise_time == pytest.approx(rise[1] - rise[0], abs=2 * step)


@pytest.mark.thorough
def test_python_control_agrees_where_its_grid_is_fine_enough():
    numerator, denominator = [3.0, 2.0], [1.0, 1.5, 4.0, 2.0]
    found = of(numerator, denominator)
    times = np.linspace(0, 30, 60001)
    other = control.step_info(control.tf(numerator, denominator), T=times)
    for name, value in (
        ("RiseTime", found.rise_time),
        ("SettlingTime", found.settling_time),
        ("Overshoot", found.overshoot),
        ("Peak", found.peak),
        ("PeakTime", found.peak_time),
    ):
        assert other[name] == pytest.approx(value, rel=3e-3), name


@pytest.mark.thorough
def test_nearly_equal_poles_whose_residues_cancel_are_searched_in_balls():
    """Poles at -1, -1.001, …: residues of 1e18 that cancel; the response is nearly that of a sixfold pole."""
    denominator = fmpz_poly([1])
    for k in range(6):
        denominator *= fmpz_poly([1000 + k, 1000])
    found = step_info(fmpz_poly([int(denominator[0])]), denominator)
    sixfold = of([1], np.array(fmpz_poly([1, 1]) ** 6).tolist()[::-1])
    assert ExponentialSum(fmpz_poly([int(denominator[0])]), denominator).cancels
    assert found.settling_time == pytest.approx(sixfold.settling_time, rel=5e-3)
    assert found.overshoot == 0


@pytest.mark.parametrize(
    ("order", "rate"), [(2, "7/3"), (2, "0.013"), (3, "4"), (4, "11/2"), (6, "1/9"), (9, "2")]
)
def test_multiple_poles_whose_residues_vanish_have_the_peak_of_the_closed_form(order, rate):
    """T(s)/s = 1/(s + a)^n is t^(n-1) exp(-a t)/(n-1)!: all residues but one are exactly zero."""
    a = Fraction(rate)
    denominator = fmpz_poly([a.numerator, a.denominator]) ** order
    found = step_info(fmpz_poly([0, a.denominator**order]), denominator)
    time = (order - 1) / float(a)
    assert found.final_value == 0
    assert found.peak_time == pytest.approx(time, rel=1e-13)
    peak = time ** (order - 1) * math.exp(1 - order) / math.factorial(order - 1)
    assert found.peak == pytest.approx(peak, rel=1e-13)


@pytest.mark.parametrize("seed", range(8))
def test_multiple_poles_with_some_residues_zero_respond_as_their_sum(seed):
    """Σ c t^l exp(p t)/l! with random c, many of them zero, of real poles and of pairs."""
    rng = random.Random(seed)
    above, below = fmpz_poly([0]), fmpz_poly([1])
    terms = []
    for rate in rng.sample(range(1, 6), 2):
        order = rng.randint(2, 4)
        parts = [rng.choice([0, 0, 1, -2]) for _ in range(order - 1)] + [rng.choice([1, 3])]
        factor = fmpz_poly([rate, 1])
        own = sum((c * factor ** (order - 1 - k) for k, c in enumerate(parts)), fmpz_poly([0]))
        above, below = above * factor**order + own * below, below * factor**order
        terms += [(c, k, rate) for k, c in enumerate(parts)]
    found = step_info(above * fmpz_poly([0, 1]), below)
    times = np.linspace(0, 60, 600_001)[1:]
    values = sum(c * times**k * np.exp(-rate * times) / math.factorial(k) for c, k, rate in terms)
    assert found.status.startswith("partly defined")
    largest = max(abs(values).max(), abs(found.initial_value))
    assert abs(found.peak) == pytest.approx(largest, rel=1e-6)


def test_double_pairs_whose_residues_vanish_at_one_pair_only():
    """A reducible denominator: (s^2 + 2 s + 5)^2 has residues that vanish, 2 s^2 + s + 6 none."""
    one, other, s = fmpz_poly([5, 2, 1]), fmpz_poly([6, 1, 2]), fmpz_poly([0, 1])
    # T/s = 8 (s + 1)/(s^2 + 2 s + 5)^2 + 2/(2 s^2 + s + 6): t exp(-t) sin 2t 2 + exp(-t/4) sin(w t)/w
    found = step_info(s * (8 * fmpz_poly([1, 1]) * other + 2 * one * one), one * one * other)
    times = np.linspace(0, 30, 3_000_001)
    w = math.sqrt(3 - 1 / 16)
    values = 2 * times * np.exp(-times) * np.sin(2 * times) + np.exp(-times / 4) * np.sin(w * times) / w
    assert found.peak == pytest.approx(values[np.argmax(abs(values))], rel=1e-9)


def test_what_takes_too_many_spans_is_left_out_with_the_reason(monkeypatch):
    monkeypatch.setattr("dynid.lti.exponential_sums._MAX_SPANS", 0)
    assert of([1], [1, 1, 1]).status.startswith(
        "not computed: the step response has millions of oscillations"
    )
    assert module.BAND == 0.02
