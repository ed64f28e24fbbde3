"""The default estimator: the cheapest that the residuals accept.

A pass of the filter goes over local minima that a fit of the whole record from far off falls into; Levenberg–
Marquardt then goes to the maximum of the likelihood, where the filter does not. Where the residuals reject
what that gives, passes follow whose assumed noise is annealed; where these end elsewhere or nowhere, the
likelihood is looked at on a net of starts, and the best of them are tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynid.identification.ensemble import Ensemble
from dynid.identification.estimators.estimation import Estimation
from dynid.identification.estimators.passes import annealed_passes, last, run_passes
from dynid.identification.estimators.search import NETS, Begun, Search, best_of_net

Array = NDArray[np.float64]


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
        search = Search(ensemble)
        search.attempt("a filter pass", partial(_filtered, ensemble, origin))
        if not self.escalates or search.accepted:
            return search.best()
        search.attempt("annealed passes", partial(_annealed, ensemble, origin))
        for count, reach, tried in NETS:
            if search.accepted or search.agreed:
                break
            for place, logs in enumerate(best_of_net(ensemble, origin, count, reach)[:tried], 1):
                search.attempt(f"start {place} of {count}", partial(_filtered, ensemble, logs))
                if search.accepted:
                    break
        return search.best()


def _filtered(ensemble: Ensemble, logs: Array) -> Begun:
    """Begin with one pass of the filter."""
    sweeps = run_passes(ensemble, 1, logs)
    return last(ensemble, sweeps), sweeps


def _annealed(ensemble: Ensemble, logs: Array) -> Begun:
    """Begin with passes whose assumed noise is annealed."""
    sweeps = annealed_passes(ensemble, logs)
    return last(ensemble, sweeps), sweeps
