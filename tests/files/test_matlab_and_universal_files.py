"""Records out of MATLAB and Universal Files."""

import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from dynid.errors import FileError
from dynid.files.matlab import MATRICES
from dynid.files.table import TableLayout
from tests.copies import answers
from tests.files.reading import read_columns, read_signal

pytestmark = pytest.mark.usefixtures("untried")

MEASURED = Path(__file__).parents[3] / "shared" / "data" / "measured"
needs_data = pytest.mark.skipif(not MEASURED.is_dir(), reason="the measured records are not here")
T = 0.01 * np.arange(50)
Y = np.column_stack([np.sin(3 * T), np.cos(5 * T)])


def refusal(*args, read=read_columns, **kwargs):
    with pytest.raises(FileError) as caught:
        read(*args, **kwargs)
    return str(caught.value)


# --- MATLAB ----------------------------------------------------------------------------------------


@pytest.fixture(params=[False, True], ids=["plain", "compressed"])
def mat(tmp_path, request):
    cells = np.empty((2, 3), dtype=object)
    for row in range(2):
        cells[row] = [T[:, None], Y[:, [row]], np.array([[row]])]
    path = tmp_path / "x.mat"
    contents = {"table": np.column_stack([T, Y]), "t": T, "y": Y[:, 0], "runs": cells, "z": 1j * T}
    savemat(path, contents, do_compression=request.param)
    return path


def test_matlab_variables_are_columns(mat):
    np.testing.assert_array_equal(read_columns(mat, ["y"]), Y[:, :1])
    np.testing.assert_array_equal(read_columns(mat, [2, 3], layout=TableLayout("table")), Y)
    np.testing.assert_array_equal(read_columns(mat, ["y"], step=0.01, layout=TableLayout(time="t")), Y[:, :1])
    np.testing.assert_array_equal(read_signal(mat, "y"), Y[:, 0])
    timed = read_columns(mat, None, step=0.01, layout=TableLayout("table", time=1, first=11))
    np.testing.assert_array_equal(timed, Y[10:])


def test_a_vector_is_a_table_of_one_column_and_the_only_variable_needs_no_name(mat, tmp_path):
    np.testing.assert_array_equal(read_columns(mat, [1], layout=TableLayout("t")), T[:, None])
    savemat(tmp_path / "one.mat", {"only": Y})
    np.testing.assert_array_equal(read_columns(tmp_path / "one.mat", None), Y)


@pytest.mark.parametrize("row", [1, 2])
def test_a_row_of_cells_is_a_table(mat, row):
    found = read_columns(mat, [2], step=0.01, layout=TableLayout("runs", row, time=1))
    np.testing.assert_array_equal(found[:, 0], Y[:, row - 1])


def test_other_readers_see_no_cells(mat):
    assert "runs" not in MATRICES.shapes(mat)
    assert MATRICES.load(mat, "table").shape == (50, 3)


@pytest.mark.parametrize(
    ("columns", "layout", "said"),
    [
        (None, TableLayout(), "5 variables: table, t, y, runs, z. Name it: variable: NAME"),
        (["yy"], TableLayout(), "has no variable 'yy'; did you mean 'y'?"),
        ([2], TableLayout("runs"), "2 rows of cells in 'runs'. Give it: row: NUMBER"),
        ([2], TableLayout("runs", 3), "has 2 rows of cells in 'runs', no row 3"),
        ([2], TableLayout("table", 1), "holds a matrix in 'table', no rows of cells"),
        ([3], TableLayout("runs", 1, time=1), "columns of different lengths: 50, 50, 1"),
        ([1], TableLayout("z"), "'z' is no matrix of real numbers"),
        ([2], TableLayout("table", time=3), "the time goes on by"),
        ([2], TableLayout("table", first=60), "has 50 rows; none is number 60"),
        (["y"], TableLayout("table"), "takes no 'variable'"),
        (["table"], TableLayout(), "has 50 x 3 numbers in 'table', not a column of them"),
    ],
)
def test_what_a_matlab_file_has_not_is_said(mat, columns, layout, said):
    assert said in refusal(mat, columns, step=0.01, layout=layout)


@pytest.mark.thorough
def test_damaged_cells_are_refused(mat, tmp_path):
    whole, contents = mat.read_bytes(), []
    for place in range(130, len(whole), 37):
        damaged = bytearray(whole)
        damaged[place : place + 4] = struct.pack("<I", 0xFFFFFF)
        contents.append(damaged)

    def refused(path):
        try:
            read_columns(path, [2], layout=TableLayout("runs", 1))
        except FileError:
            return True
        return False

    assert any(answers(refused, tmp_path / "d.mat", contents))


@needs_data
def test_a_measured_record_of_cells():
    """The record of a laser vibrometer: 12 rows, time and velocity; step and length as published."""
    path = MEASURED / "resonantdoublebeam_data.mat"
    velocity = read_columns(path, [2], layout=TableLayout("xData", 12))
    assert velocity.shape == (15719, 1)
    spectrum = np.abs(np.fft.rfft(velocity[:, 0] * np.hanning(len(velocity))))
    hertz = np.fft.rfftfreq(len(velocity), 1.953125e-4)
    peak = hertz[np.argmax(np.where((hertz > 60) & (hertz < 180), spectrum, 0))]
    assert abs(peak - 122.5) < 0.5


# --- text ------------------------------------------------------------------------------------------


