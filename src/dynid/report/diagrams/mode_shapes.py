"""Mode shapes of structures whose geometry is known: still, and animated where the reader allows motion."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.report.drawing.space import GROUP as SPACE
from dynid.report.drawing.space import Space
from dynid.report.drawing.structure_scene import StructureGeometry, geometry_of
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.notation import short
from dynid.report.scenes import frequency_unit, scene_of
from dynid.report.svg import TITLE, Point, Svg, path_of

if TYPE_CHECKING:
    from dynid.result import Result

GROUP = "structure/modes"
#: Most modes that are drawn, modes in a row, points along an element, rows of the table.
MODES, ROW, FINE, ROWS = 9, 3, 8, 200
_WIDTH, _PAD, _SPAN = 250.0, 16.0, 34.0
_LABEL = re.compile(r"(u|w|theta)_(\d+)")

Displacements = Mapping[int, Mapping[str, float]]
#: Points of lines at rest and their displacements, on the paper.
Lines = Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]
LinesOf = Callable[[int], Lines]
#: Most lines that are drawn one by one, and in all modes together.
_APART, MOST_LINES = 60, 6300


def figures(result: Result) -> Iterator[Figure]:
    """Yield the mode shapes, still and animated."""
    if not result[f"{GROUP}/shape"].data.size:
        return
    found = _lines_by(result)
    if found is None:
        return
    for name, title, animated in (
        ("modes", "Mode shapes", False),
        ("modes-animated", "Mode shapes, animated", True),
    ):
        yield Figure(name, title, partial(_picture, result, *found, name, title, animated))


def _lines_by(result: Result) -> tuple[LinesOf, bool] | None:
    """Return the function that gives the lines in a mode, and whether their points are masses.

    None without geometry.

    Of a scene's chain, beam or plane frame with all its DOFs they follow from these, of others from the
    motion of the nodes that the result holds.
    """
    data = scene_of(result).data
    geometry = geometry_of(scene_of(result)) if "structure" in data and "points" not in data else None
    labels = [str(label) for label in result[f"{GROUP}/dof"].data]
    if geometry is not None and labels == [str(label) for label in geometry.labels]:
        return lambda mode: _bent(geometry, _displacements(result, mode)), not geometry.members
    if f"{SPACE}/displacement" not in result:
        return None
    space = Space(result)
    most = MOST_LINES // min(len(result[f"{SPACE}/displacement"].data), MODES)
    return lambda mode: space.polylines(mode, most), False


def _displacements(result: Result, mode: int) -> Displacements:
    """Return the entries of a mode shape by node and direction."""
    moved: dict[int, dict[str, float]] = {}
    shape = result[f"{GROUP}/shape"].data[:, mode].tolist()
    for label, value in zip(map(str, result[f"{GROUP}/dof"].data), shape, strict=True):
        match = _LABEL.fullmatch(label)
        node = int(match[2]) if match else int(label) if label.isdecimal() else 0
        moved.setdefault(node, {})[match[1] if match else "w"] = value
    return moved


def _picture(result: Result, lines_of: LinesOf, dots: bool, name: str, title: str, animated: bool) -> Picture:
    omega, shapes = result[f"{GROUP}/omega"].data, result[f"{GROUP}/shape"].data
    damping = result[f"{GROUP}/damping"].data if f"{GROUP}/damping" in result else np.full(len(omega), np.nan)
    labels = [str(label) for label in result[f"{GROUP}/dof"].data]
    count, unit = min(len(omega), MODES), frequency_unit(result)
    points = np.concatenate([rest for rest, _ in lines_of(0)])
    (left, low), (right, top) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    tall = top - low
    scale = _WIDTH / (max(right - left, tall) or 1.0)
    # Columns of a frame sway, so that neighbouring modes may move towards each other.
    side, apart = (_SPAN + 4, 2 * _SPAN + 10) if tall else (8.0, 44.0)
    row_height = scale * tall + 2 * _SPAN + 40
    svg = Svg(name, title)
    svg.text(_PAD, _PAD + TITLE, title, "title", anchor="start")
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
        x, y = _PAD + side + column * (_WIDTH + apart), _PAD + TITLE + 22 + row * row_height
        heading = f"mode {mode + 1}: {short(unit.factor * float(omega[mode]))} {unit.name}"
        heading += f", ζ {short(float(damping[mode]), 2)}" if np.isfinite(damping[mode]) else ""
        svg.text(x + _WIDTH / 2, y + 6, heading, "small strong")
        origin = (x - scale * left + (_WIDTH - scale * (right - left)) / 2, y + 20 + _SPAN + scale * top)
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
    width = 2 * (_PAD + side) + columns * (_WIDTH + apart) - apart
    return Picture(svg.render(width, _PAD + TITLE + 22 + -(-count // ROW) * row_height), about, table)


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
                own = moved.get(node, {})
                step = np.array([own.get("u", 0.0), own.get("w", 0.0)])
                ends.append((step @ along, step @ across, own.get("theta", 0.0) * length))
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
    reach = _SPAN / scale / largest
    together = len(lines) > _APART
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
