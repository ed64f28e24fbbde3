"""A plan: identifiability as things are, and the sensors and excitations that would tell most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from dynid.errors import UsageError
from dynid.identification.identifiability import identifiability, prospect
from dynid.identification.measurement import Experiment
from dynid.identification.planning.excitation import add_excitation, present_lines
from dynid.identification.planning.lines import lines
from dynid.identification.planning.sensors import add_sensors, every_channel, every_dof, sensors
from dynid.lti.floating import guarded
from dynid.numerals import counted
from dynid.progress import tell
from dynid.result import Result
from dynid.structure import labels
from dynid.structure.matrices import Label
from dynid.structure.model import StructuralModel
from dynid.structure.response import UNITS, Channel


@dataclass(frozen=True)
class Wanted:
    """What to look for.

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
    wanted: Wanted | None = None,
    truth: StructuralModel | None = None,
) -> Result:
    """Rank sensors and excitations by the bounds that they give on the unknown joint parameters.

    Parameters
    ----------
    model, experiments, truth
        As of `dynid.identification.identifiability.prospect`; the plan is one for the first record.
    wanted
        What to look for; absent: `Wanted()`.

    Returns
    -------
    Result
        ``identification/identifiability/`` as of `identifiability`, ``plan/sensors/`` as of `add_sensors`,
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
    wanted = wanted or Wanted()
    known = identifiability(model, experiments[:1], truth)
    names = [unknown.name for unknown in model.unknowns]
    with guarded(f"the plan for {', '.join(names)}", names=names):
        experiment = experiments[0]
        expected = prospect(model, [experiment], truth)
        own = experiment.measurement.channels
        result = Result("plan")
        result.merge(known)
        channels = wanted.candidates or every_channel(model, wanted.quantities)
        tell(f"ranking {counted(len(channels), 'sensor')}")
        found = sensors(model, experiment, expected, channels, wanted.noise)
        add_sensors(result, found, own, names, wanted.sensors or len(own))
        if all(load.motion is None for load in experiment.loads):
            dofs = wanted.dofs or [dof for dof in every_dof(model) if labels.kind(dof) != "rotation"]
            tell(f"ranking sines at {len(dofs)} DOFs")
            sines = lines(model, experiment, expected, dofs, wanted.band)
            count = wanted.lines or present_lines(experiment)
            add_excitation(result, model, experiment, expected, sines, count)
    return result
