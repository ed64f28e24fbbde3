"""Frequencies of a result in the unit of its scene; files have them in rad/s."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.result import Variable, VariableView
from dynid.units import FrequencyUnit

#: Names of arrays of frequencies, and of groups that hold one with its limits. Angular velocities are none.
_NAMES = frozenset(
    {"omega", "choice_omega", "natural_frequency", "frequency", "frequencies", "reference"}
) | {
    *("frequency_start", "frequency_measured", "frequency_uncertainty", "reference_uncertainty", "counted"),
    *("frequency_standard_error", "bandwidth", "gain_crossover", "phase_crossover"),
    *("peak_frequency", "half_power_low", "half_power_high"),
}


def is_frequency(path: str, variable: Variable) -> bool:
    """Return True for an array of frequencies in rad/s."""
    *_, group, name = ("", *path.split("/"))
    return variable.units == "rad/s" and variable.dtype.kind == "f" and not _NAMES.isdisjoint((group, name))


def in_unit(path: str, variable: Variable, unit: FrequencyUnit) -> Variable:
    """Return an array, of frequencies in a unit."""
    if unit.factor == 1 or not is_frequency(path, variable):
        return variable
    return _Scaled(variable, unit)


class _Scaled(VariableView):
    """An array of frequencies in another unit; values are converted when they are read."""

    _base: Variable
    _factor: float

    def __init__(self, base: Variable, unit: FrequencyUnit) -> None:
        super().__init__(base.dims, unit.name, base.attrs, _base=base, _factor=unit.factor)

    @property
    def data(self) -> NDArray[Any]:
        """All values."""
        return np.asarray(self._base.data * self._factor)

    @property
    def shape(self) -> tuple[int, ...]:
        """The length of every axis."""
        return self._base.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the values."""
        return self._base.dtype

    def blocks(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield all values in pieces that fit the memory."""
        for start, block in self._base.blocks():
            yield start, block * self._factor

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the first axis."""
        return np.asarray(self._base.rows(start, stop) * self._factor)

    def entries(self, start: int, stop: int) -> NDArray[Any]:
        """Return the entries start … stop - 1 along the second axis, of all along the first."""
        return np.asarray(self._base.entries(start, stop) * self._factor)
