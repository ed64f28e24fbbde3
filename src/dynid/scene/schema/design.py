"""Design in the scene of a graph: free parameters, wanted zeros and poles, norms to minimise."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from dynid.arithmetic.expression import ExpressionError, parse
from dynid.scene.schema.base import Band, DefinedParameter, Section, short_for
from dynid.scene.schema.graph_variables import Output, SourceName
from dynid.scene.schema.quantities import AT_KEY, Located, NotNegative, Positive, Value, fault
from dynid.suggestions import did_you_mean


class FreeModel(Section):
    """A free parameter: its start and limits."""

    start: Value | None = None
    min: Value | None = None
    max: Value | None = None
    scale: Literal["log", "linear"] | None = None

    @model_validator(mode="after")
    def _is_in_order(self) -> Self:
        low = -math.inf if self.min is None else float(self.min)
        high = math.inf if self.max is None else float(self.max)
        if not low < high:
            raise fault("'min' is not below 'max'")
        if self.start is not None and not low <= float(self.start) <= high:
            raise fault("'start' does not lie between 'min' and 'max'")
        for key in ("start", "min", "max"):
            number = getattr(self, key)
            if self.scale == "log" and number is not None and float(number) <= 0:
                raise fault(
                    f"'{key}' is {float(number):g}; with 'scale: log' the parameter is positive: "
                    "write 'scale: linear' where zero or negative values are possible"
                )
        return self


class RootModel(Section):
    """A wanted zero or pole: its natural frequency, and its damping ratio where that matters."""

    frequency: Positive
    damping: Value | None = None
    unit: Literal["rad/s", "Hz"] | None = None

    @model_validator(mode="after")
    def _is_a_ratio(self) -> Self:
        if self.damping is not None and abs(float(self.damping)) > 1:
            raise fault(
                f"a damping ratio lies between -1 and 1, not at {float(self.damping):g}; two real roots are "
                "two targets of damping 1"
            )
        return self


_RootPlace = Annotated[RootModel, short_for("frequency", RootModel | float | str)]


#: Margins of loops that may be targets.
MARGIN_TARGETS = ("phase_margin", "gain_margin", "Ms", "Mt")


class DesignTarget(Section):
    """A target: a zero, a pole or a margin that is wanted, a norm to minimise, or a parameter to maximise."""

    zero: _RootPlace | None = None
    pole: _RootPlace | None = None
    minimise: Literal["peak", "h2", "hinf"] | None = None
    phase_margin: Positive | None = None
    gain_margin: Positive | None = None
    Ms: Positive | None = None
    Mt: Positive | None = None
    maximise: str | None = None
    loop: int | None = Field(default=None, ge=1, strict=True)
    output: Output | None = None
    input: SourceName | None = None
    unit: Literal["rad/s", "Hz"] = "rad/s"
    band: Band[NotNegative] | None = None
    weight: Positive | None = None

    @property
    def margin(self) -> str | None:
        """The margin that is wanted; None of another target."""
        return next((kind for kind in MARGIN_TARGETS if getattr(self, kind) is not None), None)

    @property
    def frequency_unit(self) -> str:
        """Unit of its frequencies, which stands beside them or beside the root."""
        root = self.zero or self.pole
        return (root.unit if root is not None else None) or self.unit

    @model_validator(mode="after")
    def _is_one_of_them(self) -> Self:
        kinds = ("zero", "pole", "minimise", *MARGIN_TARGETS, "maximise")
        if [getattr(self, kind) is None for kind in kinds].count(False) != 1:
            values = {"minimise": "peak | h2 | hinf"}
            forms = ", ".join(f"{{{kind}: {values.get(kind, '…')}}}" for kind in kinds)
            raise fault(f"a target is one of {forms}")
        if self.loop is not None and self.margin is None:
            raise fault(f"'loop' belongs to a margin: {', '.join(MARGIN_TARGETS)}")
        if self.margin in ("gain_margin", "Ms") and not float(getattr(self, self.margin)) > 1:
            raise fault(f"'{self.margin}' is a factor above 1")
        if self.band is not None and self.minimise != "peak":
            raise fault("'band' belongs to 'minimise: peak'; the other norms are over all frequencies")
        if self.weight is not None and self.minimise is None:
            raise fault("'weight' belongs to norms to minimise; zeros and poles are met exactly")
        return self


def _with_defaults(raw: Any) -> Any:
    return raw if isinstance(raw, dict) else {} if raw is None else {"start": raw}


_FreeEntry = Annotated[
    FreeModel, BeforeValidator(_with_defaults, json_schema_input_type=FreeModel | float | str | None)
]
"""A free parameter, its start alone, or nothing: it starts at its value."""


class DesignModel(Section):
    """A design: free parameters and targets; all results are those of the designed graph."""

    free: dict[str, _FreeEntry] = Field(min_length=1, max_length=50)
    targets: list[DesignTarget] = Field(min_length=1, max_length=50)
    starts: int = Field(default=5, ge=1, le=1000, strict=True)
    seed: int = Field(default=0, ge=0, strict=True)
    compare: dict[str, dict[str, Value]] = {}

    def faults(
        self, parameters: Mapping[str, Any], nodes: Collection[str], outputs: list[str], inputs: list[str]
    ) -> Iterator[Located]:
        """Yield free parameters that there are not, and targets whose channel is not said."""
        for name in self.free:
            if problem := _parameter_problem(name, parameters, nodes):
                yield ("design", "free", name, AT_KEY), problem
        for title, values in self.compare.items():
            for name in values:
                problem = _parameter_problem(name, parameters, nodes)
                if not problem and name not in self.free:
                    problem = f"'{name}' is not free; values to compare are those of free parameters"
                if problem:
                    yield ("design", "compare", title, name, AT_KEY), problem
        for index, target in enumerate(self.targets):
            if target.maximise is not None and target.maximise not in self.free:
                message = f"'{target.maximise}' is not free; maximise one of {', '.join(self.free)}"
                yield ("design", "targets", index, "maximise"), message
            if target.maximise is not None or target.margin is not None:
                continue
            for key, names in (("output", outputs), ("input", inputs)):
                if getattr(target, key) is None and len(names) != 1:
                    several = f"several: {', '.join(names)}" if names else "none"
                    message = f"the target needs an '{key}'; the analysis has {several}"
                    yield ("design", "targets", index), message

    @property
    def of_loops(self) -> bool:
        """True if its targets are margins, which have delays as they are."""
        return all(target.margin or target.maximise for target in self.targets)

    def loop_faults(self, count: int) -> Iterator[Located]:
        """Yield margins of loops that there are not, of a graph with `count` loops."""
        for index, target in enumerate(self.targets):
            if target.margin is not None and (target.loop or 1) > count:
                there = f"there are {count}" if count else "there are none: close loops with 'control'"
                yield ("design", "targets", index, AT_KEY), f"no loop {target.loop or 1}; {there}"


def _parameter_problem(name: str, parameters: Mapping[str, Any], nodes: Collection[str]) -> str:
    """Return why a name is no parameter with a value of its own; empty where it is one."""
    if name not in parameters:
        close = did_you_mean(name, parameters)
        if not close and name in nodes:
            close = f"; '{name}' is a node: name its value in 'parameters', and free that"
        return f"no parameter '{name}'{close}"
    entry = parameters[name]
    expression = entry.reference.expression if isinstance(entry, DefinedParameter) else None
    try:
        expression = parse(entry) if isinstance(entry, str) else expression
    except ExpressionError:
        return ""  # reported where it is defined
    if expression is None or not expression.names:
        return ""
    names = ", ".join(sorted(expression.names))
    return f"'{name}' is computed from {names}; free these, or write a number for it"
