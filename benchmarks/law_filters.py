"""CPU time of the filters of joints with laws against filterpy's unscented filter, on the same model.

``python -m benchmarks.law_filters [cubic | bouc_wen] [pairs]``: medians of interleaved pairs. Both filter the
same record once with the same prior, noise and steps of Runge and Kutta; filterpy's user writes the motion of
all sigma points in NumPy at once. The last coordinates of both are printed over their deviations.
"""

from __future__ import annotations

import sys
import time
from statistics import median
from typing import Any

import numpy as np

from dynid.identification.estimators.filter_passes import wide_prior
from dynid.identification.estimators.law_filter import law_filter_pass
from dynid.identification.likelihood.nonlinear_record import NonlinearRecord
from dynid.identification.problem import Problem
from dynid.identification.systems.nonlinear_prediction import hidden_start
from dynid.parameters import starts
from tests.identification.test_law_coverage import clean_record, measured, model

_SAMPLES, _SHARE = 1600, 0.05


def by_filterpy(kind: str, record: NonlinearRecord, prior: Any, noise: Any) -> Any:
    """Return the last state of the unscented filter, unscaled, and its covariance."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter  # type: ignore[import-not-found,unused-ignore]

    system, values = record.model, record.data.values
    M, K, C = np.diag([1.0, 0.7]), np.diag([1.5e4, 0.0]), np.diag([5.0, 0.0])
    hidden, h = kind == "bouc_wen", 1 / 800
    m, row = 4 + hidden, np.array([1.0, -1.0])
    phase = np.random.default_rng(7).uniform(0, 2 * np.pi, 49)
    omega = np.linspace(20, 260, 49)

    def load(t: float) -> float:
        return float(np.sum(3.0 * np.sin(omega * t + phase)))

    loads = [[load(k * h / 4) for k in range(4 * i, 4 * i + 5)] for i in range(_SAMPLES)]
    p_log = [unknown.logarithmic for unknown in record.unknowns]

    def rates(X: Any, u: float) -> Any:  # of all points at once (points x size)
        theta = np.where(p_log, np.exp(np.where(p_log, X[:, m:], 0.0)), X[:, m:])
        x, v = X[:, :2], X[:, 2:4]
        d, w = x @ row, v @ row
        f = theta[:, 0] * d + theta[:, 1] * w
        out = np.zeros_like(X)
        if hidden:
            e = d - X[:, 4]
            f = f + theta[:, 2] * e
            change = np.where(e * w > 0, theta[:, 3], -theta[:, 4])
            out[:, 4] = w * change * np.abs(e)
        else:
            f = f + theta[:, 2] * d**3
        out[:, :2] = v
        out[:, 2:4] = (np.array([0.0, u]) - x @ K - v @ C - f[:, None] * row) / np.diag(M)
        return out

    def moved(X: Any, step: int) -> Any:
        for half in (0, 2):
            u, k = loads[step][half : half + 3], h / 2
            a = rates(X, u[0])
            b = rates(X + k / 2 * a, u[1])
            c = rates(X + k / 2 * b, u[1])
            X = X + k / 6 * (a + 2 * b + 2 * c + rates(X + k * c, u[2]))
        return X

    size = m + len(p_log)
    points = MerweScaledSigmaPoints(size, alpha=1.0, beta=0.0, kappa=0.0)
    ukf = UnscentedKalmanFilter(size, 2, h, lambda X: X[2:4], None, points)
    scale = np.concatenate([system.scale, np.ones(size - 4)])
    root = prior.root * scale[:, None]
    ukf.x, ukf.P = np.concatenate([prior.state, prior.eta]) * scale, root @ root.T
    ukf.Q, ukf.R = np.zeros((size, size)), np.diag(noise**2)
    for step, value in enumerate(values):
        if step:
            sigmas = points.sigma_points(ukf.x, ukf.P)
            ukf.sigmas_f[:] = moved(sigmas, step - 1)
        else:
            ukf.sigmas_f[:] = points.sigma_points(ukf.x, ukf.P)
        ukf.x = ukf.Wm @ ukf.sigmas_f
        left = ukf.sigmas_f - ukf.x
        ukf.P = left.T @ (ukf.Wc[:, None] * left)
        ukf.update(value)
    return ukf.x, ukf.P


def main(kind: str, pairs: int) -> None:
    """Print the medians of CPU time and their ratio."""
    case, values, noise, eta, _ = clean_record(kind, _SAMPLES)
    factors = np.full(len(eta), 1.02)
    likelihood = Problem.of(model(kind, factors), measured(case, values, noise, 0)).likelihood
    (record,) = likelihood.records
    assert isinstance(record, NonlinearRecord)
    record = record.first(_SAMPLES)
    origin = starts(likelihood.unknowns)
    prior = wide_prior(record, origin, _SHARE)
    theirs = prior._replace(root=prior.root.copy())
    if kind == "bouc_wen":  # the hidden state itself in place of its number
        first = hidden_start(record.model, origin, prior.state[:4], prior.state[4:])
        theirs.root[4] = first.by_state[0] @ prior.root[:4] + first.by_number[0] * prior.root[4]
        theirs.root[4] += first.by_parameter[0] @ prior.root[5:]
    times: dict[str, list[float]] = {"sigma points": [], "linearised": [], "filterpy": []}
    ends: dict[str, Any] = {}
    for _ in range(pairs):
        for name in times:
            began = time.process_time()
            if name == "filterpy":
                x, P = by_filterpy(kind, record, theirs, noise)
                p = len(origin)
                ends[name] = x[-p:], np.sqrt(np.diag(P)[-p:])
            else:
                end = law_filter_pass(record, prior, noise, origin, sigma_points=name == "sigma points")
                ends[name] = end.eta[-1], end.deviations[-1]
            times[name].append(time.process_time() - began)
    for name, spent in times.items():
        apart = (ends[name][0] - eta) / ends[name][1]
        print(f"{kind}: {name}: {1e6 * median(spent) / _SAMPLES:.1f} us a sample; off by {apart.round(2)}")
    for name in ("sigma points", "linearised"):
        ratio = median(a / b for a, b in zip(times["filterpy"], times[name], strict=True))
        print(f"{kind}: filterpy over {name}: {ratio:.0f}")


if __name__ == "__main__":
    asked = sys.argv[1:]
    main(asked[0] if asked else "cubic", int(asked[1]) if asked[1:] else 11)
