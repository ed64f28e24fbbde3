"""Diagnostics of a result: correlations, residuals, innovations, bands of states, warnings."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal, stats

from dynid.identification.diagnosis.residuals import ChannelOfRecord
from dynid.identification.diagnosis.verdict import warnings
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.information import information
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.measurement import Experiment, Measurement, RecordData
from dynid.identification.residual_tests import autocorrelation, consistency, spectrum
from dynid.identification.systems.instruments import Instruments
from dynid.identification.systems.prediction import Trajectory
from dynid.structure.ports import Channel
from tests.identification.cases import VELOCITIES, diagnostic, parameter, run, simulated, suspension


@pytest.fixture(scope="module")
def noisy():
    return run(measurement=simulated(0.05))


def test_autocorrelation_of_a_known_series_and_its_band():
    rng = np.random.default_rng(3)
    e = rng.standard_normal(20_000)
    y = np.array([signal.lfilter([1], [1, -0.6], e), e]).T
    r, band = autocorrelation(y)
    assert r.shape == (40, 2)
    # An autoregression of order one: 0.6^lag, to a few times 1 / sqrt(N).
    np.testing.assert_allclose(r[:, 0], 0.6 ** np.arange(1, 41), atol=0.04)
    assert band == pytest.approx(stats.norm.ppf(0.975) / np.sqrt(20_000))
    assert np.mean(np.abs(r[:, 1]) < band[1]) > 0.85
    assert autocorrelation(np.zeros((100, 1)))[0].max() == 0
    assert autocorrelation(np.zeros((3, 2)))[0].shape == (0, 2)


@pytest.mark.parametrize("n", [1, 2, 333, 512, 5000])
def test_spectrum_is_a_density_whose_integral_is_the_mean_square(n):
    rng = np.random.default_rng(n)
    y = rng.standard_normal((n, 2)) * [1e-200, 3.0]
    omega, root = spectrum(y, 0.01)
    density = root**2
    spacing = 2 * np.pi / 0.01 / min(n, 512)
    power = density.sum(axis=0) * spacing
    if n == 5000:  # the window lets segments weigh differently
        np.testing.assert_allclose(power[1], np.mean(y[:, 1] ** 2), rtol=0.02)
        f, expected = signal.welch(
            y[:, 1], 100, signal.windows.hann(513, sym=False)[:512], 512, 256, detrend=False
        )
        np.testing.assert_allclose(omega, 2 * np.pi * f)
        np.testing.assert_allclose(np.median(density[:, 1]), np.median(expected) / (2 * np.pi), rtol=0.05)
    assert np.isfinite(root).all()
    assert np.all(root.max(axis=0) > 0)


def test_a_sine_stands_at_its_frequency_with_its_power_although_samples_are_missing():
    t = np.arange(4096) * 0.01
    y = 2 * np.sin(40 * t)[:, None]
    rng = np.random.default_rng(0)
    for part in (0.0, 0.3):
        gaps = np.where(rng.random((4096, 1)) < part, np.nan, y)
        omega, root = spectrum(gaps, 0.01)
        density = root**2
        assert omega[np.argmax(density[:, 0])] == pytest.approx(40, abs=omega[1])
        assert density.sum() * omega[1] == pytest.approx(2, rel=0.05)


def test_mean_squares_of_white_innovations_lie_in_the_interval_of_chi_squared():
    rng = np.random.default_rng(1)
    e = rng.standard_normal((400, 2))
    e[::5, 1] = np.nan
    found = consistency(e)
    assert found.mean_square == pytest.approx([np.mean(e[:, 0] ** 2), np.nanmean(e[:, 1] ** 2)])
    for degrees, low, high in (
        (400, found.low[0], found.high[0]),
        (320, found.low[1], found.high[1]),
        (720, found.overall_low, found.overall_high),
    ):
        # Wilson and Hilferty's approximation.
        expected = stats.chi2.ppf([0.025, 0.975], degrees) / degrees
        np.testing.assert_allclose([low, high], expected, rtol=1e-4)
    assert found.consistent
    assert not consistency(1.2 * e).consistent
    assert not consistency(0.8 * e).consistent


@pytest.mark.thorough
def test_innovations_of_the_last_filter_pass_are_normalised():
    """Over ten records the mean square lies in its 95 % interval as often as it should."""
    inside = 0
    for seed in range(10):
        measurement = simulated(0.05, seed, samples=200)
        result = run(suspension(0.9), measurement, estimator=Filter(2))
        inside += bool(result.value("identification/innovations/consistent"))
        e = result.value("identification/innovations/normalised")
        assert result.value("identification/innovations/overall") == pytest.approx(np.mean(e**2))
    assert inside >= 7  # fewer in 0.1 % of the cases


def test_only_the_filter_with_a_pass_that_knows_the_noise_reports_innovations(noisy):
    group = "identification/innovations/normalised"
    assert group not in noisy
    assert group not in run(measurement=simulated(0.05, samples=200), estimator=Filter(1))


def test_correlations_are_those_of_the_inverse_of_the_full_information():
    rng = np.random.default_rng(5)
    J = rng.standard_normal((100, 7))
    found = information(("a", "b", "c"), J[:, :3], J[:, 3:], 10.0, 100).correlation()
    covariance = np.linalg.inv(J.T @ J)[:3, :3]
    size = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found, covariance / np.outer(size, size), rtol=1e-10)
    np.testing.assert_array_equal(np.diag(found), 1.0)


def test_correlations_stand_beside_the_estimates(noisy):
    correlation = parameter(noisy, "correlation")
    np.testing.assert_array_equal(correlation, correlation.T)
    np.testing.assert_array_equal(np.diag(correlation), 1.0)
    assert 0.05 < np.abs(correlation - np.eye(4)).max() < 0.95


@pytest.mark.parametrize(
    "estimator", [None, OutputError(), Filter(2)], ids=["auto", "output error", "filter"]
)
def test_unmeasured_states_come_with_bands_that_hold_the_truth(estimator):
    result = run(measurement=simulated(0.05), estimator=estimator)
    group = "identification/states"
    error = result.value(f"{group}/estimate") - result.value(f"{group}/true")
    band = result.value(f"{group}/standard_deviation")
    assert error.shape == (800, 10)
    assert np.all(band > 0)
    ratio = error / band
    # Errors at different times are those of few numbers, and one record is one sample of them.
    assert 0.3 < np.sqrt(np.mean(ratio**2)) < 2.0
    unmeasured = result.value(f"{group}/component").tolist().index("5.velocity")
    rms = np.sqrt(np.mean(result.value(f"{group}/true")[:, unmeasured] ** 2))
    assert np.abs(error[:, unmeasured]).max() < 0.05 * rms


@pytest.mark.parametrize("records", [8, pytest.param(30, marks=pytest.mark.slow)])
def test_bands_of_states_are_those_of_many_records(records):
    errors, bands = [], []
    for seed in range(records):
        result = run(suspension(0.9), simulated(0.05, seed, samples=100), estimator=OutputError())
        errors.append(
            result.value("identification/states/estimate") - result.value("identification/states/true")
        )
        bands.append(result.value("identification/states/standard_deviation"))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    ratio = (spread / np.mean(bands, axis=0))[::20]
    assert np.median(ratio) == pytest.approx(1, abs=0.2)


def test_true_states_are_the_motion_that_the_channels_measure():
    channels = (Channel(2, "velocity"), Channel(3, "displacement"))
    result = run(measurement=simulated(0.0, channels=channels, samples=100))
    true = result.value("identification/states/true")
    names = result.value("identification/states/component").tolist()
    measured = result.value("identification/measurement/measured")
    for column, channel in enumerate(channels):
        np.testing.assert_allclose(
            true[:, names.index(channel.name)], measured[:, column], rtol=1e-12, atol=1e-15
        )


def test_the_history_carries_estimate_band_truth_and_states(noisy):
    group = "identification/history"
    samples, parameters, states = 800, 4, 10
    for name in ("estimate", "standard_deviation"):
        assert noisy.value(f"{group}/{name}").shape == (samples, parameters)
    assert noisy.value(f"{group}/true").tolist() == [2e4, 20, 2e4, 20]
    for name in ("state", "state_standard_deviation", "true_state"):
        assert noisy.value(f"{group}/{name}").shape == (samples, states)
    late = np.abs(noisy.value(f"{group}/state") - noisy.value(f"{group}/true_state"))[400:]
    assert np.mean(late < 4 * noisy.value(f"{group}/state_standard_deviation")[400:]) > 0.9


def test_measured_records_have_no_true_states():
    values = run(measurement=simulated(0.05, settle=0.0)).value("identification/measurement/measured")
    result = run(measurement=Measurement(0.002, 800, VELOCITIES, values), estimator=OutputError())
    assert "identification/states/true" not in result
    assert "identification/history/true_state" not in result


# --- words -----------------------------------------------------------------------------------------


NOISE = np.random.default_rng(8).standard_normal((300, 2))
MEASURED = 10 * np.sin(np.arange(600.0) ** 1.1).reshape(300, 2) + NOISE


def posterior(measured=MEASURED, residual=NOISE, **changed):
    """Return a posterior as the warnings read it, of one record with two channels."""
    channels = (Channel(1, "velocity"), Channel(2, "velocity"))
    experiment = Experiment((), Measurement(0.01, 300, channels, measured))
    record = TimeRecord(
        SimpleNamespace(channels=channels, instruments=Instruments.of((), (), channels)),
        RecordData(measured),
        experiment,
    )
    information = {"deviations": np.array([0.01, 0.02]), "correlation": np.eye(2)}
    information |= {name: changed.pop(name) for name in list(changed) if name in information}
    given = {
        "prior_conflict": np.zeros(2),
        "error_in_bounds": np.array([1.0, np.nan]),
        "consistency": None,
        "relative_errors": information["deviations"],
        "indistinguishable_from_zero": np.zeros(2, dtype=bool),
        "identifiable": np.ones(2, dtype=bool),
        "optima": None,
        "ambiguous": False,
        "undetermined": (),
        "rejection": None,
        "decided_by": ["data", "data"],
    }
    return SimpleNamespace(
        likelihood=SimpleNamespace(names=("a.k", "b.k"), records=[record]),
        information=SimpleNamespace(
            deviations=lambda: information["deviations"],
            correlation=lambda: information["correlation"],
            freedom=600,
        ),
        channels=[
            ChannelOfRecord(0, column, channel.name, channel.unit) for column, channel in enumerate(channels)
        ],
        fit=SimpleNamespace(parts=[SimpleNamespace(predicted=Trajectory(measured - residual, None))]),
        comparison=SimpleNamespace(lacks_fit=False),
        shapes=[None, None],
        contradicted_noise=[],
        noise_test=None,
        model_error=None,
        mistakes=changed.pop("mistakes", ()),
        estimate=SimpleNamespace(cut_off=0),
        growing=None,
        several=False,
        noun="record",
        **(given | changed),
    )


def test_a_good_result_has_no_warnings(noisy):
    assert warnings(posterior()) == []
    assert diagnostic(noisy, "warnings").tolist() == []
    assert diagnostic(noisy, "verdict") == "converged: optimum found, the model explains the record"


def coloured():
    t = np.arange(300) * 0.01
    return np.stack([NOISE[:, 0], 3 * np.sin(60 * t)], axis=1)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"error_in_bounds": np.array([7.3, 1.0])}, "error of a.k: 7.3 × Cramér–Rao bound"),
        ({"deviations": np.array([0.01, 0.8])}, "b.k is poorly known: its standard error is 80 % of it"),
        (
            {"deviations": np.array([0.01, 0.8]), "indistinguishable_from_zero": np.array([False, True])},
            "b.k is indistinguishable from 0: a thousandth of it explains the record as well",
        ),
        (
            {"correlation": np.array([[1, -0.97], [-0.97, 1]])},
            "a.k and b.k are hardly distinguishable (correlation -0.970): the record determines their ",
        ),
        (
            {"correlation": np.array([[1, 0.97], [0.97, 1]])},
            "a.k and b.k are hardly distinguishable (correlation 0.970): the record determines their ratio",
        ),
        ({"residual": coloured()}, "is not white noise; it is strongest at 60"),
        ({"measured": np.clip(MEASURED, -5, 5)}, "1.velocity stands at its extreme value in"),
        (
            {"measured": np.where(np.arange(300)[:, None] % 3 == 0, np.nan, MEASURED)},
            "1.velocity has 33 % of its samples missing",
        ),
        (
            {"consistency": consistency(1.3 * NOISE)},
            "the filter's innovations are larger than it assumes: mean square 1.",
        ),
    ],
)
def test_each_trouble_is_one_sentence(changed, said):
    found = warnings(posterior(**changed))
    assert any(said in sentence for sentence in found), found
    assert len(found) <= 2  # two channels


def test_coloured_residuals_of_several_channels_are_one_warning_with_one_remedy():
    series = np.repeat(coloured()[:, 1:], 2, axis=1)
    (said,) = warnings(posterior(residual=series))
    assert said.startswith("the residuals of 1.velocity (")
    assert ", 2.velocity (" in said
    assert said.count("strongest at 60") == 2
    assert said.count("noise: {kind: coloured, order: auto}") == 1


def test_coloured_noise_is_no_remedy_where_a_mistake_of_an_instrument_explains_it():
    found = warnings(posterior(residual=coloured(), mistakes=("the lack of fit is explained where …",)))
    assert any("is not white noise" in sentence for sentence in found)
    assert not any("noise: {kind: coloured" in sentence for sentence in found)


def test_a_clipped_record_is_said_to_be_one():
    values = run(measurement=simulated(0.01, settle=0.0)).value("identification/measurement/measured")
    limit = 0.7 * np.abs(values).max()
    clipped = Measurement(0.002, 800, VELOCITIES, np.clip(values, -limit, limit))
    said = diagnostic(run(measurement=clipped, estimator=Filter(2)), "warnings").tolist()
    assert any("it may be clipped" in sentence for sentence in said)
