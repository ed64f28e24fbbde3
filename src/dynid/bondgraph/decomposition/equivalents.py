"""Source-load decomposition at a port (Park & Kim 1997, section 4): both sides as equivalent sources.

A side is the graph cut at the port with a probing source in place of the other side, reduced by the program
that reduces whole graphs. With the flow f counted out of it, it is

    f = f_eq - Y_eq e   (Norton, eq 15)   or   e = e_eq - Z_eq f   (Thévenin, eq 16).

An ideal source has one of the two only.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from math import inf
from typing import Any

from dynid.bondgraph.decomposition.graph_bisection import GraphBisection
from dynid.bondgraph.graph import JUNCTIONS, Bond, BondGraph, NodeType, Port
from dynid.bondgraph.program.program import Program, Register
from dynid.bondgraph.reduced_graph import GraphProgram
from dynid.bondgraph.reduction.junctions import NameRegistry
from dynid.bondgraph.reduction.network import STORED
from dynid.bondgraph.reduction.prototypes import Prototype
from dynid.bondgraph.reduction.reducer import Reduction, reduce_graph
from dynid.bondgraph.reduction.trace import reserve_system_names, taken_names
from dynid.errors import Singular

# --- one side --------------------------------------------------------------------------------------

#: What each input contributes to an equivalent source.
Contributions = Mapping[str, Register]


@dataclass(frozen=True)
class OnePortEquivalent:
    """One side of a port as an equivalent source."""

    name: str  # 'source' or 'load'
    end: str  # the node that the bond leaves or enters
    nodes: tuple[str, ...]  # the nodes that the port depends on, on this side
    reduction: Reduction | None  # how it was reduced; None where a source at the port is all that counts
    #: impedance, effort: Z_eq, and e_eq for each input that reaches the port; None: an ideal flow source has
    #: none.
    impedance: Register | None
    effort: Contributions | None
    #: admittance, flow: Y_eq and f_eq; None: an ideal effort source has none.
    admittance: Register | None
    flow: Contributions | None
    #: opened, shorted: Determinants of the side with the flow or the effort at the port held at zero, as far
    #: as it lets them be: their zeros are its natural modes then.
    opened: Register | None
    shorted: Register | None

    @property
    def ideal(self) -> str:
        """The variable that the side fixes whatever stands opposite: 'effort', 'flow' or none ('')."""
        return "effort" if self.admittance is None else "flow" if self.impedance is None else ""


def _one_port_equivalent(
    cut: GraphBisection, program: Program, name: str, inputs: Sequence[str], names: NameRegistry, suffix: str
) -> OnePortEquivalent:
    """Reduce one side with a probe at the port; where one kind of probe has no answer, with the other."""
    end = cut.port.tail if name == "source" else cut.port.head
    probe, failure = cut.probe(end), None
    for kind in cut.probe_types(end):
        try:
            structure = cut.structure({end: kind})
            junction = structure.junctions[structure.place[probe]]
            if junction.fixing not in (None, probe):  # nothing else of this side reaches the port
                source = str(junction.fixing)
                drives = {source: program.one} if source in inputs else {}
                contributions = _given(cut, program, end, junction.kind, drives)
                side = partial(OnePortEquivalent, name, end, (source, *junction.members), None)
                if junction.kind == "1":
                    return side(None, None, program.zero, contributions, None, program.one)
                return side(program.zero, contributions, None, None, program.one, None)
            port = Port(probe, "f" if junction.kind == "1" else "e")
            reduction = reduce_graph(structure, program, port, [*inputs, probe], names=names, suffix=suffix)
        except Singular as error:
            failure = failure or error
            continue
        if reduction.prototype.fixed and junction.fixing != probe:
            fixed = reduction.determinant()
            contributions = _given(cut, program, end, reduction.prototype.kind, reduction.channels)
            side = partial(OnePortEquivalent, name, end, _nodes(cut, reduction), reduction)
            if reduction.prototype.kind == "1":
                return side(None, None, program.zero, contributions, None, fixed)
            return side(program.zero, contributions, None, None, fixed, None)
        return _read(cut, program, name, end, reduction)
    assert failure is not None
    raise Singular(
        f"the {name} side of the port '{cut.port}' has no equivalent: {failure.problem}",
        remedy=failure.remedy,
        names=[node for node in failure.names if node in cut.graph.nodes],
    )


def _given(
    cut: GraphBisection, program: Program, end: str, kind: str, registers: Mapping[str, Register]
) -> dict[str, Register]:
    """Return the equivalent source of a side by input, without the probe and inputs that do not reach it."""
    probe = cut.probe(end)
    others = {source: r for source, r in registers.items() if source != probe and not program.is_zero(r)}
    if kind == "1" and not cut.points_out(end):  # the bond as drawn enters here: what drives it counts back
        return {source: program.neg(register) for source, register in others.items()}
    return others


def _nodes(cut: GraphBisection, reduction: Reduction) -> tuple[str, ...]:
    return tuple(node for node in reduction.modelled if node in cut.graph.nodes)


def _read(
    cut: GraphBisection, program: Program, name: str, end: str, reduction: Reduction
) -> OnePortEquivalent:
    """Return the equivalent of a side from its reduction."""
    kind = reduction.prototype.kind
    drives = _given(cut, program, end, kind, reduction.drives)
    side = partial(OnePortEquivalent, name, end, _nodes(cut, reduction), reduction)
    total = program.add(reduction.prototype.part_a, reduction.prototype.part_b)
    bare = program.determinant(reduction.others, reduction.integrators)
    joined = program.mul(bare, total)
    inverse, turned = None, None
    if not program.is_zero(total):
        inverse, turned = program.inv(total), {source: program.div(r, total) for source, r in drives.items()}
    if kind == "1":
        return side(total, drives, inverse, turned, bare, joined)
    return side(inverse, turned, total, drives, joined, bare)


# --- decomposition ---------------------------------------------------------------------------------


class Decomposition(GraphProgram):
    """A graph decomposed at a port.

    Parameters
    ----------
    port
        A bond of it, written from the source to the load.
    inputs
        Sources kept as inputs; all others are zero.
    stored
        Storages with energy at t = 0, each an equivalent source `initial:NAME` of its own (eqs 13, 14).

    Attributes
    ----------
    sources, inputs
        The sources kept, and the same with the equivalent sources of stored energy.
    driven
        The load driven by an ideal source side; None where the source side is not ideal.
    effort, flow
        The effort at the port, and the flow into the load, by input.

    Raises
    ------
    UsageError
        Where the graph cannot be cut there.
    Singular
        Where a side, or both together, have no unique solution.
    """

    def __init__(
        self, graph: BondGraph, port: Bond, inputs: Sequence[str], stored: Sequence[str] = ()
    ) -> None:
        self.cut, self.port = GraphBisection.at(graph, port), port
        self.sources = tuple(inputs)
        self.inputs = (*inputs, *(f"{STORED}{name}" for name in stored))
        super().__init__(graph)

    def _write(self) -> None:
        names = NameRegistry(taken_names(self.graph))
        self._suffix, *sides = (reserve_system_names(names, suffix) for suffix in ("", "_source", "_load"))
        self.source, self.load = (
            _one_port_equivalent(self.cut, self.program, side, self.inputs, names, suffix)
            for side, suffix in zip(("source", "load"), sides, strict=True)
        )
        source, load = self.source, self.load
        self.total: Register | None = None  # effort source against flow source: each fixes its own variable
        if source.impedance is not None and load.impedance is not None:
            self.total = self.program.add(source.impedance, load.impedance)
        elif source.admittance is not None and load.admittance is not None:
            self.total = self.program.add(source.admittance, load.admittance)
        if self.total is not None and self.program.is_zero(self.total):
            raise Singular(
                f"source and load at the port '{self.port}' contradict each other, or leave it open: "
                "together they have no impedance",
                remedy="Put an element between them.",
                names=(self.port.tail, self.port.head),
            )
        self.driven: Reduction | None = None
        if source.ideal:  # the load is reduced with the source side as its source
            probe: NodeType = "Se" if source.ideal == "effort" else "Sf"
            structure = self.cut.structure({load.end: probe})
            name = self.cut.probe(load.end)
            port = Port(name, "f" if structure.junctions[structure.place[name]].kind == "1" else "e")
            suffix = self._suffix
            self.driven = reduce_graph(structure, self.program, port, [name], names=names, suffix=suffix)
        self.effort = {name: self._effort(name) for name in self.inputs}
        self.flow = {name: self._flow(name) for name in self.inputs}

    @property
    def reductions(self) -> dict[str, Reduction]:
        """The reductions of the sides, and that of a driven load."""
        sides = {side.name: side.reduction for side in (self.source, self.load) if side.reduction is not None}
        return sides | ({} if self.driven is None else {"driven load": self.driven})

    def pivots(self) -> list[int]:
        """Return the registers that the program divides by."""
        pivots: list[Register] = []
        for side in (self.source, self.load):
            pivots += side.reduction.pivots if side.reduction is not None else ()
            immittances = (side.impedance, side.admittance)
            pivots += [r for r in immittances if r is not None and not self.program.is_zero(r)]
        if self.driven is not None:
            pivots += self.driven.pivots
        return pivots if self.total is None else [*pivots, self.total]

    def answers(self) -> Iterable[int]:
        """Return the registers that will be asked for."""
        yield from [*self.effort.values(), *self.flow.values()]
        for side in (self.source, self.load):
            yield from [*(side.effort or {}).values(), *(side.flow or {}).values()]
            registers = (side.impedance, side.admittance, side.opened, side.shorted)
            yield from (register for register in registers if register is not None)
        if self.driven is not None:
            yield from (register for _, register in self.driven.prototype.systems)

    def _effort(self, name: str) -> Register:
        """Write the effort at the port that an input makes."""
        program, source, load = self.program, self.source, self.load
        if source.effort is not None and source.ideal:
            return source.effort.get(name, program.zero)
        if load.effort is not None and load.impedance is not None:
            effort = load.effort.get(name, program.zero)
            return program.add(effort, program.mul(load.impedance, self._flow(name)))
        assert self.total is not None
        return program.div(self._sum(source.flow, load.flow, name), self.total)

    def _flow(self, name: str) -> Register:
        """Write the flow into the load that an input makes."""
        program, source, load = self.program, self.source, self.load
        if source.flow is not None and source.ideal:
            return source.flow.get(name, program.zero)
        if source.effort is not None and load.effort is not None:
            assert self.total is not None
            against = {source: program.neg(register) for source, register in load.effort.items()}
            return program.div(self._sum(source.effort, against, name), self.total)
        assert load.flow is not None
        drives_flow = program.neg(load.flow.get(name, program.zero))
        if load.admittance is None or program.is_zero(load.admittance):
            return drives_flow
        return program.add(drives_flow, program.mul(load.admittance, self._effort(name)))

    def _sum(self, a: Contributions | None, b: Contributions | None, name: str) -> Register:
        zero = self.program.zero
        return self.program.add((a or {}).get(name, zero), (b or {}).get(name, zero))

    @cached_property
    def prototype(self) -> Prototype:
        """The prototype at the port (Fig. 2), with the equivalent source of the source side as its source.

        An ideal source drives the two systems on the load's junction. Any other is one of the two systems,
        the load the other; B is the one that sets the common variable by integration, the load where both
        could. They meet on the load's junction, else the source's, else a 1-junction.
        """
        if self.driven is not None:
            return self.driven.prototype
        ends = (self.load.end, self.source.end)
        kinds = [kind for end in ends if (kind := self.graph.nodes[end].type) in JUNCTIONS]
        kind = "0" if self.load.ideal == "flow" else "1"
        if kinds and not self.load.ideal:
            kind = kinds[0]
        source, load = (
            (self.source.impedance, self.load.impedance)
            if kind == "1"
            else (self.source.admittance, self.load.admittance)
        )
        assert source is not None
        assert load is not None
        growth = []  # the degree of the numerator less that of the denominator; zero sets nothing
        for ratio in map(self.rational((source, load)).__getitem__, (source, load)):
            numerator, denominator = ratio.lowest_terms()
            growth.append(int(numerator.degree()) - int(denominator.degree()) if numerator else -inf)
        b_is_load = growth[1] >= growth[0]
        part_a, part_b = (source, load) if b_is_load else (load, source)
        names = ("the source side", "the load side")
        names = names if b_is_load else names[::-1]
        determinant, suffix = self._determinant, self._suffix
        return Prototype(self.program, kind, False, part_a, part_b, *names, determinant, suffix=suffix)

    @property
    def meeting(self) -> str:
        """The user's junction at the port, or the bond where neither end is one."""
        ends = (self.load.end, self.source.end)
        return next((end for end in ends if self.graph.nodes[end].type in JUNCTIONS), str(self.port))

    def characteristic(self) -> Any:
        """Return the polynomial of all natural modes of both sides joined (flint `fmpz_poly`)."""
        register = self._determinant()
        return self.rational([register])[register].lowest_terms()[0]

    def _determinant(self) -> Register:
        source, load = self.source, self.load
        parts: tuple[Register | None, ...]
        if source.impedance is not None and load.impedance is not None:
            parts = source.opened, load.opened, self.total
        elif source.admittance is not None and load.admittance is not None:
            parts = source.shorted, load.shorted, self.total
        else:
            parts = (
                (source.opened, load.shorted) if source.ideal == "effort" else (source.shorted, load.opened)
            )
        return self.program.product(factor for factor in parts if factor is not None)
