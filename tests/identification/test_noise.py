"""Noise that is not white: exact likelihood, estimates of its model, coverage of the intervals."""

import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import dynid
from dynid.errors import UsageError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.maximum_likelihood import Huber, OutputError
from dynid.identification.identify import identify
from dynid.identification.likelihood.lack_of_fit import compare_models
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.problem import Problem
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.records.noise import Autoregression, ColouredNoise, Whitening, estimated
from dynid.identification.records.preparation import Decimate, prepare
from dynid.identification.systems.parametric_model import parametric_model
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Multisine
from dynid.native import compiled
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.scene.example_scenes import faults_of

M, C, K = 1.0, 2.4, 400.0
LOADS = [Load(1, Multisine([10.0] * 4, [12.0, 17.0, 21.0, 26.0]))]
#: The noise has its peak near the resonance, at 20 rad/s.
COLOUR = (0.97, -0.81)
BOTH = (Channel(1, "displacement"), Channel(1, "acceleration"))


def oscillator():
    unknowns = JointParameter(start=350.0, true=K), JointParameter(start=2.0, true=C)
    return lumped((M,), (Link((1,), 1e-9, 0),), [Joint("j", (1,), *unknowns)])


def measured(noise=None, seed=1, samples=400, channels=BOTH[:1], colour=COLOUR, ratio=0.1):
    source = Simulation(ratio, seed, 5.0, noise_colour=colour)
    return Measurement(0.05, samples, channels, source, noise=noise)


def run(noise=None, estimator=None, **options):
    return identify(oscillator(), Experiment(LOADS, measured(noise, **options)), estimator)


def parameters(result, *names):
    return [result[f"identification/parameters/{name}"].data for name in names]


def noise_of(result, name):
    return result[f"identification/noise/{name}"].data


def dense_covariance(coefficients, innovation, rows):
    """Covariance (rows x channels flattened) by the moving average of a stationary autoregression."""
    channels, order = coefficients.shape
    weights = [np.eye(channels)]
    for k in range(1, 600):
        steps = range(min(order, k))
        weights.append(sum((coefficients[:, [j]] * weights[k - 1 - j] for j in steps), np.zeros((2, 2))))
    W = np.array(weights)
    by_lag = [np.einsum("kab,bc,kdc->ad", W[h:], innovation, W[: len(W) - h]) for h in range(rows)]
    blocks = [[by_lag[i - j] if i >= j else by_lag[j - i].T for j in range(rows)] for i in range(rows)]
    return np.block(blocks)


@pytest.mark.parametrize("correlated", [False, True])
@pytest.mark.parametrize("missing", [False, True])
def test_likelihood_and_information_are_those_of_the_full_covariance(correlated, missing):
    rows, rng = 60, np.random.default_rng(2)
    measurement = measured(samples=rows, channels=BOTH, ratio=0.2)
    model = oscillator()
    values = data(model, LOADS, measurement).values
    if missing:
        values[rng.random(values.shape) < 0.2] = np.nan
        values[20:26] = np.nan
    line = Measurement(0.05, rows, BOTH, values, start=5.0)
    own = parametric_model(model, LOADS, BOTH, line.record.times)
    a, d = np.array([[1.3, -0.7], [0.6, 0.0]]), np.array([0.03, 2.0])
    L = np.array([[1.0, 0.0], [40.0, 1.0]]) if correlated else np.eye(2)
    colour = Autoregression(a, np.array([2, 1]), L if correlated else None, d)
    record = TimeRecord(own, data(model, LOADS, line), Experiment(LOADS, line), colour=colour)
    eta = np.log([380.0, 2.1])
    fit = record.fit(eta, record.data.values, d)

    free, steps = free_prediction(own, eta)
    found = prediction(own, eta, own.initial, free, steps)
    keep = ~np.isnan(values).ravel()
    V = dense_covariance(a, (L * d) @ (L * d).T, rows)[np.ix_(keep, keep)]
    residual = (values - found.outputs).ravel()[keep]
    by_state = found.by_state.reshape(2 * rows, -1)[keep]
    P = np.linalg.inv(V)
    gain = np.linalg.solve(by_state.T @ P @ by_state, by_state.T @ P)
    x0 = gain @ residual
    J = prediction(own, eta, own.initial + x0, free, steps).by_parameter.reshape(2 * rows, -1)[keep]
    J, left = J - by_state @ (gain @ J), residual - by_state @ x0

    information = record.information(fit, d)
    np.testing.assert_allclose(information.projected.T @ information.projected, J.T @ P @ J, rtol=1e-9)
    weighted = record.weighted(fit, d)
    np.testing.assert_allclose(weighted @ weighted, left @ P @ left, rtol=1e-9)
    levels = (~np.isnan(values)).sum(axis=0) @ np.log(d)
    logarithm = np.linalg.slogdet(V)[1] / 2
    np.testing.assert_allclose(record.log_determinant() + levels, logarithm, rtol=1e-9)


