"""Aspects of a scene: a choice of its run with the alternatives to it.

Of kind `reduction`: the bases, and the solver of the full structure's modes. Of kind `bond-graph`: the
engine, and the propagation of the time response.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dynid.bench.benchmark import Alternative
from dynid.bench.cases.zeros_poles import distance, relative_to
from dynid.bondgraph.analysis import analyse
from dynid.bondgraph.analysis_request import ENGINES, NUMERIC, Analysis, choose_engine, modelled_storages
from dynid.bondgraph.graph import BondGraph
from dynid.bondgraph.reduced_graph import ReducedGraph
from dynid.defaults import ALL_MODES, BASIS_BAND, DENSE_MODES, FEW_MODES
from dynid.errors import UsageError
from dynid.lti.noise import HOLDS, Sampled
from dynid.result import Result
from dynid.scene.kinds.bond_graph import question
from dynid.scene.kinds.reduction import build_reductor, interest_of, methods_of, read_reduction
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.reduction import JointAwareModel, ReductionModel, ReductionScene
from dynid.structure.backends import BACKENDS
from dynid.structure.model import StructuralModel
from dynid.structure.modes import modes, solver_for
from dynid.structure.reduction.methods import METHODS as _CLASSES
from dynid.structure.reduction.methods import Reductor
from dynid.structure.reduction_comparison import candidate

#: Joint-aware without residual vectors; `joint-aware` has them.
ALONE = "joint-aware-modes"
METHODS = (*_CLASSES, ALONE)
#: Frequencies below this part of the highest are rigid-body motions, measured by that.
_RIGID_FREQUENCY_RATIO = 1e-6
#: Samples of a hold per requested instant, and the most in all.
_HOLD_RATIOS, _MAX_HOLD_SAMPLES = (1, 2, 4), 1_000_000


@dataclass(frozen=True)
class Aspect:
    """Alternatives for the same result, one of which a run has chosen.

    Of `points`, alternatives with their sizes, the most accurate first, the first one that succeeds is the
    reference of the others.
    """

    title: str
    size: str  # unit of the sizes
    points: Sequence[tuple[Alternative, int]]
    chosen: frozenset[tuple[str, int]]  # names and sizes of the choices that the run made
    because: str  # reason for these choices
    #: Of the results of an alternative and of the reference, None without a number; its own, given twice
    error: Callable[[Any, Any], float | None]
    measure: str  # definition of the error
    #: Of a result: the least error to be expected; None: unknown
    least_error: Callable[[Any], float | None] = lambda _: None


def name_of(reduction: ReductionModel) -> str:
    """Return the name of a reduction of a scene among the alternatives."""
    return (
        ALONE
        if isinstance(reduction, JointAwareModel) and reduction.residuals in (None, [], "none")
        else reduction.method
    )


def sizes_around(size: int, max_size: int) -> list[int]:
    """Return a size and twice that size, as far as they are below the number of all coordinates."""
    return [coordinates for coordinates in (size, 2 * size) if coordinates < max_size] or [size]


def described(name: str, size: int, ends: int) -> dict[str, Any]:
    """Return the keys of a reduction by a method, or `ALONE`, to a number of coordinates.

    `ends` DOFs of joints, sensors and loads are a boundary, or loads with residual vectors. Raises
    `UsageError` if these leave no coordinate for modes.
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
    """Return the solvers of the modes that `modal_analysis` would compute, and the chosen one."""
    matrices, size = model.with_joints(values), model.size

    def frequencies(_: int, backend: str) -> Any:
        return modes(*matrices, count, below, backend).omega

    def error(result: Any, reference: Any) -> float:
        if len(result) != len(reference):
            return float("inf")
        scale = np.maximum(reference, _RIGID_FREQUENCY_RATIO * reference.max(initial=0.0))
        return float((np.abs(result - reference) / np.where(scale > 0, scale, 1.0)).max(initial=0.0))

    names = ["dense", *BACKENDS] if size <= ALL_MODES.value else list(BACKENDS)
    needs = {
        name: () if name in ("ldl", "splu") else (backend.package,) for name, backend in BACKENDS.items()
    }
    alternatives = [
        Alternative(name, partial(frequencies, backend=name), needs=needs.get(name, ())) for name in names
    ]
    return Aspect(
        title="solver of the modes",
        size="DOFs",
        points=[(alternative, size) for alternative in alternatives],
        chosen=frozenset({(solver_for(size, count, below, getattr(matrices[2], "nnz", 0)), size)}),
        because=f"chosen by default: {DENSE_MODES}; {FEW_MODES}",
        error=error,
        measure="largest relative difference of a frequency from the reference's",
    )


