"""All reduction methods by name, and the reduction of each part of an assembly by itself.

Interfaces of parts may be motions, such as those of points. A motion ``p = w . x`` at an interface becomes a
coordinate in the place of one DOF that it is made of. This change of coordinates is exact; methods keep
masters as they do of any structure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Protocol

import numpy as np

from dynid.arrays import Array
from dynid.errors import NumericalError, UsageError
from dynid.number_format import counted
from dynid.structure.labels import Label, unsigned
from dynid.structure.matrices import Matrix, congruent
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.condensation import Dynamic, Guyan
from dynid.structure.reduction.irs import Irs
from dynid.structure.reduction.masters import Indices
from dynid.structure.reduction.modal import CraigBampton, ModalTruncation
from dynid.structure.reduction.mode_selection import Interest
from dynid.structure.reduction.reduced_model import StructuralReduction, projected
from dynid.structure.reduction.serep import JointAware, Serep
from dynid.suggestions import did_you_mean


class Reductor(Protocol):
    """A method with its choices made."""

    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce a structure."""


METHODS: dict[str, Any] = {
    "serep": Serep,
    "guyan": Guyan,
    "dynamic": Dynamic,
    "irs": Irs,
    "craig-bampton": CraigBampton,
    "modal": ModalTruncation,
    "joint-aware": JointAware,
}
"""The classes of the methods: `Reductor` instances."""


def reduce(model: StructuralModel, method: str = "serep", **options: Any) -> StructuralModel:
    """Reduce a structure to a model of the same kind.

    Parameters
    ----------
    model
        The full structure. Its joints come along: their patterns are projected with everything else, so
        that unknown parameters stay unknown.
    method
        ``serep``, ``guyan``, ``dynamic``, ``irs``, ``craig-bampton``, ``modal`` or ``joint-aware``.
    options
        Those of the method's class.

    Returns
    -------
    StructuralModel
        The reduced model; any DOF of the full one can be loaded and read in it, and it expands back.

    Raises
    ------
    UsageError
        If masters or modes do not exist, stand twice, or the modes are more than the masters.
    Singular
        If a mode is invisible at the masters, or the slaves are not held by them.

    Examples
    --------
    >>> from dynid.structure.lumped import Link, lumped
    >>> chain = lumped([1, 1, 1], [Link((1,), 1.0), Link((1, 2), 1.0), Link((2, 3), 1.0)])
    >>> reduce(chain, "guyan", masters=[3]).K
    array([[0.33333333]])
    """
    if method not in METHODS:
        raise UsageError(
            f"there is no reduction method {method!r}{did_you_mean(method, METHODS)}",
            remedy=f"Use one of {', '.join(METHODS)}.",
        )
    reductor: Reductor = METHODS[method](**options)
    return reductor.reduce(model).model


# Weights of a motion that other ones explain but for this part are those of no motion of its own.
_OWN = 1e-9
# A full part keeps all its DOFs in a dense basis.
_MOST_FULL = 2000


