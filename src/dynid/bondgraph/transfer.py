"""One channel of a graph, exactly: its transfer function in lowest terms and what can be decided from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any

from dynid.lti.certified import Root, certified_roots

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.bondgraph.algebra.rational import Ratio


#: Most zeros or poles that a verdict names.
_SHOWN = 4


@dataclass(frozen=True)
class TransferFunction:
    """T(s) = numerator / denominator in lowest terms over the rationals.

    Parameters
    ----------
    numerator, denominator
        Integer polynomials without a common factor (flint `fmpz_poly`).
    """

    numerator: Any
    denominator: Any

    @classmethod
    def of(cls, ratio: Ratio) -> TransferFunction:
        """Bring a rational function into lowest terms."""
        return cls(*ratio.lowest_terms())

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
        return () if self.vanishes else certified_roots(self.numerator)

    @cached_property
    def poles(self) -> tuple[Root, ...]:
        """The poles."""
        return certified_roots(self.denominator)

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

    @property
    def stable(self) -> bool:
        """Whether every pole lies in the open left half-plane."""
        return all(pole.side < 0 for pole in self.poles)

    @property
    def stability(self) -> str:
        """The stability verdict in words, with the poles that decide it."""
        right = [pole for pole in self.poles if pole.side > 0]
        axis = [pole for pole in self.poles if pole.side == 0]
        repeated = [pole for pole in axis if pole.multiplicity > 1]
        if right or repeated:
            where = "in the right half-plane" if right else "repeated on the imaginary axis"
            return f"unstable: {_place(right or repeated, 'pole')} {where}"
        if axis:
            return f"marginal, not stable: {_place(axis, 'pole')} on the imaginary axis"
        return "stable" if self.poles else "stable: there are no poles"

    @property
    def minimum_phase(self) -> bool:
        """Whether every zero lies in the open left half-plane (no zeros: yes; a vanishing channel: no)."""
        return not self.vanishes and all(zero.side < 0 for zero in self.zeros)

    @property
    def zero_stability(self) -> str:
        """The phase verdict in words, with the zeros that decide it."""
        right = [zero for zero in self.zeros if zero.side > 0]
        axis = [zero for zero in self.zeros if zero.side == 0]
        if self.vanishes:
            return "undefined: the input does not reach the output"
        if right:
            return (
                f"non-minimum phase: {_place(right, 'zero')} in the right half-plane; its inverse is unstable"
            )
        if axis:
            where = f"{_place(axis, 'zero')} on the imaginary axis"
            return f"marginal, not minimum phase: {where}, so {_consequence(axis)}"
        if not self.zeros:
            return "minimum phase: there are no finite zeros"
        return "minimum phase: every zero lies in the open left half-plane"


def _consequence(zeros: list[Root]) -> str:
    """Say what zeros on the axis mean: an internal motion that neither decays nor shows."""
    repeated = any(zero.multiplicity > 1 for zero in zeros)
    ringing = sorted({f"{abs(zero.value):.4g}" for zero in zeros if zero.value}, key=float)
    motion = f"ring unseen at {', '.join(ringing)} rad/s" if ringing else "hold a constant state unseen"
    return f"with the output held at zero the inside can {motion}" + (" and grow" if repeated else "")


def _place(roots: list[Root], what: str) -> str:
    count = sum(root.multiplicity for root in roots)
    upper = [root.value for root in roots if root.value.imag >= 0]
    shown = [_number(value) for value in upper[:_SHOWN]]
    text = ", ".join(shown) + (", …" if len(upper) > _SHOWN else "")
    return f"{what} at {text} lies" if count == 1 else f"{what}s at {text} lie"


def _number(value: complex) -> str:
    if value.imag == 0:
        return f"{value.real:.4g}"
    return f"±{abs(value.imag):.4g}j" if value.real == 0 else f"{value.real:.4g} ± {abs(value.imag):.4g}j"


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
