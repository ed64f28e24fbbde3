"""Factorisations whose solutions are checked, and inertia counts against exact ones."""

import os
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid import native
from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure import backends
from dynid.structure.backends import BACKENDS, Factorisation, backend_for, factorise
from dynid.structure.modes import modes
from dynid.structure.modes.sparse import eigenvalues_below, negative_eigenvalues

from .pencils import grid, string

INSTALLED = [name for name, backend in BACKENDS.items() if not backend.missing()]


@pytest.mark.parametrize("name", INSTALLED)
@pytest.mark.parametrize("shape", [(400,), (400, 1), (400, 3), (400, 150)])
def test_solutions_of_every_backend(name, shape):
    A = grid(20)[0]
    b = np.random.default_rng(1).standard_normal(shape)
    factor = factorise(A, name, definite=True)
    np.testing.assert_allclose(A @ factor.solve(b), b, atol=1e-12)
    assert (factor.name, factor.negatives) == (name, 0)
    assert factor.memory >= 0


@pytest.mark.parametrize("name", [name for name in INSTALLED if BACKENDS[name].indefinite])
def test_negative_pivots_of_backends_that_take_indefinite_matrices(name):
    K, exact = grid(20)
    A = sp.csc_array(K - 1.0 * sp.eye_array(400))
    factor = factorise(A, name)
    assert factor.negatives == np.count_nonzero(exact < 1.0)
    b = np.ones(400)
    np.testing.assert_allclose(A @ factor.solve(b), b, atol=1e-11)


@pytest.mark.parametrize("name", [name for name in INSTALLED if not BACKENDS[name].indefinite])
def test_backends_for_definite_matrices_say_so(name):
    with pytest.raises(UsageError, match="positive definite matrices only"):
        factorise(grid(5)[0], name)
    with pytest.raises(Singular, match="not positive definite"):
        factorise(-grid(5)[0], name, definite=True)


def fake(monkeypatch, wrong):
    """Let every backend return solutions that are off."""

    class Faulty(Factorisation):
        name, package, requirement = "splu", "scipy", "scipy"

        def _factorise(self, *_, **__):
            self.dense = self.matrix.toarray()

        def _solve(self, b):
            return wrong(np.linalg.solve(self.dense, b))

    for name in BACKENDS:
        monkeypatch.setitem(BACKENDS, name, Faulty)


@pytest.mark.parametrize(
    "wrong",
    [lambda x: 1.01 * x + 1e-3, lambda x: x[::-1], lambda x: x + np.arange(len(x)), lambda x: 0 * x],
)
def test_a_backend_that_solves_wrongly_is_refused(monkeypatch, wrong):
    fake(monkeypatch, wrong)
    with pytest.raises(NumericalError, match=r"backend splu are wrong"):
        factorise(string(30)[0])
    K, _ = string(500)
    with pytest.raises(NumericalError, match="are wrong"):
        modes(sp.eye_array(500, format="csc"), 0 * K, K, 3, backend="splu")


def test_no_number_is_no_solution(monkeypatch):
    fake(monkeypatch, lambda x: x * np.nan)
    with pytest.raises(Singular):
        factorise(string(30)[0])


def test_one_step_of_refinement_is_taken_where_it_pays(monkeypatch):
    fake(monkeypatch, lambda x: x * (1 + 1e-7))
    A = string(30)[0]
    np.testing.assert_allclose(A @ factorise(A).solve(np.ones(30)), 1, atol=1e-11)


def test_backends_that_are_missing_are_named(monkeypatch):
    monkeypatch.setattr(BACKENDS["pardiso"], "package", "no_such_package")
    monkeypatch.setattr(BACKENDS["pardiso"], "requirement", "no-such-package")
    assert BACKENDS["pardiso"].missing()
    with pytest.raises(UsageError, match="pardiso is not installed") as refusal:
        factorise(string(3)[0], "pardiso")
    assert "no-such-package" in refusal.value.remedy
    with pytest.raises(UsageError, match="did you mean 'splu'"):
        factorise(string(3)[0], "slpu")


def test_singular_matrices_are_refused():
    A = sp.csc_array(np.diag([1.0, 0.0, 2.0]))
    with pytest.raises(Singular):
        factorise(A)
    with pytest.raises(UsageError, match="not finite"):
        factorise(sp.csc_array(np.diag([1.0, np.nan])))
    with pytest.raises(UsageError, match="square"):
        factorise(np.eye(3))


