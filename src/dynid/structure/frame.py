"""Euler–Bernoulli beams and plane frames of straight members: element matrices with consistent mass.

Source: J. S. Archer, "Consistent mass matrix for distributed mass systems", 1963.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real, hypot
from dynid.arrays import Array, guarded
from dynid.errors import UsageError
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
    per_element,
)
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.labels import Nodes
from dynid.structure.matrices import DependentMatrix, pattern_sum
from dynid.structure.model import StructuralModel


def bending(
    EI: Real, rhoA: Real, length: Real, released: Sequence[int] = ()
) -> tuple[DependentMatrix, DependentMatrix]:
    """Return stiffness and consistent mass (4 x 4) of a beam element, DOFs [w1, theta1, w2, theta2].

    Rotations are the slopes ``dw/dx``. Released DOFs carry no force: they are condensed statically (Guyan),
    which leaves zeros in their place.

    `EI`, `rhoA`, `length`: bending stiffness, N·m2, mass per length, kg/m, and length, m; `released`: the
    places, 0 … 3, of the released DOFs. Raises UsageError if a released DOF moves without any stiffness.
    """
    k, m = (
        pattern_sum((1.0, P0), (length, P1), (length**2, P2))
        for P0, P1, P2 in _patterns("bending", tuple(sorted(released)))
    )
    return k.times(EI / length**3), m.times(rhoA * length / 420)


def stretching(
    EA: Real, rhoA: Real, length: Real, released: Sequence[int] = ()
) -> tuple[DependentMatrix, DependentMatrix]:
    """Return stiffness and consistent mass (2 x 2) of a bar element, DOFs [u1, u2]; of a shaft alike.

    `EA`, `rhoA`, `length`: axial stiffness, N, mass per length, kg/m, and length, m; of a shaft GJ and polar
    inertia per length; `released`: the released DOFs as in `bending`, 0 or 1. Raises UsageError if both are
    released.
    """
    (k, *_), (m, *_) = _patterns("stretching", tuple(sorted(released)))
    return DependentMatrix(k).times(EA / length), DependentMatrix(m).times(rhoA * length / 6)


# The upper triangles, by rows, of L^3/EI times the stiffness and 420/(rhoA L) times the mass, to be
# multiplied by L once for each rotation among an entry's two DOFs; of a bar L/EA and 6/(rhoA L) times.
_TRIANGLES: dict[str, tuple[list[int], list[int]]] = {
    "bending": ([12, 6, -12, 6, 4, -6, 2, 12, -6, 4], [156, 22, 54, -13, 4, 13, -3, 156, -22, 4]),
    "stretching": ([1, -1, 1], [2, 1, 2]),
}


@cache
def _patterns(element: str, released: tuple[int, ...]) -> list[list[Array]]:
    """Return the parts of stiffness and mass of `_TRIANGLES`, each by the power of the length."""
    rotations = {"bending": [0, 1, 0, 1], "stretching": [0, 0]}[element]
    n, exact = len(rotations), []
    for triangle in _TRIANGLES[element]:
        full = np.full((n, n), Fraction(0))
        full[np.triu_indices(n)] = [Fraction(entry) for entry in triangle]
        exact.append(np.triu(full) + np.triu(full, 1).T)
    for dof in released:
        if not exact[0][dof, dof]:
            raise UsageError("releases leave a member loose", remedy="Release fewer directions at its ends.")
        follows = np.diag([Fraction(at != dof) for at in range(n)])
        follows[dof] -= exact[0][dof] / exact[0][dof, dof]
        follows[dof, dof] = Fraction(0)
        exact = [follows.T @ pattern @ follows for pattern in exact]
    powers = np.add.outer(rotations, rotations)
    return [
        [np.where(powers == power, pattern.astype(float), 0.0) for power in range(3)] for pattern in exact
    ]


BEAM_DIRECTIONS = ("w", "theta")
"""The DOFs of a node: deflection, m, and slope, rad."""


@guarded("the matrices of the beam", UsageError)
def beam(
    elements: int,
    length: Real | Sequence[Real],
    EI: Real | Sequence[Real],
    rhoA: Real | Sequence[Real],
    *,
    supports: Iterable[Support] = (),
    masses: Iterable[PointMass] = (),
    springs: Iterable[Spring] = (),
    damping: ProportionalDamping | ModalDamping | None = None,
    joints: Iterable[Joint] = (),
    parameters: Iterable[Parameter] = (),
) -> StructuralModel:
    """Return a beam along x with consistent mass; its free DOFs node by node, w before theta.

    Parameters
    ----------
    elements
        Number of elements; the nodes are 1 … elements + 1.
    length
        Length of the whole beam, m, or of each element (elements).
    EI, rhoA
        Bending stiffness, N·m2, and mass per length, kg/m (which may be 0): one for all, or of each element.
    supports, masses, springs
        Supports, masses and grounded springs at the nodes.
    damping
        Of the beam without springs' own damping, which is added.
    joints
        The joints, between DOFs such as ``w_4`` or ``theta_1``.
    parameters
        Unknown parameters, on which all numbers may depend.

    Raises
    ------
    UsageError
        If a number, a node or a direction makes no sense.
    """
    if elements < 1:
        raise UsageError("a beam has at least one element")
    element_length = length if isinstance(length, Sequence) else length / elements
    lengths = per_element("length", element_length, elements)
    stiffness = per_element("EI", EI, elements)
    density = per_element("rhoA", rhoA, elements, zero=True)
    held, points, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", points), ("spring", grounded)):
        check_nodes(what, items, elements + 1, BEAM_DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    assembly = Assembly(free_labels(elements + 1, BEAM_DIRECTIONS, fixed))
    element = cache(bending)  # many are alike
    for first, (L, ei, ra) in enumerate(zip(lengths, stiffness, density, strict=True), 1):
        ends = [node_label(direction, node) for node in (first, first + 1) for direction in BEAM_DIRECTIONS]
        k, m = element(ei, ra, L)
        assembly.add("K", ends, k)
        assembly.add("M", ends, m)
    assembly.attach(points, grounded, ("w",))
    along = np.concatenate([[0.0], np.cumsum([float(L) for L in lengths])])
    numbers = range(1, elements + 2)
    nodes = Nodes(tuple(numbers), np.outer(along, [1.0, 0, 0]), lines=tuple(pairwise(numbers)))
    return assembly.model(damping, joints, parameters, nodes)


FRAME_DIRECTIONS = ("u", "w", "theta")
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
        check_nodes(what, items, len(points), FRAME_DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    fixed += [("theta", node) for node in _moment_free(pieces, lumps, grounded, len(points))]
    assembly = Assembly(free_labels(len(points), FRAME_DIRECTIONS, fixed))
    for piece in pieces:
        dx, dy = piece.span
        length = hypot(dx, dy)
        along = stretching(piece.EA, piece.rhoA, length)
        across = bending(piece.EI, piece.rhoA, length, [2 * end - 1 for end in piece.hinges])
        T = pattern_sum((1.0, _TURNING), (dx / length, _COSINES), (dy / length, _SINES))
        k, m = (
            (element.congruent(_ALONG) + element_across.congruent(_ACROSS)).congruent(T)
            for element, element_across in zip(along, across, strict=True)
        )
        ends = [node_label(direction, node) for node in piece.nodes for direction in FRAME_DIRECTIONS]
        assembly.add("K", ends, k)
        assembly.add("M", ends, m)
    assembly.attach(lumps, grounded, ("u", "w"))
    places = np.array([(float(x), float(y), 0.0) for x, y in points])
    numbered = Nodes(tuple(range(1, len(points) + 1)), places, lines=tuple(piece.nodes for piece in pieces))
    return assembly.model(damping, joints, parameters, numbered)


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


def _carried_rotations(members: Iterable[Member | _Piece]) -> set[int]:
    """Return the nodes, of those that members name, whose rotation at least one of them carries."""
    return {
        node for member in members for end, node in enumerate(member.nodes, 1) if end not in member.hinges
    }


def _pieces(member: Member, member_number: int, points: list[tuple[Real, Real]]) -> list[_Piece]:
    """Return a member's elements, appending their inner nodes to `points`."""
    for node in member.nodes:
        if not 1 <= node <= member_number:
            raise UsageError(f"a member names node {node}", remedy=f"Nodes are 1 to {member_number}.")
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
    for fraction_number in range(1, count):
        points.append((x1 + (x2 - x1) * fraction_number / count, y1 + (y2 - y1) * fraction_number / count))
        chain.append(len(points))
    chain.append(member.nodes[1])
    step = ((x2 - x1) / count, (y2 - y1) / count)
    ends = {1: 0, 2: count - 1}
    return [
        _Piece(
            pair, member.EA, member.EI, member.rhoA, tuple(h for h in member.hinges if ends[h] == at),
            _span(points[pair[0] - 1], points[pair[1] - 1], step),
        )
        for at, pair in enumerate(pairwise(chain))
    ]  # fmt: skip


def _real(value: Real) -> Real:
    return value if isinstance(value, Dependent) else float(value)


def _span(
    first: tuple[Real, Real], last: tuple[Real, Real], fraction: tuple[Real, Real]
) -> tuple[Real, Real]:
    """Return the vector between an element's nodes; where it is dependent, the part of its member."""
    x, y = (fraction[at] if isinstance(fraction[at], Dependent) else last[at] - first[at] for at in range(2))
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
    carried = _carried_rotations(pieces) | {mass.node for mass in masses if mass.J}
    carried |= {spring.node for spring in springs if spring.direction == "theta"}
    return sorted(reached - carried)
