"""MATLAB files up to version 7.2 (`.mat`); version 7.3 is HDF5."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

from dynid.structure.matrices import Matrix
from dynid.structure.readers.imported import as_numbers, check_claim, read_errors

_WHAT = "a MATLAB file"


def shapes(path: Path) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the numeric variables of a file, by name."""
    from scipy.io import whosmat  # heavy import, needed here only

    numeric = {
        "double",
        "single",
        "sparse",
        "logical",
        *(f"{u}int{b}" for u in ("", "u") for b in (8, 16, 32, 64)),
    }
    with read_errors(path, _WHAT), _quiet():
        return {name: tuple(shape) for name, shape, kind in whosmat(str(path)) if kind in numeric}


def load(path: Path, name: str) -> Matrix:
    """Return one variable of a file; no objects, functions or structures are read."""
    from scipy.io import loadmat, whosmat

    with read_errors(path, _WHAT), _quiet():
        for variable, shape, kind in whosmat(str(path)):
            if variable == name:
                check_claim(path, tuple(shape), path.stat().st_size if kind == "sparse" else None)
        stored: dict[str, Any] = loadmat(str(path), variable_names=[name], spmatrix=False)
        return as_numbers(path, name, stored[name])


def _quiet() -> warnings.catch_warnings[None]:
    return warnings.catch_warnings(action="ignore")
