"""Frequency and time responses: Bode and Nyquist diagrams, impedances, histories, bands, designs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array, ComplexArray
from dynid.report.content.design import DESIGN
from dynid.report.content.responses import BACKBONE, DERIVED, STEADY, is_requested
from dynid.report.figure import Figure, table_of
from dynid.report.notation import approximation, frequency_label, in_decibels, labelled, short
from dynid.report.plot import (
    BandLayer,
    Chart,
    Curve,
    Layer,
    Markers,
    PlotAxis,
    Subplot,
    in_rows,
    series_class,
)
from dynid.report.scenes import frequency_unit, peak_responses
from dynid.result import Result, common_unit
from dynid.units import FrequencyUnit

_NamedResponse = tuple[str, ComplexArray]
#: Most curves in one diagram; most subplots of a Nyquist grid in a row and in all; most of time responses.
CURVES, ROW, LOCI, OUTPUTS = 7, 3, 12, 12


#: Bends of a sampled locus between which it is rounded, rad.
_BENT, _CORNER = math.radians(4), math.radians(60)


@dataclass(frozen=True)
class Frequencies:
    """The frequencies of a response, rad/s, and the unit in which they are shown, that of the scene."""

    omega: Array
    unit: FrequencyUnit

    @property
    def shown(self) -> Array:
        """The frequencies in the unit in which they are shown."""
        return self.omega / (2 * math.pi) if self.unit.name == "Hz" else self.omega

    @property
    def axis(self) -> PlotAxis:
        """The axis: logarithmic if it spans more than a decade."""
        values = self.omega[self.omega > 0]
        wide = bool(len(values)) and bool(values.max() > 10 * values.min()) and len(values) == len(self.omega)
        return PlotAxis(frequency_label(self.unit), log=wide)

    @property
    def columns(self) -> dict[str, Array]:
        """Their columns in a table."""
        columns = {"angular frequency (rad/s)": self.omega}
        return columns | {frequency_label(self.unit): self.shown}


def frequencies(result: Result, path: str) -> Frequencies:
    """Return the frequencies at a path of a result."""
    return Frequencies(result[path].data, frequency_unit(result))


def decibels(values: ComplexArray) -> Array:
    """Return 20 log10 |values|; NaN where it is not finite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = 20 * np.log10(np.abs(values))
    return np.where(np.isfinite(levels), levels, np.nan)


def degrees(values: ComplexArray) -> Array:
    """Return the phase, unwrapped along the frequencies; NaN where it is undefined."""
    defined = np.isfinite(values) & (values != 0)
    phase = np.full(len(values), np.nan)
    phase[defined] = np.rad2deg(np.unwrap(np.angle(values[defined])))
    return phase


def figures(result: Result) -> Iterator[Figure]:
    """Yield the Bode and Nyquist diagrams of every group of responses, and the impedances at the port."""
    for group in ("bond_graph/frequency_response", "structure/frequency_response"):
        if f"{group}/response" in result:
            yield from _bode_and_nyquist(result, group)
    group = "bond_graph/port/frequency_response"
    if f"{group}/omega" in result:
        at = frequencies(result, f"{group}/omega")
        groups = [
            (f"Z_eq of the {side}", result[f"{group}/{side}_Z_eq"])
            for side in ("source", "load")
            if f"{group}/{side}_Z_eq" in result
        ]
        if groups:
            late = approximation(groups[0][1].attrs)
            about = f"Impedances of source and load, as seen from the port.{late}"
            shown = [(name, variable.data) for name, variable in groups]
            draw = partial(bode, about, at, shown, groups[0][1].units, "impedance")
            yield Figure("port-impedances", "Impedances at the port", draw)


def steady_states(result: Result) -> Iterator[Figure]:
    """Yield the amplitudes of steady states over the frequency, unstable ones dashed."""
    if f"{STEADY}/omega" in result:
        yield Figure("steady-states", "Steady states under a sine", partial(_steady_curve, result))
    if f"{BACKBONE}/omega" in result and len(result[f"{BACKBONE}/omega"].data):
        yield Figure("backbone", "Frequency and damping over the amplitude", partial(_backbone, result))


