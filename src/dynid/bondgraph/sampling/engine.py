"""The channels of many samples at once, with the numbers of the exact engine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph, SampleValues
from dynid.bondgraph.sampling.channel_polynomials import (
    ChannelPolynomials,
    Integers,
    PowerTables,
    SquarefreeFactor,
    nonzero,
)
from dynid.lti.certified_roots import CertifiedRoot
from dynid.lti.root_batches import RootBatch, disjoint, root_batch


@dataclass(frozen=True, eq=False)
class _SampledRoots:
    """Roots of one polynomial of every sample."""

    #: The roots, each as often as its multiplicity says, smallest modulus first (sample x root).
    values: NDArray[np.complex128]
    #: radii, sides: Bounds on their errors, and their sides of the axis, likewise.
    radii: NDArray[np.float64]
    sides: NDArray[np.int8]
    multiplicities: NDArray[np.int64]  # their multiplicities, likewise

    @classmethod
    def of(cls, factors: Sequence[tuple[RootBatch, int]], count: int) -> _SampledRoots:
        """Join the roots of the factors of polynomials, each with its multiplicity."""

        def joined(what: str, kind: type) -> NDArray[Any]:
            parts = [np.repeat(getattr(batch, what), power, axis=1) for batch, power in factors]
            return np.concatenate([np.empty((count, 0), dtype=kind), *parts], axis=1)

        values, radii, sides = joined("values", complex), joined("radii", float), joined("sides", np.int8)
        parts = [np.full((count, batch.values.shape[1] * power), power) for batch, power in factors]
        powers = np.concatenate([np.empty((count, 0), dtype=int), *parts], axis=1)
        order = np.lexsort((values.imag, values.real, np.hypot(values.real, values.imag)))
        return cls(*(np.take_along_axis(array, order, axis=1) for array in (values, radii, sides, powers)))

    def roots(self, sample: int) -> tuple[CertifiedRoot, ...]:
        """Return the roots of one sample, each once."""
        arrays = (self.values, self.radii, self.sides, self.multiplicities)
        rows = (array[sample].tolist() for array in arrays)
        distinct = dict.fromkeys(zip(*rows, strict=True))
        return tuple(CertifiedRoot(value, power, radius, side) for value, radius, side, power in distinct)


@dataclass(frozen=True, eq=False)
class _SampledChannel:
    """A channel of all samples: coefficients, ascending, for each one integer a sample, and roots."""

    numerator: list[Integers]
    denominator: list[Integers]
    zeros: _SampledRoots
    poles: _SampledRoots
    hidden: _SampledRoots

    @property
    def relative_degree(self) -> int:
        """Poles minus zeros."""
        return len(self.denominator) - len(self.numerator)

    def dc_gain(self) -> list[float]:
        """Return the limit of T(s) as s falls to 0, of every sample."""
        above, below = map(_lowest, (self.numerator, self.denominator))
        return _limits(self.numerator[above], self.denominator[below], above - below)

    def high_frequency_gain(self) -> list[float]:
        """Return the limit of T(s) as s grows, of every sample."""
        return _limits(self.numerator[-1], self.denominator[-1], self.relative_degree)


class SampledEngine:
    """The channels of samples of a graph.

    Numerator and denominator are evaluated exactly and the roots certified together. A sample for which
    something of that fails (a leading coefficient that vanishes, roots that meet or cancel, one that is on
    the axis by chance) is not `certain`: it is to be run alone.

    `certain`: samples that the engine answers for.
    """

    def __init__(
        self,
        reduced: ReducedGraph,
        channels: dict[Channel, ChannelPolynomials],
        values: SampleValues,
        count: int,
    ) -> None:
        self.reduced, self.count = reduced, count
        self.certain = np.ones(count, dtype=bool)
        parts = [
            polynomial
            for polynomials in channels.values()
            for polynomial in (
                polynomials.numerator,
                polynomials.denominator,
                *(factor.polynomial for factor in polynomials.factors),
            )
        ]
        self._tables = PowerTables(list(values.values()), parts, count)
        self.channels: dict[Channel, _SampledChannel] = {}
        for channel, polynomials in channels.items():
            above, below = map(self._tables.coefficients, (polynomials.numerator, polynomials.denominator))
            for columns in (above, below):
                self.certain &= nonzero(columns[_lowest(columns) :])
            zeros, poles, hidden = (
                self._roots(polynomial)
                for polynomial in (polynomials.zeros, polynomials.poles, polynomials.hidden)
            )
            self.certain &= _apart([*zeros, *poles], count) & _apart(hidden, count)
            roots = (_SampledRoots.of(polynomial, count) for polynomial in (zeros, poles, hidden))
            self.channels[channel] = _SampledChannel(above, below, *roots)

    def __getitem__(self, sample: int) -> _EngineSample:
        return _EngineSample(self, sample)

    def _roots(self, factors: Sequence[SquarefreeFactor]) -> list[tuple[RootBatch, int]]:
        spectrum = []
        for factor in factors:
            if factor.is_laplace:
                zero, sure = np.zeros((self.count, 1)), np.ones(self.count, dtype=bool)
                origin = RootBatch(zero.astype(complex), zero, zero.astype(np.int8), sure)
                spectrum.append((origin, factor.multiplicity))
                continue
            columns = self._tables.coefficients(factor.polynomial)
            sound = nonzero(columns)
            self.certain &= sound
            if factor.degree:
                even = factor.even
                steady = [np.where(sound, column, 1) for column in (columns[::2] if even else columns)]
                batch = root_batch([column.tolist() for column in steady], even=even)
                self.certain &= batch.certain
                spectrum.append((batch, factor.multiplicity))
        return spectrum


class _EngineSample(NamedTuple):
    """One sample of an engine, which answers for its channels as any engine does."""

    engine: SampledEngine
    number: int

    @property
    def reduced(self) -> ReducedGraph:
        """The plan that the sample shares with the others."""
        return self.engine.reduced

    def channel(self, channel: Channel) -> TransferFunction:
        """Return one channel, with its roots."""
        from flint import fmpz_poly

        solved, sample = self.engine.channels[channel], self.number
        numerator, denominator = (
            fmpz_poly([column[sample] for column in columns])
            for columns in (solved.numerator, solved.denominator)
        )
        transfer = TransferFunction(numerator, denominator)
        vars(transfer).update(zeros=solved.zeros.roots(sample), poles=solved.poles.roots(sample))
        return transfer

    def hidden_modes(self, channel: Channel) -> tuple[CertifiedRoot, ...]:
        """Return the natural modes that cancel in a channel."""
        return self.engine.channels[channel].hidden.roots(self.number)


def _apart(spectrum: Sequence[tuple[RootBatch, int]], count: int) -> NDArray[np.bool_]:
    """Return for which samples no root of one factor may be one of another."""
    if len(spectrum) < 2:
        return np.ones(count, dtype=bool)
    values = np.concatenate([batch.values for batch, _ in spectrum], axis=1)
    return disjoint(values, np.concatenate([batch.radii for batch, _ in spectrum], axis=1))


def _lowest(columns: Sequence[Integers]) -> int:
    """Return the lowest power whose coefficient is not always 0."""
    return next((power for power, column in enumerate(columns) if column.any()), 0)


def _limits(above: Integers, below: Integers, power: int) -> list[float]:
    """Return the limits of above/below times the variable to a power, as it falls to 0."""
    if power > 0:
        return [0.0] * len(above)
    limits = []
    for a, b in zip(above.tolist(), below.tolist(), strict=True):
        infinite = math.inf if (a > 0) == (b > 0) else -math.inf
        try:
            limits.append(a / b if power == 0 else infinite)
        except OverflowError:
            limits.append(infinite)
        except ZeroDivisionError:  # of a sample that is not certain
            limits.append(math.nan)
    return limits
