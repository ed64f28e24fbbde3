"""Convex quadratic programs of a few unknowns, by Mehrotra's primal-dual method.

S. Mehrotra, SIAM J. Optim. 2 (1992) 575–601; J. Nocedal, S. J. Wright, Numerical Optimization, 2006, section
16.6.
"""

from __future__ import annotations

import numpy as np

from dynid.arrays import Array

_MAX_INTERIOR_STEPS, _GAP_RTOL = 60, 1e-14


def quadratic_program(H: Array, c: Array, A: Array, b: Array) -> tuple[Array, Array]:
    """Return the minimum of ``x' H x / 2 + c' x`` where ``A x <= b``, and the multipliers.

    `H` and `c`: positive semidefinite matrix (n x n) and vector (n). `A` and `b`: inequalities (m x n, m),
    which something satisfies and which bound the minimum.
    """
    n, m = len(c), len(b)
    scale = np.linalg.norm(A, axis=1)
    scale[scale == 0] = 1.0
    A, b = A / scale[:, None], b / scale
    x, slack, dual = np.zeros(n), np.maximum(b, 1.0), np.ones(m)
    for _ in range(_MAX_INTERIOR_STEPS):
        stationary = H @ x + c + A.T @ dual
        primal = A @ x + slack - b
        gap = float(slack @ dual) / m
        if gap <= _GAP_RTOL and max(np.abs(stationary).max(), np.abs(primal).max()) <= 1e-12:
            break
        weight = dual / slack
        matrix = H + A.T @ (weight[:, None] * A)
        matrix[np.diag_indices(n)] += 1e-15 * np.trace(matrix) / n

        def direction(target: Array) -> tuple[Array, Array, Array]:
            right = -stationary - A.T @ (weight * primal - dual + target / slack)  # noqa: B023
            step = np.linalg.solve(matrix, right)  # noqa: B023
            slack_step = -primal - A @ step  # noqa: B023
            return np.asarray(step), slack_step, target / slack - dual - weight * slack_step  # noqa: B023

        _, slack_step, dual_step = direction(np.zeros(m))
        length = min(_longest(slack, slack_step), _longest(dual, dual_step))
        ahead = float((slack + length * slack_step) @ (dual + length * dual_step)) / m
        centre = (ahead / gap) ** 3 * gap if gap > 0 else 0.0
        step, slack_step, dual_step = direction(centre - slack_step * dual_step)
        length = 0.9995 * min(_longest(slack, slack_step), _longest(dual, dual_step))
        x, slack, dual = x + length * step, slack + length * slack_step, dual + length * dual_step
        if not (slack > 1e-300).all() or not (dual > 1e-300).all():
            slack, dual = np.maximum(slack, 1e-300), np.maximum(dual, 1e-300)
            break
    return x, dual / scale


def _longest(values: Array, step: Array) -> float:
    """Return the longest part of a step, at most 1, that keeps all values positive."""
    down = step < 0
    return float(min(1.0, (-values[down] / step[down]).min(initial=np.inf)))
