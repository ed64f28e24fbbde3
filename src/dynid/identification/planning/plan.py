"""Plan of a measurement: identifiability as it is, and the most informative sensors and excitations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dynid.errors import UsageError
from dynid.identification.identifiability import add_expected_slopes, expected_time_records, identifiability
from dynid.identification.measurement import Experiment
from dynid.identification.planning.excitation import add_excitation, candidate_sines, present_lines
from dynid.identification.planning.sensors import add_sensors, candidate_sensors, every_channel, every_dof
from dynid.lti.floating import guarded
from dynid.number_format import counted
from dynid.progress import report_progress
from dynid.result import Result
from dynid.structure import labels
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.response import UNITS, Channel


@dataclass(frozen=True)
class PlanRequest:
    """A request for a plan.

    Parameters
    ----------
    sensors, lines
        How many to choose; absent: as many as there are (lines: 3 where the excitation is none of sines).
    candidates
        Candidate sensors; absent: `quantities` of every DOF.
    quantities
        Quantities of the candidates where these are not listed.
    noise
        Standard deviation of the candidates' noise by quantity, SI.
    dofs
        Where forces may act; absent: at every DOF that is no rotation.
    band
        Where sines are looked for, rad/s; absent: around the modes.
    """

    sensors: int | None = None
    lines: int | None = None
    candidates: Sequence[Channel] = ()
    quantities: Sequence[str] = tuple(UNITS)
    noise: Mapping[str, float] = field(default_factory=dict)
    dofs: Sequence[Label] = ()
    band: tuple[float, float] | None = None


def plan(
    model: StructuralModel,
    experiments: Sequence[Experiment],
    wanted: PlanRequest | None = None,
    truth: StructuralModel | None = None,
) -> Result:
    """Rank sensors and excitations by the bounds that they give on the unknown joint parameters.

    Parameters
    ----------
    model, experiments, truth
        As of `identifiability.expected_time_records`; the plan is one for the first record.
    wanted
        Numbers and candidates; absent: `PlanRequest()`.

    Returns
    -------
    Result
        ``identification/identifiability/`` as of `identifiability`, ``identification/considered/`` as of
        `add_expected_slopes`, ``plan/sensors/`` as of `add_sensors`,
        ``plan/excitation/`` as of `add_excitation` (not where a motion is prescribed: a force in its place
        would act on another structure). Bounds are relative to the values, and infinite where a
        design does not tell a parameter.

    Raises
    ------
    NotIdentifiable, NumericalError, UsageError
        As of `identify`, except for parameters that the present design does not tell.
    """
    if not experiments:
        raise UsageError("there is no record to plan for", names=("measurement",))
    wanted = wanted or PlanRequest()
    known = identifiability(model, experiments[:1], truth)
    names = [unknown.name for unknown in model.unknowns]
    with guarded(f"the plan for {', '.join(names)}", names=names):
        experiment = experiments[0]
        expected = expected_time_records(model, [experiment], truth)
        own = experiment.measurement.channels
        result = Result("plan")
        result.merge(known)
        add_expected_slopes(result, expected)
        channels = wanted.candidates or every_channel(model, wanted.quantities)
        report_progress(f"ranking {counted(len(channels), 'sensor')}")
        found = candidate_sensors(model, experiment, expected, channels, wanted.noise)
        add_sensors(result, found, own, names, wanted.sensors or len(own))
        if all(load.motion is None for load in experiment.loads):
            dofs = wanted.dofs or [dof for dof in every_dof(model) if labels.kind(dof) != "rotation"]
            report_progress(f"ranking sines at {len(dofs)} DOFs")
            sines = candidate_sines(model, experiment, expected, dofs, wanted.band)
            count = wanted.lines or present_lines(experiment)
            add_excitation(result, model, experiment, expected, sines, count)
    return result
