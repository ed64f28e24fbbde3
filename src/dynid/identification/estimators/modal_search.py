"""The default estimator of measured modes, alone or together with records or frequency responses.

Modes have few local optima: those where modes are paired wrongly, and those at a veering of two frequencies,
where shapes change so fast that steps are small. An optimum counts where a second search ends there that
begins as a compromise: with deviations so large that the values of small scatter do not lead. Where the two
differ, or the residuals are not scatter, modes that are close are first compared by the span of their shapes,
which does not veer, and other starts are drawn. Where the residuals of the best optimum are not scatter,
starts around it have to lead to it again: that verdict depends on the optimum, not on the scene's start.
Records of time and frequency responses, whose misfit has many local optima, start from where the modes lead.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dynid.arrays import Array
from dynid.identification.estimators.auto import Search, drawn_starts, guided
from dynid.identification.estimators.estimate import Estimate
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.modal_record import ModalRecord

# Frequencies nearer than this part have one span, on the way to an optimum.
_SPAN_RTOL = 0.15
# Least deviation of a compromise, relative: that of a poor initial guess rather than that of the scatter.
_COMPROMISE = 0.1
# Attempts from the given start: as it is, by a compromise, by spans of close modes.
_FROM_START = 3
# Starts around the given one: how many are drawn, and how far from it (a factor).
_AROUND_START = (8, 3.0)
# Starts around the best optimum: how many are drawn, and how far from it (a factor); how many optima, each
# better than the one before, are tried.
_AROUND_OPTIMUM, _MAX_OPTIMA = (16, 10.0), 3
# How many searches are to end at the best optimum where the residuals are not scatter, and where they are.
# With records of time or responses, whose evaluations are dearer, one round is drawn, and fewer are to agree.
_AGREEING, _CONFIRMED_SEARCHES, _AGREEING_RECORDS = 8, 2, 3


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
        surveys = tuple(record for record in likelihood.records if isinstance(record, ModalRecord))
        alone = len(surveys) == len(likelihood.records)
        surveys = tuple(record.with_error(np.maximum(record.error, _COMPROMISE)) for record in surveys)
        modes = _guide(surveys, origin)
        spans = _guide(tuple(record.by_spans(_SPAN_RTOL) for record in surveys), origin)
        route: list[Likelihood] = [] if alone else [modes]
        search = Search(likelihood, agreeing=_AGREEING if alone else _AGREEING_RECORDS)
        search.attempt("the start", partial(guided, route, origin))
        if not self.multi_start or (not alone and search.accepted and not search.vague):
            return search.best()
        if alone:
            search.attempt("a compromise", partial(guided, [modes], origin), drawn=True)
            if search.accepted and search.agreeing >= _CONFIRMED_SEARCHES and not search.vague:
                return search.best()
        routes: list[list[Likelihood]] = [[modes], [spans] if alone else [spans, modes]]
        search.attempt("spans of close modes", partial(guided, routes[1], origin), drawn=alone)
        count, reach = _AROUND_START
        for number, start in enumerate(drawn_starts(likelihood.priors, origin, count, reach, 0), 1):
            alike = _is_confirmed(search) or (bool(search.tried) and search.agreeing >= _FROM_START)
            if search.agreed or (alike if alone else search.accepted):
                break
            search.attempt(
                f"start {number} of {count}", partial(guided, routes[number % 2], start), drawn=True
            )
        if alone and search.tried and not _is_confirmed(search):
            _confirm(search, routes)
        return search.best()


def _guide(records: tuple[ModalRecord, ...], origin: Array) -> Likelihood:
    """Return the likelihood of modes alone; what they do not determine stays near `origin` (p)."""
    likelihood = Likelihood(records)
    priors, spread = likelihood.priors, [unknown.first_spread for unknown in likelihood.unknowns]
    means = np.where(priors.has_prior, priors.means, origin)
    deviations = np.where(priors.has_prior, priors.deviations, spread)
    return replace(likelihood, stated_priors=replace(priors, means=means, deviations=deviations))


def _is_confirmed(search: Search) -> bool:
    """Return True if the residuals of the best optimum are scatter, and searches have ended there twice."""
    return search.accepted and search.agreeing >= _CONFIRMED_SEARCHES


def _confirm(search: Search, routes: list[list[Likelihood]]) -> None:
    """Search from starts around the best optimum until enough of them, and half of all, end there."""
    count, reach = _AROUND_OPTIMUM
    search.confirmed = False
    for _ in range(_MAX_OPTIMA):
        best, agreeing = search.best_tried.stage, 0
        starts = drawn_starts(search.likelihood.priors, best.eta, count, reach, 1)
        for number, start in enumerate(starts, 1):
            begun, tried = partial(guided, routes[number % 2], start), len(search.tried)
            search.attempt(f"start {number} of {count} around the optimum", begun, drawn=True)
            agreeing += sum(search.is_same(best, attempt.stage) for attempt in search.tried[tried:])
            if _is_confirmed(search) or not search.is_same(best, search.best_tried.stage):
                break
            if agreeing >= search.enough and 2 * agreeing >= number:
                search.confirmed = True
                return
        else:
            return
        if _is_confirmed(search):
            return
