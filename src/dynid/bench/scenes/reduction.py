"""Aspects of scenes of kind `reduction`: the bases, and the solver of the full structure's modes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from dynid.bench.benchmark import Alternative
from dynid.bench.scenes.aspects import METHODS, Aspect, described, sizes_around, solvers
from dynid.defaults import BASIS_BAND, DENSE_MODES
from dynid.scene.kinds.reduction import build_reductor, interest_of, methods_of, read_reduction
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.reduction import ReductionScene
from dynid.structure.comparison import candidate
from dynid.structure.model import StructuralModel
from dynid.structure.modes import modes
from dynid.structure.reduction.methods import Reductor


class ReducedFrequencies(NamedTuple):
    """Natural frequencies, rad/s, and the numbers of the corresponding modes of the full structure."""

    omega: NDArray[np.float64]
    numbers: NDArray[np.int64]


def basis(scene: Scene) -> Aspect:
    """Return reductions by all methods at several sizes, beside those of the scene."""
    model, structure = _structure(scene)
    own, interest = methods_of(model), interest_of(model)
    made = {name: candidate(structure, method) for name, method in own.items()}
    sizes = {name: each.reduction.model.size for name, each in made.items()}
    largest, compared = max(sizes.values()), max(1, min(sizes.values()))
    asked = max(2 * largest, *(max(each.numbers, default=1) for each in made.values()))
    ends = len(dict.fromkeys([*(dof for joint in structure.joints for dof in joint.dofs), *interest.dofs]))

    def reduced(name: str) -> Callable[[int], Callable[[], ReducedFrequencies]]:
        def prepare(size: int) -> Callable[[], ReducedFrequencies]:
            part = read_reduction(described(name, size, ends))
            return _reduced(structure, build_reductor(part, interest, "accuracy"))(size)

        return prepare

    def full() -> ReducedFrequencies:  # all modes of a small structure
        few = None if structure.size <= DENSE_MODES.value else asked
        omega = modes(*structure.with_joints(), count=few).omega
        return ReducedFrequencies(omega, np.arange(1, len(omega) + 1))

    def error(found: ReducedFrequencies, reference: ReducedFrequencies) -> float:
        numbers = found.numbers[:compared]
        if len(found.omega) < compared or numbers.max() > len(reference.omega):
            return float("inf")
        true = reference.omega[numbers - 1]
        scale = np.where(true > 0, true, reference.omega.max(initial=1.0))
        return float((np.abs(found.omega[:compared] - true) / scale).max())

    points = [(Alternative("full", lambda _: full), structure.size)]
    points += [(Alternative(name, _reduced(structure, own[name])), size) for name, size in sizes.items()]
    points += [
        (Alternative(name, reduced(name)), size)
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


def _reduced(
    structure: StructuralModel, method: Reductor
) -> Callable[[int], Callable[[], ReducedFrequencies]]:
    def work() -> ReducedFrequencies:
        made = candidate(structure, method)
        return ReducedFrequencies(made.modes.omega, np.array(made.numbers, dtype=np.int64))

    return lambda _: work


def solver(scene: Scene) -> Aspect:
    """Return the solvers of the full structure's modes."""
    model, structure = _structure(scene)
    made = (candidate(structure, method) for method in methods_of(model).values())
    return solvers(structure, max(max(each.numbers, default=1) for each in made))


def _structure(scene: Scene) -> tuple[ReductionScene, StructuralModel]:
    model = cast("ReductionScene", scene.model)
    return model, build_structure(scene, model.structure, model.joints)


ASPECTS = {"basis": basis, "modes": solver}
