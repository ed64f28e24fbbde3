"""Measured and predicted records, their residuals with spectrum and autocorrelation, and fitted responses."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.report.diagrams.estimates import record_groups
from dynid.report.diagrams.responses import degrees, frequencies
from dynid.report.figure import Figure, Picture, table_of
from dynid.report.labels import labelled, labels_with_units, short, texts
from dynid.report.plot import Bars, Curve, Layer, Markers, PlotAxis, ReferenceLine, Subplot, chart

if TYPE_CHECKING:
    from dynid.result import Result

GROUP = "identification/measurement"
#: Most channels of a figure.
CHANNELS = 8


def figures(result: Result) -> Iterator[Figure]:
    """Yield predictions over time or frequency, and the whiteness of the residuals."""
    for record in record_groups(result, GROUP, "predicted"):
        if f"{record.group}/time" in result:
            name, title, draw = "prediction", "Measured and predicted", _over_time
        else:
            name, title, draw = "fit", "Measured and fitted responses", _over_frequency
        name, title = f"{name}{record.suffix}", f"{title}{record.title}"
        yield Figure(name, title, partial(draw, result, record.group, name, title))
    group = "identification/diagnostics"
    if f"{group}/autocorrelation" in result:
        yield Figure("whiteness", "Autocorrelation of the residuals", partial(_whiteness, result, group))


def _channels(result: Result, group: str) -> list[str]:
    """Return the labels of the channels with their units."""
    measured = result[f"{group}/measured"]
    return labels_with_units(result, group, "channel", measured.shape[1], measured.units)


def _over_time(result: Result, group: str, name: str, title: str) -> Picture:
    time, channels = result[f"{group}/time"].data, _channels(result, group)
    measured, predicted = result[f"{group}/measured"].data, result[f"{group}/predicted"].data
    spectra = group.replace("measurement", "residual_spectrum")
    rows, columns = [], {"time (s)": time}
    for place, channel in enumerate(channels):
        data, model = measured[:, place], predicted[:, place]
        columns |= {f"measured {channel}": data, f"predicted {channel}": model}
        if place >= CHANNELS:
            continue
        both: list[Layer] = [Curve(time, data, "measured", "s7"), Curve(time, model, "predicted", "s1 fine")]
        residual = Curve(time, data - model, "measured − predicted", "s2 fine")
        row = [
            Subplot(PlotAxis("time (s)"), PlotAxis(channel), both, weight=1.6),
            Subplot(PlotAxis("time (s)"), PlotAxis("residual"), [residual]),
        ]
        if f"{spectra}/amplitude" in result:
            at, amplitude = frequencies(result, f"{spectra}/omega"), result[f"{spectra}/amplitude"]
            units = texts(result, f"{spectra}/unit")
            line = Curve(at.shown, amplitude.data[:, place], "spectrum of the residual", "s3 fine")
            label = labelled("spectrum", units[place] if units else amplitude.units)
            row.append(Subplot(at.axis, PlotAxis(label), [line]))
        rows.append(row)
    shares = []
    for place, channel in enumerate(channels[:4]):
        size = float(np.linalg.norm(np.nan_to_num(measured[:, place])))
        left = float(np.linalg.norm(np.nan_to_num(measured[:, place] - predicted[:, place])))
        shares.append(f"{channel}: {f'{short(100 * left / size, 2)} %' if size else 'no signal'}")
    more = f" The first {CHANNELS} of {len(channels)} channels." if len(channels) > CHANNELS else ""
    about = f"Residual relative to the signal: {'; '.join(shares)}.{more}"
    svg = chart(name, title, rows, about, width=1000.0, height=150.0)
    return Picture(svg, about, table_of(columns))


def _over_frequency(result: Result, group: str, name: str, title: str) -> Picture:
    at, channels = frequencies(result, f"{group}/omega"), _channels(result, group)
    measured, predicted = result[f"{group}/measured"].data, result[f"{group}/predicted"].data
    rows, columns = [], dict(at.columns)
    for place, channel in enumerate(channels):
        data, model = measured[:, place], predicted[:, place]
        for what, values in (("measured", data), ("fitted", model)):
            columns |= {f"Re {what} {channel}": values.real, f"Im {what} {channel}": values.imag}
        if place >= CHANNELS:
            continue
        sizes: list[Layer] = [
            Markers(at.shown, np.abs(data), "measured", "s7", "o", 1.6),
            Curve(at.shown, np.abs(model), "fitted", "s1"),
            Curve(at.shown, np.abs(data - model), "|measured − fitted|", "s2 fine"),
        ]
        phase = (degrees(model) + 180) % 360 - 180
        phase[np.flatnonzero(np.abs(np.diff(phase)) > 180)] = np.nan  # no line where it wraps around
        phases: list[Layer] = [
            Markers(at.shown, np.rad2deg(np.angle(data)), "", "s7", "o", 1.6),
            Curve(at.shown, phase, "", "s1", name="fitted"),
        ]
        upright = PlotAxis("phase (°)", step=15, low=-180, high=180)
        rows.append(
            [
                Subplot(at.axis, PlotAxis(channel, log=True), sizes, weight=1.4),
                Subplot(at.axis, upright, phases),
            ]
        )
    more = f" The first {CHANNELS} of {len(channels)} channels." if len(channels) > CHANNELS else ""
    about = f"Measured and fitted responses, and the magnitude of their difference.{more}"
    svg = chart(name, title, rows, about, width=900.0, height=190.0)
    return Picture(svg, about, table_of(columns))


def _whiteness(result: Result, group: str) -> Picture:
    lag, values = result[f"{group}/lag"].data, result[f"{group}/autocorrelation"].data
    bands = result[f"{group}/autocorrelation_band"].data
    channels = texts(result, f"{group}/channel")
    subplots = []
    for place, channel in enumerate(channels[:CHANNELS]):
        band = float(bands[place])
        layers: list[Layer] = [
            Bars(lag, np.zeros(len(lag)), values[:, place], "autocorrelation", "s1", thick=0.4),
            ReferenceLine(band, "95 % band of white noise", "s2 dashed"),
            ReferenceLine(-band, "", "s2 dashed"),
        ]
        across, up = PlotAxis("lag (samples)", step=1), PlotAxis("autocorrelation")
        subplots.append(Subplot(across, up, layers, channel, height=150.0))
    outside = int((np.abs(values) > bands).sum())
    about = f"{outside} of {values.size} values are outside the band; for white noise about 1 in 20 would be."
    rows = [subplots[start : start + 2] for start in range(0, len(subplots), 2)]
    svg = chart("whiteness", "Autocorrelation of the residuals", rows, about)
    columns = {"lag (samples)": lag} | {channel: values[:, k] for k, channel in enumerate(channels)}
    return Picture(svg, about, table_of(columns))
