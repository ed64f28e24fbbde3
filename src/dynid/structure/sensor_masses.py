"""Masses of sensors on a structure: they move along all translations of the node that they stand on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dynid.arithmetic.dependent import Dependent, Real
from dynid.errors import UsageError
from dynid.structure.labels import DIRECTIONS, Label, node_direction
from dynid.structure.model import StructuralModel, Term


def with_sensor_masses(model: StructuralModel, masses: Mapping[Label, Real]) -> StructuralModel:
    """Return a structure, not reduced, with the masses of sensors, kg, by a DOF of the node of each.

    The masses may depend on the model's parameters. Raises UsageError if a DOF is a rotation, or sensors at
    one node have different masses.
    """
    M: Any = model.M
    terms, seen = list(model.terms), dict[tuple[Label, ...], Real]()
    for dof, mass in masses.items():
        if model.kind(dof) == "rotation":
            raise UsageError(
                f"the mass of a sensor at {dof}, a rotation, has no inertia there",
                remedy="State it at a channel along a translation of the node.",
                names=("measurement.channels",),
            )
        places = _translations(model, dof)
        if seen.setdefault(places, mass) != mass:
            raise UsageError(
                f"sensors at the node of DOF {dof} have different masses",
                remedy="State the mass of all sensors at the node in each of its channels.",
                names=("measurement.channels",),
            )
        seen[places] = mass
    for places, mass in seen.items():
        rows = np.array([model.row(place) for place in places])
        pattern: Any = model._stored(rows.T @ rows)
        M = M + float(mass) * pattern
        if isinstance(mass, Dependent):
            terms.append(Term("M", mass, pattern))
    return replace(model, M=M, terms=tuple(terms))


def _translations(model: StructuralModel, dof: Label) -> tuple[Label, ...]:
    """Return the translations of the node or point of a DOF; itself where its name says no node."""
    _, label = model.dof_names.find_signed(dof)
    split = node_direction(label)
    if split is None:
        return (label,)
    node, names = split[0], model.dof_names
    axes = (f"{node}:{axis}" for axis in DIRECTIONS[:3])
    return tuple(names.find(axis) for axis in axes if names.has(axis))
