"""Responses of structures as results."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.sparse import csc_array

from dynid.errors import UsageError
from dynid.lti.signals import Impulse, Sine, Step
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel, Load
from dynid.structure.response import frequency_response, time_response

JOINT = Joint("j", (1, 2), JointParameter(start=100.0), 2.0)
MODEL = lumped([2.0, 1.0], [Link((1,), 300.0, 1.0)], [JOINT])
VALUES = {"j.k": 200.0}
CHANNELS = [Channel(1, "displacement"), Channel(2, "velocity"), Channel(2, "acceleration")]


def test_frequency_response_has_axes_units_and_values():
    omega = np.array([0.0, 1.0, 12.5, 300.0])
    result = frequency_response(MODEL, [2, 1], CHANNELS, omega, VALUES)
    group = "structure/frequency_response"
    H = result[f"{group}/response"]
    assert H.dims == ("omega", "output", "input")
    assert list(result.value(f"{group}/output")) == ["1.displacement", "2.velocity", "2.acceleration"]
    assert list(result.value(f"{group}/input")) == ["2", "1"]
    K = np.array([[500.0, -200], [-200, 200]])
    C = np.array([[3.0, -2], [-2, 2]])
    for w, h in zip(omega, H.data, strict=True):
        Z = np.linalg.inv(K + 1j * w * C - w**2 * np.diag([2.0, 1.0]))
        exact = np.array([[Z[0, 1], Z[0, 0]], 1j * w * Z[1, ::-1], -(w**2) * Z[1, ::-1]])
        np.testing.assert_allclose(h, exact, rtol=1e-12)
    assert (H.units, list(result.value(f"{group}/unit"))) == ("", ["m/N", "m/s/N", "m/s2/N"])
    assert frequency_response(MODEL, [2], CHANNELS[:1], [1.0], VALUES)[f"{group}/response"].units == "m/N"


def test_time_response_against_runge_kutta():
    t = np.linspace(0, 2, 41)
    loads = [Load(2, Sine(3.0, 11.0, 0.3)), Load(1, Step(2.0, 0.0)), Load(1, Impulse(0.4))]
    result = time_response(
        MODEL, loads, CHANNELS, t, values=VALUES, displacement={2: 0.01}, velocity={1: -0.1}
    )
    K = np.array([[500.0, -200], [-200, 200]])
    C = np.array([[3.0, -2], [-2, 2]])
    M = np.diag([2.0, 1.0])

    def acceleration(s, x):
        force = np.array([2.0, 3 * np.sin(11 * s + 0.3)])
        return np.linalg.solve(M, force - K @ x[:2] - C @ x[2:])

    run = solve_ivp(
        lambda s, x: np.concatenate([x[2:], acceleration(s, x)]),
        (0, 2),
        [0, 0.01, -0.1 + 0.2, 0],
        method="DOP853",
        rtol=1e-12,
        atol=1e-14,
        t_eval=t,
    )
    exact = [[x[0], x[3], acceleration(s, x)[1]] for s, x in zip(t, run.y.T, strict=True)]
    group = "structure/time_response"
    # The acceleration carries the Runge–Kutta run's own 1e-12 times K/M.
    np.testing.assert_allclose(result.value(f"{group}/response"), exact, rtol=0, atol=2e-10)
    assert result[f"{group}/unit"].dims == ("output",)
    assert list(result.value(f"{group}/unit")) == ["m", "m/s", "m/s2"]
    assert result[f"{group}/input"].dims == ("time", "source")
    assert list(result.value(f"{group}/source")) == ["2", "1#1", "1#2"]
    np.testing.assert_allclose(result.value(f"{group}/input")[:, 0], 3 * np.sin(11 * t + 0.3), atol=1e-13)


def test_a_free_decay_needs_no_load():
    t = np.linspace(0, 1, 5)
    result = time_response(
        lumped([4.0], [Link((1,), 100.0)]), [], [Channel(1, "velocity")], t, displacement={1: 2.0}
    )
    np.testing.assert_allclose(
        result.value("structure/time_response/response")[:, 0], -10 * np.sin(5 * t), atol=1e-13
    )
    assert result["structure/time_response/response"].units == "m/s"


def test_an_undamped_natural_frequency_is_infinite():
    found = frequency_response(lumped([4.0], [Link((1,), 100.0)]), [1], [Channel(1, "velocity")], [5.0])
    assert np.isinf(found.value("structure/frequency_response/response")).all()


@pytest.mark.parametrize("channel", [Channel(3, "velocity"), Channel(1, "speed")])
def test_channels_must_exist(channel):
    with pytest.raises(UsageError):
        frequency_response(MODEL, [1], [channel], [1.0], VALUES)


@pytest.mark.parametrize("points", [4, 7, 23, 61])
@pytest.mark.parametrize("sparse", [False, True])
def test_the_largest_magnitude_does_not_depend_on_the_frequencies(points, sparse):
    """One mass on a spring and damper: |x/f| = 1 / (c w_d) at w_p = sqrt(k/m - c^2 / (2 m^2))."""
    m, c, k = 2.0, 1.5, 800.0
    rest = 0 if not sparse else 500  # DOFs beside it that are not moved
    diagonal = [np.diag([own, *[other] * rest]) for own, other in ((m, 1.0), (c, 0.0), (k, 4e6))]
    if sparse:
        diagonal = [csc_array(matrix) for matrix in diagonal]
    model = StructuralModel(*diagonal)
    omega = np.linspace(3.0, 55.0, points)
    channels = [Channel(1, "displacement"), Channel(1, "velocity")]
    result = frequency_response(model, [1], channels, omega)
    if sparse and points <= 6:  # every other frequency would take a factorisation
        assert "structure/frequency_peaks/omega" not in result
        return
    peak, at = (result[f"structure/frequency_peaks/{name}"].data[:, 0] for name in ("magnitude", "omega"))
    damped = np.sqrt(k / m - (c / (2 * m)) ** 2)
    np.testing.assert_allclose(peak, [1 / (c * damped), 1 / c], rtol=1e-8)
    resonance = [np.sqrt(k / m - c**2 / (2 * m**2)), np.sqrt(k / m)]
    np.testing.assert_allclose(at, resonance, rtol=1e-5)  # a maximum is flat: the root of the accuracy
