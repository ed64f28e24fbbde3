"""The bond graph of a result as a drawing: causal strokes, values, domains, the source-load cut."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, cast

from dynid.bondgraph.causality.scap import assign_causality
from dynid.bondgraph.graph import JUNCTIONS, SOURCES, TWO_PORTS, Bond, BondGraph, GraphUnits, Node, Port
from dynid.report.drawing.render import render_sketch
from dynid.report.drawing.sketch import ELEMENT_UNITS, Sketch, SketchBond, SketchNode, TextLine
from dynid.report.figure import Figure, FigureTable, Picture
from dynid.report.labels import short
from dynid.report.scenes import readable, scene_of
from dynid.scene.schema.raw import chain_ends

if TYPE_CHECKING:
    from dynid.bondgraph.graph import NodeType, Quantity
    from dynid.result import Result

#: Most nodes of a graph that is drawn; a larger drawing is unreadable.
LARGEST = 300


@dataclass(frozen=True)
class DrawnGraph:
    """The bond graph of a result with the request of its analysis.

    Parameters
    ----------
    graph
        The graph.
    inputs, outputs
        Sources that are inputs, and requested variables.
    port
        The bond of the source-load decomposition, if any, from the source side to the load side.
    domains
        The physical domain of every node that has one.
    """

    graph: BondGraph
    inputs: tuple[str, ...]
    outputs: tuple[Port, ...]
    port: Bond | None
    domains: dict[str, str]


def drawn_graph(result: Result) -> DrawnGraph:
    """Return the graph of a result, read from its scene.

    Raises
    ------
    UsageError
        Where the result does not hold its scene, or the scene cannot be read.
    """
    scene = scene_of(result)
    with readable():
        analysis = scene.data["analysis"]
        nodes = []
        for name, raw in scene.data["graph"]["nodes"].items():
            given = raw if isinstance(raw, dict) else {"type": raw}
            kind, value = cast("NodeType", str(given["type"])), given.get("value")
            exact, formula = (None, None) if value is None else (scene.exact(value), scene.expression(value))
            nodes.append(Node(str(name), kind, exact, formula, str(given.get("domain") or "")))
        chains = map(chain_ends, scene.data["graph"]["bonds"])
        graph = BondGraph(nodes, [Bond(*ends) for chain in chains for ends in pairwise(chain)])
        if analysis.get("reading") == "binary":
            graph = graph.rounded()
        sources = [name for name, node in graph.nodes.items() if node.type in SOURCES]
        outputs = []
        for text in analysis["outputs"]:
            node, _, quantity = text.rpartition(".")
            outputs.append(Port(node, cast("Quantity", quantity)))
        port = analysis.get("port")
        return DrawnGraph(
            graph,
            tuple(map(str, analysis.get("inputs") or sources)),
            tuple(outputs),
            None if port is None else Bond(*chain_ends(port)),
            GraphUnits(graph).domains,
        )


def figures(result: Result) -> Iterator[Figure]:
    """Yield the drawing of a result's bond graph."""
    drawn = drawn_graph(result)
    if len(drawn.graph.nodes) <= LARGEST:
        yield Figure("bond-graph", "Bond graph", lambda: _picture(result.title, drawn))


def _picture(title: str, drawn: DrawnGraph) -> Picture:
    sketch, graph = sketch_of(drawn), drawn.graph
    about = f"{title}: bond graph of {len(graph.nodes)} nodes and {len(graph.bonds)} bonds"
    strokes = {(bond.tail, bond.head): bond.stroke for bond in sketch.bonds}
    rows = [
        (bond.tail, bond.head, {"tail": bond.tail, "head": bond.head}[strokes[bond.tail, bond.head]])
        for bond in graph.bonds
    ]
    caption = (
        "Power is positive along the half arrows. The causal stroke of a bond is at the end that receives "
        "the effort and determines the flow."
    )
    table = FigureTable(("from", "to", "effort is imposed on"), tuple(rows))
    return Picture(render_sketch("bond-graph", f"Bond graph of {title}", about, sketch), caption, table)


def sketch_of(drawn: DrawnGraph) -> Sketch:
    """Return the sketch of a graph; a bond has the domain of its end that is no two-port."""
    graph, domains = drawn.graph, drawn.domains
    outputs: dict[str, list[str]] = {}
    for port in drawn.outputs:
        outputs.setdefault(port.node, []).append(port.quantity)
    nodes = tuple(
        sketch_node(node, domains.get(name, ""), name in drawn.inputs, outputs.get(name, ()))
        for name, node in graph.nodes.items()
    )
    bonds = []
    for bond in assign_causality(graph).bonds:
        plain = [end for end in (bond.tail, bond.head) if graph.nodes[end].type not in TWO_PORTS]
        domain = next((domains[end] for end in plain if end in domains), "")
        bonds.append(SketchBond(bond.tail, bond.head, bond.stroke, domain))
    source = next((name for name in drawn.inputs if graph.bonds_of(name)), None)
    cut = (drawn.port.tail, drawn.port.head) if drawn.port is not None else None
    return Sketch(nodes, tuple(bonds), source, next(iter(outputs), None), cut)


def sketch_node(node: Node, domain: str, is_input: bool, outputs: Iterable[str]) -> SketchNode:
    """Return a node of a graph with its name, its value with unit, and its quantities that are outputs."""
    notes = []
    if node.value is not None:
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
