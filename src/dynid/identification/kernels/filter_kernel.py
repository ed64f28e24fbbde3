"""The pass of the filter as a kernel; see `dynid.identification.filter`."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.identification.kernels.simd import LANES, accumulate, dots, inlined, kernel, product, row_product
from dynid.identification.kernels.steps import Linear, Outputs, Tables, linearise, work

Array = NDArray[np.float64]

# Squares between these neither overflow nor lose digits.
_SMALL, _LARGE = 1e-280, 1e280


class Room(NamedTuple):
    """Room for one sample."""

    driven: Array
    moved: Array
    growth: Array
    total: Array
    root: Array
    state: Array
    row: Array
    phi: Array
    gain: Array
    correction: Array
    lengths: Array


def padded(S: Array) -> Array:
    """Return a copy of a root (rows x columns), with columns of zeros after it."""
    return np.pad(S, ((0, 0), (0, -len(S) % LANES)))


@kernel
def _room(t: Tables, at: Linear, size: int, width: int) -> Room:
    n = t.lower.shape[1]
    return Room(
        np.zeros((1, at.forward.shape[1])),
        np.zeros((1, at.forward.shape[2])),
        np.ones((1, at.phis.shape[1])),
        np.zeros((n, at.phis.shape[2] // n)),
        np.zeros((n, width)),
        np.zeros(n),
        np.zeros((1, size)),
        np.zeros((1, width)),
        np.zeros((size, 1)),
        np.zeros(size),
        np.zeros((size, 1)),
    )


@inlined
def _stale(at: Linear, z: Array, spread: Array, part: float, most: Array) -> bool:
    """Return True if coordinates are too far from those of the steps."""
    n = len(z) - len(spread)
    left = False
    for j in range(len(spread)):
        left |= not abs(z[n + j] - at.eta[j]) <= min(part * spread[j], most[j])
    return left


@inlined
def _propagate(t: Tables, at: Linear, node: int, z: Array, S: Array, room: Room) -> None:
    """Take state and root to a node from the one before it; see `dynid.identification.filter`."""
    n, p = t.lower.shape[1], len(at.eta)
    length = t.which[node - 1]
    wide, width, fed, tall = at.forward.shape[2], S.shape[1], at.forward.shape[1], at.phis.shape[2]
    driven, moved, growth, total = room.driven, room.moved, room.growth, room.total
    for j in range(p):
        left = z[n + j] - at.eta[j]
        growth[0, 1 + j] = left + t.log[j] * left * left / 2
    here = length * (1 + p) * tall
    row_product(1, 1 + p, tall, growth, 0, 1 + p, at.phis, here, tall, total, 0, tall)
    for i in range(n):
        driven[0, i] = z[i]
    for i in range(t.W.shape[1]):
        driven[0, n + i] = t.W[node - 1, i]
    here = length * fed * wide
    row_product(1, fed, wide, driven, 0, fed, at.forward, here, wide, moved, 0, wide)
    for i in range(n):
        here = i * (1 + p)
        z[i] = moved[0, here]
        for j in range(p):
            change = moved[0, here + 1 + j] * growth[0, 1 + j]
            total[i, n + j] = moved[0, here + 1 + j] + t.log[j] * change
            z[i] += change
    product(n, n + p, width, total, 0, tall // n, S, 0, width, room.root, 0, width)
    for i in range(n):
        for c in range(S.shape[1]):
            S[i, c] = room.root[i, c]


@inlined
def _readout(t: Tables, at: Linear, out: Outputs, sample: int, channel: int, z: Array, room: Room) -> float:
    """Set the row of a channel's derivatives by state and coordinates; return how its direct term changes."""
    n, direct = t.lower.shape[1], 0.0
    for i in range(n):
        room.row[0, i] = out.C[channel, i]
    varying = len(at.eta) if len(out.C_slopes) or len(out.direct_slopes) else 0
    for j in range(varying):
        room.row[0, n + j] = 0.0
        left = z[n + j] - at.eta[j]
        growth, here = left, 1.0
        if out.affine:
            growth = here = math.exp(z[n + j])
        else:
            growth += t.log[j] * left * left / 2
            here += t.log[j] * growth
        if len(out.C_slopes):
            for i in range(n):
                slope = out.C_slopes[j, channel, i]
                room.row[0, i] += growth * slope
                room.row[0, n + j] += here * slope * room.state[i]
        if len(out.direct_slopes):
            direct += growth * out.direct_slopes[j, sample, channel]
            room.row[0, n + j] += here * out.direct_slopes[j, sample, channel]
    return direct


