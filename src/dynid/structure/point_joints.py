"""Joints between points: up to six springs and dampers along and about the axes of a frame.

The relative motion is taken at one place, the middle between the points unless another is given, to which
both points move as rigid bodies (as CBUSH of Nastran): a rigid-body motion of all strains nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.structure.joints import Block, Joint, JointLaw, JointParameter
from dynid.structure.labels import DIRECTIONS, Label
from dynid.structure.named_dofs import Motion
from dynid.structure.points import PlacedPoint
from dynid.suggestions import did_you_mean

Component: TypeAlias = JointParameter | Real
Components: TypeAlias = Mapping[str, Component] | JointParameter | Block

# Two places nearer than this part of their structure's size are one.
_ONE_PLACE = 1e-6
# Motions whose weights differ by less than this part of the largest are the same.
_WEIGHT_DIFFERENCE_TOL = 1e-12


@dataclass(frozen=True)
class PointJoint:
    """A joint between two points, or from one to ground."""

    name: str  # its name; its parameters are called ``<name>.k.x`` … ``<name>.c.rz``
    points: tuple[str, ...]  # one point or two
    # Stiffness and damping by direction, ``x`` … ``rz`` of its frame; or a block: over the relative
    # displacements (3 x 3), the relative displacements and rotations (6 x 6), or those of both points (12 x
    # 12, of one point 6 x 6).
    k: Components | None = None
    c: Components | None = None
    # Mass, half of it at each point; or a block over the motions of its points (6 or 12).
    m: Component | Block | None = None
    # Rows: directions of its frame in basic coordinates (3 x 3), orthonormal and right-handed; default: the
    # basic ones.
    axes: Array | None = None
    # Where the relative motion is taken, m; default: in the middle.
    at: tuple[float, float, float] | None = None
    # Loss factor of the stiffness: one of all its directions, or by direction.
    eta: Component | Mapping[str, Component] | None = None
    laws: Mapping[str, tuple[JointLaw, ...]] = field(default_factory=dict)  # nonlinear laws by direction
    offset: JointParameter | None = None  # deflection at rest by a preload, of every direction with a law


def components(
    joint: PointJoint, points: Mapping[str, PlacedPoint], size: float
) -> tuple[Mapping[str, Motion], Sequence[Joint]]:
    """Return a joint between points as joints between motions, one a direction, and the motions they need.

    `points`: the points by name; `size`: size of the structure, m. Raises UsageError if a point does not
    exist or does not determine a motion, both move alike, or numbers make no sense.
    """
    ends = _Ends(joint, [_point(joint, name, points) for name in joint.points], size)
    joints: list[Joint] = []
    matrices = {letter: matrix for letter in "kc" if isinstance(matrix := getattr(joint, letter), Mapping)}
    directions = {along for matrix in matrices.values() for along in matrix} | {*joint.laws}
    if wrong := sorted(directions - {*DIRECTIONS}):
        raise _refused(joint, f"has no direction '{wrong[0]}'", f"Use {', '.join(DIRECTIONS)}.")
    losses = _loss_factors(joint, list(matrices.get("k", ())))
    for along in (direction for direction in DIRECTIONS if direction in directions):
        parameters: dict[str, Any] = {
            letter: matrix[along] for letter, matrix in matrices.items() if along in matrix
        }
        parameters |= {"eta": losses[along]} if along in losses else {}
        laws = joint.laws.get(along, ())
        offset = joint.offset if laws else None
        joints.append(
            Joint(joint.name, ends.labels([along]), component=along, laws=laws, offset=offset, **parameters)
        )
    for letter in "kcm":
        matrix = getattr(joint, letter)
        if matrix is None or letter in matrices:
            continue
        dofs, block = _over_points(joint, letter, matrix, ends)
        parameters = {letter: block}
        if letter == "k" and "" in losses:
            parameters["eta"] = losses[""]
        joints.append(Joint(joint.name, dofs, **parameters))
    return ends.motions, _merged(joints)


def _loss_factors(joint: PointJoint, directions: Sequence[str]) -> dict[str, Component]:
    """Return the loss factors by the directions of k, of a block under the empty name."""
    eta = joint.eta
    if eta is None:
        return {}
    if isinstance(eta, Mapping):
        if missing := [along for along in eta if along not in directions]:
            raise _refused(joint, f"has an eta along {missing[0]}, but no k", "Give eta where k is.")
        return dict(eta)
    if len(directions) > 1 and isinstance(eta, JointParameter) and eta.start is not None:
        raise _refused(
            joint,
            "has one unknown eta for k of several directions",
            "Write eta: {x: {start: …}, …}, or the name of one of the scene's parameters.",
        )
    return dict.fromkeys(directions or [""], eta)


class _Ends:
    """The motions of the points of a joint along its axes, by the names under which they are used."""

    def __init__(self, joint: PointJoint, points: Sequence[PlacedPoint], size: float) -> None:
        self.joint, self.points, self.motions = joint, points, dict[str, Motion]()
        axes = np.eye(3) if joint.axes is None else np.asarray(joint.axes, dtype=float)
        if axes.shape != (3, 3) or not np.allclose(axes @ axes.T, np.eye(3), atol=1e-6):
            raise _refused(joint, "has axes that are not orthonormal", "Give three orthogonal unit vectors.")
        if np.linalg.det(axes) < 0:
            raise _refused(joint, "has left-handed axes", "Reverse one: z is the cross product of x and y.")
        self.axes = axes
        middle = np.mean([point.xyz for point in points], axis=0)
        self.at = middle if joint.at is None else np.asarray(joint.at, dtype=float)
        self.least = _ONE_PLACE * size

    def labels(self, directions: Sequence[str], *, own_axes: bool = False) -> tuple[Label, ...]:
        """Return the labels of motions along these directions, of one point after the other.

        They are taken at the joint's place; with `own_axes` at the points' own.
        """
        moves = [[self._motion(point, along, own_axes) for along in directions] for point in self.points]
        for along, *ends in zip(directions, *moves, strict=True):
            if len(ends) == 2 and _alike(*ends):
                p, q = (point.name for point in self.points)
                said = f"does nothing: the points {p} and {q} move alike along {along}"
                raise _refused(self.joint, said, "Join points that can move apart.")
        return tuple(
            self._label(point, along, motion, own_axes)
            for point, motions in zip(self.points, moves, strict=True)
            for along, motion in zip(directions, motions, strict=True)
        )

    def _motion(self, point: PlacedPoint, along: str, own_axes: bool) -> Motion:
        number = DIRECTIONS.index(along)
        axis, unit = self.axes[number % 3], np.zeros(6)
        if number < 3:
            unit[:3] = axis
            arm = self.at - point.xyz
            turning = np.cross(arm, axis)  # (theta x arm) . a = theta . (arm x a)
            if not own_axes and np.linalg.norm(turning) > self.least:
                unit[3:] = turning
        else:
            unit[3:] = axis
        try:
            return point.along(unit)
        except UsageError as error:
            raise UsageError(
                f"joint {self.joint.name} along {along}: {error.problem}",
                remedy=error.remedy,
                names=(f"joints.{self.joint.name}", *error.names),
            ) from None

    def _label(self, point: PlacedPoint, along: str, motion: Motion, own_axes: bool) -> Label:
        """Return the name of a motion: of a single DOF its own, or one among `motions`."""
        if list(motion.values()) == [1.0]:
            return next(iter(motion))
        named = f"{point.name}:{along}"
        if motion == point.motions.get(named):
            return named
        named = f"{self.joint.name}.{point.name}{'.own' if own_axes else ''}:{along}"
        self.motions[named] = motion
        return named


def _alike(a: Motion, b: Motion) -> bool:
    """Return True if two motions are the same but for rounding."""
    tolerance = _WEIGHT_DIFFERENCE_TOL * max(map(abs, [*a.values(), *b.values()]), default=0.0)
    return all(abs(a.get(dof, 0.0) - b.get(dof, 0.0)) <= tolerance for dof in {*a, *b})


def _over_points(
    joint: PointJoint, letter: str, component: Component | Block, ends: _Ends
) -> tuple[tuple[Label, ...], JointParameter]:
    """Return the DOFs of a block over the motions of a joint's points, or of its mass, and the block."""
    parameter = component if isinstance(component, JointParameter) else None
    block = parameter.matrix if parameter is not None else component
    count = len(ends.points)
    if not isinstance(block, Sequence | np.ndarray):
        if letter != "m":
            raise _refused(
                joint, f"has a '{letter}' without directions", f"Write {letter}: {{x: …, rz: …}}, or a block."
            )
        ends = _Ends(PointJoint(joint.name, joint.points), ends.points, 0.0)  # it has no directions
        there = [all(k in point.determined for point in ends.points) for k in range(3)]
        dofs = ends.labels(
            [along for along, moves in zip(DIRECTIONS, there, strict=False) if moves], own_axes=True
        )
        value: Any = block if parameter is None else parameter.value
        return dofs, JointParameter(value, matrix=np.eye(len(dofs)) / count)
    size = len(block)
    both = size == 6 * count
    if letter == "m" and not both:
        raise _refused(
            joint, f"has an m of {size} x {size}", f"Over its points it is {6 * count} x {6 * count}."
        )
    if not both and size not in (3, 6):
        sizes = dict.fromkeys(f"{n} x {n}" for n in (3, 6, 6 * count))
        raise _refused(joint, f"has a {letter} of {size} x {size}", f"It is {' or '.join(sizes)}.")
    dofs = ends.labels(DIRECTIONS if both else DIRECTIONS[:size], own_axes=letter == "m")
    if not both and count == 2:
        signs = np.kron([1, -1], np.ones(size))
        block = [
            [sign * block[i % size][j % size] for j, sign in enumerate(row)]
            for i, row in enumerate(np.outer(signs, signs).tolist())
        ]
    if parameter is None:
        return dofs, JointParameter(matrix=block)
    values = (parameter.value, parameter.start, parameter.true)
    return dofs, JointParameter(*values, block, parameter.low, parameter.high, parameter.prior)


def _merged(joints: Sequence[Joint]) -> Sequence[Joint]:
    """Return joints of different names and components: blocks over the same DOFs are one joint."""
    by_key: dict[tuple[str, tuple[Label, ...]], Joint] = {}
    for joint in joints:
        key = (joint.component, joint.dofs)
        if key in by_key:
            previous = by_key[key]
            parts = {
                letter: getattr(previous, letter) or getattr(joint, letter)
                for letter in ("k", "c", "m", "eta")
            }
            by_key[key] = Joint(joint.name, joint.dofs, **parts, component=joint.component)
        else:
            by_key[key] = joint
    return tuple(by_key.values())


def _point(joint: PointJoint, name: str, points: Mapping[str, PlacedPoint]) -> PlacedPoint:
    if name not in points:
        hint = did_you_mean(name, points)
        raise _refused(joint, f"names a point '{name}' that does not exist{hint}", "Name one of 'points'.")
    return points[name]


def _refused(joint: PointJoint, said: str, remedy: str) -> UsageError:
    return UsageError(f"joint {joint.name} {said}", remedy=remedy, names=(f"joints.{joint.name}", joint.name))
