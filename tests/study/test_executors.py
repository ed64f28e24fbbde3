"""Executors: the file of a study is the same with all of them, also after workers died."""

import concurrent.futures
import os
import subprocess
import sys
import threading
import time
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid.errors import FileError, NumericalError
from dynid.store import read_result
from dynid.study import executors, scheduler, work
from dynid.study.executors import ProcessExecutor, SerialExecutor, make_executor
from dynid.study.run import run_study, valid_samples
from tests.study.faults import poisoned
from tests.study.small import SCENE, STUDY, assert_same, planned

pytestmark = pytest.mark.thorough

MANY = STUDY.replace("stop: 4, points: 4", "stop: 14, points: 14")
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    """The file of the study as one process makes it."""
    folder = tmp_path_factory.mktemp("serial")
    run_study(planned(folder, MANY), folder / "s.h5", SerialExecutor())
    return folder / "s.h5"


class Deadly(ProcessExecutor):
    """Processes, one of which dies of samples with a certain value, as often as it is told to."""

    def __init__(self, victims, times, folder):
        super().__init__(2)
        self.poison = (victims, times, str(folder))

    def submit(self, *args):
        return super().submit(poisoned, self.poison, *args[1:])


def test_a_worker_killed_in_the_middle_changes_nothing(serial, tmp_path):
    run_study(planned(tmp_path, MANY), tmp_path / "s.h5", Deadly({4, 9}, 1, tmp_path))
    assert len(list(tmp_path.glob("death-*"))) == 2
    assert_same(tmp_path / "s.h5", serial)


class Dying(SerialExecutor):
    """A worker that dies of one sample each time, in this process: it only says so."""

    def submit(self, call, job, overrides):
        if any(one["parameters.m"] == 3 for one in overrides):
            return super().submit(_die)
        return super().submit(call, job, overrides)

    def has_died(self, error):
        return isinstance(error, MemoryError)


def _die():
    raise MemoryError


