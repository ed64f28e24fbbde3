"""`dynid check`, and what `--explain` prints of a scene: method, causality, identifiability and cost."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import set_option
from dynid.errors import DynidError, Fault, FileError, SceneError

if TYPE_CHECKING:
    from dynid.scene.load import Scene


@click.command()
@click.argument("scenes", nargs=-1, required=True, type=click.Path())
@click.option("--explain", "explaining", is_flag=True, help="Report causality, identifiability and cost.")
@set_option("scenes")
@click.option("-q", "--quiet", is_flag=True, help="Print only faults and warnings.")
def check(scenes: tuple[str, ...], explaining: bool, overrides: tuple[str, ...], quiet: bool) -> int:
    """Read and check scenes without running them.

    Prints every fault of every scene as FILE:LINE:COLUMN: message, including data files that cannot be read
    and singular graphs (no unique solution); as warnings, what a scene says that nothing uses, lists whose
    commas may be decimal, and elements of negative values. Exit code, as of the run: 0: all scenes are
    valid; 2: a scene is invalid; 3: a graph is singular; 4: a file could not be read.

    For a study, the scene that it varies is checked, too, and the paths of 'collect'. Errors of its
    computation, such as a singular graph, are reported only if the first sample has them as well; errors of
    other samples are not found.

    With --explain, reports for each valid scene what a run would do: independent and dependent states, the
    engine or estimator and the reason for it, the identifiability of each parameter, the parts of the model
    that are not used, and the time. For that a run is begun and, after five seconds of processor time,
    cut off and extrapolated; work that takes longer without any progress is named. If this shows that the
    run will fail, the reason is printed.

    \b
    Examples:
      dynid check scenes/*.yaml
      dynid check --explain isolator.yaml
    """  # noqa: D301 - click's mark against wrapping
    from dynid.cli.run import LocatedError, warn_of_doubts
    from dynid.scene.kinds.study import base_scene
    from dynid.scene.load import load_scene

    code = faults = 0
    began, loading = time.process_time(), 0.0
    for name in scenes:
        try:
            scene = load_scene(name, overrides)
            loading = (
                loading or time.process_time() - began
            )  # the first one: later ones find all modules loaded
            warn_of_doubts(base_scene(scene) if scene.kind == "study" else scene)
            obstacles, exit_code = _obstacles(scene)
            if obstacles:
                click.echo("\n".join(obstacles), err=True)
                code = max(code, exit_code)
                continue
            lines, exit_code = _explained(scene, overrides, quiet, loading) if explaining else ([], 0)
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
                click.echo("\n".join([f"{name}: valid ({scene.kind}: {scene.title})", *lines]))
    if faults:
        click.echo(f"{faults} fault{'s' if faults > 1 else ''}", err=True)
    return code


def _obstacles(scene: Scene) -> tuple[list[str], int]:
    """Return what prevents a valid scene from running and meeting its expectations, and the exit code."""
    from dynid.scene.files import missing_files
    from dynid.scene.kinds.expected_paths import impossible_paths
    from dynid.scene.kinds.study import base_scene
    from dynid.scene.run import preparation_errors

    code = 0
    faults: list[Fault] = []
    checked = base_scene(scene) if scene.kind == "study" else scene
    errors = preparation_errors(checked)
    if errors and checked is not scene:  # only errors that the first sample has, too
        from dynid.scene.load import check_source
        from dynid.scene.yaml.source import set_values
        from dynid.study.plan import make_plan

        plan = make_plan(scene)
        try:
            sample = check_source(set_values(plan.base.source, plan.override(0)))
            shared = {_problem(error) for error in preparation_errors(sample)}
        except SceneError:  # the sample is a failed row of the study's file
            shared = set()
        errors = [error for error in errors if _problem(error) in shared]
    for error in errors:
        faults += error.faults if isinstance(error, SceneError) else [checked.locate(error)]
        code = code or error.exit_code
    study = scene if checked is not scene else None
    missing, impossible = missing_files(scene), list(impossible_paths(checked, study))
    code = code or (SceneError.exit_code if impossible else 0)
    in_order = sorted(
        [*faults, *missing, *impossible], key=lambda fault: (fault.file, fault.line, fault.column)
    )
    return list(dict.fromkeys(map(str, in_order))), code or (FileError.exit_code if missing else 0)


def _problem(error: DynidError) -> str:
    if isinstance(error, SceneError):
        return "; ".join(fault.message for fault in error.faults)
    return error.problem


def _explained(
    scene: Scene, overrides: tuple[str, ...], quiet: bool, loading: float
) -> tuple[list[str], int]:
    """Return the lines that explain a valid scene, and the exit code of its run as far as it is known."""
    from dynid.cli.explained import cost_lines, explained
    from dynid.cli.progress import showing

    with showing(quiet):
        answer = explained(scene, overrides)
    return [*answer.lines, *cost_lines(answer, loading), *answer.failure], answer.code
