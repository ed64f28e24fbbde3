"""The laws of a structure's joints at values of its parameters: unknowns, tangents at rest, forces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import evaluated
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.parameters import Parameter
from dynid.structure.joints import Joint, JointLaw, JointParameter, angular
from dynid.structure.labels import Label
from dynid.structure.law import BoundLaw, Law

# Relative step of central differences of tangents by parameters: the root of round-off.
_DIFFERENCE = 1e-6


def law_unknowns(joints: Sequence[Joint], kind: Callable[[Label], str]) -> tuple[Parameter, ...]:
    """Return the unknown parameters of the laws of joints; those that may be negative are linear.

    `kind`: returns what a DOF is, such as a rotation.
    """
    unknowns = []
    for joint in joints:
        kinds = {kind(dof) for dof in joint.dofs}
        for item, named in zip((*joint.laws, None), joint.law_parameters, strict=True):
            units = ("m",) if item is None else item.law.units
            for place, (name, parameter) in enumerate(named):
                if parameter.start is None:
                    continue
                unit = "" if "unknown" in kinds or place >= len(units) else units[place]
                unit = angular(unit) if kinds == {"rotation"} else unit
                scale: Literal["log", "linear"] = "linear" if parameter.signed else "log"
                low = parameter.low
                if low is None and item is not None:
                    low = item.law.lowest.get(item.law.names[place])
                numbers = parameter.start, parameter.true, low, parameter.high, parameter.prior
                unknowns.append(Parameter(name, *numbers, scale=scale, unit=unit, spread=parameter.spread))
    return tuple(unknowns)


def with_spreads(joints: Sequence[Joint], spreads: Mapping[str, float]) -> Iterator[Joint]:
    """Yield joints whose parameters of laws may be off by so much, by name."""

    def spread(name: str, parameter: JointParameter) -> JointParameter:
        return replace(parameter, spread=spreads[name]) if name in spreads else parameter

    for joint in joints:
        *named, offset = joint.law_parameters
        laws = tuple(
            JointLaw(item.law, tuple(spread(*pair) for pair in pairs))
            for item, pairs in zip(joint.laws, named, strict=True)
        )
        yield replace(joint, laws=laws, offset=next((spread(*pair) for pair in offset), None))


class ModelLaw(NamedTuple):
    """A law of a joint at values of the parameters, and derivatives of its own ones by name."""

    joint: Joint
    bound: BoundLaw
    slopes: tuple[Mapping[str, float], ...]  # of its parameters, and of the offset


def model_laws(joints: Sequence[Joint], values: Mapping[str, float]) -> tuple[ModelLaw, ...]:
    """Return the laws of all joints at values of the parameters, by name; rows in the order of the joints.

    Raises UsageError if an unknown parameter has no value, or values make no sense.
    """
    laws, row = [], 0
    for joint in joints:
        if not joint.laws:
            continue
        *named, offset = joint.law_parameters
        shift = [_value(name, parameter, values) for name, parameter in offset] or [(0.0, {})]
        for item, parameters in zip(joint.laws, named, strict=True):
            pairs = [_value(name, parameter, values) for name, parameter in parameters]
            numbers = tuple(value for value, _ in pairs)
            bound = BoundLaw(item.law, numbers, row, shift[0][0])
            laws.append(ModelLaw(joint, bound, tuple(slopes for _, slopes in (*pairs, *shift))))
        row += 1
    return tuple(laws)


def _value(
    name: str, parameter: JointParameter, values: Mapping[str, float]
) -> tuple[float, Mapping[str, float]]:
    if parameter.value is not None:
        return evaluated(parameter.value, values)
    if name not in values:
        raise UsageError(f"the joint parameter {name} has no value", names=(name,))
    return values[name], {name: 1.0}


def tangents(
    joints: Sequence[Joint], values: Mapping[str, float]
) -> Iterator[tuple[Joint, Mapping[str, Array]]]:
    """Yield the stiffness and damping of each law at rest, as blocks over the joint's DOFs."""
    for law in model_laws(joints, values):
        k, c = law.bound.at_rest
        yield (
            law.joint,
            {letter: value * _block(law.joint) for letter, value in (("k", k), ("c", c)) if value},
        )


def tangent_slopes(
    joints: Sequence[Joint], values: Mapping[str, float]
) -> Iterator[tuple[str, Joint, str, Array]]:
    """Yield the derivatives of these blocks: name of the parameter, joint, letter and block."""
    for law in model_laws(joints, values):
        for place, slopes in enumerate(law.slopes):
            if not slopes:
                continue
            changed = [_at_rest(law.bound, place, sign) for sign in (1, -1)]
            step = changed[0][1] - changed[1][1]
            for letter, high, low in zip("kc", changed[0][0], changed[1][0], strict=True):
                if high != low:
                    for name, slope in slopes.items():
                        yield name, law.joint, letter, slope * (high - low) / step * _block(law.joint)


def _at_rest(bound: BoundLaw, place: int, sign: int) -> tuple[tuple[float, float], float]:
    numbers = [*bound.values, bound.offset]
    numbers[place] += sign * _DIFFERENCE * (abs(numbers[place]) or 1.0)
    return BoundLaw(bound.law, tuple(numbers[:-1]), bound.row, numbers[-1]).at_rest, numbers[place]


def _block(joint: Joint) -> Array:
    direction = np.array([1.0, -1.0])[: len(joint.dofs)]
    return np.outer(direction, direction)


def joint_law(law: Law, parameters: Sequence[JointParameter]) -> JointLaw:
    """Return a law of a joint with its parameters, in the order of the law's names.

    Raises UsageError if known values make no sense.
    """
    numbers = [parameter.value for parameter in parameters]
    if problem := law.fault([None if number is None else float(number) for number in numbers]):
        raise UsageError(problem)
    return JointLaw(law, tuple(parameters))
