"""Sensitivity of estimates to the calibration of instruments, the clock, and what is taken for known.

Gains of loads and sensors, the delay, considered parameters, known masses and stiffnesses are not estimated:
error bars do not include their errors. See B. D. Tapley, B. E. Schutz, G. H. Born, Statistical Orbit
Determination, 2004, ch. 6 (consider covariance analysis).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, finite
from dynid.identification.least_squares import without_state
from dynid.identification.likelihood.frf_record import FrfRecord
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood, weights
from dynid.identification.likelihood.shared_decays import sensitive_blocks, shared_triangles
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.frf_measurement import stacked, unstacked
from dynid.identification.systems.parametric_model import freed_coordinates, freed_model
from dynid.identification.systems.prediction import PredictionBlock, output_rates, outputs_from
from dynid.parameters import Parameter
from dynid.result import Result
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel

if TYPE_CHECKING:
    from dynid.identification.likelihood.modal_record import ModalRecord

#: Name of the delay of the loads behind what the channels record.
DELAY = "trigger delay"
#: Change of a gain that effects are quoted for; and of a phase, rad, where nothing is sampled.
GAIN_CHANGE = 0.01
#: Name of the relative error of the clock, and the change that effects are quoted for: that of cheap quartz.
CLOCK, CLOCK_CHANGE = "clock", 1e-4
#: Group of the result.
GROUP = "identification/considered"
# Singular values of the scaled sensitivities, over the largest, below which parameters are not distinguished.
_LEAST_SINGULAR = 1e-8
# Step of differences by the clock: of records as the phase, rad, by which the fastest mode moves at the end;
# of frequency responses relative.
_CLOCK_PHASE, _CLOCK_STEP = 1e-3, 1e-6
# Multiplications of one evaluation of frequency responses beyond which known masses and stiffnesses are not
# considered: they act at all DOFs, so that nothing is condensed.
_KNOWN_WORK = 2e8


class _CalibrationDerivatives(NamedTuple):
    """Derivatives of a record by the parameters and by the calibration, over the noise."""

    # Gains, delay and considered parameters (q), by name. A gain multiplies a load as the estimator knows it,
    # or the values of a channel; a delay, s, shifts the loads to later times. Quantities of one name are one.
    quantities: tuple[str, ...]
    # The change of each that effects are quoted for (q): 1 % of a gain, a sampling step of the delay, the
    # standard deviation of a considered parameter (of its logarithm, if it has one).
    changes: Array
    # Derivatives of the prediction by the coordinates of the parameters (rows x p), free of the initial
    # state.
    by_parameter: Array
    # Derivatives of prediction less measurement by the logarithms of gains and by the delay (rows x q), free
    # of the initial state.
    by_quantity: Array


class CalibrationSlopes(NamedTuple):
    """Slopes of the estimates by gains and delay."""

    parameters: Sequence[str]  # names of the parameters (p)
    # Names of gains, delay, considered parameters, known masses and stiffnesses, and the clock (q).
    quantities: Sequence[str]
    # The change of each quantity that effects are quoted for (q): 1 % of a gain, of a known mass or
    # stiffness, 1e-4 of the clock, a sampling step of the delay, s (of frequency responses the delay that
    # turns the phase at the highest line by 0.01 rad).
    changes: Array
    # Derivatives of the logarithms of the estimates by the logarithms of gains, and by the delay, 1/s (p x
    # q).
    slopes: Array
    # What a change leaves in the residuals when the estimates have followed it, over the noise (q): the root
    # of the sum of squares.
    visibility: Array


def calibration_slopes(
    likelihood: Likelihood, fit: Fit, noise: Sequence[Array], held: NDArray[np.bool_]
) -> CalibrationSlopes:
    """Return the slopes of the maximum-likelihood estimate, to first order (Gauss–Newton).

    With J the derivatives of the prediction by the parameters, free of the initial state, with a row for
    each prior, and g those of prediction less measurement by a quantity: ``-(J^T W J)^-1 J^T W g``. The error
    is of the order of the residuals.

    `noise`: deviations of the noise (channels) of each record; `held`: mask of parameters at a limit (p):
    these do not move.
    """
    derivatives = [
        _of_record(record, record_fit, level)
        if isinstance(record, TimeRecord)
        else _of_responses(record, record_fit, level)
        if isinstance(record, FrfRecord)
        else _of_modes(cast("ModalRecord", record), record_fit, level)
        for record, record_fit, level in zip(likelihood.records, fit.parts, noise, strict=True)
    ]
    quantities = list(dict.fromkeys(name for record in derivatives for name in record.quantities))
    changes, priors = np.full(len(quantities), np.inf), likelihood.priors.rows()
    by_quantity = []
    for record in derivatives:  # one name is one instrument, in all records
        columns = [quantities.index(name) for name in record.quantities]
        changes[columns] = np.minimum(changes[columns], record.changes)
        by_quantity.append(record.by_quantity @ np.eye(len(quantities))[columns])
    g = np.concatenate([*by_quantity, np.zeros((len(priors), len(quantities)))])
    J = np.concatenate([*(record.by_parameter for record in derivatives), priors])
    J = np.where(held, 0.0, J)
    finite("the sensitivity of the record", J)
    finite("the sensitivity of the record to its calibration", g)
    size = np.linalg.norm(J, axis=0)
    size = np.where(size > 0, size, 1.0)
    moves = np.asarray(np.linalg.lstsq(J / size, g, _LEAST_SINGULAR)[0] / size[:, None])
    visibility = np.linalg.norm(g - J @ moves, axis=0) * changes
    slopes = np.where(held[:, None], 0.0, -moves)
    return CalibrationSlopes(likelihood.names, quantities, changes, slopes, visibility)


def _considered(freed: Sequence[Parameter], record: RecordLikelihood) -> tuple[list[int], list[float]]:
    """Return which parameters of a freed model are considered alone, and the changes quoted for them."""
    unknown = {parameter.name for parameter in record.unknowns}
    deviations = {parameter.name: parameter.deviation for parameter in record.considered}
    columns = [k for k, parameter in enumerate(freed) if parameter.name not in unknown]
    return columns, [deviations.get(freed[k].name, GAIN_CHANGE) for k in columns]


# Records of time.


def _of_record(record: TimeRecord, fit: RecordFit, noise: Array) -> _CalibrationDerivatives:
    model, n, p = record.model, record.nuisances, record.model.parameters
    names, changes, columns = _by_loads(record, fit) if record.superposes else ([], [], [])
    places: list[int] = []
    if (freed := model.freed) is not None:
        # By coordinates of considered parameters, and by the logarithms of what else is known.
        places, deviations = _considered(freed.unknowns, record)
        eta = freed_coordinates(freed.unknowns, record.unknowns, fit.eta)
        names += [freed.unknowns[k].name for k in places]
        changes += deviations
    count = len(columns)
    if record.superposes and (late := _by_clock(record, fit)) is not None:
        names, changes, columns = [*names, CLOCK], [*changes, CLOCK_CHANGE], [*columns, late]
    measured, channels = np.nan_to_num(record.data.recorded), len(record.data.rms)
    mixed = record.colour is not None and record.colour.mixing is not None
    gained = np.eye(channels) if mixed else np.ones((1, 1))  # the channels whose values a gain changes
    influential, decays = record.influential(fit), record.decays(fit.eta)
    if decays is not None and not np.isnan(influential).any():
        # A freed model has the unknowns, too.
        general, at, start = model, fit.eta, fit.predicted.start
        order = list(range(p))
        if freed is not None:
            general, at, start = freed, eta, start * (model.scale / freed.scale)
            numbers = {unknown.name: k for k, unknown in enumerate(freed.unknowns)}
            order = [numbers[unknown.name] for unknown in record.unknowns]

        def blocks_of_samples() -> Iterator[tuple[NDArray[np.int64], Array]]:
            for samples, _, _, moved in sensitive_blocks(general, at, start):
                beside = [column[samples, None] for column in (*columns, measured)]
                parts = [moved[:, order], *beside[:count], moved[:, places], *beside[count:]]
                yield samples, np.concatenate(parts, axis=1)

        rows = shared_triangles(decays, blocks_of_samples()) / noise[:, None, None]
    else:
        of_freed = 0 if freed is None else len(freed.unknowns)
        at_once, start = record.rows_at_once(of_freed + len(columns) + len(gained)), fit.predicted.start
        moved_blocks: Iterator[PredictionBlock] = iter(())
        if freed is not None:
            other = record.with_model(freed)
            # All at once if delays are among what is freed.
            at_once = at_once if other.rows_at_once() < len(measured) else len(measured)
            moved_blocks = other.blocks(eta, start, model, at_once, by_state=False)

        def blocks() -> Iterator[tuple[Array, Array, Array]]:
            for samples, _, _, by_parameter, by_state in record.blocks(fit.eta, start, model, at_once):
                beside = [column[samples][..., None] for column in columns]
                if freed is not None:
                    beside.insert(count, next(moved_blocks).by_parameter[..., places])
                values = measured[samples][..., None] * gained
                yield influential[samples], by_state, np.concatenate([by_parameter, *beside, values], axis=2)

        rows, _ = record.triangles_of(blocks(), ~np.isnan(influential))
        rows = rows[..., :-1] * (record.data.rms / noise)[:, None, None]
    # The gain of a channel acts on the rows of that channel alone.
    gains = -rows[..., -channels:] if mixed else -rows[..., -1:] * np.eye(channels)[:, None, :]
    rows = np.concatenate([rows[..., : -channels if mixed else -1], gains], axis=2)
    rows = rows.reshape(-1, rows.shape[2])
    projected, _ = without_state(rows[:, n:], rows[:, :n] @ record.root)
    sensors = model.gains[1]
    return _CalibrationDerivatives(
        (*names, *sensors),
        np.array([*changes, *[GAIN_CHANGE] * len(sensors)]),
        projected[:, :p],
        projected[:, p:],
    )


def _by_clock(record: TimeRecord, fit: RecordFit) -> Array | None:
    """Return the derivative of the prediction by the relative error of the clock; None where unknown."""
    # It is exact but for free motions, whose start moves with the clock: where inputs keep their own time,
    # the rate of the outputs times the time from the first sample; else a difference.
    model = record.model
    if not model.has_samples and model.sampling is None and not model.instruments.unknown_delays:
        passed = (model.times - model.times[0])[:, None]
        return np.asarray(passed * output_rates(model, fit.eta, fit.predicted.states))
    span = float(np.ptp(model.times))
    if model.instruments.clocked:
        return None
    if model.known.any() or model.instruments.unknown_delays or not span > 0:
        return None
    poles = np.abs(model.poles(fit.eta))
    step = _CLOCK_PHASE / max(1.0, float(poles.max(initial=0.0)) * span)
    moved = outputs_from(model.clocked(step), fit.eta, fit.predicted.start, record.channel_blocks())
    return np.asarray((moved - fit.predicted.outputs) / step)


def _by_loads(record: TimeRecord, fit: RecordFit) -> tuple[list[str], list[float], list[Array]]:
    """Return names, changes, and derivatives of the prediction by gains and delay of the loads."""
    # They are exact but for free motions, which are projected out with the initial state: so the whole
    # prediction is taken for the response to a single load, and minus its rate for the derivative by the
    # delay.
    model, loads = record.model, record.model.gains[0]
    names = list(dict.fromkeys(loads))
    if len(names) == 1:
        columns = [fit.predicted.outputs]
    else:
        groups = [[k for k, load in enumerate(loads) if load == name] for name in names]
        driven = [model.driven_by(group) for group in groups]
        blocks = record.channel_blocks()
        columns = [outputs_from(alone, fit.eta, alone.initial, blocks) for alone in driven]
    changes, times = [GAIN_CHANGE] * len(names), model.times
    # Of channels with delays of their own the states are not at the times of what they record.
    if names and len(times) > 1 and model.sampling is None:
        names.append(DELAY)
        changes.append(float(f"{np.diff(times).min():.12g}"))  # as a scene writes it
        columns.append(-output_rates(model, fit.eta, fit.predicted.states))
    return names, changes, columns


# Frequency responses.


def _of_responses(record: FrfRecord, fit: RecordFit, noise: Array) -> _CalibrationDerivatives:
    frfs, omega, profile = record.channels, record.measurement.omega, record.measurement.profile
    H, measured = fit.predicted.outputs, np.nan_to_num(record.data.recorded)
    forces = np.array([frf.load.gain_name for frf in frfs])
    sensors = np.array([frf.channel.gain_name for frf in frfs])
    scaled = [] if record.system.nonlinear else dict.fromkeys(forces.tolist())
    columns = {name: np.where(forces == name, H, 0.0) for name in scaled}
    columns[DELAY] = stacked(-1j * omega[:, None] * unstacked(H))  # a delay turns the phase
    columns |= {name: np.where(sensors == name, -measured, 0.0) for name in dict.fromkeys(sensors.tolist())}
    changes = [GAIN_CHANGE / (omega[-1] or 1.0) if name == DELAY else GAIN_CHANGE for name in columns]
    size = len(record.system_model.states) / 2
    if (freed := record.system.freed(known_parts=len(omega) * size**3 < _KNOWN_WORK)) is not None:
        parameters = freed.system.unknowns
        places, deviations = _considered(parameters, record)
        slopes = freed.response(omega, freed_coordinates(parameters, record.unknowns, fit.eta)).slopes
        columns |= {parameters[k].name: stacked(slopes[..., k] / profile) for k in places}
        changes += deviations
    # A step that is known too long: lines lie lower. Another system leaves the condensed lines of this one.
    assert record.system.model is not None
    other = type(record.system).of(record.system.model, record.system.functions)
    later = other.response(omega * (1 + _CLOCK_STEP), fit.eta, slopes=False).values / profile
    columns[CLOCK] = (H - stacked(later)) / _CLOCK_STEP
    changes.append(CLOCK_CHANGE)
    influential = record.influential(fit)
    weighted = np.stack(list(columns.values()), axis=2) * weights(noise, influential)[..., None]
    by_parameter = record.slopes(replace(fit, residual=influential), noise)
    by_quantity = weighted.reshape(-1, len(columns))
    return _CalibrationDerivatives(tuple(columns), np.array(changes), by_parameter, by_quantity)


# Modal surveys.


def _of_modes(record: ModalRecord, fit: RecordFit, noise: Array) -> _CalibrationDerivatives:
    """Return the derivatives by what is considered and known, and by the clock; shapes have a free scale."""
    survey = record.measurement
    freed = freed_model(record.model, [Channel(dof, "displacement") for dof in survey.dofs])
    assert isinstance(freed, StructuralModel)
    places, changes = _considered(freed.unknowns, record)
    eta = freed_coordinates(freed.unknowns, record.unknowns, fit.eta)
    freed_record = replace(record, model=freed)
    slopes = freed_record.slopes(freed_record.fit(eta, record.data.values), noise)
    # A step that is known too long: frequencies seem lower.
    late = np.zeros_like(fit.residual)
    if record.root is None:
        late[: survey.modes, 0] = survey.omega / record.spread[0]
    else:
        columns = [np.zeros(len(column)) for column in record.measured_columns]
        columns[0] = survey.omega
        for k, column in enumerate(record.standardised(columns)):
            late[: len(column), k] = column
    late = np.where(np.isnan(fit.residual), 0.0, late / noise)
    return _CalibrationDerivatives(
        (*(freed.unknowns[k].name for k in places), CLOCK),
        np.array([*changes, CLOCK_CHANGE]),
        record.slopes(fit, noise),
        np.column_stack([slopes[:, places], late.ravel()]),
    )


def add_calibration_slopes(result: Result, slopes: CalibrationSlopes, relative: Array) -> None:
    """Add ``considered/``: the slopes of the estimates by the calibration and considered parameters.

    `result`: the result; `slopes`: the slopes of the coordinates. `relative`: derivatives of the logarithms
    of the estimates by their coordinates (p): 1 of logarithms.
    """
    dims = ("parameter", "quantity")
    result.add_axis(f"{GROUP}/parameter", list(slopes.parameters))
    result.add_axis(f"{GROUP}/quantity", list(slopes.quantities))
    units = ["s" if name == DELAY else "" for name in slopes.quantities]
    result.add(f"{GROUP}/unit", units, ("quantity",))
    result.add(f"{GROUP}/change", slopes.changes, ("quantity",))
    result.add(f"{GROUP}/visibility", slopes.visibility, ("quantity",))
    units_of_change = (
        "relative change of a gain, mass, stiffness, considered parameter or clock; second of delay"
    )
    result.add(f"{GROUP}/slope", slopes.slopes * relative[:, None], dims, per=units_of_change)
