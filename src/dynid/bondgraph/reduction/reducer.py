"""The reduction of a bond graph to one equation at the port of interest, as a program of steps.

Park & Kim 1997, section 4: source-load decomposition with series and parallel superposition (eqs 1, 2),
reflection through TF and GY, junction merging, and the swap between a flow source on a 0-junction and an
effort source on a 1-junction (eqs 15, 16). Leaves are eliminated first, farthest from the port first, so
that a tree collapses step by step; a junction on a loop is eliminated by its multiport equivalent, and a
bare junction by the constraint it states.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduction.elimination import COMMON, Elimination
from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.network import Network
from dynid.bondgraph.reduction.port import PortForm, channel, port_form
from dynid.bondgraph.reduction.program import Program, Register
from dynid.bondgraph.reduction.prototypes import DrivenBy, Prototype, split_root
from dynid.bondgraph.reduction.singularity import explain_singularity
from dynid.bondgraph.reduction.steps import Definition, Formula, Step


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
        Whether the steps are told; without them a large graph is planned in half the time.
    balanced
        Whether loops are opened everywhere at once rather than from the far end on (`Reducer`).

    Raises
    ------
    Singular
        Where the equations have no solution or more than one; it names the junctions and sources.
    """
    network = Network(structure, program, structure.place[port.node], inputs)
    return Reducer(network, traced=traced, balanced=balanced).run(port)


