"""Recordings of TDMS, MF4, WAV, NumPy, Parquet and workbooks: the same record as the CSV, or a reason."""

import datetime
import wave
import zipfile

import numpy as np
import pytest

from dynid import load_scene, run
from dynid.errors import FileError
from dynid.files import read_measured
from dynid.files.table import TableLayout
from tests.files import recorder_files
from tests.files.reading import read_columns, read_signal

pytestmark = pytest.mark.usefixtures("untried")

STEP, N = 0.002, 300
T = STEP * np.arange(N)
rng = np.random.default_rng(5)
ACC, FORCE = rng.standard_normal((2, N))
UNITS = {"acc": "g", "force": "kN"}


def refusal(*args, read=read_columns, **kwargs):
    with pytest.raises(FileError) as caught:
        read(*args, **kwargs)
    return str(caught.value)


def write_csv(path, acc=ACC, force=FORCE, times=T):
    rows = (
        f"{t!r},{a!r},{f!r}\n" for t, a, f in zip(*map(np.ndarray.tolist, (times, acc, force)), strict=True)
    )
    path.write_text("time [s],acc [g],force [kN]\n" + "".join(rows))
    return path


def waveform(unit="", increment=STEP, offset=0.0, **more):
    stated = {"wf_increment": increment, "wf_start_offset": offset, **more}
    return {**stated, "unit_string": unit} if unit else stated


def write_tdms(path, groups):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        writer.write_segment(
            [
                ChannelObject(group, name, values, properties=properties)
                for group, channels in groups.items()
                for name, (values, properties) in channels.items()
            ]
        )
    return path


def write_mf4(path, *groups, version="4.10"):
    from asammdf import MDF, Signal

    with MDF(version=version) as file:
        for times, channels in groups:
            file.append(
                [Signal(values, times, name=name, **more) for name, (values, more) in channels.items()]
            )
        file.save(path, overwrite=True)
    return path


def write_parquet(path, columns, units=None):
    import pyarrow as pa
    from pyarrow import parquet

    fields = [
        pa.field(name, pa.array(values).type, metadata={"unit": (units or {}).get(name, "")})
        for name, values in columns.items()
    ]
    parquet.write_table(pa.table([*columns.values()], schema=pa.schema(fields)), path)
    return path


def write_workbook(path, rows, title="Data"):
    import openpyxl

    book = openpyxl.Workbook()
    book.active.title = title
    for row in rows:
        book.active.append(row)
    book.create_sheet("empty")
    book.save(path)
    return path


ROWS = [["time", "acc", "force"], ["s", "g", "kN"], *np.column_stack([T, ACC, FORCE]).tolist()]


def _tdms(path):
    return write_tdms(path / "r.tdms", {"G": {"acc": (ACC, waveform("g")), "force": (FORCE, waveform("kN"))}})


def _tdms_by_hand(path):
    return recorder_files.tdms(
        path / "r.tdms", {"G": {"acc": (ACC, waveform("g")), "force": (FORCE, waveform("kN"))}}
    )


def _tdms_xy(path):
    channels = {"Time": (T, {"unit_string": "s"}), "acc": (ACC, {"unit_string": "g"})}
    return write_tdms(path / "r.tdms", {"G": {**channels, "force": (FORCE, {"unit_string": "kN"})}})


def _mf4(path):
    return write_mf4(path / "r.mf4", (T, {"acc": (ACC, {"unit": "g"}), "force": (FORCE, {"unit": "kN"})}))


def _mf4_by_hand(path):
    return recorder_files.mf4(path / "r.mf4", T, {"acc": (ACC, "g", 1.0), "force": (FORCE, "kN", 0.25)})


def _mdf3(path):
    channels = {"acc": (ACC, {"unit": "g"}), "force": (FORCE, {"unit": "kN"})}
    return write_mf4(path / "r.mdf", (T, channels), version="3.30")


def _parquet(path):
    columns = {"time": T, "acc": ACC, "force": FORCE}
    return write_parquet(path / "r.parquet", columns, {**UNITS, "time": "s"})


def _parquet_by_fastparquet(path):
    import fastparquet
    import pandas

    frame = pandas.DataFrame({"time [s]": T, "acc [g]": ACC, "force [kN]": FORCE})
    fastparquet.write(str(path / "r.parquet"), frame)
    return path / "r.parquet"


def _workbook(path):
    return write_workbook(path / "r.xlsx", [["Test of 3 May"], [], *ROWS])


