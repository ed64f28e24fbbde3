"""Known masses and stiffnesses of a structure as factors, by which estimates are differentiated.

What an identification takes for known is not: estimates move with it, and where a record has little
redundancy no residual shows that. The masses of a diagonal mass matrix and the springs of a network are taken
one by one, those of any other matrix together; beside these the masses that sensors would add.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from dynid.arithmetic.dependent import Dependent
from dynid.arrays import Array
from dynid.parameters import Parameter
from dynid.structure.matrices import Matrix, as_array
from dynid.structure.model import StructuralModel, Term
from dynid.structure.ports import Channel

# Most masses, springs or sensors that are taken one by one; DOFs beyond which none are.
_MAX_PARTS, _MAX_DOFS = 24, 400
# Entries below this part of the largest are round-off of sums.
_ROUND_OFF = 64 * float(np.finfo(float).eps)


def with_known_parts(
    model: StructuralModel, parameters: Sequence[Parameter], channels: Sequence[Any]
) -> StructuralModel:
    """Return a structure with other `parameters`, and an unknown factor, 1, of each known mass and stiffness.

    Of what is known together, the masses at the sensors of `channels` have factors, too.
    """
    terms = list(_known_terms(model, channels))
    factors = [Parameter(next(iter(term.coefficient.names)), 1.0) for term in terms]
    return model.with_terms((*model.terms, *terms), (*parameters, *factors))


def _known_terms(model: StructuralModel, channels: Sequence[Any]) -> Iterator[Term]:
    M, K = (_known(model, letter) for letter in "MK")
    one_by_one = model.basis is None and model.size <= _MAX_DOFS and not model.is_sparse
    masses = _masses(model, as_array(M)) if one_by_one else None
    springs = _springs(model, as_array(K)) if one_by_one else None
    sensors = [] if masses is not None or model.size > _MAX_DOFS else _sensors(model, channels)
    for letter, parts in (
        ("M", [("mass of the structure", M)] if masses is None else masses),
        ("M", sensors),
        ("K", [("stiffness of the structure", K)] if springs is None else springs),
    ):
        for name, matrix in parts:
            if np.any(as_array(matrix)):
                yield Term(letter, Dependent.parameter(name, 1.0), matrix)


def _known(model: StructuralModel, letter: str) -> Matrix:
    """Return the part of a matrix that depends on no parameter, known joints included."""
    none = {joint_unknown.name: 0.0 for joint_unknown in model.joint_unknowns}
    total: Any = model.rotating(None).with_known_joints()["MCK".index(letter)]
    for term in (*model.terms, *model.joint_terms):
        if term.letter == letter:
            total = total - term.coefficient.at(none).value * term.matrix
    matrix: Matrix = total
    return matrix


def _masses(model: StructuralModel, M: Array) -> list[tuple[str, Matrix]] | None:
    """Return the masses of a diagonal matrix by DOF; None of another one, or of many."""
    sizes = np.diag(M)
    if np.any(M - np.diag(sizes)) or np.count_nonzero(sizes) > _MAX_PARTS:
        return None
    units = np.eye(len(M))
    return [
        (f"mass of DOF {dof}", size * np.outer(unit, unit))
        for dof, size, unit in zip(model.dofs, sizes, units, strict=True)
        if size > 0
    ]


def _springs(model: StructuralModel, K: Array) -> list[tuple[str, Matrix]] | None:
    """Return the springs of a network of translations; None of another matrix, or of many."""
    rounding = _ROUND_OFF * np.abs(K).max(initial=0.0)
    between, ground = np.triu(-K, 1), K.sum(axis=1)
    if between.min(initial=0.0) < -rounding or ground.min(initial=0.0) < -len(K) * rounding:
        return None
    springs, units = [], np.eye(len(K))
    for i in np.flatnonzero(ground > len(K) * rounding).tolist():
        name = f"stiffness from DOF {model.dofs[i]} to ground"
        springs.append((name, ground[i] * np.outer(units[i], units[i])))
    for i, j in np.argwhere(between > rounding).tolist():
        way = units[i] - units[j]
        name = f"stiffness between DOFs {model.dofs[i]} and {model.dofs[j]}"
        springs.append((name, between[i, j] * np.outer(way, way)))
    return springs if len(springs) <= _MAX_PARTS else None


def _sensors(model: StructuralModel, channels: Sequence[Any]) -> list[tuple[str, Matrix]]:
    """Return the masses that move with the DOFs of sensors, which those of the sensors add to."""
    M, masses = as_array(model.rotating(None).with_known_joints()[0]), dict[str, Matrix]()
    for channel in channels:
        if not isinstance(channel, Channel) or model.kind(channel.dof) == "rotation":
            continue
        row = model.row(channel.dof)
        mobility = float(row @ np.linalg.lstsq(M, row, rcond=None)[0])
        if mobility > 0:
            masses[f"mass at the sensor of DOF {channel.dof}"] = np.outer(row, row) / mobility
    return list(masses.items())[:_MAX_PARTS]
