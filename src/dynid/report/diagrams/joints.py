"""Joints with nonlinear laws: force over deflection, regimes over time, dissipated energy."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from dynid.arrays import Array
from dynid.report.figure import Figure, table_of
from dynid.report.notation import short
from dynid.report.plot import Chart, Curve, PlotAxis, Subplot, in_rows, series_class
from dynid.result import Result

_GROUP = "structure/joints"
#: Most joints that are drawn.
_JOINTS = 8


def figures(result: Result) -> Iterator[Figure]:
    """Yield the force over the deflection of each joint, and what it does over time."""
    if f"{_GROUP}/force" in result:
        yield Figure("joint-loops", "Forces of joints over their deflections", partial(_loops, result))
        yield Figure("joint-histories", "Joints over time", partial(_histories, result))


def _columns(result: Result, name: str) -> dict[str, Array]:
    """Return an array over time by the names of joints or laws."""
    axis = "law" if name == "regime" else "joint"
    names = list(map(str, result[f"{_GROUP}/{axis}"].data))[:_JOINTS]
    data = result[f"{_GROUP}/{name}"].data
    return {label: np.asarray(data[:, k], dtype=float) for k, label in enumerate(names)}


def _loops(result: Result) -> Chart:
    """Return the force of the laws over the deflection: loops enclose the energy that a joint dissipates."""
    deflections, forces = _columns(result, "deflection"), _columns(result, "force")
    subplots = [
        Subplot(
            PlotAxis(f"{name} deflection (m)"),
            PlotAxis("force of laws (N)"),
            [Curve(deflections[name], force, "", series_class(0))],
        )
        for name, force in forces.items()
    ]
    ranges = [
        f"{name}: up to {short(float(np.abs(d).max(initial=0.0)))} m" for name, d in deflections.items()
    ]
    table = table_of(
        {f"{name} {what}": values for name in forces for what, values in
         (("deflection (m)", deflections[name]), ("force (N)", forces[name]))}
    )  # fmt: skip
    return Chart(in_rows(subplots), f"Samples of the response, joined. {'; '.join(ranges)}.", table)


def _histories(result: Result) -> Chart:
    """Return the energy that joints take up, and the regimes of their laws, over time."""
    time = np.asarray(result[f"{_GROUP}/time"].data)
    work, regimes = _columns(result, "work"), _columns(result, "regime")
    energy = [Curve(time, values, name, series_class(k)) for k, (name, values) in enumerate(work.items())]
    subplots = [Subplot(PlotAxis("time (s)"), PlotAxis("work on laws (J)"), energy, height=150.0)]
    subplots += [
        Subplot(PlotAxis("time (s)"), PlotAxis(name), [Curve(time, values, "", series_class(6))], height=70.0)
        for name, values in regimes.items()
        if np.ptp(values) > 0
    ]
    ends = [f"{name}: {short(float(values[-1]))} J" for name, values in work.items() if len(values)]
    about = (
        f"Work done on the laws, of which springs return a part, at the end: {'; '.join(ends)}. Below, the "
        "regimes of laws that change theirs: of a slider 0 stuck and ±1 slipping, of a gap 0 open and ±1 in "
        "contact."
    )
    table = table_of({"time (s)": time, **{f"{name} (J)": v for name, v in work.items()}, **regimes})
    return Chart(in_rows(subplots, 1), about, table, shared=True)
