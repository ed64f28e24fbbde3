"""Frequency response functions by modes and by direct solution."""

import numpy as np
import pytest
import scipy.sparse as sp

from dynid.errors import NumericalError, UsageError
from dynid.structure.frf import frequency_response_functions
from dynid.structure.joints import Joint
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel, Ports
from dynid.structure.response import frequency_response

from .pencils import free_string, grid, string

OMEGA = np.linspace(0.05, 0.6, 40)


def unit(n, *places):
    return np.eye(n)[list(places)]


def ports(n, powers=(0, 1, 2)):
    return Ports(unit(n, 7, n // 2).T, unit(n, 7, n // 3, n - 2), list(powers))


def closed_form(n, alpha, beta, where, omega):
    """The response of a membrane from its products of sines, with Rayleigh damping."""
    _, one = string(n)
    place = np.arange(1, n + 1)
    sine = np.sqrt(2 / (n + 1)) * np.sin(np.outer(place, place) * np.pi / (n + 1))
    shapes, square = np.kron(sine, sine), np.add.outer(one, one).ravel()
    out = []
    for w in omega:
        gain = 1 / (square - w**2 + 1j * w * (alpha + beta * square))
        H = (where.rows @ shapes * gain) @ (shapes.T @ where.forces)
        out.append((1j * w) ** np.array(where.powers)[:, None] * H)
    return np.array(out)


@pytest.mark.parametrize(("method", "rtol"), [("direct", 1e-10), ("modal", 1e-7), ("auto", 1e-7)])
@pytest.mark.parametrize(("alpha", "beta"), [(0.0, 0.0), (0.01, 0.003)])
def test_receptance_mobility_accelerance_of_a_membrane(method, rtol, alpha, beta):
    K, _ = grid(24)
    M = sp.eye_array(576, format="csc")
    C = sp.csc_array(alpha * M + beta * K)
    where = ports(576)
    found = frequency_response_functions(M, C, K, where, OMEGA, method=method)
    exact = closed_form(24, alpha, beta, where, OMEGA)
    size = np.abs(exact) + np.median(np.abs(exact), axis=0)
    assert (np.abs(found.response - exact) / size).max() < rtol
    assert found.method == ("direct" if method == "direct" else "modal")


@pytest.mark.thorough
def test_modes_and_direct_solution_agree_with_a_damped_joint_and_rigid_bodies():
    K, _ = grid(24, free_string)
    jointed = StructuralModel(
        sp.eye_array(576, format="csc"),
        0.001 * K,
        K,
        (Joint("j", (3, 400), 0.7, 2.5), Joint("g", (9,), c=1.0)),
    )
    channels = [Channel(3, "displacement"), Channel(400, "acceleration"), Channel(9, "velocity")]
    asked = (jointed, [400, 20], channels, OMEGA)
    modal = frequency_response(*asked, method="modal", accuracy=1e-9)
    direct = frequency_response(*asked, method="direct")
    group = "structure/frequency_response"
    H, exact = (result.value(f"{group}/response") for result in (modal, direct))
    size = np.abs(exact) + np.median(np.abs(exact), axis=0)
    assert (np.abs(H - exact) / size).max() < 1e-8
    attrs = modal.group_attrs[group]
    assert (attrs["method"], attrs["error"] < 1e-8, attrs["modes"] > 0) == ("modal", True, True)
    assert direct.group_attrs[group]["method"] == "direct"


def test_few_frequencies_and_small_models_are_solved_directly():
    K, _ = grid(24)
    M = sp.eye_array(576, format="csc")
    assert frequency_response_functions(M, 0 * K, K, ports(576), [0.1, 0.2]).method == "direct"
    small, _ = grid(8)
    one = frequency_response_functions(sp.eye_array(64, format="csc"), 0 * small, small, ports(64), OMEGA)
    assert (one.method, one.modes, one.error) == ("direct", 0, 0.0)


def test_static_response_alone_needs_no_modes():
    K, _ = grid(24)
    M = sp.eye_array(576, format="csc")
    where = ports(576, (0, 0, 0))
    found = frequency_response_functions(M, 0 * K, K, where, [0.0], method="modal")
    exact = where.rows @ np.linalg.solve(K.toarray(), where.forces)
    np.testing.assert_allclose(found.response[0], exact, rtol=1e-9)
    assert (found.modes, found.vectors > 0) == (0, True)


@pytest.mark.parametrize("method", ["direct", "modal"])
def test_an_undamped_pole_is_infinite_either_way(method):
    K = sp.csc_array(sp.block_diag([np.array([[4.0]]), string(249)[0]]))
    M = sp.eye_array(250, format="csc")
    where = Ports(unit(250, 0).T, unit(250, 0), [0])
    found = frequency_response_functions(M, 0 * K, K, where, [1.0, 2.0], method=method)
    np.testing.assert_allclose(found.response.ravel(), [1 / 3, np.inf], rtol=1e-12)


def test_an_accuracy_out_of_reach_is_said():
    K, _ = grid(24)
    M = sp.eye_array(576, format="csc")
    with pytest.raises(NumericalError, match="residual vectors has errors"):
        frequency_response_functions(M, 0 * K, K, ports(576), OMEGA, method="modal", accuracy=1e-18)


def test_methods_have_names():
    with pytest.raises(UsageError, match="did you mean 'modal'"):
        frequency_response_functions(np.eye(9), np.eye(9), np.eye(9), ports(9), [1.0], method="modl")
