"""Margins of a loop with delays: L = A/B, a quotient of quasi-polynomials.

Crossings and extremes are searched in intervals of s = jω with bounds (`lti/axis_boxes.py`): none is missed,
however many there are, and the results are refined in ball arithmetic. The limit ω → ∞ follows from the
difference operators of A and B (`lti/difference_operator.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from flint import acb, arb, ctx
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import Undecided
from dynid.lti.axis_boxes import AxisFunctions, Expansion, Sum, Work, bisect, grid
from dynid.lti.delay_stability import COUNT, lower_powers_below, stability
from dynid.lti.difference_operator import critical_gains, gap, least_separation
from dynid.lti.margins import LIMIT, Margins, lag, largest_of
from dynid.lti.quasi_polynomials import PRECISION, Balls, QuasiPolynomial
from dynid.lti.stability import Verdict

#: Terms on intervals of frequencies that the margins of all loops of a system may cost, in half a second.
SEARCH = 400_000
#: Gains below this are not followed to higher frequencies, and extremes at infinity are this exact.
_LEAST_GAIN = 1e-6
#: Relative excess that ends the search for a maximum at a finite frequency.
_EXCESS = 1e-10
#: Relative width of intervals in which a function that touches zero is taken to be there.
_TOUCH = 2.0**-40
#: Frequencies below this part of the highest one count as 0.
_ORIGIN = 2.0**-60
#: Halvings of an interval down to the rounding of doubles.
_BISECTIONS = 52
#: Steps of Newton's method in ball arithmetic.
_NEWTON_STEPS = 6
#: Relative difference of phases and delays from the smallest up to which they are refined.
_REFINED_MARGIN_RTOL = 1e-6
#: Relative distance of a maximum from a frequency where the size is the same but for `_EXCESS`.
_NEAR_MAXIMUM = 1e-3


def delay_margins(
    numerator: QuasiPolynomial,
    denominator: QuasiPolynomial,
    verdict: Verdict | None = None,
    search: int = SEARCH,
) -> Margins:
    """Return the margins of a loop L(s), those that are undecided NaN.

    Numerator and denominator have no common factor; `verdict` on the closed loop, where it is known; `search`
    limits the cost, in terms on intervals of frequencies.
    """
    verdict = verdict or stability(numerator + denominator)
    margins = dict.fromkeys(_SEARCHED, math.nan)
    loop, reasons = LoopSearch(numerator, denominator, search // 4), dict[str, None]()
    with ctx.workprec(PRECISION):
        if loop.apart:
            for add in (loop.gain_crossings, loop.phase_crossings, loop.extremes):
                try:
                    add(margins)
                except Undecided as error:
                    reasons[error.problem] = None
        elif loop.critical is not None:  # a change of these gains removes the roots of high frequency
            below, above = loop.critical
            margins |= {"gain": above, "gain_reduction": below, "phase_crossover": math.inf, "delay": 0.0}
    unstable = verdict.unstable_poles
    return Margins(
        stable=verdict.stable,
        stability=verdict.text,
        unstable_poles=math.inf if math.isnan(unstable) else unstable,
        **margins,
        undecided="; ".join(reasons) if verdict.stable else "",
    )


_SEARCHED = (
    *("gain", "gain_reduction", "phase", "delay", "modulus", "gain_crossover", "phase_crossover"),
    *("modulus_at", "Ms", "Mt", "Mt_at"),
)


class _Measure(NamedTuple):
    """A real function on intervals: value and slope (by ρ) in the middle, bounds on bend and round-off."""

    value: Array
    slope: Array
    bend: Array
    error: Array


@dataclass(frozen=True)
class LoopSearch:
    """Crossings and extremes of a loop L = A/B; `search`: the terms that each may examine."""

    top: QuasiPolynomial
    bottom: QuasiPolynomial
    search: int

    @cached_property
    def closed(self) -> QuasiPolynomial:
        """A + B."""
        return self.top + self.bottom

    @cached_property
    def functions(self) -> AxisFunctions:
        """A, B and A + B."""
        return AxisFunctions([self.top.balls, self.bottom.balls, self.closed.balls])

    @cached_property
    def degree(self) -> int:
        """The largest degree of A and B."""
        return max(self.top.degree, self.bottom.degree)

    @cached_property
    def operators(self) -> tuple[dict[Any, Fraction], dict[Any, Fraction]]:
        """The coefficients of the largest power of A and of B."""
        return self.top.leading(self.degree), self.bottom.leading(self.degree)

    @cached_property
    def apart(self) -> Fraction | None:
        """Lower bound on the difference operator of 1 + L; 0 or None where roots come near the axis."""
        return least_separation(*self.operators, 1, 1)

    @cached_property
    def critical(self) -> tuple[float, float] | None:
        """The gains nearest to 1 at which roots of high frequency pass the axis."""
        return critical_gains(*self.operators)

    def __call__(self, omega: float) -> complex:
        """Return L at a frequency."""
        s = acb(0, omega)
        value = self.top.balls.values(s)[0] / self.bottom.balls.values(s)[0]
        return complex(float(value.real.mid()), float(value.imag.mid()))

    def beyond(self, apart: Fraction, factor: float = 1.0) -> float:
        """Return a frequency from which on lower powers of B and of `factor` times A are below a bound."""
        parts = ((self.top.balls, factor), (self.bottom.balls, 1.0))
        return lower_powers_below(parts, self.degree, apart)

    # --- |L| = 1 ------------------------------------------------------------------------------------

    def gain_crossings(self, margins: dict[str, float]) -> None:
        """Add the phase and the delay margin, from the positive frequencies at which |L| = 1."""
        a, b = self.operators
        below = gap(b, a)
        if below == 0:  # |L| does not stay below 1: a delay however small adds roots of high frequency
            margins["delay"] = 0.0
        crossings = self._unit_gains(below or gap(a, b))
        lags = []
        for omega in crossings:
            (value,) = self._rounded([omega])
            angle = lag(value)
            lags.append((angle, math.radians(angle) / omega, omega))
        limits = [min((entry[k] for entry in lags), default=math.inf) for k in (0, 1)]
        refined = []
        for rough, delay, omega in lags:
            if rough <= limits[0] + 360 * _REFINED_MARGIN_RTOL or delay <= limits[1] * (
                1 + _REFINED_MARGIN_RTOL
            ):
                exact = self._refined(omega, self._difference_at)
                angle = lag(self(exact))
                refined.append((angle, exact, math.radians(angle) / exact))
        phase, crossover, _ = min(refined, default=(math.inf, math.inf, math.inf))
        delay = 0.0 if below == 0 else min((entry[2] for entry in refined), default=math.inf)
        margins |= {"phase": phase, "gain_crossover": crossover, "delay": delay}

    def unit_gains(self) -> list[float]:
        """Return the positive frequencies at which |L| = 1."""
        with ctx.workprec(PRECISION):
            a, b = self.operators
            crossings = self._unit_gains(gap(b, a) or gap(a, b))
            return [self._refined(omega, self._difference_at) for omega in crossings]

    def _unit_gains(self, apart: Fraction | None) -> list[float]:
        if not apart:
            raise Undecided("the gain crosses 1 at frequencies as high as one likes, or that is undecided")
        return _zeros(self.functions, _difference, self.beyond(apart / 2), Work(self.search))

    def _rounded(self, omega: list[float]) -> list[complex]:
        """Return L to single frequencies in doubles."""
        at = np.array(omega)
        top, bottom, _ = self.functions.expand(at, at, Work(COUNT))
        with np.errstate(all="ignore"):
            return list((top.total.value / bottom.total.value).tolist())

    def _difference_at(self, omega: Any) -> tuple[Any, Any]:
        (a, da), (b, db) = (function.balls.values(acb(0, omega), 2) for function in (self.top, self.bottom))
        size = a.real**2 + a.imag**2 - b.real**2 - b.imag**2
        # d|A|²/dω = 2 Re(conj(A) j A') = 2 (Im A Re A' - Re A Im A')
        slope = 2 * (a.imag * da.real - a.real * da.imag - b.imag * db.real + b.real * db.imag)
        return size, slope

    @staticmethod
    def _refined(
        omega: float, function: Callable[[Any], tuple[Any, Any]], near: float = _REFINED_MARGIN_RTOL
    ) -> float:
        """Return a zero to all digits by Newton's method; the first value where it does not stay near."""
        at = arb(omega)
        for _ in range(_NEWTON_STEPS):
            value, slope = function(at)
            if slope.contains(0):
                return omega
            at = (at - value / slope).mid()
            if not abs(at - omega) < near * omega:
                return omega
        return float(at)

    # --- L real and negative ------------------------------------------------------------------------

    def phase_crossings(self, margins: dict[str, float]) -> None:
        """Add the gain margins: the factors nearest to 1 that make L = -1, and their frequencies."""
        if self.critical is None:
            raise Undecided("roots of high frequency pass the axis at gains that are undecided")
        low, high = self.critical
        below, above = (low, math.inf), (high, math.inf)
        if self.bottom.at_origin() != 0:
            value = Fraction(self.top.at_origin(), self.bottom.at_origin())
            if value < 0:
                factor = float(-1 / value)
                above = min(above, (factor, 0.0)) if factor >= 1 - LIMIT else above
                below = (
                    max(below, (factor, 0.0), key=lambda crossing: crossing[0])
                    if factor < 1 - LIMIT
                    else below
                )
        above = self._nearest(above, high, up=True)
        below = self._nearest(below, low, up=False)
        margins |= {
            "gain": above[0],
            "gain_reduction": below[0],
            "phase_crossover": above[1] if math.isfinite(above[0]) else below[1],
        }

    def _nearest(self, best: tuple[float, float], limit: float, *, up: bool) -> tuple[float, float]:
        """Return the factor nearest to 1 on one side, over growing ranges of factors and frequencies."""
        work, reached = Work(self.search), 0.0
        for share in (0.5, 0.9, 0.99, 1 - 1e-3, 1 - 1e-4, 1 - 1e-5, 1 - _LEAST_GAIN):
            # factors from 1 to this one
            if up:
                end = 1 + share * (limit - 1) if math.isfinite(limit) else 1 / (1 - share)
            else:
                end = 1 - share * (1 - limit)
            apart = least_separation(*self.operators, min(1.0, end), max(1.0, end))
            if not apart:
                raise Undecided("it is undecided from which frequency on no root passes the axis")
            top = self.beyond(apart / 2, max(1.0, end))
            if top > reached:
                best = self._nearest_between(best, reached, top, work, up=up)
                reached = top
            if best[0] <= end if up else best[0] >= end:
                break
        return best

    def _nearest_between(
        self, best: tuple[float, float], start: float, top: float, work: Work, *, up: bool
    ) -> tuple[float, float]:
        factor = min(best[0], 1 / _LEAST_GAIN) if up else max(best[0], _LEAST_GAIN)
        spare = 0.0 if math.isfinite(best[1]) else _LEAST_GAIN

        def hopeless(a: Sum, b: Sum, measure: _Measure, width: Array) -> Any:
            negative = (a.total.value * b.total.value.conj()).real - measure.error
            slope = a.total.slope * b.total.value.conj() + a.total.value * b.total.slope.conj()
            negative -= np.abs(slope.real) * width + measure.bend * width**2 / 2
            smallest, largest = _gains(a, b)
            if up:
                return (negative > 0) | (largest < (1 + spare) / factor) | (smallest > 1)
            return (negative > 0) | (largest < 1) | (smallest > (1 - spare) / factor)

        for omega in _zeros(self.functions, _imaginary, top, work, start, hopeless):
            (value,) = self._rounded([omega])
            if value.real < 0:
                rough = -1 / value.real
                if (
                    (rough < factor * (1 + _REFINED_MARGIN_RTOL))
                    if up
                    else (rough > factor * (1 - _REFINED_MARGIN_RTOL))
                ):
                    exact = self._refined(omega, self._imaginary_at)
                    real = self(exact).real
                    refined = -1 / real if real else math.inf
                    if up and refined >= 1 - LIMIT:
                        best = min(best, (refined, exact))
                    elif not up and refined < 1 - LIMIT:
                        best = max(best, (refined, exact), key=lambda maximum: maximum[0])
        return best

    def _imaginary_at(self, omega: Any) -> tuple[Any, Any]:
        (a, da), (b, db) = (function.balls.values(acb(0, omega), 2) for function in (self.top, self.bottom))
        # of A conj(B), whose derivative by ω is j A' conj(B) + A conj(j B')
        value = a.imag * b.real - a.real * b.imag
        slope = (da.real * b.real + da.imag * b.imag) - (a.real * db.real + a.imag * db.imag)
        return value, slope

    # --- extremes of |S| and |T| --------------------------------------------------------------------

    def extremes(self, margins: dict[str, float]) -> None:
        """Add the largest |S| = |B/(A + B)| and |T| = |A/(A + B)|, and their frequencies."""
        Ms, Ms_at = self._largest(self.bottom, 1)
        Mt, Mt_at = self._largest(self.top, 0)
        modulus = 1 / Ms if Ms else math.inf
        margins |= {"Ms": Ms, "modulus": modulus, "modulus_at": Ms_at, "Mt": Mt, "Mt_at": Mt_at}

    def _largest(self, function: QuasiPolynomial, number: int) -> tuple[float, float]:
        if self.closed.at_origin() == 0:
            return math.inf, 0.0
        if not self.apart:
            raise Undecided("poles of high frequency come near to the axis")
        work = Work(self.search)
        limit = self._limit(number, work)
        top = self.beyond(self.apart * Fraction(_LEAST_GAIN) / Fraction(2 + 2 * limit))
        at_rest = float(abs(Fraction(function.at_origin(), self.closed.at_origin())))
        best = largest_of([(limit, math.inf), (at_rest, 0.0)])
        best = _search_largest(self.functions, number, best, top, work)
        if not 0 < best[1] < math.inf:
            return best
        exact = self._refined(best[1], lambda at: self._slope(function, at), _NEAR_MAXIMUM)
        size = abs(complex(function(1j * exact)) / complex(self.closed(1j * exact)))
        return largest_of([(size, exact), best]) if size >= best[0] * (1 - _EXCESS) else best

    def _limit(self, number: int, work: Work) -> float:
        """Return the supremum of |S| or |T| at ω → ∞, where s^n D prevails with the delays as they are."""
        parts = (self.top, self.bottom, self.closed)
        a, b, _ = (Balls.constant(function.balls, self.degree) for function in parts)
        if not a.terms or not b.terms:
            return float(bool(b.terms)) if number else float(bool(a.terms))
        closed = Balls.constant(self.closed.balls, self.degree)
        delays = {delay for function in parts for delay in function.terms if delay}
        functions = AxisFunctions([a, b, closed])
        if not delays:
            top = 1.0
        else:
            step = Fraction(
                math.gcd(*(d.numerator for d in delays)), math.lcm(*(d.denominator for d in delays))
            )
            top = math.pi / float(step)
        ends = np.array([0.0, top])
        sums = functions.expand(ends, ends, work)
        sizes = np.abs(sums[number].total.value / sums[2].total.value)
        best = largest_of([(float(size), float(at)) for size, at in zip(sizes, ends, strict=True)])
        return _search_largest(functions, number, best, top, work)[0]

    def _slope(self, function: QuasiPolynomial, at: Any) -> tuple[Any, Any]:
        """Return the first two derivatives of log |part/(A + B)| by ω."""
        slope, bend = acb(0), acb(0)
        for balls, sign in ((function.balls, 1), (self.closed.balls, -1)):
            value, first, second = balls.values(acb(0, at), 3)
            slope += sign * first / value
            bend += sign * (second / value - (first / value) ** 2)
        return -slope.imag, -bend.real


