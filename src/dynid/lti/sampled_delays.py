"""Sampled controllers around a plant with delays inside: a function of z in place of a polynomial.

Delays τ_i = a_i g and the period T = m g are multiples of a common part g. Of a solution that is multiplied
by z in every period, the m stretches of length g of a period are x_i = Σ w^i X over the roots w^m = z. A
delay is a power of w: v = P(w) (C X + D u + E v) is eliminated, and X of each mode follows by exponentials,
up to every instant at which what is held changes. Each stretch begins as the one before ends, w X(0) = X(g).
With controllers and what they hold the equations are T(z) ξ = 0: det T is analytic outside the circle on
which its zeros, the discrete poles, gather (zeros of det(1 - P E), of ever higher frequency), and grows as
z^n, with n states of plant and controllers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cached_property

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError
from dynid.lti.exponential import balance, exponentials, rescaled
from dynid.lti.sampled_system import SampledController
from dynid.lti.state_space import StateSpace

#: States of all stretches: margins of more take many seconds.
_MAX_STATES = 400
#: Entries of the matrices of all modes and values of z that are held at once.
_CHUNK_SIZE = 400_000
#: Points on the unit circle: the first trial and the last one, each twice as many.
_FIRST_POINTS, _LAST_POINTS = 128, 16_384
#: Sum of the last eighth of the coefficients relative to the smallest value on the circle: such a remainder
#: changes no count (Rouché), the factor is for what lies beyond.
_TAIL_RTOL = 1e-3
#: Size of what is round-off, relative to the largest coefficient, or value on the circle.
_ROUNDING = 1e-11
#: Turn of the function from one point on the circle to the next, rad, above which points are added, and how
#: often they are.
_LARGEST_TURN, _MAX_HALVINGS = 0.7, 40
#: Steps of the secant that refine a pole, and the size of poles that are listed.
_SECANTS, _LISTED_SIZE = 8, 0.05
#: Most poles that are listed.
_MAX_LISTED_POLES = 20


class SampledDelays:
    """Sampled controllers around a plant with commensurate delays.

    The last inputs of `plant` arrive with `delays`, s, from its last outputs; controller j measures output j
    and drives input j. Raises `UsageError` where the delays and the period have no common part of some size.
    """

    def __init__(
        self,
        plant: StateSpace,
        delays: Sequence[Fraction],
        controllers: Sequence[SampledController],
        period: Fraction,
    ) -> None:
        self._controllers, self.period, late = controllers, period, len(delays)
        common = period
        for delay in delays:
            common = _common_part(common, delay)
        self._stretches = int(period / common)
        states = self._stretches * max(len(plant.A), late)
        if states > _MAX_STATES:
            raise UsageError(
                f"the common part of the sample time, {float(period):g} s, and the delays in the plant "
                f"({', '.join(f'{float(delay):g}' for delay in delays)} s) is {float(common):.3g} s: "
                f"{states:,} states, at most {_MAX_STATES} are computed",
                remedy="Choose a sample time of which the delays are small multiples.",
            )
        scale = balance(plant.A)
        loops = len(controllers)
        self._A = rescaled(plant.A, scale)
        self._B, self._Bv = np.split(plant.B / scale[:, None], [loops], axis=1)
        self._C, self._Cz = np.split(plant.C * scale, [loops])
        (self._D, self._Dv), (self._Dz, self._E) = (
            np.split(rows, [loops], axis=1) for rows in np.split(plant.D, [loops])
        )
        self._shifts = [int(delay / common) for delay in delays]
        self._steps = [int(c.computation // period) for c in controllers]
        rests = [c.computation - step * period for c, step in zip(controllers, self._steps, strict=True)]
        borders = sorted({rest % common for rest in rests} | {Fraction(0)})
        lengths = np.diff([*borders, common])
        #: Of each part of a stretch its length, and which inputs hold their newest value there, by stretch.
        self._parts = [
            (float(length), [[k * common + border >= rest for rest in rests] for k in range(self._stretches)])
            for border, length in zip(borders, lengths, strict=True)
        ]
        self.order = len(plant.A) + sum(len(controller.h) for controller in controllers)

    def _equations(self, z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return T, without the states of all modes but the first, and det of what these are, at values of z.

        T: N x unknowns x unknowns: states of the first mode, controller states, what is held.
        """
        size = self._stretches * (len(self._A) + len(self._controllers)) ** 2
        chunks = np.array_split(z + 0j, 1 + len(z) * size // _CHUNK_SIZE)
        equations, factors = zip(*map(self._equations_at_once, chunks), strict=True)
        return np.concatenate(equations), np.concatenate(factors)

    def _equations_at_once(self, z: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        m, n, loops = self._stretches, len(self._A), len(self._controllers)
        stretches = np.arange(m)
        # x_i = sum of w^i X over the modes, w^m = z
        w = z[:, None] ** (1 / m) * np.exp(2j * np.pi * stretches / m)
        P = w[:, :, None] ** -np.array(self._shifts, dtype=float)
        late = P[:, :, :, None] * np.eye(len(self._shifts))
        arriving = late @ np.linalg.inv(np.eye(len(self._shifts)) - self._E @ late)
        from_states, from_held = arriving @ self._Cz, arriving @ self._Dz
        A, B = self._A + self._Bv @ from_states, self._B + self._Bv @ from_held
        X, held = np.broadcast_to(np.eye(n, n + loops) + 0j, (*w.shape, n, n + loops)), []
        weights = w[:, :, None] ** -stretches / m
        for length, newest in self._parts:
            late_by = np.array(self._steps) + ~np.array(newest)
            held.append(z[:, None, None] ** -late_by)
            joint: ComplexArray = np.zeros((*w.shape, n + loops, n + loops), complex)
            joint[..., :n, :n] = A
            joint[..., :n, n:] = B * (weights @ held[-1])[:, :, None, :]
            E = exponentials(joint * length)[..., :n, :]
            X = E[..., :n] @ X
            X[..., n:] += E[..., n:]
        # What is measured has what is held until now, and what arrives after jumps now.
        before = held[-1][:, m - 1, None] / z[:, None, None] * self._D
        jumped = self._Dv @ (from_held * (weights @ held[0])[:, :, None, :])
        states, moving = w[:, :, None, None] * np.eye(n) - X[..., :n], X[..., n:]
        shown = self._C + self._Dv @ from_states
        others = shown[:, 1:] @ np.linalg.solve(states[:, 1:], moving[:, 1:])
        measured = np.concatenate([shown[:, 0], before + jumped.sum(axis=1) + others.sum(axis=1)], axis=2)
        sizes = [len(controller.h) for controller in self._controllers]
        first, size = n, n + sum(sizes) + loops
        T = np.zeros((len(z), size, size), complex)
        columns = [*range(n), *range(size - loops, size)]
        T[:, :n, columns] = np.concatenate([states[:, 0], -moving[:, 0]], axis=2)
        for j, controller in enumerate(self._controllers):
            rows = np.arange(first, first + sizes[j])
            T[np.ix_(np.arange(len(z)), rows, rows)] = z[:, None, None] * np.eye(sizes[j]) - controller.F
            T[np.ix_(np.arange(len(z)), rows, columns)] -= controller.g[:, None] * measured[:, j, None, :]
            answer = size - loops + j
            T[:, answer, rows] = controller.h
            T[:, answer, columns] += controller.d * measured[:, j]
            T[:, answer, answer] += 1
            first += sizes[j]
        return T, np.linalg.det(states[:, 1:]).prod(axis=1)

    def answers(self, z: ComplexArray) -> ComplexArray:
        """Return what the closed loops hold in answer to sequences added to what is measured, by loop."""
        (T, _), loops = self._equations(z), len(self._controllers)
        added = np.zeros((T.shape[1], loops))
        first = T.shape[1] - loops - sum(len(controller.h) for controller in self._controllers)
        for j, controller in enumerate(self._controllers):
            added[first : first + len(controller.h), j] = controller.g
            added[j - loops, j] = -controller.d
            first += len(controller.h)
        return np.asarray(np.linalg.solve(T, np.broadcast_to(added + 0j, (len(z), *added.shape)))[:, -loops:])

    def loop(self, number: int, z: ComplexArray) -> ComplexArray:
        """Return L of a loop, the others closed."""
        (T, _), loops = self._equations(z), len(self._controllers)
        answer = T.shape[1] - loops + number
        row, held = T[:, answer].copy(), np.zeros(T.shape[1])
        row[:, answer] -= 1
        T[:, answer], held[answer] = 0, 1.0
        T[:, answer, answer] = 1
        solution = np.linalg.solve(T, np.broadcast_to(held[:, None] + 0j, (len(z), len(held), 1)))
        return np.asarray((row[:, None, :] @ solution)[:, 0, 0])

    def characteristic(self, z: ComplexArray) -> ComplexArray:
        """Return det T / z^n, 1 or -1 at infinity."""
        T, others = self._equations(z)
        return np.asarray(np.linalg.det(T) * others / z**self.order)

    @cached_property
    def gathering(self) -> float:
        """The largest |z| at which infinitely many poles gather: those of ever higher frequency."""
        if not self._shifts or not self._E.any():
            return 0.0
        # the companion matrix of v[k] = E_1 v[k - 1] + ..., by common parts
        late, depth = len(self._shifts), max(self._shifts)
        rows = np.zeros((late, depth * late))
        for k, shift in enumerate(self._shifts):
            rows[k, (shift - 1) * late : shift * late] = self._E[k]
        companion = np.vstack([rows, np.eye((depth - 1) * late, depth * late)])
        return float(np.abs(np.linalg.eigvals(companion)).max()) ** self._stretches

    @cached_property
    def _coefficients(self) -> tuple[Array | None, ComplexArray]:
        """The coefficients of det T / z^n in powers of 1/z, None where too many, and values on the circle."""
        points = _FIRST_POINTS
        while True:
            half = np.exp(2j * np.pi * np.arange(points // 2 + 1) / points)
            values = self.characteristic(half)
            coefficients = np.fft.irfft(values)
            smallest = np.abs(values).min()
            tail = np.abs(coefficients[-points // 8 :]).sum()
            floor = _ROUNDING * np.abs(coefficients).max()
            if tail <= _TAIL_RTOL * smallest or np.abs(coefficients[-points // 8 :]).max() < floor:
                return coefficients[: points // 2 + points // 4], values
            if points >= _LAST_POINTS:
                return None, values
            points *= 2

    @cached_property
    def outside(self) -> int | None:
        """The number of discrete poles outside the unit circle; None where it is not decided."""
        coefficients, values = self._coefficients
        if coefficients is None:
            return None
        angles, floor = np.linspace(0, math.pi, len(values)), _ROUNDING * np.abs(values).max()
        for _ in range(_MAX_HALVINGS):
            if np.abs(values).min() <= floor:
                return None
            turns = np.angle(values[1:] / values[:-1])
            if not len(wide := np.flatnonzero(np.abs(turns) > _LARGEST_TURN)):
                return round(-float(turns.sum()) / math.pi)
            middle = (angles[wide] + angles[wide + 1]) / 2
            angles = np.insert(angles, wide + 1, middle)
            values = np.insert(values, wide + 1, self.characteristic(np.exp(1j * middle)))
        return None

    @cached_property
    def poles(self) -> ComplexArray:
        """The largest discrete poles, down to where they gather, refined on the characteristic function."""
        coefficients, _ = self._coefficients
        if coefficients is None:
            return np.empty(0, complex)
        kept = np.flatnonzero(np.abs(coefficients) > _ROUNDING * np.abs(coefficients).max())[-1] + 1
        w = np.roots(coefficients[:kept][::-1])
        least = min(max(_LISTED_SIZE, 1.05 * self.gathering), 1.0)
        starts = 1 / w[np.abs(w) < 1 / least]
        poles = [self._refined(start) for start in starts if start.imag >= 0]
        listed: list[complex] = []
        for pole in poles:
            if pole is None or any(abs(pole - other) < 1e-8 * abs(pole) for other in listed):
                continue
            listed += [pole] if pole.imag == 0 else [pole, pole.conjugate()]
        return np.array(sorted(listed, key=lambda pole: (-abs(pole), pole.imag)), complex)[:_MAX_LISTED_POLES]

    def _refined(self, start: complex) -> complex | None:
        before, now = start * (1 + 1e-6), start
        values = self.characteristic(np.array([before, now]))
        f_before, f_now = values.tolist()
        for _ in range(_SECANTS):
            if f_now == f_before:
                break
            before, now, f_before = now, now - f_now * (now - before) / (f_now - f_before), f_now
            f_now = complex(self.characteristic(np.array([now]))[0])
            if abs(now - before) < 1e-13 * abs(now):
                break
        if not abs(now - start) < 0.1 * abs(start):
            return None
        return complex(now.real) if abs(now.imag) < 1e-10 * abs(now) else complex(now)


def _common_part(a: Fraction, b: Fraction) -> Fraction:
    """Return the largest number of which both are multiples."""
    denominator = math.lcm(a.denominator, b.denominator)
    return Fraction(math.gcd(int(a * denominator), int(b * denominator)), denominator)
