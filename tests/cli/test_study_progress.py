"""Progress of a study, printed while it runs."""

import io
import sys

import pytest

from dynid.cli.progress import Forecast, Rate, duration, progress_text, showing_study
from dynid.study.run import Progress


def test_the_rate_is_that_of_the_last_minute():
    rate = Rate()
    assert rate.per_second == 0
    rate.add(0.0, 0)
    assert rate.per_second == 0
    rate.add(10.0, 50)
    assert rate.per_second == 5
    for second in range(20, 200, 10):
        rate.add(float(second), 50 + second)
    assert rate.per_second == 1


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(0.4, "0 s"), (59.4, "59 s"), (61.7, "1 min 02 s"), (3599, "59 min 59 s"), (7380, "2 h 03 min")],
)
def test_a_duration_is_said_as_long_as_it_is(seconds, said):
    assert duration(seconds) == said


def test_what_is_left_is_told_as_soon_as_there_is_a_rate():
    progress = Progress(100, 20, 3, 0)
    assert progress_text(progress, 0.0) == "20 of 100 samples, 3 failed"
    assert progress_text(progress, 2.5) == "20 of 100 samples, 3 failed, 2.5 a second, 32 s left"
    assert progress_text(Progress(100, 100, 0, 0), 2.5) == "100 of 100 samples"


def test_a_terminal_has_a_bar_and_a_file_has_lines(monkeypatch):
    for terminal in (True, False):
        stream = io.StringIO()
        stream.isatty = lambda terminal=terminal: terminal
        monkeypatch.setattr(sys, "stderr", stream)
        with showing_study(quiet=False) as report:
            for finished in (0, 50, 100):
                report(Progress(100, finished, 1, 0))
        lines = stream.getvalue().splitlines()
        assert any("100 of 100 samples, 1 failed" in line for line in lines)
        assert (len(lines) == 2) != terminal  # the first and the last: the one between is too soon
    with showing_study(quiet=True) as report:
        assert report is None


def test_numbered_work_has_a_forecast_from_the_rate_of_its_own_kind():
    forecast = Forecast()
    assert forecast.hear("reducing the graph", 0.0) == ""
    assert forecast.hear("equilibrium from start 1 of 1000", 10.0) == ""
    assert forecast.hear("equilibrium from start 11 of 1000", 11.0) == ""  # too early
    assert forecast.hear("equilibrium from start 101 of 1000", 20.0) == ", about 1 min 30 s left"
    assert forecast.hear("channel 1 of 3", 20.0) == ""
    assert forecast.hear("channel 2 of 3", 24.0) == ", about 8 s left"
