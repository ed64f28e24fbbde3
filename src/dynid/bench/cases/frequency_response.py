"""Frequency responses of a chain and of a random tree at 1,000 frequencies, computed from the model."""

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

POINTS = 1000
#: Errors of smaller responses, which are next to the least doubles, are relative to this.
_MIN_BENCH_RESPONSE = 1e-280


def frequencies() -> Any:
    """Return the angular frequencies of the responses, rad/s."""
    return np.geomspace(0.1, 60.0, POINTS)


def by_reduction(model: Callable[[int], ReducedGraph]) -> Callable[[int], Any]:
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
    places = np.linspace(0, POINTS - 1, count).astype(int)
    true = np.array(exact(frequencies()[places]))
    with np.errstate(all="ignore"):
        errors = np.abs(response[places] - true) / np.maximum(np.abs(true), _MIN_BENCH_RESPONSE)
        return float(np.nan_to_num(np.max(errors), nan=np.inf))


BENCHMARK = Benchmark(
    title="Frequency response of a chain at 1,000 frequencies, from the model on",
    size="stages",
    sizes=(10, 100, 1000, 2000),
    alternatives=(
        Alternative("reduction", by_reduction(reduced)),
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
        Alternative("reduction", by_reduction(tree)),
        Alternative(
            "leaves-inward", lambda junctions: _leaves_inward(junctions, 1j * frequencies()), peer=True
        ),
    ),
    error=lambda junctions, response: distance(response, partial(_exact_tree, junctions), count=5),
    default=lambda _: "reduction",
    full=(10_000, 50_000),
)
