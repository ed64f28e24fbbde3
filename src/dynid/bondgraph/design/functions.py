"""The targets of a design as functions of its free parameters, with exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dynid.arithmetic.numbers import LARGEST
from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.design.design_request import (
    Criterion,
    Design,
    LoopTarget,
    Reached,
    RootTarget,
    Target,
    nearest,
    residual_count,
)
from dynid.bondgraph.parametric_equations import ParametricEquations
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.errors import NumericalError
from dynid.lti import norms
from dynid.lti.root_slopes import poles, zeros
from dynid.lti.state_space import Matrices, ParametricSystem, single
from dynid.number_format import frequency_text
from dynid.parameters import Parameter

if TYPE_CHECKING:
    from dynid.bondgraph.design.loop_margins import LoopMargins

#: A parameter without limits is searched in this range of its start, as a logarithm or in multiples of it.
SPAN = 1e6
#: Poles below this part of the size of A are at the origin.
_ORIGIN_POLE_TOL = 1e-14
#: The factor around the start within which random starts are drawn where a limit is farther.
_START_SPREAD = 30.0
#: Frequencies nearer to each other than this, relative, count as one.
_FREQUENCY_RTOL = 1e-6


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The coordinates of free parameters (p): logarithms, or multiples of a typical size."""

    free: tuple[Parameter, ...]

    @cached_property
    def units(self) -> Array:
        """The size of a unit of each coordinate: 1 of a logarithm."""
        sizes = []
        for parameter in self.free:  # of one that may be zero, its limits show its size
            limits = [abs(limit) for limit in (parameter.low, parameter.high) if limit]
            size = abs(parameter.start) or max(limits, default=1.0)
            sizes.append(1.0 if parameter.logarithmic else size)
        return np.array(sizes, dtype=float)

    @cached_property
    def start(self) -> Array:
        """The coordinates of the starts."""
        return np.array([parameter.coordinate(parameter.start) for parameter in self.free]) / self.units

    @cached_property
    def low(self) -> Array:
        """The lowest coordinates: the limits, else far below the start."""
        return self._limits([parameter.low for parameter in self.free], -1)

    @cached_property
    def high(self) -> Array:
        """The highest coordinates: the limits, else far above the start."""
        return self._limits([parameter.high for parameter in self.free], 1)

    def _limits(self, bounds: list[float | None], side: int) -> Array:
        far = np.where([parameter.logarithmic for parameter in self.free], math.log(SPAN), SPAN)
        limits: Array = self.start + side * far
        for k, (parameter, limit) in enumerate(zip(self.free, bounds, strict=True)):
            if limit is not None and (limit > 0 or not parameter.logarithmic):
                limits[k] = parameter.coordinate(limit) / self.units[k]
        return limits

    def values(self, eta: Array) -> Array:
        """Return the values at coordinates, those at a limit exactly it."""
        pairs = zip(self.free, eta * self.units, strict=True)
        values = np.array([parameter.value(coordinate) for parameter, coordinate in pairs])
        for k, parameter in enumerate(self.free):
            for limit, at in ((parameter.low, self.low[k]), (parameter.high, self.high[k])):
                if limit is not None and eta[k] == at:
                    values[k] = limit
        return values

    def rates(self, values: Array) -> Array:
        """Return the derivatives of values by their coordinates."""
        log = np.array([parameter.logarithmic for parameter in self.free], dtype=bool)
        return np.asarray(np.where(log, values, self.units), dtype=float)

    def of(self, values: Mapping[str, float]) -> Array:
        """Return the coordinates of values, by name; the start where there is none."""
        coordinates = [free.coordinate(values.get(free.name, free.start)) for free in self.free]
        return np.asarray(np.array(coordinates) / self.units)

    def drawn(self, count: int, seed: int) -> Array:
        """Return random coordinates within the limits (count x p)."""
        near = np.where([parameter.logarithmic for parameter in self.free], math.log(_START_SPREAD), 3.0)
        low, high = np.maximum(self.low, self.start - near), np.minimum(self.high, self.start + near)
        return np.random.default_rng(seed).uniform(low, high, (count, len(self.free)))


