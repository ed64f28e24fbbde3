"""Complex numbers in double precision with bounds on their rounding errors."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.program.program import Tape

_UNIT_ROUNDOFF = 2.0**-53
#: Relative rounding error of one complex sum, product and quotient, in units of 2^-53 (Higham 2002, 3.6).
_SUM_ERROR, _PRODUCT_ERROR, _QUOTIENT_ERROR = 1 * _UNIT_ROUNDOFF, 3 * _UNIT_ROUNDOFF, 8 * _UNIT_ROUNDOFF
#: Absolute error of a product or quotient that falls below the range of doubles.
_UNDERFLOW_ERROR = 2.0**-1070


class Bounded:
    """Complex arrays that carry a bound on their own rounding error.

    A pivot that vanishes at some frequency shows as a large bound there, never as a wrong number.
    """

    __slots__ = ("error", "value")

    def __init__(self, value: NDArray[np.complex128], error: NDArray[np.float64] | float) -> None:
        self.value = value
        self.error = error

    @classmethod
    def rounded(cls, value: Any) -> Bounded:
        """Take a number that was rounded once to double precision."""
        value = np.complex128(value)
        return cls(value, _UNIT_ROUNDOFF * np.abs(value))

    def __getitem__(self, key: Any) -> Bounded:
        return Bounded(self.value[key], np.asarray(self.error)[key])

    def __add__(self, other: Bounded) -> Bounded:
        value = self.value + other.value
        return Bounded(value, self.error + other.error + _SUM_ERROR * np.abs(value))

    def __sub__(self, other: Bounded) -> Bounded:
        value = self.value - other.value
        return Bounded(value, self.error + other.error + _SUM_ERROR * np.abs(value))

    def __neg__(self) -> Bounded:
        return Bounded(-self.value, self.error)

    def __mul__(self, other: Bounded | int) -> Bounded:
        if isinstance(other, int):
            return Bounded(self.value * other, self.error * abs(other))
        value = self.value * other.value
        error = np.abs(self.value) * other.error + self.error * (np.abs(other.value) + other.error)
        return Bounded(value, error + _PRODUCT_ERROR * np.abs(value) + _UNDERFLOW_ERROR)

    def __truediv__(self, other: Bounded) -> Bounded:
        value = self.value / other.value
        size = np.abs(other.value) - other.error
        error = (self.error + np.abs(value) * other.error) / np.where(size > 0, size, 0.0)
        return Bounded(value, error + _QUOTIENT_ERROR * np.abs(value) + _UNDERFLOW_ERROR)


def bounded_response(
    tape: Tape, values: Mapping[str, float | Fraction], omega: NDArray[np.float64]
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return registers at s = j omega, and bounds on their errors; both of shape (omega, register)."""
    leaves = {name: Bounded.rounded(float(value)) for name, value in values.items()}
    s = Bounded((1j * omega).astype(np.complex128), np.zeros_like(omega))
    with np.errstate(all="ignore"):  # what overflows has no finite bound
        numbers = tape.run(leaves, s, Bounded(np.ones((), dtype=np.complex128), 0.0))
    response, bounds = (
        np.stack([np.broadcast_to(part, omega.shape) for part in parts], axis=-1)
        for parts in ([number.value for number in numbers], [number.error for number in numbers])
    )
    return response, bounds
