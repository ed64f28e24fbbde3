"""Feedback in the scene of a graph: loops from a variable through a controller to a source."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from dynid.scene.schema.base import Section
from dynid.scene.schema.graph_variables import Output, SourceName
from dynid.scene.schema.quantities import (
    AT_KEY,
    Located,
    Uncertain,
    UncertainNotNegative,
    UncertainPositive,
    fault,
)

if TYPE_CHECKING:
    from dynid.scene.schema.bond_graph import BondGraphScene
    from dynid.scene.schema.identification import IdentificationScene

Coefficients = Annotated[list[Uncertain], Field(min_length=1, max_length=50)]


#: Most loops with delays: the terms of their characteristic function double with each.
MAX_DELAYS = 8


class PidModel(Section):
    """Gains of a PID controller: kp + ki/s + kd s/(tf s + 1)."""

    kp: Uncertain | None = None
    ki: Uncertain | None = None
    kd: Uncertain | None = None
    tf: UncertainPositive | None = None

    @model_validator(mode="after")
    def _has_a_gain(self) -> Self:
        if self.kp is None and self.ki is None and self.kd is None:
            raise fault("a PID controller has a gain: kp, ki or kd")
        if self.tf is not None and self.kd is None:
            raise fault("'tf' filters the derivative; there is no 'kd'")
        return self


class ControllerModel(Section):
    """A controller: a PID, a rational function of s, or a gain; each may have a delay."""

    pid: PidModel | None = None
    numerator: Coefficients | None = None
    denominator: Coefficients | None = None
    gain: Uncertain | None = None
    delay: UncertainNotNegative | None = None

    @model_validator(mode="after")
    def _is_one_of_them(self) -> Self:
        rational = self.numerator is not None or self.denominator is not None
        if [self.pid is not None, rational, self.gain is not None].count(True) != 1:
            raise fault("a controller is one of {pid: {…}}, {numerator: […], denominator: […]}, {gain: …}")
        if rational and (self.numerator is None or self.denominator is None):
            raise fault(
                "'numerator' and 'denominator' belong together; coefficients in descending powers of s"
            )
        if self.denominator is not None and not any(entry.value for entry in self.denominator):
            raise fault("the denominator is zero")
        return self


class LoopModel(Section):
    """A loop: the source gives reference + controller · (setpoint - what is measured)."""

    measured: Output = Field(alias="from")
    source: SourceName = Field(alias="to")
    controller: ControllerModel
    reference: str = ""
    setpoint: str = ""

    @field_validator("reference", "setpoint")
    @classmethod
    def _is_a_name(cls, name: str, info: ValidationInfo) -> str:
        if name and not name.isidentifier():
            raise fault(f"'{name}' cannot name a {info.field_name}; use letters, digits and _")
        return name

    @property
    def has_delay(self) -> bool:
        """True if its controller has a delay."""
        delay = self.controller.delay
        return delay is not None and float(delay) != 0


class ControlModel(Section):
    """Feedback, which closes loops around the graph."""

    loops: list[LoopModel] = Field(min_length=1)


def control_faults(scene: BondGraphScene | IdentificationScene) -> Iterator[Located]:
    """Yield the faults of references, setpoints and delays, and of inputs that loops drive."""
    assert scene.control is not None
    loops, seen = scene.control.loops, dict[str, str]()
    nodes = scene.graph.nodes if scene.graph is not None else {}
    for (index, loop), key in product(enumerate(loops), ("reference", "setpoint")):
        if name := getattr(loop, key):
            path = ("control", "loops", index, key)
            if name in nodes or name in seen:
                what = "a node" if name in nodes else f"the {seen[name]} of another loop"
                yield path, f"'{name}' is {what}; use another name"
            seen.setdefault(name, key)
    driven = {loop.source for loop in loops}
    signals = ", ".join(seen) or "reference: r, setpoint: w"
    for index, name in enumerate(getattr(scene.analysis, "inputs", None) or ()):
        if name in driven:
            message = f"'{name}' is driven by a loop; the input is its reference or setpoint ({signals})"
            yield ("analysis", "inputs", index), message
    yield from _delay_faults(scene, [index for index, loop in enumerate(loops) if loop.has_delay])


def _delay_faults(scene: BondGraphScene | IdentificationScene, late: list[int]) -> Iterator[Located]:
    """Yield the faults of what is not computed where loops have delays; `late` are the loops that do."""
    if not late:
        return
    remedy = "leave it out, or write the delay as a rational function (numerator, denominator)"
    if scene.kind == "identification":
        path = ("control", "loops", late[0], "controller", "delay", AT_KEY)
        yield path, f"a loop with a delay is not identified; {remedy}"
        return
    if len(late) > MAX_DELAYS:
        yield ("control", "loops", AT_KEY), f"at most {MAX_DELAYS} loops may have a delay"
    if scene.design is not None:
        message = "a graph with a delay in a loop is not designed; write it as {numerator: …, denominator: …}"
        yield from ((("control", "loops", index, "controller", "delay", AT_KEY), message) for index in late)
    message = f"a time response is not computed where a loop has a delay; {remedy}"
    if scene.analysis.results is None and scene.analysis.time is not None:
        yield ("analysis", "time", AT_KEY), message
    for index, name in enumerate(scene.analysis.results or ()):
        if name == "time_response":
            yield ("analysis", "results", index), message
