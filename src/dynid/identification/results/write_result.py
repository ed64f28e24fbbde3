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

import numpy as np

from dynid.arrays import Array
from dynid.defaults import HUBER
from dynid.identification.diagnosis.calibration import GROUP as CONSIDERED
from dynid.identification.diagnosis.calibration import add_calibration_slopes
from dynid.identification.diagnosis.importance import DRAWS, PosteriorCheck, likelihood_size, posterior_check
from dynid.identification.diagnosis.posterior import Posterior
from dynid.identification.diagnosis.verdict import CONTRADICTED, verdict, warnings
from dynid.identification.estimators.filter import Pass
from dynid.identification.likelihood.frf_record import FrfRecord
from dynid.identification.likelihood.record_likelihood import RecordFit
from dynid.identification.likelihood.time_record import TimeRecord, state_deviations, stored_rows
from dynid.identification.residual_tests import (
    autocorrelation,
    consistency,
    is_coloured,
    spectrum,
)
from dynid.identification.results.write_derived import DERIVED, DerivedRequest, add_derived, add_noise
from dynid.identification.systems.parametric_model import ParametricModel
from dynid.parameters import rates, starts, values
from dynid.result import Result
from dynid.structure.correlation import frac
from dynid.structure.excitation import inputs_of
from dynid.structure.response import common_unit, source_names

_PARAMETERS, _STAGES = "identification/parameters", "identification/stages"
_DIAGNOSTICS = "identification/diagnostics"
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
    """Results beside the estimates and their tests.

    Attributes
    ----------
    derived
        The requested derived quantities; absent: those of small systems.
    check
        True to check the Gaussian posterior by importance sampling.
    """

    derived: DerivedRequest | None = None
    check: bool = False


def add_identification(
    result: Result,
    posterior: Posterior,
    true_states: Callable[[], Sequence[Array | None]] | None = None,
    further: Further | None = None,
) -> Result:
    """Add to a result those arrays of a posterior that are wanted there, and return it.

    Parameters
    ----------
    result
        The result to add to.
    posterior
        The posterior.
    true_states
        Returns for each record of time the states (times x n) that it was simulated with, where known.
    further
        What is computed beside the estimates; absent: derived quantities of small systems.
    """
    further = further or Further()
    _add_parameters(result, posterior)
    if result.wants_below(CONSIDERED):
        size = np.abs(posterior.values)
        relative = posterior.rates / np.where(size > 0, size, 1.0)
        add_calibration_slopes(result, posterior.calibration_slopes, relative)
    if any(map(result.wants_below, _SAMPLED)):
        _add_records(result, posterior, true_states)
    result.annotate("identification", estimator=posterior.method)
    add_stages(result, posterior)
    stages = posterior.estimate.stages
    result.add_axis(f"{_STAGES}/parameter", posterior.likelihood.names)
    estimates = values(posterior.likelihood.unknowns, np.array([stage.eta for stage in stages]))
    result.add(f"{_STAGES}/estimate", estimates, ("stage", "parameter"), common_unit_of(posterior))
    if any(record.modelled for record in posterior.likelihood.records if not record.modal):
        add_noise(result, posterior)
    check = posterior_check(posterior) if further.check else None
    if check is not None:
        _add_check(result, posterior, check)
    _add_optima(result, posterior)
    add_diagnostics(result, posterior, [] if check is None else check.warnings)
    if posterior.model_error is not None:
        posterior.model_error.add_to(result, [channel.name for channel in posterior.channels])
    if result.wants_below(DERIVED):
        add_derived(result, posterior, further.derived)
    return result


def add_stages(result: Result, posterior: Posterior) -> None:
    """Add ``stages/``: the attempts of the estimator, but for their estimates."""
    stages = posterior.estimate.stages
    result.add_axis(f"{_STAGES}/stage", [stage.name for stage in stages])
    result.add(f"{_STAGES}/residual_ratio", [np.max(stage.residual_ratio) for stage in stages], ("stage",))
    result.add(f"{_STAGES}/iterations", [stage.iterations for stage in stages], ("stage",))
    result.add(f"{_STAGES}/chosen", [stage.eta is posterior.fit.eta for stage in stages].index(True) + 1)


