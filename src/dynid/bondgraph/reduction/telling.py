"""Telling a reduction: what every step did, to which nodes, in which equations and words.

Only a reduction that is to be looked at is told; the arithmetic needs none of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduction.junctions import Names
from dynid.bondgraph.reduction.network import Network, Row, Term
from dynid.bondgraph.reduction.port import PortForm
from dynid.bondgraph.reduction.program import Op, Register
from dynid.bondgraph.reduction.prototypes import DrivenBy, Prototype
from dynid.bondgraph.reduction.steps import Definition, Formula, Step, listed

#: Letter of the common variable of a junction.
COMMON = {"0": "e", "1": "f"}
#: Registers that sum up to something, each with the variable that it multiplies.
Parts = tuple[tuple[Register, str], ...]


class Untold:
    """A reduction whose steps nobody asks for: whatever happens, nothing is told.

    Every telling of a step comes before the network changes, `done` after it.

    Attributes
    ----------
    steps
        What was done.
    labels
        Names of registers in the equations of the steps.
    """

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.labels: dict[Register, str] = {}

    def done(self) -> None:
        """Note that the network is whole again."""

    def superposed(self, row: Row, terms: list[Term], total: Register, label: str = "") -> None:
        """Tell, and note on the junction, that immittances add up: in series or parallel (eqs 1, 2)."""

    def reflected(self, leaf: Row, into: Row, seen: Term) -> None:
        """Tell of an immittance seen through a TF or GY: Z1 = n^2 Z2, Z1 = r^2 / Z2."""

    def moved(self, leaf: Row, size: Register) -> None:
        """Turn what drives a leaf into the units of its neighbour, through a coupling of this size."""

    def swapped(self, leaf: Row, into: Row, factor: Register, two_port: str | None) -> None:
        """Tell that the Norton form on a leaf is a Thévenin form on its neighbour, or the other way round."""

    def merged(self, leaf: Row, into: Row) -> None:
        """Tell that a swapped junction is now of its neighbour's kind, and one with it, if both are drawn."""

    def eliminated(
        self, row: Row, factors: dict[Row, Register], changes: dict[tuple[Row, Row], Register]
    ) -> None:
        """Tell of a multiport equivalent: what the neighbours' entries gain, and the sources."""

    def constrained(self, bare: Row, fixed: Row) -> None:
        """Tell what the balance of a bare junction says of a neighbour."""

    def driven(self, row: Row) -> None:
        """Note that a balance is told from now on by what feeds it itself."""

    def reached(self, prototype: Prototype, port: Port, form: PortForm) -> None:
        """Tell the prototype, its systems, what drives them, and the output in these terms."""


