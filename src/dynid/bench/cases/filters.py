"""One pass of the filter over a noisy record, compiled and not."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark
from dynid.bench.cases.suspension import record


def _pass(compiled: str) -> Callable[[int], Callable[[], Any]]:
    def prepare(samples: int) -> Callable[[], Any]:
        from dynid.identification.estimators.passes import last, run_passes
        from dynid.identification.kernels.compiled import VARIABLE

        given = record(samples)

        def work() -> Any:
            before = os.environ.get(VARIABLE)
            os.environ[VARIABLE] = compiled
            try:
                return last(given.ensemble, run_passes(given.ensemble, 1, given.start))
            finally:
                os.environ.pop(VARIABLE)
                os.environ.update({} if before is None else {VARIABLE: before})

        return work

    return prepare


def _error(samples: int, found: Any) -> float:
    return record(samples).error(found)


BENCHMARK = Benchmark(
    title="One filter pass over a record of a suspension with four unknown joint parameters",
    size="samples",
    sizes=(800, 8000),
    alternatives=(
        Alternative("numpy", _pass("0"), most=20_000),
        Alternative("compiled", _pass("1"), needs=("numba",)),
    ),
    error=_error,
    measure="RMS error of the parameters over their Cramér–Rao bounds",
)
