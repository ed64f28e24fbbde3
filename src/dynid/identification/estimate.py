"""Joint identification: from a structure with unknown joints and records to estimates with error bars.

Source: K. T. Yang 1997.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged, UsageError
from dynid.identification.augmented import augmented, unknowns_of
from dynid.identification.ensemble import Ensemble, Likelihood
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.estimation import Estimation, Estimator, Sweep
from dynid.identification.filtering.filter import ASTRAY, Pass
from dynid.identification.fit import Fitter, Frame, frame
from dynid.identification.information import Information
from dynid.identification.measurement import (
    Data,
    Experiment,
    Measurement,
    Simulation,
    as_estimated,
    data,
    simulated,
)
from dynid.identification.model_error import ModelError, model_error
from dynid.identification.outcome import Outcome
from dynid.identification.states import true_states
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
class Common:
    """What identifications share whose records differ in their noise alone.

    Attributes
    ----------
    clean
        Of each record the values without noise (times x channels); None of one that is not simulated.
    frames
        What the fits of each record share; none where models differ.
    ideal
        The records without their noise, in which the unknowns are seen and told apart; None where models
        differ.
    """

    clean: Sequence[Array | None]
    frames: Sequence[Frame] = ()
    ideal: Likelihood | None = None

    @classmethod
    def of(
        cls, model: StructuralModel, experiments: Sequence[Experiment], truth: StructuralModel, *, same: bool
    ) -> Common:
        """Return what is common; `same`: also of the models, which are the same in all.

        Raises
        ------
        DynidError
            As of `identify_all`.
        """
        with guarded("what the records share"):
            clean = [_clean(truth, experiment) for experiment in experiments]
            if not same or any(values is None for values in clean):
                return cls(clean)
            frames = _frames(model, experiments)
            each = zip(experiments, clean, strict=True)
            values = [data(truth, *experiment, record).without_noise() for experiment, record in each]
            ideal = _filled(frames, values)
            _check_visible(ideal)
            return cls(clean, frames, ideal)

    def ensemble(self, values: Sequence[Data]) -> Ensemble:
        """Return these records with the models that they share."""
        return _filled(self.frames, values, self.ideal)


def _clean(truth: StructuralModel, experiment: Experiment) -> Array | None:
    """Return a simulated record without its noise."""
    is_simulated = isinstance(experiment.measurement.source, Simulation)
    return simulated(truth, *experiment).outputs if is_simulated else None


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
    common: Common | None = None,
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
        What these records share with others, where it is made already.
    into
        What the result is added to: of a `Selection` only what is wanted is computed. Absent: a new one.

    Returns
    -------
    Result
        ``identification/{parameters, history, first_pass, stages, states, measurement, innovations,
        residual_spectrum, diagnostics}``. `history` is the last pass, `first_pass` the first where there are
        several; `states` are those at the estimate with bands given the whole record and, of a simulated
        record, the true ones; `innovations` those of the filter's last pass; the `warnings` of the
        diagnostics say in words what to be wary of. `predicted` is the noise-free response
        at the estimate from the best initial state; `error_percent` is unsigned. `true` and `error_percent`
        are NaN where a true value is not known, `measured` and
        `normalised` innovations where a sample is missing, nothing else ever. An
        estimate has `converged` if it is `settled` (`distance_to_optimum`, the Gauss–Newton step left in
        standard errors, is below a half) and the record is `explained` (the residuals are small or `white`;
        small ones that are not white leave the error bars nominal).
        Priors count as measurements do, in estimates, `standard_error` and `cramer_rao`;
        `cramer_rao_without_prior` is the bound of the records alone, infinite where they tell nothing.
        `prior_conflict` of the diagnostics is how many deviations a prior and the records are apart, 0
        without a prior. `at_bound` says which estimates stand at a bound: their standard errors are nominal.
        What differs in unit along an axis has the units beside it, as `unit`.
        Of several records `history`, `first_pass` and `measurement` hold a group each, ``record_1``, …, and
        the channels of the diagnostics are called ``record_1.<channel>``.

    Raises
    ------
    NotIdentifiable
        If the records cannot see parameters or tell them apart, or a channel is dead.
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
        question = experiments, values, estimator or Auto(), truth or model, rebuild, common
        outcome, last = _identified(model, *question)
        return outcome.result(
            Result("identification") if into is None else into,
            lambda: [true_states(truth or model, last, *experiment) for experiment in experiments],
        )


def _identified(
    model: StructuralModel,
    experiments: Sequence[Experiment],
    values: Sequence[Data],
    estimator: Estimator,
    truth: StructuralModel,
    rebuild: Rebuild | None,
    common: Common | None,
) -> tuple[Outcome, StructuralModel]:
    """Return what was found, and the model it was found with in the end."""
    names = [unknown.name for unknown in model.unknowns]
    logs, here = np.log([unknown.start for unknown in model.unknowns]), estimator
    outcome: Outcome | None = None
    for _ in range(1 if rebuild is None else MOST_ROUNDS):
        if outcome is None:
            ensemble = _visible(model, experiments, values, common)
        else:
            ensemble = _ensemble(model, experiments, values)
            if isinstance(here, Auto):  # what is left to go is short
                here = replace(here, escalates=False)
        with guarded("the estimator", Diverged, remedy=ASTRAY, names=names):
            found = here.run(ensemble, logs)
        if outcome is not None:
            found = _joined(outcome, ensemble, model, found)
        outcome = Outcome(ensemble, estimator.name, found, experiments, model.dofs)
        change, logs = np.abs(found.fit.logs - logs), found.fit.logs
        if rebuild is None or stays(change, outcome.information):
            break
        model = rebuild(dict(zip(names, np.exp(logs).tolist(), strict=True)))
    assert outcome is not None
    outcome.check()
    if model.basis is not None and truth.basis is None:
        outcome = replace(outcome, model_error=_model_error(model, outcome, values))
    return outcome, model


def stays(change: Array, information: Information) -> bool:
    """Tell whether logarithms that changed by so much (p) stay where they are, for all that is known."""
    return bool(np.all(change <= np.maximum(_STAYS * information.deviations(), _LEAST)))


def _model_error(model: StructuralModel, outcome: Outcome, values: Sequence[Data]) -> ModelError:
    experiments = outcome.experiments
    named = [load.dof for loads, _ in experiments for load in loads if load.dof is not None]
    named += [channel.dof for _, measurement in experiments for channel in measurement.channels]
    return model_error(
        model,
        outcome.ensemble,
        outcome.estimation.fit,
        list(dict.fromkeys(named)),
        lambda finer: _ensemble(finer, experiments, values),
    )


def _ensemble(model: StructuralModel, experiments: Sequence[Experiment], values: Sequence[Data]) -> Ensemble:
    """Return the records with the model of each."""
    return _filled(_frames(model, experiments), values)


def _frames(model: StructuralModel, experiments: Sequence[Experiment]) -> list[Frame]:
    """Return the model of each record, with its loads as an estimator knows them."""
    frames = []
    for loads, measurement in experiments:
        record, channels = measurement.record, measurement.channels
        joint = augmented(model, as_estimated(loads, record), channels, record.times)
        frames.append(frame(joint, model, channels))
    return frames


def _filled(frames: Sequence[Frame], values: Sequence[Data], noiseless: Likelihood | None = None) -> Ensemble:
    each = zip(frames, values, strict=True)
    fitters = tuple(Fitter(frame, measured, len(values)) for frame, measured in each)
    return Ensemble(fitters, noiseless=noiseless)


def _joined(before: Outcome, ensemble: Ensemble, model: StructuralModel, now: Estimation) -> Estimation:
    """Return what was found with a model made anew, after what was found before.

    Earlier histories come along in the units of the new states; not where the states are others.
    """
    earlier: list[Sweep] = []
    if list(before.dofs) == list(model.dofs):
        each = zip(before.ensemble.records, ensemble.records, strict=True)
        units = [old.model.scale / new.model.scale for old, new in each]
        earlier = [
            [_rescaled(history, unit) for history, unit in zip(sweep, units, strict=True)]
            for sweep in before.estimation.histories
        ]
    stages = [*before.estimation.stages, *now.stages]
    return replace(now, histories=[*earlier, *now.histories], stages=stages)


def _rescaled(history: Pass, unit: Array) -> Pass:
    states, deviations = history.states * unit, history.state_deviations * unit
    return history._replace(states=states, state_deviations=deviations)


def _visible(
    model: StructuralModel, experiments: Sequence[Experiment], values: Sequence[Data], common: Common | None
) -> Ensemble:
    """Return the records with the model of each, in which the unknowns are seen and told apart."""
    if common is not None and common.ideal is not None:
        return common.ensemble(values)
    ensemble = _ensemble(model, experiments, values)
    _check_visible(ensemble.ideal)
    return ensemble


def _check_visible(ensemble: Likelihood) -> None:
    logs = np.log([unknown.start for unknown in ensemble.unknowns])
    rms = [record.data.rms for record in ensemble.records]
    ensemble.information(ensemble.fit(logs), rms).check()
