"""Figures of modes: measured ones with frequencies, MAC and shapes at the sensors; mode shapes, animated."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from dynid.arrays import Array
from dynid.report.content.responses import GROUP, has_modes, is_backbone, modal_table
from dynid.report.drawing.space import GROUP as SPACE
from dynid.report.drawing.space import Space, bent_line
from dynid.report.drawing.structure_scene import StructureGeometry, geometry_of
from dynid.report.figure import CellValue, Figure, FigureTable, Picture, table_of
from dynid.report.notation import labelled, short, texts
from dynid.report.plot import Chart, Curve, Layer, Markers, PlotAxis, ReferenceLine, Subplot, matrix_chart
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
    if is_backbone(result):
        yield Figure("measured-modes", "Measured backbones before and after", partial(_backbones, result))
    else:
        yield Figure("measured-modes", "Measured modes before and after", partial(_pairs, result))
    if f"{GROUP}/mac_table" in result:
        yield Figure("mac", "MAC of measured and computed modes", partial(_tables, result))


def _pairs(result: Result) -> Chart:
    """Draw the error of each frequency and the MAC of each pair, before and after."""
    names = tuple(texts(result, f"{GROUP}/mode"))
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


def _backbones(result: Result) -> Chart:
    """Draw frequencies and damping ratios over the amplitude, measured, at the start and at the estimate."""
    size, modes = result[f"{GROUP}/amplitude"], result[f"{GROUP}/model_mode"].data
    unit = result[f"{GROUP}/frequency"].units
    across = PlotAxis(
        labelled(f"amplitude of {result.group_attrs[GROUP]['amplitude_of']}", size.units), log=True
    )
    rows, columns = list[list[Subplot]](), {"amplitude": size.data, "mode": modes}
    for name, factor, label in (
        ("frequency", 1.0, labelled("frequency", unit)),
        ("damping", 100.0, "damping ratio (%)"),
    ):
        if f"{GROUP}/{name}_measured" not in result:
            continue
        layers = list[Layer]()
        for mode in np.unique(modes).tolist():
            of_mode = np.flatnonzero(modes == mode)
            order = of_mode[np.argsort(size.data[of_mode], kind="stable")]
            for title, path, cls in (("start", f"{name}_start", "s3 dashed"), ("estimate", name, "s1")):
                heights = factor * result[f"{GROUP}/{path}"].data[order]
                layers.append(Curve(size.data[order], heights, title, cls))
        measured = factor * result[f"{GROUP}/{name}_measured"].data
        layers.append(Markers(size.data, measured, "measured", "s2", "o", 4))
        rows.append([Subplot(across, PlotAxis(label), layers, height=180.0)])
        columns |= {f"{name} measured": measured, name: factor * result[f"{GROUP}/{name}"].data}
    return Chart(rows, "Natural frequency and damping of motions along the mode.", table_of(columns))


def _tables(result: Result) -> Chart:
    rows = texts(result, f"{GROUP}/mode")
    columns = texts(result, f"{GROUP}/computed")
    rows_of_modes = [
        (title, np.nan_to_num(result[f"{GROUP}/{name}"].data), rows, columns, ("measured", "model"))
        for name, title in (("mac_table_start", "start"), ("mac_table", "estimate"))
    ]
    return matrix_chart(rows_of_modes, (0.0, 1.0), "1: the shapes agree; 0: they are orthogonal.")


#: Most modes that are drawn, and in a row; rows of the table.
_MODES, _BESIDE, _ROWS = 9, 3, 200
#: Width of a shape, margin, and largest displacement, px.
_WIDTH, _PAD, SPAN = 250.0, 16.0, 34.0


class ShapeGrid:
    """Grid of the shapes of modes below a title; y of shapes upwards.

    Shapes fill their width; so much space is beside the outer ones, and between neighbours.
    """

    def __init__(self, svg: Svg, points: Array, modes: int, side: float, between: float) -> None:
        self.svg, self.side, self.between = svg, side, between
        self.count, self.beside = min(modes, _MODES), min(modes, _MODES, _BESIDE)
        self.low, self.high = points.min(axis=0), points.max(axis=0)
        self.width, self.height = (self.high - self.low).tolist()
        self.scale = _WIDTH / (max(self.width, self.height) or 1.0)
        self.row_height = self.scale * self.height + 2 * SPAN + 40
        svg.text(_PAD, _PAD + TITLE, svg.title, "title", anchor="start")
        self.cut = f" The first {self.count} of {modes} modes." if self.count < modes else ""

    def place(self, mode: int, heading: str) -> Callable[[Array], list[Point]]:
        """Write the heading of a mode, and return the function that places points of its shape."""
        row, column = divmod(mode, _BESIDE)
        x = _PAD + self.side + column * (_WIDTH + self.between)
        y = _PAD + TITLE + 22 + row * self.row_height
        self.svg.text(x + _WIDTH / 2, y + 6, heading, "small strong")
        origin = np.array([x + (_WIDTH - self.scale * self.width) / 2, y + 20 + SPAN])
        corner = np.array([self.low[0], self.high[1]])

        def placed(points: Array) -> list[Point]:
            return [(x, y) for x, y in (origin + self.scale * (points - corner) * [1, -1]).tolist()]

        return placed

    def render(self) -> str:
        """Return the figure as SVG."""
        width = 2 * (_PAD + self.side) + self.beside * (_WIDTH + self.between) - self.between
        return self.svg.render(width, _PAD + TITLE + 22 + -(-self.count // _BESIDE) * self.row_height)


def measured_shapes(result: Result) -> Iterator[Figure]:
    """Yield the measured shapes, where the places of their sensors are known."""
    if f"{SPACE}/shape_sensor" in result and f"{GROUP}/shape_measured" in result:
        yield Figure("measured-shapes", "Measured shapes", partial(_shapes, result))


def _shapes(result: Result) -> Picture:
    space, names = Space(result), texts(result, f"{SPACE}/shape_sensor")
    rows = [texts(result, f"{GROUP}/sensor").index(name) for name in names]
    both = [result[f"{GROUP}/{name}"].data[rows] for name in ("shape_measured", "shape")]
    # A complex shape has any phase: that of the largest real part, one for both.
    turn = np.exp(-0.5j * np.angle(np.nansum(both[0] ** 2, axis=0)))
    measured, model = (np.real(turn * shapes) for shapes in both)
    places = space.flat(space.array("shape_sensor_position", 3))
    ways = space.flat(space.array("shape_sensor_direction", 3))
    lines = [rest for rest, _ in space.polylines(limit=_MEASURED_LINES)]
    svg = Svg("measured-shapes", "Measured shapes")
    grid = ShapeGrid(svg, np.concatenate([*lines, places]), measured.shape[1], SPAN, 60.0)
    frequency = result[f"{GROUP}/frequency_measured"]
    for mode in range(grid.count):
        heading = f"measured {mode + 1}: {short(float(frequency.data[mode]))} {frequency.units}"
        if f"{GROUP}/mac" in result:
            heading += f", MAC {short(float(result[f'{GROUP}/mac'].data[mode]), 3)}"
        placed = grid.place(mode, heading)
        svg.element("path", "hair", d="".join(path_of(placed(rest)) for rest in lines))
        reach = SPAN / grid.scale / (float(np.nanmax(np.abs(measured[:, mode]), initial=0.0)) or 1.0)
        for shape, cls, mark, radius in ((model, "s1", "s1", 5.0), (measured, "s2 fine", "s2 dot", 2.6)):
            for position, way, value in zip(places, ways, shape[:, mode].tolist(), strict=True):
                if not np.isnan(value):
                    start, end = placed(np.array([position, position + reach * value * way]))
                    svg.line(start, end, cls=cls)
                    svg.circle(*end, radius, mark)
    about = f"Displacements at the sensors: dots are measured, rings those of the model.{grid.cut}"
    table: list[tuple[CellValue, ...]] = [
        (name, *(float(shapes[row, mode]) for mode in range(grid.count) for shapes in (measured, model)))
        for row, name in enumerate(names[:_ROWS])
    ]
    heads = [f"{what} {mode + 1}" for mode in range(grid.count) for what in ("measured", "model")]
    return Picture(grid.render(), about, FigureTable(("sensor", *heads), tuple(table)))


_COMPUTED = "structure/modes"
_LABEL = re.compile(r"(u|w|theta)_(\d+)")

#: Points of lines at rest and their displacements, on the paper.
Lines = Sequence[tuple[Array, Array]]
_LinesOf = Callable[[int], Lines]
#: Faces of a mode whose displacements are multiplied by a number, farthest first, and their shades.
_FacesOf = Callable[[int, float], Sequence[tuple[Array, str]]]
#: Most lines that are drawn one by one, in all modes together, and of measured shapes.
_LINES_APART, MOST_LINES, _MEASURED_LINES = 60, 6300, 700


def mode_shapes(result: Result) -> Iterator[Figure]:
    """Yield the mode shapes, still and animated."""
    if not result[f"{_COMPUTED}/shape"].data.size:
        return
    drawn = _drawn_by(result)
    if drawn is None:
        return
    yield Figure("modes", "Mode shapes", partial(_picture, result, *drawn, False))
    yield Figure("modes-animated", "Mode shapes, animated", partial(_picture, result, *drawn, True))


def _drawn_by(result: Result) -> tuple[_LinesOf, _FacesOf, bool] | None:
    """Return the functions that give the lines and faces in a mode, and whether points are masses.

    None without geometry. Of a scene's chain, beam or plane frame with all its DOFs they follow from these,
    else from the motion of the nodes that the result holds.
    """
    geometry = geometry_of(scene_of(result))
    labels = texts(result, f"{_COMPUTED}/dof")
    if geometry is not None and labels == [str(label) for label in geometry.labels]:
        return lambda mode: _bent(geometry, result, mode), lambda *_: (), not geometry.members
    if f"{SPACE}/displacement" not in result:
        return None
    space = Space(result)
    limit = MOST_LINES // min(len(result[f"{SPACE}/displacement"].data), _MODES)
    return (
        lambda mode: space.polylines(mode, limit),
        lambda mode, reach: space.surface(mode, reach, limit // 2),
        False,
    )


def _picture(result: Result, lines_of: _LinesOf, faces_of: _FacesOf, dots: bool, animated: bool) -> Picture:
    omega, shapes = result[f"{_COMPUTED}/omega"].data, result[f"{_COMPUTED}/shape"].data
    damping = result.get(f"{_COMPUTED}/damping")
    unit, points = frequency_unit(result), np.concatenate([rest for rest, _ in lines_of(0)])
    # Columns of a frame sway, so that neighbouring modes may move towards each other.
    space = (SPAN + 4, 2 * SPAN + 10) if np.ptp(points[:, 1]) else (8.0, 44.0)
    svg = Svg("modes-animated", "Mode shapes, animated") if animated else Svg("modes", "Mode shapes")
    grid = ShapeGrid(svg, points, len(omega), *space)
    if animated:
        frames = "from { d: var(--there) } to { d: var(--back) }"
        animate(svg, grid.count, frames, "ease-in-out infinite alternate", 1.6)
    for mode in range(grid.count):
        heading = f"mode {mode + 1}: {short(unit.factor * float(omega[mode]))} {unit.name}"
        if damping is not None and np.isfinite(damping.data[mode]):
            heading += f", ζ {short(float(damping.data[mode]), 2)}"
        _draw_shape(grid, mode, heading, lines_of(mode), faces_of, animated=animated, dots=dots)
    state = (
        "animated in slow motion, still where the system requests less motion"
        if animated
        else "at their maximum"
    )
    about = f"Mode shapes, {state}; the thin line is the structure at rest.{grid.cut}"
    labels = texts(result, f"{_COMPUTED}/dof")
    rows: list[tuple[CellValue, ...]] = [
        (label, *map(float, shapes[row, : grid.count])) for row, label in enumerate(labels[:_ROWS])
    ]
    note = f"The first {_ROWS} of {len(labels)} DOFs." if len(labels) > _ROWS else ""
    heads = ("DOF", *(f"mode {mode + 1}" for mode in range(grid.count)))
    return Picture(grid.render(), about, FigureTable(heads, tuple(rows), note))


def animate(svg: Svg, count: int, frames: str, timing: str, seconds: float) -> None:
    """Write the rules that move the paths of so many modes, the first in so many seconds, the next faster.

    Paths stand still in print, and where the system requests less motion.
    """
    swing, rules = f"{svg.name}-swing", list[str]()
    rules.append(f"@keyframes {swing} {{ {frames} }}")
    for mode in range(count):
        duration = f"{seconds / (1 + 0.35 * mode):.2f}"
        rules.append(f".{swing}{mode} {{ animation: {swing} {duration}s {timing} }}")
    still = f"{{ {', '.join(f'.{swing}{mode}' for mode in range(count))} {{ animation: none }} }}"
    rules += [f"@media (prefers-reduced-motion: reduce) {still}", f"@media print {still}"]
    svg.raw("<style>\n" + "\n".join(rules) + "\n</style>")


def _bent(geometry: StructureGeometry, result: Result, mode: int) -> Lines:
    """Return points along the members and their displacements; masses of a chain move across it."""
    index = {node: k for k, node in enumerate(geometry.points)}
    rest = np.array(list(geometry.points.values()))
    u, w, theta = np.zeros((3, len(index)))
    shape = result[f"{_COMPUTED}/shape"].data[:, mode].tolist()
    for label, value in zip(texts(result, f"{_COMPUTED}/dof"), shape, strict=True):
        match = _LABEL.fullmatch(label)
        along = {"u": u, "theta": theta}.get(match[1], w) if match else w
        along[index[int(match[2] if match else label)]] = value
    none = np.zeros(len(index))
    if not geometry.members:
        return [(rest, np.column_stack([none, w]))]
    nodes = np.column_stack([rest, none]), np.column_stack([u, w, none]), np.column_stack([none, none, theta])
    lines = (bent_line([index[node] for node in member], *nodes) for member in geometry.members)
    return [(points[:, :2], by[:, :2]) for points, by in lines]


def _draw_shape(
    grid: ShapeGrid,
    mode: int,
    heading: str,
    lines: Lines,
    faces_of: _FacesOf,
    *,
    animated: bool,
    dots: bool,
) -> None:
    """Draw the structure at rest and displaced; the largest displacement has a fixed length."""
    svg, placed = grid.svg, grid.place(mode, heading)
    largest = max(float(np.abs(by).max()) for _, by in lines) or 1.0
    reach = SPAN / grid.scale / largest
    faces = () if animated else faces_of(mode, reach)
    together = len(lines) > _LINES_APART
    rests, theres, backs = (
        [path_of(placed(rest + sign * reach * by)) for rest, by in lines] for sign in (0, 1, -1)
    )
    if together:  # one path with many parts
        rests, theres, backs = ["".join(rests)], ["".join(theres)], ["".join(backs)]
    for rest, there, back in zip(rests, theres, backs, strict=True):
        svg.element("path", "hair", d=rest)
        cls = "s1 fine" if together else "s1"
        if animated:
            style = f"--there: path('{there}'); --back: path('{back}')"
            svg.element("path", f"{cls} {svg.name}-swing{mode}", d=there, style=style)
        elif not faces:
            svg.element("path", cls, d=there)
    for corners, shade in faces:
        svg.element("path", f"hair {shade}", d=path_of(placed(corners), closed=True))
    for still, by in lines if dots and not animated else ():
        for x, y in placed(still + reach * by):
            svg.circle(x, y, 3.5, "s1 dot")
