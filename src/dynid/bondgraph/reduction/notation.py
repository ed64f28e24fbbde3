"""Programs as formulas: short ones from named intermediate results, or one nested formula."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping

from dynid.bondgraph.graph import Node
from dynid.bondgraph.reduction.program import Op, Program, Register, operands
from dynid.bondgraph.reduction.writing import TEXT, Hand, Written


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
    known: dict[Register, Written] = {}
    for current in in_order(program, register, labels):
        if current != register and current in labels:
            known[current] = hand.name(labels[current])
        else:
            known[current] = _write(*program.ops[current], known, nodes, hand)
    return known[register]


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


def _write(
    op: Op, a: int, b: int, known: Mapping[int, Written], nodes: Mapping[str, Node], hand: Hand
) -> Written:
    match op:
        case Op.CONSTANT:
            return hand.integer(a)
        case Op.PARAMETER:
            return hand.value(nodes[str(a)])
        case Op.LAPLACE:
            return hand.name("s")
        case Op.NEG:
            return hand.negative(known[a])
        case Op.ADD:
            return hand.total(known[a], known[b])
        case Op.SUB:
            return hand.difference(known[a], known[b])
        case Op.MUL if a == b:
            return hand.power(known[a], hand.integer(2))
        case Op.MUL:
            return hand.product(known[a], known[b])
        case Op.DIV:
            return hand.quotient(known[a], known[b])
