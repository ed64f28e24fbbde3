"""Meshes of solid elements, their orientation, shared faces, parts, and edges of the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.solid_elements import ELEMENTS, Places, jacobians

# A Jacobian below this part of the largest of its element is zero.
_JACOBIAN_TOL = 1e-10
# Nodes nearer to each other than this part of the size of the mesh are at one place.
_COINCIDENT_NODE_TOL = 1e-8
_CELL_CHUNK = 20_000


class Block(NamedTuple):
    """Elements of one kind: its name in `ELEMENTS`, and the places of their nodes (e x n), from 0."""

    kind: str
    cells: Places


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """A mesh of solid elements.

    `numbers`: numbers of the nodes (N); `xyz`: positions of the nodes (N x 3), m; `blocks`: the elements;
    `groups`: named groups of elements: for each block the places of its elements in the group; `sets`: named
    sets of nodes, as places; `doubts`: what may be wrong with the mesh, a sentence each.
    """

    numbers: tuple[int, ...]
    xyz: Array
    blocks: tuple[Block, ...]
    groups: Mapping[str, tuple[Places, ...]] = field(default_factory=dict)
    sets: Mapping[str, Places] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()


class _Surface(NamedTuple):
    """Properties of a mesh that its faces show.

    `faces`: the outer faces by their corners (places, m x 3 or 4, kind by kind); `parts`: of each element,
    block by block, the part that it belongs to: elements of a part are joined by faces.
    """

    faces: tuple[Places, ...]
    parts: NDArray[np.int32]


def check_elements(mesh: SolidMesh) -> None:
    """Refuse meshes of elements that do not fit together, and elements that are inverted or flat.

    Elements that all have the opposite orientation, as in a mirrored mesh, are as good.

    Raises UsageError naming the nodes of the first.
    """
    orders = {ELEMENTS[block.kind].order for block in mesh.blocks if len(block.cells)}
    if len(orders) > 1:
        raise UsageError(
            "the mesh mixes elements of first and second order, whose nodes do not fit",
            remedy="Make all elements of second order.",
            names=("mesh",),
        )
    signs = []
    for block in mesh.blocks:
        for start in range(0, len(block.cells), _CELL_CHUNK):
            cells = block.cells[start : start + _CELL_CHUNK]
            det = np.linalg.det(jacobians(ELEMENTS[block.kind], mesh.xyz[cells]))
            low, high, size = det.min(axis=1), det.max(axis=1), np.abs(det).max(axis=1)
            length = np.ptp(mesh.xyz[cells], axis=1).max(axis=1)
            bad = (low <= _JACOBIAN_TOL * size) & (high >= -_JACOBIAN_TOL * size) | (
                size <= _JACOBIAN_TOL * length**3
            )
            if np.any(bad):
                _refuse(mesh, Block(block.kind, cells), int(np.argmax(bad)), "is flat or folded")
            signs.append((Block(block.kind, cells), np.sign(low)))
    positive = sum(int((sign > 0).sum()) for _, sign in signs)
    total = sum(len(sign) for _, sign in signs)
    rare = -1.0 if 2 * positive >= total else 1.0
    for block, sign in signs:
        if 0 < positive < total and np.any(sign == rare):
            _refuse(mesh, block, int(np.argmax(sign == rare)), "is inverted")


def _refuse(mesh: SolidMesh, block: Block, at: int, what: str) -> None:
    nodes = block.cells[at]
    named = ", ".join(str(mesh.numbers[node]) for node in nodes[: len(ELEMENTS[block.kind].corners)])
    x, y, z = mesh.xyz[nodes].mean(axis=0)
    raise UsageError(
        f"the {block.kind} of nodes {named} near ({x:.4g}, {y:.4g}, {z:.4g}) m {what}",
        remedy="Repair the mesh there.",
        names=("mesh",),
    )


def surface(mesh: SolidMesh) -> _Surface:
    """Return the faces of a mesh's surface, and its parts.

    Raises UsageError if more than two elements share a face.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components  # heavy imports, for meshes only

    count, elements = len(mesh.xyz), 0
    three, owners, corners = [], [], []
    for block in mesh.blocks:
        for face in ELEMENTS[block.kind].faces:
            nodes = block.cells[:, face]
            three.append(np.sort(nodes, axis=1)[:, :3])  # three corners say which face it is
            owners.append(elements + np.arange(len(nodes)))
            corners.append(nodes)
        elements += len(block.cells)
    a, b, c = np.concatenate(three).T
    _, edge = np.unique(a * count + b, return_inverse=True)  # the product of three numbers may overflow
    _, first, inverse, times = np.unique(
        edge * count + c, return_index=True, return_inverse=True, return_counts=True
    )
    if times.max() > 2:
        faces = [nodes for nodes in corners for nodes in nodes]
        named = ", ".join(str(mesh.numbers[node]) for node in faces[first[int(np.argmax(times))]])
        raise UsageError(
            f"{times.max()} elements share the face of nodes {named}: elements overlap",
            remedy="Repair the mesh there.",
            names=("mesh",),
        )
    owner = np.concatenate(owners)
    order = np.argsort(inverse, kind="stable")
    pairs = order[np.repeat(times == 2, times)].reshape(-1, 2)
    links = coo_array((np.ones(len(pairs)), owner[pairs].T), shape=(elements, elements))
    parts = connected_components(links, directed=False)[1]
    outer = np.split(times[inverse] == 1, np.cumsum([len(nodes) for nodes in corners])[:-1])
    return _Surface(tuple(nodes[free] for nodes, free in zip(corners, outer, strict=True)), parts)


def doubled_nodes(xyz: Array) -> int:
    """Return the number of pairs of nodes at one place."""
    from scipy.spatial import cKDTree  # heavy import, for meshes of several parts

    size = float(np.ptp(xyz, axis=0).max())
    return len(cKDTree(xyz).query_pairs(_COINCIDENT_NODE_TOL * size))
