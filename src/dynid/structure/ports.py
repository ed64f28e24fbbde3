"""Channels and loads of a structure, and their directions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dynid.arithmetic.dependent import Real
from dynid.arrays import Array
from dynid.errors import UsageError
from dynid.lti.frequency_response import QUANTITIES
from dynid.lti.signals import Impulse, Signal
from dynid.result import common_unit
from dynid.structure import labels
from dynid.structure.labels import Label
from dynid.structure.model import StructuralModel
from dynid.units import as_factor

if TYPE_CHECKING:
    from dynid.lti.filters import Filter

UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2"}
"""SI units of the output quantities (of translations; read m as rad for rotations)."""


class ChannelClock(NamedTuple):
    """Clock of a channel: sample j is at ``start + j step (1 + drift)``, s, from the record's first on."""

    step: float  # nominal sampling step, s
    samples: int
    start: float = 0.0  # time of its first sample after that of the record, s
    drift: Real = 0.0  # part by which its step is longer than the nominal one


class Channel(NamedTuple):
    """An output: `quantity` (displacement, velocity, acceleration) of `dof`, less that of `reference`.

    Where the ground moves it is relative to the ground, or `absolute`. What is recorded is ``gain`` times the
    output ``delay`` earlier (s), behind `filters` of the instrument, plus ``offset``, at the times of its
    `clock`, by default those of the record. The DOF's `kind` is ``translation``, ``rotation`` or ``unknown``;
    default: as its label says, else a translation.
    """

    dof: Label
    quantity: str
    reference: Label | None = None
    absolute: bool = False
    gain: Real = 1.0
    offset: Real = 0.0
    delay: Real = 0.0
    kind: str = ""
    filters: tuple[Filter, ...] = ()
    clock: ChannelClock | None = None

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
        """Its unit, SI; empty where its DOF may be a translation or a rotation."""
        return _of_kind(self.kind or _kind(self.dof), *motion_units(self.recorded))

    @property
    def units(self) -> tuple[str, ...]:
        """The units that its label allows, SI: of a label without direction two."""
        return _allowed(self.dof, *motion_units(self.recorded))

    @property
    def recorded(self) -> str:
        """The quantity behind its integrators."""
        orders = sum(item.order for item in self.filters if item.kind == "integrator")
        return integrated(self.quantity, orders) if orders else self.quantity

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
    ``delay`` earlier (s). The `kind` of the DOF is as of a `Channel`.
    """

    dof: Label | None
    signal: Signal
    motion: str | None = None
    gain: Real = 1.0
    delay: Real = 0.0
    kind: str = ""

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
        """The unit of its signal, SI; empty where its DOF may be a translation or a rotation."""
        return _of_kind(self.kind or _kind(self.dof), *motion_units(self.motion))

    @property
    def units(self) -> tuple[str, ...]:
        """The units of its signal that its label allows, SI: of a label without direction two."""
        return _allowed(self.dof, *motion_units(self.motion))


def integrated(quantity: str, times: int) -> str:
    """Return what a quantity is after so many integrations, at most a displacement."""
    return list(UNITS)[max(0, list(UNITS).index(quantity) - times)]


def motion_units(quantity: str | None) -> tuple[str, str]:
    """Return the units of a quantity, default: of a force, along a translation and along a rotation."""
    if quantity is None:
        return "N", "N.m"
    return UNITS[quantity], UNITS[quantity].replace("m", "rad", 1)


def _kind(dof: Label | None) -> str:
    """Return the kind of a DOF of which the label alone is known, or of the ground."""
    return "rotation" if dof is not None and labels.kind(dof) == "rotation" else "translation"


def _of_kind(kind: str, of_translation: str, of_rotation: str) -> str:
    """Return the unit along a kind of DOF; empty where the kind is unknown."""
    return {"translation": of_translation, "rotation": of_rotation}.get(kind, "")


def _allowed(dof: Label | None, of_translation: str, of_rotation: str) -> tuple[str, ...]:
    """Return the units that the label of a DOF allows; the ground is translated."""
    if dof is not None and labels.kind(dof) == "unknown":
        return of_translation, of_rotation
    return (_of_kind(_kind(dof), of_translation, of_rotation),)


def response_units(model: StructuralModel, inputs: Sequence[Label], outputs: Sequence[Channel]) -> list[str]:
    """Return the units of the responses at outputs to unit forces, empty where unknown or several."""
    force = common_unit(Load(dof, Impulse(1.0), kind=model.kind(dof)).unit for dof in inputs)
    return [ratio(channel.unit, force) for channel in outputs]


def ratio(above: str, below: str) -> str:
    """Return the unit of an output over that of an input; empty where one is unknown."""
    return f"{above}/{as_factor(below)}" if above and below else ""


def source_names(loads: Sequence[Load]) -> list[str]:
    """Return a name for each load: its DOF or the base, numbered where a DOF carries several."""
    names = [load.name for load in loads]
    return [
        name if names.count(name) == 1 else f"{name}#{names[: k + 1].count(name)}"
        for k, name in enumerate(names)
    ]


class Ports(NamedTuple):
    """Force directions (n x inputs), displacement rows (outputs x n), and powers of i omega (outputs)."""

    forces: Array
    rows: Array
    powers: list[int]


def ports(model: StructuralModel, inputs: Sequence[Label], outputs: Sequence[Channel]) -> Ports:
    """Return the directions of forces at DOFs, and the rows and derivative orders of channels.

    Raises UsageError if a DOF or quantity does not exist.
    """
    forces = np.array([model.row(dof) for dof in inputs]).reshape(len(inputs), model.size).T
    rows = np.array([channel.row(model) for channel in outputs]).reshape(len(outputs), model.size)
    return Ports(forces, rows, [channel.order for channel in outputs])
