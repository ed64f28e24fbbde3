"""Result of an identification: the posterior of the parameters and its records as named arrays.

Everything is below ``identification/``:

- `parameters`: `estimate` with `standard_error`, `cramer_rao` and `correlation`, in which priors count as
  measurements do; `standard_error_scaled` (for the observed noise instead of the given one);
  `cramer_rao_without_prior` (of the records alone, infinite where a parameter is not identifiable);
  `low` and `high`, the 95 % interval, which like the standard error is that of the posterior within limits;
  `decided_by`: ``data``, the ``prior`` or the ``limits`` of a parameter alone, or ``nothing``; `at_bound`;
  `start`, `true` and the unsigned `error_percent`, NaN where no true value is known. The attribute
  `error_bars` states where error bars are nominal. `identifiable`: False of parameters that the records do
  not determine. These are fixed at their starts, where the records admit that, and have an infinite
  `standard_error`; the errors of the others are conditional.
- `considered`: slopes of the estimates by the calibration of the instruments; see `calibration`.
- `stages`: the attempts of the estimator.
- `measurement`: `measured` (NaN where a sample is missing) and `predicted`, the noise-free response at the
  estimate from the best initial state, with the excitation.
- `history`, `first_pass`: the last pass over a record, and the first one where there are several.
- `states`: physical states at the estimate with bands given the whole record; the true ones of a simulated
  record.
- `innovations`: those of the filter's last pass, normalised (NaN where a sample is missing).
- `residual_spectrum`: spectra of the residuals.
- `noise`, where the noise is not white: its model; see `noise_result`.
- `robust`, with Huber's loss: the robust deviation of each channel's residuals and the part that is bounded;
  the diagnostics are those of the bounded residuals.
- `model_error`, of a reduced model: the error of the estimates by the reduction.
- `posterior`: check of the Gaussian posterior by importance sampling; see `importance`.
- `derived`: poles, zeros, modes, gains and frequency responses with 95 % bands; see `write_derived`.
- `equivalent_optima`, where several explain the records equally well: `estimate` of each (the first is that
  of `parameters`), with `log_likelihood` and `log_posterior` less those of the first; `undecided` where
  neither priors nor limits exclude it.
- `laws`, where candidates are requested: their `log_likelihood`, `bic` and `p`; see
  `dynid.identification.diagnosis.law_comparison`.
- `diagnostics`, with a `verdict` and `warnings` in words:

  - `optimum`, also called `settled`: `distance_to_optimum`, the Gauss–Newton step left in standard errors, is
    below a half, and starts do not disagree although the residuals are not noise. `starts` were tried, of
    which `starts_agreed` ended at this optimum.
  - `explained`: there is a response (`signal_p`), and the residuals are noise (`lack_of_fit_p`), or the model
    explains at least 95 % of the signal (`signal_explained`); see `lack_of_fit`.
  - `lacks_fit`: `lack_of_fit_p` is small: the residuals contradict the model, also where it is `explained`;
    the standard errors are nominal.
  - `equivalent_optima`: number of optima with equal likelihood, to 5 in its logarithm; 1 where there is one.
  - `converged`: `optimum` and `explained`, a `redundancy` above 0 (the record could contradict the model),
    and no other of the equivalent optima that priors and limits leave.
  - `log_likelihood` at the estimate, `bic`, and the numbers of `observations` and `free_parameters` (unknown
    parameters, resolved initial states, estimated deviations of the noise) that belong to it.
  - `prior_conflict`: distance of priors and records in deviations of that distance, 0 without a prior.
  - `noise_p`: p-value of the residuals against the given noise (two-sided chi-squared), NaN without one;
    `channel_noise_p` and `noise_ratio` (observed over given) by channel.
  - `residual_<mean|kurtosis|largest>` with their p-values and the number of `outliers`: shape of residuals
    that are more than round-off; coloured ones are whitened first.
  - `autocorrelation` by `lag`, with its `autocorrelation_band`, and `channel_whiteness_p`: NaN of measured
    modes, which have no order; left out where there is nothing else.

Frequency responses have `parameters`, `considered`, `stages`, `measurement` and `diagnostics`, and
`model_error`; their `measurement` has complex values (omega x channel), their agreement with the model
before and after (`frac_start`, `frac`), and the `noise`, `given_noise` or
`deviation` of these. Their residuals are white where neither real nor imaginary parts are correlated from
line to line.

Variables whose unit differs along an axis have the units beside them, as `unit`. Of several records, groups
with a time axis hold a group each, ``record_1``, …, and channels are called ``record_1.<channel>``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from dynid.arrays import Array
from dynid.defaults import HUBER
from dynid.errors import DynidError
from dynid.identification.diagnosis.calibration import GROUP as CONSIDERED
from dynid.identification.diagnosis.calibration import add_calibration_slopes
from dynid.identification.diagnosis.importance import DRAWS, likelihood_size, posterior_check
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.diagnosis.verdict import CONTRADICTED, nonlinear_step, verdict, warnings
from dynid.identification.estimators.filter import Pass
from dynid.identification.likelihood.frf_record import FrfRecord
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.likelihood.state_deviations import state_deviations, stored_rows
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.residual_tests import autocorrelation, consistency, is_coloured, spectrum
from dynid.identification.results.write_derived import DERIVED, DerivedRequest, add_derived, add_noise
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.parameters import rates, starts, values
from dynid.result import REJECTED, Result, common_unit
from dynid.structure.correlation import frac
from dynid.structure.excitation import inputs_of
from dynid.structure.ports import source_names

_PARAMETERS, _STAGES = "identification/parameters", "identification/stages"
_DIAGNOSTICS, _NONLINEARITY = "identification/diagnostics", "identification/nonlinearity"
#: Groups that have the samples of a record for an axis.
_SAMPLED = tuple(
    f"identification/{group}"
    for group in ("history", "first_pass", "measurement", "states", "residual_spectrum", "innovations")
)
#: Names of the tests of residuals.
_TESTS = (
    *("noise_p", "noise_contradicted", "channel_noise_p", "noise_ratio", "outliers"),
    *(f"residual_{name}" for name in ("mean", "mean_p", "kurtosis", "kurtosis_p", "largest", "largest_p")),
)
#: Names that belong to the autocorrelation of the residuals.
_AUTOCORRELATION = ("lag", "autocorrelation", "autocorrelation_band", "channel_whiteness_p")
#: Names that need the comparison of three models of the records.
_COMPARED = (
    *("converged", "explained", "redundancy", "signal_p", "signal_explained"),
    *("lack_of_fit_p", "lacks_fit", "channel_lack_of_fit_p"),
)


@dataclass(frozen=True, eq=False)
class Further:
    """Results beside the estimates and their tests."""

    derived: DerivedRequest | None = None  # the requested derived quantities; absent: those of small systems
    check: bool = False  # True to check the Gaussian posterior by importance sampling
    laws: tuple[str, ...] = ()  # candidates for the laws of joints, which are compared


def add_identification(
    result: Result,
    posterior: Posterior,
    true_states: Callable[[], Sequence[Array | None]] | None = None,
    further: Further | None = None,
) -> Result:
    """Add to a result those arrays of a posterior that are wanted there, and return it.

    `true_states` returns for each record of time the states (times x n) that it was simulated with, where
    known; `further`: what is computed beside the estimates, by default derived quantities of small systems.
    """
    further = further or Further()
    unit, names = _unit_of(posterior), posterior.likelihood.names
    _add_parameters(result, posterior)
    if result.wants_below(CONSIDERED):
        size = np.abs(posterior.values)
        relative = posterior.rates / np.where(size > 0, size, 1.0)
        add_calibration_slopes(result, posterior.calibration_slopes, relative)
    if any(map(result.wants_below, _SAMPLED)):
        _add_records(result, posterior, true_states)
    result.annotate("identification", estimator=posterior.method)
    _add_stages(result, posterior)
    stages = posterior.estimate.stages
    result.add_axis(f"{_STAGES}/parameter", names)
    estimates = values(posterior.likelihood.unknowns, np.array([stage.eta for stage in stages]))
    result.add(f"{_STAGES}/estimate", estimates, ("stage", "parameter"), unit)
    if any(record.modelled for record in posterior.likelihood.records if not record.modal):
        add_noise(result, posterior)
    check = posterior_check(posterior) if further.check else None
    if check is not None:
        group = "identification/posterior"
        result.add_axis(f"{group}/parameter", names)
        result.add_all(group, k_hat=check.k_hat, effective_samples=check.effective, gaussian=check.gaussian)
        result.add_all(group, k_hat_used=check.k_used, effective_samples_used=check.effective_used)
        result.add_all(group, ("parameter",), unit, mean=check.mean, low=check.low, high=check.high)
        if check.log_evidence is not None:
            result.add(f"{group}/log_evidence", check.log_evidence)
        result.annotate(group, samples=DRAWS, confidence=0.95)
        if check.no_evidence:
            result.annotate(group, no_evidence=check.no_evidence)
    if (optima := posterior.optima) is not None and len(optima) > 1:
        group = "identification/equivalent_optima"
        result.add_axes(group, optimum=np.arange(1, len(optima) + 1), parameter=names)
        estimates = values(posterior.likelihood.unknowns, optima.eta)
        estimates[0] = posterior.values
        result.add(f"{group}/estimate", estimates, ("optimum", "parameter"), unit)
        for name in ("log_likelihood", "log_posterior", "undecided"):
            result.add(f"{group}/{name}", getattr(optima, name), ("optimum",))
    _add_diagnostics(result, posterior, [] if check is None else check.warnings)
    if result.wants_below(_NONLINEARITY):
        _add_nonlinearity(result, posterior)
    if posterior.model_error is not None:
        posterior.model_error.add_to(result, [channel.name for channel in posterior.channels])
    if result.wants_below(DERIVED):
        add_derived(result, posterior, further.derived)
    return result


def _add_stages(result: Result, posterior: Posterior) -> None:
    """Add ``stages/``: the attempts of the estimator, but for their estimates."""
    stages = posterior.estimate.stages
    result.add_axis(f"{_STAGES}/stage", [stage.name for stage in stages])
    ratios, iterations = [np.max(stage.residual_ratio) for stage in stages], [s.iterations for s in stages]
    result.add_all(_STAGES, ("stage",), residual_ratio=ratios, iterations=iterations)
    result.add(f"{_STAGES}/chosen", [stage.eta is posterior.fit.eta for stage in stages].index(True) + 1)


def _add_parameters(result: Result, posterior: Posterior) -> None:
    """Add ``parameters/``: estimates with error bars, bounds and correlations."""
    group, dims = _PARAMETERS, ("parameter",)
    names, priors = posterior.likelihood.names, posterior.likelihood.priors
    unit, identifiable = _unit_of(posterior), posterior.identifiable
    rate, (low, high) = np.where(identifiable, posterior.rates, np.inf), posterior.intervals
    _add_estimates(result, posterior, group)
    result.add_all(group, dims, unit, standard_error=rate * posterior.deviations, low=low, high=high)
    result.add_all(group, dims, identifiable=identifiable, decided_by=posterior.decided_by)
    if result.wants(f"{group}/standard_error_scaled") and posterior.noise_is_given:
        result.add(f"{group}/standard_error_scaled", rate * posterior.scaled_deviations, dims, unit)
    wanted = result.wants(f"{group}/standard_error_total")
    if wanted and (total := posterior.considered_deviations) is not None:
        result.add(f"{group}/standard_error_total", rate * total, dims, unit)
    if result.wants(f"{group}/cramer_rao"):
        bound = np.where(identifiable, posterior.bound, np.inf)
        result.add(f"{group}/cramer_rao", bound, dims, unit)
    if (priors.has_prior & ~priors.fixed).any():
        result.add(f"{group}/cramer_rao_without_prior", posterior.bound_with(prior=False), dims, unit)
    # An axis of its own: two axes of one name could not be distinguished.
    result.add_axis(f"{group}/other", names)
    result.add(f"{group}/correlation", posterior.information.correlation(), ("parameter", "other"))


def _add_estimates(result: Result, posterior: Posterior, group: str = "identification/rejected") -> None:
    """Add estimates of the parameters, their names, units, scales, starts, true values and errors."""
    dims, unit, unknowns = ("parameter",), _unit_of(posterior), posterior.likelihood.unknowns
    names, true, priors = posterior.likelihood.names, posterior.true, posterior.likelihood.priors
    result.add_axis(f"{group}/parameter", names)
    result.add_all(group, dims, name=names, unit=[unknown.unit for unknown in unknowns])
    if not all(unknown.logarithmic for unknown in unknowns):
        result.add(f"{group}/scale", [unknown.scale for unknown in unknowns], dims)
    first = posterior.starts or [unknown.start for unknown in unknowns]
    result.add_all(group, dims, unit, start=first, true=true, estimate=posterior.values)
    result.add(f"{group}/at_bound", priors.at_bound(posterior.fit.eta) & ~priors.fixed, dims)
    nonzero = np.where(true == 0, np.nan, true)
    result.add(f"{group}/error_percent", 100 * np.abs(posterior.values / nonzero - 1), dims, "%")


def _unit_of(posterior: Posterior) -> str:
    """Return the common unit of the parameters, if there is one."""
    return common_unit(unknown.unit for unknown in posterior.likelihood.unknowns)


# Diagnostics.


def _add_diagnostics(result: Result, posterior: Posterior, more: Sequence[str] = ()) -> None:
    """Add ``diagnostics/``: convergence, comparison of models, tests of the residuals, verdict."""
    group, priors = _DIAGNOSTICS, posterior.likelihood.priors
    optima = 1 if posterior.optima is None else len(posterior.optima)
    result.add_all(group, equivalent_optima=optima, optimum=posterior.optimal, settled=posterior.optimal)
    if any(result.wants(f"{group}/{name}") for name in _COMPARED):
        _add_comparison(result, posterior)
    result.add_axis(f"{group}/parameter", posterior.likelihood.names)
    result.add(f"{group}/distance_to_optimum", posterior.distance_to_optimum, ("parameter",))
    if (priors.has_prior & ~priors.fixed).any():
        conflict = posterior.prior_conflict
        contradicted = conflict > CONTRADICTED
        result.add_all(group, ("parameter",), prior_conflict=conflict, prior_contradicted=contradicted)
    result.add_axis(f"{group}/channel", [channel.name for channel in posterior.channels])
    unit = common_unit(channel.unit for channel in posterior.channels)
    result.add(f"{group}/residual_rms", posterior.residual_rms, ("channel",), unit)
    result.add(f"{group}/residual_ratio", posterior.residual_ratio, ("channel",))
    whiteness_p, condition = posterior.whiteness_p, posterior.information.condition()
    white = not is_coloured(whiteness_p)
    result.add_all(group, whiteness_p=whiteness_p, white=white, condition=condition)
    if any(result.wants(f"{group}/{name}") for name in ("log_likelihood", "bic")):
        size = likelihood_size(posterior.likelihood, posterior.fit)
        result.add_all(group, log_likelihood=size.log_likelihood, bic=size.bic)
        result.add_all(group, observations=size.observations, free_parameters=size.free)
    result.add_all(group, **posterior.estimate.counts, passes=len(posterior.estimate.histories))
    if any(result.wants(f"{group}/{name}") for name in _TESTS):
        _add_residual_tests(result, posterior)
    if any(result.wants(f"{group}/{name}") for name in _AUTOCORRELATION):
        _add_autocorrelation(result, posterior)
    if any(result.wants(f"{group}/{name}") for name in ("verdict", "warnings")):
        result.add(f"{group}/verdict", verdict(posterior))
        result.add_axis(f"{group}/warnings", np.array([*warnings(posterior), *more], dtype=object))


def _add_comparison(result: Result, posterior: Posterior) -> None:
    """Add the comparison of the scene's model with no model and with the saturated one."""
    group, compared = _DIAGNOSTICS, posterior.comparison
    result.add(f"{group}/converged", posterior.converged)
    for name in ("explained", "redundancy", "signal_p", "signal_explained", "lack_of_fit_p", "lacks_fit"):
        result.add(f"{group}/{name}", getattr(compared, name))
    if result.wants(f"{group}/channel_lack_of_fit_p"):
        result.add(f"{group}/channel_lack_of_fit_p", compared.channel_lack_of_fit_p, ("channel",))
    if posterior.rejection is not None:
        return
    flat = posterior.optima is not None and posterior.optima.flat is not None
    remarks = {
        "nominal: the estimate is not converged": not (
            posterior.optimal and compared.explained and compared.redundancy > 0
        ),
        f"conditional on the values of {', '.join(posterior.undetermined)}": posterior.undetermined,
        "of this optimum alone": posterior.ambiguous,
        "by profile likelihood, which falls more slowly than the information predicts": flat,
        "nominal: the residuals are not noise": compared.lacks_fit or is_coloured(posterior.whiteness_p),
    }
    if remark := next((text for text, holds in remarks.items() if holds), ""):
        result.annotate(_PARAMETERS, error_bars=remark)


