"""Figures of an identification: estimates, histories, predictions, residuals, and laws of joints."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.identification.residual_tests import spectrum
from dynid.report.content.identification import is_rejected, lacks_fit
from dynid.report.diagrams.responses import degrees, frequencies
from dynid.report.figure import Figure, FigureTable, table_of
from dynid.report.notation import labelled, labels_with_units, short, texts
from dynid.report.plot import (
    BandLayer,
    Bars,
    Chart,
    Curve,
    Layer,
    Markers,
    PlotAxis,
    ReferenceLine,
    Subplot,
    in_rows,
    matrix_chart,
    series_class,
)
from dynid.report.scenes import estimates
from dynid.result import Result

GROUP = "identification/parameters"
#: Columns of the table: names of the arrays, and headings.
_COLUMNS = {
    "start": "start",
    "estimate": "estimate",
    "standard_error": "standard error",
    "true": "true",
    "cramer_rao": "Cramér–Rao bound",
    "error_percent": "error (%)",
}
#: Most subplots of a history.
_PANELS = 12


def _figures_of_records(
    result: Result,
    group: str,
    member: str,
    name: str,
    title: str,
    draw: Callable[..., Chart],
    *options: Any,
) -> Iterator[Figure]:
    """Yield a figure of a group that has a member, or of each `record_1`, `record_2`, … in it that has it."""
    if f"{group}/{member}" in result:
        yield Figure(name, title, partial(draw, result, group, *options))
        return
    for path in result:
        record = path.removeprefix(f"{group}/").removesuffix(f"/{member}")
        if record.startswith("record_") and path == f"{group}/{record}/{member}" and "/" not in record:
            heading = f"{title}, {record.replace('_', ' ')}"
            yield Figure(f"{name}-{record}", heading, partial(draw, result, f"{group}/{record}", *options))


def figures(result: Result) -> Iterator[Figure]:
    """Yield the estimates and their correlations."""
    if f"{GROUP}/standard_error" in result:
        yield Figure("estimates", "Estimates", partial(_estimates, result))
    path = f"{GROUP}/correlation"
    if path in result and result[path].shape[0] > 1:
        names = texts(result, f"{GROUP}/parameter")
        about = "Blue: positive, orange: negative. Near ±1 the data do not distinguish the two parameters."
        matrices = [("", result[path].data, names, names, ("", ""))]
        draw = partial(matrix_chart, matrices, (-1.0, 1.0), about)
        yield Figure("correlation", "Correlation of the estimates", draw)


def _estimates(result: Result) -> Chart:
    estimate, error = (result[f"{GROUP}/{name}"].data for name in ("estimate", "standard_error"))
    names = labels_with_units(result, GROUP, "name")
    true = result[f"{GROUP}/true"].data if f"{GROUP}/true" in result else np.full(len(names), np.nan)
    reference = np.where(np.isfinite(true), true, estimate)
    scale = np.where(reference == 0, 1.0, np.abs(reference)) / 100
    off, half = (estimate - reference) / scale, 1.96 * np.where(np.isfinite(error), error, np.nan) / scale
    place = np.arange(len(names), dtype=float)[::-1]  # axes go up, the first parameter is at the top
    compared = bool(np.isfinite(true).any())
    barred = not is_rejected(result)
    tips = [
        f"{n}: {short(e, 6)}{f' ± {short(s, 2)}' if barred else ''}"
        for n, e, s in zip(names, estimate, error, strict=True)
    ]
    bars = [Bars(place, off - half, off + half, "95 % interval", "s1", 0.22, True, tips)] if barred else []
    layers: list[Layer] = [
        *bars,
        Markers(off, place, "estimate", "s2", "o", 4, tips),
        ReferenceLine(0.0, "true" if compared else "", "line dashed", upright=True),
    ]
    if f"{GROUP}/cramer_rao" in result:
        reach = 1.96 * result[f"{GROUP}/cramer_rao"].data / scale
        ends = np.concatenate([-reach, reach])
        layers.append(Markers(ends, np.tile(place, 2), "Cramér–Rao bound, 95 %", "s3", "+", 5))
    label = "error relative to the true value (%)" if compared else "deviation from the estimate (%)"
    height = max(90.0, 30.0 * len(names))
    plot = Subplot(PlotAxis(label), PlotAxis("", names=tuple(names[::-1])), layers, height=height)
    about = "The Cramér–Rao bound is the least standard error of any unbiased estimator on this record."
    columns = {
        title: result[f"{GROUP}/{name}"].data
        for name, title in _COLUMNS.items()
        if f"{GROUP}/{name}" in result and (barred or name != "standard_error")
    }
    rows = zip(names, *(values.tolist() for values in columns.values()), strict=True)
    return Chart([[plot]], about, FigureTable(("parameter", *columns), tuple(rows)))


def histories(result: Result) -> Iterator[Figure]:
    """Yield histories of parameters, and errors of states with known true values (Yang, Figs. 5, 8-10)."""
    passes, states = ("identification/history", "identification/first_pass"), "identification/states"
    title = "Parameters over the record"
    if _follows_record(result, passes[0]):
        yield from _figures_of_records(result, passes[0], "estimate", "history", title, _history)
    yield from _figures_of_records(
        result, passes[1], "estimate", "first-pass", f"{title}, first pass", _history
    )
    title = "State estimation error"
    members = ("true_state", "state", "state_standard_deviation")
    yield from _figures_of_records(
        result, passes[0], members[0], "state-error", f"{title} of the filter", _state_errors, members
    )
    members = ("true", "estimate", "standard_deviation")
    yield from _figures_of_records(
        result, states, members[0], "smoothed-state-error", f"{title} at the estimate", _state_errors, members
    )


def _follows_record(result: Result, group: str) -> bool:
    """Return True if estimates change over the record, as those of a filter do."""
    return any(
        path.startswith(group) and path.endswith("/estimate") and np.ptp(result[path].data, axis=0).any()
        for path in result
    )


def _history(result: Result, group: str) -> Chart:
    time, estimate = result[f"{group}/time"].data, result[f"{group}/estimate"].data
    deviation = result[f"{group}/standard_deviation"].data
    # The true values are stored with the last pass only.
    of_truth = group.replace("first_pass", "history")
    true = result[f"{of_truth}/true"].data if f"{of_truth}/true" in result else None
    labels = dict(zip(texts(result, f"{GROUP}/name"), labels_with_units(result, GROUP, "name"), strict=True))
    names = [labels.get(own, own) for own in texts(result, f"{group}/parameter")][: estimate.shape[1]]
    subplots, columns, barred = list[Subplot](), {"time (s)": time}, not is_rejected(result)
    for index, label in enumerate(names):
        own, half = estimate[:, index], deviation[:, index]
        columns |= {label: own} | ({f"± {label}": half} if barred else {})
        if index < _PANELS:
            bands = [BandLayer(time, *_visible_band(own, 1.96 * half), "95 % band", "s1")] if barred else []
            layers: list[Layer] = [*bands, Curve(time, own, "estimate", "s1")]
            if true is not None:
                layers.append(ReferenceLine(float(true[index]), "true", "s2 dashed"))
            subplots.append(Subplot(PlotAxis("time (s)"), PlotAxis(label), layers, height=170.0))
    ends = "; ".join(f"{label}: {short(float(estimate[-1, k]))}" for k, label in enumerate(names[:4]))
    left = f" The first {_PANELS} of {len(names)} parameters." if len(names) > _PANELS else ""
    about = f"Final values: {ends}.{left}"
    return Chart(in_rows(subplots, 1), about, table_of(columns), shared=True)


def _visible_band(values: np.ndarray, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ends of a band, limited so that the curve itself stays visible."""
    span = float(np.ptp(values[np.isfinite(values)])) if np.isfinite(values).any() else 0.0
    span = max(span, 4 * float(np.sort(half)[len(half) // 2]))
    low, high = float(np.nanmin(values)) - 0.6 * span, float(np.nanmax(values)) + 0.6 * span
    return np.maximum(values - half, low), np.minimum(values + half, high)


def _state_errors(result: Result, group: str, members: tuple[str, str, str]) -> Chart:
    time = result[f"{group}/time"].data
    true, estimate, deviation = members
    error = result[f"{group}/{estimate}"].data - result[f"{group}/{true}"].data
    path = f"{group}/{deviation}"
    half = 1.96 * result[path].data if path in result and not is_rejected(result) else None
    names = labels_with_units(result, group, "component", error.shape[1])
    shown = list(range(error.shape[1]))
    if len(shown) > _PANELS:  # velocities, which the paper shows and most sensors measure
        fast = [state for state in shown if ".velocity" in names[state]]
        shown = (fast or shown)[:_PANELS]
    subplots = []
    for state in shown:
        layers: list[Layer] = []
        if half is not None:
            low, high = _visible_band(error[:, state], half[:, state])
            near = np.clip(half[:, state], 0, max(float(np.abs(low).max()), float(np.abs(high).max())))
            layers.append(BandLayer(time, -near, near, "95 % band", "s1"))
        layers.append(Curve(time, error[:, state], "estimate − true", "s1 fine"))
        layers.append(ReferenceLine(0.0, "", "hair"))
        subplots.append(Subplot(PlotAxis("time (s)"), PlotAxis(names[state]), layers, height=135.0))
    left = f" {len(shown)} of {len(names)} states." if len(shown) < len(names) else ""
    about = f"Estimated minus true states, with the 95 % band of the estimator.{left}"
    columns = {"time (s)": time} | {f"error of {names[state]}": error[:, state] for state in shown}
    return Chart(in_rows(subplots, 1), about, table_of(columns), shared=True)


_MEASURED = "identification/measurement"
#: Most channels of a figure; width of records, px.
CHANNELS, _WIDE = 12, 1000.0


def predictions(result: Result) -> Iterator[Figure]:
    """Yield predictions over time or frequency, and the whiteness of the residuals."""
    if f"{_MEASURED}/omega" in result:
        name, title, draw = "fit", "Measured and fitted responses", _over_frequency
    else:
        name, title, draw = "prediction", "Measured and predicted", _over_time
    yield from _figures_of_records(result, _MEASURED, "predicted", name, title, draw)
    spectra = "identification/residual_spectrum"
    yield from _figures_of_records(result, spectra, "amplitude", "spectra", "Spectra", _spectra)
    group = "identification/diagnostics"
    if f"{group}/autocorrelation" in result:
        yield Figure("whiteness", "Autocorrelation of the residuals", partial(_whiteness, result, group))


def _channels(result: Result, group: str) -> list[str]:
    """Return the labels of the channels with their units."""
    measured = result[f"{group}/measured"]
    return labels_with_units(result, group, "channel", measured.shape[1], measured.units)


def _misfit(measured: Array, predicted: Array) -> Array:
    """Return the size of the residual of each channel, relative to its signal, NaN where it has none."""
    size, left = (
        np.linalg.norm(np.nan_to_num(signal), axis=0) for signal in (measured, measured - predicted)
    )
    return np.asarray(np.divide(left, size, out=np.full(size.shape, np.nan), where=size > 0))


def _drawn_channels(result: Result, misfit: Array) -> tuple[list[int], str]:
    """Return the channels that are drawn, and which of all they are, in words.

    Where the model lacks fit, the channel that it misses most is the first.
    """
    places, which = np.arange(len(misfit)), f"The first {CHANNELS}"
    if lacks_fit(result):
        places, which = np.argsort(-np.nan_to_num(misfit), kind="stable"), f"The {CHANNELS} that fit worst"
    more = f" {which} of {len(misfit)} channels." if len(misfit) > CHANNELS else ""
    return places[:CHANNELS].tolist(), more


def _channel_times(result: Result, group: str) -> Array | None:
    """Return the times of the samples of each channel (times x channels), s; None of one clock."""
    return result[f"{group}/channel_time"].data if f"{group}/channel_time" in result else None


def _over_time(result: Result, group: str) -> Chart:
    time, channels = result[f"{group}/time"].data, _channels(result, group)
    measured, predicted = result[f"{group}/measured"].data, result[f"{group}/predicted"].data
    units = texts(result, f"{group}/unit") or [result[f"{group}/measured"].units] * len(channels)
    columns, own = {"time (s)": time}, _channel_times(result, group)
    for column, channel in enumerate(channels):
        columns |= {} if own is None else {f"time of {channel} (s)": own[:, column]}
        columns |= {
            f"measured {channel}": measured[:, column],
            f"predicted {channel}": predicted[:, column],
        }
    misfit = _misfit(measured, predicted)
    drawn, more = _drawn_channels(result, misfit)
    subplots = []
    for column in drawn:
        data, model = measured[:, column], predicted[:, column]
        if own is not None:
            there = ~np.isnan(own[:, column])
            time, data, model = own[there, column], data[there], model[there]
        record, residual = (
            Curve(time, data, "measured", "s7"),
            Curve(time, data - model, "measured − predicted", "s1 fine"),
        )
        both = [
            record,
            Curve(time, model, "predicted", "s2 fine dash", difference=(record, residual)),
        ]
        subplots += [
            Subplot(PlotAxis("time (s)"), PlotAxis(channels[column]), both, height=150.0),
            Subplot(
                PlotAxis("time (s)"), PlotAxis(labelled("residual", units[column])), [residual], height=75.0
            ),
        ]
    shares = [
        f"{channels[k]}: {'no signal' if np.isnan(misfit[k]) else f'{short(100 * misfit[k], 2)} %'}"
        for k in drawn
    ]
    about = f"Residual relative to the signal: {'; '.join(shares)}.{more}"
    return Chart(in_rows(subplots, 1), about, table_of(columns), width=_WIDE, shared=True)


def _spectra(result: Result, group: str) -> Chart:
    """Return the spectra of what was measured and predicted, and of their difference."""
    record = group.replace("residual_spectrum", "measurement")
    time, channels = result[f"{record}/time"].data, texts(result, f"{record}/channel")
    measured, predicted = result[f"{record}/measured"].data, result[f"{record}/predicted"].data
    at, step = frequencies(result, f"{group}/omega"), float(time[-1] - time[0]) / (len(time) - 1)
    own, steps = _channel_times(result, record), None
    if own is not None:
        steps = np.nanmedian(np.diff(own, axis=0), axis=0)
        steps = np.where(np.abs(steps - step) < 1e-9 * step, step, steps)
    of_units = texts(result, f"{group}/unit") or [result[f"{group}/amplitude"].units] * len(channels)
    lines = {
        "measured": (spectrum(measured, step, steps)[1], "s7"),
        "predicted": (spectrum(predicted, step, steps)[1], "s2 fine dash"),
        "measured − predicted": (result[f"{group}/amplitude"].data, "s1 fine"),
    }
    drawn, more = _drawn_channels(result, _misfit(measured, predicted))
    columns, subplots = dict(at.columns), []
    for column in drawn:
        label = labelled(channels[column], of_units[column])
        layers: list[Layer] = [
            Curve(at.shown[1:], values[1:, column], name, cls) for name, (values, cls) in lines.items()
        ]
        subplots.append(Subplot(at.axis, PlotAxis(label, log=True), layers, height=130.0))
        columns |= {f"{name} {label}": values[:, column] for name, (values, _) in lines.items()}
    named = ", ".join(channels[k] for k in drawn)
    about = f"Roots of the power spectral densities (ASD, Welch) of {named}, above the frequency 0.{more}"
    return Chart(in_rows(subplots, 1), about, table_of(columns), width=_WIDE, shared=True)


def _over_frequency(result: Result, group: str) -> Chart:
    at, channels = frequencies(result, f"{group}/omega"), _channels(result, group)
    measured, predicted = result[f"{group}/measured"].data, result[f"{group}/predicted"].data
    coherence = result[f"{group}/coherence"].data if f"{group}/coherence" in result else None
    columns = dict(at.columns)
    for column, channel in enumerate(channels):
        if coherence is not None:
            columns[f"coherence {channel}"] = coherence[:, column]
        for what, values in (("measured", measured[:, column]), ("fitted", predicted[:, column])):
            columns |= {f"Re {what} {channel}": values.real, f"Im {what} {channel}": values.imag}
    drawn, more = _drawn_channels(result, _misfit(measured, predicted))
    subplots = []
    for column in drawn:
        data, model = measured[:, column], predicted[:, column]
        sizes: list[Layer] = [
            Markers(at.shown, np.abs(data), "measured", "s7", "o", 1.6),
            Curve(at.shown, np.abs(model), "fitted", "s2"),
            Curve(at.shown, np.abs(data - model), "|measured − fitted|", "s1 fine"),
        ]
        phase = (degrees(model) + 180) % 360 - 180
        phase[np.flatnonzero(np.abs(np.diff(phase)) > 180)] = np.nan  # no line where it wraps around
        phases: list[Layer] = [
            Markers(at.shown, np.rad2deg(np.angle(data)), "measured", "s7", "o", 1.6),
            Curve(at.shown, phase, "fitted", "s2"),
        ]
        upright = PlotAxis("phase (°)", step=15, low=-180, high=180)
        subplots += [
            Subplot(at.axis, PlotAxis(channels[column], log=True), sizes, height=170.0),
            Subplot(at.axis, upright, phases, height=90.0),
        ]
        if coherence is not None:
            shown: list[Layer] = [Curve(at.shown, coherence[:, column], "coherence", "s3")]
            subplots.append(Subplot(at.axis, PlotAxis("coherence", low=0, high=1.02), shown, height=60.0))
    named = ", ".join(texts(result, f"{group}/channel")[k] for k in drawn)
    about = f"Measured and fitted responses {named}, and the magnitude of their difference.{more}"
    return Chart(in_rows(subplots, 1), about, table_of(columns), width=_WIDE, shared=True)


def _whiteness(result: Result, group: str) -> Chart:
    lag, values = result[f"{group}/lag"].data, result[f"{group}/autocorrelation"].data
    bands = result[f"{group}/autocorrelation_band"].data
    there = np.flatnonzero(~np.isnan(bands))  # modes have no order
    names, values, bands = texts(result, f"{group}/channel"), values[:, there], bands[there]
    channels = [names[k] for k in there.tolist()]
    subplots = []
    for index, channel in enumerate(channels[:CHANNELS]):
        band = float(bands[index])
        layers: list[Layer] = [
            Bars(lag, np.zeros(len(lag)), values[:, index], "autocorrelation", "s1", thick=0.4),
            ReferenceLine(band, "95 % band of white noise", "s2 dashed"),
            ReferenceLine(-band, "", "s2 dashed"),
        ]
        across, up = PlotAxis("lag (samples)", step=1), PlotAxis("autocorrelation")
        subplots.append(Subplot(across, up, layers, channel, height=150.0))
    outside = int((np.abs(values) > bands).sum())
    about = f"{outside} of {values.size} values are outside the band; for white noise about 1 in 20 would be."
    columns = {"lag (samples)": lag} | {channel: values[:, k] for k, channel in enumerate(channels)}
    return Chart(in_rows(subplots), about, table_of(columns))


_GROUP, _IDENTIFIED = "structure/joints", "identification/joints"
#: Most joints that are drawn, and most bars of a force.
_JOINTS, _MOST_BARS = 8, 400
#: Half width of a 95 % interval in standard deviations.
_CONFIDENCE = 1.96


def joint_figures(result: Result) -> Iterator[Figure]:
    """Yield the force over the deflection of each joint, and what it does over time."""
    if f"{_GROUP}/force" in result:
        yield Figure("joint-loops", "Forces of joints over their deflections", partial(_loops, result))
        yield Figure("joint-histories", "Joints over time", partial(_histories, result))
    yield from _figures_of_records(
        result, _IDENTIFIED, "force", "joint-forces", "Restoring forces of joints", _restoring_forces
    )
    yield from _figures_of_records(
        result, _IDENTIFIED, "force", "joint-force-histories", "Forces of joints over time", _force_histories
    )
    if f"{_IDENTIFIED}/dissipation" in result:
        yield Figure("joint-dissipation", "Energy that joints dissipate", partial(_dissipation, result))


def _measured(result: Result, group: str, joint: int) -> tuple[Array, ...] | None:
    """Return deflection, force and its standard deviation as a record has them; None where they are not."""
    if f"{group}/measured_force" not in result:
        return None
    names = ("measured_deflection", "measured_force", "measured_deviation")
    return tuple(np.asarray(result[f"{group}/{name}"].data[:, joint]) for name in names)


def _restoring_forces(result: Result, group: str) -> Chart:
    """Return the force of the laws over the deflection: of the model, and as the record has it."""
    names, columns = texts(result, f"{group}/joint")[:_JOINTS], dict[str, Array]()
    subplots, springs = [], estimates(result)
    for k, name in enumerate(names):
        d, force, error = (
            result[f"{group}/{member}"].data[:, k] for member in ("deflection", "force", "force_deviation")
        )
        layers: list[Layer] = [Curve(d, force, "model", series_class(0))]
        columns |= {
            f"{name} deflection (m)": d,
            f"{name} force (N)": force,
            f"{name} standard error (N)": error,
        }
        if (shown := _measured(result, group, k)) is not None:
            at, measured, spread = shown
            rows = slice(None, None, max(1, len(at) // _MOST_BARS))
            across, bars = _bars(at[rows], measured[rows], _CONFIDENCE * spread[rows])
            layers = [
                Curve(across, bars, "95 % of the record", series_class(1)),
                Markers(at[rows], measured[rows], "record", series_class(1), "o", 1.6),
                *layers,
            ]
            columns |= {f"{name} measured deflection (m)": at, f"{name} measured force (N)": measured}
        subplots.append(
            Subplot(
                PlotAxis(f"{name} deflection ({_unit(result, f'{group}/deflection')})"),
                PlotAxis(f"force of laws ({_unit(result, f'{group}/force')})"),
                layers,
                height=260.0,
            )
        )
        if (spring := springs.get(f"{name}.k")) is not None:
            total = force + spring * d
            columns[f"{name} force with its linear spring (N)"] = total
            subplots.append(
                Subplot(
                    PlotAxis(f"{name} deflection ({_unit(result, f'{group}/deflection')})"),
                    PlotAxis(f"laws and linear spring ({_unit(result, f'{group}/force')})"),
                    [Curve(d, total, "model", series_class(0))],
                    height=260.0,
                )
            )
    about = (
        "Force of the laws over the deflection, alone and with the linear spring; without the damper. "
        "The force of the record is that of the law with the difference that the residual shows, smoothed; "
        "bars: 95 %."
    )
    return Chart(in_rows(subplots), about, table_of(columns))


def _bars(x: Array, y: Array, half: Array) -> tuple[Array, Array]:
    """Return upright bars of a half height as one broken line."""
    gap = np.full_like(x, np.nan)
    return np.column_stack([x, x, gap]).ravel(), np.column_stack([y - half, y + half, gap]).ravel()


def _force_histories(result: Result, group: str) -> Chart:
    """Return forces of the model and of the record over time with their bands, and regimes of the laws."""
    time, columns = np.asarray(result[f"{group}/time"].data), {}
    columns["time (s)"] = time
    subplots = []
    for k, name in enumerate(texts(result, f"{group}/joint")[:_JOINTS]):
        force, error = (result[f"{group}/{member}"].data[:, k] for member in ("force", "force_deviation"))
        layers: list[Layer] = []
        if (shown := _measured(result, group, k)) is not None:
            _, measured, spread = shown
            half = _CONFIDENCE * spread
            layers = [
                BandLayer(time, measured - half, measured + half, "record, 95 %", series_class(1)),
                Curve(time, measured, "record", series_class(1)),
            ]
            columns |= {f"{name} measured force (N)": measured, f"{name} its deviation (N)": spread}
        half = _CONFIDENCE * error
        layers += [
            BandLayer(time, force - half, force + half, "model, 95 %", series_class(0)),
            Curve(time, force, "model", series_class(0)),
        ]
        columns |= {f"{name} force (N)": force, f"{name} standard error (N)": error}
        subplots.append(
            Subplot(
                PlotAxis("time (s)"),
                PlotAxis(f"force of {name} ({_unit(result, f'{group}/force')})"),
                layers,
                height=170.0,
            )
        )
    regimes, changing = result[f"{group}/regime"].data, False
    for k, law in enumerate(texts(result, f"{group}/law")[:_JOINTS]):
        values = np.asarray(regimes[:, k], dtype=float)
        columns[law] = values
        if np.ptp(values) > 0:
            changing = True
            curve = Curve(time, values, "", series_class(6))
            subplots.append(Subplot(PlotAxis("time (s)"), PlotAxis(law), [curve], height=70.0))
    about = "Forces of the laws."
    if changing:
        about += (
            " Below, the regimes of laws that change theirs: of a slider 0 stuck and ±1 slipping, of a gap 0 "
            "open and ±1 in contact."
        )
    return Chart(in_rows(subplots, 1), about, table_of(columns), shared=True)


def _dissipation(result: Result) -> Chart:
    """Return what joints dissipate in a cycle of a sine, over its amplitude."""
    names = texts(result, f"{_IDENTIFIED}/joint")[:_JOINTS]
    amplitude, energy, error = (
        result[f"{_IDENTIFIED}/{member}"].data
        for member in ("amplitude", "dissipation", "dissipation_deviation")
    )
    subplots, columns = list[Subplot](), dict[str, Array]()
    for k, name in enumerate(names):
        half = _CONFIDENCE * error[:, k]
        layers: list[Layer] = [
            BandLayer(amplitude[:, k], energy[:, k] - half, energy[:, k] + half, "95 %", series_class(0)),
            Curve(amplitude[:, k], energy[:, k], "", series_class(0)),
        ]
        across = PlotAxis(f"{name} amplitude ({_unit(result, f'{_IDENTIFIED}/amplitude')})")
        subplots.append(Subplot(across, PlotAxis("energy a cycle (J)"), layers, height=180.0))
        columns |= {
            f"{name} amplitude (m)": amplitude[:, k], f"{name} energy (J)": energy[:, k],
            f"{name} standard error (J)": error[:, k],
        }  # fmt: skip
    about = (
        "Energy in a cycle of a steady sine, dampers of the joints included, up to the largest deflection in "
        "the records and at the rate of the motion there."
    )
    return Chart(in_rows(subplots), about, table_of(columns))


def _columns(result: Result, name: str) -> dict[str, Array]:
    """Return an array over time by the names of joints or laws."""
    axis = "law" if name == "regime" else "joint"
    names = list(map(str, result[f"{_GROUP}/{axis}"].data))[:_JOINTS]
    data = result[f"{_GROUP}/{name}"].data
    return {label: np.asarray(data[:, k], dtype=float) for k, label in enumerate(names)}


def _unit(result: Result, path: str) -> str:
    """Return the unit of an array of joints; some have rotations beside displacements."""
    return result[path].units or "SI"


def _loops(result: Result) -> Chart:
    """Return the force of the laws over the deflection: loops enclose the energy that a joint dissipates."""
    deflections, forces = _columns(result, "deflection"), _columns(result, "force")
    subplots = [
        Subplot(
            PlotAxis(f"{name} deflection ({_unit(result, f'{_GROUP}/deflection')})"),
            PlotAxis(f"force of laws ({_unit(result, f'{_GROUP}/force')})"),
            [Curve(deflections[name], force, "", series_class(0))],
        )
        for name, force in forces.items()
    ]
    ranges = [
        f"{name}: up to {short(float(np.abs(d).max(initial=0.0)))} {_unit(result, f'{_GROUP}/deflection')}"
        for name, d in deflections.items()
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
