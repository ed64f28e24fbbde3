"""Channels and loads of a structure, and their directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.errors import UsageError
from dynid.lti.frequency_response import QUANTITIES
from dynid.lti.signals import Impulse, Signal
from dynid.structure import labels
from dynid.structure.matrices import Array, Label
from dynid.structure.model import StructuralModel

UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2"}
"""SI units of the output quantities (of translations; read m as rad for rotations)."""


class Channel(NamedTuple):
    """An output: `quantity` (displacement, velocity, acceleration) of `dof`, less that of `reference`.

    Where the ground moves it is relative to the ground, or `absolute`. What is recorded is ``gain`` times the
    output ``delay`` earlier (s), plus ``offset``.
    """

    dof: Label
    quantity: str
    reference: Label | None = None
    absolute: bool = False
    gain: Real = 1.0
    offset: Real = 0.0
    delay: Real = 0.0

    @property
    def name(self) -> str:
        """Its name in results, ``<dof>.<quantity>``; between two DOFs ``<dof>-<reference>.<quantity>``."""
        relative = "" if self.reference is None else f"-{self.reference}"
        return f"{self.dof}{relative}.{self.quantity}{'.absolute' * self.absolute}"

    @property
    def gain_name(self) -> str:
        """The name of its gain."""
        return f"gain of {self.name}"

    @property
    def unit(self) -> str:
        """Its unit, SI; in rad of rotations that the label names."""
        turning = labels.kind(self.dof) == "rotation"
        return UNITS[self.quantity].replace("m", "rad", 1) if turning else UNITS[self.quantity]

    def row(self, model: StructuralModel) -> Array:
        """Return its row of the displacements (n)."""
        row = model.row(self.dof)
        return row if self.reference is None else np.asarray(row - model.row(self.reference))

    def unit_load(self, dof: Label) -> Load:
        """Return the load that a frequency response of it refers to: a unit impulse at a DOF."""
        return Load(dof, Impulse(1.0))

    @property
    def order(self) -> int:
        """Derivative order of the quantity."""
        if self.quantity not in QUANTITIES:
            raise UsageError(
                f"there is no output quantity {self.quantity!r}",
                remedy=f"Use one of {', '.join(QUANTITIES)}.",
                names=(self.quantity,),
            )
        return QUANTITIES[self.quantity]


class Load(NamedTuple):
    """A force on `dof` (N; N·m on a rotation) that follows `signal`; or a motion that does.

    With `motion` (displacement, velocity, acceleration) the motion of the DOF is prescribed; without a DOF
    it is the ground's, which moves along with every translation. What acts is ``gain`` times the signal
    ``delay`` earlier (s).
    """

    dof: Label | None
    signal: Signal
    motion: str | None = None
    gain: Real = 1.0
    delay: Real = 0.0

    @property
    def order(self) -> int | None:
        """Derivative order of the motion; None of a force."""
        return None if self.motion is None else Channel(0, self.motion).order

    @property
    def name(self) -> str:
        """Its name in results."""
        return "base" if self.dof is None else str(self.dof)

    @property
    def gain_name(self) -> str:
        """The name of its gain."""
        return f"{self.motion or 'force'} gain of {'base' if self.dof is None else self.dof}"

    @property
    def unit(self) -> str:
        """The unit of its signal."""
        return "N" if self.motion is None else Channel(self.dof or 0, self.motion).unit


def source_names(loads: Sequence[Load]) -> list[str]:
    """Return a name for each load: its DOF or the base, numbered where a DOF carries several."""
    names = [load.name for load in loads]
    return [
        name if names.count(name) == 1 else f"{name}#{names[: k + 1].count(name)}"
        for k, name in enumerate(names)
    ]


def ports(
    model: StructuralModel, inputs: Sequence[Label], outputs: Sequence[Channel]
) -> tuple[Array, Array, list[int]]:
    """Return force directions (n x inputs), displacement rows (outputs x n) and derivative orders.

    Raises
    ------
    UsageError
        If a DOF or quantity does not exist.
    """
    forces = np.array([model.row(dof) for dof in inputs]).reshape(len(inputs), model.size).T
    rows = np.array([channel.row(model) for channel in outputs]).reshape(len(outputs), model.size)
    return forces, rows, [channel.order for channel in outputs]
