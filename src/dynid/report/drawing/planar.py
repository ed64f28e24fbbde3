"""A plane embedding of a small graph, with crossings only where it has none without.

Paths are put into faces one after another (Demoucron, Malgrange & Pertuiset 1964): first what fits into the
fewest faces, at last what fits into none, which then crosses as few bonds as it can on its way through the
faces. A crossing is a vertex of its own from then on.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from itertools import pairwise

Edge = frozenset[int]


def connected(neighbours: dict[int, set[int]], without: int | None = None) -> list[list[int]]:
    """Return the connected components of a graph, in the order of its vertices."""
    seen = set() if without is None else {without}
    found = []
    for start in neighbours:
        if start in seen:
            continue
        component = [start]
        seen.add(start)
        for vertex in component:
            fresh = sorted(neighbours[vertex] - seen)
            seen.update(fresh)
            component += fresh
        found.append(component)
    return found


def biconnecting(neighbours: dict[int, set[int]]) -> list[Edge]:
    """Return edges that leave no vertex whose loss would part the graph; planar graphs stay planar."""
    graph = {vertex: set(near) for vertex, near in neighbours.items()}
    added = []
    for vertex, near in graph.items():
        parts = [sorted(near.intersection(part)) for part in connected(graph, vertex)]
        for one, other in pairwise(parts):
            graph[one[-1]].add(other[0])
            graph[other[0]].add(one[-1])
            added.append(frozenset((one[-1], other[0])))
    return added


class Embedding:
    """A graph in the plane.

    Parameters
    ----------
    neighbours
        A biconnected graph of at least three vertices, numbered from 0.

    Attributes
    ----------
    faces
        Cycles of vertices; every edge lies on two of them, once in either direction.
    chains
        For every edge the vertices on its way: its ends, and crossings between them.
    crossings
        The vertices that are crossings; they are numbered after the graph's own.
    """

    def __init__(self, neighbours: dict[int, set[int]]) -> None:
        self.graph = neighbours
        self.chains: dict[Edge, list[int]] = {}
        self.crossings: list[int] = []
        self._owner: dict[Edge, Edge] = {}  # the edge that a piece between crossings belongs to
        self._next = max(neighbours) + 1
        self._inside: set[int] = set()
        cycle = self._cycle()
        self.faces = [cycle, cycle[::-1]]
        self._record([*cycle, cycle[0]])
        while fragments := list(self._fragments()):
            self._put(fragments)

    def face_of_darts(self) -> dict[tuple[int, int], int]:
        """Return the face on which every directed edge lies."""
        return {
            (tail, head): place
            for place, face in enumerate(self.faces)
            for tail, head in zip(face, face[1:] + face[:1], strict=True)
        }

    def split(self, place: int, start: int, end: int, inner: list[int]) -> None:
        """Cut a face in two along a path between two of its vertices."""
        face = self.faces[place]
        first = face.index(start)
        face = face[first:] + face[:first]
        last = face.index(end)
        self.faces[place] = [start, *inner, *face[last:]]
        self.faces.append([*face[: last + 1], *inner[::-1]])

    def _cycle(self) -> list[int]:
        """Return a cycle: the shortest through the first vertex."""
        start = min(self.graph)
        branch, above = {start: start}, {start: start}
        queue = deque([start])
        while queue:
            vertex = queue.popleft()
            for other in sorted(self.graph[vertex]):
                if other not in branch:
                    branch[other] = other if vertex == start else branch[vertex]
                    above[other] = vertex
                    queue.append(other)
                elif start not in (vertex, other) and branch[other] != branch[vertex]:
                    there, back = self._climb(vertex, above), self._climb(other, above)
                    return [*there[::-1], *back[:-1]]
        raise ValueError("the graph is not biconnected")

    @staticmethod
    def _climb(vertex: int, above: dict[int, int]) -> list[int]:
        way = [vertex]
        while above[way[-1]] != way[-1]:
            way.append(above[way[-1]])
        return way

    def _record(self, path: list[int]) -> None:
        for pair in pairwise(path):
            edge = frozenset(pair)
            self.chains[edge], self._owner[edge] = list(pair), edge
        self._inside.update(path)

    def _fragments(self) -> Iterator[tuple[list[int], set[int]]]:
        """Yield what is not in the plane yet: the vertices at which a fragment is attached, and its own."""
        for vertex in sorted(self._inside):
            for other in sorted(self.graph.get(vertex, ())):
                if other in self._inside and vertex < other and frozenset((vertex, other)) not in self.chains:
                    yield [vertex, other], set()
        outside = {v: near - self._inside for v, near in self.graph.items() if v not in self._inside}
        for component in connected(outside):
            near = set().union(*(self.graph[vertex] for vertex in component))
            yield sorted(near & self._inside), set(component)

    def _put(self, fragments: list[tuple[list[int], set[int]]]) -> None:
        """Put a path of the fragment that fits into the fewest faces, at last of one that fits into none."""
        faces = [set(face) for face in self.faces]
        fitting = [
            [place for place, face in enumerate(faces) if face.issuperset(attached)]
            for attached, _ in fragments
        ]
        order = sorted(range(len(fragments)), key=lambda index: (not fitting[index], len(fitting[index])))
        attached, own = fragments[order[0]]
        if fitting[order[0]]:
            path = self._path(attached[0], attached[1:], own)
            self.split(fitting[order[0]][0], path[0], path[-1], path[1:-1])
            self._record(path)
        else:
            self._cross(attached, own)

    def _path(self, start: int, ends: Iterable[int], own: set[int]) -> list[int]:
        """Return a shortest path through a fragment."""
        targets, above = set(ends), {start: start}
        queue = deque([start])
        while queue:
            vertex = queue.popleft()
            for other in sorted(self.graph[vertex]):
                if other in targets and (own or vertex == start) and (not own or vertex != start):
                    return [*self._climb(vertex, above)[::-1], other]
                if other in own and other not in above:
                    above[other] = vertex
                    queue.append(other)
        raise ValueError("the fragment is not connected")

    def _cross(self, attached: list[int], own: set[int]) -> None:
        """Put in a path that crosses as few edges as it can."""
        pairs = [(a, b) for place, a in enumerate(attached) for b in attached[place + 1 :]]
        ways = {pair: self._way(*pair) for pair in pairs}
        start, end = min(pairs, key=lambda pair: len(ways[pair][1]))
        place: int | None
        place, crossed = ways[start, end]
        path = self._path(start, [end], own)
        chain = [start]
        for tail, head in crossed:  # the face beyond lies at the same edge in the other direction
            crossing = self._subdivide(tail, head)
            self.split(self._face_with(chain[-1], (tail, crossing), place), chain[-1], crossing, [])
            chain.append(crossing)
            place = None
        self.split(self._face_with(chain[-1], (end, end), place), chain[-1], end, path[1:-1])
        self._record(path)
        first = frozenset(path[:2])
        self.chains[first] = [*chain, path[1]]
        for pair in zip(chain, [*chain[1:], path[1]], strict=True):
            self._owner[frozenset(pair)] = first

    def _face_with(self, start: int, dart: tuple[int, int], place: int | None) -> int:
        """Return the face to cross next: it has the vertex that was reached and the edge to be met."""
        if place is not None:
            return place
        for index in reversed(range(len(self.faces))):
            face = self.faces[index]
            if start in face and dart[0] in face and dart[1] in face:
                follows = dart[0] == dart[1] or face[(face.index(dart[0]) + 1) % len(face)] == dart[1]
                if follows:
                    return index
        raise ValueError("no such face")

    def _way(self, start: int, end: int) -> tuple[int, list[tuple[int, int]]]:
        """Return the face in which the shortest way begins, and the edges that it crosses."""
        darts = self.face_of_darts()
        came: dict[int, tuple[int, tuple[int, int]] | None] = {
            place: None for place, face in enumerate(self.faces) if start in face
        }
        queue = deque(came)
        while queue:
            place = queue.popleft()
            face = self.faces[place]
            if end in face:
                crossed = []
                step = came[place]
                while step is not None:
                    place, dart = step
                    crossed.append(dart)
                    step = came[place]
                return place, crossed[::-1]
            for tail, head in zip(face, face[1:] + face[:1], strict=True):
                beyond = darts[head, tail]
                if beyond not in came:
                    came[beyond] = (place, (tail, head))
                    queue.append(beyond)
        raise ValueError("the faces are not connected")

    def _subdivide(self, tail: int, head: int) -> int:
        """Put a crossing on an edge."""
        crossing = self._next
        self._next += 1
        self.crossings.append(crossing)
        self._inside.add(crossing)
        owner = self._owner.pop(frozenset((tail, head)))
        for end in (tail, head):
            self._owner[frozenset((end, crossing))] = owner
        for way in [self.chains[owner], *self.faces]:
            cyclic = way is not self.chains[owner]
            for a, b in ((tail, head), (head, tail)):
                for place in range(len(way) - (not cyclic)):
                    if way[place] == a and way[(place + 1) % len(way)] == b:
                        way.insert(place + 1, crossing)
                        break
        return crossing
