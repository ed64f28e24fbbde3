"""Zeros and poles of a mesh: junction structures with many loops, on which polynomials grow."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from itertools import count
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.roots import distance
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.plan import ReducedGraph
from dynid.defaults import EXACT_ROOTS, EXACT_ROOTS_ON_LOOPS, MANY_LOOPS


def _mesh(side: int) -> ReducedGraph:
    """Return a square mesh of capacitors to ground, joined by coils with losses: (side - 1)^2 loops."""
    nodes, bonds, number = [Node("u", "Sf")], [Bond("u", "p0_0")], count(1)
    for row in range(side):
        for column in range(side):
            here = f"p{row}_{column}"
            nodes += [Node(here, "0"), Node(f"c{here}", "C", Fraction(next(number), 97))]
            bonds.append(Bond(here, f"c{here}"))
            for there, inside in ((f"p{row + 1}_{column}", row), (f"p{row}_{column + 1}", column)):
                if inside + 1 < side:
                    link = f"{here}{there}"
                    nodes += [Node(link, "1"), Node(f"i{link}", "I", Fraction(next(number), 89))]
                    nodes.append(Node(f"r{link}", "R", Fraction(next(number), 83)))
                    ends = (here, link, there)
                    bonds += [
                        Bond(*ends[:2]),
                        Bond(*ends[1:]),
                        Bond(link, f"i{link}"),
                        Bond(link, f"r{link}"),
                    ]
    far = f"p{side - 1}_{side - 1}"
    return ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port(far, "e")], traced=False)


def _exact(side: int) -> Callable[[], Any]:
    from dynid.bondgraph.exact_engine import ExactEngine

    return lambda: _roots(ExactEngine(graph := _mesh(side)), graph)


def _float(side: int) -> Callable[[], Any]:
    from dynid.bondgraph.floating.engine import FloatEngine

    return lambda: _roots(FloatEngine(graph := _mesh(side)), graph)


def _roots(engine: Any, graph: ReducedGraph) -> tuple[Any, Any]:
    from dynid.lti.certified_roots import repeated

    transfer = engine.channel(next(iter(graph.channels())))
    return repeated(transfer.zeros), repeated(transfer.poles)


@lru_cache(maxsize=2)
def _reference(side: int) -> tuple[Any, Any]:
    zeros, poles = _exact(side)()
    return zeros, poles


def _error(side: int, found: Any) -> float:
    zeros, poles = _reference(side)
    size = float(abs(poles).max())
    return max(distance(got, true, size) for got, true in zip(found, (zeros, poles), strict=True))


def _default(side: int) -> str:
    """Return what is chosen for a mesh of this side."""
    looped = (side - 1) ** 2 > MANY_LOOPS.value
    limit = EXACT_ROOTS_ON_LOOPS if looped else EXACT_ROOTS
    return "exact" if 3 * side**2 - 2 * side <= limit.value else "float"


BENCHMARK = Benchmark(
    title="Zeros and poles of a square mesh with (side - 1)^2 loops and 3 side^2 - 2 side storages",
    size="side",
    sizes=(3, 4),
    alternatives=(Alternative("exact", _exact, most=7), Alternative("float", _float)),
    error=_error,
    measure="largest relative distance from the exact roots; inf: a wrong count",
    default=_default,
    full=(5, 6),
)
