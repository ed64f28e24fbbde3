"""From a program to a tape: what is run at every frequency, in which order, and in which slots of memory."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import chain
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from dynid.bondgraph.algebra.doubled import Array, Integers
from dynid.bondgraph.algebra.lowering import Registers, lowered
from dynid.bondgraph.algebra.slots import assigned, ordered
from dynid.bondgraph.reduction.program import Op, Program


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
    listing, places = lowered(_registers(program, value), np.array(wanted, dtype=np.int64))
    order = ordered(listing.codes, listing.operands, places)
    slot, slots = assigned(listing.operands, order, places)
    rows = np.column_stack((listing.codes, slot[listing.operands], slot, listing.powers))
    return Tape(rows[order], listing.numbers[order], slot[places], slots)


def _registers(program: Program, value: Callable[[str], Fraction]) -> Registers:
    """Return the registers of a program as arrays, with the numbers of its leaves."""
    ops, count = program.ops, len(program.ops)
    codes = np.fromiter(map(itemgetter(0), ops), np.int64, count)
    first = list(map(itemgetter(1), ops))
    numbers = np.zeros((count, 3))
    numbers[program.s, 0] = 1.0
    leaves = np.flatnonzero(codes < Op.LAPLACE)
    read = [ops[leaf] for leaf in leaves.tolist()]
    exact = (value(name) if op is Op.PARAMETER else name for op, name, _ in read)
    parts = chain.from_iterable(_doubled(number) for number in exact)
    numbers[leaves] = np.fromiter(parts, np.float64, 3 * len(leaves)).reshape(-1, 3)
    for leaf in (program.s, *leaves.tolist()):  # a name, or a number
        first[leaf] = 0
    second = map(itemgetter(2), ops)
    one, other = (np.fromiter(operands, np.int64, count) for operands in (first, second))
    return Registers(codes, one, other, numbers)


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
