"""The causality of a graph and the zero dynamics of its channels in a result.

Strokes, states, derivative causality, loops and conflicts as tables; the zero dynamics of every channel as a
graph by bicausality, and as exact state equations.
"""

from __future__ import annotations

import numpy as np

from dynid.bondgraph.causality.bicausal import BicausalBond, ZeroCausality, zero_causality
from dynid.bondgraph.causality.report import (
    CausalBond,
    CausalElement,
    Causality,
    CausalState,
    join_nodes,
    join_with_types,
)
from dynid.bondgraph.causality.scap import assign_causality
from dynid.bondgraph.graph import VALUED, BondGraph, Port
from dynid.bondgraph.graph_state_space import ZeroPart, natural_order, zero_dynamics, zero_parts
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.bondgraph.results.prototype_results import table
from dynid.bondgraph.state_equations import zero_dynamics_equations
from dynid.errors import NumericalError, Singular
from dynid.result import Result

# --- causality ------------------------------------------------------------------------------------

_GROUP = "bond_graph/causality"


def add_causality(result: Result, graph: BondGraph) -> Causality:
    """Add strokes, elements, states, derivative causality, algebraic loops and conflicts of a whole graph.

    `order` is the number of states that the structure allows, `order_exact` that of the state equations
    with the graph's values (absent where these have no unique solution).
    """
    causality = assign_causality(graph)
    result.add_numbered(f"{_GROUP}/bond", table(causality.bonds, CausalBond._fields))
    result.add_numbered(f"{_GROUP}/element", table(causality.elements, CausalElement._fields))
    result.add_numbered(f"{_GROUP}/state", table(causality.states, CausalState._fields))
    for axis, remarks in (
        ("dependent_storage", causality.dependent),
        ("loop", causality.loops),
        ("conflict", causality.conflicts),
    ):
        rows = [(", ".join(remark.nodes), remark.meaning, remark.equations) for remark in remarks]
        dtype = [("nodes", object), ("meaning", object), ("equations", np.int64)]
        result.add_numbered(f"{_GROUP}/{axis}", np.array(rows, dtype=dtype))
    result.add(f"{_GROUP}/order", causality.order)
    note = _compare_order(result, graph, causality)
    if note:
        result.annotate(_GROUP, note=note)
    return causality


def _compare_order(result: Result, graph: BondGraph, causality: Causality) -> str:
    """Add the exact order; return the reason where it differs from the structural one."""
    from dynid.bondgraph.graph_state_space import natural_order

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


# --- zero dynamics --------------------------------------------------------------------------------

#: Most states of which the coupled equations are written down, and most parts that a sentence names.
_MAX_WRITTEN_STATES, _MAX_NAMED_PARTS = 40, 4


def add_zero_dynamics(result: Result, reduced: ReducedGraph, causality: Causality) -> None:
    """Add the zero dynamics of every channel."""
    for port in reduced.outputs:
        integrated = reduced.graph.integrates(port)
        modelled = set(reduced.reductions[port].modelled)
        order = sum(state.element in modelled for state in causality.states) + integrated
        junctions = reduced.reductions[port].junctions
        exact_order = natural_order(reduced.graph, junctions, reduced.structure) + integrated
        for source in reduced.inputs:
            bicausality = zero_causality(reduced.graph, port, source)
            group = f"bond_graph/causality/zero_dynamics/{port}/{source}"
            structural = None  # the number of zeros that the structure of the bicausal graph allows
            if bicausality is not None:
                result.add_numbered(f"{group}/bond", table(bicausality.bonds, BicausalBond._fields))
                result.add_axis(f"{group}/line", list(bicausality.line))
                inside = [state.name for state in bicausality.inside.states if state.element in modelled]
                derivative = [name for name in bicausality.derivative if name in modelled]
                result.add_axis(f"{group}/internal_state", np.array(inside, dtype=object))
                result.add_axis(f"{group}/derivative_storage", np.array(derivative, dtype=object))
                structural = len(inside)
                result.add(f"{group}/zeros_structural", structural)
                result.add(f"{group}/relative_degree_structural", order - structural)
            exact = _add_equations(result, group, reduced, port, source, exact_order)
            note = _difference(structural, exact, order - exact_order, bicausality)
            if note:
                result.annotate(group, note=note)


def _add_equations(
    result: Result, group: str, reduced: ReducedGraph, port: Port, source: str, order: int
) -> int | None:
    """Add the exact zero dynamics; return the number of zeros, None where the input does not reach."""
    try:
        parts = zero_parts(reduced, port, source)
    except Singular:
        result.add(f"{group}/meaning", f"the input {source} does not reach {port}: no zero dynamics")
        return None
    count = sum(len(zero_part.states) for zero_part in parts)
    result.add(f"{group}/zeros_exact", count)
    result.add(f"{group}/relative_degree_exact", order - count)
    result.add(f"{group}/meaning", _meaning(reduced, port, source, parts))
    rows = [
        (
            ", ".join(zero_part.elements),
            ", ".join(zero_part.states),
            "not formed: too large" if zero_part.polynomial is None else str(zero_part.polynomial),
        )
        for zero_part in parts
    ]
    result.add_numbered(f"{group}/part", table(rows, ("elements", "states", "polynomial")))
    if not 0 < count <= _MAX_WRITTEN_STATES:
        return count
    try:  # x' = A x of the zero dynamics and u = C x that holds the output, as far as doubles reach
        inside = zero_dynamics(reduced, port, source)
    except NumericalError:
        return count
    names = np.array(inside.states, dtype=object)
    result.add_axis(f"{group}/state", names)
    result.add_axis(f"{group}/rate_of", names)
    result.add(f"{group}/A", inside.A, ("rate_of", "state"))
    result.add(f"{group}/input", inside.C[0], ("state",))
    written = zero_dynamics_equations(reduced, port, source, inside.states)
    result.add(f"{group}/equations", np.array(written.states, dtype=object), ("rate_of",))
    result.add(f"{group}/input_equation", written.outputs[0])
    if written.definitions:
        result.add_numbered(f"{group}/definition", written.definitions)
    return count


def _meaning(reduced: ReducedGraph, port: Port, source: str, parts: tuple[ZeroPart, ...]) -> str:
    kinds = {name: node.type for name, node in reduced.graph.nodes.items()}
    held = f"with {port} held at zero by {source}"
    if not parts:
        return f"{held} there are no zero dynamics: the channel has no zeros"
    carried = [
        join_with_types(kinds, zero_part.elements) if zero_part.elements else join_nodes(zero_part.states)
        for zero_part in parts[:_MAX_NAMED_PARTS]
    ]
    more = f", and {len(parts) - _MAX_NAMED_PARTS} more parts" if len(parts) > _MAX_NAMED_PARTS else ""
    return f"zero dynamics, {held}: states of {'; '.join(carried)}{more}"


def _difference(
    structural: int | None, exact: int | None, lost: int, bicausality: ZeroCausality | None
) -> str:
    """Return the reason why structure and numbers give different counts of zeros."""
    several = (
        ""
        if bicausality is None or bicausality.lines < 2
        else f" ({bicausality.lines} lines of power were compared)"
    )
    if structural is None:
        return "" if exact is None else "no single line of power can be made bicausal; the exact count holds"
    if exact is None:
        return f"the structure lets the input through, but contributions cancel{several}"
    if structural - exact == lost == 0:
        return ""
    return (
        f"the structure allows {structural} zeros and the numbers have {exact}: values, or the unit gains of "
        f"plain bonds, cancel{several}"
    )
