"""Samples of one scene that differ in values: what each gives, and how many of them are run together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from importlib import import_module
from typing import TYPE_CHECKING, Any, cast

from dynid.errors import DynidError, SceneError, UsageError
from dynid.result import Result, Variable
from dynid.scene.dispatch import RUNNERS, run_scene
from dynid.scene.load import check_source
from dynid.scene.yaml.source import set_values
from dynid.words import did_you_mean

if TYPE_CHECKING:
    from dynid.scene.load import Scene

#: In `collect`: every number under `properties` and `parameters`; what an empty `collect` stands for.
NUMBERS = ""
#: The groups that these stand in.
GATHERED_ANYWAY = frozenset({"properties", "parameters"})
#: Tells of each expectation whether a result meets it; the checks stand a floor above.
Judge = Callable[[Result, Sequence[Mapping[str, Any]]], tuple[bool, ...]]
#: What runs samples of a kind together, or says with None that it cannot run these.
Batched = Callable[
    ["Scene", Sequence[Mapping[str, Any]], tuple[str, ...], int],
    "list[Outcome] | None",
]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one sample gave.

    Parameters
    ----------
    values
        What was collected, by its path in the result, with the coordinates of its axes; empty where the
        sample failed.
    error
        Why it failed; empty where it did not.
    exit_code
        What `dynid run` would have ended with: 0, 2 (the scene), 3 (numerics) or 4 (a file).
    expectations
        Whether each `expect` of the scene is met.
    """

    values: Mapping[str, Variable] = field(default_factory=dict)
    error: str = ""
    exit_code: int = 0
    expectations: tuple[bool, ...] = ()


def run_batch(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None = None,
    of: int = 1,
) -> list[Outcome]:
    """Run samples of a scene that differ in values, together where the kind of scene can.

    Parameters
    ----------
    template
        The scene that they share.
    overrides
        For each sample its values by dotted path, as `--set` takes them.
    collect
        What to gather from each result: paths, groups, or patterns with `*`; empty: every number under
        `properties` and `parameters`.
    judge
        Says which expectations of the scene a result meets; absent: nobody asks.
    of
        How many samples there are in all, of which these are some: what is worth its preparation depends on
        that, and not on what happens to be run together.

    Returns
    -------
    list of Outcome
        One for each sample, in order. A sample that fails is an outcome with its error. No outcome
        depends on what else is run with it.
    """
    outcomes = _batched(template, overrides, collect, judge, of)
    return (
        outcomes if outcomes is not None else [run_alone(template, one, collect, judge) for one in overrides]
    )


def _batched(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None,
    of: int,
) -> list[Outcome] | None:
    """Run samples by the batched route of their kind; None where there is none for them."""
    route = cast("Batched | None", getattr(import_module(RUNNERS[template.kind]), "batched", None))
    varied = {path.partition(".")[0] for one in overrides for path in one}
    expected = _expected(template) if judge is not None else []
    if route is None or "expect" in varied:
        return None
    collect = collect or (NUMBERS,)
    outcomes = route(template, overrides, (*collect, *(str(one["path"]) for one in expected)), of)
    if outcomes is None or judge is None or not expected:
        return outcomes
    return [_judged(template, outcome, collect, judge, expected) for outcome in outcomes]


def why_alone(template: Scene, paths: Sequence[str], collect: tuple[str, ...], of: int) -> str:
    """Say why samples are run one by one; nothing where they are run together.

    Parameters
    ----------
    template, collect, of
        As of `run_batch`.
    paths
        What the samples differ in.
    """
    if any(path.partition(".")[0] == "expect" for path in paths):
        return "what is expected varies"
    module = {"bond-graph": "graph_samples", "identification": "identification_samples"}.get(template.kind)
    if module is None:
        return f"scenes of kind {template.kind} share nothing"
    wanted = (*(collect or (NUMBERS,)), *(str(one["path"]) for one in _expected(template)))
    return str(import_module(f"dynid.scene.kinds.{module}").why_alone(template, paths, wanted, of))


