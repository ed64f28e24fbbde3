"""The chain of mass-spring-damper stages, of any length: its bond graph, and its scene.

Mass i is joined to mass i + 1 by a spring in parallel with a damper, the last one to ground. The force
acts on the first mass, the output is the velocity of the last: order 2N, and N zeros, one at 0 and one at
-k/b for every joint that the power passes through.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

from dynid.bondgraph.graph import Bond, BondGraph, Node, Port, no_collection

#: The force on the first mass.
FORCE = "force"
#: The golden section, in millionths.
_GOLDEN, _MILLION = 618_034, 1_000_000


class Stage(NamedTuple):
    """Mass in kg, and the spring (N/m) and damper (N s/m) from it to the next mass, or to ground."""

    mass: Fraction = Fraction(1)
    stiffness: Fraction = Fraction(1000)
    damping: Fraction = Fraction(2)


def uniform(stages: int) -> list[Stage]:
    """Return equal stages of 1 kg, 1000 N/m and 2 N s/m."""
    return [Stage()] * stages


def distinct(stages: int) -> list[Stage]:
    """Return stages whose values are spread evenly over 0.75 to 1.25 times those of `uniform`."""

    def spread(value: Fraction, number: int) -> Fraction:
        half, odd = divmod(number * _GOLDEN % _MILLION, 2)  # rounded half to even
        return Fraction(value.numerator * (750_000 + half + (half & odd)), value.denominator * _MILLION)

    return [
        Stage(*(spread(value, 3 * index + number) for number, value in enumerate(Stage())))
        for index in range(1, stages + 1)
    ]


@no_collection()
def chain(stages: Sequence[Stage]) -> BondGraph:
    """Build the bond graph of a chain.

    Its nodes are `force`, and for stage i the 1-junction `v<i>` with the mass `m<i>`; the spring `k<i>`
    and the damper `b<i>` share the flow of the 1-junction `w<i>`, the rate at which the joint shortens,
    which is tied to the 0-junction `j<i>` that carries its force. Those of the last stage, which ends at
    ground, are on its `v<i>`. The stages go from the force to the ground.
    """
    nodes, bonds = [Node(FORCE, "Se")], [Bond(FORCE, "v1")]
    for index, stage in enumerate(stages, start=1):
        junction = joint = f"v{index}"
        nodes += [Node(junction, "1"), Node(f"m{index}", "I", stage.mass)]
        bonds.append(Bond(junction, f"m{index}"))
        if index < len(stages):
            joint, force = f"w{index}", f"j{index}"
            nodes += [Node(force, "0"), Node(joint, "1")]
            bonds += [Bond(junction, force), Bond(force, f"v{index + 1}"), Bond(force, joint)]
        nodes += [Node(f"k{index}", "C", stage.stiffness**-1), Node(f"b{index}", "R", stage.damping)]
        bonds += [Bond(joint, f"k{index}"), Bond(joint, f"b{index}")]
    return BondGraph(nodes, bonds)


def last_velocity(stages: int) -> Port:
    """Return the velocity of the last mass, the output of a chain."""
    return Port(f"v{stages}", "f")


def chain_scene(stages: int, *, vary: bool = False) -> str:
    """Return the scene of a chain, to the velocity of the last mass; `vary` gives every stage its values."""
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
