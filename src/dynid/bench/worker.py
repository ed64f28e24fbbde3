"""Worker processes: one that serves requests and can be stopped, and the one that measures an alternative.

Each alternative has its own process, so that its peak memory is its own and no other one's modules interfere;
the processes take turns, so that a drift of the machine's speed affects all.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from statistics import median
from subprocess import SubprocessError
from threading import Timer
from time import perf_counter, process_time
from types import TracebackType
from typing import Any, Self

from dynid.bench.benchmark import benchmark
from dynid.errors import DynidError

#: Environment variables with the number of threads of numerical libraries.
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
#: Environment variables with the folder of temporary files.
_FOLDERS = ("TMPDIR", "TEMP", "TMP")


class Process:
    """A process of its own that runs the function `main` of a module, which calls `serve`.

    Requests and responses are pickled: both ends are the same installation.

    Parameters
    ----------
    module
        The module.
    arguments
        Arguments of `main`.
    python
        The interpreter that runs it.
    threads
        Threads of numerical libraries; default: their default, or that of the environment.
    folder
        Folder of its temporary files; default: that of this process.
    """

    def __init__(
        self,
        module: str,
        *arguments: str,
        python: str = sys.executable,
        threads: int | None = None,
        folder: str | None = None,
    ) -> None:
        # Imported rather than run: what is pickled must not belong to a module called __main__.
        command = [python, "-c", f"from {module} import main; main(*{arguments!r})"]
        limited = {} if threads is None else dict.fromkeys(_THREADS, str(threads))
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**limited, **os.environ, **({} if folder is None else dict.fromkeys(_FOLDERS, folder))},
        )

    def ask(self, request: Any, seconds: float | None = None) -> Any:
        """Return the response to a request; None where the process ended, or was stopped after `seconds`."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        timer = Timer(seconds if seconds is not None else 0.0, self._process.kill)
        if seconds is not None:
            timer.start()
        try:
            pickle.dump(request, self._process.stdin)
            self._process.stdin.flush()
            return pickle.load(self._process.stdout)
        except (BrokenPipeError, EOFError, pickle.UnpicklingError):
            return None
        finally:
            timer.cancel()

    def close(self) -> None:
        """End the process and abandon its current work."""
        self._process.kill()
        for stream in (self._process.stdin, self._process.stdout):
            with suppress(BrokenPipeError):
                if stream is not None:
                    stream.close()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def serve(answer: Callable[[Any], Any]) -> None:
    """Serve requests from standard input until it ends; output of the work goes to standard error."""
    responses, sys.stdout = sys.stdout.buffer, sys.stderr
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        pickle.dump(answer(request), responses)
        responses.flush()


#: Fewest and most runs, and the time after which no further one is started, s.
_MIN_RUNS, _MAX_RUNS, _MIN_SECONDS = 3, 25, 0.3
#: Time after which fewer runs suffice, s; a first run longer than that by this factor is the measurement.
_LONG_SECONDS, _SINGLE_RATIO = 1.0, 60


def main(name: str, alternative: str, clock: str = "wall") -> None:
    """Serve sizes with measurements, as `Process` requests them."""
    serve(partial(measured, name, alternative, clock=clock))


def measured(name: str, alternative: str, size: int, clock: str = "wall") -> dict[str, Any]:
    """Measure one alternative at one size: median time, rise of the peak memory, error; or the failure."""
    case = benchmark(name)
    chosen = next(candidate for candidate in case.alternatives if candidate.name == alternative)
    try:
        work = chosen.prepare(size)
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
