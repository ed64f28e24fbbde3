"""Points: places of a structure that move with a node, or with a set of nodes as a whole.

A point has three displacements and three rotations p about its place. Nodes that are *rigid* move as
``x = R p`` (RBE2), which eliminates their DOFs exactly. A *distributed* point moves as its nodes do in the
mean, by least squares with weights W, ``p = (R^T W R)^-1 R^T W x`` (RBE3); a force f on it acts on the nodes
as ``W R (R^T W R)^-1 f``, whose resultant and moment are those of f. R are the nodes' six rigid-body motions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, Literal, TypeAlias

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.labels import DIRECTIONS, Label, Node, Nodes, node_direction
from dynid.structure.matrices import congruent
from dynid.structure.model import StructuralModel
from dynid.structure.named_dofs import Motion

Spread: TypeAlias = Literal["rigid", "distributed"]

# A rigid-body motion is unseen by nodes that move by less than this part of their largest motion; a direction
# is not determined where more than this part of it lies in unseen motions.
_UNSEEN, _PART = 1e-7, 1e-6
# Weights below this part of the largest are round-off.
_WEIGHT_TOL = 1e-14


@dataclass(frozen=True)
class Point:
    """A node, or a set of nodes that moves as a whole."""

    name: str  # its name; its motions are ``<name>:x`` … ``<name>:rz``, along the basic axes
    nodes: tuple[Node, ...]  # the nodes
    # ``rigid``: the nodes move as one rigid body; ``distributed``: the point follows their mean. A single
    # node is neither.
    spread: Spread = "distributed"
    # Its place, m, basic coordinates; default: the node, or the centre of the nodes.
    at: tuple[float, float, float] | None = None
    # Of a distributed point a weight for each node, in any unit; default: equal ones.
    weights: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PlacedPoint:
    """The motions of a point by the DOFs of its structure.

    `name`: its name; `xyz`: its place (3), m; `dofs`: the DOFs that it follows (m); `weights`: its
    displacements and rotations by these (6 x m); `unseen`: its motions that move none of its nodes (6 x k),
    orthonormal with rotations multiplied by `length`; `length`: size of its node set, m; 1 of a single node.
    """

    name: str
    xyz: Array
    dofs: tuple[Label, ...]
    weights: Array
    unseen: Array
    length: float

    def along(self, direction: Sequence[float] | Array) -> Motion:
        """Return the motion that is the sum of its six with these weights (6).

        Raises UsageError if its nodes do not determine it.
        """
        target = np.asarray(direction, dtype=float)
        if not self.determines(target):
            raise UsageError(
                f"the nodes of the point '{self.name}' do not determine its motion along {_named(target)}: "
                f"{self.hidden(target)} moves none of their DOFs",
                remedy="Take nodes that do, or leave this direction out.",
                names=(f"points.{self.name}",),
            )
        row = target @ self.weights
        row[np.abs(row) <= _WEIGHT_TOL * np.abs(row).max(initial=0.0)] = 0.0
        return {dof: float(weight) for dof, weight in zip(self.dofs, row, strict=True) if weight}

    def determines(self, direction: Sequence[float] | Array) -> bool:
        """Return True if its nodes determine the sum of its motions with these weights (6)."""
        target = np.asarray(direction, dtype=float)
        size = np.linalg.norm(target / _lengths(self.length))
        return bool(np.linalg.norm(self.unseen.T @ target) <= _PART * size)

    @cached_property
    def motions(self) -> Mapping[str, Motion]:
        """Its motions ``<name>:x`` … ``<name>:rz``, as far as its nodes determine them."""
        return {f"{self.name}:{DIRECTIONS[k]}": self.along(np.eye(6)[k]) for k in self.determined}

    @cached_property
    def determined(self) -> list[int]:
        """The motions, from 0, that its nodes determine."""
        return [k for k, unit in enumerate(np.eye(6)) if self.determines(unit)]

    def hidden(self, target: Array) -> str:
        """Return in words the part of a motion (6) that moves none of its nodes."""
        motion = self.unseen @ (self.unseen.T @ target)
        shift, turn = motion[:3], motion[3:]
        if np.linalg.norm(turn) * self.length <= _PART * np.linalg.norm(shift):
            return f"a displacement along {_vector(shift / np.linalg.norm(shift))}"
        axis = turn / np.linalg.norm(turn)
        through = self.xyz + np.cross(turn, shift) / (turn @ turn)
        return f"a rotation about {_vector(axis)} through {_vector(through)}"


def with_points(
    model: StructuralModel, points: Sequence[Point]
) -> tuple[StructuralModel, Mapping[str, PlacedPoint]]:
    """Return a structure in which the motions of points can be named, and the points.

    The DOFs of rigid node sets are replaced by those of their points; their names remain, as motions.

    `model`: the structure, with nodes, without joints, not reduced. Raises UsageError if a node does not
    exist, belongs to two rigid sets, or lacks DOFs that others of its set have.
    """
    if not points:
        return model, {}
    if model.nodes is None:
        raise _refused(
            points[0],
            "needs the places of the nodes, which are not known of these matrices",
            "Give the nodes (`nodes: FILE`), or join DOFs.",
        )
    at_node: dict[Node, list[Label]] = {}
    for label in model.dofs:
        if (node_at := node_direction(label)) is not None:
            at_node.setdefault(node_at[0], []).append(label)
    placed: dict[str, PlacedPoint] = {}
    rigid: dict[str, tuple[tuple[Label, ...], Array, PlacedPoint]] = {}
    held: dict[Node, str] = {}
    for point in points:
        dofs, R, xyz, length = _rigid_motions(model.nodes, at_node, point)
        if len(point.nodes) > 1:
            _check_set(point, dofs, R, xyz, length)
        if point.spread == "rigid" and len(point.nodes) > 1:
            if (twice := next((node for node in point.nodes if node in held), None)) is not None:
                raise _refused(
                    point,
                    f"and the point '{held[twice]}' both hold node {twice} rigidly",
                    "Make one of them distributed, or one point of both.",
                )
            held |= dict.fromkeys(point.nodes, point.name)
            rigid[point.name] = (dofs, *_condensing(point, xyz, R, length))
            placed[point.name] = rigid[point.name][-1]
        else:
            dofs_per_node = len(dofs) // len(point.nodes)
            root = np.repeat(np.sqrt(point.weights or np.ones(len(point.nodes))), dofs_per_node)
            scale = _lengths(length)
            weights = np.linalg.pinv(root[:, None] * R / scale, rcond=_UNSEEN) * root / scale[:, None]
            placed[point.name] = PlacedPoint(point.name, xyz, dofs, weights, _unseen(R, length), length)
    nodes = _with_nodes(model.nodes, points, placed)
    if not rigid:
        motions = {
            name: motion for point_placed in placed.values() for name, motion in point_placed.motions.items()
        }
        return replace(model, nodes=nodes, motions={**model.motions, **motions}), placed
    return _condensed(model, nodes, placed, rigid)


def _rigid_motions(
    nodes: Nodes, at_node: Mapping[Node, Sequence[Label]], point: Point
) -> tuple[tuple[Label, ...], Array, Array, float]:
    """Return the DOFs of a point's nodes (m), these in its six motions (m x 6), its place, and its size."""
    for node in point.nodes:
        if node not in nodes.places:
            raise _refused(point, f"names node {node}, which does not exist", "Name a node of the structure.")
    if len(set(point.nodes)) < len(point.nodes) or not point.nodes:
        raise _refused(point, "needs nodes, each named once", "Name them, or a set.")
    if point.weights and not (
        len(point.weights) == len(point.nodes) and np.isfinite(point.weights).all() and min(point.weights) > 0
    ):
        raise _refused(
            point,
            "needs a positive weight for each of its nodes",
            "Give as many as nodes, or leave them out.",
        )
    motions_of_nodes = {
        node: {along: label for label in at_node.get(node, ()) for along in [node_direction(label)[1]]}  # type: ignore[index]
        for node in point.nodes
    }
    directions_used = set().union(*motions_of_nodes.values())
    for node, there in motions_of_nodes.items():
        if missing := directions_used - there.keys():
            raise _refused(
                point,
                f"has node {node} without DOF {node}:{min(missing, key=DIRECTIONS.index)}, which its other "
                "nodes have",
                "Leave nodes out that a support holds.",
            )
    turning = len(point.nodes) == 1 or point.spread == "rigid"
    kept = [
        along for along in DIRECTIONS if along in directions_used and (turning or along in DIRECTIONS[:3])
    ]
    dofs = tuple(motions_of_nodes[node][along] for node in point.nodes for along in kept)
    places = nodes.xyz[[nodes.places[node] for node in point.nodes]]
    centre = np.average(places, axis=0, weights=point.weights or None)
    xyz = np.array(point.at, dtype=float) if point.at is not None else centre
    length = float(np.sqrt(((places - centre) ** 2).sum(axis=1).mean())) or 1.0
    R = nodes.rigid(dofs)
    R[:, 3:] -= np.cross(xyz, R[:, :3])  # rotations about the point, not about the origin
    return dofs, R, xyz, length


