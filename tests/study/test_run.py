"""Runs of a study, from the scene to the file, and repeated runs after changes."""

import errno
import fcntl
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

import dynid
from dynid.errors import FileError, UsageError
from dynid.scene.load import load_scene
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.store import open_stored, read_result
from dynid.study import journal
from dynid.study import run as running
from dynid.study.executors import ProcessExecutor, SerialExecutor, make_executor
from dynid.study.merge import merge_studies
from dynid.study.plan import make_plan
from dynid.study.run import TooManyFailures, run_study, valid_samples
from dynid.study.stored import StudyFile
from dynid.study.work import packed
from tests.cli import conftest
from tests.study.small import SCENE, STUDY, assert_same, planned, written
from tests.study.studies import write

pytestmark = pytest.mark.thorough


class Counting(SerialExecutor):
    """The serial pool, with a list of the samples that it ran."""

    def __init__(self):
        super().__init__()
        self.ran = []

    def submit(self, call, job, overrides):
        self.ran += [tuple(one.values()) for one in overrides]
        return super().submit(call, job, overrides)


dynid_cli = conftest.dynid

ANOTHER = np.frombuffer(b"another sample, ", np.uint8).reshape(1, -1)
FAILED = packed(SampleOutcomes.of([SampleOutcome(error="it failed", exit_code=3)]))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The file of the small study, run in one go."""
    folder = tmp_path_factory.mktemp("undisturbed")
    run_study(planned(folder), folder / "s.h5", SerialExecutor())
    return folder / "s.h5"


def test_a_study_holds_what_single_runs_of_its_samples_give(undisturbed, tmp_path):
    written(tmp_path)
    study = read_result(undisturbed)
    for row in np.flatnonzero(study["study/status"].data == "done"):
        m, b = (study[f"study/samples/parameters.{name}"].data[row] for name in "mb")
        alone = dynid.run(load_scene(tmp_path / "mass.yaml", [f"parameters.m={m}", f"parameters.b={b}"]))
        for path in ("properties/m.f/F/dc_gain", "properties/m.f/F/stable", "transfer_function/m.f/F/poles"):
            found = study[f"study/results/bond_graph/{path}"].data[row]
            assert np.array_equal(found, alone[f"bond_graph/{path}"].data)
        assert study["study/expect/0"].data[row] == (1 / b <= 1)


def test_the_order_of_a_grid_is_that_of_nested_loops(undisturbed):
    study = read_result(undisturbed)
    pairs = [(m, b) for m in (1, 2, 3, 4) for b in (0.5, 1, -2)]
    found = [study[f"study/samples/parameters.{name}"].data.tolist() for name in "mb"]
    assert list(zip(*found, strict=True)) == pairs


def test_a_failed_sample_is_a_row_with_its_error(tmp_path):
    plan = planned(tmp_path, STUDY.replace("-2]", "nothing]"))
    progress = run_study(plan, tmp_path / "s.h5", SerialExecutor())
    assert (progress.total, progress.finished, progress.failed) == (12, 12, 4)
    study = read_result(tmp_path / "s.h5")
    failed = study["study/status"].data == "failed"
    assert failed.tolist() == [False, False, True] * 4
    assert set(study["study/error"].data[failed]) == {"parameters.b: no parameter 'nothing'"}
    assert study["study/exit_code"].data[failed].tolist() == [2] * 4
    assert np.isnan(study["study/results/bond_graph/properties/m.f/F/dc_gain"].data[failed]).all()
    assert not np.isnan(study["study/results/bond_graph/properties/m.f/F/dc_gain"].data[~failed]).any()
    assert study["study/samples/parameters.b"].data.tolist() == ["0.5", "1", "nothing"] * 4


def test_xarray_opens_a_study_with_its_samples_as_coordinates(undisturbed):
    with xarray.open_datatree(undisturbed, engine="h5netcdf") as tree:
        gain = tree["study/results/bond_graph/properties/m.f/F"].to_dataset()["dc_gain"].load()
        assert gain.dims == ("sample",)
        assert gain["sample"].to_numpy().tolist() == list(range(12))
        assert tree["study/samples"].to_dataset()["parameters.m"].dims == ("sample",)


def test_running_a_finished_study_again_does_nothing(undisturbed, tmp_path):
    plan = planned(tmp_path)
    run_study(plan, tmp_path / "s.h5", SerialExecutor())
    before = (tmp_path / "s.h5").read_bytes()
    pool = Counting()
    assert run_study(plan, tmp_path / "s.h5", pool).kept == 12
    assert pool.ran == []
    assert (tmp_path / "s.h5").read_bytes() == before
    assert sorted(item.name for item in tmp_path.iterdir()) == ["mass.yaml", "masses.yaml", "s.h5"]
    assert_same(tmp_path / "s.h5", undisturbed)


def test_a_changed_study_keeps_what_is_still_valid(undisturbed, tmp_path):
    run_study(planned(tmp_path, STUDY.replace("points: 4", "points: 1").replace("stop: 4", "stop: 1")),
              tmp_path / "s.h5", SerialExecutor())  # fmt: skip
    pool = Counting()
    plan = planned(tmp_path)
    assert valid_samples(plan, tmp_path / "s.h5") == 3
    assert run_study(plan, tmp_path / "s.h5", pool).kept == 3
    assert [m for m, _ in pool.ran] == [2, 2, 2, 3, 3, 3, 4, 4, 4]
    assert_same(tmp_path / "s.h5", undisturbed)


@pytest.mark.parametrize(
    ("old", "new"),
    [("value: 1", "value: 2"), ("m.f]", "m.p]"), ("max: 1}", "max: 2}")],
    ids=["a parameter", "an output", "an expectation"],
)
def test_another_scene_is_another_sample(tmp_path, old, new):
    scene = SCENE.replace("value: b", "value: 1")
    study = STUDY.replace("  parameters.b: {values: [0.5, 1, -2]}\n", "").replace("/m.f/F/poles", "/*/poles")
    run_study(planned(tmp_path, study, scene), tmp_path / "s.h5", SerialExecutor())
    assert (
        valid_samples(planned(tmp_path, study, scene.replace("mass on", "weight on")), tmp_path / "s.h5") == 4
    )
    assert valid_samples(planned(tmp_path, study, scene.replace(old, new)), tmp_path / "s.h5") == 0


def test_a_changed_record_is_another_sample(tmp_path):
    scene = SCENE + "  time: {stop: 1, step: 0.5, input: {kind: file, path: force.csv}}\n"
    scene = scene.replace("expect:\n", "").replace(
        "  - {path: bond_graph/properties/m.f/F/dc_gain, max: 1}\n", ""
    )
    (tmp_path / "force.csv").write_text("1\n2\n3\n")
    plan = planned(tmp_path, scene=scene)
    run_study(plan, tmp_path / "s.h5", SerialExecutor())
    assert valid_samples(plan, tmp_path / "s.h5") == 12
    (tmp_path / "force.csv").write_text("1\n2\n4\n")
    assert valid_samples(plan, tmp_path / "s.h5") == 0


def test_equal_samples_are_run_once(tmp_path):
    pool = Counting()
    plan = planned(tmp_path, STUDY.replace("[0.5, 1, -2]", "[1, 0.5, 1]"))
    assert run_study(plan, tmp_path / "s.h5", pool).total == 12
    assert len(pool.ran) == len(set(pool.ran)) == 8
    gain = read_result(tmp_path / "s.h5")["study/results/bond_graph/properties/m.f/F/dc_gain"].data
    assert np.array_equal(gain, [1, 2, 1] * 4)


@pytest.mark.thorough
def test_a_study_goes_on_from_a_journal_torn_at_any_byte(undisturbed, tmp_path, monkeypatch):
    plan = planned(tmp_path)
    target = tmp_path / "s.h5"
    whole = _journal_of(plan, target)
    monkeypatch.setattr(journal.os, "fsync", lambda _: None)  # no power is cut here
    before = -1
    last = len(whole) - len(whole) // 6  # from there on every third byte, before it fewer
    for end in [*range(0, last, 40), *range(last, len(whole) + 1, 3), len(whole)]:
        Path(f"{target}.journal").write_bytes(whole[:end])
        opened = journal.Journal(f"{target}.journal")
        known = opened.keys
        assert len(known) >= before  # a longer journal knows no less
        before = len(known)
        opened.append([(ANOTHER, FAILED)])
        opened.close()
        again = journal.Journal(f"{target}.journal")
        assert np.array_equal(again.keys, np.concatenate([known, ANOTHER]))
        assert again.failed.tolist() == [False] * len(known) + [True]
        (block,) = again.blocks(np.array([len(known)]), np.array([7]))
        assert (block.errors, block.rows.tolist()) == (("it failed",), [7])
        again.close()
    assert before == 12
    for end in range(0, len(whole), len(whole) // 3):
        Path(f"{target}.journal").write_bytes(whole[:end])
        pool = Counting()
        kept = run_study(plan, target, pool).kept
        assert len(pool.ran) == 12 - kept
        assert_same(target, undisturbed)
        target.unlink()


def _journal_of(plan, target):
    """Return the journal of a study that was about to write its file."""
    content = {}

    def stop(*_, **__):
        content["journal"] = Path(f"{target}.journal").read_bytes()
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(running, "write_study", stop)
        with pytest.raises(KeyboardInterrupt):
            run_study(plan, target, SerialExecutor())
    return content["journal"]


def test_a_damaged_record_costs_what_follows_and_nothing_else(undisturbed, tmp_path):
    plan = planned(tmp_path)
    target = tmp_path / "s.h5"
    whole = bytearray(_journal_of(plan, target))
    whole[len(whole) // 2] ^= 0x10
    Path(f"{target}.journal").write_bytes(whole)
    kept = run_study(plan, target, SerialExecutor()).kept
    assert 0 < kept < 12
    assert_same(target, undisturbed)


def test_what_is_no_journal_is_left_alone(tmp_path):
    (tmp_path / "s.h5.journal").write_text("my diary")
    with pytest.raises(FileError, match=r"s\.h5\.journal is no journal of a study"):
        run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())
    assert (tmp_path / "s.h5.journal").read_text() == "my diary"


def test_a_journal_of_another_version_is_left_alone(tmp_path):
    (tmp_path / "s.h5.journal").write_bytes(b"dynid journal 1\nwhatever")
    with pytest.raises(FileError, match=r"journal of another version.*Finish the study with that version"):
        run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())
    assert valid_samples(planned(tmp_path), tmp_path / "s.h5") == 0
    assert (tmp_path / "s.h5.journal").read_bytes() == b"dynid journal 1\nwhatever"


def test_what_is_no_study_is_not_overwritten(tmp_path):
    plan = planned(tmp_path)
    dynid_result = dynid.run(tmp_path / "mass.yaml")
    from dynid.store import write_result

    write_result(dynid_result, tmp_path / "s.h5")
    with pytest.raises(FileError, match="not of a study"):
        run_study(plan, tmp_path / "s.h5", SerialExecutor())
    assert read_result(tmp_path / "s.h5").equals(dynid_result)


def test_an_interrupted_study_has_pending_rows_and_goes_on(undisturbed, tmp_path):
    plan = planned(tmp_path)

    def interrupt(progress):
        if progress.finished >= 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(plan, tmp_path / "s.h5", SerialExecutor(), report=interrupt)
    with pytest.raises(FileError, match="not complete"):
        read_result(tmp_path / "s.h5")
    study = read_result(tmp_path / "s.h5", partial=True)
    pending = study["study/status"].data == "pending"
    assert 0 < pending.sum() <= 7
    assert np.isnan(study["study/results/bond_graph/properties/m.f/F/dc_gain"].data[pending]).all()
    (tmp_path / "s.h5.journal").unlink()  # the file alone is enough to go on from
    pool = Counting()
    run_study(plan, tmp_path / "s.h5", pool)
    assert len(pool.ran) == pending.sum()
    assert_same(tmp_path / "s.h5", undisturbed)


def test_too_many_failures_stop_a_study(tmp_path):
    plan = planned(tmp_path, STUDY.replace("[0.5, 1, -2]", "[1, nothing]"))
    with pytest.raises(TooManyFailures, match="2 samples failed, more than the 1 of --max-failures"):
        run_study(plan, tmp_path / "s.h5", SerialExecutor(), max_failures=1)
    study = read_result(tmp_path / "s.h5", partial=True)
    assert (study["study/status"].data == "failed").sum() == 2
    run_study(plan, tmp_path / "s.h5", SerialExecutor(), max_failures=4)
    with pytest.raises(TooManyFailures):
        run_study(plan, tmp_path / "s.h5", SerialExecutor(), max_failures=3)


def test_failed_samples_are_run_again_when_asked_to(tmp_path):
    plan = planned(tmp_path, STUDY.replace("[0.5, 1, -2]", "[1, nothing]"))
    run_study(plan, tmp_path / "s.h5", SerialExecutor())
    pool = Counting()
    run_study(plan, tmp_path / "s.h5", pool, retry_failed=True)
    assert [b for _, b in pool.ran] == ["nothing"] * 4


@pytest.mark.thorough
def test_shards_merge_to_the_file_of_one_run(undisturbed, tmp_path):
    plan = planned(tmp_path)
    parts = [tmp_path / f"{index}.h5" for index in (1, 2, 3)]
    for index, part in enumerate(parts, 1):
        assert run_study(plan, part, SerialExecutor(), shard=(index, 3)).total == 4
    with pytest.raises(UsageError, match="4 of 12 samples are finished in none of the files: 1, 4"):
        merge_studies([parts[2], parts[0]], tmp_path / "all.h5")
    merge_studies([parts[2], parts[0], parts[1]], tmp_path / "all.h5")
    assert_same(tmp_path / "all.h5", undisturbed)
    merge_studies([parts[2], parts[0]], tmp_path / "some.h5", partial=True)
    assert read_result(tmp_path / "some.h5", partial=True)["study/sample"].data.tolist() == [
        0,
        2,
        3,
        5,
        6,
        8,
        9,
        11,
    ]


def test_shards_of_different_studies_do_not_merge(tmp_path):
    run_study(planned(tmp_path), tmp_path / "1.h5", SerialExecutor(), shard=(1, 2))
    run_study(planned(tmp_path, STUDY.replace("4, points: 4", "8, points: 8")), tmp_path / "2.h5",
              SerialExecutor(), shard=(2, 2))  # fmt: skip
    with pytest.raises(UsageError, match="is of another study"):
        merge_studies([tmp_path / "1.h5", tmp_path / "2.h5"], tmp_path / "all.h5")


@pytest.mark.thorough
@pytest.mark.parametrize(("held", "lost"), [((1, 3), 4), ((2, 3), 0)])
def test_a_merge_replaces_no_other_finished_samples(tmp_path, monkeypatch, dynid_cli, held, lost):
    """The merged file is that of shards 2 and 3 of three; the target holds another shard, or one of them."""
    monkeypatch.chdir(tmp_path)
    for name, shard in (("all.h5", held), ("2.h5", (2, 3)), ("3.h5", (3, 3))):
        run_study(planned(tmp_path), name, SerialExecutor(), shard=shard)
    before = Path("all.h5").read_bytes()
    code, _, err = dynid_cli("study-merge", "2.h5", "3.h5", "-o", "all.h5", "--partial")
    assert code == (2 if lost else 0)
    if lost:
        assert f"all.h5 holds {lost} finished samples that are in none of the files" in err
        assert Path("all.h5").read_bytes() == before
    assert dynid_cli("study-merge", "2.h5", "3.h5", "-o", "all.h5", "--partial", "--force")[0] == 0
    with open_stored("all.h5", partial=True) as result:
        numbers = result["study/sample"].data.tolist()
    assert numbers == [number for number in range(12) if number % 3]


def test_a_merge_replaces_no_file_that_is_no_study(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    run_study(planned(tmp_path), "1.h5", SerialExecutor())
    Path("other.h5").write_text("notes")
    assert dynid_cli("study-merge", "1.h5", "-o", "other.h5")[0] == 4
    assert Path("other.h5").read_text() == "notes"


@pytest.mark.thorough
def test_a_dry_run_runs_nothing_and_names_the_command_that_estimates_time(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    plan = planned(tmp_path)
    for module in ("run", "scheduler"):
        monkeypatch.setattr(f"dynid.study.{module}.run_chunk", lambda *_: pytest.fail("a sample is run"))
    _, out, _ = dynid_cli("study", "masses.yaml", "--dry-run", "--set", "title=Two masses")
    (line,) = [line for line in out.splitlines() if line.startswith("  time ")]
    command = line.partition(" by: ")[2]
    assert command == "dynid check masses.yaml --explain --set 'title=Two masses'"
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    code, out, _ = dynid_cli(*shlex.split(command)[1:])
    assert (code, "  cost  " in out) == (0, True)
    run_study(plan, "masses.h5", SerialExecutor())
    assert "  time " not in dynid_cli("study", "masses.yaml", "--dry-run")[1]


def test_a_dry_run_says_what_would_be_lost(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    run_study(planned(tmp_path), "masses.h5", SerialExecutor())
    assert "warning" not in dynid_cli("study", "masses.yaml", "--dry-run")[1]
    planned(tmp_path, STUDY.replace("4, points: 4", "3, points: 3"))
    code, out, _ = dynid_cli("study", "masses.yaml", "--dry-run")
    assert code == 0
    refused = dynid_cli("study", "masses.yaml", "--executor", "serial")[2]
    count = re.search(r"holds (\d+) finished", refused)[1]
    assert f"warning: {count} finished samples of masses.h5 do not belong to this study" in out


@pytest.mark.parametrize("step", ["pwrite", "fsync"])
def test_a_full_disk_loses_nothing(undisturbed, tmp_path, monkeypatch, step):
    plan = planned(tmp_path)
    original = getattr(os, step)
    calls = []

    def full(*arguments):
        calls.append(arguments)
        if len(calls) > 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(*arguments)

    monkeypatch.setattr(journal.os, step, full)
    with pytest.raises(FileError, match=r"No space left.*run the study again to resume it"):
        run_study(plan, tmp_path / "s.h5", SerialExecutor())
    monkeypatch.undo()
    assert not (tmp_path / "s.h5").exists()
    pool = Counting()
    kept = run_study(plan, tmp_path / "s.h5", pool).kept
    assert kept > 0
    assert len(pool.ran) == 12 - kept
    assert_same(tmp_path / "s.h5", undisturbed)


LIMITED = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
import signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from dynid.cli import main
main(["study", "masses.yaml", "--executor", "serial", "-q"])
"""


