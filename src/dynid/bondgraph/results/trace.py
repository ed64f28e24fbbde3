"""The reduction as a reader of the paper would follow it: its steps, and the prototype it ends in."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynid.bondgraph.reduced import ReducedGraph
from dynid.bondgraph.reduction.notation import express, length
from dynid.bondgraph.reduction.reducer import Reduction
from dynid.bondgraph.reduction.steps import Step
from dynid.result import Result

#: Longest nested formula of a prototype's system that is written out, in operations.
_READABLE = 40


def add_steps(result: Result, reduced: ReducedGraph) -> None:
    """Add the steps to every output, in order: rule, nodes, equation and meaning."""
    symbols = {name: node.symbol for name, node in reduced.graph.nodes.items()}
    rows = []
    for port, reduction in reduced.reductions.items():
        for step in reduction.steps:
            equations = _equations(reduced, reduction, step, symbols)
            rows.append((step.rule, ", ".join(step.nodes), equations, step.meaning, str(port)))
    names = ("rule", "nodes", "equation", "meaning", "output")
    table = np.array(rows, dtype=[(name, object) for name in names])
    result.add_axis("bond_graph/reduction/step", np.arange(1, len(rows) + 1))
    result.add("bond_graph/reduction/steps", table, ("step",))


def add_prototypes(result: Result, reduced: ReducedGraph) -> None:
    """Add the prototype at every output: its letter, its equation, and the systems A and B."""
    symbols = {name: node.symbol for name, node in reduced.graph.nodes.items()}
    ports = list(reduced.reductions)
    result.add_axis("bond_graph/reduction/output", [str(port) for port in ports])
    letters = [reduced.reductions[port].prototype.letter for port in ports]
    if len(ports) == 1:
        result.add("bond_graph/reduction/prototype", letters[0])
    else:
        result.add("bond_graph/reduction/prototype", letters, ("output",))
    prototypes = [reduced.reductions[port].prototype for port in ports]
    result.add("bond_graph/reduction/prototype_equation", [p.equation for p in prototypes], ("output",))
    for part, index in (("system_a", 0), ("system_b", 1)):
        texts = []
        for port, prototype in zip(ports, prototypes, strict=True):
            name, register = prototype.systems[index]
            nested = length(reduced.program, register, _READABLE) < _READABLE
            labels = {} if nested else reduced.reductions[port].labels
            texts.append(f"{name} = {express(reduced.program, register, symbols, labels)}")
        result.add(f"bond_graph/reduction/{part}", texts, ("output",))


def _equations(reduced: ReducedGraph, reduction: Reduction, step: Step, symbols: Mapping[str, str]) -> str:
    """Write the equations of a step, in terms of what earlier steps have named."""
    lines = []
    for name, parts in step.definitions:
        if isinstance(parts, str):
            lines.append(f"{name} = {parts}")
            continue
        total = ""
        for register, variable in parts:
            label = reduction.labels.get(register)
            named = label is not None and label != name
            text = label if named else express(reduced.program, register, symbols, reduction.labels)
            term = _times(str(text), variable)
            total += f" - {term[1:]}" if total and term.startswith("-") else f" + {term}" if total else term
        lines.append(f"{name} = {total or '0'}")
    return "; ".join(lines)


def _times(coefficient: str, variable: str) -> str:
    """Write a coefficient times a variable, where there is one."""
    if not variable:
        return coefficient
    if coefficient in ("1", "-1"):
        return coefficient.replace("1", variable)
    return f"({coefficient})*{variable}" if " " in coefficient else f"{coefficient}*{variable}"
