"""HDF5 files that claim much, or lead elsewhere: refused before anything is read."""

import resource
import subprocess
import sys

import h5py
import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.read_matrix import matrix_file, read_matrix
from dynid.hdf5 import Refused, check_stored, inside
from dynid.store import read_result
from tests.files.reading import read_columns, read_signal
from tests.work import at_most

pytestmark = pytest.mark.usefixtures("untried")


def refused(call, match):
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with at_most(calls=500_000), pytest.raises(FileError, match=match):
        call()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


CLAIMS = {
    "shape": {"shape": (300_000_000, 1), "chunks": (300_000_000, 1)},
    "chunk": {"shape": (800, 1), "chunks": (300_000_000, 1), "maxshape": (None, 1)},
    "rows": {"shape": (2**40, 2), "chunks": (100, 2)},
}


# To fill the others would take what reading them must not.
@pytest.mark.parametrize(
    ("claim", "filled"), [("shape", False), ("chunk", False), ("rows", False), ("rows", True)]
)
def test_a_record_that_claims_more_than_it_holds(tmp_path, claim, filled):
    with h5py.File(tmp_path / "r.h5", "w") as file:
        made = file.create_dataset("measured", dtype="f8", compression="gzip", **CLAIMS[claim])
        file.create_dataset("time", data=np.arange(800.0))
        if filled:
            made[:100] = np.random.default_rng(3).normal(size=(100, 2))
    claimed = r"'measured' (claims|is stored in chunks of) [\d,]+ bytes"
    refused(lambda: read_columns(tmp_path / "r.h5", None, rows=800), claimed)
    refused(lambda: read_columns(tmp_path / "r.h5", ["measured"], step=0.1), claimed)
    refused(lambda: read_signal(tmp_path / "r.h5", "measured"), claimed)


@pytest.mark.parametrize("sparse", [False, True])
def test_a_matrix_that_claims_more_than_it_holds(tmp_path, sparse):
    with h5py.File(tmp_path / "k.h5", "w") as file:
        if sparse:
            group = file.create_group("K")
            group.attrs["shape"] = (3, 3)
            group["indices"], group["indptr"] = np.zeros(3, int), np.array([0, 1, 2, 3])
            group.create_dataset("data", (100_000_000,), "f8", chunks=(100_000_000,))
        else:
            file.create_dataset("K", (15_000, 15_000), "f8", chunks=(15_000, 15_000))
    refused(lambda: read_matrix(matrix_file(tmp_path, "k.h5"), "stiffness"), "claims|is stored in chunks of")


def test_only_the_rows_that_are_needed_are_read(tmp_path, monkeypatch):
    values = np.random.default_rng(4).normal(size=(5000, 2))
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file.create_dataset("measured", data=values, chunks=(500, 2), compression="gzip")
        file.create_dataset("time", data=0.01 * np.arange(5000))
    asked, original = [], h5py.Dataset.__getitem__

    def spied(self, place, **more):
        found = original(self, place, **more)
        asked.append((self.name, np.shape(found)))
        return found

    # The trial reads in a copy of the process, whose requests are not seen here.
    monkeypatch.setattr(h5py.Dataset, "__getitem__", spied)
    found = read_columns(tmp_path / "r.h5", None, step=0.01, rows=700)
    assert np.array_equal(found, values[:700])
    assert set(asked) == {("/measured", (700, 2)), ("/time", (700,))}


@pytest.fixture
def elsewhere(tmp_path):
    """A file whose datasets are all in another one, by every way that HDF5 has."""
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["measured"] = np.ones((50, 2))
        file["K"] = np.eye(3)
    (tmp_path / "raw.bin").write_bytes(np.ones(50).tobytes())
    with h5py.File(tmp_path / "r.h5", "w") as file:
        file["link"] = h5py.ExternalLink("other.h5", "measured")
        file["K"] = h5py.ExternalLink("other.h5", "K")
        file["soft"] = h5py.SoftLink("/link")
        file["folder"] = h5py.ExternalLink("other.h5", "/")
        layout = h5py.VirtualLayout((50,), "f8")
        layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "measured", (50, 2))[:, 0]
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("raw", (50,), "f8", external=[(str(tmp_path / "raw.bin"), 0, 400)])
        file["circle"] = h5py.SoftLink("/round")
        file["round"] = h5py.SoftLink("/circle")
        file["own"] = np.arange(50.0)
        file["alias"] = h5py.SoftLink("/own")
    return tmp_path / "r.h5"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("link", "'link' is a link to another file, 'other.h5'; name that file instead"),
        ("soft", "'soft' is a link to another file, 'other.h5'"),
        ("folder/measured", "'folder/measured' is a link to another file"),
        ("virtual", "'virtual' is put together from other files"),
        ("raw", "the values of 'raw' are in another file"),
        ("circle", "the links to 'circle' go in a circle"),
    ],
)
def test_what_is_in_other_files_is_refused(elsewhere, name, said):
    with pytest.raises(FileError, match=said):
        read_columns(elsewhere, [name])
    with pytest.raises(FileError, match=said):
        read_signal(elsewhere, name)


