"""A graph cut in two at a bond: a probing source at either end in place of the bond."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import cast

from dynid.bondgraph.graph import VALUED, Bond, BondGraph, Node, NodeType
from dynid.bondgraph.reduction.junctions import JunctionStructure, unique
from dynid.bondgraph.reduction.network import reach
from dynid.errors import DynidError, UsageError
from dynid.suggestions import did_you_mean

#: Types of a probe: one that fixes the common variable of a junction, one that feeds its balance. Beside
#: anything else than a junction either makes a junction of its own.
_FIXING: dict[str, NodeType] = {"0": "Se", "1": "Sf"}
_FEEDING: dict[str, NodeType] = {"0": "Sf", "1": "Se"}


def bond_fault(types: Mapping[str, str], bonds: Sequence[Bond], port: Bond) -> str:
    """Return the reason why a port is no bond of a graph, written either way, or an empty text."""
    unknown = [name for name in (port.tail, port.head) if name not in types]
    if unknown:
        return "; ".join(f"no node '{name}'{did_you_mean(name, types)}" for name in unknown)
    if _drawn_bond(bonds, port) is not None:
        return ""
    adjacent = [str(bond) for bond in bonds if {port.tail, port.head} & {bond.tail, bond.head}]
    directions = f"{port}", f"{port.head} -> {port.tail}"
    hint = did_you_mean(directions[0], adjacent) or did_you_mean(directions[1], adjacent)
    return f"there is no bond between '{port.tail}' and '{port.head}'{hint}"


def loop_fault(types: Mapping[str, str], bonds: Sequence[Bond], port: Bond) -> str:
    """Return the fault of a bond that lies on a loop, so that cutting it parts nothing, or an empty text.

    `types`, `bonds`, `port`: as for `bond_fault`; where the graph has other faults, which are reported
    elsewhere, there is none.
    """
    nodes = [
        Node(name, cast("NodeType", kind), Fraction(1) if kind in VALUED else None)
        for name, kind in types.items()
    ]
    try:
        GraphBisection.at(BondGraph(nodes, bonds), port)
    except BondOnLoop as fault:
        return str(fault)
    except DynidError:
        return ""
    return ""


def _drawn_bond(bonds: Iterable[Bond], port: Bond) -> Bond | None:
    """Return the bond of a graph that a port names, as it is written or else the other way round."""
    between = [bond for bond in bonds if {bond.tail, bond.head} == {port.tail, port.head}]
    return next((bond for bond in between if bond == port), between[0] if between else None)


class BondOnLoop(UsageError):
    """A bond lies on a loop, so that cutting it parts nothing."""


@dataclass(frozen=True)
class GraphBisection:
    """A port whose bond is cut.

    Raises `UsageError` where the graph has no such bond, or (`BondOnLoop`) the cut does not part it: power
    also passes the other way, and neither side has an impedance of its own. (A loop through a junction whose
    common variable an ideal source fixes is none in this sense: nothing passes such a junction.)
    """

    graph: BondGraph
    port: Bond  # the bond, written from the source to the load
    drawn: Bond  # the same bond as the graph has it

    @classmethod
    def at(cls, graph: BondGraph, port: Bond) -> GraphBisection:
        """Cut a graph at a bond."""
        types = {name: node.type for name, node in graph.nodes.items()}
        problem = bond_fault(types, graph.bonds, port)
        drawn = _drawn_bond(graph.bonds, port)
        if drawn is None:
            raise UsageError(problem, names=("analysis.port",))
        cut = cls(graph, port, drawn)
        structure = cut.structure({})
        here, there = (structure.place[cut.probe(end)] for end in (port.tail, port.head))
        if structure.junctions[here].fixing is None and there in reach(structure, here):
            raise BondOnLoop(
                f"the bond '{port}' lies on a loop: without it both ends are still connected, power also "
                "goes round the other way, and neither side has an impedance of its own",
                remedy="Name a bond that lies on no loop.",
                names=("analysis.port",),
            )
        return cut

    def probe(self, end: str) -> str:
        """Return the name of the probing source that stands at an end in place of the other one."""
        return unique(f"port_{end}", self.graph.nodes)

    def points_out(self, end: str) -> bool:
        """Test whether the bond as drawn leaves this end."""
        return self.drawn.tail == end

    def probe_types(self, end: str) -> tuple[NodeType, ...]:
        """Return the sources to probe a side with: first one that leaves the junction at the port bare."""
        kind = self.graph.nodes[end].type
        if kind in _FIXING:
            return _FIXING[kind], _FEEDING[kind]
        return ("Sf", "Se")

    def structure(self, probes: Mapping[str, NodeType]) -> JunctionStructure:
        """Return the junction structure of the cut graph.

        `probes`: the type of the probe at an end; default: one that fixes nothing.
        """
        ends = (self.port.tail, self.port.head)
        nodes = list(self.graph.nodes.values())
        for end in ends:
            kind = self.graph.nodes[end].type
            neutral: NodeType = "Se" if kind == "Sf" else "Sf" if kind == "Se" else _FEEDING.get(kind, "Sf")
            nodes.append(Node(self.probe(end), probes.get(end, neutral)))
        bonds = [bond for bond in self.graph.bonds if bond is not self.drawn]
        bonds += [Bond(self.drawn.tail, self.probe(self.drawn.tail))]
        bonds += [Bond(self.probe(self.drawn.head), self.drawn.head)]
        return JunctionStructure(BondGraph(nodes, bonds))
