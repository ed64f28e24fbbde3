"""Frequency responses of a chain, a random tree and a ladder at 1,000 frequencies, from the model.

The ladder has a loop at every rung, where bounds on rounding errors could add up. On each rail masses
(0-junctions with a C, by the mobility analogy) are joined by an I and an R; a rung joins the rails at every
stage by an R and an I. The flow enters at one end, the effort is read at the other.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.chain import exact_response, matrices, reduced
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.templates.chain import distinct

_LINES = 1000
#: Errors of smaller responses, which are next to the least doubles, are relative to this.
_MIN_BENCH_RESPONSE = 1e-280


def frequencies() -> Any:
    """Return the angular frequencies of the responses, rad/s."""
    return np.geomspace(0.1, 60.0, _LINES)


def _by_reduction(model: Callable[[int], ReducedGraph]) -> Callable[[int], Any]:
    """Return the response of the one channel of a model by its reduction, as dynid does it by default."""

    def work(size: int) -> Any:
        from dynid.bondgraph.graph_response import frequency_response

        return frequency_response(model(size), frequencies())[:, 0, 0]

    return work


def _compiled(stages: int) -> Any:
    """Run the reduction compiled, in doubled precision; long reductions are compiled by default."""
    from dynid.bondgraph.program.frequency_sweep import sweep_frequencies

    planned = reduced(stages)
    registers = list(planned.channels().values())
    return sweep_frequencies(planned.program, registers, planned.graph.value, frequencies())[0][:, 0]


def _solved(system: Any) -> Any:
    """Solve sE - A at every frequency, dense."""
    A, B, C, _ = system
    unit = np.eye(len(A))
    return np.array([(C @ np.linalg.solve(1j * w * unit - A, B))[0, 0] for w in frequencies()])


def _sparse(system: Any) -> Any:
    """Factorise sE - A at every frequency, sparse."""
    from scipy.sparse import csc_array, eye_array
    from scipy.sparse.linalg import splu

    A, B, C, _ = system
    state, force = csc_array(A, dtype=complex), B[:, 0].astype(complex)
    unit = eye_array(len(A), dtype=complex, format="csc")
    return np.array([C[0] @ splu(csc_array(1j * w * unit - state)).solve(force) for w in frequencies()])


def _matrices_of_masses(stages: int) -> Any:
    """Return mass, damping and stiffness of the displacements, sparse."""
    from scipy.sparse import csc_array

    m, k, b = (np.array([complex(stage[column]) for stage in distinct(stages)]) for column in range(3))
    joints = np.eye(stages) - np.eye(stages, k=1)  # elongations by displacements
    return csc_array(np.diag(m)), csc_array(joints.T * b @ joints), csc_array(joints.T * k @ joints)


def _nodal(matrices_of_masses: Any) -> Any:
    """Factorise the masses' impedances at every frequency, sparse."""
    from scipy.sparse.linalg import splu

    M, B, K = matrices_of_masses
    force = np.zeros(M.shape[0], dtype=complex)
    force[0] = 1.0
    return np.array([splu(1j * w * M + B + K / (1j * w)).solve(force)[-1] for w in frequencies()])


def _recursion(rows: Any) -> Any:
    """Move the Thévenin equivalent of what lies before a mass from mass to mass, at all frequencies."""
    s = 1j * frequencies()
    force, seen = np.ones_like(s), np.zeros_like(s)
    for m, k, b in rows[:-1]:
        joint = k / s + b
        seen = seen + s * m
        share = joint / (seen + joint)
        force, seen = force * share, seen * share
    m, k, b = rows[-1]
    return force / (seen + s * m + k / s + b)


def _control(stages: int) -> Any:
    import control

    return control.ss(*matrices(stages))(1j * frequencies())


def _polynomials(stages: int) -> Any:
    """Evaluate the transfer function that SciPy computes from the state equations (`ss2tf`)."""
    from scipy.signal import ss2tf

    numerator, denominator = ss2tf(*matrices(stages))
    with np.errstate(all="ignore"):
        return np.polyval(numerator[0], 1j * frequencies()) / np.polyval(denominator, 1j * frequencies())


def distance(response: Any, exact: Callable[[Any], list[complex]], count: int = 25) -> float:
    """Return the largest relative error of a response at `count` of its frequencies."""
    places = np.linspace(0, _LINES - 1, count).astype(int)
    true = np.array(exact(frequencies()[places]))
    with np.errstate(all="ignore"):
        errors = np.abs(response[places] - true) / np.maximum(np.abs(true), _MIN_BENCH_RESPONSE)
        return float(np.nan_to_num(np.max(errors), nan=np.inf))


