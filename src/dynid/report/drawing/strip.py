"""A reduction as a strip of drawings, one a step, as Park & Kim's Figs. 6 to 8."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from dynid.bondgraph.causality.scap import run_scap
from dynid.bondgraph.causality.strokes import Strokes
from dynid.bondgraph.graph import ONE_PORTS, SOURCES, Port
from dynid.bondgraph.reduced import ReducedGraph
from dynid.bondgraph.reduction.program import Op
from dynid.bondgraph.reduction.snapshots import Snapshot, snapshots
from dynid.numerals import counted
from dynid.report.drawing.graph import Question, question_of, sketch_of, vertex_of
from dynid.report.drawing.layout import lay_out
from dynid.report.drawing.panels import Draw, Panel, panels
from dynid.report.drawing.render import draw_sketch
from dynid.report.drawing.sketch import Line, Link, Sketch, Vertex
from dynid.report.figure import Figure, Picture, Table
from dynid.report.svg import Svg

if TYPE_CHECKING:
    from dynid.result import Result

#: Steps of the longest reduction that is drawn.
LONGEST = 60
#: The widest drawing within a strip, px.
WIDEST = 1340.0


def figures(result: Result) -> Iterator[Figure]:
    """Yield the strip of every output's reduction."""
    question = question_of(result)
    steps = result["bond_graph/reduction/steps"].data
    for port in question.outputs:
        rows = [row for row in steps if row["output"] == str(port)]
        if 0 < len(rows) <= LONGEST:
            draw = partial(_picture, question, port, rows)
            yield Figure(f"reduction-{port}", f"Reduction to {port}, step by step", draw)


def _picture(question: Question, port: Port, rows: list[dict[str, str]]) -> Picture:
    sketches = strip_of(question, port)
    title = f"Reduction to {port} in {counted(len(rows), 'step')}"
    name = f"reduction-{port}"
    svg = Svg(name, title, "; ".join(f"{row['rule']}: {row['equation']}" for row in rows))
    shown = [Panel("The graph as drawn", "", "", *drawing(sketches[0]))]
    for number, (row, sketch) in enumerate(zip(rows, sketches[1:], strict=True), 1):
        heading = f"{number}. {row['rule']}: {row['nodes']}"
        shown.append(Panel(heading, row["latex"], row["meaning"], *drawing(sketch)))
    width, height = panels(svg, shown)
    table = Table(
        ("step", "rule", "nodes", "equation", "meaning"),
        tuple(
            (number, row["rule"], row["nodes"], row["equation"], row["meaning"])
            for number, row in enumerate(rows, 1)
        ),
    )
    caption = "Every step keeps what the port of interest sees; what it changed is highlighted."
    return Picture(svg.render(width, height), caption, table)


def drawing(sketch: Sketch) -> tuple[float, float, Draw]:
    """Return a sketch as a panel has it: width, height, and what draws it; a wide one is made smaller."""
    layout = lay_out(sketch)
    frame = layout.frame
    scale = round(min(1.0, WIDEST / (frame.right - frame.left)), 2)

    def draw(svg: Svg, x: float, y: float) -> None:
        draw_sketch(svg, sketch, layout, x - scale * frame.left, y - scale * frame.top, scale)

    return scale * (frame.right - frame.left), scale * (frame.bottom - frame.top), draw


def strip_of(question: Question, port: Port) -> list[Sketch]:
    """Return the graph as drawn, then what is left of it after every step of its reduction."""
    reduced = ReducedGraph(question.graph, question.inputs, (port,))
    shots = snapshots(reduced.structure, reduced.program, port, reduced.inputs)
    first = replace(sketch_of(question), cut=None)
    seen = {vertex.key for vertex in _Left(question, reduced, port, shots[0], set()).sketch().vertices}
    strip = [first]
    for shot in shots[1:]:
        left = _Left(question, reduced, port, shot, seen).sketch()
        seen = {vertex.key for vertex in left.vertices}
        strip.append(left)
    return strip