@pytest.mark.parametrize("correlated", [False, True])
def test_blocks_of_rows_are_whitened_as_all_at_once(correlated):
    """Across gaps at the ends of blocks, blocks shorter than the order, and values that are never there."""
    rng = np.random.default_rng(4)
    present = rng.random((60, 2)) < 0.9
    present[8:14], present[30:, 1] = False, False
    a, L = np.array([[1.3, -0.7, 0.1], [0.6, 0.0, 0.0]]), np.array([[1.0, 0.0], [0.4, 1.0]])
    colour = Autoregression(a, np.array([3, 1]), L if correlated else None, np.array([0.03, 2.0]))
    rows = rng.standard_normal((60, 2, 5))
    white, ends = Whitening(colour, present), [0, 1, 3, 10, 12, 31, 60]
    blocks = [white.following(rows[first:last]) for first, last in pairwise(ends)]
    np.testing.assert_array_equal(np.concatenate(blocks), colour.whitened(rows, present))


def estimates(model, measurement, noise_limit, monkeypatch):
    """Return the posterior's arrays; `noise_limit`: numbers that are kept, and held in a block."""
    monkeypatch.setattr("dynid.identification.likelihood.time_record._MAX_KEPT_NUMBERS", noise_limit)
    monkeypatch.setattr("dynid.identification.likelihood.time_record._MAX_BLOCK_NUMBERS", noise_limit)
    for name in ("_MAX_WHOLE_NUMBERS", "_MAX_BLOCK_NUMBERS"):
        monkeypatch.setattr(f"dynid.identification.likelihood.saturated_record.{name}", noise_limit)
    return identify(model, Experiment(LOADS, measurement), OutputError())


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [None, ColouredNoise(2), ColouredNoise(2, correlated=True)], ids=str)
def test_results_of_a_record_in_blocks_are_those_of_all_at_once(noise, monkeypatch):
    measurement = measured(noise, samples=1500, channels=BOTH, colour=COLOUR if noise else ())
    source = data(oscillator(), LOADS, measurement).values
    source[510:514, 0] = np.nan  # at the end of a block
    record = Measurement(0.05, 1500, BOTH, source, start=5.0, noise=noise)
    whole, parts = (estimates(oscillator(), record, size, monkeypatch) for size in (1_000_000, 1))
    for path in (
        *("parameters/estimate", "parameters/standard_error", "considered/slope", "measurement/predicted"),
        *("diagnostics/signal_explained", "diagnostics/redundancy", "diagnostics/log_likelihood"),
    ):
        one, other = (result[f"identification/{path}"].data for result in (parts, whole))
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9 * np.abs(other).max())
    logs = [np.log(result["identification/diagnostics/lack_of_fit_p"].data) for result in (parts, whole)]
    np.testing.assert_allclose(*logs, rtol=1e-5, atol=1e-7)


