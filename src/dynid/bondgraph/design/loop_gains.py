"""Gains of loops at values of free parameters, with their delays and exact derivatives.

With every loop cut where its answer goes, z = G(s) v and v_i = exp(-s τ_i) z_i: loop i, the others closed,
has L_i = -exp(-s τ_i) (G_ii + G_iO E_O (1 - G_OO E_O)^-1 G_Oi). A crossing moves by the implicit function
theorem, a peak has the derivative of its function at the fixed frequency (envelope theorem). A grid brackets
crossings and peaks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.design.design_request import LoopKind
from dynid.lti.margins import lag

#: Frequencies of the grid, and its range beyond the poles and delays.
_POINTS, _RANGE_FACTOR = 2000, 1e3
#: Largest peaks, or crossings of the negative axis, that are refined, and their size to the largest.
_MOST_CANDIDATES, _CANDIDATE_SIZE = 4, 0.95
#: Real parts of poles below this part of the largest are those of poles on the axis.
_ORIGIN_RTOL = 1e-9


class LoopValue(NamedTuple):
    """A margin, its derivatives (p), and the frequency where it is, rad/s."""

    value: float
    slopes: Array
    omega: float


class LoopGains:
    """The loops at some values of the free parameters."""

    #: Frequencies of the grid, and its range beyond the poles and delays; relative real parts of poles on the
    #: axis.
    points, range_factor, origin_rtol = _POINTS, _RANGE_FACTOR, _ORIGIN_RTOL

    def __init__(self, matrices: Sequence[Array], delays: Array) -> None:
        self._A, self._B, self._C, self._D, *self._slopes = matrices
        self._delays = delays

    def margin(self, kind: LoopKind, loop: int) -> LoopValue | None:
        """Return a margin; None where there is none, or the closed loops are not stable."""
        grid = self._grid()
        if not self._stable(grid):
            return None
        find: Callable[[int, Array], list[LoopValue]] = {
            "phase_margin": self._phases, "gain_margin": self._gains, "Ms": self._peaks, "Mt": self._peaks
        }[kind]  # fmt: skip
        self._complementary = kind == "Mt"
        candidates = find(loop, grid)
        pick = max if kind in ("Ms", "Mt") else min
        return pick(candidates, key=lambda candidate: candidate.value, default=None)

    def _grid(self) -> Array:
        """Return frequencies, rad/s, around the poles and delays."""
        sizes = np.concatenate([np.abs(np.linalg.eigvals(self._A)), 1 / self._delays[self._delays > 0]])
        sizes = sizes[sizes > 1e-9 * sizes.max(initial=0.0)]
        low, high = (sizes.min(), sizes.max()) if len(sizes) else (1.0, 1.0)
        return np.geomspace(low / self.range_factor, high * self.range_factor, self.points)

    # --- L and its derivatives ------------------------------------------------------------------------

    def _stable(self, grid: Array) -> bool:
        """Test whether the closed loops are stable, by the turns of det(1 - G E) along the grid (Nyquist)."""
        G, E = self._cut(grid)
        values = np.linalg.det(np.eye(G.shape[1]) - G * E[:, None, :])
        turns = float(np.sum(np.angle(values[1:] / values[:-1]))) / math.pi
        at_origin = -round(math.log(abs(values[1] / values[0])) / math.log(grid[1] / grid[0]))
        return round(self._right() + at_origin / 2 - turns) == 0

    def _right(self) -> int:
        """Return the number of poles of the open loops in the right half-plane."""
        poles = np.linalg.eigvals(self._A)
        return int((poles.real > self.origin_rtol * np.abs(poles).max(initial=0.0)).sum())

    def _cut(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        """Return G and the delays E at frequencies (L x loops x loops, L x loops)."""
        s = 1j * omega[:, None, None]
        states = np.linalg.solve(s * np.eye(len(self._A)) - self._A, self._B + 0j * s)
        G = self._C @ states + sum(matrix * s**k for k, matrix in enumerate(self._D))
        return G, np.exp(-1j * omega[:, None] * self._delays)

    def _gain(self, loop: int, omega: Array) -> ComplexArray:
        """Return L at frequencies (L)."""
        G, E = self._cut(omega)
        others = [k for k in range(G.shape[1]) if k != loop]
        H = G[:, loop, loop]
        if others:
            closed = np.eye(len(others)) - G[:, others][:, :, others] * E[:, None, others]
            inner = np.linalg.solve(closed, G[:, others, loop][:, :, None])[:, :, 0]
            H = H + np.sum(G[:, loop, others] * E[:, others] * inner, axis=1)
        return np.asarray(-E[:, loop] * H)

    def _responses(self, omega: float) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return G at a frequency, and its derivatives by ω and by the parameters (p x loops x loops)."""
        s, (A_slopes, B_slopes, C_slopes, D_slopes) = 1j * omega, self._slopes
        resolvent = np.linalg.inv(s * np.eye(len(self._A)) - self._A)
        X, Y = resolvent @ self._B, self._C @ resolvent
        G = self._C @ X + sum(matrix * s**k for k, matrix in enumerate(self._D))
        by_s = -Y @ X + sum((k * matrix * s ** (k - 1) for k, matrix in enumerate(self._D) if k), 0 * G)
        by_parameter = C_slopes @ X + Y @ A_slopes @ X + Y @ B_slopes
        by_parameter = by_parameter + sum(D_slopes[:, k] * s**k for k in range(len(self._D)))
        return G, 1j * by_s, by_parameter

    def _derivatives(self, loop: int, omega: float) -> tuple[complex, complex, ComplexArray]:
        """Return L at a frequency, dL/dω, and dL by the parameters (p)."""
        G, by_omega, by_parameter = self._responses(omega)
        turns = -1j * self._delays  # of log E by ω
        E, others = np.exp(turns * omega), [k for k in range(len(G)) if k != loop]
        left, right = np.zeros(len(G), complex), np.zeros(len(G), complex)
        left[loop] = right[loop] = 1.0
        late = 0j  # what delays of the others add to dH/dω
        if others:
            W = np.linalg.inv(np.eye(len(others)) - G[np.ix_(others, others)] * E[others])
            inner = W @ G[others, loop]
            right[others] = E[others] * inner
            left[others] = (G[loop, others] * E[others]) @ W
            into = G[loop, others] + left[others] @ G[np.ix_(others, others)]
            late = into @ (turns[others] * E[others] * inner)
        H = G[loop] @ right
        rate = left @ by_omega @ right + late
        return -E[loop] * H, -E[loop] * (rate + turns[loop] * H), -E[loop] * (left @ by_parameter @ right)

    # --- crossings and peaks --------------------------------------------------------------------------

    def _phases(self, loop: int, grid: Array) -> list[LoopValue]:
        values = []
        for omega in self._roots(lambda at: np.log(np.abs(self._gain(loop, at))), grid):
            L, rate, slopes = self._derivatives(loop, omega)
            by_omega, by_parameter = rate / L, slopes / L  # of log|L| + j arg L
            turned = by_parameter.imag - by_omega.imag * by_parameter.real / by_omega.real
            values.append(LoopValue(lag(L), np.degrees(turned), omega))
        return values

    def _gains(self, loop: int, grid: Array) -> list[LoopValue]:
        values = []
        gains = self._gain(loop, grid)
        crossings = np.flatnonzero(np.sign(gains[1:].imag) * np.sign(gains[:-1].imag) < 0)
        crossings = crossings[(gains[crossings].real < 0) | (gains[crossings + 1].real < 0)]
        crossings = crossings[np.argsort(-np.abs(gains[crossings]))][:_MOST_CANDIDATES]
        roots = [self._roots(lambda at: self._gain(loop, at).imag, grid[k : k + 2]) for k in crossings]
        for omega in chain.from_iterable(roots):
            L, rate, slopes = self._derivatives(loop, omega)
            if -1 < L.real < 0:
                moved = slopes.real - rate.real * slopes.imag / rate.imag
                values.append(LoopValue(-1 / L.real, moved / L.real**2, omega))
        return values

    def _peaks(self, loop: int, grid: Array) -> list[LoopValue]:
        """Return the maxima of |S|, or |T|, with those at the ends of the grid."""

        def rate(at: Array) -> Array:
            terms = [self._derivatives(loop, omega) for omega in at.tolist()]
            L, by_omega, _ = (np.array(column) for column in zip(*terms, strict=True))
            return np.asarray(self._logarithmic(L, by_omega).real)

        L = self._gain(loop, grid)
        size = np.abs((L if self._complementary else 1) / (1 + L))
        inner = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
        inner = inner[size[inner] > _CANDIDATE_SIZE * size.max()]  # delays make many small ones
        inner = inner[np.argsort(-size[inner])][:_MOST_CANDIDATES]
        stationary = []
        for k in inner.tolist():
            stationary += self._roots(rate, grid[[k - 1, k + 1]])
        values = []
        for omega in [*stationary, float(grid[0]), float(grid[-1])]:
            at, _, slopes = self._derivatives(loop, omega)
            value = abs((at if self._complementary else 1) / (1 + at))
            values.append(LoopValue(value, value * self._logarithmic(at, slopes).real, omega))
        return values

    def _logarithmic(self, L: Any, change: Any) -> Any:
        """Return d log S, or d log T, of a change of L."""
        return change / (L * (1 + L)) if self._complementary else -change / (1 + L)

    @staticmethod
    def _roots(function: Callable[[Array], Array], grid: Array) -> list[float]:
        from scipy.optimize import brentq

        values = function(grid)
        changes = np.flatnonzero(np.sign(values[1:]) * np.sign(values[:-1]) < 0)

        def at(omega: float) -> float:
            return float(function(np.array([omega]))[0])

        ends = grid.tolist()
        return [brentq(at, ends[k], ends[k + 1], xtol=1e-300, rtol=1e-14) for k in changes.tolist()]
