"""Maximum likelihood by output error: Levenberg–Marquardt on the logarithms of the parameters.

The initial state is linear for fixed parameters and is solved for in every step (variable projection: G. H.
Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413–432), so that steps are taken in the parameters alone,
with exact sensitivities. Where the noise of a channel is not given, what is minimised is the concentrated
likelihood, the sum over channels of the count of values times the logarithm of the residuals' RMS.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError, UsageError
from dynid.identification.ensemble import JointFit, Likelihood
from dynid.identification.estimators.estimation import Estimation, Stage
from dynid.identification.filtering.filter import check_run_away
from dynid.identification.information import Information, least_squares
from dynid.progress import tell

Array = NDArray[np.float64]

#: Longest step of a logarithm: a factor of 4.5.
_LONGEST = 1.5
#: First damping, its least and its most; it falls and rises tenfold.
_DAMPING, _LEAST, _MOST = 1e-3, 1e-10, 1e6
#: A step is the last if what is left after it is below this part of the standard errors, or this size.
_PART, _SIZE = 1e-3, 1e-11


class Way(NamedTuple):
    """Where a search for the greatest likelihood ends (`fit`), after how many `steps`."""

    fit: JointFit
    steps: int


@dataclass(frozen=True)
class OutputError:
    """Estimator: maximum likelihood from the start values, without a filter.

    Parameters
    ----------
    iterations
        Most steps.
    """

    iterations: int = 50
    name: str = "output-error"

    def __post_init__(self) -> None:
        if self.iterations < 1:
            raise UsageError("output error needs at least one iteration")

    def run(self, ensemble: Likelihood, origin: Array) -> Estimation:
        """Estimate, from the logarithms `origin` (p).

        Raises
        ------
        Diverged
            If the parameters run away.
        """
        way = refine(ensemble, origin, self.iterations)
        return Estimation(way.fit, [], [Stage.at("output error", ensemble, way.fit, way.steps)])


def refine(ensemble: Likelihood, logs: Array, iterations: int = 50) -> Way:
    """Go to the nearest maximum of the likelihood.

    Parameters
    ----------
    ensemble
        The records and the model.
    logs
        Logarithms to start from (p).
    iterations
        Most steps.

    Raises
    ------
    Diverged
        If a parameter leaves its start by a factor of a million.
    """
    fit = ensemble.fit(logs)
    misfit = ensemble.misfit(fit)
    damping, before = _DAMPING, 0.0
    for number in range(1, iterations + 1):
        tell(f"maximum likelihood, step {number}")
        noise = ensemble.likeliest(fit)
        information = ensemble.information(fit, noise)
        residual = ensemble.weighted(fit, noise)
        held = ensemble.knowledge.blocked(fit.logs, information.projected.T @ residual)
        better = None
        while better is None and damping <= _MOST:
            step = np.where(held, 0.0, _step(information.without(held), residual, damping))
            target = ensemble.knowledge.clipped(fit.logs + step)
            better, step = _improved(ensemble, target, noise, misfit), target - fit.logs
            damping *= 1.0 if better else 10.0
        if better is None:  # no step improves: rounding is all that is left
            return Way(fit, number - 1)
        fit, misfit = better
        check_run_away(ensemble.unknowns, fit.logs, logs)
        size = float(np.max(np.abs(step) / np.maximum(_PART * information.deviations(), _SIZE)))
        if _left(size, before) <= 1.0:
            return Way(fit, number)
        damping, before = max(damping / 10, _LEAST), size
    return Way(fit, iterations)


def _left(size: float, before: float) -> float:
    """Return the size of all steps to come, after two of these sizes: a geometric series."""
    return size * size / (before - size) if size < before / 2 else size


def _step(information: Information, residual: Array, damping: float) -> Array:
    """Return a damped Gauss–Newton step (Marquardt's scaling), no logarithm moved too far."""
    J = information.projected
    size = np.linalg.norm(J, axis=0)
    size = np.where(size > 0, size, 1.0)
    p = len(size)
    rows = np.concatenate([J / size, np.sqrt(damping) * np.eye(p)])
    right = np.concatenate([residual, np.zeros(p)])
    step = least_squares(rows, right, 0.0) / size
    return np.asarray(step * min(1.0, _LONGEST / float(np.abs(step).max(initial=_LONGEST))))


def _improved(
    ensemble: Likelihood, logs: Array, noise: Sequence[Array], misfit: float
) -> tuple[JointFit, float] | None:
    """Return the fit at these logarithms and its misfit if that is below this one, else None."""
    try:
        new = ensemble.fit(logs, noise)
    except DynidError:  # so far off that numbers leave their range
        return None
    reached = ensemble.misfit(new)
    return (new, reached) if reached < misfit else None
