"""Long ladders, whose zeros, poles and responses are known in closed form."""

from __future__ import annotations

from functools import partial
from typing import Any

import mpmath
import numpy as np

from tests.hard.case import Case
from tests.hard.known import chain_poles
from tests.hard.scenes import graph, run

K, B = 1000, 0.2
SOURCE = "closed form: eigenvalues of a tridiagonal Toeplitz matrix"
RECURSION = "continued fraction, mpmath with 40 digits"


def chain(stages: int, damping: float = B, stiffness: float = K) -> tuple[str, str]:
    """Write a chain of unit masses, the last one tied to ground, driven at the first."""
    nodes, bonds = "Se F", "F -> v1"
    for i in range(1, stages + 1):
        nodes += f", 1 v{i}, I m{i} 1, 0 z{i}, 1 l{i}, C k{i} 1/{stiffness}"
        bonds += f", v{i} -> m{i}, v{i} -> z{i} -> l{i} -> k{i}"
        if damping:
            nodes, bonds = nodes + f", R b{i} {damping}", bonds + f", l{i} -> b{i}"
        if i < stages:
            bonds += f", z{i} -> v{i + 1}"
    return nodes, bonds


def _of(scene: dict[str, Any], output: str, *names: str) -> dict[str, Any]:
    result = run(scene)
    return {name: result.value(f"bond_graph/transfer_function/{output}/F/{name}") for name in names}


def _roots(stages: int, damping: float) -> dict[str, Any]:
    return _of(graph(*chain(stages, damping), "v1.f", results=["zeros", "poles"]), "v1.f", "zeros", "poles")


def _known_roots(stages: int, damping: float) -> dict[str, np.ndarray]:
    """With the first mass held what is left is a chain of one mass less, held at both ends."""
    zeros = chain_poles(stages - 1, K, damping, fixed=True)
    return {"zeros": np.append(zeros, 0.0), "poles": chain_poles(stages, K, damping)}


def _far_zeros(stages: int) -> dict[str, Any]:
    return _of(graph(*chain(stages), f"v{stages}.f", results=["zeros"]), f"v{stages}.f", "zeros")


def _known_far_zeros(stages: int) -> dict[str, np.ndarray]:
    return {"zeros": np.array([0.0] + [-K / B] * (stages - 1), dtype=complex)}


def _response(stages: int, damping: float, output: str, start: float, stop: float, points: int) -> np.ndarray:
    grid = {"start": start, "stop": stop, "points": points, "scale": "linear"}
    scene = graph(*chain(stages, damping), output, results=["frequency_response"], frequency=grid)
    return run(scene).value("bond_graph/frequency_response/response")[:, 0, 0]


def _static(stages: int) -> np.ndarray:
    return _response(stages, B, "v1.q", 0.0, 1.0, 2)[:1]


def _known_response(stages: int, damping: float, start: float, stop: float, points: int) -> np.ndarray:
    with mpmath.workdps(40):
        found = []
        for omega in np.linspace(start, stop, points):
            s, impedance = mpmath.mpc(0, float(omega)), mpmath.inf
            for _ in range(stages):
                link = mpmath.mpf(str(damping)) + K / s
                behind = link if impedance == mpmath.inf else link * impedance / (link + impedance)
                impedance = s + behind
            found.append(complex(1 / impedance))
    return np.array(found)


def _large_at_a_pole(stages: int, output: str) -> np.ndarray:
    """Of a chain of 3 i - 2 unit masses and springs 1 rad/s is a natural frequency."""
    grid = {"start": 1, "stop": 1, "points": 1, "scale": "linear"}
    scene = graph(*chain(stages, 0, 1), output, results=["frequency_response"], frequency=grid)
    return run(scene).value("bond_graph/frequency_response/response")[:, 0, 0]


def _cases() -> list[Case]:
    cases = []
    for stages in (50, 100, 200, 500):
        slow = stages > 50
        for damping, words in ((B, "a damped"), (0, "an undamped")):
            ask, known = partial(_roots, stages, damping), partial(_known_roots, stages, damping)
            name = f"zeros and poles of {words} ladder of {stages} stages"
            cases.append(Case(name, "frequency", SOURCE, ask, known, 1e-10, slow=slow))
        name = f"zero of multiplicity {stages - 1} of a ladder of {stages} stages"
        ask = partial(_far_zeros, stages)
        cases.append(
            Case(
                name,
                "frequency",
                "by hand: (b s + k)^(N-1)",
                ask,
                partial(_known_far_zeros, stages),
                1e-10,
                slow=slow,
            )
        )
        grid = (0.1, 60.0, 7)
        ask, known = (
            partial(_response, stages, B, "v1.f", *grid),
            partial(_known_response, stages, B, *grid),
        )
        name = f"frequency response of a ladder of {stages} stages"
        cases.append(Case(name, "frequency", RECURSION, ask, known, 1e-12, slow=stages > 50))
        ask = partial(_static, stages)
        name = f"static response of a ladder of {stages} stages, whose storage elements block at 0 rad/s"
        compliance = np.array([stages / K], dtype=complex)
        source = "by hand: springs in series"
        cases.append(Case(name, "frequency", source, ask, compliance, 1e-15, slow=stages > 200))
    for stages in (3, 5, 9):
        name = f"zero of multiplicity {stages - 1} of a ladder of {stages} stages"
        ask = partial(_far_zeros, stages)
        known = partial(_known_far_zeros, stages)
        cases.append(Case(name, "frequency", "by hand: (b s + k)^(N-1)", ask, known, 1e-15))
    for stages in (100, 1000):
        ask = partial(_large_at_a_pole, stages, "v1.f")
        name = f"an undamped ladder of {stages} stages exactly at a natural frequency"
        cases.append(Case(name, "frequency", SOURCE, ask, np.array([complex(np.inf)]), slow=stages > 100))
    return cases


CASES = _cases()