def _workbook_by_xlsxwriter(path):
    import xlsxwriter

    with xlsxwriter.Workbook(path / "r.xlsx") as book:
        sheet = book.add_worksheet("Data")
        for number, row in enumerate([["time [s]", "acc [g]", "force [kN]"], *ROWS[2:]]):
            sheet.write_row(number, 0, row)
    return path / "r.xlsx"


def _npz(path):
    np.savez(path / "r.npz", **{"time": T, "acc [g]": ACC, "force [kN]": FORCE})
    return path / "r.npz"


WRITERS = [
    *(_tdms, _tdms_by_hand, _tdms_xy, _mf4, _mf4_by_hand, _mdf3, _npz),
    *(_parquet, _parquet_by_fastparquet, _workbook, _workbook_by_xlsxwriter),
]


@pytest.mark.parametrize("write", WRITERS)
def test_a_recording_is_the_record_of_its_csv(tmp_path, write):
    csv, path = write_csv(tmp_path / "r.csv"), write(tmp_path)
    expected = read_measured.read_columns(csv, ["acc", "force"], step=STEP)
    measured = read_measured.read_columns(path, ["acc", "force"], step=STEP)
    np.testing.assert_allclose(measured.values, expected.values, rtol=1e-12, atol=0)
    assert measured.headings == expected.headings
    assert measured.clock.step == pytest.approx(expected.clock.step, rel=1e-12)
    assert read_measured.read_columns(path, None, step=STEP).headings == expected.headings
    assert "the times are 0.002 s apart, but 'step' is 0.0021 s" in refusal(path, ["acc"], step=0.0021)


@pytest.mark.parametrize(
    ("dtype", "full_scale"), [(np.uint8, 2**7), (np.int16, 2**15), (np.int32, 2**31), (np.float64, 1)]
)
def test_wav_reaches_from_minus_one_to_one(tmp_path, dtype, full_scale):
    from scipy.io import wavfile

    ratios = np.array([[-1.0, 0.5], [0.25, -0.5], [0, 0.75]])
    stored = ratios * full_scale + 128 * (dtype == np.uint8)
    wavfile.write(tmp_path / "r.wav", 500, stored.astype(dtype))
    np.testing.assert_array_equal(read_columns(tmp_path / "r.wav", None, step=STEP), ratios)
    np.testing.assert_array_equal(read_signal(tmp_path / "r.wav", "channel 2", step=STEP), ratios[:, 1])


def test_wav_of_the_standard_library_with_24_bits(tmp_path):
    levels = np.array([-(2**23), 2**22, 1])
    with wave.open(str(tmp_path / "r.wav"), "wb") as stream:
        stream.setnchannels(1)
        stream.setsampwidth(3)
        stream.setframerate(500)
        stream.writeframes(b"".join(int(level).to_bytes(3, "little", signed=True) for level in levels))
    np.testing.assert_array_equal(read_columns(tmp_path / "r.wav", [1], step=STEP)[:, 0], levels / 2**23)
    cut = tmp_path / "cut.wav"
    cut.write_bytes((tmp_path / "r.wav").read_bytes()[:-3])
    assert "cannot be read as a WAV file" in refusal(cut, None, step=STEP)


def test_numpy_arrays_are_columns_by_name_and_number(tmp_path):
    np.save(tmp_path / "r.npy", np.column_stack([T, ACC, FORCE]))
    timed = TableLayout(time=1)
    np.testing.assert_array_equal(read_columns(tmp_path / "r.npy", [3], step=STEP, layout=timed)[:, 0], FORCE)
    np.testing.assert_array_equal(
        read_columns(tmp_path / "r.npy", None, step=STEP, layout=timed), np.column_stack([ACC, FORCE])
    )
    np.savez(
        tmp_path / "r.npz",
        t=T,
        both=np.column_stack([ACC, FORCE]),
        z=1j * T,
        row=ACC[None],
        wide=np.eye(3, 9),
    )
    path = tmp_path / "r.npz"
    np.testing.assert_array_equal(read_columns(path, ["both:2", "row"], step=STEP)[:, 0], FORCE)
    assert "has complex numbers in 'z', no numbers" in refusal(path, ["z"])
    assert "an array of the shape (3, 9), which has no columns as channels" in refusal(path, ["wide"])
    assert "has no channel 'both:3'; did you mean 'both:1'? It has t, both:1, both:2, row." in refusal(
        path, ["both:3"]
    )


