"""`dynid check`, and what `--explain` prints of a scene: method, causality, identifiability and cost.

Scenes are explained in a separate process, which is ended where it takes too long: stages of a run may report
no progress for minutes, and compiled ones cannot be interrupted.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.arguments import set_option
from dynid.errors import DynidError, Fault, FileError, SceneError
from dynid.progress import progress_to, report_progress

if TYPE_CHECKING:
    from dynid.scene.explanation import Cost, Explanation
    from dynid.scene.load import Scene

#: Wall-clock seconds for each second of processor time, on a busy machine.
_PATIENCE = 6
#: Processor seconds beyond those of a trial run, which then reports its forecast.
_SLACK = 0.2

Send = Callable[[dict[str, Any]], object]


@dataclass(frozen=True)
class Explained:
    """The explanation of a scene, as far as it came.

    `lines` are the screen without the cost, `failure` those that say how a run will fail, `code` its exit
    code, if known. There is no cost where a run fails, or was cut off without a forecast; `cut_off` is what
    was in progress then.
    """

    lines: list[str] = field(default_factory=list)
    failure: list[str] = field(default_factory=list)
    code: int = 0
    cost: Cost | None = None
    cut_off: str | None = None


def explained(scene: Scene, overrides: tuple[str, ...]) -> Explained:
    """Return the explanation of a valid scene, made in a separate process of limited processor time.

    Raises `DynidError` where a file of the scene cannot be read.
    """
    from dynid.cli.text import columns
    from dynid.scene.explanation import TRIAL_SECONDS
    from dynid.trial import limits_processor_time, messages

    seconds = TRIAL_SECONDS * (_PATIENCE if limits_processor_time() else 1)
    arguments = (str(columns()), scene.source.file, *overrides)
    stream = messages("dynid.cli.check:explain_file", *arguments, seconds=seconds)
    if stream is not None:
        return _received(stream)
    heard: list[dict[str, Any]] = []  # no process can be started here
    _explain_in_parts(scene, heard.append)
    return _received(heard)


def _received(stream: Iterable[dict[str, Any]]) -> Explained:
    """Return the explanation of which a stream has the parts."""
    from dynid.scene.explanation import Cost

    answer, work = Explained(), "reading the scene"
    for message in stream:
        match message:
            case {"progress": str(text)}:
                work = text or work
                report_progress(text)
            case {"lines": lines}:
                answer, work = replace(answer, lines=lines), "the beginning of a trial run"
            case {"failure": failure, "code": code}:
                return replace(answer, failure=failure, code=code)
            case {"cost": cost}:
                return replace(answer, cost=Cost(*cost))
            case {"unreadable": str(text)}:
                error = DynidError(text)
                error.exit_code = FileError.exit_code
                raise error
            case {"unforeseen": str(text)}:
                raise RuntimeError(text)
    return replace(answer, cut_off=work)


def explain_file(send: Send, width: str, path: str, *overrides: str) -> None:
    """Explain the scene of a file for a screen of some width: what the separate process does."""
    from dynid.cli.text import screen_elsewhere
    from dynid.scene.explanation import TRIAL_SECONDS
    from dynid.scene.load import load_scene
    from dynid.trial import limit_processor_time

    screen_elsewhere.set(int(width))
    scene = load_scene(path, overrides)
    limit_processor_time(TRIAL_SECONDS + _SLACK)
    try:
        _explain_in_parts(scene, send)
    except FileError as error:
        send({"unreadable": str(scene.locate(error))})
    except Exception as error:
        send({"unforeseen": f"{type(error).__name__} {error}"})


def _explain_in_parts(scene: Scene, send: Send) -> None:
    """Send the explanation of a scene, then its failure, or its cost by a trial run."""
    from dynid.scene.explanation import TRIAL_SECONDS, explain, trial

    def report(text: str) -> None:
        send({"progress": text})

    began = time.process_time()
    with progress_to(report):
        if scene.kind == "study":
            from dynid.study.plan import make_plan
            from dynid.study.run import explain_study, study_cost

            plan, target = make_plan(scene), f"{Path(scene.source.file).stem}.h5"
            explanation = explain_study(plan, target)
        else:
            explanation = explain(scene)
        send({"lines": list(_explanation_lines(explanation))})
        obstacle = explanation.obstacle
        if scene.kind == "study":
            if obstacle is None:
                send({"cost": study_cost(plan, target)})
            else:  # a sample that fails is a row of its file
                lines = [
                    "  the scene fails at its own values:",
                    f"  {scene.base.locate(obstacle)}",
                    "",
                ]
                send({"failure": lines, "code": 0})
            return
        try:
            if obstacle is not None:
                raise obstacle
            send(
                {"cost": trial(scene, max(0.0, TRIAL_SECONDS - (time.process_time() - began)), heard=report)}
            )
        except FileError:
            raise
        except DynidError as error:
            lines = [f"  a run will fail (exit code {error.exit_code}):", f"  {scene.locate(error)}", ""]
            send({"failure": lines, "code": error.exit_code})


def _explanation_lines(explanation: Explanation) -> Iterator[str]:
    """Yield the screen of an explanation but for its cost: facts, causality, identifiability."""
    from dynid.cli.screen import section_lines
    from dynid.report.content.bond_graph import causality_sections
    from dynid.report.content.identifiability import calibration_sections, identifiability_sections

    result = explanation.result
    yield from _paragraphs(
        [line for fact in explanation.facts for line in _hanging(fact.topic, fact.text)],
        section_lines(causality_sections(result)),
        section_lines((*identifiability_sections(result), *calibration_sections(result))),
    )


def _cost_lines(answer: Explained, loading: float) -> Iterator[str]:
    """Yield the cost of a run; `loading` are the seconds in which a scene is read, a part of every run."""
    from dynid.scene.explanation import TRIAL_SECONDS

    cut_off = (
        f"after {TRIAL_SECONDS:g} s of processor time it was at '{answer.cut_off}', which has no forecast"
    )
    cost = answer.cost
    if cost is not None:
        seconds, memory = seconds_text(loading + cost.seconds), size_text(1e6 * cost.megabytes)
        file = "" if cost.kilobytes is None else f"; a file of about {size_text(1e3 * cost.kilobytes)}"
        yield from _paragraphs([*_hanging("cost", f"{seconds}, {memory} of memory{file} ({cost.source})")])
    elif answer.cut_off is not None and not answer.lines:
        yield from _paragraphs([*_hanging("cut off", f"the explanation is not complete: {cut_off}")])
    elif answer.cut_off is not None:
        text = f"more than {TRIAL_SECONDS:g} s (a trial run was cut off: {cut_off})"
        yield from _paragraphs([*_hanging("cost", text)])
    yield ""


def _paragraphs(*parts: Sequence[str]) -> Iterator[str]:
    """Yield the lines of paragraphs, an empty line before each of them, folded to the screen."""
    from dynid.cli.text import folded

    for paragraph in filter(None, parts):
        yield ""
        lines = "\n".join(paragraph).rstrip("\n").split("\n")
        yield from (piece for line in lines for piece in folded(line))


def _hanging(topic: str, text: str) -> Iterator[str]:
    from dynid.cli.text import columns

    first, *rest = wrap(text, min(91, columns() - 17), break_long_words=False, break_on_hyphens=False) or [""]
    yield f"  {topic:<13}  {first}"
    yield from (f"{'':17}{line}" for line in rest)


def seconds_text(seconds: float) -> str:
    """Return an estimated duration as text."""
    if seconds < 0.5:
        return "well under a second"
    if seconds < 1.5:
        return "about a second"
    if seconds < 90:
        return f"about {_rounded(seconds)} s"
    if seconds < 90 * 60:
        return f"about {_rounded(seconds / 60)} min"
    return f"about {_rounded(seconds / 3600)} h"


def size_text(size: float) -> str:
    """Return a number of bytes as text."""
    for unit, name in ((1e9, "GB"), (1e6, "MB")):
        if size >= unit:
            return f"{_rounded(size / unit)} {name}"
    return f"{_rounded(size / 1e3)} kB"


def _rounded(value: float) -> str:
    """Return a number with two significant digits, or one below 10."""
    digits = 1 if value >= 10 else 0
    decimals = digits - math.floor(math.log10(value)) if value > 0 else 0
    return f"{round(value, decimals):,.{max(0, decimals)}f}"


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
    from dynid.scene.load import load_scene

    code = faults = 0
    began, loading = time.process_time(), 0.0
    for name in scenes:
        try:
            scene = load_scene(name, overrides)
            loading = (
                loading or time.process_time() - began
            )  # the first one: later ones find all modules loaded
            warn_of_doubts(scene.base)
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
    from dynid.scene.run import preparation_errors

    code = 0
    faults: list[Fault] = []
    checked = scene.base
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
    from dynid.cli.progress import showing

    with showing(quiet):
        answer = explained(scene, overrides)
    return [*answer.lines, *_cost_lines(answer, loading), *answer.failure], answer.code
