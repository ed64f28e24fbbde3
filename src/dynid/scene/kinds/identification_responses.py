"""The responses of a structure that a scene of kind `identification` asks for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

from dynid.progress import tell
from dynid.result import Result
from dynid.scene.kinds.grids import angular_frequencies, record_of
from dynid.scene.kinds.records import channel_of, initial_motion, loads_of
from dynid.scene.load import Scene
from dynid.scene.schema.identification import IdentificationScene, ResponseModes
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel, Load, frequency_response, time_response

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dynid.lti.generator import Record
    from dynid.scene.schema.common import Dof, TimeGrid


#: What is said of a time response where the scene has an excitation that does not drive it.
_FREE = (
    "the free response to the initial motion; the excitation is the record's, and a response that it drives "
    "names it under time: input"
)


def _response_loads(scene: Scene, model: IdentificationScene, grid: TimeGrid, record: Record) -> list[Load]:
    """Return what drives a time response: its own input; nothing, with an initial motion; the excitation."""
    if grid.input or model.initial:
        return loads_of(scene, "analysis.time.input", grid.input, record)
    return loads_of(scene, "excitation", model.excitation, record)


def responses(
    scene: Scene, model: IdentificationScene, structure: StructuralModel, values: Mapping[str, float]
) -> Result:
    """Compute the responses, by default at the sensors to the forces that excite the record.

    With an initial motion and no input of its own the time response is the free one.
    """
    wanted = model.analysis
    assert wanted is not None
    result = Result("identification", scene.title)
    if wanted.modes is not None:
        from dynid.structure.description import modal_analysis

        tell("modes")
        result.merge(modal_analysis(structure, *which_modes(wanted.modes), values))
    if wanted.frequency is not None:
        driven = [part.dof for part in model.excitation if part.dof is not None and part.motion is None]
        driven += _forced(model)
        inputs = list(dict.fromkeys(wanted.inputs or driven))
        omega = angular_frequencies(wanted.frequency)
        tell("frequency response")
        result.merge(frequency_response(structure, inputs, _outputs(model), omega, values))
    if wanted.time is not None:
        tell("time response")
        result.merge(time_response(structure, values=values, **time_question(scene)))
        if model.initial and model.excitation and not wanted.time.input:
            result.annotate("structure/time_response", note=_FREE)
    return result


def time_question(scene: Scene) -> dict[str, Any]:
    """Return the loads, outputs, times and first motion of the time response that a scene asks for."""
    model = cast("IdentificationScene", scene.model)
    wanted = model.analysis
    assert wanted is not None
    assert wanted.time is not None
    record = record_of(wanted.time)
    return {
        "loads": _response_loads(scene, model, wanted.time, record),
        "outputs": _outputs(model),
        "times": record.times,
        **initial_motion(model),
    }


def which_modes(asked: ResponseModes) -> tuple[int | None, float | None]:
    """Return how many modes are asked for, and below what frequency, rad/s."""
    factor = 2 * math.pi if asked.unit == "Hz" else 1.0
    return asked.count, None if asked.below is None else factor * float(asked.below)


def _outputs(model: IdentificationScene) -> list[Channel]:
    """Return what responses show: what is named, else what the sensors measure."""
    sensors = model.measurement.sensors if model.measurement else []
    shown = [channel_of(item) for item in (model.analysis and model.analysis.outputs) or sensors]
    return list(dict.fromkeys(shown))


def _forced(model: IdentificationScene) -> list[Dof]:
    """Return the DOFs at which frequency response functions were measured with a force."""
    sensors = model.measurement.sensors if model.measurement else []
    return [channel.reference.dof for channel in sensors if channel.reference]