def _add_nonlinearity(result: Result, posterior: Posterior) -> None:
    """Add ``nonlinearity/``: the score test of the joints, of records of time."""
    if (tested := posterior.nonlinearity) is None:
        return
    from dynid.identification.likelihood.joint_responses import TERMS  # of records of time alone

    group, dims = _NONLINEARITY, ("joint", "term")
    result.add_axes(group, joint=list(tested.joints), term=list(TERMS))
    result.add(f"{group}/p", tested.p, dims)
    result.add(f"{group}/size", tested.size, dims, "%")
    result.add(f"{group}/joint_p", tested.joint_p, ("joint",))
    result.add(f"{group}/nonlinear_p", tested.nonlinear_p)
    result.annotate(group, verdict=tested.verdict, nonlinear=tested.nonlinear)


def _add_residual_tests(result: Result, posterior: Posterior) -> None:
    """Add the tests of residuals to ``diagnostics/``, and ``robust/`` where a robust loss was used."""
    test, dims, group = posterior.noise_test, ("channel",), _DIAGNOSTICS
    unit = common_unit(channel.unit for channel in posterior.channels)
    result.add(f"{group}/noise_p", test.p)
    if not np.isnan(test.p):
        result.add(f"{group}/noise_contradicted", bool(posterior.contradicted_noise))
        result.add_all(group, dims, channel_noise_p=test.channel_p, noise_ratio=test.ratio)
    shapes = [shape for shape in posterior.shapes if shape is not None]
    if len(shapes) == len(posterior.shapes):
        for name in ("mean", "mean_p", "kurtosis", "kurtosis_p", "largest", "largest_p"):
            numbers = [getattr(shape, name) for shape in shapes]
            result.add(f"{group}/residual_{name}", numbers, dims, unit if name == "mean" else "")
        result.add(f"{group}/outliers", [len(shape.outliers) for shape in shapes], dims)
    robust = [loss for record in posterior.likelihood.records if (loss := record.data.robust) is not None]
    if robust:
        group = "identification/robust"
        result.annotate("identification", loss="huber")
        result.annotate(group, loss="huber", tuning=HUBER.value)
        result.add_axis(f"{group}/channel", [channel.name for channel in posterior.channels])
        result.add(f"{group}/scale", np.concatenate([loss.scale for loss in robust]), dims, unit)
        result.add(f"{group}/clipped", np.concatenate([loss.clipped for loss in robust]), dims)


