"""Columns of nodes and bonds in a drawing, and how high each of them is."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

from dynid.report.drawing.sketch import PORT

_SWEEPS, _STRAIGHT = 60, 4
_LANE_WEIGHT = 4.0  # long bonds are straight before nodes are in the middle of theirs


@dataclass(eq=False)
class Item:
    """What stands in a column: a node, a bond on its way, or (with neither) a crossing of two.

    Parameters
    ----------
    name
        The node; none for a bond or a crossing.
    up, down, across
        The room it needs above and below its height, and to either side (a node: as much as it turns out).
    y
        Its height, downwards.
    """

    name: str | None = None
    up: float = PORT / 2
    down: float = PORT / 2
    across: float = 0.0
    y: float = 0.0


@dataclass
class Column:
    """The items of a column, from top to bottom."""

    items: list[Item] = field(default_factory=list)


@dataclass
class Stop:
    """A place on the way of a bond: it comes and goes at heights relative to an item."""

    item: Item
    column: int
    enter: float = 0.0
    leave: float = 0.0

    @property
    def y_in(self) -> float:
        """The height at which the bond comes."""
        return self.item.y + self.enter

    @property
    def y_out(self) -> float:
        """The height at which it goes."""
        return self.item.y + self.leave


@dataclass
class Spine:
    """The spine of a connected part of a sketch, and what hangs on it.

    Parameters
    ----------
    columns
        Its columns from left to right.
    routes
        The stops of its bonds, by their place in the sketch, from tail to head.
    ports
        How many bonds each of its nodes has to the left and to the right.
    children, hanging
        The trees: what hangs on every node, and the bond by which a node hangs.
    crossings
        How many pairs of bonds cross.
    """

    columns: list[Column]
    routes: dict[int, list[Stop]]
    ports: dict[str, tuple[int, int]]
    children: dict[str, list[str]]
    hanging: dict[str, int]
    crossings: int = 0

    def settle(self) -> None:
        """Give every item its height: bonds as straight as the room that everything needs allows."""
        ties: dict[Item, list[tuple[Item, float, bool]]] = {
            item: [] for column in self.columns for item in column.items
        }
        for route in self.routes.values():
            for a, b in pairwise(route):
                ties[a.item].append((b.item, b.enter - a.leave, b.column < a.column))
                ties[b.item].append((a.item, a.leave - b.enter, a.column < b.column))
        for column in self.columns:
            _spread(column.items, [0.0] * len(column.items))
        for sweep in range(_SWEEPS + _STRAIGHT):
            forward = sweep % 2 or sweep >= _SWEEPS
            for column in self.columns if forward else self.columns[::-1]:
                _spread(column.items, [_wanted(item, ties[item], sweep >= _SWEEPS) for item in column.items])


def _wanted(item: Item, ties: list[tuple[Item, float, bool]], straight: bool) -> float:
    """Return the height at which an item's bonds rise least; of several, the middle or the straightest."""
    if not ties:
        return item.y
    heights = sorted(other.y + offset for other, offset, _ in ties)
    low, high = heights[(len(heights) - 1) // 2], heights[len(heights) // 2]
    before = sorted(other.y + offset for other, offset, is_before in ties if is_before)
    if not straight or not before:
        return (low + high) / 2
    return min(max(before[len(before) // 2], low), high)


def _spread(items: list[Item], wanted: list[float]) -> None:
    """Move items as near as possible (least squares) to where they are wanted, in order, apart."""
    pools: list[tuple[float, float, int]] = []  # mean, weight, members: equal heights, but for their room
    room, shift = [], 0.0
    for place, item in enumerate(items):
        shift += items[place - 1].down + item.up if place else 0.0
        room.append(shift)
        mean = wanted[place] - shift
        weight, members = (1.0 if item.name is not None else _LANE_WEIGHT), 1
        while pools and pools[-1][0] > mean:
            other, heavy, count = pools.pop()
            mean = (mean * weight + other * heavy) / (weight + heavy)
            weight, members = weight + heavy, members + count
        pools.append((mean, weight, members))
    heights = [mean for mean, _, members in pools for _ in range(members)]
    for item, height, offset in zip(items, heights, room, strict=True):
        item.y = height + offset
