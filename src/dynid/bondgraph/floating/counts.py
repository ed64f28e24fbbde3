"""What is known exactly of a transfer function without its roots: how many, how repeated, how placed.

The program is run on rational functions of s modulo a large prime. Degrees, multiplicities, roots at the
origin and the roots that come with their mirror image about the imaginary axis are the same there as over
the rationals, but for accidents with a probability of about degree/2^61.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from dynid.bondgraph.algebra.modular import numeric_point
from dynid.bondgraph.algebra.rational import Ratio
from dynid.bondgraph.algebra.residue import polynomial, ratios_modulo
from dynid.bondgraph.reduced import ReducedGraph


@dataclass(frozen=True)
class Counts:
    """What is known of the roots of one polynomial.

    Parameters
    ----------
    polynomial
        The polynomial modulo a prime (flint `nmod_poly`).
    """

    polynomial: Any

    @property
    def degree(self) -> int:
        """The number of roots, by multiplicity (-1 of the zero polynomial)."""
        return int(self.polynomial.degree())

    @cached_property
    def at_origin(self) -> int:
        """The multiplicity of the root 0."""
        return next((power for power in range(self.degree + 1) if self.polynomial[power] != 0), 0)

    @cached_property
    def mirrored(self) -> int:
        """How many roots, by multiplicity, come with their mirror image about the imaginary axis.

        All roots on the axis do. With p(s) = E(s^2) + s O(s^2) they are the roots of gcd(E, O).
        """
        shared, factors = 0, self.polynomial.factor_squarefree()[1]
        for factor, multiplicity in factors:
            coefficients = factor.coeffs()
            origin = int(coefficients[0] == 0)
            even, odd = (self._made(coefficients[origin + k :: 2]) for k in (0, 1))
            shared += multiplicity * (origin + 2 * max(int(even.gcd(odd).degree()), 0))
        return int(shared)

    @cached_property
    def multiplicities(self) -> list[int]:
        """The multiplicities of the distinct roots, in order."""
        if self.degree < 1:
            return []
        factors = self.polynomial.factor_squarefree()[1]
        return sorted(int(power) for factor, power in factors for _ in range(int(factor.degree())))

    def times_s(self) -> Counts:
        """Return the counts with one more root at the origin."""
        return Counts(self.polynomial * self._made([0, 1]))

    def _made(self, coefficients: list[Any]) -> Any:
        return polynomial([int(c) for c in coefficients], self.polynomial.modulus())


def modular_ratios(reduced: ReducedGraph, registers: Iterable[int]) -> dict[int, tuple[Counts, Counts]]:
    """Return the counts of numerator and denominator, in lowest terms, of these registers.

    Raises
    ------
    ZeroDivisionError
        Where a pivot vanishes with the graph's values.
    """
    registers, prime = list(registers), reduced.program.prime
    point = numeric_point({name: reduced.graph.value(name) for name in reduced.valued}, prime)
    bits = {name: 1 << index for index, name in enumerate(reduced.storages)}
    residue, unity = ratios_modulo(prime), polynomial([1], prime)

    def constant(value: int, storages: int = 0) -> Ratio:
        return residue.of(polynomial([value], prime), unity, storages)

    values = {name: constant(int(value), bits.get(name, 0)) for name, value in point.values.items()}
    run = reduced.run(registers, values, residue.of(polynomial([0, 1], prime), unity), constant(1))
    lowest = {register: run[register].lowest_terms() for register in registers}
    return {register: (Counts(above), Counts(below)) for register, (above, below) in lowest.items()}