BENCHMARK = Benchmark(
    title="Frequency response of a chain at 1,000 frequencies, from the model on",
    size="stages",
    sizes=(10, 100, 1000, 2000),
    alternatives=(
        Alternative("reduction", _by_reduction(reduced)),
        Alternative("reduction-compiled", _compiled, max_size=100),
        Alternative(
            "recursion",
            _recursion,
            lambda stages: [tuple(map(float, stage)) for stage in distinct(stages)],
            peer=True,
        ),
        Alternative("state-space", _solved, matrices, max_size=10, peer=True),
        Alternative("sparse-lu", _sparse, matrices, max_size=1000, peer=True),
        Alternative("sparse-nodal", _nodal, _matrices_of_masses, max_size=1000, peer=True),
        Alternative("polynomials", _polynomials, max_size=100, peer=True),
        Alternative("control", _control, needs=("control",), max_size=10, peer=True),
    ),
    error=lambda stages, response: distance(
        response, partial(exact_response, stages), 25 if stages <= 1000 else 5
    ),
    default=lambda _: "reduction",
    full=(4000, 10_000),
)


def _branches(junctions: int) -> list[tuple[int, str, str, Fraction, Fraction]]:
    """Return parent, kind, type of the storage, its value and a resistance of every junction of a tree."""
    draw = random.Random(junctions)

    def value() -> Fraction:
        return Fraction(draw.randrange(500, 1500), 1000)

    return [
        (draw.randrange(max(k, 1)), draw.choice("01"), draw.choice("IC"), value(), value())
        for k in range(junctions)
    ]


def tree(junctions: int) -> ReducedGraph:
    """Return a random tree of junctions, each with a storage and a resistor, planned."""
    nodes, bonds = (
        [Node("u", "Sf"), Node("j", "0"), Node("c", "C", Fraction(1))],
        [Bond("u", "j"), Bond("j", "c")],
    )
    for k, (parent, kind, storage, value, resistance) in enumerate(_branches(junctions)):
        nodes += [
            Node(f"j{k}", "0" if kind == "0" else "1"),
            Node(f"s{k}", "I" if storage == "I" else "C", value),
        ]
        nodes.append(Node(f"r{k}", "R", resistance))
        bonds += [Bond(f"j{parent}" if k else "j", f"j{k}"), Bond(f"j{k}", f"s{k}"), Bond(f"j{k}", f"r{k}")]
    return ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port("j", "e")], traced=False)


def _leaves_inward(junctions: int, s: Any, number: Callable[[Fraction], Any] = float) -> Any:
    """Return the effort at the root for a unit flow: impedances combined from the leaves inward."""
    rows = _branches(junctions)
    immittances: list[Any] = []  # the impedance of a 1-junction, the admittance of a 0-junction
    for _, kind, storage, value, resistance in rows:
        law = s * number(value)
        impedances = law if storage == "I" else 1 / law, number(resistance)
        immittances.append(sum(z if kind == "1" else 1 / z for z in impedances))
    root = s
    for k in range(junctions - 1, -1, -1):
        parent, kind = rows[k][:2]
        above = rows[parent][1] if k else "0"
        seen = immittances[k] if kind == above else 1 / immittances[k]
        if k:
            immittances[parent] = immittances[parent] + seen
        else:
            root = root + seen
    return 1 / root


def _exact_tree(junctions: int, omega: Any) -> list[complex]:
    """Return the same in 400 bits."""
    from flint import acb, arb, ctx, fmpq

    def ball(value: Fraction) -> Any:
        return acb(arb(fmpq(value.numerator, value.denominator)))

    with ctx.workprec(400):
        return [complex(_leaves_inward(junctions, acb(0, float(w)), ball).mid()) for w in omega]


TREE = Benchmark(
    title="Frequency response of a random tree at 1,000 frequencies, from the model on",
    size="junctions",
    sizes=(100, 1000),
    alternatives=(
        Alternative("reduction", _by_reduction(tree)),
        Alternative(
            "leaves-inward", lambda junctions: _leaves_inward(junctions, 1j * frequencies()), peer=True
        ),
    ),
    error=lambda junctions, response: distance(response, partial(_exact_tree, junctions), count=5),
    default=lambda _: "reduction",
    full=(10_000, 100_000),
)


