"""The difference operator of a quasi-polynomial: what decides its roots of high frequency.

Where delayed terms have the largest degree n, the roots of high frequency are those of D = Σ c_k exp(-s τ_k),
of the coefficients of s^n. Without a prompt coefficient the equation is advanced. Otherwise it is stable for
all delays near the ones stated if D, as a polynomial in one variable q = exp(-s τ) for each loop, has no zero
in the closed polydisc |q| <= 1 (Hale & Verduyn Lunel 1993, 9.6; Michiels et al. 2009 for sums of delays).

With D = a + b q there is none if a has none, and |a| > |b| on the torus (the maximum of |b/a| lies there). D
has every variable to the first degree, so that of three variables |a|² - |b|² is affine in exp(jθ3), and its
least value over θ3 a polynomial of degree 2 in cos θ2: exact in rational numbers. Of more variables its sign
on the torus is decided in boxes, up to a number of them.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping
from fractions import Fraction
from itertools import compress, product
from typing import Any

import numpy as np
from flint import Ordering, fmpq, fmpq_poly, fmpz_mpoly_ctx

from dynid.errors import Undecided
from dynid.lti.axis_boxes import Work

#: Variables up to which the polydisc is decided exactly; beyond, in boxes of the torus.
VARIABLES = 3
#: Halvings of a box, at which terms of second order are those of round-off.
_HALVINGS = 24
#: Relative distance from a gain at which roots pass the axis, up to which none is proved to pass before.
_NEAR_GAIN = Fraction(1, 10**6)

#: Gains at which a range of gains is examined.
_GAINS = 200
#: Boxes of the torus at a time, which take some 10 ms.
_MAX_TORUS_BOXES = 20_000

#: Cosines in boxes of the torus that one decision on more variables may take, some 50 ms.
TORUS = 2_000_000

Coefficients = Mapping[frozenset[Any], Fraction]


def separation(coefficients: Coefficients, work: Work | None = None) -> Fraction | None:
    """Return a lower bound on |D| over the closed polydisc; 0 where D has a zero there, None if undecided.

    `work` limits the boxes of the torus; default: `TORUS`.
    """
    work = work or _torus_work()
    coefficients = {key: value for key, value in coefficients.items() if value}
    prompt = abs(coefficients.get(frozenset(), Fraction(0)))
    others = sum(abs(value) for key, value in coefficients.items() if key)
    if prompt > others:
        return prompt - others
    variables = _variables(coefficients)
    start = coefficients.get(frozenset(), Fraction(0))
    if any(_corner(coefficients, signs) * start <= 0 for signs in _signs(variables)):
        return Fraction(0)
    if len(variables) > VARIABLES and len(factors := _factors(coefficients, variables)) > 1:
        bounds = [separation(factor, work) for factor in factors]
        if 0 in bounds:
            return Fraction(0)
        return None if None in bounds else math.prod(filter(None, bounds), start=Fraction(1))
    last = variables[-1]
    without = {key: value for key, value in coefficients.items() if last not in key}
    inner = separation(without, work)
    if not inner:
        return inner
    apart = gap(without, {key - {last}: value for key, value in coefficients.items() if last in key}, work)
    return max(apart, _least_on_torus(coefficients, variables)) if apart else apart


def _factors(coefficients: Coefficients, variables: list[Hashable]) -> list[dict[frozenset[Any], Fraction]]:
    """Return the factors of D, without common variables: those of loops that are apart."""
    context = fmpz_mpoly_ctx.get([f"q{number}" for number in range(len(variables))], Ordering.lex)
    scale = math.lcm(*(value.denominator for value in coefficients.values()))
    powers = {
        tuple(int(name in key) for name in variables): int(value * scale)
        for key, value in coefficients.items()
    }
    content, factors = context.from_dict(powers).factor()
    found = [
        {
            frozenset(compress(variables, exponents)): Fraction(int(c))
            for exponents, c in factor.to_dict().items()
        }
        for factor, _ in factors
    ]
    return [{key: value * int(content) / scale for key, value in found[0].items()}, *found[1:]]


def _least_on_torus(coefficients: Coefficients, variables: list[Hashable]) -> Fraction:
    """Return a lower bound on |D| over the torus, about half of its least size; 0 where it takes too long."""
    exponents = np.array([[name in key for name in variables] for key in coefficients], float)
    total = sum(map(abs, coefficients.values()))
    sizes = np.array([float(value / total) for value in coefficients.values()])
    steepness = float(np.abs(sizes) @ exponents.sum(axis=1) ** 2)
    middles, half, smallest = np.zeros((1, len(variables))), math.pi, math.inf
    corners = np.array(list(product((-1, 1), repeat=len(variables))))
    while len(middles):
        if len(middles) > _MAX_TORUS_BOXES:
            return Fraction(0)
        turned = np.exp(1j * middles @ exponents.T) * sizes
        size, slopes = np.abs(turned.sum(axis=1)), np.abs(turned @ exponents)
        smallest = min(smallest, float(size.min()))
        lower = size - half * slopes.sum(axis=1) - steepness * half**2 / 2
        half /= 2
        middles = (middles[lower < smallest / 2][:, None] + half * corners).reshape(-1, len(variables))
    return total * Fraction(smallest) * Fraction(49, 100)  # the rest of the half exceeds round-off


def _torus_work() -> Work:
    return Work(TORUS, "cosines on the torus")


def gap(larger: Coefficients, smaller: Coefficients, work: Work | None = None) -> Fraction | None:
    """Return a lower bound on |a| - |b| over the torus; 0 where it is not positive, None if undecided."""
    sizes = [sum((abs(value) for value in weights.values()), Fraction(0)) for weights in (larger, smaller)]
    prompt = abs(larger.get(frozenset(), Fraction(0)))
    if 2 * prompt > sum(sizes):
        return 2 * prompt - sum(sizes)
    variables = _variables(larger, smaller)
    if len(variables) >= VARIABLES:
        corners = ([_corner(weights, signs) for weights in (larger, smaller)] for signs in _signs(variables))
        if any(abs(a) <= abs(b) for a, b in corners):
            return Fraction(0)
        try:
            return _least_difference(larger, smaller, variables, work or _torus_work()) * sum(sizes)
        except Undecided:
            return None
    mean, quadratic = _least_square(larger, smaller, variables)
    ends = [mean[0] - mean[1], mean[0] + mean[1]]
    if min(ends) <= 0:
        return Fraction(0)
    f0, f1, f2 = quadratic
    values = [f0 - f1 + f2, f0 + f1 + f2]
    if f2 > 0 and abs(f1) < 2 * f2:
        values.append(f0 - f1 * f1 / (4 * f2))
    # |a| - |b| = (|a|² - |b|²)/(|a| + |b|), and the least |a|² - |b|² is F/(A + 2 |Z|) with |Z| < A/2.
    return max(Fraction(0), Fraction(min(values) / (2 * max(ends) * sum(sizes))))


def _least_difference(
    larger: Coefficients, smaller: Coefficients, variables: list[Hashable], work: Work
) -> Fraction:
    """Return a lower bound on |a| - |b| over the torus, over the sum of all sizes; as `gap`, in boxes.

    |a|² - |b|² is a sum of cosines, of which value and slopes in the middle of a box, and a bound on the
    second derivatives, bound the least value there. `Undecided` where it is too near to 0, or takes too long.
    """
    total = sum((abs(value) for weights in (larger, smaller) for value in weights.values()), Fraction(0))
    cosines: dict[tuple[int, ...], Fraction] = {}
    for weights, sign in ((larger, 1), (smaller, -1)):
        for key, value in weights.items():
            for other_key, factor in weights.items():
                order = tuple((name in key) - (name in other_key) for name in variables)
                cosines[order] = cosines.get(order, Fraction(0)) + sign * value * factor / total**2
    orders = np.array(list(cosines), float)
    sizes = np.array([float(value) for value in cosines.values()])
    steepness = float(np.abs(sizes) @ np.abs(orders).sum(axis=1) ** 2)
    rounding = 2.0**-44 * float(np.abs(sizes).sum())
    middles, half, smallest = np.zeros((1, len(variables))), math.pi, math.inf
    corners = np.array(list(product((-1, 1), repeat=len(variables))))
    for _ in range(_HALVINGS):
        work.spend(middles.shape[0] * len(orders))
        angles = middles @ orders.T
        values, slopes = np.cos(angles) @ sizes, np.abs((np.sin(angles) * sizes) @ orders)
        smallest = min(smallest, float(values.min()))
        if smallest < -rounding:
            return Fraction(0)
        lower = values - half * slopes.sum(axis=1) - steepness * half**2 / 2 - rounding
        half /= 2
        middles = (middles[lower < smallest / 2][:, None] + half * corners).reshape(-1, len(variables))
        if not len(middles) and smallest > 2 * rounding:
            return Fraction(smallest) / 2
    raise Undecided("the least difference on the torus is that of round-off")


def critical_gains(smaller: Coefficients, larger: Coefficients) -> tuple[float, float] | None:
    """Return the gains k nearest to 1, below and above, at which D = b + k a gets a zero in the polydisc.

    `smaller` is a, `larger` b. Where b + a has such a zero itself, the gains are those at which this changes;
    0 and inf where there is none, None if undecided.
    """
    variables = _variables(smaller, larger)
    gains = set[Fraction | float]()
    for signs in _signs(variables):
        slope, constant = _corner(smaller, signs), _corner(larger, signs)
        if slope and -constant / slope > 0:
            gains.add(-constant / slope)
    if len(variables) >= VARIABLES:
        gains |= set(_touching_gains(smaller, larger, variables))
    if len(variables) > VARIABLES:
        return _corner_gains(smaller, larger, gains)
    ordered = sorted(gains)
    above = [gain for gain in ordered if gain > 1]
    below = [gain for gain in ordered if gain <= 1][::-1]

    def free(gain: Fraction) -> bool | None:
        distance = separation(_at_gain(smaller, larger, gain))
        return None if distance is None else distance > 0

    now = free(Fraction(1))
    results = []
    for candidates, end in ((below, 0.0), (above, math.inf)):
        result = end
        for number, gain in enumerate(candidates):
            following = candidates[number + 1] if number + 1 < len(candidates) else None
            if following is None:
                beyond = Fraction(gain) / 2 if end == 0 else Fraction(gain) * 2
            else:
                beyond = (Fraction(gain) + Fraction(following)) / 2
            then = free(beyond)
            if now is None or then is None:
                return None
            if now != then:
                result = float(gain)
                break
        results.append(result)
    return results[0], results[1]


def _corner_gains(
    smaller: Coefficients, larger: Coefficients, gains: set[Fraction | float]
) -> tuple[float, float] | None:
    """Return the nearest of the gains at which D has a zero at ±1, if none before has one elsewhere."""
    below = max((Fraction(gain) for gain in gains if gain <= 1), default=Fraction(0))
    above = min((Fraction(gain) for gain in gains if gain > 1), default=None)
    proofs = [(smaller, larger, min(below * (1 + _NEAR_GAIN), Fraction(1)), Fraction(1))]
    if above is None:  # b/k + a for 1/k from 0 to 1
        proofs.append((larger, smaller, Fraction(0), Fraction(1)))
    else:
        proofs.append((smaller, larger, Fraction(1), max(above * (1 - _NEAR_GAIN), Fraction(1))))
    if not all(least_separation(*proof) for proof in proofs):
        return None
    return float(below), math.inf if above is None else float(above)


def least_separation(
    smaller: Coefficients, larger: Coefficients, low: float | Fraction, high: float | Fraction
) -> Fraction | None:
    """Return a lower bound on |b + k a| over the closed polydisc and low <= k <= high.

    0 where there is a zero, or nearly; None if undecided.
    """
    steepness, work = sum((abs(value) for value in smaller.values()), Fraction(0)), _torus_work()
    intervals, smallest, count = [(Fraction(low), Fraction(high))], None, 0
    while intervals:
        start, end = intervals.pop()
        middle, count = (start + end) / 2, count + 1
        apart = separation(_at_gain(smaller, larger, middle), work)
        if apart is None:
            return None
        lost = steepness * (end - start) / 2
        if apart > 2 * lost:
            smallest = apart - lost if smallest is None else min(smallest, apart - lost)
        elif not apart or count > _GAINS:
            return Fraction(0)
        else:
            intervals += [(start, middle), (middle, end)]
    return smallest


def _at_gain(smaller: Coefficients, larger: Coefficients, gain: Fraction) -> dict[frozenset[Any], Fraction]:
    keys = {**smaller, **larger}
    return {key: larger.get(key, Fraction(0)) + gain * smaller.get(key, Fraction(0)) for key in keys}


def _touching_gains(
    smaller: Coefficients, larger: Coefficients, variables: list[Hashable]
) -> Iterator[float]:
    """Yield the gains at which the least |a|² - |b|² of b + k a may have a double zero between ±1."""
    from dynid.lti.certified_roots import certified_roots

    exact = dict[frozenset[Any], Any]()
    for key in {**smaller, **larger}:
        pair = (weights.get(key, Fraction(0)) for weights in (larger, smaller))
        exact[key] = fmpq_poly([fmpq(c.numerator, c.denominator) for c in pair])
    *rest, last = variables
    without = {key: value for key, value in exact.items() if last not in key}
    with_last = {key - {last}: value for key, value in exact.items() if last in key}
    _, (f0, f1, f2) = _least_square(without, with_last, rest)
    discriminant = (f1 * f1 - 4 * f0 * f2).numer()
    if discriminant.degree() > 0:
        for root in certified_roots(discriminant):
            if root.value.real > 0 and abs(root.value.imag) <= root.radius:
                yield root.value.real


def _least_square(
    larger: Mapping[frozenset[Any], Any], smaller: Mapping[frozenset[Any], Any], variables: list[Hashable]
) -> tuple[tuple[Any, Any], tuple[Any, Any, Any]]:
    """Return |a|² - |b|² of at most two variables: its mean A over θ2, affine in c = cos θ1, and A² - 4 |Z|².

    With |a|² - |b|² = A + 2 Re(Z exp(jθ2)) its least value over θ2 is A - 2 |Z|.
    """
    first, second = [*variables, None, None][:2]
    mean, harmonic = [0, 0], [0, 0, 0]
    for weights, sign in ((larger, 1), (smaller, -1)):
        a0, a1, a2, a12 = (
            weights.get(frozenset(name for name in key if name is not None), 0) if None not in key else 0
            for key in ((), (first,), (second,), (first, second))
        )
        mean[0] += sign * (a0 * a0 + a1 * a1 + a2 * a2 + a12 * a12)
        mean[1] += sign * 2 * (a0 * a1 + a2 * a12)
        # conj(a0 + a1 x) (a2 + a12 x) on |x| = 1: constant, factor of x, factor of conj(x)
        harmonic[0] += sign * (a0 * a2 + a1 * a12)
        harmonic[1] += sign * a0 * a12
        harmonic[2] += sign * a1 * a2
    p, r, t = harmonic
    # |Z|² = (p + (r + t) c)² + (r - t)² (1 - c²)
    squares = (p * p + (r - t) * (r - t), 2 * p * (r + t), (r + t) * (r + t) - (r - t) * (r - t))
    m0, m1 = mean
    return (m0, m1), (m0 * m0 - 4 * squares[0], 2 * m0 * m1 - 4 * squares[1], m1 * m1 - 4 * squares[2])


def _variables(*parts: Mapping[frozenset[Any], Any]) -> list[Any]:
    return sorted(set().union(*(key for weights in parts for key, value in weights.items() if value)))


def _signs(variables: list[Hashable]) -> Iterator[dict[Hashable, int]]:
    for signs in product((1, -1), repeat=len(variables)):
        yield dict(zip(variables, signs, strict=True))


def _corner(coefficients: Coefficients, signs: Mapping[Hashable, int]) -> Fraction:
    """Return D at real values ±1 of its variables."""
    terms = (value * math.prod(signs[name] for name in key) for key, value in coefficients.items() if value)
    return sum(terms, Fraction(0))
