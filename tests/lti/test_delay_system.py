"""Time responses with internal delays, by closed forms, ball arithmetic and an independent integrator."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from mpmath import mp, mpf
from scipy.integrate import solve_ivp
from scipy.signal import tf2ss

from dynid.errors import NumericalError, UsageError
from dynid.lti.delay_system import DelaySystem
from dynid.lti.method_of_steps import MAX_SEGMENTS, break_orders
from dynid.lti.signals import (
    Chirp,
    Impact,
    Impulse,
    Multisine,
    Random,
    Sampled,
    Sine,
    Step,
    WhiteNoise,
)
from dynid.lti.state_space import StateSpace

pytestmark = pytest.mark.thorough


def loop(numerator, denominator, gains, delays):
    """u = w - Σ g_i y(t - τ_i) of a plant y = G u; output y."""
    A, B, C, D = tf2ss(numerator, denominator)
    gains, ones = np.atleast_2d(gains), np.ones((len(delays) + 1, 1))
    lft = StateSpace(A, np.hstack([B, -B @ gains]), ones @ C, np.hstack([ones @ D, -ones @ D @ gains]))
    return DelaySystem(lft, tuple(Fraction(delay) for delay in delays))


def step(system, times):
    return system.response([Step()], np.asarray(times, float))


@pytest.mark.parametrize("gain", [Fraction(3, 10), 1, 2, 3])
def test_an_integrator_with_a_delay_is_a_sum_of_polynomials(gain):
    times = np.linspace(0, 20, 81)

    def exact(time):
        terms = ((-gain) ** k * max(time - k, 0) ** (k + 1) / math.factorial(k + 1) for k in range(21))
        return float(sum(terms, Fraction(0)))

    expected = np.array([exact(Fraction(n, 4)) for n in range(81)])
    response = step(loop([1], [1, 0], [float(gain)], [1]), times)
    scale = np.abs(expected).max()
    assert response.outputs[:, 0] == pytest.approx(expected, abs=1e-14 * scale)
    assert response.error[0] <= 1e-12 * scale


def test_a_third_order_lag_is_a_series_of_incomplete_gamma_functions():
    response = step(loop([2], [1, 3, 3, 1], [1], [Fraction(1, 2)]), np.linspace(0, 30, 11))
    with mp.workdps(40):
        for time, value in zip(range(0, 31, 3), response.outputs[:, 0], strict=True):
            terms = (
                (-1) ** k
                * mpf(2) ** (k + 1)
                * mp.gammainc(3 * (k + 1), 0, time - mpf(k) / 2, regularized=True)
                for k in range(2 * time)
            )
            assert value == pytest.approx(float(sum(terms)), abs=2e-15)
    assert response.segments < 70


def test_jumps_of_neutral_loops_are_kept_and_values_are_those_after_them():
    response = step(loop([0.9], [1], [1], ["0.1"]), np.arange(301) / 10)  # 0.1 * 3 is not 3/10
    assert response.outputs[:, 0] == pytest.approx(
        [0.9 * (1 - (-0.9) ** (k + 1)) / 1.9 for k in range(301)], abs=1e-14
    )
    assert response.segments == 301  # one begins at the end


def test_jumps_at_incommensurate_instants_are_kept():
    second = Fraction(14142135, 10**7)
    times = np.linspace(0.31, 19.8, 50)
    response = step(loop([1], [1], [0.5, 0.3], [1, second]), times)
    expected = [
        sum(
            math.comb(i + k, i) * (-0.5) ** i * (-0.3) ** k
            for i, k in itertools.product(range(21), repeat=2)
            if time > i + k * float(second)
        )
        for time in times
    ]
    assert response.outputs[:, 0] == pytest.approx(expected, abs=1e-14)


def test_layers_of_a_stiff_loop_are_resolved():
    """y' = -y + filtered u, poles -1 and -1e6: residues of a cascade in ball arithmetic."""
    denominator = np.polymul([1, 1], [1, 1e6])
    times = [0.5, 1 + 2e-6, 1.5, 2 + 1e-6, 3.25]
    response = step(loop([1e6], denominator, [2.0], [1]), times)
    A, B, C, D = tf2ss([1e6], denominator)
    expected = [_series(A, B[:, 0], C[0], D[0, 0], [2.0], [Fraction(1)], time) for time in times]
    assert response.outputs[:, 0] == pytest.approx(expected, abs=1e-11)