def _add_parameters(result: Result, posterior: Posterior) -> None:
    """Add ``parameters/``: estimates with error bars, bounds and correlations."""
    group, dims = _PARAMETERS, ("parameter",)
    names, priors = posterior.likelihood.names, posterior.likelihood.priors
    unit, estimate, rate, true = common_unit_of(posterior), posterior.values, posterior.rates, posterior.true
    add_names(result, group, posterior)
    result.add(f"{group}/estimate", estimate, dims, unit)
    identifiable = posterior.identifiable
    rate = np.where(identifiable, rate, np.inf)
    result.add(f"{group}/identifiable", identifiable, dims)
    result.add(f"{group}/standard_error", rate * posterior.deviations, dims, unit)
    for name, ends in zip(("low", "high"), posterior.intervals, strict=True):
        result.add(f"{group}/{name}", ends, dims, unit)
    result.add(f"{group}/decided_by", posterior.decided_by, dims)
    if result.wants(f"{group}/standard_error_scaled") and posterior.noise_is_given:
        result.add(f"{group}/standard_error_scaled", rate * posterior.scaled_deviations, dims, unit)
    if (
        result.wants(f"{group}/standard_error_total")
        and (total := posterior.considered_deviations) is not None
    ):
        result.add(f"{group}/standard_error_total", rate * total, dims, unit)
    if result.wants(f"{group}/cramer_rao"):
        bound = np.where(identifiable, posterior.bound, np.inf)
        result.add(f"{group}/cramer_rao", bound, dims, unit)
    result.add(f"{group}/at_bound", priors.at_bound(posterior.fit.eta) & ~priors.fixed, dims)
    if (priors.has_prior & ~priors.fixed).any():
        result.add(f"{group}/cramer_rao_without_prior", posterior.bound_with(prior=False), dims, unit)
    nonzero = np.where(true == 0, np.nan, true)
    result.add(f"{group}/error_percent", 100 * np.abs(estimate / nonzero - 1), dims, "%")
    # An axis of its own: two axes of one name could not be distinguished.
    result.add_axis(f"{group}/other", names)
    result.add(f"{group}/correlation", posterior.information.correlation(), ("parameter", "other"))


def add_names(result: Result, group: str, posterior: Posterior) -> None:
    """Add names, units, scales, starts and true values of the parameters to a group."""
    dims, unit, unknowns = ("parameter",), common_unit_of(posterior), posterior.likelihood.unknowns
    names = posterior.likelihood.names
    result.add_axis(f"{group}/parameter", names)
    result.add(f"{group}/name", names, dims)
    result.add(f"{group}/unit", [unknown.unit for unknown in unknowns], dims)
    if not all(unknown.logarithmic for unknown in unknowns):
        result.add(f"{group}/scale", [unknown.scale for unknown in unknowns], dims)
    result.add(f"{group}/start", posterior.starts or [unknown.start for unknown in unknowns], dims, unit)
    result.add(f"{group}/true", posterior.true, dims, unit)


def common_unit_of(posterior: Posterior) -> str:
    """Return the common unit of the parameters, if there is one."""
    return common_unit(unknown.unit for unknown in posterior.likelihood.unknowns)


def _add_optima(result: Result, posterior: Posterior) -> None:
    """Add ``equivalent_optima/`` where several optima have equal likelihood."""
    optima = posterior.optima
    if optima is None or len(optima) == 1:
        return
    group, dims = "identification/equivalent_optima", ("optimum",)
    result.add_axis(f"{group}/optimum", np.arange(1, len(optima) + 1))
    result.add_axis(f"{group}/parameter", posterior.likelihood.names)
    estimates = values(posterior.likelihood.unknowns, optima.eta)
    estimates[0] = posterior.values
    result.add(f"{group}/estimate", estimates, ("optimum", "parameter"), common_unit_of(posterior))
    result.add(f"{group}/log_likelihood", optima.log_likelihood, dims)
    result.add(f"{group}/log_posterior", optima.log_posterior, dims)
    result.add(f"{group}/undecided", optima.undecided, dims)


