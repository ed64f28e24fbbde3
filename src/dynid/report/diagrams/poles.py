"""Pole–zero maps with error discs and hidden modes, root loci, and Nyquist diagrams of feedback loops."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import ComplexArray
from dynid.number_format import counted
from dynid.report.diagrams.responses import (
    ROW,
    bode,
    decibels,
    degrees,
    followed_phases,
    frequencies,
    nyquist_curves,
)
from dynid.report.figure import CellValue, Figure, FigureTable, evenly_spaced, table_of
from dynid.report.notation import approximation, frequency_label, short
from dynid.report.plot import (
    Annotation,
    Chart,
    Curve,
    Layer,
    LegendEntry,
    Markers,
    PlotAxis,
    ReferenceLine,
    Subplot,
    in_rows,
    series_class,
)
from dynid.report.scenes import frequency_unit
from dynid.result import Result
from dynid.units import FrequencyUnit

if TYPE_CHECKING:
    from dynid.report.diagrams.study_samples import StudyNumbers, StudyVariable


Roots = tuple[str, ComplexArray, NDArray[np.float64]]
_TRANSFER_FUNCTION = "bond_graph/transfer_function"
#: Ratio of successive magnitudes above which the smaller roots have a subplot of their own.
_FAR = 25.0
#: Ratio of the ranges of a map beyond which equal scales would place all its roots on a line.
_FLAT = 6.0
_DAMPING = (0.1, 0.3, 0.5, 0.7, 0.9)
_MOST = 400
_SYMBOLS = {"pole": ("x", "s1"), "zero": ("ring", "s2"), "hidden mode": ("kite", "s4")}
#: Labels of the axes.
AXES = ("real part (rad/s)", "imaginary part (rad/s)")
#: Most samples of a root locus that are drawn.
POINTS = 600
#: Lines on which the real or the imaginary part is zero.
_ORIGIN = (ReferenceLine(0.0, "", "frame"), ReferenceLine(0.0, "", "frame", upright=True))


def figures(result: Result) -> Iterator[Figure]:
    """Yield the pole–zero map of every transfer function."""
    groups = dict.fromkeys(
        path.rpartition("/")[0]
        for path in result
        if path.startswith(_TRANSFER_FUNCTION) and path.endswith(("/poles", "/zeros"))
    )
    for group in groups:
        pair = group.removeprefix(f"{_TRANSFER_FUNCTION}/")
        output, _, source = pair.rpartition("/")
        name, title = f"poles-{pair.replace('/', '-')}", f"Poles and zeros of {output} / {source}"
        yield Figure(name, title, partial(_pole_zero_maps, result, group))


def roots_of(result: Result, group: str) -> list[Roots]:
    """Return poles, zeros and hidden modes with the bounds of their errors (NaN: unknown)."""
    roots = []
    for what in ("pole", "zero"):
        if f"{group}/{what}s" in result:
            values = result[f"{group}/{what}s"].data
            path = f"{group}/{what}_error_bound"
            bounds = result[path].data if path in result else np.full(len(values), np.nan)
            roots.append((what, values, bounds))
    path = f"bond_graph/properties/{group.removeprefix(f'{_TRANSFER_FUNCTION}/')}/hidden_modes"
    if path in result and len(result[path].data):
        values = result[path].data
        roots.append(("hidden mode", values, np.full(len(values), np.nan)))
    return roots


def _pole_zero_maps(result: Result, group: str) -> Chart:
    kinds, unit = roots_of(result, group), frequency_unit(result)
    rows: list[tuple[CellValue, ...]] = []
    for what, values, bounds in kinds:
        for value, bound in zip(values.tolist(), bounds, strict=True):
            damping = -value.real / abs(value) if abs(value) > 0 else math.nan
            rows.append((what, value.real, value.imag, unit.factor * abs(value), damping, float(bound)))
    sizes = np.abs(np.concatenate([values for _, values, _ in kinds] or [np.zeros(0, complex)]))
    # Roots that lie before a wide gap of magnitudes have a second map.
    positive = np.sort(sizes[np.isfinite(sizes) & (sizes > 0)])
    extent = float(positive[-1]) if positive.size else 1.0
    wide = np.flatnonzero(positive[1:] / positive[:-1] > _FAR)
    if not positive.size or (extent / positive[0] <= 2 * _FAR and not wide.size):
        maps = [_map(kinds, extent, "", unit)]
    else:
        near = positive[wide[-1]] if wide.size else positive[positive <= extent / _FAR][-1]
        maps = [_map(kinds, extent, "all", unit), _map(kinds, float(near), "near the origin", unit)]
    counts = ", ".join(f"{len(values)} {what}{'s' * (len(values) != 1)}" for what, values, _ in kinds)
    bounds = np.concatenate([b for _, _, b in kinds] or [np.zeros(0)])
    known = bounds[np.isfinite(bounds)]
    certified = ""
    if known.size:
        drawn = any(isinstance(layer, Curve) and layer.cls == "s3 fine" for layer in maps[0].layers)
        where = "drawn as discs" if drawn else "too small to be seen, listed in the table"
        certified = f" Certified error bounds, at most {short(float(known.max()), 2)} rad/s: {where}."
    attributes = [
        result[f"{group}/{what}s"].attrs for what in ("pole", "zero") if f"{group}/{what}s" in result
    ]
    late = next(filter(None, map(approximation, attributes)), "")
    notes = zip((f"{what}s" for what, *_ in kinds), attributes, strict=False)
    certified += "".join(f" Of {what}: {attrs['note']}." for what, attrs in notes if "note" in attrs)
    if late and certified:
        certified += " They bound the errors of the roots of the approximants."
    grid = "dashed: constant damping ratio; circles: constant natural frequency"
    about = f"{counts}; {grid}.{late}{certified}"
    if not all(plot.square for plot in maps):
        about += " Real and imaginary parts have different scales."
    legend = [LegendEntry(f"{what}s", *_SYMBOLS[what]) for what, values, _ in kinds if len(values)]
    width = 480.0 if len(maps) == 1 else 860.0
    columns = (
        f"root{' (approximate)' if late else ''}",
        *AXES,
        f"{unit.symbol}_n ({unit.name})",
        "ζ",
        "error bound (rad/s)",
    )
    return Chart([maps], about, FigureTable(columns, tuple(rows)), width, 360.0, legend=legend)


def _root_text(root: complex) -> str:
    """Return a root with four digits."""
    return f"{short(root.real)} {'−+'[root.imag >= 0]} {short(abs(root.imag))}j"


def _map(kinds: Sequence[Roots], reach: float, title: str, unit: FrequencyUnit) -> Subplot:
    """Return the subplot of the roots within a distance from the origin."""
    within = [
        (what, values[np.abs(values) <= 1.001 * reach], bounds[np.abs(values) <= 1.001 * reach])
        for what, values, bounds in kinds
    ]
    every = np.concatenate([values for _, values, _ in within] or [np.zeros(0, complex)])
    layers = list[Layer]()
    wide, tall = (reach * (0.06 if part.any() else 0.4) for part in (every.real, every.imag))
    space = 1.14 * np.append(every, [-wide, wide, 1j * tall, -1j * tall])
    ranges = np.ptp(space.real), np.ptp(space.imag)
    square = bool(max(ranges) < _FLAT * min(ranges))
    if every.size and (every.real < 0).any():
        for zeta in _DAMPING:  # lines of constant damping ratio
            ray = reach * complex(-zeta, math.sqrt(1 - zeta * zeta))
            inside = 0.92 * min(float(space.real.min()) / ray.real, float(space.imag.max()) / ray.imag)
            end, at = 4 * ray, (1.08 if square else inside) * ray
            line = [end.real, 0, end.real], [end.imag, 0, -end.imag]
            layers.append(Curve(*line, "", "grid dashed", spans=False))
            # Beyond the circles, of which there is little on different scales: there within the frame.
            anchor, shift = ("end", (-3.0, 3.0)) if square else ("start", (4.0, 3.0))
            layers.append(Annotation(at.real, at.imag, f"ζ {zeta:g}", "small muted", anchor, shift))
        half_turn = np.exp(1j * np.linspace(0.5 * np.pi, 1.5 * np.pi, 61))
        for share in (0.25, 0.5, 0.75, 1.0):  # circles of constant natural frequency
            circle = share * reach * half_turn
            layers.append(Curve(circle.real, circle.imag, "", "grid", spans=False))
    layers += _ORIGIN
    turn = np.exp(1j * np.linspace(0, 2 * np.pi, 73))
    for what, values, bounds in within:
        symbol, cls = _SYMBOLS[what]
        counts = Counter(values[:_MOST].tolist())
        tips = []
        for root, count in counts.items():
            shown = f" ({unit.text(abs(root))})" if unit.name != "rad/s" and root.imag else ""
            tips.append(f"{what} {_root_text(root)} rad/s{shown}" + (f", {count} times" if count > 1 else ""))
        points = np.array(list(counts), dtype=complex)
        size = 8 if symbol == "kite" else 5
        layers.append(Markers(points.real, points.imag, "", cls, symbol, size, tips))
        layers += [
            Annotation(root.real, root.imag, f"×{count}", f"small {cls}", shift=(7.0, -5.0))
            for root, count in counts.items()
            if count > 1
        ]
        for root, bound in zip(values.tolist(), bounds, strict=True):
            if bound > reach / 300:
                disc = root + bound * turn
                layers.append(Curve(disc.real, disc.imag, "", "s3 fine", spans=False))
    across = PlotAxis(AXES[0], low=float(space.real.min()), high=float(space.real.max()))
    up = PlotAxis(AXES[1], low=float(space.imag.min()), high=float(space.imag.max()))
    over = frequency_label(unit)
    return Subplot(across, up, layers, title, square=square, parameter=over, per_y=unit.factor)


def root_loci(result: Result) -> Iterator[Figure]:
    """Yield a root locus for each array of poles or zeros of a study over one parameter."""
    from dynid.report.diagrams.study_samples import StudyNumbers

    numbers = StudyNumbers(result)
    if len(numbers.inputs) != 1:
        return
    parameter = numbers.inputs[0]
    groups = dict.fromkeys(
        path.rpartition("/")[0]
        for path in numbers.table.paths
        if path.endswith(("/poles", "/zeros")) and numbers.table.variable(path).dtype.kind == "c"
    )
    for group in groups:
        pair = group.removeprefix(f"{_TRANSFER_FUNCTION}/")
        name, title = f"root-locus-{pair.replace('/', '-')}", f"Root locus of {pair} over {parameter.name}"
        yield Figure(name, title, partial(_study_locus, numbers, parameter, group))


def _study_locus(numbers: StudyNumbers, parameter: StudyVariable, group: str) -> Chart:
    order = np.argsort(parameter.values, kind="stable")
    drawn = order[evenly_spaced(len(order), POINTS)]
    layers: list[Layer] = [*_ORIGIN]
    rows: list[tuple[CellValue, ...]] = []
    note = ""
    for what, symbol, cls in (("poles", "x", "s1"), ("zeros", "ring", "s2")):
        path = f"{group}/{what}"
        if path not in numbers.table.paths:
            continue
        variable = numbers.table.variable(path)
        note, roots = approximation(variable.attrs), variable.data[drawn]  # samples x roots
        kept = np.isfinite(roots)
        values, opacity = (
            np.broadcast_to(column[:, None], roots.shape)[kept].tolist()
            for column in (parameter.values[drawn], np.linspace(0.25, 1.0, len(roots)))
        )
        roots = roots[kept]
        tips = [
            f"{parameter.name} {short(value)}: {_root_text(root)}"
            for root, value in zip(roots.tolist(), values, strict=True)
        ]
        layers.append(Markers(roots.real, roots.imag, what, cls, symbol, 3.5, tips, opacity))
        rows += zip(values, [what[:-1]] * len(tips), roots.real.tolist(), roots.imag.tolist(), strict=True)
    ends = parameter.values[order[[0, -1]]]
    about = (
        f"{parameter.path} from {short(float(ends[0]))} (faint) to {short(float(ends[1]))} (opaque).{note}"
    )
    plot = Subplot(PlotAxis(AXES[0]), PlotAxis(AXES[1]), layers, square=True)
    table = FigureTable((parameter.label, "root", *AXES), tuple(rows[:1000]))
    return Chart([[plot]], about, table, width=560.0, height=420.0)


_FUNCTIONS, _LOCUS = "bond_graph/sensitivity_functions", "bond_graph/root_locus"
#: Largest |L| that a Nyquist diagram shows: around -1 is where stability is decided.
_REACH = 2.0
#: Most loops that are drawn.
_LOOPS = 6
#: Reach of a root locus in z around the unit circle; twice it at the most.
_CIRCLE_REACH = 1.25
#: How far the phases of open loops with delays are drawn at least, degrees below 0.
_DRAWN_PHASE = 540.0
_AXES_OF_Z = ("real part of z", "imaginary part of z")


def loops(result: Result) -> Iterator[Figure]:
    """Yield the Nyquist diagrams of the loops, their sensitivity functions and their root loci."""
    if f"{_FUNCTIONS}/loop" in result:
        yield Figure("loop-bode", "Bode diagram of the open loops", partial(_open_loops, result))
        yield Figure("loop-nyquist", "Nyquist diagram of the loops", partial(_nyquist, result))
        yield Figure("sensitivity-functions", "Sensitivity functions", partial(_sensitivities, result))
    groups = [
        path.removesuffix("/poles") for path in result if path.startswith(_LOCUS) and path.endswith("/poles")
    ]
    for group in groups[:_LOOPS]:
        name = f"root-locus-{group.rpartition('/')[2].replace('_', '-')}"
        title = f"Root locus of {result.group_attrs[group]['loop']}"
        yield Figure(name, title, partial(_root_locus, result, group))


def _open_loops(result: Result) -> Chart:
    """Draw L(jω) of every loop, with the margins where they are read off."""
    at = frequencies(result, f"{_FUNCTIONS}/omega")
    names, responses = result[f"{_FUNCTIONS}/loop"].data, result[f"{_FUNCTIONS}/L"].data
    curves = [(str(name), responses[:, k]) for k, name in enumerate(names[:_LOOPS])]
    phases, factor = followed_phases(result, _FUNCTIONS), at.unit.factor
    margins = {
        name: result[f"bond_graph/margins/{name}"].data
        for name in ("stable", "gain", "phase", "gain_crossover", "phase_crossover", "delay")
    }
    up: list[Layer] = [Curve(at.shown[[0, -1]], [0.0, 0.0], "", "grid", name="|L| = 1")]
    down, texts, lowest = list[Layer](), [], -_DRAWN_PHASE
    for k, (name, response) in enumerate(curves):
        phase = degrees(response) if phases is None else phases[k]
        gain, angle, crossover, where, delay = (float(margins[key][k]) for key in [*margins][1:])
        if not margins["stable"][k]:
            texts.append(f"{name}: not defined (not stable)")
            continue
        late = f"{short(delay)} s" if np.isfinite(delay) else "∞"
        texts.append(
            f"{name}: gain {short(gain)}, phase {short(angle)}{'°' * math.isfinite(angle)}, delay {late}"
        )
        if np.isfinite(angle) and at.omega[0] <= crossover <= at.omega[-1]:
            reached = float(np.interp(np.log(crossover), np.log(at.omega), phase))
            lowest = min(lowest, reached - 180)
            limits = [360 * round((reached + way + 180) / 360) - 180 for way in (-angle, angle)]
            limit = min(limits, key=lambda odd: abs(abs(reached - odd) - angle))  # a multiple of 180°
            ends, title = [crossover * factor] * 2, f"phase margin {angle:.4g}°, delay margin {late}"
            down.append(Curve(ends, [limit, reached], "", series_class(k), name=title))
            down.append(Markers(ends[:1], [reached], "", series_class(k), "o", 4, [title]))
        if np.isfinite(gain) and gain > 0 and at.omega[0] <= where <= at.omega[-1]:
            level, ends = -20 * math.log10(gain), [where * factor] * 2
            title = f"gain margin {gain:.4g}"
            up.append(Curve(ends, [level, 0.0], "", series_class(k), name=title))
            up.append(Markers(ends[:1], [level], "", series_class(k), "o", 4, [title]))
    about = f"L(jω) of every loop, the others closed; margins are marked. {'; '.join(texts)}."
    turning = phases is not None and phases.min() < lowest  # delays turn them on and on
    return bode(
        about,
        at,
        curves,
        "1",
        "magnitude of L",
        phases=phases,
        marks=(up, down),
        low=lowest if turning else None,
    )


def _nyquist(result: Result) -> Chart:
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
            *_ORIGIN,
            Curve(circle.real, circle.imag, "", "grid", name="|L| = 1"),
            *nyquist_curves(drawn, at, "L"),
            Markers([-1.0], [0.0], "", "mark", "+", 5, ["−1"]),
        ]
        across, up = (PlotAxis(f"{axis} part", low=-reach, high=reach) for axis in ("real", "imaginary"))
        subplots.append(Subplot(across, up, layers, str(loop), square=True, parameter=at.axis.label))
    per_row = min(len(subplots), ROW)
    verdicts = [str(text) for text in result["bond_graph/margins/stability"].data[:_LOOPS]]
    late = ", with delays as they are" if "delays" in result.group_attrs.get("bond_graph", {}) else ""
    about = (
        f"L(jω) of every loop, the others closed{late}; dashed: negative frequencies; the "
        f"circle has the radius 1, the cross is −1. Closed: {'; '.join(dict.fromkeys(verdicts))}."
    )
    width = 420.0 if per_row == 1 else 760.0
    return Chart(in_rows(subplots, per_row), about, table_of(columns), width, 320.0)


def _sensitivities(result: Result) -> Chart:
    at = frequencies(result, f"{_FUNCTIONS}/omega")
    layers, columns = list[Layer](), dict(at.columns)
    for index, loop in enumerate(result[f"{_FUNCTIONS}/loop"].data[:_LOOPS]):
        for name, style in (("S", ""), ("T", " dashed")):
            sizes = decibels(result[f"{_FUNCTIONS}/{name}"].data[:, index])
            label = f"|{name}|, {loop}"
            layers.append(Curve(at.shown, sizes, label, f"{series_class(index)}{style}"))
            columns[f"{label} (dB)"] = sizes
    names = ("loop", "stable", "Ms", "Mt")
    margins = zip(*(result[f"bond_graph/margins/{name}"].data[:_LOOPS] for name in names), strict=True)
    peaks = ", ".join(
        f"{loop}: Ms {short(float(Ms))}, Mt {short(float(Mt))}"
        if stable
        else f"{loop}: not defined (not stable)"
        for loop, stable, Ms, Mt in margins
    )
    about = f"S = 1/(1 + L), drawn through, and T = L/(1 + L), dashed. Peaks over all frequencies: {peaks}."
    plot = Subplot(at.axis, PlotAxis("magnitude (dB)"), layers, height=260.0)
    return Chart([[plot]], about, table_of(columns), shared=True)


def _root_locus(result: Result, group: str) -> Chart:
    unit = frequency_unit(result)
    gains, poles = result[f"{group}/gain"].data, result[f"{group}/poles"].data
    zeros = result[f"{group}/zeros"].data
    closed_poles = poles[np.abs(gains - 1).argmin()]
    notable = np.abs(np.concatenate([poles[0], closed_poles, zeros]))
    about_locus = result.group_attrs[group]
    discrete = about_locus.get("plane") == "z"
    if "note" in about_locus:  # of infinitely many poles those around the crossings
        loop = [str(name) for name in result["bond_graph/margins/loop"].data].index(str(about_locus["loop"]))
        crossings = [
            float(result[f"bond_graph/margins/{name}"].data[loop])
            for name in ("gain_crossover", "phase_crossover", "modulus_at")
        ]
        notable = notable[notable <= 4 * next((one for one in crossings if 0 < one < np.inf), np.inf)]
    reach = 1.5 * float(np.max(notable[np.isfinite(notable)], initial=0.1))
    layers: list[Layer] = [*_ORIGIN]
    if discrete:
        reach = max(reach, _CIRCLE_REACH) if reach < 2 * _CIRCLE_REACH else 2 * _CIRCLE_REACH
        circle = np.exp(1j * np.linspace(0, 2 * np.pi, 121))
        layers.append(Curve(circle.real, circle.imag, "", "grid", name="|z| = 1"))
    for branch in poles.T:
        drawn = np.where(np.abs(branch) <= 1.5 * reach, branch, np.nan)
        layers.append(Curve(drawn.real, drawn.imag, "", "s1 fine"))
    for values, what, symbol, cls in (
        (poles[0], "poles of the open loop", "x", "s1"),
        (zeros, "zeros of the open loop", "ring", "s2"),
        (closed_poles, "poles with the gain as it is", "o", "s4"),
    ):
        inside = values[np.isfinite(values) & (np.abs(values) <= reach)]
        tips = [f"{root:.4g}" if discrete else _root_text(root) for root in inside.tolist()]
        if len(inside):
            layers.append(Markers(inside.real, inside.imag, what, cls, symbol, 4.5, tips))
    axes = _AXES_OF_Z if discrete else AXES
    across, up = (PlotAxis(label, low=-reach, high=reach) for label in axes)
    note = f"; {about_locus['note']}" if "note" in about_locus else ""
    span = f"{short(float(gains[1]))} to {short(float(gains[-1]))}"
    about = f"{counted(poles.shape[1], 'pole')} over a factor on the gain of the loop, from {span}{note}."
    parameter, per_y = ("", 0.0) if discrete else (frequency_label(unit), unit.factor)
    plot = Subplot(across, up, layers, square=True, parameter=parameter, per_y=per_y)
    rows: list[tuple[CellValue, ...]] = [
        (float(gain), float(pole.real), float(pole.imag))
        for gain, row in zip(gains, poles, strict=True)
        for pole in row
        if np.isfinite(pole)
    ]
    table = FigureTable(("gain", *axes), tuple(rows[:2000]))
    return Chart([[plot]], about, table, width=560.0, height=420.0)
