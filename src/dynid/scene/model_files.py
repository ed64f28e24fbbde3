"""Models that a scene uses: its own, those of other files (`use:`), and those that come with dynid."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from dynid.errors import Fault, FileError, SceneError
from dynid.scene.schema.raw import mapping, mapping_of
from dynid.scene.yaml.source import Source, parse_source, read_source

#: The most files that use one another in a row.
_MAX_USE_DEPTH = 50


def library_names() -> list[str]:
    """Return the names of the models that come with dynid."""
    from importlib.resources import files

    entries = (entry.name for entry in files("dynid.library").iterdir())
    return sorted(name.removesuffix(".yaml") for name in entries if name.endswith(".yaml"))


def library_text(name: str) -> str:
    """Return the file of a model that comes with dynid."""
    from importlib.resources import files

    return files("dynid.library").joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def is_instance(node: Any) -> bool:
    """Return True for a node that is an instance of a model."""
    return isinstance(node, dict) and "model" in node


def with_models(source: Source) -> Source:
    """Return a scene with all models that it uses under `models`, each with its place in its own file.

    Raises `SceneError` where two models have one name, or a file holds none or uses itself. Raises
    `FileError` if a file cannot be read.
    """
    faults: list[Fault] = []
    models, marks = dict(mapping(source.data, "models")), dict(source.marks)
    for used in _UsedFiles(faults).sources(source, (os.path.realpath(source.file),)):
        for name, model in mapping(used.data, "models").items():
            if name in models:
                first_file = marks["models", name].file
                message = f"there are two models '{name}'; the other is in {first_file}"
                faults.append(used.fault(("models", name), message, key=True))
            models[name] = model
        marks |= {
            path: mark for path, mark in used.marks.items() if path[:1] == ("models",) and len(path) > 1
        }
    if faults:
        raise SceneError(faults)
    library, graphs = set(library_names()), [mapping(source.data, "graph"), *models.values()]
    while graphs:
        for node in mapping(graphs.pop(), "nodes").values():
            name = node["model"] if is_instance(node) else None
            if isinstance(name, str) and name in library and name not in models:
                text = parse_source(library_text(name), f"{name}.yaml of the library")
                models |= text.data["models"]
                marks |= text.marks
                graphs.append(models[name])
    data = {key: value for key, value in source.data.items() if key != "use"}
    if models:
        data["models"] = models
    # A result holds the text of its scene, which shall not depend on other files.
    return replace(source, data=data, marks=marks, overridden=source.overridden or "use" in source.data)


class _UsedFiles:
    """The files that a scene uses, directly or through others, each read once."""

    def __init__(self, faults: list[Fault]) -> None:
        self.faults = faults
        self._read: set[str] = set()

    def sources(self, source: Source, above: tuple[str, ...]) -> Iterator[Source]:
        """Yield the files that a file uses, and those that these use; `above` are the files around."""
        names = mapping_of(source.data).get("use", [])
        for index, name in enumerate(names if isinstance(names, list) else [names]):
            path = ("use", index) if isinstance(names, list) else ("use",)
            if not isinstance(name, str) or not name or "\0" in name:
                self.faults.append(source.fault(path, "'use' names files of models"))
                continue
            file = os.path.normpath(Path(source.file).parent / name)
            identity = os.path.realpath(file)  # links may give a file any number of names
            if identity in above:
                self.faults.append(source.fault(path, f"'{name}' uses itself"))
            elif len(above) > _MAX_USE_DEPTH:
                message = f"more than {_MAX_USE_DEPTH} files use one another in a row; join some of them"
                self.faults.append(source.fault(path, message))
            elif identity not in self._read:
                self._read.add(identity)
                if used := self._used(source, path, name, file):
                    yield used
                    yield from self.sources(used, (*above, identity))

    def _used(self, source: Source, path: tuple[Any, ...], name: str, file: str) -> Source | None:
        try:
            used = read_source(file)
        except FileError as error:
            if Path(name).stem in library_names():
                message = f"the model '{Path(name).stem}' comes with dynid and needs no 'use': leave this out"
                self.faults.append(source.fault(path, message))
                return None
            message = f"{error.problem}; 'use' is relative to the folder of its file"
            raise FileError(str(source.fault(path, message))) from None
        if not isinstance(used.data, Mapping) or {"models", "use"}.isdisjoint(used.data):
            self.faults.append(source.fault(path, f"'{name}' has no 'models'"))
            return None
        return used
