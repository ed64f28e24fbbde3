"""`dynid export`: what is read back is what was written."""

import csv
import sys
from pathlib import Path

import numpy as np
import pyarrow
import pytest
from pyarrow import parquet

from dynid.result import Result
from dynid.store import read_result, write_result
from tests.study.studies import write

RNG = np.random.default_rng(2)
COUNT = 30
FAILED = {4: 'singular at "0.5"\nrad/s, twice', 9: None}
VALUES = {
    "p/gain": RNG.random(COUNT) * 10.0 ** RNG.integers(-300, 300, COUNT),
    "p/stable": RNG.random(COUNT) < 0.5,
    "p/order": RNG.integers(0, 9, COUNT),
    "p/kind": np.array(["d, or so", "c"] * (COUNT // 2)),
    "p/limit": np.where(RNG.random(COUNT) < 0.3, np.inf, 0.1),
    "p/response": (
        "m",
        ("omega",),
        {"omega": [0.5, 2.0]},
        RNG.random((COUNT, 2)) + 1j * RNG.random((COUNT, 2)),
    ),
    "p/estimate": ("N/m", ("name",), {"name": ["up.k", "low.c"]}, RNG.random((COUNT, 2))),
}
COLUMNS = {"parameters.b": RNG.random(COUNT), "estimator.method": ["filter", "auto"] * (COUNT // 2)}


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "s.h5", COLUMNS, VALUES, FAILED, [VALUES["p/stable"]], complete=False)
    return tmp_path / "s.h5"


def read_csv(path):
    """Return the columns of a CSV file as texts."""
    with Path(path).open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    return {name: [row[place] for row in rows] for place, name in enumerate(header)}


def test_a_study_is_one_row_a_sample(dynid, study, monkeypatch):
    monkeypatch.setattr("dynid.study.analysis.table._EXPORTED", 100)  # several batches
    code, out, err = dynid("export", study, "--csv")
    assert (code, out, err) == (0, "wrote s.csv\n", "")
    found = read_csv("s.csv")
    assert [int(number) for number in found["sample"]] == list(range(COUNT))
    assert list(found)[:2] == ["sample", "status"]
    assert list(found)[-1] == "error"
    assert found["status"][:10] == ["done"] * 4 + ["failed"] + ["done"] * 4 + ["pending"]
    assert found["error"][4] == FAILED[4]
    assert [float(text) for text in found["parameters.b"]] == list(COLUMNS["parameters.b"])
    assert found["estimator.method"] == COLUMNS["estimator.method"]
    response = VALUES["p/response"][3]
    for row in range(COUNT):
        cells = {name: column[row] for name, column in found.items()}
        if row in FAILED:
            empty = {name for name, cell in cells.items() if not cell}
            assert {"p/gain", "p/stable", "p/order", "p/kind", "expect[1]", "p/response[2].im [m]"} <= empty
            continue
        assert float(cells["p/gain"]) == VALUES["p/gain"][row]
        assert float(cells["p/limit"]) == VALUES["p/limit"][row]
        assert cells["p/order"] == str(VALUES["p/order"][row])
        assert cells["p/stable"] == cells["expect[1]"] == ("true" if VALUES["p/stable"][row] else "false")
        assert cells["p/kind"] == VALUES["p/kind"][row]
        assert float(cells["p/response[0.5].re [m]"]) == response[row, 0].real
        assert float(cells["p/response[2].im [m]"]) == response[row, 1].imag
        assert float(cells["p/estimate[low.c] [N/m]"]) == VALUES["p/estimate"][3][row, 1]


def test_parquet_holds_types_units_and_nulls(dynid, study):
    code, _, _ = dynid("export", study, "--parquet", "-o", "t.parquet")
    assert code == 0
    table = parquet.read_table("t.parquet")
    types = {field.name: str(field.type) for field in table.schema}
    assert types["p/order"] == types["sample"] == "int64"
    assert types["p/stable"] == types["expect[1]"] == "bool"
    assert types["p/gain"] == types["p/response[2].im"] == "double"
    assert types["p/kind"] == "string"
    assert table.schema.field("p/estimate[up.k]").metadata == {b"units": b"N/m"}
    assert table.schema.metadata[b"title"] == b"Made up"
    found = table.to_pydict()
    for path in ("p/gain", "p/stable", "p/order", "p/limit"):
        expected = [None if row in FAILED else VALUES[path][row] for row in range(COUNT)]
        assert found[path] == expected


def test_a_study_in_long_form(dynid, study):
    code, out, _ = dynid("export", study, "--csv", "--long", "-o", "tables")
    assert code == 0
    assert "wrote tables/study.results.p-sample-omega.csv" in out
    found = read_csv("tables/study.results.p-sample-omega.csv")
    assert list(found) == ["sample", "omega", "response.re [m]", "response.im [m]"]
    assert found["sample"][:4] == ["0", "0", "1", "1"]
    assert found["omega"][:2] == ["0.5", "2.0"]
    assert float(found["response.im [m]"][3]) == VALUES["p/response"][3][1, 1].imag
    code, _, _ = dynid("export", study, "--csv", "--table", "study.results.p-sample-name", "-o", "one.csv")
    assert code == 0
    assert read_csv("one.csv")["name"][:2] == ["up.k", "low.c"]


@pytest.fixture
def result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = Result("bond-graph", "R")
    made.add_axis("f/omega", [1.0, 2.0], "rad/s")
    made.add_axis("f/output", ["a.f", "b.f"])
    made.add("f/response", np.arange(8.0).reshape(2, 2, 2) * (1 - 1j), ("omega", "output", "input"), "m")
    made.add("f/phase", [0.1, np.nan], ("omega",))
    made.add("f/order", 3)
    made.add("m/mass", np.eye(2), ("dof", "dof"), "kg")
    steps = [("series", 1), ("merge", 2)]
    made.add("r/steps", np.array(steps, [("rule", object), ("place", int)]), ("step",))
    made.add("seed", 1)
    write_result(made, tmp_path / "r.h5")
    return tmp_path / "r.h5"


def test_any_result_is_a_table_for_each_group_and_its_axes(dynid, result, tmp_path):
    code, out, _ = dynid("export", result, "--csv")
    assert code == 0
    written = {path.name for path in (tmp_path / "r").iterdir()}
    assert written == {"root.csv", "f.csv", "f-omega.csv", "f-omega-output-input.csv", "m.csv", "r.csv"}
    assert len(out.splitlines()) == len(written)
    response = read_csv("r/f-omega-output-input.csv")
    assert list(response) == ["omega [rad/s]", "output", "input", "response.re [m]", "response.im [m]"]
    assert [row[:3] for row in zip(*response.values(), strict=True)][1:3] == [
        ("1.0", "a.f", "2"),
        ("1.0", "b.f", "1"),
    ]
    assert [float(text) for text in response["response.im [m]"]] == list(-np.arange(8.0))
    assert read_csv("r/f-omega.csv") == {"omega [rad/s]": ["1.0", "2.0"], "phase": ["0.1", ""]}
    assert read_csv("r/m.csv")["mass [kg]"] == ["1.0", "0.0", "0.0", "1.0"]
    assert list(read_csv("r/m.csv")) == ["dof", "dof_2", "mass [kg]"]
    assert read_csv("r/r.csv") == {
        "step": ["1", "2"],
        "steps.rule": ["series", "merge"],
        "steps.place": ["1", "2"],
    }
    assert read_csv("r/f.csv") == {"order": ["3"]}


def test_an_axis_of_another_length_labels_nothing(dynid, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = Result("bond-graph")
    result.add_axis("a/time", [0.0, 0.5, 1.0], "s")
    result.add("a/x", [1.0, 2.0, 3.0], ("time",))
    result.add("a/b/y", [7.0, 8.0], ("time",))
    write_result(result, "r.h5")
    assert dynid("export", "r.h5", "--csv")[0] == 0
    assert read_csv("r/a.csv") == {"time [s]": ["0.0", "0.5", "1.0"], "x": ["1.0", "2.0", "3.0"]}
    assert read_csv("r/a.b.csv") == {"time": ["1", "2"], "y": ["7.0", "8.0"]}


def test_rows_of_long_arrays_come_in_batches(dynid, result, monkeypatch):
    dynid("export", result, "--parquet", "-o", "whole")
    monkeypatch.setattr("dynid.store.tables._VALUES", 1)
    dynid("export", result, "--parquet", "-o", "parts")
    name = "f-omega-output-input.parquet"
    assert parquet.read_table(f"whole/{name}").equals(parquet.read_table(f"parts/{name}"))


def test_what_a_run_writes_can_be_exported(dynid, folder):
    dynid("run", folder / "small.yaml", "-q")
    code, _, _ = dynid("export", "small.h5", "--csv", "--table", "bond_graph/time_response-time-output")
    assert code == 0
    found = read_csv("bond_graph.time_response-time-output.csv")
    result = read_result("small.h5")
    np.testing.assert_array_equal(
        [float(text) for text in found["response"]], result["bond_graph/time_response/response"].data.ravel()
    )


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        ([], 2, "Pass --csv, --parquet"),
        (["--csv", "-o", "r.h5", "--table", "m"], 2, "would overwrite the result"),
        (["--csv", "--table", "n"], 2, "no table 'n'"),
        (["--csv", "--table", "f"], 0, ""),
        (["--csv", "-o", "none/r.csv", "--table", "m"], 4, "there is no folder none"),
        (["--csv", "-o", "r.h5"], 4, "cannot be made a folder"),
    ],
)
def test_a_wrong_export_is_said(dynid, result, args, code, message):
    found, _, err = dynid("export", result, *args)
    assert found == code
    assert message in err


def test_a_row_that_no_tool_reads_is_refused(dynid, tmp_path):
    write(tmp_path / "s.h5", {"a.x": [1.0]}, {"p/y": ("", ("t",), {}, np.zeros((1, 20_000)))})
    code, _, err = dynid("export", tmp_path / "s.h5", "--csv", "-o", tmp_path / "s.csv")
    assert code == 2
    assert "20,004 columns" in err
    assert "--long" in err
    assert not (tmp_path / "s.csv").exists()


def test_without_pyarrow_the_remedy_is_said(dynid, study, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    code, _, err = dynid("export", study, "--parquet")
    assert code == 2
    assert "pip install 'dynid[formats]'" in err


def test_a_failing_disk_leaves_the_old_file(dynid, study, monkeypatch):
    dynid("export", study, "--csv")
    before = Path("s.csv").read_text()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("dynid.store.tables._words", full)
    code, _, err = dynid("export", study, "--csv")
    assert code == 4
    assert "No space left" in err
    assert Path("s.csv").read_text() == before


def test_what_the_format_cannot_hold_leaves_the_old_file(dynid, study, monkeypatch):
    dynid("export", study, "--parquet")
    before = Path("s.parquet").read_bytes()

    def refuse(*_):
        raise pyarrow.ArrowInvalid("a column is too long")

    monkeypatch.setattr(parquet.ParquetWriter, "write_batch", refuse)
    code, _, err = dynid("export", study, "--parquet")
    assert (code, err) == (4, "s.parquet cannot be written: a column is too long\n")
    assert Path("s.parquet").read_bytes() == before


def test_a_group_with_strange_signs_is_a_file_of_the_folder(dynid, folder):
    result = Result("bond-graph", "x")
    for group in ("a/..\\..\\up", "a/b:c", "a/b*c"):
        result.add(f"{group}/value", np.arange(3.0), ("n",))
    write_result(result, folder / "r.h5")
    code, out, _ = dynid("export", "r.h5", "--csv", "-o", "tables")
    assert code == 0
    names = sorted(path.name for path in (folder / "tables").iterdir())
    assert names == ["a..._.._up.csv", "a.b_c.csv", "a.b_c_2.csv"]
    assert all(str(Path("tables") / name) in out for name in names)
