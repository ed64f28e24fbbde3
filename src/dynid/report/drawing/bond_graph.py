"""Bond graph of a result as a drawing, and its reduction strip, one drawing for every step.

The bond graph has causal strokes, values, domains and the source-load cut. The reduction strip shows the
graph that is left after every step (Park & Kim, Figs. 6 to 8).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

from dynid.bondgraph.causality.scap import assign_causality, run_scap
from dynid.bondgraph.causality.strokes import Strokes
from dynid.bondgraph.graph import (
    JUNCTIONS,
    LINE,
    ONE_PORTS,
    QUANTITIES,
    SOURCES,
    TWO_PORTS,
    Bond,
    BondGraph,
    GraphUnits,
    Node,
    Port,
)
from dynid.bondgraph.program.program import Operation, Register
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.reduction.snapshots import Snapshot, snapshots
from dynid.number_format import counted
from dynid.report.drawing.render import Panel, draw_panels, render_sketch
from dynid.report.drawing.sketch import (
    ELEMENT_UNITS,
    Sketch,
    SketchBond,
    SketchNode,
    TextLine,
    folded,
    instances,
)
from dynid.report.figure import CellValue, Figure, FigureTable, Picture
from dynid.report.notation import short
from dynid.report.scenes import scene_of, scene_of_text
from dynid.report.svg import SMALL, Svg
from dynid.result import Result
from dynid.scene.schema.raw import MULTIPORTS, PORT

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import NodeModel
    from dynid.scene.schema.control import LoopModel


#: Most nodes of a drawing; a larger one is unreadable.
MAX_DRAWN_NODES = 300
#: Most nodes of a graph of which parts are drawn, and most drawings of instances.
LARGEST_WHOLE, MOST_INSTANCES = 5000, 20


@dataclass(frozen=True)
class DrawnGraph:
    """The bond graph of a result with the request of its analysis.

    `port` is the bond of the source-load decomposition, if any, from the source side to the load side;
    `domains` are physical domains by node. Fields and structures are junctions in the graph, with what is
    written in their `boxes`. `loops` are pairs of the node that is measured and the source that is driven,
    whose `controllers` are described in lines; `laws` have by node with a law the nodes whose variables the
    law depends on.
    """

    graph: BondGraph
    inputs: tuple[str, ...]
    outputs: tuple[Port, ...]
    port: Bond | None
    domains: dict[str, str]
    boxes: dict[str, str] = field(default_factory=dict)
    loops: tuple[tuple[str, str], ...] = ()
    controllers: dict[str, list[str]] = field(default_factory=dict)
    laws: dict[str, tuple[str, ...]] = field(default_factory=dict)


def drawn_graph(result: Result) -> DrawnGraph:
    """Return the graph of a result, read from its scene; raises as `scene_of`."""
    return _graph_of(scene_of(result))


def _graph_of(scene: Scene) -> DrawnGraph:
    model, types = scene.model, scene.names.nodes
    nodes, boxes, laws = [], dict[str, str](), dict[str, tuple[str, ...]]()

    def holder(end: str) -> str:
        return end.rpartition(".")[0] if types.get(end) == PORT else end

    def bond(between: Bond) -> Bond:
        return Bond(holder(between.tail), holder(between.head))

    for name, node in model.graph.nodes.items():
        kind, value, formula = node.type, None, None
        if node.value is not None:
            value, formula = node.value.exact, node.value.expression
        if kind == LINE:
            boxes[name] = f"line: {float(node.impedance):g}, {float(node.delay):g} s"
            kind = "1"
        if types[name] in MULTIPORTS:
            boxes[name] = f"{types[name]} at {', '.join(node.ports)}"
            kind = "0" if kind == "C" else "1"
        variables = _variables(node, types)
        if variables is not None:  # a law is drawn without its text
            laws[name] = tuple(dict.fromkeys(map(holder, variables)))
            value, formula = Fraction(1), None
        nodes.append(Node(name, kind, value, formula, node.domain or ""))
    graph = BondGraph(nodes, [bond(between) for _, between in model.graph.single_bonds])
    analysis = model.analysis
    if analysis is not None and analysis.reading == "binary":
        graph = graph.rounded()
    if analysis is not None:
        requested = analysis.outputs
    else:  # the measured variables of an identification, of all its records
        records = model.measurement.each if model.measurement is not None else []
        channels = (channel for record in records for channel in record.channels or ())
        requested = list(dict.fromkeys(channel.output for channel in channels if channel.output))
    outputs = [
        Port(holder(output.node), output.quantity, str(output) if types.get(output.node) == PORT else "")
        for output in requested
    ]
    loops = model.control.loops if model.control is not None else ()
    driven = tuple((holder(loop.measured.node), loop.source) for loop in loops)
    controllers = dict[str, list[str]]()
    for loop in loops:
        controllers.setdefault(loop.source, []).extend(_controller_notes(loop))
    feedback = model.control.states if model.control is not None else None
    fed_back = feedback.states if feedback is not None else ()
    for source in feedback.sources if feedback is not None else ():
        driven += tuple((holder(port.node), source) for port in fed_back)
        controllers[source] = [f"gains of {counted(len(fed_back), 'state')}"]
    sources = [name for name, node in graph.nodes.items() if node.type in SOURCES]
    inputs = (analysis.inputs if analysis is not None else None) or sources
    return DrawnGraph(
        graph,
        tuple(name for name in inputs if name in graph.nodes and name not in dict(driven).values()),
        tuple(outputs),
        bond(analysis.port) if analysis is not None and analysis.port is not None else None,
        GraphUnits(graph).domains,
        boxes,
        driven,
        controllers,
        laws,
    )


def _controller_notes(loop: LoopModel) -> list[str]:
    """Return the controller of a loop with its delay or sampling, and its set point, in lines."""
    law = loop.controller
    if law.pid is not None:
        what = "".join(key[1].upper() for key in ("kp", "ki", "kd") if getattr(law.pid, key) is not None)
    else:
        what = "gain" if law.gain is not None else f"order {len(law.denominator or ()) - 1}"
    notes = [f"{what} controller of {loop.measured}"]
    if loop.setpoint or loop.reference:
        notes.append(f"set point {loop.setpoint}" if loop.setpoint else f"reference {loop.reference}")
    if law.delay is not None:
        notes.append(f"delay {short(float(law.delay))} s")
    if law.sample is not None:
        wait = f", {short(float(law.computation))} s late" if law.computation is not None else ""
        notes.append(f"every {short(float(law.sample))} s{wait}")
    return notes


def _variables(node: NodeModel, types: Mapping[str, str]) -> list[str] | None:
    """Return the nodes whose variables the law or modulus of a node depends on; None where it has a value."""
    from dynid.arithmetic.expression import parse

    if node.law is not None:
        names = parse(str(node.law.e or node.law.f)).names
    elif node.value is not None and node.value.variable and node.value.expression is not None:
        names = node.value.expression.names
    else:
        return None
    parts = (name.rpartition(".") for name in sorted(names))
    return [holder for holder, _, quantity in parts if quantity in QUANTITIES and holder in types]


def figures(result: Result) -> Iterator[Figure]:
    """Yield the drawing of a result's bond graph; of an identification of a structure nothing."""
    if getattr(scene_of(result).model, "graph", None) is None:
        return
    drawn = drawn_graph(result)
    if len(drawn.graph.nodes) > LARGEST_WHOLE:
        return
    outermost = sketch_of(drawn)
    for within in ["", *islice(instances(drawn.graph.nodes), MOST_INSTANCES)]:
        sketch = folded(outermost, within)
        if len(sketch.nodes) <= MAX_DRAWN_NODES:
            name, title = (f"inside-{within}", f"Inside {within}") if within else ("bond-graph", "Bond graph")
            yield Figure(name, title, partial(_graph_picture, name, title, result.title, sketch, drawn))


