"""Universal Files as programs write them: the same content in other columns, exponents and line ends."""

import re

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.read_measured import read_columns
from dynid.files.table import DataFile
from dynid.files.universal_file import UniversalFile, mean_step
from dynid.files.universal_geometry import read_nodes, read_shapes
from tests.files.universal_files import complex_mode, function, mode, nodes, system, units, written

#: pyuff leaves the file open when it writes a binary data set.
pytestmark = pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
RNG = np.random.default_rng(20)
VALUES = RNG.normal(size=23) * 10.0 ** RNG.integers(-9, 9, 23)
TIMES = 0.003 * np.arange(23)


def uneven(values, **more):
    return function(values, **more) | {"abscissa_spacing": 0, "x": TIMES[: len(values)]}


ANALYSIS = {
    "type": 2414, "analysis_dataset_label": 1, "analysis_dataset_name": "mode", "dataset_location": 1,
    **{f"id{k}": "NONE" for k in range(1, 6)}, "model_type": 1, "analysis_type": 2, "data_characteristic": 3,
    "result_type": 8, "data_type": 2, "number_of_data_values_for_the_data_component": 6,
    "record12_field2": 9.5, "record12_field5": 0.01, "node_nums": np.array([5, 6]),
    "data_at_node": [np.array([0, 0, 1.5, 0, 0.5, 0]), np.array([0, 0, -1.25e-7, 0, 0, 0])],
}  # fmt: skip
LINES = {"type": 82, "trace_num": 1, "n_nodes": 3, "color": 1, "id": "1.5D+02", "nodes": np.array([1, 2, 0])}
AXES = np.vstack([np.eye(3)[[1, 2, 0]], [1.5e-3, 2.0, -3e4]])
PARTS = {"type": 2420, "CS_sys_labels": [8], "CS_names": ["A"], "CS_matrices": [AXES]}
CONTENT = {
    "double": [function(VALUES, step=0.003, id1="first"), function(-VALUES[::-1], step=0.003, id1="1.5D+02")],
    "single": [function(np.round(VALUES, 3), step=0.003, ord_data_type=2)],
    "uneven": [uneven(VALUES)],
    "complex": [function(VALUES + 2j * VALUES[::-1], kind=4, step=0.5)],
    "complex-uneven": [uneven(VALUES - 1j * VALUES, kind=4)],
    "binary": [function(VALUES, step=0.003, binary=1), function(VALUES[::-1], step=0.003, binary=1)],
    "modes": [
        units(1000.0, 1.0),
        nodes([3, 11, 12], [(0, 0, 0.25), (10, -20.5, 0), (1e3, 2, 3)], systems=[0, 1, 0]),
        system(1, (1.0, 2.0, 3.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        mode(12.5, [3, 11, 12], [1e-3, 2.0, -3.0], [0.5, 1e5, 1.0], [1.0, 2.0, 3.0], damping=0.02),
        complex_mode(-3 + 120j, [3, 11], [1 + 2j, 2.0], [0.5, -1j], [1e-5 + 1j, 3.0]),
    ],
    "parts": [
        nodes([1, 2], [(0.1, 0.2, 0.3), (-1e-4, 5e6, 1.0)], kind=2411),
        mode(3.0, [1, 2], *[[1.0, 2.0]] * 6),
    ],
}


def pad(text):
    return re.sub(r"^(.*)$", lambda line: line[0].ljust(80), text, flags=re.MULTILINE)


def fortran(text, letter="D"):
    numbers = re.compile(r"^[-+.\deE\s]*\.[-+.\deE ]*$", re.MULTILINE)
    return numbers.sub(lambda line: re.sub("[eE]", letter, line[0]), text)


DIALECTS = {
    "padded": pad,
    "left": lambda text: re.sub(r"^    -1$", "-1", text, flags=re.MULTILINE),
    "left-padded": lambda text: pad(re.sub(r"^    -1$", "-1", text, flags=re.MULTILINE)),
    "two-blanks": lambda text: re.sub(r"^    -1$", "  -1", text, flags=re.MULTILINE),
    "D": fortran,
    "d-padded": lambda text: pad(fortran(text, "d")),
    "crlf": lambda text: text.replace("\n", "\r\n"),
    "crlf-padded": lambda text: pad(text).replace("\n", "\r\n"),
    "mark": lambda text: "\ufeff" + text,
    "blank-ends": lambda text: "\n" + text + "\n  \n\n",
    "no-last-end": lambda text: text.rstrip("\n"),
    "lower": lambda text: re.sub(r"(?<=\d)E(?=[-+]\d)", "e", text),
}


def contents(path, kind):
    """Return all that dynid reads of a file."""
    if kind in ("modes", "parts"):
        found = read_nodes(path).nodes
        shapes = [(one.frequency, one.damping, dict(one.shape)) for one in read_shapes(DataFile(path))]
        return found.numbers, found.xyz.tolist(), {n: rows.tolist() for n, rows in found.axes.items()}, shapes
    every = UniversalFile(DataFile(path, "")).functions()
    return [
        (one.name, one.kind, one.x.tolist(), one.values.tolist(), one.step, one.response) for one in every
    ]


#: The header lines of a binary data set are counted.
BINARY = ("blank-ends", "no-last-end")
PAIRS = [(kind, name) for kind in CONTENT for name in DIALECTS if kind != "binary" or name in BINARY]


@pytest.mark.parametrize(("kind", "dialect"), PAIRS)
def test_dialects_hold_the_same(tmp_path, kind, dialect):
    path = written(tmp_path / "a.uff", *CONTENT[kind])
    whole, raw = contents(path, kind), path.read_bytes()
    if kind == "binary":
        raw = {"blank-ends": b"\n" + raw + b"\n \n", "no-last-end": raw.rstrip(b"\n")}[dialect]
    else:
        changed = DIALECTS[dialect](raw.decode())
        assert changed != raw.decode() or (dialect in ("D", "lower"))
        raw = changed.encode()
    path.write_bytes(raw)
    assert contents(path, kind) == whole


@pytest.mark.parametrize(("width", "digits"), [(14, 5), (16, 8), (25, 16), (1, 3)])
def test_numbers_of_functions_stand_in_columns_of_any_width(tmp_path, width, digits):
    path = written(tmp_path / "a.uff", function(VALUES, step=0.003))
    lines = path.read_text().split("\n")
    printed = [f"{value:.{digits}E}" for value in VALUES]
    rows = [" " + " ".join(word.rjust(width) for word in printed[k : k + 4]) for k in range(0, 23, 4)]
    path.write_text("\n".join([*lines[:13], *rows, "    -1", ""]))
    np.testing.assert_array_equal(read_columns(path, [1]).values[:, 0], [float(word) for word in printed])


def test_exponents_of_three_digits_have_no_letter_in_fortran(tmp_path):
    values = np.array([1.5e-102, -2.5e101, 3.0, -4.25e-120, 1e100])
    path = written(tmp_path / "a.uff", function(values, step=0.003))
    bare = re.sub(r"([-+]?\d\.\d+)[eE]([-+]\d{3})", r" \1\2", path.read_text())
    assert "1.50000000000-102" in bare
    path.write_text(bare)
    np.testing.assert_array_equal(read_columns(path, [1]).values[:, 0], values)


def test_negative_numbers_may_follow_without_a_blank(tmp_path):
    values = -np.arange(1.0, 13.0)
    path = written(tmp_path / "a.uff", function(values, step=0.003, ord_data_type=2))
    lines = path.read_text().split("\n")
    rows = ["".join(f"{value:.6E}" for value in values[k : k + 6]) for k in (0, 6)]
    assert " " not in rows[0]
    path.write_text("\n".join([*lines[:13], *rows, "    -1", ""]))
    np.testing.assert_array_equal(read_columns(path, [1]).values[:, 0], values)


@pytest.mark.parametrize("end", ["", "\n"])
@pytest.mark.parametrize("count", ["right", "wrong"])
def test_the_binary_part_may_hold_what_ends_data_sets(tmp_path, end, count):
    values = np.frombuffer(
        b"    -1\n  " + b"\n    -1\n" + b"-1\n-1\n-1" + b"\0" * 7, dtype="<f8", count=4
    ).copy()
    path = written(tmp_path / "a.uff", function(values, binary=1), function(values[::-1], binary=1))
    raw = path.read_bytes()
    if end:
        raw = raw.replace(values.tobytes() + b"    -1", values.tobytes() + b"\n    -1")
    if count == "wrong":
        values = np.array([1.0, 2.5, -3.0, 4.0])
        raw = written(path, function(values, binary=1), function(values[::-1], binary=1)).read_bytes()
        assert raw.count(b"          32") == 2
        raw = raw.replace(b"          32", b"          30")
    path.write_bytes(raw)
    first, second = UniversalFile(DataFile(path, "")).functions()
    np.testing.assert_array_equal(first.values, values)
    np.testing.assert_array_equal(second.values, values[::-1])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("    -1", "     1"), "has no line -1, between which data sets stand"),
        (
            lambda text: text[:-40],
            "does not end with the line -1: it is truncated within the data set of type 58",
        ),
        (lambda text: text + "more\n", "does not end with the line -1"),
        (
            lambda text: text.replace("    58", "  text", 1),
            "has 'text' in line 2, where a type of data sets stands",
        ),
        (
            lambda text: text.replace("e+", "e*", 1),
            "data set 1 (of type 58, from line 2) is not as its format says",
        ),
        (
            lambda text: re.sub(r"^.*\d\.\d{10}.*$", "*" * 20, text, count=1, flags=re.MULTILINE),
            "which is no number",
        ),
    ],
)
def test_what_is_no_universal_file_is_said_with_its_line(tmp_path, change, said):
    path = written(tmp_path / "a.uff", function(VALUES, step=0.003))
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError, match=re.escape(said)):
        read_columns(path, None)


