"""Modes written as a Universal File, read by pyuff and by dynid."""

import warnings

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.files.read_measured import read_modes
from dynid.files.universal_shapes import universal_shapes

OMEGA, DAMPING = np.array([37.1, 152.3]), np.array([0.012, 0.004])
SHAPES = np.array([[1 + 0.1j, -0.5, 0.25j], [0.3, 0.8 - 0.2j, -1.0]])


@pytest.mark.parametrize("dofs", [["12:x", "12:y", "7"], ["3:x", "w_4", "5:z"]])
def test_modes_are_read_again(tmp_path, dofs):
    path = tmp_path / "modes.uff"
    path.write_bytes(universal_shapes(OMEGA, DAMPING, SHAPES, dofs, "A test"))
    modes = read_modes(path, {}, "")
    assert np.allclose(modes.frequency, OMEGA, rtol=1e-5)
    assert np.allclose(modes.damping, DAMPING, rtol=1e-4)
    read = {str(dof): modes.shape[row] for row, dof in enumerate(modes.dofs)}
    for column, dof in enumerate(dofs):
        name = {"7": "7:z", "w_4": "4:y"}.get(dof, dof)
        assert np.allclose(read[name], SHAPES[:, column], atol=1e-5)


def test_pyuff_reads_nodes_and_values(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    path = tmp_path / "modes.uff"
    path.write_bytes(universal_shapes(OMEGA, DAMPING, SHAPES, ["12:x", "12:y", "7"], "A test"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        first, second = pyuff.UFF(str(path)).read_sets()
    assert first["type"] == 55
    assert list(first["node_nums"]) == [12, 7]
    assert np.allclose(first["r1"], [SHAPES[0, 0], 0], atol=1e-5)
    assert np.allclose(second["r3"], [0, SHAPES[1, 2]], atol=1e-5)
    assert np.isclose(abs(second["eig"]), OMEGA[1], rtol=1e-5)


def test_a_dof_without_a_node_is_refused():
    with pytest.raises(UsageError, match="the DOF tip has no number of a node"):
        universal_shapes(OMEGA, DAMPING, SHAPES[:, :1], ["tip"], "")
    with pytest.raises(UsageError, match="the DOF 3:rz is a rotation"):
        universal_shapes(OMEGA, DAMPING, SHAPES[:, :1], ["3:rz"], "")
