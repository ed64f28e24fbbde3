"""Straight members and frames in three dimensions: Euler–Bernoulli beams with torsion, consistent mass.

Sources: J. S. Archer, "Consistent mass matrix for distributed mass systems", 1963; J. S. Przemieniecki,
"Theory of Matrix Structural Analysis", 1968, sections 5.6 and 11.4, without shear and rotary inertia of
bending.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real, sqrt
from dynid.arrays import Array, guarded
from dynid.errors import UsageError
from dynid.parameters import Parameter
from dynid.structure.assembly import Assembly, Spring, Support, check_nodes, not_negative
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.joints import Joint
from dynid.structure.labels import DIRECTIONS, Nodes
from dynid.structure.matrices import DependentMatrix, as_array, entries, pattern_sum
from dynid.structure.model import StructuralModel

Vector: TypeAlias = tuple[Real, Real, Real]
# Of a node's rotational stiffness and inertia without releases: what is rounding beside it.
_RELEASED_STIFFNESS_TOL = 1e-12
# A member nearer to the z axis than this angle is vertical.
_VERTICAL = 1e-6


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


def _stretching(
    EA: Real, rhoA: Real, length: Real, released: Sequence[int] = ()
) -> tuple[DependentMatrix, DependentMatrix]:
    """Return stiffness and consistent mass (2 x 2) of a bar, DOFs [u1, u2]; of a shaft by GJ and rhoJ."""
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


@dataclass(frozen=True)
class SpaceMember:
    """A straight member between two nodes.

    Its axis x runs from end to end, y and z are the principal axes of its section.
    """

    nodes: tuple[int, int]  # its nodes, from 1
    # Axial stiffness, N, bending stiffness about y and about z, and torsional stiffness, N·m2.
    EA: Real
    EIy: Real
    EIz: Real
    GJ: Real
    rhoA: Real  # mass per length, kg/m, which may be 0
    # Polar mass moment of inertia per length, kg·m; default: that of a homogeneous section, ``rhoA (EIy +
    # EIz) / EA``.
    rhoJ: Real | None = None
    # A vector in the plane of x and y, on the side of y; default: z is as near as possible to the basic z,
    # and of a member along the basic z, y is the basic y.
    orientation: Vector | None = None
    # Rigid offsets from the two nodes to the ends, m, basic coordinates.
    offsets: tuple[Vector, Vector] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    # The directions along the member's axes in which each end carries no force or moment.
    releases: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    # Elements along it; their inner nodes are numbered after the given ones, member by member.
    elements: int = 1
    eta: Real = 0.0  # loss factor of its stiffness

    @property
    def polar_inertia(self) -> Real:
        """Its polar mass moment of inertia per length, kg·m."""
        return self.rhoA * (self.EIy + self.EIz) / self.EA if self.rhoJ is None else self.rhoJ


@dataclass(frozen=True)
class RigidMass:
    """A rigid body at a node: mass, kg, principal inertias, kg·m2, and the offset of its centre, m."""

    node: int
    m: Real = 0.0
    J: Vector = (0.0, 0.0, 0.0)
    offset: Vector = (0.0, 0.0, 0.0)


class Element(NamedTuple):
    """An element: nodes, stiffness and mass by their DOFs, those of its rotations without releases."""

    nodes: tuple[int, int]
    k: DependentMatrix
    m: DependentMatrix
    rotational: tuple[float, float]
    eta: Real = 0.0  # loss factor of its stiffness


# Nodes, stiffness and mass over their DOFs, loss factor.
_Block: TypeAlias = tuple[tuple[int, ...], DependentMatrix, DependentMatrix, Real]


@guarded("the matrices of the frame", UsageError)
def space_frame(
    nodes: Sequence[Vector],
    members: Sequence[SpaceMember],
    *,
    supports: Iterable[Support] = (),
    masses: Iterable[RigidMass] = (),
    springs: Iterable[Spring] = (),
    damping: ProportionalDamping | ModalDamping | None = None,
    joints: Iterable[Joint] = (),
    parameters: Iterable[Parameter] = (),
) -> StructuralModel:
    """Return a frame in three dimensions; its free DOFs node by node, ``1:x`` to ``1:rz`` first.

    Rotations that nothing carries, as all members are released there, are left out.

    `nodes`: coordinates x, y, z of the nodes 1 … n, m; `supports`, `masses`, `springs`: along basic
    directions; `damping`: of the members, masses and springs; the springs' own damping is added; `joints`:
    between DOFs such as ``1:rz``; `parameters`: unknown parameters, on which all numbers may depend. Raises
    UsageError if a number, a node or a direction makes no sense, a node belongs to no member, or rotates
    freely.
    """
    points: list[Vector] = list(nodes)
    pieces: list[Element] = []
    for number, member in enumerate(members):
        try:
            _check(member, len(nodes))
            pieces += divided(member, points)
        except UsageError as error:
            names = (f"members.{number}",)
            raise UsageError(
                f"member {number + 1}: {error.problem}", remedy=error.remedy, names=names
            ) from None
    held, bodies, grounded = list(supports), list(masses), list(springs)
    for what, items in (("support", held), ("mass", bodies), ("spring", grounded)):
        check_nodes(what, items, len(points), DIRECTIONS)
    fixed = {(item.node, direction) for item in held for direction in item.fix}
    blocks: list[_Block] = [(piece.nodes, piece.k, piece.m, piece.eta) for piece in pieces]
    blocks += [((body.node,), _nothing(6), _inertia(body), 0.0) for body in bodies]
    for item in grounded:
        if not isinstance(item.k, Dependent):
            not_negative(f"the stiffness at node {item.node}", item.k)
        at = DependentMatrix(np.diag([float(item.direction == axis_name) for axis_name in DIRECTIONS]))
        blocks.append(((item.node,), at.times(item.k), _nothing(6), item.eta))
    fixed |= _uncarried(pieces, blocks, fixed, len(points))
    labels = [
        f"{node}:{direction}"
        for node in range(1, len(points) + 1)
        for direction in DIRECTIONS
        if (node, direction) not in fixed
    ]
    assembly = Assembly(labels)
    for ends, k, m, eta in blocks:
        dofs = [f"{node}:{direction}" for node in ends for direction in DIRECTIONS]
        assembly.add_stiffness(dofs, k, eta)
        assembly.add("M", dofs, m)
    for item in grounded:
        assembly.add("C", [f"{item.node}:{item.direction}"], DependentMatrix(np.eye(1)).times(item.c))
    places = np.array([[float(value) for value in point] for point in points])
    numbered = Nodes(tuple(range(1, len(points) + 1)), places, lines=tuple(piece.nodes for piece in pieces))
    return assembly.model(damping, joints, parameters, numbered)


def _check(member: SpaceMember, node_count: int) -> None:
    for node in member.nodes:
        if not 1 <= node <= node_count:
            raise UsageError(f"there is no node {node}", remedy=f"Nodes are 1 to {node_count}.")
    for name in ("EA", "EIy", "EIz", "GJ"):
        if not 0 < float(getattr(member, name)) < math.inf:
            raise UsageError(f"{name} must be positive and finite")
    not_negative("rhoA", member.rhoA)
    not_negative("rhoJ", member.polar_inertia)
    if member.elements < 1 or not set(DIRECTIONS).issuperset(member.releases[0] + member.releases[1]):
        raise UsageError(f"it needs at least one element, and releases along {', '.join(DIRECTIONS)}")


def divided(
    member: SpaceMember, points: list[Vector], directions: Sequence[str] = DIRECTIONS
) -> Iterator[Element]:
    """Yield a member's elements by DOFs along `directions`, appending their inner nodes to `points`."""
    start, end = (_sum(points[n - 1], by) for n, by in zip(member.nodes, member.offsets, strict=True))
    axes, length = _axes(_sum(end, _over(start, -1.0)), member.orientation)
    count = member.elements
    chain = [member.nodes[0]]
    for fraction_number in range(1, count):
        x, y, z = (a + (b - a) * fraction_number / count for a, b in zip(start, end, strict=True))
        points.append((x, y, z))
        chain.append(len(points))
    chain.append(member.nodes[1])
    step = length / count
    rotational = (
        4 * float(member.EIy + member.EIz + member.GJ) / float(step),
        float(member.rhoA * step**3 + member.polar_inertia * step),
    )
    blocks: dict[tuple[bool, bool], tuple[DependentMatrix, DependentMatrix]] = {}
    for at, pair in enumerate(pairwise(chain)):
        ends = (at == 0, at == count - 1)
        if ends not in blocks:
            blocks[ends] = _element(member, step, axes, ends, directions)
        yield Element(pair, *blocks[ends], rotational, member.eta)


