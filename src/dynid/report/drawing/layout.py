"""Layout of a bond graph: the spine in columns from left to right, trees above and below its nodes.

A bond leaves and reaches a node at a place of its own, along a straight segment that carries its stroke and
arrow; it turns only between columns or levels. Nothing overlaps, by construction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from dynid.report.drawing.layered_layout import LayeredLayout, LayoutItem, Waypoint, layered_layouts
from dynid.report.drawing.sketch import PORT, Sketch
from dynid.report.svg import Point

#: Length of the straight segment of a bond at a node, for its stroke and arrow; least distance of boxes; px.
RUN, GAP = 22.0, 16.0
#: Least distance between columns or levels, without the straight segments; greatest slope of a bond there.
CHANNEL, SLOPE = 6.0, 2.8
#: Steps of a bond below this are drawn straight, px.
_STEP = 4.0

_Outline = list[tuple[float, float]]


@dataclass(frozen=True)
class Box:
    """A rectangle, by its corners."""

    left: float
    top: float
    right: float
    bottom: float

    @property
    def centre(self) -> Point:
        """Its centre."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    def moved(self, x: float, y: float) -> Box:
        """Return the box moved by x and y."""
        return Box(self.left + x, self.top + y, self.right + x, self.bottom + y)


@dataclass
class GraphLayout:
    """A sketch that is laid out: the box of every node, and the points of every bond from tail to head.

    The first and the last segment of a bond are horizontal or vertical and at least `RUN` long.
    """

    boxes: dict[str, Box] = field(default_factory=dict)
    routes: list[list[Point]] = field(default_factory=list)
    crossings: int = 0

    @property
    def frame(self) -> Box:
        """Bounding box of nodes and bonds."""
        boxes = self.boxes.values()
        xs = [x for box in boxes for x in (box.left, box.right)] + [p[0] for r in self.routes for p in r]
        ys = [y for box in boxes for y in (box.top, box.bottom)] + [p[1] for r in self.routes for p in r]
        return Box(min(xs), min(ys), max(xs), max(ys)) if xs else Box(0, 0, 0, 0)


@dataclass
class _TreeLayout:
    """Trees side by side over one node at x = 0: nodes by level from left to right, and their parents."""

    x: dict[str, float] = field(default_factory=dict)
    levels: list[list[str]] = field(default_factory=list)
    parent: dict[str, str] = field(default_factory=dict)

    def port(self, name: str) -> float:
        """Return the horizontal position at which the bond to a node leaves its parent."""
        parent = self.parent[name]
        siblings = sorted((n for n, above in self.parent.items() if above == parent), key=self.x.__getitem__)
        return self.x[parent] + PORT * (siblings.index(name) - (len(siblings) - 1) / 2)

    def slant(self, level: Iterable[str]) -> float:
        """Return the greatest horizontal distance that a bond to a node of a level covers."""
        return max(abs(self.port(name) - self.x[name]) for name in level)


def _tree_layout(
    root: str,
    trees: list[str],
    children: Mapping[str, list[str]],
    size: Callable[[str], tuple[float, float]],
) -> _TreeLayout:
    """Lay out the trees on one side of a node, as narrow as their outlines allow.

    `trees` are their first nodes, from left to right; `size` returns width and height of a node.
    """
    layout = _TreeLayout()
    order: list[str] = []
    stack = [(name, root, 0) for name in reversed(trees)]
    while stack:
        name, parent, level = stack.pop()
        layout.parent[name] = parent
        if level == len(layout.levels):
            layout.levels.append([])
        layout.levels[level].append(name)
        order.append(name)
        stack += [
            (child, name, level + 1) for child in reversed(_deepest_in_middle(children[name], children))
        ]
    outlines: dict[str, _Outline] = {}  # left and right of a subtree from its root, level by level
    offsets: dict[str, dict[str, float]] = {}
    for name in reversed(order):
        offsets[name], below = _side_by_side(_deepest_in_middle(children[name], children), outlines)
        half = size(name)[0] / 2
        outlines[name] = [(-half, half), *below]
    offsets[root], _ = _side_by_side(trees, outlines)
    layout.x[root] = 0.0
    for name in order:
        parent = layout.parent[name]
        layout.x[name] = layout.x[parent] + offsets[parent][name]
    return layout


def depth(name: str, children: Mapping[str, list[str]]) -> int:
    """Return the number of levels of a tree."""
    level, count = [name], 0
    while level:
        level = [child for parent in level for child in children[parent]]
        count += 1
    return count


