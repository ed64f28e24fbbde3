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

from dynid.bondgraph.graph import Port
from dynid.bondgraph.junctions import JunctionStructure
from dynid.bondgraph.network import Network, Term
from dynid.bondgraph.program import Program, Register
from dynid.bondgraph.prototypes import Prototype, split_root
from dynid.bondgraph.singularity import explain_singularity


@dataclass(frozen=True)
class Step:
    """One step of a reduction.

    Parameters
    ----------
    rule
        series, parallel, reflection, source swap, merge, junction elimination, constraint or prototype.
    nodes
        The nodes it consumed.
    definitions
        What it defines: a name, and the registers that sum up to it, each with the source that it
        multiplies (empty where it is an immittance).
    meaning
        What happens, physically, in one sentence.
    relation
        The equation of a step that defines nothing.
    """

    rule: str
    nodes: tuple[str, ...]
    definitions: tuple[tuple[str, tuple[tuple[Register, str], ...]], ...]
    meaning: str
    relation: str = ""


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
    channels
        The transfer function from each input to the port; inputs that cannot reach it have zero.
    pivots
        Registers whose product is the determinant of the nodal form, up to sign.
    modelled
        The nodes that the result depends on.
    dropped
        The other nodes: behind an ideal source, or not connected.
    junctions
        The junctions of the structure that were reduced.
    """

    port: Port
    root: str
    steps: tuple[Step, ...]
    prototype: Prototype
    channels: dict[str, Register]
    pivots: tuple[Register, ...]
    modelled: tuple[str, ...]
    dropped: tuple[str, ...]
    junctions: tuple[str, ...]


def reduce_graph(structure: JunctionStructure, program: Program, port: Port, inputs: Iterable[str]) -> Reduction:
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

    Raises
    ------
    Singular
        Where the equations have no solution or more than one; it names the junctions and sources.
    """
    return _Reducer(Network(structure, program, structure.place[port.node], inputs)).run(port)


