"""What an answer is made of: parts with a heading, each a few facts, tables, notes or formulas."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Facts:
    """Names and what they are; an item may have several lines."""

    items: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class Grid:
    """A table of texts, its first column the heading of each row.

    Parameters
    ----------
    columns
        Headings.
    rows
        One text a column.
    marked
        Which rows stand out.
    caption
        What it lists.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    marked: frozenset[int] = frozenset()
    caption: str = ""


@dataclass(frozen=True)
class Note:
    """A sentence; `tone` is good, bad, or nothing."""

    text: str
    tone: str = ""


@dataclass(frozen=True)
class Steps:
    """Formulas or sentences in order."""

    items: tuple[str, ...]


Block = Facts | Grid | Note | Steps


@dataclass(frozen=True)
class Part:
    """Blocks under a heading."""

    title: str
    blocks: tuple[Block, ...]


@dataclass(frozen=True)
class Answer:
    """What a result says.

    Parameters
    ----------
    method
        The kind of analysis, and how it was done.
    parts
        In the order of a reader's questions.
    """

    method: str
    parts: tuple[Part, ...] = field(default=())


def facts(*items: tuple[str, str | Iterable[str]]) -> Facts:
    """Return facts, without those that have nothing to say."""
    each = ((name, (said,) if isinstance(said, str) else tuple(said)) for name, said in items)
    return Facts(tuple((name, lines) for name, lines in each if any(lines)))
