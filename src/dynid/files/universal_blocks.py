"""Data sets of a Universal File as they stand in it, and the numbers of functions (58).

A data set stands between two lines ``-1``, by the format in columns 5 and 6. Programs also write them in the
first columns, pad lines with blanks to 80 columns, and print exponents as Fortran does (``1.5D+02``,
``1.5-102``). What is passed on is as the format says.
Source: SDRC, "Universal File Datasets", Structural Dynamics Research Laboratory, University of Cincinnati.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_MARGIN = b" " * 4
_LIMIT = rb"[ \t]*(?:\r?\n|\Z)"
_ANY_LIMIT = re.compile(rb"^([ ]*)-1" + _LIMIT, re.MULTILINE)
_TYPE = re.compile(r"\s*(\d+)\s*([bB]?)(.*)")
#: A line of numbers alone.
_NUMERIC = re.compile(r"[-+.\deEdD\s]*\d[-+.\deEdD\s]*")
#: An exponent of three digits without its letter; the blank in front makes room for it.
_BARE_EXPONENT = re.compile(r" ([-+]?\d*\.\d*)([-+]\d{3})(?!\d)")
_NUMBER = re.compile(
    r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+|[-+]\d{3})?|nan|inf(?:inity)?)", re.IGNORECASE
)
#: Header lines of a data set 58, its type included.
HEADER = 12


class DataSet(NamedTuple):
    """A data set: its type, the line of the file where this stands, its lines, and its binary part."""

    kind: int
    line: int
    lines: Sequence[str]
    binary: bytes = b""


class BlockError(ValueError):
    """A fault of a Universal File as a sequence of data sets."""


def data_sets(content: bytes) -> list[DataSet]:
    """Return the data sets of a Universal File."""
    content = content.removeprefix(b"\xef\xbb\xbf")
    if b"\n" not in content:
        content = content.replace(b"\r", b"\n")
    first = _ANY_LIMIT.search(content)
    if first is None:
        raise BlockError("has no line -1, between which data sets stand: it is no Universal File")
    margins = b"|".join({_MARGIN, first[1]})
    limit = re.compile(rb"^(?:" + margins + rb")-1" + _LIMIT, re.MULTILINE)
    sets: list[DataSet] = []
    opening: re.Match[bytes] | None = first
    line, counted = 1, 0
    while opening is not None:
        start = opening.end()
        line, counted = line + content.count(b"\n", counted, start), start
        head = content[start : start + 200].partition(b"\n")[0].decode("latin-1").rstrip()
        kind = _TYPE.fullmatch(head)
        if kind is None:
            raise BlockError(
                f"has '{head.strip()[:40]}' in line {line}, where a type of data sets stands behind -1"
            )
        text_ends, end = start, None
        if kind[2]:
            text_ends, end = _binary(content, start, kind[3], margins)
        else:
            end = limit.search(content, start)
            text_ends = end.start() if end else start
        if end is None:
            raise BlockError(
                f"does not end with the line -1: it is truncated within the data set of type {kind[1]} in "
                f"line {line}"
            )
        head = f"{int(kind[1]):6d}"  # the type, in the columns of the format
        if kind[2]:
            order, form, count, size = _binary_fields(kind[3])
            head += f"b{order:6d}{form:6d}{count:12d}{size:12d}"
        lines = [head, *_lines(content[start:text_ends])[1:]]
        sets.append(DataSet(int(kind[1]), line, lines, content[text_ends : end.start()]))
        opening, last = limit.search(content, end.end()), end
    if content[last.end() :].strip(b"\0 \t\r\n"):
        raise BlockError("does not end with the line -1: it is no Universal File, or is truncated")
    return sets


def _binary_fields(head: str) -> tuple[int, int, int, int]:
    """Return byte order, format, number of header lines and of bytes, 0 where they are not stated."""
    words = head.split()[:4]
    if not all(re.fullmatch("[0-9]{1,18}", word) for word in words):
        raise BlockError(f"has '{head.strip()[:40]}' behind the type of a binary data set, no whole numbers")
    order, form, lines, size = [*(int(word) for word in words), 0, 0, 0, 0][:4]
    return order, form, lines, size


def _binary(content: bytes, start: int, head: str, margins: bytes) -> tuple[int, re.Match[bytes] | None]:
    """Return where the binary part of a data set starts, and its end; `head` is behind its type."""
    _, _, lines, size = _binary_fields(head)
    at = start
    for _ in range(1 + (lines or HEADER - 1)):
        if not (at := content.find(b"\n", at) + 1):
            return start, None
    # A binary part need not end with a line break, and some programs count its bytes wrongly.
    counted = (
        re.compile(rb"(?:\r?\n)?(?:" + margins + rb")-1" + _LIMIT).match(content, at + size) if size else None
    )
    return at, counted or re.compile(rb"(?:\r?\n)?" + _MARGIN + rb"-1" + _LIMIT).search(content, at)


def _lines(content: bytes) -> list[str]:
    """Return lines without blanks at their ends, with numbers as Python reads them."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    return [
        _BARE_EXPONENT.sub(r"\1E\2", line.replace("D", "E").replace("d", "e"))
        if _NUMERIC.fullmatch(line)
        else line
        for line in map(str.rstrip, text.removesuffix("\n").split("\n"))
    ]


