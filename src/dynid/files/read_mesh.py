"""Solid meshes from files: gmsh (`.msh`), Abaqus, Nastran; VTK, Exodus, MED and others through meshio."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files import exodus
from dynid.files.formats import reader_of
from dynid.files.mesh_data import MeshData, members
from dynid.structure.solid_elements import ELEMENTS, Places
from dynid.structure.solid_mesh import Block, SolidMesh

# Cells without volume: they give node sets.
_FLAT = re.compile(r"vertex|line\d*|triangle\d*|quad\d*|polygon.*")
# The places in Exodus of the nodes of hexahedra beyond the corners and the edges below: there those of the
# vertical edges come before those of the edges above, and the centre before the faces.
_EXODUS = (".exo", ".e", ".g", ".ex2", ".exii")
_IN_EXODUS = {
    "hexahedron20": (*range(12), *range(16, 20), *range(12, 16)),
    "hexahedron27": (*range(12), *range(16, 20), *range(12, 16), 23, 24, 25, 26, 21, 22, 20),
}
_MAX_JUDGED = 10_000


def read_mesh(path: Path, scale: float = 1.0, includes: Sequence[Path] = ()) -> SolidMesh:
    """Read the solids of a mesh, its groups of elements and its sets of nodes; its unit is `scale` metres.

    Groups and sets are physical groups of gmsh, element and node sets of Abaqus, properties of Nastran, and
    those that meshio reads in other formats; a group without a name has its number. Groups of points, lines,
    faces and solids are sets of their nodes as well. Nodes have their numbers in the file; in formats
    without, they count from 1. The file may refer to `includes` alone.
    """
    reader = reader_of(path, "mesh", names=("mesh",))
    try:
        mesh: MeshData = reader(path, includes)
    except FileError as error:
        raise FileError(error.problem, remedy=error.remedy, names=("mesh",)) from None
    xyz = np.zeros((len(mesh.xyz), 3))
    if len(xyz):
        xyz[:, : mesh.xyz.shape[1]] = mesh.xyz
    if not np.isfinite(xyz).all():
        raise FileError(f"{path} has a node without a finite position", names=("mesh",))
    # Files may name kinds of which they have no element.
    filled = [at for at, (_, cells) in enumerate(mesh.cells) if len(cells)]
    solid = [at for at in filled if not _FLAT.fullmatch(mesh.cells[at][0])]
    unknown = sorted({mesh.cells[at][0] for at in solid} - ELEMENTS.keys())
    if unknown:
        raise FileError(
            f"{path} has elements of the kind {', '.join(unknown)}",
            remedy=f"Solids are made of {', '.join(ELEMENTS)}.",
            names=("mesh",),
        )
    if not solid:
        kinds = ", ".join(dict.fromkeys(mesh.cells[at][0] for at in filled)) or "no elements"
        raise FileError(
            f"{path} has no solid elements; it has {kinds}",
            remedy="Mesh the volumes; with physical groups, gmsh saves only these: add one of the volumes.",
            names=("mesh",),
        )
    blocks = tuple(_block(path, *mesh.cells[at], xyz) for at in solid)
    groups: dict[str, tuple[Places, ...]] = {}
    sets = dict(mesh.sets)
    for name, parts in mesh.groups.items():
        if any(len(parts[at]) for at in solid):
            groups[name] = tuple(parts[at] for at in solid)
        nodes = [np.ravel(cells[rows]) for (_, cells), rows in zip(mesh.cells, parts, strict=True)]
        sets[name] = members(np.concatenate([sets.get(name, members(())), *nodes]))
    numbers = mesh.numbers if mesh.numbers is not None else _numbers(path, xyz)
    doubts = (
        ()
        if numbers is not None
        else (f"the numbers of nodes in {path.name} are not read; they count from 1",)
    )
    if numbers is None:
        numbers = tuple(range(1, len(xyz) + 1))
    return SolidMesh(numbers, xyz * scale, blocks, groups, sets, doubts)


def _block(path: Path, kind: str, cells: Places, xyz: Array) -> Block:
    """Return the elements of a kind, checked to have their nodes."""
    nodes = len(ELEMENTS[kind].nodes)
    if cells.shape[1] != nodes or not 0 <= cells.min() <= cells.max() < len(xyz):
        raise FileError(f"{path} has a {kind} without its {nodes} nodes: it is incomplete", names=("mesh",))
    if path.suffix.lower() in _EXODUS and kind in _IN_EXODUS:
        orders = cells[:, _IN_EXODUS[kind]], cells
        cells = min(orders, key=lambda order: _bent(kind, order[:_MAX_JUDGED], xyz))
    return Block(kind, cells)


def _bent(kind: str, cells: Places, xyz: Array) -> float:
    """Return how far the nodes of hexahedra are in all from where they lie between their corners."""
    ends = ELEMENTS[kind].nodes
    near = np.abs(ends[:, None] - ends[None, :8]).max(axis=2) < 1
    mean = near / near.sum(axis=1, keepdims=True)
    return float(np.linalg.norm(xyz[cells] - mean @ xyz[cells[:, :8]], axis=2).sum())


def _numbers(path: Path, xyz: Array) -> tuple[int, ...] | None:
    """Return the numbers of the nodes in a file, which meshio drops; None where they cannot be read."""
    if path.suffix.lower() not in _EXODUS:
        return tuple(range(1, len(xyz) + 1))
    numbers: Sequence[Any] | None = None
    with contextlib.suppress(FileError):
        nodes = exodus.read_nodes(path).nodes
        numbers = _at(xyz, nodes.xyz, nodes.numbers)
    complete = numbers is not None and len(set(numbers)) == len(xyz)
    return tuple(int(number) for number in numbers) if numbers is not None and complete else None


def _at(xyz: Array, places: Array, numbers: Sequence[Any]) -> Sequence[Any] | None:
    """Return the numbers of nodes at positions (n x 3); None where two are at one place, or one at none."""
    if len(places) != len(xyz):
        return None
    if np.array_equal(places, xyz):
        return numbers
    order, order_in_file = np.lexsort(xyz.T), np.lexsort(places.T)
    if not np.array_equal(xyz[order], places[order_in_file]) or len(np.unique(xyz, axis=0)) < len(xyz):
        return None
    sorted_numbers = np.empty(len(xyz), dtype=int)
    sorted_numbers[order] = np.asarray(numbers)[order_in_file]
    return sorted_numbers.tolist()
