"""Content of results, for screens, pages and notebooks: sections of definitions, tables and statements.

Every kind of result has a module with the sections of its own; those of several kinds are here:
expectations, model scope, undecided verdicts.
"""

from __future__ import annotations

from collections.abc import Iterator

from dynid.number_format import counted
from dynid.report.content.bench import alternative_sections
from dynid.report.content.blocks import Content, ReportSection, Statement, TextTable
from dynid.report.scenes import plain_data
from dynid.result import Result
from dynid.scene.kind import KINDS, resolve

#: Longest list of names of what a model omits; longest line with the reasons, and without them; characters.
_NAMES, _LINE, _PARTS = 200, 106, 59
#: Parts of models in words, by kind of result.
_PARTS_IN_WORDS = {("", "storages"): "storage elements", ("identification", "engines"): "estimation methods"}
#: Content of results that are of no kind of scene.
_OTHERS = {
    "plan": "dynid.report.content.plan",
    "bench": "dynid.report.content.bench",
}


def content(result: Result) -> Content:
    """Return the content of the report of a result; of an unknown kind, its name only."""
    kind = KINDS.get(result.kind)
    module = kind.load("content") if kind else resolve(_OTHERS.get(result.kind, ""))
    if module is None:
        return Content(result.kind)
    sections: list[ReportSection] = [
        *module.sections(result),
        *_undecided(result),
        *_expectations(result),
        *_scope(result),
        *alternative_sections(result),
    ]
    return Content(str(module.method(result)), tuple(sections))


def _undecided(result: Result) -> Iterator[ReportSection]:
    """Yield the verdicts that round-off leaves undecided."""
    texts = dict.fromkeys(str(attrs["doubt"]) for attrs in result.group_attrs.values() if "doubt" in attrs)
    if texts:
        statements = tuple(Statement(f"warning: {text}", "bad") for text in texts)
        yield ReportSection("Undecided verdicts", statements, "answer", screen="")


def _expectations(result: Result) -> Iterator[ReportSection]:
    """Yield the expectations of the scene, checked again; nothing where its scene cannot be read."""
    text = str(result.attrs.get("scene", ""))
    if "expect" not in text or result.attrs.get("status") == "interrupted" or result.kind == "plan":
        return  # a plan has nothing of what its scene expects of a run
    items = plain_data(text).get("expect")
    expected = [i for i in (items if isinstance(items, list) else []) if isinstance(i, dict) and "path" in i]
    if not expected:
        return
    from dynid.checks import check_expectations

    outcomes = check_expectations(result, expected)
    met = sum(outcome.passed for outcome in outcomes)
    tone = "good" if met == len(outcomes) else "bad"
    summary = Statement(f"{met} of {counted(len(outcomes), 'expectation')} met", tone)
    rows = tuple(
        (one.path, one.expected, one.found, "met" if one.passed else f"not met: {one.message}")
        for one in outcomes
    )
    failed = frozenset(index for index, one in enumerate(outcomes) if not one.passed)
    table = TextTable(("array", "expected", "found", ""), rows, failed)
    yield ReportSection("Expectations", (summary, *([table] if failed else [])), "answer")
    if not failed:
        yield ReportSection("Expectations in full", (table,))


def _scope(result: Result) -> Iterator[ReportSection]:
    """Yield the parts of the scene that the model includes and omits, with the reasons.

    A brief screen lists parts of the model alone, not engines and what was not requested.
    """
    group = next((path.rpartition("/")[0] for path in result if path.endswith("/need/part")), None)
    if group is None:
        return
    columns = [
        result[f"{group}/{name}"].data for name in ("part", "kept", "left_out", "left_out_names", "why")
    ]
    rows, brief, full = [], [], []
    for section, kept, left, listed, why in zip(*columns, strict=True):
        names = str(listed) if len(str(listed)) < _NAMES else ""
        name = _PARTS_IN_WORDS.get((result.kind, section)) or _PARTS_IN_WORDS.get(("", section), str(section))
        rows.append((name, f"{int(kept):,}", f"{int(left):,}", names, str(why)))
        if left:
            count, listed_names = f"{left:,} of {kept + left:,} {name}", names and section != "results"
            full.append(f"{count}{f': {names}' if listed_names else ''} ({why})")
            if not section.startswith("engines") and str(why) != "not requested":
                brief.append((count, full[-1]))
    heads = ("", "included", "omitted", "", "reason")
    yield ReportSection("Model scope", (TextTable(heads, tuple(rows)),))
    text = f"left out: {'; '.join(full) or 'nothing'}"
    yield ReportSection("Omitted", (Statement(text),), "", screen="", detail="trace")
    if not brief:
        return
    text = f"left out: {'; '.join(in_full for _, in_full in brief)}"
    if len(text) > _LINE:
        counts = [count for count, _ in brief]
        while len("; ".join(counts)) > _PARTS and len(counts) > 1:
            counts[-2:] = ["…"]
        text = f"left out: {'; '.join(counts)}; why: -v, or dynid show --trace"
    yield ReportSection("Omitted", (Statement(text),), "", screen="", detail="brief")


def array_rows(result: Result) -> list[tuple[str, str, str, str]]:
    """Return path, type, axes and units of every array, sorted by path."""
    rows = []
    for path, variable in sorted(result.items()):
        axes = " x ".join(f"{dim} {size}" for dim, size in zip(variable.dims, variable.shape, strict=True))
        dtype = variable.dtype
        kind = "table" if dtype.names else "text" if dtype.kind == "O" else dtype.name
        rows.append((path, kind, axes, variable.units))
    return rows
