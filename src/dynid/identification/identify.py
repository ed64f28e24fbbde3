"""Joint identification: from a structure with unknown joints and records to estimates with error bars.

Source: K. T. Yang 1997.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged, UsageError
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.estimate import Estimate, Estimator, Sweep
from dynid.identification.estimators.maximum_likelihood import Huber
from dynid.identification.filter import ASTRAY
from dynid.identification.information import Information
from dynid.identification.likelihood import Likelihood
from dynid.identification.measurement import (
    Experiment,
    Measurement,
    RecordData,
    Simulation,
    as_estimated,
    data,
    simulated,
)
from dynid.identification.model_error import model_error
from dynid.identification.posterior import Posterior
from dynid.identification.record_model import RecordModel, record_model, unknowns_of
from dynid.identification.states import true_states
from dynid.identification.time_record import TimeLikelihood, TimeRecord
from dynid.identification.write_result import write_result
from dynid.lti.floating import guarded
from dynid.result import Result
from dynid.structure.model import StructuralModel
from dynid.structure.response import Load

Array = NDArray[np.float64]

Rebuild = Callable[[Mapping[str, float]], StructuralModel]
"""Makes a model for joint parameters by name."""

# A basis that follows the joints is made anew until the estimates move by less than this many standard
# errors, or this part of themselves; and so often at the most.
_STAYS, _LEAST = 0.01, 1e-6
MOST_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class SharedRecords:
    """Records, models and noise-free likelihood of identifications whose records differ in their noise alone.

    Attributes
    ----------
    clean
        Of each record the values without noise (times x channels); None of one that is not simulated.
    models
        The model of each record; none where models differ.
    ideal
        The records without their noise, checked to be identifiable; None where models differ.
    """

    clean: Sequence[Array | None]
    models: Sequence[RecordModel] = ()
    ideal: Likelihood | None = None

    @classmethod
    def of(
        cls, model: StructuralModel, experiments: Sequence[Experiment], truth: StructuralModel, *, same: bool
    ) -> SharedRecords:
        """Return what is shared; `same`: also the models, which are the same in all.

        Raises
        ------
        DynidError
            As of `identify_all`.
        """
        with guarded("what the records share"):
            clean = [
                simulated(truth, *one).outputs if isinstance(one.measurement.source, Simulation) else None
                for one in experiments
            ]
            if not same or any(values is None for values in clean):
                return cls(clean)
            models = _record_models(model, experiments)
            each = zip(experiments, clean, strict=True)
            values = [data(truth, *experiment, record).without_noise() for experiment, record in each]
            ideal = _likelihood(models, experiments, values)
            _check_identifiable(ideal)
            return cls(clean, models, ideal)


def identify(
    model: StructuralModel,
    loads: Sequence[Load],
    measurement: Measurement,
    estimator: Estimator | None = None,
    *,
    truth: StructuralModel | None = None,
    rebuild: Rebuild | None = None,
) -> Result:
    """Identify the unknown joint parameters of a structure from one record; see `identify_all`."""
    return identify_all(model, [Experiment(loads, measurement)], estimator, truth=truth, rebuild=rebuild)


def identify_all(
    model: StructuralModel,
    experiments: Sequence[Experiment],
    estimator: Estimator | None = None,
    *,
    truth: StructuralModel | None = None,
    rebuild: Rebuild | None = None,
    common: SharedRecords | None = None,
    into: Result | None = None,
) -> Result:
    """Identify the unknown joint parameters of a structure from records that share them.

    Parameters
    ----------
    model
        The structure the estimator works with.
    experiments
        The records, each with its own loads, channels, sampling, noise and unknown initial state.
    estimator
        How to estimate; absent: `Auto()`.
    truth
        The structure that simulated records are made with; absent: `model`.
    rebuild
        Makes the model anew for parameters by name: a reduced one whose basis follows the joints. The
        estimator goes on with it until the estimates stay, at most ten times. Absent: `model` stays.
    common
        What these records share with those of other identifications, if it is made already.
    into
        The result to add to; of a `Selection` only what is wanted is computed. Absent: a new one.

    Returns
    -------
    Result
        ``identification/{parameters, considered, history, first_pass, stages, states, measurement,
        innovations, residual_spectrum, diagnostics}``. `history` is the last pass, `first_pass` the first
        where there are several; `states` are those at the estimate with bands given the whole record and,
        of a simulated record, the true ones; `innovations` those of the filter's last pass; the `warnings`
        of the diagnostics are sentences. `predicted` is the noise-free response
        at the estimate from the best initial state; `error_percent` is unsigned. `true` and `error_percent`
        are NaN where a true value is not known, `measured` and
        `normalised` innovations where a sample is missing, nothing else ever. An
        estimate has `converged` where three things hold. It is at the `optimum`, which is also called
        `settled`: `distance_to_optimum`, the Gauss–Newton step left in standard errors, is below a half. The
        model has `explained` the record: there is a response (`signal_p`), and the residuals are noise
        (`lack_of_fit_p`) or at least 95 % of the signal are the model's (`signal_explained`); see
        `lack_of_fit`. And the record could contradict it: `redundancy` is above 0. The attribute `error_bars`
        of `parameters` says where error bars are nominal.
        `noise_p` is the p-value of the residuals against the noise that is given (two-sided chi-squared), NaN
        without one; `channel_noise_p` and `noise_ratio` (seen over given) are NaN of channels without one.
        `standard_error_scaled` is for the noise that is seen instead. `residual_<mean|kurtosis|largest>` with
        their p-values, and the number of `outliers`, describe the residuals where these are more than
        rounding; coloured ones are whitened before.
        With Huber's loss ``robust/{channel, scale, clipped}`` has the robust deviation of each channel's
        residuals and the part that is bounded; the diagnostics are those of the bounded residuals.
        `starts` of the diagnostics is how many starts were tried, `starts_agreed` how many ended at this
        optimum; where they disagree and the residuals are no noise, the estimate is not `settled`.
        Priors count as measurements do, in estimates, `standard_error` and `cramer_rao`;
        `cramer_rao_without_prior` is the bound of the records alone, infinite where they tell nothing.
        `prior_conflict` of the diagnostics is how many deviations a prior and the records are apart, 0
        without a prior. `at_bound` says which estimates stand at a bound: their standard errors are nominal.
        Variables whose unit differs along an axis have the units beside them, as `unit`.
        Of several records `history`, `first_pass` and `measurement` hold a group each, ``record_1``, …, and
        the channels of the diagnostics are called ``record_1.<channel>``.

    Raises
    ------
    NotIdentifiable
        If parameters are not visible or not distinguishable in the records, or a channel is dead.
    Diverged
        If estimates run away, or the prediction explains nothing of a record.
    NumericalError
        If a number leaves the range of double precision.
    UsageError
        If the call makes no sense, or a record is too large to be worked on.
    """
    if not experiments:
        raise UsageError("there is no record to identify from", names=("measurement",))
    names = [unknown.name for unknown in unknowns_of(model)]
    with guarded(f"the identification of {', '.join(names)}", names=names):
        values = [
            data(truth or model, *experiment, None if common is None else common.clean[k])
            for k, experiment in enumerate(experiments)
        ]
        posterior, last = _identified(
            model, experiments, values, estimator or Auto(), truth or model, rebuild, common
        )
        return write_result(
            Result("identification") if into is None else into,
            posterior,
            lambda: [true_states(truth or model, last, *experiment) for experiment in experiments],
        )


def _identified(
    model: StructuralModel,
    experiments: Sequence[Experiment],
    values: Sequence[RecordData],
    estimator: Estimator,
    truth: StructuralModel,
    rebuild: Rebuild | None,
    common: SharedRecords | None,
) -> tuple[Posterior, StructuralModel]:
    """Return the posterior, and the model that it belongs to in the end."""
    names = [unknown.name for unknown in model.unknowns]
    logs, here = np.log([unknown.start for unknown in model.unknowns]), estimator
    before: tuple[Posterior, TimeLikelihood] | None = None
    for _ in range(1 if rebuild is None else MOST_ROUNDS):
        if before is None:
            likelihood = _checked_likelihood(model, experiments, values, common)
        else:
            likelihood = _likelihood(_record_models(model, experiments), experiments, values)
            here = _without_restarts(here)
        with guarded("the estimator", Diverged, remedy=ASTRAY, names=names):
            estimate = here.run(likelihood, logs)
        if before is not None:
            estimate = _continued(*before, likelihood, model, estimate)
        posterior = Posterior(estimate.likelihood or likelihood, estimator.name, estimate, model.dofs)
        change, logs = np.abs(estimate.fit.logs - logs), estimate.fit.logs
        before = posterior, likelihood
        if rebuild is None or has_settled(change, posterior.information):
            break
        model = rebuild(dict(zip(names, np.exp(logs).tolist(), strict=True)))
    posterior.check()
    if model.basis is not None and truth.basis is None:
        dofs = [load.dof for loads, _ in experiments for load in loads if load.dof is not None]
        dofs += [channel.dof for _, measurement in experiments for channel in measurement.channels]
        own = [record.data for record in posterior.likelihood.records]
        found = model_error(
            model,
            posterior.likelihood,
            posterior.fit,
            list(dict.fromkeys(dofs)),
            lambda finer: _likelihood(_record_models(finer, experiments), experiments, own),
        )
        posterior = replace(posterior, model_error=found)
    return posterior, model


def _without_restarts(estimator: Estimator) -> Estimator:
    """Return the estimator for a model made anew, whose optimum is near."""
    if isinstance(estimator, Huber):
        return replace(estimator, inner=_without_restarts(estimator.inner))
    return replace(estimator, escalates=False) if isinstance(estimator, Auto) else estimator


def has_settled(change: Array, information: Information) -> bool:
    """Return True if logarithms that changed by so much (p) do not change any more, within their errors."""
    return bool(np.all(change <= np.maximum(_STAYS * information.deviations(), _LEAST)))


def _record_models(model: StructuralModel, experiments: Sequence[Experiment]) -> list[RecordModel]:
    """Return the model of each record, with its loads as an estimator knows them."""
    return [
        record_model(
            model,
            as_estimated(loads, measurement.record),
            measurement.channels,
            measurement.record.times,
        )
        for loads, measurement in experiments
    ]


def _likelihood(
    models: Sequence[RecordModel],
    experiments: Sequence[Experiment],
    values: Sequence[RecordData],
    noiseless: Likelihood | None = None,
) -> TimeLikelihood:
    """Return the likelihood of records, each with its model."""
    each = zip(models, values, experiments, strict=True)
    records = tuple(TimeRecord(model, own, experiment, len(values)) for model, own, experiment in each)
    return TimeLikelihood(records, noiseless=noiseless)


def _checked_likelihood(
    model: StructuralModel,
    experiments: Sequence[Experiment],
    values: Sequence[RecordData],
    common: SharedRecords | None,
) -> TimeLikelihood:
    """Return the likelihood of records in which the unknowns are identifiable."""
    if common is not None and common.ideal is not None:
        return _likelihood(common.models, experiments, values, common.ideal)
    likelihood = _likelihood(_record_models(model, experiments), experiments, values)
    _check_identifiable(likelihood.ideal)
    return likelihood


def _check_identifiable(likelihood: Likelihood) -> None:
    logs = np.log([unknown.start for unknown in likelihood.unknowns])
    rms = [record.data.rms for record in likelihood.records]
    likelihood.information(likelihood.fit(logs), rms).check()


def _continued(
    posterior: Posterior,
    before: TimeLikelihood,
    likelihood: TimeLikelihood,
    model: StructuralModel,
    now: Estimate,
) -> Estimate:
    """Return an estimate with a model made anew, after the estimate before it.

    Earlier histories come along in the units of the new states; not where the states are others.
    """
    earlier: list[Sweep] = []
    old = posterior.estimate
    if list(posterior.dofs) == list(model.dofs):
        each = zip(before.records, likelihood.records, strict=True)
        units = [one.model.scale / other.model.scale for one, other in each]
        earlier = [
            [
                history._replace(
                    states=history.states * unit, state_deviations=history.state_deviations * unit
                )
                for history, unit in zip(sweep, units, strict=True)
            ]
            for sweep in old.histories
        ]
    return replace(
        now,
        histories=[*earlier, *now.histories],
        stages=[*old.stages, *now.stages],
        counts=old.counts if "starts" in now.counts else now.counts,  # the search was the first one
        disputed=now.disputed and old.disputed,
    )
