"""Labels of DOFs, and the direction and node in them: translation or rotation.

A label is a whole number, or a text such as ``w_4``, ``theta_1``, ``12:UX`` or ``12:4`` (node 12,
component 4 of 1 … 6: translations 1 … 3, rotations 4 … 6).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from dynid.errors import UsageError
from dynid.structure.matrices import Label
from dynid.suggestions import did_you_mean

_TRANSLATIONS = {"u", "v", "w", "x", "y", "z", "ux", "uy", "uz", "tx", "ty", "tz", "t1", "t2", "t3"} | set(
    "123"
)
_ROTATIONS = {"theta", "rx", "ry", "rz", "urx", "ury", "urz", "rotx", "roty", "rotz", "r1", "r2", "r3"} | set(
    "456"
)
_LISTED = 6


def direction(label: Label) -> str:
    """Return the direction in a label (``w`` of ``w_4``, ``UX`` of ``12:UX``); empty where it has none."""
    if isinstance(label, int):
        return ""
    if ":" in label:
        return label.rpartition(":")[2]
    name, _, node = label.rpartition("_")
    return name if node.isdecimal() else ""


def kind(label: Label) -> str:
    """Return ``translation``, ``rotation``, or ``unknown`` where the label has no direction."""
    along = direction(label).lower()
    if along in _TRANSLATIONS:
        return "translation"
    return "rotation" if along in _ROTATIONS else "unknown"


def checked(labels: Iterable[Label], n: int) -> tuple[Label, ...]:
    """Return n different labels; 1 … n where none are given.

    Raises
    ------
    UsageError
        If there are not n, two are the same, or a text could be taken for a number.
    """
    given = tuple(labels) or tuple(range(1, n + 1))
    if len(given) != n:
        raise UsageError(f"there are {len(given)} DOF labels, but {n} DOFs")
    if len(set(given)) != n:
        twice = next(label for k, label in enumerate(given) if label in given[:k])
        raise UsageError(f"two DOFs are labelled {twice}", names=(str(twice),))
    mixed = next(
        (label for label in given if isinstance(label, str) and re.fullmatch(r"\s*\d*\s*", label)), None
    )
    if mixed is not None:
        raise UsageError(f"the DOF label '{mixed}' is no name; a number as a label must be a whole number")
    return given


def no_such(dof: Label, labels: Sequence[Label]) -> UsageError:
    """Return the error for a DOF that does not exist; it lists those that do."""
    hint = (
        did_you_mean(dof, (label for label in labels if isinstance(label, str)))
        if isinstance(dof, str)
        else ""
    )
    first, last = labels[0], labels[-1]
    span = f"the DOFs {listed(labels)}"
    if len(labels) == 1:
        span = f"DOF {first} only"
    elif isinstance(first, int) and labels == tuple(range(first, first + len(labels))):
        span = f"the DOFs {first} to {last}"
    return UsageError(f"there is no DOF {dof}{hint}", remedy=f"The structure has {span}.", names=(str(dof),))


def listed(labels: Sequence[Label]) -> str:
    """Write labels, the middle of a long list left out."""
    if len(labels) <= 2 * _LISTED:
        return ", ".join(map(str, labels))
    head, tail = labels[: 2 * _LISTED - 2], labels[-1]
    return f"{', '.join(map(str, head))}, … {tail}"
