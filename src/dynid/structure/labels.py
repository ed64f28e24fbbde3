"""Nodes of structures, and the labels of their DOFs, with the node and direction in them.

A label is a whole number, or a text such as ``20:z`` (node and direction x y z rx ry rz), ``w_4``,
``theta_1``, ``12:UX`` or ``12:4`` (node 12, component 4 of 1 … 6: translations 1 … 3, rotations 4 … 6).
A DOF is also found by node and direction where its own label is another: ``4:y`` is ``w_4``.

Nodes have numbers, positions, axes of their DOFs, sets, and lines between them. A plane structure lies in
x–y: u is x, w is y, theta is rz.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.number_format import counted
from dynid.suggestions import did_you_mean

Label: TypeAlias = int | str
"""The own label of a DOF, or another name of it."""

Node: TypeAlias = int | str
#: Two nodes are a line, three or four the corners of a face.
Outline: TypeAlias = tuple[Node, ...]
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
_MAX_LISTED_LABELS = 6


def direction(label: Label) -> str:
    """Return the direction in a label (``w`` of ``w_4``, ``UX`` of ``12:UX``); empty where it has none."""
    return _split(label)[1]


def node_direction(label: Label) -> tuple[Node, str] | None:
    """Return node and direction of a DOF: 20 and ``z`` of ``20:z``, 4 and ``y`` of ``w_4``.

    The direction is one of `DIRECTIONS`; the node is a number where it reads as one. None where the label
    says neither.
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
    prefix, dot, along = name.rpartition(".")  # of a part of an assembly: arm.w_4
    return f"{prefix}{dot}{node}", along


def kind(label: Label) -> str:
    """Return ``translation``, ``rotation``, or ``unknown`` where the label has no direction."""
    along = _ALIASES.get(direction(unsigned(label)).lower())
    return "unknown" if along is None else "rotation" if along.startswith("r") else "translation"