# Diagnostics.


def add_diagnostics(result: Result, posterior: Posterior, more: Sequence[str] = ()) -> None:
    """Add ``diagnostics/``: convergence, comparison of models, tests of the residuals, verdict."""
    group = _DIAGNOSTICS
    result.add(f"{group}/equivalent_optima", 1 if posterior.optima is None else len(posterior.optima))
    for name in ("optimum", "settled"):
        result.add(f"{group}/{name}", posterior.optimal)
    if any(result.wants(f"{group}/{name}") for name in _COMPARED):
        _add_comparison(result, posterior)
    result.add_axis(f"{group}/parameter", posterior.likelihood.names)
    result.add(f"{group}/distance_to_optimum", posterior.distance_to_optimum, ("parameter",))
    priors = posterior.likelihood.priors
    if (priors.has_prior & ~priors.fixed).any():
        conflict = posterior.prior_conflict
        result.add(f"{group}/prior_conflict", conflict, ("parameter",))
        result.add(f"{group}/prior_contradicted", conflict > CONTRADICTED, ("parameter",))
    result.add_axis(f"{group}/channel", [channel.name for channel in posterior.channels])
    unit = common_unit(channel.unit for channel in posterior.channels)
    result.add(f"{group}/residual_rms", posterior.residual_rms, ("channel",), unit)
    result.add(f"{group}/residual_ratio", posterior.residual_ratio, ("channel",))
    result.add(f"{group}/whiteness_p", posterior.whiteness_p)
    result.add(f"{group}/white", not is_coloured(posterior.whiteness_p))
    result.add(f"{group}/condition", posterior.information.condition())
    if any(result.wants(f"{group}/{name}") for name in ("log_likelihood", "bic")):
        size = likelihood_size(posterior)
        result.add(f"{group}/log_likelihood", size.log_likelihood)
        result.add(f"{group}/bic", size.bic)
        result.add(f"{group}/observations", size.observations)
        result.add(f"{group}/free_parameters", size.free)
    for name, count in posterior.estimate.counts.items():
        result.add(f"{group}/{name}", count)
    result.add(f"{group}/passes", len(posterior.estimate.histories))
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
    result.add(f"{group}/explained", compared.explained)
    result.add(f"{group}/redundancy", compared.redundancy)
    result.add(f"{group}/signal_p", compared.signal_p)
    result.add(f"{group}/signal_explained", compared.signal_explained)
    result.add(f"{group}/lack_of_fit_p", compared.lack_of_fit_p)
    result.add(f"{group}/lacks_fit", compared.lacks_fit)
    result.add(f"{group}/channel_lack_of_fit_p", compared.channel_lack_of_fit_p, ("channel",))
    if posterior.rejection is not None:
        return
    if not (posterior.optimal and compared.explained and compared.redundancy > 0):
        result.annotate(_PARAMETERS, error_bars="nominal: the estimate is not converged")
    elif posterior.undetermined:
        held = ", ".join(posterior.undetermined)
        result.annotate(_PARAMETERS, error_bars=f"conditional on the values of {held}")
    elif posterior.ambiguous:
        result.annotate(_PARAMETERS, error_bars="of this optimum alone")
    elif posterior.optima is not None and posterior.optima.flat is not None:
        result.annotate(
            _PARAMETERS, error_bars="too narrow: the likelihood falls more slowly than they predict"
        )
    elif compared.lacks_fit or is_coloured(posterior.whiteness_p):
        result.annotate(_PARAMETERS, error_bars="nominal: the residuals are not noise")