@pytest.mark.thorough
@pytest.mark.parametrize("size", [5_000, pytest.param(15_000, marks=pytest.mark.slow)])
def test_a_file_that_may_not_grow_ends_in_a_message_and_no_crash(undisturbed, tmp_path, size):
    written(tmp_path)
    # -B: Python itself writes its caches without noticing that they are cut off.
    done = subprocess.run([sys.executable, "-B", "-c", LIMITED, str(size)], cwd=tmp_path, capture_output=True,
                          text=True, timeout=60, check=False)  # fmt: skip
    assert done.returncode == 4, done.stderr
    assert "cannot be written: File too large" in done.stderr
    assert not (tmp_path / "masses.h5").exists()
    assert [item.name for item in tmp_path.glob(".dynid*")] == []
    run_study(make_plan(load_scene(tmp_path / "masses.yaml")), tmp_path / "masses.h5", SerialExecutor())
    assert_same(tmp_path / "masses.h5", undisturbed)


def test_the_second_study_on_one_file_refuses_and_says_who_has_it(tmp_path):
    plan = planned(tmp_path)
    seen = []

    def again(_):
        if not seen:
            seen.append(1)
            with pytest.raises(
                FileError, match=rf"another study is writing .*s\.h5: process {os.getpid()} on"
            ):
                run_study(plan, tmp_path / "s.h5", SerialExecutor())

    run_study(plan, tmp_path / "s.h5", SerialExecutor(), report=again)
    assert seen
    assert not (tmp_path / "s.h5.lock").exists()


