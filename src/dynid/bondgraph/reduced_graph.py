"""A graph with its reductions to every output, ready to be run on a number type."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from fractions import Fraction
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, Self

from dynid.bondgraph.graph import SOURCES, STORAGES, BondGraph, GraphUnits, Port, no_collection
from dynid.bondgraph.program.factored import (
    SampledResidues,
    axis_point,
    field_point,
    numeric_point,
    prime_for,
    random_point,
)
from dynid.bondgraph.program.program import ModularPoint, Program
from dynid.bondgraph.reduction.junctions import JunctionStructure, ring_text
from dynid.bondgraph.reduction.network import STORED
from dynid.bondgraph.reduction.reducer import Reduction, reduce_graph
from dynid.bondgraph.reduction.solvability import hold, undetermined
from dynid.defaults import LARGE_GRAPHS, MANY_LOOPS
from dynid.errors import Singular

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.arithmetic.real_field import RealField
    from dynid.bondgraph.nodal_response import NodalResponse
    from dynid.bondgraph.program.factored import RationalFunction
    from dynid.bondgraph.reduction.compiled import PlanResidues


Channel = tuple[Port, str]
#: For every value that varies those of the samples, exact.
SampleValues = Mapping[str, Sequence[Fraction]]
#: The residue that stands for s where many samples are tested: any but 0 does.
_LAPLACE = 0x2F6E2B1D
#: Where a program is evaluated as it is written: without numbers, with them, or at a frequency as well.
PlanningPoint = Literal["random", "values"] | Fraction


class GraphProgram(ABC):
    """A program written for a graph, ready to be run on any number type.

    The program is planned without numbers. Where the numbers make one of its pivots zero (a resistance
    of -1 beside one of 1), it is planned again with them.
    """

    _balanced = False  # whether reductions are
    _short_paths: Self | None = None  # the balanced plan, once it is made

    def __init__(self, graph: BondGraph) -> None:
        self.graph = graph
        self._plan("random")
        if self._vanishing():
            self._plan("values")

    @cached_property
    def _values(self) -> dict[str, Fraction]:
        return {name: node.value for name, node in self.graph.nodes.items() if node.value is not None}

    @cached_property
    def _prime(self) -> int:
        return prime_for(self._values.values())

    @property
    def field(self) -> RealField | None:
        """The field of the irrational values; None where all are rational."""
        return self.graph.field

    @cached_property
    def valued(self) -> list[str]:
        """The nodes that have a value."""
        return list(self._values)

    @cached_property
    def storages(self) -> list[str]:
        """The storages among them."""
        return [name for name in self._values if self.graph.nodes[name].type in STORAGES]

    @property
    def exact(self) -> Mapping[str, Fraction]:
        """The exact values of elements and two-ports, by name."""
        return self._values

    def modulo(self) -> ModularPoint:
        """Return these values, and a random s, modulo a large prime."""
        if self.field is not None:
            return field_point(self._values, self.field)
        return numeric_point(self._values, self._prime)

    @cached_property
    def units(self) -> GraphUnits:
        """The units of the graph's variables."""
        return GraphUnits(self.graph)

    def _plan(self, at: PlanningPoint) -> None:
        if isinstance(at, Fraction):
            point = axis_point(self._values, at, self.field)
        else:
            point = random_point(self.valued, self._prime) if at == "random" else self.modulo()
        self.program = Program(point)
        self._write()

    def _vanishing(self) -> bool:
        """Test whether a pivot is zero with these values."""
        return self.program.vanishing(self.answers(), self.pivots(), self.modulo())

    def holds(self, values: SampleValues, count: int) -> NDArray[np.bool_]:
        """Return for which of many samples of some values the plan holds: no pivot vanishes.

        What is not zero modulo a prime is not zero; a sample that is zero modulo the prime counts as one for
        which it does not hold, and so does a value of zero, which is another structure.
        """
        import numpy as np

        vanished = np.zeros(count, dtype=bool)
        fixed = {name: [self.graph.value(name)] * count for name in self.valued}
        residues = {name: SampledResidues.of(v, vanished) for name, v in (fixed | dict(values)).items()}
        unity, s = (SampledResidues(np.full(count, x, dtype=np.int64), vanished) for x in (1, _LAPLACE))
        for value in values.values():
            vanished |= np.array([not number for number in value], dtype=bool)
        pivots = self.pivots()
        registers = self.run([*self.answers(), *pivots], residues, s, unity)
        for pivot in pivots:
            vanished |= registers[pivot].images == 0
        return ~vanished

    def with_values(self, values: Mapping[str, Fraction]) -> Self:
        """Return the plan with other values of some elements, for which it is known to hold."""
        program = copy(self)
        program._short_paths = None
        program.graph = self.graph.with_values(values)
        program._values = {name: program.graph.value(name) for name in self._values}
        program._prime = prime_for(program._values.values())
        return program

    def on_axis(self, omega: Fraction) -> Self:
        """Return the plan for one frequency: none of its pivots is exactly zero at s = j omega.

        Raises `Singular` where the equations are singular there.
        """
        program = copy(self)
        program._plan(omega)
        return program

    def balanced(self) -> Self:
        """Return the plan, with its numbers, for short paths through its loops (`Reducer`).

        Bounds on rounding errors, which grow with each step on a loop, stay small in long ladders and rings.
        """
        if self._balanced:
            return self
        if self._short_paths is None:
            program = self._short_paths = copy(self)
            program._balanced = True
            with no_collection():
                program._plan("values")
        return self._short_paths

    @property
    def has_short_paths(self) -> bool:
        """True where a response needed the balanced plan, so that others will."""
        return self._short_paths is not None

    @abstractmethod
    def _write(self) -> None:
        """Write the program."""

    @abstractmethod
    def pivots(self) -> list[int]:
        """Return the registers that the program divides by."""

    @abstractmethod
    def answers(self) -> Iterable[int]:
        """Return the registers that will be asked for."""

    def run(
        self, registers: Iterable[int], values: dict[str, Any], laplace: Any, unity: Any
    ) -> dict[int, Any]:
        """Run the program for these registers on any number type."""
        return self.program.run(registers, values, laplace, unity)

    def rational(self, registers: Iterable[int]) -> dict[int, RationalFunction]:
        """Run the program on exact rational functions of s (factored, not yet in lowest terms)."""
        from flint import fmpz_poly

        from dynid.bondgraph.program.factored import (
            PolynomialFactor,
            RationalFunction,
            rational_functions_over,
        )

        field, ratio = self.field, RationalFunction
        polynomial: Any = fmpz_poly
        if field is not None:
            from dynid.arithmetic.field_polynomials import polynomial as over_field

            polynomial, ratio = partial(over_field, field), rational_functions_over(field)
        bits = {name: 1 << index for index, name in enumerate(self.storages)}

        @cache
        def integer(number: int) -> PolynomialFactor:  # equal numbers are one factor, and cancel
            return PolynomialFactor(polynomial([number]))

        def constant(value: Fraction, storages: int = 0) -> RationalFunction:
            if not value:
                return ratio(None, 1, storages)
            powers = ((value.numerator, 1), (value.denominator, -1))
            return ratio({integer(number): power for number, power in powers if number != 1}, 1, storages)

        values = {name: constant(self.graph.value(name), bits.get(name, 0)) for name in self.valued}
        s = ratio.of(polynomial([0, 1]), polynomial([1]))
        return self.run(registers, values, s, constant(Fraction(1)))