def propagation(
    respond: Callable[[list[Any]], Any], signals: Sequence[Any], times: NDArray[np.float64]
) -> Aspect:
    """Return the ways to propagate a response at instants evenly from 0 on.

    `respond` is the response (times x outputs) to signals. An impulse has no samples and stays as it is.
    """
    count = len(times)

    def held(samples: int, hold: str) -> list[Any]:
        # One sample beyond the last instant: a zero hold ends before its last sample.
        finer = np.linspace(0.0, times[-1], samples)
        step = times[-1] / (samples - 1)
        return [signal if signal.jump else Sampled(signal.value(finer), step, hold) for signal in signals]

    def error(result: Any, reference: Any) -> float:
        size = float(np.sqrt(np.mean(reference**2)))
        return float(np.sqrt(np.mean((result - reference) ** 2))) / (size if size > 0 else 1.0)

    sizes = [k * (count - 1) + 1 for k in _HOLD_RATIOS if k * count <= _MAX_HOLD_SAMPLES] or [count]
    exact = Alternative("exact", lambda _: respond(list(signals)))
    holds = [Alternative(hold, respond, partial(held, hold=hold)) for hold in HOLDS]
    points = [(exact, count), *((hold, size) for hold in holds for size in sizes)]
    return Aspect(
        title="input of the time response between its samples",
        size="samples",
        points=points,
        chosen=frozenset({("exact", count)}),
        because="named signals are known in closed form, samples by their own hold: propagated exactly",
        error=error,
        measure="RMS of the error over that of the exact response",
    )


class _ReducedFrequencies(NamedTuple):
    """Natural frequencies, rad/s, and the numbers of the corresponding modes of the full structure."""

    omega: NDArray[np.float64]
    numbers: NDArray[np.int64]


def basis(scene: Scene) -> Aspect:
    """Return reductions by all methods at several sizes, beside those of the scene."""
    model, structure = _structure(scene)
    methods, interest = methods_of(model), interest_of(model)
    candidates = {name: candidate(structure, method) for name, method in methods.items()}
    sizes = {name: reduced_model.reduction.model.size for name, reduced_model in candidates.items()}
    largest, compared = max(sizes.values()), max(1, min(sizes.values()))
    asked = max(
        2 * largest, *(max(reduced_model.numbers, default=1) for reduced_model in candidates.values())
    )
    ends = len(dict.fromkeys([*(dof for joint in structure.joints for dof in joint.dofs), *interest.dofs]))

    def reductor(size: int, name: str) -> Reductor:
        return build_reductor(read_reduction(described(name, size, ends)), interest, "accuracy")

    def reduced(method: Reductor, _: object = None) -> _ReducedFrequencies:
        reduction = candidate(structure, method)
        return _ReducedFrequencies(reduction.modes.omega, np.array(reduction.numbers, dtype=np.int64))

    def full(_: int) -> _ReducedFrequencies:  # all modes of a small structure
        few = None if structure.size <= DENSE_MODES.value else asked
        omega = modes(*structure.with_joints(), count=few).omega
        return _ReducedFrequencies(omega, np.arange(1, len(omega) + 1))

    def error(result: _ReducedFrequencies, reference: _ReducedFrequencies) -> float:
        numbers = result.numbers[:compared]
        if len(result.omega) < compared or numbers.max() > len(reference.omega):
            return float("inf")
        true = reference.omega[numbers - 1]
        scale = np.where(true > 0, true, reference.omega.max(initial=1.0))
        return float((np.abs(result.omega[:compared] - true) / scale).max())

    points = [(Alternative("full", full), structure.size)]
    points += [(Alternative(name, partial(reduced, methods[name])), size) for name, size in sizes.items()]
    points += [
        (Alternative(name, reduced, partial(reductor, name=name)), size)
        for name in METHODS
        for size in sizes_around(largest, structure.size)
        if sizes.get(name) != size
    ]
    return Aspect(
        title="basis of the model",
        size="coordinates",
        points=points,
        chosen=frozenset(sizes.items()),
        because=f"as requested; chosen by default: {BASIS_BAND}",
        error=error,
        measure=f"largest relative error of the first {compared} natural frequencies with the joints",
    )


