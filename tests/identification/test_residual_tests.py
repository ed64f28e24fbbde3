"""A given noise that residuals contradict, offsets of sensors, outliers, and Huber's loss."""

import numpy as np
import pytest
from scipy import signal, stats
from scipy.optimize import least_squares

from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.maximum_likelihood import Huber, OutputError
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement, unstacked
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.records.preparation import BandPass, Detrend, prepare
from dynid.identification.residual_tests import noise_test, residual_shape
from dynid.identification.systems.frf_system import frf_data
from dynid.lti.signals import Multisine
from dynid.structure.joints import Joint
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, parameter, unknown
from tests.sample import sample

pytestmark = pytest.mark.thorough

CHANNELS = (Channel(1, "acceleration"), Channel(2, "velocity"))
LOADS = (Load(1, Multisine([20, 15, 25, 10], [40, 95, 130, 210])),)


def two_masses():
    joint = Joint("bolt", (1, 2), unknown(2e4, 0.7), unknown(15.0, 0.7))
    return lumped((1.2, 0.8), (Link((1,), 1.5e4, 12),), [joint])


def record(seed=1, samples=600, ratio=0.04):
    """Return clean values and noisy ones (times x channels), with the deviation of the noise."""
    from dynid.identification.systems.record_values import data

    measurement = Measurement(0.002, samples, CHANNELS, Simulation(ratio, seed, 1.0))
    made = data(two_masses(), LOADS, measurement)
    return made.clean, made.values, made.noise


def answered(values, noise=None, estimator=None, prepared=(), start=1.0):
    measurement = Measurement(0.002, len(values), CHANNELS, values, noise=noise, start=start)
    experiment = prepare(Experiment(LOADS, measurement), prepared)
    return identify(two_masses(), [experiment], estimator)


def warnings(result):
    return list(result["identification/diagnostics/warnings"].data)


def test_p_values_are_those_of_scipy_and_uniform_where_nothing_is_wrong():
    rng = np.random.default_rng(5)
    squares, degrees = rng.chisquare(40.0, 200), np.full(200, 40.0)
    found = noise_test(squares, degrees, np.zeros(200, dtype=bool))
    expected = 2 * np.minimum(stats.chi2.cdf(squares, 40), stats.chi2.sf(squares, 40))
    np.testing.assert_allclose(found.channel_p, expected, rtol=1e-9)
    np.testing.assert_allclose(found.ratio, np.sqrt(squares / 40))
    # One channel too quiet and one too loud whose sum is as expected.
    assert noise_test(np.array([20.0, 60.0]) * 10, np.full(2, 400.0), np.zeros(2, dtype=bool)).p < 1e-9


@pytest.mark.parametrize("coloured", [False, True])
def test_the_shape_of_gaussian_residuals_raises_no_alarm_and_its_p_values_are_uniform(coloured):
    rng = np.random.default_rng(11)
    draws = rng.standard_normal((400, 1100))
    if coloured:  # a resonance and a slow drift
        draws = signal.lfilter([1], np.convolve([1, -1.6, 0.8], [1, -0.7]), draws, axis=1)
    found = [residual_shape(draw[-600:], 1e-4) for draw in draws]
    assert not any(len(each.outliers) for each in found)
    for name in ("mean_p", "kurtosis_p", "largest_p"):
        p = np.array([getattr(each, name) for each in found])
        # Binomial of 400 at 5 %: 20 +- 13 (3 sigma); an estimated colour doubles it at the most.
        assert np.mean(p < 0.05) < (0.12 if coloured else 0.083), name
        assert p.min() > 1e-6, name