def _steady_curve(result: Result) -> Chart:
    at, amplitude = frequencies(result, f"{STEADY}/omega"), result[f"{STEADY}/amplitude"]
    stable = np.ones(len(at.omega), dtype=bool)
    if f"{STEADY}/stable" in result:
        stable = result[f"{STEADY}/stable"].data
    about, layers = result.group_attrs[STEADY], list[Layer]()
    for label, here, dashed in (("stable", stable, False), ("unstable", ~stable, True)):
        joined = here.copy()  # each branch begins at the last point of the one before
        joined[1:] |= here[:-1] if dashed else False
        joined[:-1] |= here[1:] if dashed else False
        if here.any():
            shown = np.where(joined, amplitude.data, np.nan)
            path = np.arange(1, len(stable) + 1)
            cls = series_class(0) + " dashed" * dashed
            layers.append(Curve(at.shown, shown, label, cls, along=path))
    if f"{BACKBONE}/omega" in result:
        along = frequencies(result, f"{BACKBONE}/omega").shown
        heights = result[f"{BACKBONE}/amplitude"].data
        layers.append(Curve(along, heights, "backbone", series_class(1), along=np.arange(len(along)) + 1))
    up = PlotAxis(labelled(f"amplitude of {about['output']}", amplitude.units))
    said = f"Half of the peak to peak displacement under {short(float(about['force']))} cos(omega t)."
    columns = at.columns | {"amplitude": amplitude.data, "stable": stable}
    return Chart(in_rows([Subplot(at.axis, up, layers)]), said, table_of(columns))


def _backbone(result: Result) -> Chart:
    at, size = frequencies(result, f"{BACKBONE}/omega"), result[f"{BACKBONE}/amplitude"]
    ratio = 100 * result[f"{BACKBONE}/damping"].data
    across = PlotAxis(labelled("amplitude", size.units), log=bool(size.data.min() > 0))
    subplots = [
        Subplot(across, at.axis, [Curve(size.data, at.shown)], height=180.0),
        Subplot(across, PlotAxis("damping ratio (%)"), [Curve(size.data, ratio)], height=180.0),
    ]
    said = f"Mode {result.group_attrs[BACKBONE]['mode']}, of periodic motions without a force."
    return Chart(
        in_rows(subplots), said, table_of(at.columns | {"amplitude": size.data, "damping (%)": ratio})
    )


def _bode_and_nyquist(result: Result, group: str) -> Iterator[Figure]:
    """Yield the Bode diagrams, in parts of at most `CURVES` curves, and the Nyquist diagram."""
    at = frequencies(result, f"{group}/omega")
    response = result[f"{group}/response"]
    outputs, inputs = (list(map(str, result[f"{group}/{axis}"].data)) for axis in ("output", "input"))
    if f"{group}/unit" in result:
        given = result[f"{group}/unit"].data.reshape(len(outputs), -1)  # of a structure one for all forces
        units = np.broadcast_to(given, (len(outputs), len(inputs))).ravel().tolist()
    else:
        units = [response.units] * (len(outputs) * len(inputs))
    top = peak_responses(result, group)
    sizes = [
        f"largest, {short(size)}," if np.isfinite(size) else "infinite" for size in top.magnitude.ravel()
    ]
    peaks = [
        f"is {size} at {short(where)} {top.unit}{note}" if size_of_all else "is 0"
        for size, size_of_all, where, note in zip(
            sizes, top.magnitude.ravel(), top.at.ravel(), top.note.ravel(), strict=True
        )
    ]
    curves = [
        (f"{output} / {source}", response.data[:, row, column])
        for row, output in enumerate(outputs)
        for column, source in enumerate(inputs)
    ]
    phases = followed_phases(result, group)
    for number, start in enumerate(range(0, len(curves), CURVES), 1):
        part = slice(start, start + CURVES)
        suffix = f"-{number}" if len(curves) > CURVES else ""
        same = common_unit(units[part])
        tops = [f"|{name}| {peak}" for (name, _), peak in zip(curves[part], peaks[part], strict=True)]
        about = f"{'; '.join(tops)}."
        absolute = group.startswith("structure") and bool(same)
        along = phases[part] if phases is not None else None
        draw = partial(bode, about, at, curves[part], same, "magnitude", absolute=absolute, phases=along)
        yield Figure(f"bode{suffix}", f"Frequency response{suffix.replace('-', ', part ')}", draw)
    yield Figure("nyquist", "Nyquist diagram", partial(_nyquist, at, curves, units, len(inputs)))


