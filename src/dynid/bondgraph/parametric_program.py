"""Programs whose node values are functions of unknown parameters, with exact derivatives by these.

The derivatives are registers of the program like all others, so that common parts are computed once. The
program holds for all values of the parameters; known values are those of the graph. It runs in ball
arithmetic with as many bits as it takes: fixed pivots lose digits of floats where parameters are decades
apart, but a ball says so.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.numbers import OutOfRangeError
from dynid.bondgraph.graph import BondGraph
from dynid.bondgraph.program.factored import numeric_point, prime_for
from dynid.bondgraph.program.program import ModularPoint, Operation, Program, Register, Tape
from dynid.errors import Singular

#: Bits of the ball arithmetic, tried in this order, and those that a number must have for sure.
PARAMETRIC_PRECISIONS = (128, 512, 4096)
_MIN_ACCURATE_BITS = 56

#: Powers that are written as products.
_EXACT_POWERS = range(-8, 9)


class ParametricProgram(Program):
    """A program in which `parameter` writes the value of a node as a function of the unknown parameters.

    `unknown`: the names of the parameters to differentiate by; all others have their reference values.
    """

    def __init__(self, graph: BondGraph, unknown: Sequence[str]) -> None:
        from flint import nmod

        self.graph, self.unknown = graph, tuple(unknown)
        self._dependent = {
            name: node.dependent
            for name, node in graph.nodes.items()
            if node.dependent is not None and node.dependent.names.intersection(unknown)
        }
        exact_values = {
            name: node.value
            for name, node in graph.nodes.items()
            if node.value is not None and name not in self._dependent
        }
        self.known: Mapping[str, Fraction] = exact_values
        constants: list[Fraction] = []

        def note(item: Real) -> None:
            constants.append(Fraction(item.reference if isinstance(item, Dependent) else item))

        for number in self._dependent.values():
            number.fold(note, lambda *_: None)
        prime = prime_for([*exact_values.values(), *constants])
        exact = numeric_point(exact_values, prime)
        source = random.Random(0x5EED)
        # what holds at a random point of the unknown parameters holds for all of their values
        residues = {f"@{name}": nmod(source.getrandbits(60), prime) for name in self.unknown}
        self._source, self._residues = source, {**exact.values, **residues}
        super().__init__(ModularPoint(prime, self._residues, exact.laplace, general=True))
        self.opaque: dict[str, tuple[Dependent, str]] = {}  # leaf: a function that is not rational, by what
        self._nodes: dict[str, Register] = {}
        self._slopes: dict[Register, dict[str, Register]] = {}

    def parameter(self, name: str) -> Register:
        """Write the value of a node."""
        if name not in self._nodes:
            dependent = self._dependent.get(name)
            self._nodes[name] = (
                super().parameter(name)
                if dependent is None
                else dependent.fold(self._leaf_or_number, self._operation)
            )
        return self._nodes[name]

    def _leaf_or_number(self, number: Real) -> Register:
        if isinstance(number, Dependent) and number.operands[0] in self.unknown:
            return super().parameter(f"@{number.operands[0]}")
        exact = Fraction(number.reference if isinstance(number, Dependent) else number)
        return self.div(self.constant(exact.numerator), self.constant(exact.denominator))

    def _operation(self, node: Dependent, operands: list[Register]) -> Register:
        write: dict[str, Callable[..., Register]] = {"+": self.add, "-": self.sub, "*": self.mul}
        write |= {"/": self.div, "neg": self.neg, "pos": int}
        if node.operation in write:
            return write[node.operation](*operands)
        if node.operation == "**":
            exponent = node.operands[1]
            if not isinstance(exponent, Dependent) and exponent in _EXACT_POWERS:
                power = self.product([operands[0]] * abs(int(exponent)))
                return power if exponent >= 0 else self.inv(power)
        return self._given(node, "")

    def _given(self, node: Dependent, by: str) -> Register:
        """Write a function that is not rational, or its derivative, as a number that is given."""
        from flint import nmod

        key = f"@{id(node)}@{by}"
        if key not in self.opaque:
            self.opaque[key] = node, by
            self._residues[key] = nmod(self._source.getrandbits(60), self.prime)
        return super().parameter(key)

    # --- derivatives ---------------------------------------------------------------------------

    def slopes(self, registers: Iterable[Register]) -> list[dict[str, Register]]:
        """Write the derivatives of registers by the unknown parameters; those that vanish are left out."""
        registers = list(registers)
        for register in self.behind(registers):
            if register not in self._slopes:
                self._slopes[register] = self._differentiated(register)
        return [self._slopes[register] for register in registers]

    def _differentiated(self, register: Register) -> dict[str, Register]:
        op, a, b = self.ops[register]
        if op is Operation.PARAMETER:
            if a in self.opaque:
                node, _ = self.opaque[a]
                return {name: self._given(node, name) for name in node.names.intersection(self.unknown)}
            return {a[1:]: self.one} if a.startswith("@") else {}
        if op < Operation.ADD:
            return {}
        first, second = self._slopes[a], {} if op is Operation.NEG else self._slopes[b]
        slopes = {}
        for name in (name for name in self.unknown if name in first or name in second):
            da, db = first.get(name, self.zero), second.get(name, self.zero)
            match op:
                case Operation.ADD:
                    slope = self.add(da, db)
                case Operation.SUB:
                    slope = self.sub(da, db)
                case Operation.NEG:
                    slope = self.neg(da)
                case Operation.MUL:
                    slope = self.add(self.mul(da, b), self.mul(a, db))
                case _:
                    slope = self.div(self.sub(da, self.mul(register, db)), b)
            if not self.is_zero(slope):
                slopes[name] = slope
        return slopes

    # --- evaluation ----------------------------------------------------------------------------

    def leaves(self, values: Mapping[str, float]) -> dict[str, float | Fraction]:
        """Return the numbers that the program reads, at values of the unknown parameters.

        Raises `Singular` if a value is not defined there.
        """
        leaves: dict[str, float | Fraction] = {**self.known}
        leaves |= {f"@{name}": float(values[name]) for name in self.unknown}
        try:
            duals = {id(node): node.dual(values) for node, _ in self.opaque.values()}
        except OutOfRangeError as error:
            raise Singular(
                f"a value of the graph is not defined: {error}",
                remedy="Limit the parameters to values at which it is.",
                names=self.unknown,
            ) from None
        for key, (node, by) in self.opaque.items():
            dual = duals[id(node)]
            leaves[key] = dual.slopes.get(by, Fraction(0)) if by else dual.value
        return leaves


class ParametricTape(Tape):
    """Registers of a parametric program, each evaluated to full double precision."""

    def __init__(self, program: ParametricProgram, registers: Iterable[Register]) -> None:
        super().__init__(program, registers)
        self.program = program
        self._known: dict[int, dict[str, Any]] = {}  # the values that do not change, by precision

    def evaluate(self, leaves: Mapping[str, float | Fraction], omega: float | None = None) -> list[Any]:
        """Return the registers, rounded to floats, or to complex numbers at s = j omega.

        `leaves`: what the program reads, of `ParametricProgram.leaves`. `omega`: angular frequency, rad/s;
        default: nothing depends on s. Raises `Singular` if a divisor vanishes.
        """
        from flint import acb, arb, ctx, fmpq

        def ball(number: float | Fraction) -> Any:
            return arb(number if isinstance(number, float) else fmpq(number.numerator, number.denominator))

        rounding = float if omega is None else complex
        for precision in PARAMETRIC_PRECISIONS:
            with ctx.workprec(precision):
                if precision not in self._known:
                    exact = self.program.known.items()
                    self._known[precision] = {name: ball(value) for name, value in exact}
                known = self._known[precision]
                values = known | {name: ball(leaves[name]) for name in leaves.keys() - known.keys()}
                balls = self.run(values, None if omega is None else acb(0, omega), arb(1))
                if all(ball.rel_accuracy_bits() >= _MIN_ACCURATE_BITS for ball in balls):
                    return [rounding(ball) for ball in balls]
                # what still may be zero with so many bits is zero: a slope at values where it vanishes
                if precision > PARAMETRIC_PRECISIONS[0] and all(
                    ball.rel_accuracy_bits() >= _MIN_ACCURATE_BITS
                    or (ball.is_finite() and ball.contains(0) and abs(ball) < 2.0 ** -(precision // 2))
                    for ball in balls
                ):
                    return [0.0 if ball.contains(0) else rounding(ball) for ball in balls]
        where, remedy = "at these values of the parameters", "Limit the parameters (`min`, `max`)"
        if omega is None:
            what = f"{where}: a divisor vanishes (a storage without a value, or values that cancel)"
        else:
            what = f"at {omega:g} rad/s and {where}: a divisor vanishes (such as at an undamped natural mode)"
            remedy += ", leave that frequency out"
        raise Singular(
            f"the equations of the graph have no solution {what}",
            remedy=f"{remedy}, or start elsewhere.",
            names=self.program.unknown,
        )