GROUPS = {
    "Run 1": {"acc": (ACC, waveform("g")), "force": (FORCE, waveform("kN"))},
    "Run 2": {
        "acc": (ACC[:50], waveform(increment=2 * STEP)),
        "late": (ACC[:50], waveform(offset=0.5, increment=2 * STEP)),
        "short": (ACC[:20], waveform(increment=2 * STEP)),
        "said": (["a", "b"], {}),
    },
}


def test_channels_are_named_by_group(tmp_path):
    path = write_tdms(tmp_path / "r.tdms", GROUPS)
    in_group = read_columns(path, ["acc"], step=STEP, layout=TableLayout(group="Run 1"))
    np.testing.assert_array_equal(in_group[:, 0], ACC)
    np.testing.assert_array_equal(read_columns(path, ["Run 1/acc", "force"], step=STEP)[:, 1], FORCE)
    assert "has 2 channels 'acc': Run 1/acc, Run 2/acc. Name the group" in refusal(path, ["acc"])
    assert "has 2 groups of channels: Run 1, Run 2. Name one" in refusal(path, None)
    assert "has no group 'Run 3'; did you mean 'Run 1'?" in refusal(
        path, None, layout=TableLayout(group="Run 3")
    )
    assert "has no group 'x'; it has Run 1, Run 2" in refusal(path, None, layout=TableLayout(group="x"))
    assert "has no channel 'q'; it has Run 1/acc, Run 1/force" in refusal(path, ["q"])
    assert "no numbers" in refusal(path, ["said"])
    assert "has 5 channels of numbers, no channel 6" in refusal(path, [6])
    assert "takes no 'sheet'" in refusal(path, None, layout=TableLayout(sheet="x"))
    said = refusal(path, None, layout=TableLayout(group="Run 1"), read=read_signal)
    assert "has 2 columns beside the time: acc, force" in said


@pytest.mark.parametrize("other", ["Run 2/acc", "Run 2/late", "Run 2/short"])
def test_channels_of_other_clocks_are_refused(tmp_path, other):
    path = write_tdms(tmp_path / "r.tdms", GROUPS)
    np.testing.assert_array_equal(read_columns(path, [other])[:20, 0], ACC[:20])
    first = "Run 1/acc" if other == "Run 2/acc" else "Run 2/acc"
    said = refusal(path, [first, other])
    assert f"has channels of different clocks: '{first}' has" in said
    assert "Name columns of one clock: columns: […], and others in 'beside'" in said


def test_channels_without_times_and_of_other_lengths(tmp_path):
    path = tmp_path / "r.npz"
    np.savez(path, a=ACC, b=FORCE, short=ACC[:9], t=T, on=ACC > 0)
    assert read_measured.read_columns(path, ["short"], step=STEP).clock is None
    assert "has channels of different lengths: a 300, short 9; the times 't' have 300" in refusal(
        path, ["a", "short"]
    )
    np.testing.assert_array_equal(read_columns(path, ["on"], step=STEP)[:, 0], ACC > 0)
    np.savez(path, a=ACC, short=ACC[:9])
    assert "has channels of different clocks: 'a' has 300 samples without times; 'short' has 9" in refusal(
        path, None
    )
    np.savez(path, said=np.array(["a"]))
    assert "holds no channels of numbers" in refusal(path, None)
    assert "has no channel 'a'; it has no channels of numbers" in refusal(path, ["a"])
    write_tdms(tmp_path / "r.tdms", {"G": {"on": (ACC > 0, waveform())}})
    np.testing.assert_array_equal(read_columns(tmp_path / "r.tdms", ["on"], step=STEP)[:, 0], ACC > 0)


def test_files_that_claim_too_much_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.files.recorder_files.MOST_NUMBERS", 100)
    assert "cannot be read as a Parquet file: it claims 300 rows of 3" in refusal(_parquet(tmp_path), ["acc"])
    monkeypatch.setattr("dynid.files.spreadsheet.MOST_NUMBERS", 100)
    assert "it has more than 1e+02 cells" in refusal(_workbook(tmp_path), ["acc"])
    monkeypatch.setattr("dynid.files.recorder_files._MAX_CHANNELS", 1)
    assert "it has more than 1 channels" in refusal(_mf4_by_hand(tmp_path), ["acc"])
    content = _tdms_by_hand(tmp_path).read_bytes()
    claims = content.replace((300).to_bytes(8, "little"), (10**12).to_bytes(8, "little"))
    (tmp_path / "r.tdms").write_bytes(claims)
    assert "cannot be read as a TDMS file" in refusal(tmp_path / "r.tdms", ["acc"])


