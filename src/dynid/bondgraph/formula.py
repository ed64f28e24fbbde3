"""Transfer functions as formulas in the parameters, while they stay readable."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from dynid.bondgraph.reduced import Channel, ReducedGraph

if TYPE_CHECKING:
    from dynid.bondgraph.algebra.symbolic import Formula

#: Most terms of numerator or denominator that a reader would read, and most on the way there.
_READABLE, _LIMIT = 40, 4000


def formulas(reduced: ReducedGraph) -> dict[Channel, str]:
    """Return the channels whose formula is readable, as text that SymPy could read.

    Elements are written by the expression given for their value, or by their own name where a bare number
    was given. Where that is ambiguous (a parameter called s, a node named like another's parameter), or
    the formula outgrows a page, there is none.
    """
    from dynid.bondgraph.algebra.symbolic import TooLong, text, variables

    names = _names(reduced)
    if names is None:
        return {}
    symbols, one = variables(["s", *names], _LIMIT)
    channels = reduced.channels()
    try:
        values = {name: _value(reduced, name, symbols, one) for name in reduced.valued}
        run = reduced.run(channels.values(), values, symbols["s"], one)
        lowest = {channel: run[register].lowest_terms() for channel, register in channels.items()}
    except (TooLong, KeyError, ZeroDivisionError):
        return {}
    return {
        channel: text(numerator, denominator)
        for channel, (numerator, denominator) in lowest.items()
        if max(len(numerator), len(denominator)) <= _READABLE
    }


def _names(reduced: ReducedGraph) -> list[str] | None:
    """Return the symbols needed, or None where they are ambiguous."""
    nodes = [reduced.graph.nodes[name] for name in reduced.valued]
    from_formulas = {name for node in nodes if node.formula for name in node.formula.names}
    own = [node.name for node in nodes if not (node.formula and node.formula.names)]
    if "s" in from_formulas or any(
        name == "s" or name in from_formulas or not name.isidentifier() for name in own
    ):
        return None
    return [*dict.fromkeys([*own, *sorted(from_formulas)])]


def _value(reduced: ReducedGraph, name: str, symbols: dict[str, Formula], one: Formula) -> Formula:
    from dynid.bondgraph.algebra.symbolic import apply

    formula = reduced.graph.nodes[name].formula
    if formula is None or not formula.names:
        return symbols[name]

    def leaf(item: Fraction | str) -> Formula:
        return symbols[item] if isinstance(item, str) else one.constant(item)

    value: Formula = formula.fold(leaf, apply)
    return value
