"""Work says how far it is, whoever listens; a terminal shows it, and only what takes long."""

import io
import sys
import time

import pytest

from dynid import progress
from dynid.cli import progress as shown
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene


class Terminal(io.StringIO):
    def isatty(self):
        return True


def heard(scene):
    said = []
    with progress.progress_to(said.append):
        run_scene(load_scene(scene))
    return said


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        ("isolator", ["reducing the graph", "zeros and poles of channel 1 of 1", "frequency response"]),
        ("table2", ["filter pass 1 of 1", "maximum likelihood, step 1"]),
        ("beam_reduction", ["modes of the full structure"]),
    ],
)
def test_a_run_says_what_it_does_in_order(request, scene, expected):
    said = iter(heard(request.config.rootpath / "configs" / f"{scene}.yaml"))
    assert all(any(one == what for one in said) for what in expected)


def test_nobody_listens_outside_and_listeners_nest():
    outer, inner = [], []
    with progress.progress_to(outer.append):
        with progress.progress_to(inner.append):
            progress.report_progress("in")
        progress.report_progress("out")
    progress.report_progress("nobody")
    assert (outer, inner) == (["out"], ["in"])


def test_a_line_is_written_on_a_terminal_and_wiped(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    monkeypatch.setattr(shown, "_PATIENCE", 0.0)
    monkeypatch.setattr(shown, "_PERIOD", 0.001)
    with shown.showing() as say:
        say("filter pass 1 of 4")
        while "filter pass 1 of 4 · 0 s" not in terminal.getvalue():
            time.sleep(0.001)
    assert terminal.getvalue().endswith("\r\033[K")


@pytest.mark.parametrize(("stream", "quiet"), [(Terminal, True), (io.StringIO, False)])
def test_nothing_is_written_where_nobody_looks(monkeypatch, stream, quiet):
    monkeypatch.setattr("sys.stderr", stream())
    monkeypatch.setattr(shown, "_PATIENCE", 0.0)
    with shown.showing(quiet) as say:
        say("a filter pass")
        progress.report_progress("a filter pass")
    assert sys.stderr.getvalue() == ""


def test_what_ends_within_two_seconds_writes_nothing(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr("sys.stderr", terminal)
    assert shown._PATIENCE == 2
    monkeypatch.setattr(shown, "_PATIENCE", 600.0)  # however slow the machine is
    with shown.showing() as say:
        say("a filter pass")
    assert terminal.getvalue() == ""
