"""Eliminating one junction after another: every elimination is a physical step.

A leaf is superposed (series, parallel), reflected through a TF or GY into its neighbour, and a source on it
is swapped (Park & Kim 1997, eqs 1, 2, 15, 16); a junction on a loop becomes its multiport equivalent; a bare
junction states a constraint.
"""

from __future__ import annotations

from dynid.bondgraph.reduction.network import BOND, Network, Row, Term, Tie
from dynid.bondgraph.reduction.program import Program, Register
from dynid.bondgraph.reduction.telling import Untold


class Elimination:
    """A network under elimination, with the pivots met so far.

    Parameters
    ----------
    network
        The network; it shrinks.
    story
        Where the steps are told.

    Attributes
    ----------
    pivots
        The registers divided by.
    held
        The root's unknown by inputs, where a bare neighbour fixes it.
    """

    def __init__(self, network: Network, story: Untold) -> None:
        self.net, self.program, self.root = network, network.program, network.root
        self.story = story
        self.pivots: list[Register] = []
        self.held: dict[str, Register] | None = None

    def eliminate(self, row: Row, own: Register) -> list[Row]:
        """Eliminate a junction on which something stands, in all `own`; return its former neighbours."""
        neighbours = list(row.entries)
        self.story.superposed(row, row.terms, own)
        self.pivots.append(own)
        if len(neighbours) == 1:
            self._absorb_leaf(row, neighbours[0], own)
        elif neighbours:
            self._eliminate_on_loop(row, neighbours, own)
        else:
            self._remove(row)
        return neighbours

    def _remove(self, row: Row) -> None:
        """Take out an eliminated junction, after which the network is whole."""
        self.net.remove(row)
        self.story.done()

    def _absorb_leaf(self, leaf: Row, into: Row, own: Register) -> None:
        """Let a leaf's neighbour see its immittance and its sources, through what ties them."""
        tie = self.net.tie(leaf, into)
        if tie is None:
            self._eliminate_on_loop(leaf, [into], own)
        elif tie.two_port is not None:
            self._reflect(leaf, into, own, tie)
        elif leaf.sources:
            self._swap(leaf, into, Term(leaf.origin, self.program.inv(own)))
        else:
            into.terms.append(Term(leaf.origin, self.program.inv(own)))
            self._remove(leaf)

    def _reflect(self, leaf: Row, into: Row, own: Register, tie: Tie) -> None:
        """Let a leaf be seen through a TF or GY: Z1 = n^2 Z2, Z1 = r^2 / Z2; then swap its sources."""
        program = self.program
        modulus = program.parameter(str(tie.two_port))
        square = program.mul(modulus, modulus)
        own = program.inv(program.mul(square, own)) if tie.inverse else program.mul(square, program.inv(own))
        seen = Term(str(tie.two_port), own)
        self.story.reflected(leaf, into, seen)
        if leaf.sources:
            self._move_across(leaf, into, seen)
            self._swap(leaf, into, seen, tie.two_port)
        else:
            into.terms.append(seen)
            self._remove(leaf)

    def _move_across(self, leaf: Row, into: Row, seen: Term) -> None:
        """Draw a leaf on the near side of its TF or GY: its unknown and balance in the neighbour's units."""
        net, program = self.net, self.program
        size = net.entry(into, leaf)
        leaf.sources = {source: program.div(amount, size) for source, amount in leaf.sources.items()}
        self.story.moved(leaf, size)
        leaf.terms = [Term(seen.name, program.inv(seen.register))]
        into.entries[leaf], leaf.entries[into] = program.one, program.neg(program.one)
        net.retie(into, leaf, BOND)
        self.story.done()

    def _swap(self, leaf: Row, into: Row, seen: Term, two_port: str | None = None) -> None:
        """Replace the Norton form on a leaf by the Thévenin form on its neighbour, or the other way round."""
        net, program = self.net, self.program
        factor = program.mul(program.neg(into.entries[leaf]), seen.register)
        for source, amount in leaf.sources.items():
            net.feed(into, source, program.mul(factor, amount))
        self.story.swapped(leaf, into, factor, two_port)
        into.terms.append(seen)
        self._remove(leaf)
        if two_port is None:
            self.story.merged(leaf, into)

    def _eliminate_on_loop(self, row: Row, neighbours: list[Row], own: Register) -> None:
        """Eliminate a junction by its multiport equivalent: the Schur complement of the nodal form."""
        net, program = self.net, self.program
        inverse = program.inv(own)
        factors = {other: program.mul(other.entries[row], inverse) for other in neighbours}
        changes = {
            (one, other): program.neg(program.mul(factor, row.entries[other]))
            for one, factor in factors.items()
            for other in neighbours
        }
        for (one, other), change in changes.items():
            self._add(one, other, change, row)
        for other, factor in factors.items():
            for source, amount in row.sources.items():
                net.feed(other, source, program.mul(program.neg(factor), amount))
        self.story.eliminated(row, factors, changes)
        self._remove(row)

    def _add(self, row: Row, column: Row, change: Register, origin: Row) -> None:
        if self.program.is_zero(change):
            return
        if row is column:
            row.terms.append(Term(origin.name, change))
        else:
            self.net.add_entry(row, column, change)

    # --- bare junctions ------------------------------------------------------------------------

    def paired(self, a: Row, b: Row) -> bool:
        """Tell whether two junctions appear in each other's balance, so that they can be one pivot."""
        zero = self.program.is_zero
        return not zero(self.net.entry(a, b)) and not zero(self.net.entry(b, a))

    def hold_root(self, bare: Row) -> None:
        """Let a bare junction at the root state the root's unknown."""
        program, root = self.program, self.root
        entry = bare.entries[root]
        self.held = {source: program.div(amount, entry) for source, amount in bare.sources.items()}
        self.pivots.append(program.mul(entry, root.entries[bare]))
        self.story.constrained(bare, root)
        self._remove(bare)

    def eliminate_pair(self, partner: Row, bare: Row) -> list[Row]:
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
        one, other = partner.sources, bare.sources
        sides = {
            source: solve(one.get(source, program.zero), other.get(source, program.zero))
            for source in {**one, **other}
        }
        for row in around:
            left = (net.entry(row, partner), net.entry(row, bare))
            for column, solved in columns.items():
                self._add(row, column, program.neg(_dot(program, left, solved)), partner)
            for source, solved in sides.items():
                net.feed(row, source, program.neg(_dot(program, left, solved)))
            self.story.driven(row)
        self.story.constrained(bare, partner)
        self.net.remove(bare)
        self._remove(partner)
        return around


def _dot(program: Program, left: tuple[Register, Register], right: tuple[Register, Register]) -> Register:
    return program.add(program.mul(left[0], right[0]), program.mul(left[1], right[1]))
