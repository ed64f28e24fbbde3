"""The reduction of a bond graph to one equation at the port of interest, as a program of steps.

Park & Kim 1997, section 4: source-load decomposition with series and parallel superposition (eqs 1, 2),
reflection through TF and GY, junction merging, and the swap between a flow source on a 0-junction and an
effort source on a 1-junction (eqs 15, 16). Leaves are eliminated first, farthest from the port first, so
that a tree collapses step by step; a junction on a loop is eliminated by its multiport equivalent, and a
bare junction by the constraint that it states.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from operator import attrgetter

from dynid.bondgraph.graph import Port
from dynid.bondgraph.program.program import Program, Register
from dynid.bondgraph.reduction.junctions import JunctionStructure, NameRegistry
from dynid.bondgraph.reduction.network import (
    BOND,
    Immittance,
    NodalNetwork,
    NodeRow,
    Tie,
    channel,
    port_form,
    reach,
)
from dynid.bondgraph.reduction.prototypes import Prototype, split_root
from dynid.bondgraph.reduction.solvability import explain
from dynid.bondgraph.reduction.trace import NoTrace, ReductionStep, TraceRecorder

# --- elimination of one junction ------------------------------------------------------------------


class JunctionElimination:
    """A network under elimination, with the pivots met so far.

    Attributes
    ----------
    pivots
        The registers divided by.
    held
        The root's unknown by inputs, where a bare neighbour fixes it.
    holding
        The pivot that fixes it.
    origins
        The junction whose elimination left a term on another, by that other one and the term.
    """

    def __init__(self, network: NodalNetwork, trace: NoTrace) -> None:
        self.net, self.program, self.root = network, network.program, network.root
        self.trace = trace
        self.pivots: list[Register] = []
        self.held: dict[str, Register] | None = None
        self.holding: Register | None = None
        self.origins: dict[tuple[NodeRow, Immittance], NodeRow] = {}

    def eliminate(self, row: NodeRow, total: Register) -> list[NodeRow]:
        """Eliminate a junction on which something stands, in all `total`; return its former neighbours."""
        neighbours = list(row.entries)
        self.trace.superposed(row, row.terms, total)
        self.pivots.append(total)
        tie = self.net.tie(row, neighbours[0]) if len(neighbours) == 1 else None
        if not neighbours:
            self._remove(row)
        elif tie is None:  # on a loop, or tied to its only neighbour by more than a bond
            self._eliminate_on_loop(row, neighbours, total)
        elif tie.two_port is not None:
            self._reflect(row, neighbours[0], total, tie)
        elif row.sources:
            self._transform_source(row, neighbours[0], Immittance(row.origin, self.program.inv(total)))
        else:
            self._stand(neighbours[0], Immittance(row.origin, self.program.inv(total)), row)
            self._remove(row)
        return neighbours

    def _stand(self, row: NodeRow, term: Immittance, origin: NodeRow) -> None:
        """Add an immittance that an elimination leaves to a junction."""
        row.terms.append(term)
        self.origins[row, term] = origin

    def _remove(self, row: NodeRow) -> None:
        """Remove an eliminated junction, after which the network is whole."""
        self.net.remove(row)
        self.trace.done()

    def _reflect(self, leaf: NodeRow, into: NodeRow, total: Register, tie: Tie) -> None:
        """Reflect a leaf through a TF or GY, Z1 = n^2 Z2 or Z1 = r^2 / Z2; then transform its sources."""
        net, program = self.net, self.program
        modulus = program.parameter(str(tie.two_port))
        square = program.mul(modulus, modulus)
        inverse = program.inv(program.mul(square, total)) if tie.inverse else program.inv(total)
        total = inverse if tie.inverse else program.mul(square, inverse)
        seen = Immittance(str(tie.two_port), total)
        self.trace.reflected(leaf, into, seen)
        if leaf.sources:
            # the leaf is drawn on the near side: its unknown and balance in the neighbour's units
            size = net.entry(into, leaf)
            leaf.sources = {source: program.div(amount, size) for source, amount in leaf.sources.items()}
            self.trace.moved(leaf, size)
            leaf.terms = [Immittance(seen.name, program.inv(seen.register))]
            into.entries[leaf], leaf.entries[into] = program.one, program.neg(program.one)
            net.retie(into, leaf, BOND)
            self.trace.done()
            self._transform_source(leaf, into, seen, tie.two_port)
        else:
            self._stand(into, seen, leaf)
            self._remove(leaf)

    def _transform_source(
        self, leaf: NodeRow, into: NodeRow, seen: Immittance, two_port: str | None = None
    ) -> None:
        """Transform the source on a leaf (eq 16): from Norton there to Thévenin on its neighbour, or back."""
        net, program = self.net, self.program
        factor = program.mul(program.neg(into.entries[leaf]), seen.register)
        for source, amount in leaf.sources.items():
            net.feed(into, source, program.mul(factor, amount))
        self.trace.swapped(leaf, into, factor, two_port)
        self._stand(into, seen, leaf)
        self._remove(leaf)
        if two_port is None:
            self.trace.merged(leaf, into)

    def _eliminate_on_loop(self, row: NodeRow, neighbours: list[NodeRow], total: Register) -> None:
        """Eliminate a junction by its multiport equivalent: the Schur complement of the nodal form."""
        net, program = self.net, self.program
        inverse = program.inv(total)
        factors = {neighbour: program.mul(neighbour.entries[row], inverse) for neighbour in neighbours}
        changes = {
            (row_of, column_of): program.neg(program.mul(factor, row.entries[column_of]))
            for row_of, factor in factors.items()
            for column_of in neighbours
        }
        for (row_of, column_of), change in changes.items():
            self._add(row_of, column_of, change, row)
        for column_of, factor in factors.items():
            for source, amount in row.sources.items():
                net.feed(column_of, source, program.mul(program.neg(factor), amount))
        self.trace.eliminated(row, factors, changes)
        self._remove(row)

    def _add(self, row: NodeRow, column: NodeRow, change: Register, origin: NodeRow) -> None:
        if self.program.is_zero(change):
            return
        if row is not column:
            self.net.add_entry(row, column, change)
            return
        for term in row.terms:  # what an earlier elimination left there may be taken back
            if (row, term) in self.origins and self.program.are_opposite(term.register, change):
                row.terms.remove(term)
                del self.origins[row, term]
                return
        self._stand(row, Immittance(origin.name, change), origin)

    # --- bare junctions ------------------------------------------------------------------------

    @property
    def root_known(self) -> bool:
        """True where a source, or a bare junction beside it, fixes the root's unknown."""
        return self.held is not None or self.root.fixing is not None

    def paired(self, a: NodeRow, b: NodeRow) -> bool:
        """Test whether two junctions appear in each other's balance, so that they can be one pivot."""
        zero = self.program.is_zero
        return not zero(self.net.entry(a, b)) and not zero(self.net.entry(b, a))

    def hold_root(self, bare: NodeRow) -> None:
        """Take the root's unknown from the balance of a bare neighbour."""
        program, root = self.program, self.root
        entry = bare.entries[root]
        self.held = {source: program.div(amount, entry) for source, amount in bare.sources.items()}
        self.holding = program.mul(entry, root.entries[bare])
        self.trace.constrained(bare, root, {})
        self._remove(bare)

    def eliminate_pair(self, partner: NodeRow, bare: NodeRow) -> list[NodeRow]:
        """Eliminate a bare junction with a neighbour, a 2 x 2 pivot [[d, a], [b, 0]]; return those around."""
        net, program = self.net, self.program
        a, b = partner.entries[bare], bare.entries[partner]
        d = net.diagonal(partner)
        self.pivots.append(program.mul(a, b))
        around = [row for row in {**partner.entries, **bare.entries} if row not in (partner, bare)]

        def solve(of_partner: Register, of_bare: Register) -> tuple[Register, Register]:
            x = program.div(of_bare, b)
            return x, program.div(program.sub(of_partner, program.mul(d, x)), a)

        columns = {column: solve(net.entry(partner, column), net.entry(bare, column)) for column in around}
        of_partner_sources, of_bare_sources = partner.sources, bare.sources
        zero, of_both = program.zero, {**of_partner_sources, **of_bare_sources}
        sides = {
            source: solve(of_partner_sources.get(source, zero), of_bare_sources.get(source, zero))
            for source in of_both
        }
        changes: dict[tuple[NodeRow, NodeRow], Register] = {}
        for row in around:
            left = (net.entry(row, partner), net.entry(row, bare))
            for column, solved in columns.items():
                change = changes[row, column] = program.neg(_dot(program, left, solved))
                self._add(row, column, change, partner)
            for source, solved in sides.items():
                net.feed(row, source, program.neg(_dot(program, left, solved)))
            self.trace.driven(row)
        self.trace.constrained(bare, partner, changes)
        self.net.remove(bare)
        self._remove(partner)
        return around


