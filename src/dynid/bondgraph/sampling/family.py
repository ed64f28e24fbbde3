"""A graph in which some values vary: planned once, its channels polynomials in s and these values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.algebra.residues import PRIME, SampledResidues
from dynid.bondgraph.algebra.symbolic import TooLong, variables
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.natural import determinant
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.bondgraph.sampling.polynomials import Factor, factors
from dynid.choices import SHARED_POLYNOMIALS

_TERMS = SHARED_POLYNOMIALS.value
#: The residue that stands for s: any but 0 does.
_LAPLACE = 0x2F6E2B1D

Values = Mapping[str, Sequence[Fraction]]
"""For every value that varies those of the samples, exact."""


@dataclass(frozen=True)
class Polynomials:
    """A channel of a family.

    Parameters
    ----------
    numerator, denominator
        Without a common factor (flint `fmpz_mpoly`, s being the first variable).
    zeros, poles, hidden
        The factors of numerator, denominator, and the polynomial of the natural modes that cancel.
    """

    numerator: Any
    denominator: Any
    zeros: tuple[Factor, ...]
    poles: tuple[Factor, ...]
    hidden: tuple[Factor, ...]

    @property
    def factors(self) -> tuple[Factor, ...]:
        """All of these factors."""
        return (*self.zeros, *self.poles, *self.hidden)


class Family:
    """Graphs that differ in the values of some elements.

    Parameters
    ----------
    graph
        One of them; what varies in it counts for nothing.
    inputs, outputs
        The channels asked for.
    varying
        The elements whose values vary. A value of zero is another structure, and not of the family.
    traced
        Whether the reductions tell their steps.

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

    def holds(self, values: Values, count: int) -> NDArray[np.bool_]:
        """Tell for which samples the plan holds: nothing that it divides by vanishes.

        What is not zero modulo a prime is not zero; a sample for which that cannot be told counts as one for
        which it does not hold.
        """
        vanished = np.zeros(count, dtype=bool)
        fixed = {name: [self.reduced.graph.value(name)] * count for name in self.reduced.valued}
        residues = {name: SampledResidues.of(v, vanished) for name, v in (fixed | dict(values)).items()}
        one, s = (SampledResidues(np.full(count, x, dtype=np.int64), vanished) for x in (1, _LAPLACE % PRIME))
        for value in values.values():
            vanished |= np.array([not number for number in value], dtype=bool)
        pivots = self.reduced.pivots()
        found = self.reduced.run([*self.reduced.answers(), *pivots], residues, s, one)
        for pivot in pivots:
            vanished |= found[pivot].images == 0
        return ~vanished

    def at(self, values: Mapping[str, Fraction]) -> ReducedGraph:
        """Return one of the graphs, for which the plan is known to hold."""
        return self.reduced.with_values(values)

    @cached_property
    def polynomials(self) -> dict[Channel, Polynomials] | None:
        """The channels; None where they have too many terms, or a channel is zero whatever the values."""
        try:
            return self._polynomials()
        except TooLong:
            return None

    def _polynomials(self) -> dict[Channel, Polynomials] | None:
        reduced = self.reduced
        named, one = variables(["s", *(f"x{k}" for k in range(len(self.varying)))], _TERMS)
        values = {name: one.constant(reduced.graph.value(name)) for name in reduced.valued}
        values |= {name: named[f"x{k}"] for k, name in enumerate(self.varying)}
        channels = reduced.channels()
        natural = {port: determinant(reduced, reduction) for port, reduction in reduced.reductions.items()}
        ratios = reduced.run([*channels.values(), *natural.values()], values, named["s"], one)
        found = {}
        for channel, register in channels.items():
            port = channel[0]
            numerator, denominator = ratios[register].lowest_terms()
            shown = denominator
            if reduced.graph.integrates(port) and denominator % (s := one.ring.gen(0)) == 0:
                shown = denominator // s
            modes, rest = ratios[natural[port]].lowest_terms()
            if numerator == 0 or rest.degrees()[0] or modes % _primitive(shown) != 0:
                return None
            found[channel] = Polynomials(
                numerator,
                denominator,
                factors(numerator),
                factors(denominator),
                factors(modes // _primitive(shown)),
            )
        return found


def _primitive(polynomial: Any) -> Any:
    """Return a polynomial less what it is a multiple of without s."""
    ring = polynomial.context()
    parts: dict[int, dict[tuple[int, ...], Any]] = {}
    for powers, coefficient in polynomial.to_dict().items():
        parts.setdefault(powers[0], {})[(0, *powers[1:])] = coefficient
    return polynomial // reduce(lambda a, b: a.gcd(b), map(ring.from_dict, parts.values()))
