"""Standard output and standard error with control characters written as escapes.

Titles, names and paths come from files of any origin; their control characters must not reach a terminal.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO, cast

from dynid.suggestions import printable


class _Guarded:
    """A text stream that writes control characters as escapes; line feeds and tabs stay."""

    #: `click` bypasses a stream whose encoding it finds unsuitable.
    encoding, errors = "utf-8", "replace"

    def __init__(self, stream: TextIO) -> None:
        self.stream = stream

    def write(self, text: str) -> int:
        """Write a text."""
        self.stream.write(printable(text))
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
