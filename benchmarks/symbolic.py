"""Symbolic transfer functions of a chain against the same elimination written in flint polynomials.

A chain of N mass-spring-damper stages, force in at the first mass, velocity out at the last, the last
spring and damper to ground, every symbol distinct. Expanded: the house's program on polynomials against the
recursion below, by hand. Nested: from the graph to the program's text.

Run with `python benchmarks/symbolic.py [SIZE]...`; each figure is the least of several runs, in one go.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from fractions import Fraction
from time import perf_counter
from typing import Any

from flint import fmpz_mpoly_ctx

from dynid.bondgraph.formula import expanded, nested
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.reduced import ReducedGraph

SIZES, NESTED, RUNS = (4, 6, 8), (50, 200), 9


def chain(stages: int) -> ReducedGraph:
    """Return the chain, reduced."""
    nodes, bonds = [Node("F", "Se")], [Bond("F", "v1")]
    for k in range(1, stages + 1):
        nodes += [Node(f"v{k}", "1"), Node(f"e{k}", "0"), Node(f"w{k}", "1")]
        nodes += [Node(f"m{k}", "I", Fraction(k)), Node(f"b{k}", "R", Fraction(k + 1, 3))]
        nodes += [Node(f"c{k}", "C", Fraction(2, k + 5))]
        bonds += [Bond(f"v{k}", f"m{k}"), Bond(f"v{k}", f"e{k}"), Bond(f"e{k}", f"w{k}")]
        bonds += [Bond(f"w{k}", f"b{k}"), Bond(f"w{k}", f"c{k}")]
        if k < stages:
            bonds += [Bond(f"e{k}", f"v{k + 1}")]
    return ReducedGraph(BondGraph(nodes, bonds), ["F"], [Port(f"m{stages}", "f")])


def by_hand(stages: int) -> tuple[Any, Any]:
    """Return numerator and denominator by Z_k = s m_k + 1/(1/(b_k + 1/(s c_k)) + 1/Z_(k+1))."""
    names = [f"{letter}{k}" for k in range(1, stages + 1) for letter in "mbc"]
    ring = fmpz_mpoly_ctx.get(["s", *names], "lex")
    s, *symbols = ring.gens()
    numerator, above, below = ring.constant(1), None, None
    for k in reversed(range(stages)):
        m, b, c = symbols[3 * k : 3 * k + 3]
        branch = s * b * c + 1  # Z_b = branch / (s c)
        if above is None:
            above, below = s * m * (s * c) + branch, s * c
            numerator = numerator * s * c
        else:
            below = s * c * above + branch * below
            above = s * m * below + branch * above
            numerator = numerator * branch
    return numerator, above


def as_program(stages: int) -> str:
    """Return the program's text, from the graph on."""
    graph = chain(stages)
    return nested(graph, graph.channels().values())


def least(work: Callable[[], object]) -> float:
    """Return the least wall time of several runs."""
    times = []
    for _ in range(RUNS):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def main() -> None:
    """Print the figures."""
    print("expanded      terms   by hand       house   ratio")
    for size in [int(word) for word in sys.argv[1:]] or SIZES:
        graph = chain(size)
        ((numerator, denominator),) = expanded(graph, 10**7).values()
        hand_numerator, hand_denominator = by_hand(size)
        assert (len(numerator), len(denominator)) == (len(hand_numerator), len(hand_denominator))
        hand = least(lambda size=size: by_hand(size))
        house = least(lambda graph=graph: expanded(graph, 10**7))
        times = f"{hand * 1e3:>7.2f} ms {house * 1e3:>8.2f} ms {house / hand:>7.2f}"
        print(f"N = {size:<4} {len(denominator):>9,} {times}")
    print("\nnested     assignments   graph to text")
    for size in NESTED:
        count = len(as_program(size).splitlines())
        print(f"N = {size:<4} {count:>12} {least(lambda size=size: as_program(size)) * 1e3:>10.0f} ms")


if __name__ == "__main__":
    main()
