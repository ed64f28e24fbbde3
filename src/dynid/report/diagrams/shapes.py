"""Mode shapes of beams, plane frames and chains: still, and swinging where the reader allows motion."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.report.drawing.shape import Shape, shape_of
from dynid.report.figure import Cell, Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.scenes import scene_of
from dynid.report.style import TITLE
from dynid.report.svg import Point, Svg, path_of

if TYPE_CHECKING:
    from dynid.result import Result

GROUP = "structure/modes"
#: The most modes that are drawn, in rows of how many; points along an element.
MODES, ROW, FINE = 9, 3, 8
_WIDTH, _PAD, _SPAN = 250.0, 16.0, 34.0
_ROWS = 200  # of the table
_LABEL = re.compile(r"(u|w|theta)_(\d+)")


def figures(result: Result) -> Iterator[Figure]:
    """Yield the shapes, still and swinging."""
    shape = shape_of(scene_of(result))
    if shape is None or not result[f"{GROUP}/shape"].data.size:
        return
    for name, title, moving in (
        ("modes", "Mode shapes", False),
        ("modes-animated", "Mode shapes, swinging", True),
    ):
        yield Figure(name, title, partial(_picture, result, shape, name, title, moving))


class _Modes(NamedTuple):
    """Modes: frequencies (rad/s), damping ratios (NaN where there is none), DOFs, shapes (DOFs x modes)."""

    omega: NDArray[np.float64]
    damping: NDArray[np.float64]
    labels: list[str]
    shapes: NDArray[np.float64]

    @property
    def drawn(self) -> int:
        """How many are drawn."""
        return min(len(self.omega), MODES)

    def said(self, mode: int) -> str:
        """Return what stands over a mode."""
        said = f"mode {mode + 1}: {short(float(self.omega[mode]))} rad/s"
        return said + (
            f", ζ {short(float(self.damping[mode]), 2)}" if np.isfinite(self.damping[mode]) else ""
        )

    def table(self) -> Table:
        """Return the shapes that are drawn."""
        rows: tuple[tuple[Cell, ...], ...] = tuple(
            (label, *map(float, self.shapes[row, : self.drawn]))
            for row, label in enumerate(self.labels[:_ROWS])
        )
        columns = ("DOF", *(f"mode {mode + 1}" for mode in range(self.drawn)))
        left_out = len(self.labels) > _ROWS
        return Table(columns, rows, f"The first {_ROWS} of {len(self.labels)} DOFs." if left_out else "")


def _modes(result: Result) -> _Modes:
    omega, shapes = result[f"{GROUP}/omega"].data, result[f"{GROUP}/shape"].data
    damping = result[f"{GROUP}/damping"].data if f"{GROUP}/damping" in result else np.full(len(omega), np.nan)
    return _Modes(omega, damping, [str(label) for label in result[f"{GROUP}/dof"].data], shapes)


class _Grid:
    """Where the modes stand, in rows, px."""

    def __init__(self, shape: Shape, count: int) -> None:
        xs, ys = zip(*shape.points.values(), strict=True)
        self.left, self.top, tall = min(xs), max(ys), max(ys) - min(ys)
        self.scale = _WIDTH / max((max(xs) - min(xs)) or 1.0, tall)
        self.tall = self.scale * tall + 2 * _SPAN + 40
        # Columns sway: neighbours may move towards each other.
        self.side, self.apart = (_SPAN + 4, 2 * _SPAN + 10) if tall else (8.0, 44.0)
        columns, rows = min(count, ROW), -(-count // ROW)
        self.width = 2 * (_PAD + self.side) + columns * (_WIDTH + self.apart) - self.apart
        self.height = _PAD + TITLE + 22 + rows * self.tall

    def at(self, mode: int) -> Point:
        """Return the upper left corner of a mode."""
        row, column = divmod(mode, ROW)
        return _PAD + self.side + column * (_WIDTH + self.apart), _PAD + TITLE + 22 + row * self.tall

    def origin(self, mode: int) -> Point:
        """Return where the origin of the structure lies in the drawing of a mode."""
        x, y = self.at(mode)
        return x - self.scale * self.left, y + 20 + _SPAN + self.scale * self.top


def _picture(result: Result, shape: Shape, name: str, title: str, moving: bool) -> Picture:
    modes = _modes(result)
    grid = _Grid(shape, modes.drawn)
    svg = Svg(name, title)
    svg.text(_PAD, _PAD + TITLE, title, "title", anchor="start")
    if moving:
        svg.raw(_motion(svg.name, modes.drawn))
    for mode in range(modes.drawn):
        x, y = grid.at(mode)
        svg.text(x + _WIDTH / 2, y + 6, modes.said(mode), "small strong")
        moved = _displacements(modes.labels, modes.shapes[:, mode])
        _shape(svg, shape, moved, grid.scale, grid.origin(mode), f"swing{mode}" if moving else "")
    how = (
        "swinging, slower than they are; still where the system asks for less motion"
        if moving
        else "at their largest"
    )
    left_out = (
        f" The first {modes.drawn} of {len(modes.omega)} modes." if modes.drawn < len(modes.omega) else ""
    )
    about = f"Shapes of the modes, {how}; the thin line is the structure at rest.{left_out}"
    return Picture(svg.render(grid.width, grid.height), about, modes.table())


def _displacements(labels: Sequence[str], shape: NDArray[np.float64]) -> dict[int, dict[str, float]]:
    """Return what moves at each node: u, w, theta."""
    found: dict[int, dict[str, float]] = {}
    for label, value in zip(labels, shape.tolist(), strict=True):
        match = _LABEL.fullmatch(label)
        node, along = (int(match[2]), match[1]) if match else (int(label) if label.isdecimal() else 0, "w")
        found.setdefault(node, {})[along] = value
    return found


def _shape(
    svg: Svg,
    shape: Shape,
    moved: Mapping[int, Mapping[str, float]],
    scale: float,
    corner: Point,
    swing: str,
) -> None:
    """Draw the structure at rest and moved; the largest displacement has a length that is well seen."""

    def place(point: Point) -> Point:
        return corner[0] + scale * point[0], corner[1] - scale * point[1]

    lines = [_moved_line(shape, nodes, moved) for nodes in shape.members]
    if not lines:  # masses of a chain, each moved across it to be seen
        nodes = sorted(shape.points)
        rest = np.array([shape.points[n] for n in nodes])
        lines = [(rest, np.array([[0.0, moved.get(n, {}).get("w", 0.0)] for n in nodes]))]
    largest = max(float(np.abs(by).max()) for _, by in lines) or 1.0
    reach = _SPAN / scale / largest
    for rest, by in lines:
        svg.element("path", "hair", d=path_of(map(place, map(tuple, rest.tolist()))))
        there, back = ([place((x, y)) for x, y in (rest + sign * reach * by).tolist()] for sign in (1, -1))
        if swing:
            style = f"--there: path('{path_of(there)}'); --back: path('{path_of(back)}')"
            svg.element("path", f"s1 {svg.name}-{swing}", d=path_of(there), style=style)
            continue
        svg.element("path", "s1", d=path_of(there))
        for point in there if not shape.members else ():
            svg.circle(*point, 3.5, "s1 dot")


def _moved_line(
    shape: Shape, nodes: Sequence[int], moved: Mapping[int, Mapping[str, float]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points along a member and their displacements: cubic across it, linear along it (Hermite)."""
    rest, by = [], []
    t = np.linspace(0, 1, FINE + 1)
    for a, b in pairwise(nodes):
        start, end = np.array(shape.points[a]), np.array(shape.points[b])
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
        stretch = u0 * (1 - t) + u1 * t
        rest.append(start + np.outer(t, end - start))
        by.append(np.outer(stretch, along) + np.outer(bend, across))
    return np.concatenate(rest), np.concatenate(by)


def _motion(name: str, count: int) -> str:
    """Return the rules that make the shapes swing."""
    rules = [f"@keyframes {name}-swing {{ from {{ d: var(--there) }} to {{ d: var(--back) }} }}"]
    for mode in range(count):
        seconds = f"{1.6 / (1 + 0.35 * mode):.2f}"
        rules.append(
            f".{name}-swing{mode} {{ animation: {name}-swing {seconds}s ease-in-out infinite alternate }}"
        )
    names = ", ".join(f".{name}-swing{mode}" for mode in range(count))
    rules.append(f"@media (prefers-reduced-motion: reduce) {{ {names} {{ animation: none }} }}")
    rules.append(f"@media print {{ {names} {{ animation: none }} }}")
    return "<style>\n" + "\n".join(rules) + "\n</style>"
