"""Separators, decimal marks and headings of tables: recognised where they are certain, else refused."""

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.read_measured import read_columns
from dynid.files.table import TableLayout, time_column

NAN = np.nan


@pytest.fixture
def written(tmp_path):
    def write(text):
        (tmp_path / "x.csv").write_text(text, encoding="utf-8", newline="")
        return tmp_path / "x.csv"

    return write


@pytest.mark.parametrize(
    ("text", "rows"),
    [
        ("t;v\n0,0;1\n0,1;2,5\n", [[1], [2.5]]),
        ("0,0;1,5\n0,1;1,6\n", [[0, 1.5], [0.1, 1.6]]),
        ("a;b\n1,5e-3;-2\n,25;nan\n", [[1.5e-3, -2], [0.25, NAN]]),
        ("a\tb\n0,5\t1,25\n0,75\t\n", [[0.5, 1.25], [0.75, NAN]]),
        ("a b\n0,5 1,25\n0,75 3\n", [[0.5, 1.25], [0.75, 3]]),
        ("0,001 1,5\n0,002 -2,5\n", [[0.001, 1.5], [0.002, -2.5]]),
        ("F\n1,5\n2,5\n", [[1.5], [2.5]]),
        ("a|b\n1|2.5\n3|\n", [[1, 2.5], [3, NAN]]),
        ("a,b\n1,5\n2,6\n", [[1, 5], [2, 6]]),
        ("a, b\n1.5, 5\n2, 6\n", [[1.5, 5], [2, 6]]),
        ("1,2,3\n4,5,6\n", [[1, 2, 3], [4, 5, 6]]),
        ("a;b\n1,234;0,001\n", [[1.234, 0.001]]),
        ('a;"b; c"\n1,5;2\n', [[1.5, 2]]),
        ("1.5,2\n2,3\n", [[1.5, 2], [2, 3]]),
    ],
)
def test_separators_and_decimal_marks_are_recognised(written, text, rows):
    np.testing.assert_array_equal(read_columns(written(text), None).values, rows)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0,5\n0,7\n", "x.csv:1: '0,5': the comma may separate or be decimal"),
        ("a;b\n1,234;5\n", "x.csv:2: '1,234' may be 1.234 or 1234"),
        ("a;b\n1,5;2.5\n", "x.csv:2: '2.5' has a decimal point, '1,5' a comma"),
        ("a,b,c,d\n0,001,1,5\n", "x.csv:2: '0,001,1,5': commas seem to separate and to be decimal"),
        ("0,001,1,5\n0,002,1,7\n", "x.csv:1: '0,001,1,5': commas seem to separate and to be decimal"),
        ("a,b\n0,001,1,5\n", "x.csv:2: '0,001,1,5': commas seem to separate and to be decimal"),
        ("a;b\n1.234,5;2\n", "x.csv:2: '1.234,5' is not a number"),
    ],
)
def test_what_could_be_read_in_two_ways_is_refused(written, text, said):
    with pytest.raises(FileError) as caught:
        read_columns(written(text), None, scene_key="measurement.file")
    assert said in str(caught.value)
    assert caught.value.names == ("measurement.file.path",)


@pytest.mark.parametrize(
    "heads",
    [
        ["Time (s)", "F"],
        ["TIME", "T"],
        ["t / ms", "F"],
        ["t", "T"],
        ["Zeit [s]", "t_end"],
        ["time_s", "x"],
        ["Elapsed Time (sec)", "x"],
        ["X_Value", "acc"],
        ["Timestamp", "acc"],
        ["T", "F"],
    ],
)
def test_the_column_of_the_times_is_found_by_common_names(heads):
    assert time_column(heads) == 0
    assert time_column(heads[::-1]) == 1


@pytest.mark.parametrize(
    "heads", [["T [°C]", "F"], ["t (N)", "F"], ["timer", "F"], ["acc 1", "seconds left"]]
)
def test_other_columns_are_no_times(heads):
    assert time_column(heads) is None


@pytest.mark.parametrize(
    ("head", "factor"), [("Time [ms]", 1e-3), ("Time (s)", 1), ("t / us", 1e-6), ("Time", 1)]
)
def test_times_are_in_the_unit_of_their_heading(written, head, factor):
    path = written(f"{head};v\n0;1\n2;1\n4;1\n")
    assert read_columns(path, None, step=2 * factor).values.shape == (3, 1)
    with pytest.raises(FileError, match="'step' is 1"):
        read_columns(path, None, step=1)


def test_columns_are_named_with_or_without_their_unit(written):
    path = written("Time (s);acc 12+Z [g];Force [N]\n0;1;2\n1;3;4\n")
    for name in ("acc 12+Z", "acc 12+Z [g]", "acc 12+Z (g)"):
        found = read_columns(path, [name], step=1)
        assert found.values[:, 0].tolist() == [1, 3]
        assert [one[:2] for one in found.headings] == [("acc 12+Z", "g")]
    both = read_columns(path, None, step=1)
    assert [one[:2] for one in both.headings] == [("acc 12+Z", "g"), ("Force", "N")]
    below = read_columns(written("t;a;b\ns;g;\n0;1;2\n1;3;4\n"), ["a", "b"], step=1)
    assert [one[:2] for one in below.headings] == [("a", "g"), ("b", "")]


