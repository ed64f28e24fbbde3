"""Zero and pole dynamics of a prototype as Park & Kim 1997 print them (eqs 5 to 12), and what they miss.

With the systems A = N_A/D_A and B = N_B/D_B of the prototype, each in lowest terms:

- a, b: eqs 5, 6 ask A and B to vanish together, which is sufficient, not necessary: the zeros of the
  driving point A + B are the roots of its numerator. Eqs 10, 11 give the natural modes with the driving port
  removed; of the driving point they are the zeros, its poles are those of A and B.
- c, d: eqs 7, 8 miss the zeros at the poles of A. Eq 12 loses the natural modes that cancel inside A B: all
  of them are the roots of D_A D_B + N_A N_B.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.reduced import Planned
from dynid.bondgraph.reduction.prototypes import Prototype
from dynid.bondgraph.transfer import TransferFunction
from dynid.lti.certified import Root

#: Bits to refine a mode to, and Newton steps at most: each doubles the bits.
_DIGITS, _MOST_STEPS = 192, 40


@dataclass(frozen=True)
class Dynamics:
    """Zero and pole dynamics of a prototype.

    Parameters
    ----------
    prototype
        The prototype.
    systems
        Its systems A and B (`Prototype.systems`) in lowest terms.
    zero, pole
        The polynomials of the printed equations (flint `fmpz_poly`); 0 where the condition always holds.
    driving_point
        The driving-point relation (eqs 1 to 4); None where it does not exist.
    natural
        The polynomial of all natural modes that A and B show with the driving port removed.
    """

    prototype: Prototype
    systems: tuple[TransferFunction, TransferFunction]
    zero: Any
    pole: Any
    driving_point: TransferFunction | None
    natural: Any

    @property
    def zero_equation(self) -> str:
        """The printed condition for zeros."""
        return {
            "a": "Z_A -> 0 and Z_B -> 0 (eq 5)",
            "b": "Y_A -> 0 and Y_B -> 0 (eq 6)",
            "c": "Z_B -> 0 as e_B/f -> 0 (eq 7)",
            "d": "Y_B*Z_A -> 0 as e_A/e -> 0 (eq 8)",
        }[self.prototype.letter]

    @property
    def pole_equation(self) -> str:
        """The printed condition for poles."""
        return {
            "a": "Z_A + Z_B = 0 (eq 10)",
            "b": "Y_A + Y_B = 0 (eq 11)",
            "c": "1 + Y_A*Z_B = 0 (eq 12)",
            "d": "1 + Z_A*Y_B = 0 (eq 12)",
        }[self.prototype.letter]

    @property
    def missed_zeros(self) -> Any:
        """The polynomial of the zeros of the driving point that the printed condition does not give."""
        return _without(self._driving_numerator, self.zero)

    @property
    def foreign_zeros(self) -> Any:
        """The polynomial of what the printed condition gives and the driving point does not have as zeros."""
        return _without(self.zero, self._driving_numerator)

    @property
    def missed_modes(self) -> Any:
        """The polynomial of the natural modes that the printed condition does not give."""
        return _without(self.natural, self.pole)

    @property
    def _driving_numerator(self) -> Any:
        return self.natural * 0 if self.driving_point is None else self.driving_point.numerator

    def net_power(self, modes: tuple[Root, ...]) -> NDArray[np.float64]:
        """Return the net power over the link port at natural modes, relative to what passes it (eq 9).

        With the driving port removed, what A gives B must take: on a 1-junction Z_A f + Z_B f = 0 for the
        common flow f, on a 0-junction Y_A e + Y_B e = 0. The modes are refined first to many digits, or far
        parts of a long line, which hardly feel the port, would show nothing but the rounding of their modes.
        Where each takes nothing for itself, no power passes at all: the net is 0.
        """
        from flint import ctx

        a, given = self.systems
        turned = not self.prototype.fixed and not given.vanishes  # back from Y_B to Z_B, or from Z_B to Y_B
        b = TransferFunction(given.denominator, given.numerator) if turned else given
        from_a, from_b = a.numerator * b.denominator, b.numerator * a.denominator
        simple = self.natural // self.natural.gcd(self.natural.derivative())
        powers = []
        with ctx.workprec(_DIGITS + 16 * int(self.natural.degree())):
            for mode in modes:
                s = _refined(simple, mode.value)
                passing = abs(from_a(s)).mid() + abs(from_b(s)).mid()
                rounding = (_sizes(from_a) + _sizes(from_b))(abs(s).mid()) * 2 ** (-ctx.prec // 2)
                net = abs(from_a(s) + from_b(s)).mid() / passing if passing > rounding else 0.0
                powers += [float(net)] * mode.multiplicity
        return np.array(powers, dtype=float)


def _sizes(polynomial: Any) -> Any:
    """Return the polynomial of the absolute coefficients, whose value at |s| bounds the terms at s."""
    return type(polynomial)([abs(coefficient) for coefficient in polynomial.coeffs()])


def _refined(polynomial: Any, value: complex) -> Any:
    """Return a simple root near a value to the working precision, by Newton's method."""
    from flint import acb, ctx

    s, derivative = acb(value.real, value.imag), polynomial.derivative()
    for _ in range(_MOST_STEPS):
        slope = derivative(s)
        if slope.contains(0):
            break
        step = (polynomial(s) / slope).mid()
        s = (s - step).mid()
        if abs(step) <= abs(s) * 2 ** (16 - ctx.prec):
            break
    return s


def dynamics_of(planned: Planned, prototype: Prototype) -> Dynamics:
    """Return the zero and pole dynamics of a prototype.

    Parameters
    ----------
    planned
        The graph whose program holds the prototype's registers.
    prototype
        The prototype.
    """
    registers = [register for _, register in prototype.systems]
    ratios = planned.rational(registers)
    a, b = (TransferFunction.of(ratios[register]) for register in registers)
    driving: TransferFunction | None
    both, crossed = a.numerator * b.numerator, a.denominator * b.denominator
    if prototype.fixed:  # a, b: A and B add
        total = a.numerator * b.denominator + b.numerator * a.denominator
        zero, natural = a.numerator.gcd(b.numerator), total
        driving = _lowest(total, crossed)
        pole = driving.numerator
    else:  # c, d: A acts back on B
        natural = crossed + both
        zero = b.numerator if prototype.letter == "c" else _lowest(both, crossed).numerator
        pole = _lowest(natural, crossed).numerator
        driving = _lowest(b.numerator * a.denominator, natural) if natural != 0 else None
    return Dynamics(prototype, (a, b), zero, pole, driving, natural)


def _lowest(numerator: Any, denominator: Any) -> TransferFunction:
    common = numerator.gcd(denominator)
    return TransferFunction(numerator // common, denominator // common)


def _without(polynomial: Any, other: Any) -> Any:
    """Return a polynomial without the roots that it shares with another, each as often as both have it."""
    return polynomial if other == 0 or polynomial == 0 else polynomial // polynomial.gcd(other)
