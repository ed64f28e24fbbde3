"""Plain data to YAML text, and values changed in a text that keeps its order, comments and style."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import yaml

from dynid.scene.yaml.parser import Key, Path, parse_yaml
from dynid.scene.yaml.scalars import resolve_plain


class _Dumper(yaml.SafeDumper):
    """Writes plain data so that our own rules read the same data back."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def _represent(dumper: _Dumper, value: Any) -> yaml.ScalarNode:
    # Everything bears the tag of a text, which is never written; the quotes tell texts from the rest.
    style = None
    if isinstance(value, str):
        text = value
        style = None if value != "<<" and value.isprintable() and _reads_as_text(value) else '"'
    elif isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, float):
        text = {"inf": ".inf", "-inf": "-.inf", "nan": ".nan"}.get(repr(value), repr(value))
    else:
        text = "null" if value is None else str(value)
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style)


def _reads_as_text(text: str) -> bool:
    try:
        return isinstance(resolve_plain(text), str)
    except ValueError:
        return False


for _type in (str, int, float, bool, type(None)):
    _Dumper.add_representer(_type, _represent)
_Dumper.yaml_implicit_resolvers = {}


def dump(data: Any) -> str:
    """Write plain data as YAML that our own rules read back as the same data."""
    text: str = yaml.dump(data, Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=2**31)
    return text


def flow(data: Any) -> str:
    """Write plain data on one line, as a part of a text that may stand anywhere."""
    listed: str = yaml.dump(
        [data], Dumper=_Dumper, allow_unicode=True, sort_keys=False, width=2**31, default_flow_style=True
    )
    return listed.strip()[1:-1]


_NOTE_COLUMN = 2  # blanks before a note


class _Edit(NamedTuple):
    start: int
    stop: int
    text: str
    note: str


class _BeyondEditing(Exception):
    """The text has a form in which the place of a value is not its own."""


def edited(text: str, data: Any, values: Mapping[Path, Any], notes: Mapping[Path, str]) -> str:
    """Return the text of a scene with other values.

    Parameters
    ----------
    text
        The text as it was.
    data
        What the text shall say.
    values
        Where that differs from what it says, by path.
    notes
        What to say of each in a comment at the end of its line.

    Returns
    -------
    str
        The text with only these values changed, or all written anew where that cannot be: where values are
        shared by aliases, or stand in blocks of several lines. Either way it reads as `data`.
    """
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        shared = _shared(root)
        edits = [
            _edit(text, root, path, value, notes.get(path, ""), shared) for path, value in values.items()
        ]
        changed = _applied(text, edits)
    except (_BeyondEditing, yaml.YAMLError):
        return dump(data)
    found, _, faults = parse_yaml(changed, "")
    return changed if not faults and dump(found) == dump(data) else dump(data)


def _edit(text: str, root: Any, path: Path, value: Any, note: str, shared: set[int]) -> _Edit:
    node = root
    for place, key in enumerate(path):
        if id(node) in shared:
            raise _BeyondEditing
        below = _below(node, key)
        if below is None:
            return _insertion(text, node, path[place:], value, note)
        node = below
    if id(node) in shared or not _is_inline(node):
        raise _BeyondEditing
    return _Edit(node.start_mark.index, node.end_mark.index, flow(value), note)


def _below(node: Any, key: Key) -> Any:
    if isinstance(node, yaml.SequenceNode):
        return node.value[key]
    if not isinstance(node, yaml.MappingNode):
        raise _BeyondEditing
    return next((value for name, value in node.value if name.value == str(key)), None)


def _is_inline(node: Any) -> bool:
    if isinstance(node, yaml.ScalarNode):
        return node.style not in ("|", ">") and node.start_mark.line == node.end_mark.line
    return bool(node.flow_style)


def _insertion(text: str, node: Any, path: Sequence[Key], value: Any, note: str) -> _Edit:
    """Put a new key behind a mapping's last."""
    for key in reversed(path[1:]):
        value = {key: value}
    entry = f"{flow(path[0])}: {flow(value)}"
    if node.flow_style:
        place = node.end_mark.index - 1
        return _Edit(place, place, f", {entry}" if node.value else entry, note)
    last = _last(node)
    if not _is_inline(last):
        raise _BeyondEditing
    end = text.find("\n", last.end_mark.index)
    place = len(text) if end < 0 else end
    note = f"{' ' * _NOTE_COLUMN}# {note}" if note else ""
    return _Edit(place, place, f"\n{' ' * node.start_mark.column}{entry}{note}", "")


def _last(node: Any) -> Any:
    """Return what a block ends with."""
    while isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        node = node.value[-1][1] if isinstance(node, yaml.MappingNode) else node.value[-1]
    return node


def _applied(text: str, edits: Sequence[_Edit]) -> str:
    """Apply edits from the last to the first, each with its note at the end of its line."""
    for edit in sorted(edits, reverse=True):
        after = text[edit.stop :]
        line, newline, rest = after.partition("\n")
        if edit.note:
            line = f"{line.rstrip()}{' ' * _NOTE_COLUMN}# {edit.note}"
        text = f"{text[: edit.start]}{edit.text}{line}{newline}{rest}"
    return text


def _shared(root: Any) -> set[int]:
    """Return the nodes that stand in several places: behind an anchor and its aliases."""
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
            stack += [part for pair in node.value for part in pair]
        elif isinstance(node, yaml.SequenceNode):
            stack += node.value
    return shared
