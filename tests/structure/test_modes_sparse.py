"""The lowest modes of sparse structures: against closed forms, with none missed."""

from collections import Counter

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

from dynid.bench.meshes import plate
from dynid.errors import NumericalError, Singular, UsageError
from dynid.structure.assembly import Support
from dynid.structure.backends import BACKENDS, Factorisation, backend_for
from dynid.structure.frame import beam
from dynid.structure.model import StructuralModel
from dynid.structure.modes import modes, remembered_modes, sparse
from dynid.structure.modes.sparse import SparseSpectrum
from dynid.structure.reduction.condensation import Guyan
from dynid.structure.reduction.modal import CraigBampton
from dynid.structure.reduction.mode_selection import ModeRange
from dynid.structure.reduction_comparison import compare

from .pencils import free_string, grid, string

INSTALLED = [name for name, backend in BACKENDS.items() if not backend.missing()]


def lowest(K, M=None, **asked):
    n = K.shape[0]
    M = sp.eye_array(n, format="csc") if M is None else M
    return modes(M, sp.csc_array((n, n)), K, **{"backend": "splu", **asked})


def assert_modes(found, M, exact, rtol):
    np.testing.assert_allclose(found.omega**2, exact, rtol=rtol, atol=0)
    np.testing.assert_allclose(found.shapes.T @ (M @ found.shapes), np.eye(len(exact)), atol=1e-9)
    assert found.residuals.max() < 1e-11


@pytest.mark.parametrize(
    ("backend", "count"), [("splu", 1), ("splu", 2), ("splu", 3), *((name, 10) for name in INSTALLED)]
)
def test_double_modes_of_a_membrane_are_all_found(backend, count):
    K, exact = grid(24)
    found = lowest(K, count=count, backend=backend)
    assert_modes(found, sp.eye_array(576), exact[:count], 1e-11)
    assert found.counted >= np.sqrt(exact[count - 1])
    assert found.rigid == 0


def test_modes_of_a_plate_keep_the_digits_that_its_condition_leaves():
    K, exact = grid(40, power=2)
    # The highest eigenvalue is 2e5 times the first: its rounding is what limits.
    assert_modes(lowest(K, count=12), sp.eye_array(1600), exact[:12], 1e-10)


@pytest.mark.parametrize("limit", [0.02, 0.1, 0.35])
def test_all_modes_below_a_limit(limit):
    K, exact = grid(20, free_string)
    found = lowest(K, below=np.sqrt(limit))
    wanted = exact[exact < limit]
    np.testing.assert_allclose(found.omega**2, wanted, rtol=1e-11, atol=0)
    assert found.counted == pytest.approx(np.sqrt(limit), rel=1e-8)
    assert (found.rigid, found.omega[0]) == (1, 0.0)


def test_a_limit_may_hit_a_mode_or_lie_below_all():
    K, exact = grid(20)
    at = lowest(K, below=np.sqrt(exact[4]))
    assert len(at.omega) in (4, 6)  # the double mode in whole or not at all
    np.testing.assert_allclose(at.omega**2, exact[: len(at.omega)], rtol=1e-11)
    assert lowest(K, below=np.sqrt(exact[0]) / 2).shapes.shape == (400, 0)


def test_a_limit_far_below_the_highest_mode_takes_one_sweep(monkeypatch):
    """The elements of a fine beam vibrate 1e7 times as fast as it: seen from there, its modes are one."""
    ends = [Support(1, ("w",)), Support(4001, ("w",))]
    model = beam(4000, length=np.pi, EI=1.0, rhoA=1.0, supports=ends)
    monkeypatch.setattr(sparse, "_RESTARTS", 1)
    found = lowest(model.K, model.M, below=182.0)
    exact = np.arange(1.0, 14.0) ** 2
    assert np.all(np.abs(found.omega - exact) <= found.uncertainty)


def test_count_and_limit_together_take_the_smaller():
    K, exact = grid(20)
    assert len(lowest(K, count=2, below=np.sqrt(exact[7])).omega) == 2
    assert len(lowest(K, count=50, below=0.99 * np.sqrt(exact[3])).omega) == 3


