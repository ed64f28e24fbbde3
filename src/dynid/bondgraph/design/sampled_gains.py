"""Loops of sampled controllers as functions of free parameters, with exact derivatives.

Cut where controllers answer, G_ij = -K_i(z) P_ij(z) on z = exp(jωT), with the graph from sample to sample
(modified z-transform) and K in s of the method, (2/T)(z - 1)/(z + 1) or (z - 1)/(T z).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from dynid.arithmetic.dependent import Dependent, evaluated
from dynid.arrays import Array, ComplexArray
from dynid.bondgraph.controller_circuits import Loop
from dynid.bondgraph.design.loop_gains import LoopGains, LoopValue
from dynid.errors import UsageError
from dynid.lti.exponential import exponential_with_derivatives

#: The last frequency over the Nyquist frequency, where L is real: there K may have a pole.
_LAST = 1 - 1e-7


class SampledGains(LoopGains):
    """Sampled loops at some values of the free parameters."""

    def __init__(
        self,
        matrices: Sequence[Array],
        loops: Sequence[Loop],
        values: Mapping[str, float],
        names: Sequence[str],
    ) -> None:
        super().__init__(matrices, np.zeros(len(loops)))
        timing = [loop.sampling for loop in loops if loop.sampling is not None]
        self._period = float(timing[0].period)
        self._methods = [sampling.method for sampling in timing]
        self._controllers = [
            [_coefficients(part, values, names) for part in (loop.numerator, loop.denominator)]
            for loop in loops
        ]
        A, B, dA, dB = self._A, self._B, self._slopes[0], self._slopes[1]
        n, ports, p = len(A), B.shape[1], len(names)
        joint = np.block([[A, B], [np.zeros((ports, n + ports))]])
        slopes = np.zeros((p, n + ports, n + ports))
        slopes[:, :n] = np.concatenate([dA, dB], axis=2)

        def over(time: float) -> tuple[Array, Array]:
            """Return the exponential over a time, and its derivatives, stacked: n x (n + ports)."""
            E, rates = exponential_with_derivatives(joint, slopes.copy(), time)
            return E[:n], rates[:, :n]

        self._Phi, self._Phi_slopes = (part[..., :n] for part in over(self._period))
        #: What an input that was held adds, by how many periods ago it was computed.
        self._held: list[list[tuple[int, Array, Array]]] = []
        self._steps = []
        for j, sampling in enumerate(timing):
            computation = Fraction(sampling.computation)  # type: ignore[arg-type]
            steps = int(computation // Fraction(sampling.period))  # type: ignore[arg-type]
            rest = float(computation - steps * Fraction(sampling.period))  # type: ignore[arg-type]
            later, later_slopes = over(self._period - rest)
            terms = [(steps, later[:, n + j], later_slopes[:, :, n + j])]
            if rest:
                early, early_slopes = over(rest)
                P, dP, b, db = later[:, :n], later_slopes[..., :n], early[:, n + j], early_slopes[..., n + j]
                terms.append((steps + 1, P @ b, dP @ b + db @ P.T))
            self._held.append(terms)
            self._steps.append(steps)

    def _grid(self) -> Array:
        nyquist = math.pi / self._period
        sizes = np.abs(np.linalg.eigvals(self._A))
        low = min(sizes[sizes > 1e-9 * nyquist].min(initial=nyquist), nyquist) / self.range_factor
        ends = np.geomspace(low, nyquist, self.points), np.linspace(0, nyquist, self.points)[1:]
        return np.append(np.unique(np.concatenate(ends))[:-1], _LAST * nyquist)

    def _right(self) -> int:
        """Return the number of poles of the open loops outside the unit circle."""
        poles = [np.linalg.eigvals(self._Phi)]
        for method, (_, (bottom, _)) in zip(self._methods, self._controllers, strict=True):
            roots = np.roots(bottom).astype(complex)
            half = roots * self._period / 2
            poles.append(
                roots
                if method == "z"
                else (1 + half) / (1 - half)
                if method == "tustin"
                else 1 / (1 - 2 * half)
            )
        return int((np.abs(np.concatenate(poles)) > 1 + self.origin_rtol).sum())

    def _argument(self, z: Any, method: str) -> tuple[Any, Any]:
        """Return what a controller is a function of, and its derivative by z."""
        rate = 1 / self._period
        if method == "tustin":
            return 2 * rate * (z - 1) / (z + 1), 4 * rate / (z + 1) ** 2
        return (z, np.ones_like(z)) if method == "z" else (rate * (1 - 1 / z), rate / z**2)

    def _cut(self, omega: Array) -> tuple[ComplexArray, ComplexArray]:
        z = np.exp(1j * self._period * omega)
        gains = np.stack(
            [sum(b * z[:, None] ** -float(k) for k, b, _ in terms) for terms in self._held], axis=2
        )
        P = self._C @ np.linalg.solve(z[:, None, None] * np.eye(len(self._A)) - self._Phi, gains)
        P = P + self._D[0] * z[:, None, None] ** -(np.array(self._steps) + 1.0)
        K = np.empty((len(omega), len(self._methods)), complex)
        for i, (method, ((top, _), (bottom, _))) in enumerate(
            zip(self._methods, self._controllers, strict=True)
        ):
            s, _ = self._argument(z, method)
            K[:, i] = np.polyval(top, s) / np.polyval(bottom, s)
        return -K[:, :, None] * P, np.ones_like(K)

    def _responses(self, omega: float) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        z = np.exp(1j * self._period * omega)
        resolvent = np.linalg.inv(z * np.eye(len(self._A)) - self._Phi)
        b = np.stack([sum(g * z**-k for k, g, _ in terms) for terms in self._held], axis=1)
        db = np.stack([sum(-k * g * z ** -(k + 1) for k, g, _ in terms) for terms in self._held], axis=1)
        bp = np.stack([sum(s * z**-k for k, _, s in terms) for terms in self._held], axis=2)
        late = np.array(self._steps) + 1
        X, Y = resolvent @ b, self._C @ resolvent
        P = self._C @ X + self._D[0] * z**-late
        by_z = -Y @ X + Y @ db - self._D[0] * late * z ** -(late + 1)
        C_slopes, D_slopes = self._slopes[2], self._slopes[3][:, 0]
        by_parameter = C_slopes @ X + Y @ self._Phi_slopes @ X + Y @ bp + D_slopes * z**-late
        K, K_z, K_p = np.empty(len(P), complex), np.empty(len(P), complex), list[ComplexArray]()
        for i, (method, ((top, dtop), (bottom, dbottom))) in enumerate(
            zip(self._methods, self._controllers, strict=True)
        ):
            s, rate = self._argument(z, method)
            N, D = np.polyval(top, s), np.polyval(bottom, s)
            K[i] = N / D
            K_z[i] = rate * (np.polyval(np.polyder(top), s) - K[i] * np.polyval(np.polyder(bottom), s)) / D
            powers = [s ** np.arange(len(part))[::-1] for part in (top, bottom)]
            K_p.append((dtop @ powers[0] - K[i] * (dbottom @ powers[1])) / D)
        G = -K[:, None] * P
        slopes = -(np.array(K_p).T[:, :, None] * P + K[:, None] * by_parameter)
        return G, 1j * self._period * z * -(K_z[:, None] * P + K[:, None] * by_z), slopes

    def _gains(self, loop: int, grid: Array) -> list[LoopValue]:
        """Return the gain margins at crossings, and that at the Nyquist frequency."""
        L, _, slopes = self._derivatives(loop, float(grid[-1]))
        last = [LoopValue(-1 / L.real, slopes.real / L.real**2, float(grid[-1]))] if -1 < L.real < 0 else []
        return super()._gains(loop, grid[:-1]) + last


def _coefficients(
    part: Sequence[Any], values: Mapping[str, float], names: Sequence[str]
) -> tuple[Array, Array]:
    """Return coefficients and their derivatives (p x coefficients)."""
    numbers = [evaluated(coefficient, values) for coefficient in part]
    slopes = np.array([[number.slopes.get(name, 0.0) for number in numbers] for name in names])
    return np.array([number.value for number in numbers]), slopes.reshape(len(names), len(numbers))


def refuse_sampling(loops: Sequence[Loop], names: Sequence[str]) -> None:
    """Raise `UsageError` for sampled loops that are not designed."""
    for loop in loops:
        sampling = loop.sampling
        if sampling is None and loop.delayed:
            raise UsageError(
                "sampled loops around delays or lines are not designed",
                remedy="Design them with 'delay' in place of 'sample': computation and half a period.",
                names=[loop.place] if loop.place else [],
            )
        if sampling is None:
            continue
        if sampling.method == "zoh":
            raise UsageError(
                "a controller of 'method: zoh' is not designed",
                remedy="Choose tustin, or write its coefficients in z (method: z).",
                names=[loop.place],
            )
        times = (sampling.period, sampling.computation)
        if any(isinstance(time, Dependent) and time.names & {*names} for time in times):
            raise UsageError(
                "a sample time that depends on a free parameter is not designed",
                remedy="Hold the sample time at a number.",
                names=[loop.place],
            )
