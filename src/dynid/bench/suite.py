"""Running benchmarks: one process an alternative, in turns, and the figures as a `Result`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from itertools import groupby
from tempfile import TemporaryDirectory

import numpy as np

from dynid.bench.alternative import Alternative, Benchmark
from dynid.bench.catalogue import BENCHMARKS, benchmark
from dynid.bench.process import Process
from dynid.choices import of_benchmark
from dynid.errors import NumericalError
from dynid.result import Result


@dataclass(frozen=True)
class Figure:
    """What was measured of one alternative at one size.

    `failed` says why there are no numbers; `late`: it was not begun any more.
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
    tell: Callable[[str], None] = lambda _: None,
    *,
    full: bool = False,
    clock: str = "wall",
    seconds: float = math.inf,
) -> Result:
    """Run benchmarks.

    Parameters
    ----------
    names
        Which, of `BENCHMARKS`.
    sizes
        Sizes by name; absent: each benchmark's own.
    tell
        Called with a line before each measurement.
    full
        Whether to add the larger sizes that a benchmark names, which take minutes.
    clock
        What time is: ``wall``, or ``processor``, which other work on the machine changes little.
    seconds
        How long all may take together, s: each benchmark what those after it do not need (`BENCHMARKS`). Its
        smallest size is always measured; of the others what does not fit is left out, and named.

    Returns
    -------
    Result
        ``bench/<name>/<alternative>/{size, time, memory, error}``: s, bytes, and what the attribute `measure`
        of ``bench/<name>`` says; `pareto` marks what no other alternative beats in both time and error,
        `default` what the suite itself takes at that size. The attribute `exponent` says how its time grows
        between the two largest sizes, `peer` that it is another project's. Attributes of ``bench/<name>``
        say which peers beat the default in both (`beaten`), which alternatives are `missing` or `failed`,
        what was left out for time (`late`), and the choices that rest on the table (`chosen`); the attribute
        `seconds` of ``bench`` how long all took.
    """
    result, began, chosen = Result("bench", "Speed against error"), time.monotonic(), list(names)
    for place, name in enumerate(chosen):
        case = benchmark(name)
        own = sorted((*case.sizes, *case.full)) if full else case.sizes
        until = began + seconds - sum(BENCHMARKS[later].seconds for later in chosen[place + 1 :])
        told = partial(_told, tell, f"{place + 1} of {len(chosen)}: {name}")
        _add(result, name, case, _measured(name, case, (sizes or {}).get(name, own), told, clock, until))
    result.annotate("bench", clock=clock, seconds=time.monotonic() - began)
    return result


def _told(tell: Callable[[str], None], where: str, what: str) -> None:
    tell(f"{where}, {what}")


def _measured(
    name: str,
    case: Benchmark,
    sizes: Sequence[int],
    tell: Callable[[str], None],
    clock: str,
    until: float = math.inf,
) -> dict[str, list[Figure]]:
    """Measure all alternatives, size by size in turns; beyond the first size none is begun after `until`."""
    present = [each for each in case.alternatives if not each.missing()]
    figures: dict[str, list[Figure]] = {each.name: [] for each in present}
    with TemporaryDirectory() as folder, ExitStack() as stack:
        workers = {
            each.name: stack.enter_context(
                Process(
                    "dynid.bench.worker",
                    *(name, each.name, clock),
                    python=each.interpreter,
                    threads=1,
                    folder=folder,
                )
            )
            for each in present
        }
        for size in sizes:
            for each in present:
                if each.at(size):
                    tell(f"{case.size} {size:,}, {each.name}")
                    late = size > sizes[0] and time.monotonic() > until
                    answer = {"late": True} if late else workers[each.name].ask(size)
                    figures[each.name].append(Figure(size, **(answer or {"failed": "it ended"})))
    return figures


