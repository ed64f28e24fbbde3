"""Run a program at many frequencies in doubled precision, block by block, on all cores."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.algebra.doubled import LANES, ROWS, evaluate
from dynid.bondgraph.algebra.tape import schedule
from dynid.bondgraph.reduction.program import Program, Register


def sweep(
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
    tape = schedule(program, wanted, value)
    blocks = -(-len(omega) // LANES)
    padded = np.resize(omega, blocks * LANES) if blocks else omega
    padded[len(omega) :] = omega[-1:]
    found = np.empty((blocks, len(wanted), ROWS, LANES))

    def run(worker: int) -> None:
        memory = np.zeros((tape.slots, ROWS * LANES))
        for block in range(worker, blocks, workers):
            evaluate(tape.rows, tape.numbers, padded[block * LANES : (block + 1) * LANES], memory)
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
