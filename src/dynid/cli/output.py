"""Standard output and standard error: control characters as escapes, verdicts and warnings in colour.

Titles, names and paths come from files of any origin; their control characters must not reach a terminal.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO, cast

from dynid.suggestions import printable

#: What is coloured on terminals, and by which number of ANSI.
_COLOURS = {
    "31": r"expectation failed:|not converged|unstable|problem:",
    "32": r"(?<=^ {2})converged(?=:)|(?<=^ {12})stable$|no problems found",
    "33": r"warning:|(?<=^ {12})marginal",
}
_MARKED = re.compile("|".join(f"(?P<c{code}>{words})" for code, words in _COLOURS.items()), re.MULTILINE)


def _has_colours(stream: TextIO) -> bool:
    """Return True for a terminal with colours; NO_COLOR and FORCE_COLOR decide where they are set."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR"):
        return True
    # Of terminals on Windows, those that understand the escapes name themselves.
    known = os.name != "nt" or "WT_SESSION" in os.environ or "TERM" in os.environ
    return stream.isatty() and known and os.environ.get("TERM") != "dumb"


class _Guarded:
    """A text stream that writes control characters as escapes; line feeds and tabs stay."""

    #: `click` bypasses a stream whose encoding it finds unsuitable.
    encoding, errors = "utf-8", "replace"

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream
        self._coloured = _has_colours(stream)

    def write(self, text: str) -> int:
        """Write a text."""
        safe = printable(text)
        if self._coloured:
            safe = _MARKED.sub(lambda found: f"\033[{str(found.lastgroup)[1:]}m{found[0]}\033[0m", safe)
        self.stream.write(safe)
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


@contextmanager
def guarded() -> Iterator[None]:
    """Write control characters as escapes on standard output and standard error."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (
        cast("TextIO", _Guarded(stream)) if stream is not None else stream for stream in before
    )
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def terminal() -> TextIO:
    """Return the unguarded standard error, to move the cursor; texts of files must be made printable."""
    stream: Any = sys.stderr
    return cast("TextIO", stream.stream if isinstance(stream, _Guarded) else stream)
