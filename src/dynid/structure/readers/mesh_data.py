"""Meshes as files hold them, before their solids are chosen, and the check of the counts that they state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dynid.errors import FileError
from dynid.structure.matrices import Array
from dynid.structure.solid_elements import Places


class MeshData(NamedTuple):
    """Nodes and cells of a file.

    Attributes
    ----------
    xyz
        Positions of the nodes (N x 2 or 3), in the unit of the file.
    numbers
        Numbers of the nodes (N); None where they are not known.
    cells
        Kinds of cells by their names in meshio, and the places of their nodes (e x n), from 0, in its order.
    groups
        Groups of cells by name: for each of `cells` the places of its members.
    sets
        Sets of nodes by name, as places.
    """

    xyz: Array
    numbers: tuple[int, ...] | None
    cells: tuple[tuple[str, Places], ...]
    groups: Mapping[str, tuple[Places, ...]]
    sets: Mapping[str, Places]


def members(rows: Iterable[int]) -> Places:
    """Return places in ascending order, each once."""
    return np.unique(np.asarray([*rows], dtype=np.intp))


def check_count(path: Path, count: int, what: str, available: int, least: int = 1) -> None:
    """Refuse a count that the bytes behind it cannot hold, before anything is allocated.

    Parameters
    ----------
    path
        The file.
    count, what
        The count and what it counts, in the plural.
    available
        The bytes behind it.
    least
        The fewest bytes of each.

    Raises
    ------
    FileError
        If there are too few bytes.
    """
    if not 0 <= count * least <= available:
        raise FileError(
            f"{path} claims {count:,} {what}, more than {available:,} bytes hold: it is truncated or damaged",
            names=("mesh",),
        )


def check_reference(path: Path, named: str, includes: Iterable[Path]) -> Path:
    """Return a file to which a mesh refers, which the scene must name.

    Parameters
    ----------
    path
        The file that refers to it; its folder is where relative paths start.
    named
        Its path as written there.
    includes
        The files that the scene names.

    Raises
    ------
    FileError
        If it is none of them.
    """
    file = path.parent / named
    if file.resolve() not in {one.resolve() for one in includes}:
        raise FileError(
            f"{path} refers to another file, '{named}', which the scene does not name",
            remedy=f"Name it beside the mesh, from the folder of the scene: includes: [{named}].",
            names=("mesh",),
        )
    return file
