"""Structures by the positions of their nodes, in two or three dimensions: sensors, loads, joints, supports.

A plane structure is seen along z; any other from above and aside, in parallel projection.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.report.drawing.structure import pin, plane_geometry
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.svg import FACES, SMALL, Point, Svg, path_of, text_width
from dynid.result import Result
from dynid.structure.geometry import coarser, outer_lines, sides_of

GROUP = "structure/geometry"
#: Azimuth and elevation of the eye, degrees.
_AZIMUTH, _ELEVATION = -60.0, 22.0
#: Size of the picture and length of an arrow, px; most nodes with numbers, supports and arrows with texts.
_WIDTH, _HEIGHT, _ARROW, _NUMBERED, _WRITTEN = 620.0, 440.0, 30.0, 26, 40
#: Margin, px; most lines that are bold, and nodes that are drawn.
_PAD, _FEW = 24.0, 200
#: Direction of the light, from the eye: right, up, towards it.
_LIGHT = np.array([-0.4, 0.6, 0.7])
#: Points along a line that bends; most lines that are bent, and that are drawn.
_FINE, _BENT, _MOST = 8, 400, 6000


class Space:
    """The geometry in a result, its group `structure/geometry`, and its projection onto the paper."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self.nodes = [str(name) for name in result[f"{GROUP}/node"].data]
        self.position = self.array("position", 3)
        self.edges = result[f"{GROUP}/edge"].data
        self.faces = self.array("face", 4).astype(int)
        self.lines = int(result.group_attrs.get(GROUP, {}).get("lines", len(self.edges)))

    def array(self, name: str, width: int) -> Array:
        """Return an array of the geometry; one without rows where it is absent."""
        path = f"{GROUP}/{name}"
        return np.asarray(self.result[path].data) if path in self.result else np.zeros((0, width))

    def names(self, what: str) -> list[str]:
        """Return the names of sensors, loads or joints."""
        path = f"{GROUP}/{what}"
        return [str(name) for name in self.result[path].data] if path in self.result else []

    @cached_property
    def is_plane(self) -> bool:
        """True if everything lies and moves in x-y, rotations about z."""
        flat = not np.ptp(self.position[:, 2])
        for what in ("sensor", "load"):
            turns, along = self.array(f"{what}_turns", 1).ravel(), self.array(f"{what}_direction", 3)
            flat = flat and not any(
                np.abs(direction[:2] if turning else direction[2:]).max() > 1e-9
                for turning, direction in zip(turns, along, strict=True)
            )
        return flat and not self.array("displacement", 3)[..., 2].any()

    @cached_property
    def view(self) -> Array:
        """Directions on the paper, to the right and up (2 x 3)."""
        if self.is_plane:
            return np.eye(3)[:2]
        a, e = np.radians([_AZIMUTH, _ELEVATION])
        right = [-np.sin(a), np.cos(a), 0.0]
        return np.array([right, [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)]])

    def flat(self, points: Array) -> Array:
        """Return points or displacements (… x 3) on the paper (… x 2), y upwards."""
        return np.asarray(points @ self.view.T)

    def surface(
        self, mode: int | None = None, reach: float = 0.0, limit: int | None = None
    ) -> list[tuple[Array, str]]:
        """Return the faces of a structure on the paper, displaced in a mode times `reach`, and their shades.

        The farthest come first, so that nearer ones cover them; of a closed surface those that face away are
        left out. Of more than so many, a coarser surface.
        """
        moved = reach * self.array("displacement", 3)[mode] if mode is not None else 0.0
        faces = self.faces if limit is None else coarser(self.faces, self.position, limit)
        axes = np.vstack([self.view, np.cross(*self.view)])
        corners = (self.position + moved)[faces] @ axes.T  # to the right, up, towards the eye
        normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        sizes = np.linalg.norm(normals, axis=1) * np.linalg.norm(_LIGHT)
        lit = np.abs(normals @ _LIGHT) / np.where(sizes > 0, sizes, 1.0)
        shades = [*FACES]
        steps = np.minimum((1 - lit) * len(shades), len(shades) - 1).astype(int)
        order = np.argsort(corners[..., 2].mean(axis=1), kind="stable")
        _, times = np.unique(np.sort(sides_of(faces), axis=1), axis=0, return_counts=True)
        if len(times) and not (times % 2).any():
            volume = np.sum(normals * corners.mean(axis=1))  # its sign says which way the faces are numbered
            order = order[(np.sign(volume) * normals[:, 2])[order] > 0]
        return [(corners[face, :, :2], shades[steps[face]]) for face in order.tolist()]

    @cached_property
    def beams(self) -> NDArray[np.int64]:
        """The lines that are no sides of faces (line x end)."""
        drawn = set(map(tuple, np.sort(sides_of(self.faces), axis=1).tolist()))
        return self.edges[[tuple(sorted(edge)) not in drawn for edge in self.edges.tolist()]]

    def polylines(
        self, mode: int | None = None, limit: int = _MOST, edges: NDArray[np.int64] | None = None
    ) -> list[tuple[Array, Array]]:
        """Return lines at rest, and their displacements in a mode, on the paper; beams bend (Hermite).

        Of more than so many lines, the outer ones. `edges`: the lines (line x end); default: all.
        """
        edges = outer_lines(self.edges if edges is None else edges, limit)
        moved, turned = np.zeros_like(self.position), None
        if mode is not None:
            moved, rotation = self.array("displacement", 3)[mode], self.array("rotation", 3)
            turned = rotation[mode] if len(rotation) and len(edges) <= _BENT else None
        flat, flatly = self.flat(self.position), self.flat(moved)
        if not len(edges) and not len(self.faces):  # nodes without lines are short strokes
            stroke = np.array([[-1.0, 0.0], [1.0, 0.0]]) * 0.008 * (np.ptp(flat, axis=0).max() or 1.0)
            return [(point + stroke, by + 0 * stroke) for point, by in zip(flat, flatly, strict=True)]
        chains: list[list[int]] = []
        for a, b in edges.tolist():
            if chains and chains[-1][-1] == a:  # lines that follow one another are one
                chains[-1].append(b)
            else:
                chains.append([a, b])
        if turned is None:
            return [(flat[chain], flatly[chain]) for chain in chains]
        lines = (bent_line(chain, self.position, moved, turned) for chain in chains)
        return [(self.flat(points), self.flat(by)) for points, by in lines]


