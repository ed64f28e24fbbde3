"""Derivatives of a program with respect to every parameter, by running it backwards once.

Reverse accumulation over the same operations (Griewank & Walther, *Evaluating Derivatives*, ch. 3): one sweep
gives all partial derivatives of one register, for a few times the work of one run, on any number type.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from dynid.bondgraph.reduction.program import Number, Op, Program, Register, operands

N = TypeVar("N", bound=Number)


def gradient(
    program: Program, register: Register, values: Mapping[str, N], laplace: N, one: N
) -> tuple[N, dict[str, N]]:
    """Return the value of a register and its partial derivatives.

    Parameters
    ----------
    program
        The program.
    register
        What to differentiate.
    values, laplace, one
        As for `Program.run`.

    Returns
    -------
    tuple
        The value, and the derivative by every parameter that it depends on.

    Raises
    ------
    ZeroDivisionError
        Where exact numbers meet a zero pivot.
    """
    needed = _needed(program, register)
    run = program.run(needed, values, laplace, one)
    slopes: dict[Register, N] = {register: one}
    partials: dict[str, N] = {}
    for place in reversed(needed):
        slope = slopes.pop(place, None)
        if slope is None:
            continue
        op, a, b = program.ops[place]
        if op is Op.PARAMETER:
            partials[a] = slope
        for operand, share in _shares(op, a, b, slope, run, place):
            slopes[operand] = slopes[operand] + share if operand in slopes else share
    return run[register], partials


def _needed(program: Program, register: Register) -> list[Register]:
    """Return the registers behind one, in order."""
    found, waiting = {register}, [register]
    while waiting:
        for operand in operands(*program.ops[waiting.pop()]):
            if operand not in found:
                found.add(operand)
                waiting.append(operand)
    return sorted(found)


def _shares(
    op: Op, a: Register, b: Register, slope: N, run: Mapping[Register, N], place: Register
) -> tuple[tuple[Register, N], ...]:
    """Pass a slope on to the operands of an operation."""
    match op:
        case Op.ADD:
            return (a, slope), (b, slope)
        case Op.SUB:
            return (a, slope), (b, -slope)
        case Op.MUL:
            return (a, slope * run[b]), (b, slope * run[a])
        case Op.DIV:
            share = slope / run[b]
            return (a, share), (b, -(share * run[place]))
        case Op.NEG:
            return ((a, -slope),)
        case _:
            return ()
