"""Structures imported from files: mass, damping and stiffness, or a state space.

Of a state space ``[0 I; -M^-1 K, -M^-1 C]`` the system matrix alone gives the modes, not their masses: with
left eigenvectors Psi of ``M^-1 K``, every ``M = Psi^T D Psi`` with a positive diagonal D is symmetric with
``K = M (M^-1 K)``. A collocated input and output (``M b = c``: a unit force and the motion that it moves)
give them, as residues of that channel.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.defaults import DENSE_STRUCTURES
from dynid.errors import FileError, NumericalError, UsageError
from dynid.lti.floating import guarded
from dynid.number_format import counted
from dynid.parameters import Parameter
from dynid.structure.assembly import damped_structure
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.labels import Nodes
from dynid.structure.matrices import (
    NAMES,
    Array,
    DependentMatrix,
    Label,
    Matrix,
    as_array,
    as_matrix,
    nothing,
    triplets,
)
from dynid.structure.model import StructuralModel
from dynid.structure.readers.imported_matrix import ImportedMatrix
from dynid.structure.readers.node_file import assigned
from dynid.structure.readers.read import MatrixFile, read_matrix, read_state_space
from dynid.structure.readers.read_nodes import read_nodes

# The relative contradiction that rounded numbers of a state space may contain.
_ROUNDED = 1e-6
_WORST_BASIS = 1e8
# A mode that takes part in a channel by less does not show its mass in it.
_PART = 1e-6


class MatrixPart(NamedTuple):
    """A matrix in a file, and the number that it is multiplied by."""

    file: MatrixFile
    factor: Real = 1.0


def imported(
    mass: MatrixFile | Sequence[MatrixPart],
    stiffness: MatrixFile | Sequence[MatrixPart],
    damping: MatrixFile | Sequence[MatrixPart] | ProportionalDamping | ModalDamping | None = None,
    *,
    labels: Sequence[Label] = (),
    joints: Iterable[Joint] = (),
    parameters: Iterable[Parameter] = (),
    nodes: Path | None = None,
) -> StructuralModel:
    """Return the structure of matrices in files.

    Formats without a size (triplets) take that of the largest matrix, those with labels are brought into
    one order: DOFs that a matrix does not name have none of it.

    Parameters
    ----------
    mass, stiffness, damping
        The files, or the parts that each matrix is the sum of; damping may be made from the other two
        instead.
    labels
        Labels of the DOFs; absent: those of the files, else 1 … n.
    joints
        The joints.
    parameters
        Unknown parameters, on which factors and damping may depend.
    nodes
        A file of nodes, which also gives labels ``NODE:DIR`` where no others are known.

    Raises
    ------
    FileError
        If a file cannot be read; its `names` start with the matrix concerned (``mass``, ``stiffness``, …).
    UsageError
        If the matrices are not those of a structure.
    """
    given = {"mass": mass, "damping": damping, "stiffness": stiffness}
    files = {(role, place): part for role, parts in given.items() for place, part in enumerate(_parts(parts))}
    parts = {}
    for key in sorted(files, key=lambda key: ["mass", "stiffness", "damping"].index(key[0])):
        try:
            parts[key] = read_matrix(files[key].file, key[0])
        except FileError as error:
            raise FileError(error.problem, remedy=error.remedy, names=(key[0], *error.names)) from None
    found, matrices = _aligned(parts)
    n = matrices["stiffness", 0].shape[0]
    names = tuple(labels) or found
    if len(names) not in (0, n):
        raise UsageError(f"{counted(len(names), 'DOF label')} for {counted(n, 'DOF')}", names=("labels",))
    dense = n <= DENSE_STRUCTURES.value or all(isinstance(matrix, np.ndarray) for matrix in matrices.values())
    size = matrices["mass", 0].shape[0]
    M, K, C = (
        _sum(role, [(files[key].factor, one) for key, one in matrices.items() if key[0] == role], size, dense)
        for role in ("mass", "stiffness", "damping")
    )
    known = None
    if nodes is not None:
        names, known = _with_nodes(nodes, M.reference, K.reference, names)
    law = damping if isinstance(damping, ProportionalDamping | ModalDamping) else None
    return damped_structure(M, C, K, law, joints, names, parameters, known)


def _with_nodes(
    path: Path, M: Matrix, K: Matrix, labels: tuple[Label, ...]
) -> tuple[tuple[Label, ...], Nodes]:
    """Return labels of DOFs and the nodes of a file."""
    try:
        file = read_nodes(path)
    except FileError as error:
        raise FileError(error.problem, remedy=error.remedy, names=("nodes", *error.names)) from None
    return assigned(M, K, labels, file)


def _parts(
    given: MatrixFile | Sequence[MatrixPart] | ProportionalDamping | ModalDamping | None,
) -> Sequence[MatrixPart]:
    if isinstance(given, MatrixFile):
        return [MatrixPart(given)]
    return given if isinstance(given, Sequence) else []


def _sum(role: str, parts: Sequence[tuple[Real, Matrix]], n: int, dense: bool) -> DependentMatrix:
    """Return the sum of the parts of a matrix."""
    letter = {name: letter for letter, name in NAMES.items()}[role]
    total = None
    for factor, matrix in parts:
        sized = as_matrix(letter, as_array(matrix) if dense else matrix, n, sparse=not dense)
        part = DependentMatrix(sized).times(factor)
        total = part if total is None else total + part
    return total or DependentMatrix(nothing(n, sparse=not dense))


def from_state_space(
    path: Path,
    names: Mapping[str, str] | None = None,
    *,
    labels: Sequence[Label] = (),
    joints: Iterable[Joint] = (),
) -> StructuralModel:
    """Return the structure that a state space in a file describes; see `recovered`.

    Parameters
    ----------
    path
        The file, of a format that holds several matrices.
    names
        Names of ``A``, ``B`` and ``C`` in it, where they differ. B and C are used where they exist.
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