def exact_negatives(A):
    """Count by Fractions: signs of pivots of a symmetric elimination, 2x2 pivots where the diagonal is 0."""
    A = [[Fraction(int(v)) for v in row] for row in A]
    count = 0
    while A:
        n = len(A)
        k = next((i for i in range(n) if A[i][i]), None)
        if k is None:
            pair = next(((i, j) for i in range(n) for j in range(i) if A[i][j]), None)
            if pair is None:
                return count
            i, j = pair  # adding row and column j to i is a congruence: the diagonal becomes 2 a_ij
            A[i] = [a + b for a, b in zip(A[i], A[j], strict=True)]
            for row in A:
                row[i] += row[j]
            continue
        count += A[k][k] < 0
        rest = [i for i in range(n) if i != k]
        A = [[A[i][j] - A[i][k] * A[k][j] / A[k][k] for j in rest] for i in rest]
    return count


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 7).flatmap(lambda n: st.lists(st.integers(-3, 3), min_size=n * n, max_size=n * n)))
def test_inertia_against_exact_elimination(entries):
    n = int(len(entries) ** 0.5)
    A = np.array(entries, dtype=float).reshape(n, n)
    A = A + A.T
    nearest = np.abs(np.linalg.eigvalsh(A)).min()
    for matrix in (A, sp.csc_array(A)):
        try:
            for backend in {backend_for(n), "splu"}:
                assert negative_eigenvalues(matrix, backend) == exact_negatives(A)
        except Singular:
            assert nearest < 1e-12


def test_a_pivot_that_is_rounding_has_no_sign():
    A = np.array([[0.0, 3, 6], [3, -4, -3], [6, -3, 4]])  # of rank 2, with one negative eigenvalue
    with pytest.raises(Singular, match="its inertia cannot be told"):
        negative_eigenvalues(sp.csc_array(A))


def test_pivots_that_grow_without_bound_are_left_for_dense_ones():
    rows = "0 -2 0 1 3 0; 1 0 3 0 3 1; 0 0 0 1 -1 0; 0 0 0 0 0 1; -2 0 0 0 0 1; 1 -1 0 0 2 3"
    half = np.array([[float(entry) for entry in row.split()] for row in rows.split(";")])
    A = half + half.T
    assert negative_eigenvalues(sp.csc_array(A)) == exact_negatives(A)


def test_counts_below_values_of_a_dense_and_a_sparse_pencil():
    K, exact = grid(12)
    M = sp.eye_array(144, format="csc")
    for value in (1e-3, 0.5, 1.7, 3.3, 8.5):
        wanted = np.count_nonzero(exact < value)
        assert eigenvalues_below(K, M, value) == (wanted, value)
        assert eigenvalues_below(K.toarray(), M.toarray(), value) == (wanted, value)


def test_a_value_that_hits_an_eigenvalue_is_nudged():
    K = sp.diags_array(np.arange(1.0, 9.0), format="csc")
    assert eigenvalues_below(K, sp.eye_array(8, format="csc"), 3.0) == (3, pytest.approx(3.0, rel=2e-8))


def test_the_backend_follows_the_size_and_what_is_installed(monkeypatch):
    def installed(package):
        monkeypatch.setattr(BACKENDS["pardiso"], "package", package)

    monkeypatch.setenv(native.VARIABLE, "0")
    installed("numpy")  # is there
    assert [backend_for(size) for size in (20_000, 20_001)] == ["splu", "pardiso"]
    installed("no_such_package")
    assert backend_for(10**6) == "splu"
    monkeypatch.delenv(native.VARIABLE)
    monkeypatch.setattr(BACKENDS["ldl"], "package", "numpy")
    assert backend_for(20_001, 81 * 20_001) == "ldl"
    installed("numpy")
    assert [backend_for(20_001, full * 20_001) for full in (54, 81)] == ["ldl", "pardiso"]
    assert backend_for(20_000, 81 * 20_000) == "ldl"
    monkeypatch.setenv(native.VARIABLE, "0")
    installed("no_such_package")
    monkeypatch.setattr(BACKENDS["ldl"], "package", "dynid")
    assert factorise(string(3)[0]).name == "splu"
    with pytest.raises(UsageError, match="ldl is not installed") as refusal:
        factorise(string(3)[0], "ldl")
    assert "C compiler" in refusal.value.remedy


def test_a_matrix_that_superlu_cannot_count_is_refused(monkeypatch):
    monkeypatch.setattr(BACKENDS["splu"], "_FILL", 10**9)
    with pytest.raises(UsageError, match="too large for SuperLU") as refusal:
        factorise(string(3)[0], "splu")
    assert "dynid[solvers]" in refusal.value.remedy


compiled = pytest.mark.skipif("ldl" not in INSTALLED, reason="dynid was installed without its library")


@compiled
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 80), st.sampled_from([0.0, 0.02, 0.05, 0.2, 1.0]))
def test_own_factors_of_any_pattern_against_dense_matrices(seed, n, density):
    rng = np.random.default_rng(seed)
    A = sp.random_array((n, n), density=density, rng=rng)
    A = sp.kron(A + A.T, np.ones((2, 2)))  # nodes of two DOFs
    shifted = sp.csc_array(A + sp.diags_array(rng.uniform(-1, 1, 2 * n) * (1 + 2 * rng.integers(0, 2) * n)))
    definite = sp.csc_array(A + 4 * n * sp.eye_array(2 * n))
    B = rng.standard_normal((2 * n, 6))
    factor = factorise(definite, "ldl", definite=True)
    np.testing.assert_allclose(factor.solve(B), np.linalg.solve(definite.toarray(), B), rtol=1e-9, atol=1e-13)
    assert factor.negatives == 0
    values = np.linalg.eigvalsh(shifted.toarray())
    if np.abs(values).min() > 1e-9:
        assert negative_eigenvalues(shifted, "ldl") == np.count_nonzero(values < 0)


