"""Snapshots of a graph after each step of its reduction, taken only on request.

The reduction is run once more with an observer. Its program shares equal operations, so that nothing
new is written: a snapshot holds registers of the reduction that it shows.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from dynid.bondgraph.graph import Port
from dynid.bondgraph.program.program import Program, Register
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.network import Immittance, NodalNetwork, NodeRow, PortForm, port_form, reach
from dynid.bondgraph.reduction.reducer import JunctionElimination, Reducer
from dynid.bondgraph.reduction.trace import ReductionStep, TraceRecorder


@dataclass(frozen=True)
class _JunctionState:
    """A junction that is left, with what stands on it."""

    kind: str  # '0' or '1'
    nodes: tuple[str, ...]  # the user's junctions in it; empty for one that was put in between
    #: The immittances on it: impedances on a 1, admittances on a 0; elements, and what was reduced.
    terms: tuple[Immittance, ...]
    titles: dict[Immittance, str]  # the name of each of them in the steps
    sources: dict[str, Register]  # what each input feeds into its balance
    #: The same in terms of sources and equivalent sources, by the names of the steps.
    drives: dict[str, Register]


@dataclass(frozen=True)
class _SnapshotCoupling:
    """The connection of two junctions: a bond, a TF or GY, or a coupling that only the equations show."""

    #: tail, head: The junctions.
    tail: str
    head: str
    #: forward, back: Factor of the head's unknown in the tail's balance, and of the tail's in the head's.
    forward: Register
    back: Register
    drawn: bool  # whether it is one bond or two-port of the graph
    two_port: str | None  # the TF or GY in it, if any


@dataclass(frozen=True)
class Snapshot:
    """The network after a step: the nodal form K x = b over the junctions that are left."""

    step: ReductionStep | None  # the step just done; none for the graph as drawn
    root: str  # the junction of the port of interest
    junctions: dict[str, _JunctionState]  # the junctions that are left, by name
    links: tuple[_SnapshotCoupling, ...]  # the couplings between them
    #: The root's common variable for every input, where a source or a constraint fixes it; its balance then
    #: gives the source's reaction.
    known: dict[str, Register] | None
    #: The output: `common` times the root's common variable, `drive` times what its balance lacks, and
    #: `direct` times the input `by`.
    reading: PortForm
    #: changed, gone: Junctions on which something changed in this step, and those that it consumed.
    changed: tuple[str, ...]
    gone: tuple[str, ...]


def snapshots(
    structure: JunctionStructure, program: Program, port: Port, inputs: Iterable[str]
) -> tuple[Snapshot, ...]:
    """Return the network before the first step of a reduction and after every one."""
    network = NodalNetwork(structure, program, reach(structure, structure.place[port.node]), inputs)
    taker = _SnapshotTaker(network, port)
    trace = TraceRecorder(network, taker.look)
    reducer = Reducer(network, trace, balanced=False)
    taker.trace, taker.work = trace, reducer.work
    taker.look()
    reducer.run(port)
    return tuple(taker.taken)


class _SnapshotTaker:
    """Takes the last whole state of the network for every number of steps done."""

    trace: TraceRecorder
    work: JunctionElimination

    def __init__(self, network: NodalNetwork, port: Port) -> None:
        self.net, self.port = network, port
        self.taken: list[Snapshot] = []

    def look(self) -> None:
        """Take a snapshot; what changed without a step belongs to the step before."""
        steps = self.trace.steps
        if not steps and self.taken:
            return  # the graph as drawn stays as it was drawn
        del self.taken[len(steps) :]
        before = self.taken[-1].junctions if self.taken else {}
        unknown, program, fixing = self.work.held, self.net.program, self.net.root.fixing
        if unknown is not None:
            unknown = {source: unknown.get(source, program.zero) for source in self.net.inputs}
        elif fixing is not None:
            unknown = {name: program.one if name == fixing else program.zero for name in self.net.inputs}
        left = {
            row.name: (
                _JunctionState(
                    kind=row.kind,
                    nodes=tuple(self.net.structure.junctions[row.name].members),
                    terms=tuple(row.terms),
                    titles={term: self.trace.title(row, term) for term in row.terms},
                    sources=dict(row.sources),
                    drives=dict(self.trace.drives[row]),
                )
            )
            for row in self.net.left
        }
        links: list[_SnapshotCoupling] = []
        met: set[NodeRow] = set()
        for tail in self.net.left:
            met.add(tail)
            for head in tail.entries:
                if head not in met:
                    tie = self.net.tie(tail, head)
                    names, entries = (tail.name, head.name), (tail.entries[head], head.entries[tail])
                    two_port = None if tie is None else tie.two_port
                    link = _SnapshotCoupling(*names, *entries, drawn=tie is not None, two_port=two_port)
                    links.append(link)
        self.taken.append(
            Snapshot(
                step=steps[-1] if steps else None,
                root=self.net.root.name,
                junctions=left,
                links=tuple(links),
                known=unknown,
                reading=port_form(self.net, self.port, program.zero),
                changed=tuple(name for name, state in left.items() if before and state != before[name]),
                gone=tuple(name for name in before if name not in left),
            )
        )
