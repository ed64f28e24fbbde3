"""Scenes of kind `modal-analysis`: their runs and explanations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dynid.arrays import Array, ComplexArray
from dynid.errors import NumericalError, UsageError
from dynid.modal.frf_matrix import FrfMatrix, smoothed_variance
from dynid.number_format import counted
from dynid.result import Result
from dynid.scene.explanation import Explanation, Fact
from dynid.scene.kinds.measurements import experiments, frf_measurement
from dynid.scene.load import Scene
from dynid.scene.schema.modal_analysis import ModalAnalysisScene
from dynid.structure.labels import unsigned
from dynid.suggestions import shortened
from dynid.units import angular_factor

_TWICE = "a response is measured twice: by two quantities, or in two directions of one DOF"
# Upper end of the band over the sampling rate to which records without excitation are decimated: the corner
# of the filter.
_DECIMATED_BAND = 0.4

if TYPE_CHECKING:
    from dynid.identification.records.frf_measurement import FrfMeasurement
    from dynid.scene.run import PreparationStep
    from dynid.structure.labels import Label


class _ModalTest(NamedTuple):
    """Frequency responses of a test, and the DOFs they are of."""

    frf: FrfMatrix
    channels: list[str]  # DOFs of the responses
    references: list[str]  # DOFs of the forces
    powers: ComplexArray  # factors from receptances to what was measured (lines x channels)
    proportional: bool = False
    resolution: float = 0.0  # distance of the lines of random records, Hz
    duration: float = np.inf  # of decays after impacts, s
    notes: tuple[str, ...] = ()
    cut_off: tuple[str, ...] = ()  # records that end before their decay

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
    from dynid.modal.write_result import add_analysis

    if scene.model.output_only:
        return _run_of_outputs(scene, sample)
    test, options = _modal_test(scene), scene.model.modes
    analysis = analyse(
        test.frf,
        test.driving_points,
        real=options.shapes == "real",
        reciprocal=options.reciprocal,
        proportional=test.proportional,
        window_rate=window_rate(scene),
        resolution=test.resolution,
        duration=test.duration,
    )
    result = sample if sample is not None else Result("modal-analysis", scene.title)
    notes = [*test.notes]
    if test.cut_off and analysis.bar_scale > 1:  # else the decays are short beside their noise
        end = "state 'exponential'" if scene.model.exponential is None else "shorten 'exponential'"
        notes.append(f"not decayed at the end: {shortened(test.cut_off)}; record longer, or {end}")
    add_analysis(result, analysis, test.channels, test.references, test.powers, notes)
    return result


def preparation_steps(scene: Scene[ModalAnalysisScene]) -> Iterator[PreparationStep]:
    """Yield the step of a run before the analysis: read the measurement."""
    yield lambda: _outputs(scene) if scene.model.output_only else _modal_test(scene)


class _Outputs(NamedTuple):
    """Responses without their excitation, and the DOFs they are of."""

    records: list[Array]
    step: float
    channels: list[str]
    instrument: Callable[[complex], ComplexArray]
    factor: int  # by which they were decimated
    notes: tuple[str, ...]


def _run_of_outputs(scene: Scene[ModalAnalysisScene], sample: Result | None) -> Result:
    from dynid.modal.subspace import analyse_outputs
    from dynid.modal.write_result import add_output_analysis

    outputs, band = _outputs(scene), scene.model.band
    factor = angular_factor(band.unit)
    ends = factor * float(band.low), factor * float(band.high)
    analysis = analyse_outputs(outputs.records, outputs.step, ends, outputs.instrument)
    result = sample if sample is not None else Result("modal-analysis", scene.title)
    add_output_analysis(result, analysis, outputs.channels, outputs.notes)
    return result


def _outputs(scene: Scene[ModalAnalysisScene]) -> _Outputs:
    """Return the records of a scene without excitation, decimated to its band."""
    from dynid.identification.records.preparation import Decimate, prepare

    band = scene.model.band
    high = angular_factor(band.unit) * float(band.high)
    measured = experiments(scene, [], scene.model.measurement)
    step, channels = measured[0].measurement.step, measured[0].measurement.channels
    names, signs = zip(*(_dof(channel.dof) for channel in channels), strict=True)
    if len(set(names)) < len(names):
        raise UsageError(_TWICE, remedy="List one of them.", names=("measurement.channels",))
    if high * step >= np.pi:
        nyquist = np.pi / (step * angular_factor(band.unit))
        raise UsageError(
            f"the band ends above half the sampling rate, {nyquist:.6g} {band.unit}", names=("band",)
        )
    for number, (_, measurement) in enumerate(measured, 1):
        if measurement.step != step or measurement.channels != channels:
            raise UsageError(
                f"record {number} has another step or other channels than the first",
                remedy="Responses to ambient excitation have a scale of their own in each set-up: analyse "
                "them apart.",
                names=("measurement.records",),
            )
        _check_complete(np.asarray(measurement.source), number)
    factor = max(1, int(_DECIMATED_BAND * 2 * np.pi / (high * step)))
    if factor > 1:
        measured = [prepare(experiment, [Decimate(factor)]) for experiment in measured]

    def instrument(s: complex) -> ComplexArray:
        at = np.array([s])
        factors = (
            sign * _instrument(channel, at)[0] * s**channel.order
            for channel, sign in zip(channels, signs, strict=True)
        )
        return np.array([*factors])

    return _Outputs(
        [np.asarray(experiment.measurement.source) for experiment in measured],
        step * factor,
        list(names),
        instrument,
        factor,
        tuple(note for experiment in measured for note in experiment.measurement.notes),
    )


def _check_complete(values: Array, number: int) -> None:
    """Refuse a record with missing samples."""
    if np.isnan(values).any():
        raise UsageError(
            f"record {number} has missing samples, which spectra and correlations would spread",
            remedy="Take a stretch without any.",
            names=("measurement.records", "measurement"),
        )


def _modal_test(scene: Scene[ModalAnalysisScene]) -> _ModalTest:
    """Return the frequency responses of a scene in its band."""
    measurement = scene.model.measurement
    if measurement.frf is None:
        return _test_of_records(scene)
    return _matrix_of(scene, frf_measurement(scene, measurement))


def window_rate(scene: Scene[ModalAnalysisScene]) -> float:
    """Return the decay rate (1/s) that an exponential window adds; 0 without one."""
    exponential = scene.model.exponential
    return 0.0 if exponential is None else 1 / float(exponential)


def _matrix_of(scene: Scene[ModalAnalysisScene], measured: FrfMeasurement) -> _ModalTest:
    """Return responses, one column a pair, as a matrix of receptances in the band."""
    used = in_band(scene, measured.omega)
    omega, values = measured.omega[used], np.asarray(measured.source)[used]
    deviation, known = _deviation(scene, measured, values)
    responses, references, at = _pairs(measured)
    shape = (len(omega), len(responses), len(references))
    matrix, noise, scale = np.full(shape, np.nan, dtype=complex), np.full(shape, np.nan), np.ones(shape[1:])
    powers = np.ones(shape[:2], dtype=complex)
    for column, (frf, (o, i, sign)) in enumerate(zip(measured.channels, at, strict=True)):
        power = (1j * omega + window_rate(scene)) ** frf.channel.order
        powers[:, o] = power
        factor = sign * power * _instrument(frf.channel, 1j * omega)
        matrix[:, o, i] = values[:, column] / factor
        noise[:, o, i] = deviation[:, column] / np.abs(factor)
        scale[o, i] = known[column]
    estimated = bool(np.isnan(scale).any())
    shaped = measured.proportional or measured.deviation is not None
    frf_matrix = FrfMatrix(omega, matrix, noise, np.where(np.isnan(scale), 1.0, scale), estimated, shaped)
    if scene.model.exponential is not None:
        frf_matrix = frf_matrix.windowed(float(scene.model.exponential))
    return _ModalTest(frf_matrix, responses, references, powers, measured.proportional, notes=measured.notes)


def _test_of_records(scene: Scene[ModalAnalysisScene]) -> _ModalTest:
    """Return responses estimated from records of time with their excitation.

    Raises `UsageError` where a force of a record is neither measured nor an impulse.
    """
    from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
    from dynid.modal.spectra import TimeRecord, spectra_of_records

    model = scene.model
    records, sensors = list[TimeRecord](), dict[tuple[str, str], Frf]()
    for number, (loads, measurement) in enumerate(experiments(scene, model.excitation, model.measurement), 1):
        forces = _forces_of(loads, measurement, number)
        names = [str(channel.dof) for channel in measurement.channels]
        for name, channel in zip(names, measurement.channels, strict=True):
            for load in loads:
                sensors[name, str(load.dof)] = Frf(channel, load.dof)
        values = np.asarray(measurement.source) - [float(channel.offset) for channel in measurement.channels]
        if loads[0].signal.kind == "impulse":
            values[0] /= 2  # the mean of both sides of a jump
        _check_complete(values, number)
        references = [str(load.dof) for load in loads]
        records.append(TimeRecord(f"record {number}", forces, values, names, references, measurement.step))
    exponential, segment = (
        None if seconds is None else float(seconds) for seconds in (model.exponential, model.segment)
    )
    spectra = spectra_of_records(records, exponential=exponential, segment=segment)
    # Beyond the band the force may have no power, and the noise any size.
    pairs, used = list(spectra.values), in_band(scene, spectra.omega)
    values = np.column_stack([spectra.values[pair][used] for pair in pairs])
    variances = [variance[used] for pair in pairs if (variance := spectra.variance[pair]) is not None]
    deviation = np.sqrt(np.column_stack(variances)) if len(variances) == len(pairs) else None
    channels, notes = tuple(sensors[pair] for pair in pairs), tuple(spectra.notes)
    measured = FrfMeasurement(spectra.omega[used], channels, values, None, deviation, notes=notes)
    step = float(np.median(np.diff(spectra.omega)))
    return _matrix_of(scene, measured)._replace(
        resolution=spectra.resolution,
        duration=np.inf if spectra.resolution else 2 * np.pi / step,
        cut_off=spectra.cut_off,
    )


def _forces_of(loads: Sequence[Any], measurement: Any, number: int) -> Array:
    """Return the samples of the forces of a record (samples x forces) at the times of its responses."""
    names = ("excitation", "measurement.excitation", "measurement.records")
    columns = list[Array]()
    for load in loads:
        kind = load.signal.kind
        if load.motion is not None or kind not in ("file", "impulse") or kind != loads[0].signal.kind:
            raise UsageError(
                f"an excitation of record {number} is no measured force"
                + (", but a motion" if load.motion is not None else f", but of the kind {kind}"),
                remedy="Give its samples, {dof: …, kind: file, path: …}, or of a free decay after a tap "
                "{dof: …, kind: impulse, amplitude: …}, in N s.",
                names=names,
            )
        columns.append(_impulse(load, measurement) if kind == "impulse" else _samples(load, measurement))
    return np.column_stack(columns)


def _impulse(load: Any, measurement: Any) -> Array:
    """Return the samples of an impulse at the first sample of a free decay."""
    samples = np.zeros(measurement.samples)
    samples[0] = float(load.gain) * float(load.signal.amplitude) / measurement.step
    return samples


def _samples(load: Any, measurement: Any) -> Array:
    """Return the samples of a measured force at the times of the responses."""
    step = measurement.step
    first = round((measurement.record.start - load.signal.start - float(load.delay)) / step)
    samples = np.asarray(load.signal.values)[max(first, 0) :][: measurement.samples]
    force = float(load.gain) * np.pad(samples, (max(-first, 0), 0), mode="edge")[: measurement.samples]
    return np.asarray(np.pad(force, (0, measurement.samples - len(force)), mode="edge"))


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
        deviation = np.sqrt(smoothed_variance(deviation**2, values, 2 * max(1, (file.averages or 2) - 1)))
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
            _TWICE,
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


def _instrument(channel: Any, s: ComplexArray) -> ComplexArray:
    """Return the response of a channel's gain, delay and filters at complex frequencies (1/s)."""
    response = float(channel.gain) * np.exp(-s * float(channel.delay))
    for item in channel.filters:
        response = response * item.response(-1j * s, float(item.frequency))[0]
    return np.asarray(response)


