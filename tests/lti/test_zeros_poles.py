"""Zeros and poles of state equations: every published one, planted ones, and faults in words."""

import json
import math
import re
from decimal import Decimal
from fractions import Fraction
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from flint import fmpq, fmpz_mat
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat
from scipy.sparse import csc_matrix, issparse
from sympy import Matrix, Poly, Rational, eye, gcd_list, symbols

import dynid.lti
from dynid.errors import Singular, Undecided, UsageError
from dynid.lti import zeros_poles
from dynid.lti.pencil.exact import Residues, determinant

SHARED = Path(__file__).parents[2] / "../shared/data"
FILE = SHARED / "zeros/state_space.json"
CASES = {case["name"]: case for case in json.loads(FILE.read_text(encoding="utf-8"))} if FILE.exists() else {}
published = pytest.mark.skipif(not CASES, reason=f"the published systems are not at {FILE}")
BENCHMARKS = {"building": "building", "cdplayer": "cdplayer_11", "heat": "heat"}


def assert_same(found, expected, tolerance):
    """Compare values with [re, im, multiplicity], one to one."""
    left = list(found)
    wanted = [complex(re, im) for re, im, multiplicity in expected for _ in range(multiplicity)]
    assert len(left) == len(wanted)
    for value in wanted:
        nearest = min(left, key=lambda z: abs(z - value))
        assert abs(nearest - value) <= tolerance * abs(value)
        left.remove(nearest)


# --- published systems ---------------------------------------------------------------------------


@published
@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(("engine", "tolerance"), [("exact", 1e-14), ("float", 1e-13)])
def test_published_systems(name, engine, tolerance):
    case = CASES[name]
    found = zeros_poles(*(case[key] for key in "ABCDE"), engine=engine, reading="decimal")
    assert_same(found.zeros, case["exact_invariant_zeros"], tolerance)
    assert_same(found.poles, case["exact_poles"], tolerance)
    assert found.normal_rank == case["normal_rank_G"]
    if case["m"] == case["p"] == 1 and case["normal_rank_G"]:
        assert found.relative_degree == case["relative_degree"]


def system(name):
    """Return A, B, C of a published model; how sparse they are hangs on the version of SciPy."""
    model = loadmat(SHARED / f"fe/official_{name}.mat", spmatrix=False)
    return [part.toarray() if issparse(part) else part for part in (model[key] for key in "ABC")]


def benchmark(name):
    A, B, C = system(name)
    file = SHARED / f"zeros/mor_{BENCHMARKS[name]}.json"
    expected = json.loads(file.read_text(encoding="utf-8"))
    return (A, B[:, :1], C[:1], 0), expected


@cache
def first_channel(name, reading):
    """Return exact zeros and poles of the first channel of a published model, which takes a second."""
    return zeros_poles(*benchmark(name)[0], reading=reading)


@pytest.mark.thorough
@published
@pytest.mark.parametrize("name", ["building", "cdplayer", pytest.param("heat", marks=pytest.mark.slow)])
def test_benchmark_models_exactly(name):
    expected = benchmark(name)[1]
    found = first_channel(name, "binary")
    assert_same(found.zeros, expected["zeros"], 1e-14)
    assert_same(found.poles, expected["poles"], 1e-14)
    assert found.relative_degree == expected["relative_degree"]
    assert found.gain == pytest.approx(expected["leading_coeff_numerator"], rel=1e-15)
    assert sum(root.side > 0 for root in found.zero_roots) == expected["n_rhp_zeros"]


@published
@pytest.mark.parametrize("name", ["building", "heat"])
def test_benchmark_models_in_floating_point(name):
    """Heat: 66 exact cancellations and relative degree 67; conditions up to 1e3 ask for 1e-12."""
    matrices, expected = benchmark(name)
    found = zeros_poles(*matrices, engine="float")
    assert_same(found.zeros, expected["zeros"], 1e-12)
    assert_same(found.poles, expected["poles"], 1e-12)


@published
def test_what_drowns_in_rounding_is_refused():
    """The CD player's zero at -7e15 hangs on a product C B of 1e-10 that cancels from 1e6."""
    with pytest.raises(Undecided, match="exact engine"):
        zeros_poles(*benchmark("cdplayer")[0], engine="float")


