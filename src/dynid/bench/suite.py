"""Runs of benchmarks, with the figures as a `Result`.

Each alternative has its own process, so that its peak memory is its own and no other one's modules interfere;
the processes take turns, so that a drift of the machine's speed affects all.
"""

from __future__ import annotations

import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from statistics import median
from subprocess import SubprocessError
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from dynid.bench.benchmark import BENCHMARKS, Benchmark, benchmark
from dynid.defaults import of_benchmark
from dynid.errors import DynidError, NumericalError, UsageError
from dynid.number_format import counted, significant
from dynid.result import Result
from dynid.study.executors import cores
from dynid.trial import ONE_THREAD, ChildProcess, ProcessDied


@dataclass(frozen=True)
class BenchmarkFigure:
    """Time, memory and error of one alternative at one size.

    `failed` is the reason of a failure; `late` marks one that was not started within the time.
    """

    size: int
    time: float = 0.0
    memory: float = 0.0
    error: float = 0.0
    failed: str = ""
    late: bool = False


def run_benchmarks(
    names: Iterable[str],
    sizes: Mapping[str, Sequence[int]] | None = None,
    progress: Callable[[str], None] = lambda _: None,
    *,
    full: bool = False,
    clock: str = "wall",
    seconds: float = math.inf,
) -> Result:
    """Run benchmarks of `BENCHMARKS`; `progress` is called with a line before each measurement.

    `full` adds the larger sizes, which take minutes. `clock` is ``wall`` or ``processor``. `seconds` limits
    the total time: each benchmark may use the time that those after it do not need. Its smallest size is
    always measured; others that exceed the time are left out, and named.

    Returns
    -------
    Result
        ``bench/<name>/<alternative>/{size, time, memory, error}``: s, bytes, and the error that the attribute
        `measure` of ``bench/<name>`` defines; `pareto` marks the Pareto-optimal ones in time and error,
        `default` the one that dynid uses by default at that size. The attribute `exponent` is the power of
        the size with which time grows between the two largest sizes, `peer` is True for a method of another
        project. Attributes of ``bench/<name>``: the peers that beat the default in both (`beaten`), the
        alternatives that are `missing`, that `failed`, or that were left out for time (`late`), and the
        defaults that the table justifies (`chosen`). Attributes of ``bench``: the total time (`seconds`), the
        `machine` with its Python, NumPy and BLAS, and the benchmarks of which no alternative can run
        (`skipped`), with the reason.

    Raises
    ------
    UsageError
        If no alternative of any of them can run.
    """
    result, began, chosen = Result("bench", "Speed against error"), time.monotonic(), list(names)
    skipped: list[str] = []
    for index, name in enumerate(chosen):
        case = benchmark(name)
        reasons = [alternative.missing() for alternative in case.alternatives]
        if all(reasons):
            skipped.append(f"{name}: {'; '.join(dict.fromkeys(reasons))}")
            continue
        default_sizes = sorted((*case.sizes, *case.full)) if full else case.sizes
        until = began + seconds - sum(BENCHMARKS[later].seconds for later in chosen[index + 1 :])
        where, case_sizes = f"{index + 1} of {len(chosen)}: {name}", (sizes or {}).get(name, default_sizes)
        _add(result, name, case, _measured(name, case, case_sizes, progress, where, clock, until))
    if chosen and len(skipped) == len(chosen):
        raise UsageError(f"nothing can be measured: {'; '.join(skipped)}")
    spent = time.monotonic() - began
    result.annotate("bench", clock=clock, seconds=spent, skipped="; ".join(skipped), machine=machine())
    return result


def _measured(
    name: str,
    case: Benchmark,
    sizes: Sequence[int],
    progress: Callable[[str], None],
    where: str,
    clock: str,
    until: float,
) -> dict[str, list[BenchmarkFigure]]:
    """Measure all alternatives, in turns by size; beyond the first size none is started after `until`."""
    present = [alternative for alternative in case.alternatives if not alternative.missing()]
    figures: dict[str, list[BenchmarkFigure]] = {alternative.name: [] for alternative in present}
    with TemporaryDirectory() as folder, ExitStack() as stack:
        environment = ONE_THREAD | os.environ | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), folder)
        workers = {
            alternative.name: stack.enter_context(ChildProcess(environment, python=alternative.interpreter))
            for alternative in present
        }
        for size in sizes:
            for alternative in present:
                if alternative.at(size):
                    progress(f"{where}, {case.size} {size:,}, {alternative.name}")
                    answer: dict[str, Any] = {"late": True}
                    if size == sizes[0] or time.monotonic() <= until:
                        worker = workers[alternative.name]
                        try:
                            answer = worker.run(None, measured, name, alternative.name, size, clock)
                        except ProcessDied:
                            answer = {"failed": "it ended"}
                    figures[alternative.name].append(BenchmarkFigure(size, **answer))
    return figures


