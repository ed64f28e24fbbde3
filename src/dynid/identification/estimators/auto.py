"""The default estimator: the cheapest that the residuals accept.

A pass of the filter goes over local optima that a fit of the whole record from far off ends at; Levenberg–
Marquardt then goes to the maximum of the likelihood, where the filter does not. Where the residuals reject
what that gives, fits to segments of the records lead from the given start, then passes of the filter whose
assumed noise is annealed, and then segments from other starts (`search`).

The search for the greatest likelihood makes attempts from several starts, until no more are needed.

One attempt is enough where its residuals are noise and the parameters are well known. Otherwise further
starts are drawn: a Latin hypercube in logarithms around the given start, within bounds and priors, of which
the best ones by the misfit of an easier likelihood (`guide`) are tried first, led by such likelihoods to
where the optimum of the true one is near. The search ends when several starts end at the best optimum, or
when the starts are used up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import cycle
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.defaults import AGREEING_STARTS, MOST_STARTS
from dynid.errors import DynidError
from dynid.identification.estimators.estimate import Estimate, Stage, Sweep
from dynid.identification.estimators.filter_passes import annealed_passes, last, run_passes
from dynid.identification.estimators.maximum_likelihood import Refined, refine
from dynid.identification.estimators.segments import in_segments
from dynid.identification.lack_of_fit import ModelComparison, compare_models
from dynid.identification.likelihood import Fit, Likelihood
from dynid.identification.priors import Priors
from dynid.identification.residual_tests import is_explained
from dynid.identification.time_record import TimeLikelihood
from dynid.progress import report_progress, tracked

Array = NDArray[np.float64]

# Rounds of starts: how many are drawn, how far from the given start (a factor), and how many are tried.
_ROUNDS = ((256, 20.0, 1 / 3), (512, 100.0, 1 / 3), (1024, 300.0, 1 / 3))
# A prior bounds what is drawn to so many of its deviations.
_PRIOR = 4.0
# Most steps on a guide, which is to lead near, not to the end.
_STEPS = 15
# Most steps of an attempt, and further ones where it is the best so far and has not ended.
_MOST_STEPS, _FURTHER_STEPS = 50, 200
# Two ends are one optimum if the logarithms agree to this, or the misfits to this.
_SAME, _AS_GOOD = 0.02, 0.02
# Residuals below this part of a channel's RMS are accepted whatever their colour …
_EXACT = 1e-6
# … and others if their whiteness has this p-value or more, and the model no lack of fit.
_WHITE = 1e-4
# A parameter is vague beyond this standard error of its logarithm: other optima may be as white. So many
# starts are drawn to look for them, besides those so many standard errors away (of at most so much).
_VAGUE, _CONFIRMING, _AWAY, _FARTHEST = 0.05, 4, 3.0, 2.0
# Beyond this one nothing is known of it, whatever the start.
_BLIND = 10.0
# Segments that lead one after the other, as parts of a record; of the shortest ones starts are chosen by. No
# such route is the best for all records: short segments go over more local optima, but show less.
_ROUTES = ((64, 16, 4), (16,), (64, 16, 4), (32, 4), ())


SearchStart: TypeAlias = tuple[Array, list[Sweep]]
"""Where an attempt begins: logarithms (p), and the sweeps that led there."""


class Attempt(NamedTuple):
    """An attempt that came to an end: its `stage`, its `fit`, the `sweeps` that led there.

    `drawn`: not from the given start; `accepted`: its residuals are noise, or round-off; `comparison`: of
    the model with others, if that was needed.
    """

    stage: Stage
    fit: Fit
    sweeps: list[Sweep]
    drawn: bool
    accepted: bool
    comparison: ModelComparison | None


class Search:
    """Attempts so far, and whether they are enough.

    Parameters
    ----------
    likelihood
        What is observed.
    accept_small
        True: residuals that are small are accepted whatever their colour.
    """

    def __init__(self, likelihood: Likelihood, *, accept_small: bool = False) -> None:
        self.accept_small = accept_small
        self.likelihood = likelihood
        self.tried: list[Attempt] = []
        self.failure: DynidError | None = None
        self.drawn = 0

    def attempt(self, name: str, begun: Callable[[], SearchStart], *, drawn: bool = False) -> None:
        """Begin, and go from where that ends to the nearest optimum."""
        report_progress(name)
        self.drawn += drawn
        try:
            logs, sweeps = begun()
            fit, steps = self._refined(logs)
        except DynidError as error:  # far off an attempt may run away: another start may not
            self.failure = self.failure or error
            return
        stage = Stage.at(name, self.likelihood, fit, steps)
        self.tried.append(Attempt(stage, fit, sweeps, drawn, *self._judged(stage, fit)))

    def _refined(self, logs: Array) -> Refined:
        """Return the nearest optimum; further steps, as in a narrow valley, go to the best attempt alone."""
        way = refine(self.likelihood, logs, _MOST_STEPS)
        best = min((tried.stage.misfit for tried in self.tried), default=np.inf)
        if way.steps == _MOST_STEPS and self.likelihood.misfit(way.fit) < best:
            further = refine(self.likelihood, way.fit.logs, _FURTHER_STEPS)
            return Refined(further.fit, way.steps + further.steps)
        return way

    def _judged(self, stage: Stage, fit: Fit) -> tuple[bool, ModelComparison | None]:
        """Tell whether residuals are accepted; and what the records say of the model, if that was needed."""
        ratio, whiteness_p = stage.residual_ratio, self.likelihood.whiteness(fit)
        if np.mean(ratio**2) >= 1:  # nothing is explained, in few values or in many
            return False, None
        if self.accept_small and is_explained(ratio, whiteness_p):
            return True, None
        if np.all(ratio <= _EXACT) or whiteness_p < _WHITE:
            return bool(np.all(ratio <= _EXACT)), None
        compared = compare_models(self.likelihood, fit, whiteness_p)
        return not compared.lacks_fit, compared

    def draw(self, guide: Likelihood, routes: Sequence[Sequence[Likelihood]], origin: Array) -> None:
        """Try other starts until enough of them agree, or all are used up.

        Parameters
        ----------
        guide
            The likelihood that the starts of routes are chosen by.
        routes
            Likelihoods that lead to the optimum one after the other; starts take them in turn.
        origin
            Logarithms around which starts are drawn (p).
        """
        for name, route, logs in self._starts(guide, routes, origin):
            self.attempt(name, partial(guided, route, logs), drawn=True)
            if self.ended:
                break

    def _starts(
        self, guide: Likelihood, routes: Sequence[Sequence[Likelihood]], origin: Array
    ) -> Iterator[tuple[str, Sequence[Likelihood], Array]]:
        """Yield names, routes and logarithms of starts (p), those likely to succeed first.

        An empty route begins in the likelihood itself, whose own misfit chooses its starts.
        """
        turn = cycle(routes)
        for seed, (count, reach, part) in enumerate(_ROUNDS):
            starts = drawn_starts(self.likelihood.priors, origin, count, reach, seed)
            ranked: dict[bool, Iterator[int]] = {}
            taken: set[int] = set()
            for place in range(1, round(part * MOST_STARTS.value) + 1):
                route = next(turn)
                guided_start = bool(route)
                if guided_start not in ranked:
                    chooser = guide if guided_start else self.likelihood
                    misfits = [_misfit_at(chooser, logs) for logs in tracked(starts, "start")]
                    ranked[guided_start] = iter(np.argsort(misfits, kind="stable").tolist())
                chosen = next(k for k in ranked[guided_start] if k not in taken)
                taken.add(chosen)
                yield f"start {place} of {count}", route, starts[chosen]

    def look_around(self) -> None:
        """Try both sides of the best end in the direction that is known least, until none is better."""
        for side in (1.0, -1.0, 1.0, -1.0):
            fit = self.best_tried.fit
            U, s, _ = np.linalg.svd(self.likelihood.information(fit, fit.noise).root())
            away = side * U[:, 0] * min(_AWAY * s[0], _FARTHEST)
            logs = self.likelihood.priors.clipped(fit.logs + away)
            self.attempt("a start nearby", partial(guided, (), logs), drawn=False)

    @property
    def best_tried(self) -> Attempt:
        """The attempt of the greatest likelihood."""
        return min(self.tried, key=lambda tried: tried.stage.misfit)

    @property
    def accepted(self) -> bool:
        """True if the residuals of the best attempt are noise, or zero."""
        return bool(self.tried) and self.best_tried.accepted

    @property
    def vague(self) -> bool:
        """True if parameters are so uncertain that another optimum may leave residuals as white."""
        fit = self.best_tried.fit
        return bool(_VAGUE < self.likelihood.information(fit, fit.noise).deviations().max() < _BLIND)

    @property
    def agreeing(self) -> int:
        """Number of starts that ended at the best optimum; all attempts from the given one count as one."""
        best = self.best_tried.stage
        there = [tried.drawn for tried in self.tried if _same(best, tried.stage)]
        return sum(there) + (not all(there))

    @property
    def agreed(self) -> bool:
        """True if enough starts ended at the best optimum, and at least half of all."""
        if not self.tried:
            return False
        return self.agreeing >= AGREEING_STARTS.value and 2 * self.agreeing >= self.drawn + 1

    @property
    def ended(self) -> bool:
        """True if further starts are of no use."""
        if self.accepted:
            return self.drawn >= _CONFIRMING or not self.vague
        return self.agreed

    def best(self) -> Estimate:
        """Return the attempt of the greatest likelihood."""
        if not self.tried:
            assert self.failure is not None
            raise self.failure
        best = self.best_tried
        return Estimate(
            best.fit,
            best.sweeps,
            [tried.stage for tried in self.tried],
            {"starts": self.drawn + 1, "starts_agreed": self.agreeing},
            disputed=not (best.accepted or self.agreed),
            comparison=best.comparison,
        )


def guided(route: Sequence[Likelihood], logs: Array) -> SearchStart:
    """Begin where likelihoods lead, one after the other."""
    for guide in route:
        logs = refine(guide, logs, _STEPS).fit.logs
    return logs, []


def drawn_starts(priors: Priors, origin: Array, count: int, reach: float, seed: int) -> Array:
    """Return a Latin hypercube of logarithms around an origin, within bounds and priors (count x p).

    M. D. McKay, R. J. Beckman, W. J. Conover, Technometrics 21 (1979) 239–245.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    strata = rng.permuted(np.tile(np.arange(count), (len(origin), 1)), axis=1).T
    centre = np.where(priors.believed, priors.means, origin)
    spread = np.fmin(np.log(reach), _PRIOR * priors.deviations)
    low, high = np.maximum(centre - spread, priors.low), np.minimum(centre + spread, priors.high)
    places = (strata + rng.random(strata.shape)) / count
    return priors.clipped(low + (high - low) * places)


