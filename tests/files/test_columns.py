"""Columns out of users' files: nothing shifts, nothing is guessed, and what is wrong is said at its place."""

import h5py
import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.table import TableLayout
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from tests.files.reading import read_columns, read_signal

pytestmark = pytest.mark.usefixtures("untried")

NAN = np.nan


@pytest.fixture
def written(tmp_path):
    """Write a file and return its path."""

    def write(text, name="x.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8", newline="")
        return path

    return write


@pytest.fixture
def stored(tmp_path):
    """Write datasets into an HDF5 file and return its path."""

    def write(name="x.h5", **datasets):
        with h5py.File(tmp_path / name, "w") as file:
            for key, value in datasets.items():
                file[key.replace("__", "/")] = value
        return tmp_path / name

    return write


def refusal(read, *args, **kwargs):
    with pytest.raises(FileError) as caught:
        read(*args, **kwargs)
    return str(caught.value), caught.value.names


# --- missing samples -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("1\n\n3\n", [[1], [NAN], [3]]),
        ("v\n\n2\n", [[NAN], [2]]),
        ("v\r\n1\r\n\r\n3\r\n", [[1], [NAN], [3]]),
        ("v\n1\n  \n3\n", [[1], [NAN], [3]]),
        ("# measured on Monday\n1\n# a pause\n\n3", [[1], [NAN], [3]]),
        ("1\n2\n\n\n", [[1], [2]]),
        ("\n\na,b\n1,2\n", [[1, 2]]),
        ("a,b\n1,\n,2\n,\n", [[1, NAN], [NAN, 2], [NAN, NAN]]),
        ("a\tb\n1\t\n\t2\n\t\n3\t4\n", [[1, NAN], [NAN, 2], [NAN, NAN], [3, 4]]),
        ("1\t2\n3\t\n", [[1, 2], [3, NAN]]),
        ("1 2\n  3   nan  \n", [[1, 2], [3, NAN]]),
        ("a;b\nNA;n/a\nNaN;1e-3\n", [[NAN, NAN], [NAN, 1e-3]]),
        ('"a, left","b"\n"1","2"\n', [[1, 2]]),
        ("time,1,2\n0,3,4\n", [[3, 4]]),
    ],
)
def test_a_missing_sample_keeps_its_row(written, text, rows):
    np.testing.assert_array_equal(read_columns(written(text), None), rows)


def test_a_signal_has_every_sample(written):
    message, names = refusal(read_signal, written("1\n\n3"), None, scene_key="excitation.0")
    assert "x.csv:2: a sample of the signal is missing" in message
    assert names == ("excitation.0.path",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n\n3,4\n", "x.csv:3: an empty line among the rows"),
        ("\n1\n2\n", "x.csv:1: an empty line before the first sample"),
        ("# note\n\n1\n2\n", "x.csv:2: an empty line before the first sample"),
        ("a,b\n1,2,3\n", "x.csv:2: 3 fields where the first row has 2"),
        (
            "t;v\n0,0x;1\n",
            "x.csv:2: '0,0x' is not a number. A missing sample is an empty field, nan, NA or n/a.",
        ),
        ("v\n1\nbroken\n", "x.csv:3: 'broken' is not a number"),
        ("---,0.1\n1,0.2\n", "x.csv:1: '---' is not a number"),
        ("1_000\n1_001\n", "x.csv:1: '1_000' is not a number"),
        ("1.5V\n1.6\n", "x.csv:1: '1.5V' is not a number"),
        ("2026-01-01;3\n", "x.csv:1: '2026-01-01' is not a number"),
        ("v\n1\n-inf\n", "x.csv:3: the value is infinite"),
        ("a,b\n", "x.csv holds names but no data"),
        ("# nothing\n\n", "x.csv holds no data"),
    ],
)
def test_what_cannot_be_read_is_named_with_its_line(written, text, message):
    said, names = refusal(read_columns, written(text), None, scene_key="measurement.file")
    assert message in said
    assert names == ("measurement.file.path",)


def test_what_is_no_text_or_no_hdf5_is_told_so(written, tmp_path):
    (tmp_path / "x.txt").write_bytes(b"\xb5m\x00\x01\n1\n")
    assert "is not a text" in refusal(read_columns, tmp_path / "x.txt", None)[0]
    assert "cannot be read as HDF5" in refusal(read_columns, written("1\n2\n", "x.h5"), None)[0]
    assert "is no file" in refusal(read_columns, tmp_path, None)[0]


def test_a_file_that_fails_while_it_is_read_is_told_so(written, monkeypatch):
    def fail(*_, **__):
        raise OSError(5, "Input/output error")

    path = written("1\n2\n")
    monkeypatch.setattr("pathlib.Path.read_text", fail)
    said, names = refusal(read_columns, path, None, scene_key="measurement.file")
    assert said.endswith("x.csv cannot be read: Input/output error")
    assert names == ("measurement.file.path",)


