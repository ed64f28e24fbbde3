"""Studies killed at any moment are resumed without loss."""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pytest

from dynid.study.executors import SerialExecutor
from dynid.study.journal import Journal
from dynid.study.run import run_study
from tests.study.small import STUDY, assert_same, planned, written

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[2]
ENVIRONMENT = os.environ | {"PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"}


@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_a_study_killed_at_any_byte_loses_no_sample_and_runs_none_twice(tmp_path, kills):
    plan = planned(tmp_path)
    sizes = _bytes_written(plan, tmp_path / "whole.h5")
    done = subprocess.run(
        [sys.executable, "-m", "tests.study.kills", *map(str, sizes), str(kills)],
        cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = [tuple(map(int, line.split())) for line in done.stdout.splitlines()]
    assert len(rows) == kills
    assert {again for _, again, _ in rows} == {0}  # nothing that was finished ran again
    assert {together for *_, together in rows} == {12}  # and nothing is missing
    assert len({finished for finished, *_ in rows}) > kills // 4  # the moments were different ones
    for number in range(kills):
        assert_same(tmp_path / f"{number}.h5", tmp_path / "whole.h5")
        assert not (tmp_path / f"{number}.h5.journal").exists()


def _bytes_written(plan, target):
    """Return how many bytes a study writes to its journal, and in all."""
    counted, original = Counter(), os.pwrite

    def pwrite(descriptor, content, place):
        counted[Path(f"/proc/self/fd/{descriptor}").readlink().suffix] += len(content)
        return original(descriptor, content, place)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "pwrite", pwrite)
        run_study(plan, target, SerialExecutor())
    return counted[".journal"], counted.total()


def _finished(target):
    try:
        return len(Journal.read_keys(f"{target}.journal"))
    except Exception:
        return 0


def _start(folder, *options):
    return subprocess.Popen(
        [sys.executable, "-m", "dynid", "study", "masses.yaml", *options],
        cwd=folder, env=ENVIRONMENT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip


def _await_samples(process, target, count):
    end = time.monotonic() + 120
    while _finished(target) < count:
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < end
        time.sleep(0.01)


MANY = STUDY.replace("stop: 4, points: 4", "stop: 200, points: 200")


@pytest.fixture
def many(tmp_path):
    """A study that takes seconds."""
    written(tmp_path, MANY)
    return tmp_path


def test_workers_end_with_a_study_that_is_killed(many):
    process = _start(many, "--workers", "2")
    _await_samples(process, many / "masses.h5", 3)
    process.kill()
    process.communicate()
    end = time.monotonic() + 30
    while _group(process.pid):
        assert time.monotonic() < end, "workers outlive their study"
        time.sleep(0.05)


def _group(leader):
    """Return the processes of a session that are alive."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                state, _, _, session = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
            except OSError:
                continue
            if int(session) == leader and state != "Z":
                found.append(entry.name)
    return found


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow)],
    ids=["ctrl-c", "terminated"],
)
def test_an_interrupted_study_ends_cleanly_and_says_how_to_go_on(many, number, code):
    process = _start(many, "--workers", "2")
    _await_samples(process, many / "masses.h5", 3)
    os.killpg(process.pid, number)  # as a terminal does: to the workers too
    _, said = process.communicate(timeout=60)
    assert process.returncode == code, said
    assert "Resume with: dynid study masses.yaml" in said
    assert "Traceback" not in said
    from dynid.store import read_result

    status = read_result(many / "masses.h5", partial=True)["study/status"].data.tolist()
    assert {"done", "pending"} == set(status)
    assert not (many / "masses.h5.lock").exists()
