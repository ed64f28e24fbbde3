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

from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.factorisation import BACKENDS, Factor, factorise
from dynid.structure.inertia import eigenvalues_below
from dynid.structure.modes.lanczos import largest
from dynid.structure.modes.pencil import Pencil

Array = NDArray[np.float64]

_ATTEMPTS = 6
# Modes computed above those asked for, to find a gap; and the relative gap wide enough to count in.
_SPARE, _GAP = 1, 1e-6
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
        self._shift = self.pencil.shift

    def lowest(self, count: int, *, proof: bool) -> tuple[Array, Array, float]:
        """Return the lowest pairs, and the value below which a count proved that none is missing (or 0).

        Raises
        ------
        UsageError
            If there are not so many finite ones.
        NumericalError
            If modes stay missing, or cannot be counted.
        """
        self._extend(count + _SPARE)
        for _ in range(_ATTEMPTS):
            if len(self.square) < count:
                raise too_many(count, len(self.square))
            if not proof:
                return self.square[:count], self.shapes[:, :count], 0.0
            position = self._gap(count)
            if position is None:
                self._extend(2 * len(self.square))
                continue
            value = np.inf
            if position < len(self.square):
                missing, value = self._missing_below(self.square[position - 1 : position + 1].mean())
                if missing:
                    self._extend(len(self.square) + missing)
                    continue
            return self.square[:count], self.shapes[:, :count], value
        raise _stay_missing(self.backend)

    def below(self, limit: float) -> tuple[Array, Array, float]:
        """Return all pairs below a limit, and the limit, nudged if it hits an eigenvalue.

        Raises
        ------
        NumericalError
            If modes stay missing, or cannot be counted.
        """
        count, limit = self._count(limit)
        if count:
            self._extend(count)
        for _ in range(_ATTEMPTS):
            found = int(np.count_nonzero(self.square < limit))
            if found == count:
                return self.square[:count], self.shapes[:, :count], limit
            if found > count:
                break
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
        self.square, mixed = eigh(shapes.T @ (self.K @ shapes), shapes.T @ (self.M @ shapes))
        self.shapes = shapes @ mixed

    def _shifted(self) -> tuple[Factor, float]:
        """Factorise the stiffness, shifted by a little mass."""
        for times in _SHIFTS:
            shift = times * self.pencil.shift
            try:
                return factorise(self.K + shift * self.M, self.backend, definite=True), shift
            except Singular:
                continue
        raise Singular(
            "the stiffness matrix is indefinite, or a motion has neither inertia nor stiffness",
            remedy="Check signs and units of the stiffness; give massless DOFs mass, or join them.",
        )

    def _gap(self, count: int) -> int | None:
        """Return after how many pairs, at least `count`, a gap is wide; None if there is none so far."""
        step = np.diff(self.square[count - 1 :])
        wide = step > _GAP * (np.abs(self.square[count:]) + 1e3 * self._shift)
        if wide.any():
            return count + int(np.argmax(wide))
        return len(self.square) if self.exhausted else None

    def _missing_below(self, value: float) -> tuple[int, float]:
        """Return how many pairs below a value are missing, and the value."""
        counted, value = self._count(value)
        missing = counted - int(np.count_nonzero(self.square < value))
        if missing < 0:
            raise _stay_missing(self.backend)
        return missing, value

    def _count(self, value: float) -> tuple[int, float]:
        self._factor = None  # two factorisations at a time would double the memory
        backend = self.backend if BACKENDS[self.backend].indefinite else "splu"
        return eigenvalues_below(self.K, self.M, value, backend)


def too_many(count: int, finite: int) -> UsageError:
    """Return the refusal of more modes than there are."""
    return UsageError(
        f"{count} modes are asked for, but the structure has {finite} with finite frequencies",
        remedy="Ask for fewer; massless DOFs add none.",
        names=("modes",),
    )


def _stay_missing(backend: str) -> NumericalError:
    return NumericalError(
        f"the modes computed and the modes counted disagree (factorisation backend {backend})",
        remedy="Use another backend, or ask for another number of modes.",
    )