class _Reducer:
    """Eliminates every junction but the root, and writes down what it does."""

    def __init__(self, network: Network) -> None:
        self.net, self.program, self.root = network, network.program, network.root
        self.steps: list[Step] = []
        self.pivots: list[Register] = []
        self.held: dict[str, Register] | None = None  # the root's unknown, where a bare neighbour fixes it
        self.original = {row: dict(entries) for row, entries in network.matrix.items()}
        self.original_diagonal = {name: network.diagonal(name) for name in network.matrix}
        self.original_sources = {name: dict(row) for name, row in network.sources.items()}

    def run(self, port: Port) -> Reduction:
        self._eliminate_all()
        element, rest = split_root(self.net, port, self._root_known())
        rest_name = ("Z_A" if self.net.kind[self.root] == "1" else "Y_A") if len(rest) > 1 else None
        rest_register = self._superpose(self.root, rest, rest_name)
        prototype = Prototype(
            program=self.program,
            kind=self.net.kind[self.root],
            fixed=self._root_known(),
            part_a=rest_register,
            part_b=element.register,
            name_a=", ".join(term.name for term in rest) or "nothing",
            name_b=element.name,
        )
        total = self.program.add(rest_register, element.register)
        if not prototype.fixed:
            if self.program.is_zero(total):
                raise self._singular()
            self.pivots.append(total)
        self.steps.append(
            Step("prototype", self._names(self.root), prototype.definitions, prototype.describe(self.root))
        )
        channels = {source: self._channel(port, source, total) for source in self.net.inputs}
        modelled = self._modelled()
        dropped = tuple(name for name in self.net.structure.graph.nodes if name not in modelled)
        return Reduction(
            port,
            self.root,
            tuple(self.steps),
            prototype,
            channels,
            tuple(self.pivots),
            modelled,
            dropped,
            tuple(self.original),
        )

    def _root_known(self) -> bool:
        """Tell whether a source, or a bare junction beside it, fixes the root's unknown."""
        return self.held is not None or self.net.structure.junctions[self.root].fixing is not None

    def _modelled(self) -> tuple[str, ...]:
        structure = self.net.structure
        reached = set(self.net.depth)
        behind = {name for row in self.original_sources.values() for name in row}
        inside = {name for name, place in structure.place.items() if place in reached} | behind
        for coupling in structure.couplings:
            if coupling.two_port and reached & {coupling.tail, coupling.head}:
                inside.add(coupling.two_port)
        return tuple(name for name in structure.graph.nodes if name in inside)

    # --- elimination ---------------------------------------------------------------------------

    def _eliminate_all(self) -> None:
        """Eliminate by (number of neighbours, distance from the root): leaves first, fill low."""
        order = {name: index for index, name in enumerate(self.net.depth)}

        def priority(name: str) -> tuple[int, int, int, str]:
            return len(self.net.neighbours(name)), -self.net.depth[name], order[name], name

        heap = [priority(name) for name in order if name != self.root]
        heapq.heapify(heap)
        while heap:
            entry = heapq.heappop(heap)
            name = entry[-1]
            if name not in self.net.matrix or entry != priority(name):
                continue  # eliminated already, or queued again with its new neighbours
            if self.program.is_zero(self.net.diagonal(name)):
                continue  # nothing stands on it yet; it is queued again when a neighbour is eliminated
            touched = self.net.neighbours(name)
            self._eliminate(name, touched)
            for other in touched:
                if other != self.root:
                    heapq.heappush(heap, priority(other))
        self._eliminate_bare([name for name in order if name in self.net.matrix and name != self.root])

    def _eliminate(self, name: str, neighbours: list[str]) -> None:
        own = self._superpose(name, self.net.terms[name], None)
        self.pivots.append(own)
        if len(neighbours) == 1:
            self._absorb_leaf(name, neighbours[0], own)
        elif neighbours:
            self._eliminate_on_loop(name, neighbours, own)
        self.net.remove(name)

    def _superpose(self, junction: str, terms: list[Term], name: str | None) -> Register:
        """Series on a 1-junction, parallel on a 0-junction (eqs 1, 2)."""
        total = self.program.sum(term.register for term in terms)
        if len(terms) < 2:
            return total
        series = self.net.kind[junction] == "1"
        letter = "Z" if series else "Y"
        label = name or f"{letter}_{junction}"
        parts = tuple((term.register, "") for term in terms)
        what, common, law = ("impedances", "flow", "series, eq 1") if series else ("admittances", "effort", "parallel, eq 2")
        meaning = (
            f"{_listed([term.name for term in terms])} share the {common} of {self.net.kind[junction]}-junction "
            f"{junction}: their {what} add ({law})"
        )
        nodes = tuple(dict.fromkeys([*self._names(junction), *(term.name for term in terms)]))
        self.steps.append(Step("series" if series else "parallel", nodes, ((label, parts),), meaning))
        self.program.label(total, label)
        return total

    def _absorb_leaf(self, leaf: str, into: str, own: Register) -> None:
        program, net = self.program, self.net
        coupling = net.single.get(frozenset((leaf, into)))
        forward, back = net.entry(into, leaf), net.entry(leaf, into)
        if coupling is None or not program.is_zero(program.add(forward, back)):
            self._eliminate_on_loop(leaf, [into], own)
            return
        if coupling.two_port is None:
            seen, origin = program.inv(own), self._origin(leaf)
        else:
            seen, origin = self._reflect(leaf, into, own, coupling.two_port, inverse=coupling.inverse)
        net.terms[into].append(Term(origin, seen))
        if net.sources[leaf]:
            self._swap(leaf, into, own, forward)

    def _origin(self, junction: str) -> str:
        """Name what stands on a junction: its only element, or itself."""
        terms = self.net.terms[junction]
        return terms[0].name if len(terms) == 1 else junction

    def _reflect(self, leaf: str, into: str, own: Register, two_port: str, *, inverse: bool) -> tuple[Register, str]:
        """Write the immittance seen through a TF or GY: Z1 = n^2 Z2, Z1 = r^2 / Z2."""
        program = self.program
        modulus = program.parameter(two_port)
        square = program.mul(modulus, modulus)
        if inverse:
            seen = program.inv(program.mul(square, own))
        else:
            seen = program.mul(square, program.inv(own))
        impedance = seen if self.net.kind[into] == "1" else program.inv(seen)
        label = f"Z_{two_port}"
        transformer = self.net.structure.graph.nodes[two_port].type == "TF"
        law = "Z1 = n^2 Z2" if transformer else "Z1 = r^2/Z2"
        meaning = (
            f"seen from {into} through {'transformer' if transformer else 'gyrator'} {two_port}, "
            f"{self._origin(leaf)} is the impedance {label} ({law})"
        )
        nodes = (*self._names(leaf), two_port)
        self.steps.append(Step("reflection", nodes, ((label, ((impedance, ""),)),), meaning))
        program.label(impedance, label)
        return seen, two_port

    def _swap(self, leaf: str, into: str, own: Register, forward: Register) -> None:
        """Replace the Norton form on a leaf by the Thévenin form on its neighbour, or the other way round."""
        net, program = self.net, self.program
        to_effort = net.kind[into] == "1"
        letter = "e" if to_effort else "f"
        scale = program.neg(forward)
        parts = []
        for source, amount in net.sources[leaf].items():
            register = program.mul(scale, program.mul(program.inv(own), amount))
            parts.append((register, source))
            self._add_source(into, source, register)
        label = f"{letter}_{leaf}"
        have, want = ("flow", "effort") if to_effort else ("effort", "flow")
        old, new = ("Norton, eq 15", "Thévenin, eq 16") if to_effort else ("Thévenin, eq 16", "Norton, eq 15")
        meaning = (
            f"the {have} source {_listed([source for _, source in parts])} with {self._origin(leaf)} on {net.kind[leaf]}-junction "
            f"{leaf} ({old}) is, for {into}, the {want} source {label} ({new}); "
            f"the {net.kind[leaf]}-junction becomes a {net.kind[into]}-junction"
        )
        nodes = (*(source for _, source in parts), *self._names(leaf))
        self.steps.append(Step("source swap", nodes, ((label, tuple(parts)),), meaning))
        if net.structure.junctions[leaf].members and net.structure.junctions[into].members:
            meaning = f"{leaf} and {into} are {net.kind[into]}-junctions now, joined by a bond: they merge"
            common = "f" if to_effort else "e"
            nodes = (*self._names(leaf), *self._names(into))
            self.steps.append(Step("merge", nodes, (), meaning, f"{common}_{leaf} = {common}_{into}"))

    def _add_source(self, junction: str, source: str, amount: Register) -> None:
        row = self.net.sources[junction]
        row[source] = self.program.add(row.get(source, self.program.zero), amount)

    def _eliminate_on_loop(self, name: str, neighbours: list[str], own: Register) -> None:
        """Eliminate a junction by its multiport equivalent: the Schur complement of the nodal form."""
        net, program = self.net, self.program
        inverse = program.inv(own)
        for row in neighbours:
            factor = program.mul(net.entry(row, name), inverse)
            for column in neighbours:
                self._add(row, column, program.neg(program.mul(factor, net.entry(name, column))), name)
            for source, amount in net.sources[name].items():
                self._add_source(row, source, program.neg(program.mul(factor, amount)))
        for row in neighbours:
            for column in neighbours:
                net.single[frozenset((row, column))] = None
        meaning = (
            f"{name} lies between {_listed(neighbours)}: what it passes on to them is their multiport "
            f"equivalent (Schur complement of the nodal form, as star to mesh)"
        )
        definitions = tuple(
            (f"k({row}, {column})", ((program.neg(program.mul(program.mul(net.entry(row, name), inverse), net.entry(name, column))), ""),))
            for row in neighbours
            for column in neighbours
        )
        self.steps.append(Step("junction elimination", self._names(name), definitions, meaning))

    def _add(self, row: str, column: str, change: Register, origin: str) -> None:
        if self.program.is_zero(change):
            return
        if row == column:
            self.net.terms[row].append(Term(origin, change))
        else:
            self.net.add_entry(row, column, change)

    # --- bare junctions ------------------------------------------------------------------------

    def _eliminate_bare(self, names: list[str]) -> None:
        """Eliminate junctions on which nothing stands, each with a neighbour that its balance fixes."""
        for name in names:
            if name not in self.net.matrix:
                continue
            if not self.program.is_zero(self.net.diagonal(name)):
                self._eliminate(name, self.net.neighbours(name))
                continue
            partners = [other for other in self.net.neighbours(name) if self._paired(name, other)]
            others = [other for other in partners if other != self.root]
            if others:
                self._eliminate_pair(others[0], name)
            elif partners and not self._root_known():
                self._hold_root(name)
            else:
                raise self._singular()

    def _paired(self, a: str, b: str) -> bool:
        zero = self.program.is_zero
        return not zero(self.net.entry(a, b)) and not zero(self.net.entry(b, a))

    def _hold_root(self, name: str) -> None:
        """Let a bare junction at the root state the root's unknown."""
        program, net = self.program, self.net
        entry = net.matrix[name][self.root]
        self.held = {source: program.div(amount, entry) for source, amount in net.sources[name].items()}
        self.pivots.append(program.mul(entry, net.matrix[self.root][name]))
        self._state_constraint(name, self.root, self.held)
        net.remove(name)

    def _state_constraint(self, name: str, fixed: str, value: dict[str, Register]) -> None:
        what = "effort" if self.net.kind[fixed] == "0" else "flow"
        meaning = f"no element stands on {name}, so its balance alone fixes the {what} of {fixed}"
        label = f"{what[0]}_{fixed}"
        parts = tuple((register, source) for source, register in value.items()) or ((self.program.zero, ""),)
        nodes = (*self._names(name), *self._names(fixed))
        self.steps.append(Step("constraint", nodes, ((label, parts),), meaning))

    def _eliminate_pair(self, partner: str, bare: str) -> None:
        """Eliminate a bare junction together with a neighbour: a 2 x 2 pivot [[d, a], [b, 0]]."""
        net, program = self.net, self.program
        a, b = net.matrix[partner][bare], net.matrix[bare][partner]
        d = net.diagonal(partner)
        self.pivots.append(program.mul(a, b))
        rows = dict.fromkeys([*net.neighbours(partner), *net.neighbours(bare)])
        rows = [row for row in rows if row not in (partner, bare)]

        def solve(of_partner: Register, of_bare: Register) -> tuple[Register, Register]:
            x = program.div(of_bare, b)
            return x, program.div(program.sub(of_partner, program.mul(d, x)), a)

        columns = {column: solve(net.entry(partner, column), net.entry(bare, column)) for column in rows}
        names = dict.fromkeys([*net.sources[partner], *net.sources[bare]])
        sides = {
            source: solve(net.sources[partner].get(source, program.zero), net.sources[bare].get(source, program.zero))
            for source in names
        }
        for row in rows:
            left = (net.entry(row, partner), net.entry(row, bare))
            for column, solved in columns.items():
                self._add(row, column, program.neg(_dot(program, left, solved)), partner)
                net.single[frozenset((row, column))] = None
            for source, solved in sides.items():
                self._add_source(row, source, program.neg(_dot(program, left, solved)))
        self._state_constraint(bare, partner, {source: solved[0] for source, solved in sides.items()})
        net.remove(bare)
        net.remove(partner)

    # --- the end -------------------------------------------------------------------------------

    def _channel(self, port: Port, source: str, total: Register) -> Register:
        """Write the transfer function from a source to the port, by the prototype's equation."""
        program, net = self.program, self.net
        junction = net.structure.junctions[self.root]
        node = net.structure.graph.nodes[port.node]
        drive = net.sources[self.root].get(source, program.zero)
        if self.held is not None:
            common = self.held.get(source, program.zero)
        elif junction.fixing is not None:
            common = program.one if source == junction.fixing else program.zero
        else:
            common = program.div(drive, total)
        of_common = port.quantity in (("f", "q") if junction.kind == "1" else ("e", "p"))
        own = program.one if source == port.node else program.zero
        bond = net.structure.graph.bonds_of(port.node)[0]
        outward = bond.head == port.node  # the arrow points at the node
        if node.type in ("Se", "Sf"):
            sets = "e" if node.type == "Se" else "f"
            if port.quantity in ((sets, "p") if sets == "e" else (sets, "q")):
                value = own
            elif port.node == junction.fixing:
                reaction = program.sub(program.mul(total, common), drive)
                value = program.neg(reaction) if outward else reaction
            else:
                value = common
        elif of_common:
            value = common
        else:
            value = program.mul(net.immittance(port.node, self.root), common)
            value = value if outward else program.neg(value)
        return program.div(value, program.s) if port.quantity in "qp" else value

    def _names(self, junction: str) -> tuple[str, ...]:
        members = self.net.structure.junctions[junction].members
        return tuple(members) if members else (junction,)

    def _singular(self) -> Exception:
        return explain_singularity(
            self.net.structure, self.program, self.original, self.original_diagonal, self.original_sources
        )


def _dot(program: Program, left: tuple[Register, Register], right: tuple[Register, Register]) -> Register:
    return program.add(program.mul(left[0], right[0]), program.mul(left[1], right[1]))


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
