"""Measurement of the alternatives to the choices of a scene, one by one within a budget of time.

A worker process runs the alternatives, one per request.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from statistics import median
from time import monotonic, perf_counter
from typing import Any, Self, TypeAlias

import numpy as np

from dynid.bench.scenes.aspects import Aspect
from dynid.bench.suite import BenchmarkFigure, add_figures, pareto
from dynid.errors import DynidError
from dynid.result import Result
from dynid.scene.kind import KINDS
from dynid.scene.load import Scene, check_source
from dynid.scene.schema.base import ASPECTS, AccuracyModel, aspects_of
from dynid.scene.yaml.source import Source
from dynid.structure.reduction_comparison import measured
from dynid.trial import ChildProcess, ProcessDied, TimeLimitExceeded

#: The part of the remaining time that a chosen alternative may take; and the multiple of an equal share that
#: any other may take, so that a slow one leaves time to the others.
_MAX_SHARE, _FAIR_SHARES = 0.5, 2.0

#: Expected time of a further run relative to the longest so far.
_MARGIN = 1.5

#: After a first run shorter than this, s, which is mostly loading and compiling, a second one is timed.
_MIN_TIMED_SECONDS = 0.5

Key: TypeAlias = tuple[str, int]
"""Name and size of an alternative."""


def aspect_of(scene: Scene, name: str) -> Aspect:
    """Return an aspect of a scene."""
    aspect: Aspect = KINDS[scene.kind].load("alternatives")[name](scene)
    return aspect


def add_accuracy(
    result: Result,
    scene: Scene,
    options: AccuracyModel | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> None:
    """Add the alternatives to the choices of a run, with their costs and errors.

    `options` are those of the scene's block `accuracy`, by default; `progress` is called with a line before
    each measurement.

    Notes
    -----
    ``accuracy/<aspect>/<alternative>/{size, time, memory, error, pareto, chosen}``, as of a benchmark;
    `error` is missing without a number, `bound` is the least error to be expected, where it is known.
    ``accuracy/<aspect>/{alternative, status}`` lists all alternatives: ``done``, or the reason why there are
    no figures. Attributes of ``accuracy/<aspect>``: the choices and their reasons, the definition of the
    error, and its reference: the most accurate alternative that succeeded.
    """
    asked = options or getattr(scene.model, "accuracy", None) or AccuracyModel()
    requested = asked.alternatives or dict.fromkeys(ASPECTS[scene.kind])
    aspects = {}
    for name in aspects_of(scene.model):
        if name in requested:
            aspect, names = aspect_of(scene, name), requested[name]
            if isinstance(names, list):  # the requested alternatives and the chosen ones
                points = aspect.points
                kept = [p for p in points if p[0].name in names or (p[0].name, p[1]) in aspect.chosen]
                aspect = replace(aspect, points=kept)
            aspects[name] = aspect
    with _Trial(scene, aspects, asked.budget, progress) as trial:
        trial.run(asked.repeats)
    for name, aspect in aspects.items():
        _add(result, f"accuracy/{name}", aspect, trial.tries[name])
    result.annotate("accuracy", repeats=asked.repeats, budget=asked.budget)


@dataclass
class _Try:
    """The outcome of one alternative at one size, with the times of its runs, s; or why it failed."""

    times: list[float] = field(default_factory=list)
    memory: float = 0.0  # rise of the peak, B
    result: Any = None
    failed: str = ""

    @property
    def time(self) -> float:
        """The median time, s."""
        return median(self.times)


class _Trial:
    """Measurement of all alternatives in turns, in a process that is restarted after it had to be stopped."""

    def __init__(
        self, scene: Scene, aspects: Mapping[str, Aspect], budget: float, progress: Callable[[str], None]
    ) -> None:
        self._scene, self._budget, self._progress = scene, budget, progress
        self._deadline = monotonic() + budget
        self._process: ChildProcess | None = None
        self.tries: dict[str, dict[Key, _Try]] = {
            name: {
                (alternative.name, size): _Try(failed=alternative.missing())
                for alternative, size in aspect.points
            }
            for name, aspect in aspects.items()
        }
        trials = [(name, key, key in aspects[name].chosen) for name in aspects for key in self.tries[name]]
        #: The alternatives in the order of the trials, the chosen ones first.
        self._order = sorted(trials, key=lambda item: not item[2])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    @property
    def _left(self) -> float:
        return self._deadline - monotonic()

    def run(self, repeats: int) -> None:
        """Run every alternative once, and again within the budget of time."""
        for position, (aspect, key, chosen) in enumerate(self._order):
            share = _MAX_SHARE if chosen else min(_MAX_SHARE, _FAIR_SHARES / (len(self._order) - position))
            self._try(aspect, key, share)
        for _ in range(repeats - 1):
            for aspect, key, _chosen in self._order:
                trial = self.tries[aspect][key]
                if trial.times and _MARGIN * max(trial.times) < self._left:
                    self._try(aspect, key, 1.0)

    def _try(self, aspect: str, key: Key, share: float) -> None:
        trial = self.tries[aspect][key]
        if trial.failed:
            return
        if self._process is None and self._left > 0:
            self._process = ChildProcess()
            self._call(self._left, _load_aspects, self._scene.source)
        if self._left <= 0 or self._process is None:
            trial.failed = f"not run: the budget of {self._budget:g} s was used up"
            return
        self._progress(f"{aspect}: {key[0]}, {key[1]:,}")
        answer: _Try | None = self._call(share * self._left, _measured, aspect, key)
        if answer is None:
            if not trial.times:
                trial.failed = f"not run to its end: too slow for the budget of {self._budget:g} s"
        elif answer.failed:
            trial.failed = answer.failed
        else:
            if not trial.times:
                trial.memory, trial.result = answer.memory, answer.result
            trial.times += answer.times

    def _call(self, seconds: float, call: Callable[..., Any], *arguments: Any) -> Any:
        """Return the value of a call in the process; None where it ended, or was stopped after `seconds`."""
        assert self._process is not None
        try:
            return self._process.run(seconds, call, *arguments)
        except (TimeLimitExceeded, ProcessDied):
            self._close()
            return None

    def _close(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None


def _add(result: Result, group: str, aspect: Aspect, tries: Mapping[Key, _Try]) -> None:
    results = {key: row.result for key, row in tries.items() if row.times}
    reference = next((key for key, it in results.items() if aspect.error(it, it) is not None), None)
    figures = {}
    for key, it in results.items():
        tried, error = tries[key], None if reference is None else aspect.error(it, results[reference])
        size, error = key[1], np.nan if error is None else error
        figures[key] = BenchmarkFigure(size, tried.time, tried.memory, error)
    names = list(dict.fromkeys(name for name, _ in tries))
    result.add_axis(f"{group}/alternative", names)
    result.add(f"{group}/status", [_status(name, tries) for name in names], ("alternative",))
    result.annotate(group, title=aspect.title, size=aspect.size, measure=aspect.measure)
    result.annotate(group, because=aspect.because, reference=reference[0] if reference else "")
    # All sizes do the same work here.
    front = pareto(replace(row, size=0) for row in figures.values() if np.isfinite(row.error))
    for name in names:
        keys = sorted(key for key in figures if key[0] == name)
        if not keys:
            continue
        here = f"{group}/{name}"
        rows = [figures[key] for key in keys]
        add_figures(result, here, rows, errors=not any(np.isnan(row.error) for row in rows))
        bounds = [bound for key in keys if (bound := aspect.least_error(results[key])) is not None]
        if len(bounds) == len(keys):
            result.add(f"{here}/bound", np.array(bounds, dtype=float), ("size",))
        result.add(f"{here}/runs", [len(tries[key].times) for key in keys], ("size",))
        result.add(f"{here}/pareto", [replace(figures[key], size=0) in front for key in keys], ("size",))
        result.add(f"{here}/chosen", [key in aspect.chosen for key in keys], ("size",))


def _status(name: str, tries: Mapping[Key, _Try]) -> str:
    """Return the status of an alternative, with its size where sizes differ."""
    failures = {
        size: trial.failed for (other_name, size), trial in sorted(tries.items()) if other_name == name
    }
    sizes = {
        text: [f"{size:,}" for size in failures if failures[size] == text]
        for text in dict.fromkeys(failures.values())
    }
    if len(sizes) == 1:
        return next(iter(sizes)) or "done"
    return "; ".join(f"{', '.join(which)}: {text}" for text, which in sizes.items() if text)


#: The aspects of the scene, in the process that runs the alternatives.
_ASPECTS: dict[str, Aspect] = {}


def _load_aspects(source: Source) -> None:
    scene = check_source(source)
    _ASPECTS.update({name: aspect_of(scene, name) for name in aspects_of(scene.model)})


def _measured(aspect: str, key: Key) -> _Try:
    points = _ASPECTS[aspect].points
    chosen = next(alternative for alternative, size in points if (alternative.name, size) == key)
    try:
        work = chosen.prepared(key[1])
        with measured() as cost:
            result = work()
        seconds = cost.seconds
        if seconds < _MIN_TIMED_SECONDS:
            before = perf_counter()
            work()
            seconds = perf_counter() - before
    except (DynidError, ArithmeticError, ValueError, MemoryError) as error:
        return _Try(failed=" ".join(str(error).split()) or type(error).__name__)
    return _Try([seconds], 1024**2 * (cost.peak_megabytes or 0.0), result)
