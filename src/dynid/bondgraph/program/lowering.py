"""From the registers of a program to instructions of a tape.

Whatever is a real number times a power of s is worked out once. What is left are sums, products and
reciprocals of registers, and sums of a register and such a monomial.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.program.doubled import (
    POWERS,
    Array,
    Integers,
    Real,
    TapeOperation,
    compiled,
    real_product,
    real_reciprocal,
    real_sum,
)
from dynid.bondgraph.program.program import Operation

_LAPLACE, _ADD, _SUB, _MUL, _DIV, _NEG = (int(op) for op in tuple(Operation)[2:])
_LOAD, _SHIFT, _PLUS, _MINUS, _TIMES, _INVERSE, _OPPOSITE = (int(code) for code in TapeOperation)
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


@compiled
def lower_program(registers: RegisterArrays, wanted: Integers) -> tuple[InstructionListing, Integers]:
    """Return the instructions that compute registers, and the places of those wanted."""
    count = len(registers.codes)
    needed = _needed(registers, wanted)
    power = _monomials(registers, needed)
    draft = _blank(count, 3 * count + len(wanted))
    for register in range(count):
        if needed[register] and power[register] == _GENERAL:
            draft.place[register] = _operation(registers, power, register, draft)
    for register in wanted:
        _operand(registers, power, register, draft)
    end, (codes, operands, numbers, powers) = draft.length[0], draft.listing
    return InstructionListing(codes[:end], operands[:end], numbers[:end], powers[:end]), draft.place[wanted]


@compiled
def _needed(registers: RegisterArrays, wanted: Integers) -> NDArray[np.bool_]:
    """Mark the registers that the wanted depend on."""
    needed = np.zeros(len(registers.codes), np.bool_)
    needed[wanted] = True
    for register in range(len(registers.codes) - 1, -1, -1):
        if needed[register] and registers.codes[register] >= _ADD:
            needed[registers.first[register]] = True
            if registers.codes[register] != _NEG:
                needed[registers.second[register]] = True
    return needed


# --- monomials ------------------------------------------------------------------------------------------


@compiled
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
        power[register] = _power(op, power[one], power[other])
        if power[register] != _GENERAL:
            a, b = numbers[one], numbers[other]
            x = _number(op, (a[0], a[1], a[2]), (b[0], b[1], b[2]))
            numbers[register, 0], numbers[register, 1], numbers[register, 2] = x
    return power


@compiled
def _power(op: int, one: int, other: int) -> int:
    """Return the power of s of a sum, product or quotient of monomials of these powers."""
    if one == _GENERAL or other == _GENERAL or (op in (_ADD, _SUB) and one != other):
        return _GENERAL
    power = one + other if op == _MUL else one - other if op == _DIV else one
    return power if abs(power) <= POWERS else _GENERAL


@compiled
def _number(op: int, x: Real, y: Real) -> Real:
    """Return the number of a sum, product or quotient of monomials with these numbers."""
    if op == _MUL:
        return real_product(x, y)
    if op == _DIV:
        return real_product(x, real_reciprocal(y))
    if op == _NEG:
        return -x[0], -x[1], x[2]
    return real_sum(x, y if op == _ADD else (-y[0], -y[1], y[2]))


# --- instructions ---------------------------------------------------------------------------------------


@compiled
def _blank(registers: int, most: int) -> _Draft:
    """Return an empty listing with room for some instructions."""
    operands, numbers = np.empty((most, 2), np.int64), np.zeros((most, 3))
    listing = InstructionListing(np.empty(most, np.int64), operands, numbers, np.zeros(most, np.int64))
    return _Draft(listing, np.zeros(1, np.int64), np.full(registers, -1), np.full(registers, -1))


@compiled
def _put(draft: _Draft, code: int, one: int, other: int) -> int:
    """Write an instruction; return its place."""
    at: int = draft.length[0]
    draft.listing.codes[at] = code
    draft.listing.operands[at, 0], draft.listing.operands[at, 1] = one, other
    draft.length[0] = at + 1
    return at


@compiled
def _put_monomial(draft: _Draft, code: int, one: int, number: Array, sign: float, power: int) -> int:
    """Write an instruction that reads a monomial; return its place."""
    at = _put(draft, code, one, one)
    parts = draft.listing.numbers[at]
    parts[0], parts[1], parts[2] = sign * number[0], sign * number[1], number[2]
    draft.listing.powers[at] = power
    return at


@compiled
def _operand(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
    """Return the instruction that gives a register; a monomial is loaded where it is first read."""
    at: int = draft.place[register]
    if at < 0:
        at = draft.length[0]  # a load names itself
        draft.place[register] = at
        _put_monomial(draft, _LOAD, at, registers.numbers[register], 1.0, power[register])
    return at


@compiled
def _operation(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
    """Write what computes a register from its operands; return its place."""
    op, a, b = registers.codes[register], registers.first[register], registers.second[register]
    if op == _DIV:
        return _quotient(registers, power, register, draft)
    if op in (_ADD, _SUB):
        return _sum(registers, power, register, draft)
    one = _operand(registers, power, a, draft)
    if op == _NEG:
        return _put(draft, _OPPOSITE, one, one)
    return _put(draft, _TIMES, one, _operand(registers, power, b, draft))


@compiled
def _quotient(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
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


@compiled
def _sum(registers: RegisterArrays, power: Integers, register: int, draft: _Draft) -> int:
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
