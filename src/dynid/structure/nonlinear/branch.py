"""States along a branch that an evaluation leaves for the next one, at other values of the parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array

# Largest relative change of the frequencies or amplitudes at which states are continued.
_SAME = 1e-3


class State(NamedTuple):
    """A periodic motion: unknowns (N), hidden states of the laws, derivatives of the unknowns (N x p)."""

    u: Array
    hidden: tuple[tuple[float, int] | None, ...]
    by_parameter: Array


@dataclass
class Branch:
    """The states of the last evaluation at measured frequencies or amplitudes `at`, with its `values` (p)."""

    values: Array = field(default_factory=lambda: np.zeros(0))
    at: Array = field(default_factory=lambda: np.zeros(0))
    states: list[State] = field(default_factory=list)

    def predicted(self, values: Array, at: Array) -> list[Array]:
        """Return the unknowns at other values, to first order; none where these are of other parameters."""
        same = len(self.states) == len(at) and self.values.shape == values.shape
        if not (same and np.allclose(self.at, at, rtol=_SAME)):
            return []
        return [state.u + state.by_parameter @ (values - self.values) for state in self.states]
