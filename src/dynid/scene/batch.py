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
from dynid.scene.yaml.source import set_values

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.scene.load import Scene


Expected = Sequence[Mapping[str, Any]]


class Judge(Protocol):
    """Test of results against the expectations of a scene; the checks are in a higher layer."""

    def one(self, result: Result, expected: Expected) -> tuple[bool, ...]:
        """Return True for each expectation that a result meets."""

    def many(self, block: SampleBlock, expected: Expected, kind: str, title: str) -> NDArray[np.bool_]:
        """Return the same for samples side by side (sample x expectation)."""


def run_batch(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None = None,
) -> SampleOutcomes:
    """Run samples of a scene that differ in values, together where the kind of scene can.

    Parameters
    ----------
    template
        The scene that they share.
    overrides
        For each sample its values by dotted path, as `--set` takes them.
    collect
        The arrays to gather from each result: paths, groups, or patterns with `*`; empty: every number under
        `properties` and `parameters`.
    judge
        Test of results against the expectations of the scene; absent: they are not tested.

    Returns
    -------
    SampleOutcomes
        One for each sample, in order. A sample that fails is an outcome with its error. No outcome
        depends on what else is run with it.
    """
    together = _together(template, overrides, collect, judge) or SampleOutcomes([], len(overrides))
    alone = [run_alone(template, overrides[row], collect, judge) for row in together.pending]
    return together.completed(alone)


def _together(
    template: Scene,
    overrides: Sequence[Mapping[str, Any]],
    collect: tuple[str, ...],
    judge: Judge | None,
) -> SampleOutcomes | None:
    """Return the outcomes of samples run together by their kind; None where it cannot.

    Samples that are to be run alone are pending.
    """
    together = KINDS[template.kind].load("batch")
    varied = {path.partition(".")[0] for one in overrides for path in one}
    expected = _expected(template) if judge is not None else []
    if together is None or "expect" in varied:
        return None
    collect = collect or (NUMBERS,)
    found = together.batched(template, overrides, (*collect, *(str(one["path"]) for one in expected)))
    if found is None:
        return None
    outcomes = found if isinstance(found, SampleOutcomes) else SampleOutcomes.of(found)
    if judge is None or not expected:
        return outcomes
    judged = outcomes.with_expectations(
        lambda block: judge.many(block, expected, template.kind, template.title)
    )
    return judged.with_values(lambda block: gather(block.result(0), collect))


def why_alone(template: Scene, paths: Sequence[str], collect: tuple[str, ...]) -> str:
    """Return why samples are run one by one; empty where they are run together.

    Parameters
    ----------
    template, collect
        As of `run_batch`.
    paths
        The dotted paths of the values in which the samples differ.
    """
    if any(path.partition(".")[0] == "expect" for path in paths):
        return "what is expected varies"
    together = KINDS[template.kind].load("batch")
    if together is None:
        return f"scenes of kind {template.kind} share nothing"
    wanted = (*(collect or (NUMBERS,)), *(str(one["path"]) for one in _expected(template)))
    return str(together.why_alone(template, paths, wanted))


def run_alone(
    template: Scene, override: Mapping[str, Any], collect: tuple[str, ...], judge: Judge | None = None
) -> SampleOutcome:
    """Load, check and run one sample."""
    try:
        scene = check_source(set_values(template.source, override))
        result = KINDS[scene.kind].load("run")(scene)  # without the scene's text, which nothing collects
        met = judge.one(result, _expected(scene)) if judge is not None and scene.model.expect else ()
        return SampleOutcome(gather(result, collect), expectations=met)
    except SceneError as error:
        # Each fault stands at the value that was set, or at its line of the scene.
        said = "; ".join(
            f"{fault.file}:{fault.line}: {fault.message}"
            if fault.file == template.source.file
            else f"{fault.file}: {fault.message}"
            for fault in error.faults
        )
        return failed(template, said, 2)
    except DynidError as error:
        return failed(template, str(error), error.exit_code)
    except MemoryError:
        return failed(template, "this needs more memory than there is", 3)
    except OSError as error:
        said = f"{error.filename or 'a file'} cannot be read or written: {error.strerror or error}"
        return failed(template, said, 4)
    except Exception as error:  # an unforeseen fault of one sample must not lose the others
        said = " ".join(f"{type(error).__name__} {error}".split())
        return failed(template, f"this is a fault of dynid itself ({said}). Please report it", 3)


def failed(template: Scene, error: str, exit_code: int) -> SampleOutcome:
    """Return the outcome of a failed sample, with the same message wherever it ran."""
    return SampleOutcome(error=error.replace(f"{template.folder}/", ""), exit_code=exit_code)


def _expected(scene: Scene) -> list[dict[str, Any]]:
    return [item.model_dump(exclude_none=True) for item in scene.model.expect]