def _gains(a: Sum, b: Sum) -> tuple[Array, Array]:
    """Return bounds on |A/B| over intervals."""
    with np.errstate(all="ignore"):
        quotient = a.total.over(b.total)
        shares, left = _shares(a, b)
        largest = np.fmin(_finite(_ends(quotient)), _finite(shares / left))
        smallest = np.fmax(0.0, np.where(np.isfinite(quotient.rest), quotient.smallest, 0.0))
        if len(a.terms) == 1:
            single = a.terms[0].over(b.terms[0]).smallest / (2 - left)
            smallest = np.fmax(smallest, np.where(left > 0, single, 0.0))
    return smallest, largest


def _shares(function: Sum, closed: Sum) -> tuple[Array, Array]:
    """Return bounds with any delays, over the prompt term: on a part, and what the whole has at least."""
    prompt, nothing = closed.terms[0], np.zeros(len(closed.total.width))
    left = 1 - sum((_ends(term.over(prompt)) for term in closed.terms[1:]), nothing)
    shares = sum((_ends(term.over(prompt)) for term in function.terms), nothing)
    return np.asarray(shares), np.where(left > 0, left, np.nan)


def _finite(bound: Array) -> Array:
    return np.where(np.isfinite(bound), bound, np.inf)


def _difference(a: Sum, b: Sum) -> _Measure:
    """Return |A|² - |B|²."""
    value, slope, bend, error = (np.zeros(len(a.total.width)) for _ in range(4))
    for expansion, sign in ((a.total, 1), (b.total, -1)):
        size = np.abs(expansion.value)
        value = value + sign * size**2
        slope = slope + sign * 2 * (expansion.value.conj() * expansion.slope).real
        bend = bend + 2 * (expansion.largest_slope**2 + expansion.largest * expansion.bend)
        error = error + 2 * (size + expansion.error) * expansion.error + 4 * 2.0**-52 * size**2
    return _Measure(value, slope, bend, error)


