"""Frequency response of a ladder with a loop at every rung, where bounds on rounding errors could add up."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.frequency_response import distance, frequencies
from dynid.bench.cases.ladder import exact_response, nodal, reduced


def _program(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.frequency_response import frequency_response

    omega = frequencies()
    return lambda: frequency_response(reduced(stages), omega)[:, 0, 0]


def _in_order(stages: int) -> Callable[[], Any]:
    """Run the first plan alone, from the far end on: what its bounds do not certify, in ball arithmetic."""
    from dynid.bondgraph.frequency_response import on_axis

    def work() -> Any:
        planned = reduced(stages)
        return on_axis(planned, list(planned.channels().values()), frequencies())[:, 0]

    return work


def _nodal(stages: int) -> Callable[[], Any]:
    """Factorise the nodal admittances at every frequency, sparse."""
    import numpy as np
    from scipy.sparse import csc_array, dia_array
    from scipy.sparse.linalg import splu

    stores, incidence, inertias, resistances = nodal(stages)
    flow = np.zeros(2 * stages, dtype=complex)
    flow[0] = 1.0

    def diagonal(values: Any) -> Any:
        return dia_array((values[None], [0]), shape=(len(values), len(values)))

    def solve(s: complex) -> complex:
        passes = diagonal(1 / (s * inertias + resistances))
        admittances = diagonal(s * stores) + incidence @ passes @ incidence.T
        return complex(splu(csc_array(admittances)).solve(flow)[-1])

    return lambda: np.array([solve(1j * w) for w in frequencies()])


BENCHMARK = Benchmark(
    title="Frequency response of a ladder of two rails at 1,000 frequencies, from the model on",
    size="stages",
    sizes=(100, 200),
    alternatives=(
        Alternative("reduction", _program),
        Alternative("in-order", _in_order, most=10),
        Alternative("sparse-nodal", _nodal, most=1000, peer=True),
    ),
    error=lambda stages, found: distance(found, partial(exact_response, stages), count=7),
    default=lambda _: "reduction",
    full=(10, 500, 1000, 2000),
)
