"""Zero and pole dynamics of a prototype as Park & Kim 1997 print them (eqs 5 to 12), and the complete ones.

With the systems A = N_A/D_A and B = N_B/D_B of the prototype, each in lowest terms:

- Eqs 5 to 8 give the zeros of a response that the paper names: e/f of a, f/e of b, e_B/f of c, e_A/e of d.
  Eqs 5, 6 ask A and B to vanish together, which is sufficient, not necessary: the zeros of A + B are the
  roots of its numerator. Eq 7 misses the zeros at the poles of Y_A. Eq 8 is exact.
- Eqs 10, 11 give the natural modes with the driving port removed; of the driving point of a and b they are
  the zeros, its poles are those of A and B. Eq 12 loses the natural modes that cancel inside A B.

The natural modes are the roots of the determinant of the whole graph. Where A and B are independent it is
D_A D_B + N_A N_B (N_A D_B + N_B D_A for a and b) times what neither of them shows. Where the driven junction
lies on a loop, A and B share the loop, and these products count the shared part twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.exact_engine import TransferFunction
from dynid.bondgraph.reduced_graph import GraphProgram
from dynid.bondgraph.reduction.prototypes import Prototype
from dynid.lti.certified_roots import CertifiedRoot

#: Bits to refine a mode to, and Newton steps at most: each doubles the bits.
_REFINED_BITS, _MAX_NEWTON_STEPS = 192, 40


@dataclass(frozen=True)
class PrototypeDynamics:
    """Zero and pole dynamics of a prototype."""

    prototype: Prototype
    #: Its systems A and B (`Prototype.systems`) in lowest terms.
    systems: tuple[TransferFunction, TransferFunction]
    #: zero, pole: The polynomials of the printed equations (flint `fmpz_poly`); 0 where the condition always
    #: holds.
    zero: Any
    pole: Any
    #: The driving-point relation (eqs 1 to 4); None where it does not exist.
    driving_point: TransferFunction | None
    #: The response that eqs 5 to 8 name (`Prototype.response_name`); None where it does not exist.
    response: TransferFunction | None
    #: The polynomial of all natural modes with the driving port removed: the determinant of the whole.
    natural: Any
    shown: Any  # the factor of it whose modes the systems A and B show

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
        """The polynomial of the zeros of the named response that the printed condition does not give."""
        return _without(self._named_numerator, self.zero)

    @property
    def foreign_zeros(self) -> Any:
        """The polynomial of roots of the printed condition that are no zeros of the named response."""
        return _without(self.zero, self._named_numerator)

    @property
    def missed_modes(self) -> Any:
        """The polynomial of the natural modes that the printed condition does not give."""
        return _without(self.natural, self.pole)

    @property
    def foreign_modes(self) -> Any:
        """The polynomial of roots of the printed condition that are no natural modes."""
        return _without(self.pole, self.natural)

    @property
    def hidden_modes(self) -> Any:
        """The polynomial of the natural modes that neither A nor B shows."""
        return _without(self.natural, self.shown)

    @property
    def _named_numerator(self) -> Any:
        return self.natural * 0 if self.response is None else self.response.numerator

    def net_power(self, modes: tuple[CertifiedRoot, ...]) -> NDArray[np.float64]:
        """Return the net power over the link port at natural modes, relative to what passes it (eq 9).

        With the driving port removed, what A gives B must take: on a 1-junction Z_A f + Z_B f = 0 for the
        common flow f, on a 0-junction Y_A e + Y_B e = 0. The modes are refined first to many digits, or far
        parts of a long line, which hardly feel the port, would show nothing but the rounding of their modes.
        Where each takes nothing for itself, no power passes at all: the net is 0. So it is in a mode that
        neither shows: it does not move the port, or leaves the balance there as it is.
        """
        from flint import ctx

        from dynid.arithmetic.field_polynomials import integers

        # powers that A and B take for a unit of the common variable, times their denominators
        a, system_b = self.systems
        turned = (
            not self.prototype.fixed and not system_b.vanishes
        )  # back from Y_B to Z_B, or from Z_B to Y_B
        b = TransferFunction(system_b.denominator, system_b.numerator) if turned else system_b
        from_a, from_b = integers(a.numerator * b.denominator, b.numerator * a.denominator)
        simple = self.natural // self.natural.gcd(self.natural.derivative())
        hidden = _without(simple, self.shown)
        seen = simple // hidden
        simple, hidden, seen = (integers(polynomial)[0] for polynomial in (simple, hidden, seen))
        powers = []
        with ctx.workprec(_REFINED_BITS + 16 * int(self.natural.degree())):
            for mode in modes:
                s = _refined(simple, mode.value)
                passing = abs(from_a(s)).mid() + abs(from_b(s)).mid()
                rounding = (_sizes(from_a) + _sizes(from_b))(abs(s).mid()) * 2 ** (-ctx.prec // 2)
                shows = not _nearer(hidden, seen, s) and passing > rounding
                net = float(abs(from_a(s) + from_b(s)).mid() / passing) if shows else 0.0
                powers += [net] * mode.multiplicity
        return np.array(powers, dtype=float)


def _nearer(first: Any, second: Any, s: Any) -> bool:
    """Test whether a refined root of the product of two coprime polynomials is one of the first."""
    if first.degree() < 1 or second.degree() < 1:
        return bool(first.degree() > 0)
    here, there = (abs(polynomial(s)).mid() for polynomial in (first, second))
    slope_here, slope_there = (abs(polynomial.derivative()(s)).mid() for polynomial in (first, second))
    return bool(here * slope_there < there * slope_here)  # the shorter Newton step


def _sizes(polynomial: Any) -> Any:
    """Return the polynomial of the absolute coefficients, whose value at |s| bounds the terms at s."""
    return type(polynomial)([abs(coefficient) for coefficient in polynomial.coeffs()])


def _refined(polynomial: Any, value: complex) -> Any:
    """Return a simple root near a value to the working precision, by Newton's method."""
    from flint import acb, ctx

    s, derivative = acb(value.real, value.imag), polynomial.derivative()
    for _ in range(_MAX_NEWTON_STEPS):
        slope = derivative(s)
        if slope.contains(0):
            break
        step = (polynomial(s) / slope).mid()
        s = (s - step).mid()
        if abs(step) <= abs(s) * 2 ** (16 - ctx.prec):
            break
    return s


