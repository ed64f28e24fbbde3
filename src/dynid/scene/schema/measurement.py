"""The block `measurement`: channels, sampling, and the source of the values."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import (
    Field,
    PlainValidator,
    Tag,
    WithJsonSchema,
    WrapValidator,
    field_validator,
    model_validator,
)

from dynid.defaults import NOISE_VALUES
from dynid.errors import UsageError
from dynid.scene.schema.base import (
    Band,
    FilePath,
    FrequencyGrid,
    MotionQuantity,
    Section,
    SensitivityModel,
    SignedDof,
    UnitName,
    by_form,
)
from dynid.scene.schema.graph_variables import Output
from dynid.scene.schema.quantities import (
    NotNegative,
    Positive,
    Quantity,
    Uncertain,
    UncertainNotNegative,
    UncertainPositive,
    Value,
    fault,
    raise_faults,
)
from dynid.scene.schema.references import Later
from dynid.scene.schema.signals import Signals, TablePlace
from dynid.scene.schema.structure import PerElement, PerElementOrZero
from dynid.units import si_factor

ColumnName = str | Annotated[int, Field(ge=1, strict=True)]


class ChannelModel(Section):
    """One sensor: at a DOF, between two (the first one's motion less the second one's), or at a node."""

    dof: SignedDof | None = None
    dofs: list[SignedDof] | None = Field(default=None, min_length=2, max_length=2)
    quantity: MotionQuantity | None = None
    output: Output | None = None
    frame: Literal["relative", "absolute"] = "relative"

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if self.output is not None:
            if {"dof", "dofs", "quantity", "frame"} & self.model_fields_set:
                raise fault("an 'output' of a graph stands alone: it names a node and its quantity")
            return self
        if (self.dof is None) == (self.dofs is None):
            raise fault("a sensor is at a 'dof', or between two 'dofs'")
        if self.quantity is None:
            raise fault("a sensor needs its 'quantity': displacement, velocity or acceleration")
        if self.dofs and self.dofs[0] == self.dofs[1]:
            raise fault(f"a sensor between DOF {self.dofs[0]} and itself measures nothing")
        if self.frame == "absolute" and (self.dofs or self.quantity != "acceleration"):
            raise fault("only the acceleration of one DOF is measured absolutely")
        return self

    @property
    def ends(self) -> list[SignedDof]:
        """The DOFs it is at: one or two."""
        return self.dofs or ([] if self.dof is None else [self.dof])


class OutputModel(ChannelModel):
    """A motion that a response shows: at a DOF, or between two."""

    quantity: MotionQuantity = "displacement"


class ReferenceModel(Section):
    """Force at a DOF, or source of a graph, to which a frequency response is referred."""

    dof: SignedDof | None = None
    source: str | None = None
    amplitude: Positive | None = None
    sweep: Literal["up", "down"] | None = None

    @model_validator(mode="after")
    def _somewhere(self) -> Self:
        if (self.dof is None) == (self.source is None):
            raise fault("a reference is the 'dof' of a force, or the 'source' of a graph")
        if self.amplitude is not None and self.source is not None:
            raise fault("an 'amplitude' is that of a force on a structure, not of the source of a graph")
        if self.sweep is not None and self.amplitude is None:
            raise fault("a 'sweep' is that of a stepped sine, whose force has an 'amplitude'")
        return self

    @property
    def place(self) -> SignedDof:
        """The DOF or source."""
        place = self.source if self.dof is None else self.dof
        assert place is not None
        return place


class FilterModel(Section):
    """A filter of an instrument; `frequency` is that of the -3 dB point."""

    frequency: UncertainPositive
    order: int = Field(default=1, ge=1, le=10, strict=True)
    type: Literal["butterworth", "bessel"] = "butterworth"
    unit: Literal["rad/s", "Hz"] = "rad/s"


#: Largest drift of a clock.
_MAX_DRIFT = 0.1
_DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}


class IntegratorModel(Section):
    """An integrator of an instrument, 1/(s + 2π frequency)^order."""

    frequency: UncertainPositive | None = None
    order: int = Field(default=1, ge=1, le=2, strict=True)
    unit: Literal["rad/s", "Hz"] = "rad/s"


class ClockModel(Section):
    """Clock of a channel of its own: sample j is at start + j · step · (1 + drift) from the record's first.

    `step` and `samples` are by default those of the record.
    """

    step: Positive | None = None
    start: Value | None = None
    samples: int | None = Field(default=None, ge=2, le=100_000_000, strict=True)
    drift: Uncertain | None = None

    @model_validator(mode="after")
    def _goes_on(self) -> Self:
        if not self.model_fields_set:
            raise fault("a 'clock' states how it differs from the record's: step, start, samples or drift")
        if self.drift is not None and not abs(float(self.drift)) <= _MAX_DRIFT:
            raise fault(
                f"a 'drift' is a part of the step, at most {_MAX_DRIFT:g}: another rate is another 'step'"
            )
        return self


class MeasuredChannelModel(ChannelModel):
    """One sensor of a record, or of a frequency response with its `reference`.

    Recorded is gain · (model at t − delay, behind its filters) + offset, in `unit`, by default that of the
    column's heading, else the SI unit; t is the time of its `clock`, by default of the record. With a
    `sensitivity` the recorded signal of the sensor, such as a voltage, has this unit.
    """

    reference: ReferenceModel | None = None
    gain: Uncertain | None = None
    offset: Uncertain | None = None
    delay: Uncertain | None = None
    clock: ClockModel | None = None
    high_pass: FilterModel | None = None
    low_pass: FilterModel | None = None
    integrator: IntegratorModel | None = None
    mass: UncertainNotNegative | None = None
    unit: UnitName | None = None
    sensitivity: SensitivityModel | None = None

    @model_validator(mode="after")
    def _is_calibrated(self) -> Self:
        if self.gain is not None and self.gain.value == 0:
            raise fault("the 'gain' is 0, and the channel would show nothing")
        if self.mass is not None and (self.dof is None or self.output is not None):
            raise fault("the 'mass' of a sensor is at the one 'dof' that it measures")
        for key in ("offset", "clock"):
            if self.reference is not None and getattr(self, key) is not None:
                raise fault(f"a frequency response has no '{key}'")
        if self.integrator is not None and self.integrator.order > _DERIVATIVES.get(self.quantity or "", 2):
            raise fault(
                f"an 'integrator' of order {self.integrator.order} behind a {self.quantity}: state the "
                "quantity before it, of which it makes a velocity or a displacement"
            )
        if self.unit is not None and self.quantity is not None and self.sensitivity is None:
            from dynid.structure.ports import integrated, motion_units

            recorded = integrated(self.quantity, 0 if self.integrator is None else self.integrator.order)
            units, what = [*motion_units(recorded)], f"the {recorded} of this channel"
            if self.reference is not None:
                units = [f"({unit})/{force}" for unit in units for force in ("N", "(N.m)")]
                what = "this response"
            try:
                si_factor(self.unit, units, what=what)
            except UsageError as error:
                raise fault(str(error)) from None
        return self

    @property
    def all_dofs(self) -> list[SignedDof]:
        """The DOFs that it is at, and that of the force."""
        return [*self.ends, *([self.reference.place] if self.reference else [])]


class AllOfFile(list[Any]):
    """Entries that stand in a file, which is not read yet: ``channels: all``."""


def _or_all(raw: Any, listed: Any) -> Any:
    return AllOfFile() if raw == "all" else listed(raw)


Channels = Annotated[
    list[MeasuredChannelModel],
    Field(min_length=1),
    WrapValidator(_or_all, json_schema_input_type=list[MeasuredChannelModel] | Literal["all"]),
]
"""Sensors, one by one, or all that a Universal File names."""


def _is_order(raw: Any) -> Any:
    if raw == "auto" or (type(raw) is int and 1 <= raw <= _MAX_ORDER):
        return raw
    raise fault(f"'order' is a whole number from 1 to {_MAX_ORDER}, or auto")


#: The highest order of coloured noise.
_MAX_ORDER = 200
_NoiseOrder = Annotated[
    Any,
    PlainValidator(_is_order),
    WithJsonSchema({"anyOf": [{"type": "integer", "minimum": 1, "maximum": _MAX_ORDER}, {"const": "auto"}]}),
]


class NoiseModel(Section):
    """Noise that is not white: coloured, of records of time; or proportional to a frequency response."""

    kind: Literal["coloured", "proportional"]
    order: _NoiseOrder = "auto"
    correlated: bool = False
    ratio: PerElement | None = None

    @model_validator(mode="after")
    def _is_of_its_kind(self) -> Self:
        if self.kind == "coloured" and self.ratio is not None:
            raise fault("'ratio' is that of proportional noise; coloured noise is estimated")
        if self.kind == "proportional" and {"order", "correlated"} & self.model_fields_set:
            raise fault("'order' and 'correlated' are those of coloured noise")
        return self


Noise = Annotated[
    Annotated[Positive, Tag("one")]
    | Annotated[list[Positive], Tag("list")]
    | Annotated[NoiseModel, Tag("mapping")],
    by_form("one", "list", "mapping"),
]
"""Deviations of white noise, one number or one a channel; or noise that is not white."""


class NoisyModel(Section):
    """Noise that is added to what is simulated, and the model that is simulated."""

    noise_ratio: PerElementOrZero | None = None
    noise: PerElementOrZero | None = None
    seed: int = Field(default=0, ge=0, strict=True)
    model: Literal["full", "reduced"] = "full"

    @model_validator(mode="after")
    def _one_noise(self) -> Self:
        if self.noise is not None and self.noise_ratio is not None:
            raise fault("the noise has either a 'noise_ratio', or the standard deviation 'noise'")
        return self


class SimulateModel(NoisyModel):
    """A record simulated with the joints' true values."""

    noise_colour: list[Value] = Field(default=[], max_length=200)
    settle: NotNegative | None = None

    @field_validator("noise_colour")
    @classmethod
    def _is_stationary(cls, colour: list[Quantity]) -> list[Quantity]:
        a = [float(coefficient) for coefficient in colour]
        while a:  # partial autocorrelations, from the last one (Levinson's recursion backwards)
            last = a.pop()
            if not abs(last) < 1:
                raise fault(
                    "noise with these coefficients is not stationary: all roots of 1 = a_1 z + a_2 z^2 + … "
                    "must lie outside the unit circle"
                )
            a = [(first + last * other) / (1 - last**2) for first, other in zip(a, reversed(a), strict=True)]
        return colour