def _series(A, B, C, D, gains, delays, time):
    """The step response of y = G (w - Σ g y(t - τ)) as a sum of cascades of G, in balls of 400 bits."""
    total = arb(0)
    with ctx.workprec(400):
        for counts in itertools.product(*(range(int(time / float(delay)) + 1) for delay in delays)):
            rest = Fraction(time) - sum(k * delay for k, delay in zip(counts, delays, strict=True))
            if rest <= 0:
                continue
            weight = arb(math.factorial(sum(counts)))
            for k, gain in zip(counts, gains, strict=True):
                weight *= arb(-float(gain)) ** k / arb(math.factorial(k)) if k else 1
            total += weight * _cascade(A, B, C, arb(float(D)), sum(counts) + 1, rest)
    return float(total)


def _cascade(A, B, C, direct, stages, time):
    n = len(A)
    matrix = [[arb(0)] * (stages * n + 1) for _ in range(stages * n + 1)]
    power = [arb(1)]
    for _ in range(stages):
        power.append(power[-1] * direct)
    for stage, i in itertools.product(range(stages), range(n)):
        row = matrix[stage * n + i]
        for k in range(n):
            row[stage * n + k] = arb(float(A[i, k]))
            for earlier in range(stage):
                row[earlier * n + k] += arb(float(B[i])) * power[stage - 1 - earlier] * arb(float(C[k]))
        row[-1] = arb(float(B[i])) * power[stage]
    E = (arb_mat(matrix) * (arb(time.numerator) / time.denominator)).exp()
    value = power[stages]
    for stage, k in itertools.product(range(stages), range(n)):
        value += power[stages - 1 - stage] * arb(float(C[k])) * E[stage * n + k, stages * n]
    return value


def random_loop(rng):
    """A loop of order 1 to 6 with 1 to 3 delays: oscillating, unstable and with direct parts, too."""
    order, roots = int(rng.integers(1, 7)), []
    while len(roots) < order:
        if order - len(roots) >= 2 and rng.random() < 0.4:
            size, damping = np.exp(rng.uniform(-1, 1.5)), rng.uniform(-0.1, 1)
            root = size * complex(-damping, math.sqrt(1 - damping**2))
            roots += [root, root.conjugate()]
        else:
            roots.append(-np.exp(rng.uniform(-1, 2)) * (1 if rng.random() < 0.85 else -0.15))
    count = int(rng.integers(1, 4))
    delays = [Fraction(int(ms), 1000) for ms in rng.integers(900, 2500, count)]
    gains = rng.uniform(-1.5, 1.5, count) / count
    return rng.uniform(-2, 2, order + (rng.random() < 0.3)), np.poly(roots).real, gains, delays


def worst_error(seeds):
    """The worst error of random loops relative to the largest value up to 6 s."""
    worst = 0.0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        numerator, denominator, gains, delays = random_loop(rng)
        time = float(rng.uniform(4, 5.9))
        run = loop(numerator, denominator, gains, delays).propagation([Step()], 6.0)
        times = np.unique([*np.linspace(0, 6, 121), time])
        values = run.outputs(times)[:, 0]
        A, B, C, D = tf2ss(numerator, denominator)
        expected = _series(A, B[:, 0], C[0], D[0, 0], gains, delays, time)
        worst = max(worst, abs(values[times == time][0] - expected) / np.abs(values).max())
    return worst


def test_random_loops_agree_with_cascades_in_ball_arithmetic():
    assert worst_error(range(6)) <= 1e-13


@pytest.mark.slow
def test_many_random_loops_agree_with_cascades_in_ball_arithmetic():
    assert worst_error(range(500)) <= 1e-12


_DURATION = 3.0
_SIGNALS = {
    "step": Step(2.0, start=0.4),
    "sine": Sine(1.0, 9.0, 0.3),
    "multisine": Multisine([1.0, 0.5], [3.0, 8.0], [0.1, 0.2]),
    "many sines": Multisine([0.2] * 12, [float(k) for k in range(1, 13)]),
    "chirp": Chirp(1.0, 1.0, 12.0, duration=2.0, begin=0.5),
    "impact": Impact(3.0, 0.35),
    "random": Random(1.0, seed=4, step=0.05, samples=61, band=(0.5, 20.0)),
    "white": WhiteNoise(1.0, seed=4, step=0.1, samples=31),
    "zero hold": Sampled(np.sin(np.arange(31.0)), 0.1, "zero"),
    "linear hold": Sampled(np.sin(np.arange(31.0)), 0.1, "linear"),
    "spline hold": Sampled(np.sin(np.arange(31.0)), 0.1, "spline"),
}


