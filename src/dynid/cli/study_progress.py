"""Progress of a study: a bar on a terminal, plain lines elsewhere, both on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from dynid.cli.output import terminal
from dynid.number_format import counted
from dynid.suggestions import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar

    from dynid.study.running import Notice, Progress, Report

_SECONDS = 10.0  # between two plain lines
_WINDOW = 60.0  # the rate is that of the last minute


class Rate:
    """Samples a second, and what is left of the time, from what was finished when."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, int]] = []

    def see(self, now: float, finished: int) -> None:
        """Take note of how many samples are finished now."""
        self._seen.append((now, finished))
        while len(self._seen) > 2 and now - self._seen[1][0] > _WINDOW:
            self._seen.pop(0)

    @property
    def per_second(self) -> float:
        """Samples a second; 0 where it is too early to tell."""
        if not self._seen:
            return 0.0
        (begin, first), (end, last) = self._seen[0], self._seen[-1]
        return (last - first) / (end - begin) if end > begin else 0.0


def words(progress: Progress, rate: float) -> str:
    """Say how far a study is."""
    left = progress.total - progress.finished
    parts = [f"{progress.finished} of {counted(progress.total, 'sample')}"]
    if progress.failed:
        parts.append(f"{progress.failed} failed")
    if rate > 0 and left:
        parts += [f"{rate:.3g} a second", f"{duration(left / rate)} left"]
    return ", ".join(parts)


def duration(seconds: float) -> str:
    """Say how long something takes."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


@contextmanager
def showing(quiet: bool) -> Iterator[Report | None]:
    """Give what a study reports its progress to."""
    if quiet:
        yield None
    elif sys.stderr.isatty():
        with _bar() as report:
            yield report
    else:
        yield _Lines()


class _Lines:
    """A line now and then, and one at the end."""

    def __init__(self) -> None:
        self._rate = Rate()
        self._next = 0.0

    def __call__(self, progress: Progress) -> None:
        now = time.monotonic()
        self._rate.see(now, progress.finished)
        if now >= self._next or progress.finished == progress.total:
            click.echo(words(progress, self._rate.per_second), err=True)
            self._next = now + _SECONDS


def noticing(study: str, report: Report | None) -> Notice:
    """Return what gives notice to the user of a study, above the bar where there is one.

    Parameters
    ----------
    study
        The study's file.
    report
        What its progress is reported to.
    """

    def notice(text: str) -> None:
        line = printable(f"{study}: warning: {text}")
        if isinstance(report, _Bar):
            report.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            click.echo(line, err=True)

    return notice


class _Bar:
    """A bar on a terminal."""

    def __init__(self, console: Console, bar: Bar) -> None:
        self.console = console
        self._bar = bar
        self._rate = Rate()
        self._task = bar.add_task("", total=None)

    def __call__(self, progress: Progress) -> None:
        self._rate.see(time.monotonic(), progress.finished)
        said = words(progress, self._rate.per_second)
        self._bar.update(self._task, total=progress.total, completed=progress.finished, description=said)


@contextmanager
def _bar() -> Iterator[Report]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (BarColumn(), TextColumn("{task.description}"))
    console = Console(file=terminal())
    with Bar(*columns, console=console, transient=True) as bar:
        yield _Bar(console, bar)