@needs_data
def test_columns_of_a_dat_file():
    values = read_columns(MEASURED / "robot_arm.dat", None)
    assert values.shape == (1024, 2)
    np.testing.assert_array_equal(values, np.loadtxt(MEASURED / "robot_arm.dat"))


def test_a_column_of_times_by_its_number(tmp_path):
    path = tmp_path / "x.dat"
    np.savetxt(path, np.column_stack([T, Y]), fmt="%.6f")
    assert read_columns(path, None, step=0.01, layout=TableLayout(time=1)).shape == (50, 2)
    assert "the times are 0.01 s apart, but 'step' is 0.02 s" in refusal(
        path, None, step=0.02, layout=TableLayout(time=1)
    )
    assert "has 3 columns, no column 4" in refusal(path, None, layout=TableLayout(time=4))
    assert "takes no 'variable'" in refusal(path, None, layout=TableLayout("a"))


# --- Universal Files -------------------------------------------------------------------------------

# pyuff leaves the files open that it writes in binary form.
leaks = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


def stored(path, binary, functions):
    pyuff = pytest.importorskip("pyuff", reason="pyuff is an extra")
    path.unlink(missing_ok=True)
    for k, (x, values, kind) in enumerate(functions):
        data_set = pyuff.prepare_58(
            binary=binary,
            func_type=kind,
            rsp_node=k + 1,
            rsp_dir=1,
            ref_node=1,
            ref_dir=1,
            data=values,
            x=x,
            id1=f"sensor {k + 1}",
            rsp_ent_name="NONE",
            ref_ent_name="NONE",
            abscissa_spacing=1,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=8,
            orddenom_spec_data_type=0,
            abscissa_inc=x[1] - x[0],
            abscissa_min=x[0],
        )
        pyuff.UFF(str(path)).write_sets(data_set, "add")
    return path


@leaks
@pytest.mark.parametrize("binary", [0, 1])
def test_time_histories_of_a_universal_file(tmp_path, binary):
    path = stored(tmp_path / "x.uff", binary, [(T, Y[:, 0], 1), (T, Y[:, 1], 1)])
    np.testing.assert_allclose(read_columns(path, None, step=0.01), Y, atol=1e-5)
    np.testing.assert_allclose(read_columns(path, ["sensor 2"])[:, 0], Y[:, 1], atol=1e-5)
    np.testing.assert_allclose(read_signal(path, 1), Y[:, 0], atol=1e-5)
    assert "the times are 0.01 s apart, but 'step' is 0.03 s" in refusal(path, None, step=0.03)
    assert "has no column 'sensor 3'; it has sensor 1, sensor 2" in refusal(path, ["sensor 3"])


def test_records_of_different_sampling_are_refused(tmp_path):
    path = stored(tmp_path / "x.unv", 0, [(T, Y[:, 0], 1), (2 * T, Y[:, 1], 1)])
    assert "function 2 (sensor 2) has other times than the first" in refusal(path, None)


def test_a_record_is_real(tmp_path):
    path = stored(tmp_path / "x.unv", 0, [(T, Y[:, 0], 1), (T, Y[:, 0] + 1j, 1)])
    assert "function 2 (sensor 2) is complex; a record is real" in refusal(path, None)


def test_more_bytes_than_are_read_are_refused_before_they_are(tmp_path, monkeypatch):
    path = stored(tmp_path / "x.unv", 0, [(T, Y[:, 0], 1)])
    monkeypatch.setattr("dynid.files.universal_file.MOST_NUMBERS", 10)
    assert "is larger than the 80 bytes that are read" in refusal(path, None)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("        50         1", "        60         1", "function 1 claims 60 points, but 50 can be read"),
        ("        50         1", "        5x         1", "cannot be read as a Universal File"),
    ],
)
def test_what_a_universal_file_claims_is_checked(tmp_path, old, new, said):
    path = stored(tmp_path / "x.unv", 0, [(T, Y[:, 0], 1)])
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    message = refusal(path, None, scene_key="measurement.file")
    assert said in message


@needs_data
def test_both_forms_of_a_measured_universal_file_agree():
    pytest.importorskip("pyuff", reason="pyuff is an extra")
    text, binary = (read_columns(MEASURED / f"Sample_UFF58{k}.uff", None) for k in ("_ascii", "b_bin"))
    assert text.shape == (79292, 1)
    np.testing.assert_allclose(text, binary, rtol=1e-5, atol=1e-7)


@leaks
@pytest.mark.parametrize("cut", [0.01, 0.3, 0.9])
@pytest.mark.parametrize("binary", [0, 1])
def test_a_damaged_universal_file_is_refused(tmp_path, binary, cut):
    path = stored(tmp_path / "x.uff", binary, [(T, Y[:, 0], 1)])
    path.write_bytes(path.read_bytes()[: int(cut * path.stat().st_size)])
    assert str(path) in refusal(path, None, scene_key="measurement.file")


def test_a_file_of_something_else_is_refused(tmp_path):
    pytest.importorskip("pyuff", reason="pyuff is an extra")
    (tmp_path / "x.uff").write_bytes(b"\x00\xff" * 3000)
    assert "x.uff" in refusal(tmp_path / "x.uff", None)


def test_without_pyuff_it_is_said_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyuff", None)
    (tmp_path / "x.uff").write_text("    -1\n    58\n")
    assert "pyuff is not installed. Install it: dynid[formats]" in refusal(tmp_path / "x.uff", None)
