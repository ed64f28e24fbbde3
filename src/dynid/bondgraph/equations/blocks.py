"""The irreducible parts of a square system of equations (Dulmage and Mendelsohn 1958)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from dynid.bondgraph.equations.forms import Form, contradiction


@dataclass(frozen=True)
class Block:
    """A square part of a system: the places of its equations, and what they say of its own unknowns."""

    rows: list[int]
    forms: list[Form]

    @property
    def unknowns(self) -> set[str]:
        """The names of its unknowns."""
        return {symbol[1] for form in self.forms for symbol in form}


def irreducible_blocks(equations: Sequence[Form]) -> list[Block]:
    """Split equations into the smallest square systems whose determinants multiply to that of the whole.

    Equations and unknowns can be ordered so that the system is block triangular; each block is returned
    without what stands beside the diagonal: terms in unknowns of other blocks, and inputs.

    Parameters
    ----------
    equations
        Forms that equal zero; an unknown and its rate are one column.

    Raises
    ------
    Singular
        Where the determinant vanishes whatever the coefficients are.
    """
    place: dict[str, int] = {}
    entries = [
        (row, place.setdefault(symbol[1], len(place)))
        for row, form in enumerate(equations)
        for symbol in form
        if symbol[0] != "u"
    ]
    size = len(equations)
    if len(place) != size:
        raise contradiction()
    if not size:
        return []
    by_row, by_column = _parts(entries, size)
    blocks = [Block([], []) for _ in range(max(by_row) + 1)]
    block_of = {name: by_column[column] for name, column in place.items()}
    for row, form in enumerate(equations):
        own = {s: v for s, v in form.items() if s[0] != "u" and block_of[s[1]] == by_row[row]}
        blocks[by_row[row]].rows.append(row)
        blocks[by_row[row]].forms.append(own)
    return blocks


def _parts(entries: Sequence[tuple[int, int]], size: int) -> tuple[list[int], list[int]]:
    """Return the irreducible part that each row and each column of a square pattern belongs to.

    Raises
    ------
    Singular
        Where no diagonal can be chosen.
    """
    import numpy as np
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

    rows, columns = np.array(entries).T
    pattern = csr_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(size, size))
    column_of = maximum_bipartite_matching(pattern, perm_type="column")
    if (column_of < 0).any():
        raise contradiction()
    row_of = np.empty(size, dtype=int)
    row_of[column_of] = np.arange(size)
    reads = csr_array((np.ones(len(rows), dtype=np.int8), (rows, row_of[columns])), shape=(size, size))
    _, label = connected_components(reads, directed=True, connection="strong")
    return label.tolist(), label[row_of].tolist()
