"""The compiler of reduction programs: instructions, their order, their memory slots, and the parallel run.

Whatever in a program is a real number times a power of s is worked out once. What is left becomes
instructions: sums, products and reciprocals of registers, and sums of a register and such a monomial. They
are put in an order in which few values are alive at a time, each with a slot of memory that is reused as soon
as its value is no longer needed. The tape runs in doubled precision, block of frequencies by block, on all
cores (`docs/theory/reduction_programs.md`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import chain
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.bondgraph.program.doubled import (
    LANES,
    POWERS,
    ROWS,
    Integers,
    Real,
    TapeOperation,
    fma,
    real_product,
    real_reciprocal,
    real_sum,
    run_tape,
)
from dynid.bondgraph.program.program import Operation, Program, Register
from dynid.native import call, compiled

# --- instructions ----------------------------------------------------------------------------------

_LAPLACE, _ADD, _SUB, _MUL, _DIV, _NEG = (int(op) for op in tuple(Operation)[2:])
_LOAD, _SHIFT, _PLUS, _MINUS, _TIMES, _INVERSE, _OPPOSITE = (int(code) for code in TapeOperation)
# Frequencies that NumPy runs at once at the most.
_MOST_LANES = 1024
_GENERAL = 99  # power of a register that is no monomial


class RegisterArrays(NamedTuple):
    """The registers of a program: operation, operands, and (once known) the number of each monomial.

    Parameters
    ----------
    codes, first, second
        Operations (`Operation`) and the registers they read; shape (register,).
    numbers
        High part, low part and error bound of each monomial; shape (register, 3).
    """

    codes: Integers
    first: Integers
    second: Integers
    numbers: Array


class InstructionListing(NamedTuple):
    """Instructions in the order in which they were written; each is named by its place.

    Parameters
    ----------
    codes, operands
        Operations (`TapeOperation`), shape (instruction,), and the instructions that they read, shape
        (instruction, 2).
    numbers, powers
        The monomial of each instruction that has one: parts of its number, and its power of s.
    """

    codes: Integers
    operands: Integers
    numbers: Array
    powers: Integers


class _Draft(NamedTuple):
    """A listing being written."""

    listing: InstructionListing
    length: Integers  # shape (1,)
    place: Integers  # the instruction that gives a register, or -1
    inverse: Integers  # the one that gives its reciprocal


def lower_program(registers: RegisterArrays, wanted: Integers) -> tuple[InstructionListing, Integers]:
    """Return the instructions that compute registers, and the places of those wanted."""
    count = len(registers.codes)
    needed = np.zeros(count, np.bool_)
    needed[wanted] = True
    for register in range(count - 1, -1, -1):
        if needed[register] and registers.codes[register] >= _ADD:
            needed[registers.first[register]] = True
            if registers.codes[register] != _NEG:
                needed[registers.second[register]] = True
    power = _monomials(registers, needed)
    most = 3 * count + len(wanted)
    blank = InstructionListing(
        np.empty(most, np.int64), np.empty((most, 2), np.int64), np.zeros((most, 3)), np.zeros(most, np.int64)
    )
    draft = _Draft(blank, np.zeros(1, np.int64), np.full(count, -1), np.full(count, -1))
    for register in range(count):
        if needed[register] and power[register] == _GENERAL:
            draft.place[register] = _operation(registers, power, register, draft)
    for register in wanted:
        _operand(registers, power, register, draft)
    end, (codes, operands, numbers, powers) = draft.length[0], draft.listing
    return InstructionListing(codes[:end], operands[:end], numbers[:end], powers[:end]), draft.place[wanted]


def _monomials(registers: RegisterArrays, needed: NDArray[np.bool_]) -> Integers:
    """Work out all registers that are a number times a power of s; return the powers."""
    codes, first, second, numbers = registers
    power = np.full(len(codes), _GENERAL)
    for register in range(len(codes)):
        op = codes[register]
        if not needed[register]:
            continue
        if op <= _LAPLACE:
            power[register] = 1 if op == _LAPLACE else 0
            continue
        one, other = first[register], first[register] if op == _NEG else second[register]
        p, q = power[one], power[other]
        if p == _GENERAL or q == _GENERAL or (op in (_ADD, _SUB) and p != q):
            continue
        total = p + q if op == _MUL else p - q if op == _DIV else p
        if abs(total) <= POWERS:
            power[register] = total
            a, b = numbers[one], numbers[other]
            x = _number(op, (a[0], a[1], a[2]), (b[0], b[1], b[2]))
            numbers[register, 0], numbers[register, 1], numbers[register, 2] = x
    return power


def _number(op: int, x: Real, y: Real) -> Real:
    """Return the number of a sum, product or quotient of monomials with these numbers."""
    if op == _MUL:
        return real_product(x, y)
    if op == _DIV:
        return real_product(x, real_reciprocal(y))
    if op == _NEG:
        return -x[0], -x[1], x[2]
    return real_sum(x, y if op == _ADD else (-y[0], -y[1], y[2]))


def _put(draft: _Draft, code: int, one: int, other: int) -> int:
    """Write an instruction; return its place."""
    at: int = draft.length[0]
    draft.listing.codes[at] = code
    draft.listing.operands[at, 0], draft.listing.operands[at, 1] = one, other
    draft.length[0] = at + 1
    return at


def _put_monomial(draft: _Draft, code: int, one: int, number: Array, sign: float, power: int) -> int:
    """Write an instruction that reads a monomial; return its place."""
    at = _put(draft, code, one, one)
    parts = draft.listing.numbers[at]
    parts[0], parts[1], parts[2] = sign * number[0], sign * number[1], number[2]
    draft.listing.powers[at] = power
    return at


def _operand(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
    """Return the instruction that gives a register; a monomial is loaded where it is first read."""
    at: int = draft.place[register]
    if at < 0:
        at = draft.length[0]  # a load names itself
        draft.place[register] = at
        _put_monomial(draft, _LOAD, at, registers.numbers[register], 1.0, power[register])
    return at


def _operation(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
    """Write the instruction that computes a register from its operands; return its place."""
    op, a, b = registers.codes[register], registers.first[register], registers.second[register]
    if op == _DIV:
        return _write_quotient(registers, power, register, draft)
    if op in (_ADD, _SUB):
        return _write_sum(registers, power, register, draft)
    one = _operand(registers, power, a, draft)
    if op == _NEG:
        return _put(draft, _OPPOSITE, one, one)
    return _put(draft, _TIMES, one, _operand(registers, power, b, draft))


def _write_quotient(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
    """Write a quotient as a product with a reciprocal, which is shared by all that divide by the same."""
    a, b = registers.first[register], registers.second[register]
    divisor = _operand(registers, power, b, draft)
    inverse: int = draft.inverse[b]
    if inverse < 0:
        inverse = _put(draft, _INVERSE, divisor, divisor)
        draft.inverse[b] = inverse
    if power[a] == 0 and registers.numbers[a, 0] == 1.0 and registers.numbers[a, 1] == 0.0:
        return inverse
    return _put(draft, _TIMES, _operand(registers, power, a, draft), inverse)


def _write_sum(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
    """Write a sum or difference; a monomial in it is added as such, without being loaded."""
    op, a, b = registers.codes[register], registers.first[register], registers.second[register]
    if power[b] != _GENERAL:
        one = _operand(registers, power, a, draft)
        sign = 1.0 if op == _ADD else -1.0
        return _put_monomial(draft, _SHIFT, one, registers.numbers[b], sign, power[b])
    other = draft.place[b]
    if power[a] == _GENERAL:
        return _put(draft, _PLUS if op == _ADD else _MINUS, draft.place[a], other)
    if op == _SUB:  # number - x = -x + number
        other = _put(draft, _OPPOSITE, other, other)
    return _put_monomial(draft, _SHIFT, other, registers.numbers[a], 1.0, power[a])


# --- order and slots ------------------------------------------------------------------------------

_SHALLOW = 4  # operations above a leaf
_FEW = 100  # slots that stay in fast memory


def instruction_order(codes: Integers, operands: Integers, wanted: Integers, *, deep: bool) -> Integers:
    """Return an order of the instructions in which few are alive at a time.

    It is the one in which they are written, but what is near the leaves (the immittance of an element, say)
    comes only when it is asked for, or not at all. Where it goes `deep`, every instruction does, of its
    operands first the one that needs more slots (R. Sethi, J. D. Ullman, J. ACM 17 (1970) 715–728).
    """
    count = len(codes)
    weight = np.full(count, int(deep))  # slots that it needs, or operations above the leaves
    for at in range(count):
        if codes[at] != _LOAD:
            one, other = operands[at]
            more = one != other and weight[one] == weight[other] if deep else True
            weight[at] = max(weight[one], weight[other]) + more
    root = (weight > _SHALLOW) & (not deep)
    root[wanted] = True
    order = np.empty(count, np.int64)
    done = 0
    placed = np.zeros(count, np.bool_)
    stack = np.empty(2 * count + 2, np.int64)
    for start in np.flatnonzero(root):
        stack[0], top = start, 0
        while top >= 0:
            at, here = stack[top], top
            if not placed[at] and codes[at] != _LOAD:
                one, other = operands[at]
                turned = deep and weight[one] > weight[other]
                for operand in (other, one) if turned else (one, other):  # the last comes first
                    if not placed[operand]:
                        top += 1
                        stack[top] = operand
            if top > here:
                continue  # back to it when its operands are placed
            top -= 1
            if not placed[at]:
                placed[at] = True
                order[done] = at
                done += 1
    return order[:done]


def allocate_slots(operands: Integers, order: Integers, wanted: Integers) -> tuple[Integers, int]:
    """Return the slot of each instruction, and how many slots there are.

    A slot is free again when the last instruction that reads it has run. The target of an instruction is
    taken before its operands are given back: the two never overlap.
    """
    uses = np.zeros(len(operands), np.int64)
    for at in wanted:
        uses[at] += 1  # never given back
    for at in order:
        for operand in operands[at]:  # a load names itself: others read it later
            uses[operand] += 1
    slot = np.full(len(operands), -1, np.int64)
    free = np.empty(len(operands), np.int64)
    available, slots = 0, 0
    for at in order:
        if available:
            available -= 1
            slot[at] = free[available]
        else:
            slot[at] = slots
            slots += 1
        for operand in operands[at]:
            uses[operand] -= 1
            if uses[operand] == 0:
                free[available] = slot[operand]
                available += 1
    return slot, slots


# --- tape -----------------------------------------------------------------------------------------


class InstructionTape(NamedTuple):
    """The instructions that `doubled.run_tape` runs.

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