@pytest.mark.parametrize("count", [2, 4, 7])
def test_rigid_bodies_are_exact_zeros_whichever_part_of_them_is_asked_for(count):
    K, exact = free_string(300)
    three = sp.block_diag([K, K, 2 * K], format="csc")
    found = lowest(three, count=count)
    assert found.rigid == min(count, 3)
    np.testing.assert_array_equal(found.omega[:3][:count], 0)
    wanted = np.sort([*exact, *exact, *(2 * exact)])[3:count]
    np.testing.assert_allclose(found.omega[3:] ** 2, wanted, rtol=1e-11)


def test_units_of_rotations_change_nothing():
    K, exact = grid(22)
    unit = np.where(np.arange(484) % 2, 1e7, 1e-3)  # as if every second DOF were a rotation in odd units
    D = sp.diags_array(unit)
    found = lowest(sp.csc_array(D @ K @ D), sp.csc_array(D @ D), count=9)
    np.testing.assert_allclose(found.omega**2, exact[:9], rtol=1e-11)


def test_massless_dofs_follow_without_modes_of_their_own():
    K, _ = string(999)
    mass = np.zeros(999)
    mass[99::100] = 1.0  # springs of 100 in series between nine masses
    found = lowest(K, sp.diags_array(mass, format="csc"), count=9)
    np.testing.assert_allclose(found.omega**2, string(9)[1] / 100, rtol=1e-10)
    assert found.massless == 990
    with pytest.raises(UsageError, match="10 modes are asked for, but the structure has 9 "):
        lowest(K, sp.diags_array(mass, format="csc"), count=10)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(8, 40), rank=st.integers(3, 8), count=st.integers(1, 6))
def test_random_semidefinite_pencils_against_dense_decompositions(seed, n, rank, count):
    rng = np.random.default_rng(seed)
    rank = min(rank, n)
    half = rng.standard_normal((n, n))
    K = half @ half.T + np.diag(rng.uniform(0.1, 1, n))
    mass = rng.standard_normal((n, rank))  # a mass of low rank, its null space no single DOFs
    M = mass @ mass.T
    exact = 1 / eigh(M, K, eigvals_only=True)[::-1][:rank]
    if count > rank:
        with pytest.raises(UsageError, match=f"has {rank} with finite"):
            modes(M, 0 * K, K, count)
        return
    for backend in ("dense", "splu"):
        found = modes(M, 0 * K, K, count, backend=backend)
        np.testing.assert_allclose(found.omega**2, exact[:count], rtol=1e-8)
    assert modes(M, 0 * K, K).massless == n - rank


def test_runs_give_the_same_bytes_and_signs():
    K, _ = grid(24)
    first, again = lowest(K, count=6), lowest(K, count=6)
    assert first.shapes.tobytes() == again.shapes.tobytes()
    assert np.all(first.shapes.max(axis=0) >= -first.shapes.min(axis=0) * (1 - 1e-6))


def test_a_mode_that_the_iteration_drops_is_noticed_and_found(monkeypatch):
    K, exact = grid(24)
    honest, calls = sparse.largest, []

    def dropping(solve, M, count, rng, known=None):
        theta, X = honest(solve, M, count, rng, known)
        calls.append(count)
        keep = np.arange(len(theta)) != (2 if len(calls) == 1 else -1)
        return theta[keep], X[:, keep]

    monkeypatch.setattr("dynid.structure.modes.sparse.largest", dropping)
    np.testing.assert_allclose(lowest(K, count=5).omega ** 2, exact[:5], rtol=1e-10)
    assert len(calls) > 1