def test_datasets_of_a_record_are_of_one_length(stored):
    path = stored(a=[1.0, 2, 3], b=[1.0, 2], c=np.ones((3, 2)))
    for names in (["a", "b"], ["a", "c"]):
        said = f"has no columns of one length in {', '.join(names)}"
        assert said in refusal(read_columns, path, names)[0]


def test_datasets_have_no_numbered_times(stored):
    said, names = refusal(
        read_columns, stored(measured=[1.0, 2]), None, layout=TableLayout(time=1), scene_key="file"
    )
    assert "has datasets, no numbered columns of times. Give its name." in said
    assert names == ("file.time",)


def test_infinite_values_of_other_columns_do_no_harm(written):
    path = written("a,b\n1,inf\n2,3\n")
    assert read_columns(path, ["a"]).tolist() == [[1], [2]]
    assert "x.csv:2: the value is infinite" in refusal(read_columns, path, ["b"])[0]


def test_an_infinite_value_in_hdf5_is_named_with_its_row(stored):
    path = stored(measured=[[1.0, 2], [3, np.inf]])
    assert "x.h5: row 2: the value is infinite" in refusal(read_columns, path, None)[0]


# --- columns ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (["u"], "has no column 'u'; it has time, v, w"),
        (["vv"], "has no column 'vv'; did you mean 'v'? It has time, v, w."),
        ([4], "has 3 columns, no column 4"),
    ],
)
def test_a_column_that_is_not_there_is_located_at_the_columns(written, columns, message):
    path = written("time,v,w\n0,1,2\n")
    said, names = refusal(read_columns, path, columns, scene_key="measurement.file")
    assert message in said
    assert names == ("measurement.file.columns",)


def test_the_column_of_another_sensor_is_not_suggested(written):
    path = written("Zeit;Kraft [N];Beschl. 1 [g]\n0;1;2\n")
    said, _ = refusal(read_columns, path, ["Beschl. 2"])
    assert "has no column 'Beschl. 2'; it has Zeit, Kraft [N], Beschl. 1 [g]" in said
    said, _ = refusal(read_columns, path, ["Beschl 1"])
    assert "did you mean 'Beschl. 1 [g]'?" in said


def test_a_name_that_stands_twice_is_refused(written):
    assert "has 2 columns 'v'" in refusal(read_columns, written("v,v\n1,2\n"), ["v"])[0]


@pytest.mark.parametrize(
    "text", ["time,F\n0,5\n1,6\n", "F;T\n5;0\n6;1\n", "t (s)\tF\n0\t5\n1\t6\n", "5\n6\n"]
)
def test_a_signal_is_by_default_the_only_column_that_is_not_the_time(written, text):
    assert read_signal(written(text), None).tolist() == [5, 6]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,F,G\n0,1,2\n", "has 2 columns beside the time: F, G. Name the one that drives: column: NAME"),
        ("0,1.5\n", "has 2 columns beside the time. Name the one"),
        ("time\n0\n", "has no columns beside the time"),
        ("T,t,F\n300,0,1\n", "has 2 columns beside the time: T, F"),
    ],
)
def test_several_columns_that_could_drive_are_named(written, text, message):
    said, names = refusal(read_signal, written(text), None, scene_key="excitation.0")
    assert message in said
    assert names == ("excitation.0.column",)


def test_a_signal_in_hdf5_is_the_only_dataset_that_is_not_the_time(stored):
    path = stored(time=[0.0, 1], F=[5.0, 6], names=[b"a", b"b"])
    assert read_signal(path, None, step=1).tolist() == [5, 6]
    path = stored(time=[0.0, 1], F=[5.0, 6], measured=[[1.0, 2], [3, 4]])
    assert "has 2 datasets of numbers beside the time: F, measured" in refusal(read_signal, path, None)[0]
    assert read_signal(path, "F").tolist() == [5, 6]
    assert read_signal(path, 2).tolist() == [2, 4]
    assert "has 2 columns in 'measured'" in refusal(read_signal, path, "measured")[0]
    assert "has no dataset of numbers 'f'; did you mean 'F'?" in refusal(read_signal, path, "f")[0]


# --- times -----------------------------------------------------------------------------------------


def table_of(times, form):
    return "time,v\n" + "".join(f"{form % t},1\n" for t in times)


@pytest.mark.parametrize("form", ["%.17g", "%.9f", "%.6g", "%.4f", "%.3f"])
@pytest.mark.parametrize("step", [0.002, 1 / 1024, 1 / 300])
@pytest.mark.parametrize("start", [0, 12.345678])
def test_times_that_agree_up_to_how_they_are_printed_are_accepted(written, form, step, start):
    path = written(table_of(start + step * np.arange(800), form))
    assert read_columns(path, None, step=step).shape == (800, 1)
    short = written(table_of(start + step * np.arange(3), form))
    assert read_columns(short, None, step=step).shape == (3, 1)


