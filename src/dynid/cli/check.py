"""`dynid check`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dynid.errors import DynidError, Fault, FileError, SceneError

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

    Prints every fault of every scene as FILE:LINE:COLUMN: message: what can be found without computing
    anything, files of data and graphs without a solution included. Exit code as the run would have: 0: all
    are valid; 2: some are not; 3: a graph has no solution; 4: a file could not be read.

    Of a study, the scene that it varies is checked as well. A fault that its first sample does not share is
    none of the study.

    With --explain, says of each valid scene what a run would do: states and what follows from others, the
    engine or estimator and why, what the record can tell of each parameter, what is left out, and about how
    long it takes. Where that shows that the run will fail, it says why, and exits as the run would.

    \b
    Examples:
      dynid check scenes/*.yaml
      dynid check --explain isolator.yaml
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.run import LocatedError
    from dynid.scene.load import load_scene

    code = faults = 0
    for name in scenes:
        try:
            scene = load_scene(name, overrides)
            hindrances, exit_code = _hindrances(scene)
            if hindrances:
                click.echo("\n".join(hindrances), err=True)
                code = max(code, exit_code)
                continue
            said, exit_code = _explained(scene, quiet) if explaining else ([], 0)
            code = max(code, exit_code)
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


def _hindrances(scene: Scene) -> tuple[list[str], int]:
    """Return what keeps a valid scene from running, one by one, and the exit code of its run."""
    from dynid.scene.files import missing_files
    from dynid.scene.kinds.study import base_scene
    from dynid.scene.run import preparation_errors

    code = 0
    found: list[Fault] = []
    checked = scene
    if scene.kind == "study":
        checked = base_scene(scene)
    errors = preparation_errors(checked)
    if errors and checked is not scene:
        errors = _of_first_sample(scene, errors)
    for error in errors:
        found += error.faults if isinstance(error, SceneError) else [checked.locate(error)]
        code = code or error.exit_code
    missing = missing_files(scene)
    in_order = sorted([*found, *missing], key=lambda fault: (fault.file, fault.line, fault.column))
    return list(dict.fromkeys(map(str, in_order))), code or (FileError.exit_code if missing else 0)


def _of_first_sample(study: Scene, errors: Sequence[DynidError]) -> list[DynidError]:
    """Return the errors of a study's scene that its first sample, with the values that it sets, has too."""
    from dynid.scene.load import check_source
    from dynid.scene.run import preparation_errors
    from dynid.scene.yaml.source import set_values
    from dynid.study.plan import make_plan

    plan = make_plan(study)
    try:
        sample = check_source(set_values(plan.base.source, plan.override(0)))
    except SceneError:  # the sample is a failed row
        return []
    shared = {_problem(error) for error in preparation_errors(sample)}
    return [error for error in errors if _problem(error) in shared]


def _problem(error: DynidError) -> str:
    if isinstance(error, SceneError):
        return "; ".join(fault.message for fault in error.faults)
    return error.problem


def _explained(scene: Scene, quiet: bool) -> tuple[list[str], int]:
    """Return the lines that explain a valid scene, and the exit code of its run as far as that is known."""
    from dynid.cli.progress import showing
    from dynid.cli.summary.explanation import explanation_lines
    from dynid.scene.kinds.study import base_scene

    with showing(quiet):
        explained = _explanation(scene)
    lines = list(explanation_lines(explained))
    code = 0
    if explained.obstacle is not None and scene.kind == "study":  # a sample that fails is a row of its file
        place = base_scene(scene).locate(explained.obstacle)
        lines += ["  the scene fails at its own values:", f"  {place}", ""]
    elif explained.obstacle is not None:
        code = explained.obstacle.exit_code
        lines += [f"  a run will fail (exit code {code}):", f"  {scene.locate(explained.obstacle)}", ""]
    return lines, code


def _explanation(scene: Scene) -> Explanation:
    if scene.kind == "study":
        from dynid.study.explanation import explain_study
        from dynid.study.plan import make_plan

        return explain_study(make_plan(scene), f"{Path(scene.source.file).stem}.h5")
    from dynid.cli.run import LocatedError
    from dynid.scene.explanations.explanation import explain

    try:
        return explain(scene)
    except FileError as error:
        raise LocatedError(scene, error) from error