def followed_phases(result: Result, group: str) -> Array | None:
    """Return the phases of responses with delays, in degrees (curves x omega); None where there are none."""
    if f"{group}/phase" not in result:
        return None
    phase = result[f"{group}/phase"].data
    return np.asarray(phase.reshape(len(phase), -1).T)


def bode(
    about: str,
    at: Frequencies,
    curves: Sequence[_NamedResponse],
    units: str,
    quantity: str,
    *,
    absolute: bool = False,
    phases: Array | None = None,
    marks: tuple[Sequence[Layer], Sequence[Layer]] = ((), ()),
    low: float | None = None,
) -> Chart:
    """Draw magnitudes, in dB or absolute on a logarithmic axis, and phases.

    `phases`: those of the curves, in degrees, where they turn between the frequencies; default: unwrapped
    along these. `marks`: of magnitudes and of phases. `low`: the end of the axis of phases.
    """

    def headed(name: str, unit: str) -> str:
        return labelled(name, unit) if absolute else in_decibels(name, unit)

    up, down, columns = list[Layer](), list[Layer](), dict(at.columns)
    for index, (curve, values) in enumerate(curves):
        size = np.abs(values) if absolute else decibels(values)
        phase = degrees(values) if phases is None else phases[index]
        up.append(Curve(at.shown, size, curve, series_class(index)))
        down.append(Curve(at.shown, phase, "", series_class(index), name=curve))
        columns[headed(f"|{curve}|", units if absolute else units or "1")] = size
        columns[f"∠ {curve} (°)"] = phase
    magnitude_axis, phase_axis = (
        PlotAxis(headed(quantity, units), log=absolute),
        PlotAxis("phase (°)", step=15, low=low),
    )
    magnitude = Subplot(at.axis, magnitude_axis, [*up, *marks[0]], height=220.0)
    lower = Subplot(at.axis, phase_axis, [*down, *marks[1]], height=0.7 * 220.0)
    return Chart([[magnitude], [lower]], about, table_of(columns), shared=True)


def _nyquist(at: Frequencies, curves: Sequence[_NamedResponse], units: Sequence[str], inputs: int) -> Chart:
    subplots, columns = [], dict(at.columns)
    for (name, response), unit in zip(curves[:LOCI], units, strict=False):
        columns |= {f"Re {name}": response.real, f"Im {name}": response.imag}
        values = np.where(np.isfinite(response), response, np.nan)
        finite = np.flatnonzero(np.isfinite(values))
        layers: list[Layer] = [*nyquist_curves(values, at, name)]
        if finite.size:
            first = finite[0]
            tip = f"{short(at.shown[first])} {at.unit.name}"
            layers.append(Markers([values.real[first]], [values.imag[first]], "", "s1", "o", 4, [tip]))
        real, imaginary = (PlotAxis(labelled(f"{axis} part", unit)) for axis in ("real", "imaginary"))
        subplots.append(Subplot(real, imaginary, layers, name, square=True, parameter=at.axis.label))
    per_row = min(len(subplots), inputs if 1 < inputs <= ROW else ROW)
    left = f" The first {LOCI} of {len(curves)} responses." if len(curves) > LOCI else ""
    about = f"The dot is the lowest frequency, dashed lines are negative frequencies.{left}"
    width, height = 420.0 if per_row == 1 else 760.0, 300.0 if per_row < 3 else 210.0
    return Chart(in_rows(subplots, per_row), about, table_of(columns), width, height)


