"""Roots that round-off does not resolve, of matrices whose roots are known with their multiplicities."""

from collections import Counter
from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.lti.root_slopes import poles, zeros
from dynid.lti.state_space import ParametricSystem

NOTHING = np.zeros(1)


def companion(roots):
    """Return the companion matrix of a real polynomial with these roots, and with no parameter that acts."""
    s = sympy.Symbol("s")
    polynomial = sympy.Poly(sympy.expand(sympy.prod(s - root for root in roots)), s)
    coefficients = [float(c) for c in polynomial.all_coeffs()[1:]]
    n = len(coefficients)
    A = np.zeros((n, n))
    A[0], A[1:, :-1] = -np.array(coefficients), np.eye(n - 1)
    return A, np.zeros((1, n, n))


def multiplicities(roots):
    """Return the multiplicity of each root in order: of a cluster its size, else 1."""
    count = np.ones(len(roots.values), dtype=int)
    for cluster in roots.clusters:
        count[cluster.places] = len(cluster.places)
    return count


SETS = [
    [-2, -2],
    [-2, -2, -2, -5],
    [-1, -1, -1, -1],
    [-3 + 4 * sympy.I, -3 - 4 * sympy.I, -3 + 4 * sympy.I, -3 - 4 * sympy.I],
    [-7, -7, -1 + 2 * sympy.I, -1 - 2 * sympy.I, -1 + 2 * sympy.I, -1 - 2 * sympy.I, -4],
    [-1, -1, sympy.Rational(-11, 10), sympy.Rational(-11, 10), -9],
    [2, 2, -2, -2],
]


@pytest.mark.parametrize("roots", SETS)
@pytest.mark.parametrize("seed", range(3))
def test_multiple_roots_are_one_whatever_round_off_makes_of_them(roots, seed):
    """The matrix is changed within its rounding, as another order of operations changes it."""
    A, slopes = companion(roots)
    rng = np.random.default_rng(seed)
    A = A * (1 + rng.integers(-4, 5, A.shape) * np.finfo(float).eps)
    result = poles(A, slopes, spread=NOTHING)
    expected = Counter(complex(root) for root in roots)
    for value, count in zip(result.values, multiplicities(result), strict=True):
        nearest = min(expected, key=lambda root: abs(root - value))
        assert abs(value - nearest) <= 1e-7 * abs(nearest)
        assert count == expected[nearest]
        assert (value.imag == 0) == (nearest.imag == 0)
    for cluster in result.clusters:
        nearest = min(expected, key=lambda root: abs(root - cluster.centre))
        assert abs(cluster.centre - nearest) <= cluster.radius
        assert np.isinf(result.slopes[cluster.places]).all()


@settings(deadline=None)
@given(
    st.lists(st.integers(1, 20), min_size=1, max_size=3, unique=True),
    st.lists(st.integers(1, 3), min_size=3, max_size=3),
    st.fractions(Fraction(1, 50), 1, max_denominator=60),
)
def test_distinct_roots_stay_apart(places, counts, step):
    """Roots at a distance that rounding of the coefficients does not bridge are clusters of their own."""
    roots = [-place * sympy.Rational(step.numerator, step.denominator) for place in places]
    repeated = [root for root, count in zip(roots, counts, strict=False) for _ in range(count)]
    A, slopes = companion(repeated)
    result = poles(A, slopes, spread=NOTHING)
    if len(places) == 1:
        assert set(multiplicities(result)) == {len(repeated)}
    separate = [
        place
        for place in places
        if all(abs(place - other) > 0.3 * place for other in places if other != place)
    ]
    for place in separate:
        root, count = float(-place * step), counts[places.index(place)]
        near = np.abs(result.values - root) <= 0.05 * abs(root)
        assert near.sum() == count
        assert (multiplicities(result)[near] == count).all()


def test_roots_of_separate_blocks_are_told_from_near_ones():
    """Eigenvalues of a diagonal matrix are exact: equal ones are one, those beside are not."""
    A = np.diag([-1.0, -1.0, -1.0 - 1e-11, -5.0])
    result = poles(A, np.zeros((1, 4, 4)), spread=NOTHING)
    assert sorted(multiplicities(result)) == [1, 1, 2, 2]


def test_roots_within_the_errors_of_the_parameters_are_one():
    """A pair -10 ± d and an error of the parameter that moves one of them by more, or by less, than d."""
    A, slopes = np.diag([-10.0, -10.000002]), np.zeros((1, 2, 2))
    slopes[0, 0, 0] = 1.0
    assert poles(A, slopes, spread=np.array([1e-8])).clusters == ()
    (cluster,) = poles(A, slopes, spread=np.array([1e-5])).clusters
    assert cluster.centre == pytest.approx(-10.000001, rel=1e-12)


def chain(count, stiffness, damping):
    """Return masses in a row between springs with dampers: the force on the first, the last one measured."""
    m = np.arange(1, count + 1) / 2
    K = np.zeros((count, count))
    for k in range(count - 1):
        K[k : k + 2, k : k + 2] += np.array([[1, -1], [-1, 1]]) * (k + 1)
    K[0, 0] += 1
    A = np.zeros((2 * count, 2 * count))
    A[:count, count:] = np.eye(count)
    A[count:, :count], A[count:, count:] = -stiffness * K / m[:, None], -damping * K / m[:, None]
    b, c = np.zeros(2 * count), np.zeros(2 * count)
    b[count], c[count - 1] = 1 / m[0], 1
    none = np.zeros((1, 2 * count))
    return ParametricSystem(A, b, c, 0.0, np.zeros((1, *A.shape)), none, none, np.zeros(1))


@pytest.mark.parametrize(("count", "stiffness", "damping"), [(3, 2e4, 20), (4, 700.0, 3.5), (5, 90.0, 0.6)])
def test_every_link_between_force_and_sensor_is_a_zero_at_the_same_place(count, stiffness, damping):
    """Each link has the factor c s + k: with equal quotients -k/c is as multiple as there are links."""
    result = zeros(chain(count, stiffness, damping), spread=NOTHING)
    assert len(result.values) == count - 1
    np.testing.assert_allclose(result.values, -stiffness / damping, rtol=1e-10)
    assert (result.values.imag == 0).all()
    assert (multiplicities(result) == count - 1).all()


@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_a_sensor_across_the_plane_of_motion_has_no_zeros(angle):
    """Two decoupled rows of masses, and a sensor that sees none of the first, by direction or by symmetry."""
    one, other = chain(4, 3e4, 5.0), chain(4, 8e4, 9.0)
    n = len(one.A)
    A = np.block([[one.A, np.zeros((n, n))], [np.zeros((n, n)), other.A]])
    b, c = np.concatenate([one.b, 0 * other.b]), np.concatenate([0 * one.c, other.c])
    turn = np.eye(2 * n)
    if angle:  # a mirror-symmetric pair, in the coordinates of its halves: what is measured cancels
        A[n:, n:] = one.A
        turn = np.kron(np.array([[1, 1], [1, -1]]) / np.sqrt(2), np.eye(n))
        c = np.concatenate([0 * one.c, one.c])
    A, b, c = turn @ A @ turn.T, turn @ b, c @ turn.T
    if angle:
        assert np.abs(c @ np.linalg.solve(3j * np.eye(2 * n) - A, b)) < 1e-12
    none = np.zeros((1, 2 * n))
    system = ParametricSystem(A, b, c, 0.0, np.zeros((1, *A.shape)), none, none, np.zeros(1))
    assert zeros(system, spread=NOTHING) is None
