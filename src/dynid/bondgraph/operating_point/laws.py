"""Laws of elements: effort, flow or modulus as an expression of variables of the graph."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from dynid.arithmetic.expression import Expression
from dynid.arithmetic.numbers import Number
from dynid.bondgraph.graph import BondGraph, Port
from dynid.bondgraph.operating_point.gradient import Gradient


@dataclass(frozen=True)
class Law:
    """The law of a node.

    Parameters
    ----------
    gives
        ``e``: effort of an R or C; ``f``: flow of an R or I; ``value``: the resistance of an R, or the
        modulus of a TF or GY. Where the bond leaves the element its effort or flow is minus the law.
    expression
        The law.
    constants
        Values of its parameters.
    variables
        Its variables, by the names that the expression has for them; its own one is that of the node.
    """

    gives: Literal["e", "f", "value"]
    expression: Expression
    constants: Mapping[str, Number]
    variables: Mapping[str, Port]

    def gradient(self, high: bool = False) -> Gradient:
        """Return the law as a function of its variables, in their order."""
        return Gradient(self.expression, self.constants, list(self.variables), high)

    @property
    def ports(self) -> tuple[Port, ...]:
        """The variables, in their order."""
        return tuple(self.variables.values())


@dataclass(frozen=True)
class LawGraph:
    """A graph, some of whose nodes have laws in place of values.

    Parameters
    ----------
    graph
        The graph. The values of nodes with laws have no meaning.
    laws
        The laws, by node.
    """

    graph: BondGraph
    laws: Mapping[str, Law]

    def own(self, name: str) -> Port:
        """Return the variable whose slope is the value of an element with a law."""
        law, kind = self.laws[name], self.graph.nodes[name].type
        if kind in "IC":
            return Port(name, "p" if kind == "I" else "q")
        return Port(name, "e" if law.gives == "f" else "f")
