"""Modal truncation with residual vectors, and component mode synthesis with fixed interfaces.

Sources: T. G. Dickens, J. M. Nakagawa & M. J. Wittbrodt, *Computers & Structures* 62 (1997) 985–998; R. R.
Craig & M. C. C. Bampton, AIAA J. 6 (1968) 1313–1319.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np

from dynid.arrays import Array, guarded
from dynid.errors import Singular, UsageError
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix
from dynid.structure.model import StructuralModel
from dynid.structure.modes import remembered_modes
from dynid.structure.reduction.condensation import SLAVES, OnMasters, Partition, constraint_modes, solver
from dynid.structure.reduction.masters import Indices, indices_of, interesting
from dynid.structure.reduction.mode_selection import (
    Interest,
    ModeRange,
    SelectedModes,
    mode_rule,
    selected,
    wanted_modes,
)
from dynid.structure.reduction.reduced_model import StructuralReduction, projected

Residuals: TypeAlias = Sequence[Label] | Literal["auto"]
"""DOFs whose loads get residual vectors; ``auto``: those of joints, sensors and loads."""

# The shift that holds rigid-body modes, relative to the square of the lowest elastic frequency.
_SHIFT, _RAISED = 1e-4, 100.0
# A residual vector that the modes span but for this part of its energy is none.
_SPANNED = 1e-12


@dataclass(frozen=True)
class ModalTruncation:
    """Modes of the structure with its known joints, and the static response to loads that they leave out.

    Coordinates are modal ones; residual vectors are scaled to unit stiffness. They make the model exact at
    rest for loads on their DOFs, joints' forces included.

    `modes`: numbers from 1, rigid-body modes included, or a range. Default: those of the band. `residuals`:
    DOFs whose loads get residual vectors; ``auto``: those of joints, sensors and loads; none: ``()``;
    `interest`: purpose of the model.
    """

    modes: Sequence[int] | ModeRange | None = None
    residuals: Residuals = "auto"
    interest: Interest = field(default_factory=Interest)

    @guarded("the modal reduction")
    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure.

        Raises UsageError if modes or DOFs do not exist or stand twice.
        """
        matrices = model.with_known_joints()
        return on_modes_and_residuals(
            model, matrices, self.modes, self.residuals, self.interest, retained=not model.joint_unknowns
        )


def on_modes_and_residuals(
    model: StructuralModel,
    matrices: tuple[Matrix, Matrix, Matrix],
    modes: Sequence[int] | ModeRange | None,
    residuals: Residuals,
    interest: Interest,
    *,
    retained: bool,
) -> StructuralReduction:
    """Reduce a structure on modes and residual vectors of `matrices`: M, C, K with all joints, or with some.

    `retained` says that all joints are in them.
    """
    if isinstance(residuals, str):
        loads = interesting(model, interest)
    else:
        loads = indices_of(model, residuals, "residuals") if residuals else np.array([], dtype=np.int64)
    basis = selected(matrices, wanted_modes(modes, interest, None))
    extra = _residuals(matrices, basis, loads)
    names = [f"mode_{number}" for number in basis.numbers]
    names += [f"residual_{k}" for k in range(1, extra.shape[1] + 1)]
    T = np.concatenate([basis.shapes, extra], axis=1)
    rule = mode_rule(modes, interest, None)
    reduced = projected(model, T, names, basis.rigid if retained else ())
    return StructuralReduction(reduced, (), basis.numbers, retained=retained, rule=rule, doubt=basis.doubt)