class ReducedGraph(GraphProgram):
    """One program for all outputs of a graph; outputs share the steps that they have in common.

    `undetermined`: what the equations leave open although no output depends on it, a sentence each. Raises
    `Singular` where sources contradict each other, in whatever part of the graph (each is prescribed, one
    that is zero as well), or the graph leaves an output undetermined: in general or with its numbers.
    """

    reductions: dict[Port, Reduction]

    def __init__(
        self, graph: BondGraph, inputs: Sequence[str], outputs: Sequence[Port], *, traced: bool = True
    ) -> None:
        self.inputs, self.outputs, self._traced = tuple(inputs), tuple(outputs), traced
        self._drawn, self._all_solved, self._by_library = graph, False, not traced
        self.free: list[str] = []
        self.undetermined: list[str] = []
        self.nodal = None if traced else self._nodal_response(graph)
        if self.nodal is not None:  # it has a unique solution, and is planned where it must be
            self.graph = graph
            return
        with no_collection():
            try:
                super().__init__(graph)
                undetermined_parts = [] if self._all_solved else undetermined(self.structure, self.unsolved())
            except Singular as error:
                self._by_library = False  # from here on something is held
                undetermined_parts = hold(self.structure, outputs)
                if not undetermined_parts:
                    raise
                try:
                    super().__init__(graph)
                except Singular:
                    raise undetermined_parts[0].error from error
        rings = [] if self._all_solved else self.structure.rings
        #: What is not determined, and no output depends on.
        self.free = [undetermined_part.error.problem for undetermined_part in undetermined_parts]
        self.undetermined = [ring_text(graph, bond) for bond in rings]
        self.undetermined += [f"{problem}; no requested output depends on it" for problem in self.free]

    @cached_property
    def structure(self) -> JunctionStructure:
        """The junction structure of the graph."""
        with no_collection():
            return JunctionStructure(self._drawn)

    def with_values(self, values: Mapping[str, Fraction]) -> Self:
        """Return the plan with other values of some elements, for which it is known to hold."""
        _ = self.program  # it is shared
        reduced = super().with_values(values)
        reduced.nodal = None
        return reduced

    def _nodal_response(self, graph: BondGraph) -> NodalResponse | None:
        """Return the response by sparse factors of a large graph whose many loops fill its elimination."""
        if len(graph.bonds) < LARGE_GRAPHS.value or len(graph.bonds) - len(graph.nodes) < MANY_LOOPS.value:
            return None
        from dynid.bondgraph.nodal_response import NodalResponse

        with no_collection():
            return NodalResponse.of(self.structure, self.inputs, self.outputs)

    def __getattr__(self, name: str) -> Any:
        """Plan a graph whose response needs no program, where something else does."""
        if name not in ("program", "reductions") or self.__dict__.get("nodal") is None:
            raise AttributeError(name)
        with no_collection():
            super().__init__(self.graph)
        return self.__dict__[name]

    def _plan(self, at: PlanningPoint) -> None:
        if not self._plan_by_library(at):
            self._all_solved = False
            super()._plan(at)

    def _plan_by_library(self, at: PlanningPoint) -> bool:
        """Plan by the library; False where the graph is small, or it refuses."""
        if not self._by_library or len(self.graph.bonds) < LARGE_GRAPHS.value or isinstance(at, Fraction):
            return False
        if self.field is not None and at == "values":  # its prime is longer than a word
            return False
        from dynid.native import compiled

        if not compiled():
            return False
        from dynid.bondgraph.reduction.compiled import PlanResidues, compiled_reductions

        at_random = at == "random"
        residues = PlanResidues.random(self.graph, self._prime) if at_random else self._residues()
        planned = compiled_reductions(
            self.graph, residues, self.inputs, self.outputs, lambda: self.structure, balanced=self._balanced
        )
        if planned is None:
            return False
        self.program, self.reductions, unsolved = planned
        self._all_solved = not unsolved
        return True

    def _residues(self) -> PlanResidues:
        """Return these values, and a random s, modulo the prime."""
        from dynid.bondgraph.reduction.compiled import PlanResidues

        return PlanResidues.of(self.graph, self._prime, int(numeric_point({}, self._prime).laplace))

    def _vanishing(self) -> bool:
        if type(self.program) is Program:
            return super()._vanishing()
        program: Any = self.program
        return program.divides_by_zero(self.pivots(), self._residues()) and super()._vanishing()

    def unsolved(self) -> list[str]:
        """Return the junctions that no output depends on and no source fixes."""
        solved = {name for reduction in self.reductions.values() for name in reduction.junctions}
        junctions = self.structure.junctions.items()
        return [name for name, junction in junctions if name not in solved and junction.fixing is None]

    def _write(self) -> None:
        self.reductions = {
            port: reduce_graph(
                self.structure,
                self.program,
                port,
                self.inputs,
                traced=self._traced and not self._balanced,
                balanced=self._balanced,
            )
            for port in self.outputs
        }

    def pivots(self) -> list[int]:
        """Return the registers that the program divides by."""
        return [pivot for reduction in self.reductions.values() for pivot in reduction.pivots]

    def answers(self) -> Iterable[int]:
        """Return the registers that will be asked for."""
        yield from self.channels().values()
        for reduction in self.reductions.values():
            yield from (register for _, register in reduction.prototype.systems)

    def channels(self) -> dict[Channel, int]:
        """Return the register of every channel (output, input)."""
        return {
            (port, source): register
            for port, reduction in self.reductions.items()
            for source, register in reduction.channels.items()
        }

    def dropped(self, port: Port) -> tuple[str, ...]:
        """Return the nodes that an output is independent of, in the order of the graph.

        These are nodes behind an ideal source or not connected, sources that are no inputs or do not reach
        the output, and elements whose value enters neither the output's transfer functions, nor the natural
        modes behind it, nor its prototype.
        """
        if self.nodal is not None:
            return self.nodal.dropped()
        reduction, program = self.reductions[port], self.program
        prototype = reduction.prototype
        parts = (prototype.part_a, prototype.part_b)
        kept = program.parameters([*reduction.channels.values(), *reduction.pivots, *parts])
        kept |= {source for source, register in reduction.channels.items() if not program.is_zero(register)}
        kept.add(port.node)
        fixing = reduction.network.root.fixing
        if fixing is not None:
            kept.add(fixing)
        inside = set(reduction.modelled)
        return tuple(
            name
            for name, node in self.graph.nodes.items()
            if name not in kept and (name not in inside or node.value is not None or node.type in SOURCES)
        )

    def stored(self, names: Iterable[str]) -> dict[Channel, int]:
        """Return the register of the answer to the stored energy of each storage, by output and storage.

        It is the Laplace transform of the output for f(0) = 1 of an I, e(0) = 1 of a C, all inputs zero:
        the stored energy is an equivalent source (Park & Kim 1997, eqs 13 to 16).
        """
        sources = {f"{STORED}{name}": name for name in names}
        return {
            (port, sources[source]): register
            for port in self.outputs
            for source, register in reduce_graph(self.structure, self.program, port, sources).channels.items()
        }


