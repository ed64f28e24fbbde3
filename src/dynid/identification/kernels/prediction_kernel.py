"""Prediction of a record, its sensitivities and their triangular factors, as kernels.

See `dynid.identification.prediction` and `dynid.identification.least_squares.triangular_factors`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynid.identification.kernels.simd import LANES, accumulate, dots, kernel, product, row_product
from dynid.identification.kernels.steps import Linear, Tables, linear, linearise, place, tables, work
from dynid.identification.parametric_model import ParametricModel

Array = NDArray[np.float64]

# Rows that are reflected at once: a whole number of registers.
_ROWS = 64


def steps_at(model: ParametricModel, eta: Array) -> Linear:
    """Return the steps of all lengths at these coordinates (p)."""
    at = linear(model)
    at.eta[:] = eta
    for length in prepare(tables(model), at).nonzero()[0].tolist():
        place(at, length, model.transition(eta, float(model.line.lengths[length])))
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
def free(t: Tables, at: Linear, C: Array, direct: Array, outputs: Array, by_state: Array) -> None:
    """Fill outputs from rest (times x channels), and their derivatives by the first state (… x n)."""
    n, fed, wide = t.lower.shape[1], at.forward.shape[1], at.forward.shape[2]
    channels, beside, tall = len(C), 1 + len(at.eta), at.phis.shape[2]
    pitch = tall // n
    driven, moved = np.zeros((1, fed)), np.zeros((1, wide))
    width = -(-n // LANES) * LANES
    read, next_read = np.zeros((channels, width)), np.zeros((channels, width))
    read[:, :n] = C
    for node in range(len(t.sample)):
        if node > 0:
            length = t.which[node - 1]
            for i in range(fed - n):
                driven[0, n + i] = t.W[node - 1, i]
            row_product(1, fed, wide, driven, 0, fed, at.forward, length * fed * wide, wide, moved, 0, wide)
            for i in range(n):
                driven[0, i] = moved[0, i * beside]
            phi = length * beside * tall
            product(channels, n, width, read, 0, width, at.phis, phi, pitch, next_read, 0, width)
            read, next_read = next_read, read
        sample = t.sample[node]
        if sample < 0:
            continue
        for c in range(channels):
            total = direct[sample, c]
            for i in range(n):
                total += C[c, i] * driven[0, i]
                by_state[sample, c, i] = read[c, i]
            outputs[sample, c] = total


@kernel
def sensitive(  # noqa: C901 - machine code: handing arrays over takes longer than a step
    t: Tables,
    at: Linear,
    C: Array,
    C_slopes: Array,
    direct: Array,
    start: Array,
    outputs: Array,
    states: Array,
    by_parameter: Array,
) -> None:
    """Fill outputs from a first state, states (times x n), and derivatives by the coordinates (… x p)."""
    n, fed, wide = t.lower.shape[1], at.forward.shape[1], at.forward.shape[2]
    p, channels, tall = len(at.eta), len(C), at.phis.shape[2]
    pitch = tall // n
    driven, moved, width = np.zeros((1, fed)), np.zeros((1, wide)), -(-(1 + p) // LANES) * LANES
    # Beside the sensitivities a column of zeros, which the state itself takes when it is read.
    slopes, ahead, read = np.zeros((n, width)), np.zeros((n, width)), np.zeros((channels, width))
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
        product(channels, n, width, C, 0, n, slopes, 0, width, read, 0, width)
        for c in range(channels):
            outputs[sample, c] = read[c, 0] + direct[sample, c]
            for j in range(p):
                by_parameter[sample, c, j] = read[c, 1 + j]
            for j in range(len(C_slopes)):
                for i in range(n):
                    by_parameter[sample, c, j] += C_slopes[j, c, i] * driven[0, i]


@kernel
def triangles(
    by_state: Array, by_parameter: Array, residual: Array, rms: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Return the triangular factors of derivatives and residuals side by side, over the channels' RMS.

    Blocks of rows are reflected into the triangle of those before them (Householder).

    Parameters
    ----------
    by_state, by_parameter
        Derivatives (times x channels x n, x p).
    residual
        Residuals (times x channels), NaN where missing.
    rms
        What each channel is divided by (channels).

    Returns
    -------
    tuple
        The factors (channels x n + p + 1 x n + p + 1), and how many residuals there are (channels).
    """
    samples, channels, n = by_state.shape
    w = n + by_parameter.shape[2] + 1
    out, counts = np.zeros((channels, w, w)), np.zeros(channels, dtype=np.int64)
    block, products = np.zeros((w, _ROWS)), np.zeros((w, 1))
    for channel in range(channels):
        for first in range(0, samples, _ROWS):
            counts[channel] += _fill(block, by_state, by_parameter, residual, first, channel, rms)
            _reflect(out[channel], block, products)
    return out, counts


@kernel
def _fill(
    block: Array,
    by_state: Array,
    by_parameter: Array,
    residual: Array,
    first: int,
    channel: int,
    rms: Array,
) -> int:
    """Fill a block (w x rows) with what follows a sample, zeros where it is missing; count the rest."""
    samples, n, p = len(by_state), by_state.shape[2], by_parameter.shape[2]
    unit, counted = 1.0 / rms[channel], 0
    block[:] = 0.0
    for r in range(min(_ROWS, samples - first)):
        left = residual[first + r, channel]
        if math.isnan(left):
            continue
        counted += 1
        for c in range(n):
            block[c, r] = by_state[first + r, channel, c] * unit
        for c in range(p):
            block[n + c, r] = by_parameter[first + r, channel, c] * unit
        block[n + p, r] = left * unit
    return counted


@kernel
def _reflect(R: Array, block: Array, products: Array) -> None:
    """Reflect the rows of a block into a triangle."""
    w = len(R)
    for j in range(w):
        dots(w - j, _ROWS, block, j * _ROWS, _ROWS, block, j * _ROWS, 0, products, j, 1)
        square = products[j, 0]
        if square == 0.0:
            continue
        diagonal = R[j, j]
        length = math.copysign(math.sqrt(diagonal * diagonal + square), diagonal)
        head = diagonal + length
        R[j, j] = -length
        share = 1.0 / (length * head)
        for k in range(j + 1, w):
            scaled = -(head * R[j, k] + products[k, 0]) * share
            R[j, k] += scaled * head
            products[k, 0] = scaled
        here = (j + 1) * _ROWS
        accumulate(w - j - 1, 1, _ROWS, products, j + 1, 1, block, j * _ROWS, _ROWS, block, here, _ROWS)
