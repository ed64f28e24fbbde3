"""`dynid check`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.errors import FileError, SceneError

if TYPE_CHECKING:
    from dynid.scene.explanations.explanation import Explanation
    from dynid.scene.load import Scene


@click.command()
@click.argument("scenes", nargs=-1, required=True, type=click.Path())
@click.option("--explain", "explaining", is_flag=True, help="Tell causality, identifiability and cost.")
@click.option(
    "--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Set a value of the scenes; repeatable."
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but faults.")
def check(scenes: tuple[str, ...], explaining: bool, overrides: tuple[str, ...], quiet: bool) -> int:
    """Read and check scenes without running them.

    Prints every fault of every scene as FILE:LINE:COLUMN: message, and every file of data that a run would
    not find. Exit code 0: all are valid; 2: some are not; 4: a file could not be read.

    With --explain, says of each valid scene what a run would do: states and what follows from others, the
    engine or estimator and why, what the record can tell of each parameter, what is left out, and about how
    long it takes. A scene whose run is bound to fail is still valid; why it will fail is said.

    \b
    Examples:
      dynid check scenes/*.yaml
      dynid check --explain isolator.yaml
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.run import LocatedError
    from dynid.scene.files import missing_files
    from dynid.scene.load import load_scene

    code = faults = 0
    for name in scenes:
        try:
            scene = load_scene(name, overrides)
            missing = missing_files(scene)
            if missing:
                raise FileError("\n".join(map(str, missing)))
            said = _explained(scene, quiet) if explaining else []
        except SceneError as error:
            click.echo(str(error), err=True)
            faults += len(error.faults)
            code = max(code, error.exit_code)
        except (FileError, LocatedError) as error:
            click.echo(str(error), err=True)
            code = max(code, error.exit_code)
        else:
            if not quiet:
                click.echo("\n".join([f"{name}: valid ({scene.kind}: {scene.title})", *said]))
    if faults:
        click.echo(f"{faults} fault{'s' if faults > 1 else ''}", err=True)
    return code


def _explained(scene: Scene, quiet: bool) -> list[str]:
    """Return the lines that explain a valid scene."""
    from dynid.cli.progress import showing
    from dynid.cli.summary.explanation import explanation_lines

    with showing(quiet):
        explained = _explanation(scene)
    lines = list(explanation_lines(explained))
    if explained.obstacle is not None:
        place = scene.locate(explained.obstacle)
        lines += [f"  a run will fail (exit code {explained.obstacle.exit_code}):", f"  {place}", ""]
    return lines


def _explanation(scene: Scene) -> Explanation:
    if scene.kind == "study":
        from dynid.study.explanation import explain_study
        from dynid.study.plan import make_plan

        return explain_study(make_plan(scene), f"{Path(scene.source.file).stem}.h5")
    from dynid.cli.run import LocatedError
    from dynid.scene.explanations import explain

    try:
        return explain(scene)
    except FileError as error:
        raise LocatedError(scene, error) from error