# --- natural modes ---------------------------------------------------------------------------------


def characteristic_polynomials(reduced: ReducedGraph) -> dict[Port, Any]:
    """Return, for every output, the polynomial of all natural modes of the part behind it.

    It is the determinant of the nodal form (the product of the pivots) times s for every storage that
    integrates there (its immittance has s in the denominator).
    """
    registers = {port: reduction.determinant() for port, reduction in reduced.reductions.items()}
    ratios = reduced.rational(registers.values())
    return {port: ratios[register].lowest_terms()[0] for port, register in registers.items()}


def separate_parts(reduced: ReducedGraph, natural: Mapping[Port, Any]) -> list[Any]:
    """Return the polynomials of the natural modes of the separate parts behind outputs."""
    parts = list[tuple[set[str], Any]]()
    for port, modes in natural.items():
        junctions, polynomial, separate = set(reduced.reductions[port].junctions), modes, []
        for others, theirs in parts:
            if junctions.isdisjoint(others):
                separate.append((others, theirs))
            else:  # activated bonds let one part act on another one, whose modes then are among its own
                junctions |= others
                polynomial = polynomial * (theirs // polynomial.gcd(theirs))
        parts = [*separate, (junctions, polynomial)]
    return [polynomial for _, polynomial in parts]


def parts_without_output(reduced: ReducedGraph) -> list[Any] | None:
    """Return the polynomials of the natural modes of the parts on which no output depends.

    None where a part has no unique solution.
    """
    if reduced.free:
        return None
    covered, polynomials = set[str](), list[Any]()
    for name in [] if reduced._all_solved else reduced.unsolved():
        if name in covered or name not in reduced.graph.nodes:
            continue
        port = Port(name, "e" if reduced.graph.nodes[name].type == "0" else "f")
        try:
            separate = ReducedGraph(reduced.graph, (), [port], traced=False)
        except Singular:
            return None
        covered |= set(separate.reductions[port].junctions)
        polynomials += characteristic_polynomials(separate).values()
    return polynomials
