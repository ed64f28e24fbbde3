"""Joint identification from measured frequency response functions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged
from dynid.identification.augmented import unknowns_of
from dynid.identification.estimate import MOST_ROUNDS, Rebuild, stays
from dynid.identification.estimators.output_error import OutputError
from dynid.identification.filtering.filter import ASTRAY
from dynid.identification.frf.estimator import FrfAuto, FrfLikelihood
from dynid.identification.frf.fitter import FrfFitter
from dynid.identification.frf.measurement import FrfMeasurement, check_cost, frf_data
from dynid.identification.frf.outcome import FrfOutcome
from dynid.identification.measurement import Data
from dynid.identification.model_error import ModelError, model_error
from dynid.lti.floating import guarded
from dynid.result import Result
from dynid.structure.model import StructuralModel

Array = NDArray[np.float64]


def identify_frf(
    model: StructuralModel,
    measurement: FrfMeasurement,
    estimator: FrfAuto | OutputError | None = None,
    *,
    truth: StructuralModel | None = None,
    rebuild: Rebuild | None = None,
) -> Result:
    """Identify the unknown joint parameters of a structure from frequency response functions.

    Parameters
    ----------
    model
        The structure the estimator works with, full or reduced.
    measurement
        The responses, measured or to be simulated.
    estimator
        How to estimate; absent: `FrfAuto()`.
    truth
        The structure that simulated responses are made with; absent: `model`.
    rebuild
        As of `dynid.identification.estimate.identify_all`.

    Returns
    -------
    Result
        ``identification/{parameters, stages, measurement, diagnostics}`` as of `identify_all`, where they are
        of whole records; ``measurement/{omega, channel, measured, predicted}`` (omega x channel, complex),
        with `noise`, `given_noise` or `deviation` of the complex values. Residuals are white where neither
        real nor imaginary parts are correlated from line to line; those that are not are the model's.

    Raises
    ------
    NotIdentifiable
        If the responses cannot see parameters or tell them apart, or one is dead.
    Diverged
        If estimates run away, or the prediction explains nothing of the responses.
    Singular
        If a line lies on an undamped pole.
    UsageError
        If the call makes no sense, or there is more to solve than can be.
    """
    names = [unknown.name for unknown in unknowns_of(model)]
    with guarded(f"the identification of {', '.join(names)}", names=names):
        return _identified(model, measurement, estimator or FrfAuto(), truth or model, rebuild)


def _identified(
    model: StructuralModel,
    measurement: FrfMeasurement,
    estimator: FrfAuto | OutputError,
    truth: StructuralModel,
    rebuild: Rebuild | None,
) -> Result:
    data = frf_data(truth, measurement)
    names = [unknown.name for unknown in model.unknowns]
    logs = np.log([unknown.start for unknown in model.unknowns])
    here = estimator if rebuild is None else _for_rounds(estimator)
    outcome: FrfOutcome | None = None
    for rounds in range(1, 2 * MOST_ROUNDS + 1):
        likelihood = likelihood_of(model, measurement, data)
        if outcome is None:
            likelihood.information(likelihood.fit(logs), [data.rms]).check()
        with guarded("the estimator", Diverged, remedy=ASTRAY, names=names):
            found = here.run(likelihood, logs)
        if outcome is not None:
            found = replace(found, stages=[*outcome.estimation.stages, *found.stages])
        outcome = FrfOutcome(likelihood, estimator.name, found, measurement)
        change, logs = np.abs(found.fit.logs - logs), found.fit.logs
        if rebuild is None:
            break
        if stays(change, outcome.information) or rounds == MOST_ROUNDS:
            if outcome.explained or not isinstance(here, FrfAuto) or here.nets:
                break
            here = replace(here, nets=True)
        model = rebuild(dict(zip(names, np.exp(logs).tolist(), strict=True)))
    assert outcome is not None
    outcome.check()
    if model.basis is not None and truth.basis is None:
        outcome = replace(outcome, model_error=_model_error(model, outcome, data))
    return outcome.result()


def _for_rounds(estimator: FrfAuto | OutputError) -> FrfAuto | OutputError:
    """Return the estimator for a model that is to be made anew.

    What its basis leaves need not be white; a basis may lead where no start does.
    """
    return replace(estimator, content=True, nets=False) if isinstance(estimator, FrfAuto) else estimator


def likelihood_of(model: StructuralModel, measurement: FrfMeasurement, data: Data) -> FrfLikelihood:
    """Return the likelihood of measured responses with a model.

    Raises
    ------
    UsageError
        If there is more to solve than can be.
    """
    check_cost(model, len(measurement.omega))
    return FrfLikelihood((FrfFitter(model, measurement, data),))


def _model_error(model: StructuralModel, outcome: FrfOutcome, data: Data) -> ModelError:
    measurement = outcome.measurement
    named = [dof for frf in measurement.channels for dof in (frf.channel.dof, frf.force)]
    return model_error(
        model,
        outcome.ensemble,
        outcome.estimation.fit,
        list(dict.fromkeys(named)),
        lambda finer: likelihood_of(finer, measurement, data),
    )