def _add(result: Result, name: str, case: Benchmark, figures: Mapping[str, list[BenchmarkFigure]]) -> None:
    numbers = {key: [row for row in rows if not (row.failed or row.late)] for key, rows in figures.items()}
    done = {key: rows for key, rows in numbers.items() if rows}
    if not done:
        raise NumericalError(
            f"no alternative of the benchmark {name} came to an end",
            remedy=_failures(case, figures),
            names=(name,),
        )
    late = sorted((row.size, key) for key, rows in figures.items() for row in rows if row.late)
    left_out = (
        f"{case.size} {size:,}: {', '.join(key for _, key in some)}"
        for size, some in groupby(late, key=lambda pair: pair[0])
    )
    missing = (
        f"{alternative.name} ({alternative.missing()})"
        for alternative in case.alternatives
        if alternative.missing()
    )
    attrs = {
        "failed": _failures(case, figures),
        "late": "; ".join(left_out),
        "missing": "; ".join(missing),
        "chosen": "; ".join(of_benchmark(name)),
        "limits": "; ".join(limits(case, done)),
        "remark": case.remark,
    }
    if case.default is not None:
        attrs["beaten"] = "; ".join(beaten(case, case.default, done))
    group = f"bench/{name}"
    result.annotate(group, title=case.title, size=case.size, measure=case.measure, **attrs)
    front = pareto([figure for rows in done.values() for figure in rows])
    for alternative in case.alternatives:
        if alternative.name not in done:
            continue
        here, rows = f"{group}/{alternative.name}", done[alternative.name]
        add_figures(result, here, rows)
        is_default = [
            case.default is not None and case.default(figure.size) == alternative.name for figure in rows
        ]
        result.add(f"{here}/pareto", np.array([figure in front for figure in rows]), ("size",))
        result.add(f"{here}/default", np.array(is_default), ("size",))
        power = exponent(rows)
        result.annotate(here, peer=alternative.peer, **({} if power is None else {"exponent": power}))


def add_figures(result: Result, group: str, rows: Sequence[BenchmarkFigure], *, errors: bool = True) -> None:
    """Add the figures of one alternative, with their sizes, and with errors if they are known."""
    result.add_axis(f"{group}/size", [figure.size for figure in rows])
    for column, units in ({"time": "s", "memory": "B"} | ({"error": ""} if errors else {})).items():
        values = np.array([getattr(figure, column) for figure in rows], dtype=float)
        result.add(f"{group}/{column}", values, ("size",), units)


def _failures(case: Benchmark, figures: Mapping[str, list[BenchmarkFigure]]) -> str:
    return "; ".join(
        f"{name} at {case.size} {row.size:,}: {row.failed}"
        for name, rows in figures.items()
        for row in rows
        if row.failed
    )


def pareto(figures: Iterable[BenchmarkFigure]) -> list[BenchmarkFigure]:
    """Return the figures that no other of the same size beats in time and error."""
    rows = list(figures)
    return [
        row
        for row in rows
        if not any(
            competitor.size == row.size
            and (competitor.time, competitor.error) != (row.time, row.error)
            and competitor.time <= row.time
            and competitor.error <= row.error
            for competitor in rows
        )
    ]


