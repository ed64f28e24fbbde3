"""Straight-line reduction programs over any number type, and their derivatives.

A reduction writes its arithmetic down once, as a list of operations on registers, never expanded and
with every common subexpression shared. Running the program on complex arrays gives a frequency
response, on exact rational functions a transfer function, on polynomials a formula; no physics is
written twice. Reverse accumulation over the same operations (Griewank & Walther, *Evaluating Derivatives*,
ch. 3) gives all partial derivatives of one register for a few times the work of one run.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import compress
from operator import itemgetter
from typing import Any, TypeVar

# --- programs -------------------------------------------------------------------------------------


#: A number type that a program can be run on: it has +, -, *, / and the opposite.
N = TypeVar("N", bound=Any)


class Operation(IntEnum):
    """The operations of a program."""

    CONSTANT = 0  # an integer
    PARAMETER = 1  # the value of a node
    LAPLACE = 2  # the variable s
    ADD = 3
    SUB = 4
    MUL = 5
    DIV = 6
    NEG = 7


#: Looked up once: planning compares operations millions of times.
_CONSTANT, _PARAMETER, _LAPLACE, _ADD, _SUB, _MUL, _DIV, _NEG = tuple(Operation)

Register = int

#: Registers among which equal values are looked for: two of them are mistaken for equal with a probability of
#: about the square of this, times their degree, over the prime.
_MAX_COMPARED_VALUES = 20_000


@dataclass(frozen=True)
class ModularPoint:
    """A point modulo a prime: residues (flint `nmod`, whose inverses are cheap) of the parameters and s.

    `general`: it is random, and what holds there holds for all values. `one`: the number 1 of its residues,
    where they are not `nmod`.
    """

    prime: int
    values: Mapping[str, Any]
    laplace: Any
    general: bool = False
    one: Any = None

    def residue(self, value: int) -> Any:
        """Return an integer modulo the prime."""
        from flint import nmod

        return nmod(value, self.prime) if self.one is None else self.one * value


class Program:
    """A growing list of operations; equal operations share a register, and so does what is always equal.

    `point`: a point modulo a large prime at which every register is evaluated as it is written. One that is
    identically zero vanishes at a random point; one that is not does so with a probability of about its
    degree over the prime. So "identically zero" is known without numbers.
    """

    #: The tape that was run last, with its registers and values: responses are evaluated again around peaks.
    compiled_tape: tuple[Any, Any] | None = None

    def __init__(self, point: ModularPoint) -> None:
        self.ops: list[tuple[Operation, Any, int]] = []
        self._images: list[Any] = []
        self._known: dict[tuple[Operation, Any, int], Register] = {}
        self._by_value: dict[int, Register] = {}
        self._point = point
        self.zero = self.constant(0)
        self.one = self.constant(1)
        self.s = self._emit(_LAPLACE, None, 0, point.laplace)

    # --- writing -------------------------------------------------------------------------------

    def constant(self, value: int) -> Register:
        """Write an integer."""
        return self._emit(_CONSTANT, value, 0, self._point.residue(value))

    def parameter(self, name: str) -> Register:
        """Write the value of a node."""
        return self._emit(_PARAMETER, name, 0, self._point.values[name])

    def add(self, a: Register, b: Register) -> Register:
        """Write a + b."""
        if a == self.zero:
            return b
        if b == self.zero:
            return a
        if self.ops[b][0] is _NEG:
            return self.sub(a, self.ops[b][1])
        if self.ops[a][0] is _NEG:
            return self.sub(b, self.ops[a][1])
        return self._emit(_ADD, a, b, self._images[a] + self._images[b])

    def sub(self, a: Register, b: Register) -> Register:
        """Write a - b."""
        if b == self.zero:
            return a
        if a == self.zero:
            return self.neg(b)
        if self.ops[b][0] is _NEG:
            return self.add(a, self.ops[b][1])
        return self.zero if a == b else self._emit(_SUB, a, b, self._images[a] - self._images[b])

    def neg(self, a: Register) -> Register:
        """Write -a."""
        if a == self.zero:
            return a
        op, inner, _ = self.ops[a]
        return int(inner) if op is _NEG else self._emit(_NEG, a, 0, -self._images[a])

    def mul(self, a: Register, b: Register) -> Register:
        """Write a * b; a sign moves outwards, a division by the other factor disappears."""
        if a == self.zero or b == self.zero:
            return self.zero
        if a == self.one:
            return b
        if b == self.one:
            return a
        first, second = self.ops[a], self.ops[b]
        if first[0] is _NEG:
            return self.neg(self.mul(first[1], b))
        if second[0] is _NEG:
            return self.neg(self.mul(a, second[1]))
        if first[0] is _DIV and first[1] == self.one:
            return self.div(b, first[2])
        if second[0] is _DIV and second[1] == self.one:
            return self.div(a, second[2])
        return self._emit(_MUL, a, b, self._images[a] * self._images[b])

    def div(self, a: Register, b: Register) -> Register:
        """Write a / b; a division by a quotient becomes a product, so that no 1/(1/x) is ever formed."""
        if not self._images[b]:
            raise ZeroDivisionError
        if a == self.zero or b == self.one:
            return a
        if a == b:
            return self.one
        first, (op, numerator, denominator) = self.ops[a], self.ops[b]
        if first[0] is _NEG:
            return self.neg(self.div(first[1], b))
        if op is _NEG:
            return self.neg(self.div(a, numerator))
        if op is _DIV:
            if numerator == self.one:
                return self.mul(a, denominator)
            return self.div(self.mul(a, denominator), numerator)
        return self._emit(_DIV, a, b, self._images[a] / self._images[b])

    def inv(self, a: Register) -> Register:
        """Write 1 / a."""
        return self.div(self.one, a)

    def sum(self, terms: Iterable[Register]) -> Register:
        """Write the sum of terms, in order."""
        total = self.zero
        for term in terms:
            total = self.add(total, term)
        return total

    def product(self, factors: Iterable[Register]) -> Register:
        """Write the product of factors, in order."""
        total = self.one
        for factor in factors:
            total = self.mul(total, factor)
        return total

    def determinant(self, pivots: Iterable[Register], integrators: int) -> Register:
        """Write the determinant of a nodal form: the pivots, times s for every storage that integrates."""
        return self.product([*pivots, *[self.s] * integrators])

    def are_opposite(self, a: Register, b: Register) -> bool:
        """Test whether the sum of two registers is identically zero."""
        return not (self._images[a] + self._images[b])

    def is_zero(self, a: Register) -> bool:
        """Test whether a register is identically zero (as far as the random point shows)."""
        return not self._images[a]

    @property
    def prime(self) -> int:
        """The prime that images are taken modulo."""
        return self._point.prime

    def image(self, a: Register) -> Any:
        """Return the value of a register at the point: a residue modulo its prime."""
        return self._images[a]

    def _emit(self, op: Operation, a: Any, b: int, image: Any) -> Register:
        entry = (op, a, b)
        key = (op, b, a) if (op is _ADD or op is _MUL) and b < a else entry
        following = len(self.ops)
        register = self._known.setdefault(key, following)
        if register == following:
            if (
                self._point.general and following < _MAX_COMPARED_VALUES
            ):  # look for this value, or its opposite
                value = int(image)
                equal = self._by_value.setdefault(value, following)
                opposite = self._by_value.get(self._point.prime - value)
                if equal < following and op >= _ADD:
                    self._known[key] = equal
                    return equal
                if equal == following and opposite is not None and op >= _ADD and op is not _NEG:
                    del self._by_value[value]
                    negative = self._known[key] = self.neg(opposite)
                    return negative
            self.ops.append(entry)
            self._images.append(image)
        return register

    def __len__(self) -> int:
        return len(self.ops)

    def arrays(self) -> tuple[Any, Any, Any, Sequence[str]]:
        """Return operations and operands as arrays; the first of a parameter is its place in the names.

        Codes, first and second operands are arrays of integers of shape (register,), and names of nodes.
        """
        import numpy as np

        codes, first, second = (list(map(itemgetter(field), self.ops)) for field in range(3))
        first[self.s] = 0
        names: list[str] = []
        for register, code in enumerate(codes):
            if code is _PARAMETER:
                names.append(first[register])
                first[register] = len(names) - 1
        first_operands, second_operands = np.array(first, dtype=np.int64), np.array(second, dtype=np.int64)
        return np.array(codes, dtype=np.int64), first_operands, second_operands, names

    def behind(self, registers: Iterable[Register]) -> list[Register]:
        """Return registers and those that they depend on, in order."""
        requested, ops = list(registers), self.ops
        needed = bytearray(max(requested, default=-1) + 1)
        for register in requested:
            needed[register] = 1
        for register in range(len(needed) - 1, -1, -1):
            if needed[register]:
                op, a, b = ops[register]
                if op >= _ADD:
                    needed[a] = 1
                    if op is not _NEG:
                        needed[b] = 1
        return list(compress(range(len(needed)), needed))

    def parameters(self, registers: Iterable[Register]) -> set[str]:
        """Return the nodes whose values the wanted registers are made of."""
        ops = (self.ops[register] for register in self.behind(registers))
        return {str(name) for op, name, _ in ops if op is _PARAMETER}

    def vanishing(
        self, registers: Iterable[Register], divisors: Iterable[Register], point: ModularPoint
    ) -> bool:
        """Test whether at another point a divisor is zero: one of these, or one on the way to the wanted."""
        divisors, numbers = list(divisors), (point.values, point.laplace, point.residue(1))
        try:
            values = self.run(range(len(self.ops)), *numbers)
        except ZeroDivisionError:  # but what nobody needs may be infinite
            try:
                values = self.run([*registers, *divisors], *numbers)
            except ZeroDivisionError:
                return True
        return not all(values[divisor] for divisor in divisors)

    def run(
        self, registers: Iterable[Register], values: Mapping[str, N], laplace: N, unity: N
    ) -> dict[Register, N]:
        """Run the part of the program that registers need once (`Tape.run`)."""
        requested = list(registers)
        return dict(zip(requested, Tape(self, requested).run(values, laplace, unity), strict=True))


def operands(op: Operation, a: Any, b: int) -> tuple[Register, ...]:
    """Return the registers that an operation reads."""
    if op <= _LAPLACE:
        return ()
    return (a,) if op is _NEG else (a, b)


class Tape:
    """The part of a program that some registers need, to be run on any number type again and again.

    Memory is that of the numbers alive at a time: one that is read no more is dropped.
    """

    def __init__(self, program: Program, registers: Iterable[Register]) -> None:
        requested, ops = list(registers), program.ops
        order = program.behind(requested)
        last_use = dict.fromkeys(requested, len(ops))  # the last register that reads each of those needed
        for register in reversed(order):
            for operand in operands(*ops[register]):
                last_use.setdefault(operand, register)
        self._steps: list[tuple[Operation, int, Any, int, int | None]] = []
        self._size, free = 0, list[int]()
        slots: dict[Register, int] = {}
        for register in order:
            op, a, b = ops[register]
            first, second = a, 0
            dead: list[int] = []
            if op >= _ADD:
                first, second = slots[a], slots[a if op is _NEG else b]
                dead = [slots[operand] for operand in {*operands(op, a, b)} if last_use[operand] == register]
            free += dead
            if not free:
                free.append(self._size)
                self._size += 1
            slots[register] = free.pop()  # the last of the dead ones, if any
            self._steps.append((op, slots[register], first, second, dead[0] if len(dead) > 1 else None))
        self._places = [slots[register] for register in requested]

    def run(self, values: Mapping[str, N], laplace: N, unity: N) -> list[N]:
        """Return the registers.

        `values`: node values by name, as numbers of the type to compute in. `laplace` and `unity`: the
        variable s and the number 1 of that type; s may be an array. Raises `ZeroDivisionError` where exact
        numbers meet a zero pivot; arrays follow NumPy's rules instead.
        """
        memory: list[Any] = [None] * self._size
        for op, slot, a, b, dead in self._steps:
            if op is _MUL:
                memory[slot] = memory[a] * memory[b]
            elif op is _ADD:
                memory[slot] = memory[a] + memory[b]
            elif op is _DIV:
                memory[slot] = memory[a] / memory[b]
            elif op is _SUB:
                memory[slot] = memory[a] - memory[b]
            elif op is _PARAMETER:
                memory[slot] = values[a]
            elif op is _NEG:
                memory[slot] = -memory[a]
            else:
                memory[slot] = laplace if op is _LAPLACE else unity * a if a != 1 else unity
            if dead is not None:
                memory[dead] = None
        return [memory[place] for place in self._places]


# --- derivatives ----------------------------------------------------------------------------------


def gradient(
    program: Program, register: Register, values: Mapping[str, N], laplace: N, unity: N
) -> tuple[N, dict[str, N]]:
    """Return the value of a register and its partial derivatives.

    Returns the value, and the derivative by every parameter that it depends on. Raises `ZeroDivisionError`
    where exact numbers meet a zero pivot.
    """
    needed = program.behind([register])
    run = program.run(needed, values, laplace, unity)
    slopes: dict[Register, N] = {register: unity}
    partials: dict[str, N] = {}
    for current in reversed(needed):
        slope = slopes.pop(current)
        op, a, b = program.ops[current]
        shares: tuple[tuple[Register, N], ...] = ()
        match op:
            case Operation.PARAMETER:
                partials[a] = slope
            case Operation.ADD:
                shares = (a, slope), (b, slope)
            case Operation.SUB:
                shares = (a, slope), (b, -slope)
            case Operation.MUL:
                shares = (a, slope * run[b]), (b, slope * run[a])
            case Operation.DIV:
                divided = slope / run[b]
                shares = (a, divided), (b, -(divided * run[current]))
            case Operation.NEG:
                shares = ((a, -slope),)
        for operand, share in shares:
            slopes[operand] = slopes[operand] + share if operand in slopes else share
    return run[register], partials