def _add_autocorrelation(result: Result, posterior: Posterior) -> None:
    """Add the autocorrelation of the residuals and their whiteness, channel by channel."""
    group, series = _DIAGNOSTICS, [posterior.series(channel) for channel in posterior.channels]
    correlations = {
        k: autocorrelation(channel_series) for k, channel_series in enumerate(series) if len(channel_series)
    }  # modes have no order
    if not correlations:
        return
    lags = min(len(r) for r, _ in correlations.values())
    result.add_axis(f"{group}/lag", np.arange(1, lags + 1))
    joined, band, white = np.full((lags, len(series)), np.nan), *np.full((2, len(series)), np.nan)
    for k, (r, channel_band) in correlations.items():  # real and imaginary parts are alike: their mean
        joined[:, k], band[k] = r[:lags].mean(axis=1), np.mean(channel_band) / np.sqrt(len(channel_band))
        white[k] = posterior.channel_whiteness_p(posterior.channels[k])
    result.add(f"{group}/autocorrelation", joined, ("lag", "channel"))
    result.add_all(group, ("channel",), autocorrelation_band=band, channel_whiteness_p=white)


# Records.


def _add_records(
    result: Result, posterior: Posterior, true_states: Callable[[], Sequence[Array | None]] | None
) -> None:
    """Add the groups that have samples or lines for an axis, record by record."""
    first = posterior.likelihood.records[0]
    if isinstance(first, FrfRecord):
        _add_responses(result, first, posterior.fit.parts[0])
        return
    records = [record for record in posterior.likelihood.records if isinstance(record, TimeRecord)]
    if not records:
        return
    true = [None] * len(records) if true_states is None else true_states()
    parts = posterior.fit.parts[: len(records)]
    fits = zip(records, parts, posterior.noise[: len(records)], strict=True)
    bands = [
        state_deviations(record, record_fit, noise, posterior.root) for record, record_fit, noise in fits
    ]
    sweeps = posterior.estimate.histories
    if not sweeps:  # an estimator of whole records has the same information at any time
        deviations, passes = posterior.deviations, []
        for record_fit, band in zip(parts, bands, strict=True):
            states = record_fit.predicted.states[stored_rows(len(record_fit.residual))]
            eta, spread = (np.tile(numbers, (len(states), 1)) for numbers in (record_fit.eta, deviations))
            passes.append(Pass(eta, spread, states, band, np.diag(deviations)))
        sweeps = [passes]
    named = {"history": sweeps[-1]} | ({"first_pass": sweeps[0]} if len(sweeps) > 1 else {})
    for name, sweep in named.items():
        for k, (record, history) in enumerate(zip(records, sweep, strict=True)):
            _add_history(result, _group(posterior, k, name), record, history)
    for k, (record, record_fit) in enumerate(zip(records, parts, strict=True)):
        _add_record(result, posterior, k, record, record_fit, bands[k], true[k])
    if not all(record.superposes for record in records):
        from dynid.identification.results.write_joints import add_joints  # of joints with laws alone

        groups = [_group(posterior, k, "joints") for k in range(len(records))]
        laws: Any = records
        add_joints(result, laws, parts, posterior.noise[: len(records)], posterior.root, groups)


