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


@pytest.fixture(scope="module")
def suspension():
    return dynid.run(CONFIGS / "suspension_noisy.yaml")


def test_a_frequency_response_is_a_data_frame_by_frequency(isolator):
    table = isolator.to_pandas("frequency_response")
    assert table.index.name == "frequency [Hz]"  # as the scene is written
    assert list(table.columns) == ["response[m_s.f,v_in]"]
    assert table.attrs == {"title": "Passive tuned isolator", "units": {"response[m_s.f,v_in]": "1"}}
    omega = isolator["bond_graph/frequency_response/omega"].data
    assert np.allclose(table.index, omega / (2 * np.pi), rtol=1e-15, atol=0)
    response = isolator["bond_graph/frequency_response/response"].data[:, 0, 0]
    assert np.array_equal(table["response[m_s.f,v_in]"], response)


def test_estimates_have_their_bars(suspension):
    table = suspension.to_pandas("identification/parameters")
    assert list(table.columns[:4]) == ["estimate", "standard_error", "low", "high"]
    assert list(table.index) == ["upper.k", "upper.c", "lower.k", "lower.c"]
    error, middle = table["standard_error"], table["estimate"]
    assert np.allclose(np.log(table["high"] / middle), 1.959963984540054 * error / middle, rtol=1e-12)
    assert np.allclose(table["low"] * table["high"], middle**2, rtol=1e-12)
    assert list(suspension.to_pandas("identification/parameters/standard_error")) == ["standard_error"]
    assert table.loc["upper.k", "unit"] == "N/m"


def test_estimates_that_are_rejected_have_no_bars(suspension):
    result = suspension
    for flag in ("converged", "optimum"):
        result = result.without(f"identification/diagnostics/{flag}")
        result.add(f"identification/diagnostics/{flag}", False)
    assert not {"low", "high"} & set(result.to_pandas("parameters"))


def test_histories_are_data_frames_by_time(suspension):
    table = suspension.to_pandas("history")
    assert table.index.name == "time [s]"
    mine = suspension["identification/history/standard_deviation"].data[:, 1]
    assert np.array_equal(table["standard_deviation[upper.c]"], mine)
    record = suspension.to_pandas("identification/measurement")
    assert {"measured[2.velocity]", "predicted[3.velocity]", "input[5]"} == set(record) - {
        "measured[3.velocity]",
        "predicted[2.velocity]",
    }
    assert record.attrs["units"]["measured[2.velocity]"] == "m/s"


def test_single_numbers_are_rows_and_other_axes_have_tables(suspension):
    verdict = suspension.to_pandas("identification/diagnostics")
    assert verdict.loc["converged", "value"] is True
    assert list(verdict.columns) == ["value", "unit"]
    channels = suspension.to_pandas("identification/diagnostics/channel")
    assert list(channels.index) == ["2.velocity", "3.velocity"]
    assert "residual_rms" in channels
    assert "channel" not in channels
    lags = suspension.to_pandas("identification/diagnostics/autocorrelation")
    assert (lags.index.name, lags.shape) == ("lag", (40, 2))


def test_records_with_fields_have_a_column_each(isolator):
    steps = isolator.to_pandas("bond_graph/reduction/steps")
    assert steps.iloc[0]["rule"] == isolator["bond_graph/reduction/steps"].data["rule"][0]


def test_tables_that_are_not_there_or_several_are_named(isolator):
    with pytest.raises(UsageError, match=r"no table 'frequency_respnse'; did you mean 'bond_graph/freq"):
        isolator.to_pandas("frequency_respnse")
    with pytest.raises(UsageError, match=r"did you mean 'bond_graph/properties/m_s.f/v_in/dc_gain'"):
        isolator.to_pandas("properties/dc_gain")
    with pytest.raises(UsageError, match=r"has several tables.*v_in/zero, .*v_in/pole"):
        isolator.to_pandas("bond_graph/transfer_function/m_s.f/v_in")
    with pytest.raises(UsageError, match=r"several tables are called 'response'.*time_response/response"):
        isolator.to_pandas("response")


def test_a_missing_pandas_is_an_error_that_names_the_extra(isolator, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)  # as if it were not installed
    with pytest.raises(UsageError, match=r"pandas, which is not installed.*dynid\[pandas\]"):
        isolator.to_pandas("bond_graph/frequency_response")


def test_a_study_is_a_data_frame_by_sample(tmp_path):
    from dynid.cli import cli

    study = Path(__file__).parents[1] / "docs/examples/project/studies/tolerances.yaml"
    file = str(tmp_path / "study.h5")
    words = ["study", str(study), "-q", "--executor", "serial", "-o", file, "--set", "sampling.samples=4"]
    cli.main(words, standalone_mode=False)
    result = dynid.open_result(file)
    table = result.to_pandas("study")
    assert (table.index.name, len(table)) == ("sample", 4)
    assert np.array_equal(table["parameters.b"], result["study/samples/parameters.b"].data)
    assert table["bond_graph/properties/m_s.f/v_in/stable"].dtype == bool
    assert table["bond_graph/properties/m_s.f/v_in/order"].tolist() == [2] * 4
    assert table.attrs["units"]["bond_graph/properties/m_s.f/v_in/natural_frequency[1]"] == "rad/s"
    samples = result.to_pandas("study/samples")
    assert np.array_equal(samples["parameters.b"], table["parameters.b"])


def test_a_group_with_modes_has_a_row_for_each():
    result = Result("identification")
    result.add_axis("structure/modes/mode", [1, 2])
    result.add_axis("structure/modes/dof", ["a", "b", "c"])
    result.add("structure/modes/shape", np.ones((3, 2)), ("dof", "mode"))
    result.add("structure/modes/damping", [0.01, 0.02], ("mode",))
    result.add("structure/modes/omega", [3.0, 4.0], ("mode",), "rad/s")
    table = result.to_pandas("modes")
    assert list(table.columns) == ["omega", "damping"]
    assert (list(table.index), list(table["omega"])) == ([1, 2], [3.0, 4.0])
    result.add_axis("structure/node", ["x"])
    with pytest.raises(UsageError, match="Name one: structure/modes"):
        result.to_pandas("structure")


def test_a_reduction_is_the_table_of_its_frequencies():
    result = dynid.run(dynid.load_scene(CONFIGS / "beam_reduction.yaml"))
    method = str(result["reduction/method"].data[0])
    table = result.to_pandas(f"reduction/{method}")
    assert list(table["frequencies"]) == list(result[f"reduction/{method}/frequencies"].data)
    assert {"frequency_error", "reference"} <= set(table.columns)
