"""The scene of a chain of mass-spring-damper stages, of any length."""

from __future__ import annotations

from dynid.bondgraph.chains import FORCE, chain, distinct, last_velocity, uniform


def chain_scene(stages: int, *, vary: bool = False) -> str:
    """Return the scene of a chain, from the force on the first mass to the velocity of the last.

    Parameters
    ----------
    stages
        Number of stages.
    vary
        True to give every stage values of its own.
    """
    parts = distinct(stages) if vary else uniform(stages)
    graph, nodes = chain(parts), []
    for node in graph.nodes.values():
        if node.value is None:
            nodes.append(f"    {node.name}: {node.type}")
        else:
            value = f"1/{float(1 / node.value)!r}" if node.type == "C" else repr(float(node.value))
            nodes.append(f"    {node.name}: {{type: {node.type}, value: {value}}}")
    exact = "transfer_function, zeros, poles, " if stages <= 100 else ""
    lines = [
        f"# A chain of {stages} mass-spring-damper stages. Run it with: dynid run THIS_FILE",
        "# Force on mass 1; spring k<i> and damper b<i> join mass i to the next, the last to ground.",
        "# It has 2N poles and N zeros: one at 0, the others at -k/b of the joints passed.",
        "dynid: 1",
        "kind: bond-graph",
        f"title: Chain of {stages} mass-spring-damper stages",
        "graph:",
        "  nodes:                      # m in kg, k is a compliance in m/N (1/stiffness), b in N s/m",
        *nodes,
        "  bonds:",
        *(f"    - {bond}" for bond in graph.bonds),
        "analysis:",
        f"  inputs: [{FORCE}]",
        f"  outputs: [{last_velocity(stages)}]",
        f"  results: [{exact}frequency_response]",
        "  frequency: {start: 0.01, stop: 100, points: 1000, scale: log}   # rad/s",
        "",
    ]
    return "\n".join(lines)
