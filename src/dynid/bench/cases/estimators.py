"""Estimators on one noisy record, against the best that any could do."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from dynid.bench.alternative import Alternative, Benchmark
from dynid.bench.cases.suspension import record


def _estimator(module: str, name: str, **options: Any) -> Callable[[int], Callable[[], Any]]:
    def prepare(samples: int) -> Callable[[], Any]:
        kind = getattr(import_module(f"dynid.identification.estimators.{module}"), name)
        given = record(samples)
        return lambda: kind(**options).run(given.ensemble, given.start).fit.logs

    return prepare


def _error(samples: int, found: Any) -> float:
    return record(samples).error(found)


BENCHMARK = Benchmark(
    title="Four joint parameters of a suspension from a record with 5 % noise",
    size="samples",
    sizes=(800,),
    alternatives=(
        Alternative("auto", _estimator("auto", "Auto")),
        *(Alternative(f"filter-{k}", _estimator("passes", "Filter", passes=k)) for k in (1, 2, 3)),
        Alternative("output-error", _estimator("output_error", "OutputError")),
        Alternative("invariant-imbedding", _estimator("imbedding", "InvariantImbedding"), most=1000),
    ),
    error=_error,
    measure="RMS error of the parameters over their Cramér–Rao bounds",
)
