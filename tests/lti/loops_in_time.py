"""Figures of loops in time: errors, verdicts and processor time (``python -m tests.lti.loops_in_time``).

Names of sections choose some: steps, random, pade, neutral, sampled. Times are of this thread, in ms, and of
calls that alternate where two are compared; the tests check the same errors without a clock.
"""

import math
import random
import sys
import time
from fractions import Fraction
from functools import partial

import numpy as np
from mpmath import mp, mpf
from scipy.signal import tf2ss

from dynid.lti.difference_operator import separation
from dynid.lti.signals import Step
from tests.bondgraph.sampled_loops import closed_matrix, loop_gain
from tests.bondgraph.test_sampled_loops import drawn, radius
from tests.lti.test_delay_system import _series, loop, step, worst_error
from tests.lti.test_difference_operator import products


def timed(function):
    """Return what a function returns, and its processor time, ms."""
    start = time.thread_time()
    value = function()
    return value, (time.thread_time() - start) * 1e3


def third_order(instant):
    """2/(s + 1)^3 e^(-s/2) in a loop: a series of incomplete gamma functions."""
    with mp.workdps(60):
        terms = (
            (-1) ** k
            * mpf(2) ** (k + 1)
            * mp.gammainc(3 * (k + 1), 0, instant - mpf(k) / 2, regularized=True)
            for k in range(math.ceil(2 * instant))
        )
        return float(sum(terms))


def first_order(instant):
    """0.9/(s + 1) e^-s in a loop."""
    with mp.workdps(60):
        terms = (
            (-1) ** k * mpf("0.9") ** (k + 1) * mp.gammainc(k + 1, 0, instant - k, regularized=True)
            for k in range(math.ceil(instant))
        )
        return float(sum(terms))


def cascades(numerator, denominator, gains, delays):
    """Return the exact step response of a loop by instant, in ball arithmetic."""
    A, B, C, D = tf2ss(numerator, denominator)
    exact = [Fraction(delay) for delay in delays]
    return lambda instant: _series(A, B[:, 0], C[0], D[0, 0], gains, exact, instant)


def neutral(instant):
    return 0.9 * (1 - (-0.9) ** (math.floor(instant) + 1)) / 1.9


def polynomials(instant, gain=3):
    terms = (
        (-gain) ** k * max(Fraction(instant) - k, 0) ** (k + 1) / math.factorial(k + 1)
        for k in range(math.ceil(instant))
    )
    return float(sum(terms, Fraction(0)))


def steps():
    eight = [0.7 + 0.11 * k for k in range(8)]
    cases = {
        "integrator, closed polynomials, 20 s": (([1], [1, 0], [3.0], [1]), 20, polynomials),
        "third order, 60 s": (([2], [1, 3, 3, 1], [1.0], ["1/2"]), 60, third_order),
        "0.9/(s + 1) e^-s, 20 s": (([0.9], [1, 1], [1.0], [1]), 20, first_order),
        "neutral 0.9, 60 s": (([0.9], [1], [1.0], [1]), 60, neutral),
        "stiff, poles 1 and 1e6": (([1e6], np.polymul([1, 1], [1, 1e6]), [2.0], [1]), 3.5, None),
        "three incommensurate delays, 8 s": (
            ([1], [1, 1], [0.4, 0.3, 0.2], ["1", "1.4142136", "1.7320508"]), 8, None,
        ),
        "eight delays": (([1], [1, 1], [0.1] * 8, [f"{delay:.2f}" for delay in eight]), 3, None),
    }  # fmt: skip
    for name, (arguments, stop, exact) in cases.items():
        instants = np.array([k * stop / 14 + stop / 100 for k in range(13)])
        value = exact or cascades(*arguments)
        runs = [loop(*arguments).propagation([Step()], float(stop)) for _ in range(11)]
        results = [timed(partial(run.outputs, instants)) for run in runs]
        values, ms, run = results[0][0][:, 0], np.median([ms for _, ms in results]), runs[0]
        error = max(abs(v - value(t)) for v, t in zip(values, instants.tolist(), strict=True))
        scale = np.abs(values).max()
        print(f"{name}: error {error / scale:.1e} of the largest value, {run.count} segments, {ms:.1f} ms")