# The DOFs of an element that stretch, twist, and bend it in its x-y and x-z planes: selected from the twelve,
# slopes from rotations.
_GROUPS = {
    "along": (("x",), np.eye(12)[[0, 6]]),
    "twist": (("rx",), np.eye(12)[[3, 9]]),
    "in xy": (("y", "rz"), np.eye(12)[[1, 5, 7, 11]]),
    "in xz": (("z", "ry"), np.diag([1.0, -1, 1, -1]) @ np.eye(12)[[2, 4, 8, 10]]),
}


def _element(
    member: SpaceMember,
    length: Real,
    axes: DependentMatrix,
    ends: tuple[bool, bool],
    global_directions: Sequence[str],
) -> tuple[DependentMatrix, DependentMatrix]:
    """Return stiffness and mass of an element by its nodes' directions (2 d x 2 d).

    `axes`: the member's as rows (3 x 3); `ends`: whether its first and last ends are those of the member.
    """
    k, m = _nothing(12), _nothing(12)
    for name, (directions, selected) in _GROUPS.items():
        if not set(global_directions).issuperset(directions):
            continue  # of a plane frame
        released = [
            len(directions) * end + index
            for end in (0, 1)
            if ends[end]
            for index, direction in enumerate(directions)
            if direction in member.releases[end]
        ]
        if name == "along":
            parts = _stretching(member.EA, member.rhoA, length, released)
        elif name == "twist":
            parts = _stretching(member.GJ, member.polar_inertia, length, released)
        else:
            parts = bending(member.EIz if name == "in xy" else member.EIy, member.rhoA, length, released)
        T = DependentMatrix(selected)
        k, m = k + parts[0].congruent(T), m + parts[1].congruent(T)
    T = _blocks(axes, [(at, at) for at in range(4)], 12)
    kept = [k for k in range(12) if DIRECTIONS[k % 6] in global_directions]
    T = DependentMatrix(T.constant[:, kept], tuple((c, pattern[:, kept]) for c, pattern in T.terms))
    k, m = k.congruent(T), m.congruent(T)
    for end in (0, 1):
        if ends[end] and any(member.offsets[end]):
            T = _carried(member.offsets[end], 12, 2 * end)
            k, m = k.congruent(T), m.congruent(T)
    return k, m