def explain(scene: Scene[ModalAnalysisScene]) -> Explanation:
    """Return the explanation of a scene of kind `modal-analysis`, whose measurement is read."""
    result = Result("modal-analysis", scene.title)
    try:
        if scene.model.output_only:
            return Explanation(result, _facts_of_outputs(_outputs(scene)))
        test = _modal_test(scene)
    except (NumericalError, UsageError) as error:
        return Explanation(result, [], obstacle=error)
    frf, band = test.frf, scene.model.band
    factor = angular_factor(band.unit)
    responses, references = (
        counted(len(test.channels), "response"),
        counted(len(test.references), "reference"),
    )
    step = float(np.median(np.diff(frf.omega))) / factor
    facts = [
        Fact("responses", f"{responses} to {references} ({', '.join(test.references)})"),
        Fact("lines", f"{counted(len(frf.omega), 'line')} in the band, {step:.4g} {band.unit} apart"),
        Fact("noise", "estimated from the responses" if frf.estimated else "as stated or measured"),
        Fact("scale", _scale(test.driving_points, real=scene.model.modes.shapes == "real")),
        *(Fact("warning", note) for note in test.notes),
    ]
    return Explanation(result, facts)


def _facts_of_outputs(outputs: _Outputs) -> list[Fact]:
    samples = sum(map(len, outputs.records))
    kept = f", every {outputs.factor}. sample of the records" if outputs.factor > 1 else ""
    return [
        Fact("responses", f"{counted(len(outputs.channels), 'response')} to ambient excitation"),
        Fact("samples", f"{samples}, {outputs.step:.4g} s apart{kept}"),
        Fact("scale", "largest entry 1: the excitation is not measured"),
        *(Fact("warning", note) for note in outputs.notes),
    ]


def _scale(driving_points: list[tuple[int, int]], *, real: bool) -> str:
    if not driving_points:
        return "largest entry 1: no response is measured at a reference"
    return (
        f"{'unit modal mass' if real else 'modal a of 1'}, by {counted(len(driving_points), 'driving point')}"
    )
