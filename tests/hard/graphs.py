"""Graphs whose driven junction lies on a loop, and graphs without a solution."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from tests.hard.case import Case, Refusal
from tests.hard.scenes import graph, run

NODES = "by hand: node equations without the driving source"


def _natural_modes(nodes: str, bonds: str) -> dict[str, Any]:
    result = run(graph(nodes, bonds, "F.e", results=["poles", "prototype"], port="F -> a"))
    return {"poles": result.value("bond_graph/port/natural_modes")}


def _bridge(p: float, q: float, w: float, C: float, L: float) -> Case:
    """A bridge of three resistances, a compliance and an inertia, driven at the junction of two arms.

    Without the source p and q are in series, parallel to w: a conductance g between C and L.
    """
    g = 1 / (p + q) + 1 / w
    nodes = f"Sf F, 0 a, 1 p, 1 q, 0 b, 0 d, 1 w, R Rp {p}, R Rq {q}, R Rw {w}, C Cb {C}, I Ld {L}"
    bonds = "F -> a, a -> p -> b, a -> q -> d, b -> w -> d, p -> Rp, q -> Rq, w -> Rw, b -> Cb, d -> Ld"
    known = {"poles": np.roots([C * g * L, C, g]).astype(complex)}
    name = f"natural modes of a bridge of {p:g}, {q:g} and {w:g}"
    return Case(name, "frequency", NODES, partial(_natural_modes, nodes, bonds), known, 1e-14)


def _ring(junctions: int) -> Case:
    """A ring of equal cells, each with a compliance of 0.5 and a resistance of 4 to ground, 3 between two.

    The eigenvalues of the ring's Laplacian are 2 - 2 cos(2 π k / n).
    """
    names = [chr(ord("a") + k) for k in range(junctions)]
    nodes, bonds = "Sf F", "F -> a"
    for k, name in enumerate(names):
        nodes += f", 0 {name}, C C{name} 0.5, R R{name} 4, 1 x{k}, R S{k} 3"
        bonds += f", {name} -> C{name}, {name} -> R{name}"
        bonds += f", {name} -> x{k} -> {names[(k + 1) % junctions]}, x{k} -> S{k}"
    laplacian = 2 - 2 * np.cos(2 * np.pi * np.arange(junctions) / junctions)
    known = {"poles": (-(1 / 4 + laplacian / 3) / 0.5).astype(complex)}
    ask = partial(_natural_modes, nodes, bonds)
    return Case(f"natural modes of a ring of {junctions}", "frequency", NODES, ask, known, 1e-14)


def _refused(name: str, nodes: str, bonds: str, output: str, says: str) -> Case:
    ask = partial(run, graph(nodes, bonds, output))
    return Case(name, "frequency", "by hand: the equations have no solution", ask, Refusal(says))


CASES = [
    _bridge(2, 3, 5, 0.1, 0.7),
    _bridge(1e6, 1, 1e-3, 1e-9, 1e3),
    _ring(3),
    _ring(6),
    _refused(
        "two efforts prescribed on one junction",
        "Se u, Se v, 0 j, R r 2, C c 1",
        "u -> j -> r, v -> j -> c",
        "r.f",
        "'j'",
    ),
    _refused(
        "two flows prescribed in a part that no output needs",
        "Se u, 0 j, R r 2, 0 k, Sf v, Sf w, 1 s, C c 1",
        "u -> j -> r, j -> k, k -> s -> c, v -> s, w -> s",
        "r.f",
        "'s'",
    ),
    _refused(
        "an effort through transformers of 2 and 3 at once",
        "Se u, 0 j, TF a 2, TF b 3, 0 k, R r 1",
        "u -> j -> a -> k -> r, j -> b -> k",
        "r.f",
        ".",
    ),
]
