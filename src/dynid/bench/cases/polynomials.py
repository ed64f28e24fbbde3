"""Numerator and denominator of a chain: what is asked for where no roots are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.chain import characteristic, matrices, numerator, reduced


def _exact(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.exact_engine import ExactEngine

    def work() -> Any:
        graph = reduced(stages)
        return ExactEngine(graph).channel(next(iter(graph.channels()))).coefficients()

    return work


def _ss2tf(stages: int) -> Callable[[], Any]:
    from scipy.signal import ss2tf

    def work() -> Any:
        numerator, denominator = ss2tf(*matrices(stages))
        return numerator[0], denominator

    return work


def _control(stages: int) -> Callable[[], Any]:
    import control

    def work() -> Any:
        transfer = control.tf(control.ss(*matrices(stages)))
        return transfer.num[0][0], transfer.den[0][0]

    return work


def _error(stages: int, found: Any) -> float:
    """Return the largest relative error of the coefficients that doubles can hold."""
    denominator = characteristic(stages)
    lead = denominator[denominator.degree()]
    known = numerator(stages), denominator
    return max(_distance(each, exact, lead) for each, exact in zip(found, known, strict=True))


def _distance(found: Any, polynomial: Any, lead: Any) -> float:
    """Return the largest relative error of coefficients, descending; of one that is 0, to the largest."""
    import numpy as np

    ascending = np.asarray(found, dtype=float)[::-1].tolist()
    if len(ascending) <= polynomial.degree() or not np.isfinite(ascending).all():
        return float("inf")
    exact = [polynomial[power] / lead for power in range(len(ascending))]
    held = [(number, int(c.p) / int(c.q)) for number, c in zip(ascending, exact, strict=True) if _held(c)]
    largest = max(abs(true) for _, true in held)
    return float(max(abs(number - true) / (abs(true) or largest) for number, true in held))


def _held(number: Any) -> bool:
    """Tell whether a double can hold a fraction."""
    return number == 0 or abs(int(number.p).bit_length() - int(number.q).bit_length()) < 1000


BENCHMARK = Benchmark(
    title="Numerator and denominator of a chain, monic, from the model on",
    size="stages",
    sizes=(10, 50, 100),
    full=(200, 500),
    alternatives=(
        Alternative("exact", _exact),
        Alternative("ss2tf", _ss2tf, peer=True),
        Alternative("control-tf", _control, needs=("control",), most=100, peer=True),
    ),
    error=_error,
    measure="largest relative error of a coefficient of numerator or denominator",
    default=lambda _: "exact",
)
