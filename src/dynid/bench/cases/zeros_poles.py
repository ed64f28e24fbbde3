"""Zeros and poles of a chain: v_N / F has a zero at 0 and one at -k/b for every joint but the last."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark
from dynid.bench.cases.chain import exact, matrices, reduced
from dynid.bench.roots import distance


def _exact(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.exact import ExactEngine
    from dynid.lti.certified import repeated

    def work() -> Any:
        graph = reduced(stages)
        transfer = ExactEngine(graph).channel(next(iter(graph.channels())))
        return repeated(transfer.zeros), repeated(transfer.poles)

    return work


def _float(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.floating.transfer import FloatEngine
    from dynid.lti.certified import repeated

    def work() -> Any:
        graph = reduced(stages)
        transfer = FloatEngine(graph).channel(next(iter(graph.channels())))
        return repeated(transfer.zeros), repeated(transfer.poles)

    return work


def _matrices(stages: int) -> Callable[[], Any]:
    from dynid.lti import zeros_poles

    def work() -> Any:
        A, B, C, D = matrices(stages)
        return zeros_poles(A, B, C, D, engine="float")[:2]

    return work


def _control(stages: int) -> Callable[[], Any]:
    import control

    def work() -> Any:
        system = control.ss(*matrices(stages))
        return control.zeros(system), control.poles(system)

    return work


def _polynomials(stages: int) -> Callable[[], Any]:
    from scipy.signal import ss2zpk

    return lambda: ss2zpk(*matrices(stages))[:2]


def _error(stages: int, found: Any) -> float:
    """Return the largest relative distance of roots paired with the true ones; inf for a wrong count."""
    import numpy as np

    from dynid.lti.certified import repeated

    transfer = exact(stages)
    size = max(abs(root.value) for root in transfer.poles)
    return max(
        distance(np.asarray(got), repeated(true), size)
        for got, true in zip(found, (transfer.zeros, transfer.poles), strict=True)
    )


BENCHMARK = Benchmark(
    title="Zeros and poles of a chain, from the model on",
    size="stages",
    sizes=(5, 20, 100),
    alternatives=(
        Alternative("exact", _exact, most=400),
        Alternative("float", _float),
        Alternative("pencil", _matrices, most=200),
        Alternative("control", _control, needs=("control",), most=200),
        Alternative("polynomials", _polynomials, most=200),
    ),
    error=_error,
    measure="largest relative distance from the exact roots; inf: a wrong count",
)
