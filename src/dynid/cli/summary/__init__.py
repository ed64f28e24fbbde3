"""Summary of a result on one screen: the answer, what to know of it, where the rest is.

Sentences and tables that screens share with reports are in `dynid.report.content`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynid.cli.summary.common import columns, folded, paragraph, wrapped
from dynid.cli.summary.transfer_functions import derivation_lines
from dynid.report.content import doubts, method, part_name
from dynid.scene.kind import KINDS, resolve

if TYPE_CHECKING:
    from dynid.result import Result

#: Screens of results that have no scene.
_OTHERS = {
    "plan": "dynid.cli.summary.identification:plan_lines",
    "bench": "dynid.cli.summary.bench:lines",
}
#: Most names of a part left out that are written; further ones are counted.
_NAMES = 6


def summary(result: Result, note: str, *, trace: bool = False) -> str:
    """Return a result as a screen of text.

    Parameters
    ----------
    result
        The result.
    note
        End of the headline: the duration of the run, or the time of creation.
    trace
        With the derivations: causality, and the steps of the reduction.
    """
    kind = KINDS.get(result.kind)
    screen = kind.load("summary") if kind else resolve(_OTHERS.get(result.kind, ""))
    if screen is None:  # of a kind that this version does not know
        return "\n".join([*_headline(result.title, result.kind, note), "", contents(result)])
    lines = [*_headline(result.title, method(result), note), "", *screen(result)]
    while not lines[-1]:
        lines.pop()
    if warnings := doubts(result):
        lines += ["", *(f"  {line}" for sentence in warnings for line in wrapped(sentence, 104))]
    if need := need_lines(result, in_full=trace):
        lines += ["", *need]
    if "accuracy" in result.group_attrs:
        from dynid.cli.summary.bench import accuracy_lines

        lines += ["", *accuracy_lines(result)]
    derivations = derivation_lines(result)
    if derivations and derivations[0] not in lines:
        lines += ["", *derivations] if trace else ["", "  derivation: -v, or dynid show --trace"]
    return "\n".join(part for line in lines for part in folded(line)).rstrip("\n")


def _headline(title: str, method: str, note: str) -> list[str]:
    """Return title, method and note in one line, or in two on a narrow terminal."""
    right = " · ".join(part for part in (method, note) if part)
    if len(title) + 2 + len(right) > columns():
        return [title, *paragraph(right)]
    return [f"{title}{' ' * max(2, min(100, columns()) - len(title) - len(right))}{right}"]


def contents(result: Result) -> str:
    """Return the arrays of a result with their axes, types and units, one per line."""
    from dynid.report.content import array_rows

    width = max((len(path) for path in result), default=0)
    lines = (
        f"  {path:<{width}}  {kind}  {axes}  {units}".rstrip()
        for path, kind, axes, units in array_rows(result)
    )
    return "\n".join(part for line in lines for part in folded(line))


def need_lines(result: Result, *, in_full: bool) -> list[str]:
    """Return what was left out of the model, in one line, or with the reasons; empty if not recorded.

    Parameters
    ----------
    result
        The result.
    in_full
        True for all parts and the reasons; else these are shown where they fit in one line.
    """
    group = next((path.rpartition("/")[0] for path in result if path.endswith("/need/part")), None)
    if group is None:
        return []
    names = ("part", "kept", "left_out", "left_out_names", "why")
    texts, short = [], []
    for part, kept, left, named, why in zip(
        *(result[f"{group}/{column}"].data for column in names), strict=True
    ):
        if left:
            listed = named and named.count(", ") < _NAMES and part != "results"
            short.append(f"{left:,} of {kept + left:,} {part_name(result, str(part))}")
            texts.append(f"{short[-1]}{f': {named}' if listed else ''} ({why})")
    lines = wrapped(
        f"left out: {'; '.join(texts) or 'nothing'}", 108, initial_indent="  ", subsequent_indent="    "
    )
    if in_full or len(lines) == 1:
        return lines
    room = min(108, columns()) - len("  left out: ; why: -v, or dynid show --trace")
    while len("; ".join(short)) > room and len(short) > 1:
        short[-2:] = ["…"]
    return [f"  left out: {'; '.join(short)}; why: -v, or dynid show --trace"]
