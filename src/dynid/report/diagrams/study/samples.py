"""All samples at once: parallel coordinates, a scatter matrix, distributions, a map over two parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.report.diagrams.study.columns import Number, StudyNumbers
from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.plot import Axis, Bars, Cells, Line, Marks, Panel, Rule, chart, listed, thinned
from dynid.report.plot.layers import Layer
from dynid.report.plot.parallel import parallel
from dynid.study.analysis.correlation import correlations, scatter
from dynid.study.analysis.moments import NAMES, statistics

if TYPE_CHECKING:
    from dynid.result import Result

#: Samples drawn one by one: as lines, and as points of a scatter diagram; beyond, cells are counted.
LINES, POINTS, BINS = 400, 400, 24
_AXES, _MATRIX, _MAPS, _HISTOGRAMS = 9, 6, 6, 12


def figures(result: Result) -> Iterator[Figure]:
    """Yield the figures of all samples."""
    numbers = StudyNumbers(result)
    if not numbers.table.done.any():
        return
    inputs, outputs = numbers.inputs, numbers.outputs
    if outputs:
        yield Figure("distributions", "What the samples gave", partial(_distributions, outputs))
    if inputs and outputs:
        chosen = _chosen(inputs, outputs, _AXES)
        yield Figure("parallel", "Samples as lines", partial(_parallel, chosen))
        yield Figure("scatter", "Scatter matrix", partial(_scatter, _chosen(inputs, outputs, _MATRIX)))
    grid = _grid(inputs)
    if grid is not None and outputs:
        yield Figure("map", "Results over two parameters", partial(_maps, inputs, outputs, grid))
    if len(inputs) == 1 and outputs and len(np.unique(inputs[0].values)) > 2:
        yield Figure("course", f"Results over {inputs[0].name}", partial(_course, inputs[0], outputs))


def _chosen(inputs: Sequence[Number], outputs: Sequence[Number], most: int) -> list[Number]:
    """Return inputs first, then as many results as have room."""
    first = (
        list(inputs[: max(1, most // 2)])
        if len(outputs) >= most // 2
        else list(inputs[: most - len(outputs)])
    )
    return first + list(outputs[: most - len(first)])


def _said(count: int, drawn: int, what: str = "samples") -> str:
    return f" {drawn} of {count:,} {what} are drawn, evenly chosen." if drawn < count else ""


def _complete(numbers: Sequence[Number]) -> np.ndarray:
    return np.flatnonzero(np.all([np.isfinite(number.values) for number in numbers], axis=0))


def _parallel(numbers: Sequence[Number]) -> Picture:
    known = _complete(numbers)
    rows = known[thinned(len(known), LINES)]
    about = (
        "A line is a sample; its colour goes from blue over green to orange with the last axis."
        f"{_said(len(known), len(rows))}"
    )
    values = np.array([number.values[rows] for number in numbers]).T
    svg = parallel("parallel", "Samples as lines", [number.label for number in numbers], values, about)
    table = listed({"sample": rows} | {number.label: number.values[rows] for number in numbers})
    return Picture(svg, about, table)


def _scatter(numbers: Sequence[Number]) -> Picture:
    size = max(105.0, 640.0 / len(numbers))
    found = _ranked(numbers)
    rows = []
    for i, down in enumerate(numbers):
        row = []
        for j, across in enumerate(numbers):
            x_axis = Axis(across.label if i == len(numbers) - 1 else "")
            y_axis = Axis(down.label if j == 0 else "")
            if j > i:
                row.append(_related(float(found[i, j]), size))
            elif i == j:
                row.append(Panel(x_axis, y_axis, _histogram(down), height=size))
            else:
                row.append(Panel(x_axis, y_axis, _cloud(across.values, down.values), height=size))
        rows.append(row)
    count = len(_complete(numbers))
    binned = (
        " Points lie too densely to be drawn: the more opaque a cell, the more samples in it."
        if count > POINTS
        else ""
    )
    about = f"Each number over each other, rank correlations above the diagonal; {count:,} samples.{binned}"
    svg = chart("scatter", "Scatter matrix", rows, about, width=max(760.0, 160.0 * len(numbers)))
    cells: tuple[tuple[Cell, ...], ...] = tuple(
        (number.label, *map(float, found[k])) for k, number in enumerate(numbers)
    )
    return Picture(svg, about, Table(("rank correlation", *(n.label for n in numbers)), cells))


def _ranked(numbers: Sequence[Number]) -> np.ndarray:
    """Return the rank correlation of each pair."""
    found = np.eye(len(numbers))
    for i, one in enumerate(numbers):
        for j, other in enumerate(numbers[:i]):
            found[i, j] = found[j, i] = correlations([one.values], [other.values], ranks=True)[0, 0]
    return found


def _related(value: float, size: float) -> Panel:
    """Return the panel that says a rank correlation."""
    text = f"{value:.2f}".replace("-", "−") if np.isfinite(value) else ""
    bare = Axis("", names=("",))
    return Panel(bare, bare, [Cells(np.array([[value]]), -1.0, 1.0, [[text]])], height=size)


def _cloud(x: np.ndarray, y: np.ndarray) -> list[Layer]:
    x, y = scatter(x, y, most=10**9)
    if len(x) <= POINTS:
        return [Marks(x, y, "", "s1", "o", 1.6)]
    counts, across, up = np.histogram2d(x, y, bins=BINS)
    filled = np.where(counts > 0, np.sqrt(counts), np.nan).T
    return [Cells(filled, 0.0, float(np.nanmax(filled)), edges=(across, up))]


def _counted(values: NDArray[np.float64], most: int) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return how many values are in each of some bins, and their edges; also of values that hardly differ."""
    low, high = float(values.min()), float(values.max())
    size = max(abs(low), abs(high))
    if not high - low > 1e-12 * size:
        low, high = low - (1e-3 * size or 0.5), high + (1e-3 * size or 0.5)
    return np.histogram(values, bins=int(np.clip(np.sqrt(len(values)), 5, most)), range=(low, high))


