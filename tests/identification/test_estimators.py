"""Maximum likelihood and the default estimator: where they end, from how far, and what they say of it."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from dynid.errors import Diverged, UsageError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.likelihood.time_record import TimeRecord
from dynid.identification.records.measurement import Measurement
from dynid.identification.systems.parametric_model import parametric_model
from dynid.identification.systems.record_values import data
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import lumped
from dynid.structure.ports import Channel
from tests.identification.cases import (
    LINKS,
    LOADS,
    MASSES,
    diagnostic,
    in_bounds,
    parameter,
    run,
    simulated,
    suspension,
)
from tests.sample import sample

pytestmark = pytest.mark.thorough

TRUE = np.array([2e4, 20.0, 2e4, 20.0])


def started(*factors):
    """The suspension, its joints started at these factors of the truth."""
    k2, c2, k3, c3 = (
        JointParameter(start=f * v, true=v) for f, v in zip(factors, TRUE.tolist(), strict=True)
    )
    return lumped(MASSES, LINKS, [Joint("j2", (2, 3), k2, c2), Joint("j3", (3, 4), k3, c3)])


@pytest.mark.parametrize("estimator", [None, OutputError()], ids=["auto", "output-error"])
def test_clean_data_give_the_parameters_to_rounding(estimator):
    result = run(estimator=estimator)
    # doubles: relative 1e-16 on the record, times its condition of 1e4
    assert parameter(result, "error_percent").max() < 1e-9
    assert diagnostic(result, "converged")


@pytest.mark.parametrize("noise", [0.05, 0.5])
def test_output_error_ends_where_an_optimiser_ends_that_shares_nothing_with_it(noise):
    channels = (Channel(2, "velocity"), Channel(3, "acceleration"))
    measurement, model = simulated(noise, channels=channels), suspension(0.9)
    result = run(model, measurement, estimator=OutputError())
    record = data(model, LOADS, measurement)
    fits = TimeRecord(parametric_model(model, LOADS, channels, measurement.record.times), record)
    eta = np.log(parameter(result, "estimate"))
    sigma = np.sqrt(np.mean(fits.fit(eta, record.values).residual ** 2, axis=0))

    def over_noise(x):
        return (fits.fit(x, record.values, sigma).residual / sigma).ravel()

    best = least_squares(over_noise, eta + 0.01, jac="3-point", xtol=1e-12)
    deviation = parameter(result, "standard_error") / parameter(result, "estimate")
    assert np.abs(best.x - eta).max() < 0.01 * deviation.min()
    assert diagnostic(result, "settled")


@pytest.mark.parametrize("factor", sample([0.05, 0.1, 3, 10], 2))
def test_far_starts_end_at_the_optimum(factor):
    result = run(suspension(factor), simulated(0.05, 3))
    near = run(suspension(1.05), simulated(0.05, 3), estimator=OutputError())
    np.testing.assert_allclose(parameter(result, "estimate"), parameter(near, "estimate"), rtol=1e-4)
    assert diagnostic(result, "converged")


def test_where_the_residuals_reject_a_pass_more_are_run():
    result = run(started(30.8, 0.012, 6.76, 0.01), simulated(0.05, 107))
    assert np.abs(in_bounds(result)).max() < 5
    assert list(result.value("identification/stages/stage")) != ["a filter pass"]
    assert diagnostic(result, "converged")


def test_output_error_alone_says_that_it_ended_elsewhere():
    with pytest.raises(Diverged, match="are invalid"):
        run(suspension(0.1), simulated(0.05, 3), estimator=OutputError())


def test_channels_count_by_their_noise():
    """One channel is a hundred times noisier, unknown to the estimator: it must hardly matter."""
    rng = np.random.default_rng(0)
    channels = (Channel(2, "velocity"), Channel(3, "velocity"))
    model, clean = suspension(0.8), data(suspension(), LOADS, simulated(settle=0.0)).values
    rms = np.sqrt(np.mean(clean**2, axis=0))
    noisy = clean + np.array([0.005, 0.5]) * rms * rng.standard_normal(clean.shape)
    result = run(model, Measurement(0.002, 800, channels, noisy))
    error = np.abs(parameter(result, "estimate") - TRUE) / parameter(result, "standard_error")
    assert error.max() < 4
    assert (parameter(result, "standard_error") / TRUE).max() < 0.01  # by rms alone it were ten times that


def test_stages_tell_what_was_tried():
    result = run(measurement=simulated(0.05))
    assert list(result.value("identification/stages/stage")) == ["a filter pass"]
    assert result.value("identification/stages/iterations")[0] >= 1
    np.testing.assert_array_equal(
        result.value("identification/stages/estimate")[-1], parameter(result, "estimate")
    )
    assert result.group_attrs["identification"]["estimator"] == "auto"


def test_the_history_of_a_whole_record_is_its_estimate():
    result = run(measurement=simulated(0.05), estimator=OutputError())
    history = result.value("identification/history/estimate")
    np.testing.assert_allclose(history, np.broadcast_to(parameter(result, "estimate"), history.shape))
    spread = result.value("identification/history/standard_deviation")[0]
    np.testing.assert_allclose(spread, parameter(result, "standard_error"))


@pytest.mark.usefixtures("few_starts")
def test_a_run_away_is_named():
    y = data(suspension(), LOADS, simulated(samples=200)).values
    with pytest.raises(Diverged, match="are invalid") as caught:
        run(measurement=Measurement(0.002, 200, (Channel(2, "velocity"), Channel(3, "velocity")), 1e-6 * y))
    assert set(caught.value.names) <= {"j2.k", "j2.c", "j3.k", "j3.c"}


def test_nonsense_is_refused():
    with pytest.raises(UsageError, match="at least one iteration"):
        OutputError(0)
    with pytest.raises(UsageError, match="at least one pass"):
        Filter(0)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.05, 0.1, 0.25, 0.5, 2, 3, 10])
def test_twenty_records_from_each_start_factor(factor):
    ends = [np.abs(in_bounds(run(suspension(factor), simulated(0.05, seed)))).max() for seed in range(20)]
    assert max(ends) < 5


@pytest.mark.slow
def test_two_hundred_starts_anywhere_within_a_hundred():
    rng = np.random.default_rng(2026)
    ends = []
    for seed in range(200):
        factors = 10 ** rng.uniform(-2, 2, 4)
        result = run(started(*factors), simulated(0.05, seed))
        there = np.abs(in_bounds(result)).max() < 5
        assert there or not diagnostic(result, "converged")
        ends.append(there)
    assert sum(ends) >= 195
