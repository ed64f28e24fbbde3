"""From a program to a tape: what is run at every frequency, in which order, and in which slots of memory.

Whatever is a real number times a power of s is worked out once. What is left are sums, products and
reciprocals of registers, and sums of a register and such a monomial.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.algebra.doubled import (
    POWERS,
    Array,
    Code,
    compiled,
    real_product,
    real_reciprocal,
    real_sum,
)
from dynid.bondgraph.reduction.program import Op, Program

Integers = NDArray[np.int64]
#: Codes, operands, numbers and powers of the monomials of instructions.
Listing = tuple[Integers, Integers, Array, Integers]

_LAPLACE, _ADD, _SUB, _MUL, _DIV, _NEG = (int(op) for op in tuple(Op)[2:])
_LOAD, _SHIFT, _PLUS, _MINUS, _TIMES, _INVERSE, _MINUS_ONE = (int(code) for code in Code)
_GENERAL = 99  # power of a register that is no monomial
_SHALLOW = 4  # operations above a leaf


class Tape(NamedTuple):
    """What `doubled.evaluate` runs.

    Parameters
    ----------
    rows
        Operation, first and second operand, target (slots of the memory), and power of s in the monomial.
    numbers
        High part, low part and error bound of the monomial of each row.
    places
        The slot of each wanted register.
    slots
        How many slots there are.
    """

    rows: Integers
    numbers: Array
    places: Integers
    slots: int


def schedule(program: Program, wanted: Sequence[int], value: Callable[[str], Fraction]) -> Tape:
    """Return the tape that computes some registers.

    Parameters
    ----------
    program, wanted
        The program, and the registers.
    value
        The exact value of a node.
    """
    ops, count = program.ops, len(program.ops)
    codes = np.fromiter([op for op, _, _ in ops], np.int64, count)
    first = np.fromiter([a if op >= _ADD else 0 for op, a, _ in ops], np.int64, count)
    second = np.fromiter([b for _, _, b in ops], np.int64, count)
    numbers = np.zeros((count, 3))
    numbers[program.s, 0] = 1.0
    leaves = np.flatnonzero(codes < _LAPLACE)
    read = [ops[leaf] for leaf in leaves.tolist()]
    exact = (value(name) if op is Op.PARAMETER else name for op, name, _ in read)
    parts = chain.from_iterable(_doubled(number) for number in exact)
    numbers[leaves] = np.fromiter(parts, np.float64, 3 * len(leaves)).reshape(-1, 3)
    asked = np.array(wanted, dtype=np.int64)
    return Tape(*_allocated(*_lowered(codes, first, second, numbers, asked)))


def _doubled(exact: Fraction | int) -> tuple[float, float, float]:
    """Return a number as a sum of two doubles, with a bound on what they miss."""
    numerator, denominator = exact.numerator, exact.denominator
    try:
        high = numerator / denominator
        above, below = high.as_integer_ratio()
        low = (numerator * below - above * denominator) / (denominator * below)
    except OverflowError:
        return np.inf, 0.0, np.inf
    return high, low, 2.0**-104 * abs(high) + 2.0**-1070


@compiled
def _monomials(
    codes: Integers, first: Integers, second: Integers, numbers: Array, needed: NDArray[np.bool_]
) -> Integers:
    """Work out all registers that are a number times a power of s; return the powers."""
    power = np.full(len(codes), _GENERAL)
    for register in range(len(codes)):
        if not needed[register]:
            continue
        op = codes[register]
        if op <= _LAPLACE:
            power[register] = 1 if op == _LAPLACE else 0
            continue
        p = power[first[register]]
        q = p if op == _NEG else power[second[register]]
        if p == _GENERAL or q == _GENERAL:
            continue
        a, b = numbers[first[register]], numbers[second[register]]
        x, y = (a[0], a[1], a[2]), (b[0], b[1], b[2])
        total = p + q if op == _MUL else p - q if op == _DIV else p
        if abs(total) > POWERS or (op in (_ADD, _SUB) and p != q):
            continue
        if op == _MUL:
            x = real_product(x, y)
        elif op == _DIV:
            x = real_product(x, real_reciprocal(y))
        elif op == _ADD:
            x = real_sum(x, y)
        elif op == _SUB:
            x = real_sum(x, (-y[0], -y[1], y[2]))
        else:
            x = (-x[0], -x[1], x[2])
        power[register] = total
        numbers[register, 0], numbers[register, 1], numbers[register, 2] = x
    return power


@compiled
def _needed(codes: Integers, first: Integers, second: Integers, wanted: Integers) -> NDArray[np.bool_]:
    """Mark the registers that the wanted depend on."""
    needed = np.zeros(len(codes), np.bool_)
    needed[wanted] = True
    for register in range(len(codes) - 1, -1, -1):
        if needed[register] and codes[register] >= _ADD:
            needed[first[register]] = True
            if codes[register] != _NEG:
                needed[second[register]] = True
    return needed


@compiled
def _put(listing: Listing, at: int, code: int, one: int, other: int) -> int:
    """Write an instruction; return the place of the next one."""
    listing[0][at] = code
    listing[1][at, 0], listing[1][at, 1] = one, other
    return at + 1


@compiled
def _put_monomial(
    listing: Listing, at: int, code: int, one: int, number: Array, sign: float, power: int
) -> int:
    """Write an instruction that reads a monomial; return the place of the next one."""
    listing[2][at, 0], listing[2][at, 1], listing[2][at, 2] = sign * number[0], sign * number[1], number[2]
    listing[3][at] = power
    return _put(listing, at, code, one, one)


@compiled
def _lowered(
    codes: Integers, first: Integers, second: Integers, numbers: Array, wanted: Integers
) -> tuple[Integers, Integers, Array, Integers, Integers]:
    """Return the instructions: codes, operands, numbers and powers of the monomials; and those wanted."""
    count = len(codes)
    needed = _needed(codes, first, second, wanted)
    power = _monomials(codes, first, second, numbers, needed)
    most = 3 * count + len(wanted)
    listing = (
        np.empty(most, np.int64),
        np.empty((most, 2), np.int64),
        np.zeros((most, 3)),
        np.zeros(most, np.int64),
    )
    place = np.full(count, -1)  # the instruction that gives a register
    inverse = np.full(count, -1)
    at = 0
    for index in range(count + len(wanted)):
        register = index if index < count else wanted[index - count]
        if place[register] >= 0 or not needed[register] or (index < count and power[index] != _GENERAL):
            continue
        general = power[register] == _GENERAL
        op = codes[register] if general else _LAPLACE
        a = first[register] if general else register
        b = second[register] if general and op != _NEG else a
        added = -1  # the operand of a sum that is a monomial
        if op in (_ADD, _SUB):
            added = b if power[b] != _GENERAL else a if power[a] != _GENERAL else -1
        for operand in (a, b):
            if place[operand] < 0 and operand != added:
                place[operand] = at
                at = _put_monomial(listing, at, _LOAD, at, numbers[operand], 1.0, power[operand])
        if op == _LAPLACE:
            continue  # wanted, and a monomial
        if op == _DIV:
            if inverse[b] < 0:
                inverse[b] = at
                at = _put(listing, at, _INVERSE, place[b], place[b])
            if power[a] == 0 and numbers[a, 0] == 1.0 and numbers[a, 1] == 0.0:
                place[register] = inverse[b]
                continue
            at = _put(listing, at, _TIMES, place[a], inverse[b])
        elif added >= 0:
            one, sign = place[a] if added == b else place[b], 1.0
            if op == _SUB and added == b:
                sign = -1.0
            elif op == _SUB:  # number - x = -x + number
                one, at = at, _put(listing, at, _MINUS_ONE, one, one)
            at = _put_monomial(listing, at, _SHIFT, one, numbers[added], sign, power[added])
        elif op == _NEG:
            at = _put(listing, at, _MINUS_ONE, place[a], place[a])
        else:
            code = _PLUS if op == _ADD else _MINUS if op == _SUB else _TIMES
            at = _put(listing, at, code, place[a], place[b])
        place[register] = at - 1
    return listing[0][:at], listing[1][:at], listing[2][:at], listing[3][:at], place[wanted]


@compiled
def _allocated(
    codes: Integers, operands: Integers, monomials: Array, powers: Integers, wanted: Integers
) -> tuple[Integers, Array, Integers, int]:
    """Order the instructions so that few registers are alive, and give them slots."""
    count = len(codes)
    depth = np.zeros(count, np.int64)
    for register in range(count):
        if codes[register] != _LOAD:
            depth[register] = 1 + max(depth[operands[register, 0]], depth[operands[register, 1]])
    uses = np.zeros(count, np.int64)
    for register in wanted:
        uses[register] += 1  # never freed
    # as written, but what is near the leaves (the immittance of an element, say) only when it is asked for
    order = np.empty(count, np.int64)
    done = 0
    state = np.zeros(count, np.int8)  # 1: waits for its operands, 2: in order
    stack = np.empty(2 * count + 2, np.int64)
    for root in range(count):
        if depth[root] <= _SHALLOW and uses[root] == 0:
            continue
        top = 0
        stack[0] = root
        while top >= 0:
            register = stack[top]
            if state[register] == 2:
                top -= 1
            elif state[register] == 1 or codes[register] == _LOAD:
                state[register] = 2
                order[done] = register
                done += 1
                top -= 1
            else:
                state[register] = 1
                one, other = operands[register]
                uses[one] += 1
                if state[one] != 2:
                    top += 1
                    stack[top] = one
                if other != one:
                    uses[other] += 1
                    if state[other] != 2:
                        top += 1
                        stack[top] = other
    slot = np.full(count, -1, np.int64)
    free = np.empty(count, np.int64)
    available, slots = 0, 0
    rows = np.empty((done, 5), np.int64)
    for step in range(done):
        register = order[step]
        if available:
            available -= 1
            slot[register] = free[available]
        else:
            slot[register] = slots
            slots += 1
        rows[step, 0] = codes[register]
        rows[step, 3] = slot[register]
        rows[step, 4] = powers[register]
        one, other = operands[register]
        rows[step, 1], rows[step, 2] = slot[one], slot[other]
        if codes[register] == _LOAD:
            continue
        # the target is taken before its operands are given back: the two never overlap
        uses[one] -= 1
        if uses[one] == 0:
            free[available] = slot[one]
            available += 1
        if other != one:
            uses[other] -= 1
            if uses[other] == 0:
                free[available] = slot[other]
                available += 1
    return rows, monomials[order[:done]], slot[wanted], slots
