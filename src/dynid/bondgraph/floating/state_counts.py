"""Polynomials, counts and first values of the roots of a graph on loops, from its exact state equations.

On loops a program of rational functions fills, and so does the index reduction of the equations that hold
an output at zero. The state equations stay sparse: their matrix has the natural polynomial, and with the
feedback -b c the numerator of a channel (the matrix determinant lemma), over the rationals or modulo a prime.
With the exact degree of that an orthogonal staircase takes what lies at infinity off the rounded matrices,
and leaves the zeros as eigenvalues (Emami-Naeini and Van Dooren 1982).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.descriptor import Descriptor, LinearForm, NumberField, solve
from dynid.bondgraph.floating.roots import RootCounts
from dynid.bondgraph.floating.series import MIN_SERIES_BITS, SERIES_PRECISIONS, lost_to_round_off
from dynid.bondgraph.graph import Port
from dynid.defaults import MANY_LOOPS

if TYPE_CHECKING:
    from dynid.bondgraph.reduced_graph import ReducedGraph


# Last step of a refinement, relative to the solution: two steps more than doubles hold, each of which gains
# this factor at least. A sum that is a smaller part of its terms has cancelled.
_SETTLED, _CONTRACTED, _CANCELLED = 1e-24, 1e-3, 1e-6


class StateCounts:
    """The exact state equations of the part behind an output, rounded and modulo a prime."""

    def __init__(
        self, rates: dict[str, LinearForm], output: LinearForm, inputs: Sequence[str], prime: int
    ) -> None:
        self._prime, self._size = prime, len(rates)
        self._rows, self._output = list(rates.values()), output
        self._column = {("w", name): column for column, name in enumerate(rates)}
        self._inputs = inputs
        self._natural: dict[type, Any] = {}  # polynomials by the type of their coefficients

    @classmethod
    def of_outputs(cls, reduced: ReducedGraph) -> dict[Port, Self]:
        """Return those of all outputs of a graph on many loops; none where one lacks them."""
        if reduced.structure.loops <= MANY_LOOPS.value:
            return {}
        states = {port: cls.of(reduced, port) for port in reduced.outputs}
        complete = {port: equations for port, equations in states.items() if equations is not None}
        return complete if len(complete) == len(states) else {}

    @classmethod
    def of(cls, reduced: ReducedGraph, port: Port) -> Self | None:
        """Return those of a port; None where it integrates, or derivatives of an input enter."""
        if reduced.field is not None or reduced.graph.integrates(port):
            return None
        field = NumberField.rational(reduced.graph)
        system = Descriptor(
            reduced.structure, reduced.reductions[port].junctions, field, inputs=reduced.inputs
        )
        output = system.output(port)
        rates, (form,) = solve(system.equations, [output])
        if any(len(symbol) == 3 and symbol[2] for row in (*rates.values(), form) for symbol in row):
            return None
        return cls(rates, form, reduced.inputs, reduced.modulo().prime)

    def _sparse(self, source: str) -> tuple[list[dict[int, Any]], list[Any], dict[int, Any], Any]:
        """Return A by rows, b, c and d of a channel in balls of the working precision."""
        from flint import arb

        drive = ("u", source, 0)
        c: dict[int, Any] = {}
        A: list[dict[int, Any]] = [{} for _ in self._rows]
        b = [arb(form[drive]) if drive in form else arb(0) for form in self._rows]
        for row, form in zip([*A, c], [*self._rows, self._output], strict=True):
            row |= {self._column[symbol]: arb(value) for symbol, value in form.items() if len(symbol) == 2}
        return A, b, c, arb(self._output[drive]) if drive in self._output else arb(0)

    def leading_at_infinity(self, source: str, power: int) -> float:
        """Return d, or ``c A^(k-1) b``, of a channel that falls with s^-k, k = `power`, known exactly."""
        from flint import arb, ctx

        for precision in SERIES_PRECISIONS:
            with ctx.workprec(precision):
                A, x, c, value = self._sparse(source)
                for _ in range(power - 1):
                    x = _product(A, x)
                if power:
                    value = sum((factor * x[k] for k, factor in c.items()), arb(0))
                if value.rel_accuracy_bits() > MIN_SERIES_BITS:
                    return float(value)
        raise lost_to_round_off()

    def leading_at_rest(self, source: str, power: int) -> float | None:
        """Return d - ``c A^-1 b``, or - ``c A^-(k+1) b`` of a channel that rises with s^k, k = `power`.

        A is regular. Solutions by rounded factors are refined to twice their digits and more. None where the
        refinement stalls, or the terms of the sum cancel.
        """
        from flint import arb, ctx
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        with ctx.workprec(SERIES_PRECISIONS[0]):
            A, x, c, value = self._sparse(source)
            rows, columns, entries = zip(
                *((i, k, float(a)) for i, row in enumerate(A) for k, a in row.items()), strict=True
            )
            try:
                factors = splu(csc_array((entries, (rows, columns)), shape=(self._size, self._size)))
            except RuntimeError:  # singular to rounding
                return None
            for _ in range(power + 1):
                solution, residual, size = [arb(0)] * self._size, x, np.inf
                while size > _SETTLED:
                    step = factors.solve(np.array([float(part) for part in residual]))
                    solution = [part + arb(float(more)) for part, more in zip(solution, step, strict=True)]
                    largest = max(abs(float(part)) for part in solution)
                    before, size = size, float(np.abs(step).max()) / largest if largest else 0.0
                    if not size < _CONTRACTED * before:
                        return None
                    moved = _product(A, solution)
                    residual = [(part - force).mid() for part, force in zip(x, moved, strict=True)]
                x = [part.mid() for part in solution]
            terms = [value if power == 0 else arb(0), *(-factor * x[k] for k, factor in c.items())]
            limit = float(sum(terms, arb(0)))
            return limit if abs(limit) > _CANCELLED * sum(abs(float(term)) for term in terms) else None

    def _dense(self, number: Any, zero: Any, source: str) -> tuple[Any, list[Any], list[Any], Any]:
        """Return A as a list of rows, b, c and d of a channel, in some numbers."""
        drive = ("u", source, 0)
        A = [[zero] * self._size for _ in self._rows]
        b, c = [zero] * self._size, [zero] * self._size
        for row, form in enumerate(self._rows):
            for symbol, value in form.items():
                if symbol == drive:
                    b[row] = number(value)
                elif len(symbol) == 2:
                    A[row][self._column[symbol]] = number(value)
        for symbol, value in self._output.items():
            if len(symbol) == 2:
                c[self._column[symbol]] = number(value)
        return A, b, c, number(self._output[drive]) if drive in self._output else zero

    def _polynomials(
        self, number: Callable[[Any], Any], zero: Any, matrix: Callable[[list[Any]], Any], source: str
    ) -> tuple[Any, Any]:
        """Return a channel's numerator, with what it hides, and the natural polynomial, in some numbers."""
        A, b, c, d = self._dense(number, zero, source)
        natural = self._natural.get(type(d)) or matrix([x for row in A for x in row]).charpoly()
        self._natural[type(d)] = natural
        fed = [x - b[i] * y if b[i] else x for i, row in enumerate(A) for x, y in zip(row, c, strict=True)]
        return matrix(fed).charpoly() - natural + natural * d, natural

    def counts(self, source: str) -> tuple[RootCounts, RootCounts]:
        """Return the counts of a channel's numerator, with what it hides, and of the natural modes.

        Raises `ZeroDivisionError` where the prime divides a denominator.
        """
        from flint import nmod, nmod_mat

        prime = self._prime
        above, natural = self._polynomials(
            lambda value: nmod(int(value.p), prime) / int(value.q),
            nmod(0, prime),
            lambda entries: nmod_mat(self._size, self._size, entries, prime),
            source,
        )
        return RootCounts(above), RootCounts(natural)

    def exact(self, source: str) -> tuple[Any, Any]:
        """Return the same two polynomials over the rationals (flint `fmpq_poly`)."""
        from flint import fmpq, fmpq_mat

        return self._polynomials(
            fmpq, fmpq(0), lambda entries: fmpq_mat(self._size, self._size, entries), source
        )

    def zeros(self, source: str, count: int) -> ComplexArray:
        """Return first values of the zeros of a channel, hidden modes among them: that many, as is known.

        They are not finite where the channel is so weak that it leaves the range of doubles.
        """
        from scipy.linalg import matrix_balance

        A, b, c, d = (
            np.array(part) for part in self._dense(lambda value: int(value.p) / int(value.q), 0.0, source)
        )
        with np.errstate(all="ignore"):
            A, (scale, _) = matrix_balance(A, permute=False, separate=True)
            b, c = b / scale, c * scale
            for _ in range(self._size - count):
                A, b, c, d = _without_last(A, b, c)
            A = A - np.outer(b, c) / d
        if not np.isfinite(A).all():
            return np.full(count, np.nan, dtype=complex)
        return np.linalg.eigvals(A).astype(np.complex128)


def _product(A: list[dict[int, Any]], x: list[Any]) -> list[Any]:
    """Return A x in balls."""
    from flint import arb

    return [sum((value * x[k] for k, value in row.items() if x[k]), arb(0)) for row in A]


def _without_last(A: Array, b: Array, c: Array) -> tuple[Array, Array, Array, Any]:
    """Turn the states so that the output is the last one, and hold it at zero: its rate is the new output."""
    mirror = c / np.linalg.norm(c)
    mirror[-1] += np.copysign(1.0, mirror[-1])
    mirror /= np.linalg.norm(mirror)
    A = A - 2 * np.outer(mirror, mirror @ A)
    A = A - 2 * np.outer(A @ mirror, mirror)
    b = b - 2 * mirror * (mirror @ b)
    return A[:-1, :-1], b[:-1], A[-1, :-1], b[-1]
