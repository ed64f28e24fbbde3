"""The default estimator of measured modes, alone or together with records or frequency responses.

Modes have few local optima: those where modes are paired wrongly, and those at a veering of two frequencies,
where shapes change so fast that steps are small. So where the residuals are not scatter, modes that are close
are first compared by the span of their shapes, which does not veer, and other starts are drawn near the given
one. Records of time and frequency responses, whose misfit has many local optima, start from where the modes
lead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dynid.identification.estimators.auto import Search, drawn_starts, guided
from dynid.identification.estimators.estimate import Estimate
from dynid.identification.likelihood import Likelihood
from dynid.identification.records.modal_record import ModalGuide, ModalRecord

Array = NDArray[np.float64]

# Frequencies nearer than this part have one span, on the way to an optimum.
_WIDE = 0.15
# Starts that are drawn at most, how far from the given one (a factor), and how many are to agree.
_STARTS, _REACH, _AGREEING = 6, 2.5, 3


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
        begun = [r.begun(origin) if isinstance(r, ModalRecord) else r for r in likelihood.records]
        likelihood = replace(likelihood, records=tuple(begun))
        own = tuple(record for record in likelihood.records if isinstance(record, ModalRecord))
        alone = len(own) == len(likelihood.records)
        modes = ModalGuide(own, at=origin)
        spans = ModalGuide(tuple(record.by_spans(_WIDE) for record in own), at=origin)
        routes: list[list[Likelihood]] = [[] if alone else [modes], [spans] if alone else [spans, modes]]
        search = Search(likelihood, agreeing=_AGREEING)
        search.attempt("the start", partial(guided, routes[0], origin))
        if not self.multi_start or (search.accepted and not search.vague):
            return search.best()
        if search.tried:  # errors of the model's form are about the same at all optima
            search.likelihood = likelihood.continuing(search.best_tried.likelihood)
        search.attempt("spans of close modes", partial(guided, routes[1], origin))
        if not search.accepted:
            for number, start in enumerate(drawn_starts(likelihood.priors, origin, _STARTS, _REACH, 0), 1):
                route = routes[number % 2]
                search.attempt(f"start {number} of {_STARTS}", partial(guided, route, start), drawn=True)
                if search.agreed:
                    break
        return search.best()
