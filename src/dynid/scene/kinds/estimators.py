"""Estimators of a scene."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dynid.identification.estimators.estimate import Estimator
    from dynid.scene.schema.identification import EstimatorModel

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
