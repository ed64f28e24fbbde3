"""How poles move with joints, against finite differences of an eigenvalue problem of its own."""

import numpy as np
import pytest

from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.poles import pole_sensitivities


def chain(joints, masses=(2, 2, 1.5, 1, 1), ground=True):
    links = [Link((1, 2), 3e4, 30), Link((4, 5), 2e4, 20)]
    return lumped(masses, [*([Link((1,), 2e4, 20)] if ground else []), *links], joints)


def joint(name, dofs, k=2e4, c=20.0):
    return Joint(name, dofs, JointParameter(start=k), JointParameter(start=c))


def starts(model):
    return {unknown.name: unknown.start for unknown in model.unknowns}


def oracle(model, values):
    """Size and damping ratio of the poles with Im > 0, by the plain companion matrix."""
    M, C, K = model.dense(values)
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    poles = np.linalg.eigvals(A)
    poles = poles[poles.imag > 1e-6]
    poles = poles[np.argsort(np.abs(poles))]
    return np.abs(poles), -poles.real / np.abs(poles)


@pytest.mark.parametrize("damping", [0.0, 20.0, 150.0])
def test_slopes_are_the_finite_differences(damping):
    model = chain([joint("a", (2, 3), c=damping or 1e-9), joint("b", (3, 4), c=2 * damping or 1e-9)])
    values = starts(model)
    found = pole_sensitivities(model, values)
    omega, zeta = oracle(model, values)
    swing = found.poles.imag > 1e-6
    np.testing.assert_allclose(found.omega[swing], omega, rtol=1e-10)
    np.testing.assert_allclose(found.zeta[swing], zeta, rtol=1e-8, atol=1e-12)
    for j, name in enumerate(values):
        h = 1e-4 * max(values[name], 1.0)
        moved = [oracle(model, {**values, name: values[name] + s * h}) for s in (-2, -1, 1, 2)]
        for of, slopes in ((0, found.omega_slopes), (1, found.zeta_slopes)):
            a, b, c, d = (m[of] for m in moved)
            slope = (a - 8 * b + 8 * c - d) / (12 * h)
            # Rounding of the eigenvalues over the step.
            size = (omega if of == 0 else 1.0) * 1e-13 / h
            np.testing.assert_allclose(slopes[swing, j], slope, rtol=1e-5, atol=float(np.max(size) * 100))


def test_a_double_frequency_has_a_branch_for_each_way_to_move():
    """Two equal masses on springs: each joint moves one of them, and no basis of the plane is preferred."""
    k, m = 450.0, 2.0
    model = lumped(
        [m, m], [], [Joint("a", (1,), JointParameter(start=k)), Joint("b", (2,), JointParameter(start=k))]
    )
    found = pole_sensitivities(model, {"a.k": k, "b.k": k})
    omega = np.sqrt(k / m)
    np.testing.assert_allclose(found.omega, omega, rtol=1e-12)
    for j in range(2):
        np.testing.assert_allclose(np.sort(found.omega_slopes[:, j]), [0, 1 / (2 * m * omega)], atol=1e-12)
    between = lumped([m, m], [Link((1,), k), Link((2,), k)], [joint("j", (1, 2), k=1e-9, c=1e-9)])
    found = pole_sensitivities(between, {"j.k": 0.0, "j.c": 0.0})
    np.testing.assert_allclose(np.sort(found.omega_slopes[:, 0]), [0, 2 / (2 * m * omega)], atol=1e-12)
    np.testing.assert_allclose(np.sort(found.zeta_slopes[:, 1]), [0, 2 / (2 * m * omega)], atol=1e-12)


def test_rigid_bodies_are_left_out_and_overdamped_poles_are_there():
    free = lumped([1.0, 2.0], [], [joint("j", (1, 2), k=100.0, c=1.0)])
    found = pole_sensitivities(free, {"j.k": 100.0, "j.c": 1.0})
    mass = 2 / 3
    assert len(found.omega) == 1
    assert found.omega[0] == pytest.approx(np.sqrt(100 / mass))
    assert found.omega_slopes[0] == pytest.approx([0.5 / np.sqrt(100 * mass), 0], abs=1e-12)
    assert found.zeta_slopes[0, 1] == pytest.approx(0.5 / np.sqrt(100 * mass))
    heavy = pole_sensitivities(free, {"j.k": 100.0, "j.c": 100.0})
    assert heavy.zeta == pytest.approx([1, 1])
    np.testing.assert_allclose(heavy.zeta_slopes, 0, atol=1e-12)


def test_critical_damping_has_no_derivative():
    single = lumped([1.0], [], [joint("j", (1,), k=100.0, c=20.0)])
    found = pole_sensitivities(single, {"j.k": 100.0, "j.c": 20.0})
    assert np.all(np.isinf(found.omega_slopes))
