"""The matrix exponential and its derivatives, against 60-digit arithmetic."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.errors import NumericalError
from dynid.lti.exponential import balance, exponential, exponential_with_derivatives
from tests.sample import sample


def chain(masses, springs, dampers):
    """System matrix of a chain of masses from ground."""
    n = len(masses)
    K, C = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        b = np.zeros(n)
        b[i] = 1
        if i:
            b[i - 1] = -1
        K += springs[i] * np.outer(b, b)
        C += dampers[i] * np.outer(b, b)
    M = np.diag(masses)
    lower = np.hstack([-np.linalg.solve(M, K), -np.linalg.solve(M, C)])
    return np.vstack([np.eye(n, 2 * n, k=n), lower])


def exact(A, dA, h):
    """Exponential and derivative from the exponential of [[A, dA], [0, A]], with 60 digits."""
    n = len(A)
    with mpmath.workdps(60):
        block = mpmath.matrix(np.block([[A, dA], [np.zeros_like(A), A]]).tolist()) * mpmath.mpf(h)
        squarings = max(0, int(mpmath.log(mpmath.norm(block, 1) + 1, 2)) + 10)
        E = mpmath.expm(block / 2**squarings, method="taylor")
        for _ in range(squarings):
            E = E * E
        E = np.array(E.tolist(), dtype=float)
    return E[:n, :n], E[:n, n:]


@pytest.mark.parametrize("damped", [True, False])
@pytest.mark.parametrize("phase", sample([1e-3, 1e-1, 1.0, 30.0, 1000.0], 3))
def test_value_and_derivatives_are_exact_from_slow_to_fast(phase, damped):
    dampers = [20.0, 30.0, 20.0] if damped else [0.0] * 3
    A = chain([2, 2, 1.5], [2e4, 3e4, 2e4], dampers)
    changed = chain([2, 2, 1.5], [2e4, 3e4, 4e4], dampers), chain([2, 2, 1.5], [2e4, 3e4, 2e4], [20, 30, 40])
    dA = np.stack([changed[0] - A, changed[1] - A])
    d = balance(A)
    A, dA = A * d / d[:, None], dA * d / d[:, None]
    h = phase / np.abs(np.linalg.eigvals(A)).max()
    Phi, dPhi = exponential_with_derivatives(A, dA, h)
    # A perturbation eps of A turns the phase by eps * phase: no method can do better.
    tolerance = 2e-15 * max(1.0, phase)
    for j in range(2):
        E, dE = exact(A, dA[j], h)
        assert np.abs(Phi - E).max() <= tolerance * np.abs(E).max()
        assert np.abs(dPhi[j] - dE).max() <= tolerance * np.abs(dE).max()


def test_fast_decay_beside_slow_is_exact():
    A = np.array([[-1e6, 1e6], [0.0, -1.0]])
    E, _ = exact(A, np.zeros((2, 2)), 1.0)
    np.testing.assert_allclose(exponential(A, 1.0), E, rtol=1e-9, atol=1e-300)  # eps * norm, twenty squarings


def test_zero_matrix_gives_identity_and_the_derivative_itself():
    dA = np.arange(4.0).reshape(1, 2, 2)
    Phi, dPhi = exponential_with_derivatives(np.zeros((2, 2)), dA, 0.5)
    np.testing.assert_array_equal(Phi, np.eye(2))
    np.testing.assert_allclose(dPhi, 0.5 * dA, rtol=1e-15)


@pytest.mark.parametrize("A", [np.array([[1e4]]), np.array([[np.nan]]), np.array([[np.inf]])])
def test_overflow_and_non_finite_are_refused(A):
    with pytest.raises(NumericalError):
        exponential(A, 1.0)


@given(
    st.lists(st.floats(-1, 1), min_size=9, max_size=9),
    st.lists(st.integers(-20, 20), min_size=3, max_size=3),
    st.floats(1e-3, 2),
)
@settings(max_examples=50, deadline=None)
def test_balancing_undoes_units_and_changes_nothing_else(entries, powers, h):
    A = np.array(entries).reshape(3, 3)
    units = 2.0 ** np.array(powers)
    scaled = A * units / units[:, None]
    d = balance(scaled)
    assert np.all(np.log2(d) == np.round(np.log2(d)))
    balanced = scaled * d / d[:, None]
    assert np.abs(balanced).sum() <= np.abs(scaled).sum() * (1 + 1e-12)
    back = exponential(balanced, h) * d[:, None] / d
    np.testing.assert_allclose(back * units[:, None] / units, exponential(A, h), rtol=1e-9, atol=1e-12)
