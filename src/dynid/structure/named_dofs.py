"""Names of what moves in a structure: DOFs, nodes with directions, motions, DOFs of the full model."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure import labels
from dynid.structure.labels import Label

Motion: TypeAlias = Mapping[Label, float]
"""A weighted sum of displacements: weights by the DOFs' own labels; a force on it has the same weights."""


class NamedDofs:
    """What can be named in a structure: its DOFs, weighted sums of them, and all DOFs of the full model."""

    dofs: tuple[Label, ...]  # labels of the DOFs, or of the coordinates of a reduced model (n)
    basis: Any  # of a reduced model, the way back to all DOFs (`structure.model.Basis`)
    motions: Mapping[str, Motion]  # named weighted sums of the full model's DOFs
    translations: bool  # True where DOFs whose labels have no direction are translations

    @property
    def size(self) -> int:
        """Number of DOFs."""
        return len(self.dofs)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Of each DOF ``translation``, ``rotation`` or ``unknown``."""
        return tuple(self.kind(label) for label in self.dofs)

    def kind(self, dof: Label) -> str:
        """Return ``translation``, ``rotation`` or ``unknown`` of a DOF of the full model or a motion.

        A sum of displacements and of rotations times lengths is a translation.

        Raises UsageError if there is no such DOF.
        """
        kinds = {labels.kind(label) for label in self.moved_by(dof)}
        if "unknown" in kinds and not self._full.translations:
            return "unknown"
        return "rotation" if kinds == {"rotation"} else "translation"

    def label(self, dof: Label) -> Label:
        """Return the own label of a DOF, or the name of a motion.

        A DOF is named by its label, by ``NODE:DIR``, or where labels are texts by number. Numbers are those
        of the full model, in a reduced one as well.

        Raises UsageError if there is no such DOF, or the name has a sign.
        """
        if dof in self._places:
            return dof
        return self.dof_names.find(dof) if self.basis is None else self.basis.parent.label(dof)

    def index(self, dof: Label) -> int:
        """Return the place of a DOF, from 0.

        Raises UsageError if there is no such DOF, it is a motion, or a reduction has not kept it as a
        coordinate.
        """
        label = self.label(dof)
        at = self._places.get(label)
        if at is None and label in self.motions:
            raise UsageError(
                f"'{label}' is a weighted sum of DOFs; a single one is needed here", names=(str(dof),)
            )
        if at is None:
            raise UsageError(
                f"DOF {dof} is no coordinate of the reduced model",
                remedy=f"It has {labels.listed(self.dofs)}.",
                names=(str(dof),),
            )
        return at

    def moved_by(self, dof: Label) -> tuple[Label, ...]:
        """Return the own labels of the DOFs in a displacement: of a motion several, whatever the sign.

        Raises UsageError if there is no such DOF.
        """
        if dof in self._places:
            return (dof,)
        _, label = self.dof_names.find_signed(dof)
        return tuple(self.motions.get(str(label), (label,)))

    def row(self, dof: Label) -> Array:
        """Return the row (n) that reads the displacement of a DOF; also the direction of a force on it.

        `dof`: its own label, ``NODE:DIR``, or a motion. A sign (``20:-z``) reverses it. In a reduced model
        any DOF of the model it was made from can be named. Raises UsageError if there is no such DOF.
        """
        row = np.zeros(self.size)
        if dof in self._places:
            row[self._places[dof]] = 1.0
        elif self.basis is not None:
            sign, label = self.dof_names.find_signed(dof)
            if label not in self._places:
                return np.asarray(self.basis.parent.row(dof) @ self.basis.T)
            row[self._places[label]] = sign
        else:
            sign, label = self.dof_names.find_signed(dof)
            for moved, weight in self._weights(label).items():
                row[self._places[moved]] += sign * weight
        return row

    def _weights(self, label: Label) -> Motion:
        """Return the weights, by the DOFs' own labels, of a DOF of the full model or a motion."""
        return {label: 1.0} if label in self._places else self.motions[str(label)]

    def expand(self, q: Array) -> Array:
        """Return the motion (N or N x m) of all DOFs of the full model, for coordinates q (n or n x m)."""
        if self.basis is None:
            return q
        return np.asarray(self.basis.parent.expand(self.basis.T @ q))

    @cached_property
    def _places(self) -> dict[Label, int]:
        return {label: index for index, label in enumerate(self.dofs)}

    @cached_property
    def dof_names(self) -> labels.DofNames:
        """The names of the full model's DOFs and motions."""
        return labels.DofNames(self.dofs, self.motions) if self.basis is None else self.basis.parent.dof_names

    @property
    def _full(self) -> NamedDofs:
        """The model that reductions started from."""
        return self if self.basis is None else self.basis.parent._full

    def _check_motions(self) -> None:
        full_places = self._full._places
        for name, motion in self.motions.items():
            if name in full_places:
                raise UsageError(f"'{name}' is a DOF, and cannot name a motion", names=(name,))
            missing = next((label for label in motion if label not in full_places), None)
            if missing is not None or not np.isfinite(list(motion.values())).all():
                said = "weights that are no numbers" if missing is None else f"no DOF: {missing}"
                raise UsageError(f"the motion '{name}' names {said}", names=(name,))
