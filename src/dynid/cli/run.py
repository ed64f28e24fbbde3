"""The commands run and plan: from a scene to a file and its summary."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import refuse_missing_folders, refuse_overwriting, set_option, writes_junit
from dynid.errors import DynidError, FileError, NumericalError, SceneError, UsageError

if TYPE_CHECKING:
    from dynid.checks import CheckOutcome
    from dynid.progress import Listener
    from dynid.result import Result
    from dynid.scene.load import Scene


class LocatedError(DynidError):
    """An error of a run with its location in the scene."""

    def __init__(self, scene: Scene, error: DynidError) -> None:
        super().__init__(str(scene.locate(error)))
        self.exit_code, self.result = error.exit_code, error.result


@contextmanager
def _locating(scene: Scene) -> Iterator[None]:
    """Locate errors of the run in its scene."""
    try:
        yield
    except (NumericalError, UsageError, FileError) as error:
        raise LocatedError(scene, error) from error


@click.command()
@click.argument("scene", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="The HDF5 file to write; default ./<scene>.h5.")
@set_option("scene")
@click.option(
    "--junit", type=click.Path(), help="Write the outcome of the expectations, or an error, as JUnit XML."
)
@click.option("--report", type=click.Path(), help="Also write an HTML report to this file.")
@click.option(
    "--accuracy",
    is_flag=True,
    help="Compare the cost and error of the selected algorithms with those of the alternatives.",
)
@click.option("-v", "--verbose", is_flag=True, help="Print the derivations, too: causality, reduction steps.")
@click.option("--json", "as_json", is_flag=True, help="Print the answer as one JSON object.")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors and warnings.")
@writes_junit("scene")
def run(
    scene: str,
    output: str | None,
    overrides: tuple[str, ...],
    junit: str | None,
    report: str | None,
    accuracy: bool,
    verbose: bool,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run one scene and write one HDF5 file.

    The file is written completely or not at all. Exit code 1: an expectation of the scene failed; the file is
    still written. Exit code 3 with a file of status "rejected": a fit does not explain its record; the file
    has the fit and its tests, and no estimates to go by.

    \b
    Examples:
      dynid run isolator.yaml
      dynid run isolator.yaml --set parameters.b=80 -o damped.h5
      dynid run isolator.yaml --report isolator.html
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.progress import showing
    from dynid.scene.load import load_scene

    started = time.perf_counter()
    loaded = load_scene(scene, overrides)
    target = Path(output) if output else Path(Path(scene).stem + ".h5")
    refuse_overwriting(scene, str(target), junit, report)
    refuse_missing_folders(str(target), junit, report)
    _refuse_impossible(loaded)
    from dynid.store import write_result

    doubts = warn_of_doubts(loaded)
    rejection: LocatedError | None = None
    with showing(quiet) as listener:
        try:
            result = compute(loaded, listener, accuracy=accuracy)
        except LocatedError as error:
            if error.result is None:
                raise
            rejection, result = error, error.result
        listener(f"writing {target}")
        write_result(result, target)
        if report:
            from dynid.cli.results import write_page
            from dynid.store import read_result

            write_page(read_result(target), report)
    seconds = time.perf_counter() - started
    outcomes = [] if rejection else checked_expectations(loaded, result, junit, seconds)
    from dynid.report import warnings, without_warnings

    if not quiet and not as_json:
        from dynid.cli.screen import summary

        # Each warning is printed once, on standard error.
        click.echo(summary(without_warnings(result), f"{time.perf_counter() - started:.2g} s", trace=verbose))
        more = report or f"see it: dynid report {target}"
        click.echo(f"\n  wrote {target}{', ' if report else ' · '}{more}")
    said = warnings(result)
    if as_json:
        from dynid.store.export import answer_json

        click.echo(answer_json(result, [*doubts, *said]))
    for warning in said:
        click.echo(f"{scene}: warning: {warning}", err=True)
    if rejection:
        raise rejection
    return report_expectations(loaded, outcomes, quiet or as_json)


def _refuse_impossible(scene: Scene) -> None:
    """Refuse, before any work, expectations of what the run cannot give."""
    if scene.model.expect:
        from dynid.scene.kinds.expected_paths import impossible_paths

        if faults := list(impossible_paths(scene)):
            raise SceneError(faults)


def warn_of_doubts(scene: Scene) -> list[str]:
    """Print the doubts about a valid scene on standard error, each at its place; return their messages."""
    from dynid.scene.run import scene_doubts

    faults = scene_doubts(scene)
    for doubt in faults:
        click.echo(str(replace(doubt, message=f"warning: {doubt.message}")), err=True)
    return [doubt.message for doubt in faults]


def compute(scene: Scene, listener: Listener, *, accuracy: bool) -> Result:
    """Run a scene, with the table of alternatives if requested; errors are located in the scene."""
    from dynid.scene.run import run_scene

    with _locating(scene):
        result = run_scene(scene)
        if accuracy or getattr(scene.model, "accuracy", None) is not None:
            from dynid.bench.scenes import add_accuracy

            add_accuracy(result, scene, progress=listener)
    return result


def checked_expectations(
    scene: Scene, result: Result, junit: str | None, seconds: float
) -> list[CheckOutcome]:
    """Check a result, in memory or stored, against its scene; write a JUnit file if one is named.

    `seconds`: what the run took.
    """
    outcomes: list[CheckOutcome] = []
    if scene.model.expect:
        from dynid.checks import check_expectations

        outcomes = check_expectations(
            result, [item.model_dump(exclude_none=True) for item in scene.model.expect]
        )
    if junit:
        from dynid.checks import junit_xml
        from dynid.file_access import replace_file

        replace_file(junit, junit_xml(outcomes, Path(scene.source.file).stem, seconds=seconds).encode())
    return outcomes


def report_expectations(scene: Scene, outcomes: list[CheckOutcome], quiet: bool) -> int:
    """Print how many expectations are met, and each failure at its place; return the exit code."""
    met = sum(outcome.passed for outcome in outcomes)
    if outcomes and not quiet:
        from dynid.number_format import counted

        click.echo(f"  {met} of {counted(len(outcomes), 'expectation')} met")
    for index, outcome in enumerate(outcomes):
        if not outcome.passed:
            message = f"expectation failed: {outcome.path}: {outcome.message}"
            click.echo(str(scene.source.fault(("expect", index), message)), err=True)
    return 1 if met < len(outcomes) else 0


@click.command()
@click.argument("scene", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="Write the plan to this HDF5 file.")
@click.option(
    "--sensors",
    type=click.IntRange(1, 1000),
    metavar="N",
    help="Number of sensors; default: as many as the scene has.",
)
@click.option(
    "--lines",
    type=click.IntRange(1, 1000),
    metavar="N",
    help="Number of sines; default: as many as the scene has if all its forces are sines, else 3.",
)
@set_option("scene")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors.")
def plan(
    scene: str,
    output: str | None,
    sensors: int | None,
    lines: int | None,
    overrides: tuple[str, ...],
    quiet: bool,
) -> int:
    """Rank sensors and excitation by the Cramér–Rao bounds they give.

    Prints the Cramér–Rao bound of each unknown parameter, before the measurement, and the sensors and the
    sines that would give the lowest bounds. Nothing is identified.

    \b
    Example:
      dynid plan suspension.yaml --sensors 3
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.progress import showing
    from dynid.scene.kinds.planning import run_plan
    from dynid.scene.load import load_scene

    started = time.perf_counter()
    loaded = load_scene(scene, overrides)
    if output:
        refuse_overwriting(scene, output, None)
        refuse_missing_folders(output)
    with _locating(loaded), showing(quiet):
        result = run_plan(loaded, sensors, lines)
    if output:
        from dynid.store import write_result

        write_result(result, Path(output))
    if not quiet:
        from dynid.cli.screen import summary

        click.echo(summary(result, f"{time.perf_counter() - started:.2g} s"))
        if output:
            click.echo(f"\n  wrote {output}")
    return 0
