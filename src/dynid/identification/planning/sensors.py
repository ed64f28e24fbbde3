"""Ranking of sensors: the sensitivities of all candidates come from one propagation of the record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.identification.identifiability import ExpectedTimeRecords
from dynid.identification.measurement import Experiment, as_estimated
from dynid.identification.planning.selection import Candidates, select
from dynid.identification.prediction import free_prediction, prediction
from dynid.identification.record_model import record_model
from dynid.result import Result
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.response import UNITS, Channel, common_unit

Array = NDArray[np.float64]

# A candidate that moves by less than this part of the largest of its quantity measures nothing.
_STILL = 1e-9


@dataclass(frozen=True, eq=False)
class CandidateSensors:
    """Candidate sensors for a record, and what each would tell.

    Attributes
    ----------
    channels
        The candidates; those that would measure nothing are left out.
    noise, rms
        Standard deviation of the noise and RMS of the signal of each.
    candidates
        What each would tell.
    still
        Names of the candidates that were left out.
    """

    channels: tuple[Channel, ...]
    noise: Array
    rms: Array
    candidates: Candidates
    still: tuple[str, ...]

    def places(self, channels: Sequence[Channel]) -> list[int]:
        """Return the places of channels among the candidates."""
        return [self.channels.index(channel) for channel in channels]


def every_dof(model: StructuralModel) -> tuple[Label, ...]:
    """Return the DOFs of a structure; of a reduced one those of the full one."""
    while model.basis is not None:
        model = model.basis.parent
    return model.dofs


def every_channel(model: StructuralModel, quantities: Sequence[str] = tuple(UNITS)) -> list[Channel]:
    """Return these quantities of every DOF."""
    return [Channel(dof, quantity) for quantity in quantities for dof in every_dof(model)]


def candidate_sensors(
    model: StructuralModel,
    experiment: Experiment,
    expected: ExpectedTimeRecords,
    channels: Sequence[Channel],
    noise: Mapping[str, float] | None = None,
) -> CandidateSensors:
    """Return what candidate sensors would tell of a record.

    Parameters
    ----------
    model
        The structure.
    experiment
        Loads, and the sampling of the record.
    expected
        The record as it is expected with its own channels.
    channels
        The candidates.
    noise
        Standard deviation of the noise by quantity, SI; of others it is the same part of the RMS as that of
        the record's own channels, whose noise stays as it is.
    """
    own = experiment.measurement.channels
    record = expected.likelihood.records[0]
    every = tuple(dict.fromkeys([*own, *channels]))
    known = as_estimated(experiment.loads, experiment.measurement.record)
    joint = record_model(model, known, every, experiment.measurement.record.times)
    logs, x0 = expected.fit.logs, expected.fit.parts[0].predicted.states[0]
    free, steps = free_prediction(joint, logs)
    seen = prediction(joint, logs, x0, free, steps)
    rms = np.sqrt(np.mean(seen.outputs**2, axis=0))
    largest = {channel.quantity: 0.0 for channel in every}
    for channel, size in zip(every, rms, strict=True):
        largest[channel.quantity] = max(largest[channel.quantity], float(size))
    moves = [bool(size > _STILL * largest[c.quantity]) for c, size in zip(every, rms, strict=True)]
    level = _levels(every, rms, own, expected.noise[0], noise or {})
    kept = np.flatnonzero(moves)
    both = np.concatenate([seen.by_state[:, kept] @ record.root, seen.by_parameter[:, kept]], axis=2)
    roots = np.asarray(np.linalg.qr(np.moveaxis(both / level[kept, None], 1, 0), mode="r"))
    left_out = tuple(channel.name for channel, yes in zip(every, moves, strict=True) if not yes)
    found = Candidates(roots, joint.states)
    return CandidateSensors(tuple(every[k] for k in kept), level[kept], rms[kept], found, left_out)


def _levels(
    every: Sequence[Channel], rms: Array, own: Sequence[Channel], levels: Array, given: Mapping[str, float]
) -> Array:
    """Return the noise of each candidate."""
    ratio = float(np.mean(levels / np.maximum(rms[: len(own)], np.finfo(float).tiny)))
    level = np.array([given.get(c.quantity, ratio * size) for c, size in zip(every, rms, strict=True)])
    for k in range(len(own)):
        level[k] = given.get(own[k].quantity, levels[k])
    return level


def add_sensors(
    result: Result, found: CandidateSensors, own: Sequence[Channel], names: Sequence[str], count: int
) -> None:
    """Add the ranking of sensors to a result.

    ``plan/sensors/``: of each `candidate` its `noise`, `rms` and `bound_alone` (candidate x parameter); the
    `choice` of the best, in the order in which they help, with the relative `bound` after each (choice x
    parameter) and its `gain`, the factor by which it narrows the bounds (geometric mean); `present`, the
    channels as they are, with their `present_bound` and `efficiency`, the geometric mean of the best bounds
    over theirs.
    """
    group, candidates = "plan/sensors", found.candidates
    chosen = select(candidates, count)
    result.add_axis(f"{group}/candidate", [channel.name for channel in found.channels])
    result.add_axis(f"{group}/parameter", names)
    units = [channel.unit for channel in found.channels]
    result.add(f"{group}/unit", units, ("candidate",))
    result.add(f"{group}/noise", found.noise, ("candidate",), common_unit(units))
    result.add(f"{group}/rms", found.rms, ("candidate",), common_unit(units))
    alone = [candidates.bounds([k]) for k in range(len(found.channels))]
    result.add(f"{group}/bound_alone", alone, ("candidate", "parameter"))
    result.add_axis(f"{group}/choice", [found.channels[k].name for k in chosen])
    result.add(f"{group}/gain", candidates.steps(chosen), ("choice",))
    bounds = [candidates.bounds(chosen[: k + 1]) for k in range(len(chosen))]
    result.add(f"{group}/bound", bounds, ("choice", "parameter"))
    present = found.places([channel for channel in own if channel in found.channels])
    result.add_axis(f"{group}/present", [found.channels[k].name for k in present])
    result.add(f"{group}/present_bound", candidates.bounds(present), ("parameter",))
    lost = candidates.worth(present) - candidates.worth(chosen)
    result.add(f"{group}/efficiency", np.exp(lost / (2 * len(names))))
    result.annotate(group, left_out=", ".join(found.still[:100]))
