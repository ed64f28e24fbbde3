"""Frequency responses, against closed forms and direct inversion."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.errors import Singular, UsageError
from dynid.lti.frequency_response import at_a_pole, frequency_response, second_order_response
from dynid.lti.state_space import StateSpace

OMEGA = np.geomspace(0.01, 1e4, 200)


def test_oscillator_and_improper_terms():
    system = StateSpace([[0, 1], [-100, -2]], [[0], [1]], [[1, 0]], [[3.0]], ([[0.5]], [[0.1]]))
    s = 1j * OMEGA
    np.testing.assert_allclose(
        frequency_response(system, OMEGA)[:, 0, 0],
        1 / (s**2 + 2 * s + 100) + 3 + 0.5 * s + 0.1 * s**2,
        rtol=1e-13,
    )


def test_a_system_without_states():
    system = StateSpace(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), [[1.0, 2.0]])
    np.testing.assert_array_equal(frequency_response(system, [1.0, 2.0]), np.tile([[1.0, 2.0]], (2, 1, 1)))


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_receptance_mobility_and_accelerance_of_random_structures(seed):
    rng = np.random.default_rng(seed)
    R = rng.standard_normal((3, 3, 3))
    M, C, K = (part @ part.T + 0.1 * np.eye(3) for part in R)
    K = 1e4 * K
    omega = rng.uniform(0, 300, 5)
    H = second_order_response(M, C, K, np.eye(3), np.eye(3), [0, 1, 2], omega)
    for w, h in zip(omega, H, strict=True):
        Z = np.linalg.inv(K + 1j * w * C - w**2 * M)
        np.testing.assert_allclose(h, np.diag([1, 1j * w, -(w**2)]) @ Z, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize("unit", [1.0, 1e-8, 1e8])
def test_an_undamped_resonance_is_infinite_in_any_unit(unit):
    M, C, K = np.array([[4.0]]), np.zeros((1, 1)), np.array([[100.0]]) * unit
    omega = 5 * np.sqrt(unit)
    ok = second_order_response(M, C, K, np.eye(1), np.eye(1), [0], [omega * (1 + 1e-6)])
    assert ok[0, 0, 0] == pytest.approx(1 / (-100 * unit * (2e-6 + 1e-12)), rel=1e-8)
    found = second_order_response(M, C, K, np.eye(1), np.eye(1), [0], [0.0, omega])
    np.testing.assert_allclose(found.ravel(), [1 / K[0, 0], np.inf], rtol=1e-15)
    system = StateSpace([[0, 1], [-25 * unit, 0]], [[0], [1]], [[1, 0]], [[0]])
    assert np.isinf(frequency_response(system, [omega])).all()


def test_a_rigid_body_drifts_away_at_rest_unless_its_forces_balance():
    M, C, K = np.eye(2), np.zeros((2, 2)), np.array([[1.0, -1], [-1, 1]])
    forces = np.array([[1.0, 1], [0, -1]])
    found = second_order_response(M, C, K, forces, np.ones((3, 1)) @ [[1.0, 0]], [0, 1, 2], [0.0])[0]
    # The first accelerates both masses, 1/2 each; the second stretches the spring to either side.
    np.testing.assert_allclose(found, [[np.inf, 0.5], [np.inf, 0], [0.5, 0]], atol=1e-15)
    H = second_order_response(M, C, K, np.eye(2), np.eye(2), [0, 0], [1e-3])
    assert H[0].sum() == pytest.approx(-2 / 1e-6, rel=1e-9)
    assert np.isinf(frequency_response(StateSpace([[0.0]], [[1.0]], [[1.0]], [[0.0]]), [0.0])).all()


def test_at_a_pole_only_what_its_mode_is_in_is_infinite():
    """Three masses in a row, held at both ends: the middle one is a node of the second mode."""
    K = np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 2]])
    M, C, omega = np.eye(3), np.zeros((3, 3)), np.sqrt(2.0)
    found = second_order_response(M, C, K, np.eye(3), np.eye(3), [0, 0, 0], [1.0, omega])[1]
    assert np.isinf(found[[0, 0, 2, 2], [0, 2, 0, 2]]).all()
    # By hand: a force at the middle holds it still, and each end takes half of it, as the ends balance it.
    np.testing.assert_allclose(found[1], [-0.5, 0, -0.5], atol=1e-12)
    np.testing.assert_allclose(found[:, 1], [-0.5, 0, -0.5], atol=1e-12)


def test_a_damped_rigid_body_at_rest():
    """A free mass on a damper: x = F / (i w c - w^2 m); its velocity at rest is 1 / c."""
    one = np.eye(1)
    found = second_order_response(2 * one, 5 * one, 0 * one, one, np.ones((3, 1)), [0, 1, 2], [0.0])
    assert found.ravel().tolist() == [np.inf, 0.2, 0.0]


def test_mixed_units_do_not_look_singular():
    scale = np.diag([1.0, 1e7])
    K = scale @ np.array([[2.0, -1], [-1, 2]]) @ scale
    H = second_order_response(scale @ scale, 0.1 * K, K, np.eye(2), np.eye(2), [0, 0], [0.5])
    np.testing.assert_allclose(
        scale @ H[0] @ scale,
        np.linalg.inv(np.array([[2, -1], [-1, 2]]) * (1 + 0.05j) - 0.25 * np.eye(2)),
        rtol=1e-12,
    )


@pytest.mark.parametrize("omega", [[np.nan], [-1.0], [[1.0]]])
def test_nonsense_is_refused(omega):
    with pytest.raises(UsageError):
        frequency_response(StateSpace([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), omega)


def test_what_is_no_pole_or_none_of_second_order_cannot_be_told():
    eye, none, powers = np.eye(2), np.zeros((2, 2)), np.zeros(1, int)
    ask = (np.ones((1, 2)), np.ones((2, 1)), powers)
    with pytest.raises(Singular, match="pole"):
        at_a_pole((eye, eye, eye), *ask, 1.0)
    with pytest.raises(Singular, match="pole"):  # a double pole away from rest
        at_a_pole((np.diag([1.0, 0.0]), none, eye), *ask, 1.0)
    barely = np.array([[1.0, 1e-13]])  # the read-out sees the mode as much as rounding does
    with pytest.raises(Singular, match="pole"):
        at_a_pole((np.diag([1.0, 0.0]), eye, none), barely, np.ones((2, 1)), powers, 1.0)
    at_rest = at_a_pole((np.diag([1.0, 0.0]), none, eye), *ask, 0.0)
    assert np.isinf(at_rest).all()