def _histogram(number: Number) -> list[Layer]:
    values = number.values[np.isfinite(number.values)]
    counts, edges = _counted(values, 40)
    middles = (edges[1:] + edges[:-1]) / 2
    # In a scatter matrix the upright axis is that of the number: bars are scaled onto it.
    low, high = float(values.min()), float(values.max())
    tops = low + (high - low) * counts / counts.max()
    return [Bars(middles, np.full(len(counts), low), tops, "", "s1", float(edges[1] - edges[0]) * 0.9)]


def _distributions(outputs: Sequence[Number]) -> Picture:
    shown = outputs[:_HISTOGRAMS]
    panels = [
        Panel(Axis(number.label), Axis("samples", step=1, low=0), _with_quantiles(number), height=120.0)
        for number in shown
    ]
    left = f" {len(shown)} of {len(outputs)} numbers; the table has all." if len(shown) < len(outputs) else ""
    about = f"Histograms with median and 5 % and 95 % quantiles.{left}"
    grid = [panels[start : start + 3] for start in range(0, len(panels), 3)]
    width = 900.0 if len(panels) > 1 else 480.0
    svg = chart("distributions", "What the samples gave", grid, about, width=width)
    rows: list[tuple[Cell, ...]] = []
    for number in outputs:
        found = statistics(number.values)
        rows.append((number.label, *(found[name].item() for name in NAMES)))
    return Picture(svg, about, Table(("number", *NAMES), tuple(rows)))


def _with_quantiles(number: Number) -> list[Layer]:
    values = number.values[np.isfinite(number.values)]
    found = statistics(values)
    counts, edges = _counted(values, 60)
    middles, thick = (edges[1:] + edges[:-1]) / 2, float(edges[1] - edges[0]) * 0.92
    tips = [f"{short(a)} … {short(b)}: {c}" for a, b, c in zip(edges, edges[1:], counts, strict=False)]
    return [
        Bars(middles, np.zeros(len(counts)), counts, "samples", "s1", thick, False, tips),
        Rule(float(found["median"]), "median", "s2", upright=True),
        Rule(float(found["p05"]), "5 % and 95 %", "s3 dashed", upright=True),
        Rule(float(found["p95"]), "", "s3 dashed", upright=True),
    ]


