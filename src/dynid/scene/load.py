"""Scenes: read, brought to the current format, and checked as a whole.

Every format ever released is read, each by one step to the next. Today there is one. A second one comes with
the step `STEPS[1]` from the data of the first.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, cast

from dynid.errors import DynidError, Fault, FileError, SceneError, UsageError
from dynid.file_access import replace_file
from dynid.scene.composition import composed
from dynid.scene.kind import KINDS
from dynid.scene.yaml.source import Source, apply_overrides, read_source
from dynid.suggestions import did_you_mean

if TYPE_CHECKING:
    from typing_extensions import TypeVar

    from dynid.scene.schema.base import SceneModel
    from dynid.scene.schema.quantities import Located, SceneNames

    M = TypeVar("M", bound=SceneModel, covariant=True, default=Any)
else:
    from typing import TypeVar

    M = TypeVar("M")

#: The format that the schema describes.
CURRENT = 1

#: For an older format: the function that returns its data in the next one, without changing them in place.
STEPS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {}


@dataclass(frozen=True, eq=False)
class Scene(Generic[M]):
    """A valid scene of the kind of its model.

    Parameters
    ----------
    source
        Its text, plain data and the places of both.
    model
        The same, validated, with every quantity resolved.
    names
        The names in it, with which its quantities were resolved.
    """

    source: Source
    model: M
    names: SceneNames

    @property
    def kind(self) -> str:
        """The kind of scene."""
        return str(self.source.data["kind"])

    @property
    def title(self) -> str:
        """Its title, or the name of its file."""
        return self.model.title or Path(self.source.file).stem

    @property
    def folder(self) -> Path:
        """The folder that paths in the scene are relative to."""
        return Path(self.source.file).parent

    @cached_property
    def base(self) -> Scene:
        """The scene that a study varies, read once; a scene of another kind itself.

        Raises `FileError` where it cannot be read, `SceneError` with all faults of it.
        """
        base = KINDS[self.kind].load("base")
        return base(self) if base else self

    def to_yaml(self) -> str:
        """Return the scene as YAML: the text as read, or written anew where values were set."""
        return self.source.resolved_text()

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write the scene as YAML, which `load_scene` reads back as an equal scene.

        Paths in a scene are relative to its folder: write a scene that names files into that folder.

        Raises
        ------
        FileError
            Where the file cannot be written.
        """
        replace_file(path, self.to_yaml().encode())

    def __eq__(self, other: object) -> bool:
        """Return True for a scene with the same data, of any file."""
        return isinstance(other, Scene) and self._written == other._written

    def __hash__(self) -> int:
        return hash(self.to_yaml())

    @property
    def _written(self) -> Any:
        """Its data with its sub-models, as they are written."""
        return (self.source.written or self.source).data

    def raise_faults(self, faults: Iterable[Located]) -> None:
        """Raise faults by their paths in the scene, as `SceneError`, if there are any."""
        from dynid.scene.schema.faults import located

        if located_faults := located(self.source, faults):
            raise SceneError(located_faults)

    def locate(self, error: DynidError) -> Fault:
        """Return an error of a run as a fault at the first of its names that the scene has."""
        for name in error.names:
            joint, _, key_of_joint = name.rpartition(".")
            key = int(name) if name.isdecimal() else name
            candidates: tuple[tuple[Any, ...], ...] = (
                *(("graph", "nodes", name), ("graph", "nodes", key), ("joints", joint, key_of_joint)),
                *(("joints", name), ("parameters", name), (name,)),
                ("joints", *name.split(".")),
                *(("measurement", name), ("measurement", "simulate", name)),
            )
            path = next((path for path in candidates if path in self.source.marks), None)
            if path is None:
                keys = name.split(".")
                dotted = tuple(int(key) if key.isdecimal() else key for key in keys)
                path = dotted if dotted[0] in self.source.data else None
            if path is not None:
                return self.source.fault(path, str(error), key=True)
        return Fault(self.source.file, 1, 1, str(error))


def as_current(source: Source) -> Source:
    """Return a scene of any known format as one of the current format.

    Its text stays as written: a result keeps it, and it is read again. Faults are reported at the places of
    that text. Raises `SceneError` where the format is newer than this dynid.
    """
    number = source.data.get("dynid") if isinstance(source.data, dict) else None
    if not isinstance(number, int) or isinstance(number, bool):
        return source  # the schema says what is wrong
    if number > CURRENT:
        message = f"the scene has format {number}; this dynid reads formats up to {CURRENT}: update dynid"
        raise SceneError([source.fault(("dynid",), message)])
    data = source.data
    while number < CURRENT and number in STEPS:
        number += 1
        data = {**STEPS[number - 1](data), "dynid": number}
    return source if data is source.data else replace(source, data=data)


