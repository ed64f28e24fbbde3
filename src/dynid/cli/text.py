"""Lines of text as wide as the terminal: paragraphs, names with descriptions, tables."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable, Sequence
from contextvars import ContextVar
from shutil import get_terminal_size
from textwrap import wrap
from typing import Any

#: Widths of screens in characters: the usual one of texts, and limits of what terminals give.
_USUAL, _NARROWEST, _WIDEST = 110, 60, 120

#: The width of the screen of another process, for which this one writes; None: its own.
screen_elsewhere: ContextVar[int | None] = ContextVar("screen_elsewhere", default=None)


def columns() -> int:
    """Return the width of the screen, characters: of a terminal, at most 120; 120 for pipes and files."""
    if (width := screen_elsewhere.get()) is not None:
        return width
    if not sys.stdout.isatty():
        return _WIDEST
    return max(_NARROWEST, min(_WIDEST, get_terminal_size().columns))


def wrapped(text: str, width: int, **options: Any) -> list[str]:
    """Return a text as lines of at most a width, less on narrow terminals; options as of `textwrap.wrap`."""
    return wrap(text, width - max(0, _USUAL - columns()), **options)


def folded(line: str, hanging: int | None = None) -> list[str]:
    """Return a line as it is, or as several with a hanging indent where a terminal is narrower."""
    if not sys.stdout.isatty() or len(line) <= columns():
        return [line]
    left = " " * (len(line) - len(line.lstrip()) + 2 if hanging is None else hanging)
    return wrap(line, columns(), subsequent_indent=left, break_long_words=False, break_on_hyphens=False)


def described(rows: Sequence[tuple[str, str]], indent: str = "  ") -> list[str]:
    """Return names with their descriptions in a second column, which is wrapped on a terminal."""
    width = max((len(name) for name, _ in rows), default=0)
    lines = (f"{indent}{name:{width}}  {text}".rstrip() for name, text in rows)
    return [part for line in lines for part in folded(line, len(indent) + width + 2)]


def aligned(
    rows: Sequence[Sequence[str]], indent: str = "    ", left: Collection[int] = (0,)
) -> Iterable[str]:
    """Yield a table as lines; one that is wider than a terminal continues in further blocks of columns.

    The headings are the first row; the first column is repeated in every block.
    """
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    room = (columns() if sys.stdout.isatty() else 1000) - len(indent)
    blocks: list[list[int]] = [[0]]
    for k in range(1, len(widths)):
        if len(blocks[-1]) > 1 and sum(widths[j] + 2 for j in blocks[-1]) + widths[k] > room:
            blocks.append([0])
        blocks[-1].append(k)
    for number, block in enumerate(blocks):
        if number:
            yield ""
        for row in rows:
            cells = (f"{row[k]:{'<' if k in left else '>'}{widths[k]}}" for k in block)
            yield f"{indent}{'  '.join(cells)}".rstrip()
