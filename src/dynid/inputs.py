"""Files that users name, before anything reads them."""

from __future__ import annotations

import os
from pathlib import Path


def obstacle(path: Path) -> tuple[str, str] | None:
    """Return why a file cannot be read, and what to do about it; None where nothing is seen to hinder.

    Nothing is opened: a name may be that of a pipe, which would wait.
    """
    if not os.path.isfile(path):  # noqa: PTH113 (False, too, for a name that no file can have)
        return "is no file", "Paths in a scene are relative to the scene's folder."
    if not os.access(path, os.R_OK):
        return "cannot be read: Permission denied", ""
    return None


def dataset_of(path: str) -> tuple[str, str | None]:
    """Split the name of a matrix: in HDF5 the file and what stands in it, of ``file.h5:/path``."""
    bare, colon, inside = path.partition(":/")
    return (bare, inside) if colon and bare.lower().endswith((".h5", ".hdf5")) else (path, None)
