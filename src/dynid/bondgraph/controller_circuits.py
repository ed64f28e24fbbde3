"""Feedback as part of a bond graph: a controller is a circuit of integrators and activated bonds.

A source that a loop drives becomes a junction; what the controller gives enters its balance. The closed loop
is then a bond graph like any other one, with exact zeros, poles, formulas, state equations and responses.
The states of a controller are flows of unit inertias (an analogue computer).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise, zip_longest
from math import factorial
from typing import NamedTuple

from dynid.arithmetic.dependent import Dependent, Real
from dynid.arithmetic.ldl import reference
from dynid.bondgraph.graph import (
    ACTIVATED,
    JUNCTIONS,
    Bond,
    BondGraph,
    Node,
    NodeType,
    Port,
    Quantity,
    bond_sign,
)
from dynid.bondgraph.reduction.junctions import unique
from dynid.errors import UsageError

Polynomial = Sequence[Real]


@dataclass(frozen=True)
class Sampling:
    """A sampled controller: it measures every `period`, and holds its answer after `computation`, both s."""

    period: Real
    computation: Real = Fraction(0)
    method: str = "tustin"  # its discrete form (`analysis_request.Discretisation`)


class Limits(NamedTuple):
    """Limits of what a controller gives, and the time constant of its anti-windup, s; 0: it has none.

    By back-calculation (Åström and Hägglund 1995, 3.5) its answer a has the integral of
    (limited a - a)/tracking added: beyond the limits an integrating controller follows what it can give.
    """

    low: Fraction
    high: Fraction
    tracking: Fraction


@dataclass(frozen=True)
class Loop:
    """A feedback: the source gives reference + controller · (setpoint - what is measured)."""

    measured: Port  # the variable that is measured
    source: str  # the source that is driven
    #: numerator, denominator: The controller, a rational function of s: coefficients in descending powers.
    numerator: Polynomial
    denominator: Polynomial
    reference: str = ""  # name of the reference, a source of the closed loop; empty: zero
    delay: Real = Fraction(0)  # delay of the controller's answer, s
    place: str = ""  # where the loop stands in a scene, as `control.loops.0`
    #: Name of the setpoint, a source of the closed loop ahead of the controller; empty: zero.
    setpoint: str = ""
    #: Of a sampled controller; None: it is continuous.
    sampling: Sampling | None = None
    line: str = ""  # the line that it is a direction of; empty: it is a feedback
    limits: Limits | None = None  # of its answer, in time responses that are not linear

    @property
    def delayed(self) -> bool:
        """True if it has a delay."""
        return bool(reference(self.delay)) or isinstance(self.delay, Dependent)

    def at(self, values: Mapping[str, float]) -> Loop:
        """Return it with exact numbers: those at values of the parameters that it depends on."""

        def number(value: Real) -> Real:
            return Fraction(value.at(values).value) if isinstance(value, Dependent) else value

        above, below = ([number(entry) for entry in part] for part in (self.numerator, self.denominator))
        return replace(self, numerator=above, denominator=below, delay=number(self.delay))

    def cut(self, reference: str = "") -> Loop:
        """Return it without an answer; its reference has that name where it had none."""
        numerator, denominator = [Fraction(0)], [Fraction(1)]
        name = self.reference or reference
        return replace(self, numerator=numerator, denominator=denominator, delay=Fraction(0), reference=name)

    def approximated(self) -> Loop:
        """Return it with the Padé approximant of order `PADE_ORDER` for its delay, a sampled one cut."""
        if self.sampling is not None:
            return self.cut()
        if not self.delayed:
            return self
        top, bottom = pade(self.delay, PADE_ORDER)
        numerator, denominator = _product(self.numerator, top), _product(self.denominator, bottom)
        return replace(self, numerator=numerator, denominator=denominator, delay=Fraction(0))


#: The gain that stands for a delay where formulas have its name: no sum of others vanishes with it.
_GENERIC_GAIN = Fraction(104729, 7919)
#: Order of the Padé approximants of delays, in whatever needs a rational function.
PADE_ORDER = 6


def pade(delay: Real, order: int) -> tuple[list[Real], list[Real]]:
    """Return the Padé approximant of exp(-s τ): numerator and denominator, in descending powers.

    It has an error of about (s τ)^(2n+1) (n!)² / ((2n)! (2n+1)!), and the size 1 on the imaginary axis.
    """
    below: list[Real] = []
    power: Real = Fraction(1)
    for k in range(order + 1):
        weight = Fraction(factorial(2 * order - k) * factorial(order), factorial(2 * order) * factorial(k))
        below.append(power * (weight / factorial(order - k)))
        power = power * delay
    above = [-coefficient if k % 2 else coefficient for k, coefficient in enumerate(below)]
    return above[::-1], below[::-1]


def _product(a_coefficients: Polynomial, b_coefficients: Polynomial) -> list[Real]:
    product: list[Real] = [Fraction(0)] * (len(a_coefficients) + len(b_coefficients) - 1)
    for i, a in enumerate(a_coefficients):
        for k, b in enumerate(b_coefficients):
            product[i + k] = product[i + k] + a * b
    return product


@dataclass(frozen=True)
class ClosedLoops:
    """A graph with its loops closed."""

    graph: BondGraph
    variables: dict[Port, Port]  # variables of the driven sources, under the names that they had: ``pump.e``
    #: What the controller of each loop answers to: what is measured, less the setpoint.
    answered: tuple[Port, ...]
    #: By the junction whose flow it is, what is measured by an integral of its own: no state of the graph.
    integrals: dict[str, Port]
    #: Of the loops with delays that are cut: the source that stands for the delayed answer, and the answer.
    delayed: tuple[tuple[str, Port], ...] = ()
    #: Of limited answers: the resistor of effort zero whose flow is that of the port within the limits.
    limited: tuple[tuple[str, Port, Limits], ...] = ()


def close_loops(
    graph: BondGraph,
    loops: Iterable[Loop],
    *,
    cut: bool = False,
    named: bool = False,
    lawful: Container[str] | None = None,
) -> ClosedLoops:
    """Return a graph with feedback; delays are approximated, sampled loops cut, or delays are `cut` out.

    `named`: a delay is a factor of a name of its own, in formulas without numbers. `lawful`: answers are
    limited, and these nodes have laws in place of values.

    Raises `UsageError` if a controller differentiates more than once.
    """
    circuit, loops = Circuit(graph, named=named, lawful=lawful), list(loops)
    for source in dict.fromkeys(loop.source for loop in loops):
        circuit.drive(source)
    exact = cut or named
    answered = tuple(circuit.close(loop if exact else loop.approximated()) for loop in loops)
    closed = BondGraph(circuit.nodes.values(), circuit.bonds)
    parts = circuit.variables, answered, circuit.integrals, tuple(circuit.delayed), tuple(circuit.limited)
    return ClosedLoops(closed, *parts)


class Circuit:
    """The nodes and bonds of a graph to which integrators and activated bonds are added."""

    part = "control"  # of the nodes that are added

    def __init__(
        self, graph: BondGraph, *, named: bool = False, lawful: Container[str] | None = None
    ) -> None:
        self.graph, self.named, self.lawful = graph, named, lawful
        self.limited: list[tuple[str, Port, Limits]] = []
        self.nodes = dict(graph.nodes)
        self.bonds = list(graph.bonds)
        self.driven: dict[str, int] = {}  # by driven source 1 where its arrow points away, else -1
        self.variables: dict[Port, Port] = {}  # of driven sources: where they are now
        self.integrals: dict[str, Port] = {}  # by their junction what they measure
        self.delayed: list[tuple[str, Port]] = []  # sources that stand for delayed answers, and the answers
        self._sensors: dict[tuple[str, str], str] = {}

    def drive(self, source: str) -> None:
        """Make a source a junction that signals feed."""
        node, (bond,) = self.graph.nodes[source], self.graph.bonds_of(source)
        effort = node.type == "Se"
        self.nodes[source] = Node(source, "1" if effort else "0", domain=node.domain)
        link = self._add("0" if effort else "1", f"{source}.link")
        end = self._add("1" if effort else "0", f"{source}.end")
        index = next(k for k, bond_ends in enumerate(self.bonds) if source in bond_ends)
        outward = bond.tail == source
        tail, head = self.bonds[index]
        way = [source, link, end, head] if outward else [tail, end, link, source]
        self.bonds[index : index + 1] = [Bond(*ends) for ends in pairwise(way)]
        self.driven[source] = 1 if outward else -1
        pairs: tuple[tuple[Quantity, Quantity], ...] = (("e", "p"), ("f", "q"))
        variables, others = pairs if effort else pairs[::-1]
        self.variables |= {Port(source, q): Port(link, q, f"{source}.{q}") for q in variables}
        self.variables |= {Port(source, q): Port(end, q, f"{source}.{q}") for q in others}

    def close(self, loop: Loop) -> Port:
        """Add a controller, the reference and the setpoint; return what the controller answers to.

        A delayed answer ends as the flow of a unit resistor; a source, or where delays are `named` an
        activated bond, stands for what it is a delay later.
        """
        kind: NodeType = "Se" if self.graph.nodes[loop.source].type == "Se" else "Sf"
        if loop.reference:
            self.nodes[loop.reference] = Node(loop.reference, kind)
            self._add_source(loop.reference, loop.source)
        answer = self._prompt_answer(loop.source, kind) if reference(loop.delay) else loop.source
        if self.lawful is not None and loop.limits is not None:
            answer = self._limited_answer(loop.source, loop.limits)
        at, scale = self.measure(loop.measured, loop.source)
        answered = self.variables.get(loop.measured, loop.measured)
        if loop.setpoint:
            difference = self.total(f"{loop.source}.difference", [(at, scale)], loop.setpoint)
            at, scale, answered = difference, Fraction(1), Port(difference, "f")
        gains, remainder, monic = _divided(loop.numerator, loop.denominator)
        if len(gains) > 2:
            raise UsageError(
                f"the controller of '{loop.source}' differentiates {len(gains) - 1} times",
                remedy="Add a filter: a denominator of at most one degree less than the numerator.",
                names=[name for name in (loop.place,) if name],
            )
        if any(map(reference, gains[:1])):
            self._feed(at, answer, scale * gains[0])
        if len(gains) > 1:
            self._feed(self._rate(at, loop.source), answer, scale * gains[1])
        states = [self._integrator(f"{loop.source}.x{k}") for k in range(1, len(monic))]
        for state, following in pairwise(states):
            self._activate(following, state, Fraction(1))
        if states:
            self._activate(at, states[-1], Fraction(1))
            for state, coefficient in zip(states[:-1], monic, strict=False):
                self._activate(state, states[-1], -coefficient)
            if reference(monic[-2]):
                damper = self._add("R", f"{states[-1]}_a", monic[-2])
                self.bonds.append(Bond(states[-1], damper))
        for state, coefficient in zip(states, remainder, strict=False):
            self._feed(state, answer, scale * coefficient)
        return answered

    def _prompt_answer(self, source: str, kind: NodeType) -> str:
        """Return the junction of an answer that reaches a driven source a delay later."""
        answer = self._add("1", f"{source}.answer")
        if self.named:
            delayed = self._add(ACTIVATED, f"{source}.delay", -self.driven[source] * _GENERIC_GAIN)
            self.bonds += [Bond(answer, delayed), Bond(delayed, source)]
        else:
            delayed = self._add(kind, f"{source}.delayed")
            self._add_source(delayed, source)
        self.delayed.append((delayed, Port(answer, "f")))
        self.bonds.append(Bond(answer, self._add("R", f"{answer}_R", Fraction(1))))
        self.driven[answer] = 1
        return answer

    def _limited_answer(self, source: str, limits: Limits) -> str:
        """Return the junction of an answer that reaches a driven source within limits."""
        answer, within = self.total(f"{source}.answer", []), self._add("1", f"{source}.limited")
        self.driven[answer] = 1
        law = self._add("R", f"{within}_R", Fraction(1))
        self.bonds.append(Bond(within, law))
        self.limited.append((law, Port(answer, "f"), limits))
        self._activate(within, source, self.driven[source] * Fraction(1))
        if limits.tracking:
            integral, rate = self._integrator(f"{source}.tracking"), 1 / limits.tracking
            for tail, head, gain in (
                (within, integral, rate),
                (answer, integral, -rate),
                (integral, answer, Fraction(1)),
            ):
                self._activate(tail, head, gain)
        return answer

    def measure(self, port: Port, owner: str) -> tuple[str, Real]:
        """Return a junction whose common variable, times a factor, is a variable of the graph."""
        stored = self.graph.is_state(port) and port.node not in (self.lawful or ())
        behind, node = self.graph.behind(port), self.graph.nodes[port.node]
        if port.quantity in "qp" and not stored:
            behind = Port(port.node, "f" if port.quantity == "q" else "e")
        at = self.variables.get(port, port).node
        if node.type not in JUNCTIONS and port not in self.variables:
            kind: NodeType = "0" if behind.quantity == "e" else "1"
            key = (port.node, kind)
            near = [end for bond in self.graph.bonds_of(port.node) for end in bond if end != port.node]
            if len(near) == 1 and self.graph.nodes[near[0]].type == kind:
                self._sensors[key] = near[0]  # its junction has the variable
            if key not in self._sensors:
                self._sensors[key] = sensor = self._add(kind, f"{port.node}.{behind.quantity}_sensor")
                index = next(k for k, bond_ends in enumerate(self.bonds) if port.node in bond_ends)
                bond = self.bonds[index]
                self.bonds[index : index + 1] = [Bond(bond.tail, sensor), Bond(sensor, bond.head)]
            at = self._sensors[key]
        if stored:
            value: Real = node.dependent or self.graph.value(port.node)
            return at, bond_sign(self.graph, port.node) * value
        if port.quantity in "qp":
            state = self._integrator(f"{owner}.{port.quantity}")
            self.integrals[state] = port
            self._activate(at, state, Fraction(1))
            return state, Fraction(1)
        return at, Fraction(1)

    def total(self, preferred: str, terms: Iterable[tuple[str, Real]], less: str = "") -> str:
        """Return a junction whose flow is the sum of common variables times factors, less an input to add."""
        junction = self._add("1", preferred)
        if less:
            self.nodes[less] = Node(less, "Se", part=self.part)
        for at, factor in terms:
            self._activate(at, junction, factor)
        if less:
            self.bonds.append(Bond(junction, less))
        self.bonds.append(Bond(junction, self._add("R", f"{junction}_R", Fraction(1))))
        return junction

    def signal(self, name: str) -> str:
        """Add an input; return a junction whose common variable it is."""
        self.nodes[name] = Node(name, "Se", part=self.part)
        junction = self._add("0", f"{name}.signal")
        self.bonds.append(Bond(name, junction))
        return junction

    def _add_source(self, name: str, driven: str) -> None:
        """Let a source act on the balance of a driven one."""
        ends = (name, driven) if self.driven[driven] > 0 else (driven, name)
        self.bonds.append(Bond(*ends))

    def _feed(self, at: str, source: str, gain: Real) -> None:
        """Let a signal, times minus a gain, enter the balance of a driven source."""
        if reference(gain) or isinstance(gain, Dependent):
            self._activate(at, source, -self.driven[source] * gain)

    def _rate(self, at: str, owner: str) -> str:
        """Return a junction whose common variable is the rate of another one's."""
        copy, rate = self._integrator(f"{owner}.copy"), self._add("1", f"{owner}.rate")
        self._activate(at, rate, Fraction(1))
        self._activate(copy, rate, Fraction(-1))  # its balance: the copy equals what is measured
        self._activate(rate, copy, Fraction(1))
        return rate

    def _integrator(self, preferred: str) -> str:
        """Return a junction whose flow is the integral of the signals that it is fed."""
        junction = self._add("1", preferred)
        self.bonds.append(Bond(junction, self._add("I", f"{junction}_I", Fraction(1))))
        return junction

    def _activate(self, tail: str, head: str, gain: Real) -> None:
        if reference(gain) or isinstance(gain, Dependent):
            name = self._add(ACTIVATED, f"{tail}_to_{head.rpartition('.')[2]}", gain)
            self.bonds += [Bond(tail, name), Bond(name, head)]

    def _add(self, kind: NodeType, preferred: str, value: Real | None = None) -> str:
        name = unique(preferred, self.nodes)
        dependent = value if isinstance(value, Dependent) else None
        exact = None if value is None else reference(value)
        self.nodes[name] = Node(name, kind, exact, None, "", dependent, self.part)
        return name


def _divided(numerator: Polynomial, denominator: Polynomial) -> tuple[list[Real], list[Real], list[Real]]:
    """Divide two polynomials; return quotient, remainder and monic denominator, in ascending powers."""
    top, bottom = _trimmed(numerator), _trimmed(denominator)
    lead = bottom[-1]
    monic = [coefficient / lead for coefficient in bottom]
    rest = [coefficient / lead for coefficient in top]
    quotient: list[Real] = []
    while len(rest) >= len(monic):
        factor = rest[-1]
        quotient.insert(0, factor)
        shift = len(rest) - len(monic)
        lower = [Fraction(0)] * shift + [factor * coefficient for coefficient in monic]
        rest = [a - b for a, b in zip_longest(rest, lower, fillvalue=Fraction(0))][:-1]
    return quotient, rest, monic


def _trimmed(polynomial: Polynomial) -> list[Real]:
    """Return coefficients in ascending powers, without zeros at the end."""
    ascending = list(polynomial)[::-1]
    while len(ascending) > 1 and not reference(ascending[-1]):
        ascending.pop()
    return ascending
