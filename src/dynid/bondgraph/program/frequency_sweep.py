"""Reduction programs run in doubled precision at many frequencies.

Where the library is, the program is compiled to a tape first (`native/tape.c`): whatever in it is a real
number times a power of s is worked out once, and what is left becomes sums, products and reciprocals, in an
order in which few values are alive at a time, each with a slot of memory that is reused as soon as its value
is no longer needed. The tape runs block of frequencies by block, on all cores
(`docs/theory/reduction_programs.md`). Without the library the program itself runs on `_BoundedDoubled`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array
from dynid.bondgraph.program.program import Operation, Program, Register
from dynid.lti.doubled import DoubledComplex, two_product
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
    leaves[constants] = _doubled_reals(first[constants].tolist())
    leaves[parameters] = _doubled_reals([value(names[name]) for name in first[parameters].tolist()])
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

    Both are of shape (omega, register).
    """
    omega = np.asarray(omega, dtype=float)
    values = np.empty((len(omega), len(registers)), dtype=np.complex128)
    bounds = np.empty(values.shape)
    run = _by_library if compiled() else _by_numpy
    run(program, registers, value, omega, values, bounds)
    return values, bounds


def _by_library(
    program: Program,
    registers: Sequence[Register],
    value: Callable[[str], Fraction],
    omega: Array,
    values: NDArray[np.complex128],
    bounds: Array,
) -> None:
    key = [*registers], value
    if program.compiled_tape is None or program.compiled_tape[0] != key:
        program.compiled_tape = key, compile_tape(program, registers, value)
    tape = program.compiled_tape[1]
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
    shape = (_REGISTER_ROWS, blocks * _BLOCK, len(registers))
    rows = blocks_of_rows.transpose(2, 0, 3, 1).reshape(shape)[:, : len(omega)]
    values.real, values.imag, bounds[:] = rows[0] + rows[1], rows[2] + rows[3], rows[5]


def _by_numpy(
    program: Program,
    registers: Sequence[Register],
    value: Callable[[str], Fraction],
    omega: Array,
    values: NDArray[np.complex128],
    bounds: Array,
) -> None:
    exact = {name: _BoundedDoubled.real(value(name)) for name in program.parameters(registers)}
    unity = _BoundedDoubled.real(1)
    with np.errstate(all="ignore"):  # what overflows has no finite bound
        for start in range(0, len(omega), _NUMPY_BLOCK):
            rows = slice(start, start + _NUMPY_BLOCK)
            run = program.run(registers, exact, _BoundedDoubled.on_axis(omega[rows]), unity)
            for column, register in enumerate(registers):
                values[rows, column] = run[register].value.rounded
                bounds[rows, column] = run[register].error


# --- numbers of NumPy -----------------------------------------------------------------------------

# Relative error bounds of the operations: several times what an analysis of the algorithms gives (a sum 3, a
# product 19, a reciprocal about 100 units of 2^-106), so that no rounding of the bounds themselves counts.
_SUM_ERROR, _PRODUCT_ERROR, _RECIPROCAL_ERROR = 2.0**-102, 2.0**-100, 2.0**-97
#: Absolute error of a product or reciprocal whose parts fall below the range of doubles.
_UNDERFLOW_ERROR = 2.0**-1068
# Squared moduli that can be trusted: beyond them the square, or its low part, leaves the range of doubles.
_MIN_SQUARE, _MAX_SQUARE = 2.0**-900, 2.0**900
#: A divisor with a larger relative error (nine digits of 31) is taken for one that may be zero.
_MAX_DIVISOR_ERROR = 2.0**-30
#: By how much an error of that size makes the bound of a reciprocal larger.
_RECIPROCAL_SLACK = 1.0 + 2.0**-29
#: Relative and absolute error of an exact number that is stored in two doubles.
_STORED_ERROR, _STORED_UNDERFLOW = 2.0**-104, 2.0**-1070


