"""What a run is expected to cost: time, memory, and the size of its file."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

# The probe of `speed` on the machine that the rates of the explanations are from, s.
_REFERENCE = 1.0e-3


@dataclass(frozen=True)
class Cost:
    """What a run is expected to cost.

    The time is counted from what will be done and rates measured once, or from pieces of the work itself;
    it is right within a factor of a few.

    Parameters
    ----------
    parts
        Seconds of each part of the work, without the start of the program.
    megabytes
        Memory of the process at its peak.
    kilobytes
        Size of the result's file.
    """

    parts: Mapping[str, float]
    megabytes: float
    kilobytes: float

    @property
    def seconds(self) -> float:
        """Seconds of all of it."""
        return sum(self.parts.values())


@cache
def speed() -> float:
    """Return how fast this machine is, over the one that rates are from: from a probe of milliseconds."""
    best = min(_probe() for _ in range(5))
    return _REFERENCE / best


def _probe() -> float:
    began = time.thread_time()
    total = 0
    for k in range(20_000):
        total += k & 7
    return time.thread_time() - began


def peak_megabytes() -> float:
    """Return the memory that the process has used at its peak so far, MB; a guess where nothing tells."""
    try:
        import resource
    except ImportError:  # not on every system
        return 100.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def file_kilobytes(arrays: int, values: float) -> float:
    """Return the size of a file of so many arrays that hold so many numbers (complex ones are two)."""
    return 8.0 + 0.8 * arrays + 8 * values / 1000
