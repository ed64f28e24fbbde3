"""Responses over time: to a step, an impulse or any other signal, or of stored energy alone."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from dynid.report.figure import Figure, Picture
from dynid.report.numbers import labelled, short
from dynid.report.plot import Axis, Line, Panel, chart, listed
from dynid.report.plot.layers import hue

if TYPE_CHECKING:
    from dynid.result import Result

#: The most panels under each other.
PANELS = 12


def figures(result: Result) -> Iterator[Figure]:
    """Yield the responses over time."""
    for group in ("bond_graph/time_response", "structure/time_response"):
        if f"{group}/response" in result:
            yield Figure("time-response", "Time response", partial(_picture, result, group))


def _picture(result: Result, group: str) -> Picture:
    time = result[f"{group}/time"].data
    outputs = _columns(result, group, "response", "output", "unit")
    sources = _columns(result, group, "input", "source", "input_unit") if f"{group}/input" in result else {}
    shown = list(outputs.items())[:PANELS]
    height = 240.0 if len(shown) == 1 else 150.0
    panels = [
        Panel(Axis("time (s)"), Axis(name), [Line(time, values, "", hue(0))], height=height)
        for name, values in shown
    ]
    moving = {name: values for name, values in sources.items() if np.any(np.asarray(values) != 0)}
    for name, values in list(moving.items())[:3]:
        panels.append(Panel(Axis("time (s)"), Axis(name), [Line(time, values, "", hue(6))], height=90.0))
    about = _about(time, shown, bool(moving), len(outputs))
    svg = chart("time-response", "Time response", [[panel] for panel in panels], about, shared=True)
    return Picture(svg, about, listed({"time (s)": time, **dict(shown), **moving}))


def _columns(result: Result, group: str, name: str, axis: str, unit: str) -> Mapping[str, ArrayLike]:
    """Return the columns of an array over time, each under its name with its units."""
    variable = result[f"{group}/{name}"]
    names = list(map(str, result[f"{group}/{axis}"].data))
    given = result[f"{group}/{unit}"].data if f"{group}/{unit}" in result else [variable.units] * len(names)
    units = [str(own) or "SI" for own in given]
    return {
        labelled(own, its): variable.data[:, k] for k, (own, its) in enumerate(zip(names, units, strict=True))
    }


def _about(time: np.ndarray, shown: list[tuple[str, ArrayLike]], driven: bool, count: int) -> str:
    said = []
    for name, values in shown[:3]:
        data = np.asarray(values)
        if np.isfinite(data).any():
            said.append(f"{name}: {short(np.nanmin(data))} … {short(np.nanmax(data))}")
    way = "" if driven else "Moved by stored energy alone. "
    left = f" The first {PANELS} of {count} outputs." if count > PANELS else ""
    return f"{way}{'; '.join(said)}, over {short(float(time[-1] - time[0]))} s.{left}"