@pytest.mark.thorough
@pytest.mark.parametrize("noise", [None, ColouredNoise(2)], ids=["white", "coloured"])
def test_memory_of_fits_and_comparisons_grows_with_the_values_alone(noise, monkeypatch):
    """Twice the samples take a few more arrays of values and states, not their derivatives."""
    if not compiled():
        pytest.skip("the library is absent")
    monkeypatch.setattr("dynid.identification.likelihood.time_record._MAX_KEPT_NUMBERS", 0)
    monkeypatch.setattr("dynid.identification.likelihood.time_record._MAX_BLOCK_NUMBERS", 50_000)
    for name in ("_MAX_WHOLE_NUMBERS", "_MAX_BLOCK_NUMBERS"):
        monkeypatch.setattr(f"dynid.identification.likelihood.saturated_record.{name}", 10_000)
    peaks, arrays = [], 0
    for samples in (6000, 12_000):
        measurement = measured(noise, samples=samples, channels=BOTH)
        likelihood = Problem.of(oscillator(), [Experiment(LOADS, measurement)]).likelihood
        eta = np.log([350.0, 2.0])
        if noise is not None:
            likelihood = likelihood.renewed(likelihood.fit(eta))
        compare_models(likelihood, likelihood.fit(eta))
        tracemalloc.start()
        compare_models(likelihood, likelihood.fit(eta))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        arrays = samples * 8 * len(BOTH)
    # Outputs, residuals, direct terms, states, loads, masks. The regressors alone were 8 of such arrays.
    assert peaks[1] - peaks[0] < 9 * arrays / 2


def test_noise_is_simulated_with_its_colour_and_size():
    plain = data(oscillator(), LOADS, measured(samples=40_000, colour=()))
    coloured = data(oscillator(), LOADS, measured(samples=40_000))
    noise = (coloured.values - coloured.clean)[:, 0]
    assert noise.std() == pytest.approx(plain.noise[0], rel=0.03)
    a, b = COLOUR
    first = a / (1 - b)  # Yule–Walker
    assert np.mean(noise[1:] * noise[:-1]) / noise.var() == pytest.approx(first, abs=0.02)
    assert np.mean(noise[2:] * noise[:-2]) / noise.var() == pytest.approx(a * first + b, abs=0.02)
    with pytest.raises(UsageError, match="not stationary"):
        measured(colour=(1.0,))


def test_the_order_is_found_and_the_coefficients_are_those_of_the_noise():
    result = run(ColouredNoise(), samples=2000, channels=BOTH)
    assert result.group_attrs["identification/noise"]["kind"] == "coloured"
    assert noise_of(result, "order").tolist() == [2, 2]
    np.testing.assert_allclose(noise_of(result, "coefficients"), [COLOUR] * 2, atol=0.05)
    np.testing.assert_allclose(
        noise_of(result, "deviation"), result["identification/measurement/noise"].data, rtol=0.1
    )
    bic = noise_of(result, "bic")
    assert bic.shape == (2, 21)
    assert np.argmin(bic, axis=1).tolist() == [2, 2]
    assert bool(result.value("identification/diagnostics/converged"))
    assert bool(result.value("identification/diagnostics/white"))
    error, bound = parameters(result, "standard_error", "cramer_rao")
    np.testing.assert_allclose(error, bound, rtol=0.05)


def test_bounds_are_for_the_true_noise_whatever_is_assumed():
    white, coloured = run(), run(ColouredNoise(2))
    np.testing.assert_allclose(*(parameters(one, "cramer_rao")[0] for one in (white, coloured)), rtol=1e-12)
    ratio = parameters(white, "standard_error")[0] / parameters(white, "cramer_rao")[0]
    assert np.all(ratio < 0.5)
    warnings = " ".join(white["identification/diagnostics/warnings"].data)
    assert "noise: {kind: coloured, order: auto}" in warnings
    assert not len(coloured["identification/diagnostics/warnings"].data)


