"""The channels of a graph as polynomials in s and the values that vary, evaluated for many samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.formulas.symbolic import FormulaTooLong, variables
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph
from dynid.defaults import SHARED_POLYNOMIALS

# --- polynomials of samples -----------------------------------------------------------------------

Integers = NDArray[np.object_]


@dataclass(frozen=True)
class SquarefreeFactor:
    """A factor of a polynomial of a graph, without multiple roots for almost all values."""

    polynomial: Any  # the factor (flint `fmpz_mpoly`, s being the first variable)
    multiplicity: int  # how often it occurs

    @property
    def degree(self) -> int:
        """The degree in s."""
        return int(self.polynomial.degrees()[0])

    @property
    def even(self) -> bool:
        """True of a polynomial in s^2: with s, -s is a root as well."""
        return all(powers[0] % 2 == 0 for powers in self.polynomial.monoms())

    @property
    def is_laplace(self) -> bool:
        """True of s itself, up to a sign."""
        return len(self.polynomial) == 1 and self.degree == 1


def factors(polynomial: Any) -> tuple[SquarefreeFactor, ...]:
    """Return factors of a polynomial that for almost all values have simple roots, none in common.

    Pairs of roots s and -s have a factor of their own, a polynomial in s^2. Factors without s are left out.
    """
    ring = polynomial.context()
    s = ring.gen(0)
    power = min((int(powers[0]) for powers in polynomial.monoms()), default=0)
    with_multiplicity = [SquarefreeFactor(s, power)] if power else []
    for squarefree, multiplicity in _squarefree(polynomial // s**power):
        even = ring.from_dict({powers: c for powers, c in squarefree.to_dict().items() if powers[0] % 2 == 0})
        odd = squarefree - even
        # roots s and -s are those that even and odd part share; odd/s is even as well
        pairs = even.gcd(odd // s) if odd != 0 else squarefree
        with_multiplicity += [
            SquarefreeFactor(factor, multiplicity)
            for factor in (pairs, squarefree // pairs)
            if factor.degrees()[0]
        ]
    return tuple(with_multiplicity)


def _squarefree(polynomial: Any) -> Iterator[tuple[Any, int]]:
    """Yield the square-free factors in s with their multiplicities (Yun's algorithm)."""
    slope = polynomial.derivative(0)
    if slope == 0:
        return
    common = polynomial.gcd(slope)
    b, multiplicity = polynomial // common, 1
    d = slope // common - b.derivative(0)
    while b.degrees()[0]:
        factor = b.gcd(d)
        if factor.degrees()[0]:
            yield factor, multiplicity
        b, multiplicity = b // factor, multiplicity + 1
        d = d // factor - b.derivative(0)


class PowerTables:
    """Powers of the values of many samples, as integers over a common denominator.

    A value n/d that occurs up to the power D enters as n^e d^(D - e): the same positive or negative factor
    multiplies every polynomial.

    `values`: for every variable but s the values of the samples. `polynomials`: what will be evaluated (flint
    `fmpz_mpoly`).
    """

    def __init__(
        self, values: Sequence[Sequence[Fraction]], polynomials: Iterable[Any], samples: int
    ) -> None:
        degrees = np.max([(*polynomial.degrees(),) for polynomial in polynomials], axis=0, initial=0)[1:]
        self.samples = samples
        self._powers = [_powers(column, int(degree)) for column, degree in zip(values, degrees, strict=True)]

    def coefficients(self, polynomial: Any) -> list[Integers]:
        """Return the coefficients of s, ascending: for every power one integer a sample."""
        columns: list[Any] = [0] * (int(polynomial.degrees()[0]) + 1)
        for (power, *exponents), coefficient in polynomial.terms():
            term: Any = int(coefficient)
            for table, exponent in zip(self._powers, exponents, strict=True):
                term = term * table[exponent]
            columns[power] = columns[power] + term
        return [np.broadcast_to(np.asarray(column, dtype=object), (self.samples,)) for column in columns]


def _powers(values: Sequence[Fraction], degree: int) -> list[Integers]:
    """Return n^e d^(D - e) for e up to D."""
    above, below = (
        np.array(parts, dtype=object)
        for parts in zip(*((v.numerator, v.denominator) for v in values), strict=True)
    )
    return [above**e * below ** (degree - e) for e in range(degree + 1)]


def nonzero(columns: Sequence[Integers]) -> NDArray[np.bool_]:
    """Return for which samples the first and the last coefficient are not zero."""
    first, last = columns[0], columns[-1]
    both: NDArray[np.bool_] = (first != 0) & (last != 0)
    return both.astype(bool)


# --- channels -------------------------------------------------------------------------------------

_TERMS = SHARED_POLYNOMIALS.value


@dataclass(frozen=True)
class ChannelPolynomials:
    """A channel of graphs that differ in some values."""

    #: numerator, denominator: Without a common factor (flint `fmpz_mpoly`, s being the first variable).
    numerator: Any
    denominator: Any
    #: zeros, poles, hidden: The factors of numerator, denominator, and the polynomial of the natural modes
    #: that cancel.
    zeros: tuple[SquarefreeFactor, ...]
    poles: tuple[SquarefreeFactor, ...]
    hidden: tuple[SquarefreeFactor, ...]

    @property
    def factors(self) -> tuple[SquarefreeFactor, ...]:
        """All of these factors."""
        return (*self.zeros, *self.poles, *self.hidden)


def channel_polynomials(
    reduced: ReducedGraph, varying: Sequence[str]
) -> dict[Channel, ChannelPolynomials] | None:
    """Return the channels of a graph as polynomials in s and the values that vary.

    None where they have too many terms, or a channel is zero whatever the values.
    """
    channels = reduced.channels()
    natural = {port: reduction.determinant() for port, reduction in reduced.reductions.items()}
    try:
        named, unity = variables(["s", *(f"x{k}" for k in range(len(varying)))], _TERMS)
        values = {name: unity.constant(reduced.graph.value(name)) for name in reduced.valued}
        values |= {name: named[f"x{k}"] for k, name in enumerate(varying)}
        ratios = reduced.run([*channels.values(), *natural.values()], values, named["s"], unity)
        lowest = {register: ratio.lowest_terms() for register, ratio in ratios.items()}
    except FormulaTooLong:
        return None
    polynomials = {}
    for channel, register in channels.items():
        port = channel[0]
        numerator, denominator = lowest[register]
        shown = denominator
        if reduced.graph.integrates(port) and denominator % (s := unity.ring.gen(0)) == 0:
            shown = denominator // s
        modes, rest = lowest[natural[port]]
        if numerator == 0 or rest.degrees()[0] or modes % _primitive(shown) != 0:
            return None
        hidden = factors(modes // _primitive(shown))
        polynomials[channel] = ChannelPolynomials(
            numerator, denominator, factors(numerator), factors(denominator), hidden
        )
    return polynomials


def _primitive(polynomial: Any) -> Any:
    """Return the primitive part of a polynomial in s: without factors that are free of s."""
    ring = polynomial.context()
    parts: dict[int, dict[tuple[int, ...], Any]] = {}
    for powers, coefficient in polynomial.to_dict().items():
        parts.setdefault(powers[0], {})[(0, *powers[1:])] = coefficient
    return polynomial // reduce(lambda a, b: a.gcd(b), map(ring.from_dict, parts.values()))
