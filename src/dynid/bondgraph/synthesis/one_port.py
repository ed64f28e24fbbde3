"""One-ports of elements in series and parallel and of Brune sections, and the bond graphs that they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from dynid.bondgraph.graph import Bond, BondGraph, Node, NodeType

#: The name of the source at the driving point.
SOURCE = "source"
ElementType = Literal["R", "I", "C"]
_DUAL: dict[ElementType, ElementType] = {"I": "C", "C": "I", "R": "R"}


@dataclass(frozen=True)
class Element:
    """An element: impedance R, s I or 1 / (s C)."""

    type: ElementType
    value: Fraction


@dataclass(frozen=True)
class Series:
    """One-ports with a common flow, a 1-junction: their impedances add up."""

    parts: tuple[OnePort, ...]


@dataclass(frozen=True)
class Parallel:
    """One-ports with a common effort, a 0-junction: their admittances add up."""

    parts: tuple[OnePort, ...]


@dataclass(frozen=True)
class BruneSection:
    """Brune's section: two perfectly coupled coils with a capacitor in their common branch, before a load.

    The coils are one inertia I behind an ideal transformer: with flux φ = I (i1 - j / n), the efforts are
    e1 = dφ/dt + v and e2 = (1/n) dφ/dt + v with C dv/dt = i1 - j.
    """

    #: inertia, compliance: I and C, positive.
    inertia: Fraction
    compliance: Fraction
    modulus: Fraction  # n, positive: the inductances are I, I/n² and their mutual inductance I/n
    load: OnePort  # the one-port behind it


OnePort = Element | Series | Parallel | BruneSection


def series(*parts: OnePort) -> OnePort:
    """Return one-ports in series; one alone is itself, and a series within is opened."""
    opened = [inner for port in parts for inner in (port.parts if isinstance(port, Series) else (port,))]
    return opened[0] if len(opened) == 1 else Series(tuple(opened))


def parallel(*parts: OnePort) -> OnePort:
    """Return one-ports in parallel; one alone is itself, and a parallel within is opened."""
    opened = [inner for port in parts for inner in (port.parts if isinstance(port, Parallel) else (port,))]
    return opened[0] if len(opened) == 1 else Parallel(tuple(opened))


def dual(port: OnePort) -> OnePort:
    """Return the one-port whose impedance is the admittance of a one-port without Brune sections."""
    if isinstance(port, Element):
        return Element(_DUAL[port.type], 1 / port.value if port.type == "R" else port.value)
    assert not isinstance(port, BruneSection)
    parts = tuple(map(dual, port.parts))
    return Parallel(parts) if isinstance(port, Series) else Series(parts)


def inverted(port: OnePort) -> OnePort:
    """Return the one-port of Z(1/s) for that of Z(s), without Brune sections."""
    if isinstance(port, Element):
        return port if port.type == "R" else Element(_DUAL[port.type], 1 / port.value)
    assert not isinstance(port, BruneSection)
    parts = tuple(map(inverted, port.parts))
    return Series(parts) if isinstance(port, Series) else Parallel(parts)


def with_values(port: OnePort, change: Callable[[Fraction], Fraction]) -> OnePort:
    """Return the one-port with a function applied to every value."""
    if isinstance(port, Element):
        return Element(port.type, change(port.value))
    if isinstance(port, BruneSection):
        inertia, compliance, modulus = map(change, (port.inertia, port.compliance, port.modulus))
        return BruneSection(inertia, compliance, modulus, with_values(port.load, change))
    parts = tuple(with_values(inner, change) for inner in port.parts)
    return Series(parts) if isinstance(port, Series) else Parallel(parts)


def bond_graph(port: OnePort, driven_by: Literal["Se", "Sf"] = "Sf", domain: str = "") -> BondGraph:
    """Return the bond graph of a one-port at a source.

    Elements and junctions are numbered by type from the source on: I1, I2, C1, …, `series1`, `parallel1`.

    `driven_by`: the type of the source: Sf, whose effort over flow is the impedance; Se, for the admittance.
    `domain`: the physical domain of source and elements; default: none.
    """
    return _ElementGraph(driven_by, domain).drawn(port)


class _ElementGraph:
    """A bond graph in the making."""

    def __init__(self, driven_by: Literal["Se", "Sf"], domain: str) -> None:
        self._domain = domain
        self._nodes = [Node(SOURCE, driven_by, domain=domain)]
        self._bonds: list[Bond] = []
        self._counts: Counter[str] = Counter()

    def drawn(self, port: OnePort) -> BondGraph:
        self._attach(port, SOURCE)
        return BondGraph(self._nodes, self._bonds)

    def _add(self, stem: str, kind: NodeType, value: Fraction | None = None) -> str:
        self._counts[stem] += 1
        name = f"{stem}{self._counts[stem]}"
        self._nodes.append(Node(name, kind, value, domain=self._domain if kind in ("R", "I", "C") else ""))
        return name

    def _attach(self, port: OnePort, behind: str) -> None:
        if isinstance(port, Element):
            self._bonds.append(Bond(behind, self._add(port.type, port.type, port.value)))
        elif isinstance(port, BruneSection):
            entry, coupled = self._add("series", "1"), self._add("parallel", "0")
            coil, transformer = self._add("I", "I", port.inertia), self._add("TF", "TF", port.modulus)
            common, capacitor = self._add("parallel", "0"), self._add("C", "C", port.compliance)
            leaving = self._add("series", "1")
            self._bonds += [Bond(behind, entry), Bond(entry, coupled), Bond(coupled, coil)]
            self._bonds += [Bond(coupled, transformer), Bond(transformer, leaving)]
            self._bonds += [Bond(entry, common), Bond(common, capacitor), Bond(common, leaving)]
            self._attach(port.load, leaving)
        else:
            junction = self._add(*(("series", "1") if isinstance(port, Series) else ("parallel", "0")))
            self._bonds.append(Bond(behind, junction))
            for inner in port.parts:
                self._attach(inner, junction)
