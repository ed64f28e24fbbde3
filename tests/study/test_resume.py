"""Resumed studies: no finished sample is lost, whatever was damaged, changed or interrupted."""

import errno
import itertools
import os
import re
import shlex
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.cli import main
from dynid.errors import FileError, UsageError
from dynid.scene.outcomes import SampleOutcome, SampleOutcomes
from dynid.store import read_result
from dynid.study import journal
from dynid.study import run as running
from dynid.study.executors import SerialExecutor
from dynid.study.journal import MAGIC, Journal
from dynid.study.run import foreign_samples, run_study, valid_samples
from dynid.study.work import packed
from tests.cli import conftest
from tests.sample import sample
from tests.study.small import STUDY, assert_same, planned, written

pytestmark = pytest.mark.thorough

dynid_cli = conftest.dynid

SIZES = [1, 3, 2, 5, 1, 4]  # samples of the records


def record(number):
    """Return keys and outcomes of a record."""
    keys = np.frombuffer(b"".join(zlib.crc32(bytes([number, k])).to_bytes(4, "big") * 4
                                  for k in range(SIZES[number])), np.uint8).reshape(-1, 16)  # fmt: skip
    outcomes = [SampleOutcome(error=f"it failed, {number}/{k}", exit_code=3) for k in range(SIZES[number])]
    return keys, packed(SampleOutcomes.of(outcomes))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The bytes of a journal, and where its records begin and end."""
    path = tmp_path_factory.mktemp("journal") / "j"
    opened, places = Journal(str(path)), [len(MAGIC)]
    for number in range(len(SIZES)):
        opened.append([record(number)])
        places.append(path.stat().st_size)
    opened.close()
    return path.read_bytes(), places


#: Where in a record something is: its length, its CRC, the count, the keys, the codes, the outcomes.
PARTS = {"length": (0, 8), "crc": (8, 12), "count": (12, 16), "keys": (16, 32), "rest": (32, None)}


@pytest.mark.thorough
@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_a_flipped_bit_costs_its_own_record_at_most(whole, tmp_path_factory, data):
    content, places = bytearray(whole[0]), whole[1]
    number = data.draw(st.integers(0, len(SIZES) - 1))
    begin, end = PARTS[data.draw(st.sampled_from(sorted(PARTS)))]
    size = places[number + 1] - places[number]
    place = places[number] + data.draw(st.integers(begin, (end or size) - 1))
    content[place] ^= 1 << data.draw(st.integers(0, 7))
    path = tmp_path_factory.mktemp("flipped") / "j"
    path.write_bytes(content)
    known = len(Journal.read_keys(str(path)))
    opened = Journal(str(path))
    assert opened.damage is not None
    assert opened.damage.lost in (0, SIZES[number])
    assert opened.damage.known
    assert len(opened.keys) == known == sum(SIZES) - opened.damage.lost
    if place - places[number] < 8:
        assert opened.damage.lost == 0  # the CRC still tells that all else is whole
    assert Path(f"{path}.damaged").read_bytes() == content
    for other in set(range(len(SIZES))) - ({number} if opened.damage.lost else set()):
        keys, _ = record(other)
        found = opened.numbers(keys)
        assert (found >= 0).all()
        blocks = list(opened.blocks(found, np.arange(len(found))))
        errors = {row: error for block in blocks for row, error in zip(block.rows, block.errors, strict=True)}
        assert [errors[row] for row in range(len(keys))] == [
            f"it failed, {other}/{k}" for k in range(len(keys))
        ]
    opened.append([record(number)])
    opened.close()
    again = Journal(str(path))  # it is whole now
    assert again.damage is None
    assert (again.numbers(record(number)[0]) >= 0).all()
    again.close()


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_bytes_that_are_overwritten_cost_the_records_that_they_are_in(whole, tmp_path_factory, data):
    content, places = bytearray(whole[0]), whole[1]
    start = data.draw(st.integers(len(MAGIC), len(content) - 1))
    stop = min(len(content), start + data.draw(st.integers(1, 400)))
    content[start:stop] = data.draw(st.binary(min_size=stop - start, max_size=stop - start))
    path = tmp_path_factory.mktemp("overwritten") / "j"
    path.write_bytes(content)
    hit = {
        number for number in range(len(SIZES)) if start < places[number + 1] and stop > places[number]
    }  # fmt: skip
    opened = Journal(str(path))
    for number in set(range(len(SIZES))) - hit:
        assert (opened.numbers(record(number)[0]) >= 0).all()
    opened.close()


def test_a_damaged_beginning_costs_nothing(whole, tmp_path):
    content = bytearray(whole[0])
    content[3] ^= 4
    (tmp_path / "j").write_bytes(content)
    opened = Journal(str(tmp_path / "j"))
    assert (len(opened.keys), opened.damage.lost) == (sum(SIZES), 0)
    opened.close()


def test_a_record_that_was_being_written_is_cut_off_without_a_word(whole, tmp_path):
    content, places = whole
    for end in range(places[-2] + 1, places[-1], 7):
        (tmp_path / "j").write_bytes(content[:end])
        opened = Journal(str(tmp_path / "j"))
        assert opened.damage is None
        assert len(opened.keys) == sum(SIZES[:-1])
        opened.close()
    assert not list(tmp_path.glob("*damaged*"))


def test_damage_is_reported_in_numbers_and_run_again(tmp_path, monkeypatch, dynid_cli):
    monkeypatch.chdir(tmp_path)
    written(tmp_path)
    monkeypatch.setattr("dynid.study.scheduler.Chunks.size", lambda *_: 3)
    with monkeypatch.context() as patch:
        patch.setattr(running, "write_study", _stop)
        dynid_cli("study", "masses.yaml", "--executor", "serial", "-q")
    content = bytearray(Path("masses.h5.journal").read_bytes())
    content[len(content) // 2] ^= 0x10
    for turn in ("", "-2"):
        Path("masses.h5.journal").write_bytes(content)
        code, _, err = dynid_cli("study", "masses.yaml", "--executor", "serial", "-q")
        assert code == 0
        assert re.search(
            r"masses\.yaml: warning: .*masses\.h5\.journal was damaged: 3 finished samples in it cannot be "
            rf"read\. It is kept as .*masses\.h5\.journal\.damaged{turn}\n", err
        )  # fmt: skip
        assert Path(f"masses.h5.journal.damaged{turn}").read_bytes() == content
        assert read_result("masses.h5")["study/status"].data.tolist() == ["done"] * 12
        Path("masses.h5").unlink()


def _stop(*_, **__):
    raise KeyboardInterrupt


def test_a_full_disk_at_the_end_names_the_journal(tmp_path, monkeypatch):
    def full(*_, **__):
        raise FileError("s.h5 cannot be written: No space left on device")

    monkeypatch.setattr(running, "write_study", full)
    with pytest.raises(
        FileError, match=r"No space left.*s\.h5\.journal holds 12 finished samples\. Free space"
    ):
        run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())
    monkeypatch.undo()
    assert run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor()).kept == 12


def test_a_full_disk_in_the_middle_says_how_many_samples_are_safe(tmp_path, monkeypatch):
    original, calls = os.pwrite, []

    def full(*arguments):
        calls.append(arguments)
        if len(calls) > 3:  # the header, the first sample and those after it are written
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return original(*arguments)

    monkeypatch.setattr(journal.os, "pwrite", full)
    with pytest.raises(
        FileError, match=r"No space left on device\. The \d+ finished samples in it stay safe"
    ):
        run_study(planned(tmp_path), tmp_path / "s.h5", SerialExecutor())


OTHERS = {
    "fewer": STUDY.replace("points: 4", "points: 2"),
    "different": STUDY.replace("[0.5, 1, -2]", "[0.5, 1, -3]"),
    "another result": STUDY.replace("/m.f/F/poles", "/m.f/F/zeros"),
}


@pytest.mark.parametrize(
    ("held", "other"),
    sample(
        itertools.product(["file", "journal"], OTHERS),
        0,
        ("file", "different"),
        ("journal", "another result"),
    ),
)
def test_another_study_replaces_no_finished_samples(tmp_path, monkeypatch, other, held):
    target = tmp_path / "s.h5"
    with monkeypatch.context() as patch:
        if held == "journal":
            patch.setattr(running, "write_study", _stop)
        try:
            run_study(planned(tmp_path), target, SerialExecutor())
        except KeyboardInterrupt:
            assert held == "journal"
    before = {path.name: path.read_bytes() for path in tmp_path.glob("s.h5*")}
    plan = planned(tmp_path, OTHERS[other])
    lost = 12 - valid_samples(plan, target)
    with pytest.raises(UsageError, match=rf"holds {lost} finished samples that do not belong to this study"):
        run_study(plan, target, SerialExecutor())
    assert {path.name: path.read_bytes() for path in tmp_path.glob("s.h5*")} == before
    run_study(plan, target, SerialExecutor(), force=True)
    run_study(plan, tmp_path / "new.h5", SerialExecutor())
    assert_same(target, tmp_path / "new.h5")
    assert foreign_samples(str(target), read_keys(target)) == 0


def read_keys(target):
    keys = "".join(read_result(target)["study/key"].data)
    return np.frombuffer(bytes.fromhex(keys), np.uint8).reshape(-1, 16)


OPTIONS = [
    ["--set", "vary.parameters.b.values=[0.5, 1]", "--set", "title=Two words & 'quotes'"],
    ["--executor", "serial", "-o", "my file.h5", "--shard", "1/2"],
    ["--workers", "2", "--max-failures", "3", "--retry-failed", "--sample-timeout", "12.5", "-q"],
    ["--scheduler", "tcp://127.0.0.1:1", "--executor", "dask"],
    ["--scheduler-file", "sch ed.json", "--junit", "out.xml", "--report", "page.html", "--force"],
]


@pytest.mark.parametrize("options", OPTIONS)
def test_the_command_to_go_on_is_the_whole_command(tmp_path, monkeypatch, capsys, options):
    monkeypatch.chdir(tmp_path)
    written(tmp_path)
    asked = []

    def interrupted(plan, target, pool, **limits):
        asked.append(
            (
                plan.study.source.resolved_text(),
                target,
                type(pool).__name__,
                pool.timeout,
                vars_of(pool),
                {key: limits[key] for key in ("shard", "max_failures", "retry_failed")},
            )
        )
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "run_study", interrupted)

    def call(arguments):
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 130
        return capsys.readouterr().err.strip().rpartition("Resume with: ")[2]

    again = shlex.split(call(["study", "masses.yaml", *options]))
    assert again[:2] == ["dynid", "study"]
    assert "--force" not in again
    repeated = shlex.split(call(again[1:]))
    assert repeated == again
    assert asked[0] == asked[1]


def vars_of(pool):
    return {
        key: value for key, value in vars(pool).items() if key in ("_where", "_options", "_workers", "width")
    }
