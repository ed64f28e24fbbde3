"""Masters, the DOFs that a reduced model keeps: given or chosen, and their condition for the modes.

Sources: pivoted QR of the mode matrix's rows, G. H. Golub & C. F. Van Loan, *Matrix Computations*, 5.4;
effective independence, D. C. Kammer, *J. Guidance, Control, and Dynamics* 14 (1991) 251–259.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.defaults import MASTERS, SINGLE_MASTERS
from dynid.errors import Singular, UsageError
from dynid.number_format import counted
from dynid.structure.labels import Label, listed
from dynid.structure.model import StructuralModel
from dynid.structure.reduction.mode_selection import Interest, ModeRange, selected, wanted_modes

Indices = NDArray[np.int64]

Choice = Literal["qr", "effective-independence", "mass"]

HOPELESS = 1 / float(np.sqrt(np.finfo(float).eps))
"""Condition of the modes at the masters beyond which half of all digits are lost: they are refused."""

# A combination of modes that masters see less than this, relative to the modes, is to be seen by others.
_BARELY = 1e-3
_ONE_BY_ONE = SINGLE_MASTERS.value


@dataclass(frozen=True)
class Masters:
    """A rule to choose masters by.

    `count`: their number; default: one a mode; `choose`: ``qr``: column-pivoted QR of the mode matrix's rows;
    ``effective-independence``: drop the DOFs that add least to the modes' information (Kammer); ``mass``: the
    largest diagonal masses, which often see the modes badly and are there for comparison.
    """

    count: int | None = None
    choose: Choice = MASTERS.value

    def __post_init__(self) -> None:
        if self.count is not None and self.count < 1:
            raise UsageError("at least one master is needed", names=("masters",))
        if self.choose not in get_args(Choice):
            raise UsageError(
                f"masters cannot be chosen by {self.choose!r}",
                remedy=f"Use one of {', '.join(get_args(Choice))}.",
                names=("masters",),
            )


def chosen(choose: Choice, count: int, shapes: Array, mass: Array) -> Indices:
    """Return the indices of `count` DOFs, ascending.

    `choose`: the rule, as of `Masters`; `count`: how many; `shapes`: the modes to be seen (n x r); `mass`
    needs none; `mass`: diagonal of the mass matrix (n). Raises UsageError if there are not that many DOFs.
    """
    if count > len(mass):
        raise UsageError(
            f"{counted(count, 'master')} asked for, but the structure has {counted(len(mass), 'DOF')}",
            names=("masters",),
        )
    if choose == "mass":
        return np.sort(np.argsort(-mass, kind="stable")[:count])
    if choose == "qr":
        # Beyond one DOF a mode, the others see all modes over again.
        masters = _pivots(shapes)[: min(count, shapes.shape[1])]
        while len(masters) < count:
            rest = np.setdiff1d(np.arange(len(shapes)), masters)
            again = rest[_pivots(shapes[rest])]
            masters = np.concatenate([masters, again[: min(count - len(masters), shapes.shape[1])]])
        return np.sort(masters)
    return _effectively_independent(count, shapes)


def completed(masters: Indices, shapes: Array) -> Indices:
    """Add DOFs to the given ones, by pivoted QR of what these do not see of the modes, until all are seen.

    `masters`: indices of the DOFs taken for granted; `shapes`: the modes (n x r).
    """
    _, s, Vt = np.linalg.svd(shapes[masters])
    typical = float(np.abs(shapes).max(axis=0, initial=0.0).min(initial=np.inf))
    rank = int(np.count_nonzero(s > _BARELY * typical))
    unseen = shapes @ Vt[rank:].T
    unseen[masters] = 0.0
    more = _pivots(unseen)[: shapes.shape[1] - rank]
    return np.sort(np.concatenate([masters, more]))


def _pivots(shapes: Array) -> Indices:
    """Return the DOFs in the order in which column-pivoted QR of the modes' rows takes them."""
    from scipy.linalg import qr  # heavy import, needed here only

    return np.asarray(qr(shapes.T, mode="r", pivoting=True)[1], dtype=np.int64)