class Told(Untold):
    """The steps of a reduction, as they are taken.

    Parameters
    ----------
    network
        The network; it shrinks.
    watch
        Called whenever the network is whole: after every step, and after a change that needs none.

    Attributes
    ----------
    drives
        What feeds the balances, as `Row.sources`, in terms of sources and equivalent sources.
    """

    def __init__(self, network: Network, watch: Callable[[], None] = lambda: None) -> None:
        super().__init__()
        self.net, self.program, self._watch = network, network.program, watch
        self.drives = {row: dict(row.sources) for row in network.rows.values()}
        self._names = Names(_taken_names(network))
        self._under_way: Step | None = None
        self._held_by: Parts | None = None  # what fixes the root's unknown, where a bare neighbour does

    def done(self) -> None:  # noqa: D102
        if self._under_way is not None:
            self.steps.append(self._under_way)
            self._under_way = None
        self._watch()

    def tell(
        self, rule: str, nodes: tuple[str, ...], definitions: Iterable[Definition], meaning: str
    ) -> None:
        """Say what is under way."""
        self._under_way = Step(rule, nodes, tuple(definitions), meaning)

    def nodes(self, row: Row) -> tuple[str, ...]:
        """Return the user's junctions in a junction, or its made-up name."""
        members = self.net.structure.junctions[row.name].members
        return tuple(members) if members else (row.name,)

    def superposed(self, row: Row, terms: list[Term], total: Register, label: str = "") -> None:  # noqa: D102
        if len(terms) < 2:
            return
        series = row.kind == "1"
        label = label or self._names.fresh(f"{'Z' if series else 'Y'}_{row.name}")
        what, common, law = (
            ("impedances", "flow", "series, eq 1") if series else ("admittances", "effort", "parallel, eq 2")
        )
        meaning = (
            f"{listed([term.name for term in terms])} share the {common} of "
            f"{row.kind}-junction {row.name}: their {what} add ({law})"
        )
        nodes = tuple(dict.fromkeys([*self.nodes(row), *(term.name for term in terms)]))
        self._name(total, label)
        superposed = {id(term) for term in terms}
        row.terms = [Term(row.name, total), *(term for term in row.terms if id(term) not in superposed)]
        parts = tuple((term.register, "") for term in terms)
        self.tell("series" if series else "parallel", nodes, [(label, parts)], meaning)
        self.done()

    def reflected(self, leaf: Row, into: Row, seen: Term) -> None:  # noqa: D102
        two_port = seen.name
        impedance = seen.register if into.kind == "1" else self.program.inv(seen.register)
        label = self._names.fresh(f"Z_{two_port}")
        transformer = self.net.structure.graph.nodes[two_port].type == "TF"
        law = "Z1 = n^2 Z2" if transformer else "Z1 = r^2/Z2"
        meaning = (
            f"seen from {into.name} through {'transformer' if transformer else 'gyrator'} {two_port}, "
            f"{leaf.origin} is the impedance {label} ({law})"
        )
        self._name(impedance, label)
        self.tell("reflection", (*self.nodes(leaf), two_port), [(label, ((impedance, ""),))], meaning)

    def moved(self, leaf: Row, size: Register) -> None:  # noqa: D102
        for source, amount in self.drives[leaf].items():
            self.drives[leaf][source] = self.program.div(amount, size)

    def swapped(self, leaf: Row, into: Row, factor: Register, two_port: str | None) -> None:  # noqa: D102
        letter = "e" if into.kind == "1" else "f"  # what a source feeds into a junction's balance
        label = self._names.fresh(f"{letter}_eq_{leaf.name}")
        sources, parts = tuple(self.drives[leaf]), self._passed_on(leaf, into, factor, label)
        forms = {"0": ("flow", "Norton, eq 15"), "1": ("effort", "Thévenin, eq 16")}
        (have, old), (want, new) = forms[leaf.kind], forms[into.kind]
        meaning = (
            f"the {have} source{'' if len(sources) == 1 else 's'} {listed(sources)} with {leaf.origin} on "
            f"{leaf.kind}-junction "
            f"{leaf.name} ({old}) is, for {into.name}, the equivalent {want} source {label} ({new})"
        )
        if two_port is not None:
            meaning += f", seen through {two_port}"
        else:
            meaning += f"; the {leaf.kind}-junction becomes a {into.kind}-junction"
        self.tell("source swap", (*sources, *self.nodes(leaf)), [(label, parts)], meaning)

    def merged(self, leaf: Row, into: Row) -> None:  # noqa: D102
        junctions = self.net.structure.junctions
        if not (junctions[leaf.name].members and junctions[into.name].members):
            return
        common = COMMON[into.kind]
        meaning = f"{leaf.name} and {into.name} are {into.kind}-junctions now, joined by a bond: they merge"
        definition = (f"{common}_{leaf.name}", ((self.program.one, f"{common}_{into.name}"),))
        self.tell("merge", (*self.nodes(leaf), *self.nodes(into)), [definition], meaning)
        self.done()

    def eliminated(  # noqa: D102
        self, row: Row, factors: dict[Row, Register], changes: dict[tuple[Row, Row], Register]
    ) -> None:
        definitions: list[Definition] = [
            (self._names.fresh(f"k_{one.name}_{other.name}"), ((change, ""),))
            for (one, other), change in changes.items()
        ]
        for other, factor in factors.items():
            if self.drives[row]:
                label = self._names.fresh(f"b_{other.name}_{row.name}")
                definitions.append((label, self._passed_on(row, other, self.program.neg(factor), label)))
        neighbours = [other.name for other in factors]
        if len(neighbours) == 1:
            meaning = f"{row.name} acts on {neighbours[0]} through more than a bond: what it passes on is its"
        else:
            meaning = (
                f"{row.name} lies between {listed(neighbours)}: what it passes on to them is their multiport"
            )
        meaning += " equivalent (Schur complement of the nodal form, as star to mesh)"
        self.tell("junction elimination", self.nodes(row), definitions, meaning)

    def constrained(self, bare: Row, fixed: Row) -> None:  # noqa: D102
        net, program = self.net, self.program
        own = net.entry(bare, fixed)
        parts = [(program.div(amount, own), by) for by, amount in self.drives[bare].items()]
        others = [other for other in bare.entries if other is not fixed]
        for other in others:
            tie = program.neg(program.div(net.entry(bare, other), own))
            parts.append((tie, f"{COMMON[other.kind]}_{other.name}"))
        common = COMMON[fixed.kind]
        what, names = {"e": "effort", "f": "flow"}[common], [other.name for other in others]
        does = f"ties the {what} of {fixed.name} to" if names else f"fixes the {what} of {fixed.name}"
        meaning = f"no element stands on {bare.name}, so its balance alone {does}"
        if names:
            meaning += f" {listed(names)}"
        nodes = (*self.nodes(bare), *self.nodes(fixed))
        self.tell("constraint", nodes, [(f"{common}_{fixed.name}", tuple(parts))], meaning)
        if fixed is net.root:
            self._held_by = tuple(parts)

    def driven(self, row: Row) -> None:  # noqa: D102
        self.drives[row] = dict(row.sources)

    def reached(self, prototype: Prototype, port: Port, form: PortForm) -> None:  # noqa: D102
        root, zero = self.net.root, self.program.is_zero
        letter = COMMON[root.kind]
        common, source = f"{letter}_{root.name}", {"e": "f_eq", "f": "e_eq"}[letter]
        definitions: list[Definition] = [(name, ((register, ""),)) for name, register in prototype.systems]
        if not prototype.fixed or not zero(form.drive):
            drives = tuple((amount, by) for by, amount in self.drives[root].items())
            definitions.append((source, drives))
        definitions.append((common, self._common(prototype, source)))
        if (port.node, port.quantity) != (root.name, letter):
            output = ((form.common, common), (form.drive, source), (form.own, form.by))
            parts = tuple((register, by) for register, by in output if not zero(register))
            definitions.append((f"{port.quantity}_{port.node}", parts))
        self.tell("prototype", self.nodes(root), definitions, prototype.describe(root.name))
        self.done()

    def _common(self, prototype: Prototype, source: str) -> Parts | Formula:
        """Return what the root's common variable equals: what fixes it, or the prototype's relation."""
        fixing = self.net.root.fixing
        if self._held_by is not None:
            return self._held_by
        if fixing is not None:
            return ((self.program.one, fixing),) if fixing in self.net.inputs else ()
        return DrivenBy(prototype, source)

    def _passed_on(self, row: Row, to: Row, factor: Register, label: str) -> Parts:
        """Let what drives a row, times a factor, drive another under a label; return what that stands for."""
        self.drives[to][label] = self.program.one
        return tuple((self.program.mul(factor, amount), by) for by, amount in self.drives[row].items())

    def _name(self, register: Register, label: str) -> None:
        """Let the equations of later steps call a register by a name, unless it is as short itself."""
        if self.program.ops[register][0] not in (Op.CONSTANT, Op.PARAMETER, Op.LAPLACE):
            self.labels.setdefault(register, label)


def _taken_names(network: Network) -> set[str]:
    """Collect what a label must not be called: nodes, parameters, and the prototype's systems."""
    nodes = network.structure.graph.nodes
    parameters = {name for node in nodes.values() if node.formula for name in node.formula.names}
    return {*nodes, *parameters, "Z_A", "Z_B", "Y_A", "Y_B"}