def test_names_that_differ_by_their_unit_alone_are_refused_without_it(written):
    path = written("a [g];a [N]\n1;2\n")
    assert read_columns(path, ["a [N]"]).values.tolist() == [[2]]
    with pytest.raises(FileError, match="has 2 columns 'a'"):
        read_columns(path, ["a"])


def test_a_column_of_times_in_another_unit_is_refused(written):
    path = written("clock [V];v\n0;1\n1;1\n")
    with pytest.raises(FileError, match=r"has 'clock' in V, which is no time"):
        read_columns(path, ["v"], step=1, layout=TableLayout(time="clock"), scene_key="f")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_texts_of_instruments_are_read_in_their_encodings(tmp_path, encoding):
    (tmp_path / "x.csv").write_bytes("Zeit [µs];Beschl. [m/s²]\n0;1,5\n2;2,5\n".encode(encoding))
    found = read_columns(tmp_path / "x.csv", None, step=2e-6)
    assert found.values[:, 0].tolist() == [1.5, 2.5]
    assert found.headings[0][:2] == ("Beschl.", "m/s²")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "cp1252", "utf-16"])
def test_a_lone_column_is_read_in_its_encoding(tmp_path, encoding):
    (tmp_path / "x.csv").write_bytes("# Kanal 1 in m/s²\n0.1\n0.2\n".encode(encoding))
    assert read_columns(tmp_path / "x.csv", None).values[:, 0].tolist() == [0.1, 0.2]
    (tmp_path / "x.csv").write_bytes("# Kanal 1 in m/s²\n\n0.2\n".encode(encoding))
    with pytest.raises(FileError, match=r"x\.csv:2: an empty line before the first sample"):
        read_columns(tmp_path / "x.csv", None)


LOGGER = "Logger;ACME DL-4\nProject;Clamp test\nDate;2026-11-26 10:14:03\n"
NAMED = "Zeit [s];Kraft [N];Beschl. [g]\n"
ROWS = "0,000;9,42;-0,1\n0,001;6,80;0,2\n"


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        (LOGGER + NAMED + ROWS, 3),
        (LOGGER + "\n" + NAMED + ROWS, 4),
        ("Clamp test\n" + NAMED + ROWS, 1),
        (LOGGER + "Zeit;Kraft;Beschl.\ns;N;g\n" + ROWS, 3),
        (LOGGER.replace("\n", ";\n") + NAMED + ROWS, 3),  # filled up by a spreadsheet
        ("a;b;c\n\n" + NAMED + ROWS, 2),  # as many fields, but a paragraph of its own
        ((LOGGER + NAMED + ROWS).replace(",", ".").replace(";", ","), 3),
        ((LOGGER + NAMED + ROWS).replace(",", ".").replace(";", "\t"), 3),
        ("# a comment\n" + LOGGER + NAMED + ROWS, 4),
    ],
)
def test_lines_above_the_names_are_skipped_and_counted(written, text, lines):
    table = read_columns(written(text), ["Kraft", 3], step=0.001)
    np.testing.assert_array_equal(table.values, [[9.42, -0.1], [6.8, 0.2]])
    assert [heading.unit for heading in table.headings] == ["N", "g"]
    first = f"the first {lines} lines of x.csv" if lines > 1 else "line 1 of x.csv"
    assert table.note == f"{first}, above the column names, {'are' if lines > 1 else 'is'} skipped"


@pytest.mark.parametrize("text", [NAMED + ROWS, ROWS, "Kraft\n1\n2\n", "Zeit;F\ns;N\n0;1\n1;2\n"])
def test_nothing_is_skipped_of_a_table_alone(written, text):
    assert read_columns(written(text), None).note == ""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Logger;ACME\nZeit;Kraft\n0;1\n1;2\n", "x.csv:2: 'Zeit' is not a number"),
        ("Logger\nRate;1000\nZeit;Kraft\n0;1\n1;2\n", "x.csv:2: 'Rate;1000' is not a number"),
        ("Logger;a;b\n\nRate;1;2\nZeit;x;y\n0;1;3\n1;2;3\n", "x.csv:2: an empty line among the rows"),
        (LOGGER + ROWS, "x.csv:4: 3 fields where the first row has 2"),
        ("Logger\nKraft\n1\n2\n", "x.csv:2: 'Kraft' is not a number"),
        ("1000\n" + NAMED + ROWS, "x.csv:2: 4 fields where the first row has 1"),
    ],
)
def test_where_the_names_are_not_certain_the_lines_above_are_to_be_deleted(written, text, said):
    with pytest.raises(FileError) as caught:
        read_columns(written(text), None)
    assert said in str(caught.value)
    numbers_first = text.startswith("1000")  # no row of numbers stands above a name
    assert ("Delete the lines above the column names" in str(caught.value)) != numbers_first


def test_samples_are_never_skipped(written):
    """A damaged row is not the heading of the rows below it."""
    for text in ("0;1\n0.1;2;3\n0.2;x;3\n0.3;2;3\n0.4;2;3\n", "Zeit;F\n0;1;2;\n0.2;1,x\n0.3;4\n0.4;5\n"):
        with pytest.raises(FileError):
            read_columns(written(text), None)
