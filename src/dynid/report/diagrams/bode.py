"""Bode and Nyquist diagrams of bond graphs and structures, and the impedances on both sides of a port."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.report.diagrams.frequencies import Frequencies, bode_panels, decibels, degrees, frequencies
from dynid.report.figure import Figure, Picture
from dynid.report.numbers import in_decibels, labelled, short
from dynid.report.plot import Axis, Line, Marks, Panel, chart, listed
from dynid.result import common_unit

if TYPE_CHECKING:
    from dynid.report.plot.layers import Layer
    from dynid.result import Result

Complex = NDArray[np.complex128]
Curve = tuple[str, Complex]
#: The most curves in one diagram, and the most panels of a Nyquist grid in a row and in all.
CURVES, ROW, PANELS = 7, 3, 12


def figures(result: Result) -> Iterator[Figure]:
    """Yield the diagrams of every group of responses."""
    for group in ("bond_graph/frequency_response", "structure/frequency_response"):
        if f"{group}/response" in result:
            yield from _responses(result, group)
    group = "bond_graph/port/frequency_response"
    if f"{group}/omega" in result:
        yield from _port(result, group)


def _responses(result: Result, group: str) -> Iterator[Figure]:
    at = frequencies(result, f"{group}/omega")
    response = result[f"{group}/response"]
    outputs, inputs = (list(map(str, result[f"{group}/{axis}"].data)) for axis in ("output", "input"))
    units = _units(result, group, len(outputs), len(inputs))
    curves = [
        (f"{output} / {source}", response.data[:, row, column])
        for row, output in enumerate(outputs)
        for column, source in enumerate(inputs)
    ]
    pieces = [curves[start : start + CURVES] for start in range(0, len(curves), CURVES)]
    for number, piece in enumerate(pieces, 1):
        suffix = f"-{number}" if len(pieces) > 1 else ""
        same = common_unit(units[(number - 1) * CURVES : number * CURVES])
        yield Figure(
            f"bode{suffix}",
            f"Frequency response{suffix.replace('-', ', part ')}",
            partial(_bode, f"bode{suffix}", at, piece, same, group.startswith("structure") and bool(same)),
        )
    yield Figure("nyquist", "Nyquist diagram", partial(_nyquist, at, curves, units, len(inputs)))


def _units(result: Result, group: str, outputs: int, inputs: int) -> list[str]:
    """Return the unit of every response, input by input of each output; empty where none is known."""
    path = f"{group}/unit"
    if path not in result:
        return [result[f"{group}/response"].units] * (outputs * inputs)
    given = result[path].data.reshape(outputs, -1)  # of a structure one for all forces
    return np.broadcast_to(given, (outputs, inputs)).ravel().tolist()


def _bode(name: str, at: Frequencies, curves: Sequence[Curve], units: str, absolute: bool) -> Picture:
    label = labelled("magnitude", units) if absolute else in_decibels("magnitude", units)
    panels = bode_panels(at, curves, label, absolute=absolute)
    svg = chart(name, "Frequency response", [[panel] for panel in panels], _peaks(at, curves), shared=True)
    columns = dict(at.columns)
    for curve, values in curves:
        own = f"|{curve}|"
        title = labelled(own, units) if absolute else in_decibels(own, units or "1")
        columns[title] = np.abs(values) if absolute else decibels(values)
        columns[f"∠ {curve} (°)"] = degrees(values)
    return Picture(svg, _peaks(at, curves), listed(columns))


def _peaks(at: Frequencies, curves: Sequence[Curve]) -> str:
    """Say where the responses are largest."""
    parts = []
    for name, values in curves[:3]:
        size = np.abs(values)
        if np.isfinite(size).any():
            place = int(np.nanargmax(np.where(np.isfinite(size), size, np.nan)))
            unit = "Hz" if at.hertz else "rad/s"
            parts.append(f"|{name}| is largest, {short(size[place])}, at {short(at.shown[place])} {unit}")
    text = "; ".join(parts)
    return f"{text}." if text else "Magnitude and phase over frequency."


def _nyquist(at: Frequencies, curves: Sequence[Curve], units: Sequence[str], inputs: int) -> Picture:
    shown = curves[:PANELS]
    panels = [_locus(at, name, values, unit) for (name, values), unit in zip(shown, units, strict=False)]
    per_row = min(len(panels), inputs if 1 < inputs <= ROW else ROW)
    rows = [panels[start : start + per_row] for start in range(0, len(panels), per_row)]
    left = f" The first {PANELS} of {len(curves)} responses." if len(curves) > PANELS else ""
    about = f"From the dot with growing frequency; dashed: negative frequencies; the cross is −1.{left}"
    wide = 420.0 if per_row == 1 else 760.0
    svg = chart("nyquist", "Nyquist diagram", rows, about, width=wide, height=300.0 if per_row < 3 else 210.0)
    columns = dict(at.columns)
    for name, values in shown:
        columns |= {f"Re {name}": values.real, f"Im {name}": values.imag}
    return Picture(svg, about, listed(columns))


def _locus(at: Frequencies, name: str, values: Complex, units: str) -> Panel:
    values = np.where(np.isfinite(values), values, np.nan)
    unit = "Hz" if at.hertz else "rad/s"
    known = np.flatnonzero(np.isfinite(values))
    layers: list[Layer] = [
        Line(values.real, -values.imag, "", "s1 fine dashed"),
        Line(values.real, values.imag, "", "s1"),
        Marks([-1.0], [0.0], "", "mark", "+", 5, ["−1"]) if _near(values) else Marks([], []),
    ]
    if known.size:
        first = known[0]
        tip = f"{short(at.shown[first])} {unit}"
        layers.append(Marks([values.real[first]], [values.imag[first]], "", "s1", "o", 4, [tip]))
    real, imaginary = (Axis(labelled(f"{part} part", units)) for part in ("real", "imaginary"))
    return Panel(real, imaginary, layers, name, square=True)


def _near(values: Complex) -> bool:
    """Tell whether −1 is at the scale of a response."""
    size = np.nanmax(np.abs(values)) if np.isfinite(values).any() else 0.0
    return bool(0.05 < size < 1e3)


def _port(result: Result, group: str) -> Iterator[Figure]:
    at = frequencies(result, f"{group}/omega")
    curves = [
        (f"Z_eq of the {side}", result[f"{group}/{side}_Z_eq"])
        for side in ("source", "load")
        if f"{group}/{side}_Z_eq" in result
    ]
    if curves:
        units = curves[0][1].units
        drawn = [(name, variable.data) for name, variable in curves]
        yield Figure("port-impedances", "Impedances at the port", partial(_impedances, at, drawn, units))


def _impedances(at: Frequencies, curves: Sequence[Curve], units: str) -> Picture:
    panels = bode_panels(at, curves, in_decibels("impedance", units))
    about = "Source and load as seen from the port; where they meet, they exchange most."
    svg = chart("port-impedances", "Impedances at the port", [[p] for p in panels], about, shared=True)
    columns = dict(at.columns)
    for name, values in curves:
        columns[in_decibels(f"|{name}|", units or "1")] = decibels(values)
        columns[f"∠ {name} (°)"] = degrees(values)
    return Picture(svg, about, listed(columns))
