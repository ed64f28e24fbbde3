"""One pass of a filter from half the true values on: what its numerics cost, and add to its errors."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from dynid.bench.benchmark import Alternative, Benchmark
from dynid.bench.cases.suspension import (
    REMARK,
    STEP,
    assumed_noise,
    case,
    compiles,
    first_covariance,
    first_prior,
    kernels,
)
from dynid.identification.filter import PART, Pass, filter_pass


def _house(wish: str, part: float = PART) -> Callable[[int], Callable[[], Any]]:
    """Return the house's pass, compiled or not; `part` 0: linearised anew at every sample."""

    def prepare(samples: int) -> Callable[[], Any]:
        return lambda: _passed(samples, wish, part).logs[-1]

    return prepare


def _passed(samples: int, wish: str, part: float) -> Pass:
    this = case(samples)
    record, prior = this.ensemble.records[0], first_prior(this)
    with kernels(wish):
        return filter_pass(record.model, record.data.values, prior, assumed_noise(this), this.start, part)


def _joseph(precision: str) -> Callable[[int], Callable[[], Any]]:
    """Return the pass on the covariance itself, in Joseph's form, at this precision."""

    def prepare(samples: int) -> Callable[[], Any]:
        import numpy as np

        this = case(samples)
        record = this.ensemble.records[0]
        model, kind = record.model, np.dtype(precision)
        scale = np.append(model.scale, np.ones(4))
        first = (first_covariance(this) / scale / scale[:, None]).astype(kind)
        H = np.zeros((2, 14), dtype=kind)
        H[:, :10] = model.C
        noise, values = assumed_noise(this), record.data.values.astype(kind)

        def work() -> Any:
            z, P, eye = np.append(np.zeros(10), this.start).astype(kind), first, np.eye(14, dtype=kind)
            for k, value in enumerate(values):
                if k:
                    step, slopes = model.transition(z[10:].astype(float), STEP)
                    driven = np.concatenate([z[:10], model.W[k - 1]])
                    F = np.eye(14, dtype=kind)
                    F[:10, :10], F[:10, 10:] = step[:, :10], (slopes @ driven).T
                    z[:10] = step @ driven
                    P = F @ P @ F.T
                R = np.diag(noise[k] ** 2).astype(kind)
                gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
                z = z + gain @ (value - H @ z)
                closed = eye - gain @ H
                P = closed @ P @ closed.T + gain @ R @ gain.T
            return z[10:].astype(float)

        return work

    return prepare


def _imbedding(substeps: int) -> Callable[[int], Callable[[], Any]]:
    """Return eqs 19 and 20 as one differential equation, by Runge–Kutta 4 with so many steps a sample."""

    def prepare(samples: int) -> Callable[[], Any]:
        import numpy as np

        from dynid.identification.estimators.imbedding import Flow, InvariantImbedding

        this = case(samples)
        record = this.ensemble.records[0]
        prior = first_prior(this)
        weights = 1 / (2 * assumed_noise(this) ** 2 * STEP)
        times, h = record.model.line.nodes, STEP / substeps

        def work() -> Any:
            equations = Flow(record, InvariantImbedding())
            v = equations.packed(np.concatenate([prior.state, prior.logs]), prior.root @ prior.root.T)
            with np.errstate(all="ignore"):
                for time, weight in zip(times[:-1], weights[:-1], strict=True):
                    equations.weight = weight
                    for k in range(substeps):
                        t = time + k * h
                        k1 = equations.rate(t, v)
                        k2 = equations.rate(t + h / 2, v + h / 2 * k1)
                        k3 = equations.rate(t + h / 2, v + h / 2 * k2)
                        v = v + h / 6 * (k1 + 2 * k2 + 2 * k3 + equations.rate(t + h, v + h * k3))
            return v[10:14]

        return work

    return prepare


@lru_cache(maxsize=4)
def _exact(samples: int) -> Pass:
    """Return the pass that is linearised at every sample."""
    return _passed(samples, "1", 0.0)


def _error(samples: int, found: Any) -> float:
    import numpy as np

    exact = _exact(samples)
    error = float(np.max(np.abs(found - exact.logs[-1]) / exact.deviations[-1]))
    return error if np.isfinite(error) else float("inf")


BENCHMARK = Benchmark(
    title="One filter pass over the suspension's record, 10 + 4 states",
    size="samples",
    sizes=(800, 8000),
    alternatives=(
        Alternative("square-root", _house("1")),
        Alternative("square-root-numpy", _house("0")),
        Alternative("every-sample", _house("1", 0.0)),
        Alternative("every-sample-numpy", _house("0", 0.0), most=8000),
        Alternative("joseph", _joseph("float64"), most=8000),
        Alternative("joseph-float32", _joseph("float32"), most=8000),
        Alternative("imbedding-1", _imbedding(1), most=800),
        Alternative("imbedding-4", _imbedding(4), most=800),
    ),
    error=_error,
    measure="largest distance from the filter linearised at every sample, in its deviations; inf: no number",
    default=lambda samples: "square-root" if compiles(samples) else "square-root-numpy",
    full=(80_000,),
    remark=REMARK,
)
