"""Rankings of a plan: sensors and frequencies of excitation, by the bounds they give."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from dynid.report.diagrams.responses import frequencies
from dynid.report.figure import CellValue, Figure, FigureTable, table_of
from dynid.report.notation import short, texts
from dynid.report.plot import Chart, Curve, Layer, Markers, PlotAxis, Subplot, series_class
from dynid.result import Result

#: Most sensors that are ranked in a figure.
SENSORS = 30
_SYMBOLS = ("o", "square", "diamond", "x", "+", "ring")


def figures(result: Result) -> Iterator[Figure]:
    """Yield the rankings."""
    if "plan/sensors/bound_alone" in result:
        yield Figure("sensors", "Sensors, each alone", partial(_sensors, result))
    if "plan/excitation/worth" in result:
        title = "Location and frequency of the excitation"
        yield Figure("excitation", title, partial(_excitation, result))


def _sensors(result: Result) -> Chart:
    group = "plan/sensors"
    bounds = result[f"{group}/bound_alone"].data
    names, unknowns = texts(result, f"{group}/candidate"), texts(result, f"{group}/parameter")
    chosen, present = texts(result, f"{group}/choice"), texts(result, f"{group}/present")
    with np.errstate(divide="ignore", invalid="ignore"):  # the geometric mean over the parameters
        mean = np.exp(np.mean(np.log(np.where(np.isfinite(bounds) & (bounds > 0), bounds, np.inf)), axis=1))
    order = [k for k in np.argsort(mean, kind="stable").tolist() if np.isfinite(mean[k])][:SENSORS]
    upwards = order[::-1]
    layers: list[Layer] = []
    for index, unknown in enumerate(unknowns):
        values = 100 * bounds[upwards][:, index]
        tips = [f"{names[k]}: {unknown} to {short(100 * float(bounds[k, index]), 2)} %" for k in upwards]
        at = np.arange(len(order), dtype=float)
        layers.append(Markers(values, at, unknown, series_class(index), _SYMBOLS[index % 6], 3.5, tips))
    labels = tuple(names[k] + (" ✓" if names[k] in chosen else "") for k in upwards)
    across, height = PlotAxis("bound on the standard error (%)", log=True), max(120.0, 16.0 * len(order))
    plot = Subplot(across, PlotAxis("", names=labels), layers, height=height)
    dropped = len(names) - len(order)
    left = f" {dropped} more have larger bounds, or do not identify every parameter alone." if dropped else ""
    about = (
        f"Bounds with one sensor alone, the best at the top. ✓: best combination, {', '.join(chosen)}. "
        f"Present sensors: {', '.join(present)}.{left}"
    )
    rows: tuple[tuple[CellValue, ...], ...] = tuple(
        (names[k], names[k] in chosen, *map(float, bounds[k])) for k in order
    )
    head = ("sensor", "chosen", *(f"relative bound of {unknown}" for unknown in unknowns))
    return Chart([[plot]], about, FigureTable(head, rows))


def _excitation(result: Result) -> Chart:
    group = "plan/excitation"
    at = frequencies(result, f"{group}/omega")
    bounds, dofs = result[f"{group}/worth"].data, texts(result, f"{group}/dof")
    layers: list[Layer] = [
        Curve(at.shown, bounds[:, k], f"force at {dof}", series_class(k)) for k, dof in enumerate(dofs[:7])
    ]
    picked = result[f"{group}/choice_omega"].data
    heights = [
        float(np.interp(omega, at.omega, bounds[:, dofs.index(dof)])) if dof in dofs else np.nan
        for omega, dof in zip(picked, texts(result, f"{group}/choice_dof"), strict=True)
    ]
    scale = at.shown[-1] / at.omega[-1]
    tips = texts(result, f"{group}/choice")
    layers.append(Markers(picked * scale, heights, "chosen sines", "mark", "ring", 6, tips))
    about = "Bound with a sine of the present force, geometric mean over the parameters; lower is better."
    plot = Subplot(at.axis, PlotAxis("relative bound", log=True), layers, height=220.0)
    columns = dict(at.columns) | {f"force at {dof}": bounds[:, k] for k, dof in enumerate(dofs)}
    return Chart([[plot]], about, table_of(columns))
