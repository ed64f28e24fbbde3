"""The exact engine: every channel in lowest terms over the rationals, its roots certified."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph, characteristic_polynomials
from dynid.defaults import MANY_LOOPS, STARTED_ROOTS
from dynid.errors import NumericalError
from dynid.lti.certified_roots import CertifiedRoot, certified_roots
from dynid.lti.positive_real import fraction, nearest_double
from dynid.lti.stability import TransferProperties

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.bondgraph.floating.state_counts import StateCounts
    from dynid.bondgraph.program.factored import RationalFunction


# --- transfer function ----------------------------------------------------------------------------


@dataclass(frozen=True)
class TransferFunction(TransferProperties):
    """T(s) = numerator / denominator in lowest terms over the rationals."""

    #: numerator, denominator: Integer polynomials without a common factor (flint `fmpz_poly`), or polynomials
    #: over the field of a graph's irrational values (`FieldPolynomial`).
    numerator: Any
    denominator: Any
    #: Gives approximate zeros (asked for `zeros`) or poles (`poles`), where there is a quick way to them.
    starts: Callable[[str], Sequence[complex] | None] = field(default=lambda _: None, compare=False)

    @classmethod
    def of(cls, ratio: RationalFunction) -> TransferFunction:
        """Bring a rational function into lowest terms; one over a field is rounded, with its structure."""
        return cls.rounded(*ratio.lowest_terms())

    @classmethod
    def over_field(cls, ratio: RationalFunction) -> TransferFunction:
        """Bring a rational function into lowest terms; one over a field stays one."""
        numerator, denominator = ratio.lowest_terms()
        if hasattr(denominator, "field"):
            lead = denominator.leading_coefficient()
            return cls(numerator.over(lead), denominator.over(lead))
        return cls(numerator, denominator)

    @classmethod
    def rounded(cls, numerator: Any, denominator: Any) -> TransferFunction:
        """Return polynomials without a common factor over the integers: those over a field are rounded."""
        from flint import fmpq, fmpz_poly

        if isinstance(numerator, fmpz_poly):
            return cls(numerator, denominator)
        from dynid.arithmetic.field_polynomials import leading_ratio

        gain = fmpq(*leading_ratio(numerator, denominator).as_integer_ratio())
        above, below = gain * numerator.rounded(), denominator.rounded()
        common = above.denom() * below.denom()
        above, below = (above * common).numer(), (below * common).numer()
        content = math.gcd(above.content(), below.content())
        return cls(above // content, below // content)

    def times(self, factor: Fraction) -> TransferFunction:
        """Return it times a number."""
        numerator, denominator = self.numerator * factor.numerator, self.denominator * factor.denominator
        common = numerator.gcd(denominator)
        return TransferFunction(numerator // common, denominator // common)

    @property
    def vanishes(self) -> bool:
        """True where the input does not reach the output at all."""
        return bool(self.numerator == 0)

    def coefficients(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return numerator and denominator in descending powers, denominator monic, correctly rounded."""
        lead = fraction(self.denominator.leading_coefficient())

        def rounded(polynomial: Any) -> NDArray[np.float64]:
            descending = reversed([fraction(c) for c in polynomial.coeffs()] or [Fraction(0)])
            return np.array([nearest_double(c / lead) for c in descending])

        return rounded(self.numerator), rounded(self.denominator)

    @cached_property
    def zeros(self) -> tuple[CertifiedRoot, ...]:
        """The finite zeros; none where the channel vanishes."""
        return () if self.vanishes else certified_roots(self.numerator, self.starts("zeros"))

    @cached_property
    def poles(self) -> tuple[CertifiedRoot, ...]:
        """The poles."""
        return certified_roots(self.denominator, self.starts("poles"))

    @property
    def order(self) -> int:
        """The number of poles."""
        return int(self.denominator.degree())

    @property
    def relative_degree(self) -> int | float:
        """Poles minus zeros: negative where the channel differentiates, infinite where it vanishes."""
        return math.inf if self.vanishes else int(self.denominator.degree()) - int(self.numerator.degree())

    @property
    def dc_gain(self) -> float:
        """The limit of T(s) as s falls to 0 through positive values; may be infinite."""
        return _limit(self.numerator.coeffs(), self.denominator.coeffs())

    @property
    def high_frequency_gain(self) -> float:
        """The limit of T(s) as s grows through positive values; may be infinite."""
        size = max(self.numerator.length(), self.denominator.length())
        pad = [[0] * (size - p.length()) + p.coeffs()[::-1] for p in (self.numerator, self.denominator)]
        return _limit(*pad)


def _limit(numerator: list[Any], denominator: list[Any]) -> float:
    """Return the quotient of two polynomials as the variable falls to 0+, coefficients ascending."""
    n = next((k for k, c in enumerate(numerator) if c), None)
    if n is None:
        return 0.0
    d = next(k for k, c in enumerate(denominator) if c)
    quotient = fraction(numerator[n]) / fraction(denominator[d])
    if n == d:
        return nearest_double(quotient)
    return 0.0 if n > d else math.inf if quotient > 0 else -math.inf