def _same(one: Stage, other: Stage) -> bool:
    """Tell whether two attempts ended at one optimum."""
    return bool(np.all(np.abs(one.logs - other.logs) <= _SAME)) or abs(one.misfit - other.misfit) <= _AS_GOOD


def _misfit_at(guide: Likelihood, logs: Array) -> float:
    try:
        return guide.misfit_at(logs)
    except DynidError:
        return np.inf


@dataclass(frozen=True)
class Auto:
    """Estimator: a filter pass and maximum likelihood; other starts only where they are needed.

    Parameters
    ----------
    escalates
        Whether more than the first pass may be tried.
    """

    escalates: bool = True
    name: str = "auto"

    def run(self, likelihood: TimeLikelihood, origin: Array) -> Estimate:
        """Estimate, from the logarithms `origin` (p).

        Raises
        ------
        DynidError
            What went wrong at first, if no attempt came to an end.
        """
        search = Search(likelihood)
        search.attempt("a filter pass", partial(_filtered, likelihood, origin))
        if not self.escalates or (search.accepted and not search.vague):
            return search.best()
        guides = {part: in_segments(likelihood, part) for route in _ROUTES for part in route}
        routes: list[list[Likelihood]] = [[guides[part] for part in route] for route in _ROUTES]
        if search.accepted:
            search.look_around()
        else:
            search.attempt("segments", partial(guided, routes[0], origin))
        if not search.accepted:
            search.attempt("annealed passes", partial(_annealed, likelihood, origin))
        if not search.ended:
            search.draw(guides[_ROUTES[0][0]], routes, origin)
        return search.best()


def _filtered(likelihood: TimeLikelihood, logs: Array) -> SearchStart:
    """Begin with one pass of the filter."""
    sweeps = run_passes(likelihood, 1, logs)
    return last(likelihood, sweeps), sweeps


def _annealed(likelihood: TimeLikelihood, logs: Array) -> SearchStart:
    """Begin with passes whose assumed noise is annealed."""
    sweeps = annealed_passes(likelihood, logs)
    return last(likelihood, sweeps), sweeps
