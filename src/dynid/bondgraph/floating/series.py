"""Laurent series with a few exact leading terms: how a transfer function begins at 0 and at infinity."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from dynid.bondgraph.reduced import ReducedGraph

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
        Exact numbers (flint `fmpq`).
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
    from flint import fmpq

    registers, terms = list(registers), _FIRST
    exact = {name: reduced.graph.value(name) for name in reduced.valued}
    numbers = {name: fmpq(value.numerator, value.denominator) for name, value in exact.items()}
    while True:
        pad = [fmpq(0)] * (terms - 1)
        values = {
            name: Series(0, [number, *pad], terms) if number != 0 else Series(_NEVER, [], terms)
            for name, number in numbers.items()
        }
        one = Series(0, [fmpq(1), *pad], terms)
        s = Series(-1 if at_infinity else 1, [fmpq(1), *pad], terms)
        try:
            run = reduced.run(registers, values, s, one)
            if not all(run[register].coefficients for register in registers):
                raise _TooFew
        except _TooFew:
            if terms >= _LAST:
                raise
            terms *= 4
            continue
        sign = -1 if at_infinity else 1
        return {
            register: (sign * run[register].start, run[register].coefficients[0]) for register in registers
        }
