"""Where the scene of a study says Hz, its tables, statistics and data frames are in Hz; files in rad/s."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid.cli import main
from dynid.result import Variable
from dynid.store.reader import in_unit, is_frequency
from dynid.units import FrequencyUnit

pytestmark = pytest.mark.thorough

SCENE = """dynid: 1
kind: bond-graph
graph:
  nodes: {T: Se, x: 1, J: {type: I, value: 2, domain: rotational}, k: {type: C, value: 0.5},
          b: {type: R, value: 0.1}}
  bonds: [T -> x, x -> J, x -> k, x -> b]
analysis: {outputs: [J.f], frequency: {start: 0.01, stop: 10, points: 3, unit: UNIT}}
"""
STUDY = """dynid: 1
kind: study
scene: one.yaml
vary: {graph.nodes.J.value: {values: [1, 3]}}
collect: [bond_graph/properties, bond_graph/frequency_response/response]
"""
NATURAL = "bond_graph/properties/J.f/T/natural_frequency"


@pytest.fixture(params=["Hz", "rad/s"])
def unit(request, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "one.yaml").write_text(SCENE.replace("UNIT", request.param))
    (tmp_path / "s.yaml").write_text(STUDY)
    for command in (["study", "s.yaml", "--executor", "serial"], ["export", "s.h5", "--csv", "-o", "s.csv"]):
        with pytest.raises(SystemExit) as left:
            main([*command, "-q"] if command[0] == "study" else command)
        assert left.value.code == 0
    return request.param


def test_a_study_is_shown_in_the_unit_of_its_scene_and_stored_in_radians(unit, capsys):
    exact = np.sqrt([2.0, 2 / 3])  # 1/sqrt(J C), rad/s
    result = dynid.open_result("s.h5")
    np.testing.assert_allclose(result[f"study/results/{NATURAL}"].data[:, 0], exact, rtol=1e-12)
    assert result[f"study/results/{NATURAL}"].units == "rad/s"
    assert result[f"study/statistics/{NATURAL}/max"].units == "rad/s"
    shown = exact / (2 * math.pi if unit == "Hz" else 1)
    with Path("s.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    np.testing.assert_allclose([float(row[f"{NATURAL}[1] [{unit}]"]) for row in rows], shown, rtol=1e-12)
    frame = result.to_pandas("study")
    np.testing.assert_allclose(frame[f"{NATURAL}[1]"], shown, rtol=1e-12)
    assert frame.attrs["units"][f"{NATURAL}[1]"] == unit
    assert "bond_graph/frequency_response/response[0.01,J.f,T].re" in frame.columns  # as in the scene
    with pytest.raises(SystemExit):
        main(["show", "s.h5"])
    (line,) = [line for line in capsys.readouterr().out.splitlines() if "natural_frequency" in line]
    assert f"[{unit}]" in line.split()
    assert f"{shown.max():.4g}" in line


def test_a_data_frame_of_a_run_is_in_the_unit_of_its_scene(unit):
    frame = dynid.run("one.yaml").to_pandas("bond_graph/frequency_response")
    assert frame.index.name == ("frequency [Hz]" if unit == "Hz" else "omega [rad/s]")
    np.testing.assert_allclose(frame.index, np.geomspace(0.01, 10, 3), rtol=1e-14)


@pytest.mark.parametrize(
    ("path", "units", "answer"),
    [
        ("structure/modes/omega", "rad/s", True),
        ("identification/derived/modes/frequency/low", "rad/s", True),
        ("bond_graph/time_response/response", "rad/s", False),  # an angular velocity
        ("bond_graph/operating_point/value", "rad/s", False),
        ("bond_graph/transfer_function/y/u/pole_error_bound", "rad/s", False),  # poles stay in rad/s
        ("structure/modes/omega", "1/s", False),
    ],
)
def test_angular_velocities_are_no_frequencies(path, units, answer):
    assert is_frequency(path, Variable(("mode",), np.ones(2), units)) is answer


def test_an_array_in_another_unit_is_read_in_pieces():
    omega = Variable(("sample", "mode"), np.arange(12.0).reshape(4, 3), "rad/s")
    shown = in_unit("modal/frequency", omega, FrequencyUnit("Hz", "f", 1 / (2 * math.pi)))
    hertz = omega.data / (2 * math.pi)
    assert shown.shape == (4, 3)
    np.testing.assert_allclose(shown.data, hertz, rtol=1e-15)
    np.testing.assert_allclose(np.concatenate([block for _, block in shown.blocks()]), hertz, rtol=1e-15)
    np.testing.assert_allclose(shown.rows(1, 3), hertz[1:3], rtol=1e-15)
    np.testing.assert_allclose(shown.entries(1, 3), hertz[:, 1:3], rtol=1e-15)