@dataclass(frozen=True, eq=False)
class Norm:
    """A norm at some values: the pieces that it is the largest of, with derivatives by the coordinates."""

    #: values, slopes: The pieces (k), and their derivatives (k x p).
    values: Array
    slopes: Array
    system: ParametricSystem | None = None  # the system, hidden modes moved
    maxima: norms.Maxima | None = None  # the local maxima that the pieces are; None of an H2 norm
    why: str = ""  # why there is none: then it is infinite

    @property
    def value(self) -> float:
        """The norm."""
        return float(self.values.max(initial=0.0)) if not self.why else math.inf


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The targets at some coordinates (p)."""

    eta: Array
    #: residuals, jacobian: Of all wanted roots (r), and their derivatives by the coordinates (r x p).
    residuals: Array
    jacobian: Array
    reached: tuple[Reached | None, ...]  # the nearest root of each target; None where there is none
    norms: tuple[Norm, ...]  # the norms to minimise

    @property
    def exists(self) -> bool:
        """True if every target has a root, and every norm is finite."""
        return bool(np.isfinite(self.residuals).all()) and not any(norm.why for norm in self.norms)


class DesignFunctions:
    """The targets of a design as functions of the coordinates of its free parameters.

    `low` and `high`: the coordinates between which is searched: equal of a parameter that is held. Raises
    `Singular` where the equations have no unique solution whatever the parameters are.
    """

    def __init__(self, design: Design) -> None:
        self.design, self.coordinates = design, Coordinates(design.free)
        self.low, self.high = self.coordinates.low.copy(), self.coordinates.high.copy()
        self._outputs = list(dict.fromkeys(target.output for target in design.targets))
        self._inputs = list(dict.fromkeys(target.input for target in design.targets))
        reduced = ReducedGraph(design.graph, self._inputs, self._outputs, traced=False)
        self._names = [parameter.name for parameter in design.free]
        self._equations = ParametricEquations(reduced, self._names)
        self._loops: LoopMargins | None = None
        if design.opened is not None and any(isinstance(target, LoopTarget) for target in design.targets):
            from dynid.bondgraph.design.loop_margins import LoopMargins

            self._loops = LoopMargins(design.opened, design.loops, self._names)

    @property
    def reached(self) -> frozenset[str]:
        """The free parameters that the targets depend on."""
        loops = frozenset() if self._loops is None else self._loops.reached
        maximised = {criterion.parameter for criterion in self.design.criteria if criterion.parameter}
        return self._equations.reached | loops | maximised

    def verified(self, at: Evaluation) -> bool:
        """Test whether margins that are reached are those of stable loops, and the least ones."""
        if self._loops is None:
            return True
        pairs = zip(self.design.roots, at.reached, strict=True)
        margins = [(t, r.frequency) for t, r in pairs if isinstance(t, LoopTarget) and r is not None]
        values = dict(zip(self._names, self.coordinates.values(at.eta).tolist(), strict=True))
        return self._loops.verified([t for t, _ in margins], [value for _, value in margins], values)

    def matrices(self, eta: Array) -> Matrices:
        """Return the matrices of all channels, with derivatives by the coordinates.

        Raises `NumericalError` where the equations have no solution, or one whose squares overflow.
        """
        values = self.coordinates.values(eta)
        matrices = self._equations.at(dict(zip(self._names, values.tolist(), strict=True)))
        largest = max(float(np.abs(matrix).max(initial=0.0)) for matrix in matrices[:4])
        if not largest <= LARGEST:
            raise NumericalError(f"the state equations reach {largest:.3g}; a design takes up to {LARGEST:g}")
        rates = self.coordinates.rates(values)
        slopes = (np.einsum("p,p...->p...", rates, slope) for slope in matrices[4:])
        return Matrices(*matrices[:4], *slopes)

    def channel(self, matrices: Matrices, target: Target) -> ParametricSystem:
        """Return the system of a target's channel."""
        return single(matrices, self._outputs.index(target.output), self._inputs.index(target.input))

    def derivative(self, matrices: Matrices, target: Target) -> int:
        """Return the order of the derivative of its input that a channel follows.

        Its system (`channel`) is driven by this derivative.
        """
        direct = matrices.D[:, self._outputs.index(target.output), self._inputs.index(target.input)]
        return int(np.flatnonzero(direct).max(initial=0))

    def response(self, matrices: Matrices, target: Target, omega: Array) -> ComplexArray:
        """Return the response of a target's channel at frequencies (L), infinite at an undamped pole."""
        system, factor = self.channel(matrices, target), (1j * omega) ** self.derivative(matrices, target)
        try:
            return norms.response(system, omega) * factor
        except np.linalg.LinAlgError:
            if len(omega) == 1:
                return np.array([complex(math.inf)])
            halves = np.array_split(omega, 2)
            return np.concatenate([self.response(matrices, target, half) for half in halves])

    def at(self, eta: Array) -> Evaluation:
        """Evaluate all targets; where the equations have no solution, all are infinite."""
        p = len(self._names)
        try:
            matrices = self.matrices(eta)
        except NumericalError as error:
            rows = sum(map(residual_count, self.design.roots))
            empty = Norm(np.zeros(0), np.zeros((0, p)), why=error.problem)
            return Evaluation(
                eta,
                np.full(rows, np.inf),
                np.zeros((rows, p)),
                (None,) * len(self.design.roots),
                (empty,) * len(self.design.criteria),
            )
        reached = self._roots(matrices, eta)
        residuals, jacobian = [np.zeros(0)], [np.zeros((0, p))]
        for target, root in zip(self.design.roots, reached, strict=True):
            count = residual_count(target)
            residuals.append(np.full(count, np.inf) if root is None else root.residuals)
            usable = root is not None and bool(np.isfinite(root.slopes).all())
            jacobian.append(root.slopes if root is not None and usable else np.zeros((count, p)))
        return Evaluation(
            eta,
            np.concatenate(residuals),
            np.concatenate(jacobian),
            tuple(reached),
            tuple(
                self._inverse(criterion, eta) if criterion.parameter else self._norm(matrices, criterion)
                for criterion in self.design.criteria
            ),
        )

    def _inverse(self, criterion: Criterion, eta: Array) -> Norm:
        """Return the start of a maximised parameter, which is positive, over its value."""
        index = self._names.index(criterion.parameter)
        value = self.design.free[index].start / self.coordinates.values(eta)[index]
        slopes = np.zeros((1, len(eta)))
        slopes[0, index] = -value
        return Norm(np.array([value]), slopes)

    def _margins(self, eta: Array) -> list[Reached | None]:
        """Return the margins that are wanted, in order."""
        targets = [target for target in self.design.roots if isinstance(target, LoopTarget)]
        if self._loops is None:
            return []
        values = self.coordinates.values(eta)
        loops = self._loops.at(dict(zip(self._names, values.tolist(), strict=True)))
        reached: list[Reached | None] = []
        for target in targets:
            margin = self._loops.margin(loops, target)
            if margin is None:
                reached.append(None)
                continue
            slopes = margin.slopes * self.coordinates.rates(values) / target.frequency
            residual = np.array([margin.value / target.frequency - 1])
            reached.append(Reached(margin.value, 0.0, residual, slopes[None]))
        return reached

    def _roots(self, matrices: Matrices, eta: Array) -> list[Reached | None]:
        groups: dict[tuple[str, object, str], list[int]] = {}
        reached: list[Reached | None] = [None] * len(self.design.roots)
        margins = iter(self._margins(eta))
        for index, target in enumerate(self.design.roots):
            if isinstance(target, LoopTarget):
                reached[index] = next(margins)
            else:
                groups.setdefault((target.kind, target.output, target.input), []).append(index)
        for places in groups.values():
            targets = [t for t in (self.design.roots[k] for k in places) if isinstance(t, RootTarget)]
            values, slopes = self.channel_roots(matrices, targets[0])
            for index, found_root in zip(places, nearest(targets, values, slopes), strict=True):
                reached[index] = found_root
        return reached

    def channel_roots(self, matrices: Matrices, target: RootTarget) -> tuple[ComplexArray, ComplexArray]:
        """Return the zeros or poles of a channel (m) without hidden modes, and their derivatives (m x p)."""
        is_pole = target.kind == "pole"
        roots = poles(matrices.A, matrices.A_slopes) if is_pole else zeros(self.channel(matrices, target))
        if roots is None:
            return np.zeros(0, dtype=complex), np.zeros((0, len(self._names)), dtype=complex)
        proper = matrices._replace(D=matrices.D[:1], D_slopes=matrices.D_slopes[:, :1])
        modes = norms.modes(self.channel(proper, target))
        kept = np.ones(len(roots.values), dtype=bool)
        for value in modes.values[modes.hidden]:
            away = np.where(kept, np.abs(roots.values - value), np.inf)
            if len(away) and np.isfinite(away).any():
                kept[int(np.argmin(away))] = False
        return roots.values[kept], roots.slopes[kept]

    def _norm(self, matrices: Matrices, criterion: Criterion) -> Norm:
        p = len(self._names)
        system, channel_poles = norms.without_hidden(self.channel(matrices, criterion))
        if why := self._without_norm(matrices, criterion, system, channel_poles):
            return Norm(np.zeros(0), np.zeros((0, p)), why=why)
        if criterion.kind == "h2":
            value, slopes = norms.h2_norm(system)
            return Norm(np.array([value]), slopes[None], system)
        maxima = norms.maxima(system, channel_poles, criterion.low, criterion.high)
        return Norm(maxima.magnitude, maxima.slopes, system, maxima)

    def _without_norm(
        self, matrices: Matrices, criterion: Criterion, system: ParametricSystem, channel_poles: ComplexArray
    ) -> str:
        """Return the reason why a channel has no finite norm; empty where it has."""
        name = f"{criterion.output}/{criterion.input}"
        if self.derivative(matrices, criterion):
            return f"{name} follows a derivative of its input: its response grows without limit"
        if criterion.kind == "h2" and system.d:
            return f"{name} follows its input directly (gain {system.d:.4g}): its H2 norm is infinite"
        size = float(np.linalg.norm(system.A)) or 1.0
        channel_poles = np.where(np.abs(channel_poles) <= _ORIGIN_POLE_TOL * size, 0.0, channel_poles)
        axis = norms.on_axis(channel_poles, size)
        at = np.abs(channel_poles.imag)
        within = axis & (at >= criterion.low * (1 - 1e-9)) & (at <= criterion.high * (1 + 1e-9))
        bad = within if criterion.kind == "peak" else axis
        right = (channel_poles.real > 0) & ~axis
        if right.any():
            return f"{name} is unstable: {_pole_text(channel_poles[right][0])} in the right half-plane"
        if bad.any():
            return f"{name} is not stable: {_pole_text(channel_poles[bad][0])} on the imaginary axis"
        return ""

    def with_frequencies(self, here: Evaluation, candidate: Evaluation) -> Evaluation:
        """Return an evaluation with further pieces of its norms: the magnitudes where another's maxima are.

        They are not above the norms. Each is a smooth function of the parameters, at a fixed frequency.
        """
        pairs = zip(here.norms, candidate.norms, strict=True)
        return replace(here, norms=tuple(_with_frequencies(norm, further) for norm, further in pairs))

    def gradients(self, eta: Array, near: Evaluation) -> tuple[Array, list[Array]]:
        """Return the derivatives of the residuals and of the pieces of every norm, at a point nearby.

        The pieces are those of the evaluation: its maxima are followed.
        """
        matrices = self.matrices(eta)
        jacobian = [np.zeros((0, len(eta)))]
        for target, reached, root in zip(
            self.design.roots, near.reached, self._roots(matrices, eta), strict=True
        ):
            lost = root is None or reached is None or not np.isfinite(root.slopes).all()
            jacobian.append(
                np.zeros((residual_count(target), len(eta))) if lost or root is None else root.slopes
            )
        slopes = []
        for criterion, known_norm in zip(self.design.criteria, near.norms, strict=True):
            if criterion.parameter:
                slopes.append(self._inverse(criterion, eta).slopes)
                continue
            system, _ = norms.without_hidden(self.channel(matrices, criterion))
            if known_norm.maxima is None:
                slopes.append(norms.h2_norm(system)[1][None])
            else:
                moved = norms.followed(system, known_norm.maxima, criterion.low, criterion.high)
                slopes.append(moved.slopes)
        return np.concatenate(jacobian), slopes


def _with_frequencies(norm: Norm, further: Norm) -> Norm:
    maxima, others = norm.maxima, further.maxima
    if maxima is None or others is None or norm.system is None:
        return norm
    at, new = (set_of_maxima.omega[np.isfinite(set_of_maxima.omega)] for set_of_maxima in (maxima, others))
    distance = np.abs(new[:, None] - at).min(axis=1, initial=np.inf)
    new = new[distance > _FREQUENCY_RTOL * new]
    values, slopes = norms.at_frequencies(norm.system, new)
    joined = norms.Maxima(
        np.append(maxima.omega, new),
        np.append(maxima.magnitude, values),
        np.concatenate([maxima.slopes, slopes]),
        maxima.fixed + len(new),
    )
    return Norm(joined.magnitude, joined.slopes, norm.system, joined)


def _pole_text(value: complex) -> str:
    if abs(value) == 0 or abs(value.imag) <= 1e-9 * abs(value):
        return f"a pole at {value.real:.4g} rad/s lies" if value.real else "a pole at 0 lies"
    return f"poles at {value.real:.4g} ± {abs(value.imag):.4g}j ({frequency_text(abs(value))}) lie"
