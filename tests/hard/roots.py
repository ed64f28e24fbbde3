"""Roots that nearly meet, meet, or lie many decades apart; read off graphs and off state equations."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import partial
from math import comb
from typing import Any

import numpy as np

from dynid.lti import roots as rational_roots
from dynid.lti import zeros_poles
from tests.hard.case import Case
from tests.hard.known import channel, exact, plus, times
from tests.hard.scenes import graph, run

BY_HAND = "by hand, roots by mpmath with 80 digits"
GAPS = ("1e-6", "1e-8", "1e-10", "1e-12")


def _channel(nodes: str, bonds: str, output: str, names: tuple[str, ...]) -> dict[str, Any]:
    result = run(graph(nodes, bonds, output, results=["transfer_function", "zeros", "poles", "hidden_modes"]))
    group, source = "bond_graph/transfer_function", nodes.split(",")[0].split()[1]
    return {name: result.value(f"{group}/{output}/{source}/{name}") for name in names}


def of_graph(
    name: str, nodes: str, bonds: str, output: str, known: Mapping[str, Any], source: str = BY_HAND
) -> Case:
    """Return a case of one channel: its first node is the input; all its numbers are correctly rounded."""
    ask = partial(_channel, nodes, bonds, output, tuple(known))
    return Case(name, "frequency", source, ask, known, 2.3e-16)


# --- nearly meeting ------------------------------------------------------------------------------


def _relaxing_pair(gap: str) -> Case:
    """1/(s + 1) + 1/(s + 1 + gap): the zero lies between the poles, half a gap from either."""
    other = 1 + exact(gap)
    nodes = f"Sf u, 1 j, 0 a, 0 b, C ca 1, R ra 1, C cb 1, R rb 1/{other.numerator}*{other.denominator}"
    known = channel([2, 1 + other], times([1, 1], [1, other]))
    bonds = "u -> j -> a -> ca, a -> ra, j -> b -> cb, b -> rb"
    return of_graph(f"poles {gap} apart, a zero between them", nodes, bonds, "u.e", known)


def _ringing_pair(gap: str) -> Case:
    """Two tanks of 1 and 1 + gap rad/s squared in series: a zero on the axis between the poles."""
    other = 1 + exact(gap)
    nodes = f"Sf u, 1 j, 0 a, 0 b, C ca 1, I la 1, C cb 1, I lb 1/{other.numerator}*{other.denominator}"
    known = channel([2, 0, 1 + other, 0], times([1, 0, 1], [1, 0, other]))
    bonds = "u -> j -> a -> ca, a -> la, j -> b -> cb, b -> lb"
    return of_graph(
        f"undamped poles {gap} apart in frequency squared, a zero between", nodes, bonds, "u.e", known
    )


def _beside(gap: str) -> Case:
    """A zero of an RC branch beside the pole of the other: R + 1/(s + 1), zero at -1 - 1/R."""
    resistance = 1 / exact(gap)
    known = channel([resistance, resistance + 1], [1, 1])
    nodes = f"Sf u, 1 j, R r {resistance}, 0 a, C c 1, R d 1"
    return of_graph(f"zero {gap} beside a pole", nodes, "u -> j -> r, j -> a -> c, a -> d", "u.e", known)


# --- meeting -------------------------------------------------------------------------------------


def _hidden(count: int) -> Case:
    """Equal branches in series: all but one of their modes are hidden, however many."""
    nodes, bonds = "Sf u, 1 j", "u -> j"
    for i in range(count):
        nodes += f", 0 n{i}, C c{i} 1/3, R r{i} 1/2"
        bonds += f", j -> n{i} -> c{i}, n{i} -> r{i}"
    name = f"{count} equal branches: a hidden mode of multiplicity {count - 1}"

    def ask() -> dict[str, Any]:
        result = run(graph(nodes, bonds, "u.e", results=["poles", "properties", "hidden_modes"]))
        return {
            "poles": result.value("bond_graph/transfer_function/u.e/u/poles"),
            "hidden_modes": result.value("bond_graph/properties/u.e/u/hidden_modes"),
            "dc_gain": result.value("bond_graph/properties/u.e/u/dc_gain"),
        }

    known = {"poles": np.array([-6 + 0j]), "hidden_modes": np.full(count - 1, -6 + 0j), "dc_gain": count / 2}
    return Case(name, "frequency", "by hand", ask, known, 2.3e-16)


def _jordan(size: int, engine: str) -> Case:
    """A Jordan block at -1/3 in coordinates of an integer, unimodular matrix: defective and full."""
    lower = np.array([[comb(i, j) for j in range(size)] for i in range(size)], dtype=object)
    inverse = np.array(
        [[(-1) ** (i + j) * comb(i, j) for j in range(size)] for i in range(size)], dtype=object
    )
    J = np.array(
        [
            [Fraction(-1, 3) if i == j else Fraction(int(j == i + 1)) for j in range(size)]
            for i in range(size)
        ],
        dtype=object,
    )
    A, B, C = lower @ J @ inverse, lower[:, -1:] * Fraction(1), inverse[:1] * Fraction(1)

    def ask() -> dict[str, Any]:
        found = zeros_poles(A.tolist(), B.tolist(), C.tolist(), [[0]], engine=engine)
        return {"poles": found.poles, "zeros": found.zeros, "order": found.relative_degree}

    known = {"poles": np.full(size, -1 / 3 + 0j), "zeros": np.zeros(0, dtype=complex), "order": size}
    name = f"defective pole of multiplicity {size}"
    return Case(name, "frequency", "by construction: a Jordan block", ask, known, 2.3e-16)


def _power(many: int) -> Case:
    """(s + 1/10)^m / (s + 1/7)^m, multiplied out."""

    def expanded(root: Fraction) -> list[Fraction]:
        return times(*[[1, root]] * many)

    above, below = expanded(Fraction(1, 10)), expanded(Fraction(1, 7))

    def ask() -> dict[str, Any]:
        found = rational_roots(above, below)
        return {"zeros": found.zeros, "poles": found.poles}

    known = {"zeros": np.full(many, -0.1 + 0j), "poles": np.full(many, -1 / 7 + 0j)}
    return Case(
        f"zero and pole of multiplicity {many}, multiplied out",
        "frequency",
        "by construction",
        ask,
        known,
        2.3e-16,
    )


# --- many decades --------------------------------------------------------------------------------


def _resonator(mass: str, damping: str, compliance: str) -> Case:
    m, b, c = map(exact, (mass, damping, compliance))
    known = channel([c, 0], [m * c, b * c, 1])
    name = f"resonator with I = {mass}, R = {damping}, C = {compliance}"
    return of_graph(
        name,
        f"Se u, 1 j, I m {mass}, R b {damping}, C c {compliance}",
        "u -> j -> m, j -> b, j -> c",
        "m.f",
        known,
    )


def _turned(kind: str, modulus: str) -> Case:
    """A mass behind a transformer (n^2 m) or a gyrator (m s / r^2 as an admittance) on a resistance of 1."""
    n = exact(modulus)
    # Seen from the source: 1 + n^2 s, or 1 + r^2 / s.
    known = channel([1], [n * n, 1]) if kind == "TF" else channel([1, 0], [1, n * n])
    return of_graph(
        f"{kind} of modulus {modulus}",
        f"Se u, 1 j, R b 1, {kind} t {modulus}, I m 1",
        "u -> j -> b, j -> t -> m",
        "b.f",
        known,
    )


# --- several domains, in SI units ----------------------------------------------------------------


def _transducer(name: str, L: str, R: str, r: str, m: str, b: str, k: str) -> Case:
    """Velocity by voltage of a coil on a mass: r s / ((L s + R)(m s^2 + b s + k) + r^2 s)."""
    electrical, mechanical = [exact(L), exact(R)], [exact(m), exact(b), exact(k)]
    known = channel([exact(r), 0], plus(times(electrical, mechanical), [exact(r) ** 2, 0]))
    nodes = f"Se u, 1 i, I L {L}, R R {R}, GY r {r}, 1 v, I m {m}, R b {b}, C k 1/({k})"
    bonds = "u -> i -> L, i -> R, i -> r -> v -> m, v -> b, v -> k"
    return of_graph(f"{name}: coil, magnet and mass", nodes, bonds, "m.f", known)


def _servo(name: str, R: str, C: str, A: str, m: str, d: str) -> Case:
    """Velocity by pressure of a ram behind a valve: A / ((R C s + 1)(m s + d) + R A^2)."""
    valve, load, area = [exact(R) * exact(C), 1], [exact(m), exact(d)], exact(A)
    known = channel([area], plus(times(valve, load), [exact(R) * area**2]))
    nodes = f"Se p, 1 q, R R {R}, 0 oil, C C {C}, TF ram 1/({A}), 1 v, I m {m}, R d {d}"
    bonds = "p -> q -> R, q -> oil -> C, oil -> ram -> v -> m, v -> d"
    return of_graph(f"{name}: valve, oil and load", nodes, bonds, "m.f", known)


def _piezo(name: str, C: str, R: str, n: str, m: str, b: str, k: str) -> Case:
    """Voltage by current: 1 / (C s + 1/R + s / (n^2 (m s^2 + b s + k)))."""
    c, r, modulus = exact(C), exact(R), exact(n)
    mechanical = [exact(m), exact(b), exact(k)]
    scaled = [modulus**2 * part for part in mechanical]
    known = channel([r * part for part in scaled], plus(times([c * r, 1], scaled), [r, 0]))
    nodes = f"Sf i, 0 e, C C {C}, R R {R}, TF n {n}, 1 v, I m {m}, R b {b}, C k 1/({k})"
    bonds = "i -> e -> C, e -> R, e -> n -> v -> m, v -> b, v -> k"
    return of_graph(f"{name}: charge, leak and mass", nodes, bonds, "R.e", known)


def _thermal() -> Case:
    """Chip, case and sink: heat capacities from 1e-6 to 1e4 J/K in a ladder of three."""
    capacities, resistances = ("1e-6", "0.3", "1e4"), ("1e-2", "0.5", "20")
    nodes, bonds, upper = "Sf q", "q -> t0", "t0"
    below: tuple[list[Fraction], list[Fraction]] = ([Fraction(0)], [Fraction(1)])
    for i, (c, r) in enumerate(zip(capacities, resistances, strict=True)):
        nodes += f", 0 t{i}, C c{i} {c}, 1 w{i}, R r{i} {r}"
        bonds += f", {upper} -> c{i}, t{i} -> w{i} -> r{i}"
        if i < 2:
            bonds, upper = bonds + f", w{i} -> t{i + 1}", f"t{i + 1}"
    for c, r in zip(reversed(capacities), reversed(resistances), strict=True):
        above, under = below
        lower = plus(above, times([exact(r)], under))  # r + Z
        below = lower, plus(under, times([exact(c), 0], lower))
    return of_graph("chip, case and sink, 1e-6 to 1e4 J/K", nodes, bonds, "t0.e", channel(*below))


# --- undamped, unstable, improper, vanishing -----------------------------------------------------


def _hair(damping: str, verdict: str) -> Case:
    real = -exact(damping) / 2  # the poles are a pair

    def ask() -> dict[str, Any]:
        result = run(
            graph(
                f"Se u, 1 j, I m 1, R b {damping}, C c 1",
                "u -> j -> m, j -> b, j -> c",
                "m.f",
                results=["poles", "properties"],
            )
        )
        found = result.value("bond_graph/transfer_function/m.f/u/poles")
        return {"stable": bool(result.value("bond_graph/properties/m.f/u/stable")), "real": found.real}

    known = {"stable": verdict == "stable", "real": np.full(2, float(real))}
    return Case(f"damping of {damping} beside 1: {verdict}", "frequency", "by hand", ask, known, 2.3e-16)


def _gains(
    name: str, nodes: str, bonds: str, output: str, known: Mapping[str, Any], source: str = "by hand"
) -> Case:
    channel_name = f"{output}/{nodes.split(',')[0].split()[1]}"

    def ask() -> dict[str, Any]:
        result = run(graph(nodes, bonds, output, results=["properties", "transfer_function"]))
        return {key: result.value(f"bond_graph/properties/{channel_name}/{key}") for key in known}

    return Case(name, "frequency", source, ask, known, 2.3e-16)


def _bridge(off: str) -> Case:
    """A Wheatstone bridge of ones, one of which is off: e / u = 1 / (2 + d) - 1 / 2."""
    d = exact(off)
    nodes = f"Se u, 0 top, 1 l1, 1 l2, 0 a, 0 b, R r1 1, R r2 1+({off}), R r3 1, R r4 1, 1 across, Sf open"
    bonds = "u -> top -> l1 -> r1, top -> l2 -> r2, l1 -> a -> r3, l2 -> b -> r4"
    bonds += ", a -> across -> b, open -> across"
    known = float(1 / (2 + d) - Fraction(1, 2))
    return _gains(f"Wheatstone bridge {off} off its balance", nodes, bonds, "open.e", {"dc_gain": known})


def _cases() -> list[Case]:
    cases = [make(gap) for make in (_relaxing_pair, _ringing_pair, _beside) for gap in GAPS]
    cases += [_hidden(count) for count in (2, 4, 9)]
    cases += [_jordan(size, "exact") for size in (2, 5, 8)] + [_power(many) for many in (3, 5, 8)]
    cases += [
        _resonator("1e-12", "1", "1e12"),
        _resonator("1e12", "1e-12", "1e-12"),
        _resonator("1e12", "1e12", "1e12"),
        _resonator("1e-12", "1e-12", "1e-12"),
        _resonator("1", "1e12", "1"),
        _resonator("1e-9", "1e6", "1e-12"),
    ]
    cases += [_turned(kind, modulus) for kind in ("TF", "GY") for modulus in ("1e-12", "1e12")]
    cases += [
        _transducer("DC motor", "1.5e-3", "0.8", "0.05", "3e-5", "1e-6", "0.2"),
        _transducer("MEMS gyroscope", "1e-6", "50", "2e-7", "1.3e-9", "4e-8", "5.1"),
        _transducer("shaker of 10 t", "0.02", "0.4", "120", "1e4", "1e3", "4e8"),
        _servo("press", "2.1e11", "3e-13", "0.8", "6e4", "2e5"),
        _servo("micro valve", "4e13", "1e-18", "1e-7", "2e-6", "1e-5"),
        _piezo("piezo stack", "3e-6", "1e7", "0.05", "0.4", "90", "2.4e8"),
        _piezo("quartz", "3e-12", "1e10", "1e3", "1e-6", "3e-3", "1.1e9"),
        _thermal(),
    ]
    cases += [
        _hair("1e-12", "stable"),
        _hair("-1e-12", "unstable"),
        _hair("1e-300", "stable"),
        _hair("0", "marginal"),
    ]
    nothing = {"relative_degree": -1.0, "dc_gain": 0.0, "high_frequency_gain": np.inf}
    cases += [
        _gains("compliance on an ideal effort: improper", "Se u, C c 1e-9", "u -> c", "c.f", nothing),
        _gains("inertia on an ideal flow: improper", "Sf u, I m 1e9", "u -> m", "m.e", nothing),
        _gains(
            "improper beside a pole",
            "Sf u, 1 j, I m 3, 0 k, C c 1/2, R r 4",
            "u -> j -> m, j -> k -> c, k -> r",
            "u.e",
            {"relative_degree": -1.0, "dc_gain": 4.0, "high_frequency_gain": np.inf},
        ),
        _bridge("0"),
        _bridge("1e-12"),
        _bridge("-1e-300"),
    ]
    near = "Se u, 1 a, R r {0}, 0 b, R s 1, 1 d, R t {0}, 0 e, R w 1"
    far = "u -> a -> r, a -> b -> s, b -> d -> t, d -> e -> w"
    for value in ("1e-300", "1e-12", "1e12", "1e300"):
        r = exact(value)
        gain = float(1 / (r * r + 3 * r + 1))
        name = f"algebraic divider with R = {value}"
        cases.append(_gains(name, near.format(value), far, "w.e", {"dc_gain": gain, "relative_degree": 0.0}))
    cases += [
        _gains(
            "algebraic loop through resistances of 1 and -1 + 1e-12",
            "Se u, 1 j, R a 1, R b -1+1e-12",
            "u -> j -> a, j -> b",
            "a.f",
            {"dc_gain": 1e12},
        ),
        _gains(
            "resistances of exactly 0", near.format("0"), far, "w.e", {"dc_gain": 1.0, "relative_degree": 0.0}
        ),
    ]
    return cases


CASES = _cases()
