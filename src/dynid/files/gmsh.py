"""Meshes of gmsh (`.msh`), formats 2 and 4.1, as text or binary.

Elements without a physical group are read as others, an element in several groups is in all of them. Format 2
repeats such an element for each group; it is taken once.
Source: C. Geuzaine, J.-F. Remacle, "Gmsh reference manual", section "Gmsh file formats".
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.errors import FileError
from dynid.files.mesh_data import MeshData, members
from dynid.files.untrusted import check_count, check_size
from dynid.structure.solid_elements import Places

Numbers: TypeAlias = NDArray[Any]

#: Elements by their numbers: name in meshio, number of nodes.
_KINDS = {
    1: ("line", 2), 2: ("triangle", 3), 3: ("quad", 4), 4: ("tetra", 4), 5: ("hexahedron", 8),
    6: ("wedge", 6), 7: ("pyramid", 5), 8: ("line3", 3), 9: ("triangle6", 6), 10: ("quad9", 9),
    11: ("tetra10", 10), 12: ("hexahedron27", 27), 13: ("wedge18", 18), 14: ("pyramid14", 14),
    15: ("vertex", 1), 16: ("quad8", 8), 17: ("hexahedron20", 20), 18: ("wedge15", 15),
    19: ("pyramid13", 13), 20: ("triangle9", 9),
    21: ("triangle10", 10), 22: ("triangle12", 12), 23: ("triangle15", 15), 25: ("triangle21", 21),
    26: ("line4", 4), 27: ("line5", 5), 28: ("line6", 6), 29: ("tetra20", 20), 30: ("tetra35", 35),
    31: ("tetra56", 56), 36: ("quad16", 16), 37: ("quad25", 25), 92: ("hexahedron64", 64),
    93: ("hexahedron125", 125),
}  # fmt: skip
_DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2}
#: The nodes of elements in the order of VTK, where that of gmsh is another.
_ORDERS = {
    "tetra10": (*range(8), 9, 8),
    "hexahedron20": (*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15),
    "hexahedron27": (*range(8), 8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25, 26),
}
_FORMAT = re.compile(rb"\s*\$MeshFormat\s+(\d+(?:\.\d+)?)\s+([01])\s+([48])[ \t]*\r?\n")


_SECTION = re.compile(rb"\$([A-Za-z]+)[ \t]*\r?\n")
_VERSIONS = ("2", "2.0", "2.1", "2.2", "4.1")


class _Elements(NamedTuple):
    """Elements of one kind: numbers of their nodes (e x n), and their physical groups (e x g, 0: none)."""

    kind: int
    nodes: Numbers
    groups: Numbers


def read_gmsh(path: Path, _: Sequence[Path] = ()) -> MeshData:
    """Return the mesh of a file."""
    check_size(path)
    content = path.read_bytes()
    head = _FORMAT.match(content)
    if head is None:
        raise FileError(
            f"{path} is no mesh of gmsh: it does not start with $MeshFormat, its version and its type"
        )
    version = head[1].decode()
    if version not in _VERSIONS:
        raise FileError(
            f"{path} has the format {version} of gmsh; {', '.join(_VERSIONS)} are read",
            remedy="Save it again: gmsh FILE -save -format msh41 -o NEW.",
        )
    try:
        return _File(path, content, head, version == "4.1").mesh()
    except (ValueError, IndexError, KeyError, OverflowError) as error:
        raise FileError(f"{path} is no mesh of gmsh, or damaged: {error}") from None


class _Numbers:
    """The numbers of a section, one after the other."""

    def __init__(self, path: Path, content: bytes, order: str | None) -> None:
        self.path, self.content, self.order, self.at = path, content, order, 0
        self.values = np.empty(0)
        if order is None and content.strip():
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # where something is no number
                try:
                    self.values = np.fromstring(content, sep=" ")
                except (DeprecationWarning, ValueError):  # the latter in later versions of NumPy
                    raise ValueError("a section has what is no number") from None

    def take(self, count: int, form: str) -> Numbers:
        """Return the next numbers; `form` is theirs in binary, without the order of bytes."""
        dtype = np.dtype(f"{self.order or '='}{form}")
        if self.order is None:
            left = len(self.values) - self.at
            if not 0 <= count <= left:
                raise ValueError(f"{count} numbers are stated where {left} stand")
            numbers: Numbers = self.values[self.at : self.at + count]
            self.at += count
            return numbers if form == "f8" else _whole(numbers)
        check_count(self.path, count, "numbers", len(self.content) - self.at, dtype.itemsize)
        numbers = np.frombuffer(self.content, dtype, count, self.at)
        self.at += count * dtype.itemsize
        return numbers.astype(float if form == "f8" else np.int64)


class _File:
    """A file, section by section."""

    def __init__(self, path: Path, content: bytes, head: re.Match[bytes], blocks: bool) -> None:
        self.path, self.content, self.blocks = path, content, blocks
        self.order: str | None = None
        self.at = head.end()
        if head[2] == b"1":
            marker = content[self.at : self.at + 4]
            self.order = {(1).to_bytes(4, "little"): "<", (1).to_bytes(4, "big"): ">"}[marker]
            self.at += 4
        self.size = f"u{head[3].decode()}"
        self.names: dict[tuple[int, int], str] = {}
        self.entities: dict[tuple[int, int], list[int]] = {}
        self.numbers: Numbers = np.empty(0, dtype=np.int64)
        self.xyz: Numbers = np.empty((0, 3))
        self.elements: list[_Elements] = []

    def mesh(self) -> MeshData:
        readers: dict[str, Callable[[_Numbers], None]] = {
            "Nodes": self._node_blocks if self.blocks else self._node_list,
            "Elements": self._element_blocks if self.blocks else self._element_list,
        }
        if self.blocks:
            readers["Entities"] = self._entities
        for name, start, end in self._sections():
            if name == "PartitionedEntities":
                raise FileError(f"{self.path} is partitioned", remedy="Save it as one part.")
            if name == "PhysicalNames":
                for line in self.content[start:end].decode("utf-8", errors="replace").splitlines()[1:]:
                    match = re.fullmatch(r'\s*(\d+)\s+(\d+)\s+"(.*)"\s*', line)
                    if match is not None:
                        self.names[int(match[1]), int(match[2])] = match[3]
            elif name in readers:
                if not self.blocks and self.order is not None:  # counts are text
                    count, _, rest = self.content[start:end].partition(b"\n")
                    self.count, numbers = int(count), _Numbers(self.path, rest, self.order)
                else:
                    numbers = _Numbers(self.path, self.content[start:end], self.order)
                    self.count = -1
                readers[name](numbers)
        return self._assembled()

    def _sections(self) -> Iterator[tuple[str, int, int]]:
        """Yield the sections with the places of their contents."""
        at = self.content.find(b"$EndMeshFormat", self.at)
        at = self.at if at < 0 else at + len(b"$EndMeshFormat")
        while (opening := _SECTION.search(self.content, at)) is not None:
            name = opening[1]
            closing = re.compile(rb"\$End" + name + rb"[ \t]*(?:\r?\n|\Z)").search(
                self.content, opening.end()
            )
            if closing is None:
                raise FileError(f"{self.path} ends within ${name.decode()}: it is incomplete")
            yield name.decode(), opening.end(), closing.start()
            at = closing.end()

    def _counted(self, numbers: _Numbers) -> int:
        """Return the count at the start of a section of format 2."""
        return self.count if self.count >= 0 else int(numbers.take(1, "i4")[0])

    def _entities(self, numbers: _Numbers) -> None:
        for dimension, count in enumerate(numbers.take(4, self.size)):
            check_count(self.path, int(count), "entities", len(numbers.content), 4)
            for _ in range(int(count)):
                (tag,) = numbers.take(1, "i4")
                numbers.take(3 if dimension == 0 else 6, "f8")
                groups = numbers.take(int(numbers.take(1, self.size)[0]), "i4")
                self.entities[dimension, int(tag)] = np.abs(groups).tolist()
                if dimension:
                    numbers.take(int(numbers.take(1, self.size)[0]), "i4")

    def _node_list(self, numbers: _Numbers) -> None:
        count = self._counted(numbers)
        if self.order is None:
            rows = numbers.take(4 * count, "f8").reshape(-1, 4)
            self.numbers, self.xyz = _whole(rows[:, 0]), rows[:, 1:]
            return
        size = 4 + 3 * 8
        check_count(self.path, count, "nodes", len(numbers.content), size)
        rows = np.frombuffer(numbers.content, f"{self.order}i4, 3{self.order}f8", count)
        self.numbers, self.xyz = rows["f0"].astype(np.int64), rows["f1"].astype(float)

    def _node_blocks(self, numbers: _Numbers) -> None:
        blocks, count = (int(n) for n in numbers.take(4, self.size)[:2])
        tags, points = [self.numbers], [self.xyz]
        check_count(self.path, blocks, "blocks of nodes", len(numbers.content))
        for _ in range(blocks):
            dimension, _, parametric = (int(n) for n in numbers.take(3, "i4"))
            (rows,) = numbers.take(1, self.size)
            tags.append(numbers.take(int(rows), self.size))
            width = 3 + (dimension if parametric else 0)
            points.append(numbers.take(int(rows) * width, "f8").reshape(-1, width)[:, :3])
        self.numbers, self.xyz = np.concatenate(tags), np.concatenate(points)
        if len(self.numbers) != count:
            raise ValueError(f"{count} nodes are stated, {len(self.numbers)} stand there")

    def _element_list(self, numbers: _Numbers) -> None:
        left = self._counted(numbers)
        check_count(self.path, left, "elements", len(numbers.content))
        while left > 0:
            if self.order is None:
                _, kind, tags = numbers.take(3, "i4")
                numbers.at -= 3  # they are taken once more below
                run, width, ahead = left, 3 + tags + _nodes(kind), 3
                rows = numbers.values[numbers.at : numbers.at + left * width]
                rows = rows[: len(rows) // width * width].reshape(-1, width)
                differ = np.flatnonzero((rows[:, 1] != kind) | (rows[:, 2] != tags))
                run = int(differ[0]) if len(differ) else min(left, len(rows))
                if not run:
                    raise ValueError(f"{left} elements are missing at the end")
                table = numbers.take(run * width, "i4").reshape(-1, width)
            else:
                kind, run, tags = (int(n) for n in numbers.take(3, "i4"))
                width, ahead = 1 + tags + _nodes(kind), 1
                table = numbers.take(run * width, "i4").reshape(-1, width)
            groups = np.abs(table[:, ahead : ahead + min(tags, 1)])
            self.elements.append(_Elements(kind, table[:, ahead + tags :], groups))
            left -= run

    def _element_blocks(self, numbers: _Numbers) -> None:
        (blocks, *_) = (int(n) for n in numbers.take(4, self.size))
        check_count(self.path, blocks, "blocks of elements", len(numbers.content))
        for _ in range(blocks):
            dimension, tag, kind = (int(n) for n in numbers.take(3, "i4"))
            (rows,) = numbers.take(1, self.size)
            width = 1 + _nodes(kind)
            rows_of_block = numbers.take(int(rows) * width, self.size).reshape(-1, width)
            groups = self.entities.get((dimension, tag), [])
            self.elements.append(
                _Elements(
                    kind,
                    rows_of_block[:, 1:],
                    np.tile(np.array(groups, dtype=np.int64), (len(rows_of_block), 1)),
                )
            )

    def _assembled(self) -> MeshData:
        order = np.argsort(self.numbers, kind="stable")
        ordered = self.numbers[order]
        if np.any(ordered[1:] == ordered[:-1]):
            twice = ordered[1:][ordered[1:] == ordered[:-1]][0]
            raise ValueError(f"two nodes have the number {twice}")
        cells: list[tuple[str, Places]] = []
        grouped: dict[str, list[Places]] = {}
        kinds = list(dict.fromkeys(block.kind for block in self.elements))
        for index, kind in enumerate(kinds):
            name, _ = _KINDS[kind]
            blocks = [block for block in self.elements if block.kind == kind]
            rows = np.concatenate([block.nodes for block in blocks])
            at = np.searchsorted(ordered, rows)
            missing = (at >= len(ordered)) | (ordered[np.minimum(at, len(ordered) - 1)] != rows)
            if missing.any():
                raise ValueError(f"a {name} has the node {rows[missing][0]}, which is not there")
            places = order[at]
            # Format 4.1 has each element once.
            unique, back = (places, np.arange(len(places))) if self.blocks else _unique_rows(places)
            cells.append((name, unique[:, list(_ORDERS[name])] if name in _ORDERS else unique))
            first = 0
            for block in blocks:
                for column in block.groups.T:
                    for tag in np.unique(column[column != 0]).tolist():
                        group = self.names.get((_DIMENSIONS.get(name.rstrip("0123456789"), 3), tag), str(tag))
                        parts = grouped.setdefault(group, [members(()) for _ in kinds])
                        parts[index] = np.union1d(parts[index], back[first + np.flatnonzero(column == tag)])
                first += len(block.nodes)
        groups = {name: tuple(parts) for name, parts in grouped.items()}
        return MeshData(self.xyz, tuple(self.numbers.tolist()), tuple(cells), groups, {})


def _whole(values: Numbers) -> Numbers:
    """Return numbers of text as whole numbers."""
    if not np.abs(values).max(initial=0) < 2**53 or np.any(values != np.floor(values)):
        raise ValueError("a section has what is no whole number")
    return values.astype(np.int64)


def _nodes(kind: int) -> int:
    if kind not in _KINDS:
        raise ValueError(f"elements of type {kind} are not known")
    return _KINDS[kind][1]


def _unique_rows(rows: Places) -> tuple[Places, Places]:
    """Return elements without repetitions in the order of the file, and for each row its place among them."""
    if not len(rows):
        return rows.astype(np.intp), np.empty(0, dtype=np.intp)
    _, first, back = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return rows[kept].astype(np.intp), rank[np.ravel(back)]
