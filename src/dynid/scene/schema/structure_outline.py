"""Faults that only the whole of a structure and its measurement shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from pydantic import ValidationError

from dynid.errors import Fault
from dynid.scene.schema.plain import is_mapping_of_mappings, listing, mapping, mapping_of, signals
from dynid.scene.schema.quantities import Names
from dynid.scene.schema.structure import StructureModel
from dynid.scene.yaml.source import Source
from dynid.words import did_you_mean


def structure_faults(source: Source, names: Names) -> list[Fault]:
    """Check that every node and DOF exists, and that what is to be identified can be simulated."""
    data = source.data
    structure = _structure(data, names)
    if structure is not None:
        faults = [source.fault(("structure", *path), message) for path, message in structure.faults()]
        known = structure.labels()
    else:
        faults, known = (
            [],
            list(range(1, 1 + len(listing(mapping(mapping(data, "structure"), "lumped"), "masses")))),
        )
    if known and not faults:
        faults += dof_faults(source, known)
    for path, signal in _excitations(data):
        if "base" in signal and ("dof" in signal or "motion" in signal):
            faults.append(source.fault((*path, "base"), "the base moves, or a 'dof' does", key=True))
        if "dof" not in signal and "base" not in signal:
            faults.append(source.fault(path, "this signal needs the 'dof' that it drives", key=True))
        if "source" in signal:
            faults.append(
                source.fault((*path, "source"), "a structure has DOFs, not sources; write 'dof'", key=True)
            )
    return [*faults, *_channel_faults(source), *_unknown_faults(source)]


def _structure(data: Any, names: Names) -> StructureModel | None:
    """Return the structure of a scene, if that is valid by itself."""
    try:
        return StructureModel.model_validate(mapping_of(data).get("structure"), context=names)
    except ValidationError:
        return None


def dof_faults(source: Source, labels: Sequence[int | str]) -> list[Fault]:
    """Check that every DOF of a scene is one of a structure, by its label or its number.

    Parameters
    ----------
    source
        The scene.
    labels
        Labels of the structure's DOFs; where they are texts, numbers count them from 1.
    """
    known = set(labels)
    count = 0 if any(isinstance(label, int) for label in labels) else len(labels)
    faults = []
    for path, dof in _dofs(source.data):
        if not isinstance(dof, int | str) or isinstance(dof, bool) or dof in known:
            continue
        if isinstance(dof, str) and dof:
            hint = did_you_mean(dof, (label for label in labels if isinstance(label, str)))
            message = f"there is no DOF '{dof}'{hint or _dofs_there(labels)}"
        elif isinstance(dof, int) and dof >= 1 and dof > count:
            message = f"there is no DOF {dof}{_dofs_there(labels)}"
        else:
            continue
        faults.append(source.fault(path, message, key=path[0] == "initial"))
    return faults


def _dofs_there(labels: Sequence[int | str]) -> str:
    return f"; the structure has {len(labels)}{f' ({labels[0]} … {labels[-1]})' if labels[0] != 1 else ''}"


def _channel_faults(source: Source) -> list[Fault]:
    """Check that no sensor stands twice."""
    return [
        source.fault((*path, "channels", place), "this channel is listed twice")
        for path, record in _records(source.data)
        for place, channel in enumerate(listing(record, "channels"))
        if isinstance(channel, dict) and channel in listing(record, "channels")[:place]
    ]


def _records(data: Any) -> Iterable[tuple[tuple[Any, ...], dict[Any, Any]]]:
    """Yield what all records of a measurement share, and every record, with their paths."""
    measurement = mapping(data, "measurement")
    yield ("measurement",), measurement
    for place, record in enumerate(listing(measurement, "records")):
        yield ("measurement", "records", place), mapping_of(record)


def _dofs(data: Any) -> Iterable[tuple[tuple[Any, ...], Any]]:
    """Yield every DOF number of a scene with its path."""
    links = listing(mapping(mapping(data, "structure"), "lumped"), "links")
    for place, link in enumerate(links):
        for end, dof in enumerate(listing(link, "dofs")):
            yield ("structure", "lumped", "links", place, "dofs", end), dof
    for name, joint in mapping(data, "joints").items():
        for end, dof in enumerate(listing(joint, "dofs")):
            yield ("joints", name, "dofs", end), dof
    for path, record in _records(data):
        yield from _sensor_dofs((*path, "channels"), listing(record, "channels"))
    analysis = mapping(data, "analysis")
    for place, dof in enumerate(listing(analysis, "inputs")):
        yield ("analysis", "inputs", place), dof
    yield from _sensor_dofs(("analysis", "outputs"), listing(analysis, "outputs"))
    for path, signal in _excitations(data):
        yield (*path, "dof"), signal.get("dof")
    yield from _reduction_dofs(data)
    for dof in mapping(data, "initial"):
        yield ("initial", dof), dof
    wanted = mapping(data, "plan")
    yield from _sensor_dofs(("plan", "candidates"), listing(wanted, "candidates"))
    for place, dof in enumerate(listing(mapping(wanted, "excitation"), "dofs")):
        yield ("plan", "excitation", "dofs", place), dof


def _reduction_dofs(data: Any) -> Iterable[tuple[tuple[Any, ...], Any]]:
    """Yield the DOFs that reductions and their comparison name."""
    parts: list[tuple[tuple[Any, ...], Any]] = [(("reduction",), data.get("reduction"))]
    parts += [(("reduction", place), part) for place, part in enumerate(listing(data, "reduction"))]
    for path, part in parts:
        for key in ("masters", "residuals"):
            yield from (((*path, key, place), dof) for place, dof in enumerate(listing(part, key)))
    for place, dof in enumerate(listing(data, "inputs")):
        yield ("inputs", place), dof
    for place, output in enumerate(listing(data, "outputs")):
        yield ("outputs", place, "dof"), mapping_of(output).get("dof")
    substructures = mapping(data, "substructures")
    for name in substructures:
        for place, dof in enumerate(listing(substructures, name)):
            yield ("substructures", name, place), dof


def unknown_joint_faults(source: Source) -> list[Fault]:
    """Check that all joints are known: reductions are compared at one value of them."""
    message = "the joints of a comparison are known: give a 'value', or the number alone"
    return [
        source.fault(("joints", name, part, "start"), message, key=True)
        for name, joint in mapping(source.data, "joints").items()
        for part in ("k", "c")
        if "start" in mapping_of(mapping_of(joint).get(part))
    ]


def _excitations(data: Any) -> Iterable[tuple[tuple[Any, ...], dict[Any, Any]]]:
    yield from signals(("excitation",), data.get("excitation"))
    yield from signals(("analysis", "time", "input"), mapping(mapping(data, "analysis"), "time").get("input"))
    for path, record in _records(data):
        yield from signals((*path, "excitation"), record.get("excitation"))


def _sensor_dofs(path: tuple[Any, ...], sensors: Sequence[Any]) -> Iterable[tuple[tuple[Any, ...], Any]]:
    for place, sensor in enumerate(sensors):
        yield (*path, place, "dof"), mapping_of(sensor).get("dof")
        yield (*path, place, "reference", "dof"), mapping(sensor, "reference").get("dof")
        for end, dof in enumerate(listing(sensor, "dofs")):
            yield (*path, place, "dofs", end), dof


def _unknown_faults(source: Source) -> list[Fault]:
    """Check that a measurement has unknowns to identify, and true values to simulate with."""
    measurement = mapping(source.data, "measurement")
    if not measurement:
        return []
    given = [
        (("joints", name, part), mapping_of(joint)[part])
        for name, joint in mapping(source.data, "joints").items()
        for part in ("k", "c")
        if part in mapping_of(joint)
    ]
    unknowns = [(path, mapping_of(value)) for path, value in given if "start" in mapping_of(value)]
    known = all(not isinstance(value, dict) or {*value} <= {"value", "matrix"} for _, value in given)
    if not unknowns and known and is_mapping_of_mappings(source.data.get("joints", {})):
        message = "there is nothing to identify: no joint parameter has a 'start'"
        return [source.fault(("measurement",), message, key=True)]
    records = [record for _, record in _records(source.data)]
    if not any("simulate" in part for record in records for part in (record, mapping(record, "frf"))):
        return []
    message = "a simulated measurement needs the 'true' value of this parameter"
    lacking = [
        path
        for path, value in unknowns
        if value.keys() <= {"start", "value", "matrix", "min", "max", "prior"}
    ]
    return [source.fault(path, message, key=True) for path in lacking]
