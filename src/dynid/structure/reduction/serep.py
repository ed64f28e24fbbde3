"""SEREP: the system equivalent reduction expansion process, on modes that are selected by number.

Sources: K. T. Yang 1997, eqs 4–9; J. O'Callahan, P. Avitabile & R. Riemer, IMAC 1989.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynid.lti.floating import guarded
from dynid.structure.matrices import Array, Label, Matrix, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.modes.pencil import scaled
from dynid.structure.reduction.masters import Indices, Masters, checked_condition, indices_of
from dynid.structure.reduction.reduction import Reduction, interesting, masters_for_modes, without_rounding
from dynid.structure.reduction.selection import (
    Interest,
    ModeRange,
    Selected,
    fixed_count,
    mode_rule,
    selected,
    wanted_modes,
)


@dataclass(frozen=True)
class Serep:
    """SEREP on modes of the structure without its joints (Yang, eqs 2, 4–9).

    With as many masters as modes the coordinates are the masters' displacements: ``T = U U_m^-1`` (eq 8).
    With more masters ``T = U U_m^+`` (eq 7) would have dependent columns, and eq 9 a singular mass: the
    coordinates are then the modal ones, ``T = U``, and the masters those displacements that determine them.
    Both span the same motions, so that the models agree.

    Parameters
    ----------
    masters
        Labels, or a rule to choose by (`Masters`). Absent: the DOFs of joints, sensors and loads, with
        others where these do not see all the modes.
    modes
        Numbers from 1, rigid-body modes included, or a range (`ModeRange`). Absent: one a master; with no
        masters either, all of the band; without a band, one a DOF of joints, sensors and loads.
    interest
        What the model is for.
    """

    masters: Sequence[Label] | Masters | None = None
    modes: Sequence[int] | ModeRange | None = None
    interest: Interest = field(default_factory=Interest)

    def reduce(self, model: StructuralModel) -> Reduction:
        """Reduce a structure.

        Raises
        ------
        UsageError
            If masters or modes do not exist, stand twice, or the modes are more than the masters.
        Singular
            If a mode is invisible at the masters.
        """
        return on_modes(model, None, self.masters, self.modes, self.interest)


@guarded("the reduction on modes")
def on_modes(
    model: StructuralModel,
    values: Mapping[str, float] | None,
    masters: Sequence[Label] | Masters | None,
    modes: Sequence[int] | ModeRange | None,
    interest: Interest,
) -> Reduction:
    """Reduce a structure on modes without its joints; or with these, at `values` of the unknown ones."""
    matrices = (model.M, model.C, model.K) if values is None else model.with_joints(values)
    retained = values is not None or not model.joints
    if masters is not None and not isinstance(masters, Masters):
        indices_of(model, masters)  # what is wrong with them is said before the modes are computed
    count = fixed_count(masters)
    if count is None and interest.band is None:
        count = len(interesting(model, interest)) or None
    basis = selected(matrices, wanted_modes(modes, interest, count))
    kept = masters_for_modes(model, masters, interest, basis.shapes)
    labels = tuple(model.dofs[k] for k in kept)
    seen = basis.shapes[kept]
    whole = basis.shapes / scaled(matrices[2], matrices[0]).scale[:, None]
    share = whole[kept] / np.linalg.norm(whole, axis=0)
    condition = checked_condition(seen, share, basis.numbers, labels)
    T, inverse, names = _coordinates(basis, kept, labels)
    rigid = basis.rigid if retained and len(kept) != len(basis.numbers) else ()
    reduced = _projected(model.projected(T, names, rigid), values, matrices, basis, inverse)
    rule = mode_rule(modes, interest, count)
    return Reduction(
        reduced, labels, basis.numbers, condition, retained=retained, rule=rule, doubt=basis.doubt
    )


def _coordinates(
    basis: Selected, kept: Indices, labels: tuple[Label, ...]
) -> tuple[Array, Array, tuple[Label, ...]]:
    """Return T, the modes in the coordinates, and the names of these: as many masters, else the modes."""
    if len(kept) != len(basis.numbers):
        names = tuple(f"mode_{number}" for number in basis.numbers)
        return basis.shapes, np.eye(len(basis.numbers)), names
    inverse = np.asarray(np.linalg.inv(basis.shapes[kept]), dtype=np.float64)
    T = basis.shapes @ inverse
    T[kept] = np.eye(len(kept))
    return T, inverse, labels


def _projected(
    reduced: StructuralModel,
    values: Mapping[str, float] | None,
    matrices: tuple[Matrix, Matrix, Matrix],
    basis: Selected,
    inverse: Array,
) -> StructuralModel:
    """Project the stiffness (eq 9) by what the modes say of it: ``U^T K U = U^T M U Omega^2``.

    The product loses as many digits as the stiffness is worse conditioned than its low modes; the
    frequencies do not. What joints are in the modes' stiffness is taken off again.
    """
    energy = basis.shapes.T @ np.asarray(matrices[0] @ basis.shapes) * basis.omega**2
    assert reduced.basis is not None
    K = without_rounding(inverse.T @ energy @ inverse, reduced.basis.T, matrices[2])
    if values is not None:
        joints = replace(reduced, K=np.zeros_like(reduced.K)).with_joints(values)[2]
        K = K - as_array(joints)
    return replace(reduced, K=(K + K.T) / 2)
