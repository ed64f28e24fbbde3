"""Nastran bulk data (`.bdf`, `.dat`, `.nas`, `.pch`): nodes, orders of DOFs, and labelled DMIG matrices.

Cards have fields of 8 or 16 columns or separated by commas, continuations in order, `INCLUDE`. Constraints
(SPC, MPC, rigid elements) are counted, not applied.
Source: MSC Nastran Quick Reference Guide, "Bulk Data Entries", "DMIG".
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files.coordinate_systems import BASIC, CoordinateSystem
from dynid.files.fe_text import Reference, check_reference, open_included, real
from dynid.files.matrix_data import COMPLEX, Container, ImportedMatrix
from dynid.files.mesh_data import corners, outlines
from dynid.files.untrusted import read_errors
from dynid.number_format import counted
from dynid.structure.dof_order import DofOrder, NodeFile
from dynid.structure.labels import DIRECTIONS, Label, Node, Nodes

_CONSTRAINTS = (
    "SPC", "SPC1", "SPCD", "MPC", "RBE1", "RBE2", "RBE3", "RBAR", "RBAR1", "RROD", "RJOINT", "RTRPLT",
    "RSPLINE", "SUPORT", "SUPORT1", "OMIT", "OMIT1",
)  # fmt: skip
#: Elements by shape: the places of their nodes among the fields behind the name start there.
_ELEMENTS = {
    "PLOTEL": ("line", 1), "CONROD": ("line", 1),
    **dict.fromkeys(("CROD", "CTUBE", "CBAR", "CBEAM", "CBUSH"), ("line", 2)),
    **dict.fromkeys(("CTRIA3", "CTRIA6", "CTRIAR"), ("triangle", 2)),
    **dict.fromkeys(("CQUAD4", "CQUAD8", "CQUADR", "CSHEAR"), ("quadrilateral", 2)),
    "CTETRA": ("tetrahedron", 2), "CPYRAM": ("pyramid", 2), "CPENTA": ("wedge", 2),
    "CHEXA": ("hexahedron", 2),
}  # fmt: skip
_SYSTEMS = ("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")
_KINDS: dict[str, Literal["cartesian", "cylindrical", "spherical"]] = {
    "R": "cartesian",
    "C": "cylindrical",
    "S": "spherical",
}
_ASETS = ("ASET", "ASET1", "BSET", "BSET1", "CSET", "CSET1", "QSET", "QSET1")
KEPT = {"GRID", "GRDSET", "SPOINT", "EXTRN", *_SYSTEMS, *_ASETS, *_ELEMENTS, *_CONSTRAINTS}


def read_nodes(path: Path) -> NodeFile:
    """Return the nodes of bulk data, and the orders of DOFs of its a-set and g-set."""
    with read_errors(path, WHAT):
        cards = read_cards(path, KEPT)
        return nodes_of(path, cards)


def nodes_of(path: Path, cards: Mapping[str, Sequence[Card]], orders: Sequence[DofOrder] = ()) -> NodeFile:
    """Return the nodes of cards by name; `orders` of DOFs that are known from elsewhere come first."""
    grids = _grids(path, cards)
    scalars = sorted({point for card in cards.get("SPOINT", ()) for point in _listed_points(card)})
    if not grids:
        raise FileError(f"{path} has no nodes (GRID)")
    systems = _systems(cards, grids)

    def system(number: int) -> CoordinateSystem:
        if number not in systems:
            raise FileError(f"{path}: coordinate system {number} is not in the file")
        return systems[number]

    physical = {node: grid for node, grid in grids.items() if grid.output >= 0}  # -1: a point of a fluid
    numbers = sorted(physical)
    xyz = np.array([system(physical[n].input).basic(physical[n].position) for n in numbers]).reshape(-1, 3)
    axes: dict[Node, Array] = {}
    for node, point in zip(numbers, xyz, strict=True):
        output = physical[node].output
        if output and not np.array_equal(turned := system(output).at(point), np.eye(3)):
            axes[node] = turned
    elements = (
        (shape, [integer(field) for field in card[first + 1 : first + 1 + corners(shape)]])
        for name, (shape, first) in _ELEMENTS.items()
        for card in cards.get(name, ())
    )
    drawn = outlines((shape, ends) for shape, ends in elements if physical.keys() >= {*ends})
    components = {**dict.fromkeys(grids, "123456"), **dict.fromkeys(scalars, "0")}
    components |= {node: "0" for node in grids if node not in physical}
    dof_orders = [*orders, *_orders(cards, components)]
    used = {grid.output for grid in physical.values()} | {grid.input for grid in physical.values()}
    notes = [counted(len(scalars), "scalar point")] * bool(scalars)
    fluid = len(grids) - len(physical)
    if fluid:
        notes.append(f"{counted(fluid, 'point')} of a fluid")
    if used - {0}:
        notes.append(counted(len(used - {0}), "coordinate system"))
    if axes:
        notes.append(f"DOFs of {counted(len(axes), 'node')} in other than basic coordinates")
    held = Counter({name: len(cards[name]) for name in _CONSTRAINTS if cards.get(name)})
    if held:
        listed = ", ".join(f"{count} {name}" for name, count in held.items())
        notes.append(f"constraints, which are not applied: {listed}")
    nodes = Nodes(tuple(numbers), xyz, axes, {}, drawn, tuple(notes))
    return NodeFile(nodes, tuple(dof_orders))


def _orders(cards: Mapping[str, Sequence[Card]], all_components: Mapping[int, str]) -> Iterator[DofOrder]:
    """Yield the orders of DOFs: of an external superelement, of the a-set, of the g-set."""
    outside = [
        (integer(node), components)
        for card in cards.get("EXTRN", ())
        for node, components in zip(card[1::2], card[2::2], strict=False)
        if node
    ]
    if outside:
        yield DofOrder("EXTRN", tuple(label for pair in outside for label in component_labels(*pair)), True)
    kept: dict[int, set[str]] = {}
    for name in _ASETS:
        for card in cards.get(name, ()):
            if name.endswith("1"):
                pairs = [(node, card[1]) for node in _listed_points(card[1:])]
            else:
                pairs = [(integer(n), c) for n, c in zip(card[1::2], card[2::2], strict=False) if n]
            for node, components in pairs:
                kept.setdefault(node, set()).update(components or "0")
    if kept:
        analysed = (component_labels(node, "".join(sorted(kept[node]))) for node in sorted(kept))
        yield DofOrder("a-set", tuple(label for labels_of_node in analysed for label in labels_of_node), True)
    labels = tuple(
        label for node in sorted(all_components) for label in component_labels(node, all_components[node])
    )
    yield DofOrder("g-set", labels, True)
    held = set(_constrained(cards, _HELD))
    dependent = set(_constrained(cards, _DEPENDENT))
    for name, without in (("SPC", held), ("MPC", dependent), ("SPC and MPC", held | dependent)):
        left = tuple(label for label in labels if label not in without)
        if len(left) < len(labels):
            yield DofOrder(f"g-set without {name}", left, False)


#: By card the places of components and nodes: of all nodes behind a place, or of pairs.
_Places: TypeAlias = Mapping[str, Sequence[tuple[int, int | None]]]
_HELD: _Places = {"GRID": [(7, 1)], "SPC": [(3, 2), (6, 5)], "SPC1": [(2, None)]}
_DEPENDENT: _Places = {"MPC": [(3, 2)], "RBE2": [(3, None)], "RBE3": [(4, 3)]}


def _constrained(cards: Mapping[str, Sequence[Card]], kinds: _Places) -> Iterator[Label]:
    """Yield the DOFs that constraints remove; which of their sets a run has selected is not known."""
    default = (cards.get("GRDSET") or [[""] * 9])[0][7]
    for name, places in kinds.items():
        for card in cards.get(name, ()):
            for at, node in places:
                along = card[at] or (default if name == "GRID" else "")
                if not along.isdecimal():
                    continue
                nodes = [integer(card[node])] if node is not None else _listed_points(card[at:])
                for grid in nodes:
                    yield from component_labels(grid, along)


def component_labels(node: int, components: str) -> list[Label]:
    """Return the labels of a node's DOFs by components ``1`` … ``6``; of a scalar point its number."""
    along = [DIRECTIONS[int(digit) - 1] for digit in components if digit in "123456"]
    return [f"{node}:{direction}" for direction in along] if along else [node]


