"""Programs as formulas: short ones from named intermediate results, or one nested formula."""

from __future__ import annotations

from collections.abc import Collection, Container, Iterator, Mapping

from dynid.bondgraph.graph import Node
from dynid.bondgraph.reduction.program import Op, Program, Register, operands
from dynid.bondgraph.reduction.writing import TEXT, Hand, Over, Written


def express(
    program: Program,
    register: Register,
    nodes: Mapping[str, Node],
    labels: Mapping[Register, str],
    hand: Hand = TEXT,
) -> Written:
    """Return a register as a formula.

    Parameters
    ----------
    program
        Holds the register.
    register
        What to print.
    nodes
        The nodes of the graph.
    labels
        Names of intermediate results, at which to stop (but the register itself is spelled out); none: write
        everything in terms of the elements.
    hand
        How to write.
    """
    known: dict[Register, Over] = {}
    for current in in_order(program, register, labels):
        if current != register and current in labels:
            known[current] = Over(hand.name(labels[current]))
        else:
            known[current] = _write(*program.ops[current], known, nodes, hand)
    return hand.whole(known[register])


def length(program: Program, register: Register, limit: int) -> int:
    """Count the operations of a nested formula, up to a limit (a shared part counts each time)."""
    counts: dict[Register, int] = {}
    for current in in_order(program, register, ()):
        counts[current] = min(limit, 1 + sum(counts[operand] for operand in operands(*program.ops[current])))
    return counts[register]


def in_order(program: Program, register: Register, stops: Container[Register]) -> Iterator[Register]:
    """Yield what a register is made of, operands first, without recursion: programs are deep."""
    done: set[Register] = set()
    stack = [register]
    while stack:
        current = stack[-1]
        leaf = current != register and current in stops
        missing = [] if leaf else [part for part in operands(*program.ops[current]) if part not in done]
        if missing:
            stack += missing
            continue
        stack.pop()
        if current not in done:
            done.add(current)
            yield current


def _write(op: Op, a: int, b: int, known: Mapping[int, Over], nodes: Mapping[str, Node], hand: Hand) -> Over:
    match op:
        case Op.CONSTANT:
            return Over(hand.integer(a))
        case Op.PARAMETER:
            return hand.value(nodes[str(a)])
        case Op.LAPLACE:
            return Over(hand.name("s"))
        case Op.NEG:
            return hand.opposite(known[a])
        case Op.ADD:
            return Over(hand.total(hand.whole(known[a]), hand.whole(known[b])))
        case Op.SUB:
            return Over(hand.difference(hand.whole(known[a]), hand.whole(known[b])))
        case Op.MUL if a == b:
            return hand.squared(known[a])
        case Op.MUL:
            return hand.times(known[a], known[b])
        case Op.DIV:
            return hand.divided(known[a], known[b])


def shared(program: Program, wanted: Collection[Register], longest: int) -> list[Register]:
    """Return what is worth a name: the wanted, what is used more than once, and what grows long.

    Parameters
    ----------
    program
        Holds the registers.
    wanted
        What is to be written.
    longest
        Most operations of a formula before a part of it is named.

    Returns
    -------
    list
        Registers in the order of the program.
    """
    order = _needed(program, wanted)
    uses: dict[Register, int] = {}
    for register in order:
        for operand in operands(*program.ops[register]):
            uses[operand] = uses.get(operand, 0) + 1
    size: dict[Register, int] = {}
    named: list[Register] = []
    for register in order:
        if program.ops[register][0] < Op.ADD:
            size[register] = 1
            continue
        size[register] = 1 + sum(size[operand] for operand in operands(*program.ops[register]))
        if register in wanted or uses[register] > 1 or size[register] > longest:
            named.append(register)
            size[register] = 1
    return named


def _needed(program: Program, wanted: Collection[Register]) -> list[Register]:
    """Return what some registers are made of, in the order of the program."""
    found = set(wanted)
    for register in range(max(wanted, default=-1), -1, -1):
        if register in found:
            found.update(operands(*program.ops[register]))
    return sorted(found)


def free_letter(taken: Collection[str], letter: str = "t") -> str:
    """Return a beginning of names that no node and no parameter has."""
    while any(
        (name.startswith(letter) and name[len(letter) :].isdigit()) or name == letter for name in taken
    ):
        letter += "_"
    return letter
