"""Laurent series with a few leading terms: orders and leading coefficients at 0, infinity, j omega.

Which terms vanish is decided modulo a large prime, where numbers do not grow; what the others are is known
in balls, as wide as the rounding errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from dynid.bondgraph.program.factored import axis_point
from dynid.bondgraph.reduced_graph import GraphProgram, ReducedGraph
from dynid.errors import NumericalError

#: First and last number of terms that are carried before giving up.
_FIRST_TERMS, _LAST_TERMS = 1, 256
#: Bits of the balls, until they say all of the first term that a double can.
SERIES_PRECISIONS = (128, 1024, 8192, 65536)
MIN_SERIES_BITS = 100
_NO_END = 1 << 60


class _TooFew(ArithmeticError):
    """All terms that were carried cancelled."""


class LaurentSeries:
    """coefficients[0] t^start + coefficients[1] t^(start+1) + …, the first nonzero.

    `start`: the lowest power; without coefficients all that is known is that no power below occurs.
    `coefficients`: numbers that know whether they are zero (`_CertifiedNumber`, or flint `nmod`). `terms`:
    most coefficients that are kept.
    """

    __slots__ = ("coefficients", "start", "terms")

    def __init__(self, start: int, coefficients: list[Any], terms: int) -> None:
        leading = next((k for k, c in enumerate(coefficients) if c), len(coefficients))
        self.start, self.coefficients, self.terms = start + leading, coefficients[leading:], terms

    def __add__(self, other: LaurentSeries) -> LaurentSeries:
        earlier, later = (self, other) if self.start <= other.start else (other, self)
        end = min(earlier._end, later._end, earlier.start + self.terms)
        total = earlier.coefficients[: end - earlier.start]
        for index, c in zip(range(later.start - earlier.start, len(total)), later.coefficients, strict=False):
            total[index] = total[index] + c
        return LaurentSeries(earlier.start if total else end, total, self.terms)

    def __neg__(self) -> LaurentSeries:
        return LaurentSeries(self.start, [-c for c in self.coefficients], self.terms)

    def __sub__(self, other: LaurentSeries) -> LaurentSeries:
        return self + (-other)

    def __mul__(self, other: LaurentSeries | int) -> LaurentSeries:
        if isinstance(other, int):
            if other == 0:
                return LaurentSeries(_NO_END, [], self.terms)
            return LaurentSeries(self.start, [c * other for c in self.coefficients], self.terms)
        a, b = self.coefficients, other.coefficients
        size = min(len(a), len(b))
        return LaurentSeries(
            self.start + other.start,
            [sum((a[i] * b[k - i] for i in range(1, k + 1)), a[0] * b[k]) for k in range(size)],
            self.terms,
        )

    def __truediv__(self, other: LaurentSeries) -> LaurentSeries:
        if not other.coefficients:
            raise _TooFew
        a, b = self.coefficients, other.coefficients
        quotient: list[Any] = []
        for k in range(min(len(a), len(b))):
            quotient.append(sum((-quotient[i] * b[k - i] for i in range(k)), a[k]) / b[0])
        return LaurentSeries(self.start - other.start, quotient, self.terms)

    @property
    def _end(self) -> int:
        """The first power that is not known."""
        return _NO_END if self.start >= _NO_END else self.start + len(self.coefficients)


class _CertifiedNumber:
    """A number known twice: modulo a large prime, where it vanishes only if it is zero, and in a ball."""

    __slots__ = ("ball", "residue")

    def __init__(self, residue: Any, ball: Any) -> None:
        self.residue, self.ball = residue, ball

    def __bool__(self) -> bool:
        return bool(self.residue)

    def __add__(self, other: _CertifiedNumber) -> _CertifiedNumber:
        return _CertifiedNumber(self.residue + other.residue, self.ball + other.ball)

    def __mul__(self, other: _CertifiedNumber | int) -> _CertifiedNumber:
        if isinstance(other, int):
            return _CertifiedNumber(self.residue * other, self.ball * other)
        return _CertifiedNumber(self.residue * other.residue, self.ball * other.ball)

    def __truediv__(self, other: _CertifiedNumber) -> _CertifiedNumber:
        return _CertifiedNumber(self.residue / other.residue, self.ball / other.ball)

    def __neg__(self) -> _CertifiedNumber:
        return _CertifiedNumber(-self.residue, -self.ball)

    def __float__(self) -> float:
        return float(self.ball.mid())

    @property
    def is_sharp(self) -> bool:
        """True where the ball determines the nearest double."""
        return bool(self.ball.rel_accuracy_bits() > MIN_SERIES_BITS)


class _Point(NamedTuple):
    """A point of expansion: a field, the values of the nodes in it, power and coefficients of s there."""

    field: Callable[[int], Any]
    values: Mapping[str, Any]
    laplace: tuple[int, list[Any]]


def _residues(planned: GraphProgram, power: int) -> _Point:
    """Return the expansion at 0 in t, s = t^power, modulo a large prime."""
    at = planned.modulo()
    return _Point(at.residue, at.values, (power, [at.residue(1)]))


def _certain(planned: GraphProgram, power: int) -> _Point:
    """Return the same expansion in numbers that are known in balls of the working precision as well."""
    from flint import arb, fmpq

    field, residues, _ = _residues(planned, power)
    values = {
        name: _CertifiedNumber(residues[name], arb(fmpq(value.numerator, value.denominator)))
        for name, value in planned.exact.items()
    }

    def certain(number: int) -> _CertifiedNumber:
        return _CertifiedNumber(field(number), arb(number))

    return _Point(certain, values, (power, [certain(1)]))


def _sharp(
    planned: GraphProgram,
    registers: Iterable[int],
    power: int,
    is_known: Callable[[LaurentSeries], bool],
    precisions: Sequence[int] = SERIES_PRECISIONS,
) -> dict[int, LaurentSeries]:
    """Return the series of registers in t, s = t^power, with as many bits as their first terms take."""
    from flint import ctx

    requested = list(registers)
    _, terms = _expanded(planned, requested, _residues(planned, power), is_known)
    for precision in precisions:
        with ctx.workprec(precision):
            run, _ = _expanded(planned, requested, _certain(planned, power), is_known, terms)
        if all(series.coefficients[0].is_sharp for series in run.values() if series.coefficients):
            return run
    raise lost_to_round_off(precisions[-1])


def lost_to_round_off(bits: int = SERIES_PRECISIONS[-1]) -> NumericalError:
    """Return the error for a first term that no working precision gives."""
    return NumericalError(
        f"a response of this graph at rest or for fast inputs is lost to round-off at {bits} bits",
        remedy="Ask for fewer stages, or for its zeros and poles instead.",
    )


def leading_terms(
    reduced: ReducedGraph, registers: Iterable[int], *, at_infinity: bool
) -> dict[int, tuple[int, float]]:
    """Return the leading terms of registers that do not vanish: (k, c) for c s^k at s = 0 or infinity."""
    sign = -1 if at_infinity else 1
    run = _sharp(reduced, registers, sign, lambda series: bool(series.coefficients))
    leading = {register: float(series.coefficients[0]) for register, series in run.items()}
    return {register: (sign * run[register].start, size) for register, size in leading.items()}


def limits_at_rest(
    planned: GraphProgram, registers: Iterable[int], precisions: Sequence[int] = SERIES_PRECISIONS
) -> dict[int, float]:
    """Return the limits of registers as s goes to 0, rounded; infinite at a pole.

    `registers`: what to evaluate; they may vanish. Raises `NumericalError` where they are not enough.
    """
    run = _sharp(planned, registers, 1, _knows_its_limit, precisions)
    limits = {}
    for register, series in run.items():
        if series.start < 0:
            limits[register] = math.inf
        else:
            limits[register] = float(series.coefficients[0]) if series.start == 0 else 0.0
    return limits


def orders_on_axis(planned: GraphProgram, registers: Iterable[int], omega: Fraction) -> dict[int, int]:
    """Return the orders of registers at s = j omega: -k at a pole, k at a zero of order k, 0 elsewhere.

    They are expanded modulo a large prime, in which orders are the same but for accidents.

    `registers`: what to expand; of those that vanish any positive order is returned. `omega`: the frequency,
    rad/s.
    """
    at = axis_point(planned.exact, omega, planned.field)
    point = _Point(at.residue, at.values, (0, [at.laplace, at.residue(1)]))
    run, _ = _expanded(planned, registers, point, _knows_its_limit)
    return {register: series.start for register, series in run.items()}


def _knows_its_limit(series: LaurentSeries) -> bool:
    return bool(series.coefficients) or series.start > 0


def _expanded(
    planned: GraphProgram,
    registers: Iterable[int],
    point: _Point,
    is_known: Callable[[LaurentSeries], bool],
    terms: int = _FIRST_TERMS,
) -> tuple[dict[int, LaurentSeries], int]:
    """Return the series of registers, with as many terms as it takes to know them, and how many that is."""
    requested = list(registers)

    def series(start: int, *coefficients: Any) -> LaurentSeries:
        return LaurentSeries(start, [*coefficients, *[point.field(0)] * (terms - len(coefficients))], terms)

    while True:
        nothing = LaurentSeries(_NO_END, [], terms)
        values = {name: series(0, value) if value else nothing for name, value in point.values.items()}
        start, coefficients = point.laplace
        try:
            run = planned.run(requested, values, series(start, *coefficients), series(0, point.field(1)))
            if all(map(is_known, run.values())):
                return run, terms
        except _TooFew:
            pass
        if terms >= _LAST_TERMS:
            raise NumericalError(
                f"a response of this graph depends on more than the first {_LAST_TERMS} terms of "
                "its expansion",
                remedy="Ask for fewer stages, or for its zeros and poles instead.",
            )
        terms *= 4