def _dot(program: Program, left: tuple[Register, Register], right: tuple[Register, Register]) -> Register:
    return program.add(program.mul(left[0], right[0]), program.mul(left[1], right[1]))


# --- order of elimination -------------------------------------------------------------------------


@dataclass(frozen=True)
class Reduction:
    """A graph reduced to a prototype at one port."""

    port: Port  # the output asked for
    root: str  # the junction of the port of interest
    steps: tuple[ReductionStep, ...]  # what was done, in order; the last one names the prototype
    prototype: Prototype  # the prototype reached, with its two systems A and B
    drives: dict[str, Register]  # what each input feeds into the root's balance
    #: The transfer function from each input to the port; inputs that cannot reach it have zero.
    channels: dict[str, Register]
    pivots: tuple[Register, ...]  # registers whose product is the determinant of the nodal form, up to sign
    others: tuple[Register, ...]  # the same without what solves for the root's own common variable
    network: NodalNetwork  # what was reduced
    junctions: tuple[str, ...]  # the junctions that were reduced
    driving: frozenset[str]  # the inputs that drive them
    labels: dict[Register, str]  # names of registers in the equations of the steps

    @property
    def structure(self) -> JunctionStructure:
        """The junction structure."""
        return self.network.structure

    @cached_property
    def modelled(self) -> tuple[str, ...]:
        """The nodes on the junctions that were reduced, and what drives them from outside."""
        return self.network.modelled(self.driving)

    @cached_property
    def dropped(self) -> tuple[str, ...]:
        """The other nodes: behind an ideal source, or not connected."""
        inside = set(self.modelled)
        return tuple(name for name in self.structure.graph.nodes if name not in inside)

    @property
    def integrators(self) -> int:
        """Number of storage elements in integral causality: their immittance has s in the denominator."""
        return _integrators(self.structure, self.junctions)

    def determinant(self) -> Register:
        """Write the determinant of the nodal form, times s for every storage that integrates there."""
        return self.network.program.determinant(self.pivots, self.integrators)


