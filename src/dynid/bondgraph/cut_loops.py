"""Feedback loops cut open: their exact open-loop transfer functions, and what they say of stability.

With all loops cut, y = G u of the driven sources u; closed, u_j = r_j - K_j(s) exp(-s τ_j) y_j. The
characteristic function det(I + G K exp(-s τ)) is a sum of minors, a polynomial over one denominator for every
set of loops with delays: exact, whatever the delays are. Loop i, the others closed, has
1 + L_i = det(I + …) / det(I + …, loop i cut).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property, reduce
from itertools import combinations
from math import lcm
from operator import or_
from typing import TYPE_CHECKING, Any

from dynid.arithmetic.ldl import reference
from dynid.arithmetic.numbers import coded
from dynid.arithmetic.numbers import rounded as rounded_number
from dynid.bondgraph.controller_circuits import Loop, pade
from dynid.bondgraph.graph import TWO_PORTS, VALUED, BondGraph
from dynid.bondgraph.reduced_graph import (
    ReducedGraph,
    characteristic_polynomials,
    parts_without_output,
    separate_parts,
)
from dynid.errors import Singular
from dynid.lti.axis_boxes import Work
from dynid.lti.certified_roots import certified_roots
from dynid.lti.delay_stability import COUNT, stability
from dynid.lti.quasi_polynomials import Delay, QuasiPolynomial, common_factor, coprime
from dynid.lti.stability import Verdict, combined, no_solution, verdict

if TYPE_CHECKING:
    from dynid.arithmetic.real_field import RealField
    from dynid.lti.margins import Margins

#: Ratios of delays that are fractions of small numbers but for the rounding of irrational ones (320 bits).
_RATIO_DENOMINATOR, _RATIO_ROUNDING = 1000, Fraction(1, 2**300)
#: Rows up to which a determinant is expanded: 3! products cost less than 5 exact divisions.
_EXPANDED_ROWS = 3
#: Delays up to which all minors are formed: 2^4 of them cost less than polynomials in the delays.
_MAX_MINORS = 4


def _polynomial_over(field: RealField | None, coefficients: list[Any]) -> Any:
    """Return a polynomial over the integers (flint `fmpz_poly`), or over a field, coefficients ascending."""
    from flint import fmpz_poly

    if field is None:
        return fmpz_poly(coefficients)
    from dynid.arithmetic.field_polynomials import polynomial

    return polynomial(field, coefficients)


class CutLoops:
    """The loops of a graph, all cut open.

    Raises `Singular` where the graph without feedback has no unique solution.
    """

    def __init__(self, opened: BondGraph, loops: Sequence[Loop]) -> None:
        self.loops = tuple(loops)
        sources = list(dict.fromkeys(loop.source for loop in loops))
        measured = list(dict.fromkeys(loop.measured for loop in loops))
        coefficients = [c for loop in loops for c in (*loop.numerator, *loop.denominator)]
        opened = opened.over(map(reference, coefficients))
        reduced = ReducedGraph(opened, sources, measured, traced=False)
        channels = reduced.channels()
        ratios = reduced.rational(channels.values())
        plant = {channel: ratios[register].lowest_terms() for channel, register in channels.items()}
        self._ratios = plant
        common = _polynomial_over(opened.field, [1])
        for _, below in plant.values():
            common = common * (below // common.gcd(below))
        self._common = common
        numerators = {channel: above * (common // below) for channel, (above, below) in plant.items()}
        self._plant = [[numerators[row.measured, column.source] for column in loops] for row in loops]
        #: What counts of roots may still cost.
        self.work = Work(COUNT)
        self.reduced, self.natural = reduced, characteristic_polynomials(reduced)
        self._controllers = [controller(loop, opened.field) for loop in loops]
        self._by_source = len(sources) <= len(measured)
        groups: dict[Any, list[int]] = {}
        for number, loop in enumerate(loops):
            groups.setdefault(loop.source if self._by_source else loop.measured, []).append(number)
        #: The product of the denominators of the loops of each group, and their numerators over it.
        self._groups: list[tuple[Any, list[tuple[int, Any]]]] = []
        for group in groups.values():
            parts = [(loop, *self._controllers[loop]) for loop in group]
            denominator = math.prod((below for _, _, below in parts), start=0 * common + 1)
            over = [(loop, above * (denominator // below)) for loop, above, below in parts]
            self._groups.append((denominator, over))
        self._delays = in_proportion([rounded_number(reference(loop.delay)) for loop in loops])
        # Margins, loci and verdicts ask for the same few again and again.
        self._minors, self._functions = dict[frozenset[int], Any](), dict[tuple[int, ...], QuasiPolynomial]()

    def function(self, kept: Sequence[int]) -> QuasiPolynomial:
        """Return the characteristic function with some loops closed, over one denominator for all sets."""
        key = tuple(kept)
        if key not in self._functions:
            self._functions[key] = self._function(key)
        return self._functions[key]

    def _function(self, kept: Sequence[int]) -> QuasiPolynomial:
        if sum(map(bool, self._delays)) > _MAX_MINORS and self.reduced.field is None:
            return self._determinant_in_delays(frozenset(kept))
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
                    (-1) ** (len(chosen) - len(subset)) * minors[subset]
                    for count in range(len(chosen) + 1)
                    for subset in combinations(chosen, count)
                ),
                0 * self._common,
            )
        return QuasiPolynomial(products)

    def _determinant_in_delays(self, kept: frozenset[int]) -> QuasiPolynomial:
        """Return the characteristic function as one determinant over s and a variable for each delay.

        Every row has a denominator of its own, whatever is kept: that of all has a degree without need.
        """
        from flint import Ordering, fmpz_mpoly_ctx, fmpz_poly

        late = [loop for loop, delay in enumerate(self._delays) if delay]
        names = ["s", *(f"q{loop}" for loop in late)]
        ring = fmpz_mpoly_ctx.get(names, Ordering.lex)
        variables = dict(zip(late, ring.gens()[1:], strict=True))
        unity, padding = ring.constant(1), (0,) * len(late)

        def lifted(polynomial: Any) -> Any:
            return ring.from_dict({(k, *padding): int(c) for k, c in enumerate(polynomial.coeffs()) if c})

        first = [parts[0][0] for _, parts in self._groups]
        matrix = []
        for i, (denominator, parts) in enumerate(self._groups):
            entries = {
                (loop, k): self._ratio(*((loop, k) if self._by_source else (k, loop)))
                for loop, _ in parts
                for k in first
            }
            common = fmpz_poly([1])
            for _, below in entries.values():
                common *= below // common.gcd(below)
            row = []
            for j, k in enumerate(first):
                entry = lifted(common * denominator) if i == j else 0 * unity
                for loop, above in parts:
                    top, below = entries[loop, k]
                    if loop in kept and top != 0:
                        entry += lifted(top * (common // below) * above) * variables.get(loop, unity)
                row.append(entry)
            matrix.append(row)
        products: dict[frozenset[Delay], dict[int, int]] = {}
        for (power, *exponents), coefficient in _determinant(matrix, unity).to_dict().items():
            loops = (loop for loop, exponent in zip(late, exponents, strict=True) if exponent)
            key = frozenset(Delay(self._delays[loop], loop) for loop in loops)
            products.setdefault(key, {})[power] = int(coefficient)
        return QuasiPolynomial(
            {
                key: fmpz_poly([powers.get(k, 0) for k in range(max(powers) + 1)])
                for key, powers in products.items()
            }
        )

    def _ratio(self, measured: int, driven: int) -> tuple[Any, Any]:
        """Return what the source of a loop does to what a loop measures: numerator and denominator."""
        return self._ratios[self.loops[measured].measured, self.loops[driven].source]

    def loop(self, number: int) -> tuple[QuasiPolynomial, QuasiPolynomial]:
        """Return L of one loop, the others closed: numerator and denominator without a common factor.

        Of a feed-forward, whose source does not act on what is measured, L is 0/1.
        """
        all_loops = range(len(self.loops))
        below = self.function([loop for loop in all_loops if loop != number])
        above = self.function(all_loops) - below
        if not above.terms:
            return above, QuasiPolynomial({Fraction(0): 0 * self._common + 1})
        if self.reduced.field is None:
            return coprime(above, below)
        shared = common_factor([above, below])
        return above.over(shared), below.over(shared)

    def margins(self, above: QuasiPolynomial, below: QuasiPolynomial) -> Margins:
        """Return the margins of a loop from its L, the others closed (`loop`)."""
        from dynid.lti.delay_margins import SEARCH, delay_margins
        from dynid.lti.margins import margins

        if above.is_rational and below.is_rational:
            (bottom,) = below.terms.values()
            return margins(above.terms.get(Fraction(0), 0 * bottom), bottom)
        above, below = rounded([above, below])
        closed = above + below
        alike = closed.products == rounded([self.closed])[0].products
        verdict = self.shown if alike else stability(self.paired(closed), self.work)
        return delay_margins(above, below, verdict, SEARCH // len(self.loops))

    @cached_property
    def closed(self) -> QuasiPolynomial:
        """The characteristic function of all loops, without the roots that no loop shows."""
        function = self.function(range(len(self.loops)))
        return function.over(common_factor([function, self.function([])]))

    def hidden(self) -> Any:
        """Return the polynomial of the natural modes behind what is measured that no feedback moves."""
        modes = 0 * self._common + 1
        for port_modes in self.natural.values():
            modes = modes * (port_modes // modes.gcd(port_modes))
        return self.unmoved(modes)

    def unmoved(self, modes: Any) -> Any:
        """Return the factor of natural modes, and those of controllers, that no feedback moves."""
        function, opened = self.function(range(len(self.loops))), self.function([])
        (below,) = opened.over(common_factor([function, opened])).terms.values()
        for _, controller_modes in self._controllers:
            modes *= controller_modes
        modes *= _polynomial_over(self.reduced.field, [*[0] * self._measuring_integrals, 1])
        return modes // modes.gcd(below)

    @cached_property
    def _measuring_integrals(self) -> int:
        """The number of integrals that only measurements have, and that their loops act upon and use.

        They put poles at 0 into the loops that are no modes of the graph. An integral of a signal with
        a zero at 0, or one that controllers only differentiate, holds a constant and is not counted.
        """
        graph = self.reduced.graph
        ports = {loop.measured: number for number, loop in enumerate(self.loops)}
        integrals = {
            loop.measured
            for loop, (above, _) in zip(self.loops, self._controllers, strict=True)
            if graph.integrates(loop.measured) and above[0] != 0
        }
        if not integrals:
            return 0
        drives = list({loop.source: number for number, loop in enumerate(self.loops)}.values())
        s, zero = _polynomial_over(self.reduced.field, [0, 1]), 0 * self._common
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
                        (entry * _mixing_gain(k, j) for k, entry in enumerate(row)),
                        self._common if i == j else zero,
                    )
                    for j in range(len(plant))
                ]
                for i, row in enumerate(plant)
            ]
            determinant = _determinant(matrix, zero + 1)
            poles.append(len(plant) * _roots_at_origin(self._common) - _roots_at_origin(determinant))
        return max(poles[0] - max(poles[1], 0), 0)

    @cached_property
    def shown(self) -> Verdict:
        """The verdict on the roots that the loops show."""
        if self.closed.is_rational:
            return verdict(certified_roots(self.closed.terms[Fraction(0)]))
        decided = stability(self.paired(rounded([self.closed])[0]), self.work)
        if decided.kind in ("undecided", "at the limit") and self._passive:
            near = "" if decided.kind == "undecided" else ", but come as near to the axis as one likes"
            reason = f"the system is passive: no poles lie in the right half-plane{near}"
            return Verdict(decided.kind, reason, 0)
        return decided

    @property
    def _passive(self) -> bool:
        """Test whether the graph is of passive elements and lines alone, which make no energy."""
        lines = {loop.line for loop in self.loops}
        elements = (node for node in self.reduced.graph.nodes.values() if node.type in VALUED)
        return all(lines) and all(
            node.type in TWO_PORTS or (node.value is not None and node.value > 0)
            for node in elements
            if node.part not in lines
        )

    def paired(self, function: QuasiPolynomial) -> QuasiPolynomial:
        """Return a function with one delay for both directions of a line, where they only come together."""
        directions: dict[str, list[Delay]] = {}
        for loop, delay in sorted({(d.loop, d) for key in function.products for d in key}):
            if self.loops[loop].line:
                directions.setdefault(self.loops[loop].line, []).append(delay)
        for there, *back in directions.values():
            pair = {there, *back}
            if back and all(len(pair & key) != 1 for key in function.products):
                both = Delay(2 * there.seconds, there.loop)
                function = QuasiPolynomial(
                    {(key - pair) | {both} if pair <= key else key: p for key, p in function.products.items()}
                )
        return function

    def verdict(self) -> Verdict:
        """Return the verdict on loops, controllers and every separate part of the graph."""
        return combined([self.shown, *self.unseen()])

    def unseen(self) -> list[Verdict]:
        """Return the verdicts on modes that no loop moves, if any, and on parts without an output."""
        others = parts_without_output(self.reduced)
        parts = [*separate_parts(self.reduced, self.natural), *(others or ())]
        modes = math.prod(parts, start=_polynomial_over(self.reduced.field, [1]))
        hidden = certified_roots(self.unmoved(modes))
        verdicts = [verdict(hidden)] if hidden else []
        return [*verdicts, *([] if others is not None else [no_solution(self.reduced.free)])]

    def check(self) -> None:
        """Raise where a loop passes through no delay and no storage element, and has no solution.

        Raises `Singular` where 1 + L is zero, or falls to zero at high frequencies; it names the loops.
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
                    names=[location for k in chosen if (location := self.loops[k].place)],
                )

    def _minor(self, kept: Sequence[int]) -> Any:
        """Return det(I + G K) of some loops, times a denominator that is the same for all sets of loops.

        det(I + G K) = det(I + K G): loops that measure, or drive, the same share a row.
        """
        closed, zero = frozenset(kept), 0 * self._common
        if closed not in self._minors:
            first = [parts[0][0] for _, parts in self._groups]  # what a loop and a group drive or measure
            plant = self._plant if self._by_source else list(zip(*self._plant, strict=True))
            matrix = [
                [
                    (self._common * denominator if i == j else zero)
                    + sum((plant[loop][k] * above for loop, above in parts if loop in closed), zero)
                    for j, k in enumerate(first)
                ]
                for i, (denominator, parts) in enumerate(self._groups)
            ]
            self._minors[closed] = _determinant(matrix, zero + 1)
        return self._minors[closed]


