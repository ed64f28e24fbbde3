"""The frequency response of a graph on many loops, from its sparse nodal matrix.

One-ports stand on the diagonal of the balances of all junctions, bonds and two-ports beside it. Junctions
between two others are eliminated in formulas: of a mesh the matrix of its nodes is left. It is factorised at
every frequency in one order of elimination. The factors also solve the transposed equations of the outputs:
their solution, times the residual of that of the inputs in extended precision, corrects the response to
second order and bounds its error (Pierce and Giles 2000; Higham 2002, section 12.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.graph import SOURCES, BondGraph, Port, bond_sign
from dynid.bondgraph.reduction.network import reach
from dynid.defaults import NODAL_RESPONSES

if TYPE_CHECKING:
    from dynid.bondgraph.reduction.junctions import JunctionStructure

Extended = NDArray[np.longdouble]

_PARTS_OF_FRACTIONS = ("numerator", "denominator")
#: Equations that are factorised at a time: those of several frequencies, where a graph is small.
_EQUATIONS_AT_ONCE = 4000
#: An off-diagonal pivot is taken only where the diagonal one is this much smaller.
_PIVOT_RATIO = 1e-3
#: Roundings of an entry of the matrix, and of a product with it: as many sums as its row has entries follow.
_ROUNDINGS = 16
_EXTENDED_ROUNDOFF = float(np.finfo(np.longdouble).eps)
#: By how much the correction of a solution may exceed the one that the factors give, which are rounded.
_CORRECTION_FACTOR = 4.0
#: A correction that is a larger part of the solution shows factors that are not to be trusted.
_MAX_CORRECTION = 1e-6


class _Pattern(NamedTuple):
    """The nonzero entries of the nodal matrix, by columns, in the order of elimination."""

    rows: NDArray[np.int32]
    starts: NDArray[np.int32]
    constant: Extended  # what does not depend on s
    products: Any  # factors of the reciprocal immittances of eliminated junctions (sparse)
    product_sizes: Any  # their absolute values, as doubles
    diagonal: NDArray[np.int64]  # the places of the diagonal
    laws: Extended  # of the junctions on it
    drives: NDArray[np.float64]  # (junction, input)
    readings: NDArray[np.float64]  # (junction, output)
    fill: float  # products of an elimination, per equation


class NodalResponse:
    """The balances of all junctions of a graph that lie behind each of its outputs."""

    def __init__(self, structure: JunctionStructure, inputs: Sequence[str], outputs: Sequence[Port]) -> None:
        graph, junctions = structure.graph, structure.junctions
        self._structure, self._inputs, self._outputs = structure, inputs, outputs
        row_of = {name: k for k, name in enumerate(n for n, j in junctions.items() if j.fixing is None)}
        on = [(row, junctions[name].kind, element) for name, row in row_of.items()
              for element in junctions[name].elements]  # fmt: skip
        parts = [_part(graph, element, kind) for _, kind, element in on]
        values = _extended([graph.value(element) for *_, element in on])
        inverse = np.array([inverted for _, inverted in parts], dtype=bool)
        self._laws = np.zeros((len(row_of), 3), dtype=np.longdouble)
        at = [row for row, *_ in on], [column for column, _ in parts]
        np.add.at(self._laws, at, np.where(inverse, 1 / values, values))
        self._drives = np.zeros((len(row_of), len(inputs)), dtype=np.longdouble)
        column_of = {name: column for column, name in enumerate(inputs)}
        for name, row in row_of.items():
            for source, sign in junctions[name].feeding:
                if source in column_of:
                    self._drives[row, column_of[source]] += sign
        entries: list[tuple[int, int, Any]] = []
        for coupling in structure.couplings:
            size = np.longdouble(1)
            if coupling.two_port is not None:
                (size,) = _extended([graph.value(coupling.two_port)])
                size = 1 / size if coupling.inverse else size
            for name, neighbour, sign in coupling.entries:
                if name in row_of and neighbour in row_of:
                    entries.append((row_of[name], row_of[neighbour], sign * size))
                elif name in row_of and (fixing := junctions[neighbour].fixing) in column_of:
                    self._drives[row_of[name], column_of[str(fixing)]] -= sign * size
        self._entries = entries
        self._roots = [row_of[structure.place[graph.behind(port).node]] for port in outputs]

    @classmethod
    def of(cls, structure: JunctionStructure, inputs: Sequence[str], outputs: Sequence[Port]) -> Self | None:
        """Return it where the structure shows that the graph has a unique solution, and its loops fill it.

        Where all values are positive, so are the real parts of all immittances at s > 0, and junctions with
        elements are at rest without sources. Only junctions without any could be open: each must be fixed by
        a balance in which no other is. Other graphs are None.
        """
        graph, junctions = structure.graph, structure.junctions
        if structure.rings or graph.field is not None or any(c.one_way for c in structure.couplings):
            return None
        if any(not value > 0 for node in graph.nodes.values() if (value := node.value) is not None):
            return None
        roots = {structure.place[graph.behind(port).node] for port in outputs}
        free = sum(junction.fixing is None for junction in junctions.values())
        if any(junctions[root].fixing is not None or len(reach(structure, root)) < free for root in roots):
            return None
        if any(graph.nodes[port.node].type in SOURCES and _answers(structure, port) for port in outputs):
            return None
        response = cls(structure, inputs, outputs)
        if not response._is_unique():
            return None
        return response if response._pattern.fill > NODAL_RESPONSES.value else None

    def _is_unique(self) -> bool:
        open_rows = set(np.flatnonzero(~self._laws.any(axis=1)).tolist())
        around: list[list[int]] = [[] for _ in self._laws]
        for row, column, _ in self._entries:
            around[row].append(column)
        waiting = list(range(len(around))) if open_rows else []
        while waiting:
            row = waiting.pop()
            unknown = [column for column in around[row] if column in open_rows]
            if len(unknown) == 1 and row not in open_rows:
                open_rows.discard(unknown[0])
                waiting += [*around[unknown[0]], unknown[0]]
        return not open_rows

    def dropped(self) -> tuple[str, ...]:
        """Return the nodes that no output depends on: what ideal sources separate, and sources at zero."""
        junctions, couplings = self._structure.junctions, self._structure.couplings
        driving = {name for name, column in zip(self._inputs, self._drives.T, strict=True) if column.any()}
        kept = driving | {port.node for port in self._outputs}
        for junction in junctions.values():
            if junction.fixing is None or junction.fixing in driving:
                kept.update(junction.members)
            if junction.fixing is None:
                kept.update(junction.elements)
        for coupling in couplings:
            fixing = [junctions[end].fixing for end in (coupling.tail, coupling.head)]
            if coupling.two_port is not None and None in fixing and {*fixing} <= {None, *driving}:
                kept.add(coupling.two_port)
        return tuple(name for name in self._structure.graph.nodes if name not in kept)

    @cached_property
    def _eliminated(self) -> NDArray[np.bool_]:
        """Which junctions are eliminated in formulas: those with elements, between two that are not."""
        kept: NDArray[np.bool_] = np.asarray(self._drives.any(axis=1) | ~self._laws.any(axis=1))
        kept[self._roots] = True
        around: list[list[int]] = [[] for _ in self._laws]
        for row, column, _ in self._entries:
            around[row].append(column)
        chosen = np.zeros(len(kept), dtype=np.bool_)
        for row, neighbours in enumerate(around):
            if len(neighbours) == 2 and not kept[row]:
                chosen[row] = kept[neighbours] = True
        return chosen

    @cached_property
    def _pattern(self) -> _Pattern:
        from scipy.sparse import coo_array, csc_array
        from scipy.sparse.linalg import splu

        gone, count = self._eliminated, len(self._laws)
        place: NDArray[np.int64] = (
            np.cumsum(~gone) - 1
        )  # of a junction that is left; of one that is eliminated
        place[gone] = np.arange(np.count_nonzero(gone))
        row, column = (np.array([entry[k] for entry in self._entries], dtype=np.int64) for k in (0, 1))
        value = np.array([entry[2] for entry in self._entries], dtype=np.longdouble)
        size, inner = count - np.count_nonzero(gone), ~gone[row] & ~gone[column]
        outward, inward = (  # two entries from and to each eliminated junction
            entries[np.lexsort((others[entries], ends[entries]))].reshape(-1, 2)
            for ends, others in ((row, column), (column, row))
            for entries in [np.flatnonzero(gone[ends])]
        )
        pairs = [(inward[:, i], outward[:, j]) for i in (0, 1) for j in (0, 1)]
        rows = [np.arange(size), place[row[inner]], *(place[row[into]] for into, _ in pairs)]
        columns = [np.arange(size), place[column[inner]], *(place[column[out]] for _, out in pairs)]
        keys = np.stack([np.concatenate(columns), np.concatenate(rows)])
        unordered = coo_array((np.ones(keys.shape[1]), (keys[1], keys[0])), shape=(size, size)).tocsc()
        unordered.data[:] = -1.0
        unordered.setdiag(np.diff(unordered.indptr) + 1.0)
        options = {"SymmetricMode": True}
        factors = splu(unordered, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        order = np.asarray(factors.perm_c, dtype=np.int64)
        distinct, at = np.unique(order[keys[0]] * size + order[keys[1]], return_inverse=True)
        constant = np.zeros(len(distinct), dtype=np.longdouble)
        inner_end = size + np.count_nonzero(inner)
        np.add.at(constant, at[size:inner_end], value[inner])
        terms = np.concatenate([-value[into] * value[out] for into, out in pairs])
        middles = np.tile(np.arange(len(inward)), len(pairs))
        products = csc_array((terms, (at[inner_end:], middles)), shape=(len(distinct), max(len(inward), 1)))
        laws = np.empty((size, 3), dtype=np.longdouble)
        drives, readings = np.empty((size, len(self._inputs))), np.zeros((size, len(self._outputs)))
        laws[order], drives[order] = self._laws[~gone], self._drives[~gone]
        readings[order[place[self._roots]], np.arange(len(self._roots))] = 1.0
        starts = np.searchsorted(distinct, np.arange(size + 1) * size)
        fill = float(np.sum(np.diff(factors.L.indptr).astype(float) ** 2)) / size
        return _Pattern(
            rows=(distinct % size).astype(np.int32),
            starts=starts.astype(np.int32),
            constant=constant,
            products=products,
            product_sizes=abs(products).astype(float),
            diagonal=at[:size][np.argsort(order)],
            laws=laws,
            drives=drives,
            readings=readings,
            fill=fill,
        )

    def at(self, omega: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
        """Return T(j omega) and bounds on its error, both of shape (omega, output, input)."""
        shape = len(omega), len(self._outputs), len(self._inputs)
        response, bounds = np.empty(shape, dtype=np.complex128), np.empty(shape)
        step = max(1, _EQUATIONS_AT_ONCE // len(self._pattern.laws))
        with np.errstate(all="ignore"):  # what is not finite has no bound
            for start in range(0, len(omega), step):
                some = slice(start, start + step)
                response[some], bounds[some] = self._solved(omega[some])
            weights = np.stack([_weight(self._structure, port, omega) for port in self._outputs], axis=1)
            return response * weights[..., None], bounds * np.abs(weights)[..., None]

    def _solved(self, omega: NDArray[np.float64]) -> tuple[Any, Any]:
        """Return the common variables of the outputs' junctions, and bounds on their errors."""
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        pattern, count, size = self._pattern, len(omega), len(self._pattern.laws)
        diagonal, diagonal_sizes = _immittances(pattern.laws, omega)
        middle, middle_sizes = _immittances(self._laws[self._eliminated], omega)
        if not len(middle):  # one that no entry takes
            middle, middle_sizes = np.ones((1, count), np.clongdouble), np.ones((1, count))
        entries = pattern.constant[:, None] + pattern.products @ (1 / middle)
        ratios = middle_sizes / abs(middle.astype(complex)) ** 2
        sizes = abs(pattern.constant).astype(float)[:, None] + pattern.product_sizes @ ratios
        entries[pattern.diagonal] += diagonal
        sizes[pattern.diagonal] += diagonal_sizes
        rows = (pattern.rows + size * np.arange(count, dtype=np.int32)[:, None]).ravel()
        shifts = pattern.starts[-1] * np.arange(count, dtype=np.int32)[:, None]
        starts = np.append((pattern.starts[:-1] + shifts).ravel(), len(rows)).astype(np.int32)

        def stacked(values: Any) -> Any:
            return csc_array((values.T.ravel(), rows, starts), shape=2 * (size * count,))

        matrix, magnitudes = stacked(entries), stacked(sizes)
        if not np.isfinite(matrix.data).all():
            return self._solved_apart(omega)
        drives, readings = np.tile(pattern.drives, (count, 1)), np.tile(pattern.readings, (count, 1))
        options, doubles = {"SymmetricMode": True}, matrix.astype(complex)
        try:
            factors: Any = splu(doubles, "NATURAL", diag_pivot_thresh=_PIVOT_RATIO, options=options)
        except RuntimeError:  # exactly singular
            return self._solved_apart(omega)
        states, weights = factors.solve(drives.astype(complex)), factors.solve(readings.astype(complex), "T")
        residual = (drives - matrix @ states).astype(complex)
        correction, roundings = factors.solve(residual), _ROUNDINGS + np.diff(pattern.starts).max()
        rounded = magnitudes @ abs(states) + abs(drives)  # times the roundings of extended precision
        weight_residual = abs(readings - doubles.T @ weights)
        weight_residual += roundings * np.finfo(float).eps * (magnitudes.T @ abs(weights) + readings)

        def products(left: Any, right: Any) -> Any:
            return np.einsum("mno,mni->moi", *(x.reshape(count, size, -1) for x in (left, right)))

        response = products(readings, states) + products(weights, residual)
        bound = roundings * _EXTENDED_ROUNDOFF * products(abs(weights), rounded)
        bound += _CORRECTION_FACTOR * products(weight_residual, abs(correction))
        largest, change = (abs(x).reshape(count, size, -1).max(axis=1) for x in (states, correction))
        bound[np.broadcast_to((change > _MAX_CORRECTION * largest)[:, None], bound.shape)] = np.inf
        return response, bound + np.finfo(float).eps * abs(response)

    def _solved_apart(self, omega: NDArray[np.float64]) -> tuple[Any, Any]:
        """Return the same of each frequency alone, with an infinite bound where it cannot be solved."""
        if len(omega) == 1:
            shape = 1, len(self._outputs), len(self._inputs)
            return np.zeros(shape, dtype=complex), np.full(shape, np.inf)
        responses, bounds = zip(*(self._solved(frequency) for frequency in omega[:, None]), strict=True)
        return np.concatenate(responses), np.concatenate(bounds)


