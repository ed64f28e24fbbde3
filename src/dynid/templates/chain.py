"""The scene of a chain of mass-spring-damper stages, of any length."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from dynid.bondgraph.chains import FORCE, Stage, chain, distinct, last_velocity, uniform
from dynid.bondgraph.graph import Node


def chain_scene(stages: int, *, vary: bool = False) -> str:
    """Write the scene of a chain, force in at the first mass, velocity out at the last.

    Parameters
    ----------
    stages
        Number of stages.
    vary
        Whether every stage has values of its own.
    """
    return "\n".join([*_head(stages), *_graph(distinct(stages) if vary else uniform(stages)), *_tail(stages)])


def _head(stages: int) -> Iterator[str]:
    yield f"# A chain of {stages} mass-spring-damper stages. Run it with: dynid run THIS_FILE"
    yield "# Force on mass 1; spring k<i> and damper b<i> join mass i to the next, the last to ground."
    yield "# It has 2N poles and N zeros: one at 0, the others at -k/b of the joints passed."
    yield "dynid: 1"
    yield "kind: bond-graph"
    yield f"title: Chain of {stages} mass-spring-damper stages"


def _graph(stages: Sequence[Stage]) -> Iterator[str]:
    graph = chain(stages)
    yield "graph:"
    yield "  nodes:                      # m in kg, k is a compliance in m/N (1/stiffness), b in N s/m"
    yield from (f"    {_node(node)}" for node in graph.nodes.values())
    yield "  bonds:"
    yield from (f"    - {bond}" for bond in graph.bonds)


def _node(node: Node) -> str:
    if node.value is None:
        return f"{node.name}: {node.type}"
    value = f"1/{float(1 / node.value)!r}" if node.type == "C" else repr(float(node.value))
    return f"{node.name}: {{type: {node.type}, value: {value}}}"


def _tail(stages: int) -> Iterator[str]:
    exact = "transfer_function, zeros, poles, " if stages <= 100 else ""
    yield "analysis:"
    yield f"  inputs: [{FORCE}]"
    yield f"  outputs: [{last_velocity(stages)}]"
    yield f"  results: [{exact}frequency_response]"
    yield "  frequency: {start: 0.01, stop: 100, points: 1000, scale: log}   # rad/s"
    yield ""
