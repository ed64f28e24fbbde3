"""Nodes of a file, and the DOFs of matrices without labels by them, checked with rigid-body motions.

A structure resists no rigid-body motion but at its supports: ``K r = 0`` at all other DOFs. That shows the
right order of the nodes from others. Where a file of nodes has modes, these are another way: the modes of
mass and stiffness are the same, node by node.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.number_format import counted
from dynid.structure.labels import DIRECTIONS, Label, Nodes, node_direction
from dynid.structure.matrices import Matrix, as_array, is_sparse, nothing


class DofOrder(NamedTuple):
    """An order of DOFs that a matrix may have."""

    name: str  # the order in the terms of the file, such as ``a-set``
    labels: tuple[Label, ...]  # labels of the DOFs
    stated: bool  # true where the file states it; an order that is not stated has to be confirmed


class ModeShapes(NamedTuple):
    """Modes in a file: displacements x, y, z of each node (N x 3 x m), and frequencies (m), rad/s."""

    shapes: Array
    frequencies: Array


@dataclass(frozen=True, eq=False)
class NodeFile:
    """Nodes of a file."""

    nodes: Nodes  # the nodes
    orders: tuple[DofOrder, ...]  # orders of DOFs that a matrix without labels may have, the likeliest first
    modes: ModeShapes | None = None  # modes, where the file has them


_SPATIAL = (DIRECTIONS[:3], DIRECTIONS)
_PLANE = (("x", "y", "rz"), DIRECTIONS[:2])


def _usual_orders(nodes: Nodes, size: int) -> Iterator[DofOrder]:
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


# The force of a rigid-body motion on a DOF, relative to the sum of its parts, that is rounding of a file.
_BALANCED = 1e-4
# The share of DOFs in balance that confirms an order, and the share below which it is contradicted.
_CONFIRMED, _CONTRADICTED = 0.5, 0.1
# Orders whose shares differ by less than this fit alike.
_ALIKE = 0.01
# The largest dense matrix whose rigid-body modes are counted.
_MOST_COUNTED = 3000
_RIGID_MODE = 1e-9


class Balance(NamedTuple):
    """Forces of the rigid-body motions of nodes on a structure."""

    share: float  # the share of DOFs on which they vanish
    median: float  # the median over the DOFs of the largest force, relative to the sum of its parts


def balance(K: Matrix, nodes: Nodes, labels: Sequence[Label]) -> Balance:
    """Return the balance of a stiffness (n x n) in the rigid-body motions of nodes, by its DOFs' labels."""
    centred = replace(nodes, xyz=nodes.xyz - nodes.xyz.mean(axis=0))
    R = centred.rigid(labels)
    size, force = np.asarray(abs(K) @ np.abs(R)), np.asarray(K @ R)
    with np.errstate(invalid="ignore", divide="ignore"):
        relative = np.where(size > 0, np.abs(force) / size, 0.0).max(axis=1)
    moved = relative[np.abs(R).any(axis=1) & (size > 0).any(axis=1)]
    if not len(moved):
        return Balance(1.0, 0.0)
    return Balance(float(np.mean(moved <= _BALANCED)), float(np.median(moved)))


def assigned(
    M: Matrix, K: Matrix, labels: Sequence[Label], file: NodeFile
) -> tuple[tuple[Label, ...], Nodes]:
    """Return labels of DOFs, and the nodes with what contradicts them.

    `M`, `K`: mass and stiffness (n x n); `labels`: labels of the DOFs where they are known (n); else they are
    found; `file`: the nodes, and the orders of DOFs that their file has. Raises UsageError if no order of
    DOFs fits the matrices, or several fit and none can be confirmed.
    """
    if labels:
        return tuple(labels), _checked(K, labels, file.nodes, stated=True)
    n = K.shape[0]
    stated = [order for order in file.orders if order.stated and len(order.labels) == n]
    if stated:
        return stated[0].labels, _checked(K, stated[0].labels, file.nodes, stated=True)
    others = [order for order in file.orders if not order.stated and len(order.labels) == n]
    others += _usual_orders(file.nodes, n)
    likeliest = _likeliest(K, others, file.nodes)
    confirmed = bool(likeliest) and likeliest[0][1].share >= _CONFIRMED
    if confirmed and len(likeliest) == 1:
        return likeliest[0][0].labels, file.nodes
    matched = _by_modes(M, K, file)
    if matched:
        return matched, file.nodes
    if not likeliest:
        sizes = ", ".join(f"{order.name} {len(order.labels)}" for order in file.orders)
        raise UsageError(
            f"the matrices have {n} DOFs, which is no order of DOFs of the {len(file.nodes.numbers)} nodes"
            f"{f' ({sizes})' if sizes else ''}",
            remedy="Give 'labels', or a table of nodes (.csv) with a column 'dofs'.",
            names=("nodes",),
        )
    if confirmed:
        raise UsageError(
            f"the order of the DOFs is unknown, and several fit the stiffness: "
            f"{'; '.join(order.name for order, _ in likeliest)}",
            remedy="Give 'labels', or a table of nodes (.csv) with a column 'dofs'.",
            names=("nodes",),
        )
    labels = likeliest[0][0].labels
    return labels, _checked(K, labels, file.nodes, stated=False)


def _likeliest(K: Matrix, orders: Sequence[DofOrder], nodes: Nodes) -> list[tuple[DofOrder, Balance]]:
    """Return the different orders in which most DOFs are in balance, the best one first."""
    different: dict[tuple[Label, ...], DofOrder] = {}
    for order in orders:
        different.setdefault(order.labels, order)
    balances = [(order, balance(K, nodes, order.labels)) for order in different.values()]
    best = max((judged.share for _, judged in balances), default=0.0)
    alike = [pair for pair in balances if pair[1].share > best - _ALIKE]
    return sorted(alike, key=lambda pair: -pair[1].share)