def _group(posterior: Posterior, k: int, name: str) -> str:
    """Return the path of a group of record k."""
    return f"identification/{name}/record_{k + 1}" if posterior.several else f"identification/{name}"


def _add_record(
    result: Result,
    posterior: Posterior,
    k: int,
    record: TimeRecord,
    fit: RecordFit,
    band: Array,
    true: Array | None,
) -> None:
    """Add measurement, states and residuals of a record; `band` and `true` of its states (rows x n)."""
    group = partial(_group, posterior, k)
    model, measurement, rows = record.model, record.conditions.measurement, stored_rows(len(fit.residual))
    if true is not None:
        true = true[record.left_out.before :][: len(fit.residual)][rows]
    _add_measurement(result, group("measurement"), record, fit)
    values = [unknown.true for unknown in model.unknowns if unknown.true is not None]
    if len(values) == len(model.unknowns):
        result.add(f"{group('history')}/true", values, ("parameter",), _unit_of(posterior))
    if true is not None:
        result.add(f"{group('history')}/true_state", true, ("time", "component"))
    states, dims = group("states"), ("time", "component")  # measured or not (Yang, Fig. 9)
    _add_stored_times(result, states, record)
    _add_components(result, states, model)
    estimate = fit.predicted.states[rows] * model.scale
    if model.instruments.clocked:  # no sample may be at the last times of the record
        outside = ~record.within_inputs(fit.eta)[rows]
        estimate, band = (np.where(outside[:, None], np.nan, values) for values in (estimate, band))
    result.add_all(states, dims, estimate=estimate, standard_deviation=band * model.scale)
    if true is not None:
        result.add(f"{states}/true", true, dims)
    _add_spectrum(result, group("residual_spectrum"), record, fit)
    if posterior.innovations is not None:
        normalised, innovations = posterior.innovations[k], group("innovations")
        consistent = consistency(normalised)
        result.add_axis(f"{innovations}/time", record.times, "s")
        result.add_axis(f"{innovations}/channel", [channel.name for channel in measurement.channels])
        result.add(f"{innovations}/normalised", normalised, ("time", "channel"))
        for name, number in consistent._asdict().items():
            result.add(f"{innovations}/{name}", number, ("channel",) if np.ndim(number) else ())
        result.add(f"{innovations}/consistent", consistent.consistent)