_RAILS = "ab"


def _ladder_value(kind: str, index: int) -> Fraction:
    """Return a value between 1 and 1.5 of its unit: mF of a C, 1 of an I and an R."""
    return (1 + Fraction(index * 7919 % 1000, 2000)) * (Fraction(1, 1000) if kind == "C" else 1)


def _ladder_links(stages: int) -> list[tuple[str, str, Fraction, Fraction]]:
    """Return the ends, inertia and resistance of all links of rails and rungs."""
    ends = [(f"{rail}{k}", f"{rail}{k + 1}") for k in range(1, stages) for rail in _RAILS]
    ends += [(f"a{k}", f"b{k}") for k in range(1, stages + 1)]
    return [
        (*pair, _ladder_value("I", 2 * n + 1), _ladder_value("R", 2 * n + 2)) for n, pair in enumerate(ends)
    ]


def ladder(stages: int) -> ReducedGraph:
    """Return a ladder, planned."""
    nodes, bonds = [Node("u", "Sf")], [Bond("u", "a1")]
    for index, (rail, k) in enumerate((rail, k) for k in range(1, stages + 1) for rail in _RAILS):
        nodes += [Node(f"{rail}{k}", "0"), Node(f"C{rail}{k}", "C", _ladder_value("C", index))]
        bonds.append(Bond(f"{rail}{k}", f"C{rail}{k}"))
    for tail, head, inertia, resistance in _ladder_links(stages):
        link = f"{tail}{head}"
        nodes += [Node(link, "1"), Node(f"I{link}", "I", inertia), Node(f"R{link}", "R", resistance)]
        bonds += [Bond(tail, link), Bond(link, head), Bond(link, f"I{link}"), Bond(link, f"R{link}")]
    return ReducedGraph(BondGraph(nodes, bonds), ["u"], [Port(f"b{stages}", "e")], traced=False)


def _ladder_matrices(stages: int) -> tuple[Any, Any, Any, Any]:
    """Return compliances, the sparse incidence of links at rail nodes, inertias and resistances."""
    from scipy.sparse import csc_array

    places = {f"{rail}{k + 1}": 2 * k + side for k in range(stages) for side, rail in enumerate(_RAILS)}
    tails, heads, inertias, resistances = zip(*_ladder_links(stages), strict=True)
    count = len(tails)
    rows = [places[end] for end in (*tails, *heads)]
    signs, columns = np.repeat([1.0, -1.0], count), [*range(count), *range(count)]
    incidence = csc_array((signs, (rows, columns)), shape=(2 * stages, count))
    compliances = [float(_ladder_value("C", index)) for index in range(2 * stages)]
    return np.array(compliances), incidence, np.array(inertias, float), np.array(resistances, float)


def exact_ladder(stages: int, omega: Any) -> list[complex]:
    """Return the response in 60 digits and more, rung by rung: two rails are 2 x 2 blocks in a row."""
    from flint import acb, acb_mat, arb, ctx, fmpq

    def ball(value: Fraction) -> Any:
        return acb(arb(fmpq(value.numerator, value.denominator)))

    values = []
    with ctx.workprec(400 + 20 * stages):
        laws = [(ball(inertia), ball(resistance)) for _, _, inertia, resistance in _ladder_links(stages)]
        stores = [ball(_ladder_value("C", index)) for index in range(2 * stages)]
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


def _rung_by_rung(stages: int) -> Any:
    """Run the first plan alone, from the far end; values that its bounds do not certify by balls."""
    from dynid.bondgraph.graph_response import on_axis

    planned = ladder(stages)
    return on_axis(planned, list(planned.channels().values()), frequencies())[:, 0]


def _ladder_by_nodes(admittances: Any) -> Any:
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


LADDER = Benchmark(
    title="Frequency response of a ladder of two rails at 1,000 frequencies, from the model on",
    size="stages",
    sizes=(100, 200),
    alternatives=(
        Alternative("reduction", _by_reduction(ladder)),
        Alternative("in-order", _rung_by_rung, max_size=10),
        Alternative("sparse-nodal", _ladder_by_nodes, _ladder_matrices, max_size=1000, peer=True),
    ),
    error=lambda stages, response: distance(response, partial(exact_ladder, stages), count=7),
    default=lambda _: "reduction",
    full=(10, 500, 1000, 2000),
)
