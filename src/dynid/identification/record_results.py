"""What a result holds of each record: its measurement, and the histories of the passes over it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.identification.augmented import AugmentedModel
from dynid.identification.filtering.filter import Pass
from dynid.identification.fit import Fitter
from dynid.identification.measurement import Experiment, Measurement
from dynid.identification.observed import Fit
from dynid.identification.residuals import consistency, spectrum
from dynid.identification.thinning import kept
from dynid.result import Result
from dynid.structure.matrices import Label
from dynid.structure.motion import inputs_of
from dynid.structure.response import Channel, common_unit, source_names

Array = NDArray[np.float64]


def add_history(
    result: Result,
    group: str,
    model: AugmentedModel,
    measurement: Measurement,
    dofs: Sequence[Label],
    history: Pass,
) -> None:
    """Add the histories of parameters and states over a record."""
    estimate = np.exp(history.logs)
    dims = ("time", "parameter")
    _add_kept_times(result, group, measurement)
    result.add_axis(f"{group}/parameter", [unknown.name for unknown in model.unknowns])
    unit = common_unit(unknown.unit for unknown in model.unknowns)
    result.add(f"{group}/estimate", estimate, dims, unit)
    result.add(f"{group}/standard_deviation", estimate * history.deviations, dims, unit)
    _add_components(result, group, dofs)
    # Not an axis named `state`: a variable of two axes cannot bear the name of one of them.
    result.add(f"{group}/state", history.states * model.scale, ("time", "component"))
    band = history.state_deviations * model.scale
    result.add(f"{group}/state_standard_deviation", band, ("time", "component"))


def add_truth(result: Result, group: str, model: AugmentedModel, states: Array | None) -> None:
    """Add to a history what it should come to, if known: the parameters, and the states (times x n)."""
    true = [unknown.true for unknown in model.unknowns if unknown.true is not None]
    if len(true) == len(model.unknowns):
        unit = common_unit(unknown.unit for unknown in model.unknowns)
        result.add(f"{group}/true", true, ("parameter",), unit)
    if states is not None:
        result.add(f"{group}/true_state", states, ("time", "component"))


def add_states(
    result: Result,
    group: str,
    measurement: Measurement,
    dofs: Sequence[Label],
    states: tuple[Array, Array],
    true: Array | None,
) -> None:
    """Add states and their deviations (times x n), measured or not, and the truth (Yang, Fig. 9)."""
    dims = ("time", "component")
    _add_kept_times(result, group, measurement)
    _add_components(result, group, dofs)
    result.add(f"{group}/estimate", states[0], dims)
    result.add(f"{group}/standard_deviation", states[1], dims)
    if true is not None:
        result.add(f"{group}/true", true, dims)


def _add_components(result: Result, group: str, dofs: Sequence[Label]) -> None:
    components = [Channel(dof, quantity) for quantity in ("displacement", "velocity") for dof in dofs]
    result.add_axis(f"{group}/component", [component.name for component in components])
    result.add(f"{group}/unit", [component.unit for component in components], ("component",))


def add_spectrum(result: Result, group: str, measurement: Measurement, fit: Fit) -> None:
    """Add the spectra of the residuals of a record, as roots of power spectral densities."""
    omega, amplitude = spectrum(fit.residual, measurement.step)
    units = [f"{channel.unit}.(s/rad)^0.5" for channel in measurement.channels]
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/channel", [channel.name for channel in measurement.channels])
    result.add(f"{group}/unit", units, ("channel",))
    result.add(f"{group}/amplitude", amplitude, ("omega", "channel"), common_unit(units))


def add_innovations(result: Result, group: str, measurement: Measurement, innovations: Array) -> None:
    """Add the normalised innovations of a record (times x channels) and their mean squares."""
    found = consistency(innovations)
    result.add_axis(f"{group}/time", _times(measurement), "s")
    result.add_axis(f"{group}/channel", [channel.name for channel in measurement.channels])
    result.add(f"{group}/normalised", innovations, ("time", "channel"))
    for name in ("mean_square", "low", "high"):
        result.add(f"{group}/{name}", getattr(found, name), ("channel",))
    for name in ("overall", "overall_low", "overall_high", "consistent"):
        result.add(f"{group}/{name}", getattr(found, name))


def add_measurement(result: Result, group: str, record: Fitter, experiment: Experiment, fit: Fit) -> None:
    """Add a record as measured and as predicted, and what drove it."""
    dims = ("time", "channel")
    channels, data = experiment.measurement.channels, record.data
    units = [channel.unit for channel in channels]
    unit = common_unit(units)
    result.add_axis(f"{group}/time", _times(experiment.measurement), "s")
    result.add_axis(f"{group}/channel", [channel.name for channel in channels])
    result.add(f"{group}/unit", units, ("channel",))
    result.add(f"{group}/measured", data.values, dims, unit)
    result.add(f"{group}/predicted", fit.predicted.outputs, dims, unit)
    result.add_axis(f"{group}/excitation", source_names(experiment.loads))
    loads, line = experiment.loads, record.model.line
    inputs = inputs_of(loads, line.nodes[line.wanted], line.inputs())
    units_in = [load.unit for load in loads]
    result.add(f"{group}/input_unit", units_in, ("excitation",))
    result.add(f"{group}/input", inputs, ("time", "excitation"), common_unit(units_in))
    measurement = experiment.measurement
    if measurement.prepared:
        # `time` counts from the first sample that is left; on the clock of the record it is at `start`, s.
        result.annotate(group, prepared="; ".join(measurement.prepared), start=measurement.start)
    if data.noise is not None:
        result.add(f"{group}/noise", data.noise, ("channel",), unit)
    if data.given is not None:
        result.add(f"{group}/given_noise", data.given, ("channel",), unit)


def _add_kept_times(result: Result, group: str, measurement: Measurement) -> None:
    """Add the times of a history, and say where these are not those of all samples."""
    rows = kept(measurement.samples)
    result.add_axis(f"{group}/time", _times(measurement)[rows], "s")
    if rows.step > 1:
        result.annotate(group, samples=measurement.samples, stored_every=rows.step)


def _times(measurement: Measurement) -> Array:
    return np.asarray(np.arange(measurement.samples) * measurement.step)
