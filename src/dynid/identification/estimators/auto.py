"""The default estimator: a local fit first, a multi-start search only where the residuals reject that.

Records of time: a pass of the filter avoids local optima at which a fit of the whole record from a poor
initial guess ends; Levenberg–Marquardt then goes on to the maximum of the likelihood, which the filter does
not reach exactly. Where the residuals of that are not noise, fits to segments of the records are tried from
the given start, then passes of the filter whose assumed noise is annealed, and then segments from other
starts.

Frequency responses: the misfit of a response has a local minimum wherever a measured and a predicted
resonance do not overlap; that of the logarithms of magnitudes slopes towards the resonances from afar. So
where the likelihood ends in residuals that are not noise, magnitudes are fitted first, from the given start
and then from others. A large structure is searched with its modes in the band of the lines
(`band_limited_system`); the last iterations are those of the whole model, and where that does not confirm the
search, it is repeated with more modes.

Measured modes, alone or together with either, have few local optima: those where modes are paired wrongly,
and those at a veering of two frequencies, where shapes change so fast that steps are small. An optimum counts
where a second search ends there that begins as a compromise: with deviations so large that the values of
small scatter do not lead. Where the two differ, or the residuals are not scatter, modes that are close are
first compared by the span of their shapes, which does not veer, and other starts are drawn. Where the
residuals of the best optimum are not scatter, starts around it have to lead to it again: that verdict depends
on the optimum, not on the scene's start. Records of time and frequency responses, whose misfit has many local
optima, start from where the modes lead.

Segments of a record are predicted from initial states of their own (multiple shooting), which are linear and
projected out: phase errors of a wrong model grow with time, and so do the local minima of the misfit of a
longer prediction (H. G. Bock, in: Modelling of Chemical Reaction Systems, Springer 1981, 102–125; L. Kaufman,
BIT 15 (1975) 49–57).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from heapq import heappop, heappush
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, finite
from dynid.errors import DynidError, UsageError
from dynid.identification.estimators.estimate import Estimate, Sweep
from dynid.identification.estimators.filter_passes import annealed_passes, last, run_passes
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.estimators.multi_start import (
    WHITENESS_LEVEL,
    Attempt,
    Search,
    SearchStart,
    drawn_starts,
    guided,
    order_of,
)
from dynid.identification.likelihood.frf_record import FrfLikelihood
from dynid.identification.likelihood.likelihood import Likelihood
from dynid.identification.likelihood.record_likelihood import RecordFit, RecordLikelihood
from dynid.identification.likelihood.saturated_model import SaturatedCoordinates
from dynid.identification.likelihood.time_record import TimeLikelihood, TimeRecord
from dynid.identification.records.measurement import RecordData
from dynid.identification.systems.band_limited_system import BAND_FACTOR
from dynid.identification.systems.linear_system import LinearSystem
from dynid.identification.systems.prediction import Trajectory, free_prediction, prediction
from dynid.lti.recurrence import recurrence

if TYPE_CHECKING:
    from dynid.identification.likelihood.modal_record import ModalRecord

# The prior of the initial states of segments has this part of the information of one value of RMS size:
# states that are not observable in a segment stay those of the forced response.
_STATE_RIDGE = 1e-6
# Most numbers of a prediction with its derivatives that is cut into segments.
_MOST_SEGMENT_NUMBERS = 20_000_000
# A segment has at least this many values for each of its initial states.
_MIN_VALUES_PER_STATE = 2


@dataclass(frozen=True, eq=False)
class _Segments(RecordLikelihood):
    """A record in segments of one length, channels counting by their RMS."""

    record: TimeRecord  # the record as a whole
    length: int  # samples of a segment
    sharing: int = 1

    @cached_property
    def data(self) -> RecordData:  # type: ignore[override]
        """All values over their channel's RMS, as one channel whose noise is given."""
        record = self.record.data
        return RecordData((record.values / record.rms).reshape(-1, 1), given=np.ones(1))

    @property
    def system_model(self) -> LinearSystem:
        """The model of the record."""
        return self.record.system_model

    @property
    def may_idle(self) -> bool:
        """True if parameters may have no influence in the record."""
        return self.record.may_idle

    @property
    def nuisances(self) -> int:
        """Number of initial states of all segments."""
        return self.record.nuisances * math.ceil(len(self.record.data.values) / self.length)

    def residual(self, eta: Array) -> Array:
        """Return a residual with the RMS of those of all segments (1 x 1)."""
        model = self.record.model
        free, _ = free_prediction(model, eta)
        left = self._cut(self.record.data.values - free.forced - free.by_state @ model.initial)[..., None]
        by_start = self._by_start(free.by_state)
        projected = by_start.swapaxes(-1, -2) @ left
        return self._sized(float(np.sum(left**2) - np.sum(projected * _starts(by_start, projected))))

    def fit(self, eta: Array, values: Array, noise: Array | None = None) -> RecordFit:  # noqa: ARG002
        """Fit the initial states of all segments at coordinates of the parameters."""
        model = self.record.model
        # Free decays from n states over a segment are beside the responses over the record.
        share = model.states * self.length / len(self.record.data.values)
        self.record.system_model.evaluations += 1 + math.ceil(share)
        free, steps = free_prediction(model, eta)
        predicted_whole = prediction(model, eta, model.initial, free, steps)
        left = self._cut(self.record.data.values - predicted_whole.outputs)[..., None]
        by_start = self._by_start(free.by_state)
        starts = _starts(by_start, by_start.swapaxes(-1, -2) @ left)[..., 0]
        slopes = self._cut(predicted_whole.by_parameter) + self._moved(eta, starts)
        columns = np.where(self._present[..., None], np.concatenate([slopes, left], axis=2), 0.0)
        projected = by_start.swapaxes(-1, -2) @ columns
        products = columns.swapaxes(1, 2) @ columns - projected.swapaxes(1, 2) @ _starts(by_start, projected)
        finite("the sensitivity of the record", products)
        size, V = np.linalg.eigh(products.sum(axis=0))
        rows = np.sqrt(np.maximum(size, 0.0))[:, None] * V.T  # as many as there are columns, same products
        residual, by_parameter = rows[:, -1:], rows[:, None, :-1]
        rms = self._sized(float(np.sum(residual**2)))[0]
        predicted = Trajectory(residual, np.zeros((len(rows), 0)))
        return RecordFit(
            eta, predicted, residual, self.data.counts, rms, np.ones(1), by_parameter=by_parameter
        )

    def slopes(self, fit: RecordFit, noise: Array) -> Array:
        """Return few rows with the same products as the derivatives by the coordinates over noise (… x p)."""
        assert fit.by_parameter is not None
        return np.asarray(fit.by_parameter[:, 0] / noise)

    def by_row(self, level: NDArray[Any]) -> NDArray[Any]:
        """Return the number of the one channel that all values count as, row by row."""
        return np.tile(level, len(self.unknowns) + 1)

    def coordinates(self, fit: RecordFit) -> list[SaturatedCoordinates]:  # noqa: ARG002
        """Return none: segments are a step of the search, and no test of the model."""
        return []

    def on(self, data: RecordData) -> Self:
        """Return the same segments of other values."""
        return replace(self, record=self.record.on(data))

    @cached_property
    def _present(self) -> NDArray[np.bool_]:
        """Return the mask of measured rows of each segment (segments x rows)."""
        there = ~np.isnan(self.record.data.values)
        filled = np.concatenate([there, np.zeros((-len(there) % self.length, there.shape[1]), dtype=bool)])
        return filled.reshape(-1, self.length * there.shape[1])

    def _cut(self, values: Array) -> Array:
        """Return values (times x channels x …) over RMS by segments (segments x rows x …), 0 if missing."""
        samples, channels, *more = values.shape
        scaled = values / self.record.data.rms.reshape(channels, *(1 for _ in more))
        filled = np.concatenate([scaled, np.zeros((-samples % self.length, channels, *more))])
        cut = filled.reshape(-1, self.length * channels, *more)
        return cut if more else np.where(self._present, cut, 0.0)

    def _by_start(self, by_state: Array) -> Array:
        """Return the response to initial states in the units of their prior ((segments x) rows x n)."""
        root, rms = self.record.root, self.record.data.rms
        projected = ((by_state[: self.length] @ root) / rms[:, None]).reshape(-1, len(root))
        return projected if self._present.all() else np.where(self._present[..., None], projected, 0.0)

    def _moved(self, eta: Array, starts: Array) -> Array:
        """Return the derivatives of the free decays from initial states (segments x rows x p)."""
        model = self.record.model.moved(eta)
        n, p, L = model.states, model.parameters, self.length
        sampled = model.times
        transition = model.transition(eta, float(sampled[-1] - sampled[0]) / (len(sampled) - 1))
        Phi, by_parameter = transition.step[:, :n], transition.derivatives[:, :, :n]
        # From the states of the prior's root, of which every initial state is a sum.
        states, slopes = np.empty((L, n, n)), np.zeros((L, n * p, n))
        states[0] = self.record.root.T
        states[1:] = recurrence(Phi, np.zeros((L - 1, n, n)), states[0])
        forcing = states[:-1].reshape(-1, n) @ by_parameter.reshape(p * n, n).T
        slopes[1:] = recurrence(Phi, forcing.reshape(L - 1, n * p, n), slopes[0])
        C, C_slopes = model.output(eta)
        seen = states.reshape(-1, n) @ C_slopes.reshape(-1, n).T
        seen = (seen.reshape(L, n, p, -1) + (slopes @ C.T).reshape(L, n, p, -1)) / self.record.data.rms
        derivatives = starts @ seen.transpose(1, 0, 3, 2).reshape(n, -1)
        return np.asarray(derivatives.reshape(len(starts), -1, p))

    def _sized(self, square: float) -> Array:
        """Return a residual whose RMS is that of all values, of a sum of squares (1 x 1)."""
        return np.full((1, 1), math.sqrt(max(square, 0.0) / int(self.data.counts[0])))


