"""Input files of Abaqus and CalculiX (`.inp`): nodes, node sets, elements to draw; constraints are counted.

Source: Dassault Systèmes, "Abaqus Keywords Reference"; G. Dhondt, "CalculiX CrunchiX User's Manual", 2.20.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dynid.errors import FileError
from dynid.files.fe_text import Reference, check_reference, open_included, real
from dynid.files.mesh_data import corners, outlines
from dynid.files.untrusted import read_errors
from dynid.number_format import counted
from dynid.structure.dof_order import NodeFile
from dynid.structure.labels import Nodes

WHAT = "an input file of Abaqus or CalculiX"
#: The most members of all sets of a file.
_MOST_MEMBERS = 20_000_000
_CONSTRAINTS = (
    "BOUNDARY", "EQUATION", "MPC", "COUPLING", "KINEMATIC", "DISTRIBUTING", "RIGID BODY", "TIE",
    "KINEMATIC COUPLING", "DISTRIBUTING COUPLING",
)  # fmt: skip
#: Keywords that make or move nodes, and are not read.
_UNREAD = ("NGEN", "NFILL", "NCOPY", "NMAP", "SYSTEM", "SUBMODEL")
#: Shapes by the patterns of element types.
_SHAPES = (
    (r"C3D4|C3D10|DC3D4|DC3D10|F3D4", "tetrahedron"), (r"C3D5", "pyramid"), (r"C3D6|C3D15|SC6", "wedge"),
    (r"C3D8|C3D20|C3D27|SC8|F3D8", "hexahedron"),
    (r"(S|M3D|STRI|CPS|CPE|CAX|R3D|DS)(3|6|65)(?!\d)", "triangle"),
    (r"(S|M3D|CPS|CPE|CAX|R3D|DS)(4|8|9)", "quadrilateral"), (r"(B|T|PIPE|ELBOW|RB|D1)", "line"),
    (r"SPRINGA|CONN|JOINTC", "line"),
)  # fmt: skip


class Block(NamedTuple):
    """A keyword with its parameters, and its data lines as words."""

    keyword: str
    parameters: dict[str, str]
    lines: list[list[str]]


def read_nodes(path: Path, reference: Reference = check_reference) -> NodeFile:
    """Return nodes and node sets of an input file; `reference` finds or refuses what it includes."""
    with read_errors(path, WHAT):
        places: dict[int, list[float]] = {}
        sets = Sets()
        elements: list[tuple[str, list[int]]] = []
        held: Counter[str] = Counter()
        parts = 0
        for block in blocks(path, reference):
            parts += block.keyword == "PART"
            moved = block.keyword == "INSTANCE" and block.lines
            if parts > 1 or moved or block.keyword in _UNREAD:
                what = "several parts" if parts > 1 else "a moved instance" if moved else f"*{block.keyword}"
                raise FileError(
                    f"{path} has {what}, which is not read",
                    remedy="Write an input file without parts, or a table of nodes (.csv).",
                )
            name = block.parameters.get("NSET", "")
            if block.keyword == "NODE":
                numbers = _nodes(places, block)
                if name:
                    sets.add(name, numbers)
            elif block.keyword == "NSET":
                sets.add(name, sets.listed(block))
            elif block.keyword == "ELEMENT":
                elements += _elements(block)
            elif block.keyword in _CONSTRAINTS:
                held[block.keyword] += 1
            elif block.keyword == "TRANSFORM":
                held["TRANSFORM"] += 1
        if not places:
            raise FileError(f"{path} has no nodes (*NODE)")
        numbers = list(places)
        xyz = np.array([places[number] for number in numbers])
        node_sets = {
            name: tuple(dict.fromkeys(node for node in members if node in places))
            for name, members in sets.named.items()
        }
        drawn = outlines((shape, ends) for shape, ends in elements if places.keys() >= {*ends})
        return NodeFile(Nodes(tuple(numbers), xyz, {}, node_sets, drawn, tuple(_notes(held))), ())


def _notes(held: Counter[str]) -> Iterator[str]:
    turned = held.pop("TRANSFORM", 0)
    if turned:
        yield f"{counted(turned, 'coordinate system')} of *TRANSFORM, which are not applied"
    if held:
        listed = ", ".join(f"{count} *{name}" for name, count in held.items())
        yield f"constraints, which are not applied: {listed}"


def _nodes(places: dict[int, list[float]], block: Block) -> list[int]:
    """Add the nodes of a block; of one that stands twice the last position holds."""
    if block.parameters.get("SYSTEM", "R").upper() != "R":
        raise ValueError("*NODE in a system other than Cartesian is not read")
    numbers = []
    for words in block.lines:
        number = int(words[0])
        point = [real(word) for word in words[1:4]]
        places[number] = point + [0.0] * (3 - len(point))
        numbers.append(number)
    return numbers


class Sets:
    """Sets of numbers by name, in any case of letters; `named` are they by their names as written first."""

    def __init__(self) -> None:
        self.named: dict[str, list[int]] = {}
        self._spelled: dict[str, str] = {}
        self._left = _MOST_MEMBERS

    def add(self, name: str, numbers: Iterable[int]) -> None:
        """Add numbers to a set."""
        added = [*islice(numbers, self._left + 1)]
        self._left -= len(added)
        if self._left < 0:
            raise ValueError(f"its sets have more than {_MOST_MEMBERS} members")
        self.named.setdefault(self._spelled.setdefault(name.upper(), name), []).extend(added)

    def listed(self, block: Block) -> Iterator[int]:
        """Yield the members in a block: numbers, names of other sets, with ``GENERATE`` first, last, step."""
        for words in block.lines:
            if "GENERATE" in block.parameters:
                first, last, step = (int(word) for word in [*[word for word in words if word], "1"][:3])
                if step < 1 or (last - first) // step > self._left:
                    raise ValueError(f"it has a set from {first} to {last} by {step}")
                yield from range(first, last + 1, step)
                continue
            for word in words:
                if word.lstrip("+-").isdigit():
                    yield int(word)
                elif word:
                    yield from self.named.get(self._spelled.get(word.upper().strip('"'), ""), ())


def _elements(block: Block) -> Iterator[tuple[str, list[int]]]:
    """Yield shape and corners of the elements of a block, whose lines go on until all nodes are there."""
    kind = block.parameters.get("TYPE", "").upper()
    shape = next((shape for pattern, shape in _SHAPES if re.match(pattern, kind)), None)
    if shape is None:
        return
    nodes = re.search(r"(?:C3D|SC)(\d+)", kind)
    total = max(int(nodes[1]), corners(shape)) if nodes else 0
    waiting: list[str] = []
    for words in block.lines:
        waiting += [word for word in words if word]
        if len(waiting) > total:
            yield shape, [int(word) for word in waiting[1 : 1 + corners(shape)]]
            waiting = []


def blocks(path: Path, reference: Reference = check_reference) -> Iterator[Block]:
    """Yield the keywords of a file and those that it includes, with their data lines."""
    current: Block | None = None
    continued = ""
    for line in _lines(path, reference, 0, [0]):
        if line.startswith("*"):
            continued = line
        elif continued.endswith(","):  # the parameters of a keyword go on
            continued += line
        else:
            if current is None:
                raise ValueError("it does not start with a keyword (*…)")
            current.lines.append([word.strip() for word in line.split(",")])
            continue
        if continued.endswith(","):
            continue
        if current is not None:
            yield current
        keyword, *parameters = (word.strip() for word in continued[1:].split(","))
        pairs = (word.partition("=") for word in parameters)
        options = {name.strip().upper(): value.strip().strip('"') for name, _, value in pairs}
        current = Block(" ".join(keyword.upper().split()), options, [])
        continued = ""
    if current is not None:
        yield current


def _lines(path: Path, reference: Reference, depth: int, size: list[int]) -> Iterator[str]:
    """Yield the lines of a file and those that it includes, without comments and blanks at their ends."""
    with open_included(path, depth, size) as stream:
        for raw in stream:
            line = raw.strip()
            if not line or line.startswith("**"):
                continue
            reference_line = re.match(
                r"\*(?:INCLUDE|NODE|ELEMENT|NSET|ELSET)\b.*,\s*INPUT\s*=\s*([^,]+)", line, re.IGNORECASE
            )
            if reference_line is None or not line[1:].upper().startswith("INCLUDE"):
                yield line
            if reference_line is not None:
                file = reference(path, reference_line[1].strip().strip("\"'"))
                yield from _lines(file, reference, depth + 1, size)
