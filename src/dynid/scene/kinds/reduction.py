"""Run a scene of kind `reduction`."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from dynid.result import Result
from dynid.scene.kinds.grids import angular_frequencies
from dynid.scene.kinds.needs import tell_reduction
from dynid.scene.kinds.records import channel_of
from dynid.scene.kinds.reductions import LocatedReductor, build_reductor
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.reduction import ReductionScene, result_names
from dynid.structure.comparison import Responses, compare
from dynid.structure.reduction.selection import Interest
from dynid.structure.response import Channel

if TYPE_CHECKING:
    pass


def run(scene: Scene) -> Result:
    """Reduce the structure of a scene by each of its methods, and compare them with the full one.

    Raises
    ------
    Singular
        Where a method has no answer.
    UsageError
        Where masters or modes do not exist.
    """
    model = cast("ReductionScene", scene.model)
    structure = build_structure(scene, model.structure, model.joints)
    result = Result("reduction", scene.title)
    made = compare(structure, methods_of(model), responses=_responses(model), parts=model.substructures)
    result.merge(made)
    names = result_names([part.method for part in model.reduction])
    tell_reduction(
        result, model, {name: part.method for name, part in zip(names, model.reduction, strict=True)}
    )
    return result


def methods_of(model: ReductionScene) -> dict[str, LocatedReductor]:
    """Return the methods of a scene by their names in its result."""
    interest = interest_of(model)
    names = result_names([part.method for part in model.reduction])
    return {
        name: build_reductor(part, interest, f"reduction.{place}")
        for place, (name, part) in enumerate(zip(names, model.reduction, strict=True))
    }


def interest_of(model: ReductionScene) -> Interest:
    """Return what reduced models are for: the DOFs and the band of the responses."""
    if model.frequency is None:
        return Interest()
    asked = [*(model.inputs or ()), *(dof for output in model.outputs or () for dof in output.ends)]
    return Interest(tuple(dict.fromkeys(asked)), float(angular_frequencies(model.frequency)[-1]))


def _responses(model: ReductionScene) -> Responses | None:
    """Return the responses to compare; where it is not said which, receptances between the DOFs of interest.

    These are the ends of the joints and the masters that are given, else the structure's first DOF.
    """
    if model.frequency is None:
        return None
    ends = [dof for joint in model.joints.values() for dof in joint.dofs]
    masters = [getattr(part, "masters", None) for part in model.reduction]
    given = [dof for listed in masters if isinstance(listed, list) for dof in listed]
    dofs = list(dict.fromkeys([*ends, *given])) or [1]
    outputs = [channel_of(item) for item in model.outputs or ()]
    inputs = model.inputs or dofs[:1]
    return Responses(
        inputs,
        outputs or [Channel(dof, "displacement") for dof in dofs],
        angular_frequencies(model.frequency),
    )