def bent_line(chain: Sequence[int], position: Array, moved: Array, turned: Array) -> tuple[Array, Array]:
    """Return points along nodes (n x 3) that move and turn, and displacements, cubic across each line."""
    t = np.linspace(0, 1, _FINE + 1)[:, None]
    points, displacements = [], []
    for a, b in pairwise(chain):
        start, along = position[a], position[b] - position[a]
        chord, size = moved[b] - moved[a], float(along @ along)
        # What the rotations of the ends add across the straight line between them.
        slopes = [np.cross(turned[node], along) - chord for node in (a, b)]
        slopes = [slope - along * (slope @ along) / size if size else slope for slope in slopes]
        bend = slopes[0] * (t - 2 * t**2 + t**3) + slopes[1] * (t**3 - t**2)
        points.append(start + t * along)
        displacements.append(moved[a] + t * chord + bend)
    return np.concatenate(points), np.concatenate(displacements)


def figures(result: Result) -> Iterator[Figure]:
    """Yield the picture of the geometry in a result, where no schematic is drawn."""
    if plane_geometry(result) is None:
        space = Space(result)
        yield Figure("structure", "Structure", lambda: _SpaceDrawing(space, result.title).picture())


class _SpaceDrawing:
    """The structure with what is attached to it; y downwards, px."""

    def __init__(self, space: Space, title: str) -> None:
        self.space, self.title = space, title
        flat = space.flat(space.position)
        low, high = flat.min(axis=0), flat.max(axis=0)
        width, height = (high - low).tolist()
        self.scale = min(_WIDTH / width if width else np.inf, _HEIGHT / height if height else np.inf)
        self.scale = self.scale if np.isfinite(self.scale) else 1.0
        self.low, self.high = low, high
        self.boxes: list[tuple[float, float, float, float]] = []
        self.strokes: list[Point] = []
        self.texts: list[tuple[Point, str, str]] = []
        self.svg = Svg("structure", f"Structure of {title}")

    def at(self, point: Array) -> Point:
        x, y = self.space.flat(point)
        return self.scale * float(x - self.low[0]), self.scale * float(self.high[1] - y)

    def picture(self) -> Picture:
        space, svg = self.space, self.svg
        self._draw_lines()
        self._draw_supports()
        self._draw_joints()
        for what, cls in (("load", "s2"), ("sensor", "s3"), ("shape_sensor", "s3")):
            self._draw_arrows(what, cls)
        if len(space.nodes) <= _NUMBERED:
            named_points = zip(space.nodes, space.position, strict=True)
            self.texts += [(self.at(point), name, "small muted") for name, point in named_points]
        for text in self.texts:
            self._write(*text)
        self._draw_axes()
        sensors = len(space.names("sensor")) + len(space.names("shape_sensor"))
        parts = [*((len(space.names(what)), what) for what in ("joint", "load")), (sensors, "sensor")]
        texts = [f"{count} {what}{'s' * (count != 1)}" for count, what in parts if count]
        about = f"The structure, {len(space.nodes)} nodes" + (f", with {', '.join(texts)}." if texts else ".")
        if len(space.edges) < space.lines:
            about += f" {len(space.edges):,} of its {space.lines:,} lines are drawn."
        if not space.is_plane:
            about += " Seen from above and aside, in parallel projection."
        left, top, right, bottom = (
            pick(box[index] for box in self.boxes) for index, pick in enumerate((min, min, max, max))
        )
        size = right - left + 2 * _PAD, bottom - top + 2 * _PAD
        return Picture(svg.render(*size, left - _PAD, top - _PAD), about, self._table())

    def _table(self) -> FigureTable:
        rows: list[tuple[CellValue, ...]] = []
        for what in ("joint", "load", "sensor", "shape_sensor"):
            places = self.space.array(f"{what}_position", 3)
            along = self.space.array(f"{what}_direction", 3)
            for k, name in enumerate(self.space.names(what)):
                ends = places[k].reshape(-1, 3)
                way = "" if what == "joint" else ", ".join(f"{value + 0.0:.3g}" for value in along[k])
                rows.append((name, what.removeprefix("shape_"), *map(float, ends[0]), way))
        return FigureTable(("name", "what", "x, m", "y, m", "z, m", "direction"), tuple(rows))

    def _draw_lines(self) -> None:
        space, svg = self.space, self.svg
        surface = space.surface()
        for corners, shade in surface:
            svg.element("path", f"hair {shade}", d=path_of(self._placed(corners), closed=True))
        beams = [rest for rest, _ in space.polylines(edges=space.beams) if len(rest) > 1]
        if len(space.edges) <= _FEW:
            for a, b in space.edges.tolist():
                self._keep_clear(self.at(space.position[a]), self.at(space.position[b]))
        if beams:
            drawn = "".join(path_of(self._placed(rest)) for rest in beams)
            svg.element("path", "bond" if len(space.edges) <= _FEW else "hair", d=drawn)
        flat = space.flat(space.position)
        few = len(flat) <= _FEW
        extreme = {int(pick(flat[:, axis])) for pick in (np.argmin, np.argmax) for axis in (0, 1)}
        for node in range(len(flat)) if few or not (beams or surface) else extreme:
            x, y = self.at(space.position[node])
            self.boxes.append((x, y, x, y))
            if (few and not surface) or not (beams or surface):
                svg.circle(x, y, 2.2, "solid")

    def _keep_clear(self, start: Point, end: Point) -> None:
        steps = int(max(abs(end[0] - start[0]), abs(end[1] - start[1])) // 4) + 2
        self.strokes += zip(
            np.linspace(start[0], end[0], steps), np.linspace(start[1], end[1], steps), strict=True
        )

    def _placed(self, points: Array) -> Iterator[Point]:
        for x, y in points.tolist():
            yield self.scale * (x - float(self.low[0])), self.scale * (float(self.high[1]) - y)

    def _draw_supports(self) -> None:
        held = self.space.array("held", 3).astype(bool)
        some = [node for node, ways in enumerate(held) if ways.any()]
        for node in some:
            x, y = self.at(self.space.position[node])
            ways = ", ".join(way for way, fixed in zip("xyz", held[node], strict=True) if fixed)
            self.svg.open(tip=f"node {self.space.nodes[node]}: {ways} held")
            if len(some) <= _WRITTEN:
                pin(self.svg, x, y)
                self.boxes.append((x - 18, y + 3, x + 18, y + 27))
            else:
                self.svg.rect(x - 2.5, y - 2.5, 5, 5, "solid")
            self.svg.close()

    def _draw_joints(self) -> None:
        places = self.space.array("joint_position", 3)
        for name, ends in zip(self.space.names("joint"), places, strict=True):
            points = [self.at(end) for end in ends]
            self.svg.open(tip=f"joint {name}")
            if points[0] != points[1]:
                self.svg.line(*points, cls="bond mark")
                self._keep_clear(*points)
            for x, y in dict.fromkeys(points):
                self.svg.circle(x, y, 5, "line mark")
            self.svg.close()
            middle = (points[0][0] + points[1][0]) / 2, (points[0][1] + points[1][1]) / 2
            self.texts.append((middle, name, "small marked"))

    def _draw_arrows(self, what: str, cls: str) -> None:
        """Draw loads, which point at their nodes, and sensors, which point away from them."""
        space, names = self.space, self.space.names(what)
        turns = space.array(f"{what}_turns", 1).ravel()
        ways = space.array(f"{what}_direction", 3)
        for k, (name, point) in enumerate(zip(names, space.array(f"{what}_position", 3), strict=True)):
            x, y = self.at(point)
            dx, dy = (float(component) for component in space.flat(ways[k]))
            size = float(np.hypot(dx, dy))
            self.svg.open(tip=f"{what.removeprefix('shape_')} {name}")
            if size < 0.15:  # along the line of sight, or about it
                self.svg.circle(x, y, 6, f"frame {cls}")
                self.svg.circle(x, y, 2, f"{cls} dot")
                tip = (x, y)
            else:
                step = (_ARROW * dx / size, -_ARROW * dy / size)
                start, end = ((-1.15, -0.15), (0.15, 1.15))[what != "load"]
                points = [(x + share * step[0], y + share * step[1]) for share in (start, end)]
                self.svg.arrow(*points, cls=f"bond {cls}", head=f"{cls} dot", heads=1 + bool(turns[k]))
                tip = points[what != "load"]
                self.boxes.append((*points[0], *points[0]))
                self.boxes.append((*points[1], *points[1]))
                self._keep_clear(*points)
            self.svg.close()
            if len(names) <= _WRITTEN:
                self.texts.append((tip, name, f"small {cls}"))

    def _draw_axes(self) -> None:
        left, bottom = min(box[0] for box in self.boxes), max(box[3] for box in self.boxes)
        x, y = left + 24.0, bottom + 44.0
        for name, way in zip("xyz", np.eye(3), strict=True):
            dx, dy = (float(component) for component in self.space.flat(way))
            if dx or dy:
                self.svg.line((x, y), (x + 22 * dx, y - 22 * dy), cls="frame")
                self.svg.text(x + 30 * dx, y - 30 * dy + 3, name, "small muted")
        self.boxes.append((left, y - 36, x + 36, y + 22))

    def _write(self, at: Point, text: str, cls: str) -> None:
        """Write a text beside a point where nothing else is written; else it is left to the table."""
        width = text_width(text, SMALL)
        strokes = np.array(self.strokes).reshape(-1, 2)
        for dx, dy, anchor in _BESIDE:
            x, y = at[0] + dx, at[1] + dy
            left = x - {"start": 0.0, "middle": width / 2, "end": width}[anchor]
            box = (left, y - 0.8 * SMALL, left + width, y + 0.25 * SMALL)
            if ((strokes > box[:2]) & (strokes < box[2:])).all(axis=1).any():
                continue
            if all(
                box[2] <= drawn_box[0]
                or drawn_box[2] <= box[0]
                or box[3] <= drawn_box[1]
                or drawn_box[3] <= box[1]
                for drawn_box in self.boxes
            ):
                self.boxes.append(box)
                halo = " halo" * (len(self.space.faces) > 0)
                self.svg.text(x, y, text, cls + halo, anchor=anchor)
                return


_BESIDE = tuple(
    (dx, dy, anchor)
    for far in (0, 12, 24)
    for dx, dy, anchor in (
        (7, 13 + far, "start"),
        (7, -6 - far, "start"),
        (-7, -6 - far, "end"),
        (-7, 13 + far, "end"),
        (10, 3.5, "start"),
        (-10, 3.5, "end"),
        (0, -10 - far, "middle"),
        (0, 18 + far, "middle"),
    )
)
