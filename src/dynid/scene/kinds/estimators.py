"""Estimators of a scene, and what it requests beside the estimates."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynid.identification.estimators.estimate import Estimator
    from dynid.identification.write_result import Further
    from dynid.scene.schema.identification import EstimatorModel, IdentificationScene

#: Module and class of every estimator; only the requested one is imported.
_ESTIMATORS = {
    "auto": ("auto", "Auto"),
    "filter": ("filter_passes", "Filter"),
    "output-error": ("maximum_likelihood", "OutputError"),
    "invariant-imbedding": ("imbedding", "InvariantImbedding"),
}


def estimator_of(given: EstimatorModel) -> Estimator:
    """Return the estimator of records of time."""
    module, name = _ESTIMATORS[given.method]
    kind = getattr(import_module(f"dynid.identification.estimators.{module}"), name)
    estimator: Estimator = kind(**given.options())
    if given.loss == "huber":
        from dynid.identification.estimators.maximum_likelihood import Huber

        estimator = Huber(estimator)
    return estimator


def frf_estimator_of(given: EstimatorModel) -> Any:
    """Return the estimator of frequency responses."""
    from dynid.identification.estimators.auto import FrfAuto
    from dynid.identification.estimators.maximum_likelihood import Huber, OutputError

    options: dict[str, Any] = given.options()
    method = OutputError(**options) if given.method == "output-error" else FrfAuto()
    return Huber(method) if given.loss == "huber" else method


def modal_estimator_of(given: EstimatorModel) -> Any:
    """Return the estimator of measured modes, alone or with others."""
    from dynid.identification.estimators.maximum_likelihood import OutputError
    from dynid.identification.estimators.modal_search import ModalSearch

    options: dict[str, Any] = given.options()
    return OutputError(**options) if given.method == "output-error" else ModalSearch()


def further_of(model: IdentificationScene) -> Further:
    """Return what a scene requests beside the estimates; responses are at the frequencies of its analysis."""
    from dynid.identification.write_derived import DerivedRequest
    from dynid.identification.write_result import Further
    from dynid.scene.kinds.signals import angular_frequencies

    if model.derived is None:
        return Further(check=model.posterior_check)
    analysis = model.responses or model.graph_analysis
    grid = analysis.frequency if analysis else None
    omega = None if grid is None else angular_frequencies(grid)
    return Further(DerivedRequest(tuple(model.derived), omega), model.posterior_check)