def _residuals(matrices: tuple[Matrix, Matrix, Matrix], basis: SelectedModes, loads: Indices) -> Array:
    """Return static responses to unit loads beyond the modes, of unit stiffness and orthogonal (n x k)."""
    if not len(loads):
        return basis.shapes[:, :0]
    M, held, solve = matrices[0], *_held(matrices, basis)
    forces = np.zeros((len(basis.shapes), len(loads)))
    forces[loads, np.arange(len(loads))] = 1.0
    X = solve(forces)
    energy = (X * np.asarray(held @ X)).sum(axis=0)
    X = X / np.sqrt(energy)
    for _ in range(2):  # twice is enough
        X = X - basis.shapes @ (basis.shapes.T @ (M @ X))
    values, vectors = np.linalg.eigh(X.T @ (held @ X))
    kept = values > _SPANNED
    return np.asarray(X @ (vectors[:, kept] / np.sqrt(values[kept])))


def _held(
    matrices: tuple[Matrix, Matrix, Matrix], basis: SelectedModes
) -> tuple[Matrix, Callable[[Array], Array]]:
    """Return the stiffness, of a free structure shifted by a little mass, and a solver with it."""
    M, _, K = matrices
    what = "the static response does not exist", "Check the stiffness of massless DOFs."
    if not basis.free:
        try:
            return K, solver(K, *what).solve
        except Singular:  # so soft a mode that rounding leaves it open
            pass
    largest = float(np.abs(K.diagonal()).max() / max(np.abs(M.diagonal()).max(), 1e-300))
    shift = _SHIFT * (basis.elastic**2 or 1e-8 * largest)
    held: Any = K + shift * M
    try:
        return held, solver(held, *what).solve
    except Singular:  # beside a soft spring so small a shift is rounding of the stiffness
        held = K + _RAISED * shift * M
        return held, solver(held, *what).solve


@dataclass(frozen=True)
class CraigBampton(OnMasters):
    """Static condensation on the boundary, with modes of the structure whose boundary is held.

    Exact for any joint between boundary DOFs as all modes are taken. Coordinates are the boundary's
    displacements, then the modal ones of the fixed-interface modes.

    `masters`: the boundary: labels, or a rule to choose by. Default: the DOFs of joints, sensors and loads.
    `modes`: fixed-interface modes: numbers or a range; a count of 0 is static condensation. Default: those of
    the band. `interest`: purpose of the model.
    """

    modes: Sequence[int] | ModeRange | None = None

    @guarded("the Craig–Bampton reduction")
    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure.

        Raises UsageError if masters or modes do not exist or stand twice, and Singular if the inside is not
        held by the boundary.
        """
        cut = self.partition(model)
        labels, (slaves, inverse) = cut.labels(model), constraint_modes(model, cut)
        condition, requested = inverse.condition, wanted_modes(self.modes, self.interest, None)
        with remembered_modes() as memory:  # the modes use the factors of the constraint modes
            memory.inverse = inverse.factors
            del inverse
            fixed = None if requested == ModeRange(count=0) else self._fixed_modes(cut, model, requested)
            memory.inverse = None
        names, numbers, rule, doubt = labels, tuple[int, ...](), "", ""
        if fixed is not None:
            numbers, doubt = fixed.numbers, fixed.doubt
            names = (*labels, *(f"fixed_mode_{number}" for number in numbers))
            rule = f"fixed-interface modes: {mode_rule(self.modes, self.interest, None)}"
            # Of unit size at their largest, like the boundary's coordinates.
            slaves = np.concatenate([slaves, fixed.shapes / np.abs(fixed.shapes).max(axis=0)], axis=1)
        reduced = projected(model, cut.basis(slaves), names)
        return StructuralReduction(
            reduced, labels, numbers, condition, rule=rule, doubt=doubt, inverted=SLAVES
        )

    def _fixed_modes(
        self, cut: Partition, model: StructuralModel, requested: Sequence[int] | ModeRange
    ) -> SelectedModes | None:
        """Return the modes with the boundary held; None where none is in the band."""
        if not len(cut.slaves):
            return None
        M, C, K = (cut.inner(matrix) for matrix in model.with_known_joints())
        try:
            return selected((M, C, K), requested)
        except UsageError:
            if self.modes is not None:
                raise
            return None
