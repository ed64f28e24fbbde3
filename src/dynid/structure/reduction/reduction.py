"""What every reduction method returns, and the masters where none are given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.errors import UsageError
from dynid.structure.matrices import Array, Label, Matrix, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.masters import Indices, Masters, chosen, completed, indices_of
from dynid.structure.reduction.selection import Interest, ModeRange, selected, wanted_modes

# What rounding leaves of a sum of positive and negative terms, relative to their sizes.
_ROUNDING = 16 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Reduction:
    """A reduced model and how it came about.

    Attributes
    ----------
    model
        The reduced model; it expands back to all DOFs (``model.expand``).
    masters
        Labels of the masters.
    modes
        Numbers of the modes that the basis is made of: of the structure that the method takes them from.
    condition
        Condition of the modes at the masters, where masters stand for modes.
    rule
        How they were chosen, in words; empty of a method without modes.
    retained
        Whether these modes are those of the structure with its joints, so that the reduced model has them.
    doubt
        Which of these modes rounding leaves open, in words; empty where it leaves none.
    """

    model: StructuralModel
    masters: tuple[Label, ...] = ()
    modes: tuple[int, ...] = ()
    condition: float | None = None
    retained: bool = False
    rule: str = ""
    doubt: str = ""

    @property
    def T(self) -> Array:
        """The basis (n x r)."""
        assert self.model.basis is not None
        return self.model.basis.T


def projected(
    model: StructuralModel, T: Array, names: Sequence[Label], rigid: Sequence[int] = ()
) -> StructuralModel:
    """Project a structure; stiffness that is rounding of the sum it is made of is taken for none.

    Rigid-body motions stay such in the reduced model, where nothing tells the size of that sum any more.

    Parameters
    ----------
    model
        The full structure.
    T
        The basis (n x r).
    names
        Labels of the coordinates (r).
    rigid
        Those in which the structure with its joints moves as a rigid body.
    """
    reduced = model.projected(T, names, rigid)
    return replace(reduced, K=without_rounding(as_array(reduced.K), T, model.K))


def without_rounding(reduced: Array, T: Array, K: Matrix) -> Array:
    """Return a projected stiffness without what is rounding of ``|T|^T |K| |T|``, motions and coordinates."""
    parts = np.einsum("ij,ij->j", np.abs(T), np.asarray(abs(K) @ np.abs(T)))
    size = np.sqrt(np.where(parts > 0, parts, 1.0))
    values, vectors = np.linalg.eigh((reduced + reduced.T) / 2 / size / size[:, None])
    if values[0] > _ROUNDING:
        return np.asarray((reduced + reduced.T) / 2)
    root = size[:, None] * vectors * np.sqrt(np.where(values > _ROUNDING, values, 0.0))
    stiff = (root**2).sum(axis=1) > _ROUNDING * parts
    return np.asarray(np.where(np.outer(stiff, stiff), root @ root.T, 0.0))


def with_known_joints(model: StructuralModel) -> tuple[Matrix, Matrix, Matrix]:
    """Return M, C and K with the joints that are known; unknown ones are left out."""
    return model.with_joints({unknown.name: 0.0 for unknown in model.unknowns})


def masters_for_modes(
    model: StructuralModel, given: Sequence[Label] | Masters | None, interest: Interest, shapes: Array
) -> Indices:
    """Return masters that shall see these modes.

    Parameters
    ----------
    model
        The full structure.
    given
        Labels, or a rule to choose by. Absent: the DOFs of joints, sensors and loads, and as many others as
        it takes to see all the modes.
    interest
        The DOFs of sensors and loads.
    shapes
        The modes (n x r).
    """
    if given is None:
        return completed(interesting(model, interest), shapes)
    if isinstance(given, Masters):
        return chosen(given.choose, given.count or shapes.shape[1], shapes, model.M.diagonal())
    return indices_of(model, given)


def masters_alone(
    model: StructuralModel, given: Sequence[Label] | Masters | None, interest: Interest
) -> Indices:
    """Return the masters of a method that is not made of modes.

    Absent: the DOFs of joints, sensors and loads. A rule to choose by looks at as many of the lowest modes
    as masters are wanted; without a count, at those of the band.

    Raises
    ------
    UsageError
        If nothing says which or how many.
    """
    if isinstance(given, Masters):
        if given.choose == "mass" and given.count is not None:
            return chosen("mass", given.count, np.empty((model.size, 0)), model.M.diagonal())
        wanted = wanted_modes(None, interest, given.count)
        if isinstance(wanted, ModeRange) and wanted.count is not None:
            wanted = ModeRange(count=min(wanted.count, model.size))
        shapes = selected(with_known_joints(model), wanted).shapes
        return chosen(given.choose, given.count or shapes.shape[1], shapes, model.M.diagonal())
    masters = interesting(model, interest) if given is None else indices_of(model, given)
    if not len(masters):
        raise UsageError(
            "nothing says which DOFs are masters: there are no joints, sensors or loads",
            remedy="Give `masters: [DOF, …]`, or `masters: {count: N}` to have them chosen.",
            names=("masters",),
        )
    return masters


def interesting(model: StructuralModel, interest: Interest) -> Indices:
    """Return the DOFs of joints, then those of sensors and loads, each once."""
    dofs = [dof for joint in model.joints for dof in joint.dofs]
    labels = list(dict.fromkeys(model.label(dof) for dof in [*dofs, *interest.dofs]))
    return indices_of(model, labels) if labels else np.array([], dtype=np.int64)