class _Grid(NamedTuple):
    """A node: its input system, position in that, and system of its displacements."""

    input: int
    position: Array
    output: int


def _grids(path: Path, cards: Mapping[str, Sequence[Card]]) -> dict[int, _Grid]:
    base = (cards.get("GRDSET") or [[""] * 9])[0]
    grids: dict[int, _Grid] = {}
    for card in cards.get("GRID", ()):
        node = integer(card[1])
        position = np.array([real(field) for field in card[3:6]])
        grid = _Grid(integer(card[2] or base[2]), position, integer(card[6] or base[6]))
        old = grids.setdefault(node, grid)
        if old is not grid and (old[::2] != grid[::2] or not np.allclose(old.position, position)):
            raise FileError(
                f"{path} has two different nodes {node}",
                remedy="Give a file with one superelement.",
            )
    return grids


def _systems(cards: Mapping[str, Sequence[Card]], grids: Mapping[int, _Grid]) -> dict[int, CoordinateSystem]:
    """Return the coordinate systems by number, those that others refer to first."""
    waiting: dict[int, tuple[str, list[str]]] = {}
    for name in _SYSTEMS:
        for card in cards.get(name, ()):
            if name[4] == "2":
                waiting[integer(card[1])] = name, card[2:12]
            else:
                for start in (1, 5):
                    if card[start]:
                        waiting[integer(card[start])] = name, card[start + 1 : start + 4]
    systems = {0: BASIC}
    while waiting:
        done = []
        for number, (name, fields) in waiting.items():
            if name[4] == "2":
                within = [integer(fields[0])] * 3
                points = [np.array([real(f) for f in fields[k : k + 3]]) for k in (1, 4, 7)]
            else:
                ends = [grids[integer(field)] for field in fields]
                within, points = [end.input for end in ends], [end.position for end in ends]
            if all(reference in systems for reference in within):
                basic = [systems[w].basic(point) for w, point in zip(within, points, strict=True)]
                systems[number] = CoordinateSystem(basic[0], _frame(number, *basic), _KINDS[name[5]])
                done.append(number)
        if not done:
            raise ValueError(f"coordinate system {min(waiting)} refers to one that is not there")
        for number in done:
            del waiting[number]
    return systems


