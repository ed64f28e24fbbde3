"""The characteristic polynomial of a graph: all natural modes, also those that no channel shows."""

from __future__ import annotations

from typing import Any

from dynid.bondgraph.graph import Port
from dynid.bondgraph.plan import ProgramPlan, ReducedGraph
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
    registers = {port: determinant(reduced, reduction) for port, reduction in reduced.reductions.items()}
    ratios = reduced.rational(registers.values())
    return {port: ratios[register].lowest_terms()[0] for port, register in registers.items()}


def determinant(planned: ProgramPlan, reduction: Reduction) -> int:
    """Write the determinant of the nodal form, times s for every storage that integrates there."""
    program = planned.program
    return program.product([*reduction.pivots, *(program.s for _ in range(reduction.integrators))])