def _add_spectrum(result: Result, group: str, record: TimeRecord, fit: RecordFit) -> None:
    """Add the roots of the power spectral densities of the residuals."""
    channels = record.conditions.measurement.channels
    omega, amplitude = spectrum(fit.residual, record.sampling_step, record.channel_steps)
    units = [f"{channel.unit}.(s/rad)^0.5" for channel in channels]
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/channel", [channel.name for channel in channels])
    result.add(f"{group}/unit", units, ("channel",))
    result.add(f"{group}/amplitude", amplitude, ("omega", "channel"), common_unit(units))


def _add_fits(result: Result, posterior: Posterior) -> None:
    """Add what was measured and predicted with the residuals and their spectra, record by record."""
    fits = zip(posterior.likelihood.records, posterior.fit.parts, strict=True)
    for k, (record, fit) in enumerate(fits):
        if isinstance(record, FrfRecord):
            _add_responses(result, record, fit)
            group, dims = "identification/measurement", ("omega", "channel")
        elif isinstance(record, TimeRecord):
            group = _group(posterior, k, "measurement")
            _add_measurement(result, group, record, fit)
            _add_spectrum(result, _group(posterior, k, "residual_spectrum"), record, fit)
            dims = ("time", "channel")
        else:
            continue
        unit = common_unit(channel.unit for channel in record.channels)
        residual = result[f"{group}/measured"].data - result[f"{group}/predicted"].data
        result.add(f"{group}/residual", residual, dims, unit)


