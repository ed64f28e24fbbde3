"""The kinds of scenes: each is one object that refers to all that differs between kinds."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class Kind:
    """A kind of scene.

    All but `name` and `template` are references, `module:name` or `module`, loaded when used. So a command
    loads only what it needs, and no layer imports a higher one. An empty reference: the kind has none.
    """

    name: str  #: The value of the key `kind`.
    template: str  #: The file in `dynid.templates` that `dynid new` writes.
    model: str  #: The pydantic model of its scenes.
    #: Function of a scene; returns its `Result`. Given a `Result` of a study's sample besides, it adds to it
    #: what that wants, and computes little else.
    run: str
    explain: str = ""  #: Function of a scene; returns its `Explanation`.
    prepare: str = ""  #: Function of a scene; yields the steps of its run that come before any computation.
    #: Function of a valid scene; returns its source with what files add to it, such as their channels.
    complete: str = ""
    #: Function of a valid scene; raises the faults of it and of the scenes that it names.
    check_valid: str = ""
    #: Function of a valid scene; yields its parts that a run does not use, as faults that are warnings.
    doubts: str = ""
    base: str = ""  #: Function of a valid scene; returns the scene that it varies.
    unread: str = ""  #: Function of a valid scene; yields the keys whose files a run does not read.
    #: Function of a scene, the paths that vary and what is collected; returns the plan of the samples
    #: (`dynid.scene.batch.SamplePlan`), or raises `NotShared`.
    samples: str = ""
    #: Module with `sections` and `method`: a result as facts and tables, for screens and pages.
    content: str = ""
    alternatives: str = ""  #: Mapping of the choices in a scene to functions that try their alternatives.

    def load(self, attribute: str) -> Any:
        """Return the object that a reference names; None where the kind has none."""
        return resolve(getattr(self, attribute))


def resolve(reference: str) -> Any:
    """Return the module, or the object in it, that `module` or `module:name` refers to; None for none."""
    if not reference:
        return None
    module, _, name = reference.partition(":")
    loaded = import_module(module)
    return getattr(loaded, name) if name else loaded


_KINDS = (
    Kind(
        "bond-graph",
        template="bond-graph.yaml",
        model="dynid.scene.schema.bond_graph:BondGraphScene",
        run="dynid.scene.kinds.bond_graph:run",
        explain="dynid.scene.kinds.explain_graph:explain",
        prepare="dynid.scene.kinds.bond_graph:preparation_steps",
        check_valid="dynid.scene.kinds.bond_graph:check_valid",
        doubts="dynid.scene.kinds.bond_graph:doubts",
        unread="dynid.scene.kinds.bond_graph:unread_files",
        samples="dynid.scene.kinds.bond_graph_samples:GraphSamples",
        content="dynid.report.content.bond_graph",
        alternatives="dynid.bench.scenes.aspects:GRAPH_ASPECTS",
    ),
    Kind(
        "identification",
        template="identification.yaml",
        model="dynid.scene.schema.identification:IdentificationScene",
        run="dynid.scene.kinds.identification:run",
        explain="dynid.scene.kinds.explain_identification:explain",
        prepare="dynid.scene.kinds.identification:preparation_steps",
        complete="dynid.scene.kinds.file_channels:completed",
        check_valid="dynid.scene.kinds.parameters:check_parameters",
        doubts="dynid.scene.kinds.identification:doubts",
        unread="dynid.scene.kinds.identification:unread_files",
        samples="dynid.scene.kinds.identification_samples:IdentificationSamples",
        content="dynid.report.content.identification",
        alternatives="dynid.bench.scenes.identification:ASPECTS",
    ),
    Kind(
        "reduction",
        template="reduction.yaml",
        model="dynid.scene.schema.reduction:ReductionScene",
        run="dynid.scene.kinds.reduction:run",
        explain="dynid.scene.kinds.reduction:explain",
        prepare="dynid.scene.kinds.reduction:preparation_steps",
        doubts="dynid.scene.kinds.structures:idle_masses",
        samples="dynid.scene.kinds.reduction_samples:ReductionSamples",
        content="dynid.report.content.reduction",
        alternatives="dynid.bench.scenes.aspects:REDUCTION_ASPECTS",
    ),
    Kind(
        "synthesis",
        template="synthesis.yaml",
        model="dynid.scene.schema.synthesis:SynthesisScene",
        run="dynid.scene.kinds.synthesis:run",
        explain="dynid.scene.kinds.explain_graph:explain_synthesis",
        prepare="dynid.scene.kinds.synthesis:preparation_steps",
        content="dynid.report.content.synthesis",
    ),
    Kind(
        "modal-analysis",
        template="modal-analysis.yaml",
        model="dynid.scene.schema.modal_analysis:ModalAnalysisScene",
        run="dynid.scene.kinds.modal_analysis:run",
        explain="dynid.scene.kinds.modal_analysis:explain",
        prepare="dynid.scene.kinds.modal_analysis:preparation_steps",
        complete="dynid.scene.kinds.file_channels:completed",
        content="dynid.report.content.modal_analysis",
    ),
    Kind(
        "study",
        template="study.yaml",
        model="dynid.scene.schema.study:StudyScene",
        run="dynid.scene.kinds.study:run",
        base="dynid.scene.kinds.study:base_scene",
        check_valid="dynid.scene.kinds.study:check_study",
        content="dynid.report.content.study",
    ),
)
#: The kinds by their names.
KINDS = {kind.name: kind for kind in _KINDS}
