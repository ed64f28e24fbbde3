"""Attempts to find the greatest likelihood, until one is accepted."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError
from dynid.identification.diagnostics import is_coloured, is_explained
from dynid.identification.ensemble import JointFit, Likelihood
from dynid.identification.estimators.estimation import Estimation, Stage, Sweep
from dynid.identification.estimators.output_error import refine
from dynid.progress import counted, tell

Array = NDArray[np.float64]

Begun: TypeAlias = tuple[Array, list[Sweep]]
"""Where an attempt begins: logarithms (p), and the sweeps that led there."""

#: Nets of starts: how many, how far from the given start (a factor), and how many of the best are tried.
NETS = ((64, 100.0, 6), (512, 300.0, 6))
#: Two results are one optimum if the logarithms agree to this.
_SAME = 0.02
#: Residuals below this part of a channel's RMS are accepted whatever their colour.
_EXACT = 1e-6


class Search:
    """Attempts so far, and whether they are enough.

    Parameters
    ----------
    ensemble
        What is observed.
    content
        Whether residuals that are small are accepted whatever their colour.
    """

    def __init__(self, ensemble: Likelihood, *, content: bool = False) -> None:
        self.content = content
        self.ensemble = ensemble
        self.stages: list[Stage] = []
        self.failure: DynidError | None = None
        self.accepted = False  # the residuals of the last attempt are noise, or nothing
        self._best: tuple[float, JointFit, list[Sweep]] | None = None

    def attempt(self, name: str, begun: Callable[[], Begun]) -> None:
        """Begin, and go from where that ends to the nearest optimum."""
        tell(name)
        try:
            logs, histories = begun()
            fit, steps = refine(self.ensemble, logs)
        except DynidError as error:  # far off a pass may run away: another start may not
            self.failure = self.failure or error
            return
        stage = Stage.at(name, self.ensemble, fit, steps)
        self.stages.append(stage)
        self.accepted = self._accepts(stage.residual_ratio, self.ensemble.whiteness(fit))
        if self._best is None or stage.misfit < self._best[0]:
            self._best = stage.misfit, fit, histories

    def _accepts(self, ratio: Array, whiteness_p: float) -> bool:
        if np.mean(ratio**2) >= 1:  # nothing is explained, in few values or in many
            return False
        if self.content and is_explained(ratio, whiteness_p):
            return True
        return bool(np.all(ratio <= _EXACT)) or not is_coloured(whiteness_p)

    @property
    def agreed(self) -> bool:
        """Whether the two best attempts end at one optimum, with residuals that are small."""
        ranked = sorted(self.stages, key=lambda stage: stage.misfit)
        if len(ranked) < 2:
            return False
        best, second = ranked[:2]
        explained = is_explained(best.residual_ratio, 0.0)
        return explained and bool(np.all(np.abs(best.logs - second.logs) <= _SAME))

    def best(self) -> Estimation:
        """Return the attempt of the greatest likelihood."""
        if self._best is None:
            assert self.failure is not None
            raise self.failure
        _, fit, histories = self._best
        return Estimation(fit, histories, self.stages)


def best_of_net(ensemble: Likelihood, origin: Array, count: int, reach: float) -> list[Array]:
    """Return starts spread evenly around the origin, the likeliest first."""
    from scipy.stats import qmc  # heavy import, needed only here

    net = qmc.Sobol(len(origin), rng=np.random.Generator(np.random.PCG64(0))).random(count)
    starts = origin + np.log(reach) * (2 * net - 1)
    starts = ensemble.knowledge.clipped(starts)
    misfits = [_misfit_at(ensemble, logs) for logs in counted(starts, "start")]
    return [starts[place] for place in np.argsort(misfits, kind="stable")]


def _misfit_at(ensemble: Likelihood, logs: Array) -> float:
    try:
        return ensemble.misfit_at(logs)
    except DynidError:
        return np.inf
