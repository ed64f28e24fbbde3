"""Samples of one scene that differ in values, run together where their kind can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from dynid.errors import DynidError, SceneError
from dynid.result import Result
from dynid.scene.collect import NUMBERS, gather
from dynid.scene.kind import KINDS
from dynid.scene.load import check_source
from dynid.scene.outcomes import SampleBlock, SampleOutcome, SampleOutcomes
from dynid.scene.run import run_scene
from dynid.scene.yaml.source import set_values

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.scene.load import Scene


Expected = Sequence[Mapping[str, Any]]


class Judge(Protocol):
    """Tells of each expectation whether results meet it; the checks stand a floor above."""

    def one(self, result: Result, expected: Expected) -> tuple[bool, ...]:
        """Judge one result."""

    def many(self, block: SampleBlock, expected: Expected, kind: str, title: str) -> NDArray[np.bool_]:
        """Judge samples side by side (sample x expectation)."""


def run_batch(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None = None,
    of: int = 1,
) -> SampleOutcomes:
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
    SampleOutcomes
        One for each sample, in order. A sample that fails is an outcome with its error. No outcome
        depends on what else is run with it.
    """
    together = _together(template, overrides, collect, judge, of) or SampleOutcomes([], len(overrides))
    alone = [run_alone(template, overrides[row], collect, judge) for row in together.pending]
    return together.completed(alone)


def _together(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None,
    of: int,
) -> SampleOutcomes | None:
    """Run samples by the batched route of their kind; None where there is none for them.

    Those that it leaves out are pending.
    """
    together = KINDS[template.kind].load("batch")
    varied = {path.partition(".")[0] for one in overrides for path in one}
    expected = _expected(template) if judge is not None else []
    if together is None or "expect" in varied:
        return None
    collect = collect or (NUMBERS,)
    found = together.batched(template, overrides, (*collect, *(str(one["path"]) for one in expected)), of)
    if found is None:
        return None
    outcomes = found if isinstance(found, SampleOutcomes) else SampleOutcomes.of(found)
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
    together = KINDS[template.kind].load("batch")
    if together is None:
        return f"scenes of kind {template.kind} share nothing"
    wanted = (*(collect or (NUMBERS,)), *(str(one["path"]) for one in _expected(template)))
    return str(together.why_alone(template, paths, wanted, of))


def run_alone(
    template: Scene, override: Mapping[str, Any], collect: tuple[str, ...], judge: Judge | None = None
) -> SampleOutcome:
    """Load, check and run one sample."""
    try:
        scene = check_source(set_values(template.source, override))
        result = run_scene(scene)
        met = judge.one(result, _expected(scene)) if judge is not None and scene.model.expect else ()
        return SampleOutcome(gather(result, collect), expectations=met)
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


def failed(template: Scene, error: str, exit_code: int) -> SampleOutcome:
    """Return the outcome of a sample that failed, in the same words wherever it ran."""
    return SampleOutcome(error=error.replace(f"{template.folder}/", ""), exit_code=exit_code)


def _said(template: Scene, fault: Any) -> str:
    """Word a fault of a sample: at the value that was set, or at its line of the scene."""
    written = fault.file == template.source.file
    return f"{fault.file}:{fault.line}: {fault.message}" if written else f"{fault.file}: {fault.message}"


def _expected(scene: Scene) -> list[dict[str, Any]]:
    return [item.model_dump(exclude_none=True) for item in scene.model.expect]
