"""Sensitivities, bound, filter and diagnostics, each against an independent oracle."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from scipy.stats import kstest

from dynid.errors import NotIdentifiable
from dynid.identification.estimators.filter import filter_pass
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.information import information
from dynid.identification.likelihood.priors import InitialState
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.residual_tests import is_explained, is_optimal, whiteness
from dynid.identification.systems.parametric_model import parametric_model
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Impact, Sine
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import LOADS as CASE_LOADS
from tests.identification.cases import parameter, run, simulated, suspension

M, K, C = 2.0, 800.0, 3.0
T = np.arange(60) * 0.02
LOADS = [Load(1, Sine(5.0, 17.0, 0.3)), Load(1, Impact(30.0, 0.333))]


def oscillator():
    joint = Joint("j", (1,), JointParameter(start=K, true=K), JointParameter(start=C, true=C))
    return lumped([M], [], [joint])


def force(t):
    half_sine = 30 * np.sin(np.pi * t / 0.333) if t < 0.333 else 0.0
    return 5 * np.sin(17 * t + 0.3) + half_sine


def oracle(eta, x0):
    """Displacement, velocity, acceleration of the oscillator by Runge–Kutta, split where contact ends."""
    k, c = np.exp(eta)

    def rate(t, x):
        return [x[1], (force(t) - k * x[0] - c * x[1]) / M]

    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-16}
    contact = T < 0.333
    first = solve_ivp(rate, (0, 0.333), x0, t_eval=np.append(T[contact], 0.333), **options)
    rest = solve_ivp(rate, (0.333, T[-1]), first.y[:, -1], t_eval=T[~contact], **options)
    x = np.hstack([first.y[:, :-1], rest.y])
    f = np.array([force(t) for t in T])
    return np.stack([x[0], x[1], (f - k * x[0] - c * x[1]) / M], axis=1)


def test_sensitivities_are_the_derivatives_of_the_prediction():
    model = oscillator()
    channels = tuple(Channel(1, q) for q in ("displacement", "velocity", "acceleration"))
    joint = parametric_model(model, LOADS, channels, T)
    eta, x0 = np.log([K, C]), np.array([0.01, -0.3])
    y = oracle(eta, x0)
    record = data(model, LOADS, simulated(channels=channels, samples=60, settle=0.0))
    fit = TimeRecord(joint, record).fit(eta, y)
    np.testing.assert_allclose(fit.predicted.outputs, y, rtol=0, atol=1e-11 * np.abs(y).max())
    np.testing.assert_allclose(fit.predicted.states[0] * joint.scale, x0, rtol=1e-9)
    found = prediction(joint, eta, fit.predicted.states[0], *free_prediction(joint, eta))
    for j in range(2):
        e = 1e-4 * np.eye(2)[j]
        # Five-point rule: truncation h^4, rounding 1e-12 / h.
        slope = (
            8 * (oracle(eta + e, x0) - oracle(eta - e, x0))
            - (oracle(eta + 2 * e, x0) - oracle(eta - 2 * e, x0))
        ) / (12 * 1e-4)
        np.testing.assert_allclose(found.by_parameter[:, :, j], slope, rtol=0, atol=1e-8 * np.abs(y).max())
        state = oracle(eta, x0 + np.eye(2)[j]) - oracle(eta, x0)
        np.testing.assert_allclose(
            found.by_state[:, :, j] / joint.scale[j], state, rtol=0, atol=1e-9 * np.abs(state).max()
        )


def test_the_bound_is_that_of_the_full_information_matrix():
    rng = np.random.default_rng(5)
    weight = np.tile([1 / 0.3, 1 / 2.0], 50)
    weight[15] = 0.0
    J = rng.standard_normal((100, 7)) * weight[:, None]
    bound = information(("a", "b", "c"), J[:, :3], J[:, 3:], 10.0, 99)
    full = np.linalg.inv(J.T @ J)[:3, :3]
    np.testing.assert_allclose(bound.covariance(), full, rtol=1e-12)
    np.testing.assert_allclose(bound.deviations(), np.sqrt(np.diag(full)), rtol=1e-12)
    scale = np.sqrt(np.diag(np.linalg.inv(full)))
    assert bound.condition() == pytest.approx(
        np.linalg.cond(np.linalg.inv(full) / np.outer(scale, scale)), rel=1e-9
    )
    residual = rng.standard_normal(100) * (weight > 0)
    np.testing.assert_allclose(
        bound.step(residual), np.linalg.lstsq(J, residual, rcond=None)[0][:3], rtol=1e-9
    )


def test_nearly_collinear_parameters_pass_and_collinear_ones_do_not():
    rng = np.random.default_rng(5)
    a, other, x0 = rng.standard_normal((3, 50, 1))

    def record(b):
        return information(("a", "b", "c"), np.concatenate([a, b, other], axis=1), x0, 50**0.5, 50)

    record(a + 1e-6 * rng.standard_normal(a.shape)).check()
    with pytest.raises(NotIdentifiable, match="a, b cannot be distinguished"):
        record(2 * a).check()
    with pytest.raises(NotIdentifiable, match="b cannot be identified"):
        record(0 * a).check()
    with pytest.raises(NotIdentifiable, match="b cannot be identified"):
        record(3 * x0).check()  # a change of the initial state explains it


def test_the_filter_is_the_extended_kalman_filter_of_the_augmented_state():
    """A plain filter, with numerical Jacobians of Runge–Kutta steps, walks through the same estimates."""
    model = oscillator()
    channels = (Channel(1, "velocity"), Channel(1, "acceleration"))
    count, sigma = 12, np.array([0.02, 0.5])
    loads = LOADS[:1]
    joint = parametric_model(model, loads, channels, T[:count])
    y = oracle(np.log([K, C]), [0.0, 0.0])[:count, 1:] + 0.01 * np.sin(np.arange(2 * count)).reshape(count, 2)
    z, P = np.array([0.001, 0.02, np.log(0.8 * K), np.log(1.3 * C)]), np.diag([1e-4, 1e-2, 0.04, 0.09])
    S = np.concatenate([joint.scale, np.ones(2)])
    prior = InitialState(z[:2] / joint.scale, z[2:], np.linalg.cholesky(P) / S[:, None])
    walked = filter_pass(joint, y, prior, sigma, z[2:].copy(), 0.0)

    def acceleration(t, z):
        return (5 * np.sin(17 * t + 0.3) - np.exp(z[2]) * z[0] - np.exp(z[3]) * z[1]) / M

    def step(z, t):
        run = solve_ivp(
            lambda s, z: [z[1], acceleration(s, z), 0, 0],
            (t, t + 0.02),
            z,
            method="DOP853",
            rtol=1e-12,
            atol=1e-15,
        )
        return run.y[:, -1]

    def slope(f, z):
        h = 1e-5
        return np.stack([(f(z + h * e) - f(z - h * e)) / (2 * h) for e in np.eye(4)], axis=1)

    for k in range(count):
        if k:
            F = slope(lambda z, k=k: step(z, T[k - 1]), z)
            z, P = step(z, T[k - 1]), F @ P @ F.T
        H = slope(lambda z, k=k: np.array([z[1], acceleration(T[k], z)]), z)
        gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(sigma**2))
        z, P = z + gain @ (y[k] - [z[1], acceleration(T[k], z)]), P - gain @ H @ P
        # Numerical Jacobians: step^2 = 1e-10, grown by the correction they feed.
        np.testing.assert_allclose(walked.eta[k], z[2:], atol=1e-7)
        np.testing.assert_allclose(walked.states[k] * joint.scale, z[:2], atol=1e-7)
        np.testing.assert_allclose(walked.deviations[k], np.sqrt(np.diag(P)[2:]), rtol=1e-5)


def test_a_step_of_a_load_between_samples_is_known_to_the_estimator():
    joint = Joint("j", (1,), JointParameter(start=400.0, true=K), JointParameter(start=5.0, true=C))
    model = lumped([M], [Link((1,), 10.0)], [joint])
    result = run(model, simulated(settle=0.0, channels=(Channel(1, "velocity"),)), loads=LOADS)
    assert parameter(result, "error_percent").max() < 1e-3


def test_noise_has_the_ratio_asked_for_and_leaves_the_record_exact():
    loads, measurement = (
        LOADS[:1],
        simulated(0.08, 11, settle=0.0, channels=(Channel(1, "velocity"),), samples=60),
    )
    measurement = type(measurement)(0.02, 60, measurement.channels, measurement.source)
    record = data(oscillator(), loads, measurement)
    exact = oracle_single()
    np.testing.assert_allclose(record.clean[:, 0], exact, atol=1e-12)
    ratio = record.noise[0] / np.sqrt(np.mean(exact**2))
    assert ratio == pytest.approx(0.08, rel=1e-9)
    expected = (
        0.08 * np.sqrt(np.mean(exact**2)) * np.random.Generator(np.random.PCG64(11)).standard_normal(60)
    )
    np.testing.assert_allclose(record.values[:, 0] - exact, expected, atol=1e-12)


def oracle_single():
    """Velocity from rest under the first load alone."""
    run = solve_ivp(
        lambda t, x: [x[1], (5 * np.sin(17 * t + 0.3) - K * x[0] - C * x[1]) / M],
        (0, T[-1]),
        [0, 0],
        method="DOP853",
        rtol=1e-13,
        atol=1e-16,
        t_eval=T,
    )
    return run.y[1]


def test_whiteness_is_a_p_value_for_white_and_zero_for_coloured_residuals():
    rng = np.random.default_rng(2)
    p = [whiteness(rng.standard_normal((300, 2))) for _ in range(300)]
    assert kstest(p, "uniform").pvalue > 1e-3
    coloured = np.cumsum(rng.standard_normal((300, 2)), axis=0)
    assert whiteness(coloured) < 1e-12
    assert whiteness(np.zeros((300, 1))) == 1.0
    assert whiteness(rng.standard_normal((3, 1))) == 1.0
    coloured[::7] = np.nan
    assert whiteness(coloured) < 1e-12


def test_settled_is_half_a_standard_error_from_the_optimum_or_next_to_nothing():
    error = np.array([0.01, 0.01])
    assert is_optimal(np.array([0.001, -0.004]), error)
    assert not is_optimal(np.array([0.001, -0.006]), error)
    assert is_optimal(np.array([5e-5, 5e-5]), 1e-3 * error)


def test_explained_are_residuals_that_are_small_or_white():
    assert is_explained(np.array([0.2, 0.2]), whiteness_p=0.3)
    assert is_explained(np.array([0.01, 0.01]), whiteness_p=0.0)
    assert not is_explained(np.array([0.01, 0.2]), whiteness_p=1e-9)


def test_the_distance_to_the_optimum_is_the_one_that_a_search_of_the_maximum_likelihood_goes():
    """Loud noise: an optimiser that knows nothing of the filter or its sensitivities ends where it says."""
    measurement = simulated(0.5)
    model = suspension()
    result = run(model, measurement, estimator=Filter(2))
    record = data(model, CASE_LOADS, measurement)
    joint = parametric_model(model, CASE_LOADS, measurement.channels, measurement.record.times)
    fits = TimeRecord(joint, record)
    start = np.log(parameter(result, "estimate"))
    noise = fits.fit(start, record.values).noise

    def over_noise(eta):
        return (fits.fit(eta, record.values).residual / noise).ravel()

    best = least_squares(over_noise, start, jac="3-point", xtol=1e-10)
    deviation = parameter(result, "standard_error") / parameter(result, "estimate")
    gone = np.abs(best.x - start) / deviation
    assert not result.value("identification/diagnostics/settled")
    assert result.value("identification/diagnostics/explained")
    # The step is Gauss–Newton's first, the deviations are not small: a tenth of a standard error.
    np.testing.assert_allclose(
        result.value("identification/diagnostics/distance_to_optimum"), gone, rtol=0, atol=0.1
    )
