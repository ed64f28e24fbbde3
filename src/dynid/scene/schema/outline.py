"""What a scene's names stand for, and the faults that only the whole of it shows.

These checks work on the plain data, as far as they make sense, so that they find their faults in a
scene that has others as well.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from pydantic import ValidationError

from dynid.bondgraph.decomposition.cut import bond_fault, loop_fault
from dynid.bondgraph.graph import NODE_TYPES, ONE_PORTS, Bond, graph_faults
from dynid.bondgraph.question import NUMERIC
from dynid.errors import Fault
from dynid.scene.arithmetic.expression import resolve_parameters
from dynid.scene.schema.chains import chain_ends
from dynid.scene.schema.quantities import Names
from dynid.scene.schema.structure import StructureModel
from dynid.scene.yaml.source import Source
from dynid.words import did_you_mean


def read_names(source: Source) -> tuple[Names, list[Fault]]:
    """Resolve the parameters and list the nodes of a scene.

    Returns
    -------
    Names, list of Fault
        The names, and what is wrong with the parameters.
    """
    raw = _mapping(source.data, "parameters")
    complete = isinstance(source.data.get("parameters", {}), dict)
    values, problems = resolve_parameters({str(name): value for name, value in raw.items()})
    faults = [source.fault(("parameters", _key(raw, name)), text) for name, text in problems.items()]
    return Names(values, frozenset(problems), _node_types(source), complete), faults


def whole_faults(source: Source, names: Names) -> list[Fault]:
    """Find the faults that concern several parts of a scene at once."""
    kind = source.data.get("kind")
    if kind == "bond-graph":
        faults = [*_bond_graph_faults(source), *_initial_faults(source), *_driving_faults(source)]
        faults += [*_port_faults(source), *_engine_faults(source)]
    else:
        faults = _structure_faults(source, names) if kind in ("identification", "reduction") else []
        faults += _unknown_joint_faults(source) if kind == "reduction" else []
    return [*faults, *_motionless_faults(source)]


def _motionless_faults(source: Source) -> list[Fault]:
    """Check that a motion from an initial state is asked for: nothing else shows it."""
    analysis = source.data.get("analysis", {})
    if not _mapping(source.data, "initial") or not isinstance(analysis, dict):
        return []
    if source.data.get("kind") == "bond-graph":
        return _unseen_energy_faults(source, analysis)
    place, message = ("initial",), "the initial state shows in a time response only; "
    if not any(did_you_mean(str(key), ["time"]) for key in analysis):
        return [source.fault(place, f"{message}it needs the block 'analysis.time'", key=True)]
    results = analysis.get("results")
    if isinstance(results, list) and not any(did_you_mean(str(name), ["time_response"]) for name in results):
        return [source.fault(place, f"{message}'results' does not list 'time_response'", key=True)]
    return []


def _unseen_energy_faults(source: Source, analysis: dict[Any, Any]) -> list[Fault]:
    """Check that stored energy shows: in a response, beside the transfer functions, or at a port."""
    results, showing = analysis.get("results"), ("time_response", "transfer_function")
    listed = not isinstance(results, list) or any(did_you_mean(str(name), showing) for name in results)
    if listed or "port" in analysis:
        return []
    message = "the initial state shows in a time response, a transfer function or at a port only; "
    message += "'results' lists neither 'time_response' nor 'transfer_function'"
    return [source.fault(("initial",), message, key=True)]


# --- bond graphs -----------------------------------------------------------------------------------


def _node_types(source: Source) -> dict[str, str]:
    nodes = _mapping(_mapping(source.data, "graph"), "nodes")
    types = {}
    for name, node in nodes.items():
        kind = node.get("type") if isinstance(node, dict) else node
        types[str(name)] = str(kind) if isinstance(kind, str | int) else ""
    return types


def _bond_graph_faults(source: Source) -> list[Fault]:
    """Check the number of bonds at every node.

    A bond that cannot be read is reported where it stands. A node that may only lack that bond is not
    reported as well; one that has too many already is.
    """
    nodes = _mapping(_mapping(source.data, "graph"), "nodes")
    types = _node_types(source)
    bonds, places, complete = _bonds(source, types)
    faults = []
    for fault in graph_faults({name: kind for name, kind in types.items() if kind in NODE_TYPES}, bonds):
        if fault.bond is not None:
            faults.append(source.fault(("graph", "bonds", places[fault.bond]), fault.message))
        elif fault.node is not None and bonds and (complete or _is_crowded(fault.node, types, bonds)):
            faults.append(source.fault(("graph", "nodes", _key(nodes, fault.node)), fault.message, key=True))
    return faults


def _bonds(source: Source, types: Mapping[str, str]) -> tuple[list[Bond], list[int], bool]:
    """Return the bonds that can be read, the entry that each stands in, and whether they are all."""
    bonds, places, complete = [], [], True
    for index, text in enumerate(_list(_mapping(source.data, "graph"), "bonds")):
        ends = chain_ends(text) if isinstance(text, str) else []
        read = bool(ends) and all(end in types for end in ends)
        complete = complete and read and all(a != b for a, b in pairwise(ends))
        if read:
            bonds += [Bond(tail, head) for tail, head in pairwise(ends)]
            places += [index] * (len(ends) - 1)
    return bonds, places, complete


def _port_faults(source: Source) -> list[Fault]:
    """Check that the port is a bond of the graph, and that the graph can be cut there."""
    text, types = _mapping(source.data, "analysis").get("port"), _node_types(source)
    ends = chain_ends(text) if isinstance(text, str) else []
    bonds, _, complete = _bonds(source, types)
    if len(ends) != 2 or not all(end in types for end in ends) or not complete:
        return []  # reported where it stands, or by what is wrong with the bonds
    problem = bond_fault(types, bonds, Bond(*ends)) or loop_fault(types, bonds, Bond(*ends))
    return [source.fault(("analysis", "port"), problem)] if problem else []


def _is_crowded(name: str, types: Mapping[str, str], bonds: list[Bond]) -> bool:
    """Tell whether a node has more bonds than ports, whatever bonds may be missing."""
    ins, outs = sum(bond.head == name for bond in bonds), sum(bond.tail == name for bond in bonds)
    return ins + outs > 1 if types[name] in ONE_PORTS else max(ins, outs) > 1


def _initial_faults(source: Source) -> list[Fault]:
    """Check that stored energy is given to storages, in their own variable."""
    types, faults = _node_types(source), []
    for name, given in _mapping(source.data, "initial").items():
        kind, path = types.get(str(name)), ("initial", name)
        if kind is None and types:
            faults.append(source.fault(path, f"no node '{name}'{did_you_mean(str(name), types)}", key=True))
        elif kind not in NODE_TYPES:
            continue  # reported where the node stands
        elif kind not in ("I", "C"):
            faults.append(
                source.fault(path, f"'{name}' is {kind} and stores no energy; only I and C do", key=True)
            )
        elif isinstance(given, dict):
            own, other = ("f", "e") if kind == "I" else ("e", "f")
            if other in given or own not in given:
                message = (
                    f"the energy of {kind} '{name}' is given by its {'flow f' if own == 'f' else 'effort e'}"
                )
                faults.append(source.fault(path, message))
    return faults


def _driving_faults(source: Source) -> list[Fault]:
    """Check that the signals of a time response drive inputs."""
    types, analysis = _node_types(source), _mapping(source.data, "analysis")
    given = _mapping(analysis, "time").get("input")
    inputs = [str(name) for name in _list(analysis, "inputs")]
    inputs = inputs or [name for name, kind in types.items() if kind in ("Se", "Sf")]
    faults = []
    for path, signal in _signals(("analysis", "time", "input"), given):
        name = signal.get("source")
        if isinstance(name, str) and name not in inputs:
            faults.append(
                source.fault((*path, "source"), f"'{name}' is not an input{did_you_mean(name, inputs)}")
            )
        if "dof" in signal:
            faults.append(source.fault((*path, "dof"), "a bond graph has sources, not DOFs", key=True))
        for key in ("motion", "base"):
            if key in signal:
                message = f"'{key}' belongs to structures; a flow source prescribes a motion"
                faults.append(source.fault((*path, key), message, key=True))
    return faults


def _engine_faults(source: Source) -> list[Fault]:
    """Check that the engine has what is asked for, and that formulas have a transfer function to be of."""
    analysis = _mapping(source.data, "analysis")
    results = _list(analysis, "results")
    faults = []
    if analysis.get("engine") == "symbolic":
        faults = [
            source.fault(
                ("analysis", "results", place),
                f"'{name}' needs numbers, and the symbolic engine has formulas alone; write 'engine: auto'",
            )
            for place, name in enumerate(results)
            if isinstance(name, str) and name in NUMERIC
        ]
    asks_for_it = any(did_you_mean(str(name), ["transfer_function"]) for name in results)
    if analysis.get("symbolic") is not None and results and not asks_for_it:
        message = "formulas are of the transfer function; 'results' does not list 'transfer_function'"
        faults.append(source.fault(("analysis", "symbolic"), message, key=True))
    return faults


# --- structures ------------------------------------------------------------------------------------


def _structure_faults(source: Source, names: Names) -> list[Fault]:
    """Check that every node and DOF exists, and that what is to be identified can be simulated."""
    data = source.data
    structure = _structure(data, names)
    if structure is not None:
        faults = [source.fault(("structure", *path), message) for path, message in structure.faults()]
        known = structure.labels()
    else:
        faults, known = (
            [],
            list(range(1, 1 + len(_list(_mapping(_mapping(data, "structure"), "lumped"), "masses")))),
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
        return StructureModel.model_validate(_mapping_of(data).get("structure"), context=names)
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
        for place, channel in enumerate(_list(record, "channels"))
        if isinstance(channel, dict) and channel in _list(record, "channels")[:place]
    ]


def _records(data: Any) -> Iterable[tuple[tuple[Any, ...], dict[Any, Any]]]:
    """Yield what all records of a measurement share, and every record, with their paths."""
    measurement = _mapping(data, "measurement")
    yield ("measurement",), measurement
    for place, record in enumerate(_list(measurement, "records")):
        yield ("measurement", "records", place), _mapping_of(record)


def _dofs(data: Any) -> Iterable[tuple[tuple[Any, ...], Any]]:
    """Yield every DOF number of a scene with its path."""
    links = _list(_mapping(_mapping(data, "structure"), "lumped"), "links")
    for place, link in enumerate(links):
        for end, dof in enumerate(_list(link, "dofs")):
            yield ("structure", "lumped", "links", place, "dofs", end), dof
    for name, joint in _mapping(data, "joints").items():
        for end, dof in enumerate(_list(joint, "dofs")):
            yield ("joints", name, "dofs", end), dof
    for path, record in _records(data):
        yield from _sensor_dofs((*path, "channels"), _list(record, "channels"))
    analysis = _mapping(data, "analysis")
    for place, dof in enumerate(_list(analysis, "inputs")):
        yield ("analysis", "inputs", place), dof
    yield from _sensor_dofs(("analysis", "outputs"), _list(analysis, "outputs"))
    for path, signal in _excitations(data):
        yield (*path, "dof"), signal.get("dof")
    yield from _reduction_dofs(data)
    for dof in _mapping(data, "initial"):
        yield ("initial", dof), dof
    wanted = _mapping(data, "plan")
    yield from _sensor_dofs(("plan", "candidates"), _list(wanted, "candidates"))
    for place, dof in enumerate(_list(_mapping(wanted, "excitation"), "dofs")):
        yield ("plan", "excitation", "dofs", place), dof


def _reduction_dofs(data: Any) -> Iterable[tuple[tuple[Any, ...], Any]]:
    """Yield the DOFs that reductions and their comparison name."""
    parts: list[tuple[tuple[Any, ...], Any]] = [(("reduction",), data.get("reduction"))]
    parts += [(("reduction", place), part) for place, part in enumerate(_list(data, "reduction"))]
    for path, part in parts:
        for key in ("masters", "residuals"):
            yield from (((*path, key, place), dof) for place, dof in enumerate(_list(part, key)))
    for place, dof in enumerate(_list(data, "inputs")):
        yield ("inputs", place), dof
    for place, output in enumerate(_list(data, "outputs")):
        yield ("outputs", place, "dof"), _mapping_of(output).get("dof")
    substructures = _mapping(data, "substructures")
    for name in substructures:
        for place, dof in enumerate(_list(substructures, name)):
            yield ("substructures", name, place), dof


def _unknown_joint_faults(source: Source) -> list[Fault]:
    """Check that all joints are known: reductions are compared at one value of them."""
    message = "the joints of a comparison are known: give a 'value', or the number alone"
    return [
        source.fault(("joints", name, part, "start"), message, key=True)
        for name, joint in _mapping(source.data, "joints").items()
        for part in ("k", "c")
        if "start" in _mapping_of(_mapping_of(joint).get(part))
    ]


def _excitations(data: Any) -> Iterable[tuple[tuple[Any, ...], dict[Any, Any]]]:
    yield from _signals(("excitation",), data.get("excitation"))
    yield from _signals(
        ("analysis", "time", "input"), _mapping(_mapping(data, "analysis"), "time").get("input")
    )
    for path, record in _records(data):
        yield from _signals((*path, "excitation"), record.get("excitation"))


def _sensor_dofs(path: tuple[Any, ...], sensors: Sequence[Any]) -> Iterable[tuple[tuple[Any, ...], Any]]:
    for place, sensor in enumerate(sensors):
        yield (*path, place, "dof"), _mapping_of(sensor).get("dof")
        for end, dof in enumerate(_list(sensor, "dofs")):
            yield (*path, place, "dofs", end), dof


def _unknown_faults(source: Source) -> list[Fault]:
    """Check that a measurement has unknowns to identify, and true values to simulate with."""
    measurement = _mapping(source.data, "measurement")
    if not measurement:
        return []
    given = [
        (("joints", name, part), _mapping_of(joint)[part])
        for name, joint in _mapping(source.data, "joints").items()
        for part in ("k", "c")
        if part in _mapping_of(joint)
    ]
    unknowns = [(path, _mapping_of(value)) for path, value in given if "start" in _mapping_of(value)]
    known = all(not isinstance(value, dict) or {*value} <= {"value", "matrix"} for _, value in given)
    if not unknowns and known and _is_mapping_of_mappings(source.data.get("joints", {})):
        message = "there is nothing to identify: no joint parameter has a 'start'"
        return [source.fault(("measurement",), message, key=True)]
    if not any("simulate" in record for _, record in _records(source.data)):
        return []
    message = "a simulated measurement needs the 'true' value of this parameter"
    lacking = [
        path
        for path, value in unknowns
        if value.keys() <= {"start", "value", "matrix", "min", "max", "prior"}
    ]
    return [source.fault(path, message, key=True) for path in lacking]


# --- plain data ------------------------------------------------------------------------------------


def _signals(path: tuple[Any, ...], given: Any) -> Iterable[tuple[tuple[Any, ...], dict[Any, Any]]]:
    if isinstance(given, dict):
        yield path, given
    elif isinstance(given, list):
        yield from (
            ((*path, place), signal) for place, signal in enumerate(given) if isinstance(signal, dict)
        )


def _mapping_of(value: Any) -> dict[Any, Any]:
    return value if isinstance(value, dict) else {}


def _is_mapping_of_mappings(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(entry, dict) for entry in value.values())


def _mapping(holder: Any, key: str) -> dict[Any, Any]:
    return _mapping_of(_mapping_of(holder).get(key))


def _list(holder: Any, key: str) -> list[Any]:
    value = _mapping_of(holder).get(key)
    return value if isinstance(value, list) else []


def _key(mapping: dict[Any, Any], name: str) -> Any:
    """Return the key of a mapping that is written like `name` (a number may be a key)."""
    return name if name in mapping else next((key for key in mapping if str(key) == name), name)
