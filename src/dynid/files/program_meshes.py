"""Meshes in input files of FE programs: Abaqus and CalculiX (`.inp`), Nastran bulk data (`.bdf`, `.nas`, …).

Only solids and their sets are read. Other elements give sets of nodes. Groups are element sets of Abaqus, and
property numbers of Nastran. Other files that a file includes are read where the scene names them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files import bulk_data, input_file
from dynid.files.fe_text import check_reference
from dynid.files.mesh_data import MeshData, members
from dynid.files.untrusted import read_errors
from dynid.structure.solid_elements import Places

_ABAQUS = {
    "C3D4": "tetra", "C3D10": "tetra10", "C3D6": "wedge", "C3D15": "wedge15", "C3D5": "pyramid",
    "C3D8": "hexahedron", "C3D20": "hexahedron20",
}  # fmt: skip
#: Elements with a volume that are none of these.
_OTHER_SOLIDS = re.compile(r"[A-Z]*C3D|F3D|SC\d|CSS|CIN3D|COH3D")
_NASTRAN = {
    ("CTETRA", 4): "tetra", ("CTETRA", 10): "tetra10", ("CPENTA", 6): "wedge", ("CPENTA", 15): "wedge15",
    ("CPYRAM", 5): "pyramid", ("CPYRAM", 13): "pyramid13",
    ("CHEXA", 8): "hexahedron", ("CHEXA", 20): "hexahedron20",
}  # fmt: skip
_MOST_NODES = {"CTETRA": 10, "CPENTA": 15, "CPYRAM": 13, "CHEXA": 20}
#: Nastran has the nodes of vertical edges before those of the edges above.
_ORDERS = {"hexahedron20": (*range(12), *range(16, 20), *range(12, 16))}


class _Cells:
    """Elements by kind, with their numbers, and groups of these."""

    def __init__(self) -> None:
        self.nodes: dict[str, list[list[int]]] = {}
        self.rows: dict[int, tuple[str, int]] = {}
        self.groups = input_file.Sets()

    def add(self, number: int, kind: str, nodes: list[int]) -> None:
        if number in self.rows:
            raise ValueError(f"two elements have the number {number}")
        listed = self.nodes.setdefault(kind, [])
        self.rows[number] = kind, len(listed)
        listed.append(nodes)

    def mesh(self, numbers: Sequence[int], xyz: Array, sets: dict[str, Places]) -> MeshData:
        places = {number: index for index, number in enumerate(numbers)}
        missing = next(
            (node for rows in self.nodes.values() for row in rows for node in row if node not in places), 0
        )
        if missing:
            raise ValueError(f"an element has the node {missing}, which is not there")
        kinds = list(self.nodes)
        cells = tuple(
            (kind, np.array([[places[n] for n in row] for row in self.nodes[kind]])) for kind in kinds
        )
        groups = {}
        for name, elements in self.groups.named.items():
            by_kind: dict[str, list[int]] = {kind: [] for kind in kinds}
            for kind, row in (self.rows[number] for number in elements if number in self.rows):
                by_kind[kind].append(row)
            groups[name] = tuple(members(by_kind[kind]) for kind in kinds)
        return MeshData(xyz, tuple(numbers), cells, groups, sets)


def read_abaqus(path: Path, includes: Sequence[Path]) -> MeshData:
    """Return the mesh of an input file of Abaqus or CalculiX."""
    allowed = partial(check_reference, includes=includes)
    nodes = input_file.read_nodes(path, allowed).nodes
    with read_errors(path, input_file.WHAT):
        cells = _Cells()
        for block in input_file.blocks(path, allowed):
            name = block.parameters.get("ELSET", "")
            if block.keyword == "ELEMENT":
                elements = [*_abaqus_elements(block)]
                for element in elements:
                    cells.add(*element)
                if name and elements:
                    cells.groups.add(name, [number for number, *_ in elements])
            elif block.keyword == "ELSET" and name:
                cells.groups.add(name, cells.groups.listed(block))
        places = {number: index for index, number in enumerate(nodes.numbers)}
        sets = {name: members(places[node] for node in listed) for name, listed in nodes.sets.items() if name}
        return cells.mesh([int(number) for number in nodes.numbers], nodes.xyz, sets)


def _abaqus_elements(block: input_file.Block) -> Iterator[tuple[int, str, list[int]]]:
    """Yield number, kind and nodes of the elements of a block; lines go on until all nodes are there."""
    kind = block.parameters.get("TYPE", "").upper()
    solid = re.match(r"C3D\d+", kind)
    count = int(solid[0][3:]) if solid else 0
    name = _ABAQUS.get(solid[0], kind) if solid else kind if _OTHER_SOLIDS.match(kind) else ""
    waiting: list[int] = []
    for words in block.lines:
        waiting += [int(word) for word in words if word]
        # Of other elements a line ends with a comma where the next one goes on.
        if len(waiting) > count if count else words[-1]:
            if count and len(waiting) != count + 1:
                raise ValueError(f"element {waiting[0]} of type {kind} has {len(waiting) - 1} nodes")
            yield waiting[0], name or f"polygon{len(waiting) - 1}", waiting[1:]
            waiting = []
    if waiting:
        raise ValueError(
            f"element {waiting[0]} of type {kind} has {len(waiting) - 1} nodes: it is incomplete"
        )


def read_nastran(path: Path, includes: Sequence[Path]) -> MeshData:
    """Return the mesh of Nastran bulk data, nodes in the order of the file."""
    allowed = partial(check_reference, includes=includes)
    with read_errors(path, bulk_data.WHAT):
        cards = bulk_data.read_cards(path, {*bulk_data.KEPT, *_MOST_NODES}, allowed)
        nodes = bulk_data.nodes_of(path, cards).nodes
        cells = _Cells()
        for card_name, max_nodes in _MOST_NODES.items():
            for card in cards.get(card_name, ()):
                ends = [bulk_data.integer(field) for field in card[3 : 3 + max_nodes]]
                while ends and not ends[-1]:
                    ends.pop()
                number = bulk_data.integer(card[1])
                kind = _NASTRAN.get((card_name, len(ends)))
                if kind is None or 0 in ends:
                    raise FileError(
                        f"{path}: {card_name} {number} has {len(ends) - ends.count(0)} nodes: all of its "
                        "edges have a node, or none"
                    )
                cells.add(number, kind, [ends[index] for index in _ORDERS.get(kind, range(len(ends)))])
                cells.groups.add(card[2] or card[1], [number])
        listed = list(dict.fromkeys(bulk_data.integer(card[1]) for card in cards.get("GRID", ())))
        at = {number: index for index, number in enumerate(nodes.numbers)}
        listed = [number for number in listed if number in at]
        return cells.mesh(listed, nodes.xyz[[at[number] for number in listed]], {})
