"""Scenes with results in place of unknowns: estimates of an identification, values of a design."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import reduce
from operator import getitem
from typing import Any

import yaml

from dynid.errors import SceneError, UsageError
from dynid.result import Result
from dynid.scene.composition import composed
from dynid.scene.models import is_instance
from dynid.scene.schema.raw import mapping, written_key
from dynid.scene.yaml.parser import Path
from dynid.scene.yaml.source import Source, parse_source
from dynid.scene.yaml.writer import dump, edited
from dynid.structure.joint_laws import LAWS

#: Keys that belong to the identification alone.
_OF_IDENTIFICATION = {
    *("measurement", "estimator", "identifiability", "derived", "posterior_check", "plan", "accuracy")
}
_PARAMETERS = "identification/parameters"
_DESIGN = "bond_graph/design"


def identified_scene(result: Result, file: str = "") -> str:
    """Return the scene of an identification as YAML in which every unknown has its estimate.

    Estimates have all their digits; comments give the standard errors. What belongs to the identification
    alone (measurement, estimator, its expectations) is left out; the analysis stays, or modes are requested.
    A graph becomes a scene of kind bond-graph. Order and comments stay where values stand in one line each.

    Parameters
    ----------
    result
        The result of an identification, with its scene.
    file
        Its name, for messages.

    Raises
    ------
    UsageError
        If it is no identification, or has no scene.
    """
    if result.rejected:
        raise UsageError(
            f"{file or 'the result'} is rejected: its fit does not explain the record",
            remedy="Correct the model or the record, and run the scene again.",
        )
    if f"{_PARAMETERS}/estimate" not in result:
        raise UsageError(
            f"{file or 'the result'} holds no identification: there are no estimates",
            remedy="Export the scene of a run with a `measurement` and unknown parameters.",
        )
    source = _scene_of(result, file, result[f"{_PARAMETERS}/name"].data.tolist())
    text = source.text
    values = dict(_estimates(source, result))
    notes: dict[Path, str] = {}
    first: dict[Any, Path] = {}  # one comment a line
    for path, (_, note) in values.items():
        line = source.marks[path].value[0] if path in source.marks else path
        path_of_line = first.setdefault(line, path)
        notes[path_of_line] = (
            f"{notes[path_of_line]}, {note}" if path_of_line in notes else f"standard error: {note}"
        )
    changes: dict[Path, Any] = {path: value for path, (value, _) in values.items()}
    data = {key: value for key, value in source.data.items() if key not in _dropped(source.data)}
    changes |= _requests(source.data, data)
    kept = _without_keys(text, _dropped(source.data), data).rstrip() + "\n"
    for path, value in changes.items():
        data = _changed_at(data, path, value)
    notes = {path: note for path, note in notes.items() if path[0] in data}
    return edited(kept, data, changes, notes)


def _scene_of(result: Result, file: str, names: Sequence[str]) -> Source:
    """Return the scene of a result, without its models where a parameter of these names is within one."""
    text = str(result.attrs.get("scene", ""))
    if not text:
        raise UsageError(f"{file or 'the result'} holds no scene", remedy="Run the scene again.")
    source = parse_source(text, file or "<scene>")
    if all(_place_of_unknown(source.data, name) for name in names):
        return source
    return parse_source(dump(composed(source).data), file or "<scene>")  # of one instance, not of the model


def _estimates(source: Source, result: Result) -> Iterator[tuple[Path, tuple[Any, str]]]:
    parts = (result[f"{_PARAMETERS}/{name}"].data for name in ("name", "estimate", "standard_error"))
    for name, estimate, error in zip(*parts, strict=True):
        path = _place_of_unknown(source.data, str(name))
        value: Any = float(estimate)
        written: Any = reduce(getitem, path, source.data)
        if isinstance(written, dict) and "matrix" in written:
            value = {"value": value, "matrix": written["matrix"]}
        yield path, (value, f"{name} {float(error):.3g}")


def _place_of_unknown(data: Any, name: str) -> Path:
    """Return the path of an unknown: parameter, k or c of a joint, value of an instance; empty for others."""
    if name in (data.get("parameters") or {}):
        return ("parameters", name)
    holder, _, parameter = name.rpartition(".")
    if holder in mapping(mapping(data, "graph"), "nodes"):
        node = data["graph"]["nodes"][holder]
        return ("graph", "nodes", holder, parameter) if is_instance(node) and parameter in node else ()
    line, _, number = holder.rpartition(".")
    copies = mapping(mapping(mapping(data, "graph"), "nodes").get(line), "copies")
    if parameter in mapping(copies, key := written_key(copies, number)):
        return ("graph", "nodes", line, "copies", key, parameter)
    joints = {str(key): key for key in mapping(data, "joints")}
    for joint, key in joints.items():
        if (place := dict(_places_of_laws(joint, data["joints"][key])).get(name)) is not None:
            return ("joints", key, *place)
    joint, _, letter = holder.rpartition(".")  # of a joint between points: bolt.k.x
    if joint in joints and holder not in joints:
        return ("joints", joints[joint], letter, parameter)
    return ("joints", joints[holder], parameter) if holder in joints else ()


def _places_of_laws(joint: str, data: Any) -> Iterator[tuple[str, Path]]:
    """Yield the names of the parameters of a joint's laws, as of `Joint.law_parameters`, with their paths."""
    earlier: dict[str, list[str]] = {}  # kinds by component
    for index, law in enumerate(data.get("laws") or ()):
        kind, component = law["kind"], f".{law['component']}" if "component" in law else ""
        kinds = earlier.setdefault(component, [])
        names = {*getattr(LAWS[kind], "names", ())}
        count = kinds.count(kind) + 1
        numbered = f"{kind}_{count}" if count > 1 else kind
        shared = any(names & {*getattr(LAWS[before], "names", ())} for before in kinds)
        prefix = f"{joint}.{numbered}" if shared else joint
        kinds.append(kind)
        yield from ((f"{prefix}.{name}{component}", ("laws", index, name)) for name in names)


