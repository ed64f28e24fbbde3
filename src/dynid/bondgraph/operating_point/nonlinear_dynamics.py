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

from dynid.arithmetic.numbers import OutOfRangeError
from dynid.bondgraph.graph import Port
from dynid.bondgraph.operating_point.equations import LawEquations, LawSystem
from dynid.bondgraph.operating_point.newton import equilibrated
from dynid.errors import NumericalError

if TYPE_CHECKING:
    from dynid.arrays import Array

_RANK_TOL = 1e-11
_ZERO = Fraction(0)


class LawDynamics:
    """The state equations near a point.

    `z`: variables at the point; they set the units of all others. `sources`: the sources, whose values are
    the input u, in this order. Raises `NumericalError` if the equations have no unique solution there.
    """

    def __init__(self, equations: LawEquations, z: Array, sources: tuple[str, ...]) -> None:
        self.equations, self.z = equations, z
        self._count = 2 * len(equations.model.graph.bonds)
        linear = [(node, row, _ZERO) for node, row, _ in equations.rows]
        self._system = LawSystem(equations, linear)
        _, matrix = self._system.residual(z)
        self._rows, scale = equilibrated(matrix)
        self.y_scale, self.x_scale = scale[: self._count], scale[self._count :]
        scaled = (self._rows[:, None] * matrix.toarray()) * scale
        of_rows = [max(row) < self._count for _, row, _ in equations.rows]
        static = np.array(of_rows + [False] * len(equations.laws))
        driven = np.zeros((len(scaled), len(sources)))
        for k, (_, _, source) in enumerate(equations.rows):
            if source in sources:
                driven[k, sources.index(source)] = self._rows[k]
        U, s, V = np.linalg.svd(scaled[static, : self._count])
        rank = int((s > _RANK_TOL * s.max(initial=0.0)).sum())
        self._basis = V[rank:].T  # of efforts and flows that fulfil the linear equations
        self._particular = V[:rank].T @ ((U[:, :rank].T @ driven[static]) / s[:rank, None])
        self._left = ~static
        self._regular = False  # once h is known to determine c
        self._prepare(scaled)
        self._storage_rows, self._places = self._storages()
        self._rate_rows = np.array(equations.rates, dtype=int)

    def _storages(self) -> tuple[list[tuple[int, int]], list[int]]:
        """Return the columns of output and state of every storage, and the rows of their equations."""
        pairs: list[tuple[int, int]] = []
        places = []
        equations, first = self.equations, len(self.equations.rows)
        graph = equations.model.graph
        for state in equations.states:
            if not graph.is_state(state):
                continue
            out = equations.column(Port(state.node, "f" if state.quantity == "p" else "e"))
            pairs.append((out, equations.column(state)))
            rows = [k for k, (node, _, _) in enumerate(equations.rows) if node == state.node]
            rows += [first + k for k, row in enumerate(equations.laws) if row.node == state.node]
            places.append(rows[0])
        return pairs, places

    def efforts_and_flows(self, c: Array, u: Array) -> Array:
        """Return the efforts and flows of all bonds."""
        return np.asarray(self.y_scale * (self._basis @ c + self._particular @ u))

    def _prepare(self, scaled: Array) -> None:
        """Take the linear storages together, and what the laws read of efforts, flows and states."""
        count, linear = self._count, len(self.equations.rows)
        storages = self._left[:linear]
        by_y = scaled[:linear][storages][:, :count]
        self._linear = by_y @ self._basis, scaled[:linear][storages][:, count:], by_y @ self._particular
        laws = self.equations.laws
        self._gradients = [self.equations.model.laws[row.node].gradient() for row in laws]
        read = [[row.out, *([row.factor] if row.factor >= 0 else []), *row.arguments] for row in laws]
        #: Of every law, by the columns that it reads: derivatives of the variables by c, x (scaled) and u.
        self._reads = []
        for columns in read:
            by_c, by_x = (
                np.zeros((len(columns), self._basis.shape[1])),
                np.zeros((len(columns), len(self.x_scale))),
            )
            by_u = np.zeros((len(columns), self._particular.shape[1]))
            for k, column in enumerate(columns):
                if column < count:
                    by_c[k] = self.y_scale[column] * self._basis[column]
                    by_u[k] = self.y_scale[column] * self._particular[column]
                else:
                    by_x[k, column - count] = self.x_scale[column - count]
            self._reads.append((by_c, by_x, by_u))

    def _storages_and_laws(self, c: Array, x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Return the scaled residuals h, and their derivatives by c and by the scaled states."""
        scaled = x / self.x_scale
        by_c, by_x, by_u = self._linear
        residuals, rows_c, rows_x = [by_c @ c + by_x @ scaled + by_u @ u], [by_c], [by_x]
        rows = self._rows[len(self.equations.rows) :]
        for row, gradient, (law_c, law_x, law_u), size in zip(
            self.equations.laws, self._gradients, self._reads, rows, strict=True
        ):
            out, *rest = (law_c @ c + law_x @ scaled + law_u @ u).tolist()
            factor = row.sign * (rest.pop(0) if row.factor >= 0 else 1.0)
            value, slopes = gradient(rest)
            modulus = [-row.sign * value] if row.factor >= 0 else []
            weights = size * np.array([1.0, *modulus, *(-factor * slope for slope in slopes)])
            residuals.append(np.array([size * (out - factor * value)]))
            rows_c.append((weights @ law_c)[None])
            rows_x.append((weights @ law_x)[None])
        return np.concatenate(residuals), np.concatenate(rows_c), np.concatenate(rows_x)

    @cached_property
    def rate_matrix(self) -> Array:
        """S: scaled rates of states by c (states x unknowns)."""
        return self._rates_by(self._basis)

    def _rates_by(self, matrix: Array) -> Array:
        scale = self.y_scale[self._rate_rows] / self.x_scale
        return np.asarray(scale[:, None] * matrix[self._rate_rows])

    def _closed(self, by_c: Array, by_x: Array) -> tuple[Array, Array]:
        """Return the matrix that determines a correction of c, and the constraints N."""
        if self._regular and np.isfinite(by_c).all():
            return by_c, np.zeros((len(by_c), 0))
        U, s, _ = np.linalg.svd(by_c)
        rank = int((s > _RANK_TOL * s.max(initial=0.0)).sum())
        N = U[:, rank:]
        self._regular = not N.shape[1]
        return np.vstack([by_c, N.T @ by_x @ self.rate_matrix]), N

    def unknowns(self, c: Array, x: Array, u: Array) -> Array:
        """Return c for states and inputs, from a guess by Newton's method.

        Raises `NumericalError` if the equations determine it not, or the iteration does not converge.
        """
        for _ in range(30):
            h, by_c, by_x = self._storages_and_laws(c, x, u)
            matrix, N = self._closed(by_c, by_x)
            if N.shape[1]:
                rates = self.rate_matrix @ c + self._rates_by(self._particular) @ u
                h = np.concatenate([h, N.T @ by_x @ rates])
                step, _, rank, _ = np.linalg.lstsq(matrix, h, rcond=_RANK_TOL)
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

    def nearest(self, z: Array, columns: list[int], u: Array) -> Array:
        """Return c at which the efforts and flows of some columns are nearest to their values."""
        y = (z[columns] / self.y_scale[columns]) - self._particular[columns] @ u
        return np.asarray(np.linalg.lstsq(self._basis[columns], y, rcond=None)[0])

    def rates(self, c: Array, u: Array) -> Array:
        """Return the rates of the states."""
        scaled = self.rate_matrix @ c + self._rates_by(self._particular) @ u
        return np.asarray(self.x_scale * scaled)

    def constraints(self, c: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """Return the constraints N on the states, and how far each input enters them."""
        z = np.concatenate([self.efforts_and_flows(c, u), x])
        _, matrix = self._system.residual(z)
        by_y = self._rows[self._left, None] * matrix[self._left].toarray()[:, : self._count] * self.y_scale
        _, by_c, by_x = self._storages_and_laws(c, x, u)
        _, N = self._closed(by_c, by_x)
        return N, N.T @ by_y @ self._particular

    def state_sizes(self) -> Array:
        """Return the sizes of the states: those at the point, else those by which they are scaled."""
        x = np.abs(self.z[self._count :])
        return np.where(x > 0, x, self.x_scale)

    def state_with(self, out: int, state: int, z: Array, change: float) -> float:
        """Return the state of a storage whose effort or flow differs by an amount from that at the point.

        Raises `NumericalError` if its law has no such value near.
        """
        z, target = z.copy(), z[out] + change
        row = next(k for k, pair in enumerate(self._storage_rows) if pair == (out, state))
        for _ in range(50):
            z[out] = target
            try:
                residual, matrix = self._system.residual(z)
            except OutOfRangeError:
                break
            index = self._places[row]
            slope = float(matrix[[index], [state]][0])
            if slope == 0:
                break
            step = float(residual[index]) / slope
            z[state] -= step
            if abs(step) <= 1e-14 * abs(z[state]):
                return float(z[state])
        raise NumericalError("the stored energy at t = 0 is no value of the law of its element")

    def natural_modes(self, u: Array) -> tuple[Array, float]:
        """Return the natural modes at the point, and the largest entry of their state matrix."""
        c, x = self.at_point(u), self.z[self._count :]
        _, by_c, by_x = self._storages_and_laws(c, x, u)
        matrix, N = self._closed(by_c, by_x)
        right = np.vstack([by_x, np.zeros((N.shape[1], by_x.shape[1]))])
        by_states = -np.linalg.lstsq(matrix, right, rcond=_RANK_TOL)[0]
        # on the constraints and with what is conserved: the null space of both
        kept = np.zeros((len(self.equations.conserved), by_x.shape[1]))
        for k, conserved in enumerate(self.equations.conserved):
            for port, weight in conserved.weights.items():
                kept[k, self.equations.states.index(port)] = (
                    float(weight) * self.x_scale[self.equations.states.index(port)]
                )
            kept[k] /= np.abs(kept[k]).max()
        fixed = np.vstack([N.T @ by_x, kept])
        _, s, V = np.linalg.svd(fixed) if len(fixed) else (0, np.zeros(0), np.eye(by_x.shape[1]))
        rank = int((s > _RANK_TOL * s.max(initial=0.0)).sum())
        tangent = V[rank:].T
        A = tangent.T @ self.rate_matrix @ by_states @ tangent
        return np.linalg.eigvals(A), float(np.abs(A).max(initial=0.0))
