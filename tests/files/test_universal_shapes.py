"""Mode shapes in Universal Files, written by pyuff and read back."""

import cmath
import math

import numpy as np
import pytest

from dynid.errors import FileError
from dynid.files.read_measured import read_modes
from dynid.files.table import DataFile
from dynid.files.universal_geometry import read_shapes
from tests.files.universal_files import complex_mode, mode, units, written


def refusal(path):
    with pytest.raises(FileError) as caught:
        read_shapes(DataFile(path, "measurement.modes"))
    return str(caught.value)


def test_normal_modes_by_node_and_direction(tmp_path):
    path = written(
        tmp_path / "x.unv",
        mode(12.5, [3, 20], [0.0, 0.0], [1.0, -0.5], [0.25, 2.0], damping=0.02),
        mode(3.0, [3, 20], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0]),
    )
    low, high = read_shapes(DataFile(path))
    assert (low.frequency, low.damping) == (pytest.approx(6 * math.pi, rel=1e-15), None)
    assert (high.frequency, high.damping) == (pytest.approx(25 * math.pi, rel=1e-15), 0.02)
    assert high.shape == {(3, "y"): 1.0, (3, "z"): 0.25, (20, "y"): -0.5, (20, "z"): 2.0}
    assert low.shape == {(3, "y"): 1.0, (3, "z"): 1.0, (20, "y"): 0.0, (20, "z"): 1.0}


def test_rotations_are_in_radians_where_lengths_are_not_metres(tmp_path):
    columns = [[0.0], [0.0], [5.0], [0.0], [0.25], [0.0]]
    path = written(tmp_path / "x.unv", units(1000.0, 1.0), mode(1.0, [4], *columns))
    assert read_shapes(DataFile(path))[0].shape == {(4, "z"): 0.005, (4, "ry"): 0.25}


def test_complex_modes_have_their_eigenvalue(tmp_path):
    omega, zeta = 2 * math.pi * 7, 0.03
    pole = omega * complex(-zeta, math.sqrt(1 - zeta**2))
    turned = cmath.exp(0.4j)
    values = [turned * 1.0, turned * complex(-0.5, 0.01)]
    path = written(tmp_path / "x.unv", complex_mode(pole, [1, 2], [0j, 0j], [0j, 0j], values))
    (found,) = read_shapes(DataFile(path))
    assert found.frequency == pytest.approx(omega, rel=1e-5)
    assert found.damping == pytest.approx(zeta, rel=1e-4)
    assert found.shape[2, "z"] / found.shape[1, "z"] == pytest.approx(complex(-0.5, 0.01), rel=1e-5)


def analysis(**changes):
    """Return a data set 2414 of one mode at two nodes."""
    return {
        "type": 2414,
        "analysis_dataset_label": 1,
        "analysis_dataset_name": "mode",
        "dataset_location": 1,
        **{f"id{k}": "NONE" for k in range(1, 6)},
        "model_type": 1,
        "analysis_type": 2,
        "data_characteristic": 3,
        "result_type": 8,
        "data_type": 2,
        "number_of_data_values_for_the_data_component": 6,
        "record12_field2": 9.5,
        "record12_field5": 0.01,
        "node_nums": np.array([5, 6]),
        "data_at_node": [np.array([0, 0, 1.5, 0, 0.5, 0]), np.array([0, 0, -1.0, 0, 0, 0])],
    } | changes


def test_analysis_data_2414(tmp_path):
    path = written(tmp_path / "x.unv", analysis())
    (found,) = read_shapes(DataFile(path))
    assert found.frequency == pytest.approx(2 * math.pi * 9.5, rel=1e-15)
    assert found.damping == 0.01
    assert found.shape == {(5, "z"): 1.5, (5, "ry"): 0.5, (6, "z"): -1.0}


def test_a_modal_survey_is_a_table_of_modes(tmp_path):
    path = written(
        tmp_path / "x.unv",
        mode(3.0, [3, 20], [0.0, 0.0], [1.0, -0.5], [0.0, 0.0], damping=0.02),
        mode(4.0, [20], [0.0], [2.0], [0.0]),
    )
    found = read_modes(path, {}, "measurement.modes")
    assert found.dofs == ["3:y", "20:y"]
    assert found.unit == "rad/s"
    np.testing.assert_allclose(found.frequency, [6 * math.pi, 8 * math.pi], rtol=1e-15)
    np.testing.assert_array_equal(found.shape, [[1.0, np.nan], [-0.5, 2.0]])
    np.testing.assert_array_equal(found.damping, [0.02, np.nan])
    with pytest.raises(FileError) as caught:
        read_modes(path, {"frequency": "f"}, "measurement.modes")
    named = str(caught.value)
    assert "has mode shapes, no named quantities" in named


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (mode(0.0, [1], [1.0], [0.0], [0.0]), "has the frequency 0 Hz"),
        (mode(1.0, [1], [1.0], [0.0], [0.0], damping=2.0), "has the damping ratio 2. A ratio is from 0 to 1"),
        (mode(1.0, [1, 1], [1.0, 1.0], [0.0, 0.0], [0.0, 0.0]), "has node 1 twice"),
        (mode(1.0, [1], [0.0], [0.0], [0.0]), "that are zero"),
        (mode(1.0, [1], [math.inf], [0.0], [0.0]), "at node 1 is not finite"),
        (mode(1.0, [1], [1.0], [0.0], [0.0]) | {"spec_data_type": 2}, "holds no mode shapes"),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path, one, said):
    assert said in refusal(written(tmp_path / "x.unv", one))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"r2": np.array([0.0])},
            "a mode shape has fewer values than nodes. It is damaged.",
        ),
        (
            {"number_of_data_values_for_the_data_component": 2},
            "a mode shape has 2 values a node; 3 or 6 are read",
        ),
        ({"data_at_node": [np.zeros(6)]}, "a mode shape has fewer values than nodes. It is damaged."),
        ({"data_at_node": [np.ones(6), np.ones(5)]}, "the shape at node 6 has 5 values. It is damaged."),
        ({"data_type": 5}, "the shape at node 5 has 6 values. It is damaged."),
    ],
)
def test_a_shape_whose_values_are_not_those_of_its_nodes_is_refused(tmp_path, monkeypatch, changes, said):
    """Such as a reader may return of a damaged file."""
    uff = pytest.importorskip("pyuff", reason="pyuff is an extra").UFF
    one = mode(1.0, [1, 2], [1.0, 2.0], [0.0, 0.0], [0.0, 0.0]) if "r2" in changes else analysis()
    path = written(tmp_path / "x.unv", one)
    read = uff.read_sets
    monkeypatch.setattr(uff, "read_sets", lambda *at, **how: read(*at, **how) | changes)
    assert said in refusal(path)
