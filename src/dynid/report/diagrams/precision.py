"""Work–precision diagrams of benchmarks, and of a run's alternatives: time, error, growth with size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.plot import Axis, Line, Marks, Panel, chart
from dynid.report.plot.layers import Layer, hue

if TYPE_CHECKING:
    from dynid.result import Result, Variable

#: Errors below this are drawn here: zero has no place on a logarithmic axis.
LEAST = 1e-17
_SYMBOLS = ("o", "square", "diamond", "x", "+", "ring", "kite")
_COLUMNS = ("size", "time", "memory", "error", "pareto")
#: What sets points apart: the array that says so, in words, as symbol, its size and class. Of benchmarks the
#: suite's default is marked, of a run what was chosen.
_MARKED = (
    ("pareto", "nothing beats it in time and error", "ring", 8, "hair"),
    ("default", "what the suite takes by default", "kite", 11, "line"),
    ("chosen", "what was chosen", "kite", 11, "line"),
)


def figures(result: Result) -> Iterator[Figure]:
    """Yield for each benchmark time against error, and time over size."""
    for group in dict.fromkeys(
        "/".join(path.split("/")[:2]) for path in result if path.startswith(("bench/", "accuracy/"))
    ):
        found = _alternatives(result, group)
        name = group.replace("/", "-")
        title = group.partition("/")[2]
        if any("error" in columns for columns in found.values()):
            draw = partial(_precision, result, group, f"{name}-precision", found)
            yield Figure(f"{name}-precision", f"{title}: time against error", draw)
        if any(len(set(columns["size"].data.tolist())) > 1 for columns in found.values()):
            draw = partial(_growth, result, group, f"{name}-growth", found)
            yield Figure(f"{name}-growth", f"{title}: time over size", draw)


Alternatives = Mapping[str, Mapping[str, "Variable"]]


def _alternatives(result: Result, group: str) -> dict[str, dict[str, Variable]]:
    names = dict.fromkeys(
        path.split("/")[2] for path in result if path.startswith(f"{group}/") and path.endswith("/time")
    )
    return {
        name: {
            column: result[f"{group}/{name}/{column}"]
            for column in (*_COLUMNS, "default", "chosen")
            if f"{group}/{name}/{column}" in result
        }
        for name in names
    }


def _about(result: Result, group: str) -> str:
    said = result.group_attrs.get(group, {})
    words = {"failed": "failed", "missing": "missing", "chosen": "chosen by default"}
    notes = "".join(
        f" {text[0].upper()}{text[1:]}: {said[key]}." for key, text in words.items() if said.get(key)
    )
    return f"{said.get('title', group)}.{notes}"


def _precision(result: Result, group: str, name: str, found: Alternatives) -> Picture:
    layers: list[Layer] = []
    marked: dict[str, list[tuple[float, float]]] = {}
    for place, (own, columns) in enumerate(found.items()):
        if "error" not in columns:
            continue
        error, time = columns["error"].data, columns["time"].data
        shown = np.isfinite(error)
        x, y = np.maximum(error[shown], LEAST), time[shown]
        tips = [
            f"{own}, {size:,}: {short(t, 3)} s, error {short(e, 2)}"
            for size, t, e in zip(columns["size"].data[shown].tolist(), y, error[shown], strict=True)
        ]
        layers += [
            Line(x, y, "", f"{hue(place)} fine"),
            Marks(x, y, own, hue(place), _SYMBOLS[place % len(_SYMBOLS)], 4, tips),
        ]
        for column in columns.keys() & {each[0] for each in _MARKED}:
            which = columns[column].data[shown].astype(bool)
            marked.setdefault(column, []).extend(zip(x[which].tolist(), y[which].tolist(), strict=True))
    for column, words, symbol, size, cls in _MARKED:
        if marked.get(column):
            xs, ys = zip(*marked[column], strict=True)
            layers.append(Marks(xs, ys, words, cls, symbol, size))
    measure = str(result.group_attrs.get(group, {}).get("measure", "error"))
    panel = Panel(Axis(_capped(measure), log=True), Axis("time (s)", log=True), layers, height=320.0)
    title = f"{group.partition('/')[2]}: time against error"
    about = (
        f"{_about(result, group)} Errors of zero are drawn at 10⁻¹⁷; infinite ones stand in the table alone."
    )
    return Picture(chart(name, title, [[panel]], about), about, _table(result, group, found))


def _capped(measure: str, most: int = 90) -> str:
    text = measure if measure.startswith("error") else f"error: {measure}"
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _growth(result: Result, group: str, name: str, found: Alternatives) -> Picture:
    layers: list[Layer] = []
    for place, (own, columns) in enumerate(found.items()):
        size, time = columns["size"].data, columns["time"].data
        power = result.group_attrs.get(f"{group}/{own}", {}).get("exponent")
        label = own if power is None else f"{own}, power {float(power):.2f}"
        layers += [
            Line(size, time, "", f"{hue(place)} fine"),
            Marks(size, time, label, hue(place), _SYMBOLS[place % len(_SYMBOLS)], 4),
        ]
    what = str(result.group_attrs.get(group, {}).get("size", "size"))
    panel = Panel(Axis(what, log=True), Axis("time (s)", log=True), layers, height=320.0)
    title = f"{group.partition('/')[2]}: time over size"
    about = f"{_about(result, group)} In the legend: the power of the size with which time grows."
    return Picture(chart(name, title, [[panel]], about), about, _table(result, group, found))


def _table(result: Result, group: str, found: Alternatives) -> Table:
    about = result.group_attrs.get(group, {})
    rows: list[tuple[Cell, ...]] = []
    for own, columns in found.items():
        count = len(columns["size"].data)
        blank = [""] * count
        data = [columns[column].data.tolist() if column in columns else blank for column in _COLUMNS]
        rows += [(own, *row) for row in zip(*data, strict=True)]
    names = (
        "alternative",
        str(about.get("size", "size")),
        "time (s)",
        "memory (B)",
        str(about.get("measure", "error")),
        "unbeaten",
    )
    return Table(names, tuple(rows))
