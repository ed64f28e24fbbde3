"""Programs as formulas: short ones from named intermediate results, or one nested formula."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterable, Iterator, Mapping

from dynid.bondgraph.formula_printers import TEXT, FormulaPrinter, Printed, PrintedFraction
from dynid.bondgraph.formulas.lowest_terms import (
    FormulaRing,
    RegisterExpression,
    SumTerm,
    combined,
    independent,
)
from dynid.bondgraph.graph import Node
from dynid.bondgraph.program.program import Operation, Program, Register, operands

#: Most operations of a sum that is brought to lowest terms; a longer one is written as it stands.
_MAX_SUM_OPERATIONS = 300


def print_register(
    program: Program,
    register: Register,
    nodes: Mapping[str, Node],
    labels: Mapping[Register, str],
    hand: FormulaPrinter = TEXT,
) -> Printed:
    """Return a register as a formula in lowest terms.

    It is written as the program builds it; where something in that would cancel, as a quotient of products.

    `labels`: names of intermediate results, at which to stop (but the register itself is spelled out); none:
    write everything in terms of the elements.
    """
    return hand.listed(print_sum(program, [(register, True)], nodes, labels, hand))


def print_sum(
    program: Program,
    terms: Iterable[tuple[Register, bool]],
    nodes: Mapping[str, Node],
    labels: Mapping[Register, str],
    hand: FormulaPrinter = TEXT,
) -> list[Printed]:
    """Return the terms of a sum as formulas in lowest terms; where they would cancel, their sum is one term.

    `program`, `nodes`, `labels`, `hand`: as for `print_register`. `terms`: registers, and whether
    each is spelled out although it has a name.
    """
    expressions = []
    for register, spelled in terms:
        whole_formula = spelled or register not in labels
        order = tuple(in_order(program, register, labels)) if whole_formula else (register,)
        named = {r: labels[r] for r in order if r in labels and not (spelled and r == register)}
        expressions.append(RegisterExpression(order, named))
    if sum(len(expression.order) for expression in expressions) > _MAX_SUM_OPERATIONS or independent(
        program, expressions, nodes
    ):
        return [_as_it_stands(program, expression, nodes, hand) for expression in expressions]
    ring = FormulaRing(program, expressions, nodes)
    try:
        summands: list[SumTerm] = []
        for expression in expressions:
            quotient = ring.part(expression)
            if not quotient.cancelled:
                summands.append(SumTerm(quotient, 1, expression))
                continue
            for sign, addend in _addends(program, expression):
                addend_quotient = ring.part(addend)
                value = addend_quotient._replace(above=sign * addend_quotient.above)
                summands.append(SumTerm(value, sign, addend))
    except OverflowError:
        return [_as_it_stands(program, expression, nodes, hand) for expression in expressions]
    written: list[Printed] = []
    for addend_quotient, sign, single in combined(summands):
        if single is None or addend_quotient.cancelled:
            written.append(ring.write(addend_quotient, hand))
        else:
            term = _as_it_stands(program, single, nodes, hand)
            written.append(term if sign > 0 else hand.whole(hand.opposite(PrintedFraction(term))))
    return written


def _addends(program: Program, expression: RegisterExpression) -> list[tuple[int, RegisterExpression]]:
    """Split a sum into its terms, each with its sign."""
    addends: list[tuple[int, RegisterExpression]] = []
    stack = [(1, expression.order[-1])]
    while stack:
        sign, register = stack.pop()
        op, a, b = program.ops[register]
        if op not in (Operation.ADD, Operation.SUB, Operation.NEG) or register in expression.named:
            order = tuple(in_order(program, register, expression.named))
            order = (register,) if register in expression.named else order
            addends.append((sign, RegisterExpression(order, expression.named)))
        elif op is Operation.NEG:
            stack.append((-sign, a))
        else:
            stack += [(sign if op is Operation.ADD else -sign, b), (sign, a)]
    return addends


def _as_it_stands(
    program: Program, expression: RegisterExpression, nodes: Mapping[str, Node], hand: FormulaPrinter
) -> Printed:
    written: dict[Register, PrintedFraction] = {}
    for current in expression.order:
        if current in expression.named:
            written[current] = PrintedFraction(hand.name(expression.named[current]))
        else:
            written[current] = _write(*program.ops[current], written, nodes, hand)
    return hand.whole(written[expression.order[-1]])


def length(program: Program, register: Register, limit: int) -> int:
    """Count the operations of a nested formula, up to a limit (a shared part counts each time)."""
    counts: dict[Register, int] = {}
    for current in in_order(program, register, ()):
        counts[current] = min(limit, 1 + sum(counts[operand] for operand in operands(*program.ops[current])))
    return counts[register]


def in_order(program: Program, register: Register, stops: Container[Register]) -> Iterator[Register]:
    """Yield the registers behind one, operands first, without recursion: programs are deep."""
    done: set[Register] = set()
    stack = [register]
    while stack:
        current = stack[-1]
        leaf = current != register and current in stops
        read = () if leaf else operands(*program.ops[current])
        missing = [operand for operand in read if operand not in done]
        if missing:
            stack += missing
            continue
        stack.pop()
        if current not in done:
            done.add(current)
            yield current


def _write(
    op: Operation,
    a: int,
    b: int,
    written: Mapping[int, PrintedFraction],
    nodes: Mapping[str, Node],
    hand: FormulaPrinter,
) -> PrintedFraction:
    match op:
        case Operation.CONSTANT:
            return PrintedFraction(hand.integer(a))
        case Operation.PARAMETER:
            return hand.value(nodes[str(a)])
        case Operation.LAPLACE:
            return PrintedFraction(hand.name("s"))
        case Operation.NEG:
            return hand.opposite(written[a])
        case Operation.ADD:
            return PrintedFraction(hand.total(hand.whole(written[a]), hand.whole(written[b])))
        case Operation.SUB:
            return PrintedFraction(hand.difference(hand.whole(written[a]), hand.whole(written[b])))
        case Operation.MUL if a == b:
            return hand.squared(written[a])
        case Operation.MUL:
            return hand.times(written[a], written[b])
        case Operation.DIV:
            return hand.divided(written[a], written[b])


def shared(program: Program, registers: Collection[Register], longest: int) -> list[Register]:
    """Return the registers to name: the wanted ones, those used more than once, and long ones.

    `longest`: most operations of a formula before a part of it is named.
    """
    order = program.behind(registers)
    uses: dict[Register, int] = {}
    for register in order:
        for operand in operands(*program.ops[register]):
            uses[operand] = uses.get(operand, 0) + 1
    size: dict[Register, int] = {}
    named: list[Register] = []
    for register in order:
        if program.ops[register][0] < Operation.ADD:
            size[register] = 1
            continue
        size[register] = 1 + sum(size[operand] for operand in operands(*program.ops[register]))
        if register in registers or uses[register] > 1 or size[register] > longest:
            named.append(register)
            size[register] = 1
    return named


def free_letter(names: Collection[str], letter: str = "t") -> str:
    """Return a beginning of names that no node and no parameter has."""
    while any(
        (name.startswith(letter) and name[len(letter) :].isdigit()) or name == letter for name in names
    ):
        letter += "_"
    return letter
