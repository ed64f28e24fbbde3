"""Noise in proportion to the response, and what only looks like it."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from dynid.identification.diagnosis.proportional_noise import rank_correlation
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement
from dynid.lti.signals import Sampled
from dynid.structure.ports import Channel, Load
from tests.identification.test_delays import Rig, off

pytestmark = pytest.mark.thorough

CHANNELS = (Frf(Channel(1, "acceleration"), 3), Frf(Channel(3, "velocity"), 3))


def responses(rig, noise, masses=None):
    """Return measured responses, with complex noise whose deviation `noise` makes of their sizes."""
    omega = np.linspace(0.15, 1.0, 180) * rig.omega[-1]
    M = np.diag(rig.masses if masses is None else masses)
    H = [np.linalg.solve(rig.stiffness - M * w * w + 1j * w * rig.damping, [0.0, 0.0, 1.0]) for w in omega]
    H = np.array(H)[:, [0, 2]] * np.column_stack([-(omega**2), 1j * omega])
    parts = rig.rng.standard_normal((2, *H.shape)) / np.sqrt(2)
    return FrfMeasurement(omega, CHANNELS, H + noise(np.abs(H)) * (parts[0] + 1j * parts[1]))


def warnings(result) -> str:
    return "\n".join(result["identification/diagnostics/warnings"].data)


@pytest.mark.parametrize("seed", [3, 5, *(pytest.param(s, marks=pytest.mark.slow) for s in range(6, 30))])
def test_noise_in_proportion_is_suggested_with_the_result_that_it_gives(seed):
    rig = Rig(seed)
    measured = responses(rig, lambda size: 0.02 * size)
    result = identify(rig.model(), measured)
    said = warnings(result)
    assert (
        "State noise: {kind: proportional} in the measurement: with that the model has no lack of fit" in said
    )
    assert "grow" in said
    assert "outlier" not in said
    # The result that is announced is that of the noise as it is then stated.
    stated = FrfMeasurement(measured.omega, CHANNELS, measured.source, proportional=True)
    result = identify(rig.model(), stated)
    assert result.value("identification/diagnostics/converged")
    assert not result.value("identification/diagnostics/lacks_fit")
    assert np.abs(off(result)).max() < 4.5
    assert "grow" not in warnings(result)
    announced = float(said.partition("bolt.c = ")[2].split(" ± ")[0].replace(" ", ""))
    np.testing.assert_allclose(announced, result["identification/parameters/estimate"].data[1], rtol=0.01)


@pytest.mark.parametrize("seed", [3, *(pytest.param(s, marks=pytest.mark.slow) for s in range(4, 24))])
def test_noise_of_one_deviation_suggests_nothing(seed):
    result = identify(Rig(seed).model(), responses(Rig(seed), lambda size: 0.02 * size.mean(axis=0)))
    assert "grow" not in warnings(result)
    assert not result.value("identification/diagnostics/lacks_fit")


def test_a_wrong_model_is_not_excused_by_the_noise():
    rig = Rig(7)
    wrong = rig.masses * [1.0, 1.0, 1.02]
    said = warnings(identify(rig.model(), responses(rig, lambda size: 2e-3 * size.mean(axis=0), wrong)))
    assert "no lack of fit" not in said
    assert "the model lacks fit" in said


@pytest.mark.parametrize("proportional", [True, False])
def test_samples_whose_noise_grows_with_the_response_are_named(proportional):
    rig = Rig(9)
    values = np.column_stack([rig.recorded(1, "velocity", 0.0), rig.recorded(3, "velocity", 0.0)])
    size = np.abs(values) if proportional else np.sqrt(np.mean(values**2, axis=0))
    values = values + 0.03 * size * rig.rng.standard_normal(values.shape)
    channels = (Channel(1, "velocity"), Channel(3, "velocity"))
    load = Load(3, Sampled(rig.force(), rig.step))
    result = identify(rig.model(), Experiment([load], Measurement(rig.step, rig.samples, channels, values)))
    assert ("with the response: noise in proportion to it?" in warnings(result)) == proportional


def test_rank_correlations_are_those_of_scipy():
    rng = np.random.default_rng(0)
    a, b = rng.standard_normal((2, 300))
    b = b + 0.4 * a
    a[7], b[11] = np.nan, np.nan
    correlation, p = rank_correlation(a, b)
    both = ~np.isnan(a + b)
    expected = spearmanr(a[both], b[both], alternative="greater")
    np.testing.assert_allclose(correlation, expected.statistic, rtol=1e-10)
    assert 0.1 < p / expected.pvalue < 10
    assert rank_correlation(np.full(5, np.nan), np.ones(5)) == (0.0, 1.0)


def test_a_lack_of_fit_that_nothing_explains_names_a_nonlinear_joint():
    rig = Rig(7)
    size = lambda size: 2e-3 * size.mean(axis=0)  # noqa: E731
    wrong = warnings(identify(rig.model(), responses(rig, size, rig.masses * [1.0, 1.0, 1.02])))
    assert "nonlinear joint" in wrong
    assert "nonlinear joint" not in warnings(identify(rig.model(), responses(rig, size)))
    explained = warnings(identify(rig.model(), responses(rig, lambda size: 0.02 * size)))
    assert "nonlinear joint" not in explained