def realisations(result: Result) -> Iterator[Figure]:
    """Yield the drawing of every bond graph of a synthesis."""
    for form in result["synthesis/form"].data:
        drawn = _graph_of(scene_of_text(str(result.value(f"synthesis/{form}/scene"))))
        if len(drawn.graph.nodes) <= MAX_DRAWN_NODES:
            name, title = f"bond-graph-{form}", f"Bond graph, {form} form"
            draw = partial(_graph_picture, name, title, result.title, sketch_of(drawn), drawn)
            yield Figure(name, title, draw)


def _graph_picture(name: str, title: str, result_title: str, sketch: Sketch, drawn: DrawnGraph) -> Picture:
    about = f"{result_title}: {counted(len(sketch.nodes), 'node')} and {counted(len(sketch.bonds), 'bond')}"
    rows = [
        (bond.tail, bond.head, {"tail": bond.tail, "head": bond.head}.get(bond.stroke, ""))
        for bond in sketch.bonds
    ]
    caption = (
        "Power is positive along the half arrows. The causal stroke of a bond is at the end that receives "
        "the effort and determines the flow."
    )
    if drawn.boxes:
        caption = "Power is positive along the half arrows. A box is a field, structure or line."
    if drawn.loops:
        caption += " Dashed arrows are feedback, from what is measured to the source that it drives."
    if any(read != name for name, variables in drawn.laws.items() for read in variables):
        caption += " Dashed arrows are variables that laws depend on."
    if any(node.opens for node in sketch.nodes):
        caption += " The box of a sub-model leads to the drawing of its inside."
    table = FigureTable(("from", "to", "effort is imposed on"), tuple(rows))
    return Picture(render_sketch(name, f"{title} of {result_title}", about, sketch), caption, table)