def _effectively_independent(count: int, shapes: Array) -> Indices:
    """Drop the DOFs of least leverage until `count` are left (Kammer's backward deletion)."""
    if count < shapes.shape[1]:
        raise UsageError(
            f"{counted(count, 'master')} cannot tell {counted(shapes.shape[1], 'mode')} apart",
            names=("masters",),
        )
    kept = np.arange(len(shapes))
    while len(kept) > count:
        Q = np.linalg.qr(shapes[kept])[0]
        leverage = np.einsum("ij,ij->i", Q, Q)
        spare = len(kept) - max(count, _ONE_BY_ONE)
        if spare <= 0:
            return _dropped_singly(kept, count, Q)
        drop = min(spare, max(1, len(kept) // 4))
        kept = np.delete(kept, np.argsort(leverage, kind="stable")[:drop])
    return kept


def _dropped_singly(kept: Indices, count: int, Q: Array) -> Indices:
    """Drop one DOF after the other, the orthogonal factor brought up to date by a Householder reflection.

    Removing the row q of an orthonormal Q multiplies what is left by (I - q q^T)^(-1/2).
    """
    Q = Q.copy()
    while len(kept) > count:
        leverage = np.einsum("ij,ij->i", Q, Q)
        k = int(np.argmin(leverage))
        q, size = Q[k], float(leverage[k])
        Q, kept = np.delete(Q, k, axis=0), np.delete(kept, k)
        if 0 < size < 1:
            Q += np.outer(Q @ q, q) * ((1 / np.sqrt(1 - size) - 1) / size)
    return kept


def indices_of(model: StructuralModel, dofs: Sequence[Label], key: str = "masters") -> Indices:
    """Return the indices of DOFs given by their labels under a key of a scene, by default masters.

    Raises UsageError if a DOF is named twice or does not exist, or none is named.
    """
    try:
        indices = [model.index(dof) for dof in dofs]
    except UsageError as error:
        raise UsageError(error.problem, remedy=error.remedy, names=(key,)) from None
    if not indices:
        raise UsageError(f"the {key} name no DOF", remedy="Name at least one.", names=(key,))
    twice = [dof for position, dof in enumerate(dofs) if indices[position] in indices[:position]]
    if twice:
        raise UsageError(f"DOF {twice[0]} stands twice among the {key}", names=(key,))
    return np.array(indices, dtype=np.int64)


def checked_condition(seen: Array, share: Array, numbers: Sequence[int], masters: Sequence[Label]) -> float:
    """Return the condition of the modes at the masters.

    `seen`: the modes at the masters, U_m (m x r), normed to unit modal mass; `share`: the same, in units in
    which all DOFs compare, as parts of whole modes of length 1; `numbers`: the modes' numbers (r); `masters`:
    the masters' labels (m).

    Raises UsageError if there are more modes than masters, and Singular if a mode is invisible at the
    masters: the condition, or the length of what is seen of the mode below that of the whole, is beyond
    1/sqrt(eps).
    """
    if len(numbers) > len(masters):
        raise UsageError(
            f"{len(numbers)} modes are more than {counted(len(masters), 'master')} can tell apart",
            remedy="Take fewer modes or more masters; `masters: {count: N}` chooses them.",
            names=("modes",),
        )
    s = np.linalg.svd(seen, compute_uv=False)
    _, parts, Vt = np.linalg.svd(share)
    condition = float(s[0] / s[-1]) if s[-1] > 0 else np.inf
    worst = max(condition, 1 / parts[-1]) if parts[-1] > 0 else np.inf
    if worst < HOPELESS:
        return condition
    last_vector = np.abs(Vt[-1])
    hidden = [
        number for number, entry in zip(numbers, last_vector, strict=True) if entry > 0.1 * last_vector.max()
    ]
    subject = (
        f"mode {hidden[0]} is" if len(hidden) == 1 else f"a combination of the modes {listed(hidden)} is"
    )
    raise Singular(
        f"{subject} invisible at the {counted(len(masters), 'master')} {listed(masters)} "
        f"(condition {worst:.2g})",
        remedy="Add a master where it moves, leave it out, or let `masters: {choose: qr}` choose.",
        names=("masters",),
    )


def masters_for_modes(
    model: StructuralModel,
    masters: Sequence[Label] | Masters | None,
    interest: Interest,
    shapes: Array,
    mass: Array,
) -> Indices:
    """Return masters at which these modes are observable.

    `masters`: labels, or a rule to choose by. Default: the DOFs of joints, sensors and loads, and as many
    others as it takes to see all the modes. `interest`: the DOFs of sensors and loads; `shapes`, `mass`: the
    modes (n x r), and the diagonal of the mass matrix (n).
    """
    if masters is None:
        return completed(interesting(model, interest), shapes)
    if isinstance(masters, Masters):
        return chosen(masters.choose, masters.count or shapes.shape[1], shapes, mass)
    return indices_of(model, masters)


def masters_alone(
    model: StructuralModel, choice: Sequence[Label] | Masters | None, interest: Interest
) -> Indices:
    """Return the masters of a method that is not made of modes.

    Default: the DOFs of joints, sensors and loads. A rule to choose by looks at `modes_to_see`.

    Raises UsageError if neither masters nor their number are known.
    """
    if isinstance(choice, Masters):
        shapes = np.empty((model.size, 0))
        if choice.choose != "mass" or choice.count is None:
            shapes = selected(model.with_known_joints(), modes_to_see(choice, interest, model.size)).shapes
        return masters_for_modes(model, choice, interest, shapes, model.M.diagonal())
    masters = interesting(model, interest) if choice is None else indices_of(model, choice)
    if not len(masters):
        raise UsageError(
            "nothing says which DOFs are masters: there are no joints, sensors or loads",
            remedy="Give `masters: [DOF, …]`, or `masters: {count: N}` to have them chosen.",
            names=("masters",),
        )
    return masters


def modes_to_see(choice: Masters, interest: Interest, size: int) -> Sequence[int] | ModeRange:
    """Return the modes that chosen masters are to see: one a master, without a count those of the band."""
    count = None if choice.count is None else min(choice.count, size)
    return wanted_modes(None, interest, count)


def interesting(model: StructuralModel, interest: Interest) -> Indices:
    """Return the DOFs of joints, then those of sensors and loads, each once; of motions what they are of."""
    dofs = [dof for joint in model.joints for dof in joint.dofs]
    labels = list(dict.fromkeys(label for dof in [*dofs, *interest.dofs] for label in model.moved_by(dof)))
    return indices_of(model, labels) if labels else np.array([], dtype=np.int64)


def mode_count(
    model: StructuralModel, masters: Sequence[Label] | Masters | None, interest: Interest
) -> int | None:
    """Return the number of masters, one a mode; None where the band of interest says which modes to keep."""
    count = None
    if masters is not None:
        count = masters.count if isinstance(masters, Masters) else len(masters)
    if count is None and interest.band is None:
        count = len(interesting(model, interest)) or None
    return count
