"""Work–precision diagrams of benchmarks and of the alternatives of a run: time, error and size."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

import numpy as np

from dynid.report.figure import CellValue, Figure, FigureTable
from dynid.report.notation import short, with_infinity
from dynid.report.plot import Chart, Curve, Layer, Markers, PlotAxis, Subplot, series_class
from dynid.result import Result, Variable

#: Least error that is drawn: zero has no place on a logarithmic axis.
_LEAST = 1e-17
#: Symbols of the alternatives; none is that of a mark.
_SYMBOLS = ("o", "square", "diamond", "x", "+", "up", "down")
_COLUMNS = ("size", "time", "memory", "error", "pareto")
#: Marked points: name of the array, label, symbol, its size and class. In benchmarks the default of the suite
#: is marked, in runs the choice.
_MARKED = (
    ("pareto", "Pareto-optimal in time and error", "ring", 8, "hair"),
    ("default", "default of the suite", "kite", 11, "line"),
    ("chosen", "chosen", "kite", 11, "line"),
)

Alternatives = Mapping[str, Mapping[str, Variable]]


def figures(result: Result) -> Iterator[Figure]:
    """Yield the diagrams of every benchmark or choice."""
    for group in dict.fromkeys(
        "/".join(path.split("/")[:2]) for path in result if path.startswith(("bench/", "accuracy/"))
    ):
        names = dict.fromkeys(
            path.split("/")[2] for path in result if path.startswith(f"{group}/") and path.endswith("/time")
        )
        alternatives = {}
        for name in names:
            paths = {column: f"{group}/{name}/{column}" for column in (*_COLUMNS, "default", "chosen")}
            alternatives[name] = {column: result[path] for column, path in paths.items() if path in result}
        name, title = group.replace("/", "-"), group.partition("/")[2]
        if any("error" in columns for columns in alternatives.values()):
            draw = partial(_over_error, result, group, alternatives)
            yield Figure(f"{name}-precision", f"{title}: time against error", draw)
        if any(len(set(columns["size"].data.tolist())) > 1 for columns in alternatives.values()):
            draw = partial(_over_size, result, group, alternatives)
            yield Figure(f"{name}-growth", f"{title}: time over size", draw)


def _over_error(result: Result, group: str, alternatives: Alternatives) -> Chart:
    layers: list[Layer] = []
    marked: dict[str, list[tuple[float, float]]] = {}
    absent = []
    for index, (label, columns) in enumerate(alternatives.items()):
        if "error" not in columns:
            continue
        error, time = columns["error"].data, columns["time"].data
        shown = np.isfinite(error)
        if not shown.all():
            absent.append(label)
        if not shown.any():
            continue
        x, y = np.maximum(error[shown], _LEAST), time[shown]
        tips = [
            f"{label}, {size:,}: {short(t, 3)} s, error {short(e, 2)}"
            for size, t, e in zip(columns["size"].data[shown].tolist(), y, error[shown], strict=True)
        ]
        layers += [
            Curve(x, y, "", f"{series_class(index)} fine", name=label),
            Markers(x, y, label, series_class(index), _SYMBOLS[index % len(_SYMBOLS)], 4, tips),
        ]
        for column in columns.keys() & {mark[0] for mark in _MARKED}:
            which = columns[column].data[shown].astype(bool)
            marked.setdefault(column, []).extend(zip(x[which].tolist(), y[which].tolist(), strict=True))
    for column, words, symbol, size, cls in _MARKED:
        if marked.get(column):
            xs, ys = zip(*marked[column], strict=True)
            layers.append(Markers(xs, ys, words, cls, symbol, size))
    measure = with_infinity(str(result.group_attrs.get(group, {}).get("measure", "error")))
    about = f"{measure[:1].upper()}{measure[1:]}" if measure.startswith("error") else f"Error: {measure}"
    about += ". Errors of zero are drawn at 10⁻¹⁷"
    about += f"; infinite ones of {', '.join(absent)} are only in the table." if absent else "."
    return _chart(result, group, alternatives, PlotAxis("error", log=True), layers, about)


def _over_size(result: Result, group: str, alternatives: Alternatives) -> Chart:
    layers: list[Layer] = []
    for index, (own, columns) in enumerate(alternatives.items()):
        size, time = columns["size"].data, columns["time"].data
        power = result.group_attrs.get(f"{group}/{own}", {}).get("exponent")
        label = own if power is None else f"{own}, power {float(power):.2f}"
        layers += [
            Curve(size, time, "", f"{series_class(index)} fine", name=own),
            Markers(size, time, label, series_class(index), _SYMBOLS[index % len(_SYMBOLS)], 4),
        ]
    across = PlotAxis(str(result.group_attrs.get(group, {}).get("size", "size")), log=True)
    about = "The legend has the power of the size with which time grows."
    return _chart(result, group, alternatives, across, layers, about)


def _chart(
    result: Result,
    group: str,
    alternatives: Alternatives,
    across: PlotAxis,
    layers: list[Layer],
    remark: str,
) -> Chart:
    """Return time over a quantity, with all measurements as a table."""
    attrs = result.group_attrs.get(group, {})
    about = f"{attrs.get('title', group)}."
    for key, text in (("failed", "Failed"), ("missing", "Missing"), ("chosen", "Chosen by default")):
        about += f" {text}: {attrs[key]}." if attrs.get(key) else ""
    about = f"{about} {remark}"
    plot = Subplot(across, PlotAxis("time (s)", log=True), layers, height=320.0)
    rows: list[tuple[CellValue, ...]] = []
    for label, columns in alternatives.items():
        blank = [""] * len(columns["size"].data)
        data = [columns[column].data.tolist() if column in columns else blank for column in _COLUMNS]
        rows += [(label, *row) for row in zip(*data, strict=True)]
    size, measure = str(attrs.get("size", "size")), str(attrs.get("measure", "error"))
    heads = ("alternative", size, "time (s)", "memory (B)", measure, "Pareto-optimal")
    return Chart([[plot]], about, FigureTable(heads, tuple(rows)))