@pytest.mark.parametrize("wrong", [0.004, 0.001, 2, 0.00201, 0.00200001])
def test_a_step_that_disagrees_with_the_times_is_refused_with_both_numbers(written, stored, wrong):
    times = 0.002 * np.arange(800)
    csv, hdf5 = written(table_of(times, "%.6f")), stored(time=times, measured=np.ones((800, 1)))
    for read, path in ((read_columns, csv), (read_columns, hdf5), (read_signal, csv), (read_signal, hdf5)):
        said, names = refusal(read, path, None, step=wrong, scene_key="excitation")
        assert f"the times are 0.002 s apart, but 'step' is {wrong:.9g} s" in said
        assert names == ("excitation.path",)
        assert len(read(path, None, step=0.002)) == 800


def test_coarsely_printed_times_still_tell_a_wrong_step(written):
    path = written(table_of(np.arange(800) / 1024, "%.3f"))
    assert "s apart, but 'step' is 0.001 s" in refusal(read_columns, path, None, step=0.001)[0]


def test_a_jump_is_named_with_its_row(written, stored):
    times = 0.002 * np.arange(10)
    times[4:] += 0.0011
    said = refusal(read_columns, written(table_of(times, "%.4f")), None, step=0.002)[0]
    assert "x.csv:6: the time goes on by 0.0031 s here, 0.002 s a row elsewhere; 'step' is 0.002 s" in said
    said = refusal(read_columns, stored(t=times, measured=np.ones(10)), None, step=0.002)[0]
    assert "x.h5: row 5: the time goes on by 0.0031 s here" in said


def test_missing_times_and_single_precision_do_no_harm(written, stored):
    assert len(read_columns(written("time,v\n0,1\n,2\n0.2,3\n"), None, step=0.1)) == 3
    times = np.float32(0.002) * np.arange(5000, dtype=np.float32)
    assert len(read_columns(stored(time=times, measured=np.ones(5000)), None, step=0.002)) == 5000
    assert "infinite" in refusal(read_columns, written("time,v\n0,1\ninf,2\n"), None, step=0.1)[0]


def test_one_time_alone_tells_no_step(written):
    assert len(read_columns(written("time,v\n,1\n0.7,2\n,3\n"), None, step=0.1)) == 3


def test_the_dataset_of_the_times_may_be_named_wherever_it_is(stored):
    path = stored(measured=[1.0, 2, 3], daq__clock=[0, 0.2, 0.4], daq__short=[0, 0.2])
    clock = TableLayout(time="daq/clock")
    assert len(read_columns(path, None, step=0.2, layout=clock)) == 3
    assert "0.2 s apart, but 'step' is 1 s" in refusal(read_columns, path, None, step=1, layout=clock)[0]
    said = refusal(read_columns, path, None, step=0.2, layout=TableLayout(time="daq/short"))[0]
    assert "has 3 rows of data, but another number of times in 'daq/short'" in said


def test_the_times_of_a_result_are_those_beside_its_data(stored):
    path = stored(
        identification__measurement__time=[0, 0.1, 0.2],
        identification__measurement__measured=np.ones((3, 1)),
        time=[0.0, 1.0, 2.0],
    )
    assert len(read_columns(path, None, step=0.1)) == 3
    assert "0.1 s apart, but 'step' is 1 s" in refusal(read_columns, path, None, step=1)[0]


# --- the place in the scene ------------------------------------------------------------------------

SCENE = """\
dynid: 1
kind: identification
structure: {lumped: {masses: [1]}}
joints: {j: {dofs: [1], k: {start: 10}, c: {start: 1}}}
excitation:
  - {dof: 1, kind: file, path: force.csv}
measurement:
  step: 0.01
  samples: 3
  channels: [{dof: 1, quantity: velocity}]
  file:
    path: record.csv
    columns: [v]
"""
GOOD = {"force.csv": "time,F\n0,1\n0.01,2\n0.02,1\n", "record.csv": "time,v\n0,0\n0.01,1\n0.02,2\n"}


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"record.csv": None}, (12, 5)),
        ({"record.csv": "time,v\n0,0\n0.02,1\n0.04,2\n"}, (12, 5)),
        ({"record.csv": "time,v\n0,0\n0.01,1\n"}, (12, 5)),
        ({"record.csv": "time,w\n0,0\n0.01,1\n0.02,2\n"}, (13, 5)),
        ({"force.csv": None}, (6, 26)),
        ({"force.csv": "time,F\n0,1\n0.01,2\n"}, (6, 26)),
        ({"force.csv": "time,F\n0,1\n0.02,2\n0.04,1\n"}, (6, 26)),
        ({"force.csv": "time,F,G\n0,1,2\n0.01,2,2\n0.02,1,2\n"}, (6, 5)),
    ],
)
@pytest.mark.parametrize("single", [False, True])
def test_a_fault_of_a_file_stands_where_the_scene_names_the_file(tmp_path, change, place, single):
    for name, text in {**GOOD, **change}.items():
        if text is not None:
            (tmp_path / name).write_text(text)
    text = SCENE.replace("  - {dof", "    {dof") if single else SCENE
    (tmp_path / "s.yaml").write_text(text)
    scene = load_scene(tmp_path / "s.yaml")
    with pytest.raises(FileError) as caught:
        run_scene(scene)
    fault = scene.locate(caught.value)
    assert (fault.line, fault.column) == ((5, 1) if single and place == (6, 5) else place)
