"""Samples of one scene that differ in values, run together where their kind can."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from graphlib import TopologicalSorter
from typing import TYPE_CHECKING, Any, Protocol

from dynid.arithmetic.expression import Expression, parse
from dynid.arithmetic.numbers import Number, OutOfRangeError, apply, pi, to_fraction
from dynid.errors import DynidError, SceneError, UsageError
from dynid.native import call, compiled
from dynid.result import NUMBERS, Result, Selection
from dynid.scene.kind import KINDS
from dynid.scene.load import check_source
from dynid.scene.outcomes import SampleBlock, SampleOutcome, SampleOutcomes, gather
from dynid.scene.schema.base import DefinedParameter
from dynid.scene.schema.raw import reference_values
from dynid.scene.yaml.source import set_values

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.result import Variable
    from dynid.scene.load import Scene
    from dynid.scene.yaml.source import Source


# Memory that a process of samples keeps between them, bytes.
_KEPT_BYTES = 2**26

Expected = Sequence[Mapping[str, Any]]
Overrides = Sequence[Mapping[str, Any]]
"""For each sample its values by dotted path, as `--set` takes them."""


class NotShared(Exception):
    """The samples of a batch share too little; the text says why."""


class SamplePlan(Protocol):
    """What the samples of a scene share.

    It is made of the scene, the dotted paths that vary, and the paths, groups or patterns to collect; where
    these share too little, that raises `NotShared`.
    """

    def run(self, overrides: Overrides) -> SampleOutcomes:
        """Run samples; those that are to be run alone are pending."""


@dataclass(frozen=True)
class _PlanKey:
    """Key of a plan: scenes of equal text are equal."""

    text: str
    file: str
    paths: tuple[str, ...]
    collect: tuple[str, ...]
    scene: Scene = field(compare=False)


class _Judge(Protocol):
    """Test of samples against the expectations of their scene; the checks are in a higher layer."""

    def __call__(self, block: SampleBlock, expected: Expected, kind: str, title: str) -> NDArray[np.bool_]:
        """Return True for each expectation that a sample meets (sample x expectation)."""


def run_batch(
    template: Scene, overrides: Overrides, collect: tuple[str, ...], judge: _Judge | None = None
) -> SampleOutcomes:
    """Run samples of a scene that differ in values, together where the kind of scene can.

    Parameters
    ----------
    template
        The scene that they share.
    overrides
        The values of the samples.
    collect
        The arrays to compute and gather: paths, groups, or patterns with `*`; empty: every number under
        `properties` and `parameters`.
    judge
        Test of results against the expectations of the scene; default: they are not tested.

    Returns
    -------
    SampleOutcomes
        One for each sample, in order. A sample that fails is an outcome with its error. No outcome
        depends on what else is run with it.
    """
    if compiled():
        call("dynid_keep_memory", _KEPT_BYTES)
    expected = _expected(template) if judge is not None else []
    paths = tuple(overrides[0]) if overrides else ()
    alike = bool(paths) and all(tuple(override) == paths for override in overrides)
    plan = _plan(template, paths, _requested(collect, expected)) if alike else ""
    outcomes = SampleOutcomes([], len(overrides)) if isinstance(plan, str) else plan.run(overrides)
    if judge is not None and expected:
        outcomes = outcomes.mapped(
            lambda block: replace(
                block,
                met=judge(block, expected, template.kind, template.title),
                values={path: block.values[path] for path in gather(block.result(0), collect)},
            )
        )
    alone = [run_alone(template, overrides[row], collect, judge) for row in outcomes.pending]
    return outcomes.completed(alone)


def why_alone(template: Scene, paths: Sequence[str], collect: tuple[str, ...]) -> str:
    """Return why samples are run one by one; empty where they are run together.

    `paths` are the dotted paths of the values in which the samples differ.
    """
    plan = _plan(template, tuple(paths), _requested(collect, _expected(template)))
    return plan if isinstance(plan, str) else ""


def _plan(scene: Scene, paths: tuple[str, ...], collect: tuple[str, ...]) -> SamplePlan | str:
    """Return the plan of samples, made once a process; or why there is none."""
    if any(path.partition(".")[0] == "expect" for path in paths):
        return "what is expected varies"
    return _planned(_PlanKey(scene.source.resolved_text(), scene.source.file, paths, collect, scene))


@lru_cache(maxsize=4)
def _planned(key: _PlanKey) -> SamplePlan | str:
    make = KINDS[key.scene.kind].load("samples")
    if make is None:
        return f"scenes of kind {key.scene.kind} share nothing"
    try:
        plan: SamplePlan = make(key.scene, key.paths, key.collect)
    except NotShared as reason:
        return str(reason)
    except (DynidError, ArithmeticError):
        return "the scene as it stands cannot be run"
    return plan


def _requested(collect: tuple[str, ...], expected: Expected) -> tuple[str, ...]:
    """Return what to compute: what is collected, and what is expected."""
    return (*(collect or (NUMBERS,)), *(str(item["path"]) for item in expected))


def run_alone(
    template: Scene, override: Mapping[str, Any], collect: tuple[str, ...], judge: _Judge | None = None
) -> SampleOutcome:
    """Load, check and run one sample; only what is collected or expected is computed."""
    try:
        scene = check_source(set_values(template.source, override)) if override else template
        expected = _expected(scene) if judge is not None else []
        run = KINDS[scene.kind].load("run")
        result: Result = run(scene, Selection(scene.kind, _requested(collect, expected)))
        try:
            values = gather(result, collect)
        except UsageError:
            values = gather(run(scene), collect)  # its error names what there is
        if judge is None or not expected:
            return SampleOutcome(values)
        (block,) = SampleOutcomes.of([SampleOutcome(dict(result))]).blocks
        met = judge(block, expected, scene.kind, scene.title)[0]
        return SampleOutcome(values, expectations=tuple(met.tolist()))
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


def run_exemplar(scene: Scene, collect: tuple[str, ...]) -> Mapping[str, Variable]:
    """Return what is collected of the scene as it stands, or raise `NotShared`."""
    exemplar = run_alone(scene, {}, collect)
    if exemplar.error:
        raise NotShared("the scene as it stands cannot be run")
    return exemplar.values


def failed(template: Scene, error: str, exit_code: int) -> SampleOutcome:
    """Return the outcome of a failed sample, with the same message wherever it ran."""
    return SampleOutcome(error=error.replace(f"{template.folder}/", ""), exit_code=exit_code)


def _expected(scene: Scene) -> list[dict[str, Any]]:
    return [item.model_dump(exclude_none=True) for item in scene.model.expect]


SampleColumn = list[Number | None]
"""One value a sample; None where it has none: run alone, the sample reports why."""


def varied_parameter(parameters: Mapping[str, Any], path: Sequence[str]) -> str | None:
    """Return the parameter that a varied path sets to any value; None where it is no such path."""
    match path:
        case ["parameters", name] if name in parameters:
            return name
        case ["parameters", name, key] if isinstance(entry := parameters.get(name), DefinedParameter):
            bounded = entry.min is not None or entry.max is not None or entry.scale == "log"
            if key == entry.reference_key and not bounded:
                return name
    return None


class VariedNumbers:
    """The parameters of samples: constant (`fixed`) ones, those that `paths` set, and those that follow."""

    def __init__(self, source: Source, fixed: Mapping[str, Number], paths: Mapping[str, str]) -> None:
        self.fixed, self._paths = fixed, paths
        raw = reference_values(source.data.get("parameters") or {})
        texts = {name: parse(text) for name, text in raw.items() if isinstance(text, str)}
        order = TopologicalSorter({name: text.names & texts.keys() for name, text in texts.items()})
        #: The expressions of those that depend on varied ones, each after those that it needs.
        self.dependent: dict[str, Expression] = {}
        for name in order.static_order():
            varied = {*paths.values(), *self.dependent}
            if name not in varied and texts[name].names & varied:
                self.dependent[name] = texts[name]

    def at(self, overrides: Overrides) -> dict[str, Number | SampleColumn]:
        """Return the values of samples by name; of parameters that vary one a sample."""
        values: dict[str, Number | SampleColumn] = dict(self.fixed)
        for path, name in self._paths.items():
            values[name] = numbers([override[path] for override in overrides])
        for name, expression in self.dependent.items():
            values[name] = evaluate(expression, values, len(overrides))
        return values


def numbers(raw: Sequence[Any]) -> SampleColumn:
    """Return the values of samples as the decimals they are written as."""
    column: SampleColumn = []
    for value in raw:
        if type(value) is float and math.isfinite(value):  # the quick way to the same fraction
            column.append(Fraction(*Decimal(repr(value)).as_integer_ratio()))
            continue
        try:
            column.append(to_fraction(value))
        except OutOfRangeError:
            column.append(None)
    return column


def evaluate(expression: Expression, values: Mapping[str, Number | SampleColumn], count: int) -> SampleColumn:
    """Return the values of an expression, one a sample: the very numbers of each sample alone."""

    def leaf(item: Fraction | str) -> Number | SampleColumn:
        if isinstance(item, Fraction):
            return item
        return pi() if item == "pi" else values[item]

    def operate(operation: str, operands: list[Number | SampleColumn]) -> Number | SampleColumn:
        if not any(isinstance(operand, list) for operand in operands):
            return apply(operation, operands)  # type: ignore[arg-type]
        columns = [operand if isinstance(operand, list) else [operand] * count for operand in operands]
        results: SampleColumn = []
        for row in zip(*columns, strict=True):
            try:
                results.append(None if any(value is None for value in row) else apply(operation, list(row)))
            except OutOfRangeError:
                results.append(None)
        return results

    found = expression.fold(leaf, operate)
    return found if isinstance(found, list) else [found] * count