@pytest.mark.thorough
@published
@pytest.mark.parametrize("reading", ["binary", pytest.param("decimal", marks=pytest.mark.slow)])
def test_phase_verdicts_of_the_cd_player_name_its_far_zeros(reading):
    """Of channel (2, 2) all but one of 119 zeros lie on the left; that one is 6e15 times the largest pole."""
    A, B, C = system("cdplayer")
    found = zeros_poles(A, B[:, 1:], C[1:], 0, reading=reading)
    assert (found.relative_degree, len(found.zeros), found.minimum_phase) == (1, 119, False)
    assert found.far_zeros == pytest.approx([2.755e20], rel=1e-3)
    assert found.zero_stability == (
        "non-minimum phase: zero at 2.755e+20 lies in the right half-plane; its inverse is unstable; far, "
        "6e+15 times beyond the largest pole, and without it minimum phase"
    )
    assert found.stable
    found = first_channel("cdplayer", reading)
    assert found.far_zeros == pytest.approx([-6.887e15], rel=1e-3)
    assert found.zero_stability == (
        "non-minimum phase: zero at 1.598e+05 lies in the right half-plane; its inverse is unstable"
    )


# --- planted structure, and an oracle that knows nothing of the engines --------------------------

s = symbols("s")


def smith_zeros(A, B, C, D, E):
    """Return the monic gcd of all minors of the normal rank's size, by definition."""
    top = (s * E - A).row_join(-B) if B.cols else s * E - A
    pencil = top.col_join(C.row_join(D) if D.cols else C) if C.rows else top
    for size in range(min(pencil.shape), 0, -1):
        minors = [
            pencil.extract(list(rows), list(columns)).det(method="berkowitz").expand()
            for rows in combinations(range(pencil.rows), size)
            for columns in combinations(range(pencil.cols), size)
        ]
        if any(minors):
            return size, Poly(gcd_list([minor for minor in minors if minor != 0]), s)
    return 0, Poly(1, s)


entries = st.integers(-2, 2)


@st.composite
def systems(draw):
    """Small systems with singular E, repeated and decoupling zeros, of any shape and rank."""
    n, m, p = draw(st.integers(1, 3)), draw(st.integers(0, 2)), draw(st.integers(0, 2))

    def matrix(rows, columns, values=entries):
        return Matrix(rows, columns, [draw(values) for _ in range(rows * columns)])

    A, B, C, D = matrix(n, n), matrix(n, m), matrix(p, n), matrix(p, m, st.sampled_from([0, 0, 0, 1]))
    E = draw(st.sampled_from([eye(n), eye(n), matrix(n, n, st.sampled_from([0, 0, 1]))]))
    return A, B, C, D, E


@pytest.mark.thorough
@settings(max_examples=30, deadline=None)
@given(systems())
def test_zeros_are_the_smith_zeros(system):
    A, B, C, D, E = system
    n, m, p = A.rows, B.cols, C.rows
    given_as = [np.array(M.tolist(), dtype=object).reshape(M.shape) for M in (A, B, C, D, E)]
    denominator = (s * E - A).det()
    if denominator.expand() == 0:
        for engine in ("exact", "float"):
            with pytest.raises(Singular, match="singular for every s"):
                zeros_poles(*given_as, engine=engine)
        return
    rank, expected = smith_zeros(A, B, C, D, E)
    found = zeros_poles(*given_as)
    assert found.normal_rank == rank - n
    for roots, polynomial in (
        (found.zero_roots, expected),
        (found.pole_roots, Poly(denominator, s)),
    ):
        assert sum(root.multiplicity for root in roots) == polynomial.degree()
        factors = [(f, k) for f, k in polynomial.sqf_list()[1] if f.degree() > 0]
        for root in roots:
            (factor,) = (f for f, k in factors if k == root.multiplicity)
            nearest = min(abs(complex(z) - root.value) for z in factor.nroots(n=30, maxsteps=500))
            assert nearest <= 1e-14 * max(1.0, abs(root.value))
    if m == p == 1 and rank > n:
        assert found.relative_degree == Poly(denominator, s).degree() - expected.degree()
    assert_float_agrees_or_refuses(given_as, found)


