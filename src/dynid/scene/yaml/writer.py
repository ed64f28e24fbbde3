"""YAML text of plain data, and values changed in a text that keeps its order, comments and style."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import yaml

from dynid.errors import UsageError
from dynid.scene.yaml.parser import (
    MAX_DEPTH,
    MAX_DIGITS,
    UNSTORABLE,
    Key,
    Path,
    parse_yaml,
    resolve_plain,
)
from dynid.suggestions import short_paths

_SafeDumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


class _Dumper(_SafeDumper):  # type: ignore[misc]
    """Dumper of plain data, which `parse_yaml` reads back as the same data."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def _represent(dumper: _Dumper, value: Any) -> yaml.ScalarNode:
    # Everything has the tag of a text, which is never written; quotes distinguish texts from the rest.
    style = None
    if isinstance(value, str):
        text = value
        try:
            plain = value != "<<" and value.isprintable() and isinstance(resolve_plain(value), str)
        except ValueError:  # a number that is too long, or too large
            plain = False
        style = None if plain else '"'
    elif isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, float):
        text = {"inf": ".inf", "-inf": "-.inf", "nan": ".nan"}.get(repr(value), repr(value))
    else:
        text = "null" if value is None else str(value)
    node: yaml.ScalarNode = dumper.represent_scalar("tag:yaml.org,2002:str", text, style)
    return node


