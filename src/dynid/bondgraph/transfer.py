"""One channel of a graph, exactly: its transfer function in lowest terms and what can be decided from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

from dynid.lti.certified import Root, certified_roots
from dynid.lti.verdicts import Verdicts

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.bondgraph.algebra.rational import Ratio


@dataclass(frozen=True)
class TransferFunction(Verdicts):
    """T(s) = numerator / denominator in lowest terms over the rationals.

    Parameters
    ----------
    numerator, denominator
        Integer polynomials without a common factor (flint `fmpz_poly`).
    starts
        Gives approximate zeros (asked for `zeros`) or poles (`poles`), where there is a quick way to them.
    """

    numerator: Any
    denominator: Any
    starts: Callable[[str], Sequence[complex] | None] = field(default=lambda _: None, compare=False)

    @classmethod
    def of(cls, ratio: Ratio) -> TransferFunction:
        """Bring a rational function into lowest terms."""
        return cls(*ratio.lowest_terms())

    @classmethod
    def of_roots(
        cls, numerator: Any, denominator: Any, zeros: tuple[Root, ...], poles: tuple[Root, ...]
    ) -> TransferFunction:
        """Return it with zeros and poles that are certified already."""
        known = cls(numerator, denominator)
        vars(known).update(zeros=zeros, poles=poles)
        return known

    def times(self, factor: Fraction) -> TransferFunction:
        """Return it times a number."""
        numerator, denominator = self.numerator * factor.numerator, self.denominator * factor.denominator
        common = numerator.gcd(denominator)
        return TransferFunction(numerator // common, denominator // common)

    @property
    def vanishes(self) -> bool:
        """Whether the input does not reach the output at all."""
        return bool(self.numerator == 0)

    def coefficients(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return numerator and denominator in descending powers, denominator monic, correctly rounded."""
        import numpy as np

        lead = int(self.denominator.leading_coefficient())

        def rounded(polynomial: Any) -> NDArray[np.float64]:
            descending = reversed([int(c) for c in polynomial.coeffs()] or [0])
            return np.array([_as_float(Fraction(c, lead)) for c in descending])

        return rounded(self.numerator), rounded(self.denominator)

    @cached_property
    def zeros(self) -> tuple[Root, ...]:
        """The finite zeros; none where the channel vanishes."""
        return () if self.vanishes else certified_roots(self.numerator, self.starts("zeros"))

    @cached_property
    def poles(self) -> tuple[Root, ...]:
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
        pad = [
            [0] * (size - p.length()) + [int(c) for c in p.coeffs()][::-1]
            for p in (self.numerator, self.denominator)
        ]
        return _limit(*pad)


def _limit(numerator: list[Any], denominator: list[Any]) -> float:
    """Return the quotient of two polynomials as the variable falls to 0+, coefficients ascending."""
    n = next((k for k, c in enumerate(numerator) if c), None)
    if n is None:
        return 0.0
    d = next(k for k, c in enumerate(denominator) if c)
    quotient = Fraction(int(numerator[n]), int(denominator[d]))
    if n == d:
        return _as_float(quotient)
    return 0.0 if n > d else math.inf if quotient > 0 else -math.inf


def _as_float(value: Fraction) -> float:
    """Round to the nearest double; beyond its range to infinity."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
