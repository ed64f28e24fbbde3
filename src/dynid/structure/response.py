"""Frequency and time responses of a structure to forces at DOFs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import guarded
from dynid.lti.time_response import propagate
from dynid.result import Result, common_unit
from dynid.structure.excitation import drive, inputs_of, signals_of, starting_state
from dynid.structure.labels import Label
from dynid.structure.model import TANGENT, StructuralModel
from dynid.structure.ports import Channel, Load, ports, response_units, source_names


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

    `inputs`: DOFs that are excited, one a column; `omega`: angular frequencies, rad/s; `values`: unknown
    joint parameters by name; `method`, `accuracy`: as of `dynid.structure.frf.frequency_response_functions`.

    Raises Singular if the responses that are infinite at an undamped natural frequency are not determined,
    NumericalError if modes do not reach the accuracy, and UsageError if a DOF or quantity does not exist or
    an unknown parameter has no value.

    Returns
    -------
    Result
        ``structure/frequency_response/{omega, output, unit, input, response}``; ``unit`` is along ``output``;
        ``structure/frequency_peaks/{magnitude, omega}``, the largest magnitudes over the band, between the
        frequencies too, but for large sparse structures at few frequencies.
        Attributes `method`, `modes` and `error` hold the method of computation and its error.
    """
    from dynid.structure.frf import frequency_response_functions

    where = ports(model, inputs, outputs)
    w = np.atleast_1d(np.asarray(omega, dtype=float))
    model.needs_positive(w)
    if model.rotor is not None:
        from dynid.structure.rotors import rotor_response

        response = rotor_response(model, where, w, values)
    else:
        response = frequency_response_functions(
            *model.with_joints(values, loss=True), where, w, method=method, accuracy=accuracy
        )
    result = Result("structure")
    group = "structure/frequency_response"
    result.add_axis(f"{group}/omega", w, "rad/s")
    names = [channel.name for channel in outputs]
    result.add_axes(group, output=names, input=[str(dof) for dof in inputs])
    units = response_units(model, inputs, outputs)
    result.add(f"{group}/unit", units, ("output",))
    result.add(f"{group}/response", response.response, ("omega", "output", "input"), common_unit(units))
    result.annotate(group, method=response.method, modes=response.modes, error=response.error)
    if model.nonlinear:
        result.annotate(group, note=TANGENT)
    if response.evaluate is not None and len(w) and np.all(np.diff(w) > 0):
        from dynid.lti.peaks import add_peaks

        add_peaks(result, "structure", response.evaluate, response.near)
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

    `loads`: the forces; `times`: increasing times, s; `values`: unknown joint parameters by name;
    `displacement`, `velocity`: initial displacement, m, and velocity, m/s, by DOF; default: 0. Raises
    UsageError if a DOF or quantity does not exist or an unknown parameter has no value, and NumericalError if
    the response overflows.

    Returns
    -------
    Result
        ``structure/time_response/{time, output, unit, response, source, input}``; ``unit`` is along
        ``output``, ``input`` (time x source) holds the forces.
    """
    model.needs_causal("time response")
    t = np.asarray(times, dtype=float)
    driven, (M, C, K) = drive(model, loads, outputs, values), model.dense(values)
    driven.check_initial(M, C, model.dofs, displacement, velocity)
    motion = starting_state(model, loads, displacement, velocity)
    result = Result("structure")
    group = "structure/time_response"
    if model.nonlinear:
        from dynid.structure.nonlinear.response import add_joints, nonlinear_response

        y, joints = nonlinear_response(model, driven, signals_of(loads), t, motion, values or {})
        add_joints(result, joints, t)
    else:
        y = propagate(driven.system(M, C, K), signals_of(loads), t, driven.state(M, C, motion))
    result.add_axis(f"{group}/time", t, "s")
    result.add_axis(f"{group}/output", [channel.name for channel in outputs])
    units = [channel.unit for channel in outputs]
    result.add(f"{group}/unit", units, ("output",))
    result.add(f"{group}/response", y.outputs, ("time", "output"), common_unit(units))
    result.add_axis(f"{group}/source", source_names(loads))
    inputs = inputs_of(loads, t, y.inputs)
    units = [load.unit for load in loads]
    result.add(f"{group}/input_unit", units, ("source",))
    result.add(f"{group}/input", inputs, ("time", "source"), common_unit(units))
    return result
