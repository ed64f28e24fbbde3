"""Requests to a design: free parameters, wanted zeros and poles, and norms to minimise.

Distances of zeros and poles from where they are wanted have derivatives: a pair of roots counts by its
natural frequency sqrt(a b) and its damping ratio -(a + b)/(2 sqrt(a b)), which stay smooth where the pair
becomes real.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.graph import Port
from dynid.parameters import Parameter

if TYPE_CHECKING:
    from dynid.bondgraph.controller_circuits import Loop
    from dynid.bondgraph.graph import BondGraph


RootKind = Literal["zero", "pole"]
NormKind = Literal["peak", "h2", "hinf", "maximise"]
LoopKind = Literal["phase_margin", "gain_margin", "Ms", "Mt"]


@dataclass(frozen=True)
class RootTarget:
    """A wanted zero or pole of a channel."""

    kind: RootKind
    output: Port
    input: str
    frequency: float  # natural frequency |s|, rad/s
    #: Damping ratio -Re s/|s|, from -1 to 1; 1 and -1 are real roots. None: any that oscillates.
    damping: float | None = None
    hertz: bool = False  # True if its frequency is shown in Hz

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
class LoopTarget:
    """A wanted margin of a feedback loop, the others closed."""

    kind: LoopKind
    loop: int  # its index
    name: str  # FROM -> TO
    frequency: float  # the wanted value: degrees, a factor, or a size
    #: output, input: A channel whose response is shown before and after.
    output: Port
    input: str
    damping: None = None

    @property
    def margin(self) -> str:
        """Its name among the margins of a loop."""
        return {"phase_margin": "phase", "gain_margin": "gain"}.get(self.kind, self.kind)

    @property
    def unit(self) -> str:
        """Its unit."""
        return "deg" if self.kind == "phase_margin" else ""

    @property
    def channel(self) -> str:
        """The name of the loop."""
        return f"the loop {self.name}"

    def root_text(self, value: float, damping: float = 0.0) -> str:  # noqa: ARG002 (as of a root)
        """Return a value of it in words."""
        return f"{value:.6g}{'°' if self.unit else ''}"

    def __str__(self) -> str:
        return f"{self.kind.replace('_', ' ')} of {self.channel} of {self.root_text(self.frequency)}"


@dataclass(frozen=True)
class Criterion:
    """A norm of a channel that is minimised: the sum of all, each times its weight."""

    #: peak: the largest magnitude in a band. hinf: over all frequencies. h2: the root of the mean square of
    #: the response to white noise of intensity 1.
    kind: NormKind
    output: Port
    input: str
    #: low, high: The band of a peak, rad/s.
    low: float = 0.0
    high: float = math.inf
    weight: float = 1.0
    parameter: str = ""  # what is maximised: its start over its value is minimised

    @property
    def channel(self) -> str:
        """The name of the channel."""
        return f"{self.output}/{self.input}"

    @property
    def noun(self) -> str:
        """The minimised quantity."""
        return {"peak": "peak", "h2": "H2 norm", "hinf": "H∞ norm", "maximise": "inverse"}[self.kind]

    def __str__(self) -> str:
        return f"inverse of {self.parameter}" if self.parameter else f"{self.noun} of {self.channel}"


Target = RootTarget | LoopTarget | Criterion


@dataclass(frozen=True, eq=False)
class Design:
    """A request to a design."""

    graph: BondGraph  # the graph; values of its nodes depend on the free parameters
    free: tuple[Parameter, ...]  # the free parameters (p) with their starts and limits
    targets: tuple[Target, ...]  # what is wanted (m), in the order of the scene
    starts: int = 8  # how many starts are tried: the given one, and others at random within the limits
    seed: int = 0  # seed of the random starts
    #: Values of free parameters, by the name of another design, whose targets are reported beside.
    compared: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    #: opened, loops: Of margins: the graph without feedback, and the loops.
    opened: BondGraph | None = None
    loops: tuple[Loop, ...] = ()

    @property
    def roots(self) -> tuple[RootTarget | LoopTarget, ...]:
        """The wanted zeros, poles and margins."""
        return tuple(target for target in self.targets if not isinstance(target, Criterion))

    @property
    def criteria(self) -> tuple[Criterion, ...]:
        """The norms to minimise."""
        return tuple(target for target in self.targets if isinstance(target, Criterion))


#: Imaginary parts below this part of a root are those of a real one.
_REAL_RTOL = 1e-9
#: Cost of a target that no root can meet.
_MISSING_RESIDUAL = 1e12


class Reached(NamedTuple):
    """The root that is nearest to a target: frequency, damping ratio, and its residuals; or a margin."""

    #: frequency, damping: Natural frequency, rad/s, and damping ratio.
    frequency: float
    damping: float
    #: Logarithm of the frequency over the wanted one, and the difference of the damping ratios where one is
    #: wanted; of a real root its distance over the wanted one (1 or 2).
    residuals: Array
    slopes: Array  # derivatives of the residuals (1 or 2 x p)


def residual_count(target: RootTarget | LoopTarget) -> int:
    """Return how many equations a target is."""
    return 1 if target.damping is None or abs(target.damping) == 1 else 2


def nearest(
    targets: Sequence[RootTarget], values: ComplexArray, slopes: ComplexArray
) -> list[Reached | None]:
    """Return the nearest root of each target, a different one of each; None where there is none.

    `values` and `slopes`: its roots (m), and their derivatives (m x p).
    """
    from scipy.optimize import linear_sum_assignment

    options = [_candidates(target, values, slopes) for target in targets]
    if len(targets) == 1:
        roots = list(options[0].values())
        return [min(roots, key=_distance) if roots else None]
    keys = list(dict.fromkeys(key for candidates in options for key in candidates))
    costs = np.full((len(targets), len(keys) + len(targets)), _MISSING_RESIDUAL)
    for row, candidates in enumerate(options):
        for key, reached in candidates.items():
            costs[row, keys.index(key)] = min(_distance(reached), _MISSING_RESIDUAL)
    columns = linear_sum_assignment(costs)[1]
    return [
        candidates.get(keys[column]) if column < len(keys) else None
        for candidates, column in zip(options, columns, strict=True)
    ]


def _distance(reached: Reached) -> float:
    return float(reached.residuals @ reached.residuals)


def _candidates(
    target: RootTarget, values: ComplexArray, slopes: ComplexArray
) -> dict[tuple[int, ...], Reached]:
    """Return what could meet a target, by the places of its roots."""
    real = np.abs(values.imag) <= _REAL_RTOL * np.abs(values)
    candidates: dict[tuple[int, ...], Reached] = {}
    if target.damping is not None and abs(target.damping) == 1:
        requested = target.value.real
        for k in np.flatnonzero(real & (values != 0)).tolist():
            value = values[k].real
            residual = np.array([value / requested - 1])
            damping = -math.copysign(1.0, value)
            candidates[k,] = Reached(abs(value), damping, residual, slopes[k : k + 1].real / requested)
        return candidates
    for k in np.flatnonzero(~real & (values.imag > 0)).tolist():
        z, change = values[k], slopes[k]
        by_log = np.real(z.conjugate() * change) / abs(z) ** 2
        candidates[k,] = _reached(target, abs(z), -z.real / abs(z), by_log, -change.real / abs(z))
    if target.damping is not None:
        for pair in combinations(np.flatnonzero(real & (values != 0)).tolist(), 2):
            a, b = values[list(pair)].real
            if a * b > 0:
                size, moved = math.sqrt(a * b), slopes[list(pair)].real
                by_log = (moved[0] / a + moved[1] / b) / 2
                candidates[pair] = _reached(
                    target, size, -(a + b) / (2 * size), by_log, -moved.sum(axis=0) / 2 / size
                )
    return candidates


def _reached(target: RootTarget, size: float, damping: float, by_log: Array, by_sum: Array) -> Reached:
    """Return a root with its residuals; `by_sum` is the derivative of -(a + b) over 2 sqrt(a b)."""
    residuals, slopes = [math.log(size / target.frequency)], [by_log]
    if target.damping is not None:
        residuals.append(damping - target.damping)
        slopes.append(by_sum - damping * by_log)
    return Reached(size, damping, np.array(residuals), np.array(slopes))
