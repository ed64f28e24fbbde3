"""The reduction of a bond graph to one equation at the port of interest, as a program of steps.

Park & Kim 1997, section 4: source-load decomposition with series and parallel superposition (eqs 1, 2),
reflection through TF and GY, junction merging, and the swap between a flow source on a 0-junction and an
effort source on a 1-junction (eqs 15, 16). Leaves are eliminated first, farthest from the port first, so
that a tree collapses step by step; a junction on a loop is eliminated by its multiport equivalent, and a
bare junction by the constraint it states.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduction.elimination import Elimination
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.network import Network, Row
from dynid.bondgraph.reduction.port import channel, port_form
from dynid.bondgraph.reduction.program import Program, Register
from dynid.bondgraph.reduction.prototypes import Prototype, split_root
from dynid.bondgraph.reduction.singularity import explain_singularity
from dynid.bondgraph.reduction.steps import Step
from dynid.bondgraph.reduction.telling import Told, Untold


@dataclass(frozen=True)
class Reduction:
    """A graph reduced to a prototype at one port.

    Parameters
    ----------
    port
        The output asked for.
    root
        The junction of the port of interest.
    steps
        What was done, in order; the last one names the prototype.
    prototype
        The prototype reached, with its two systems A and B.
    drives
        What each input feeds into the root's balance.
    channels
        The transfer function from each input to the port; inputs that cannot reach it have zero.
    pivots
        Registers whose product is the determinant of the nodal form, up to sign.
    structure
        The junction structure.
    junctions
        Those of its junctions that were reduced.
    driving
        The inputs that drive them.
    labels
        Names of registers in the equations of the steps.
    """

    port: Port
    root: str
    steps: tuple[Step, ...]
    prototype: Prototype
    drives: dict[str, Register]
    channels: dict[str, Register]
    pivots: tuple[Register, ...]
    structure: JunctionStructure
    junctions: tuple[str, ...]
    driving: frozenset[str]
    labels: dict[Register, str]

    @cached_property
    def modelled(self) -> tuple[str, ...]:
        """The nodes on the junctions that were reduced, and what drives them from outside."""
        structure, reached = self.structure, set(self.junctions)
        inside = {name for name, place in structure.place.items() if place in reached} | self.driving
        for junction in structure.junctions.values():
            if junction.fixing in self.driving:  # the port depends on it through its known variable only
                inside.update(junction.members)
        for coupling in structure.couplings:
            if coupling.two_port is not None and reached & {coupling.tail, coupling.head}:
                inside.add(coupling.two_port)
        return tuple(name for name in structure.graph.nodes if name in inside)

    @cached_property
    def dropped(self) -> tuple[str, ...]:
        """The other nodes: behind an ideal source, or not connected."""
        inside = set(self.modelled)
        return tuple(name for name in self.structure.graph.nodes if name not in inside)

    @property
    def integrators(self) -> int:
        """How many storages integrate: their immittance has s in the denominator."""
        nodes = self.structure.graph.nodes
        standing = ((self.structure.junctions[name].kind, name) for name in self.junctions)
        return sum(
            (kind, nodes[element].type) in {("1", "C"), ("0", "I")}
            for kind, name in standing
            for element in self.structure.junctions[name].elements
        )


def reduce_graph(
    structure: JunctionStructure,
    program: Program,
    port: Port,
    inputs: Iterable[str],
    *,
    traced: bool = True,
    balanced: bool = False,
) -> Reduction:
    """Reduce a graph to a prototype at the junction that carries an output.

    Parameters
    ----------
    structure
        The graph's junction structure.
    program
        Where the arithmetic is written; several reductions may share one.
    port
        The output; its junction is the port of interest.
    inputs
        The sources to keep; all others are zero.
    traced
        Whether the steps are told, which takes as long again.
    balanced
        Whether loops are opened everywhere at once rather than from the far end on (`Reducer`).

    Raises
    ------
    Singular
        Where the equations have no solution or more than one; it names the junctions and sources.
    """
    network = Network(structure, program, structure.place[port.node], inputs)
    return Reducer(network, Told(network) if traced else Untold(), balanced=balanced).run(port)


class Reducer:
    """Eliminates every junction but the root, and reads the prototype off what is left.

    Parameters
    ----------
    network
        The network to reduce; it shrinks.
    story
        Where the steps are told.
    balanced
        Whether loops are opened in rounds, of junctions that do not touch each other (cyclic reduction):
        results then depend on one another over as many steps as the logarithm of the graph's length, where
        one end after the other takes as many as the length, and error bounds grow with each. It takes up to
        twice the steps.

    Attributes
    ----------
    work
        The elimination, with the pivots so far.
    """

    def __init__(self, network: Network, story: Untold, *, balanced: bool) -> None:
        self._balanced = balanced
        self.net, self.program, self.root, self.story = network, network.program, network.root, story
        self.work = Elimination(network, story)
        self._driving = frozenset(name for row in network.rows.values() for name in row.sources)

    def run(self, port: Port) -> Reduction:
        """Reduce the network to the prototype at its root, for an output there."""
        self._eliminate_all()
        prototype = self._prototype(port)
        total = self.program.add(prototype.part_a, prototype.part_b)
        if not prototype.fixed:
            if self.program.is_zero(total):
                raise self._singular()
            self.work.pivots.append(total)
        form = port_form(self.net, port, total)
        self.story.reached(prototype, port, form)
        return Reduction(
            port=port,
            root=self.root.name,
            steps=tuple(self.story.steps),
            prototype=prototype,
            drives=dict(self.root.sources),
            channels={
                source: channel(self.net, form, source, self._common(source, total))
                for source in self.net.inputs
            },
            pivots=tuple(self.work.pivots),
            structure=self.net.structure,
            junctions=tuple(self.net.rows),
            driving=self._driving,
            labels=self.story.labels,
        )

    def _common(self, source: str, total: Register) -> Register:
        """Write the transfer function from a source to the root's common variable (eqs 1 to 4)."""
        program, fixing = self.program, self.root.fixing
        if self.work.held is not None:
            return self.work.held.get(source, program.zero)
        if fixing is not None:
            return program.one if source == fixing else program.zero
        return program.div(self.root.sources.get(source, program.zero), total)

    def _prototype(self, port: Port) -> Prototype:
        element, rest = split_root(self.net, port, self._root_known())
        part_a = self.program.sum(term.register for term in rest)
        self.story.superposed(self.root, rest, part_a, "Z_A" if self.root.kind == "1" else "Y_A")
        return Prototype(
            program=self.program,
            kind=self.root.kind,
            fixed=self._root_known(),
            part_a=part_a,
            part_b=element.register,
            name_a=", ".join(term.name for term in rest) or "nothing",
            name_b=element.name,
        )

    def _root_known(self) -> bool:
        """Tell whether a source, or a bare junction beside it, fixes the root's unknown."""
        return self.work.held is not None or self.root.fixing is not None

    def _eliminate_all(self) -> None:
        """Eliminate leaves first, then what has most to say to the fewest; at last what is still bare."""
        nearest_first = list(self.net.rows.values())
        rows = sorted(nearest_first, key=attrgetter("depth"), reverse=True)
        rows.remove(self.root)
        for rank, row in enumerate(rows):
            row.rank = rank
        self._eliminate_in_turn([row for row in rows if len(row.entries) < 2], most=1)
        self._eliminate_in_turn([row for row in rows if not row.gone], most=len(rows))
        self._eliminate_bare([row for row in nearest_first if not row.gone and row is not self.root])

    def _eliminate_in_turn(self, rows: list[Row], most: int) -> None:
        """Eliminate by (round, number of neighbours, distance from the root), up to so many neighbours."""
        turns = [_turn(row) for row in rows]
        heapq.heapify(turns)
        while turns:
            turn = heapq.heappop(turns)
            row = turn[-1]
            if row.gone or turn != _turn(row):
                continue  # eliminated already, or queued again with its new neighbours
            around = self._eliminate_next(row)
            following = row.round + 1 if self._balanced and len(around) > 1 else 0
            for other in around:
                other.round = max(other.round, following)
                if other is not self.root and len(other.entries) <= most:
                    heapq.heappush(turns, _turn(other))

    def _eliminate_next(self, row: Row) -> list[Row]:
        """Eliminate a junction if something stands on it, or if it is bare and a dead end."""
        own = self.net.diagonal(row)
        if not self.program.is_zero(own):
            return self.work.eliminate(row, own)
        neighbours = list(row.entries)
        if len(neighbours) == 1 and neighbours[0] is not self.root and self.work.paired(row, neighbours[0]):
            return self.work.eliminate_pair(neighbours[0], row)
        return []  # nothing stands on it yet; it is queued again when a neighbour is eliminated

    def _eliminate_bare(self, rows: list[Row]) -> None:
        """Eliminate junctions on which nothing stands, each with a neighbour that its balance fixes."""
        for row in rows:
            if row.gone:
                continue
            own = self.net.diagonal(row)
            if not self.program.is_zero(own):
                self.work.eliminate(row, own)
                continue
            partners = [other for other in row.entries if self.work.paired(row, other)]
            others = [other for other in partners if other is not self.root]
            if others:
                self.work.eliminate_pair(others[0], row)
            elif partners and not self._root_known():
                self.work.hold_root(row)
            else:
                raise self._singular()

    def _singular(self) -> Exception:
        net = self.net
        return explain_singularity(Network(net.structure, self.program, self.root.name, net.inputs))


def _turn(row: Row) -> tuple[int, int, int, Row]:
    """Return when a junction is eliminated: leaves first, fill low, the farthest from the root first."""
    degree = len(row.entries)
    return (row.round if degree > 1 else 0, degree, row.rank, row)