def test_a_lock_left_behind_by_the_dead_holds_nobody_up(undisturbed, tmp_path):
    (tmp_path / "s.h5.lock").write_text("process 1 on elsewhere")
    run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())
    assert_same(tmp_path / "s.h5", undisturbed)


@pytest.mark.parametrize("suffix", ["lock", "journal"])
def test_what_is_written_beside_a_study_follows_no_link(tmp_path, suffix):
    (tmp_path / "mine").write_text("my diary")
    (tmp_path / f"s.h5.{suffix}").symlink_to(tmp_path / "mine")
    with pytest.raises(FileError, match=rf"s\.h5\.{suffix} cannot be (written|locked): "):
        run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())
    assert (tmp_path / "mine").read_text() == "my diary"


def test_a_lock_whose_last_holder_removes_it_just_then_is_made_anew(undisturbed, tmp_path, monkeypatch):
    take, taken = fcntl.flock, []

    def removed(descriptor, how):
        take(descriptor, how)
        taken.extend([descriptor] if how & fcntl.LOCK_EX else [])
        if not how & fcntl.LOCK_EX:
            return
        if len(taken) == 1:
            (tmp_path / "s.h5.lock").unlink()
        elif len(taken) == 2:  # somebody else has made one in the meantime
            (tmp_path / "s.h5.lock").unlink()
            (tmp_path / "s.h5.lock").touch()

    monkeypatch.setattr(fcntl, "flock", removed)
    run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())
    assert len(taken) == 3
    assert_same(tmp_path / "s.h5", undisturbed)


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS])
def test_a_file_system_without_locks_is_named(tmp_path, monkeypatch, number):
    """A file that merely exists is no lock: it would outlive its process."""

    def none(*_):
        raise OSError(number, "No locks available")

    monkeypatch.setattr(fcntl, "flock", none)
    with pytest.raises(FileError, match=r"s\.h5\.lock cannot be locked: No locks available") as raised:
        run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())
    assert "has no locks: write the file to a local folder with -o" in raised.value.remedy


