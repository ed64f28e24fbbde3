"""Quasi-polynomials, sums of polynomials times exp(-s τ): the characteristic functions of loops with delays.

Values on the imaginary axis are enclosed by ball arithmetic, for single frequencies and for intervals. The
roots right of a line are counted by the argument principle, with a proof that no turn is missed
(`roots_right_of`); single roots are refined by Newton's method and proved to be isolated (`refined_root`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

from dynid.errors import Undecided

#: Working precision, bits.
PRECISION = 160
#: Relative width below which an interval of frequencies is not divided further.
_NARROW = 2.0**-60
#: Size below which a root beside one at the origin is that root.
_ORIGIN = 1e-30
#: Bits of a value that is exact to double precision.
_DOUBLE = 60
#: Doublings of a radius before it is given up.
_DOUBLINGS = 2000


class QuasiPolynomial:
    """A sum of polynomials P_k(s) times exp(-s τ_k).

    Parameters
    ----------
    terms
        Integer polynomials (flint `fmpz_poly`) by delay, s, not negative; those that are zero are left out.
        For the algebra of this class they may be over a field (`FieldPolynomial`).
    """

    def __init__(self, terms: Mapping[Fraction, Any]) -> None:
        self.terms = {delay: terms[delay] for delay in sorted(terms) if terms[delay] != 0}

    def __add__(self, other: QuasiPolynomial) -> QuasiPolynomial:
        terms = dict(self.terms)
        for delay, polynomial in other.terms.items():
            terms[delay] = terms[delay] + polynomial if delay in terms else polynomial
        return QuasiPolynomial(terms)

    def __sub__(self, other: QuasiPolynomial) -> QuasiPolynomial:
        return self + QuasiPolynomial({delay: -polynomial for delay, polynomial in other.terms.items()})

    def over(self, factor: Any) -> QuasiPolynomial:
        """Return it divided by a polynomial that divides every term."""
        return QuasiPolynomial({delay: polynomial // factor for delay, polynomial in self.terms.items()})

    @property
    def degree(self) -> int:
        """The largest degree of its polynomials; -1 of zero."""
        return max((int(polynomial.degree()) for polynomial in self.terms.values()), default=-1)

    @property
    def is_rational(self) -> bool:
        """True if it is a polynomial: no term has a delay."""
        return not any(self.terms)

    def leading(self, degree: int) -> dict[Fraction, Fraction]:
        """Return the coefficients of s^degree by delay."""
        return {delay: Fraction(int(polynomial[degree])) for delay, polynomial in self.terms.items()}

    def at_origin(self) -> int:
        """Return its value at s = 0, exactly."""
        return sum(int(polynomial[0]) for polynomial in self.terms.values())

    @cached_property
    def balls(self) -> Balls:
        """It, and its first two derivatives, in ball arithmetic."""
        return Balls.of(self)

    def __call__(self, s: complex) -> complex:
        """Return its value, rounded."""
        from flint import acb, ctx

        with ctx.workprec(PRECISION):
            value = self.balls.values(acb(s.real, s.imag))[0]
            return complex(float(value.real.mid()), float(value.imag.mid()))


def common_factor(parts: Iterable[QuasiPolynomial]) -> Any:
    """Return the greatest common divisor of all polynomials of some quasi-polynomials."""
    from flint import fmpz_poly

    polynomials = [polynomial for part in parts for polynomial in part.terms.values()]
    if not polynomials:
        return fmpz_poly([1])
    found = 0 * polynomials[0]
    for polynomial in polynomials:
        found = found.gcd(polynomial)
    return found


@dataclass(frozen=True)
class _Term:
    """exp(-s τ) times a polynomial and its first two derivatives (flint `acb_poly`)."""

    delay: Any
    polynomials: tuple[Any, Any, Any]


@dataclass(frozen=True)
class Balls:
    """A quasi-polynomial in ball arithmetic.

    Parameters
    ----------
    terms
        Its terms, the one without delay first where there is one.
    """

    terms: tuple[_Term, ...]

    @classmethod
    def of(cls, given: QuasiPolynomial, line: float = 0.0, precision: int = PRECISION) -> Balls:
        """Return a quasi-polynomial as a function of s - line."""
        from flint import acb, acb_poly, arb, ctx, fmpq

        terms = []
        with ctx.workprec(precision):
            for delay, polynomial in given.terms.items():
                exact = arb(fmpq(delay.numerator, delay.denominator))
                moved = acb_poly(polynomial)
                if line:
                    moved = moved(acb_poly([line, 1])) * acb((-arb(line) * exact).exp())
                terms.append(_Term(exact, (moved, moved.derivative(), moved.derivative().derivative())))
        return cls(tuple(terms))

    def values(self, s: Any, orders: int = 1) -> list[Any]:
        """Return enclosures of value and derivatives at a ball (flint `acb`)."""
        from flint import acb

        found = [acb(0) for _ in range(orders)]
        for term in self.terms:
            delay, factor = term.delay, (-s * term.delay).exp()
            p = [polynomial(s) for polynomial in term.polynomials[:orders]]
            found[0] += p[0] * factor
            if orders > 1:
                found[1] += (p[1] - delay * p[0]) * factor
            if orders > 2:
                found[2] += (p[2] - 2 * delay * p[1] + delay * delay * p[0]) * factor
        return found

    def on_axis(self, low: Any, high: Any) -> Any:
        """Return an enclosure of the values at s = jω, low <= ω <= high, by the mean value theorem."""
        from flint import acb

        middle, whole = (low + high) / 2, low.union(high)
        slope = self.values(acb(0, whole), 2)[1]
        return self.values(acb(0, middle))[0] + slope * acb(0, whole - middle)

    def sizes(self, low: Any, high: Any) -> tuple[Any, list[Any]]:
        """Return an enclosure of the first term at s = jω, and bounds on the sizes of the others there."""
        from flint import acb

        first, *others = self.terms
        middle, whole = (low + high) / 2, low.union(high)
        own = acb(0, whole - middle) * first.polynomials[1](acb(0, whole))
        own += first.polynomials[0](acb(0, middle))
        return own, [term.polynomials[0](acb(0, whole)).abs_upper() for term in others]


# --- number of roots right of a line ----------------------------------------------------------------


def roots_right_of(given: QuasiPolynomial, line: float = 0.0) -> int:
    """Return the number of roots with real part above `line`, multiple ones counted so.

    The argument of Q along the line is followed over intervals of frequencies on which Q, or the part by
    which its delayed terms turn the one without delay, provably does not turn by more than half a turn; on
    the large half circle its leading term prevails (the Nyquist criterion).

    Parameters
    ----------
    given
        The quasi-polynomial; its term without delay has the largest degree, and the leading coefficients of
        the others sum up to less than its own (on the line).
    line
        Real part of the line.

    Raises
    ------
    Undecided
        Where a root lies on the line, or too near to be told from one that does; or where infinitely many
        roots may lie right of it (a neutral equation).
    """
    from flint import acb, ctx

    with ctx.workprec(PRECISION):
        balls = given.balls if not line else Balls.of(given, line)
        degree = given.degree
        radius = _radius(balls, degree)
        lead = balls.terms[0].polynomials[0][degree]
        top = acb(0, radius)
        at_top = balls.values(top)[0] / (lead * top**degree)
        turned = sum(_turns(balls, radius))
        count = degree / 2 + (float(at_top.arg().mid()) - turned) / math.pi
    nearest = round(count)
    if abs(count - nearest) > 1e-6:
        raise Undecided(f"the argument of the characteristic function sums up to {count:.3f} roots")
    return nearest


def _radius(balls: Balls, degree: int) -> Any:
    """Return a radius outside of which the leading term prevails in the right half-plane."""
    from flint import arb

    lead = abs(balls.terms[0].polynomials[0][degree])
    if not balls.terms[0].delay == 0 or not lead > 0:
        raise Undecided("the delayed terms have the largest degree: infinitely many roots lie to the right")
    sizes = [
        [abs(term.polynomials[0][k]) / lead for k in range(term.polynomials[0].degree() + 1)]
        for term in balls.terms
    ]
    leading = sum((own[degree] for own in sizes[1:] if len(own) > degree), arb(0))
    allowed = (1 + leading) / 2
    if not leading < 1:
        raise Undecided(
            "the delayed terms do not vanish at high frequencies: the equation is of neutral type"
        )
    radius = arb(2) ** -200
    for _ in range(_DOUBLINGS):
        rest = arb(0)
        for own in sizes:
            for k, size in enumerate(own[:degree]):
                rest += size * radius ** (k - degree)
        if leading + rest < allowed:
            return radius
        radius *= 2
    raise Undecided("the coefficients of the characteristic function are out of range")  # pragma: no cover


def _turns(balls: Balls, top: Any) -> Iterator[float]:
    """Yield the changes of the argument of Q(jω) over intervals from ω = 0 to the top."""
    from flint import acb, arb

    intervals = [(arb(0), top)]
    while intervals:
        low, high = intervals.pop()
        ends = [acb(0, low), acb(0, high)]
        if balls.on_axis(low, high).abs_lower() > 0:
            one, other = (balls.values(end)[0] for end in ends)
            yield float((other / one).arg().mid())
            continue
        own, others = balls.sizes(low, high)
        if own.abs_lower() > 0 and sum(others, arb(0)) < own.abs_lower():
            first = balls.terms[0].polynomials[0]
            yield float((first(ends[1]) / first(ends[0])).arg().mid())
            one, other = (balls.values(end)[0] / first(end) for end in ends)
            yield float((other.arg() - one.arg()).mid())
            continue
        intervals += divided(low, high, top)[::-1]


def divided(low: Any, high: Any, top: Any) -> list[tuple[Any, Any]]:
    """Divide an interval of frequencies in two, in a ratio where it is wide.

    Raises
    ------
    Undecided
        Where it is too narrow.
    """
    if high - low <= _NARROW * high or high <= top * _NARROW**2:
        where = float(high.mid())
        raise Undecided(
            f"a root lies on the imaginary axis near {where:.6g} rad/s, or within round-off of it"
        )
    if low == 0:
        middle = high / 8
    elif high > 4 * low:
        middle = (low * high).sqrt().mid()
    else:
        middle = ((low + high) / 2).mid()
    return [(low, middle), (middle, high)]


# --- single roots -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class RefinedRoot:
    """A root that was refined.

    Parameters
    ----------
    value
        The root.
    radius
        Proved bound on its error: one root, a simple one, lies within.
    """

    value: complex
    radius: float


def refined_root(given: QuasiPolynomial, start: complex) -> RefinedRoot | None:
    """Return the root to which Newton's method leads from a first value; None where it leads to none.

    That a simple root lies within the radius is proved by the interval Newton operator.
    """
    from flint import acb, arb, ctx

    with ctx.workprec(PRECISION):
        balls, s = given.balls, acb(start.real, start.imag)
        for _ in range(60):
            value, slope = balls.values(s, 2)
            if slope.abs_lower() == 0:
                return None
            step = (value / slope).mid()
            s = (s - step).mid()
            if step.abs_upper() <= _NARROW**2 * s.abs_upper():
                break
            if not s.abs_upper() < 1e6 * (1 + abs(start)):
                return None
        root = complex(float(s.real), float(s.imag))
        about = acb(root.real, root.imag)
        radius = 2.0**-50 * abs(root)
        for _ in range(20):
            disc = about + acb(arb(0, radius), arb(0, radius))
            slope = balls.values(disc, 2)[1]
            if slope.abs_lower() > 0:
                move = balls.values(about)[0] / slope
                if move.real.abs_upper() < radius and move.imag.abs_upper() < radius:
                    return RefinedRoot(root, math.nextafter(math.sqrt(2) * radius, math.inf))
            radius *= 4
    return None


def rightmost_roots(
    given: QuasiPolynomial, starts: Iterable[complex], most: int
) -> tuple[list[RefinedRoot], float]:
    """Return the rightmost roots, and a line right of which none is missing (inf where that is not proved).

    Parameters
    ----------
    given
        As in `roots_right_of`.
    starts
        First values, of which many may lead to one root.
    most
        About the number of roots that are wanted.
    """
    found = [RefinedRoot(0j, 0.0)] if given.at_origin() == 0 else []
    for start in sorted(starts, key=lambda s: -s.real):
        if start.imag < 0:
            continue
        root = refined_root(given, start)
        if (
            root is None
            or (found and abs(root.value) < _ORIGIN and not found[0].radius)
            or any(abs(root.value - one.value) <= root.radius + one.radius for one in found)
        ):
            continue
        if abs(root.value.imag) <= root.radius:
            root = RefinedRoot(complex(root.value.real), root.radius)
        found.append(root)
        if root.value.imag < 0:
            root = found[-1] = RefinedRoot(root.value.conjugate(), root.radius)
        if root.value.imag:
            found.append(RefinedRoot(root.value.conjugate(), root.radius))
    found.sort(key=lambda root: (-root.value.real, abs(root.value.imag), -root.value.imag))
    for kept in range(min(most, len(found) - 1), 0, -1):
        upper, lower = found[kept - 1].value.real, found[kept].value.real
        line = (upper + lower) / 2
        if not upper > line > lower:
            continue
        try:
            if roots_right_of(given, line) == kept:
                return found[:kept], line
        except Undecided:
            continue
    return found[:most], math.inf


# --- values ----------------------------------------------------------------------------------------


def on_axis(top: QuasiPolynomial, bottom: QuasiPolynomial, omega: Iterable[float]) -> list[complex]:
    """Return a quotient at s = jω to full double precision; inf at a pole."""
    from flint import acb, ctx

    found = []
    for at in omega:
        for precision in (PRECISION, 8 * PRECISION, 64 * PRECISION):
            with ctx.workprec(precision):
                s = acb(0, at)
                above, below = (
                    (part.balls if precision == PRECISION else Balls.of(part, precision=precision)).values(s)[
                        0
                    ]
                    for part in (top, bottom)
                )
                value = above / below
                if value.rel_accuracy_bits() > _DOUBLE or above.is_zero():
                    found.append(complex(float(value.real.mid()), float(value.imag.mid())))
                    break
        else:
            found.append(complex(0.0 if above.abs_upper() < below.abs_upper() else math.inf))
    return found
