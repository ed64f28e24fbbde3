"""Plane frames of straight members."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dynid.errors import UsageError
from dynid.lti.floating import guarded
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
from dynid.structure.beam import bending, released, stretching
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.model import StructuralModel

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
    EA: float
    EI: float
    rhoA: float
    elements: int = 1
    hinges: tuple[int, ...] = ()


@guarded("the matrices of the frame", UsageError)
def frame(
    nodes: Sequence[tuple[float, float]],
    members: Sequence[Member],
    *,
    supports: Iterable[Support] = (),
    masses: Iterable[PointMass] = (),
    springs: Iterable[Spring] = (),
    damping: ProportionalDamping | ModalDamping | None = None,
    joints: Iterable[Joint] = (),
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

    Raises
    ------
    UsageError
        If a number, a node or a direction makes no sense, or a node belongs to no member.
    """
    points = [(float(x), float(y)) for x, y in nodes]
    pieces = [piece for member in members for piece in _pieces(member, len(nodes), points)]
    held, lumps, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", lumps), ("spring", grounded)):
        check_nodes(what, items, len(points), DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    fixed += [("theta", node) for node in _moment_free(pieces, lumps, grounded, len(points))]
    whole = Assembly(free_labels(len(points), DIRECTIONS, fixed))
    for piece in pieces:
        (x1, y1), (x2, y2) = (points[node - 1] for node in piece.nodes)
        length = math.hypot(x2 - x1, y2 - y1)
        c, s = (x2 - x1) / length, (y2 - y1) / length
        axial, across = [0, 3], [1, 2, 4, 5]
        k, m = np.zeros((6, 6)), np.zeros((6, 6))
        k[np.ix_(axial, axial)], m[np.ix_(axial, axial)] = stretching(piece.EA, piece.rhoA, length)
        bent = released(*bending(piece.EI, piece.rhoA, length), [(1, 3)[end - 1] for end in piece.hinges])
        k[np.ix_(across, across)], m[np.ix_(across, across)] = bent
        T = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))  # to global directions
        k, m = T.T @ k @ T, T.T @ m @ T
        ends = [node_label(direction, node) for node in piece.nodes for direction in DIRECTIONS]
        whole.add("K", ends, k)
        whole.add("M", ends, m)
    whole.attach(lumps, grounded, ("u", "w"))
    return whole.model(damping, joints)


def carried_rotations(members: Iterable[Member]) -> set[int]:
    """Return the nodes, of those that members name, whose rotation at least one of them carries."""
    return {
        node for member in members for end, node in enumerate(member.nodes, 1) if end not in member.hinges
    }


def _pieces(member: Member, given: int, points: list[tuple[float, float]]) -> list[Member]:
    """Return a member's elements as members, appending their inner nodes to `points`."""
    for node in member.nodes:
        if not 1 <= node <= given:
            raise UsageError(f"a member names node {node}", remedy=f"Nodes are 1 to {given}.")
    first, last = (np.array(points[node - 1]) for node in member.nodes)
    if not np.hypot(*(last - first)) > 0:
        raise UsageError(f"the member between nodes {member.nodes[0]} and {member.nodes[1]} has no length")
    for name in ("EA", "EI", "rhoA"):
        not_negative(f"{name} of a member", getattr(member, name))
    if not (member.EA > 0 and member.EI > 0):
        raise UsageError("EA and EI of a member must be positive")
    if member.elements < 1 or not set(member.hinges) <= {1, 2}:
        raise UsageError("a member has at least one element, and hinges at its ends 1 and 2 only")
    chain = [member.nodes[0]]
    for part in range(1, member.elements):
        x, y = first + (last - first) * part / member.elements
        points.append((float(x), float(y)))
        chain.append(len(points))
    chain.append(member.nodes[1])
    pairs = list(pairwise(chain))
    ends = {1: 0, 2: len(pairs) - 1}
    return [
        Member(pair, member.EA, member.EI, member.rhoA, 1, tuple(h for h in member.hinges if ends[h] == at))
        for at, pair in enumerate(pairs)
    ]


def _moment_free(
    pieces: Iterable[Member], masses: Iterable[PointMass], springs: Iterable[Spring], count: int
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