def sketch_of(drawn: DrawnGraph) -> Sketch:
    """Return the sketch of a graph; a bond has the domain of its end that is no two-port."""
    graph, domains = drawn.graph, drawn.domains
    outputs: dict[str, list[str]] = {}
    for port in drawn.outputs:
        outputs.setdefault(port.node, []).append(port.quantity)
    nodes = []
    for name, node in graph.nodes.items():
        if name in drawn.boxes:  # a field or structure as one node
            ports = ", ".join(str(port) for port in drawn.outputs if port.node == name)
            notes = (drawn.boxes[name], *([f"output {ports}"] if ports else []))
            lines = (TextLine(name), *(TextLine(note, "note") for note in notes))
            nodes.append(SketchNode(name, lines, "", "output" if ports else ""))
            continue
        domain, is_input = domains.get(name, ""), name in drawn.inputs
        sketched = _sketch_node(node, domain, is_input, outputs.get(name, ()), name in drawn.laws)
        lines = (*sketched.lines, *(TextLine(note, "note") for note in drawn.controllers.get(name, ())))
        nodes.append(replace(sketched, lines=lines))
    bonds = []
    # The causality of what is behind a box is not known here.
    strokes = {} if drawn.boxes else {(b.tail, b.head): b.stroke for b in assign_causality(graph).bonds}
    for bond in graph.bonds:
        plain = [end for end in (bond.tail, bond.head) if graph.nodes[end].type not in TWO_PORTS]
        domain = next((domains[end] for end in plain if end in domains), "")
        bonds.append(SketchBond(bond.tail, bond.head, strokes.get((bond.tail, bond.head), ""), domain))
    bonds += [SketchBond(*loop, signal=True) for loop in drawn.loops]
    bonds += [
        SketchBond(read, name, signal=True)
        for name, variables in drawn.laws.items()
        for read in variables
        if read != name
    ]
    source = next((name for name in drawn.inputs if graph.bonds_of(name)), None)
    cut = (drawn.port.tail, drawn.port.head) if drawn.port is not None else None
    return Sketch(tuple(nodes), tuple(bonds), source, next(iter(outputs), None), cut)


