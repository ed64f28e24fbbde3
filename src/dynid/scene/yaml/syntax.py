"""Places in a text, and the parser's syntax errors in plain words."""

from __future__ import annotations

import re

import yaml

from dynid.errors import Fault

Place = tuple[int, int]

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


def place_of(text: str, index: int) -> Place:
    """Give the line and column (from 1) of a character of a text."""
    before = text[:index]
    line = len(re.findall(r"\r\n?|\n", before)) + 1
    return line, index - max(before.rfind("\n"), before.rfind("\r"))


def in_plain_words(error: yaml.YAMLError, text: str, file: str) -> Fault:
    """Turn a syntax error of the YAML parser into a located fault."""
    problem = str(getattr(error, "problem", None) or error)
    mark, context = getattr(error, "problem_mark", None), getattr(error, "context_mark", None)
    line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
    lines = text.splitlines()
    character = lines[line - 1][column - 1 : column] if line <= len(lines) else ""
    if "start any token" in problem:
        plain = f"a text cannot begin with '{character}'; put it in quotes"
        message = _PLAIN_WORDS["violates indentation"] if character == "\t" else plain
    else:
        known = (words for part, words in _PLAIN_WORDS.items() if part in problem)
        message = next(known, f"this is not valid YAML: {problem}")
    if mark and context and context.line != mark.line:
        message += f" (it begins at line {context.line + 1}, column {context.column + 1})"
    return Fault(file, line, column, message)
