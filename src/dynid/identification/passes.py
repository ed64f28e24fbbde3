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
from dynid.identification.filter import Pass, filter_pass
from dynid.identification.fit import Fit, Fitter

Array = NDArray[np.float64]

# The first pass assumes a noise that falls from twice the RMS to a twentieth, over an eighth of the record:
# from far off the early samples must not narrow the covariance, the linearisation is wrong there.
_FIRST_NOISE = 2.0
_LAST_NOISE = 0.05
_FALL = 0.125


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

    def __post_init__(self) -> None:
        if self.passes < 1:
            raise UsageError("the filter needs at least one pass")


def run_passes(fitter: Fitter, estimator: Filter, origin: Array) -> tuple[list[Pass], list[Fit]]:
    """Run the passes; return each one's history and the fit at its final parameters.

    Parameters
    ----------
    fitter
        The record and the model.
    estimator
        The number of passes.
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
    deviation = level[:, None] * rms
    prior = fitter.wide_prior(origin)
    histories, fits = [], []
    for _ in range(estimator.passes):
        history = filter_pass(fitter.model, values, prior, deviation, origin)
        fit = fitter.fit(history.logs[-1], values)
        histories.append(history)
        fits.append(fit)
        prior = fitter.unit_prior(fit)
        deviation = fitter.floored(fit.noise)
    return histories, fits
