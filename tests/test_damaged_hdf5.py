"""A file on which a compiled parser crashes or hangs, or that is no longer as written, is refused."""

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

import dynid.hdf5
from dynid import trial
from dynid.errors import FileError
from dynid.files import matlab, untrusted
from dynid.files.frequency_responses import ResponseLayout
from dynid.files.read_matrix import MatrixFile, read_matrix
from dynid.files.read_measured import read_columns, read_responses
from dynid.files.table import DataFile
from dynid.hdf5 import open_hdf5
from dynid.result import Result
from dynid.store import read_result, write_result
from dynid.store.files import hollow, write_blocks
from dynid.trial import messages, survives
from tests.copies import told_by_a_copy

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize(
    ("name", "outcome"),
    [
        ("returns", True),
        ("fails", None),
        ("crashes", False),
        ("takes_memory", False),
        ("lacks_memory", False),
    ],
)
def test_only_what_dies_does_not_survive(capfd, name, outcome):
    assert survives(f"tests.doomed:{name}", "x", memory=2**30) is outcome
    assert capfd.readouterr() == ("", "")


def test_what_never_ends_does_not_survive():
    assert survives("tests.doomed:never_ends", "x", seconds=0.01) is False


@pytest.mark.parametrize("number", [0, 3])
def test_what_was_sent_before_the_processor_time_was_over_is_received(number):
    received = messages("tests.doomed:sends_and_never_ends", str(number), seconds=30)
    assert list(received) == [{"number": k} for k in range(number)]


def test_what_was_sent_before_a_crash_or_the_time_was_over_is_received():
    assert list(messages("tests.doomed:crashes_after_a_message", seconds=30)) == [[1, 2]]
    assert list(messages("tests.doomed:never_ends", seconds=0.5)) == []


def test_a_stream_that_is_not_read_to_its_end_leaves_no_process():
    received = messages("tests.doomed:sends_and_never_ends", "2", seconds=30)
    assert next(received) == {"number": 0}
    received.close()


def test_beside_other_threads_there_is_a_trial():
    stop = threading.Event()
    thread = threading.Thread(target=stop.wait)
    thread.start()
    try:
        assert survives("tests.doomed:crashes", "x") is False
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize("program", [None, "", "/opt/host/application.exe", sys.executable])
def test_a_program_that_python_is_embedded_in_is_not_started(monkeypatch, program):
    def none(*_, **__):
        raise OSError("no processes here")

    monkeypatch.setattr(sys, "executable", program)
    monkeypatch.setattr(subprocess, "Popen", none)
    assert survives("tests.doomed:crashes", "x") is None


def test_a_process_is_limited_where_the_system_can(monkeypatch):
    import resource

    limits = {}
    monkeypatch.setattr(resource, "setrlimit", lambda what, values: limits.update({what: values}))
    trial._limit(10**9)
    assert limits == {resource.RLIMIT_CORE: (0, 0), resource.RLIMIT_AS: (10**9, 10**9)}


@pytest.mark.parametrize("system", ["win32", "other"])
def test_systems_without_limits_show_no_dialogs(monkeypatch, system):
    modes = []

    class Runtime:
        SEM_FAILCRITICALERRORS, SEM_NOGPFAULTERRORBOX = 1, 2
        SetErrorMode = modes.append

    monkeypatch.setitem(sys.modules, "resource", None)
    monkeypatch.setitem(sys.modules, "msvcrt", Runtime)
    monkeypatch.setattr(sys, "platform", system)
    trial._limit(10**9)
    assert modes == ([3] if system == "win32" else [])


# --- HDF5 ------------------------------------------------------------------------------------------


@pytest.fixture
def tried(monkeypatch):
    """The files that were read on trial, none of which survives."""
    names = []
    monkeypatch.setattr(trial, "survives", lambda _, name, **__: names.append(name))
    return names


def result_of(size=3):
    result = Result("identification", "A title")
    result.add("group/x", np.arange(float(size)), ("axis",))
    return result


