"""Matrices in Harwell–Boeing and Rutherford–Boeing files, as ``HBMAT`` of Ansys writes them, too.

Assembled real matrices, by columns, in Fortran's formats; of symmetric ones one triangle. Ansys writes the
node and the direction of each row into a file `.mapping` beside it.
Source: I. S. Duff, R. G. Grimes, J. G. Lewis, "Users' Guide for the Harwell-Boeing Sparse Matrix
Collection", 1992.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import FileError
from dynid.structure.readers.imported_matrix import (
    ImportedMatrix,
    check_backed,
    check_claim,
    compressed,
    read_errors,
)
from dynid.structure.readers.program_text import real

_WHAT = "a Harwell-Boeing file"
_FORMAT = re.compile(
    r"\(\s*(?:\d+P\s*,?\s*)?(?P<count>\d*)(?P<kind>[IEDFG])(?P<width>\d+)(?:\.\d+)?(?:E\d+)?\s*\)",
    re.IGNORECASE,
)


def read_harwell_boeing(path: Path) -> ImportedMatrix:
    """Return the matrix of a file, both triangles, with the labels of a file `.mapping` beside it.

    Raises
    ------
    FileError
        If it is damaged, or holds no real assembled matrix.
    """
    with read_errors(path, _WHAT):
        with path.open(encoding="latin-1") as stream:
            lines = (line.rstrip("\r\n") for line in stream)
            head = list(islice(lines, 4))
            if len(head) < 4 or any(len(line) > 400 for line in head):
                raise ValueError("its header has four lines")
            cards = [int(word) for word in head[1].split()]
            kind = head[2][:3].upper()
            sizes = [int(word) for word in head[2][3:].split()]
            rows, columns, entries = sizes[:3]
            if not re.fullmatch(r"[RI][SU]A", kind):
                raise FileError(
                    f"{path} holds a matrix of type {kind}; what is read is RSA or RUA: real, assembled"
                )
            if min(rows, columns, entries) < 0 or len(cards) < 4:
                raise ValueError("its sizes are no whole numbers from 0")
            check_claim(path, (rows, columns), entries)
            check_backed(path, max(rows, columns), entries, 2)
            if len(cards) > 4 and cards[4] > 0:
                next(lines)  # the formats of right-hand sides
            formats = [_FORMAT.fullmatch(word.strip()) for word in _formats(head[3])]
            starts = _numbers(lines, formats[0], columns + 1, int)
            indices = _numbers(lines, formats[1], entries, int)
            values = _numbers(lines, formats[2], entries, float)
        matrix = compressed(path, (rows, columns), (values, indices - 1, starts - 1), "csc")
        if kind[1] == "S":
            from scipy.sparse import csc_array, diags_array  # loaded already: the matrix is sparse

            if rows != columns:
                raise ValueError(f"a symmetric matrix is square, not {rows} x {columns}")
            matrix = csc_array(matrix + matrix.T - diags_array(matrix.diagonal()))
    mapping = path.with_suffix(".mapping")
    labels: tuple[str, ...] = _mapping(mapping, rows) if mapping.is_file() else ()
    return ImportedMatrix(matrix, labels)


def _formats(line: str) -> list[str]:
    """Return the formats of pointers, indices and values: in 16, 16 and 20 characters, or between blanks."""
    fixed = [line[:16], line[16:32], line[32:52]]
    return fixed if all(_FORMAT.fullmatch(word.strip()) for word in fixed) else line.split()[:3]


def _numbers(
    lines: Iterator[str], form: re.Match[str] | None, total: int, kind: type[int] | type[float]
) -> np.ndarray[Any, np.dtype[Any]]:
    """Return numbers out of lines of fields of a fixed width."""
    if form is None or (kind is int) != (form["kind"].upper() == "I"):
        raise ValueError("its formats are not those of whole numbers and numbers with a point")
    count, width = int(form["count"] or 1), int(form["width"])
    if not 0 < width <= 100 or not 0 < count <= 1000:
        raise ValueError("its formats are no formats")
    words: list[str] = []
    for line in islice(lines, -(-total // count)):
        fields = (line[k : k + width].strip() for k in range(0, min(len(line), count * width), width))
        words += [field for field in fields if field]
    if len(words) < total:
        raise ValueError(f"it ends after {len(words)} of {total} numbers: it is truncated")
    if kind is int:
        return np.array([int(word) for word in words[:total]], dtype=np.int64)
    return np.array([real(word) for word in words[:total]], dtype=np.float64)


def _mapping(path: Path, rows: int) -> tuple[str, ...]:
    """Return the labels of rows: lines ``row node direction`` below a heading."""
    with read_errors(path, "a mapping of Ansys"):
        if path.stat().st_size > 1_000_000_000:
            raise FileError(f"{path} is too large for a mapping")
        entries = (line.split() for line in path.read_text(encoding="latin-1").splitlines())
        named = {
            int(words[0]): f"{words[1]}:{words[2]}"
            for words in entries
            if len(words) == 3 and words[0].isdecimal() and words[1].isdecimal()
        }
        if sorted(named) != list(range(1, rows + 1)):
            raise FileError(f"{path} names {len(named)} rows of {rows}")
        return tuple(named[row] for row in range(1, rows + 1))
