"""Parameters of any sign, themselves states of the filter (K. T. Yang 1997, eq 12 to the letter).

The oracle is the extended Kalman filter as textbooks have it: covariance instead of its root, transitions by
one matrix exponential of states and generators, their derivatives by complex steps.
"""

import numpy as np
import pytest
from scipy.linalg import expm

import dynid
from dynid.arithmetic.dependent import Dependent
from dynid.identification.estimators.filter import filter_pass
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.records.measurement import Measurement, Simulation
from dynid.identification.systems.parametric_model import parametric_model
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Multisine
from dynid.native import VARIABLE
from dynid.parameters import Parameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load

pytestmark = pytest.mark.thorough

STEP, SAMPLES = 0.02, 250
AMPLITUDES, FREQUENCIES = [20.0, 15.0], [9.0, 21.0]
NOISE = np.array([0.02, 0.3, 0.004])
TRUE = {"k": 300.0, "c": 2.0, "d": 0.0, "kx": -40.0}
START = {"k": 200.0, "c": 1.0, "d": 0.6, "kx": 30.0}
FIRST = np.array([150.0, 2.0, 1.0, 80.0])  # standard deviations before the first sample


def plant():
    """Three masses; a damper that is absent and a negative stiffness among the unknowns."""
    p = {name: Dependent.parameter(name, value) for name, value in TRUE.items()}
    links = [
        Link((1,), 250.0, 1.0), Link((1, 2), p["k"], p["c"]), Link((2, 3), 180.0, 0.5),
        Link((3,), 90.0, p["d"]), Link((1, 3), p["kx"]),
    ]  # fmt: skip
    parameters = [Parameter(name, START[name], true=value, scale="linear") for name, value in TRUE.items()]
    return lumped([1.0, 2.0, 1.5], links, parameters=parameters)


LOADS = [Load(1, Multisine(AMPLITUDES, FREQUENCIES))]
CHANNELS = (Channel(2, "velocity"), Channel(1, "acceleration"), Channel(3, "displacement"))


def generator(theta):
    """Return the matrix of d/dt [x, v, w] with w the sines and cosines, and the outputs' rows."""
    k, c, d, kx = theta
    mass = np.array([1.0, 2.0, 1.5])
    K = np.array([[250 + k + kx, -k, -kx], [-k, k + 180, -180], [-kx, -180, 180 + 90 + kx]])
    C = np.array([[1.0 + c, -c, 0], [-c, c + 0.5, -0.5], [0, -0.5, 0.5 + d]])
    A = np.zeros((10, 10), dtype=complex)
    A[:3, 3:6] = np.eye(3)
    A[3:6, :3], A[3:6, 3:6] = -K / mass[:, None], -C / mass[:, None]
    for j, (amplitude, omega) in enumerate(zip(AMPLITUDES, FREQUENCIES, strict=True)):
        A[3, 6 + 2 * j] = amplitude / mass[0]
        A[6 + 2 * j, 7 + 2 * j], A[7 + 2 * j, 6 + 2 * j] = omega, -omega
    rows = np.zeros((3, 10), dtype=complex)
    rows[0, 4], rows[1], rows[2, 2] = 1, A[3], 1
    return A, rows


def slopes(function, theta):
    """Return a function of the parameters and its derivatives, by complex steps."""
    each = [function(theta + 1e-30j * np.eye(len(theta))[k]).imag / 1e-30 for k in range(len(theta))]
    return function(theta.astype(complex)).real, np.stack(each, axis=-1)


def extended_kalman_filter(measured, theta, P):
    """Return estimates, deviations and states at every sample of the textbook's filter."""
    z = np.concatenate([np.zeros(6), theta])
    phases = STEP * np.arange(len(measured))[:, None] * FREQUENCIES
    sines = np.stack([np.sin(phases), np.cos(phases)], axis=2).reshape(-1, 4)
    found = []
    for sample, (values, w) in enumerate(zip(measured, sines, strict=True)):
        if sample:
            before = np.concatenate([z[:6], sines[sample - 1]])
            phi = expm(generator(z[6:])[0] * STEP).real
            moved, by_theta = slopes(lambda at, x=before: (expm(generator(at)[0] * STEP) @ x)[:6], z[6:])
            F = np.block([[phi[:6, :6], by_theta], [np.zeros((4, 6)), np.eye(4)]])
            z, P = np.concatenate([moved, z[6:]]), F @ P @ F.T
        here = np.concatenate([z[:6], w])
        rows = generator(z[6:])[1].real
        expected, by_theta = slopes(lambda at, x=here: generator(at)[1] @ x, z[6:])
        H = np.concatenate([rows[:, :6], by_theta], axis=1)
        gain = np.linalg.solve(H @ P @ H.T + np.diag(NOISE**2), H @ P).T
        z = z + gain @ (values - expected)
        P = (np.eye(10) - gain @ H) @ P
        P = (P + P.T) / 2
        found.append((z.copy(), np.sqrt(P.diagonal())))
    return (np.array(part) for part in zip(*found, strict=True))


