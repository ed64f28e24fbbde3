"""Signals as outputs of autonomous linear systems.

Between its breakpoints every signal is ``u = h w`` with ``w' = G w`` and a state w(t) known in closed
form. Joined with this generator a driven linear system is autonomous, so one matrix exponential
propagates it exactly over any step, also at an undamped resonance.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from dynid.arrays import Array
from dynid.errors import UsageError

TAYLOR_DEGREE = 18
"""Degree of Taylor polynomials: where (frequency x step) <= 1 the first omitted term is 1/19! = 8e-18."""


@dataclass(frozen=True)
class RecordTimes:
    """The sampling times of a record, over which a chirp sweeps and which a random signal fills."""

    step: float  # sampling step, s
    samples: int  # number of samples from `start` on
    start: float = 0.0  # time of the first sample, s; the time before it, from t = 0 on, is settling time

    def __post_init__(self) -> None:
        require(0 < self.step < math.inf, "a record's step must be positive and finite", names=("step",))
        require(self.samples >= 1, "a record needs at least one sample", names=("samples",))
        require(0 <= self.start < math.inf, "a record cannot start before t = 0", names=("settle",))
        last = self.start + self.step * self.samples
        require(
            math.isfinite(last) and self.start + self.step > self.start and last > last - self.step,
            f"the samples of a record coincide: a step of {self.step:g} s is lost to rounding at {last:g} s",
            "Lengthen the step, or settle for a shorter time.",
            names=("step",),
        )

    @property
    def duration(self) -> float:
        """Time from the first sample to the last, s."""
        return (self.samples - 1) * self.step

    @property
    def times(self) -> Array:
        """The sampling times, s."""
        return np.asarray(self.start + np.arange(self.samples) * self.step)


class Signal(ABC):
    """A signal as propagation uses it, by default without jump, breakpoint or limit on the step.

    `kind` is its name in scenes, `pace` the key that sets `longest_step`; errors name both.
    """

    kind: ClassVar[str] = "signal"
    pace: ClassVar[str] = "frequency"

    @property
    def jump(self) -> float:
        """Strength of the Dirac impulse at t = 0 (unit of u times s)."""
        return 0.0

    @property
    def longest_step(self) -> float:
        """Longest step, s, over which the generator is exact to rounding."""
        return math.inf

    @abstractmethod
    def generator(self) -> tuple[Array, Array]:
        """Return G (p x p) and h (p)."""

    @abstractmethod
    def states(self, times: Array, middles: Array) -> Array:
        """Return the generator states (times x p) of the pieces that hold the times `middles`."""

    def breakpoints(self, start: float, stop: float) -> Array:  # noqa: ARG002
        """Return the times in [start, stop] at which the generator's state is reset."""
        return np.empty(0)

    def value(self, times: ArrayLike) -> Array:
        """Return u at `times` (right-hand limits at jumps; an impulse's Dirac part is not shown)."""
        t = np.asarray(times, dtype=float)
        flat = t.ravel()
        return np.asarray((self.states(flat, flat) @ self.generator()[1]).reshape(t.shape))


def polynomial_generator(degree: int, tau: float) -> tuple[Array, Array]:
    """Return G and h of a polynomial whose state is ``tau^j u^(j)``."""
    h = np.zeros(degree + 1)
    h[0] = 1.0
    return np.eye(degree + 1, k=1) / tau, h


def inside(points: Array, start: float, stop: float) -> Array:
    """Return the points in [start, stop]."""
    return points[(points >= start) & (points <= stop)]


def require(condition: bool, problem: str, remedy: str = "", names: Iterable[str] = ()) -> None:
    """Raise a `UsageError` unless the condition holds."""
    if not condition:
        raise UsageError(problem, remedy=remedy, names=names)


def require_finite(kind: str, **numbers: ArrayLike) -> None:
    """Raise a `UsageError` unless all numbers of a signal are finite; it names the kind and the key."""
    for name, value in numbers.items():
        if not np.all(np.isfinite(np.asarray(value, dtype=float))):
            raise UsageError(f"the {name} of a signal of kind {kind} must be finite", names=(kind, name))
