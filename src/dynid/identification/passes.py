"""The schedule of filter passes, and its limit.

The last pass leaves the filter's fixed point, where each sample is linearised about the estimate before it.
It is near the maximum-likelihood point of the record, but not that point: with acceleration channels or loud
noise it can be several standard errors off, and more passes do not move it. How far it is the result says
(`identification/diagnostics/distance_to_optimum`); beyond half a standard error it is not `settled`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import UsageError
from dynid.identification.estimation import Estimation, Stage
from dynid.identification.filter import Pass, filter_pass
from dynid.identification.fit import Fitter

Array = NDArray[np.float64]

# The first pass assumes a noise that falls from twice the RMS to a twentieth, over an eighth of the record:
# from far off the early samples must not narrow the covariance, the linearisation is wrong there.
_FIRST_NOISE = 2.0
_LAST_NOISE = 0.05
_FALL = 0.125


# Annealing, pass by pass: the noise assumed, over the RMS, and the prior's deviation of the logarithms.
_ANNEALED = ((0.5, 2.0), (0.2, 1.0), (0.08, 0.5), (0.03, 0.3))


@dataclass(frozen=True)
class Filter:
    """Estimator: several passes of the filter of the augmented state.

    Each pass restarts from the last one's parameters with a fresh covariance (`Fitter.unit_prior`) and the
    noise that the last one's residuals show. They converge to the filter's fixed point, which is not exactly
    the maximum-likelihood point; where the two differ, more passes do not help.

    Parameters
    ----------
    passes
        Number of passes over the record.
    """

    passes: int = 2
    name: str = "filter"

    def __post_init__(self) -> None:
        if self.passes < 1:
            raise UsageError("the filter needs at least one pass")

    def run(self, fitter: Fitter, origin: Array) -> Estimation:
        """Estimate, from the logarithms `origin` (p).

        Raises
        ------
        Diverged
            If the parameters run away.
        """
        histories = run_passes(fitter, self.passes, origin)
        fit = fitter.fit(histories[-1].logs[-1], fitter.data.values)
        return Estimation(fit, histories, [Stage("filter", [fit])])


def run_passes(fitter: Fitter, passes: int, origin: Array) -> list[Pass]:
    """Run passes of the filter.

    Parameters
    ----------
    fitter
        The record and the model.
    passes
        How many.
    origin
        Logarithms of the initial parameters (p).

    Raises
    ------
    Diverged
        If the parameters run away.
    """
    values, rms = fitter.data.values, fitter.data.rms
    progress = np.arange(len(values)) / (_FALL * len(values))
    level = np.maximum(_LAST_NOISE, _FIRST_NOISE * np.exp(-progress))
    histories = [filter_pass(fitter.model, values, fitter.wide_prior(origin), level[:, None] * rms, origin)]
    while len(histories) < passes:
        fit = fitter.fit(histories[-1].logs[-1], values)
        prior, noise = fitter.unit_prior(fit), fitter.floored(fit.noise)
        histories.append(filter_pass(fitter.model, values, prior, noise, origin))
    return histories


def annealed_passes(fitter: Fitter, origin: Array) -> list[Pass]:
    """Run passes that trust the record, and themselves, more from one to the next.

    It takes longer than `run_passes` and gets there from farther away.

    Parameters
    ----------
    fitter
        The record and the model.
    origin
        Logarithms of the initial parameters (p).

    Raises
    ------
    Diverged
        If the parameters run away.
    """
    histories: list[Pass] = []
    logs = origin
    for level, spread in _ANNEALED:
        prior = fitter.wide_prior(logs, spread)
        noise = level * fitter.data.rms
        histories.append(filter_pass(fitter.model, fitter.data.values, prior, noise, logs))
        logs = histories[-1].logs[-1]
    return histories
