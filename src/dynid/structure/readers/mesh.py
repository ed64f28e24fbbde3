"""Solid meshes from files, read by meshio: gmsh `.msh`, Abaqus `.inp`, VTK, Exodus, MED and others."""

from __future__ import annotations

import contextlib
import io
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.errors import FileError
from dynid.file_access import obstacle
from dynid.structure.matrices import Array
from dynid.structure.readers.read_nodes import read_nodes
from dynid.structure.solid_elements import ELEMENTS, Places

if TYPE_CHECKING:
    import meshio

# Cells without volume: they give node sets.
_FLAT = re.compile(r"vertex|line\d*|triangle\d*|quad\d*|polygon.*")
# The places in Exodus of the nodes of hexahedra beyond the corners and the edges below: there those of the
# vertical edges come before those of the edges above, and the centre before the faces.
_EXODUS = (".exo", ".e", ".ex2")
_IN_EXODUS = {
    "hexahedron20": (*range(12), *range(16, 20), *range(12, 16)),
    "hexahedron27": (*range(12), *range(16, 20), *range(12, 16), 23, 24, 25, 26, 21, 22, 20),
}
_MOST_JUDGED = 10_000
# Formats with numbers of nodes beside gmsh's.
_NUMBERED = (".inp", ".bdf", ".dat", ".nas", *_EXODUS)
# Data of cells whose values are numbers of groups.
_TAGS = ("gmsh:physical", "medit:ref")
# Sets that meshio adds itself.
_OWN = "gmsh:bounding_entities"


class Block(NamedTuple):
    """Elements of one kind: its name in `ELEMENTS`, and the places of their nodes (e x n), from 0."""

    kind: str
    cells: Places


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """A mesh of solid elements.

    Parameters
    ----------
    numbers
        Numbers of the nodes (N).
    xyz
        Positions of the nodes (N x 3), m.
    blocks
        The elements.
    groups
        Named groups of elements: for each block the places of its elements in the group.
    sets
        Named sets of nodes, as places.
    doubts
        What may be wrong with the mesh, a sentence each.
    """

    numbers: tuple[int, ...]
    xyz: Array
    blocks: tuple[Block, ...]
    groups: Mapping[str, tuple[Places, ...]] = field(default_factory=dict)
    sets: Mapping[str, Places] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()


def read_mesh(path: Path, scale: float = 1.0) -> SolidMesh:
    """Read the solids of a mesh, its groups of elements and its sets of nodes.

    Groups and sets are physical groups of gmsh, element and node sets of Abaqus, and those that meshio finds
    in other formats; a group without a name has its number. Groups of points, lines, faces and solids are
    sets of their nodes as well. Nodes have their numbers in the file; in formats without, they count from 1.

    Parameters
    ----------
    path
        The file.
    scale
        Length of its unit, m.

    Raises
    ------
    FileError
        If it cannot be read, holds no solids or elements that are not known, or meshio is not installed.
    """
    found = obstacle(path)
    if found is not None:
        raise FileError(f"{path} {found[0]}", remedy=found[1], names=("mesh",))
    content = path.read_bytes() if path.suffix.lower() == ".msh" else b""
    for section in (b"Nodes", b"Elements"):
        if b"$" + section in content and b"$End" + section not in content:
            raise FileError(f"{path} ends within ${section.decode()}: it is incomplete", names=("mesh",))
    mesh = _read(path)
    xyz = np.zeros((len(mesh.points), 3))
    if len(xyz):
        xyz[:, : np.shape(mesh.points)[1]] = mesh.points
    if not np.isfinite(xyz).all():
        raise FileError(f"{path} has a node without a finite position", names=("mesh",))
    solid = [at for at, block in enumerate(mesh.cells) if not _FLAT.fullmatch(block.type)]
    unknown = sorted({mesh.cells[at].type for at in solid} - ELEMENTS.keys())
    if unknown:
        raise FileError(
            f"{path} has elements of the kind {', '.join(unknown)}",
            remedy=f"Solids are made of {', '.join(ELEMENTS)}.",
            names=("mesh",),
        )
    if not any(len(mesh.cells[at].data) for at in solid):
        kinds = ", ".join(dict.fromkeys(block.type for block in mesh.cells)) or "no elements"
        raise FileError(
            f"{path} has no solid elements; it has {kinds}",
            remedy="Mesh the volumes; with physical groups, gmsh saves only these: add one of the volumes.",
            names=("mesh",),
        )
    blocks = tuple(_block(path, mesh.cells[at], xyz) for at in solid)
    groups: dict[str, tuple[Places, ...]] = {}
    sets = {name: _unique(places) for name, places in mesh.point_sets.items()}
    for name, members in _cell_groups(mesh).items():
        if any(len(members[at]) for at in solid):
            groups[name] = tuple(members[at] for at in solid)
        nodes = [block.data[member] for block, member in zip(mesh.cells, members, strict=True)]
        sets[name] = _unique(np.concatenate([sets.get(name, []), *(np.ravel(one) for one in nodes)]))
    numbers = _numbers(path, content, xyz)
    doubts = (
        ()
        if numbers is not None
        else (f"the numbers of nodes in {path.name} are not read; they count from 1",)
    )
    if numbers is None:
        numbers = tuple(range(1, len(xyz) + 1))
    return SolidMesh(numbers, xyz * scale, blocks, groups, sets, doubts)


