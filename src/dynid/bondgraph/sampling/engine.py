"""The channels of many samples at once, with the numbers of the exact engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.bondgraph.sampling.family import Family, Polynomials, Values
from dynid.bondgraph.sampling.polynomials import Factor, Integers, Tables, nonzero
from dynid.bondgraph.transfer import TransferFunction
from dynid.lti.batches.roots import RootBatch, disjoint, root_batch
from dynid.lti.certified import Root, in_order

#: Roots of a family: those of each factor, with the factor's multiplicity.
Spectrum = list[tuple[RootBatch, int]]


@dataclass(frozen=True, eq=False)
class _Solved:
    """A channel of all samples."""

    numerator: list[Integers]
    denominator: list[Integers]
    zeros: Spectrum
    poles: Spectrum
    hidden: Spectrum


class SampledEngine:
    """The channels of samples of a family.

    Numerator and denominator are evaluated exactly and the roots certified together. A sample for which
    something of that fails (a leading coefficient that vanishes, roots that meet or cancel, one that is on the
    axis by chance) is not `certain`: it is to be run alone.

    Parameters
    ----------
    family
        The graphs.
    channels
        Their channels as polynomials.
    values
        The values of the samples.
    count
        How many samples there are.

    Attributes
    ----------
    certain
        Samples that the engine answers for.
    """

    def __init__(
        self, family: Family, channels: dict[Channel, Polynomials], values: Values, count: int
    ) -> None:
        self.family, self.count = family, count
        self.certain = np.ones(count, dtype=bool)
        parts = [
            part
            for one in channels.values()
            for part in (one.numerator, one.denominator, *(f.polynomial for f in (*one.zeros, *one.poles, *one.hidden)))
        ]
        self._tables = Tables([values[name] for name in family.varying], parts, count)
        self._solved = {channel: self._solve(one) for channel, one in channels.items()}

    def __getitem__(self, sample: int) -> Sample:
        return Sample(self, sample)

    def transfer(self, channel: Channel, sample: int) -> TransferFunction:
        """Return a channel of a sample; its roots are known already."""
        from flint import fmpz_poly

        solved = self._solved[channel]
        numerator, denominator = (
            fmpz_poly([column[sample] for column in columns])
            for columns in (solved.numerator, solved.denominator)
        )
        zeros, poles = (_roots(spectrum, sample) for spectrum in (solved.zeros, solved.poles))
        return TransferFunction.of_roots(numerator, denominator, zeros, poles)

    def hidden_modes(self, channel: Channel, sample: int) -> tuple[Root, ...]:
        """Return the natural modes that cancel in a channel of a sample."""
        return _roots(self._solved[channel].hidden, sample)

    def _solve(self, channel: Polynomials) -> _Solved:
        numerator, denominator = (
            self._tables.coefficients(part) for part in (channel.numerator, channel.denominator)
        )
        zeros, poles, hidden = (
            self._spectrum(part) for part in (channel.zeros, channel.poles, channel.hidden)
        )
        self.certain &= _apart([*zeros, *poles], self.count) & _apart(hidden, self.count)
        return _Solved(numerator, denominator, zeros, poles, hidden)

    def _spectrum(self, factors: Sequence[Factor]) -> Spectrum:
        spectrum = []
        for factor in factors:
            if factor.is_laplace:
                spectrum.append((_origin(self.count), factor.multiplicity))
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


class Sample(NamedTuple):
    """One sample of an engine, which answers for its channels as any engine does."""

    engine: SampledEngine
    number: int

    @property
    def reduced(self) -> ReducedGraph:
        """The plan that the sample shares with the others."""
        return self.engine.family.reduced

    def channel(self, channel: Channel) -> TransferFunction:
        """Return one channel."""
        return self.engine.transfer(channel, self.number)

    def hidden_modes(self, channel: Channel) -> tuple[Root, ...]:
        """Return the natural modes that cancel in a channel."""
        return self.engine.hidden_modes(channel, self.number)


def _origin(count: int) -> RootBatch:
    """Return the root 0 of every sample."""
    zeros = np.zeros((count, 1))
    return RootBatch(zeros.astype(complex), zeros, zeros.astype(np.int8), np.ones(count, dtype=bool))


def _apart(spectrum: Spectrum, count: int) -> NDArray[np.bool_]:
    """Tell for which samples no root of one factor may be one of another."""
    if len(spectrum) < 2:
        return np.ones(count, dtype=bool)
    values, radii = (np.concatenate([getattr(part, what) for part, _ in spectrum], axis=1) for what in ("values", "radii"))
    return disjoint(values, radii)


def _roots(spectrum: Spectrum, sample: int) -> tuple[Root, ...]:
    return in_order(
        Root(value, multiplicity, radius, side)
        for batch, multiplicity in spectrum
        for value, radius, side in zip(*batch.row(sample), strict=True)
    )