def _grid(inputs: Sequence[Number]) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the levels of two inputs whose every pair is a sample."""
    if len(inputs) != 2:
        return None
    x, y = (np.unique(number.values) for number in inputs)
    count = len(inputs[0].values)
    if len(x) < 2 or len(y) < 2 or len(x) * len(y) != count or count > 40_000:
        return None
    pairs = np.unique(np.column_stack([n.values for n in inputs]), axis=0)
    return (x, y) if len(pairs) == count else None


def _maps(
    inputs: Sequence[Number], outputs: Sequence[Number], grid: tuple[np.ndarray, np.ndarray]
) -> Picture:
    x, y = grid
    columns, rows = np.searchsorted(x, inputs[0].values), np.searchsorted(y, inputs[1].values)
    across, up = (
        Axis(n.label, log=_even(np.log(v)) if (v > 0).all() and not _even(v) else False)
        for n, v in zip(inputs, grid, strict=True)
    )
    panels = []
    for number in outputs[:_MAPS]:
        values = np.full((len(y), len(x)), np.nan)
        values[rows, columns] = number.values
        stride = max(1, -(-max(values.shape) // 60))  # 60 × 60 cells are what can be told apart
        a, b, part = x[::stride], y[::stride], values[::stride, ::stride]
        said = f"{number.label}: {short(float(np.nanmin(part)), 3)} … {short(float(np.nanmax(part)), 3)}"
        tips = [[f"{inputs[0].name} {short(p)}, {inputs[1].name} {short(q)}" for p in a] for q in b]
        cells = _shaded(part, tips, (_edges(a, across.log), _edges(b, up.log)))
        panels.append(Panel(across, up, [cells], said, height=260.0))
    wide = 1 if len(panels) == 1 else 2
    cut = f" {len(panels)} of {len(outputs)} numbers." if len(panels) < len(outputs) else ""
    about = f"The more opaque, the larger; the ends of each scale stand over it.{cut}"
    rows_of = [panels[k : k + wide] for k in range(0, len(panels), wide)]
    svg = chart("map", "Results over two parameters", rows_of, about, width=560.0 if wide == 1 else 1000.0)
    return Picture(svg, about, listed({n.label: n.values for n in [*inputs, *outputs[:_MAPS]]}))


def _shaded(
    values: np.ndarray, where: Sequence[Sequence[str]], edges: tuple[np.ndarray, np.ndarray]
) -> Cells:
    """Return cells as opaque as their values are large, which stand in them where there are few."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    tips = [
        [f"{place}: {short(float(value))}" for place, value in zip(places, line, strict=True)]
        for places, line in zip(where, values, strict=True)
    ]
    texts = [[short(float(value), 2) for value in line] for line in values] if values.size <= 120 else ()
    return Cells(values, low - 0.05 * (high - low), high, texts, tips, edges)


def _even(values: np.ndarray) -> bool:
    steps = np.diff(values)
    return bool(np.ptp(steps) <= 1e-6 * np.abs(steps).max())


def _edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Return the borders halfway between levels."""
    at = np.log(values) if log else values
    middles = (at[1:] + at[:-1]) / 2
    edges = np.concatenate([[2 * at[0] - middles[0]], middles, [2 * at[-1] - middles[-1]]])
    return np.exp(edges) if log else edges


def _course(own: Number, outputs: Sequence[Number]) -> Picture:
    order = np.argsort(own.values, kind="stable")
    x = own.values[order]
    repeated = len(np.unique(x)) < len(x)
    log = bool((x > 0).all()) and not _even(np.unique(x)) and _even(np.log(np.unique(x)))
    panels = []
    for number in outputs[:_HISTOGRAMS]:
        y = number.values[order]
        positive = y[np.isfinite(y)]
        wide = bool((positive > 0).all() and positive.max() > 100 * positive.min())
        layers: list[Layer] = [] if repeated or own.path.endswith("seed") else [Line(x, y, "", "s1")]
        if len(x) <= POINTS:
            layers.append(Marks(x, y, "", "s1", "o", 2.2))
        panels.append(Panel(Axis(own.label, log=log), Axis(number.label, log=wide), layers, height=150.0))
    about = f"Each number over {own.path}, the only thing that varied."
    grid = [panels[start : start + 2] for start in range(0, len(panels), 2)]
    svg = chart("course", f"Results over {own.name}", grid, about, width=760.0, shared=True)
    return Picture(
        svg, about, listed({own.label: x} | {n.label: n.values[order] for n in outputs[:_HISTOGRAMS]})
    )
