"""Explanation of a comparison of reductions: the bases, and the solver of the modes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dynid import progress
from dynid.defaults import DENSE_MODES, FEW_MODES
from dynid.errors import NumericalError, UsageError
from dynid.number_format import counted
from dynid.result import Result
from dynid.scene.explanations.explanation import Explanation, Fact, node_facts
from dynid.scene.kinds.reduction import methods_of
from dynid.scene.kinds.signals import angular_frequencies
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.base import Section
from dynid.scene.schema.reduction import ReductionScene
from dynid.structure.modes.modes import solver_for
from dynid.structure.reduction.reduced_model import StructuralReduction

#: DOFs up to which bases are computed for an explanation; their modes take well under a second.
_MADE = DENSE_MODES.value
#: Modes where their number is not given.
_UNKNOWN = 20


def explain(scene: Scene[ReductionScene]) -> Explanation:
    """Return the explanation of a scene of kind `reduction`; the bases of small structures are computed."""
    model = scene.model
    structure = build_structure(scene, model.structure, model.joints)
    result = Result("reduction", scene.title)
    n = structure.size
    facts = [Fact("model", f"{counted(n, 'DOF')}, {counted(len(structure.joints), 'joint')}")]
    facts += node_facts(structure)
    bases: dict[str, StructuralReduction] = {}
    try:
        methods = methods_of(model)
        if n <= _MADE:
            for name in progress.tracked(list(methods), "reduction"):
                bases[name] = methods[name].reduce(structure)
        for index, name in enumerate(methods):
            said = [] if name in bases else _masters_and_modes(model.reduction[index])
            if basis := bases.get(name):
                said.append(counted(basis.model.size, "coordinate"))
                said += [f"masters {_listed(basis.masters)}"] if basis.masters else []
                if basis.modes:
                    rule = f" ({basis.rule})" if basis.rule else ""
                    said.append(counted(len(basis.modes), "mode") + rule)
                said += [f"condition {basis.condition:.2g}"] if basis.condition is not None else []
            facts.append(Fact("bases" if index == 0 else "", f"{name}: {'; '.join(said)}"))
        mode_count = _mode_count(model, bases)
        solver = solver_for(n, mode_count, None)
    except (NumericalError, UsageError) as error:
        return Explanation(result, facts, obstacle=error)
    if solver == "dense":
        solved = f"{f'the lowest {mode_count}' if n <= DENSE_MODES.value else 'all'}, by dense matrices"
    else:
        solved = f"the lowest {mode_count}, {FEW_MODES.sentence.format(value=FEW_MODES.value)} ({solver})"
    facts.append(Fact("modes", solved))
    if model.frequency is not None:
        lines = len(angular_frequencies(model.frequency))
        grid = counted(lines, "frequency")
        facts.append(Fact("responses", f"at {grid}, of the full structure and of each reduction"))
    return Explanation(result, facts)


def _masters_and_modes(reduction: Section) -> list[str]:
    said = []
    for key, value in ((key, getattr(reduction, key, None)) for key in ("masters", "modes")):
        if isinstance(value, Section):
            parts = value.model_dump(exclude_none=True, exclude_unset=True)
            said.append(f"{key} {', '.join(f'{name} {entry}' for name, entry in parts.items())}")
        elif value is not None:
            said.append(f"{key} {_listed(value)}")
    return said or ["chosen from joints and responses"]


def _listed(names: Sequence[object]) -> str:
    return f"{', '.join(map(str, names[:8]))}{', …' * (len(names) > 8)}"


def _mode_count(model: ReductionScene, bases: Mapping[str, StructuralReduction]) -> int:
    """Return the number of modes of the full structure in the comparison."""
    counts = [max(basis.modes, default=basis.model.size) for basis in bases.values()]
    for reduction in [] if bases else model.reduction:
        modes, masters = (getattr(reduction, key, None) for key in ("modes", "masters"))
        counts += [max(modes)] if isinstance(modes, list) else [getattr(modes, "count", None) or 0]
        counts += [len(masters)] if isinstance(masters, list) else [getattr(masters, "count", None) or 0]
    return max(counts, default=0) or _UNKNOWN
