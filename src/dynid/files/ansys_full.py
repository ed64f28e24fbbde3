"""Ansys `.full` files: mass and stiffness of the free DOFs, with their labels.

The reader ansys-mapdl-reader returns upper triangles, in which constrained DOFs have rows of zeros. It runs
in a separate process, which completes the triangles and leaves these rows out.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dynid.files.matrix_data import ImportedMatrix, compressed
from dynid.files.recorder_files import converted, problems_in
from dynid.files.table import DataFile
from dynid.structure.labels import DIRECTIONS

_PACKAGE = "ansys.mapdl.reader"


def members(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the matrices of a file, by name."""
    with np.load(_archive_of(path), allow_pickle=False) as stored:
        size = len(stored["labels"])
        return {name: (size, size) for name in ("K", "M") if f"{name}0" in stored}


def load(path: Path, name: str) -> ImportedMatrix:
    """Return one matrix of a file, with labels ``NODE:DIR``."""
    with np.load(_archive_of(path), allow_pickle=False) as stored:
        labels = tuple(str(label) for label in stored["labels"])
        data, indices, pointers = (stored[f"{name}{part}"] for part in range(3))
    shape = (len(labels), len(labels))
    return ImportedMatrix(compressed(path, shape, (data, indices, pointers), "csc"), labels)


def _archive_of(path: Path) -> Path:
    return converted(DataFile(path), "an Ansys .full file", _PACKAGE, archive, extra="ansys")


def archive(path: str, target: str) -> None:
    """Write the matrices of a file, or why there are none, into a NumPy archive."""
    with problems_in(target):
        full: Any = import_module(_PACKAGE).read_binary(path)
        if not hasattr(full, "load_km"):
            raise ValueError(
                f"it holds results or element matrices ({type(full).__name__}), no assembled ones"
            )
        dofs, stiffness, mass = full.load_km(as_sparse=True, sort=True)
        count = stiffness.shape[0]
        if np.shape(dofs) != (count, 2) or len(np.unique(dofs, axis=0)) != count:
            raise ValueError(f"its {count} equations have {len(dofs)} DOFs, or one of these twice")
        if np.min(dofs[:, 1]) < 0 or np.max(dofs[:, 1]) >= len(DIRECTIONS):
            raise ValueError("it has DOFs other than displacements and rotations, such as temperatures")
        matrices = {"K": _symmetric(stiffness), "M": _symmetric(mass)}
        constrained = {(int(node), int(dof)) for node, dof in np.reshape(full.const, (-1, 2))}
        stored_rows = np.diff(matrices["K"].indptr) > 0
        kept = np.array(
            [row or (*pair,) not in constrained for row, pair in zip(stored_rows, dofs.tolist(), strict=True)]
        )
        arrays: dict[str, Any] = {}
        for name, matrix in matrices.items():
            part = matrix[kept][:, kept].tocsc()
            if part.nnz:
                arrays |= {f"{name}{k}": a for k, a in enumerate((part.data, part.indices, part.indptr))}
        labels = [f"{node}:{DIRECTIONS[dof]}" for node, dof in dofs[kept].tolist()]
        np.savez(target, labels=np.array(labels), **arrays)


def _symmetric(matrix: Any) -> Any:
    """Return a matrix whose other triangle is that of its transpose, if only one is stored."""
    from scipy.sparse import csc_array, tril, triu

    full = csc_array(matrix)
    full.eliminate_zeros()
    upper, lower = triu(full, 1), tril(full, -1)
    if upper.nnz and lower.nnz:
        return full  # both are stored: of an unsymmetric matrix they differ
    return csc_array(full + (upper + lower).T)