def assert_float_agrees_or_refuses(matrices, exact):
    try:
        rough = zeros_poles(*matrices, engine="float")
    except Undecided:
        return
    for values, expected, bounds in (
        (rough.zeros, exact.zeros, rough.zero_bounds),
        (rough.poles, exact.poles, rough.pole_bounds),
    ):
        assert_same(values, [(z.real, z.imag, 1) for z in expected], 1e-7)
        assert (bounds <= 1e-7 * np.maximum(np.abs(values), 1e-6)).all()
    assert rough[6:9] == exact[6:9]  # rank, relative degree, zeros at infinity


def unimodular(n, seed):
    """Return an integer matrix with integer inverse, and that inverse."""
    rng = np.random.default_rng(seed)
    lower, upper = (
        np.tril(rng.integers(-1, 2, (n, n)), -1).astype(object) + np.eye(n, dtype=object) for _ in "ab"
    )
    T = lower @ upper.T
    inverse = np.array(Matrix(T.astype(int)).inv().tolist(), dtype=object)
    return T, inverse


@pytest.mark.parametrize("seed", range(3))
def test_planted_jordan_blocks_and_decoupling_zeros_survive_a_change_of_coordinates(seed):
    """Two channels with zeros 1/3 (twice) and -5; a Jordan block of size 3 at -2 that no input reaches."""
    third = Fraction(1, 3)
    A = np.zeros((8, 8), dtype=object)
    A[:3, :3] = [[0, 1, 0], [0, 0, 1], [-6, -11, -6]]  # numerator (s - 1/3)^2
    A[3:5, 3:5] = [[0, 1], [-12, -7]]  # numerator s + 5
    A[5:, 5:] = [[-2, 1, 0], [0, -2, 1], [0, 0, -2]]
    B, C = np.zeros((8, 2), dtype=object), np.zeros((2, 8), dtype=object)
    B[2, 0] = B[4, 1] = 1
    C[0, :3] = [third**2, -2 * third, 1]
    C[1, 3:5] = [5, 1]
    C[:, 5:] = 1
    T, inverse = unimodular(8, seed)
    found = zeros_poles(T @ A @ inverse, T @ B, C @ inverse, np.zeros((2, 2)))
    zeros = {root.value: (root.multiplicity, root.side) for root in found.zero_roots}
    assert zeros == {1 / 3: (2, 1), -2: (3, -1), -5: (1, -1)}
    poles = {root.value: root.multiplicity for root in found.pole_roots}
    assert poles == {-1: 1, -2: 4, -3: 2, -4: 1}
    assert (found.normal_rank, found.infinite_zeros) == (2, 2)


def test_a_descriptor_system_of_index_three():
    """y = u'' through a nilpotent E: improper, no poles, a double zero at the origin."""
    E = [[0, 1, 0], [0, 0, 1], [0, 0, 0]]
    for engine in ("exact", "float"):
        found = zeros_poles(np.eye(3), [0, 0, 1], [1, 0, 0], 0, E, engine=engine)
        assert found.zeros.tolist() == [0, 0]
        assert found.poles.shape == (0,)
        assert found.relative_degree == -2
        assert found.infinite_zeros == 0


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("what", ["units", "coordinates"])
def test_units_and_coordinates_do_not_hurt_the_float_engine(seed, what):
    rng = np.random.default_rng(seed)
    A, B, C = rng.standard_normal((8, 8)), rng.standard_normal((8, 2)), rng.standard_normal((2, 8))
    reference = zeros_poles(A, B, C, 0)
    if what == "units":
        T = np.diag(10.0 ** rng.integers(-6, 7, 8))
        inputs, outputs = 10.0 ** rng.integers(-6, 7, (2, 2))
    else:
        T, inputs, outputs = np.linalg.qr(rng.standard_normal((8, 8)))[0], np.ones(2), np.ones(2)
    inverse = np.diag(1 / np.diag(T)) if what == "units" else T.T
    found = zeros_poles(T @ A @ inverse, T @ B * inputs, outputs[:, None] * C @ inverse, 0, engine="float")
    assert_same(found.zeros, [(z.real, z.imag, 1) for z in reference.zeros], 1e-10)
    assert_same(found.poles, [(z.real, z.imag, 1) for z in reference.poles], 1e-10)


