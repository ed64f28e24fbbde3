"""The natural modes of a graph, those that no channel shows included."""

from __future__ import annotations

from functools import reduce
from typing import Any

from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduced import Planned, ReducedGraph
from dynid.bondgraph.reduction.reducer import Reduction
from dynid.bondgraph.transfer import TransferFunction


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


def hidden_polynomial(reduced: ReducedGraph, port: Port, transfer: TransferFunction, natural: Any) -> Any:
    """Return the polynomial of the natural modes that cancel in a channel.

    Parameters
    ----------
    reduced, port
        The graph, and the channel's output.
    transfer
        The channel.
    natural
        The polynomial of all natural modes behind the output.
    """
    return natural // natural.gcd(_shown(reduced, port, transfer))


def _shown(reduced: ReducedGraph, port: Port, transfer: TransferFunction) -> Any:
    """Return the polynomial of the natural modes that a channel shows."""
    from flint import fmpz_poly

    if not reduced.graph.integrates(port) or transfer.denominator[0] != 0:
        return transfer.denominator
    return transfer.denominator // fmpz_poly([0, 1])


def determinant(planned: Planned, reduction: Reduction) -> int:
    """Write the determinant of the nodal form, times s for every storage that integrates there."""
    program = planned.program
    return reduce(
        program.mul, [*reduction.pivots, *(program.s for _ in range(reduction.integrators))], program.one
    )
