"""The default estimator of frequency response functions: maximum likelihood, from elsewhere where needed.

A response's misfit has a local minimum wherever a measured and a predicted resonance do not overlap; that of
the logarithms of magnitudes slopes towards the resonances from afar. So where the likelihood ends in
residuals that are no noise, magnitudes lead first, and then starts on a net.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynid.identification.ensemble import Likelihood
from dynid.identification.estimators.estimation import Estimation
from dynid.identification.estimators.output_error import refine
from dynid.identification.estimators.search import NETS, Begun, Search, best_of_net
from dynid.identification.frf.fitter import FrfFitter

Array = NDArray[np.float64]

# Most steps on magnitudes, which are to lead near, not to the end.
_STEPS = 20


@dataclass(frozen=True, eq=False)
class FrfLikelihood(Likelihood):
    """The likelihood of frequency response functions."""

    records: tuple[FrfFitter, ...]

    def by_magnitude(self) -> FrfLikelihood:
        """Return the likelihood of the logarithms of magnitudes."""
        return FrfLikelihood(tuple(record.by_magnitude() for record in self.records))


@dataclass(frozen=True)
class FrfAuto:
    """Estimator: maximum likelihood; by magnitudes and from other starts only where it is needed.

    Parameters
    ----------
    content
        Whether residuals that are small are accepted whatever their colour.
    nets
        Whether other starts than the given one may be tried.
    """

    content: bool = False
    nets: bool = True
    name: str = "auto"

    def run(self, ensemble: FrfLikelihood, origin: Array) -> Estimation:
        """Estimate, from the logarithms `origin` (p).

        Raises
        ------
        DynidError
            What went wrong at first, if no attempt came to an end.
        """
        search, magnitudes = Search(ensemble, content=self.content), ensemble.by_magnitude()
        search.attempt("the start", lambda: (origin, []))
        if not search.accepted:
            search.attempt("magnitudes", partial(_led, magnitudes, origin))
        for count, reach, tried in NETS if self.nets else ():
            if search.accepted or search.agreed:
                break
            for place, logs in enumerate(best_of_net(magnitudes, origin, count, reach)[:tried], 1):
                search.attempt(f"start {place} of {count}", partial(_led, magnitudes, logs))
                if search.accepted or search.agreed:
                    break
        return search.best()


def _led(magnitudes: Likelihood, logs: Array) -> Begun:
    """Begin where the magnitudes lead."""
    return refine(magnitudes, logs, _STEPS).fit.logs, []