def test_a_journal_that_changes_under_a_study_is_not_believed(tmp_path):
    opened = journal.Journal(str(tmp_path / "s.h5.journal"))
    opened.append([(ANOTHER, FAILED)])
    for _ in range(2):  # the second time from what is at hand
        (block,) = opened.blocks(np.array([0]), np.array([5]))
        assert (block.rows.tolist(), block.errors) == ([5], ("it failed",))
    opened.close()
    again = journal.Journal(str(tmp_path / "s.h5.journal"))
    content = bytearray((tmp_path / "s.h5.journal").read_bytes())
    content[-1] ^= 1
    (tmp_path / "s.h5.journal").write_bytes(content)
    with pytest.raises(FileError, match=r"s\.h5\.journal has changed while the study ran"):
        list(again.blocks(np.array([0]), np.array([0])))
    again.close()


def test_samples_of_several_lengths_come_back_as_they_were(tmp_path):
    poles = [np.arange(1 + row % 3) + 1.0 for row in range(7)]
    values = {"p/poles": ("1/s", ("pole",), {}, poles), "p/gain": np.arange(7.0)}
    write(tmp_path / "s.h5", {"parameters.b": np.arange(7.0)}, values, failed={4: "singular"})
    with open_stored(tmp_path / "s.h5") as result:
        blocks = list(StudyFile(result).between(0, 7))
    found = {}
    for block in blocks:
        if "p/poles" in block.values:
            found |= dict(zip(block.rows.tolist(), block.values["p/poles"].data.tolist(), strict=True))
    assert found == {row: poles[row].tolist() for row in range(7) if row != 4}


