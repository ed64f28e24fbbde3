"""Complex arrays that carry a bound on their own rounding error.

Running the reduction on them gives a frequency response and, point by point, how far it can be off; a
pivot that vanishes at some frequency shows as a large bound there, never as a wrong number.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_UNIT = 2.0**-53
#: Relative rounding error of one complex sum, product and quotient, in units of 2^-53 (Higham 2002, 3.6).
_SUM, _PRODUCT, _QUOTIENT = 1 * _UNIT, 3 * _UNIT, 8 * _UNIT
#: Absolute error of a product or quotient that falls below the range of doubles.
_UNDERFLOW = 2.0**-1070


class Bounded:
    """Values with error bounds.

    Parameters
    ----------
    value
        Complex numbers of any shape.
    error
        Bound on the absolute error of each.
    """

    __slots__ = ("error", "value")

    def __init__(self, value: NDArray[np.complex128], error: NDArray[np.float64] | float) -> None:
        self.value = value
        self.error = error

    @classmethod
    def rounded(cls, value: Any) -> Bounded:
        """Take a number that was rounded once to double precision."""
        value = np.complex128(value)
        return cls(value, _UNIT * np.abs(value))

    def __getitem__(self, key: Any) -> Bounded:
        return Bounded(self.value[key], np.asarray(self.error)[key])

    def __add__(self, other: Bounded) -> Bounded:
        value = self.value + other.value
        return Bounded(value, self.error + other.error + _SUM * np.abs(value))

    def __sub__(self, other: Bounded) -> Bounded:
        value = self.value - other.value
        return Bounded(value, self.error + other.error + _SUM * np.abs(value))

    def __neg__(self) -> Bounded:
        return Bounded(-self.value, self.error)

    def __mul__(self, other: Bounded | int) -> Bounded:
        if isinstance(other, int):
            return Bounded(self.value * other, self.error * abs(other))
        value = self.value * other.value
        error = np.abs(self.value) * other.error + self.error * (np.abs(other.value) + other.error)
        return Bounded(value, error + _PRODUCT * np.abs(value) + _UNDERFLOW)

    def __truediv__(self, other: Bounded) -> Bounded:
        value = self.value / other.value
        size = np.abs(other.value) - other.error
        error = (self.error + np.abs(value) * other.error) / np.where(size > 0, size, 0.0)
        return Bounded(value, error + _QUOTIENT * np.abs(value) + _UNDERFLOW)
