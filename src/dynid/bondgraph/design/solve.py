"""Design of a graph: several starts, the best solution, and the reason where there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.bondgraph.design.functions import DesignFunctions, Evaluation
from dynid.bondgraph.design.reasons import no_minimum, no_norm, unreachable, without_influence
from dynid.bondgraph.design.request import Design
from dynid.bondgraph.design.search import MET, Solution, meet_roots, minimise
from dynid.progress import tracked

Array = NDArray[np.float64]

#: Solutions whose coordinates differ by less are one; norms that differ by less, relative, are equal.
_SAME, _EQUAL = 1e-6, 1e-7
#: Points at which the influence of a parameter is tested.
_PROBES = 4


@dataclass(frozen=True, eq=False)
class Optimum:
    """A solution, and how many starts ended there."""

    solution: Solution
    count: int


@dataclass(frozen=True, eq=False)
class Designed:
    """A design that meets its targets.

    Attributes
    ----------
    functions
        The targets as functions of the free parameters.
    start
        The targets at the start.
    optima
        The solutions found, the chosen one first, then by their norms.
    idle
        Free parameters that no target depends on: they keep their starts.
    ended
        How many starts ended in a solution.
    """

    functions: DesignFunctions
    start: Evaluation
    optima: tuple[Optimum, ...]
    idle: tuple[str, ...]
    ended: int

    @property
    def solution(self) -> Solution:
        """The chosen solution."""
        return self.optima[0].solution

    @property
    def values(self) -> dict[str, float]:
        """The designed values of the free parameters."""
        names = [one.name for one in self.functions.design.free]
        values = self.functions.coordinates.values(self.solution.found.eta)
        return dict(zip(names, values.tolist(), strict=True))


def solve(design: Design) -> Designed:
    """Return the design that meets its targets.

    Raises
    ------
    Unreachable
        Where the targets cannot be reached, or a norm is infinite or has no minimum, with the reason.
    """
    functions = DesignFunctions(design)
    coordinates = functions.coordinates
    starts = [coordinates.start, *coordinates.drawn(design.starts - 1, design.seed)]
    evaluations = [functions.at(eta) for eta in starts[: max(2, min(_PROBES, len(starts)))]]
    idle = without_influence(functions, evaluations)
    kept = np.array([one.name in idle for one in design.free])
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
    met = [one for one in ends if one.met]
    if not met:
        missed += [one.found for one in ends]
        raise no_norm(functions, refused) if refused else unreachable(functions, missed, idle)
    optima = _optima(coordinates.start, met)
    best = optima[0].solution
    if problem := no_minimum(functions, best):
        raise problem
    return Designed(functions, functions.at(coordinates.start), tuple(optima), idle, len(met))


def _optima(start: Array, met: list[Solution]) -> list[Optimum]:
    """Return the different solutions: the least norm first, else the nearest to the start.

    Where the targets leave freedom and nothing is minimised, every start ends elsewhere: the nearest counts.
    """
    least = min(one.objective for one in met)

    def rank(one: Solution) -> tuple[int, bool, float]:
        behind = round((one.objective - least) / (_EQUAL * abs(least))) if least else 0
        unsure = one.conditions is not None and not one.conditions.verified
        return behind, unsure, float(np.linalg.norm(one.found.eta - start))

    best, *others = sorted(met, key=rank)
    optima = [Optimum(best, 1)]
    for one in others:
        same = next((k for k, other in enumerate(optima) if _is_same(one, other.solution)), None)
        if same is not None:
            optima[same] = Optimum(optima[same].solution, optima[same].count + 1)
        elif one.conditions.verified if one.conditions is not None else _is_isolated(one):
            optima.append(Optimum(one, 1))
    return optima


def _is_same(one: Solution, other: Solution) -> bool:
    return bool(np.abs(one.found.eta - other.found.eta).max() <= _SAME)


def _is_isolated(one: Solution) -> bool:
    """Return True if the targets leave no freedom at a solution."""
    jacobian = one.found.jacobian
    used = np.abs(jacobian).max(axis=0) > 0
    return bool(np.linalg.matrix_rank(jacobian, 1e-9 * np.abs(jacobian).max()) == np.count_nonzero(used))