def _sketch_node(
    node: Node, domain: str, is_input: bool, outputs: Iterable[str], law: bool = False
) -> SketchNode:
    """Return a node of a graph with its name, its value with unit, and its quantities that are outputs."""
    notes = ["law"] if law else []
    if node.value is not None and not law:
        number = short(float(node.value))
        if node.type in TWO_PORTS:
            notes.append(f"{'n' if node.type == 'TF' else 'r'} = {number}")
        else:
            notes.append(f"{number} {ELEMENT_UNITS.get(domain, {}).get(node.type, '')}".rstrip())
    quantities = ", ".join(outputs)
    notes += ["input"] if is_input else []
    notes += [f"output {quantities}"] if quantities else []
    head: Sequence[TextLine]
    if node.type in JUNCTIONS:
        head = (TextLine(node.type, "glyph"), TextLine(node.name, "note"))
    else:
        head = (TextLine(f"{node.type} : {node.name}"),)
    role = "both" if is_input and quantities else "input" if is_input else "output" if quantities else ""
    return SketchNode(node.name, (*head, *(TextLine(note, "note") for note in notes)), domain, role)


#: Most steps of a reduction that is drawn.
LONGEST = 60
_DASHED = "couplings that are not bonds: the entries k between two junctions, defined by the equations"


def reduction_strips(result: Result) -> Iterator[Figure]:
    """Yield the reduction strip of every output."""
    drawn = drawn_graph(result)
    if drawn.boxes or drawn.loops or drawn.laws:
        return
    steps = result["bond_graph/reduction/steps"].data
    for port in drawn.outputs:
        rows = [row for row in steps if row["output"] == str(port)]
        if 0 < len(rows) <= LONGEST:
            draw = partial(_strip_picture, drawn, port, rows)
            yield Figure(f"reduction-{port}", f"Reduction to {port}, step by step", draw, derivation=True)


def _strip_picture(drawn: DrawnGraph, port: Port, rows: list[dict[str, str]]) -> Picture:
    sketches = reduction_strip(drawn, port)
    title = f"Reduction to {port} in {counted(len(rows), 'step')}"
    name = f"reduction-{port}"
    svg = Svg(name, title, "; ".join(f"{row['rule']}: {row['equation']}" for row in rows))
    panels = [Panel.of_sketch("The graph as drawn", "", "", sketches[0])]
    for number, (row, sketch) in enumerate(zip(rows, sketches[1:], strict=True), 1):
        heading = f"{number}. {row['rule']}: {row['nodes']}"
        panels.append(Panel.of_sketch(heading, row["latex"], row["meaning"], sketch))
    width, height = draw_panels(svg, panels)
    caption = "Every step preserves the response at the port of interest; its changes are highlighted."
    if any(bond.equation_only for sketch in sketches for bond in sketch.bonds):
        svg.line((14, height + 8), (54, height + 8), cls="bond dashed")
        svg.text(62, height + 8 + SMALL / 3, f"dashed: {_DASHED}", "small muted", anchor="start")
        height = height + 8 + 2 * SMALL
        caption += f" Dashed lines are {_DASHED}."
    columns = ("rule", "nodes", "equation", "meaning")
    cells: list[tuple[CellValue, ...]] = [
        (number, *(str(row[column]) for column in columns)) for number, row in enumerate(rows, 1)
    ]
    table = FigureTable(("step", *columns), tuple(cells))
    return Picture(svg.render(width, height), caption, table)


