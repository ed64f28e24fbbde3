"""Nodes of a file, and the orders in which its DOFs may stand in a matrix."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dynid.structure.labels import DIRECTIONS
from dynid.structure.matrices import Array, Label
from dynid.structure.nodes import Nodes


class DofOrder(NamedTuple):
    """An order of DOFs that a matrix may have.

    Parameters
    ----------
    name
        The order in the terms of the file, such as ``a-set``.
    labels
        Labels of the DOFs.
    stated
        True where the file states it; an order that is not stated has to be confirmed.
    """

    name: str
    labels: tuple[Label, ...]
    stated: bool


class ModeShapes(NamedTuple):
    """Modes in a file: displacements x, y, z of each node (N x 3 x m), and frequencies (m), rad/s."""

    shapes: Array
    frequencies: Array


@dataclass(frozen=True, eq=False)
class NodeFile:
    """Nodes of a file.

    Parameters
    ----------
    nodes
        The nodes.
    orders
        Orders of DOFs that a matrix without labels may have, the likeliest first.
    modes
        Modes, where the file has them.
    """

    nodes: Nodes
    orders: tuple[DofOrder, ...]
    modes: ModeShapes | None = None


_SPATIAL = (DIRECTIONS[:3], DIRECTIONS)
_PLANE = (("x", "y", "rz"), DIRECTIONS[:2])


def usual_orders(nodes: Nodes, size: int) -> Iterator[DofOrder]:
    """Yield the usual orders of as many DOFs in all where each node has the same: none of them is stated."""
    numbers = nodes.numbers
    ascending = sorted(numbers, key=lambda node: (isinstance(node, str), node))
    listed = [("the nodes of the file", list(numbers)), ("the nodes in ascending order", ascending)]
    plane = bool(np.ptp(nodes.xyz[:, 2]) == 0)
    for directions in (*_SPATIAL, *(_PLANE if plane else ())):
        if len(numbers) * len(directions) != size:
            continue
        for name, order in listed[: 1 if ascending == list(numbers) else 2]:
            words = " ".join(directions)
            by_node = tuple(f"{node}:{along}" for node in order for along in directions)
            yield DofOrder(f"{name}, each with {words}", by_node, stated=False)
            by_direction = tuple(f"{node}:{along}" for along in directions for node in order)
            yield DofOrder(f"{name}, {words} one after the other", by_direction, stated=False)