def test_channels_are_correlated_with_each_other():
    channels = (Channel(1, "displacement"), Channel(1, "velocity"))
    clean = data(oscillator(), LOADS, measured(samples=1000, channels=channels, ratio=0.0)).values
    e = np.random.default_rng(1).multivariate_normal([0, 0], [[1, 0.8], [0.8, 1]], 1100)
    noise = e.copy()
    for t in range(1, 1100):
        noise[t] += 0.7 * noise[t - 1]
    values = clean + 0.1 * clean.std(axis=0) * noise[100:]
    gap = values.copy()
    gap[::9, 0] = np.nan
    for each in (values, gap):
        line = Measurement(0.05, 1000, channels, each, ColouredNoise(1, correlated=True), start=5.0)
        result = identify(oscillator(), Experiment(LOADS, line))
        assert noise_of(result, "correlation")[0, 1] == pytest.approx(0.8, abs=0.05)
        np.testing.assert_allclose(noise_of(result, "coefficients"), [[0.7], [0.7]], atol=0.08)
        np.testing.assert_allclose(noise_of(result, "innovation"), 0.1 * clean.std(axis=0), rtol=0.1)


def test_every_record_has_its_own_noise():
    first, second = measured(ColouredNoise(), samples=800), measured(ColouredNoise(), 2, 800, colour=())
    result = identify(oscillator(), [Experiment(LOADS, one) for one in (first, second)])
    assert noise_of(result, "order").tolist() == [2, 0]


def test_an_autoregression_is_stationary_and_leaves_out_gaps():
    x = Autoregression.of((1.5, -0.9), 1).simulated(np.random.default_rng(3).standard_normal((3000, 1)))
    x[::7] = np.nan
    found = estimated(x, [np.zeros((3000, 0))], ColouredNoise(2))
    np.testing.assert_allclose(found.coefficients, [[1.5, -0.9]], atol=0.05)
    x[::2] = np.nan
    with pytest.raises(UsageError, match="stretches of"):
        estimated(x, [np.zeros((3000, 0))], ColouredNoise(2))


def test_estimators_that_assume_white_noise_say_so_and_others_find_one_optimum():
    filtered = run(ColouredNoise(2), Filter())
    assert "filter assumes white noise" in " ".join(filtered["identification/diagnostics/warnings"].data)
    error, estimate = parameters(run(ColouredNoise(2)), "standard_error", "estimate")
    other = parameters(run(ColouredNoise(2), OutputError()), "estimate")[0]
    np.testing.assert_allclose(other, estimate, atol=0.005 * error.min())
    with pytest.raises(UsageError, match="robust loss"):
        run(ColouredNoise(2), Huber(OutputError()))
    values = data(oscillator(), LOADS, measured()).values
    line = Measurement(0.05, 400, BOTH[:1], values, ColouredNoise(2), start=5.0)
    with pytest.raises(UsageError, match="Leave the filters out"):
        prepare(Experiment(LOADS, line), [Decimate(2)])


def responses(seed=1, ratio=0.1, noise=None, proportional=True):
    source = Simulation(ratio, seed, noise_by_line=True)
    function = Frf(Channel(1, "displacement"), 1)
    return FrfMeasurement(np.linspace(2, 60, 60), (function,), source, noise, proportional=proportional)


def test_noise_in_proportion_to_a_response_is_weighted_by_the_response_of_the_model():
    result = identify(oscillator(), responses())
    estimate, error, bound = parameters(result, "estimate", "standard_error", "cramer_rao")
    assert noise_of(result, "ratio")[0] == pytest.approx(0.1, rel=0.2)
    np.testing.assert_allclose(error, bound, rtol=0.2)
    # The estimating equations: sum of Re[(Y - H)* dH] / |H|^2 vanishes.
    (k, c), omega = estimate, np.linspace(2, 60, 60)
    Y = result["identification/measurement/measured"].data[:, 0]
    H = 1 / (k + 1e-9 - M * omega**2 + 1j * omega * c)
    slopes = np.stack([-(H**2) * k, -1j * omega * H**2 * c])
    equations = np.real((Y - H).conj() * slopes / np.abs(H) ** 2).sum(axis=1)
    information = np.real(slopes.conj() / np.abs(H) ** 2 @ slopes.T)
    assert np.all(np.abs(np.linalg.solve(information, equations)) < 0.01 * error / estimate)


