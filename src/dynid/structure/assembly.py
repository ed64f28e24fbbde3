"""Assembling structures of nodes and elements: supports, masses and springs at nodes, element blocks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.defaults import DENSE_STRUCTURES
from dynid.errors import UsageError
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.matrices import Array, Label, Matrix, combined
from dynid.structure.model import StructuralModel


@dataclass(frozen=True)
class Support:
    """Directions in which a node cannot move."""

    node: int
    fix: tuple[str, ...]


@dataclass(frozen=True)
class PointMass:
    """A mass at a node, kg, with rotary inertia J, kg·m2."""

    node: int
    m: float = 0.0
    J: float = 0.0


@dataclass(frozen=True)
class Spring:
    """A spring and damper from a node to ground, along one of its directions."""

    node: int
    direction: str
    k: float = 0.0
    c: float = 0.0


def node_label(direction: str, node: int) -> str:
    """Return the label of a node's DOF, such as ``w_4``."""
    return f"{direction}_{node}"


def free_labels(nodes: int, directions: Sequence[str], fixed: Iterable[tuple[str, int]]) -> list[str]:
    """Return the labels of the free DOFs, node by node."""
    held = set(fixed)
    return [
        node_label(direction, node)
        for node in range(1, nodes + 1)
        for direction in directions
        if (direction, node) not in held
    ]


class Assembly:
    """Sums of blocks over labelled DOFs; DOFs that are not among the labels are held and left out."""

    def __init__(self, dofs: Sequence[Label]) -> None:
        if not dofs:
            raise UsageError("the supports leave nothing to move")
        self.dofs = tuple(dofs)
        self._places = {label: place for place, label in enumerate(self.dofs)}
        self._blocks: dict[str, list[tuple[Array, Array]]] = {"M": [], "C": [], "K": []}

    def add(self, letter: str, dofs: Sequence[Label], block: Array) -> None:
        """Add a block (d x d) over d DOFs to ``M``, ``C`` or ``K``."""
        places = np.array([self._places.get(label, -1) for label in dofs])
        self._blocks[letter].append((places, block))

    def attach(
        self, masses: Iterable[PointMass], springs: Iterable[Spring], translations: Sequence[str]
    ) -> None:
        """Add masses, which move along all `translations`, and springs to ground."""
        for mass in masses:
            parts = {**dict.fromkeys(translations, mass.m), "theta": mass.J}
            for direction, value in parts.items():
                self._point("M", direction, mass.node, value)
        for spring in springs:
            self._point("K", spring.direction, spring.node, spring.k)
            self._point("C", spring.direction, spring.node, spring.c)

    def _point(self, letter: str, direction: str, node: int, value: float) -> None:
        not_negative(f"the value at node {node}", value)
        if value:
            self.add(letter, [node_label(direction, node)], np.array([[value]]))

    def sum(self, letter: str) -> Matrix:
        """Return the sum of what was added: an array, or sparse where there are many DOFs."""
        n, blocks = len(self.dofs), self._blocks[letter]
        rows, columns, values = (np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0))
        if blocks:
            rows = np.concatenate([np.repeat(places, len(places)) for places, _ in blocks])
            columns = np.concatenate([np.tile(places, len(places)) for places, _ in blocks])
            values = np.concatenate([block.ravel() for _, block in blocks])
        free = (rows >= 0) & (columns >= 0)
        rows, columns, values = rows[free], columns[free], values[free]
        if n > DENSE_STRUCTURES.value:
            from scipy.sparse import coo_array  # heavy import, for large models only

            return coo_array((values, (rows, columns)), shape=(n, n)).tocsc()
        matrix = np.zeros((n, n))
        np.add.at(matrix, (rows, columns), values)
        return matrix

    def model(
        self, damping: ProportionalDamping | ModalDamping | None = None, joints: Iterable[Joint] = ()
    ) -> StructuralModel:
        """Return the structure, its damping that of `damping` and of what was added."""
        M, C, K = self.sum("M"), self.sum("C"), self.sum("K")
        if damping is not None:
            C = combined(1.0, C, 1.0, damping.matrix(M, K))
        return StructuralModel(M, C, K, tuple(joints), self.dofs)


def check_nodes(
    what: str, items: Iterable[Support | PointMass | Spring], nodes: int, directions: Sequence[str]
) -> None:
    """Refuse items at nodes or along directions that do not exist.

    Raises
    ------
    UsageError
        Naming the first.
    """
    for item in items:
        if not 1 <= item.node <= nodes:
            raise UsageError(f"there is no node {item.node} for a {what}", remedy=f"Nodes are 1 to {nodes}.")
        along = item.fix if isinstance(item, Support) else getattr(item, "direction", None)
        for direction in (along,) if isinstance(along, str) else along or ():
            if direction not in directions:
                raise UsageError(f"a node has no direction {direction!r}", remedy=f"It has {directions}.")


def per_element(what: str, given: float | Sequence[float], count: int, *, zero: bool = False) -> Array:
    """Return a property of each element (count), from one number for all or a list.

    Raises
    ------
    UsageError
        If the list has another length, or a value is not positive (or with `zero`, is negative).
    """
    values = np.asarray(given, dtype=float)
    if values.ndim and values.shape != (count,):
        raise UsageError(f"{what} has {values.size} entries for {count} elements")
    if not np.all(np.isfinite(values) & ((values >= 0) if zero else (values > 0))):
        raise UsageError(f"{what} must be {'finite and not negative' if zero else 'positive'}")
    return np.broadcast_to(values, count)


def not_negative(what: str, value: float) -> None:
    """Refuse a value that is negative or not finite.

    Raises
    ------
    UsageError
        Naming it.
    """
    if not (math.isfinite(value) and value >= 0):
        raise UsageError(f"{what} must be finite and not negative, not {value:g}")
