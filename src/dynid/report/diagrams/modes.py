"""Figures of modes: measured ones with frequencies, MAC and shapes at the sensors; mode shapes, animated."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid.report.content.modes import GROUP, has_modes, modal_table
from dynid.report.drawing.space import GROUP as SPACE
from dynid.report.drawing.space import Space
from dynid.report.drawing.structure_scene import StructureGeometry, geometry_of
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.notation import short
from dynid.report.plot import Chart, Layer, Markers, PlotAxis, ReferenceLine, Subplot, matrix_chart
from dynid.report.scenes import frequency_unit, scene_of
from dynid.report.svg import TITLE, Point, Svg, path_of
from dynid.result import Result

#: Title, paths of frequency error and MAC, colour and mark.
_SERIES = (
    ("start", "frequency_error_start", "mac_start", "s3", "o"),
    ("estimate", "frequency_error", "mac", "s1", "o"),
    ("frequency left out", "left_out_error", "", "s2", "+"),
    ("frequencies alone", "trade_off/frequencies/frequency_error", "trade_off/frequencies/mac", "s4", "x"),
    ("shapes alone", "trade_off/shapes/frequency_error", "trade_off/shapes/mac", "s5", "x"),
)


def figures(result: Result) -> Iterator[Figure]:
    """Yield the figures of measured modes."""
    if not has_modes(result):
        return
    yield Figure("measured-modes", "Measured modes before and after", partial(_pairs, result))
    if f"{GROUP}/mac_table" in result:
        yield Figure("mac", "MAC of measured and computed modes", partial(_tables, result))


def _pairs(result: Result) -> Chart:
    """Draw the error of each frequency and the MAC of each pair, before and after."""
    names = tuple(str(mode) for mode in result[f"{GROUP}/mode"].data)
    height = np.arange(len(names), dtype=float)
    layers: list[Layer] = []
    shown: list[Layer] = []
    for title, error, criterion, colour, mark in _SERIES:
        for path, scale, into in ((error, 100.0, layers), (criterion, 1.0, shown)):
            if f"{GROUP}/{path}" in result:
                into.append(Markers(height, scale * result[f"{GROUP}/{path}"].data, title, colour, mark, 4))
    layers.append(ReferenceLine(0.0, "", "line dashed"))
    axis = PlotAxis("mode", names=names)
    rows = [[Subplot(axis, PlotAxis("frequency error (%)"), layers, height=150.0)]]
    if shown:
        rows.append([Subplot(axis, PlotAxis("MAC"), shown, height=120.0)])
    table = modal_table(result)
    about = (
        "Errors of the model's frequencies, and agreement of its shapes with the measured ones (1: the same)."
    )
    return Chart(rows, about, FigureTable(table.columns, table.rows))


def _tables(result: Result) -> Chart:
    """Draw the MAC of all pairs, before and after."""
    rows = [str(mode) for mode in result[f"{GROUP}/mode"].data]
    columns = [str(mode) for mode in result[f"{GROUP}/computed"].data]
    rows_of_modes = [
        (title, np.nan_to_num(result[f"{GROUP}/{name}"].data), rows, columns, ("measured", "model"))
        for name, title in (("mac_table_start", "start"), ("mac_table", "estimate"))
    ]
    return matrix_chart(rows_of_modes, (0.0, 1.0), "1: the shapes agree; 0: they are orthogonal.")


_MODES, _BESIDE, _LINES = 9, 3, 700
_WIDTH, _PAD, _SPAN, _APART = 250.0, 16.0, 34.0, 60.0


def measured_shapes(result: Result) -> Iterator[Figure]:
    """Yield the measured shapes, where the places of their sensors are known."""
    if f"{SPACE}/shape_sensor" in result and f"{GROUP}/shape_measured" in result:
        yield Figure("measured-shapes", "Measured shapes", partial(_shapes, result))


def _shapes(result: Result) -> Picture:
    space = Space(result)
    names = [str(name) for name in result[f"{SPACE}/shape_sensor"].data]
    rows = [[str(name) for name in result[f"{GROUP}/sensor"].data].index(name) for name in names]
    both = [result[f"{GROUP}/{name}"].data[rows] for name in ("shape_measured", "shape")]
    # A complex shape has any phase: that of the largest real part, one for both.
    turn = np.exp(-0.5j * np.angle(np.nansum(both[0] ** 2, axis=0)))
    measured, model = (np.real(turn * shapes) for shapes in both)
    count = min(measured.shape[1], _MODES)
    places = space.flat(space.array("shape_sensor_position", 3))
    ways = space.flat(space.array("shape_sensor_direction", 3))
    lines = [rest for rest, _ in space.polylines(limit=_LINES)]
    points = np.concatenate([*lines, places])
    low, high = points.min(axis=0), points.max(axis=0)
    width, height = (high - low).tolist()
    scale = _WIDTH / (max(width, height) or 1.0)
    tall = scale * height + 2 * _SPAN + 40
    svg = Svg("measured-shapes", "Measured shapes")
    svg.text(_PAD, _PAD + TITLE, "Measured shapes", "title", anchor="start")
    unit = result[f"{GROUP}/frequency_measured"].units
    for mode in range(count):
        row, column = divmod(mode, _BESIDE)
        x = _PAD + _SPAN + column * (_WIDTH + _APART)
        y = _PAD + TITLE + 22 + row * tall
        frequency = short(float(result[f"{GROUP}/frequency_measured"].data[mode]))
        heading = f"measured {mode + 1}: {frequency} {unit}"
        if f"{GROUP}/mac" in result:
            heading += f", MAC {short(float(result[f'{GROUP}/mac'].data[mode]), 3)}"
        svg.text(x + _WIDTH / 2, y + 6, heading, "small strong")
        origin = np.array([x + (_WIDTH - scale * width) / 2, y + 20 + _SPAN])

        def placed(flat: np.ndarray, origin: np.ndarray = origin) -> np.ndarray:
            return np.asarray(origin + scale * (flat - [low[0], high[1]]) * [1, -1])

        svg.element("path", "hair", d="".join(path_of(map(tuple, placed(rest).tolist())) for rest in lines))
        for shape, cls, mark in ((model, "s1", "s1"), (measured, "s2", "s2 dot")):
            largest = float(np.nanmax(np.abs(measured[:, mode]), initial=0.0)) or 1.0
            for position, way, value in zip(places, ways, shape[:, mode].tolist(), strict=True):
                if np.isnan(value):
                    continue
                start = placed(position)
                end = start + _SPAN * value / largest * way * [1, -1]
                svg.line(
                    tuple(start.tolist()), tuple(end.tolist()), cls=cls if shape is model else f"{cls} fine"
                )
                svg.circle(float(end[0]), float(end[1]), 5.0 if shape is model else 2.6, mark)
    cut = f" The first {count} of {measured.shape[1]} modes." if count < measured.shape[1] else ""
    about = "Displacements at the sensors: dots are measured, rings those of the model." + cut
    table: list[tuple[CellValue, ...]] = [
        (name, *(float(shapes[row, mode]) for mode in range(count) for shapes in (measured, model)))
        for row, name in enumerate(names[:200])
    ]
    heads = [f"{what} {mode + 1}" for mode in range(count) for what in ("measured", "model")]
    columns = min(count, _BESIDE)
    size = 2 * (_PAD + _SPAN) + columns * (_WIDTH + _APART) - _APART
    drawn = svg.render(size, _PAD + TITLE + 22 + -(-count // _BESIDE) * tall)
    return Picture(drawn, about, FigureTable(("sensor", *heads), tuple(table)))


_COMPUTED = "structure/modes"
#: Most modes that are drawn, modes in a row, points along an element, rows of the table.
MODES, ROW, FINE, ROWS = 9, 3, 8, 200
_SHAPE_WIDTH, _SHAPE_PAD, _SHAPE_SPAN = 250.0, 16.0, 34.0
_LABEL = re.compile(r"(u|w|theta)_(\d+)")

Displacements = Mapping[int, Mapping[str, float]]
#: Points of lines at rest and their displacements, on the paper.
Lines = Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]
_LinesOf = Callable[[int], Lines]
#: Most lines that are drawn one by one, and in all modes together.
_LINES_APART, MOST_LINES = 60, 6300


def mode_shapes(result: Result) -> Iterator[Figure]:
    """Yield the mode shapes, still and animated."""
    if not result[f"{_COMPUTED}/shape"].data.size:
        return
    lines = _lines_by(result)
    if lines is None:
        return
    for name, title, animated in (
        ("modes", "Mode shapes", False),
        ("modes-animated", "Mode shapes, animated", True),
    ):
        yield Figure(name, title, partial(_picture, result, *lines, name, title, animated))


def _lines_by(result: Result) -> tuple[_LinesOf, bool] | None:
    """Return the function that gives the lines in a mode, and whether their points are masses.

    None without geometry. Of a scene's chain, beam or plane frame with all its DOFs they follow from these,
    else from the motion of the nodes that the result holds.
    """
    geometry = geometry_of(scene_of(result))
    labels = [str(label) for label in result[f"{_COMPUTED}/dof"].data]
    if geometry is not None and labels == [str(label) for label in geometry.labels]:
        return lambda mode: _bent(geometry, _displacements(result, mode)), not geometry.members
    if f"{SPACE}/displacement" not in result:
        return None
    space = Space(result)
    limit = MOST_LINES // min(len(result[f"{SPACE}/displacement"].data), MODES)
    return lambda mode: space.polylines(mode, limit), False


def _displacements(result: Result, mode: int) -> Displacements:
    """Return the entries of a mode shape by node and direction."""
    moved: dict[int, dict[str, float]] = {}
    shape = result[f"{_COMPUTED}/shape"].data[:, mode].tolist()
    for label, value in zip(map(str, result[f"{_COMPUTED}/dof"].data), shape, strict=True):
        match = _LABEL.fullmatch(label)
        node = int(match[2]) if match else int(label) if label.isdecimal() else 0
        moved.setdefault(node, {})[match[1] if match else "w"] = value
    return moved


def _picture(
    result: Result, lines_of: _LinesOf, dots: bool, name: str, title: str, animated: bool
) -> Picture:
    omega, shapes = result[f"{_COMPUTED}/omega"].data, result[f"{_COMPUTED}/shape"].data
    damping = (
        result[f"{_COMPUTED}/damping"].data
        if f"{_COMPUTED}/damping" in result
        else np.full(len(omega), np.nan)
    )
    labels = [str(label) for label in result[f"{_COMPUTED}/dof"].data]
    count, unit = min(len(omega), MODES), frequency_unit(result)
    points = np.concatenate([rest for rest, _ in lines_of(0)])
    (left, low), (right, top) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    tall = top - low
    scale = _SHAPE_WIDTH / (max(right - left, tall) or 1.0)
    # Columns of a frame sway, so that neighbouring modes may move towards each other.
    side, apart = (_SHAPE_SPAN + 4, 2 * _SHAPE_SPAN + 10) if tall else (8.0, 44.0)
    row_height = scale * tall + 2 * _SHAPE_SPAN + 40
    svg = Svg(name, title)
    svg.text(_SHAPE_PAD, _SHAPE_PAD + TITLE, title, "title", anchor="start")
    if animated:
        swing, rules = f"{svg.name}-swing", list[str]()
        rules.append(f"@keyframes {swing} {{ from {{ d: var(--there) }} to {{ d: var(--back) }} }}")
        for mode in range(count):
            seconds = f"{1.6 / (1 + 0.35 * mode):.2f}"
            rules.append(f".{swing}{mode} {{ animation: {swing} {seconds}s ease-in-out infinite alternate }}")
        still = f"{{ {', '.join(f'.{swing}{mode}' for mode in range(count))} {{ animation: none }} }}"
        rules += [f"@media (prefers-reduced-motion: reduce) {still}", f"@media print {still}"]
        svg.raw("<style>\n" + "\n".join(rules) + "\n</style>")
    for mode in range(count):
        row, column = divmod(mode, ROW)
        x, y = _SHAPE_PAD + side + column * (_SHAPE_WIDTH + apart), _SHAPE_PAD + TITLE + 22 + row * row_height
        heading = f"mode {mode + 1}: {short(unit.factor * float(omega[mode]))} {unit.name}"
        heading += f", ζ {short(float(damping[mode]), 2)}" if np.isfinite(damping[mode]) else ""
        svg.text(x + _SHAPE_WIDTH / 2, y + 6, heading, "small strong")
        origin = (
            x - scale * left + (_SHAPE_WIDTH - scale * (right - left)) / 2,
            y + 20 + _SHAPE_SPAN + scale * top,
        )
        _draw_shape(svg, lines_of(mode), scale, origin, f"swing{mode}" if animated else "", dots=dots)
    state = (
        "animated in slow motion, still where the system requests less motion"
        if animated
        else "at their maximum"
    )
    cut = f" The first {count} of {len(omega)} modes." if count < len(omega) else ""
    about = f"Mode shapes, {state}; the thin line is the structure at rest.{cut}"
    rows: tuple[tuple[CellValue, ...], ...] = tuple(
        (label, *map(float, shapes[row, :count])) for row, label in enumerate(labels[:ROWS])
    )
    note = f"The first {ROWS} of {len(labels)} DOFs." if len(labels) > ROWS else ""
    table = FigureTable(("DOF", *(f"mode {mode + 1}" for mode in range(count))), rows, note)
    columns = min(count, ROW)
    width = 2 * (_SHAPE_PAD + side) + columns * (_SHAPE_WIDTH + apart) - apart
    return Picture(svg.render(width, _SHAPE_PAD + TITLE + 22 + -(-count // ROW) * row_height), about, table)


def _bent(geometry: StructureGeometry, moved: Displacements) -> Lines:
    """Return points along the members and their displacements: cubic across a member, linear along it."""
    lines, t = list[tuple[NDArray[np.float64], NDArray[np.float64]]](), np.linspace(0, 1, FINE + 1)
    for nodes in geometry.members:
        points, displacements = [], []
        for a, b in pairwise(nodes):
            start, end = np.array(geometry.points[a]), np.array(geometry.points[b])
            length = float(np.linalg.norm(end - start))
            along = (end - start) / length
            across = np.array([-along[1], along[0]])
            ends = []
            for node in (a, b):
                motion = moved.get(node, {})
                step = np.array([motion.get("u", 0.0), motion.get("w", 0.0)])
                ends.append((step @ along, step @ across, motion.get("theta", 0.0) * length))
            (u0, v0, s0), (u1, v1, s1) = ends
            bend = v0 * (1 - 3 * t**2 + 2 * t**3) + s0 * (t - 2 * t**2 + t**3)
            bend = bend + v1 * (3 * t**2 - 2 * t**3) + s1 * (t**3 - t**2)
            points.append(start + np.outer(t, end - start))
            displacements.append(np.outer(u0 * (1 - t) + u1 * t, along) + np.outer(bend, across))
        lines.append((np.concatenate(points), np.concatenate(displacements)))
    if not lines:  # masses of a chain, displaced across it to be visible
        masses = sorted(geometry.points)
        rest = np.array([geometry.points[n] for n in masses])
        lines = [(rest, np.array([[0.0, moved.get(n, {}).get("w", 0.0)] for n in masses]))]
    return lines


def _draw_shape(svg: Svg, lines: Lines, scale: float, origin: Point, swing: str, *, dots: bool) -> None:
    """Draw the structure at rest and displaced; the largest displacement has a fixed length."""

    def path(points: NDArray[np.float64]) -> str:
        return path_of((origin[0] + scale * x, origin[1] - scale * y) for x, y in points.tolist())

    largest = max(float(np.abs(by).max()) for _, by in lines) or 1.0
    reach = _SHAPE_SPAN / scale / largest
    together = len(lines) > _LINES_APART
    rests = [path(rest) for rest, _ in lines]
    theres, backs = ([path(rest + sign * reach * by) for rest, by in lines] for sign in (1, -1))
    if together:  # one path with many parts
        rests, theres, backs = ["".join(rests)], ["".join(theres)], ["".join(backs)]
    for rest, there, back in zip(rests, theres, backs, strict=True):
        svg.element("path", "hair", d=rest)
        cls = "s1 fine" if together else "s1"
        if swing:
            style = f"--there: path('{there}'); --back: path('{back}')"
            svg.element("path", f"{cls} {svg.name}-{swing}", d=there, style=style)
        else:
            svg.element("path", cls, d=there)
    for still, by in lines if dots and not swing else ():
        for x, y in (still + reach * by).tolist():
            svg.circle(origin[0] + scale * x, origin[1] - scale * y, 3.5, "s1 dot")
