"""The recorder of the fuzzer counts what happens, and a page shows it."""

import importlib.util
import json
import os
from pathlib import Path

from tests.fuzz import record
from tests.fuzz.judge import Sandbox

SCRIPT = Path(__file__).parents[2] / "docs/quality.py"


def scene_of(seed, _):
    return "odd" if seed % 2 else "even", "dynid: 1\n"


def test_what_ends_its_process_is_counted_and_the_others_go_on(monkeypatch, capsys):
    monkeypatch.setattr(record, "hostile_scene", scene_of)
    judged = Sandbox.judge

    def judge(self, *args, **kwargs):
        verdict = judged(self, *args, **kwargs)
        calls.append(0)
        return os._exit(7) if len(calls) == 3 else verdict

    calls = []
    monkeypatch.setattr(Sandbox, "judge", judge)
    found = record.judge("check", 10, 5, [])
    assert found["scenes"] == 5
    assert found["broken"] == [[12, "even", "the process ended with 7"]]
    assert found["kinds"] == {"even": {"2": 2}, "odd": {"2": 2}}
    assert found["ranges"] == [[10, 15]]
    assert "seed 12 (even)" in capsys.readouterr().out


def test_records_add_up():
    one = record.empty() | {"scenes": 2, "codes": {"0": 1, "2": 1}, "slowest": [1.5, 7], "peak_MB": 5}
    other = record.empty() | {
        "scenes": 3,
        "codes": {"2": 3},
        "slowest": [0.5, 8],
        "broken": [[8, "x", "wrong"]],
    }
    both = record.together(one, other)
    assert both["codes"] == {"0": 1, "2": 4}
    assert (both["scenes"], both["slowest"], both["peak_MB"], len(both["broken"])) == (5, [1.5, 7], 5, 1)


def test_what_is_mended_is_broken_no_more(monkeypatch, tmp_path):
    path, was = tmp_path / "fuzz.json", [[8, "x", "wrong"], [9, "x", "slow"]]
    path.write_text(json.dumps({"run": record.empty() | {"scenes": 10, "broken": was}}))
    left = {8: was[:1], 9: []}
    monkeypatch.setattr(record, "judge", lambda _, seed, *_rest: {"broken": left[seed]})
    assert record.again("run", path=path) == 1
    kept = json.loads(path.read_text())["run"]
    assert (kept["broken"], kept["mended"], kept["scenes"]) == (was[:1], was[1:], 10)
    assert record.together(kept, record.empty())["mended"] == was[1:]


def test_the_page_shows_every_count(tmp_path):
    spec = importlib.util.spec_from_file_location("quality_page", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    check = record.empty() | {
        "scenes": 12345,
        "codes": {"0": 45, "2": 12300},
        "kinds": {"code": {"2": 12300, "0": 45}},
        "broken": [[9, "code", "escaped"]],
        "mended": [[5, "code", "slow"]],
        "slowest": [3.25, 77],
        "peak_MB": 512,
    }
    mutants = {"m": {"killed": 8, "survived": 1, "equivalent": 3}}
    (tmp_path / "fuzz.json").write_text(
        json.dumps({"check": check, "files": {"npz": {"read": 4, "refused": 6}}})
    )
    kept = {"mutants": 100, "chosen": 12, "modules": mutants, "survivors": ["m:f: a → b"]}
    (tmp_path / "mutants.json").write_text(json.dumps(kept))
    text = script.page(tmp_path)
    for said in (
        "| code | 12,345 | 45 | 12,300 |",
        "broke something: **1**",
        "seed 77",
        "512 MB",
        "seed 9 (code): escaped",
        "no longer counted: seeds 5.",
        "| npz | 4 | 6 |",
        "**8 of 9** (88.9 %)",
        "`m:f: a → b`",
        "12 of the 100 mutants",
    ):
        assert said in text


def test_the_page_is_that_of_the_figures_kept():
    spec = importlib.util.spec_from_file_location("quality_page", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    assert (SCRIPT.parent / "quality.md").read_text(encoding="utf-8") == script.page()