def reduce_graph(
    structure: JunctionStructure,
    program: Program,
    port: Port,
    inputs: Iterable[str],
    *,
    traced: bool = True,
    balanced: bool = False,
    names: NameRegistry | None = None,
    suffix: str = "",
) -> Reduction:
    """Reduce a graph to a prototype at the junction that carries an output.

    `program`: where the arithmetic is written; several reductions may share one. `balanced`: whether loops
    are opened everywhere at once rather than from the far end on (`Reducer`). `names` and `suffix`: the names
    that are taken, and what stands behind those of the systems (`TraceRecorder`). Raises `Singular` where the
    equations have no solution or more than one; it names the junctions and sources.
    """
    network = NodalNetwork(structure, program, reach(structure, structure.place[port.node]), inputs)
    trace = TraceRecorder(network, names=names, suffix=suffix) if traced else NoTrace()
    return Reducer(network, trace, balanced=balanced).run(port)


class Reducer:
    """Eliminates every junction but the root, and reads the prototype off what is left.

    `balanced`: whether loops are opened in rounds, of junctions that do not touch each other (cyclic
    reduction): results then depend on one another over as many steps as the logarithm of the graph's length,
    where one end after the other takes as many as the length, and error bounds grow with each. It takes up to
    twice the steps. `work`: the elimination, with the pivots so far.
    """

    def __init__(self, network: NodalNetwork, trace: NoTrace, *, balanced: bool) -> None:
        self._balanced = balanced
        self.net, self.program, self.root, self.trace = network, network.program, network.root, trace
        self.work = JunctionElimination(network, trace)
        self._driving = frozenset(name for row in network.rows.values() for name in row.sources)

    def run(self, port: Port) -> Reduction:
        """Reduce the network to the prototype at its root, for an output there."""
        # leaves first, then the junctions with the fewest neighbours; at last those that are still bare
        nearest_first = list(self.net.rows.values())
        rows = sorted(nearest_first, key=attrgetter("depth"), reverse=True)
        rows.remove(self.root)
        for rank, row in enumerate(rows):
            row.rank = rank
        self._eliminate_in_turn([row for row in rows if len(row.entries) < 2], max_degree=1)
        self._eliminate_in_turn([row for row in rows if not row.gone], max_degree=len(rows))
        self._eliminate_bare([row for row in nearest_first if not row.gone and row is not self.root])
        return reduction_at_root(self.net, self.work, self.trace, port, self._driving)

    def _eliminate_in_turn(self, rows: list[NodeRow], max_degree: int) -> None:
        """Eliminate by (round, number of neighbours, distance from the root), up to so many neighbours."""
        paired = self.work.paired
        turns = [_turn(row) for row in rows]
        heapq.heapify(turns)
        while turns:
            turn = heapq.heappop(turns)
            row = turn[-1]
            if row.gone or turn != _turn(row):
                continue  # eliminated already, or queued again with its new neighbours
            total, neighbours = self.net.diagonal(row), list(row.entries)
            if not self.program.is_zero(total):
                around = self.work.eliminate(row, total)
            elif len(neighbours) == 1 and neighbours[0] is not self.root and paired(row, neighbours[0]):
                around = self.work.eliminate_pair(neighbours[0], row)
            else:
                continue  # nothing stands on it yet; it is queued again when a neighbour is eliminated
            following = row.round + 1 if self._balanced and len(around) > 1 else 0
            for neighbour in around:
                neighbour.round = max(neighbour.round, following)
                if neighbour is not self.root and len(neighbour.entries) <= max_degree:
                    heapq.heappush(turns, _turn(neighbour))

    def _eliminate_bare(self, rows: list[NodeRow]) -> None:
        """Eliminate junctions on which nothing stands, each with a neighbour that its balance fixes."""
        for row in rows:
            if row.gone:
                continue
            total = self.net.diagonal(row)
            if not self.program.is_zero(total):
                self.work.eliminate(row, total)
                continue
            partners = [neighbour for neighbour in row.entries if self.work.paired(row, neighbour)]
            others = [neighbour for neighbour in partners if neighbour is not self.root]
            if others:
                self.work.eliminate_pair(others[0], row)
            elif partners and not self.work.root_known:
                self.work.hold_root(row)
            else:
                raise explain(self.net.structure)


