"""How far the work is: said by whoever does it, heard by whoever listens, and free where nobody does."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")

Listener = Callable[[str], None]
"""Hears what is being done, in a few words."""

_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def heard_by(listener: Listener) -> Iterator[None]:
    """Within, hand what is told to a listener.

    Parameters
    ----------
    listener
        Called with a few words, in the thread that does the work; it must be quick.

    Examples
    --------
    >>> with heard_by(print):
    ...     tell("reducing the graph")
    reducing the graph
    >>> tell("nobody listens")
    """
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def tell(what: str) -> None:
    """Say what is being done now."""
    listener = _LISTENER.get()
    if listener is not None:
        listener(what)


def counted(things: Collection[T], what: str) -> Iterator[T]:
    """Yield things, and say before each which of how many it is.

    Examples
    --------
    >>> with heard_by(print):
    ...     found = list(counted("ab", "channel"))
    channel 1 of 2
    channel 2 of 2
    """
    for number, thing in enumerate(things, 1):
        tell(f"{what} {number} of {len(things)}")
        yield thing
