"""What was modelled and what was left out, and why: said of every result in one form."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from dynid.result import Result

#: Most names that are written out.
_SHOWN = 500


class Part(NamedTuple):
    """What was kept and what was left out of one sort of things.

    Parameters
    ----------
    name
        The sort: elements, states, modes, parameters, engines, results, ….
    kept, left_out
        Names, or how many where they have none.
    why
        Why the others were left out; empty where none were.
    """

    name: str
    kept: Sequence[str] | int
    left_out: Sequence[str] | int
    why: str


def divided(name: str, known: Iterable[str], kept: Iterable[str], why: str) -> Part:
    """Return a part whose things have names: those that were kept, and all others that are known."""
    inside = set(kept)
    names = list(dict.fromkeys(known))
    return Part(name, [n for n in names if n in inside], [n for n in names if n not in inside], why)


def add_need(result: Result, holder: str, parts: Sequence[Part]) -> None:
    """Add what was needed.

    Parameters
    ----------
    result
        The result.
    holder
        Its kind's group.
    parts
        What was kept and left out.

    Notes
    -----
    ``<holder>/need/{part, kept, left_out, kept_names, left_out_names, why}``: counts, and names where
    things have them.
    """
    group, dims = f"{holder}/need", ("part",)
    result.add_axis(f"{group}/part", [part.name for part in parts])
    for column in ("kept", "left_out"):
        each = [getattr(part, column) for part in parts]
        result.add(f"{group}/{column}", [one if isinstance(one, int) else len(one) for one in each], dims)
        names = ["" if isinstance(one, int) else listed_names(one) for one in each]
        result.add(f"{group}/{column}_names", names, dims)
    any_left = (bool(part.left_out) for part in parts)
    result.add(f"{group}/why", [p.why if yes else "" for p, yes in zip(parts, any_left, strict=True)], dims)


def listed_names(names: Sequence[str]) -> str:
    """Write names, or as many as a reader would read."""
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