@inlined
def _update(
    t: Tables,
    at: Linear,
    out: Outputs,
    sample: int,
    measured: Array,
    weights: Array,
    z: Array,
    S: Array,
    normalised: Array,
    room: Room,
) -> None:
    """Take one sample into account, channel by channel, in units of its noise (Potter)."""
    n, size, width = t.lower.shape[1], len(z), S.shape[1]
    state, row, phi, gain, correction = room.state, room.row, room.phi, room.gain, room.correction
    for i in range(n):
        state[i] = z[i]  # every channel is linearised about the state before the sample
    correction[:] = 0.0
    for channel in range(len(out.C)):
        if math.isnan(measured[sample, channel]):
            continue
        weight = weights[sample, channel]
        innovation = measured[sample, channel] - out.direct[sample, channel]
        innovation -= _readout(t, at, out, sample, channel, z, room)
        for i in range(n):
            innovation -= row[0, i] * state[i]
        for i in range(size):
            row[0, i] *= weight
        innovation *= weight
        row_product(1, size, width, row, 0, size, S, 0, width, phi, 0, width)
        dots(1, width, phi, 0, width, phi, 0, width, gain, 0, 1)
        spread = 1.0 + gain[0, 0]
        for i in range(size):
            innovation -= row[0, i] * correction[i]
        normalised[sample, channel] = innovation / math.sqrt(spread)
        shrink = -1 / (1 + math.sqrt(1 / spread))
        dots(size, width, S, 0, width, phi, 0, 0, gain, 0, 1)
        for i in range(size):
            gain[i, 0] /= spread
            correction[i] += gain[i, 0] * innovation
            gain[i, 0] *= shrink
        accumulate(size, 1, width, gain, 0, 1, phi, 0, width, S, 0, width)
    for i in range(size):
        z[i] += correction[i]


@inlined
def _lengths(S: Array, lengths: Array) -> None:
    """Set the lengths (rows x 1) of the rows of a root, however large or small."""
    size, width = S.shape
    dots(size, width, S, 0, width, S, 0, width, lengths, 0, 1)
    low, high = _LARGE, _SMALL
    for i in range(size):
        low, high = min(low, lengths[i, 0]), max(high, lengths[i, 0])
    if low > _SMALL and high < _LARGE:
        for i in range(size):
            lengths[i, 0] = math.sqrt(lengths[i, 0])
    else:
        for i in range(size):
            lengths[i, 0] = _length(S, i)


@kernel
def _length(S: Array, row: int) -> float:
    unit = 0.0  # squares of large units overflow
    for c in range(S.shape[1]):
        unit = max(unit, abs(S[row, c]))
    if unit == 0.0:
        return 0.0
    square = 0.0
    for c in range(S.shape[1]):
        share = S[row, c] / unit
        square += share * share
    return math.sqrt(square) * unit


@kernel
def filter_samples(
    t: Tables,
    at: Linear,
    out: Outputs,
    limits: tuple[float, Array, Array],
    first: int,
    measured: Array,
    weights: Array,
    z: Array,
    S: Array,
    spread: Array,
    origin: Array,
    history: Any,
) -> int:
    """Filter from a node on; see `filter_pass`.

    Parameters
    ----------
    t, at, out
        The model, and its steps and outputs as they were last linearised.
    limits
        Part of their deviation, and most (p), that coordinates may be off the linearisation; and off the
        origin (p).
    first
        The node to go to.
    measured, weights
        Measured values, and one over the standard deviation of their noise (times x channels).
    z, S
        State and coordinates (n + p), and root of their covariance (n + p x width), in place.
    spread
        Deviations of the coordinates (p), in place.
    origin
        What a coordinate must not leave.
    history
        What is filled: coordinates, their deviations, states, their deviations, innovations.

    Returns
    -------
    int
        The node that it has not got to: the number of nodes, or where the series does not reach, or minus one
        minus the node of a run-away.
    """
    room, series = _room(t, at, len(z), S.shape[1]), work(t)
    part, most, runaway = limits
    eta, deviations, states, bands, innovations = history
    n = t.lower.shape[1]
    for node in range(first, len(t.sample)):
        if node > 0:
            if _stale(at, z, spread, part, most):
                at.eta[:] = z[n:]
                at.ready[:] = False
            length = t.which[node - 1]
            if not at.ready[length] and not linearise(t, length, at, series):
                return node
            _propagate(t, at, node, z, S, room)
        sample = t.sample[node]
        if sample < 0:
            continue
        _update(t, at, out, sample, measured, weights, z, S, innovations, room)
        _lengths(S, room.lengths)
        for j in range(len(origin)):
            if not abs(z[n + j] - origin[j]) < runaway[j]:
                return -1 - node
            spread[j] = room.lengths[n + j, 0]
            eta[sample, j], deviations[sample, j] = z[n + j], spread[j]
        for i in range(n):
            states[sample, i], bands[sample, i] = z[i], room.lengths[i, 0]
    return len(t.sample)
