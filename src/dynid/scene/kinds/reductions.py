"""From a scene's reductions to the methods that make them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.choices import RESIDUALS
from dynid.errors import NumericalError, UsageError
from dynid.scene.schema.common import ChirpSignal, MultisineSignal, RandomSignal, SineSignal
from dynid.scene.schema.reductions import DynamicModel, JointAwareModel, MastersModel, ModesModel, in_radians
from dynid.structure.reduction.joint_aware import JointAware
from dynid.structure.reduction.masters import Masters
from dynid.structure.reduction.methods import METHODS, Reductor
from dynid.structure.reduction.selection import Interest, ModeRange

if TYPE_CHECKING:
    from dynid.scene.schema.common import SignalPart
    from dynid.scene.schema.reductions import Reduction
    from dynid.structure.model import StructuralModel
    from dynid.structure.reduction.reduction import Reduction as Reduced


class LocatedReductor:
    """A method, whose errors name its place in the scene."""

    def __init__(self, method: Reductor, place: str) -> None:
        self.method = method
        self.place = place

    def reduce(self, model: StructuralModel) -> Reduced:
        """Reduce a structure, as the method does."""
        with _placed(self.place):
            return self.method.reduce(model)

    def at(self, values: Mapping[str, float]) -> LocatedReductor:
        """Return the method for these values of the joints, where its basis depends on them."""
        if isinstance(self.method, JointAware):
            return LocatedReductor(self.method.at(values), self.place)
        return self

    @property
    def follows_joints(self) -> bool:
        """Whether the basis depends on the values of unknown joints."""
        return isinstance(self.method, JointAware)


def build_reductor(part: Reduction, interest: Interest, place: str) -> LocatedReductor:
    """Build a reduction method from its part of a scene.

    Parameters
    ----------
    part
        The part.
    interest
        What the reduced model is for.
    place
        The dotted path of the part in the scene.
    """
    skipped = {"method", "unit"}
    given = {name: getattr(part, name) for name in type(part).model_fields if name not in skipped}
    options = {name: _option(value) for name, value in given.items() if value is not None}
    if isinstance(part, DynamicModel) and part.frequency is not None:
        options["frequency"] = in_radians(float(part.frequency), part.unit)
    with _placed(place):
        return LocatedReductor(METHODS[part.method](**options, interest=interest), place)


def with_residuals(part: Reduction) -> Reduction:
    """Return a reduction with residual vectors at the joints, where its scene leaves that open."""
    if isinstance(part, JointAwareModel) and part.masters is None and part.residuals is None:
        return part.model_copy(update={"residuals": RESIDUALS.value})
    return part


def read_reduction(data: Mapping[str, Any]) -> Reduction:
    """Return a part of a scene that describes a reduction in numbers and words alone."""
    from pydantic import TypeAdapter

    from dynid.scene.schema import reductions

    part: Reduction = TypeAdapter(reductions.Reduction).validate_python(data)
    return part


def _option(value: Any) -> Any:
    if value == "none":
        return ()
    if isinstance(value, MastersModel):
        return Masters(value.count, value.choose)
    if isinstance(value, ModesModel):
        below = None if value.below is None else in_radians(float(value.below), value.unit)
        return ModeRange(value.count, below)
    return value


@contextmanager
def _placed(place: str) -> Iterator[None]:
    """Name the place of the key that an error is about, else that of the reduction."""
    try:
        yield
    except (UsageError, NumericalError) as error:
        names = [f"{place}.{name}" for name in error.names]
        raise type(error)(error.problem, remedy=error.remedy, names=(*names, f"{place}.method")) from error


def band_of(signals: Sequence[SignalPart], step: float) -> float:
    """Return the highest frequency that signals excite, rad/s; what has no end goes to Nyquist's.

    Parameters
    ----------
    signals
        The signals.
    step
        Sampling step, s.
    """
    nyquist = math.pi / step
    return min(nyquist, max((_highest(part) for part in signals), default=nyquist))


def _highest(part: SignalPart) -> float:
    given = part.parameters()
    if isinstance(part, ChirpSignal):
        return float(max(given["start"], given["stop"]))
    if isinstance(part, RandomSignal):
        return float(given["band"][1]) if part.band else math.inf
    if isinstance(part, SineSignal | MultisineSignal):
        return float(np.max(given["frequency"]))
    return math.inf
