"""Damped Newton iteration on sparse equations of very different units, refined at high precision.

The damping follows Deuflhard (2011), *Newton Methods for Nonlinear Problems*, section 3.3: a step is accepted
where the simplified correction behind it is smaller. That test does not depend on the units of the equations;
the variables are scaled by equilibration of the matrix. Where the matrix is singular the shortest
step is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from dynid.arithmetic.numbers import OutOfRangeError
from dynid.arrays import norm_of_inverse
from dynid.defaults import DENSE_EQUILIBRIUM

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from scipy.sparse import csr_array

    from dynid.bondgraph.operating_point.equations import LawSystem

_MAX_STEPS, _MIN_STEP_FACTOR = 200, 2.0**-20
_CORRECTION_TOL = 1e-11  # of a correction, beside the largest scaled variable
_ROUNDING_CORRECTION = 1e-6  # of a correction that no step makes smaller
_RESIDUAL_BITS = 256
_SINGULAR_TOL = 1e-12  # singular values of the scaled matrix below it count as zero
#: Residual beside the terms of an equation above which the equations are not fulfilled.
CONSISTENT = 1e-9


class Factor:
    """A factorised matrix of corrections.

    `fixed`: columns of variables that are not solved for, which are zero.
    """

    def __init__(self, matrix: csr_array, fixed: Sequence[int] = ()) -> None:
        from scipy.sparse import diags_array

        rows, self.scale = equilibrated(matrix)
        self._rows = rows
        self._matrix = diags_array(rows) @ matrix @ diags_array(self.scale)
        self._fixed = list(fixed)
        self._lu: Any = None
        self._svd: Any = None
        self.condition = np.inf
        if matrix.shape[0] == matrix.shape[1]:
            self._factorise()
        if self._lu is None:
            self._decompose()

    def _factorise(self) -> None:
        from scipy.sparse.linalg import splu

        try:
            lu = splu(self._matrix.tocsc())
        except RuntimeError:  # exactly singular
            return
        rows, solve = self._matrix.shape[0], cast("Any", lu.solve)
        with np.errstate(all="ignore"):
            size = norm_of_inverse(rows, solve, lambda right: solve(right, "T"))
        condition = float(size * abs(self._matrix).sum(axis=0).max())
        large = rows > DENSE_EQUILIBRIUM.value  # then the residual at high precision decides alone
        if np.isfinite(condition) and (large or condition < 1 / _SINGULAR_TOL):
            self._lu, self.condition = lu, condition

    def _decompose(self) -> None:
        """Decompose a singular matrix, or one that is not square, by its singular values."""
        if max(self._matrix.shape) > DENSE_EQUILIBRIUM.value:
            raise OutOfRangeError("the matrix is singular")
        U, s, V = np.linalg.svd(self._matrix.toarray())
        rank = int((s > _SINGULAR_TOL * s[0]).sum()) if len(s) else 0
        self._svd = U[:, :rank], s[:rank], V
        full = rank == self._matrix.shape[1] - len(self._fixed)
        self.condition = float(s[0] / s[rank - 1]) if full else np.inf

    @property
    def free(self) -> NDArray[np.float64]:
        """Directions that the equations leave open: scaled variables x directions."""
        if self._svd is None:
            return np.zeros((len(self.scale), 0))
        directions = np.asarray(self._svd[2][len(self._svd[1]) :].T)
        directions[self._fixed] = 0.0
        return directions

    def solve(self, residual: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the scaled correction of a residual."""
        if self._lu is not None:
            return np.asarray(self._lu.solve(self._rows * residual))
        U, s, V = self._svd
        step = np.asarray(V[: len(s)].T @ ((U.T @ (self._rows * residual)) / s))
        step[self._fixed] = 0.0
        return step


