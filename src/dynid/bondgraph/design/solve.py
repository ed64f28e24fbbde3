"""Design of a graph: several starts, the best solution, and the reason where there is none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dynid.arrays import Array
from dynid.bondgraph.design.design_request import (
    Design,
    LoopTarget,
    Reached,
    RootTarget,
    Target,
    residual_count,
)
from dynid.bondgraph.design.functions import DesignFunctions, Evaluation
from dynid.bondgraph.design.search import MET, Solution, meet_roots, minimise
from dynid.errors import NumericalError, Unreachable
from dynid.number_format import counted
from dynid.progress import tracked

#: Solutions whose coordinates differ by less are one; norms that differ by less, relative, are equal.
_OPTIMUM_DISTANCE, _OBJECTIVE_RTOL = 1e-6, 1e-7
#: Points at which the influence of a parameter is tested.
_PROBES = 4


@dataclass(frozen=True, eq=False)
class Optimum:
    """A solution, and how many starts ended there."""

    solution: Solution
    count: int


@dataclass(frozen=True, eq=False)
class Designed:
    """A design that meets its targets."""

    functions: DesignFunctions  # the targets as functions of the free parameters
    start: Evaluation  # the targets at the start
    optima: tuple[Optimum, ...]  # the solutions found, the chosen one first, then by their norms
    idle: tuple[str, ...]  # free parameters that no target depends on: they keep their starts
    ended: int  # how many starts ended in a solution

    @property
    def solution(self) -> Solution:
        """The chosen solution."""
        return self.optima[0].solution

    @property
    def values(self) -> dict[str, float]:
        """The designed values of the free parameters."""
        names = [parameter.name for parameter in self.functions.design.free]
        values = self.functions.coordinates.values(self.solution.evaluation.eta)
        return dict(zip(names, values.tolist(), strict=True))


def solve(design: Design) -> Designed:
    """Return the design that meets its targets.

    Raises `Unreachable` where the targets cannot be reached, or a norm is infinite or has no minimum, with
    the reason.
    """
    functions = DesignFunctions(design)
    coordinates = functions.coordinates
    starts = [coordinates.start, *coordinates.drawn(design.starts - 1, design.seed)]
    evaluations = [functions.at(eta) for eta in starts[: max(2, min(_PROBES, len(starts)))]]
    idle = _without_influence(functions, evaluations)
    kept = np.array([parameter.name in idle for parameter in design.free])
    starts = [np.where(kept, coordinates.start, eta) for eta in starts]
    if kept.any():
        functions.low[kept] = functions.high[kept] = coordinates.start[kept]
    ends, missed, refused = list[Solution](), list[Evaluation](), list[Evaluation]()
    for eta in tracked(starts, "start"):
        here = meet_roots(functions, eta) if design.roots else functions.at(eta)
        if not np.abs(here.residuals).max(initial=0.0) <= MET:
            missed.append(here)
        elif not here.exists:
            refused.append(here)
        elif design.criteria:
            ends.append(minimise(functions, here))
        else:
            ends.append(Solution(here, 0.0, met=True))
    met = [solution for solution in ends if solution.met]
    if not met:
        missed += [solution.evaluation for solution in ends]
        raise _no_norm(functions, refused) if refused else _unreachable(functions, missed, idle)
    met = _verified(functions, met)
    optima = _optima(coordinates.start, met)
    best = optima[0].solution
    if problem := _no_minimum(functions, best):
        raise problem
    return Designed(functions, functions.at(coordinates.start), tuple(optima), idle, len(met))


def _verified(functions: DesignFunctions, met: list[Solution]) -> list[Solution]:
    """Return the solutions whose margins are those of stable loops; raises `Unreachable` where none is."""
    verified = [solution for solution in met if functions.verified(solution.evaluation)]
    if not verified:
        design = functions.design
        target = next(target for target in design.roots if isinstance(target, LoopTarget))
        why = "it is met only where the closed loops are not stable"
        raise _error(design, target, why, "Start where they are stable, or give limits.")
    return verified


def _optima(start: Array, met: list[Solution]) -> list[Optimum]:
    """Return the different solutions: the least norm first, else the nearest to the start.

    Where the targets leave freedom and nothing is minimised, every start ends elsewhere: the nearest counts.
    """
    lowest = min(solution.objective for solution in met)

    def rank(solution: Solution) -> tuple[int, bool, float]:
        behind = round((solution.objective - lowest) / (_OBJECTIVE_RTOL * abs(lowest))) if lowest else 0
        unsure = solution.conditions is not None and not solution.conditions.verified
        return behind, unsure, float(np.linalg.norm(solution.evaluation.eta - start))

    best, *others = sorted(met, key=rank)
    optima = [Optimum(best, 1)]
    for solution in others:
        eta = solution.evaluation.eta
        distances = [np.abs(eta - optimum.solution.evaluation.eta).max() for optimum in optima]
        same = next((k for k, distance in enumerate(distances) if distance <= _OPTIMUM_DISTANCE), None)
        if same is not None:
            optima[same] = Optimum(optima[same].solution, optima[same].count + 1)
            continue
        jacobian = solution.evaluation.jacobian  # of full rank where the targets leave no freedom
        used = np.count_nonzero(np.abs(jacobian).max(axis=0, initial=0.0))
        isolated = used == np.linalg.matrix_rank(jacobian, 1e-9 * np.abs(jacobian).max(initial=0.0))
        if isolated if solution.conditions is None else solution.conditions.verified:
            optima.append(Optimum(solution, 1))
    return optima


#: Derivatives below this part of the largest one are those of something that does not change.
_DERIVATIVE_TOL = 1e-10
#: A coordinate nearer to its limit than this is at it.
_LIMIT_DISTANCE = 1e-6
#: A parameter that left its start by more than this factor without a limit ran away.
_FAR_FACTOR = 1e3


def _without_influence(functions: DesignFunctions, evaluations: Sequence[Evaluation]) -> tuple[str, ...]:
    """Return the free parameters that no target depends on, by derivatives at several points."""
    free = functions.design.free
    usable = [evaluation for evaluation in evaluations if evaluation.exists]
    blocks = [
        np.concatenate([evaluation.jacobian, *(norm.slopes for norm in evaluation.norms)])
        for evaluation in usable
    ]
    idle = []
    for k, parameter in enumerate(free):
        still = all(
            (np.abs(rows[:, k]) <= _DERIVATIVE_TOL * np.abs(rows).max(axis=1, initial=0.0)).all()
            for rows in blocks
        )
        if parameter.name not in functions.reached or (len(blocks) > 1 and still):
            idle.append(parameter.name)
    return tuple(idle)


def _unreachable(
    functions: DesignFunctions, missed: Sequence[Evaluation], idle: Sequence[str]
) -> Unreachable:
    """Return the error of wanted roots that no start reaches, with the reason."""
    design = functions.design
    usable = [evaluation for evaluation in missed if np.isfinite(evaluation.residuals).all()]
    if not usable:
        return _missing_roots(functions, missed)
    best = min(usable, key=lambda evaluation: float(np.linalg.norm(evaluation.residuals)))
    ends = np.cumsum([0, *map(residual_count, design.roots)]).tolist()
    places = [slice(a, b) for a, b in pairwise(ends)]  # of the residuals of each root
    off = [k for k, rows in enumerate(places) if np.abs(best.residuals[rows]).max() > MET]
    target, reached = design.roots[off[0]], best.reached[off[0]]
    assert reached is not None
    there = target.root_text(reached.frequency, reached.damping)
    nearest = f"the nearest that is reached is {there}"
    fixed = _fixed_part(functions, target, reached, places[off[0]], usable)
    if fixed:
        return _error(design, target, f"{fixed}; {nearest}", "Free another parameter that moves it.")
    limits = list(_limits(functions, best))
    values = functions.coordinates.values(best.eta)
    at = _named(design, values)
    if limits:
        needed = _needed(functions, best)
        reason = f"{' and '.join(limits)}; there {there} is reached{needed}"
        return _error(design, target, reason, "Widen the limits, or free another parameter.")
    conditions = sum(map(residual_count, design.roots))
    count = len(design.free) - len(idle)
    if conditions > count:
        others = [str(design.roots[k]) for k in off[1:]]
        also = f" (as are the {', the '.join(others)})" if others else ""
        reason = (
            f"the targets are {counted(conditions, 'condition')} on {counted(count, 'free parameter')}{also}"
            f"; {nearest}, with {at} (least squares)"
        )
        return _error(design, target, reason, "Free more parameters, or drop a target.")
    tried = counted(design.starts, "start")
    reason = f"{nearest}, with {at}: no small change comes nearer, from {tried}"
    return _error(design, target, reason, "Try more `starts`, or another target.")


def _no_norm(functions: DesignFunctions, refused: Sequence[Evaluation]) -> Unreachable:
    design = functions.design
    index, why = next((k, norm.why) for k, norm in enumerate(refused[0].norms) if norm.why)
    target = design.criteria[index]
    everywhere = f" (so at all {len(refused)} starts)" if len(refused) > 1 else ""
    return Unreachable(
        f"the {target} cannot be minimised: {why}{everywhere}",
        remedy="Choose another output, another norm, or a start at which it is finite.",
        names=(_name(design, target),),
    )


def _no_minimum(functions: DesignFunctions, best: Solution) -> Unreachable | None:
    """Return the error of a norm that falls while a parameter without limit runs away; None if none does."""
    design, coordinates = functions.design, functions.coordinates
    if best.conditions is None:
        return None
    values = coordinates.values(best.evaluation.eta)
    for k, parameter in enumerate(design.free):
        away = best.evaluation.eta[k] - coordinates.start[k]
        factor = np.exp(abs(away)) if parameter.logarithmic else abs(away)
        limit = parameter.high if away > 0 else parameter.low
        open_end = limit is None or (parameter.logarithmic and limit <= 0)
        at_end = (
            min(best.evaluation.eta[k] - functions.low[k], functions.high[k] - best.evaluation.eta[k])
            < _LIMIT_DISTANCE
        )
        if open_end and (at_end or (factor > _FAR_FACTOR and not best.conditions.verified)):
            way, key = ("grows", "max") if values[k] > parameter.start else ("falls", "min")
            target = design.criteria[0]
            return Unreachable(
                f"the {target} has no minimum: it still falls, at {best.evaluation.norms[0].value:.6g}, as "
                f"{parameter.name} {way} to {values[k]:.3g}",
                remedy=f"Give {parameter.name} a limit: `{key}`.",
                names=(f"design.free.{parameter.name}", _name(design, target)),
            )
    return None


def _named(design: Design, values: Array) -> str:
    pairs = zip(design.free, values, strict=True)
    return ", ".join(f"{parameter.name} = {value:.6g}" for parameter, value in pairs)


def _name(design: Design, target: Target) -> str:
    index = next(k for k, candidate in enumerate(design.targets) if candidate is target)
    return f"design.targets.{index}"


def _error(design: Design, target: RootTarget | LoopTarget, reason: str, remedy: str) -> Unreachable:
    return Unreachable(
        f"the {target} cannot be reached: {reason}", remedy=remedy, names=(_name(design, target),)
    )


def _missing_roots(functions: DesignFunctions, missed: Sequence[Evaluation]) -> Unreachable:
    """Return the error of a target for which the channel has no roots at any start."""
    design = functions.design
    reached = missed[0].reached
    index = next((k for k, root in enumerate(reached) if root is None), 0)
    target = design.roots[index]
    if isinstance(target, LoopTarget):
        none = {"phase_margin": ", or |L| does not cross 1", "gain_margin": ", or L not the negative axis"}
        reason = f"the closed loops are not stable{none.get(target.kind, '')}"
        why = f"{reason} at any of {counted(len(missed), 'start')}"
        return _error(design, target, why, "Start where they are stable, or choose another target.")
    try:
        values, _ = functions.channel_roots(functions.matrices(missed[0].eta), target)
    except NumericalError as error:
        return _error(design, target, error.problem, "Change the start.")
    if not len(values):
        return _error(design, target, f"{target.channel} has no {target.kind}s", "Choose another channel.")
    what = "real" if target.damping is not None and abs(target.damping) == 1 else "oscillating"
    fewer = sum(
        root_target.kind == target.kind and root_target.channel == target.channel
        for root_target in design.roots
    )
    text = f"no {what} {target.kind}s" if fewer == 1 else f"fewer {what} {target.kind}s than targets"
    reason = f"{target.channel} has {text} at any of {counted(len(missed), 'start')}"
    return _error(design, target, reason, "Start elsewhere, or choose another target.")


def _fixed_part(
    functions: DesignFunctions,
    target: RootTarget | LoopTarget,
    reached: Reached,
    rows: slice,
    evaluations: Sequence[Evaluation],
) -> str:
    """Return what of a root does not depend on the free parameters; empty where all that is missed does."""
    names = ", ".join(parameter.name for parameter in functions.design.free)
    slopes = np.stack([evaluation.jacobian[rows] for evaluation in evaluations])
    still = np.asarray((np.abs(slopes) <= _DERIVATIVE_TOL).all(axis=(0, 2)))
    if still.all():
        return f"the {target.kind.replace('_', ' ')}s of {target.channel} do not depend on {names}"
    missed = np.abs(reached.residuals) > MET
    for quantity, (fixed, off) in enumerate(zip(still, np.atleast_1d(missed), strict=True)):
        if fixed and off:
            what = ("natural frequency", "damping ratio")[quantity]
            return f"the {what} of this {target.kind} does not depend on {names}"
    return ""


def _limits(functions: DesignFunctions, best: Evaluation) -> Iterator[str]:
    """Yield the limits beyond which the residuals would still fall."""
    coordinates = functions.coordinates
    gradient = best.jacobian.T @ best.residuals
    size = np.abs(best.jacobian).max(initial=0.0) * np.linalg.norm(best.residuals)
    for k, parameter in enumerate(functions.design.free):
        for key, limit, edge, way in (
            ("min", parameter.low, functions.low[k], 1),
            ("max", parameter.high, functions.high[k], -1),
        ):
            at = abs(best.eta[k] - edge) <= _LIMIT_DISTANCE * (1 + abs(edge))
            if at and way * gradient[k] > _DERIVATIVE_TOL * size:
                value = coordinates.values(best.eta)[k]
                runs = f"{'falls' if way > 0 else 'grows'} to"
                yield f"{parameter.name} {runs if limit is None else f'is at its {key},'} {value:.6g}"


def _needed(functions: DesignFunctions, best: Evaluation) -> str:
    """Return the values that reach the targets without limits, in words; empty where none do."""
    design = functions.design
    open_ended = replace(
        design, free=tuple(replace(parameter, low=None, high=None) for parameter in design.free)
    )
    free = DesignFunctions(open_ended)
    evaluation = meet_roots(free, np.clip(best.eta, free.low, free.high))
    if not np.abs(evaluation.residuals).max() <= MET:
        return ""
    values = free.coordinates.values(evaluation.eta)
    return f"; without limits it needs {_named(design, values)}"
