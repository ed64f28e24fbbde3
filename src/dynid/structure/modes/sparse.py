"""The lowest modes of large structures: shift-invert Lanczos, and a count that proves none is missing.

The shift is negative, so that the shifted stiffness is definite with rigid bodies too. Below a limit the
modes are counted first, by signs of pivots, and so many are computed; a given number of modes is computed
with a few more, and counted in a gap above the last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_array

from dynid.errors import NumericalError, Singular
from dynid.structure.factorisation import BACKENDS, Factor, factorise
from dynid.structure.inertia import eigenvalues_below
from dynid.structure.modes.lanczos import largest
from dynid.structure.modes.pencil import Pencil, times
from dynid.structure.modes.solution import too_many

Array = NDArray[np.float64]

_ATTEMPTS = 6
# Modes computed above those asked for, to find a gap; and the relative gap wide enough to count in.
_SPARE, _GAP = 1, 1e-6
# A body has six rigid motions at most: of one pair more one is elastic, which tells how far the others are.
_RIGID = 6
# Relative distance of a limit to a mode at which rounding decides on which side of it the mode lies.
_HIT = 1e-8
# Shifts tried, relative to the pencil's: the first that leaves the stiffness definite and well enough posed.
_SHIFTS = (1.0, 1e3, 1e6)


@dataclass(eq=False)
class Spectrum:
    """The lowest eigenpairs of a sparse pencil, ascending; more are added beside those found.

    `square` (pairs) are eigenvalues, `shapes` (n x pairs) scaled eigenvectors of unit modal mass.
    """

    pencil: Pencil
    backend: str
    seed: int = 0

    def __post_init__(self) -> None:
        self.K, self.M = csc_array(self.pencil.K), csc_array(self.pencil.M)
        self.square, self.shapes = np.zeros(0), np.zeros((self.pencil.size, 0))
        self.exhausted = False
        self._rng = np.random.Generator(np.random.PCG64(self.seed))
        self._factor: Factor | None = None
        self._shift = self._first_shift = self.pencil.shift

    def lowest(self, count: int, *, proof: bool) -> tuple[Array, Array, float]:
        """Return the lowest pairs, and the value below which a count proved that none is missing (or 0).

        There may be some more than asked for.

        Raises
        ------
        UsageError
            If there are not so many finite ones.
        NumericalError
            If modes stay missing, or cannot be counted.
        """
        self._extend(count + _SPARE)
        if len(self.square) <= _RIGID and self.square.max(initial=0.0) < self._shift:
            self._extend(_RIGID + _SPARE)
        value = self._proved(count) if proof else 0.0
        if len(self.square) < count:
            raise too_many(count, len(self.square))
        return self.square, self.shapes, value

    def below(self, limit: float) -> tuple[Array, Array, float]:
        """Return all pairs below a limit, and the limit, nudged if it hits an eigenvalue.

        Raises
        ------
        NumericalError
            If modes stay missing, or cannot be counted.
        """
        self._first_shift = min(limit, self.pencil.shift)  # from far below, all of them would look alike
        count, limit = self._count(limit)
        for _ in range(_ATTEMPTS):
            found = int(np.count_nonzero(self.square < limit))
            if np.any(np.abs(self.square - limit) <= _HIT * limit):  # copies may lie on either side
                count, limit = self._count(limit * (1 + 10 * _HIT))
            elif found == count:
                return self.square[:count], self.shapes[:, :count], limit
            elif found > count:
                break
            else:
                self._extend(len(self.square) + count - found)
        raise _stay_missing(self.backend)

    def _extend(self, count: int) -> None:
        """Compute at least so many pairs, as far as there are so many (Rayleigh–Ritz at the end)."""
        from scipy.linalg import eigh

        if self._factor is None:
            self._factor, self._shift = self._shifted()
        known = (1 / (self.square + self._shift), self.shapes) if len(self.square) else None
        theta, shapes = largest(self._factor.solve, self.M, count, self._rng, known)
        self.exhausted = len(theta) < count
        if self.exhausted and len(theta) == 0:
            return
        self.square, mixed = eigh(shapes.T @ times(self.K, shapes), shapes.T @ times(self.M, shapes))
        self.shapes = shapes @ mixed

    def _shifted(self) -> tuple[Factor, float]:
        """Factorise the stiffness, shifted by a little mass."""
        for factor in _SHIFTS:
            shift = factor * self._first_shift
            try:
                return factorise(self.K + shift * self.M, self.backend, definite=True), shift
            except Singular:
                continue
        raise Singular(
            "the stiffness matrix is indefinite, or a motion has neither inertia nor stiffness",
            remedy="Check signs and units of the stiffness; give massless DOFs mass, or join them.",
        )

    def _proved(self, count: int) -> float:
        """Find what is missing of so many pairs; return the value below which none is, in a gap above."""
        for _ in range(_ATTEMPTS):
            gap = self._gap(min(count, len(self.square)))
            if gap is None:
                self._extend(2 * len(self.square))
                continue
            counted, value = self._count(gap)
            missing = counted - int(np.count_nonzero(self.square < value))
            if missing == 0:
                return value
            if missing < 0:
                break
            self._extend(len(self.square) + missing)
        raise _stay_missing(self.backend)

    def _gap(self, count: int) -> float | None:
        """Return a value in a wide gap above so many pairs; None if there is no gap so far."""
        tail = self.square[max(count - 1, 0) :]
        wide = np.diff(tail) > _GAP * (np.abs(tail[1:]) + 1e3 * self._shift)
        if wide.any():
            first = int(np.argmax(wide))
            return float(tail[first : first + 2].mean())
        above = 4 * (float(np.abs(self.square).max(initial=0.0)) + self._shift)
        return above if self.exhausted else None

    def _count(self, value: float) -> tuple[int, float]:
        self._factor = None  # two factorisations at a time would double the memory
        backend = self.backend if BACKENDS[self.backend].indefinite else "splu"
        return eigenvalues_below(self.K, self.M, value, backend)


def _stay_missing(backend: str) -> NumericalError:
    return NumericalError(
        f"the modes computed and the modes counted disagree (factorisation backend {backend})",
        remedy="Use another backend, or ask for another number of modes.",
    )
