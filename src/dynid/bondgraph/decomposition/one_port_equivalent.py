"""One side of a port as an equivalent source (Park & Kim 1997, section 4).

The side is the graph cut at the port with a probing source in place of the other side, reduced by the program
that reduces whole graphs. With the flow f counted out of it, it is

    f = f_eq - Y_eq e   (Norton, eq 15)   or   e = e_eq - Z_eq f   (Thévenin, eq 16).

An ideal source has one of the two only.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from dynid.bondgraph.decomposition.graph_bisection import GraphBisection
from dynid.bondgraph.graph import Port
from dynid.bondgraph.program.program import Program, Register
from dynid.bondgraph.reduction.junctions import Junction, NameRegistry
from dynid.bondgraph.reduction.reducer import Reduction, reduce_graph
from dynid.errors import Singular

#: What each input contributes to an equivalent source.
Contributions = Mapping[str, Register]


@dataclass(frozen=True)
class OnePortEquivalent:
    """One side of a port as an equivalent source.

    Parameters
    ----------
    name
        'source' or 'load'.
    end
        The node that the bond leaves or enters.
    nodes
        The nodes that the port depends on, on this side.
    reduction
        How it was reduced; None where a source at the port is all that counts.
    impedance, effort
        Z_eq, and e_eq for each input that reaches the port; None: an ideal flow source has none.
    admittance, flow
        Y_eq and f_eq; None: an ideal effort source has none.
    opened, shorted
        Determinants of the side with the flow or the effort at the port held at zero, as far as it lets
        them be: their zeros are its natural modes then.
    """

    name: str
    end: str
    nodes: tuple[str, ...]
    reduction: Reduction | None
    impedance: Register | None
    effort: Contributions | None
    admittance: Register | None
    flow: Contributions | None
    opened: Register | None
    shorted: Register | None

    @property
    def ideal(self) -> str:
        """The variable that the side fixes whatever stands opposite: 'effort', 'flow' or none ('')."""
        return "effort" if self.admittance is None else "flow" if self.impedance is None else ""


def one_port_equivalent(
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
                return _fixed(cut, program, name, end, junction, inputs)
            port = Port(probe, "f" if junction.kind == "1" else "e")
            reduction = reduce_graph(structure, program, port, [*inputs, probe], names=names, suffix=suffix)
        except Singular as error:
            failure = failure or error
            continue
        if reduction.prototype.fixed and junction.fixing != probe:
            fixed = _product(program, reduction.pivots, reduction.integrators)
            given = _given(cut, program, end, reduction.prototype.kind, reduction.channels)
            side = partial(OnePortEquivalent, name, end, _nodes(cut, reduction), reduction)
            if reduction.prototype.kind == "1":
                return side(None, None, program.zero, given, None, fixed)
            return side(program.zero, given, None, None, fixed, None)
        return _read(cut, program, name, end, reduction)
    assert failure is not None
    raise Singular(
        f"the {name} side of the port '{cut.port}' has no equivalent: {failure.problem}",
        remedy=failure.remedy,
        names=[node for node in failure.names if node in cut.graph.nodes],
    )


def _fixed(
    cut: GraphBisection, program: Program, name: str, end: str, junction: Junction, inputs: Sequence[str]
) -> OnePortEquivalent:
    """Return a side whose junction at the port has its common variable fixed by a source on it."""
    source = str(junction.fixing)
    registers = {source: program.one} if source in inputs else {}
    given = _given(cut, program, end, junction.kind, registers)
    side = partial(OnePortEquivalent, name, end, (source, *junction.members), None)
    if junction.kind == "1":
        return side(None, None, program.zero, given, None, program.one)
    return side(program.zero, given, None, None, program.one, None)


def _given(
    cut: GraphBisection, program: Program, end: str, kind: str, registers: Mapping[str, Register]
) -> dict[str, Register]:
    """Return what drives the port out of a side, without the probe and without what does not reach it."""
    probe = cut.probe(end)
    given = {source: r for source, r in registers.items() if source != probe and not program.is_zero(r)}
    if kind == "1" and not cut.points_out(end):  # the bond as drawn enters here: what drives it counts back
        return {source: program.neg(register) for source, register in given.items()}
    return given


def _nodes(cut: GraphBisection, reduction: Reduction) -> tuple[str, ...]:
    return tuple(node for node in reduction.modelled if node in cut.graph.nodes)


def _read(
    cut: GraphBisection, program: Program, name: str, end: str, reduction: Reduction
) -> OnePortEquivalent:
    """Read a side's equivalent off its reduction."""
    kind = reduction.prototype.kind
    given = _given(cut, program, end, kind, reduction.drives)
    side = partial(OnePortEquivalent, name, end, _nodes(cut, reduction), reduction)
    total = program.add(reduction.prototype.part_a, reduction.prototype.part_b)
    bare = _product(program, reduction.others, reduction.integrators)
    joined = program.mul(bare, total)
    inverse, turned = None, None
    if not program.is_zero(total):
        inverse, turned = program.inv(total), {source: program.div(r, total) for source, r in given.items()}
    if kind == "1":
        return side(total, given, inverse, turned, bare, joined)
    return side(inverse, turned, total, given, joined, bare)


def _product(program: Program, pivots: Iterable[Register], integrators: int) -> Register:
    """Write a determinant: the product of pivots, times s for every storage that integrates."""
    return program.product([*pivots, *(program.s for _ in range(integrators))])
