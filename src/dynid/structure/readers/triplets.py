"""Bare text triplets, as Abaqus exports matrices: `row column value`, or `node,dof,node,dof,value`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynid.errors import FileError
from dynid.structure.readers.imported import Imported, read_errors
from dynid.structure.readers.text import assembled, numbers, places

_COMMENTS = ("*", "#", "%")


def read(path: Path) -> Imported:
    """Read triplets, one a line; entries of one triangle only are mirrored, repeated ones are added.

    Lines that start with ``*``, ``#`` or ``%`` (whichever comes first) are comments. With three columns rows
    and columns count from 1; with five, DOFs are labelled ``<node>:<dof>``, in ascending order.

    Raises
    ------
    FileError
        If a line is no triplet.
    """
    with read_errors(path, "triplets"):
        with path.open(encoding="utf-8") as lines:
            comment = next((mark for line in lines if (mark := line.strip()[:1]) in _COMMENTS), "*")
        table = numbers(path, 0, comment)
        if not table.size:
            raise FileError(f"{path} holds no triplets")
        if table.shape[1] not in (3, 5):
            raise FileError(f"{path} has {table.shape[1]} columns; triplets have 3 (row, column, value) or 5")
        ends, values = places(path, table[:, :-1]), table[:, -1]
        labels: tuple[str, ...] = ()
        if table.shape[1] == 5:
            both = np.concatenate([ends[:, :2], ends[:, 2:]])
            dofs, inverse = np.unique(both, axis=0, return_inverse=True)
            ends = inverse.reshape(2, -1).T + 1
            labels = tuple(f"{node}:{dof}" for node, dof in dofs.tolist())
        # No more rows than bytes: an index that is wrong must not take memory.
        n = min(int(ends.max()), max(path.stat().st_size, 1000))
        one_triangle = bool(np.all(ends[:, 0] <= ends[:, 1]) or np.all(ends[:, 0] >= ends[:, 1]))
        matrix = assembled(path, ends, values, (max(n, 1), max(n, 1)), mirror=one_triangle)
    return Imported(matrix, labels, at_least=not labels)
