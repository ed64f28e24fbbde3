"""Requests of a scene on which groups of results depend: the reason why a group is absent, before the run.

Groups that follow from the data, such as `equivalent_optima`, are left to the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

from dynid.bondgraph.analysis_request import PROPERTIES, ResultName
from dynid.errors import DynidError
from dynid.scene.kinds.result_layout import RECORD
from dynid.scene.schema.measurement import NoiseModel
from dynid.suggestions import shortened

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.scene.schema.bond_graph import AnalysisModel, BondGraphScene
    from dynid.scene.schema.identification import IdentificationScene
    from dynid.scene.schema.measurement import MeasurementModel
    from dynid.structure.model import StructuralModel

    GraphScene = BondGraphScene | IdentificationScene

#: The groups of bond graphs, with the results of which one has to be requested.
GROUPS: dict[str, frozenset[ResultName]] = {
    "transfer_function": frozenset({"transfer_function", "zeros", "poles"}),
    "properties": frozenset(PROPERTIES),
    "frequency_response": frozenset({"frequency_response"}),
    "frequency_peaks": frozenset({"frequency_response"}),
    "time_response": frozenset({"time_response"}),
    "state_space": frozenset({"state_space"}),
    "sensitivities": frozenset({"sensitivities"}),
    "causality": frozenset({"causality"}),
    "energy": frozenset({"energy"}),
    "source_performance": frozenset({"source_performance"}),
    "reduction": frozenset({"reduction", "prototype"}),
    "system": frozenset({"properties"}),
    "zero_input": frozenset({"transfer_function"}),
    **dict.fromkeys(("margins", "sensitivity_functions", "root_locus"), frozenset({"properties"})),
}
#: Further groups of bond graphs, which come with blocks of the scene.
OTHER_GROUPS = frozenset({"port", "operating_point", "design", "need"})
#: Groups of bond graphs that come with a block of the scene, and how to write that.
_OF_BLOCKS = {
    "margins": "a graph without loops has no margins; close loops with 'control'",
    "sensitivity_functions": "a graph without loops has no sensitivity functions; close loops with 'control'",
    "root_locus": "a graph without loops has no root locus; close loops with 'control'",
    "port": "'port' needs the bond at which the graph is cut; name it in 'analysis.port'",
    "design": "'design' needs the block 'design'",
    "design/compared": "'compared' is of the designs to 'compare'; name their values in 'design'",
    "zero_input": "'zero_input' is of stored energy; give it in 'initial'",
    "operating_point": "a graph without laws has no operating point; write a 'law' or an 'operating_point'",
}
_OF_TIME = frozenset({"history", "first_pass", "states", "innovations", "residual_spectrum"})
#: Kinds of derived quantities, by their groups; gains come with zeros.
_DERIVED = {name: name for name in ("poles", "zeros", "modes", "frequency_response")} | {"gains": "zeros"}


def analysis_of(scene: Scene) -> AnalysisModel | None:
    """Return the analysis of the graph of a scene, if it has one."""
    model: GraphScene = scene.model
    return model.analysis if model.kind == "bond-graph" else model.graph_analysis


def absence_in_graph(model: GraphScene, analysis: AnalysisModel, group: str) -> str:
    """Return the reason why the analysis of a graph has no results in a group; empty where it may have."""
    if group == "need" and model.kind == "identification":
        return "the scope of an identified graph stands in 'identification/need'"
    if group in _OF_BLOCKS and not _has_block(group, model, analysis):
        return _OF_BLOCKS[group]
    if group in GROUPS and analysis.asked().isdisjoint(GROUPS[group]):
        return _unrequested(group, min(GROUPS[group]), analysis)
    return ""


def _has_block(group: str, model: GraphScene, analysis: AnalysisModel) -> bool:
    from dynid.scene.kinds.graph_parts import has_law

    if group == "port":
        return analysis.port is not None
    if group == "zero_input":
        return bool(model.initial)
    if group == "operating_point":
        nodes = model.graph.nodes.values() if model.graph is not None else ()
        return getattr(model, "operating_point", None) is not None or any(map(has_law, nodes))
    if group.startswith("design"):
        design = getattr(model, "design", None)
        return design is not None and (group == "design" or bool(design.compare))
    return getattr(model, "control", None) is not None


def _unrequested(group: str, result: ResultName, analysis: AnalysisModel) -> str:
    block = {"frequency_response": "frequency", "time_response": "time"}.get(result, "")
    if block and getattr(analysis, block) is None:
        return f"'{group}' needs the block '{block}' in 'analysis'"
    return f"'{group}' comes with the result '{result}', which 'results' does not list; add it"


@lru_cache(maxsize=1)
def structure_in(scene: Scene) -> StructuralModel:
    """Return the structure of a reduction or of an identification.

    Raises `DynidError` where it cannot be built.
    """
    if scene.kind == "reduction":
        from dynid.scene.kinds.structures import build_structure

        return build_structure(scene, scene.model.structure, scene.model.joints)
    from dynid.scene.kinds.identification import structure_of

    return structure_of(scene)


def absence_in_structure(scene: Scene, group: str) -> str:
    """Return the reason why a scene has no results of its structure in a group; empty where it may have."""
    model = scene.model
    graph = getattr(model, "graph", None)
    if graph is not None:
        # of structures in a graph there is a doubt of their nodes alone
        structures = any(node.type == "structure" for node in graph.nodes.values())
        return "" if group == "nodes" and structures else "a graph has no results of a structure"
    block = {"frequency_peaks": "frequency", "frequency_response": "frequency", "time_response": "time"} | {
        "modes": "modes"
    }
    if group == "geometry":
        try:
            nodes = structure_in(scene).nodes
        except DynidError:  # which the preparation of the run reports
            return ""
        return "a structure without positions of nodes has no 'geometry'" if nodes is None else ""
    if group not in block:
        return ""
    if model.kind == "reduction":
        return f"a comparison of reductions has no results 'structure/{group}'; they stand in 'reduction'"
    if model.responses is None or getattr(model.responses, block[group]) is None:
        return f"'{group}' needs the block '{block[group]}' in 'analysis'"
    return ""


def absence_in_identification(model: IdentificationScene, names: Sequence[str]) -> str:
    """Return the reason why an identification has no results at a path; empty where it may have."""
    measurement, (group, *below) = model.measurement, names
    if group == "need":
        return ""
    if measurement is None:
        return "nothing is identified without the block 'measurement'"
    if group in _OF_TIME | {"measurement"}:
        return _absence_of_records(model, group) or _absence_of_record(len(measurement.each), below[0])
    if group == "derived":
        return _absence_of_derived(model, below[0])
    noises = [record.noise for record in measurement.each]
    conditions = {
        "robust": (model.estimator.loss == "huber", "the loss 'huber' of the 'estimator'"),
        "posterior": (model.posterior_check, "'posterior_check: true'"),
        "identifiability": (model.identifiability, "'identifiability: true'"),
        "modes": (measurement.modes is not None, "measured 'modes'"),
        "noise": (
            any(isinstance(noise, NoiseModel) for noise in noises),
            "a 'noise' of the kind coloured or proportional",
        ),
        "model_error": (
            model.is_reduced and measurement.modes is None and not _is_simulated_reduced(measurement),
            "a 'reduction' and records of the full structure",
        ),
    }
    met, cause = conditions.get(group, (True, ""))
    return "" if met else f"'{group}' comes with {cause}, which the scene does not have"


def _is_simulated_reduced(measurement: MeasurementModel) -> bool:
    simulated = [record.frf.simulate if record.frf else record.simulate for record in measurement.each]
    return any(simulation is not None and simulation.model == "reduced" for simulation in simulated)


def _absence_of_records(model: IdentificationScene, group: str) -> str:
    measurement, estimator = model.measurement, model.estimator
    assert measurement is not None
    if measurement.modes_alone:
        return f"measured modes alone have no '{group}'; it is of records"
    if measurement.frf is not None and group in _OF_TIME:
        return f"frequency responses have no '{group}'; it is of records of time"
    passes = estimator.method == "filter" and estimator.passes != 1
    if (group == "innovations" and not passes) or (
        group == "first_pass" and not passes and estimator.method != "auto"
    ):
        return f"'{group}' comes with several passes of the method 'filter' of the 'estimator'"
    return ""


def _absence_of_record(count: int, name: str) -> str:
    """Return the reason why no group of a record has a name; of several records each has a group."""
    groups = [f"{RECORD}{number}" for number in range(1, count + 1)]
    if count > 1 and name not in groups:
        return f"each record has a group of its own; there are: {shortened(groups)}"
    return f"there is one record; leave '{name}' out" if count == 1 and name.startswith(RECORD) else ""


def _absence_of_derived(model: IdentificationScene, group: str) -> str:
    assert model.measurement is not None
    if model.measurement.modes_alone and group in _DERIVED:
        return "nothing is derived from measured modes alone; these are of records"
    if model.derived is None:
        return ""
    if not model.derived:
        return "nothing is derived: 'derived' is empty; list what is to be"
    kind = _DERIVED.get(group)
    return "" if kind is None or kind in model.derived else f"'{kind}' is not in the list 'derived'; add it"
