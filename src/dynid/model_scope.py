"""The scope of a model: what a result includes, what was left out, and why."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from dynid.result import Result

#: Most names in a list.
_MAX_LISTED_NAMES = 500


class ScopePart(NamedTuple):
    """The kept and the omitted items of one kind: elements, states, modes, parameters, engines, results, ….

    They are names, or a number where they have none; `why` is the reason for the omission.
    """

    name: str
    kept: Sequence[str] | int
    left_out: Sequence[str] | int
    why: str


def divided(name: str, all_names: Iterable[str], kept: Iterable[str], why: str) -> ScopePart:
    """Return a part of named items: those kept, and all other known ones as omitted."""
    inside = set(kept)
    names = list(dict.fromkeys(all_names))
    return ScopePart(name, [n for n in names if n in inside], [n for n in names if n not in inside], why)


def add_model_scope(result: Result, holder: str, parts: Sequence[ScopePart]) -> None:
    """Add the scope of a model to a result, in the group of its kind.

    ``<holder>/need/{part, kept, left_out, kept_names, left_out_names, why}``: counts, and names where the
    items have them.
    """
    group, dims = f"{holder}/need", ("part",)
    result.add_axis(f"{group}/part", [row.name for row in parts])
    for column in ("kept", "left_out"):
        values = [getattr(row, column) for row in parts]
        result.add(
            f"{group}/{column}", [value if isinstance(value, int) else len(value) for value in values], dims
        )
        names = ["" if isinstance(value, int) else listed_names(value) for value in values]
        result.add(f"{group}/{column}_names", names, dims)
    any_left = (bool(row.left_out) for row in parts)
    result.add(f"{group}/why", [p.why if yes else "" for p, yes in zip(parts, any_left, strict=True)], dims)


def wants_scope(result: Result, holder: str) -> bool:
    """Return True if a result keeps anything of the scope of a model."""
    columns = ("kept", "left_out", "kept_names", "left_out_names", "why")
    return any(result.wants(f"{holder}/need/{column}") for column in columns)


def scope_parts(result: Result, holder: str) -> list[ScopePart]:
    """Return the parts that `add_model_scope` added to a result."""
    group = f"{holder}/need"
    columns = ("part", "kept_names", "kept", "left_out_names", "left_out", "why")
    return [
        ScopePart(
            str(name),
            str(kept_names).split(", ") if kept_names else int(kept),
            str(left_names).split(", ") if left_names else int(left),
            str(why),
        )
        for name, kept_names, kept, left_names, left, why in zip(
            *(result[f"{group}/{column}"].data for column in columns), strict=True
        )
    ]


def listed_names(names: Sequence[str]) -> str:
    """Return a list of names, shortened where it is long."""
    more = f" and {len(names) - _MAX_LISTED_NAMES} more" if len(names) > _MAX_LISTED_NAMES else ""
    return ", ".join(names[:_MAX_LISTED_NAMES]) + more