def _deepest_in_middle(names: list[str], children: Mapping[str, list[str]]) -> list[str]:
    """Return siblings in an order that has the deepest tree in the middle."""
    if len(names) < 3:
        return names
    by_depth = sorted(names, key=lambda name: depth(name, children))
    return [*by_depth[0::2], *by_depth[1::2][::-1]]


def _side_by_side(names: list[str], outlines: Mapping[str, _Outline]) -> tuple[dict[str, float], _Outline]:
    """Return the offsets of subtrees that stand side by side, centred, and their common outline."""
    if not names:
        return {}, []
    places: list[float] = []
    joint: _Outline = []
    for name in names:
        outline = outlines[name]
        first = places[-1] + PORT if places else 0.0
        shift = max(
            [first, *(right + GAP - left for (_, right), (left, _) in zip(joint, outline, strict=False))]
        )
        shift = shift if places else 0.0
        places.append(shift)
        moved = [(left + shift, right + shift) for left, right in outline]
        shared = [(a[0], b[1]) for a, b in zip(joint, moved, strict=False)]
        joint = [*shared, *joint[len(shared) :], *moved[len(shared) :]]
    centre = places[len(places) // 2] if len(places) % 2 else (places[0] + places[-1]) / 2
    offsets = {name: position - centre for name, position in zip(names, places, strict=True)}
    return offsets, [(left - centre, right - centre) for left, right in joint]


def lay_out(sketch: Sketch) -> GraphLayout:
    """Lay out a sketch; its connected parts are placed below each other."""
    layout = GraphLayout(routes=[[] for _ in sketch.bonds])
    below = 0.0
    for spine in layered_layouts(sketch):
        component = _PartLayout(sketch, spine)
        frame = GraphLayout(component.boxes, list(component.routes.values())).frame
        for name, box in component.boxes.items():
            layout.boxes[name] = box.moved(-frame.left, below - frame.top)
        for index, route in component.routes.items():
            layout.routes[index] = [(x - frame.left, y + below - frame.top) for x, y in route]
        layout.crossings += spine.crossings
        below += frame.bottom - frame.top + 2 * GAP
    return layout


class _PartLayout:
    """Layout of one connected part: boxes of its nodes and routes of its bonds."""

    def __init__(self, sketch: Sketch, spine: LayeredLayout) -> None:
        self.sketch, self.spine = sketch, spine
        self.nodes = {node.key: node for node in sketch.nodes}
        self.boxes: dict[str, Box] = {}
        self.routes: dict[int, list[Point]] = {}
        self.children = spine.children
        self.sides: dict[str, tuple[list[str], list[str]]] = {}  # trees above and below nodes of the spine
        for column in spine.columns:
            for item in column:
                if item.name is not None:
                    trees = self.children[item.name]
                    trees = sorted(trees, key=lambda tree: -depth(tree, self.children))
                    self.sides[item.name] = (
                        sorted(trees[1::2], key=trees.index),
                        sorted(trees[0::2], key=trees.index),
                    )
        self._place()

    def size(self, name: str) -> tuple[float, float]:
        """Return width and height of a node: space for its text and for its bonds."""
        node = self.nodes[name]
        if name in self.sides:
            across = max(len(side) for side in self.sides[name])
            along = max(self.spine.ports[name])
        else:
            across, along = max(len(self.children[name]), 1), 0
        return max(node.width, across * PORT), max(node.height, along * PORT)

    def _place(self) -> None:
        """Place the nodes of the spine with their trees, then route the bonds between columns."""
        trees = {
            name: [_tree_layout(name, side, self.children, self.size) for side in sides]
            for name, sides in self.sides.items()
        }
        depths = {name: [self._levels(tree) for tree in pair] for name, pair in trees.items()}
        for column in self.spine.columns:
            for item in column:
                if item.name is not None:
                    half = self.size(item.name)[1] / 2
                    item.up, item.down = (
                        half + (levels[-1][0] + levels[-1][1] if levels else 0) + GAP / 2
                        for levels in depths[item.name]
                    )
        self.spine.assign_heights()
        columns = self._column_places(trees)
        for column, (x, _) in zip(self.spine.columns, columns, strict=True):
            for item in column:
                if item.name is not None:
                    self._put(item, item.name, x, trees[item.name], depths[item.name])
        for index, route in self.spine.routes.items():
            points: list[Point] = []
            for place, waypoint in enumerate(route):
                before = route[place - 1] if place else None
                after = route[place + 1] if place + 1 < len(route) else None
                points += self._passing(waypoint, before, after, columns[waypoint.column][1])
            # Without points on straight lines, and without steps too small to be read as such.
            kept: list[Point] = []
            for x, height in points:
                y = kept[-1][1] if kept and abs(kept[-1][1] - height) < _STEP else height
                if len(kept) > 1 and kept[-2][1] == kept[-1][1] == y:
                    kept.pop()
                kept.append((x, y))
            self.routes[index] = kept

    def _column_places(self, trees: dict[str, list[_TreeLayout]]) -> list[tuple[float, tuple[float, float]]]:
        """Return the x of every column, and its left and right edge, so that bonds between them fit."""
        lefts, rights = [], []
        for column in self.spine.columns:
            left, right = 0.0, 0.0
            for item in column:
                a, b = 0.0, 0.0
                if item.name is not None:  # a node with its trees
                    half = self.size(item.name)[0] / 2
                    west, east = self.spine.ports[item.name]
                    subtrees = [
                        (x, self.size(name)[0] / 2) for tree in trees[item.name] for name, x in tree.x.items()
                    ]
                    a = min([-half - (RUN if west else 0), *(x - reach for x, reach in subtrees)]) - GAP / 2
                    b = max([half + (RUN if east else 0), *(x + reach for x, reach in subtrees)]) + GAP / 2
                left, right = min(left, a), max(right, b)
            lefts.append(left)
            rights.append(right)
        channels = [CHANNEL if column else 0.0 for column in self.spine.columns]
        for route in self.spine.routes.values():
            for start, end in pairwise(route):
                rise, column_index = abs(start.y_out - end.y_in), min(start.column, end.column)
                channels[column_index] = max(
                    channels[column_index], CHANNEL + rise / SLOPE if rise > 0.5 else CHANNEL
                )
        x, places = 0.0, []
        for column_index in range(len(lefts)):
            x = (
                x + channels[column_index - 1] + rights[column_index - 1] - lefts[column_index]
                if column_index
                else -lefts[0]
            )
            places.append((x, (x + lefts[column_index], x + rights[column_index])))
        return places

    def _levels(self, tree: _TreeLayout) -> list[tuple[float, float]]:
        """Return the distance of every level from the node, and its height."""
        levels, start = [], 0.0
        for names in tree.levels:
            slant = tree.slant(names)
            start += 2 * RUN + (max(CHANNEL, slant / SLOPE) if slant > 0.5 else 0.0)
            height = max(self.size(name)[1] for name in names)
            levels.append((start, height))
            start += height
        return levels

    def _put(
        self,
        item: LayoutItem,
        root: str,
        x: float,
        trees: list[_TreeLayout],
        depths: list[list[tuple[float, float]]],
    ) -> None:
        """Place a node of the spine, its trees, and their bonds."""
        width, height = self.size(root)
        y = item.y
        self.boxes[root] = Box(x - width / 2, y - height / 2, x + width / 2, y + height / 2)
        for tree, levels, sign in zip(trees, depths, (-1, 1), strict=True):
            border = y + sign * height / 2
            for names, (start, _) in zip(tree.levels, levels, strict=True):
                near = border + sign * start
                for name in names:
                    w, h = self.size(name)
                    top, bottom = sorted((near, near + sign * h))
                    self.boxes[name] = Box(x + tree.x[name] - w / 2, top, x + tree.x[name] + w / 2, bottom)
                turn = max(CHANNEL, tree.slant(names) / SLOPE)  # the height in which bonds turn
                for name in names:
                    parent = self.boxes[tree.parent[name]]
                    leave = parent.bottom if sign > 0 else parent.top
                    port, centre = x + tree.port(name), x + tree.x[name]
                    if abs(port - centre) < 0.5:
                        points = [(centre, leave), (centre, near)]
                    else:
                        points = [(port, leave), (port, near - sign * (RUN + turn))]
                        points += [(centre, near - sign * RUN), (centre, near)]
                    bond = self.spine.hanging[name]
                    self.routes[bond] = points if self.sketch.bonds[bond].head == name else points[::-1]

    def _passing(
        self, here: Waypoint, before: Waypoint | None, after: Waypoint | None, edges: tuple[float, float]
    ) -> list[Point]:
        """Return the points of a bond within a column."""
        come, go = (None if near is None else near.column > here.column for near in (before, after))
        points = [] if come is None else [(edges[come], here.y_in)]
        if here.item.name is not None:
            box = self.boxes[here.item.name]
            east = bool(go if come is None else come)
            points.append((box.right if east else box.left, here.y_in))
        return points if go is None else [*points, (edges[go], here.y_out)]
