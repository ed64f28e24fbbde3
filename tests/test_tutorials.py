"""The tutorials, replayed in a shell as they are printed: every output is what the page says."""

import importlib.util
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
_spec = importlib.util.spec_from_file_location("replay", DOCS / "replay.py")
replay = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(replay)


@pytest.mark.parametrize("page", sorted((DOCS / "tutorials").glob("*.md")), ids=lambda page: page.stem)
def test_a_tutorial_says_what_is_printed(page, tmp_path):
    played = replay.Replay(page.read_text(), tmp_path)
    played.run()
    assert played.outputs
    for command, printed, said in played.outputs:
        assert replay.matches(printed, said), f"$ {command}\n{said}"


@pytest.mark.parametrize(
    ("printed", "said", "matching"),
    [
        ("a\nb\n", "a\nb\n", True),
        ("a\nb\n", "a\nc\n", False),
        ("a\n…\nd\n", "a\nb\nc\nd\n", True),
        ("a\n…\nd\n", "a\nd\n", True),
        ("a\n…\nd\n", "a\nb\n", False),
        ("x = … m\n", "x = 3.2 m\n", True),
        ("Car   exact engine · 0.4 s\n", "Car  exact engine · 13 ms\n", True),
        ("", "unexpected\n", False),
    ],
)
def test_outputs_match_but_for_times_and_dots(printed, said, matching):
    assert replay.matches(printed, said) is matching
