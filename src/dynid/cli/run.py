"""`dynid run`."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.errors import DynidError, FileError, NumericalError, UsageError

if TYPE_CHECKING:
    from dynid.progress import Listener
    from dynid.result import Result
    from dynid.scene.load import Scene


class LocatedError(DynidError):
    """An error of a run with its place in the scene."""

    def __init__(self, scene: Scene, error: DynidError) -> None:
        super().__init__(str(scene.locate(error)))
        self.exit_code = error.exit_code


@click.command()
@click.argument("scene", type=click.Path())
@click.option("-o", "--output", type=click.Path(), help="The HDF5 file to write; default ./<scene>.h5.")
@click.option(
    "--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Set a value of the scene; repeatable."
)
@click.option("--junit", type=click.Path(), help="Write the expectations' outcome as JUnit XML.")
@click.option("--report", type=click.Path(), help="Write the page of the result to this HTML file.")
@click.option(
    "--accuracy",
    is_flag=True,
    help="Try what else could have been chosen: what it costs, and how far off it is.",
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def run(
    scene: str,
    output: str | None,
    overrides: tuple[str, ...],
    junit: str | None,
    report: str | None,
    accuracy: bool,
    quiet: bool,
) -> int:
    """Run one scene and write one HDF5 file.

    The file is written whole or not at all. Exit code 1 says that an expectation of the scene failed; the
    file is there then, for a look.

    \b
    Examples:
      dynid run isolator.yaml
      dynid run isolator.yaml --set parameters.b=80 -o stiff.h5
      dynid run isolator.yaml --report isolator.html
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.expectations import check, tell
    from dynid.cli.progress import showing
    from dynid.scene.load import load_scene

    started = time.perf_counter()
    loaded = load_scene(scene, overrides)
    target = Path(output) if output else Path(Path(scene).stem + ".h5")
    refuse_overwriting(scene, str(target), junit, report)
    refuse_missing_folders(str(target), junit, report)
    from dynid.store import write_result

    with showing(quiet) as say:
        result = compute(loaded, say, accuracy=accuracy)
        say(f"writing {target}")
        write_result(result, target)
        if report:
            from dynid.cli.report import write_page
            from dynid.store import read_result

            write_page(read_result(target), report)
    outcomes = check(loaded, result, junit)
    if not quiet:
        _show(result, time.perf_counter() - started, f"{target}{f', {report}' if report else ''}")
    for warning in _warnings(result):
        click.echo(f"{scene}: warning: {warning}", err=True)
    return tell(loaded, outcomes, quiet)


def compute(scene: Scene, say: Listener, *, accuracy: bool) -> Result:
    """Run a scene, with the table of alternatives where it is wanted; errors are placed in the scene."""
    from dynid.scene.run import run_scene

    try:
        result = run_scene(scene)
        if accuracy or getattr(scene.model, "accuracy", None) is not None:
            from dynid.bench.scenes import add_accuracy

            add_accuracy(result, scene, tell=say)
        return result
    except (NumericalError, UsageError, FileError) as error:
        raise LocatedError(scene, error) from error


def _show(result: Result, seconds: float, files: str) -> None:
    from dynid.cli.summary import summary

    click.echo(summary(result, f"{seconds:.2g} s"))
    click.echo(f"\n  wrote {files}")


def _warnings(result: Result) -> list[str]:
    """Return the warnings of a result, which standard error shows to scripts that read no screen."""
    from dynid.report.content.identification import cautions

    of_graph = result["bond_graph/warnings"].data if "bond_graph/warnings" in result else ()
    return [*map(str, of_graph), *cautions(result)]


def refuse_overwriting(scene: str, target: str, junit: str | None, report: str | None = None) -> None:
    """Refuse to write over the scene, or one output over another."""
    if is_same(target, scene):
        raise UsageError(f"the result would overwrite the scene {scene}", remedy="Name another file with -o.")
    taken = [scene, target]
    for file, what, option in ((junit, "JUnit file", "--junit"), (report, "page", "--report")):
        if file and any(is_same(file, other) for other in taken):
            raise UsageError(f"the {what} would overwrite {file}", remedy=f"Name another file with {option}.")
        taken += [file] if file else []


def refuse_missing_folders(*files: str | None) -> None:
    """Say before the work what would come to light after it."""
    for file in files:
        if file is not None and not Path(file).parent.is_dir():
            folder = Path(file).parent
            raise FileError(f"{file} cannot be written: there is no folder {folder}", remedy="Make it first.")


def is_same(file: str, other: str) -> bool:
    """Tell whether two names are of the same file."""
    return os.path.realpath(file) == os.path.realpath(other)
