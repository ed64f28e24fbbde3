"""Exact time responses, against closed forms and tight Runge–Kutta runs."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from dynid.errors import NumericalError, UsageError
from dynid.lti.generator import RecordTimes
from dynid.lti.signals import Chirp, Impact, Impulse, Multisine, Random, Sampled, Sine, Step, signal
from dynid.lti.state_space import StateSpace
from dynid.lti.time_response import impulsive_outputs, propagate


def oscillator(omega, zeta=0.0):
    """x'' + 2 zeta omega x' + omega^2 x = u, outputs x, x', x''."""
    A = [[0, 1], [-(omega**2), -2 * zeta * omega]]
    return StateSpace(A, [[0], [1]], [[1, 0], [0, 1], A[1]], [[0], [0], [1]])


def closed_step(omega, zeta, t):
    damped = omega * math.sqrt(1 - zeta**2)
    t = np.maximum(t, 0)
    decay = np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t))
    return (1 - decay) / omega**2


@pytest.mark.parametrize("step", [1e-3, 0.1, 3.0])
def test_resonance_without_damping_is_exact_at_any_step(step):
    omega = 50.0
    t = np.arange(0, 3 + step / 2, step)
    y = propagate(oscillator(omega), [Sine(2, omega)], t).outputs[:, 0]
    exact = (np.sin(omega * t) - omega * t * np.cos(omega * t)) / omega**2
    # Rounding adds up over the phase (150 rad) or the steps (3,000), whichever are more.
    assert np.abs(y - exact).max() <= 1e-13 * 3 / omega


@pytest.mark.parametrize("step", [0.01, 0.37])
def test_step_inside_a_sampling_interval_splits_it(step):
    t = np.arange(0, 4, step)
    y = propagate(oscillator(9.0, 0.1), [Step(2.0, 0.1234)], t).outputs[:, 0]
    np.testing.assert_allclose(y, 2 * closed_step(9.0, 0.1, t - 0.1234), atol=1e-15)


def test_impulse_is_a_jump_of_the_state():
    t = np.linspace(0, 1, 11)
    r = propagate(oscillator(9.0), [Impulse(0.5)], t, x0=[0.1, 0.0])
    np.testing.assert_allclose(r.outputs[:, 0], 0.1 * np.cos(9 * t) + 0.5 / 9 * np.sin(9 * t), atol=1e-15)
    assert r.states[0, 1] == 0.5
    late = propagate(oscillator(9.0), [Impulse(0.5)], t[3:], x0=[0.1, 0.0])
    np.testing.assert_allclose(late.states, r.states[3:], atol=1e-14)


def test_impulse_inside_a_time_span_that_starts_before_zero():
    t = np.array([-0.3, -0.05, 0.2])
    y = propagate(oscillator(9.0), [Impulse(0.5)], t).outputs[:, 0]
    np.testing.assert_allclose(y, [0, 0, 0.5 / 9 * math.sin(1.8)], atol=1e-16)


def test_impact_is_exact_across_its_end():
    omega, amplitude, duration = 40.0, 7.0, 0.0437
    t = np.arange(0, 0.5, 0.01)
    p = math.pi / duration
    y = propagate(oscillator(omega), [Impact(amplitude, duration)], t).outputs[:, 0]

    def during(s):
        return amplitude / (omega**2 - p**2) * (np.sin(p * s) - p / omega * np.sin(omega * s))

    # After contact: the two steps of a half sine, one shifted by its duration.
    after = during(t) + during(np.maximum(t - duration, 0))
    np.testing.assert_allclose(y, after, atol=1e-15)


@pytest.mark.thorough
@pytest.mark.parametrize(
    "signal",
    [
        pytest.param(Chirp(1.0, 10, 200, 1.0, 0.5), marks=pytest.mark.slow),
        Multisine(list(range(1, 21)), list(np.linspace(3, 90, 20))),
        Random(2.0, seed=1, step=0.01, samples=200),
        Sampled(np.random.default_rng(0).standard_normal(68), 0.03),
        Sampled(np.random.default_rng(0).standard_normal(68), 0.03, "linear"),
    ],
    ids=["chirp", "many sines", "random", "spline", "linear"],
)
def test_broad_signals_against_runge_kutta(signal):
    system = oscillator(50.0, 0.02)
    t = np.linspace(0, 1, 11)
    edges = np.unique(np.concatenate([[0.0, 1.0], signal.breakpoints(0, 1)]))
    x, states = np.zeros(2), [np.zeros(2)]
    marks = np.unique(np.concatenate([edges, t]).round(13))
    for a, b in itertools.pairwise(marks):
        run = solve_ivp(
            lambda s, x, b=b: (
                system.A @ x + system.B[:, 0] * float(signal.value(np.array([min(s, b - 1e-12)]))[0])
            ),
            (a, b),
            x,
            method="DOP853",
            rtol=1e-12,
            atol=1e-15,
            max_step=0.01,
        )
        x = run.y[:, -1]
        if np.abs(t - b).min() < 1e-9:
            states.append(x)
    r = propagate(system, [signal], t)
    np.testing.assert_allclose(r.states, states, rtol=0, atol=1e-10 * np.abs(r.states).max())
    np.testing.assert_allclose(r.inputs[:, 0], signal.value(t), atol=1e-12)


def test_random_line_on_an_undamped_pole_grows_like_resonance():
    spacing = 2 * math.pi / 2.0
    system = oscillator(5 * spacing)
    lines = Random(1.0, seed=4, step=0.05, samples=40, band=(4.5 * spacing, 5.5 * spacing))
    omega, c = lines.lines
    assert len(omega) == 1
    t = np.linspace(0, 2, 41)
    y = propagate(system, [lines], t).outputs[:, 0]
    same = propagate(system, [Sine(abs(c[0]), omega[0], float(np.angle(1j * c[0])))], t).outputs[:, 0]
    np.testing.assert_allclose(y, same, atol=1e-14)
    assert np.abs(y[-10:]).max() > 2 * np.abs(y[:10]).max()


def test_random_agrees_with_its_own_sum_of_sines():
    system = oscillator(30.0, 0.01)
    noise = Random(1.0, seed=4, step=0.02, samples=100)
    omega, c = noise.lines
    t = np.arange(50, 100) * 0.02
    sines = [Sine(abs(a), w, float(np.angle(1j * a))) for a, w in zip(c, omega, strict=True)]
    parts = [propagate(system, [s], t, start=0.0).outputs for s in sines]
    y = propagate(system, [noise], t, start=0.0).outputs
    np.testing.assert_allclose(y, np.sum(parts, axis=0), rtol=0, atol=1e-12 * np.abs(y).max())


@given(
    st.sampled_from(
        [
            Step(1.0, 0.31),
            Sine(1.0, 20.0),
            Chirp(1.0, 5, 60, 1.0, 0.2),
            Impact(5.0, 0.217),
            Random(1.0, seed=2, step=0.05, samples=40),
            Sampled(np.sin(np.arange(41.0)), 0.05),
            Impulse(0.3),
        ]
    ),
    st.lists(st.floats(0.001, 1.99), min_size=1, max_size=8, unique=True),
)
@settings(max_examples=40, deadline=None)
def test_a_response_does_not_depend_on_the_times_asked_for(signal, times):
    system = oscillator(25.0, 0.05)
    t = np.array(sorted(times))
    if np.any(np.diff(t) < 1e-6):
        return
    some = propagate(system, [signal], t).states
    with_more = np.union1d(t, np.linspace(0, 1.999, 97))
    more = propagate(system, [signal], with_more).states
    np.testing.assert_allclose(some, more[np.isin(with_more, t)], rtol=0, atol=1e-12)


def test_stiff_and_slow_side_by_side():
    rates = np.array([1e-3, 1.0, 1e7])
    system = StateSpace(-np.diag(rates), np.ones((3, 1)), np.eye(3), np.zeros((3, 1)))
    t = np.array([0.5, 1.0, 700.0])
    y = propagate(system, [Step(1.0)], t).outputs
    np.testing.assert_allclose(y, -np.expm1(-np.outer(t, rates)) / rates, rtol=1e-13)


def test_improper_systems_see_the_derivatives_of_the_input():
    system = StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), [[1.0]], ([[0.5]], [[0.25]]))
    t = np.linspace(0, 1, 7)
    y = propagate(system, [Sine(2.0, 3.0)], t).outputs[:, 0]
    np.testing.assert_allclose(y, 2 * np.sin(3 * t) + 3 * np.cos(3 * t) - 4.5 * np.sin(3 * t), atol=1e-13)
    noise = Random(1.0, seed=2, step=0.05, samples=40)
    y = propagate(system, [noise], t).outputs[:, 0]
    omega, c = noise.lines
    gain = 1 + 0.5j * omega - 0.25 * omega**2
    np.testing.assert_allclose(y, [(gain * c * np.exp(1j * omega * s)).sum().real for s in t], rtol=1e-9)


def test_settling_takes_one_step_however_long():
    system, t = oscillator(40.0, 0.01), 1000.0 + np.arange(5) * 0.01
    y = propagate(system, [Sine(1.0, 30.0)], t).outputs[:, 0]
    gain = 1 / (1600 - 900 + 2j * 0.01 * 40 * 30)
    np.testing.assert_allclose(y, np.imag(gain * np.exp(30j * t)), atol=1e-10 * abs(gain))  # phase 4e4 rad


def test_nonsense_is_refused():
    system = oscillator(3.0)
    for arguments in (
        ([], [0.0]),
        ([Step()], []),
        ([Step()], [1.0, 1.0]),
        ([Step()], [math.nan]),
        ([Step()], [0.0], [1.0]),
        ([Step()], [0.0], [1.0, math.inf]),
        ([Step()], [0.0], None, 1.0),
    ):
        with pytest.raises(UsageError):
            propagate(system, *arguments)


def test_an_overflow_names_the_mode_that_grows_only_where_one_does():
    growing = StateSpace([[50.0, 2.0], [-2.0, 50.0]], [[1.0], [0.0]], [[1.0, 0.0]], [[0.0]])
    with pytest.raises(NumericalError, match="beyond double precision") as caught:
        propagate(growing, [Step()], np.arange(100.0))
    assert caught.value.remedy.startswith(
        "The natural mode at 50 ± 2j rad/s grows by e^4950 in 99 s: shorten"
    )
    huge = StateSpace([[-1.0]], [[1e300]], [[1e300]], [[0.0]])
    with pytest.raises(NumericalError, match="beyond double precision") as caught:
        propagate(huge, [Step()], np.arange(10.0))
    assert "Check the units" in caught.value.remedy


@pytest.mark.parametrize(
    "change",
    [
        {"B": np.ones((3, 1))},
        {"A": [[np.nan]]},
        {"C": [1.0]},
        {"inputs": ("a", "b")},
        {"output_units": ("m", "s")},
    ],
)
def test_systems_must_fit_together(change):
    given = {"A": [[-1.0]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]], **change}
    with pytest.raises(UsageError):
        StateSpace(**given)


# --- Dirac impulses in outputs ---

RECORD = RecordTimes(0.01, 201)
SPLINE = {"values": np.sin(np.linspace(0.0, 7.0, 201)) ** 4, "hold": "spline"}

#: Signals, and the lowest derivative that jumps on [0, 2 s] (-1: an impulse; None: none up to the third).
FIRST_JUMP = [
    ("impulse", {"amplitude": 2.0}, -1),
    ("step", {"amplitude": 2.0, "start": 0.0}, 0),
    ("step", {"amplitude": -3.0, "start": 1.25}, 0),
    ("step", {"amplitude": 2.0, "start": 5.0}, None),  # after the last time
    ("step", {"amplitude": 0.0, "start": 0.0}, None),
    ("sine", {"amplitude": 1.0, "frequency": 9.0, "phase": 0.0}, 1),
    ("sine", {"amplitude": 1.0, "frequency": 9.0, "phase": 0.7}, 0),
    ("multisine", {"amplitude": (2.0, -1.0), "frequency": (1.0, 2.0), "phase": (0.0, 0.0)}, 3),
    ("impact", {"amplitude": 5.0, "duration": 0.1}, 1),
    ("file", {"values": np.r_[0.0, np.ones(200)], "hold": "linear"}, 1),
    ("file", {"values": np.r_[0.0, np.ones(200)], "hold": "zero"}, 0),
    ("file", SPLINE, 1),  # the slope of the spline at t = 0 is not quite zero
]


@pytest.mark.parametrize(("kind", "keys", "first"), FIRST_JUMP)
@pytest.mark.parametrize("order", range(4))
def test_an_output_has_an_impulse_where_a_lower_derivative_of_its_input_jumps(kind, keys, first, order):
    """y1 follows the derivative of that order, y2 follows nothing."""
    parts = [np.array([[float(k == order)], [0.0]]) for k in range(order + 1)]
    system = StateSpace(np.zeros((1, 1)), np.ones((1, 1)), np.ones((2, 1)), parts[0], higher=tuple(parts[1:]))
    found = impulsive_outputs(system, [signal(kind, keys, RECORD)], 2.0)
    assert found.tolist() == [first is not None and first < order, False]