def nyquist_curves(response: ComplexArray, at: Frequencies, name: str) -> list[Curve]:
    """Return the locus of a response, NaN where it is not drawn, at negative and at positive frequencies."""
    locus, along = rounded_locus(response, at.shown)
    return [
        Curve(locus.real, -locus.imag, "", "s1 fine dashed", name="negative frequencies"),
        Curve(locus.real, locus.imag, "", "s1", name=name, along=along),
    ]


def rounded_locus(values: ComplexArray, at: Array) -> tuple[ComplexArray, Array]:
    """Return a locus with points between the samples where it bends, and its parameter at all of them.

    Samples are NaN where there is none; `at` is the parameter, such as the frequency. The tangent at a sample
    is that of the circle through it and its neighbours; pieces between samples are cubics with these
    tangents. Circles of resonance stay circles. Where a corner is sharper than 60°, there are too few
    samples, and the line stays straight.
    """
    steps = np.diff(values)
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = np.conj(1 / steps[:-1] + 1 / steps[1:])
        tangents /= np.abs(tangents)
        bend = np.abs(np.angle(steps[1:] / steps[:-1]))
        turn = np.angle(tangents[1:] / tangents[:-1])  # of the pieces between samples that have tangents
    points, places = [values[:1]], [at[:1]]
    for k, step in enumerate(steps.tolist()):
        if 0 < k < len(steps) - 1 and _BENT < max(bend[k - 1], bend[k]) < _CORNER:
            u = np.linspace(0, 1, math.ceil(max(bend[k - 1], bend[k]) / _BENT) + 1)[1:-1]
            reach = abs(step) / math.cos(turn[k - 1] / 4) ** 2
            first, last = reach * tangents[k - 1], reach * tangents[k]
            points.append(
                (1 - u) ** 2 * (1 + 2 * u) * values[k]
                + u**2 * (3 - 2 * u) * values[k + 1]
                + u * (1 - u) * ((1 - u) * first - u * last)
            )
            places.append(at[k] + u * (at[k + 1] - at[k]))
        points.append(values[k + 1 : k + 2])
        places.append(at[k + 1 : k + 2])
    return np.concatenate(points), np.concatenate(places)


def time_responses(result: Result) -> Iterator[Figure]:
    """Yield the responses over time."""
    for group in ("bond_graph/time_response", "structure/time_response"):
        if f"{group}/response" in result:
            yield Figure("time-response", "Time response", partial(_time_response, result, group))


def _time_response(result: Result, group: str) -> Chart:
    time = result[f"{group}/time"].data
    outputs = _columns(result, group, "response", "output", "unit")
    sources = _columns(result, group, "input", "source", "input_unit") if f"{group}/input" in result else {}
    shown = list(outputs.items())[:OUTPUTS]
    height = 240.0 if len(shown) == 1 else 150.0
    compared = f"{group}/nonlinear" in result
    laws = dict(_columns(result, group, "nonlinear", "output", "unit")) if compared else {}
    curves = [
        (name, Curve(time, values, "linear" * compared, series_class(0)), height) for name, values in shown
    ]
    moving = {name: values for name, values in sources.items() if np.any(np.asarray(values) != 0)}
    curves += [(n, Curve(time, values, "", series_class(6)), 90.0) for n, values in list(moving.items())[:3]]
    ranges = []
    for name, values in shown:
        both = {"linear ": values, "nonlinear ": laws[name]} if name in laws else {"": values}
        spans = [
            f"{law}{short(np.nanmin(data))} … {short(np.nanmax(data))}"
            for law, data in both.items()
            if np.isfinite(data).any()
        ]
        ranges += [f"{name}: {', '.join(spans)}"] if spans else []
    way = "" if moving else "Free response to the initial state. "
    left = f" The first {OUTPUTS} of {len(outputs)} responses." if len(outputs) > OUTPUTS else ""
    about = f"{way}{'; '.join(ranges)}, over {short(float(time[-1] - time[0]))} s.{left}"
    subplots = []
    for name, curve, tall in curves:
        beside = [Curve(time, laws[name], "nonlinear", series_class(1))] if name in laws else []
        subplots.append(Subplot(PlotAxis("time (s)"), PlotAxis(name), [curve, *beside], height=tall))
    also = {f"nonlinear {name}": values for name, values in laws.items()}
    table = table_of({"time (s)": time, **dict(shown), **also, **moving})
    return Chart(in_rows(subplots, 1), about, table, shared=True)


