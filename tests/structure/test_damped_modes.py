"""Damped modes of sparse structures against all poles of the state matrix, and closed forms."""

import numpy as np
import pytest
from scipy.sparse import csc_array

from dynid.structure.mode_derivatives import lowest_modes
from dynid.structure.model import StructuralModel


@pytest.mark.parametrize("damper", [3e5, 1e7])
def test_damped_modes_of_a_sparse_structure_are_all_there(damper):
    n = 120  # a damper in the middle, which nearly holds it, and poles that do not oscillate
    K = 1e8 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    C = np.zeros((n, n))
    C[n // 2, n // 2] = damper
    whole = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    poles = np.linalg.eigvals(whole)
    poles = poles[poles.imag > 1e-6 * np.abs(poles)]
    model = StructuralModel(*(csc_array(one) for one in (np.eye(n), C, K)))
    found = lowest_modes(model, {}, 6, 90.0, damped=True)
    np.testing.assert_allclose(found.poles, poles[np.argsort(np.abs(poles))][:6], rtol=1e-9)


def test_equal_damped_modes_of_a_sparse_structure_have_independent_shapes():
    n = 80
    one = 1e8 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K = np.kron(np.eye(2), one)
    model = StructuralModel(*(csc_array(part) for part in (np.eye(2 * n), 1e-5 * K, K)))
    found = lowest_modes(model, {}, 5, 90.0, damped=True)
    omega = 2e4 * np.sin(np.repeat([1, 2, 3], 2)[:5] * np.pi / (2 * (n + 1)))
    zeta = 1e-5 * omega / 2
    np.testing.assert_allclose(found.poles, omega * (-zeta + 1j * np.sqrt(1 - zeta**2)), rtol=1e-9)
    np.testing.assert_allclose(found.shapes.T @ found.shapes, np.eye(5), atol=1e-6)
