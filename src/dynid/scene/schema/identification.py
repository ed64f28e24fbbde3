"""Scenes of kind `identification`: the model of their keys, and checks of several keys together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from dynid.defaults import ESTIMATOR
from dynid.errors import Fault
from dynid.scene.schema.base import (
    AccuracyModel,
    ComposedScene,
    Dof,
    FrequencyGrid,
    MotionQuantity,
    Section,
    SignedDof,
)
from dynid.scene.schema.joints import JointModel, by_direction
from dynid.scene.schema.later import Later
from dynid.scene.schema.measurement import ChannelModel, MeasurementModel, OutputModel, RecordModel
from dynid.scene.schema.parts import PartModel, PartName, PointModel
from dynid.scene.schema.quantities import NotNegative, Positive, SceneNames, Value, fault
from dynid.scene.schema.raw import (
    is_mapping_of_mappings,
    listing,
    mapping,
    mapping_of,
    node_types,
    references,
)
from dynid.scene.schema.reduction import ReductionModel, structure_faults
from dynid.scene.schema.references import sections
from dynid.scene.schema.signals import SignalPart, Signals, TimeGrid
from dynid.scene.schema.structure import StructureModel
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from dynid.scene.schema.bond_graph import AnalysisModel

#: The method that an option belongs to.
_OPTIONS = {
    "passes": "filter",
    "iterations": "output-error",
    "noise_ratio": "invariant-imbedding",
    "input_deviation": "invariant-imbedding",
    "tolerance": "invariant-imbedding",
}


#: Methods that can bound the influence of outliers.
_ROBUST = ("auto", "output-error")


class EstimatorModel(Section):
    """Method of identification and its options."""

    method: Literal["auto", "filter", "output-error", "invariant-imbedding"] = ESTIMATOR.value
    passes: int | None = Field(default=None, ge=1, le=100, strict=True)
    iterations: int | None = Field(default=None, ge=1, le=1000, strict=True)
    noise_ratio: Positive | None = None
    input_deviation: NotNegative | None = None
    tolerance: float | None = Field(default=None, ge=1e-12, le=1e-2, strict=True)
    loss: Literal["squares", "huber"] = "squares"

    @model_validator(mode="after")
    def _options_fit(self) -> Self:
        if self.loss == "huber" and self.method not in _ROBUST:
            raise fault(
                f"the loss 'huber' belongs to the methods {' and '.join(_ROBUST)}; the method "
                f"'{self.method}' has none: leave 'loss' out, or change 'method'"
            )
        for option in self.model_fields_set - {"method", "loss"}:
            method = _OPTIONS[option]
            if self.method != method:
                raise fault(f"'{option}' belongs to the method '{method}', not to '{self.method}'")
        return self

    def options(self) -> dict[str, int | float]:
        """Return the options that were given."""
        given = {name: getattr(self, name) for name in _OPTIONS}
        return {n: v if isinstance(v, int) else float(v) for n, v in given.items() if v is not None}


class ResponseModes(Section):
    """Modes to compute: a number, or all below a frequency; with neither all of a small structure."""

    count: int | None = Field(default=None, ge=1, le=10_000, strict=True)
    below: Positive | None = None
    unit: Literal["rad/s", "Hz"] = "rad/s"


class ResponseModel(Section):
    """Linear responses of the structure with its joints."""

    inputs: list[SignedDof] | None = None
    outputs: list[OutputModel] | None = None
    frequency: FrequencyGrid | None = None
    time: TimeGrid | None = None
    modes: ResponseModes | None = None

    @model_validator(mode="after")
    def _asks_something(self) -> Self:
        if self.frequency is None and self.time is None and self.modes is None:
            raise fault("an analysis needs a 'frequency', a 'time' or a 'modes' block")
        return self


def _analysis_of(raw: Any) -> str:
    """Return what an analysis is of: a graph, which has outputs such as J.f, or a structure."""
    given = mapping_of(raw)
    outputs = listing(given, "outputs")
    named = any(isinstance(output, str) for output in outputs)
    own = {"results", "engine", "reading", "symbolic", "port"} & given.keys()
    return "graph" if named or own else "structure"


IdentifiedAnalysis = Annotated[
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
    band: list[Positive] | None = Field(default=None, min_length=2, max_length=2)
    unit: Literal["rad/s", "Hz"] = "rad/s"

    @model_validator(mode="after")
    def _is_a_band(self) -> Self:
        if self.band and float(self.band[0]) >= float(self.band[1]):
            raise fault("a band is [low, high], and low is not below high")
        return self


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
    analysis: IdentifiedAnalysis | None = None
    initial: dict[Dof, Annotated[InitialMotion, Later()]] = {}

    @property
    def is_reduced(self) -> bool:
        """True if the structure is reduced, as a whole or part by part."""
        return self.reduction is not None or any(self.part_reductions.values())

    @property
    def part_reductions(self) -> dict[str, ReductionModel | None]:
        """The reduction of each part by itself; None of a full part."""
        return {name: part.reduction for name, part in (self.structures or {}).items()}

    @property
    def reduction_method(self) -> str:
        """The method that reduces the structure, or those that reduce its parts."""
        each = [f"{part.method} ({name})" for name, part in self.part_reductions.items() if part is not None]
        return ", ".join([*each, *([self.reduction.method] if self.reduction is not None else [])])

    @property
    def responses(self) -> ResponseModel | None:
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
        if self.posterior_check and self.estimator.loss == "huber":
            raise fault("'posterior_check' needs the likelihood; the loss 'huber' has none")
        return self

    @model_validator(mode="after")
    def _asks_something(self) -> Self:
        if sum(one is not None for one in (self.structure, self.structures, self.graph)) != 1:
            raise fault("a scene of this kind has either a 'structure', or 'structures', or a 'graph'")
        if self.measurement is None and self.analysis is None:
            raise fault("a scene needs a 'measurement' to identify from, or an 'analysis'")
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
        if self.analysis is not None and (self.graph is None) != (self.responses is not None):
            raise fault("this analysis is that of a structure; of a graph it has 'outputs' such as J.f")
        wanted = self.responses
        responds = wanted and (wanted.frequency or wanted.time)
        if wanted and responds and not wanted.outputs and not self.measurement:
            raise fault("the analysis needs its 'outputs'; there are no channels to take them from")
        if wanted and wanted.frequency and not (wanted.inputs or self.excitation or frf):
            raise fault("the analysis needs its 'inputs'; there is no excitation to take them from")
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


def identification_faults(source: Source, names: SceneNames) -> list[Fault]:
    """Return the faults of nodes, DOFs, loads, channels, unknowns and the initial motion."""
    data, model = source.data, IdentificationScene
    of_graph = "graph" in data and not {"structure", "structures"} & data.keys()
    if of_graph:
        from dynid.scene.schema.bond_graph import graph_scene_faults

        faults = [
            *graph_scene_faults(source, names),
            *_only_structures(source),
            *_graph_channel_faults(source),
        ]
    else:
        faults = [*structure_faults(source, model, names), *_load_faults(source)]
    for path, signal in sections(model, data, SignalPart):
        if path[0] == "analysis":
            from dynid.scene.schema.bond_graph import calibration_faults

            faults += calibration_faults(source, path, signal)
    records = list(sections(model, data, RecordModel))
    faults += [
        source.fault((*path, "channels", place), "this channel is listed twice")
        for path, record in records
        for place, channel in enumerate(listing(record, "channels"))
        if isinstance(channel, dict) and channel in listing(record, "channels")[:place]
    ]
    simulated = any("simulate" in record for _, record in records)
    responses = any("simulate" in mapping(record, "frf") for _, record in records)
    faults += _unknown_faults(source, simulated=simulated or responses)
    analysis = data.get("analysis", {})
    shown = (
        simulated
        or not isinstance(analysis, dict)
        or any(did_you_mean(str(key), ["time"]) for key in analysis)
    )
    if mapping(data, "initial") and not shown:
        message = "the initial state shows in a time response or a simulated record only; "
        message += "it needs the block 'analysis.time'"
        faults.append(source.fault(("initial",), message, key=True))
    return faults


def _load_faults(source: Source) -> list[Fault]:
    """Return the faults of the signals of a structure: what they drive."""
    faults = []
    for path, signal in sections(IdentificationScene, source.data, SignalPart):
        if "base" in signal and ("dof" in signal or "motion" in signal):
            faults.append(source.fault((*path, "base"), "the base moves, or a 'dof' does", key=True))
        if "dof" not in signal and "base" not in signal:
            faults.append(source.fault(path, "this signal needs the 'dof' that it drives", key=True))
        if "source" in signal:
            message = "a structure has DOFs, not sources; write 'dof'"
            faults.append(source.fault((*path, "source"), message, key=True))
    return faults


def _only_structures(source: Source) -> list[Fault]:
    """Return the faults of keys beside a graph that belong to structures."""
    remedies = {
        ("points",): "a graph has nodes, not points",
        ("motions",): "a graph has no DOFs; leave 'motions' out",
        ("joints",): "a graph has no joints; its unknowns are entries of 'parameters' that its values name",
        ("reduction",): "a graph is not reduced; leave 'reduction' out",
        ("plan", "quantities"): "a graph has efforts and flows; list 'candidates' such as {output: J.f}",
        ("plan", "noise"): "levels by motion are of structures; leave 'noise' out",
        ("plan", "excitation", "dofs"): "a graph has sources; write 'sources'",
    }
    plan = mapping(source.data, "plan")
    keys = {
        *((key,) for key in source.data),
        *(("plan", key) for key in plan),
        *(("plan", "excitation", key) for key in mapping(plan, "excitation")),
    }
    return [source.fault(path, text, key=True) for path, text in remedies.items() if path in keys]


def _graph_channel_faults(source: Source) -> list[Fault]:
    """Return the faults of signals and channels of a graph: its sources and outputs."""
    from dynid.bondgraph.graph import SOURCES

    types, faults = node_types(source.data) | references(source.data), []
    sources = [name for name, kind in types.items() if kind in SOURCES]
    for path, signal in sections(IdentificationScene, source.data, SignalPart):
        for key in ("dof", "motion", "base"):
            if key in signal:
                message = f"'{key}' belongs to structures; a graph has sources: write 'source'"
                faults.append(source.fault((*path, key), message, key=True))
        name = signal.get("source")
        if "source" not in signal and "dof" not in signal:
            faults.append(source.fault(path, "this signal needs the 'source' that it drives", key=True))
        elif isinstance(name, str) and types and types.get(name) not in SOURCES:
            message = f"'{name}' is no source (Se, Sf)" if name in types else f"no node '{name}'"
            faults.append(source.fault((*path, "source"), message + did_you_mean(name, sources)))
    for path, channel in sections(IdentificationScene, source.data, ChannelModel):
        referred = mapping(channel, "reference").get("source")
        if referred is not None and types and types.get(str(referred)) not in SOURCES:
            message = f"'{referred}' is no source (Se, Sf)" + did_you_mean(str(referred), sources)
            faults.append(source.fault((*path, "reference", "source"), message))
        for key in ("dof", "dofs"):
            if key in channel:
                message = f"'{key}' belongs to structures; a graph has outputs: write output: NODE.f"
                faults.append(source.fault((*path, key), message, key=True))
    return faults


def _unknown_faults(source: Source, *, simulated: bool) -> list[Fault]:
    """Return the faults of a measurement without unknowns, or simulated without their true values."""
    if not mapping(source.data, "measurement"):
        return []
    joints = source.data.get("joints", {})
    parameters = mapping(source.data, "parameters")
    given: dict[tuple[Any, ...], Any] = {}
    for name, joint in mapping_of(joints).items():
        for letter in [letter for letter in ("k", "c") if letter in mapping_of(joint)]:
            path, part = ("joints", name, letter), joint[letter]
            given |= {(*path, along): part[along] for along in part} if by_direction(part) else {path: part}
    unknowns = {path: value for path, value in given.items() if "start" in mapping_of(value)}
    named = {("parameters", name): value for name, value in parameters.items()}
    unknowns |= {path: value for path, value in named.items() if "start" in mapping_of(value)}
    known = all(not isinstance(value, dict) or {*value} <= {"value", "matrix"} for value in given.values())
    known = known and all({*mapping_of(value)} <= {"value", "std"} for value in parameters.values())
    if not unknowns and known and is_mapping_of_mappings(joints):
        message = "there is nothing to identify: no parameter has a 'start'"
        return [source.fault(("measurement",), message, key=True)]
    allowed = {
        "start",
        "value",
        "matrix",
        "min",
        "max",
        "prior",
        "scale",
        "std",
    }  # another key may be 'true', misspelt
    message = "a simulated measurement needs the 'true' value of this parameter"
    lacking = [path for path, value in unknowns.items() if simulated and value.keys() <= allowed]
    return [source.fault(path, message, key=True) for path in lacking]
