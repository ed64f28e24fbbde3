"""Geometry of a structure as a result: nodes, lines, supports, sensors, loads, joints, motion in modes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.result import Result
from dynid.structure.labels import DIRECTIONS, Label, node_direction
from dynid.structure.model import StructuralModel

GROUP = "structure/geometry"
#: Most lines that are kept of a mesh, evenly spaced; most faces; most modes.
MOST_LINES, MOST_FACES, MOST_MODES = 6000, 4000, 12
#: Cells along a mesh that is drawn coarser, at first, and the largest ratio to the next try.
_CELLS, _FEWER_CELLS = 256, 0.95


class Place(NamedTuple):
    """Place and direction of a displacement: basic coordinates, m; a unit vector; True of a rotation."""

    position: Array
    direction: Array
    turns: bool


def place_of(model: StructuralModel, dof: Label) -> Place | None:
    """Return where a DOF or a motion is, and its direction, the sign of its name included.

    A motion is at the mean of its nodes, by the sizes of their weights. None where no node is known.

    Raises UsageError if there is no such DOF.
    """
    if model.nodes is None:
        return None
    sign, label = model.dof_names.find_signed(dof)
    position, direction, weight_of_translations, turning = np.zeros(3), np.zeros(3), 0.0, 0.0
    for moving_dof, weight in model.motions.get(str(label), {label: 1.0}).items():
        node, along = node_direction(moving_dof) or (None, "")
        if node is None or node not in model.nodes.places or not weight:
            return None
        axis = DIRECTIONS.index(along)
        position += abs(weight) * model.nodes.xyz[model.nodes.places[node]]
        direction += sign * weight * model.nodes.axes_of(node)[axis % 3]
        weight_of_translations += abs(weight)
        turning += abs(weight) * (axis >= 3)
    size = float(np.linalg.norm(direction))
    return (
        Place(position / weight_of_translations, direction / size, turning > weight_of_translations / 2)
        if size
        else None
    )


def geometry(
    model: StructuralModel,
    sensors: Iterable[tuple[str, Label]] = (),
    loads: Iterable[Label] = (),
    *,
    supports: bool = True,
) -> Result:
    """Return what a picture of a structure needs; an empty result where its nodes are not known.

    `model`: the full structure, with its joints; `sensors`: name and DOF of each; `loads`: DOFs of forces;
    `supports`: True if displacements that are no DOFs are held; else they may be no part of the model.

    Returns
    -------
    Result
        ``structure/geometry/``: `node`, `position` (node x xyz), `edge` (line x end: places of the two nodes
        in `node`, from 0), `face` (face x corner: likewise, of triangles the last one twice), `held` (node x
        direction x y z of the node's own axes); `sensor`, `load`, each with `_position`, `_direction` (… x
        xyz) and `_turns` (a rotation); `joint`, `joint_position` (joint x end x xyz; of one to ground both
        ends are the same). Of large meshes the outer lines and a coarser surface, with their nodes; the
        attribute `lines` of the group counts all.
    """
    result, nodes = Result("structure"), model.nodes
    if nodes is None:
        return result
    drawn = [[nodes.places[node] for node in line] for line in nodes.lines]
    lines, triangles, squares = (
        np.array([line for line in drawn if len(line) == size], dtype=np.int64).reshape(-1, size)
        for size in (2, 3, 4)
    )
    all_faces = np.concatenate([triangles[:, [0, 1, 2, 2]], squares])
    faces = coarser(all_faces, nodes.xyz, MOST_FACES)
    count = len(np.unique(np.sort(np.concatenate([lines, sides_of(all_faces)]), axis=1), axis=0))
    sides = np.unique(np.sort(sides_of(faces), axis=1), axis=0)
    edges = outer_lines(np.concatenate([lines, sides]), MOST_LINES)
    rows = np.arange(len(nodes.numbers))
    if len(edges) and len(rows) > MOST_LINES:
        rows = np.unique(np.concatenate([edges.ravel(), faces.ravel()]))
    numbers = [nodes.numbers[row] for row in rows]
    result.add_axis(f"{GROUP}/xyz", ["x", "y", "z"])
    result.add_axis(f"{GROUP}/node", [str(node) for node in numbers])
    result.add(f"{GROUP}/position", nodes.xyz[rows], ("node", "xyz"), "m")
    result.add(f"{GROUP}/edge", np.searchsorted(rows, edges), ("line", "end"))
    if len(faces):
        result.add(f"{GROUP}/face", np.searchsorted(rows, faces), ("face", "corner"))
    result.annotate(GROUP, lines=count)
    if supports:  # displacements that are no DOFs although other nodes have them
        free = {node_direction(label) for label in (*model.dofs, *model.motions)}
        ways = [way for way in DIRECTIONS[:3] if any(dof and dof[1] == way for dof in free)]
        held = [[way in ways and (node, way) not in free for way in DIRECTIONS[:3]] for node in numbers]
        result.add(f"{GROUP}/held", np.array(held), ("node", "xyz"))
    add_places(result, model, "sensor", sensors)
    add_places(result, model, "load", ((str(dof), dof) for dof in loads))
    ends = {
        joint.name: [position.position for dof in joint.dofs if (position := place_of(model, dof))]
        for joint in model.joints
    }
    ends = {name: positions for name, positions in ends.items() if positions}
    if ends:
        result.add_axis(f"{GROUP}/joint", list(ends))
        both = [
            [positions[0], max(positions, key=lambda point: float(np.linalg.norm(point - positions[0])))]
            for positions in ends.values()
        ]
        result.add(f"{GROUP}/joint_position", both, ("joint", "end", "xyz"), "m")
    return result


def outer_lines(edges: NDArray[np.int64], max_lines: int) -> NDArray[np.int64]:
    """Return at most so many lines (m x 2), those whose nodes have the fewest neighbours: edges, faces."""
    if len(edges) <= max_lines:
        return edges
    neighbours = np.bincount(edges.ravel())[edges].sum(axis=1)
    return edges[np.sort(np.argsort(neighbours, kind="stable")[:max_lines])]


def sides_of(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the sides of faces (m x 4), each as often as faces have it."""
    sides = np.concatenate([faces[:, [k, (k + 1) % 4]] for k in range(4)])
    return np.asarray(sides[sides[:, 0] != sides[:, 1]])


