"""Interrupts (Ctrl-C and SIGTERM), deferred while HDF5 writes."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def deferred_interrupts() -> Iterator[Callable[[], None]]:
    """Defer interrupts until the end, or until the yielded function is called.

    HDF5 does not survive an interrupt during writing.
    """
    came: list[int] = []
    before: dict[int, Any] = {}

    def check() -> None:
        if came:
            number = came.pop()
            came.clear()
            before[number](number, None)

    if threading.current_thread() is not threading.main_thread():
        yield check  # only the main thread receives interrupts
        return
    for number in (int(signal.SIGINT), int(signal.SIGTERM)):
        if callable(handler := signal.getsignal(number)):  # the default action ends the process at once
            before[number] = handler
            signal.signal(number, lambda came_now, _: came.append(came_now))
    try:
        yield check
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    check()


class Terminated(KeyboardInterrupt):
    """The system asked this process to end (SIGTERM)."""


@contextmanager
def terminations() -> Iterator[None]:
    """Let SIGTERM interrupt like Ctrl-C, as `Terminated`."""

    def end(*_: Any) -> None:
        raise Terminated

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
