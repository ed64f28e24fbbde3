"""Dates and times of day in tables: formats, order of day and month, midnight, zones, and what is refused."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.errors import FileError
from dynid.files.date_times import read_stamps
from dynid.files.read_measured import read_columns
from dynid.files.table import TableLayout

START = datetime(2024, 12, 30, 23, 59, 58, 250_000)


def iso(mark="-", between=" ", decimal=".", digits=3, zone=""):
    return lambda t: (
        t.strftime(f"%Y{mark}%m{mark}%d{between}%H:%M:%S") + decimal + f"{t.microsecond:06d}"[:digits] + zone
    )


def half_day(t):
    return (
        t.strftime("%m/%d/%Y %I:%M:%S") + f".{t.microsecond // 1000:03d} " + ("PM" if t.hour > 11 else "AM")
    )


FORMATS = {
    "ISO": iso(),
    "ISO with T": iso(between="T", zone="Z"),
    "ISO with an offset": iso(between="T", zone="+01:00"),
    "ISO with six digits": iso(digits=6),
    "ISO with a comma": iso(decimal=","),
    "slashes": iso(mark="/"),
    "d.m.Y": lambda t: t.strftime("%d.%m.%Y %H:%M:%S.") + f"{t.microsecond // 1000:03d}",
    "d.m.Y with a comma": lambda t: t.strftime("%d.%m.%Y %H:%M:%S,") + f"{t.microsecond // 1000:03d}",
    "d/m/Y": lambda t: t.strftime("%d/%m/%Y %H:%M:%S.") + f"{t.microsecond // 1000:03d}",
    "m/d/Y": lambda t: t.strftime("%m/%d/%Y %H:%M:%S.") + f"{t.microsecond // 1000:03d}",
    "m/d/Y with AM and PM": half_day,
    "month by name": lambda t: t.strftime("%d-%b-%Y %H:%M:%S.") + f"{t.microsecond // 1000:03d}",
    "two digits of the year": lambda t: t.strftime("%d/%m/%y %H:%M:%S.") + f"{t.microsecond // 1000:03d}",
    "time of day": lambda t: t.strftime("%H:%M:%S.") + f"{t.microsecond // 1000:03d}",
}


def table(stamps, separator, head="Timestamp", end="\n", names=("F", "a1")):
    rows = [f"{stamp}{separator}{k}{separator}{k * 2}" for k, stamp in enumerate(stamps)]
    return end.join([separator.join([head, *names]), *rows, ""])


@pytest.mark.parametrize(
    ("form", "separator"),
    [
        (form, mark)
        for form in FORMATS
        for mark in (",", ";", "\t", " ")
        if mark != "," or "comma" not in form
    ],
)
def test_stamps_of_all_forms_are_the_times_of_the_rows(tmp_path, form, separator):
    step = 0.125
    stamps = [FORMATS[form](START + timedelta(seconds=k * step)) for k in range(40)]  # over midnight
    (tmp_path / "x.csv").write_text(table(stamps, separator))
    found = read_columns(tmp_path / "x.csv", None, step=step)
    np.testing.assert_array_equal(found.values, [[k, 2 * k] for k in range(40)])
    assert found.clock.step == pytest.approx(step, rel=1e-12)
    with pytest.raises(FileError, match=r"the times are 0\.125 s apart, but 'step' is 0\.25 s"):
        read_columns(tmp_path / "x.csv", None, step=0.25)


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize(
    "top", ["", "------ Logger X, firmware 2.0, at 8 Hz ------\nSerial: 7\n-----------\n"]
)
@pytest.mark.parametrize("rule", ["", "---------,----,----\n", "=====================\n"])
def test_headers_of_loggers_may_have_dashes(tmp_path, end, mark, top, rule):
    stamps = [FORMATS["d/m/Y"](START + timedelta(seconds=k / 8)) for k in range(30)]
    head, rows = table(stamps, ",").split("\n", 1)
    text = (mark + top + head + "\n" + rule + rows).replace("\n", end)
    (tmp_path / "x.csv").write_bytes(text.encode())
    found = read_columns(tmp_path / "x.csv", ["a1"], step=0.125)
    np.testing.assert_array_equal(found.values[:, 0], 2.0 * np.arange(30))
    assert ("above the column names" in found.note) == bool(top)


@pytest.mark.parametrize("separator", [",", ";", " "])
@pytest.mark.parametrize("heads", ["Date{0}Time", "Datum{0}Zeit", "date{0}t"])
def test_date_and_time_may_have_columns_of_their_own(tmp_path, separator, heads):
    moments = [START + timedelta(seconds=k / 8) for k in range(30)]
    stamps = [t.strftime(f"%d.%m.%Y{separator}%H:%M:%S.") + f"{t.microsecond // 1000:03d}" for t in moments]
    (tmp_path / "x.csv").write_text(table(stamps, separator, heads.format(separator)))
    for columns in (None, ["F", "a1"], [3, 4]):
        found = read_columns(tmp_path / "x.csv", columns, step=0.125)
        np.testing.assert_array_equal(found.values, [[k, 2 * k] for k in range(30)])
        assert found.clock.step == pytest.approx(0.125, rel=1e-12)
    with pytest.raises(FileError, match=r"has dates or times of day in '[dD]at"):
        read_columns(tmp_path / "x.csv", [1], step=0.125)


def test_without_names_the_only_stamps_are_the_times(tmp_path):
    stamps = [FORMATS["ISO"](START + timedelta(seconds=k / 8)) for k in range(30)]
    (tmp_path / "x.csv").write_text(table(stamps, ";").split("\n", 1)[1])
    found = read_columns(tmp_path / "x.csv", None, step=0.125)
    assert found.clock.step == pytest.approx(0.125, rel=1e-12)


def test_a_column_of_numbers_named_as_time_comes_before_stamps(tmp_path):
    rows = [f"{FORMATS['ISO'](START)},{k / 4},{k}" for k in range(9)]
    (tmp_path / "x.csv").write_text("\n".join(["started,time,a", *rows]))
    found = read_columns(tmp_path / "x.csv", None, step=0.25)
    np.testing.assert_array_equal(found.values[:, 0], np.arange(9.0))
    named = TableLayout(time="started")
    with pytest.raises(FileError, match="the times are 0 s apart"):
        read_columns(tmp_path / "x.csv", ["a"], step=0.25, layout=named)


def test_dropped_samples_are_found_by_stamps(tmp_path):
    kept = [k for k in range(60) if k not in (17, 18, 40)]
    stamps = [FORMATS["m/d/Y with AM and PM"](START + timedelta(seconds=k / 8)) for k in kept]
    (tmp_path / "x.csv").write_text(table(stamps, ","))
    found = read_columns(tmp_path / "x.csv", ["F"], step=0.125)
    assert found.clock.dropped == 3
    assert np.flatnonzero(np.isnan(found.values[:, 0])).tolist() == [17, 18, 40]


def test_whole_seconds_are_stamps_of_a_coarse_clock(tmp_path):
    stamps = [(START + timedelta(seconds=k / 8)).strftime("%Y-%m-%d %H:%M:%S") for k in range(80)]
    (tmp_path / "x.csv").write_text(table(stamps, ","))
    np.testing.assert_array_equal(
        read_columns(tmp_path / "x.csv", ["F"], step=0.125).values[:, 0], np.arange(80.0)
    )


@settings(max_examples=80)
@given(
    st.datetimes(datetime(1971, 1, 1), datetime(2099, 1, 1)),
    st.lists(st.integers(0, 10**10), min_size=1, max_size=5),
    st.sampled_from(["ISO with six digits", "ISO with an offset", "month by name", "d.m.Y"]),
)
def test_no_digit_of_a_stamp_is_lost(start, steps, form):
    digits = 6 if "six" in form else 3
    moments = [start.replace(microsecond=start.microsecond // 1000 * 1000)]
    for step in steps:
        moments.append(moments[-1] + timedelta(microseconds=step if digits == 6 else step // 1000 * 1000))
    found = read_stamps([FORMATS[form](t) for t in moments])
    exact = [(t - moments[0]) / timedelta(seconds=1) for t in moments]
    np.testing.assert_array_equal(found.seconds, exact)
    assert found.resolution == 10.0**-digits


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        (["11/12/2024 23:59:59", "12/12/2024 00:00:00"], "day and month of '11/12' cannot be distinguished"),
        (["11/13/2024 23:59:59", "14/11/2024 00:00:00"], "numbers above 12 at the places of day and month"),
        (["2024-02-30 10:00:00", "2024-03-01 10:00:00"], "x.csv:2: '2024-02-30 10:00:00' does not exist"),
        (["2024-02-20 10:00:00", "2024-02-20 10:61:00"], "x.csv:3: '2024-02-20 10:61:00' does not exist"),
        (["2024-02-20 10:00:00", "2024-02-20"], "x.csv:3: '2024-02-20' is no date and time"),
        (["2024-02-20 10:00:00", "0.5"], "x.csv:3: '0.5' is no date and time"),
        (["10:00:00", "13:00:00 PM"], "x.csv:3: '13:00:00 PM' does not exist: hours before or after noon"),
        (["1-Foo-2024 10:00:00", "1-Foo-2024 10:00:01"], "x.csv:2: '1-Foo-2024 10:00:00' does not exist"),
        (["2024-12-11 yesterday", "2024-12-11 today"], "x.csv:2: '2024-12-11 yesterday' is not a number"),
    ],
)
def test_what_is_no_stamp_is_said_with_its_line(tmp_path, stamps, said):
    (tmp_path / "x.csv").write_text(table(stamps, ","))
    with pytest.raises(FileError) as raised:
        read_columns(tmp_path / "x.csv", None, step=1.0)
    assert said in str(raised.value)


def test_offsets_of_zones_are_taken_into_account():
    found = read_stamps(["2024-10-27T02:59:59+02:00", "2024-10-27T02:00:00+01:00", "2024-10-27T01:00:01Z"])
    np.testing.assert_array_equal(found.seconds, [0, 1, 2])


def test_the_last_place_is_that_of_the_format():
    assert read_stamps(["10:00:00.5", "10:00:00.25"]).resolution == 0.01
    assert read_stamps(["10:00", "10:01", ""]).resolution == 60.0
    assert np.isnan(read_stamps(["10:00", ""]).seconds[1])


@pytest.mark.parametrize("text", ["a,b\n---,---\n1,2\n3,4\n", "a,b\n1,2\n----,----\n3,4\n", "----\n1\n"])
def test_dashes_that_may_be_a_row_are_not_passed_over(tmp_path, text):
    (tmp_path / "x.csv").write_text(text)
    if text.startswith("----"):
        np.testing.assert_array_equal(read_columns(tmp_path / "x.csv", None).values, [[1.0]])
        return
    with pytest.raises(FileError, match=r"'---+' is not a number"):
        read_columns(tmp_path / "x.csv", None)


@pytest.mark.parametrize("rule", ["|---|:---:|", "--- ---", "======  ====", "*****"])
def test_lines_below_the_names_may_separate(tmp_path, rule):
    mark = "|" if "|" in rule else " "
    rows = [mark.join(words) for words in (("time", "acc"), ("0.0", "1.5"), ("0.5", "2.5"))]
    (tmp_path / "x.txt").write_text("\n".join([rows[0], rule, *rows[1:]]) + "\n")
    np.testing.assert_array_equal(read_columns(tmp_path / "x.txt", None, step=0.5).values, [[1.5], [2.5]])
