"""Signals, and the times of responses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, field_validator, model_validator

from dynid.defaults import HOLD
from dynid.scene.schema.base import (
    Band,
    FilePath,
    MotionQuantity,
    Section,
    SensitivityModel,
    SignedDof,
    UnitName,
)
from dynid.scene.schema.quantities import (
    AT_KEY,
    Located,
    NotNegative,
    Positive,
    Quantity,
    Uncertain,
    Value,
    fault,
)
from dynid.scene.schema.references import Path
from dynid.units import angular_factor

Hold = Literal["spline", "linear", "zero"]
"""The interpolation of a signal between its samples: cubic spline, linear, or constant."""


class SignalPart(Section):
    """Keys of every signal: the source, DOF or ground that it drives.

    Of a structure that is a force on `dof`, its prescribed `motion`, or the motion of the ground (`base`).
    In an excitation the input is gain · (signal at t − delay).
    """

    source: str | None = None
    dof: SignedDof | None = None
    motion: MotionQuantity | None = None
    base: MotionQuantity | None = None
    gain: Uncertain | None = None
    delay: Uncertain | None = None

    @field_validator("gain")
    @classmethod
    def _is_not_zero(cls, gain: Quantity | None) -> Quantity | None:
        if gain is not None and gain.value == 0:
            raise fault("the 'gain' is 0, and the signal would drive nothing")
        return gain

    @property
    def factor(self) -> float:
        """Factor that converts its frequencies into rad/s."""
        return 1.0

    def parameters(self) -> dict[str, Any]:
        """Return the signal's own parameters as floats, frequencies in rad/s."""
        values = {name: getattr(self, name) for name in type(self).model_fields if name not in _NO_PARAMETERS}
        factor = self.factor
        factors = {name: factor if name in _FREQUENCIES else 1.0 for name in values}
        return {name: _as_float(value, factors[name]) for name, value in values.items() if value is not None}


class AmplitudePart(SignalPart):
    """Keys of signals that have an amplitude."""

    amplitude_unit: UnitName | None = None


class PeriodicPart(AmplitudePart):
    """Keys of signals that have frequencies."""

    unit: Literal["rad/s", "Hz"] = "rad/s"

    @property
    def factor(self) -> float:
        """Factor that converts its frequencies into rad/s."""
        return angular_factor(self.unit)


def calibration_faults(path: Path, signal: SignalPart) -> Iterator[Located]:
    """Yield the faults of a signal of a response with a gain or delay, which belong to records."""
    for key in {"gain", "delay"} & signal.model_fields_set:
        message = f"'{key}' belongs to the excitation of a record; a response is that to the signal itself"
        yield (*path, key, AT_KEY), message


_FREQUENCIES = {"frequency", "band"}
_NO_PARAMETERS = {"unit", "amplitude_unit", "source", "dof", "motion", "base", "gain", "delay", "kind"}


def _as_float(value: Any, factor: float) -> Any:
    if isinstance(value, Quantity):
        return float(value) * factor
    if isinstance(value, list):
        return tuple(_as_float(item, factor) for item in value)
    return value


class StepSignal(AmplitudePart):
    """A step."""

    kind: Literal["step"]
    amplitude: Value = Quantity(1)
    start: NotNegative = Quantity(0)


class ImpulseSignal(AmplitudePart):
    """A Dirac impulse at t = 0."""

    kind: Literal["impulse"]
    amplitude: Value = Quantity(1)


class SineSignal(PeriodicPart):
    """A sine."""

    kind: Literal["sine"]
    amplitude: Value = Quantity(1)
    frequency: Positive
    phase: Value = Quantity(0)


class MultisineSignal(PeriodicPart):
    """A sum of sines."""

    kind: Literal["multisine"]
    amplitude: list[Value] = Field(min_length=1)
    frequency: list[Positive] = Field(min_length=1)
    phase: list[Value] | None = None

    @model_validator(mode="after")
    def _lists_match(self) -> Self:
        lengths = {len(self.amplitude), len(self.frequency), len(self.phase or self.amplitude)}
        if len(lengths) > 1:
            raise fault("'amplitude', 'frequency' and 'phase' of a multisine differ in length")
        return self


class ChirpSignal(PeriodicPart):
    """A linear sweep over the record."""

    kind: Literal["chirp"]
    amplitude: Value = Quantity(1)
    start: NotNegative
    stop: NotNegative

    def parameters(self) -> dict[str, Any]:
        """Return the parameters; here start and stop are frequencies."""
        parameters = super().parameters()
        frequencies = {key: parameters[key] * self.factor for key in ("start", "stop")}
        return {**parameters, **frequencies}


class RandomSignal(PeriodicPart):
    """Band-limited noise with a seed; `amplitude` is its standard deviation."""

    kind: Literal["random"]
    amplitude: Positive = Quantity(1)
    seed: int = Field(default=0, ge=0, strict=True)
    band: Band[NotNegative] | None = None
    hold: Hold | None = None


class ImpactSignal(AmplitudePart):
    """Half a sine from t = 0."""

    kind: Literal["impact"]
    amplitude: Value = Quantity(1)
    duration: Positive


class TablePlace(Section):
    """Place of a table in a file, beyond its columns.

    `variable`: one of a MATLAB file; `row`: of a cell array; `time`: the column of the times, where its
    name does not show; `first`: the first row that counts, from 1; `resample`: interpolate at even times;
    `group`: of the channels of a recorder; `sheet`: of a workbook.
    """

    variable: str | None = None
    row: int | None = Field(default=None, ge=1, strict=True)
    time: str | Annotated[int, Field(ge=1, strict=True)] | None = None
    first: int | None = Field(default=None, ge=1, strict=True)
    resample: bool = False
    group: str | None = None
    sheet: str | None = None


class FileSignal(SignalPart, TablePlace):
    """Samples from a file, at the step of the record; by default its only column but the time.

    Recorded is gain · (what acts at t − delay) + offset, in `unit`, by default that of the column's heading,
    else the SI unit. With a `sensitivity` the recorded signal of the sensor has this unit.
    """

    kind: Literal["file"]
    path: FilePath
    column: str | Annotated[int, Field(ge=1, strict=True)] | None = None
    hold: Hold = HOLD.value
    unit: UnitName | None = None
    sensitivity: SensitivityModel | None = None
    offset: Value | None = None


Signal = Annotated[
    StepSignal
    | ImpulseSignal
    | SineSignal
    | MultisineSignal
    | ChirpSignal
    | RandomSignal
    | ImpactSignal
    | FileSignal,
    Discriminator("kind"),
]


Signals = Annotated[
    list[Signal],
    BeforeValidator(
        lambda raw: [raw] if isinstance(raw, dict) else raw, json_schema_input_type=Signal | list[Signal]
    ),
]


class TimeGrid(Section):
    """Times and inputs of a time response."""

    stop: Positive
    step: Positive
    input: Signals = []

    @model_validator(mode="after")
    def _is_a_grid(self) -> Self:
        count = float(self.stop) / float(self.step)
        if count < 1:
            raise fault("'step' is longer than 'stop'")
        if count > 1e8:
            raise fault(f"{count:.2g} time steps are too many; 'step' is too short, or 'stop' too late")
        return self

    @property
    def samples(self) -> int:
        """The number of instants, t = 0 included."""
        return int(float(self.stop) / float(self.step) + 1e-9) + 1
