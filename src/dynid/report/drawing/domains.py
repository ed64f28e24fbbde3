"""Physical domains: their colours, and the units of elements in them."""

from __future__ import annotations

from collections.abc import Mapping

from dynid.bondgraph.graph import TWO_PORTS, BondGraph

#: The colour of every domain, one of `style.SERIES`.
COLOUR = {
    "mechanical": "s1",
    "electrical": "s2",
    "hydraulic": "s3",
    "acoustic": "s4",
    "thermal": "s5",
    "rotational": "s6",
    "magnetic": "s7",
}
#: SI units of inertia, compliance and resistance (thermal: temperature and heat flow, a pseudo bond graph).
UNITS = {
    "mechanical": {"I": "kg", "C": "m/N", "R": "N·s/m"},
    "rotational": {"I": "kg·m²", "C": "rad/(N·m)", "R": "N·m·s/rad"},
    "electrical": {"I": "H", "C": "F", "R": "Ω"},
    "magnetic": {"C": "H", "R": "1/Ω"},
    "hydraulic": {"I": "kg/m⁴", "C": "m³/Pa", "R": "Pa·s/m³"},
    "acoustic": {"I": "kg/m⁴", "C": "m³/Pa", "R": "Pa·s/m³"},
    "thermal": {"C": "J/K", "R": "K/W"},
}


def spread(graph: BondGraph, given: Mapping[str, str]) -> dict[str, str]:
    """Return the domain of every node that has one for sure.

    A bond joins nodes of one domain; only a TF or GY may stand between two. It has a domain itself where both
    of its sides have the same.

    Parameters
    ----------
    graph
        The graph.
    given
        The domains of some nodes.
    """
    known = dict(given)
    queue = list(given)
    for name in queue:
        for bond in graph.bonds_of(name):
            other = bond.head if bond.tail == name else bond.tail
            if other not in known and graph.nodes[other].type not in TWO_PORTS:
                known[other] = known[name]
                queue.append(other)
    for name, node in graph.nodes.items():
        if node.type in TWO_PORTS:
            ends = {end for bond in graph.bonds_of(name) for end in (bond.tail, bond.head)} - {name}
            sides = {known.get(end, "") for end in ends}
            if len(sides) == 1 and "" not in sides:
                known[name] = sides.pop()
    return known