def _frame(number: int, a: Array, b: Array, c: Array) -> Array:
    """Return the axes of a system (3 x 3, rows): z from a to b, x towards c."""
    z, across = b - a, c - a
    y = np.cross(z, across)
    if not np.linalg.norm(y) > 1e-12 * np.linalg.norm(z) * np.linalg.norm(across):
        raise ValueError(f"the points of coordinate system {number} lie on one line")
    x = np.cross(y, z)
    return np.array([v / np.linalg.norm(v) for v in (x, y, z)])


WHAT = "Nastran bulk data"

Card = list[str]


def read_cards(path: Path, kept: Set[str], reference: Reference = check_reference) -> dict[str, list[Card]]:
    """Return the cards of some names in a file, each as its fields, the name first, padded by blanks."""
    cards_by_name: dict[str, list[Card]] = {}
    current: Card | None = None
    for line in _lines(path, reference, 0, [0]):
        fields = _fields(line)
        name = fields[0].rstrip("*").rstrip().upper()
        if name.startswith("="):
            raise FileError(f"{path} repeats cards (=), which is not read", remedy="Write them out.")
        if name and not name.startswith(("+", "*")):
            current = [name] if name in kept else None
            if current is not None:
                cards_by_name.setdefault(name, []).append(current)
        if current is not None:
            current += fields[1:]
    for cards in cards_by_name.values():
        for card in cards:
            card.extend([""] * (13 - len(card)))
    return cards_by_name


def _lines(path: Path, reference: Reference, depth: int, size: list[int]) -> Iterator[str]:
    """Yield the lines of bulk data, included ones too, without comments and what is above ``BEGIN BULK``."""
    with open_included(path, depth, size) as stream:
        above = depth == 0 and any(re.match(r"\s*BEGIN\s+BULK", line, re.IGNORECASE) for line in stream)
        stream.seek(0)
        for raw in stream:
            line = raw.split("$")[0].rstrip()
            word = line[:9].strip().upper()
            if word.startswith("BEGIN"):
                above = False
            elif word.startswith("ENDDATA"):
                return
            elif line and not above:
                if word.startswith("INCLUDE"):
                    name = line.strip()[7:].strip().strip("'\"")
                    yield from _lines(reference(path, name), reference, depth + 1, size)
                else:
                    yield line


