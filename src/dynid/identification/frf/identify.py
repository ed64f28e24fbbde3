"""Joint identification from measured frequency response functions."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Diverged
from dynid.identification.estimators.maximum_likelihood import Huber, OutputError
from dynid.identification.filter import ASTRAY
from dynid.identification.frf.measurement import FrfMeasurement, check_cost, frf_data
from dynid.identification.frf.record import FrfAuto, FrfLikelihood, FrfRecord
from dynid.identification.identifiability import expected_records, identifiability_result
from dynid.identification.identify import MOST_ROUNDS, Rebuild, has_settled
from dynid.identification.measurement import RecordData
from dynid.identification.model_error import model_error
from dynid.identification.posterior import Posterior
from dynid.identification.record_model import unknowns_of
from dynid.identification.write_result import write_result
from dynid.lti.floating import guarded
from dynid.result import Result
from dynid.structure.model import StructuralModel

Array = NDArray[np.float64]
FrfEstimator: TypeAlias = FrfAuto | OutputError | Huber


def identify_frf(
    model: StructuralModel,
    measurement: FrfMeasurement,
    estimator: FrfEstimator | None = None,
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
        As of `dynid.identification.identify.identify_all`.

    Returns
    -------
    Result
        ``identification/{parameters, considered, stages, measurement, diagnostics}`` as of `identify_all`,
        where they are of whole records; ``measurement/{omega, channel, measured, predicted}`` (omega x
        channel, complex), with `noise`, `given_noise` or `deviation` of the complex values. Residuals are
        white where neither real nor imaginary parts are correlated from line to line; those that are not are
        the model's.

    Raises
    ------
    NotIdentifiable
        If parameters are not visible or not distinguishable in the responses, or one is dead.
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
    estimator: FrfEstimator,
    truth: StructuralModel,
    rebuild: Rebuild | None,
) -> Result:
    data = frf_data(truth, measurement)
    names = [unknown.name for unknown in model.unknowns]
    logs = np.log([unknown.start for unknown in model.unknowns])
    here = estimator if rebuild is None else _without_restarts(estimator)
    posterior: Posterior | None = None
    for rounds in range(1, 2 * MOST_ROUNDS + 1):
        likelihood = likelihood_of(model, measurement, data)
        if posterior is None:
            likelihood.information(likelihood.fit(logs), [data.rms]).check()
        with guarded("the estimator", Diverged, remedy=ASTRAY, names=names):
            estimate = here.run(likelihood, logs)
        if posterior is not None:
            estimate = replace(estimate, stages=[*posterior.estimate.stages, *estimate.stages])
        posterior = Posterior(estimate.likelihood or likelihood, estimator.name, estimate, model.dofs)
        change, logs = np.abs(estimate.fit.logs - logs), estimate.fit.logs
        if rebuild is None:
            break
        if has_settled(change, posterior.information) or rounds == MOST_ROUNDS:
            if posterior.explained or (other := _with_restarts(here)) is None:
                break
            here = other
        model = rebuild(dict(zip(names, np.exp(logs).tolist(), strict=True)))
    assert posterior is not None
    posterior.check()
    if model.basis is not None and truth.basis is None:
        dofs = [dof for frf in measurement.channels for dof in (frf.channel.dof, frf.force)]
        own = posterior.likelihood.records[0].data
        found = model_error(
            model,
            posterior.likelihood,
            posterior.fit,
            list(dict.fromkeys(dofs)),
            lambda finer: likelihood_of(finer, measurement, own),
        )
        posterior = replace(posterior, model_error=found)
    return write_result(Result("identification"), posterior)


def _without_restarts(estimator: FrfEstimator) -> FrfEstimator:
    """Return the estimator for a model that is to be made anew.

    The residuals of its basis need not be white; a basis may lead where no start does.
    """
    if isinstance(estimator, Huber):
        return replace(estimator, inner=_without_restarts(cast("FrfEstimator", estimator.inner)))
    if isinstance(estimator, FrfAuto):
        return replace(estimator, accept_small=True, multi_start=False)
    return estimator


def _with_restarts(estimator: FrfEstimator) -> FrfEstimator | None:
    """Return the estimator with other starts; None where it has them, or takes none."""
    if isinstance(estimator, Huber):
        inner = _with_restarts(cast("FrfEstimator", estimator.inner))
        return None if inner is None else replace(estimator, inner=inner)
    if not isinstance(estimator, FrfAuto) or estimator.multi_start:
        return None
    return replace(estimator, multi_start=True)


def likelihood_of(model: StructuralModel, measurement: FrfMeasurement, data: RecordData) -> FrfLikelihood:
    """Return the likelihood of measured responses with a model.

    Raises
    ------
    UsageError
        If there is more to solve than can be.
    """
    check_cost(model, len(measurement.omega))
    return FrfLikelihood((FrfRecord(model, measurement, data),))


def frf_identifiability(
    model: StructuralModel, measurement: FrfMeasurement, truth: StructuralModel | None = None
) -> Result:
    """Return the identifiability of the unknown joint parameters from responses, by their Fisher information.

    Parameters
    ----------
    model, measurement, truth
        As of `dynid.identification.frf.identify.identify_frf`.

    Returns
    -------
    Result
        As of `dynid.identification.identifiability.identifiability`; there is no initial state to know. The
        deviation of the noise is that of real and imaginary part each, over the deviation by line where that
        is given.
    """
    names = [unknown.name for unknown in model.unknowns]
    with guarded(f"the identifiability of {', '.join(names)}", names=names):
        likelihood = likelihood_of(model, measurement, frf_data(truth or model, measurement))
        channels = [(frf.name, frf.unit) for frf in measurement.channels]
        return identifiability_result(model, expected_records(likelihood), channels)
