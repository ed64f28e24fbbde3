"""State equations of a graph with laws, evaluated pointwise.

All efforts and flows fulfil the linear equations of junctions, transformers and resistances; what is left
are the equations of storages and laws, in few unknowns c: h(c, x, u) = 0 and dx/dt = S c. Where h does not
determine c (storages in derivative causality), the combinations N of it that are free of c are constraints on
the states, and their time derivative N' dh/dx S c = 0 determines the rest (index 2; Hairer & Wanner 1996,
chapter VII.1).
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dynid.bondgraph.operating_point.equations import LawEquations, System
from dynid.bondgraph.operating_point.newton import equilibrated
from dynid.errors import NumericalError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

_RANK = 1e-11
_ZERO = Fraction(0)


class LawDynamics:
    """The state equations near a point.

    Parameters
    ----------
    equations
        The equations of the graph.
    z
        Variables at the point; they set the units of all others.
    sources
        The sources, whose values are the input u, in this order.

    Raises
    ------
    NumericalError
        If the equations have no unique solution there.
    """

    def __init__(self, equations: LawEquations, z: Array, sources: tuple[str, ...]) -> None:
        self.equations, self.z = equations, z
        self._count = 2 * len(equations.model.graph.bonds)
        linear = [(node, row, _ZERO) for node, row, _ in equations.rows]
        self._system = System(equations, linear)
        _, matrix = self._system.residual(z)
        self._rows, scale = equilibrated(matrix)
        self.y_scale, self.x_scale = scale[: self._count], scale[self._count :]
        whole = (self._rows[:, None] * matrix.toarray()) * scale
        static = np.array(
            [max(row) < self._count for _, row, _ in equations.rows] + [False] * len(equations.laws)
        )
        driven = np.zeros((len(whole), len(sources)))
        for k, (_, _, source) in enumerate(equations.rows):
            if source in sources:
                driven[k, sources.index(source)] = self._rows[k]
        U, s, V = np.linalg.svd(whole[static, : self._count])
        rank = int((s > _RANK * s.max(initial=0.0)).sum())
        self._basis = V[rank:].T  # of efforts and flows that fulfil the linear equations
        self._particular = V[:rank].T @ ((U[:, :rank].T @ driven[static]) / s[:rank, None])
        self._left = ~static
        self._rate_rows = np.array(equations.rates, dtype=int)

    def efforts_and_flows(self, c: Array, u: Array) -> Array:
        """Return the efforts and flows of all bonds."""
        return np.asarray(self.y_scale * (self._basis @ c + self._particular @ u))

    def _storages_and_laws(self, c: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the scaled residuals h, and their derivatives by c and by the scaled states."""
        z = np.concatenate([self.efforts_and_flows(c, u), x])
        residual, matrix = self._system.residual(z)
        scaled = self._rows[self._left, None] * matrix[self._left].toarray()
        by_y = scaled[:, : self._count] * self.y_scale
        return (
            self._rows[self._left] * residual[self._left],
            by_y @ self._basis,
            scaled[:, self._count :] * self.x_scale,
        )

    @cached_property
    def rate_matrix(self) -> Array:
        """S: scaled rates of states by c (states x unknowns)."""
        return np.asarray(
            (self.y_scale[self._rate_rows] / self.x_scale)[:, None] * self._basis[self._rate_rows]
        )

    def _rates_of_inputs(self) -> Array:
        return np.asarray(
            (self.y_scale[self._rate_rows] / self.x_scale)[:, None] * self._particular[self._rate_rows]
        )

    def _closed(self, by_c: Array, by_x: Array) -> tuple[Array, Array]:
        """Return the matrix that determines a correction of c, and the constraints N."""
        U, s, _ = np.linalg.svd(by_c)
        rank = int((s > _RANK * s.max(initial=0.0)).sum())
        N = U[:, rank:]
        return np.vstack([by_c, N.T @ by_x @ self.rate_matrix]), N

    def unknowns(self, c: Array, x: Array, u: Array) -> Array:
        """Return c for states and inputs, from a guess by Newton's method.

        Raises
        ------
        NumericalError
            If the equations determine it not, or the iteration does not converge.
        """
        for _ in range(30):
            h, by_c, by_x = self._storages_and_laws(c, x, u)
            matrix, N = self._closed(by_c, by_x)
            if N.shape[1]:
                rates = self.rate_matrix @ c + self._rates_of_inputs() @ u
                h = np.concatenate([h, N.T @ by_x @ rates])
                step, _, rank, _ = np.linalg.lstsq(matrix, h, rcond=_RANK)
                if rank < len(c):
                    raise NumericalError("the state equations have an index above 2")
            else:
                step = np.linalg.solve(by_c, h)
            c = c - step
            if np.abs(step).max(initial=0.0) <= 1e-12 * np.abs(c).max(initial=0.0):
                return c
        raise NumericalError("the equations of the nonlinear response have no solution near the last one")

    def at_point(self, u: Array) -> Array:
        """Return c at the point."""
        y = self.z[: self._count] / self.y_scale
        return np.asarray(self._basis.T @ (y - self._particular @ u))

    def rates(self, c: Array, u: Array) -> Array:
        """Return the rates of the states."""
        scaled = self.rate_matrix @ c + self._rates_of_inputs() @ u
        return np.asarray(self.x_scale * scaled)

    def natural_modes(self, u: Array) -> Array:
        """Return the natural modes at the point: eigenvalues of the linearised state equations."""
        c, x = self.at_point(u), self.z[self._count :]
        _, by_c, by_x = self._storages_and_laws(c, x, u)
        matrix, N = self._closed(by_c, by_x)
        right = np.vstack([by_x, np.zeros((N.shape[1], by_x.shape[1]))])
        by_states = -np.linalg.lstsq(matrix, right, rcond=_RANK)[0]
        # on the constraints and with what is conserved: the null space of both
        kept = np.zeros((len(self.equations.conserved), by_x.shape[1]))
        for k, one in enumerate(self.equations.conserved):
            for port, weight in one.weights.items():
                kept[k, self.equations.states.index(port)] = (
                    float(weight) * self.x_scale[self.equations.states.index(port)]
                )
            kept[k] /= np.abs(kept[k]).max()
        fixed = np.vstack([N.T @ by_x, kept])
        _, s, V = np.linalg.svd(fixed) if len(fixed) else (0, np.zeros(0), np.eye(by_x.shape[1]))
        rank = int((s > _RANK * s.max(initial=0.0)).sum())
        tangent = V[rank:].T
        return np.linalg.eigvals(tangent.T @ self.rate_matrix @ by_states @ tangent)
