"""Where everything of a bond graph stands: a spine from left to right, trees hanging above and below it.

The spine of a tree is a longest path, through the port and from the source where there is one; that of a
graph with loops is the part that the loops hold together, in columns of a plane embedding. What is left are
trees, which hang on it. A bond leaves and reaches a node at a place of its own, straight, where its stroke
and arrow are; it turns only between columns or levels. So nothing overlaps, by construction.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise

from dynid.report.drawing.columns import Item, Spine, Stop
from dynid.report.drawing.forest import GAP, RUN, Forest, depth, grow
from dynid.report.drawing.sketch import PORT, Sketch
from dynid.report.drawing.spine import spine_of
from dynid.report.svg import Point

#: Least distance between columns or levels, without the straight ends of bonds; most slope of a bond there.
CHANNEL, SLOPE = 14.0, 1.7


@dataclass(frozen=True)
class Box:
    """A rectangle, by its corners."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def centre(self) -> Point:
        """Its middle."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    def moved(self, x: float, y: float) -> Box:
        """Return it elsewhere."""
        return Box(self.left + x, self.top + y, self.right + x, self.bottom + y)


@dataclass
class Layout:
    """A laid out sketch.

    Parameters
    ----------
    boxes
        The box of every node.
    routes
        The points of every bond from tail to head, in the sketch's order; the first and the last stretch are
        horizontal or vertical and at least `RUN` long.
    crossings
        How many bonds cross another one.
    """

    boxes: dict[str, Box] = field(default_factory=dict)
    routes: list[list[Point]] = field(default_factory=list)
    crossings: int = 0

    @property
    def frame(self) -> Box:
        """The box around everything."""
        boxes = self.boxes.values()
        xs = [x for box in boxes for x in (box.left, box.right)] + [p[0] for r in self.routes for p in r]
        ys = [y for box in boxes for y in (box.top, box.bottom)] + [p[1] for r in self.routes for p in r]
        return Box(min(xs), min(ys), max(xs), max(ys)) if xs else Box(0, 0, 0, 0)


def lay_out(sketch: Sketch) -> Layout:
    """Lay out a sketch; parts that nothing ties stand below each other."""
    whole = Layout(routes=[[] for _ in sketch.links])
    below = 0.0
    for spine in spine_of(sketch):
        part = _Part(sketch, spine)
        part.place()
        frame = part.frame()
        for name, box in part.boxes.items():
            whole.boxes[name] = box.moved(-frame.left, below - frame.top)
        for index, route in part.routes.items():
            whole.routes[index] = [(x - frame.left, y + below - frame.top) for x, y in route]
        whole.crossings += spine.crossings
        below += frame.bottom - frame.top + 2 * GAP
    return whole


class _Part:
    """The layout of one connected part."""

    def __init__(self, sketch: Sketch, spine: Spine) -> None:
        self.sketch, self.spine = sketch, spine
        self.vertices = {vertex.key: vertex for vertex in sketch.vertices}
        self.boxes: dict[str, Box] = {}
        self.routes: dict[int, list[Point]] = {}
        self.children = spine.children
        self.sides: dict[str, tuple[list[str], list[str]]] = {}  # trees above and below, of the spine's nodes
        for column in spine.columns:
            for item in column.items:
                if item.name is not None:
                    self.sides[item.name] = self._halves(item.name)

    def _halves(self, name: str) -> tuple[list[str], list[str]]:
        """Split the trees on a node of the spine into those above and those below."""
        trees = sorted(self.children[name], key=lambda tree: -depth(tree, self.children))
        return sorted(trees[1::2], key=trees.index), sorted(trees[0::2], key=trees.index)

    def size(self, name: str) -> tuple[float, float]:
        """Return width and height of a node: room for its text and for its bonds."""
        vertex = self.vertices[name]
        if name in self.sides:
            across = max(len(side) for side in self.sides[name])
            along = max(self.spine.ports[name])
        else:
            across, along = max(len(self.children[name]), 1), 0
        return max(vertex.width, across * PORT), max(vertex.height, along * PORT)

    def place(self) -> None:
        """Place the nodes of the spine with all that hangs on them, then the bonds between columns."""
        forests = {
            name: [grow(name, side, self.children, self.size) for side in sides]
            for name, sides in self.sides.items()
        }
        depths = {name: [self._levels(forest) for forest in pair] for name, pair in forests.items()}
        self._set_heights(depths)
        lefts, rights = [], []
        for column in self.spine.columns:
            left, right = 0.0, 0.0
            for item in column.items:
                a, b = (-item.across, item.across)
                if item.name is not None:
                    a, b = self._extent(item.name, forests[item.name])
                left, right = min(left, a), max(right, b)
            lefts.append(left)
            rights.append(right)
        channels = self._channels()
        x = 0.0
        edges: list[tuple[float, float]] = []
        for place, column in enumerate(self.spine.columns):
            x = x + channels[place - 1] + rights[place - 1] - lefts[place] if place else -lefts[0]
            edges.append((x + lefts[place], x + rights[place]))
            for item in column.items:
                if item.name is not None:
                    self._put(item, x, forests[item.name], depths[item.name])
        self._route_spine(edges)

    def _extent(self, name: str, forests: list[Forest]) -> tuple[float, float]:
        """Return how far a node and its trees reach to the left and to the right."""
        half = self.size(name)[0] / 2
        west, east = self.spine.ports[name]
        left, right = [-half - (RUN if west else 0)], [half + (RUN if east else 0)]
        for forest in forests:
            for other, x in forest.x.items():
                reach = self.size(other)[0] / 2
                left.append(x - reach)
                right.append(x + reach)
        return min(left) - GAP / 2, max(right) + GAP / 2

    def _levels(self, forest: Forest) -> list[tuple[float, float]]:
        """Return for every level how far from the node it begins, and its height."""
        levels, start = [], 0.0
        for names in forest.levels:
            slant = max(abs(self._port(forest, name) - forest.x[name]) for name in names)
            start += 2 * RUN + (max(CHANNEL, slant / SLOPE) if slant > 0.5 else 0.0)
            height = max(self.size(name)[1] for name in names)
            levels.append((start, height))
            start += height
        return levels

    def _port(self, forest: Forest, name: str) -> float:
        """Return where the bond to a node leaves what the node hangs on."""
        parent = forest.parent[name]
        siblings = sorted(
            (other for other, above in forest.parent.items() if above == parent), key=forest.x.__getitem__
        )
        return forest.x[parent] + PORT * (siblings.index(name) - (len(siblings) - 1) / 2)

    def _set_heights(self, depths: dict[str, list[list[tuple[float, float]]]]) -> None:
        """Give every item of the spine its room above and below, then its height."""
        for column in self.spine.columns:
            for item in column.items:
                if item.name is None:
                    continue
                half = self.size(item.name)[1] / 2
                item.up, item.down = (
                    half + (levels[-1][0] + levels[-1][1] if levels else 0) + GAP / 2
                    for levels in depths[item.name]
                )
        self.spine.settle()

    def _channels(self) -> list[float]:
        """Return how wide the space between neighbouring columns has to be."""
        widths = [CHANNEL if column.items else 0.0 for column in self.spine.columns]
        for route in self.spine.routes.values():
            for a, b in pairwise(route):
                rise, left = abs(a.y_out - b.y_in), min(a.column, b.column)
                widths[left] = max(widths[left], CHANNEL + rise / SLOPE if rise > 0.5 else CHANNEL)
        return widths

    def _put(
        self, item: Item, x: float, forests: list[Forest], depths: list[list[tuple[float, float]]]
    ) -> None:
        """Place a node of the spine, its trees, and their bonds."""
        assert item.name is not None
        width, height = self.size(item.name)
        y = item.y
        self.boxes[item.name] = Box(x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        for forest, levels, sign in zip(forests, depths, (-1, 1), strict=True):
            border = y + sign * height / 2
            for names, (start, _) in zip(forest.levels, levels, strict=True):
                for name in names:
                    w, h = self.size(name)
                    near = border + sign * start
                    top, bottom = sorted((near, near + sign * h))
                    self.boxes[name] = Box(
                        x + forest.x[name] - w / 2, top, x + forest.x[name] + w / 2, bottom
                    )
                for name in names:
                    self._hang(name, forest, x, sign, near=border + sign * start)

    def _hang(self, name: str, forest: Forest, x: float, sign: int, near: float) -> None:
        """Route the bond of a node that hangs on another one."""
        parent = self.boxes[forest.parent[name]]
        leave = parent.bottom if sign > 0 else parent.top
        port, own = x + self._port(forest, name), x + forest.x[name]
        link = self.spine.hanging[name]
        if abs(port - own) < 0.5:
            points = [(own, leave), (own, near)]
        else:
            points = [(port, leave), (port, near - sign * (RUN + self._slant(forest, name)))]
            points += [(own, near - sign * RUN), (own, near)]
        outward = self.sketch.links[link].head == name
        self.routes[link] = points if outward else points[::-1]

    def _slant(self, forest: Forest, name: str) -> float:
        """Return the room between levels in which bonds turn."""
        level = next(names for names in forest.levels if name in names)
        slant = max(abs(self._port(forest, other) - forest.x[other]) for other in level)
        return max(CHANNEL, slant / SLOPE)

    def _route_spine(self, edges: list[tuple[float, float]]) -> None:
        """Route the bonds between columns."""
        for link, route in self.spine.routes.items():
            points: list[Point] = []
            for place, stop in enumerate(route):
                before = route[place - 1] if place else None
                after = route[place + 1] if place + 1 < len(route) else None
                points += self._passing(stop, before, after, edges[stop.column])
            self.routes[link] = _straightened(points)

    def _passing(
        self, stop: Stop, before: Stop | None, after: Stop | None, edges: tuple[float, float]
    ) -> list[Point]:
        """Return the points of a bond within a column."""
        come, go = (None if near is None else near.column > stop.column for near in (before, after))
        points = [] if come is None else [(edges[come], stop.y_in)]
        if stop.item.name is not None:
            box = self.boxes[stop.item.name]
            east = bool(go if come is None else come)
            points.append((box.right if east else box.left, stop.y_in))
        elif come == go:  # a crossing on which a bond turns back
            points.append(((edges[0] + edges[1]) / 2, stop.item.y))
        return points if go is None else [*points, (edges[go], stop.y_out)]

    def frame(self) -> Box:
        """Return the box around everything."""
        return Layout(self.boxes, list(self.routes.values())).frame


def _straightened(points: Iterable[Point]) -> list[Point]:
    """Leave out points on straight lines, and steps that nobody sees."""
    kept: list[Point] = []
    for x, height in points:
        y = kept[-1][1] if kept and abs(kept[-1][1] - height) < 0.5 else height
        if len(kept) > 1 and kept[-2][1] == kept[-1][1] == y:
            kept.pop()
        kept.append((x, y))
    return kept
