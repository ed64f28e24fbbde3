"""Feedback in the scene of a graph: loops from a variable through a controller to a source."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Annotated, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from dynid.bondgraph.analysis_request import Discretisation
from dynid.defaults import ANSWERS_UNDER_WAY
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
    """A controller: a PID, a rational function of s, or a gain; each may have a delay, or be sampled."""

    pid: PidModel | None = None
    numerator: Coefficients | None = None
    denominator: Coefficients | None = None
    gain: Uncertain | None = None
    delay: UncertainNotNegative | None = None
    sample: UncertainPositive | None = None
    computation: UncertainNotNegative | None = None
    method: Discretisation | None = None

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
        raise_faults(self._sampling_faults())
        return self

    def _sampling_faults(self) -> Iterator[Located]:
        """Yield the faults of a sampled controller."""
        if self.sample is None:
            for key in {"computation", "method"} & self.model_fields_set:
                yield (key, AT_KEY), f"'{key}' is of a sampled controller; add its 'sample', the period in s"
            return
        if self.delay is not None:
            message = "a sampled controller has no 'delay'; write 'computation', from sample to answer"
            yield ("delay", AT_KEY), message
        longest = ANSWERS_UNDER_WAY.value
        if self.computation is not None and self.computation.exact > longest * self.sample.exact:
            message = f"an answer takes at most {longest} periods 'sample'; lengthen the period"
            yield ("computation",), message
        top, bottom = self.numerator or (), self.denominator or ()
        if self.method == "z":
            if self.pid is not None:
                yield (
                    ("method",),
                    "'z' reads coefficients in z; write 'numerator' and 'denominator'",
                )
            elif len(top) > len(bottom) > 0:
                yield ("numerator", AT_KEY), "it answers to samples not yet measured; add poles at z = 0"
        if self.method == "zoh":
            pid = self.pid
            if len(top) > len(bottom) > 0 or (pid is not None and pid.kd is not None and pid.tf is None):
                message = "'zoh' needs a controller with as many poles as zeros; filter its derivative"
                yield ("method",), f"{message}, or choose tustin"


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
        periods = [
            (index, loop.controller.sample)
            for index, loop in enumerate(self.loops)
            if loop.controller.sample is not None
        ]
        for index, period in periods:
            path = ("loops", index, "controller", "sample")
            if linear:
                message = "a sampled loop is not identified; write the controller without 'sample'"
                yield (*path, AT_KEY), message
            elif period.exact != periods[0][1].exact:
                first = float(periods[0][1])
                yield path, f"loops are sampled together; write the period of the first, {first:g}"

    @property
    def sampled(self) -> bool:
        """True if its loops are sampled."""
        return any(loop.controller.sample is not None for loop in self.loops)
