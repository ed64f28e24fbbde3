"""The alternatives to the choices of a scene, measured one after the other within a budget of time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isnan
from statistics import median
from time import monotonic
from typing import Any, Self, TypeAlias

import numpy as np

from dynid.bench.process import Process
from dynid.bench.scenes.aspects import Aspect
from dynid.bench.scenes.worker import TrialRequest, TrialResult, aspect_of
from dynid.bench.suite import BenchmarkFigure, pareto
from dynid.result import Result
from dynid.scene.load import Scene
from dynid.scene.schema.accuracy import ASPECTS, AccuracyModel, aspects_of

_WORKER = "dynid.bench.scenes.worker"
#: The part of the time left that a choice made may take; and how often its fair share any other may, so that
#: a slow one leaves some to the others.
_SHARE, _FAIR = 0.5, 2.0

#: What a run may take beyond the longest so far.
_MARGIN = 1.5

Key: TypeAlias = tuple[str, int]
"""Name and size of an alternative."""


def add_accuracy(
    result: Result,
    scene: Scene,
    options: AccuracyModel | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> None:
    """Add the alternatives to the choices of a run, with their costs and errors.

    Parameters
    ----------
    result
        The result of the scene.
    scene
        The scene.
    options
        Which alternatives, how often, and how long in all; absent: the scene's block `accuracy`, else all.
    tell
        Called with a line before each measurement.

    Notes
    -----
    ``accuracy/<aspect>/<alternative>/{size, time, memory, error, pareto, chosen}``, as of a benchmark;
    `error` is missing where no number was found, `bound` is the least to be expected, where that is known.
    ``accuracy/<aspect>/{alternative, status}`` lists all alternatives: ``done``, or why there are no
    figures. Attributes of ``accuracy/<aspect>`` say what is chosen and why, what the error is, and which
    alternative it is taken against: the most trustworthy one that came to an end.
    """
    asked = options or getattr(scene.model, "accuracy", None) or AccuracyModel()
    wanted = asked.alternatives or dict.fromkeys(ASPECTS[scene.kind])
    aspects = {
        name: _restricted(aspect_of(scene, name), wanted[name])
        for name in aspects_of(scene.source.data)
        if name in wanted
    }
    with _Trial(scene, aspects, asked.budget, tell) as trial:
        trial.run(asked.repeats)
    for name, aspect in aspects.items():
        _add(result, f"accuracy/{name}", aspect, trial.tries[name])
    result.annotate("accuracy", repeats=asked.repeats, budget=asked.budget)


def _restricted(aspect: Aspect, wanted: list[str] | str | None) -> Aspect:
    """Return an aspect with the requested alternatives and the choice made."""
    if wanted is None or isinstance(wanted, str):
        return aspect
    kept = [p for p in aspect.points if p[0].name in wanted or (p[0].name, p[1]) in aspect.chosen]
    return replace(aspect, points=kept)


@dataclass
class _Try:
    """The outcome of one alternative at one size, with the times of its runs."""

    answer: TrialResult | None = None
    times: list[float] = field(default_factory=list)
    failed: str = ""

    @property
    def time(self) -> float:
        """The median time, s."""
        return median(self.times)


class _Trial:
    """The process that tries alternatives, in turns; it is restarted after it had to be stopped."""

    def __init__(
        self, scene: Scene, aspects: Mapping[str, Aspect], budget: float, tell: Callable[[str], None]
    ) -> None:
        self._scene, self._budget, self._tell = scene, budget, tell
        self._deadline = monotonic() + budget
        self._process: Process | None = None
        self.tries: dict[str, dict[Key, _Try]] = {
            name: {(each.name, size): _Try(failed=each.missing()) for each, size in aspect.points}
            for name, aspect in aspects.items()
        }
        every = [(name, key, key in aspects[name].chosen) for name in aspects for key in self.tries[name]]
        #: What to try, the choices made first.
        self._order = sorted(every, key=lambda item: not item[2])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._close()

    @property
    def _left(self) -> float:
        return self._deadline - monotonic()

    def run(self, repeats: int) -> None:
        """Run everything once, and again within the budget of time."""
        for place, (aspect, key, chosen) in enumerate(self._order):
            part = _SHARE if chosen else min(_SHARE, _FAIR / (len(self._order) - place))
            self._try(aspect, key, part)
        for _ in range(repeats - 1):
            for aspect, key, _chosen in self._order:
                found = self.tries[aspect][key]
                if found.times and _MARGIN * max(found.times) < self._left:
                    self._try(aspect, key, 1.0)

    def _try(self, aspect: str, key: Key, part: float) -> None:
        found = self.tries[aspect][key]
        if found.failed:
            return
        if self._left <= 0 or not self._is_begun():
            found.failed = f"not run: the budget of {self._budget:g} s was used up"
            return
        assert self._process is not None
        self._tell(f"{aspect}: {key[0]}, {key[1]:,}")
        answer: TrialResult | None = self._process.ask(
            TrialRequest(aspect, *key), max(0.0, part * self._left)
        )
        if answer is None:
            self._close()
            if not found.times:
                found.failed = f"not run to its end: too slow for the budget of {self._budget:g} s"
        elif answer.failed:
            found.failed = answer.failed
        else:
            found.answer = found.answer or answer
            found.times.append(answer.time)

    def _is_begun(self) -> bool:
        if self._process is None:
            self._process = Process(_WORKER)
            if self._process.ask(self._scene.source, self._left) is None:
                self._close()
        return self._process is not None

    def _close(self) -> None:
        if self._process is not None:
            self._process.close()
            self._process = None


def _add(result: Result, group: str, aspect: Aspect, tries: Mapping[Key, _Try]) -> None:
    found = {key: each.answer.found for key, each in tries.items() if each.answer is not None}
    reference = next((key for key, it in found.items() if aspect.error(it, it) is not None), None)
    figures = {
        key: _figure(aspect, key, tries[key], None if reference is None else found[reference])
        for key in found
    }
    names = list(dict.fromkeys(name for name, _ in tries))
    result.add_axis(f"{group}/alternative", names)
    result.add(f"{group}/status", [_status(name, tries) for name in names], ("alternative",))
    result.annotate(group, title=aspect.title, size=aspect.size, measure=aspect.measure)
    result.annotate(group, because=aspect.because, reference=reference[0] if reference else "")
    # A size is how the work is done here, and not other work.
    front = pareto(replace(each, size=0) for each in figures.values() if np.isfinite(each.error))
    for name in names:
        keys = sorted(key for key in figures if key[0] == name)
        if not keys:
            continue
        here = f"{group}/{name}"
        result.add_axis(f"{here}/size", [size for _, size in keys])
        for column, values, units in _columns(aspect, keys, figures, found):
            result.add(f"{here}/{column}", np.array(values, dtype=float), ("size",), units)
        result.add(f"{here}/runs", [len(tries[key].times) for key in keys], ("size",))
        result.add(f"{here}/pareto", [replace(figures[key], size=0) in front for key in keys], ("size",))
        result.add(f"{here}/chosen", [key in aspect.chosen for key in keys], ("size",))


def _figure(aspect: Aspect, key: Key, tried: _Try, reference: Any) -> BenchmarkFigure:
    assert tried.answer is not None
    error = None if reference is None else aspect.error(tried.answer.found, reference)
    return BenchmarkFigure(key[1], tried.time, tried.answer.memory, float("nan") if error is None else error)


def _columns(
    aspect: Aspect, keys: Sequence[Key], figures: Mapping[Key, BenchmarkFigure], found: Mapping[Key, Any]
) -> Iterator[tuple[str, list[float], str]]:
    """Yield the figures of an alternative, each with its unit; without those that have no value."""
    rows = [figures[key] for key in keys]
    yield "time", [row.time for row in rows], "s"
    yield "memory", [row.memory for row in rows], "B"
    if not any(isnan(row.error) for row in rows):
        yield "error", [row.error for row in rows], ""
    bounds = [bound for key in keys if (bound := aspect.yardstick(found[key])) is not None]
    if len(bounds) == len(keys):
        yield "bound", bounds, ""


def _status(name: str, tries: Mapping[Key, _Try]) -> str:
    """Return the status of an alternative, with its size where sizes differ."""
    own = {size: each.failed for (other, size), each in sorted(tries.items()) if other == name}
    sizes = {text: [f"{size:,}" for size in own if own[size] == text] for text in dict.fromkeys(own.values())}
    if len(sizes) == 1:
        return next(iter(sizes)) or "done"
    return "; ".join(f"{', '.join(which)}: {text}" for text, which in sizes.items() if text)
