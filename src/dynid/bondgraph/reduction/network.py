"""The nodal form that a reduction works on: K x = b, with registers of a program as entries.

Row and column are junctions. Eliminating a junction is a physical step: a leaf is superposed and
reflected into its neighbour, a source on it is swapped (Park & Kim 1997, eqs 15, 16), a junction on a
loop becomes its multiport equivalent (the Schur complement of the nodal form).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

from dynid.bondgraph.graph import bond_sign
from dynid.bondgraph.reduction.junctions import Coupling, JunctionStructure
from dynid.bondgraph.reduction.program import Program, Register

#: What stands before the name of a storage whose energy at t = 0 is an input.
STORED = "initial:"


class Term(NamedTuple):
    """One immittance on a junction: an impedance on a 1, an admittance on a 0."""

    name: str  # the node or label it comes from
    register: Register


class Network:
    """The part of a junction structure that the root depends on.

    Parameters
    ----------
    structure
        The junction structure.
    program
        Where the arithmetic is written.
    root
        The junction of the port of interest.
    inputs
        Sources that are kept; all others are zero. `initial:NAME` is the equivalent source of the energy
        that a storage holds at t = 0, by its flow (I) or effort (C) then.
    """

    def __init__(
        self, structure: JunctionStructure, program: Program, root: str, inputs: Iterable[str]
    ) -> None:
        self.structure, self.program, self.root = structure, program, root
        self.inputs = tuple(inputs)
        self.depth = reach(structure, root)
        self.kind: dict[str, str] = {}
        self.terms: dict[str, list[Term]] = {}
        self.matrix: dict[str, dict[str, Register]] = {name: {} for name in self.depth}
        self.sources: defaultdict[str, dict[str, Register]] = defaultdict(dict)
        self._replaced: dict[frozenset[str], Coupling | None] = {}  # what ties a pair instead of the graph's
        for name in self.depth:
            junction = structure.junctions[name]
            self.kind[name] = junction.kind
            self.terms[name] = [
                Term(element, self.immittance(element, name)) for element in junction.elements
            ]
            for source, sign in junction.feeding:
                self._feed(name, source, program.one if sign > 0 else program.neg(program.one))
        for source in self.inputs:
            if source.startswith(STORED):
                self._feed_stored(source.removeprefix(STORED))
        for coupling in structure.couplings:
            self._couple(coupling)
        # the same right-hand side in terms of equivalent sources, as the steps name them
        self.drives = defaultdict(dict, {name: dict(row) for name, row in self.sources.items()})

    def add_term(self, junction: str, term: Term) -> None:
        """Put an immittance on a junction."""
        self.terms[junction].append(term)

    def immittance(self, name: str, junction: str) -> Register:
        """Write the impedance of an element on a 1-junction, its admittance on a 0-junction."""
        program, node = self.program, self.structure.graph.nodes[name]
        value = program.parameter(name)
        law = value if node.type == "R" else program.mul(program.s, value)
        own = "0" if node.type == "C" else "1"  # where the law itself is the immittance
        return law if self.kind[junction] == own else program.inv(law)

    def _feed(self, junction: str, source: str, amount: Register) -> None:
        if source in self.inputs:
            row = self.sources[junction]
            row[source] = self.program.add(row.get(source, self.program.zero), amount)

    def _feed_stored(self, name: str) -> None:
        junction = self.structure.place[name]
        if junction in self.depth:
            self._feed(junction, f"{STORED}{name}", self.stored(name, junction))

    def stored(self, name: str, junction: str) -> Register:
        """Write the equivalent source of a storage's energy at t = 0 (Park & Kim 1997, eqs 13 to 16).

        An element that answers with a rate has e = I (s f - f(0)): the momentum p(0) = I f(0) drives. One
        that integrates has f = e/(s I) + f(0)/s. Dually for a C.
        """
        program, node = self.program, self.structure.graph.nodes[name]
        if (self.kind[junction] == "1") is (node.type == "I"):
            return program.parameter(name)
        state = program.inv(program.s)
        return program.neg(state) if bond_sign(self.structure.graph, name) > 0 else state

    def _couple(self, coupling: Coupling) -> None:
        program = self.program
        size = program.one if coupling.two_port is None else program.parameter(coupling.two_port)
        if coupling.inverse:
            size = program.inv(size)
        tail, head = coupling.tail, coupling.head
        for row, column, entry in ((tail, head, size), (head, tail, program.neg(size))):
            if row not in self.depth:
                continue
            fixing = self.structure.junctions[column].fixing
            if fixing is not None and column != self.root:
                self._feed(row, fixing, program.neg(entry))  # a known unknown moves to the right-hand side
            else:
                self.add_entry(row, column, entry)

    def tie(self, a: str, b: str, coupling: Coupling | None) -> None:
        """Note the coupling that ties two junctions from now on, or none where it is more than a bond."""
        self._replaced[frozenset((a, b))] = coupling

    def single(self, a: str, b: str) -> Coupling | None:
        """Return the coupling between two junctions, where it is one bond or two-port."""
        if self._replaced and (pair := frozenset((a, b))) in self._replaced:
            return self._replaced[pair]
        found = [coupling for coupling in self.structure.tied[a] if b in (coupling.tail, coupling.head)]
        return found[0] if len(found) == 1 else None

    def add_entry(self, row: str, column: str, entry: Register) -> None:
        """Add to a matrix entry off the diagonal; one that is zero both ways is no tie between the two."""
        program, own, other = self.program, self.matrix[row], self.matrix[column]
        total = own[column] = program.add(own.get(column, program.zero), entry)
        back = other.setdefault(row, program.zero)  # a coupling is known from both sides
        if program.is_zero(total) and program.is_zero(back):
            del own[column], other[row]

    def entry(self, row: str, column: str) -> Register:
        """Return a matrix entry off the diagonal."""
        return self.matrix[row].get(column, self.program.zero)

    def diagonal(self, junction: str) -> Register:
        """Return the sum of the immittances on a junction."""
        total = self.program.zero
        for term in self.terms[junction]:
            total = self.program.add(total, term.register)
        return total

    def neighbours(self, junction: str) -> list[str]:
        """Return the junctions whose balance or unknown this one is tied to."""
        return list(self.matrix[junction])

    def remove(self, junction: str) -> None:
        """Take an eliminated junction out."""
        for other in self.matrix[junction]:
            del self.matrix[other][junction]
        del self.matrix[junction], self.terms[junction]
        self.sources.pop(junction, None)
        self.drives.pop(junction, None)


def reach(structure: JunctionStructure, root: str) -> dict[str, int]:
    """Return the junctions that influence the root, with their distance; fixed ones separate."""
    depth, queue = {root: 0}, [root]
    for name in queue:
        for coupling in structure.tied[name]:
            other = coupling.head if coupling.tail == name else coupling.tail
            if other not in depth and structure.junctions[other].fixing is None:
                depth[other] = depth[name] + 1
                queue.append(other)
    return depth
