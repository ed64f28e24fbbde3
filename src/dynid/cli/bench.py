"""`dynid bench`."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from pathlib import Path

import click

from dynid.cli.completion import among
from dynid.cli.progress import showing
from dynid.errors import UsageError


def _benchmarks() -> Iterable[str]:
    from dynid.bench import BENCHMARKS

    return BENCHMARKS


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...", shell_complete=among(_benchmarks))
@click.option("-o", "--output", type=click.Path(), help="Write the figures to this HDF5 file.")
@click.option("--report", type=click.Path(), help="Write the tables and work-precision plots to this page.")
@click.option(
    "--size", "sizes", multiple=True, metavar="NAME=N,N", help="Sizes of a benchmark instead of its own."
)
@click.option(
    "--clock",
    type=click.Choice(["wall", "processor"]),
    default="wall",
    help="What time is; other work on the machine changes processor time little.",
)
@click.option("--full", is_flag=True, help="Larger sizes too, however long they take.")
@click.option("--list", "listing", is_flag=True, help="List the benchmarks.")
def bench(
    names: tuple[str, ...],
    output: str | None,
    report: str | None,
    sizes: tuple[str, ...],
    clock: str,
    full: bool,
    listing: bool,
) -> int:
    """Measure speed against error, now, on this machine.

    Each NAME runs its alternatives on the same work in one go: median time, peak memory, and error against an
    exact or high-precision reference; what no other beats in both time and error is marked. Without a NAME
    all of them run, for at most three minutes: what does not fit is left out, and named. With --full, or with
    sizes of your own, they take the time they need.

    \b
    Examples:
      dynid bench --list
      dynid bench zeros-poles --size zeros-poles=20,100
    """  # noqa: D301 - click's mark against wrapping
    from dynid.bench import BENCHMARKS, DEFAULT_RUN, benchmark, run_benchmarks
    from dynid.cli.summary import summary

    if listing:
        width = max(map(len, BENCHMARKS))
        for name in BENCHMARKS:
            click.echo(f"  {name:{width}}  {benchmark(name).title}")
        return 0
    chosen = [_known(name, BENCHMARKS) for name in names] or list(BENCHMARKS)
    own, seconds = _sizes(sizes, BENCHMARKS), math.inf if full or sizes else DEFAULT_RUN
    with showing() as tell:
        result = run_benchmarks(dict.fromkeys(chosen), own, tell, full=full, clock=clock, seconds=seconds)
    click.echo(summary(result, ""))
    if output:
        from dynid.store import write_result

        write_result(result, Path(output))
        click.echo(f"\n  wrote {output}")
    if report:
        from dynid.cli.report import write_page

        write_page(result, report)
        click.echo(f"  wrote {report}")
    return 0


def _known(name: str, known: Collection[str]) -> str:
    if name not in known:
        from dynid.suggestions import did_you_mean

        raise UsageError(
            f"there is no benchmark '{name}'{did_you_mean(name, known)}",
            remedy="List them with: dynid bench --list",
        )
    return name


def _sizes(given: tuple[str, ...], known: Collection[str]) -> dict[str, list[int]]:
    """Read NAME=N,N."""
    sizes: dict[str, list[int]] = {}
    for text in given:
        name, _, numbers = text.partition("=")
        parts = numbers.split(",")
        if not all(part.strip().isdecimal() and 0 < int(part) <= 10**9 for part in parts):
            raise UsageError(f"--size {text}: sizes are whole numbers", remedy="Write NAME=100,1000.")
        sizes[_known(name, known)] = sorted({int(part) for part in parts})
    return sizes
