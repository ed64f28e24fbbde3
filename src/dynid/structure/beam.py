"""Euler–Bernoulli beams: element matrices with consistent mass, and beams of elements in a row.

Source: J. S. Archer, "Consistent mass matrix for distributed mass systems", 1963.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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
    per_element,
)
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.matrices import Array
from dynid.structure.model import StructuralModel


def bending(EI: float, rhoA: float, length: float) -> tuple[Array, Array]:
    """Return stiffness and consistent mass (4 x 4) of a beam element, DOFs [w1, theta1, w2, theta2].

    Rotations are the slopes ``dw/dx``.
    """
    L = length
    k = np.array(
        [
            [12, 6 * L, -12, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ]
    )
    m = np.array(
        [
            [156, 22 * L, 54, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54, 13 * L, 156, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ]
    )
    return EI / L**3 * k, rhoA * L / 420 * m


def stretching(EA: float, rhoA: float, length: float) -> tuple[Array, Array]:
    """Return stiffness and consistent mass (2 x 2) of a bar element, DOFs [u1, u2]."""
    return EA / length * np.array([[1.0, -1], [-1, 1]]), rhoA * length / 6 * np.array([[2.0, 1], [1, 2]])


def released(k: Array, m: Array, ends: list[int]) -> tuple[Array, Array]:
    """Condense DOFs that carry no force out of an element (Guyan), leaving zeros in their place.

    Parameters
    ----------
    k, m
        Stiffness and mass (d x d).
    ends
        The released DOFs, from 0.
    """
    if not ends:
        return k, m
    kept = [place for place in range(len(k)) if place not in ends]
    T = np.zeros((len(k), len(k)))
    T[kept, kept] = 1.0
    T[np.ix_(ends, kept)] = -np.linalg.solve(k[np.ix_(ends, ends)], k[np.ix_(ends, kept)])
    return T.T @ k @ T, T.T @ m @ T


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
    damping: ProportionalDamping | ModalDamping | None = None,
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
        Supports, masses and grounded springs at the nodes.
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
