"""Measured modes beside those of the model, before and after: ``identification/modes/``.

- `frequency_measured`, `frequency_start`, `frequency` (in the unit of the measured ones), their relative
  errors `frequency_error_start`, `frequency_error`, and `frequency_std` (scatter with its floor); `damping…`
  alike.
- `amplitude`: of the first harmonic of the motion at which each was measured, of backbones.
- `mac_start`, `mac`: modal assurance criterion of each pair; `mac_table_start`, `mac_table` of all pairs of
  measured and computed modes; `comac_start`, `comac`: that of each sensor over all modes.
- `model_mode_start`, `model_mode`: the modes of the model that the measured ones are paired with, from 1.
- `shape_measured`, `shape_start`, `shape`: shapes at the sensors, the largest measured component of
  magnitude 1; of complex ones `complexity_measured`, the part of each that no phase makes real.
- `expanded_start`, `expanded`: measured shapes at all DOFs, in the span of the modes they are paired with
  (SEREP), of as many of the nearest ones as there are sensors; NaN of a mode whose shape was not measured.
- `chi2`, `chi2_degrees`: sum of squares of the residuals over their deviations, priors included, and its
  degrees of freedom.
- `frequency_leverage`: part of an error of each frequency that the parameters follow, so that it does not
  show; `frequency_studentised`: residual of each frequency over its own deviation, NaN where that is none.
- `model_error`: errors of the model's form that the scene states, relative, of each quantity, with
  `scatter_floor`; `model_error_needed`: those that the residuals would need, where the fit is rejected.
- `left_out_error`, `left_out_deviation`, `left_out_by_scatter`: each frequency predicted with it left out,
  over the measured one less 1, and its bars, with the stated error of the form and by scatter alone; of modes
  alone, NaN where the rest does not determine the parameters. By a linear step from the estimate; the fit is
  repeated for the most doubtful ones, five at most.
- `trade_off/<frequencies|shapes>/{frequency_error, mac}`: the fits to frequencies alone and to shapes alone
  (damping ratios, where measured, count in both), for their scatter, where the form is in error: stated, or
  needed.
- `directions/`: combinations of parameters by how much better the data know them than the priors (`strength`,
  singular values of the derivatives times the priors' deviations), where all parameters have priors.
- `statements`: what follows from these, in words.

Where the form of a model is in error, better frequencies may cost agreement of shapes. The error bars of such
a fit say nothing of it, but a diagnosis does: each frequency predicted with it left out, beside its bar, and
the fits to frequencies alone and to shapes alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import DynidError
from dynid.identification.diagnosis.form_error import FormError
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.information import Information
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.modal_record import ModalFit, ModalRecord
from dynid.identification.likelihood.record_likelihood import ScatterTest
from dynid.identification.records.modal_measurement import ModalMeasurement
from dynid.identification.systems.parametric_model import Rebuild
from dynid.parameters import named, rates, starts
from dynid.progress import report_progress
from dynid.result import Result
from dynid.structure.correlation import comac, complexity
from dynid.structure.model import StructuralModel
from dynid.units import angular_factor

# What a fit to a part of the data may raise: the rest may not determine the parameters.
_FAILURES = (DynidError, ArithmeticError, np.linalg.LinAlgError)
# Most steps with a frequency left out, and to an end of the trade-off.
_MAX_TRADE_OFF_STEPS = 25
# Standard errors, of a prediction by a linear step and of the parameters, beyond which it is doubtful.
_DOUBTFUL = 2.0
# Most frequencies for which the fit is repeated: each costs as much as a fit.
_MOST_REFITS = 5
# An error that takes the weight from a quantity.
_NO_WEIGHT = 1e3
#: Prediction errors beyond so many bars contradict these: one in 16,000 by chance.
CONTRADICTED = 4.0
# Part of a direction below which a parameter is not named in it.
_MIN_DIRECTION_SHARE = 0.3
#: Leverage above which an error of 6 standard errors shows in three of four surveys at the most, tested at
#: 5 %: as 6 sqrt(1 - 0.8) = 2.7 deviations.
ABSORBED = 0.8
#: A direction is determined by the data where they know it better than the prior.
DETERMINED = 1.0


class _LeftOut(NamedTuple):
    """Frequencies predicted with them left out, over the measured ones less 1."""

    # Relative errors of the predictions (r); NaN where the other data do not determine the parameters.
    error: Array
    deviation: Array  # their standard deviations by parameters, scatter and error of the form (r)
    by_scatter: Array  # the same by scatter alone (r)
    refitted: NDArray[np.bool_]  # mask of predictions by a fit to the other data (r)

    @property
    def contradicted(self) -> NDArray[np.bool_]:
        """Mask of modes whose errors, after a fit to the other data, exceed four deviations (r)."""
        return np.asarray(self.refitted & (np.abs(self.error) > CONTRADICTED * self.deviation))


def left_out(record: ModalRecord, eta: Array) -> _LeftOut:
    """Predict each frequency with it left out, from the estimate `eta` (p); shapes stay.

    By one Gauss–Newton step, which needs no further modes. Where that is doubtful, as the error of the
    prediction or the change of a parameter exceeds two standard errors, by a fit to the other data: for five
    frequencies at most, the most doubtful ones.
    """
    surveys = record, record.with_error(np.zeros(len(record.error)))
    fits = [survey.fit(eta, survey.data.values) for survey in surveys]
    bounds = _information(Likelihood((record,)), Fit(eta, (fits[0],))).bounds()
    predicted = np.full((3, record.measurement.modes), np.nan)
    doubt, refitted = np.zeros(predicted.shape[1]), np.zeros(predicted.shape[1], dtype=bool)
    for k in range(len(doubt)):
        rest = [survey.with_error(survey.error, (k,)) for survey in surveys]
        ends = [survey.fit_of(eta, fit.modes) for survey, fit in zip(rest, fits, strict=True)]
        try:
            step = _step(rest[0], ends[0])
            predicted[:, k] = _predicted(rest, ends, k, step)
        except _FAILURES:
            continue
        doubt[k] = max(abs(predicted[0, k]) / predicted[1, k], float(np.max(np.abs(step) / bounds)))
    for k in np.argsort(-doubt, kind="stable")[:_MOST_REFITS].tolist():
        if doubt[k] <= _DOUBTFUL:
            break
        report_progress(f"fit without frequency {k + 1}")
        rest = [survey.with_error(survey.error, (k,)) for survey in surveys]
        predicted[:, k], refitted[k] = np.nan, True
        try:
            end = refine(Likelihood((rest[0],)), eta, _MAX_TRADE_OFF_STEPS).fit.eta
            ends = [survey.fit(end, survey.data.values) for survey in rest]
            predicted[:, k] = _predicted(rest, ends, k, np.zeros(len(eta)))
        except _FAILURES:
            continue
    error, deviation, by_scatter = predicted
    return _LeftOut(error, deviation, by_scatter, refitted)


def _step(record: ModalRecord, fit: ModalFit) -> Array:
    """Return the Gauss–Newton step within the limits (p), if the data determine the parameters."""
    likelihood, both = Likelihood((record,)), Fit(fit.eta, (fit,))
    information = _information(likelihood, both)
    information.check()
    step = information.step(likelihood.weighted(both, likelihood.likeliest(both)))
    return likelihood.priors.constrained(fit.eta + step, information.root) - fit.eta


def _predicted(surveys: Sequence[ModalRecord], fits: Sequence[ModalFit], k: int, step: Array) -> list[float]:
    """Return a frequency after a step of the coordinates (p), over the measured one less 1, and its bars."""
    fit, measured = fits[0], surveys[0].measurement.omega[k]
    slope = fit.modes.slopes[0][k] * rates(surveys[0].unknowns, fit.eta) / measured
    bars = []
    for survey, end in zip(surveys, fits, strict=True):
        root = _information(Likelihood((survey,)), Fit(fit.eta, (end,))).root
        bars.append(float(np.hypot(np.linalg.norm(slope @ root), survey.spread[0][k] / measured)))
    return [float(fit.omega[k] / measured - 1 + slope @ step), *bars]


def _information(likelihood: Likelihood, fit: Fit) -> Information:
    return likelihood.information(fit, likelihood.likeliest(fit))


class End(NamedTuple):
    """An end of the trade-off: frequencies over the measured ones less 1 (r), and MAC (r)."""

    error: Array
    mac: Array


def trade_off(record: ModalRecord, eta: Array, rebuild: Rebuild | None) -> dict[str, End]:
    """Return the fits to `frequencies` alone and to `shapes` alone, as far as these determine the parameters.

    Priors count in both, and so do damping ratios where they are measured.
    """
    ends, channels = {}, [channel.name for channel in record.channels]
    for name, ignored in (("frequencies", "shape"), ("shapes", "frequency")):
        report_progress(f"fit to {name} alone")
        error = np.where([channel == ignored for channel in channels], _NO_WEIGHT, 0.0)
        survey, end = record.with_error(error), eta
        try:
            for _ in range(1 if rebuild is None else 2):
                end = refine(Likelihood((survey,)), end, _MAX_TRADE_OFF_STEPS).fit.eta
                if rebuild is not None:
                    survey = replace(survey, model=rebuild(named(survey.unknowns, end)))
            fit = survey.fit(end, survey.data.values)
        except _FAILURES:
            continue
        ends[name] = End(fit.omega / survey.measurement.omega - 1, fit.modes.pair_mac)
    return ends


@dataclass(frozen=True)
class Direction:
    """A combination of parameters, and how much better the data know it than the priors."""

    strength: float  # deviation by the prior over that by the data
    weights: Array  # its components in units of the priors' deviations (p)

    def label(self, names: Sequence[str]) -> str:
        """Return the parameters that take part in it, the most important first, as ratios or products."""
        order = np.argsort(-np.abs(self.weights), kind="stable")
        largest = np.abs(self.weights).max()
        parts = [k for k in order.tolist() if abs(self.weights[k]) > _MIN_DIRECTION_SHARE * largest]
        sign = np.sign(self.weights[parts[0]])
        return " ".join(f"{'' if self.weights[k] * sign > 0 else '-'}{names[k]}" for k in parts)


def directions(information: Information, prior: Array) -> list[Direction]:
    """Return combinations of parameters by how well the data determine them: singular vectors of J · prior.

    `information`: of the data alone; `prior`: deviations of the priors of the coordinates (p).
    """
    _, s, Vt = np.linalg.svd(information.projected * prior, full_matrices=False)
    return [Direction(float(size), row) for size, row in zip(s, Vt, strict=True)]


GROUP = "identification/modes"
# The most numbers of expanded shapes.
_MOST_EXPANDED = 2_000_000


def add_modes(
    result: Result,
    posterior: Posterior,
    full: StructuralModel,
    at_start: ModalRecord,
    rebuild: Rebuild | None = None,
    needed: FormError | None = None,
) -> Result:
    """Add measured and computed modes, and return the result.

    `full`: the structure, not reduced; `at_start`: the measured modes with the model at the starts;
    `needed`: errors of the form that the residuals would need, where the fit is rejected.
    """
    if not result.wants_below(GROUP):
        return result
    k, record = next(
        (k, record)
        for k, record in enumerate(posterior.likelihood.records)
        if isinstance(record, ModalRecord)
    )
    after = posterior.fit.parts[k]
    before = at_start.fit(starts(record.unknowns), at_start.data.values)
    assert isinstance(after, ModalFit)
    measured, r = record.measurement, record.measurement.modes
    factor = 1 / angular_factor(measured.unit)
    quantities = [channel.name for channel in record.channels]
    result.add_axes(GROUP, mode=np.arange(1, r + 1), quantity=quantities)
    dims, frequency = ("mode",), factor * measured.omega
    if (of := measured.backbone) is not None:
        result.add(f"{GROUP}/amplitude", of.amplitude, dims, of.channel.unit)
        result.annotate(GROUP, amplitude_of=of.channel.name)
    scatter = measured.deviations()[0] * frequency
    result.add_all(GROUP, dims, measured.unit, frequency_measured=frequency, frequency_std=scatter)
    for suffix, fit in (("_start", before), ("", after)):
        result.add(f"{GROUP}/frequency{suffix}", factor * fit.omega, dims, measured.unit)
        result.add(f"{GROUP}/frequency_error{suffix}", fit.omega / measured.omega - 1, dims)
        result.add(f"{GROUP}/model_mode{suffix}", fit.modes.pairs + 1, dims)
        if measured.has_damping:
            result.add(f"{GROUP}/damping{suffix}", fit.modes.damping, dims)
    if measured.has_damping:
        assert measured.damping is not None
        deviation = record.scatter_and_size[1][0]
        result.add_all(GROUP, dims, damping_measured=measured.damping, damping_std=deviation)
    if len(measured.dofs):
        _add_shapes(result, record, before, after)
    if len(measured.dofs) and full.size * r <= _MOST_EXPANDED and result.wants(f"{GROUP}/expanded"):
        result.add_axis(f"{GROUP}/dof", [str(dof) for dof in full.dofs])
        for suffix, candidate, fit in (("_start", at_start, before), ("", record, after)):
            shapes = _expanded(candidate, fit)
            if len(shapes) == full.size:
                result.add(f"{GROUP}/expanded{suffix}", shapes, ("dof", "mode"))
    squares, degrees = posterior.comparison.chi_squared
    result.add_all(GROUP, chi2=squares, chi2_degrees=degrees)
    floors = [getattr(measured.floors, name) for name in quantities]
    result.add_all(GROUP, ("quantity",), model_error=record.error, scatter_floor=floors)
    if needed is not None:
        result.add(f"{GROUP}/model_error_needed", needed.error, ("quantity",))
    said = _add_leverage(result, posterior.comparison.tables[0], measured)
    if len(posterior.likelihood.records) == 1:
        in_error = needed is not None or bool(record.error.any())
        said += _add_diagnosis(result, posterior, record, rebuild, in_error=in_error)
    said += _raised(measured)
    said += _add_directions(result, posterior)
    result.add_axis(f"{GROUP}/statements", np.array(said, dtype=object))
    return result


def _raised(measured: ModalMeasurement) -> list[str]:
    """Return which stated scatter counts as its floor."""
    floors = [f"{100 * getattr(measured.floors, name):g} % of {name}" for name in measured.raised]
    if not floors:
        return []
    listed = " and ".join(floors)
    return [f"a stated scatter below its floor, {listed}, counts as the floor (measurement.modes.floor)"]


def _add_leverage(result: Result, table: ScatterTest, measured: ModalMeasurement) -> list[str]:
    """Add how much of an error of each frequency the parameters absorb; return where it would not show."""
    leverage, studentised = table.leverage[: measured.modes, 0], table.studentised[: measured.modes, 0]
    result.add_all(GROUP, ("mode",), frequency_leverage=leverage, frequency_studentised=studentised)
    absorbed = np.flatnonzero(leverage > ABSORBED)
    if not len(absorbed):
        return []
    more = "modes or sensors" if measured.backbone is None else "amplitudes"
    listed = ", ".join(f"{k + 1} ({100 * leverage[k]:.3g} %)" for k in absorbed)
    return [
        "an error of a measured frequency would move the estimates rather than show in the residuals, since "
        f"the parameters follow it (leverage), of {measured.noun} {listed}: measure more {more}, or give "
        "priors, where such errors are to be detected"
    ]


def _expanded(record: ModalRecord, fit: ModalFit) -> NDArray[Any]:
    """Return measured shapes at all DOFs (n x r) in the span of modes that they are paired with (SEREP)."""
    # J. O'Callahan, P. Avitabile, R. Riemer, *Proc. IMAC VII* 1989, 29–37.
    solution = record.solution(named(record.unknowns, fit.eta))
    shapes_at_all_dofs = record.model.expand(solution.shapes[:, fit.modes.pairs])
    at_sensors, target = record.rows @ solution.shapes[:, fit.modes.pairs], record.measurement.shapes
    expanded = np.full(shapes_at_all_dofs.shape, np.nan, dtype=np.result_type(shapes_at_all_dofs, target))
    for k in range(target.shape[1]):
        there = ~np.isnan(target[:, k])
        if there.any():
            near = np.argsort(np.abs(fit.omega - fit.omega[k]), kind="stable")[: np.count_nonzero(there)]
            parts = np.linalg.lstsq(at_sensors[np.ix_(there, near)], target[there, k], rcond=None)[0]
            expanded[:, k] = shapes_at_all_dofs[:, near] @ parts
    return expanded


def _add_diagnosis(
    result: Result, posterior: Posterior, record: ModalRecord, rebuild: Rebuild | None, *, in_error: bool
) -> list[str]:
    """Add the frequencies left out and the ends of the trade-off; return what they say."""
    group, eta, said = GROUP, posterior.fit.eta, []
    if record.error.any():
        statements = [
            f"{100 * e:.2g} % of {channel.name}"
            for channel, e in zip(record.channels, record.error, strict=True)
        ]
        said.append(
            f"stated errors of the model's form, in fit, intervals and verdict: {', '.join(statements)}"
        )
    if result.wants_below(f"{group}/left_out_error") and record.measurement.modes > 1:
        predictions = left_out(record, eta)
        for name in ("error", "deviation", "by_scatter"):
            result.add(f"{group}/left_out_{name}", getattr(predictions, name), ("mode",))
        worst = np.flatnonzero(predictions.contradicted)
        if len(worst):
            bars = predictions.deviation
            shown = ", ".join(
                f"{record.measurement.noun} {k + 1} {100 * predictions.error[k]:+.2g} % (bar "
                f"{100 * bars[k]:.2g} %)"
                for k in worst
            )
            said.insert(
                0,
                "the form of the model contradicts the data: frequencies predicted with them left out are "
                f"off by more than {CONTRADICTED:.0f} standard errors: {shown}",
            )
    if in_error and len(record.measurement.dofs) and result.wants_below(f"{group}/trade_off"):
        also = " and damping ratios" if record.measurement.has_damping else ""
        for name, end in trade_off(record, eta, rebuild).items():
            end_group = f"{group}/trade_off/{name}"
            result.add_axis(f"{end_group}/mode", np.arange(1, len(end.error) + 1))
            result.add_all(end_group, ("mode",), frequency_error=end.error, mac=end.mac)
            rms = 100 * float(np.sqrt(np.mean(end.error**2)))
            said.append(
                f"fitted to {name}{also} alone: RMS error of frequencies {rms:.2g} %, mean MAC "
                f"{float(np.nanmean(end.mac)):.3f}"
            )
    return said


def _add_directions(result: Result, posterior: Posterior) -> list[str]:
    """Add the combinations of parameters that the data determine, where all have priors; say which."""
    # Two limits are a prior, of the deviation of a uniform distribution.
    priors, names = posterior.likelihood.priors, posterior.likelihood.names
    directions_group = f"{GROUP}/directions"
    if np.isnan(priors.spreads).any() or not result.wants_below(directions_group):
        return []
    information = posterior.likelihood.information(posterior.fit, posterior.noise, prior=False)
    combinations = directions(information, priors.spreads)
    labels = [combination.label(names) for combination in combinations]
    result.add_axes(directions_group, direction=np.arange(1, len(combinations) + 1), parameter=names)
    strengths, weights = zip(
        *((direction.strength, direction.weights) for direction in combinations), strict=True
    )
    result.add_all(directions_group, ("direction",), strength=strengths, label=np.array(labels, dtype=object))
    result.add(f"{directions_group}/weights", weights, ("direction", "parameter"))
    determined = [label for label, strength in zip(labels, strengths, strict=True) if strength > DETERMINED]
    than = "priors" if priors.has_prior.all() else "priors and limits" if priors.has_prior.any() else "limits"
    said = [
        f"the data determine {len(determined)} of {len(names)} combinations better than the {than}: "
        + "; ".join(determined)
    ]
    if blind := [name for name, by in zip(names, posterior.decided_by, strict=True) if by == "prior"]:
        said.append(f"known by their priors alone: {', '.join(blind)}")
    return said


def _add_shapes(result: Result, record: ModalRecord, before: ModalFit, after: ModalFit) -> None:
    """Add shapes at the sensors and their correlation."""
    measured = record.measurement
    count = max(before.modes.mac.shape[1], after.modes.mac.shape[1])
    sensors = [str(dof) for dof in measured.dofs]
    result.add_axes(GROUP, sensor=sensors, computed=np.arange(1, count + 1))
    result.add(f"{GROUP}/shape_measured", measured.shapes, ("sensor", "mode"))
    if measured.complex_shapes:
        result.add(f"{GROUP}/complexity_measured", complexity(measured.shapes), ("mode",))
    for suffix, fit in (("_start", before), ("", after)):
        table = np.full((measured.modes, count), np.nan)
        table[:, : fit.modes.mac.shape[1]] = fit.modes.mac
        result.add(f"{GROUP}/mac{suffix}", fit.modes.pair_mac, ("mode",))
        result.add(f"{GROUP}/mac_table{suffix}", table, ("mode", "computed"))
        result.add(f"{GROUP}/shape{suffix}", fit.modes.shapes, ("sensor", "mode"))
        result.add(f"{GROUP}/comac{suffix}", comac(measured.shapes, fit.modes.shapes), ("sensor",))