def _checked(K: Matrix, labels: Sequence[Label], nodes: Nodes, *, stated: bool) -> Nodes:
    """Return nodes with the sentence on what contradicts or does not confirm their order."""
    placed = (node_direction(label) for label in labels)
    missing = [node[0] for node in placed if node is not None and node[0] not in nodes.places]
    if missing:
        some = f"{counted(len(missing), 'DOF')} of {len(labels)}"
        doubt = f"{some} have nodes that are not there, first {missing[0]}"
        nodes = replace(nodes, doubts=(*nodes.doubts, doubt))
    judged = balance(K, nodes, labels)
    if judged.share >= _CONFIRMED:
        return nodes
    figure = (
        f"a rigid-body motion of the nodes strains {1 - judged.share:.0%} of the DOFs (median of the forces: "
        f"{judged.median:.2g} of the sum of their parts)"
    )
    if _must_balance(K, judged):
        if not stated:
            raise UsageError(
                f"the order of the DOFs is unknown, and none that is usual fits the stiffness: {figure}",
                remedy="Give 'labels', or a table of nodes (.csv) with a column 'dofs'.",
                names=("nodes",),
            )
        return replace(nodes, doubts=(*nodes.doubts, f"the nodes contradict the stiffness: {figure}"))
    if stated:  # a reduced structure on supports: rigid-body motions say nothing
        return nodes
    first = ", ".join(map(str, labels[:3]))
    guess = f"the order of the DOFs, {first}, …, is a guess that could not be confirmed: {figure}"
    return replace(nodes, doubts=(*nodes.doubts, guess))


def _must_balance(K: Matrix, judged: Balance) -> bool:
    """Return True if most DOFs must be in balance: of a free structure, or far from most others."""
    n = K.shape[0]
    filled = (K.nnz if is_sparse(K) else int(np.count_nonzero(K))) / n
    if filled < n / 4:
        return judged.share < _CONTRADICTED or _rigid_modes(K) > 0
    return _rigid_modes(K) > 0


def _rigid_modes(K: Matrix) -> int:
    """Return the number of eigenvalues of a stiffness that are 0, after scaling; 0 of a large one."""
    n = K.shape[0]
    if n > _MOST_COUNTED:
        return 0
    dense = as_array(K)
    diagonal = np.abs(np.diag(dense))
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    kept = diagonal > 0
    values = np.linalg.eigvalsh((scale[:, None] * dense * scale)[np.ix_(kept, kept)])
    return int(np.sum(np.abs(values) < _RIGID_MODE))


# Frequencies of a file of modes and those of the matrices are the same within this.
_FILE_FREQUENCY_RTOL = 1e-4
# A mode is apart from its neighbours by at least this, relative.
_MIN_MODE_SEPARATION = 1e-3
# Displacements in two shapes of one mode are the same within this, relative to the largest.
_SAME_MOTION = 1e-4
_MOST_MODES = 40


def _by_modes(M: Matrix, K: Matrix, file: NodeFile) -> tuple[Label, ...]:
    """Return labels of matrices whose rows are triples x, y, z of each node, by the modes in a file; or none.

    Each mode's sign is free: those of the first modes are tried until one assignment of the nodes is left.
    """
    from dynid.structure.modes.modes import modes  # heavy import, needed here only

    n = len(file.nodes.numbers)
    if file.modes is None or K.shape[0] != 3 * n:
        return ()
    count = min(_MOST_MODES, len(file.modes.frequencies), 3 * n - 2)
    result = modes(M, nothing(3 * n, sparse=is_sparse(K)), K, count)
    omega, shapes = result.omega, result.shapes
    file_omega = file.modes.frequencies[:count]
    if len(file_omega) < 2 or not np.allclose(
        omega, file_omega, rtol=_FILE_FREQUENCY_RTOL, atol=1e-4 * file_omega.max()
    ):
        return ()
    gaps = np.diff(file_omega) > _MIN_MODE_SEPARATION * file_omega.max()
    alone = np.r_[True, gaps] & np.r_[gaps, False] & (file_omega > 0.01 * file_omega.max())
    model_shapes = shapes.reshape(n, 3, -1)[:, :, alone]
    theirs = file.modes.shapes[:, :, :count][:, :, alone]
    for places in _matchings(model_shapes, theirs):
        labels = tuple(f"{file.nodes.numbers[index]}:{along}" for index in places for along in "xyz")
        if balance(K, file.nodes, labels).share >= _CONFIRMED:
            return labels
    return ()


def _matchings(in_model: Array, in_file: Array) -> Iterator[list[int]]:
    """Yield the places in `in_file` (N x 3 x m) of the nodes in `in_model`, the signs of modes left open."""
    from scipy.spatial import cKDTree

    n, _, m = in_model.shape
    in_model, in_file = (
        shapes / np.linalg.norm(shapes, axis=(0, 1)) * np.sqrt(n) for shapes in (in_model, in_file)
    )
    signs: list[tuple[float, ...]] = [()]
    for mode in range(m):
        longer = []
        for tried in signs:
            for sign in (1.0, -1.0):
                both = np.array([*tried, sign])
                tree = cKDTree(in_file[:, :, : mode + 1].reshape(n, -1))
                distances, nearest = tree.query((in_model[:, :, : mode + 1] * both).reshape(n, -1))
                if np.max(distances) <= _SAME_MOTION * np.sqrt(mode + 1):
                    longer.append((*tried, sign))
                    places: list[int] = np.asarray(nearest).tolist()
                    if mode == m - 1 and len({*places}) == n:
                        yield places
        signs = longer[:64]
