"""Feedback in the scene of a graph: loops from a variable through a controller to a source."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import accumulate, product
from math import lcm, sqrt
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from dynid.bondgraph.analysis_request import Discretisation
from dynid.bondgraph.graph import QUANTITIES, Port
from dynid.defaults import ANSWERS_UNDER_WAY, COMMON_SAMPLES
from dynid.number_format import counted
from dynid.scene.schema.base import Section, once, short_for
from dynid.scene.schema.graph_variables import Output, SourceName, variable_or_source
from dynid.scene.schema.quantities import (
    AT_KEY,
    Located,
    NotNegative,
    Positive,
    Quantity,
    Uncertain,
    UncertainNotNegative,
    UncertainPositive,
    Value,
    fault,
    names_of,
    raise_faults,
)
from dynid.scene.schema.references import Path
from dynid.units import angular_factor

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


class LimitsModel(Section):
    """Limits of what a controller gives, and its anti-windup by back-calculation."""

    min: Value
    max: Value
    tracking: Positive | None = None

    @model_validator(mode="after")
    def _hold_rest(self) -> Self:
        if not self.min.exact <= 0 <= self.max.exact or self.min.exact == self.max.exact:
            raise fault("'min' is below 'max', and 0, what a controller gives at rest, is within them")
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
    limits: LimitsModel | None = None

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
        raise_faults([*self._sampling_faults(), *self._limit_faults()])
        return self

    def _limit_faults(self) -> Iterator[Located]:
        """Yield the faults of limits and their anti-windup."""
        if self.limits is None:
            return
        path, order = ("limits", "tracking"), self.integrations
        if self.delay is not None:
            yield ("limits", AT_KEY), "a controller with a 'delay' has no 'limits'; leave one of them out"
        if self.limits.tracking is not None and not order:
            yield path, "the controller does not integrate, and has nothing to track; leave 'tracking' out"
        if order > 1:
            yield ("limits", AT_KEY), "a controller that integrates more than once has no 'limits'"
        elif order and self.tracking_time is None:
            yield ("limits", AT_KEY), "state 'tracking', the time constant of the anti-windup, s"

    @property
    def integrations(self) -> int:
        """The multiplicity of its pole at rest."""
        if self.pid is not None:
            return int(self.pid.ki is not None and bool(self.pid.ki.exact))
        below = [entry.exact for entry in self.denominator or ()]
        if self.method != "z":
            return next((k for k, entry in enumerate(reversed(below)) if entry), 0)
        count = 0
        while below and not sum(below):
            below, count = list(accumulate(below))[:-1], count + 1  # over z - 1
        return count

    @property
    def tracking_time(self) -> Fraction | None:
        """The time constant of the anti-windup, s, of a PID by default kp/ki; None where there is none."""
        if self.limits is None or not self.integrations:
            return None
        if self.limits.tracking is not None:
            return self.limits.tracking.exact
        if self.pid is None or self.pid.kp is None or self.pid.ki is None:
            return None
        time = self.pid.kp.exact / self.pid.ki.exact
        return time if time > 0 else None

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


class StateFeedbackModel(Section):
    """Feedback of a full set of states: what follows a target, and inputs of the closed loops."""

    states: Annotated[list[Output], once(), Field(min_length=1, max_length=50)]
    references: dict[SourceName, str] = {}
    setpoints: dict[str, str] = {}

    @property
    def sources(self) -> list[str]:
        """The sources that are driven."""
        raise NotImplementedError

    @property
    def variables(self) -> list[Output]:
        """The variables of the graph that it depends on."""
        return self.states

    @property
    def signals(self) -> dict[tuple[str, str], str]:
        """The names of its references and setpoints, by the keys under which they stand."""
        groups = {"references": self.references, "setpoints": self.setpoints}
        return {(group, key): name for group, names in groups.items() for key, name in names.items()}

    @model_validator(mode="after")
    def _are_of_it(self) -> Self:
        raise_faults(self._faults())
        return self

    def _faults(self) -> Iterator[Located]:
        """Yield references of sources that are not driven, and setpoints of what is not fed back."""
        for (group, key), name in self.signals.items():
            states = [str(port) for port in self.states]
            among, what = (self.sources, "driven") if group == "references" else (states, "fed back")
            if key not in among:
                yield (group, key, AT_KEY), f"'{key}' is not {what}; there are: {', '.join(among)}"
            if not name.isidentifier():
                yield (group, key), f"'{name}' cannot name an input; use letters, digits and _"


class LqrModel(StateFeedbackModel):
    """State feedback that minimises the integral of weighted squares (LQR)."""

    weights: Annotated[dict[str, NotNegative], Field(min_length=1, max_length=100)]

    @field_validator("weights")
    @classmethod
    def _are_of_the_graph(cls, weights: dict[str, Quantity], info: ValidationInfo) -> dict[str, Quantity]:
        for name in weights:
            variable_or_source(name, info)
        return weights

    @property
    def sources(self) -> list[str]:
        """The sources that are driven: those with a weight."""
        return [name for name in self.weights if not _is_variable(name)]

    @property
    def variables(self) -> list[Output]:
        """The states, and the variables that are weighted."""
        names = (name.rpartition(".") for name in self.weights if _is_variable(name))
        return [*self.states, *(Port(node, quantity) for node, _, quantity in names)]  # type: ignore[arg-type]

    def _faults(self) -> Iterator[Located]:
        """Yield weights without which there is no minimum, too."""
        yield from super()._faults()
        if not self.sources:
            yield ("weights",), "no source has a weight; the sources that are driven have a positive one"
        for name in self.sources:
            if not float(self.weights[name]):
                yield ("weights", name), f"the weight of the driven source '{name}' is not positive"
        if not any(float(weight) for name, weight in self.weights.items() if _is_variable(name)):
            message = "no variable has a positive weight: the least cost is without feedback; weigh a state"
            yield ("weights",), message


class PlacedPoleModel(Section):
    """A pole: real, or a conjugate pair by natural frequency and damping ratio."""

    real: Value | None = None
    frequency: Positive | None = None
    damping: Value | None = None
    unit: Literal["rad/s", "Hz"] = "rad/s"

    @model_validator(mode="after")
    def _is_one_of_them(self) -> Self:
        if (self.real is None) == (self.frequency is None) or (self.frequency is None) != (
            self.damping is None
        ):
            raise fault("a pole is a real number, or {frequency: …, damping: …} of a conjugate pair")
        if self.damping is not None and not abs(float(self.damping)) < 1:
            raise fault("the damping ratio of a pair lies between -1 and 1; write real poles as numbers")
        return self

    @property
    def roots(self) -> list[complex]:
        """The pole, or the pair, rad/s."""
        if self.real is not None:
            return [complex(float(self.real) * angular_factor(self.unit))]
        assert self.frequency is not None
        assert self.damping is not None
        omega, damping = float(self.frequency) * angular_factor(self.unit), float(self.damping)
        root = omega * complex(-damping, sqrt(1 - damping**2))
        return [root, root.conjugate()]


_PlacedPole = Annotated[PlacedPoleModel, short_for("real", PlacedPoleModel | float | str)]


class PlacementModel(StateFeedbackModel):
    """State feedback that places the poles of the closed loop."""

    to: Annotated[list[SourceName], once(), Field(min_length=1, max_length=50)]
    poles: Annotated[list[_PlacedPole], Field(min_length=1, max_length=50)]

    @property
    def sources(self) -> list[str]:
        """The sources that are driven."""
        return self.to

    def _faults(self) -> Iterator[Located]:
        """Yield a number of poles that is not that of the states, too."""
        yield from super()._faults()
        count = sum(len(pole.roots) for pole in self.poles)
        if count != len(self.states):
            message = f"{counted(count, 'pole')} of {counted(len(self.states), 'state')}: give as many"
            yield ("poles", AT_KEY), message


def _is_variable(name: str) -> bool:
    return name.rpartition(".")[2] in QUANTITIES and "." in name


class ControlModel(Section):
    """Feedback, which closes loops around the graph."""

    loops: list[LoopModel] = Field(default=[], min_length=1)
    lqr: LqrModel | None = None
    placement: PlacementModel | None = None

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> Self:
        if [bool(self.loops), self.lqr is not None, self.placement is not None].count(True) != 1:
            raise fault("feedback is one of 'loops', 'lqr' and 'placement'")
        names = names_of(info)
        raise_faults(
            [
                *self._faults(names.nodes, linear=names.linear),
                *self._period_faults(linear=names.linear),
                *self._limit_faults(linear=names.linear),
            ]
        )
        return self

    def _limit_faults(self, *, linear: bool) -> Iterator[Located]:
        """Yield limits that no response has."""
        for index, loop in enumerate(self.loops):
            path = ("loops", index, "controller", "limits", AT_KEY)
            if loop.controller.limits is None:
                continue
            if linear:
                yield path, "a loop with limits is not identified; leave them out"
            elif self.sampled and loop.controller.sample is None:
                yield path, "a loop without 'sample' beside sampled ones has no 'limits'; leave them out"

    @property
    def driven(self) -> set[str]:
        """The sources that loops drive."""
        return {*(loop.source for loop in self.loops), *(self.states.sources if self.states else ())}

    @property
    def measured(self) -> list[Output]:
        """The variables of the graph that it measures or weighs."""
        states = self.states.variables if self.states else ()
        return [*(loop.measured for loop in self.loops), *states]

    @property
    def states(self) -> StateFeedbackModel | None:
        """The feedback of states, if it is that."""
        return self.lqr or self.placement

    @property
    def loop_names(self) -> list[str]:
        """The names of its loops in results."""
        loops = [(str(loop.measured), loop.source) for loop in self.loops]
        loops += [("states", source) for source in (self.states.sources if self.states else ())]
        return [f"{measured} -> {source}" for measured, source in loops]

    @property
    def signals(self) -> list[str]:
        """The references and setpoints, which are sources of the closed loop."""
        names = [name for loop in self.loops for name in (loop.reference, loop.setpoint) if name]
        return [*names, *dict.fromkeys(self.states.signals.values() if self.states else ())]

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
        key = "lqr" if self.lqr else "placement"
        for path, name in self.states.signals.items() if self.states else ():
            if name in nodes or name in seen:
                what = "a node" if name in nodes else "the name of another input"
                yield (key, *path), f"'{name}' is {what}; use another name"
            seen.setdefault(name, key)
        if linear and self.states:
            message = "gains are designed for a graph of fixed values, and this one is identified; "
            yield (key, AT_KEY), message + "write them as 'loops', each {from, to, controller: {gain: …}}"
        if len(self.delays) > _MAX_DELAYS:
            yield ("loops", AT_KEY), f"at most {_MAX_DELAYS} loops may have a delay"

    def _period_faults(self, *, linear: bool) -> Iterator[Located]:
        """Yield sampled loops that are identified, and sample times with no small common multiple."""
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
            elif (samples := self._common_samples(index)) > COMMON_SAMPLES.value:
                message = f"the loops sample together again after {samples:,} samples only; at most "
                yield path, f"{message}{COMMON_SAMPLES.value:,}: choose periods in a simple ratio"
            elif self.delays and period.exact != periods[0][1].exact:
                first = f"write the period of the first, {float(periods[0][1]):g}"
                yield path, f"beside loops with delays sampled loops have one period; {first}"

    def _common_samples(self, last: int) -> int:
        """Return the number of samples up to a loop until these loops sample together again."""
        loops = self.loops[: last + 1]
        exact = [loop.controller.sample.exact for loop in loops if loop.controller.sample is not None]
        unit = lcm(*(period.denominator for period in exact))
        ticks = [int(period * unit) for period in exact]
        return sum(lcm(*ticks) // tick for tick in ticks)

    @property
    def multirate(self) -> bool:
        """True if its loops are sampled with several periods."""
        samples = (loop.controller.sample for loop in self.loops)
        return len({sample.exact for sample in samples if sample is not None}) > 1

    @property
    def limited(self) -> bool:
        """True if a controller has limits."""
        return any(loop.controller.limits is not None for loop in self.loops)

    @property
    def sampled(self) -> bool:
        """True if its loops are sampled."""
        return any(loop.controller.sample is not None for loop in self.loops)
