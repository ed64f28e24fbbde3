"""Exact rank tests of a graph's nodal form: contradictory sources and undetermined variables.

The nodal form K x = b has a row for every junction whose common variable no source fixes, and a column of b
for every source, whether it is an input or held at zero: each is prescribed independently of the others. The
graph has a unique solution where K has full rank over the rational functions of s; it has none for some
sources where a left null vector of K does not annihilate b; else a variable is undetermined where a right
null vector reaches it. The rank is taken at a random s modulo a large prime. Full rank there proves full
rank; a deficiency is confirmed at another point modulo another prime (a false one has odds below 1e-30).
The errors name junctions and sources.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

from dynid.bondgraph.graph import SOURCES, Port
from dynid.bondgraph.program.factored import field_point, numeric_point, primes_for
from dynid.bondgraph.program.program import ModularPoint, Program
from dynid.bondgraph.reduction.junctions import UNDETERMINED, JunctionStructure
from dynid.bondgraph.reduction.network import NodalNetwork
from dynid.errors import Singular

# --- errors ---------------------------------------------------------------------------------------

#: Most nodes that a message names.
_MAX_QUOTED_NODES = 8


def no_solution(structure: JunctionStructure, junctions: Sequence[str], sources: Sequence[str]) -> Singular:
    """Return the error for sources that contradict each other, or a balance that one of them cannot meet.

    `junctions`: the junctions whose balances together leave a condition on the sources alone.
    """
    members = _user_names(structure, junctions)
    verb = "contradict each other" if len(sources) > 1 else "meets a balance without a solution"
    what = "sources" if len(sources) > 1 else "source"
    cancelling = any(structure.junctions[name].elements for name in junctions)
    reason = "the elements there cancel, nothing is left" if cancelling else "no element stands between"
    kinds = {structure.junctions[name].kind for name in junctions}
    drawn = [name for name in junctions if structure.junctions[name].members]
    remedy = "Put an element (a resistance, say) on a junction in between"
    if len(kinds) == 1 and drawn:
        element, kind = ("an R or a C", "0") if kinds == {"0"} else ("an R or an I", "1")
        remedy = f"Put {element} on the {kind}-junction '{_user_names(structure, drawn[:1])[0]}'"
        remedy += " or one of the others" if len(drawn) > 1 else ""
    return Singular(
        f"{what} {_quoted(sources)} {verb} through {_quoted(members)}: {reason} to take up the difference",
        remedy=f"{remedy}, or drop a source.",
        names=(*sources, *members),
    )


def _not_determined(structure: JunctionStructure, junctions: Iterable[str]) -> Singular:
    """Return the error for common variables that the equations leave open."""
    junctions = list(junctions)
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
    """Return the user's junctions in these; of a bare one the nodes that it was put between."""
    names: dict[str, None] = {}
    queue = list(junctions)
    while queue:
        name = queue.pop(0)
        if name in structure.graph.nodes and name not in structure.junctions:
            names[name] = None
            continue
        junction = structure.junctions[name]
        names |= dict.fromkeys(junction.members)
        queue[:0] = [] if junction.members else [node for node in junction.between if node not in names]
    return list(names)


def _quoted(names: Sequence[str]) -> str:
    quoted = [f"'{name}'" for name in names]
    if len(quoted) > _MAX_QUOTED_NODES:
        return f"{', '.join(quoted[:_MAX_QUOTED_NODES])} and {len(quoted) - _MAX_QUOTED_NODES} more"
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


# --- rank tests -----------------------------------------------------------------------------------

#: Coefficients by the name of a junction, none of them zero.
Sparse = dict[str, int]


@dataclass(frozen=True)
class _Undetermined:
    """A set of junctions whose common variables the equations leave open together."""

    vector: Sparse  # a null vector of the nodal form of smallest support: coefficients by junction
    error: Singular  # what to raise where a requested output depends on them


def _modular_nodal_form(
    structure: JunctionStructure, point: ModularPoint, junctions: Iterable[str]
) -> tuple[dict[str, Sparse], dict[str, Sparse]]:
    """Return the balances of junctions that no source fixes, and what every source contributes to them."""
    sources = [name for name, node in structure.graph.nodes.items() if node.type in SOURCES]
    program = Program(point)
    net = NodalNetwork(structure, program, dict.fromkeys(junctions, 0), sources)
    rows: dict[str, Sparse] = {name: {} for name in net.rows}
    driven: dict[str, Sparse] = {}
    for name, row in net.rows.items():
        for column, entry in [(row, net.diagonal(row)), *row.entries.items()]:
            if not program.is_zero(entry):
                rows[name][column.name] = int(program.image(entry))
        for source, amount in row.sources.items():
            driven.setdefault(source, {})[name] = int(program.image(amount))
    return rows, driven


