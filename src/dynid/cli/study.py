"""`dynid study`, `dynid study-merge` and `dynid study-worst`."""

from __future__ import annotations

import shlex
import time
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import click
from click.core import ParameterSource

from dynid.cli.foreign import reads_results
from dynid.errors import UsageError

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.study.analysis.worst import Direction
    from dynid.study.executors import StudyExecutor
    from dynid.study.plan import Plan

_LONGEST = 1e6  # s that a sample may be given: more than a week


def _shard(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Read I/N: the Ith of N parts, from 1."""
    if value is None:
        return None
    index, slash, count = value.partition("/")
    if not (slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        said = f"'{value}' is no shard; write I/N with I from 1 to N, such as 1/4"
        raise click.BadParameter(said, ctx, param)
    return int(index), int(count)


def _seconds(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not 0 < value <= _LONGEST:
        said = f"{value:g} is no time limit; give seconds above 0, at most {_LONGEST:g}"
        raise click.BadParameter(said, ctx, param)
    return value


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
@click.option(
    "--sample-timeout",
    type=float,
    metavar="SECONDS",
    callback=_seconds,
    help="End a sample that takes longer; it is a failed row then.",
)
@click.option(
    "--force", is_flag=True, help="Discard finished samples of the file that are not of this study."
)
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
    sample_timeout: float | None,
    force: bool,
    junit: str | None,
    report: str | None,
    dry_run: bool,
    quiet: bool,
) -> int:
    """Run a parameter study and write one HDF5 file; where it was interrupted, go on.

    Every finished sample is safe at once, in FILE.h5.journal, whatever happens next. A sample that fails is
    a row of the file with its error, also one that exceeds --sample-timeout. A file that holds finished
    samples of another study is not replaced without --force. Exit code 1 says that an expectation of the
    study's statistics failed; those of the scene are counted for each sample. At length: dynid help studies

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
    from dynid.study.executors import make_executor

    started = time.perf_counter()
    pool = make_executor(executor, workers, scheduler, scheduler_file, sample_timeout)
    limits: Limits = {
        "shard": shard,
        "max_failures": max_failures,
        "retry_failed": retry_failed,
        "force": force,
    }
    if ended := _run(plan, target, pool, quiet, limits):
        click.echo(f"interrupted; what is finished is safe. Go on with: {_same_command()}", err=True)
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


def _same_command() -> str:
    """Return this command as a shell takes it, with all that changes samples or how they are run.

    What was discarded with --force is gone already.
    """
    context = click.get_current_context()
    words = ["dynid", "study"]
    for parameter in context.command.params:
        if context.get_parameter_source(str(parameter.name)) != ParameterSource.COMMANDLINE:
            continue
        value = context.params[str(parameter.name)]
        if isinstance(parameter, click.Argument):
            words.append(value)
        elif parameter.name == "shard":
            words += ["--shard", f"{value[0]}/{value[1]}"]
        elif isinstance(parameter, click.Option) and parameter.is_flag:
            words += [parameter.opts[0]] * (parameter.name != "force")
        else:
            for one in value if parameter.multiple else [value]:
                words += [parameter.opts[0], f"{one:g}" if isinstance(one, float) else str(one)]
    return shlex.join(words)


class Limits(TypedDict):
    """Selection of samples to run, and the condition to stop."""

    shard: tuple[int, int] | None
    max_failures: int | None
    retry_failed: bool
    force: bool


def _run(plan: Plan, target: str, pool: StudyExecutor, quiet: bool, limits: Limits) -> int:
    """Run the samples; return the exit code of an interruption, or 0."""
    from dynid.cli.study_progress import noticing, showing
    from dynid.store.interrupts import Terminated, terminations
    from dynid.study.execute import run_study

    try:
        with terminations(), showing(quiet) as report:
            notice = noticing(plan.study.source.file, report)
            run_study(plan, target, pool, report=report, notice=notice, **limits)
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
    from dynid.study.execute import foreign_samples, shard_of, valid_samples
    from dynid.study.keys import sample_keys

    numbers = shard_of(plan, shard)
    foreign = foreign_samples(target, sample_keys(plan, numbers))
    click.echo("\n".join(lines(plan, numbers, valid_samples(plan, target, shard), target, foreign)))


def _show_end(plan: Plan, target: str, started: float) -> None:
    from dynid.cli.summary import summary
    from dynid.scene.batch import why_alone
    from dynid.store import open_stored

    with open_stored(target) as result:
        click.echo(summary(result, f"{time.perf_counter() - started:.2g} s"))
    if plan.size > 1 and (reason := why_alone(plan.base, plan.settings, plan.collect, plan.size)):
        click.echo(f"\n  samples were run one by one: {reason}")
    click.echo(f"\n  wrote {target}")


@click.command("study-merge")
@click.argument("files", nargs=-1, required=True, type=click.Path())
@click.option("-o", "--output", required=True, type=click.Path(), help="The HDF5 file to write.")
@click.option("--partial", is_flag=True, help="Write the file also where samples are missing.")
@click.option(
    "--force", is_flag=True, help="Discard finished samples of the output that are in none of the files."
)
@reads_results("files")
def study_merge(files: tuple[str, ...], output: str, partial: bool, force: bool) -> int:
    """Put the shards of a study (dynid study --shard I/N) into one file.

    The file is the same as if the study had been run in one piece. A file that holds other finished samples
    is not replaced without --force.
    """
    from dynid.cli.run import refuse_missing_folders
    from dynid.study.merge import merge_studies

    refuse_missing_folders(output)
    count = merge_studies(files, output, partial, force=force)
    click.echo(f"wrote {output}: {count} samples of {len(files)} file{'s' if len(files) > 1 else ''}")
    return 0


@click.command()
@click.argument("file", type=click.Path())
@click.argument("path")
@click.option("-o", "--output", type=click.Path(), required=True, help="The scene to write.")
@click.option("--max", "direction", flag_value="max", default=True, help="The largest is worst (default).")
@click.option("--min", "direction", flag_value="min", help="The smallest is worst.")
@click.option("--abs", "direction", flag_value="abs", help="What is farthest from 0 is worst.")
@reads_results("file")
def study_worst(file: str, path: str, output: str, direction: Direction) -> int:
    """Write the scene of the worst sample of a study, to be run alone.

    PATH is what is judged: a number that the study gathered, as in study/results, an array of them, or one
    entry of it as PATH[LABEL].
    """
    from dynid.cli.run import is_same, refuse_missing_folders
    from dynid.errors import UsageError
    from dynid.file_access import replace_file
    from dynid.store import open_stored
    from dynid.study.worst import worst_scene

    if is_same(output, file):
        raise UsageError(f"the scene would overwrite the study {file}", remedy="Name another file with -o.")
    refuse_missing_folders(output)
    chosen = "" if direction == "max" else f" --{direction}"
    command = f"dynid study-worst {Path(file).name} {path}{chosen}"
    with open_stored(file, partial=True) as result:
        text = worst_scene(result, path, direction, Path(output).parent, command)
    replace_file(output, text.encode())
    click.echo("\n".join(line[2:] for line in text.splitlines()[:1]))
    click.echo(f"wrote {output}; run it with: dynid run {output}")
    return 0
