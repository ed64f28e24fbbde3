"""The compiler of reduction programs: order and memory slots of the instructions, and the parallel run.

A program becomes a tape: instructions (`lowering`) in an order in which few values are alive at a time, each
with a slot of memory that is reused as soon as its value is no longer needed. The tape runs in doubled
precision, block of frequencies by block, on all cores (`docs/theory/reduction_programs.md`).
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

from dynid.bondgraph.program.doubled import LANES, ROWS, Array, Integers, TapeOperation, compiled, run_tape
from dynid.bondgraph.program.lowering import RegisterArrays, lower_program
from dynid.bondgraph.program.program import Operation, Program, Register

# --- order and slots ------------------------------------------------------------------------------

_LOAD = int(TapeOperation.LOAD)
_SHALLOW = 4  # operations above a leaf


@compiled
def instruction_order(codes: Integers, operands: Integers, wanted: Integers) -> Integers:
    """Return an order of the instructions in which few are alive at a time.

    It is the one in which they are written, but what is near the leaves (the immittance of an element, say)
    comes only when it is asked for, or not at all.
    """
    count = len(codes)
    root = _depths(codes, operands) > _SHALLOW
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
                for operand in operands[at]:
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


@compiled
def _depths(codes: Integers, operands: Integers) -> Integers:
    """Return how many operations lie above the leaves of each instruction."""
    depth = np.zeros(len(codes), np.int64)
    for at in range(len(codes)):
        if codes[at] != _LOAD:
            depth[at] = 1 + max(depth[operands[at, 0]], depth[operands[at, 1]])
    return depth


@compiled
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
    listing, places = lower_program(_registers(program, value), np.array(wanted, dtype=np.int64))
    order = instruction_order(listing.codes, listing.operands, places)
    slot, slots = allocate_slots(listing.operands, order, places)
    rows = np.column_stack((listing.codes, slot[listing.operands], slot, listing.powers))
    return InstructionTape(rows[order], listing.numbers[order], slot[places], slots)


def _registers(program: Program, value: Callable[[str], Fraction]) -> RegisterArrays:
    """Return the registers of a program as arrays, with the numbers of its leaves."""
    ops, count = program.ops, len(program.ops)
    codes = np.fromiter(map(itemgetter(0), ops), np.int64, count)
    first = list(map(itemgetter(1), ops))
    numbers = np.zeros((count, 3))
    numbers[program.s, 0] = 1.0
    leaves = np.flatnonzero(codes < Operation.LAPLACE)
    read = [ops[leaf] for leaf in leaves.tolist()]
    exact = (value(name) if op is Operation.PARAMETER else name for op, name, _ in read)
    parts = chain.from_iterable(_doubled(number) for number in exact)
    numbers[leaves] = np.fromiter(parts, np.float64, 3 * len(leaves)).reshape(-1, 3)
    for leaf in (program.s, *leaves.tolist()):  # a name, or a number
        first[leaf] = 0
    second = map(itemgetter(2), ops)
    one, other = (np.fromiter(operands, np.int64, count) for operands in (first, second))
    return RegisterArrays(codes, one, other, numbers)


def _doubled(exact: Fraction | int) -> tuple[float, float, float]:
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
        RegisterArrays to return.
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
    blocks = -(-len(omega) // LANES)
    padded = np.resize(omega, blocks * LANES) if blocks else omega
    padded[len(omega) :] = omega[-1:]
    found = np.empty((blocks, len(wanted), ROWS, LANES))

    def run(worker: int) -> None:
        memory = np.zeros((tape.slots, ROWS * LANES))
        for block in range(worker, blocks, workers):
            run_tape(tape.rows, tape.numbers, padded[block * LANES : (block + 1) * LANES], memory)
            found[block] = memory[tape.places].reshape(-1, ROWS, LANES)

    workers = max(1, min(blocks, _cores()))
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, range(workers)))
    rows = found.transpose(2, 0, 3, 1).reshape(ROWS, blocks * LANES, len(wanted))[:, : len(omega)]
    values = np.empty(rows.shape[1:], dtype=np.complex128)
    values.real, values.imag = rows[0] + rows[1], rows[2] + rows[3]
    return values, rows[5]


def _cores() -> int:
    """Return how many cores this process may use; where the system does not say, how many there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
