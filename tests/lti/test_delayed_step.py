"""Characteristics of step responses with delays, by their exact polynomials and series."""

import math

import numpy as np
import pytest
from mpmath import mp, mpf

from dynid.lti import delayed_step
from dynid.lti.delay_system import DelaySystem
from dynid.lti.delayed_step import delayed_steps
from dynid.lti.state_space import StateSpace
from tests.lti.test_delay_system import loop


def test_an_integrator_with_a_delay_overshoots_as_its_polynomials_do():
    """y' = 1 - 0.8 y(t - 1): polynomials piece by piece, steady state 1.25."""
    (info,) = delayed_steps(loop([1], [1, 0], [0.8], [1]), [1.25], -0.3)
    with mp.workdps(30):

        def exact(time):
            terms = range(int(time) + 1)
            return sum((-mpf(4) / 5) ** k * (time - k) ** (k + 1) / mp.factorial(k + 1) for k in terms)

        def crossing(level, near):
            return float(mp.findroot(lambda t: exact(t) - level, near))

        peak = mp.findroot(lambda t: 1 - mpf(4) / 5 * exact(t - 1), 2.3)
        outside = exact(mpf(info.settling_time)) > 1.25
        settling = crossing(1.25 * (1.02 if outside else 0.98), info.settling_time)
        assert info.rise_time == pytest.approx(crossing(1.125, 1.2) - 0.125, abs=1e-13)
        assert info.peak_time == pytest.approx(float(peak), abs=1e-7)
        assert info.peak == pytest.approx(float(exact(peak)), abs=1e-13)
        assert info.overshoot == pytest.approx(float(exact(peak) / 1.25 - 1) * 100, abs=1e-11)
        assert info.settling_time == pytest.approx(settling, abs=1e-11)
        later = [float(exact(mpf(t) / 50)) for t in range(math.ceil(50 * info.settling_time), 1000)]
    assert np.abs(np.array(later) / 1.25 - 1).max() <= 0.02 + 1e-12
    assert (info.status, info.initial_value, info.undershoot) == ("defined", 0.0, 0.0)


def test_jumps_count_as_extremes_and_crossings():
    """y(t) = 0.9 (1 - y(t - 1)): d changes its sign at every jump, |d| falls by 0.9."""
    (info,) = delayed_steps(loop([0.9], [1], [1], [1]), [0.9 / 1.9], math.log(0.9))
    final = 0.9 / 1.9
    assert [info.initial_value, info.peak, info.peak_time] == pytest.approx([0.9, 0.9, 0], abs=1e-13)
    assert info.overshoot == pytest.approx(100 * (0.9 / final - 1), rel=1e-12)
    assert info.rise_time == 0.0
    jumps = next(k for k in range(100) if 0.9 ** (k + 1) <= 0.02)
    assert info.settling_time == pytest.approx(jumps, abs=1e-12)


def test_a_dead_time_delays_a_lag_and_nothing_undershoots():
    """y = G e^(-2 s) u, G = 3/(s + 1), as an internal delay."""
    lft = StateSpace([[-1.0]], [[0.0, 3.0]], [[1.0], [0.0]], [[0, 0], [1.0, 0]])
    (info,) = delayed_steps(DelaySystem(lft, (2,)), [3.0], -1.0)
    assert info.rise_time == pytest.approx(math.log(9), abs=1e-12)
    assert info.settling_time == pytest.approx(2 + math.log(50), abs=1e-11)
    assert (info.overshoot, info.undershoot, info.peak, info.peak_time) == (0.0, 0.0, 3.0, math.inf)


def test_what_is_not_defined_or_takes_too_long_is_said(monkeypatch):
    monkeypatch.setattr(delayed_step, "_MAX_SEGMENTS", 200)
    lft = StateSpace([[-1.0]], [[1.0, 0]], [[1.0], [0]], np.zeros((2, 2)), ([[1.0, 0], [0, 0]],))
    (info,) = delayed_steps(DelaySystem(lft, (1,)), [1.0], -1.0)
    assert "impulse" in info.status
    (info,) = delayed_steps(loop([1], [1, 1e-7], [1e-8], [0.001]), [1.0], -1e-7)
    assert info.status.startswith("not computed")
    (info,) = delayed_steps(loop([1], [1, 1], [0], [1]), [0.0], -1.0)
    assert info.status.startswith("not computed")  # that is not its steady state
