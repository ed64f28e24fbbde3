"""Write docs/accuracy.md, speed against error of all benchmarks: `accuracy.py [FOLDER | FILE.h5…]`.

It measures all benchmarks at all sizes, by the processor's clock, each into a file of its own in the
folder, by default a new one. What a folder has already is not measured again: name it to go on after an
interruption. With files it writes what `dynid bench -o FILE.h5` wrote. The measurements go to
docs/accuracy.json, from which the site's build draws the plots (`accuracy.py --pictures`).
Exit code 1: not all benchmarks are on the page.
"""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
import traceback
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
#: What the hard cases of each half are about.
SUBJECTS = {
    "frequency": "bond graphs",
    "structure": "structures",
    "identification": "identification",
    "long run": "long runs",
}
#: Exponent below which a time does not grow.
CONSTANT = 0.05
sys.path.insert(0, str(HERE.parent))
os.environ["PYTHONPATH"] = str(HERE.parent)  # workers find the peers of `benchmarks/`
if "DYNID_PEERS" in os.environ:
    os.environ["DYNID_PEER_MODULE"] = "benchmarks.peers"

from dynid.bench import BENCHMARKS, run_benchmarks  # noqa: E402
from dynid.bench.suite import machine  # noqa: E402
from dynid.defaults import CHOICES  # noqa: E402
from dynid.number_format import memory_text  # noqa: E402
from dynid.report import figures  # noqa: E402
from dynid.report.content.bench import BenchmarkRow, benchmark_rows, better_peers, remarks  # noqa: E402
from dynid.result import Result  # noqa: E402
from dynid.store import read_result, write_result  # noqa: E402
from tests.hard.catalogue import HALVES, cases  # noqa: E402

PAGE = """\
# Speed against error

Written by `python docs/accuracy.py`; `dynid bench` measures every number. The alternatives of a benchmark
do the same work in turns, each in its own process with one thread. Times are medians of the {clock}
clock, as multiples of the time of dynid's default at that size, or where there is none of the first row;
memory is the rise of the peak, errors are against exact or high-precision references. ●
Pareto-optimal: nothing of the same size is both faster and more accurate; › default of dynid.

Measured on {machine}.

## In short

{short}

## Defaults and the tables that justify them

{choices}

## Hard cases

{hard}; source, bound and error of each are in [Hard cases](hard_cases.md).

{benchmarks}
"""


def table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    lines = [list(heads), *(list(row) for row in rows)]
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines)


def names_of(result: Result, group: str) -> list[str]:
    """Return the alternatives that have figures."""
    return list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))


def by_size(result: Result, group: str) -> list[BenchmarkRow]:
    """Return all rows of a benchmark, by size."""
    every = [row for name in names_of(result, group) for row in benchmark_rows(result, group, name)]
    return sorted(every, key=lambda row: row.size)


def power(size: str, exponent: float) -> str:
    """Return how a time grows with a size."""
    return f"{size}<sup>{exponent:.2f}</sup>" if abs(exponent) >= CONSTANT else f"not with the {size}"


def raised(page: str) -> str:
    """Return a page with superscripts in place of `^`."""
    return re.sub(r"(?<=[\w)])\^(-?\d[\d.]*)", r"<sup>\1</sup>", page)


def link(benchmark: str) -> str:
    """Return a link to the part of a benchmark."""
    return f"[{benchmark}](#{benchmark})"


def summary(result: Result, group: str) -> list[str]:
    """Return benchmark, how the default's time grows, whether it is on the front, and who beats it."""
    about, rows = result.group_attrs[group], by_size(result, group)
    chosen = [row for row in rows if row.default]
    off = [f"{row.size:,}" for row in chosen if not row.best]
    last = chosen[-1].name if chosen else names_of(result, group)[0]
    grows = result.group_attrs[f"{group}/{last}"].get("exponent")
    name = group.partition("/")[2]
    return [
        link(name),
        ", ".join(dict.fromkeys(row.name for row in chosen)) or "-",
        power(str(about["size"]), grows) if grows is not None else "-",
        ("always" if not off else f"not at {', '.join(off)}") if chosen else "-",
        better_peers(result, group) if "beaten" in about else "-",
    ]


