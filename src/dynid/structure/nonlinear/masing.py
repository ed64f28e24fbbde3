"""Force over a cycle of laws that follow Masing's rules, with its derivatives.

In a steady state the loops that are open at the largest deflection of the cycle are those of first loading
alone: the cycle begins there, on the curve of first loading or its mirror image. Between the turning points
of the deflection branches begin and close (`dynid.structure.nonlinear.memory`). The force is continuous, and
at a turning point the deflection does not depend on its angle: events add nothing to the derivatives.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.structure.hysteretic_laws import Iwan
from dynid.structure.law import BoundLaw
from dynid.structure.nonlinear.fourier import clenshaw_curtis, further_harmonics, rate_of, series

# Points of a cycle at which turning points are looked for, over the highest harmonic.
_SCAN = 16
# Halvings of the interval of an angle, and Newton's steps after them.
_HALVINGS, _STEPS = 12, 3
# Change of a deflection, relative to its size, that is round-off.
_ROUND_OFF = 1e-13


class _Origin(NamedTuple):
    """Where a branch began: deflection and force, and their derivatives (columns)."""

    d: float
    f: float
    D: Array
    F: Array


class _Piece(NamedTuple):
    """A part of a branch between two angles: its origin and direction, and whether all slips."""

    low: float
    high: float
    origin: _Origin
    sign: float
    slips: bool


class MasingCycle:
    """A law over a cycle of the deflection q (2 H + 1); columns: by q, and by the parameters and the offset.

    `coefficients` (2 J + 1) of the force, and their derivatives `slopes` (2 H + 1 x columns).
    """

    def __init__(self, law: BoundLaw, q: Array, *, parameters: bool) -> None:
        assert isinstance(law.law, Iwan)
        self.law, self.values, self.q = law.law, law.values, q
        self.harmonics, self.rate = len(q) // 2, rate_of(q)
        self.columns = len(q) + (len(law.values) + 1 if parameters else 0)
        self.phi = law.law.slip(law.values)[0]
        further = further_harmonics(self.harmonics)
        self.coefficients, self.slopes = np.zeros(2 * further + 1), np.zeros((len(q), self.columns))
        theta = self._turning_points()
        if not len(theta):
            self.coefficients[: len(q)] = law.values[0] * q
            self.slopes[:, : len(q)] = law.values[0] * np.eye(len(q))
            return
        for piece in self._pieces(theta):
            self._add(piece)

    def _turning_points(self) -> Array:
        """Return the angles at which the deflection turns, the largest first, and that one again."""
        count = max(128, _SCAN * self.harmonics)
        theta = 2 * np.pi * np.arange(count) / count
        v = series(theta, self.harmonics) @ self.rate
        at = np.flatnonzero(v * np.roll(v, -1) < 0)
        at = np.concatenate([at, np.flatnonzero(v == 0)]) if v.any() else at
        angles = self._zeros(theta[at], theta[at] + 2 * np.pi / count, np.zeros(len(at)), self.rate)
        angles = np.sort(angles)
        if not len(angles):
            return angles
        first = int(np.abs(series(angles, self.harmonics) @ self.q).argmax())
        return np.concatenate([angles[first:], angles[:first] + 2 * np.pi, [angles[first] + 2 * np.pi]])

    def _zeros(self, low: Array, high: Array, value: Array, q: Array) -> Array:
        """Return the angles between others at which a series has values."""
        by_angle = rate_of(q)
        rises = series(high, self.harmonics) @ q > value
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            above = (series(middle, self.harmonics) @ q > value) == rises
            low, high = np.where(above, low, middle), np.where(above, middle, high)
        theta = (low + high) / 2
        for _ in range(_STEPS):
            T = series(theta, self.harmonics)
            slope = T @ by_angle
            step = (T @ q - value) / np.where(slope == 0, np.inf, slope)
            theta = np.clip(theta - step, low, high)
        return np.asarray(theta)

    def _pieces(self, theta: Array) -> Iterator[_Piece]:
        """Yield the parts of the cycle between turning points, closures of loops, and slip."""
        T = series(theta, self.harmonics)
        d = (T @ self.q).tolist()
        rows = np.zeros((len(theta), self.columns))
        rows[:, : len(self.q)] = T
        tiny = _ROUND_OFF * max(map(abs, d))
        sign = float(np.sign(d[0]))
        first = _Origin(0.0, 0.0, np.zeros(self.columns), np.zeros(self.columns))
        f, F = self._force(np.array(d[:1]), T[:1], first, sign, slips=abs(d[0]) >= self.phi, scale=1.0)
        stack = [_Origin(d[0], float(f[0]), rows[0], F[0])]
        for k, (turn, end) in enumerate(zip(theta[:-1].tolist(), theta[1:].tolist(), strict=True), 1):
            low, sign = turn, 1.0 if d[k] > d[k - 1] else -1.0
            piece: _Piece | None = None
            while True:
                origin = stack[-1]
                closes = len(stack) > 2 and sign * (d[k] - stack[-2].d) > tiny
                last, high = (stack[-2].d, self._angle(low, end, stack[-2].d)) if closes else (d[k], end)
                slip = origin.d + 2 * sign * self.phi
                if sign * (last - slip) > tiny:
                    begins = max(low, self._angle(low, high, slip)) if sign * (slip - d[k - 1]) > 0 else low
                    yield _Piece(low, begins, origin, sign, slips=False)
                    piece = _Piece(begins, high, origin, sign, slips=True)
                else:
                    piece = _Piece(low, high, origin, sign, slips=False)
                yield piece
                if not closes:
                    break
                del stack[-2:]
                low = high
            f, F = self._force(np.array(d[k : k + 1]), T[k : k + 1], piece.origin, sign, slips=piece.slips)
            stack.append(_Origin(d[k], float(f[0]), rows[k], F[0]))

    def _angle(self, low: float, high: float, value: float) -> float:
        ends = np.array([low]), np.array([high])
        return float(self._zeros(*ends, np.array([value]), self.q)[0])

    def _force(
        self, d: Array, T: Array, origin: _Origin, sign: float, *, slips: bool, scale: float = 2.0
    ) -> tuple[Array, Array]:
        """Return the force at deflections of a branch (nodes), and its derivatives (nodes x columns)."""
        size = len(self.q)
        F = np.zeros((len(d), self.columns))
        if slips:
            if self.columns > size:
                F[:, size + 1] = sign
            return np.full(len(d), sign * self.values[1]), F
        f = self.law.backbone(self.values, sign * (d - origin.d) / scale)
        slope = np.broadcast_to(f.slope, len(d))[:, None]
        F += origin.F - slope * origin.D
        F[:, :size] += slope * T
        for column in range(size, self.columns - 1):
            F[:, column] += scale * sign * f.p[column - size]
        return origin.f + scale * sign * f.value, F

    def _add(self, piece: _Piece) -> None:
        """Add a part of the cycle to the coefficients."""
        length, size = piece.high - piece.low, len(self.q)
        if length <= 0:
            return
        x, weights, _ = clenshaw_curtis(24 + 8 * int(np.ceil(length * (self.harmonics + 1) / 6)))
        T = series(piece.low + length * x, len(self.coefficients) // 2)
        rows = T.T * (length * weights / np.pi)
        rows[0] /= 2
        f, F = self._force(T[:, :size] @ self.q, T[:, :size], piece.origin, piece.sign, slips=piece.slips)
        self.coefficients += rows @ f
        self.slopes += rows[:size] @ F