class SimulateFrfModel(NoisyModel):
    """Frequency responses simulated with the joints' true values, at these lines."""

    lines: FrequencyGrid
    noise_by_line: bool = False

    @model_validator(mode="after")
    def _lines_differ(self) -> Self:
        if self.lines.points > 1 and float(self.lines.start) == float(self.lines.stop):
            raise fault("the lines are all one frequency; 'stop' is not above 'start'")
        return self


class FurtherFileModel(TablePlace):
    """Columns of a further file of a record."""

    path: FilePath
    columns: list[ColumnName] | None = None


class MeasuredFileModel(TablePlace):
    """Measured data: one column for each channel, those of the files `beside` after its own."""

    path: FilePath | None = None
    columns: list[ColumnName] | None = None
    beside: list[FurtherFileModel] = Field(default=[], max_length=1000)


class FrfFileModel(Section):
    """Measured frequency responses: columns of complex numbers, or pairs [real, imaginary] of columns.

    `frequency`: the column of the lines. `deviation`: of the complex noise, line by line, a column for each
    channel; or `coherence`, with which it follows from the `averages` that were taken.
    """

    path: FilePath
    columns: list[ColumnName | Annotated[list[ColumnName], Field(min_length=2, max_length=2)]] | None = Field(
        default=None, min_length=1
    )
    frequency: ColumnName | None = None
    deviation: list[ColumnName] | None = Field(default=None, min_length=1)
    coherence: (
        Annotated[
            list[ColumnName],
            Field(min_length=1),
            WrapValidator(_or_all, json_schema_input_type=list[ColumnName] | Literal["all"]),
        ]
        | None
    ) = None
    averages: int | None = Field(default=None, ge=1, le=1_000_000_000, strict=True)

    @model_validator(mode="after")
    def _one_deviation(self) -> Self:
        if self.deviation and self.coherence is not None:
            raise fault("the noise by line has either its 'deviation', or a 'coherence' that it follows from")
        if self.averages is not None and self.coherence is None:
            raise fault("'averages' are those of a 'coherence'")
        return self