def beaten(
    case: Benchmark, chosen: Callable[[int], str], done: Mapping[str, list[BenchmarkFigure]]
) -> list[str]:
    """Return the peers that are both faster and more accurate than the default, with sizes, as text."""
    peers = [
        alternative.name for alternative in case.alternatives if alternative.peer and alternative.name in done
    ]
    sizes = sorted({row.size for rows in done.values() for row in rows})
    texts = []
    for size in sizes:
        at = {name: row for name, rows in done.items() for row in rows if row.size == size}
        default = at.get(chosen(size))
        if default is None:
            texts.append(f"at {case.size} {size:,} the default has no figures")
            continue
        texts += [
            f"at {case.size} {size:,} by {name} ({significant(default.time / at[name].time, 2)} times faster)"
            for name in peers
            if name in at and at[name].time < default.time and at[name].error < default.error
        ]
    return texts


def limits(case: Benchmark, done: Mapping[str, list[BenchmarkFigure]]) -> list[str]:
    """Return the ratios of times that are limited, as text."""
    return [
        f"{limit.alternative} takes {ratio:.2f} times {limit.of} (at most {limit.max_ratio:g})"
        for limit in case.limits
        if limit.alternative in done and limit.of in done
        for ratio in [done[limit.alternative][-1].time / done[limit.of][-1].time]
    ]


def exponent(rows: Sequence[BenchmarkFigure]) -> float | None:
    """Return the exponent of the growth of time between the two largest sizes; None for a single size."""
    if len(rows) < 2 or rows[-1].size <= rows[-2].size:
        return None
    return math.log(rows[-1].time / rows[-2].time) / math.log(rows[-1].size / rows[-2].size)


def machine() -> str:
    """Return processor, cores, system, Python, NumPy and its BLAS as text, each as it names itself."""
    info = Path("/proc/cpuinfo")
    text = info.read_text(encoding="utf-8", errors="replace") if info.exists() else ""
    models = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    chip = next(iter(models), "") or platform.processor() or platform.machine()
    blas = np.show_config(mode="dicts").get("Build Dependencies", {}).get("blas", {})
    algebra = " ".join(str(blas.get(key, "")) for key in ("name", "version")).strip() or "unknown BLAS"
    return (
        f"{chip}, {counted(cores(), 'core')}, {platform.system()}, Python {platform.python_version()}, "
        f"NumPy {np.__version__} ({algebra})"
    )


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
        return time.process_time()
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


#: Clocks: wall time, or processor time, which depends little on other work.
CLOCKS: dict[str, Callable[[], float]] = {"wall": time.perf_counter, "processor": processor}


def _peak_memory() -> float:
    """Return the largest resident size of this process, or of one it ran, so far, bytes; 0: unknown."""
    try:
        import resource
    except ImportError:  # not on Windows
        return 0.0
    unit = 1 if sys.platform == "darwin" else 1024
    who = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    return float(max(resource.getrusage(process).ru_maxrss for process in who) * unit)


#: A ratio of times, memory or errors that counts as a change; smaller memory and errors than these do not.
CHANGE, SMALL_MEMORY, SMALL_ERROR = 1.25, 16e6, 1e-13


@dataclass(frozen=True)
class BenchmarkChange:
    """Change of a figure: `value`, which was `before`; `worse` if it is larger."""

    path: str
    size: int
    value: float
    before: float

    @property
    def worse(self) -> bool:
        """True if the figure is larger than before."""
        return self.value > self.before


def changes(result: Result, earlier: Sequence[Result]) -> list[BenchmarkChange]:
    """Return the times, memory and errors that differ from all earlier measurements by more than 25 %.

    What is compared are the alternatives of dynid at common sizes. With several measurements of the same
    release a difference that is chance shows between them, and is none.
    """
    differences = []
    for path, variable in result.items():
        group, _, name = path.rpartition("/")
        if name not in ("time", "memory", "error") or result.group_attrs[group].get("peer"):
            continue
        threshold = {"time": 0.0, "memory": SMALL_MEMORY, "error": SMALL_ERROR}[name]
        for size, value in zip(result[f"{group}/size"].data.tolist(), variable.data.tolist(), strict=True):
            before = [
                float(measurement[path].data[row])
                for measurement in earlier
                if path in measurement
                for row in np.flatnonzero(measurement[f"{group}/size"].data == size)
            ]
            if not before:
                continue
            low, high = min(before), max(before)
            if value > CHANGE * max(high, threshold):
                differences.append(BenchmarkChange(path, size, value, high))
            elif CHANGE * max(value, threshold) < low:
                differences.append(BenchmarkChange(path, size, value, low))
    return differences