@pytest.mark.parametrize("wish", ["0", "1"])
def test_the_filter_is_the_extended_kalman_filter_of_stiffness_and_damping(monkeypatch, wish):
    monkeypatch.setenv(VARIABLE, wish)
    measurement = Measurement(STEP, SAMPLES, CHANNELS, Simulation(0.02, 5))
    model = parametric_model(plant(), LOADS, CHANNELS, measurement.record.times)
    measured = data(plant(), LOADS, measurement).values
    deviations = np.concatenate([np.full(3, 0.1), np.ones(3), FIRST])
    start = np.array(list(START.values()))
    root = np.diag(deviations / np.concatenate([model.scale, np.ones(4)]))
    found = filter_pass(model, measured, InitialState(np.zeros(6), start, root), NOISE, start, fraction=0.0)
    z, spread = extended_kalman_filter(measured, start, np.diag(deviations**2.0))
    assert np.abs(z[-1, 6:] - list(TRUE.values())).max() < 4.5 * spread[-1, 6:].max()
    for own, wanted in (
        (found.eta, z[:, 6:]),
        (found.deviations, spread[:, 6:]),
        (found.states * model.scale, z[:, :6]),
        (found.state_deviations * model.scale, spread[:, :6]),
    ):
        size = np.abs(wanted).max(axis=0)
        np.testing.assert_allclose(own / size, wanted / size, rtol=0, atol=1e-8)


SCENE = f"""
dynid: 1
kind: identification
parameters:
  k: {{start: 200, true: 300, scale: linear}}
  c: {{start: 1, true: 2, scale: linear}}
  d: {{start: 0.6, true: 0, scale: linear}}
  kx: {{start: 30, true: -40, scale: linear}}
structure:
  lumped:
    masses: [1, 2, 1.5]
    links:
      - {{dofs: [1], k: 250, c: 1}}
      - {{dofs: [1, 2], k: k, c: c}}
      - {{dofs: [2, 3], k: 180, c: 0.5}}
      - {{dofs: [3], k: 90, c: d}}
      - {{dofs: [1, 3], k: kx}}
excitation: [{{dof: 1, kind: multisine, amplitude: {AMPLITUDES}, frequency: {FREQUENCIES}}}]
measurement:
  step: {STEP}
  samples: {SAMPLES}
  channels:
    - {{dof: 2, quantity: velocity}}
    - {{dof: 1, quantity: acceleration}}
    - {{dof: 3, quantity: displacement}}
  simulate: {{noise_ratio: 0.02, seed: 5}}
"""


@pytest.mark.parametrize(
    "method", ["filter, passes: 4", "auto", "output-error", "invariant-imbedding, tolerance: 1.0e-3"]
)
def test_values_of_zero_and_below_are_estimated_within_their_bounds(tmp_path, method):
    scene = f"{SCENE}estimator: {{method: {method}}}\n"
    if "imbedding" in method:  # half of the record takes a second
        scene = scene.replace(f"samples: {SAMPLES}", f"samples: {SAMPLES // 2}")
    (tmp_path / "scene.yaml").write_text(scene)
    result = dynid.run(dynid.load_scene(tmp_path / "scene.yaml"))
    estimate, true, bound, error = (
        np.asarray(result.value(f"identification/parameters/{name}"))
        for name in ("estimate", "true", "cramer_rao", "standard_error")
    )
    np.testing.assert_array_equal(true, list(TRUE.values()))
    assert np.all(np.abs(estimate - true) < 4.5 * bound)
    np.testing.assert_allclose(error, bound, rtol=0.15)
    if method in ("auto", "output-error"):
        assert result.value("identification/diagnostics/converged")
