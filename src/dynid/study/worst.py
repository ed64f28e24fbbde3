"""The scene of one sample of a study, to be run alone."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
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
from dynid.study.analysis.statistics import Direction, worst, worst_entries
from dynid.study.analysis.table import StudyTable, as_numbers

_WORDS = {"max": "largest", "min": "smallest", "abs": "farthest from 0"}


def worst_sample(table: StudyTable, name: str, direction: Direction) -> tuple[int, float]:
    """Return the row of the worst sample and what it has there.

    Parameters
    ----------
    table
        The study.
    name
        What is judged: the path of a number, of an array (of which the worst entry counts), or of an entry,
        `path[label]`.
    direction
        Whether the largest is worst, the smallest, or what is farthest from 0; of complex numbers it is the
        magnitude.

    Raises
    ------
    UsageError
        Where there is no such number, or no sample has it.
    """
    path, place = table.find(name)
    found = np.full(len(table.numbers), np.nan)
    for start, values in table.variable(path).blocks():
        entries = as_numbers(values).reshape(len(values), -1)
        if place is not None:
            entries = entries[:, [np.ravel_multi_index(place, values.shape[1:])] if place else [0]]
        found[start : start + len(values)] = worst_entries(entries, direction)
    worst_row = worst(found, direction)
    if worst_row is None:
        raise UsageError(f"no sample has a value at '{name}'")
    return worst_row, float(found[worst_row])


def worst_scene(result: Result, name: str, direction: Direction, target: Path, command: str) -> str:
    """Return the scene of the worst sample, as text.

    Parameters
    ----------
    result
        The study.
    name, direction
        As in `worst_sample`.
    target
        The folder that the scene shall stand in: relative names of files are as seen from there.
    command
        What made it, for its first comment.

    Returns
    -------
    str
        The text of the scene that the study varies, with the values of the sample and comments on what they
        were. Run alone it gives the sample's numbers.

    Raises
    ------
    UsageError
        As in `worst_sample`.
    """
    table = StudyTable(result)
    row, value = worst_sample(table, name, direction)
    number = int(table.numbers[row])
    base = _base(result)
    values = _overrides(table, row)
    data, changes = _relocated(base, values, target)
    notes = {path_of(base, dotted): _note(base, dotted) for dotted in values}
    said = f"the {_WORDS[direction]} {name}" if direction != "abs" else f"{name} {_WORDS[direction]}"
    header = [
        f"# Sample {number} of the study '{' '.join(result.title.split())}': {said}, {word(value)}.",
        f"# Written by: {command}",
        *(f"# Set: {dotted} = {flow(new)}" for dotted, new in values.items()),
    ]
    return "\n".join([*header, edited(base.text, data, changes, notes)])


def _base(result: Result) -> Source:
    folder = str(result.attrs.get("folder", "."))
    return parse_source(str(result.value("study/scene")), str(Path(folder) / "scene.yaml"))


def _overrides(table: StudyTable, row: int) -> dict[str, Any]:
    """Return what a sample set in the scene, by dotted path, in the types that it was set in."""
    varied = str(table.result.group_attrs.get("study", {}).get("varied", "")).split("\n")
    choices = _choices(table.result)
    return {
        path: _original(column[row], choices.get(path, ()))
        for path, column in table.inputs.items()
        if path in varied or "." in path  # a name alone was derived, to be read only
    }


def _choices(result: Result) -> dict[str, list[Any]]:
    """Return the values that the study lists, by path: text in the file may be a list or mapping there."""
    choices: dict[str, list[Any]] = {}
    vary = parse_source(str(result.attrs["scene"])).data.get("vary", {})
    for key, factor in vary.items():
        values = factor if isinstance(factor, list) else factor.get("values", [])
        paths = paths_of(key)
        for place, path in enumerate(paths):
            choices[path] = values if len(paths) == 1 else [value[place] for value in values]
    return choices


def _original(stored: Any, choices: Sequence[Any]) -> Any:
    value = stored.item() if isinstance(stored, np.generic) else stored
    for choice in choices:
        if value == (
            json.dumps(choice) if isinstance(value, str) and not isinstance(choice, str) else choice
        ):
            return choice
    return value


def _relocated(base: Source, values: Mapping[str, Any], target: Path) -> tuple[Any, dict[KeyPath, Any]]:
    """Return a scene with other values, its files as seen from elsewhere, and what of it has changed."""
    own = [path_of(base, dotted) for dotted in values]
    whole, others = set_values(base, values), []
    for place in file_places(whole.data):
        name = _at(whole.data, place)
        new = moved(name, Path(base.file).parent, target)
        if new != name:
            whole = set_values(whole, {".".join(map(str, place)): new})
            others += [place] if not any(place[: len(path)] == path for path in own) else []
    return whole.data, {path: _at(whole.data, path) for path in (*own, *others)}


def _at(data: Any, path: KeyPath) -> Any:
    for key in path:
        data = data[key]
    return data


def _note(base: Source, dotted: str) -> str:
    try:
        return f"set by the study; was {flow(_at(base.data, path_of(base, dotted)))}"
    except (LookupError, TypeError):
        return "set by the study"