def rounded(functions: Sequence[QuasiPolynomial]) -> list[QuasiPolynomial]:
    """Return quasi-polynomials with integer polynomials, all times the same number."""
    from dynid.arithmetic.field_polynomials import integers

    polynomials = [polynomial for function in functions for polynomial in function.products.values()]
    plain = iter(integers(*polynomials, rounded=True))
    return [QuasiPolynomial({loops: next(plain) for loops in function.products}) for function in functions]


def controller(loop: Loop, field: RealField | None = None) -> tuple[Any, Any]:
    """Return numerator and denominator of a controller without its delay, over the integers or a field."""
    from flint import fmpq, fmpz_poly

    parts = [[reference(c) for c in coefficients] for coefficients in (loop.numerator, loop.denominator)]
    if field is not None:
        exact = [[coded(c, field) for c in reversed(coefficients)] for coefficients in parts]
        top, bottom = (_polynomial_over(field, [fmpq(c.numerator, c.denominator) for c in p]) for p in exact)
        return top, bottom
    factor = lcm(*(c.denominator for polynomial in parts for c in polynomial))
    top, bottom = (fmpz_poly([int(c * factor) for c in reversed(polynomial)]) for polynomial in parts)
    return top, bottom


def rational(functions: Sequence[QuasiPolynomial], order: int) -> list[Any]:
    """Return quasi-polynomials over one polynomial, with a Padé approximant for the delay of each loop."""
    from flint import fmpq, fmpq_poly

    products = [product for function in functions for product in function.products]
    counts = [Counter(loop.seconds for loop in product) for product in products]
    approximants = {}
    for delay, largest in reduce(or_, counts, Counter[Fraction]()).items():
        exact = [[Fraction(reference(c)) for c in reversed(part)] for part in pade(delay, order)]
        parts = [[fmpq(c.numerator, c.denominator) for c in coefficients] for coefficients in exact]
        top, bottom = (fmpq_poly(coefficients) for coefficients in parts)
        approximants[delay] = (largest, top, bottom)
    numerators = []
    for function in functions:
        total = fmpq_poly(0)
        for product, polynomial in function.products.items():
            numerator, count = fmpq_poly(polynomial), Counter(loop.seconds for loop in product)
            for delay, (largest, top, bottom) in approximants.items():  # equal delays share a denominator
                numerator *= top ** count[delay] * bottom ** (largest - count[delay])
            total += numerator
        numerators.append(total)
    common = lcm(*(int(total.denom()) for total in numerators))
    return [(total * common).numer() for total in numerators]


