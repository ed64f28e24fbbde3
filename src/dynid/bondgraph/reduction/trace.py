"""The trace of a reduction: its steps, and the recorder that writes them in equations and words.

Only a reduction whose steps were requested is recorded; the arithmetic does not need them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from dynid.bondgraph.formula_printers import FormulaPrinter, Printed
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.program.program import Operation, Register
from dynid.bondgraph.reduction.junctions import NameRegistry
from dynid.bondgraph.reduction.network import Immittance, NodalNetwork, NodeRow, PortForm
from dynid.bondgraph.reduction.prototypes import SYSTEMS, DrivenRelation, Prototype

# --- steps ----------------------------------------------------------------------------------------

#: A formula in names that were defined before.
PrintableFormula = Callable[[FormulaPrinter], Printed]
#: Registers that sum up to something, each with the variable that it multiplies (empty: none).
WeightedSum = tuple[tuple[Register, str], ...]
#: A name, and what sums up to it, or a formula.
Definition = tuple[str, WeightedSum | PrintableFormula]


@dataclass(frozen=True)
class ReductionStep:
    """One step of a reduction."""

    #: series, parallel, reflection, source swap, merge, junction elimination, constraint or prototype.
    rule: str
    nodes: tuple[str, ...]  # the nodes it consumed
    definitions: tuple[Definition, ...]  # what it defines, in order
    meaning: str  # what happens, physically, in one sentence


def _join_names(names: Iterable[str]) -> str:
    """Join names as in a sentence: a, b and c."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


# --- recorder -------------------------------------------------------------------------------------

#: Letter of the common variable of a junction.
COMMON = {"0": "e", "1": "f"}


#: What entries of the nodal form gain, by row and column.
Changes = Mapping[tuple[NodeRow, NodeRow], Register]


class NoTrace:
    """The trace of a reduction whose steps are not requested: nothing is recorded.

    Every step is recorded before the network changes; `done` is called after it.

    `labels`: names of registers in the equations of the steps. `suffix`: what stands behind the names of the
    prototype's systems.
    """

    suffix = ""

    def __init__(self) -> None:
        self.steps: list[ReductionStep] = []
        self.labels: dict[Register, str] = {}

    def done(self) -> None:
        """Note that the network is whole again."""

    def superposed(self, row: NodeRow, terms: list[Immittance], total: Register, label: str = "") -> None:
        """Record, and note on the junction, that immittances add up: in series or parallel (eqs 1, 2)."""

    def reflected(self, leaf: NodeRow, into: NodeRow, seen: Immittance) -> None:
        """Record the reflection of an immittance through a TF or GY: Z1 = n^2 Z2, Z1 = r^2 / Z2."""

    def moved(self, leaf: NodeRow, size: Register) -> None:
        """Convert the drives of a leaf to the units of its neighbour, through a coupling of this size."""

    def swapped(self, leaf: NodeRow, into: NodeRow, factor: Register, two_port: str | None) -> None:
        """Record the swap of a Norton form on a leaf for a Thévenin form on its neighbour, or the reverse."""

    def merged(self, leaf: NodeRow, into: NodeRow) -> None:
        """Record the merge of a swapped junction with its neighbour, where both are drawn."""

    def eliminated(self, row: NodeRow, factors: dict[NodeRow, Register], changes: Changes) -> None:
        """Record a multiport equivalent: the gains of the neighbours' entries, and the sources."""

    def constrained(self, bare: NodeRow, fixed: NodeRow, changes: Changes) -> None:
        """Record the constraint that a bare junction puts on a neighbour, and the gains of entries."""

    def driven(self, row: NodeRow) -> None:
        """Note that a balance is described by its own sources from here on."""

    def reached(self, prototype: Prototype, port: Port, form: PortForm) -> None:
        """Record the prototype, its systems, what drives them, and the output in these terms."""


