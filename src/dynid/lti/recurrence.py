"""Linear recurrences over many steps, by blocks: a few large products instead of many small ones.

There are as many blocks as a block has steps. All blocks start from zero at once; then the state is carried
from block to block, and its free response in each is added. The number of products is a few times the square
root of the number of steps; the errors are those of single steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from dynid.arrays import Array

# Number of steps below which single steps are as fast.
_MIN_BLOCKED_STEPS = 8


def recurrence(
    Phi: Array,
    forcing: Array,
    start: Array,
    power: Callable[[int], Array | None] | None = None,
    powers: Array | None = None,
) -> Array:
    """Return the states of ``x(k+1) = Phi x(k) + f(k)`` after each step (steps x columns x n).

    `forcing` is f, `start` the first states (columns x n). `power` returns Phi^k more accurately than k
    products of the rounded Phi, or None: over many steps the rounding of Phi accumulates; with it only inside
    a block. `powers`: Phi, Phi², … (count x n x n), if they are ready: up to the root of the steps.
    """
    steps, columns, n = forcing.shape
    out = np.empty(forcing.shape)
    length = math.isqrt(steps)
    if steps < _MIN_BLOCKED_STEPS or not n:
        powers = Phi[None]
    else:
        powers = powers_of(Phi, length) if powers is None else powers[:length]
    if steps < _MIN_BLOCKED_STEPS or not (
        n and np.isfinite(powers[-1]).all()
    ):  # powers overflow, but the state may be 0
        state = start
        for k in range(steps):
            state = out[k] = state @ Phi.T + forcing[k]
        return out
    blocks = steps // length
    full = blocks * length
    over = power(length) if power else None
    over = powers[-1] if over is None else over
    # Step by step inside all blocks: (steps, blocks, columns, n), each step in one piece.
    inside = np.empty((length, blocks, columns, n))
    inside[:] = forcing[:full].reshape(blocks, length, columns, n).swapaxes(0, 1)
    rows = inside.reshape(length, -1, n)
    for k in range(1, length):
        rows[k] += rows[k - 1] @ Phi.T
    starts = np.empty((blocks, columns, n))
    for block, at_rest in enumerate(inside[-1]):
        starts[block] = start
        start = at_rest + start @ over.T
    rows += starts.reshape(-1, n) @ powers.swapaxes(1, 2)
    out[:full].reshape(blocks, length, columns, n)[:] = inside.swapaxes(0, 1)
    out[full:] = recurrence(Phi, forcing[full:], start, power, powers)
    return out


def powers_of(Phi: Array, count: int) -> Array:
    """Return Phi, Phi², … (count x n x n), by doubling."""
    powers = np.empty((count, *Phi.shape))
    powers[0] = Phi
    computed = 1
    while computed < count:
        more = min(computed, count - computed)
        powers[computed : computed + more] = (
            powers[:more].reshape(-1, len(Phi)) @ powers[computed - 1]
        ).reshape(more, *Phi.shape)
        computed += more
    return powers


def free_response(Phi: Array, start: Array, readout: Array, steps: int) -> tuple[Array, Array]:
    """Return the outputs of ``X(k+1) = Phi X(k)`` (steps x c x columns), and the last states (n x columns).

    The states in between are not computed.
    """
    length = max(1, math.isqrt(steps))
    powers = powers_of(Phi, length)
    read = (readout @ powers).reshape(-1, len(Phi))
    outputs = np.empty((steps, len(readout), start.shape[1]))
    for first in range(0, steps, length):
        count = min(length, steps - first)
        outputs[first : first + count] = (read @ start).reshape(length, len(readout), -1)[:count]
        start = powers[count - 1] @ start
    return outputs, start
