"""Matrices of linear systems at some values of their parameters, with derivatives by these."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Matrices(NamedTuple):
    """``x' = A x + B u``, ``y = C x + sum_k D[k] d^k u / dt^k`` at some values of the parameters.

    Attributes
    ----------
    A, B, C, D
        Matrices (n x n, n x loads, channels x n, orders x channels x loads), SI.
    A_slopes, B_slopes, C_slopes, D_slopes
        Their derivatives by the values of the parameters (p x the shape of the matrix).
    """

    A: Array
    B: Array
    C: Array
    D: Array
    A_slopes: Array
    B_slopes: Array
    C_slopes: Array
    D_slopes: Array


class System(NamedTuple):
    """``x' = A x + b u``, ``y = c x + d u`` of one input and one output, with derivatives (p x …)."""

    A: Array
    b: Array
    c: Array
    d: float
    A_slopes: Array
    b_slopes: Array
    c_slopes: Array
    d_slopes: Array


def single(found: Matrices, channel: int, load: int) -> System:
    """Return the system of one channel and load, with integrators where derivatives of the input act.

    An input u that acts by its derivatives up to the k-th is a state with k - 1 others, driven by the k-th
    derivative: the zeros stay the same.
    """
    A, b, c = found.A, found.B[:, load], found.C[channel]
    direct, changes = found.D[:, channel, load], found.D_slopes[:, :, channel, load]
    p, n = len(found.A_slopes), len(A)
    k = max((order for order in range(len(direct)) if direct[order]), default=0)
    if not k:
        return System(
            A, b, c, float(direct[0]) if len(direct) else 0.0, found.A_slopes,
            found.B_slopes[:, :, load], found.C_slopes[:, channel],
            changes[:, 0] if len(direct) else np.zeros(p),
        )  # fmt: skip
    wide, moved = np.zeros((n + k, n + k)), np.zeros((p, n + k, n + k))
    wide[:n, :n], wide[:n, n] = A, b
    wide[n : n + k - 1, n + 1 :] = np.eye(k - 1)
    moved[:, :n, :n], moved[:, :n, n] = found.A_slopes, found.B_slopes[:, :, load]
    last = np.zeros(n + k)
    last[-1] = 1.0
    rows = np.concatenate([found.C_slopes[:, channel], changes[:, :k]], axis=1)
    return System(
        wide, last, np.concatenate([c, direct[:k]]), float(direct[k]), moved, np.zeros((p, n + k)), rows,
        changes[:, k],
    )  # fmt: skip