def _add(result: Result, name: str, case: Benchmark, figures: Mapping[str, list[Figure]]) -> None:
    numbers = {key: [row for row in rows if not (row.failed or row.late)] for key, rows in figures.items()}
    done = {key: rows for key, rows in numbers.items() if rows}
    if not done:
        raise NumericalError(
            f"no alternative of the benchmark {name} came to an end",
            remedy=_said(case, figures),
            names=(name,),
        )
    missing = (f"{each.name} ({each.missing()})" for each in case.alternatives if each.missing())
    said = {
        "failed": _said(case, figures),
        "late": _late(case, figures),
        "missing": "; ".join(missing),
        "chosen": "; ".join(of_benchmark(name)),
        "limits": "; ".join(limits(case, done)),
        "remark": case.remark,
    }
    if case.default is not None:
        said["beaten"] = "; ".join(beaten(case, case.default, done))
    group = f"bench/{name}"
    result.annotate(group, title=case.title, size=case.size, measure=case.measure, **said)
    front = pareto([figure for rows in done.values() for figure in rows])
    for each in case.alternatives:
        if each.name in done:
            _add_alternative(result, f"{group}/{each.name}", case, each, done[each.name], front)


def _add_alternative(
    result: Result, here: str, case: Benchmark, each: Alternative, rows: list[Figure], front: list[Figure]
) -> None:
    result.add_axis(f"{here}/size", [figure.size for figure in rows])
    for column, units in (("time", "s"), ("memory", "B"), ("error", "")):
        values = np.array([getattr(figure, column) for figure in rows], dtype=float)
        result.add(f"{here}/{column}", values, ("size",), units)
    taken = [case.default is not None and case.default(figure.size) == each.name for figure in rows]
    result.add(f"{here}/pareto", np.array([figure in front for figure in rows]), ("size",))
    result.add(f"{here}/default", np.array(taken), ("size",))
    power = exponent(rows)
    result.annotate(here, peer=each.peer, **({} if power is None else {"exponent": power}))


def _said(case: Benchmark, figures: Mapping[str, list[Figure]]) -> str:
    """Say what failed, and at which size."""
    return "; ".join(
        f"{name} at {case.size} {row.size:,}: {row.failed}"
        for name, rows in figures.items()
        for row in rows
        if row.failed
    )


def _late(case: Benchmark, figures: Mapping[str, list[Figure]]) -> str:
    """Say what was left out for time, size by size."""
    late = sorted((row.size, name) for name, rows in figures.items() for row in rows if row.late)
    sizes = groupby(late, key=lambda each: each[0])
    return "; ".join(f"{case.size} {size:,}: {', '.join(name for _, name in some)}" for size, some in sizes)


def pareto(figures: Iterable[Figure]) -> list[Figure]:
    """Return the figures that no other of the same size beats in time and error."""
    rows = list(figures)
    return [
        row
        for row in rows
        if not any(
            other.size == row.size
            and (other.time, other.error) != (row.time, row.error)
            and other.time <= row.time
            and other.error <= row.error
            for other in rows
        )
    ]


def beaten(case: Benchmark, chosen: Callable[[int], str], done: Mapping[str, list[Figure]]) -> list[str]:
    """Say which peers are both faster and more accurate than what the suite chooses, and at which size."""
    peers = [each.name for each in case.alternatives if each.peer and each.name in done]
    sizes = sorted({row.size for rows in done.values() for row in rows})
    said = []
    for size in sizes:
        at = {name: row for name, rows in done.items() for row in rows if row.size == size}
        default = at.get(chosen(size))
        if default is None:
            said.append(f"at {case.size} {size:,} the default has no figures")
            continue
        said += [
            f"at {case.size} {size:,} by {name} ({default.time / at[name].time:.2g} times faster)"
            for name in peers
            if name in at and at[name].time < default.time and at[name].error < default.error
        ]
    return said


def limits(case: Benchmark, done: Mapping[str, list[Figure]]) -> list[str]:
    """Say how long alternatives take beside those that they are held to."""
    return [
        f"{limit.alternative} takes {ratio:.2f} times {limit.of} (at most {limit.most:g})"
        for limit in case.limits
        if limit.alternative in done and limit.of in done
        for ratio in [done[limit.alternative][-1].time / done[limit.of][-1].time]
    ]


def exponent(rows: Sequence[Figure]) -> float | None:
    """Return the power of the size by which time grows between the two largest; None where there is one."""
    if len(rows) < 2 or rows[-1].size <= rows[-2].size:
        return None
    return math.log(rows[-1].time / rows[-2].time) / math.log(rows[-1].size / rows[-2].size)