def _blocks(block: DependentMatrix, places: Sequence[tuple[int, int]], n: int) -> DependentMatrix:
    """Return a block (3 x 3) at places of a matrix (n x n) of such blocks."""
    where: Any = np.zeros((n // 3, n // 3))
    where[tuple(zip(*places, strict=True))] = 1.0
    terms = tuple((c, np.kron(where, as_array(pattern))) for c, pattern in block.terms)
    return DependentMatrix(np.kron(where, as_array(block.constant)), terms)


def _carried(offset: Vector, n: int, at: int) -> DependentMatrix:
    """Return the motion (n x n) of a point that a rigid offset joins to the node of the DOFs from 3 `at`."""
    x, y, z = offset
    lever = entries([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]], symmetric=False)
    return DependentMatrix(np.eye(n)) + _blocks(lever, [(at, at + 1)], n)


def _inertia(body: RigidMass) -> DependentMatrix:
    """Return the mass (6 x 6) of a rigid body by its node's directions."""
    total = _nothing(6)
    for at, value in enumerate((body.m, body.m, body.m, *body.J)):
        not_negative(f"the mass or inertia at node {body.node}", value)
        total = total + DependentMatrix(np.diag(np.eye(6)[at])).times(value)
    return total.congruent(_carried(body.offset, 6, 0)) if any(body.offset) else total


def _axes(along: Vector, orientation: Vector | None) -> tuple[DependentMatrix, Real]:
    """Return the axes of a member as rows (3 x 3), and its length."""
    length = _length(along)
    if not 0 < float(length) < math.inf:
        raise UsageError("it has no length", remedy="Its ends, offsets included, must differ.")
    x = _over(along, length)
    if orientation is None and not isinstance(along[2], Dependent) and along[2] == 0:
        rows = [(x[0], x[1], 0.0), (-x[1], x[0], 0.0), (0.0, 0.0, 1.0)]
        return entries(rows, symmetric=False).merged(), length
    if orientation is None:
        vertical = math.hypot(float(x[0]), float(x[1])) < _VERTICAL
        orientation = (0.0, 1.0, 0.0) if vertical else _cross((0.0, 0.0, 1.0), x)
    z = _cross(x, orientation)
    size = _length(z)
    if not float(size) > _VERTICAL * float(_length(orientation)):
        raise UsageError("its orientation lies along it", remedy="Give a vector beside its axis.")
    z = _over(z, size)
    return entries([x, _cross(z, x), z], symmetric=False), length


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _length(a: Vector) -> Real:
    length: Real = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    return length


def _over(a: Vector, by: Real) -> Vector:
    return a[0] / by, a[1] / by, a[2] / by


def _nothing(n: int) -> DependentMatrix:
    return DependentMatrix(np.zeros((n, n)))


def _uncarried(
    pieces: Sequence[Element],
    blocks: Sequence[_Block],
    fixed: set[tuple[int, str]],
    count: int,
) -> set[tuple[int, str]]:
    """Return the rotations that nothing carries; refuse nodes that are loose, or rotate about other axes."""
    size = np.zeros((count, 2))
    for piece in pieces:
        for node in piece.nodes:
            size[node - 1] += piece.rotational
    loose = np.flatnonzero(size[:, 0] == 0)
    if len(loose):
        raise UsageError(
            f"node {loose[0] + 1} belongs to no member",
            remedy="Join it, or leave it out.",
            names=(f"nodes.{loose[0]}",),
        )
    carried = np.zeros((count, 3, 3))
    for ends, *matrices, _ in blocks:
        for end, node in enumerate(ends):
            rotations = slice(6 * end + 3, 6 * end + 6)
            for letter, matrix in enumerate(matrices):
                block = matrix.reference[rotations, rotations]
                carried[node - 1] += block / (size[node - 1, letter] or 1.0)
    free = np.array(
        [[(node, along) not in fixed for along in DIRECTIONS[3:]] for node in range(1, count + 1)]
    )
    there = np.einsum("nii->ni", carried) > _RELEASED_STIFFNESS_TOL
    for node, along in zip(*np.nonzero(~there | ~free), strict=True):
        carried[node, along], carried[node, :, along], carried[node, along, along] = 0.0, 0.0, 1.0
    values, vectors = np.linalg.eigh(carried)
    for alone in np.flatnonzero(values[:, 0] < _RELEASED_STIFFNESS_TOL):
        axis = vectors[alone, :, 0]
        axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
        shown = ", ".join(f"{component:.3g}" for component in axis)
        raise UsageError(
            f"node {alone + 1} rotates freely about ({shown}): the members are released there",
            remedy="Release fewer directions, or hold the node by a support or a spring.",
            names=(f"nodes.{alone}",),
        )
    return {(int(node) + 1, DIRECTIONS[3 + along]) for node, along in zip(*np.nonzero(~there), strict=True)}