def _check_set(point: Point, dofs: tuple[Label, ...], R: Array, xyz: Array, length: float) -> None:
    """Refuse nodes that do not determine the motions that nodes of their kind do in general."""
    along = {node[1] for dof in dofs if (node := node_direction(dof))}
    rotations = [
        k for k, pair in enumerate(("yz", "xz", "xy"), 3) if {*pair} <= along or DIRECTIONS[k] in along
    ]
    rotations = [k for k in range(3) if DIRECTIONS[k] in along] + rotations
    free = PlacedPoint(point.name, xyz, (), np.empty((6, 0)), _unseen(R, length), length)
    if lacking := [k for k in rotations if k not in free.determined]:
        raise _refused(
            point,
            f"has nodes that do not determine its motion {DIRECTIONS[lacking[0]]}: "
            f"{free.hidden(np.eye(6)[lacking[0]])} moves none of their DOFs",
            "Add a node beside this line, or join single nodes.",
        )


def _lengths(length: float) -> Array:
    """Return what the six motions are multiplied by to be alike."""
    return np.array([1.0, 1.0, 1.0, length, length, length])


def _unseen(R: Array, length: float) -> Array:
    """Return the motions (6 x k) that move none of the DOFs with the rigid-body motions R (m x 6)."""
    scale = _lengths(length)
    _, s, Vt = np.linalg.svd(R / scale)
    rank = int(np.count_nonzero(s > _UNSEEN * s.max(initial=0.0)))
    return np.asarray(Vt[rank:].T / scale[:, None])


