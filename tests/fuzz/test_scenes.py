"""Spoiled scenes end in located messages and an exit code, in bounded time; never in a traceback.

The exhaustive run is `python -m tests.fuzz.record`, whose figures stand in docs/quality.md.
"""

import random

import pytest

from tests.fuzz.judge import Sandbox
from tests.fuzz.kinds import KINDS, hostile_scene
from tests.fuzz.mutation import bases
from tests.sample import sample

pytestmark = pytest.mark.thorough

BASES = bases()
COUNT = 600


@pytest.mark.thorough
@pytest.mark.parametrize("part", sample(range(6), 1))
def test_a_spoiled_scene_is_refused_with_its_places_or_is_valid(tmp_path, part):
    sandbox = Sandbox(tmp_path)
    for seed in range(part, COUNT, 6):
        _, text = hostile_scene(seed, BASES)
        assert sandbox.judge(text).wrong == "", f"seed {seed}:\n{text[:2000]}"


@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 10), marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_hostile_scene_is_refused_or_valid(tmp_path, kind, seeds):
    sandbox = Sandbox(tmp_path)
    for seed in seeds:
        text = KINDS[kind][0](random.Random(seed), BASES[7 * seed % len(BASES)])
        assert sandbox.judge(text).wrong == "", f"seed {seed}:\n{text[:2000]}"


def test_the_judge_sees_a_fault_of_dynid_itself(tmp_path, monkeypatch):
    def broken(*_):
        raise KeyError("x")

    monkeypatch.setattr("dynid.scene.load.load_scene", broken)
    assert "fault of dynid itself" in Sandbox(tmp_path).judge("dynid: 1\n").wrong


def test_the_judge_sees_what_takes_too_long_and_what_is_touched(tmp_path, monkeypatch):
    def slow(*_):
        while True:
            pass

    sandbox = Sandbox(tmp_path)
    monkeypatch.setattr("dynid.scene.load.load_scene", slow)
    assert sandbox.judge("dynid: 1\n", seconds=0.05).wrong == "took more than 0.05 s"
    (sandbox.folder / "kept.csv").write_text("gone")
    monkeypatch.undo()
    assert sandbox.judge("dynid: 1\n").wrong.startswith("changed the folder")