def test_a_given_ratio_is_tested_and_white_noise_would_be_wrong():
    given = identify(oscillator(), responses(noise=0.1))
    assert float(given.value("identification/diagnostics/noise_p")) > 0.01
    np.testing.assert_allclose(*parameters(given, "standard_error", "cramer_rao"), rtol=0.05)
    white = identify(oscillator(), responses(proportional=False))
    error, bound = parameters(white, "standard_error", "cramer_rao")
    assert np.all(error < 0.5 * bound)
    robust = identify(oscillator(), responses(), Huber(OutputError()))
    assert bool(robust.value("identification/diagnostics/converged"))


SCENE = """\
dynid: 1
kind: identification
structure: {lumped: {masses: [1]}}
joints: {j: {dofs: [1], k: {start: 350, true: 400}, c: {start: 2, true: 2.4}}}
excitation: [{dof: 1, kind: multisine, amplitude: [10, 10, 10, 10], frequency: [12, 17, 21, 26]}]
measurement:
  step: 0.05
  samples: 400
  channels: [{dof: 1, quantity: displacement}]
  simulate: {noise_ratio: 0.1, seed: 1, settle: 5, noise_colour: [0.97, -0.81]}
  noise: {kind: coloured, order: auto}
"""


def test_a_scene_states_the_noise(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text(SCENE)
    result = dynid.run(dynid.load_scene(path))
    assert noise_of(result, "order").tolist() == [2]
    same = run(ColouredNoise())
    np.testing.assert_allclose(*(parameters(one, "estimate")[0] for one in (result, same)), rtol=1e-6)


@pytest.mark.parametrize(
    ("right", "wrong", "place", "fault"),
    [
        ("[0.97, -0.81]", "[1.5, -0.5]", "10:", "not stationary"),
        ("order: auto", "order: 0", "11:", "a whole number from 1 to 200, or auto"),
        ("order: auto", "order: 40", "7:", "needs 440 samples, and there are 400"),
        ("kind: coloured, order: auto", "kind: proportional", "7:", "no lines to be proportional to"),
        ("order: auto", "ratio: 0.1", "11:", "'ratio' is that of proportional noise"),
        ("kind: coloured", "kind: colored", "11:", "coloured"),
    ],
)
def test_noise_that_cannot_be_is_a_fault_at_its_place(right, wrong, place, fault):
    assert faults_of(SCENE) == []
    assert right in SCENE
    (found,) = faults_of(SCENE.replace(right, wrong))
    assert found.startswith(place)
    assert fault in found


@pytest.mark.slow
def test_intervals_cover_the_truth_with_coloured_noise_and_not_with_white():
    records, inside = 2000, {}
    for noise, count in ((ColouredNoise(2), records), (None, 200)):
        held = []
        for seed in range(1, count + 1):
            # The white model rejects the residuals: no search for another optimum.
            estimator = OutputError() if noise is None else None
            estimate, true, error = parameters(
                run(noise, estimator, seed=seed), "estimate", "true", "standard_error"
            )
            held.append(np.abs(np.log(true / estimate)) <= 1.959964 * error / estimate)
        inside[noise is None] = np.mean(held, axis=0)
    assert np.all((inside[False] > 0.93) & (inside[False] < 0.97)), inside
    assert np.all(inside[True] < 0.8), inside


def test_white_noise_is_not_whitened():
    record = TimeRecord(
        parametric_model(oscillator(), LOADS, BOTH, measured().record.times),
        data(oscillator(), LOADS, measured(channels=BOTH, colour=())),
    )
    eta = np.log([380.0, 2.1])
    white = record.fit(eta, record.data.values)
    same = replace(record, colour=Autoregression.of((), 2)).fit(eta, record.data.values)
    np.testing.assert_allclose(same.triangles, white.triangles, rtol=1e-12)
