"""A scene as written: its text, its plain data, and the place of every key and value in it."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path as FilePath
from typing import Any

from dynid.errors import Fault, FileError, SceneError
from dynid.scene.yaml.parser import (
    MAX_CHARACTERS,
    MAX_DEPTH,
    Key,
    Path,
    Place,
    Positions,
    parse_yaml,
    place_of,
    resolve_plain,
    shorten,
)
from dynid.suggestions import did_you_mean

_START: Place = (1, 1)
# The most names in a dotted path: a scene is at most MAX_DEPTH deep, and its keys may hold dots themselves.
_MAX_NAMES = 4 * MAX_DEPTH


@dataclass(frozen=True)
class Source:
    """The text of a scene and its data."""

    file: str  #: The name under which faults are reported.
    text: str  #: The text as read.
    #: Texts, numbers, Booleans, nulls, lists and mappings. Aliases share their values, so that nothing may be
    #: changed in place.
    data: Any
    #: The place of every path (keys, and list indices from 0); what stands below an alias has none.
    marks: dict[Path, Positions]
    overridden: bool = False  #: Whether the data differ from the text.
    #: Of a scene whose sub-models have been replaced by their nodes: the scene with the sub-models.
    written: Source | None = None

    def fault(self, path: Iterable[Key], message: str, key: bool = False) -> Fault:
        """Return a fault at a value, or at its key; that of a missing path is where it would belong."""
        parts = tuple(path)
        full = len(parts)
        while parts and parts not in self.marks:
            parts = parts[:-1]
        marks = self.marks.get(parts, Positions(_START, _START, self.file))
        # What a mapping lacks is reported at its name rather than at its first entry.
        position = marks.key if key or len(parts) < full else marks.value
        return Fault(marks.file, *position, message)

    def resolved_text(self) -> str:
        """Return the text as run: as written, or serialized again where values were overridden."""
        if not self.overridden:
            return self.text
        from dynid.scene.yaml.writer import dump

        return dump((self.written or self).data)


class _BuiltSource(Source):
    """A scene of plain data: its text is written, and read for the places in it, where either is used."""

    @cached_property
    def text(self) -> str:
        from dynid.scene.yaml.writer import dump

        return dump(self.data)

    @cached_property
    def marks(self) -> dict[Path, Positions]:
        return parse_yaml(self.text, self.file, limited=False)[1]


def built_source(data: Any, file: str) -> Source:
    """Return a scene built in Python.

    Raises `SceneError` where its text would not be a document of plain data, `UsageError` where it has none.
    """
    from dynid.scene.yaml.writer import dump, plain

    source = object.__new__(_BuiltSource)
    try:
        vars(source).update(file=file, data=plain(data), overridden=False, written=None)
    except ValueError:
        return parse_source(dump(data), file, limited=False)
    return source


def read_source(path: str | os.PathLike[str]) -> Source:
    """Read a scene file.

    Raises `FileError` when there is no readable regular file at `path`. Raises `SceneError` when the text is
    not a document of plain data, with all faults.
    """
    name = os.fspath(path)
    raw = _read_regular_file(name)
    if raw.startswith(b"\x89HDF"):
        message = f"this is an HDF5 file, not a scene; if it is a result: dynid show {name}"
        raise SceneError([Fault(name, 1, 1, message)])
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise SceneError([Fault(name, 1, 1, "the file is UTF-16; save it as UTF-8")])
    try:
        text = raw.removeprefix(b"\xef\xbb\xbf").decode()
    except UnicodeDecodeError as error:
        before = error.object[: error.start].decode()
        message = f"the byte 0x{error.object[error.start]:02X} is not UTF-8; save the file as UTF-8"
        raise SceneError([Fault(name, *place_of(before, len(before)), message)]) from None
    return parse_source(text, name)


def parse_source(text: str, file: str = "<scene>", *, limited: bool = True) -> Source:
    """Read a scene from a text, of any length where it is not `limited`.

    Raises `SceneError` when the text is not a document of plain data, with all faults.
    """
    data, marks, faults = parse_yaml(text, file, limited=limited)
    if data is None and not faults:
        faults = [Fault(file, 1, 1, "the scene is empty")]
    if faults:
        raise SceneError(faults)
    return Source(file, text, data, marks)


def apply_overrides(source: Source, assignments: Iterable[str]) -> Source:
    """Set values as `--set PATH=VALUE` does, in the order given.

    Parameters
    ----------
    source
        The scene.
    assignments
        `PATH=VALUE` each: a dotted path of keys and of list indices (from 0), and a value in YAML.
        Mappings that are missing on the way are created.

    Raises
    ------
    SceneError
        When paths or values are invalid, with all faults.
    """
    faults: list[Fault] = []
    source = source.written or source
    for assignment in assignments:
        path, equals, text = assignment.partition("=")
        origin = f"--set {path}"
        if not equals:
            faults.append(Fault(origin, 1, 1, "a value is missing; write --set PATH=VALUE"))
            continue
        value, marks, value_faults = parse_yaml(text, origin)
        faults += value_faults
        try:
            source = _set(source, path, value, marks, origin)
        except SceneError as error:
            faults += error.faults
    if faults:
        raise SceneError(faults)
    return source


def set_values(source: Source, values: Mapping[str, Any]) -> Source:
    """Set plain values at dotted paths, as `--set` does with values written in YAML.

    Raises `SceneError` when a path is invalid.
    """
    source = source.written or source
    for path, value in values.items():
        source = _set(source, path, value, {(): Positions(_START, _START, path)}, path)
    return source


def path_of(source: Source, dotted: str) -> Path:
    """Return the path that a dotted one means: keys may hold dots themselves, and indices are numbers.

    Raises `SceneError` when a list has no such entry.
    """
    parts, holder = _names(dotted, dotted), (source.written or source).data
    path: Path = ()
    while parts:
        key, parts = _next_key(holder if isinstance(holder, dict | list) else {}, parts, path, dotted)
        path = (*path, key)
        holder = holder.get(key) if isinstance(holder, dict) else holder[key] if holder else None
    return path


def _read_regular_file(name: str) -> bytes:
    if os.path.isdir(name):  # noqa: PTH112 - to Windows an access denied
        raise FileError(f"{name} is a directory, not a scene file", names=[name])
    try:
        # Without O_NONBLOCK, opening a named pipe would wait for someone to write into it.
        descriptor = os.open(name, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        with os.fdopen(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise FileError(f"{name} is not a regular file", names=[name])
            raw = file.read(4 * MAX_CHARACTERS + 1)
    except FileNotFoundError:
        hint = ""
        with suppress(OSError):
            there = sorted(p.name for p in FilePath(name).parent.iterdir())
            scenes = [scene for scene in there if scene.lower().endswith((".yaml", ".yml"))]
            bare = FilePath(name).name
            hint = next(filter(None, (did_you_mean(bare, some) for some in (scenes, there))), "")
        remedy = "" if hint else "To begin with a template: dynid new"
        raise FileError(f"{name}: no such file{hint}", remedy=remedy, names=[name]) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"{name} cannot be read: {reason}", names=[name]) from None
    if len(raw) > 4 * MAX_CHARACTERS:
        message = f"{name} is too large for a scene; put large data in files of their own"
        raise FileError(message, names=[name])
    return raw


def _set(source: Source, dotted: str, value: Any, marks: dict[Path, Positions], origin: str) -> Source:
    """Copy the containers along the path, so that the source, and what aliases share, stay as they are."""
    parts = _names(dotted, origin)
    if not all(parts):
        raise SceneError([Fault(origin, 1, 1, "an empty name in the path; write it as a.b.c")])
    root = [source.data]
    holder: Any = root
    key: Key = 0
    path: Path = ()
    while parts:
        child = holder.get(key) if isinstance(holder, dict) else holder[key]
        child = {} if child is None else child
        if not isinstance(child, dict | list):
            kinds = {str: "a text", bool: "a Boolean"}
            kind = kinds.get(type(child), "a number")
            name = ".".join(map(str, path)) or "the scene"
            message = f"{name} is {kind}, not a mapping; it has no '{parts[0]}'"
            if path and isinstance(holder, dict):
                others = [str(name) for name, value in holder.items() if isinstance(value, dict)]
                message += did_you_mean(str(key), others)
            raise SceneError([Fault(origin, 1, 1, message)])
        holder[key] = holder = child.copy()
        key, parts = _next_key(holder, parts, path, origin)
        path = (*path, key)
    if len(path) + _height(value) > MAX_DEPTH:
        raise SceneError([Fault(origin, 1, 1, f"nested more than {MAX_DEPTH} deep")])
    holder[key] = value
    kept = {marked: mark for marked, mark in source.marks.items() if marked[: len(path)] != path}
    for length in range(len(path)):
        kept.setdefault(path[:length], Positions(_START, _START, origin))
    kept.update({path + below: mark for below, mark in marks.items()})
    return replace(source, data=root[0], marks=kept, overridden=True)


def _names(dotted: str, origin: str) -> list[str]:
    names = dotted.split(".")
    if len(names) > _MAX_NAMES:
        message = f"the path has {len(names)} names; a scene is at most {MAX_DEPTH} deep"
        raise SceneError([Fault(shorten(origin), 1, 1, message)])
    return names


def _height(value: Any) -> int:
    if not isinstance(value, dict | list):
        return 0
    return 1 + max(map(_height, value.values() if isinstance(value, dict) else value), default=0)


def _next_key(holder: Any, parts: list[str], path: Path, origin: str) -> tuple[Key, list[str]]:
    if isinstance(holder, list):
        word = parts[0]
        if word.isascii() and word.isdigit() and len(word) < 10 and int(word) < len(holder):
            return int(word), parts[1:]
        where = ".".join(map(str, path)) or "the scene"
        message = f"{where} is a list of {len(holder)}, counted from 0; it has no entry '{word}'"
        raise SceneError([Fault(origin, 1, 1, message)])
    # A key may hold dots itself (a study varies dotted paths): the longest one that exists is meant.
    for length in range(len(parts), 0, -1):
        joined = ".".join(parts[:length])
        for key in (joined, _as_key(joined)):
            if key in holder:
                return key, parts[length:]
    key = _as_key(parts[0])
    if type(key) is int and {"model", "repeat"} <= holder.keys():
        return "copies", parts  # line.2.C: the copies of an instance are named by their numbers
    return key, parts[1:]


def _as_key(word: str) -> Key:
    try:
        value = resolve_plain(word)
    except ValueError:
        return word
    return value if type(value) is int else word
