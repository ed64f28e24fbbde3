"""Nodes in MATLAB files and HDF5: a matrix of positions, and the DOFs of mass and stiffness.

The positions are a variable, or the field of a structure: ``node,x,y,z`` in four columns, ``x,y,z`` in three,
or the seven columns of the Structural Dynamics Toolbox. DOFs are node and component in two columns, or
``node.component`` in one (12.03 is the third of node 12).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynid.errors import FileError
from dynid.structure.labels import DIRECTIONS
from dynid.structure.matrices import Array, as_array
from dynid.structure.nodes import Nodes
from dynid.structure.readers.node_file import DofOrder, NodeFile
from dynid.structure.readers.read import load_matrix, shapes_in

POSITIONS = ("node", "nodes", "xyz", "coord", "coords", "coordinates")
"""Names of the positions."""
_DOFS = ("dof", "dofs", "mdof")


def read_nodes(path: Path) -> NodeFile:
    """Return the nodes of a file, and the order of DOFs that it states.

    Raises
    ------
    FileError
        If it cannot be read, or has no nodes.
    """
    table = _variable(path, POSITIONS)
    if table is None or table.shape[1] not in (3, 4, 7) or not len(table):
        raise FileError(
            f"{path} has no nodes",
            remedy=f"These are a matrix {', '.join(POSITIONS)} of three, four or seven columns.",
        )
    numbers = list(range(1, len(table) + 1))
    if table.shape[1] > 3:
        numbers = _whole(path, table[:, 0])
    if table.shape[1] == 7 and table[:, 1:3].any():
        raise FileError(f"{path} has nodes in other than basic coordinates, which are not read")
    nodes = Nodes(tuple(numbers), table[:, -3:].copy())
    dofs = _variable(path, _DOFS)
    return NodeFile(nodes, () if dofs is None else (DofOrder("dof", _labels(path, dofs), stated=True),))


def _variable(path: Path, names: tuple[str, ...]) -> Array | None:
    """Return the first matrix of a file that has one of these names, in any case of letters."""
    found = next((name for name in shapes_in(path) if name.rpartition("/")[2].lower() in names), None)
    return None if found is None else as_array(load_matrix(path, found).matrix)


def _whole(path: Path, column: Array) -> list[int]:
    if not np.isfinite(column).all() or (column != np.round(column)).any():
        raise FileError(f"{path} has numbers of nodes that are not whole")
    return [int(number) for number in column]


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