def raise_rejected(posterior: Posterior, *further: Callable[[Result, Posterior], Any]) -> None:
    """Raise the error of a rejected fit, with its result, which leaves out what cannot be computed.

    It has what was measured and predicted, and the tests that reject it, but no answers: estimates stand in
    ``identification/rejected/``, with their starts, true values and units, and nowhere else. `measurement`
    has the `residual`, too. `further`: what is added besides, as measured modes.
    """
    error = posterior.rejection
    if error is None:
        return
    if posterior.unexplained and (step := nonlinear_step(posterior)):
        error.remedy = f"{step[0].upper()}{step[1:]}."
    result = Result("identification")
    result.attrs["status"] = REJECTED
    result.annotate("identification", estimator=posterior.method, rejected=str(error))
    for add in (_add_estimates, _add_stages, _add_fits, _add_diagnostics, _add_nonlinearity, *further):
        group = Result("identification")
        try:
            add(group, posterior)
        except (DynidError, ArithmeticError, np.linalg.LinAlgError):  # numbers may leave their range
            continue
        result.merge(group)
    error.result = result
    raise error


def _add_history(result: Result, group: str, record: TimeRecord, history: Pass) -> None:
    """Add the histories of parameters and states over a record."""
    model, dims = record.model, ("time", "parameter")
    estimate, rate = values(model.unknowns, history.eta), rates(model.unknowns, history.eta)
    _add_stored_times(result, group, record)
    result.add_axis(f"{group}/parameter", [unknown.name for unknown in model.unknowns])
    unit = common_unit(unknown.unit for unknown in model.unknowns)
    result.add_all(group, dims, unit, estimate=estimate, standard_deviation=rate * history.deviations)
    _add_components(result, group, model)
    # Not an axis named `state`: a variable of two axes cannot have the name of one of them.
    states, bands = history.states * model.scale, history.state_deviations * model.scale
    result.add_all(group, ("time", "component"), state=states, state_standard_deviation=bands)


