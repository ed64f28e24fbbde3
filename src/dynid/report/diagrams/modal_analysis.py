"""Figures of a modal analysis: chart of poles, synthesis over the measured responses, shapes, MAC."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from dynid.arrays import ComplexArray
from dynid.report.content.modal_analysis import GROUP, modes_table
from dynid.report.diagrams.modes import SPAN, ShapeGrid, animate
from dynid.report.diagrams.responses import decibels, frequencies
from dynid.report.figure import CellValue, Figure, FigureTable, Picture, table_of
from dynid.report.notation import frequency_label, short, texts
from dynid.report.plot import (
    Bars,
    Chart,
    Curve,
    Layer,
    Markers,
    PlotAxis,
    ReferenceLine,
    Subplot,
    in_rows,
    matrix_chart,
    series_class,
)
from dynid.report.scenes import frequency_unit
from dynid.report.svg import Svg, path_of
from dynid.result import Result
from dynid.structure.correlation import mac

# Phases of a period that are drawn; between them lines move straight.
_STAGES = 12
# Most pairs of response and reference, and most shapes, that are drawn.
_MAX_PAIRS, _MAX_SHAPES = 12, 9


def figures(result: Result) -> Iterator[Figure]:
    """Yield the figures of a modal analysis."""
    if f"{GROUP}/fit/omega" in result:
        yield Figure("synthesis", "Measured responses and their synthesis", partial(_synthesis, result))
    yield Figure("stabilisation", "Poles of increasing orders", partial(_chart, result))
    yield Figure("modal-shapes", "Mode shapes at the sensors", partial(_shapes, result))
    if len(result[f"{GROUP}/channel"].data) > 1:
        yield Figure("modal-shapes-animated", "Mode shapes, animated", partial(_animated, result))
    yield Figure("modal-mac", "MAC of the modes among themselves", partial(_mac, result))


def _synthesis(result: Result) -> Chart:
    at = frequencies(result, f"{GROUP}/fit/omega")
    measured, synthesis = (result[f"{GROUP}/fit/{name}"].data for name in ("measured", "synthesis"))
    channels, references = (texts(result, f"{GROUP}/{name}") for name in ("channel", "reference"))
    pairs = [(o, i) for i in range(len(references)) for o in range(len(channels))]
    columns = dict(at.columns)
    subplots = []
    for o, i in pairs[:_MAX_PAIRS]:
        name = f"{channels[o]}/{references[i]}"
        layers: list[Layer] = [
            Curve(at.shown, decibels(measured[:, o, i]), "measured", "s7"),
            Curve(at.shown, decibels(synthesis[:, o, i]), "synthesis", "s2 fine dash"),
        ]
        subplots.append(Subplot(at.axis, PlotAxis("magnitude (dB)"), layers, name, height=150.0))
        columns |= {f"|{name}| measured": np.abs(measured[:, o, i]), f"|{name}|": np.abs(synthesis[:, o, i])}
    cut = f" The first {_MAX_PAIRS} of {len(pairs)} responses." if len(pairs) > _MAX_PAIRS else ""
    about = f"Responses of the modes and the residual terms over those measured, in SI units.{cut}"
    return Chart(in_rows(subplots, 1), about, table_of(columns), shared=True)


def _chart(result: Result) -> Chart:
    unit = frequency_unit(result)
    order, chain, pole = (result[f"{GROUP}/chart/{name}"].data for name in ("order", "chain", "pole"))
    frequency, damping = unit.factor * np.abs(pole), -pole.real / np.abs(pole)
    layers: list[Layer] = []
    for label, used, cls, symbol in (
        ("in no chain", chain < 0, "s4", "x"),
        ("in a chain", chain >= 0, "s1", "o"),
    ):
        tips = [
            f"order {n}: {short(float(f))} {unit.name}, ζ {short(100 * float(z), 3)} %"
            for n, f, z in zip(order[used], frequency[used], damping[used], strict=True)
        ]
        layers.append(Markers(frequency[used], order[used].astype(float), label, cls, symbol, 2.5, tips))
    for omega in result[f"{GROUP}/frequency"].data:
        layers.append(ReferenceLine(unit.factor * float(omega), "", "line dashed", upright=True))
    rows: list[tuple[CellValue, ...]] = [
        (int(n), float(f), float(z), int(c))
        for n, f, z, c in zip(order, frequency, damping, chain, strict=True)
    ]
    heads = ("order", frequency_label(unit), "damping ratio", "chain")
    plot = Subplot(PlotAxis(frequency_label(unit)), PlotAxis("order"), layers, height=260.0)
    about = "Stable poles of increasing order; dashed: the modes."
    if f"{GROUP}/harmonics" in result:
        layers += [
            ReferenceLine(unit.factor * float(omega), "harmonic", "line", upright=True)
            for omega in result[f"{GROUP}/harmonics"].data
        ]
    return Chart([[plot]], about, FigureTable(heads, tuple(rows)))


def _shapes(result: Result) -> Chart:
    shape, channels = result[f"{GROUP}/shape"].data, tuple(texts(result, f"{GROUP}/channel"))
    turned = _turned(shape)
    across, at = PlotAxis("", names=channels), np.arange(len(channels), dtype=float)
    unit, omega = frequency_unit(result), result[f"{GROUP}/frequency"].data
    subplots = []
    for k, row in enumerate(turned[:_MAX_SHAPES]):
        title = f"mode {k + 1}: {short(unit.factor * float(omega[k]))} {unit.name}"
        layers: list[Layer] = [
            Bars(at, np.zeros(len(at)), row.real, "real part", series_class(0)),
            Markers(at, row.imag, "imaginary part", series_class(1), "diamond", 3),
            ReferenceLine(0.0),
        ]
        subplots.append(Subplot(across, PlotAxis(""), layers, title, height=110.0))
    cut = f" The first {_MAX_SHAPES} of {len(shape)} modes." if len(shape) > _MAX_SHAPES else ""
    scale = result[f"{GROUP}/shape"].attrs["normalisation"]
    about = f"Shapes of {scale}, turned so that their real parts are largest.{cut}"
    table = modes_table(result)
    return Chart(in_rows(subplots, 3), about, FigureTable(table.columns, table.rows))


def _turned(shape: ComplexArray) -> ComplexArray:
    """Return shapes (rows) in the phase that makes their real parts largest, as of real modes."""
    return np.asarray(shape * np.exp(-0.5j * np.angle(np.sum(shape**2, axis=1)))[:, None])


def _animated(result: Result) -> Picture:
    """Draw a period of every mode, a line for each direction of the sensors, in the order of the channels."""
    shape, channels = _turned(result[f"{GROUP}/shape"].data), texts(result, f"{GROUP}/channel")
    directions: dict[str, list[int]] = {}
    for k, name in enumerate(channels):
        directions.setdefault(name.partition(":")[2].lstrip("+-"), []).append(k)
    nodes = list(dict.fromkeys(name.partition(":")[0] for name in channels))
    across = np.array([float(nodes.index(name.partition(":")[0])) for name in channels])
    svg = Svg("modal-shapes-animated", "Mode shapes, animated")
    grid = ShapeGrid(svg, np.column_stack([across, np.zeros(len(across))]), len(shape), 8.0, 44.0)
    stages = [f"{100 * k / _STAGES:g}% {{ d: var(--p{k % _STAGES}) }}" for k in range(_STAGES + 1)]
    animate(svg, grid.count, " ".join(stages), "linear infinite", 3.2)
    unit, omega = frequency_unit(result), result[f"{GROUP}/frequency"].data
    zeta = result[f"{GROUP}/damping"].data
    for mode, row in enumerate(shape[: grid.count]):
        heading = f"mode {mode + 1}: {short(unit.factor * float(omega[mode]))} {unit.name}"
        placed = grid.place(mode, f"{heading}, ζ {short(100 * float(zeta[mode]), 2)} %")
        reach = SPAN / grid.scale / (float(np.abs(row).max()) or 1.0)
        for series, rows in enumerate(directions.values()):
            rest = np.column_stack([across[rows], np.zeros(len(rows))])
            paths = [
                path_of(placed(rest + np.outer((row[rows] * turn).real, [0.0, reach])))
                for turn in np.exp(2j * np.pi * np.arange(_STAGES) / _STAGES)
            ]
            svg.element("path", "hair", d=path_of(placed(rest)))
            style = "; ".join(f"--p{k}: path('{path}')" for k, path in enumerate(paths))
            cls = f"{series_class(series)} {svg.name}-swing{mode}"
            svg.element("path", cls, d=paths[0], style=style, stroke_linecap="round")
    named = [name for name in directions if name]
    by = f" A line for each direction ({', '.join(named)})." if len(directions) > 1 else ""
    about = (
        f"One period of each mode at the sensors, in their order, slowly; still where the system requests "
        f"less motion, and in print. The thin line is the structure at rest.{by}{grid.cut}"
    )
    rows_of_table: list[tuple[CellValue, ...]] = [
        (name, *(float(part) for value in shape[: grid.count, k] for part in (value.real, value.imag)))
        for k, name in enumerate(channels)
    ]
    heads = [f"{part} {mode + 1}" for mode in range(grid.count) for part in ("real", "imaginary")]
    return Picture(grid.render(), about, FigureTable(("DOF", *heads), tuple(rows_of_table)))


def _mac(result: Result) -> Chart:
    shapes = result[f"{GROUP}/shape"].data.T
    names = [str(number) for number in result[f"{GROUP}/mode"].data]
    about = "1: two modes have one shape at the sensors, which then do not separate them."
    return matrix_chart([("", mac(shapes, shapes), names, names, ("mode", "mode"))], (0.0, 1.0), about)
