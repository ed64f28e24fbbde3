"""One matrix out of a file, the format chosen by its extension and header."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.errors import FileError
from dynid.file_access import check_readable, dataset_of
from dynid.files.formats import format_of, reader_of
from dynid.files.matrix_data import (
    COMPLEX,
    USE_REAL_PART,
    Container,
    ImportedMatrix,
    check_real_numbers,
)
from dynid.files.signatures import signature_of
from dynid.files.untrusted import check_size
from dynid.structure.labels import Label
from dynid.structure.matrices import Matrix, is_sparse
from dynid.suggestions import did_you_mean, shortened

USUAL = {
    "mass": ("M", "mass", "MAA", "MGG", "MXX", "MAAX", "MASS1"),
    "stiffness": ("K", "stiffness", "KAA", "KGG", "KXX", "KAAX", "STIF1"),
    "damping": ("C", "damping", "BAA", "BGG", "BXX", "BAAX", "DAMP1", "D"),
    "structural": ("structural", "K4AA", "K4GG", "K4XX", "K4", "H"),
    "A": ("A",),
    "B": ("B",),
    "C": ("C",),
}
"""Usual names of the matrices in files that hold several, in any case of letters."""


#: Bytes of a file of labels, at most.
_MAX_LABEL_BYTES = 100_000_000


@dataclass(frozen=True)
class MatrixFile:
    """A file, and the name of the matrix in it where it holds several."""

    path: Path
    name: str | None = None


def matrix_file(folder: Path, path: str, name: str | None = None) -> MatrixFile:
    """Return the file that a scene in a folder names; in HDF5 also as ``file.h5:/path``."""
    bare, inside = dataset_of(path)
    return MatrixFile(folder / bare, inside) if name is None else MatrixFile(folder / path, name)


def read_matrix(file: MatrixFile, role: str, *, loss: bool = False) -> ImportedMatrix:
    """Read the matrix of a file that plays a role, one of `USUAL`: it decides in a file of several.

    The file is Matrix Market or Abaqus triplets (`.mtx`, distinguished by banner or size line), CalculiX
    (`.sti`, `.mas`), Harwell-Boeing (`.rsa`, `.matrix`, …), a script of triplets (`.m`), full rows or Matrix
    Market (`.txt`, `.out`, `.mmf`), MATLAB (`.mat`), NumPy (`.npz`, `.npy`), HDF5 (`.h5`, `.hdf5`) or Nastran
    OUTPUT4, OUTPUT2 or DMIG (`.op4`, `.op2`, `.pch`). With `loss` it may be complex, as a stiffness with
    structural damping.
    """
    form = format_of(file.path, "matrix", "matrices")
    if form.matrix is not None:
        imported = form.matrix(file.path)
        if not loss:
            check_real_numbers(file.path, "", imported.matrix)
    else:
        container = container_of(file.path)
        shapes: dict[str, tuple[int, ...]] = container.shapes(file.path)
        if loss:
            others = container.others(file.path)
            shapes |= {name: () for name, what in others.items() if what == COMPLEX}
        name = _choose(file.path, file.name, role, shapes)
        imported = container.matrix(file.path, name, loss=loss)
    entries = imported.matrix.data if is_sparse(imported.matrix) else imported.matrix
    if not np.any(entries):
        without = f" Leave '{role}' out where there is none." if role in ("damping", "structural") else ""
        raise FileError(
            f"{file.path}: the {role} has no entry but 0",
            remedy=f"Export it again, and compare the size of the file with the model.{without}",
        )
    return imported


def container_of(path: Path) -> Container:
    """Return the reader of a file that holds several matrices."""
    container: Container = reader_of(path, "matrices")
    return container


def read_state_space(path: Path, names: Mapping[str, str]) -> dict[str, Matrix]:
    """Read ``A``, and ``B`` and ``C`` if there; `names` are theirs in the file, where these differ."""
    if format_of(path, "matrix", "matrices").matrix is not None:
        raise FileError(f"{path} holds one matrix; a state space takes several")
    container = container_of(path)
    shapes = container.shapes(path)
    there = {name.rpartition("/")[2].upper() for name in shapes}
    roles = ["A", *(role for role in ("B", "C") if role in names or role in there)]
    chosen = {role: _choose(path, names.get(role), role, shapes) for role in roles}
    return {role: container.matrix(path, name).matrix for role, name in chosen.items()}


def read_labels(path: Path) -> list[Label]:
    """Read the labels of DOFs from a text file, one a line."""
    check_readable(path)
    check_size(path, "a list of labels", _MAX_LABEL_BYTES)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        signature = signature_of(path)
        what = signature.what if signature else "no text in UTF-8"
        raise FileError(f"{path} is {what}", remedy="Labels are a text in UTF-8, one a line.") from None
    words = [line.strip() for line in lines if line.strip()]
    return [int(word) if word.isdecimal() else word for word in words]


def _choose(path: Path, name: str | None, role: str, shapes: Mapping[str, Sequence[int]]) -> str:
    """Return the name of the matrix that is meant."""
    if name is not None:
        return _named(path, name.strip("/"), shapes)
    first = named_as(shapes, role)
    check_real(path, role, first)
    if first and (len(first) == 1 or _rank(first[0], role) != _rank(first[1], role)):
        return first[0]
    only = next(iter(shapes), "")
    others = (USUAL[another] for another in ("mass", "stiffness") if another != role)
    named_as_another = len(role) > 1 and any(
        only.rpartition("/")[2].lower() in (name.lower() for name in names) for names in others
    )
    if len(shapes) == 1 and role not in ("B", "C") and not named_as_another:
        return only
    raise FileError(
        f"{path} does not say which matrix is the {role}{_known(shapes, container_of(path).others(path))}",
        remedy="Name it: {path: …, name: …}.",
    )


#: What to do with what is no matrix of real numbers.
_AS_REAL = {
    COMPLEX: USE_REAL_PART,
    "structure": "Name the field of one of its elements: NAME(1)/FIELD.",
    "empty": "Save it with its numbers, or leave 'damping' out where there is none.",
    "cell": "Save the matrix in one of its cells as a variable.",
}


def _named(path: Path, name: str, shapes: Mapping[str, Sequence[int]]) -> str:
    """Return a name as the file spells it; the case of letters decides only between several."""
    name = name if name in shapes else name.replace(").", ")/")  # as MATLAB writes the field of an element
    alike = [spelled for spelled in shapes if spelled.lower() == name.lower()]
    if name in shapes or len(alike) == 1:
        return name if name in shapes else alike[0]
    others = container_of(path).others(path)
    for spelled, what in others.items():
        # A field of what is no structure of matrices has no matrix, either.
        if name.lower() == spelled.lower() or name.lower().startswith(f"{spelled.lower()}/"):
            remedy = next((text for word, text in _AS_REAL.items() if word in what), "")
            raise FileError(f"{path}: '{spelled}' is no matrix: it holds {what}", remedy=remedy)
    hint = did_you_mean(name, alike or shapes) or _known(shapes, others)
    raise FileError(f"{path} has no matrix '{name}'{hint}")


def check_real(path: Path, role: str, real: Sequence[str], *, required: bool = True) -> None:
    """Refuse a file whose likeliest matrix of a role is complex, or no matrix.

    `real` are the real ones with a usual name. If the role is `required` and none is real, what is no matrix
    counts as well.
    """
    others = container_of(path).others(path)
    counts = required and not real
    usual = [name for name in named_as(others, role) if counts or others[name] == COMPLEX]
    if usual and (not real or _rank(usual[0], role) < _rank(real[0], role)):
        _named(path, usual[0], {})


def named_as(shapes: Iterable[str], role: str) -> list[str]:
    """Return the matrices that have a usual name of a role, the likeliest first."""
    usual = [word.lower() for word in USUAL[role]]
    named = (name for name in shapes if name.rpartition("/")[2].lower() in usual)
    return sorted(named, key=lambda name: _rank(name, role))


def _rank(name: str, role: str) -> tuple[int, int]:
    """Return the place of a name among the usual ones, and how deep in the file it stands."""
    usual = [word.lower() for word in USUAL[role]]
    return usual.index(name.rpartition("/")[2].lower()), name.count("/")


def _known(shapes: Mapping[str, Sequence[int]], others: Mapping[str, str]) -> str:
    listed = [f"{name} ({' x '.join(map(str, shape))})" for name, shape in shapes.items()]
    listed += [f"{name} ({what})" for name, what in others.items()]
    return f"; it has {shortened(listed) or 'none'}"
