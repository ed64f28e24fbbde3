"""Base of the schema: sections, references, parameters, units, expectations, frequencies, alternatives."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from dynid.scene.schema.quantities import AT_KEY, Located, NotNegative, Positive, Quantity, Value, fault
from dynid.scene.schema.references import DOF, FILE, SIGNED_DOF, Later
from dynid.suggestions import did_you_mean
from dynid.units import UnknownUnitError, readings, unit_fits


class Section(BaseModel):
    """A mapping of a scene whose keys are all known."""

    model_config = ConfigDict(
        defer_build=True,  # made ready when first used: a scene uses few
        extra="forbid",
        frozen=True,
        arbitrary_types_allowed=True,
        populate_by_name=True,
    )


def once(what: str = "") -> AfterValidator:
    """Return the check that a list has no entry twice; `what` is the noun for one, default: it is quoted."""

    def check(listed: list[Any]) -> list[Any]:
        for index, item in enumerate(listed):
            if item in listed[:index]:
                named = f"{what} {item}" if isinstance(item, int | str) else what
                named = named if what else f"'{item}'"
                raise fault(f"{named} is listed twice")
        return listed

    return AfterValidator(check)


def by_form(*forms: Literal["one", "list", "mapping", "text"]) -> Discriminator:
    """Return the discriminator of a union by the form of its value; any other form counts as the first."""

    def form_of(raw: Any) -> str:
        types: dict[str, Any] = {"list": list, "mapping": (dict, BaseModel), "text": str, "one": ()}
        return next((form for form in forms if isinstance(raw, types[form])), forms[0])

    return Discriminator(form_of)


Entry = TypeVar("Entry")
OneOrList = Annotated[
    Annotated[Entry, Tag("one")] | Annotated[list[Entry], Tag("list")], by_form("one", "list")
]
"""One value, or one for each element, mode or channel."""


def _is_a_band(band: list[Quantity]) -> list[Quantity]:
    if band[0].value >= band[1].value:
        raise fault("a band is [low, high], and low is not below high")
    return band


Band = Annotated[list[Entry], Field(min_length=2, max_length=2), AfterValidator(_is_a_band)]
"""Two frequencies, the first below the second."""


def short_for(key: str, accepted: Any) -> BeforeValidator:
    """Return the reading of a section that may be the value of a key alone; `accepted` are its types."""

    def read(raw: Any) -> Any:
        return raw if isinstance(raw, dict) else {key: raw}

    return BeforeValidator(read, json_schema_input_type=accepted)


class FrequencyGrid(Section):
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


DofLabel = Annotated[int, Field(ge=1, strict=True)] | Annotated[str, Field(min_length=1, max_length=100)]
"""The name of a degree of freedom: its number, from 1, its label, or NODE:DIR."""

Dof = Annotated[DofLabel, DOF]
"""A degree of freedom of the structure."""

SignedDof = Annotated[DofLabel, SIGNED_DOF]
"""A degree of freedom, in the opposite direction with a minus sign: NODE:-DIR."""

FilePath = Annotated[str, FILE]
"""A file, relative to the folder of the scene."""


MotionQuantity = Literal["displacement", "velocity", "acceleration"]


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


class Expectation(Section):
    """An expectation of the result; a run that does not meet it ends with exit code 1."""

    path: str
    at: dict[str, str | float] | None = None
    value: Expected = None
    rtol: float | None = Field(default=None, ge=0, strict=True)
    atol: float | None = Field(default=None, ge=0, strict=True)
    min: float | None = Field(default=None, strict=True)
    max: float | None = Field(default=None, strict=True)
    max_abs: float | None = Field(default=None, strict=True)
    part: Literal["real", "imaginary", "magnitude"] | None = None
    unit: Literal["rad/s", "Hz"] | None = None

    @field_validator("at", mode="before")
    @classmethod
    def _names_a_dimension(cls, raw: Any) -> Any:
        if raw is not None and not isinstance(raw, dict):
            raise fault("'at' is a mapping of dimensions to labels, such as at: {mode: 2}")
        return raw

    @model_validator(mode="after")
    def _expects_something(self) -> Self:
        if self.value is None and self.min is None and self.max is None and self.max_abs is None:
            raise fault("an expectation needs a 'value', or a 'min', 'max' or 'max_abs'")
        return self


class DefinedPrior(Section):
    """Prior of an unknown parameter: its expected value, and its standard deviation, absolute or relative."""

    value: Value
    relative_deviation: Positive | None = None
    std: Positive | None = None

    @model_validator(mode="after")
    def _one_deviation(self) -> Self:
        if (self.relative_deviation is None) == (self.std is None):
            raise fault("a prior has either a 'relative_deviation', or its standard deviation 'std'")
        if self.relative_deviation is not None and self.value.value == 0:
            raise fault("the prior's 'value' is 0, of which no deviation is a part; write 'std'")
        return self


class DefinedParameter(Section):
    """A named value: unknown (`start`), or known with uncertainty (`value`, `std`)."""

    start: Value | None = None
    true: Value | None = None
    min: Value | None = None
    max: Value | None = None
    prior: DefinedPrior | None = None
    scale: Literal["log", "linear"] | None = None
    value: Value | None = None
    std: Positive | None = None

    @model_validator(mode="after")
    def _known_or_unknown(self) -> Self:
        if (self.start is None) == (self.value is None):
            raise fault(_FORMS_OF_A_PARAMETER)
        if self.start is None:
            for key in ("true", "min", "max", "prior", "scale"):
                if getattr(self, key) is not None:
                    raise fault(f"'{key}' belongs to an unknown parameter, which has a 'start'")
            return self
        if self.std is not None:
            raise fault(
                "'std' belongs beside 'value'; of an unknown parameter write prior: {value: …, std: …}"
            )
        low = -math.inf if self.min is None else float(self.min)
        high = math.inf if self.max is None else float(self.max)
        if not low <= float(self.start) <= high:
            raise fault("'start' does not lie between 'min' and 'max'")
        numbers = {key: getattr(self, key) for key in ("start", "true", "min", "max")}
        numbers["prior"] = self.prior.value if self.prior else None
        for key, number in numbers.items():
            if self.scale == "log" and number is not None and number.value <= 0:
                raise fault(
                    f"'{key}' is {float(number):g}; with 'scale: log' the logarithm is estimated: "
                    "write 'scale: linear' where zero or negative values are possible"
                )
        return self

    @property
    def reference_key(self) -> str:
        """The key of its true value where that is known, else of its start; of a known value this one."""
        return next(key for key in ("true", "start", "value") if getattr(self, key) is not None)

    @property
    def reference(self) -> Quantity:
        """The quantity under that key."""
        quantity: Quantity = getattr(self, self.reference_key)
        return quantity


_FORMS_OF_A_PARAMETER = (
    "a parameter is a number, an expression, unknown with its 'start', or known with a 'value' and its 'std'"
)


def _as_defined(raw: Any, info: ValidationInfo) -> Any:
    if not isinstance(raw, dict):
        return raw  # known: read and checked with the names of the scene
    if raw.keys() == {"value"}:
        raise fault("the 'std' of this 'value' is missing; a known parameter is the number alone")
    return DefinedParameter.model_validate(raw, context=info.context)


ParameterEntry = Annotated[
    DefinedParameter | float | str,
    PlainValidator(_as_defined, json_schema_input_type=DefinedParameter | float | str),
]
"""An entry of `parameters`; a known one as it is written."""


class SceneModel(Section):
    """Keys of every scene."""

    if TYPE_CHECKING:  # each kind has its own value
        kind: str

    dynid: Literal[1]
    title: str = ""
    parameters: dict[str, ParameterEntry] = {}
    expect: list[Expectation] = []

    @field_validator("dynid", mode="before")
    @classmethod
    def _is_a_number(cls, raw: Any) -> Any:
        return str(raw).lower() if isinstance(raw, bool) else raw  # in Python, true equals 1

    @property
    def aspects(self) -> set[str]:
        """The aspects in which it chooses between alternatives, of `ASPECTS`."""
        return set()


class ComposedScene(SceneModel):
    """Keys of scenes with a graph: its models, which are gone once it is flat, and feedback around it."""

    models: dict[str, Annotated[Any, Later("dynid.scene.schema.bond_graph:SubModel")]] = {}
    use: FilePath | list[FilePath] = []
    control: Annotated[Any, Later("dynid.scene.schema.control:ControlModel")] | None = None


def _is_unit(text: str) -> str:
    try:
        readings(text)
    except UnknownUnitError as error:
        raise fault(str(error)) from None
    return text


UnitName = Annotated[str, AfterValidator(_is_unit)]
"""A unit such as `g`, `mm/s^2` or `(m/s2)/kN`."""


class SensitivityModel(Section):
    """Sensitivity of a sensor: recorded value over measured quantity, such as 0.1 V/g."""

    value: Value
    unit: UnitName

    @model_validator(mode="after")
    def _shows_something(self) -> Self:
        if self.value.value == 0:
            raise fault("the sensitivity is 0, and the sensor would show nothing")
        return self

    @property
    def recorded(self) -> str:
        """The unit recorded where nothing else gives it: the voltage or charge above the fraction line.

        `V` of `V.s/m` and `mV` of `mV/g`; all that stands there if nothing is a voltage or charge.
        """
        above = self.unit.partition("/")[0].strip("() ")
        electric = (unit for unit in re.split(r"[.·*\s-]+", above) if unit_fits(unit, ("V", "C")))
        return next(electric, above)


_METHODS = (
    *("full", "serep", "guyan", "dynamic", "irs", "craig-bampton", "modal", "joint-aware"),
    "joint-aware-modes",  # without residual vectors
)
_SOLVERS = ("dense", "ldl", "splu", "cholespy", "pardiso")
_HOLDS = ("spline", "linear", "zero")

#: The choices in every kind of scene, the quickest to try first, and their alternatives.
ASPECTS: dict[str, dict[str, tuple[str, ...]]] = {
    "bond-graph": {"engine": ("exact", "float", "symbolic"), "propagation": ("exact", *_HOLDS)},
    "identification": {
        "modes": _SOLVERS,
        "propagation": ("exact", *_HOLDS),
        "estimator": ("auto", "output-error", "filter", "invariant-imbedding"),
        "hold": ("as-written", *_HOLDS),
        "basis": _METHODS,
    },
    "reduction": {"modes": _SOLVERS, "basis": _METHODS},
}
#: Results that an engine computes.
ENGINE_RESULTS = {"transfer_function", "zeros", "poles", "properties", "hidden_modes"}


class AccuracyModel(Section):
    """Alternatives to the choices of a run, number of repeats, and time limit (s)."""

    alternatives: dict[str, list[str] | Literal["all"]] | None = Field(default=None, min_length=1)
    repeats: int = Field(default=3, ge=1, le=1000, strict=True)
    budget: float = Field(default=60.0, gt=0, le=1e6, strict=True)


def aspects_of(scene: SceneModel) -> list[str]:
    """Return the aspects in which a scene chooses between alternatives, the quickest to try first."""
    return [name for name in ASPECTS[scene.kind] if name in scene.aspects]


def accuracy_faults(scene: SceneModel) -> Iterator[Located]:
    """Yield the faults of the alternatives: unknown ones, and choices that the scene does not make."""
    accuracy: AccuracyModel | None = getattr(scene, "accuracy", None)
    kind, alternatives = scene.kind, accuracy.alternatives if accuracy is not None else None
    for aspect, names in (alternatives or {}).items():
        path = ("accuracy", "alternatives", aspect)
        if aspect not in ASPECTS[kind]:
            options = f"a scene of kind {kind} chooses {', '.join(ASPECTS[kind])}"
            message = f"'{aspect}' is no choice of a run; {options}{did_you_mean(aspect, ASPECTS[kind])}"
            yield (*path, AT_KEY), message
            continue
        if aspect not in scene.aspects:
            yield (*path, AT_KEY), f"nothing in this scene is {_MISSING[aspect]}"
        for index, name in enumerate(names if isinstance(names, list) else []):
            if name not in (choices := ASPECTS[kind][aspect]):
                options = f"it is one of {', '.join(choices)}{did_you_mean(name, choices)}"
                yield (*path, index), f"there is no alternative '{name}'; {options}"


_MISSING = {
    "engine": "computed by an engine: 'results' asks for no transfer function, zeros, poles or properties",
    "propagation": "propagated: there is no 'analysis.time', or an impulse or initial state alone drives it",
    "estimator": "estimated: there is no 'measurement'",
    "basis": "reduced for an estimate: a record of a structure is, unless a reduced model simulates it",
    "hold": "held: no force is known by samples alone",
    "modes": "asked for its modes: there is no 'analysis.modes'",
}
