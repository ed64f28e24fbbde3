"""What a reduction does: frequency responses before and after it (Yang, Fig. 7), frequencies, MAC."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.frequencies import frequencies
from dynid.report.diagrams.matrices import Matrix, matrix_picture
from dynid.report.diagrams.records import texts
from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import labelled, short
from dynid.report.plot import Axis, Line, Marks, Panel, chart, listed
from dynid.report.plot.layers import Layer, hue

if TYPE_CHECKING:
    from dynid.result import Result

_PANELS = 6


def figures(result: Result) -> Iterator[Figure]:
    """Yield the comparison of all methods with the full model."""
    methods = texts(result, "reduction/method")
    if "reduction/frf/full" in result:
        yield Figure(
            "reduction-frf",
            "Frequency responses before and after reduction",
            partial(_responses, result, methods),
        )
    compared = [method for method in methods if f"reduction/{method}/frequency_error" in result]
    if compared:
        yield Figure(
            "reduction-frequencies",
            "Frequencies of the reduced models",
            partial(_frequencies, result, compared),
        )
    matrices: list[Matrix] = [
        (
            method,
            result[f"reduction/{method}/mac"].data,
            [str(k) for k in result[f"reduction/{method}/mode"].data],
            [str(k) for k in result[f"reduction/{method}/full_mode"].data],
            ("reduced mode", "full mode"),
        )
        for method in methods
        if f"reduction/{method}/mac" in result
    ]
    if matrices:
        about = "1: a mode of the reduced model has the shape of one of the full model; 0: nothing in common."
        draw = partial(matrix_picture, "mac", "Modal assurance criterion", matrices, (0.0, 1.0), about)
        yield Figure("mac", "Modal assurance criterion", draw)


def _responses(result: Result, methods: Sequence[str]) -> Picture:
    group = "reduction/frf"
    at = frequencies(result, f"{group}/omega")
    outputs, inputs = texts(result, f"{group}/output"), texts(result, f"{group}/input")
    full = result[f"{group}/full"]
    units = texts(result, f"{group}/unit") or [full.units] * len(outputs)
    shown = [method for method in methods if f"{group}/{method}" in result]
    panels, columns = [], dict(at.columns)
    for row, output in enumerate(outputs):
        for column, source in enumerate(inputs):
            pair = f"{output} / {source}"
            curves = {"full": full.data[:, row, column]}
            curves |= {method: result[f"{group}/{method}"].data[:, row, column] for method in shown}
            layers: list[Layer] = [
                Line(at.shown, np.abs(values), name, "bond" if name == "full" else hue(place - 1, True))
                for place, (name, values) in enumerate(curves.items())
            ]
            panels.append(Panel(at.axis, Axis(labelled(pair, units[row]), log=True), layers, height=230.0))
            columns |= {f"|{pair}|, {name}": np.abs(values) for name, values in curves.items()}
    left = f" The first {_PANELS} of {len(panels)} responses." if len(panels) > _PANELS else ""
    about = f"Where a reduced model leaves the full line, its modes or what it leaves out are wrong.{left}"
    svg = chart(
        "reduction-frf",
        "Frequency responses before and after reduction",
        [[p] for p in panels[:_PANELS]],
        about,
        shared=True,
    )
    return Picture(svg, about, listed(columns))


def _frequencies(result: Result, methods: Sequence[str]) -> Picture:
    layers: list[Layer] = []
    rows: list[tuple[Cell, ...]] = []
    for place, method in enumerate(methods):
        get = {
            name: result[f"reduction/{method}/{name}"].data
            for name in ("mode", "frequencies", "reference", "frequency_error")
        }
        error = np.abs(get["frequency_error"])
        seen = np.maximum(error, 1e-16)
        tips = [f"{method}, mode {m}: {short(100 * e, 2)} %" for m, e in zip(get["mode"], error, strict=True)]
        layers += [
            Line(get["mode"], 100 * seen, "", hue(place, True) + " fine"),
            Marks(
                get["mode"],
                100 * seen,
                method,
                hue(place),
                ("o", "square", "diamond", "ring", "x", "+")[place % 6],
                4,
                tips,
            ),
        ]
        rows += [(method, *map(float, row)) for row in zip(*get.values(), strict=True)]
    about = "Distance of the frequencies from those of the full model; exact ones lie at 10⁻¹⁴ %."
    panel = Panel(Axis("mode", step=1), Axis("frequency error (%)", log=True), layers)
    svg = chart("reduction-frequencies", "Frequencies of the reduced models", [[panel]], about)
    columns = ("method", "mode", "frequency (rad/s)", "of the full model (rad/s)", "relative error")
    return Picture(svg, about, Table(columns, tuple(rows)))
