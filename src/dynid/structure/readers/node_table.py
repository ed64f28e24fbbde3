"""Tables of nodes: `nodes.csv` with the columns ``node,x,y,z``, and ``set`` and ``dofs`` where wanted."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from dynid.errors import FileError
from dynid.structure.labels import DIRECTIONS, Node, node_direction
from dynid.structure.nodes import Nodes
from dynid.structure.readers.imported_matrix import read_errors
from dynid.structure.readers.node_file import DofOrder, NodeFile

# The largest table, bytes.
_LONGEST = 1_000_000_000


def read_nodes(path: Path) -> NodeFile:
    """Return the nodes of a table, and the order of DOFs that its column ``dofs`` states.

    The first row names the columns; what follows a # is a comment. ``set`` holds the names of node sets,
    separated by blanks, ``dofs`` the node's directions (``x y rz``; ``-`` for none).

    Raises
    ------
    FileError
        If it cannot be read, or a line is no node.
    """
    with read_errors(path, "a table of nodes"):
        if path.stat().st_size > _LONGEST:
            raise FileError(f"{path} is too large for a table of nodes")
        with path.open(encoding="utf-8-sig", newline="") as lines:
            rows = csv.reader(
                (line.split("#")[0] for line in lines), skipinitialspace=True, delimiter=_delimiter(path)
            )
            first = next((row for row in rows if any(word.strip() for word in row)), [])
            header = [word.strip().lower() for word in first]
            if not {"node", "x", "y", "z"} <= {*header} or len({*header}) < len(header):
                line = rows.line_num if first else 1
                raise FileError(
                    f"{path}:{line}: the columns are {', '.join(header) or 'missing'}",
                    remedy="The first row of a table of nodes is node,x,y,z (and set, dofs where wanted).",
                )
            numbers: list[Node] = []
            xyz: list[list[float]] = []
            sets: dict[str, list[Node]] = {}
            order: list[str] = []
            for row in rows:
                if not any(word.strip() for word in row):
                    continue
                if len(row) != len(header):
                    raise FileError(f"{path}:{rows.line_num}: {len(row)} entries below {len(header)} columns")
                entry = {name: word.strip() for name, word in zip(header, row, strict=True)}
                node: Node = int(entry["node"]) if entry["node"].isdecimal() else entry["node"]
                numbers.append(node)
                xyz.append([_number(path, rows.line_num, entry[axis]) for axis in "xyz"])
                for name in entry.get("set", "").split():
                    sets.setdefault(name, []).append(node)
                order += [
                    f"{node}:{along}" for along in _directions(path, rows.line_num, entry.get("dofs", "-"))
                ]
        if not numbers:
            raise FileError(f"{path} has no nodes below its columns' names")
        nodes = Nodes(
            tuple(numbers), np.array(xyz), {}, {name: tuple(members) for name, members in sets.items()}
        )
        orders = (DofOrder("dofs", tuple(order), stated=True),) if "dofs" in header else ()
        return NodeFile(nodes, orders)


def _delimiter(path: Path) -> str:
    """Return what separates the columns in the first line that is not blank."""
    with path.open(encoding="utf-8-sig") as lines:
        first = next((line for line in lines if line.split("#")[0].strip()), "")
    return next((mark for mark in ",;\t" if mark in first), ",")


def _number(path: Path, line: int, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise FileError(f"{path}:{line}: '{word}' is no coordinate")
    return value


def _directions(path: Path, line: int, words: str) -> list[str]:
    found = []
    for word in words.replace("-", " ").split():
        place = node_direction(f"1:{word}")
        if place is None or place[1] in found:
            raise FileError(
                f"{path}:{line}: '{words}' are no directions", remedy=f"Write some of {' '.join(DIRECTIONS)}."
            )
        found.append(place[1])
    return found