@pytest.mark.parametrize("stated", [{"increment": -STEP}, {"increment": np.inf}, {"offset": np.nan}])
def test_a_clock_that_is_none_is_refused(tmp_path, stated):
    path = write_tdms(tmp_path / "r.tdms", {"G": {"a": (ACC, waveform(**stated))}})
    assert "of 'G/a'. Save it with a positive, finite step." in refusal(path, ["a"], step=STEP)


def test_a_channel_without_samples_is_refused(tmp_path):
    path = recorder_files.tdms(
        tmp_path / "r.tdms", {"G": {"a": (ACC, waveform()), "b": (ACC[:0], waveform())}}
    )
    assert "has no samples in 'G/b'" in refusal(path, ["b"], step=STEP)
    assert read_columns(path, ["a"], step=STEP).shape == (N, 1)


def test_units_that_are_not_known_are_to_be_stated(tmp_path):
    write_tdms(tmp_path / "r.tdms", {"G": {"a": (ACC, waveform("Volts")), "b": (ACC, waveform("EU"))}})
    volts, engineering = read_measured.read_columns(tmp_path / "r.tdms", None, step=STEP).headings
    assert volts == ("a", "volts", "")
    assert engineering == ("b", "", "the file states 'EU', which is no known unit")


def test_starts_in_absolute_time_count(tmp_path):
    began = datetime.datetime(2024, 5, 3, 10, 0, 0)
    later = began + datetime.timedelta(milliseconds=1)
    groups = {
        "G": {
            "a": (ACC, waveform(wf_start_time=began)),
            "b": (ACC, waveform(wf_start_time=later)),
            "c": (ACC, waveform(wf_start_time=later, offset=-0.001)),
        }
    }
    path = write_tdms(tmp_path / "r.tdms", groups)
    assert "'G/b' has 300 samples every 0.002 s from 0.001 s" in refusal(path, ["a", "b"], step=STEP)
    assert read_columns(path, ["a", "c"], step=STEP).shape == (N, 2)


def test_groups_of_mf4_have_clocks_conversions_and_invalid_samples(tmp_path):
    from asammdf.blocks.v4_blocks import ChannelConversion

    counts = np.arange(50, dtype=np.uint8)
    conversion = ChannelConversion(conversion_type=1, b=-1.0, a=0.5)  # linear
    invalid = counts % 7 == 3
    slow = {
        "counts": (counts, {"conversion": conversion}),
        "gaps": (ACC[:50], {"invalidation_bits": invalid}),
    }
    path = write_mf4(
        tmp_path / "r.mf4",
        (T, {"acc": (ACC, {"unit": "g"})}),
        (4 * T[:50], slow),
        (4 * T[:50], {"same": (ACC[:50], {}), "said": (np.array([b"a"] * 50), {"encoding": "utf-8"})}),
    )
    values = read_columns(path, ["counts", "gaps", "same"], step=4 * STEP)
    np.testing.assert_array_equal(values[:, 0], 0.5 * counts - 1)
    np.testing.assert_array_equal(np.isnan(values[:, 1]), invalid)
    np.testing.assert_array_equal(values[:, 2], ACC[:50])
    assert "has channels of different clocks" in refusal(path, ["acc", "counts"])
    assert "no numbers" in refusal(path, ["said"])


def test_columns_of_parquet_may_be_missing_stamped_and_text(tmp_path):
    stamps = np.datetime64("2024-05-03T10:00:00.000") + (1000 * T).astype(int).astype("timedelta64[ms]")
    import pyarrow as pa

    gaps = pa.array([None, *ACC[1:]])
    path = write_parquet(
        tmp_path / "r.parquet", {"timestamp": stamps, "acc": gaps, "said": ["a"] * N, "count": np.arange(N)}
    )
    measured = read_columns(path, ["acc", "count"], step=STEP)
    assert np.isnan(measured[0, 0])
    np.testing.assert_array_equal(measured[1:, 0], ACC[1:])
    assert "has text in 'said'" in refusal(path, ["said"])


