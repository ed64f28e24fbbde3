"""Results that come block by block, a disk that fills up meanwhile, and interrupts at any moment."""

import errno
import os
import signal
import threading

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.result import Result
from dynid.store import read_result, write_blocks, write_result
from dynid.store.files import Terminated, deferred_interrupts, hollow, terminations
from dynid.store.writer import Sink

FULL = OSError(errno.ENOSPC, "No space left on device")


def filling(monkeypatch, taken):
    """Let the disk take so many bytes, and count what it is asked to take."""
    write, asked = os.pwrite, [0]

    def pwrite(descriptor, content, place):
        asked[0] += len(content)
        room = taken - asked[0] + len(content)
        if room <= 0:
            raise FULL
        return write(descriptor, content[:room], place)

    monkeypatch.setattr("dynid.store.writer.os.pwrite", pwrite)
    return asked


# --- the file that never fails ---------------------------------------------------------------------


@pytest.mark.parametrize("taken", [0, 3, 10, 14, 100])
def test_what_the_disk_does_not_take_is_read_back_all_the_same(tmp_path, monkeypatch, taken):
    (tmp_path / "f").touch()
    filling(monkeypatch, taken)
    sink, mirror = Sink(str(tmp_path / "f")), bytearray(40)
    for place, content in ((0, b"0123456789"), (20, b"abcdef"), (5, b"VWXYZ"), (18, b"##")):
        sink.seek(place)
        assert sink.write(content) == len(content)
        mirror[place : place + len(content)] = content
    assert sink.truncate(30) == 30
    for place, count in ((0, 30), (4, 3), (17, 5), (25, 40)):
        assert sink.seek(place) == sink.tell() == place
        assert sink.read(count) == bytes(mirror[place : min(place + count, 30)])
    assert (sink.error is FULL) == (taken < 23)
    if sink.error:
        with pytest.raises(OSError, match="No space"):
            sink.check()
    sink.close()


def test_the_first_error_is_the_one_that_is_told(tmp_path, monkeypatch):
    (tmp_path / "f").touch()
    sink = Sink(str(tmp_path / "f"))

    def fail(*_):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr("dynid.store.writer.os.ftruncate", fail)
    sink.truncate(7)
    filling(monkeypatch, 0)
    sink.write(b"more")
    with pytest.raises(OSError, match="Input/output error"):
        sink.check()
    sink.close()


# --- results block by block ------------------------------------------------------------------------

VALUES = np.arange(6000.0).reshape(2000, 3)


def in_blocks(path, rows=VALUES, finish=None):
    result = Result("k", "new")
    result.add("a/x", hollow((2000, 3), float), ("n", "m"))
    blocks = (("a/x", first, rows[first : first + 100]) for first in range(0, 2000, 100))
    write_blocks(result, path, blocks, finish=finish)


def test_a_disk_that_fills_up_at_any_moment_leaves_the_old_file(tmp_path, monkeypatch):
    write_result(Result("k", "old"), tmp_path / "r.h5")
    asked = filling(monkeypatch, 10**9)
    in_blocks(tmp_path / "new.h5")
    assert np.array_equal(read_result(tmp_path / "new.h5")["a/x"].data, VALUES)
    (tmp_path / "new.h5").unlink()
    for taken in range(0, asked[0], asked[0] // 12):
        monkeypatch.undo()
        filling(monkeypatch, taken)
        with pytest.raises(FileError, match="No space left"):
            in_blocks(tmp_path / "r.h5")
    monkeypatch.undo()
    assert read_result(tmp_path / "r.h5").title == "old"
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]


def test_blocks_that_do_not_fit_are_told(tmp_path):
    with pytest.raises(FileError, match=r"r\.h5 cannot be written"):
        in_blocks(tmp_path / "r.h5", rows=np.zeros((2000, 7)))
    assert not (tmp_path / "r.h5").exists()


# --- what the store keeps for itself ---------------------------------------------------------------


def test_notes_at_the_root_are_kept_but_those_of_the_store_are_its_own(tmp_path):
    result = Result("k")
    result.annotate("", note="by hand")
    write_result(result, tmp_path / "r.h5")
    assert read_result(tmp_path / "r.h5").attrs["note"] == "by hand"
    for group, name in (("", "kind"), ("a", "units")):
        other = Result("k")
        other.annotate(group, **{name: "x"})
        with pytest.raises(FileError, match=f"the attribute '{name}' is set by the store"):
            write_result(other, tmp_path / "other.h5")


def test_packages_that_are_not_there_have_no_version(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.store.files._PACKAGES", ("numpy", "no-such-package"))
    write_result(Result("k"), tmp_path / "r.h5")
    assert read_result(tmp_path / "r.h5").attrs["packages"] == f"numpy {np.__version__}"


# --- interrupts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("asked", [True, False])
def test_an_interrupt_waits_until_it_is_asked_for_or_the_end(number, asked):
    reached = []

    def work():
        with terminations(), deferred_interrupts() as check:
            check()
            os.kill(os.getpid(), number)
            reached.append("after it")
            if asked:
                check()
            reached.append("the end")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == (["after it"] if asked else ["after it", "the end"])


def test_what_ends_a_process_at_once_is_left_to_do_so():
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with deferred_interrupts():
            assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
            assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_request_to_end_interrupts_for_as_long_as_that_is_wished():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Terminated), terminations():
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_thread_leaves_the_signals_alone(tmp_path):
    """Python lets the main thread alone set handlers; results can be written in any."""
    failed = []

    def work():
        try:
            with terminations():
                in_blocks(tmp_path / "r.h5")
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert not failed
    assert read_result(tmp_path / "r.h5").title == "new"


def test_a_file_that_cannot_be_opened_leaves_nothing_to_close(tmp_path):
    with pytest.raises(FileNotFoundError):
        Sink(str(tmp_path / "none" / "f"))
