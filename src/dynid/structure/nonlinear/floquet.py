"""Stability of steady states by Floquet's multipliers, from the march over a period with its sensitivities.

The monodromy matrix is the derivative of the state after a period by the first state and the first hidden
states; jumps at events are in it. Its eigenvalues are the multipliers (G. Floquet 1883): disturbances decay
where all are below 1. The march begins on the steady state, and has to return to it: an independent check.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError
from dynid.lti.exponential import balance, rescaled
from dynid.structure.nonlinear.harmonic_balance import Condensed
from dynid.structure.nonlinear.march import march
from dynid.structure.nonlinear.tables import LinearRest, Motion, Refine, Regimes, Steps, load_points

# Change of the state over a period, relative to its size, beyond which a march does not confirm a steady
# state: harmonics that are left out change it by less.
_PERIOD_TOL = 1e-3
# Steps of a period to begin with, and those beyond which the steady state is not confirmed.
_STEPS, _MAX_STEPS = 16, 256
# Size of a multiplier above 1 that is round-off: of sliders that never slip, whose multiplier is 1, and of
# rigid-body motions, which are defective.
_MARGIN = 1e-6


class Stability(NamedTuple):
    """Multipliers of a steady state, and the change of the state over its period, relative to its size."""

    multipliers: ComplexArray
    change: float

    @property
    def stable(self) -> bool:
        """True if no disturbance grows."""
        return not self.instability

    @property
    def instability(self) -> str:
        """The bifurcation behind which a state is unstable, by its largest multiplier; empty if it is stable.

        ``fold`` (or branching) where this is above 1, ``period doubling`` where it is below -1, and
        ``Neimark-Sacker`` where it is complex: motion of two frequencies.
        """
        size = np.abs(self.multipliers)
        if size.max(initial=0.0) <= 1 + _MARGIN:
            return ""
        largest = self.multipliers[size.argmax()]
        if abs(largest.imag) > _MARGIN * size.max():
            return "Neimark-Sacker"
        return "fold" if largest.real > 0 else "period doubling"


class FloquetAnalysis:
    """The march of a structure over periods of a load ``amplitude cos(omega t)``; `load`: modal (n)."""

    def __init__(self, structure: Condensed, load: Array, amplitude: float) -> None:
        s, n = structure, len(structure.eigenvalues)
        R, damping = s.deflections, s.damping if s.damping.ndim == 2 else np.diag(s.damping)
        stiffness = np.diag(s.eigenvalues) - R.T @ (s.k[:, None] * R)
        A = np.zeros((2 * n, 2 * n))
        A[:n, n:] = np.eye(n)
        A[n:, :n], A[n:, n:] = -stiffness, -(damping - R.T @ (s.c[:, None] * R))
        D = np.concatenate([np.zeros((n, len(R) + 1)), np.column_stack([-R.T, amplitude * load])])
        self.scale = balance(A)
        rows = np.kron(np.eye(2), R) * self.scale
        rest = LinearRest(rescaled(A, self.scale), D / self.scale[:, None], rows, len(R), 1)
        self.regimes, self.steps = Regimes(rest, s.laws), _STEPS
        hidden = [2 * n + index for index, law in enumerate(s.laws) if law.law.hidden]
        self.states = [*range(2 * n), *hidden]

    def stability(self, omega: float, motion: ComplexArray, hidden: Array) -> Stability:
        """Return the multipliers of a steady state.

        `motion`: amplitudes of the modes (H + 1 x n); `hidden`: hidden states at the beginning (laws).

        Raises NumericalError if the march does not return to the steady state after a period.
        """
        rates = 1j * omega * np.arange(len(motion))[:, None] * motion
        x0 = np.concatenate([motion.sum(axis=0).real, rates.sum(axis=0).real]) / self.scale
        size = float(np.abs(np.concatenate([motion, rates], axis=1) / self.scale).sum(axis=0).max())
        points, inverse = load_points()
        change = np.inf
        while self.steps <= _MAX_STEPS:
            angles = 2 * np.pi * (np.arange(self.steps)[:, None] + points) / self.steps
            steps = Steps(
                np.full(self.steps, 2 * np.pi / omega / self.steps),
                (np.cos(angles) @ inverse.T)[:, :, None],
                np.array([self.steps]),
            )
            followed: Motion | None = None
            with suppress(Refine):
                followed = march(
                    self.regimes.rest, self.regimes.laws, steps, x0, hidden, first=True, kept=self.regimes
                )
            self.regimes.forget_steps()
            if followed is not None:
                change = float(np.abs(followed.states[0] - x0).max()) / size
                if change <= _PERIOD_TOL:
                    matrix = np.concatenate([followed.slopes[0], followed.hidden_slopes[0]])
                    matrix = matrix[np.ix_(self.states, self.states)]
                    return Stability(np.linalg.eigvals(matrix).astype(complex), change)
            self.steps *= 2
        self.steps = _STEPS
        raise NumericalError(
            f"a march over a period does not return to the steady state at {omega:.6g} rad/s: it is off by "
            f"{100 * change:.2g} %",
            remedy="Allow more 'harmonics', or leave out 'stability'.",
        )