def exact_channels(reduced: ReducedGraph) -> dict[Channel, TransferFunction]:
    """Return all channels of a graph, exactly."""
    channels = reduced.channels()
    ratios = reduced.rational(channels.values())
    return {channel: TransferFunction.of(ratios[register]) for channel, register in channels.items()}


# --- engine ---------------------------------------------------------------------------------------

#: Degree from which eigenvalues are worth their time as first values of roots.
_LARGE = STARTED_ROOTS.value


class ExactEngine:
    """The channels of a graph, exactly.

    Roots of large polynomials are certified from the eigenvalues of the graph's own equations: these save
    time, and what is certified does not depend on them.
    """

    def __init__(self, reduced: ReducedGraph) -> None:
        self.reduced = reduced
        channels = reduced.channels()
        self._states = _state_equations(reduced)
        if self._states:
            full = {channel: self._states[channel[0]].exact(channel[1]) for channel in channels}
            lowest = {channel: _in_lowest_terms(*parts) for channel, parts in full.items()}
            self._zero_counts = {channel: int(above.degree()) for channel, (above, _) in full.items()}
            self._by_states = {channel[0]: natural.numer() for channel, (_, natural) in full.items()}
        else:
            ratios = reduced.rational(channels.values())
            lowest = {channel: ratios[register].lowest_terms() for channel, register in channels.items()}
        self._denominators = {channel: below for channel, (_, below) in lowest.items()}
        self._transfers = {
            channel: replace(TransferFunction.rounded(*parts), starts=partial(self._starts, channel))
            for channel, parts in lowest.items()
        }
        self._modes: dict[frozenset[str], list[complex] | None] = {}
        self._hidden: dict[Channel, tuple[CertifiedRoot, ...]] = {}

    def channel(self, channel: Channel) -> TransferFunction:
        """Return one channel."""
        return self._transfers[channel]

    def hidden_modes(self, channel: Channel) -> tuple[CertifiedRoot, ...]:
        """Return the natural modes that cancel in a channel: uncontrollable, unobservable, or both."""
        if channel not in self._hidden:
            polynomial = self.hidden_polynomial(channel)
            starts = self._natural_starts(channel[0]) if polynomial.degree() > _LARGE else None
            self._hidden[channel] = certified_roots(polynomial, starts)
        return self._hidden[channel]

    def hidden_polynomial(self, channel: Channel) -> Any:
        """Return the polynomial whose roots are the natural modes that cancel in a channel."""
        from flint import fmpz_poly

        port, shown = channel[0], self._denominators[channel]
        if self.reduced.graph.integrates(port) and shown[0] == 0:  # the output's own integrator is no mode
            shown = shown // fmpz_poly([0, 1])
        natural = self.natural[port]
        return natural // natural.gcd(shown)

    @cached_property
    def natural(self) -> dict[Port, Any]:
        """The polynomials of all natural modes behind each output."""
        return self._by_states if self._states else characteristic_polynomials(self.reduced)

    def _starts(self, channel: Channel, what: str) -> Sequence[complex] | None:
        """Return first values of the zeros or poles of a channel, where they are many."""
        transfer = self._transfers[channel]
        if what == "poles":
            return self._natural_starts(channel[0]) if transfer.denominator.degree() > _LARGE else None
        if transfer.numerator.degree() <= _LARGE:
            return None
        if self._states:
            values = self._states[channel[0]].zeros(channel[1], self._zero_counts[channel])
            return values.tolist() if np.isfinite(values).all() else None
        from dynid.bondgraph.floating.spectrum import zero_equations

        return _first_values(zero_equations(self.reduced, channel))

    def _natural_starts(self, port: Port) -> Sequence[complex] | None:
        junctions = frozenset(self.reduced.reductions[port].junctions)
        if junctions not in self._modes:
            from dynid.bondgraph.floating.spectrum import natural_equations

            self._modes[junctions] = _first_values(natural_equations(self.reduced, port))
        return self._modes[junctions]


def _state_equations(reduced: ReducedGraph) -> dict[Port, StateCounts]:
    """Return the state equations of outputs on many loops, where a program of rational functions fills."""
    if reduced.structure.loops <= MANY_LOOPS.value:  # without an import
        return {}
    from dynid.bondgraph.floating.state_counts import StateCounts

    return StateCounts.of_outputs(reduced)


def _in_lowest_terms(above: Any, below: Any) -> tuple[Any, Any]:
    """Return two polynomials over the rationals as ones over the integers without a common factor."""
    shared = above.gcd(below)
    above, below = above // shared, below // shared
    common = math.lcm(int(above.denom()), int(below.denom()))
    above, below = (above * common).numer(), (below * common).numer()
    content = math.gcd(int(above.content()), int(below.content()))
    return above // content, below // content


def _first_values(equations: Any) -> list[complex] | None:
    from dynid.bondgraph.floating.spectrum import first_values

    try:
        return first_values(equations)
    except NumericalError:  # they would only have saved time
        return None
