"""Explanation of a comparison of reductions: the bases, the solver of the modes, and the cost."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import cast

from dynid import progress
from dynid.defaults import DENSE_MODES, FEW_MODES
from dynid.errors import NumericalError, UsageError
from dynid.number_format import counted
from dynid.result import Result
from dynid.scene.explanations.explanation import (
    CostEstimate,
    Explanation,
    Fact,
    file_kilobytes,
    node_facts,
    peak_megabytes,
    speed,
)
from dynid.scene.kinds.reduction import methods_of
from dynid.scene.kinds.signals import angular_frequencies
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.base import Section
from dynid.scene.schema.reduction import ReductionScene
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import solver_for
from dynid.structure.reduction.reduction import StructuralReduction

#: DOFs up to which bases are computed for an explanation; their modes take well under a second.
_MADE = DENSE_MODES.value
#: Modes where their number is not given.
_UNKNOWN = 20
#: Seconds of a multiplication of a dense solver, and of one DOF of one mode of a sparse one.
_DENSE, _SPARSE = 1.2e-9, 6e-6


def explain(scene: Scene) -> Explanation:
    """Return the explanation of a scene of kind `reduction`; the bases of small structures are computed."""
    model = cast("ReductionScene", scene.model)
    structure = build_structure(scene, model.structure, model.joints)
    result = Result("reduction", scene.title)
    n = structure.size
    facts = [Fact("model", f"{counted(n, 'DOF')}, {counted(len(structure.joints), 'joint')}")]
    facts += node_facts(structure)
    made: dict[str, StructuralReduction] = {}
    seconds: dict[str, float] = {}
    try:
        methods = methods_of(model)
        if n <= _MADE:
            import scipy.linalg  # noqa: F401 - loaded beforehand: that is no work

            for name in progress.tracked(list(methods), "reduction"):
                began = time.thread_time()
                made[name] = methods[name].reduce(structure)
                seconds[f"reducing by {name}"] = time.thread_time() - began
        for place, name in enumerate(methods):
            said = [] if name in made else _wanted(model.reduction[place])
            if basis := made.get(name):
                said.append(counted(basis.model.size, "coordinate"))
                said += [f"masters {_listed(basis.masters)}"] if basis.masters else []
                if basis.modes:
                    rule = f" ({basis.rule})" if basis.rule else ""
                    said.append(counted(len(basis.modes), "mode") + rule)
                said += [f"condition {basis.condition:.2g}"] if basis.condition is not None else []
            facts.append(Fact("bases" if place == 0 else "", f"{name}: {'; '.join(said)}"))
        most = _most_modes(model, made)
        solver = solver_for(n, most, None)
    except (NumericalError, UsageError) as error:
        return Explanation(result, facts, obstacle=error)
    if solver == "dense":
        solved = f"{f'the lowest {most}' if n <= DENSE_MODES.value else 'all'}, by dense matrices"
    else:
        solved = f"the lowest {most}, {FEW_MODES.sentence.format(value=FEW_MODES.value)} ({solver})"
    facts.append(Fact("modes", solved))
    if model.frequency is not None:
        lines = len(angular_frequencies(model.frequency))
        facts.append(
            Fact(
                "responses", f"at {counted(lines, 'frequency')}, of the full structure and of each reduction"
            )
        )
    sizes = [each.model.size for each in made.values()] or [most] * len(methods)
    return Explanation(result, facts, _cost(model, structure, seconds, solver, sizes))


def _wanted(part: Section) -> list[str]:
    """Return the masters and modes of a method, in the terms of the scene."""
    given = {key: getattr(part, key) for key in ("masters", "modes") if getattr(part, key, None) is not None}
    said = []
    for key, value in given.items():
        parts = (
            value.model_dump(exclude_none=True, exclude_unset=True) if isinstance(value, Section) else None
        )
        asked = ", ".join(f"{name} {each}" for name, each in parts.items()) if parts else _listed(value)
        said.append(f"{key} {asked}")
    return said or ["chosen from joints and responses"]


def _listed(names: Sequence[object]) -> str:
    return f"{', '.join(map(str, names[:8]))}{', …' * (len(names) > 8)}"


def _most_modes(model: ReductionScene, made: Mapping[str, StructuralReduction]) -> int:
    """Return the number of modes of the full structure in the comparison."""
    found = [max(each.modes, default=each.model.size) for each in made.values()]
    for part in [] if made else model.reduction:
        modes, masters = (getattr(part, key, None) for key in ("modes", "masters"))
        found += [max(modes)] if isinstance(modes, list) else [getattr(modes, "count", None) or 0]
        found += [len(masters)] if isinstance(masters, list) else [getattr(masters, "count", None) or 0]
    return max(found, default=0) or _UNKNOWN


def _cost(
    model: ReductionScene,
    structure: StructuralModel,
    seconds: dict[str, float],
    solver: str,
    sizes: list[int],
) -> CostEstimate:
    n = float(structure.size)
    one = (0.005 + (12 * _DENSE * n**3 if solver == "dense" else _SPARSE * n * (20 + max(sizes)))) / speed()
    parts = dict(seconds) or {f"reducing by {counted(len(sizes), 'method')}": one * len(sizes)}
    parts["modes of the full structure"] = one
    parts["comparison"] = (0.01 + 1e-7 * n * sum(size for size in sizes)) * len(sizes) / speed()
    values = n + sum(size * n + 5 * size**2 for size in sizes)
    if model.frequency is not None:
        lines = len(angular_frequencies(model.frequency))
        solved = 1e-9 * n**3 / 4 if n <= 1000 else 5e-6 * n
        parts["frequency responses"] = (0.02 + min(lines, 1000) * (1e-4 + solved)) / speed()
        values += 4 * lines * (1 + len(sizes))
    held = 8e-6 * (6 * n**2 if solver == "dense" else 60 * n)
    kilobytes = file_kilobytes(15 + 18 * len(sizes), values)
    return CostEstimate(parts, peak_megabytes() + held + 2e-3 * kilobytes, kilobytes)
