"""Scenes of kind `identification`: the model of their keys, and checks of several keys together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, ValidationInfo, model_validator

from dynid.defaults import ESTIMATOR
from dynid.scene.schema.base import (
    AccuracyModel,
    Band,
    ComposedScene,
    DefinedParameter,
    Dof,
    FrequencyGrid,
    MotionQuantity,
    Section,
    SignedDof,
    accuracy_faults,
)
from dynid.scene.schema.graph_variables import stored_energy_faults
from dynid.scene.schema.joints import JointModel, LawParameterModel, ParameterModel, joint_parameters
from dynid.scene.schema.measurement import ChannelModel, MeasurementModel, OutputModel, RecordModel
from dynid.scene.schema.parts import PartModel, PartName, PointModel
from dynid.scene.schema.quantities import (
    AT_KEY,
    Located,
    NotNegative,
    Positive,
    Value,
    fault,
    names_of,
    raise_faults,
)
from dynid.scene.schema.raw import listing, mapping_of
from dynid.scene.schema.reduction import ReductionModel, structure_faults
from dynid.scene.schema.references import Later, Path, sections
from dynid.scene.schema.signals import SignalPart, Signals, TimeGrid, calibration_faults
from dynid.scene.schema.structure import StructureModel
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.scene.schema.bond_graph import AnalysisModel

#: The methods that an option belongs to.
_OPTIONS = {
    "passes": ("filter", "sigma-point"),
    "iterations": ("output-error",),
    "noise_ratio": ("invariant-imbedding",),
    "input_deviation": ("invariant-imbedding",),
    "tolerance": ("invariant-imbedding",),
}


#: Methods that can bound the influence of outliers.
_ROBUST = ("auto", "output-error")


LawKind = Literal[
    "linear",
    "power",
    "cubic",
    "quadratic_damping",
    "coulomb",
    "jenkins",
    "iwan",
    "bouc_wen",
    "gap",
    "expression",
]
"""A candidate for the law of a joint; ``linear``: none."""


class EstimatorModel(Section):
    """Method of identification and its options."""

    method: Literal["auto", "filter", "sigma-point", "output-error", "invariant-imbedding"] = ESTIMATOR.value
    passes: int | None = Field(default=None, ge=1, le=100, strict=True)
    iterations: int | None = Field(default=None, ge=1, le=1000, strict=True)
    noise_ratio: Positive | None = None
    input_deviation: NotNegative | None = None
    tolerance: float | None = Field(default=None, ge=1e-12, le=1e-2, strict=True)
    loss: Literal["squares", "huber"] = "squares"
    laws: list[LawKind] = Field(default=[], max_length=10)

    @model_validator(mode="after")
    def _candidates_differ(self) -> Self:
        if len(self.laws) == 1:
            raise fault("'laws' are compared with each other: name two or more, such as [linear, cubic]")
        if len(set(self.laws)) < len(self.laws):
            raise fault("'laws' names a law twice")
        if self.laws and self.loss == "huber":
            raise fault("'laws' are compared by their likelihood, which the loss 'huber' has not")
        return self

    @model_validator(mode="after")
    def _options_fit(self) -> Self:
        if self.loss == "huber" and self.method not in _ROBUST:
            raise fault(
                f"the loss 'huber' belongs to the methods {' and '.join(_ROBUST)}; the method "
                f"'{self.method}' has none: leave 'loss' out, or change 'method'"
            )
        for option in self.model_fields_set - {"method", "loss", "laws"}:
            if self.method not in (methods := _OPTIONS[option]):
                named = "' and '".join(methods)
                belongs = f"belongs to the method{'s' * (len(methods) > 1)} '{named}'"
                raise fault(f"'{option}' {belongs}, not to '{self.method}'")
        return self

    def options(self) -> dict[str, int | float]:
        """Return the options that were given."""
        options = {name: getattr(self, name) for name in _OPTIONS}
        return {n: v if isinstance(v, int) else float(v) for n, v in options.items() if v is not None}


class ResponseModes(Section):
    """Modes to compute: a number, or all below a frequency; with neither all of a small structure."""

    count: int | None = Field(default=None, ge=1, le=10_000, strict=True)
    below: Positive | None = None
    unit: Literal["rad/s", "Hz"] = "rad/s"


class CampbellModel(Section):
    """Speeds of rotation, and the number of modes that are followed over them."""

    start: NotNegative | None = None
    stop: Positive
    points: int = Field(default=51, ge=2, le=10_000, strict=True)
    modes: int = Field(default=4, ge=1, le=1000, strict=True)
    unit: Literal["rad/s", "Hz"] = "rad/s"

    @model_validator(mode="after")
    def _is_a_range(self) -> Self:
        if float(self.stop) <= float(self.start or 0):
            raise fault("'stop' is not above 'start'")
        return self


class ResponseModel(Section):
    """Linear responses of the structure with its joints."""

    inputs: list[SignedDof] | None = None
    outputs: list[OutputModel] | None = None
    frequency: FrequencyGrid | None = None
    time: TimeGrid | None = None
    modes: ResponseModes | None = None
    campbell: CampbellModel | None = None

    @model_validator(mode="after")
    def _asks_something(self) -> Self:
        if not {"frequency", "time", "modes", "campbell"} & self.model_fields_set:
            raise fault("an analysis needs a 'frequency', a 'time', a 'modes' or a 'campbell' block")
        return self


class HarmonicBalanceModel(Section):
    """Steady states under a sine at a DOF, from one frequency to another."""

    dof: SignedDof
    amplitude: Positive
    start: Positive
    stop: Positive
    unit: Literal["rad/s", "Hz"] = "rad/s"
    output: SignedDof | None = None
    harmonics: int = Field(default=101, ge=1, le=1000, strict=True)
    points: int = Field(default=1000, ge=2, le=100_000, strict=True)
    max_step: float = Field(default=0.1, ge=1e-4, le=0.1)
    stability: bool = True
    backbone: bool = True

    @model_validator(mode="after")
    def _is_an_interval(self) -> Self:
        if float(self.start) == float(self.stop):
            raise fault("'start' and 'stop' are the same frequency; a curve goes from one to another")
        return self


class SteadyStatesModel(Section):
    """Steady states of a structure with nonlinear joints."""

    harmonic_balance: HarmonicBalanceModel


def _analysis_of(raw: Any) -> str:
    """Return what an analysis is of: a graph, which has outputs such as J.f, or a structure."""
    analysis = mapping_of(raw)
    outputs = listing(analysis, "outputs")
    named = any(isinstance(output, str) for output in outputs)
    graph_keys = {"results", "engine", "reading", "symbolic", "port"} & analysis.keys()
    return "graph" if named or graph_keys else "structure"


_IdentifiedAnalysis = Annotated[
    Annotated[ResponseModel, Later(), Tag("structure")]
    | Annotated[Any, Later("dynid.scene.schema.bond_graph:AnalysisModel"), Tag("graph")],
    Discriminator(_analysis_of),
]


class InitialMotion(Section):
    """State at t = 0: displacement and velocity of a DOF; in a graph the flow of an I, the effort of a C."""

    x: Value | None = None
    v: Value | None = None
    f: Value | None = None
    e: Value | None = None


class ForceModel(Section):
    """Candidate positions (or sources) and frequencies of an excitation; default: all, around the modes."""

    dofs: list[SignedDof] | None = Field(default=None, min_length=1)
    sources: list[str] | None = Field(default=None, min_length=1)
    band: Band[Positive] | None = None
    unit: Literal["rad/s", "Hz"] = "rad/s"


class PlanModel(Section):
    """Search space of `dynid plan`: number of sensors and lines, candidates, noise."""

    sensors: int | None = Field(default=None, ge=1, le=1000, strict=True)
    lines: int | None = Field(default=None, ge=1, le=1000, strict=True)
    candidates: list[ChannelModel] | None = Field(default=None, min_length=1)
    quantities: list[MotionQuantity] | None = Field(default=None, min_length=1)
    noise: dict[MotionQuantity, Positive] = {}
    excitation: Annotated[ForceModel, Later()] = ForceModel.model_construct()

    @model_validator(mode="after")
    def _one_list(self) -> Self:
        if self.candidates and self.quantities:
            raise fault("'candidates' name their quantities; 'quantities' are for every DOF without them")
        return self


class IdentificationScene(ComposedScene):
    """A structure with joints, or a graph; a record to identify them from, responses, or both."""

    kind: Literal["identification"]
    accuracy: Annotated[AccuracyModel, Later()] | None = None
    structure: StructureModel | None = None
    structures: dict[PartName, Annotated[PartModel, Later()]] | None = Field(default=None, min_length=1)
    graph: Annotated[Any, Later("dynid.scene.schema.bond_graph:GraphModel")] | None = None
    points: dict[PartName, Annotated[PointModel, Later()]] = {}
    motions: dict[str, Annotated[dict[Dof, Value], Field(min_length=1)]] = {}
    joints: dict[str, JointModel] = {}
    reduction: ReductionModel | None = None
    excitation: Signals = []
    measurement: MeasurementModel | None = None
    estimator: Annotated[EstimatorModel, Later()] = EstimatorModel.model_construct()
    identifiability: bool = False
    derived: list[Literal["poles", "zeros", "modes", "frequency_response"]] | None = None
    posterior_check: bool = False
    plan: Annotated[PlanModel, Later()] = PlanModel.model_construct()
    analysis: _IdentifiedAnalysis | None = None
    responses: Annotated[SteadyStatesModel, Later()] | None = None
    initial: dict[Dof, Annotated[InitialMotion, Later()]] = {}

    @property
    def is_reduced(self) -> bool:
        """True if the structure is reduced, as a whole or part by part."""
        return self.reduction is not None or any(self.part_reductions.values())

    @property
    def part_reductions(self) -> dict[str, ReductionModel | None]:
        """The reduction of each part by itself; None of a full part."""
        return {name: structure.reduction for name, structure in (self.structures or {}).items()}

    @property
    def reduction_method(self) -> str:
        """The method that reduces the structure, or those that reduce its parts."""
        reductions = self.part_reductions.items()
        methods = [f"{reduction.method} ({name})" for name, reduction in reductions if reduction is not None]
        return ", ".join([*methods, *([self.reduction.method] if self.reduction is not None else [])])

    @property
    def structure_analysis(self) -> ResponseModel | None:
        """The analysis of a structure."""
        return self.analysis if isinstance(self.analysis, ResponseModel) else None

    @property
    def graph_analysis(self) -> AnalysisModel | None:
        """The analysis of a graph."""
        return None if isinstance(self.analysis, ResponseModel) else self.analysis

    @model_validator(mode="after")
    def _follows_from_an_estimate(self) -> Self:
        for name in ("derived", "posterior_check"):
            if getattr(self, name) and self.measurement is None:
                raise fault(f"'{name}' follows from an estimate; there is no 'measurement'")
        if self.derived and self.control is not None and self.control.delays:
            raise fault(
                "'derived' is of finitely many poles and zeros, and a loop with a delay has infinitely many; "
                "leave it out: 'analysis' gives the poles at the estimate"
            )
        if self.posterior_check and self.estimator.loss == "huber":
            raise fault("'posterior_check' needs the likelihood; the loss 'huber' has none")
        return self

    @model_validator(mode="after")
    def _asks_something(self) -> Self:
        if sum(model is not None for model in (self.structure, self.structures, self.graph)) != 1:
            raise fault("a scene of this kind has either a 'structure', or 'structures', or a 'graph'")
        if self.measurement is None and self.analysis is None and self.responses is None:
            raise fault("a scene needs a 'measurement' to identify from, an 'analysis', or 'responses'")
        if self.responses is not None and self.graph is not None:
            raise fault("'responses' are of a structure, not of a graph; leave them out")
        if self.identifiability and self.measurement is None:
            raise fault("'identifiability' is that of a record; there is no 'measurement'")
        records = self.measurement.each if self.measurement else []
        simulated = [record.frf.simulate if record.frf else record.simulate for record in records]
        models = {simulate.model for simulate in simulated if simulate}
        if "reduced" in models and not self.is_reduced:
            raise fault("the record is to be simulated with the reduced model, but there is no 'reduction'")
        if len(models) > 1:
            raise fault("all records are simulated with one 'model': full or reduced")
        frf = self.measurement and self.measurement.frf
        if frf and self.excitation:
            raise fault("frequency responses are of unit forces; an 'excitation' says nothing beside 'frf'")
        if frf and self.estimator.method not in ("auto", "output-error"):
            raise fault(f"the method '{self.estimator.method}' is for records of time, not for 'frf'")
        if self.analysis is not None and (self.graph is None) != (self.structure_analysis is not None):
            raise fault("this analysis is that of a structure; of a graph it has 'outputs' such as J.f")
        responses = self.structure_analysis
        responds = responses and (responses.frequency or responses.time)
        if responses and responds and not responses.outputs and not self.measurement:
            raise fault("the analysis needs its 'outputs'; there are no channels to take them from")
        if responses and responses.frequency and not (responses.inputs or self.excitation or frf):
            raise fault("the analysis needs its 'inputs'; there is no excitation to take them from")
        return self

    @model_validator(mode="after")
    def _steady_states_fit(self) -> Self:
        has_laws = any(joint.laws for _, joint in sections(self.joints, JointModel))
        if has_laws and self.measurement is not None and self.measurement.frf is not None:
            for channel in self.measurement.channels or ():
                if channel.reference is not None and channel.reference.amplitude is None:
                    raise fault(
                        "a frequency response is linear and cannot identify nonlinear 'laws'; state the "
                        "'amplitude' of the force in each 'reference' of a stepped sine, or leave 'laws' out"
                    )
        if self.responses is not None and not has_laws:
            raise fault(
                "no joint has nonlinear 'laws': the steady state under a sine is the frequency response; ask "
                "for 'analysis: {frequency: …}'"
            )
        return self

    @model_validator(mode="after")
    def _candidates_fit(self) -> Self:
        laws = self.estimator.laws
        if not laws:
            return self
        if self.measurement is None or self.graph is not None:
            raise fault("the 'laws' of an estimator are of joints, and compared by a record of time")
        if self.measurement.frf is not None or self.measurement.modes is not None:
            raise fault(
                "frequency responses and modes are linear: they cannot compare 'laws' of joints; a record of "
                "time can"
            )
        stated = {law.kind for _, joint in sections(self.joints, JointModel) for law in joint.laws}
        if incomplete := [law for law in laws if law in ("power", "expression") and law not in stated]:
            raise fault(
                f"the law '{incomplete[0]}' needs more than its kind: state it among the 'laws' of the joint"
            )
        return self

    @model_validator(mode="after")
    def _held_out_fit(self) -> Self:
        if self.graph is not None and self.measurement is not None and self.measurement.held_out:
            raise fault("records are 'held_out' of a structure, not of a graph; leave them out")
        return self

    @model_validator(mode="after")
    def _modes_fit(self) -> Self:
        if self.measurement is None or self.measurement.modes is None:
            return self
        if self.graph is not None:
            raise fault("measured 'modes' are of a structure, not of a graph")
        if self.estimator.method not in ("auto", "output-error"):
            raise fault(f"the method '{self.estimator.method}' is for records of time, not for 'modes'")
        if self.estimator.loss == "huber":
            raise fault("measured 'modes' have no loss 'huber'; the error of the model is estimated instead")
        if self.measurement.modes_alone and self.excitation:
            raise fault("modes are measured without an 'excitation'; leave it out")
        return self

    @model_validator(mode="after")
    def _fits(self, info: ValidationInfo) -> Self:
        faults: list[Located] = []
        if self.graph is not None:
            inputs = self.analysis.inputs if self.analysis is not None else None
            faults += [
                *stored_energy_faults(self.initial, names_of(info).nodes),
                *(self.control.input_faults(inputs) if self.control is not None else ()),
                *self._structure_keys(),
                *self._graph_channel_faults(names_of(info).variables),
            ]
        else:
            # Points and motions have names like DOFs, which are known as the model is built.
            structure = None if self.points or self.motions else self.structure
            faults += [*structure_faults(self, structure), *self._load_faults()]
        if self.analysis is not None:
            for path, signal in sections(self.analysis, SignalPart, ("analysis",)):
                faults += calibration_faults(path, signal)
        records = [record for _, record in sections(self, RecordModel)]
        simulated = any(record.simulate or (record.frf and record.frf.simulate) for record in records)
        faults += [*self._unknown_faults(simulated=simulated), *accuracy_faults(self)]
        if self.initial and not simulated and (self.analysis is None or self.analysis.time is None):
            message = "the initial state shows in a time response or a simulated record only; "
            faults.append((("initial", AT_KEY), f"{message}it needs the block 'analysis.time'"))
        raise_faults(faults)
        return self

    @property
    def aspects(self) -> set[str]:
        """The aspects in which it chooses between alternatives."""
        records = self.measurement.each if self.measurement is not None else []
        simulated = [record.frf.simulate if record.frf else record.simulate for record in records]
        # Samples of a force are those of random signals, and of files beside measured records.
        sampled = any(
            signal.kind == "random" or (signal.kind == "file" and record.simulate is None)
            for record in records
            for signal in (record.excitation or self.excitation)
        )
        reduced = any(simulation is not None and simulation.model == "reduced" for simulation in simulated)
        requested = {
            "propagation": self._is_propagated,
            "estimator": self.measurement is not None,
            "basis": self.measurement is not None and not reduced and self.graph is None,
            "hold": sampled,
            "modes": self.structure_analysis is not None and self.structure_analysis.modes is not None,
        }
        return {name for name, chosen in requested.items() if chosen}

    @property
    def _is_propagated(self) -> bool:
        """True if a time response is computed from signals that are more than an impulse."""
        if self.analysis is None or self.analysis.time is None:
            return False
        graph, signals = self.graph_analysis, self.analysis.time.input
        if graph is not None and "time_response" not in graph.asked():
            return False
        if graph is None and not (signals or self.initial):
            signals = self.excitation
        elif not signals:
            return not self.initial  # a unit step, unless stored energy moves it
        return any(signal.kind != "impulse" for signal in signals)

    def _load_faults(self) -> Iterator[Located]:
        for path, signal in sections(self, SignalPart):
            if signal.base is not None and (signal.dof is not None or signal.motion is not None):
                yield (*path, "base", AT_KEY), "the base moves, or a 'dof' does"
            if signal.dof is None and signal.base is None:
                yield (*path, AT_KEY), "this signal needs the 'dof' that it drives"
            if signal.source is not None:
                yield (*path, "source", AT_KEY), "a structure has DOFs, not sources; write 'dof'"

    def _structure_keys(self) -> Iterator[Located]:
        """Yield the keys beside a graph that belong to structures."""
        force = self.plan.excitation
        for path, section, message in (
            (("points",), self, "a graph has nodes, not points"),
            (("motions",), self, "a graph has no DOFs; leave 'motions' out"),
            (("joints",), self, _NO_JOINTS),
            (("reduction",), self, "a graph is not reduced; leave 'reduction' out"),
            (("plan", "quantities"), self.plan, _NO_QUANTITIES),
            (("plan", "noise"), self.plan, "levels by motion are of structures; leave 'noise' out"),
            (("plan", "excitation", "dofs"), force, "a graph has sources; write 'sources'"),
        ):
            if path[-1] in section.model_fields_set:
                yield (*path, AT_KEY), message

    def _graph_channel_faults(self, types: Mapping[str, str]) -> Iterator[Located]:
        """Yield the faults of signals and channels of a graph: its sources and outputs."""
        from dynid.bondgraph.graph import SOURCES

        sources = [name for name, kind in types.items() if kind in SOURCES]

        for path, signal in sections(self, SignalPart):
            for key in {"dof", "motion", "base"} & signal.model_fields_set:
                message = f"'{key}' belongs to structures; a graph has sources: write 'source'"
                yield (*path, key, AT_KEY), message
            if signal.source is None and signal.dof is None:
                yield (*path, AT_KEY), "this signal needs the 'source' that it drives"
            elif signal.source is not None and signal.source not in sources:
                name = signal.source
                problem = f"'{name}' is no source (Se, Sf)" if name in types else f"no node '{name}'"
                yield (*path, "source"), problem + did_you_mean(name, sources)
        for path, channel in sections(self, ChannelModel):
            reference = getattr(channel, "reference", None)
            if reference is not None and reference.source and reference.source not in sources:
                message = f"'{reference.source}' is no source (Se, Sf)"
                message += did_you_mean(reference.source, sources)
                yield (*path, "reference", "source"), message
            for key in {"dof", "dofs"} & channel.model_fields_set:
                message = f"'{key}' belongs to structures; a graph has outputs: write output: NODE.f"
                yield (*path, key, AT_KEY), message

    def _unknown_faults(self, *, simulated: bool) -> Iterator[Located]:
        """Yield the fault of a measurement without unknowns, or unknowns without true values to simulate."""
        if self.measurement is None:
            return
        unknowns: dict[Path, DefinedParameter | ParameterModel | LawParameterModel] = {
            path: parameter
            for path, parameter in joint_parameters(self.joints, ("joints",))
            if parameter.start is not None
        }
        unknowns |= {
            ("parameters", name): entry
            for name, entry in self.parameters.items()
            if isinstance(entry, DefinedParameter) and entry.start is not None
        }
        if not unknowns:
            yield ("measurement", AT_KEY), "there is nothing to identify: no parameter has a 'start'"
        for path, unknown in unknowns.items():
            if simulated and unknown.true is None:
                yield (*path, AT_KEY), "a simulated measurement needs the 'true' value of this parameter"


_NO_JOINTS = "a graph has no joints; its unknowns are entries of 'parameters' that its values name"
_NO_QUANTITIES = "a graph has efforts and flows; list 'candidates' such as {output: J.f}"