def test_a_formula_without_its_value_is_refused(tmp_path):
    import xlsxwriter

    rows = [["time", "acc"], [0.0, 1.0], [0.002, "=2*B2"]]
    assert (
        "has in the sheet 'Data', row 3, the formula =2*B2 without its value. Save the workbook with"
        in refusal(write_workbook(tmp_path / "a.xlsx", rows), None, step=STEP)
    )
    with xlsxwriter.Workbook(tmp_path / "b.xlsx") as book:  # stores 0, to be calculated when it is opened
        sheet = book.add_worksheet("Data")
        for number, row in enumerate(rows):
            sheet.write_row(number, 0, row)
    assert "the formula =2*B2 without its value" in refusal(tmp_path / "b.xlsx", None, step=STEP)
    calculated = tmp_path / "c.xlsx"  # as a spreadsheet program saves it
    with zipfile.ZipFile(tmp_path / "b.xlsx") as book, zipfile.ZipFile(calculated, "w") as copy:
        for name in book.namelist():
            content = (
                book.read(name)
                .replace(b' fullCalcOnLoad="1"', b"")
                .replace(b"<v>0</v></c></row>", b"<v>2</v></c></row>")
            )
            copy.writestr(name, content)
    np.testing.assert_array_equal(read_columns(calculated, ["acc"], step=STEP)[:, 0], [1, 2])


def test_dates_and_times_of_a_workbook_are_times(tmp_path):
    began = datetime.datetime(2024, 5, 3, 10, 0, 0)
    stamps = [began + datetime.timedelta(milliseconds=500 * k) for k in range(5)]
    rows = [["time", "acc"], *([stamp, float(k)] for k, stamp in enumerate(stamps))]
    path = write_workbook(tmp_path / "a.xlsx", rows)
    np.testing.assert_array_equal(read_columns(path, ["acc"], step=0.5)[:, 0], np.arange(5))
    clock = [["time", "acc"], *([stamp.time(), k] for k, stamp in enumerate(stamps))]
    path = write_workbook(tmp_path / "b.xlsx", clock)
    np.testing.assert_array_equal(read_columns(path, ["acc"], step=0.5)[:, 0], np.arange(5))


def test_sheets_are_named_where_there_are_several(tmp_path):
    import openpyxl

    path = _workbook(tmp_path)
    book = openpyxl.load_workbook(path)
    for row in ROWS[:4]:
        book["empty"].append(row)
    book.save(path)
    assert "has 2 sheets with cells: Data, empty. Name one: sheet: NAME" in refusal(path, ["acc"])
    assert read_columns(path, ["acc"], layout=TableLayout(sheet="empty")).shape == (2, 1)
    assert "has no sheet 'Dat' with cells; did you mean 'Data'?" in refusal(
        path, None, layout=TableLayout(sheet="Dat")
    )
    broken = write_workbook(tmp_path / "x.xlsx", [["time", "acc"], [0, 1], [0.002, "#DIV/0!"]])
    assert f"{broken}:3: '#DIV/0!' is not a number" in refusal(broken, None)


