"""Several records that share their parameters, each with its own loads, channels, sampling and state."""

import numpy as np
import pytest
from scipy.linalg import expm

from dynid.errors import NotIdentifiable, UsageError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.record_values import simulated
from dynid.lti.signals import Multisine
from dynid.lti.time_response import propagate
from dynid.structure.ports import Channel, Load, ports
from dynid.structure.state_space import state_space
from tests.identification.cases import LOADS, VELOCITIES, diagnostic, in_bounds, parameter, suspension
from tests.identification.cases import run as run_one
from tests.identification.cases import simulated as measured

OTHER = Experiment(
    (Load(1, Multisine([50, 80], [90, 160])),),
    Measurement(0.003, 300, (Channel(4, "acceleration"),), Simulation(0.05, 7, 5.0)),
)
ONE = Experiment(LOADS, measured(0.05))
SHORT = Experiment(LOADS, measured(0.05, samples=150))


def decays(count=3, samples=400):
    """Free decays of the true structure from different initial states, with noise; nothing drives them."""
    model, generator = suspension(0.6), np.random.default_rng(3)
    system = state_space(*model.dense(model.true_values()), *ports(model, [], VELOCITIES))
    experiments = []
    for _ in range(count):
        x0 = np.concatenate([np.zeros(5), generator.standard_normal(5)])
        clean = propagate(system, [], 0.002 * np.arange(samples), x0).outputs
        noisy = clean + 0.01 * generator.standard_normal(clean.shape)
        experiments.append(Experiment((), Measurement(0.002, samples, VELOCITIES, noisy)))
    return model, experiments


def test_two_records_have_more_information_than_either():
    both = identify(suspension(), [ONE, OTHER])
    alone = [identify(suspension(), [each]) for each in (ONE, OTHER)]
    together = parameter(both, "cramer_rao")
    best = np.minimum(*(parameter(result, "cramer_rao") for result in alone))
    assert np.all(together < best)
    assert np.abs(in_bounds(both)).max() < 4
    assert diagnostic(both, "converged")


def test_a_record_twice_halves_the_variance_and_changes_no_estimate():
    once, twice = run_one(measurement=measured(0.05)), identify(suspension(), [ONE, ONE])
    np.testing.assert_allclose(parameter(twice, "estimate"), parameter(once, "estimate"), rtol=1e-6)
    np.testing.assert_allclose(
        parameter(twice, "cramer_rao"), parameter(once, "cramer_rao") / np.sqrt(2), rtol=1e-9
    )


def test_a_simulated_ring_down_starts_from_its_initial_motion():
    model = suspension()
    source = Simulation(0.0, 1, 0.004, displacement={5: 0.01}, velocity={1: -0.3, 2: 0.2})
    found = simulated(model, (), Measurement(0.002, 200, VELOCITIES, source)).outputs
    M, C, K = model.dense(model.true_values())
    zero, one = np.zeros((5, 5)), np.eye(5)
    A = np.block([[zero, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    x0 = np.array([0, 0, 0, 0, 0.01, -0.3, 0.2, 0, 0, 0])
    expected = [(expm(A * (0.004 + 0.002 * k)) @ x0)[[6, 7]] for k in range(200)]
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("estimator", [None, OutputError(), Filter(2)], ids=lambda e: e and e.name)
def test_free_decays_from_unknown_states_identify_the_joints(estimator):
    model, experiments = decays()
    result = identify(model, experiments, estimator)
    error = parameter(result, "estimate") - parameter(result, "true")
    assert np.abs(error / parameter(result, "standard_error")).max() < 4
    np.testing.assert_allclose(
        result["identification/diagnostics/residual_rms"].data, 0.01, rtol=0.1
    )  # of 400 samples


def test_one_free_decay_is_enough():
    model, experiments = decays(1, 800)
    result = identify(model, experiments)
    error = parameter(result, "estimate") - parameter(result, "true")
    assert np.abs(error / parameter(result, "standard_error")).max() < 4
    assert diagnostic(result, "converged")
    assert "identification/measurement/measured" in result


@pytest.mark.thorough
def test_imbedding_takes_one_record_after_the_other():
    result = identify(suspension(0.8), [SHORT, OTHER], InvariantImbedding(tolerance=1e-3))
    assert np.abs(parameter(result, "error_percent")).max() < 10


def test_every_record_has_its_groups():
    result = identify(suspension(), [ONE, OTHER], Filter(2))
    group = "identification/measurement"
    assert result[f"{group}/record_1/measured"].data.shape == (800, 2)
    assert result[f"{group}/record_2/predicted"].data.shape == (300, 1)
    np.testing.assert_allclose(np.diff(result[f"{group}/record_2/time"].data), 0.003)
    assert result["identification/history/record_2/estimate"].data.shape == (300, 4)
    assert result["identification/first_pass/record_1/state"].data.shape == (800, 10)
    names = ["record_1.2.velocity", "record_1.3.velocity", "record_2.4.acceleration"]
    assert list(result["identification/diagnostics/channel"].data) == names
    # The second record's filter goes on where the first one's ended.
    before = result["identification/history/record_1/standard_deviation"].data[-1]
    after = result["identification/history/record_2/standard_deviation"].data[0]
    assert np.all(after < 1.1 * before)


def test_a_parameter_may_be_identifiable_from_one_record_alone():
    """A record of one sample has too little information alone; beside a good one it does no harm."""
    short = Experiment(LOADS, Measurement(0.002, 1, VELOCITIES, Simulation(0.05, 1, 10.0)))
    with pytest.raises(NotIdentifiable):
        identify(suspension(), [short])
    result = identify(suspension(), [ONE, short])
    alone = run_one(measurement=measured(0.05))
    # A hundredth of a standard error is what an iteration may leave.
    np.testing.assert_allclose(parameter(result, "estimate"), parameter(alone, "estimate"), rtol=1e-4)


def test_no_record_is_refused():
    with pytest.raises(UsageError, match="no record"):
        identify(suspension(), [])


@pytest.mark.parametrize(
    ("build", "said"),
    [
        (lambda: Simulation(noise_ratio=0.1, noise=2.0), "either a ratio or a standard deviation"),
        (lambda: Simulation(noise_ratio=-0.1), "the noise ratio must be finite and not negative"),
        (
            lambda: Measurement(0.1, 5, VELOCITIES, noise=[1.0] * len(VELOCITIES[1:]) + [0.0]),
            "must be finite and pos",
        ),
        (
            lambda: Measurement(0.1, 5, VELOCITIES, noise=[1.0] * 7),
            "'measurement.noise' has 7 entries, but there are",
        ),
    ],
)
def test_noise_that_makes_no_sense_is_refused(build, said):
    with pytest.raises(UsageError, match=said):
        build()
