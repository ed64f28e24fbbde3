"""Run a scene of kind `reduction`."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from dynid.result import Result
from dynid.scene.kinds.grids import angular_frequencies
from dynid.scene.kinds.records import channel_of
from dynid.scene.kinds.reductions import build_reductor
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import Scene
from dynid.scene.schema.reduction import ReductionScene, result_names
from dynid.structure.comparison import Responses, compare
from dynid.structure.reduction.selection import Interest
from dynid.structure.response import Channel

if TYPE_CHECKING:
    from dynid.structure.matrices import Label


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
    responses = _responses(model)
    dofs: tuple[Label, ...] = ()
    band = None
    if responses is not None:
        asked = [*(model.inputs or ()), *(output.dof for output in model.outputs or ())]
        dofs, band = tuple(dict.fromkeys(asked)), float(responses.omega[-1])
    interest = Interest(dofs, band)
    names = result_names([part.method for part in model.reduction])
    methods = {
        name: build_reductor(part, interest, f"reduction.{place}")
        for place, (name, part) in enumerate(zip(names, model.reduction, strict=True))
    }
    result = Result("reduction", scene.title)
    result.merge(compare(structure, methods, responses=responses, parts=model.substructures))
    return result


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