def load_scene(path: str | os.PathLike[str], overrides: Iterable[str] = ()) -> Scene:
    """Read and check a scene.

    Parameters
    ----------
    path
        The YAML file.
    overrides
        Values to set before checking, as `a.b=1`.

    Raises
    ------
    FileError
        Where the file cannot be read.
    SceneError
        With all faults of the scene.
    """
    source, assignments = read_source(path), list(overrides)
    paths = [assignment.partition("=")[0].strip() for assignment in assignments]
    data = source.data if isinstance(source.data, dict) else {}
    faults = []
    # A parameter, or a part of a joint, that the scene does not have is refused: nothing would use it.
    for path in paths:
        holder, _, name = path.partition(".")
        names = [str(key) for key in data[holder]] if isinstance(data.get(holder), dict) else None
        if names is None or not name:
            continue
        joint, _, key_of_joint = name.partition(".")
        if holder == "parameters" and {name, joint}.isdisjoint(names):
            faults.append((path, f"the scene has no parameter '{joint}'{did_you_mean(joint, names)}"))
        added = {f"joints.{joint}", f"joints.{joint}.dofs"}  # which may be added
        known_joint = any(name.startswith(f"{joint_name}.") for joint_name in names)
        if holder == "joints" and key_of_joint and not known_joint and added.isdisjoint(paths):
            faults.append((path, f"the scene has no joint '{joint}'{did_you_mean(joint, names)}"))
    if faults:
        raise SceneError(Fault(f"--set {path}", 1, 1, message) for path, message in faults)
    return check_source(apply_overrides(source, assignments))


def check_source(source: Source) -> Scene:
    """Check a scene that has been read.

    Raises `SceneError` with all faults of the scene.
    """
    scene, faults = _validated(source)
    if scene is not None and (check_valid := KINDS[scene.kind].load("check_valid")):
        try:
            check_valid(scene)
        except SceneError as error:
            faults += error.faults
        except FileError:  # that a file is missing hides no fault
            if not faults:
                raise
    if scene is None or faults:
        raise SceneError(faults)
    complete = KINDS[scene.kind].load("complete")
    try:
        completed = complete(scene) if complete else source
    except FileError as error:
        raise FileError(str(scene.locate(error))) from None
    except UsageError as error:
        raise SceneError([scene.locate(error)]) from None
    return check_source(completed) if complete and completed is not scene.source else scene


def validated(source: Source) -> Scene:
    """Return the scene of a source by its keys alone: no file that it names is read, but those of models.

    Raises `SceneError` with all faults of the keys.
    """
    scene, faults = _validated(source)
    if scene is None or faults:
        raise SceneError(faults)
    return scene


def _validated(source: Source) -> tuple[Scene | None, list[Fault]]:
    """Return the scene of a source, and its faults; unknown keys and unresolved parameters hide no others."""
    from pydantic import ValidationError

    from dynid.scene.schema.faults import located_faults, without_unknown_keys
    from dynid.scene.schema.raw import read_names

    source = composed(as_current(source))
    model = _model_of(source)
    names, faults = read_names(source)
    data = with_text_keys(source.data)
    try:
        valid = model.model_validate(data, context=names)
    except ValidationError as error:
        # A parameter that has no value is reported with the cause.
        reported = {(fault.file, fault.line, fault.column) for fault in faults}
        located = located_faults(source, model, error)
        complete = not faults
        faults += [fault for fault in located if (fault.file, fault.line, fault.column) not in reported]
        try:
            valid = model.model_validate(without_unknown_keys(data, error), context=names)
        except ValidationError:
            return None, faults
        return Scene(source, valid, names) if complete else None, faults
    return None if faults else Scene(source, valid, names), faults


_OF_STRUCTURES = (
    ". Modes and responses of a structure alone: kind: identification with 'analysis', without "
    "'measurement'; its reduced models: kind: reduction"
)
#: Words that somebody may take for a kind, and the kind that has it.
_OTHER_KINDS = {
    **dict.fromkeys(("structure", "structural", "fe", "fem", "modes", "model"), _OF_STRUCTURES),
    **dict.fromkeys(("modal", "frf", "ema", "oma"), ". Modes of measured responses: kind: modal-analysis"),
    **dict.fromkeys(
        ("control", "loop", "circuit", "transfer-function"), ". Loops and circuits: kind: bond-graph"
    ),
}


def _model_of(source: Source) -> type[SceneModel]:
    """Return the model of the kind of a scene, without which nothing else can be checked."""
    data = source.data
    if not isinstance(data, dict):
        message = "a scene is a mapping; it starts with 'dynid: 1' and 'kind: …'"
        if Path(source.file).suffix.lower() not in (".yaml", ".yml", ".json"):
            message += ". Measured data are named in a scene: dynid new record"
        raise SceneError([source.fault((), message)])
    if "kind" not in data:
        raise SceneError([source.fault((), f"a scene needs the key 'kind': {', '.join(KINDS)}")])
    kind = data["kind"]
    if not isinstance(kind, str) or kind not in KINDS:
        name = f" '{kind}'" if isinstance(kind, str) else ""
        hint = (did_you_mean(str(kind), KINDS) or _OTHER_KINDS.get(str(kind), "")) if name else ""
        message = f"unknown kind{name}; it is one of {', '.join(KINDS)}{hint}"
        raise SceneError([source.fault(("kind",), message)])
    return cast("type[SceneModel]", KINDS[kind].load("model"))


def with_text_keys(data: dict[str, Any]) -> dict[str, Any]:
    """Return the scene with the keys of nodes, parameters and joints as text (a node may be called 1)."""
    copy = dict(data)
    for key in ("parameters", "joints", "structures", "points"):
        if isinstance(copy.get(key), dict):
            copy[key] = {str(name): value for name, value in copy[key].items()}
    graph = copy.get("graph")
    if isinstance(graph, dict) and isinstance(graph.get("nodes"), dict):
        copy["graph"] = {**graph, "nodes": {str(name): node for name, node in graph["nodes"].items()}}
    if "graph" in copy and isinstance(copy.get("initial"), dict):
        copy["initial"] = {str(name): value for name, value in copy["initial"].items()}
    return copy