@pytest.mark.parametrize("name", [b"DIMENSION_SCAL\xe1", b"DIMENSION_SCALX", b"TABLE"])
def test_an_array_of_another_class_is_no_scale_and_ends_nothing(tmp_path, name):
    """The function of HDF5 2.0 that tells scales apart aborts on it."""
    path = tmp_path / "a.h5"
    write_result(result_of(), path)
    with h5py.File(path, "r+") as file:
        file["group/x"].attrs["CLASS"] = np.bytes_(name)

    def read():
        yield read_result(path)["group/x"].dims

    assert told_by_a_copy(read) == ([["axis"]], 0)


def test_readers_refuse_in_one_sentence_what_would_crash_them(tmp_path, monkeypatch):
    path = tmp_path / "k.h5"
    with h5py.File(path, "w") as file:
        file["K"] = np.eye(2)
    monkeypatch.setattr(trial, "survives", lambda *_: survives("tests.doomed:crashes", "x"))
    for read in (read_result, lambda path: read_matrix(MatrixFile(path, "K"), "stiffness")):
        with pytest.raises(FileError, match=r"k\.h5.*damaged"):
            read(path)


def test_a_good_file_is_read_after_a_real_trial(tmp_path):
    with h5py.File(tmp_path / "k.h5", "w") as file:
        file["K"] = np.eye(2)
    np.testing.assert_array_equal(read_matrix(MatrixFile(tmp_path / "k.h5"), "stiffness").matrix, np.eye(2))


def test_a_file_is_tried_once_and_again_after_it_changed(tmp_path, tried):
    path = tmp_path / "a.h5"
    for count, value in ((1, 1.0), (2, 2.0)):
        with h5py.File(path, "w") as file:
            file["x"] = np.full(count, value)
        for _ in range(3):
            with open_hdf5(path) as file:
                assert file["x"][0] == value
        assert len(tried) == count


