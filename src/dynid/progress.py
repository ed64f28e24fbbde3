"""Progress of the work: reported by computations, received by a listener if there is one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

Listener = Callable[[str], None]
"""Receives a short description of the current work."""

_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def progress_to(listener: Listener) -> Iterator[None]:
    """Pass the progress reported within to a listener.

    It is called with a short text in the thread that does the work, and must return quickly.

    Examples
    --------
    >>> with progress_to(print):
    ...     report_progress("reducing the graph")
    reducing the graph
    >>> report_progress("no listener")
    """
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def report_progress(what: str) -> None:
    """Report the current work."""
    listener = _LISTENER.get()
    if listener is not None:
        listener(what)


def tracked(things: Collection[T], what: str) -> Iterator[T]:
    """Yield items, and report the number of each before it.

    Examples
    --------
    >>> with progress_to(print):
    ...     found = list(tracked("ab", "channel"))
    channel 1 of 2
    channel 2 of 2
    """
    for number, thing in enumerate(things, 1):
        report_progress(f"{what} {number} of {len(things)}")
        yield thing
