"""Worker process that measures one alternative, one size per request.

Each alternative has its own process, so that its peak memory is its own and no other one's modules interfere;
the processes take turns, so that a drift of the machine's speed affects all.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from statistics import median
from subprocess import SubprocessError
from time import perf_counter, process_time
from typing import Any

from dynid.bench.benchmark import benchmark
from dynid.bench.process import serve
from dynid.errors import DynidError

#: Fewest and most runs, and the time after which no further one is started, s.
_FEWEST, _MOST, _ENOUGH = 3, 25, 0.3
#: Time after which even fewer have to do, s; a first run of so many times that (compiling takes less) counts.
_LONG, _WHOLE = 1.0, 60


def main(name: str, alternative: str, clock: str = "wall") -> None:
    """Answer sizes with measurements, as `dynid.bench.process.Process` asks."""
    serve(partial(measured, name, alternative, clock=clock))


def measured(name: str, alternative: str, size: int, clock: str = "wall") -> dict[str, Any]:
    """Measure one alternative at one size: median time, rise of the peak memory, error; or the failure."""
    case = benchmark(name)
    chosen = next(each for each in case.alternatives if each.name == alternative)
    try:
        work = chosen.prepare(size)
        before, now = peak_memory(), CLOCKS[clock]
        start = now()
        result = work()  # loads, compiles, and fills caches
        first = now() - start
        memory = peak_memory() - before
        return {
            "time": first if first > _WHOLE * _LONG else _timed(work, now),
            "memory": memory,
            "error": float(case.error(size, result)),
        }
    except (DynidError, ArithmeticError, ValueError, MemoryError, SubprocessError) as error:
        return {"failed": f"{type(error).__name__}: {error}".splitlines()[0]}


def _timed(work: Callable[[], Any], clock: Callable[[], float]) -> float:
    times: list[float] = []
    while (len(times) < _FEWEST and sum(times) < _LONG) or (sum(times) < _ENOUGH and len(times) < _MOST):
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


def peak_memory() -> float:
    """Return the largest resident size of this process, or of one it ran, so far, bytes; 0: unknown."""
    try:
        import resource
    except ImportError:  # not on Windows
        return 0.0
    unit = 1 if sys.platform == "darwin" else 1024
    who = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return float(max(resource.getrusage(each).ru_maxrss for each in who) * unit)
