"""Sums of exponentials in time: the transient of a rational transfer function, with all of its extremes.

The transient of T(s)/s beside its steady state is d(t) = Σ c t^l exp(p t), with the poles p of T and residues
c in ball arithmetic. Between two times every extreme of d is found: on a box of time a Taylor polynomial with
a bound on its remainder proves that the rate has no zero, or one at most, or the box is divided. No extreme
is missed between the points of a grid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.errors import NumericalError

#: Order of the Taylor polynomials.
_TAYLOR_ORDER = 10
#: Most boxes that are examined at a time; a longer span of time is divided before.
_MAX_TIME_BOXES = 4096
#: Most spans of time that a search visits.
_MAX_SPANS = 5000
#: Relative rounding of doubles that a search may lose to cancelling residues.
_MAX_CANCELLATION = 1e8
#: Where d changes by less than this over a box, relative to its terms, it is flat: rounding decides.
_FLAT_BOX_TOL = 1e-13
#: Shortest half width of a box, in units of the fastest time constant.
_MIN_INTERVAL_RTOL = 1e-20
#: Working precisions, bits.
_SUM_PRECISIONS = (160, 320, 640, 1280, 2560, 5120)


class ExponentialSum:
    """The transient d(t) of the response of a stable, proper T(s) to a unit step, for t > 0.

    T(s) is in lowest terms (flint `fmpz_poly`), its poles in the open left half-plane, one at least. Times
    inside are in units of `time`, 1/|p| of the fastest pole, s; values in units of `size`, the largest
    residue (`arb`).
    """

    def __init__(self, numerator: Any, denominator: Any) -> None:
        from flint import arb, ctx

        vanishing = _vanishing(numerator, denominator)
        for self.precision in _SUM_PRECISIONS:
            with ctx.workprec(self.precision):
                terms = _residues(numerator, denominator, vanishing)
                fastest = max(float(abs(pole).mid()) for pole, _ in terms)
                self.size = max((abs(c).mid() for _, parts in terms for c in parts), key=float)
                if all(c.is_zero() or c.rel_accuracy_bits() > 100 for _, parts in terms for c in parts):
                    break
        else:
            raise NumericalError(
                f"{_SUM_PRECISIONS[-1]} bits do not resolve the residues of the step response",
                remedy="Leave the result 'step_info' out.",
            )
        self.time = 1 / fastest
        with ctx.workprec(self.precision):
            scale = arb(self.time)
            self._poles, self._powers, self._balls = [], [], []
            for pole, parts in terms:
                weight = (1 if pole.imag == 0 else 2) / self.size
                scaled = [c * weight * scale**k for k, c in enumerate(parts)]
                for power in range(len(parts)):
                    self._poles.append(pole * scale)
                    self._powers.append(power)
                    self._balls.append(_taylor_row(pole * scale, scaled, power))
        self.poles = np.array([complex(pole) for pole in self._poles])
        self.powers = np.array(self._powers, dtype=float)
        self._rows = np.array([[complex(c) for c in row] for row in self._balls])
        self._sizes = np.abs(self._rows)
        self.cancels = self._cancelling()

    # Values

    def at(self, time: Any, order: int) -> Any:
        """Return a Taylor coefficient of d at a time, in ball arithmetic (flint `arb`)."""
        from flint import acb, ctx

        with ctx.workprec(self.precision):
            total = acb(0)
            for pole, power, row in zip(self._poles, self._powers, self._balls, strict=True):
                total += (pole * time).exp() * acb(time) ** power * row[order]
            return total.real

    def taylor(self, times: Array) -> Array:
        """Return the Taylor coefficients of d at times, shape (times, order + 2)."""
        if self.cancels:
            orders = range(_TAYLOR_ORDER + 2)
            return np.array([[float(self.at(float(t), k).mid()) for k in orders] for t in times])
        with np.errstate(under="ignore"):
            columns = np.exp(np.multiply.outer(times, self.poles)) * np.power.outer(times, self.powers)
            return np.asarray((columns @ self._rows).real)

    def values(self, times: Array) -> Array:
        """Return d at times."""
        return self.taylor(times)[:, 0]

    def _cancelling(self) -> bool:
        """Return True where residues cancel too far for double precision."""
        self.cancels = True
        slowest = 10 / float(-self.poles.real.max())
        sample = np.concatenate([[0.0], np.geomspace(min(0.1, slowest / 2), slowest, 40)])
        largest = float(np.abs(self.values(sample)).max())
        return float(self._sizes[:, 0].sum()) > _MAX_CANCELLATION * largest

    # Bounds

    def bound(self, time: float) -> float:
        """Return a bound on |d| at this time and all later ones."""
        latest = np.maximum(time, self.powers / -self.poles.real)  # where t^l exp(σ t) is largest
        with np.errstate(under="ignore"):
            return float(np.exp(self.poles.real * latest) * latest**self.powers @ self._sizes[:, 0])

    def horizon(self, level: float) -> float:
        """Return a time after which |d| stays below a level."""
        late = 1.0
        while self.bound(late) > level:
            late *= 2
        early = 0.0
        while late - early > 1e-12 * late:
            middle = (early + late) / 2
            early, late = (early, middle) if self.bound(middle) <= level else (middle, late)
        return late

    def last_extreme(self) -> float:
        """Return a time after which the slowest term decides the sign of d'; inf where it oscillates."""
        slowest = self.poles.real.max()
        slow = self.poles.real == slowest
        if len(set(self.poles[slow])) > 1 or self.poles[slow][0].imag != 0:
            return math.inf
        rates = self._sizes[:, 1]
        top = slow & (self.powers == self.powers[slow].max())
        if not rates[top][0]:
            return math.inf
        gaps = slowest - self.poles.real[~slow]
        time = float((self.powers[~slow] / gaps).max(initial=1.0))
        while time < 1e15:
            with np.errstate(under="ignore"):
                remainder = float(np.exp(-gaps * time) * time ** self.powers[~slow] @ rates[~slow])
            rest = float(time ** self.powers[slow & ~top] @ rates[slow & ~top])
            if remainder + rest < 0.5 * float(time ** self.powers[top][0] * rates[top][0]):
                return time
            time *= 1.5
        return math.inf

    # Extremes

    def pieces(self, start: float, stop: float, *, backward: bool = False) -> Iterator[tuple[Array, Array]]:
        """Yield spans of time in order: times between which d is monotone, the ends included, and d there."""
        spans, visited = [(start, stop)], 0
        while spans:
            low, high = spans.pop()
            extremes = self._extremes(low, high)
            if extremes is None:
                halves = [(low, (low + high) / 2), ((low + high) / 2, high)]
                spans += halves if backward else halves[::-1]
                continue
            visited += 1
            if visited > _MAX_SPANS:
                raise NumericalError(
                    "the step response has millions of oscillations, of which any may be the largest",
                    remedy="Leave the result 'step_info' out.",
                )
            times = np.unique(np.concatenate([[low], extremes, [high]]))
            yield times, self.values(times)

    def _extremes(self, start: float, stop: float) -> Array | None:
        """Return the extremes of d between two times, ascending; None where that takes too many boxes."""
        orders = np.arange(1, _TAYLOR_ORDER + 2)
        extremes = []
        low, high = np.array([start]), np.array([stop])
        while len(low):
            if len(low) > _MAX_TIME_BOXES:
                return None
            middle, half = (low + high) / 2, (high - low) / 2
            values = self.taylor(middle)
            rates = values[:, 1:] * orders  # Taylor coefficients of d'
            steps = half[:, None] ** np.arange(_TAYLOR_ORDER + 1)
            remainder = (
                (_TAYLOR_ORDER + 1) * self._sum_of_bounds(low, high, _TAYLOR_ORDER + 1) * half**_TAYLOR_ORDER
            )
            terms = np.abs(rates[:, :_TAYLOR_ORDER]) * steps[:, :_TAYLOR_ORDER]
            may_vanish = np.abs(rates[:, 0]) <= terms[:, 1:].sum(axis=1) + remainder
            curving = (terms[:, 2:] * np.arange(2, _TAYLOR_ORDER)).sum(axis=1) + _TAYLOR_ORDER * remainder
            monotone = terms[:, 1] > curving
            size = np.abs(values[:, 0]) if self.cancels else self._sum_of_bounds(low, high, 0)
            flat = 2 * half * (terms.sum(axis=1) + remainder) <= _FLAT_BOX_TOL * size
            narrow = flat | (half <= np.maximum(8 * np.spacing(high), _MIN_INTERVAL_RTOL))
            single = may_vanish & monotone & ~narrow
            if single.any():
                signs = [self.taylor(ends[single])[:, 1] >= 0 for ends in (low, high)]
                turning = signs[0] != signs[1]
                extremes.append(self._turned(low[single][turning], high[single][turning], signs[0][turning]))
            extremes.append(middle[may_vanish & narrow])
            split = may_vanish & ~monotone & ~narrow
            low, high = (
                np.concatenate([low[split], middle[split]]),
                np.concatenate([middle[split], high[split]]),
            )
        return np.sort(np.concatenate(extremes)) if extremes else np.zeros(0)

    def _sum_of_bounds(self, low: Array, high: Array, order: int) -> Array:
        """Return bounds on a Taylor coefficient of d over boxes of time, term by term."""
        with np.errstate(under="ignore"):
            columns = np.exp(np.multiply.outer(low, self.poles.real)) * np.power.outer(high, self.powers)
        return np.asarray(columns @ self._sizes[:, order])

    def _turned(self, low: Array, high: Array, rising: NDArray[np.bool_]) -> Array:
        """Return the zeros of d' in brackets on which it is monotone."""
        time = (low + high) / 2
        for _ in range(60):
            if not len(time):
                break
            rate, slope = self.taylor(time)[:, 1:3].T
            before = (rate >= 0) == rising
            low, high = np.where(before, time, low), np.where(before, high, time)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = time - rate / (2 * slope)
            inside = (step > low) & (step < high)
            following = np.where(inside, step, (low + high) / 2)
            if np.all(np.abs(following - time) <= 1e-14 * time):
                break
            time = following
        return time

    def root(self, order: int, level: Any, low: float, high: float) -> Any:
        """Return the time in a bracket at which a Taylor coefficient of d takes a level (flint `arb`)."""
        from flint import arb, ctx

        with ctx.workprec(self.precision):
            ends = [arb(low), arb(high)]
            below = bool((self.at(ends[0], order) - level).mid() < 0)
            time = (ends[0] + ends[1]) / 2
            for _ in range(200):
                value = (self.at(time, order) - level).mid()
                ends[0 if bool(value < 0) is below else 1] = time
                slope = (self.at(time, order + 1) * (order + 1)).mid()
                following = time - value / slope if slope != 0 else time
                if not (ends[0] < following < ends[1]):
                    following = (ends[0] + ends[1]) / 2
                following = following.mid()
                done = abs(following - time) <= abs(following) * arb(2) ** -70
                time = following
                if done:
                    break
            return time


