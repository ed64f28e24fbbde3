"""Labels of DOFs, and the node and direction in them.

A label is a whole number, or a text such as ``20:z`` (node and direction x y z rx ry rz), ``w_4``,
``theta_1``, ``12:UX`` or ``12:4`` (node 12, component 4 of 1 … 6: translations 1 … 3, rotations 4 … 6).
A DOF is also found by node and direction where its own label is another: ``4:y`` is ``w_4``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TypeAlias

from dynid.errors import UsageError
from dynid.structure.matrices import Label
from dynid.suggestions import did_you_mean

Node: TypeAlias = int | str
"""A node: its number, or in assemblies of several parts a text such as ``arm.20``."""

DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
"""The directions of a node's DOFs: displacements along its axes, then rotations about them."""

# The names of directions in labels. Plane structures lie in x-y: u = x, w = y, theta = rz.
_ALIASES = {
    **{name: axis for axis in "xyz" for name in (axis, f"u{axis}", f"t{axis}")},
    **{name: f"r{axis}" for axis in "xyz" for name in (f"r{axis}", f"ur{axis}", f"rot{axis}")},
    **{"u": "x", "v": "y", "w": "y", "theta": "rz"},
    **{str(number): along for number, along in enumerate(DIRECTIONS, 1)},
    **{f"t{number}": along for number, along in enumerate(DIRECTIONS[:3], 1)},
    **{f"r{number}": along for number, along in enumerate(DIRECTIONS[3:], 1)},
}
_LISTED = 6


def direction(label: Label) -> str:
    """Return the direction in a label (``w`` of ``w_4``, ``UX`` of ``12:UX``); empty where it has none."""
    return _split(label)[1]


def node_direction(label: Label) -> tuple[Node, str] | None:
    """Return node and direction of a DOF: 20 and ``z`` of ``20:z``, 4 and ``y`` of ``w_4``.

    Returns
    -------
    tuple or None
        The direction is one of `DIRECTIONS`; the node is a number where it reads as one. None where the
        label says neither.
    """
    node, name = _split(label)
    along = _ALIASES.get(name.lower())
    return None if along is None or not node else (int(node) if node.isdecimal() else node, along)


def _split(label: Label) -> tuple[str, str]:
    """Return the texts for node and direction in a label; empty where it has none."""
    if isinstance(label, int):
        return "", ""
    if ":" in label:
        node, _, along = label.rpartition(":")
        return node, along
    name, _, node = label.rpartition("_")
    if not node.isdecimal():
        return "", ""
    part, dot, along = name.rpartition(".")  # of a part of an assembly: arm.w_4
    return f"{part}{dot}{node}", along


def kind(label: Label) -> str:
    """Return ``translation``, ``rotation``, or ``unknown`` where the label has no direction."""
    along = _ALIASES.get(direction(label).lower())
    return "unknown" if along is None else "rotation" if along.startswith("r") else "translation"


class DofNames:
    """The names by which DOFs are found: their own labels, ``NODE:DIR``, and numbers where labels are texts.

    Parameters
    ----------
    labels
        The DOFs' own labels (n).
    motions
        Names of weighted sums of DOFs, which are found like DOFs.
    """

    def __init__(self, labels: Sequence[Label], motions: Iterable[str] = ()) -> None:
        self.labels = labels
        self._own = {*labels, *motions}
        self._numbered = any(isinstance(label, int) for label in labels)

    def find(self, name: Label) -> Label:
        """Return the own label of a DOF, or the name of a motion.

        Raises
        ------
        UsageError
            If there is no such DOF, two have this node and direction, or the name has a sign.
        """
        if name in self._own:
            return name
        if isinstance(name, int):
            if 1 <= name <= len(self.labels) and not self._numbered:
                return self.labels[name - 1]
            raise no_such(name, self.labels)
        node, along = _split(name)
        found = self._by_node.get(node_direction(name), ()) if along in DIRECTIONS and ":" in name else ()
        if not found:
            raise self._none(name)
        if len(found) > 1:
            raise UsageError(
                f"the DOFs {listed(found)} have node {node} and direction {along} in common",
                remedy="Name one by its own label.",
                names=(name,),
            )
        return found[0]

    def find_signed(self, name: Label) -> tuple[float, Label]:
        """Return the sign of a name such as ``20:-z``, +1 or -1, and the own label of its DOF.

        Raises
        ------
        UsageError
            As `find`.
        """
        bare = unsigned(name)
        if name in self._own or bare == name:
            return 1.0, self.find(name)
        return (-1.0 if str(name).rpartition(":")[2][0] == "-" else 1.0), self.find(bare)

    def _none(self, name: str) -> UsageError:
        """Return the error for a text that names no DOF."""
        bare = unsigned(name)
        if bare != name and self.has(bare):
            return UsageError(
                f"'{name}' has a sign, which only channels, loads and reference DOFs can have",
                remedy=f"Write '{bare}'.",
                names=(name,),
            )
        place = node_direction(bare)
        if place is not None and place in self._by_node:
            hint = f"; did you mean '{place[0]}:{place[1]}'?"
            return no_such(name, self.labels, hint)
        node = "" if place is None else place[0]
        beside = [found[0] for one, found in self._by_node.items() if one is not None and one[0] == node]
        if beside:
            return UsageError(
                f"there is no DOF {name}: node {node} has {listed(beside)} only",
                remedy="Others are held by supports, or do not exist in this structure.",
                names=(name,),
            )
        return no_such(name, self.labels)

    def has(self, name: Label) -> bool:
        """Return True if a name without a sign is that of a DOF."""
        try:
            self.find(name)
        except UsageError:
            return False
        return True

    @cached_property
    def _by_node(self) -> dict[tuple[Node, str] | None, list[Label]]:
        found: dict[tuple[Node, str] | None, list[Label]] = {}
        for label in self.labels:
            place = node_direction(label)
            if place is not None:
                found.setdefault(place, []).append(label)
        return found


def unsigned(name: Label) -> Label:
    """Return a name such as ``20:-z`` without its sign."""
    return re.sub(r":[+-](?=[^:]+$)", ":", name) if isinstance(name, str) else name


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


def no_such(dof: Label, labels: Sequence[Label], hint: str = "") -> UsageError:
    """Return the error for a DOF that does not exist; it lists those that do."""
    if isinstance(dof, str) and not hint:
        hint = did_you_mean(dof, (label for label in labels if isinstance(label, str)))
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
