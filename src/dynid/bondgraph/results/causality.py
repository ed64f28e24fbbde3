"""The causality of a graph as tables: strokes, states, dependent storage, loops and conflicts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.bondgraph.causality.assign import assign_causality
from dynid.bondgraph.causality.report import Causality, Remark
from dynid.bondgraph.graph import VALUED, BondGraph
from dynid.errors import Singular
from dynid.result import Result

_GROUP = "bond_graph/causality"


def add_causality(result: Result, graph: BondGraph) -> Causality:
    """Add strokes, elements, states, dependent storages, algebraic loops and conflicts of a whole graph.

    `order` is the number of states that the structure allows, `order_exact` that of the state equations
    with the graph's values (absent where these have no unique solution).
    """
    causality = assign_causality(graph)
    bonds = [(b.tail, b.head, b.stroke, b.set_by) for b in causality.bonds]
    elements = [(e.name, e.type, e.causality, e.set_by) for e in causality.elements]
    states = [(s.name, s.element, s.quantity) for s in causality.states]
    _table(result, "bond", bonds, ("tail", "head", "stroke", "set_by"))
    _table(result, "element", elements, ("name", "type", "causality", "set_by"))
    _table(result, "state", states, ("name", "element", "quantity"))
    for axis, remarks in (
        ("dependent_storage", causality.dependent),
        ("loop", causality.loops),
        ("conflict", causality.conflicts),
    ):
        _remarks(result, axis, remarks)
    result.add(f"{_GROUP}/order", causality.order)
    note = _compare_order(result, graph, causality)
    if note:
        result.annotate(_GROUP, note=note)
    return causality


def _table(result: Result, axis: str, rows: Sequence[tuple[str, ...]], names: tuple[str, ...]) -> None:
    result.add_axis(f"{_GROUP}/{axis}", np.arange(1, len(rows) + 1))
    result.add(f"{_GROUP}/{axis}s", np.array(rows, dtype=[(name, object) for name in names]), (axis,))


def _remarks(result: Result, axis: str, remarks: Sequence[Remark]) -> None:
    rows = [(", ".join(remark.nodes), remark.meaning, remark.equations) for remark in remarks]
    dtype = [("nodes", object), ("meaning", object), ("equations", np.int64)]
    result.add_axis(f"{_GROUP}/{axis}", np.arange(1, len(rows) + 1))
    result.add(f"{_GROUP}/{axis}s", np.array(rows, dtype=dtype), (axis,))


def _compare_order(result: Result, graph: BondGraph, causality: Causality) -> str:
    """Add the exact order, and say why it differs from the structural one."""
    from dynid.bondgraph.state_space import natural_order

    if causality.conflicts:
        return ""
    try:
        exact = natural_order(graph)
    except Singular:
        return (
            "causality can be assigned, but the equations have no unique solution: around a loop the gain is "
            "1, or values cancel"
        )
    result.add(f"{_GROUP}/order_exact", exact)
    if exact == causality.order:
        return ""
    zero = [name for name, node in graph.nodes.items() if node.type in VALUED and node.value == 0]
    because = (
        f"the values of {', '.join(zero)} are zero"
        if zero
        else "with these values, or the unit gains of plain bonds, contributions of parallel paths cancel"
    )
    return (
        f"the structure allows {causality.order} states, but the equations have {exact}, the degree of the "
        f"natural polynomial: {because}"
    )
