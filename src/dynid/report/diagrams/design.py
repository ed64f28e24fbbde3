"""Responses of a graph before and after its design."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.content.design import DESIGN
from dynid.report.diagrams.responses import decibels, degrees, frequencies
from dynid.report.figure import Figure, Picture, table_of
from dynid.report.notation import labelled
from dynid.report.plot import Curve, Layer, PlotAxis, Subplot, chart

if TYPE_CHECKING:
    from dynid.result import Result

#: Most channels that are drawn.
_MOST = 6


def figures(result: Result) -> Iterator[Figure]:
    """Yield magnitude and phase of every channel with a target, at the start and as designed."""
    group = f"{DESIGN}/frequency_response"
    if f"{group}/designed" not in result:
        return
    for place, name in enumerate(result[f"{group}/channel"].data[:_MOST]):
        title = f"Design of {name}"
        suffix = f"-{place + 1}" if place else ""
        yield Figure(f"design{suffix}", title, partial(_drawn, result, place, f"design{suffix}", title))


def _drawn(result: Result, place: int, name: str, title: str) -> Picture:
    group = f"{DESIGN}/frequency_response"
    at, unit = frequencies(result, f"{group}/omega"), str(result[f"{group}/unit"].data[place])
    columns, rows = dict(at.columns), []
    for quantity, measure in (("magnitude", decibels), ("phase", degrees)):
        layers: list[Layer] = []
        symbol = "°" if quantity == "phase" else "dB"
        for part, colour in (("start", "s2"), ("designed", "s1")):
            found = measure(result[f"{group}/{part}"].data[:, place])
            layers.append(Curve(at.shown, found, part, colour))
            columns[labelled(f"{quantity}, {part}", symbol)] = found
        rows.append([Subplot(at.axis, PlotAxis(labelled(quantity, symbol)), layers, height=210.0)])
    size = [float(np.max(np.abs(result[f"{group}/{part}"].data[:, place]))) for part in ("start", "designed")]
    of = f" {unit}" if unit not in ("", "1") else ""
    about = (
        f"Frequency response of {result[f'{group}/channel'].data[place]} at the start of the design and as "
        f"designed; over these frequencies at most {size[0]:.4g}{of} and {size[1]:.4g}{of}."
    )
    return Picture(chart(name, title, rows, about, shared=True), about, table_of(columns))
