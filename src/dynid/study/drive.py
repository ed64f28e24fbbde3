"""Samples to workers and outcomes back, whatever becomes of the workers."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError
from dynid.scene.outcomes import Outcome, Outcomes
from dynid.study.chunks import Chunks
from dynid.study.packing import Packed, packed
from dynid.study.work import Done, Job, run_chunk

if TYPE_CHECKING:
    from dynid.study.executors import Crew
    from dynid.study.plan import Plan

_ATTEMPTS = 3  # of a sample whose worker dies each time
_HOPELESS = 5  # samples given up in a row: it is not they

Numbers = NDArray[np.int64]
#: Chunks that have come back: the numbers of their samples in the plan, and what became of them.
Chunk = tuple[Numbers, Packed]
Arrived = Callable[[list[Chunk]], None]


def drive(crew: Crew, job: Job, plan: Plan, numbers: Numbers, arrived: Arrived) -> None:
    """Run samples of a plan.

    A chunk whose worker died is run again with nothing beside it; if its worker dies again, halves of it
    are, until the sample is found that workers die of. That one has failed after a few attempts.

    Parameters
    ----------
    crew
        What runs them.
    job
        What they share.
    plan
        The plan.
    numbers
        The samples to run.
    arrived
        Is called with the outcomes as they come, of many samples at a time.

    Raises
    ------
    NumericalError
        Where workers die whatever they run.
    FileError
        Where the crew as a whole is gone.
    """
    _Drive(crew, job, plan, numbers, arrived).run()


class _Drive:
    def __init__(self, crew: Crew, job: Job, plan: Plan, numbers: Numbers, arrived: Arrived) -> None:
        self.crew = crew
        self.job = job
        self.plan = plan
        self.numbers = numbers
        self.arrived = arrived
        self.chunks = Chunks()
        self.next = 0
        self.flying: dict[Future[Any], Numbers] = {}
        self.suspects: deque[Numbers] = deque()
        self.alone: Numbers | None = None  # the suspect that flies alone
        self.deaths: Counter[int] = Counter()
        self.given_up = 0  # in a row

    def run(self) -> None:
        while self._launch():
            landed, _ = wait(self.flying, return_when=FIRST_COMPLETED)
            self._land(landed)

    def _launch(self) -> bool:
        """Keep workers busy; a suspect flies alone."""
        if self.suspects:
            if not self.flying:
                self.alone = self.suspects.popleft()
                self._submit(self.alone)
            return True
        while len(self.flying) < self.crew.ahead and self.next < len(self.numbers):
            size = self.chunks.size(len(self.numbers) - self.next, self.crew.width)
            chunk = self.numbers[self.next : self.next + size]
            self.next += len(chunk)
            self._submit(chunk)
        return bool(self.flying)

    def _submit(self, chunk: Numbers) -> None:
        try:
            future = self.crew.submit(run_chunk, self.job, self.plan.overrides(chunk))
        except Exception as error:
            if not self.crew.has_died(error):
                self.crew.refuse(error)
                raise
            future = Future()
            future.set_exception(error)
        self.flying[future] = chunk

    def _land(self, landed: set[Future[Any]]) -> None:
        came: list[Chunk] = []
        lost = []
        for future in landed:
            chunk = self.flying.pop(future)
            try:
                done: Done = future.result()
            except BaseException as error:
                if not self.crew.has_died(error):
                    self.crew.refuse(error)
                    raise
                lost.append(chunk)
                continue
            self.chunks.learn(len(chunk), done.seconds, len(done.outcomes.content))
            self.given_up = 0
            came.append((chunk, done.outcomes))
        if came:
            self.arrived(came)
        if lost:
            self.crew.replace()
            self._suspect(lost)

    def _suspect(self, lost: list[Numbers]) -> None:
        """Take up chunks whose worker died; one that flew alone is divided, or counted against its sample."""
        for chunk in lost:
            if chunk is not self.alone:
                self.suspects.append(chunk)
            elif len(chunk) > 1:
                half = len(chunk) // 2
                self.suspects.extendleft([chunk[half:], chunk[:half]])
            else:
                self._count(chunk)

    def _count(self, chunk: Numbers) -> None:
        number = int(chunk[0])
        self.deaths[number] += 1
        if self.deaths[number] < _ATTEMPTS:
            self.suspects.appendleft(chunk)
            return
        self.given_up += 1
        if self.given_up == _HOPELESS:
            raise NumericalError(
                f"workers die whatever they run ({_ATTEMPTS * _HOPELESS} times in a row)",
                remedy="See what kills them: too little memory, or a damaged installation. "
                "Run the study again then: it goes on.",
            )
        error = f"its worker died {_ATTEMPTS} times: it was killed, or ran out of memory"
        self.arrived([(chunk, packed(Outcomes.of([Outcome(error=error, exit_code=3)])))])
