"""Layered layout of a bond graph: its spine in columns from left to right, with a height for every node.

The spine of a tree is a longest path, through the port and from the source where there is one. The spine of a
graph with loops is the subgraph without leaves; bonds that pass a column have an item in it. All other nodes
are trees that hang on the spine.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

from dynid.report.drawing.column_order import ColumnOrder, ranks
from dynid.report.drawing.sketch import PORT, Sketch

_SWEEPS, _STRAIGHT = 60, 4
_LANE_WEIGHT = 4.0  # straightness of long bonds counts more than centring a node among its neighbours

Ties = Mapping[str, list[tuple[str, int]]]


@dataclass(eq=False)
class LayoutItem:
    """An item of a column, a named node or a passing bond: space above and below, and its height y, px."""

    name: str | None = None
    up: float = PORT / 2
    down: float = PORT / 2
    y: float = 0.0


@dataclass
class Waypoint:
    """A point of a bond's route: it enters and leaves at heights relative to an item of a column."""

    item: LayoutItem
    column: int
    enter: float = 0.0
    leave: float = 0.0

    @property
    def y_in(self) -> float:
        """Height at which the bond enters."""
        return self.item.y + self.enter

    @property
    def y_out(self) -> float:
        """Height at which the bond leaves."""
        return self.item.y + self.leave


@dataclass
class LayeredLayout:
    """The spine of a connected part of a sketch, and the trees that hang on it.

    Columns are from left to right, their items from top to bottom. `routes` are the waypoints of the spine's
    bonds from tail to head, by their index in the sketch; `ports` the numbers of bonds to the left and right
    of its nodes. Of the trees, `children` are the nodes that hang on every node, `hanging` the bond by which
    each of them hangs.
    """

    columns: list[list[LayoutItem]]
    routes: dict[int, list[Waypoint]]
    ports: dict[str, tuple[int, int]]
    children: dict[str, list[str]]
    hanging: dict[str, int]
    crossings: int

    def assign_heights(self) -> None:
        """Give every item its height: bonds as straight as the space of all items allows."""
        ties: dict[LayoutItem, list[tuple[LayoutItem, float, bool]]] = {
            item: [] for column in self.columns for item in column
        }
        for route in self.routes.values():
            for a, b in pairwise(route):
                ties[a.item].append((b.item, b.enter - a.leave, b.column < a.column))
                ties[b.item].append((a.item, a.leave - b.enter, a.column < b.column))
        for column in self.columns:
            _place_apart(column, [0.0] * len(column))
        for sweep in range(_SWEEPS + _STRAIGHT):
            straight = sweep >= _SWEEPS
            for column in self.columns if sweep % 2 or straight else self.columns[::-1]:
                _place_apart(column, [_preferred_height(item, ties[item], straight) for item in column])


