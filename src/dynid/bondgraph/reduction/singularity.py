"""Why a graph has no unique solution, in terms of its junctions and sources.

The nodal form is taken at the program's random point modulo a prime, where its rank is what it is for
general values; its null vectors name the junctions concerned.
"""

from __future__ import annotations

from collections.abc import Iterable

from dynid.bondgraph.reduction.junctions import JunctionStructure
from dynid.bondgraph.reduction.network import Network, Row
from dynid.errors import Singular

#: Most junctions whose dense nodal form is looked at.
_MOST = 1500


def explain_singularity(network: Network) -> Singular:
    """Return the error that says which balances contradict each other, or what is not determined.

    Parameters
    ----------
    network
        The network before elimination.
    """
    structure, program, names = network.structure, network.program, list(network.rows)
    if len(names) > _MOST:
        return Singular(
            f"the equations of this graph of {len(names)} junctions have no unique solution: sources "
            "contradict each other, or a part floats",
            remedy=f"Look for it in a part of the graph: up to {_MOST} junctions, those concerned are named.",
        )

    def entry(row: Row, column: Row) -> int:
        register = network.diagonal(row) if row is column else network.entry(row, column)
        return int(program.image(register))

    rows = network.rows.values()
    dense = [[entry(row, column) for column in rows] for row in rows]
    for row, name in enumerate(names):
        if structure.junctions[name].fixing is not None:  # the root, whose unknown is known
            dense[row] = [int(row == column) for column in range(len(names))]
    contradicting = _null_support([list(column) for column in zip(*dense, strict=True)], names, program.prime)
    undetermined = _null_support(dense, names, program.prime)
    fixed = _neighbouring_sources(structure, contradicting)
    driving = fixed or [source for name in contradicting for source, _ in structure.junctions[name].feeding]
    if len(driving) > 1 or (driving and not fixed):
        return _no_solution(structure, contradicting, driving)
    return _not_determined(structure, undetermined or contradicting)


def _no_solution(structure: JunctionStructure, junctions: list[str], sources: list[str]) -> Singular:
    members = _user_names(structure, junctions)
    what = "sources" if len(sources) > 1 else "source"
    through = f" through {_quoted(members)}" if members else ""
    verb = "contradict each other" if len(sources) > 1 else "meets a balance without a solution"
    cancelling = any(structure.junctions[name].elements for name in junctions)
    reason = "the elements there cancel, nothing is left" if cancelling else "no element stands between"
    return Singular(
        f"{what} {_quoted(sources)} {verb}{through}: {reason} to take up the difference",
        remedy="Put an element (a resistance, say) in between, or drop a source.",
        names=(*sources, *members),
    )


def _not_determined(structure: JunctionStructure, junctions: list[str]) -> Singular:
    members = _user_names(structure, junctions)
    kinds = {structure.junctions[name].kind for name in junctions}
    what = {"0": "effort", "1": "flow"}.get(kinds.pop() if len(kinds) == 1 else "", "common variable")
    return Singular(
        f"the {what} of {_quoted(members)} is not determined: this part floats, "
        f"or a loop through it has no unique solution",
        remedy="Tie it to an element or a source, or drop one of the parallel paths.",
        names=tuple(members),
    )


def _user_names(structure: JunctionStructure, junctions: Iterable[str]) -> list[str]:
    names: list[str] = []
    for name in junctions:
        names += structure.junctions[name].members or structure.junctions[name].between
    return list(dict.fromkeys(names))


def _neighbouring_sources(structure: JunctionStructure, junctions: list[str]) -> list[str]:
    """Return the fixing sources of the junctions beside these."""
    found = []
    for coupling in structure.couplings:
        for here, there in ((coupling.tail, coupling.head), (coupling.head, coupling.tail)):
            fixing = structure.junctions[there].fixing
            if here in junctions and fixing is not None:
                found.append(fixing)
    return list(dict.fromkeys(found))


def _null_support(matrix: list[list[int]], names: list[str], prime: int) -> list[str]:
    """Return the names with a nonzero entry in a null vector of a square matrix modulo the prime."""
    from flint import nmod_mat

    size = len(names)
    reduced, rank = nmod_mat(size, size, [entry for row in matrix for entry in row], prime).rref()
    pivots = [next(column for column in range(size) if int(reduced[row, column])) for row in range(rank)]
    free = next((column for column in range(size) if column not in pivots), None)
    if free is None:
        return []
    return [names[pivot] for row, pivot in enumerate(pivots) if int(reduced[row, free])] + [names[free]]


def _quoted(names: Iterable[str]) -> str:
    quoted = [f"'{name}'" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"