def prototype_dynamics(planned: GraphProgram, prototype: Prototype) -> PrototypeDynamics:
    """Return the zero and pole dynamics of a prototype."""
    assert prototype.released is not None
    registers, characteristic = [register for _, register in prototype.systems], prototype.released()
    ratios = planned.rational([*registers, characteristic])
    a, b = (TransferFunction.over_field(ratios[register]) for register in registers)
    natural = ratios[characteristic].lowest_terms()[0]
    both, crossed = a.numerator * b.numerator, a.denominator * b.denominator
    driving: TransferFunction | None
    response: TransferFunction | None
    if prototype.fixed:  # a, b: A and B add
        total = a.numerator * b.denominator + b.numerator * a.denominator
        driving = response = _lowest(total, crossed)
        zero, pole, counted = a.numerator.gcd(b.numerator), driving.numerator, total
    else:  # c, d: A acts back on B
        counted = crossed + both
        loop = _lowest(both, crossed)
        driving = _lowest(b.numerator * a.denominator, counted) if counted != 0 else None
        exact = prototype.letter == "d"
        zero, pole = loop.numerator if exact else b.numerator, _lowest(counted, crossed).numerator
        response = (_lowest(both, counted) if counted != 0 else None) if exact else driving
    if prototype.shared() and counted != 0:  # of what A and B count, the part that the port feels
        total = _lowest(counted, crossed if prototype.fixed else a.denominator * b.numerator)
        counted = total.numerator
    shown = natural.gcd(counted)
    return PrototypeDynamics(prototype, (a, b), zero, pole, driving, response, natural, shown)


def _lowest(numerator: Any, denominator: Any) -> TransferFunction:
    common = numerator.gcd(denominator)
    return TransferFunction(numerator // common, denominator // common)


def _without(polynomial: Any, divisor: Any) -> Any:
    """Return a polynomial without the roots that it shares with another, each as often as both have it."""
    return polynomial if divisor == 0 or polynomial == 0 else polynomial // polynomial.gcd(divisor)
