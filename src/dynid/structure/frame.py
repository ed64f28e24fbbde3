"""Euler–Bernoulli beams and plane frames of straight members, with consistent mass."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arrays import guarded
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
from dynid.structure.model import StructuralModel
from dynid.structure.space_frame import Element, SpaceMember, Vector, bending, divided

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
    eta: Real | Sequence[Real] = 0.0,
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
    eta
        Loss factor of the bending stiffness: one for all, or of each element.

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
    loss = per_element("eta", eta, elements, zero=True)
    held, points, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", points), ("spring", grounded)):
        check_nodes(what, items, elements + 1, BEAM_DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    assembly = Assembly(free_labels(elements + 1, BEAM_DIRECTIONS, fixed))
    element = cache(bending)  # many are alike
    for first, (L, ei, ra, lost) in enumerate(zip(lengths, stiffness, density, loss, strict=True), 1):
        ends = [node_label(direction, node) for node in (first, first + 1) for direction in BEAM_DIRECTIONS]
        k, m = element(ei, ra, L)
        assembly.add_stiffness(ends, k, lost)
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
    """A straight member between two nodes."""

    nodes: tuple[int, int]  # its nodes, from 1
    # Axial stiffness, N, bending stiffness, N·m2, and mass per length, kg/m (which may be 0).
    EA: Real
    EI: Real
    rhoA: Real
    # Elements along it; their inner nodes are numbered after the given ones, member by member.
    elements: int = 1
    hinges: tuple[int, ...] = ()  # the ends, 1 or 2, that carry no moment
    eta: Real = 0.0  # loss factor of its stiffness


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

    `nodes`: coordinates x, y of the nodes 1 … n, m; all else is as of `beam`, with joints between DOFs such
    as ``u_2``. Raises UsageError if a number, a node or a direction makes no sense, or a node belongs to no
    member.
    """
    points: list[Vector] = [(_real(x), _real(y), 0.0) for x, y in nodes]
    elements: list[Element] = []
    for member in members:
        _check(member, points[: len(nodes)])
        released = tuple(("rz",) if end in member.hinges else () for end in (1, 2))
        in_space = SpaceMember(
            member.nodes, member.EA, member.EI, member.EI, member.EI, member.rhoA, 0.0,
            releases=(released[0], released[1]), elements=member.elements, eta=member.eta,
        )  # fmt: skip
        elements += divided(in_space, points, ("x", "y", "rz"))
    held, lumps, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", lumps), ("spring", grounded)):
        check_nodes(what, items, len(points), FRAME_DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    fixed += [("theta", node) for node in _moment_free(elements, lumps, grounded, len(points))]
    assembly = Assembly(free_labels(len(points), FRAME_DIRECTIONS, fixed))
    for element in elements:
        ends = [node_label(direction, node) for node in element.nodes for direction in FRAME_DIRECTIONS]
        assembly.add_stiffness(ends, element.k, element.eta)
        assembly.add("M", ends, element.m)
    assembly.attach(lumps, grounded, ("u", "w"))
    places = np.array(points, dtype=float)
    lines = tuple(element.nodes for element in elements)
    numbered = Nodes(tuple(range(1, len(points) + 1)), places, lines=lines)
    return assembly.model(damping, joints, parameters, numbered)


def _check(member: Member, points: Sequence[Vector]) -> None:
    for node in member.nodes:
        if not 1 <= node <= len(points):
            raise UsageError(f"a member names node {node}", remedy=f"Nodes are 1 to {len(points)}.")
    (x1, y1, _), (x2, y2, _) = (points[node - 1] for node in member.nodes)
    if not math.hypot(float(x2 - x1), float(y2 - y1)) > 0:
        raise UsageError(f"the member between nodes {member.nodes[0]} and {member.nodes[1]} has no length")
    for name in ("EA", "EI", "rhoA"):
        not_negative(f"{name} of a member", getattr(member, name))
    if not (float(member.EA) > 0 and float(member.EI) > 0):
        raise UsageError("EA and EI of a member must be positive")
    if member.elements < 1 or not set(member.hinges) <= {1, 2}:
        raise UsageError("a member has at least one element, and hinges at its ends 1 and 2 only")


def _real(value: Real) -> Real:
    return value if isinstance(value, Dependent) else float(value)


def _moment_free(
    elements: Iterable[Element], masses: Iterable[PointMass], springs: Iterable[Spring], count: int
) -> list[int]:
    """Return the nodes whose rotation nothing carries, and refuse nodes that nothing reaches."""
    rotations = [
        (node, bool(element.k.reference[3 * end + 2, 3 * end + 2]))
        for element in elements
        for end, node in enumerate(element.nodes)
    ]
    reached = {node for node, _ in rotations}
    for node in range(1, count + 1):
        if node not in reached:
            raise UsageError(f"node {node} belongs to no member", remedy="Join it, or leave it out.")
    carried = {node for node, stiff in rotations if stiff} | {mass.node for mass in masses if mass.J}
    carried |= {spring.node for spring in springs if spring.direction == "theta"}
    return sorted(reached - carried)