def _imaginary(a: Sum, b: Sum) -> _Measure:
    """Return Im(A conj B)."""
    p, q = a.total, b.total
    slope = (p.slope * q.value.conj() + p.value * q.slope.conj()).imag
    bend = p.bend * q.largest + 2 * p.largest_slope * q.largest_slope + p.largest * q.bend
    sizes = np.abs(p.value), np.abs(q.value)
    error = p.error * sizes[1] + q.error * sizes[0] + p.error * q.error + 4 * 2.0**-52 * sizes[0] * sizes[1]
    return _Measure((p.value * q.value.conj()).imag, slope, bend, error)


def _zeros(
    functions: AxisFunctions,
    measure: Callable[[Sum, Sum], _Measure],
    top: float,
    work: Work,
    start: float = 0.0,
    hopeless: Callable[[Sum, Sum, _Measure, Array], Any] | None = None,
) -> list[float]:
    """Return the zeros of a function of A and B, start < ω <= top, those in `hopeless` intervals left out."""
    zeros: list[float] = []
    brackets: list[tuple[Array, Array]] = []

    def signs(at: Array) -> Array:
        a, b, *_ = functions.expand(at, at, work)
        with np.errstate(all="ignore"):
            values = measure(a, b)
        return np.asarray(np.where(np.abs(values.value) <= values.error, 0.0, np.sign(values.value)))

    def examine(low: Array, high: Array) -> NDArray[np.bool_]:
        nonlocal zeros
        a, b, *_ = functions.expand(low, high, work)
        with np.errstate(all="ignore"):
            values, width = measure(a, b), a.total.width
        if not np.isfinite(values.error).all():
            raise Undecided(f"the loop has values beyond the range of doubles below {top:.3g} rad/s")
        bound = np.abs(values.slope) * width + values.bend * width**2 / 2 + values.error
        undecided = ~(np.abs(values.value) > bound)
        if hopeless is not None:
            undecided &= ~hopeless(a, b, values, width)
        single = undecided & (np.abs(values.slope) > values.bend * width)
        if single.any():
            before, after = signs(low[single]), signs(high[single])
            crossing = (before * after <= 0) & ~((low[single] == 0) & (before == 0))
            brackets.append((low[single][crossing], high[single][crossing]))
        undecided &= ~single & (high > top * _ORIGIN)
        touching = undecided & (high - low <= _TOUCH * high)
        zeros += ((low + high) / 2)[touching].tolist()
        return undecided & ~touching

    bisect(*grid(start, top), examine)
    if not any(len(lows) for lows, _ in brackets):
        return zeros
    low, high = (np.concatenate(ends) for ends in zip(*brackets, strict=True))
    rising = signs(high)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        left = signs(middle) == rising
        low, high = np.where(left, low, middle), np.where(left, middle, high)
    return [*zeros, *((low + high) / 2).tolist()]


