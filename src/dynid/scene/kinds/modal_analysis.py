"""Scenes of kind `modal-analysis`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import UsageError
from dynid.modal.frf_matrix import FrfMatrix, smoothed_variance
from dynid.result import Result
from dynid.scene.kinds.measurements import frf_measurement
from dynid.scene.load import Scene
from dynid.structure.labels import unsigned
from dynid.suggestions import shortened
from dynid.units import angular_factor

if TYPE_CHECKING:
    from dynid.identification.records.frf_measurement import FrfMeasurement
    from dynid.scene.run import PreparationStep
    from dynid.scene.schema.modal_analysis import ModalAnalysisScene
    from dynid.structure.labels import Label


class ModalTest(NamedTuple):
    """Frequency responses of a test, and the DOFs they are of."""

    frf: FrfMatrix
    channels: list[str]  # DOFs of the responses
    references: list[str]  # DOFs of the forces
    powers: ComplexArray  # factors from receptances to what was measured (lines x channels)
    proportional: bool = False
    notes: tuple[str, ...] = ()

    @property
    def driving_points(self) -> list[tuple[int, int]]:
        """Response and reference of each DOF that is both."""
        pairs = (
            (o, i)
            for i, force in enumerate(self.references)
            for o, dof in enumerate(self.channels)
            if dof == force
        )
        return list(pairs)


def run(scene: Scene[ModalAnalysisScene], sample: Result | None = None) -> Result:
    """Return the modes that the responses of a scene show in its band.

    Raises `NumericalError` where there are none. Raises `FileError` or `UsageError` where the measurement
    cannot be read, or does not have all responses to all references.
    """
    from dynid.modal.modal_analysis import analyse
    from dynid.modal.write_result import add_modes

    test, options = modal_test(scene), scene.model.modes
    analysis = analyse(
        test.frf,
        test.driving_points,
        real=options.shapes == "real",
        reciprocal=options.reciprocal,
        proportional=test.proportional,
    )
    result = sample if sample is not None else Result("modal-analysis", scene.title)
    add_modes(result, analysis, test.channels, test.references, test.powers, test.notes)
    return result


def preparation_steps(scene: Scene[ModalAnalysisScene]) -> Iterator[PreparationStep]:
    """Yield the step of a run before the analysis: read the measurement."""
    yield lambda: modal_test(scene)


def modal_test(scene: Scene[ModalAnalysisScene]) -> ModalTest:
    """Return the frequency responses of a scene in its band."""
    measurement = scene.model.measurement
    if measurement.frf is None:
        raise UsageError("records of time are not read yet", names=("measurement",))
    return _matrix_of(scene, frf_measurement(scene, measurement))


def _matrix_of(scene: Scene[ModalAnalysisScene], measured: FrfMeasurement) -> ModalTest:
    """Return responses, one column a pair, as a matrix of receptances in the band."""
    used = in_band(scene, measured.omega)
    omega, values = measured.omega[used], np.asarray(measured.source)[used]
    deviation, known = _deviation(scene, measured, values)
    responses, references, at = _pairs(measured)
    shape = (len(omega), len(responses), len(references))
    matrix, noise, scale = np.full(shape, np.nan, dtype=complex), np.full(shape, np.nan), np.ones(shape[1:])
    powers = np.ones(shape[:2], dtype=complex)
    for column, (frf, (o, i, sign)) in enumerate(zip(measured.channels, at, strict=True)):
        power = (1j * omega) ** frf.channel.order
        powers[:, o] = power
        factor = sign * power * _instrument(frf.channel, omega)
        matrix[:, o, i] = values[:, column] / factor
        noise[:, o, i] = deviation[:, column] / np.abs(factor)
        scale[o, i] = known[column]
    estimated = bool(np.isnan(scale).any())
    shaped = measured.proportional or measured.deviation is not None
    frf_matrix = FrfMatrix(omega, matrix, noise, np.where(np.isnan(scale), 1.0, scale), estimated, shaped)
    return ModalTest(frf_matrix, responses, references, powers, measured.proportional, measured.notes)


def in_band(scene: Scene[ModalAnalysisScene], omega: Array) -> Any:
    """Return the lines in the band of a scene, above 0.

    Raises `UsageError` where there are none.
    """
    band = scene.model.band
    factor = angular_factor(band.unit)
    used = (omega >= factor * float(band.low)) & (omega <= factor * float(band.high)) & (omega > 0)
    if not used.any():
        span = f"{omega[0] / factor:.6g} to {omega[-1] / factor:.6g} {band.unit}"
        raise UsageError(f"no line lies in the band; they go from {span}", names=("band",))
    return used


def _deviation(
    scene: Scene[ModalAnalysisScene], measured: FrfMeasurement, values: ComplexArray
) -> tuple[Array, Array]:
    """Return deviations of the noise by line, and the factor of each column, NaN where it is unknown."""
    columns = values.shape[1]
    noise = np.full(columns, np.nan) if measured.given_noise is None else np.asarray(measured.given_noise)
    if measured.proportional:
        return np.abs(values), noise
    if measured.deviation is None:
        return np.ones(values.shape), noise
    deviation = measured.profile[in_band(scene, measured.omega)]
    file = scene.model.measurement.frf and scene.model.measurement.frf.file
    if file and file.coherence is not None:
        deviation = np.sqrt(smoothed_variance(deviation**2, values))
    return deviation, noise


def _pairs(measured: FrfMeasurement) -> tuple[list[str], list[str], list[tuple[int, int, float]]]:
    """Return DOFs of responses and references, and row, column and sign of each function.

    Raises `UsageError` where a pair is missing, or measured twice.
    """
    ends = [(_dof(frf.channel.dof), _dof(frf.force)) for frf in measured.channels]
    responses = list(dict.fromkeys(response for (response, _), _ in ends))
    references = list(dict.fromkeys(force for _, (force, _) in ends))
    at = [(responses.index(o), references.index(i), a * b) for (o, a), (i, b) in ends]
    if len({pair[:2] for pair in at}) < len(at):
        raise UsageError(
            "a response is measured twice: by two quantities, or in two directions of one DOF",
            remedy="List one of them.",
            names=("measurement.channels",),
        )
    missing = [
        f"{response}/{force}"
        for o, response in enumerate(responses)
        for i, force in enumerate(references)
        if (o, i) not in {pair[:2] for pair in at}
    ]
    if missing:
        raise UsageError(
            f"responses to some references are missing: {shortened(missing, 6)}",
            remedy="A modal analysis needs all channels at every reference; leave the others out.",
            names=("measurement.channels",),
        )
    return responses, references, at


def _dof(label: Label) -> tuple[str, float]:
    """Return the name of a DOF without its sign, and the sign."""
    name = unsigned(label)
    return str(name).replace(":+", ":"), 1.0 if name == label or ":+" in str(label) else -1.0


def _instrument(channel: Any, omega: Array) -> ComplexArray:
    """Return the response of a channel's gain and delay."""
    return np.asarray(float(channel.gain) * np.exp(-1j * omega * float(channel.delay)))