@pytest.mark.parametrize("factor", sample([0.05, 0.6, 1.5, 20.0], 2))
def test_a_noise_that_the_residuals_contradict_is_named_with_both_error_bars(factor):
    _, values, noise = record(3)
    unknown_noise = answered(values)
    result = answered(values, list(factor * noise))
    assert diagnostic(result, "noise_p") < 1e-9
    np.testing.assert_allclose(diagnostic(result, "noise_ratio"), 1 / factor, rtol=0.1)
    said = [warning for warning in warnings(result) if "given noise" in warning]
    assert len(said) == 1
    assert all(name in said[0] for name in ("1.acceleration", "2.velocity", "measurement.noise"))
    # Bars are for the given noise; the scaled ones are those of a fit without it.
    honest = parameter(unknown_noise, "standard_error")
    np.testing.assert_allclose(parameter(result, "standard_error"), factor * honest, rtol=0.1)
    np.testing.assert_allclose(parameter(result, "standard_error_scaled"), honest, rtol=0.1)


@pytest.mark.parametrize(("records", "rtol"), [(15, 0.55), pytest.param(60, 0.28, marks=pytest.mark.slow)])
def test_scaled_error_bars_are_the_scatter_where_one_channel_alone_is_given_wrongly(records, rtol):
    errors, scaled = [], []
    for seed in range(records):
        _, values, noise = record(seed, samples=200)
        result = answered(values, [noise[0] / 10, noise[1]], OutputError())
        errors.append(np.log(parameter(result, "estimate") / [2e4, 15.0]))
        scaled.append(parameter(result, "standard_error_scaled") / parameter(result, "estimate"))
        (said,) = (warning for warning in warnings(result) if "given noise" in warning)
        assert "1.acceleration" in said
        assert "2.velocity" not in said
    # Of n records the scatter is known to 1 / sqrt(2 n): three times that.
    np.testing.assert_allclose(np.std(errors, axis=0), np.mean(scaled, axis=0), rtol=rtol)


@pytest.mark.parametrize("records", [10, pytest.param(40, marks=pytest.mark.slow)])
def test_a_right_noise_is_not_contradicted_and_its_p_value_is_uniform(records):
    p = []
    for seed in range(records):
        _, values, noise = record(seed, samples=60)
        p.append(diagnostic(answered(values, list(noise), OutputError()), "noise_p"))
    # Bonferroni of three tests, two of which make the third: no smaller than uniform.
    assert stats.kstest(p, "uniform", alternative="greater").pvalue > 1e-3
    assert min(p) > 1e-4
    assert np.isnan(diagnostic(answered(record(1)[1]), "noise_p"))


def test_a_right_noise_stays_right_behind_a_filter():
    _, values, noise = record(8, samples=3000)
    steps = (BandPass(10.0, 300.0),)
    assert diagnostic(answered(values, list(noise), prepared=steps), "noise_p") > 1e-4
    assert diagnostic(answered(values, list(noise / 1.5), prepared=steps), "noise_p") < 1e-9


@pytest.mark.parametrize(("channel", "row", "size"), [(0, 17, 30.0), (1, 402, -12.0)])
def test_an_outlier_is_named_with_channel_and_time(channel, row, size):
    _, values, noise = record(2)
    values[row, channel] += size * noise[channel]
    result = answered(values)
    said = [warning for warning in warnings(result) if "outlier" in warning]
    assert len(said) == 1
    assert said[0].startswith(f"{CHANNELS[channel].name} has an outlier at {0.002 * row:.5g} s")
    assert "loss: huber" in said[0]
    assert ("counts" in said[0]) == (size == 30.0)  # 900 squares of 600 weigh it down, 144 do not
    np.testing.assert_array_equal(diagnostic(result, "outliers"), np.eye(2)[channel])


def test_heavy_tails_are_named():
    clean, _, noise = record(2)
    loud = np.random.default_rng(4).laplace(size=clean.shape) * [1.0, 0.0]
    calm = np.random.default_rng(5).standard_normal(clean.shape) * [0.0, 1.0]
    said = warnings(answered(clean + noise * (loud + calm)))
    assert any("1.acceleration" in warning and "huber" in warning for warning in said)
    assert not any("2.velocity" in warning for warning in said)


