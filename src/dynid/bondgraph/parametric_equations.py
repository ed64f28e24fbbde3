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

from collections.abc import Mapping, Sequence
from functools import cached_property
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
from dynid.bondgraph.parametric_program import ParametricProgram, Tape
from dynid.bondgraph.program.bounded import bounded_response
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.reducer import reduce_graph
from dynid.errors import NumericalError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from dynid.arrays import Array


#: The matrices, in the order of `ParametricEquations.at`.
_NAMES = ("A", "B", "C", "D")


class _StateOfGraph(NamedTuple):
    """A state of the equations, as a variable of the graph: q of a C, f of an I, or an output's integral.

    `port` names the variable; `kind` is ``q``, ``f``, or ``integral`` of one that stores no energy.
    """

    port: Port
    kind: str


class _StoredEnergy(NamedTuple):
    """Energy at some values: that of a state x is ``sum(sizes * (rows @ x)**2) / 2``.

    `rows` gives the effort of each C and the flow of each I; `sizes` their values.
    """

    rows: Array
    sizes: Array


class ParametricEquations:
    """``x' = A x + B u``, ``y = C x + D[0] u + D[1] u' + …`` of the part of a graph that its outputs need.

    Parameters
    ----------
    initial
        Storages with energy at t = 0, each a further input: an impulse of strength f(0) of an I, e(0) of
        a C.

    Raises
    ------
    Singular
        Where the equations have no unique solution whatever the parameters are.

    Attributes
    ----------
    inputs
        The names of the inputs, those of the stored energy last.
    orders
        The highest derivative of each input in the outputs, -1 where it does not enter directly.
    """

    def __init__(self, reduced: ReducedGraph, unknown: Sequence[str], initial: Sequence[str] = ()) -> None:
        self.graph, self.unknown = reduced.graph, tuple(unknown)
        program = self._program = ParametricProgram(reduced.graph, unknown)
        try:
            self._derive(reduced, initial)
        except ZeroDivisionError:
            raise contradiction() from None
        self.reached = frozenset(name for slope in program.slopes(self._registers()) for name in slope)

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
            element = next(
                name for name in junction.elements if nodes[name].type == kind and field.value(name)
            )
        sign = bond_sign(self.graph, element)
        if kind == "I":  # the flow of a 1-junction is that of its elements; what integrates has its own arrow
            return _StateOfGraph(Port(element, "f"), "f"), field.one * (sign if junction is None else 1)
        return _StateOfGraph(Port(element, "q"), "q"), field.value(element) * (
            1 if junction is None else sign
        )

    # --- matrices ------------------------------------------------------------------------------

    def _entries(self) -> list[tuple[str, tuple[int, ...], int]]:
        """Return matrix, place and register of every coefficient."""
        entries: list[tuple[str, tuple[int, ...], int]] = []
        columns: list[list[FormSymbol]] = [
            [("u", name, order) for name in self.inputs] for order in range(self.highest + 1)
        ]
        for name, forms, symbols in (
            ("A", self._rates, self._symbols),
            ("B", self._rates, columns[0]),
            ("C", self._outputs, self._symbols),
        ):
            entries += [(name, index, register) for index, register in _places(forms, symbols)]
        for order, symbols in enumerate(columns):
            entries += [
                ("D", (order, *index), register) for index, register in _places(self._outputs, symbols)
            ]
        return entries

    def _registers(self) -> list[int]:
        return [register for _, _, register in self._entries()]

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of A, B, C, D."""
        n, inputs, outputs = len(self._symbols), len(self.inputs), len(self._outputs)
        return {"A": (n, n), "B": (n, inputs), "C": (outputs, n), "D": (self.highest + 1, outputs, inputs)}

    @cached_property
    def _layout(self) -> tuple[Tape, NDArray[np.intp], list[tuple[int, tuple[int, ...]]], int]:
        """The tape, the place of each of its numbers in one flat array, and the matrices in that array."""
        entries, shapes, p = self._entries(), self.shapes(), len(self.unknown)
        parts, size = [], 0
        for shape in (*(shapes[name] for name in _NAMES), *((p, *shapes[name]) for name in _NAMES)):
            parts.append((size, shape))
            size += int(np.prod(shape, dtype=int))
        begin = {name: parts[k][0] for k, name in enumerate(_NAMES)}
        slopes_begin = {name: parts[4 + k][0] for k, name in enumerate(_NAMES)}
        registers, places = [], []
        index = {name: k for k, name in enumerate(self.unknown)}
        slopes_of = self._program.slopes([register for _, _, register in entries])
        for (name, at, register), slopes in zip(entries, slopes_of, strict=True):
            shape = shapes[name]
            flat = int(np.ravel_multi_index(at, shape))
            registers.append(register)
            places.append(begin[name] + flat)
            for parameter, slope in slopes.items():
                registers.append(slope)
                places.append(slopes_begin[name] + index[parameter] * int(np.prod(shape, dtype=int)) + flat)
        return Tape(self._program, registers), np.array(places, dtype=np.intp), parts, size

    def at(self, values: Mapping[str, float]) -> tuple[Array, ...]:
        """Return A, B, C, D (orders x outputs x inputs), and their derivatives (p x …), to double precision.

        Raises
        ------
        Singular
            Where the equations change their form: a divisor vanishes.
        NumericalError
            Where a coefficient leaves the range of doubles.
        """
        tape, places, parts, size = self._layout
        flat = np.zeros(size)
        flat[places] = tape.run(self._program.leaves(values))
        if not np.isfinite(flat).all():
            raise NumericalError(
                "a coefficient of the state equations is beyond the range of numbers",
                remedy="Limit the parameters (`min`, `max`), or choose units that bring values nearer to 1.",
                names=self.unknown,
            )
        return tuple(
            flat[first : first + int(np.prod(shape, dtype=int))].reshape(shape) for first, shape in parts
        )

    @cached_property
    def _energy_tape(self) -> tuple[Tape, list[tuple[int, int]]]:
        entries = list(_places(self._stored, self._symbols))
        values = [self._program.parameter(name) for name in self.storages]
        return Tape(self._program, [*values, *(register for _, register in entries)]), [
            (index[0], index[1]) for index, _ in entries
        ]

    def energy(self, values: Mapping[str, float]) -> _StoredEnergy:
        """Return the stored energy as a function of the state, at values of the parameters."""
        tape, places = self._energy_tape
        numbers, count = np.array(tape.run(self._program.leaves(values))), len(self.storages)
        rows = np.zeros((count, len(self.states)))
        for index, number in zip(places, numbers[count:], strict=True):
            rows[index] = number
        return _StoredEnergy(rows, numbers[:count])

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


def _places(forms: Sequence[LinearForm], symbols: Sequence[FormSymbol]) -> list[tuple[tuple[int, int], int]]:
    """Return row, column and register of the coefficients of these symbols."""
    column = {symbol: k for k, symbol in enumerate(symbols)}
    return [
        ((row, column[symbol]), value.register)
        for row, form in enumerate(forms)
        for symbol, value in form.items()
        if symbol in column
    ]


#: Largest error bound over the response; of a derivative, over it or the response over the parameter.
_ERROR_BOUND_TOL = 1e-10


class ParametricResponse:
    """The responses of a graph's outputs to its inputs at s = j omega.

    Raises
    ------
    Singular
        Where the equations have no unique solution whatever the parameters are.
    """

    def __init__(self, reduced: ReducedGraph, unknown: Sequence[str]) -> None:
        program = self._program = ParametricProgram(reduced.graph, unknown)
        self._shape = len(reduced.outputs), len(reduced.inputs)
        self._unknown = tuple(unknown)
        channels: list[int] = []
        try:
            for port in reduced.outputs:
                transfers = reduce_graph(
                    reduced.structure, program, port, reduced.inputs, traced=False
                ).channels
                channels += [transfers.get(source, program.zero) for source in reduced.inputs]
            slopes = program.slopes(channels)
        except ZeroDivisionError:
            raise contradiction() from None
        self._registers = [
            *channels,
            *(slope.get(name, program.zero) for slope in slopes for name in self._unknown),
        ]
        self._tape = Tape(program, self._registers)

    def at(
        self, values: Mapping[str, float], omega: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the responses (L x outputs x inputs), and their derivatives by the parameters (… x p).

        Parameters
        ----------
        omega
            Angular frequencies, rad/s, not zero (L).

        Raises
        ------
        Singular
            Where a response is infinite, or the equations have no unique solution.
        """
        program, leaves = self._program, self._program.leaves(values)
        responses, error = bounded_response(program, self._registers, leaves, omega)
        count, theta = int(np.prod(self._shape)), np.abs([values[name] for name in self._unknown])
        with np.errstate(all="ignore"):
            size = np.abs(responses)
            relative = size[:, :count, None] / np.where(theta > 0, theta, np.inf)
            size[:, count:] = np.maximum(size[:, count:], relative.reshape(size[:, count:].shape))
            trusted = np.all((error <= _ERROR_BOUND_TOL * size) & np.isfinite(responses), axis=1)
        for line in np.flatnonzero(~trusted):
            responses[line] = self._tape.run(leaves, float(omega[line]))
        return (
            responses[:, :count].reshape(len(omega), *self._shape),
            responses[:, count:].reshape(len(omega), *self._shape, len(self._unknown)),
        )
