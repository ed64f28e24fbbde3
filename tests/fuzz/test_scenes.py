"""Spoiled scenes end in located messages and an exit code, in bounded time; never in a traceback.

The exhaustive run is `python -m tests.fuzz.record`, whose figures stand in the documentation.
"""

import re

import pytest

from tests.fuzz.judge import verdict
from tests.fuzz.mutation import bases, hostile_scene

BASES = bases()
COUNT = 600


@pytest.mark.parametrize("part", range(6))
def test_a_spoiled_scene_is_refused_with_its_places_or_is_valid(tmp_path, part):
    for seed in range(part, COUNT, 6):
        text = hostile_scene(seed, BASES[seed % len(BASES)])
        assert verdict(text, tmp_path / "scene.yaml", "check") == "", f"seed {seed}:\n{text[:2000]}"


def test_the_judge_sees_a_fault_of_dynid_itself(tmp_path, monkeypatch):
    def broken(*_):
        raise KeyError("x")

    monkeypatch.setattr("dynid.scene.load.load_scene", broken)
    assert re.search("fault of dynid itself", verdict("dynid: 1\n", tmp_path / "scene.yaml", "check"))
