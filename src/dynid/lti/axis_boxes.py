"""Quasi-polynomials over intervals of the imaginary axis, in arrays of doubles with bounds on all errors.

On s = jm(1 + ρ), |ρ| <= η, every polynomial is expanded about the middle m in all its powers, so that value,
slope and bounds on the rest belong to the interval; round-off is bounded a priori (Higham 2002, 5.1). What
doubles do not decide is left to ball arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np
from flint import arb
from numpy.typing import NDArray

from dynid.arrays import Array, ComplexArray
from dynid.errors import Undecided
from dynid.lti.quasi_polynomials import Balls

#: Round-off of a double.
_EPS = 2.0**-52
#: Intervals that are expanded at a time, which limits the memory.
_INTERVAL_CHUNK = 4096
#: Lowest frequency of the first grid above 0, relative to the highest one.
_LOW_RATIO = 2.0**-24
#: What a search along the axis counts.
INTERVALS = "terms on intervals of frequencies; their number grows with delay times bandwidth"


class Work:
    """The budget of searches, a limit on a `unit` that depends on no clock."""

    def __init__(self, limit: int, unit: str = INTERVALS) -> None:
        self.limit = self.left = limit
        self.unit = unit

    def spend(self, count: int) -> None:
        """Count some more; `Undecided` where it is more than the limit."""
        self.left -= count
        if self.left < 0:
            raise Undecided(f"the search takes more than {self.limit} {self.unit}")


@dataclass(frozen=True)
class Expansion:
    """A function on intervals: value and slope (by ρ) in the middle, and bounds.

    `bend` bounds the second derivative by ρ, `error` the round-off of the value; `width` is the half width η
    of the intervals, relative to their middles.
    """

    value: ComplexArray
    slope: ComplexArray
    bend: Array
    error: Array
    width: Array

    @property
    def rest(self) -> Array:
        """Bound on what value and slope leave."""
        return np.asarray(self.bend * self.width**2 / 2 + self.error)

    @property
    def largest(self) -> Array:
        """Bound on the size."""
        return np.asarray(np.abs(self.value) + np.abs(self.slope) * self.width + self.rest)

    @property
    def largest_slope(self) -> Array:
        """Bound on the first derivative by ρ."""
        return np.asarray(np.abs(self.slope) + self.bend * self.width)

    @property
    def smallest(self) -> Array:
        """Lower bound on the size; negative where it may vanish."""
        return np.asarray(np.abs(self.value) - np.abs(self.slope) * self.width - self.rest)

    def __add__(self, other: Expansion) -> Expansion:
        return Expansion(
            self.value + other.value,
            self.slope + other.slope,
            self.bend + other.bend,
            self.error + other.error,
            self.width,
        )

    def over(self, other: Expansion) -> Expansion:
        """Return the quotient; its bend is infinite where the denominator may vanish."""
        with np.errstate(all="ignore"):
            value = self.value / other.value
            slope = (self.slope - value * other.slope) / other.value
            ends = np.abs(value) + np.abs(slope) * self.width
            # N - (r0 + r1 ρ) Q = N2 - r1 Q1 ρ² - (r0 + r1 ρ) Q2, over Q
            bend = self.bend + 2 * np.abs(slope * other.slope) + ends * other.bend
            smallest = np.where(other.smallest > 0, other.smallest, 0.0)
            error = (self.error + ends * other.error) / smallest
            return Expansion(value, slope, bend / smallest, error, self.width)


@dataclass(frozen=True)
class Sum:
    """The `total` of a quasi-polynomial on intervals; its terms without exp(-s τ), the prompt one first."""

    terms: tuple[Expansion, ...]
    total: Expansion


class AxisFunctions:
    """Several quasi-polynomials on the imaginary axis, over one scale of values and frequencies."""

    def __init__(self, functions: Sequence[Balls]) -> None:
        terms = [(number, term) for number, function in enumerate(functions) for term in function.terms]
        self.count = len(functions)
        self.degree = max(term.polynomials[0].degree() for _, term in terms)
        self.scale, coefficients = _scaled([term.polynomials[0] for _, term in terms], self.degree)
        self._of = [number for number, _ in terms]
        self._delays = [float(term.delay.mid()) for _, term in terms]
        turned = coefficients * np.array([1j**k for k in range(self.degree + 1)])
        powers = range(self.degree + 1)
        binomials = np.array([[comb(k, i) for i in powers] for k in powers], float)
        self._sizes = np.abs(coefficients)
        self._matrices = turned[:, :, None] * binomials  # term x power of ω x power of ρ

    def expand(self, low: Array, high: Array, work: Work) -> list[Sum]:
        """Return the functions on intervals of frequencies, rad/s, all divided by one positive size."""
        work.spend(len(low) * len(self._of))
        middle = (low + high) / 2
        width = np.divide(high - low, high + low, out=np.zeros(len(low)), where=high > 0)
        powers = np.arange(self.degree + 1)
        with np.errstate(all="ignore"):
            grown = (middle / self.scale)[:, None] ** powers
            spread = width[:, None] ** powers
            majorants = [grown @ size for size in self._sizes]
            level = sum(majorants) + 0.0
            grown /= level[:, None]
            sums: list[list[tuple[Expansion, float]]] = [[] for _ in range(self.count)]
            for number, delay, matrix, majorant in zip(
                self._of, self._delays, self._matrices, majorants, strict=True
            ):
                taylor = grown @ matrix
                sizes = np.abs(taylor)
                second = sizes[:, 2:] * spread[:, : max(self.degree - 1, 0)]
                bend = second @ (powers[2:] * (powers[2:] - 1.0))
                error = _EPS * (4 * self.degree + 12) * (1 + self.degree * width) * majorant / level
                slope = taylor[:, 1] if self.degree else np.zeros(len(middle), complex)
                term = Expansion(taylor[:, 0], slope, bend, error, width)
                sums[number].append((term, delay))
            return [_sum(parts, middle) for parts in sums]


def _sum(parts: list[tuple[Expansion, float]], middle: Array) -> Sum:
    nothing = np.zeros(len(middle))
    total = Expansion(nothing.astype(complex), nothing.astype(complex), nothing, nothing, nothing)
    for term, delay in parts:
        angle = middle * delay
        turn = np.exp(-1j * angle)
        turned = Expansion(
            term.value * turn,
            (term.slope - 1j * angle * term.value) * turn,
            term.bend + 2 * angle * term.largest_slope + angle**2 * term.largest,
            (term.error + _EPS * (2 * angle + 2) * np.abs(term.value)) * (1 + angle * term.width),
            term.width,
        )
        total = turned + total
    return Sum(tuple(term for term, _ in parts), total)


def _scaled(polynomials: Sequence[object], degree: int) -> tuple[float, NDArray[np.float64]]:
    """Return a scale of frequencies, and coefficients in its powers, divided by the largest."""
    rows = [[abs(polynomial[k].real) for k in range(degree + 1)] for polynomial in polynomials]  # type: ignore[index]
    sizes = [max((row[k] for row in rows), key=float_log) for k in range(degree + 1)]
    present = [(k, float_log(size)) for k, size in enumerate(sizes) if size != 0]
    (first, low), (last, high) = present[0], present[-1]
    exponent = round((low - high) / (last - first)) if last > first else 0
    top = max(size + k * exponent for k, size in present)
    values = []
    for polynomial in polynomials:
        factors = [arb(2) ** (k * exponent - int(top)) for k in range(degree + 1)]
        values.append([float((polynomial[k].real * factors[k]).mid()) for k in range(degree + 1)])  # type: ignore[index]
    scaled = np.array(values)
    if not np.isfinite(scaled).all():
        raise Undecided("the coefficients of the characteristic function are out of range")
    return 2.0**exponent, scaled


def float_log(size: object) -> float:
    """Return the binary logarithm of a ball's middle (flint `arb`), -inf of 0."""
    middle = size.mid()  # type: ignore[attr-defined]
    return float((middle.log() / arb(2).log()).mid()) if middle > 0 else -np.inf


def grid(start: float, top: float) -> tuple[Array, Array]:
    """Return intervals between two frequencies, each twice as high as the last; the lowest may begin at 0."""
    low = start or top * _LOW_RATIO
    count = max(1, int(np.ceil(np.log2(top / low))))
    edges = np.geomspace(low, top, count + 1)
    if not start:
        edges = np.append(0.0, edges)
    return edges[:-1], edges[1:]


def bisect(low: Array, high: Array, examine: Callable[[Array, Array], NDArray[np.bool_]]) -> None:
    """Examine intervals in portions that fit into memory; those in the mask that this returns are halved."""
    while len(low):
        masked: list[tuple[Array, Array]] = []
        for start in range(0, len(low), _INTERVAL_CHUNK):
            lows, highs = low[start : start + _INTERVAL_CHUNK], high[start : start + _INTERVAL_CHUNK]
            divided = examine(lows, highs)
            masked.append((lows[divided], highs[divided]))
        low, high = (np.concatenate(ends) for ends in zip(*masked, strict=True))
        middle = (low + high) / 2
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
