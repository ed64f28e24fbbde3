"""How far the work is, for who looks."""

from __future__ import annotations

import sys
from collections.abc import Callable

import click


def teller() -> Callable[[str], None]:
    """Return what tells the progress: a line that is overwritten, or nothing where nobody looks."""
    if not sys.stderr.isatty():
        return lambda _: None
    return lambda line: click.echo(f"\r\033[K{line}", nl=False, err=True)