def _add_components(result: Result, group: str, model: ParametricModel) -> None:
    components = model.system.states
    result.add_axis(f"{group}/component", [component.name for component in components])
    result.add(f"{group}/unit", [component.unit for component in components], ("component",))


def _add_measurement(result: Result, group: str, record: TimeRecord, fit: RecordFit) -> None:
    """Add a record as measured and as predicted, and its excitation."""
    data, (loads, measurement) = record.data, record.conditions
    result.add_axis(f"{group}/time", record.times, "s")
    result.add(f"{group}/samples_left_out", record.left_out.total)
    if record.model.instruments.clocked:
        result.add(f"{group}/channel_time", record.channel_times(fit.eta), ("time", "channel"), "s")
    predicted = fit.predicted.outputs
    if record.model.instruments.clocked:  # of a channel there is none beyond its samples, or the inputs'
        predicted = np.where(record.known, predicted, np.nan)
    unit = _add_values(result, group, record, "time", data.recorded, predicted)
    result.add_axis(f"{group}/excitation", source_names(loads))
    inputs = inputs_of(loads, record.model.times, record.model.inputs())
    units_in = [load.unit for load in loads]
    result.add(f"{group}/input_unit", units_in, ("excitation",))
    result.add(f"{group}/input", inputs, ("time", "excitation"), common_unit(units_in))
    if measurement.prepared:
        # `time` counts from the first sample that is left; on the clock of the record it is at `start`, s.
        result.annotate(group, prepared="; ".join(measurement.prepared), start=measurement.start)
    if measurement.clock:
        result.annotate(group, **{f"clock_{name}": value for name, value in measurement.clock.items()})
    if data.noise is not None:
        result.add(f"{group}/noise", data.noise, ("channel",), unit)
    if not np.isnan(data.given_noise).all():
        result.add(f"{group}/given_noise", data.given_noise, ("channel",), unit)


