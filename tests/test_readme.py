"""The README says what is there: its Python runs, its outputs are printed, its files exist."""

import importlib.util
import re
from pathlib import Path

import numpy as np

import dynid
from dynid.store import write_result

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
_spec = importlib.util.spec_from_file_location("replay", ROOT / "docs/replay.py")
replay = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(replay)


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


def test_the_readme_says_what_is_printed(tmp_path, warm):
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    session, shown = (
        replay.Session(tmp_path, warm.clients),
        re.findall(r"```text\n(\$ .*?)```", README, re.DOTALL),
    )
    assert len(shown) == 2
    for code in shown:
        for command, printed in replay.commands(code):
            said = session.shell(command)
            assert replay.matches(printed, said), f"$ {command}\n{said}"


def test_the_commands_of_the_readme_run_as_printed_in_a_new_folder(tmp_path, warm):
    block = re.search(r"^## Your own system\n\n```sh\n(.*?)```", README, re.DOTALL | re.MULTILINE)
    session = replay.Session(tmp_path, warm.clients)
    for line in block[1].splitlines():
        code = session.shell(f"{line}\necho left $?").split()[-1]
        assert code == ("1" if line.startswith("dynid compare") else "0"), line


def test_files_of_the_readme_exist():
    for target in re.findall(r"\]\(([^)#:]+)\)", README):
        assert (ROOT / target).exists(), target
    for scene in re.findall(r"^\| (`.*?`) \|", (ROOT / "docs/scenes.md").read_text(), re.MULTILINE):
        for name in re.findall(r"`([^` …]+)`", scene):
            assert (ROOT / "configs" / name).exists(), name
