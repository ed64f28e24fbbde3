"""Standard output and standard error without control characters of files.

A title, a name or a path may come from anybody's file; what a terminal would obey is written as an escape.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO, cast

from dynid.suggestions import printable


class _Guarded:
    """A text stream that writes control characters as escapes; line feeds and tabs stay."""

    #: As of a stream that needs no other encoding: `click` would write around this one.
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
    """Have all that is written to standard output and standard error guarded."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (
        cast("TextIO", _Guarded(stream)) if stream is not None else stream for stream in before
    )
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def terminal() -> TextIO:
    """Return standard error for what moves the cursor; texts of files are to be made printable first."""
    stream: Any = sys.stderr
    return cast("TextIO", stream.stream if isinstance(stream, _Guarded) else stream)