def reduction_at_root(
    net: NodalNetwork, work: JunctionElimination, trace: NoTrace, port: Port, driving: frozenset[str]
) -> Reduction:
    """Return the reduction of a network of which the root is left.

    Raises `Singular` where the root's balance leaves its common variable open.
    """
    program, root = net.program, net.root
    # the prototype, and the eliminated junctions behind A and B, before the trace adds their terms up
    element, rest = split_root(net, port, work.root_known)
    part_a = program.sum(term.register for term in rest)
    factors = (*work.pivots, program.add(part_a, element.register))
    behind: tuple[set[str], set[str]] = set(), set()
    for term in root.terms:
        origin = work.origins.get((root, term))
        if origin is not None:
            behind[term is element].add(origin.name)
    origins = frozenset(behind[0]), frozenset(behind[1])
    label = f"{'Z' if root.kind == '1' else 'Y'}_A{trace.suffix}"
    trace.superposed(root, rest, part_a, label)
    prototype = Prototype(
        program=program,
        kind=root.kind,
        fixed=work.root_known,
        part_a=part_a,
        part_b=element.register,
        name_a=", ".join(term.name for term in rest) or "nothing",
        name_b=element.name,
        released=lambda: net.program.determinant(factors, _integrators(net.structure, net.junctions)),
        shared=partial(_shared, net, *origins),
        suffix=trace.suffix,
    )
    total = program.add(prototype.part_a, prototype.part_b)
    others, pivot = tuple(work.pivots), work.holding
    if not prototype.fixed:
        if program.is_zero(total):
            raise explain(net.structure)
        pivot = total
    form = port_form(net, port, total)
    trace.reached(prototype, port, form)
    channels = {}
    for source in net.inputs:  # the root's common variable first (eqs 1 to 4)
        if work.held is not None:
            common = work.held.get(source, program.zero)
        elif root.fixing is not None:
            common = program.one if source == root.fixing else program.zero
        else:
            common = program.div(root.sources.get(source, program.zero), total)
        channels[source] = channel(net, form, source, common)
    return Reduction(
        port=port,
        root=root.name,
        steps=tuple(trace.steps),
        prototype=prototype,
        drives=dict(root.sources),
        channels=channels,
        pivots=others if pivot is None else (*others, pivot),
        others=others,
        network=net,
        junctions=net.junctions,
        driving=driving,
        labels=trace.labels,
    )


def _turn(row: NodeRow) -> tuple[int, int, int, NodeRow]:
    """Return when a junction is eliminated: leaves first, fill low, the farthest from the root first."""
    degree = len(row.entries)
    return (row.round if degree > 1 else 0, degree, row.rank, row)


def _integrators(structure: JunctionStructure, junctions: Iterable[str]) -> int:
    """Count the storage elements on junctions whose immittance has s in the denominator."""
    nodes = structure.graph.nodes
    standing = ((structure.junctions[name].kind, name) for name in junctions)
    return sum(
        (kind, nodes[element].type) in {("1", "C"), ("0", "I")}
        for kind, name in standing
        for element in structure.junctions[name].elements
    )


def _shared(net: NodalNetwork, of_a: frozenset[str], of_b: frozenset[str]) -> tuple[str, ...]:
    """Return the user's junctions of the parts that systems A and B were both reduced from.

    Without the root a graph falls into parts; one that left terms in both systems is tied to it by a loop.
    """
    structure, members = net.structure, list[str]()
    while of_a and of_b:
        reached = set(reach(structure, min(of_b), without=net.root.name))
        if reached & of_a:
            members += [member for name in reached for member in structure.junctions[name].members]
        of_a, of_b = of_a - reached, of_b - reached
    return tuple(name for name in structure.graph.nodes if name in set(members))