class FrfModel(Section):
    """Frequency responses, simulated or out of a file; of these the lines in a band.

    `unit` is that of the band, and of the frequencies in the file; those of a Universal File are in Hz.
    """

    simulate: Annotated[SimulateFrfModel, Later()] | None = None
    file: Annotated[FrfFileModel, Later()] | None = None
    band: Band[NotNegative] | None = None
    unit: Literal["rad/s", "Hz"] | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if (self.simulate is None) == (self.file is None):
            raise fault("frequency responses are either 'simulate'd or read from a 'file'")
        if self.simulate is not None and (self.band or self.unit):
            raise fault("'band' and 'unit' are those of a 'file'; simulated lines have their own")
        return self


class PrepareModel(Section):
    """One step that prepares measured samples: subtract a trend, pass a band, or keep every n-th sample."""

    detrend: Literal["constant", "linear"] | None = None
    band_pass: Band[NotNegative] | None = None
    unit: Literal["rad/s", "Hz"] | None = None
    order: int | None = Field(default=None, ge=1, le=10, strict=True)
    decimate: int | None = Field(default=None, ge=2, le=100_000, strict=True)

    @model_validator(mode="after")
    def _is_one_step(self) -> Self:
        steps = [name for name in ("detrend", "band_pass", "decimate") if getattr(self, name) is not None]
        if len(steps) != 1:
            raise fault("a step of 'prepare' is one of 'detrend', 'band_pass' and 'decimate'")
        if self.band_pass is None and (self.unit is not None or self.order is not None):
            raise fault("'unit' and 'order' are those of a 'band_pass'")
        return self