Key: TypeAlias = tuple[str, int]


def _aligned(parts: Mapping[Key, ImportedMatrix]) -> tuple[tuple[Label, ...], dict[Key, Matrix]]:
    """Bring matrices into one order and size; return the labels, if the files have any."""
    roles = sorted(parts, key=lambda key: ["stiffness", "mass", "damping"].index(key[0]))
    order = list(dict.fromkeys(label for key in roles for label in parts[key].labels))
    places = {label: place for place, label in enumerate(order)}
    n = max([len(order), *(part.matrix.shape[0] for part in parts.values())])
    matrices: dict[Key, Matrix] = {}
    for key, part in parts.items():
        if not (part.labels or part.at_least):
            matrices[key] = part.matrix
            continue
        from scipy.sparse import coo_array  # loaded already: the reader made a sparse matrix

        moved = np.array([places[label] for label in part.labels], dtype=int)
        rows, columns, values = triplets(part.matrix)
        if len(moved):
            rows, columns = moved[rows], moved[columns]
        matrices[key] = coo_array((values, (rows, columns)), shape=(n, n)).tocsc()
    return tuple(order), matrices


class RecoveredMatrices(NamedTuple):
    """Matrices (n x n) of a state space; `scaled`: a collocated input and output give the modal masses."""

    M: Array
    C: Array
    K: Array
    scaled: bool


@guarded("the recovery of mass and stiffness")
def recovered(A: Array, B: Array | None = None, C: Array | None = None) -> RecoveredMatrices:
    """Recover the matrices of a structure from its state space, states [x, x'].

    Parameters
    ----------
    A
        System matrix (2n x 2n).
    B, C
        Inputs (2n x p) and outputs (q x 2n), if known. The first pair at one place tells the modal masses;
        without one they are those closest to a unit mass matrix.

    Raises
    ------
    UsageError
        If the state space is not that of a structure with symmetric matrices.
    NumericalError
        If the modes are nearly linearly dependent.
    """
    n = _half(A)
    X, Y = -A[n:, :n], -A[n:, n:]
    square, right = np.linalg.eig(X)
    size = float(np.abs(square).max(initial=0.0))
    if np.abs(square.imag).max() > _ROUNDED * size or square.real.min() < -_ROUNDED * size:
        worst = square[int(np.argmax(np.abs(square.imag) + np.maximum(-square.real, 0)))]
        raise UsageError(
            f"the state space is no passive structure: M^-1 K has the eigenvalue {worst:.4g}",
            remedy="The squares of natural frequencies are real and not negative.",
            names=("state_space",),
        )
    if np.abs(X - X.T).max() <= 1e-12 * max(float(np.abs(X).max()), np.finfo(float).tiny):
        right = np.linalg.eigh((X + X.T) / 2)[1]
    condition = float(np.linalg.cond(right))
    if condition > _WORST_BASIS:
        raise NumericalError(
            f"the modes of the state space are nearly dependent (condition {condition:.2g})",
            remedy="A structure with symmetric matrices has independent ones; check the file.",
            names=("state_space",),
        )
    left = np.linalg.inv(right).real
    coupling = left @ Y @ right.real
    masses = _port_masses(n, left, right.real, B, C)
    scaled = masses is not None
    if masses is None:
        masses = _nearest_masses(left, coupling)
    M = left.T @ (masses[:, None] * left)
    return RecoveredMatrices(_even("mass", M), _even("damping", M @ Y), _even("stiffness", M @ X), scaled)