def _condensing(point: Point, xyz: Array, R: Array, length: float) -> tuple[Array, PlacedPoint]:
    """Return the DOFs of rigid nodes by those of their point (m x r), and the point by its own DOFs."""
    unseen = _unseen(R, length)
    free = PlacedPoint(point.name, xyz, (), np.empty((6, 0)), unseen, length)
    if len(free.determined) < 6 - unseen.shape[1]:
        said = "has nodes whose rigid motions are not along the basic axes"
        raise _refused(point, said, "Make it distributed, or add nodes.")
    V = np.eye(6)[:, free.determined]
    names = tuple(f"{point.name}:{DIRECTIONS[k]}" for k in free.determined)
    return R @ V, replace(free, dofs=names, weights=V)


def _condensed(
    model: StructuralModel,
    nodes: Nodes,
    placed: Mapping[str, PlacedPoint],
    rigid: Mapping[str, tuple[tuple[Label, ...], Array, PlacedPoint]],
) -> tuple[StructuralModel, Mapping[str, PlacedPoint]]:
    """Return a structure whose rigid node sets have the DOFs of their points, and all points in it."""
    from scipy.sparse import coo_array  # heavy import, for rigid node sets only

    at = {label: index for index, label in enumerate(model.dofs)}
    first = {dofs[0]: name for name, (dofs, _, _) in rigid.items()}
    gone = {dof for dofs, _, _ in rigid.values() for dof in dofs}
    labels: list[Label] = []
    for label in model.dofs:
        if label in first:
            labels += rigid[first[label]][-1].dofs
        if label not in gone:
            labels.append(label)
    new = {label: index for index, label in enumerate(labels)}
    entries = [(at[label], new[label], 1.0) for label in model.dofs if label not in gone]
    for dofs, follows, point in rigid.values():
        entries += [
            (at[dof], new[point_dof], float(weight))
            for dof, row in zip(dofs, follows, strict=True)
            for point_dof, weight in zip(point.dofs, row, strict=True)
            if weight
        ]
    rows, columns, values = zip(*entries, strict=True)
    T: Any = coo_array((values, (rows, columns)), shape=(model.size, len(labels))).tocsr()

    def moved(motion: Motion) -> Motion:
        row = np.zeros(model.size)
        for label, weight in motion.items():
            row[at[label]] = weight
        row = row @ T
        return {labels[k]: float(row[k]) for k in np.flatnonzero(row)}

    def substituted(point: PlacedPoint) -> PlacedPoint:
        if point.name in rigid or gone.isdisjoint(point.dofs):
            return point
        rows = np.zeros((6, model.size))
        rows[:, [at[dof] for dof in point.dofs]] = point.weights
        rows = rows @ T
        used = np.flatnonzero(np.any(rows, axis=0))
        return replace(point, dofs=tuple(labels[k] for k in used), weights=rows[:, used])

    motions_of_points = {name: substituted(point) for name, point in placed.items()}
    motions = {name: moved(motion) for name, motion in model.motions.items()}
    motions |= {str(dof): moved({dof: 1.0}) for dof in model.dofs if dof in gone}
    motions |= {
        name: motion
        for point_dof in motions_of_points.values()
        for name, motion in point_dof.motions.items()
        if name not in new
    }
    T = T.tocsc() if model.is_sparse else T.toarray()
    condensed = replace(
        model,
        **model.mapped(partial(congruent, T)),
        dofs=tuple(labels),
        modal=tuple(part.projected(T) for part in model.modal),
        nodes=nodes,
        motions=motions,
    )
    return condensed, motions_of_points


