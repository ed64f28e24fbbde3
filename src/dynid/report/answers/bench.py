"""What benchmarks say: a table each, what nothing beats marked."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from dynid.numerals import memory_text, time_text
from dynid.report.answers.blocks import Block, Grid, Note, Part
from dynid.result import Result

_SAID = {
    "limits": "held to",
    "failed": "failed",
    "late": "left out for time (--full measures it)",
    "missing": "missing",
    "chosen": "chosen by default",
    "remark": "not shown",
}


def method(result: Result) -> str:
    """Name the kind of result."""
    clock = "processor " * (result.group_attrs["bench"]["clock"] == "processor")
    return f"median {clock}times; ● nothing is both faster and more accurate; › the suite's default"


def parts(result: Result) -> Iterator[Part]:
    """Yield a part for each benchmark."""
    for group in dict.fromkeys("/".join(path.split("/")[:2]) for path in result if path.startswith("bench/")):
        yield Part(group.partition("/")[2], tuple(_benchmark(result, group)))


def _benchmark(result: Result, group: str) -> Iterator[Block]:
    about = result.group_attrs[group]
    names = list(dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/")))
    every = sorted((row for name in names for row in rows_of(result, group, name)), key=lambda row: row.size)
    rows = [
        (
            row.name,
            f"{row.size:,}",
            time_text(row.time),
            memory_text(row.memory),
            f"{row.error:.1e}",
            row.marks,
        )
        for row in every
    ]
    marked = frozenset(place for place, row in enumerate(every) if row.best)
    heads = ("", str(about["size"]), "time", "memory", "error", "")
    yield Grid(heads, tuple(rows), marked, str(about["title"]))
    yield Note("● nothing is both faster and more accurate; › the suite's default.")
    for said, text in notes(result, group):
        yield Note(f"{said}: {text}", "bad" if said == "failed" else "")


class Row(NamedTuple):
    """What was measured of an alternative at a size; `best`: nothing beats it, `default`: what is chosen."""

    size: int
    name: str
    time: float
    memory: float
    error: float
    best: bool
    default: bool

    @property
    def marks(self) -> str:
        """Both, as signs."""
        return "›" * self.default + "●" * self.best


def rows_of(result: Result, group: str, name: str) -> Iterator[Row]:
    """Yield the rows of an alternative."""
    columns = [result[f"{group}/{name}/{c}"].data for c in ("size", *Row._fields[2:5], "pareto", "default")]
    for size, time, memory, error, best, default in zip(*columns, strict=True):
        yield Row(int(size), name, float(time), float(memory), float(error), bool(best), bool(default))


def verdict(result: Result, group: str) -> str:
    """Say which peers are faster and more accurate than the default, at which size, or which ones are not."""
    names = sorted({path.split("/")[2] for path in result if path.startswith(f"{group}/")})
    peers = [name for name in names if result.group_attrs[f"{group}/{name}"].get("peer")]
    none = f"none of {', '.join(peers)}" if peers else "none; no peer took part"
    return str(result.group_attrs[group]["beaten"] or none)


def notes(result: Result, group: str) -> Iterator[tuple[str, str]]:
    """Yield what is to be said of a benchmark beside its table: about what, and the text."""
    about = result.group_attrs[group]
    yield "error", str(about["measure"])
    names = dict.fromkeys(path.split("/")[2] for path in result if path.startswith(f"{group}/"))
    attributes = {name: result.group_attrs[f"{group}/{name}"] for name in names}
    powers = [f"{name} {given['exponent']:.2f}" for name, given in attributes.items() if "exponent" in given]
    if powers:
        yield f"time grows with {about['size']} to the power of", ", ".join(powers)
    if "beaten" in about:
        yield "peers faster and more accurate than the default", verdict(result, group)
    for word, said in _SAID.items():
        if about.get(word):
            yield said, str(about[word])
