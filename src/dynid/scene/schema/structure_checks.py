"""Faults of a structure and its measurement that concern several keys at once."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ValidationError

from dynid.errors import Fault
from dynid.scene.schema.identification import IdentificationScene
from dynid.scene.schema.joints import ParameterModel
from dynid.scene.schema.measurement import RecordModel
from dynid.scene.schema.quantities import SceneNames
from dynid.scene.schema.raw import is_mapping_of_mappings, listing, mapping, mapping_of
from dynid.scene.schema.reduction import ReductionScene
from dynid.scene.schema.references import dof_faults, node_faults, sections
from dynid.scene.schema.signals import SignalPart
from dynid.scene.schema.structure import StructureModel
from dynid.scene.yaml.source import Source
from dynid.suggestions import did_you_mean


def identification_faults(source: Source, names: SceneNames) -> list[Fault]:
    """Check nodes, DOFs, loads and channels, that what is to be identified can be, and the initial motion."""
    data, model = source.data, IdentificationScene
    faults = structure_faults(source, model, names)
    for path, signal in sections(model, data, SignalPart):
        if "base" in signal and ("dof" in signal or "motion" in signal):
            faults.append(source.fault((*path, "base"), "the base moves, or a 'dof' does", key=True))
        if "dof" not in signal and "base" not in signal:
            faults.append(source.fault(path, "this signal needs the 'dof' that it drives", key=True))
        if "source" in signal:
            message = "a structure has DOFs, not sources; write 'dof'"
            faults.append(source.fault((*path, "source"), message, key=True))
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


def reduction_faults(source: Source, names: SceneNames) -> list[Fault]:
    """Check nodes and DOFs, and that all joints are known: reductions are compared at one value of them."""
    message = "the joints of a comparison are known: give a 'value', or the number alone"
    unknown = [
        source.fault((*path, "start"), message, key=True)
        for path, parameter in sections(ReductionScene, source.data, ParameterModel)
        if "start" in parameter
    ]
    return structure_faults(source, ReductionScene, names) + unknown


def structure_faults(source: Source, model: type[BaseModel], names: SceneNames) -> list[Fault]:
    """Check that every node and DOF that a scene names is one of its structure."""
    given = mapping_of(source.data).get("structure")
    labels: list[int | str] | None
    try:
        structure = StructureModel.model_validate(given, context=names)
    except ValidationError:
        faults, labels = [], list(range(1, 1 + len(listing(mapping(given, "lumped"), "masses"))))
    else:
        wrong = [*node_faults(StructureModel, given, structure.nodes), *structure.faults()]
        faults = [source.fault(("structure", *path), message) for path, message in wrong]
        labels = structure.labels()
    return dof_faults(source, model, labels) if labels and not faults else faults


def _unknown_faults(source: Source, *, simulated: bool) -> list[Fault]:
    """Check that a measurement has unknowns to identify, and true values where it is simulated."""
    if not mapping(source.data, "measurement"):
        return []
    joints = source.data.get("joints", {})
    given: dict[tuple[Any, ...], Any] = {
        ("joints", name, letter): joint[letter]
        for name, joint in mapping_of(joints).items()
        for letter in ("k", "c")
        if letter in mapping_of(joint)
    }
    unknowns = {path: value for path, value in given.items() if "start" in mapping_of(value)}
    known = all(not isinstance(value, dict) or {*value} <= {"value", "matrix"} for value in given.values())
    if not unknowns and known and is_mapping_of_mappings(joints):
        message = "there is nothing to identify: no joint parameter has a 'start'"
        return [source.fault(("measurement",), message, key=True)]
    allowed = {"start", "value", "matrix", "min", "max", "prior"}  # another key may be 'true', misspelt
    message = "a simulated measurement needs the 'true' value of this parameter"
    lacking = [path for path, value in unknowns.items() if simulated and value.keys() <= allowed]
    return [source.fault(path, message, key=True) for path in lacking]
