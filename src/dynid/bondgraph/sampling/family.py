"""A graph in which some values vary: planned once, its channels polynomials in s and these values.

The polynomials are evaluated exactly for many samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.formulas.symbolic import FormulaTooLong, variables
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.program.factored import PRIME, SampledResidues
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph, determinant
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

    Parameters
    ----------
    values
        For every variable but s the values of the samples.
    polynomials
        What will be evaluated (flint `fmpz_mpoly`).
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


# --- graphs of a family ---------------------------------------------------------------------------

_TERMS = SHARED_POLYNOMIALS.value
#: The residue that stands for s: any but 0 does.
_LAPLACE = 0x2F6E2B1D

SampleValues = Mapping[str, Sequence[Fraction]]
"""For every value that varies those of the samples, exact."""


@dataclass(frozen=True)
class ChannelPolynomials:
    """A channel of a family."""

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


class GraphFamily:
    """Graphs that differ in the values of some elements.

    Parameters
    ----------
    graph
        One of them; what varies in it counts for nothing.
    varying
        The elements whose values vary. A value of zero is another structure, and not of the family.

    Raises
    ------
    Singular
        Where the equations have no unique solution whatever the values.
    """

    def __init__(
        self,
        graph: BondGraph,
        inputs: Sequence[str],
        outputs: Sequence[Port],
        varying: Sequence[str],
        *,
        traced: bool,
    ) -> None:
        self.varying = tuple(varying)
        stand_ins = {name: Fraction(1009 + 20 * k, 7) for k, name in enumerate(varying)}
        self.reduced = ReducedGraph(graph.with_values(stand_ins), inputs, outputs, traced=traced)
        # elements that no output depends on, but whose values decide whether sources agree
        structure, deciding = self.reduced.structure, set[str]()
        for name in self.reduced.unsolved():
            deciding.update(structure.junctions[name].elements)
            deciding.update(coupling.two_port for coupling in structure.tied[name] if coupling.two_port)
        self._alone = bool(self.reduced.undetermined) or not deciding.isdisjoint(varying)

    def holds(self, values: SampleValues, count: int) -> NDArray[np.bool_]:
        """Return for which samples the plan holds: nothing that it divides by vanishes.

        What is not zero modulo a prime is not zero; a sample that is zero modulo the prime counts as one for
        which it does not hold.
        """
        vanished = np.full(count, self._alone)  # elsewhere some values may contradict each other
        fixed = {name: [self.reduced.graph.value(name)] * count for name in self.reduced.valued}
        residues = {name: SampledResidues.of(v, vanished) for name, v in (fixed | dict(values)).items()}
        unity, s = (
            SampledResidues(np.full(count, x, dtype=np.int64), vanished) for x in (1, _LAPLACE % PRIME)
        )
        for value in values.values():
            vanished |= np.array([not number for number in value], dtype=bool)
        pivots = self.reduced.pivots()
        registers = self.reduced.run([*self.reduced.answers(), *pivots], residues, s, unity)
        for pivot in pivots:
            vanished |= registers[pivot].images == 0
        return ~vanished

    def at(self, values: Mapping[str, Fraction]) -> ReducedGraph:
        """Return one of the graphs, for which the plan is known to hold."""
        return self.reduced.with_values(values)

    @cached_property
    def polynomials(self) -> dict[Channel, ChannelPolynomials] | None:
        """The channels; None where they have too many terms, or a channel is zero whatever the values."""
        reduced = self.reduced
        channels = reduced.channels()
        natural = {port: determinant(reduced, reduction) for port, reduction in reduced.reductions.items()}
        try:
            named, unity = variables(["s", *(f"x{k}" for k in range(len(self.varying)))], _TERMS)
            values = {name: unity.constant(reduced.graph.value(name)) for name in reduced.valued}
            values |= {name: named[f"x{k}"] for k, name in enumerate(self.varying)}
            ratios = reduced.run([*channels.values(), *natural.values()], values, named["s"], unity)
            lowest = {register: ratio.lowest_terms() for register, ratio in ratios.items()}
        except FormulaTooLong:
            return None
        channel_polynomials = {}
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
            channel_polynomials[channel] = ChannelPolynomials(
                numerator, denominator, factors(numerator), factors(denominator), hidden
            )
        return channel_polynomials


def _primitive(polynomial: Any) -> Any:
    """Return the primitive part of a polynomial in s: without factors that are free of s."""
    ring = polynomial.context()
    parts: dict[int, dict[tuple[int, ...], Any]] = {}
    for powers, coefficient in polynomial.to_dict().items():
        parts.setdefault(powers[0], {})[(0, *powers[1:])] = coefficient
    return polynomial // reduce(lambda a, b: a.gcd(b), map(ring.from_dict, parts.values()))