def test_modes_that_stay_missing_are_an_error(monkeypatch):
    K, _ = grid(21)
    honest = sparse.largest

    def dropping(solve, M, count, rng, known=None):  # noqa: ARG001 - what is known is lost again
        theta, X = honest(solve, M, count, rng)
        keep = np.arange(len(theta)) != 2
        return theta[keep], X[:, keep]

    monkeypatch.setattr("dynid.structure.modes.sparse.largest", dropping)
    with pytest.raises(NumericalError, match="disagree"):
        lowest(K, count=5)
    with pytest.raises(NumericalError, match="disagree"):
        lowest(K, below=0.5)


def test_without_proof_nothing_is_counted(monkeypatch):
    def counted(*_args):
        raise AssertionError

    monkeypatch.setattr(SparseSpectrum, "_count", counted)
    K, exact = grid(24)
    found = lowest(K, count=5, proof=False)
    np.testing.assert_allclose(found.omega**2, exact[:5], rtol=1e-10)
    assert found.counted == 0


@pytest.mark.parametrize("backend", ["dense", *(name for name in INSTALLED if name != "pardiso")])
def test_an_indefinite_stiffness_is_refused(backend):
    K, _ = grid(24)
    with pytest.raises(Singular, match="indefinite"):
        lowest(sp.csc_array(K - 0.1 * sp.eye_array(576)), count=3, backend=backend)


def test_a_motion_with_neither_mass_nor_stiffness_is_refused():
    K, _ = free_string(300)
    mass = sp.diags_array(np.concatenate([np.ones(300), np.zeros(300)]), format="csc")
    with pytest.raises(Singular, match="neither inertia nor stiffness"):
        lowest(sp.block_diag([string(300)[0], K], format="csc"), mass, count=3)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"count": 0}, "1 or more"),
        ({"below": -1.0}, "positive"),
        ({"below": float("nan")}, "positive"),
        ({"backend": "splu"}, "number or a limit"),
        ({"count": 3, "backend": "slpu"}, "did you mean 'splu'"),
    ],
)
def test_what_makes_no_sense_is_refused(asked, message):
    with pytest.raises(UsageError, match=message):
        lowest(string(30)[0], **asked)


def test_all_modes_of_a_large_structure_are_not_computed_by_accident():
    K, _ = string(7000)
    with pytest.raises(UsageError, match="all modes of 7000 DOFs"):
        lowest(K, backend="auto")


def test_auto_takes_what_fits():
    K, exact = grid(25)
    assert backend_for(625) in lowest(K, count=4, backend="auto").method
    assert "dense" in lowest(grid(13)[0], count=4, backend="auto").method
    full = lowest(K, backend="auto")
    assert ("dense" in full.method, full.counted) == (True, np.inf)
    np.testing.assert_allclose(full.omega**2, exact, rtol=1e-11)


