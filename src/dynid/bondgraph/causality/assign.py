"""The causality of a graph."""

from __future__ import annotations

from dynid.bondgraph.causality.loops import algebraic_loops
from dynid.bondgraph.causality.report import CausalBond, CausalElement, Causality, CausalState
from dynid.bondgraph.causality.scap import Assigned, run_scap
from dynid.bondgraph.causality.strokes import Strokes
from dynid.bondgraph.causality.wording import explain_conflict, explain_dependent
from dynid.bondgraph.graph import ONE_PORTS, SOURCES, STORAGES, BondGraph


def assign_causality(graph: BondGraph) -> Causality:
    """Assign causality to every bond of a graph (SCAP).

    It reads nodes and bonds only, no values, and takes time linear in their number; around loops a step
    may have to be looked ahead.

    Parameters
    ----------
    graph
        The bond graph.

    Returns
    -------
    Causality
        Strokes, states, dependent storages and algebraic loops; conflicts where the graph contradicts
        itself, with the strokes of the rest.
    """
    kinds = {name: node.type for name, node in graph.nodes.items()}
    strokes = Strokes(kinds, [(bond.tail, bond.head) for bond in graph.bonds])
    one_ports = [name for name, kind in kinds.items() if kind in ONE_PORTS]
    return describe(run_scap(strokes, one_ports))


def describe(assigned: Assigned) -> Causality:
    """Put an assignment into words and tables."""
    strokes = assigned.strokes
    kinds = strokes.kinds
    elements = tuple(_element(strokes, name) for name, kind in kinds.items() if kind in ONE_PORTS)
    integral = [element.name for element in elements if element.causality == "integral"]
    derivative = [element.name for element in elements if element.causality == "derivative"]
    return Causality(
        bonds=tuple(_bond(strokes, bond) for bond in range(len(strokes.bonds))),
        elements=elements,
        states=tuple(_state(kinds[name], name) for name in integral),
        dependent=tuple(explain_dependent(strokes, name) for name in derivative),
        loops=() if assigned.conflicts else algebraic_loops(strokes),
        conflicts=tuple(explain_conflict(strokes, bond, problem) for bond, problem in assigned.conflicts),
    )


def _bond(strokes: Strokes, bond: int) -> CausalBond:
    tail, head = strokes.bonds[bond]
    at_head = strokes.at_head[bond]
    how = "conflict" if at_head is None else strokes.how[bond]
    return CausalBond(tail, head, "tail" if at_head is False else "head", how)


def _element(strokes: Strokes, name: str) -> CausalElement:
    kind = strokes.kinds[name]
    (bond,) = strokes.bonds_at[name]
    if strokes.at_head[bond] is None:
        return CausalElement(name, kind, "fixed" if kind in SOURCES else "conflict", "conflict")
    effort_in = strokes.at_head[bond] is strokes.towards(name, bond)
    if kind in SOURCES:
        causality = "fixed"
    elif kind in STORAGES:
        causality = "integral" if effort_in is (kind == "I") else "derivative"
    else:
        causality = "conductive" if effort_in else "resistive"
    return CausalElement(name, kind, causality, strokes.how[bond])


def _state(kind: str, name: str) -> CausalState:
    return (
        CausalState(f"p_{name}", name, "momentum")
        if kind == "I"
        else CausalState(f"q_{name}", name, "displacement")
    )
