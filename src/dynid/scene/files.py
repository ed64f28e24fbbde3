"""The files that a scene names, those that are missing, and their names in another folder."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import Fault, FileError, UsageError
from dynid.file_access import check_readable, dataset_of
from dynid.scene.kind import KINDS
from dynid.scene.yaml.parser import Path as KeyPath
from dynid.scene.yaml.source import path_of, set_values
from dynid.suggestions import did_you_mean, shortened

if TYPE_CHECKING:
    from dynid.scene.load import Scene


def file_places(data: Any) -> Iterator[KeyPath]:
    """Yield the paths in the data of a scene that hold the name of a file."""
    from dynid.scene.schema.references import FILE, references

    kind = KINDS.get(data.get("kind"))
    if kind is not None:
        occurrences = references(kind.load("model"), data, FILE)
        yield from (path for path, name, _ in occurrences if isinstance(name, str))


def missing_files(scene: Scene) -> list[Fault]:
    """Return the files that a run of a valid scene would not find, each at its key.

    Nothing is opened. Files that a run does not read may be missing: that of a simulated record, the input of
    a response that is not requested. Of a study, the files of the scene that it varies, and those that it
    sets.
    """
    if scene.kind != "study":
        return _missing(scene, [])
    from dynid.scene.schema.study import Listed, paths_of

    base, model = scene.base, scene.model
    faults = _missing(base, [path_of(base.source, path) for path in model.varied])
    for key, factor in model.vary.items():
        for number, value in enumerate(factor.values if isinstance(factor, Listed) else []):
            if isinstance(value, str | list | dict):
                values = [value] if len(paths_of(key)) == 1 else value
                source = set_values(base.source, dict(zip(paths_of(key), values, strict=True)))
                parts = [path_of(source, path) for path in paths_of(key)]
                places = (key_path for key_path in file_places(source.data) if _is_below(key_path, parts))
                message = next(filter(None, (_why_not(base.folder, source.data, p) for p in places)), "")
                listed = ("vary", key, "values", number)
                key_path = listed if listed in scene.source.marks else ("vary", key, number)
                faults += [scene.source.fault(key_path, message)] if message else []
    return faults


def supplied_arrays(scene: Scene, data: Mapping[str, Any]) -> dict[Path, dict[str, Any]]:
    """Return arrays that are to stand in place of files of a scene, checked, by the paths of the files.

    Raises `UsageError` where the scene names no such file, or what is supplied are no arrays of numbers.
    """
    from dynid.files.supplied_arrays import arrays_of

    if scene.kind == "study":
        raise UsageError("a study reads files; arrays are supplied to single scenes")
    names = {dataset_of(_value(scene.source.data, path))[0] for path in file_places(scene.source.data)}
    for name in data:
        if name not in names:
            hint = did_you_mean(name, names) or f"; it names {shortened(sorted(names)) or 'no files'}"
            raise UsageError(f"the scene names no file '{name}'{hint}")
    return {scene.folder / name: arrays_of(name, arrays) for name, arrays in data.items()}


def _value(data: Any, path: KeyPath) -> Any:
    """Return the value at a path of a scene."""
    for key in path:
        data = data[key]
    return data


def _missing(scene: Scene, elsewhere: Sequence[KeyPath]) -> list[Fault]:
    """Return the missing files of a scene, except at paths that something else sets."""
    unread = KINDS[scene.kind].load("unread")
    data, passed = scene.source.data, [*(unread(scene) if unread else ()), *elsewhere]
    places = [path for path in file_places(data) if not _is_below(path, passed)]
    said = {path: _why_not(scene.folder, data, path) for path in places}
    return [scene.source.fault(path, message, key=True) for path, message in said.items() if message]


def _is_below(path: KeyPath, parts: Iterable[KeyPath]) -> bool:
    return any(path[: len(holder)] == holder for holder in parts)


def _why_not(folder: Path, data: Any, key_path: KeyPath) -> str:
    """Return why the file at a path cannot be read, in the words of a run; empty where it can."""
    name = _value(data, key_path)
    path = folder / (dataset_of(name)[0] if key_path[:2] == ("structure", "matrices") else name)
    try:
        check_readable(path)
    except FileError as error:
        return str(error)
    return ""


def moved(name: str, folder: Path, target: Path) -> str:
    """Return the name under which a scene in another folder finds a file."""
    if Path(name).is_absolute():
        return name
    return Path(os.path.relpath(folder.resolve() / name, target.resolve())).as_posix()
