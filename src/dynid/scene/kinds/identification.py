"""Run a scene of kind `identification`."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

from dynid.errors import FileError
from dynid.result import Result
from dynid.scene.kinds.grids import angular_frequencies, build_signals, record_of
from dynid.scene.kinds.structures import build_structure, number
from dynid.scene.load import Scene
from dynid.scene.schema.identification import EstimatorModel, IdentificationScene
from dynid.structure.model import StructuralModel
from dynid.structure.response import Channel, Load, frequency_response, time_response

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from dynid.identification.estimate import Rebuild
    from dynid.identification.estimation import Estimator
    from dynid.identification.measurement import Measurement
    from dynid.lti.generator import Record
    from dynid.scene.kinds.reductions import LocatedReductor
    from dynid.scene.schema.common import SignalPart, TimeGrid


def run(scene: Scene) -> Result:
    """Identify the joints of a structure from a record, and compute the responses asked for.

    Where the structure is reduced, both are done with the reduced model. Responses are those with the
    joints as identified; without a record, unknown joints have their true values where these are given,
    else their starts.

    Raises
    ------
    NotIdentifiable, Diverged
        Where the record cannot tell the unknowns, or the estimator runs away.
    FileError
        Where measured data cannot be read.
    """
    model = cast("IdentificationScene", scene.model)
    structure = build_structure(scene, model.structure, model.joints)
    method = _reductor(model)
    result = Result("identification", scene.title)
    values = {unknown.name: unknown.true or unknown.start for unknown in structure.unknowns}
    if model.measurement is not None:
        result.merge(_identified(scene, model, structure, method))
        names = result["identification/parameters/name"].data
        values = dict(zip(names, result["identification/parameters/estimate"].data.tolist(), strict=True))
    if model.analysis is not None:
        responding = structure if method is None else method.at(values).reduce(structure).model
        result.merge(_responses(scene, model, responding, values))
    return result


def _identified(
    scene: Scene, model: IdentificationScene, structure: StructuralModel, method: LocatedReductor | None
) -> Result:
    """Identify with the reduced model where there is one; its basis may follow the joints."""
    from dynid.identification.estimate import identify

    measurement = _measurement(scene, model)
    loads = _loads(scene, "excitation", model.excitation, measurement.record)
    estimator = _estimator(model.estimator)
    if method is None:
        return identify(structure, loads, measurement, estimator)
    assert model.measurement is not None
    simulate = model.measurement.simulate
    truth = structure
    if simulate is not None and simulate.model == "reduced":
        truth = method.at(structure.true_values()).reduce(structure).model
    reduced = method.reduce(structure).model
    rebuild = _rebuilder(structure, method) if method.follows_joints else None
    return identify(reduced, loads, measurement, estimator, truth=truth, rebuild=rebuild)


def _estimator(given: EstimatorModel) -> Estimator:
    """Return the estimator that a scene names."""
    from dynid.identification.auto import Auto
    from dynid.identification.imbedding import InvariantImbedding
    from dynid.identification.output_error import OutputError
    from dynid.identification.passes import Filter

    kinds = (Auto, Filter, OutputError, InvariantImbedding)
    options: dict[str, Any] = given.options()
    estimator: Estimator = next(kind for kind in kinds if kind.name == given.method)(**options)
    return estimator


def _reductor(model: IdentificationScene) -> LocatedReductor | None:
    """Return the reduction of a scene, made for its sensors, loads and the band of its excitation."""
    if model.reduction is None:
        return None
    from dynid.scene.kinds.reductions import band_of, build_reductor
    from dynid.structure.reduction.selection import Interest

    dofs = [part.dof for part in model.excitation]
    band = None
    if model.measurement is not None:
        dofs += [channel.dof for channel in model.measurement.channels]
        band = band_of(model.excitation, float(model.measurement.step))
    if model.analysis is not None:
        dofs += [*(model.analysis.inputs or ()), *(output.dof for output in model.analysis.outputs or ())]
        if band is None and model.analysis.frequency is not None:
            band = float(angular_frequencies(model.analysis.frequency)[-1])
    interest = Interest(tuple(dict.fromkeys(dof for dof in dofs if dof is not None)), band)
    return build_reductor(model.reduction, interest, "reduction")


def _rebuilder(full: StructuralModel, method: LocatedReductor) -> Rebuild:
    return lambda values: method.at(values).reduce(full).model


def _loads(scene: Scene, where: str, parts: Sequence[SignalPart], record: Record) -> list[Load]:
    return [Load(part.dof or 0, signal) for part, signal in build_signals(scene, where, parts, record)]


def _measurement(scene: Scene, model: IdentificationScene) -> Measurement:
    from dynid.identification.measurement import Measurement, Simulation

    given = model.measurement
    assert given is not None
    channels = tuple(Channel(channel.dof, channel.quantity) for channel in given.channels)
    source: Simulation | NDArray[np.float64]
    if given.simulate is not None:
        simulate = given.simulate
        source = Simulation(number(simulate.noise_ratio), simulate.seed, number(simulate.settle))
    else:
        source = _measured(scene, model)
    return Measurement(float(given.step), given.samples, channels, source)


def _measured(scene: Scene, model: IdentificationScene) -> NDArray[np.float64]:
    from dynid.scene.kinds.tables import read_columns

    given = model.measurement
    assert given is not None
    assert given.file is not None
    path = scene.folder / given.file.path
    table = read_columns(path, given.file.columns, step=float(given.step), place="measurement.file")
    if table.shape[1] != len(given.channels):
        raise FileError(
            f"{path} has {table.shape[1]} columns of numbers, 'channels' has {len(given.channels)}",
            remedy="Name the columns: file: {path: …, columns: […]}.",
            names=("measurement.file.columns",),
        )
    if len(table) < given.samples:
        raise FileError(
            f"{path} has {len(table)} samples, but the scene asks for {given.samples}",
            names=("measurement.file.path",),
        )
    return table[: given.samples]


def _response_loads(scene: Scene, model: IdentificationScene, grid: TimeGrid, record: Record) -> list[Load]:
    """Return what drives a time response: its own input; nothing, with an initial motion; the excitation."""
    if grid.input or model.initial:
        return _loads(scene, "analysis.time.input", grid.input, record)
    return _loads(scene, "excitation", model.excitation, record)


def _responses(
    scene: Scene, model: IdentificationScene, structure: StructuralModel, values: Mapping[str, float]
) -> Result:
    """Compute the responses, by default at the sensors to the forces that excite the record.

    With an initial motion and no input of its own the time response is the free one.
    """
    wanted = model.analysis
    assert wanted is not None
    result = Result("identification", scene.title)
    sensors = model.measurement.channels if model.measurement else []
    outputs = [Channel(item.dof, item.quantity) for item in wanted.outputs or sensors]
    if wanted.modes is not None:
        from dynid.structure.description import modal_analysis

        asked = wanted.modes
        factor = 2 * math.pi if asked.unit == "Hz" else 1.0
        below = None if asked.below is None else factor * float(asked.below)
        result.merge(modal_analysis(structure, asked.count, below, values))
    if wanted.frequency is not None:
        inputs = list(dict.fromkeys(wanted.inputs or [part.dof or 0 for part in model.excitation]))
        omega = angular_frequencies(wanted.frequency)
        result.merge(frequency_response(structure, inputs, outputs, omega, values))
    if wanted.time is not None:
        record = record_of(wanted.time)
        result.merge(
            time_response(
                structure,
                _response_loads(scene, model, wanted.time, record),
                outputs,
                record.times,
                values=values,
                displacement={dof: number(motion.x) for dof, motion in model.initial.items()},
                velocity={dof: number(motion.v) for dof, motion in model.initial.items()},
            )
        )
    return result
