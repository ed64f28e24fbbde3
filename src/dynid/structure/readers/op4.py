"""Nastran OUTPUT4 files (`.op4`), through pyyeti."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dynid.errors import FileError
from dynid.structure.matrices import Matrix
from dynid.structure.readers.imported import as_numbers, check_claim, read_errors

_WHAT = "Nastran OUTPUT4"


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the matrices of a file, by name."""
    with read_errors(path, _WHAT):
        names, sizes, *_ = _reader(path).dir(str(path), verbose=False)
        return {name: tuple(size) for name, size in zip(names, sizes, strict=True)}


def load(path: Path, name: str) -> Matrix:
    """Return one matrix of a file, sparse where it is stored so."""
    with read_errors(path, _WHAT):
        check_claim(path, shapes(path)[name], path.stat().st_size)
        stored = _reader(path).load(str(path), [name], into="dct", justmatrix=True, sparse=True)[name]
        return as_numbers(path, name, stored)


def _reader(path: Path) -> Any:
    try:
        from pyyeti.nastran.op4 import OP4  # heavy import, of an optional package
    except ImportError:
        raise FileError(
            f"{path} is a Nastran file, which needs the package pyyeti",
            remedy="Install it: pip install 'dynid[formats]'.",
        ) from None
    return OP4()