def _search_largest(
    functions: AxisFunctions, number: int, best: tuple[float, float], top: float, work: Work
) -> tuple[float, float]:
    """Return the largest |A/Q| (number 0) or |B/Q| (1) up to a frequency, from a first value."""

    def examine(low: Array, high: Array) -> NDArray[np.bool_]:
        nonlocal best
        sums = functions.expand(low, high, work)
        numerator, closed = sums[number], sums[2]
        with np.errstate(all="ignore"):
            sizes = np.abs(numerator.total.value / closed.total.value)
        sizes = np.where(closed.total.error < np.abs(closed.total.value), sizes, 0.0)
        at = int(sizes.argmax())
        if sizes[at] > best[0] * (1 + 1e-13):
            best = (float(sizes[at]), float((low[at] + high[at]) / 2))
        excess = _EXCESS if math.isfinite(best[1]) else _LEAST_GAIN
        above = ~(_upper(numerator, sums[1 - number], closed) <= best[0] * (1 + excess))
        return above & (high - low > _TOUCH * high) & (high > top * _ORIGIN)

    bisect(*grid(0.0, top), examine)
    return best


def _upper(function: Sum, complement_function: Sum, closed: Sum) -> Array:
    """Return an upper bound on |part/whole| over intervals, where part + other = whole."""
    with np.errstate(all="ignore"):
        quotient, rest = function.total.over(closed.total), complement_function.total.over(closed.total)
        turned = rest.slope * rest.width
        complement = np.maximum(np.abs(1 - rest.value - turned), np.abs(1 - rest.value + turned)) + rest.rest
        direct, left = _shares(function, closed)
        bounds = [
            _ends(quotient),
            complement,
            direct / left,
            1 + _shares(complement_function, closed)[0] / left,
        ]
    return np.asarray(np.minimum.reduce([_finite(bound) for bound in bounds]))


def _ends(quotient: Expansion) -> Array:
    """Return a bound on a size: a linear function of ρ is largest at an end."""
    turned = quotient.slope * quotient.width
    size = np.maximum(np.abs(quotient.value + turned), np.abs(quotient.value - turned))
    return np.asarray(size + quotient.rest)
