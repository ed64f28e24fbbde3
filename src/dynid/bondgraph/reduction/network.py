"""The nodal form that a reduction works on, K x = b, with registers of a program as entries.

Every junction has a balance: one row of K and b. Eliminating one is a physical step: a leaf is superposed and
reflected into its neighbour, a source on it is swapped (Park & Kim 1997, eqs 15, 16), a junction on a loop
becomes its multiport equivalent (the Schur complement of the nodal form). Reduced to its root, the nodal form
gives the output that was requested (`port_form`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from dynid.bondgraph.graph import JUNCTIONS, SOURCES, Port, bond_sign
from dynid.bondgraph.program.program import Program, Register
from dynid.bondgraph.reduction.junctions import Coupling, Junction, JunctionStructure

# --- nodal form -----------------------------------------------------------------------------------

#: What stands before the name of a storage whose energy at t = 0 is an input.
STORED = "initial:"


class Immittance(NamedTuple):
    """One immittance on a junction: an impedance on a 1, an admittance on a 0."""

    name: str  # the node or label it comes from
    register: Register


class Tie(NamedTuple):
    """The only connection of two junctions: a bond, or the TF or GY of that name (`Coupling`)."""

    two_port: str | None
    inverse: bool


#: A bond.
BOND = Tie(None, False)


class NodeRow:
    """The balance of a junction, as far as it is reduced.

    `terms`: the immittances on it, which add up to its entry on the diagonal. `entries`: its entries off the
    diagonal, by the row of the other junction; that one has an entry for this one. `sources`: what each input
    feeds into it: its right-hand side.
    """

    __slots__ = ("depth", "entries", "fixing", "gone", "kind", "name", "rank", "round", "sources", "terms")

    def __init__(self, junction: Junction, depth: int) -> None:
        self.name, self.kind, self.fixing = junction.name, junction.kind, junction.fixing
        self.depth = depth
        self.terms: list[Immittance] = []
        self.entries: dict[NodeRow, Register] = {}
        self.sources: dict[str, Register] = {}
        self.rank = self.round = 0
        self.gone = False

    @property
    def origin(self) -> str:
        """The name of the immittance on the junction: its only element, or the junction itself."""
        return self.terms[0].name if len(self.terms) == 1 else self.name


class NodalNetwork:
    """The nodal form of some junctions: one row for each, of which the first is the root.

    Parameters
    ----------
    depths
        By junction its distance from the root, as `reach` gives it; none is fixed but the root.
    inputs
        Sources that are kept; all others are zero. `initial:NAME` is the equivalent source of the energy
        that a storage holds at t = 0, by its flow (I) or effort (C) then.

    Attributes
    ----------
    rows
        The balances, by the names of their junctions, the nearest to the root first.
    root
        That of the port of interest, the first.
    junctions, elements
        The names of all junctions, and of the one-ports on the root.
    """

    def __init__(
        self, structure: JunctionStructure, program: Program, depths: Mapping[str, int], inputs: Iterable[str]
    ) -> None:
        self.structure, self.program, self.graph = structure, program, structure.graph
        self.inputs = tuple(inputs)
        self._kept = frozenset(self.inputs)
        junctions = structure.junctions
        self.rows = {name: NodeRow(junctions[name], depth) for name, depth in depths.items()}
        self.root, self.junctions = next(iter(self.rows.values())), tuple(self.rows)
        self.elements = junctions[self.root.name].elements
        self._ties: dict[frozenset[NodeRow], Tie | None] = {}  # of pairs that are tied by other than one bond
        for name, row in self.rows.items():
            junction = junctions[name]
            row.terms = [Immittance(element, self.immittance(element, row)) for element in junction.elements]
            for source, sign in junction.feeding:
                self._feed(row, source, program.one if sign > 0 else self._minus_one)
        for source in self.inputs:
            storage = source.removeprefix(STORED)
            if storage != source and (at := self.rows.get(structure.place[storage])) is not None:
                self.feed(at, source, self.stored(storage, at))
        for coupling in structure.couplings:
            self._couple(coupling)

    @property
    def left(self) -> list[NodeRow]:
        """The rows that are not eliminated."""
        return [row for row in self.rows.values() if not row.gone]

    def modelled(self, driving: frozenset[str]) -> tuple[str, ...]:
        """Return the nodes on the junctions, and what drives them from outside: `driving`."""
        structure, reached = self.structure, set(self.junctions)
        inside = {name for name, junction in structure.place.items() if junction in reached} | driving
        for junction in structure.junctions.values():
            if junction.fixing in driving:  # the port depends on it through its known variable only
                inside.update(junction.members)
        for coupling in structure.couplings:
            if coupling.two_port is not None and reached & {coupling.tail, coupling.head}:
                inside.add(coupling.two_port)
        return tuple(name for name in structure.graph.nodes if name in inside)

    def immittance(self, name: str, row: NodeRow) -> Register:
        """Write the impedance of an element on a 1-junction, its admittance on a 0-junction."""
        program, node = self.program, self.graph.nodes[name]
        value = program.parameter(name)
        law = value if node.type == "R" else program.mul(program.s, value)
        direct_kind = "0" if node.type == "C" else "1"  # where the law itself is the immittance
        return law if row.kind == direct_kind else program.inv(law)

    def feed(self, row: NodeRow, source: str, amount: Register) -> None:
        """Add the contribution of an input to a balance; contributions that cancel disappear."""
        total = self.program.add(row.sources.get(source, self.program.zero), amount)
        if self.program.is_zero(total):
            row.sources.pop(source, None)
        else:
            row.sources[source] = total

    def _feed(self, row: NodeRow, source: str | None, amount: Register) -> None:
        if source in self._kept:
            self.feed(row, source, amount)

    def stored(self, name: str, row: NodeRow) -> Register:
        """Write the equivalent source of a storage's energy at t = 0 (Park & Kim 1997, eqs 13 to 16).

        An element that answers with a rate has e = I (s f - f(0)): the momentum p(0) = I f(0) drives. One
        that integrates has f = e/(s I) + f(0)/s. Dually for a C.
        """
        program, node = self.program, self.graph.nodes[name]
        if (row.kind == "1") is (node.type == "I"):
            return program.parameter(name)
        state = program.inv(program.s)
        return program.neg(state) if bond_sign(self.graph, name) > 0 else state

    def _couple(self, coupling: Coupling) -> None:
        """Write both entries of a coupling; a known unknown moves to the right-hand side."""
        program, junctions = self.program, self.structure.junctions
        tail, head, two_port, inverse, one_way = coupling
        tail_row, head_row = self.rows.get(tail), self.rows.get(head)
        if tail_row is None and head_row is None:
            return
        size, minus = program.one, self._minus_one
        if two_port is not None:
            size = program.inv(program.parameter(two_port)) if inverse else program.parameter(two_port)
            minus = program.neg(size)
        if head_row is None and tail_row is not None:
            if not one_way:
                self._feed(tail_row, junctions[head].fixing, minus)
        elif tail_row is None and head_row is not None:
            self._feed(head_row, junctions[tail].fixing, size)
        elif tail_row is not None and head_row is not None:
            if one_way:
                self.add_entry(head_row, tail_row, minus)
                return
            if head_row in tail_row.entries or self.tie(tail_row, head_row) != BOND:  # one more
                self.add_entry(tail_row, head_row, size)
                self.add_entry(head_row, tail_row, minus)
                return
            tail_row.entries[head_row], head_row.entries[tail_row] = size, minus
            if two_port is not None:
                self.retie(tail_row, head_row, Tie(two_port, inverse))

    @cached_property
    def _minus_one(self) -> Register:
        return self.program.neg(self.program.one)

    def retie(self, a: NodeRow, b: NodeRow, tie: Tie) -> None:
        """Note the only tie of two junctions."""
        self._ties[frozenset((a, b))] = tie

    def tie(self, a: NodeRow, b: NodeRow) -> Tie | None:
        """Return what ties two junctions, where it is one bond or two-port."""
        return self._ties.get(frozenset((a, b)), BOND) if self._ties else BOND

    def add_entry(self, row: NodeRow, column: NodeRow, entry: Register) -> None:
        """Add to a matrix entry off the diagonal; more than a bond or two-port ties the two from now on.

        One that is zero both ways ties them no more.
        """
        self._ties[frozenset((row, column))] = None
        program, entries, mirrored = self.program, row.entries, column.entries
        total = entries[column] = program.add(entries.get(column, program.zero), entry)
        back = mirrored.setdefault(row, program.zero)  # a coupling is known from both sides
        if program.is_zero(total) and program.is_zero(back):
            del entries[column], mirrored[row]

    def entry(self, row: NodeRow, column: NodeRow) -> Register:
        """Return a matrix entry off the diagonal."""
        return row.entries.get(column, self.program.zero)

    def diagonal(self, row: NodeRow) -> Register:
        """Return the sum of the immittances on a junction."""
        return self.program.sum([term.register for term in row.terms])

    def remove(self, row: NodeRow) -> None:
        """Remove an eliminated junction."""
        for neighbour in row.entries:
            del neighbour.entries[row]
        row.gone = True
        del row.entries, row.terms, row.sources


def reach(structure: JunctionStructure, root: str, without: str | None = None) -> dict[str, int]:
    """Return the junctions that influence the root, with their distance; fixed ones separate.

    `without`: a junction through which nothing is looked for.
    """
    depth, queue = {root: 0}, [root]
    for name in queue:
        for tail, head, *_ in structure.tied[name]:
            neighbour = head if tail == name else tail
            if (
                neighbour not in depth
                and neighbour != without
                and structure.junctions[neighbour].fixing is None
            ):
                depth[neighbour] = depth[name] + 1
                queue.append(neighbour)
    return depth


# --- output ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PortForm:
    """An output as a linear form: of the root's common variable, of what drives the root, and of itself."""

    #: common, drive, direct: Coefficients.
    common: Register
    drive: Register
    direct: Register
    by: str  # the input that `direct` multiplies: the output's node, or the energy that it stores at t = 0

    def scaled(self, program: Program, factor: Register) -> PortForm:
        """Return the form times a factor."""
        common, drive, direct = (
            program.mul(factor, coefficient) for coefficient in (self.common, self.drive, self.direct)
        )
        return PortForm(common, drive, direct, self.by)


