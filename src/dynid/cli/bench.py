"""`dynid bench`."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import among, refuse_unknown
from dynid.cli.progress import showing
from dynid.errors import UsageError
from dynid.number_format import counted

if TYPE_CHECKING:
    from dynid.result import Result


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...", shell_complete=among("dynid.bench:BENCHMARKS"))
@click.option("-o", "--output", type=click.Path(), help="Write the measurements to this HDF5 file.")
@click.option(
    "--report", type=click.Path(), help="Write tables and work-precision diagrams to this HTML file."
)
@click.option(
    "--size",
    "sizes",
    multiple=True,
    metavar="NAME=N,N",
    help="Sizes of a benchmark instead of the default ones.",
)
@click.option(
    "--clock",
    type=click.Choice(["wall", "processor"]),
    default="wall",
    help="The time to measure; processor time depends little on other work of the machine.",
)
@click.option(
    "--against",
    "earlier",
    multiple=True,
    type=click.Path(),
    metavar="FILE",
    help="Compare with measurements of another version, by -o on this machine; may be repeated.",
)
@click.option("--full", is_flag=True, help="Run larger sizes, too, without a time limit.")
@click.option("--list", "listing", is_flag=True, help="List the benchmarks.")
def bench(
    names: tuple[str, ...],
    output: str | None,
    report: str | None,
    sizes: tuple[str, ...],
    clock: str,
    earlier: tuple[str, ...],
    full: bool,
    listing: bool,
) -> int:
    """Measure the speed and the error of the algorithms on this machine.

    Each benchmark NAME runs its alternatives on the same problem: median time, peak memory, and error against
    an exact or high-precision reference; the Pareto-optimal ones are marked. Without NAME all benchmarks
    but those of measured data run, for at most three minutes; those that do not fit are omitted and listed.
    With --full, or with other sizes, the time is not limited. The environment variable DYNID_DATA names the
    folder of measured data.

    With --against, changes of time, memory or error of more than 25 % are listed; the exit code is 1 if
    anything got worse. Of several files of one version, a change is one from each.

    \b
    Examples:
      dynid bench --list
      dynid bench zeros-poles --size zeros-poles=20,100
    """  # noqa: D301 - click's mark against wrapping
    from dynid.bench import BENCHMARKS, DEFAULT_RUN, benchmark, run_benchmarks
    from dynid.cli.screen import summary
    from dynid.cli.text import described

    if listing:
        click.echo("\n".join(described([(name, benchmark(name).title) for name in BENCHMARKS])))
        return 0
    own_sizes: dict[str, list[int]] = {}
    for text in sizes:
        name, _, numbers = text.partition("=")
        parts = numbers.split(",")
        if not all(part.strip().isdecimal() and 0 < int(part) <= 10**9 for part in parts):
            raise UsageError(f"--size {text}: sizes are whole numbers", remedy="Write NAME=100,1000.")
        own_sizes[name] = sorted({int(part) for part in parts})
    for name in (*names, *own_sizes):
        refuse_unknown(name, BENCHMARKS, "benchmark", "List them with: dynid bench --list")
    from dynid.store import read_result, write_result

    before = [read_result(name) for name in earlier]
    for name, one in zip(earlier, before, strict=True):
        if one.kind != "bench":
            raise UsageError(f"{name} is a result of kind {one.kind}, not of dynid bench")
        if (was := one.group_attrs["bench"]["clock"]) != clock:
            raise UsageError(f"{name} has times of the {was} clock", remedy=f"Add --clock {was}.")
    seconds = math.inf if full or sizes else DEFAULT_RUN
    chosen = dict.fromkeys(names or [name for name, entry in BENCHMARKS.items() if entry.seconds])
    with showing() as listener:
        result = run_benchmarks(chosen, own_sizes, listener, full=full, clock=clock, seconds=seconds)
    click.echo(summary(result, ""))
    if output:
        write_result(result, Path(output))
        click.echo(f"\n  wrote {output}")
    if report:
        from dynid.cli.results import write_page

        write_page(read_result(output) if output else result, report)  # stored, it has versions and date
        click.echo(f"  wrote {report}")
    return _compared(result, before) if before else 0


def _compared(result: Result, earlier: list[Result]) -> int:
    """Print the changes of the figures; return the exit code."""
    from dynid.bench.suite import changes
    from dynid.number_format import general, memory_text, time_text

    differences = changes(result, earlier)
    click.echo(f"\n  {counted(len(differences), 'change')} of more than 25 %")
    written: dict[str, Callable[[float], str]] = {"time": time_text, "memory": memory_text}
    written["error"] = partial(general, digits=2)
    for change in sorted(differences, key=lambda change: not change.worse):
        path, _, name = change.path.removeprefix("bench/").rpartition("/")
        was, now = written[name](change.before), written[name](change.value)
        click.echo(
            f"    {'worse ' if change.worse else 'better'}  {path} at {change.size:,}: {name} {was} -> {now}"
        )
    return int(any(change.worse for change in differences))