@dataclass(frozen=True)
class PartReduction:
    """Reduction of one part: a method of `METHODS` with its options, `interest` apart."""

    method: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class ReductionByParts:
    """Reduction of the parts of an assembly; masters are by default the ends of joints, sensors and loads.

    `parts`: by the name of each part its reduction; a full part has None. One part of the name ``""`` is the
    whole structure. `interest`: purpose of the model.
    """

    parts: Mapping[str, PartReduction | None]
    interest: Interest = field(default_factory=Interest)

    def reduce(self, model: StructuralModel) -> StructuralReduction:
        """Reduce an assembly.

        Raises UsageError, NumericalError as the method of a part; `names` start with the part. If a DOF is of
        no part.
        """
        names: list[Label] = []
        bases: list[tuple[Indices, Array]] = []
        reductions: list[StructuralReduction] = []
        places_of = self._places(model)
        for name, reduction in self.parts.items():
            prefix, places = _prefix(name), places_of[name]
            if reduction is None:
                if len(places) > _MOST_FULL:
                    said = f"the part '{name}' has {counted(len(places), 'DOF')}, too many to stay full"
                    raise UsageError(said, remedy="Give it a `reduction`.", names=(name,))
                names += [model.dofs[k] for k in places]
                bases.append((places, np.eye(len(places))))
                continue
            try:
                part, T = self._reduced(name, model, places, reduction)
            except (UsageError, NumericalError) as error:
                error.names = (*(f"{name}.{name_of_key}" for name_of_key in error.names), name)
                raise
            reductions.append(part)
            bases.append((places, T))
            kept, dofs = len(part.masters), part.model.dofs
            names += [*dofs[:kept], *(f"{prefix}{label}" for label in dofs[kept:])]
        T = np.zeros((model.size, len(names)))
        first = 0
        for places, basis in bases:
            T[places, first : first + basis.shape[1]] = basis
            first += basis.shape[1]
        conditions = [part.condition for part in reductions if part.condition is not None]
        rules, doubts = (
            "; ".join(dict.fromkeys(filter(None, texts)))
            for texts in ([part.rule for part in reductions], [part.doubt for part in reductions])
        )
        return StructuralReduction(
            projected(model, T, names),
            tuple(label for part in reductions for label in part.masters),
            tuple(number for part in reductions for number in part.modes),
            max(conditions, default=None),
            rule=rules,
            doubt=doubts,
            inverted=reductions[0].inverted if reductions else "",
        )

    def _places(self, model: StructuralModel) -> Mapping[str, Indices]:
        """Return the places of each part's DOFs, in the order of the assembly.

        A DOF of a rigid point has the name of the point: it is of the part whose DOFs have become motions of
        it. These come before the motions of joints and of users, whose names say nothing about parts.
        """
        part_of: dict[Label, str] = {}
        for name, moved in [*((str(dof), (dof,)) for dof in model.dofs), *model.motions.items()]:
            owner = next(
                (part_label for part_label in self.parts if name.startswith(_prefix(part_label))), None
            )
            if owner is not None:
                for dof in moved:
                    part_of.setdefault(dof, owner)
        places: dict[str, list[int]] = {name: [] for name in self.parts}
        for k, dof in enumerate(model.dofs):
            if dof not in part_of:
                raise UsageError(f"the DOF '{dof}' is of no part", names=(str(dof),))
            places[part_of[dof]].append(k)
        return {name: np.array(listed, dtype=int) for name, listed in places.items()}

    def _reduced(
        self, name: str, model: StructuralModel, places: Indices, reduction: PartReduction
    ) -> tuple[StructuralReduction, Array]:
        """Return the reduction of the part at these DOFs of the assembly, and its basis."""
        part_model, prefix = _cut(model, places), _prefix(name)
        chosen = reduction.options.get("masters")
        masters = [model.label(dof) for dof in chosen] if isinstance(chosen, Sequence) else []
        rows: dict[Label, Array] = {}
        for label in dict.fromkeys([*_interfaces(model, self.interest), *masters]):
            row = model.row(label)
            complete = np.count_nonzero(row) == np.count_nonzero(row[places])
            if row[places].any():
                rows[label if complete else f"{prefix}{label}"] = row[places]
        changed, change = _with_coordinates(part_model, rows)
        options = dict(reduction.options)
        if masters:
            options["masters"] = [label for label in masters if label in changed.dofs]
        here = tuple(label for label in rows if label in changed.dofs)
        method = METHODS[reduction.method](**options, interest=Interest(here, self.interest.band))
        reduced = method.reduce(changed)
        return reduced, np.asarray(reduced.T if change is None else change @ reduced.T)


def reduced_with_motions(method: Any, model: StructuralModel) -> StructuralReduction:
    """Return a structure reduced by a method, for which motions at joints, sensors and loads are DOFs."""
    ends = _interfaces(model, method.interest)
    changed, change = _with_coordinates(model, {label: model.row(label) for label in ends})
    reduced: StructuralReduction = method.reduce(changed)
    if change is None:
        return reduced
    assert reduced.model.basis is not None
    full_model = projected(
        model, np.asarray(change @ reduced.T), reduced.model.dofs, reduced.model.basis.rigid
    )
    return replace(reduced, model=full_model)


def _prefix(name: str) -> str:
    """Return what the names of a part's DOFs start with in the assembly."""
    return f"{name}." if name else ""


def _interfaces(model: StructuralModel, interest: Interest) -> list[Label]:
    """Return the labels of joints' ends, sensors and loads, each once."""
    ends = [dof for joint in model.joints for dof in joint.dofs]
    return list(dict.fromkeys(model.label(unsigned(dof)) for dof in (*ends, *interest.dofs)))