# --- what may be given ---------------------------------------------------------------------------


def test_a_reading_decides_what_a_float_means():
    """Pole and zero at 0.3: cancelled as decimals, as binary numbers 0.1 + 0.2 is another number."""
    A, B, C = [[-0.3]], [[1.0]], [[0.1]]
    assert zeros_poles(A, B, C, [[0.1]], reading="decimal").zeros.tolist() == [-1.3]
    third = zeros_poles([[0.1, 0], [0, 0.1]], [[1], [1]], [["1/3", "1/3"]], 0, reading="decimal")
    assert third.zeros.tolist() == [0.1]
    assert third.gain == 2 / 3
    close = zeros_poles([[0.1, 0], [0, 0.3]], [[1], [1]], [[3, -1]], 0, reading="decimal")
    assert close.zeros.tolist() == [0.4]
    assert zeros_poles([[0.1, 0], [0, 0.3]], [[1], [1]], [[3, -1]], 0).zeros.tolist() == [
        float((3 * Fraction(0.3) - Fraction(0.1)) / 2)
    ]


@pytest.mark.parametrize(
    "A", [[[-2, 1], [0, -3]], np.array([[-2, 1], [0, -3]]), csc_matrix([[-2.0, 1.0], [0.0, -3.0]]),
          [["-2", "1e0"], [Fraction(0), "-9/3"]], np.array([[-2, 1], [0, -3]], dtype=np.float32)]
)  # fmt: skip
@pytest.mark.parametrize("B", [[0, 1], [[0], ["1"]], csc_matrix([[0], [1]])])
def test_matrices_come_in_many_forms(A, B):
    found = zeros_poles(A, B, [1, 0], 0)
    assert sorted(found.poles.real) == [-3, -2]
    assert found.zeros.shape == (0,)
    zeros, poles = dynid.lti.zeros_poles(A, B, [1, 0], 0, engine="float")[:2]
    assert zeros.dtype == poles.dtype == np.complex128


def test_a_system_without_states_or_without_ports():
    static = zeros_poles([], [], [], [[1, 2], [2, 4]])
    assert (static.zeros.shape, static.poles.shape, static.normal_rank) == ((0,), (0,), 1)
    closed = zeros_poles([[1, 0], [0, 2]], np.zeros((2, 0)), [[1, 0]], np.zeros((1, 0)))
    assert closed.zeros.tolist() == [2]  # unobservable
    assert zeros_poles([[-1]], [[0]], [[1]], 0).relative_degree == math.inf


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"A": [[1, 2]]}, "A is 1 x 2"),
        ({"B": [[1], [2], [3]]}, r"B is 3 x 1 where 2 x 1 is wanted"),
        ({"C": [[1, 2, 3]]}, r"C is 1 x 3 where 1 x 2 is wanted"),
        ({"D": [[1, 2]]}, r"D is 1 x 2 where 1 x 1 is wanted"),
        ({"E": [[1]]}, r"E is 1 x 1 where 2 x 2 is wanted"),
        ({"A": [[1, 2], [3]]}, "A is not a rectangular table of numbers"),
        ({"A": [[1, math.nan], [0, 1]]}, r"A\[1, 2\] is nan, which is not a finite real number"),
        ({"A": np.array([[1, np.inf], [0, 1]])}, r"A\[1, 2\] is inf"),
        ({"B": [["1/0"], [0]]}, r"B\[1, 1\] is '1/0'"),
        ({"B": [["one"], [0]]}, r"B\[1, 1\] is 'one'"),
        ({"B": [["1e999999999"], [0]]}, r"B\[1, 1\]"),
        ({"B": [[1j], [0]]}, r"B\[1, 1\] is 1j"),
        ({"B": [[None], [0]]}, "B is not a rectangular table of numbers"),
        ({"D": 1.5, "B": np.zeros((2, 2))}, "D is a single number where 1 x 2 is wanted"),
        ({"engine": "flaot"}, "no engine 'flaot'; did you mean 'float'"),
        ({"reading": "octal"}, "no reading 'octal'"),
    ],
)  # fmt: skip
def test_faults_are_named(changes, message):
    system = {"A": [[0, 1], [-2, -3]], "B": [[0], [1]], "C": [[1, 0]], "D": [[0]], **changes}
    with pytest.raises(UsageError, match=message):
        zeros_poles(**system)


