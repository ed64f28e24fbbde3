"""Trial run of a scene: its time measured, or forecast from the work that a limited time suffices for.

Estimates from operation counts depend on rates of one machine, and the number of steps of a search on the
data. So the run itself is begun. Most scenes end within the limit: then their time is known. Otherwise the
steps so far, each timed, are extrapolated to the number that such a run takes.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from dynid.errors import DynidError
from dynid.progress import progress_to

if TYPE_CHECKING:
    from dynid.scene.load import Scene

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


def trial(scene: Scene, limit: float = LIMIT, clock: Callable[[], float] = time.process_time) -> Trial | None:
    """Return the forecast of the time of a run, which is begun and cut off at a limit.

    Parameters
    ----------
    scene
        The scene.
    limit
        Longest trial, s.
    clock
        Returns the time, s.

    Returns
    -------
    Trial or None
        None if the run fails.
    """
    from dynid.scene.run import run_scene

    began = clock()
    reports = [Report("", 0.0)]

    def heard(what: str) -> None:
        reports.append(Report(what, clock() - began))
        if reports[-1].at > limit:
            raise _Enough

    try:
        with progress_to(heard):
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
