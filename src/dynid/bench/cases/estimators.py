"""Four joint parameters from noisy records, started at half: time against error over the Cramér–Rao bound."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.suspension import REMARK, SuspensionRecord, case, compiles, kernels
from dynid.defaults import ESTIMATOR

#: Noises of the records that a work goes over.
_SEEDS = (1, 2, 3, 4)


def each_record(make: Callable[[SuspensionRecord], Callable[[], Any]]) -> Callable[[int], Callable[[], Any]]:
    """Return the work on all records, one after the other (records x parameters)."""

    def prepare(samples: int) -> Callable[[], Any]:
        works = [make(case(samples, seed)) for seed in _SEEDS]
        return lambda: [work() for work in works]

    return prepare


def _house(name: str, wish: str = "1") -> Callable[[int], Callable[[], Any]]:
    """Return an estimator of the house, compiled or not."""

    def make(this: SuspensionRecord) -> Callable[[], Any]:
        from dynid.identification.estimators.auto import Auto
        from dynid.identification.estimators.estimate import Estimator
        from dynid.identification.estimators.filter_passes import Filter
        from dynid.identification.estimators.imbedding import InvariantImbedding
        from dynid.identification.estimators.maximum_likelihood import OutputError

        every: dict[str, Estimator] = {f"filter-{k}": Filter(k) for k in (1, 2, 3)}
        every |= {each.name: each for each in (Auto(), OutputError(), InvariantImbedding())}
        estimator = every[name]

        def work() -> Any:
            with kernels(wish):
                return estimator.run(this.ensemble, this.start).fit.logs

        return work

    return each_record(make)


def _least_squares(this: SuspensionRecord) -> Callable[[], Any]:
    """Return SciPy's optimiser on a simulation, Jacobian by differences, initial state among the unknowns."""
    import numpy as np
    from scipy.optimize import least_squares

    from dynid.identification.prediction import free_prediction

    record = this.ensemble.records[0]
    values, root = record.data.values, record.root

    def residual(unknown: Any) -> Any:
        free, _ = free_prediction(record.model, unknown[:4])
        seen = free.forced + free.by_state @ (root @ unknown[4:])
        return ((values - seen) / record.data.rms).ravel()

    def work() -> Any:
        with kernels("0"):
            return least_squares(residual, np.append(this.start, np.zeros(10))).x[:4]

    return work


def _error(samples: int, found: Any) -> float:
    import numpy as np

    cases = [case(samples, seed) for seed in _SEEDS]
    errors = [(logs - this.truth) / this.bound for logs, this in zip(found, cases, strict=True)]
    return float(np.sqrt(np.mean(np.square(errors))))


BENCHMARK = Benchmark(
    title="Four joint parameters of the suspension, from four records",
    size="samples",
    sizes=(800,),
    alternatives=(
        Alternative("auto", _house("auto")),
        Alternative("auto-numpy", _house("auto", "0"), most=8000),
        *(Alternative(f"filter-{k}", _house(f"filter-{k}")) for k in (1, 2, 3)),
        Alternative("output-error", _house("output-error")),
        Alternative("invariant-imbedding", _house("invariant-imbedding"), most=200),
        Alternative("least-squares", each_record(_least_squares), peer=True),
    ),
    error=_error,
    measure="RMS of the errors over the Cramér-Rao bound",
    default=lambda samples: ESTIMATOR.value if compiles(samples, len(_SEEDS)) else f"{ESTIMATOR.value}-numpy",
    full=(8000, 80_000),
    remark=REMARK,
)
