"""Nodes of structures: numbers, positions, the axes of their DOFs, sets, and the lines between them.

A plane structure lies in x–y: u is x, w is y, theta is rz.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from dynid.errors import UsageError
from dynid.structure.labels import DIRECTIONS, Node, node_direction
from dynid.structure.matrices import Array, Label


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of a structure: numbers, positions, and what a picture of them needs.

    Parameters
    ----------
    numbers
        Numbers of the nodes (N); in assemblies of several parts texts such as ``arm.20``.
    xyz
        Positions (N x 3), m, basic coordinates.
    axes
        By node a matrix (3 x 3) whose rows are the directions x, y, z of the node's own DOFs in basic
        coordinates; nodes that are absent have the basic ones.
    sets
        Named sets of nodes.
    lines
        Pairs of nodes: edges to draw.
    notes
        What else their file says, in words: coordinate systems, constraints that are not applied.
    doubts
        Sentences on what contradicts the nodes, does not confirm them, or makes their model inaccurate.
    points
        Nodes that are none of the structure: they move with a node, or with a set of nodes.

    Raises
    ------
    UsageError
        If shapes do not fit, a node stands twice or is not there, or axes are not orthonormal.
    """

    numbers: tuple[Node, ...]
    xyz: Array
    axes: Mapping[Node, Array] = field(default_factory=dict)
    sets: Mapping[str, tuple[Node, ...]] = field(default_factory=dict)
    lines: tuple[tuple[Node, Node], ...] = ()
    notes: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
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
        for node in (*self.axes, *self.points, *(node for one in self.sets.values() for node in one), *ends):
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

        Parameters
        ----------
        labels
            Labels of the DOFs.

        Returns
        -------
        Array
            The displacement, or rotation, of each DOF (len(labels) x 6) in its node's own axes; zeros for
            DOFs of no node.
        """
        names = list(labels)
        motions = np.zeros((len(names), 6))
        found = (node_direction(label) for label in names)
        moved = [
            (row, self.places[place[0]], DIRECTIONS.index(place[1]))
            for row, place in enumerate(found)
            if place is not None and place[0] in self.places
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