def _dropped(data: Any) -> set[str]:
    """Return the keys of a scene that the identified one has not."""
    keys: set[str] = _OF_IDENTIFICATION & data.keys()
    analysis = data.get("analysis") or {}
    if not analysis.get("time"):
        keys |= {"initial"} & data.keys()
    if "graph" in data:
        keys |= {"excitation"} & data.keys()
    expectations = [one for one in data.get("expect") or [] if not _of_identification(one)]
    if "expect" in data and not expectations:
        keys.add("expect")
    return keys


def _of_identification(expectation: Any) -> bool:
    return isinstance(expectation, dict) and str(expectation.get("path", "")).startswith("identification/")


def _requests(before: Any, data: Any) -> dict[Path, Any]:
    """Return what else changes: the kind and analysis of a graph, the analysis and outputs of a structure."""
    changes: dict[Path, Any] = {}
    measurement, analysis = before.get("measurement") or {}, before.get("analysis") or {}
    records = measurement.get("records") or [measurement]
    channels = _distinct(one for record in records for one in record.get("channels") or ())
    channels = channels or _distinct(measurement.get("channels") or ())
    references = [one["reference"] for one in channels if "reference" in one]
    if "graph" in before:
        changes["kind",] = "bond-graph"
        loads = [load for one in (before, measurement, *records) for load in _signals(one)]
        asked = {
            "inputs": _distinct(one["source"] for one in (*loads, *references)),
            "outputs": _distinct(one["output"] for one in channels),
        }
        if analysis:
            changes |= {("analysis", key): value for key, value in asked.items() if key not in analysis}
        else:
            changes["analysis",] = asked
    elif not analysis:
        changes["analysis",] = {"modes": {}}
    elif "frequency" in analysis or "time" in analysis:
        keys = ("dof", "dofs", "quantity", "frame")
        outputs = _distinct({key: one[key] for key in keys if key in one} for one in channels)
        forces = _distinct(one["dof"] for one in references) if "frequency" in analysis else []
        asked = {"inputs": forces, "outputs": outputs}
        changes |= {("analysis", key): value for key, value in asked.items() if value and key not in analysis}
    if "expect" in data:
        changes["expect",] = [one for one in data["expect"] if not _of_identification(one)]
        if changes["expect",] == data["expect"]:
            del changes["expect",]
    return changes