def test_an_offset_is_named_with_its_remedy_and_the_remedy_helps():
    _, values, noise = record(6)
    values[:, 0] -= 25 * noise[0]
    spoiled = answered(values)
    said = [warning for warning in warnings(spoiled) if "mean" in warning]
    assert len(said) == 1
    assert "1.acceleration" in said[0]
    assert "detrend: constant" in said[0]
    assert "counts" in said[0]
    cured = answered(values, prepared=(Detrend(0),))
    assert not [warning for warning in warnings(cured) if "mean" in warning]
    assert parameter(cured, "standard_error")[1] < 0.8 * parameter(spoiled, "standard_error")[1]
    assert np.all(
        np.abs(parameter(cured, "estimate") / [2e4, 15.0] - 1)
        < 5 * parameter(cured, "standard_error") / parameter(cured, "estimate")
    )


def test_hubers_loss_ends_where_an_optimiser_ends_that_shares_nothing_with_it():
    """Huber's loss at fixed scales by scipy, initial state and logarithms free, by finite differences."""
    from scipy.linalg import expm

    _, values, noise = record(9, samples=120)
    values[[20, 71, 99], [0, 1, 1]] += np.array([40, -25, 60]) * noise[[0, 1, 1]]
    result = answered(values, estimator=Huber(OutputError()))
    scale = result.value("identification/robust/scale")
    omega, force = np.array([40, 95, 130, 210.0]), np.array([20, 15, 25, 10.0])
    times, fine = 1.0 + 0.002 * np.arange(120), np.linalg.inv(np.diag([1.2, 0.8]))

    def predicted(x):
        k, c = np.exp(x[:2])
        K, C = (np.array([[a + b, -b], [-b, b]]) for a, b in ((1.5e4, k), (12, c)))
        A = np.block([[np.zeros((2, 2)), np.eye(2)], [-fine @ K, -fine @ C]])
        b = np.array([0, 0, 1 / 1.2, 0])
        steady = np.zeros((len(times), 4))
        for w, F in zip(omega, force, strict=True):
            X = np.linalg.solve(1j * w * np.eye(4) - A, b * F)
            steady += np.imag(X * np.exp(1j * w * times)[:, None])
        Phi, free = expm(0.002 * A), [np.array(x[2:]) * [1e-3, 1e-3, 0.1, 0.1]]
        for _ in times[1:]:
            free.append(Phi @ free[-1])
        state = steady + free
        u = np.sin(np.outer(times, omega)) @ force
        return np.column_stack([state @ A[2] + u / 1.2, state[:, 3]])

    # The channels count by their own efficiency: m / q of the mean derivative and the mean square of psi.
    def left(x, weight):
        z = (values - predicted(x)) / scale
        rho = np.where(np.abs(z) < 1.345, z**2, 2 * 1.345 * np.abs(z) - 1.345**2)
        return (np.sign(z) * np.sqrt(rho * weight)).ravel()

    x = np.concatenate([np.log(parameter(result, "estimate")), np.zeros(4)])
    for _ in range(3):
        z = (values - predicted(x)) / scale
        weight = np.mean(np.abs(z) < 1.345, axis=0) / np.mean(np.clip(z, -1.345, 1.345) ** 2, axis=0)
        x = least_squares(left, x, args=(weight,), xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac").x
    relative = parameter(result, "standard_error") / parameter(result, "estimate")
    # Both stop at about a thousandth of a standard error; the weights of the channels differ in 1/n.
    assert np.all(np.abs(x[:2] - np.log(parameter(result, "estimate"))) < 0.02 * relative)


def test_hubers_loss_keeps_estimates_within_their_bars_where_squares_lose_the_channel():
    _, values, noise = record(12)
    values[233, 1] += 100 * noise[1]
    plain, robust = answered(values), answered(values, estimator=Huber(Auto()))
    clean = answered(record(12)[1])
    np.testing.assert_allclose(
        parameter(robust, "standard_error"), parameter(clean, "standard_error"), rtol=0.1
    )
    off = np.log(parameter(robust, "estimate") / parameter(clean, "estimate"))
    relative = parameter(clean, "standard_error") / parameter(clean, "estimate")
    assert np.all(np.abs(off) < relative)
    assert parameter(plain, "standard_error").max() > 0
    assert diagnostic(robust, "converged")
    assert not warnings(robust)
    assert result_attrs(robust)["loss"] == "huber"
    # Gaussian noise leaves 17.9 % beyond 1.345; 600 values, three standard errors.
    np.testing.assert_allclose(robust.value("identification/robust/clipped"), 0.179, atol=0.05)
    np.testing.assert_allclose(robust.value("identification/robust/scale"), noise, rtol=0.15)
    np.testing.assert_array_equal(robust.value("identification/measurement/measured"), values)


def result_attrs(result):
    return result.group_attrs["identification"]


def test_hubers_loss_tests_a_given_noise_by_the_robust_deviation():
    _, values, noise = record(15)
    values[100, 0] += 1e3 * noise[0]
    right = answered(values, list(noise), Huber(Auto()))
    wrong = answered(values, list(noise / 2), Huber(Auto()))
    assert diagnostic(right, "noise_p") > 1e-3
    assert diagnostic(wrong, "noise_p") < 1e-9
    np.testing.assert_allclose(
        parameter(right, "standard_error"), parameter(wrong, "standard_error"), rtol=1e-6
    )


def frf(seed, spoil=0.0, loss=None, noise=None):
    channels = (Frf(Channel(1, "acceleration"), 1), Frf(Channel(2, "acceleration"), 1))
    omega = np.linspace(20, 300, 140)
    made = frf_data(two_masses(), FrfMeasurement(omega, channels, Simulation(0.03, seed)))
    values, level = unstacked(made.values), np.sqrt(2) * made.noise  # of the complex noise
    values[31, 1] += spoil * level[1]
    measurement = FrfMeasurement(
        omega, channels, values, noise=None if noise is None else list(noise * level)
    )
    return identify(two_masses(), measurement, loss or Auto()), omega[31]


def test_frequency_responses_have_the_same_tests_and_loss():
    result, line = frf(3, 60.0)
    said = [warning for warning in warnings(result) if "outlier" in warning]
    assert len(said) == 1
    assert f"{line:.5g} rad/s" in said[0]
    robust, _ = frf(3, 60.0, Huber(Auto()))
    clean, _ = frf(3)
    np.testing.assert_allclose(
        parameter(robust, "standard_error"), parameter(clean, "standard_error"), rtol=0.15
    )
    assert np.all(
        np.abs(parameter(robust, "estimate") - parameter(clean, "estimate"))
        < parameter(clean, "standard_error")
    )
    assert diagnostic(frf(4, noise=1.0)[0], "noise_p") > 1e-4
    wrong, _ = frf(4, noise=0.2)
    assert diagnostic(wrong, "noise_p") < 1e-9
    np.testing.assert_allclose(
        parameter(wrong, "standard_error_scaled"), 5 * parameter(wrong, "standard_error"), rtol=0.15
    )


@pytest.mark.slow
@pytest.mark.parametrize("spike", [0.0, 100.0])
def test_hubers_intervals_cover_and_it_loses_a_twentieth_of_the_efficiency(spike):
    records, held, squares, errors = 300, [], [], []
    for seed in range(records):
        clean, values, noise = record(seed, samples=400)
        del clean
        plain = answered(values, estimator=OutputError())
        row = np.random.default_rng(seed).integers(400)
        values[row, 1] += spike * noise[1]
        result = answered(values, estimator=Huber(OutputError()))
        off = np.log(parameter(result, "estimate") / [2e4, 15.0])
        bars = parameter(result, "standard_error") / parameter(result, "estimate")
        held.append(np.abs(off) < 1.96 * bars)
        errors.append(off)
        squares.append(np.log(parameter(plain, "estimate") / [2e4, 15.0]))
    # Three standard errors of the figures: coverage 3.8 %; the ratio of two correlated variances 7 %.
    np.testing.assert_allclose(np.mean(held, axis=0), 0.95, atol=0.038)
    efficiency = np.mean(np.square(squares), axis=0) / np.mean(np.square(errors), axis=0)
    np.testing.assert_allclose(efficiency, 0.95, atol=0.08)
