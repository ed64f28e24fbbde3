"""Ctrl-C at moments that can take it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def deferred_interrupts() -> Iterator[Callable[[], None]]:
    """Keep an interrupt back until the end, or until what this gives is called.

    HDF5 does not survive one in the middle of writing.
    """
    came: list[int] = []

    def check() -> None:
        if came:
            came.clear()
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield check  # interrupts come to the main thread only
        return
    before: Any = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
    check()