def compile_tape(
    program: Program, wanted: Sequence[int], value: Callable[[str], Fraction]
) -> InstructionTape:
    """Return the tape that computes some registers.

    Parameters
    ----------
    program, wanted
        The program, and the registers.
    value
        The exact value of a node.
    """
    registers, asked = _registers(program, value), np.array(wanted, dtype=np.int64)
    if compiled():
        return _tape_by_library(registers, asked)
    listing, places = lower_program(registers, asked)
    order, slot, slots = _in_few_slots(listing, places)
    rows = np.column_stack((listing.codes, slot[listing.operands], slot, listing.powers))
    return InstructionTape(rows[order], listing.numbers[order], slot[places], slots)


def _in_few_slots(listing: InstructionListing, places: Integers) -> tuple[Integers, Integers, int]:
    """Return the order of the instructions, the slot of each, and how many slots there are."""
    tried: list[tuple[Integers, Integers, int]] = []
    for deep in (False, True):
        order = instruction_order(listing.codes, listing.operands, places, deep=deep)
        tried.append((order, *allocate_slots(listing.operands, order, places)))
        if tried[-1][2] <= _FEW:
            return tried[-1]
    return min(tried, key=itemgetter(2))


def _tape_by_library(registers: RegisterArrays, wanted: Integers) -> InstructionTape:
    """Return the same from `native/tape.c`."""
    count = len(registers.codes)
    most = 3 * count + len(wanted)
    rows, numbers = np.empty((most, 5), np.int64), np.empty((most, 3))
    places, sizes = np.empty(len(wanted), np.int64), np.empty(2, np.int64)
    call("dynid_tape", count, *registers, len(wanted), wanted, rows, numbers, places, sizes)
    length, slots = sizes.tolist()
    return InstructionTape(rows[:length], numbers[:length], places, slots)