def test_shapes_in_other_columns_are_refused_with_their_line(tmp_path):
    path = written(tmp_path / "a.uff", mode(12.5, [3], [1.0], [2.0], [3.0]))
    lines = path.read_text().split("\n")
    place = next(k for k, line in enumerate(lines) if line.split() == ["3"]) + 1
    lines[place] = "".join(f"{value:14.5E}" for value in (10.0, 2.0, 3.0))
    path.write_text("\n".join(lines))
    with pytest.raises(FileError, match=f"line {place + 1} has numbers that are not in columns of 13"):
        read_shapes(DataFile(path))


# Even times that are stored one by one


@pytest.mark.parametrize("rate", [100, 500, 512, 1000, 25600 / 7])
@pytest.mark.parametrize("count", [20, 3000])
def test_the_step_of_stored_times_is_that_of_a_whole_rate(rate, count):
    exact = np.arange(count) / rate
    printed = np.array([float(f"{t:.5e}") for t in exact])
    for times in (exact, printed, exact.astype(np.float32).astype(float)):
        assert mean_step(times) == pytest.approx(1 / rate, rel=1e-15 if float(rate).is_integer() else 1e-5)
    gone = np.delete(printed, [5, 6, 11])
    if count == 20:
        assert mean_step(gone) == pytest.approx(1 / rate, rel=1e-15 if float(rate).is_integer() else 2e-5)


def test_stored_times_are_compared_with_the_step(tmp_path):
    rng = np.random.default_rng(4)
    values = rng.normal(size=400)
    for name, times, accepted in (
        ("even", 0.002 * np.arange(400), True),
        ("jitter", 0.002 * (np.arange(400) + rng.uniform(-0.15, 0.15, 400)), False),
    ):
        one = function(values) | {"abscissa_spacing": 0, "x": times}
        path = written(tmp_path / f"{name}.uff", one)
        if accepted:
            found = read_columns(path, None, step=0.002)
            np.testing.assert_allclose(found.values[:, 0], values, rtol=1e-11)
            continue
        with pytest.raises(FileError, match="resample: true takes the samples at their times"):
            read_columns(path, None, step=0.002)