def test_a_study_of_which_all_samples_failed_has_their_errors_alone(tmp_path):
    write(tmp_path / "s.h5", {"parameters.b": np.arange(3.0)}, {}, failed=range(3))
    with open_stored(tmp_path / "s.h5") as result:
        (block,) = StudyFile(result).between(0, 3)
    assert (block.values, block.errors) == ({}, ("singular at 0.5", "singular at 1.5", "singular at 2.5"))


def test_who_names_a_scheduler_means_dask(monkeypatch):
    monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", "tcp://127.0.0.1:1")
    assert type(make_executor()).__name__ == "DaskExecutor"
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS")
    assert isinstance(make_executor(), ProcessExecutor)
    assert type(make_executor(scheduler="tcp://127.0.0.1:1")).__name__ == "DaskExecutor"
    with pytest.raises(UsageError, match="no scheduler to ask"):
        make_executor("dask")
    with pytest.raises(UsageError, match="of no use"):
        make_executor("serial", scheduler="tcp://127.0.0.1:1")
    with pytest.raises(UsageError, match="name two schedulers"):
        make_executor(scheduler="tcp://127.0.0.1:1", scheduler_file="scheduler.json")


@pytest.mark.thorough
def test_the_template_of_a_study_runs_on_that_of_a_bond_graph(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    for name in ("bond-graph", "study"):
        assert dynid_cli("new", name)[0] == 0
    assert "dynid study study.yaml" in dynid_cli("new", "study", "--force")[1]
    code, out, _ = dynid_cli("study", "study.yaml", "--dry-run")
    assert code == 0
    assert "50 samples of bond-graph.yaml (bond-graph)" in out
    assert "study.h5: 0 finished, 50 to run" in out
    options = ("--set", "sampling.samples=3", "--executor", "serial")
    code, out, said = dynid_cli("study", "study.yaml", *options)
    assert (code, "wrote study.h5" in out, said.splitlines()[-1]) == (0, True, "3 of 3 samples")
    assert read_result("study.h5")["study/status"].data.tolist() == ["done"] * 3
    assert dynid_cli("study", "study.yaml", *options, "-q")[1:] == ("", "")


def test_the_command_line_says_what_a_study_is_and_what_is_none(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    written(tmp_path)
    code, _, said = dynid_cli("run", "masses.yaml")
    assert (code, said) == (
        2, "masses.yaml:1:1: this is a study: many runs of a scene. Run it with: dynid study masses.yaml\n"
    )  # fmt: skip
    assert dynid_cli("check", "masses.yaml")[:2] == (0, "masses.yaml: valid (study: Masses on dampers)\n")
    code, _, said = dynid_cli("study", "mass.yaml")
    assert code == 2
    assert "not a study. Run it with: dynid run mass.yaml" in said
    assert dynid_cli("study", "masses.yaml", "--shard", "3/2")[0] == 2
    code, out, _ = dynid_cli("study", "masses.yaml", "--shard", "2/3", "--dry-run")
    assert code == 0
    assert "masses.yaml" not in out.partition("  time ")[0]
    assert "Masses on dampers: 4 samples of mass.yaml (bond-graph)" in out
    assert "shard     of 12 samples, one in 3 or so" in out
    assert "…" not in out
    assert dynid_cli("study", "masses.yaml", "-o", "mass.yaml")[0] == 2
    (tmp_path / "mass.yaml").unlink()
    code, _, said = dynid_cli("check", "masses.yaml")
    assert code == 4
    assert said.startswith("masses.yaml:4:8: mass.yaml: no such file; did you mean 'masses.yaml'?")


def test_a_circle_of_studies_is_refused_at_its_place(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    text = "dynid: 1\nkind: study\nscene: {}\nvary: {{parameters.b: {{values: [1]}}}}\n"
    for name, other in (("self", "self"), ("one", "other"), ("other", "one")):
        (tmp_path / f"{name}.yaml").write_text(text.format(f"{other}.yaml"))
    for command in ("check", "study"):
        for name in ("self", "one"):
            code, _, err = dynid_cli(command, f"{name}.yaml")
            assert code == 2
            assert f"{name}.yaml:3:8: this is a study itself" in err


def test_samples_without_what_is_gathered_anyway_are_done(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    asked = (
        "  results: [poles]\nexpect:\n  - {path: bond_graph/transfer_function/m.f/F/poles, value: [-0.5]}\n"
    )
    written(tmp_path, STUDY.partition("collect:")[0], f"{SCENE.partition('expect:')[0]}{asked}")
    code, out, _ = dynid_cli("study", "masses.yaml", "--executor", "serial")
    assert code == 0
    assert "12 done" in out
    assert "nothing was collected; name the outputs in the study's 'collect'" in out
    assert (read_result(tmp_path / "masses.h5")["study/expect/0"].data.sum()) == 2


@pytest.mark.thorough
def test_too_many_failures_are_an_exit_code(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, STUDY.replace("-2]", "nothing]"))
    assert dynid_cli("study", "masses.yaml", "--executor", "serial", "--max-failures", "2")[0] == 3
    assert dynid_cli("study", "masses.yaml", "--executor", "serial", "--max-failures", "4")[0] == 0
    assert dynid_cli("study", "masses.yaml", "--executor", "serial")[0] == 0
    for index in (1, 2):
        assert dynid_cli("study", "masses.yaml", "--executor", "serial", "--shard", f"{index}/2")[0] == 0
    code, out, _ = dynid_cli("study-merge", "masses-1-of-2.h5", "masses-2-of-2.h5", "-o", "both.h5")
    assert (code, out) == (0, "wrote both.h5: 12 samples of 2 files\n")
    assert_same("both.h5", "masses.h5")


@pytest.mark.parametrize("quiet", [(), ("-q",)])
def test_a_study_of_which_all_samples_fail_warns_and_may_be_repeated(tmp_path, monkeypatch, dynid_cli, quiet):
    monkeypatch.chdir(tmp_path)
    wrong = STUDY[: STUDY.index("collect")] + "collect: [bond_graph/properties/m.f/dc_gian]\n"
    written(tmp_path, wrong)
    run = ("study", "masses.yaml", "--executor", "serial", *quiet)
    code, _, err = dynid_cli(*run)
    assert code == 0  # as the failures of single samples
    warning = next(line for line in err.splitlines() if "warning" in line)
    assert warning.startswith(
        "masses.yaml: warning: all 12 samples failed: there is nothing to collect at "
        "'bond_graph/properties/m.f/dc_gian'; did you mean 'bond_graph/properties/m.f/F/dc_gain'?"
    )
    assert "dynid show masses.h5" in warning
    assert dynid_cli(*run, "--max-failures", "3")[0] == 3
    # nothing of value is lost by another study
    written(tmp_path, wrong.replace("/dc_gian", "/F/dc_gain"))
    code, _, err = dynid_cli(*run)
    assert (code, "warning" in err) == (0, False)
    written(tmp_path, wrong)
    assert dynid_cli(*run)[0] == 2