def section(result: Result, group: str) -> Iterator[str]:
    """Yield the part of a benchmark."""
    about, name = result.group_attrs[group], group.partition("/")[2]
    yield f"## {name}\n\n{about['title']}.\n"
    for figure in figures(result):
        if figure.name.startswith(f"bench-{name}-"):
            yield f"![{figure.title}](accuracy/{figure.name}.svg)\n"
    rows = []
    for size, some in groupby(by_size(result, group), key=lambda row: row.size):
        each = list(some)
        unit = next((row.time for row in each if row.default), each[0].time)
        for place, row in enumerate(each):
            ratio = row.time / unit
            time = f"{ratio:,.0f}" if ratio >= 10 else f"{ratio:.2g}"
            measured = (time, memory_text(row.memory), f"{row.error:.1e}", row.marks)
            rows.append((f"{size:,}" if place == 0 else "", row.name, *measured))
    yield table((str(about["size"]), "", "time, relative", "memory", "error", ""), rows) + "\n"
    yield "\n".join(f"- {said}: {text}" for said, text in remarks(result, group)) + "\n"


#: Arrays of an alternative that its figures need.
COLUMNS = {"time": "s", "memory": "B", "error": "", "pareto": "", "default": ""}


def as_data(result: Result, group: str) -> dict[str, Any]:
    """Return the measurements of a benchmark as JSON has them."""
    alternatives = {
        name: {
            "attrs": result.group_attrs[f"{group}/{name}"],
            **{column: result[f"{group}/{name}/{column}"].data.tolist() for column in ("size", *COLUMNS)},
        }
        for name in names_of(result, group)
    }
    return {"attrs": result.group_attrs[group], "alternatives": alternatives}


def draw() -> None:
    """Draw the plots from the measurements that are kept."""
    result = Result("bench", "")
    for name, benchmark in json.loads((HERE / "accuracy.json").read_text(encoding="utf-8")).items():
        result.annotate(f"bench/{name}", **benchmark["attrs"])
        for alternative, columns in benchmark["alternatives"].items():
            group = f"bench/{name}/{alternative}"
            result.annotate(group, **columns["attrs"])
            result.add_axis(f"{group}/size", columns["size"])
            for column, unit in COLUMNS.items():
                result.add(f"{group}/{column}", np.array(columns[column]), ("size",), unit)
    (HERE / "accuracy").mkdir(exist_ok=True)
    for figure in figures(result):
        (HERE / "accuracy" / f"{figure.name}.svg").write_text(figure.svg, encoding="utf-8")


def measured(folder: Path) -> Iterator[Path]:
    """Yield the files of all benchmarks, measured now where they are not there; one that fails is told."""
    folder.mkdir(parents=True, exist_ok=True)
    print(f"the figures go to {folder}")
    for name in BENCHMARKS:
        file = folder / f"{name}.h5"
        try:
            if not file.exists():
                write_result(run_benchmarks([name], full=True, clock="processor", progress=print), file)
            yield file
        except Exception:
            traceback.print_exc()


def main() -> int:
    """Measure or read, and write the page; or draw its plots alone."""
    if sys.argv[1:] == ["--pictures"]:
        draw()
        return 0
    given = [Path(name) for name in sys.argv[1:]]
    if given and given[0].suffix == ".h5":
        files = given
    else:
        files = list(measured(given[0] if given else Path(tempfile.mkdtemp(prefix="accuracy-"))))
    results = [read_result(file) for file in files]
    if not results:
        return 1
    found = {
        f"bench/{name}": each
        for name in BENCHMARKS
        for each in results
        if f"bench/{name}" in each.group_attrs
    }
    heads = ("benchmark", "default", "its time grows as", "on the front", "peers faster and more accurate")
    counts = [f"{sum(case.half == half for case in cases())} on {SUBJECTS[half]}" for half in HALVES]
    page = PAGE.format(
        clock=results[0].group_attrs["bench"]["clock"],
        machine=machine(),
        short=table(heads, (summary(result, group) for group, result in found.items())),
        choices=table(
            ("choice", "value", "in words", "benchmark"),
            (
                (
                    f"`{name}`",
                    str(c.value),
                    c.sentence.format(value=c.value),
                    link(c.benchmark) if f"bench/{c.benchmark}" in found else c.benchmark,
                )
                for name, c in CHOICES.items()
            ),
        ),
        hard=f"There are {len(cases())}: {', '.join(counts)}",
        benchmarks="\n".join(part for group, result in found.items() for part in section(result, group)),
    )
    (HERE / "accuracy.md").write_text(raised(page.rstrip()) + "\n", encoding="utf-8")
    data = {group.partition("/")[2]: as_data(result, group) for group, result in found.items()}
    lines = (f" {json.dumps(name)}: {json.dumps(each, ensure_ascii=False)}" for name, each in data.items())
    (HERE / "accuracy.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    draw()
    absent = [name for name in BENCHMARKS if f"bench/{name}" not in found]
    if absent:
        print(f"not on the page: {', '.join(absent)}", file=sys.stderr)
    return 1 if absent else 0


if __name__ == "__main__":
    sys.exit(main())
