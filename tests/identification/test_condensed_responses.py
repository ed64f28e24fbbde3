"""Responses condensed to what unknown parameters act on: against 50 digits, and the work that they save."""

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dynid.identification.systems.structure_system import StructureSystem
from dynid.lti import frequency_response
from dynid.structure.dynamic_condensation import ActiveCoordinates
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel

pytestmark = pytest.mark.thorough

PAIRS = [(0, 0), (1, 0), (0, 1)]


def chain(joints, damping=1e-3, n=10):
    """A chain of masses with stiffness and damping, and joints."""
    links = [Link((k,) if k == 1 else (k - 1, k), 1e4 + 700 * k, damping * 1e4) for k in range(1, n + 1)]
    return lumped([1 + 0.1 * k for k in range(n)], links, joints)


def joint(name, dofs, matrix=None):
    """A joint with unknown stiffness and damping, of one motion or of several DOFs by a matrix."""
    return Joint(
        name, dofs, JointParameter(start=1.0, matrix=matrix), JointParameter(start=1.0, matrix=matrix)
    )


def system(model):
    channels = [Channel(2, "acceleration"), Channel(9, "displacement", 3)]
    loads = [channels[0].unit_load(dof) for dof in (5, 9)]
    return StructureSystem(model, loads, channels)


def in_many_digits(model, values, omega):
    """Responses of PAIRS (L x pairs): the dynamic stiffness inverted in 50 digits."""
    with mp.workdps(50):
        zero = dict.fromkeys(values, 0.0)
        matrices = [mp.matrix(part.tolist()) for part in model.dense(zero)]
        for name, value in values.items():  # joints are affine in their own values
            for letter, change in model.slopes(zero, [name])[0].items():
                for i, j in np.argwhere(change):
                    matrices["MCK".index(letter)][i, j] += value * mp.mpf(float(change[i, j]))
        M, C, K = matrices
        found = []
        for w in omega:
            s = mp.mpc(0, float(w))
            x, y = (mp.lu_solve(K + s * C + s**2 * M, mp.eye(len(K))[:, load - 1]) for load in (5, 9))
            found.append([s**2 * x[1], x[8] - x[2], s**2 * y[1]])
        return mp.matrix(found)


RIGID = np.outer([1, -2, 1], [1, -2, 1]).astype(float)
JOINTS = {
    "between two DOFs": [joint("a", (4, 6))],
    "to ground": [joint("a", (7,))],
    "of a block": [joint("a", (3, 5, 8), tuple(map(tuple, RIGID)))],
    "several at shared DOFs": [joint("a", (4, 6)), joint("b", (6, 7)), joint("c", (4, 7))],
}


@pytest.mark.parametrize("joints", JOINTS.values(), ids=JOINTS.keys())
def test_responses_and_derivatives_are_those_of_many_digits(joints):
    model = chain(joints)
    omega = np.linspace(5, 250, 5)
    values = {one.name: 3.7 * 10.0 ** (3 * one.name.endswith("k")) for one in model.unknowns}
    made = system(model)
    H, slopes = made.paired_response(values, omega, PAIRS)
    assert made._condensed(omega, PAIRS) is not None
    exact = in_many_digits(model, values, omega)
    assert np.allclose(H, np.array(exact.tolist(), dtype=complex), rtol=1e-11, atol=0)
    for place, name in enumerate(values):
        with mp.workdps(50):
            step = mp.mpf(10) ** -20
            moved = in_many_digits(model, {**values, name: values[name] + step}, omega)
            by_value = np.array(((moved - exact) / step).tolist(), dtype=complex)
        scale = np.abs(by_value).max()
        assert np.abs(slopes[..., place] - by_value).max() < 1e-10 * scale


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_changes_of_any_size_leave_responses_exact(seed):
    rng = np.random.default_rng(seed)
    model = chain([joint("a", (4, 6)), joint("b", (9,))], damping=10 ** rng.uniform(-6, -2))
    omega = np.sort(rng.uniform(1, 300, 2))
    values = {one.name: 10 ** rng.uniform(-3, 7) for one in model.unknowns}
    made = system(model)
    found, whole = (
        made.paired_response(values, omega, PAIRS)[0],
        made._whole_response(values, omega, PAIRS, slopes=False)[0],
    )
    exact = np.array(in_many_digits(model, values, omega).tolist(), dtype=complex)
    least = np.abs(exact).max(axis=0)
    assert np.all(np.abs(found - exact) <= 1e-10 * least + 10 * np.abs(whole - exact))


def test_a_line_on_a_resonance_of_the_eliminated_part_is_solved_whole():
    model = chain([joint("a", (5,)), joint("b", (10,))], damping=0.0)
    M, _, K = (part[:4, :4] for part in model.dense({"a.k": 0.0, "a.c": 0.0, "b.k": 0.0, "b.c": 0.0}))
    inner = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min())
    omega = np.array([10.0, inner, 40.0])
    values = {"a.k": 2e3, "a.c": 30.0, "b.k": 10.0, "b.c": 4.0}
    H, _ = system(model).paired_response(values, omega, PAIRS)
    assert np.allclose(H, np.array(in_many_digits(model, values, omega).tolist(), dtype=complex), rtol=1e-9)


def test_all_but_the_joints_is_solved_once(monkeypatch):
    solved, solve = [], np.linalg.solve

    def counted(Z, right):
        solved.append(Z.shape)
        return solve(Z, right)

    monkeypatch.setattr(frequency_response.np.linalg, "solve", counted)
    made, omega = system(chain([joint("a", (4, 6))])), np.linspace(5, 250, 12)
    for k in (1.0, 10.0, 100.0):
        made.paired_response({"a.k": k, "a.c": 1.0}, omega, PAIRS)
    assert solved == [(12, 9, 9), *3 * [(12, 1, 1)]]


def test_nothing_is_eliminated_where_unknowns_act_nearly_everywhere():
    matrix = tuple(map(tuple, np.eye(8).tolist()))
    made, omega = system(chain([joint("a", tuple(range(1, 9)), matrix)])), np.linspace(5, 250, 12)
    assert made._condensed(omega, PAIRS) is None
    values = {"a.k": 40.0, "a.c": 2.0}
    H, _ = made.paired_response(values, omega, PAIRS)
    assert np.allclose(
        H, np.array(in_many_digits(made.model, values, omega).tolist(), dtype=complex), rtol=1e-10
    )


def test_coordinates_are_combinations_of_dofs_only_where_the_rank_is_clear():
    row = np.array([0.0, 1.0, 0.0, -1.0])
    part = np.outer(row, row)
    found = ActiveCoordinates.of([part])
    assert (found.count, found.places.tolist()) == (1, [1, 3])
    assert found.active @ found.block(part) @ found.active.T == pytest.approx(part[1::2, 1::2], abs=1e-14)
    unclear = part + 1e-11 * np.outer(np.abs(row), np.abs(row))
    assert ActiveCoordinates.of([unclear]).count == 2
