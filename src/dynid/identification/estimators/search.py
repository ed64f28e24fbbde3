"""Attempts to find the greatest likelihood, until one is accepted."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError
from dynid.identification.diagnostics import is_coloured, is_explained
from dynid.identification.ensemble import Likelihood
from dynid.identification.estimators.estimation import Estimation, Stage, Sweep
from dynid.identification.estimators.output_error import refine
from dynid.progress import counted, tell

Array = NDArray[np.float64]

Begun: TypeAlias = tuple[Array, list[Sweep]]
"""Where an attempt begins: logarithms (p), and the sweeps that led there."""

#: Nets of starts: how many, how far from the given start (a factor), and how many of the best are tried.
NETS = ((64, 100.0, 6), (512, 300.0, 12))
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
        self.attempts: list[tuple[Stage, list[Sweep]]] = []
        self.failure: DynidError | None = None

    def attempt(self, name: str, begun: Callable[[], Begun]) -> None:
        """Begin, and go from where that ends to the nearest optimum."""
        tell(name)
        try:
            logs, histories = begun()
            way = refine(self.ensemble, logs)
        except DynidError as error:  # far off a pass may run away: another start may not
            self.failure = self.failure or error
            return
        self.attempts.append((Stage(name, way.fits), histories))

    @property
    def accepted(self) -> bool:
        """Whether the residuals of the last attempt are noise, or nothing."""
        if not self.attempts:
            return False
        fit = self.attempts[-1][0].fit
        ratio, p = self.ensemble.residual_ratio(fit), self.ensemble.whiteness(fit)
        if np.mean(ratio**2) >= 1:  # nothing is explained, in few values or in many
            return False
        if self.content and is_explained(ratio, p):
            return True
        return bool(np.all(ratio <= _EXACT)) or not is_coloured(p)

    @property
    def agreed(self) -> bool:
        """Whether the two best attempts end at one optimum, with residuals that are small."""
        ranked = self._ranked()
        if len(ranked) < 2:
            return False
        best, second = (stage.fit for stage, _ in ranked[:2])
        explained = is_explained(self.ensemble.residual_ratio(best), 0.0)
        return explained and bool(np.all(np.abs(best.logs - second.logs) <= _SAME))

    def best(self) -> Estimation:
        """Return the attempt of the greatest likelihood."""
        if not self.attempts:
            assert self.failure is not None
            raise self.failure
        stage, histories = self._ranked()[0]
        return Estimation(stage.fit, histories, [stage for stage, _ in self.attempts])

    def _ranked(self) -> list[tuple[Stage, list[Sweep]]]:
        return sorted(self.attempts, key=lambda attempt: self.ensemble.misfit(attempt[0].fit))


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
        return ensemble.misfit(ensemble.fit(logs))
    except DynidError:
        return np.inf
