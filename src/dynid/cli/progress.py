"""Progress of a run: one line on a terminal, for work that takes more than two seconds."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import click

from dynid.cli.output import terminal
from dynid.progress import Listener, progress_to
from dynid.suggestions import printable

# What takes less needs no line; from then on it is written anew so often, s.
_PATIENCE, _PERIOD = 2.0, 0.5
#: Longest text of the line: what is wider than the terminal could not be wiped.
_WIDTH = 72


@contextmanager
def showing(quiet: bool = False) -> Iterator[Listener]:
    """Show how far the work inside is; nothing where standard error is no terminal.

    Parameters
    ----------
    quiet
        Whether nobody wants to see it.

    Yields
    ------
    Listener
        For work that is handed a listener; all other work is heard anyway (`dynid.progress`).
    """
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    line = _Line()
    try:
        with progress_to(line.hear):
            yield line.hear
    finally:
        line.end()


class _Line:
    """A line that a thread of its own keeps up to date, since work need not report for long."""

    def __init__(self) -> None:
        self._said = ""
        self._began = time.monotonic()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def hear(self, what: str) -> None:
        self._said = what

    def end(self) -> None:
        """Wipe the line."""
        self._over.set()
        self._thread.join()

    def _write(self) -> None:
        if self._over.wait(_PATIENCE):
            return
        while not self._over.wait(_PERIOD):
            seconds = f"{time.monotonic() - self._began:.0f} s"
            said = printable(" · ".join(filter(None, (self._said[:_WIDTH], seconds))))
            click.echo(f"\r\033[K{said}", file=terminal(), nl=False)
        click.echo("\r\033[K", file=terminal(), nl=False)
