"""The order in which a program is run with few registers alive, and the slots of memory they take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.algebra.doubled import compiled
from dynid.bondgraph.reduction.program import Op, Program

Integers = NDArray[np.int64]

_FIRST = int(Op.ADD)  # operations from here on read registers
_NEG = int(Op.NEG)
_SHALLOW = 4  # operations above a leaf


def schedule(program: Program, wanted: Sequence[int]) -> tuple[Integers, Integers, int]:
    """Return the tape that computes some registers, where it leaves them, and how many slots it needs.

    Returns
    -------
    tape
        Rows of operation, first and second operand (slots; for a constant its register), and target slot.
    places
        The slot of each wanted register.
    slots
        Number of slots.
    """
    ops = program.ops
    codes = np.fromiter((op for op, _, _ in ops), dtype=np.int64, count=len(ops))
    first = np.fromiter((a if op >= _FIRST else 0 for op, a, _ in ops), dtype=np.int64, count=len(ops))
    second = np.fromiter((b for _, _, b in ops), dtype=np.int64, count=len(ops))
    second[codes == _NEG] = first[codes == _NEG]
    return _allocate(codes, first, second, np.array(wanted, dtype=np.int64))


@compiled
def _allocate(
    codes: Integers, first: Integers, second: Integers, wanted: Integers
) -> tuple[Integers, Integers, int]:
    count = len(codes)
    depth = np.zeros(count, np.int64)
    for register in range(count):
        if codes[register] >= _FIRST:
            depth[register] = 1 + max(depth[first[register]], depth[second[register]])
    needed = np.zeros(count, np.bool_)
    uses = np.zeros(count, np.int64)
    for register in wanted:
        needed[register] = True
        uses[register] += 1  # never freed
    for register in range(count - 1, -1, -1):
        if needed[register] and codes[register] >= _FIRST:
            needed[first[register]] = needed[second[register]] = True
    # as written, but what is near the leaves (the immittance of an element, say) only when it is asked for
    order = np.empty(count, np.int64)
    done = 0
    state = np.zeros(count, np.int8)  # 1: waits for its operands, 2: in order
    stack = np.empty(2 * count + 2, np.int64)
    for root in range(count):
        if not needed[root] or (depth[root] <= _SHALLOW and uses[root] == 0):
            continue
        top = 0
        stack[0] = root
        while top >= 0:
            register = stack[top]
            if state[register] == 2:
                top -= 1
            elif state[register] == 1 or codes[register] < _FIRST:
                state[register] = 2
                order[done] = register
                done += 1
                top -= 1
            else:
                state[register] = 1
                one, other = first[register], second[register]
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
    tape = np.empty((done, 4), np.int64)
    for step in range(done):
        register = order[step]
        if available:
            available -= 1
            slot[register] = free[available]
        else:
            slot[register] = slots
            slots += 1
        tape[step, 0] = codes[register]
        tape[step, 3] = slot[register]
        if codes[register] < _FIRST:
            tape[step, 1] = tape[step, 2] = register
            continue
        one, other = first[register], second[register]
        tape[step, 1], tape[step, 2] = slot[one], slot[other]
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
    return tape, slot[wanted], slots