class _BoundedDoubled:
    """Numbers of twice the usual precision with their moduli and bounds on the moduli of their errors.

    The bounds follow the moduli, so that they do not grow where the errors do not; a divisor that may be zero
    makes them infinite. `native/doubled.c` computes the same many times faster.
    """

    __slots__ = ("error", "modulus", "value")

    def __init__(self, value: DoubledComplex, modulus: Array, error: Array) -> None:
        self.value, self.modulus, self.error = value, modulus, error

    @classmethod
    def real(cls, number: Fraction | int) -> _BoundedDoubled:
        high, low, error = _doubled_reals([number]).T
        value = DoubledComplex.of(high.astype(complex))
        value.real.low[:] = low
        return cls(value, np.abs(high), error)

    @classmethod
    def on_axis(cls, omega: Array) -> _BoundedDoubled:
        """Return the numbers j omega, exactly."""
        return cls(DoubledComplex.of((1j * omega).astype(np.complex128)), np.abs(omega), np.zeros_like(omega))

    def __neg__(self) -> _BoundedDoubled:
        return _BoundedDoubled(-self.value, self.modulus, self.error)

    def __add__(self, other: _BoundedDoubled) -> _BoundedDoubled:
        value = self.value + other.value
        re, im = value.real.high, value.imag.high
        square = re * re + im * im
        # the sum of the parts where their squares would leave the range
        fits = (square > _MIN_SQUARE) & (square < _MAX_SQUARE)
        modulus = np.where(fits, np.sqrt(square), abs(re) + abs(im))
        error = self.error + other.error + _SUM_ERROR * (self.modulus + other.modulus)
        return _BoundedDoubled(value, modulus, error)

    def __sub__(self, other: _BoundedDoubled) -> _BoundedDoubled:
        return self + -other

    def __mul__(self, other: _BoundedDoubled | int) -> _BoundedDoubled:
        if isinstance(other, int):
            other = _BoundedDoubled.real(other)
        modulus = self.modulus * other.modulus
        error = self.modulus * other.error + self.error * (other.modulus + other.error)
        error = error + (_PRODUCT_ERROR * modulus + _UNDERFLOW_ERROR)
        return _BoundedDoubled(self.value * other.value, modulus, error)

    def __truediv__(self, other: _BoundedDoubled) -> _BoundedDoubled:
        return self * other._reciprocal()

    def _reciprocal(self) -> _BoundedDoubled:
        """Return 1 / z; the bound is infinite where z may be zero, or too large or small to be squared."""
        high, modulus, error = self.value.rounded, self.modulus, self.error
        square = high.real * high.real + high.imag * high.imag
        inverse = 1.0 / square
        start = DoubledComplex.of(high.conj() * inverse)
        rest = DoubledComplex.of(np.ones_like(high)) - self.value * start  # 1 - z u
        size = modulus * inverse
        sound = (error <= _MAX_DIVISOR_ERROR * modulus) & (square > _MIN_SQUARE) & (square < _MAX_SQUARE)
        bound = _RECIPROCAL_SLACK * error * inverse + (_RECIPROCAL_ERROR * size + _UNDERFLOW_ERROR)
        return _BoundedDoubled(start + rest * start, size, np.where(sound, bound, np.inf))


def _doubled_reals(exact: Sequence[Fraction | int]) -> Array:
    """Return numbers as sums of two doubles, with bounds on what they miss; shape (numbers, 3)."""
    above, below = zip(*(number.as_integer_ratio() for number in exact), strict=True) if exact else ((), ())
    if max(map(abs, chain(above, below)), default=2**53) >= 2**53:
        return np.array([_doubled_real(number) for number in exact]).reshape(-1, 3)
    numerator, denominator = np.array(above, dtype=float), np.array(below, dtype=float)
    high = numerator / denominator
    product, error = two_product(high, denominator)
    low = (numerator - product - error) / denominator  # what is left of the numerator is exact
    return np.column_stack((high, low, _STORED_ERROR * abs(high) + _STORED_UNDERFLOW))


def _doubled_real(exact: Fraction | int) -> tuple[float, float, float]:
    numerator, denominator = exact.as_integer_ratio()
    try:
        high = numerator / denominator
        above, below = high.as_integer_ratio()
        low = (numerator * below - above * denominator) / (denominator * below)
    except OverflowError:
        return np.inf, 0.0, np.inf
    return high, low, _STORED_ERROR * abs(high) + _STORED_UNDERFLOW