def equilibrated(matrix: csr_array) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return scales of rows and columns that bring entries near 1: their logarithms average to zero.

    Source: Curtis & Reid 1972, "On the automatic scaling of matrices for Gaussian elimination".
    """
    entries = abs(matrix).tocoo()
    kept = entries.data > 0
    row, column, logs = entries.row[kept], entries.col[kept], np.log2(entries.data[kept])
    scales = [np.zeros(size) for size in matrix.shape]
    counts = [
        np.maximum(np.bincount(index, minlength=size), 1)
        for index, size in zip((row, column), matrix.shape, strict=True)
    ]
    for _ in range(10):
        for k, index in enumerate((row, column)):
            rest = logs + scales[1 - k][(column, row)[k]]
            scales[k] = -np.bincount(index, rest, minlength=matrix.shape[k]) / counts[k]
    return np.exp2(np.round(scales[0])), np.exp2(np.round(scales[1]))  # powers of two change no digit


@dataclass(frozen=True)
class NewtonSolution:
    """A solution of equations."""

    z: NDArray[np.float64]  # the variables, rounded to doubles
    exact: list[Any]  # the same at high precision (flint `arb`)
    residual: float  # the largest residual of an equation beside its terms, at the rounded variables
    condition: float  # condition of the equations with scaled variables; inf where they are singular
    free: tuple[int, ...]  # columns of variables that the equations leave open
    worst: str  # the node whose equation has the largest residual
    scale: NDArray[np.float64]  # sizes of the variables by equilibration


def iterate(system: LawSystem, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], Factor] | None:
    """Return the limit of the damped iteration from a start with its factorised matrix; None without one."""
    try:
        residual, matrix = system.residual(z)
        largest = 0.0
        for _ in range(_MAX_STEPS):
            factor = Factor(matrix, system.fixed)
            step = factor.solve(residual)
            size, damping = float(np.abs(step).max(initial=0.0)), 1.0
            largest = max(largest, float(np.abs(z / factor.scale).max(initial=0.0)))
            if not np.isfinite(size):
                return None
            if size <= _CORRECTION_TOL * largest:
                return z, factor
            while True:
                trial = z - damping * factor.scale * step
                try:
                    residual, matrix = system.residual(trial)
                    simplified = float(np.abs(factor.solve(residual)).max(initial=0.0))
                    if simplified <= (1 - damping / 4) * size:
                        break
                except OutOfRangeError:
                    pass
                damping /= 2
                if damping < _MIN_STEP_FACTOR:  # within rounding of a solution, else stuck
                    return (z, factor) if size <= _ROUNDING_CORRECTION * largest else None
            z = trial
    except (OutOfRangeError, np.linalg.LinAlgError):
        return None
    return None


def refined(system: LawSystem, z: NDArray[np.float64], factor: Factor) -> NewtonSolution | None:
    """Return a solution with its variables at high precision; None where a law has no value there."""
    from flint import arb, ctx

    laws = system.equations.model.laws
    with ctx.workprec(_RESIDUAL_BITS):
        gradients = [laws[row.node].gradient(high=True) for row in system.equations.laws]
        exact = [arb(float(value)) for value in z]
        for _ in range(30):
            pairs = system.high_residual(exact, gradients)
            correction = factor.scale * factor.solve(np.array([float(residual) for residual, _ in pairs]))
            exact = [
                (coordinate - arb(float(change))).mid()
                for coordinate, change in zip(exact, correction, strict=True)
            ]
            largest = float(np.abs(correction / factor.scale).max(initial=0.0))
            if not largest > 1e-45 * float(np.abs(z / factor.scale).max(initial=0.0)):
                break
        rounded = np.array([float(coordinate) for coordinate in exact])
        # what only rounding left beside the other variables is zero
        tiny = np.abs(rounded / factor.scale) < 1e-30 * np.abs(rounded / factor.scale).max(initial=0.0)
        rounded[tiny] = 0.0
        exact = [arb(0) if zero else coordinate for coordinate, zero in zip(exact, tiny, strict=True)]
        try:
            pairs = system.high_residual([arb(float(value)) for value in rounded], gradients)
            _, matrix = system.residual(rounded)
        except OutOfRangeError:
            return None
    shares = [float(abs(residual)) / float(terms) if float(terms) else 0.0 for residual, terms in pairs]
    largest_share = max(range(len(shares)), key=shares.__getitem__, default=-1)
    try:
        final = Factor(matrix, system.fixed)
    except OutOfRangeError:
        final = factor
    open_columns = tuple(int(k) for k in np.flatnonzero(np.abs(final.free).max(axis=1, initial=0.0) > 1e-8))
    return NewtonSolution(
        rounded,
        exact,
        shares[largest_share] if shares else 0.0,
        final.condition,
        open_columns,
        system.nodes[largest_share] if shares else "",
        final.scale,
    )
