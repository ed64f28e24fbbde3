"""Arrays of residues modulo a prime: nonzero told from zero for many samples of a graph at once."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: A Mersenne prime; products of residues fit into 64 bits.
PRIME = (1 << 31) - 1

Residues = NDArray[np.int64]


class SampledResidues:
    """One residue for every sample.

    Parameters
    ----------
    images
        The residues.
    vanished
        Samples in which something was divided by zero; shared by all numbers of a run, and added to.
    """

    __slots__ = ("images", "vanished")

    def __init__(self, images: Residues, vanished: NDArray[np.bool_]) -> None:
        self.images = images
        self.vanished = vanished

    @classmethod
    def of(cls, values: Sequence[Fraction], vanished: NDArray[np.bool_]) -> SampledResidues:
        """Return the residues of exact values, one a sample."""
        above, below = (
            np.array([part % PRIME for part in parts], dtype=np.int64)
            for parts in ([v.numerator for v in values], [v.denominator for v in values])
        )
        return cls(above, vanished) / cls(below, vanished)

    def _made(self, images: Any) -> SampledResidues:
        return SampledResidues(images % PRIME, self.vanished)

    def __add__(self, other: SampledResidues) -> SampledResidues:
        return self._made(self.images + other.images)

    def __sub__(self, other: SampledResidues) -> SampledResidues:
        return self._made(self.images - other.images)

    def __neg__(self) -> SampledResidues:
        return self._made(-self.images)

    def __mul__(self, other: SampledResidues | int) -> SampledResidues:
        return self._made(self.images * (other % PRIME if isinstance(other, int) else other.images))

    def __truediv__(self, other: SampledResidues) -> SampledResidues:
        self.vanished |= other.images == 0
        inverse, power, exponent = np.ones_like(other.images), other.images, PRIME - 2
        while exponent:  # Fermat: x^(p - 2) is 1/x
            if exponent & 1:
                inverse = inverse * power % PRIME
            power, exponent = power * power % PRIME, exponent >> 1
        return self._made(self.images * inverse)
