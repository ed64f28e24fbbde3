"""Planar embedding of a small graph, and the columns in which a drawing from left to right places it.

Embedding: paths are inserted into faces one after another (Demoucron, Malgrange & Pertuiset 1964), first
those that fit into the fewest faces. A path that fits into no face crosses as few edges as possible on its
way through the faces; each crossing is a vertex from then on.

Columns: the graph is taken for a network of resistances between its first and its last vertex. Potentials
direct every edge without cycles and give every other vertex a neighbour on either side; the currents define
the potentials of the dual network, by which the vertices and edges of one column are ordered so that no two
edges cross (squared rectangles: Brooks, Smith, Stone & Tutte 1940).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

Edge = frozenset[int]
_GOLDEN = 0.6180339887498949


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
    """Return edges that make a connected graph biconnected and keep a planar graph planar."""
    graph = {vertex: set(near) for vertex, near in neighbours.items()}
    added = []
    for vertex, near in graph.items():
        parts = [sorted(near.intersection(part)) for part in connected(graph, vertex)]
        for one, other in pairwise(parts):
            graph[one[-1]].add(other[0])
            graph[other[0]].add(one[-1])
            added.append(frozenset((one[-1], other[0])))
    return added


class PlanarEmbedding:
    """A graph in the plane.

    Parameters
    ----------
    neighbours
        A biconnected graph of at least three vertices, numbered from 0.

    Attributes
    ----------
    faces
        Cycles of vertices; every edge lies on two of them, once in each direction.
    chains
        The vertices along every edge: its ends, and the crossings between them.
    crossings
        The vertices that are crossings; they are numbered after the graph's own.
    """

    def __init__(self, neighbours: dict[int, set[int]]) -> None:
        self.graph = neighbours
        self.chains: dict[Edge, list[int]] = {}
        self.crossings: list[int] = []
        self._owner: dict[Edge, Edge] = {}  # the edge of each piece between crossings
        self._next = max(neighbours) + 1
        self._inside: set[int] = set()
        cycle = self._shortest_cycle()
        self.faces = [cycle, cycle[::-1]]
        self._record([*cycle, cycle[0]])
        while fragments := list(self._fragments()):
            faces = [set(face) for face in self.faces]
            fitting = [
                [place for place, face in enumerate(faces) if face.issuperset(attached)]
                for attached, _ in fragments
            ]
            first = min(range(len(fragments)), key=lambda k: (not fitting[k], len(fitting[k])))
            attached, own = fragments[first]
            if fitting[first]:
                path = self._path(attached[0], attached[1:], own)
                self.split(fitting[first][0], path[0], path[-1], path[1:-1])
                self._record(path)
            else:
                self._cross(attached, own)

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

    def _shortest_cycle(self) -> list[int]:
        """Return the shortest cycle through the first vertex."""
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
        """Yield the fragments that are not embedded yet: vertices of attachment, and own vertices."""
        for vertex in sorted(self._inside):
            for other in sorted(self.graph.get(vertex, ())):
                if other in self._inside and vertex < other and frozenset((vertex, other)) not in self.chains:
                    yield [vertex, other], set()
        outside = {v: near - self._inside for v, near in self.graph.items() if v not in self._inside}
        for component in connected(outside):
            near = set().union(*(self.graph[vertex] for vertex in component))
            yield sorted(near & self._inside), set(component)

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
        """Insert a path that crosses as few edges as possible."""
        pairs = [(a, b) for place, a in enumerate(attached) for b in attached[place + 1 :]]
        ways = {pair: self._way(*pair) for pair in pairs}
        start, end = min(pairs, key=lambda pair: len(ways[pair][1]))
        place: int | None
        place, crossed = ways[start, end]
        path = self._path(start, [end], own)
        chain = [start]
        for tail, head in crossed:
            crossing, self._next = self._next, self._next + 1
            self.crossings.append(crossing)
            self._inside.add(crossing)
            owner = self._owner.pop(frozenset((tail, head)))
            for end_of_edge in (tail, head):
                self._owner[frozenset((end_of_edge, crossing))] = owner
            for way in [self.chains[owner], *self.faces]:
                cyclic = way is not self.chains[owner]
                for a, b in ((tail, head), (head, tail)):
                    for index in range(len(way) - (not cyclic)):
                        if way[index] == a and way[(index + 1) % len(way)] == b:
                            way.insert(index + 1, crossing)
                            break
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
        """Return the face to cross next: it contains the vertex reached so far and the edge to cross."""
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
        """Return the face in which the shortest way begins, and the directed edges that it crosses."""
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


@dataclass(frozen=True)
class ColumnOrder:
    """Columns of a plane graph.

    Parameters
    ----------
    rank
        The column of every vertex, from 0.
    height
        The position of vertices and edges from top to bottom, among those of one column.
    """

    rank: dict[int, int]
    height: dict[int | Edge, float]


def columns_of(embedding: PlanarEmbedding, first: int, last: int) -> ColumnOrder:
    """Return columns for a plane graph between two vertices of one face.

    Parameters
    ----------
    embedding
        The graph; an outer face is added to it.
    first, last
        The vertices of the first and the last column.
    """
    outer = next(place for place, face in enumerate(embedding.faces) if first in face and last in face)
    outside = -1
    embedding.split(outer, first, last, [outside])
    darts = embedding.face_of_darts()
    edges = [dart for dart in darts if dart[0] < dart[1] and outside not in dart]
    weights = {edge: 1 + 0.4 * ((place * _GOLDEN) % 1) for place, edge in enumerate(edges)}
    # Kirchhoff's equations of the network, with the potentials of the two ends given.
    places = {vertex: place for place, vertex in enumerate(sorted({v for edge in weights for v in edge}))}
    matrix = np.zeros((len(places), len(places)))
    for (tail, head), weight in weights.items():
        a, b = places[tail], places[head]
        matrix[a, a] += weight
        matrix[b, b] += weight
        matrix[a, b] -= weight
        matrix[b, a] -= weight
    right = np.zeros(len(places))
    for vertex, value in ((first, 0.0), (last, 1.0)):
        matrix[places[vertex]] = 0
        matrix[places[vertex], places[vertex]], right[places[vertex]] = 1, value
    solved = np.linalg.solve(matrix, right)
    potential = {vertex: float(solved[place]) for vertex, place in places.items()}
    # The potential of every face: across an edge it changes by the current of that edge.
    below = [0.0] * len(embedding.faces)
    queue = [darts[first, outside]]
    reached = set(queue)
    for place in queue:
        face = embedding.faces[place]
        for tail, head in zip(face, face[1:] + face[:1], strict=True):
            edge, beyond = (min(tail, head), max(tail, head)), darts[head, tail]
            if edge in weights and beyond not in reached:
                below[beyond] = below[place] + weights[edge] * (potential[head] - potential[tail])
                reached.add(beyond)
                queue.append(beyond)
    height: dict[int | Edge, float] = {}
    around: dict[int, list[float]] = {}
    for (tail, head), place in darts.items():
        if outside not in (tail, head):
            height[frozenset((tail, head))] = (below[place] + below[darts[head, tail]]) / 2
        around.setdefault(tail, []).append(below[place])
    height |= {vertex: (min(near) + max(near)) / 2 for vertex, near in around.items() if vertex != outside}
    directed = [edge if potential[edge[0]] < potential[edge[1]] else edge[::-1] for edge in edges]
    return ColumnOrder(_ranks(potential, directed), height)


def _ranks(potential: dict[int, float], directed: list[tuple[int, int]]) -> dict[int, int]:
    """Return the first column that the edges allow for every vertex, moved towards its neighbours."""
    before: dict[int, list[int]] = {vertex: [] for vertex in potential}
    after: dict[int, list[int]] = {vertex: [] for vertex in potential}
    for tail, head in directed:
        before[head].append(tail)
        after[tail].append(head)
    order = sorted(potential, key=lambda vertex: (potential[vertex], vertex))
    rank: dict[int, int] = {}
    for vertex in order:
        rank[vertex] = max((rank[other] + 1 for other in before[vertex]), default=0)
    for _ in range(4):
        for vertex in (*order[-2:0:-1], *order[1:-1]):
            least = max(rank[other] for other in before[vertex]) + 1
            most = min(rank[other] for other in after[vertex]) - 1
            balance = len(after[vertex]) - len(before[vertex])
            rank[vertex] = most if balance > 0 else least if balance < 0 else (least + most) // 2
    return rank