def pade():
    import control

    times = np.linspace(0, 30, 301)
    system = loop([2], [1, 3, 3, 1], [1.0], ["1/2"])
    exact = np.array([third_order(instant) if instant else 0.0 for instant in times.tolist()])

    def ours():
        return system.propagation([Step()], 30.0).outputs(times)[:, 0]

    def theirs():
        plant = control.tf([2], [1, 3, 3, 1])
        closed = control.feedback(control.ss(plant), control.ss(control.tf(*control.pade(0.5, 8))))
        return control.forced_response(closed, times, np.ones_like(times)).outputs

    pairs = [(timed(ours), timed(theirs)) for _ in range(21)]
    (own, _), (other, _) = pairs[-1]
    errors = [np.abs(values - exact).max() for values in (own, other)]
    ratio = np.median([a / b for (_, a), (_, b) in pairs])
    ms = [np.median([pair[side][1] for pair in pairs]) for side in (0, 1)]
    print(
        f"Pade 8: {errors[1]:.1e} in {ms[1]:.2f} ms; steps: {errors[0]:.1e} in {ms[0]:.2f} ms, {ratio:.2f} x"
    )
    print(f"  error {errors[1] / errors[0]:.1e} times smaller")
    corners = np.array([1.0 + k / 1000 for k in (-2, -1, 1, 2)] + [2.001, 3.001])
    values = step(loop([0.9], [1, 1], [1.0], [1]), corners).outputs[:, 0]
    grid = np.linspace(0, 4, 4001)
    for order in (2, 8, 14):
        forward = control.ss(control.tf([0.9], [1, 1]))
        closed = control.feedback(forward, control.ss(control.tf(*control.pade(1, order))))
        approximate = control.forced_response(closed, grid, np.ones_like(grid)).outputs
        worst = max(abs(approximate[k] - first_order(grid[k])) for k in range(1, 4001, 20))
        print(f"  0.9 e^-s/(s + 1): Pade {order}: {worst:.1e}")
    worst = max(abs(v - first_order(t)) for v, t in zip(values, corners.tolist(), strict=True))
    print(f"  0.9 e^-s/(s + 1) at its corners: {worst:.1e}")


def many_random():
    print(f"500 random loops of order 1-6, 1-3 delays: worst error {worst_error(range(500)):.1e}")


def neutral_products():
    """200 products of 1 + a q, with a known truth, as the difference operators of loops apart."""
    for variables, count in ((1, 67), (2, 67), (3, 66), (4, 50)):
        right = undecided = wrong = 0
        total = 0.0
        for seed in range(count):
            coefficients, least = products(random.Random(1000 * variables + seed), variables)
            apart, ms = timed(lambda coefficients=coefficients: separation(coefficients))
            total += ms
            undecided += apart is None
            right += apart is not None and (apart > 0) == (least > 0)
            wrong += apart is not None and (apart > 0) != (least > 0)
        verdicts = f"{right} of {count} right, {undecided} undecided, {wrong} wrong"
        print(f"{variables} delays: {verdicts}, {total / count:.2f} ms each")


def sampled():
    wrong = 0
    confirmed = {"gain": [0, 0], "phase": [0, 0]}
    kinds, times = {}, {"verdict": [], "margins": []}
    for seed in range(500):
        chain, kp, ki, sampling, loops = drawn(seed)
        verdict, ms = timed(lambda loops=loops: loops.verdict)
        times["verdict"].append(ms)
        kinds[verdict.kind] = kinds.get(verdict.kind, 0) + 1
        values = np.linalg.eigvals(closed_matrix(chain, float(kp), float(ki), sampling))
        outside = int((np.abs(values) > 1 + 1e-9).sum())
        on_circle = bool((np.abs(np.abs(values) - 1) < 1e-9).any())
        expected = "unstable" if outside else "marginal" if on_circle else "stable"
        wrong += (verdict.kind, verdict.unstable_poles) != (expected, outside)
        if not verdict.stable:
            continue
        margin, ms = timed(lambda loops=loops: loops.margins(0))
        times["margins"].append(ms)
        if np.isfinite(margin.gain):
            sides = [radius(chain, kp, ki, sampling, margin.gain * (1 + side)) for side in (-1e-6, 1e-6)]
            confirmed["gain"][0] += sides[0] < 1 < sides[1]
            confirmed["gain"][1] += 1
        if np.isfinite(margin.phase):
            value = loop_gain(chain, float(kp), float(ki), sampling, margin.gain_crossover)
            turned = abs(np.degrees(np.angle(-value)) % 360 - margin.phase) < 1e-6
            confirmed["phase"][0] += abs(abs(value) - 1) < 1e-8 and turned
            confirmed["phase"][1] += 1
    print(f"500 sampled loops: {wrong} wrong, {kinds}")
    for name, (good, count) in confirmed.items():
        print(f"  {name} margins confirmed from both sides: {good} of {count}")
    for name, values in times.items():
        print(f"  {name}: median {np.median(values):.2f} ms, 90 % below {np.quantile(values, 0.9):.2f} ms")


SECTIONS = {
    "steps": steps,
    "random": many_random,
    "pade": pade,
    "neutral": neutral_products,
    "sampled": sampled,
}

if __name__ == "__main__":
    for section in sys.argv[1:] or SECTIONS:
        SECTIONS[section]()
