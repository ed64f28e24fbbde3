"""A process that tries alternatives to the choices of a scene, one at a time, as it is asked."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from time import perf_counter
from typing import Any, NamedTuple

from dynid.bench.process import serve
from dynid.bench.scenes.aspect import Aspect
from dynid.errors import DynidError
from dynid.scene.load import Scene, check_source
from dynid.scene.schema.accuracy import aspects_of
from dynid.scene.yaml.source import Source
from dynid.structure.reduction.cost import measured

#: A first run shorter than this is followed by one that is timed, s: loading and compiling is much of it.
_LONG = 0.5
_KINDS = {
    "bond-graph": "dynid.bench.scenes.bond_graph",
    "identification": "dynid.bench.scenes.identification",
    "reduction": "dynid.bench.scenes.reduction",
}


class Question(NamedTuple):
    """What to try."""

    aspect: str
    alternative: str
    size: int


class Answer(NamedTuple):
    """Time, s, rise of the peak memory, B, and what was found; or why there is nothing."""

    time: float = 0.0
    memory: float = 0.0
    found: Any = None
    failed: str = ""


def aspect_of(scene: Scene, name: str) -> Aspect:
    """Return one of the things that are chosen in a scene."""
    found: Aspect = import_module(_KINDS[scene.kind]).ASPECTS[name](scene)
    return found


class Worker:
    """Answers: first it is given the scene, then questions."""

    def __call__(self, asked: Source | Question) -> Answer:
        """Take over a scene, or answer a question."""
        if isinstance(asked, Source):
            scene = check_source(asked)
            self._aspects = {name: aspect_of(scene, name) for name in aspects_of(asked.data)}
            return Answer()
        points = self._aspects[asked.aspect].points
        wanted = (asked.alternative, asked.size)
        chosen = next(each for each, size in points if (each.name, size) == wanted)
        try:
            return _tried(chosen.prepare(asked.size))
        except (DynidError, ArithmeticError, ValueError, MemoryError) as error:
            return Answer(failed=" ".join(str(error).split()) or type(error).__name__)


def _tried(work: Callable[[], Any]) -> Answer:
    with measured() as cost:
        found = work()
    seconds = cost.seconds
    if seconds < _LONG:
        before = perf_counter()
        work()
        seconds = perf_counter() - before
    return Answer(seconds, 1024**2 * (cost.peak_megabytes or 0.0), found)


def main() -> None:
    """Answer until there are no more questions."""
    serve(Worker())
