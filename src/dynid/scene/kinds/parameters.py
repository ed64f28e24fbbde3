"""Unknown and considered parameters of a scene, and their estimators."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

from pydantic import BaseModel

from dynid.errors import SceneError, UsageError
from dynid.scene.schema.base import DefinedParameter
from dynid.scene.schema.quantities import AT_KEY, Quantity

if TYPE_CHECKING:
    from dynid.arithmetic.numbers import Number
    from dynid.identification.results.write_result import Further
    from dynid.parameters import Parameter, ParameterPrior
    from dynid.scene.load import Scene
    from dynid.scene.schema.base import SceneModel
    from dynid.scene.schema.identification import IdentificationScene


M = TypeVar("M", bound="SceneModel")


class ConsideredParameter(NamedTuple):
    """A parameter that is known with uncertainty: its value, and its standard deviation."""

    name: str
    value: float
    std: float


def unknown_parameters(model: SceneModel) -> tuple[Parameter, ...]:
    """Return the unknown parameters of a scene in its order; those of joints are not among them.

    One without a `scale` is linear where an offset or a delay depends on it, else logarithmic.

    Raises
    ------
    UsageError
        If a number does not fit the scale; it names the parameter.
    """
    from dynid.parameters import Parameter  # loads NumPy

    unknown = {
        name: given
        for name, given in model.parameters.items()
        if isinstance(given, DefinedParameter) and given.start is not None
    }
    linear: frozenset[str] = frozenset()
    if any(given.scale is None for given in unknown.values()):
        linear = linear.union(
            *(one.dependent.names for key, one in quantities(model) if key in _SIGNED and one.dependent)
        )
    return tuple(
        Parameter(
            name,
            float(given.start or 0),
            _number(given.true),
            _number(given.min),
            _number(given.max),
            _prior(given),
            given.scale or ("linear" if name in linear else "log"),
        )
        for name, given in unknown.items()
    )


def considered_parameters(model: SceneModel) -> tuple[ConsideredParameter, ...]:
    """Return the parameters of a scene that are known with uncertainty, in its order."""
    return tuple(
        ConsideredParameter(name, float(given.value), float(given.std))
        for name, given in model.parameters.items()
        if isinstance(given, DefinedParameter) and given.value is not None and given.std is not None
    )


def check_parameters(scene: Scene[IdentificationScene]) -> None:
    """Check the unknown parameters of an identification.

    Raises
    ------
    SceneError
        If a number does not fit the scale of its parameter, or nothing depends on an unknown one.
    """
    model = scene.model
    if not any(isinstance(given, DefinedParameter) for given in model.parameters.values()):
        return
    used: set[str] = set()
    for _, quantity in quantities(model):
        if quantity.dependent is not None:
            used |= quantity.dependent.names
    message = "nothing depends on this unknown parameter; name it in a quantity of the model, or leave it out"
    if model.measurement is not None:
        scene.raise_faults(
            (("parameters", name, AT_KEY), message)
            for name, entry in model.parameters.items()
            if isinstance(entry, DefinedParameter) and entry.start is not None and name not in used
        )
    try:
        unknown_parameters(model)
    except UsageError as error:
        raise SceneError([scene.locate(error)]) from None


def all_parameters(model: SceneModel) -> tuple[Parameter, ...]:
    """Return the unknown parameters of a scene, and those that are known with uncertainty after them."""
    from dynid.parameters import Parameter

    known = (
        Parameter(
            one.name,
            one.value,
            one.value,
            scale="log" if one.value > 0 else "linear",
            std=one.std,
        )
        for one in considered_parameters(model)
    )
    return (*unknown_parameters(model), *known)


#: Keys of quantities that may have any sign, and so have no logarithm.
_SIGNED = ("offset", "delay")


def quantities(part: Any, key: str = "") -> Iterator[tuple[str, Quantity]]:
    """Yield the quantities in a part of a scene at any depth, each with the key that it stands under."""
    if isinstance(part, Quantity):
        yield key, part
    elif isinstance(part, BaseModel):
        for name, value in part:
            yield from quantities(value, name)
    elif isinstance(part, Mapping):
        for value in part.values():
            yield from quantities(value, key)
    elif isinstance(part, list | tuple):
        for value in part:
            yield from quantities(value, key)


def at_starts(model: M) -> M:
    """Return a scene whose quantities have the unknown parameters' starts for reference values.

    What an estimator computes at reference values, such as a basis, must not know the true ones.
    """
    starts = {
        name: given.start.value
        for name, given in model.parameters.items()
        if isinstance(given, DefinedParameter) and given.start is not None and given.true is not None
    }
    return cast("M", _referred(model, starts)) if starts else model


def _referred(part: Any, values: Mapping[str, Number]) -> Any:
    """Return a part of a scene with other reference values of parameters."""

    def changed(quantity: Quantity) -> Quantity:
        if quantity.dependent is None or quantity.dependent.names.isdisjoint(values):
            return quantity
        found = quantity.dependent.referred(values)
        return Quantity(found.reference, quantity.expression, found)

    return with_quantities(part, changed)


def with_quantities(part: Any, change: Callable[[Quantity], Quantity]) -> Any:
    """Return a part of a scene with changed quantities at any depth; itself where none is."""
    if isinstance(part, Quantity):
        return change(part)
    if isinstance(part, BaseModel):
        own = {name: (value, with_quantities(value, change)) for name, value in part}
        changed = {name: new for name, (old, new) in own.items() if new is not old}
        return part.model_copy(update=changed) if changed else part
    if isinstance(part, Mapping):
        return {name: with_quantities(value, change) for name, value in part.items()}
    if isinstance(part, list | tuple):
        parts = [with_quantities(value, change) for value in part]
        return part if all(map(operator.is_, parts, part)) else type(part)(parts)
    return part


def _number(given: Quantity | None) -> float | None:
    return None if given is None else float(given)


def _prior(given: DefinedParameter) -> ParameterPrior | None:
    from dynid.parameters import ParameterPrior

    prior = given.prior
    if prior is None:
        return None
    if prior.relative_deviation is not None:
        return ParameterPrior(float(prior.value), float(prior.relative_deviation))
    assert prior.std is not None
    return ParameterPrior(float(prior.value), deviation=float(prior.std))


#: Module and class of every estimator; only the requested one is imported.
_ESTIMATORS = {
    "auto": ("auto", "Auto"),
    "filter": ("filter_passes", "Filter"),
    "output-error": ("maximum_likelihood", "OutputError"),
    "invariant-imbedding": ("imbedding", "InvariantImbedding"),
}


def estimator_of(model: IdentificationScene) -> Any:
    """Return the estimator of an identification."""
    given, measurement = model.estimator, model.measurement
    module, name = _ESTIMATORS[given.method]
    if given.method == "auto" and measurement is not None and measurement.modes is not None:
        module, name = "modal_search", "ModalSearch"
    elif given.method == "auto" and measurement is not None and measurement.frf is not None:
        name = "FrfAuto"
    kind = getattr(import_module(f"dynid.identification.estimators.{module}"), name)
    estimator = kind(**given.options())
    if given.loss == "huber":
        from dynid.identification.estimators.maximum_likelihood import Huber

        estimator = Huber(estimator)
    return estimator


def further_of(model: IdentificationScene) -> Further:
    """Return what a scene requests beside the estimates; responses are at the frequencies of its analysis."""
    from dynid.identification.results.write_derived import DerivedRequest
    from dynid.identification.results.write_result import Further
    from dynid.scene.kinds.signals import angular_frequencies

    if model.derived is None:
        return Further(check=model.posterior_check)
    analysis = model.responses or model.graph_analysis
    grid = analysis.frequency if analysis else None
    omega = None if grid is None else angular_frequencies(grid)
    return Further(DerivedRequest(tuple(model.derived), omega), model.posterior_check)
