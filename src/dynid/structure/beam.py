"""Euler–Bernoulli beams of elements in a row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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
    per_element,
)
from dynid.structure.damping import Modal, Proportional
from dynid.structure.elements import bending
from dynid.structure.joints import Joint
from dynid.structure.model import StructuralModel

DIRECTIONS = ("w", "theta")
"""The DOFs of a node: deflection, m, and slope, rad."""


@guarded("the matrices of the beam", UsageError)
def beam(
    elements: int,
    length: float | Sequence[float],
    EI: float | Sequence[float],
    rhoA: float | Sequence[float],
    *,
    supports: Iterable[Support] = (),
    masses: Iterable[PointMass] = (),
    springs: Iterable[Spring] = (),
    damping: Proportional | Modal | None = None,
    joints: Iterable[Joint] = (),
) -> StructuralModel:
    """Return a beam with consistent mass; its free DOFs node by node, w before theta.

    Parameters
    ----------
    elements
        Number of elements; the nodes are 1 … elements + 1.
    length
        Length of the whole beam, m, or of each element (elements).
    EI, rhoA
        Bending stiffness, N·m2, and mass per length, kg/m (which may be 0): one for all, or of each element.
    supports, masses, springs
        What holds and loads the nodes.
    damping
        Of the beam without springs' own damping, which is added.
    joints
        The joints, between DOFs such as ``w_4`` or ``theta_1``.

    Raises
    ------
    UsageError
        If a number, a node or a direction makes no sense.
    """
    if elements < 1:
        raise UsageError("a beam has at least one element")
    each = length if isinstance(length, Sequence) else length / elements
    lengths = per_element("length", each, elements)
    stiffness = per_element("EI", EI, elements)
    density = per_element("rhoA", rhoA, elements, zero=True)
    held, points, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", points), ("spring", grounded)):
        check_nodes(what, items, elements + 1, DIRECTIONS)
    fixed = [(direction, item.node) for item in held for direction in item.fix]
    whole = Assembly(free_labels(elements + 1, DIRECTIONS, fixed))
    for first, (L, ei, ra) in enumerate(zip(lengths, stiffness, density, strict=True), 1):
        ends = [node_label(direction, node) for node in (first, first + 1) for direction in DIRECTIONS]
        k, m = bending(ei, ra, L)
        whole.add("K", ends, k)
        whole.add("M", ends, m)
    whole.attach(points, grounded, ("w",))
    return whole.model(damping, joints)
