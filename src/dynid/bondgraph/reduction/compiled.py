"""Reductions of large graphs by the library, which does on integers what `reducer` and `Program` do.

Nodes are numbered once. What the library returns is a program that lives there (`native/plan.c`), and of
every reduction what is left at its root; from there on the prototype and the channels are written as ever.
It refuses what is rare: activated bonds, rings, elements of value zero, junctions that stay bare. Such graphs
are reduced by `reducer`.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from itertools import compress
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.graph import JUNCTIONS, NUMBER_OF_TYPE, TWO_PORTS, BondGraph, Port
from dynid.bondgraph.program.program import ModularPoint, Operation, Program, Register
from dynid.bondgraph.reduction.junctions import Junction, JunctionStructure, NameRegistry
from dynid.bondgraph.reduction.network import STORED, Immittance, NodalNetwork, NodeRow
from dynid.bondgraph.reduction.reducer import JunctionElimination, Reduction, reduction_at_root
from dynid.bondgraph.reduction.trace import NoTrace
from dynid.native import call

Integers = NDArray[np.int64]


class PlanResidues(NamedTuple):
    """The values of all nodes, as quotients modulo a prime, and s there."""

    prime: int  # the prime, below 2^62
    #: above, below: Numerators and denominators by the number of the node; any of nodes without a value.
    above: Integers
    below: Integers
    laplace: int  # the variable s
    general: bool  # whether they are random

    @classmethod
    def of(cls, graph: BondGraph, prime: int, laplace: int) -> PlanResidues:
        """Return the values of a graph, at a given s."""
        values = [node.value for node in graph.nodes.values()]
        parts = [(1, 1) if value is None else value.as_integer_ratio() for value in values]
        above, below = (_modulo(list(map(itemgetter(k), parts)), prime) for k in (0, 1))
        return cls(prime, above, below, laplace, general=False)

    @classmethod
    def random(cls, graph: BondGraph, prime: int) -> PlanResidues:
        """Return a fixed random point."""
        x = np.arange(1, len(graph.nodes) + 2, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):  # splitmix64
            x = (x ^ (x >> np.uint64(shift))) * np.uint64(factor)
        drawn = ((x ^ (x >> np.uint64(31))) % np.uint64(prime)).astype(np.int64)
        return cls(prime, drawn[:-1].copy(), np.ones(len(drawn) - 1, np.int64), int(drawn[-1]), general=True)


def _modulo(integers: list[int], prime: int) -> Integers:
    try:
        return np.array(integers, dtype=np.int64) % prime
    except OverflowError:
        return np.array([integer % prime for integer in integers], dtype=np.int64)


class CompiledProgram(Program):
    """A program in the library.

    `handle`: the library's plan, with an empty program.
    """

    def __init__(
        self, handle: int, names: list[str], numbers: dict[str, int], residues: PlanResidues
    ) -> None:
        from flint import nmod

        self.handle, self.names, self._numbers = handle, names, numbers
        weakref.finalize(self, call, "dynid_plan_forget", handle)
        self._point = ModularPoint(residues.prime, {}, nmod(residues.laplace, residues.prime))
        self.zero, self.one, self.s = 0, 1, 2
        self._listed: list[tuple[Operation, Any, int]] | None = None

    def __len__(self) -> int:
        return call("dynid_plan_read", self.handle, None, None, None)

    def arrays(self) -> tuple[Integers, Integers, Integers, list[str]]:  # noqa: D102
        count = len(self)
        codes, first, second = (np.empty(count, np.int64) for _ in range(3))
        call("dynid_plan_read", self.handle, codes, first, second)
        return codes, first, second, self.names

    @property
    def ops(self) -> list[tuple[Operation, Any, int]]:  # type: ignore[override]
        """The operations, as a list."""
        if self._listed is None:
            codes, first, second, names = self.arrays()
            read: list[Any] = first.tolist()
            for leaf in np.flatnonzero(codes == Operation.PARAMETER).tolist():
                read[leaf] = names[read[leaf]]
            read[self.s] = None
            kinds = map(tuple(Operation).__getitem__, codes.tolist())
            self._listed = list(zip(kinds, read, second.tolist(), strict=True))
        return self._listed

    def _written(self, operation: Operation, a: int, b: int) -> Register:
        self._listed = None
        register = call("dynid_plan_write", self.handle, int(operation), a, b)
        if register < 0:
            raise ZeroDivisionError
        return register

    def constant(self, value: int) -> Register:  # noqa: D102
        return self._written(Operation.CONSTANT, value, 0)

    def parameter(self, name: str) -> Register:  # noqa: D102
        return self._written(Operation.PARAMETER, self._numbers[name], 0)

    def add(self, a: Register, b: Register) -> Register:  # noqa: D102
        return self._written(Operation.ADD, a, b)

    def sub(self, a: Register, b: Register) -> Register:  # noqa: D102
        return self._written(Operation.SUB, a, b)

    def neg(self, a: Register) -> Register:  # noqa: D102
        return self._written(Operation.NEG, a, 0)

    def mul(self, a: Register, b: Register) -> Register:  # noqa: D102
        return self._written(Operation.MUL, a, b)

    def div(self, a: Register, b: Register) -> Register:  # noqa: D102
        return self._written(Operation.DIV, a, b)

    def image(self, a: Register) -> Any:  # noqa: D102
        from flint import nmod

        return nmod(call("dynid_plan_image", self.handle, a), self.prime)

    def is_zero(self, a: Register) -> bool:  # noqa: D102
        return not call("dynid_plan_image", self.handle, a)

    def are_opposite(self, a: Register, b: Register) -> bool:  # noqa: D102
        return not self.image(a) + self.image(b)

    def parameters(self, registers: Iterable[Register]) -> set[str]:  # noqa: D102
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import breadth_first_order

        codes, first, second, names = self.arrays()
        requested, count = np.fromiter(registers, np.int64), len(codes)
        first[codes == Operation.NEG], second[codes == Operation.NEG] = first[codes == Operation.NEG], 0
        inner = codes >= Operation.ADD
        operands = np.column_stack((first, second))[inner].ravel()
        starts = np.concatenate(([0], np.cumsum(2 * inner), [2 * np.count_nonzero(inner) + len(requested)]))
        indices = np.concatenate((operands, requested))
        graph = csr_array((np.ones(len(indices), np.int8), indices, starts), shape=(count + 1, count + 1))
        needed = breadth_first_order(graph, count, return_predecessors=False)[1:]
        return {names[k] for k in first[needed[codes[needed] == Operation.PARAMETER]].tolist()}

    def divides_by_zero(self, divisors: Iterable[Register], at: PlanResidues) -> bool:
        """Test whether any of these registers, or anything that is divided by, is zero at another point."""
        registers = np.fromiter(divisors, np.int64)
        return bool(
            call(
                "dynid_plan_vanishes", self.handle, at.above, at.below, at.laplace, len(registers), registers
            )
        )


def compiled_reductions(
    graph: BondGraph,
    residues: PlanResidues,
    inputs: Sequence[str],
    outputs: Sequence[Port],
    structure: Callable[[], JunctionStructure],
    *,
    balanced: bool,
) -> tuple[CompiledProgram, dict[Port, Reduction], bool] | None:
    """Return the reductions of a graph to its outputs in one program, without traces.

    The last is whether there are junctions that no output depends on and no source fixes. None where the
    library refuses.
    """
    names = list(graph.nodes)
    numbers = graph.numbers
    if any(source.startswith(STORED) for source in inputs):
        return None
    if not all(value for node in graph.nodes.values() if (value := node.value) is not None):
        return None
    sizes = np.zeros(5, np.int64)
    handle = call(
        "dynid_plan", len(names), len(graph.bonds), graph.kinds, graph.ends, residues.prime,
        int(residues.general), residues.above, residues.below, residues.laplace, sizes,
    )  # fmt: skip
    if not handle:
        return None
    program = CompiledProgram(handle, names, numbers, residues)
    junction_of, fixing, drawn = (np.empty(count, np.int64) for count in (len(names), sizes[0], sizes[0]))
    call("dynid_plan_structure", handle, junction_of, fixing, drawn)
    junctions = _junction_names(graph, names, drawn.tolist())
    kept = np.array([numbers[source] for source in inputs], dtype=np.int64)
    reductions, solved = {}, fixing >= 0
    for port in outputs:
        root = int(junction_of[numbers[port.node]])
        if root < 0 or call("dynid_plan_reduce", handle, root, len(kept), kept, int(balanced), sizes):
            return None
        rows, pivots = np.empty(sizes[0], np.int64), np.empty(sizes[1], np.int64)
        terms, drives = np.empty((sizes[2], 3), np.int64), np.empty((sizes[3], 2), np.int64)
        elements, driving = np.empty(sizes[4], np.int64), np.zeros(len(kept), np.uint8)
        call("dynid_plan_reduced", handle, rows, pivots, terms, drives, elements, driving)
        solved[rows] = True
        fixed = int(fixing[root])
        first = int(drawn[root])
        kind = "0" if first >= 0 and graph.nodes[names[first]].type == "0" else "1"
        if first < 0:
            return None
        net = _RootAlone(
            program,
            inputs,
            Junction(junctions[root], kind, fixing=None if fixed < 0 else names[fixed]),
            list(map(junctions.__getitem__, rows.tolist())),
            [names[element] for element in elements.tolist()],
            graph,
            structure,
            (junction_of, fixing, rows),
        )
        work = JunctionElimination(net, NoTrace())
        work.pivots = pivots.tolist()
        for name, register, origin in terms.tolist():
            term = Immittance(names[name] if name >= 0 else junctions[-2 - name], register)
            net.root.terms.append(term)
            if origin >= 0:
                work.origins[net.root, term] = NodeRow(Junction(junctions[origin], ""), 0)
        net.root.sources = {inputs[source]: register for source, register in drives.tolist()}
        driven = frozenset(inputs[k] for k in np.flatnonzero(driving).tolist())
        reductions[port] = reduction_at_root(net, work, NoTrace(), port, driven)
    return program, reductions, not solved.all()


def _junction_names(graph: BondGraph, names: list[str], drawn: list[int]) -> list[str]:
    """Return the names of junctions as `JunctionStructure` gives them."""
    if min(drawn, default=0) >= 0:
        return list(map(names.__getitem__, drawn))
    registry = NameRegistry(graph.nodes)
    return [names[node] if node >= 0 else registry.fresh("_".join(graph.bonds[-2 - node])) for node in drawn]


class _RootAlone(NodalNetwork):
    """A network of which the root is left."""

    def __init__(
        self,
        program: Program,
        inputs: Sequence[str],
        root: Junction,
        junctions: list[str],
        elements: list[str],
        graph: BondGraph,
        structure: Callable[[], JunctionStructure],
        places: tuple[Integers, Integers, Integers],
    ) -> None:
        self.program, self.inputs, self.graph, self.elements = program, tuple(inputs), graph, elements
        self._kept = frozenset(inputs)
        self.root = NodeRow(root, 0)
        self.junctions = tuple(junctions)
        self._made, self._places = structure, places

    def modelled(self, driving: frozenset[str]) -> tuple[str, ...]:
        graph, (junction_of, fixing, rows) = self.graph, self._places
        if np.isin(graph.kinds, [NUMBER_OF_TYPE[kind] for kind in TWO_PORTS]).any():
            return super().modelled(driving)
        drivers = [graph.numbers[name] for name in driving]
        is_junction = np.isin(graph.kinds, [NUMBER_OF_TYPE[kind] for kind in JUNCTIONS])
        inside = np.isin(junction_of, rows) | (is_junction & np.isin(fixing, drivers)[junction_of])
        inside[drivers] = True
        return tuple(compress(graph.nodes, inside.tolist()))

    @cached_property
    def structure(self) -> JunctionStructure:  # type: ignore[override]
        """The junction structure."""
        return self._made()
