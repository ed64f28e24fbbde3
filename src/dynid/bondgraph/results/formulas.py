"""Transfer functions in symbols: short ones as text, on demand nested or expanded at any length."""

from __future__ import annotations

from dynid.bondgraph.formula import expanded, nested, readable
from dynid.bondgraph.question import Formulas
from dynid.bondgraph.reduced import Channel, ReducedGraph
from dynid.bondgraph.reduction.writing import LATEX, TEXT
from dynid.result import Result


def add_formulas(result: Result, reduced: ReducedGraph, wanted: Formulas | None) -> None:
    """Add what there is to read of every channel.

    A formula of a page is the attribute `symbolic` (and `latex`) of its channel. On demand a channel has the
    datasets `program` and `program_latex` (named assignments, none expanded), and where it is to be expanded
    `symbolic_numerator` and `symbolic_denominator`, however long.

    Raises
    ------
    NumericalError
        Where an expansion outgrows its guard.
    UsageError
        Where a formula that was asked for cannot be written.
    """
    _add_readable(result, reduced)
    if wanted is None:
        return
    for channel, register in reduced.channels().items():
        for name, hand in (("program", TEXT), ("program_latex", LATEX)):
            result.add(f"{_group(channel)}/{name}", nested(reduced, [register], hand))
    if wanted.form == "expanded":
        from dynid.bondgraph.algebra.symbolic import plain

        for channel, polynomials in expanded(reduced, wanted.terms).items():
            for name, part in zip(("numerator", "denominator"), polynomials, strict=True):
                result.add(f"{_group(channel)}/symbolic_{name}", plain(part), terms=len(part))


def _add_readable(result: Result, reduced: ReducedGraph) -> None:
    from dynid.bondgraph.algebra.symbolic import quotient, written

    for channel, (numerator, denominator) in readable(reduced).items():
        latex, rank = written(numerator, LATEX)
        if denominator != 1:
            latex, rank = LATEX.quotient((latex, rank), written(denominator, LATEX))
        result.annotate(_group(channel), symbolic=quotient(numerator, denominator)[0], latex=latex)


def _group(channel: Channel) -> str:
    return f"bond_graph/transfer_function/{channel[0]}/{channel[1]}"
