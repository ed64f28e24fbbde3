"""Design in the scene of a graph: free parameters, wanted zeros and poles, norms to minimise."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from dynid.arithmetic.expression import ExpressionError, parse
from dynid.bondgraph.graph import SOURCES
from dynid.errors import Fault
from dynid.scene.schema.base import Section
from dynid.scene.schema.graph_variables import Output, SourceName
from dynid.scene.schema.quantities import NotNegative, Positive, Value, fault
from dynid.scene.schema.raw import (
    is_mapping_of_mappings,
    listing,
    mapping,
    mapping_of,
    node_types,
    reference_values,
    references,
    written_key,
)
from dynid.scene.yaml.source import Source
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
            given = getattr(self, key)
            if self.scale == "log" and given is not None and float(given) <= 0:
                raise fault(
                    f"'{key}' is {float(given):g}; with 'scale: log' the parameter is positive: "
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


def _frequency_alone(raw: Any) -> Any:
    return raw if isinstance(raw, dict) else {"frequency": raw}


RootPlace = Annotated[
    RootModel, BeforeValidator(_frequency_alone, json_schema_input_type=RootModel | float | str)
]


class DesignTarget(Section):
    """A target: a zero or a pole that is wanted, or a norm to minimise, of a channel."""

    zero: RootPlace | None = None
    pole: RootPlace | None = None
    minimise: Literal["peak", "h2", "hinf"] | None = None
    output: Output | None = None
    input: SourceName | None = None
    unit: Literal["rad/s", "Hz"] = "rad/s"
    band: Annotated[list[NotNegative], Field(min_length=2, max_length=2)] | None = None
    weight: Positive | None = None

    @property
    def frequency_unit(self) -> str:
        """Unit of its frequencies, which stands beside them or beside the root."""
        root = self.zero or self.pole
        return (root.unit if root is not None else None) or self.unit

    @model_validator(mode="after")
    def _is_one_of_them(self) -> Self:
        if [self.zero is None, self.pole is None, self.minimise is None].count(False) != 1:
            raise fault("a target is one of {zero: …}, {pole: …}, {minimise: peak | h2 | hinf}")
        if self.band is not None and self.minimise != "peak":
            raise fault("'band' belongs to 'minimise: peak'; the other norms are over all frequencies")
        if self.band is not None and not float(self.band[0]) < float(self.band[1]):
            raise fault("the first frequency of 'band' is not below the second")
        if self.weight is not None and self.minimise is None:
            raise fault("'weight' belongs to norms to minimise; zeros and poles are met exactly")
        return self


def _with_defaults(raw: Any) -> Any:
    return raw if isinstance(raw, dict) else {} if raw is None else {"start": raw}


FreeEntry = Annotated[
    FreeModel, BeforeValidator(_with_defaults, json_schema_input_type=FreeModel | float | str | None)
]
"""A free parameter, its start alone, or nothing: it starts at its value."""


class DesignModel(Section):
    """A design: free parameters and targets; all results are those of the designed graph."""

    free: dict[str, FreeEntry] = Field(min_length=1, max_length=50)
    targets: list[DesignTarget] = Field(min_length=1, max_length=50)
    starts: int = Field(default=5, ge=1, le=1000, strict=True)
    seed: int = Field(default=0, ge=0, strict=True)
    compare: dict[str, dict[str, Value]] = {}


def design_faults(source: Source) -> list[Fault]:
    """Return the faults of names: free parameters that there are not, and channels that are not said."""
    design = mapping(source.data, "design")
    given = mapping(source.data, "parameters")
    written = reference_values(given)
    faults = [
        found
        for path, name in _named(design)
        if (found := _parameter_fault(source, path, name, written)) is not None
    ]
    free = [str(name) for name in mapping(design, "free")]
    for title, values in mapping(design, "compare").items():
        for name in mapping_of(values):
            if str(name) in written and str(name) not in free:
                message = f"'{name}' is not free; values to compare are those of free parameters"
                faults.append(source.fault(("design", "compare", title, name), message, key=True))
    late = [
        ("control", "loops", place, "controller", "delay")
        for place, loop in enumerate(listing(mapping(source.data, "control"), "loops") if design else [])
        if mapping(loop, "controller").get("delay") not in (None, 0)
    ]
    message = "a graph with a delay in a loop is not designed; write it as {numerator: …, denominator: …}"
    return [
        *faults,
        *_channel_faults(source, design),
        *(source.fault(path, message, key=True) for path in late),
    ]


def _named(design: dict[Any, Any]) -> list[tuple[tuple[Any, ...], str]]:
    """Return the places of names of free parameters, with the names."""
    found: list[tuple[tuple[Any, ...], str]] = [
        (("design", "free", name), str(name)) for name in mapping(design, "free")
    ]
    for title, values in mapping(design, "compare").items():
        found += [(("design", "compare", title, name), str(name)) for name in mapping_of(values)]
    return found


def _parameter_fault(
    source: Source, path: tuple[Any, ...], name: str, written: dict[str, Any]
) -> Fault | None:
    """Return the fault of a name that is no parameter with a value of its own."""
    if name not in written:
        close = did_you_mean(name, written)
        nodes = mapping(mapping(source.data, "graph"), "nodes")
        if not close and written_key(nodes, name) in nodes:
            close = f"; '{name}' is a node: name its value in 'parameters', and free that"
        return source.fault(path, f"no parameter '{name}'{close}", key=True)
    text = written[name]
    if isinstance(text, str):
        try:
            used = sorted(parse(text).names)
        except ExpressionError:
            return None  # reported where it is defined
        if used:
            message = f"'{name}' is computed from {', '.join(used)}; free these, or write a number for it"
            return source.fault(path, message, key=True)
    return None


def _channel_faults(source: Source, design: dict[Any, Any]) -> list[Fault]:
    """Return targets without output or input where there are several to choose from."""
    analysis, faults = mapping(source.data, "analysis"), []
    outputs = [str(one) for one in listing(analysis, "outputs")]
    sources = node_types(source.data) | references(source.data)
    inputs = [str(one) for one in listing(analysis, "inputs")]
    loops = listing(mapping(source.data, "control"), "loops")
    driven = {str(mapping_of(loop).get("to")) for loop in loops}
    inputs = inputs or [name for name, kind in sources.items() if kind in SOURCES and name not in driven]
    targets = listing(design, "targets")
    for place, target in enumerate(targets if is_mapping_of_mappings(dict(enumerate(targets))) else []):
        for key, known in (("output", outputs), ("input", inputs)):
            if key not in target and len(known) != 1:
                several = f"several: {', '.join(known)}" if known else "none"
                message = f"the target needs an '{key}'; the analysis has {several}"
                faults.append(source.fault(("design", "targets", place), message))
    return faults
