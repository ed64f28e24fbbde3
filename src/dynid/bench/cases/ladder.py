"""Frequency response of a ladder with a loop at every rung, where bounds on rounding errors could add up.

On each rail masses (0-junctions with a C, by the mobility analogy) are joined by an I and an R; a rung joins
the rails at every stage by an R and an I. The flow enters at one end, the effort is read at the other.
"""

from __future__ import annotations

from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.frequency_response import by_reduction, distance, frequencies
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.reduced_graph import ReducedGraph

_RAILS = "ab"


def _value(kind: str, index: int) -> Fraction:
    """Return a value between 1 and 1.5 of its unit: mF of a C, 1 of an I and an R."""
    return (1 + Fraction(index * 7919 % 1000, 2000)) * (Fraction(1, 1000) if kind == "C" else 1)


def _links(stages: int) -> list[tuple[str, str, Fraction, Fraction]]:
    """Return the ends, inertia and resistance of all links of rails and rungs."""
    ends = [(f"{rail}{k}", f"{rail}{k + 1}") for k in range(1, stages) for rail in _RAILS]
    ends += [(f"a{k}", f"b{k}") for k in range(1, stages + 1)]
    return [(*pair, _value("I", 2 * n + 1), _value("R", 2 * n + 2)) for n, pair in enumerate(ends)]


def reduced(stages: int) -> ReducedGraph:
    """Return a ladder, planned."""
    nodes, bonds = [Node("u", "Sf")], [Bond("u", "a1")]
    for index, (rail, k) in enumerate((rail, k) for k in range(1, stages + 1) for rail in _RAILS):
        nodes += [Node(f"{rail}{k}", "0"), Node(f"C{rail}{k}", "C", _value("C", index))]
        bonds.append(Bond(f"{rail}{k}", f"C{rail}{k}"))
    for tail, head, inertia, resistance in _links(stages):
        link = f"{tail}{head}"
        nodes += [Node(link, "1"), Node(f"I{link}", "I", inertia), Node(f"R{link}", "R", resistance)]
        bonds += [Bond(tail, link), Bond(link, head), Bond(link, f"I{link}"), Bond(link, f"R{link}")]
    return ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port(f"b{stages}", "e")], traced=False)


def nodal(stages: int) -> tuple[Any, Any, Any, Any]:
    """Return compliances, the sparse incidence of links at rail nodes, inertias and resistances."""
    from scipy.sparse import csc_array

    places = {f"{rail}{k + 1}": 2 * k + side for k in range(stages) for side, rail in enumerate(_RAILS)}
    tails, heads, inertias, resistances = zip(*_links(stages), strict=True)
    count = len(tails)
    rows = [places[end] for end in (*tails, *heads)]
    signs, columns = np.repeat([1.0, -1.0], count), [*range(count), *range(count)]
    incidence = csc_array((signs, (rows, columns)), shape=(2 * stages, count))
    compliances = [float(_value("C", index)) for index in range(2 * stages)]
    return np.array(compliances), incidence, np.array(inertias, float), np.array(resistances, float)


def exact_response(stages: int, omega: Any) -> list[complex]:
    """Return the response in 60 digits and more, rung by rung: two rails are 2 x 2 blocks in a row."""
    from flint import acb, acb_mat, arb, ctx, fmpq

    def ball(value: Fraction) -> Any:
        return acb(arb(fmpq(value.numerator, value.denominator)))

    values = []
    with ctx.workprec(400 + 20 * stages):
        laws = [(ball(inertia), ball(resistance)) for _, _, inertia, resistance in _links(stages)]
        stores = [ball(_value("C", index)) for index in range(2 * stages)]
        for w in omega:
            s = acb(0, float(w))
            passes = [1 / (s * inertia + resistance) for inertia, resistance in laws]
            rungs = passes[2 * (stages - 1) :]
            drive, seen = acb_mat([[1], [0]]), acb_mat([[0, 0], [0, 0]])
            for k in range(stages):
                rung, (first, second) = rungs[k], (s * store for store in stores[2 * k : 2 * k + 2])
                seen += acb_mat([[first + rung, -rung], [-rung, second + rung]])
                if k + 1 == stages:
                    break
                across = acb_mat([[passes[2 * k], 0], [0, passes[2 * k + 1]]])
                ahead = across * (seen + across).inv()  # the part of the flow that passes on
                drive, seen = ahead * drive, ahead * seen
            effort = (seen.inv() * drive)[1, 0]
            values.append(complex(float(effort.real.mid()), float(effort.imag.mid())))
    return values


def _in_order(stages: int) -> Any:
    """Run the first plan alone, from the far end; values that its bounds do not certify by balls."""
    from dynid.bondgraph.graph_response import on_axis

    planned = reduced(stages)
    return on_axis(planned, list(planned.channels().values()), frequencies())[:, 0]


def _nodal(admittances: Any) -> Any:
    """Factorise the nodal admittances at every frequency, sparse."""
    from scipy.sparse import csc_array, dia_array
    from scipy.sparse.linalg import splu

    stores, incidence, inertias, resistances = admittances
    flow = np.zeros(len(stores), dtype=complex)
    flow[0] = 1.0

    def diagonal(values: Any) -> Any:
        return dia_array((values[None], [0]), shape=(len(values), len(values)))

    def solve(s: complex) -> complex:
        passes = diagonal(1 / (s * inertias + resistances))
        matrix = diagonal(s * stores) + incidence @ passes @ incidence.T
        return complex(splu(csc_array(matrix)).solve(flow)[-1])

    return np.array([solve(1j * w) for w in frequencies()])


BENCHMARK = Benchmark(
    title="Frequency response of a ladder of two rails at 1,000 frequencies, from the model on",
    size="stages",
    sizes=(100, 200),
    alternatives=(
        Alternative("reduction", by_reduction(reduced)),
        Alternative("in-order", _in_order, max_size=10),
        Alternative("sparse-nodal", _nodal, nodal, max_size=1000, peer=True),
    ),
    error=lambda stages, response: distance(response, partial(exact_response, stages), count=7),
    default=lambda _: "reduction",
    full=(10, 500, 1000, 2000),
)
