"""What a piece of work costs: its time, and its peak of memory where the system tells."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

_PROCESS = Path("/proc/self")


@dataclass
class Cost:
    """Cost of a piece of work.

    Attributes
    ----------
    seconds
        Wall time.
    peak_megabytes
        The process's memory at its highest meanwhile, above what it was before; None where unknown.
    """

    seconds: float = 0.0
    peak_megabytes: float | None = None

    def attributes(self) -> dict[str, float]:
        """Return what is known, by name."""
        peak = {} if self.peak_megabytes is None else {"peak_megabytes": self.peak_megabytes}
        return {"seconds": self.seconds, **peak}


@contextmanager
def measured() -> Iterator[Cost]:
    """Measure what happens inside; the cost is complete on leaving."""
    cost = Cost()
    before = _restarted()
    started = time.perf_counter()
    yield cost
    cost.seconds = time.perf_counter() - started
    peak = _resident("VmHWM")
    if before is not None and peak is not None:
        cost.peak_megabytes = max(0.0, peak - before)


def _restarted() -> float | None:
    """Restart the system's peak, and return the memory in use, MB; None where there is no such peak."""
    try:
        (_PROCESS / "clear_refs").write_text("5")
    except OSError:
        return None
    return _resident("VmRSS")


def _resident(key: str) -> float | None:
    try:
        lines = (_PROCESS / "status").read_text().splitlines()
    except OSError:
        return None
    found = (line.split()[1] for line in lines if line.startswith(f"{key}:"))
    kilobytes = next(found, None)
    return None if kilobytes is None else int(kilobytes) / 1024