def _fields(line: str) -> list[str]:
    """Return the fields of a line: its name, then eight small ones or four large ones."""
    wide = "*" in line[:8]
    count = 4 if wide else 8
    if "," in line:
        fields = [field.strip() for field in line.split(",")][: count + 1]
    else:
        line, size = line.expandtabs(8), 16 if wide else 8
        fields = [line[:8].strip(), *(line[k : k + size].strip() for k in range(8, min(len(line), 72), size))]
    return fields + [""] * (count + 1 - len(fields))


def _listed_points(fields: Iterable[str]) -> list[int]:
    """Return the points of a list of fields behind a name, with ``THRU``."""
    words = [field.upper() for field in list(fields)[1:] if field and "." not in field]
    if "THRU" in words:
        first, last = integer(words[0]), integer(words[-1])
        if last - first > 10_000_000:
            raise ValueError(f"{first} THRU {last} are too many points")
        return list(range(first, last + 1))
    return [integer(field) for field in words]


def integer(field: str) -> int:
    """Return a whole number; a blank is 0."""
    return int(field) if field else 0


def _members(path: Path) -> dict[str, tuple[int, ...] | str]:
    """Return the shapes of the square real DMIG matrices of a file, and what others are, by name."""
    members: dict[str, tuple[int, ...] | str] = {}
    with read_errors(path, WHAT):
        heads, entries = _columns(read_cards(path, {"DMIG"}))
        for name in {**entries, **heads}:
            form, kind = _form(heads.get(name))
            if name not in entries:
                members[name] = "no entry"
            elif kind in _COMPLEX:
                members[name] = COMPLEX
            elif form not in _SQUARE:
                members[name] = f"a matrix of form {form}, not square (1) or symmetric (6)"
            elif not entries[name]:
                members[name] = "no entry"
            elif kind in _REAL:
                members[name] = _labelled(entries[name], symmetric=form == 6).matrix.shape
        return members


def _load(path: Path, name: str) -> ImportedMatrix:
    """Return one DMIG matrix of a file, with the labels of its DOFs."""
    with read_errors(path, WHAT):
        heads, entries = _columns(read_cards(path, {"DMIG"}))
        return _labelled(entries[name], symmetric=_form(heads.get(name))[0] == 6)


MATRICES = Container(_members, _load)
"""The reader of the DMIG matrices of a file."""

_REAL, _COMPLEX = (1, 2), (3, 4)
_SQUARE = (1, 6)


def _form(head: Card | None) -> tuple[int, int]:
    """Return form and type of a matrix, as its first card says."""
    return (1, 2) if head is None else (integer(head[3] or "1"), integer(head[4] or "1"))


def _columns(
    cards: Mapping[str, Sequence[Card]],
) -> tuple[dict[str, Card], dict[str, list[tuple[int, int, int, int, float]]]]:
    """Return the first cards of matrices (node 0: form and type), and their entries, by name."""
    heads: dict[str, Card] = {}
    entries: dict[str, list[tuple[int, int, int, int, float]]] = {}
    for card in cards.get("DMIG", ()):
        name, column = card[1].upper(), integer(card[2])
        if column == 0:
            heads[name] = card
            continue
        rows = entries.setdefault(name, [])
        at = (column, integer(card[3] or "0"))
        for k in range(5, len(card) - 2, 4):
            if card[k]:
                rows.append((*at, integer(card[k]), integer(card[k + 1] or "0"), real(card[k + 2])))
    return heads, entries


def _labelled(rows: Sequence[tuple[int, int, int, int, float]], *, symmetric: bool) -> ImportedMatrix:
    from scipy.sparse import coo_array  # heavy import, needed here only

    ends = np.array([row[:4] for row in rows])
    values = np.array([row[4] for row in rows])
    dofs, inverse = np.unique(np.concatenate([ends[:, 2:], ends[:, :2]]), axis=0, return_inverse=True)
    i, j = inverse.reshape(2, -1)
    n = len(dofs)
    if symmetric:  # one of two mirrored entries is there, or both
        lone = (i != j) & ~np.isin(j * n + i, i * n + j)
        i, j, values = (np.concatenate(pair) for pair in ((i, j[lone]), (j, i[lone]), (values, values[lone])))
    labels = tuple(component_labels(node, str(component))[0] for node, component in dofs.tolist())
    return ImportedMatrix(coo_array((values, (i, j)), shape=(n, n)).tocsc(), labels)
