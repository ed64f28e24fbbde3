"""Meshes as files hold them, before their solids are chosen, and the edges of elements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.structure.solid_elements import Places


class MeshData(NamedTuple):
    """Nodes and cells of a file."""

    xyz: Array  # positions of the nodes (N x 2 or 3), in the unit of the file
    numbers: tuple[int, ...] | None  # numbers of the nodes (N); None where they are not known
    #: Kinds of cells by their names in meshio, and the places of their nodes (e x n), from 0, in its order.
    cells: tuple[tuple[str, Places], ...]
    #: Groups of cells by name: for each of `cells` the places of its members.
    groups: Mapping[str, tuple[Places, ...]]
    sets: Mapping[str, Places]  # sets of nodes by name, as places


def members(rows: Iterable[int]) -> Places:
    """Return places in ascending order, each once."""
    return np.unique(np.asarray([*rows], dtype=np.intp))


_TRIANGLE, _SQUARE = ((0, 1), (1, 2), (2, 0)), ((0, 1), (1, 2), (2, 3), (3, 0))

_EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "line": ((0, 1),),
    "triangle": _TRIANGLE,
    "quadrilateral": _SQUARE,
    "tetrahedron": (*_TRIANGLE, (0, 3), (1, 3), (2, 3)),
    "pyramid": (*_SQUARE, (0, 4), (1, 4), (2, 4), (3, 4)),
    "wedge": (*_TRIANGLE, (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hexahedron": (*_SQUARE, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
}


def corners(shape: str) -> int:
    """Return the number of corners of an element."""
    return 1 + max(map(max, _EDGES[shape]))


def edges(shape: str, nodes: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield the edges of an element between its corners, the smaller node first; none of too few nodes."""
    if len(nodes) >= corners(shape):
        for a, b in _EDGES[shape]:
            start, end = nodes[a], nodes[b]
            yield (start, end) if start < end else (end, start)