def in_proportion(delays: list[Fraction]) -> list[Fraction]:
    """Return delays whose ratios to one another are exact again where rounding moved them."""
    exact = list[Fraction]()
    for delay in delays:
        for earlier in filter(None, exact):
            ratio = (delay / earlier).limit_denominator(_RATIO_DENOMINATOR)
            if abs(delay - ratio * earlier) < delay * _RATIO_ROUNDING:
                exact.append(ratio * earlier)
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


def _expanded(matrix: list[list[Any]], unity: Any) -> Any:
    """Return a determinant by expansion along the first row: no divisions, which cost most over a field."""
    if not matrix:
        return unity
    total = 0 * unity
    for column, factor in enumerate(matrix[0]):
        if factor != 0:
            minor = [[*row[:column], *row[column + 1 :]] for row in matrix[1:]]
            total = total + (-1) ** column * factor * _expanded(minor, unity)
    return total


def _determinant(matrix: list[list[Any]], unity: Any) -> Any:
    """Return the determinant of a matrix of polynomials: expanded, or after Bareiss (1968)."""
    if len(matrix) <= _EXPANDED_ROWS:
        return _expanded(matrix, unity)
    rows, sign, before = [list(row) for row in matrix], 1, unity
    for k in range(len(rows)):
        below = [i for i in range(k, len(rows)) if rows[i][k] != 0]
        pivot = min(below, key=lambda i: len(rows[i][k].coeffs()), default=None)  # the smallest
        if pivot is None:
            return 0 * unity
        if pivot != k:
            rows[k], rows[pivot], sign = rows[pivot], rows[k], -sign
        for i in range(k + 1, len(rows)):
            rows[i] = [
                (rows[i][j] * rows[k][k] - rows[i][k] * rows[k][j]) // before if j > k else 0 * unity
                for j in range(len(rows))
            ]
        before = rows[k][k]
    return sign * before
