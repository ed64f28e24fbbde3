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

#: The most files that use each other.
_DEEPEST = 50


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

    Raises
    ------
    SceneError
        Where two models have one name, or a file holds none or uses itself.
    FileError
        If a file cannot be read.
    """
    faults: list[Fault] = []
    models, marks = dict(mapping(source.data, "models")), dict(source.marks)
    files = {used.file: used for used in _used(source, (os.path.normpath(source.file),), faults)}  # each once
    for used in files.values():
        for name, model in mapping(used.data, "models").items():
            if name in models:
                other = marks["models", name].file
                message = f"there are two models '{name}'; the other is in {other}"
                faults.append(used.fault(("models", name), message, key=True))
            models[name] = model
        marks |= {
            path: mark for path, mark in used.marks.items() if path[:1] == ("models",) and len(path) > 1
        }
    if faults:
        raise SceneError(faults)
    library, wanted = set(library_names()), [mapping(source.data, "graph"), *models.values()]
    while wanted:
        for node in mapping(wanted.pop(), "nodes").values():
            name = node["model"] if is_instance(node) else None
            if isinstance(name, str) and name in library and name not in models:
                text = parse_source(library_text(name), f"{name}.yaml of the library")
                models |= text.data["models"]
                marks |= text.marks
                wanted.append(models[name])
    data = {key: value for key, value in source.data.items() if key != "use"}
    if models:
        data["models"] = models
    # A result holds the text of its scene, which shall not depend on other files.
    return replace(source, data=data, marks=marks, overridden=source.overridden or "use" in source.data)


def _used(source: Source, above: tuple[str, ...], faults: list[Fault]) -> Iterator[Source]:
    """Yield the files that a file uses, and those that these use."""
    used = mapping_of(source.data).get("use", [])
    for place, name in enumerate(used if isinstance(used, list) else [used]):
        path = ("use", place) if isinstance(used, list) else ("use",)
        if not isinstance(name, str) or not name:
            faults.append(source.fault(path, "'use' names files of models"))
            continue
        file = os.path.normpath(Path(source.file).parent / name)
        if file in above or len(above) > _DEEPEST:
            faults.append(source.fault(path, f"'{name}' uses itself"))
            continue
        try:
            found = read_source(file)
        except FileError as error:
            if Path(name).stem in library_names():
                message = f"the model '{Path(name).stem}' comes with dynid and needs no 'use': leave this out"
                faults.append(source.fault(path, message))
                continue
            message = f"{error.problem}; 'use' is relative to the folder of its file"
            raise FileError(str(source.fault(path, message))) from None
        if not isinstance(found.data, Mapping) or {"models", "use"}.isdisjoint(found.data):
            faults.append(source.fault(path, f"'{name}' has no 'models'"))
            continue
        yield found
        yield from _used(found, (*above, file), faults)