@pytest.mark.parametrize("real", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_sample_that_workers_die_of_fails_alone(tmp_path, real):
    study = STUDY.replace("[0.5, 1, -2]", "[1]")
    pool = Deadly({3}, 99, tmp_path) if real else Dying()
    progress = run_study(planned(tmp_path, study), tmp_path / "s.h5", pool)
    assert (progress.finished, progress.failed) == (4, 1)
    result = read_result(tmp_path / "s.h5")
    assert result["study/status"].data.tolist() == ["done", "done", "failed", "done"]
    assert result["study/error"].data[2] == "its worker died 3 times: it was killed, or ran out of memory"


class DyingLater(Dying):
    """A worker that dies of some samples when chunks are long already, and once when it is given one."""

    refused = False

    def submit(self, call, job, overrides):
        if any(one["parameters.m"] == 11 for one in overrides):
            return SerialExecutor.submit(self, _die)
        if any(one["parameters.m"] == 7 for one in overrides) and not self.refused:
            self.refused = True
            _die()
        return SerialExecutor.submit(self, call, job, overrides)


def test_a_chunk_that_workers_die_of_is_divided_until_its_sample_is_found(serial, tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.study.scheduler.Chunks.size", lambda *_: 8)
    pool = DyingLater()
    progress = run_study(planned(tmp_path, MANY), tmp_path / "s.h5", pool)
    assert pool.refused
    assert (progress.finished, progress.failed) == (42, 3)
    result, alone = read_result(tmp_path / "s.h5"), read_result(serial)
    lost = result["study/samples/parameters.m"].data == 11
    assert np.array_equal(result["study/status"].data == "failed", lost)
    gain = "study/results/bond_graph/properties/m.f/F/dc_gain"
    assert np.array_equal(result[gain].data[~lost], alone[gain].data[~lost])


class Faulty(SerialExecutor):
    """An executor with a fault that is nobody's death: in what it runs, or in how it takes it."""

    def __init__(self, at_once):
        super().__init__()
        self.at_once = at_once

    def submit(self, *_):
        if self.at_once:
            _fault()
        return super().submit(_fault)


def _fault():
    raise ArithmeticError("a fault of the executor")


@pytest.mark.parametrize("at_once", [True, False])
def test_a_fault_that_is_no_death_ends_the_study_and_what_is_finished_stays(tmp_path, at_once):
    with pytest.raises(ArithmeticError, match="a fault of the executor"):
        run_study(planned(tmp_path), tmp_path / "s.h5", Faulty(at_once))
    assert run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor()).finished == 12


class Broken(SerialExecutor):
    """Workers that die whatever they run."""

    def submit(self, *_):
        self.runs = getattr(self, "runs", 0) + 1
        return super().submit(_die)

    def has_died(self, error):
        return isinstance(error, MemoryError)


def test_workers_that_die_whatever_they_run_end_the_study(tmp_path):
    pool = Broken()
    with pytest.raises(NumericalError, match="workers die whatever they run"):
        run_study(planned(tmp_path, MANY), tmp_path / "s.h5", pool)
    assert pool.runs < 30


def test_a_worker_holds_linear_algebra_to_one_thread_and_this_process_is_left_alone(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    pool = ProcessExecutor(1)
    try:
        assert pool.submit(os.getenv, "OMP_NUM_THREADS").result(60) == "1"
        assert os.environ["OMP_NUM_THREADS"] == "2"
        assert "MKL_NUM_THREADS" not in os.environ or os.environ["MKL_NUM_THREADS"] != ""
    finally:
        pool.dismiss()


def test_a_worker_with_another_version_is_refused(tmp_path):
    plan = planned(tmp_path)
    job = replace(work.Job.of(plan.base, plan.collect), version="0.0.1")
    with pytest.raises(FileError, match=r"has dynid .*, and the study 0\.0\.1\. Install the same version"):
        work.run_chunk(job, plan.overrides([0]))


@pytest.fixture
def cluster(tmp_path):
    """A Dask scheduler and two workers on loopback: its address, and the processes."""
    pytest.importorskip("distributed")
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}"}
    environment["DASK_DISTRIBUTED__COMM__RETRY__COUNT"] = "0"
    file = tmp_path / "scheduler.json"
    dask = [sys.executable, "-W", "ignore", "-m"]
    with (tmp_path / "dask.log").open("w") as log:
        started = [
            subprocess.Popen(
                [*dask, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
                 "--no-dashboard", "--scheduler-file", str(file)],
                env=environment, stdout=log, stderr=log,
            )
        ]  # fmt: skip
        started += [
            subprocess.Popen(
                [*dask, "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1",
                 "--no-dashboard", "--no-nanny", "--local-directory", str(tmp_path)],
                env=environment, stdout=log, stderr=log,
            )
            for _ in range(2)
        ]  # fmt: skip
        try:
            _await(file.exists)
            yield file, started
        finally:
            for process in started:
                process.kill()
                process.wait()


def _await(condition, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_dask_cluster_gives_the_file_of_one_process_also_when_a_worker_is_killed(serial, cluster, tmp_path):
    file, (_, worker, _) = cluster
    plan = planned(tmp_path, MANY)
    run_study(plan, tmp_path / "s.h5", make_executor(scheduler_file=str(file)))
    assert_same(tmp_path / "s.h5", serial)

    def kill(progress):
        if progress.finished >= 10 and worker.poll() is None:
            worker.kill()

    run_study(plan, tmp_path / "killed.h5", make_executor(scheduler_file=str(file)), report=kill)
    assert worker.poll() is not None
    assert_same(tmp_path / "killed.h5", serial)


@pytest.mark.slow
def test_a_study_whose_scheduler_is_gone_says_so_and_goes_on_elsewhere(serial, cluster, tmp_path):
    file, (scheduler, *_) = cluster
    plan = planned(tmp_path, MANY)

    def kill(progress):
        if progress.finished >= 10 and scheduler.poll() is None:
            scheduler.kill()

    with pytest.raises(FileError, match=r"does not answer.*again to resume it"):
        run_study(plan, tmp_path / "s.h5", make_executor(scheduler_file=str(file)), report=kill)
    assert valid_samples(plan, tmp_path / "s.h5") >= 10
    assert run_study(plan, tmp_path / "s.h5", SerialExecutor()).kept >= 10
    assert_same(tmp_path / "s.h5", serial)


def test_a_scheduler_that_is_not_there_is_said_to_be_so(tmp_path, monkeypatch):
    from dynid.study import executors

    monkeypatch.setattr(executors, "_CONNECT_SECONDS", 0.5)
    with pytest.raises(FileError, match=r"the Dask scheduler at tcp://127\.0\.0\.1:9 does not answer"):
        run_study(planned(tmp_path), tmp_path / "s.h5", make_executor(scheduler="tcp://127.0.0.1:9"))


def test_the_folder_of_a_study_does_not_show_in_its_errors(tmp_path):
    scene = SCENE.partition("expect:")[0]
    scene += "  time: {stop: 1, step: 0.5, input: {kind: file, path: force.csv}}\n"
    (tmp_path / "force.csv").write_text("1\n2\n3\n")
    study = STUDY.replace("parameters.b: {values: [0.5, 1, -2]}", "analysis.time.input.path: [gone.csv]")
    run_study(planned(tmp_path, study, scene), tmp_path / "s.h5", SerialExecutor())
    result = read_result(tmp_path / "s.h5")
    assert set(result["study/error"].data) == {
        "gone.csv is no file. Paths in a scene are relative to the scene's folder."
    }
    assert set(result["study/exit_code"].data) == {4}


def test_a_short_study_stays_in_this_process(serial, tmp_path, monkeypatch):
    monkeypatch.setattr(executors, "cores", lambda: 2)
    monkeypatch.setattr(ProcessExecutor, "_start", None)  # calling it would fail
    run_study(planned(tmp_path, MANY), tmp_path / "s.h5", make_executor())
    assert_same(tmp_path / "s.h5", serial)


def test_a_study_goes_on_in_processes_once_its_samples_are_seen_to_take_long(serial, tmp_path, monkeypatch):
    monkeypatch.setattr(executors, "cores", lambda: 2)
    monkeypatch.setattr(executors, "_MIN_SECONDS_FOR_PROCESSES", 0.0)
    monkeypatch.setattr(scheduler, "_FIRST_SECONDS", 0.0)
    pool, started = make_executor(), []
    monkeypatch.setattr(pool, "_start", lambda start=pool._start: started.append(pool.width) or start())
    run_study(planned(tmp_path, MANY), tmp_path / "s.h5", pool)
    assert started == [2]
    assert_same(tmp_path / "s.h5", serial)


def test_what_the_first_chunk_imports_does_not_start_processes(monkeypatch):
    """Slow samples do, after the first one; until the processes are ready, they run here."""
    monkeypatch.setattr(executors, "cores", lambda: 2)
    pool, ready = make_executor(), threading.Event()
    monkeypatch.setattr(pool, "_run", lambda *_: ready.wait())
    run = scheduler.Scheduler(pool, None, None, np.arange(100), None)
    run.next = 1
    pool.expect(run._left(1, 2.0))
    assert pool.ahead == 1
    pool.expect(run._left(1, 10.0))
    assert pool.ahead == 1
    assert pool.submit(threading.get_ident).result() == threading.get_ident()
    ready.set()
    concurrent.futures.wait(pool._starts)
    assert pool.ahead == 4
    pool.dismiss()


@pytest.mark.parametrize(
    ("text", "loaded"), [("# scheduler: none", True), ("scheduler-address: tcp://h:1", True), ("a: 1", False)]
)
def test_dask_is_asked_for_a_scheduler_only_where_its_configuration_names_one(
    tmp_path, monkeypatch, text, loaded
):
    (tmp_path / "distributed.yaml").write_text(text)
    monkeypatch.setenv("DASK_CONFIG", str(tmp_path))
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    address = "tcp://h:1" if "address" in text else None
    dask = types.SimpleNamespace(config={"scheduler-address": address})
    monkeypatch.setitem(sys.modules, "dask", dask if loaded else None)
    assert executors._configured_address() == address
