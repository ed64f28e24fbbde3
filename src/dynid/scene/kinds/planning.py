"""Plans of the measurement of a scene: its sensors and excitation."""

from __future__ import annotations

from dynid.errors import UsageError
from dynid.identification.planning.plan import PlanRequest, plan
from dynid.identification.systems.graph_system import IdentifiedGraph
from dynid.result import Result
from dynid.scene.kinds.identification import Setting, expected_values, setting
from dynid.scene.kinds.identified_graphs import identified_graph
from dynid.scene.kinds.measurements import channel_of, measurements_of, result_name
from dynid.scene.kinds.parts import structure_of
from dynid.scene.load import Scene
from dynid.scene.schema.identification import IdentificationScene
from dynid.structure.model import StructuralModel
from dynid.structure.ports import UNITS
from dynid.units import angular_factor


def prospect(scene: Scene[IdentificationScene]) -> Setting:
    """Return the model and the measurements of an identification, at the expected values of its unknowns."""
    model = scene.model
    if model.graph is None:
        structure = structure_of(scene)
        return setting(scene, structure, expected_values(structure))
    graph = identified_graph(scene)[0]
    return Setting(graph, measurements_of(scene, graph), graph)


def run_plan(
    scene: Scene[IdentificationScene], sensors: int | None = None, lines: int | None = None
) -> Result:
    """Return ranked sensors and excitations for a scene of kind identification.

    `sensors` and `lines` are the numbers to choose; default: those of the scene, else as many as it has.
    Raises `UsageError` where the scene has nothing to identify, or no measurement. Raises `NotIdentifiable`
    or `NumericalError` or `FileError` as of a run, except for parameters that the present measurement does
    not determine.
    """
    if scene.kind != "identification":
        raise UsageError(
            f"there is nothing to plan in a scene of kind {scene.kind}",
            remedy="A plan is for scenes of kind identification.",
            names=("kind",),
        )
    model = scene.model
    if model.measurement is None:
        raise UsageError(
            "there is no measurement to plan",
            remedy="Add the block 'measurement' with step, samples and channels.",
            names=("kind",),
        )
    for key, what in (("modes", "has modes"), ("frf", "is of frequency responses")):
        if getattr(model.measurement, key) is not None:
            remedy = f"Give step, samples and channels of a record that could be taken instead of '{key}'."
            problem = f"a plan is for a record of time; this measurement {what}"
            raise UsageError(problem, remedy=remedy, names=(f"measurement.{key}",))
    reduced, records, truth, _ = prospect(scene)
    labelled = reduced if isinstance(reduced, IdentifiedGraph | StructuralModel) else None
    structure = labelled if isinstance(labelled, StructuralModel) else None
    options, force = model.plan, model.plan.excitation
    factor = angular_factor(force.unit)
    request = PlanRequest(
        sensors=sensors or options.sensors,
        lines=lines or options.lines,
        candidates=[channel_of(channel, labelled) for channel in options.candidates or ()],
        quantities=options.quantities or tuple(UNITS),
        noise={quantity: float(level) for quantity, level in options.noise.items()},
        dofs=[result_name(structure, dof) for dof in force.dofs or ()] or force.sources or (),
        band=(factor * float(force.band[0]), factor * float(force.band[1])) if force.band else None,
    )
    result = plan(reduced, records, request, truth)
    result.title = scene.title
    result.attrs["scene"] = scene.source.resolved_text()
    return result
