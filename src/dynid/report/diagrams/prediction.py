"""Measured against predicted, what is left, and its spectrum; frequency responses with their fit."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.frequencies import Frequencies, degrees, frequencies
from dynid.report.diagrams.records import Record, records, texts, with_units
from dynid.report.figure import Figure, Picture
from dynid.report.numbers import labelled, short
from dynid.report.plot import Axis, Bars, Line, Marks, Panel, Rule, chart, listed
from dynid.report.plot.layers import Layer

if TYPE_CHECKING:
    from dynid.result import Result

GROUP = "identification/measurement"
#: The most channels of a figure.
CHANNELS = 8


def figures(result: Result) -> Iterator[Figure]:
    """Yield predictions over time or frequency, and the whiteness of the residuals."""
    for record in records(result, GROUP, "predicted"):
        over_time = f"{record.group}/time" in result
        name = f"{'prediction' if over_time else 'fit'}{record.suffix}"
        title = f"{'Measured and predicted' if over_time else 'Measured and fitted responses'}{record.title}"
        yield Figure(
            name, title, partial(_over_time if over_time else _over_frequency, result, record, name, title)
        )
    group = "identification/diagnostics"
    if f"{group}/autocorrelation" in result:
        yield Figure("whiteness", "Autocorrelation of the residuals", partial(_whiteness, result, group))


def _over_time(result: Result, record: Record, name: str, title: str) -> Picture:
    group = record.group
    time = result[f"{group}/time"].data
    measured, predicted = result[f"{group}/measured"].data, result[f"{group}/predicted"].data
    channels = with_units(result, group, "channel", measured.shape[1], result[f"{group}/measured"].units)
    rows = []
    for place, channel in enumerate(channels[:CHANNELS]):
        both: list[Layer] = [
            Line(time, measured[:, place], "measured", "s7"),
            Line(time, predicted[:, place], "predicted", "s1 fine"),
        ]
        left = Line(time, measured[:, place] - predicted[:, place], "measured − predicted", "s2 fine")
        rows.append(
            [
                Panel(Axis("time (s)"), Axis(channel), both, weight=1.6),
                Panel(Axis("time (s)"), Axis("residual"), [left]),
                *_spectrum(result, group.replace("measurement", "residual_spectrum"), place),
            ]
        )
    share = "; ".join(
        f"{channel}: {_share(measured[:, k], predicted[:, k])}" for k, channel in enumerate(channels[:4])
    )
    more = f" The first {CHANNELS} of {len(channels)} channels." if len(channels) > CHANNELS else ""
    about = f"What is left, as a share of the signal: {share}.{more}"
    svg = chart(name, title, rows, about, width=1000.0, height=150.0)
    columns = {"time (s)": time}
    for place, channel in enumerate(channels):
        columns |= {f"measured {channel}": measured[:, place], f"predicted {channel}": predicted[:, place]}
    return Picture(svg, about, listed(columns))


def _spectrum(result: Result, group: str, place: int) -> Iterator[Panel]:
    """Yield the spectrum of what is left of a channel, if there is one."""
    if f"{group}/amplitude" not in result:
        return
    at, amplitude = frequencies(result, f"{group}/omega"), result[f"{group}/amplitude"]
    units = texts(result, f"{group}/unit")
    line = Line(at.shown, amplitude.data[:, place], "its spectrum", "s3 fine")
    yield Panel(at.axis, Axis(labelled("spectrum", units[place] if units else amplitude.units)), [line])


def _share(measured: np.ndarray, predicted: np.ndarray) -> str:
    size = float(np.linalg.norm(np.nan_to_num(measured)))
    left = float(np.linalg.norm(np.nan_to_num(measured - predicted)))
    return f"{short(100 * left / size, 2)} %" if size else "no signal"


def _over_frequency(result: Result, record: Record, name: str, title: str) -> Picture:
    group = record.group
    at = frequencies(result, f"{group}/omega")
    measured, predicted = result[f"{group}/measured"].data, result[f"{group}/predicted"].data
    channels = with_units(result, group, "channel", measured.shape[1], result[f"{group}/measured"].units)
    rows = [
        _fitted(at, channel, measured[:, place], predicted[:, place])
        for place, channel in enumerate(channels[:CHANNELS])
    ]
    columns = dict(at.columns)
    for place, channel in enumerate(channels):
        for what, values in (("measured", measured), ("fitted", predicted)):
            columns |= {
                f"Re {what} {channel}": values[:, place].real,
                f"Im {what} {channel}": values[:, place].imag,
            }
    more = f" The first {CHANNELS} of {len(channels)} channels." if len(channels) > CHANNELS else ""
    about = f"Responses as measured, as fitted, and what is left between them.{more}"
    svg = chart(name, title, rows, about, width=900.0, height=190.0)
    return Picture(svg, about, listed(columns))


def _fitted(at: Frequencies, channel: str, data: np.ndarray, model: np.ndarray) -> list[Panel]:
    """Return the panels of a channel: sizes, and phases."""
    sizes: list[Layer] = [
        Marks(at.shown, np.abs(data), "measured", "s7", "o", 1.6),
        Line(at.shown, np.abs(model), "fitted", "s1"),
        Line(at.shown, np.abs(data - model), "|measured − fitted|", "s2 fine"),
    ]
    phases: list[Layer] = [
        Marks(at.shown, np.rad2deg(np.angle(data)), "", "s7", "o", 1.6),
        Line(at.shown, _wrapped(degrees(model)), "", "s1"),
    ]
    return [
        Panel(at.axis, Axis(channel, log=True), sizes, weight=1.4),
        Panel(at.axis, Axis("phase (°)", step=15, low=-180, high=180), phases),
    ]


def _wrapped(phase: np.ndarray) -> np.ndarray:
    """Return phases within ±180°, not joined where they jump."""
    folded = (phase + 180) % 360 - 180
    jumps = np.flatnonzero(np.abs(np.diff(folded)) > 180)
    folded[jumps] = np.nan
    return folded


def _whiteness(result: Result, group: str) -> Picture:
    lag, values = result[f"{group}/lag"].data, result[f"{group}/autocorrelation"].data
    bands = result[f"{group}/autocorrelation_band"].data
    channels = texts(result, f"{group}/channel")
    panels = []
    for place, channel in enumerate(channels[:CHANNELS]):
        band = float(bands[place])
        layers: list[Layer] = [
            Bars(lag, np.zeros(len(lag)), values[:, place], "autocorrelation", "s1", thick=0.4),
            Rule(band, "95 % band of white noise", "s2 dashed"),
            Rule(-band, "", "s2 dashed"),
        ]
        panels.append(
            Panel(Axis("lag (samples)", step=1), Axis("autocorrelation"), layers, channel, height=150.0)
        )
    outside = int((np.abs(values) > bands).sum())
    about = f"{outside} of {values.size} values are outside the band; of white noise about 1 in 20 would be."
    rows = [panels[start : start + 2] for start in range(0, len(panels), 2)]
    svg = chart("whiteness", "Autocorrelation of the residuals", rows, about)
    columns = {"lag (samples)": lag} | {channel: values[:, k] for k, channel in enumerate(channels)}
    return Picture(svg, about, listed(columns))
