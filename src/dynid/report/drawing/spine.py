"""The spine of a drawing: its nodes and bonds in columns, found by planar embedding."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from itertools import pairwise

from dynid.report.drawing.columns import Column, Item, Spine, Stop
from dynid.report.drawing.layers import layers_of
from dynid.report.drawing.planar import Edge, Embedding, biconnecting
from dynid.report.drawing.sketch import PORT, Sketch


def spine_of(sketch: Sketch) -> Iterator[Spine]:
    """Yield the spine of every connected part of a sketch."""
    ties: dict[str, list[tuple[str, int]]] = {vertex.key: [] for vertex in sketch.vertices}
    for index, link in enumerate(sketch.links):
        ties[link.tail].append((link.head, index))
        ties[link.head].append((link.tail, index))
    seen: set[str] = set()
    for start in ties:
        if start not in seen:
            part = _reached(start, ties)
            seen.update(part)
            yield _Builder(sketch, {name: ties[name] for name in part}).spine()


Ties = Mapping[str, list[tuple[str, int]]]


def _reached(start: str, ties: Ties, without: str | None = None) -> dict[str, str]:
    """Return what a node reaches, nearest first, each with the node that it is reached from."""
    above = {start: start}
    queue = deque([start])
    while queue:
        name = queue.popleft()
        for other, _ in ties[name]:
            if other not in above and other != without:
                above[other] = name
                queue.append(other)
    return above


class _Builder:
    """Builds the spine of one connected part."""

    def __init__(self, sketch: Sketch, ties: dict[str, list[tuple[str, int]]]) -> None:
        self.sketch, self.ties = sketch, ties

    def spine(self) -> Spine:
        core = self._loops()
        if not core:
            path = self._path()
            columns = [Column([Item(name)]) for name in path]
            return self._finish(columns, dict(zip(path, range(len(path)), strict=True)), {}, 0)
        return self._layered(core)

    # --- trees ---------------------------------------------------------------------------------

    def _path(self) -> list[str]:
        """Return the spine of a tree."""
        cut, source = self.sketch.cut, self.sketch.source
        if cut is not None and cut[0] in self.ties:
            return [*self._farthest(cut[0], cut[1])[::-1], *self._farthest(cut[1], cut[0])]
        one = self._farthest(next(iter(self.ties)))[-1]
        longest = self._farthest(one)
        if source in self.ties:
            path = self._farthest(str(source))
            return path if len(path) * 2 > len(longest) else longest
        return longest

    def _farthest(self, start: str, without: str | None = None) -> list[str]:
        """Return the path to the farthest node; the source and the target count as a little farther."""
        above = _reached(start, self.ties, without)
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

    # --- loops ---------------------------------------------------------------------------------

    def _loops(self) -> list[str]:
        """Return the nodes that loops hold together: what is left without leaves."""
        degree = {name: len(near) for name, near in self.ties.items()}
        leaves = [name for name, count in degree.items() if count < 2]
        for name in leaves:
            degree[name] = 0
            for other, _ in self.ties[name]:
                degree[other] -= 1
                if degree[other] == 1:
                    leaves.append(other)
        gone = set(leaves)
        return [name for name in self.ties if name not in gone]

    def _layered(self, core: list[str]) -> Spine:
        """Return columns for a graph with loops."""
        number = {name: place for place, name in enumerate(core)}
        graph: dict[int, set[int]] = {place: set() for place in range(len(core))}
        ways: dict[int, list[int]] = {}  # a bond's vertices; parallel ones get one of their own
        for name in core:
            for other, index in self.ties[name]:
                if other in number and index not in ways:
                    way = [number[self.sketch.links[index].tail], number[self.sketch.links[index].head]]
                    if way[1] in graph[way[0]]:
                        way.insert(1, len(graph))
                        graph[way[1]] = set()
                    for a, b in pairwise(way):
                        graph[a].add(b)
                        graph[b].add(a)
                    ways[index] = way
        for edge in biconnecting(graph):
            a, b = edge
            graph[a].add(b)
            graph[b].add(a)
        embedding = Embedding(graph)
        chains = dict(embedding.chains)
        left, right = self._ends(core, number, embedding)
        layers = layers_of(embedding, number[left[-1]], number[right[0]])
        whole = {index: _along(way, chains) for index, way in ways.items()}
        return self._columns(
            core, left[:-1], right[1:], layers.rank, layers.height, whole, embedding.crossings
        )

    def _ends(
        self, core: list[str], number: dict[str, int], embedding: Embedding
    ) -> tuple[list[str], list[str]]:
        """Return the ways from the source into the loops, and out of them to the target."""
        inside = set(core)

        def way(end: str | None) -> list[str]:
            if end not in self.ties:
                return []
            above = _reached(core[0], self.ties)
            path = [str(end)]
            while path[-1] not in inside:
                path.append(above[path[-1]])
            return path

        left, right = way(self.sketch.source), way(self.sketch.target)[::-1]
        left = left or [core[0] if not right or core[0] != right[0] else core[1]]
        start = number[left[-1]]
        facing = {vertex for face in embedding.faces if start in face for vertex in face} - {start}
        if right and number[right[0]] in facing:
            return left, right
        distance = {left[-1]: 0}
        for name, before in _reached(left[-1], self.ties).items():
            distance[name] = distance[before] + (name != left[-1])
        named = [name for name in core if number[name] in facing]
        return left, [max(named, key=distance.__getitem__)]

    def _columns(
        self,
        core: list[str],
        left: list[str],
        right: list[str],
        rank: dict[int, int],
        height: dict[int | Edge, float],
        ways: dict[int, list[int]],
        crossings: list[int],
    ) -> Spine:
        """Fill the columns and lead the bonds through them."""
        first = len(left)
        count = first + max(rank.values()) + 1
        stacks: list[list[tuple[float, Item]]] = [[] for _ in range(count + len(right))]
        for column, name in [*enumerate(left), *enumerate(right, count)]:
            stacks[column].append((0.0, Item(name)))
        at: dict[int, Item] = {}
        used = {vertex for way in ways.values() for vertex in way}
        for vertex in sorted(used | set(range(len(core)))):
            room = (1.5 * PORT, 1.5 * PORT, PORT) if vertex in crossings else (PORT / 2, PORT / 2, 0.0)
            at[vertex] = Item(core[vertex] if vertex < len(core) else None, *room)
            stacks[first + rank[vertex]].append((height[vertex], at[vertex]))
        routes: dict[int, list[Stop]] = {}
        for index, way in ways.items():
            routes[index] = [Stop(at[way[0]], first + rank[way[0]])]
            for a, b in pairwise(way):
                for column in _between(rank[a], rank[b]):
                    lane = Item()
                    stacks[first + column].append((height[frozenset((a, b))], lane))
                    routes[index].append(Stop(lane, first + column))
                routes[index].append(Stop(at[b], first + rank[b]))
        columns = [Column([i for _, i in sorted(stack, key=lambda entry: entry[0])]) for stack in stacks]
        standing = {item.name: c for c, column in enumerate(columns) for item in column.items if item.name}
        return self._finish(columns, standing, routes, len(crossings))

    # --- both ----------------------------------------------------------------------------------

    def _finish(
        self,
        columns: list[Column],
        place: dict[str, int],
        routes: dict[int, list[Stop]],
        crossings: int,
    ) -> Spine:
        """Lead the bonds of the two ends, give every bond its place at its nodes, and hang up the rest."""
        item = {i.name: i for column in columns for i in column.items if i.name is not None}
        for name in place:
            for _, index in self.ties[name]:
                link = self.sketch.links[index]
                if index not in routes and link.tail in place and link.head in place:
                    routes[index] = [Stop(item[end], place[end]) for end in (link.tail, link.head)]
        _set_ports(columns, routes)
        ports = {name: [0, 0] for name in place}
        for route in routes.values():
            for end, near in ((route[0], route[1]), (route[-1], route[-2])):
                ports[str(end.item.name)][near.column > end.column] += 1
        children: dict[str, list[str]] = {name: [] for name in self.ties}
        hanging: dict[str, int] = {}
        queue = list(place)
        for name in queue:
            for other, index in self.ties[name]:
                if other not in place and other not in hanging and index != hanging.get(name):
                    children[name].append(other)
                    hanging[other] = index
                    queue.append(other)
        return Spine(
            columns, routes, {name: (w, e) for name, (w, e) in ports.items()}, children, hanging, crossings
        )


def _along(way: list[int], chains: dict[Edge, list[int]]) -> list[int]:
    """Return a bond's way with the crossings on it."""
    whole = [way[0]]
    for a, b in pairwise(way):
        chain = chains[frozenset((a, b))]
        whole += (chain if chain[0] == a else chain[::-1])[1:]
    return whole


def _between(start: int, end: int) -> range:
    """Return the columns between two, in the order in which they are met."""
    step = 1 if end > start else -1
    return range(start + step, end, step)


def _set_ports(columns: list[Column], routes: dict[int, list[Stop]]) -> None:
    """Spread the bonds on either side of an item in the order of what they lead to."""
    order = {item: place for column in columns for place, item in enumerate(column.items)}
    sides: dict[tuple[Item, bool], list[tuple[int, int, Stop, bool]]] = {}
    for index, route in routes.items():
        for a, b in pairwise(route):
            for here, there, leaving in ((a, b, True), (b, a, False)):
                side = sides.setdefault((here.item, there.column > here.column), [])
                side.append((order[there.item], index, here, leaving))
    # what leads to the same item keeps its order there: nodes are tied by one bond, crossings by one way
    for entries in sides.values():
        entries.sort(key=lambda entry: entry[:2])
        for number, (_, _, stop, leaving) in enumerate(entries):
            offset = PORT * (number - (len(entries) - 1) / 2)
            if leaving:
                stop.leave = offset
            else:
                stop.enter = offset
    for route in routes.values():
        route[0].enter, route[-1].leave = route[0].leave, route[-1].enter