def _add_residual_tests(result: Result, posterior: Posterior) -> None:
    """Add the tests of residuals to ``diagnostics/``, and ``robust/`` where a robust loss was used."""
    test, dims, group = posterior.noise_test, ("channel",), _DIAGNOSTICS
    unit = common_unit(channel.unit for channel in posterior.channels)
    result.add(f"{group}/noise_p", test.p)
    if not np.isnan(test.p):
        result.add(f"{group}/noise_contradicted", bool(posterior.contradicted_noise))
        result.add(f"{group}/channel_noise_p", test.channel_p, dims)
        result.add(f"{group}/noise_ratio", test.ratio, dims)
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
    result.add(f"{group}/autocorrelation_band", band, ("channel",))
    result.add(f"{group}/channel_whiteness_p", white, ("channel",))


def _add_check(result: Result, posterior: Posterior, check: PosteriorCheck) -> None:
    """Add the check of the Gaussian posterior by importance sampling."""
    group, dims = "identification/posterior", ("parameter",)
    result.add_axis(f"{group}/parameter", posterior.likelihood.names)
    result.add(f"{group}/k_hat", check.k_hat)
    result.add(f"{group}/effective_samples", check.effective)
    result.add(f"{group}/k_hat_used", check.k_used)
    result.add(f"{group}/effective_samples_used", check.effective_used)
    result.add(f"{group}/gaussian", check.gaussian)
    for name in ("mean", "low", "high"):
        result.add(f"{group}/{name}", getattr(check, name), dims, common_unit_of(posterior))
    if check.log_evidence is not None:
        result.add(f"{group}/log_evidence", check.log_evidence)
    result.annotate(group, samples=DRAWS, confidence=0.95)
    if check.no_evidence:
        result.annotate(group, no_evidence=check.no_evidence)


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
            rows_of_ones = np.ones((len(states), 1))
            passes.append(
                Pass(
                    rows_of_ones * record_fit.eta,
                    rows_of_ones * deviations,
                    states,
                    band,
                    np.diag(deviations),
                )
            )
        sweeps = [passes]
    named = {"history": sweeps[-1]} | ({"first_pass": sweeps[0]} if len(sweeps) > 1 else {})
    for name, sweep in named.items():
        for k, (record, history) in enumerate(zip(records, sweep, strict=True)):
            _add_history(result, _group(posterior, k, name), record, history)
    for k, (record, record_fit) in enumerate(zip(records, parts, strict=True)):
        _add_record(result, posterior, k, record, record_fit, bands[k], true[k])


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
        result.add(f"{group('history')}/true", values, ("parameter",), common_unit_of(posterior))
    if true is not None:
        result.add(f"{group('history')}/true_state", true, ("time", "component"))
    states, dims = group("states"), ("time", "component")  # measured or not (Yang, Fig. 9)
    _add_stored_times(result, states, record)
    _add_components(result, states, model)
    result.add(f"{states}/estimate", fit.predicted.states[rows] * model.scale, dims)
    result.add(f"{states}/standard_deviation", band * model.scale, dims)
    if true is not None:
        result.add(f"{states}/true", true, dims)
    _add_spectrum(result, group("residual_spectrum"), record, fit)
    if posterior.innovations is not None:
        normalised, innovations = posterior.innovations[k], group("innovations")
        consistent = consistency(normalised)
        result.add_axis(f"{innovations}/time", record.times, "s")
        result.add_axis(f"{innovations}/channel", [channel.name for channel in measurement.channels])
        result.add(f"{innovations}/normalised", normalised, ("time", "channel"))
        for name in ("mean_square", "low", "high"):
            result.add(f"{innovations}/{name}", getattr(consistent, name), ("channel",))
        for name in ("overall", "overall_low", "overall_high", "consistent"):
            result.add(f"{innovations}/{name}", getattr(consistent, name))