def port_form(net: NodalNetwork, port: Port, total: Register) -> PortForm:
    """Write an output in terms of the root's common variable.

    The displacement of a C and the momentum of an I are its state, q = C e and p = I f; any other
    displacement or momentum is the integral of flow or effort.

    `total`: what stands on the root: Z_A + Z_B on a 1-junction, Y_A + Y_B on a 0-junction.
    """
    program, graph = net.program, net.graph
    form = _effort_or_flow(net, port.node, graph.behind(port).quantity, total)
    if graph.is_state(port):
        value = program.parameter(port.node)
        return form.scaled(program, value if bond_sign(graph, port.node) > 0 else program.neg(value))
    return form.scaled(program, program.inv(program.s)) if port.quantity in "qp" else form


def _effort_or_flow(net: NodalNetwork, name: str, quantity: str, total: Register) -> PortForm:
    """Write an effort or flow: common to the junction, set by a source, or the answer of what is asked."""
    program, kind = net.program, net.graph.nodes[name].type
    zero, unity = program.zero, program.one
    if kind in SOURCES and quantity == ("e" if kind == "Se" else "f"):
        return PortForm(zero, zero, unity, name)
    if kind in JUNCTIONS or quantity == ("f" if net.root.kind == "1" else "e"):
        return PortForm(unity, zero, zero, name)
    if kind in SOURCES:  # it fixes the common variable; its reaction balances the junction
        form = PortForm(program.neg(total), unity, zero, name)
    else:
        source = f"{STORED}{name}"
        direct = program.neg(net.stored(name, net.root)) if source in net.inputs else zero
        form = PortForm(net.immittance(name, net.root), zero, direct, source)
    outward = bond_sign(net.graph, name) > 0
    return form if outward else form.scaled(program, program.neg(unity))


def channel(net: NodalNetwork, form: PortForm, source: str, common: Register) -> Register:
    """Write the transfer function from a source to an output.

    `form`: the output in terms of the root's common variable. `common`: the transfer function from the source
    to the common variable.
    """
    program = net.program
    drive = net.root.sources.get(source, program.zero)
    value = program.add(program.mul(form.common, common), program.mul(form.drive, drive))
    return program.add(value, form.direct) if source == form.by else value
