"""Formulas in lowest terms: a formula in which something cancels is written anew, in factors.

Names of intermediate results, parameters and s are the variables of integer polynomials; a value that is no
rational function of the parameters is a variable of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from fractions import Fraction
from functools import reduce
from itertools import combinations
from typing import Any, NamedTuple

from dynid.bondgraph.formula_printers import FormulaPrinter, Printed
from dynid.bondgraph.graph import Node
from dynid.bondgraph.program.program import Operation, Program, Register, operands

#: Most terms of a polynomial; a formula that outgrows it is written as it stands.
_MAX_POLYNOMIAL_TERMS = 2000


class _ReducedQuotient(NamedTuple):
    """A quotient of polynomials in lowest terms, and whether something was cancelled on the way to it."""

    above: Any
    below: Any
    cancelled: bool = False


class RegisterExpression(NamedTuple):
    """The registers of a formula."""

    order: tuple[Register, ...]  # its registers, operands first, itself last
    named: Mapping[Register, str]  # those that are written by a name


def independent(
    program: Program, expressions: Iterable[RegisterExpression], nodes: Mapping[str, Node]
) -> bool:
    """Test whether expressions have every variable once, so that nothing in them can cancel."""
    variables: list[str] = []
    constants = 0  # in sums: 1 and 1 are 2
    for order, named in expressions:
        spelled = [program.ops[register] for register in order if register not in named]
        read = [r for op in spelled for r in operands(*op) if program.ops[r][0] is not Operation.CONSTANT]
        summed = [r for op in spelled if op[0] in (Operation.ADD, Operation.SUB) for r in operands(*op)]
        for register in [*summed, order[-1]]:
            op, inner, _ = program.ops[register]
            constants += (program.ops[inner][0] if op is Operation.NEG else op) is Operation.CONSTANT
        if len(read) != len(set(read)) or constants > 1:
            return False
        variables += named.values()
        for op, name, _ in spelled:
            variables += (
                _names(nodes[str(name)])
                if op is Operation.PARAMETER
                else ["s"]
                if op is Operation.LAPLACE
                else []
            )
    return len(variables) == len(set(variables))


def _names(node: Node) -> list[str]:
    """Return the parameters that a value is written in, each as often as it stands there."""
    if node.formula is None or not node.formula.names:
        return [node.name]

    def leaf(item: Fraction | str) -> list[str]:
        return [item] if isinstance(item, str) else []

    names: list[str] = node.formula.fold(
        leaf, lambda _, parts: [name for names_of_operand in parts for name in names_of_operand]
    )
    return names


class FormulaRing:
    """The polynomials that expressions are made of."""

    def __init__(
        self, program: Program, expressions: Iterable[RegisterExpression], nodes: Mapping[str, Node]
    ) -> None:
        from flint import fmpz_mpoly_ctx

        self._program, self._nodes = program, nodes
        names: dict[tuple[str, str], None] = {("s", ""): None}
        for order, named in expressions:
            names |= dict.fromkeys(("label", label) for label in named.values())
            for op, name, _ in (program.ops[register] for register in order if register not in named):
                if op is Operation.PARAMETER:
                    names["value", name] = None
                    names |= dict.fromkeys(("name", symbol) for symbol in _names(nodes[name]))
        self._keys = list(names)
        self._ring = fmpz_mpoly_ctx.get([f"x{index}" for index in range(len(names))], "lex")
        self.one = self._ring.constant(1)
        self._gens = dict(zip(names, self._ring.gens(), strict=True))

    def part(self, expression: RegisterExpression) -> _ReducedQuotient:
        """Return an expression as a quotient.

        Raises `OverflowError` where it has too many terms, or divides by zero.
        """
        quotients: dict[Register, _ReducedQuotient] = {}
        cancelled = False
        for register in expression.order:
            label = expression.named.get(register)
            quotient = (
                _ReducedQuotient(self._gens["label", label], self.one)
                if label
                else self._part(register, quotients)
            )
            if max(len(quotient.above), len(quotient.below)) > _MAX_POLYNOMIAL_TERMS:
                raise OverflowError
            cancelled |= quotient.cancelled
            quotients[register] = quotient
        return quotients[expression.order[-1]]._replace(cancelled=cancelled)

    def _part(self, register: Register, quotients: Mapping[Register, _ReducedQuotient]) -> _ReducedQuotient:
        op, a, b = self._program.ops[register]
        match op:
            case Operation.CONSTANT:
                return _ReducedQuotient(self.one * a, self.one)
            case Operation.PARAMETER:
                return self._value(self._nodes[str(a)])
            case Operation.LAPLACE:
                return _ReducedQuotient(self._gens["s", ""], self.one)
            case Operation.NEG:
                return _ReducedQuotient(-quotients[a].above, quotients[a].below)
            case Operation.ADD:
                return added(quotients[a], quotients[b])
            case Operation.SUB:
                return added(quotients[a], _ReducedQuotient(-quotients[b].above, quotients[b].below))
            case Operation.MUL:
                return multiplied(quotients[a], quotients[b], same=a == b)
            case _:
                return multiplied(quotients[a], _ReducedQuotient(quotients[b].below, quotients[b].above))

    def _value(self, node: Node) -> _ReducedQuotient:
        from dynid.bondgraph.formulas.symbolic import FormulaTooLong, SymbolicQuotient, apply
        from dynid.bondgraph.program.factored import PolynomialFactor

        if node.formula is None or not node.formula.names:
            return _ReducedQuotient(self._gens["name", node.name], self.one)

        def leaf(item: Fraction | str) -> SymbolicQuotient:
            if isinstance(item, str):
                return SymbolicQuotient(
                    {PolynomialFactor(self._gens["name", item]): 1}, 1, self._ring, _MAX_POLYNOMIAL_TERMS
                )
            return SymbolicQuotient({}, 1, self._ring, _MAX_POLYNOMIAL_TERMS).constant(item)

        try:
            return _ReducedQuotient(*node.formula.fold(leaf, apply).lowest_terms())
        except (KeyError, FormulaTooLong, ZeroDivisionError):  # no short rational function
            return _ReducedQuotient(self._gens["value", node.name], self.one)

    def write(self, quotient: _ReducedQuotient, hand: FormulaPrinter) -> Printed:
        """Write a quotient in factors, its sign in front."""
        if quotient.above == 0:
            return hand.integer(0)
        (sign, above), (sign_below, below) = (
            self._product(quotient.above, hand),
            self._product(quotient.below, hand),
        )
        written = above if quotient.below in (1, -1) else hand.quotient(above, below)
        return hand.negative(written) if sign * sign_below < 0 else written

    def _product(self, polynomial: Any, hand: FormulaPrinter) -> tuple[int, Printed]:
        """Write a polynomial as a product, and return its sign apart."""
        content, factors = polynomial.factor()
        sign = 1 if content > 0 else -1
        written: list[Printed] = [] if abs(content) == 1 and factors else [hand.integer(abs(int(content)))]
        for factor, power in factors:
            base = hand.listed([self._term(int(c), powers, hand) for powers, c in factor.terms()])
            written.append(base if power == 1 else hand.power(base, hand.integer(int(power))))
        return sign, reduce(hand.product, written)

    def _term(self, coefficient: int, powers: tuple[int, ...], hand: FormulaPrinter) -> Printed:
        bases = []
        for (kind, name), power in zip(self._keys, powers, strict=True):
            if power and kind == "value":
                bases.append((hand.whole(hand.value(self._nodes[name])), int(power)))
            elif power:
                base = hand.given(name) if kind == "name" else hand.name(name or "s")
                bases.append((base, int(power)))
        return hand.monomial(coefficient, bases)


class SumTerm(NamedTuple):
    """A term of a sum: its value, and the expression that it is, with a sign; none where several are one."""

    quotient: _ReducedQuotient
    sign: int
    expression: RegisterExpression | None


def combined(summands: list[SumTerm]) -> list[SumTerm]:
    """Return the terms of a sum, those that cancel in part added up."""
    left = list(summands)
    pair = next(iter(_cancelling(left)), None)
    while pair is not None:
        first, second = pair
        total = added(first.quotient, second.quotient)
        left = [term for term in left if term is not first and term is not second]
        left += [SumTerm(total, 1, None)] if total.above != 0 else []
        pair = next(iter(_cancelling(left)), None)
    total = _ReducedQuotient(summands[0].quotient.above * 0, summands[0].quotient.below ** 0)
    cancelled = False
    for term in left:
        total = added(total, term.quotient)
        cancelled |= total.cancelled
    return [SumTerm(total, 1, None)] if cancelled else left


def _cancelling(summands: list[SumTerm]) -> Iterator[tuple[SumTerm, SumTerm]]:
    return (pair for pair in combinations(summands, 2) if added(pair[0].quotient, pair[1].quotient).cancelled)


def added(a: _ReducedQuotient, b: _ReducedQuotient) -> _ReducedQuotient:
    """Add quotients, and note whether terms combine or a factor of the denominator cancels."""
    shared = a.below.gcd(b.below)
    left, right = b.below // shared, a.below // shared
    from_a, from_b = a.above * left, b.above * right
    total, below = from_a + from_b, a.below * left
    if total == 0:
        return _ReducedQuotient(total, below**0, cancelled=True)
    common = total.gcd(below)
    fewer = len(total) < len(from_a) + len(from_b) and a.above != 0 and b.above != 0
    return _ReducedQuotient(total // common, below // common, fewer or common != 1)


def multiplied(a: _ReducedQuotient, b: _ReducedQuotient, *, same: bool = False) -> _ReducedQuotient:
    """Multiply quotients, and note whether factors cancel or repeat (unless both are the same)."""
    if b.below == 0:
        raise OverflowError  # a value of the scene is identically zero
    if a.above == 0 or b.above == 0:
        return _ReducedQuotient(a.above * b.above, a.below**0)
    across, back = a.above.gcd(b.below), b.above.gcd(a.below)
    twice = not same and (_vary(a.above, b.above) or _vary(a.below, b.below))
    above = (a.above // across) * (b.above // back)
    below = (a.below // back) * (b.below // across)
    return _ReducedQuotient(above, below, twice or across != 1 or back != 1)


def _vary(a: Any, b: Any) -> bool:
    """Test whether two polynomials have a common factor that is not constant."""
    return bool(a.gcd(b).total_degree() > 0)