# --- verdicts ------------------------------------------------------------------------------------

COMPANION = [[0, 1], [-2, -3]]


@pytest.mark.parametrize("engine", ["exact", "float"])
@pytest.mark.parametrize(
    ("A", "C", "stability", "phase"),
    [
        (COMPANION, [1, 0], "stable", "minimum phase: there are no finite zeros"),
        (COMPANION, [3, 1], "stable", "minimum phase: every zero lies in the open left half-plane"),
        (COMPANION, [-3, 1], "stable", "non-minimum phase: zero at 3 lies in the right half-plane"),
        (COMPANION, [0, 1], "stable", "marginal, not minimum phase: zero at 0 lies on the imaginary axis"),
        ([[0, 1], [0, 0]], [1, 0], "unstable: poles at 0 lie repeated", "minimum phase"),
        ([[0, 1], [2, 1]], [1, 0], "unstable: pole at 2 lies in the right", "minimum phase"),
        (
            COMPANION,
            [-1e5, 1],
            "stable",
            "non-minimum phase: .* far, 5e\\+04 times beyond .* it minimum phase",
        ),
        (COMPANION, [0, 0], "stable", "undefined: the input does not reach the output"),
    ],
)
def test_verdicts_in_words(engine, A, C, stability, phase):
    found = zeros_poles(A, [0, 1], C, 0, engine=engine)
    assert re.match(phase, found.zero_stability)
    assert re.match(stability, found.stability)
    assert found.stable is (stability == "stable")
    assert found.minimum_phase is phase.startswith("minimum")


def test_a_side_that_rounding_hides_is_left_open():
    """An undamped oscillator in skew coordinates: exactly on the axis, and within the bound."""
    T = np.array([[2, 1], [7, 4]])
    A = T @ [[0, 1], [-2, 0]] @ [[4, -1], [-7, 2]]
    exact, rough = (zeros_poles(A, [[1], [0]], [[1, 0]], 0, engine=engine) for engine in ("exact", "float"))
    assert exact.stability.startswith("marginal, not stable: poles at ±1.414j lie on the imaginary axis")
    assert rough.stability.startswith("undecided")
    assert (exact.stable, rough.stable) == (False, None)
    # With an integrator beside it the system is not stable, whatever that pair is: flag and words agree.
    beside, b, c = np.block([[A, np.zeros((2, 1))], [np.eye(1, 3)]]), np.ones((3, 1)), np.ones((1, 3))
    poles = zeros_poles(beside, np.eye(3, 1), np.eye(3)[2:], 0, engine="float")
    assert poles.stable is False
    assert poles.stability.startswith(
        "not stable: pole at 0 lies on the imaginary axis; marginal or unstable is undecided within"
    )
    zeros = zeros_poles(beside + b @ c, b, c, 1, engine="float")
    assert zeros.minimum_phase is False
    assert zeros.zero_stability.startswith(
        "not minimum phase: zero at 0 lies on the imaginary axis; marginal or non-minimum phase is undecided"
    )


def test_exact_numbers_of_other_libraries_are_read_as_they_are():
    A = [[fmpq(-1, 3), Rational(1, 7)], [0, Decimal("-0.1")]]
    found = zeros_poles(A, [[1], [1]], [[1, 0]], [[0]])
    assert sorted(found.poles.real) == [-1 / 3, -0.1]


def test_nothing_has_the_determinant_one_and_a_singular_pencil_none():
    nothing = fmpz_mat(0, 0)
    assert Residues(nothing, nothing, 10007).determinant() == 1
    F, G = fmpz_mat([[1, 1], [1, 1]]), fmpz_mat([[2, 2], [2, 2]])
    assert determinant(F, G) == 0
    assert determinant(F, fmpz_mat([[2, 3], [2, 2]])).coeffs() == [-2, 1]