def _with_nodes(nodes: Nodes, points: Sequence[Point], placed: Mapping[str, PlacedPoint]) -> Nodes:
    """Return nodes with one more for each point, joined to the nodes of its set."""
    for point in points:
        if point.name in nodes.places:
            raise _refused(point, "has the name of a node", "Give it another name.")
    names = [point.name for point in points]
    lines = [(point.name, node) for point in points if len(point.nodes) > 1 for node in point.nodes]
    return replace(
        nodes,
        numbers=(*nodes.numbers, *names),
        xyz=np.concatenate([nodes.xyz, [placed[name].xyz for name in names]]),
        lines=(*nodes.lines, *lines),
        points=(*nodes.points, *names),
    )


def _refused(point: Point, said: str, remedy: str) -> UsageError:
    return UsageError(f"the point '{point.name}' {said}", remedy=remedy, names=(f"points.{point.name}",))


def _named(motion: Array) -> str:
    """Return a direction by its name, else as components."""
    places = np.flatnonzero(motion)
    if len(places) == 1:
        return DIRECTIONS[places[0]]
    parts = (f"{motion[k]:.3g} {DIRECTIONS[k]}" for k in places)
    return " + ".join(parts)


def _vector(values: Array) -> str:
    return f"({', '.join(f'{value + 0.0:.3g}' for value in np.round(values, 12))})"
