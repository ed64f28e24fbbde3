"""Parser of scene files: YAML text to plain data with the place of every key and value.

The data are built from the events of PyYAML, without recursion and without any constructor: texts,
numbers, Booleans, nulls, lists and mappings, by the YAML 1.2 core schema, and nothing else. PyYAML's own
rules for scalars are those of YAML 1.1, where `1e3` is a text, `on` is true and `12:30` is 750.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any, NamedTuple, NoReturn

import yaml

from dynid.errors import Fault

Place = tuple[int, int]

MAX_DIGITS = 400
_CORE = "tag:yaml.org,2002:"
UNSTORABLE = re.compile("[\0\ud800-\udfff]")

_NULL = frozenset({"", "~", "null", "Null", "NULL"})
_BOOL = {word: word.lower() == "true" for word in ("true", "True", "TRUE", "false", "False", "FALSE")}
_INT = re.compile(r"(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)\Z")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?\Z")
_INF = re.compile(r"[-+]?\.(?:inf|Inf|INF)\Z")
_NAN = frozenset({".nan", ".NaN", ".NAN"})
_ENDS_WHOLE = re.compile(r"\A(?:[^(]*[-+*/ ])?[0-9]+\Z")
_DIGITS = frozenset("0123456789")

_PLAIN_WORDS = {
    "mapping values are not allowed": "a ':' is not expected here; check the indentation, "
    "and put a text that holds ': ' in quotes",
    "',' or ']'": "a list that opens with '[' lacks a comma or its ']'",
    "',' or '}'": "a mapping that opens with '{' lacks a comma or its '}'",
    "unexpected end of stream": "a quoted text is not closed",
    "expected '-' indicator": "a list entry '- …' is expected here; check the indentation",
    "expected key": "a key is expected here; check the indentation",
    "expected ':'": "a ':' is missing after a key",
    "block sequence entries": "a list entry '- …' is not expected here; check the indentation",
    "escape": "unknown escape in a double-quoted text; single quotes take a backslash as it is",
    "tag handle": "tags (!…) are not allowed in a scene",
    "alphabetic or numeric": "'*' and '&' begin an alias or an anchor; put a text that begins so in quotes",
    "document start": "a scene is one document; nothing may follow its end",
    "violates indentation": "a tab cannot indent; use spaces",
}


def resolve_plain(text: str) -> str | int | float | bool | None:
    """Return the value of an unquoted scalar by the core schema of YAML 1.2.

    Raises `ValueError` when a number is too long, or too large for double precision.
    """
    if text in _NULL:
        return None
    if text in _BOOL:
        return _BOOL[text]
    if _INT.match(text):
        # The length is checked before the conversion, whose cost grows with its square.
        number = int(text, {"0o": 8, "0x": 16}.get(text[:2], 10)) if len(text) <= 2 * MAX_DIGITS else None
        if number is None or abs(number) >= 10**MAX_DIGITS:
            raise ValueError(f"{shorten(text)} has more than {MAX_DIGITS} digits")
        return number
    if _FLOAT.match(text):
        value = float(text)
        if value in (float("inf"), float("-inf")):
            raise ValueError(f"{shorten(text)} is too large for a number in double precision")
        return value
    if _INF.match(text):
        return float("-inf" if text[0] == "-" else "inf")
    return float("nan") if text in _NAN else text


def shorten(text: str) -> str:
    """Return a quoted text, cut to a length that fits a message."""
    return text if len(text) <= 40 else f"{text[:20]}…"


def _resolve_tagged(text: str, tag: str) -> Any:
    """Return the value of a scalar with a core tag (`!!int`, …); raises `ValueError` for others."""
    value = resolve_plain(text)
    kind = tag.removeprefix(_CORE)
    if kind == "float" and type(value) is int:
        return resolve_plain(f"{value}.0")
    expected = {"int": int, "float": float, "bool": bool, "null": type(None)}.get(kind)
    if expected is None:
        raise ValueError(_tag_message(tag))
    if type(value) is not expected:
        raise ValueError(f"'{shorten(text)}' is not of the type {kind} that its tag says")
    return value


def _tag_message(tag: str) -> str:
    shown = tag.replace(_CORE, "!!")
    return f"the tag {shorten(shown)} is not allowed; a scene is plain texts, numbers, lists and mappings"


def place_of(text: str, index: int) -> Place:
    """Return the line and column (from 1) of a character of a text."""
    before = text[:index]
    line = len(re.findall(r"\r\n?|\n", before)) + 1
    return line, index - max(before.rfind("\n"), before.rfind("\r"))


def _in_plain_words(error: yaml.YAMLError, text: str, file: str) -> Fault:
    """Turn a syntax error of the YAML parser into a located fault."""
    problem = str(getattr(error, "problem", None) or error)
    mark, context = getattr(error, "problem_mark", None), getattr(error, "context_mark", None)
    line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
    lines = text.splitlines()
    character = lines[line - 1][column - 1 : column] if line <= len(lines) else ""
    if "start any token" in problem:
        plain = f"a text cannot begin with '{character}'; put it in quotes"
        message = _PLAIN_WORDS["violates indentation"] if character == "\t" else plain
    elif "maximum nesting depth" in problem:  # where the parser looks ahead, it counts levels itself
        message = f"nested more than {MAX_DEPTH} deep"
    else:
        messages = (words for pattern, words in _PLAIN_WORDS.items() if pattern in problem)
        message = next(messages, f"this is not valid YAML: {problem}")
        if character in ("[", "{") and "lacks a comma" in message:
            message += f"; put a text that holds '{character}' in quotes"
    if mark and context and context.line != mark.line:
        message += f" (it begins at line {context.line + 1}, column {context.column + 1})"
    return Fault(file, line, column, message)


MAX_CHARACTERS = 8 * 2**20
MAX_DEPTH = 64
_MAX_NODES = 1_000_000
MAX_FAULTS = 100

Key = str | int
Path = tuple[Key, ...]

_UNTYPABLE = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]")
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class Positions(NamedTuple):
    """Line and column, from 1, of a value and of its key."""

    value: Place
    key: Place
    file: str


class _StopError(Exception):
    """Parsing ends here; the faults say why."""


_AWAITED = object()  # the mapping's next node is a key
_DROPPED = object()  # the key was at fault: its value is read and discarded


@dataclass(slots=True)
class _OpenCollection:
    """A list or mapping that is still open; a `path` of None means that it is discarded."""

    container: list[Any] | dict[Key, Any]
    path: Path | None
    anchor: str | None
    start: int
    height: int = 1
    key: Any = _AWAITED
    key_place: Place = (1, 1)
    seen: dict[str, int] = field(default_factory=dict)
    halves: _Halves | None = None

    def awaits_key(self) -> bool:
        return isinstance(self.container, dict) and self.key is _AWAITED


class _Halves(NamedTuple):
    """Both halves of a number that a comma may have split, the place of the first, and the faults before."""

    first: str
    second: str
    place: Place
    faults: int


def parse_yaml(
    text: str, file: str, *, limited: bool = True
) -> tuple[Any, dict[Path, Positions], list[Fault]]:
    """Read one YAML document; of any length where it is not `limited`, but written by dynid.

    The data are valid only where there are no faults.
    """
    builder = _TreeBuilder(file, limited=limited)
    try:
        builder.check_characters(text)
        builder.read(yaml.parse(text, Loader=_LOADER))
    except _StopError:
        pass
    except yaml.YAMLError as error:
        builder.faults.append(_in_plain_words(error, text, file))
    return builder.root, builder.marks, builder.faults


class _TreeBuilder:
    """Builds plain data from events, keeping a stack of open collections."""

    def __init__(self, file: str, *, limited: bool) -> None:
        self.file, self._limited = file, limited
        self.root: Any = None
        self.marks: dict[Path, Positions] = {}
        self.faults: list[Fault] = []
        self._stack: list[_OpenCollection] = []
        self._anchors: dict[str, tuple[Any, int, int]] = {}  # value, nodes, height
        self._nodes = 0
        self._last: yaml.Event | None = None  # the event before

    def check_characters(self, text: str) -> None:
        if self._limited and len(text) > MAX_CHARACTERS:
            size = f"{MAX_CHARACTERS // 2**20} MiB"
            self._stop((1, 1), f"the text is longer than {size}; put large data in files")
        matches = list(islice(_UNTYPABLE.finditer(text), 10))
        for match in matches:
            character = f"the character U+{ord(match.group()):04X} does not belong in a scene"
            self._fault(place_of(text, match.start()), character)
        if matches:
            raise _StopError

    def read(self, events: Iterator[yaml.Event]) -> None:
        documents = 0
        for event in events:
            mark: Any = event.start_mark
            position = (mark.line + 1, mark.column + 1)
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self._stop(position, "a second document begins here; a scene is one document")
            elif isinstance(event, yaml.ScalarEvent):
                self._count(1, position)
                self._attach(self._scalar(event, position), position, event)
            elif isinstance(event, yaml.AliasEvent):
                self._alias(event, position)
            elif isinstance(event, yaml.CollectionStartEvent):
                self._open(event, position)
            elif isinstance(event, yaml.CollectionEndEvent):
                frame = self._stack.pop()
                if frame.anchor is not None:
                    self._anchors[frame.anchor] = (frame.container, self._nodes - frame.start, frame.height)
                parent = self._stack[-1] if self._stack else None
                if parent is not None and parent.awaits_key():
                    parent.key = _DROPPED
                else:
                    self._put(frame.container, frame.height)
            self._last = event

    def _fault(self, position: Place, message: str) -> None:
        self.faults.append(Fault(self.file, *position, message))
        if len(self.faults) >= MAX_FAULTS:
            raise _StopError

    def _stop(self, position: Place, message: str) -> NoReturn:
        self.faults.append(Fault(self.file, *position, message))
        raise _StopError

    def _count(self, nodes: int, position: Place) -> None:
        self._nodes += nodes
        if self._limited and self._nodes > _MAX_NODES:
            self._stop(position, f"more than {_MAX_NODES:,} values, aliases counted; put large data in files")

    def _scalar(self, event: yaml.ScalarEvent, position: Place) -> Any:
        text, tag = event.value, event.tag
        if UNSTORABLE.search(text):
            self._fault(position, "a text cannot hold the character NUL or half of a surrogate pair")
        try:
            if tag is None:
                return resolve_plain(text) if event.implicit[0] else text
            if tag in ("!", f"{_CORE}str"):
                return text
            return _resolve_tagged(text, tag)
        except ValueError as error:
            self._fault(position, str(error))
            return None

    def _alias(self, event: yaml.AliasEvent, position: Place) -> None:
        name = event.anchor
        if any(frame.anchor == name for frame in self._stack):
            self._stop(position, f"the alias *{name} stands inside the value it repeats")
        if name not in self._anchors:
            message = f"no anchor &{name} stands before this alias; put a text that begins with * in quotes"
            self._stop(position, message)
        value, nodes, height = self._anchors[name]
        self._count(nodes, position)
        if len(self._stack) + height > MAX_DEPTH:
            self._stop(position, f"nested more than {MAX_DEPTH} deep, aliases counted")
        self._attach(value, position, None, height)

    def _open(self, event: yaml.CollectionStartEvent, position: Place) -> None:
        sequence = isinstance(event, yaml.SequenceStartEvent)
        if len(self._stack) >= MAX_DEPTH:
            self._stop(position, f"nested more than {MAX_DEPTH} deep")
        if event.tag not in (None, "!", f"{_CORE}{'seq' if sequence else 'map'}"):
            self._fault(position, _tag_message(event.tag))
        parent = self._stack[-1] if self._stack else None
        as_key = parent is not None and parent.awaits_key()
        if as_key:
            self._fault(position, "a key is one word or whole number, not a list or mapping")
        path = None if as_key else self._locate(position)
        self._count(1, position)
        self._stack.append(_OpenCollection([] if sequence else {}, path, event.anchor, self._nodes - 1))

    def _attach(self, value: Any, position: Place, event: yaml.ScalarEvent | None, height: int = 0) -> None:
        if event is not None and event.anchor is not None:
            self._anchors[event.anchor] = (value, 1, 0)
        if self._stack and self._stack[-1].awaits_key():
            plain = event is not None and event.implicit[0]
            # A key is a word: `true` beside `start` names a value, as it would in quotes.
            word = event.value if event is not None and isinstance(value, bool) else value
            self._stack[-1].halves = self._halves(event) if plain else None
            self._take_key(word, position, plain)
        else:
            if event is not None and self._stack:
                self._rejoin(event)
            self._locate(position)
            self._put(value, height)

    def _halves(self, key: yaml.ScalarEvent | None) -> _Halves | None:
        """Return the halves of a decimal number of which a comma makes a value and a key, as of {R: 0,6}."""
        last = self._last
        if key is None or not isinstance(last, yaml.ScalarEvent) or not last.implicit[0]:
            return None
        marks: Any = (last.start_mark, last.end_mark, key.start_mark)
        begin, end, behind = marks
        touches = (end.line, end.column + 1) == (behind.line, behind.column)
        numbers = _ENDS_WHOLE.search(last.value) and key.value[:1] in _DIGITS
        if not (touches and numbers):
            return None
        return _Halves(last.value, key.value, (begin.line + 1, begin.column + 1), len(self.faults))

    def _rejoin(self, value: yaml.ScalarEvent) -> None:
        """Report a decimal comma where the second half of a number is a key without a value."""
        frame = self._stack[-1]
        halves, frame.halves = frame.halves, None
        if halves is None or value.value or not value.implicit[0]:
            return
        del self.faults[halves.faults :]  # what is wrong with the half as a key
        frame.seen.pop(halves.second, None)
        frame.key = _DROPPED
        first, second = shorten(halves.first), shorten(halves.second)
        message = f"the comma in '{first},{second}' ends the value; decimals stand behind a point: "
        self._fault(halves.place, f"{message}{first}.{second}")

    def _take_key(self, key: Any, position: Place, plain: bool) -> None:
        frame = self._stack[-1]
        frame.key, frame.key_place = _DROPPED, position
        if key == "<<" and plain:
            self._fault(position, "merge keys (<<) are not part of YAML 1.2; write the keys out")
        elif isinstance(key, bool) or not isinstance(key, str | int):
            self._fault(position, "a key is a text or a whole number; put any other word in quotes")
        elif str(key) in frame.seen:  # 1 and '1' name the same thing
            first = frame.seen[str(key)]
            self._fault(position, f"the key '{shorten(str(key))}' is given twice, first on line {first}")
        else:
            frame.seen[str(key)] = position[0]
            frame.key = key

    def _locate(self, position: Place) -> Path | None:
        """Return the path of the value that begins here, and record its place."""
        path: Path | None = ()
        key_place = position
        if self._stack:
            frame = self._stack[-1]
            key = len(frame.container) if isinstance(frame.container, list) else frame.key
            if isinstance(frame.container, dict):
                key_place = frame.key_place
            path = None if frame.path is None or key is _DROPPED else (*frame.path, key)
        if path is not None:
            self.marks[path] = Positions(position, key_place, self.file)
        return path

    def _put(self, value: Any, height: int) -> None:
        if not self._stack:
            self.root = value
            return
        frame = self._stack[-1]
        frame.height = max(frame.height, height + 1)
        if isinstance(frame.container, list):
            frame.container.append(value)
            return
        if frame.key is not _DROPPED:
            frame.container[frame.key] = value
        frame.key = _AWAITED
