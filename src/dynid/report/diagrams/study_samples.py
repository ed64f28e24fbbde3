"""All samples of a study: distributions, parallel coordinates, scatter matrix, results over parameters.

However many samples there are, a figure stays small: samples are drawn at even spacing, or counted in bins.
Statistics, correlations and indices are those of all samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property, partial
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.number_format import counted
from dynid.report.figure import CellValue, Figure, FigureTable, Picture, evenly_spaced, table_of
from dynid.report.notation import labelled, short
from dynid.report.plot import (
    Bars,
    Chart,
    Curve,
    Heatmap,
    Layer,
    Markers,
    PlotAxis,
    ReferenceLine,
    Subplot,
    in_rows,
    parallel_coordinates,
)
from dynid.result import Result
from dynid.study.analysis.design import is_logarithmic
from dynid.study.analysis.influence import correlations, scatter
from dynid.study.analysis.sample_statistics import NAMES, statistics
from dynid.study.analysis.table import StudyTable
from dynid.suggestions import short_paths

#: Most entries of an array that are shown one by one, greatest size of an array with entries shown, and most
#: numbers in all.
ENTRIES, LONGEST, COLUMNS = 8, 64, 24
#: Most samples drawn as lines, and as points of a scatter plot (beyond, they are counted in so many bins).
LINES, POINTS, BINS = 400, 400, 24
#: Most axes, rows of the scatter matrix, maps and histograms; most cells of a map along an axis.
_AXES, _MATRIX, _MAPS, _HISTOGRAMS, _CELLS = 9, 6, 6, 12, 60
#: Relative differences that are round-off.
_ROUNDING = 1e-12


class StudyVariable(NamedTuple):
    """A number of each sample: its short name, its full name, its units, values, and logarithmic spacing."""

    name: str
    path: str
    units: str
    values: Array
    log: bool = False

    @property
    def label(self) -> str:
        """Its name with units."""
        return labelled(self.name, self.units)

    @property
    def known(self) -> NDArray[np.bool_]:
        """The samples that have it."""
        return np.isfinite(self.values)

    def axis(self, label: str) -> PlotAxis:
        """Return its axis: logarithmic where it is spaced by its logarithm, with whole ticks for counts."""
        integral = bool((self.values[self.known] == np.round(self.values[self.known])).all())
        return PlotAxis(label, log=self.log, step=float(integral))


class StudyNumbers:
    """The numbers of a study that figures show."""

    def __init__(self, result: Result) -> None:
        self.table = StudyTable(result)

    @cached_property
    def inputs(self) -> list[StudyVariable]:
        """Inputs that are numbers and vary, in the order of their names."""
        varied = {
            name: column.astype(float)
            for name, column in self.table.inputs.items()
            if column.dtype.kind in "bif" and len(column) and (column != column[0]).any()
        }
        names = dict(zip(varied, short_paths(list(varied)), strict=True))
        return [
            StudyVariable(names[path], path, "", values, is_logarithmic(values))
            for path, values in varied.items()
        ]

    @cached_property
    def outputs(self) -> list[StudyVariable]:
        """Results that are numbers and vary, named by the shortest distinct ends of their paths.

        Magnitudes that repeat the column before, such as those of a conjugate pair, are omitted.
        """
        variables: list[StudyVariable] = []
        magnitudes = set()
        for path in sorted(filter(self.table.is_number, self.table.paths)):
            if self.table.size(path) > LONGEST or len(variables) >= COLUMNS:
                continue
            for column in islice(self.table.columns(path), ENTRIES):
                finite = column.values[np.isfinite(column.values)]
                if finite.size > 1 and np.ptp(finite) > _ROUNDING * np.abs(finite).max():
                    size = self.table.variable(path).dtype.kind == "c"
                    if (
                        size
                        and variables
                        and np.array_equal(variables[-1].values, column.values, equal_nan=True)
                    ):
                        continue  # of a conjugate pair, or the natural frequencies
                    variables.append(StudyVariable(column.name, column.name, column.units, column.values))
                    if size:
                        magnitudes.add(column.name)
        variables = variables[:COLUMNS]
        names = paths = [number.path for number in variables]
        for count in range(1, max((path.count("/") for path in paths), default=0) + 2):
            ends = ["/".join(path.split("/")[-count:]) for path in paths]
            if len(set(ends)) == len(ends):
                names = ends
                break
        return [
            number._replace(name=f"|{name}|" if number.path in magnitudes else name)
            for number, name in zip(variables, names, strict=True)
        ]


def figures(result: Result) -> Iterator[Figure]:
    """Yield the figures of all samples."""
    numbers = StudyNumbers(result)
    if not numbers.table.done.any():
        return
    inputs, outputs = numbers.inputs, numbers.outputs
    if not outputs:
        return
    yield Figure("distributions", "Distributions of the results", partial(_distributions, outputs))
    if inputs:
        yield Figure("parallel", "Samples as lines", partial(_parallel, inputs, outputs))
        yield Figure("scatter", "Scatter matrix", partial(_scatter, inputs, outputs))
    if len(inputs) == 2:
        count = len(inputs[0].values)
        x, y = (np.unique(number.values) for number in inputs)
        full = len(x) > 1 and len(y) > 1 and len(x) * len(y) == count and count <= 40_000
        if full and len(np.unique(np.column_stack([n.values for n in inputs]), axis=0)) == count:
            yield Figure("map", "Results over two parameters", partial(_maps, inputs, outputs, (x, y)))
    if len(inputs) == 1 and len(np.unique(inputs[0].values)) > 2:
        yield Figure("course", f"Results over {inputs[0].name}", partial(_course, inputs[0], outputs))


def _complete(numbers: Sequence[StudyVariable]) -> np.ndarray:
    """Return the indices of the samples with all numbers."""
    return np.flatnonzero(np.all([np.isfinite(number.values) for number in numbers], axis=0))


def _columns_of(
    inputs: Sequence[StudyVariable], outputs: Sequence[StudyVariable], limit: int
) -> tuple[list[StudyVariable], str]:
    """Return at most so many columns, inputs first, and in words what a figure of them omits."""
    room = max(1, limit // 2) if len(outputs) >= limit // 2 else limit - len(outputs)
    numbers = [*inputs[:room], *outputs][:limit]
    count = len(inputs) + len(outputs)
    return numbers, f" {len(numbers)} of {count} columns." if len(numbers) < count else ""


def _parallel(inputs: Sequence[StudyVariable], outputs: Sequence[StudyVariable]) -> Picture:
    done = np.any([number.known for number in outputs], axis=0)
    # A result that some samples lack would leave these samples without a line.
    best = max((number.known & done).sum() for number in outputs)
    complete = [number for number in outputs if (number.known & done).sum() == best]
    numbers, cut = _columns_of(inputs, complete, _AXES)
    if len(complete) < len(outputs):
        lacking = len(outputs) - len(complete)
        cut += f" {counted(lacking, 'result')} with missing values {'is' if lacking == 1 else 'are'} omitted."
    samples = _complete(numbers)
    rows = samples[evenly_spaced(len(samples), LINES)]
    if len(rows) < len(samples):
        cut = f" {len(rows)} of {len(samples):,} samples are drawn, evenly spaced.{cut}"
    elif len(samples) < len(done):
        cut = f" {len(samples)} of {len(done):,} samples are drawn, the others lack a value.{cut}"
    about = f"Each line is a sample; blue to green to orange: low to high values on the last axis.{cut}"
    values = np.array([number.values[rows] for number in numbers]).T
    axes = [number.axis(number.label) for number in numbers]
    svg = parallel_coordinates("parallel", "Samples as lines", axes, values, about)
    table = table_of({"sample": rows} | {number.label: number.values[rows] for number in numbers})
    return Picture(svg, about, table)


def _scatter(inputs: Sequence[StudyVariable], outputs: Sequence[StudyVariable]) -> Chart:
    numbers, cut = _columns_of(inputs, outputs, _MATRIX)
    size = max(105.0, 640.0 / len(numbers))
    ranks = np.eye(len(numbers))
    for i, across_number in enumerate(numbers):
        for j, down_number in enumerate(numbers[:i]):
            ranks[i, j] = ranks[j, i] = correlations(
                [across_number.values], [down_number.values], ranks=True
            )[0, 0]
    rows = []
    for i, down in enumerate(numbers):
        row = []
        for j, across in enumerate(numbers):
            x_axis = across.axis(across.label if i == len(numbers) - 1 else "")
            y_axis = down.axis(down.label if j == 0 else "")
            layers: list[Layer]
            if j > i:
                value = float(ranks[i, j])
                text = f"{value:.2f}".replace("-", "−") if np.isfinite(value) else ""
                x_axis = y_axis = PlotAxis("", names=("",))
                layers = [Heatmap(np.array([[value]]), -1.0, 1.0, [[text]])]
            elif i == j:
                layers = [_counts(down)]
            else:
                x, y = scatter(across.values, down.values, max_points=10**9)
                if len(x) <= POINTS:
                    layers = [Markers(x, y, "", "s1", "o", 1.6)]
                else:  # a two-dimensional histogram
                    edges = [
                        _histogram(across_number, BINS, log)[1]
                        for across_number, log in ((x, across.log), (y, down.log))
                    ]
                    cells, *bins = np.histogram2d(x, y, bins=edges)
                    filled = np.where(cells > 0, np.sqrt(cells), np.nan).T
                    layers = [Heatmap(filled, 0.0, float(np.nanmax(filled)), edges=(bins[0], bins[1]))]
            row.append(Subplot(x_axis, y_axis, layers, height=size))
        rows.append(row)
    count, complete = int(np.any([number.known for number in outputs], axis=0).sum()), len(_complete(numbers))
    if complete < count:
        cut = f" {complete:,} of them have all values.{cut}"
    binned = " The opacity of a cell is the number of samples in it." if count > POINTS else ""
    about = (
        f"Pairwise scatter plots, with the rank correlations above the diagonal; {count:,} samples."
        f"{cut}{binned}"
    )
    cells_of_table: list[tuple[CellValue, ...]] = [
        (number.label, *map(float, ranks[k])) for k, number in enumerate(numbers)
    ]
    table = FigureTable(("rank correlation", *(n.label for n in numbers)), tuple(cells_of_table))
    return Chart(rows, about, table, max(760.0, 160.0 * len(numbers)))


def _counts(number: StudyVariable) -> Bars:
    """Return the histogram of a number on two axes of this number, the upright one for the counts."""
    values = number.values[number.known]
    counts, edges = _histogram(values, 40, number.log)
    share, low, high = counts / counts.max(), float(values.min()), float(values.max())
    tops = low * (high / low) ** share if number.log else low + (high - low) * share
    middles, thick = (edges[1:] + edges[:-1]) / 2, 0.9 * np.diff(edges)
    return Bars(middles, np.full(len(counts), low), tops, "", "s1", thick)


def _histogram(values: Array, max_bins: int, log: bool = False) -> tuple[NDArray[np.intp], Array]:
    """Return the counts of values in at most so many bins, and the edges; also of nearly equal values."""
    if log:
        counts, edges = _histogram(np.log(values), max_bins)
        return counts, np.exp(edges)
    low, high = float(values.min()), float(values.max())
    size = max(abs(low), abs(high))
    if not high - low > 1e-12 * size:
        low, high = low - (1e-3 * size or 0.5), high + (1e-3 * size or 0.5)
    return np.histogram(values, bins=int(np.clip(np.sqrt(len(values)), 5, max_bins)), range=(low, high))


def _distributions(outputs: Sequence[StudyVariable]) -> Chart:
    subplots = []
    for number in outputs[:_HISTOGRAMS]:
        values = number.values[np.isfinite(number.values)]
        moments = statistics(values)
        counts, edges = _histogram(values, 60)
        middles, thick = (edges[1:] + edges[:-1]) / 2, float(edges[1] - edges[0]) * 0.92
        tips = [f"{short(a)} … {short(b)}: {c}" for a, b, c in zip(edges, edges[1:], counts, strict=False)]
        layers: list[Layer] = [
            Bars(middles, np.zeros(len(counts)), counts, "samples", "s1", thick, False, tips),
            ReferenceLine(float(moments["median"]), "median", "s2", upright=True),
            ReferenceLine(float(moments["p05"]), "5 % and 95 %", "s3 dashed", upright=True),
            ReferenceLine(float(moments["p95"]), "", "s3 dashed", upright=True),
        ]
        upright = PlotAxis("samples", step=1, low=0)
        subplots.append(Subplot(PlotAxis(number.label), upright, layers, height=120.0))
    left = ""
    if len(subplots) < len(outputs):
        left = f" {len(subplots)} of {len(outputs)} numbers; the table has all."
    about = f"Histograms with median and 5 % and 95 % quantiles.{left}"
    rows: list[tuple[CellValue, ...]] = []
    for number in outputs:
        moments = statistics(number.values)
        rows.append((number.label, *(moments[name].item() for name in NAMES)))
    width = 760.0 if len(subplots) > 1 else 480.0
    return Chart(in_rows(subplots), about, FigureTable(("number", *NAMES), tuple(rows)), width)


def _maps(
    inputs: Sequence[StudyVariable],
    outputs: Sequence[StudyVariable],
    grid: tuple[np.ndarray, np.ndarray],
) -> Chart:
    x, y = grid
    columns, rows = np.searchsorted(x, inputs[0].values), np.searchsorted(y, inputs[1].values)
    across, up = (PlotAxis(number.label, log=number.log) for number in inputs)
    subplots = []
    for number in outputs[:_MAPS]:
        values = np.full((len(y), len(x)), np.nan)
        values[rows, columns] = number.values
        stride = max(1, -(-max(values.shape) // _CELLS))
        a, b, shade = x[::stride], y[::stride], values[::stride, ::stride]
        low, high = float(np.nanmin(shade)), float(np.nanmax(shade))
        tips = [
            [
                f"{inputs[0].name} {short(p)}, {inputs[1].name} {short(q)}: {short(float(value))}"
                for p, value in zip(a, line, strict=True)
            ]
            for q, line in zip(b, shade, strict=True)
        ]
        # As many digits as tell neighbouring values apart.
        size, span = max(abs(low), abs(high)), high - low
        digits = int(np.clip(np.ceil(np.log10(size / span)) + 2 if span > 0 else 2, 2, 5))
        texts = (
            [[short(float(value), digits) for value in line] for line in shade] if shade.size <= 120 else ()
        )
        edges = (_edges(a, across.log), _edges(b, up.log))
        cells = Heatmap(shade, low - 0.05 * (high - low), high, texts, tips, edges)
        heading = f"{number.label}\n{short(low, max(3, digits))} … {short(high, max(3, digits))}"
        subplots.append(Subplot(across, up, [cells], heading, height=260.0))
    wide = 1 if len(subplots) == 1 else 2
    cut = f" {len(subplots)} of {len(outputs)} numbers." if len(subplots) < len(outputs) else ""
    about = f"Opaque cells have large values; the range is above each map.{cut}"
    table = table_of({number.label: number.values for number in [*inputs, *outputs[:_MAPS]]})
    return Chart(in_rows(subplots, wide), about, table, 560.0 if wide == 1 else 1000.0)


def _edges(values: np.ndarray, log: bool) -> np.ndarray:
    """Return the borders halfway between levels."""
    at = np.log(values) if log else values
    middles = (at[1:] + at[:-1]) / 2
    edges = np.concatenate([[2 * at[0] - middles[0]], middles, [2 * at[-1] - middles[-1]]])
    return np.exp(edges) if log else edges


def _course(parameter: StudyVariable, outputs: Sequence[StudyVariable]) -> Chart:
    order = np.argsort(parameter.values, kind="stable")
    x = parameter.values[order]
    levels = np.unique(x)
    joined = len(levels) == len(x) and not parameter.path.endswith("seed")
    subplots, columns = [], {parameter.label: x}
    for number in outputs[:_HISTOGRAMS]:
        y = columns[number.label] = number.values[order]
        finite = y[np.isfinite(y)]
        wide = bool((finite > 0).all() and finite.max() > 100 * finite.min())
        layers: list[Layer] = [Curve(x, y, "", "s1")] if joined else []
        if len(x) <= POINTS:
            layers.append(Markers(x, y, "", "s1", "o", 2.2))
        across, up = parameter.axis(parameter.label), PlotAxis(number.label, log=wide)
        subplots.append(Subplot(across, up, layers, height=150.0))
    about = f"Results over {parameter.path}, the only input that varies."
    return Chart(in_rows(subplots, 1), about, table_of(columns), shared=not across.names)