def check_columns(data_set: DataSet, first: int = 0, last: int | None = None) -> None:
    """Refuse a data set whose numbers, from a first to a last line, are not in columns of 13 characters."""
    for at, line in enumerate(data_set.lines[first:last], first):
        if "." in line and _NUMERIC.fullmatch(line):
            columns = [line[k : k + 13].strip() for k in range(0, len(line), 13)]
            if columns != _NUMBER.findall(line):
                raise ValueError(
                    f"line {data_set.line + at} has numbers that are not in columns of 13 characters"
                )


def function_values(data_set: DataSet, header: Mapping[str, Any]) -> tuple[NDArray[np.float64], NDArray[Any]]:
    """Return abscissae and ordinates of a data set 58 with its header."""
    if header["ord_data_type"] not in (2, 4, 5, 6):
        raise ValueError(
            f"its ordinates have the data type {header['ord_data_type']}; 2, 4, 5 and 6 are known"
        )
    single, is_complex = header["ord_data_type"] in (2, 5), header["ord_data_type"] in (5, 6)
    if data_set.binary or header["binary"]:
        order = "<" if header["byte_ordering"] == 1 else ">"
        width = 4 if single else 8
        numbers = np.frombuffer(
            data_set.binary[: len(data_set.binary) // width * width], f"{order}f{width}"
        ).astype(float)
    else:
        numbers = _numbers(data_set)
    even = header["abscissa_spacing"] == 1
    columns = 1 + is_complex + (not even)
    rows = numbers[: len(numbers) // columns * columns].reshape(-1, columns)
    values = rows[:, -2] + 1j * rows[:, -1] if is_complex else rows[:, -1].copy()
    start, step = header["abscissa_min"], header["abscissa_inc"]
    return (start + step * np.arange(len(rows)) if even else rows[:, 0].copy()), values


def _numbers(data_set: DataSet) -> NDArray[np.float64]:
    """Return the numbers below the header, in columns of any width."""
    body = data_set.lines[HEADER:]
    try:
        return np.array(" ".join(body).split(), dtype=float)
    except ValueError:  # negative numbers may follow without a blank
        numbers: list[float] = []
        for at, line in enumerate(body):
            if rest := _NUMBER.sub("", line).strip():
                where = data_set.line + HEADER + at
                raise ValueError(f"line {where} has '{rest[:20]}', which is no number") from None
            numbers += [
                float(re.sub(r"(?<=[\d.])([-+]\d{3})$", r"e\1", word)) for word in _NUMBER.findall(line)
            ]
        return np.array(numbers)
