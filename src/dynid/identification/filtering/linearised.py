"""The steps of a pass, linearised about parameters that the estimate has hardly left.

Between samples the physical part is propagated exactly at parameters near the estimate, and to first order in
the difference of their values: of these a short step is nearly linear, of their logarithms it is not. It is
made anew where a logarithm has moved by its own standard deviation. What the first order leaves out is then
some thousandths of what the filter leaves out anyway, which linearises about an estimate that is off by that
deviation; so a pass asks for some tens of matrix exponentials, not for one a sample, and for hardly more over
a longer record.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.choices import LINEARISED
from dynid.identification.augmented import AugmentedModel

Array = NDArray[np.float64]

#: How far a logarithm may move before steps are linearised anew: in its standard deviations, and at the most.
PART, MOST = LINEARISED.value, 0.1


class Step(NamedTuple):
    """``forward`` (n (1 + p) x n + q) takes [x, w] to the next state and its derivatives by the logarithms.

    `phi` (n x n) is its part of x, `phi_slopes` (p x n n) the derivatives of that.
    """

    forward: Array
    phi: Array
    phi_slopes: Array


class Linearised:
    """The steps of a model about some logarithms, made when they are needed.

    Parameters
    ----------
    model
        The model.
    part
        How far a logarithm may move, in its deviations.
    """

    def __init__(self, model: AugmentedModel, part: float) -> None:
        self._model, self._part = model, part
        self._steps: dict[int, Step] = {}
        self.logs = np.full(model.parameters, np.nan)

    def follow(self, logs: Array, spread: Array) -> None:
        """Linearise anew if logarithms of these deviations (p) have left the present ones."""
        if not np.all(np.abs(logs - self.logs) <= np.minimum(self._part * spread, MOST)):
            self.logs = logs.copy()
            self._steps.clear()

    def growth(self, logs: Array) -> Array:
        """Return by what part the values of logarithms (p) exceed those of the steps, to second order."""
        left = logs - self.logs
        return np.asarray(left + left * left / 2)

    def step(self, length: int) -> Step:
        """Return the step of a length of the timeline."""
        if length not in self._steps:
            n = self._model.states
            step, slopes = self._model.transition(self.logs, float(self._model.line.lengths[length]))
            forward = np.concatenate([step[None], slopes]).reshape(-1, step.shape[1])
            phi_slopes = slopes[:, :, :n].reshape(len(slopes), n * n)
            self._steps[length] = Step(forward, step[:, :n], phi_slopes)
        return self._steps[length]
