"""The finite roots of det(s E - A) for a sparse square system of equations, in floating point.

The system falls apart into its irreducible blocks (Dulmage and Mendelsohn), which is an exact deflation: an
index-500 channel of a chain leaves blocks of one root each. Within a block an exact index reduction leaves
the states alone, so that their number is right by construction. Their matrix gives first values of the
roots, which are then refined on the sparse equations as they were written, by inverse iteration from both
sides, and judged there entry by entry: neither the values nor the error estimates change with the units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.arrays import finite, guarded
from dynid.bondgraph.descriptor import (
    Descriptor,
    LinearForm,
    NumberField,
    constrained,
    irreducible_blocks,
    solve,
)
from dynid.bondgraph.floating.roots import RootDiscs
from dynid.bondgraph.graph import Port
from dynid.bondgraph.reduced_graph import Channel, ReducedGraph
from dynid.errors import NumericalError, Undecided

if TYPE_CHECKING:
    from numpy.typing import NDArray


#: Solves with the matrices at several numbers s (s x unknown), or their adjoints ("H").
_Solver = Callable[["NDArray[np.complex128]", str], "NDArray[np.complex128]"]

# --- eigenvalues, refined -------------------------------------------------------------------------

_UNIT_ROUNDOFF = 2.0**-53
#: What the error estimate allows for: coefficients rounded once, and the rounding of a sparse solution.
_ERROR_FACTOR = 8.0
#: Inverse iterations on one factorisation, and factorisations before a root is left as it is.
_MAX_INVERSE_ITERATIONS, _MAX_FACTORISATIONS = 2, 4
#: What is allowed for the correction that follows one, over its square by the room around the root.
_NEXT_CORRECTION_FACTOR = 64.0
#: Most states of a block whose characteristic polynomial is computed: 2 s for 60 with 53 bits an entry.
MAX_CERTIFIED_STATES = 60
#: Entries of the matrices at several roots that are factorised together: beyond, factors leave the caches.
_MAX_BATCH_ENTRIES = 50_000
#: How far beside a root its equations are factorised, if they are exactly singular at it.
_SINGULAR_SHIFTS = (_UNIT_ROUNDOFF, 2.0**-40, 2.0**-26, 2.0**-18)


def spectrum(equations: Sequence[LinearForm], *, exact: bool = False) -> RootDiscs:
    """Return the roots of the determinant of equations, with error estimates.

    `equations`: as many forms that equal zero as there are unknowns, with exact coefficients. `exact`: True:
    roots of blocks of up to `MAX_CERTIFIED_STATES` states are certified. Raises `Singular` where the
    determinant vanishes.
    """
    parts = []
    for block in irreducible_blocks(equations):
        if exact and (discs := _certified(block.forms)) is not None:
            parts.append(discs)
            continue
        states = _states(block.forms)
        if len(states) == 1:  # exact, rounded once
            value, error = states[0].astype(np.complex128), _UNIT_ROUNDOFF * np.abs(states[0])
            parts.append(RootDiscs(value, error, np.zeros(1)))
        elif len(states):
            parts.append(_Pencil(block.forms).refined(_eigenvalues(states)))
    return RootDiscs.joined(parts)


def refined(equations: Sequence[LinearForm], starts: NDArray[np.complex128]) -> RootDiscs:
    """Return roots of the determinant of equations near first values of all of them, with error estimates."""
    return _Pencil(list(equations)).refined(starts) if len(starts) else RootDiscs.none()


def _certified(block: list[LinearForm]) -> RootDiscs | None:
    """Return the roots of a block from its characteristic polynomial; None where it has too many states."""
    from flint import fmpq_mat

    from dynid.arithmetic.field_polynomials import FieldPolynomial
    from dynid.lti.certified_roots import certified_roots

    rates = solve(block, [])[0] if len(block) > 1 else {}
    if not 1 < len(rates) <= MAX_CERTIFIED_STATES:
        return None
    matrix = fmpq_mat(len(rates), len(rates))
    index_of, field = {name: k for k, name in enumerate(rates)}, None
    for name, form in rates.items():
        for symbol, value in form.items():
            field = getattr(value, "field", None)  # all are irrational, or none
            matrix[index_of[name], index_of[symbol[1]]] = value if field is None else value.value
    monic = matrix.charpoly()
    polynomial = monic.numer() if field is None else FieldPolynomial(field, monic)
    roots = [root for root in certified_roots(polynomial) for _ in range(root.multiplicity)]
    values, radii = (np.array([getattr(root, name) for root in roots]) for name in ("value", "radius"))
    return RootDiscs(values.astype(np.complex128), radii, np.zeros(len(roots)))


def first_values(equations: Sequence[LinearForm]) -> list[complex]:
    """Return the roots of the determinant of equations as the eigenvalues come, without any judgement."""
    states = [_states(block.forms) for block in irreducible_blocks(equations)]
    return [
        complex(s) for matrix in states for s in (_eigenvalues(matrix) if len(matrix) > 1 else matrix.ravel())
    ]


def _states(block: list[LinearForm]) -> NDArray[np.float64]:
    """Return the matrix of the state equations that a block comes down to."""
    if len(block) == 1:
        return _state(block[0])
    rates, _ = solve(block, [])
    index_of = {name: k for k, name in enumerate(rates)}
    matrix = np.zeros((len(index_of), len(index_of)))
    for name, form in rates.items():
        for symbol, value in form.items():
            matrix[index_of[name], index_of[symbol[1]]] = _float(value)
    finite("a coefficient of the state equations", matrix)
    return matrix


def _state(form: LinearForm) -> NDArray[np.float64]:
    """Return the same of one equation in one unknown."""
    slope = next((value for symbol, value in form.items() if symbol[0] == "dw"), None)
    if slope is None:
        return np.zeros((0, 0))
    constant = next((value for symbol, value in form.items() if symbol[0] == "w"), 0)
    matrix = np.array([[_float(-constant / slope) if constant else 0.0]])
    finite("a coefficient of the state equations", matrix)
    return matrix


def _eigenvalues(matrix: NDArray[np.float64]) -> NDArray[np.complex128]:
    with guarded("the eigenvalues of the state equations"):
        return np.linalg.eigvals(matrix).astype(np.complex128)


def _float(value: Any) -> float:
    """Round an exact number to a double, to infinity beyond its range."""
    try:
        return int(value.p) / int(value.q) if value else 0.0
    except OverflowError:
        return float(np.inf)


#: Size of a pencil from which its columns are ordered once, and real roots have real factors.
_ORDERED_ONCE = 100


class _Pencil:
    """The equations of a block as a sparse matrix A + s E."""

    def __init__(self, block: list[LinearForm]) -> None:
        column_of: dict[str, int] = {}
        entries: dict[tuple[int, int], list[float]] = {}
        for row, form in enumerate(block):
            for symbol, value in form.items():
                column = column_of.setdefault(symbol[1], len(column_of))
                entries.setdefault((row, column), [0.0, 0.0])[symbol[0] == "dw"] = _float(value)
        self.size = len(block)
        keys = np.array(list(entries), dtype=np.int32)
        values = np.array(list(entries.values()))
        self.large = self.size >= _ORDERED_ONCE
        if self.large:
            keys[:, 1] = _elimination_order(keys, self.size)[keys[:, 1]]
        order = np.lexsort((keys[:, 0], keys[:, 1]))  # compressed by columns
        self.rows, self.columns = np.ascontiguousarray(keys[order].T)
        self.constant, self.slope = np.ascontiguousarray(values[order].T)
        finite("a coefficient of the equations", self.constant, self.slope)
        self.starts_of = np.searchsorted(self.columns, np.arange(self.size + 1)).astype(np.int32)
        self.by_row = np.argsort(self.rows, kind="stable")
        self.row_starts = np.searchsorted(self.rows[self.by_row], np.arange(self.size))
        self.unit = 1.0  # rad/s: the largest root
        self.seed = np.random.default_rng(0).uniform(0.5, 1.5, self.size)

    def refined(self, starts: NDArray[np.complex128]) -> RootDiscs:
        """Refine roots that come in conjugate pairs; those of the lower half-plane follow the upper ones."""
        upper = starts[starts.imag >= 0]
        self.unit = float(np.max(np.abs(starts))) or 1.0
        nearest = np.full(len(starts), np.inf)
        if len(starts) > 1:
            apart = np.abs(starts[:, None] - starts[None, :])
            np.fill_diagonal(apart, np.inf)
            nearest = apart.min(axis=1)
        rooms = nearest[starts.imag >= 0]
        group = max(1, _MAX_BATCH_ENTRIES // len(self.constant))
        parts_of_upper = [
            self._refined(upper[first : first + group], rooms[first : first + group])
            for first in range(0, len(upper), group)
        ]
        value, radius, residual = (np.concatenate(columns) for columns in zip(*parts_of_upper, strict=True))
        value = np.where(upper.imag == 0, value.real, value)  # a real root alone stays real
        pairs = upper.imag > 0
        parts = [
            RootDiscs(value.astype(np.complex128), radius, residual),
            RootDiscs(value[pairs].conj().astype(np.complex128), radius[pairs], residual[pairs]),
        ]
        return RootDiscs.joined(parts)

    def _refined(
        self, starts: NDArray[np.complex128], rooms: NDArray[np.float64]
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
        """Return roots, their error estimates and their residuals.

        A correction that leaves the root's own surroundings is not followed: roots that (nearly) coincide are
        left where they were found, and their estimate covers the correction.
        """
        roots, (coarse, errors, residuals) = starts.copy(), np.zeros((3, len(starts)))
        active = np.arange(len(starts))
        for _ in range(_MAX_FACTORISATIONS):
            value = roots[active]
            vectors = self._null_vectors(value)
            correction, sensitivity, residuals[active] = self._judged(value, *vectors)
            error = np.abs(correction) + _ERROR_FACTOR * _UNIT_ROUNDOFF * sensitivity
            coarse[active] = np.where(coarse[active], coarse[active], 4 * error)
            roots[active] = value + correction
            rounding = _UNIT_ROUNDOFF * np.abs(value)
            errors[active] = 2 * error + rounding
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                lost = ~(np.abs(roots[active] - starts[active]) <= rooms[active] / 4)  # nan, too
                ratio = np.abs(correction) / rooms[active]
                rest = _NEXT_CORRECTION_FACTOR * np.abs(correction) * ratio
                rest *= np.maximum(1.0, sensitivity / np.abs(value))
                done = np.abs(correction) <= 0.5 * _UNIT_ROUNDOFF * sensitivity + rounding
                # another factorisation would find nothing but rounding
                last = ~(lost | done) & (value != 0) & (rest <= rounding)
            left = active[lost]
            roots[left] = starts[left]
            errors[left] = np.where(np.isfinite(coarse[left]), coarse[left], np.inf)
            if last.any():
                at, (x, y) = active[last], (vector[last] for vector in vectors)
                value = roots[at]
                correction, sensitivity, residuals[at] = self._judged(value, x, y)
                error = np.abs(correction) + rest[last] + _ERROR_FACTOR * _UNIT_ROUNDOFF * sensitivity
                roots[at] = value + correction
                errors[at] = 2 * error + _UNIT_ROUNDOFF * np.abs(value)
            active = active[~(lost | done | last)]
            if not len(active):
                break
        return roots, errors, residuals

    def _judged(
        self, s: NDArray[np.complex128], x: NDArray[np.complex128], y: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64], NDArray[np.float64]]:
        """Return the corrections of roots, the sizes of their errors in units of rounding, and residuals.

        With the null vectors x, y of P(s) = A + s E, or of one close to it: a change of the entries by a part
        u of themselves moves the root by at most u |y|^T (|A| + |s| |E|) |x| / |y^H E x|.
        """
        entries = self.constant + s[:, None] * self.slope
        sizes = np.abs(self.constant) + np.abs(s)[:, None] * np.abs(self.slope)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            # close to a root they are very long
            x, y = (vector / np.max(np.abs(vector), axis=1, keepdims=True) for vector in (x, y))
            left, right = y.conj()[:, self.rows], x[:, self.columns]
            slope = np.sum(left * self.slope * right, axis=1)
            correction = -np.sum(left * entries * right, axis=1) / slope
            sensitivity = np.sum(np.abs(left) * sizes * np.abs(right), axis=1) / np.abs(slope)
            return correction, sensitivity, np.abs(correction) / sensitivity

    def _null_vectors(
        self, s: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return right and left null vectors of the equilibrated matrices at numbers s (s x unknown).

        Each is solved for from the other, as singular vectors: from itself a right vector that is nearly
        orthogonal to the left one would lose what it has gained (Ipsen 1997, section 5).
        """
        reach = np.maximum(np.abs(s), _UNIT_ROUNDOFF * self.unit)
        sizes = np.abs(self.constant) + reach[:, None] * np.abs(self.slope)
        row, column = np.ones((2, len(s), self.size))  # powers of two
        for _ in range(2):
            scaled = (sizes * row[:, self.rows] * column[:, self.columns])[:, self.by_row]
            row /= np.exp2(np.round(np.log2(np.maximum.reduceat(scaled, self.row_starts, axis=1))))
            scaled = sizes * row[:, self.rows] * column[:, self.columns]
            column /= np.exp2(np.round(np.log2(np.maximum.reduceat(scaled, self.starts_of[:-1], axis=1))))
        scale = row[:, self.rows] * column[:, self.columns]
        at = s.real if self.large and not s.imag.any() else s
        solve = self._solver(at, reach, scale)
        x = np.tile(self.seed.astype(at.dtype), (len(s), 1))
        for _ in range(_MAX_INVERSE_ITERATIONS):
            y = solve(x / np.max(np.abs(x), axis=1, keepdims=True), "H")
            x = solve(y / np.max(np.abs(y), axis=1, keepdims=True), "N")
        return np.asarray(x * column, np.complex128), np.asarray(y * row, np.complex128)

    def _solver(self, s: NDArray[Any], reach: NDArray[np.float64], scale: NDArray[np.float64]) -> _Solver:
        """Factorise the equilibrated matrices; one that is exactly singular a little beside its root."""
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import splu

        count, n = len(s), self.size
        # one matrix of all, block by block: each factorisation by itself would cost its overhead
        first = np.arange(count, dtype=np.int32)[:, None]
        rows, starts = (first * n + self.rows).ravel(), (first * len(self.rows) + self.starts_of[:-1]).ravel()
        starts = np.append(starts, np.int32(count * len(self.rows)))
        nearby = (0.0, *(share * size for size in (reach[0], self.unit) for share in _SINGULAR_SHIFTS))
        # Columns that are ordered already, one at a time: the others have less fill than in panels.
        options: dict[str, Any] = {}
        if self.large:
            options = {"permc_spec": "NATURAL", "relax": 1, "panel_size": 1}
        for shift in nearby if count == 1 else (0.0,):
            entries = (self.constant + (s[:, None] + shift) * self.slope) * scale
            matrix = csc_array((entries.ravel(), rows, starts), shape=(count * n, count * n))
            try:
                factors: Any = splu(matrix, **options)
            except RuntimeError:
                continue
            return lambda b, trans: factors.solve(b.ravel(), trans=trans).reshape(count, n)
        if count == 1:
            raise Undecided(
                f"the floating-point engine cannot resolve the roots near {s[0]:.6g} rad/s",
                remedy="Use 'analysis.engine: exact', which does.",
            )
        halves = [slice(0, count // 2), slice(count // 2, count)]
        solvers = [self._solver(s[half], reach[half], scale[half]) for half in halves]
        return lambda b, trans: np.concatenate(
            [solve(b[half], trans) for solve, half in zip(solvers, halves, strict=True)]
        )


def _elimination_order(keys: NDArray[np.int32], size: int) -> NDArray[np.int32]:
    """Return the positions of columns in an order with little fill; as they are where none is found."""
    from scipy.sparse import csc_array
    from scipy.sparse.linalg import splu

    generic = np.random.default_rng(0).uniform(0.5, 1.5, len(keys))
    try:
        return np.asarray(splu(csc_array((generic, keys.T), shape=(size, size))).perm_c)
    except RuntimeError:  # singular whatever its entries
        return np.arange(size, dtype=np.int32)


# --- systems of equations -------------------------------------------------------------------------

#: Most storage elements whose eigenvalues are sought: the matrix is dense.
_MAX_DENSE_STORAGES = 8000


def natural_equations(reduced: ReducedGraph, port: Port) -> list[LinearForm]:
    """Return the equations of the part behind an output without inputs: their roots are its natural modes."""
    _check_size(reduced)
    junctions = reduced.reductions[port].junctions
    return Descriptor(reduced.structure, junctions, NumberField.rational(reduced.graph)).equations


def zero_equations(reduced: ReducedGraph, channel: Channel) -> list[LinearForm]:
    """Return the equations with the input unknown and the output held at zero: zeros, and hidden modes."""
    _check_size(reduced)
    return constrained(reduced, *channel, NumberField.rational(reduced.graph))[1]


def _check_size(reduced: ReducedGraph) -> None:
    if len(reduced.storages) > _MAX_DENSE_STORAGES:
        raise NumericalError(
            f"zeros and poles of {len(reduced.storages):,} storages are beyond dense eigenvalues "
            f"(at most {_MAX_DENSE_STORAGES:,})",
            remedy="Ask for the frequency response, which needs no roots, or for a smaller part.",
        )