def coarser(faces: NDArray[np.int64], xyz: Array, max_faces: int) -> NDArray[np.int64]:
    """Return at most so many faces (m x 4): of more, nodes in a cell of a cubic grid become one of them.

    Source: J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering", 1993.
    """
    coarse, cells = faces, float(_CELLS)
    while len(coarse) > max_faces:
        at = np.floor((xyz - xyz.min(axis=0)) * (cells / np.ptp(xyz, axis=0).max())).astype(np.int64)
        places = at @ [(2 * _CELLS) ** 2, 2 * _CELLS, 1]
        _, first, cell = np.unique(places, return_index=True, return_inverse=True)
        moved = first[cell][faces]
        ends = np.sort(moved, axis=1)
        _, kept = np.unique(ends, axis=0, return_index=True)
        coarse = moved[np.sort(kept[(np.diff(ends[kept], axis=1) > 0).sum(axis=1) > 1])]
        cells *= min(_FEWER_CELLS, math.sqrt(max_faces / max(len(coarse), 1)))
    return coarse


def add_places(result: Result, model: StructuralModel, what: str, named: Iterable[tuple[str, Label]]) -> None:
    """Add names of DOFs with their places to the geometry in a result, those whose nodes are known.

    `what`: what they are: the name of the axis; `named`: name and DOF of each. Raises UsageError if there is
    no such DOF.
    """
    placed = [(name, position) for name, dof in named if (position := place_of(model, dof))]
    if placed:
        result.add_axis(f"{GROUP}/{what}", [name for name, _ in placed])
        places = [position for _, position in placed]
        result.add(f"{GROUP}/{what}_position", [item.position for item in places], (what, "xyz"), "m")
        result.add(f"{GROUP}/{what}_direction", [item.direction for item in places], (what, "xyz"))
        result.add(f"{GROUP}/{what}_turns", [item.turns for item in places], (what,))


def add_motion(result: Result, model: StructuralModel) -> None:
    """Add the motion of the nodes in the modes of a result, in basic coordinates, to its geometry.

    `result`: with `geometry` and the modes of `model`; `model`: the structure, full or reduced.

    Notes
    -----
    Adds `displacement` and `rotation` (mode x node x xyz), the latter where there are rotations, of the
    first modes.
    """
    if model.nodes is None or f"{GROUP}/node" not in result or "structure/modes/shape" not in result:
        return
    shapes = model.expand(np.asarray(result["structure/modes/shape"].data)[:, :MOST_MODES])
    places = {name: at for at, name in enumerate(result[f"{GROUP}/node"].data.tolist())}
    moved = np.zeros((2, shapes.shape[1], len(places), 3))
    labels = model.dof_names.labels
    rows = {label: row for row, label in enumerate(labels)}
    motions = list(zip(labels, shapes, strict=True))
    for name, motion in model.motions.items():
        motions.append((name, np.sum([weight * shapes[rows[dof]] for dof, weight in motion.items()], axis=0)))
    for label, motion in motions:
        node, along = node_direction(label) or (None, "")
        if node is not None and node in model.nodes.places and str(node) in places:
            at = DIRECTIONS.index(along)
            moved[at // 3, :, places[str(node)]] += np.outer(motion, model.nodes.axes_of(node)[at % 3])
    result.add_axis(f"{GROUP}/mode", np.arange(1, shapes.shape[1] + 1))
    result.add(f"{GROUP}/displacement", moved[0], ("mode", "node", "xyz"))
    if moved[1].any():
        result.add(f"{GROUP}/rotation", moved[1], ("mode", "node", "xyz"))