def _registers(program: Program, value: Callable[[str], Fraction]) -> RegisterArrays:
    """Return the registers of a program as arrays, with the numbers of its leaves."""
    codes, one, other, names = program.arrays()
    numbers = np.zeros((len(codes), 3))
    numbers[program.s, 0] = 1.0
    constants, parameters = (np.flatnonzero(codes == op) for op in (Operation.CONSTANT, Operation.PARAMETER))
    numbers[constants] = _doubled(one[constants].tolist())
    numbers[parameters] = _doubled([value(names[name]) for name in one[parameters].tolist()])
    one[codes <= Operation.LAPLACE] = 0
    return RegisterArrays(codes, one, other, numbers)


def _doubled(exact: list[Fraction] | list[int]) -> Array:
    """Return numbers as sums of two doubles, with bounds on what they miss; shape (number, 3)."""
    above, below = zip(*(number.as_integer_ratio() for number in exact), strict=True) if exact else ((), ())
    if max(map(abs, chain(above, below)), default=2**53) >= 2**53:
        return np.array([_doubled_exactly(number) for number in exact]).reshape(-1, 3)
    numerator, denominator = np.array(above, dtype=float), np.array(below, dtype=float)
    high = numerator / denominator
    low = -fma(high, denominator, -numerator) / denominator  # what is left of the numerator is exact
    return np.column_stack((high, low, 2.0**-104 * abs(high) + 2.0**-1070))


