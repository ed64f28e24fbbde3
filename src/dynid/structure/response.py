"""Frequency and time responses of a structure to forces at DOFs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.errors import UsageError
from dynid.lti.floating import guarded
from dynid.lti.frequency import QUANTITIES
from dynid.lti.propagate import response
from dynid.lti.signals import Signal
from dynid.result import Result
from dynid.structure import labels
from dynid.structure.frf import Ports, frequency_response_functions
from dynid.structure.matrices import Label, as_array
from dynid.structure.model import StructuralModel
from dynid.structure.state_space import state_space

Array = NDArray[np.float64]

UNITS = {"displacement": "m", "velocity": "m/s", "acceleration": "m/s2"}
"""SI units of the output quantities (of translations; read m as rad for rotations)."""


class Channel(NamedTuple):
    """An output: `quantity` (displacement, velocity, acceleration) of `dof`, less that of `reference`."""

    dof: Label
    quantity: str
    reference: Label | None = None

    @property
    def name(self) -> str:
        """Its name in results, ``<dof>.<quantity>``; between two DOFs ``<dof>-<reference>.<quantity>``."""
        relative = "" if self.reference is None else f"-{self.reference}"
        return f"{self.dof}{relative}.{self.quantity}"

    @property
    def unit(self) -> str:
        """Its unit, SI: of rotations, where the label tells, in rad."""
        turning = labels.kind(self.dof) == "rotation"
        return UNITS[self.quantity].replace("m", "rad", 1) if turning else UNITS[self.quantity]

    def row(self, model: StructuralModel) -> Array:
        """Return what it reads of the displacements (n)."""
        row = model.row(self.dof)
        return row if self.reference is None else np.asarray(row - model.row(self.reference))

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
    """A force on `dof` (N; N·m on a rotation) that follows `signal`."""

    dof: Label
    signal: Signal


@guarded("the frequency response")
def frequency_response(
    model: StructuralModel,
    inputs: Sequence[Label],
    outputs: Sequence[Channel],
    omega: ArrayLike,
    values: Mapping[str, float] | None = None,
    *,
    method: str = "auto",
    accuracy: float = 1e-8,
) -> Result:
    """Return the responses at `outputs` to unit forces at the DOFs `inputs`.

    Parameters
    ----------
    model
        The structure.
    inputs
        DOFs that are excited, one a column.
    outputs
        What is read.
    omega
        Angular frequencies, rad/s.
    values
        Unknown joint parameters by name.
    method, accuracy
        As of `dynid.structure.frf.frequency_response_functions`.

    Returns
    -------
    Result
        ``structure/frequency_response/{omega, output, unit, input, response}``; ``unit`` is along ``output``.
        Attributes `method`, `modes` and `error` say how the response was computed and how well.

    Raises
    ------
    Singular
        If a frequency lies on an undamped natural frequency.
    NumericalError
        If modes do not reach the accuracy.
    UsageError
        If a DOF or quantity does not exist or an unknown parameter has no value.
    """
    where = Ports(*ports(model, inputs, outputs))
    w = np.atleast_1d(np.asarray(omega, dtype=float))
    found = frequency_response_functions(
        *model.with_joints(values), where, w, method=method, accuracy=accuracy
    )
    result = Result("structure")
    group = "structure/frequency_response"
    result.add_axis(f"{group}/omega", w, "rad/s")
    result.add_axis(f"{group}/output", [channel.name for channel in outputs])
    result.add_axis(f"{group}/input", [str(dof) for dof in inputs])
    units = [f"{channel.unit}/N" for channel in outputs]
    result.add(f"{group}/unit", units, ("output",))
    result.add(f"{group}/response", found.response, ("omega", "output", "input"), common_unit(units))
    result.annotate(group, method=found.method, modes=found.modes, error=found.error)
    return result


@guarded("the time response")
def time_response(
    model: StructuralModel,
    loads: Sequence[Load],
    outputs: Sequence[Channel],
    times: ArrayLike,
    *,
    values: Mapping[str, float] | None = None,
    displacement: Mapping[Label, float] | None = None,
    velocity: Mapping[Label, float] | None = None,
) -> Result:
    """Return the exact responses at `outputs` to `loads`, from t = 0 on.

    Parameters
    ----------
    model
        The structure.
    loads
        The forces.
    outputs
        What is read.
    times
        Increasing times, s.
    values
        Unknown joint parameters by name.
    displacement, velocity
        Initial displacement, m, and velocity, m/s, by DOF; absent: 0.

    Returns
    -------
    Result
        ``structure/time_response/{time, output, unit, response, source, input}``; ``unit`` is along
        ``output``, ``input`` (time x source) holds the forces.

    Raises
    ------
    UsageError
        If a DOF or quantity does not exist or an unknown parameter has no value.
    NumericalError
        If the response overflows.
    """
    forces, rows, orders = ports(model, [load.dof for load in loads], outputs)
    system = state_space(*model.dense(values), forces, rows, orders)
    x0 = np.concatenate([_initial(model, displacement), _initial(model, velocity)])
    t = np.asarray(times, dtype=float)
    y = response(system, [load.signal for load in loads], t, x0)
    result = Result("structure")
    group = "structure/time_response"
    result.add_axis(f"{group}/time", t, "s")
    result.add_axis(f"{group}/output", [channel.name for channel in outputs])
    units = [channel.unit for channel in outputs]
    result.add(f"{group}/unit", units, ("output",))
    result.add(f"{group}/response", y.outputs, ("time", "output"), common_unit(units))
    result.add_axis(f"{group}/source", source_names(loads))
    result.add(f"{group}/input", y.inputs, ("time", "source"), "N")
    return result


def source_names(loads: Sequence[Load]) -> list[str]:
    """Return a name for each load: its DOF, numbered where a DOF carries several."""
    dofs = [load.dof for load in loads]
    return [
        str(dof) if dofs.count(dof) == 1 else f"{dof}#{dofs[: k + 1].count(dof)}"
        for k, dof in enumerate(dofs)
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


def _initial(model: StructuralModel, given: Mapping[Label, float] | None) -> Array:
    if model.basis is not None:  # the nearest motion of the reduced model, by kinetic energy
        M, full = as_array(model.M), _initial(model.basis.parent, given)
        momentum = model.basis.T.T @ np.asarray(model.basis.parent.M @ full)
        return np.asarray(np.linalg.lstsq(M, momentum, rcond=None)[0])
    start = np.zeros(model.size)
    for dof, value in (given or {}).items():
        start += value * model.row(dof)
    return start


def common_unit(units: Iterable[str]) -> str:
    """Return the unit that all share, or nothing."""
    different = set(units)
    return different.pop() if len(different) == 1 else ""
