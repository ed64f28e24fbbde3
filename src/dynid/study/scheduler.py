"""Scheduler of a study: chunks of samples to the executor, sized by what samples were measured to cost."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.study.executors.lanes import Overdue
from dynid.study.packing import Packed, packed
from dynid.study.watch import Watch
from dynid.study.work import Done, Job, run_chunk

if TYPE_CHECKING:
    from dynid.study.executors import StudyExecutor
    from dynid.study.plan import Plan
    from dynid.study.running import Notice

_SECONDS = 0.5  # a chunk: long against what a message costs, short against what a user waits for
_SPARE = 4  # chunks that are as long as expected take this part of the time that they may take
_MOST = 4096
_GROWTH = 4
_BYTES = 16 * 2**20  # a chunk: what is in memory at a time


class Chunks:
    """Sizes of chunks from what samples were measured to cost.

    Parameters
    ----------
    timeout
        How long a chunk may take, s; absent: any time.
    """

    def __init__(self, timeout: float | None = None) -> None:
        self._size = 1
        self._seconds = _SECONDS if timeout is None else min(_SECONDS, timeout / _SPARE)

    def size(self, remaining: int, width: int) -> int:
        """Return how many of the remaining samples to take next; towards the end, fewer, for all workers.

        Parameters
        ----------
        remaining
            How many samples there are to take.
        width
            How many chunks run at once.
        """
        return max(1, min(self._size, remaining // (2 * width)))

    def learn(self, count: int, seconds: float, size: int = 0) -> None:
        """Take note of what a chunk has cost in time and bytes.

        Samples that run together cost less time each, the more they are.
        """
        fitting = int(count * min(self._seconds / max(seconds, 1e-9), _BYTES / max(size, 1)))
        self._size = max(1, min(fitting, _GROWTH * count, _MOST))


_ATTEMPTS = 3  # of a sample whose worker dies each time
_HOPELESS = 5  # samples given up in a row: it is not they
_TICK = 1.0  # s between two looks at what runs

Numbers = NDArray[np.int64]
#: Chunks that have come back: the numbers of their samples in the plan, and what became of them.
Chunk = tuple[Numbers, Packed]
Arrived = Callable[[list[Chunk]], None]


def drive(
    pool: StudyExecutor,
    job: Job,
    plan: Plan,
    numbers: Numbers,
    arrived: Arrived,
    notice: Notice | None = None,
) -> None:
    """Run samples of a plan.

    A chunk whose worker died is run again with nothing beside it; if its worker dies again, halves of it
    are, until the sample is found that workers die of. That one has failed after a few attempts. Where the
    time of a sample is limited, the samples of a chunk that takes longer are run again one by one, and one
    that takes longer has failed.

    Parameters
    ----------
    pool
        What runs them.
    job
        What they share.
    plan
        The plan.
    numbers
        The samples to run.
    arrived
        Is called with the outcomes as they come, of many samples at a time.
    notice
        Is given sentences for the user: which samples take long, what the executor waits for.

    Raises
    ------
    NumericalError
        Where workers die whatever they run.
    FileError
        Where the executor as a whole is gone.
    """
    _Drive(pool, job, plan, numbers, arrived, notice).run()


class _Drive:
    def __init__(
        self,
        pool: StudyExecutor,
        job: Job,
        plan: Plan,
        numbers: Numbers,
        arrived: Arrived,
        notice: Notice | None,
    ) -> None:
        self.pool = pool
        self.job = job
        self.plan = plan
        self.numbers = numbers
        self.arrived = arrived
        self.watch = Watch(pool, plan, notice)
        self.chunks = Chunks(pool.timeout)
        self.next = 0
        self.flying: dict[Future[Any], Numbers] = {}
        self.singles: deque[Numbers] = deque()  # of chunks that took too long
        self.suspects: deque[Numbers] = deque()
        self.alone: Numbers | None = None  # the suspect that flies alone
        self.deaths: Counter[int] = Counter()
        self.given_up = 0  # in a row

    def run(self) -> None:
        while self._launch():
            landed, _ = wait(self.flying, timeout=_TICK, return_when=FIRST_COMPLETED)
            self._land(landed)
            self.watch.look(self.flying)

    def _launch(self) -> bool:
        """Keep workers busy; a suspect flies alone."""
        if self.suspects:
            if not self.flying:
                self.alone = self.suspects.popleft()
                self._submit(self.alone)
            return True
        while self.singles and len(self.flying) < self.pool.ahead:
            self._submit(self.singles.popleft())
        while len(self.flying) < self.pool.ahead and self.next < len(self.numbers):
            size = self.chunks.size(len(self.numbers) - self.next, self.pool.width)
            chunk = self.numbers[self.next : self.next + size]
            self.next += len(chunk)
            self._submit(chunk)
        return bool(self.flying)

    def _submit(self, chunk: Numbers) -> None:
        try:
            future = self.pool.submit(run_chunk, self.job, self.plan.overrides(chunk))
        except Exception as error:
            if not self.pool.has_died(error):
                self.pool.refuse(error)
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
                if isinstance(error, Overdue):
                    self._overdue(chunk)
                    continue
                if not self.pool.has_died(error):
                    self.pool.refuse(error)
                    raise
                lost.append(chunk)
                continue
            self.chunks.learn(len(chunk), done.seconds, len(done.outcomes.content))
            self.given_up = 0
            came.append((chunk, done.outcomes))
        if came:
            self.arrived(came)
        if lost:
            self.pool.replace()
            self._suspect(lost)

    def _overdue(self, chunk: Numbers) -> None:
        """Run the samples of a chunk that took too long one by one; one that did alone has failed."""
        if len(chunk) > 1:
            self.singles.extend(chunk[place : place + 1] for place in range(len(chunk)))
            return
        self.given_up = 0
        error = f"it took longer than the {self.pool.timeout:g} s of --sample-timeout"
        self._failed(chunk, error)

    def _failed(self, chunk: Numbers, error: str) -> None:
        self.arrived([(chunk, packed(SampleOutcomes.of([SampleOutcome(error=error, exit_code=3)])))])

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
        self._failed(chunk, f"its worker died {_ATTEMPTS} times: it was killed, or ran out of memory")
