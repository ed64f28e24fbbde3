"""Reduction strip: one drawing of the graph for every step of its reduction (Park & Kim, Figs. 6 to 8)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from dynid.bondgraph.causality.scap import run_scap
from dynid.bondgraph.causality.strokes import Strokes
from dynid.bondgraph.graph import ONE_PORTS, SOURCES, Port
from dynid.bondgraph.plan import ReducedGraph
from dynid.bondgraph.program.program import Operation, Register
from dynid.bondgraph.reduction.snapshots import Snapshot, snapshots
from dynid.number_format import counted
from dynid.report.drawing.graph import DrawnGraph, drawn_graph, sketch_node, sketch_of
from dynid.report.drawing.render import Panel, draw_panels
from dynid.report.drawing.sketch import Sketch, SketchBond, SketchNode, TextLine
from dynid.report.figure import Figure, FigureTable, Picture
from dynid.report.style import SMALL
from dynid.report.svg import Svg

if TYPE_CHECKING:
    from dynid.result import Result

#: Most steps of a reduction that is drawn.
LONGEST = 60
_DASHED = "couplings that are not bonds: the entries k between two junctions, defined by the equations"


def figures(result: Result) -> Iterator[Figure]:
    """Yield the reduction strip of every output."""
    drawn = drawn_graph(result)
    steps = result["bond_graph/reduction/steps"].data
    for port in drawn.outputs:
        rows = [row for row in steps if row["output"] == str(port)]
        if 0 < len(rows) <= LONGEST:
            draw = partial(_picture, drawn, port, rows)
            yield Figure(f"reduction-{port}", f"Reduction to {port}, step by step", draw)


def _picture(drawn: DrawnGraph, port: Port, rows: list[dict[str, str]]) -> Picture:
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
    table = FigureTable(
        ("step", "rule", "nodes", "equation", "meaning"),
        tuple(
            (number, row["rule"], row["nodes"], row["equation"], row["meaning"])
            for number, row in enumerate(rows, 1)
        ),
    )
    return Picture(svg.render(width, height), caption, table)


def reduction_strip(drawn: DrawnGraph, port: Port) -> list[Sketch]:
    """Return the graph as drawn, then the graph after every step of its reduction to a port."""
    reduced = ReducedGraph(drawn.graph, drawn.inputs, (port,))
    shots = snapshots(reduced.structure, reduced.program, port, reduced.inputs)
    seen = {node.key for node in _SnapshotSketch(drawn, reduced, port, shots[0], set()).sketch().nodes}
    strip = [replace(sketch_of(drawn), cut=None)]
    for place, shot in enumerate(shots[1:], 1):
        rules = [one.step.rule if one.step else "" for one in shots[place : place + 2]]
        merges = rules == ["source swap", "merge"]
        shown = _before_merging(shots[place - 1], shot) if merges else shot
        sketch = _SnapshotSketch(drawn, reduced, port, shown, seen).sketch()
        seen = {node.key for node in sketch.nodes}
        if merges:  # elements on the merged junction are not new there
            ((leaf, into),) = [(leaf, into) for leaf in shot.gone for into in shot.changed]
            seen |= {f"{into}/{key.partition('/')[2]}" for key in seen if key.startswith(f"{leaf}/")}
        strip.append(sketch)
    return strip


def _before_merging(before: Snapshot, after: Snapshot) -> Snapshot:
    """Return a source swap as drawn: the swapped junction beside the one with which it merges.

    Parameters
    ----------
    before
        The graph before the swap.
    after
        The graph after it, in which the two equal junctions are merged.
    """
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
    """Sketch of the graph that is left after a step."""

    def __init__(
        self, drawn: DrawnGraph, reduced: ReducedGraph, port: Port, shot: Snapshot, before: set[str]
    ) -> None:
        self.drawn, self.shot, self.before = drawn, shot, before
        self.junctions, self.program = reduced.structure.junctions, reduced.program
        self.labels = reduced.reductions[port].labels
        self.nodes: dict[str, SketchNode] = {}
        self.kinds: dict[str, str] = {}
        self.bonds: list[SketchBond] = []
        self.reduced: dict[str, Register] = {}  # immittances that steps created, by node

    def sketch(self) -> Sketch:
        """Return the sketch, with causal strokes where every coupling is a bond."""
        for name, state in self.shot.junctions.items():
            found = {self.drawn.domains.get(node, "") for node in state.nodes}
            lines = (TextLine(state.kind, "glyph"), TextLine(", ".join(state.nodes) or name, "note"))
            self._add(SketchNode(name, lines, found.pop() if len(found) == 1 else ""), state.kind)
        for tie in self.shot.links:
            ends = (tie.head, tie.tail) if self._is_negative(tie.forward) else (tie.tail, tie.head)
            self._add_coupling(*ends, tie.two_port, tie.drawn)
        for name in self.shot.junctions:
            self._add_sources(name)
            self._add_terms(name)
        if not any(bond.equation_only for bond in self.bonds):
            strokes = Strokes(self.kinds, [(bond.tail, bond.head) for bond in self.bonds])
            one_ports = [key for key, kind in self.kinds.items() if kind in ONE_PORTS]
            at_head = run_scap(strokes, one_ports).strokes.at_head
            ends_of = ("" if value is None else "head" if value else "tail" for value in at_head)
            self.bonds = [replace(b, stroke=end) for b, end in zip(self.bonds, ends_of, strict=True)]
        self._name_by_causality(self.bonds)
        fresh = {key for key in self.nodes if self.before and key not in self.before}
        touched = set(self.shot.changed) or set(self.shot.step.nodes if self.shot.step else ())
        marked = fresh or touched
        nodes = tuple(replace(node, changed=node.key in marked) for node in self.nodes.values())
        source = next((key for key, kind in self.kinds.items() if kind in SOURCES), None)
        target = next((node.key for node in nodes if node.role in ("output", "both")), None)
        return Sketch(nodes, tuple(self.bonds), source, target)

    def _is_negative(self, register: int) -> bool:
        """Return True if a coefficient is negative: power is then counted in the other direction."""
        op, value, _ = self.program.ops[register]
        return op is Operation.NEG or (op is Operation.CONSTANT and value < 0)

    def _add(self, node: SketchNode, kind: str) -> None:
        self.nodes[node.key], self.kinds[node.key] = node, kind

    def _add_coupling(self, tail: str, head: str, two_port: str | None, drawn: bool) -> None:
        """Add a bond between two junctions, through its two-port if it has one."""
        if two_port is None:
            domain = self.nodes[tail].domain or self.nodes[head].domain
            self.bonds.append(SketchBond(tail, head, domain=domain, equation_only=not drawn))
            return
        node = self.drawn.graph.nodes[two_port]
        self._add(sketch_node(node, self.drawn.domains.get(two_port, ""), False, ()), node.type)
        self.bonds += [
            SketchBond(tail, two_port, domain=self.nodes[tail].domain),
            SketchBond(two_port, head, domain=self.nodes[head].domain),
        ]

    def _add_sources(self, name: str) -> None:
        """Add the sources that drive a junction."""
        state = self.shot.junctions[name]
        feeding, fixing = ("Sf", "Se") if state.kind == "0" else ("Se", "Sf")
        given = [(source, feeding) for source in state.drives]
        fixed = self.junctions[name].fixing
        if fixed is not None and self.shot.known is not None and name == self.shot.root:
            given.append((fixed, fixing))
        for source, kind in given:
            is_input = source in self.drawn.inputs
            notes = (TextLine("input", "note"),) if is_input else ()
            key = source
            if source in self.nodes:  # a source that drives several junctions
                key, notes = f"{name}/{source}", (*notes, TextLine(f"at {name}", "note"))
            domain = self.nodes[name].domain
            lines = (TextLine(f"{kind} : {source}"), *notes)
            self._add(SketchNode(key, lines, domain, "input" if is_input else ""), kind)
            ends = (name, key) if self._is_negative(state.drives.get(source, 0)) else (key, name)
            self.bonds.append(SketchBond(*ends, domain=domain))

    def _add_terms(self, name: str) -> None:
        """Add the elements and reduced immittances on a junction."""
        state, domain = self.shot.junctions[name], self.nodes[name].domain
        for term in state.terms:
            title = state.titles[term]
            element = self.drawn.graph.nodes.get(term.name)
            if element is not None and element.type in ONE_PORTS:
                outputs = [port.quantity for port in self.drawn.outputs if port.node == term.name]
                node = sketch_node(element, self.drawn.domains.get(term.name, ""), False, outputs)
                self._add(node, element.type)
            else:
                what = "impedance" if state.kind == "1" else "admittance"
                node = SketchNode(f"{name}/{title}", (TextLine(title), TextLine(what, "note")), domain)
                self.reduced[node.key] = term.register
                self._add(node, "R")
            self.bonds.append(SketchBond(name, node.key, domain=domain))

    def _name_by_causality(self, bonds: Iterable[SketchBond]) -> None:
        """Name immittances that steps created by their strokes: one that determines effort is an impedance.

        On a 1-junction the program has impedances, on a 0-junction admittances; under the opposite causality
        the inverse is named, as in the equations of the steps.
        """
        for bond in bonds:
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
