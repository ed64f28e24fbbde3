"""A file on which the HDF5 library crashes or hangs is refused; the process lives on."""

import os
import signal

import h5py
import numpy as np
import pytest

from dynid.errors import FileError
from dynid.hdf5 import open_hdf5, survives
from dynid.result import Result
from dynid.store import read_result, write_result
from dynid.structure.readers.read import MatrixFile, read_matrix
from tests.copies import told_by_a_copy


@pytest.fixture(autouse=True)
def _alone(monkeypatch):
    """Threads that other tests have left idle would forbid the trial."""
    monkeypatch.setattr("dynid.hdf5.threading.active_count", lambda: 1)


@pytest.mark.parametrize(
    ("work", "outcome"),
    [
        (lambda: None, True),
        (lambda: 1 / 0, True),  # what raises here raises again in the original, and is reported there
        (lambda: os.kill(os.getpid(), signal.SIGSEGV), False),
        (os.abort, False),
    ],
)
def test_only_what_dies_does_not_survive(capfd, work, outcome):
    assert survives(work) is outcome
    assert capfd.readouterr() == ("", "")


def test_what_never_ends_does_not_survive():
    assert not survives(signal.pause, seconds=0.05)


def test_the_copy_leaves_no_trace():
    seen = []
    assert survives(lambda: seen.append(1))
    assert seen == []


def test_beside_other_threads_there_is_no_trial(monkeypatch):
    monkeypatch.setattr("dynid.hdf5.threading.active_count", lambda: 2)
    assert survives(os.abort)


@pytest.fixture
def crashing(tmp_path, monkeypatch):
    """A good file, whose reading on trial crashes."""
    with h5py.File(tmp_path / "k.h5", "w") as file:
        file["K"] = np.eye(2)

    def crash(_):
        os.kill(os.getpid(), signal.SIGSEGV)

    monkeypatch.setattr("dynid.hdf5._read", crash)
    return tmp_path / "k.h5"


@pytest.mark.parametrize("name", [b"DIMENSION_SCAL\xe1", b"DIMENSION_SCALX", b"TABLE"])
def test_an_array_of_another_class_is_no_scale_and_ends_nothing(tmp_path, name):
    """The function of HDF5 2.0 that tells scales apart aborts on it."""
    path = tmp_path / "a.h5"
    result = Result("identification", "A title")
    result.add("group/x", np.arange(3.0), ("axis",))
    write_result(result, path)
    with h5py.File(path, "r+") as file:
        file["group/x"].attrs["CLASS"] = np.bytes_(name)

    def read():
        yield read_result(path)["group/x"].dims

    assert told_by_a_copy(read) == ([["axis"]], 0)


def test_readers_refuse_in_one_sentence_what_would_crash_them(crashing):
    for read in (read_result, lambda path: read_matrix(MatrixFile(path, "K"), "stiffness")):
        with pytest.raises(FileError, match=r"k\.h5.*damaged"):
            read(crashing)


def test_a_file_is_tried_once_and_again_after_it_changed(tmp_path, monkeypatch):
    tried = []
    monkeypatch.setattr("dynid.hdf5.survives", lambda _work: tried.append(1) or True)
    path = tmp_path / "a.h5"
    for count, value in ((1, 1.0), (2, 2.0)):
        with h5py.File(path, "w") as file:
            file["x"] = np.full(count, value)
        for _ in range(3):
            with open_hdf5(path) as file:
                assert file["x"][0] == value
        assert len(tried) == count