class Reducer:
    """Eliminates every junction but the root, and reads the prototype off what is left.

    Parameters
    ----------
    network
        The network to reduce; it shrinks.
    watch
        Called whenever the network is whole, if somebody wants to look at it on the way.
    traced
        Whether the steps are told.
    balanced
        Whether loops are opened in rounds, of junctions that do not touch each other (cyclic reduction):
        results then depend on one another over as many steps as the logarithm of the graph's length, where
        one end after the other takes as many as the length, and error bounds grow with each. It takes up to
        twice the steps.

    Attributes
    ----------
    work
        The elimination, with the steps taken so far.
    """

    def __init__(
        self,
        network: Network,
        watch: Callable[[], None] = lambda: None,
        *,
        traced: bool = True,
        balanced: bool = False,
    ) -> None:
        self._balanced = balanced
        self.net, self.program, self.root = network, network.program, network.root
        self.work = Elimination(network, watch, traced=traced)
        self._driving = frozenset(name for row in network.sources.values() for name in row)

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
        if self.work.traced:
            self.work.record(self._last_step(prototype, port, form))
        return Reduction(
            port=port,
            root=self.root,
            steps=tuple(self.work.steps) if self.work.traced else (),
            prototype=prototype,
            drives=dict(self.net.sources[self.root]),
            channels={
                source: channel(self.net, form, source, self._common(source, total))
                for source in self.net.inputs
            },
            pivots=tuple(self.work.pivots),
            structure=self.net.structure,
            junctions=tuple(self.net.depth),
            driving=self._driving,
            labels=self.work.labels,
        )

    def _common(self, source: str, total: Register) -> Register:
        """Write the transfer function from a source to the root's common variable (eqs 1 to 4)."""
        program, fixing = self.program, self.net.structure.junctions[self.root].fixing
        if self.work.held is not None:
            return self.work.held.get(source, program.zero)
        if fixing is not None:
            return program.one if source == fixing else program.zero
        return program.div(self.net.sources[self.root].get(source, program.zero), total)

    def _last_step(self, prototype: Prototype, port: Port, form: PortForm) -> Step:
        """Name the prototype, its systems, what drives them, and the output in these terms."""
        letter = COMMON[prototype.kind]
        common, source = f"{letter}_{self.root}", {"e": "f_eq", "f": "e_eq"}[letter]
        drives = tuple((amount, by) for by, amount in self.net.drives[self.root].items())
        definitions: list[Definition] = [(name, ((register, ""),)) for name, register in prototype.systems]
        if not prototype.fixed or not self.program.is_zero(form.drive):
            definitions.append((source, drives))
        definitions.append((common, self._common_in_words(prototype, source)))
        if (port.node, port.quantity) != (self.root, letter):
            output = ((form.common, common), (form.drive, source), (form.own, form.by))
            parts = tuple((register, by) for register, by in output if not self.program.is_zero(register))
            definitions.append((f"{port.quantity}_{port.node}", parts))
        names = self.work.names(self.root)
        return Step("prototype", names, tuple(definitions), prototype.describe(self.root))

    def _common_in_words(
        self, prototype: Prototype, source: str
    ) -> tuple[tuple[Register, str], ...] | Formula:
        """Return what the root's common variable equals: what fixes it, or the prototype's relation."""
        fixing = self.net.structure.junctions[self.root].fixing
        if self.work.held is not None:
            return self.work.held_by
        if fixing is not None:
            return ((self.program.one, fixing),) if fixing in self.net.inputs else ()
        return DrivenBy(prototype, source)

    def _prototype(self, port: Port) -> Prototype:
        element, rest = split_root(self.net, port, self._root_known())
        label = ("Z_A" if self.net.kind[self.root] == "1" else "Y_A") if len(rest) > 1 else None
        return Prototype(
            program=self.program,
            kind=self.net.kind[self.root],
            fixed=self._root_known(),
            part_a=self.work.superpose(self.root, rest, label),
            part_b=element.register,
            name_a=", ".join(term.name for term in rest) or "nothing",
            name_b=element.name,
        )

    def _root_known(self) -> bool:
        """Tell whether a source, or a bare junction beside it, fixes the root's unknown."""
        return self.work.held is not None or self.net.structure.junctions[self.root].fixing is not None

    def _eliminate_all(self) -> None:
        """Eliminate by (round, number of neighbours, distance from the root): leaves first, fill low."""
        matrix, depth = self.net.matrix, self.net.depth
        names = sorted(depth, key=depth.__getitem__, reverse=True)[:-1]  # the root is nearest to itself
        rank, size = {name: index for index, name in enumerate(names)}, len(names)
        rounds = dict.fromkeys(depth, 0)  # how many steps on loops follow one another up to a junction

        def turn(name: str) -> int:
            degree = len(matrix[name])
            return ((rounds[name] if degree > 1 else 0) * (size + 1) + degree) * size + rank[name]

        heap = [turn(name) for name in names]
        heapq.heapify(heap)
        while heap:
            place = heapq.heappop(heap)
            name = names[place % size]
            if name not in matrix or place != turn(name):
                continue  # eliminated already, or queued again with its new neighbours
            around = self._eliminate_next(name)
            following = rounds[name] + 1 if self._balanced and len(around) > 1 else 0
            for other in around:
                rounds[other] = max(rounds[other], following)
                if other != self.root:
                    heapq.heappush(heap, turn(other))
        self._eliminate_bare([name for name in depth if name in matrix and name != self.root])

    def _eliminate_next(self, name: str) -> list[str]:
        """Eliminate a junction if something stands on it, or if it is bare and a dead end."""
        own = self.net.diagonal(name)
        if not self.program.is_zero(own):
            return self.work.eliminate(name, own)
        neighbours = self.net.neighbours(name)
        if len(neighbours) == 1 and neighbours[0] != self.root and self.work.paired(name, neighbours[0]):
            return self.work.eliminate_pair(neighbours[0], name)
        return []  # nothing stands on it yet; it is queued again when a neighbour is eliminated

    def _eliminate_bare(self, names: list[str]) -> None:
        """Eliminate junctions on which nothing stands, each with a neighbour that its balance fixes."""
        for name in names:
            if name not in self.net.matrix:
                continue
            own = self.net.diagonal(name)
            if not self.program.is_zero(own):
                self.work.eliminate(name, own)
                continue
            partners = [other for other in self.net.neighbours(name) if self.work.paired(name, other)]
            others = [other for other in partners if other != self.root]
            if others:
                self.work.eliminate_pair(others[0], name)
            elif partners and not self._root_known():
                self.work.hold_root(name)
            else:
                raise self._singular()

    def _singular(self) -> Exception:
        net = self.net
        return explain_singularity(Network(net.structure, self.program, self.root, net.inputs))