def test_a_trial_reads_all_that_it_may_and_raises_nothing(tmp_path, monkeypatch):
    path = tmp_path / "a.h5"
    write_result(result_of(), path)
    read = []
    real = h5py.Dataset.__getitem__
    with h5py.File(path, "a") as file:
        file["group/again"] = file["group"]  # a circle of hard links
        file["soft"], file["out"] = h5py.SoftLink("/nowhere"), h5py.ExternalLink("other.h5", "/x")
        file["large"], file["type"] = np.ones(2000), np.dtype("f8")
        file.create_dataset("empty", (100,), "f8", chunks=(100,))  # claims what is not stored
        file["none"] = h5py.Empty("f8")
    monkeypatch.setattr(dynid.hdf5, "_MOST_BYTES", 15_000)
    monkeypatch.setattr(
        h5py.Dataset, "__getitem__", lambda self, key: read.append(self.name) or real(self, key)
    )
    dynid.hdf5.read_all(str(path))
    assert {name.rpartition("/")[2] for name in read} == {"axis", "scene", "x"}
    (tmp_path / "b.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    dynid.hdf5.read_all(str(tmp_path / "b.h5"))


def in_blocks(path):
    result = Result("study")
    result.add("long", hollow((5,), float), ("row",))
    write_blocks(result, path, [("long", 0, np.ones(2)), ("long", 2, np.ones(3))])


@pytest.mark.parametrize("write", [lambda path: write_result(result_of(), path), in_blocks])
class TestOwnFiles:
    """Results carry a checksum behind their data."""

    def test_are_not_tried_and_are_plain_hdf5(self, tmp_path, tried, write):
        write(tmp_path / "a.h5")
        assert read_result(tmp_path / "a.h5").kind
        assert tried == []
        content = (tmp_path / "a.h5").read_bytes()
        assert content.startswith(b"\x89HDF")
        with h5py.File(tmp_path / "a.h5") as file:
            assert file.id.get_filesize() == len(content)
            assert file.attrs["status"] == "complete"

    def test_are_refused_after_any_change(self, tmp_path, tried, write):
        write(tmp_path / "a.h5")
        whole = (tmp_path / "a.h5").read_bytes()
        for place in np.random.default_rng(3).integers(0, len(whole) - 22, 40):
            changed = bytearray(whole)
            changed[place] ^= 1 << int(place) % 8
            (tmp_path / "b.h5").write_bytes(changed)
            with pytest.raises(FileError, match=r"b\.h5 is damaged: it does not match its checksum"):
                read_result(tmp_path / "b.h5")
            (tmp_path / "b.h5").unlink()
        assert tried == []

    @pytest.mark.parametrize("change", ["nothing", "in place", "more"])
    def test_of_other_writers_are_tried(self, tmp_path, tried, write, change):
        write(tmp_path / "a.h5")
        with h5py.File(tmp_path / "a.h5", "a") as file:
            if change == "in place":
                file[next(name for name in ("long", "group/x") if name in file)][0] = 7.0
            elif change == "more":
                file["more"] = np.arange(3.0)
        assert read_result(tmp_path / "a.h5").kind
        assert tried == [str(tmp_path / "a.h5")]

    def test_that_are_large_are_tried(self, tmp_path, tried, write, monkeypatch):
        monkeypatch.setattr(dynid.hdf5, "CHECKED", 1000)
        monkeypatch.setattr("dynid.store.files.CHECKED", 1000)
        write(tmp_path / "a.h5")
        assert b"crc32" not in (tmp_path / "a.h5").read_bytes()
        assert read_result(tmp_path / "a.h5").kind
        assert len(tried) == 1

    def test_that_lost_their_end_are_refused(self, tmp_path, write):
        write(tmp_path / "a.h5")
        whole = (tmp_path / "a.h5").read_bytes()
        (tmp_path / "b.h5").write_bytes(whole[: len(whole) // 2])
        with pytest.raises(FileError, match="damaged"):
            read_result(tmp_path / "b.h5")


# --- MATLAB ----------------------------------------------------------------------------------------

K = np.array([[2.0, -1], [-1, 2]])


@pytest.fixture
def mat(tmp_path):
    savemat(tmp_path / "k.mat", {"K": K})
    return tmp_path / "k.mat"


def stiffness(path):
    return read_matrix(MatrixFile(path), "stiffness").matrix


def test_a_matlab_file_is_read_apart_once_and_again_after_it_changed(mat, monkeypatch):
    calls = []
    monkeypatch.setattr(
        trial, "survives", lambda *call, **bounds: calls.append(bounds) or survives(*call, **bounds)
    )
    for _ in range(2):
        np.testing.assert_array_equal(stiffness(mat), K)
    assert len(calls) == 1
    assert calls[0]["memory"] < 2.2e9  # of a small file, of a scale with it
    savemat(mat, {"K": 2 * K, "other": 1.0})
    np.testing.assert_array_equal(stiffness(mat), 2 * K)
    assert len(calls) == 2


@pytest.mark.parametrize("fate", ["crashes", "takes_memory"])
def test_a_matlab_file_that_ends_its_reader_is_refused(mat, monkeypatch, fate):
    monkeypatch.setattr(
        trial, "survives", lambda *_, **__: survives(f"tests.doomed:{fate}", "x", memory=2**30)
    )
    with pytest.raises(
        FileError, match=r"k\.mat cannot be read as a MATLAB file: it is damaged.* Save it again"
    ):
        stiffness(mat)


@pytest.mark.usefixtures("untried")
def test_archives_of_matlab_files_are_few_and_leave_nothing(mat, monkeypatch):
    monkeypatch.setattr(untrusted, "_archives", {})
    monkeypatch.setattr(untrusted, "KEPT", 3)
    ends = []
    monkeypatch.setattr(untrusted.atexit, "register", ends.append)
    untrusted._folder.cache_clear()
    for k in range(untrusted.KEPT + 2):
        shutil.copy(mat, mat.with_name(f"{k}.mat"))
        np.testing.assert_array_equal(stiffness(mat.with_name(f"{k}.mat")), K)
    folder = Path(untrusted._folder(os.getpid()))
    assert len([*folder.iterdir()]) == untrusted.KEPT
    next(iter(untrusted._archives.values())).unlink()  # somebody tidies the folder
    for k in range(untrusted.KEPT + 2):
        np.testing.assert_array_equal(stiffness(mat.with_name(f"{k}.mat")), K)
    monkeypatch.setattr(os, "getpid", lambda: -1)  # in a copy of the process
    ends[0]()
    assert folder.is_dir()
    monkeypatch.undo()
    ends[0]()
    assert not folder.exists()
    untrusted._folder.cache_clear()


def test_claims_of_a_matlab_file_are_checked_before_it_is_read(tmp_path):
    cells = np.empty((1, 2), dtype=object)
    cells[0, :] = ["a", "b"]
    savemat(tmp_path / "c.mat", {"K": K, "many": cells, "other": np.eye(3)})
    content = (tmp_path / "c.mat").read_bytes()
    shape = np.array([1, 2], "<i4").tobytes()
    assert content.count(shape) == 1  # of the cells alone
    (tmp_path / "c.mat").write_bytes(content.replace(shape, np.array([1, 2**30], "<i4").tobytes()))
    with pytest.raises(FileError, match=r"'many' claims 1073741824 entries, more than its bytes"):
        stiffness(tmp_path / "c.mat")


def test_a_variable_that_is_too_large_harms_no_other(tmp_path, monkeypatch):
    savemat(tmp_path / "c.mat", {"K": K, "large": np.ones(500)})
    monkeypatch.setattr(matlab, "MOST_NUMBERS", 300)
    monkeypatch.setattr("dynid.files.untrusted.MOST_NUMBERS", 300)
    savemat(tmp_path / "c.mat", {"K": K, "large": np.ones(500)}, do_compression=True)
    np.testing.assert_array_equal(read_matrix(MatrixFile(tmp_path / "c.mat", "K"), "stiffness").matrix, K)
    with pytest.raises(FileError, match="claims a matrix of 1 x 500"):
        read_matrix(MatrixFile(tmp_path / "c.mat", "large"), "stiffness")


def test_version_4_is_read_too(tmp_path):
    from scipy.sparse import csc_array

    savemat(tmp_path / "k.mat", {"K": csc_array(K), "w": "text"}, format="4")
    np.testing.assert_array_equal(stiffness(tmp_path / "k.mat").toarray(), K)


def test_what_else_is_in_a_matlab_file_is_passed_over(tmp_path):
    """Objects and handles of functions are written by MATLAB alone; here they are as SciPy returns them."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    plain = np.zeros(1, dtype=[("a", object)])
    index, members = {}, {}
    for kind in (MatlabFunction, MatlabObject, MatlabOpaque):
        matlab._add("x", kind(plain), 0, index, members)
    assert (index, members) == ({}, {})
    cells = np.empty((1, 1), dtype=object)
    cells[0, 0] = K
    handles = np.empty((1, 2), dtype=object)
    handles[0, :] = ["text", K]
    savemat(tmp_path / "m.mat", {"model": {"K": K, "cells": cells}, "mixed": handles, "c": "text"})
    assert [*matlab.MATRICES.shapes(tmp_path / "m.mat")] == ["model/K"]
    assert matlab.names(tmp_path / "m.mat") == ["model/K", "mixed"]
    with pytest.raises(FileError, match=r"'mixed\{1\}' is no matrix of real numbers"):
        read_columns(tmp_path / "m.mat", ["mixed"])
    with pytest.raises(FileError, match="'mixed' is no full matrix of numbers"):
        matlab.complex_columns(DataFile(tmp_path / "m.mat"), ["mixed"], "columns")


def test_responses_are_not_read_from_version_7_3(tmp_path):
    with h5py.File(tmp_path / "x.mat", "w", userblock_size=512) as file:
        file["y"] = K
    with pytest.raises(FileError, match=r"x\.mat is a MATLAB file of version 7\.3, .* with -v7\."):
        read_responses(tmp_path / "x.mat", ResponseLayout(["y"]), "")


@pytest.mark.usefixtures("untried")
def test_a_lack_of_memory_in_the_separate_process_is_reported(mat, monkeypatch):
    def lack(*_, **__):
        raise MemoryError

    monkeypatch.setattr("scipy.io.matlab.loadmat", lack)
    with pytest.raises(FileError, match=r"k\.mat cannot be read .*: it claims more than the memory"):
        stiffness(mat)


def test_a_file_of_text_is_no_matlab_file(tmp_path):
    (tmp_path / "k.mat").write_text("These are no matrices, but more than 128 characters of text. " * 4)
    with pytest.raises(FileError, match=r"k\.mat cannot be read as a MATLAB file: .* with -v7\."):
        stiffness(tmp_path / "k.mat")
