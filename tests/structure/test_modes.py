"""Natural frequencies and damping of small structures."""

import numpy as np
import pytest

from dynid.errors import Singular
from dynid.structure.lumped import Link, lumped
from dynid.structure.modes import modes


def test_uniform_chain_has_its_closed_form_frequencies():
    n, k, m = 12, 3e4, 2.0
    chain = lumped([m] * n, [Link((1,), k)] + [Link((i, i + 1), k) for i in range(1, n)])
    exact = 2 * np.sqrt(k / m) * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * (2 * n + 1)))
    found = modes(*chain.with_joints())
    np.testing.assert_allclose(found.omega, exact, rtol=1e-13)
    np.testing.assert_array_equal(found.damping, 0)
    np.testing.assert_allclose(found.shapes.T @ chain.M @ found.shapes, np.eye(n), atol=1e-13)


def test_free_chain_has_one_rigid_mode_without_damping():
    chain = lumped([1, 2, 3], [Link((1, 2), 1e6, 10), Link((2, 3), 1e6, 10)])
    found = modes(*chain.with_joints())
    assert found.omega[0] == 0.0
    assert found.damping[0] == 0.0
    assert np.all(found.omega[1:] > 100)


def test_proportional_damping_is_exact():
    chain = lumped([1, 2], [Link((1,), 100, 0.2), Link((1, 2), 300, 0.6)])
    found = modes(*chain.with_joints())
    np.testing.assert_allclose(found.damping, 0.002 * found.omega / 2, rtol=1e-12)


def test_suspension_of_five_masses():
    links = [
        Link((1,), 2e4, 20),
        Link((1, 2), 3e4, 30),
        Link((2, 3), 2e4),
        Link((3, 4), 2e4),
        Link((4, 5), 2e4),
    ]
    found = modes(*lumped([2, 2, 1.5, 1, 1], links).with_joints())
    np.testing.assert_allclose(found.omega, [38.05, 94.80, 156.39, 205.42, 244.08], atol=5e-3)


def test_indefinite_stiffness_is_refused():
    with pytest.raises(Singular, match="indefinite"):
        modes(np.eye(2), np.zeros((2, 2)), np.diag([1.0, -1.0]))
