"""Dimensions with their labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.checks.comparison import RTOL
from dynid.result import Variable


@dataclass(frozen=True)
class Axis:
    """A dimension with its labels; without a coordinate, the entries' numbers from 1."""

    dim: str
    labels: NDArray[Any]
    units: str = ""

    def find(self, label: Any) -> int | None:
        """Return the place of a label: a text as it is, a number to rounding."""
        if self.labels.dtype.kind == "O" or isinstance(label, str):
            hits = [place for place, own in enumerate(self.labels) if own == label]
        else:
            hits = list(np.flatnonzero(np.isclose(self.labels, label, rtol=RTOL, atol=0)))
        return int(hits[0]) if hits else None


def axis_of(result: Mapping[str, Variable], path: str, dim: str, length: int) -> Axis:
    """Return a dimension of an array, with the coordinate in its group or the nearest one above."""
    group = path
    while group:
        group = group.rpartition("/")[0]
        coordinate = result.get(f"{group}/{dim}" if group else dim)
        if coordinate is not None and coordinate.dims == (dim,):
            if coordinate.shape == (length,) and not coordinate.dtype.names:
                return Axis(dim, coordinate.data, coordinate.units)
            break
    return Axis(dim, np.arange(1, length + 1))
