"""Content of benchmarks: a table each, with the Pareto-optimal alternatives highlighted."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from dynid.number_format import counted, memory_text, time_text
from dynid.report.content.blocks import ALL, Block, ReportSection, Statement, TextTable, on_page, on_screen
from dynid.report.notation import with_infinity
from dynid.result import Result, Scalar

_REMARKS = {
    "limits": "held to",
    "failed": "failed",
    "late": "left out for time (--full measures it)",
    "missing": "missing",
    "chosen": "chosen by default",
    "remark": "not shown",
}
#: Remarks that belong to the answer: without them the table cannot be read.
_NEEDED = ("error", *(_REMARKS[name] for name in ("failed", "late", "missing", "chosen")))
#: Most rows of which all are in the answer; of more, those that are Pareto-optimal or the default.
_FEW_ROWS = 8
_SIGNS = "● Pareto-optimal in time and error; › the suite's default"


def method(result: Result) -> str:
    """Return the kind of result and the meaning of its signs."""
    clock = "processor " * (result.group_attrs["bench"]["clock"] == "processor")
    return f"median {clock}times{' on '.join(['', *_machine_text(result)])}; {_SIGNS}"


def _machine_text(result: Result) -> list[str]:
    """Return the machine that measured; nothing in files of earlier versions."""
    about = str(result.group_attrs.get("bench", {}).get("machine", ""))
    return [about] if about else []


def sections(result: Result) -> Iterator[ReportSection]:
    """Yield a section for each benchmark."""
    for group in dict.fromkeys("/".join(path.split("/")[:2]) for path in result if path.startswith("bench/")):
        about, name = result.group_attrs[group], group.partition("/")[2]
        rows = [row for name in _alternatives(result, group) for row in benchmark_rows(result, group, name)]
        rows.sort(key=lambda row: row.size)
        first = ([row for row in rows if row.marks] or rows) if len(rows) > _FEW_ROWS else rows
        statements = {
            term: Statement(f"{term}: {with_infinity(text)}", "bad" if term == "failed" else "")
            for term, text in remarks(result, group)
        }
        needed: list[Block] = [statements.pop(term) for term in _NEEDED if term in statements]
        if len(first) < len(rows):
            others = counted(len(rows) - len(first), "other row")
            note = Statement(f"{others} in the details: neither Pareto-optimal nor the default")
            needed.insert(0, on_page(note))
        table = _table(about, rows)
        shown = (on_page(_table(about, first)), on_screen(table))
        yield ReportSection(name, (*shown, *needed), "answer", screen=name)
        if len(first) < len(rows):
            yield ReportSection(f"{name}: all alternatives", (table,))
        if statements:
            yield ReportSection(f"{name}: growth and peers", tuple(statements.values()), screen="")
    about = result.group_attrs.get("bench", {})  # absent in files of earlier versions
    seconds = float(about.get("seconds", 0))
    where = "".join(f" on {machine}" for machine in _machine_text(result))
    notes = [f"skipped: {about['skipped']}"] if about.get("skipped") else []
    notes += [f"measured in {time_text(seconds)}{where}"] if seconds else []
    if notes:
        yield ReportSection("Measurement", tuple(map(Statement, notes)), "", screen="")


def _table(about: Mapping[str, Scalar], measurements: list[BenchmarkRow]) -> TextTable:
    rows = []
    for row in measurements:
        costs = (time_text(row.time), memory_text(row.memory), _error_text(row.error))
        rows.append((row.name, f"{row.size:,}", *costs, row.marks))
    marked = frozenset(k for k, row in enumerate(measurements) if row.best)
    heads = ("", str(about["size"]), "time", "memory", "error", "")
    return TextTable(heads, tuple(rows), marked, str(about["title"]), brief=ALL, most=ALL)


def _error_text(error: float) -> str:
    """Return an error with two digits; infinite ones are wrong results."""
    if math.isnan(error):
        return "-"
    return "∞" if math.isinf(error) else f"{error:.1e}" if error else "0"


class BenchmarkRow(NamedTuple):
    """Measurements of an alternative at a size; `best`: Pareto-optimal, `default`: chosen by default."""

    size: int
    name: str
    time: float
    memory: float
    error: float
    best: bool
    default: bool

    @property
    def marks(self) -> str:
        """The signs of `default` and `best`."""
        return "›" * self.default + "●" * self.best


def _alternatives(result: Result, group: str) -> list[str]:
    return list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))


def benchmark_rows(result: Result, group: str, name: str) -> Iterator[BenchmarkRow]:
    """Yield the rows of an alternative."""
    names = ("size", "time", "memory", "error", "pareto", "default")
    columns = [result[f"{group}/{name}/{column}"].data for column in names]
    for size, time, memory, error, best, default in zip(*columns, strict=True):
        costs = (float(time), float(memory), float(error))
        yield BenchmarkRow(int(size), name, *costs, bool(best), bool(default))


def better_peers(result: Result, group: str) -> str:
    """Return the peers that are faster and more accurate than the default, with the sizes; or `none`."""
    names = sorted(_alternatives(result, group))
    peers = [name for name in names if result.group_attrs[f"{group}/{name}"].get("peer")]
    none = f"none of {', '.join(peers)}" if peers else "none; no peer took part"
    return str(result.group_attrs[group]["beaten"] or none)


def remarks(result: Result, group: str) -> Iterator[tuple[str, str]]:
    """Yield the remarks on a benchmark: a term and its text."""
    about = result.group_attrs[group]
    yield "error", str(about["measure"])
    attributes = {name: result.group_attrs[f"{group}/{name}"] for name in _alternatives(result, group)}
    powers = [f"{name} {attrs['exponent']:.2f}" for name, attrs in attributes.items() if "exponent" in attrs]
    if powers:
        yield f"time grows with {about['size']} to the power of", ", ".join(powers)
    if "beaten" in about:
        yield "peers faster and more accurate than the default", better_peers(result, group)
    for key, term in _REMARKS.items():
        if about.get(key):
            yield term, str(about[key])


def alternative_sections(result: Result) -> Iterator[ReportSection]:
    """Yield the alternatives of every choice of method in a scene, with their times and errors."""
    about = result.group_attrs.get("accuracy")
    if about is None:
        return
    aspects = list(dict.fromkeys(path.split("/")[1] for path in result if path.startswith("accuracy/")))
    effort = f"median of {about['repeats']}, at most {about['budget']:g} s in all"
    heading = f"alternatives to the choices made: {effort}"
    for aspect in aspects:
        group = f"accuracy/{aspect}"
        attrs = result.group_attrs[group]
        reference = f", against {attrs['reference']}" if attrs.get("reference") else ""
        rows = list(_alternative_rows(result, group))
        marked = frozenset(k for k, row in enumerate(rows) if row[-1].startswith(_CHOSEN))
        heads = ("", str(attrs["size"]), "time", "memory", "error", "error/bound", "")
        blocks = (
            Statement(f"{attrs['title']}: {attrs['because']}"),
            TextTable(heads, tuple(rows), marked, brief=ALL, most=ALL),
            Statement(f"error: {attrs['measure']}{reference}; median of {about['repeats']}"),
        )
        title = f"Alternatives: {aspect.replace('_', ' ')}"
        yield ReportSection(title, blocks, screen=heading if aspect == aspects[0] else "")


#: How the row of the choice is marked.
_CHOSEN = "→ chosen"


def _alternative_rows(result: Result, group: str) -> Iterator[tuple[str, ...]]:
    """Yield name, size, time, memory, error, its ratio to the bound, and the marks of every measurement."""

    def entry(path: str, k: int) -> float:
        return float(result[path].data[k]) if path in result else math.nan

    def number(value: float, form: str) -> str:
        return format(value, form) if math.isfinite(value) else "-"

    names = [str(name) for name in result[f"{group}/alternative"].data]
    for name, status in zip(names, result[f"{group}/status"].data, strict=True):
        base = f"{group}/{name}"
        for k in range(len(result[f"{base}/size"].data) if f"{base}/size" in result else 0):
            size, time, memory, error, bound = (
                entry(f"{base}/{key}", k) for key in ("size", "time", "memory", "error", "bound")
            )
            marks = [_CHOSEN] if entry(f"{base}/chosen", k) else []
            marks += ["Pareto-optimal"] if entry(f"{base}/pareto", k) else []
            costs = (f"{int(size):,}", time_text(time), memory_text(memory))
            ratio = error / bound if bound > 0 else math.nan
            yield name, *costs, number(error, ".1e"), number(ratio, ".2g"), ", ".join(marks)
        if status != "done":
            yield name, "", "", "", "", "", str(status)
