"""Quantities that follow from an estimate, with 95 % bands: poles, zeros, gains and frequency responses.

A band is that of the delta method: of the quantity or of its logarithm, whichever is nearer to linear over
the posterior. Both are tried at the ends of the principal axes of the posterior. Where neither is linear
there, and where a root has no derivative, quantiles of seeded samples of the posterior are taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import DynidError
from dynid.identification.statistics import HALF_WIDTH, TAIL_PROBABILITY
from dynid.identification.systems.linear_system import LinearSystem
from dynid.lti.exponential import balance
from dynid.lti.root_slopes import Roots, poles, poles_of_all, zeros, zeros_of_all
from dynid.lti.state_space import Matrices, ParametricSystem, single
from dynid.number_format import counted
from dynid.parameters import Parameter, named, rates
from dynid.structure.ports import ratio

#: Samples of the posterior that are requested, those of what is not requested, and their seed.
SAMPLES, FEW_SAMPLES, _POSTERIOR_SEED = 1000, 200, 20261123
# A quantity is linear if its curvature changes the ends of the band by less than this part of its half width.
_CURVATURE_SHARE = 0.1
# Real parts below this part of the root, whatever the parameters, are on the imaginary axis.
_ON_AXIS_REL_TOL = 1e-8
# Random values of the parameters that confirm what holds for all values.
_CONFIRMING_DRAWS = 3
# Distance from the axis, in standard deviations, beyond which no sample is needed.
_AXIS_DEVIATIONS = 6.0
# Errors of an estimate that is converged: so many standard deviations, at most this part of the parameter.
_ERROR_DEVIATIONS, _CONVERGED_REL_ERROR = 6.0, 1e-9
# Roots of a sample that stay within so many radii of a cluster are not resolved either.
_CLUSTER_RADII = 4.0
# Distances between roots in a block of samples.
_BLOCK_DISTANCES = 1 << 17

DELTA, LOGARITHM, SAMPLED = "delta", "delta of the logarithm", "samples"


class ConfidenceBand(NamedTuple):
    """Values with the ends of their 95 % bands, and the method of each (arrays of one shape)."""

    value: Array
    low: Array
    high: Array
    method: NDArray[np.object_]

    def part(self, places: Any) -> ConfidenceBand:
        """Return the bands at some places."""
        return ConfidenceBand(self.value[places], self.low[places], self.high[places], self.method[places])


class Pair(NamedTuple):
    """An output and an input of a system: names, units, and places of its channel and load."""

    output: str
    input: str
    unit: str
    channel: int
    load: int


class Verdict(NamedTuple):
    """A statement that may depend on the parameters.

    `name`; `holds` at the estimate; its `probability`; `always`: True if it is decided for all values of the
    parameters; `statement` in words.
    """

    name: str
    holds: bool
    probability: float
    always: bool
    statement: str


@dataclass(frozen=True, eq=False)
class GaussianPosterior:
    """Gaussian posterior of the parameters in their coordinates."""

    unknowns: tuple[Parameter, ...]  # the parameters (p)
    eta: Array  # its mean (p)
    root: Array  # a root of its covariance (p x p)
    # `low`, `high`: limits of the coordinates (p)
    low: Array
    high: Array
    count: int = SAMPLES  # number of samples
    # Samples of a posterior that limits cut off (count x p); None of a Gaussian one.
    drawn: Array | None = None

    def values(self, eta: Array) -> dict[str, float]:
        """Return the parameters at coordinates by name."""
        return named(self.unknowns, eta)

    @cached_property
    def axes(self) -> Array:
        """Principal axes of the 95 % region, from its centre to its surface (p x p, one a row)."""
        U, s, _ = np.linalg.svd(self.root)
        return np.asarray(HALF_WIDTH * (U * s).T)

    @cached_property
    def samples(self) -> Array:
        """Seeded samples (samples x p)."""
        if self.drawn is not None:
            return self.drawn
        drawn = np.random.default_rng(_POSTERIOR_SEED).standard_normal((self.count // 2, len(self.eta)))
        both = np.concatenate([drawn, -drawn]) @ self.root.T
        return np.clip(self.eta + both, self.low, self.high)

    @cached_property
    def elsewhere(self) -> Array:
        """Coordinates at random far from the mean, to confirm what holds everywhere (count x p)."""
        spread = np.array([unknown.first_spread for unknown in self.unknowns]) / 4
        drawn = np.random.default_rng(_POSTERIOR_SEED).uniform(-1, 1, (_CONFIRMING_DRAWS, len(self.eta)))
        return np.clip(self.eta + spread * drawn, self.low, self.high)

    def bands(
        self, value: Array, slopes: Array, at: Callable[[Array, NDArray[np.intp] | slice], Array]
    ) -> ConfidenceBand:
        """Return the bands of quantities.

        `value`, `slopes`: the quantities at the mean (m), and their derivatives by the coordinates (m x p),
        not finite where there are none; `at`: returns the quantities of some places at other coordinates (S
        x p), a row each. NaN where they do not exist.
        """
        usable = np.isfinite(slopes).all(axis=1)
        linear = self.axes @ np.where(np.isfinite(slopes), slopes, 0.0).T
        half = np.linalg.norm(linear, axis=0)
        moved = np.clip(self.eta + np.concatenate([self.axes, -self.axes]), self.low, self.high)
        ends = at(moved, slice(None))
        up, down = np.split(ends, 2)
        usable &= np.isfinite(ends).all(axis=0)
        bend = _bend(value, up, down, linear)
        same = (np.sign(ends) == np.sign(value)).all(axis=0) & (value != 0)
        size = np.where(same, np.abs(value), 1.0)
        signed = np.where(same, value, 1.0)
        logs = [np.log(np.where(same, np.abs(quantity), 1.0)) for quantity in (value, up, down)]
        by_log = _bend(logs[0], logs[1], logs[2], linear / signed)
        by_log = np.where(same, by_log * size, np.inf)
        rounding = 1e-13 * np.abs(value)
        curvature_limit = np.maximum(_CURVATURE_SHARE * half, rounding)
        logarithmic = usable & (by_log <= curvature_limit) & (by_log < bend) & (bend > rounding)
        plain = usable & (bend <= curvature_limit) & ~logarithmic
        low, high = value - half, value + half
        factor = np.exp(np.minimum(half / size, 700.0))
        ordered = np.sort(np.stack([value / factor, value * factor]), axis=0)
        low, high = np.where(logarithmic, ordered[0], low), np.where(logarithmic, ordered[1], high)
        method = np.where(logarithmic, LOGARITHM, DELTA).astype(object)
        others = np.flatnonzero(~(plain | logarithmic) | (self.drawn is not None))
        if len(others):
            drawn = at(self.samples, others)
            for k, index in enumerate(others):
                finite = drawn[:, k][np.isfinite(drawn[:, k])]
                ends_of = (
                    np.quantile(finite, [TAIL_PROBABILITY, 1 - TAIL_PROBABILITY])
                    if len(finite)
                    else [-np.inf, np.inf]
                )
                low[index], high[index] = ends_of
                method[index] = SAMPLED
        return ConfidenceBand(value, np.minimum(low, value), np.maximum(high, value), method)


def _bend(value: Array, up: Array, down: Array, linear: Array) -> Array:
    """Return by how much quantities (m) differ from linear ones at the ends of the axes (axes x m)."""
    differences = np.maximum(np.abs(up - value - linear), np.abs(down - value + linear))
    return np.asarray(np.linalg.norm(np.where(np.isfinite(differences), differences, np.inf), axis=0))


@dataclass(frozen=True, eq=False)
class RootFamily:
    """Poles of a system, or zeros of a pair, as functions of the parameters."""

    posterior: GaussianPosterior
    # Returns the roots at coordinates (S x p), one a row; None where there are none.
    at: Callable[[Array], Sequence[Roots | None]]
    reference: Roots  # the roots at the mean, derivatives by the coordinates
    _known: dict[bytes, ComplexArray] = field(default_factory=dict, repr=False)

    @cached_property
    def multiplicity(self) -> NDArray[np.intp]:
        """Number of roots that are one with each within round-off (m)."""
        count = np.ones(len(self.reference.values), dtype=np.intp)
        count[: self.reference.origin] = self.reference.origin
        for cluster in self.reference.clusters:
            count[cluster.places] = len(cluster.places)
        return count

    @property
    def shown(self) -> NDArray[np.intp]:
        """Places of the roots that are not below the real axis."""
        return np.flatnonzero(self.reference.values.imag >= 0)

    @cached_property
    def partners(self) -> NDArray[np.intp]:
        """Place of the conjugate of each root (m); of a real one its own."""
        values = self.reference.values
        near = np.abs(values.conj()[:, None] - values)
        return np.where(values.imag == 0, np.arange(len(values)), np.argmin(near, axis=1))

    @cached_property
    def on_axis(self) -> NDArray[np.bool_]:
        """Mask of roots on the imaginary axis for all values of the parameters (m).

        Their real parts and those of their derivatives, where a root has any, vanish to rounding at the mean,
        and as many roots are on the axis at random values.
        """
        values, slopes = self.reference.values, self.reference.slopes
        smooth = np.asarray(np.isfinite(slopes).all(axis=1))
        for cluster in self.reference.clusters:
            smooth[cluster.places] = True
        change = np.where(np.isfinite(slopes), slopes, 0.0)
        still = (np.abs(change.real) <= _ON_AXIS_REL_TOL * (np.abs(values)[:, None] + np.abs(change))).all(
            axis=1
        )
        still_on_axis = smooth & still & (np.abs(values.real) <= _ON_AXIS_REL_TOL * np.abs(values))
        for elsewhere in self._tracked(self.posterior.elsewhere):
            if np.isnan(elsewhere).any():
                return np.zeros(len(values), dtype=bool)
            if (
                np.count_nonzero(np.abs(elsewhere.real) <= _ON_AXIS_REL_TOL * np.abs(elsewhere))
                < still_on_axis.sum()
            ):
                return (
                    values == 0 if (elsewhere[values == 0] == 0).all() else np.zeros(len(values), dtype=bool)
                )
        return np.asarray(still_on_axis)

    def _tracked(self, etas: Array) -> ComplexArray:
        """Return the roots at coordinates (S x m), each in the place of its origin; NaN where none are."""
        key = etas.tobytes()
        if not len(self.reference.values):
            return np.zeros((len(etas), 0), dtype=np.complex128)
        if key not in self._known:
            block = max(1, _BLOCK_DISTANCES // len(self.reference.values) ** 2)
            parts = [self._assigned(etas[k : k + block]) for k in range(0, len(etas), block)]
            tracked = self._known[key] = np.concatenate(parts)
            # Those that round-off does not resolve are in their centre.
            for places, centre, radius in self.reference.clusters:
                roots = tracked[:, places]
                mean = roots.mean(axis=1)
                mean = mean.real.astype(np.complex128) if centre.imag == 0 else mean
                close = (np.abs(roots - mean[:, None]) <= _CLUSTER_RADII * radius).all(axis=1)
                tracked[np.ix_(close, places)] = mean[close, None]
        return self._known[key]

    def _assigned(self, etas: Array) -> ComplexArray:
        """Return the roots at coordinates (S x m) in the order of those at the mean."""
        start, change, origin, _ = self.reference
        root_sets = self.at(etas)
        tracked = np.full((len(etas), len(start)), complex(math.nan, math.nan))
        usable = [
            k
            for k, roots in enumerate(root_sets)
            if roots and len(roots.values) == len(start) and roots.origin == origin
        ]
        values = np.array([root_sets[k].values for k in usable]).reshape(len(usable), 1, len(start))  # type: ignore[union-attr]
        moved = (etas[usable] - self.posterior.eta) @ np.where(np.isfinite(change), change, 0.0).T
        off = np.abs((start + moved)[:, :, None] - values)
        stay = np.abs(start[:, None] - values)
        cost = np.minimum(off, stay) / (np.abs(start)[:, None] + np.abs(values) + 1e-300)
        nearest = np.argmin(cost, axis=2)
        clash = (np.sort(nearest, axis=1) != np.arange(len(start))).any(axis=1)
        for k in np.flatnonzero(clash):  # two roots are nearest to one
            nearest[k] = _paired(cost[k])
        tracked[usable] = np.take_along_axis(values[:, 0], nearest, axis=1)
        return tracked

    def parts(self) -> tuple[ConfidenceBand, ConfidenceBand]:
        """Return real and imaginary parts of the shown roots with their bands."""
        shown, reference = self.shown, self.reference
        values, slopes = reference.values[shown], reference.slopes[shown]
        real, imaginary = np.where(self.on_axis[shown], 0.0, values.real), values.imag

        def at(etas: Array, places: NDArray[np.intp] | slice) -> Array:
            z = self._tracked(etas)[:, shown]
            there = ~np.isnan(z)
            both = [np.where(self.on_axis[shown] & there, 0.0, z.real), np.abs(z.imag)]
            return np.concatenate(both, axis=1)[:, places]

        moved = np.concatenate([np.where(self.on_axis[shown][:, None], 0.0, slopes.real), slopes.imag])
        return _halves(self.posterior.bands(np.concatenate([real, imaginary]), moved, at))

    @cached_property
    def oscillating(self) -> NDArray[np.intp]:
        """Places of the roots above the real axis, which are pairs."""
        return np.flatnonzero(self.reference.values.imag > 0)

    def frequencies(self) -> tuple[ConfidenceBand, ConfidenceBand]:
        """Return natural frequencies and damping ratios of the pairs with their bands.

        Of a pair a, b these are sqrt(a b) and -(a + b) / 2 sqrt(a b), also where it becomes real.
        """
        pairs, partners = self.oscillating, self.partners
        values, slopes = self.reference.values[pairs], self.reference.slopes[pairs]
        omega = np.abs(values)
        fixed = self.on_axis[pairs]
        zeta = np.where(fixed, 0.0, -values.real / omega)
        with np.errstate(invalid="ignore"):
            by_omega = np.real(values.conj()[:, None] * slopes) / omega[:, None]
            by_zeta = (-slopes.real - zeta[:, None] * by_omega) / omega[:, None]
        by_zeta = np.where(fixed[:, None], 0.0, by_zeta)

        def at(etas: Array, places: NDArray[np.intp] | slice) -> Array:
            tracked = self._tracked(etas)
            first, second = tracked[:, pairs], tracked[:, partners[pairs]]
            second = np.where(first.imag != 0, first.conj(), second)
            product = np.real(first * second)
            size = np.sqrt(np.where(product > 0, product, np.nan))
            there = ~np.isnan(first)
            damping = np.where(fixed & there, 0.0, -np.real(first + second) / (2 * size))
            return np.concatenate([size, damping], axis=1)[:, places]

        return _halves(
            self.posterior.bands(np.concatenate([omega, zeta]), np.concatenate([by_omega, by_zeta]), at)
        )

    def verdict(self, name: str, noun: str, adjective: str) -> Verdict:
        """Return the verdict that all roots are in the open left half-plane, with its probability."""
        values, slopes = self.reference.values, self.reference.slopes
        fixed = self.on_axis | (np.arange(len(values)) < self.reference.origin)
        free = ~fixed
        holds = bool(np.all(values.real[free] < 0))
        probability = self._probability(values[free].real, slopes[free].real, free)
        if not fixed.any():
            word = "" if holds else "not "
            chance = _chance(probability if holds else 1 - probability)
            return Verdict(name, holds, probability, False, f"{word}{adjective} (probability {chance})")
        places = []
        if origin := self.reference.origin:
            places.append(f"{counted(origin, noun)} at the origin")
        if axis := int(np.count_nonzero(self.on_axis & (values != 0))):
            places.append(f"{counted(axis, noun)} on the imaginary axis")
        others = f"; the others are in the left half-plane (probability {_chance(probability)})"
        statement = f"not {adjective} for any values of the parameters: {' and '.join(places)}"
        return Verdict(name, False, 0.0, True, statement + (others if free.any() else ""))

    def _probability(self, real: Array, slopes: Array, free: NDArray[np.bool_]) -> float:
        """Return the probability that some real parts are negative."""
        if not len(real):
            return 1.0
        deviation = np.linalg.norm(np.where(np.isfinite(slopes), slopes, 0.0) @ self.posterior.root, axis=1)
        smooth = np.isfinite(slopes).all(axis=1)
        far = np.abs(real) > _AXIS_DEVIATIONS * deviation
        if (smooth & far).all():
            return float(np.all(real < 0))
        real_parts = self._tracked(self.posterior.samples)[:, free].real
        real_parts = real_parts[~np.isnan(real_parts).any(axis=1)]
        return float((real_parts < 0).all(axis=1).mean()) if len(real_parts) else math.nan


def _chance(probability: float) -> str:
    return f"{'>' * (probability == 1)}{'<' * (probability == 0)}{min(max(probability, 0.001), 0.999):.3g}"


def _paired(cost: Array) -> NDArray[np.intp]:
    """Return the column of each row (m x m), every column once, the cheapest pairs first."""
    m = len(cost)
    column, free = np.full(m, -1, dtype=np.intp), np.ones(m, dtype=bool)
    for entry in np.argsort(cost, axis=None, kind="stable").tolist():
        i, j = divmod(entry, m)
        if column[i] < 0 and free[j]:
            column[i], free[j] = j, False
    return column


def _halves(band: ConfidenceBand) -> tuple[ConfidenceBand, ConfidenceBand]:
    half = len(band.value) // 2
    return band.part(slice(half)), band.part(slice(half, None))


@dataclass(frozen=True, eq=False)
class DerivedQuantities:
    """Quantities of one system that follow from a posterior."""

    posterior: GaussianPosterior
    system: LinearSystem  # the system, whose parameters they are
    _known: dict[bytes, Matrices] = field(default_factory=dict, repr=False)

    def _at(self, eta: Array) -> Matrices:
        key = eta.tobytes()
        if key not in self._known:
            values, affine = self.posterior.values(eta), self.system.affine
            self._known[key] = (
                self.system.at(values)
                if affine is None
                else affine.at(np.array([values[unknown.name] for unknown in self.system.unknowns]))
            )
        return self._known[key]

    def _each(self, etas: Array) -> list[Matrices | None]:
        """Return the matrices at coordinates (S x p); None where there are none."""
        matrices: list[Matrices | None] = []
        for eta in etas:
            try:
                matrices.append(self._at(eta))
            except DynidError:
                matrices.append(None)
        return matrices

    @property
    def _rates(self) -> Array:
        return rates(self.posterior.unknowns, self.posterior.eta)

    @property
    def _spread(self) -> Array:
        """Errors of the parameters where the estimate is converged (p)."""
        deviation = np.linalg.norm(self.posterior.root, axis=1) * np.abs(self._rates)
        size = np.abs(np.array(list(self.posterior.values(self.posterior.eta).values())))
        return np.asarray(np.minimum(_ERROR_DEVIATIONS * deviation, _CONVERGED_REL_ERROR * size))

    @cached_property
    def poles(self) -> RootFamily:
        """The poles."""
        here = self._at(self.posterior.eta)
        scale = balance(here.A)

        def at(etas: Array) -> list[Roots | None]:
            matrix_sets = self._each(etas)
            root_sets = iter(
                poles_of_all([matrices.A for matrices in matrix_sets if matrices is not None], scale)
            )
            return [None if matrices is None else next(root_sets) for matrices in matrix_sets]

        return RootFamily(
            self.posterior, at, self._reference(poles(here.A, here.A_slopes, scale, self._spread))
        )

    def zeros(self, pair: Pair) -> RootFamily | None:
        """Return the zeros of a pair; None where the input does not affect the output."""
        here = single(self._at(self.posterior.eta), pair.channel, pair.load)
        scale = balance(here.A)

        def at(etas: Array) -> list[Roots | None]:
            subsystems = [
                None if subsystem is None else single(subsystem, pair.channel, pair.load)
                for subsystem in self._each(etas)
            ]
            alike = [
                subsystem
                for subsystem in subsystems
                if subsystem is not None and len(subsystem.A) == len(scale)
            ]
            roots = iter(zeros_of_all(alike, scale))
            return [
                None if subsystem is None
                else next(roots) if len(subsystem.A) == len(scale)
                else zeros_of_all([subsystem], balance(subsystem.A))[0]  # another order of its direct term
                for subsystem in subsystems
            ]  # fmt: skip

        roots = zeros(here, scale=scale, spread=self._spread)
        return None if roots is None else RootFamily(self.posterior, at, self._reference(roots))

    def _reference(self, roots: Roots) -> Roots:
        """Return roots with derivatives by the coordinates."""
        finite = np.isfinite(roots.slopes)
        return roots._replace(
            slopes=np.where(finite, np.where(finite, roots.slopes, 0.0) * self._rates, np.inf)
        )

    def response(self, omega: Array, pair: Pair) -> tuple[ConfidenceBand, ConfidenceBand]:
        """Return magnitude and phase (rad) of a frequency response at lines (L) with their bands.

        Raises Singular if a line lies on an undamped pole, to rounding.
        """
        pairs, lines = [(pair.channel, pair.load)], len(omega)
        H, slopes = self.system.paired_response(self.posterior.values(self.posterior.eta), omega, pairs)
        H, slopes = H[:, 0], slopes[:, 0] * self._rates
        there = np.where(H == 0, 1.0, H)
        size, phase = np.abs(H), np.unwrap(np.angle(there))
        relative = slopes / there[:, None]
        moved = np.concatenate([size[:, None] * relative.real, np.where(H == 0, np.inf, relative.imag.T).T])

        def sample(eta: Array, chosen: NDArray[np.intp]) -> Array:
            needed = np.unique(chosen % lines)
            values = self.posterior.values(eta)
            try:
                responses = self.system.paired_response(values, omega[needed], pairs, slopes=False)[0][:, 0]
            except DynidError:
                return np.full(len(chosen), np.nan)
            turned = phase[needed] + np.angle(responses / there[needed])
            both = np.where(
                chosen < lines,
                *(curve[np.searchsorted(needed, chosen % lines)] for curve in (np.abs(responses), turned)),
            )
            return np.asarray(both)

        def at(etas: Array, places: NDArray[np.intp] | slice) -> Array:
            return np.array([sample(eta, np.arange(2 * lines)[places]) for eta in etas])

        return _halves(self.posterior.bands(np.concatenate([size, phase]), moved, at))

    def gains(self, pair: Pair, family: RootFamily) -> dict[str, ConfidenceBand]:
        """Return the gains of a pair at rest and at high frequencies, as far as they are finite.

        With zeros at the origin, in the family of its zeros, and no poles there, it is 0 at rest.
        """
        eta = self.posterior.eta
        functions: dict[str, Callable[[ParametricSystem], tuple[float, Array] | None]] = {"dc": _dc_gain}
        if family.reference.origin > self.poles.reference.origin:
            functions["dc"] = lambda subsystem: (0.0, np.zeros_like(subsystem.d_slopes))
        here = self._at(eta)
        if len(here.D) == 1 or not here.D[1:, pair.channel, pair.load].any():
            functions["high_frequency"] = lambda subsystem: (subsystem.d, subsystem.d_slopes)
        bands = {}
        for name, gain in functions.items():
            gain_and_slopes = gain(single(here, pair.channel, pair.load))
            if gain_and_slopes is None:
                continue

            def at(etas: Array, places: NDArray[np.intp] | slice, gain=gain) -> Array:  # type: ignore[no-untyped-def] # noqa: ARG001
                gain_and_slopes = [gain(single(self._at(eta), pair.channel, pair.load)) for eta in etas]
                return np.array(
                    [[math.nan if subsystem is None else subsystem[0]] for subsystem in gain_and_slopes]
                )

            value, slopes = gain_and_slopes
            bands[name] = self.posterior.bands(np.array([value]), (slopes * self._rates)[None], at)
        return bands


def _dc_gain(subsystem: ParametricSystem) -> tuple[float, Array] | None:
    """Return d - c A^-1 b with its derivatives; None where a pole at the origin is in the way."""
    if poles(subsystem.A).origin:
        return None
    x, y = np.linalg.solve(subsystem.A, subsystem.b), np.linalg.solve(subsystem.A.T, subsystem.c)
    slopes = (
        subsystem.d_slopes
        - subsystem.c_slopes @ x
        - subsystem.b_slopes @ y
        + np.einsum("i,pij,j->p", y, subsystem.A_slopes, x)
    )
    return float(subsystem.d - subsystem.c @ x), slopes


def pairs_of(outputs: Sequence[tuple[str, str]], inputs: Sequence[tuple[str, str]]) -> list[Pair]:
    """Return every pair of an output and an input (names and units); loads of one name are one input."""
    first = {name: (index, unit) for index, (name, unit) in reversed(list(enumerate(inputs)))}
    return [
        Pair(output, name, ratio(unit, per), channel, load)
        for channel, (output, unit) in enumerate(outputs)
        for name, (load, per) in reversed(first.items())
    ]