def reduction_strip(drawn: DrawnGraph, port: Port) -> list[Sketch]:
    """Return the graph as drawn, then the graph after every step of its reduction to a port."""
    reduced = ReducedGraph(drawn.graph, drawn.inputs, (port,))
    shots = snapshots(reduced.structure, reduced.program, port, reduced.inputs)
    first = _SnapshotSketch(drawn, reduced, port, shots[0], set()).sketch()
    seen, source = {node.key for node in first.nodes}, first.source
    strip = [replace(sketch_of(drawn), cut=None)]
    for index, shot in enumerate(shots[1:], 1):
        rules = [snapshot.step.rule if snapshot.step else "" for snapshot in shots[index : index + 2]]
        merges = rules == ["source swap", "merge"]
        shown = _before_merging(shots[index - 1], shot) if merges else shot
        sketch = _SnapshotSketch(drawn, reduced, port, shown, seen, source).sketch()
        source = sketch.source
        seen = {node.key for node in sketch.nodes}
        if merges:  # elements on the merged junction are not new there
            ((leaf, into),) = [(leaf, into) for leaf in shot.gone for into in shot.changed]
            seen |= {f"{into}/{key.partition('/')[2]}" for key in seen if key.startswith(f"{leaf}/")}
        strip.append(sketch)
    return strip


def _before_merging(before: Snapshot, after: Snapshot) -> Snapshot:
    """Return a source swap as drawn: the swapped junction beside the one with which `after` merges it."""
    (leaf,), (into,) = after.gone, after.changed
    old, new = before.junctions[into], after.junctions[into]
    kept = tuple(term for term in new.terms if term in old.terms)
    swapped = replace(
        new,
        nodes=before.junctions[leaf].nodes,
        terms=tuple(term for term in new.terms if term not in old.terms),
        drives={name: amount for name, amount in new.drives.items() if name not in old.drives},
    )
    junctions = after.junctions | {into: replace(new, terms=kept, drives=old.drives), leaf: swapped}
    bond = [link for link in before.links if {link.tail, link.head} == {leaf, into}]
    return replace(after, junctions=junctions, links=(*bond, *after.links), changed=(leaf,), gone=())


