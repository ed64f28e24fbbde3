"""Modes of published and exported matrices."""

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.io import mmread

from dynid.structure.modes import modes

FE = Path(__file__).parents[3] / "shared/data/fe"
needs_data = pytest.mark.skipif(not FE.is_dir(), reason="the shared finite-element matrices are not here")


@needs_data
@pytest.mark.parametrize(
    ("number", "massless", "backend"),
    [
        *((*pair, backend) for pair in (("01", 24), ("03", 40)) for backend in ("dense", "splu")),
        ("08", 0, "splu"),
        pytest.param("08", 0, "dense", marks=pytest.mark.slow),  # the others are dense by default, too
    ],
)
def test_harwell_boeing_pairs(number, massless, backend):
    known = json.loads((FE / "eigenvalues.json").read_text())[f"bcsstk{number}/bcsstm{number}"]
    K, M = (sp.csc_array(mmread(FE / f"bcsst{letter}{number}.mtx")) for letter in "km")
    found = modes(M, 0 * K, K, 12, backend=backend)
    np.testing.assert_allclose(found.omega**2, known["lowest_lambda"], rtol=5e-12)
    assert (found.massless, found.rigid) == (massless, 0)
    assert found.residuals.max() < 1e-11
    assert found.counted > found.omega[-1]


@needs_data
@pytest.mark.parametrize("backend", ["dense", "splu"])
def test_a_free_block_has_six_rigid_bodies(backend):
    def triplets(name):
        row, column, value = np.loadtxt(FE / name, unpack=True)
        return sp.csc_array((value, (row.astype(int) - 1, column.astype(int) - 1)))

    K, M = triplets("blockC3D8_STIF1.mtx"), triplets("blockC3D8_MASS1.mtx")
    found = modes(M, 0 * K, K, 12, backend=backend)
    assert found.rigid == 6
    np.testing.assert_array_equal(found.omega[:6], 0)
    # The block is square: bending and its repetition come in pairs.
    np.testing.assert_allclose(found.omega[[6, 9]], found.omega[[7, 10]], rtol=1e-12)
    np.testing.assert_allclose(found.omega[6] ** 2, 7600528.9221593, rtol=1e-11)
    assert modes(M, 0 * K, K, below=found.omega[9] * 0.999, backend=backend).omega.shape == (9,)
