"""What the page of a watched scene shows now; those who wait are told when it changes."""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Notice:
    """What is to be seen.

    Parameters
    ----------
    page
        HTML of the last good result.
    version
        Counts good results.
    fault
        What is wrong with the scene as it is now; empty where nothing is.
    running
        Whether it is being run.
    """

    page: str = ""
    version: int = 0
    fault: str = ""
    running: bool = False


class Board:
    """Holds a notice that one thread replaces and others wait for."""

    def __init__(self) -> None:
        self._notice = Notice()
        self._changed = threading.Condition()

    @property
    def now(self) -> Notice:
        """The notice as it is."""
        return self._notice

    def put(self, **news: str | int | bool) -> None:
        """Replace a part of the notice."""
        with self._changed:
            self._notice = replace(self._notice, **news)  # type: ignore[arg-type]
            self._changed.notify_all()

    def wait(self, seen: Notice | None, seconds: float) -> Notice:
        """Return the notice once it is another one than was seen, or after some time as it is."""
        with self._changed:
            self._changed.wait_for(lambda: self._notice is not seen, seconds)
            return self._notice
