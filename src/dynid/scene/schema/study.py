"""Scenes of kind `study`: one scene, many values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    WithJsonSchema,
    model_validator,
)

from dynid.scene.schema.base import FilePath, SceneModel, Section
from dynid.scene.schema.quantities import Positive, Value, fault
from dynid.suggestions import did_you_mean

#: More would not fit into one file, nor their plan into memory.
MAX_SAMPLES = 10_000_000


def _is_plain(raw: Any) -> Any:
    if isinstance(raw, bool | int | float | str | list | dict):
        return raw
    raise fault("a value is a number, a text, true, false, or a list or mapping of these")


Plain = Annotated[Any, PlainValidator(_is_plain), WithJsonSchema({"description": "a value of the scene"})]


def _or_bare(schema: dict[str, Any]) -> None:
    """Allow a list without the key `values` in a JSON Schema."""
    mapping_schema = dict(schema)
    schema.clear()
    schema["anyOf"] = [mapping_schema, {"type": "array", "minItems": 1}]


class Listed(Section):
    """Values, one by one; under several paths, a list of values for each."""

    model_config = ConfigDict(json_schema_extra=_or_bare)

    values: list[Plain] = Field(min_length=1, max_length=MAX_SAMPLES)
    name: str | None = None


class Spread(Section):
    """Values at even distances; where they are drawn, any value between."""

    start: Value
    stop: Value
    points: int | None = Field(default=None, ge=1, le=MAX_SAMPLES, strict=True)
    scale: Literal["linear", "log"] = "linear"
    name: str | None = None

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if self.scale == "log" and not float(self.start) * float(self.stop) > 0:
            raise fault("a logarithmic scale has two ends of the same sign, neither of them 0")
        if self.points == 1 and float(self.start) != float(self.stop):
            raise fault("one point cannot be at both 'start' and 'stop'")
        return self


class _Distribution(Section):
    """Keys of every distribution; `points` is the number of equally likely values in a grid."""

    points: int | None = Field(default=None, ge=1, le=MAX_SAMPLES, strict=True)
    name: str | None = None


class Uniform(_Distribution):
    """Evenly between two bounds: the value, its logarithm, or the whole numbers there, both ends included."""

    distribution: Literal["uniform", "loguniform", "integer"]
    low: Value
    high: Value

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if float(self.low) >= float(self.high):
            raise fault("'low' is not below 'high'")
        if self.distribution == "loguniform" and float(self.low) <= 0:
            raise fault("'low' of a log-uniform distribution is above 0")
        if self.distribution == "integer" and any(q.exact.denominator != 1 for q in (self.low, self.high)):
            raise fault("'low' and 'high' of whole numbers are whole numbers")
        return self


class Normal(_Distribution):
    """Gaussian, or with a Gaussian logarithm; mean and standard deviation are those of the value itself.

    It is truncated at `low` and `high`.
    """

    distribution: Literal["normal", "lognormal"]
    mean: Value
    std: Positive
    low: Value | None = None
    high: Value | None = None

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if self.distribution == "lognormal" and float(self.mean) <= 0:
            raise fault("'mean' of a lognormal distribution is above 0")
        if self.low is not None and self.high is not None and float(self.low) >= float(self.high):
            raise fault("'low' is not below 'high'")
        if self.distribution == "lognormal" and self.high is not None and float(self.high) <= 0:
            raise fault("'high' of a lognormal distribution is above 0")
        return self


class Triangular(_Distribution):
    """A triangle from `low` over its peak at `mode` to `high`."""

    distribution: Literal["triangular"]
    low: Value
    mode: Value
    high: Value

    @model_validator(mode="after")
    def _is_a_triangle(self) -> Self:
        if not float(self.low) <= float(self.mode) <= float(self.high) or self.low.value == self.high.value:
            raise fault("'low', 'mode' and 'high' do not follow each other")
        return self


_FORMS = {
    "uniform": "uniform",
    "loguniform": "uniform",
    "integer": "uniform",
    "normal": "normal",
    "lognormal": "normal",
    "triangular": "triangular",
}
_MODELS: dict[str, type[_Distribution]] = {"uniform": Uniform, "normal": Normal, "triangular": Triangular}
#: Names of other programs for the keys of distributions.
_OTHER_NAMES = {"min": "low", "max": "high", "mu": "mean", "sigma": "std"}


def _form_of(raw: Any) -> str:
    """Return the form of a factor, which its keys determine."""
    if isinstance(raw, dict) and "distribution" in raw:
        return _FORMS[raw["distribution"]]
    return "range" if isinstance(raw, dict) and {"start", "stop", "scale"} & raw.keys() else "values"


def _as_mapping(raw: Any) -> Any:
    """Return a factor as a mapping: a bare list is its values."""
    if isinstance(raw, list):
        return {"values": raw}
    if not isinstance(raw, dict) or raw.keys().isdisjoint({"values", "start", "stop", "distribution"}):
        kinds = ", ".join(_FORMS)
        raise fault(f"what varies has 'values', 'start' and 'stop', or a 'distribution': {kinds}")
    name = raw.get("distribution", "uniform")
    if not isinstance(name, str) or name not in _FORMS:
        hint = did_you_mean(str(name), _FORMS)
        raise fault(f"there is no distribution '{name}'; it is one of {', '.join(_FORMS)}{hint}")
    if "distribution" in raw:
        fields = _MODELS[_FORMS[name]].model_fields
        needed = [key for key, field in fields.items() if field.is_required() and key != "distribution"]
        names = ((key, name) for key, name in _OTHER_NAMES.items() if name in fields)
        renamed = [(key, name) for key, name in names if key in raw]
        if renamed or not all(key in raw for key in needed):
            hint = "".join(f"; write '{field_name}' for '{key}'" for key, field_name in renamed)
            raise fault(f"distribution '{name}' needs the keys {', '.join(needed)}{hint}")
    return raw


StudyFactor = Annotated[
    Annotated[Listed, Tag("values")]
    | Annotated[Spread, Tag("range")]
    | Annotated[Uniform, Tag("uniform")]
    | Annotated[Normal, Tag("normal")]
    | Annotated[Triangular, Tag("triangular")],
    Discriminator(_form_of),
    BeforeValidator(_as_mapping),
]
"""Variation of one value of the scene, or of several together."""

Paths = Annotated[list[str], Field(min_length=2)]


class Correlation(Section):
    """Correlation of two drawn values, as that of their normal scores."""

    between: list[str] = Field(min_length=2, max_length=2)
    value: float = Field(gt=-1, lt=1)


class Sampling(Section):
    """Sampling of the varied values."""

    method: Literal["grid", "list", "random", "latin-hypercube", "sobol"] = "grid"
    samples: int | None = Field(default=None, ge=1, le=MAX_SAMPLES, strict=True)
    seed: int = Field(default=0, ge=0, strict=True)
    correlation: list[Correlation] = []
    indices: bool = False


class StudyScene(SceneModel):
    """A scene, its varied values, and the collected results."""

    kind: Literal["study"]
    scene: FilePath = Field(min_length=1)
    vary: dict[str, StudyFactor] = Field(min_length=1)
    derive: dict[str, str] = {}
    zip: list[Paths] = []
    sampling: Sampling = Sampling()
    collect: list[Annotated[str, Field(min_length=1)]] = []

    @property
    def varied(self) -> list[str]:
        """The dotted paths of all keys of `vary`."""
        return [path for key in self.vary for path in paths_of(key)]


def paths_of(key: str) -> tuple[str, ...]:
    """Return the dotted paths in a key of `vary`: one, or several separated by commas."""
    return tuple(path.strip() for path in key.split(","))


def names_of_factor(key: str, factor: StudyFactor) -> tuple[str, ...]:
    """Return the names of the values of a key of `vary` in expressions."""
    paths = paths_of(key)
    if factor.name is not None:
        return paths_of(factor.name)
    return tuple(path.rpartition(".")[2] for path in paths)


def known_names(model: StudyScene, parameters: Iterable[object]) -> dict[str, str]:
    """Return the paths that the names in `derive` refer to: varied and derived values, and parameters.

    A name that two paths share refers to neither.
    """
    factors = ((key, names_of_factor(key, factor)) for key, factor in model.vary.items())
    pairs = [pair for key, named in factors for pair in zip(named, paths_of(key), strict=True)]
    pairs += [(target.rpartition(".")[2], target) for target in model.derive]
    counts = Counter(name for name, _ in pairs)
    names = {name: path for name, path in pairs if counts[name] == 1}
    return {str(name): f"parameters.{name}" for name in parameters} | names


def grid_length(factor: StudyFactor) -> int | None:
    """Return the number of values of a factor on a grid; None where it is not given."""
    return len(factor.values) if isinstance(factor, Listed) else factor.points


def grid_groups(model: StudyScene) -> list[list[str]]:
    """Return the groups of keys of `vary` that vary together, in the order of their first keys."""
    groups, done = [], set()
    for key in model.vary:
        if key not in done:
            group = next((group for group in model.zip if key in group), [key])
            groups.append(group)
            done |= set(group)
    return groups


def grid_size(model: StudyScene) -> int:
    """Return the number of samples of a grid."""
    count = 1
    for group in grid_groups(model):
        count *= grid_length(model.vary[group[0]]) or 1 if group[0] in model.vary else 1
    return count
