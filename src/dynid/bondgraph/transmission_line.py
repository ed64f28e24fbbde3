"""Lossless lines (pipes, shafts, cables) in bond graphs: a two-port of two delays, after Bergeron.

With the power into its first and out of its second end, e1 = Z f1 + E1 and e2 = E2 - Z f2, where
E2(t) = (e1 + Z f1)(t - T) and E1(t) = (e2 - Z f2)(t - T) are what arrives from the other end (Dommel 1969). A
line is a resistance and a source at each end, and a loop with a delay from either end to the other.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from fractions import Fraction
from typing import NamedTuple

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.ldl import reference
from dynid.bondgraph.controller_circuits import Loop
from dynid.bondgraph.graph import ACTIVATED, Bond, BondGraph, Node, NodeType, Port
from dynid.bondgraph.reduction.junctions import unique


class _ExpandedLine(NamedTuple):
    """The nodes and bonds that a line stands for, and its loops."""

    nodes: list[Node]
    bonds: list[Bond]
    loops: list[Loop]
    ends: tuple[str, str]  # the junctions that bonds of the line attach to: in, out


def expand_line(
    name: str, impedance: Real, delay: Real, domain: str, names: Collection[str]
) -> _ExpandedLine:
    """Return what a line of a characteristic impedance and a delay, s, stands for."""
    nodes, bonds, used = list[Node](), list[Bond](), set(names)

    def add(kind: NodeType, preferred: str, value: Real | None = None) -> str:
        node = unique(f"{name}.{preferred}", used)
        used.add(node)
        dependent = value if isinstance(value, Dependent) else None
        exact = None if value is None else reference(value)
        nodes.append(Node(node, kind, exact, None, domain, dependent, name))
        return node

    ends, arrivals, waves = list[str](), list[str](), list[str]()
    for end, direction in (("1", 1), ("2", -1)):
        junction, resistance = add("1", f"end{end}"), add("R", f"R{end}", impedance)
        node, arriving = add("0", f"node{end}"), add("Se", f"E{end}")
        inward = direction > 0
        bonds += [Bond(junction, resistance)]
        bonds += [Bond(junction, node), Bond(node, arriving)] if inward else [
            Bond(arriving, node), Bond(node, junction)
        ]  # fmt: skip
        wave = add("1", f"wave{end}")  # its flow is what leaves this end: E + 2 Z f, or E - 2 Z f
        bonds.append(Bond(wave, add("R", f"wave{end}_R", Fraction(1))))
        for at, gain in ((node, Fraction(1)), (junction, 2 * direction * impedance)):
            signal = add(ACTIVATED, f"{at.rpartition('.')[2]}_to_wave{end}", gain)
            bonds += [Bond(at, signal), Bond(signal, wave)]
        ends.append(junction)
        arrivals.append(arriving)
        waves.append(wave)
    loops = [
        Loop(Port(wave, "f"), arriving, [Fraction(-1)], [Fraction(1)], delay=delay, line=name)
        for wave, arriving in zip(waves, arrivals[::-1], strict=True)
    ]
    return _ExpandedLine(nodes, bonds, loops, (ends[0], ends[1]))


def lines_as_circuits(graph: BondGraph, lines: Iterable[str]) -> BondGraph:
    """Return a graph with each of its lines as a T of impedances, Z tanh(s T/2), Z/sinh(s T), Z tanh(s T/2).

    They are resistances by name: the graph is one of formulas without numbers.
    """
    nodes, bonds = dict(graph.nodes), list(graph.bonds)
    for line in lines:
        inside = {name: node for name, node in nodes.items() if node.part == line}
        (entry,) = (bond.head for bond in bonds if bond.head in inside and bond.tail not in inside)
        (exit_,) = (bond.tail for bond in bonds if bond.tail in inside and bond.head not in inside)
        bonds = [bond for bond in bonds if not inside.keys() >= set(bond)]
        impedance = next(node for node in inside.values() if node.type == "R")
        nodes = {name: node for name, node in nodes.items() if name not in inside.keys() - {entry, exit_}}

        def add(preferred: str, node: Node) -> str:
            name = unique(f"{node.part}.{preferred}", nodes)  # noqa: B023 (called at once)
            nodes[name] = replace(node, name=name)  # noqa: B023
            return name

        middle = add("middle", replace(nodes[entry], type="0"))
        arms = [add(f"arm{end}", impedance) for end in (1, 2)]
        bonds += [Bond(entry, arms[0]), Bond(entry, middle), Bond(middle, exit_), Bond(exit_, arms[1])]
        bonds.append(Bond(middle, add("across", impedance)))
    return BondGraph(nodes.values(), bonds)
