"""Laws of the nodes of a graph, and its linearisation at the operating point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal, cast

from dynid.arithmetic.expression import parse
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.operating_point.element_laws import Law, LawGraph
from dynid.bondgraph.operating_point.equilibrium import OperatingPointRequest, find_operating_point
from dynid.bondgraph.operating_point.linearisation import Linearisation, linearised
from dynid.scene.schema.laws import OperatingPointModel, variables_of
from dynid.scene.schema.quantities import Quantity
from dynid.scene.schema.raw import law_variable

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import GraphModel, NodeModel

_Gives = Literal["e", "f", "value"]


def law_variables(scene: Scene, graph: GraphModel, point: OperatingPointModel | None) -> list[Port]:
    """Return the variables in laws and in the operating point."""
    ports = [port for law in laws_of(scene, graph).values() for port in law.ports]
    if point is not None:
        ports += [
            _port(name) for values in (point.values, point.start, point.search.ranges) for name in values
        ]
    return ports


def laws_of(scene: Scene, graph: GraphModel) -> dict[str, Law]:
    """Return the laws of the nodes of a graph."""
    laws: dict[str, Law] = {}
    names = scene.names
    for name, node in graph.nodes.items():
        if law := _law_of(node):
            gives, text = law
            expression = parse(text)
            variable = law_variable(node.type, gives)
            variables = {variable: Port(name, variable)} if variable in expression.names else {}  # type: ignore[arg-type]
            variables |= {
                key: port for key, port in variables_of(expression, names.nodes).items() if key != variable
            }
            constants = {
                key: names.parameters[key] for key in expression.names - variables.keys() if key != "pi"
            }
            laws[name] = Law(gives, expression, constants, variables)
    return laws


def _law_of(node: NodeModel) -> tuple[_Gives, str] | None:
    """Return what the law of a node gives, and its text; None of a node that has a value."""
    if node.law is not None:
        return ("e", node.law.e) if node.law.e is not None else ("f", cast("str", node.law.f))
    if node.value is not None and node.value.variable:
        assert node.value.expression is not None
        return "value", node.value.expression.text
    return None


def linear_graph(
    graph: BondGraph,
    laws: Mapping[str, Law],
    point: OperatingPointModel | None,
    variables: Mapping[str, Port],
) -> Linearisation:
    """Return a graph with laws, linearised at its operating point.

    Without a point it is the equilibrium with all sources zero. `variables` are those at ports of fields and
    structures, which have other names in the graph. Raises `NumericalError` where there is no equilibrium, or
    a law has no slope there.
    """

    def ports(values: Mapping[str, Quantity]) -> dict[Port, Quantity]:
        return {variables.get(name, _port(name)): value for name, value in values.items()}

    laws_of_variables = {
        name: Law(
            law.gives,
            law.expression,
            law.constants,
            {key: variables.get(str(port), port) for key, port in law.variables.items()},
        )
        for name, law in laws.items()
    }
    point = point or OperatingPointModel()
    request = OperatingPointRequest(
        inputs={name: value.exact for name, value in point.inputs.items()},
        values={port: value.exact for port, value in ports(point.values).items()},
        start={port: value.exact for port, value in ports(point.start).items()},
        starts=point.search.starts,
        seed=point.search.seed,
        ranges={
            variables.get(name, _port(name)): (float(low), float(high))
            for name, (low, high) in point.search.ranges.items()
        },
        choose=point.choose,
    )
    return linearised(find_operating_point(LawGraph(graph, laws_of_variables), request))


def _port(name: str) -> Port:
    node, _, quantity = name.rpartition(".")
    return Port(node, quantity)  # type: ignore[arg-type]
