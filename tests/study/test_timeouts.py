"""Time limits: samples that hang, die or take long are failed rows or are reported."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.store import read_result
from dynid.study import executors, scheduler
from dynid.study.executors import ProcessExecutor, SerialExecutor, make_executor
from dynid.study.run import run_study
from dynid.trial import ProcessDied, TimeLimitExceeded
from tests.study.faults import faulty
from tests.study.small import STUDY, assert_same, planned
from tests.study.test_executors import cluster  # noqa: F401 - a fixture

pytestmark = pytest.mark.thorough

MANY = STUDY.replace("stop: 4, points: 4", "stop: 20, points: 20").replace("[0.5, 1, -2]", "[1]")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The file of the study in one process, without a limit."""
    folder = tmp_path_factory.mktemp("undisturbed")
    run_study(planned(folder, MANY), folder / "s.h5", SerialExecutor())
    return folder / "s.h5"


class Faulty(ProcessExecutor):
    """Processes with a time limit, in which some samples hang or die."""

    def __init__(self, width, seconds, faults, folder):
        super().__init__(width, seconds)
        self.faults, self.folder = faults, str(folder)

    def submit(self, _, job, overrides):
        return super().submit(faulty, self.faults, self.folder, job, overrides)


@pytest.fixture
def impatient(monkeypatch):
    """A second for what is known to hang, ten minutes for all the rest, whatever the limit says."""
    exchange = executors.Worker._exchange

    def hurried(worker, _, call, args):
        hangs = call is faulty and any(args[0].get(one["parameters.m"]) == "hangs" for one in args[-1])
        return exchange(worker, 1.0 if hangs and worker._completed else 600.0, call, args)

    monkeypatch.setattr(executors.Worker, "_exchange", hurried)
    monkeypatch.setattr("dynid.study.scheduler.Chunks.size", lambda _, left, __: 1 if left == 20 else 2)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("width", [pytest.param(1, marks=pytest.mark.slow), 2])
def test_samples_that_hang_or_die_are_failed_rows_and_the_others_are_whole(undisturbed, tmp_path, width):
    plan, target = planned(tmp_path, MANY), tmp_path / "s.h5"
    pool = Faulty(width, 5.0, {8: "hangs", 15: "dies"}, tmp_path)
    progress = run_study(plan, target, pool)
    assert (progress.finished, progress.failed) == (20, 2)
    found, whole = read_result(target), read_result(undisturbed)
    m = found["study/samples/parameters.m"].data
    status, errors = found["study/status"].data, found["study/error"].data
    assert m[status == "failed"].tolist() == [8, 15]
    assert errors[m == 8].tolist() == ["it took longer than the 5 s of --sample-timeout"]
    assert errors[m == 15].tolist() == ["its worker died 3 times: it was killed, or ran out of memory"]
    assert found["study/exit_code"].data[status == "failed"].tolist() == [3, 3]
    gain = "study/results/bond_graph/properties/m.f/F/dc_gain"
    done = status == "done"
    assert np.array_equal(found[gain].data[done], whole[gain].data[done])
    seen = [line.split() for line in (tmp_path / "seen.txt").read_text().splitlines()]
    assert {"2", "1"} <= {size for _, size in seen}  # together first, then alone
    assert not any(_lives(int(process)) for process, _ in seen)


def _lives(process):
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False


@pytest.mark.parametrize("executor", ["serial", "processes"])
def test_a_limit_that_nothing_reaches_changes_nothing(undisturbed, tmp_path, executor):
    pool = make_executor(executor, 2, sample_timeout=300.0)
    assert pool.width == (1 if executor == "serial" else 2)
    run_study(planned(tmp_path, MANY), tmp_path / "s.h5", pool)
    assert_same(tmp_path / "s.h5", undisturbed)


@pytest.mark.usefixtures("impatient")
def test_a_sample_that_takes_long_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(scheduler, "_REPORT_INTERVAL", 0.2)
    monkeypatch.setattr(scheduler, "_POLL_SECONDS", 0.05)
    said = []
    plan = planned(tmp_path, MANY)
    run_study(plan, tmp_path / "s.h5", Faulty(1, 5.0, {8: "hangs"}, tmp_path), notice=said.append)
    assert any(
        re.match(r"sample 7 \(.*parameters\.m=8(\.0)?\b.* has been running for", line) for line in said
    )
    assert any(line.startswith("2 samples between ") for line in said)
    assert sum(line.startswith("sample 7 ") for line in said) < 6  # each time after twice as long


def test_a_process_that_is_gone_is_replaced_and_what_it_raises_comes_through():
    worker = executors.Worker()
    try:
        assert worker.run(60.0, os.getpid) != os.getpid()
        with pytest.raises(ValueError, match="could not convert"):
            worker.run(60.0, float, "x")
        with pytest.raises(ProcessDied):
            worker.run(60.0, signal.raise_signal, signal.SIGKILL)
        with pytest.raises(TimeLimitExceeded):
            worker.run(0.2, time.sleep, 1000)
        assert worker.run(60.0, abs, -3) == 3
    finally:
        worker.close()
    with pytest.raises(ProcessDied):
        worker.run(60.0, abs, -3)


def test_processes_that_nothing_asks_for_end():
    of_worker = executors.WorkerPool(idle=0.05)
    process = of_worker.run(60.0, os.getpid)
    end = time.monotonic() + 60
    while _lives(process):
        assert time.monotonic() < end
        time.sleep(0.02)
    assert of_worker.run(60.0, os.getpid) != process
    of_worker.close()


ORPHAN = """
import os, sys, time
from dynid.study.executors import Worker
worker = Worker()
print(worker.run(60.0, os.getpid), flush=True)
worker.run(60.0, time.sleep, 1000)
"""


def test_a_process_ends_with_the_one_that_it_works_for():
    parent = subprocess.Popen([sys.executable, "-c", ORPHAN], stdout=subprocess.PIPE, text=True)
    child = int(parent.stdout.readline())
    parent.kill()
    parent.communicate()
    end = time.monotonic() + 60
    while _lives(child):
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
def test_a_limit_on_a_dask_cluster(tmp_path, cluster):  # noqa: F811
    file, _ = cluster
    pool = make_executor(scheduler_file=str(file), sample_timeout=5.0)
    submit, folder = pool.submit, str(tmp_path)
    pool.submit = lambda _, job, overrides: submit(faulty, {8: "hangs"}, folder, job, overrides)
    progress = run_study(planned(tmp_path, MANY), tmp_path / "s.h5", pool)
    assert (progress.finished, progress.failed) == (20, 1)
    found = read_result(tmp_path / "s.h5")
    failed = found["study/status"].data == "failed"
    assert found["study/samples/parameters.m"].data[failed].tolist() == [8]
    assert found["study/error"].data[failed].tolist() == ["it took longer than the 5 s of --sample-timeout"]


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "soon"])
def test_a_limit_must_be_a_time(seconds, tmp_path, monkeypatch, capsys):
    from dynid.cli import main

    monkeypatch.chdir(tmp_path)
    planned(tmp_path)
    with pytest.raises(SystemExit) as left:
        main(["study", "masses.yaml", "--sample-timeout", seconds])
    assert left.value.code == 2
    assert not list(tmp_path.glob("*.h5"))
    assert "--sample-timeout" in capsys.readouterr().err


def test_a_limit_needs_no_other_option():
    with pytest.raises(UsageError, match="of no use"):
        make_executor("serial", scheduler="tcp://127.0.0.1:1", sample_timeout=1.0)