def _taylor_row(pole: Any, parts: list[Any], power: int) -> list[Any]:
    """Return the coefficients of exp(p t) t^power in the Taylor coefficients of Σ c_k t^k/k! exp(p t)."""
    from flint import acb, arb

    row = []
    for order in range(_TAYLOR_ORDER + 2):
        total = acb(0)
        for i in range(min(order, len(parts) - 1 - power) + 1):
            share = parts[power + i] / (arb.fac_ui(power) * arb.fac_ui(i))
            total += share * pole ** (order - i) / arb.fac_ui(order - i)
        row.append(total)
    return row


def _vanishing(numerator: Any, denominator: Any) -> list[tuple[Any, list[int]]]:
    """Return which coefficients of the series at multiple poles of T(s)/s are exactly zero.

    At a root x of an irreducible factor f of multiplicity m these coefficients, of
    T(x + h)/(x + h) h^m = a(h)/b(h), are polynomials in x modulo f.
    """
    from flint import fmpq_poly

    s, vanishing = fmpq_poly([0, 1]), []
    for factor, multiplicity in denominator.factor()[1]:
        if multiplicity == 1:  # T is in lowest terms: its residue is not zero
            continue
        count, modulus = int(multiplicity), fmpq_poly(factor)
        above = _series_modulo(fmpq_poly(numerator), modulus, count)
        below = _series_modulo(s * fmpq_poly(denominator // factor**count), modulus, count)
        slope = _series_modulo(modulus, modulus, count + 1)[1:]  # f(x + h) / h
        for _ in range(count):
            below = [
                sum((below[i] * slope[k - i] for i in range(k + 1)), fmpq_poly(0)) % modulus
                for k in range(count)
            ]
        scaled: list[Any] = []  # the coefficients times powers of b(0), so that nothing is divided
        for k in range(count):
            rest = above[k] * below[0] ** k % modulus
            for i in range(1, k + 1):
                rest -= below[i] * below[0] ** (i - 1) % modulus * scaled[k - i]
            scaled.append(rest % modulus)
        vanishing.append((factor, [k for k, coefficient in enumerate(scaled) if coefficient == 0]))
    return vanishing


def _series_modulo(polynomial: Any, modulus: Any, count: int) -> list[Any]:
    """Return the first coefficients of p(x + h) in powers of h, modulo a polynomial in x."""
    series = []
    for k in range(count):
        series.append(polynomial % modulus)
        polynomial = polynomial.derivative() / (k + 1)
    return series


def _residues(
    numerator: Any, denominator: Any, vanishing: list[tuple[Any, list[int]]]
) -> list[tuple[Any, list[Any]]]:
    """Return the poles of T(s)/s other than 0, one of each pair, and c_k of Σ c_k t^k/k! exp(p t)."""
    from flint import acb, acb_series, ctx

    poles = [(acb(pole), int(count)) for pole, count in denominator.complex_roots()]
    lead = acb(denominator.leading_coefficient())
    top = [acb(c) for c in reversed(numerator.coeffs())]
    terms = []
    cap = ctx.cap
    for index, (pole, count) in enumerate(poles):
        if pole.imag < 0:
            continue
        ctx.cap = count  # the length of series
        try:
            shift = acb_series([pole, 1])
            above = acb_series([0])
            for coefficient in top:
                above = above * shift + coefficient
            below = shift * lead
            for factor, (value, times) in enumerate(poles):
                if factor != index:
                    below = below * acb_series([pole - value, 1]) ** times
            series = above / below  # times (s - p)^-count: its coefficient k belongs to t^(count-1-k)
        finally:
            ctx.cap = cap
        zero = next((powers for f, powers in vanishing if count > 1 and f(pole).contains(0)), [])
        parts = [acb(0) if k in zero else series[k] for k in range(count)]
        terms.append((pole, parts[::-1]))
    return terms