@compiled
def test_own_factors_of_wide_panels():
    """A dense matrix is a panel of 300 columns, wider than the widest; an arrow's last column is full."""
    rng = np.random.default_rng(3)
    half = rng.standard_normal((300, 300))
    arrow = sp.diags_array(np.full(300, 400.0)).tolil()
    arrow[:, -1] = arrow[-1, :] = 1.0
    for A in (half @ half.T + np.eye(300), arrow.toarray()):
        factor = factorise(sp.csc_array(A), "ldl", definite=True)
        b = rng.standard_normal(300)
        np.testing.assert_allclose(factor.solve(b), np.linalg.solve(A, b), rtol=1e-8)
    assert factorise(sp.csc_array(arrow), "ldl", definite=True).memory < 20_000  # no fill


@compiled
def test_own_factors_of_solids_are_dissected():
    """A block of 3,000 DOFs by itself, and among others."""
    n = 10
    ones = sp.diags_array([np.ones(n), np.ones(n - 1), np.ones(n - 1)], offsets=[0, 1, -1])
    cube = sp.kron(sp.kron(ones, ones), ones)
    A = sp.csc_array(
        sp.kron(100 * sp.eye_array(n**3) - cube, np.array([[2, 0.5, 0], [0.5, 2, 0.5], [0, 0.5, 2]]))
    )
    factor = factorise(A, "ldl", definite=True)
    b = np.random.default_rng(2).standard_normal((3 * n**3, 5))
    np.testing.assert_allclose(A @ factor.solve(b), b, atol=1e-11)
    assert factor.memory < 7e6
    islands = sp.csc_array(sp.block_diag([A, A[:600][:, :600], sp.eye_array(7)]))
    solved = factorise(islands, "ldl", definite=True).solve(np.ones(islands.shape[0]))
    np.testing.assert_allclose(islands @ solved, 1, atol=1e-11)


@compiled
def test_own_factors_of_a_pattern_that_is_not_symmetric():
    A = grid(6)[0].tolil()
    A[0, 20] = 1e-17  # is zero on the other side
    A = sp.csc_array(A)
    factor = factorise(A, "ldl", definite=True)
    np.testing.assert_allclose(A @ factor.solve(np.ones(36)), 1, atol=1e-12)


@compiled
def test_a_matrix_that_needs_pivots_is_left_to_superlu():
    K, exact = grid(6)
    A = sp.csc_array(sp.block_diag([K - sp.eye_array(36), np.array([[0.0, 1.0], [1.0, 0.0]])]))
    factor = factorise(A, "ldl")
    assert factor.name == "splu"
    assert negative_eigenvalues(A, "ldl") == np.count_nonzero(exact < 1) + 1
    with pytest.raises(Singular, match="not positive definite"):
        factorise(A, "ldl", definite=True)


@pytest.mark.parametrize("name", [name for name in ("ldl", "splu") if name in INSTALLED])
def test_the_order_of_one_factorisation_serves_another(name):
    K, exact = grid(20)
    order = factorise(K, name, definite=True).order
    assert sorted(order) == list(range(400))
    A = sp.csc_array(K - 1.0 * sp.eye_array(400))
    counts = [
        eigenvalues_below(K, sp.eye_array(400, format="csc"), 1.0, name, given) for given in (None, order)
    ]
    assert counts == [(np.count_nonzero(exact < 1.0), 1.0)] * 2
    turned, found = factorise(A, name, order=order), factorise(A, name)
    b = np.arange(400.0)
    np.testing.assert_allclose(turned.solve(b), found.solve(b), rtol=1e-9)
    assert turned.memory <= 1.1 * found.memory
    assert sorted(turned.order) == list(range(400))


def test_the_library_of_pardiso_is_named_for_pypardiso(monkeypatch, tmp_path):
    (tmp_path / "lib").mkdir()
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    for name in ("PYPARDISO_MKL_RT", "KMP_BLOCKTIME"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    backends._prepare_library()
    assert "PYPARDISO_MKL_RT" not in os.environ  # elsewhere pypardiso looks for it
    library = tmp_path / "lib" / "libmkl_rt.so.3"
    library.touch()
    backends._prepare_library()
    assert os.environ["PYPARDISO_MKL_RT"] == str(library)
    assert os.environ["KMP_BLOCKTIME"] == "0"
    monkeypatch.setenv("KMP_BLOCKTIME", "200")
    backends._prepare_library()
    assert os.environ["KMP_BLOCKTIME"] == "200"
