"""Factorisations whose solutions are checked, and inertia counts against exact ones."""

import os
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure import factorisation
from dynid.structure.factorisation import BACKENDS, available, backend_for, factorise
from dynid.structure.modes import modes
from dynid.structure.modes.sparse import eigenvalues_below, negative_eigenvalues

from .pencils import grid, string

INSTALLED = [name for name, there in available().items() if there]


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


class Faulty:
    """A backend whose solutions are off."""

    negative_eigenvalues, memory = 0, 0

    def __init__(self, A, wrong):
        self.A, self.wrong = A.toarray(), wrong

    def solve(self, b):
        x = np.linalg.solve(self.A, b)
        return self.wrong(x)


def fake(monkeypatch, wrong):
    monkeypatch.setattr(factorisation, "bare", lambda A, _name, **_: Faulty(A, wrong))


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
    absent = factorisation.Backend("no_such_package", "no-such-package", indefinite=True, factors=Faulty)
    monkeypatch.setitem(BACKENDS, "pardiso", absent)
    assert not available()["pardiso"]
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


@settings(max_examples=150, deadline=None)
@given(st.integers(1, 7).flatmap(lambda n: st.lists(st.integers(-3, 3), min_size=n * n, max_size=n * n)))
def test_inertia_against_exact_elimination(entries):
    n = int(len(entries) ** 0.5)
    A = np.array(entries, dtype=float).reshape(n, n)
    A = A + A.T
    nearest = np.abs(np.linalg.eigvalsh(A)).min()
    for matrix in (A, sp.csc_array(A)):
        try:
            assert negative_eigenvalues(matrix) == exact_negatives(A)
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
        monkeypatch.setitem(BACKENDS, "pardiso", BACKENDS["pardiso"]._replace(package=package))

    installed("numpy")  # is there
    assert [backend_for(size) for size in (20_000, 20_001)] == ["splu", "pardiso"]
    installed("no_such_package")
    assert backend_for(10**6) == "splu"
    assert factorise(string(3)[0]).name == "splu"


def test_a_matrix_that_superlu_cannot_count_is_refused(monkeypatch):
    monkeypatch.setattr(factorisation._SuperLUFactors, "_FILL", 10**9)
    with pytest.raises(UsageError, match="too large for SuperLU") as refusal:
        factorise(string(3)[0], "splu")
    assert "dynid[solvers]" in refusal.value.remedy


def test_the_order_of_one_factorisation_serves_another():
    K, exact = grid(20)
    order = factorise(K, "splu", definite=True).order
    assert sorted(order) == list(range(400))
    A = sp.csc_array(K - 1.0 * sp.eye_array(400))
    counts = [
        eigenvalues_below(K, sp.eye_array(400, format="csc"), 1.0, "splu", given) for given in (None, order)
    ]
    assert counts == [(np.count_nonzero(exact < 1.0), 1.0)] * 2
    turned = factorise(A[order][:, order], "splu", ordered=True)
    found = factorise(A, "splu")
    b = np.arange(400.0)
    np.testing.assert_allclose(turned.solve(b[order]), found.solve(b)[order], rtol=1e-9)
    assert turned.memory <= 1.1 * found.memory


def test_the_library_of_pardiso_is_named_for_pypardiso(monkeypatch, tmp_path):
    (tmp_path / "lib").mkdir()
    monkeypatch.setattr("sys.prefix", str(tmp_path))
    for name in ("PYPARDISO_MKL_RT", "KMP_BLOCKTIME"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    factorisation._prepare_library()
    assert "PYPARDISO_MKL_RT" not in os.environ  # elsewhere pypardiso looks for it
    library = tmp_path / "lib" / "libmkl_rt.so.3"
    library.touch()
    factorisation._prepare_library()
    assert os.environ["PYPARDISO_MKL_RT"] == str(library)
    assert os.environ["KMP_BLOCKTIME"] == "0"
    monkeypatch.setenv("KMP_BLOCKTIME", "200")
    factorisation._prepare_library()
    assert os.environ["KMP_BLOCKTIME"] == "200"
