"""Stability of loops with delays: the roots of a quasi-polynomial Q right of a line, counted.

Roots of high frequency are those of the difference operator D (`lti/difference_operator.py`). Where it has
none to the right, the argument of Q/(s^n D) along the line counts the others (the Nyquist criterion). It is
followed over intervals on which it provably turns by less than half a turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from fractions import Fraction

import numpy as np
from flint import acb, arb, ctx, fmpq, fmpz_poly
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import Undecided
from dynid.lti.axis_boxes import AxisFunctions, Work, bisect, float_log, grid
from dynid.lti.difference_operator import TORUS, separation
from dynid.lti.quasi_polynomials import PRECISION, Balls, QuasiPolynomial, RefinedRoot, refined_root
from dynid.lti.stability import Verdict

#: Terms on intervals of frequencies that the counts of a system may examine, in half a second.
COUNT = 300_000
#: Terms that one enclosure in ball arithmetic costs as much as.
_BALL = 100
#: Relative width below which doubles no longer divide an interval, and ball arithmetic takes over.
_NARROW_DOUBLE = 2.0**-30
#: Relative width below which an interval of frequencies is not divided further.
_NARROW = 2.0**-60
#: Binary digits to which a root is on the axis that is at the limit: half of those of doubles.
_LIMIT_BITS = 26
#: Size below which a root beside one at the origin is that root.
_ORIGIN_ROOT_SIZE = 1e-30
#: Halvings of a frequency down to where the lowest power prevails.
_HALVINGS = 2000
#: Rate of growth, by the largest delay, of roots of high frequency that are told from those on the axis.
_SLOW = 1e-3
_INFINITELY_MANY = "infinitely many roots lie in the right half-plane"
_NEAR = (
    "roots come as near to the imaginary axis as one likes, or cross it when a delay changes by however "
    "little"
)
#: Binary logarithm of the largest frequency.
_FREQUENCY_RANGE_BITS = 900
#: Exponent of the largest factor exp(-s τ) that doubles hold with its inverse.
_MAX_EXPONENT = 700.0
#: Relative separation that rounding errors of shifted coefficients do not reach.
_ROUNDING = Fraction(1, 10**12)


def stability(closed: QuasiPolynomial, work: Work | None = None) -> Verdict:
    """Return the verdict on the roots of a characteristic function."""
    work = work or Work(COUNT)
    try:
        right = _roots_right(closed, work)
    except _OnAxis as error:
        return _at_limit(closed, error) or Verdict("undecided", error.problem, math.nan)
    except Undecided as error:
        return _at_infinity(closed, work) or Verdict("undecided", error.problem, math.nan)
    if right:
        return Verdict("unstable", _counted(right), right)
    at_origin = next(order for order in range(closed.degree + 2) if closed.taylor(order))
    if at_origin:
        several = f"a root of multiplicity {at_origin}" if at_origin > 1 else "a root of the closed loop"
        return Verdict("marginal", f"{several} lies at the origin", 0)
    return Verdict("stable", "no root lies in the right half-plane (Nyquist count with delays)", 0)


class _OnAxis(Undecided):
    """A root that the working precision does not tell from one on the imaginary axis."""

    def __init__(self, frequency: float) -> None:
        super().__init__(
            f"a root lies on the imaginary axis near {frequency:.6g} rad/s, or within round-off of it"
        )
        self.frequency = frequency


def _at_limit(closed: QuasiPolynomial, near: _OnAxis) -> Verdict | None:
    """Return the verdict on a root that is proved to lie next to the axis, and how near; else None."""
    root = refined_root(closed, complex(0, near.frequency))
    if root is None or not abs(root.value):
        return None
    distance = abs(root.value.real) + root.radius
    bits = math.floor(-math.log2(distance / abs(root.value)))
    if bits < _LIMIT_BITS:
        return None
    where = f"a root at ±{abs(root.value.imag):.6g}j rad/s lies on the imaginary axis"
    return Verdict("at the limit", f"{where} within 2^-{bits} of its size", math.nan)


def _counted(right: int) -> str:
    plural = "root lies" if right == 1 else "roots lie"
    return f"{right} {plural} in the right half-plane (Nyquist count with delays)"


def _at_infinity(closed: QuasiPolynomial, work: Work) -> Verdict | None:
    """Return the verdict where roots of high frequency decide it; else None."""
    if not closed.terms:
        return Verdict("undecided", "the characteristic function is zero", math.nan)
    degrees = {delay: int(polynomial.degree()) for delay, polynomial in closed.terms.items()}
    if degrees.get(Fraction(0), -1) < max(degrees.values()):
        reason = f"a delayed term differentiates more often than any prompt one: {_INFINITELY_MANY}"
        return Verdict("unstable", reason + _chain(closed, degrees), math.inf)
    leading = {loops: value for loops, value in closed.leading(closed.degree).items() if value}
    apart = separation(leading)
    if apart is None:
        count = len(set().union(*leading))
        reason = f"{count} delays have gains at high frequencies that add up to 1 or more"
        limit = f"whether they cancel takes more than {TORUS} cosines of their phases"
        return Verdict("undecided", f"{reason}; {limit}", math.nan)
    if apart:
        return None
    try:
        inside, lag = _operator_zeros(closed, work)
    except Undecided:
        inside, lag = 0, Fraction(0)
        with suppress(Undecided):  # zeros of the operator that grow faster than a slow rate
            inside, _ = _operator_zeros(closed, work, _SLOW / float(max(closed.terms)))
    if inside:
        reason = f"the loop has a gain above 1 at high frequencies and a delay; {_INFINITELY_MANY}"
        return Verdict("unstable", reason, math.inf)
    if not lag:
        return Verdict(
            "at the limit", f"the loops have a gain of 1 or more at high frequencies; {_NEAR}", math.nan
        )
    try:
        right = _count(closed.balls, closed, lag / 2, work)
    except Undecided:
        return Verdict("at the limit", f"the gain at high frequencies is too large; {_NEAR}", math.nan)
    if right:
        return Verdict("unstable", _counted(right), right)
    reason = "stable at these delays, not at delays however near: the gain at high frequencies is too large"
    return Verdict("at the limit", reason, 0)


def _chain(closed: QuasiPolynomial, degrees: Mapping[Fraction, int]) -> str:
    """Return where the rightmost chain of roots of an advanced equation lies; '' without a prompt term.

    At high frequencies c_0 s^n + c_k s^(n + d) exp(-s τ) = 0, with the delay of the largest d/τ.
    """
    prompt = degrees.get(Fraction(0))
    if prompt is None:
        return ""
    late = [delay for delay in degrees if delay]
    delay = max(late, key=lambda delay: (degrees[delay] - prompt) / delay)
    order = degrees[delay] - prompt  # at least 1
    ratio = abs(int(closed.terms[delay][degrees[delay]]) / int(closed.terms[Fraction(0)][prompt]))
    size = f"{ratio:.4g} ω^{order}" if order > 1 else f"{ratio:.4g} ω"
    return f", with real parts near ln({size})/({float(delay):.4g} s)"


def _operator_zeros(closed: QuasiPolynomial, work: Work, line: float = 0.0) -> tuple[int, Fraction]:
    """Return the zeros exp(-s h) of the difference operator, Re s > `line`, and its least size there."""
    degree = max(int(polynomial.degree()) for polynomial in closed.terms.values())
    operator = QuasiPolynomial(
        {
            delay: fmpz_poly([int(polynomial[degree])])
            for delay, polynomial in closed.terms.items()
            if polynomial[degree]
        }
    )
    delays = [delay for delay in operator.terms if delay]
    step = Fraction(math.gcd(*(d.numerator for d in delays)), math.lcm(*(d.denominator for d in delays)))
    if max(delays) / step > work.left / 100:
        raise Undecided("the delays have no common divisor that is not small")
    balls = Balls.of(operator, line)
    turned, lag = _turns(AxisFunctions([balls]), balls, 0.0, math.pi / float(step), work)
    if abs(math.remainder(turned, math.pi)) > 1e-6:
        raise Undecided("a zero lies on the line")
    sizes = sum(abs(int(polynomial[0])) for polynomial in operator.terms.values())
    return round(-turned / math.pi), Fraction(lag) * sizes


# --- number of roots right of a line ----------------------------------------------------------------


def roots_right_of(function: QuasiPolynomial, line: float = 0.0, work: Work | None = None) -> int:
    """Return the number of roots with real part above `line`, multiple ones counted so.

    A root at the origin is not counted where the line is the axis. `Undecided` where a root lies on the line
    or too near it, where infinitely many may lie right of it, or where the count costs too much.
    """
    return _roots_right(function, work or Work(COUNT), line)


def _roots_right(function: QuasiPolynomial, work: Work, line: float = 0.0) -> int:
    leading = function.leading(function.degree)
    if line:
        growth = {loops: -line * float(sum(loop.seconds for loop in loops)) for loops in leading}
        if max(map(abs, growth.values())) > _MAX_EXPONENT:
            raise Undecided("the delayed terms are out of range on this line")
        leading = {loops: value * Fraction(math.exp(growth[loops])) for loops, value in leading.items()}
    apart = separation(leading)
    if apart is None or apart <= _ROUNDING * sum(map(abs, leading.values())):
        raise Undecided(
            "the delayed terms do not vanish at high frequencies: the equation is of neutral type"
        )
    return _count(function.balls if not line else Balls.of(function, line), function, apart, work, line)


def _count(balls: Balls, function: QuasiPolynomial, apart: Fraction, work: Work, line: float = 0.0) -> int:
    """Return the number of roots right of the line on which the balls are; D is at least `apart` there."""
    degree = max(int(polynomial.degree()) for polynomial in function.terms.values())
    with ctx.workprec(PRECISION):
        top = lower_powers_below([(balls, 1.0)], degree, apart / 2)
        at_origin = 0 if line else next(order for order in range(degree + 2) if function.taylor(order))
        start = _lowest(function, at_origin, top) if at_origin else 0.0
        operator = Balls.constant(balls, degree)
        s = acb(0, top)
        ratio = balls.values(s)[0] / (s**degree * operator.values(s)[0])
        turned = float(ratio.arg().mid()) + (degree - at_origin) * math.pi / 2
        if at_origin:  # around the origin on its right
            s = acb(0, start)
            rest = balls.values(s)[0] / (
                s**at_origin * acb(arb(fmpq(*function.taylor(at_origin).as_integer_ratio())))
            )
            turned -= float(rest.arg().mid())
    if len(operator.terms) > 1:
        turned += _turns(AxisFunctions([operator]), operator, 0.0, top, work)[0]
    turned -= _turns(AxisFunctions([balls]), balls, start, top, work)[0]
    count = turned / math.pi
    nearest = round(count)
    if abs(count - nearest) > 1e-6:
        raise Undecided(f"the argument of the characteristic function sums up to {count:.3f} roots")
    return nearest


def lower_powers_below(parts: Iterable[tuple[Balls, float]], degree: int, limit: Fraction) -> float:
    """Return a frequency from which on the lower powers of functions, over s^degree, are below a limit.

    `parts` are the functions with factors on them; the limit is on the sum of the sizes.
    """
    lower = [
        (float_log(abs(term.polynomials[0][k])) + math.log2(factor), degree - k)
        for balls, factor in parts
        for term in balls.terms
        for k in range(min(degree, term.polynomials[0].degree() + 1))
        if term.polynomials[0][k] != 0
    ]
    allowed = math.log2(limit.numerator) - math.log2(limit.denominator)
    radius = max(((size - allowed) / gap for size, gap in lower), default=0.0)
    while sum(2.0 ** (size - allowed - gap * radius) for size, gap in lower) > 1:
        radius += 0.25
    if not abs(radius) < _FREQUENCY_RANGE_BITS:
        raise Undecided("the coefficients of the characteristic function are out of range")
    return float(2.0**radius)


def _lowest(function: QuasiPolynomial, order: int, top: float) -> float:
    """Return a frequency below which the first power of Q at the origin prevails."""
    first, frequency = abs(function.taylor(order)), Fraction(top)
    for _ in range(_HALVINGS):
        rest = Fraction(0)  # bounds |Q^(order + 1)| on the axis, over (order + 1)!
        for delay, polynomial in function.terms.items():
            for k in range(order + 2):
                derivative = sum(
                    abs(int(polynomial[j])) * math.comb(j, k) * frequency ** (j - k)
                    for j in range(k, polynomial.degree() + 1)
                )
                rest += derivative * delay ** (order + 1 - k) / math.factorial(order + 1 - k)
        if 2 * rest * frequency < first:
            return float(frequency)
        frequency /= 16
    raise Undecided("the coefficients of the characteristic function are out of range")


def _turns(
    functions: AxisFunctions, balls: Balls, start: float, top: float, work: Work
) -> tuple[float, float]:
    """Return the change of the argument of Q(jω) from start to top, and its least relative size."""
    total, smallest = 0.0, math.inf
    narrow: list[tuple[float, float]] = []

    def examine(low: Array, high: Array) -> NDArray[np.bool_]:
        nonlocal total, smallest, narrow
        (expanded,) = functions.expand(low, high, work)
        first, whole = expanded.terms[0], expanded.total
        clear = whole.smallest > 0
        others = sum((term.largest for term in expanded.terms[1:]), np.zeros(len(low)))
        prevails = ~clear & (first.smallest > others)
        if clear.any():
            smallest = min(smallest, float(whole.smallest[clear].min()))
            total += _change(functions, low[clear], high[clear], work)
        if prevails.any():
            total += _change(functions, low[prevails], high[prevails], work, prompt=True)
        left = ~(clear | prevails)
        fine = high - low <= _NARROW_DOUBLE * high
        rounding = np.abs(whole.value) + np.abs(whole.slope) * whole.width <= 4 * whole.error
        stuck = left & (fine | rounding | ~np.isfinite(whole.error))
        narrow += zip(low[stuck].tolist(), high[stuck].tolist(), strict=True)
        return left & ~stuck

    bisect(*grid(start, top), examine)
    for interval in narrow:
        total += sum(_ball_turns(balls, *interval, work))
        smallest = 0.0
    return total, smallest


def _change(functions: AxisFunctions, low: Array, high: Array, work: Work, *, prompt: bool = False) -> float:
    """Return the sum of the changes of the argument over intervals, where Q or its prompt term prevails."""
    (before,), (after,) = (functions.expand(end, end, work) for end in (low, high))
    if not prompt:
        return float(np.angle(after.total.value / before.total.value).sum())
    total_angle = np.angle(after.total.value / after.terms[0].value) - np.angle(
        before.total.value / before.terms[0].value
    )
    return float((np.angle(after.terms[0].value / before.terms[0].value) + total_angle).sum())


def _ball_turns(balls: Balls, start: float, top: float, work: Work) -> Iterator[float]:
    """Yield the changes of the argument of Q(jω) over parts of an interval, in ball arithmetic."""
    with ctx.workprec(PRECISION):
        intervals = [(arb(start), arb(top))]
        while intervals:
            work.spend(_BALL)
            low, high = intervals.pop()
            middle, interval = (low + high) / 2, low.union(high)
            slope = balls.values(acb(0, interval), 2)[1]
            value = balls.values(acb(0, middle))[0] + slope * acb(0, interval - middle)
            if value.abs_lower() > 0:
                start_value, end_value = (balls.values(acb(0, end))[0] for end in (low, high))
                yield float((end_value / start_value).arg().mid())
            elif high - low <= _NARROW * high or high <= arb(top) * _NARROW**2:
                where = float(high.mid())
                raise _OnAxis(where)
            else:
                middle = middle.mid()
                intervals += [(middle, high), (low, middle)]


# --- rightmost roots --------------------------------------------------------------------------------


def rightmost_roots(
    function: QuasiPolynomial, starts: Iterable[complex], max_roots: int, work: Work | None = None
) -> tuple[list[RefinedRoot], float]:
    """Return the rightmost roots, and a line right of which none is missing (inf where that is not proved).

    Many `starts` may lead to one root. `work` limits the cost of the proof.
    """
    work = work or Work(COUNT)
    roots = [RefinedRoot(0j, 0.0)] if function.at_origin() == 0 else []
    for start in sorted(starts, key=lambda s: -s.real):
        if start.imag < 0:
            continue
        root = refined_root(function, start)
        if (
            root is None
            or (roots and abs(root.value) < _ORIGIN_ROOT_SIZE and not roots[0].radius)
            or any(abs(root.value - neighbour.value) <= root.radius + neighbour.radius for neighbour in roots)
        ):
            continue
        if abs(root.value.imag) <= root.radius:
            root = RefinedRoot(complex(root.value.real), root.radius)
        roots.append(root)
        if root.value.imag < 0:
            root = roots[-1] = RefinedRoot(root.value.conjugate(), root.radius)
        if root.value.imag:
            roots.append(RefinedRoot(root.value.conjugate(), root.radius))
    roots.sort(key=lambda root: (-root.value.real, abs(root.value.imag), -root.value.imag))
    for count in range(min(max_roots, len(roots) - 1), 0, -1):
        upper, lower = roots[count - 1].value.real, roots[count].value.real
        line = (upper + lower) / 2
        if not upper > line > lower:
            continue
        try:
            if roots_right_of(function, line, work) == count:
                return roots[:count], line
        except Undecided:
            if work.left < 0:
                break
    return roots[:max_roots], math.inf