class DofNames:
    """The names by which DOFs are found: their own labels, ``NODE:DIR``, and numbers where labels are texts.

    `labels`: the DOFs' own labels (n); `motions`: names of weighted sums of DOFs, which are found like DOFs.
    """

    def __init__(self, labels: Sequence[Label], motions: Iterable[str] = ()) -> None:
        self.labels = labels
        self._own = {*labels, *motions}
        self._numbered = any(isinstance(label, int) for label in labels)

    def _as_number(self, name: Label) -> Label:
        """Return the number that a text is, as JSON writes keys, unless it is a label."""
        number = isinstance(name, str) and name not in self._own and re.fullmatch(r"[1-9][0-9]{0,17}", name)
        return int(name) if number else name

    def find(self, name: Label) -> Label:
        """Return the own label of a DOF, or the name of a motion.

        Raises UsageError if there is no such DOF, two have this node and direction, or the name has a sign.
        """
        name = self._as_number(name)
        if name in self._own:
            return name
        if isinstance(name, int):
            if 1 <= name <= len(self.labels) and not self._numbered:
                return self.labels[name - 1]
        elif len(matches := self._at(name)) == 1:
            return matches[0]
        said = self.misnamed(name)
        if said is None:
            raise _no_such(name, self.labels)
        raise UsageError(said, names=(str(name),))

    def find_signed(self, name: Label) -> tuple[float, Label]:
        """Return the sign of a name such as ``20:-z``, +1 or -1, and the own label of its DOF.

        Raises UsageError as `find`.
        """
        name = self._as_number(name)
        bare = unsigned(name)
        if name in self._own or bare == name:
            return 1.0, self.find(name)
        return (-1.0 if str(name).rpartition(":")[2][0] == "-" else 1.0), self.find(bare)

    def display_name(self, name: Label) -> Label:
        """Return the name of a DOF or motion in results: its own label, or ``NODE:-DIR`` with a minus sign.

        A number stays as it is.

        Raises UsageError as `find`.
        """
        name = self._as_number(name)
        sign, label = self.find_signed(name)
        if isinstance(name, int) or sign > 0:
            return name if isinstance(name, int) else label
        node, along = _split(str(unsigned(name)))
        return f"{node}:-{along}"

    def has(self, name: Label, *, signed: bool = False) -> bool:
        """Return True if a name is that of a DOF or motion; `signed`: where it may have a sign."""
        try:
            (self.find_signed if signed else self.find)(name)
        except UsageError:
            return False
        return True

    def misnamed(self, name: Label, *, signed: bool = False) -> str | None:
        """Return what is wrong with a text that names no DOF, as far as it has a node, direction or sign.

        `name`: the name, which `find` refuses; `find_signed` if `signed`; `signed`: True where a sign is
        allowed.
        """
        name = self._as_number(name)
        if isinstance(name, int):
            return None
        bare = str(unsigned(name))
        if not signed and bare != name and (bare in self._own or self._at(bare)):
            return (
                f"'{name}' has a sign, which only channels, loads and reference DOFs can have; write '{bare}'"
            )
        node, along = _split(bare)
        node_and_direction, matches = node_direction(bare), self._at(bare)
        if len(matches) > 1:
            both = f"have node {node} and direction {along} in common"
            return f"the DOFs {listed(matches)} {both}; name one by its own label"
        if node_and_direction in self._by_node:
            return f"there is no DOF '{name}'; did you mean '{node}:{node_and_direction[1]}'?"
        if (glued := re.fullmatch(r"(.+)([+-])(r?[xyz])", name, re.IGNORECASE)) and ":" not in name:
            close = f"{glued[1]}:{glued[3].lower()}"
            if self._at(close):
                minus = "-" if glued[2] == "-" else ""
                return f"there is no DOF '{name}'; write '{glued[1]}:{minus}{glued[3].lower()}'"
        if ":" not in bare or not self._by_node:
            return None
        there = [
            f"{label}" if str(label).endswith(f":{way}") else f"{label} ({way})"
            for (number, way), labels in self._by_node.items()
            for label in labels
            if str(number) == node
        ]
        if not there:
            nodes = list(dict.fromkeys(number for number, _ in self._by_node))
            return f"there is no DOF '{name}'; there are DOFs at the nodes {listed(nodes)}"
        if along not in DIRECTIONS:
            ways = ", ".join(DIRECTIONS)
            return f"there is no DOF '{name}'; directions are {ways}, and node {node} has {listed(there)}"
        return (
            f"there is no DOF '{name}'; node {node} has {listed(there)} only, others are held or do not exist"
        )

    def _at(self, name: str) -> Sequence[Label]:
        """Return the DOFs at a node along a direction, ``NODE:DIR``."""
        directed = ":" in name and _split(name)[1] in DIRECTIONS
        return self._by_node.get(key, ()) if directed and (key := node_direction(name)) else ()

    @cached_property
    def _by_node(self) -> dict[tuple[Node, str], list[Label]]:
        labels: dict[tuple[Node, str], list[Label]] = {}
        for label in self.labels:
            key = node_direction(label)
            if key is not None:
                labels.setdefault(key, []).append(label)
        return labels


def unsigned(name: Label) -> Label:
    """Return a name such as ``20:-z`` without its sign."""
    return re.sub(r":[+-](?=[^:]+$)", ":", name) if isinstance(name, str) else name


def checked(labels: Iterable[Label], n: int) -> tuple[Label, ...]:
    """Return n different labels; 1 … n where none are given.

    Raises UsageError if there are not n, two are the same, or a text could be taken for a number.
    """
    names = tuple(labels)
    if not names:
        return tuple(range(1, n + 1))
    if len(names) != n:
        raise UsageError(f"{counted(len(names), 'DOF label')} for {counted(n, 'DOF')}")
    if len(set(names)) != n:
        twice = next(label for k, label in enumerate(names) if label in names[:k])
        raise UsageError(f"two DOFs are labelled {twice}", names=(str(twice),))
    mixed = next(
        (label for label in names if isinstance(label, str) and re.fullmatch(r"\s*\d*\s*", label)), None
    )
    if mixed is not None:
        raise UsageError(f"the DOF label '{mixed}' is no name; a number as a label must be a whole number")
    return names


