"""The bond graph of a result as a drawing: causal strokes, values, domains, the source-load cut."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, cast

from dynid.bondgraph.causality.assign import assign_causality
from dynid.bondgraph.domains import Units
from dynid.bondgraph.graph import JUNCTIONS, SOURCES, TWO_PORTS, Bond, BondGraph, Node, Port
from dynid.report.drawing.domains import ELEMENT_UNITS
from dynid.report.drawing.render import render_sketch
from dynid.report.drawing.sketch import Line, Link, Sketch, Vertex
from dynid.report.figure import Figure, Picture, Table
from dynid.report.numbers import short
from dynid.report.scenes import readable, scene_of
from dynid.scene.schema.chains import chain_ends

if TYPE_CHECKING:
    from dynid.bondgraph.graph import NodeType, Quantity
    from dynid.report.scenes import PlainScene
    from dynid.result import Result

#: Nodes of the largest graph that is drawn: a larger one shows nothing to anybody.
LARGEST = 300


@dataclass(frozen=True)
class Question:
    """A graph and what was asked of it.

    Parameters
    ----------
    graph
        The graph.
    inputs, outputs
        Sources kept as inputs, and the variables asked for.
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


def question_of(result: Result) -> Question:
    """Read the graph of a result, and what was asked of it.

    Raises
    ------
    UsageError
        Where the result does not bear its scene, or the scene cannot be read.
    """
    scene = scene_of(result)
    with readable():
        return _read(scene)


def _read(scene: PlainScene) -> Question:
    analysis = scene.data["analysis"]
    written = {str(name): node for name, node in scene.data["graph"]["nodes"].items()}
    given = {name: node if isinstance(node, dict) else {"type": node} for name, node in written.items()}
    chains = map(chain_ends, scene.data["graph"]["bonds"])
    graph = BondGraph(
        [_node(scene, name, node) for name, node in given.items()],
        [Bond(*ends) for chain in chains for ends in pairwise(chain)],
    )
    if analysis.get("reading") == "binary":
        graph = graph.rounded()
    sources = [name for name, node in graph.nodes.items() if node.type in SOURCES]
    port = analysis.get("port")
    return Question(
        graph,
        tuple(map(str, analysis.get("inputs") or sources)),
        tuple(_port(output) for output in analysis["outputs"]),
        None if port is None else Bond(*chain_ends(port)),
        Units(graph).domains,
    )


def _port(text: str) -> Port:
    node, _, quantity = text.rpartition(".")
    return Port(node, cast("Quantity", quantity))


def _node(scene: PlainScene, name: str, given: dict[str, Any]) -> Node:
    kind, value = cast("NodeType", str(given["type"])), given.get("value")
    domain = str(given.get("domain") or "")
    if value is None:
        return Node(name, kind, domain=domain)
    return Node(name, kind, scene.exact(value), scene.expression(value), domain)


def figures(result: Result) -> Iterator[Figure]:
    """Yield the drawing of a result's bond graph."""
    question = question_of(result)
    if len(question.graph.nodes) <= LARGEST:
        yield Figure("bond-graph", "Bond graph", lambda: _picture(result.title, question))


def _picture(title: str, question: Question) -> Picture:
    sketch = sketch_of(question)
    graph = question.graph
    about = f"{title}: bond graph of {len(graph.nodes)} nodes and {len(graph.bonds)} bonds"
    strokes = {(link.tail, link.head): link.stroke for link in sketch.links}
    rows = [
        (bond.tail, bond.head, {"tail": bond.tail, "head": bond.head}[strokes[bond.tail, bond.head]])
        for bond in graph.bonds
    ]
    caption = (
        "Power is positive along the half arrows; the stroke of a bond is at the end that sets its flow, "
        "effort is imposed towards it."
    )
    table = Table(("from", "to", "effort is imposed towards"), tuple(rows))
    return Picture(render_sketch("bond-graph", f"Bond graph of {title}", about, sketch), caption, table)


def sketch_of(question: Question) -> Sketch:
    """Return the drawing of a graph as a sketch."""
    graph, domains = question.graph, question.domains
    outputs: dict[str, list[str]] = {}
    for port in question.outputs:
        outputs.setdefault(port.node, []).append(port.quantity)
    vertices = tuple(
        vertex_of(node, domains.get(name, ""), name in question.inputs, outputs.get(name, ()))
        for name, node in graph.nodes.items()
    )
    source = next((name for name in question.inputs if graph.bonds_of(name)), None)
    target = next(iter(outputs), None)
    cut = (question.port.tail, question.port.head) if question.port is not None else None
    return Sketch(vertices, tuple(_links(graph, domains)), source, target, cut)


def _links(graph: BondGraph, domains: dict[str, str]) -> Iterator[Link]:
    """Yield the bonds with their strokes; a bond has the domain of its end that is no two-port."""
    for bond in assign_causality(graph).bonds:
        plain = [end for end in (bond.tail, bond.head) if graph.nodes[end].type not in TWO_PORTS]
        domain = next((domains[end] for end in plain if end in domains), "")
        yield Link(bond.tail, bond.head, bond.stroke, domain)


def vertex_of(node: Node, domain: str, is_input: bool, asked: Iterable[str]) -> Vertex:
    """Return a node of a graph with its name, value and unit."""
    quantities = ", ".join(asked)
    notes = [value] if (value := value_text(node, domain)) else []
    notes += ["input"] if is_input else []
    notes += [f"output {quantities}"] if quantities else []
    head: Sequence[Line]
    if node.type in JUNCTIONS:
        head = (Line(node.type, "glyph"), Line(node.name, "note"))
    else:
        head = (Line(f"{node.type} : {node.name}"),)
    role = "both" if is_input and quantities else "input" if is_input else "output" if quantities else ""
    return Vertex(node.name, (*head, *(Line(note, "note") for note in notes)), domain, role)


def value_text(node: Node, domain: str) -> str:
    """Write the value of a node, with its unit where the domain is known."""
    if node.value is None:
        return ""
    number = short(float(node.value))
    if node.type in TWO_PORTS:
        return f"{'n' if node.type == 'TF' else 'r'} = {number}"
    unit = ELEMENT_UNITS.get(domain, {}).get(node.type, "")
    return f"{number} {unit}".rstrip()