def _starts(by_start: Array, projected: Array) -> Array:
    """Return the initial states that fit best, in the units of their prior (segments x n x …)."""
    products = by_start.swapaxes(-1, -2) @ by_start
    return np.asarray(np.linalg.solve(products + _STATE_RIDGE * np.eye(products.shape[-1]), projected))


def in_segments(likelihood: TimeLikelihood, divisor: int) -> Likelihood:
    """Return the likelihood of records in segments of this part of their length, or somewhat longer ones.

    Of long records those of their first part: a search needs no more, and its memory does not grow.
    """
    segments = []
    for whole in likelihood.records:
        numbers = len(whole.data.rms) * (whole.model.states + whole.model.parameters + 1)
        most = _MOST_SEGMENT_NUMBERS // numbers
        record = whole.first(most) if most < len(whole.times) else whole
        samples, channels = record.data.values.shape
        min_length = math.ceil(_MIN_VALUES_PER_STATE * record.nuisances / channels)
        length = int(min(samples, max(min_length, samples // divisor)))
        segments.append(_Segments(record, length, len(likelihood.records)))
    return Likelihood(tuple(segments))


# Records of time: lengths of segments that are fitted one after the other, as fractions 1/n of a record;
# starts are chosen by the shortest. No route is the best for all records: short segments have fewer local
# optima, but are less sensitive.
_ROUTES = ((64, 16, 4), (16,), (64, 16, 4), (32, 4), ())
# Joints with nonlinear laws: the first parts of the records, one in so many, that are fitted in turn.
_FIRST_PARTS = (32, 16, 4)
# Starts around the given one: how many are drawn, how far from it (a factor), and how many are fitted to the
# shortest part, on which the best by its misfit end at the optimum.
_AROUND_LAWS, _BEST_STARTS = (32, 5.0), 8
# Loops with delays: starts around the given one, and how far from it (a factor).
_AROUND_DELAYS = (32, 4.0)
# Responses: a search with the modes of a band is confirmed by an estimate of the whole model that differs by
# less than this part of its standard errors.
_CONFIRMED_DEVIATIONS = 0.1
# Modes: frequencies nearer than this part have one span, on the way to an optimum.
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
class Auto:
    """Estimator: maximum likelihood by a search that suits the kind of the records."""

    multi_start: bool = True  # True: more than the attempts from the given start may be made
    # True: residuals of frequency responses that are small are accepted whatever their colour.
    accept_small: bool = False
    # The noise (channels of each record) of a nearby model whose accepted estimate the origin is: records of
    # time go to the optimum that is next to it.
    near: Sequence[Array] | None = None
    name: str = "auto"

    def run(self, likelihood: Likelihood, origin: Array) -> Estimate:
        """Estimate, from the coordinates `origin` (p).

        Raises DynidError: the first error, if no attempt was completed.
        """
        if isinstance(likelihood, TimeLikelihood):
            if any(record.origin_is_free for record in likelihood.records):
                return self._of_laws(likelihood, origin)
            if self.near is not None:
                return OutputError(noise=self.near).run(likelihood, origin)
            if any(record.system_model.delayed for record in likelihood.records):
                return self._of_delays(likelihood, origin)
            return self._of_records(likelihood, origin)
        if isinstance(likelihood, FrfLikelihood):
            return self._of_responses(likelihood, origin)
        return self._of_modes(likelihood, origin)

    def _of_records(self, likelihood: TimeLikelihood, origin: Array) -> Estimate:
        """Estimate from records of time: a filter pass; segments, annealed passes and starts where needed."""
        search, guide = Search(likelihood), likelihood.at_record_clock()
        first = likelihood.shortened(origin)
        if first is not likelihood:  # a pass of the filter takes the time of many fits
            search.attempt("the start", partial(guided, [first], origin))
        if not search.accepted:
            one_pass = partial(run_passes, passes=1)
            search.attempt("a filter pass", partial(_filtered, one_pass, guide, origin))
        if not (self.multi_start or search.accepted):
            search.attempt("the start", partial(guided, (), origin))
        if not self.multi_start or (search.accepted and not search.vague):
            return search.best()
        try:
            for record in likelihood.records:
                record.check_whole()
        except UsageError:  # too long for segments and ranked starts: the search ends, and says so
            search.cut_off = True
            return search.best()
        guides = {divisor: in_segments(guide, divisor) for route in _ROUTES for divisor in route}
        routes: list[list[Likelihood]] = [[guides[divisor] for divisor in route] for route in _ROUTES]
        if search.accepted:
            search.look_around()
        else:
            search.attempt("segments", partial(guided, routes[0], origin))
        if not search.accepted and search.left > 0:
            search.attempt("annealed passes", partial(_filtered, annealed_passes, guide, origin))
        if not search.ended:
            search.draw(guides[_ROUTES[0][0]], routes, origin)
        return search.best()

    def _of_laws(self, likelihood: TimeLikelihood, origin: Array) -> Estimate:
        """Estimate from records of joints with nonlinear laws: by their first parts, from several starts."""
        from dynid.identification.likelihood.nonlinear_record import growing  # of joints with laws alone

        search = Search(likelihood)
        if not self.multi_start:
            search.attempt("the start", partial(guided, (), origin))
            return search.best()
        parts, (count, reach) = growing(likelihood, _FIRST_PARTS), _AROUND_LAWS

        def starts() -> Iterator[tuple[int, Array]]:
            yield 0, origin
            drawn = drawn_starts(likelihood.priors, origin, count, reach, 0)
            for number, place in enumerate(order_of(parts[0], drawn)[:_BEST_STARTS], 1):
                yield number, drawn[place]

        further = starts()
        waiting: list[tuple[bool, float, int, int, Array]] = []
        while True:
            # What explains its part goes on, then other starts, then what explains its part best.
            start = None if waiting and not waiting[0][0] else next(further, None)
            if start is None and not waiting:
                break
            number, stage, eta = (start[0], 0, start[1]) if start else heappop(waiting)[2:]
            search.cut_off = search.left <= 0
            if search.cut_off and search.tried:
                return search.best()
            if stage < len(parts) and not search.cut_off:
                way = search.on_guides([parts[stage]], eta)
                if way is not None:
                    coloured = parts[stage].whiteness(way) < WHITENESS_LEVEL
                    misfit = parts[stage].misfit(way) / sum(int(part.counts.sum()) for part in way.parts)
                    heappush(waiting, (coloured, misfit, number, stage + 1, way.eta))
                continue
            name = f"start {number} of {_BEST_STARTS}" if number else "records of growing length"
            search.attempt(name, partial(guided, (), eta), drawn=number > 0)
            if search.accepted or search.agreed or search.cut_off:
                return search.best()
        search.draw(parts[0], [parts], origin)
        return search.best()

    def _of_delays(self, likelihood: TimeLikelihood, origin: Array) -> Estimate:
        """Estimate from records of loops with delays: from the start, and from the best of starts around it.

        Neither segments nor first parts guide: what is under way at their ends, or before the first answer
        arrives, is no part of them.
        """
        search, (count, reach) = Search(likelihood), _AROUND_DELAYS
        search.attempt("the start", partial(guided, (), origin))
        if not self.multi_start or (search.accepted and not search.vague):
            return search.best()
        drawn = drawn_starts(likelihood.priors, origin, count, reach, 0)
        for number, place in enumerate(order_of(likelihood, drawn)[:_BEST_STARTS], 1):
            search.cut_off = search.left <= 0
            if search.cut_off and search.tried:
                break
            name = f"start {number} of {_BEST_STARTS}"
            search.attempt(name, partial(guided, (), drawn[place]), drawn=True)
            if search.agreed or (search.accepted and not search.vague):
                break
        return search.best()

    def _of_responses(self, likelihood: FrfLikelihood, origin: Array) -> Estimate:
        """Estimate from frequency responses: in the band of the lines, confirmed by the whole model."""
        band = BAND_FACTOR
        while (limited := likelihood.band_limited(band)) is not None:
            try:
                estimate = self._searched(limited, origin)
            except DynidError:  # the whole model says more exactly what is wrong
                break
            weighted = estimate.likelihood
            end = likelihood if weighted is None else likelihood.with_weights_of(weighted)
            full_search = Search(end, accept_small=self.accept_small)
            full_search.attempt("the whole model", partial(guided, (), estimate.fit.eta))
            for full in full_search.tried:
                deviations = full.likelihood.information(full.fit, full.fit.noise).deviations()
                apart = np.abs(full.fit.eta - estimate.fit.eta)
                if full.accepted or np.all(apart <= _CONFIRMED_DEVIATIONS * deviations):
                    return _completed(estimate, full, likelihood)
            band *= 2  # more modes, until the whole model confirms the search
        return self._searched(likelihood, origin)

    def _searched(self, likelihood: FrfLikelihood, origin: Array) -> Estimate:
        """Estimate in one model: magnitudes and other starts where needed."""
        search, magnitudes = Search(likelihood, accept_small=self.accept_small), likelihood.by_magnitude()
        search.attempt("the start", lambda: (origin, []))
        if not search.accepted:
            search.attempt("magnitudes", partial(guided, [magnitudes], origin))
        if self.multi_start and not search.accepted:
            search.draw(magnitudes, [[magnitudes]], origin)
        return search.best()

    def _of_modes(self, likelihood: Likelihood, origin: Array) -> Estimate:
        """Estimate from measured modes and what is beside them: spans of close modes, starts where needed."""
        from dynid.identification.likelihood.modal_record import ModalRecord  # of modal surveys alone

        surveys = tuple(record for record in likelihood.records if isinstance(record, ModalRecord))
        alone = len(surveys) == len(likelihood.records)
        surveys = tuple(record.with_error(np.maximum(record.error, _COMPROMISE)) for record in surveys)
        modes = _guide(surveys, origin)
        spans = _guide(tuple(replace(record, close=_SPAN_RTOL) for record in surveys), origin)
        route: list[Likelihood] = [] if alone else [modes]
        search = Search(likelihood, agreeing=_AGREEING if alone else _AGREEING_RECORDS)
        search.attempt("the start", partial(guided, route, origin))
        if not self.multi_start or (not alone and search.accepted and not search.vague):
            return search.best()
        if alone:
            search.attempt("a compromise", partial(guided, [modes], origin), drawn=True)
            if _is_confirmed(search) and not search.vague:
                return search.best()
        routes: list[list[Likelihood]] = [[modes], [spans] if alone else [spans, modes]]
        search.attempt("spans of close modes", partial(guided, routes[1], origin), drawn=alone)
        count, reach = _AROUND_START
        for number, start in enumerate(drawn_starts(likelihood.priors, origin, count, reach, 0), 1):
            alike = _is_confirmed(search) or (bool(search.tried) and search.agreeing >= _FROM_START)
            if search.agreed or (alike if alone else search.accepted):
                break
            begin = partial(guided, routes[number % 2], start)
            search.attempt(f"start {number} of {count}", begin, drawn=True)
        if alone and search.tried and not _is_confirmed(search):
            _confirm(search, routes)
        return search.best()


def _filtered(
    passes: Callable[[TimeLikelihood, Array], list[Sweep]], likelihood: TimeLikelihood, eta: Array
) -> SearchStart:
    """Begin with passes of the filter."""
    sweeps = passes(likelihood, eta)
    return last(likelihood, sweeps), sweeps


def _completed(estimate: Estimate, full: Attempt, likelihood: FrfLikelihood) -> Estimate:
    """Return an estimate whose last iterations are those of the whole model."""
    stages = [
        replace(full.stage, name=stage.name, iterations=stage.iterations + full.stage.iterations)
        if stage.eta is estimate.fit.eta
        else stage
        for stage in estimate.stages
    ]
    return replace(
        estimate,
        fit=full.fit,
        stages=stages,
        likelihood=full.likelihood if likelihood.modelled else None,
        disputed=estimate.disputed and not full.accepted,
        cut_off=0 if full.accepted else estimate.cut_off,
        comparison=full.comparison,
    )


def _guide(records: Sequence[ModalRecord], origin: Array) -> Likelihood:
    """Return the likelihood of modes alone; what they do not determine stays near `origin` (p)."""
    likelihood = Likelihood(tuple(records))
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