def _no_such(dof: Label, labels: Sequence[Label]) -> UsageError:
    """Return the error for a DOF that does not exist; it lists those that do."""
    hint = ""
    if isinstance(dof, str):
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
    if len(labels) <= 2 * _MAX_LISTED_LABELS:
        return ", ".join(map(str, labels))
    head, tail = labels[: 2 * _MAX_LISTED_LABELS - 2], labels[-1]
    return f"{', '.join(map(str, head))}, … {tail}"


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of a structure: numbers, positions, and what a picture of them needs.

    Raises UsageError if shapes do not fit, a node stands twice or is not there, or axes are not orthonormal.
    """

    # Numbers of the nodes (N); in assemblies of several parts texts such as ``arm.20``.
    numbers: tuple[Node, ...]
    xyz: Array  # positions (N x 3), m, basic coordinates
    # By node a matrix (3 x 3) whose rows are the directions x, y, z of the node's own DOFs in basic
    # coordinates; nodes that are absent have the basic ones.
    axes: Mapping[Node, Array] = field(default_factory=dict)
    sets: Mapping[str, tuple[Node, ...]] = field(default_factory=dict)  # named sets of nodes
    lines: tuple[Outline, ...] = ()  # lines and faces to draw
    # What else their file says, in words: coordinate systems, constraints that are not applied.
    notes: tuple[str, ...] = ()
    # Sentences on what contradicts the nodes, does not confirm them, or makes their model inaccurate.
    doubts: tuple[str, ...] = ()
    # Nodes that are none of the structure: they move with a node, or with a set of nodes.
    points: tuple[Node, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "numbers", tuple(self.numbers))
        xyz = np.asarray(self.xyz, dtype=float)
        object.__setattr__(self, "xyz", xyz)
        if xyz.shape != (len(self.numbers), 3) or not np.isfinite(xyz).all():
            raise UsageError(f"{len(self.numbers)} nodes need {len(self.numbers)} x 3 finite coordinates")
        if len(self.places) < len(self.numbers):
            twice = next(node for at, node in enumerate(self.numbers) if self.places[node] != at)
            raise UsageError(f"two nodes have the number {twice}", names=(str(twice),))
        ends = (node for line in self.lines for node in line)
        for node in (
            *self.axes,
            *self.points,
            *(node for members in self.sets.values() for node in members),
            *ends,
        ):
            if node not in self.places:
                raise UsageError(f"there is no node {node}", names=(str(node),))
        for node, axes in self.axes.items():
            if np.shape(axes) != (3, 3) or not np.allclose(axes @ np.transpose(axes), np.eye(3), atol=1e-6):
                raise UsageError(f"the axes of node {node} are not orthonormal", names=(str(node),))

    @cached_property
    def places(self) -> Mapping[Node, int]:
        """The place of each node in `numbers`, from 0."""
        return {node: at for at, node in enumerate(self.numbers)}

    def axes_of(self, node: Node) -> Array:
        """Return the directions of a node's own DOFs (3 x 3, in rows) in basic coordinates."""
        return np.asarray(self.axes[node]) if node in self.axes else np.eye(3)

    def rigid(self, labels: Iterable[Label]) -> Array:
        """Return DOFs in the six rigid-body motions: unit displacements, then rotations about the origin.

        `labels`: labels of the DOFs.

        It returns the displacement, or rotation, of each DOF (len(labels) x 6) in its node's own axes; zeros
        for DOFs of no node.
        """
        names = list(labels)
        motions = np.zeros((len(names), 6))
        placed = (node_direction(label) for label in names)
        moved = [
            (row, self.places[node_at[0]], DIRECTIONS.index(node_at[1]))
            for row, node_at in enumerate(placed)
            if node_at is not None and node_at[0] in self.places
        ]
        if not moved:
            return motions
        rows, nodes, places = np.array(moved).T
        axes = np.eye(3)[places % 3]
        for at in np.flatnonzero([self.numbers[node] in self.axes for node in nodes]):
            axes[at] = self.axes[self.numbers[nodes[at]]][places[at] % 3]
        along, about = places < 3, places >= 3
        motions[rows[along], :3] = axes[along]
        # a . (e x r) = e . (r x a) for rotations about e
        motions[rows[along], 3:] = np.cross(self.xyz[nodes[along]], axes[along])
        motions[rows[about], 3:] = axes[about]
        return motions
