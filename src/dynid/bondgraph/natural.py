"""The natural modes of a graph, those that no channel shows included."""

from __future__ import annotations

from functools import reduce
from typing import Any

from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduced import ReducedGraph
from dynid.bondgraph.reduction.reducer import Reduction


def characteristic_polynomials(reduced: ReducedGraph) -> dict[Port, Any]:
    """Return, for every output, the polynomial of all natural modes of the part behind it.

    It is the determinant of the nodal form (the product of the pivots) times s for every storage that
    integrates there (its immittance has s in the denominator).

    Returns
    -------
    dict
        Integer polynomials (flint `fmpz_poly`) by output.
    """
    registers = {port: _determinant(reduced, reduction) for port, reduction in reduced.reductions.items()}
    ratios = reduced.rational(registers.values())
    return {port: ratios[register].lowest_terms()[0] for port, register in registers.items()}


def _determinant(reduced: ReducedGraph, reduction: Reduction) -> int:
    program, structure = reduced.program, reduced.structure
    integrating = {"1": "C", "0": "I"}
    storages = [
        name
        for place in reduction.junctions
        for name in structure.junctions[place].elements
        if reduced.graph.nodes[name].type == integrating[structure.junctions[place].kind]
    ]
    return reduce(program.mul, [*reduction.pivots, *(program.s for _ in storages)], program.one)
