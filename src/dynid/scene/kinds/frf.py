"""From a scene's measurement to the frequency response functions that joints are identified from."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dynid.errors import FileError
from dynid.scene.kinds.grids import angular_frequencies
from dynid.scene.kinds.records import channel_of, levels

if TYPE_CHECKING:
    from dynid.identification.frf.measurement import Frf, FrfMeasurement
    from dynid.scene.kinds.frf_table import Responses
    from dynid.scene.load import Scene
    from dynid.scene.schema.measurement import FrfModel, MeasurementModel

_PLACE = "measurement.frf.file"


def frf_measurement(scene: Scene, given: MeasurementModel) -> FrfMeasurement:
    """Return the frequency response functions of a scene.

    Raises
    ------
    FileError
        Where measured responses cannot be read.
    UsageError
        Where they make no sense.
    """
    from dynid.identification.frf.measurement import Frf, FrfMeasurement
    from dynid.identification.measurement import Simulation

    assert given.frf is not None
    channels = tuple(
        Frf(channel_of(channel), channel.reference.dof)
        for channel in given.channels or ()
        if channel.reference
    )
    noise = levels(given.noise)
    simulate = given.frf.simulate
    if simulate is not None:
        added = levels(simulate.noise_ratio) or 0.0, simulate.seed, 0.0, levels(simulate.noise)
        return FrfMeasurement(angular_frequencies(simulate.lines), channels, Simulation(*added), noise)
    found = _in_band(_read(scene, given.frf, channels), given.frf)
    deviation, relative = found.deviation, False
    if found.coherence is not None:
        # Of the estimate H1 from n averages: J. S. Bendat, A. G. Piersol, Random Data, 4th ed. 2010, eq 9.57.
        averages = given.frf.file.averages if given.frf.file else None
        relative = averages is None
        spread = np.sqrt((1 - found.coherence) / found.coherence / (averages or 1))
        deviation = np.abs(found.values) * spread
    return FrfMeasurement(found.omega, channels, found.values, noise, deviation, relative)


def _read(scene: Scene, given: FrfModel, channels: tuple[Frf, ...]) -> Responses:
    """Read the file of a scene's responses: lines in rad/s, one column a channel."""
    from dynid.scene.kinds.frf_table import read_responses

    file = given.file
    assert file is not None
    path = scene.folder / file.path
    found = read_responses(path, file, _PLACE)
    for name, columns in found.columns.items():
        if columns.shape[1] != len(channels):
            key = name if name != "values" else "columns"
            raise FileError(
                f"{path} has {columns.shape[1]} frequency responses, 'channels' has {len(channels)}"
                if name == "values"
                else f"{path}: '{name}' names {columns.shape[1]} columns, 'channels' has {len(channels)}",
                remedy="Name one for each channel: frf: {file: {path: …, columns: […]}}.",
                names=(f"{_PLACE}.{key}", f"{_PLACE}.path"),
            )
    for number, (quantity, channel) in enumerate(zip(found.quantities, channels, strict=False), 1):
        if quantity and quantity != channel.channel.quantity:
            raise FileError(
                f"{path}: function {number} is {quantity} over force, but the channel {channel.name} is not",
                remedy=f"Write quantity: {quantity}.",
                names=("measurement.channels", f"{_PLACE}.path"),
            )
    unit = given.unit or ("Hz" if found.in_hertz else "rad/s")
    return found._replace(omega=found.omega * (2 * math.pi if unit == "Hz" else 1.0))


def _in_band(found: Responses, given: FrfModel) -> Responses:
    """Return the lines of a band."""
    if given.band is None:
        return found
    factor = 2 * math.pi if given.unit == "Hz" else 1.0
    low, high = (factor * float(edge) for edge in given.band)
    here = (found.omega >= low) & (found.omega <= high)
    if not here.any():
        raise FileError(
            f"no line lies in the band; they go from {found.omega[0] / factor:.6g} to "
            f"{found.omega[-1] / factor:.6g} {given.unit or 'rad/s'}",
            names=("measurement.frf.band",),
        )
    return found.at(here)