def _block(path: Path, block: meshio.CellBlock, xyz: Array) -> Block:
    """Return the elements of a kind, checked to have their nodes."""
    cells = np.asarray(block.data, dtype=np.intp).reshape(len(block.data), -1)
    nodes = len(ELEMENTS[block.type].nodes)
    if cells.shape[1] != nodes or (cells.size and not 0 <= cells.min() <= cells.max() < len(xyz)):
        raise FileError(
            f"{path} has a {block.type} without its {nodes} nodes: it is incomplete", names=("mesh",)
        )
    if path.suffix.lower() in _EXODUS and block.type in _IN_EXODUS:
        orders = cells[:, _IN_EXODUS[block.type]], cells
        cells = min(orders, key=lambda order: _bent(block.type, order[:_MOST_JUDGED], xyz))
    return Block(block.type, cells)


def _bent(kind: str, cells: Places, xyz: Array) -> float:
    """Return how far the nodes of hexahedra are in all from where they lie between their corners.

    Other programs write Exodus in its own order of nodes, meshio in that of VTK.
    """
    ends = ELEMENTS[kind].nodes
    near = np.abs(ends[:, None] - ends[None, :8]).max(axis=2) < 1
    mean = near / near.sum(axis=1, keepdims=True)
    return float(np.linalg.norm(xyz[cells] - mean @ xyz[cells[:, :8]], axis=2).sum())


def _unique(places: Any) -> Places:
    return np.unique(np.asarray(places, dtype=np.intp))


def _read(path: Path) -> meshio.Mesh:
    """Read a mesh, what meshio prints caught for the message of an error."""
    try:
        import meshio  # of an extra
    except ImportError:
        raise FileError(
            f"{path} cannot be read without meshio",
            remedy="Install it: pip install 'dynid[laboratory]'.",
            names=("mesh",),
        ) from None
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return meshio.read(path)
    except (Exception, SystemExit) as error:  # readers of many formats fail in many ways; meshio may exit
        reason = next((line for line in reversed(said.getvalue().splitlines()) if line.strip()), "")
        reason = str(error) if not isinstance(error, SystemExit) and str(error) else reason
        raise FileError(
            f"{path} is no mesh that meshio reads: {' '.join(reason.split()) or type(error).__name__}",
            names=("mesh",),
        ) from None


def _cell_groups(mesh: meshio.Mesh) -> dict[str, list[Places]]:
    """Return the groups of cells of all dimensions by name: for each block of cells the places in it."""
    found: dict[str, list[Places]] = {}
    tagged = ((name, value) for name, value in mesh.field_data.items() if np.shape(value) == (2,))
    names = {(int(tag), int(dimension)): name for name, (tag, dimension) in tagged}

    def add(name: str, at: int, members: Iterable[int]) -> None:
        each = found.setdefault(name, [np.empty(0, dtype=np.intp) for _ in mesh.cells])
        each[at] = _unique([*each[at], *members])

    for name, parts in mesh.cell_sets.items():
        for at, members in enumerate(parts if name != _OWN else ()):
            if members is not None and len(members):
                add(name, at, members)
    for data in _TAGS:
        for at, tags in enumerate(mesh.cell_data.get(data, ())):
            for tag in np.unique(tags):
                name = names.get((int(tag), mesh.cells[at].dim), str(tag))
                if tag:  # 0: of no group
                    add(name, at, np.flatnonzero(tags == tag))
    return found


def _numbers(path: Path, content: bytes, xyz: Array) -> tuple[int, ...] | None:
    """Return the numbers of the nodes in a file, which meshio drops; None where they cannot be read.

    In formats without numbers they are 1 … n.
    """
    numbers: Sequence[Any] | None = None
    if path.suffix.lower() == ".msh":
        with contextlib.suppress(ValueError, IndexError):
            numbers = _gmsh_numbers(content)
    elif path.suffix.lower() in _NUMBERED:
        with contextlib.suppress(FileError):
            nodes = read_nodes(path).nodes
            numbers = _at(xyz, nodes.xyz, nodes.numbers)
    else:
        return tuple(range(1, len(xyz) + 1))
    known = numbers is not None and len(set(numbers)) == len(xyz)
    return tuple(int(number) for number in numbers) if numbers is not None and known else None


def _at(xyz: Array, places: Array, numbers: Sequence[Any]) -> Sequence[Any] | None:
    """Return the numbers of nodes at positions (n x 3); None where two are at one place, or one at none."""
    if len(places) != len(xyz):
        return None
    if np.array_equal(places, xyz):
        return numbers
    one, other = np.lexsort(xyz.T), np.lexsort(places.T)
    if not np.array_equal(xyz[one], places[other]) or len(np.unique(xyz, axis=0)) < len(xyz):
        return None
    found = np.empty(len(xyz), dtype=int)
    found[one] = np.asarray(numbers)[other]
    return found.tolist()


def _gmsh_numbers(content: bytes) -> list[int] | None:
    """Return the numbers of the nodes of a text file of gmsh, format 2 or 4.1; None of others."""
    form = re.search(rb"\$MeshFormat\s+(\S+)\s+(\d)", content)
    section = re.search(rb"\$Nodes\r?\n(.*?)\$EndNodes", content, re.DOTALL)
    if form is None or section is None or form[2] != b"0":
        return None
    lines = section[1].decode("ascii").splitlines()
    if form[1].startswith(b"2"):
        return [int(line.split(maxsplit=1)[0]) for line in lines[1:]]
    if not form[1].startswith(b"4.1"):
        return None
    numbers, at = [], 1
    while at < len(lines):
        count = int(lines[at].split()[3])
        numbers += [int(line) for line in lines[at + 1 : at + 1 + count]]
        at += 1 + 2 * count
    return numbers
