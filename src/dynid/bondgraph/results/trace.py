"""The reduction as a reader of the paper would follow it: its steps, and the prototype it ends in."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dynid.bondgraph.notation import express, length
from dynid.bondgraph.reduced import ReducedGraph
from dynid.bondgraph.steps import Step
from dynid.result import Result

#: Longest nested formula of a prototype's system that is written out, in operations.
_READABLE = 40


def add_steps(result: Result, reduced: ReducedGraph) -> None:
    """Add the steps to every output, in order: rule, nodes, equation and meaning."""
    symbols = {name: node.symbol for name, node in reduced.graph.nodes.items()}
    rows = [
        (str(port), step.rule, ", ".join(step.nodes), _equation(reduced, step, symbols), step.meaning)
        for port, reduction in reduced.reductions.items()
        for step in reduction.steps
    ]
    names = ("output", "rule", "nodes", "equation", "meaning")
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
        for prototype in prototypes:
            name, ((register, _),) = prototype.definitions[index]
            nested = length(reduced.program, register, _READABLE) < _READABLE
            texts.append(f"{name} = {express(reduced.program, register, symbols, nested=nested)}")
        result.add(f"bond_graph/reduction/{part}", texts, ("output",))


def _equation(reduced: ReducedGraph, step: Step, symbols: Mapping[str, str]) -> str:
    """Write the equations of a step, in terms of what earlier steps have named."""
    program, lines = reduced.program, []
    for name, parts in step.definitions:
        terms = []
        for register, source in parts:
            label = program.labels.get(register)
            text = label if label and label != name else express(program, register, symbols)
            if source and text in ("1", "-1"):
                text = text.replace("1", source)
            elif source:
                text = f"({text})*{source}" if (" + " in text or " - " in text) else f"{text}*{source}"
            terms.append(text)
        lines.append(f"{name} = {' + '.join(terms)}")
    return "; ".join([*lines, step.relation] if step.relation else lines)
