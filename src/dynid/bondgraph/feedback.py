"""Feedback loops cut open: their exact open-loop transfer functions, with the delays as they are.

With all loops cut, y = G u of the driven sources u; closed, u_j = r_j - K_j(s) exp(-s τ_j) y_j. The
characteristic function det(I + G K exp(-s τ)) is a sum of minors, a polynomial over one denominator for every
set of loops with delays: exact, whatever the delays are. Loop i, the others closed, has
1 + L_i = det(I + …) / det(I + …, loop i cut).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import cached_property, reduce
from itertools import combinations
from math import lcm
from operator import or_
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import coded
from dynid.arithmetic.numbers import rounded as rounded_number
from dynid.arrays import ComplexArray
from dynid.bondgraph.controller_circuits import PADE_ORDER, Loop, close_loops, pade
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.graph_response import frequency_response
from dynid.bondgraph.reduced_graph import (
    ReducedGraph,
    characteristic_polynomials,
    parts_without_output,
    separate_parts,
)
from dynid.errors import Singular, Undecided
from dynid.lti.axis_boxes import Work
from dynid.lti.certified_roots import certified_roots
from dynid.lti.delay_stability import COUNT
from dynid.lti.delay_stability import stability as delayed_stability
from dynid.lti.quasi_polynomials import Delay, QuasiPolynomial, common_factor, coprime
from dynid.lti.stability import Verdict, combined, no_solution, verdict

if TYPE_CHECKING:
    from dynid.arithmetic.real_field import RealField

#: Condition of I + L above which a pole lies on the axis.
_SINGULAR = 1e12
#: Ratios of delays that are fractions of small numbers but for the rounding of irrational ones (320 bits).
_RATIO_DENOMINATOR, _RATIO_ROUNDING = 1000, Fraction(1, 2**300)
#: Rows up to which a determinant is expanded: 3! products cost less than 5 exact divisions.
_EXPANDED_ROWS = 3


def polynomial_over(field: RealField | None, coefficients: list[Any]) -> Any:
    """Return a polynomial over the integers (flint `fmpz_poly`), or over a field, coefficients ascending."""
    from flint import fmpz_poly

    if field is None:
        return fmpz_poly(coefficients)
    from dynid.arithmetic.field_polynomials import polynomial

    return polynomial(field, coefficients)


class CutLoops:
    """The loops of a graph, all cut open.

    Parameters
    ----------
    opened
        The graph without feedback.
    loops
        The loops.

    Raises
    ------
    Singular
        Where the graph without feedback has no unique solution.
    """

    def __init__(self, opened: BondGraph, loops: Sequence[Loop]) -> None:
        self.loops = tuple(loops)
        sources = list(dict.fromkeys(loop.source for loop in loops))
        measured = list(dict.fromkeys(loop.measured for loop in loops))
        parts = [part for loop in loops for part in (*loop.numerator, *loop.denominator)]
        opened = opened.over(map(reference, parts))
        reduced = ReducedGraph(opened, sources, measured, traced=False)
        channels = reduced.channels()
        ratios = reduced.rational(channels.values())
        plant = {channel: ratios[register].lowest_terms() for channel, register in channels.items()}
        common = polynomial_over(opened.field, [1])
        for _, below in plant.values():
            common = common * (below // common.gcd(below))
        self._common = common
        self._plant = [
            [_scaled(plant[row.measured, column.source], common) for column in loops] for row in loops
        ]
        #: What counts of roots may still cost.
        self.work = Work(COUNT)
        self._reduced, self._natural = reduced, characteristic_polynomials(reduced)
        self._controllers = [controller(loop, opened.field) for loop in loops]
        self._by_source = len(sources) <= len(measured)
        groups: dict[Any, list[int]] = {}
        for number, loop in enumerate(loops):
            groups.setdefault(loop.source if self._by_source else loop.measured, []).append(number)
        #: The product of the denominators of the loops of each group, and their numerators over it.
        self._groups = [self._over_one_denominator(group) for group in groups.values()]
        self._delays = _in_proportion([rounded_number(reference(loop.delay)) for loop in loops])
        # Margins, loci and verdicts ask for the same few again and again.
        self._minors, self._functions = dict[frozenset[int], Any](), dict[tuple[int, ...], QuasiPolynomial]()

    def function(self, kept: Sequence[int]) -> QuasiPolynomial:
        """Return the characteristic function with some loops closed, over one denominator for all sets."""
        key = tuple(kept)
        if key not in self._functions:
            self._functions[key] = self._function(key)
        return self._functions[key]

    def _function(self, kept: Sequence[int]) -> QuasiPolynomial:
        late = [loop for loop in kept if self._delays[loop]]
        prompt = [loop for loop in kept if not self._delays[loop]]
        minors = {
            chosen: self._minor([*prompt, *chosen])
            for count in range(len(late) + 1)
            for chosen in combinations(late, count)
        }
        products = {}
        for chosen in minors:  # what the delays of all of them multiply, by inclusion and exclusion
            loops = frozenset(Delay(self._delays[loop], loop) for loop in chosen)
            products[loops] = sum(
                (
                    (-1) ** (len(chosen) - len(part)) * minors[part]
                    for count in range(len(chosen) + 1)
                    for part in combinations(chosen, count)
                ),
                0 * self._common,
            )
        return QuasiPolynomial(products)

    def loop(self, place: int) -> tuple[QuasiPolynomial, QuasiPolynomial]:
        """Return L of one loop, the others closed: numerator and denominator without a common factor.

        Of a feed-forward, whose source does not act on what is measured, L is 0/1.
        """
        every = range(len(self.loops))
        below = self.function([loop for loop in every if loop != place])
        above = self.function(every) - below
        if not above.terms:
            return above, QuasiPolynomial({Fraction(0): 0 * self._common + 1})
        if self._reduced.field is None:
            return coprime(above, below)
        shared = common_factor([above, below])
        return above.over(shared), below.over(shared)

    @cached_property
    def closed(self) -> QuasiPolynomial:
        """The characteristic function of all loops, without the roots that no loop shows."""
        whole = self.function(range(len(self.loops)))
        return whole.over(common_factor([whole, self.function([])]))

    def hidden(self) -> Any:
        """Return the polynomial of the natural modes behind what is measured that no feedback moves."""
        modes = 0 * self._common + 1
        for own in self._natural.values():
            modes = modes * (own // modes.gcd(own))
        return self._unmoved(modes)

    @cached_property
    def loop_verdict(self) -> Verdict:
        """The verdict on the roots that the loops show."""
        closed = self.closed
        if closed.is_rational:
            return verdict(certified_roots(closed.terms[Fraction(0)]))
        return delayed_stability(rounded([closed])[0], self.work)

    def verdict(self) -> Verdict:
        """Return the verdict on the whole system: loops, controllers and every separate part of the graph."""
        verdicts = [self.loop_verdict]
        others = parts_without_output(self._reduced)
        parts = [*separate_parts(self._reduced, self._natural), *(others or ())]
        hidden = certified_roots(self._unmoved(math.prod(parts, start=0 * self._common + 1)))
        verdicts += [verdict(hidden)] if hidden else []
        return combined([*verdicts, *([] if others is not None else [no_solution(self._reduced.free)])])

    def _unmoved(self, modes: Any) -> Any:
        """Return the factor of natural modes, and those of controllers, that no feedback moves."""
        whole, opened = self.function(range(len(self.loops))), self.function([])
        (below,) = opened.over(common_factor([whole, opened])).terms.values()
        for _, own in self._controllers:
            modes *= own
        modes *= polynomial_over(self._reduced.field, [*[0] * self._measuring_integrals, 1])
        return modes // modes.gcd(below)

    @cached_property
    def _measuring_integrals(self) -> int:
        """The number of integrals that only measurements have, and that their loops act upon and use.

        They put poles at 0 into the loops that are no modes of the graph. An integral of a signal with
        a zero at 0, or one that controllers only differentiate, holds a constant and is not counted.
        """
        graph = self._reduced.graph
        ports = {loop.measured: number for number, loop in enumerate(self.loops)}
        integrals = {
            loop.measured
            for loop, (above, _) in zip(self.loops, self._controllers, strict=True)
            if graph.integrates(loop.measured) and above[0] != 0
        }
        if not integrals:
            return 0
        drives = list({loop.source: number for number, loop in enumerate(self.loops)}.values())
        s, zero = polynomial_over(self._reduced.field, [0, 1]), 0 * self._common
        poles = []
        for behind in (False, True):
            plant = [
                [self._plant[row][column] * (s if behind and port in integrals else 1) for column in drives]
                for port, row in ports.items()
            ]
            # The poles at 0 of a matrix of rational functions are those of det(I + G K) for almost all K.
            matrix = [
                [
                    sum(
                        (part * _mixing_gain(k, j) for k, part in enumerate(row)),
                        self._common if i == j else zero,
                    )
                    for j in range(len(plant))
                ]
                for i, row in enumerate(plant)
            ]
            determinant = _determinant(matrix, zero + 1)
            poles.append(len(plant) * _roots_at_origin(self._common) - _roots_at_origin(determinant))
        return max(poles[0] - max(poles[1], 0), 0)

    def check(self) -> None:
        """Raise where a loop passes through no delay and no storage element, and has no solution.

        Raises
        ------
        Singular
            Where 1 + L is zero, or falls to zero at high frequencies; it names the loops.
        """
        prompt = [loop for loop, delay in enumerate(self._delays) if not delay]
        degree = self._minor([]).degree()
        for chosen in (*([loop] for loop in prompt), prompt):
            if self._minor(chosen).degree() < degree:
                names = [f"'{self.loops[k].measured} -> {self.loops[k].source}'" for k in chosen]
                which = f"the loop {names[0]} is" if len(names) == 1 else f"the loops {', '.join(names)} are"
                raise Singular(
                    f"{which} algebraic and without a solution: 1 + L = 0 at high frequencies",
                    remedy="Change the gain, or add a filter to the controller.",
                    names=[place for k in chosen if (place := self.loops[k].place)],
                )

    def approximants_agree(self, work: Work) -> bool:
        """Return whether the Padé approximants of delays have as many poles to the right as the loops.

        They count as different where their roots cost too much.
        """
        (polynomial,) = rational(rounded([self.closed]), PADE_ORDER)
        try:
            right = sum(root.multiplicity for root in certified_roots(polynomial, work=work) if root.side > 0)
        except Undecided:
            return False
        return self.loop_verdict.unstable_poles == right

    def _over_one_denominator(self, group: list[int]) -> tuple[Any, list[tuple[int, Any]]]:
        parts = [(loop, *self._controllers[loop]) for loop in group]
        whole = math.prod((below for _, _, below in parts), start=0 * self._common + 1)
        return whole, [(loop, above * (whole // below)) for loop, above, below in parts]

    def _minor(self, kept: Sequence[int]) -> Any:
        """Return det(I + G K) of some loops, times a denominator that is the same for all sets of loops.

        det(I + G K) = det(I + K G): loops that measure, or drive, the same share a row.
        """
        closed = frozenset(kept)
        if closed not in self._minors:
            self._minors[closed] = self._determinant_of(closed)
        return self._minors[closed]

    def _determinant_of(self, closed: frozenset[int]) -> Any:
        matrix = [
            [
                (self._common * denominator if i == j else 0 * self._common)
                + sum(
                    (self._plants(loop, j) * part for loop, part in parts if loop in closed), 0 * self._common
                )
                for j in range(len(self._groups))
            ]
            for i, (denominator, parts) in enumerate(self._groups)
        ]
        return _determinant(matrix, 0 * self._common + 1)

    def _plants(self, loop: int, group: int) -> Any:
        """Return what a loop measures of the source of a group, or what a group measures of its source."""
        other = self._groups[group][1][0][0]
        return self._plant[loop][other] if self._by_source else self._plant[other][loop]


def rounded(functions: Sequence[QuasiPolynomial]) -> list[QuasiPolynomial]:
    """Return quasi-polynomials with integer polynomials, all times the same number."""
    from dynid.arithmetic.field_polynomials import integers

    every = [polynomial for function in functions for polynomial in function.products.values()]
    plain = iter(integers(*every, rounded=True))
    return [QuasiPolynomial({loops: next(plain) for loops in function.products}) for function in functions]


def controller(loop: Loop, field: RealField | None = None) -> tuple[Any, Any]:
    """Return numerator and denominator of a controller without its delay, over the integers or a field."""
    from flint import fmpq, fmpz_poly

    parts = [[reference(c) for c in part] for part in (loop.numerator, loop.denominator)]
    if field is not None:
        exact = [[coded(c, field) for c in reversed(part)] for part in parts]
        top, bottom = (polynomial_over(field, [fmpq(c.numerator, c.denominator) for c in p]) for p in exact)
        return top, bottom
    factor = lcm(*(c.denominator for part in parts for c in part))
    top, bottom = (fmpz_poly([int(c * factor) for c in reversed(part)]) for part in parts)
    return top, bottom


def rational(functions: Sequence[QuasiPolynomial], order: int) -> list[Any]:
    """Return quasi-polynomials over one polynomial, with a Padé approximant for the delay of each loop."""
    from flint import fmpq, fmpq_poly

    products = [product for function in functions for product in function.products]
    counts = [Counter(loop.seconds for loop in product) for product in products]
    approximants = {}
    for delay, largest in reduce(or_, counts, Counter[Fraction]()).items():
        exact = [[Fraction(reference(c)) for c in reversed(part)] for part in pade(delay, order)]
        parts = [[fmpq(c.numerator, c.denominator) for c in part] for part in exact]
        top, bottom = (fmpq_poly(part) for part in parts)
        approximants[delay] = (largest, top, bottom)
    found = []
    for function in functions:
        total = fmpq_poly(0)
        for product, polynomial in function.products.items():
            own, count = fmpq_poly(polynomial), Counter(loop.seconds for loop in product)
            for delay, (largest, top, bottom) in approximants.items():  # equal delays share a denominator
                own *= top ** count[delay] * bottom ** (largest - count[delay])
            total += own
        found.append(total)
    common = lcm(*(int(total.denom()) for total in found))
    return [(total * common).numer() for total in found]


def delayed_response(
    opened: BondGraph, loops: Sequence[Loop], inputs: Sequence[str], outputs: Sequence[Port]
) -> Callable[[NDArray[np.float64]], ComplexArray]:
    """Return the frequency response of a graph with feedback, with the delays as they are.

    The response without the delays is certified; the delays turn what is fed back by exp(-jωτ) - 1. Where
    the loops without their delays have a pole on the axis, they are taken open instead.

    Returns
    -------
    callable
        Of angular frequencies in rad/s, it returns the response, shape (omega, output, input).
    """
    closed = close_loops(opened, loops)
    outputs = [closed.variables.get(port, port) for port in outputs]
    approximate = ReducedGraph(closed.graph, inputs, outputs, traced=False)
    bases: dict[bool, Callable[[NDArray[np.float64]], ComplexArray]] = {}

    def evaluate(omega: NDArray[np.float64]) -> ComplexArray:
        response = np.zeros((len(omega), len(outputs), len(inputs)), dtype=complex)
        rest = omega == 0  # there the approximants are exact
        response[rest] = frequency_response(approximate, omega[rest])
        left = np.flatnonzero(~rest)
        for cut in (False, True):
            if cut not in bases and len(left):
                bases[cut] = _turned_response(opened, loops, inputs, outputs, cut=cut)
            if len(left):
                response[left] = bases[cut](omega[left])
                left = left[~np.isfinite(response[left]).all(axis=(1, 2))]
        return response

    return evaluate


def _turned_response(
    opened: BondGraph, loops: Sequence[Loop], inputs: Sequence[str], outputs: Sequence[Port], *, cut: bool
) -> Callable[[NDArray[np.float64]], ComplexArray]:
    """Return the response with delays, from that of the graph whose delayed loops are prompt, or cut."""
    taken = {*opened.nodes, *(name for loop in loops for name in (loop.reference, loop.setpoint)), *inputs}
    late, base = list[tuple[int, str]](), list[Loop]()
    for number, loop in enumerate(loops):
        if not loop.delayed:
            base.append(loop)
            continue
        probe = loop.reference or f"delayed_{number}"
        while probe in taken and not loop.reference:
            probe += "_"
        late.append((number, probe))
        answer = [Fraction(0)] if cut else loop.numerator
        base.append(replace(loop, numerator=answer, delay=Fraction(0), reference=probe))
    closed = close_loops(opened, base)
    measured = [closed.answered[number] for number, _ in late]
    rows = list(dict.fromkeys([*outputs, *measured]))
    columns = list(dict.fromkeys([*inputs, *(probe for _, probe in late)]))
    reduced = ReducedGraph(closed.graph, columns, rows, traced=False)
    shown, own = [rows.index(port) for port in outputs], [rows.index(port) for port in measured]
    driven, fed = [columns.index(name) for name in inputs], [columns.index(probe) for _, probe in late]

    def evaluate(omega: NDArray[np.float64]) -> ComplexArray:
        whole = frequency_response(reduced, omega)
        s = (1j * omega).astype(np.complex128)
        turns = np.stack([_answer(loops[number], s, cut=cut) for number, _ in late], axis=-1)
        with np.errstate(all="ignore"):
            back = whole[:, :, fed] * turns[:, None, :]
            matrix = np.eye(len(late)) + back[:, own]
            response = np.full((len(omega), len(shown), len(driven)), np.inf, dtype=complex)
            finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(whole).all(axis=(1, 2))
            known = np.flatnonzero(finite)
            known = known[np.linalg.cond(matrix[known]) < _SINGULAR]
            solved = np.linalg.solve(matrix[known], whole[known][:, own][:, :, driven])
            response[known] = whole[known][:, shown][:, :, driven] - back[known][:, shown] @ solved
        return response

    return evaluate


def _answer(loop: Loop, s: ComplexArray, *, cut: bool) -> ComplexArray:
    """Return the controller times exp(-s τ), less the controller without its delay unless that is cut."""
    top, bottom = (
        np.polyval([float(reference(c)) for c in p], s) for p in (loop.numerator, loop.denominator)
    )
    turn = -s * float(reference(loop.delay))
    with np.errstate(all="ignore"):
        return np.asarray(top / bottom * (np.exp(turn) if cut else np.expm1(turn)))


def _in_proportion(delays: list[Fraction]) -> list[Fraction]:
    """Return delays whose ratios to one another are exact again where rounding moved them."""
    exact = list[Fraction]()
    for delay in delays:
        for other in filter(None, exact):
            ratio = (delay / other).limit_denominator(_RATIO_DENOMINATOR)
            if abs(delay - ratio * other) < delay * _RATIO_ROUNDING:
                exact.append(ratio * other)
                break
        else:
            exact.append(delay)
    return exact


def _mixing_gain(row: int, column: int) -> int:
    """Return an entry of a fixed matrix of gains without structure: residues of powers modulo a prime."""
    return pow(5, 7919 * row + 104729 * column + 1, 1_000_003)


def _roots_at_origin(polynomial: Any) -> int:
    """Return the multiplicity of the root 0 of a polynomial that is not zero."""
    return next((power for power in range(polynomial.degree() + 1) if polynomial[power] != 0), 0)


def _scaled(ratio: tuple[Any, Any], common: Any) -> Any:
    """Return the numerator of a rational function over a common denominator."""
    return ratio[0] * (common // ratio[1])


def _expanded(matrix: list[list[Any]], one: Any) -> Any:
    """Return a determinant by expansion along the first row: no divisions, which cost most over a field."""
    if not matrix:
        return one
    total = 0 * one
    for column, factor in enumerate(matrix[0]):
        if factor != 0:
            minor = [[*row[:column], *row[column + 1 :]] for row in matrix[1:]]
            total = total + (-1) ** column * factor * _expanded(minor, one)
    return total


def _determinant(matrix: list[list[Any]], one: Any) -> Any:
    """Return the determinant of a matrix of polynomials: expanded, or after Bareiss (1968)."""
    if len(matrix) <= _EXPANDED_ROWS:
        return _expanded(matrix, one)
    rows, sign, before = [list(row) for row in matrix], 1, one
    for k in range(len(rows)):
        pivot = next((i for i in range(k, len(rows)) if rows[i][k] != 0), None)
        if pivot is None:
            return 0 * one
        if pivot != k:
            rows[k], rows[pivot], sign = rows[pivot], rows[k], -sign
        for i in range(k + 1, len(rows)):
            rows[i] = [
                (rows[i][j] * rows[k][k] - rows[i][k] * rows[k][j]) // before if j > k else 0 * one
                for j in range(len(rows))
            ]
        before = rows[k][k]
    return sign * before
