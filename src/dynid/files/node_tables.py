"""Nodes, and whole models, from files whose format is chosen by their extension.

Here: tables of nodes (`nodes.csv`) with the columns ``node,x,y,z``, and ``set`` and ``dofs`` where wanted;
nodes in MATLAB files and HDF5: a matrix of positions, and the DOFs of mass and stiffness. The positions are a
variable, or the field of a structure: ``node,x,y,z`` in four columns, ``x,y,z`` in three, or the seven
columns of the Structural Dynamics Toolbox. DOFs are node and component in two columns, or ``node.component``
in one (12.03 is the third of node 12).
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from dynid.arrays import Array
from dynid.errors import FileError
from dynid.files.matrix_data import Container
from dynid.files.untrusted import check_size, read_errors
from dynid.structure.dof_order import DofOrder, NodeFile
from dynid.structure.labels import DIRECTIONS, Node, Nodes, node_direction
from dynid.structure.matrices import as_array

#: Bytes of a table, at most.
_MAX_BYTES = 1_000_000_000


def read_table(path: Path) -> NodeFile:
    """Return the nodes of a table, and the order of DOFs that its column ``dofs`` states.

    The first row names the columns; what follows a # is a comment. ``set`` holds the names of node sets,
    separated by blanks, ``dofs`` the node's directions (``x y rz``; ``-`` for none).
    """
    with read_errors(path, "a table of nodes"):
        check_size(path, "a table of nodes", _MAX_BYTES)
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
    directions = []
    for word in words.replace("-", " ").split():
        node = node_direction(f"1:{word}")
        if node is None or node[1] in directions:
            raise FileError(
                f"{path}:{line}: '{words}' are no directions", remedy=f"Write some of {' '.join(DIRECTIONS)}."
            )
        directions.append(node[1])
    return directions


POSITIONS = ("node", "nodes", "xyz", "coord", "coords", "coordinates")
"""Names of the positions."""
_DOFS = ("dof", "dofs", "mdof")


def read_from(container: Container) -> Callable[[Path], NodeFile]:
    """Return the reader of the nodes, and of the order of DOFs, among the matrices of files of a format."""
    return partial(_read_matrices, container)


def _read_matrices(container: Container, path: Path) -> NodeFile:
    table = _variable(container, path, POSITIONS)
    if table is None or table.shape[1] not in (3, 4, 7) or not len(table):
        raise FileError(
            f"{path} has no nodes",
            remedy=f"These are a matrix {', '.join(POSITIONS)} of three, four or seven columns.",
        )
    numbers = list(range(1, len(table) + 1))
    if table.shape[1] > 3:
        if not np.isfinite(table[:, 0]).all() or (table[:, 0] != np.round(table[:, 0])).any():
            raise FileError(f"{path} has numbers of nodes that are not whole")
        numbers = [int(number) for number in table[:, 0]]
    if table.shape[1] == 7 and table[:, 1:3].any():
        raise FileError(f"{path} has nodes in other than basic coordinates, which are not read")
    nodes = Nodes(tuple(numbers), table[:, -3:].copy())
    dofs = _variable(container, path, _DOFS)
    return NodeFile(nodes, () if dofs is None else (DofOrder("dof", _labels(path, dofs), stated=True),))


def _variable(container: Container, path: Path, names: tuple[str, ...]) -> Array | None:
    """Return the first matrix of a file that has one of these names, in any case of letters."""
    name = next((name for name in container.shapes(path) if name.rpartition("/")[2].lower() in names), None)
    return None if name is None else as_array(container.matrix(path, name).matrix)


def _labels(path: Path, dofs: Array) -> tuple[str, ...]:
    if dofs.shape[1] == 1 or len(dofs) == 1:
        column = dofs.ravel()
        nodes, components = np.floor(column + 0.005), np.round((column - np.floor(column + 0.005)) * 100)
    elif dofs.shape[1] == 2:
        nodes, components = dofs.T
    else:
        raise FileError(f"{path} has DOFs in {dofs.shape[1]} columns, not one or two")
    if not (np.isin(components, range(1, 7)).all() and np.isfinite(nodes).all()):
        raise FileError(f"{path} has DOFs that are no node and component 1 to 6")
    return tuple(
        f"{int(node)}:{DIRECTIONS[int(component) - 1]}"
        for node, component in zip(nodes, components, strict=True)
    )
