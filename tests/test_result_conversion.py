"""Results in the hands of other libraries."""

import sys
from pathlib import Path

import numpy as np
import pytest
import xarray

import dynid
from dynid.errors import UsageError
from dynid.result import Result
from dynid.store import write_result

CONFIGS = Path(__file__).parents[1] / "configs"


@pytest.fixture(scope="module")
def isolator():
    return dynid.run(CONFIGS / "isolator.yaml")


def test_a_group_is_what_xarray_reads_from_the_file(isolator, tmp_path):
    write_result(isolator, tmp_path / "r.h5")
    group = "bond_graph/frequency_response"
    mine = isolator.to_xarray(group)
    with xarray.open_dataset(tmp_path / "r.h5", group=group, engine="h5netcdf") as theirs:
        assert set(mine.coords) == set(theirs.coords) >= {"omega", "output", "input"}
        assert np.array_equal(mine["response"], theirs["response"])
        assert mine["omega"].attrs["units"] == theirs["omega"].attrs["units"] == "rad/s"
    assert mine["response"].sel(output="m_s.f", input="v_in").dims == ("omega",)


def test_coordinates_come_from_the_groups_above(isolator):
    group = next(path.rpartition("/")[0] for path in isolator if path.endswith("dc_gain"))
    assert isolator.to_xarray(group)["dc_gain"].item() == 1


def test_a_group_that_is_not_there_is_named(isolator):
    with pytest.raises(UsageError, match=r"did you mean 'bond_graph/frequency_response'\?"):
        isolator.to_xarray("bond_graph/frequency_respnse")


def test_a_missing_xarray_is_an_error_that_names_the_extra(isolator, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)  # as if it were not installed
    with pytest.raises(UsageError, match=r"xarray, which is not installed.*dynid\[xarray\]"):
        isolator.to_xarray("bond_graph/frequency_response")


def test_coordinates_are_those_of_the_nearest_group_above_that_fit():
    result = Result("bond-graph", "Made")
    result.add_axis("a/time", [0.0, 0.5, 1.0], "s")
    result.add("a/b/x", [1.0, 2.0, 3.0], ("time",), "m")
    result.add("a/c/y", [7.0, 8.0], ("time",))  # another length
    result.add("z", [1.0], ("time",))  # and nothing above
    found = result.to_xarray("a/b")
    assert found["time"].values.tolist() == [0.0, 0.5, 1.0]
    assert (found["time"].attrs["units"], found["x"].attrs["units"]) == ("s", "m")
    assert "time" not in result.to_xarray("a/c").coords
    assert "time" not in result.to_xarray("").coords
    assert repr(result) == "<Result of bond-graph 'Made': 4 arrays>"
