"""Reduction programs run in doubled precision at many frequencies.

Where the library is, the program is compiled to a tape first (`native/tape.c`): whatever in it is a real
number times a power of s is worked out once, and what is left becomes sums, products and reciprocals, in an
order in which few values are alive at a time, each with a slot of memory that is reused as soon as its value
is no longer needed. The tape runs block of frequencies by block, on all cores
(`docs/theory/reduction_programs.md`). Without the library the program itself runs on `DoubledComplex`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.bondgraph.program.doubled import DoubledComplex, doubled_reals
from dynid.bondgraph.program.program import Operation, Program, Register
from dynid.native import call, compiled

#: Frequencies in a block of the library (`native/doubled.c`): a few cache lines of each row, so that the
#: registers alive stay in the cache; and in a block of NumPy, whose calls cost more than their arithmetic.
_BLOCK, _NUMPY_BLOCK = 64, 1024
#: Rows of a register: high and low part of the real and the imaginary part, modulus, error bound.
_REGISTER_ROWS = 6


class _InstructionTape(NamedTuple):
    """The instructions that the library runs."""

    #: Operation, first and second operand, target (slots of the memory), and power of s in the monomial.
    rows: NDArray[np.int64]
    numbers: Array  # high part, low part and error bound of the monomial of each row
    places: NDArray[np.int64]  # the slot of each requested register
    slots: int  # how many slots there are


def compile_tape(
    program: Program, registers: Sequence[Register], value: Callable[[str], Fraction]
) -> _InstructionTape:
    """Return the tape that computes some registers."""
    codes, first, second, names = program.arrays()
    leaves = np.zeros((len(codes), 3))
    leaves[program.s, 0] = 1.0
    constants, parameters = (np.flatnonzero(codes == op) for op in (Operation.CONSTANT, Operation.PARAMETER))
    leaves[constants] = doubled_reals(first[constants].tolist())
    leaves[parameters] = doubled_reals([value(names[name]) for name in first[parameters].tolist()])
    first[codes <= Operation.LAPLACE] = 0
    requested = np.array(registers, dtype=np.int64)
    room = 3 * len(codes) + len(requested)
    rows, numbers = np.empty((room, 5), np.int64), np.empty((room, 3))
    places, sizes = np.empty(len(requested), np.int64), np.empty(2, np.int64)
    call(
        "dynid_tape", len(codes), codes, first, second, leaves, len(requested), requested,
        rows, numbers, places, sizes,
    )  # fmt: skip
    length, slots = sizes.tolist()
    return _InstructionTape(rows[:length], numbers[:length], places, slots)


def sweep_frequencies(
    program: Program,
    registers: Sequence[Register],
    value: Callable[[str], Fraction],
    omega: NDArray[np.float64],
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Return registers at s = j omega, and bounds on the moduli of their errors.

    Memory is that of the registers alive at a time, for one block of frequencies a thread; the blocks are
    independent, so that the result does not depend on their number or on the threads.

    Returns
    -------
    values, bounds
        Both of shape (omega, register).
    """
    omega = np.asarray(omega, dtype=float)
    run = _by_library if compiled() else _by_numpy
    rows = run(program, registers, value, omega)
    values = np.empty((len(omega), len(registers)), dtype=np.complex128)
    values.real, values.imag = rows[0] + rows[1], rows[2] + rows[3]
    return values, rows[5]


def _by_library(
    program: Program, registers: Sequence[Register], value: Callable[[str], Fraction], omega: Array
) -> Array:
    """Return the rows of the registers, shape (6, omega, register)."""
    tape = compile_tape(program, registers, value)
    blocks = -(-len(omega) // _BLOCK)
    padded = np.resize(omega, blocks * _BLOCK)
    padded[len(omega) :] = omega[-1:]
    blocks_of_rows = np.empty((blocks, len(registers), _REGISTER_ROWS, _BLOCK))

    def run(worker: int) -> None:
        memory = np.zeros((tape.slots, _REGISTER_ROWS, _BLOCK))
        for block in range(worker, blocks, workers):
            frequencies = padded[block * _BLOCK : (block + 1) * _BLOCK]
            call("dynid_run_tape", len(tape.rows), tape.rows, tape.numbers, frequencies, memory)
            blocks_of_rows[block] = memory[tape.places]

    limited = hasattr(os, "sched_getaffinity")  # the cores that this process may use
    cores = len(os.sched_getaffinity(0)) if limited else os.cpu_count() or 1
    workers = max(1, min(blocks, cores))
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(run, range(workers)))
    return blocks_of_rows.transpose(2, 0, 3, 1).reshape(_REGISTER_ROWS, blocks * _BLOCK, len(registers))[
        :, : len(omega)
    ]


def _by_numpy(
    program: Program, registers: Sequence[Register], value: Callable[[str], Fraction], omega: Array
) -> Array:
    """Return the rows of the registers, shape (6, omega, register)."""
    values = {name: DoubledComplex.real(value(name)) for name in program.parameters(registers)}
    unity, rows = DoubledComplex.real(1), np.empty((_REGISTER_ROWS, len(omega), len(registers)))
    with np.errstate(all="ignore"):  # what overflows has no finite bound
        for start in range(0, len(omega), _NUMPY_BLOCK):
            block = omega[start : start + _NUMPY_BLOCK]
            run = program.run(registers, values, DoubledComplex.on_axis(block), unity)
            for column, register in enumerate(registers):
                rows[:, start : start + _NUMPY_BLOCK, column] = run[register].rows
    return rows