def _add_values(
    result: Result, group: str, record: RecordLikelihood, axis: str, measured: Any, predicted: Any
) -> str:
    """Add measured and predicted values of the channels, and return their common unit."""
    units = [channel.unit for channel in record.channels]
    result.add_axis(f"{group}/channel", [channel.name for channel in record.channels])
    result.add(f"{group}/unit", units, ("channel",))
    unit = common_unit(units)
    result.add_all(group, (axis, "channel"), unit, measured=measured, predicted=predicted)
    return unit


def _add_stored_times(result: Result, group: str, record: TimeRecord) -> None:
    """Add the times of a history, and annotate it where not every sample is stored."""
    samples = len(record.times)
    rows = stored_rows(samples)
    result.add_axis(f"{group}/time", record.times[rows], "s")
    if rows.step > 1:
        result.annotate(group, samples=samples, stored_every=rows.step)


def _add_responses(result: Result, record: FrfRecord, fit: RecordFit) -> None:
    """Add frequency response functions as measured and as predicted."""
    group, dims, measurement = "identification/measurement", ("omega", "channel"), record.measurement
    result.add_axis(f"{group}/omega", measurement.omega, "rad/s")
    measured, predicted = map(record.responses, (record.data.recorded, fit.predicted.outputs))
    unit = _add_values(result, group, record, "omega", measured, predicted)
    result.add(f"{group}/frac", frac(measured, predicted), ("channel",))
    if result.wants(f"{group}/frac_start"):
        begun = record.responses(record.fit(starts(record.unknowns), record.data.values).predicted.outputs)
        result.add(f"{group}/frac_start", frac(measured, begun), ("channel",))
    if record.data.noise is not None:
        result.add(f"{group}/noise", np.sqrt(2) * record.data.noise, ("channel",), unit)
    if measurement.coherence is not None:
        result.add(f"{group}/coherence", measurement.coherence, dims)
    if measurement.deviation is not None:
        by_line = measurement.profile
        if measurement.proportional:  # the profile is the predicted magnitude
            by_line = by_line * np.sqrt(2) * fit.noise
        result.add(f"{group}/deviation", by_line, dims, unit)
    elif measurement.given_noise is not None:
        result.add(f"{group}/given_noise", measurement.given_noise, ("channel",), unit)
