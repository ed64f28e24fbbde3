"""Plain scalars and tags by the core schema of YAML 1.2.

PyYAML's own rules are those of YAML 1.1, where `1e3` is a text, `on` is true and `12:30` is 750.
"""

from __future__ import annotations

import re
from typing import Any

MAX_DIGITS = 400
CORE = "tag:yaml.org,2002:"
UNSTORABLE = re.compile("[\0\ud800-\udfff]")

_NULL = frozenset({"", "~", "null", "Null", "NULL"})
_BOOL = {word: word.lower() == "true" for word in ("true", "True", "TRUE", "false", "False", "FALSE")}
_INT = re.compile(r"(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)\Z")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?\Z")
_INF = re.compile(r"[-+]?\.(?:inf|Inf|INF)\Z")
_NAN = frozenset({".nan", ".NaN", ".NAN"})


def resolve_plain(text: str) -> str | int | float | bool | None:
    """Give an unquoted scalar its value by the core schema of YAML 1.2.

    Raises
    ------
    ValueError
        When a number is too long, or too large for double precision.
    """
    if text in _NULL:
        return None
    if text in _BOOL:
        return _BOOL[text]
    if _INT.match(text):
        return _whole_number(text)
    if _FLOAT.match(text):
        value = float(text)
        if value in (float("inf"), float("-inf")):
            raise ValueError(f"{shorten(text)} is too large for a number in double precision")
        return value
    if _INF.match(text):
        return float("-inf" if text[0] == "-" else "inf")
    return float("nan") if text in _NAN else text


def _whole_number(text: str) -> int:
    # The length is checked before the conversion, whose cost grows with its square.
    base = {"0o": 8, "0x": 16}.get(text[:2], 10)
    if len(text) <= 2 * MAX_DIGITS:
        value = int(text, base)
        if abs(value) < 10**MAX_DIGITS:
            return value
    raise ValueError(f"{shorten(text)} has more than {MAX_DIGITS} digits")


def shorten(text: str) -> str:
    """Keep a quoted text short enough for a message."""
    return text if len(text) <= 40 else f"{text[:20]}…"


def resolve_tagged(text: str, tag: str) -> Any:
    """Give a scalar the value that its core tag (`!!int`, `!!float`, `!!bool`, `!!null`) asks for.

    Raises
    ------
    ValueError
        When the tag is another, or the text is not of that type.
    """
    value = resolve_plain(text)
    kind = tag.removeprefix(CORE)
    if kind == "float" and type(value) is int:
        return resolve_plain(f"{value}.0")
    expected = {"int": int, "float": float, "bool": bool, "null": type(None)}.get(kind)
    if expected is None:
        raise ValueError(tag_message(tag))
    if type(value) is not expected:
        raise ValueError(f"'{shorten(text)}' is not of the type {kind} that its tag says")
    return value


def tag_message(tag: str) -> str:
    """Say that a tag is not allowed."""
    shown = tag.replace(CORE, "!!")
    return f"the tag {shorten(shown)} is not allowed; a scene is plain texts, numbers, lists and mappings"
