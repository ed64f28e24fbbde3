"""Meshes as files hold them, before their solids are chosen, and the outlines of elements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.structure.labels import Outline
from dynid.structure.solid_elements import ELEMENTS, Places


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


#: The outlines of elements by their corners: the line of a beam, the faces of others.
_OUTLINES: dict[str, tuple[tuple[int, ...], ...]] = {
    "line": ((0, 1),),
    "triangle": ((0, 1, 2),),
    "quadrilateral": ((0, 1, 2, 3),),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "tetrahedron": ELEMENTS["tetra"].faces,
    "wedge": ELEMENTS["wedge"].faces,
    "hexahedron": ELEMENTS["hexahedron"].faces,
}


def corners(shape: str) -> int:
    """Return the number of corners of an element."""
    return 1 + max(map(max, _OUTLINES[shape]))


def outlines(elements: Iterable[tuple[str, Sequence[int]]], most: int | None = None) -> tuple[Outline, ...]:
    """Return the lines of beams and the faces of shells and solids, but for those between two solids.

    `elements`: shape and nodes of each; those with too few nodes have none. None of more than `most`.
    """
    thin, solid = (dict[frozenset[int], Outline]() for _ in range(2))
    for shape, nodes in elements:
        drawn = solid if len(_OUTLINES[shape]) > 1 else thin
        for places in _OUTLINES[shape] if len(nodes) >= corners(shape) else ():
            outline = tuple(dict.fromkeys(nodes[place] for place in places))  # elements may be collapsed
            ends = frozenset(outline)
            if len(outline) >= min(3, len(places)):
                drawn[ends] = () if ends in solid else outline
        if most is not None and len(thin) + len(solid) > most:
            return ()
    return tuple(sorted(filter(None, (solid | thin).values())))