def _judged(
    template: Scene, outcome: Outcome, collect: tuple[str, ...], judge: Judge, expected: list[dict[str, Any]]
) -> Outcome:
    """Judge an outcome by what was gathered for the expectations, and keep what was asked for."""
    if outcome.error:
        return outcome
    result = Result(template.kind, template.title)
    for path, variable in outcome.values.items():
        result.add(path, variable.data, variable.dims, variable.units, **variable.attrs)
    return Outcome(gather(result, collect), expectations=judge(result, expected))


def run_alone(
    template: Scene, override: Mapping[str, Any], collect: tuple[str, ...], judge: Judge | None = None
) -> Outcome:
    """Load, check and run one sample."""
    try:
        scene = check_source(set_values(template.source, override))
        result = run_scene(scene)
        met = judge(result, _expected(scene)) if judge is not None and scene.model.expect else ()
        return Outcome(gather(result, collect), expectations=met)
    except SceneError as error:
        return failed(template, "; ".join(_said(template, fault) for fault in error.faults), 2)
    except DynidError as error:
        return failed(template, str(error), error.exit_code)
    except MemoryError:
        return failed(template, "this needs more memory than there is", 3)
    except OSError as error:
        said = f"{error.filename or 'a file'} cannot be read or written: {error.strerror or error}"
        return failed(template, said, 4)
    except Exception as error:  # one sample in an unforeseen state is no reason to lose the others
        said = " ".join(f"{type(error).__name__} {error}".split())
        return failed(template, f"this is a fault of dynid itself ({said}). Please report it", 3)


def failed(template: Scene, error: str, exit_code: int) -> Outcome:
    """Return the outcome of a sample that failed, in the same words wherever it ran."""
    return Outcome(error=error.replace(f"{template.folder}/", ""), exit_code=exit_code)


def _said(template: Scene, fault: Any) -> str:
    """Word a fault of a sample: at the value that was set, or at its line of the scene."""
    written = fault.file == template.source.file
    return f"{fault.file}:{fault.line}: {fault.message}" if written else f"{fault.file}: {fault.message}"


def _expected(scene: Scene) -> list[dict[str, Any]]:
    return [item.model_dump(exclude_none=True) for item in scene.model.expect]


def gather(result: Mapping[str, Variable], collect: tuple[str, ...]) -> dict[str, Variable]:
    """Pick what is collected from a result, with the coordinates of its axes.

    Parameters
    ----------
    result
        Arrays by path.
    collect
        Paths, groups, or patterns with `*`; empty: every number under `properties` and `parameters`.

    Raises
    ------
    UsageError
        Where there is nothing at a path, or a table, which has no place in a study.
    """
    chosen = dict.fromkeys(selected(result, collect))
    for path in list(chosen):
        chosen.update(dict.fromkeys(_coordinates(result, path)))
    return {path: result[path] for path in chosen}


def selected(result: Mapping[str, Variable], collect: tuple[str, ...]) -> Iterator[str]:
    """Yield the paths of a result that `collect` names."""
    for wanted in (path.strip("/") for path in collect or (NUMBERS,)):
        if wanted == NUMBERS:
            yield from [path for path, variable in result.items() if _is_collected_anyway(path, variable)]
            continue
        if wanted in result:
            if result[wanted].data.dtype.names:
                raise UsageError(f"{wanted} is a table, which cannot be collected")
            yield wanted
            continue
        below = [
            path
            for path, variable in result.items()
            if (path.startswith(f"{wanted}/") or fnmatchcase(path, wanted)) and not variable.data.dtype.names
        ]
        if not below:
            raise UsageError(f"there is nothing to collect at '{wanted}'{did_you_mean(wanted, result)}")
        yield from below


def _is_collected_anyway(path: str, variable: Variable) -> bool:
    return variable.data.dtype.kind in "bifc" and not GATHERED_ANYWAY.isdisjoint(path.split("/"))


def _coordinates(result: Mapping[str, Variable], path: str) -> Iterator[str]:
    """Yield the coordinates of an array's axes: in its own group, or in the nearest one above."""
    for dim in result[path].dims:
        group = path
        while group:
            group = group.rpartition("/")[0]
            coordinate = f"{group}/{dim}" if group else dim
            if coordinate in result:
                if result[coordinate].dims == (dim,):
                    yield coordinate
                break