def _preferred_height(item: LayoutItem, ties: list[tuple[LayoutItem, float, bool]], straight: bool) -> float:
    """Return the height at which an item's bonds rise least; of several, the middle or the straightest."""
    if not ties:
        return item.y
    heights = sorted(neighbour.y + offset for neighbour, offset, _ in ties)
    low, high = heights[(len(heights) - 1) // 2], heights[len(heights) // 2]
    before = sorted(neighbour.y + offset for neighbour, offset, is_before in ties if is_before)
    if not straight or not before:
        return (low + high) / 2
    return min(max(before[len(before) // 2], low), high)


def _place_apart(items: list[LayoutItem], preferred: list[float]) -> None:
    """Place items in order, without overlap, at the least squared distance from their preferred heights.

    Isotonic regression by pooling adjacent violators.
    """
    pools: list[tuple[float, float, int]] = []  # mean, weight, number of members
    space, shift = [], 0.0
    for index, item in enumerate(items):
        shift += items[index - 1].down + item.up if index else 0.0
        space.append(shift)
        mean = preferred[index] - shift
        weight, members = (1.0 if item.name is not None else _LANE_WEIGHT), 1
        while pools and pools[-1][0] > mean:
            pool, heavy, count = pools.pop()
            mean = (mean * weight + pool * heavy) / (weight + heavy)
            weight, members = weight + heavy, members + count
        pools.append((mean, weight, members))
    heights = [mean for mean, _, members in pools for _ in range(members)]
    for item, height, offset in zip(items, heights, space, strict=True):
        item.y = height + offset


def layered_layouts(sketch: Sketch) -> Iterator[LayeredLayout]:
    """Yield the layered layout of every connected part of a sketch."""
    ties: dict[str, list[tuple[str, int]]] = {node.key: [] for node in sketch.nodes}
    for index, bond in enumerate(sketch.bonds):
        ties[bond.tail].append((bond.head, index))
        ties[bond.head].append((bond.tail, index))
    seen: set[str] = set()
    for start in ties:
        if start not in seen:
            component = _predecessors(start, ties)
            seen.update(component)
            yield _LayoutBuilder(sketch, {name: ties[name] for name in component}).layout()


def _predecessors(start: str, ties: Ties, without: str | None = None) -> dict[str, str]:
    """Return the nodes that are reachable, nearest first, each with the one before it (breadth first)."""
    above = {start: start}
    queue = deque([start])
    while queue:
        name = queue.popleft()
        for neighbour, _ in ties[name]:
            if neighbour not in above and neighbour != without:
                above[neighbour] = name
                queue.append(neighbour)
    return above


class _LayoutBuilder:
    def __init__(self, sketch: Sketch, ties: dict[str, list[tuple[str, int]]]) -> None:
        self.sketch, self.ties = sketch, ties

    def layout(self) -> LayeredLayout:
        """Return the layout; the spine of a tree is a path, that of a graph with loops its core."""
        degree = {name: len(near) for name, near in self.ties.items()}
        leaves = [name for name, count in degree.items() if count < 2]
        for name in leaves:  # which grows while leaves are removed
            degree[name] = 0
            for neighbour, _ in self.ties[name]:
                degree[neighbour] -= 1
                if degree[neighbour] == 1:
                    leaves.append(neighbour)
        gone = set(leaves)
        core = [name for name in self.ties if name not in gone]
        if core:
            return self._of_loops(core)
        cut, source = self.sketch.cut, self.sketch.source
        if cut is not None and cut[0] in self.ties:
            path = [*self._longest_path(cut[0], cut[1])[::-1], *self._longest_path(cut[1], cut[0])]
        else:
            end = self._longest_path(next(iter(self.ties)))[-1]
            path = self._longest_path(end)
            if source in self.ties:
                from_source = self._longest_path(str(source))
                path = from_source if len(from_source) * 2 > len(path) else path
        columns = [[LayoutItem(name)] for name in path]
        return self._finish(columns, dict(zip(path, range(len(path)), strict=True)), {}, 0)

    def _longest_path(self, start: str, without: str | None = None) -> list[str]:
        """Return the path to the farthest node; the source and the target count as a little farther."""
        above = _predecessors(start, self.ties, without)
        distance = {start: 0}
        for name, before in above.items():
            if name != start:
                distance[name] = distance[before] + 1
        farther = {self.sketch.target: 1.5, self.sketch.source: 2.5}
        end = max(distance, key=lambda name: distance[name] + farther.get(name, 0.0))
        path = [end]
        while path[-1] != start:
            path.append(above[path[-1]])
        return path[::-1]

    def _of_loops(self, core: list[str]) -> LayeredLayout:
        """Return the layout of a graph with loops, which the core is without its trees."""
        number = {name: k for k, name in enumerate(core)}
        bonds = sorted(
            {index for name in core for neighbour, index in self.ties[name] if neighbour in number}
        )
        ends = {index: (self.sketch.bonds[index].tail, self.sketch.bonds[index].head) for index in bonds}
        graph: dict[int, set[int]] = {k: set() for k in range(len(core))}
        for tail, head in ends.values():
            graph[number[tail]].add(number[head])
            graph[number[head]].add(number[tail])
        left, right = self._ends(core)
        rank = ranks(graph, number[left[-1]], number[right[0]])
        first = len(left) - 1
        count = first + max(rank.values()) + 1
        column_of = {name: first + rank[number[name]] for name in core}
        column_of |= {name: k for k, name in enumerate(left[:-1])}
        column_of |= {name: k for k, name in enumerate(right[1:], count)}
        columns: list[list[LayoutItem]] = [[] for _ in range(count + len(right) - 1)]
        item = {name: LayoutItem(name) for name in column_of}
        for name, column in column_of.items():
            columns[column].append(item[name])
        routes: dict[int, list[Waypoint]] = {}
        for index, (tail, head) in ends.items():
            step = 1 if column_of[head] > column_of[tail] else -1
            lanes = [
                Waypoint(LayoutItem(), column)
                for column in range(column_of[tail] + step, column_of[head], step)
            ]
            for lane in lanes:
                columns[lane.column].append(lane.item)
            routes[index] = [
                Waypoint(item[tail], column_of[tail]),
                *lanes,
                Waypoint(item[head], column_of[head]),
            ]
        links = [
            (a.item, b.item) if a.column < b.column else (b.item, a.item)
            for route in routes.values()
            for a, b in pairwise(route)
        ]
        return self._finish(columns, column_of, routes, ColumnOrder(columns, links).improve())

    def _ends(self, core: list[str]) -> tuple[list[str], list[str]]:
        """Return the paths from the source into the loops, and out of them to the target."""
        inside = set(core)

        def path(end: str | None) -> list[str]:
            if end not in self.ties:
                return []
            above = _predecessors(core[0], self.ties)
            names = [str(end)]
            while names[-1] not in inside:
                names.append(above[names[-1]])
            return names

        left, right = path(self.sketch.source), path(self.sketch.target)[::-1]
        left = left or [core[0] if not right or core[0] != right[0] else core[1]]
        if right and right[0] != left[-1]:
            return left, right
        farthest = [name for name in _predecessors(left[-1], self.ties) if name in inside][-1]
        return left, [farthest]

    def _finish(
        self,
        columns: list[list[LayoutItem]],
        column_of: dict[str, int],
        routes: dict[int, list[Waypoint]],
        crossings: int,
    ) -> LayeredLayout:
        """Route the other bonds of the spine, spread the bonds at its nodes, and attach the trees."""
        item = {i.name: i for column in columns for i in column if i.name is not None}
        for name in column_of:
            for _, index in self.ties[name]:
                bond = self.sketch.bonds[index]
                if index not in routes and bond.tail in column_of and bond.head in column_of:
                    routes[index] = [Waypoint(item[end], column_of[end]) for end in (bond.tail, bond.head)]
        _spread_bonds(columns, routes)
        ports = {name: [0, 0] for name in column_of}
        for route in routes.values():
            for end, near in ((route[0], route[1]), (route[-1], route[-2])):
                ports[str(end.item.name)][near.column > end.column] += 1
        children: dict[str, list[str]] = {name: [] for name in self.ties}
        hanging: dict[str, int] = {}
        queue = list(column_of)
        for name in queue:
            for neighbour, index in self.ties[name]:
                if neighbour not in column_of and neighbour not in hanging and index != hanging.get(name):
                    children[name].append(neighbour)
                    hanging[neighbour] = index
                    queue.append(neighbour)
        sides = {name: (west, east) for name, (west, east) in ports.items()}
        return LayeredLayout(columns, routes, sides, children, hanging, crossings)


def _spread_bonds(columns: list[list[LayoutItem]], routes: dict[int, list[Waypoint]]) -> None:
    """Spread the bonds on either side of an item, in the order of the items they lead to."""
    order = {item: position for column in columns for position, item in enumerate(column)}
    sides: dict[tuple[LayoutItem, bool], list[tuple[int, int, Waypoint, bool]]] = {}
    for index, route in routes.items():
        for a, b in pairwise(route):
            for here, there, leaving in ((a, b, True), (b, a, False)):
                side = sides.setdefault((here.item, there.column > here.column), [])
                side.append((order[there.item], index, here, leaving))
    # Bonds to one item keep their order.
    for entries in sides.values():
        entries.sort(key=lambda entry: entry[:2])
        for number, (_, _, waypoint, leaving) in enumerate(entries):
            offset = PORT * (number - (len(entries) - 1) / 2)
            if leaving:
                waypoint.leave = offset
            else:
                waypoint.enter = offset
    for route in routes.values():
        route[0].enter, route[-1].leave = route[0].leave, route[-1].enter
