"""Rational functions modulo a prime: degrees and common factors, without numbers that grow."""

from __future__ import annotations

from functools import cache
from typing import Any

from dynid.bondgraph.algebra.rational import Ratio


@cache
def ratios_modulo(prime: int) -> type[Ratio]:
    """Return the type of quotients of polynomials modulo a prime (flint `nmod_poly`)."""

    class Residue(Ratio):
        """A quotient of polynomials modulo the prime."""

        __slots__ = ()

        def _zero(self) -> Any:
            return polynomial([0], prime)

    return Residue


def polynomial(coefficients: list[int], prime: int) -> Any:
    """Return a polynomial modulo a prime, coefficients ascending."""
    from flint import nmod_poly

    return nmod_poly(coefficients, prime)
