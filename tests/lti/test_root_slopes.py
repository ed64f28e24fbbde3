"""Poles and zeros with their derivatives, against closed forms and against mpmath."""

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.lti.root_slopes import poles, zeros, zeros_of_all
from dynid.lti.state_space import ParametricSystem


def oscillator(k, c, m=2.0):
    """A mass on a spring and a damper (states x, v); slopes by k and c."""
    A = np.array([[0.0, 1.0], [-k / m, -c / m]])
    slopes = np.zeros((2, 2, 2))
    slopes[0, 1, 0], slopes[1, 1, 1] = -1 / m, -1 / m
    return A, slopes


def test_the_poles_of_one_mass_are_those_of_the_formula():
    k, c, m = 800.0, 4.0, 2.0
    found = poles(*oscillator(k, c))
    root = np.sqrt(complex(c * c - 4 * m * k))
    np.testing.assert_allclose(found.values, [(-c + root) / (2 * m), (-c - root) / (2 * m)], rtol=1e-13)
    by_k = np.array([-1 / root, 1 / root])
    by_c = np.array([(-1 + c / root) / (2 * m), (-1 - c / root) / (2 * m)])
    np.testing.assert_allclose(found.slopes, np.column_stack([by_k, by_c]), rtol=1e-12)


def test_a_critically_damped_pole_has_no_derivative():
    assert np.isinf(poles(*oscillator(800.0, 80.0)).slopes).all()


def test_poles_at_the_origin_are_exact_and_stay_there():
    A, slopes = oscillator(0.0, 4.0)
    found = poles(A, slopes)
    assert found.origin == 1
    assert found.values.tolist() == [0, -2]
    assert not found.slopes[0].any()
    free = np.zeros((2, 2))
    free[0, 1] = 1.0
    assert poles(free).origin == 2


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration"])
def test_each_derivative_of_an_output_adds_a_zero_at_the_origin(quantity):
    A, slopes = oscillator(800.0, 4.0)
    none = np.zeros((2, 2))
    row = {"displacement": [1.0, 0.0], "velocity": [0.0, 1.0], "acceleration": A[1]}[quantity]
    rows = slopes[:, 1] if quantity == "acceleration" else none
    direct = 0.5 if quantity == "acceleration" else 0.0
    found = zeros(
        ParametricSystem(A, np.array([0.0, 0.5]), np.array(row), direct, slopes, none, rows, np.zeros(2))
    )
    order = {"displacement": 0, "velocity": 1, "acceleration": 2}[quantity]
    assert found.origin == len(found.values) == order


def test_an_input_without_effect_has_no_zeros():
    A, none = np.diag([-1.0, -2.0]), np.zeros((0, 2))
    apart = ParametricSystem(
        A, np.array([1.0, 0]), np.array([0, 1.0]), 0.0, np.zeros((0, 2, 2)), none, none, np.zeros(0)
    )
    assert zeros(apart) is None


def exact_zeros(parts, changes, step):
    """Zeros of c (s - A)^-1 b + d as roots of det [s - A, -b; c, d], at parts + step changes."""
    n = len(parts[0])
    A, b, c, d = (
        np.vectorize(lambda x, dx: mpmath.mpf(float(x)) + step * mpmath.mpf(float(dx)), otypes=[object])(
            one, by
        )
        for one, by in zip(parts, changes, strict=True)
    )

    def determinant(s):
        P = mpmath.matrix(n + 1, n + 1)
        for i in range(n):
            for j in range(n):
                P[i, j] = (s if i == j else 0) - A[i, j]
            P[i, n], P[n, i] = -b[i], c[i]
        P[n, n] = d.item()
        return mpmath.det(P)

    points = [mpmath.mpf(k) for k in range(n + 1)]
    powers = mpmath.matrix([[point**power for power in range(n + 1)] for point in points])
    found = mpmath.lu_solve(powers, mpmath.matrix([determinant(point) for point in points]))
    return list(mpmath.polyroots([found[k] for k in range(n, -1, -1)], maxsteps=1000, extraprec=400))


@pytest.mark.thorough
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 5))
def test_zeros_and_their_derivatives_are_those_of_the_determinant(seed, n):
    generator = np.random.default_rng(seed)
    A, b, c = generator.normal(size=(n, n)), generator.normal(size=n), generator.normal(size=n)
    parts = (A, b, c, 1.0 + generator.random())
    changes = [generator.normal(size=np.shape(one)) for one in parts]
    found = zeros(ParametricSystem(*parts, *(np.asarray(one)[None] for one in changes)))
    with mpmath.workdps(60):
        step = mpmath.mpf("1e-20")
        reference, lower, upper = (exact_zeros(parts, changes, side * step) for side in (0, -1, 1))
        for value, slope in zip(found.values, found.slopes[:, 0], strict=True):
            exact = min(reference, key=lambda z: abs(z - mpmath.mpc(value)))
            ends = [min(one, key=lambda z: abs(z - exact)) for one in (lower, upper)]
            moved = complex((ends[1] - ends[0]) / (2 * step))
            near = min([abs(z - exact) for z in reference if z != exact], default=1)
            trust = 1e-9 * (1 + abs(value)) / float(min(near, 1)) ** 2
            assert abs(complex(exact) - value) < trust
            assert abs(moved - slope) < trust * (1 + abs(slope)) ** 2


def test_samples_of_different_relative_degree_have_their_own_zeros():
    """With c = [k, 1] the zero is -k; with c = [k, 0] there is none."""
    A, slopes = oscillator(800.0, 4.0)
    none, b = np.zeros((2, 2)), np.array([0.0, 0.5])
    each = [
        ParametricSystem(A, b, np.array(c), 0.0, slopes, none, none, np.zeros(2))
        for c in ([3.0, 1.0], [3.0, 0.0])
    ]
    found = zeros_of_all([*each, each[0]], np.ones(2))
    assert [len(one.values) for one in found] == [1, 0, 1]
    np.testing.assert_allclose(found[0].values, [-3.0], rtol=1e-13)
