"""Columns of a drawing: where each vertex of a plane graph stands, and in which order from top to bottom.

The graph is taken for a network of resistances between its first and its last vertex. Potentials give every
edge a direction without cycles, and every vertex but these two a neighbour on either side; the currents give
every face a potential of the dual network. By these, what stands in one column has an order in which no two
edges cross (the squared rectangle of Brooks, Smith, Stone & Tutte 1940).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.report.drawing.planar import Edge, Embedding

_GOLDEN = 0.6180339887498949


@dataclass(frozen=True)
class Layers:
    """Columns of a plane graph.

    Parameters
    ----------
    rank
        The column of every vertex, from 0.
    height
        Where a vertex or edge lies from top to bottom, for those that share a column.
    """

    rank: dict[int, int]
    height: dict[int | Edge, float]


def layers_of(embedding: Embedding, first: int, last: int) -> Layers:
    """Return columns for a plane graph between two vertices on one face.

    Parameters
    ----------
    embedding
        The graph; it is given a face to its outside.
    first, last
        The vertices in the first and the last column.
    """
    outer = next(place for place, face in enumerate(embedding.faces) if first in face and last in face)
    outside = -1
    embedding.split(outer, first, last, [outside])
    darts = embedding.face_of_darts()
    edges = [dart for dart in darts if dart[0] < dart[1] and outside not in dart]
    weights = {edge: 1 + 0.4 * ((place * _GOLDEN) % 1) for place, edge in enumerate(edges)}
    potential = _potentials(weights, first, last)
    below = _dual(embedding, darts, weights, potential, (first, outside))
    height: dict[int | Edge, float] = {}
    around: dict[int, list[float]] = {}
    for (tail, head), place in darts.items():
        if outside not in (tail, head):
            height[frozenset((tail, head))] = (below[place] + below[darts[head, tail]]) / 2
        around.setdefault(tail, []).append(below[place])
    height |= {vertex: (min(near) + max(near)) / 2 for vertex, near in around.items() if vertex != outside}
    directed = [edge if potential[edge[0]] < potential[edge[1]] else edge[::-1] for edge in edges]
    return Layers(_ranks(potential, directed), height)


def _potentials(weights: dict[tuple[int, int], float], first: int, last: int) -> dict[int, float]:
    """Solve the network of resistances between the first and the last vertex."""
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
    return {vertex: float(solved[place]) for vertex, place in places.items()}


def _dual(
    embedding: Embedding,
    darts: dict[tuple[int, int], int],
    weights: dict[tuple[int, int], float],
    potential: dict[int, float],
    start: tuple[int, int],
) -> list[float]:
    """Return the potential of every face: from face to face it changes by the current between them."""
    below: list[float | None] = [None] * len(embedding.faces)
    below[darts[start]] = 0.0
    queue = [darts[start]]
    for place in queue:
        face, here = embedding.faces[place], below[place]
        assert here is not None
        for tail, head in zip(face, face[1:] + face[:1], strict=True):
            weight = weights.get((tail, head), weights.get((head, tail)))
            beyond = darts[head, tail]
            if weight is not None and below[beyond] is None:
                below[beyond] = here + weight * (potential[head] - potential[tail])
                queue.append(beyond)
    return [value if value is not None else 0.0 for value in below]


def _ranks(potential: dict[int, float], directed: list[tuple[int, int]]) -> dict[int, int]:
    """Give every vertex the first column that its edges allow, then draw it towards its neighbours."""
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
