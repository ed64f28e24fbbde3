"""The README says what is there: its Python runs, its commands and files exist."""

import re
from pathlib import Path

import numpy as np

import dynid
from dynid.cli import COMMANDS
from dynid.store import write_result

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()


def test_the_python_of_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    write_result(dynid.run("configs/isolator.yaml"), "isolator.h5")
    names = {}
    for block in re.findall(r"```python\n(.*?)```", README, re.DOTALL):
        exec(block, names)
    assert np.allclose(names["zeros"], [-70.71067811865476j, 70.71067811865476j], rtol=1e-12)
    assert names["again"].equals(names["result"])
    assert list(names["poles"]) == [-2]


def test_commands_and_files_of_the_readme_exist():
    for block in re.findall(r"```(?:sh|text)\n(.*?)```", README, re.DOTALL):
        for command in re.findall(r"^(?:\$ )?dynid ([a-z-]+)", block, re.MULTILINE):
            assert command in COMMANDS
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / target).exists(), target
    for scene in re.findall(r"^\| (`.*?`) \|", README, re.MULTILINE):
        for name in re.findall(r"`([^` …]+)`", scene):
            assert (ROOT / "configs" / name).exists(), name
