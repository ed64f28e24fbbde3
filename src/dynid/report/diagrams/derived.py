"""Frequency responses of the identified model with their 95 % bands."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.content.derived import DERIVED, is_requested
from dynid.report.diagrams.responses import frequencies
from dynid.report.figure import Figure, Picture, table_of
from dynid.report.notation import labelled
from dynid.report.plot import Band, Curve, Layer, PlotAxis, Subplot, chart

if TYPE_CHECKING:
    from dynid.result import Result

#: Most responses that are drawn.
_MOST = 6


def figures(result: Result) -> Iterator[Figure]:
    """Yield magnitude and phase of each derived response, with bands, where they were requested."""
    beginning, end = f"{DERIVED}/frequency_response/", "/magnitude/value"
    groups = [path.removesuffix(end) for path in result if path.startswith(beginning) and path.endswith(end)]
    for group in groups[: _MOST if is_requested(result) else 0]:
        pair = group.removeprefix(beginning)
        yield Figure(
            f"identified-response-{pair.replace('/', '-')}",
            f"Identified response {pair}",
            partial(_drawn, result, group, pair),
        )


def _drawn(result: Result, group: str, pair: str) -> Picture:
    at = frequencies(result, f"{group}/magnitude/omega")
    columns, rows = dict(at.columns), []
    for name, factor in (("magnitude", 1.0), ("phase", 180 / np.pi)):
        value, low, high = (factor * result[f"{group}/{name}/{end}"].data for end in ("value", "low", "high"))
        unit = "°" if name == "phase" else result[f"{group}/{name}/value"].units
        logarithmic = name == "magnitude" and bool(np.all(low > 0))
        axis = PlotAxis(labelled(name, unit), log=logarithmic)
        layers: list[Layer] = [
            Band(at.shown, low, high, "95 % band", "s1"),
            Curve(at.shown, value, "identified", "s1"),
        ]
        rows.append([Subplot(at.axis, axis, layers, height=220.0)])
        columns |= {
            labelled(f"{name}{word}", unit): each
            for word, each in (("", value), (", low", low), (", high", high))
        }
    about = f"Frequency response {pair} of the identified model, with its 95 % band."
    svg = chart(
        f"identified-response-{pair.replace('/', '-')}",
        f"Identified response {pair}",
        rows,
        about,
        shared=True,
    )
    return Picture(svg, about, table_of(columns))
