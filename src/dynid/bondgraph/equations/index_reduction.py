"""Sparse index reduction by substitution, and the irreducible blocks of a system.

Equations are solved for one rate each (Gauss-Jordan). One without any rate is algebraic: it is solved for
an unknown that, with its rate, is put into everything else; an equation that loses its rate by that is
solved anew. So every round stays among neighbours, and constraints, algebraic loops and dependent storage
are folded in until each unknown that is left has a state equation. The irreducible blocks (Dulmage and
Mendelsohn 1958) are the smallest square systems whose determinants multiply to that of the whole.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from dynid.bondgraph.equations.descriptor import FormSymbol, LinearForm, add, contradiction, rate, scaled

# --- index reduction ------------------------------------------------------------------------------


def solve(
    equations: Sequence[LinearForm], outputs: Sequence[LinearForm]
) -> tuple[dict[str, LinearForm], list[LinearForm]]:
    """Return the rate of every unknown that is left, and the outputs, as forms in these and the inputs.

    Parameters
    ----------
    equations
        Forms that equal zero, in unknowns, rates and inputs.
    outputs
        Forms to rewrite.

    Raises
    ------
    Singular
        Where the equations contradict each other or leave an unknown open.
    """
    return _IndexReduction(equations, outputs).run()


class _IndexReduction:
    def __init__(self, equations: Sequence[LinearForm], outputs: Sequence[LinearForm]) -> None:
        self.count = len(equations)  # rows from here on are outputs
        self.rows: dict[int, LinearForm] = {k: dict(form) for k, form in enumerate([*equations, *outputs])}
        self.rows_with: dict[FormSymbol, dict[int, None]] = {}
        self.rank: dict[str, int] = {}  # the order in which unknowns were met
        for row, form in self.rows.items():
            for symbol in form:
                if symbol[0] != "u":
                    self.rows_with.setdefault(symbol, {})[row] = None
                    self.rank.setdefault(symbol[1], len(self.rank))
        self.rate_row: dict[FormSymbol, int] = {}
        self.pivot: dict[int, FormSymbol] = {}
        self.waiting = deque(range(self.count))
        self.algebraic: list[tuple[int, int]] = []  # a heap of (length when pushed, row)

    def run(self) -> tuple[dict[str, LinearForm], list[LinearForm]]:
        while self.waiting or self.algebraic:
            while self.waiting:
                self._solve_for_a_rate(self.waiting.popleft())
            if self.algebraic:
                length, row = heapq.heappop(self.algebraic)
                if length == len(self.rows[row]):
                    self._solve_for_an_unknown(row)
                else:
                    heapq.heappush(self.algebraic, (len(self.rows[row]), row))
        rates: dict[str, LinearForm] = {}
        for pivot in sorted(self.rate_row, key=lambda symbol: self.rank[symbol[1]]):
            form = self.rows[self.rate_row[pivot]]
            rates[pivot[1]] = scaled({k: v for k, v in form.items() if k != pivot}, -1)
        outputs = [self.rows[row] for row in range(self.count, self.count + len(self.rows) - len(rates))]
        for output in outputs:
            for symbol in [symbol for symbol in output if symbol in self.rate_row]:
                add(output, rates[symbol[1]], output.pop(symbol))
        for form in (*rates.values(), *outputs):
            if any(symbol[0] == "dw" or (symbol[0] == "w" and symbol[1] not in rates) for symbol in form):
                raise contradiction()
        return rates, outputs

    def _add(self, row: int, form: LinearForm, factor: object) -> None:
        """Add a multiple of a form to a row, and keep the index of rows true."""
        target = self.rows[row]
        add(target, form, factor)
        for symbol in form:
            if symbol[0] == "u":
                continue
            if symbol in target:
                self.rows_with.setdefault(symbol, {})[row] = None
            else:
                self.rows_with.get(symbol, {}).pop(row, None)

    def _solve_for_a_rate(self, row: int) -> None:
        form = self.rows[row]
        for symbol in [symbol for symbol in form if symbol in self.rate_row]:
            self._add(row, self.rows[self.rate_row[symbol]], -form[symbol])
        pivot = min(
            (symbol for symbol in form if symbol[0] == "dw"),
            key=lambda symbol: (len(self.rows_with[symbol]), self.rank[symbol[1]]),
            default=None,
        )
        if pivot is None:
            heapq.heappush(self.algebraic, (len(form), row))
            return
        form = self.rows[row] = scaled(form, 1 / form[pivot])
        for other in [other for other in self.rows_with[pivot] if other in self.pivot]:
            self._add(other, form, -self.rows[other][pivot])
        self.rate_row[pivot], self.pivot[row] = row, pivot

    def _solve_for_an_unknown(self, row: int) -> None:
        """Solve an algebraic equation for one unknown, and put it and its rate into everything else.

        An unknown whose rate stands nowhere is preferred, then one in few equations, then a late one.
        """
        form = self.rows[row]
        unknowns = [symbol for symbol in form if symbol[0] == "w"]
        if not unknowns:
            raise contradiction()
        moving = {symbol: bool(self.rows_with.get(("dw", symbol[1]))) for symbol in unknowns}
        unknown = min(
            unknowns,
            key=lambda s: (moving[s], len(self.rows_with[s]) if not moving[s] else 0, -self.rank[s[1]]),
        )
        value = scaled({k: v for k, v in form.items() if k != unknown}, -1 / form[unknown])
        for symbol in form:
            if symbol[0] == "w":
                self.rows_with[symbol].pop(row)
        del self.rows[row]
        self._substitute(("dw", unknown[1]), rate(value))
        self._substitute(unknown, value)

    def _substitute(self, symbol: FormSymbol, value: LinearForm) -> None:
        for row in list(self.rows_with.pop(symbol, ())):
            if symbol[0] == "dw" and row in self.pivot:
                del self.rate_row[self.pivot.pop(row)]
                self.waiting.append(row)
            self._add(row, value, self.rows[row].pop(symbol))


def without_input_rates(rates: dict[str, LinearForm], outputs: list[LinearForm]) -> None:
    """Take derivatives of inputs out of the state equations, in place, by a change of state.

    With x = v + B_k u^(k-1), the k-th derivative leaves x'; what remains of it is the improper part of the
    outputs.
    """
    forms = [*rates.values(), *outputs]
    highest = max((s[2] for form in rates.values() for s in form if len(s) == 3), default=0)
    for k in range(highest, 0, -1):
        shifts: dict[FormSymbol, LinearForm] = {}
        for name, form in rates.items():
            moved: LinearForm = {
                ("u", s[1], k - 1): form.pop(s) for s in list(form) if len(s) == 3 and s[2] == k
            }
            if moved:
                shifts["w", name] = moved
        for form in forms:
            for symbol in [symbol for symbol in form if symbol in shifts]:
                add(form, shifts[symbol], form[symbol])


# --- irreducible blocks ---------------------------------------------------------------------------


@dataclass(frozen=True)
class IrreducibleBlock:
    """A square part of a system: the places of its equations, and what they say of its own unknowns."""

    rows: list[int]
    forms: list[LinearForm]

    @property
    def unknowns(self) -> set[str]:
        """The names of its unknowns."""
        return {symbol[1] for form in self.forms for symbol in form}


def irreducible_blocks(equations: Sequence[LinearForm]) -> list[IrreducibleBlock]:
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
    by_row, by_column = label.tolist(), label[row_of].tolist()
    blocks = [IrreducibleBlock([], []) for _ in range(max(by_row) + 1)]
    block_of = {name: by_column[column] for name, column in place.items()}
    for row, form in enumerate(equations):
        own = {s: v for s, v in form.items() if s[0] != "u" and block_of[s[1]] == by_row[row]}
        blocks[by_row[row]].rows.append(row)
        blocks[by_row[row]].forms.append(own)
    return blocks
