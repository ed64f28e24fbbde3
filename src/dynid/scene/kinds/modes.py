"""Measured modes of a scene: listed, or read from a file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dynid.errors import FileError, UsageError
from dynid.units import angular_factor

if TYPE_CHECKING:
    from pathlib import Path

    from dynid.files.modal_tables import ModalTable
    from dynid.identification.records.modal_measurement import Backbone, ModalMeasurement, Scatter
    from dynid.scene.load import Scene
    from dynid.scene.schema.modes import MeasuredModesModel, ScatterModel, SensorFileModel
    from dynid.structure.labels import Label

_PLACE = "measurement.modes"


def modal_measurement(scene: Scene, modes: MeasuredModesModel, place: Any = None) -> ModalMeasurement:
    """Return the measured modes of a scene, in SI units; `place`: the channel of their amplitudes, if any.

    Raises `FileError` where a file cannot be read, or does not say what its values are.
    """
    return _from_file(scene, modes, place) if modes.file is not None else _listed(modes, place)


def _listed(modes_model: MeasuredModesModel, place: Any) -> ModalMeasurement:
    import numpy as np

    factor, modes = angular_factor(modes_model.unit), modes_model.values
    dofs: list[Label] = list(dict.fromkeys(dof for mode in modes for dof in mode.shape))
    wide = any(isinstance(component, list) for mode in modes for component in mode.shape.values())
    shape = np.full((len(dofs), len(modes)), np.nan, dtype=complex if wide else float)
    std = np.full(shape.shape, np.nan)
    for k, mode in enumerate(modes):
        for dof, component in mode.shape.items():
            row = dofs.index(dof)
            shape[row, k] = (
                complex(*map(float, component)) if isinstance(component, list) else float(component)
            )
            deviation = mode.shape_std.get(dof) if isinstance(mode.shape_std, dict) else mode.shape_std
            std[row, k] = math.nan if deviation is None else float(deviation)

    def each(key: str, scale: float = 1.0) -> Any:
        values = [getattr(mode, key) for mode in modes]
        return np.array([math.nan if value is None else scale * float(value) for value in values])

    return _measured(
        modes_model,
        each("frequency", factor),
        dofs,
        shape if dofs else None,
        each("damping"),
        each("frequency_std", factor),
        each("damping_std"),
        std if dofs else None,
        modes_model.unit or "rad/s",
        backbone=_backbone(each("amplitude"), each("mode"), place),
    )


def _backbone(amplitude: Any, mode: Any, place: Any) -> Backbone | None:
    """Return the amplitudes at which modes were measured (r), and the numbers of their modes, if any."""
    if place is None:
        return None
    import numpy as np

    from dynid.identification.records.modal_measurement import Backbone

    number = np.full(len(amplitude), math.nan) if mode is None else mode
    return Backbone(place, amplitude, number - 1)


def _from_file(scene: Scene, modes: MeasuredModesModel, place: Any) -> ModalMeasurement:
    import numpy as np

    from dynid.files.read_measured import read_modes

    assert modes.file is not None
    path_of_file = f"{_PLACE}.file"
    path = scene.folder / modes.file.path
    survey = read_modes(path, modes.file.names, path_of_file)
    if survey.covariance is not None and modes.floor.model_fields_set:
        raise UsageError(
            f"{path} has the covariance of its modes, to which no floor is added",
            remedy="Leave 'floor' out; 'model_error' is added.",
            names=(f"{_PLACE}.floor",),
        )
    _check_amplitudes(path, survey, modes)
    dofs = list(survey.dofs) if modes.sensors is None else _sensors(scene, modes.sensors)
    rows = 0 if survey.shape is None else len(survey.shape)
    if len(dofs) != rows:
        raise FileError(
            f"{path} has shapes at {rows} sensors, and {len(dofs)} DOFs are named"
            if dofs
            else f"{path} does not name the DOFs of its {rows} sensors",
            remedy="Name one DOF for each row: modes: {sensors: […]}.",
            names=(
                f"{_PLACE}.sensors" if modes.sensors is not None else f"{path_of_file}.path",
                path_of_file,
            ),
        )
    keep = np.arange(len(survey.frequency))
    if modes.file.modes is not None:
        keep = np.array(modes.file.modes) - 1
        if keep.max() >= len(survey.frequency):
            said = f"{path} has {len(survey.frequency)} modes, but mode {keep.max() + 1} is asked for"
            raise FileError(said, names=(f"{path_of_file}.modes",))
    unit = modes.unit or survey.unit or "rad/s"
    stated = survey.unit or unit  # of the values in the file
    factor = angular_factor(stated)

    def own(values: Any, scale: float = 1.0) -> Any:
        return None if values is None else scale * np.asarray(values)[..., keep]

    return _measured(
        modes,
        own(survey.frequency, factor),
        dofs,
        own(survey.shape),
        own(survey.damping),
        own(survey.frequency_std, factor),
        own(survey.damping_std),
        own(survey.shape_std),
        unit,
        covariance=None
        if survey.covariance is None
        else _kept(survey.covariance, len(survey.frequency), keep),
        absolute=survey.absolute,
        backbone=_backbone(own(survey.amplitude), own(survey.mode), place),
    )


def _check_amplitudes(path: Path, survey: ModalTable, modes: MeasuredModesModel) -> None:
    """Refuse a file with amplitudes of a motion that the scene does not name, or the reverse."""
    of = modes.amplitude_of
    if of is None:
        if survey.amplitude is not None:
            raise FileError(
                f"{path} has modes at amplitudes",
                remedy="Say of which motion: modes: {amplitude_of: {dof: …, quantity: …}}.",
                names=(f"{_PLACE}.file",),
            )
        return
    place = (f"{_PLACE}.amplitude_of",)
    if survey.amplitude is None or survey.shape is not None:
        what = (
            "no column 'amplitude'" if survey.amplitude is None else "shapes, which modes at amplitudes lack"
        )
        raise FileError(f"{path} has {what}", remedy="Name the columns under 'file'.", names=place)
    from dynid.structure.ports import motion_units

    unit = survey.amplitude_unit
    if unit and unit not in motion_units(of.quantity):
        raise FileError(
            f"{path} has amplitudes in {unit}, but 'amplitude_of' is a {of.quantity}",
            remedy="Correct the 'quantity', or the heading.",
            names=place,
        )


def _kept(covariance: Any, modes: int, keep: Any) -> Any:
    """Return the covariance of some of the modes; values stand mode by mode within each quantity."""
    import numpy as np

    rows = (modes * np.arange(len(covariance) // modes)[:, None] + keep).ravel()
    return covariance[np.ix_(rows, rows)]


def _sensors(scene: Scene, sensors: list[Label] | SensorFileModel) -> list[Label]:
    """Return the DOFs of sensors, listed or in a file of their own."""
    if isinstance(sensors, list):
        return list(sensors)
    from dynid.files.matlab import whole_numbers
    from dynid.files.table import DataFile

    file = DataFile(scene.folder / sensors.path, f"{_PLACE}.sensors")
    file.check()
    return list(whole_numbers(file, sensors.name, "name"))


def _measured(
    modes: MeasuredModesModel,
    omega: Any,
    dofs: Sequence[Label],
    *rest: Any,
    covariance: Any = None,
    **further: Any,
) -> ModalMeasurement:
    """Return measured modes with the floors (without a covariance) and model errors of the scene."""
    from dynid.identification.records.modal_measurement import FLOORS, NO_ERROR, ModalMeasurement

    shape, damping, omega_std, damping_std, shape_std, unit = rest
    try:
        return ModalMeasurement(
            omega,
            tuple(dofs),
            shape,
            damping,
            omega_std,
            damping_std,
            shape_std,
            floors=_scatter(modes.floor, FLOORS) if covariance is None else NO_ERROR,
            model_error=_scatter(modes.model_error, NO_ERROR),
            covariance=covariance,
            unit=unit,
            **further,
        )
    except UsageError as error:
        raise UsageError(error.problem, remedy=error.remedy, names=(_PLACE,)) from error


def _scatter(scatter: ScatterModel, usual: Scatter) -> Scatter:
    values = {key: getattr(scatter, key) for key in scatter.model_fields_set}
    stated = {key: float(value) for key, value in values.items() if value is not None}
    return usual._replace(**stated)
