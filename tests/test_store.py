import errno
import os
import signal
import stat
import subprocess
import sys

import h5py
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from dynid import file_access
from dynid.checks import compare
from dynid.errors import FileError
from dynid.result import Result
from dynid.store import open_stored, read_result, write_result

RESPONSE = "bond_graph/frequency_response"


def make():
    result = Result("bond-graph", "Träger", {"seed": 3, "created": "2020-01-01T00:00:00+00:00"})
    result.add_axis(f"{RESPONSE}/omega", [1.0, 2.0, 3.0], "rad/s", spacing="log")
    result.add_axis(f"{RESPONSE}/output", ["m_s.f", "ü"])
    response = np.arange(6).reshape(3, 2, 1) * (1 + 1j)
    result.add(f"{RESPONSE}/response", response, ("omega", "output", "input"), exact=True, cost=np.nan)
    result.add(f"{RESPONSE}/below/phase", [0.1, 0.2, np.nan], ("omega",))
    result.add("reduction/serep/mass", np.eye(3), ("dof", "dof"))
    result.add("reduction/serep/dof", 4)
    result.add("reduction/serep/masters", [1, 6], ("dof",))
    result.add("reduction/serep/converged", True)
    result.add("reduction/serep/none", np.zeros((2, 0)), ("dof", "void"))
    result.add("reduction/serep/words", np.array([], dtype=object), ("void",))
    steps = [("series", "a, b", 1.5, True), ("source swap", "", np.nan, False)]
    table = np.array(steps, dtype=[("rule", object), ("nodes", object), ("x", float), ("ok", bool)])
    result.add("bond_graph/reduction/steps", table, ("step",))
    result.add("bond_graph/reduction/prototype", "d")
    result.annotate(RESPONSE, symbolic="K/s" * 50_000)
    result.annotate("empty/group", number=2)
    return result


def test_what_is_written_reads_back_equal(tmp_path):
    write_result(make(), tmp_path / "r.h5", "kind: bond-graph\n")
    found = read_result(tmp_path / "r.h5")
    assert found.equals(make())
    assert found.attrs["scene"] == "kind: bond-graph\n"
    assert found["reduction/serep/mass"].dims == ("dof", "dof")


def test_root_attributes_of_the_contract(tmp_path):
    write_result(Result("identification", "T", {"seed": 7}), tmp_path / "r.h5", "a: 1")
    with h5py.File(tmp_path / "r.h5") as file:
        attrs = dict(file.attrs)
        assert file["scene"].asstr()[()] == "a: 1"
    assert (attrs["format"], attrs["status"], attrs["seed"]) == (1, "complete", 7)
    assert (attrs["kind"], attrs["title"]) == ("identification", "T")
    assert {"dynid_version", "created", "python", "packages"} <= attrs.keys()
    assert "numpy " in attrs["packages"]


def test_a_rewritten_result_keeps_its_provenance_and_bytes(tmp_path):
    write_result(make(), tmp_path / "a.h5", "x: 1")
    write_result(read_result(tmp_path / "a.h5"), tmp_path / "b.h5")
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


@pytest.mark.parametrize(
    "group", ["/", RESPONSE, f"{RESPONSE}/below", "reduction/serep", "bond_graph/reduction"]
)
def test_xarray_opens_every_group(tmp_path, group):
    write_result(make(), tmp_path / "r.h5")
    with xr.open_dataset(tmp_path / "r.h5", group=group, engine="h5netcdf") as dataset:
        dataset.load()
        assert not [dim for dim in dataset.dims if str(dim).startswith("phony")]


def test_xarray_finds_coordinates_units_and_complex_values(tmp_path):
    write_result(make(), tmp_path / "r.h5")
    with xr.open_dataset(tmp_path / "r.h5", group=RESPONSE, engine="h5netcdf") as dataset:
        assert dataset["response"].dims == ("omega", "output", "input")
        assert dataset["response"].sel(omega=2.0, output="ü", input=1).item() == 3 + 3j
        assert dataset["omega"].attrs["units"] == "rad/s"


