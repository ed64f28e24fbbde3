"""The reduction as a reader of the paper would follow it: its steps, and the prototype it ends in."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynid.bondgraph.need import dropped
from dynid.bondgraph.reduced import Planned, ReducedGraph
from dynid.bondgraph.reduction.notation import express, length
from dynid.bondgraph.reduction.prototypes import Prototype
from dynid.bondgraph.reduction.reducer import Reduction
from dynid.bondgraph.reduction.steps import Step
from dynid.bondgraph.reduction.writing import LATEX, TEXT, Hand, Written
from dynid.result import Result

#: Longest nested formula of a prototype's system that is written out, in operations.
_READABLE = 40


def add_steps(result: Result, reduced: ReducedGraph) -> None:
    """Add the steps to every output, in order: rule, nodes, equation and meaning."""
    reductions = {str(port): reduction for port, reduction in reduced.reductions.items()}
    add_traces(result, "bond_graph/reduction", reduced, reductions, "output")


def add_traces(
    result: Result, group: str, planned: Planned, reductions: Mapping[str, Reduction], of: str
) -> None:
    """Add the steps of reductions as one table; its column `of` says which reduction a step belongs to."""
    rows = []
    for name, reduction in reductions.items():
        for step in reduction.steps:
            text, latex = (equations(planned, reduction, step, hand) for hand in (TEXT, LATEX))
            rows.append((step.rule, ", ".join(step.nodes), text, step.meaning, name, latex))
    names = ("rule", "nodes", "equation", "meaning", of, "latex")
    table = np.array(rows, dtype=[(name, object) for name in names])
    result.add_axis(f"{group}/step", np.arange(1, len(rows) + 1))
    result.add(f"{group}/steps", table, ("step",))


def add_prototypes(result: Result, reduced: ReducedGraph) -> None:
    """Add the prototype at every output: its letter, its equation, and the systems A and B."""
    ports = list(reduced.reductions)
    result.add_axis("bond_graph/reduction/output", [str(port) for port in ports])
    letters = [reduced.reductions[port].prototype.letter for port in ports]
    if len(ports) == 1:
        result.add("bond_graph/reduction/prototype", letters[0])
    else:
        result.add("bond_graph/reduction/prototype", letters, ("output",))
    left_out = [", ".join(dropped(reduced, port)) for port in ports]
    result.add("bond_graph/reduction/dropped", left_out, ("output",))
    prototypes = [reduced.reductions[port].prototype for port in ports]
    for hand, suffix in ((TEXT, ""), (LATEX, "_latex")):
        texts = [prototype.equation(hand) for prototype in prototypes]
        result.add(f"bond_graph/reduction/prototype_equation{suffix}", texts, ("output",))
        for part, index in (("system_a", 0), ("system_b", 1)):
            texts = [_system(reduced, reduced.reductions[port], index, hand) for port in ports]
            result.add(f"bond_graph/reduction/{part}{suffix}", texts, ("output",))


def _system(planned: Planned, reduction: Reduction, index: int, hand: Hand) -> str:
    return system_text(planned, reduction.prototype, index, reduction.labels, hand)


def system_text(
    planned: Planned, prototype: Prototype, index: int, labels: Mapping[int, str], hand: Hand
) -> str:
    """Write system A or B of a prototype: nested while that is readable, else by the names of the steps."""
    name, register = prototype.systems[index]
    nested = length(planned.program, register, _READABLE) < _READABLE
    text, _ = express(planned.program, register, planned.graph.nodes, {} if nested else labels, hand)
    return f"{hand.name(name)[0]} = {text}"


def equations(planned: Planned, reduction: Reduction, step: Step, hand: Hand) -> str:
    """Write the equations of a step, in terms of what earlier steps have named."""
    lines = []
    for name, parts in step.definitions:
        if callable(parts):
            text, _ = parts(hand)
        else:
            text, _ = hand.listed([_term(planned, reduction, name, part, hand) for part in parts])
        lines.append(f"{hand.name(name)[0]} = {text}")
    return ("; " if hand is TEXT else r";\quad ").join(lines)


def _term(planned: Planned, reduction: Reduction, name: str, part: tuple[int, str], hand: Hand) -> Written:
    """Write a register, by its label unless that is what is being defined, times its variable."""
    register, variable = part
    label = reduction.labels.get(register)
    if label is not None and label != name:
        coefficient = hand.name(label)
    else:
        coefficient = express(planned.program, register, planned.graph.nodes, reduction.labels, hand)
    return hand.scaled(coefficient, variable)