class _Left:
    """What is left of a graph after a step, as a sketch."""

    def __init__(
        self, question: Question, reduced: ReducedGraph, port: Port, shot: Snapshot, before: set[str]
    ) -> None:
        self.question, self.shot, self.before = question, shot, before
        self.junctions, self.program = reduced.structure.junctions, reduced.program
        self.labels = reduced.reductions[port].labels
        self.vertices: dict[str, Vertex] = {}
        self.kinds: dict[str, str] = {}
        self.links: list[Link] = []

    def sketch(self) -> Sketch:
        """Return the sketch, with causal strokes where every tie is a bond."""
        for name in self.shot.junctions:
            self._junction(name)
        for tie in self.shot.links:
            ends = (tie.head, tie.tail) if self._is_negative(tie.forward) else (tie.tail, tie.head)
            self._tie(*ends, tie.two_port, tie.drawn)
        for name in self.shot.junctions:
            self._sources(name)
            self._terms(name)
        fresh = {key for key in self.vertices if self.before and key not in self.before}
        touched = set(self.shot.changed) or set(self.shot.step.nodes if self.shot.step else ())
        marked = fresh or touched
        vertices = tuple(replace(v, changed=v.key in marked) for v in self.vertices.values())
        source = next((key for key, kind in self.kinds.items() if kind in SOURCES), None)
        target = next((v.key for v in vertices if v.role in ("output", "both")), None)
        return Sketch(vertices, tuple(self._with_strokes()), source, target)

    def _is_negative(self, register: int) -> bool:
        """Tell whether a coefficient has a sign: then power is counted the other way."""
        op, value, _ = self.program.ops[register]
        return op is Op.NEG or (op is Op.CONSTANT and value < 0)

    def _domain(self, nodes: Iterable[str]) -> str:
        found = {self.question.domains.get(node, "") for node in nodes}
        return found.pop() if len(found) == 1 else ""

    def _add(self, vertex: Vertex, kind: str) -> None:
        self.vertices[vertex.key], self.kinds[vertex.key] = vertex, kind

    def _junction(self, name: str) -> None:
        state = self.shot.junctions[name]
        label = ", ".join(state.nodes) or name
        lines = (Line(state.kind, "glyph"), Line(label, "note"))
        self._add(Vertex(name, lines, self._domain(state.nodes)), state.kind)

    def _tie(self, tail: str, head: str, two_port: str | None, drawn: bool) -> None:
        if two_port is None:
            domain = self.vertices[tail].domain or self.vertices[head].domain
            self.links.append(Link(tail, head, domain=domain, equation_only=not drawn))
            return
        node = self.question.graph.nodes[two_port]
        self._add(vertex_of(node, self.question.domains.get(two_port, ""), False, ()), node.type)
        self.links += [
            Link(tail, two_port, domain=self.vertices[tail].domain),
            Link(two_port, head, domain=self.vertices[head].domain),
        ]

    def _sources(self, name: str) -> None:
        state = self.shot.junctions[name]
        feeding = "Sf" if state.kind == "0" else "Se"
        given = [(source, feeding) for source in state.drives]
        fixed = self.junctions[name].fixing
        if fixed is not None and self.shot.known is not None and name == self.shot.root:
            given.append((fixed, "Se" if state.kind == "0" else "Sf"))
        for source, kind in given:
            is_input = source in self.question.inputs
            notes = (Line("input", "note"),) if is_input else ()
            key = source if source not in self.vertices else f"{name}/{source}"
            domain = self.vertices[name].domain
            lines = (Line(f"{kind} : {source}"), *notes)
            self._add(Vertex(key, lines, domain, "input" if is_input else ""), kind)
            ends = (name, key) if self._is_negative(state.drives.get(source, 0)) else (key, name)
            self.links.append(Link(*ends, domain=domain))

    def _terms(self, name: str) -> None:
        domain, kind = self.vertices[name].domain, self.shot.junctions[name].kind
        for term in self.shot.junctions[name].terms:
            node = self.question.graph.nodes.get(term.name)
            if node is not None and node.type in ONE_PORTS:
                asked = [port.quantity for port in self.question.outputs if port.node == term.name]
                vertex, own = (
                    vertex_of(node, self.question.domains.get(term.name, ""), False, asked),
                    node.type,
                )
            else:
                letter, what = ("Z", "impedance") if kind == "1" else ("Y", "admittance")
                label = self.labels.get(term.register, f"{letter}_{term.name}")
                vertex = Vertex(f"{name}/{label}", (Line(label), Line(what, "note")), domain)
                own = "R"
            self._add(vertex, own)
            self.links.append(Link(name, vertex.key, domain=domain))

    def _with_strokes(self) -> list[Link]:
        """Assign causality to what is left; couplings that are no bonds have none."""
        if any(link.equation_only for link in self.links):
            return self.links
        strokes = Strokes(self.kinds, [(link.tail, link.head) for link in self.links])
        one_ports = [key for key, kind in self.kinds.items() if kind in ONE_PORTS]
        at_head = run_scap(strokes, one_ports).strokes.at_head
        ends = ("" if value is None else "head" if value else "tail" for value in at_head)
        return [replace(link, stroke=end) for link, end in zip(self.links, ends, strict=True)]
