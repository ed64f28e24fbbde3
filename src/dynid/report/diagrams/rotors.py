"""Campbell diagrams of rotors: frequencies and damping ratios over the speed of rotation."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from dynid.report.figure import CellValue, Figure, FigureTable
from dynid.report.notation import frequency_label
from dynid.report.plot import Chart, Curve, Layer, PlotAxis, ReferenceLine, Subplot, series_class
from dynid.report.scenes import frequency_unit
from dynid.result import Result

_GROUP = "structure/campbell"
# Whirl beyond which a mode is called forward or backward.
_CIRCLES = 0.1


def figures(result: Result) -> Iterator[Figure]:
    """Yield the Campbell diagram."""
    yield Figure("campbell", "Frequencies over the speed of rotation", partial(_campbell, result))


def _campbell(result: Result) -> Chart:
    unit = frequency_unit(result)
    speed = unit.factor * result[f"{_GROUP}/speed"].data
    omega, damping, whirl = (result[f"{_GROUP}/{name}"].data for name in ("omega", "damping", "whirl"))
    frequency = unit.factor * omega
    curves: list[Layer] = []
    ratios: list[Layer] = [ReferenceLine(0.0)]
    top = float(np.nanmax(frequency, initial=0.0))
    once = speed <= top
    curves.append(Curve(speed[once], speed[once], "once a revolution", "s7 fine dash"))
    for mode in range(omega.shape[1]):
        name, sense = f"mode {mode + 1}", np.append(whirl[np.isfinite(whirl[:, mode]), mode], 0.0)
        turns = float(sense[np.argmax(np.abs(sense))])
        if abs(turns) > _CIRCLES:
            name += " forward" if turns > 0 else " backward"
        cls = series_class(mode) + (" dashed" if turns < -_CIRCLES else "")
        curves.append(Curve(speed, frequency[:, mode], name, cls))
        ratios.append(Curve(speed, 100 * damping[:, mode], name, cls))
    across = PlotAxis(f"speed ({unit.name})")
    plots = [
        [Subplot(across, PlotAxis(frequency_label(unit)), curves, height=260.0)],
        [Subplot(across, PlotAxis("damping ratio (%)"), ratios, height=120.0)],
    ]
    rows: list[tuple[CellValue, ...]] = [
        (float(at), *(float(value) for triple in zip(*line, strict=True) for value in triple))
        for at, *line in zip(speed, frequency, damping, whirl, strict=True)
    ]
    heads = [
        f"{what} {k + 1}" for k in range(omega.shape[1]) for what in ("frequency", "damping ratio", "whirl")
    ]
    about = "Dashed: backward whirl. Critical speeds lie where a mode meets the line once a revolution."
    return Chart(plots, about, FigureTable((f"speed ({unit.name})", *heads), tuple(rows)), shared=True)
