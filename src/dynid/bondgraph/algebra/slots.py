"""The order in which instructions are run, and the slots of memory they write to."""

from __future__ import annotations

import numpy as np

from dynid.bondgraph.algebra.doubled import Code, Integers, compiled

_LOAD = int(Code.LOAD)
_SHALLOW = 4  # operations above a leaf


@compiled
def ordered(codes: Integers, operands: Integers, wanted: Integers) -> Integers:
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
def assigned(operands: Integers, order: Integers, wanted: Integers) -> tuple[Integers, int]:
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
