"""`dynid study`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import click

from dynid.errors import UsageError

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.study.executors import Crew
    from dynid.study.plan import Plan


def _shard(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Read I/N: the Ith of N parts, from 1."""
    if value is None:
        return None
    index, slash, count = value.partition("/")
    if not (slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        said = f"'{value}' is no shard; write I/N with I from 1 to N, such as 1/4"
        raise click.BadParameter(said, ctx, param)
    return int(index), int(count)


@click.command()
@click.argument("study", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="The HDF5 file to write; default ./<study>.h5.")
@click.option(
    "--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Set a value of the study; repeatable."
)
@click.option(
    "--executor",
    type=click.Choice(["serial", "processes", "dask"]),
    help="What runs samples; default processes, or dask where a scheduler is named.",
)
@click.option(
    "--workers", type=click.IntRange(1, 100_000), metavar="N", help="How many processes; default one a core."
)
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, such as tcp://host:8786.")
@click.option("--scheduler-file", type=click.Path(), help="The file of a Dask scheduler's address.")
@click.option("--shard", metavar="I/N", callback=_shard, help="Run the Ith of N parts only, for job arrays.")
@click.option(
    "--max-failures", type=click.IntRange(0), metavar="N", help="Stop when more samples fail (exit code 3)."
)
@click.option("--retry-failed", is_flag=True, help="Run samples again that failed before.")
@click.option("--junit", type=click.Path(), help="Write the study's expectations' outcome as JUnit XML.")
@click.option("--report", type=click.Path(), help="Write the page of the study to this HTML file.")
@click.option("--dry-run", is_flag=True, help="Show the plan and its size, and run nothing.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def study(
    study: str,
    output: str | None,
    overrides: tuple[str, ...],
    executor: str | None,
    workers: int | None,
    scheduler: str | None,
    scheduler_file: str | None,
    shard: tuple[int, int] | None,
    max_failures: int | None,
    retry_failed: bool,
    junit: str | None,
    report: str | None,
    dry_run: bool,
    quiet: bool,
) -> int:
    """Run a parameter study and write one HDF5 file; where it was interrupted, go on.

    Every finished sample is safe at once, in FILE.h5.journal, whatever happens next. A sample that fails is
    a row of the file with its error. Exit code 1 says that an expectation of the study's statistics failed;
    those of the scene are counted for each sample. At length: dynid help studies

    \b
    Examples:
      dynid study tolerances.yaml --dry-run
      dynid study tolerances.yaml --workers 4
      dynid study tolerances.yaml --shard 3/10
    """  # noqa: D301 - click's mark against wrapping
    from dynid.scene.load import load_scene
    from dynid.study.plan import make_plan

    part = shard is not None and shard[1] > 1
    if junit and part:
        raise UsageError(
            "the expectations of a study are of all its samples, not of a shard",
            remedy="Merge the shards, and run the study again on that file: nothing is computed then.",
        )
    loaded = load_scene(study, overrides)
    plan = make_plan(loaded)
    target = output or default_target(study, shard)
    _refuse_outputs(plan, study, target, junit, report)
    if dry_run:
        _show_plan(plan, target, shard)
        return 0
    from dynid.study.executors import hire

    started = time.perf_counter()
    crew = hire(executor, workers, scheduler, scheduler_file)
    limits: Limits = {"shard": shard, "max_failures": max_failures, "retry_failed": retry_failed}
    if ended := _run(plan, target, crew, quiet, limits):
        _say_how_to_go_on(study, output, shard)
        return ended
    if report:
        _write_page(target, report)
    if not quiet:
        _show_end(plan, target, started)
    return 0 if part else _check(loaded, target, junit, quiet)


def _refuse_outputs(plan: Plan, study: str, target: str, junit: str | None, report: str | None) -> None:
    """Refuse files that cannot be written, or that would overwrite the study or its scene."""
    from dynid.cli.run import refuse_missing_folders, refuse_overwriting

    for scene in (study, plan.base.source.file):
        refuse_overwriting(scene, target, junit, report)
    refuse_missing_folders(target, junit, report)


def _say_how_to_go_on(study: str, output: str | None, shard: tuple[int, int] | None) -> None:
    again = f"dynid study {study}{f' -o {output}' if output else ''}"
    again += f" --shard {shard[0]}/{shard[1]}" if shard else ""
    click.echo(f"interrupted; what is finished is safe. Go on with: {again}", err=True)


class Limits(TypedDict):
    """Which samples are run, and when it is enough."""

    shard: tuple[int, int] | None
    max_failures: int | None
    retry_failed: bool


def _run(plan: Plan, target: str, crew: Crew, quiet: bool, limits: Limits) -> int:
    """Run the samples; return the exit code of an interruption, or 0."""
    from dynid.cli.study_progress import showing
    from dynid.store.interrupts import Terminated, terminations
    from dynid.study.execute import run_study

    try:
        with terminations(), showing(quiet) as progress:
            run_study(plan, target, crew, report=progress, **limits)
    except KeyboardInterrupt as end:
        return 143 if isinstance(end, Terminated) else 130
    return 0


def _check(study: Scene, target: str, junit: str | None, quiet: bool) -> int:
    from dynid.cli.expectations import check, tell
    from dynid.store import open_stored

    with open_stored(target) as result:
        return tell(study, check(study, result, junit), quiet)


def _write_page(target: str, report: str) -> None:
    from dynid.cli.report import write_page
    from dynid.store import open_stored

    with open_stored(target) as result:
        write_page(result, report)


def default_target(study: str, shard: tuple[int, int] | None) -> str:
    """Return the name of the file of a study, or of a shard of it."""
    part = f"-{shard[0]}-of-{shard[1]}" if shard else ""
    return f"{Path(study).stem}{part}.h5"


def _show_plan(plan: Plan, target: str, shard: tuple[int, int] | None) -> None:
    from dynid.cli.summary.study_plan import lines
    from dynid.study.execute import shard_of, valid_samples

    numbers = shard_of(plan, shard)
    click.echo("\n".join(lines(plan, numbers, valid_samples(plan, target, shard), target)))


def _show_end(plan: Plan, target: str, started: float) -> None:
    from dynid.cli.summary import summary
    from dynid.scene.batch import why_alone
    from dynid.store import open_stored

    with open_stored(target) as result:
        click.echo(summary(result, f"{time.perf_counter() - started:.2g} s"))
    if plan.size > 1 and (reason := why_alone(plan.base, plan.settings, plan.collect, plan.size)):
        click.echo(f"\n  samples were run one by one: {reason}")
    click.echo(f"\n  wrote {target}")
