"""The default estimator: the cheapest that the residuals accept.

A pass of the filter goes over local minima that a fit of the whole record from far off falls into; Levenberg–
Marquardt then goes to the maximum of the likelihood, where the filter does not. Where the residuals reject
what that gives, passes follow whose assumed noise is annealed; where these end elsewhere or nowhere, the
likelihood is looked at on a net of starts, and the best of them are tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError
from dynid.identification.diagnostics import is_coloured, is_explained
from dynid.identification.ensemble import Ensemble
from dynid.identification.estimators.estimation import Estimation, Stage, Sweep
from dynid.identification.estimators.output_error import refine
from dynid.identification.estimators.passes import annealed_passes, last, run_passes

Array = NDArray[np.float64]

#: Nets of starts: how many, how far from the given start (a factor), and how many of the best are tried.
_NETS = ((64, 100.0, 6), (512, 300.0, 12))
#: Two results are one optimum if the logarithms agree to this.
_SAME = 0.02
#: Residuals below this part of a channel's RMS are accepted whatever their colour.
_EXACT = 1e-6


@dataclass(frozen=True)
class Auto:
    """Estimator: a filter pass and maximum likelihood; more passes or starts only where they are needed.

    Parameters
    ----------
    escalates
        Whether more than the first pass may be tried.
    """

    escalates: bool = True
    name: str = "auto"

    def run(self, ensemble: Ensemble, origin: Array) -> Estimation:
        """Estimate, from the logarithms `origin` (p).

        Raises
        ------
        DynidError
            What went wrong at first, if no attempt came to an end.
        """
        search = _Search(ensemble)
        search.attempt("a filter pass", partial(run_passes, ensemble, 1, origin))
        if not self.escalates:
            return search.best()
        if not search.accepted:
            search.attempt("annealed passes", partial(annealed_passes, ensemble, origin))
        for count, reach, tried in _NETS:
            if search.accepted or search.agreed:
                break
            for place, logs in enumerate(_best_of_net(ensemble, origin, count, reach)[:tried], 1):
                search.attempt(f"start {place} of {count}", partial(run_passes, ensemble, 1, logs))
                if search.accepted:
                    break
        return search.best()


class _Search:
    """Attempts so far, and whether they are enough."""

    def __init__(self, ensemble: Ensemble) -> None:
        self.ensemble = ensemble
        self.attempts: list[tuple[Stage, list[Sweep]]] = []
        self.failure: DynidError | None = None

    def attempt(self, name: str, filtered: Callable[[], list[Sweep]]) -> None:
        """Run passes, and go from where they end to the nearest optimum."""
        try:
            histories = filtered()
            way = refine(self.ensemble, last(self.ensemble, histories))
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
        small = self.ensemble.residual_ratio(fit) <= _EXACT
        return bool(small.all()) or not is_coloured(self.ensemble.whiteness(fit))

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


def _best_of_net(ensemble: Ensemble, origin: Array, count: int, reach: float) -> list[Array]:
    """Return starts spread evenly around the origin, the likeliest first."""
    from scipy.stats import qmc  # heavy import, needed only here

    net = qmc.Sobol(len(origin), rng=np.random.Generator(np.random.PCG64(0))).random(count)
    starts = origin + np.log(reach) * (2 * net - 1)
    starts = ensemble.knowledge.clipped(starts)
    misfits = [_misfit_at(ensemble, logs) for logs in starts]
    return [starts[place] for place in np.argsort(misfits, kind="stable")]


def _misfit_at(ensemble: Ensemble, logs: Array) -> float:
    try:
        return ensemble.misfit(ensemble.fit(logs))
    except DynidError:
        return np.inf
