"""What a plan ranks: sensors and frequencies of excitation, by the bounds they give."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.frequencies import frequencies
from dynid.report.diagrams.records import texts
from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.plot import Axis, Line, Marks, Panel, chart, listed
from dynid.report.plot.layers import Layer, hue

if TYPE_CHECKING:
    from dynid.result import Result

#: The most sensors that are ranked in a figure.
SENSORS = 30


def figures(result: Result) -> Iterator[Figure]:
    """Yield the rankings."""
    if "plan/sensors/bound_alone" in result:
        yield Figure("sensors", "Sensors, each alone", partial(_sensors, result))
    if "plan/excitation/worth" in result:
        yield Figure("excitation", "Where and how fast to excite", partial(_excitation, result))


def _sensors(result: Result) -> Picture:
    group = "plan/sensors"
    bounds = result[f"{group}/bound_alone"].data
    names, unknowns = texts(result, f"{group}/candidate"), texts(result, f"{group}/parameter")
    chosen, present = texts(result, f"{group}/choice"), texts(result, f"{group}/present")
    order = _best(bounds)[:SENSORS]
    labels = tuple(names[k] + (" ✓" if names[k] in chosen else "") for k in order[::-1])
    layers = _ranked(bounds[order[::-1]], [names[k] for k in order[::-1]], unknowns)
    panel = Panel(
        Axis("bound on the standard error (%)", log=True),
        Axis("", names=labels),
        layers,
        height=max(120.0, 17.0 * len(order)),
    )
    dropped = len(names) - len(order)
    left = f" {dropped} more tell nothing alone, or less." if dropped else ""
    about = (
        f"Each sensor by itself, the best at the top; ✓: together the best are {', '.join(chosen)}; "
        f"now there are {', '.join(present)}.{left}"
    )
    svg = chart("sensors", "Sensors, each alone", [[panel]], about)
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (names[k], names[k] in chosen, *map(float, bounds[k])) for k in order
    )
    head = ("sensor", "chosen", *(f"relative bound of {unknown}" for unknown in unknowns))
    return Picture(svg, about, Table(head, rows))


def _best(bounds: np.ndarray) -> list[int]:
    """Return the sensors that bound every parameter, the best first by the geometric mean."""
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.exp(np.mean(np.log(np.where(np.isfinite(bounds) & (bounds > 0), bounds, np.inf)), axis=1))
    return [k for k in np.argsort(mean, kind="stable").tolist() if np.isfinite(mean[k])]


def _ranked(bounds: np.ndarray, names: Sequence[str], unknowns: Sequence[str]) -> list[Layer]:
    """Return the bounds (sensors x parameters) as marks, one row a sensor."""
    return [
        Marks(
            100 * bounds[:, place],
            np.arange(len(names), dtype=float),
            unknown,
            hue(place),
            ("o", "square", "diamond", "x", "+", "ring")[place % 6],
            3.5,
            [
                f"{name}: {unknown} to {short(100 * float(b), 2)} %"
                for name, b in zip(names, bounds[:, place], strict=True)
            ],
        )
        for place, unknown in enumerate(unknowns)
    ]


def _excitation(result: Result) -> Picture:
    group = "plan/excitation"
    at = frequencies(result, f"{group}/omega")
    worth, dofs = result[f"{group}/worth"].data, texts(result, f"{group}/dof")
    layers: list[Layer] = [
        Line(at.shown, worth[:, k], f"force at {dof}", hue(k)) for k, dof in enumerate(dofs[:7])
    ]
    picked = result[f"{group}/choice_omega"].data
    where = texts(result, f"{group}/choice_dof")
    heights = [
        float(np.interp(omega, at.omega, worth[:, dofs.index(dof)])) if dof in dofs else np.nan
        for omega, dof in zip(picked, where, strict=True)
    ]
    scale = at.shown[-1] / at.omega[-1]
    layers.append(
        Marks(picked * scale, heights, "chosen sines", "mark", "ring", 6, texts(result, f"{group}/choice"))
    )
    about = (
        "The bound that a sine of the present force gives, geometric mean over the parameters: low is good."
    )
    panel = Panel(at.axis, Axis("relative bound", log=True), layers)
    svg = chart("excitation", "Where and how fast to excite", [[panel]], about)
    return Picture(
        svg, about, listed(dict(at.columns) | {f"force at {dof}": worth[:, k] for k, dof in enumerate(dofs)})
    )
