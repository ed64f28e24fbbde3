"""Matrices in text as FE programs export them: CalculiX, Harwell–Boeing (Ansys), MATLAB scripts.

- CalculiX (`.sti`, `.mas`), as ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` writes them: lines ``row column value``
  of one triangle, and beside them a file `.dof` with ``node.component`` of each row.
  Source: G. Dhondt, "CalculiX CrunchiX User's Manual", 2.20.
- Harwell–Boeing and Rutherford–Boeing files, as ``HBMAT`` of Ansys writes them, too: assembled real matrices,
  by columns, in Fortran's formats; of symmetric ones one triangle. Ansys writes the node and the direction of
  each row into a file `.mapping` beside it. Source: I. S. Duff, R. G. Grimes, J. G. Lewis, "Users' Guide for
  the Harwell-Boeing Sparse Matrix Collection", 1992.
- MATLAB scripts of triplets (`.m`), as Sierra/SD and other programs write them: a function that lists
  ``row column value;`` between brackets and passes them to ``sparse``. Nothing is executed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import FileError
from dynid.files.fe_text import real
from dynid.files.matrix_data import ImportedMatrix, compressed
from dynid.files.matrix_market import assembled, entry_indices, one_triangle, read_triplets
from dynid.files.untrusted import check_backed, check_claim, check_size, read_errors
from dynid.structure.labels import DIRECTIONS

#: The largest script, and the largest file of labels, bytes.
_MAX_SCRIPT_BYTES, _MAX_LABEL_BYTES = 4_000_000_000, 1_000_000_000


def read_calculix(path: Path) -> ImportedMatrix:
    """Return a matrix, with labels where the file `.dof` stands beside it."""
    matrix = read_triplets(path)
    order = path.with_suffix(".dof")
    if not order.is_file():
        return matrix
    labels = _read_order(order)
    rows = matrix.matrix.shape[0]
    if rows != len(labels):
        truncated = ": it is truncated" if rows < len(labels) else ""
        raise FileError(f"{path} has {rows} rows, but {order} names {len(labels)} DOFs{truncated}")
    return replace(matrix, labels=labels, at_least=False)


def _read_order(path: Path) -> tuple[str, ...]:
    """Return the labels of the DOFs in a file `.dof`."""
    with read_errors(path, "an order of DOFs of CalculiX"):
        check_size(path, "an order of DOFs", _MAX_LABEL_BYTES)
        words = path.read_text(encoding="utf-8").split()
        wrong = next((word for word in words if not re.fullmatch(r"\d+\.[1-6]", word)), None)
        if wrong is not None or not words:
            raise FileError(
                f"{path} names no DOFs: '{wrong}' is no node.component" if words else f"{path} is empty"
            )
        return tuple(f"{word[:-2]}:{DIRECTIONS[int(word[-1]) - 1]}" for word in words)


_WHAT = "a Harwell-Boeing file"
_FORMAT = re.compile(
    r"\(\s*(?:\d+P\s*,?\s*)?(?P<count>\d*)(?P<kind>[IEDFG])(?P<width>\d+)(?:\.\d+)?(?:E\d+)?\s*\)",
    re.IGNORECASE,
)


def read_harwell_boeing(path: Path) -> ImportedMatrix:
    """Return the matrix of a file, both triangles, with the labels of a file `.mapping` beside it."""
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
            words = [head[3][:16], head[3][16:32], head[3][32:52]]
            if not all(_FORMAT.fullmatch(word.strip()) for word in words):
                words = head[3].split()[:3]  # between blanks, not in 16, 16 and 20 characters
            formats = [_FORMAT.fullmatch(word.strip()) for word in words]
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
        check_size(path, "a mapping", _MAX_LABEL_BYTES)
        entries = (line.split() for line in path.read_text(encoding="latin-1").splitlines())
        named = {
            int(words[0]): f"{words[1]}:{words[2]}"
            for words in entries
            if len(words) == 3 and words[0].isdecimal() and words[1].isdecimal()
        }
        if sorted(named) != list(range(1, rows + 1)):
            raise FileError(f"{path} names {len(named)} rows of {rows}")
        return tuple(named[row] for row in range(1, rows + 1))


_SPARSE = re.compile(
    r"^\s*(?P<name>\w+)\s*=\s*sparse\(\s*\w+\(:,1\)\s*,\s*\w+\(:,2\)\s*,\s*\w+\(:,3\)"
    r"\s*(?:,\s*(?P<rows>\d+)\s*,\s*(?P<columns>\d+)\s*)?\)"
)


def read_script(path: Path) -> ImportedMatrix:
    """Return the matrix of a script; entries of one triangle only are mirrored."""
    with read_errors(path, "a MATLAB script of a sparse matrix"):
        check_size(path, "a script of a matrix", _MAX_SCRIPT_BYTES)
        inside, call = False, None
        numbers: list[str] = []
        with path.open(encoding="utf-8") as lines:
            for line in lines:
                text = line.split("%")[0].strip()
                if inside:
                    body, bracket, _ = text.partition("]")
                    if body:
                        numbers.append(body)
                    inside = not bracket
                elif re.fullmatch(r"\w+\s*=\s*\[", text) and not numbers:
                    inside = True
                else:
                    call = call or _SPARSE.match(text)
        if inside or call is None:
            raise ValueError("the triplets have no end, or are not passed to 'sparse'")
        table = np.loadtxt([row.rstrip(";, ") for row in numbers], ndmin=2) if numbers else np.empty((0, 3))
        if table.shape[1] != 3:
            raise ValueError(f"its rows have {table.shape[1]} numbers, not row, column, value")
        ends = entry_indices(path, table[:, :2])
        size = (int(call["rows"]), int(call["columns"])) if call["rows"] else None
        shape = size or (int(ends.max(initial=1)),) * 2
        if max(shape) > max(path.stat().st_size, 1000):
            raise ValueError(f"it claims {shape[0]} x {shape[1]}, more rows than its bytes")
        mirror = one_triangle(ends)
        return ImportedMatrix(assembled(path, ends, table[:, 2], shape, mirror=mirror), at_least=size is None)
