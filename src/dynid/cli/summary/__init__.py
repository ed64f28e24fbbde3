"""What a result says, on one screen: the user's question first, then how it is known."""

from __future__ import annotations

from importlib import import_module
from textwrap import wrap
from typing import TYPE_CHECKING

from dynid.cli.summary.need import need_lines
from dynid.report.answers import method
from dynid.report.answers.common import doubts

if TYPE_CHECKING:
    from dynid.result import Result

_KINDS = {
    "bond-graph": "dynid.cli.summary.bond_graph",
    "identification": "dynid.cli.summary.identification",
    "plan": "dynid.cli.summary.plan",
    "reduction": "dynid.cli.summary.reduction",
    "bench": "dynid.cli.summary.bench",
    "study": "dynid.cli.summary.study",
}


def summary(result: Result, note: str) -> str:
    """Return a result as a screen of text.

    Parameters
    ----------
    result
        The result.
    note
        What to say at the end of the headline (how long it took, or when it was made).
    """
    if result.kind not in _KINDS:
        return f"{_headline(result.title, result.kind, note)}\n\n{contents(result)}"
    module = import_module(_KINDS[result.kind])
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
    from dynid.report.answers.contents import array_rows

    width = max((len(path) for path in result), default=0)
    return "\n".join(
        f"  {path:<{width}}  {kind}  {axes}  {units}".rstrip()
        for path, kind, axes, units in array_rows(result)
    )
