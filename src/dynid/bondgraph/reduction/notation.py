"""Programs as text: short formulas from named intermediate results, or one nested formula."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping

from dynid.bondgraph.reduction.program import Op, Program, Register, operands

_SUM, _SIGN, _PRODUCT, _POWER, _ATOM = range(5)


def express(
    program: Program, register: Register, symbols: Mapping[str, str], labels: Mapping[Register, str]
) -> str:
    """Return a register as a formula that SymPy could read.

    Parameters
    ----------
    program
        Holds the register.
    register
        What to print.
    symbols
        What stands for the value of each node.
    labels
        Names of intermediate results, at which to stop (but the register itself is spelled out); none: write
        everything in terms of the elements.
    """
    known: dict[Register, tuple[str, int]] = {}
    for current in _in_order(program, register, labels):
        if current != register and current in labels:
            known[current] = labels[current], _ATOM
        else:
            known[current] = _write(*program.ops[current], known, symbols)
    return known[register][0]


def length(program: Program, register: Register, limit: int) -> int:
    """Count the operations of a nested formula, up to a limit (a shared part counts each time)."""
    counts: dict[Register, int] = {}
    for current in _in_order(program, register, ()):
        counts[current] = min(limit, 1 + sum(counts[operand] for operand in operands(*program.ops[current])))
    return counts[register]


def _in_order(program: Program, register: Register, stops: Container[Register]) -> Iterator[Register]:
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
    op: Op, a: int, b: int, known: Mapping[int, tuple[str, int]], symbols: Mapping[str, str]
) -> tuple[str, int]:
    match op:
        case Op.CONSTANT:
            return str(a), _ATOM if a >= 0 else _SIGN
        case Op.PARAMETER:
            return symbols[str(a)], _ATOM
        case Op.LAPLACE:
            return "s", _ATOM
        case Op.NEG:
            return "-" + _bracket(known[a], _PRODUCT), _SIGN
        case Op.ADD:
            return f"{_bracket(known[a], _SUM)} + {_bracket(known[b], _PRODUCT)}", _SUM
        case Op.SUB:
            return f"{_bracket(known[a], _SUM)} - {_bracket(known[b], _PRODUCT)}", _SUM
        case Op.MUL if a == b:
            return f"{_bracket(known[a], _ATOM)}**2", _POWER
        case Op.MUL:
            return f"{_bracket(known[a], _PRODUCT)}*{_bracket(known[b], _POWER)}", _PRODUCT
        case Op.DIV:
            return f"{_bracket(known[a], _PRODUCT)}/{_bracket(known[b], _POWER)}", _PRODUCT


def _bracket(text: tuple[str, int], least: int) -> str:
    return text[0] if text[1] >= least else f"({text[0]})"