def _half(A: Array) -> int:
    rows, columns = A.shape
    if rows != columns or rows % 2 or not rows:
        raise UsageError(
            f"the system matrix is {rows} x {columns}; that of a structure is square and even",
            names=("state_space",),
        )
    if not np.isfinite(A).all():
        raise UsageError("the system matrix has entries that are no numbers", names=("state_space",))
    n: int = rows // 2
    wrong = np.argwhere(A[:n] != np.eye(n, 2 * n, k=n))
    if len(wrong):
        i, j = wrong[0]
        raise UsageError(
            f"the upper half of the system matrix is not [0 I]: entry ({i + 1}, {j + 1}) is {A[i, j]:.6g}",
            remedy="The states must be all displacements, then all velocities.",
            names=("state_space",),
        )
    return n


def _port_masses(n: int, left: Array, right: Array, B: Array | None, C: Array | None) -> Array | None:
    """Return the modal masses (n) from the first collocated input and output."""
    if B is None or C is None or B.shape[0] != 2 * n or C.shape[1] != 2 * n:
        return None
    for b in B[n:].T[np.abs(B[:n]).max(axis=0, initial=0.0) == 0]:
        for row in C:
            # The output reads displacements or velocities, not both.
            if np.any(row[:n]) == np.any(row[n:]):
                continue
            driven, seen = left @ b, right.T @ (row[:n] + row[n:])
            if np.abs(driven).min() <= _PART * np.abs(driven).max():
                continue
            masses = seen / driven
            if masses.min() > _PART * masses.max():
                return np.asarray(masses)
    return None


def _nearest_masses(left: Array, coupling: Array) -> Array:
    """Return the modal masses (n) that make damping symmetric and the mass matrix closest to unity."""
    gram = left @ left.T
    size = max(float(np.abs(coupling).max()), np.finfo(float).tiny)
    Z = coupling / size
    np.fill_diagonal(Z, 0.0)
    # D_i Z_ij = D_j Z_ji makes C symmetric: the null space of their squares' sum, rounding of Z left out.
    Z[np.abs(Z) < _ROUNDED] = 0.0
    symmetry = np.diag((Z**2).sum(axis=1)) - Z * Z.T
    values, vectors = np.linalg.eigh(symmetry)
    free = vectors[:, values <= _ROUNDED**2 + _ROUNDED * values[-1]]
    masses = free @ np.linalg.lstsq(free.T @ gram**2 @ free, free.T @ np.diag(gram), rcond=None)[0]
    if masses.min() <= 0:
        raise UsageError(
            "the state space is no passive structure: no positive modal masses make its damping symmetric",
            names=("state_space",),
        )
    return np.asarray(masses)


def _even(name: str, matrix: Array) -> Array:
    gap = np.abs(matrix - matrix.T)
    if gap.max() > _ROUNDED * max(float(np.abs(matrix).max()), np.finfo(float).tiny):
        i, j = np.unravel_index(int(np.argmax(gap)), gap.shape)
        raise UsageError(
            f"the {name} that the state space gives is not symmetric: entry ({i + 1}, {j + 1}) is "
            f"{matrix[i, j]:.6g}, ({j + 1}, {i + 1}) is {matrix[j, i]:.6g}",
            names=("state_space",),
        )
    return (matrix + matrix.T) / 2
