"""A search for the greatest likelihood from several starts: attempts, and when they are enough.

One attempt is enough where its residuals are noise and the parameters are well determined. Otherwise further
starts are drawn: a Latin hypercube in coordinates around the given start, within limits and priors. The best
ones by the misfit of a likelihood with fewer local optima (`guide`) are tried first; each is improved on such
likelihoods before the true one. The search ends when several starts end at the best optimum, or when the
starts are used up; of frequency responses of large models also after a number of evaluations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import cycle
from typing import NamedTuple, TypeAlias

import numpy as np

from dynid.arrays import Array, guarded
from dynid.defaults import AGREEING_STARTS, MOST_STARTS
from dynid.errors import DynidError
from dynid.identification.estimators.estimate import Estimate, EstimationStage, Sweep
from dynid.identification.estimators.maximum_likelihood import Refined, refine, with_noise
from dynid.identification.likelihood.lack_of_fit import ModelComparison, compare_models
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.priors import Priors
from dynid.identification.residual_tests import is_explained
from dynid.parameters import logarithmic
from dynid.progress import report_progress, tracked

# Rounds of starts: how many are drawn, how far from the given start (a factor), and how many are tried.
_ROUNDS = ((256, 20.0, 1 / 3), (512, 100.0, 1 / 3), (1024, 300.0, 1 / 3))
# A round before these where not all unknowns are the stiffness and damping of joints: masses and stiffnesses
# of a structure are known better than those, and far from them most starts end nowhere.
_NEAR = (256, 4.0, 1 / 3)
# A prior bounds what is drawn to so many of its deviations.
_PRIOR = 4.0
# Most steps on a guide, of which only the neighbourhood of the optimum is needed.
_MAX_GUIDE_STEPS = 15
# Most steps of an attempt, and further ones where it is the best so far and has not converged.
_ATTEMPT_STEPS, _FURTHER_STEPS = 50, 200
# Part of the evaluations that are left which ranking starts may take, and fewest starts of a round.
_RANKING, _MIN_STARTS_OF_ROUND = 0.5, 8
# Two ends are one optimum if the coordinates agree to this, or the misfits to this.
_SAME_COORDINATES, _SAME_MISFIT = 0.02, 0.02
# Misfits that differ by less are equal to round-off: of equal ends the first is the best.
_TIED_MISFIT = 1e-6
# Residuals below this part of a channel's RMS are accepted whatever their colour …
_EXACT_RESIDUAL = 1e-6
# … and others if their whiteness has this p-value or more, and the model no lack of fit.
WHITENESS_LEVEL = 1e-4
# Part of the mean square of the records that residuals may be where their noise is coloured or proportional.
_COLOURED_SQUARE_RATIO = 0.25
# A parameter is vague beyond this standard error of its coordinate: other optima may be as white. To look for
# them, starts are drawn, besides those so many standard errors away (of at most so much).
_VAGUE_DEVIATION, _AWAY_DEVIATIONS, _MAX_AWAY_UNITS = 0.05, 3.0, 2.0
# Beyond this one the parameter is not identifiable, whatever the start.
_BLIND_DEVIATION = 10.0
# Starts that confirm an accepted optimum: one by each route of a search of records of time.
_CONFIRMING = 5


SearchStart: TypeAlias = tuple[Array, list[Sweep]]
"""Start of an attempt: coordinates (p), and the sweeps before it."""


class Attempt(NamedTuple):
    """A completed attempt of a search."""

    likelihood: Likelihood  # of the noise at the end
    stage: EstimationStage
    fit: Fit
    sweeps: list[Sweep]
    drawn: bool  # not from the given start
    accepted: bool  # the residuals are noise, or round-off
    comparison: ModelComparison | None  # of the model with others, if that was needed


class Search:
    """A multi-start search for the greatest likelihood: the attempts so far.

    `accept_small`: True: residuals that are small are accepted whatever their colour; `agreeing`: number of
    starts that are to end at the best optimum.
    """

    def __init__(
        self, likelihood: Likelihood, *, accept_small: bool = False, agreeing: int = AGREEING_STARTS.value
    ) -> None:
        self.accept_small = accept_small
        self.enough = agreeing
        self.likelihood = likelihood
        self.tried: list[Attempt] = []
        self.failure: DynidError | None = None
        self.drawn = 0
        self.before = likelihood.evaluations
        self.cut_off = False
        self.confirmed: bool | None = None  # by starts around the best optimum; None: not tried

    def attempt(self, name: str, begun: Callable[[], SearchStart], *, drawn: bool = False) -> None:
        """Begin, and go from there to the nearest optimum."""
        report_progress(name)
        self.drawn += drawn
        try:
            with guarded("the prediction", names=self.likelihood.names):
                eta, sweeps = begun()
                fit, steps = refine(self.likelihood, eta, _ATTEMPT_STEPS)
                best = min((tried.stage.misfit for tried in self.tried), default=np.inf)
                if steps == _ATTEMPT_STEPS and self.likelihood.misfit(fit) < best:
                    # Further steps, as in a narrow valley, are for the best attempt alone.
                    max_steps = int(min(_FURTHER_STEPS, max(1, self.left)))
                    fit, further = refine(self.likelihood, fit.eta, max_steps)
                    steps += further
                likelihood, (fit, steps) = with_noise(self.likelihood, Refined(fit, steps))
        except DynidError as error:  # from a poor start an attempt may diverge, from another one not
            self.failure = self.failure or error
            return
        stage = EstimationStage.at(name, likelihood, fit, steps)
        judged = self._judged(likelihood, stage, fit)
        self.tried.append(Attempt(likelihood, stage, fit, sweeps, drawn, *judged))

    def on_guides(self, route: Sequence[Likelihood], eta: Array) -> Fit | None:
        """Return the fit after a few steps on each likelihood of a route; None where it fails."""
        try:
            with guarded("the prediction", names=self.likelihood.names):
                eta, _ = guided(route[:-1], eta)
                return refine(route[-1], eta, _MAX_GUIDE_STEPS).fit
        except DynidError as error:
            self.failure = self.failure or error
            return None

    def _judged(
        self, likelihood: Likelihood, stage: EstimationStage, fit: Fit
    ) -> tuple[bool, ModelComparison | None]:
        """Return True if residuals are accepted, and the comparison of models if that was needed."""
        ratio, whiteness_p = stage.residual_ratio, likelihood.whiteness(fit)
        # Nothing is explained, in few values or in many; a noise model whitens the residuals of a wrong
        # optimum, too, which are about as large as the signal.
        if np.mean(ratio**2) >= (_COLOURED_SQUARE_RATIO if likelihood.modelled else 1):
            return False, None
        if self.accept_small and is_explained(ratio, whiteness_p):
            return True, None
        if np.all(ratio <= _EXACT_RESIDUAL) or whiteness_p < WHITENESS_LEVEL:
            return bool(np.all(ratio <= _EXACT_RESIDUAL)), None
        compared = compare_models(likelihood, fit, whiteness_p)
        return not compared.lacks_fit, compared

    def draw(self, guide: Likelihood, routes: Sequence[Sequence[Likelihood]], origin: Array) -> None:
        """Try other starts around `origin` (p), the best first, until enough agree or all are used up.

        They take the `routes` in turn: likelihoods that are maximised one after the other. The misfit of
        `guide` ranks their starts; of an empty route, which begins with the true likelihood, that one's own.
        """
        turn = cycle(routes)
        affine = self.likelihood.records[0].system_model.affine is not None
        for seed, (max_count, reach, fraction) in enumerate(_ROUNDS if affine else (_NEAR, *_ROUNDS)):
            count = int(min(max_count, _RANKING * self.left))
            if count < _MIN_STARTS_OF_ROUND:
                self.cut_off = True
                return
            starts = drawn_starts(self.likelihood.priors, origin, count, reach, seed)
            ranked: dict[bool, Iterator[int]] = {}
            used: set[int] = set()
            for number in range(1, min(count, round(fraction * MOST_STARTS.value)) + 1):
                if self.left <= 0:
                    self.cut_off = True
                    return
                route = next(turn)
                is_guided = bool(route)
                if is_guided not in ranked:
                    ranked[is_guided] = iter(order_of(guide if is_guided else self.likelihood, starts))
                chosen = next(k for k in ranked[is_guided] if k not in used)
                used.add(chosen)
                self.attempt(f"start {number} of {count}", partial(guided, route, starts[chosen]), drawn=True)
                if self.ended:
                    return

    def look_around(self) -> None:
        """Try starts on both sides of the best optimum, in the direction that is determined least."""
        for side in (1.0, -1.0, 1.0, -1.0):
            fit = self.best_tried.fit
            units = self._units(fit.eta)
            information = self.best_tried.likelihood.information(fit, fit.noise)
            U, s, _ = np.linalg.svd(information.root / units[:, None])
            away = side * units * U[:, 0] * min(_AWAY_DEVIATIONS * s[0], _MAX_AWAY_UNITS)
            eta = self.likelihood.priors.clipped(fit.eta + away)
            self.attempt("a start nearby", partial(guided, (), eta), drawn=False)

    @property
    def left(self) -> float:
        """Number of evaluations that are left."""
        return self.likelihood.most_evaluations - (self.likelihood.evaluations - self.before)

    @property
    def best_tried(self) -> Attempt:
        """The attempt of the greatest likelihood, the first of several that end there."""
        min_misfit = min(tried.stage.misfit for tried in self.tried)
        return next(tried for tried in self.tried if tried.stage.misfit <= min_misfit + _TIED_MISFIT)

    @property
    def accepted(self) -> bool:
        """True if the residuals of the best attempt are noise, or zero."""
        return bool(self.tried) and self.best_tried.accepted

    @property
    def vague(self) -> bool:
        """True if parameters are so uncertain that another optimum may leave residuals as white."""
        fit = self.best_tried.fit
        deviations = self.best_tried.likelihood.information(fit, fit.noise).deviations()
        return bool(_VAGUE_DEVIATION < (deviations / self._units(fit.eta)).max() < _BLIND_DEVIATION)

    def _units(self, eta: Array) -> Array:
        """Return what coordinates are compared with (p): 1, or of linear ones the unit or the value."""
        units = self.likelihood.priors.units
        return np.where(logarithmic(self.likelihood.unknowns), 1.0, np.maximum(np.abs(eta), units))

    @property
    def agreeing(self) -> int:
        """Number of starts that ended at the best optimum; all attempts from the given one count as one."""
        best = self.best_tried.stage
        there = [tried.drawn for tried in self.tried if self.is_same(best, tried.stage)]
        return sum(there) + (not all(there))

    def is_same(self, best: EstimationStage, stage: EstimationStage) -> bool:
        """Return True if two attempts ended at one optimum."""
        near = np.all(np.abs(best.eta - stage.eta) <= _SAME_COORDINATES * self._units(best.eta))
        return bool(near) or abs(best.misfit - stage.misfit) <= _SAME_MISFIT

    @property
    def agreed(self) -> bool:
        """True if enough starts ended at the best optimum, and at least half of all."""
        if not self.tried:
            return False
        return self.agreeing >= self.enough and 2 * self.agreeing >= self.drawn + 1

    @property
    def ended(self) -> bool:
        """True if further starts are of no use.

        An accepted optimum needs no confirmation if the first attempt ended there and it is well known.
        """
        if self.accepted:
            return self.drawn >= _CONFIRMING or (self.tried[0].accepted and not self.vague)
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
            likelihood=best.likelihood if self.likelihood.modelled else None,
            disputed=not (best.accepted or (self.agreed if self.confirmed is None else self.confirmed)),
            cut_off=self.likelihood.evaluations - self.before if self.cut_off else 0,
            comparison=best.comparison,
        )


def guided(route: Sequence[Likelihood], eta: Array) -> SearchStart:
    """Begin at the end of a few steps on each likelihood of a route."""
    for guide in route:
        eta = refine(guide, eta, _MAX_GUIDE_STEPS).fit.eta
    return eta, []


def order_of(likelihood: Likelihood, starts: Array) -> list[int]:
    """Return the places of starts (count x p), the best by the misfit of a likelihood first."""
    misfits = np.full(len(starts), np.inf)
    for k, eta in enumerate(tracked(starts, "start")):
        with suppress(DynidError), guarded("the prediction"):  # numbers may leave their range
            misfits[k] = likelihood.misfit_at(eta)
    return [int(k) for k in np.argsort(misfits, kind="stable")]


def drawn_starts(priors: Priors, origin: Array, count: int, reach: float, seed: int) -> Array:
    """Return a Latin hypercube of coordinates around an origin, within limits and priors (count x p).

    M. D. McKay, R. J. Beckman, W. J. Conover, Technometrics 21 (1979) 239–245.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    strata = rng.permuted(np.tile(np.arange(count), (len(origin), 1)), axis=1).T
    centre = np.where(priors.has_prior, priors.means, origin)
    spread = np.fmin(np.log(reach) * priors.units, _PRIOR * priors.deviations)
    low, high = np.maximum(centre - spread, priors.low), np.minimum(centre + spread, priors.high)
    places = (strata + rng.random(strata.shape)) / count
    return priors.clipped(low + (high - low) * places)
