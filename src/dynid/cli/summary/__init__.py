"""Summary of a result on one screen: the answers first, then the method."""

from __future__ import annotations

from textwrap import wrap
from typing import TYPE_CHECKING, Any

from dynid.cli.summary.need import need_lines
from dynid.report.content import doubts, method
from dynid.scene.kind import KINDS, resolve

if TYPE_CHECKING:
    from dynid.result import Result

#: Kinds of results that are of no scene.
_OTHERS = {
    "plan": "dynid.cli.summary.plan",
    "bench": "dynid.cli.summary.bench",
}


def _module(result: Result) -> Any:
    """Return the module for results of a kind; None where the kind is unknown."""
    kind = KINDS.get(result.kind)
    return kind.load("summary") if kind else resolve(_OTHERS.get(result.kind, ""))


def summary(result: Result, note: str) -> str:
    """Return a result as a screen of text.

    Parameters
    ----------
    result
        The result.
    note
        What to say at the end of the headline (how long it took, or when it was made).
    """
    if _module(result) is None:
        return f"{_headline(result.title, result.kind, note)}\n\n{contents(result)}"
    module = _module(result)
    lines = [_headline(result.title, method(result), note), "", *module.lines(result)]
    while not lines[-1]:
        lines.pop()
    if said := doubts(result):
        lines += ["", *(f"  {line}" for sentence in said for line in wrap(sentence, 104))]
    if need := need_lines(result):
        lines += ["", *need]
    if "accuracy" in result.group_attrs:
        from dynid.cli.summary.accuracy import accuracy_lines

        lines += ["", *accuracy_lines(result)]
    return "\n".join(lines).rstrip("\n")


def _headline(title: str, method: str, note: str) -> str:
    right = " · ".join(part for part in (method, note) if part)
    return f"{title}{' ' * max(2, 100 - len(title) - len(right))}{right}"


def contents(result: Result) -> str:
    """Return the arrays of a result with their axes, types and units, one a line."""
    from dynid.report.content import array_rows

    width = max((len(path) for path in result), default=0)
    return "\n".join(
        f"  {path:<{width}}  {kind}  {axes}  {units}".rstrip()
        for path, kind, axes, units in array_rows(result)
    )
