"""Optima of the likelihood that explain the records as well as the estimate: interchangeable parameters.

They are images of the estimate by the symmetries of the model (`symmetry`), or ends of further searches from
exchanged values, where a symmetry holds but for a scale, or the records cannot contradict it. What priors and
limits decide is judged by the posterior at the optimum next to each image.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Array, guarded
from dynid.errors import DynidError
from dynid.identification.diagnosis.intervals import profile_intervals
from dynid.identification.diagnosis.symmetry import (
    Permutation,
    centre_of,
    distinct_kinds,
    image,
    images,
    like_parameters,
    nearly_symmetric,
    symmetries,
)
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.likelihood.frf_record import FrfRecord
from dynid.identification.likelihood.likelihood import Fit, Likelihood
from dynid.identification.likelihood.priors import Priors
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.systems.parametric_model import Model, system_of
from dynid.parameters import named
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel

#: Difference of the logarithm of the posterior from which it decides: odds of 150 to 1.
DECIDED = 5.0
# Most optima that are listed: the images of seven equal branches.
_MAX_OPTIMA = 5040
# Most images whose neighbourhood is searched for the optimum of the posterior, and steps of one search.
_REFINED, _STEPS = 24, 20
# Gain of the logarithm of the posterior from which another optimum is the estimate, and how often it may be.
_BETTER, _ROUNDS = 0.01, 8
# Coordinates are those of one optimum where they differ by less than this many deviations, or units; from so
# many units on they are distinct.
_SAME_DEVIATIONS, _SAME_UNITS, _DISTINCT = 0.01, 1e-9, 1e-4
# An optimum that no symmetry relates to the estimate is another one from so many deviations on.
_DISTINCT_OPTIMUM_DEVIATIONS = 3.0
# Starts with exchanged values that are ranked, and searched; the first steps of such a search, and the part
# of the misfit that they must leave at most.
_RANKED, _SEARCHED, _FIRST, _LEFT = 16, 3, 4, 0.3
# Further steps of a search that is as good as the best and has not converged.
_FURTHER = 60
# Most directions, of models without symmetries, in which error bars are tested against the misfit.
_MAX_DIRECTIONS = 12
# Directions of the greatest deviations along which misfits are compared with those that the information
# predicts, from so many deviations on, each distance twice the one before, up to so many units; the ratio
# below which the misfit is not that of one optimum, the points above it that end a line, and the most starts
# below it that are searched.
_DIRECTIONS, _FARTHEST, _FLAT, _STEEP, _FLATTEST = 3, 4.0, 0.5, 2, 8
#: The first of these distances, in deviations.
FLAT_DISTANCE = 4.0
# Most states, and candidate sensors, of models whose deciding sensors are sought; lines at which responses
# are compared, the relative difference from which they differ, how many sensors are named, and most optima
# that are compared with the estimate.
_SENSOR_STATES, _SENSORS, _LINES, _DIFFERENT, _NAMED, _COMPARED = 120, 60, 5, 1e-3, 3, 24
# How far from a saddle its optima are looked for, in units.
_APART_SADDLE = (0.4, 0.1)
# Most multiplications of the evaluations of these starts: some hundredths of a second.
_MAX_RANKING_WORK = 100_000_000


class _FlatDirection(NamedTuple):
    """A direction in which the misfit rises by less than half of what the information predicts."""

    away: Array  # four standard errors along it (p), in coordinates
    # `rise`, `predicted`: rise of the misfit there, and that of the information
    rise: float
    predicted: float
    intervals: Array | None = None  # ends of the 95 % intervals by profile likelihood (2 x p), in coordinates


@dataclass(frozen=True, eq=False)
class EquivalentOptima:
    """Optima with equal likelihood."""

    eta: Array  # their coordinates (optima x p); the first is the estimate
    # `log_likelihood`, `log_posterior`: logarithms less those at the estimate (optima), of the records alone
    # and with priors and limits; minus infinity where there is no optimum of the posterior
    log_likelihood: Array
    log_posterior: Array
    permutations: Sequence[Permutation] = ()  # the symmetries of the model that relate them
    # Further sensors, by name: each entry is one, or a set, at which all undecided ones differ.
    sensors: Sequence[tuple[str, ...]] = ()
    # The direction that contradicts the error bars most; None where none does.
    flat: _FlatDirection | None = None

    def __len__(self) -> int:
        return len(self.eta)

    @property
    def undecided(self) -> NDArray[np.bool_]:
        """Mask of the optima that priors and limits do not exclude (optima), the estimate among them."""
        return np.asarray(self.log_posterior > -DECIDED)

    @property
    def ambiguous(self) -> bool:
        """True if priors and limits leave more than one optimum."""
        return bool(np.count_nonzero(self.undecided) > 1)


class Optimum(NamedTuple):
    """An optimum of the posterior, with the likelihood that it maximises."""

    likelihood: Likelihood
    fit: Fit

    @property
    def noise(self) -> list[Array]:
        """Noise given, or that of the residuals (channels of each record)."""
        return self.likelihood.likeliest(self.fit)

    @property
    def misfit(self) -> float:
        """Misfit with the priors."""
        return self.likelihood.misfit(self.fit)

    @property
    def record_misfit(self) -> float:
        """Misfit without the priors."""
        return self.likelihood.record_misfit(self.fit)


@dataclass(frozen=True, eq=False)
class OptimaSearch:
    """A search for optima that are equivalent to an estimate."""

    likelihood: Likelihood  # the likelihood that the estimate maximises
    kinds: Sequence[str]  # what each parameter is; see `symmetry.like_parameters`
    # Returns the likelihood with the model for other coordinates (p), where a reduced basis follows the
    # parameters; None where it stays.
    likelihood_at: Callable[[Array], Likelihood] | None = None
    ends: Sequence[Array] = ()  # coordinates at which other searches ended
    # Most starts from which an optimum is searched for; 0: images by symmetries alone are found.
    searched: int = _SEARCHED

    def run(self, fit: Fit, deviations: Array) -> tuple[EquivalentOptima, Optimum | None]:
        """Return the equivalent optima of a fit, and the one of a greater posterior if there is any.

        `fit`: the fit at the estimate; `deviations`: standard deviations of its coordinates (p).
        """
        best = Optimum(self.likelihood, fit)
        for _ in range(_ROUNDS):
            optima, better = self._around(best, deviations)
            if better is None:
                break
            before, best = best, better
            deviations = better.likelihood.information(better.fit, better.noise).deviations()
        else:  # there may be still better ones: at least the last two are known
            optima = EquivalentOptima(
                np.array([best.fit.eta, before.fit.eta]),
                np.array([0.0, best.record_misfit - before.record_misfit]),
                np.array([0.0, best.misfit - before.misfit]),
            )
        return optima, None if best.fit is fit else best

    def _around(self, best: Optimum, deviations: Array) -> tuple[EquivalentOptima, Optimum | None]:
        """Return the optima equivalent to the best so far, and one of a greater posterior if there is any."""
        eta, priors = best.fit.eta, self.likelihood.priors
        alone = EquivalentOptima(eta[None], np.zeros(1), np.zeros(1))  # beside a better one
        # Near equal values deviations are large, and optima yet distinct.
        same = np.clip(_SAME_DEVIATIONS * deviations, _SAME_UNITS * priors.units, _DISTINCT * priors.units)
        permutations = self._symmetries(best)
        if (past_saddle := self._beside_saddle(best, permutations, deviations)) is not None:
            return alone, past_saddle
        points = images(permutations, eta, same, _MAX_OPTIMA)
        gain = np.zeros(len(points))  # of the logarithm of the posterior
        bounded = np.isfinite(priors.low) | np.isfinite(priors.high) | priors.has_prior
        if (bounded & ~priors.fixed).any():
            for k, point in enumerate(points[1:], 1):
                if k >= _REFINED or priors.fixed.any():  # with what is fixed at another place
                    gain[k] = _prior_gain(priors, eta, point)
                    continue
                optimum = self._beside(k, points)
                gain[k] = -math.inf if optimum is None else best.misfit - optimum.misfit
                if gain[k] > _BETTER and optimum is not None:
                    return alone, optimum
                if gain[k] > -DECIDED and optimum is not None:
                    points[k] = optimum.fit.eta
        likelihoods = np.zeros(len(points))
        flat, afar = self._beyond(best, symmetric=len(points) > 1)
        near = list(self._near(best, points, deviations, afar))
        nearest_best = min(near, key=lambda optimum: optimum.misfit, default=best)
        if best.misfit - nearest_best.misfit > _BETTER:
            return alone, nearest_best
        flat, better = self._with_intervals(best, flat, deviations)
        if better is not None:
            return alone, better
        for optimum in near:
            for point in images(permutations, optimum.fit.eta, same, _MAX_OPTIMA):
                points.append(point)
                likelihoods = np.append(likelihoods, best.record_misfit - optimum.record_misfit)
                gain = np.append(gain, best.misfit - optimum.misfit)
        return EquivalentOptima(np.array(points), likelihoods, gain, permutations, flat=flat), None

    def _beside_saddle(
        self, best: Optimum, permutations: Sequence[Permutation], deviations: Array
    ) -> Optimum | None:
        """Return an optimum beside a saddle at which interchangeable parameters are equal; else None."""
        # Their derivatives are the same there, so that a search does not see a way from it.
        eta, priors = best.fit.eta, self.likelihood.priors
        for permutation in permutations:
            for k, m in enumerate(permutation):
                if k >= m or abs(eta[k] - eta[m]) > deviations[k]:
                    continue
                for size in _APART_SADDLE:
                    start = eta.copy()
                    start[[k, m]] += size * priors.units[k] * np.array([1, -1])
                    likelihood = self._likelihood(start)
                    try:
                        with guarded("the prediction"):
                            fit = refine(likelihood, priors.clipped(start), _STEPS).fit
                    except DynidError:
                        continue
                    optimum = Optimum(likelihood, fit)
                    if best.misfit - optimum.misfit > _BETTER:
                        return optimum
        return None

    def _likelihood(self, eta: Array) -> Likelihood:
        """Return the likelihood at coordinates (p)."""
        return self.likelihood if self.likelihood_at is None else self.likelihood_at(eta)

    def _symmetries(self, best: Optimum) -> list[Permutation]:
        """Return the symmetries of the model that leave the likelihood at the optimum as it is."""
        likelihood, eta = self.likelihood, best.fit.eta
        if self.likelihood_at is not None:
            # A basis for the estimate has not the symmetry of the model: one for equal parameters has.
            centre = centre_of(self.kinds, eta)
            if not nearly_symmetric(likelihood, self.kinds, eta):
                return []
            likelihood = self.likelihood_at(centre)
        confirmed = []
        for permutation in symmetries(likelihood, self.kinds, eta):
            try:
                with guarded("the prediction"):
                    moved = image(permutation, eta)
                    optimum = Optimum(
                        moved_likelihood := self._likelihood(moved), moved_likelihood.fit(moved)
                    )
            except DynidError:
                continue
            if abs(optimum.record_misfit - best.record_misfit) <= DECIDED:
                confirmed.append(permutation)
        return confirmed

    def _beside(self, k: int, points: Sequence[Array]) -> Optimum | None:
        """Return the optimum of the posterior beside the k-th of the images; None where there is none."""
        likelihood = self._likelihood(points[k])
        try:
            with guarded("the prediction"):
                fit = refine(likelihood, likelihood.priors.clipped(points[k]), _STEPS).fit
        except DynidError:
            return None
        # From outside the limits a search may end at the optimum of another image.
        away = [float(np.linalg.norm((fit.eta - point) / likelihood.priors.units)) for point in points]
        return Optimum(likelihood, fit) if away[k] <= min(away) else None

    # Optima that no exact symmetry relates.

    @cached_property
    def _cheap(self) -> bool:
        """True if further searches are wanted, and their evaluations cheap."""
        cheap = _work_of(self.likelihood) * _RANKED <= _MAX_RANKING_WORK and self.likelihood_at is None
        return cheap and self.searched > 0

    def _near(
        self, best: Optimum, points: Sequence[Array], deviations: Array, afar: list[tuple[float, int, Array]]
    ) -> Iterator[Optimum]:
        """Yield optima to which searches from exchanged values, and from starts `afar`, lead."""
        # As far as their posterior is no less than that of the best.
        likelihood = self.likelihood
        if not self._cheap:
            return
        apart = np.maximum(_DISTINCT_OPTIMUM_DEVIATIONS * deviations, _SAME_UNITS * likelihood.priors.units)
        seen = list(points)
        starts = []
        for start in map(likelihood.priors.clipped, self._starts(best.fit.eta)):
            if _is_new(start, seen, apart):
                seen.append(start)
                starts.append(start)
        ranked: list[tuple[float, int, Array]] = []
        while starts and (left := _RANKED + self.searched - len(ranked)) > 0:
            pairs = zip(likelihood.misfits_at(np.array(starts[:left])).tolist(), starts, strict=False)
            for misfit, start in pairs:
                if not math.isnan(misfit):
                    ranked.append((misfit, len(ranked), start))
            del starts[:left]
        ends = list(points)
        for misfit, _, start in sorted(ranked)[: self.searched] + afar:
            optimum = self._searched(best, start, misfit)
            if optimum is not None and _is_new(optimum.fit.eta, ends, apart):
                ends.append(optimum.fit.eta)
                yield optimum

    def _beyond(
        self, best: Optimum, *, symmetric: bool
    ) -> tuple[_FlatDirection | None, list[tuple[float, int, Array]]]:
        """Return the direction in which error bars are contradicted most, and starts far beyond them."""
        # Those where the misfit is less than the information predicts, with theirs. With N values and the
        # noise estimated, at t deviations it predicts N / 2 log(1 + t^2 / N). Of `symmetric` models the
        # least known directions are followed where they are steep at first.
        if not self._cheap:
            return None, []
        likelihood, eta, units = self.likelihood, best.fit.eta, self.likelihood.priors.units
        information = likelihood.information(best.fit, best.noise)
        U, s, _ = np.linalg.svd(information.root / units[:, None])
        values = sum(int(record.data.counts.sum()) for record in likelihood.records)
        starts: list[tuple[float, float, Array]] = []
        directions: list[_FlatDirection] = []
        max_count, steepest = (_DIRECTIONS, _STEEP) if symmetric else (_MAX_DIRECTIONS, 1)
        # One deviation on either side of each direction, its length in units, and how long it has been steep.
        lines = [
            (size * units * side * direction, size, 0)
            for direction, size in zip(U.T[:max_count], s.tolist(), strict=False)
            for side in (1, -1)
            if size > _SAME_UNITS  # of clean data none
        ]
        distance, misfit = FLAT_DISTANCE, best.misfit
        while lines := [line for line in lines if distance * line[1] <= _FARTHEST and line[2] < steepest]:
            predicted = values / 2 * math.log1p(distance**2 / values)
            away = distance * np.array([deviation for deviation, _, _ in lines])
            points = likelihood.priors.clipped(eta + away)
            within = np.all(points == eta + away, axis=1)
            rises = likelihood.misfits_at(points) - misfit
            for k, (line, rise) in enumerate(zip(lines, rises.tolist(), strict=True)):
                if math.isnan(rise):
                    continue
                starts.append((rise / predicted, misfit + rise, points[k]))
                if distance == FLAT_DISTANCE and within[k]:
                    directions.append(_FlatDirection(away[k], rise, predicted))
                lines[k] = (*line[:2], 0 if rise < _FLAT * predicted else line[2] + 1)
            distance *= 2
        flat = sorted((start for start in starts if start[0] < _FLAT), key=lambda start: start[0])
        flattest = min(directions, key=lambda direction: direction.rise / direction.predicted, default=None)
        contradicted = flattest is not None and flattest.rise < _FLAT * flattest.predicted
        afar = [(misfit, k, start) for k, (_, misfit, start) in enumerate(flat[:_FLATTEST])]
        return flattest if contradicted else None, afar

    def _with_intervals(
        self, best: Optimum, flat: _FlatDirection | None, deviations: Array
    ) -> tuple[_FlatDirection | None, Optimum | None]:
        """Return a flat direction with intervals by profile likelihood, or a better optimum met there."""
        if flat is None:
            return None, None
        profiles = profile_intervals(self.likelihood, best.fit, deviations)
        if profiles.best.rise < -_BETTER:
            better = self._searched(best, profiles.best.eta, best.misfit)
            if better is not None and best.misfit - better.misfit > _BETTER:
                return flat, better
        return flat._replace(intervals=np.array([profiles.low, profiles.high])), None

    def _searched(self, best: Optimum, start: Array, misfit: float) -> Optimum | None:
        """Return the optimum that a search from a start leads to, if it is as good as the best."""
        likelihood = self.likelihood
        try:
            with guarded("the prediction"):
                fit, steps = refine(likelihood, start, _FIRST)
                if steps == _FIRST:
                    left = likelihood.misfit(fit) - best.misfit
                    if left > max(DECIDED, _LEFT * (misfit - best.misfit)):
                        return None
                    fit, steps = refine(likelihood, fit.eta, _STEPS)
                    if steps == _STEPS and likelihood.misfit(fit) - best.misfit < DECIDED:
                        fit, steps = refine(likelihood, fit.eta, _FURTHER)
        except DynidError:
            return None
        optimum = Optimum(likelihood, fit)
        return optimum if steps not in (_STEPS, _FURTHER) and optimum.misfit - best.misfit < DECIDED else None

    def _starts(self, eta: Array) -> Iterator[Array]:
        """Yield where other searches ended, and coordinates (p) with like parameters exchanged."""
        yield from self.ends
        names, kinds, p = self.likelihood.names, list(self.kinds), len(eta)
        pairs = [
            (i, j)
            for i, j in combinations(range(p), 2)
            if kinds[i] == kinds[j] and not self.likelihood.priors.fixed[[i, j]].any()
        ]
        exchanges = [{i: j, j: i} for i, j in pairs]
        # What belongs together by its name is exchanged together: left.k and left.c, R1 and C1.
        together: dict[tuple[str, str], dict[int, int]] = {}
        for i, j in pairs:
            label = _labels(names[i], names[j])
            if label is not None:
                together.setdefault(label, {}).update({i: j, j: i})
        exchanges = [exchange_set for exchange_set in together.values() if len(exchange_set) > 2] + exchanges
        for exchange in exchanges:
            yield image(tuple(exchange.get(k, k) for k in range(p)), eta)


def _labels(first: str, second: str) -> tuple[str, str] | None:
    """Return in what two names differ, if they have a common rest; None where they differ in all."""
    parts = [re.findall(r"\d+|[A-Za-z]+|[^A-Za-z\d]+", name) for name in (first, second)]
    if len(parts[0]) != len(parts[1]):
        return None
    different = [(a, b) for a, b in zip(*parts, strict=True) if a != b]
    return different[0] if len(different) == 1 and len(parts[0]) > 1 else None


def _is_new(eta: Array, others: Sequence[Array], apart: Array) -> bool:
    """Return True if coordinates (p) are apart from all others."""
    return not any(np.all(np.abs(eta - seen) <= apart) for seen in others)


def expected_optima(
    model: Model, likelihood: Likelihood, eta: Array, identifiable: NDArray[np.bool_]
) -> EquivalentOptima | None:
    """Return the optima that records will have at expected coordinates (p); None where there is but one.

    Those of exact symmetries of the `identifiable` parameters (p), the priors and limits judged at the images
    themselves. Where the expected values are equal, others stand for them.
    """
    kinds = distinct_kinds(like_parameters(model), likelihood.names, (~identifiable).tolist())
    permutations = symmetries(likelihood, kinds, eta)
    if not permutations:
        return None
    units = likelihood.priors.units
    points = images(permutations, eta, _SAME_UNITS * units, _MAX_OPTIMA)
    if len(points) == 1:
        apart = eta + units * np.linspace(-0.5, 0.5, len(eta))
        points = images(permutations, apart, _SAME_UNITS * units, _MAX_OPTIMA)
    gain = np.array([_prior_gain(likelihood.priors, eta, point) for point in points])
    optima = EquivalentOptima(np.array(points), np.zeros(len(points)), gain - gain[0], permutations)
    return replace(optima, sensors=deciding_sensors(model, likelihood, optima))


def _prior_gain(priors: Priors, eta: Array, point: Array) -> float:
    """Return the logarithm of the prior at a point (p) over that at coordinates (p)."""
    if np.any(((point < priors.low) | (point > priors.high)) & ~priors.fixed):
        return -math.inf
    has_prior = priors.has_prior & ~priors.fixed
    squares = [
        np.sum(((priors.means - coordinates) / priors.deviations)[has_prior] ** 2)
        for coordinates in (eta, point)
    ]
    return float(squares[0] - squares[1]) / 2


def deciding_sensors(model: Model, likelihood: Likelihood, optima: EquivalentOptima) -> list[tuple[str, ...]]:
    """Return sensors whose responses differ between all undecided optima, those that differ most first.

    Where one alone does not distinguish all, a set that does together.

    They are DOFs of a structure, or variables of a graph; none of measured modes.
    """
    record = likelihood.records[0]
    if isinstance(record, TimeRecord):
        loads, measured = list(record.conditions.loads), list(record.channels)
    elif isinstance(record, FrfRecord):
        loads = [frf.load for frf in record.measurement.channels]
        measured = [frf.channel for frf in record.measurement.channels]
    else:
        return []
    if len(record.system_model.states) > _SENSOR_STATES or not loads:
        return []
    channels: list[Any] = []
    if isinstance(model, StructuralModel) and model.basis is None:
        channels = [Channel(dof, "displacement", kind=model.kind(dof)) for dof in model.dofs]
    elif not isinstance(model, StructuralModel):
        channels = _storage_channels(model)
    names = {_sensor_name(channel) for channel in measured}
    channels = [channel for channel in channels if _sensor_name(channel) not in names][:_SENSORS]
    if not channels:
        return []
    # What exchanges least is seen by the fewest sensors.
    rest = optima.eta[1:][optima.undecided[1:]] if optima.ambiguous else optima.eta[1:]
    moved = np.count_nonzero(np.abs(rest - optima.eta[0]) > _DISTINCT * likelihood.priors.units, axis=1)
    compared = [optima.eta[0], *rest[np.argsort(moved, kind="stable")[:_COMPARED]]]
    try:
        with guarded("the responses of further sensors"):
            system = system_of(model, loads, channels)
            parameter_sets = [named(likelihood.unknowns, eta) for eta in compared]
            speeds = np.abs(record.system_model.poles(parameter_sets[0]))
            omega = np.geomspace(0.3, 1.1, _LINES) * float(np.max(speeds, initial=1.0))
            first, *others = (np.abs(system.response(values, omega)[0]) for values in parameter_sets)
    except (DynidError, np.linalg.LinAlgError):
        return []
    apart = np.array([_relative_difference(first, response) for response in others])
    labels = [str(_sensor_name(channel)) for channel in channels]
    min_difference = apart.min(axis=0)  # what a sensor distinguishes alone
    order = [k for k in np.argsort(-min_difference, kind="stable") if min_difference[k] > _DIFFERENT][:_NAMED]
    return [(labels[k],) for k in order] or [tuple(labels[k] for k in chosen) for chosen in _together(apart)]


def _relative_difference(first: Array, second: Array) -> Array:
    """Return the largest difference of responses (line x channel x load), relative to the largest."""
    size = np.maximum(first, second).max(axis=(0, 2))
    return np.asarray(np.abs(first - second).max(axis=(0, 2)) / np.where(size > 0, size, 1.0))


def _together(apart: Array) -> list[list[int]]:
    """Return a set of sensors that distinguish all optima (optimum x sensor) together; none where none do."""
    left, chosen = apart > _DIFFERENT, list[int]()
    if not left.any(axis=1).all():
        return []
    while len(left):
        counts = left.sum(axis=0)
        best = max(range(len(counts)), key=lambda k: (counts[k], apart[:, k].max()))
        chosen.append(best)
        left = left[~left[:, best]]
    return [sorted(chosen)]


def _storage_channels(model: Any) -> list[Any]:
    """Return the efforts of the storages of a graph; none of any other model."""
    from dynid.bondgraph.graph import STORAGES, Port
    from dynid.identification.systems.graph_system import IdentifiedGraph

    nodes = model.graph.nodes.items() if isinstance(model, IdentifiedGraph) else ()
    return [model.channel(Port(name, "e")) for name, node in nodes if node.type in STORAGES]


def _sensor_name(channel: Any) -> str:
    return f"DOF {channel.dof}" if isinstance(channel, Channel) else str(channel.name)


def _work_of(likelihood: Likelihood) -> float:
    """Return the approximate number of multiplications of one evaluation."""
    work = 0.0
    for record in likelihood.records:
        rows, states = len(record.data.values), len(record.system_model.states)
        multiplications = getattr(record, "multiplications", None)
        work += (
            rows * float(states) ** 2 * (1 + len(likelihood.unknowns))
            if multiplications is None
            else multiplications
        )
    return work
