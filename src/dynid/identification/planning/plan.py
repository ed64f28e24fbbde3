"""Plan of a measurement: identifiability as it is, and the most informative sensors and excitations.

The sensitivities of all candidate sensors come from one prediction of the record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from dynid.arrays import Array, guarded
from dynid.bondgraph.graph import SOURCES, STORAGES, BondGraph, Port
from dynid.errors import UsageError
from dynid.identification.identifiability import (
    ExpectedRecords,
    add_expected_slopes,
    expected_records,
    identifiability,
)
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.planning.excitation import add_excitation, candidate_sines, present_lines
from dynid.identification.planning.selection import Candidates, relative_slopes, select
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, sampled_loads
from dynid.identification.systems.graph_system import IdentifiedGraph
from dynid.identification.systems.parametric_model import Model, parametric_model
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.number_format import counted
from dynid.progress import report_progress
from dynid.result import Result, common_unit
from dynid.structure import labels
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.ports import UNITS, Channel

# The variable that all bonds of a junction share.
_COMMON: dict[str, Literal["e", "f"]] = {"0": "e", "1": "f"}
# A candidate that moves by less than this part of the largest of its quantity is left out.
_STILL = 1e-9


@dataclass(frozen=True)
class PlanRequest:
    """A request for a plan."""

    # `sensors`, `lines`: how many to choose; absent: as many as there are (lines: 3 where the excitation is
    # none of sines)
    sensors: int | None = None
    lines: int | None = None
    # Candidate sensors; absent: `quantities` of every DOF, or every variable of a graph.
    candidates: Sequence[Any] = ()
    quantities: Sequence[str] = tuple(UNITS)  # quantities of the candidates where these are not listed
    # Standard deviation of the candidates' noise by quantity, SI.
    noise: Mapping[str, float] = field(default_factory=dict)
    # Where forces may act, or sources; absent: at every DOF that is no rotation, and every source.
    dofs: Sequence[Label] = ()
    band: tuple[float, float] | None = None  # where sines are looked for, rad/s; absent: around the modes


def plan(
    model: Model,
    experiments: Sequence[Experiment],
    request: PlanRequest | None = None,
    truth: Model | None = None,
) -> Result:
    """Rank sensors and excitations by the bounds that they give on the unknown parameters.

    Parameters
    ----------
    model, experiments, truth
        As of `identify`, for records of time; the plan is one for the first record.
    request
        Numbers and candidates; absent: `PlanRequest()`.

    Returns
    -------
    Result
        ``identification/identifiability/`` as of `identifiability`, ``identification/considered/`` as of
        `add_expected_slopes`, ``plan/sensors/`` as of `_add_sensors`,
        ``plan/excitation/`` as of `add_excitation` (not where a motion is prescribed: a force in its place
        would act on another structure); with nonlinear joints, whose responses to sines do not add up,
        ``plan/amplitude/`` as of `add_amplitudes` instead. Bounds are relative to the values, and infinite
        where a parameter is not identifiable from a design.

    Raises
    ------
    NotIdentifiable, NumericalError, UsageError
        As of `identify`, except for parameters that are not identifiable from the present design.
    """
    if not experiments:
        raise UsageError("there is no record to plan for", names=("measurement",))
    if isinstance(model, IdentifiedGraph) and model.delayed:
        raise UsageError(
            "there is no plan for a graph with a delay in a loop",
            remedy="Compare designs by the bounds of simulated records.",
            names=("control",),
        )
    request = request or PlanRequest()
    present = identifiability(model, experiments[:1], truth)
    names = [unknown.name for unknown in model.unknowns]
    with guarded(f"the plan for {', '.join(names)}", names=names):
        experiment = experiments[0]
        expected = expected_records(Problem.of(model, experiment, truth=truth).likelihood)
        channels_present = experiment.measurement.channels
        result = Result("plan")
        result.merge(present)
        add_expected_slopes(result, expected)
        channels = request.candidates or every_channel(model, request.quantities)
        report_progress(f"ranking {counted(len(channels), 'sensor')}")
        sensors = candidate_sensors(model, experiment, expected, channels, request.noise)
        count = request.sensors or len(channels_present)
        _add_sensors(result, sensors, channels_present, names, count, expected.relative_rates)
        if not all(record.superposes for record in expected.likelihood.records):
            from dynid.identification.planning.amplitude import add_amplitudes  # of joints with laws alone

            report_progress("other amplitudes of the excitation")
            add_amplitudes(result, model, experiment, expected)
        elif all(load.motion is None for load in experiment.loads):
            dofs: Sequence[Label] = request.dofs
            if not dofs and isinstance(model, IdentifiedGraph):
                dofs = [name for name, node in model.graph.nodes.items() if node.type in SOURCES]
            elif not dofs and isinstance(model, StructuralModel):
                dofs = [dof for dof in _all_dofs(model) if labels.kind(dof) != "rotation"]
            report_progress(f"ranking sines at {counted(len(dofs), 'place')}")
            sines = candidate_sines(model, experiment, expected, dofs, request.band)
            count = request.lines or present_lines(experiment)
            add_excitation(result, model, experiment, expected, sines, count)
    return result


@dataclass(frozen=True, eq=False)
class _CandidateSensors:
    """Candidate sensors for a record, with the information of each."""

    channels: tuple[Any, ...]  # the candidates; those that would measure no motion are left out
    # `noise`, `rms`: standard deviation of the noise and RMS of the signal of each
    noise: Array
    rms: Array
    candidates: Candidates  # the information of each
    still: tuple[str, ...]  # names of the candidates that were left out

    def places(self, channels: Sequence[Any]) -> list[int]:
        """Return the places of channels, whatever the kinds of their DOFs, among the candidates."""
        candidates = [_of_any_kind(channel) for channel in self.channels]
        return [candidates.index(sensor) for sensor in map(_of_any_kind, channels) if sensor in candidates]


def _of_any_kind(channel: Any) -> Any:
    """Return a channel, of a structure without the kind of its DOF."""
    return channel._replace(kind="") if isinstance(channel, Channel) else channel


def _all_dofs(model: StructuralModel) -> tuple[Label, ...]:
    """Return the DOFs of a structure; of a reduced one those of the full one."""
    while model.basis is not None:
        model = model.basis.parent
    return model.dofs


def every_channel(model: Model, quantities: Sequence[str] = tuple(UNITS)) -> list[Any]:
    """Return these quantities of every DOF, or the efforts and flows of a graph."""
    if isinstance(model, StructuralModel):
        kinds = {dof: model.kind(dof) for dof in _all_dofs(model)}
        return [Channel(dof, quantity, kind=kind) for quantity in quantities for dof, kind in kinds.items()]
    assert isinstance(model, IdentifiedGraph)
    return [model.channel(port) for port in every_variable(model.graph)]


def every_variable(graph: BondGraph) -> list[Port]:
    """Return efforts and flows of storages, and the common variable of junctions, each once.

    What a storage shares with its junction bears the name of the storage.
    """
    shared: dict[tuple[str, str], Port] = {}
    quantities: tuple[Literal["e", "f"], ...] = ("e", "f")
    for name, node in graph.nodes.items():
        if node.type in STORAGES and not node.part:
            (bond,) = graph.bonds_of(name)
            junction = bond.tail if bond.head == name else bond.head
            common = _COMMON.get(graph.nodes[junction].type)
            for quantity in quantities:
                shared.setdefault((junction if quantity == common else name, quantity), Port(name, quantity))
    for name, node in graph.nodes.items():
        common = _COMMON.get(node.type)
        if common is not None and not node.part:
            shared.setdefault((name, common), Port(name, common))
    return list(shared.values())


def candidate_sensors(
    model: Model,
    experiment: Experiment,
    expected: ExpectedRecords,
    channels: Sequence[Any],
    noise: Mapping[str, float] | None = None,
) -> _CandidateSensors:
    """Return candidate sensors for a record, with their information.

    `noise`: standard deviations by quantity, SI; that of others is the same part of the RMS as that of the
    record's own channels, whose noise stays as it is.
    """
    present = experiment.measurement.channels
    record = expected.likelihood.records[0]
    assert isinstance(record, TimeRecord)
    there = {channel.name for channel in present}  # their instruments may have a gain, offset or delay
    all_channels = tuple(
        dict.fromkeys([*present, *(channel for channel in channels if channel.name not in there)])
    )
    loads = sampled_loads(experiment.loads, experiment.measurement.record)
    joint = parametric_model(model, loads, all_channels, record.model.times)
    eta = expected.fit.eta
    # Candidates may depend on more states, which start from zero.
    start = expected.fit.parts[0].predicted.start[: record.model.states] * record.model.scale
    known_states = dict(zip((state.name for state in record.system_model.states), start, strict=True))
    x0 = np.array([known_states.get(state.name, 0.0) for state in joint.system.states]) / joint.scale
    root = record.root
    if joint.states != record.model.states:
        root = np.linalg.norm(record.root) / np.linalg.norm(record.model.state_root) * joint.state_root
    if record.superposes:
        free, steps = free_prediction(joint, eta)
        predicted = prediction(joint, eta, x0, free, steps)
    else:
        predicted = record.with_model(joint).prediction_from(
            eta, expected.fit.parts[0].predicted.start, record.model
        )
    rms = np.sqrt(np.mean(predicted.outputs**2, axis=0))
    largest = {channel.quantity: 0.0 for channel in all_channels}
    for channel, size in zip(all_channels, rms, strict=True):
        largest[channel.quantity] = max(largest[channel.quantity], float(size))
    moves = [bool(size > _STILL * largest[c.quantity]) for c, size in zip(all_channels, rms, strict=True)]
    noise_of_quantity, levels = noise or {}, expected.noise[0]
    ratio = float(np.mean(levels / np.maximum(rms[: len(present)], np.finfo(float).tiny)))
    level = np.array(
        [noise_of_quantity.get(c.quantity, ratio * size) for c, size in zip(all_channels, rms, strict=True)]
    )
    level[: len(present)] = [
        noise_of_quantity.get(c.quantity, size) for c, size in zip(present, levels, strict=True)
    ]
    kept = np.flatnonzero(moves)
    by_state = predicted.by_state[:, kept] @ root / level[kept, None]
    by_parameter = predicted.by_parameter[:, kept] / level[kept, None]
    both = np.concatenate([by_state, relative_slopes(by_parameter, expected.relative_rates)], axis=2)
    roots = np.asarray(np.linalg.qr(np.moveaxis(both, 1, 0), mode="r"))
    left_out = tuple(channel.name for channel, yes in zip(all_channels, moves, strict=True) if not yes)
    candidates = Candidates(roots, predicted.by_state.shape[2])
    return _CandidateSensors(
        tuple(all_channels[k] for k in kept), level[kept], rms[kept], candidates, left_out
    )


def _add_sensors(
    result: Result,
    sensors: _CandidateSensors,
    present_channels: Sequence[Any],
    names: Sequence[str],
    count: int,
    rates: Array,
) -> None:
    """Add the ranking of sensors to a result; `rates`: relative rates of the parameters (p)."""
    # ``plan/sensors/``: of each `candidate` its `noise`, `rms` and `bound_alone` (candidate x parameter);
    # the `choice` of the best, in the order of their gains, with the relative `bound` after each (choice x
    # parameter) and its `gain`, the factor by which it narrows the bounds (geometric mean); `present`, the
    # channels as they are, with their `present_bound` and `efficiency`, the geometric mean of the best
    # bounds over theirs.
    group, candidates = "plan/sensors", sensors.candidates
    relative = np.where(np.isfinite(rates), 1.0, np.inf)  # nothing is relative to a value of 0
    chosen = select(candidates, count)
    result.add_axes(group, candidate=[channel.name for channel in sensors.channels], parameter=names)
    units = [channel.unit for channel in sensors.channels]
    result.add(f"{group}/unit", units, ("candidate",))
    result.add_all(group, ("candidate",), common_unit(units), noise=sensors.noise, rms=sensors.rms)
    alone = [relative * candidates.bounds([k]) for k in range(len(sensors.channels))]
    result.add(f"{group}/bound_alone", alone, ("candidate", "parameter"))
    result.add_axis(f"{group}/choice", [sensors.channels[k].name for k in chosen])
    result.add(f"{group}/gain", candidates.steps(chosen), ("choice",))
    bounds = [relative * candidates.bounds(chosen[: k + 1]) for k in range(len(chosen))]
    result.add(f"{group}/bound", bounds, ("choice", "parameter"))
    present = sensors.places(present_channels)
    result.add_axis(f"{group}/present", [sensors.channels[k].name for k in present])
    result.add(f"{group}/present_bound", relative * candidates.bounds(present), ("parameter",))
    lost = candidates.worth(present) - candidates.worth(chosen)
    result.add(f"{group}/efficiency", np.exp(lost / (2 * len(names))))
    result.annotate(group, left_out=", ".join(sensors.still[:100]))