def _columns(result: Result, group: str, name: str, axis: str, unit: str) -> Mapping[str, ArrayLike]:
    """Return the columns of an array over time, by their names with units."""
    variable = result[f"{group}/{name}"]
    names = list(map(str, result[f"{group}/{axis}"].data))
    units = result[f"{group}/{unit}"].data if f"{group}/{unit}" in result else [variable.units] * len(names)
    if variable.data.ndim == 3:  # each source alone
        sources = result[f"{group}/source"].data
        return {
            labelled(f"{label} to {source}", str(its) or "SI"): variable.data[:, k, m]
            for k, (label, its) in enumerate(zip(names, units, strict=True))
            for m, source in enumerate(sources)
        }
    return {
        labelled(label, str(its) or "SI"): variable.data[:, k]
        for k, (label, its) in enumerate(zip(names, units, strict=True))
    }


#: Most responses with bands, and most designed channels, that are drawn.
_DERIVED = 6


def identified_responses(result: Result) -> Iterator[Figure]:
    """Yield magnitude and phase of each derived response, with bands, where they were requested."""
    beginning, end = f"{DERIVED}/frequency_response/", "/magnitude/value"
    groups = [path.removesuffix(end) for path in result if path.startswith(beginning) and path.endswith(end)]
    for group in groups[: _DERIVED if is_requested(result) else 0]:
        pair = group.removeprefix(beginning)
        name, title = f"identified-response-{pair.replace('/', '-')}", f"Identified response {pair}"
        yield Figure(name, title, partial(_identified, result, group, pair))


def _identified(result: Result, group: str, pair: str) -> Chart:
    at = frequencies(result, f"{group}/magnitude/omega")
    columns, rows = dict(at.columns), []
    for name, factor in (("magnitude", 1.0), ("phase", 180 / np.pi)):
        value, low, high = (factor * result[f"{group}/{name}/{end}"].data for end in ("value", "low", "high"))
        unit = "°" if name == "phase" else result[f"{group}/{name}/value"].units
        logarithmic = name == "magnitude" and bool(np.all(low > 0))
        axis = PlotAxis(labelled(name, unit), log=logarithmic)
        layers: list[Layer] = [
            BandLayer(at.shown, low, high, "95 % band", "s1"),
            Curve(at.shown, value, "identified", "s1"),
        ]
        rows.append([Subplot(at.axis, axis, layers, height=220.0)])
        columns |= {
            labelled(f"{name}{word}", unit): bound
            for word, bound in (("", value), (", low", low), (", high", high))
        }
    about = f"Frequency response {pair} of the identified model, with its 95 % band."
    return Chart(rows, about, table_of(columns), shared=True)


def designed_responses(result: Result) -> Iterator[Figure]:
    """Yield magnitude and phase of every channel with a target, as designed and at the start."""
    group = f"{DESIGN}/frequency_response"
    if f"{group}/designed" not in result:
        return
    at = frequencies(result, f"{group}/omega")
    for index, name in enumerate(result[f"{group}/channel"].data[:_DERIVED]):
        designs = ("designed", "start")
        curves = [(design, result[f"{group}/{design}"].data[:, index]) for design in designs]
        unit = str(result[f"{group}/unit"].data[index])
        of = f" {unit}" if unit not in ("", "1") else ""
        last, first = (f"{float(np.max(np.abs(values))):.4g}{of}" for _, values in curves)
        about = (
            f"Frequency response of {name} at the start of the design and as designed; over these "
            f"frequencies at most {first} and {last}."
        )
        draw = partial(bode, about, at, curves, "1", "magnitude")
        yield Figure(f"design{f'-{index + 1}' if index else ''}", f"Design of {name}", draw)
