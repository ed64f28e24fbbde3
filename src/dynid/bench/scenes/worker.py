"""Worker process that runs alternatives of a scene, one per request."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

from dynid.bench.process import serve
from dynid.bench.scenes.aspects import Aspect
from dynid.errors import DynidError
from dynid.scene.kind import KINDS
from dynid.scene.load import Scene, check_source
from dynid.scene.schema.accuracy import aspects_of
from dynid.scene.yaml.source import Source
from dynid.structure.comparison import measured

#: A first run shorter than this, s, is mostly loading and compiling: a second one is timed.
_LONG = 0.5


class TrialRequest(NamedTuple):
    """The alternative to run, and its size."""

    aspect: str
    alternative: str
    size: int


class TrialResult(NamedTuple):
    """Time, s, rise of the peak memory, B, and the result; or the reason of a failure."""

    time: float = 0.0
    memory: float = 0.0
    found: Any = None
    failed: str = ""


def aspect_of(scene: Scene, name: str) -> Aspect:
    """Return an aspect of a scene."""
    found: Aspect = KINDS[scene.kind].load("alternatives")[name](scene)
    return found


class Worker:
    """Receives the scene first, then requests."""

    def __call__(self, asked: Source | TrialRequest) -> TrialResult:
        """Store the scene, or serve a request."""
        if isinstance(asked, Source):
            scene = check_source(asked)
            self._aspects = {name: aspect_of(scene, name) for name in aspects_of(asked.data)}
            return TrialResult()
        points = self._aspects[asked.aspect].points
        wanted = (asked.alternative, asked.size)
        chosen = next(each for each, size in points if (each.name, size) == wanted)
        try:
            return _tried(chosen.prepare(asked.size))
        except (DynidError, ArithmeticError, ValueError, MemoryError) as error:
            return TrialResult(failed=" ".join(str(error).split()) or type(error).__name__)


def _tried(work: Callable[[], Any]) -> TrialResult:
    with measured() as cost:
        found = work()
    seconds = cost.seconds
    if seconds < _LONG:
        before = perf_counter()
        work()
        seconds = perf_counter() - before
    return TrialResult(seconds, 1024**2 * (cost.peak_megabytes or 0.0), found)


def main() -> None:
    """Serve requests until there are no more."""
    serve(Worker())
