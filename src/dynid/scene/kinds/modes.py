"""Measured modes of a scene: listed, or read from a file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from dynid.errors import FileError, UsageError
from dynid.units import angular_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dynid.identification.records.modal_measurement import ModalMeasurement, Scatter
    from dynid.scene.load import Scene
    from dynid.scene.schema.modes import MeasuredModesModel, ScatterModel
    from dynid.structure.labels import Label

_PLACE = "measurement.modes"


def modal_measurement(scene: Scene, given: MeasuredModesModel) -> ModalMeasurement:
    """Return the measured modes of a scene, in SI units.

    Raises
    ------
    FileError
        Where a file cannot be read, or does not say what its values are.
    """
    return _from_file(scene, given) if given.file is not None else _listed(given)


def _listed(given: MeasuredModesModel) -> ModalMeasurement:
    """Return modes that the scene lists."""
    import numpy as np

    factor, modes = angular_factor(given.unit), given.values
    dofs: list[Label] = list(dict.fromkeys(dof for mode in modes for dof in mode.shape))
    wide = any(isinstance(part, list) for mode in modes for part in mode.shape.values())
    shape = np.full((len(dofs), len(modes)), np.nan, dtype=complex if wide else float)
    std = np.full(shape.shape, np.nan)
    for k, mode in enumerate(modes):
        for dof, part in mode.shape.items():
            row = dofs.index(dof)
            shape[row, k] = complex(*map(float, part)) if isinstance(part, list) else float(part)
            deviation = mode.shape_std.get(dof) if isinstance(mode.shape_std, dict) else mode.shape_std
            std[row, k] = math.nan if deviation is None else float(deviation)

    def each(key: str, scale: float = 1.0) -> Any:
        values = [getattr(mode, key) for mode in modes]
        return np.array([math.nan if one is None else scale * float(one) for one in values])

    return _measured(
        given,
        each("frequency", factor),
        dofs,
        shape if dofs else None,
        each("damping"),
        each("frequency_std", factor),
        each("damping_std"),
        std if dofs else None,
        given.unit or "rad/s",
    )


def _from_file(scene: Scene, given: MeasuredModesModel) -> ModalMeasurement:
    """Return the modes in a file."""
    import numpy as np

    from dynid.files.read_measured import read_modes

    assert given.file is not None
    place = f"{_PLACE}.file"
    path = scene.folder / given.file.path
    found = read_modes(path, given.file.names, place)
    dofs = list(found.dofs) or _sensors(scene, given)
    rows = 0 if found.shape is None else len(found.shape)
    if given.sensors is not None and not isinstance(given.sensors, list):
        dofs = _sensors(scene, given)
    elif given.sensors is not None:
        dofs = list(given.sensors)
    if len(dofs) != rows:
        raise FileError(
            f"{path} has shapes at {rows} sensors, and {len(dofs)} DOFs are named"
            if dofs
            else f"{path} does not name the DOFs of its {rows} sensors",
            remedy="Name one DOF for each row: modes: {sensors: […]}.",
            names=(f"{_PLACE}.sensors" if given.sensors is not None else f"{place}.path", place),
        )
    keep = np.arange(len(found.frequency))
    if given.file.modes is not None:
        keep = np.array(given.file.modes) - 1
        if keep.max() >= len(found.frequency):
            raise FileError(
                f"{path} has {len(found.frequency)} modes, but mode {keep.max() + 1} is asked for",
                names=(f"{place}.modes",),
            )
    unit = given.unit or found.unit or "rad/s"
    stated = found.unit or unit  # of the values in the file
    factor = angular_factor(stated)

    def own(values: Any, scale: float = 1.0) -> Any:
        return None if values is None else scale * np.asarray(values)[..., keep]

    return _measured(
        given,
        own(found.frequency, factor),
        dofs,
        own(found.shape),
        own(found.damping),
        own(found.frequency_std, factor),
        own(found.damping_std),
        own(found.shape_std),
        unit,
    )


def _sensors(scene: Scene, given: MeasuredModesModel) -> list[Label]:
    """Return the DOFs of the sensors in a file of their own."""
    from dynid.scene.schema.modes import SensorFileModel

    if not isinstance(given.sensors, SensorFileModel):
        return []
    from dynid.files.matlab import whole_numbers
    from dynid.files.table import DataFile

    file = DataFile(scene.folder / given.sensors.path, f"{_PLACE}.sensors")
    file.check()
    return list(whole_numbers(file, given.sensors.name, "name"))


def _measured(given: MeasuredModesModel, omega: Any, dofs: Sequence[Label], *rest: Any) -> ModalMeasurement:
    """Return measured modes with the floors and model errors of the scene."""
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
            floors=_scatter(given.floor, FLOORS),
            model_error=_scatter(given.model_error, NO_ERROR),
            unit=unit,
        )
    except UsageError as error:
        raise UsageError(error.problem, remedy=error.remedy, names=(_PLACE,)) from error


def _scatter(given: ScatterModel, usual: Scatter) -> Scatter:
    own = {
        key: float(getattr(given, key)) for key in given.model_fields_set if getattr(given, key) is not None
    }
    return usual._replace(**own)
