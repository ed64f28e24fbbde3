"""Laurent series with a few exact leading terms: how a transfer function begins at 0, infinity, j omega."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from typing import Any, NamedTuple

from dynid.bondgraph.algebra.modular import axis_point
from dynid.bondgraph.reduced import Planned, ReducedGraph
from dynid.errors import NumericalError

#: First and last number of terms that are carried before giving up.
_FIRST, _LAST = 4, 256
_NEVER = 1 << 60


class _TooFew(ArithmeticError):
    """All terms that were carried cancelled."""


class Series:
    """coefficients[0] t^start + coefficients[1] t^(start+1) + …, the first nonzero.

    Parameters
    ----------
    start
        The lowest power; without coefficients all that is known is that no power below occurs.
    coefficients
        Exact numbers (flint `fmpq`, or `nmod`).
    terms
        Most coefficients that are kept.
    """

    __slots__ = ("coefficients", "start", "terms")

    def __init__(self, start: int, coefficients: list[Any], terms: int) -> None:
        leading = next((k for k, c in enumerate(coefficients) if c != 0), len(coefficients))
        self.start, self.coefficients, self.terms = start + leading, coefficients[leading:], terms

    def __add__(self, other: Series) -> Series:
        start = min(self.start, other.start)
        end = min(self._end, other._end, start + self.terms)
        total = [self._at(power) + other._at(power) for power in range(start, end)]
        return Series(start, total, self.terms) if total else Series(end, [], self.terms)

    def __neg__(self) -> Series:
        return Series(self.start, [-c for c in self.coefficients], self.terms)

    def __sub__(self, other: Series) -> Series:
        return self + (-other)

    def __mul__(self, other: Series | int) -> Series:
        if isinstance(other, int):
            if other == 0:
                return Series(_NEVER, [], self.terms)
            return Series(self.start, [c * other for c in self.coefficients], self.terms)
        a, b = self.coefficients, other.coefficients
        size = min(len(a), len(b))
        return Series(
            self.start + other.start,
            [sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(size)],
            self.terms,
        )

    def __truediv__(self, other: Series) -> Series:
        if not other.coefficients:
            raise _TooFew
        a, b = self.coefficients, other.coefficients
        quotient: list[Any] = []
        for k in range(min(len(a), len(b))):
            quotient.append((a[k] - sum(quotient[i] * b[k - i] for i in range(k))) / b[0])
        return Series(self.start - other.start, quotient, self.terms)

    @property
    def _end(self) -> int:
        """The first power that is not known."""
        return _NEVER if self.start >= _NEVER else self.start + len(self.coefficients)

    def _at(self, power: int) -> Any:
        place = power - self.start
        return self.coefficients[place] if 0 <= place < len(self.coefficients) else 0


class _Point(NamedTuple):
    """Where to expand: a field, the values of the nodes in it, and how s begins: power and coefficients."""

    field: Callable[[int], Any]
    values: Mapping[str, Any]
    laplace: tuple[int, list[Any]]


def _rational(planned: Planned, power: int) -> _Point:
    """Return the expansion over the rationals in t, s = t^power."""
    from flint import fmpq

    exact = {name: planned.graph.value(name) for name in planned.valued}
    values = {name: fmpq(value.numerator, value.denominator) for name, value in exact.items()}
    return _Point(fmpq, values, (power, [fmpq(1)]))


def leading_terms(
    reduced: ReducedGraph, registers: Iterable[int], *, at_infinity: bool
) -> dict[int, tuple[int, Any]]:
    """Return how registers that do not vanish begin: (k, c) for c s^k as s goes to 0 or to infinity.

    Parameters
    ----------
    reduced
        The graph.
    registers
        What to expand.
    at_infinity
        Whether as s grows, or falls to 0.
    """
    sign = -1 if at_infinity else 1
    point = _rational(reduced, sign)
    run = _expanded(reduced, registers, point, lambda series: bool(series.coefficients))
    return {register: (sign * series.start, series.coefficients[0]) for register, series in run.items()}


def limits_at_rest(planned: Planned, registers: Iterable[int]) -> dict[int, float]:
    """Return the limits of registers as s goes to 0, correctly rounded; infinite at a pole.

    Parameters
    ----------
    planned
        What the program was written for.
    registers
        What to evaluate; they may vanish.
    """
    run = _expanded(planned, registers, _rational(planned, 1), _knows_its_limit)
    return {register: _limit(series) for register, series in run.items()}


def orders_on_axis(planned: Planned, registers: Iterable[int], omega: Fraction) -> dict[int, int]:
    """Return how registers begin at s = j omega: -k at a pole, k at a zero of that order, 0 elsewhere.

    They are expanded modulo a large prime, in which orders are the same but for accidents.

    Parameters
    ----------
    planned
        What the program was written for.
    registers
        What to expand; of those that vanish any positive order is returned.
    omega
        The frequency, rad/s.
    """
    at = axis_point({name: planned.graph.value(name) for name in planned.valued}, omega)
    point = _Point(at.residue, at.values, (0, [at.laplace, at.residue(1)]))
    run = _expanded(planned, registers, point, _knows_its_limit)
    return {register: series.start for register, series in run.items()}


def _knows_its_limit(series: Series) -> bool:
    return bool(series.coefficients) or series.start > 0


def _limit(series: Series) -> float:
    if series.start < 0:
        return math.inf
    return as_float(series.coefficients[0]) if series.start == 0 else 0.0


def _expanded(
    planned: Planned, registers: Iterable[int], point: _Point, known: Callable[[Series], bool]
) -> dict[int, Series]:
    """Return the series of registers, with as many terms as it takes to know them."""
    wanted, terms = list(registers), _FIRST

    def series(start: int, *coefficients: Any) -> Series:
        return Series(start, [*coefficients, *[point.field(0)] * (terms - len(coefficients))], terms)

    while True:
        values = {n: series(0, v) if v != 0 else Series(_NEVER, [], terms) for n, v in point.values.items()}
        start, coefficients = point.laplace
        try:
            run = planned.run(wanted, values, series(start, *coefficients), series(0, point.field(1)))
            if all(map(known, run.values())):
                return run
        except _TooFew:
            pass
        if terms >= _LAST:
            raise NumericalError(
                f"a response of this graph hangs on more than the first {_LAST} terms of its expansion",
                remedy="Ask for fewer stages, or for its zeros and poles instead.",
            )
        terms *= 4


def as_float(value: Any) -> float:
    """Return an exact number rounded, infinite where doubles end."""
    try:
        return int(value.p) / int(value.q)
    except OverflowError:
        return math.copysign(math.inf, 1 if value > 0 else -1)
