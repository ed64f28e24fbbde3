"""State equations and frequency responses of a graph as functions of parameters, with exact derivatives.

The index reduction of `descriptor.solve` is run once, on a growing program; its coefficients and their
derivatives are registers. The states are the displacement q of a C and the flow f of an I wherever the
reduction leaves an effort or a flow of theirs, so that a graph of masses and springs has the coordinates of
the structure that it is, up to a constant map: an extended filter then is the same in both.

For frequency responses the reduction to each output is written once, in terms of the parameters, with its
derivatives. It runs in double precision with error bounds at all frequencies; frequencies at which a bound is
too large are run again in ball arithmetic. So responses keep their digits where state equations lose them: at
frequencies far below or above the fastest mode of a stiff graph.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.descriptor import (
    FormSymbol,
    LinearForm,
    NumberField,
    RegisterNumber,
    contradiction,
    reduced_descriptor,
    solve,
    without_input_rates,
)
from dynid.bondgraph.graph import STORAGES, Port, bond_sign
from dynid.bondgraph.parametric_program import ParametricProgram, ParametricTape
from dynid.bondgraph.program.bounded import bounded_response
from dynid.bondgraph.program.program import Register
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.reducer import reduce_graph
from dynid.errors import NumericalError

if TYPE_CHECKING:
    from dynid.arrays import Array


#: Largest error bound over the response; of a derivative, over it or the response over the parameter.
_ERROR_BOUND_TOL = 1e-10


class _StateOfGraph(NamedTuple):
    """A state of the equations, as a variable of the graph: q of a C, f of an I, or an output's integral.

    `port` names the variable; `kind` is ``q``, ``f``, or ``integral`` of one that stores no energy.
    """

    port: Port
    kind: str


class ParametricEquations:
    """``x' = A x + B u``, ``y = C x + D[0] u + D[1] u' + …`` of the part of a graph that its outputs need.

    `initial`: storages with energy at t = 0, each a further input: an impulse of strength f(0) of an I, e(0)
    of a C. Raises `Singular` where the equations have no unique solution whatever the parameters are.
    `inputs`: the names of the inputs, those of the stored energy last. `orders`: the highest derivative of
    each input in the outputs, -1 where it does not enter directly.
    """

    def __init__(self, reduced: ReducedGraph, unknown: Sequence[str], initial: Sequence[str] = ()) -> None:
        self._reduced, self.graph, self.unknown = reduced, reduced.graph, tuple(unknown)
        program = self._program = ParametricProgram(reduced.graph, unknown)
        try:
            self._derive(reduced, initial)
        except ZeroDivisionError:
            raise contradiction() from None
        registers = [register for _, _, register in self._entries()]
        self.reached = frozenset(name for slope in program.slopes(registers) for name in slope)

    def _derive(self, reduced: ReducedGraph, initial: Sequence[str]) -> None:
        program, graph = self._program, self.graph
        field = NumberField.registers(program)
        system = reduced_descriptor(reduced, field, initial)
        forms = [system.output(port) for port in reduced.outputs]
        self.storages = [
            name
            for name, node in graph.nodes.items()
            if node.type in STORAGES and system.models(reduced.structure.place[name]) and field.value(name)
        ]
        stores = [Port(name, "e" if graph.nodes[name].type == "C" else "f") for name in self.storages]
        rates, outputs = solve(system.equations, [*forms, *(system.output(port) for port in stores)])
        self.states: list[_StateOfGraph] = []
        scales: dict[FormSymbol, RegisterNumber] = {}  # the new state over the old one
        for name in rates:
            state, scale = self._state(name, reduced, field)
            self.states.append(state)
            scales["w", name] = scale
        for name in rates:
            rates[name] = {symbol: scales["w", name] * value for symbol, value in rates[name].items()}
        for form in (*rates.values(), *outputs):
            for symbol in form:
                if symbol in scales:
                    form[symbol] = form[symbol] / scales[symbol]
        without_input_rates(rates, outputs)
        self._rates, self._symbols = list(rates.values()), list(scales)
        self._outputs, self._stored = outputs[: len(forms)], outputs[len(forms) :]
        self.inputs = [*reduced.inputs, *(f"initial:{name}" for name in initial)]
        self.orders = {
            name: max(
                (s[2] for form in self._outputs for s in form if len(s) == 3 and s[1] == name), default=-1
            )
            for name in self.inputs
        }
        self.highest = max(0, *self.orders.values()) if self.orders else 0

    def _state(
        self, name: str, reduced: ReducedGraph, field: NumberField
    ) -> tuple[_StateOfGraph, RegisterNumber]:
        """Return the state that an unknown of the equations stands for, and its ratio to that unknown."""
        if name.startswith("integral:"):
            node, _, quantity = name.removeprefix("integral:").rpartition(".")
            return _StateOfGraph(Port(node, "q" if quantity == "q" else "p"), "integral"), field.one
        nodes, junction = self.graph.nodes, reduced.structure.junctions.get(name)
        kind = nodes[name].type if junction is None else "I" if junction.kind == "1" else "C"
        element = name
        if junction is not None:
            stores = (name for name in junction.elements if nodes[name].type == kind)
            element = next(filter(field.value, stores))
        sign = bond_sign(self.graph, element)
        if kind == "I":  # the flow of a 1-junction is that of its elements; what integrates has its own arrow
            return _StateOfGraph(Port(element, "f"), "f"), field.one * (sign if junction is None else 1)
        ratio = field.value(element) * (1 if junction is None else sign)
        return _StateOfGraph(Port(element, "q"), "q"), ratio

    # --- matrices ------------------------------------------------------------------------------

    def _entries(self) -> list[tuple[int, tuple[int, ...], Register]]:
        """Return the matrix (0 to 3: A, B, C, D), the index and the register of every coefficient."""
        columns: list[list[FormSymbol]] = [
            [("u", name, order) for name in self.inputs] for order in range(self.highest + 1)
        ]
        blocks = (self._rates, self._symbols), (self._rates, columns[0]), (self._outputs, self._symbols)
        entries: list[tuple[int, tuple[int, ...], Register]] = [
            (number, index, register)
            for number, (forms, symbols) in enumerate(blocks)
            for index, register in _places(forms, symbols)
        ]
        for order, symbols in enumerate(columns):
            entries += [(3, (order, *index), register) for index, register in _places(self._outputs, symbols)]
        return entries

    @cached_property
    def _layout(self) -> tuple[ParametricTape, NDArray[np.intp], list[tuple[int, ...]], list[int]]:
        """The tape, where its numbers are in one flat array, and shapes and starts of the matrices there."""
        n, inputs, outputs, p = len(self._symbols), len(self.inputs), len(self._outputs), len(self.unknown)
        shapes = [(n, n), (n, inputs), (outputs, n), (self.highest + 1, outputs, inputs)]
        shapes += [(p, *shape) for shape in shapes]
        starts = np.cumsum([0, *map(math.prod, shapes)]).tolist()
        entries, index_of = self._entries(), {name: k for k, name in enumerate(self.unknown)}
        slopes_of = self._program.slopes([register for _, _, register in entries])
        registers, places = [], []
        for (number, index, register), slopes in zip(entries, slopes_of, strict=True):
            written = [(number, index, register)]
            written += [(number + 4, (index_of[name], *index), slope) for name, slope in slopes.items()]
            for matrix, position, coefficient in written:
                registers.append(coefficient)
                places.append(starts[matrix] + int(np.ravel_multi_index(position, shapes[matrix])))
        return ParametricTape(self._program, registers), np.array(places, dtype=np.intp), shapes, starts

    def at(self, values: Mapping[str, float]) -> tuple[Array, ...]:
        """Return A, B, C, D (orders x outputs x inputs), and their derivatives (p x …), to double precision.

        Raises `Singular` where the equations change their form: a divisor vanishes. Raises `NumericalError`
        where a coefficient leaves the range of doubles.
        """
        tape, places, shapes, starts = self._layout
        flat = np.zeros(starts[-1])
        flat[places] = tape.evaluate(self._program.leaves(values))
        if not np.isfinite(flat).all():
            raise NumericalError(
                "a coefficient of the state equations is beyond the range of numbers",
                remedy="Limit the parameters (`min`, `max`), or choose units that bring values nearer to 1.",
                names=self.unknown,
            )
        parts = zip(shapes, pairwise(starts), strict=True)
        return tuple(flat[start:end].reshape(shape) for shape, (start, end) in parts)

    @cached_property
    def _energy_tape(self) -> tuple[ParametricTape, list[tuple[int, int]]]:
        entries = _places(self._stored, self._symbols)
        registers = [self._program.parameter(name) for name in self.storages]
        registers += [register for _, register in entries]
        return ParametricTape(self._program, registers), [index for index, _ in entries]

    def energy(self, values: Mapping[str, float]) -> tuple[Array, Array]:
        """Return the stored energy at values of the parameters: rows and sizes.

        That of a state x is ``sum(sizes * (rows @ x)**2) / 2``: `rows` gives the effort of each C and the
        flow of each I, `sizes` their values.
        """
        tape, places = self._energy_tape
        numbers, count = np.array(tape.evaluate(self._program.leaves(values))), len(self.storages)
        rows = np.zeros((count, len(self.states)))
        for index, number in zip(places, numbers[count:], strict=True):
            rows[index] = number
        return rows, numbers[:count]

    def generic_rank(self, rows: Sequence[int], columns: Sequence[int]) -> int:
        """Return the rank of a block of A for all values of the parameters but exceptional ones."""
        from flint import nmod, nmod_mat

        if not rows or not columns:
            return 0
        prime = self._program.prime
        images = [
            [
                int(self._program.image(form[symbol].register)) if symbol in form else 0
                for symbol in (self._symbols[column] for column in columns)
            ]
            for form in (self._rates[row] for row in rows)
        ]
        entries = [nmod(image, prime) for row in images for image in row]
        return int(nmod_mat(len(rows), len(columns), entries, prime).rank())

    # --- frequency responses -------------------------------------------------------------------

    @cached_property
    def _channels(self) -> ParametricTape:
        """The tape of the responses, output by output, and of their derivatives."""
        reduced, program = self._reduced, ParametricProgram(self.graph, self.unknown)
        channels: list[Register] = []
        try:
            for port in reduced.outputs:
                reduction = reduce_graph(reduced.structure, program, port, reduced.inputs, traced=False)
                transfers = reduction.channels
                channels += [transfers.get(source, program.zero) for source in reduced.inputs]
            slopes = program.slopes(channels)
        except ZeroDivisionError:
            raise contradiction() from None
        derivatives = (slope.get(name, program.zero) for slope in slopes for name in self.unknown)
        return ParametricTape(program, [*channels, *derivatives])

    def response(
        self, values: Mapping[str, float], omega: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the responses at s = j omega (L x outputs x inputs), and their derivatives (… x p).

        `values`: the values of the unknown parameters, by name. `omega`: angular frequencies, rad/s, not zero
        (L). Raises `Singular` where a response is infinite, or the equations have no unique solution.
        """
        tape, shape = self._channels, (len(self._reduced.outputs), len(self._reduced.inputs))
        leaves, count = tape.program.leaves(values), math.prod(shape)
        responses, error = bounded_response(tape, leaves, omega)
        theta = np.abs([values[name] for name in self.unknown])
        with np.errstate(all="ignore"):
            size = np.abs(responses)
            relative = size[:, :count, None] / np.where(theta > 0, theta, np.inf)
            size[:, count:] = np.maximum(size[:, count:], relative.reshape(size[:, count:].shape))
            trusted = np.all((error <= _ERROR_BOUND_TOL * size) & np.isfinite(responses), axis=1)
        for line in np.flatnonzero(~trusted):
            responses[line] = tape.evaluate(leaves, float(omega[line]))
        return (
            responses[:, :count].reshape(len(omega), *shape),
            responses[:, count:].reshape(len(omega), *shape, len(self.unknown)),
        )


def _places(forms: Sequence[LinearForm], symbols: Sequence[FormSymbol]) -> list[tuple[tuple[int, int], int]]:
    """Return row, column and register of the coefficients of these symbols."""
    column = {symbol: k for k, symbol in enumerate(symbols)}
    return [
        ((row, column[symbol]), value.register)
        for row, form in enumerate(forms)
        for symbol, value in form.items()
        if symbol in column
    ]
