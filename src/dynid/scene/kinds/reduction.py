"""Scenes of kind `reduction`: runs, explanations, and the reduction methods of scenes of any kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from dynid import progress
from dynid.defaults import COMPARED_DOFS, DENSE_MODES, FEW_MODES, RESIDUALS
from dynid.errors import NumericalError, UsageError
from dynid.model_scope import wants_scope
from dynid.number_format import counted
from dynid.result import Result
from dynid.scene.explanation import Explanation, Fact, node_facts
from dynid.scene.kinds.measurements import channel_of, result_name
from dynid.scene.kinds.scope import add_geometry, add_reduction_scope
from dynid.scene.kinds.signals import angular_frequencies
from dynid.scene.kinds.structures import add_doubts, build_structure
from dynid.scene.kinds.time_scales import structure_time_scales
from dynid.scene.load import Scene
from dynid.scene.schema.base import Section
from dynid.scene.schema.reduction import (
    DynamicModel,
    JointAwareModel,
    MastersModel,
    ModesModel,
    ReductionModel,
    ReductionScene,
    result_names,
)
from dynid.structure.model import StructuralModel
from dynid.structure.modes.modes import solver_for
from dynid.structure.ports import Channel
from dynid.structure.reduction.masters import Masters
from dynid.structure.reduction.methods import (
    METHODS,
    PartReduction,
    ReductionByParts,
    Reductor,
    reduced_with_motions,
)
from dynid.structure.reduction.mode_selection import Interest, ModeRange
from dynid.structure.reduction.reduced_model import StructuralReduction
from dynid.structure.reduction.reduced_model import StructuralReduction as Reduced
from dynid.structure.reduction.serep import JointAware
from dynid.structure.reduction_comparison import COMPARISONS, RequestedResponses, compare
from dynid.units import angular_factor

if TYPE_CHECKING:
    from dynid.scene.run import PreparationStep


class LocatedReductor:
    """A method, whose errors name its place in the scene; `first` reduces the parts, once, before it."""

    def __init__(self, method: Reductor, path: str, first: LocatedReductor | None = None) -> None:
        self.method = method
        self.place = path
        self.first = first
        self._parts: tuple[StructuralModel, StructuralModel] | None = None

    def reduce(self, model: StructuralModel) -> Reduced:
        """Reduce a structure, as the method does."""
        if self.first is not None:
            model = self.first.of_parts(model)
        with _placed(self.place):
            if model.motions and not isinstance(self.method, ReductionByParts):
                return reduced_with_motions(self.method, model)
            return self.method.reduce(model)

    def of_parts(self, model: StructuralModel) -> StructuralModel:
        """Return the reduced model of a structure, which is kept for the next time."""
        if self._parts is None or self._parts[0] is not model:
            self._parts = (model, self.reduce(model).model)
        return self._parts[1]

    def at(self, values: Mapping[str, float]) -> LocatedReductor:
        """Return the method for these values of the joints, where its basis depends on them."""
        if isinstance(self.method, JointAware):
            return LocatedReductor(self.method.at(values), self.place, self.first)
        return self

    @property
    def follows_joints(self) -> bool:
        """True if the basis depends on the values of unknown joints."""
        return isinstance(self.method, JointAware)


def build_reductor(
    reduction: ReductionModel, interest: Interest, path: str, first: LocatedReductor | None = None
) -> LocatedReductor:
    """Build a reduction method from its part of a scene.

    `path` is its dotted path in the scene, `first` the reduction of the parts of an assembly before it.
    """
    with _placed(path):
        method = METHODS[reduction.method](**_options(reduction), interest=interest)
        return LocatedReductor(method, path, first)


def reductor_by_parts(parts: Mapping[str, ReductionModel | None], interest: Interest) -> LocatedReductor:
    """Return the reduction of an assembly part by part; a full part has none."""
    reductors = {
        name: None if reduction is None else PartReduction(reduction.method, _options(reduction))
        for name, reduction in parts.items()
    }
    return LocatedReductor(ReductionByParts(reductors, interest), "structures")


def _options(reduction: ReductionModel) -> dict[str, Any]:
    skipped = {"method", "unit"}
    chosen = {name: getattr(reduction, name) for name in type(reduction).model_fields if name not in skipped}
    options: dict[str, Any] = {name: value for name, value in chosen.items() if value is not None}
    for name, value in options.items():
        if value == "none":
            options[name] = ()
        elif isinstance(value, MastersModel):
            options[name] = Masters(value.count, value.choose)
        elif isinstance(value, ModesModel):
            below = None if value.below is None else angular_factor(value.unit) * float(value.below)
            options[name] = ModeRange(value.count, below)
    if isinstance(reduction, DynamicModel) and reduction.frequency is not None:
        options["frequency"] = angular_factor(reduction.unit) * float(reduction.frequency)
    return options


def with_residuals(reduction: ReductionModel) -> ReductionModel:
    """Return a reduction with residual vectors at the joints, where their choice is open."""
    if isinstance(reduction, JointAwareModel) and reduction.masters is None and reduction.residuals is None:
        return reduction.model_copy(update={"residuals": RESIDUALS.value})
    return reduction


def read_reduction(data: Mapping[str, Any]) -> ReductionModel:
    """Return the reduction that a part of a scene in plain data describes."""
    from pydantic import TypeAdapter

    from dynid.scene.schema import reduction

    reduction_model: ReductionModel = TypeAdapter(reduction.ReductionModel).validate_python(data)
    return reduction_model


@contextmanager
def _placed(path: str) -> Iterator[None]:
    """Name the place of the key that an error is about, else that of the reduction."""
    try:
        yield
    except (UsageError, NumericalError) as error:
        names = [f"{path}.{name}" for name in error.names]
        raise type(error)(error.problem, remedy=error.remedy, names=(*names, f"{path}.method")) from error


def run(scene: Scene[ReductionScene], sample: Result | None = None) -> Result:
    """Return the comparison of the reductions of a structure with the full one.

    Of the `sample` of a study only what it wants is computed. Raises `Singular` where a method has no unique
    solution. Raises `UsageError` where masters or modes do not exist.
    """
    model = scene.model
    structure = build_structure(scene, model.structure, model.joints)
    narrow = sample is not None and not (sample.wants_below("structure") or wants_scope(sample, "reduction"))
    result = sample if sample is not None and narrow else Result("reduction", scene.title)
    add_doubts(result, structure)
    compare(
        structure,
        methods_of(model),
        responses=responses_of(model, structure),
        parts=model.substructures,
        result=result,
        references=_references(model, structure, sample),
    )
    if narrow:
        return result
    add_geometry(result, model, structure)
    names = result_names([reduction.method for reduction in model.reduction])
    methods = (reduction.method for reduction in model.reduction)
    add_reduction_scope(result, model, dict(zip(names, methods, strict=True)))
    return result


def _references(model: ReductionScene, structure: StructuralModel, sample: Result | None) -> bool:
    """Return True if modes of the full structure are to be computed although no basis is made of them."""
    if model.compare is not None:
        return model.compare
    named = any(expectation.path.rpartition("/")[2] in COMPARISONS for expectation in model.expect)
    wanted = sample is not None and any(
        sample.wants(f"reduction/{name}/{array}") for name in methods_of(model) for array in COMPARISONS
    )
    return structure.size <= COMPARED_DOFS.value or named or wanted


def preparation_steps(scene: Scene[ReductionScene]) -> Iterator[PreparationStep]:
    """Yield the steps of a run before any computation: build the structure and the methods."""
    model = scene.model
    yield lambda: build_structure(scene, model.structure, model.joints)
    yield lambda: methods_of(model)


def methods_of(model: ReductionScene) -> dict[str, LocatedReductor]:
    """Return the methods of a scene by their names in its result."""
    interest = interest_of(model)
    names = result_names([reduction.method for reduction in model.reduction])
    return {
        name: build_reductor(reduction, interest, f"reduction.{index}")
        for index, (name, reduction) in enumerate(zip(names, model.reduction, strict=True))
    }


def interest_of(model: ReductionScene) -> Interest:
    """Return the DOFs and the band (rad/s) of the responses, for which reduced models are made."""
    if model.frequency is None:
        return Interest()
    asked = [*(model.inputs or ()), *(dof for output in model.outputs or () for dof in output.ends)]
    return Interest(tuple(dict.fromkeys(asked)), float(angular_frequencies(model.frequency)[-1]))


def responses_of(model: ReductionScene, structure: StructuralModel) -> RequestedResponses | None:
    """Return the responses to compare; by default receptances between the DOFs of interest.

    These are the ends of the joints and the masters that are given, else the structure's first DOF.
    """
    if model.frequency is None:
        return None
    ends = [dof for joint in model.joints.values() for dof in joint.dofs]
    masters = [getattr(reduction, "masters", None) for reduction in model.reduction]
    named = [dof for listed in masters if isinstance(listed, list) for dof in listed]
    dofs = list(dict.fromkeys([*ends, *named])) or [1]
    dofs = [result_name(structure, dof) for dof in dofs]
    outputs = [channel_of(item, structure) for item in model.outputs or ()]
    inputs = [result_name(structure, dof) for dof in model.inputs or ()] or dofs[:1]
    return RequestedResponses(
        inputs,
        outputs or [Channel(dof, "displacement", kind=structure.kind(dof)) for dof in dict.fromkeys(dofs)],
        angular_frequencies(model.frequency),
    )


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
    facts += [*node_facts(structure), *structure_time_scales(structure, {})]
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