def test_what_is_in_the_file_itself_is_read_and_nothing_else_is_opened(elsewhere):
    (elsewhere.parent / "other.h5").unlink()
    (elsewhere.parent / "raw.bin").unlink()
    assert np.array_equal(read_columns(elsewhere, ["alias"])[:, 0], np.arange(50.0))
    with pytest.raises(
        FileError, match=r"has 4 datasets of numbers beside the time: alias, own, raw, virtual"
    ):
        read_signal(elsewhere, None)
    with pytest.raises(FileError):
        read_matrix(matrix_file(elsewhere.parent, "r.h5", "K"), "stiffness")
    with h5py.File(elsewhere) as file:
        assert inside(file, "nothing/at/all") is None
        assert inside(file["/"], "./alias").name == "/own"
        with pytest.raises(Refused):
            check_stored(file["virtual"])


def test_a_result_whose_arrays_are_elsewhere_is_refused(tmp_path):
    import dynid
    from dynid.store import write_result
    from tests.cli.conftest import SMALL

    (tmp_path / "small.yaml").write_text(SMALL)
    write_result(dynid.run(tmp_path / "small.yaml"), tmp_path / "s.h5")
    (tmp_path / "raw.bin").write_bytes(bytes(400))
    with h5py.File(tmp_path / "s.h5", "a") as file:
        file.create_dataset("extra", (50,), "f8", external=[(str(tmp_path / "raw.bin"), 0, 400)])
    with pytest.raises(FileError, match="the values of 'extra' are in another file"):
        read_result(tmp_path / "s.h5")


def filtered(path, number, *, mask=0, name=b"measured"):
    """Write a dataset through a filter that is not there; with a mask its chunk was stored without it."""
    rows = np.arange(30.0).reshape(10, 3)
    with h5py.File(path, "w") as file:
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((10, 3))
        properties.set_filter(number, h5py.h5z.FLAG_OPTIONAL, (1,))
        made = h5py.h5d.create(
            file.id, name, h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((10, 3)), properties
        )
        made.write_direct_chunk((0, 0), rows.tobytes(), mask)
    return rows


@pytest.fixture
def no_plugins():
    """Take the folders of filters from HDF5: libraries that other tests import bring filters of their own."""
    kept = [h5py.h5pl.get(k) for k in range(h5py.h5pl.size())]
    for _ in kept:
        h5py.h5pl.remove(0)
    yield
    for folder in kept:
        h5py.h5pl.append(folder)


@pytest.mark.usefixtures("no_plugins")
@pytest.mark.parametrize(
    ("number", "said"), [(32015, "Zstandard \\(32015\\)"), (32001, "Blosc"), (300, "number 300")]
)
def test_a_filter_that_is_missing_is_named(tmp_path, number, said):
    filtered(tmp_path / "r.h5", number)
    for call in (
        lambda: read_columns(tmp_path / "r.h5", None),
        lambda: read_columns(tmp_path / "r.h5", ["measured"], step=0.1),
    ):
        refused(call, f"'measured' is stored through the filter {said}.*HDF5_PLUGIN_PATH")
    filtered(tmp_path / "k.h5", number, name=b"K")
    refused(
        lambda: read_matrix(matrix_file(tmp_path, "k.h5", "K"), "stiffness"), f"through the filter {said}"
    )


def test_a_chunk_that_was_stored_without_its_filter_is_read(tmp_path):
    rows = filtered(tmp_path / "r.h5", 32015, mask=1)
    np.testing.assert_array_equal(read_columns(tmp_path / "r.h5", None), rows)


WRITER = """
import sys, h5py, numpy
file = h5py.File(sys.argv[1], "w", libver="latest")
file.create_dataset("measured", data=numpy.eye(4), maxshape=(None, 4), chunks=(2, 4))
file["K"] = numpy.eye(4)
file.swmr_mode = True
file.flush()
print("written", flush=True)
sys.stdin.read()
"""


def test_a_file_that_another_program_writes_is_left_to_it(tmp_path):
    path = tmp_path / "r.h5"
    with subprocess.Popen(
        [sys.executable, "-c", WRITER, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as writer:
        assert writer.stdout.readline()
        for call in (
            lambda: read_columns(path, None),
            lambda: read_signal(path, "measured"),
            lambda: read_matrix(matrix_file(tmp_path, "r.h5", "K"), "stiffness"),
        ):
            with pytest.raises(FileError, match="another program is still writing it") as raised:
                call()
            assert "h5clear" not in str(raised.value)
        writer.communicate()
    np.testing.assert_array_equal(read_columns(path, None), np.eye(4))
