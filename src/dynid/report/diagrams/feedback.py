"""Feedback loops: Nyquist diagrams of open loops, sensitivity functions, root loci over the gain."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dynid.number_format import counted
from dynid.report.diagrams.poles import AXES
from dynid.report.diagrams.responses import ROW, decibels, frequencies
from dynid.report.figure import CellValue, Figure, FigureTable, Picture, table_of
from dynid.report.notation import frequency_label, short
from dynid.report.plot import Curve, Layer, Markers, PlotAxis, ReferenceLine, Subplot, chart, series_class
from dynid.report.scenes import frequency_unit

if TYPE_CHECKING:
    from dynid.result import Result

_FUNCTIONS, _LOCUS = "bond_graph/sensitivity_functions", "bond_graph/root_locus"
#: Largest |L| that a Nyquist diagram shows: around -1 is where stability is decided.
_REACH = 3.0
#: Most loops that are drawn.
_LOOPS = 6


def figures(result: Result) -> Iterator[Figure]:
    """Yield the Nyquist diagrams of the loops, their sensitivity functions and their root loci."""
    if f"{_FUNCTIONS}/loop" in result:
        yield Figure("loop-nyquist", "Nyquist diagram of the loops", partial(_nyquist, result))
        yield Figure("sensitivity-functions", "Sensitivity functions", partial(_sensitivities, result))
    groups = [
        path.removesuffix("/poles") for path in result if path.startswith(_LOCUS) and path.endswith("/poles")
    ]
    for group in groups[:_LOOPS]:
        name = f"root-locus-{group.rpartition('/')[2].replace('_', '-')}"
        loop = str(result.group_attrs[group]["loop"])
        title = f"Root locus of {loop}"
        yield Figure(name, title, partial(_root_locus, result, group, name, title))


def _nyquist(result: Result) -> Picture:
    at = frequencies(result, f"{_FUNCTIONS}/omega")
    loops, responses = result[f"{_FUNCTIONS}/loop"].data, result[f"{_FUNCTIONS}/L"].data
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 121))
    subplots, columns = [], dict(at.columns)
    for loop, response in zip(loops[:_LOOPS], responses.T, strict=False):
        columns |= {f"Re L, {loop}": response.real, f"Im L, {loop}": response.imag}
        drawn = np.where(np.abs(response) <= 2 * _REACH, response, np.nan)
        size = float(np.nanmax(np.abs(drawn), initial=1.2)) if np.isfinite(drawn).any() else 1.2
        reach = min(_REACH, 1.1 * max(size, 1.2))
        layers: list[Layer] = [
            ReferenceLine(0.0, "", "frame"),
            ReferenceLine(0.0, "", "frame", upright=True),
            Curve(circle.real, circle.imag, "", "grid", name="|L| = 1"),
            Curve(drawn.real, -drawn.imag, "", "s1 fine dashed", name="negative frequencies"),
            Curve(drawn.real, drawn.imag, "", "s1", name="L", along=at.shown),
            Markers([-1.0], [0.0], "", "mark", "+", 5, ["−1"]),
        ]
        across, up = (PlotAxis(f"{part} part", low=-reach, high=reach) for part in ("real", "imaginary"))
        subplots.append(Subplot(across, up, layers, str(loop), square=True, parameter=at.axis.label))
    per_row = min(len(subplots), ROW)
    rows = [subplots[start : start + per_row] for start in range(0, len(subplots), per_row)]
    verdicts = [str(text) for text in result["bond_graph/margins/stability"].data[:_LOOPS]]
    about = (
        "L(jω) of every loop, the others closed, with delays as they are; dashed: negative frequencies; the "
        f"circle has the radius 1, the cross is −1. Closed: {'; '.join(dict.fromkeys(verdicts))}."
    )
    wide = 420.0 if per_row == 1 else 760.0
    svg = chart("loop-nyquist", "Nyquist diagram of the loops", rows, about, width=wide, height=320.0)
    return Picture(svg, about, table_of(columns))


def _sensitivities(result: Result) -> Picture:
    at = frequencies(result, f"{_FUNCTIONS}/omega")
    layers, columns = list[Layer](), dict(at.columns)
    for place, loop in enumerate(result[f"{_FUNCTIONS}/loop"].data[:_LOOPS]):
        for name, style in (("S", ""), ("T", " dashed")):
            sizes = decibels(result[f"{_FUNCTIONS}/{name}"].data[:, place])
            label = f"|{name}|, {loop}"
            layers.append(Curve(at.shown, sizes, label, f"{series_class(place)}{style}"))
            columns[f"{label} (dB)"] = sizes
    peaks = ", ".join(
        f"{loop}: Ms {short(float(Ms))}, Mt {short(float(Mt))}"
        for loop, Ms, Mt in zip(
            *(result[f"bond_graph/margins/{name}"].data[:_LOOPS] for name in ("loop", "Ms", "Mt")),
            strict=True,
        )
    )
    about = f"S = 1/(1 + L), drawn through, and T = L/(1 + L), dashed. Peaks over all frequencies: {peaks}."
    plot = Subplot(at.axis, PlotAxis("magnitude (dB)"), layers, height=260.0)
    return Picture(
        chart("sensitivity-functions", "Sensitivity functions", [[plot]], about), about, table_of(columns)
    )


def _near(result: Result, loop: str) -> float:
    """Return the size of roots that matter to the stability of a loop, rad/s."""
    place = [str(name) for name in result["bond_graph/margins/loop"].data].index(loop)
    crossings = [
        float(result[f"bond_graph/margins/{name}_crossover"].data[place]) for name in ("gain", "phase")
    ]
    return 4 * next((one for one in crossings if 0 < one < np.inf), np.inf)


def _root_locus(result: Result, group: str, name: str, title: str) -> Picture:
    unit = frequency_unit(result)
    gains, poles = result[f"{group}/gain"].data, result[f"{group}/poles"].data
    zeros = result[f"{group}/zeros"].data
    own = poles[np.abs(gains - 1).argmin()]
    notable = np.abs(np.concatenate([poles[0], own, zeros]))
    if "approximate" in result.group_attrs[group]:  # not out to the poles of the approximants
        notable = notable[notable <= _near(result, str(result.group_attrs[group]["loop"]))]
    reach = 1.5 * float(np.max(notable[np.isfinite(notable)], initial=0.1))
    layers: list[Layer] = [ReferenceLine(0.0, "", "frame"), ReferenceLine(0.0, "", "frame", upright=True)]
    for branch in poles.T:
        drawn = np.where(np.abs(branch) <= 1.5 * reach, branch, np.nan)
        layers.append(Curve(drawn.real, drawn.imag, "", "s1 fine"))
    for values, what, symbol, cls in (
        (poles[0], "poles of the open loop", "x", "s1"),
        (zeros, "zeros of the open loop", "ring", "s2"),
        (own, "poles with the gain as it is", "o", "s4"),
    ):
        inside = values[np.isfinite(values) & (np.abs(values) <= reach)]
        tips = [f"{short(r.real)} {'−+'[r.imag >= 0]} {short(abs(r.imag))}j" for r in inside.tolist()]
        layers.append(Markers(inside.real, inside.imag, what, cls, symbol, 4.5, tips))
    across, up = (PlotAxis(label, low=-reach, high=reach) for label in AXES)
    approximate = str(result.group_attrs[group].get("approximate", ""))
    note = f" {approximate[:1].upper()}{approximate[1:]}." if approximate else ""
    span = f"{short(float(gains[1]))} to {short(float(gains[-1]))}"
    about = f"{counted(poles.shape[1], 'pole')} over a factor on the gain of the loop, from {span}.{note}"
    plot = Subplot(across, up, layers, square=True, parameter=frequency_label(unit), per_y=unit.factor)
    svg = chart(name, title, [[plot]], about, width=560.0, height=420.0)
    rows: list[tuple[CellValue, ...]] = [
        (float(gain), float(pole.real), float(pole.imag))
        for gain, row in zip(gains, poles, strict=True)
        for pole in row
        if np.isfinite(pole)
    ]
    return Picture(svg, about, FigureTable(("gain", *AXES), tuple(rows[:2000])))
