"""Columns of a layered drawing of a graph with loops, from left to right, and the order within them.

Ranks: the graph is taken for a network of resistances between its first and its last vertex, whose potentials
direct every edge without cycles and give every other vertex a neighbour on either side. Order: medians of
neighbours and swaps of adjacent items, which leave few crossings (E. R. Gansner et al., IEEE Trans. Software
Eng. 19 (1993) 214–230).
"""

from __future__ import annotations

import random
from collections.abc import Hashable, Iterable
from itertools import pairwise
from statistics import median
from typing import Generic, TypeVar

import numpy as np

T = TypeVar("T", bound=Hashable)
Graph = dict[int, set[int]]

#: Conductances differ by multiples of this modulo 1, so that no two neighbours have one potential.
_GOLDEN = 0.6180339887498949
#: Starts from a shuffled order while links cross, and sweeps of each: more removed no crossing of the
#: published graphs and of random ones of ten junctions with three loops.
_STARTS, _SWEEPS = 8, 12


def ranks(graph: Graph, first: int, last: int) -> dict[int, int]:
    """Return the column of every vertex between two of a connected graph, neighbours in different ones."""
    network = _biconnected(graph, (first, last))
    potential = _potentials(network, first, last)
    before = {v: [u for u in near if potential[u] < potential[v]] for v, near in graph.items()}
    after = {v: [u for u in near if potential[u] > potential[v]] for v, near in graph.items()}
    order = sorted(potential, key=lambda vertex: (potential[vertex], vertex))
    rank: dict[int, int] = {}
    for vertex in order:
        rank[vertex] = max((rank[neighbour] + 1 for neighbour in before[vertex]), default=0)
    rank[last] = max(rank[last], max((rank[vertex] for vertex in order[:-1]), default=0) + 1)
    for _ in range(4):  # towards the neighbours
        for vertex in (*order[-2:0:-1], *order[1:-1]):
            low = max((rank[neighbour] for neighbour in before[vertex]), default=rank[first]) + 1
            high = min((rank[neighbour] for neighbour in after[vertex]), default=rank[last]) - 1
            balance = len(after[vertex]) - len(before[vertex])
            rank[vertex] = high if balance > 0 else low if balance < 0 else (low + high) // 2
    return rank


def _biconnected(graph: Graph, ends: tuple[int, int]) -> Graph:
    """Return a graph with edges that make it biconnected, one of them between its ends."""
    network = {vertex: set(near) for vertex, near in graph.items()}

    def tie(a: int, b: int) -> None:
        network[a].add(b)
        network[b].add(a)

    tie(*ends)
    for vertex in graph:
        for first_part, second_part in pairwise(_parts_without(network, vertex)):
            tie(first_part, second_part)
    return network


def _parts_without(graph: Graph, vertex: int) -> list[int]:
    """Return a neighbour of a vertex in each part into which the graph falls without it."""
    seen, starts = {vertex}, []
    for start in sorted(graph[vertex]):
        if start not in seen:
            starts.append(start)
            stack = [start]
            seen.add(start)
            while stack:
                fresh = graph[stack.pop()] - seen
                seen |= fresh
                stack += fresh
    return starts


def _potentials(graph: Graph, first: int, last: int) -> dict[int, float]:
    """Return the potentials of a network between 0 at its first and 1 at its last vertex (Kirchhoff)."""
    index = {vertex: k for k, vertex in enumerate(graph)}
    edges = [(a, b) for a, near in graph.items() for b in near if a < b]
    matrix, right = np.zeros((len(graph), len(graph))), np.zeros(len(graph))
    for k, (tail, head) in enumerate(edges):
        a, b, conductance = index[tail], index[head], 1 + 0.4 * ((k * _GOLDEN) % 1)
        matrix[[a, b], [a, b]] += conductance
        matrix[[a, b], [b, a]] -= conductance
    for vertex, value in ((first, 0.0), (last, 1.0)):
        k = index[vertex]
        matrix[k], matrix[k, k], right[k] = 0.0, 1.0, value
    solution = np.linalg.solve(matrix, right)
    return {vertex: float(solution[k]) for vertex, k in index.items()}


class ColumnOrder(Generic[T]):
    """Order of the items within columns, in which few links between neighbouring columns cross.

    Links are pairs, the left item first; `improve` orders the columns in place.
    """

    def __init__(self, columns: list[list[T]], links: Iterable[tuple[T, T]]) -> None:
        self.columns = columns
        self._left: dict[T, list[T]] = {item: [] for items in columns for item in items}
        self._right: dict[T, list[T]] = {item: [] for item in self._left}
        for left_item, right_item in links:
            self._right[left_item].append(right_item)
            self._left[right_item].append(left_item)
        self._position = {item: k for items in columns for k, item in enumerate(items)}

    def improve(self) -> int:
        """Order the columns, and return the number of crossings."""
        best, fewest = [list(items) for items in self.columns], self._count_crossings()
        shuffle = random.Random(0)
        for start in range(_STARTS):
            for items in self.columns if start else ():
                shuffle.shuffle(items)
                self._number(items)
            for sweep in range(_SWEEPS):
                self._sweep(self._right if sweep % 2 else self._left)
                count = self._count_crossings()
                if count < fewest:
                    best, fewest = [list(items) for items in self.columns], count
            if not fewest:
                break
        for items, chosen in zip(self.columns, best, strict=True):
            items[:] = chosen
        return fewest

    def _count_crossings(self) -> int:
        """Return the number of pairs of links that cross."""
        total = 0
        for items in self.columns:
            ends = [self._places(self._right[item]) for item in items]
            for k, near in enumerate(ends):
                total += sum(a > b for below in ends[k + 1 :] for a in near for b in below)
        return total

    def _sweep(self, near: dict[T, list[T]]) -> None:
        """Move the items of every column to the medians of their neighbours on a side, then swap some."""
        for items in self.columns if near is self._left else self.columns[::-1]:
            places = {item: self._places(near[item]) or [self._position[item]] for item in items}
            items.sort(key=lambda item: median(places[item]))
            swapped = True
            while swapped:
                swapped = False
                for k in range(len(items) - 1):
                    above, below = items[k : k + 2]
                    if self._crossings_of(above, below) > self._crossings_of(below, above):
                        items[k : k + 2], swapped = (below, above), True
            self._number(items)

    def _crossings_of(self, above: T, below: T) -> int:
        """Return the number of crossings of the links of two items, one of which is above the other."""
        return sum(
            a > b
            for near in (self._left, self._right)
            for a in self._places(near[above])
            for b in self._places(near[below])
        )

    def _places(self, items: list[T]) -> list[int]:
        return sorted(self._position[item] for item in items)

    def _number(self, items: list[T]) -> None:
        self._position.update((item, k) for k, item in enumerate(items))
