"""Statistics in the file of a study, and what reads them."""

import re

import numpy as np
import pytest
import xarray as xr

from dynid.checks import check_expectations, compare
from dynid.errors import UsageError
from dynid.store import open_stored, read_result
from dynid.study.analysis.sample_statistics import NAMES, statistics
from dynid.study.analysis.table import StudyTable
from tests.study.studies import write

pytestmark = pytest.mark.thorough

COUNT = 50
RNG = np.random.default_rng(11)
COLUMNS = {"parameters.b": RNG.random(COUNT), "estimator.method": ["filter", "auto"] * (COUNT // 2)}
OMEGA = [1.0, 2.5, 10.0]
VALUES = {
    "p/properties/gain": RNG.random(COUNT),
    "p/properties/stable": RNG.random(COUNT) < 0.5,
    "p/properties/order": np.full(COUNT, 2),
    "p/properties/kind": np.array(["d", "c"] * (COUNT // 2)),
    "p/response/response": ("m", ("omega",), {"omega": OMEGA}, RNG.random((COUNT, 3)) + 1j),
    "i/estimate": ("N/m", ("name",), {"name": ["up.k", "low.c"]}, RNG.random((COUNT, 2))),
    "p/poles": ("", ("pole",), {}, [np.arange(1 + row % 3) + 1.0 for row in range(COUNT)]),
}
FAILED = {3: "singular at 1.5", 17: "singular at 2.5", 20: "no such file"}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "s.h5"
    write(path, COLUMNS, VALUES, FAILED, expectations=[RNG.random(COUNT) < 0.5, np.ones(COUNT, bool)])
    return path


def rows(path):
    given = VALUES[path]
    values = np.asarray(given[3] if isinstance(given, tuple) else given)
    values = np.abs(values).astype(float)
    values[list(FAILED)] = np.nan
    return values


@pytest.mark.parametrize(
    "path",
    ["p/properties/gain", "p/properties/stable", "p/properties/order", "p/response/response", "i/estimate"],
)
def test_the_file_has_the_statistics_of_all_its_numbers(file, path):
    result = read_result(file)
    expected = statistics(rows(path))
    for name in NAMES:
        np.testing.assert_array_equal(result[f"study/statistics/{path}/{name}"].data, expected[name])
    assert result.value("study/statistics/p/properties/gain/count") == COUNT - len(FAILED)
    assert "study/statistics/p/properties/kind/mean" not in result
    assert result["study/statistics/p/response/response/p95"].attrs["of"] == "magnitude"


def test_entries_that_only_some_samples_have_count_where_they_are(file):
    result = read_result(file)
    counts = result["study/statistics/p/poles/count"].data
    lengths = np.array([1 + row % 3 for row in range(COUNT) if row not in FAILED])
    np.testing.assert_array_equal(counts, [np.sum(lengths > place) for place in range(3)])
    assert not [path for path in result if path.startswith("study/statistics/p/poles_length")]


def test_statistics_are_the_same_entry_by_entry(file, tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.study.analysis.sample_statistics._BLOCK_VALUES", 1)
    write(tmp_path / "t.h5", COLUMNS, VALUES, FAILED)
    with open_stored(file) as one, open_stored(tmp_path / "t.h5") as other:
        found = {difference.path for difference in compare(one, other, 0, 0)}
    assert found == {"study/expect/0", "study/expect/1"}


def test_xarray_opens_a_study_with_named_coordinates(file):
    with xr.open_dataset(file, group="study/results/p/response", engine="h5netcdf") as dataset:
        np.testing.assert_array_equal(dataset.omega, OMEGA)
        assert dataset.response.dims == ("sample", "omega")
        at = dataset.response.sel(omega=2.5)
        np.testing.assert_array_equal(at[:3], VALUES["p/response/response"][3][:3, 1])
        assert np.isnan(at[3])
        assert dataset.response.attrs["units"] == "m"
    with xr.open_dataset(file, group="study/statistics/p/response/response", engine="h5netcdf") as dataset:
        assert dataset.p95.dims == ("omega",)
        assert dataset["mean"].sel(omega=10.0) == statistics(rows("p/response/response"))["mean"][2]
    tree = xr.open_datatree(file, group="study", engine="h5netcdf")
    with tree:
        assert tree["results/i"].estimate.sel(name="low.c").dims == ("sample",)
        np.testing.assert_array_equal(tree.sample, np.arange(COUNT))
        np.testing.assert_array_equal(tree["samples"]["parameters.b"], COLUMNS["parameters.b"])


def test_expectations_hold_for_statistics(file):
    path = "study/statistics/i/estimate/p95"
    with open_stored(file) as stored:
        outcomes = check_expectations(
            stored,
            [
                {"path": path, "max": 1.0, "min": 0.0},
                {"path": path, "at": {"name": "low.c"}, "max": 0.1},
                {"path": "study/statistics/p/properties/order/std", "value": 0},
            ],
        )
    assert [outcome.passed for outcome in outcomes] == [True, False, True]


def test_keys_and_the_scene_are_no_differences(file, tmp_path):
    write(
        tmp_path / "t.h5",
        COLUMNS,
        VALUES,
        FAILED,
        base="dynid: 1 # changed\n",
        keys=np.ones((COUNT, 8), np.uint8),
    )
    assert {d.path for d in compare(read_result(file), read_result(tmp_path / "t.h5"))} == {
        "study/expect/0",
        "study/expect/1",
    }


# --- as a table ----------------------------------------------------------------------------------------


def test_a_study_is_a_table_of_its_numbers(file):
    with open_stored(file) as stored:
        table = StudyTable(stored)
        assert sorted(table.inputs) == sorted(COLUMNS)
        assert sorted(table.paths) == sorted(VALUES)
        found = {column.name: column for path in ("i/estimate", "p/poles") for column in table.columns(path)}
        assert list(found) == [
            "i/estimate[up.k]",
            "i/estimate[low.c]",
            "p/poles[1]",
            "p/poles[2]",
            "p/poles[3]",
        ]
        np.testing.assert_array_equal(found["i/estimate[low.c]"].values, rows("i/estimate")[:, 1])
        assert found["i/estimate[up.k]"].units == "N/m"


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("p/properties/gain", ("p/properties/gain", ())),
        ("study/results/p/properties/gain", ("p/properties/gain", ())),
        ("i/estimate", ("i/estimate", None)),
        ("i/estimate[low.c]", ("i/estimate", (1,))),
        ("p/response/response[2.5]", ("p/response/response", (1,))),
        ("p/response/response[2.50]", ("p/response/response", (1,))),
        ("p/poles[3]", ("p/poles", (2,))),
    ],
)
def test_entries_go_by_their_labels(file, name, place):
    with open_stored(file) as stored:
        assert StudyTable(stored).find(name) == place


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("p/properties/gian", "did you mean 'p/properties/gain'"),
        ("i/estimate[low.k]", "no name low.k; did you mean 'low.c'"),
        ("i/estimate[up.k,1]", "names 2 entries; the axes of i/estimate are: name"),
        ("p/response/response[3]", "has no omega 3"),
        ("p/properties/kind", "is a text"),
    ],
)
def test_a_wrong_name_is_said(file, name, message):
    with open_stored(file) as stored, pytest.raises(UsageError, match=re.escape(message)):
        StudyTable(stored).find(name)
