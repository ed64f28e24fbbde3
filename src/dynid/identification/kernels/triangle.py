"""The triangular factor of many rows, as a kernel; see `information.triangle`."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dynid.identification.kernels.compile import kernel
from dynid.identification.kernels.lanes import accumulate, dots

Array = NDArray[np.float64]

# Rows that are reflected at once: a whole number of registers.
_ROWS = 64


@kernel
def triangles(rows: Array) -> Array:
    """Return the triangular factor (channels x w x w) of the rows (times x channels x w) of each channel.

    Blocks of rows are reflected into the triangle of those before them (Householder).
    """
    samples, channels, w = rows.shape
    out = np.zeros((channels, w, w))
    block, product = np.zeros((w, _ROWS)), np.zeros((w, 1))
    for channel in range(channels):
        R = out[channel]
        for first in range(0, samples, _ROWS):
            count = min(_ROWS, samples - first)
            for c in range(w):
                for r in range(count):
                    block[c, r] = rows[first + r, channel, c]
                for r in range(count, _ROWS):
                    block[c, r] = 0.0
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
                accumulate(
                    w - j - 1, 1, _ROWS, product, j + 1, 1, block, j * _ROWS, _ROWS, block, here, _ROWS
                )
    return out