class TraceRecorder(NoTrace):
    """The recorder of the steps of a reduction, in equations and words.

    Parameters
    ----------
    watch
        Called whenever the network is whole: after every step, and after a change that needs none.
    names
        The names that are taken, which no step may define again; default: those of the graph.
    suffix
        What stands behind the names of the prototype's systems, which are reserved with it
        (`reserve_system_names`).

    Attributes
    ----------
    drives
        What feeds the balances, as `Balance.sources`, in terms of sources and equivalent sources.
    """

    def __init__(
        self,
        network: NodalNetwork,
        watch: Callable[[], None] = lambda: None,
        names: NameRegistry | None = None,
        suffix: str = "",
    ) -> None:
        super().__init__()
        self.net, self.program, self._watch = network, network.program, watch
        self.drives = {row: dict(row.sources) for row in network.rows.values()}
        if names is None:
            names = NameRegistry(taken_names(network.structure.graph))
            suffix = reserve_system_names(names)
        self._names, self.suffix = names, suffix
        self._variables: dict[tuple[str, str], str] = {}
        self._meant: dict[str, dict[str, Register]] = {}  # what a drive is in terms of the inputs
        self._titles: dict[tuple[NodeRow, Immittance], str] = {}
        self._under_way: ReductionStep | None = None
        self._held_by: WeightedSum | None = None  # what fixes the root's unknown, where a bare neighbour does

    def done(self) -> None:  # noqa: D102
        if self._under_way is not None:
            self.steps.append(self._under_way)
            self._under_way = None
        self._watch()

    def record(
        self, rule: str, nodes: tuple[str, ...], definitions: Iterable[Definition], meaning: str
    ) -> None:
        """Note the step that is under way."""
        self._under_way = ReductionStep(rule, nodes, tuple(definitions), meaning)

    def nodes(self, row: NodeRow) -> tuple[str, ...]:
        """Return the user's junctions in a junction, or its made-up name."""
        members = self.net.structure.junctions[row.name].members
        return tuple(members) if members else (row.name,)

    def superposed(self, row: NodeRow, terms: list[Immittance], total: Register, label: str = "") -> None:  # noqa: D102
        if len(terms) < 2:
            return
        series = row.kind == "1"
        label = label or self._names.fresh(f"{'Z' if series else 'Y'}_{row.name}")
        what, common, law = (
            ("impedances", "flow", "series, eq 1") if series else ("admittances", "effort", "parallel, eq 2")
        )
        meaning = (
            f"{_join_names([term.name for term in terms])} share the {common} of "
            f"{row.kind}-junction {row.name}: their {what} add ({law})"
        )
        nodes = tuple(dict.fromkeys([*self.nodes(row), *(term.name for term in terms)]))
        self._name(total, label)
        superposed = {id(term) for term in terms}
        row.terms = [Immittance(row.name, total), *(term for term in row.terms if id(term) not in superposed)]
        parts = tuple((term.register, "") for term in terms)
        self.record("series" if series else "parallel", nodes, [(label, parts)], meaning)
        self.done()

    def reflected(self, leaf: NodeRow, into: NodeRow, seen: Immittance) -> None:  # noqa: D102
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
        self.record("reflection", (*self.nodes(leaf), two_port), [(label, ((impedance, ""),))], meaning)

    def moved(self, leaf: NodeRow, size: Register) -> None:  # noqa: D102
        for source, amount in self.drives[leaf].items():
            self.drives[leaf][source] = self.program.div(amount, size)

    def swapped(self, leaf: NodeRow, into: NodeRow, factor: Register, two_port: str | None) -> None:  # noqa: D102
        letter = "e" if into.kind == "1" else "f"  # what a source feeds into a junction's balance
        label = self._names.fresh(f"{letter}_eq_{leaf.name}")
        sources, parts = tuple(self.drives[leaf]), self._passed_on(leaf, into, factor, label)
        forms = {"0": ("flow", "Norton, eq 15"), "1": ("effort", "Thévenin, eq 16")}
        (have, old), (want, new) = forms[leaf.kind], forms[into.kind]
        meaning = (
            f"the {have} source{'' if len(sources) == 1 else 's'} {_join_names(sources)} with "
            f"{leaf.origin} on {leaf.kind}-junction {leaf.name} ({old}) is, for {into.name}, "
            f"the equivalent {want} source {label} ({new})"
        )
        if two_port is not None:
            meaning += f", seen through {two_port}"
        else:
            meaning += f"; the {leaf.kind}-junction becomes a {into.kind}-junction"
        self.record("source swap", (*sources, *self.nodes(leaf)), [(label, parts)], meaning)

    def merged(self, leaf: NodeRow, into: NodeRow) -> None:  # noqa: D102
        junctions = self.net.structure.junctions
        if not (junctions[leaf.name].members and junctions[into.name].members):
            return
        meaning = f"{leaf.name} and {into.name} are {into.kind}-junctions now, joined by a bond: they merge"
        letter = COMMON[into.kind]  # the leaf's common variable is that of the kind it has become
        definition = (self.variable(letter, leaf.name), ((self.program.one, self._common_of(into)),))
        self.record("merge", (*self.nodes(leaf), *self.nodes(into)), [definition], meaning)
        self.done()

    def eliminated(self, row: NodeRow, factors: dict[NodeRow, Register], changes: Changes) -> None:  # noqa: D102
        definitions = self._gained(row, changes)
        for neighbour, factor in factors.items():
            if self.drives[row]:
                label = self._names.fresh(f"b_{neighbour.name}_{row.name}")
                definitions.append((label, self._passed_on(row, neighbour, self.program.neg(factor), label)))
        neighbours = [neighbour.name for neighbour in factors]
        if len(neighbours) == 1:
            meaning = f"{row.name} acts on {neighbours[0]} through more than a bond: what it passes on is its"
        else:
            meaning = (
                f"{row.name} lies between {_join_names(neighbours)}: "
                "what it passes on to them is their multiport"
            )
        meaning += " equivalent (Schur complement of the nodal form, as star to mesh)"
        self.record("junction elimination", self.nodes(row), definitions, meaning)

    def _gained(self, origin: NodeRow, changes: Changes) -> list[Definition]:
        """Name what entries gain by the elimination of a junction, and define it."""
        definitions: list[Definition] = []
        for (row, column), change in changes.items():
            if self.program.is_zero(change):
                continue
            label = self._names.fresh(f"k_{row.name}_{column.name}")
            definitions.append((label, ((change, ""),)))
            self._name(change, label)
            if row is column:
                self._titles[row, Immittance(origin.name, change)] = label
        return definitions

    def title(self, row: NodeRow, term: Immittance) -> str:
        """Return the name of an immittance on a junction: its own, or one after the node it comes from."""
        title = self._titles.get((row, term)) or self.labels.get(term.register)
        if title is None:
            title = self._names.fresh(f"{'Z' if row.kind == '1' else 'Y'}_{term.name}")
            self._titles[row, term] = title
        return title

    def variable(self, letter: str, node: str) -> str:
        """Return the name of an effort, flow, momentum or displacement of a node."""
        key = letter, node
        if key not in self._variables:
            self._variables[key] = self._names.fresh(f"{letter}_{node}")
        return self._variables[key]

    def _common_of(self, row: NodeRow) -> str:
        return self.variable(COMMON[row.kind], row.name)

    def constrained(self, bare: NodeRow, fixed: NodeRow, changes: Changes) -> None:  # noqa: D102
        net, program = self.net, self.program
        entry = net.entry(bare, fixed)
        parts = [(program.div(amount, entry), by) for by, amount in self.drives[bare].items()]
        others = [neighbour for neighbour in bare.entries if neighbour is not fixed]
        for neighbour in others:
            tie = program.neg(program.div(net.entry(bare, neighbour), entry))
            parts.append((tie, self._common_of(neighbour)))
        what, names = (
            {"e": "effort", "f": "flow"}[COMMON[fixed.kind]],
            [neighbour.name for neighbour in others],
        )
        does = f"ties the {what} of {fixed.name} to" if names else f"fixes the {what} of {fixed.name}"
        meaning = f"no element stands on {bare.name}, so its balance alone {does}"
        if names:
            meaning += f" {_join_names(names)}"
        nodes = (*self.nodes(bare), *self.nodes(fixed))
        definitions = [(self._common_of(fixed), tuple(parts)), *self._gained(fixed, changes)]
        self.record("constraint", nodes, definitions, meaning)
        if fixed is net.root:
            self._held_by = tuple(parts)

    def driven(self, row: NodeRow) -> None:  # noqa: D102
        self.drives[row] = dict(row.sources)

    def reached(self, prototype: Prototype, port: Port, form: PortForm) -> None:  # noqa: D102
        root, zero = self.net.root, self.program.is_zero
        letter = COMMON[root.kind]
        common, source = self._common_of(root), self._names.fresh({"e": "f_eq", "f": "e_eq"}[letter])
        definitions: list[Definition] = [(name, ((register, ""),)) for name, register in prototype.systems]
        if not prototype.fixed or not zero(form.drive):
            drives = tuple((amount, by) for by, amount in self.drives[root].items())
            definitions.append((source, drives))
        relation: WeightedSum | PrintableFormula = DrivenRelation(prototype, source)
        if self._held_by is not None:
            relation = self._held_by
        elif root.fixing is not None:
            relation = ((self.program.one, root.fixing),) if root.fixing in self.net.inputs else ()
        definitions.append((common, relation))
        if (port.node, port.quantity) != (root.name, letter):
            output = ((form.common, common), (form.drive, source), (form.direct, form.by))
            parts = tuple((register, by) for register, by in output if not zero(register))
            definitions.append((self.variable(port.quantity, port.node), parts))
        self.record("prototype", self.nodes(root), definitions, prototype.describe(root.name))
        self.done()

    def _passed_on(self, row: NodeRow, to: NodeRow, factor: Register, label: str) -> WeightedSum:
        """Add the drives of a row, times a factor, to another row under a label; return the sum they form."""
        parts = tuple((self.program.mul(factor, amount), by) for by, amount in self.drives[row].items())
        program = self.program
        meant: dict[str, Register] = {}  # the sum in terms of the inputs
        for amount, by in parts:
            for source, coefficient in self._meant.get(by, {by: program.one}).items():
                meant[source] = program.add(meant.get(source, program.zero), program.mul(amount, coefficient))
        self._meant[label] = meant
        for label_before, amount in self.drives[to].items():
            earlier = self._meant.get(label_before, {})
            taken_back = meant.keys() == earlier.keys() and all(
                program.are_opposite(meant[source], earlier[source]) for source in meant
            )
            if amount == program.one and taken_back:
                del self.drives[to][label_before]
                return parts
        self.drives[to][label] = program.one
        return parts

    def _name(self, register: Register, label: str) -> None:
        """Name a register in the equations of later steps, unless it is as short itself."""
        if self.program.ops[register][0] not in (Operation.CONSTANT, Operation.PARAMETER, Operation.LAPLACE):
            self.labels.setdefault(register, label)


def reserve_system_names(names: NameRegistry, suffix: str = "") -> str:
    """Reserve the names of a prototype's systems, and return the suffix that makes them free."""
    while any(names.has(f"{system}{suffix}") for system in SYSTEMS):
        suffix += "_2"
    for system in SYSTEMS:
        names.fresh(f"{system}{suffix}")
    return suffix


def taken_names(graph: BondGraph) -> set[str]:
    """Return the names that no step may define: nodes, parameters, and s."""
    nodes = graph.nodes.values()
    parameters = {name for node in nodes if node.formula for name in node.formula.names}
    return {*graph.nodes, *parameters, "s", "s_value"}