def _extended(values: Sequence[Fraction]) -> Extended:
    """Round values to extended precision."""
    numerators, denominators = ([getattr(value, name) for value in values] for name in _PARTS_OF_FRACTIONS)
    return np.array(numerators, dtype=np.longdouble) / np.array(denominators, dtype=np.longdouble)


def _part(graph: BondGraph, element: str, kind: str) -> tuple[int, bool]:
    """Return the part of an immittance that an element is, of 1, s and 1/s, and whether by its reciprocal."""
    node = graph.nodes[element].type
    if node == "R":
        return 0, kind == "0"
    return (1, False) if (kind == "1") is (node == "I") else (2, True)


def _immittances(laws: Extended, omega: NDArray[np.float64]) -> tuple[Any, NDArray[np.float64]]:
    """Return immittances at j omega, and the sums of the sizes of their parts, of shape (junction, omega)."""
    real, slope, integral = laws.T[:, :, None]
    rising, falling = slope * omega, np.where(integral > 0, integral / omega, 0)
    return real + 1j * (rising - falling), (real + rising + falling).astype(float)


def _answers(structure: JunctionStructure, port: Port) -> bool:
    """Test whether an output is not the common variable of its junction, but what a node answers it with."""
    variable = structure.graph.behind(port)
    common = "f" if structure.junctions[structure.place[variable.node]].kind == "1" else "e"
    return variable.quantity != common


def _weight(structure: JunctionStructure, port: Port, omega: NDArray[np.float64]) -> Any:
    """Return an output over the common variable of its junction at j omega."""
    graph, name = structure.graph, port.node
    junction = structure.junctions[structure.place[graph.behind(port).node]]
    weight = np.ones(len(omega), dtype=complex)
    if _answers(structure, port):
        part, inverted = _part(graph, name, junction.kind)
        value = float(graph.value(name)) ** (-1 if inverted else 1)
        weight = value * (1j * omega) ** (0, 1, -1)[part] * bond_sign(graph, name)
    if graph.is_state(port):
        weight = weight * float(graph.value(name)) * bond_sign(graph, name)
    elif port.quantity not in "ef":
        weight = weight / (1j * omega)
    return weight.astype(complex)
