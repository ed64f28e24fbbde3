"""Linear systems with constant delays inside, as linear fractional forms, and their time responses.

``v_i(t) = z_i(t - τ_i)`` joins outputs z of a `StateSpace` to inputs v (Bellman & Cooke 1963, 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from dynid.arrays import Array
from dynid.errors import NumericalError, UsageError
from dynid.lti.generator import Signal
from dynid.lti.method_of_steps import Propagation, break_orders
from dynid.lti.state_space import StateSpace

#: Degree of the polynomials, and their last coefficients relative to the largest value, of the run that
#: estimates the error.
_CHECK_DEGREE, _CHECK_TAIL_RTOL = 16, 1e-14
#: Instants at which the error is estimated.
_CHECKED_TIMES = 100


@dataclass(frozen=True, eq=False)
class DelaySystem:
    """A linear system with internal delays: ``v_i(t) = z_i(t - delays[i])``, zero before t = 0.

    With m delays the last m inputs of `lft` are v, its last m outputs z; those before are u and y.
    """

    lft: StateSpace
    delays: tuple[Fraction, ...]  # s, positive, exact

    def __post_init__(self) -> None:
        if any(delay <= 0 for delay in self.delays):
            raise UsageError("the delays of a system must be positive")
        if len(self.delays) > min(self.lft.D.shape):
            raise UsageError(f"{len(self.delays)} delays for {self.lft.D.shape} outputs and inputs")
        order = break_orders(self.lft)[len(self.lft.C) - len(self.delays) :, self.inputs :]
        path = np.where(np.eye(len(order), dtype=bool), np.minimum(order, 0), order)
        for k in range(len(path)):  # Floyd-Warshall: a loop that differentiates has a negative length
            path = np.minimum(path, path[:, k, None] + path[None, k])
        if np.any(np.diag(path) < 0):
            raise NumericalError(
                "a delayed term differentiates more often than any prompt one: the loop is advanced, and its "
                "response grows faster than any exponential",
                remedy="Add a filter to the controller (tf of a PID).",
            )

    @property
    def inputs(self) -> int:
        """The number of inputs u."""
        return len(self.lft.B.T) - len(self.delays)

    @property
    def outputs(self) -> int:
        """The number of outputs y."""
        return len(self.lft.C) - len(self.delays)

    def with_inputs(self, names: Sequence[str]) -> DelaySystem:
        """Return it with these inputs u; a name that repeats is several inputs that act alike."""
        return replace(self, lft=self.lft.with_inputs([*names, *self.lft.inputs[self.inputs :]]))

    def with_outputs(self, rows: Sequence[int]) -> DelaySystem:
        """Return it with these of its outputs y."""
        lft, rows = self.lft, [*rows, *range(self.outputs, len(self.lft.C))]
        kept = replace(
            lft,
            C=lft.C[rows],
            D=lft.D[rows],
            higher=tuple(matrix[rows] for matrix in lft.higher),
            outputs=tuple(lft.outputs[row] for row in rows),
            output_units=tuple(lft.output_units[row] for row in rows),
        )
        return replace(self, lft=kept)

    @property
    def paces(self) -> tuple[Fraction, ...]:
        """The times, s, by which it acts on itself."""
        return self.delays

    def propagation(self, signals: Sequence[Signal], stop: float, **options: Any) -> Propagation:
        """Return a run of it from rest at t = 0."""
        return Propagation(self.lft, self.delays, signals, stop, **options)

    def response(self, signals: Sequence[Signal], times: Array) -> DelayedResponse:
        """Return the response from rest at t = 0 to one signal per input u, after jumps at their instants.

        Times, s, increase from 0 on. Dirac parts of outputs are not returned but marked. The error is the
        difference from a run with higher degree, smaller tolerance and coefficients of the system changed by
        one rounding. Raises `UsageError` beyond `MAX_SEGMENTS`.
        """
        run = self.propagation(signals, float(times[-1]))
        outputs = run.outputs(times)
        instants = np.unique(np.linspace(0, len(times) - 1, min(len(times), _CHECKED_TIMES)).astype(int))
        check = replace(self, lft=_perturbed(self.lft)).propagation(
            signals, float(times[-1]), degree=_CHECK_DEGREE, rtol=_CHECK_TAIL_RTOL
        )
        difference = np.abs(check.outputs(times[instants]) - outputs[instants]).max(axis=0, initial=0.0)
        inputs = np.stack([signal.value(times) for signal in signals], axis=1) if signals else None
        return DelayedResponse(
            outputs,
            np.zeros((len(times), 0)) if inputs is None else inputs,
            difference,
            run.impulsive,
            run.count,
        )


class DelayedResponse(NamedTuple):
    """A time response of a system with delays."""

    outputs: Array  # times x outputs
    inputs: Array  # times x inputs u
    error: Array  # estimated, of each output, in its unit
    impulsive: Array  # outputs with a Dirac part, which is not shown
    segments: int  # polynomials that it took


def _perturbed(lft: StateSpace) -> StateSpace:
    """Return a system with every coefficient changed by one rounding."""
    rng = np.random.default_rng(0)

    def moved(matrix: Array) -> Array:
        return np.asarray(matrix * (1 + np.finfo(float).eps * rng.choice([-1.0, 1.0], matrix.shape)))

    A, B, C, D = map(moved, (lft.A, lft.B, lft.C, lft.D))
    return replace(lft, A=A, B=B, C=C, D=D, higher=tuple(map(moved, lft.higher)))
