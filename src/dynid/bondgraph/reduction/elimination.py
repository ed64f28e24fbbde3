"""Eliminating one junction after another: every elimination is a physical step.

A leaf is superposed (series, parallel), reflected through a TF or GY into its neighbour, and a source on it
is swapped (Park & Kim 1997, eqs 1, 2, 15, 16); a junction on a loop becomes its multiport equivalent; a bare
junction states a constraint.
"""

from __future__ import annotations

from collections.abc import Callable

from dynid.bondgraph.reduction.junctions import Coupling, Names
from dynid.bondgraph.reduction.network import Network, Term
from dynid.bondgraph.reduction.program import Op, Program, Register
from dynid.bondgraph.reduction.steps import Definition, Step, listed

#: Letter of the common variable of a junction.
COMMON = {"0": "e", "1": "f"}


class Elimination:
    """A network under elimination, with the steps taken and the pivots met so far.

    Parameters
    ----------
    network
        The network; it shrinks.
    watch
        Called whenever the network is whole: after every step, and after a change that needs none.
    traced
        Whether superpositions and swaps, of which a large graph has many, are told as steps.

    Attributes
    ----------
    steps, pivots
        What was done, and the registers divided by.
    labels
        Names of registers in the equations of the steps.
    """

    def __init__(self, network: Network, watch: Callable[[], None], *, traced: bool = True) -> None:
        self.net, self.program, self.root = network, network.program, network.root
        self.traced = traced
        self._watch = watch
        self.steps: list[Step] = []
        self.pivots: list[Register] = []
        self.held: dict[str, Register] | None = None  # the root's unknown, where a bare neighbour fixes it
        self.held_by: tuple[tuple[Register, str], ...] = ()  # the same in terms of equivalent sources
        self.labels: dict[Register, str] = {}
        self._names = Names(_taken_names(network))

    def eliminate(self, name: str, own: Register) -> list[str]:
        """Eliminate a junction on which something stands, in all `own`; return its former neighbours."""
        neighbours = self.net.neighbours(name)
        if self.traced:
            self.superpose(name, self.net.terms[name], None)
        self.pivots.append(own)
        if len(neighbours) == 1:
            self._absorb_leaf(name, neighbours[0], own)
        elif neighbours:
            self._eliminate_on_loop(name, neighbours, own)
        else:
            self.net.remove(name)
            self._watch()
        return neighbours

    def record(self, step: Step) -> None:
        """Note a step that is done."""
        self.steps.append(step)
        self._watch()

    def names(self, junction: str) -> tuple[str, ...]:
        """Return the user's junctions in a junction, or its made-up name."""
        members = self.net.structure.junctions[junction].members
        return tuple(members) if members else (junction,)

    def _fresh(self, wanted: str) -> str:
        """Return a name for something new, so that no two things in a trace are called the same."""
        return self._names.fresh(wanted)

    def superpose(self, junction: str, terms: list[Term], name: str | None) -> Register:
        """Series on a 1-junction, parallel on a 0-junction (eqs 1, 2)."""
        total = self.program.sum(term.register for term in terms)
        if len(terms) < 2 or not self.traced:
            return total
        series = self.net.kind[junction] == "1"
        letter = "Z" if series else "Y"
        label = name or self._fresh(f"{letter}_{junction}")
        parts = tuple((term.register, "") for term in terms)
        what, common, law = (
            ("impedances", "flow", "series, eq 1") if series else ("admittances", "effort", "parallel, eq 2")
        )
        meaning = (
            f"{listed([term.name for term in terms])} share the {common} of "
            f"{self.net.kind[junction]}-junction {junction}: their {what} add ({law})"
        )
        nodes = tuple(dict.fromkeys([*self.names(junction), *(term.name for term in terms)]))
        self._name(total, label)
        superposed = {id(term) for term in terms}
        kept = [term for term in self.net.terms[junction] if id(term) not in superposed]
        self.net.terms[junction] = [Term(junction, total), *kept]
        self.record(Step("series" if series else "parallel", nodes, ((label, parts),), meaning))
        return total

    def _name(self, register: Register, label: str) -> None:
        """Let the equations of later steps call a register by a name, unless it is as short itself."""
        if self.program.ops[register][0] not in (Op.CONSTANT, Op.PARAMETER, Op.LAPLACE):
            self.labels.setdefault(register, label)

    def _absorb_leaf(self, leaf: str, into: str, own: Register) -> None:
        program, net = self.program, self.net
        coupling = net.single(leaf, into)
        if coupling is None:
            self._eliminate_on_loop(leaf, [into], own)
            return
        term, step = Term(self._origin(leaf), program.inv(own)), None
        if coupling.two_port is not None:
            term, step = self._reflect(leaf, into, own, coupling.two_port, inverse=coupling.inverse)
        if net.sources.get(leaf):
            if step is not None:
                self._move_across(leaf, into, term)
                self.record(step)
            self._swap(leaf, into, term, coupling.two_port)
            return
        net.add_term(into, term)
        net.remove(leaf)
        self._watch() if step is None else self.record(step)

    def _origin(self, junction: str) -> str:
        """Name what stands on a junction: its only element, or itself."""
        terms = self.net.terms[junction]
        return terms[0].name if len(terms) == 1 else junction

    def _reflect(
        self, leaf: str, into: str, own: Register, two_port: str, *, inverse: bool
    ) -> tuple[Term, Step]:
        """Write the immittance seen through a TF or GY: Z1 = n^2 Z2, Z1 = r^2 / Z2."""
        program = self.program
        modulus = program.parameter(two_port)
        square = program.mul(modulus, modulus)
        seen = program.inv(program.mul(square, own)) if inverse else program.mul(square, program.inv(own))
        impedance = seen if self.net.kind[into] == "1" else program.inv(seen)
        label = self._fresh(f"Z_{two_port}")
        transformer = self.net.structure.graph.nodes[two_port].type == "TF"
        law = "Z1 = n^2 Z2" if transformer else "Z1 = r^2/Z2"
        meaning = (
            f"seen from {into} through {'transformer' if transformer else 'gyrator'} {two_port}, "
            f"{self._origin(leaf)} is the impedance {label} ({law})"
        )
        nodes = (*self.names(leaf), two_port)
        self._name(impedance, label)
        return Term(two_port, seen), Step("reflection", nodes, ((label, ((impedance, ""),)),), meaning)

    def _move_across(self, leaf: str, into: str, seen: Term) -> None:
        """Draw a leaf on the near side of its TF or GY: its unknown and balance in the neighbour's units."""
        net, program = self.net, self.program
        size = net.entry(into, leaf)
        for row in (net.sources[leaf], net.drives[leaf]):
            row.update({source: program.div(amount, size) for source, amount in row.items()})
        net.terms[leaf] = [Term(seen.name, program.inv(seen.register))]
        net.matrix[into][leaf], net.matrix[leaf][into] = program.one, program.neg(program.one)
        net.tie(into, leaf, Coupling(into, leaf))

    def _swap(self, leaf: str, into: str, seen: Term, two_port: str | None) -> None:
        """Replace the Norton form on a leaf by the Thévenin form on its neighbour, or the other way round."""
        net, program = self.net, self.program
        scale = program.neg(net.entry(into, leaf))
        if not self.traced:
            factor = program.mul(scale, seen.register)
            for source, amount in net.sources[leaf].items():
                self._add_source(into, source, program.mul(factor, amount))
            net.add_term(into, seen)
            net.remove(leaf)
            return
        letter = "e" if net.kind[into] == "1" else "f"  # what a source feeds into a junction's balance
        label = self._fresh(f"{letter}_eq_{leaf}")
        origin, sources = self._origin(leaf), tuple(net.drives[leaf])

        def swapped(row: dict[str, Register]) -> dict[str, Register]:
            factor = program.mul(scale, seen.register)
            return {source: program.mul(factor, amount) for source, amount in row.items()}

        for source, amount in swapped(net.sources[leaf]).items():
            self._add_source(into, source, amount)
        parts = tuple((amount, source) for source, amount in swapped(net.drives[leaf]).items())
        net.drives[into][label] = program.one
        forms = {"0": ("flow", "Norton, eq 15"), "1": ("effort", "Thévenin, eq 16")}
        (have, old), (want, new) = forms[net.kind[leaf]], forms[net.kind[into]]
        plural = "" if len(sources) == 1 else "s"
        meaning = (
            f"the {have} source{plural} {listed(sources)} with {origin} on "
            f"{net.kind[leaf]}-junction "
            f"{leaf} ({old}) is, for {into}, the equivalent {want} source {label} ({new})"
        )
        if two_port is not None:
            meaning += f", seen through {two_port}"
        else:
            meaning += f"; the {net.kind[leaf]}-junction becomes a {net.kind[into]}-junction"
        net.add_term(into, seen)
        net.remove(leaf)
        self.record(Step("source swap", (*sources, *self.names(leaf)), ((label, parts),), meaning))
        junctions = net.structure.junctions
        if two_port is None and junctions[leaf].members and junctions[into].members:
            self._merge(leaf, into)

    def _merge(self, leaf: str, into: str) -> None:
        """Note that a swapped junction is now of its neighbour's kind, and one with it."""
        kind = self.net.kind[into]
        common = COMMON[kind]
        meaning = f"{leaf} and {into} are {kind}-junctions now, joined by a bond: they merge"
        nodes = (*self.names(leaf), *self.names(into))
        definition = (f"{common}_{leaf}", ((self.program.one, f"{common}_{into}"),))
        self.record(Step("merge", nodes, (definition,), meaning))

    def _add_source(self, junction: str, source: str, amount: Register) -> None:
        row = self.net.sources[junction]
        row[source] = self.program.add(row.get(source, self.program.zero), amount)

    def _eliminate_on_loop(self, name: str, neighbours: list[str], own: Register) -> None:
        """Eliminate a junction by its multiport equivalent: the Schur complement of the nodal form."""
        net, program = self.net, self.program
        factors = {row: program.mul(net.entry(row, name), program.inv(own)) for row in neighbours}
        changes = {
            (row, column): program.neg(program.mul(factor, net.entry(name, column)))
            for row, factor in factors.items()
            for column in neighbours
        }
        for (row, column), change in changes.items():
            self._add(row, column, change, name)
            net.tie(row, column, None)
        definitions: list[Definition] = [
            (self._fresh(f"k_{row}_{column}"), ((change, ""),)) for (row, column), change in changes.items()
        ]
        for row, factor in factors.items():
            definitions += self._pass_on(name, row, program.neg(factor))
        if len(neighbours) == 1:
            meaning = f"{name} acts on {neighbours[0]} through more than a bond: what it passes on is its"
        else:
            meaning = (
                f"{name} lies between {listed(neighbours)}: what it passes on to them is their multiport"
            )
        meaning += " equivalent (Schur complement of the nodal form, as star to mesh)"
        net.remove(name)
        self.record(Step("junction elimination", self.names(name), tuple(definitions), meaning))

    def _pass_on(self, name: str, row: str, factor: Register) -> list[Definition]:
        """Add what drives an eliminated junction, times a factor, to a neighbour; return its definition."""
        net, program = self.net, self.program
        for source, amount in net.sources[name].items():
            self._add_source(row, source, program.mul(factor, amount))
        if not net.drives[name]:
            return []
        label = self._fresh(f"b_{row}_{name}")
        net.drives[row][label] = program.one
        return [(label, tuple((program.mul(factor, drive), by) for by, drive in net.drives[name].items()))]

    def _add(self, row: str, column: str, change: Register, origin: str) -> None:
        if self.program.is_zero(change):
            return
        if row == column:
            self.net.add_term(row, Term(origin, change))
        else:
            self.net.add_entry(row, column, change)

    # --- bare junctions ------------------------------------------------------------------------

    def paired(self, a: str, b: str) -> bool:
        """Tell whether two junctions appear in each other's balance, so that they can be one pivot."""
        zero = self.program.is_zero
        return not zero(self.net.entry(a, b)) and not zero(self.net.entry(b, a))

    def hold_root(self, name: str) -> None:
        """Let a bare junction at the root state the root's unknown."""
        program, net = self.program, self.net
        entry = net.matrix[name][self.root]
        self.held = {source: program.div(amount, entry) for source, amount in net.sources[name].items()}
        self.pivots.append(program.mul(entry, net.matrix[self.root][name]))
        self.held_by, step = self._constraint(name, self.root)
        net.remove(name)
        self.record(step)

    def _constraint(self, bare: str, fixed: str) -> tuple[tuple[tuple[Register, str], ...], Step]:
        """Return what the balance of a bare junction says of a neighbour, and the step that uses it."""
        net, program = self.net, self.program
        own = net.entry(bare, fixed)
        parts = [(program.div(amount, own), by) for by, amount in net.drives[bare].items()]
        others = [other for other in net.neighbours(bare) if other != fixed]
        for other in others:
            tie = program.neg(program.div(net.entry(bare, other), own))
            parts.append((tie, f"{COMMON[net.kind[other]]}_{other}"))
        common = COMMON[net.kind[fixed]]
        what = {"e": "effort", "f": "flow"}[common]
        tied = f"ties the {what} of {fixed} to {listed(others)}" if others else f"fixes the {what} of {fixed}"
        meaning = f"no element stands on {bare}, so its balance alone {tied}"
        nodes = (*self.names(bare), *self.names(fixed))
        definition = (f"{common}_{fixed}", tuple(parts))
        return tuple(parts), Step("constraint", nodes, (definition,), meaning)

    def eliminate_pair(self, partner: str, bare: str) -> list[str]:
        """Eliminate a bare junction with a neighbour, a 2 x 2 pivot [[d, a], [b, 0]]; return those around."""
        net, program = self.net, self.program
        a, b = net.matrix[partner][bare], net.matrix[bare][partner]
        d = net.diagonal(partner)
        self.pivots.append(program.mul(a, b))
        around = dict.fromkeys([*net.neighbours(partner), *net.neighbours(bare)])
        rows = [row for row in around if row not in (partner, bare)]

        def solve(of_partner: Register, of_bare: Register) -> tuple[Register, Register]:
            x = program.div(of_bare, b)
            return x, program.div(program.sub(of_partner, program.mul(d, x)), a)

        columns = {column: solve(net.entry(partner, column), net.entry(bare, column)) for column in rows}
        names = dict.fromkeys([*net.sources[partner], *net.sources[bare]])
        sides = {
            source: solve(
                net.sources[partner].get(source, program.zero), net.sources[bare].get(source, program.zero)
            )
            for source in names
        }
        for row in rows:
            left = (net.entry(row, partner), net.entry(row, bare))
            for column, solved in columns.items():
                self._add(row, column, program.neg(_dot(program, left, solved)), partner)
                net.tie(row, column, None)
            for source, solved in sides.items():
                self._add_source(row, source, program.neg(_dot(program, left, solved)))
            net.drives[row] = dict(net.sources[row])
        _, step = self._constraint(bare, partner)
        net.remove(bare)
        net.remove(partner)
        self.record(step)
        return rows


def _taken_names(network: Network) -> set[str]:
    """Collect what a label must not be called: nodes, parameters, and the prototype's systems."""
    nodes = network.structure.graph.nodes
    parameters = {name for node in nodes.values() if node.formula for name in node.formula.names}
    return {*nodes, *parameters, "Z_A", "Z_B", "Y_A", "Y_B"}


def _dot(program: Program, left: tuple[Register, Register], right: tuple[Register, Register]) -> Register:
    return program.add(program.mul(left[0], right[0]), program.mul(left[1], right[1]))