def _doubled_exactly(exact: Fraction | int) -> tuple[float, float, float]:
    """Return a number as a sum of two doubles, with a bound on what they miss."""
    numerator, denominator = exact.as_integer_ratio()
    try:
        high = numerator / denominator
        above, below = high.as_integer_ratio()
        low = (numerator * below - above * denominator) / (denominator * below)
    except OverflowError:
        return np.inf, 0.0, np.inf
    return high, low, 2.0**-104 * abs(high) + 2.0**-1070


# --- run ------------------------------------------------------------------------------------------


def sweep_frequencies(
    program: Program,
    wanted: Sequence[Register],
    value: Callable[[str], Fraction],
    omega: NDArray[np.float64],
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return registers at s = j omega, and bounds on the moduli of their errors.

    Memory is that of the registers alive at a time, for one block of frequencies a thread; the blocks are
    independent, so that the result does not depend on their number or on the threads.

    Parameters
    ----------
    program
        The program.
    wanted
        Registers to return.
    value
        The exact value of a node.
    omega
        Angular frequencies, rad/s.

    Returns
    -------
    values, bounds
        Both of shape (omega, register).
    """
    tape = compile_tape(program, wanted, value)
    lanes = LANES if compiled() else max(1, min(len(omega), _MOST_LANES))
    blocks = -(-len(omega) // lanes)
    padded = np.resize(np.asarray(omega, dtype=float), blocks * lanes)
    padded[len(omega) :] = omega[-1:]
    found = np.empty((blocks, len(wanted), ROWS, lanes))

    def run(worker: int) -> None:
        memory = np.zeros((tape.slots, ROWS, lanes))
        for block in range(worker, blocks, workers):
            run_tape(tape.rows, tape.numbers, padded[block * lanes : (block + 1) * lanes], memory)
            found[block] = memory[tape.places]

    limited = hasattr(os, "sched_getaffinity")  # the cores that this process may use
    cores = len(os.sched_getaffinity(0)) if limited else os.cpu_count() or 1
    workers = max(1, min(blocks, cores))
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, range(workers)))
    rows = found.transpose(2, 0, 3, 1).reshape(ROWS, blocks * lanes, len(wanted))[:, : len(omega)]
    values = np.empty(rows.shape[1:], dtype=np.complex128)
    values.real, values.imag = rows[0] + rows[1], rows[2] + rows[3]
    return values, rows[5]
