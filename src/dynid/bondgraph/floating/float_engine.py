"""The floating-point engine: roots as eigenvalues (`roots`), gains and orders exact (`series`)."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property

import numpy as np

from dynid.bondgraph.floating.roots import (
    EstimatedRoot,
    RootCounts,
    RootDiscs,
    cancelling,
    checked,
    modular_ratios,
    settled,
)
from dynid.bondgraph.floating.series import leading_terms
from dynid.bondgraph.floating.spectrum import (
    MAX_CERTIFIED_STATES,
    natural_equations,
    refined,
    spectrum,
    zero_equations,
)
from dynid.bondgraph.floating.state_counts import StateCounts
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph
from dynid.errors import Undecided
from dynid.lti.stability import TransferProperties


class FloatEngine:
    """The channels of a graph, their roots found in floating point where they are asked for."""

    def __init__(self, reduced: ReducedGraph) -> None:
        self.reduced = reduced
        self.channels = reduced.channels()
        self._spectra: dict[tuple[frozenset[str], bool], RootDiscs] = {}
        self._found: dict[Channel, _FloatTransferFunction] = {}
        self._terms: tuple[dict[Channel, tuple[int, float]], ...] = ({}, {})  # at 0, at infinity
        self._states = StateCounts.of_outputs(reduced)
        if self._states:
            self.counts, self.natural_counts, self._zero_counts = {}, {}, {}
            for channel in self.channels:
                above, natural = self._states[channel[0]].counts(channel[1])
                shared = above.polynomial.gcd(natural.polynomial)
                lowest = [RootCounts(counts.polynomial // shared) for counts in (above, natural)]
                self.counts[channel] = lowest[0], lowest[1]
                self.natural_counts[channel[0]], self._zero_counts[channel] = natural, above.degree
            return
        determinants = {port: reduction.determinant() for port, reduction in reduced.reductions.items()}
        counted = modular_ratios(reduced, [*self.channels.values(), *determinants.values()])
        self.counts = {channel: counted[register] for channel, register in self.channels.items()}
        self.natural_counts = {port: counted[register][0] for port, register in determinants.items()}

    def channel(self, channel: Channel) -> _FloatTransferFunction:
        """Return one channel."""
        if channel not in self._found:
            self._found[channel] = _FloatTransferFunction(self, channel)
        return self._found[channel]

    def hidden_modes(self, channel: Channel) -> tuple[EstimatedRoot, ...]:
        """Return the natural modes that cancel in a channel."""
        return self.channel(channel).hidden_modes

    def natural(self, channel: Channel, *, exact: bool = False) -> RootDiscs:
        """Return all natural modes of the part behind an output, its integrator included."""
        port = channel[0]
        key = frozenset(self.reduced.reductions[port].junctions), exact
        if key not in self._spectra:
            self._spectra[key] = checked(
                spectrum(natural_equations(self.reduced, port), exact=exact), self.natural_counts[port].degree
            )
        origin = RootDiscs(np.zeros(1, dtype=np.complex128), np.zeros(1), np.zeros(1))
        return RootDiscs.joined([self._spectra[key], *[origin] * self.reduced.graph.integrates(port)])

    def invariant_zeros(self, channel: Channel, *, exact: bool = False) -> RootDiscs:
        """Return the invariant zeros of a channel: its zeros and hidden modes."""
        if self._states and not (exact and self._zero_counts[channel] <= MAX_CERTIFIED_STATES):
            starts = self._states[channel[0]].zeros(channel[1], self._zero_counts[channel])
            if np.isfinite(starts).all():
                return refined(zero_equations(self.reduced, channel), starts)
        return spectrum(zero_equations(self.reduced, channel), exact=exact)

    def leading(self, channel: Channel, *, at_infinity: bool) -> tuple[int, float]:
        """Return the leading term, as s falls to 0 or grows, of a channel that is not zero: power, factor."""
        if channel not in self._terms[at_infinity]:
            self._terms[at_infinity].update(self._leading_terms(channel, at_infinity))
        return self._terms[at_infinity][channel]

    def _leading_terms(self, channel: Channel, at_infinity: bool) -> dict[Channel, tuple[int, float]]:
        """Return the leading terms of a channel, or of all where they are those of one program."""
        above, below = self.counts[channel]
        if self._states:
            states, source = self._states[channel[0]], channel[1]
            if at_infinity:
                power = above.degree - below.degree
                return {channel: (power, states.leading_at_infinity(source, -power))}
            if not self.natural_counts[channel[0]].at_origin:
                factor = states.leading_at_rest(source, above.at_origin)
                if factor is not None:
                    return {channel: (above.at_origin, factor)}
        registers = {c: self.channels[c] for c, (reached, _) in self.counts.items() if reached.degree >= 0}
        terms = leading_terms(self.reduced, registers.values(), at_infinity=at_infinity)
        return {reached_channel: terms[register] for reached_channel, register in registers.items()}


class _FloatTransferFunction(TransferProperties):
    """One channel: see `FloatEngine`.

    Raises `Undecided` where the roots found do not fit what is known of them exactly.
    """

    def __init__(self, engine: FloatEngine, channel: Channel) -> None:
        self.engine, self.channel = engine, channel
        self.above, self.below = engine.counts[channel]

    @property
    def vanishes(self) -> bool:
        """True where the input does not reach the output at all."""
        return self.above.degree < 0

    @property
    def order(self) -> int:
        """The number of poles."""
        return self.below.degree

    @property
    def relative_degree(self) -> int | float:
        """Poles minus zeros."""
        return math.inf if self.vanishes else self.below.degree - self.above.degree

    @property
    def gain(self) -> float:
        """The factor k of T(s) = k prod(s - zeros) / prod(s - poles)."""
        return 0.0 if self.vanishes else self.engine.leading(self.channel, at_infinity=True)[1]

    @property
    def dc_gain(self) -> float:
        """The limit of T(s) as s falls to 0 through positive values."""
        return 0.0 if self.vanishes else _limit(*self.engine.leading(self.channel, at_infinity=False))

    @property
    def high_frequency_gain(self) -> float:
        """The limit of T(s) as s grows through positive values."""
        if self.vanishes:
            return 0.0
        power, coefficient = self.engine.leading(self.channel, at_infinity=True)
        return _limit(-power, coefficient)

    @property
    def zeros(self) -> tuple[EstimatedRoot, ...]:
        """The finite zeros; none where the channel vanishes."""
        return self._roots[0]

    @property
    def poles(self) -> tuple[EstimatedRoot, ...]:
        """The poles."""
        return self._roots[1]

    @property
    def hidden_modes(self) -> tuple[EstimatedRoot, ...]:
        """The natural modes that cancel; an output's own integrator is none."""
        hidden = self._roots[2]
        if not self.engine.reduced.graph.integrates(self.channel[0]) or self.below.at_origin:
            return hidden
        rest = [replace(root, multiplicity=root.multiplicity - (root.value == 0)) for root in hidden]
        return tuple(root for root in rest if root.multiplicity)

    @cached_property
    def _roots(self) -> tuple[tuple[EstimatedRoot, ...], ...]:
        """Return zeros, poles and hidden modes, certified in small blocks where eigenvalues do not decide."""
        try:
            return self._settled(exact=False)
        except Undecided:
            return self._settled(exact=True)

    def _settled(self, *, exact: bool) -> tuple[tuple[EstimatedRoot, ...], ...]:
        port = self.channel[0]
        natural, all_counts = self.engine.natural(self.channel, exact=exact), self.engine.natural_counts[port]
        if self.engine.reduced.graph.integrates(port):  # the output's integrator counts as a mode here
            all_counts = all_counts.times_s()
        if self.vanishes:
            return (), (), settled(natural, all_counts, strict=not exact)
        hidden_counts = RootCounts(all_counts.polynomial // self.below.polynomial)
        zeros = self.engine.invariant_zeros(self.channel, exact=exact)
        zeros = checked(zeros, self.above.degree + hidden_counts.degree)
        common, matches = cancelling(natural, zeros, hidden_counts.degree)
        parts = (
            (zeros.where(~matches), self.above),
            (natural.where(~common), self.below),
            (natural.where(common), hidden_counts),
        )
        return tuple(settled(discs, counts, strict=not exact) for discs, counts in parts)


def _limit(power: int, coefficient: float) -> float:
    """Return the limit of c x^k as x falls to 0."""
    if power == 0:
        return coefficient
    return 0.0 if power > 0 else math.copysign(math.inf, coefficient)
