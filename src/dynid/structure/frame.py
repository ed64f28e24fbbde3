"""Plane frames of straight members."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real, hypot
from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.parameters import Parameter
from dynid.structure.assembly import (
    Assembly,
    PointMass,
    Spring,
    Support,
    check_nodes,
    free_labels,
    node_label,
    not_negative,
)
from dynid.structure.beam import bending, stretching
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.dependent_matrix import DependentMatrix, pattern_sum
from dynid.structure.joints import Joint
from dynid.structure.model import StructuralModel
from dynid.structure.nodes import Nodes

DIRECTIONS = ("u", "w", "theta")
"""The DOFs of a node: displacements along x and y, m, and rotation from x to y, rad."""


@dataclass(frozen=True)
class Member:
    """A straight member between two nodes.

    Parameters
    ----------
    nodes
        Its nodes, from 1.
    EA, EI, rhoA
        Axial stiffness, N, bending stiffness, N·m2, and mass per length, kg/m (which may be 0).
    elements
        Elements along it; their inner nodes are numbered after the given ones, member by member.
    hinges
        The ends, 1 or 2, that carry no moment.
    """

    nodes: tuple[int, int]
    EA: Real
    EI: Real
    rhoA: Real
    elements: int = 1
    hinges: tuple[int, ...] = ()


@guarded("the matrices of the frame", UsageError)
def frame(
    nodes: Sequence[tuple[Real, Real]],
    members: Sequence[Member],
    *,
    supports: Iterable[Support] = (),
    masses: Iterable[PointMass] = (),
    springs: Iterable[Spring] = (),
    damping: ProportionalDamping | ModalDamping | None = None,
    joints: Iterable[Joint] = (),
    parameters: Iterable[Parameter] = (),
) -> StructuralModel:
    """Return a plane frame with consistent mass; its free DOFs node by node: u, w, theta.

    Rotations that no member carries (all its ends there are hinged) are left out.

    Parameters
    ----------
    nodes
        Coordinates x, y of the nodes 1 … n, m.
    members
        The members.
    supports, masses, springs
        Supports, masses and grounded springs at the nodes.
    damping
        Of the members, masses and springs; the springs' own damping is added.
    joints
        The joints, between DOFs such as ``u_2`` or ``theta_1``.
    parameters
        Unknown parameters, on which all numbers may depend.

    Raises
    ------
    UsageError
        If a number, a node or a direction makes no sense, or a node belongs to no member.
    """
    points: list[tuple[Real, Real]] = [(_real(x), _real(y)) for x, y in nodes]
    pieces = [piece for member in members for piece in _pieces(member, len(nodes), points)]
    held, lumps, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", lumps), ("spring", grounded)):
        check_nodes(what, items, len(points), DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    fixed += [("theta", node) for node in _moment_free(pieces, lumps, grounded, len(points))]
    whole = Assembly(free_labels(len(points), DIRECTIONS, fixed))
    for piece in pieces:
        dx, dy = piece.span
        length = hypot(dx, dy)
        along = stretching(piece.EA, piece.rhoA, length)
        across = bending(piece.EI, piece.rhoA, length, [2 * end - 1 for end in piece.hinges])
        T = pattern_sum((1.0, _TURNING), (dx / length, _COSINES), (dy / length, _SINES))
        k, m = (
            (one.congruent(_ALONG) + other.congruent(_ACROSS)).congruent(T)
            for one, other in zip(along, across, strict=True)
        )
        ends = [node_label(direction, node) for node in piece.nodes for direction in DIRECTIONS]
        whole.add("K", ends, k)
        whole.add("M", ends, m)
    whole.attach(lumps, grounded, ("u", "w"))
    places = np.array([(float(x), float(y), 0.0) for x, y in points])
    numbered = Nodes(tuple(range(1, len(points) + 1)), places, lines=tuple(piece.nodes for piece in pieces))
    return whole.model(damping, joints, parameters, numbered)


# The DOFs of an element along and across it, out of [u1, w1, theta1, u2, w2, theta2]; and the parts of the
# rotation to global directions: constant, times the cosine, times the sine.
_ALONG, _ACROSS = (DependentMatrix(np.eye(6)[places]) for places in ([0, 3], [1, 2, 4, 5]))
_TURNING, _COSINES, _SINES = (
    np.kron(np.eye(2), np.array(part, dtype=float))
    for part in (
        [[0, 0, 0], [0, 0, 0], [0, 0, 1]],
        [[1, 0, 0], [0, 1, 0], [0, 0, 0]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 0]],
    )
)


class _Piece(NamedTuple):
    """An element of a member: its nodes, properties, hinged ends, and the vector from end to end, m."""

    nodes: tuple[int, int]
    EA: Real
    EI: Real
    rhoA: Real
    hinges: tuple[int, ...]
    span: tuple[Real, Real]


def carried_rotations(members: Iterable[Member | _Piece]) -> set[int]:
    """Return the nodes, of those that members name, whose rotation at least one of them carries."""
    return {
        node for member in members for end, node in enumerate(member.nodes, 1) if end not in member.hinges
    }


def _pieces(member: Member, given: int, points: list[tuple[Real, Real]]) -> list[_Piece]:
    """Return a member's elements, appending their inner nodes to `points`."""
    for node in member.nodes:
        if not 1 <= node <= given:
            raise UsageError(f"a member names node {node}", remedy=f"Nodes are 1 to {given}.")
    (x1, y1), (x2, y2) = (points[node - 1] for node in member.nodes)
    if not math.hypot(float(x2 - x1), float(y2 - y1)) > 0:
        raise UsageError(f"the member between nodes {member.nodes[0]} and {member.nodes[1]} has no length")
    for name in ("EA", "EI", "rhoA"):
        not_negative(f"{name} of a member", getattr(member, name))
    if not (float(member.EA) > 0 and float(member.EI) > 0):
        raise UsageError("EA and EI of a member must be positive")
    count = member.elements
    if count < 1 or not set(member.hinges) <= {1, 2}:
        raise UsageError("a member has at least one element, and hinges at its ends 1 and 2 only")
    chain = [member.nodes[0]]
    for part in range(1, count):
        points.append((x1 + (x2 - x1) * part / count, y1 + (y2 - y1) * part / count))
        chain.append(len(points))
    chain.append(member.nodes[1])
    whole = ((x2 - x1) / count, (y2 - y1) / count)
    ends = {1: 0, 2: count - 1}
    return [
        _Piece(
            pair, member.EA, member.EI, member.rhoA, tuple(h for h in member.hinges if ends[h] == at),
            _span(points[pair[0] - 1], points[pair[1] - 1], whole),
        )
        for at, pair in enumerate(pairwise(chain))
    ]  # fmt: skip


def _real(given: Real) -> Real:
    return given if isinstance(given, Dependent) else float(given)


def _span(first: tuple[Real, Real], last: tuple[Real, Real], part: tuple[Real, Real]) -> tuple[Real, Real]:
    """Return the vector between an element's nodes; where it is dependent, the part of its member."""
    x, y = (part[at] if isinstance(part[at], Dependent) else last[at] - first[at] for at in range(2))
    return x, y


def _moment_free(
    pieces: Iterable[_Piece], masses: Iterable[PointMass], springs: Iterable[Spring], count: int
) -> list[int]:
    """Return the nodes whose rotation nothing carries, and refuse nodes that nothing reaches."""
    pieces = list(pieces)
    reached = {node for piece in pieces for node in piece.nodes}
    for node in range(1, count + 1):
        if node not in reached:
            raise UsageError(f"node {node} belongs to no member", remedy="Join it, or leave it out.")
    carried = carried_rotations(pieces) | {mass.node for mass in masses if mass.J}
    carried |= {spring.node for spring in springs if spring.direction == "theta"}
    return sorted(reached - carried)