def _converted(value: Any) -> Any:
    """Return numbers and arrays of NumPy as numbers and lists, paths as texts, fractions as quotients."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Fraction):
        return str(value) if value.denominator > 1 else value.numerator
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise UsageError(
        f"a scene cannot hold {value!r}, of type {type(value).__name__}",
        remedy="It holds mappings, lists, numbers, texts, true and false.",
    )


for _type in (str, int, float, bool, type(None)):
    _Dumper.add_representer(_type, _represent)
_Dumper.add_multi_representer(object, lambda dumper, value: dumper.represent_data(_converted(value)))
_Dumper.yaml_implicit_resolvers = {}
_UNBROKEN = 2**31 - 1  # characters of a line; the largest that libyaml takes


def plain(value: Any, depth: int = 0) -> Any:
    """Return data as `parse_yaml` reads them from their text; raise `ValueError` where it has faults."""
    kind = type(value)
    if kind in (float, bool, type(None)) or (kind is int and abs(value) < 10**MAX_DIGITS):
        return value
    if kind is str and not UNSTORABLE.search(value):
        return value
    if kind in (int, str) or depth >= MAX_DEPTH:
        raise ValueError
    if kind in (list, tuple):
        return [plain(entry, depth + 1) for entry in value]
    if kind is not dict:
        return plain(_converted(value), depth)
    if not all(type(key) in (str, int) for key in value) or len(set(map(str, value))) < len(value):
        raise ValueError
    return {plain(key): plain(entry, depth + 1) for key, entry in value.items()}


def dump(data: Any) -> str:
    """Return plain data as YAML, which `parse_yaml` reads back as the same data."""
    text: str = yaml.dump(data, Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=_UNBROKEN)
    return text


def flow(data: Any) -> str:
    """Return plain data as YAML on one line, for any place in a text."""
    listed: str = yaml.dump(
        [data], Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=_UNBROKEN, default_flow_style=True
    )
    return listed.strip()[1:-1]


_NOTE_COLUMN = 2  # blanks before a note


class _Edit(NamedTuple):
    start: int
    stop: int
    text: str
    note: str


class _BeyondEditing(Exception):
    """A value is shared by aliases, or spans several lines: it cannot be changed in place."""


def edited(text: str, data: Any, values: Mapping[Path, Any], notes: Mapping[Path, str]) -> str:
    """Return the text of a scene with other values.

    Parameters
    ----------
    text
        The text.
    data
        The data that the returned text shall have.
    values
        The changed values by path.
    notes
        Comments for the ends of their lines, by path. Those of one line become one, in the order of the line
        and with names; what they have in common before a comma or semicolon is said once.

    Returns
    -------
    str
        The text with only these values changed; where values are shared by aliases, or stand in blocks of
        several lines, all of it serialized again. In both cases it reads as `data`.
    """
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        shared = _shared(root)
        edits = _with_one_note_a_line(
            text,
            {
                path: _edit(text, root, path, value, notes.get(path, ""), shared)
                for path, value in values.items()
            },
        )
    except (_BeyondEditing, yaml.YAMLError):
        return dump(data)
    for edit in sorted(edits, reverse=True):  # from the last to the first: places before one stay as they are
        line, newline, rest = text[edit.stop :].partition("\n")
        if edit.note:
            line = f"{line.rstrip()}{' ' * _NOTE_COLUMN}# {edit.note}"
        text = f"{text[: edit.start]}{edit.text}{line}{newline}{rest}"
    reread, _, faults = parse_yaml(text, "")
    return text if not faults and dump(reread) == dump(data) else dump(data)


def _with_one_note_a_line(text: str, edits: Mapping[Path, _Edit]) -> list[_Edit]:
    """Return the edits, the last one of each line with the notes of all of them."""
    lines: dict[int, list[tuple[_Edit, Path]]] = {}
    for path, edit in edits.items():
        if edit.note:
            lines.setdefault(text.find("\n", edit.stop), []).append((edit, path))
    kept = {edit: edit.note for edit in edits.values()}
    for edits_of_line in lines.values():
        edits_of_line.sort(key=lambda pair: pair[0].start)
        names = short_paths([".".join(map(str, path)) for _, path in edits_of_line])
        kept |= dict.fromkeys((edit for edit, _ in edits_of_line), "")
        by_name = zip(names, (edit.note for edit, _ in edits_of_line), strict=True)
        kept[edits_of_line[-1][0]] = _joined(dict(by_name))
    return [edit._replace(note=note) for edit, note in kept.items()]


def _joined(notes: Mapping[str, str]) -> str:
    if len(notes) == 1:
        return next(iter(notes.values()))
    parts = {name: re.match(r"([^;,]*)(?:[;,] )?(.*)", note, re.DOTALL) for name, note in notes.items()}
    heads = {parsed[1] for parsed in parts.values() if parsed}
    if len(heads) > 1:
        return "; ".join(f"{name}: {note}" for name, note in notes.items())
    rests = ", ".join(f"{name} {parsed[2]}".rstrip() for name, parsed in parts.items() if parsed)
    return f"{heads.pop()}: {rests}"


def _edit(text: str, root: Any, path: Path, value: Any, note: str, shared: set[int]) -> _Edit:
    node = root
    for depth, key in enumerate(path):
        if id(node) in shared:
            raise _BeyondEditing
        if isinstance(node, yaml.SequenceNode):
            node = node.value[key]
            continue
        if not isinstance(node, yaml.MappingNode):
            raise _BeyondEditing
        below = next((below for name, below in node.value if name.value == str(key)), None)
        if below is None:
            return _insertion(text, node, path[depth:], value, note)
        node = below
    if id(node) in shared or not _is_inline(node):
        raise _BeyondEditing
    return _Edit(node.start_mark.index, node.end_mark.index, flow(value), note)


def _is_inline(node: Any) -> bool:
    if isinstance(node, yaml.ScalarNode):
        return node.style not in ("|", ">") and node.start_mark.line == node.end_mark.line
    return bool(node.flow_style)


def _insertion(text: str, node: Any, path: Sequence[Key], value: Any, note: str) -> _Edit:
    """Return the edit that adds a key behind the last one of a mapping."""
    for key in reversed(path[1:]):
        value = {key: value}
    entry = f"{flow(path[0])}: {flow(value)}"
    if node.flow_style:
        index = node.end_mark.index - 1
        return _Edit(index, index, f", {entry}" if node.value else entry, note)
    last = node  # what the block ends with
    while isinstance(last, yaml.CollectionNode) and not last.flow_style and last.value:
        last = last.value[-1][1] if isinstance(last, yaml.MappingNode) else last.value[-1]
    if not _is_inline(last):
        raise _BeyondEditing
    end = text.find("\n", last.end_mark.index)
    index = len(text) if end < 0 else end
    note = f"{' ' * _NOTE_COLUMN}# {note}" if note else ""
    return _Edit(index, index, f"\n{' ' * node.start_mark.column}{entry}{note}", "")


def _shared(root: Any) -> set[int]:
    """Return the nodes that several places share: an anchor and its aliases."""
    seen: set[int] = set()
    shared: set[int] = set()
    stack = [root]
    while stack:
        node = stack.pop()
        if id(node) in seen:
            shared.add(id(node))
            continue
        seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            stack += [child for pair in node.value for child in pair]
        elif isinstance(node, yaml.SequenceNode):
            stack += node.value
    return shared