def _cut(model: StructuralModel, places: Indices) -> StructuralModel:
    """Return some DOFs of an assembly as a structure of their own, with the joints among them."""
    if len(places) == model.size:
        return model

    def cut(matrix: Matrix) -> Any:
        rows: Any = matrix[:, places]
        return rows[places]

    labels = {model.dofs[k] for k in places}
    inside = {name: motion for name, motion in model.motions.items() if labels.issuperset(motion)}
    there = labels | inside.keys()
    return StructuralModel(
        **model.mapped(cut),
        joints=tuple(j for j in model.joints if all(model.label(dof) in there for dof in j.dofs)),
        dofs=tuple(model.dofs[k] for k in places),
        parameters=model.parameters,
        motions=inside,
        translations=model.translations,
    )


def _with_coordinates(model: StructuralModel, rows: Mapping[Label, Array]) -> tuple[StructuralModel, Any]:
    """Return a structure in which motions are DOFs, and the DOFs that it had by those (n x n).

    `rows`: by label the weights (n) of motions; DOFs of the structure among them stay DOFs. A motion that is
    a sum of others is left out.

    It returns the structure, and the change of coordinates, None where all of them are DOFs already.
    """
    rows_of_dofs = [k for k, label in enumerate(model.dofs) if label in rows]
    labels = [label for label in rows if label not in model.dofs]
    if not labels:
        return model, None
    W = np.array([rows[label] for label in labels])
    W[:, rows_of_dofs] = 0.0  # these are coordinates already
    W /= np.linalg.norm([rows[label] for label in labels], axis=1)[:, None]
    labels, W = _independent(labels, W)
    if not labels:
        return model, None
    from scipy.linalg import qr  # heavy imports, for motions only
    from scipy.sparse import coo_array

    used = np.flatnonzero(W.any(axis=0))
    pivots = used[qr(W[:, used], mode="r", pivoting=True)[1][: len(labels)]]
    full = np.array([rows[label] for label in labels])
    inverse = np.linalg.inv(full[:, pivots])
    rest = np.setdiff1d(np.flatnonzero(full.any(axis=0)), pivots)
    others = np.setdiff1d(np.arange(model.size), pivots)
    block = -inverse @ full[:, rest]
    # x = (the others), and at the pivots W_d^-1 (p - W_rest x_rest).
    places = [
        (others, others, np.ones(len(others))),
        (np.repeat(pivots, len(rest)), np.tile(rest, len(pivots)), block.ravel()),
        (np.repeat(pivots, len(pivots)), np.tile(pivots, len(pivots)), inverse.ravel()),
    ]
    i, j, values = (np.concatenate(parts) for parts in zip(*places, strict=True))
    T: Any = coo_array((values, (i, j)), shape=(model.size, model.size)).tocsc()
    dofs = list(model.dofs)
    for row_index, label in zip(pivots, labels, strict=True):
        dofs[row_index] = label

    new = StructuralModel(
        **model.mapped(partial(congruent, T)),
        dofs=tuple(dofs),
        parameters=model.parameters,
        translations=model.translations,
    )
    at = {label: row_index for row_index, label in enumerate(model.dofs)}
    # Joints name DOFs that are none any more by the motions that these are now.
    lost = {
        label: {dofs[k]: float(value) for k, value in zip(row.indices, row.data, strict=True)}
        for label in (model.dofs[k] for k in pivots)
        for row in [T[[at[label]]].tocsr()]
    }
    old = {name: _through(motion, lost) for name, motion in model.motions.items() if name not in dofs}
    return replace(new, motions=old | {str(label): row for label, row in lost.items()}).joined(
        model.joints
    ), T


def _through(
    motion: Mapping[Label, float], lost: Mapping[Label, Mapping[Label, float]]
) -> dict[Label, float]:
    """Return a motion with the DOFs that are lost replaced by what they are now."""
    weights: dict[Label, float] = {}
    for label, weight in motion.items():
        for retained, weight_of_dof in lost.get(label, {label: 1.0}).items():
            weights[retained] = weights.get(retained, 0.0) + weight * weight_of_dof
    return weights


def _independent(labels: Sequence[Label], W: Array) -> tuple[list[Label], Array]:
    """Return the motions that are no sums of the ones before them."""
    kept: list[int] = []
    basis = np.empty((0, W.shape[1]))
    for k, row in enumerate(W):
        left = row - (row @ basis.T) @ basis
        left -= (left @ basis.T) @ basis
        size = float(np.linalg.norm(left))
        if size > _OWN:
            kept.append(k)
            basis = np.concatenate([basis, left[None] / size])
    return [labels[k] for k in kept], W[kept]
