"""Finite eigenvalues of pencils in floating point: right, checked, or refused."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.sparse import csr_array

from dynid.errors import Singular, Undecided
from dynid.lti.pencil.eigenvalues import finite_eigenvalues, settle_origin


def chain(N, seed=0):
    """Return masses, springs, dampers and (A, b, c) of a grounded chain, force on 1, velocity of N."""
    rng = np.random.default_rng(seed)
    m, k, c = rng.uniform(0.5, 1.5, N), rng.uniform(100, 1000, N), rng.uniform(1, 10, N)

    def links(x):
        return np.diag(x + np.append(x[1:], 0)) - np.diag(x[1:], 1) - np.diag(x[1:], -1)

    A = np.block([[np.zeros((N, N)), np.eye(N)], [-links(k) / m[:, None], -links(c) / m[:, None]]])
    b, row = np.zeros((2 * N, 1)), np.zeros((1, 2 * N))
    b[N, 0], row[0, -1] = 1 / m[0], 1
    return k, c, A, b, row


def output_zeroing(A, b, row):
    n = len(A)
    return block_diag(np.eye(n), np.zeros((1, 1))), np.block([[A, b], [-row, np.zeros((1, 1))]])


@pytest.mark.parametrize("N", [1, 5, 60])
def test_zeros_of_a_chain_are_those_of_its_links(N):
    k, c, *state = chain(N)
    found = finite_eigenvalues(*output_zeroing(*state), count=N)
    assert np.sort(found.values.real) == pytest.approx(np.sort(np.append(-k[1:] / c[1:], 0)), rel=1e-13)
    assert not found.values.imag.any()
    assert found.infinite == N + 1


def test_sparse_and_dense_pencils_have_the_same_eigenvalues():
    A = chain(30)[2]
    dense, sparse = finite_eigenvalues(np.eye(60), A), finite_eigenvalues(csr_array(np.eye(60)), csr_array(A))
    assert dense.values.tolist() == sparse.values.tolist()
    assert (dense.bounds < 1e-10 * np.abs(dense.values)).all()


@pytest.mark.parametrize("seed", range(3))
def test_units_and_orthogonal_coordinates_leave_no_trace(seed):
    """Rows and columns in units between 1e-6 and 1e6, after an orthogonal change of coordinates."""
    rng = np.random.default_rng(seed)
    F, G = block_diag(np.eye(6), np.zeros((2, 2))), rng.standard_normal((8, 8))
    expected = finite_eigenvalues(F, G, count=6).values
    left, right = (np.linalg.qr(rng.standard_normal((8, 8)))[0] for _ in range(2))
    rows, columns = 10.0 ** rng.integers(-6, 7, (2, 8))
    found = finite_eigenvalues(
        rows[:, None] * (left @ F @ right) * columns, rows[:, None] * (left @ G @ right) * columns, count=6
    )
    assert found.values == pytest.approx(expected, rel=1e-8)
    assert (np.abs(found.values - expected) <= np.maximum(found.bounds, 1e-9 * np.abs(expected))).all()


def test_jordan_blocks_at_infinity_are_deflated():
    """Index 4: a nilpotent block of size 4 beside three finite eigenvalues, mixed by random coordinates."""
    rng = np.random.default_rng(1)
    F = block_diag(np.eye(3), np.eye(4, k=1))
    G = block_diag(np.diag([-1.0, 2.0, -3.0]), np.eye(4))
    left, right = (np.linalg.qr(rng.standard_normal((7, 7)))[0] for _ in range(2))
    found = finite_eigenvalues(left @ F @ right, left @ G @ right)
    assert np.sort(found.values.real) == pytest.approx([-3, -1, 2], rel=1e-12)
    assert found.infinite == 4


def test_what_cannot_be_known_is_refused():
    """A triple eigenvalue of a full matrix is known to the cube root of rounding only."""
    T = np.array([[2.0, 1, 3], [1, 3, -1], [0, 1, 1]])
    with pytest.raises(Undecided, match=r"the error of the eigenvalue .* may be .* exact engine"):
        finite_eigenvalues(np.eye(3), T @ (np.diag([1.0] * 3) + np.eye(3, k=1)) @ np.linalg.inv(T))


def test_another_count_is_refused():
    with pytest.raises(Undecided, match="leaves 2 finite eigenvalues where there are 1"):
        finite_eigenvalues(np.eye(2), [[1.0, 2.0], [3.0, 5.0]], count=1)


def test_a_determinant_that_vanishes_by_position_is_refused():
    with pytest.raises(Singular):
        finite_eigenvalues([[1.0, 0.0], [0.0, 0.0]], [[1.0, 1.0], [0.0, 0.0]])


def test_eigenvalues_known_to_be_zero_are_zero():
    A = np.array([[-1.0, 1.0], [1.0, -1.0]]) / 3
    found = finite_eigenvalues(np.eye(2), A, count=2, origin=1)
    assert found.values[0] == 0
    assert found.values[1] == pytest.approx(-2 / 3, rel=1e-15)


def test_no_equations_have_no_eigenvalues():
    assert finite_eigenvalues(np.zeros((0, 0)), np.zeros((0, 0))).values.shape == (0,)


def test_equations_without_a_derivative_have_no_eigenvalues():
    """s x = -x beside 0 = 2 y; and s u v' - 1 with v' u = 0, whose determinant is constant."""
    found = finite_eigenvalues(np.diag([1.0, 0.0]), np.diag([-1.0, 2.0]), count=1)
    assert found.values == pytest.approx([-1])
    assert found.infinite == 1
    none = finite_eigenvalues(np.array([[1.0, 1.0], [-1.0, -1.0]]), np.eye(2), count=0)
    assert len(none.values) == 0
    assert none.infinite == 2


def test_a_number_of_zeros_that_rounding_hides_is_refused():
    value, bound = np.array([1e-3, 1.0], complex), np.full(2, 1e-15)
    with pytest.raises(Undecided, match="rounding hides which 1 eigenvalues are 0"):
        settle_origin(value, bound, 1)
    assert value[0] == 1e-3
    value[0] = 1e-18
    settle_origin(value, bound, None)
    assert value[0] == 1e-18
    settle_origin(value, bound, 1)
    assert (value.tolist(), bound.tolist()) == ([0, 1], [0, 1e-15])