@pytest.mark.parametrize("name", _SIGNALS)
def test_each_signal_drives_a_delayed_loop(name):
    """x' = -x - 2 x(t - 0.7) + u, y = x + u, by an independent integrator between all corners."""
    signal, delay = _SIGNALS[name], 0.7
    lft = StateSpace([[-1.0]], [[1.0, -2.0]], [[1.0], [1.0]], [[1.0, 0.0], [0.0, 0.0]])
    times = np.linspace(0, _DURATION, 31)
    response = DelaySystem(lft, (Fraction(7, 10),)).response([signal], times)
    corners = {0.0, _DURATION, *(k * delay for k in range(1, 5)), *signal.breakpoints(0.0, _DURATION)}
    corners |= {corner + delay for corner in signal.breakpoints(0.0, _DURATION)}
    corners = sorted(corner for corner in corners if corner <= _DURATION)
    pieces = []

    def past(time):
        for start, stop, solution in pieces:
            if start <= time <= stop + 1e-12:
                return float(solution(time)[0])
        return 0.0

    state, expected = [0.0], np.zeros(len(times))
    for start, stop in itertools.pairwise(corners):
        if stop - start < 1e-12:
            continue
        middle = np.array([(start + stop) / 2])

        def driven(time, middle=middle):
            return float((signal.states(np.array([time]), middle) @ signal.generator()[1])[0])

        solution = solve_ivp(
            lambda t, x: [-x[0] - 2 * past(t - delay) + driven(t)],
            (start, stop),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-13,
            dense_output=True,
        )
        pieces.append((start, stop, solution.sol))
        state = solution.y[:, -1]
        inside = (times >= start - 1e-12) & (times < stop - 1e-12)
        expected[inside] = solution.sol(times[inside])[0]
    expected[-1] = state[0]
    expected += signal.value(times)
    assert response.outputs[:-1, 0] == pytest.approx(expected[:-1], abs=2e-9)
    assert response.outputs[-1, 0] == pytest.approx(expected[-1], abs=2e-9)
    assert np.array_equal(response.inputs[:, 0], signal.value(times))


def test_an_impulse_returns_through_a_delayed_direct_part():
    """y = G (u - 0.8 y(t - 1)), G = 0.5 + 1/(s + 1): a series of impulse responses of G^k."""
    lft = StateSpace([[-1.0]], [[1.0, -0.8]], [[1.0], [1.0]], [[0.5, -0.4], [0.5, -0.4]])
    times = np.linspace(0.25, 4.25, 17)
    response = DelaySystem(lft, (Fraction(1),)).response([Impulse(2.0)], np.array([0.0, *times]))
    assert response.impulsive.tolist() == [True]

    def power(stages, time):  # of (0.5 + 1/(s + 1))^n without its Dirac part
        return sum(
            math.comb(stages, j) * 0.5 ** (stages - j) * time ** (j - 1) / math.factorial(j - 1)
            for j in range(1, stages + 1)
        ) * math.exp(-time)

    expected = [
        2 * sum((-0.8) ** k * power(k + 1, time - k) for k in range(5) if time >= k) for time in times
    ]
    assert response.outputs[1:, 0] == pytest.approx(expected, abs=1e-14)


def test_outputs_that_follow_derivatives_of_delayed_inputs():
    """y = v' with v = z(t - 1), z = 1 - e^-t: y = e^-(t-1) after t = 1, with no Dirac part."""
    system = StateSpace([[-1.0]], [[1.0, 0.0]], [[0.0], [1.0]], np.zeros((2, 2)), ([[0, 1.0], [0, 0]],))
    response = step(DelaySystem(system, (Fraction(1),)), np.linspace(0, 5, 21))
    times = np.linspace(0, 5, 21)
    assert response.outputs[:, 0] == pytest.approx(np.where(times >= 1, np.exp(1 - times), 0), abs=1e-12)
    assert not response.impulsive.any()
    direct = StateSpace([[-1.0]], [[1.0, 0.0]], [[0.0], [0.0]], [[0, 0.0], [1.0, 0]], ([[0, 1.0], [0, 0]],))
    assert step(DelaySystem(direct, (Fraction(1),)), times).impulsive.all()


def test_a_derivative_of_a_jump_that_is_fed_back_acts_as_an_impulse():
    """z = u' is a Dirac impulse at 0, which x' = v integrates to a step at t = 1."""
    system = StateSpace([[0.0]], [[0.0, 1.0]], [[1.0], [0.0]], np.zeros((2, 2)), ([[0.0, 0], [1.0, 0]],))
    response = step(DelaySystem(system, (Fraction(1),)), [0.0, 0.5, 1.0, 3.0])
    assert response.outputs[:, 0] == pytest.approx([0, 0, 1, 1], abs=1e-14)


