"""Estimates with their intervals, and how they are correlated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.matrices import matrix_picture
from dynid.report.diagrams.records import parameters, texts
from dynid.report.figure import Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.plot import Axis, Bars, Marks, Panel, Rule, chart
from dynid.report.plot.layers import Layer

if TYPE_CHECKING:
    from dynid.result import Result

GROUP = "identification/parameters"
#: The columns of the table: what they hold, and their titles.
_COLUMNS = {
    "start": "start",
    "estimate": "estimate",
    "standard_error": "standard error",
    "true": "true",
    "cramer_rao": "Cramér–Rao bound",
    "error_percent": "error (%)",
}


def figures(result: Result) -> Iterator[Figure]:
    """Yield the estimates and their correlations."""
    if f"{GROUP}/standard_error" in result:
        yield Figure("estimates", "Estimates", partial(_estimates, result))
    path = f"{GROUP}/correlation"
    if path in result and result[path].shape[0] > 1:
        names = texts(result, f"{GROUP}/parameter")
        draw = partial(
            matrix_picture,
            "correlation",
            "Correlation of the estimates",
            [("", result[path].data, names, names, ("", ""))],
            (-1.0, 1.0),
            "Blue: errors go together; orange: against each other. Near ±1 the data cannot tell two apart.",
        )
        yield Figure("correlation", "Correlation of the estimates", draw)


def _estimates(result: Result) -> Picture:
    estimate, error = (result[f"{GROUP}/{name}"].data for name in ("estimate", "standard_error"))
    names = parameters(result)
    true = result[f"{GROUP}/true"].data if f"{GROUP}/true" in result else np.full(len(names), np.nan)
    about_what = np.where(np.isfinite(true), true, estimate)
    scale = np.where(about_what == 0, 1.0, np.abs(about_what)) / 100
    off, half = (estimate - about_what) / scale, 1.96 * error / scale
    place = np.arange(len(names), dtype=float)
    known = bool(np.isfinite(true).any())
    tips = [f"{n}: {short(e, 6)} ± {short(s, 2)}" for n, e, s in zip(names, estimate, error, strict=True)]
    layers: list[Layer] = [
        Bars(place, off - half, off + half, "95 % interval", "s1", 0.22, True, tips),
        Marks(off, place, "estimate", "s2", "o", 4, tips),
        Rule(0.0, "true" if known else "", "line dashed", upright=True),
    ]
    bound = f"{GROUP}/cramer_rao"
    if bound in result:
        reach = 1.96 * result[bound].data / scale
        layers.append(
            Marks(np.concatenate([-reach, reach]), np.tile(place, 2), "Cramér–Rao bound, 95 %", "s3", "+", 5)
        )
    label = "off the true value (%)" if known else "about the estimate (%)"
    panel = Panel(Axis(label), Axis("", names=tuple(names)), layers, height=max(90.0, 30.0 * len(names)))
    about = "The best that any estimator could do with this record is the Cramér–Rao bound."
    svg = chart("estimates", "Estimates", [[panel]], about)
    return Picture(svg, about, _table(result, names))


def _table(result: Result, names: Sequence[str]) -> Table:
    columns = {
        title: result[f"{GROUP}/{name}"].data
        for name, title in _COLUMNS.items()
        if f"{GROUP}/{name}" in result
    }
    rows = zip(names, *(values.tolist() for values in columns.values()), strict=True)
    return Table(("parameter", *columns), tuple(rows))
