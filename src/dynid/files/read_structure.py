"""Structures and their nodes from files: mass, damping and stiffness, a state space, or a whole model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.dependent import Real
from dynid.defaults import DENSE_STRUCTURES
from dynid.errors import FileError, UsageError
from dynid.file_access import check_readable
from dynid.files.formats import endings_of, reader_of
from dynid.files.matrix_data import ImportedMatrix
from dynid.files.node_tables import POSITIONS
from dynid.files.read_matrix import (
    MatrixFile,
    check_real,
    container_of,
    named_as,
    read_matrix,
    read_state_space,
)
from dynid.number_format import counted
from dynid.parameters import Parameter
from dynid.structure.assembly import damped_structure
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.dof_order import NodeFile, assigned
from dynid.structure.joints import Joint
from dynid.structure.labels import Label
from dynid.structure.matrices import (
    DependentMatrix,
    Matrix,
    as_array,
    as_matrix,
    nothing,
    triplets,
)
from dynid.structure.model import Rotor, StructuralModel
from dynid.structure.recovery import recovered


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
    structural: Sequence[MatrixPart] = (),
    gyroscopic: Sequence[MatrixPart] = (),
    circulatory: Sequence[MatrixPart] = (),
    speed: float = 0.0,
) -> StructuralModel:
    """Return the structure of matrices in files, each the sum of parts; damping may be made from the others.

    Formats without a size (triplets) take that of the largest matrix, those with labels are brought into one
    order: DOFs that a matrix does not name have none of it. Labels are by default those of the files, else 1
    … n; a file of nodes also gives labels ``NODE:DIR`` where no others are known. Factors and damping may
    depend on the parameters. The imaginary part of a complex stiffness is structural damping, unless
    `structural` has its parts. `gyroscopic`, which is multiplied by the `speed` of rotation (rad/s), and
    `circulatory` are skew-symmetric. The `names` of a `FileError` start with the matrix concerned (``mass``,
    ``stiffness``, …); `UsageError` if the matrices are not those of a structure.
    """
    roles = {"mass": mass, "damping": damping, "stiffness": stiffness, "structural": structural}
    roles |= {"gyroscopic": gyroscopic, "circulatory": circulatory}
    files: dict[Key, MatrixPart] = {}
    for role, source in roles.items():
        terms = [MatrixPart(source)] if isinstance(source, MatrixFile) else source
        files |= {
            (role, index): term for index, term in enumerate(terms if isinstance(terms, Sequence) else ())
        }
    parts = {}
    for key in sorted(files, key=lambda key: _ROLES.index(key[0])):
        try:
            part = read_matrix(files[key].file, key[0], loss=key[0] == "stiffness")
        except FileError as error:
            raise FileError(error.problem, remedy=error.remedy, names=(key[0], *error.names)) from None
        if np.iscomplexobj(part.matrix):
            if structural:
                raise FileError(
                    f"{files[key].file.path}: the stiffness is complex: it has structural damping already",
                    remedy="Leave 'structural' out, or name the real part of the stiffness.",
                    names=("structural",),
                )
            parts["structural", key[1]] = replace(part, matrix=part.matrix.imag)
            files["structural", key[1]] = files[key]
            part = replace(part, matrix=part.matrix.real)
        parts[key] = part
    labels_of_files, matrices = _aligned(parts)
    n = matrices["stiffness", 0].shape[0]
    names = tuple(labels) or labels_of_files
    if len(names) not in (0, n):
        raise UsageError(f"{counted(len(names), 'DOF label')} for {counted(n, 'DOF')}", names=("labels",))
    dense = n <= DENSE_STRUCTURES.value or all(isinstance(matrix, np.ndarray) for matrix in matrices.values())
    size = matrices["mass", 0].shape[0]
    M, K, C, H = (
        _sum(
            role,
            [(files[key].factor, summand) for key, summand in matrices.items() if key[0] == role],
            size,
            dense,
        )
        for role in _LETTERS
    )
    lossy = any(key[0] == "structural" for key in parts)
    known_nodes = None
    if nodes is not None:
        try:
            file = read_nodes(nodes)
        except FileError as error:
            raise FileError(error.problem, remedy=error.remedy, names=("nodes", *error.names)) from None
        names, known_nodes = assigned(M.reference, K.reference, names, file)
    law = damping if isinstance(damping, ProportionalDamping | ModalDamping) else None
    model = damped_structure(M, C, K, law, joints, names, parameters, known_nodes, H=H if lossy else None)
    if not (gyroscopic or circulatory):
        return model
    G, N = (_skew(role, files, matrices, n) for role in _ROLES[4:])
    return model.rotating(Rotor(G, N, speed))


_LETTERS = {"mass": "M", "stiffness": "K", "damping": "C", "structural": "H"}
_ROLES = (*_LETTERS, "gyroscopic", "circulatory")
# Relative difference from a skew-symmetric matrix that is rounding of a file.
_SKEW = 1e-9


def _skew(
    role: str, files: Mapping[Key, MatrixPart], matrices: Mapping[Key, Matrix], n: int
) -> NDArray[np.float64]:
    """Return the sum of the parts of a skew-symmetric matrix (n x n)."""
    total = np.zeros((n, n))
    for key, matrix in matrices.items():
        if key[0] == role:
            part = as_array(matrix)
            if part.shape != (n, n):
                raise UsageError(f"the {role} matrix is not {n} x {n}", names=(role,))
            total += float(files[key].factor) * part
    excess = np.abs(total + total.T)
    if not np.all(excess <= _SKEW * np.abs(total).max(initial=0.0)):  # also where it is no number
        i, j = np.unravel_index(int(np.argmax(np.nan_to_num(excess, nan=np.inf))), excess.shape)
        raise UsageError(
            f"the {role} matrix is not skew-symmetric: entry ({i + 1}, {j + 1}) is {total[i, j]:.6g}, "
            f"({j + 1}, {i + 1}) is {total[j, i]:.6g}",
            remedy="Its symmetric part belongs to the damping or the stiffness.",
            names=(role,),
        )
    return np.asarray((total - total.T) / 2)


def _sum(role: str, parts: Sequence[tuple[Real, Matrix]], n: int, dense: bool) -> DependentMatrix:
    """Return the sum of the parts of a matrix."""
    letter = _LETTERS[role]
    total = None
    for factor, matrix in parts:
        sized = as_matrix(letter, as_array(matrix) if dense else matrix, n, sparse=not dense)
        term = DependentMatrix(sized).times(factor)
        total = term if total is None else total + term
    return total or DependentMatrix(nothing(n, sparse=not dense))


def from_state_space(
    path: Path,
    names: Mapping[str, str] | None = None,
    *,
    labels: Sequence[Label] = (),
    joints: Iterable[Joint] = (),
) -> StructuralModel:
    """Return the structure that a state space in a file of several matrices describes; see `recovered`.

    `names` are those of ``A``, ``B`` and ``C`` in it, where they differ. B and C are used where they exist.
    """
    parts = {name: as_array(matrix) for name, matrix in read_state_space(path, names or {}).items()}
    M, C, K, _ = recovered(parts["A"], parts.get("B"), parts.get("C"))
    return StructuralModel(M, C, K, tuple(joints), tuple(labels))


Key: TypeAlias = tuple[str, int]


def _aligned(parts: Mapping[Key, ImportedMatrix]) -> tuple[tuple[Label, ...], dict[Key, Matrix]]:
    """Bring matrices into one order and size; return the labels, if the files have any."""
    roles = sorted(parts, key=lambda key: ["stiffness", "mass", *_ROLES[2:]].index(key[0]))
    order = list(dict.fromkeys(label for key in roles for label in parts[key].labels))
    places = {label: index for index, label in enumerate(order)}
    n = max([len(order), *(matrix_read.matrix.shape[0] for matrix_read in parts.values())])
    matrices: dict[Key, Matrix] = {}
    for key, matrix_read in parts.items():
        if not (matrix_read.labels or matrix_read.at_least):
            matrices[key] = matrix_read.matrix
            continue
        from scipy.sparse import coo_array  # loaded already: the reader made a sparse matrix

        moved = np.array([places[label] for label in matrix_read.labels], dtype=int)
        rows, columns, values = triplets(matrix_read.matrix)
        if len(moved):
            rows, columns = moved[rows], moved[columns]
        matrices[key] = coo_array((values, (rows, columns)), shape=(n, n)).tocsc()
    return tuple(order), matrices


def read_nodes(path: Path) -> NodeFile:
    """Return the nodes of a file.

    It is Nastran bulk data (`.bdf`, `.dat`, `.nas`, `.pch`, `.asm`) or OUTPUT2 (`.op2`), Exodus (`.exo`,
    `.e`, `.g`), Abaqus or CalculiX (`.inp`), MATLAB or HDF5, or a table (`.csv`).
    """
    reader = reader_of(path, "nodes")
    try:
        nodes: NodeFile = reader(path)
    except UsageError as error:  # of the nodes themselves: two have one number
        raise FileError(f"{path}: {error.problem}", remedy=error.remedy) from None
    return nodes


#: Files of nodes that may stand beside OUTPUT4.
_BESIDE = (".pch", ".asm", ".bdf", ".dat", ".nas", ".op2", ".csv")

#: Endings of stiffness and mass beside an input file: of CalculiX, of Abaqus.
_PAIRS = ((".sti", ".mas"), ("_STIF1.mtx", "_MASS1.mtx"), ("STIF1.mtx", "MASS1.mtx"))


class _ModelFiles(NamedTuple):
    """The files of a model."""

    mass: MatrixFile
    stiffness: MatrixFile
    damping: MatrixFile | None
    nodes: Path | None
    structural: tuple[MatrixFile, ...] = ()


def model_files(path: Path) -> _ModelFiles:
    """Return the files of a model.

    That is a file of several matrices, which also holds the nodes (OUTPUT2, bulk data with DMIG, MATLAB,
    HDF5) or has them beside it in a file of the same name (OUTPUT4); or an input file of CalculiX or Abaqus
    (`.inp`), which has the matrices beside it.
    """
    if path.suffix.lower() == ".inp":
        check_readable(path)
        for stiffness, mass in _PAIRS:
            pair = [path.with_name(path.stem + ending) for ending in (mass, stiffness)]
            if all(file.is_file() for file in pair):
                return _ModelFiles(MatrixFile(pair[0]), MatrixFile(pair[1]), None, path)
        raise FileError(
            f"{path} has no matrices beside it",
            remedy=f"Looked for {', '.join(path.stem + ending for ending, _ in _PAIRS)}.",
        )
    endings = endings_of("matrices")
    if path.suffix.lower() not in endings:
        raise FileError(
            f"{path} is no file of a whole model",
            remedy=f"Those end in .inp, {', '.join(endings)}; else name mass, stiffness and nodes.",
        )
    shapes = container_of(path).shapes(path)
    sizes = [shapes[name] for role in ("stiffness", "mass") for name in named_as(shapes, role)]
    check_real(path, "damping", named_as(shapes, "damping"), required=False)

    def sized(role: str) -> list[MatrixFile]:
        """Return the likeliest matrix of a role that has the size of the model, if there is one."""
        names = (name for name in named_as(shapes, role) if sizes and shapes[name] == sizes[0])
        return [MatrixFile(path, name) for name in names if name.rpartition("/")[2] != "H"][:1]

    matrices = MatrixFile(path)
    nodes = _nodes_beside(path, [*shapes])
    damping, structural = next(iter(sized("damping")), None), tuple(sized("structural"))
    return _ModelFiles(matrices, matrices, damping, nodes, structural)


def _nodes_beside(path: Path, names: list[str]) -> Path | None:
    kind = path.suffix.lower()
    if kind == ".op4":
        return next((file for end in _BESIDE if (file := path.with_suffix(end)).is_file()), None)
    if kind in (".mat", ".h5", ".hdf5"):
        there = any(name.rpartition("/")[2].lower() in POSITIONS for name in names)
        table = path.with_suffix(".csv")
        return path if there else table if table.is_file() else None
    return path
