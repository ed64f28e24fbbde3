"""The geometry of a scene's structure in its result, with the scene's sensors and loads."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dynid.scene.kinds.measurements import channel_of, shown
from dynid.structure.geometry import add_motion, add_places, geometry

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.measurement import ChannelModel
    from dynid.scene.schema.reduction import ReductionScene
    from dynid.structure.model import StructuralModel


#: Where a result has measured shapes.
_SHAPES = "identification/modes"


def dof_of(name: str) -> int | str:
    """Return the DOF that a name in a result means: a number, or a text."""
    return int(name) if name.isdecimal() else name


def add_geometry(
    result: Result,
    model: IdentificationScene | ReductionScene,
    structure: StructuralModel,
    reduced: StructuralModel | None = None,
) -> None:
    """Add the geometry of a structure whose nodes are known, and their motion in the modes of the result.

    Parameters
    ----------
    result
        The result, with its modes if any.
    model
        The scene.
    structure
        Its structure.
    reduced
        The reduced one, of which the modes are; absent: the structure.
    """
    if structure.nodes is None:
        return
    sensors: list[ChannelModel] = []
    if model.kind == "reduction":
        sensors += model.outputs or ()
        loads = [*(model.inputs or ())]
    else:
        loads = [part.dof for part in model.excitation if part.dof is not None]
        if model.measurement is not None:
            sensors += model.measurement.sensors
            records = model.measurement.each
            loads += [part.dof for one in records for part in one.excitation or () if part.dof is not None]
            loads += [one.reference.place for one in model.measurement.sensors if one.reference]
        if model.responses is not None:
            sensors += model.responses.outputs or ()
            loads += model.responses.inputs or ()
    named = {
        (channel_of(one, structure).name, shown(structure, end)): None for one in sensors for end in one.ends
    }
    acting = dict.fromkeys(shown(structure, dof) for dof in loads)
    parts = [model.structure, *(getattr(model, "structures", None) or {}).values()]
    imported = any(part is not None and part.matrices is not None for part in parts)
    result.merge(geometry(structure, named, acting, supports=not imported))
    if f"{_SHAPES}/sensor" in result:
        names = [str(name) for name in result[f"{_SHAPES}/sensor"].data]
        add_places(result, structure, "shape_sensor", ((name, dof_of(name)) for name in names))
    add_motion(result, structure if reduced is None else reduced)
