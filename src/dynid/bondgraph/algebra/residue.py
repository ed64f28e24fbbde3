"""Quotients of polynomials modulo a prime: degrees and common factors, without numbers that grow."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from dynid.bondgraph.algebra.quotient import Factor, Quotient
from dynid.bondgraph.algebra.rational import Ratio


@cache
def ratios_modulo(prime: int) -> type[Ratio]:
    """Return the type of rational functions of s modulo a prime (flint `nmod_poly`)."""

    class RatioModulo(Ratio):
        """A rational function of s modulo the prime."""

        __slots__ = ()

        def _zero(self) -> Any:
            return polynomial([0], prime)

    return RatioModulo


class Residue(Quotient):
    """A quotient of polynomials modulo a prime, factored as it came about.

    Parameters
    ----------
    factors, sign
        As for any quotient.
    prime
        The prime.
    """

    __slots__ = ("prime",)

    def __init__(self, factors: Mapping[Factor, int] | None, sign: int, prime: int) -> None:
        super().__init__(factors, sign)
        self.prime = prime

    def _made(self, factors: Mapping[Factor, int] | None, sign: int, other: Residue) -> Residue:  # noqa: ARG002
        return Residue(factors, sign, self.prime)

    def _zero(self) -> Any:
        return polynomial([0], self.prime)


def polynomial(coefficients: list[int], prime: int) -> Any:
    """Return a polynomial modulo a prime, coefficients ascending."""
    from flint import nmod_poly

    return nmod_poly(coefficients, prime)