class RecordModel(Section):
    """One record; it inherits the keys that it lacks from the measurement."""

    step: Positive | None = None
    samples: int | None = Field(default=None, ge=1, le=100_000_000, strict=True)
    channels: Channels | None = None
    match: Annotated[Any, Later("dynid.scene.schema.modes:MatchModel")] | None = None
    noise: Noise | None = None
    simulate: Annotated[SimulateModel, Later()] | None = None
    file: Annotated[MeasuredFileModel, Later()] | None = None
    prepare: list[Annotated[PrepareModel, Later()]] | None = Field(default=None, max_length=20)
    excitation: Signals | None = None
    frf: Annotated[FrfModel, Later()] | None = None

    @model_validator(mode="after")
    def _channels_differ(self) -> Self:
        channels = self.channels or []
        message = "this channel is listed twice"
        twice = (index for index, channel in enumerate(channels) if channel in channels[:index])
        raise_faults((("channels", index), message) for index in twice)
        return self

    def completed(self, shared: RecordModel, number: int) -> RecordModel:
        """Return this record with what it shares; a shared seed counts up from record to record."""
        values = {name: getattr(self, name) for name in RecordModel.model_fields}
        for name, value in values.items():
            if value is None:
                values[name] = getattr(shared, name)
        if self.channels is not None and not isinstance(self.channels, AllOfFile):  # they name their DOFs
            values["match"] = self.match
        if self.file and shared.file:
            file_keys = {name: getattr(self.file, name) for name in self.file.model_fields_set}
            values["file"] = shared.file.model_copy(update=file_keys)
        if self.simulate is not None and self.file is None:
            values["file"] = None
        if self.file is not None and self.simulate is None:
            values["simulate"] = None
        if self.simulate is None and values["simulate"] is not None:
            seed = values["simulate"].seed + number
            values["simulate"] = values["simulate"].model_copy(update={"seed": seed})
        return RecordModel.model_construct(**values)

    def check(self, of: str) -> None:
        """Refuse a record that is not whole."""
        if isinstance(self.channels, AllOfFile):  # it is checked again with what the file holds
            file = self.file if self.frf is None else self.frf.file
            if file is None or file.path is None:
                raise fault(f"'channels: all' are those of a file, and {of} names none")
        elif self.match is not None:
            raise fault("'match' goes with 'channels: all'; these channels name their DOFs")
        elif self.frf is None:
            self._check_record(of)
        elif self.frf.file is not None and isinstance(self.frf.file.coherence, AllOfFile):
            raise fault("'coherence: all' goes with 'channels: all'; name a column for each channel")
        else:
            self._check_frf()

    def _check_record(self, of: str) -> None:
        if any(channel.reference for channel in self.channels or ()):
            raise fault("a 'reference' is that of a frequency response; there is no 'frf'")
        for key in ("step", "samples", "channels"):
            if getattr(self, key) is None:
                raise fault(f"{of} needs the key '{key}'")
        if (self.simulate is None) == (self.file is None):
            raise fault(f"{of} is either 'simulate'd or read from a 'file'")
        if self.simulate is not None and self.prepare:
            raise fault(f"{of} is simulated; only what is read from a 'file' can be 'prepare'd")
        channels = len(self.channels or ())
        if self.file is not None:
            if self.file.path is None:
                raise fault(f"the file of {of} needs the key 'path'")
            columns = [self.file.columns, *(file.columns for file in self.file.beside)]
            named = sum(len(names or ()) for names in columns)
            if named > channels or (all(columns) and named != channels):
                raise fault(f"'columns' names {named}, but 'channels' has {channels}")
        self._check_levels(self.simulate)
        self._check_noise(of)
        if any(channel.clock is not None for channel in self.channels or ()):
            self._check_clocks(of)

    def _check_clocks(self, of: str) -> None:
        """Refuse what goes with one clock of all channels only."""
        if isinstance(self.noise, NoiseModel) and self.noise.correlated:
            raise fault(f"noise is not 'correlated' between channels of different clocks, as {of} has them")
        filters = ("band_pass", "decimate")
        steps = {key for step in self.prepare or () for key in filters if getattr(step, key)}
        if steps:
            named = " and ".join(f"'{key}'" for key in sorted(steps))
            verb = "filter" + "s" * (len(steps) == 1)
            raise fault(f"{named} {verb} all channels of {of} alike, and one has a 'clock' of its own")

    def _check_noise(self, of: str) -> None:
        """Refuse noise models that a record of time does not have, or has too few samples for."""
        if not isinstance(self.noise, NoiseModel):
            return
        if self.noise.kind == "proportional":
            raise fault(
                f"the noise of {of} of time has no lines to be proportional to; 'kind' is coloured, "
                "or 'noise' a number"
            )
        if self.prepare and any(step.detrend is None for step in self.prepare):
            raise fault(
                f"the coloured noise of {of} is that of unfiltered samples; leave 'band_pass' and "
                "'decimate' out: it weights frequencies by itself"
            )
        order, samples = self.noise.order, self.samples or 0
        needed = (NOISE_VALUES.value + 1) * (order if isinstance(order, int) else 0)
        if samples < needed:
            raise fault(f"coloured noise of order {order} needs {needed} samples, and there are {samples}")

    def _check_levels(self, simulate: NoisyModel | None) -> None:
        channels = len(self.channels or ())
        noise = self.noise.ratio if isinstance(self.noise, NoiseModel) else self.noise
        levels = {"noise": noise}
        if simulate is not None:
            levels |= {"simulate.noise": simulate.noise, "simulate.noise_ratio": simulate.noise_ratio}
        for name, level in levels.items():
            if isinstance(level, list) and len(level) != channels:
                raise fault(f"'{name}' has {len(level)} entries, but 'channels' has {channels}")

    def _check_frf(self) -> None:
        """Refuse frequency responses that are not whole, and what belongs to records of time."""
        assert self.frf is not None
        for key in ("step", "samples", "simulate", "file", "prepare", "excitation"):
            if getattr(self, key) is not None:
                raise fault(f"'{key}' is that of a record of time; with 'frf' it says nothing")
        if not self.channels:
            raise fault("a measurement needs the key 'channels'")
        if not all(channel.reference for channel in self.channels):
            raise fault("a channel of a frequency response needs its reference: {dof: …}, where the force is")
        if any(channel.frame == "absolute" for channel in self.channels):
            raise fault("with a force as its reference a frequency response has no 'frame'")
        file = self.frf.file
        if file is not None:
            by_line = {"columns": file.columns, "deviation": file.deviation, "coherence": file.coherence}
            for name, columns in by_line.items():
                if columns and len(columns) > len(self.channels):
                    count = len(self.channels)
                    raise fault(f"'{name}' names {len(columns)}, but 'channels' has {count}")
            if self.noise is not None and (file.deviation or file.averages):
                raise fault("the noise is given by line already; leave 'noise' out")
            if file.coherence and isinstance(self.noise, NoiseModel):
                raise fault("the noise follows from the 'coherence'; leave its 'kind' out")
        if isinstance(self.noise, NoiseModel) and self.noise.kind == "coloured":
            raise fault("coloured noise is that of records of time; frequency responses have 'proportional'")
        self._check_levels(self.frf.simulate)


