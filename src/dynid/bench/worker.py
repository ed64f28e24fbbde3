"""Measurement of one alternative, in a process of its own.

Each alternative has its own process, so that its peak memory is its own and no other one's modules interfere;
the processes take turns, so that a drift of the machine's speed affects all.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from statistics import median
from subprocess import SubprocessError
from time import perf_counter, process_time
from typing import Any

from dynid.bench.benchmark import benchmark
from dynid.errors import DynidError

#: Fewest and most runs, and the time after which no further one is started, s.
_MIN_RUNS, _MAX_RUNS, _MIN_SECONDS = 3, 25, 0.3
#: Time after which fewer runs suffice, s; a first run longer than that by this factor is the measurement.
_LONG_SECONDS, _SINGLE_RATIO = 1.0, 60


def measured(name: str, alternative: str, size: int, clock: str = "wall") -> dict[str, Any]:
    """Measure one alternative at one size: median time, rise of the peak memory, error; or the failure."""
    case = benchmark(name)
    chosen = next(candidate for candidate in case.alternatives if candidate.name == alternative)
    try:
        work = chosen.prepared(size, case.problem)
        before, now = _peak_memory(), CLOCKS[clock]
        start = now()
        result = work()  # loads, compiles, and fills caches
        first = now() - start
        memory = _peak_memory() - before
        return {
            "time": first if first > _SINGLE_RATIO * _LONG_SECONDS else _timed(work, now),
            "memory": memory,
            "error": float(case.error(size, result)),
        }
    except (DynidError, ArithmeticError, ValueError, MemoryError, SubprocessError) as error:
        return {"failed": f"{type(error).__name__}: {error}".splitlines()[0]}


def _timed(work: Callable[[], Any], clock: Callable[[], float]) -> float:
    times: list[float] = []
    while (len(times) < _MIN_RUNS and sum(times) < _LONG_SECONDS) or (
        sum(times) < _MIN_SECONDS and len(times) < _MAX_RUNS
    ):
        start = clock()
        work()
        times.append(clock() - start)
    return median(times)


def processor() -> float:
    """Return the time that processors spent on this process and on those it ran, s."""
    try:
        import resource
    except ImportError:  # not on Windows
        return process_time()
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() + ended.ru_utime + ended.ru_stime


#: Clocks: wall time, or processor time, which depends little on other work.
CLOCKS: dict[str, Callable[[], float]] = {"wall": perf_counter, "processor": processor}


def _peak_memory() -> float:
    """Return the largest resident size of this process, or of one it ran, so far, bytes; 0: unknown."""
    try:
        import resource
    except ImportError:  # not on Windows
        return 0.0
    unit = 1 if sys.platform == "darwin" else 1024
    who = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return float(max(resource.getrusage(process).ru_maxrss for process in who) * unit)
