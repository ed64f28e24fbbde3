"""Physical domains of a bond graph, and the SI units that follow from them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cached_property

from dynid.bondgraph.graph import TWO_PORTS, BondGraph, Port

#: SI units by domain: of effort e, flow f, displacement q (the integral of f), momentum p (that of e).
#: `mechanical` is translation; thermal: temperature and heat flow, a pseudo bond graph.
UNITS: dict[str, dict[str, str]] = {
    "mechanical": {"e": "N", "f": "m/s", "q": "m", "p": "N.s"},
    "rotational": {"e": "N.m", "f": "rad/s", "q": "rad", "p": "N.m.s"},
    "electrical": {"e": "V", "f": "A", "q": "A.s", "p": "V.s"},
    "magnetic": {"e": "A", "f": "V", "q": "V.s", "p": "A.s"},
    "hydraulic": {"e": "Pa", "f": "m3/s", "q": "m3", "p": "Pa.s"},
    "acoustic": {"e": "Pa", "f": "m3/s", "q": "m3", "p": "Pa.s"},
    "thermal": {"e": "K", "f": "W", "q": "J", "p": "K.s"},
}
_FACTOR = re.compile(r"([A-Za-z]+)(\d*)")


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


class Units:
    """The units of a graph's variables, as far as domains tell them; else they are empty.

    Parameters
    ----------
    graph
        The graph; its nodes may name their domains.
    """

    def __init__(self, graph: BondGraph) -> None:
        self._graph = graph

    @cached_property
    def domains(self) -> dict[str, str]:
        """The domain of every node that has one for sure."""
        given = {name: node.domain for name, node in self._graph.nodes.items() if node.domain}
        return spread(self._graph, given) if given else {}

    def of(self, node: str, quantity: str) -> str:
        """Return the unit of e, f, q or p at a node."""
        domain = self.domains.get(node, "")
        return UNITS[domain][quantity] if domain else ""

    def of_output(self, port: Port) -> str:
        """Return the unit of an output."""
        return self.of(port.node, port.quantity)

    def of_input(self, source: str) -> str:
        """Return the unit of what a source gives."""
        return self.of(source, "e" if self._graph.nodes[source].type == "Se" else "f")

    def of_channel(self, port: Port, source: str) -> str:
        """Return the unit of output over input; `1` where both have the same."""
        above, below = self.of_output(port), self.of_input(source)
        return quotient(above, below) if above and below else ""


def quotient(above: str, below: str) -> str:
    """Return the unit of a quotient: `m/s` over `N` is `m/(N.s)`; `1` where nothing is left."""
    powers: dict[str, int] = {}
    for text, sign in ((above, 1), (below, -1)):
        for part, way in zip(text.split("/"), (sign, -sign), strict=False):
            for name, power in _FACTOR.findall(part):
                powers[name] = powers.get(name, 0) + way * int(power or 1)
    top = [_power(name, power) for name, power in powers.items() if power > 0]
    under = [_power(name, -power) for name, power in powers.items() if power < 0]
    if not under:
        return ".".join(top) or "1"
    bottom = ".".join(under)
    return f"{'.'.join(top) or '1'}/{f'({bottom})' if len(under) > 1 else bottom}"


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}{power}"
