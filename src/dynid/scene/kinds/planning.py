"""Plans of the measurement of a scene: its sensors and excitation."""

from __future__ import annotations

import math
from typing import cast

from dynid.errors import UsageError
from dynid.identification.planning.plan import PlanRequest, plan
from dynid.result import Result
from dynid.scene.kinds.identification import expected_values, setting, structure_of
from dynid.scene.kinds.measurements import channel_of
from dynid.scene.load import Scene
from dynid.scene.schema.identification import IdentificationScene
from dynid.structure.response import UNITS


def run_plan(scene: Scene, sensors: int | None = None, lines: int | None = None) -> Result:
    """Return ranked sensors and excitations for a scene of kind identification.

    Parameters
    ----------
    scene
        The scene.
    sensors, lines
        The numbers to choose; absent: those of the scene, else as many as it has.

    Raises
    ------
    UsageError
        Where the scene has nothing to identify, or no measurement.
    NotIdentifiable, NumericalError, FileError
        As of a run, except for parameters that the present measurement does not determine.
    """
    if scene.kind != "identification":
        raise UsageError(
            f"there is nothing to plan in a scene of kind {scene.kind}",
            remedy="A plan is for scenes of kind identification.",
            names=("kind",),
        )
    model = cast("IdentificationScene", scene.model)
    if model.measurement is None:
        raise UsageError(
            "there is no measurement to plan",
            remedy="Add the block 'measurement' with step, samples and channels.",
            names=("kind",),
        )
    if model.measurement.frf is not None:
        raise UsageError(
            "a plan is for a record of time; this measurement is of frequency responses",
            remedy="Give step, samples and channels of a record that could be taken instead of 'frf'.",
            names=("measurement.frf",),
        )
    structure = structure_of(scene)
    reduced, records, truth = setting(scene, structure, expected_values(structure))
    given, force = model.plan, model.plan.excitation
    factor = 2 * math.pi if force.unit == "Hz" else 1.0
    request = PlanRequest(
        sensors=sensors or given.sensors,
        lines=lines or given.lines,
        candidates=[channel_of(channel) for channel in given.candidates or ()],
        quantities=given.quantities or tuple(UNITS),
        noise={quantity: float(level) for quantity, level in given.noise.items()},
        dofs=force.dofs or (),
        band=(factor * float(force.band[0]), factor * float(force.band[1])) if force.band else None,
    )
    result = plan(reduced, records, request, truth)
    result.title = scene.title
    result.attrs["scene"] = scene.source.resolved_text()
    return result
