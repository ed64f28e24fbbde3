"""Samples of one scene that differ in values: what each gives, and how many of them are run together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol, cast

from dynid.errors import DynidError, SceneError, UsageError
from dynid.result import Result, Variable
from dynid.scene.dispatch import RUNNERS, run_scene
from dynid.scene.load import check_source
from dynid.scene.outcomes import Block, Outcome, Outcomes
from dynid.scene.yaml.source import set_values
from dynid.words import did_you_mean_path

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.scene.load import Scene

__all__ = ["Outcome", "Outcomes", "failed", "gather", "run_alone", "run_batch", "selected", "why_alone"]

Expected = Sequence[Mapping[str, Any]]

#: In `collect`: every number under `properties` and `parameters`; what an empty `collect` stands for.
NUMBERS = ""
#: The groups that these stand in.
GATHERED_ANYWAY = frozenset({"properties", "parameters"})
#: What runs samples of a kind together, or says with None that it cannot run these; None in the place of a
#: sample leaves that one to be run alone.
Batched = Callable[
    ["Scene", Sequence[Mapping[str, Any]], tuple[str, ...], int],
    "Sequence[Outcome | None] | None",
]


class Judge(Protocol):
    """Tells of each expectation whether results meet it; the checks stand a floor above."""

    def one(self, result: Result, expected: Expected) -> tuple[bool, ...]:
        """Judge one result."""

    def many(self, block: Block, expected: Expected, kind: str, title: str) -> NDArray[np.bool_]:
        """Judge samples side by side (sample x expectation)."""


def run_batch(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None = None,
    of: int = 1,
) -> Outcomes:
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
    Outcomes
        One for each sample, in order. A sample that fails is an outcome with its error. No outcome
        depends on what else is run with it.
    """
    together = _together(template, overrides, collect, judge, of) or Outcomes([], len(overrides))
    alone = [run_alone(template, overrides[row], collect, judge) for row in together.pending]
    return together.completed(alone)


def _together(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None,
    of: int,
) -> Outcomes | None:
    """Run samples by the batched route of their kind; None where there is none for them.

    Those that it leaves out are pending.
    """
    route = cast("Batched | None", getattr(import_module(RUNNERS[template.kind]), "batched", None))
    varied = {path.partition(".")[0] for one in overrides for path in one}
    expected = _expected(template) if judge is not None else []
    if route is None or "expect" in varied:
        return None
    collect = collect or (NUMBERS,)
    found = route(template, overrides, (*collect, *(str(one["path"]) for one in expected)), of)
    if found is None:
        return None
    outcomes = found if isinstance(found, Outcomes) else Outcomes.of(found)
    if judge is None or not expected:
        return outcomes
    judged = outcomes.with_expectations(
        lambda block: judge.many(block, expected, template.kind, template.title)
    )
    return judged.with_values(lambda block: gather(block.result(0), collect))


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


def run_alone(
    template: Scene, override: Mapping[str, Any], collect: tuple[str, ...], judge: Judge | None = None
) -> Outcome:
    """Load, check and run one sample."""
    try:
        scene = check_source(set_values(template.source, override))
        result = run_scene(scene)
        met = judge.one(result, _expected(scene)) if judge is not None and scene.model.expect else ()
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
            raise UsageError(f"there is nothing to collect at '{wanted}'{did_you_mean_path(wanted, result)}")
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
