"""Identification from measured modes, alone or together with records of time or frequency responses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Self

from dynid.errors import UsageError
from dynid.identification.diagnosis.form_error import needed_form_error
from dynid.identification.estimators.modal_search import ModalSearch
from dynid.identification.estimators.origin import identifiable_origin
from dynid.identification.identify import models_of_records, posterior_of, raise_if_rejected
from dynid.identification.likelihood.frf_record import frf_likelihood
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.modal_record import (
    ModalLikelihood,
    ModalRecord,
    start_values,
)
from dynid.identification.likelihood.paired_modes import is_large, modal_model, modes_needed
from dynid.identification.likelihood.record_likelihood import RecordLikelihood
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.frf_measurement import FrfMeasurement
from dynid.identification.records.measurement import Experiment, RecordData
from dynid.identification.records.modal_measurement import ModalMeasurement
from dynid.identification.results.write_modes import add_modes
from dynid.identification.results.write_result import Further, add_identification
from dynid.identification.systems.frf_system import frf_data
from dynid.identification.systems.parametric_model import Rebuild, unknowns_of
from dynid.identification.systems.record_values import data
from dynid.lti.floating import guarded
from dynid.result import Result
from dynid.structure.model import StructuralModel


@dataclass(frozen=True, eq=False)
class ModalProblem:
    """Measured modes, alone or with records, and the models that they are identified with.

    Attributes
    ----------
    full
        The structure as it is given; sparse where it is large.
    model
        The model that the estimator begins with.
    likelihood
        The likelihood of all records with it.
    rebuild
        Returns the model for parameters by name; None where it stays.
    likelihood_of
        Returns the likelihood of given values of the records with another model.
    """

    full: StructuralModel
    model: StructuralModel
    likelihood: Likelihood
    rebuild: Rebuild | None
    likelihood_of: Callable[[StructuralModel, Sequence[RecordData]], Likelihood]

    @classmethod
    def of(
        cls,
        model: StructuralModel,
        modal: ModalMeasurement,
        experiments: Sequence[Experiment] = (),
        responses: FrfMeasurement | None = None,
        *,
        truth: StructuralModel | None = None,
        rebuild: Rebuild | None = None,
    ) -> Self:
        """Return the problem; parameters and errors as of `identify_modes`."""
        if experiments and responses is not None:
            raise UsageError(
                "modes are identified with records of time or with frequency responses, not with both",
                remedy="Leave one of them out.",
                names=("measurement.frf",),
            )
        alone = not experiments and responses is None
        start, full = start_values(model), model
        if alone and is_large(model) and not model.is_sparse and model.basis is None:
            full = model.stored_sparse()
        count = modes_needed(full, modal, start)
        if alone and rebuild is None and is_large(full):
            rebuild = partial(modal_model, full, modal, count=count)
            model = rebuild(start)

        def likelihood_of(other: StructuralModel, given: Sequence[RecordData]) -> Likelihood:
            waves = 0 if alone else len(experiments) or 1
            measured = ModalRecord.of(other, modal, count, sharing=waves + 1)
            if alone:
                return ModalLikelihood((measured,))
            records: list[RecordLikelihood] = []
            if responses is not None:
                found = frf_likelihood(other, responses, given[0]).records[0].first_weighted()
                records.append(replace(found, sharing=waves + 1))
            else:  # the values of the modes, the last ones, are those of the measurement
                models = models_of_records(other, experiments)
                each = zip(models, given[: len(experiments)], experiments, strict=True)
                records += [TimeRecord.of(own, values, taken, waves + 1) for own, values, taken in each]
            return Likelihood((*records, measured))

        given = [data(truth or full, *experiment) for experiment in experiments]
        if responses is not None:
            given = [frf_data(truth or full, responses)]
        return cls(full, model, likelihood_of(model, given), rebuild, likelihood_of)


def identify_modes(
    model: StructuralModel,
    modal: ModalMeasurement,
    experiments: Sequence[Experiment] = (),
    responses: FrfMeasurement | None = None,
    estimator: Any = None,
    *,
    truth: StructuralModel | None = None,
    rebuild: Rebuild | None = None,
    further: Further | None = None,
) -> Result:
    """Identify the unknown parameters of a structure from measured modes.

    Parameters
    ----------
    model
        The structure the estimator works with, full or reduced. Where modes stand alone, a large one is
        reduced to its lowest modes and their derivatives, and this basis follows the parameters.
    modal
        The measured modes.
    experiments, responses
        Records of time, or frequency responses, not both, that share the parameters.
    estimator
        How to estimate; absent: `ModalSearch()`.
    truth
        The structure that simulated records are made with; absent: `model`.
    rebuild, further
        As of `identify_all`.

    Returns
    -------
    Result
        ``identification/…``: the groups that `dynid.identification.results.write_result` describes, and
        ``modes/``, which `dynid.identification.results.write_modes` does.

    Raises
    ------
    UsageError
        If there are both `experiments` and `responses`.
    DynidError
        As of `identify_all` and `identify_frf`.
    """
    names = [unknown.name for unknown in unknowns_of(model)]
    with guarded(f"the identification of {', '.join(names)}", names=names):
        problem = ModalProblem.of(model, modal, experiments, responses, truth=truth, rebuild=rebuild)
        posterior, _ = posterior_of(
            problem.model,
            problem.model,
            problem.likelihood,
            identifiable_origin(problem.likelihood),
            estimator or ModalSearch(),
            problem.rebuild,
            problem.likelihood_of,
            [],
        )
        at_start = problem.likelihood.records[-1]
        assert isinstance(at_start, ModalRecord)
        raise_if_rejected(
            posterior,
            lambda result, rejected: add_modes(result, rejected, problem.full, at_start, problem.rebuild),
        )
        needed = needed_form_error(posterior)
        if needed is not None:
            posterior = replace(posterior, mistakes=(*posterior.mistakes, needed.statement))
        result = add_identification(Result("identification"), posterior, further=further)
        return add_modes(result, posterior, problem.full, at_start, problem.rebuild, needed)
