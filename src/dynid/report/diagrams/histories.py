"""Parameters and states over a record, with bands and true values (Yang, Figs. 5, 8, 9, 10)."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.records import Record, records, with_units
from dynid.report.figure import Figure, Picture
from dynid.report.numbers import short
from dynid.report.plot import Axis, Band, Line, Panel, Rule, chart, listed
from dynid.report.plot.layers import Layer

if TYPE_CHECKING:
    from dynid.result import Result

#: The most panels of a figure.
PANELS = 12
_WHAT = {
    "identification/history": ("history", "Parameters over the record"),
    "identification/first_pass": ("first-pass", "Parameters over the record, first pass"),
}


def figures(result: Result) -> Iterator[Figure]:
    """Yield histories of parameters, and errors of states where the true ones are known."""
    for group, (name, title) in _WHAT.items():
        for record in records(result, group, "estimate"):
            yield Figure(
                f"{name}{record.suffix}",
                f"{title}{record.title}",
                partial(_history, result, record, name, title),
            )
    for group, name, title in (
        ("identification/history", "state-error", "State estimation error of the filter"),
        ("identification/states", "smoothed-state-error", "State estimation error at the estimate"),
    ):
        true, estimate = ("true_state", "state") if name == "state-error" else ("true", "estimate")
        for record in records(result, group, true):
            draw = partial(_states, result, record, (name, title, true, estimate))
            yield Figure(f"{name}{record.suffix}", f"{title}{record.title}", draw)


def _history(result: Result, record: Record, name: str, title: str) -> Picture:
    group = record.group
    time, estimate = result[f"{group}/time"].data, result[f"{group}/estimate"].data
    deviation = result[f"{group}/standard_deviation"].data
    # First passes say nothing of the truth that the last one is to come to.
    of_truth = group.replace("first_pass", "history")
    true = result[f"{of_truth}/true"].data if f"{of_truth}/true" in result else None
    names = _parameters(result, group, estimate.shape[1])
    panels = []
    for place, label in enumerate(names[:PANELS]):
        own, half = estimate[:, place], 1.96 * deviation[:, place]
        layers: list[Layer] = [
            Band(time, *_seen(own, half), "95 % band", "s1"),
            Line(time, own, "estimate", "s1"),
        ]
        if true is not None:
            layers.append(Rule(float(true[place]), "true", "s2 dashed"))
        panels.append(Panel(Axis("time (s)"), Axis(label), layers, height=170.0))
    ends = "; ".join(f"{label}: {short(float(estimate[-1, k]))}" for k, label in enumerate(names[:4]))
    left = f" The first {PANELS} of {len(names)} parameters." if len(names) > PANELS else ""
    about = f"At the end {ends}.{left}"
    rows = _in_rows(panels, 1 if len(panels) == 1 else 2)
    svg = chart(f"{name}{record.suffix}", f"{title}{record.title}", rows, about, shared=True)
    columns = {"time (s)": time}
    for place, label in enumerate(names):
        columns |= {label: estimate[:, place], f"± {label}": deviation[:, place]}
    return Picture(svg, about, listed(columns))


def _seen(own: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of a band, no further off than makes the line itself hard to see."""
    span = float(np.ptp(own[np.isfinite(own)])) if np.isfinite(own).any() else 0.0
    span = max(span, 4 * float(np.sort(half)[len(half) // 2]))
    low, high = float(np.nanmin(own)) - 0.6 * span, float(np.nanmax(own)) + 0.6 * span
    return np.maximum(own - half, low), np.minimum(own + half, high)


def _parameters(result: Result, group: str, count: int) -> list[str]:
    names = list(map(str, result[f"{group}/parameter"].data))
    known = (
        dict(
            zip(
                result["identification/parameters/name"].data,
                with_units(
                    result,
                    "identification/parameters",
                    "name",
                    len(result["identification/parameters/name"].data),
                ),
                strict=True,
            )
        )
        if "identification/parameters/name" in result
        else {}
    )
    return [known.get(name, name) for name in names][:count]


def _states(result: Result, record: Record, what: tuple[str, str, str, str]) -> Picture:
    name, title, true_name, estimate_name = what
    group = record.group
    time = result[f"{group}/time"].data
    error = result[f"{group}/{estimate_name}"].data - result[f"{group}/{true_name}"].data
    path = f"{group}/state_standard_deviation" if name == "state-error" else f"{group}/standard_deviation"
    half = 1.96 * result[path].data if path in result else None
    names = with_units(result, group, "component", error.shape[1])
    shown = list(range(error.shape[1]))
    if len(shown) > PANELS:  # velocities are what the paper shows, and what sensors mostly give
        fast = [place for place in shown if ".velocity" in names[place]]
        shown = (fast or shown)[:PANELS]
    panels = []
    for place in shown:
        layers: list[Layer] = []
        if half is not None:
            low, high = _seen(error[:, place], half[:, place])
            near = np.clip(half[:, place], 0, max(float(np.abs(low).max()), float(np.abs(high).max())))
            layers.append(Band(time, -near, near, "95 % band", "s1"))
        layers += [Line(time, error[:, place], "estimate − true", "s1 fine"), Rule(0.0, "", "hair")]
        panels.append(Panel(Axis("time (s)"), Axis(names[place]), layers, height=135.0))
    left = f" {len(shown)} of {len(names)} states." if len(shown) < len(names) else ""
    about = f"Estimated less true states, with the band that the estimator gives them.{left}"
    rows = _in_rows(panels, 2 if len(panels) > 1 else 1)
    svg = chart(f"{name}{record.suffix}", f"{title}{record.title}", rows, about, shared=True)
    columns = {"time (s)": time} | {f"error of {names[place]}": error[:, place] for place in shown}
    return Picture(svg, about, listed(columns))


def _in_rows(panels: list[Panel], count: int) -> list[list[Panel]]:
    return [panels[start : start + count] for start in range(0, len(panels), count)]