class _SnapshotSketch:
    def __init__(
        self,
        drawn: DrawnGraph,
        reduced: ReducedGraph,
        port: Port,
        shot: Snapshot,
        before: set[str],
        source: str | None = None,
    ) -> None:
        self.drawn, self.shot, self.before, self.source = drawn, shot, before, source
        self.junctions, self.program = reduced.structure.junctions, reduced.program
        self.labels = reduced.reductions[port].labels
        self.nodes: dict[str, SketchNode] = {}
        self.kinds: dict[str, str] = {}
        self.bonds: list[SketchBond] = []
        self.reduced: dict[str, Register] = {}  # immittances that steps created, by node

    def sketch(self) -> Sketch:
        """Return the sketch, with causal strokes where every coupling is a bond."""
        for name, state in self.shot.junctions.items():
            domains_of_nodes = {self.drawn.domains.get(node, "") for node in state.nodes}
            lines = (TextLine(state.kind, "glyph"), TextLine(", ".join(state.nodes) or name, "note"))
            domain = domains_of_nodes.pop() if len(domains_of_nodes) == 1 else ""
            self._add(SketchNode(name, lines, domain), state.kind)
        for tie in self.shot.links:
            tail, head = (tie.head, tie.tail) if self._is_negative(tie.forward) else (tie.tail, tie.head)
            two_port, domains = tie.two_port, [self.nodes[end].domain for end in (tail, head)]
            if two_port is None:
                domain = domains[0] or domains[1]
                self.bonds.append(SketchBond(tail, head, domain=domain, equation_only=not tie.drawn))
                continue
            node = self.drawn.graph.nodes[two_port]
            self._add(_sketch_node(node, self.drawn.domains.get(two_port, ""), False, ()), node.type)
            self.bonds.append(SketchBond(tail, two_port, domain=domains[0]))
            self.bonds.append(SketchBond(two_port, head, domain=domains[1]))
        for name in self.shot.junctions:
            self._add_elements(name)
        if not any(bond.equation_only for bond in self.bonds):
            strokes = Strokes(self.kinds, [(bond.tail, bond.head) for bond in self.bonds])
            one_ports = [key for key, kind in self.kinds.items() if kind in ONE_PORTS]
            at_head = run_scap(strokes, one_ports).strokes.at_head
            ends_of = ("" if value is None else "head" if value else "tail" for value in at_head)
            self.bonds = [replace(b, stroke=end) for b, end in zip(self.bonds, ends_of, strict=True)]
        self._name_by_causality()
        fresh = {key for key in self.nodes if self.before and key not in self.before}
        touched = set(self.shot.changed) or set(self.shot.step.nodes if self.shot.step else ())
        marked = fresh or touched
        nodes = tuple(replace(node, changed=node.key in marked) for node in self.nodes.values())
        # The source on the left stays there, or the one that replaces it: panels are laid out alike.
        sources = [key for key, kind in self.kinds.items() if kind in SOURCES]
        source = min(sources, key=lambda key: (key != self.source, key not in fresh), default=None)
        target = next((node.key for node in nodes if node.role in ("output", "both")), None)
        return Sketch(nodes, tuple(self.bonds), source, target)

    def _is_negative(self, register: int) -> bool:
        """Return True if a coefficient is negative: power is then counted in the other direction."""
        op, value, _ = self.program.ops[register]
        return op is Operation.NEG or (op is Operation.CONSTANT and value < 0)

    def _add(self, node: SketchNode, kind: str) -> None:
        self.nodes[node.key], self.kinds[node.key] = node, kind

    def _add_elements(self, name: str) -> None:
        """Add the sources that drive a junction, its elements and reduced immittances."""
        state, domain = self.shot.junctions[name], self.nodes[name].domain
        feeding, fixing = ("Sf", "Se") if state.kind == "0" else ("Se", "Sf")
        driving = [(source, feeding) for source in state.drives]
        fixed = self.junctions[name].fixing
        if fixed is not None and self.shot.known is not None and name == self.shot.root:
            driving.append((fixed, fixing))
        for source, kind in driving:
            is_input = source in self.drawn.inputs
            notes = (TextLine("input", "note"),) if is_input else ()
            key = source
            if source in self.nodes:  # a source that drives several junctions
                key, notes = f"{name}/{source}", (*notes, TextLine(f"at {name}", "note"))
            lines = (TextLine(f"{kind} : {source}"), *notes)
            self._add(SketchNode(key, lines, domain, "input" if is_input else ""), kind)
            ends = (name, key) if self._is_negative(state.drives.get(source, 0)) else (key, name)
            self.bonds.append(SketchBond(*ends, domain=domain))
        for term in state.terms:
            title = state.titles[term]
            element = self.drawn.graph.nodes.get(term.name)
            if element is not None and element.type in ONE_PORTS:
                outputs = [port.quantity for port in self.drawn.outputs if port.node == term.name]
                node = _sketch_node(element, self.drawn.domains.get(term.name, ""), False, outputs)
                self._add(node, element.type)
            else:
                what = "impedance" if state.kind == "1" else "admittance"
                node = SketchNode(f"{name}/{title}", (TextLine(title), TextLine(what, "note")), domain)
                self.reduced[node.key] = term.register
                self._add(node, "R")
            self.bonds.append(SketchBond(name, node.key, domain=domain))

    def _name_by_causality(self) -> None:
        """Name immittances that steps created by their strokes: one that determines effort is an impedance.

        On a 1-junction the program has impedances, on a 0-junction admittances; under the opposite causality
        the inverse is named, as in the equations of the steps.
        """
        for bond in self.bonds:
            register = self.reduced.get(bond.head)
            impedance = bond.stroke == "tail"
            if register is None or not bond.stroke or impedance is (self.kinds[bond.tail] == "1"):
                continue
            letter, what = ("Z", "impedance") if impedance else ("Y", "admittance")
            shown = self.nodes[bond.head].lines[0].text
            created = register not in self.labels and shown[:2] in ("Z_", "Y_")
            inverse = f"{letter}_{shown[2:]}" if created else f"1/{shown}"
            label = self.labels.get(self.program.inv(register), inverse)
            lines = (TextLine(label), TextLine(what, "note"))
            self.nodes[bond.head] = replace(self.nodes[bond.head], lines=lines)
