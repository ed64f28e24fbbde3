"""Figures of a modal analysis: chart of poles, synthesis over the measured responses, shapes, MAC."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from dynid.report.content.modal_analysis import GROUP, modes_table
from dynid.report.diagrams.responses import decibels, frequencies
from dynid.report.figure import CellValue, Figure, FigureTable, table_of
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
from dynid.result import Result
from dynid.structure.correlation import mac

# Most pairs of response and reference, and most shapes, that are drawn.
_MAX_PAIRS, _MAX_SHAPES = 12, 9


def figures(result: Result) -> Iterator[Figure]:
    """Yield the figures of a modal analysis."""
    yield Figure("synthesis", "Measured responses and their synthesis", partial(_synthesis, result))
    yield Figure("stabilisation", "Poles of increasing orders", partial(_chart, result))
    yield Figure("modal-shapes", "Mode shapes at the sensors", partial(_shapes, result))
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
            Curve(at.shown, decibels(measured[:, o, i]), "measured", "s2 fine"),
            Curve(at.shown, decibels(synthesis[:, o, i]), "synthesis", "s1"),
        ]
        subplots.append(Subplot(at.axis, PlotAxis("magnitude (dB)"), layers, name))
        columns |= {f"|{name}| measured": np.abs(measured[:, o, i]), f"|{name}|": np.abs(synthesis[:, o, i])}
    cut = f" The first {_MAX_PAIRS} of {len(pairs)} responses." if len(pairs) > _MAX_PAIRS else ""
    about = f"Responses of the modes and the residual terms over those measured, in SI units.{cut}"
    return Chart(in_rows(subplots), about, table_of(columns))


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
    about = "Stable poles of polynomials of increasing order; dashed: the modes by maximum likelihood."
    return Chart([[plot]], about, FigureTable(heads, tuple(rows)))


def _shapes(result: Result) -> Chart:
    shape, channels = result[f"{GROUP}/shape"].data, tuple(texts(result, f"{GROUP}/channel"))
    # The phase that makes the real part largest, as of a real mode.
    turned = shape * np.exp(-0.5j * np.angle(np.sum(shape**2, axis=1)))[:, None]
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


def _mac(result: Result) -> Chart:
    shapes = result[f"{GROUP}/shape"].data.T
    names = [str(number) for number in result[f"{GROUP}/mode"].data]
    about = "1: two modes have one shape at the sensors, which then do not separate them."
    return matrix_chart([("", mac(shapes, shapes), names, names, ("mode", "mode"))], (0.0, 1.0), about)
