"""Memory of laws that follow Masing's rules: the reversals that have not been closed, the last one on top.

A branch ends at a reversal, which opens a loop, or where it meets the branch before the last reversal: the
loop is closed and that branch goes on, as if the loop had never been. On first loading, or where all slip,
the branch backwards is closed by its mirror image. Origin and force of a branch are constant within it; so
are their sensitivities.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.structure.law import Guard, Slopes

# First loading, its mirror image, and a reversal: closing the last of so many leads back to first loading.
_FIRST_LOOPS = 3


class Origin(NamedTuple):
    """Where a branch began: deflection and force, with their slopes (q)."""

    d: float
    f: float
    D: Array
    F: Array


class Memory:
    """The forces at which the branches of laws began (laws), their slopes (laws x q), and the open loops."""

    def __init__(self, laws: int, columns: int) -> None:
        self.f, self.F = np.zeros(laws), np.zeros((laws, columns))
        self.open: list[list[Origin]] = [[] for _ in range(laws)]

    def closing(self, law: int, regime: int, d: Array) -> list[Guard]:
        """Return the guard of an open loop."""
        if not self.open[law]:
            return []
        s, opened = 1.0 - 2 * (regime & 1), self.open[law]
        following = regime & ~4 if len(opened) <= _FIRST_LOOPS else regime
        return [Guard(Slopes(s * (opened[-1].d - d), -s, p=(0.0,) * 5), following)]

    def reverse(self, law: int, *, first: bool, branch: Origin, reversal: Origin) -> None:
        """Open a loop at a reversal of a branch, of first loading with its mirror image."""
        self.open[law].append(branch)
        if first:
            self.open[law].append(
                Origin(2 * branch.d - reversal.d, 0.0, 2 * branch.D - reversal.D, np.zeros_like(branch.F))
            )
        self.f[law], self.F[law] = reversal.f, reversal.F

    def close(self, law: int) -> Origin:
        """Close a loop; return the origin of the branch that goes on."""
        opened = self.open[law]
        place = 0 if len(opened) <= _FIRST_LOOPS else len(opened) - 2
        branch = opened[place]
        del opened[place:]
        self.f[law], self.F[law] = branch.f, branch.F
        return branch
