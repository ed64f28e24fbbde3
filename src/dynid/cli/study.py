"""`dynid study`, `dynid study-merge` and `dynid study-worst`."""

from __future__ import annotations

import shlex
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from dynid.cli.arguments import (
    is_same,
    reads_results,
    refuse_missing_folders,
    refuse_overwriting,
    report_in_junit,
    set_option,
    writes_junit,
)
from dynid.errors import UsageError

if TYPE_CHECKING:
    from dynid.result import Result
    from dynid.study.analysis.sample_statistics import Direction
    from dynid.study.plan import Plan
    from dynid.study.scheduler import Notice

_TIME_LIMIT = 1e6  # longest time limit of a sample, s: more than a week
_MAX_LISTED_SAMPLES = 5  # most samples of a plan that are listed


def _shard(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Parse I/N: the Ith of N parts, counted from 1."""
    if value is None:
        return None
    index, slash, count = value.partition("/")
    if not (slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
        problem = f"'{value}' is no shard; write I/N with I from 1 to N, such as 1/4"
        raise click.BadParameter(problem, ctx, param)
    return int(index), int(count)


def _seconds(ctx: click.Context, param: click.Parameter, value: float | None) -> float | None:
    if value is not None and not 0 < value <= _TIME_LIMIT:
        problem = f"{value:g} is no time limit; give seconds above 0, at most {_TIME_LIMIT:g}"
        raise click.BadParameter(problem, ctx, param)
    return value


@click.command()
@click.argument("study", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="The HDF5 file to write; default ./<study>.h5.")
@set_option("study")
@click.option(
    "--executor",
    type=click.Choice(["serial", "processes", "dask"]),
    help="How samples are run; default processes where that is faster, or dask if a scheduler is named.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 100_000),
    metavar="N",
    help="Number of processes; default one per core.",
)
@click.option("--scheduler", metavar="ADDRESS", help="A Dask scheduler, such as tcp://host:8786.")
@click.option("--scheduler-file", type=click.Path(), help="The file with the address of a Dask scheduler.")
@click.option("--shard", metavar="I/N", callback=_shard, help="Run only the Ith of N parts, for job arrays.")
@click.option(
    "--max-failures",
    type=click.IntRange(0),
    metavar="N",
    help="Stop after more than N failed samples (exit code 3).",
)
@click.option("--retry-failed", is_flag=True, help="Run failed samples again.")
@click.option(
    "--sample-timeout",
    type=float,
    metavar="SECONDS",
    callback=_seconds,
    help="Abort a sample that takes longer; it counts as failed.",
)
@click.option("--force", is_flag=True, help="Overwrite a file with samples of another study.")
@click.option(
    "--junit", type=click.Path(), help="Write the outcome of the study's expectations as JUnit XML."
)
@click.option("--report", type=click.Path(), help="Also write an HTML report to this file.")
@click.option("--dry-run", is_flag=True, help="List the samples without running them.")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors and warnings.")
@writes_junit("study")
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
    """Run a parameter study and write one HDF5 file; running it again resumes an interrupted study.

    Every finished sample is stored at once in FILE.h5.journal, and survives a crash. A sample that fails or
    exceeds --sample-timeout is stored with its error message. A file that holds finished samples of
    another study is not replaced without --force. Exit code 1: an expectation of the study's statistics
    failed; those of the scene are counted for each sample. More: dynid help studies

    \b
    Examples:
      dynid study tolerances.yaml --dry-run
      dynid study tolerances.yaml --workers 4
      dynid study tolerances.yaml --shard 3/10
    """  # noqa: D301 - click's mark against wrapping
    from dynid.study.executors import make_executor

    pool = make_executor(executor, workers, scheduler, scheduler_file, sample_timeout)
    click.get_current_context().call_on_close(pool.dismiss)
    if not dry_run:
        pool.start()  # while the scene is read
    from dynid.scene.load import load_scene
    from dynid.study.plan import make_plan

    sharded = shard is not None and shard[1] > 1
    if junit and sharded:
        raise UsageError(
            "the expectations of a study are of all its samples, not of a shard",
            remedy="Merge the shards, and run the study again on that file: nothing is computed then.",
        )
    loaded = load_scene(study, overrides)
    plan = make_plan(loaded)
    target = output or f"{Path(study).stem}{f'-{shard[0]}-of-{shard[1]}' if shard else ''}.h5"
    for scene in (study, plan.base.source.file):
        refuse_overwriting(scene, target, junit, report)
    refuse_missing_folders(target, junit, report)
    if dry_run:
        from dynid.cli.text import folded
        from dynid.study.keys import sample_keys
        from dynid.study.run import foreign_samples, shard_of, valid_samples

        numbers = shard_of(plan, shard)
        foreign = foreign_samples(target, sample_keys(plan, numbers))
        settings = [word for value in overrides for word in ("--set", value)]
        explaining = shlex.join(["dynid", "check", study, "--explain", *settings])
        finished = valid_samples(plan, target, shard)
        lines = _plan_lines(plan, numbers, finished, target, foreign, explaining)
        click.echo("\n".join(sharded for line in lines for sharded in folded(line)))
        return 0
    from dynid.cli.progress import noticing, showing_study
    from dynid.cli.run import checked_expectations, report_expectations, warn_of_doubts
    from dynid.store import open_stored
    from dynid.store.files import Terminated, terminations
    from dynid.study.run import run_study

    warn_of_doubts(plan.base)
    started = time.perf_counter()
    try:
        with terminations(), showing_study(quiet) as listener:
            notice = noticing(plan.study.source.file, listener)
            run_study(
                plan, target, pool, shard=shard, max_failures=max_failures, retry_failed=retry_failed,
                force=force, report=listener, notice=notice,
            )  # fmt: skip
    except KeyboardInterrupt as end:
        if junit:
            report_in_junit(Path(junit), study, end)
        click.echo(f"interrupted; finished samples are stored. Resume with: {_same_command()}", err=True)
        return 143 if isinstance(end, Terminated) else 130
    with open_stored(target) as result:
        _warn_of_failure(result, notice, target)
        if report:
            from dynid.cli.results import write_page

            write_page(result, report)
        if not quiet:
            from dynid.cli.screen import summary
            from dynid.scene.batch import why_alone

            click.echo(summary(result, f"{time.perf_counter() - started:.2g} s"))
            if plan.size > 1 and (reason := why_alone(plan.base, plan.settings, plan.collect)):
                click.echo(f"\n  samples were run one by one: {reason}")
            more = f", {report}" if report else f" · see it: dynid report {target}"
            click.echo(f"\n  wrote {target}{more}")
        if sharded:
            return 0
        seconds = time.perf_counter() - started
        return report_expectations(loaded, checked_expectations(loaded, result, junit, seconds), quiet)


def _plan_lines(
    plan: Plan, numbers: Sequence[int], finished: int, target: str, foreign: int = 0, explaining: str = ""
) -> Iterator[str]:
    """Yield the screen of a plan: its size, sampling, outputs, varied inputs and first samples.

    Of the samples to run, so many are finished; `foreign` are those in the file to write that belong to no
    sample of the study; `explaining` is the command that estimates the time, which needs samples to be run.
    """
    import numpy as np

    from dynid.cli.text import aligned
    from dynid.number_format import counted
    from dynid.suggestions import short_paths

    method = plan.attrs["method"]
    yield f"{plan.study.title}: {counted(len(numbers), 'sample')} of {plan.attrs['base']} ({plan.base.kind})"
    yield f"  sampling  {method}" + (f", seed {plan.seed}" if method not in ("grid", "list") else "")
    if len(numbers) < plan.size:
        yield f"  shard     of {plan.size} samples, one in {plan.size // len(numbers)} or so"
    yield f"  collects  {', '.join(plan.collect) or 'every number under properties and parameters'}"
    yield f"  {target}: {finished} finished, {len(numbers) - finished} to run"
    if explaining and finished < len(numbers):
        yield f"  time      estimated from a few samples by: {explaining}"
    if foreign:
        verb = "does" if foreign == 1 else "do"
        yield f"  warning: {counted(foreign, 'finished sample')} of {target} {verb} not belong to this study,"
        yield "           and would be lost: write another file with -o, or discard them with --force"
    yield ""
    rows = [["", "values", "from", "to"]]
    for path, values in plan.arrays.items():
        different = np.unique(values)
        name = path if path in plan.settings else f"{path} (not set in the scene)"
        rows.append([name, str(len(different)), _value_text(different[0]), _value_text(different[-1])])
    yield from aligned(rows, "  ")
    yield ""
    samples = [
        [str(number), *(_value_text(values[number]) for values in plan.arrays.values())]
        for number in numbers[:_MAX_LISTED_SAMPLES]
    ]
    yield from aligned([["sample", *short_paths(list(plan.arrays))], *samples], "  ")
    if len(numbers) > _MAX_LISTED_SAMPLES:
        yield "  …"


def _value_text(value: Any) -> str:
    import numpy as np

    if isinstance(value, np.bool_):
        return str(value).lower()
    return f"{value:.6g}" if isinstance(value, np.floating) else str(value)


def _warn_of_failure(result: Result, notice: Notice, target: str) -> None:
    """Warn of a study whose samples all failed, which leaves the exit code at 0."""
    from dynid.number_format import counted
    from dynid.study.analysis.table import StudyTable, failures

    table = StudyTable(result)
    count = len(table.failed)
    if not count or table.done.any() or len(table.pending):
        return
    reasons = failures(table)
    share = "" if len(reasons) == 1 else f", {len(reasons[0].samples)} of them"
    notice(
        f"{'all ' * (count > 1)}{counted(count, 'sample')} failed{share}: {reasons[0].error.rstrip('.')}. "
        f"All reasons: dynid show {target}. Correct it and run the study again; with --max-failures 0, a "
        "failure is exit code 3."
    )


def _same_command() -> str:
    """Return the command line of this call, quoted for a shell, without --force (which has been applied)."""
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
            for entry in value if parameter.multiple else [value]:
                words += [parameter.opts[0], f"{entry:g}" if isinstance(entry, float) else str(entry)]
    return shlex.join(words)


@click.command("study-merge")
@click.argument("files", nargs=-1, required=True, type=click.Path())
@click.option("-o", "--output", required=True, type=click.Path(), help="The HDF5 file to write.")
@click.option("--partial", is_flag=True, help="Write the file even if samples are missing.")
@click.option(
    "--force", is_flag=True, help="Discard finished samples of the output file that are in none of the files."
)
@reads_results("files")
def study_merge(files: tuple[str, ...], output: str, partial: bool, force: bool) -> int:
    """Merge the shards of a study (dynid study --shard I/N) into one file.

    The file equals that of the study run in one piece. A file that holds other finished samples is not
    replaced without --force.
    """
    from dynid.study.merge import merge_studies

    refuse_missing_folders(output)
    count = merge_studies(files, output, partial, force=force)
    click.echo(f"wrote {output}: {count} samples of {len(files)} file{'s' if len(files) > 1 else ''}")
    return 0


@click.command()
@click.argument("file", type=click.Path())
@click.argument("path")
@click.option("-o", "--output", type=click.Path(), required=True, help="The scene to write.")
@click.option(
    "--max", "direction", flag_value="max", default=True, help="The largest value is worst (default)."
)
@click.option("--min", "direction", flag_value="min", help="The smallest value is worst.")
@click.option("--abs", "direction", flag_value="abs", help="The largest absolute value is worst.")
@reads_results("file")
def study_worst(file: str, path: str, output: str, direction: Direction) -> int:
    """Write the sample with the most extreme result as a scene, to run it alone.

    PATH is the quantity to judge: a number that the study collected, as in study/results, an array, or one
    entry of an array as PATH[LABEL].
    """
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