@pytest.mark.parametrize("write", [_tdms, _parquet, _workbook, _npz])
def test_damaged_recordings_are_refused(tmp_path, write):
    path = write(tmp_path)
    content = path.read_bytes()
    for size in (0, 3, 200, len(content) // 2):
        path.write_bytes(content[:size])
        said = refusal(path, ["acc"], step=STEP)
        assert "cannot be read" in said or "has no " in said or "truncated" in said, (size, said)


def test_without_its_package_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.files.recorder_files.find_spec", lambda _: None)
    assert (
        "is a TDMS file, and nptdms is not installed. Install it: pip install 'dynid[recorders]'"
        in refusal(_tdms(tmp_path), None)
    )
    assert "is a workbook, and openpyxl is not installed" in refusal(_workbook(tmp_path), None)


def test_a_package_that_dies_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.trial.survives", lambda *_, **__: False)
    assert "nptdms crashes, or takes over 30 s or 4.0 GiB. It may be damaged" in refusal(
        _tdms(tmp_path), None
    )


SCENE = """
dynid: 1
kind: identification
structure: {{lumped: {{masses: [1.2, 0.8], links: [{{dofs: [1], k: 1.5e4, c: 4}}]}}}}
joints: {{bolt: {{dofs: [1, 2], k: {{start: 0.9e4}}, c: {{start: 2}}}}}}
excitation: [{{dof: 1, kind: file, path: {path}, column: force}}]
measurement:
  step: 0.002
  samples: 300
  channels: [{{dof: 2, quantity: acceleration}}]
  file: {{path: {path}, columns: [acc]}}
"""


@pytest.fixture(scope="module")
def response():
    """Acceleration of the second mass in g under the force in kN between its samples, with a little noise."""
    from scipy.signal import cont2discrete

    M, k, c = np.diag([1.2, 0.8]), 1.0e4, 3.0
    K = np.array([[1.5e4 + k, -k], [-k, k]])
    C = np.array([[4 + c, -c], [-c, c]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.concatenate([[0, 0], np.linalg.solve(M, [1.0, 0])])[:, None]
    a, b, c_d, d, _ = cont2discrete((A, B, A[[3]], B[[3]]), STEP, "foh")
    x, y = np.zeros(4), np.empty(N)
    for k_step in range(N):
        y[k_step] = (c_d @ x + d[:, 0] * 1e3 * FORCE[k_step])[0]
        x = a @ x + b[:, 0] * 1e3 * FORCE[k_step]
    return y / 9.80665 + 0.5 * np.random.default_rng(1).standard_normal(N)


@pytest.mark.parametrize("write", [_tdms, _mf4, _parquet, _workbook, _npz])
def test_a_joint_is_identified_as_from_the_csv(tmp_path, write, response, monkeypatch):
    monkeypatch.setattr("tests.files.test_recordings.ACC", response)
    monkeypatch.setattr(
        "tests.files.test_recordings.ROWS", [*ROWS[:2], *np.column_stack([T, response, FORCE]).tolist()]
    )
    estimates = []
    for path in (write_csv(tmp_path / "r.csv", response), write(tmp_path)):
        scene = tmp_path / "scene.yaml"
        scene.write_text(SCENE.format(path=path.name).replace("column: force", "column: force, hold: linear"))
        result = run(load_scene(scene))
        estimates.append(result["identification/parameters/estimate"].data)
    np.testing.assert_allclose(estimates[1], estimates[0], rtol=1e-9)
    np.testing.assert_allclose(estimates[0], [1e4, 3.0], rtol=0.2)


def test_two_forces_of_two_files_act_at_once(tmp_path):
    """Against a simulation of both masses driven, in TDMS and NumPy, the channels in either."""
    from scipy.signal import cont2discrete

    M, C = np.diag([1.2, 0.8]), np.array([[7.0, -3], [-3, 3]])
    K = np.array([[2.5e4, -1e4], [-1e4, 1e4]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    B = np.vstack([np.zeros((2, 2)), np.linalg.inv(M)])
    a, b, _, d, _ = cont2discrete((A, B, A[2:], B[2:]), STEP, "foh")
    c, u = A[2:], np.column_stack([1e3 * FORCE, ACC])
    x, y = np.zeros(4), np.empty((N, 2))
    for k in range(N):
        y[k] = c @ x + d @ u[k]
        x = a @ x + b @ u[k]
    run_1 = {"acc": (y[:, 0], waveform("m/s^2")), "force": (FORCE, waveform("kN"))}
    recorder_files.tdms(tmp_path / "r.tdms", {"G": run_1})
    np.savez(tmp_path / "b.npz", **{"time [s]": T, "F [N]": ACC, "a [m/s2]": y[:, 1]})
    text = SCENE.format(path="r.tdms").replace("column: force}", "column: force, hold: linear}, SECOND")
    second = "{dof: 2, kind: file, path: b.npz, column: F, hold: linear}"
    both = "path: r.tdms, columns: [acc], beside: [{path: b.npz, columns: [a]}]"
    text = text.replace("SECOND", second).replace("path: r.tdms, columns: [acc]", both)
    channels = "[{dof: 1, quantity: acceleration}, {dof: 2"
    (tmp_path / "scene.yaml").write_text(text.replace("channels: [{dof: 2", f"channels: {channels}"))
    result = run(load_scene(tmp_path / "scene.yaml"))
    np.testing.assert_allclose(result["identification/parameters/estimate"].data, [1e4, 3.0], rtol=1e-3)


# --- HDF5 and MATLAB ---------------------------------------------------------------------------------


def test_datasets_have_units_nested_paths_and_columns(tmp_path):
    import h5py

    path = tmp_path / "r.h5"
    with h5py.File(path, "w") as file:
        run = file.create_group("run 1/daq")
        run["time"], run["acc"], run["both"] = 1e3 * T, ACC, np.column_stack([ACC, FORCE])
        for name, key, unit in (
            ("time", "units", "ms"),
            ("acc", "unit", "g"),
            ("both", "Units", np.bytes_("kN")),
        ):
            run[name].attrs[key] = unit
        file["run 1/daq/kelvin"] = T
        file["run 1/daq/kelvin"].attrs["unit"] = ["K"]
    measured = read_measured.read_columns(path, ["run 1/daq/acc", "run 1/daq/both:2"], step=STEP)
    np.testing.assert_array_equal(measured.values, np.column_stack([ACC, FORCE]))
    assert [heading.unit for heading in measured.headings] == ["g", "kN"]
    assert measured.clock.step == pytest.approx(STEP, rel=1e-12)
    in_group = TableLayout(group="run 1/daq", time="time")
    np.testing.assert_array_equal(read_columns(path, ["both:1"], step=STEP, layout=in_group)[:, 0], ACC)
    np.testing.assert_array_equal(read_signal(path, "both:1", step=STEP, layout=in_group), ACC)
    assert "has 2 columns in 'run 1/daq/both', no column 3" in refusal(path, ["run 1/daq/both:3"])
    assert "has no dataset of numbers 'acc'; it has run 1/daq/acc, run 1/daq/both" in refusal(path, ["acc"])
    wrong = TableLayout(group="run 1/daq", time="kelvin")
    assert "has 'run 1/daq/kelvin' in K, which is no time" in refusal(path, ["acc"], step=STEP, layout=wrong)


def write_matlab_7_3(path, contents):
    """Write arrays as MATLAB 7.3 does: transposed; lists are the elements of a structure array."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in contents.items():
            if isinstance(values, dict):
                group = file.create_group(name)
                group.attrs["MATLAB_class"] = np.bytes_("struct")
                for field, elements in values.items():
                    references = []
                    for number, element in enumerate(elements):
                        stored = file.create_dataset(
                            f"#refs#/{name}{field}{number}", data=np.atleast_2d(element).T
                        )
                        stored.attrs["MATLAB_class"] = np.bytes_("double")
                        references.append(stored.ref)
                    group.create_dataset(field, data=np.array(references, dtype=h5py.ref_dtype)[:, None])
            else:
                stored = file.create_dataset(name, data=np.atleast_2d(values).T)
                stored.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(512, b" "))
    return path


@pytest.fixture(params=["5", "7.3"])
def matlab(request, tmp_path):
    """A file with vectors, a matrix, and a structure array, of either version."""
    from scipy.io import savemat

    runs = {"acc": [ACC, 2 * ACC], "M": [np.eye(2), np.array([[2.0, 1], [0, 3]])]}
    contents = {"t": T, "row": FORCE[None], "both": np.column_stack([ACC, FORCE])}
    if request.param == "7.3":
        return write_matlab_7_3(tmp_path / "r.mat", {**contents, "runs": runs})
    array = np.zeros((1, 2), dtype=[("acc", object), ("M", object)])
    for number in range(2):
        array[0, number] = tuple(values[number] for values in runs.values())
    savemat(tmp_path / "r.mat", {**contents, "runs": array})
    return tmp_path / "r.mat"


def test_matlab_files_of_both_versions_are_records(matlab):
    timed = TableLayout(time="t")
    measured = read_columns(matlab, ["both:1", "row"], step=STEP, layout=timed)
    np.testing.assert_array_equal(measured, np.column_stack([ACC, FORCE]))
    for name in ("runs(2)/acc", "runs(2).acc"):
        np.testing.assert_array_equal(read_columns(matlab, [name], step=STEP, layout=timed)[:, 0], 2 * ACC)
    np.testing.assert_array_equal(
        read_columns(matlab, ["acc"], layout=TableLayout(group="runs(1)"))[:, 0], ACC
    )
    assert "'runs(3)/acc'; " in refusal(matlab, ["runs(3)/acc"])
    assert "has 2 columns in 'both', no column 3" in refusal(matlab, ["both:3"])


def test_matrices_are_fields_of_structure_arrays(matlab):
    from dynid.files.read_matrix import MatrixFile, read_matrix

    for name in ("runs(2)/M", "runs(2).M"):
        matrix = read_matrix(MatrixFile(matlab, name), "mass").matrix
        np.testing.assert_array_equal(matrix, [[2.0, 1], [0, 3]])
    with pytest.raises(FileError, match=r"Name the field of one of its elements: NAME\(1\)/FIELD"):
        read_matrix(MatrixFile(matlab, "runs/M"), "mass")


def test_fields_of_structures_are_columns(tmp_path):
    from scipy.io import savemat

    tracks = {f"Track{k}": {"time": T, "data": k * ACC, "deep": {"x": FORCE}} for k in (1, 2)}
    savemat(tmp_path / "r.mat", tracks)
    measured = read_columns(
        tmp_path / "r.mat",
        ["Track1/data", "Track2.data", "Track2/deep/x"],
        step=STEP,
        layout=TableLayout(time="Track1/time"),
    )
    np.testing.assert_array_equal(measured, np.column_stack([ACC, 2 * ACC, FORCE]))


def test_fields_of_numpy_structures_are_columns(tmp_path):
    table = np.zeros(len(T), dtype=[("time", float), ("acc", "f4"), ("note", "U3"), ("pair", float, 2)])
    table["time"], table["acc"] = T, ACC
    np.save(tmp_path / "r.npy", table)
    np.savez(tmp_path / "r.npz", run=table, square=table[:4].reshape(2, 2))
    for name, group in (("r.npy", ""), ("r.npz", "run/")):
        measured = read_columns(
            tmp_path / name, [f"{group}acc"], step=STEP, layout=TableLayout(time=f"{group}time")
        )
        np.testing.assert_array_equal(measured[:, 0], np.float32(ACC))
        assert f"has text in '{group}note', no numbers" in refusal(tmp_path / name, [f"{group}note"])
        assert f"has structures in '{group}pair', no numbers" in refusal(tmp_path / name, [f"{group}pair"])
    assert "has structures in 'square', no numbers" in refusal(tmp_path / "r.npz", ["square"])


# --- Files of one record -----------------------------------------------------------------------------

TWO = """
dynid: 1
kind: identification
structure: {{lumped: {{masses: [1.2, 0.8], links: [{{dofs: [1], k: 1.5e4, c: 4}}]}}}}
joints: {{bolt: {{dofs: [1, 2], k: {{start: 0.9e4}}, c: {{start: 2}}}}}}
excitation: [{{dof: 1, kind: file, path: {force}, column: force}}]
measurement:
  step: 0.002
  samples: 300
  channels: [{{dof: 2, quantity: acceleration}}, {{dof: 1, quantity: acceleration}}]
  file: {file}
"""


def read_record(folder, file, force="r.csv"):
    from dynid.scene.kinds.measurements import measurements_of
    from dynid.scene.kinds.parts import structure_of

    (folder / "scene.yaml").write_text(TWO.format(file=file, force=force))
    scene = load_scene(folder / "scene.yaml")
    return measurements_of(scene, structure_of(scene))[0].measurement


def test_channels_of_several_files_are_one_record(tmp_path):
    from scipy.io import wavfile

    write_csv(tmp_path / "r.csv")
    wavfile.write(tmp_path / "b.wav", 500, np.column_stack([ACC, 2 * ACC]))
    both = "{path: r.csv, columns: [acc], beside: [{path: b.wav, columns: [2]}]}"
    measured = read_record(tmp_path, both)
    np.testing.assert_allclose(measured.source, np.column_stack([9.80665 * ACC, 2 * ACC]), rtol=1e-15)
    alone = read_record(tmp_path, "{path: b.wav, beside: []}")
    np.testing.assert_array_equal(alone.source, np.column_stack([ACC, 2 * ACC]))
    for file, message in (
        (
            both.replace(", columns: [2]", ""),
            "the files of the record have 3 columns of numbers, 'channels' has 2",
        ),
        (both.replace("b.wav", "none.wav"), "none.wav is no file"),
        (both.replace("acc]", "acc, force]"), "'columns' names 3, but 'channels' has 2"),
    ):
        with pytest.raises(Exception, match=message) as caught:
            read_record(tmp_path, file)
        assert message in str(caught.value)
    wavfile.write(tmp_path / "b.wav", 500, np.column_stack([ACC, ACC])[:200])
    with pytest.raises(FileError, match="has 200 samples, but the scene asks for 300"):
        read_record(tmp_path, both)


def test_files_and_signals_of_one_record_have_one_start(tmp_path):
    write_csv(tmp_path / "r.csv")
    write_csv(tmp_path / "late.csv", times=T + 0.5)
    both = "{path: r.csv, columns: [acc], beside: [{path: late.csv, columns: [acc]}]}"
    with pytest.raises(FileError, match=r"late\.csv starts at 0\.5 s, the others of the record at 0 s"):
        read_record(tmp_path, both)
    path = write_tdms(
        tmp_path / "r.tdms",
        {
            "A": {"acc": (ACC, waveform()), "b": (ACC, waveform())},
            "B": {"force": (FORCE, waveform(offset=0.01))},
        },
    )
    with pytest.raises(FileError, match=r"r\.tdms starts at 0\.01 s, the others of the record at 0 s"):
        read_record(tmp_path, "{path: r.tdms, group: A}", path.name)
    read_record(tmp_path, "{path: late.csv, columns: [acc, acc]}")  # files of their own have their own zero