def _signals(holder: Any) -> list[Any]:
    signals = holder.get("excitation") or []
    return [signals] if isinstance(signals, dict) else signals


def _distinct(values: Any) -> list[Any]:
    distinct: list[Any] = []
    for value in values:
        if value not in distinct:
            distinct.append(value)
    return distinct


def _changed_at(data: Any, path: Path, value: Any) -> Any:
    """Return data with another value at a path, mappings on the way copied."""
    if not path:
        return value
    key = path[0]
    if isinstance(data, list) and isinstance(key, int):
        return [*data[:key], _changed_at(data[key], path[1:], value), *data[key + 1 :]]
    return {**(data or {}), key: _changed_at((data or {}).get(key), path[1:], value)}


def _without_keys(text: str, keys: set[str], data: Any) -> str:
    """Return the text of a scene without some keys of the top level; comments before the next key stay."""
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if not isinstance(root, yaml.MappingNode) or root.flow_style:
        return dump(data)
    lines, starts = text.splitlines(keepends=True), [key.start_mark.line for key, _ in root.value]
    kept = lines[: starts[0]]
    for index, (key, _) in enumerate(root.value):
        stop = starts[index + 1] if index + 1 < len(starts) else len(lines)
        block = lines[starts[index] : stop]
        if key.value in keys:
            # Comments and blank lines at the end belong to what follows.
            length = len(block)
            while length > 1 and re.match(r"#|\s*$|\.\.\.|---", block[length - 1]):
                length -= 1
            block = block[length:]
        kept += block
    kept_text = "".join(kept)
    return kept_text if parse_source(kept_text).data == data else dump(data)


def holds_design(result: Result) -> bool:
    """Return True if a result is that of a design."""
    return f"{_DESIGN}/value" in result


def designed_scene_text(result: Result, file: str = "") -> str:
    """Return the scene of a design as YAML, without the design, with all digits of the designed values.

    Comments give the starts. Expectations of the design are left out. Order and comments stay where values
    stand in one line each. `file` is its name, for messages. Raises `UsageError` if it has no scene.
    """
    names, values, starts = (result[f"{_DESIGN}/{key}"].data.tolist() for key in ("name", "value", "start"))
    source = _scene_of(result, file, names)
    text = source.text
    changes: dict[Path, Any] = {}
    notes: dict[Path, str] = {}
    for name, value, start in zip(names, values, starts, strict=True):
        path = _place_of_unknown(source.data, name)
        changes[path], notes[path] = value, f"designed, from {start:.6g}"
    expectations = source.data.get("expect") or []
    expected = [item for item in expectations if not str(item.get("path", "")).startswith(f"{_DESIGN}/")]
    dropped = {"design"} | ({"expect"} if expectations and not expected else set())
    data = {key: value for key, value in source.data.items() if key not in dropped}
    if expected and expected != expectations:
        data["expect"] = expected
        text = _without_entries(
            source, [k for k, expectation in enumerate(expectations) if expectation not in expected], expected
        )
    kept = _without_keys(text, dropped, data).rstrip() + "\n"
    for path, value in changes.items():
        data = _changed_at(data, path, value)
    return edited(kept, data, changes, notes)


def _without_entries(source: Source, places: list[int], expected: list[Any]) -> str:
    """Return the text of a scene without some expectations, each of which stands in a line."""
    lines = {source.marks["expect", index].value[0] for index in places if ("expect", index) in source.marks}
    written = source.text.splitlines(keepends=True)
    text = "".join(line for number, line in enumerate(written, 1) if number not in lines)
    data = {**source.data, "expect": expected}
    try:
        return text if parse_source(text).data == data else dump(data)
    except SceneError:
        return dump(data)