# --- DOFs that are nearly free ----------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("spring", [1e-5, 1e-7, 1e-9, 1e-12, 0.0])
def test_a_nearly_free_dof_hides_no_modes_of_the_others(seed, spring):
    """A fixed chain has lambda_j = 4 k/m sin^2(j pi / (2 (n + 1))), one DOF beside it spring/mass."""
    rng = np.random.default_rng(seed)
    n, k, m, own = int(rng.integers(210, 400)), float(rng.uniform(5e3, 2e4)), 1.5, float(rng.uniform(1, 9))
    at = int(rng.integers(0, n + 1))
    K = k * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    K = np.insert(np.insert(K, at, 0.0, axis=0), at, 0.0, axis=1)
    K[at, at] = spring
    mass = np.insert(np.full(n, m), at, own)
    chain = np.sqrt(4 * k / m) * np.sin(np.arange(1, n + 1) * np.pi / (2 * (n + 1)))
    true = np.concatenate([[np.sqrt(spring / own)], chain])
    matrices = sp.csc_array(np.diag(mass)), sp.csc_array((n + 1, n + 1)), sp.csc_array(K)
    for asked in ({"count": 2}, {"count": 7}, {"below": float(true[4:6].mean())}):
        found = modes(*matrices, backend="splu", **asked).omega
        np.testing.assert_allclose(found, true[: asked.get("count", 5)], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_nearly_free_dofs_on_a_chain_are_found_with_all_the_others_or_refused(seed):
    """Against dense matrices; both state what rounding leaves open."""
    rng = np.random.default_rng(seed)
    n = 220
    K, mass = np.zeros((n, n)), rng.uniform(1, 2, n)
    ties = [(i, i + 1, 1e4) for i in range(n - 4)] + [(0, 0, 1e4)]
    ties += [(n - 3 + j, int(rng.integers(0, n - 4)), 10 ** rng.uniform(-6, -3)) for j in range(3)]
    for a, b, k in ties:
        K[a, a] += k
        if a != b:
            K[b, b], K[a, b], K[b, a] = K[b, b] + k, K[a, b] - k, K[b, a] - k
    dense = modes(np.diag(mass), np.zeros((n, n)), K, count=8, backend="dense")
    matrices = sp.csc_array(np.diag(mass)), sp.csc_array((n, n)), sp.csc_array(K)
    found = modes(*matrices, count=8, backend="splu")
    stated = 3 * (dense.uncertainty + found.uncertainty)
    assert np.all(np.abs(found.omega - dense.omega) <= 1e-8 * dense.omega + stated)


def test_the_same_modes_are_computed_once(monkeypatch):
    K, exact = grid(24)
    M, C = sp.eye_array(576, format="csc"), sp.csc_array((576, 576))
    K = sp.csc_array(K)
    computed = []
    whole = SparseSpectrum.lowest

    def counted(self, count, **options):
        computed.append(count)
        return whole(self, count, **options)

    monkeypatch.setattr(SparseSpectrum, "lowest", counted)
    with remembered_modes() as memory:
        first = modes(M, C, K, 5)
        assert memory.seconds == 0
        again = modes(M.copy(), C.copy(), K.copy(), 4)  # equal, and not the same objects
        assert computed == [5]
        assert memory.seconds > 0
        np.testing.assert_array_equal(again.omega, first.omega[:4])
        modes(M, C, K, 6)  # more of them
        modes(M, C, sp.csc_array(2 * K), 6)  # another structure
        modes(M, C, K, 6)  # only the last are remembered
        modes(M, C, K, 6, proof=False)  # with nothing proved
        assert computed == [5, 6, 6, 6, 6]
        below = modes(M, C, K, below=float(np.sqrt(exact[8])) * 1.01)
        few = modes(M, C, K, 3)
        np.testing.assert_array_equal(few.omega, below.omega[:3])
        assert computed == [5, 6, 6, 6, 6]
    modes(M, C, K, 3)
    assert computed == [5, 6, 6, 6, 6, 3]


@pytest.fixture
def work(monkeypatch):
    """Numbers of factorisations and of solutions with their factors."""
    counts = Counter()

    def counted(name, method):
        def call(self, *arguments, **options):
            counts[name] += 1
            return method(self, *arguments, **options)

        return call

    for name, label in (("__init__", "factorisations"), ("_finite_solution", "solutions")):
        monkeypatch.setattr(Factorisation, name, counted(label, getattr(Factorisation, name)))
    return counts


def test_many_modes_take_two_factorisations_and_no_restart(work):
    K, M = plate(20)
    assert len(modes(M, sp.csc_array(K.shape), K, 100, backend="splu").omega) == 100
    assert work["factorisations"] == 2  # the other one counts
    assert work["solutions"] <= 250


def test_a_comparison_costs_less_than_ten_times_the_reductions(work):
    K, M = plate(20)
    model, masters = StructuralModel(M, sp.csc_array(K.shape), K), list(range(100, 1000, 45))
    methods = {"craig-bampton": CraigBampton(masters, modes=ModeRange(count=10)), "guyan": Guyan(masters)}
    compare(model, methods, references=False)
    reductions = Counter(work)
    assert reductions["factorisations"] <= 4  # two stiffnesses of slaves, fixed modes and their count
    compare(model, methods)
    assert work["factorisations"] - reductions["factorisations"] == reductions["factorisations"] + 2
    assert work["solutions"] - reductions["solutions"] < 10 * reductions["solutions"]
