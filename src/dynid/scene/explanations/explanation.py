"""Explanation of a scene before it is run: causality or identifiability, choices, expected cost."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
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


# The probe of `speed` on the machine of the rates of the explanations, s.
_REFERENCE = 1.0e-3
# Runs that are expected to take longer, s, are not tried: parts of them may not report for minutes.
_TRIED = 30.0


@dataclass(frozen=True)
class CostEstimate:
    """Expected cost of a run.

    Without a trial the time is estimated from operation counts and rates measured once, or from parts of the
    work itself; it is right within a factor of a few, with one within a factor of two.

    Parameters
    ----------
    parts
        Seconds of each part of the work, without the start of the program.
    megabytes
        Memory of the process at its peak.
    kilobytes
        Size of the result's file.
    trial
        The beginning of the run, or the whole of it, measured.
    """

    parts: Mapping[str, float]
    megabytes: float
    kilobytes: float
    trial: Trial | None = None

    @property
    def seconds(self) -> float:
        """Seconds of all of it."""
        return sum(self.parts.values()) if self.trial is None else self.trial.seconds


@cache
def speed() -> float:
    """Return the speed of this machine over that of the rates, from a probe of milliseconds."""
    seconds = []
    for _ in range(5):
        began = time.thread_time()
        total = 0
        for k in range(20_000):
            total += k & 7
        seconds.append(time.thread_time() - began)
    return _REFERENCE / min(seconds)


def peak_megabytes() -> float:
    """Return the peak memory of the process so far, MB; a guess where the system does not report it."""
    try:
        import resource
    except ImportError:  # not on every system
        return 100.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def file_kilobytes(arrays: int, values: float) -> float:
    """Return the size of a result file, kB, from its numbers of arrays and values (complex ones are two)."""
    return 8.0 + 0.8 * arrays + 8 * values / 1000


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
    """Explanation of a scene before it is run.

    Parameters
    ----------
    result
        Causality or identifiability, where a run has them, too.
    facts
        The rest in words, in the order of the work.
    cost
        Expected cost of a run; None where it is bound to fail.
    obstacle
        The error that the run is bound to raise; None where none is known.
    """

    result: Result
    facts: Sequence[Fact]
    cost: CostEstimate | None = None
    obstacle: DynidError | None = field(default=None)


def explain(scene: Scene, *, trying: bool = False) -> Explanation:
    """Return the explanation of a valid scene, of any kind but `study`.

    Parameters
    ----------
    scene
        The scene.
    trying
        True: its time is measured by a trial run, of a few seconds at the most.

    Returns
    -------
    Explanation
        The model, the choices, the results and the expected cost. Where the run is bound to fail, its
        `obstacle` is the error.

    Raises
    ------
    FileError
        Where a file that the scene names cannot be read.
    """
    try:
        explained: Explanation = KINDS[scene.kind].load("explain")(scene)
    except (NumericalError, UsageError) as error:  # before any fact is known
        return Explanation(Result(scene.kind, scene.title), [], obstacle=error)
    cost = explained.cost
    if trying and cost is not None and is_tried(cost):
        explained = replace(explained, cost=replace(cost, trial=trial(scene)))
    explained.result.attrs["scene"] = scene.source.resolved_text()  # screens look up its frequency unit
    tried = getattr(scene.model, "accuracy", None)
    if tried is None:
        return explained
    what = ", ".join(tried.alternatives or aspects_of(scene.source.data))
    fact = Fact("accuracy", f"alternatives of {what} are tried after it, for at most {tried.budget:g} s")
    return replace(explained, facts=[*explained.facts, fact])


def is_tried(cost: CostEstimate) -> bool:
    """Return True for a run that is expected to be short enough for a trial."""
    return cost.seconds < _TRIED


#: Longest trial, processor seconds.
LIMIT = 5.0
#: Steps of an attempt with those of its noise model, and attempts of a search.
_STEPS, _ATTEMPTS = 40, 6
_START, _STEP = re.compile(r"start (\d+) of (\d+)"), re.compile("maximum likelihood, step")


class Report(NamedTuple):
    """A report of progress: the work begun, and the time, s."""

    what: str
    at: float


class Trial(NamedTuple):
    """The forecast of a run: its `seconds`, the `steps` that were seen, and True where it was `complete`."""

    seconds: float
    steps: int
    complete: bool


class _Enough(BaseException):
    """Ends a trial; no handler of errors takes it for one."""


def trial(
    scene: Scene,
    limit: float = LIMIT,
    clock: Callable[[], float] = time.process_time,
    heard: Listener | None = None,
) -> Trial | None:
    """Return the forecast of the time of a run, which is begun and cut off at a limit.

    Parameters
    ----------
    scene
        The scene.
    limit
        Longest trial, s.
    clock
        Returns the time, s.
    heard
        Receives the progress of the run, too.

    Returns
    -------
    Trial or None
        None if the run fails.
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
            run_scene(scene)
    except _Enough:
        return Trial(forecast(reports), len(reports), complete=False)
    except DynidError:
        return None
    return Trial(clock() - began, len(reports), complete=True)


def forecast(reports: Sequence[Report]) -> float:
    """Return the expected time of a whole run, s, from the reports of its beginning.

    Starts of a search are ranked one after the other; each attempt then takes steps of maximum likelihood.
    """
    spent = reports[-1].at
    durations = [after.at - before.at for before, after in pairwise(reports)]
    steps = [each for report, each in zip(reports, durations, strict=False) if _STEP.match(report.what)]
    step = sum(steps) / len(steps) if steps else spent / max(1, len(durations))
    places = [place for place, report in enumerate(reports[:-1]) if _START.fullmatch(report.what)]
    if not places:
        return spent + max(_STEPS - len(steps), len(steps)) * step
    begun = [place for place in places if _STEP.match(reports[place + 1].what)]
    if not begun:
        number, count = map(int, _START.findall(reports[places[-1]].what)[0])
        return (
            spent + (count - number) * min(durations[place] for place in places) + _ATTEMPTS * _STEPS * step
        )
    attempt = (spent - reports[begun[0]].at) / len(begun)
    return spent + max(1, _ATTEMPTS - len(begun)) * attempt
