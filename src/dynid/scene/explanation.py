"""Explanation of a scene before it is run: causality or identifiability, choices, and a trial run."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from dynid.errors import DynidError, NumericalError, UsageError
from dynid.number_format import counted
from dynid.progress import Listener, progress_to
from dynid.result import Result
from dynid.scene.kind import KINDS
from dynid.scene.schema.base import aspects_of

if TYPE_CHECKING:
    from dynid.scene.load import Scene
    from dynid.structure.model import StructuralModel


class Fact(NamedTuple):
    """A line of an explanation: its `topic`, of a word or two, and its text."""

    topic: str
    text: str


def node_facts(structure: StructuralModel) -> list[Fact]:
    """Return what the file of nodes of a structure says beside them, and what contradicts them."""
    nodes = structure.nodes
    if nodes is None or not (nodes.notes or nodes.doubts):
        return []
    said = "; ".join((counted(len(nodes.numbers), "node"), *nodes.notes))
    return [Fact("nodes", said), *(Fact("warning", doubt) for doubt in nodes.doubts)]


@dataclass(frozen=True)
class Explanation:
    """Explanation of a scene before it is run."""

    result: Result  #: Causality or identifiability, where a run has them, too.
    facts: Sequence[Fact]  #: The rest in words, in the order of the work.
    obstacle: DynidError | None = None  #: The error that the run is bound to raise; None where none is known.


def explain(scene: Scene) -> Explanation:
    """Return the explanation of a valid scene, of any kind but `study`.

    Where the run is bound to fail, its `obstacle` is the error. Raises `FileError` where a file that the
    scene names cannot be read.
    """
    try:
        explained: Explanation = KINDS[scene.kind].load("explain")(scene)
    except (NumericalError, UsageError) as error:  # before any fact is known
        return Explanation(Result(scene.kind, scene.title), [], obstacle=error)
    explained.result.attrs["scene"] = scene.source.resolved_text()  # screens look up its frequency unit
    tried = getattr(scene.model, "accuracy", None)
    if tried is None:
        return explained
    what = ", ".join(tried.alternatives or aspects_of(scene.model))
    fact = Fact("accuracy", f"alternatives of {what} are tried after it, for at most {tried.budget:g} s")
    return replace(explained, facts=[*explained.facts, fact])


#: Longest trial, processor seconds.
TRIAL_SECONDS = 5.0
#: Steps of an attempt with those of its noise model, and attempts of a search.
_STEPS, _ATTEMPTS = 40, 6
_START, _STEP = re.compile(r"start (\d+) of (\d+)"), re.compile("maximum likelihood, step")
# Reports within a step.
_BLOCK = re.compile("sensitivities, block")


class Report(NamedTuple):
    """A report of progress: the work begun, and the time, s."""

    what: str
    at: float


class Cost(NamedTuple):
    """Cost of a run by a trial."""

    #: Its time without the start of the program, right within a factor of two where it is extrapolated.
    seconds: float
    megabytes: float  #: Peak memory of the process.
    #: Size of the result's file; None where the trial was cut off before there was a result.
    kilobytes: float | None
    source: str  #: The origin of the figures in words, such as `measured by a trial run`.


class _Enough(BaseException):
    """Ends a trial; no handler of errors takes it for one."""


def trial(
    scene: Scene,
    limit: float = TRIAL_SECONDS,
    clock: Callable[[], float] = time.process_time,
    heard: Listener | None = None,
) -> Cost:
    """Begin a run, cut it off at a limit, and return its cost.

    `limit` is the longest trial, s; `clock` returns the time, s; `heard` receives the progress, too. Raises
    `DynidError` as of the run.
    """
    from dynid.scene.run import run_scene

    began = clock()
    reports = [Report("", 0.0)]

    def hear(what: str) -> None:
        if heard is not None:
            heard(what)
        reports.append(Report(what, clock() - began))
        if reports[-1].at > limit:
            raise _Enough

    try:
        with progress_to(hear):
            result = run_scene(scene)
    except _Enough:
        return Cost(forecast(reports), peak_megabytes(), None, "from the beginning of a trial run")
    arrays = [array.data.nbytes for array in result.values()]
    kilobytes = file_kilobytes(len(arrays), sum(arrays))
    return Cost(clock() - began, peak_megabytes(), kilobytes, "measured by a trial run")


def peak_megabytes() -> float:
    """Return the peak memory of the process so far, MB; a guess where the system does not report it."""
    try:
        import resource
    except ImportError:  # not on every system
        return 100.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def file_kilobytes(arrays: int, size: float) -> float:
    """Return the size of a result file, kB, from its number of arrays and their bytes."""
    return 8.0 + 0.8 * arrays + size / 1000


def forecast(reports: Sequence[Report]) -> float:
    """Return the expected time of a whole run, s, from the reports of its beginning.

    Starts of a search are ranked one after the other; each attempt then takes steps of maximum likelihood.
    """
    spent = reports[-1].at
    reports = [*(report for report in reports[:-1] if not _BLOCK.match(report.what)), reports[-1]]
    durations = [after.at - before.at for before, after in pairwise(reports)]
    pairs = zip(reports, durations, strict=False)
    steps = [duration for report, duration in pairs if _STEP.match(report.what)]
    step = sum(steps) / len(steps) if steps else spent / max(1, len(durations))
    places = [index for index, report in enumerate(reports[:-1]) if _START.fullmatch(report.what)]
    if not places:
        return spent + max(_STEPS - len(steps), len(steps)) * step
    begun = [index for index in places if _STEP.match(reports[index + 1].what)]
    if not begun:
        number, count = map(int, _START.findall(reports[places[-1]].what)[0])
        fastest = min(durations[index] for index in places)
        return spent + (count - number) * fastest + _ATTEMPTS * _STEPS * step
    attempt = (spent - reports[begun[0]].at) / len(begun)
    return spent + max(1, _ATTEMPTS - len(begun)) * attempt
