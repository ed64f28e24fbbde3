"""Margins of a loop with delays: L = A/B, a quotient of quasi-polynomials.

Crossings and extremes are found between interval bounds on s = jω: none is missed, however many there are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from heapq import heappop, heappush
from itertools import count
from typing import Any

from dynid.errors import Undecided
from dynid.lti.margins import LIMIT, Margins, lag, largest_of
from dynid.lti.quasi_polynomials import PRECISION, QuasiPolynomial, divided, roots_right_of

#: Gains below this are not followed to higher frequencies.
_LEAST_GAIN = 1e-6
#: Relative width of intervals in which a function that touches zero is taken to be there.
_TOUCH = 2.0**-45
#: Halvings of an interval down to the rounding of doubles.
_BISECTIONS = 56
#: Frequencies below this part of the highest one count as 0.
_ORIGIN = 2.0**-60
#: Relative excess that ends the search for a maximum.
_EXCESS = 1e-10


def delay_margins(numerator: QuasiPolynomial, denominator: QuasiPolynomial) -> Margins:
    """Return the margins of a loop with delays.

    Parameters
    ----------
    numerator, denominator
        The open-loop transfer function L(s) of negative feedback, without common factors. In the
        denominator the term without delay has the largest degree.
    """
    from flint import ctx

    closed = numerator + denominator
    at_infinity = limit_gain(numerator, denominator)
    stable, verdict, right = stability(closed)
    if at_infinity >= 1:  # however small a further delay, it adds roots to the right of the axis
        none = math.inf
        small = 1 / at_infinity
        return Margins(stable, verdict, right, none, small, 0, 0, 0, none, none, none, none, none, none)
    loop = _Loop(numerator, denominator)
    with ctx.workprec(PRECISION):
        phases = [(lag(loop(omega)), omega) for omega in loop.gain_crossings()]
        (gain, above), (reduction, below) = loop.phase_crossings()
        bound = 1 / (1 - at_infinity)
        Ms, Ms_at = _Quotient(denominator, closed).largest(bound, loop.beyond, lambda size: 1 - 1 / size)
        Mt, Mt_at = _Quotient(numerator, closed).largest(
            bound * at_infinity, loop.beyond, lambda size: 1 / (1 + 1 / size)
        )
    phase, gain_crossover = min(phases, default=(math.inf, math.inf))
    return Margins(
        stable=stable,
        stability=verdict,
        unstable_poles=right,
        gain=gain,
        gain_reduction=reduction,
        phase=phase,
        delay=min((math.radians(angle) / omega for angle, omega in phases), default=math.inf),
        modulus=1 / Ms,
        gain_crossover=gain_crossover,
        phase_crossover=above if math.isfinite(gain) else below,
        modulus_at=Ms_at,
        Ms=Ms,
        Mt=Mt,
        Mt_at=Mt_at,
    )


def stability(closed: QuasiPolynomial) -> tuple[bool, str, float]:
    """Return whether all roots of a characteristic function lie left of the axis, why, and how many do not.

    Their number is inf where there are infinitely many, or where it is undecided.
    """
    if closed.at_origin() == 0:
        return False, "not stable: a root of the closed loop lies at the origin", math.inf
    try:
        right = roots_right_of(closed)
    except Undecided as error:
        neutral = neutral_verdict(closed)
        return False, neutral or f"not stable, or undecided: {error.problem}", math.inf
    if right:
        plural = "root lies" if right == 1 else "roots lie"
        return False, f"unstable: {right} {plural} in the right half-plane (Nyquist count with delays)", right
    return True, "stable: no root lies in the right half-plane (Nyquist count with delays)", 0


def neutral_verdict(closed: QuasiPolynomial) -> str:
    """Return the verdict where delayed terms do not vanish at high frequencies; else ''."""
    leading = closed.leading(closed.degree)
    own = abs(leading.get(Fraction(0), Fraction(0)))
    others = [abs(size) for delay, size in leading.items() if delay and size]
    if not others or sum(others) < own:
        return ""
    if 2 * max(others) > own + sum(others):
        where = "infinitely many roots lie in the right half-plane"
        return f"unstable: the loop has a gain above 1 at high frequencies and a delay; {where}"
    return (
        "not stable: the loops have a gain of 1 or more at high frequencies and delays; roots come as near "
        "to the imaginary axis as one likes, or cross it when a delay changes by however little"
    )


def limit_gain(numerator: QuasiPolynomial, denominator: QuasiPolynomial) -> float:
    """Return a bound on |L(jω)| for ω → ∞, exact where the numerator has one delay."""
    degree = denominator.degree
    if numerator.degree < degree:
        return 0.0
    if numerator.degree > degree:
        return math.inf
    top = sum(map(abs, numerator.leading(degree).values()))
    bottom = denominator.leading(degree)
    own = abs(bottom.pop(min(denominator.terms)))
    left = own - sum(map(abs, bottom.values()))
    return float(top / left) if left > 0 else math.inf


@dataclass(frozen=True)
class _Quotient:
    """A quotient of quasi-polynomials on s = jω."""

    top: QuasiPolynomial
    bottom: QuasiPolynomial

    def __call__(self, omega: float) -> complex:
        from flint import acb

        s = acb(0, omega)
        value = self.top.balls.values(s)[0] / self.bottom.balls.values(s)[0]
        return complex(float(value.real.mid()), float(value.imag.mid()))

    def sizes(self, low: Any, high: Any) -> tuple[float, float]:
        """Return bounds on the size over an interval of frequencies."""
        bounds = []
        for part in (self.top.balls, self.bottom.balls):
            value = part.on_axis(low, high)
            own, others = part.sizes(low, high)
            rest = float(sum(others)) if others else 0.0
            lower = max(float(value.abs_lower()), float(own.abs_lower()) - rest)
            bounds.append((lower, min(float(value.abs_upper()), float(own.abs_upper()) + rest)))
        (t_low, t_high), (b_low, b_high) = bounds
        return t_low / b_high if b_high else math.inf, t_high / b_low if b_low > 0 else math.inf

    def largest(
        self, at_infinity: float, beyond: Callable[[float], float], small_enough: Callable[[float], float]
    ) -> tuple[float, float]:
        """Return the supremum of the size over all frequencies, and where it is.

        Parameters
        ----------
        at_infinity
            Bound on the size at ω → ∞.
        beyond
            The frequency from which on the loop's gain is below a given one.
        small_enough
            The gain of the loop below which the size is below a given one.
        """
        from flint import arb

        if self.bottom.at_origin() == 0:
            return math.inf, 0.0
        scale = beyond(small_enough(math.inf) / 2)
        tried = [0.0, *(scale * 1.15**k for k in range(-150, 1))]
        best = largest_of([*((abs(self(omega)), omega) for omega in tried), (at_infinity, math.inf)])
        top = arb(beyond(small_enough(best[0])))
        number = count()  # intervals are not compared
        intervals = [(-math.inf, next(number), arb(0), top)]
        while intervals:
            upper, _, low, high = heappop(intervals)
            if -upper <= best[0] * (1 + _EXCESS):
                break
            slope, bend = self._slope(low, high)
            ends = [(abs(self(float(end))), float(end)) for end in (low, high)]
            if not slope.contains(0) or bend > 0:
                best = largest_of([best, *ends])
            elif bend < 0 or high - low <= _TOUCH * high:
                best = largest_of([best, *ends])
                if not bend < 0 or self._below_tangents(low, high, ends) > best[0] * (1 + _EXCESS):
                    omega = _zero(lambda at: self._slope(at, at)[0], low, high)
                    best = largest_of([best, (abs(self(omega)), omega)])
            else:
                for part in divided(low, high, top):
                    heappush(intervals, (-self.sizes(*part)[1], next(number), *part))
        return best

    def _below_tangents(self, low: Any, high: Any, ends: list[tuple[float, float]]) -> float:
        """Return a bound on the size over an interval where its logarithm is concave."""
        (at_low, _), (at_high, _) = ends
        rising, falling = (float(self._slope(end, end)[0].mid()) for end in (low, high))
        if not (rising > 0 > falling and min(at_low, at_high) > 0):
            return max(at_low, at_high)
        first, last = math.log(at_low), math.log(at_high)
        ahead = (last - first - falling * float((high - low).mid())) / (rising - falling)
        return math.exp(first + rising * ahead)

    def _slope(self, low: Any, high: Any) -> tuple[Any, Any]:
        """Return enclosures of the first two derivatives of log |quotient| by ω."""
        from flint import acb

        s = acb(0, low.union(high))
        slope, bend = acb(0), acb(0)
        for part, sign in ((self.top.balls, 1), (self.bottom.balls, -1)):
            value, first, second = part.values(s, 3)
            slope += sign * first / value
            bend += sign * (second / value - (first / value) ** 2)
        return -slope.imag, -bend.real


class _Loop(_Quotient):
    """The loop L = A/B."""

    @cached_property
    def at_infinity(self) -> float:
        """Bound on its gain at high frequencies."""
        return limit_gain(self.top, self.bottom)

    def beyond(self, gain: float) -> float:
        """Return a frequency from which on the loop's gain is below a given one, or near its limit."""
        from flint import arb

        gain = max(gain, self.at_infinity + _LEAST_GAIN * (1 + self.at_infinity))
        degree = self.bottom.degree
        lead = self.bottom.balls.terms[0].polynomials[0][degree]
        omega = arb(2) ** -200
        while True:
            sizes = [
                sum(
                    abs(term.polynomials[0][k] / lead) * omega ** (k - degree)
                    for term in part.balls.terms
                    for k in range(term.polynomials[0].degree() + 1)
                )
                for part in (self.top, self.bottom)
            ]
            if sizes[1] < 2 and sizes[0] < gain * (2 - sizes[1]):
                return float(omega.mid())
            omega = omega * 2

    def gain_crossings(self) -> Iterator[float]:
        """Yield the positive frequencies at which |L| = 1."""
        from flint import acb

        def difference(low: Any, high: Any) -> tuple[Any, Any]:
            s = acb(0, low.union(high))
            (a, da), (b, db) = (part.balls.values(s, 2) for part in (self.top, self.bottom))
            size = a.real**2 + a.imag**2 - b.real**2 - b.imag**2
            # d|A|^2/dω = 2 Re(conj(A) j A') = 2 (Im A Re A' - Re A Im A')
            slope = 2 * (a.imag * da.real - a.real * da.imag - b.imag * db.real + b.real * db.imag)
            return size, slope

        top = self.beyond((1 + self.at_infinity) / 2)
        yield from _zeros(difference, top, lambda low, high: False)  # noqa: ARG005

    def phase_crossings(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the factor above 1 nearest to it that makes L = -1, its frequency, and the same below 1."""
        from flint import acb

        def imaginary(low: Any, high: Any) -> tuple[Any, Any]:
            s = acb(0, low.union(high))
            (a, da), (b, db) = (part.balls.values(s, 2) for part in (self.top, self.bottom))
            # of A conj(B), whose derivative by ω is j A' conj(B) + A conj(j B')
            value = a.imag * b.real - a.real * b.imag
            slope = (da.real * b.real + da.imag * b.imag) - (a.real * db.real + a.imag * db.imag)
            return value, slope

        above, below = (math.inf, math.inf), (0.0, math.inf)

        def hopeless(low: Any, high: Any) -> bool:
            lower, upper = self.sizes(low, high)
            small = upper < max(1 / above[0], _LEAST_GAIN)
            return small or (lower > 1 and below[0] > 0 and lower > 1 / below[0])

        def note(omega: float) -> None:
            nonlocal above, below
            value = self(omega).real
            if value < 0:
                factor = -1 / value
                if factor >= 1 - LIMIT:
                    above = min(above, (factor, omega))
                else:
                    below = max(below, (factor, omega))

        if self.bottom.at_origin() != 0:
            note(0.0)
        if self.at_infinity:
            above = (1 / self.at_infinity, math.inf)
        reached, wanted = 0.0, (1 + self.at_infinity) / 2
        while wanted > max(_LEAST_GAIN, self.at_infinity):
            top = self.beyond(wanted)
            for omega in _zeros(imaginary, top, hopeless, reached):
                note(omega)
            if 1 / above[0] > wanted:
                break
            reached, wanted = top, wanted / 16
        return above, below


def _zeros(
    enclose: Callable[[Any, Any], tuple[Any, Any]],
    top: float,
    hopeless: Callable[[Any, Any], bool],
    start: float = 0.0,
) -> Iterator[float]:
    """Yield the zeros of a function of ω, start < ω <= top, from enclosures of its values and derivatives.

    Intervals that are `hopeless` are left out. Zeros in which it does not change its sign are found to
    about half the digits.
    """
    from flint import arb

    whole = arb(top)
    intervals = [(arb(start), whole)]
    while intervals:
        low, high = intervals.pop()
        value, slope = enclose(low, high)
        if not value.contains(0) or hopeless(low, high):
            continue
        middle = (low + high) / 2
        near = enclose(middle, middle)[0] + slope * (low.union(high) - middle)
        if not near.contains(0):
            continue
        if not slope.contains(0):
            ends = enclose(low, low)[0], enclose(high, high)[0]
            if not ends[0] * ends[1] > 0 and not (low == 0 and ends[0].contains(0)):
                yield _zero(lambda at: enclose(at, at)[0], low, high)
        elif high - low <= _TOUCH * high:
            yield float(middle.mid())
        elif high > whole * _ORIGIN:  # what is left at ω = 0 is no crossing
            intervals += divided(low, high, whole)[::-1]


def _zero(function: Callable[[Any], Any], low: Any, high: Any) -> float:
    """Return the zero in an interval at whose ends a function has different signs, by bisection."""
    rising = function(high) > 0
    for _ in range(_BISECTIONS):
        middle = ((low + high) / 2).mid()
        if (function(middle) > 0) == rising:
            high = middle
        else:
            low = middle
    return float(((low + high) / 2).mid())