@pytest.mark.thorough
def test_one_axis_may_serve_thousands_of_arrays(tmp_path):
    result = Result("k")
    result.add_axis("time", [0.0, 1.0])
    for number in range(4200):
        result.add(f"g/v{number}", [1.0, 2.0], ("time",))
    write_result(result, tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5") as file:
        assert all(len(file[f"g/v{number}"].dims[0]) == 1 for number in (0, 4199))


def test_an_empty_table_keeps_its_columns(tmp_path):
    result = Result("k")
    result.add("steps", np.zeros(0, dtype=[("rule", object), ("x", float)]), ("step",))
    write_result(result, tmp_path / "r.h5")
    assert read_result(tmp_path / "r.h5").equals(result)


def test_same_name_with_another_length_is_another_axis(tmp_path):
    result = Result("k")
    result.add_axis("g/time", [0.0, 1.0])
    result.add("g/y", [1.0, 2.0, 3.0], ("time",))
    result.add("g/z", [1.0, 2.0, 3.0], ("time",))
    write_result(result, tmp_path / "r.h5")
    assert read_result(tmp_path / "r.h5").equals(result)


NAMES = st.text("abxyö_.1 ", min_size=1, max_size=4).filter(lambda name: name.strip("."))
DIMS = st.sampled_from(["a", "b", "time"])
TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=5)
SCALARS = TEXTS | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats()
SHAPES = npst.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3)
NUMBERS = st.sampled_from([np.float64, np.complex128, np.int64, np.bool_])


@st.composite
def results(draw):
    result = Result(draw(TEXTS), draw(TEXTS), {"seed": draw(st.integers(0, 99))})
    for path in draw(st.sets(st.lists(NAMES, min_size=1, max_size=3).map("/".join), max_size=5)):
        if any(f"{path}/".startswith(f"{other}/") or f"{other}/".startswith(f"{path}/") for other in result):
            continue
        shape = draw(SHAPES)
        elements = npst.arrays(draw(NUMBERS), shape) | npst.arrays(object, shape, elements=TEXTS)
        dims = tuple(draw(DIMS | st.just(path.rsplit("/", 1)[-1])) for _ in shape)
        attrs = draw(st.dictionaries(NAMES, SCALARS, max_size=2))
        result.add(path, draw(elements), dims, draw(TEXTS), **attrs)
    return result


@pytest.mark.thorough
@given(results())
@settings(max_examples=25, deadline=None)
def test_random_results_read_back_equal(tmp_path_factory, result):
    path = tmp_path_factory.getbasetemp() / "random.h5"
    write_result(result, path)
    assert read_result(path).equals(result)


@pytest.mark.parametrize(
    ("path", "data", "attrs"),
    [
        ("a/../b/.", 1.0, {}), ("a//b", 1.0, {}), ("/a", 1.0, {}), ("", 1.0, {}), ("scene", 1.0, {}),
        ("a\0b", 1.0, {}),
        ("a", "x\0y", {}), ("a", "\ud800", {}), ("a", 1.0, {"units": "m"}), ("a", 1.0, {"CLASS": "x"}),
        ("a", 1.0, {"big": 2**70}), ("ok/below", 1.0, {}), ("a", np.array([None]), {}),
    ],
)  # fmt: skip
def test_what_hdf5_cannot_hold_is_told_and_leaves_the_old_file(tmp_path, path, data, attrs):
    target = tmp_path / "r.h5"
    target.write_bytes(b"old")
    result = Result("k")
    result.add("ok", 1.0)
    result.add(path, data, ("n",) * np.ndim(data))
    object.__setattr__(result[path], "attrs", attrs)
    with pytest.raises(FileError, match="cannot be written"):
        write_result(result, target)
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]
    assert target.read_bytes() == b"old"


@pytest.mark.parametrize("step", ["fsync", "replace", "open"])
@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_failures_leave_the_old_file_and_nothing_else(tmp_path, monkeypatch, step, error):
    target = tmp_path / "r.h5"
    write_result(make(), target)
    before = target.read_bytes()

    def fail(*_):
        raise error

    monkeypatch.setattr(file_access.os, step, fail)
    with pytest.raises(KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else FileError):
        write_result(Result("k"), target)
    monkeypatch.undo()
    assert [item.name for item in tmp_path.iterdir()] == ["r.h5"]
    assert target.read_bytes() == before


KILLED = """
import os, signal, sys
from dynid.result import Result
from dynid.store import write_result
target, step, before = sys.argv[1:]
original = getattr(os, step)
def die(*arguments, **options):
    value = None if before == "before" else original(*arguments, **options)
    os.kill(os.getpid(), signal.SIGKILL)
    return value
result = Result("k", "new")
setattr(os, step, die)
write_result(result, target)
"""


