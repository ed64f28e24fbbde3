"""Unknown parameters of a model, and the coordinates in which they are estimated.

Estimators work with coordinates eta: the logarithm of a parameter that is positive (`scale` log), or the
parameter itself (`scale` linear), which may have any sign.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import UsageError

Scale = Literal["log", "linear"]


class ParameterPrior(NamedTuple):
    """Prior of an unknown parameter: its expected value and its standard deviation."""

    value: float
    relative_deviation: float = math.nan  # standard deviation over the expected value
    deviation: float = math.nan  # in the parameter's unit, instead of the relative one

    @property
    def relative(self) -> float:
        """Standard deviation over the expected value."""
        deviation = self.relative_deviation
        return deviation if not math.isnan(deviation) else self.deviation / abs(self.value)

    @property
    def absolute(self) -> float:
        """Standard deviation in the parameter's unit."""
        return self.deviation if not math.isnan(self.deviation) else self.relative_deviation * abs(self.value)


@dataclass(frozen=True)
class Parameter:
    """An unknown parameter.

    Raises `UsageError` if a number is not finite, not positive with `scale` log, or the start is not within
    the limits.
    """

    name: str  # in a scene and in results
    start: float  # initial guess
    true: float | None = None  # where it is known: what simulated records are made with
    low: float | None = None  # limits, within which the start lies
    high: float | None = None
    prior: ParameterPrior | None = None
    scale: Scale = "log"  # `log`: positive, its logarithm is estimated; `linear`: of any sign
    unit: str = ""  # in SI; empty where it is not known or there is none
    #: Standard deviation of the coordinate that a first guess may be off by, of `scale` linear.
    spread: float | None = None
    #: Standard deviation of a parameter that is known with uncertainty ("considered"): it is not estimated,
    #: and `start` is its value.
    std: float | None = None

    def __post_init__(self) -> None:
        numbers = [self.start, self.true, self.low, self.high, self.prior and self.prior.value]
        for number in numbers:
            if number is not None and not math.isfinite(number):
                raise self._refused("has a number that is not finite")
            if number is not None and self.scale == "log" and number <= 0:
                raise self._refused(
                    "is estimated by its logarithm, and has a number that is not positive",
                    "Write `scale: linear` where zero or negative values are possible.",
                )
        low, high = (
            (-math.inf if self.low is None else self.low),
            (math.inf if self.high is None else self.high),
        )
        if not low <= self.start <= high:
            raise self._refused("starts outside its limits")
        if self.prior is not None and not self.prior.absolute > 0:
            raise self._refused("has a prior without a positive standard deviation")

    def _refused(self, what: str, remedy: str = "") -> UsageError:
        return UsageError(f"the parameter {self.name} {what}", remedy=remedy, names=(self.name,))

    @property
    def expected(self) -> float:
        """The true value where it is known, else the start."""
        return self.start if self.true is None else self.true

    @property
    def logarithmic(self) -> bool:
        """True if its logarithm is estimated."""
        return self.scale == "log"

    @property
    def first_spread(self) -> float:
        """Standard deviation of the coordinate that a first guess may be off by.

        Of a logarithm 2, a factor of e squared. Of a linear parameter as given, else that of its prior, else
        the span of its limits over 4, else twice its size, or 1 where it starts at 0.
        """
        if self.logarithmic:
            return 2.0
        if self.spread is not None:
            return self.spread
        if self.prior is not None:
            return self.prior.absolute
        if self.low is not None and self.high is not None:
            return (self.high - self.low) / 4
        return 2 * abs(self.start) or 1.0

    @property
    def deviation(self) -> float:
        """Standard deviation of the coordinate of a considered parameter, to first order."""
        std = self.std or 0.0
        return std / self.start if self.logarithmic else std

    def freed(self) -> Parameter:
        """Return a considered parameter as one that is unknown."""
        return replace(self, std=None)

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        return math.log(value) if self.logarithmic else value

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate."""
        return math.exp(coordinate) if self.logarithmic else coordinate


def starts(parameters: Sequence[Parameter]) -> Array:
    """Return the coordinates of the starts (p)."""
    return np.array([parameter.coordinate(parameter.start) for parameter in parameters])


def truths(parameters: Sequence[Parameter]) -> Array:
    """Return the true values (p), NaN where they are not known."""
    return np.array([math.nan if parameter.true is None else parameter.true for parameter in parameters])


def logarithmic(parameters: Sequence[Parameter]) -> NDArray[np.bool_]:
    """Return the mask of parameters whose logarithms are estimated (p)."""
    return np.array([parameter.logarithmic for parameter in parameters], dtype=bool)


def coordinates(parameters: Sequence[Parameter], values: Array) -> Array:
    """Return the coordinates (… x p) of values."""
    log = logarithmic(parameters)
    return np.where(log, np.log(np.where(log, values, 1.0)), values)


def values(parameters: Sequence[Parameter], eta: Array) -> Array:
    """Return the values (… x p) at coordinates."""
    log = logarithmic(parameters)
    return np.where(log, np.exp(np.where(log, eta, 0.0)), eta)


def rates(parameters: Sequence[Parameter], eta: Array) -> Array:
    """Return the derivatives of the values by their coordinates (… x p): the value itself, or 1."""
    log = logarithmic(parameters)
    return np.where(log, np.exp(np.where(log, eta, 0.0)), 1.0)


def named(parameters: Sequence[Parameter], eta: Array) -> dict[str, float]:
    """Return the values at coordinates (p) by name."""
    return dict(
        zip([parameter.name for parameter in parameters], values(parameters, eta).tolist(), strict=True)
    )


def expected(parameters: Sequence[Parameter]) -> Mapping[str, float]:
    """Return the true values where they are known, else the starts, by name."""
    return {parameter.name: parameter.expected for parameter in parameters}


def true_values(parameters: Sequence[Parameter]) -> dict[str, float]:
    """Return the true values by name; raises `UsageError` if one is not known."""
    missing = [parameter.name for parameter in parameters if parameter.true is None]
    if missing:
        raise UsageError(
            f"no true value is known of {', '.join(missing)}",
            remedy="Give `true` beside `start`: records are simulated with it.",
            names=missing,
        )
    return {parameter.name: parameter.expected for parameter in parameters}