def solver(scene: Scene) -> Aspect:
    """Return the solvers of the full structure's modes."""
    model, structure = _structure(scene)
    candidates = (candidate(structure, method) for method in methods_of(model).values())
    return solvers(structure, max(max(reduction.numbers, default=1) for reduction in candidates))


def _structure(scene: Scene[ReductionScene]) -> tuple[ReductionScene, StructuralModel]:
    model = scene.model
    return model, build_structure(scene, model.structure, model.joints)


REDUCTION_ASPECTS = {"basis": basis, "modes": solver}


_TRANSFER_FUNCTIONS = "bond_graph/transfer_function/"


def engine(scene: Scene) -> Aspect:
    """Return the engines, with the chosen one."""
    graph, analysis = question(scene)
    reduced = ReducedGraph(graph, analysis.inputs, analysis.outputs, traced=False)
    size, choice = modelled_storages(reduced), choose_engine(reduced, analysis)

    def roots(_: int, engine: Any) -> dict[str, tuple[Any, Any]]:
        asked = analysis.results & (NUMERIC | {"transfer_function"})
        if engine == "symbolic" and "transfer_function" not in asked:
            raise UsageError("formulas alone: zeros, poles and properties need numbers")
        results = {"transfer_function"} if engine == "symbolic" else asked | {"zeros", "poles"}
        request = replace(
            analysis, engine=engine, results=frozenset(results), port=None, times=None, omega=None
        )
        return _roots(analyse(graph, request))

    return Aspect(
        title="engine of transfer functions, zeros and poles",
        size="storage elements",
        points=[(Alternative(name, partial(roots, engine=name)), size) for name in ENGINES],
        chosen=frozenset({(choice.engine, size)}),
        because=choice.reason,
        error=_error,
        measure="largest relative distance of zeros and poles from the reference's; its own: its bound",
    )


def _roots(result: Result) -> dict[str, tuple[Any, Any]]:
    """Return zeros and poles of every channel, with their error bounds or estimates."""
    roots = {}
    for path, variable in result.items():
        group, _, name = path.rpartition("/")
        if path.startswith(_TRANSFER_FUNCTIONS) and name in ("zeros", "poles"):
            errors = (f"{group}/{name[:-1]}_error_{kind}" for kind in ("bound", "estimate"))
            radius = next(result[path_of_error].data for path_of_error in errors if path_of_error in result)
            roots[path] = variable.data, radius
    return roots


def _error(roots: dict[str, tuple[Any, Any]], reference: dict[str, tuple[Any, Any]]) -> float | None:
    if not roots:
        return None  # formulas
    worst = 0.0
    for path, (true, radius) in reference.items():
        poles = reference[path.rpartition("/")[0] + "/poles"][0]
        size = float(np.abs(poles).max(initial=0.0))
        if roots is reference:
            worst = max(worst, float((radius / relative_to(true, size)).max(initial=0.0)))
        else:
            worst = max(worst, distance(roots[path][0], true, size))
    return worst


def response(scene: Scene) -> Aspect:
    """Return the ways to propagate the time response."""
    return response_of(*question(scene))


def response_of(graph: BondGraph, asked: Analysis) -> Aspect:
    """Return the ways to propagate the time response of a graph."""
    assert asked.times is not None
    analysis = replace(asked, results=frozenset({"time_response"}), omega=None, port=None)

    def respond(signals: list[Any]) -> Any:
        driven = tuple(zip((name for name, _ in analysis.signals), signals, strict=True))
        request = replace(analysis, signals=driven)
        return analyse(graph, request)["bond_graph/time_response/response"].data

    return propagation(respond, [signal for _, signal in analysis.signals], asked.times)


GRAPH_ASPECTS = {"engine": engine, "propagation": response}
