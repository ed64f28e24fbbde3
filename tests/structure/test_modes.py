"""Natural frequencies and damping of small structures."""

import mpmath
import numpy as np
import pytest

from dynid.errors import NumericalError, Singular, UsageError
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


def test_stiff_parts_leave_the_digits_of_soft_ones():
    # A link of 1e13 N/m beside springs of 1 N/m: the two masses it joins move as one.
    chain = lumped([1, 1, 1], [Link((1,), 1.0), Link((1, 2), 1e13), Link((2, 3), 1.0)])
    exact = [1 - np.sqrt(0.5), 1 + np.sqrt(0.5)]  # of masses 2 and 1
    found = modes(*chain.with_joints())
    np.testing.assert_allclose(found.omega[:2] ** 2, exact, rtol=2e-3)  # the stiffness 1 + 1e13 has no more
    assert found.rigid == 0


def test_massless_dofs_are_condensed_and_counted():
    K = np.array([[3.0, -2, 0], [-2, 5, -3], [0, -3, 3]])
    found = modes(np.diag([2.0, 0, 1]), np.zeros((3, 3)), K)
    # Springs of 2 and 3 N/m in series are one of 1.2 N/m.
    exact = np.linalg.eigvals(np.diag([0.5, 1]) @ np.array([[2.2, -1.2], [-1.2, 1.2]]))
    np.testing.assert_allclose(found.omega**2, np.sort(exact.real), rtol=1e-14)
    np.testing.assert_allclose(K[1] @ found.shapes, 0, atol=1e-14)
    assert (found.massless, found.rigid, found.counted) == (1, 0, np.inf)


def test_directions_without_mass_need_not_be_dofs():
    M = np.array([[1.0, 1], [1, 1]])
    found = modes(M, np.zeros((2, 2)), np.array([[2.0, -1], [-1, 2]]))
    np.testing.assert_allclose(found.omega, [np.sqrt(0.5)], rtol=1e-14)
    assert found.massless == 1
    with pytest.raises(UsageError, match="2 modes are asked for, but the structure has 1 "):
        modes(M, np.zeros((2, 2)), np.eye(2), 2)


@pytest.mark.parametrize(
    ("mass", "error", "message"),
    [
        ([[1.0, 0], [0, -1]], UsageError, "DOF 2 has a negative mass"),
        ([[1.0, 2], [2, 1]], UsageError, "indefinite"),
        ([[1.0, 1], [1, 0]], UsageError, "DOF 2 has no mass on the diagonal, but beside it"),
        ([[1.0, np.nan], [np.nan, 1]], NumericalError, "beyond double precision"),
    ],
)
def test_mass_that_is_none_is_refused(mass, error, message):
    with pytest.raises(error, match=message):
        modes(np.array(mass), np.zeros((2, 2)), np.eye(2))


def test_motions_without_inertia_and_stiffness_are_refused():
    with pytest.raises(Singular, match="DOF 2 has neither mass nor stiffness"):
        modes(np.diag([1.0, 0]), np.zeros((2, 2)), np.diag([1.0, 0]))
    K = np.array([[1.0, 0, 0], [0, 1, -1], [0, -1, 1]])
    with pytest.raises(Singular, match="neither inertia nor stiffness"):
        modes(np.diag([1.0, 0, 0]), np.zeros((3, 3)), K)


def test_a_stiffness_printed_with_six_digits_keeps_its_rigid_body():
    rng = np.random.default_rng(3)
    springs = rng.uniform(1, 9, 30)
    chain = lumped([1.0] * 31, [Link((i + 1, i + 2), k) for i, k in enumerate(springs)])
    K = np.array([[float(f"{v:.6g}") for v in row] for row in chain.K])
    assert modes(chain.M, chain.C, K).rigid == 1
    assert modes(chain.M, chain.C, chain.K).rigid == 1


def test_a_soft_suspension_is_no_rigid_body():
    springs = [Link((1,), 1e-7)] + [Link((i, i + 1), 1e4) for i in range(1, 6)]
    found = modes(*lumped([1.0] * 6, springs).with_joints())
    assert found.rigid == 0
    np.testing.assert_allclose(found.omega[0] ** 2, 1e-7 / 6, rtol=1e-4)


def test_masses_that_nothing_holds_are_rigid_bodies():
    found = modes(np.diag([2.0, 1.0]), np.zeros((2, 2)), np.diag([0.0, 9.0]))
    np.testing.assert_allclose(found.omega, [0, 3])
    assert found.rigid == 1


@pytest.mark.parametrize("mass", [1e-12, 1e-20, 1e-27, 1e-40])
def test_a_mass_too_small_to_matter_leaves_the_others_their_modes(mass):
    K = np.diag([2.0, 2, 1]) - np.eye(3, k=1) - np.eye(3, k=-1)
    found = modes(np.diag([1.0, mass, 1.0]), np.zeros((3, 3)), K)
    # Without it DOF 2 follows: K = [[1.5, -0.5], [-0.5, 0.5]], whose eigenvalues are 1 -+ sqrt(1/2).
    np.testing.assert_allclose(found.omega[:2] ** 2, [1 - 0.5**0.5, 1 + 0.5**0.5], rtol=1e-10)
    assert found.massless == (mass == 1e-40)
    if not found.massless:
        assert found.omega[2] ** 2 * mass == pytest.approx(2, rel=1e-10)


@pytest.mark.parametrize("seed", range(8))
def test_a_mass_that_rounding_alone_ties_to_others_is_a_rigid_body(seed):
    # As reduced models have it: modal coordinates, of which the masses couple by rounding.
    random = np.random.default_rng(seed)
    A = random.normal(size=(12, 12))
    K = np.zeros((13, 13))
    K[1:, 1:] = A @ A.T + np.diag(10.0 ** random.uniform(0, 6, 12))
    blur = np.triu(random.normal(size=(13, 13)) * 1e-16, 1)
    found = modes(np.eye(13) + blur + blur.T, np.zeros((13, 13)), K)
    assert (found.rigid, found.omega[0]) == (1, 0.0)
    np.testing.assert_allclose(found.omega[1:] ** 2, np.linalg.eigvalsh(K[1:, 1:]), rtol=1e-8)


def test_a_nearly_free_mass_makes_no_other_massless():
    for squares in ([1e-30, 1e4], [1e-30, 1e-10, 1.0, 1e10, 1e20]):
        found = modes(np.eye(len(squares)), np.zeros((len(squares),) * 2), np.diag(squares))
        assert found.massless == 0
        np.testing.assert_allclose(found.omega**2, squares, rtol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_a_spectrum_of_more_decades_than_doubles_have_is_resolved_in_all_its_parts(seed):
    # Coupled to the full, so that nothing is read off the diagonal; K is graded, which fixes each mode.
    random = np.random.default_rng(seed)
    A, D = random.normal(size=(5, 5)), np.sqrt([1e-30, 3, 1e-10, 1, 1e4])
    K, M = (A @ A.T + np.eye(5)) * D * D[:, None], np.eye(5) + 0.3 * np.diag(random.random(4), 1)
    M = (M + M.T) / 2
    with mpmath.workdps(100):
        L = mpmath.cholesky(mpmath.matrix(M.tolist())) ** -1
        exact = sorted(float(x) for x in mpmath.eigsy(L * mpmath.matrix(K.tolist()) * L.T, eigvals_only=True))
    np.testing.assert_allclose(modes(M, np.zeros((5, 5)), K).omega ** 2, exact, rtol=1e-8)
