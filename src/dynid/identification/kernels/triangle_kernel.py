"""The triangular factor of many rows, as a kernel; see `least_squares.triangular_factors`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynid.identification.kernels.simd import accumulate, dots, kernel

Array = NDArray[np.float64]

# Rows that are reflected at once: a whole number of registers.
_ROWS = 64


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
    block, product = np.zeros((w, _ROWS)), np.zeros((w, 1))
    for channel in range(channels):
        for first in range(0, samples, _ROWS):
            counts[channel] += _fill(block, by_state, by_parameter, residual, first, channel, rms)
            _reflect(out[channel], block, product)
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
def _reflect(R: Array, block: Array, product: Array) -> None:
    """Reflect the rows of a block into a triangle."""
    w = len(R)
    for j in range(w):
        dots(w - j, _ROWS, block, j * _ROWS, _ROWS, block, j * _ROWS, 0, product, j, 1)
        square = product[j, 0]
        if square == 0.0:
            continue
        diagonal = R[j, j]
        length = math.copysign(math.sqrt(diagonal * diagonal + square), diagonal)
        head = diagonal + length
        R[j, j] = -length
        share = 1.0 / (length * head)
        for k in range(j + 1, w):
            scaled = -(head * R[j, k] + product[k, 0]) * share
            R[j, k] += scaled * head
            product[k, 0] = scaled
        here = (j + 1) * _ROWS
        accumulate(w - j - 1, 1, _ROWS, product, j + 1, 1, block, j * _ROWS, _ROWS, block, here, _ROWS)
