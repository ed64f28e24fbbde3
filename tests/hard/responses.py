"""Responses of graphs over frequency and time: at and beside poles, stiff, long, and from hidden modes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import mpmath
import numpy as np

from tests.hard.case import Case, Refusal
from tests.hard.scenes import graph, run

RING = "Se u, 1 j, I m 1, C c 1"
RING_BONDS = "u -> j -> m, j -> c"
BY_MPMATH = "closed form, mpmath with 60 digits"


def _swept(nodes: str, bonds: str, output: str, omega: float) -> np.ndarray:
    grid = {"start": omega, "stop": max(omega, 1e-300), "points": 1, "scale": "linear"}
    scene = graph(nodes, bonds, output, results=["frequency_response"], frequency=grid)
    return run(scene).value("bond_graph/frequency_response/response")[:, 0, 0]


def _over_frequency(name: str, nodes: str, bonds: str, output: str, omega: float, known: complex) -> Case:
    source = "by hand" if not np.isfinite(known) or known in (0, 1) else BY_MPMATH
    ask = partial(_swept, nodes, bonds, output, omega)
    return Case(name, "frequency", source, ask, np.array([known]), 1e-15)


def _ring(omega: float, quantity: str = "f") -> complex:
    """Flow of a mass on a spring, both 1: s / (s^2 + 1); its displacement 1 / (s^2 + 1)."""
    with mpmath.workdps(60):
        s = mpmath.mpc(0, omega)
        return complex((s if quantity == "f" else 1) / (s * s + 1))


def _times(
    nodes: str,
    bonds: str,
    outputs: str | list[str],
    stop: float,
    step: float,
    signal: dict[str, Any] | None = None,
    initial: dict[str, Any] | None = None,
) -> dict[str, np.ndarray]:
    time: dict[str, Any] = {"stop": stop, "step": step}
    if signal:
        time["input"] = signal
    scene = graph(nodes, bonds, outputs, results=["time_response"], time=time, initial=initial or {})
    result = run(scene)
    group = "bond_graph/time_response"
    return {"time": result.value(f"{group}/time"), "response": result.value(f"{group}/response")}


def _last(*question: Any) -> np.ndarray:
    return _times(*question)["response"][-1]


def _stiff(rates: Sequence[str]) -> Case:
    """Relaxing branches in series under a step of flow: sum of (1 - exp(-a t)) / a, from 1e9 to 1e-3 1/s."""
    nodes, bonds = "Sf u, 1 j", "u -> j"
    for i, rate in enumerate(rates):
        nodes += f", 0 n{i}, C c{i} 1, R r{i} 1/({rate})"
        bonds += f", j -> n{i} -> c{i}, n{i} -> r{i}"
    stop, step = 2000.0, 500.0

    def known() -> np.ndarray:
        with mpmath.workdps(60):
            parts = [mpmath.mpf(rate) for rate in rates]
            return np.array([float(sum((1 - mpmath.exp(-a * stop)) / a for a in parts))])

    ask = partial(_last, nodes, bonds, "u.e", stop, step, {"kind": "step"})
    name = f"step response of rates {', '.join(rates)} 1/s over {stop:g} s"
    return Case(name, "frequency", BY_MPMATH, ask, known, 1e-13)


def _coupled() -> Case:
    """A stiff ladder of two: C1 = 1e-9, R1 = 1 before C2 = 1, R2 = 1000: rates 1e9 and 1e-3."""
    stop = 5000.0

    def known() -> np.ndarray:
        with mpmath.workdps(60):
            # e1' = (u - e1 + e2)/1e-9, with r = 1 between; e2' = (e1 - e2) - e2/1000.
            A = mpmath.matrix([[-mpmath.mpf(2) * 10**9, 10**9], [1, -1 - mpmath.mpf(1) / 1000]])
            b = mpmath.matrix([10**9, 0])
            rest = -(mpmath.inverse(A) * b)
            a, d, bc = A[0, 0], A[1, 1], A[0, 1] * A[1, 0]
            middle, root = (a + d) / 2, mpmath.sqrt(((a - d) / 2) ** 2 + bc)
            slow, fast = (a * d - bc) / (middle - root), middle - root
            # exp(A t) = (exp(slow t)(A - fast) - exp(fast t)(A - slow)) / (slow - fast)
            one = mpmath.eye(2)
            E = (mpmath.exp(slow * stop) * (A - fast * one) - mpmath.exp(fast * stop) * (A - slow * one)) / (
                slow - fast
            )
            return np.array([float((rest - E * rest)[1])])

    nodes = "Se u, 1 i, R r 1, 0 a, C c 1e-9, 1 l, R s 1, 0 b, C d 1, R w 1000"
    bonds = "u -> i -> r, i -> a -> c, a -> l -> s, l -> b -> d, b -> w"
    ask = partial(_last, nodes, bonds, "d.e", stop, 1000.0, {"kind": "step"})
    return Case("ladder of rates 2e9 and 5e-1 1/s after 5000 s", "frequency", BY_MPMATH, ask, known, 1e-14)


def _long(periods: float) -> Case:
    """A free oscillation of 1 rad/s: cos t after a long time.

    In doubles the phase is known to eps * t; where that is more than 1e-10 it is found again in more bits.
    """
    stop = float(np.ceil(2 * np.pi * periods)) + 1.0

    def known() -> np.ndarray:
        with mpmath.workdps(60):
            return np.array([float(mpmath.cos(stop))])

    ask = partial(_last, RING, RING_BONDS, "m.f", stop, stop / 16, None, {"m": {"f": 1}})
    name = f"free oscillation after {periods:g} periods"
    return Case(name, "frequency", BY_MPMATH, ask, known, 1e-15 * stop if stop < 1e5 else 1e-15)


def _cancelling() -> Case:
    """A flow kicks two inertias, 20 orders of magnitude apart, and an oscillator beside them.

    The momentum that both share is L q0 w sin(w t), with L the two in parallel, q0 = L/(d + L) what passes
    into the oscillator at once, and w^2 = 1/(c (d + L)). Written in the flows of a and d the momentum of b is
    a difference without a digit; that these are the states hangs on the order of the nodes.
    """
    stop = 4e-4

    def known() -> np.ndarray:
        with mpmath.workdps(60):
            a, b, d, c = (mpmath.mpf(value) for value in ("1e-11", "5e9", "0.08", "5e-8"))
            L = a * b / (a + b)
            w = 1 / mpmath.sqrt(c * (d + L))
            return np.array([float(L * L / (d + L) * w * mpmath.sin(w * mpmath.mpf(stop)))])

    nodes = "0 q, Sf u, C c 1e-7, 1 j, I a 1e-11, 0 p, 0 n, I d 0.08, 0 r, I b 5e9, C k 1e-7"
    bonds = "p -> d, a -> n, j -> q, k -> r, j -> r, n -> j, q -> c, u -> n, j -> p, n -> b"
    ask = partial(_last, nodes, bonds, "b.p", stop, 1e-5, {"kind": "impulse"})
    name = "a momentum that is the difference of flows 20 orders of magnitude larger"
    return Case(name, "frequency", BY_MPMATH, ask, known, 1e-13)


def _growing() -> Case:
    def known() -> np.ndarray:
        with mpmath.workdps(60):
            return np.array([float(mpmath.exp(mpmath.mpf("0.5") * 1000))])

    nodes, bonds = "Se u, 1 j, I m 2, R b -1", "u -> j -> m, j -> b"
    ask = partial(_last, nodes, bonds, "m.f", 1000.0, 100.0, None, {"m": {"f": 1}})
    return Case("unstable motion grown by exp(500)", "frequency", BY_MPMATH, ask, known, 1e-12)


def _resonance() -> Case:
    """A ring driven at its own frequency from rest: f = t sin(t) / 2."""
    stop = 1000.0

    def known() -> np.ndarray:
        with mpmath.workdps(60):
            return np.array([float(stop * mpmath.sin(mpmath.mpf(stop)) / 2)])

    signal = {"kind": "sine", "amplitude": 1, "frequency": 1}
    ask = partial(_last, RING, RING_BONDS, "m.f", stop, 100.0, signal)
    return Case("undamped resonance for 1000 s", "frequency", BY_MPMATH, ask, known, 1e-12)


def _runaway() -> Case:
    nodes, bonds = "Se u, 1 j, I m 1, R b -1", "u -> j -> m, j -> b"
    ask = partial(_last, nodes, bonds, "m.f", 1000.0, 100.0, None, {"m": {"f": 1}})
    answer = Refusal("overflow|beyond double precision", "shorten|Shorten")
    return Case("unstable motion beyond the range of doubles", "frequency", "by hand: exp(1000)", ask, answer)


def _static() -> list[Case]:
    hidden_bonds = "u -> j -> r, j -> n -> la, n -> ca"
    short = "Sf u, 0 n, 1 b, I m 1, C c 1, R r 1"
    return [
        _over_frequency("a ring exactly at its pole", RING, RING_BONDS, "m.f", 1.0, complex(np.inf)),
        _over_frequency("a ring 1e-12 beside its pole", RING, RING_BONDS, "m.f", 1 + 1e-12, _ring(1 + 1e-12)),
        _over_frequency(
            "a ring one rounding beside its pole", RING, RING_BONDS, "m.q", 1 - 2**-53, _ring(1 - 2**-53, "q")
        ),
        _over_frequency("a ring at rest: its zero", RING, RING_BONDS, "m.f", 0.0, 0j),
        _over_frequency("a ring at rest: its compliance", RING, RING_BONDS, "m.q", 0.0, 1 + 0j),
        _over_frequency("an integrator at rest", "Se u, I m 2", "u -> m", "m.f", 0.0, complex(np.inf)),
        _over_frequency(
            "a branch that resonates exactly blocks",
            "Se u, 1 j, R r 1, 0 n, I l 1, C k 1",
            hidden_bonds.replace("la", "l").replace("ca", "k"),
            "r.f",
            1.0,
            0j,
        ),
        _over_frequency(
            "a branch that resonates exactly shorts",
            short,
            "u -> n -> b -> m, b -> c, n -> r",
            "u.e",
            1.0,
            0j,
        ),
        _over_frequency(
            "what a short resonating branch carries",
            short,
            "u -> n -> b -> m, b -> c, n -> r",
            "m.f",
            1.0,
            1 + 0j,
        ),
        _over_frequency(
            "an undamped response 1e150 rad/s high", RING, RING_BONDS, "m.f", 1e150, _ring(1e150)
        ),
    ]


def _sensitivity(name: str, resistance: str, known: dict[str, Any], source: str) -> Case:
    """Of s / (m s^2 + b s + 1/c) with m = c = 1."""
    nodes, bonds = f"Se u, 1 j, I m 1, R b {resistance}, C c 1", "u -> j -> m, j -> b, j -> c"
    group = "bond_graph/sensitivities/m.f/u"

    def ask() -> dict[str, Any]:
        result = run(graph(nodes, bonds, "m.f", results=["sensitivities"]))
        return {key: result.value(f"{group}/{key}") for key in known}

    return Case(name, "frequency", source, ask, known, 1e-15)


def _sensitivities() -> list[Case]:
    nothing = {"dc_gain_sensitivity": np.zeros(3), "high_frequency_gain_sensitivity": np.zeros(3)}
    never = {"pole_sensitivity": np.full((2, 3), complex(np.inf))}
    return [
        _sensitivity("sensitivity of a double pole", "2", never, "by hand: square-root branch"),
        _sensitivity("sensitivity of gains that vanish for all values", "2", nothing, "by hand: both are 0"),
        _sensitivity("sensitivity of gains beside a damping of 1e12", "1e12", nothing, "by hand: both are 0"),
    ]


def _cases() -> list[Case]:
    return [
        *_static(),
        _stiff(["1e9", "1e-3"]),
        _stiff(["1e12", "1e6", "1", "1e-6"]),
        _coupled(),
        _long(1e3),
        _long(1e6),
        _long(1e9),
        _cancelling(),
        _growing(),
        _runaway(),
        _resonance(),
        *_sensitivities(),
    ]


CASES = _cases()
