"""Approximate roots with error estimates: which belong together, which may be one and the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Discs:
    """Roots of a polynomial, one for each multiplicity.

    Parameters
    ----------
    centre
        Approximate roots, rad/s.
    radius
        Estimates of their errors, rad/s; 0 of what is exact.
    residual
        Relative residual of the equations at each, entry by entry: about 1e-16 where the root is exact for
        coefficients that were changed in their last digit.
    """

    centre: NDArray[np.complex128]
    radius: NDArray[np.float64]
    residual: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.centre)

    @classmethod
    def none(cls) -> Discs:
        """Return no roots."""
        return cls(np.zeros(0, dtype=np.complex128), np.zeros(0), np.zeros(0))

    @classmethod
    def joined(cls, parts: list[Discs]) -> Discs:
        """Return the roots of a product."""
        if not parts:
            return cls.none()
        return cls(
            np.concatenate([part.centre for part in parts]),
            np.concatenate([part.radius for part in parts]),
            np.concatenate([part.residual for part in parts]),
        )

    def where(self, mask: NDArray[np.bool_]) -> Discs:
        """Return some of them."""
        return Discs(self.centre[mask], self.radius[mask], self.residual[mask])

    def overlaps(self, other: Discs) -> NDArray[np.bool_]:
        """Tell of every pair whether they may be one root (len(self) x len(other))."""
        apart = np.abs(self.centre[:, None] - other.centre[None, :])
        return apart <= self.radius[:, None] + other.radius[None, :]

    def clusters(self) -> NDArray[np.int64]:
        """Return a number for every root: the same for those that overlap, also by way of others."""
        from scipy.sparse.csgraph import connected_components

        if not len(self):
            return np.zeros(0, dtype=np.int64)
        _, label = connected_components(self.overlaps(self).astype(np.int8), directed=False)
        return np.asarray(label, dtype=np.int64)

    def in_order(self) -> Discs:
        """Return them by modulus, then real part, then imaginary part, conjugates side by side."""
        size = np.abs(self.centre)
        order = np.lexsort((self.centre.imag, self.centre.real, size))
        return Discs(self.centre[order], self.radius[order], self.residual[order])
