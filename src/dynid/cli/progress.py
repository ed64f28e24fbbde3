"""Progress on standard error: one line for a run, on a terminal only; a bar or plain lines for a study."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from dynid.cli.arguments import terminal
from dynid.number_format import counted
from dynid.progress import Listener, progress_to
from dynid.suggestions import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bar

    from dynid.study.run import Progress, Report
    from dynid.study.scheduler import Notice

#: Duration of a run without a line, and period of its updates, s.
_PATIENCE, _PERIOD = 2.0, 0.5
#: Longest text of the line: a line wider than the terminal could not be erased.
_LINE_WIDTH = 72
#: A report of numbered work.
_NUMBERED = re.compile(r"(.*?)(\d+) of (\d+)")
#: Period of the plain lines of a study, and window of the rate that is shown, s.
_SECONDS, _WINDOW = 10.0, 60.0


@contextmanager
def showing(quiet: bool = False) -> Iterator[Listener]:
    """Show the progress of the work inside the context, if standard error is a terminal.

    The listener is for functions that take one; others report by `dynid.progress`.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    line = _Line()
    try:
        with progress_to(line.hear):
            yield line.hear
    finally:
        line.end()


class Forecast:
    """The time that numbered work still takes, from reports like "start 3 of 100"."""

    def __init__(self) -> None:
        self._what, self._began, self._first = "", 0.0, 0

    def hear(self, what: str, now: float) -> str:
        """Return the forecast after a report, heard at a time, s; '' where there is none yet."""
        match = _NUMBERED.fullmatch(what)
        if match is None:
            self._what = ""
            return ""
        kind, number, total = match[1], int(match[2]), int(match[3])
        if kind != self._what:
            self._what, self._began, self._first = kind, now, number
        finished, spent = number - self._first, now - self._began
        if spent < _PATIENCE or not finished:
            return ""
        return f", about {duration(spent / finished * (total - number + 1))} left"


class _Line:
    """A line that a thread of its own updates, since the work may not report for long."""

    def __init__(self) -> None:
        self._text = ""
        self._forecast = Forecast()
        self._began = time.monotonic()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def hear(self, what: str) -> None:
        left = self._forecast.hear(what, time.monotonic())
        self._text = f"{what[:_LINE_WIDTH]}{left}"

    def end(self) -> None:
        self._over.set()
        self._thread.join()

    def _write(self) -> None:
        if self._over.wait(_PATIENCE):
            return
        while not self._over.wait(_PERIOD):
            seconds = f"{time.monotonic() - self._began:.0f} s"
            line = printable(" · ".join(filter(None, (self._text, seconds))))
            click.echo(f"\r\033[K{line}", file=terminal(), nl=False)
        click.echo("\r\033[K", file=terminal(), nl=False)


class Rate:
    """Samples per second of a study, from the number of finished samples over the last minute."""

    def __init__(self) -> None:
        self._counts: list[tuple[float, int]] = []

    def add(self, now: float, finished: int) -> None:
        """Record the number of samples finished at a time, s."""
        self._counts.append((now, finished))
        while len(self._counts) > 2 and now - self._counts[1][0] > _WINDOW:
            self._counts.pop(0)

    @property
    def per_second(self) -> float:
        """Samples per second; 0 before two different times are known."""
        if not self._counts:
            return 0.0
        (begin, first), (end, last) = self._counts[0], self._counts[-1]
        return (last - first) / (end - begin) if end > begin else 0.0


def progress_text(progress: Progress, rate: float) -> str:
    """Return the progress of a study as text, with the rate (samples per second) where it is known."""
    left = progress.total - progress.finished
    parts = [f"{progress.finished} of {counted(progress.total, 'sample')}"]
    if progress.failed:
        parts.append(f"{progress.failed} failed")
    if rate > 0 and left:
        parts += [f"{rate:.3g} a second", f"{duration(left / rate)} left"]
    return ", ".join(parts)


def duration(seconds: float) -> str:
    """Return a duration as text, in units from seconds to hours."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


@contextmanager
def showing_study(quiet: bool) -> Iterator[Report | None]:
    """Yield the function to which a study reports its progress; None for no report."""
    if quiet:
        yield None
    elif sys.stderr.isatty():
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn
        from rich.progress import Progress as Bar

        console = Console(file=terminal())
        with Bar(BarColumn(), TextColumn("{task.description}"), console=console, transient=True) as bar:
            yield _StudyProgress(console, bar)
    else:
        yield _StudyProgress()


class _StudyProgress:
    """Progress as a bar on a terminal, else as a plain line every ten seconds and one at the end."""

    def __init__(self, console: Console | None = None, bar: Bar | None = None) -> None:
        self.console, self._bar = console, bar
        self._rate, self._next = Rate(), 0.0
        if bar is not None:
            self._task = bar.add_task("", total=None)

    def __call__(self, progress: Progress) -> None:
        now = time.monotonic()
        self._rate.add(now, progress.finished)
        text = progress_text(progress, self._rate.per_second)
        if self._bar is not None:
            total, finished = progress.total, progress.finished
            self._bar.update(self._task, total=total, completed=finished, description=text)
        elif now >= self._next or progress.finished == progress.total:
            click.echo(text, err=True)
            self._next = now + _SECONDS


def noticing(study: str, report: Report | None) -> Notice:
    """Return the function that prints warnings of a study's file, above the bar if the report has one."""

    def notice(text: str) -> None:
        line = printable(f"{study}: warning: {text}")
        if isinstance(report, _StudyProgress) and report.console is not None:
            report.console.print(line, markup=False, highlight=False, soft_wrap=True)
        else:
            click.echo(line, err=True)

    return notice