class HeldOutModel(RecordModel):
    """A record that is predicted at the estimate, and not fitted; it inherits keys as `records` do."""

    initial_samples: int | None = Field(default=None, ge=1, le=100_000_000, strict=True)

    def completed(self, shared: RecordModel, number: int) -> HeldOutModel:
        """Return this record with what it shares."""
        values = super().completed(shared, number)
        keys = {name: getattr(values, name) for name in RecordModel.model_fields}
        return HeldOutModel.model_construct(**keys, initial_samples=self.initial_samples)


class MeasurementModel(RecordModel):
    """A record with sampling, channels and source; several records and their common keys; measured modes."""

    records: list[Annotated[RecordModel, Later()]] = Field(default=[], max_length=1000)
    held_out: list[Annotated[HeldOutModel, Later()]] = Field(default=[], max_length=1000)
    modes: Annotated[Any, Later("dynid.scene.schema.modes:MeasuredModesModel")] | None = None

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.records and (self.frf or any(record.frf for record in self.records)):
            raise fault("frequency responses stand alone: 'frf' goes with no 'records'")
        if self.held_out and (self.frf or self.modes_alone or any(record.frf for record in self.held_out)):
            raise fault("'held_out' are records of time, predicted beside those that are fitted")
        if self.modes_alone:
            return self
        for number, held_out in enumerate(self.each_held_out, 1):
            held_out.check(f"held-out record {number}")
        all_of_file = any(isinstance(record.channels, AllOfFile) for record in self.each)
        if self.match is not None and not all_of_file:
            if self.modes is not None:
                raise fault(
                    "'match' goes with 'channels: all'; write that of modes under 'measurement.modes'"
                )
            raise fault("'match' goes with 'channels: all'; these channels name their DOFs")
        if not self.records:
            self.check("a measurement")
            if self.excitation is not None:
                raise fault("the excitation of a single record stands beside 'measurement', not in it")
        for number, record in enumerate(self.each, 1):
            if self.records:
                record.check(f"record {number} of the measurement")
        return self

    @property
    def modes_alone(self) -> bool:
        """True if there are measured modes and nothing else."""
        return self.modes is not None and not (self.model_fields_set - {"modes"})

    @property
    def each(self) -> list[RecordModel]:
        """The records, each complete; none where modes stand alone."""
        if self.modes_alone:
            return []
        return [record.completed(self, k) for k, record in enumerate(self.records)] or [self]

    @property
    def each_held_out(self) -> list[HeldOutModel]:
        """The records that are held out, each complete."""
        count = len(self.records) or 1
        return [record.completed(self, count + k) for k, record in enumerate(self.held_out)]

    @property
    def sensors(self) -> list[MeasuredChannelModel]:
        """All different channels of the records."""
        channels = [channel for record in self.each for channel in record.channels or ()]
        return [channel for k, channel in enumerate(channels) if channel not in channels[:k]]
