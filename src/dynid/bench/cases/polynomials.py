"""Numerator and denominator of a chain: what is asked for where no roots are."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark
from dynid.bench.cases.chain import characteristic, matrices, reduced


def _exact(stages: int) -> Callable[[], Any]:
    from dynid.bondgraph.exact import ExactEngine

    def work() -> Any:
        graph = reduced(stages)
        return ExactEngine(graph).channel(next(iter(graph.channels()))).coefficients()[1]

    return work


def _ss2tf(stages: int) -> Callable[[], Any]:
    from scipy.signal import ss2tf

    return lambda: ss2tf(*matrices(stages))[1]


def _control(stages: int) -> Callable[[], Any]:
    import control

    return lambda: control.tf(control.ss(*matrices(stages))).den[0][0]


def _error(stages: int, found: Any) -> float:
    """Return the largest relative error of the coefficients that doubles can hold."""
    import numpy as np

    polynomial = characteristic(stages)
    if len(found) != polynomial.degree() + 1:
        return float("inf")
    lead, errors = polynomial[polynomial.degree()], [0.0]
    for number, exact in zip(np.asarray(found)[::-1].tolist(), polynomial.coeffs(), strict=True):
        ratio = exact / lead
        log2 = int(ratio.p).bit_length() - int(ratio.q).bit_length()
        if abs(log2) < 1000:
            true = int(ratio.p) / int(ratio.q)
            errors.append(abs(number - true) / abs(true) if np.isfinite(number) else float("inf"))
    return max(errors)


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
    measure="largest relative error of the denominator's coefficients",
    default=lambda _: "exact",
)
