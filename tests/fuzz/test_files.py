"""Files that somebody prepared: nothing in them is run, whatever reads them.

Damaged files by the thousand are judged by `python -m tests.fuzz.files`.
"""

import contextlib
import os
import pickle
import runpy
import sys
import zipfile

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from dynid.errors import DynidError, FileError
from dynid.files.read_matrix import MatrixFile, read_matrix
from dynid.files.read_measured import read_columns
from tests.fuzz.files import spoilt
from tests.fuzz.guided import scene

pytestmark = pytest.mark.usefixtures("untried")


class Payload:
    """Makes a folder when it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


def npy(path, payload):
    np.save(path, np.array([[payload]], dtype=object), allow_pickle=True)


def npz(path, payload):
    np.savez(path, K=np.array([[payload]], dtype=object), a=np.array([payload], dtype=object))


def renamed_pickle(path, payload):
    path.write_bytes(pickle.dumps({"K": payload, "a": payload}))


def pickle_in_zip(path, payload):
    with zipfile.ZipFile(path, "w") as store:
        for name in ("K.npy", "K.pkl", "a.npy"):
            store.writestr(name, pickle.dumps(payload))


def sparse_npz(path, payload):
    objects = np.array([payload], dtype=object)
    np.savez(path, data=objects, indices=objects, indptr=objects, shape=objects, format=objects)


def cells(path, payload):
    savemat(path, {"K": np.array([[pickle.dumps(payload)]], dtype=object), "a": pickle.dumps(payload)})


def opaque(path, payload):
    with h5py.File(path, "w") as store:
        store["K"] = np.void(pickle.dumps(payload))
        store["a"] = np.frombuffer(pickle.dumps(payload), dtype="u1")
        store["K"].attrs["CLASS"] = "PICKLE"


WAYS = [
    *((npy, "k.npy"), (npz, "k.npz"), (sparse_npz, "k.npz"), (pickle_in_zip, "k.npz"), (cells, "k.mat")),
    *((opaque, "k.h5"), (opaque, "k.mat")),
    *((renamed_pickle, f"k.{ending}") for ending in ("npy", "npz", "mat", "h5", "mtx", "csv", "uff", "op4")),
]


@pytest.mark.parametrize(("write", "name"), WAYS, ids=lambda way: getattr(way, "__name__", way))
def test_nothing_is_unpickled(tmp_path, write, name):
    path, canary = tmp_path / name, tmp_path / "canary"
    write(path, Payload(canary))
    for read in (
        lambda: read_matrix(MatrixFile(path), "stiffness"),
        lambda: read_matrix(MatrixFile(path, "K"), "stiffness"),
        lambda: read_columns(path, ["a"]),
        lambda: read_columns(path, ["K"]),
    ):
        with contextlib.suppress(DynidError):  # but nothing else
            read()
    assert not canary.exists()


@pytest.mark.parametrize("name", ["x" * 300, "a\0b", "loop"])
@pytest.mark.parametrize("ending", ["csv", "h5", "mtx"])
def test_a_name_that_no_file_can_have_is_no_file(tmp_path, name, ending):
    path = tmp_path / f"{name}.{ending}"
    if name == "loop":
        path.symlink_to(path.name)
    with pytest.raises(FileError, match="is no file"):
        read_columns(path, ["a"])
    if ending != "csv":
        with pytest.raises(FileError, match="is no file"):
            read_matrix(MatrixFile(path), "stiffness")


def test_the_payload_would_act(tmp_path):
    pickle.loads(pickle.dumps(Payload(tmp_path / "canary")))
    assert (tmp_path / "canary").is_dir()


def test_what_the_guided_fuzzer_feeds_is_judged():
    with pytest.raises(DynidError):
        scene(b"dynid: 1\nkind: \xff")


def test_damage_is_the_same_for_the_same_seed():
    whole = bytes(range(256))
    assert {spoilt(3, whole)} == {spoilt(3, whole)} != {spoilt(4, whole)}


@pytest.mark.parametrize("fuzz", ["files", "guided", "record"])
@pytest.mark.filterwarnings("ignore:.* found in sys.modules")
def test_a_fuzz_says_what_it_does_instead_of_doing_it(fuzz, monkeypatch, capsys):
    for asked, code in (("--help", 0), ("--halp", 2)):
        monkeypatch.setattr(sys, "argv", [fuzz, asked])
        with pytest.raises(SystemExit) as left:
            runpy.run_module(f"tests.fuzz.{fuzz}", run_name="__main__")
        assert left.value.code == code
        assert "usage: " in "".join(capsys.readouterr())