def undetermined(structure: JunctionStructure, junctions: Iterable[str] | None = None) -> list[_Undetermined]:
    """Return the variables that some equations leave open; none where the solution is unique.

    `junctions`: junctions that no others influence but through fixed ones; default: all. Raises `Singular`
    where sources contradict each other: for some values of them there is no solution.
    """
    candidates = structure.junctions if junctions is None else junctions
    names = [name for name in candidates if structure.junctions[name].fixing is None]
    if not names:
        return []
    graph = structure.graph
    values = {name: node.value for name, node in graph.nodes.items() if node.value is not None}
    if graph.field is None:
        points = [numeric_point(values, prime) for prime in islice(primes_for(values.values()), 2)]
    else:
        points = [field_point(values, graph.field)]
    for point in points:
        rows, contributions = _modular_nodal_form(structure, point, names)
        elimination = _SparseElimination(rows, point.prime)
        if not elimination.free:
            return []
    # a contradiction: a left null vector that does not annihilate the sources; the smallest is reported
    transposed: dict[str, Sparse] = {name: {} for name in rows}
    for name, row in rows.items():
        for column, entry in row.items():
            transposed[column][name] = entry
    smallest: tuple[list[str], list[str]] | None = None
    for vector in _SparseElimination(transposed, point.prime).null_vectors():
        sources = [name for name, driven in contributions.items() if _product(driven, vector, point.prime)]
        if sources and (smallest is None or len(vector) < len(smallest[0])):
            smallest = list(vector), [name for name in graph.nodes if name in sources]
    if smallest is not None:
        raise no_solution(structure, *smallest)
    vectors = elimination.null_vectors()
    return [_Undetermined(vector, _not_determined(structure, vector)) for vector in vectors]


def hold(structure: JunctionStructure, outputs: Iterable[Port]) -> list[_Undetermined]:
    """Fix undetermined variables at zero that no output depends on: the rest has a unique solution.

    `structure`: the junction structure; junctions that are undetermined become fixed ones. Raises `Singular`
    where sources contradict each other, or an output depends on what is undetermined.
    """
    parts = undetermined(structure)
    for port in outputs:
        for undetermined_part in sorted(parts, key=lambda undetermined_part: len(undetermined_part.vector)):
            if structure.place[port.node] in undetermined_part.vector and _is_answer(structure, port):
                raise undetermined_part.error
    for undetermined_part in parts:
        structure.junctions[next(iter(undetermined_part.vector))].fixing = UNDETERMINED
    return parts


def _is_answer(structure: JunctionStructure, port: Port) -> bool:
    """Test whether a variable depends on the common variable of its junction.

    The reaction of a source needs no test: by reciprocity a source that reacts to an undetermined variable
    drives it, which is a contradiction and was raised before.
    """
    graph, quantity = structure.graph, structure.graph.behind(port).quantity
    node, junction = graph.nodes[port.node], structure.junctions[structure.place[port.node]]
    if node.type in SOURCES and quantity == ("e" if node.type == "Se" else "f"):
        return False
    return quantity == ("f" if junction.kind == "1" else "e") or bool(node.value)


def explain(structure: JunctionStructure) -> Singular:
    """Return the error for a graph without a unique solution."""
    try:
        parts = undetermined(structure)
    except Singular as error:
        return error
    if parts:
        return min(parts, key=lambda undetermined_part: len(undetermined_part.vector)).error
    return Singular(
        "the equations of this graph have a unique solution for its values, but not for general ones",
        remedy="Give elements that cancel other values.",
    )


def _product(row: Mapping[str, int], vector: Mapping[str, int], prime: int) -> int:
    return sum(entry * vector[name] for name, entry in row.items() if name in vector) % prime


class _SparseElimination:
    """Sparse elimination modulo a prime: the shortest row first, by its column with the fewest rows.

    `free`: columns without a pivot: as many as the rank is short of the size.
    """

    def __init__(self, rows: Mapping[str, Sparse], prime: int) -> None:
        self._prime = prime
        left = {name: dict(row) for name, row in rows.items()}
        rows_with: dict[str, set[str]] = {name: set() for name in rows}
        for name, row in rows.items():
            for column in row:
                rows_with[column].add(name)
        self._pivots: list[tuple[str, Sparse]] = []
        turns = [(len(row), index, name) for index, (name, row) in enumerate(rows.items()) if row]
        places = {name: index for _, index, name in turns}
        heapq.heapify(turns)
        while turns:
            length, _, name = heapq.heappop(turns)
            if len(left.get(name, ())) != length:
                continue  # eliminated already, or queued again with another length
            row = left.pop(name)
            pivot = min(row, key=lambda column: len(rows_with[column]))
            inverse = pow(row[pivot], -1, prime)
            for column in row:
                rows_with[column].discard(name)
            for row_below in rows_with.pop(pivot):
                target = left[row_below]
                factor = -target[pivot] * inverse % prime
                for column, entry in row.items():
                    if total := (target.get(column, 0) + factor * entry) % prime:
                        target[column] = total
                    else:
                        target.pop(column, None)
                    if column != pivot:
                        (rows_with[column].add if column in target else rows_with[column].discard)(row_below)
                if target:
                    heapq.heappush(turns, (len(target), places[row_below], row_below))
            self._pivots.append((pivot, row))
        pivoted = {column for column, _ in self._pivots}
        self.free = [name for name in rows if name not in pivoted]

    def null_vectors(self) -> Iterable[Sparse]:
        """Yield a basis of the right null space, each vector of smallest support, its free column first."""
        for free in self.free:
            vector = {free: 1}
            for pivot, row in reversed(self._pivots):
                total = _product(row, vector, self._prime)
                if total:
                    vector[pivot] = -total * pow(row[pivot], -1, self._prime) % self._prime
            yield vector
