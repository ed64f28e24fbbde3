"""The check of the Gaussian posterior by importance sampling, likelihood and evidence."""

import builtins
import math

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.identification.diagnosis import importance
from dynid.identification.estimators.maximum_likelihood import Huber, OutputError
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Measurement, Simulation
from dynid.identification.results.write_result import Further
from dynid.lti.signals import Multisine
from dynid.parameters import ParameterPrior
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, run, simulated

pytestmark = pytest.mark.thorough

POSTERIOR = "identification/posterior"
CHECK = Further(check=True)


def one_mass(k=None, c=2.0):
    return lumped([1.0], [], [Joint("foot", (1,), k or JointParameter(start=300.0, true=400.0), c)])


def record(model, noise, samples=60, **options):
    measurement = Measurement(0.02, samples, (Channel(1, "displacement"),), Simulation(noise, 3, 10.0))
    loads = (Load(1, Multisine([1.0, 1.0], [11.0, 27.0])),)
    return run(model, measurement, loads, further=CHECK, **options)


@pytest.fixture(scope="module")
def good():
    return record(one_mass(), 0.02)


def test_a_good_record_has_a_gaussian_posterior(good):
    result = good
    assert result.value(f"{POSTERIOR}/gaussian")
    assert result.value(f"{POSTERIOR}/effective_samples") > 900
    estimate, error = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "standard_error")
    )
    for name, side in (("low", -1.96), ("high", 1.96)):
        np.testing.assert_allclose(
            result[f"{POSTERIOR}/{name}"].data, estimate + side * error, atol=0.25 * error[0]
        )
    assert not diagnostic(result, "warnings").size


def test_a_poor_record_is_reported_with_weighted_intervals(monkeypatch):
    monkeypatch.setattr(importance, "DRAWS", 300)
    joint = JointParameter(start=3.0, true=1.0, prior=ParameterPrior(1.0, 5.0))
    model = lumped([1.0], [], [Joint("foot", (1,), JointParameter(start=300.0, true=400.0), joint)])
    result = record(model, 1.5, samples=60)
    assert result.value(f"{POSTERIOR}/k_hat") > 0.7
    assert not result.value(f"{POSTERIOR}/gaussian")
    assert any("the posterior is not Gaussian" in text for text in diagnostic(result, "warnings"))
    low, mean, high = (result[f"{POSTERIOR}/{name}"].data for name in ("low", "mean", "high"))
    assert np.all((low < mean) & (mean < high))


def test_the_weights_are_those_of_a_grid():
    """One parameter: the posterior on a grid, the likelihood computed directly."""
    result = record(one_mass(), 0.3, samples=40)
    measured = result["identification/measurement/measured"].data[:, 0]
    time = np.arange(40) * 0.02
    grid = np.exp(np.linspace(-0.6, 0.6, 1201)) * 400
    log_density = []
    for k in grid:
        pole = -1 + 1j * math.sqrt(k - 1)
        free = np.column_stack([np.exp(pole * time).real, np.exp(pole * time).imag])
        forced = sum((1 / (k - w * w + 2j * w) * np.exp(1j * w * (10 + time))).imag for w in (11.0, 27.0))
        # States x, v from amplitudes: the determinant of the information is of x and v at the start.
        states = np.linalg.inv(np.array([[1.0, 0.0], [pole.real, pole.imag]]))
        X = free @ states
        left = measured - forced
        left = left - X @ np.linalg.lstsq(X, left, rcond=None)[0]
        _, log_det = np.linalg.slogdet(X.T @ X)
        log_density.append(-(40 - 2) / 2 * math.log(left @ left) - log_det / 2)
    density = np.exp(np.array(log_density) - max(log_density))
    cumulated = np.cumsum(density) / density.sum()
    expected = np.interp([0.025, 0.975], cumulated, grid)
    found = [result[f"{POSTERIOR}/{name}"].data[0] for name in ("low", "high")]
    np.testing.assert_allclose(found, expected, atol=0.12 * (expected[1] - expected[0]))


def test_the_likelihood_is_that_of_the_residuals(good):
    result = good
    left = (
        result["identification/measurement/measured"].data
        - result["identification/measurement/predicted"].data
    )
    variance = float(np.mean(left**2))
    expected = -60 / 2 * (math.log(2 * math.pi * variance) + 1)
    assert diagnostic(result, "log_likelihood") == pytest.approx(expected, rel=1e-9)
    assert diagnostic(result, "observations") == 60
    assert diagnostic(result, "free_parameters") == 4  # k, two states, one deviation
    assert diagnostic(result, "bic") == pytest.approx(4 * math.log(60) - 2 * expected, rel=1e-9)


def frf(prior=None, noise=2e-4):
    joint = JointParameter(start=350.0, true=400.0, prior=prior)
    measurement = FrfMeasurement(
        np.linspace(5, 40, 30), (Frf(Channel(1, "displacement"), 1),), Simulation(0.05, 2), noise
    )
    return identify(one_mass(joint), measurement, further=CHECK), measurement


def test_the_evidence_of_responses_is_the_integral_over_the_prior():
    result, measurement = frf(ParameterPrior(420.0, 0.2))
    measured = result["identification/measurement/measured"].data[:, 0]
    omega, deviation = measurement.omega, 2e-4 / math.sqrt(2)
    eta, h = np.linspace(math.log(200), math.log(800), 4001, retstep=True)
    spread = math.sqrt(math.log1p(0.2**2))
    H = 1 / (np.exp(eta)[:, None] - omega**2 + 2j * omega)
    squares = np.sum(np.abs(measured - H) ** 2, axis=1) / deviation**2
    logs = -squares / 2 - 2 * len(omega) * math.log(deviation * math.sqrt(2 * math.pi))
    logs -= ((eta - math.log(420.0)) / spread) ** 2 / 2 + math.log(spread * math.sqrt(2 * math.pi))
    evidence = logs.max() + math.log(float(np.exp(logs - logs.max()).sum()) * h)
    assert result.value(f"{POSTERIOR}/log_evidence") == pytest.approx(evidence, abs=0.02)


def test_without_priors_there_is_no_evidence_and_the_reason_is_given(monkeypatch):
    monkeypatch.setattr(importance, "DRAWS", 300)
    result, _ = frf(noise=None)
    assert f"{POSTERIOR}/log_evidence" not in result
    reason = result.group_attrs[POSTERIOR]["no_evidence"]
    assert reason == "no prior of foot.k; the noise is not given"
    result = run(measurement=simulated(0.05, samples=100), further=CHECK)
    assert "the initial state has no prior" in result.group_attrs[POSTERIOR]["no_evidence"]


def test_a_robust_loss_has_no_likelihood_to_check_with():
    with pytest.raises(UsageError, match="a robust loss has not"):
        record(one_mass(), 0.02, estimator=Huber(OutputError()))


def test_without_the_extra_the_command_that_installs_it_is_named(monkeypatch):
    plain = builtins.__import__

    def without(name, *rest, **options):
        if name.startswith("arviz_stats"):
            raise ImportError(name)
        return plain(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UsageError, match=r"pip install dynid\[posterior\]"):
        record(one_mass(), 0.02)
