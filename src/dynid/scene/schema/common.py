"""The parts that scenes of several kinds share: responses, signals, expectations."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from dynid.choices import HOLD
from dynid.scene.schema.quantities import NotNegative, Positive, Quantity, Value, fault


class Part(BaseModel):
    """A mapping of a scene whose keys are all known."""

    model_config = ConfigDict(
        defer_build=True,  # made ready when first used: a scene uses few
        extra="forbid",
        frozen=True,
        arbitrary_types_allowed=True,
        populate_by_name=True,
    )


class FrequencyGrid(Part):
    """Frequencies of a frequency response."""

    start: NotNegative
    stop: Positive
    points: int = Field(default=200, ge=1, le=10_000_000, strict=True)
    scale: Literal["log", "linear"] = "log"
    unit: Literal["rad/s", "Hz"] = "rad/s"

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if float(self.stop) < float(self.start):
            raise fault("'stop' is below 'start'")
        if self.scale == "log" and float(self.start) == 0:
            raise fault("a logarithmic scale cannot start at 0; start above it, or set 'scale: linear'")
        return self


Dof = Annotated[int, Field(ge=1, strict=True)] | Annotated[str, Field(min_length=1, max_length=100)]
"""A degree of freedom: its number, from 1, or its label."""


MotionQuantity = Literal["displacement", "velocity", "acceleration"]


class SignalPart(Part):
    """What every signal may say beside its own keys: what it drives.

    Of a structure that is a force on `dof`, its prescribed `motion`, or the motion of the ground (`base`).
    """

    source: str | None = None
    dof: Dof | None = None
    motion: MotionQuantity | None = None
    base: MotionQuantity | None = None

    @property
    def factor(self) -> float:
        """What turns its frequencies into rad/s."""
        return 1.0

    def parameters(self) -> dict[str, Any]:
        """Return the signal's own parameters as floats, frequencies in rad/s."""
        skipped = {"unit", "source", "dof", "motion", "base", "kind"}
        given = {name: getattr(self, name) for name in type(self).model_fields if name not in skipped}
        factor = self.factor
        return {
            name: _as_float(value, factor if name in _FREQUENCIES else 1.0)
            for name, value in given.items()
            if value is not None
        }


class PeriodicPart(SignalPart):
    """What a signal that has frequencies may say as well."""

    unit: Literal["rad/s", "Hz"] = "rad/s"

    @property
    def factor(self) -> float:
        """What turns its frequencies into rad/s."""
        return 2 * math.pi if self.unit == "Hz" else 1.0


_FREQUENCIES = {"frequency", "band"}


def _as_float(value: Any, factor: float) -> Any:
    if isinstance(value, Quantity):
        return float(value) * factor
    if isinstance(value, list):
        return tuple(_as_float(item, factor) for item in value)
    return value


class StepSignal(SignalPart):
    """A step."""

    kind: Literal["step"]
    amplitude: Value = Quantity(1)
    start: NotNegative = Quantity(0)


class ImpulseSignal(SignalPart):
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
        own = super().parameters()
        return {**own, "start": own["start"] * self.factor, "stop": own["stop"] * self.factor}


class RandomSignal(PeriodicPart):
    """Band-limited noise with a seed; `amplitude` is its standard deviation."""

    kind: Literal["random"]
    amplitude: Positive = Quantity(1)
    seed: int = Field(default=0, ge=0, strict=True)
    band: list[NotNegative] | None = Field(default=None, min_length=2, max_length=2)
    hold: Hold | None = None

    @field_validator("band")
    @classmethod
    def _is_a_band(cls, band: list[Quantity] | None) -> list[Quantity] | None:
        if band and band[0].value >= band[1].value:
            raise fault("a band is [low, high], and low is not below high")
        return band


class ImpactSignal(SignalPart):
    """Half a sine from t = 0."""

    kind: Literal["impact"]
    amplitude: Value = Quantity(1)
    duration: Positive


Hold = Literal["spline", "linear", "zero"]
"""How a signal goes on between its samples: by a cubic spline, straight, or constant."""


class TablePlace(Part):
    """Where in a file a table is, beyond its columns.

    `variable`: one of a MATLAB file; `row`: of a cell array; `time`: the column of the times, where its
    name does not tell; `first`: the first row that counts, from 1.
    """

    variable: str | None = None
    row: int | None = Field(default=None, ge=1, strict=True)
    time: str | Annotated[int, Field(ge=1, strict=True)] | None = None
    first: int | None = Field(default=None, ge=1, strict=True)


class FileSignal(SignalPart, TablePlace):
    """Samples from a file, at the step of the record; by default its only column but the time."""

    kind: Literal["file"]
    path: str
    column: str | Annotated[int, Field(ge=1, strict=True)] | None = None
    hold: Hold = HOLD.value


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


def _as_list(raw: Any) -> Any:
    return [raw] if isinstance(raw, dict) else raw


Signals = Annotated[list[Signal], BeforeValidator(_as_list, json_schema_input_type=Signal | list[Signal])]


class TimeGrid(Part):
    """Times of a time response, and what drives it."""

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


def _is_expected(raw: Any) -> Any:
    plain = (bool, int, float, str)
    if isinstance(raw, plain) or (isinstance(raw, list) and all(isinstance(x, (*plain, list)) for x in raw)):
        return raw
    raise fault("an expected value is a number, a text, true, false, or a list of these")


Expected = Annotated[
    Any,
    PlainValidator(_is_expected),
    WithJsonSchema({"type": ["number", "string", "boolean", "array"], "description": "the expected value"}),
]


class Expectation(Part):
    """What a result must be for the run to end with exit code 0."""

    path: str
    at: dict[str, str | float] | None = None
    value: Expected = None
    rtol: float | None = Field(default=None, ge=0, strict=True)
    atol: float | None = Field(default=None, ge=0, strict=True)
    min: float | None = Field(default=None, strict=True)
    max: float | None = Field(default=None, strict=True)
    max_abs: float | None = Field(default=None, strict=True)

    @model_validator(mode="after")
    def _expects_something(self) -> Self:
        if self.value is None and self.min is None and self.max is None and self.max_abs is None:
            raise fault("an expectation needs a 'value', or a 'min', 'max' or 'max_abs'")
        return self


def _as_written(raw: Any) -> Any:
    return str(raw).lower() if isinstance(raw, bool) else raw  # in Python, true equals 1


class SceneModel(Part):
    """What every scene says."""

    dynid: Annotated[Literal[1], BeforeValidator(_as_written)]
    title: str = ""
    parameters: dict[str, Any] = {}
    expect: list[Expectation] = []
