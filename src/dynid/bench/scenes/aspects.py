"""Aspects of a scene: a choice of its run with the alternatives to it, by bases, solvers and propagation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.bench.benchmark import Alternative
from dynid.defaults import ALL_MODES, DENSE_MODES, FEW_MODES
from dynid.errors import UsageError
from dynid.lti.sampled import HOLDS, Sampled
from dynid.scene.schema.reduction import JointAwareModel, ReductionModel
from dynid.structure.backends import BACKENDS
from dynid.structure.model import StructuralModel
from dynid.structure.modes import modes, solver_for
from dynid.structure.reduction.methods import METHODS as _CLASSES

#: Joint-aware without residual vectors; `joint-aware` has them.
ALONE = "joint-aware-modes"
METHODS = (*_CLASSES, ALONE)
#: Frequencies below this part of the highest are rigid-body motions, measured by that.
_RIGID = 1e-6
#: Samples of a hold per requested instant, and the most in all.
_FINER, _MOST = (1, 2, 4), 1_000_000
Work = Callable[[list[Any]], Callable[[], Any]]


def nothing(_: Any) -> float | None:
    """Return None: no least error is known."""
    return None


@dataclass(frozen=True)
class Aspect:
    """Alternatives for the same result, one of which a run has chosen.

    Parameters
    ----------
    title
        Short description of the choice.
    size
        Unit of the sizes.
    points
        Alternatives with their sizes, the most accurate first: the first one that succeeds in this order is
        the reference of the others.
    chosen
        Names and sizes of the choices that the run made.
    because
        Reason for these choices.
    error
        Function of the results of an alternative and of the reference: its error, None without a number.
        Given the reference twice: the error of the reference.
    measure
        Definition of the error.
    least_error
        Function of a result: the least error to be expected; None: unknown.
    """

    title: str
    size: str
    points: Sequence[tuple[Alternative, int]]
    chosen: frozenset[tuple[str, int]]
    because: str
    error: Callable[[Any, Any], float | None]
    measure: str
    least_error: Callable[[Any], float | None] = nothing


def name_of(part: ReductionModel) -> str:
    """Return the name of a reduction of a scene among the alternatives."""
    return (
        ALONE if isinstance(part, JointAwareModel) and part.residuals in (None, [], "none") else part.method
    )


def sizes_around(size: int, most: int) -> list[int]:
    """Return a size and twice that size, as far as they are below the number of all coordinates."""
    return [each for each in (size, 2 * size) if each < most] or [size]


def described(name: str, size: int, ends: int) -> dict[str, Any]:
    """Return the keys of a reduction to a number of coordinates.

    Parameters
    ----------
    name
        The method, or `ALONE`.
    size
        Coordinates.
    ends
        Number of DOFs of joints, sensors and loads: a boundary, or loads with residual vectors.

    Raises
    ------
    UsageError
        If these leave no coordinate for modes.
    """
    chosen = {"masters": {"count": size}}
    if name in ("guyan", "dynamic", "irs"):
        return {"method": name, **chosen}
    if name == "serep":
        return {"method": name, **chosen, "modes": {"count": size}}
    if name == ALONE:
        return {"method": "joint-aware", "modes": {"count": size}, "residuals": "none"}
    if size <= ends:
        raise UsageError(f"{ends} DOFs of joints, sensors and loads leave no coordinate for modes")
    modes = {"modes": {"count": size - ends}}
    return {"method": name, **modes} | ({} if name == "craig-bampton" else {"residuals": "auto"})


def solvers(
    model: StructuralModel,
    count: int | None,
    below: float | None = None,
    values: Mapping[str, float] | None = None,
) -> Aspect:
    """Return the solvers of a structure's modes, and the one that is chosen.

    Parameters
    ----------
    model
        The structure.
    count, below, values
        As of `dynid.structure.modal_analysis.modal_analysis`.
    """
    matrices, size = model.with_joints(values), model.size

    def solver(backend: str) -> Callable[[int], Callable[[], Any]]:
        return lambda _: lambda: modes(*matrices, count, below, backend).omega

    def error(found: Any, reference: Any) -> float:
        if len(found) != len(reference):
            return float("inf")
        scale = np.maximum(reference, _RIGID * reference.max(initial=0.0))
        return float((np.abs(found - reference) / np.where(scale > 0, scale, 1.0)).max(initial=0.0))

    names = ["dense", *BACKENDS] if size <= ALL_MODES.value else list(BACKENDS)
    needs = {
        name: () if name in ("ldl", "splu") else (backend.package,) for name, backend in BACKENDS.items()
    }
    every = [(Alternative(name, solver(name), needs.get(name, ())), size) for name in names]
    return Aspect(
        title="solver of the modes",
        size="DOFs",
        points=every,
        chosen=frozenset({(solver_for(size, count, below, getattr(matrices[2], "nnz", 0)), size)}),
        because=f"chosen by default: {DENSE_MODES}; {FEW_MODES}",
        error=error,
        measure="largest relative difference of a frequency from the reference's",
    )


def propagation(work: Work, signals: Sequence[Any], times: NDArray[np.float64]) -> Aspect:
    """Return the ways to propagate a response.

    Parameters
    ----------
    work
        Function of signals: the function that computes the response (times x outputs) to them.
    signals
        The signals of the scene. An impulse has no samples and stays as it is.
    times
        The instants, evenly from 0 on.
    """
    count = len(times)

    def held(hold: str) -> Callable[[int], Callable[[], Any]]:
        def prepare(samples: int) -> Callable[[], Any]:
            # One sample beyond the last instant: a zero hold ends before its last sample.
            finer = np.linspace(0.0, times[-1], samples)
            step = times[-1] / (samples - 1)
            return work([each if each.jump else Sampled(each.value(finer), step, hold) for each in signals])

        return prepare

    def error(found: Any, reference: Any) -> float:
        size = float(np.sqrt(np.mean(reference**2)))
        return float(np.sqrt(np.mean((found - reference) ** 2))) / (size if size > 0 else 1.0)

    sizes = [k * (count - 1) + 1 for k in _FINER if k * count <= _MOST] or [count]
    exact = Alternative("exact", lambda _: work(list(signals)))
    points = [(exact, count), *((Alternative(hold, held(hold)), size) for hold in HOLDS for size in sizes)]
    return Aspect(
        title="input of the time response between its samples",
        size="samples",
        points=points,
        chosen=frozenset({("exact", count)}),
        because="named signals are known in closed form, samples by their own hold: propagated exactly",
        error=error,
        measure="RMS of the error over that of the exact response",
    )
