"""Feedback in the scene of a graph: loops from a variable through a controller to a source."""

from __future__ import annotations

from itertools import product
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from dynid.errors import Fault
from dynid.scene.schema.base import Section
from dynid.scene.schema.graph_variables import Output, SourceName
from dynid.scene.schema.quantities import Uncertain, UncertainNotNegative, UncertainPositive, fault
from dynid.scene.schema.raw import (
    is_mapping_of_mappings,
    listing,
    mapping,
    mapping_of,
    node_types,
    references,
)
from dynid.scene.yaml.source import Source

Coefficients = Annotated[list[Uncertain], Field(min_length=1, max_length=50)]


#: Most loops with delays: the terms of their characteristic function double with each.
MOST_DELAYS = 8


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


class ControlModel(Section):
    """Feedback, which closes loops around the graph."""

    loops: list[LoopModel] = Field(min_length=1)


def control_faults(source: Source) -> list[Fault]:
    """Return the faults of references and setpoints, and of inputs that loops drive."""
    types, faults, seen = node_types(source.data), list[Fault](), dict[str, str]()
    loops = listing(mapping(source.data, "control"), "loops")
    every = enumerate(loops if is_mapping_of_mappings(dict(enumerate(loops))) else [])
    for (place, loop), key in product(every, ("reference", "setpoint")):
        name, path = loop.get(key), ("control", "loops", place, key)
        if name is None or not isinstance(name, str):
            continue
        if name in types or name in seen:
            what = "a node" if name in types else f"the {seen[name]} of another loop"
            faults.append(source.fault(path, f"'{name}' is {what}; use another name"))
        elif not name.isidentifier():
            faults.append(source.fault(path, f"'{name}' cannot name a {key}; use letters, digits and _"))
        seen.setdefault(name, key)
    driven = {str(loop.get("to")) for loop in loops if isinstance(loop, dict)}
    for place, name in enumerate(listing(mapping(source.data, "analysis"), "inputs")):
        if str(name) in driven:
            known = list(references(source.data)) or ["reference: r", "setpoint: w"]
            message = (
                f"'{name}' is driven by a loop; the input is its reference or setpoint ({', '.join(known)})"
            )
            faults.append(source.fault(("analysis", "inputs", place), message))
    return [*faults, *_delay_faults(source, [mapping_of(loop) for loop in loops])]


def _delay_faults(source: Source, loops: list[dict[Any, Any]]) -> list[Fault]:
    """Return the faults of what is not computed where loops have delays."""
    late = [
        place for place, loop in enumerate(loops) if mapping(loop, "controller").get("delay") not in (None, 0)
    ]
    if not late:
        return []
    remedy = "leave it out, or write the delay as a rational function (numerator, denominator)"
    first = ("control", "loops", late[0], "controller", "delay")
    if source.data.get("kind") == "identification":
        message = f"a loop with a delay is not identified; {remedy}"
        return [source.fault(first, message, key=True)]
    faults = []
    if len(late) > MOST_DELAYS:
        faults.append(
            source.fault(("control", "loops"), f"at most {MOST_DELAYS} loops may have a delay", key=True)
        )
    analysis = mapping(source.data, "analysis")
    results = analysis.get("results")
    message = f"a time response is not computed where a loop has a delay; {remedy}"
    if isinstance(results, list):
        places = [place for place, name in enumerate(results) if name == "time_response"]
        faults += [source.fault(("analysis", "results", place), message) for place in places]
    elif analysis.get("time") is not None:
        faults.append(source.fault(("analysis", "time"), message, key=True))
    return faults
