# ruff: noqa: ARG002 - the methods of `Law` have the arguments that those of some law need
"""What a law of a joint is: the force over deflection d, its rate v and a hidden state z, in smooth regimes.

A law is a class of value, slopes, guards and tangent. Within a regime all its functions are smooth; the
regime ends where a guard is no longer positive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import numpy as np

Values = Sequence[float]
"""Values of the parameters of a law, in the order of its `names`."""

#: Points of a cycle over which work is summed: of smooth laws exact, of others to 1e-3.
CYCLE_POINTS = 360


class Slopes(NamedTuple):
    """A function of d, v, z and the parameters, with its derivatives; numbers, or arrays over nodes."""

    value: Any
    d: Any = 0.0
    v: Any = 0.0
    z: Any = 0.0
    p: Sequence[Any] = ()


class Guard(NamedTuple):
    """A function that is positive within a regime, and the regime where it is no longer."""

    function: Slopes
    following: int


class Law:
    """A law without regimes and without a hidden state."""

    kind: ClassVar[str]
    names: tuple[str, ...]  # its parameters
    signed: tuple[str, ...] = ()  # those that may be negative: estimated themselves, not as logarithms
    units: tuple[str, ...] = ()  # of the parameters, over a translation; empty: not known
    code: ClassVar[int] = 0  # the law's number in `native/march.c`; 0: NumPy alone has it
    hidden: ClassVar[bool] = False  # True if it has a hidden state
    preloaded: ClassVar[bool] = True  # True if an offset of the joint shifts its deflection
    remembers: ClassVar[bool] = False  # True if its branches follow Masing's rules: see `nonlinear/memory.py`
    options: tuple[float, ...] = ()  # its numbers that are no parameters, as the march in C takes them
    lowest: ClassVar[Mapping[str, float]] = MappingProxyType({})  # limits of unknowns that may be negative

    def force(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        """Return the force on the joint's ends, positive where it resists a positive deflection."""
        raise NotImplementedError

    def rate(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Slopes | None:
        """Return the rate of the hidden state; None where it is constant within the regime."""
        return None

    def regime(self, p: Values, d: float, v: float, z: float) -> int:
        """Return the regime in which a motion starts."""
        return 0

    def guards(self, p: Values, regime: int, d: Any, v: Any, z: Any) -> Sequence[Guard]:
        """Return the guards of a regime."""
        return ()

    def tangent(self, p: Values, regime: int) -> tuple[float, float]:
        """Return the stiffness and damping of a regime that the march takes into the linear rest."""
        return 0.0, 0.0

    def entered(self, p: Values, before: int, after: int, d: float, z: float) -> Slopes | None:
        """Return the hidden state with which a regime begins; None where it goes on."""
        return None

    def range_of_hidden(self, p: Values, d: float) -> tuple[float, float]:
        """Return centre and half the width of the hidden states that a motion from d may start with."""
        return 0.0, 0.0

    def cycle_work(self, p: Values, amplitude: float, omega: float, offset: float = 0.0) -> float:
        """Return the work that it takes up in a cycle of a steady sine of the deflection, J.

        `amplitude`, m; `omega`, rad/s; `offset`: the mean of the deflection, m.
        """
        angle = 2 * np.pi * (np.arange(CYCLE_POINTS) + 0.5) / CYCLE_POINTS
        d, v = offset + amplitude * np.cos(angle), -amplitude * omega * np.sin(angle)
        regimes = np.array([self.regime(p, *pair, 0.0) for pair in zip(d.tolist(), v.tolist(), strict=True)])
        work = 0.0
        for regime in np.unique(regimes).tolist():
            there = regimes == regime
            force = self.force(p, regime, d[there], v[there], np.zeros(int(there.sum())))
            work += float(np.sum(force.value * v[there]))
        return work * 2 * np.pi / (CYCLE_POINTS * omega)

    def fault(self, p: Sequence[float | None]) -> str:
        """Return why known values (None of unknown ones) make no sense, or an empty text."""
        return ""


@dataclass(frozen=True)
class BoundLaw:
    """A law with values of its parameters, at a row of deflections of a structure.

    A preload deflects the joint by `offset` at rest; its static force is balanced, so that the force is that
    of the deflection from there. The offset is the last one of the parameters by which a force has slopes.
    """

    law: Law
    values: tuple[float, ...]
    row: int = 0  # its place among the rows of deflections
    offset: float = 0.0

    @property
    def _shift(self) -> float:
        return self.offset if self.law.preloaded else 0.0

    @cached_property
    def static(self) -> Slopes:
        """The force of the preload alone."""
        if not self._shift:
            return Slopes(0.0, p=(0.0,) * len(self.values))
        return self.law.force(
            self.values, self.law.regime(self.values, self._shift, 0.0, 0.0), self._shift, 0.0, 0.0
        )

    def force(self, regime: int, d: Any, v: Any, z: Any) -> Slopes:
        """Return the force, with its slopes by the parameters and by the offset."""
        f, static = self.law.force(self.values, regime, d + self._shift, v, z), self.static
        by_p = [slope - at_rest for slope, at_rest in zip(f.p, static.p, strict=True)]
        return f._replace(value=f.value - static.value, p=(*by_p, (f.d - static.d) * self.law.preloaded))

    def rate(self, regime: int, d: Any, v: Any, z: Any) -> Slopes | None:
        """Return the rate of the hidden state."""
        rate = self.law.rate(self.values, regime, d + self._shift, v, z)
        return None if rate is None else rate._replace(p=(*rate.p, 0.0))

    def guards(self, regime: int, d: Any, v: Any, z: Any) -> list[Guard]:
        """Return the guards of a regime, with slopes as of `force`."""
        guards = self.law.guards(self.values, regime, d + self._shift, v, z)
        none = (0.0,) * len(self.values)
        return [
            guard._replace(function=f._replace(p=(*(f.p or none), f.d * self.law.preloaded)))
            for guard in guards
            for f in (guard.function,)
        ]

    def entered(self, before: int, after: int, d: float, z: float) -> Slopes | None:
        """Return the hidden state with which a regime begins, with slopes as of `force`."""
        hidden = self.law.entered(self.values, before, after, d + self._shift, z)
        return None if hidden is None else hidden._replace(p=(*hidden.p, 0.0))

    def regime(self, d: float, v: float, z: float) -> int:
        """Return the regime in which a motion starts."""
        return self.law.regime(self.values, d + self._shift, v, z)

    def tangent(self, regime: int) -> tuple[float, float]:
        """Return the stiffness and damping of a regime that the march takes into the linear rest."""
        return self.law.tangent(self.values, regime)

    def cycle_work(self, amplitude: float, omega: float) -> float:
        """Return the work that the law takes up in a cycle of a steady sine about the offset, J."""
        return self.law.cycle_work(self.values, amplitude, omega, self._shift)

    @property
    def at_rest(self) -> tuple[float, float]:
        """Stiffness and damping for small motions about rest."""
        regime = self.regime(0.0, 0.0, 0.0)
        if self.law.hidden:
            return self.tangent(regime)
        f = self.force(regime, 0.0, 0.0, 0.0)
        return float(f.d), float(f.v)
