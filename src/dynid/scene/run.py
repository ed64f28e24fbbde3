"""Run a scene, or only the steps of its run that come before any computation; doubts about a valid scene."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from dynid.errors import DynidError, Fault
from dynid.scene.kind import KINDS

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.scene.load import Scene
    from dynid.scene.yaml.parser import Path

#: A step of a run: builds or reads something, or raises its error.
PreparationStep = Callable[[], Any]


def run_scene(scene: Scene) -> Result:
    """Run a valid scene.

    The result has the scene's text. Raises `NumericalError` where the analysis has no trustworthy result; of
    a rejected fit with its `result`. Raises `FileError` where a file that the scene names cannot be read.
    """
    try:
        result: Result = KINDS[scene.kind].load("run")(scene)
    except DynidError as error:
        if error.result is not None:
            error.result.title = scene.title
            _add_origin(error.result, scene)
        raise
    _add_origin(result, scene)
    return result


def _add_origin(result: Result, scene: Scene) -> None:
    """Add the scene's text and the seed of its noise."""
    result.attrs["scene"] = scene.source.resolved_text()
    data = scene.source.data
    measurement, time = data.get("measurement") or {}, (data.get("analysis") or {}).get("time") or {}
    simulate = measurement.get("simulate") or (measurement.get("frf") or {}).get("simulate")
    noisy = [] if simulate is None else [simulate]
    for signals in (data.get("excitation"), time.get("input")):
        listed = [signals] if isinstance(signals, dict) else signals or []
        noisy += [signal for signal in listed if signal["kind"] == "random"]
    # The seed of the noise of the measurement, else that of the first random signal; 0 without both.
    result.attrs["seed"] = noisy[0].get("seed", 0) if noisy else 0


def preparation_errors(scene: Scene) -> list[DynidError]:
    """Return the errors of a run of a valid scene before any computation, in its order.

    The run's own steps are taken, so messages are those of the run: files are read, structures and graphs
    built, signals and records made, sources of a graph tested for contradictions. A study has no steps
    of its own; see those of the scene that it varies.
    """
    steps = KINDS[scene.kind].load("prepare")
    errors: list[DynidError] = []
    for step in steps(scene) if steps else ():
        try:
            step()
        except DynidError as error:
            errors.append(error)
    return errors


#: A whole number of a list between `[ ]`, and its comma with the spaces behind it.
_ENTRY = re.compile(r"[-+]?[0-9]+,( *)\Z")


def scene_doubts(scene: Scene) -> list[Fault]:
    """Return the doubts about a valid scene, each at its place, in the order of the file."""
    doubts_of_kind = KINDS[scene.kind].load("doubts")
    return sorted({*_decimal_commas(scene), *(doubts_of_kind(scene) if doubts_of_kind else ())})


def _decimal_commas(scene: Scene) -> Iterator[Fault]:
    """Yield the lists of real numbers whose commas may be decimal, such as [3,1, 1,7]."""
    source = scene.source
    lines: list[str] = []
    for path, numbers in _lists_of_whole_numbers(source.data, ()):
        marks = [source.marks.get((*path, index)) for index in range(len(numbers))]
        places = [mark.value for mark in marks if mark is not None and mark.file == source.file]
        if len(places) < len(numbers) or any(index[0] != places[0][0] for index in places):
            continue
        lines = lines or source.text.splitlines()
        line = lines[places[0][0] - 1]
        entries = [_ENTRY.match(line[a - 1 : b - 1]) for (_, a), (_, b) in pairwise(places)]
        apart = [bool(entry[1]) for entry in entries if entry]
        # All commas alike are a habit; of three numbers without spaces between, no two are one.
        pairs = len(apart) == len(entries) and any(apart) and not all(apart)
        if pairs and all(any(two) for two in pairwise(apart)) and not _are_counts(scene.model, path):
            yield source.fault(path, _doubtful_list(numbers, apart))


def _lists_of_whole_numbers(data: Any, path: Path) -> Iterator[tuple[Path, list[int]]]:
    """Yield the lists of three whole numbers or more in plain data, each with its path."""
    if isinstance(data, list) and len(data) > 2 and all(type(entry) is int for entry in data):
        yield path, data
    elif isinstance(data, dict | list):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _lists_of_whole_numbers(value, (*path, key))


def _are_counts(model: Any, path: Path) -> bool:
    """Return True if the entries of a list are whole numbers to its model, such as DOFs."""
    for key in path:
        if isinstance(model, BaseModel):
            fields = type(model).model_fields
            name = next((name for name, field in fields.items() if key in (name, field.alias)), None)
            model = None if name is None else getattr(model, name)
        elif isinstance(model, dict):
            model = model.get(key, model.get(str(key)))
        else:
            model = model[key] if isinstance(model, list | tuple) and isinstance(key, int) else None
    return not isinstance(model, list | tuple) or all(isinstance(entry, int | str) for entry in model)


def _doubtful_list(numbers: list[int], apart: list[bool]) -> str:
    """Return the warning of a list; `apart`: whether a space follows each comma."""
    written = decimal = str(numbers[0])
    for number, space in zip(numbers[1:], apart, strict=True):
        written += f"{', ' if space else ','}{number}"
        decimal += f"{', ' if space else '.'}{number}"
    return (
        f"[{written}] is read as {len(numbers)} numbers, but not every comma has a space behind it; "
        f"decimals stand behind a point: [{decimal}]. If it is {len(numbers)} numbers, put a space behind "
        "every comma"
    )
