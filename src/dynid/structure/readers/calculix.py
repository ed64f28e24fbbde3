"""Matrices of CalculiX (`.sti`, `.mas`), as ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` writes them.

Lines ``row column value`` of one triangle, and beside them a file `.dof` with ``node.component`` of each row.
Source: G. Dhondt, "CalculiX CrunchiX User's Manual", 2.20.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from dynid.errors import FileError
from dynid.structure.labels import DIRECTIONS
from dynid.structure.readers.imported_matrix import ImportedMatrix, read_errors
from dynid.structure.readers.text import read_triplets


def read_calculix(path: Path) -> ImportedMatrix:
    """Return a matrix, with labels where the file `.dof` stands beside it.

    Raises
    ------
    FileError
        If a file is damaged, or they contradict each other.
    """
    matrix = read_triplets(path)
    order = path.with_suffix(".dof")
    if not order.is_file():
        return matrix
    labels = read_order(order)
    rows = matrix.matrix.shape[0]
    if rows != len(labels):
        truncated = ": it is truncated" if rows < len(labels) else ""
        raise FileError(f"{path} has {rows} rows, but {order} names {len(labels)} DOFs{truncated}")
    return replace(matrix, labels=labels, at_least=False)


def read_order(path: Path) -> tuple[str, ...]:
    """Return the labels of the DOFs in a file `.dof`."""
    with read_errors(path, "an order of DOFs of CalculiX"):
        if path.stat().st_size > 1_000_000_000:
            raise FileError(f"{path} is too large for an order of DOFs")
        words = path.read_text(encoding="utf-8").split()
        wrong = next((word for word in words if not re.fullmatch(r"\d+\.[1-6]", word)), None)
        if wrong is not None or not words:
            raise FileError(
                f"{path} names no DOFs: '{wrong}' is no node.component" if words else f"{path} is empty"
            )
        return tuple(f"{word[:-2]}:{DIRECTIONS[int(word[-1]) - 1]}" for word in words)