@pytest.mark.parametrize("old", [True, False])
@pytest.mark.parametrize(
    ("step", "moment", "replaced"),
    [
        ("close", "before", False),
        ("fsync", "before", False),
        ("replace", "before", False),
        ("replace", "after", True),
    ],
)
def test_a_killed_writer_leaves_the_old_file_or_the_new(tmp_path, step, moment, replaced, old):
    target = tmp_path / "r.h5"
    if old:
        write_result(Result("k", "old"), target)
    done = subprocess.run([sys.executable, "-c", KILLED, target, step, moment], check=False)
    assert done.returncode == -signal.SIGKILL
    if old or replaced:
        assert read_result(target).title == ("new" if replaced else "old")
    else:
        assert not target.exists()


def test_places_that_cannot_be_written(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name in ("missing/r.h5", "", "pipe", "a\0b", "x" * 300):
        with pytest.raises(FileError, match="cannot be written"):
            write_result(make(), f"{tmp_path}/{name}")
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_a_link_and_permissions_survive(tmp_path):
    (tmp_path / "real.h5").write_bytes(b"")
    (tmp_path / "real.h5").chmod(0o640)
    (tmp_path / "link.h5").symlink_to("real.h5")
    write_result(make(), tmp_path / "link.h5")
    assert (tmp_path / "link.h5").is_symlink()
    assert read_result(tmp_path / "real.h5").equals(make())
    assert stat.S_IMODE((tmp_path / "real.h5").stat().st_mode) == 0o640


def test_what_is_not_a_result_cannot_be_read(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "text.h5").write_text("kind: x")
    h5py.File(tmp_path / "other.h5", "w").close()
    (tmp_path / "scene.yaml").write_text("kind: x")
    cases = {
        "scene.yaml": "dynid run",
        "pipe": "regular",
        "": "regular",
        "nope.h5": "no such file",
        "text.h5": "not an HDF5 file",
    }
    for name, words in (cases | {"other.h5": "not a result"}).items():
        with pytest.raises(FileError, match=words):
            read_result(f"{tmp_path}/{name}")


def test_a_file_that_may_not_be_read_is_told_so(tmp_path, monkeypatch):
    def refuse(_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("dynid.store.files.open_hdf5", refuse)
    with pytest.raises(FileError, match=r"r\.h5 cannot be read: permission denied"):
        read_result(tmp_path / "r.h5")


def test_a_result_may_have_lost_its_scene(tmp_path):
    write_result(make(), tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "a") as file:
        del file["scene"]
    found = read_result(tmp_path / "r.h5")
    assert "scene" not in found.attrs
    assert found[f"{RESPONSE}/omega"].equals(make()[f"{RESPONSE}/omega"])


@pytest.mark.thorough
def test_a_truncated_file_is_told(tmp_path):
    write_result(make(), tmp_path / "r.h5")
    content = (tmp_path / "r.h5").read_bytes()
    for part in range(5):
        (tmp_path / "cut.h5").write_bytes(content[: len(content) * part // 5])
        with pytest.raises(FileError, match="damaged"):
            read_result(tmp_path / "cut.h5")


@pytest.mark.parametrize(
    ("attr", "value", "words"), [("format", 2, "format 2"), ("status", "partial", "not complete")]
)
def test_newer_and_incomplete_files_are_refused(tmp_path, attr, value, words):
    write_result(make(), tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "a") as file:
        file.attrs[attr] = value
    with pytest.raises(FileError, match=words):
        read_result(tmp_path / "r.h5")


def test_links_are_not_followed_and_cycles_end(tmp_path):
    write_result(make(), tmp_path / "r.h5")
    write_result(make(), tmp_path / "other.h5")
    with h5py.File(tmp_path / "r.h5", "a") as file:
        file["soft"] = h5py.SoftLink("/bond_graph")
        file["external"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/")
        file["bond_graph/self"] = file["bond_graph"]
        file["type"] = np.dtype(float)
    assert read_result(tmp_path / "r.h5").equals(make())


def _virtual(file):
    layout = h5py.VirtualLayout((2,), float)
    layout[:] = h5py.VirtualSource("other.h5", "x", (2,))
    file.create_virtual_dataset("bad", layout)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda file: file.create_dataset("bad", (10**12,), "f8"),
        lambda file: file.create_dataset("bad", (2,), "f8", external=[("/etc/passwd", 0, 16)]),
        lambda file: file.create_dataset("bad", data=h5py.Empty("f8")),
        lambda file: file.create_dataset("bad", data=np.void(b"abc")),
        lambda file: file.create_dataset("bad", data=b"\xff\xfe", dtype=h5py.string_dtype()),
        lambda file: file["reduction/serep/dof"].attrs.create("dynid_dims", "x\ny"),
        lambda file: file.attrs.create("format", "one"),
        lambda file: file.attrs.create("format", [1, 2]),
        _virtual,
    ],
)
def test_hostile_contents_are_refused(tmp_path, spoil):
    write_result(make(), tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "a") as file:
        spoil(file)
    with pytest.raises(FileError):
        read_result(tmp_path / "r.h5")


def test_other_tools_files_are_read_as_far_as_they_fit(tmp_path):
    write_result(make(), tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "a") as file:
        file.create_dataset("more/single", data=np.ones(3, np.float32), compression="gzip")
        file.create_dataset("more/fixed", data=np.array([b"ab", b"c"]))
        file["more"].attrs["list"] = [1, 2]
    found = read_result(tmp_path / "r.h5")
    assert found["more/single"].dims == ("axis_1",)
    assert found["more/fixed"].data.tolist() == ["ab", "c"]


# --- arrays that stay in the file ------------------------------------------------------------------


def test_a_stored_result_is_the_one_that_was_written(tmp_path):
    write_result(make(), tmp_path / "r.h5")
    with open_stored(tmp_path / "r.h5") as stored:
        assert stored.equals(make())
        for path, variable in make().items():
            assert (stored[path].shape, stored[path].dtype) == (variable.shape, variable.dtype)


@pytest.mark.parametrize("block", [1, 7, 2**20])
def test_blocks_rows_and_entries_are_pieces_of_the_whole(tmp_path, monkeypatch, block):
    monkeypatch.setattr("dynid.store.reader._BLOCK", block)
    values = np.arange(60.0).reshape(10, 3, 2)
    result = Result("reduction")
    result.add("a/b", values, ("x", "y", "z"))
    write_result(result, tmp_path / "r.h5")
    with open_stored(tmp_path / "r.h5") as stored:
        pieces = list(stored["a/b"].blocks())
        assert [start for start, _ in pieces] == list(range(0, 10, len(pieces[0][1])))
        np.testing.assert_array_equal(np.concatenate([piece for _, piece in pieces]), values)
        np.testing.assert_array_equal(stored["a/b"].rows(2, 5), values[2:5])
        np.testing.assert_array_equal(stored["a/b"].entries(1, 3), values[:, 1:3])


def test_differences_are_the_same_piece_by_piece(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.store.reader._BLOCK", 4)
    rng = np.random.default_rng(1)
    results = []
    for name in "ab":
        result = Result("reduction")
        result.add("n/values", np.where(rng.random((20, 2)) < 0.8, 1.0, np.nan), ("x", "y"))
        result.add("n/words", np.where(rng.random(20) < 0.5, "p", "q").astype(object), ("x",))
        result.add("n/table", np.array([(1, rng.random())] * 9, [("i", int), ("r", float)]), ("z",))
        write_result(result, tmp_path / f"{name}.h5")
        results.append(result)
    expected = compare(*results)
    assert len(expected) == 3
    with open_stored(tmp_path / "a.h5") as a, open_stored(tmp_path / "b.h5") as b:
        assert compare(a, b) == expected
        assert compare(a, a) == []


def test_what_goes_wrong_with_open_file_is_not_laid_to_the_file(tmp_path):
    write_result(make(), tmp_path / "r.h5")
    with pytest.raises(ValueError, match="ours"), open_stored(tmp_path / "r.h5"):
        raise ValueError("ours")
    with pytest.raises(FileError, match="no such file"), open_stored(tmp_path / "none.h5"):
        pass


def test_a_group_in_the_place_of_the_scene_is_refused(tmp_path):
    path = tmp_path / "r.h5"
    write_result(make(), path)
    with h5py.File(path, "a") as file:
        if "scene" in file:
            del file["scene"]
        file.create_group("scene")
    with pytest.raises(FileError, match="'scene' is not an array stored in the file itself"):
        read_result(path)
