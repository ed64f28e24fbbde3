"""dynid from Python: load, run, write, open; and its files in other hands."""

from pathlib import Path

import numpy as np
import pytest
import xarray

import dynid
from dynid.errors import FileError, SceneError, UsageError
from dynid.store import write_result

ISOLATOR = Path(__file__).parents[1] / "configs" / "isolator.yaml"


@pytest.fixture(scope="module")
def result():
    return dynid.run(dynid.load_scene(ISOLATOR))


def test_a_scene_or_its_path_can_be_run(result):
    assert dynid.run(ISOLATOR).equals(result)
    assert dynid.run(str(ISOLATOR)).equals(result)
    assert result.value("bond_graph/properties/m_s.f/v_in/dc_gain") == 1


def test_values_can_be_overridden_while_loading():
    scene = dynid.load_scene(ISOLATOR, ["parameters.b=100", "analysis.results=[poles]"])
    result = dynid.run(scene)
    assert np.allclose(result["bond_graph/transfer_function/m_s.f/v_in/poles"].data.real, -100 / 24)
    assert "bond_graph/transfer_function/m_s.f/v_in/zeros" not in result


def test_errors_are_those_of_the_package(tmp_path):
    with pytest.raises(FileError, match="no such file"):
        dynid.load_scene(tmp_path / "missing.yaml")
    with pytest.raises(SceneError) as caught:
        dynid.load_scene(ISOLATOR, ["parameters.b=x"])
    assert caught.value.faults[0].message == "no parameter 'x'"
    with pytest.raises(FileError):
        dynid.open_result(ISOLATOR)


def test_a_result_is_read_back_as_it_was_written(result, tmp_path):
    dynid.write_result(result, tmp_path / "r.h5")
    again = dynid.open_result(tmp_path / "r.h5")
    assert again.equals(result)
    assert again.attrs["scene"] == ISOLATOR.read_text()


def test_expectations_are_evaluated_by_one_call(result):
    expected = dynid.load_scene(ISOLATOR).source.data["expect"]
    outcomes = dynid.checks.check_expectations(result, expected)
    assert [outcome.passed for outcome in outcomes] == [True] * len(expected)
    wrong = [{**expected[0], "value": 1e9}]
    assert not dynid.checks.check_expectations(result, wrong)[0].passed


def test_the_same_scene_gives_the_same_bytes_of_data(result):
    again = dynid.run(ISOLATOR)
    assert list(again) == list(result)
    for path, variable in again.items():
        if variable.data.dtype.kind in "bifc":
            assert variable.data.tobytes() == result[path].data.tobytes(), path


def test_xarray_opens_every_group_with_named_coordinates_and_units(result, tmp_path):
    write_result(result, tmp_path / "r.h5")
    tree = xarray.open_datatree(tmp_path / "r.h5", engine="h5netcdf")
    seen = {f"{group.path}/{name}".lstrip("/") for group in tree.subtree for name in group.variables}
    assert set(result) <= seen
    response = tree["bond_graph/frequency_response"].to_dataset()
    assert response["response"].dims == ("omega", "output", "input")
    assert response["omega"].attrs["units"] == "rad/s"
    at_rest = response["response"].sel(output="m_s.f", input="v_in").sel(omega=0, method="nearest")
    assert abs(complex(at_rest) - 1) < 1e-2
    time = tree["bond_graph/time_response"].to_dataset()
    assert time["response"].dims == ("time", "output")
    assert time["time"].attrs["units"] == "s"
    assert np.allclose(np.diff(time["time"]), 1e-3)


def test_every_file_says_what_seed_it_was_made_with():
    isolator = dynid.run(Path(__file__).parents[1] / "configs" / "isolator.yaml")
    noisy = dynid.run(
        dynid.load_scene(
            Path(__file__).parents[1] / "configs" / "suspension_noisy.yaml", ["measurement.simulate.seed=7"]
        )
    )
    assert (isolator.attrs["seed"], noisy.attrs["seed"]) == (0, 7)


def test_a_note_says_that_a_dirac_impulse_is_not_shown(tmp_path):
    scene = tmp_path / "mass.yaml"
    scene.write_text(
        "dynid: 1\nkind: bond-graph\ngraph:\n  nodes: {v: Sf, j: 1, m: {type: I, value: 1}}\n"
        "  bonds: [v -> j -> m]\nanalysis:\n  outputs: [m.e]\n  time: {stop: 1, step: 0.1}\n"
    )
    notes = dynid.run(scene).group_attrs["bond_graph/time_response"]["note"]
    assert "Dirac impulse, which is not shown" in notes


@pytest.mark.parametrize(
    ("outputs", "signal", "named"),
    [
        ("m.e", "{kind: step}", "m.e has"),
        ("m.e", "{kind: step, start: 0.5}", "m.e has"),
        ("m.f, m.e, r.e", "{kind: impulse}", "m.f, m.e, r.e have"),
        ("m.f, r.e, m.p", "{kind: step}", ""),  # only the effort of the mass follows the derivative
        ("m.e, m.f", "{kind: sine, frequency: 3}", ""),  # its derivative does not jump
    ],
)
def test_a_dirac_impulse_is_said_of_the_requested_outputs_that_have_one(tmp_path, outputs, signal, named):
    scene = tmp_path / "mass.yaml"
    scene.write_text(
        "dynid: 1\nkind: bond-graph\ngraph:\n"
        "  nodes: {v: Sf, j: 1, m: {type: I, value: 1}, r: {type: R, value: 2}}\n"
        f"  bonds: [v -> j -> m, j -> r]\nanalysis:\n  outputs: [{outputs}]\n"
        f"  time: {{stop: 1, step: 0.1, input: {signal}}}\n"
    )
    note = dynid.run(scene).group_attrs["bond_graph/time_response"].get("note", "")
    assert ("Dirac impulse, which is not shown" in note) is bool(named)
    assert named in note


def test_names_in_a_scene_are_not_taken_for_seeds(tmp_path):
    scene = tmp_path / "seed.yaml"
    scene.write_text(
        "dynid: 1\nkind: bond-graph\nparameters: {seed: 3}\n"
        "graph:\n  nodes: {v: Se, seed: 1, r: {type: R, value: seed}}\n  bonds: [v -> seed -> r]\n"
        "analysis:\n  outputs: [r.f]\n"
        "  time: {stop: 1, step: 0.1, input: [{kind: step}, {kind: random, seed: 9}]}\n"
    )
    assert dynid.run(scene).attrs["seed"] == 9


def test_a_message_and_its_remedy_are_sentences():
    assert str(UsageError("there is no 'b'", remedy="Name another.")) == "there is no 'b'. Name another."
    hint = UsageError("there is no 'b'; did you mean 'a'?", remedy="List them.")
    assert str(hint) == "there is no 'b'; did you mean 'a'? List them."
