"""The prediction of a record and its sensitivities at fixed parameters, as kernels; see `prediction`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.identification.kernels.simd import LANES, accumulate, kernel, product, row_product
from dynid.identification.kernels.steps import Linear, Tables, linear, linearise, place, tables, work
from dynid.identification.record_model import RecordModel

Array = NDArray[np.float64]


def steps_at(model: RecordModel, logs: Array) -> Linear:
    """Return the steps of all lengths at these logarithms (p)."""
    at = linear(model)
    at.logs[:] = logs
    for length in prepare(tables(model), at).nonzero()[0].tolist():
        place(at, length, model.transition(logs, float(model.line.lengths[length])))
    return at


@kernel
def prepare(t: Tables, at: Linear) -> NDArray[np.bool_]:
    """Make the steps of all lengths ready; return which ones the series does not reach."""
    room = work(t)
    missed = np.zeros(len(t.lengths), dtype=np.bool_)
    for length in range(len(t.lengths)):
        missed[length] = not linearise(t, length, at, room)
    return missed


@kernel
def free(t: Tables, at: Linear, C: Array, outputs: Array, by_state: Array) -> None:
    """Fill outputs from rest (times x channels), and their derivatives by the first state (… x n)."""
    n, fed, wide = t.lower.shape[1], at.forward.shape[1], at.forward.shape[2]
    channels, beside, tall = len(C), 1 + len(at.logs), at.phis.shape[2]
    pitch = tall // n
    driven, moved = np.zeros((1, fed)), np.zeros((1, wide))
    width = -(-n // LANES) * LANES
    seen, next_seen = np.zeros((channels, width)), np.zeros((channels, width))
    seen[:, :n] = C
    for node in range(len(t.sample)):
        if node > 0:
            length = t.which[node - 1]
            for i in range(fed - n):
                driven[0, n + i] = t.W[node - 1, i]
            row_product(1, fed, wide, driven, 0, fed, at.forward, length * fed * wide, wide, moved, 0, wide)
            for i in range(n):
                driven[0, i] = moved[0, i * beside]
            phi = length * beside * tall
            product(channels, n, width, seen, 0, width, at.phis, phi, pitch, next_seen, 0, width)
            seen, next_seen = next_seen, seen
        sample = t.sample[node]
        if sample < 0:
            continue
        for c in range(channels):
            total = t.feedthrough[sample, c]
            for i in range(n):
                total += C[c, i] * driven[0, i]
                by_state[sample, c, i] = seen[c, i]
            outputs[sample, c] = total


@kernel
def sensitive(  # noqa: C901 - machine code: handing arrays over takes longer than a step
    t: Tables,
    at: Linear,
    C: Array,
    C_slopes: Array,
    start: Array,
    outputs: Array,
    states: Array,
    by_parameter: Array,
) -> None:
    """Fill outputs from a first state, states (times x n), and derivatives by the logarithms (… x p)."""
    n, fed, wide = t.lower.shape[1], at.forward.shape[1], at.forward.shape[2]
    p, channels, tall = len(at.logs), len(C), at.phis.shape[2]
    pitch = tall // n
    driven, moved, width = np.zeros((1, fed)), np.zeros((1, wide)), -(-(1 + p) // LANES) * LANES
    # Beside the sensitivities a column of zeros, which the state itself takes when it is read.
    slopes, ahead, seen = np.zeros((n, width)), np.zeros((n, width)), np.zeros((channels, width))
    for i in range(n):
        driven[0, i] = start[i]
    for node in range(len(t.sample)):
        if node > 0:
            length = t.which[node - 1]
            for i in range(fed - n):
                driven[0, n + i] = t.W[node - 1, i]
            row_product(1, fed, wide, driven, 0, fed, at.forward, length * fed * wide, wide, moved, 0, wide)
            for i in range(n):
                driven[0, i] = moved[0, i * (1 + p)]
                slopes[i, 0] = 0.0
                for j in range(1 + p):
                    ahead[i, j] = moved[0, i * (1 + p) + j]
            phi = length * (1 + p) * tall
            accumulate(n, n, width, at.phis, phi, pitch, slopes, 0, width, ahead, 0, width)
            slopes, ahead = ahead, slopes
        sample = t.sample[node]
        if sample < 0:
            continue
        for i in range(n):
            slopes[i, 0] = states[sample, i] = driven[0, i]
        product(channels, n, width, C, 0, n, slopes, 0, width, seen, 0, width)
        for c in range(channels):
            outputs[sample, c] = seen[c, 0] + t.feedthrough[sample, c]
            for j in range(p):
                by_parameter[sample, c, j] = seen[c, 1 + j]
            for j in range(len(C_slopes)):
                for i in range(n):
                    by_parameter[sample, c, j] += C_slopes[j, c, i] * driven[0, i]
