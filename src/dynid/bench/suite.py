"""Running benchmarks: one process an alternative, in turns, and the figures as a `Result`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.bench.alternative import Benchmark
from dynid.bench.catalogue import benchmark
from dynid.bench.process import Process
from dynid.choices import of_benchmark
from dynid.errors import NumericalError
from dynid.result import Result


@dataclass(frozen=True)
class Figure:
    """What was measured of one alternative at one size; `failed` says why there are no numbers."""

    size: int
    time: float = 0.0
    memory: float = 0.0
    error: float = 0.0
    failed: str = ""


def run_benchmarks(
    names: Iterable[str],
    sizes: Mapping[str, Sequence[int]] | None = None,
    tell: Callable[[str], None] = lambda _: None,
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

    Returns
    -------
    Result
        ``bench/<name>/<alternative>/{size, time, memory, error}``: s, bytes, and what the attribute `measure`
        of ``bench/<name>`` says; `pareto` marks what no other alternative beats in both time and error.
        Alternatives that are missing or failed are named in the attributes `missing` and `failed`.
    """
    result = Result("bench", "Speed against error")
    for name in names:
        case = benchmark(name)
        _add(result, name, case, _measured(name, case, (sizes or {}).get(name, case.sizes), tell))
    return result


def _measured(
    name: str, case: Benchmark, sizes: Sequence[int], tell: Callable[[str], None]
) -> dict[str, list[Figure]]:
    """Measure all alternatives, size by size in turns."""
    present = [each for each in case.alternatives if not each.missing()]
    workers = {
        each.name: Process("dynid.bench.worker", name, each.name, python=each.interpreter) for each in present
    }
    figures: dict[str, list[Figure]] = {each.name: [] for each in present}
    try:
        for size in sizes:
            for each in present:
                if each.most is None or size <= each.most:
                    tell(f"{name}: {each.name}, {case.size} {size:,}")
                    answer = workers[each.name].ask(size) or {"failed": "it ended"}
                    figures[each.name].append(Figure(size, **answer))
    finally:
        for worker in workers.values():
            worker.close()
    return figures


def _add(result: Result, name: str, case: Benchmark, figures: Mapping[str, list[Figure]]) -> None:
    done = {key: [figure for figure in rows if not figure.failed] for key, rows in figures.items()}
    if not any(done.values()):
        raise NumericalError(
            f"no alternative of the benchmark {name} came to an end",
            remedy=_said(case, figures),
            names=(name,),
        )
    group = f"bench/{name}"
    result.annotate(
        group, title=case.title, size=case.size, measure=case.measure, failed=_said(case, figures)
    )
    result.annotate(group, chosen="; ".join(of_benchmark(name)))
    result.annotate(
        group, missing="; ".join(f"{e.name} ({e.missing()})" for e in case.alternatives if e.missing())
    )
    front = pareto([figure for rows in done.values() for figure in rows])
    for alternative, rows in done.items():
        if not rows:
            continue
        here = f"{group}/{alternative}"
        result.add_axis(f"{here}/size", [figure.size for figure in rows])
        for column, units in (("time", "s"), ("memory", "B"), ("error", "")):
            values = np.array([getattr(figure, column) for figure in rows], dtype=float)
            result.add(f"{here}/{column}", values, ("size",), units)
        result.add(f"{here}/pareto", np.array([figure in front for figure in rows]), ("size",))


def _said(case: Benchmark, figures: Mapping[str, list[Figure]]) -> str:
    """Say what failed, and at which size."""
    return "; ".join(
        f"{name} at {case.size} {row.size:,}: {row.failed}"
        for name, rows in figures.items()
        for row in rows
        if row.failed
    )


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