def _add_spectrum(result: Result, group: str, record: TimeRecord, fit: RecordFit) -> None:
    """Add the roots of the power spectral densities of the residuals."""
    channels = record.conditions.measurement.channels
    omega, amplitude = spectrum(fit.residual, record.sampling_step)
    units = [f"{channel.unit}.(s/rad)^0.5" for channel in channels]
    result.add_axis(f"{group}/omega", omega, "rad/s")
    result.add_axis(f"{group}/channel", [channel.name for channel in channels])
    result.add(f"{group}/unit", units, ("channel",))
    result.add(f"{group}/amplitude", amplitude, ("omega", "channel"), common_unit(units))


def add_fits(result: Result, posterior: Posterior) -> None:
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


def _add_history(result: Result, group: str, record: TimeRecord, history: Pass) -> None:
    """Add the histories of parameters and states over a record."""
    model, dims = record.model, ("time", "parameter")
    estimate, rate = values(model.unknowns, history.eta), rates(model.unknowns, history.eta)
    _add_stored_times(result, group, record)
    result.add_axis(f"{group}/parameter", [unknown.name for unknown in model.unknowns])
    unit = common_unit(unknown.unit for unknown in model.unknowns)
    result.add(f"{group}/estimate", estimate, dims, unit)
    result.add(f"{group}/standard_deviation", rate * history.deviations, dims, unit)
    _add_components(result, group, model)
    # Not an axis named `state`: a variable of two axes cannot have the name of one of them.
    result.add(f"{group}/state", history.states * model.scale, ("time", "component"))
    band = history.state_deviations * model.scale
    result.add(f"{group}/state_standard_deviation", band, ("time", "component"))


def _add_components(result: Result, group: str, model: ParametricModel) -> None:
    components = model.system.states
    result.add_axis(f"{group}/component", [component.name for component in components])
    result.add(f"{group}/unit", [component.unit for component in components], ("component",))


def _add_measurement(result: Result, group: str, record: TimeRecord, fit: RecordFit) -> None:
    """Add a record as measured and as predicted, and its excitation."""
    dims, data = ("time", "channel"), record.data
    loads, measurement = record.conditions
    units = [channel.unit for channel in measurement.channels]
    unit = common_unit(units)
    result.add_axis(f"{group}/time", record.times, "s")
    result.add(f"{group}/samples_left_out", sum(record.left_out))
    result.add_axis(f"{group}/channel", [channel.name for channel in measurement.channels])
    result.add(f"{group}/unit", units, ("channel",))
    result.add(f"{group}/measured", data.recorded, dims, unit)
    result.add(f"{group}/predicted", fit.predicted.outputs, dims, unit)
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
    units = [channel.unit for channel in measurement.channels]
    unit = common_unit(units)
    result.add_axis(f"{group}/omega", measurement.omega, "rad/s")
    result.add_axis(f"{group}/channel", [channel.name for channel in measurement.channels])
    result.add(f"{group}/unit", units, ("channel",))
    result.add(f"{group}/measured", record.responses(record.data.recorded), dims, unit)
    result.add(f"{group}/predicted", record.responses(fit.predicted.outputs), dims, unit)
    measured = record.responses(record.data.recorded)
    result.add(f"{group}/frac", frac(measured, record.responses(fit.predicted.outputs)), ("channel",))
    if result.wants(f"{group}/frac_start"):
        begun = record.fit(starts(record.unknowns), record.data.values)
        result.add(
            f"{group}/frac_start", frac(measured, record.responses(begun.predicted.outputs)), ("channel",)
        )
    if record.data.noise is not None:
        result.add(f"{group}/noise", np.sqrt(2) * record.data.noise, ("channel",), unit)
    if measurement.deviation is not None:
        by_line = measurement.profile
        if measurement.proportional:  # the profile is the predicted magnitude
            by_line = by_line * np.sqrt(2) * fit.noise
        result.add(f"{group}/deviation", by_line, dims, unit)
    elif measurement.given_noise is not None:
        result.add(f"{group}/given_noise", measurement.given_noise, ("channel",), unit)
