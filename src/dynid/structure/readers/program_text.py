"""Text files of FE programs: files that include others, and numbers of Fortran."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TextIO

from dynid.errors import FileError
from dynid.file_access import obstacle

# The most characters of a file and those that it includes, and how deep these are nested.
_MOST, _DEEPEST = 1_000_000_000, 10


def opened(path: Path, depth: int, size: list[int]) -> TextIO:
    """Return a file opened for reading, as one of those that include each other.

    Parameters
    ----------
    path
        The file.
    depth
        How many files are above it; 0 of the first.
    size
        The characters so far, one entry; those of this file are added.

    Raises
    ------
    FileError
        If it cannot be read, or the files are too many or too large.
    """
    blocked = obstacle(path)
    if blocked is not None:
        raise FileError(f"{path} {blocked[0]}", remedy=blocked[1])
    size[0] += path.stat().st_size
    if depth > _DEEPEST or size[0] > _MOST:
        raise FileError(f"{path}: too many files include each other, or they are too large")
    return path.open(encoding="utf-8-sig", errors="replace")


def real(word: str) -> float:
    """Return a number of Fortran or Nastran: ``1.5D-3`` and ``1.5-3`` are 0.0015, a blank is 0."""
    if not word:
        return 0.0
    return float(re.sub(r"(?<=[0-9.])([+-])", r"e\1", word.upper().replace("D", "E")))
