"""Scheduler of a study: passes chunks of samples to the executor, sized by the measured time of samples."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NumericalError
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.study.work import Done, Job, Packed, packed, run_chunk
from dynid.trial import TimeLimitExceeded

if TYPE_CHECKING:
    from dynid.study.executors import StudyExecutor
    from dynid.study.plan import Plan

_CHUNK_SECONDS = 0.5  # of a chunk: long compared with the cost of a message, short for a waiting user
_FIRST_SECONDS, _TELLING_SECONDS = 5.0, 0.2  # of the first chunk, and of others, that show what samples take
_LIMIT_RATIO = 4  # a time limit is this many times the expected time of a chunk
_MAX_CHUNK_SAMPLES = 4096  # samples of a chunk
_CHUNK_RATIO = 4  # ratio of the sizes of successive chunks
_MAX_CHUNK_BYTES = 16 * 2**20  # of a chunk in memory
_REPORT_INTERVAL = 30.0  # s after which running samples are reported; then after twice as long, and so on
_SAMPLE_ATTEMPTS = 3  # of a sample whose worker dies each time
_MAX_LOST_IN_A_ROW = 5  # samples given up in a row: they are not the cause
_POLL_SECONDS = 1.0  # s between two looks at the running chunks

Numbers = NDArray[np.int64]
#: Finished chunk: the numbers of its samples in the plan, and their outcomes.
Chunk = tuple[Numbers, Packed]
#: Receiver of finished chunks.
Arrived = Callable[[list[Chunk]], None]
#: Receiver of sentences for the user.
Notice = Callable[[str], None]


class Chunks:
    """Sizes of chunks, from the measured time and memory of samples, with a time limit of a chunk, s."""

    def __init__(self, timeout: float | None = None) -> None:
        self._size = 1
        self._seconds = _CHUNK_SECONDS if timeout is None else min(_CHUNK_SECONDS, timeout / _LIMIT_RATIO)

    def size(self, remaining: int, width: int) -> int:
        """Return the size of the next chunk of the remaining samples, of which `width` run at once.

        Of several it decreases towards the end, to keep all workers busy.
        """
        return max(1, min(self._size, remaining // (2 * width) if width > 1 else remaining))

    def learn(self, count: int, seconds: float, size: int = 0) -> None:
        """Record the time (s) and size (bytes) of a chunk; samples of larger chunks take less time each."""
        fitting = int(count * min(self._seconds / max(seconds, 1e-9), _MAX_CHUNK_BYTES / max(size, 1)))
        self._size = max(1, min(fitting, _CHUNK_RATIO * count, _MAX_CHUNK_SAMPLES))


class _RunningChunks:
    """Running chunks with their start times, to report those that take long."""

    def __init__(self, pool: StudyExecutor, plan: Plan, notice: Notice | None) -> None:
        self._pool, self._plan, self._notice = pool, plan, notice
        self._long = _REPORT_INTERVAL if pool.timeout is None else min(_REPORT_INTERVAL, pool.timeout / 2)
        self._trouble: str | None = None
        self._since: dict[Future[Any], float] = {}
        self._due: dict[Future[Any], float] = {}  # the age at which it is reported next

    def look(self, submitted: Mapping[Future[Any], Numbers]) -> None:
        """Report chunks that take long, and new trouble of the executor."""
        if self._notice is None or not submitted:
            return
        trouble, before = self._pool.trouble(), self._trouble
        self._trouble = trouble
        if trouble is not None:
            if trouble != before:
                self._notice(trouble)
            self._since.clear()  # nothing runs
            return
        now = time.monotonic()
        running = list(submitted)[: self._pool.width]  # the others are queued
        self._since = {future: self._since.get(future, now) for future in running}
        self._due = {future: self._due.get(future, self._long) for future in running}
        for future in running:
            age = now - self._since[future]
            if age < self._due[future]:
                continue
            self._due[future] = 2 * age
            numbers = submitted[future]
            first, last = int(numbers[0]), int(numbers[-1])
            if len(numbers) > 1:
                samples = f"{len(numbers)} samples between {first} and {last} have"
            else:
                values = self._plan.overrides(numbers)[0].items()
                samples = f"sample {first} ({', '.join(f'{path}={value}' for path, value in values)}) has"
            self._notice(f"{samples} been running for {age:.2g} s")


@dataclass
class Scheduler:
    """Run of samples of a plan by an executor.

    A chunk whose worker died is run again alone; if its worker dies again, its halves are, down to the
    sample that kills workers, which has failed after a few attempts. If the time of a sample is limited, the
    samples of a chunk that exceeds it are run again one by one, and one that exceeds it alone has failed.
    `arrived` is called with the outcomes of finished chunks, `notice` with sentences for the user.
    """

    pool: StudyExecutor
    job: Job
    plan: Plan
    numbers: Numbers
    arrived: Arrived
    notice: Notice | None = None

    def __post_init__(self) -> None:
        self.running = _RunningChunks(self.pool, self.plan, self.notice)
        self.chunks = Chunks(self.pool.timeout)
        self.next = 0
        self.submitted: dict[Future[Any], Numbers] = {}
        self.singles: deque[Numbers] = deque()  # of chunks that took too long
        self.suspects: deque[Numbers] = deque()  # chunks whose worker died
        self.alone: Numbers | None = None  # the suspect that runs alone
        self.deaths: Counter[int] = Counter()
        self.given_up = 0  # in a row

    def run(self) -> None:
        """Run all samples; raise `NumericalError` if workers die whatever they run."""
        while self._submit_chunks():
            finished, _ = wait(self.submitted, timeout=_POLL_SECONDS, return_when=FIRST_COMPLETED)
            self._collect(finished)
            self.running.look(self.submitted)

    def _submit_chunks(self) -> bool:
        """Keep the workers busy, a suspect alone; return whether chunks are submitted."""
        if self.suspects:
            if not self.submitted:
                self.alone = self.suspects.popleft()
                self._submit(self.alone)
            return True
        while self.singles and len(self.submitted) < self.pool.ahead:
            self._submit(self.singles.popleft())
        while len(self.submitted) < self.pool.ahead and self.next < len(self.numbers):
            size = self.chunks.size(len(self.numbers) - self.next, self.pool.width)
            chunk = self.numbers[self.next : self.next + size]
            self.next += len(chunk)
            self._submit(chunk)
        return bool(self.submitted)

    def _submit(self, chunk: Numbers) -> None:
        try:
            future = self.pool.submit(run_chunk, self.job, self.plan.overrides(chunk))
        except Exception as error:
            if not self.pool.has_died(error):
                self.pool.refuse(error)
                raise
            future = Future()
            future.set_exception(error)
        self.submitted[future] = chunk

    def _collect(self, finished: set[Future[Any]]) -> None:
        """Pass on the outcomes of finished chunks, and prepare the others to be run again."""
        chunks: list[Chunk] = []
        lost = []
        for future in finished:
            chunk = self.submitted.pop(future)
            try:
                done: Done = future.result()
            except TimeLimitExceeded:
                if len(chunk) > 1:
                    self.singles.extend(chunk[index : index + 1] for index in range(len(chunk)))
                else:
                    self.given_up = 0
                    limit = f"{self.pool.timeout:g} s of --sample-timeout"
                    self._fail(chunk, f"it took longer than the {limit}")
            except BaseException as error:
                if not self.pool.has_died(error):
                    self.pool.refuse(error)
                    raise
                lost.append(chunk)
            else:
                self.chunks.learn(len(chunk), done.seconds, len(done.outcomes.content))
                # On a loaded machine the clock would tell of others' work.
                self.pool.expect(self._left(len(chunk), done.processor_seconds))
                self.given_up = 0
                chunks.append((chunk, done.outcomes))
        if chunks:
            self.arrived(chunks)
        for chunk in lost:
            self._suspect(chunk)

    def _left(self, count: int, seconds: float) -> float:
        """Return the time of the samples that are left, s, by that of a chunk; 0 if it says too little.

        The first one imports modules, and of a short one most is what samples share.
        """
        enough = _FIRST_SECONDS if self.next == count else _TELLING_SECONDS
        return seconds / count * (len(self.numbers) - self.next) if seconds > enough else 0.0

    def _suspect(self, chunk: Numbers) -> None:
        """Run a chunk whose worker died again: alone; then its halves; then its sample, a few times."""
        if chunk is not self.alone:
            self.suspects.append(chunk)
            return
        if len(chunk) > 1:
            half = len(chunk) // 2
            self.suspects.extendleft([chunk[half:], chunk[:half]])
            return
        number = int(chunk[0])
        self.deaths[number] += 1
        if self.deaths[number] < _SAMPLE_ATTEMPTS:
            self.suspects.appendleft(chunk)
            return
        self.given_up += 1
        if self.given_up == _MAX_LOST_IN_A_ROW:
            raise NumericalError(
                f"workers die whatever they run ({_SAMPLE_ATTEMPTS * _MAX_LOST_IN_A_ROW} times in a row)",
                remedy="Find the cause: too little memory, or a damaged installation. "
                "Then run the study again to resume it.",
            )
        self._fail(chunk, f"its worker died {_SAMPLE_ATTEMPTS} times: it was killed, or ran out of memory")

    def _fail(self, chunk: Numbers, error: str) -> None:
        self.arrived([(chunk, packed(SampleOutcomes.of([SampleOutcome(error=error, exit_code=3)])))])
