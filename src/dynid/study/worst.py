"""Scene of the worst sample of a study, to run it alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dynid.checks.comparison import word
from dynid.errors import UsageError
from dynid.result import Result
from dynid.scene.files import file_places, moved
from dynid.scene.schema.study import paths_of
from dynid.scene.yaml.parser import Path as KeyPath
from dynid.scene.yaml.source import Source, parse_source, path_of, set_values
from dynid.scene.yaml.writer import edited, flow
from dynid.study.analysis.sample_statistics import Direction, worst, worst_entries
from dynid.study.analysis.table import StudyTable, as_numbers

_WORDS = {"max": "largest", "min": "smallest", "abs": "farthest from 0"}


def _worst_sample(table: StudyTable, name: str, direction: Direction) -> tuple[int, float]:
    """Return the row and the value of the worst sample.

    `name` is the path of a number, of an array (its worst entry), or of an entry, `path[label]`. The largest
    value is worst, the smallest, or the largest magnitude; complex numbers are compared by their magnitude.
    Raises `UsageError` if there is no such number, or no sample has it.
    """
    path, entry = table.find(name)
    worst_values = np.full(len(table.numbers), np.nan)
    for start, values in table.variable(path).blocks():
        entries = as_numbers(values).reshape(len(values), -1)
        if entry is not None:
            entries = entries[:, [np.ravel_multi_index(entry, values.shape[1:])] if entry else [0]]
        worst_values[start : start + len(values)] = worst_entries(entries, direction)
    worst_row = worst(worst_values, direction)
    if worst_row is None:
        raise UsageError(f"no sample has a value at '{name}'")
    return worst_row, float(worst_values[worst_row])


def worst_scene(result: Result, name: str, direction: Direction, target: Path, command: str) -> str:
    """Return the scene of the worst sample as text; its run gives the numbers of the sample.

    It is the scene that the study varies, with the values of the sample and comments on the original ones;
    `target` is the folder of the new scene, to which names of files are made relative, `command` stands in a
    comment.
    """
    table = StudyTable(result)
    row, value = _worst_sample(table, name, direction)
    number = int(table.numbers[row])
    folder = str(result.attrs.get("folder", "."))
    base = parse_source(str(result.value("study/scene")), str(Path(folder) / "scene.yaml"))
    values = _overrides(table, row)
    data, changes = _relocated(base, values, target)
    notes = {}
    for dotted in values:
        path = path_of(base, dotted)
        try:
            notes[path] = f"set by the study; was {flow(_at(base.data, path))}"
        except (LookupError, TypeError):
            notes[path] = "set by the study"
    which = f"the {_WORDS[direction]} {name}" if direction != "abs" else f"{name} {_WORDS[direction]}"
    header = [
        f"# Sample {number} of the study '{' '.join(result.title.split())}': {which}, {word(value)}.",
        f"# Written by: {command}",
        *(f"# Set: {dotted} = {flow(new)}" for dotted, new in values.items()),
    ]
    return "\n".join([*header, edited(base.text, data, changes, notes)])


def _overrides(table: StudyTable, row: int) -> dict[str, Any]:
    """Return the values that a sample set in the scene, by dotted path, with their types in the study."""
    varied = str(table.result.group_attrs.get("study", {}).get("varied", "")).split("\n")
    # Texts in the file may be lists or mappings in the study, which lists them.
    choices: dict[str, list[Any]] = {}
    for key, factor in parse_source(str(table.result.attrs["scene"])).data.get("vary", {}).items():
        values = factor if isinstance(factor, list) else factor.get("values", [])
        paths = paths_of(key)
        for index, path in enumerate(paths):
            choices[path] = values if len(paths) == 1 else [value[index] for value in values]
    overrides = {}
    for path, column in table.inputs.items():
        if path in varied or "." in path:  # a derived name without a dot is not set in the scene
            value = column[row].item() if isinstance(column[row], np.generic) else column[row]
            overrides[path] = value
            for choice in choices.get(path, ()):
                as_json = isinstance(value, str) and not isinstance(choice, str)
                if value == (json.dumps(choice) if as_json else choice):
                    overrides[path] = choice
                    break
    return overrides


def _relocated(base: Source, values: Mapping[str, Any], target: Path) -> tuple[Any, dict[KeyPath, Any]]:
    """Return the data of a scene with other values and relocated names of files, and all changes by path."""
    set_paths = [path_of(base, dotted) for dotted in values]
    source, others = set_values(base, values), []
    for name_path in file_places(source.data):
        name = _at(source.data, name_path)
        new = moved(name, Path(base.file).parent, target)
        if new != name:
            source = set_values(source, {".".join(map(str, name_path)): new})
            others += [name_path] if not any(name_path[: len(path)] == path for path in set_paths) else []
    return source.data, {path: _at(source.data, path) for path in (*set_paths, *others)}


def _at(data: Any, path: KeyPath) -> Any:
    for key in path:
        data = data[key]
    return data
