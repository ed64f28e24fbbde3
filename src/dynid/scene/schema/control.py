"""Feedback in the scene of a graph: loops from a variable through a controller to a source."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Annotated, Self

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
    names_of,
    raise_faults,
)
from dynid.scene.schema.references import Path

Coefficients = Annotated[list[Uncertain], Field(min_length=1, max_length=50)]


#: Most loops with delays: the terms of their characteristic function double with each.
_MAX_DELAYS = 8
DELAY_REMEDY = "leave it out, or write the delay as a rational function (numerator, denominator)"


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


class ControlModel(Section):
    """Feedback, which closes loops around the graph."""

    loops: list[LoopModel] = Field(min_length=1)

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> Self:
        names = names_of(info)
        raise_faults(self._faults(names.nodes, linear=names.linear))
        return self

    @property
    def driven(self) -> set[str]:
        """The sources that loops drive."""
        return {loop.source for loop in self.loops}

    @property
    def signals(self) -> list[str]:
        """The references and setpoints, which are sources of the closed loop."""
        return [name for loop in self.loops for name in (loop.reference, loop.setpoint) if name]

    @property
    def delays(self) -> list[Path]:
        """The paths of the delays in its loops."""
        return [
            ("control", "loops", index, "controller", "delay")
            for index, loop in enumerate(self.loops)
            if loop.controller.delay is not None and float(loop.controller.delay)
        ]

    def input_faults(self, inputs: Sequence[str] | None) -> Iterator[Located]:
        """Yield the inputs of an analysis that loops drive."""
        signals = ", ".join(self.signals) or "reference: r, setpoint: w"
        for index, name in enumerate(inputs or ()):
            if name in self.driven:
                message = f"'{name}' is driven by a loop; the input is its reference or setpoint ({signals})"
                yield ("analysis", "inputs", index), message

    def _faults(self, nodes: Mapping[str, str], *, linear: bool) -> Iterator[Located]:
        """Yield references and setpoints with the name of something else, and delays that cannot be."""
        seen = dict[str, str]()
        for (index, loop), key in product(enumerate(self.loops), ("reference", "setpoint")):
            if name := getattr(loop, key):
                if name in nodes or name in seen:
                    what = "a node" if name in nodes else f"the {seen[name]} of another loop"
                    yield ("loops", index, key), f"'{name}' is {what}; use another name"
                seen.setdefault(name, key)
        if linear and self.delays:
            yield (*self.delays[0][1:], AT_KEY), f"a loop with a delay is not identified; {DELAY_REMEDY}"
        elif len(self.delays) > _MAX_DELAYS:
            yield ("loops", AT_KEY), f"at most {_MAX_DELAYS} loops may have a delay"
