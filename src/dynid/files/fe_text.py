"""Text files of FE programs: numbers of Fortran, and files that include others."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TextIO, TypeAlias

from dynid.errors import FileError
from dynid.file_access import check_readable

#: Characters of a file and those that it includes, and how deep these are nested, at most.
_MAX_CHARACTERS, _MAX_DEPTH = 1_000_000_000, 10

Reference: TypeAlias = Callable[[Path, str], Path]
"""Function of a file and the name of another one in it, which returns the path of that, or refuses it."""


def open_included(path: Path, depth: int, size: list[int]) -> TextIO:
    """Return a file opened as one of those that include each other, `depth` of them above it.

    The characters of all add up in the one entry of `size`.
    """
    check_readable(path)
    size[0] += path.stat().st_size
    if depth > _MAX_DEPTH or size[0] > _MAX_CHARACTERS:
        raise FileError(f"{path}: too many files include each other, or they are too large")
    return path.open(encoding="utf-8-sig", errors="replace")


def real(word: str) -> float:
    """Return a number of Fortran or Nastran: ``1.5D-3`` and ``1.5-3`` are 0.0015, a blank is 0."""
    if not word:
        return 0.0
    return float(re.sub(r"(?<=[0-9.])([+-])", r"e\1", word.upper().replace("D", "E")))


def check_reference(path: Path, named: str, includes: Iterable[Path] | None = None) -> Path:
    """Return a file that another one refers to as `named`; the scene must name it among `includes`."""
    if includes is None:
        raise FileError(
            f"{path} refers to another file, '{named}', which is not followed",
            remedy="Write the lines of that file into this one.",
        )
    file = path.parent / named
    if file.resolve() not in {include.resolve() for include in includes}:
        raise FileError(
            f"{path} refers to another file, '{named}', which the scene does not name",
            remedy=f"Name it beside the mesh, from the folder of the scene: includes: [{named}].",
        )
    return file
