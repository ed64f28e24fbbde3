"""Cards of Nastran bulk data: names and fields.

Fields of 8 or 16 columns or separated by commas, continuations in order, `INCLUDE`.
Source: MSC Nastran Quick Reference Guide, "Bulk Data Entries".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Set
from pathlib import Path

from dynid.errors import FileError
from dynid.structure.readers.program_text import opened

WHAT = "Nastran bulk data"

Card = list[str]


def read_cards(path: Path, kept: Set[str]) -> dict[str, list[Card]]:
    """Return the cards of some names in a file, each as its fields, the name first, padded by blanks."""
    found: dict[str, list[Card]] = {}
    current: Card | None = None
    for line in _lines(path, 0, [0]):
        fields = _fields(line)
        name = fields[0].rstrip("*").rstrip().upper()
        if name.startswith("="):
            raise FileError(f"{path} repeats cards (=), which is not read", remedy="Write them out.")
        if name and not name.startswith(("+", "*")):
            current = [name] if name in kept else None
            if current is not None:
                found.setdefault(name, []).append(current)
        if current is not None:
            current += fields[1:]
    for cards in found.values():
        for card in cards:
            card.extend([""] * (13 - len(card)))
    return found


def _lines(path: Path, depth: int, size: list[int]) -> Iterator[str]:
    """Yield the lines of bulk data in a file and those that it includes, without comments.

    The commands above ``BEGIN BULK`` are left out; files without it are bulk data from their first line.
    """
    with opened(path, depth, size) as stream:
        above = depth == 0 and any(re.match(r"\s*BEGIN\s+BULK", line, re.IGNORECASE) for line in stream)
        stream.seek(0)
        for raw in stream:
            line = raw.split("$")[0].rstrip()
            word = line[:9].strip().upper()
            if word.startswith("BEGIN"):
                above = False
            elif word.startswith("ENDDATA"):
                return
            elif line and not above:
                if word.startswith("INCLUDE"):
                    name = line.strip()[7:].strip().strip("'\"")
                    yield from _lines(path.parent / name, depth + 1, size)
                else:
                    yield line


def _fields(line: str) -> list[str]:
    """Return the fields of a line: its name, then eight small ones or four large ones."""
    wide = "*" in line[:8]
    count = 4 if wide else 8
    if "," in line:
        fields = [field.strip() for field in line.split(",")][: count + 1]
    else:
        line, size = line.expandtabs(8), 16 if wide else 8
        fields = [line[:8].strip(), *(line[k : k + size].strip() for k in range(8, min(len(line), 72), size))]
    return fields + [""] * (count + 1 - len(fields))


def listed_points(fields: Iterable[str]) -> list[int]:
    """Return the points of a list of fields behind a name, with ``THRU``."""
    given = [field.upper() for field in list(fields)[1:] if field and "." not in field]
    if "THRU" in given:
        first, last = whole(given[0]), whole(given[-1])
        if last - first > 10_000_000:
            raise ValueError(f"{first} THRU {last} are too many points")
        return list(range(first, last + 1))
    return [whole(field) for field in given]


def whole(field: str) -> int:
    """Return a whole number; a blank is 0."""
    return int(field) if field else 0
