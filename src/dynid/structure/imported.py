"""Structures out of matrices in users' files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.choices import DENSE_STRUCTURES
from dynid.errors import FileError, UsageError
from dynid.structure.damping import Modal, Proportional
from dynid.structure.joints import Joint
from dynid.structure.matrices import Label, Matrix, as_array, nothing, triplets
from dynid.structure.model import StructuralModel
from dynid.structure.readers.imported import Imported
from dynid.structure.readers.read import MatrixFile, read_matrix, read_state_space
from dynid.structure.recovery import recovered


def imported(
    mass: MatrixFile,
    stiffness: MatrixFile,
    damping: MatrixFile | Proportional | Modal | None = None,
    *,
    labels: Sequence[Label] = (),
    joints: Iterable[Joint] = (),
) -> StructuralModel:
    """Return the structure of matrices in files.

    Formats without a size (triplets) take that of the largest matrix, those with labels are brought into
    one order: DOFs that a matrix does not name have none of it.

    Parameters
    ----------
    mass, stiffness, damping
        The files; damping may be made from the other two instead.
    labels
        Labels of the DOFs; absent: those of the files, else 1 … n.
    joints
        The joints.

    Raises
    ------
    FileError
        If a file cannot be read; its `names` start with the matrix concerned (``mass``, ``stiffness``, …).
    UsageError
        If the matrices are not those of a structure.
    """
    files = {"mass": mass, "stiffness": stiffness}
    if isinstance(damping, MatrixFile):
        files["damping"] = damping
    parts = {role: _read(file, role) for role, file in files.items()}
    found, matrices = _aligned(parts)
    n = matrices["stiffness"].shape[0]
    given = tuple(labels) or found
    if len(given) not in (0, n):
        raise UsageError(f"there are {len(given)} DOF labels, but {n} DOFs", names=("labels",))
    dense = n <= DENSE_STRUCTURES.value or all(isinstance(matrix, np.ndarray) for matrix in matrices.values())
    sized = {role: as_array(matrix) if dense else matrix for role, matrix in matrices.items()}
    M, K = sized["mass"], sized["stiffness"]
    C = sized.get("damping", nothing(n, sparse=not dense))
    model = StructuralModel(M, C, K, tuple(joints), given)
    if isinstance(damping, Proportional | Modal):
        return replace(model, C=damping.matrix(model.M, model.K))
    return model


def from_state_space(
    path: Path,
    names: Mapping[str, str] | None = None,
    *,
    labels: Sequence[Label] = (),
    joints: Iterable[Joint] = (),
) -> StructuralModel:
    """Return the structure that a state space in a file describes; see `recovery.recovered`.

    Parameters
    ----------
    path
        The file, of a format that holds several matrices.
    names
        What it calls ``A``, ``B`` and ``C``; absent: that. B and C are used where they are there.
    labels, joints
        As of `imported`.

    Raises
    ------
    FileError
        If the file cannot be read.
    UsageError, NumericalError
        As `recovered`.
    """
    parts = {name: as_array(matrix) for name, matrix in read_state_space(path, names or {}).items()}
    M, C, K, _ = recovered(parts["A"], parts.get("B"), parts.get("C"))
    return StructuralModel(M, C, K, tuple(joints), tuple(labels))


def _read(file: MatrixFile, role: str) -> Imported:
    try:
        return read_matrix(file, role)
    except FileError as error:
        raise FileError(error.problem, remedy=error.remedy, names=(role, *error.names)) from None


def _aligned(parts: Mapping[str, Imported]) -> tuple[tuple[Label, ...], dict[str, Matrix]]:
    """Bring matrices into one order and size; return the labels, if the files have any."""
    order = list(dict.fromkeys(label for role in sorted(parts, reverse=True) for label in parts[role].labels))
    places = {label: place for place, label in enumerate(order)}
    n = max([len(order), *(part.matrix.shape[0] for part in parts.values())])
    matrices = {}
    for role, part in parts.items():
        moved = np.array([places[label] for label in part.labels], dtype=int)
        matrices[role] = _embedded(part, moved, n) if part.labels or part.at_least else part.matrix
    return tuple(order), matrices


def _embedded(part: Imported, moved: NDArray[np.int_], n: int) -> Matrix:
    """Return a matrix with its rows and columns at other places of a larger one."""
    from scipy.sparse import coo_array  # loaded already: the reader made a sparse matrix

    rows, columns, values = triplets(part.matrix)
    if len(moved):
        rows, columns = moved[rows], moved[columns]
    matrix: Matrix = coo_array((values, (rows, columns)), shape=(n, n)).tocsc()
    return matrix
