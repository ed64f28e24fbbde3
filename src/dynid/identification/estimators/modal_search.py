"""The default estimator of measured modes, alone or together with records or frequency responses.

Modes have few local optima: those where modes are paired wrongly, and those at a veering of two frequencies,
where shapes change so fast that steps are small. An optimum counts where a second search ends there that
begins as a compromise: with deviations so large that the values of small scatter do not lead. Where the two
differ, or the residuals are not scatter, modes that are close are first compared by the span of their shapes,
which does not veer, and other starts are drawn. Records of time and frequency responses, whose misfit has
many local optima, start from where the modes lead.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynid.identification.estimators.auto import Search, drawn_starts, guided
from dynid.identification.estimators.estimate import Estimate
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.modal_record import ModalGuide, ModalRecord

Array = NDArray[np.float64]

# Frequencies nearer than this part have one span, on the way to an optimum.
_WIDE = 0.15
# Least deviation of a compromise, relative: that of a poor initial guess rather than that of the scatter.
_COMPROMISE = 0.1
# Rounds of starts: how many are drawn, and how far from the given one (a factor).
_ROUNDS = ((8, 3.0), (16, 10.0))
# How many searches are to end at the best optimum where the residuals are not scatter, and where they are.
# With records of time or responses, whose evaluations are dearer, one round is drawn, and fewer are to agree.
_AGREEING, _CONFIRMED, _AGREEING_RECORDS = 8, 2, 3


@dataclass(frozen=True)
class ModalSearch:
    """Estimator of measured modes: maximum likelihood; spans of close modes and other starts where needed.

    Parameters
    ----------
    multi_start
        True: other starts than the given one may be tried.
    """

    multi_start: bool = True
    name: str = "auto"

    def run(self, likelihood: Likelihood, origin: Array) -> Estimate:
        """Estimate, from the coordinates `origin` (p).

        Raises
        ------
        DynidError
            The first error, if no attempt was completed.
        """
        own = tuple(record for record in likelihood.records if isinstance(record, ModalRecord))
        alone = len(own) == len(likelihood.records)
        own = tuple(record.with_error(np.maximum(record.error, _COMPROMISE)) for record in own)
        modes = ModalGuide(own, at=origin)
        spans = ModalGuide(tuple(record.by_spans(_WIDE) for record in own), at=origin)
        route: list[Likelihood] = [] if alone else [modes]
        search = Search(likelihood, agreeing=_AGREEING if alone else _AGREEING_RECORDS)
        search.attempt("the start", partial(guided, route, origin))
        if not self.multi_start or (not alone and search.accepted and not search.vague):
            return search.best()
        if alone:
            search.attempt("a compromise", partial(guided, [modes], origin), drawn=True)
            if search.accepted and search.agreeing >= _CONFIRMED and not search.vague:
                return search.best()
        routes: list[list[Likelihood]] = [[modes], [spans] if alone else [spans, modes]]
        search.attempt("spans of close modes", partial(guided, routes[1], origin), drawn=alone)
        for seed, (count, reach) in enumerate(_ROUNDS if alone else _ROUNDS[:1]):
            starts = drawn_starts(likelihood.priors, origin, count, reach, seed)
            for number, start in enumerate(starts, 1):
                if search.agreed or (search.accepted and (not alone or search.agreeing >= _CONFIRMED)):
                    return search.best()
                route = routes[number % 2]
                search.attempt(f"start {number} of {count}", partial(guided, route, start), drawn=True)
        return search.best()
