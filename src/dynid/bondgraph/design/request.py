"""Requests to a design: free parameters, wanted zeros and poles, and norms to minimise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from dynid.bondgraph.graph import Port
from dynid.parameters import Parameter

if TYPE_CHECKING:
    from dynid.bondgraph.graph import BondGraph

RootKind = Literal["zero", "pole"]
NormKind = Literal["peak", "h2", "hinf"]


@dataclass(frozen=True)
class RootTarget:
    """A wanted zero or pole of a channel.

    Parameters
    ----------
    kind
        zero or pole.
    output, input
        The channel.
    frequency
        Natural frequency |s|, rad/s.
    damping
        Damping ratio -Re s/|s|, from -1 to 1; 1 and -1 are real roots. None: any that oscillates.
    hertz
        True if its frequency is shown in Hz.
    """

    kind: RootKind
    output: Port
    input: str
    frequency: float
    damping: float | None = None
    hertz: bool = False

    @property
    def value(self) -> complex:
        """The root above the real axis, of damping 0 where none is given."""
        ratio = self.damping or 0.0
        return self.frequency * complex(-ratio, math.sqrt(1 - ratio * ratio))

    def frequency_text(self, omega: float, digits: int = 6) -> str:
        """Return a frequency in the unit of the target."""
        return f"{omega / (2 * math.pi):.{digits}g} Hz" if self.hertz else f"{omega:.{digits}g} rad/s"

    def root_text(self, omega: float, damping: float) -> str:
        """Return a root in words: its frequency, and its damping ratio where one is wanted."""
        text = self.frequency_text(omega)
        if self.damping is None:
            return text
        return f"{text} with damping ratio {round(damping, 12) + 0.0:.6g}"

    @property
    def channel(self) -> str:
        """The name of the channel."""
        return f"{self.output}/{self.input}"

    def __str__(self) -> str:
        return f"{self.kind} of {self.channel} at {self.root_text(self.frequency, self.damping or 0.0)}"


@dataclass(frozen=True)
class Criterion:
    """A norm of a channel that is minimised: the sum of all, each times its weight.

    Parameters
    ----------
    kind
        peak: the largest magnitude in a band. hinf: over all frequencies. h2: the root of the mean square
        of the response to white noise of intensity 1.
    output, input
        The channel.
    low, high
        The band of a peak, rad/s.
    weight
        Its weight.
    """

    kind: NormKind
    output: Port
    input: str
    low: float = 0.0
    high: float = math.inf
    weight: float = 1.0

    @property
    def channel(self) -> str:
        """The name of the channel."""
        return f"{self.output}/{self.input}"

    @property
    def noun(self) -> str:
        """The minimised quantity."""
        return {"peak": "peak", "h2": "H2 norm", "hinf": "H∞ norm"}[self.kind]

    def __str__(self) -> str:
        return f"{self.noun} of {self.channel}"


Target = RootTarget | Criterion


@dataclass(frozen=True, eq=False)
class Design:
    """A request to a design.

    Parameters
    ----------
    graph
        The graph; values of its nodes depend on the free parameters.
    free
        The free parameters (p) with their starts and limits.
    targets
        What is wanted (m), in the order of the scene.
    starts
        How many starts are tried: the given one, and others at random within the limits.
    seed
        Seed of the random starts.
    compared
        Values of free parameters, by the name of another design, whose targets are reported beside.
    """

    graph: BondGraph
    free: tuple[Parameter, ...]
    targets: tuple[Target, ...]
    starts: int = 8
    seed: int = 0
    compared: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def roots(self) -> tuple[RootTarget, ...]:
        """The wanted zeros and poles."""
        return tuple(one for one in self.targets if isinstance(one, RootTarget))

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        """The norms to minimise."""
        return tuple(one for one in self.targets if isinstance(one, Criterion))
