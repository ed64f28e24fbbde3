"""The performance characteristic of a port: what the source gives and what the load takes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import labelled, short
from dynid.report.plot import Axis, Line, Marks, Panel, chart

if TYPE_CHECKING:
    from dynid.result import Result

GROUP = "bond_graph/port/performance"


def figures(result: Result) -> Iterator[Figure]:
    """Yield the characteristics, where they are finite lines."""
    if f"{GROUP}/source_flow" in result and len(result[f"{GROUP}/input"].data):
        yield Figure("performance", "Performance characteristic of the port", partial(_picture, result))


def _picture(result: Result) -> Picture:
    data = {
        name: result[f"{GROUP}/{name}"].data
        for name in ("source_flow", "source_effort", "load_flow", "load_effort")
    }
    at = [result[f"{GROUP}/operating_{name}"].data for name in ("flow", "effort")]
    axes = [labelled(name, result[f"{GROUP}/source_{name}"].units or "SI") for name in ("flow", "effort")]
    panels, rows = [], list[tuple[Cell, ...]]()
    for place, source in enumerate(map(str, result[f"{GROUP}/input"].data)):
        points = {name: values[place] for name, values in data.items()}
        panels.append(_panel(source, points, (float(at[0][place]), float(at[1][place])), axes))
        for side in ("source", "load"):
            rows += [
                (source, side, float(f), float(e))
                for f, e in zip(points[f"{side}_flow"], points[f"{side}_effort"], strict=True)
            ]
        rows.append((source, "operating point", float(at[0][place]), float(at[1][place])))
    about = "At rest (s → 0): what the source gives, what the load takes; they meet at the operating point."
    svg = chart(
        "performance",
        "Performance characteristic of the port",
        [panels[:3]],
        about,
        height=300.0,
        width=480.0 if len(panels) == 1 else 760.0,
    )
    return Picture(svg, about, Table(("input", "what", *axes), tuple(rows)))


def _panel(source: str, points: dict[str, np.ndarray], at: tuple[float, float], axes: list[str]) -> Panel:
    layers = [
        Line(points[f"{side}_flow"], points[f"{side}_effort"], f"{side}", cls)
        for side, cls in (("source", "s1"), ("load", "s2"))
    ]
    tip = f"flow {short(at[0])}, effort {short(at[1])}"
    mark = Marks([at[0]], [at[1]], "operating point", "s3", "o", 5, [tip])
    return Panel(Axis(axes[0]), Axis(axes[1]), [*layers, mark], source)
