"""Unknown and considered parameters of a scene, and their estimators."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeVar, cast

from pydantic import BaseModel

from dynid.errors import SceneError, UsageError
from dynid.scene.schema.base import DefinedParameter, SceneModel
from dynid.scene.schema.quantities import AT_KEY, Quantity

if TYPE_CHECKING:
    from dynid.identification.results.write_result import Further
    from dynid.parameters import Parameter, ParameterPrior
    from dynid.scene.load import Scene
    from dynid.scene.schema.identification import IdentificationScene


M = TypeVar("M", bound="SceneModel")


def unknown_parameters(model: SceneModel) -> tuple[Parameter, ...]:
    """Return the unknown parameters of a scene in its order; those of joints are not among them.

    One without a `scale` is linear where an offset, a delay or a drift of an instrument depends on it, else
    logarithmic, as the delay of a loop is positive. Raises `UsageError` if a number does not fit the scale;
    it names the parameter.
    """
    from dynid.parameters import Parameter  # loads NumPy

    entries = model.parameters.items()
    defined = {name: entry for name, entry in entries if isinstance(entry, DefinedParameter)}
    unknown = {name: entry for name, entry in defined.items() if entry.start is not None}
    linear: frozenset[str] = frozenset()
    if any(entry.scale is None for entry in unknown.values()):
        parts = (value for name, value in model if name != "control")
        linear = linear.union(
            *(
                quantity.dependent.names
                for key, quantity in chain.from_iterable(map(quantities, parts))
                if key in _SIGNED and quantity.dependent
            )
        )
    return tuple(
        Parameter(
            name,
            float(entry.start or 0),
            _number(entry.true),
            _number(entry.min),
            _number(entry.max),
            _prior(entry),
            entry.scale or ("linear" if name in linear else "log"),
        )
        for name, entry in unknown.items()
    )


def check_parameters(scene: Scene[IdentificationScene]) -> None:
    """Check the unknown parameters of an identification.

    Raises `SceneError` if a number does not fit the scale of its parameter, or nothing depends on an unknown
    one.
    """
    model = scene.model
    if not any(isinstance(parameter, DefinedParameter) for parameter in model.parameters.values()):
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

    considered = (
        Parameter(name, value, value, scale="log" if value > 0 else "linear", std=float(entry.std))
        for name, entry in model.parameters.items()
        if isinstance(entry, DefinedParameter) and entry.value is not None and entry.std is not None
        for value in (float(entry.value),)
    )
    return (*unknown_parameters(model), *considered)


#: Keys of quantities that may have any sign, and so have no logarithm.
_SIGNED = ("offset", "delay", "drift")


def quantities(section: Any, key: str = "") -> Iterator[tuple[str, Quantity]]:
    """Yield the quantities in a part of a scene at any depth, each with the key that it stands under."""
    if isinstance(section, Quantity):
        yield key, section
    elif isinstance(section, BaseModel):
        for name, value in section:
            yield from quantities(value, name)
    elif isinstance(section, Mapping):
        for value in section.values():
            yield from quantities(value, key)
    elif isinstance(section, list | tuple):
        for value in section:
            yield from quantities(value, key)


def at_starts(model: M) -> M:
    """Return a scene whose quantities have the unknown parameters' starts for reference values.

    What an estimator computes at reference values, such as a basis, must not know the true ones.
    """
    starts = {
        name: entry.start.value
        for name, entry in model.parameters.items()
        if isinstance(entry, DefinedParameter) and entry.start is not None and entry.true is not None
    }

    def changed(quantity: Quantity) -> Quantity:
        if quantity.dependent is None or quantity.dependent.names.isdisjoint(starts):
            return quantity
        dependent = quantity.dependent.referred(starts)
        return Quantity(dependent.reference, quantity.expression, dependent)

    return cast("M", with_quantities(model, changed)) if starts else model


def with_quantities(section: Any, change: Callable[[Quantity], Quantity]) -> Any:
    """Return a part of a scene with changed quantities at any depth; itself where none is."""
    if isinstance(section, Quantity):
        return change(section)
    if isinstance(section, BaseModel):
        fields = {name: (value, with_quantities(value, change)) for name, value in section}
        changed = {name: new for name, (old, new) in fields.items() if new is not old}
        return section.model_copy(update=changed) if changed else section
    if isinstance(section, Mapping):
        return {name: with_quantities(value, change) for name, value in section.items()}
    if isinstance(section, list | tuple):
        parts = [with_quantities(value, change) for value in section]
        return section if all(map(operator.is_, parts, section)) else type(section)(parts)
    return section


def _number(quantity: Quantity | None) -> float | None:
    return None if quantity is None else float(quantity)


def _prior(entry: DefinedParameter) -> ParameterPrior | None:
    from dynid.parameters import ParameterPrior

    if (prior := entry.prior) is None:
        return None
    deviations = {"relative_deviation": prior.relative_deviation, "deviation": prior.std}
    stated = {key: float(value) for key, value in deviations.items() if value is not None}
    return ParameterPrior(float(prior.value), **stated)


#: Module and class, or function, of every estimator; only the requested one is imported.
_ESTIMATORS = {
    "auto": ("auto", "Auto"),
    "filter": ("filter_passes", "Filter"),
    "sigma-point": ("filter_passes", "sigma_point_filter"),
    "output-error": ("maximum_likelihood", "OutputError"),
    "invariant-imbedding": ("imbedding", "InvariantImbedding"),
}


def estimator_of(model: IdentificationScene) -> Any:
    """Return the estimator of an identification."""
    options = model.estimator
    module, name = _ESTIMATORS[options.method]
    kind = getattr(import_module(f"dynid.identification.estimators.{module}"), name)
    estimator = kind(**options.options())
    if options.loss == "huber":
        from dynid.identification.estimators.maximum_likelihood import Huber

        estimator = Huber(estimator)
    return estimator


def further_of(model: IdentificationScene) -> Further:
    """Return what a scene requests beside the estimates; responses are at the frequencies of its analysis."""
    from dynid.identification.results.write_derived import DerivedRequest
    from dynid.identification.results.write_result import Further
    from dynid.scene.kinds.signals import angular_frequencies

    if model.derived is None:
        return Further(check=model.posterior_check, laws=tuple(model.estimator.laws))
    analysis = model.structure_analysis or model.graph_analysis
    grid = analysis.frequency if analysis else None
    omega = None if grid is None else angular_frequencies(grid)
    request = DerivedRequest(tuple(model.derived), omega)
    return Further(request, model.posterior_check, tuple(model.estimator.laws))