def test_held_inputs_change_where_they_are_told():
    """A sampled controller: u = -y just before each instant, y' = u(t - 0.3) + 1, exactly by hand."""
    lft = StateSpace([[0.0]], [[1.0, 0.0, 1.0]], [[1.0], [0.0]], [[0, 0, 0], [0, 1.0, 0]])
    run = DelaySystem(lft, (Fraction(3, 10),)).propagation([Step(), None], 4.0)
    measured = []
    for k in range(1, 5):
        list(run.segments(Fraction(k)))
        measured.append(float(run.now[0]))
        run.hold(1, -measured[-1])
    expected, held = [1.0], [0.0, -1.0]
    for _ in range(3):
        expected.append(expected[-1] + 1 + 0.3 * held[-2] + 0.7 * held[-1])
        held.append(-expected[-1])
    assert measured == pytest.approx(expected, abs=1e-14)


def test_advanced_loops_and_too_many_segments_are_refused():
    higher = ([[0.0, 0], [0, 1.0]],)
    advanced = StateSpace([[-1.0]], [[1.0, 0]], [[1.0], [0]], np.zeros((2, 2)), higher)
    with pytest.raises(NumericalError, match="advanced"):
        DelaySystem(advanced, (Fraction(1),))
    with pytest.raises(UsageError, match="2,000,000 segments"):
        step(loop([1], [1, 1], [1], ["1e-6"]), [0.0, 2.0])
    assert MAX_SEGMENTS == 1_000_000
    with pytest.raises(UsageError, match="positive"):
        loop([1], [1, 1], [1], [0])
    with pytest.raises(UsageError, match="one signal per input"):
        loop([1], [1, 1], [1], [1]).response([], np.array([0.0, 1.0]))
    lft = StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]])
    with pytest.raises(UsageError, match="2 delays"):
        DelaySystem(lft, (Fraction(1), Fraction(2)))


def test_a_response_beyond_double_precision_is_an_error():
    with pytest.raises(NumericalError, match="beyond double precision"):
        step(loop([1], [1, -1], [1e8], [1]), np.linspace(0, 60, 7))


def test_orders_of_breaks_depend_on_the_structure_and_not_on_the_size_of_rates():
    """A chain of five integrators with leaks of any size smooths by its length."""
    for rate in (1.0, 1e-60, 1e60):
        A = np.diag(np.full(5, -rate)) + np.diag(np.ones(4), -1)
        chain = StateSpace(A, np.eye(5)[:, [0, 3]], np.eye(5)[[4, 0]], np.zeros((2, 2)))
        np.testing.assert_array_equal(break_orders(chain), [[5, 2], [1, np.inf]])


def test_rounded_times_of_steep_samples_are_no_kinks():
    """Late in a record the times of samples are rounded: segments were halved there to the last digit."""
    step, tau, samples = 0.05, 0.317, 700
    values = np.repeat(np.random.default_rng(1).standard_normal(samples // 20 + 1), 20)[:samples]
    lft = StateSpace([[-1.0]], [[1.0, -1.5]], [[1.0], [1.0]], [[0.0, 0.0], [0.0, 0.0]])
    times = 0.5 * np.arange(1, 70)
    signal = Sampled(values, step, "linear")
    response = DelaySystem(lft, (Fraction(tau),)).response([signal], times)
    assert response.segments < 20_000
    # x' = -x + u - 1.5 x(t - tau) by Runge and Kutta's steps of 0.001 s, by which tau and the samples are
    # whole; half way between two of them x is that of a cubic.
    h, late, of_step = 0.001, 317, 50
    x = np.zeros(len(times) * 500 + 1)
    half = np.zeros(len(x))

    def u(n, part):
        k, rest = divmod(n, of_step)
        return values[k] + (values[min(k + 1, samples - 1)] - values[k]) * (rest + part) / of_step

    for n in range(len(x) - 1):
        m = n - late
        v = (x[m], half[m], x[m + 1]) if m >= 0 else (0.0, 0.0, 0.0)
        forces = [u(n, part) - 1.5 * before for part, before in zip((0.0, 0.5, 1.0), v, strict=True)]
        k1 = forces[0] - x[n]
        k2 = forces[1] - (x[n] + h / 2 * k1)
        k3 = forces[1] - (x[n] + h / 2 * k2)
        k4 = forces[2] - (x[n] + h * k3)
        x[n + 1] = x[n] + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        half[n] = (x[n] + x[n + 1]) / 2 + h / 8 * (k1 - (forces[2] - x[n + 1]))
    expected = x[np.rint(times / h).astype(int)]
    assert response.outputs[:, 0] == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())
