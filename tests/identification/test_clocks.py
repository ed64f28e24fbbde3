"""Channels with clocks of their own: against matrix exponentials at each instant, and over many noises."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import expm

from dynid.arithmetic.dependent import Dependent
from dynid.errors import UsageError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import refine
from dynid.identification.identify import identify
from dynid.identification.problem import Problem
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.parametric_model import parametric_model
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.identification.systems.record_values import simulated
from dynid.lti.filters import Filter as InstrumentFilter
from dynid.lti.signals import Sampled
from dynid.parameters import Parameter, ParameterPrior, coordinates, starts, truths
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, ChannelClock, Load

MASSES = (8.0, 5.0, 6.0)
LINKS = {(1,): (3e6, 200.0), (1, 2): (2e6, 120.0), (2, 3): (1.5e6, 90.0)}
DRIFT, LATE = (Dependent.parameter(name, 0.0) for name in ("drift", "late"))


def model(*parameters, joint=None):
    """Return the chain whose middle link is a joint."""
    k, c = LINKS[1, 2]
    joint = joint or Joint("bolt", (1, 2), JointParameter(start=k, true=k), JointParameter(start=c, true=c))
    links = [Link(dofs, *values) for dofs, values in LINKS.items() if dofs != (1, 2)]
    return lumped(list(MASSES), links, [joint], parameters=parameters)


def unknown(name, true=0.0, **options):
    return Parameter(name, 0.0, true, scale="linear", **options)


def force(samples, seed=1):
    """Return samples of a force that fill the band of the chain."""
    return 100 * np.convolve(np.random.default_rng(seed).standard_normal(samples), [0.25, 0.5, 0.25], "same")


@dataclass
class Exact:
    """The chain under a force that is linear between its samples, step by step by scipy's exponential."""

    step: float
    force: np.ndarray
    start: np.ndarray  # first state (displacements, velocities)

    def __post_init__(self):
        C, K = np.zeros((2, 3, 3))
        for dofs, (k, c) in LINKS.items():
            v = np.zeros(3)
            v[dofs[-1] - 1] = 1
            if len(dofs) > 1:
                v[dofs[0] - 1] = -1
            K, C = K + k * np.outer(v, v), C + c * np.outer(v, v)
        mass = np.diag(MASSES)
        A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(mass, K), -np.linalg.solve(mass, C)]])
        self.B = np.append(np.zeros(5), 1 / MASSES[2])
        self.joint = np.zeros((8, 8))  # state, force, its rate
        self.joint[:6, :6], self.joint[:6, 6], self.joint[6, 7] = A, self.B, 1.0

    def states(self, times):
        """Return state and its rate at ascending times (times x 12)."""
        state, at, rows = self.start, 0.0, []
        for time in times:
            while True:
                piece = min(int(np.floor(at / self.step + 1e-9)), len(self.force) - 2)
                slope = (self.force[piece + 1] - self.force[piece]) / self.step
                value = self.force[piece] + slope * (at - piece * self.step)
                end = min((piece + 1) * self.step, time) if piece < len(self.force) - 2 else time
                full = expm(self.joint * (end - at)) @ np.array([*state, value, slope])
                state, at = full[:6], end
                if at >= time:
                    break
            rows.append(np.concatenate([state, (self.joint @ full)[:6]]))
        return np.array(rows)

    def channel(self, dof, quantity, times):
        """Return a channel at times in any order."""
        column = {"displacement": 0, "velocity": 3, "acceleration": 9}[quantity] + dof - 1
        order = np.argsort(times)
        values = np.empty(len(times))
        values[order] = self.states(times[order])[:, column]
        return values


def test_predictions_are_exponentials_at_each_instant():
    step, samples = 1e-3, 90
    exact = Exact(step, force(140), np.array([1e-4, -2e-4, 1e-4, 0.02, 0.03, -0.01]))
    drift, late = 7e-3, 0.37e-3
    channels = (
        Channel(1, "acceleration"),
        Channel(3, "acceleration", clock=ChannelClock(1 / 1024, 88, 0.025, DRIFT), gain=1.2, offset=0.3),
        Channel(2, "velocity", clock=ChannelClock(step / 3.1, 90, 0.0021), delay=LATE),
        Channel(3, "displacement", clock=ChannelClock(2.5 * step, 30), gain=-1.0),
    )
    unknowns = model(unknown("drift", drift), unknown("late", late))
    load = Load(3, Sampled(exact.force, step, "linear"))
    record = Measurement(step, samples, channels, Simulation()).record
    parametric = parametric_model(unknowns, [load], channels, record.times)
    eta = coordinates(unknowns.unknowns, truths(unknowns.unknowns))

    def predict(eta):
        free, steps = free_prediction(parametric, eta)
        # The timeline begins before the delayed channel's first sample, at which the state is known here.
        return prediction(parametric, eta, exact.start / parametric.scale, free, steps)

    j = np.arange(samples)
    times = [j * step, 0.025 + j / 1024 * (1 + drift), 0.0021 + j * step / 3.1 - late, j * 2.5 * step]
    predicted = predict(eta)
    for column, (channel, own) in enumerate(zip(channels, times, strict=True)):
        count = channel.clock.samples if channel.clock else samples
        values = exact.channel(channel.dof, channel.quantity, own[:count])
        recorded = channel.gain * values + channel.offset
        np.testing.assert_allclose(
            predicted.outputs[:count, column], recorded, atol=1e-10 * np.abs(recorded).max(), rtol=0
        )
    for place, shift in enumerate((1e-5, 1e-5, 1e-8, 1e-9)):
        ends = [predict(eta + side * shift * np.eye(4)[place]).outputs for side in (1, -1)]
        slope = (ends[0] - ends[1]) / (2 * shift)
        size = np.abs(slope).max(axis=0)
        np.testing.assert_allclose(
            predicted.by_parameter[..., place] / np.where(size > 0, size, 1),
            slope / np.where(size > 0, size, 1),
            atol=1e-5,
        )
    assert not predicted.by_parameter[:, [0, 2, 3], 2].any()  # by the drift of another channel


STEP, CLOCKS = 1e-3, (ChannelClock(1e-3, 1000), ChannelClock(1 / 1024, 1024, 0.25, DRIFT))
CHANNELS = (Channel(1, "acceleration", clock=CLOCKS[0]), Channel(3, "acceleration", clock=CLOCKS[1]))
LOAD = Load(3, Sampled(force(1300), STEP))


def measured(source, channels=CHANNELS):
    """Return a record of channels at 1,000 and 1,024 Hz, the second begun 0.25 s later."""
    return Experiment([LOAD], Measurement(STEP, 1024, channels, source))


def study(seeds, prior=None):
    """Return errors over standard errors of stiffness, damping and drift, which scatters by a prior."""
    errors, values = [], None
    for seed in range(seeds):
        rng = np.random.default_rng(1000 + seed)
        true = 5e-5 if prior is None else prior.absolute * rng.standard_normal()
        unknowns = model(unknown("drift", true, prior=prior))
        if values is None or prior is not None:
            values = simulated(unknowns, *measured(Simulation())).outputs
        noise = 0.05 * np.sqrt(np.nanmean(values**2, axis=0))
        record = measured(values + noise * rng.standard_normal(values.shape))
        likelihood = Problem.of(unknowns, record).likelihood
        fit = refine(likelihood, starts(likelihood.unknowns)).fit
        likelihood = likelihood.covering(fit.eta, narrowed=True)
        fit = refine(likelihood, fit.eta).fit
        off = fit.eta - coordinates(likelihood.unknowns, truths(likelihood.unknowns))
        errors.append(off / likelihood.information(fit, fit.noise).deviations())
    return np.array(errors)


@pytest.mark.parametrize(
    ("seeds", "prior"),
    [
        pytest.param(12, None, marks=pytest.mark.thorough),
        pytest.param(200, None, marks=pytest.mark.slow),
        pytest.param(200, ParameterPrior(0.0, deviation=1e-5), marks=pytest.mark.slow),
    ],
)
def test_estimates_are_unbiased_and_intervals_cover(seeds, prior):
    errors = study(seeds, prior)
    assert np.abs(errors.mean(axis=0)).max() < 3.5 / np.sqrt(seeds)
    covered = np.mean(np.abs(errors) < 1.96, axis=0)
    low, high = (0.92, 0.98) if seeds >= 200 else (0.7, 1.0)
    assert np.all((covered >= low) & (covered <= high)), covered


@pytest.mark.thorough
def test_poor_starts_lead_to_the_optimum_and_results_are_at_the_channels_times():
    k, c = LINKS[1, 2]
    joint = Joint("bolt", (1, 2), JointParameter(start=5 * k, true=k), JointParameter(start=c / 4, true=c))
    unknowns = model(unknown("drift", 2e-4), joint=joint)
    results = [identify(unknowns, measured(Simulation(0.05, 3))) for _ in range(2)]
    result, group = results[0], "identification/parameters"
    estimate, true, error = (
        result[f"{group}/{name}"].data for name in ("estimate", "true", "standard_error")
    )
    assert np.abs((estimate - true) / error).max() < 4
    assert not result.value("identification/diagnostics/lacks_fit")
    record = "identification/measurement"
    times, predicted, values = (
        result[f"{record}/{name}"].data for name in ("channel_time", "predicted", "measured")
    )
    j = np.arange(1024)
    np.testing.assert_allclose(times[:, 1], 0.25 + j / 1024 * (1 + estimate[2]), rtol=1e-14)
    np.testing.assert_array_equal(np.isnan(times[:, 0]), j >= 1000)
    np.testing.assert_array_equal(np.isnan(predicted), np.isnan(times))
    np.testing.assert_array_equal(np.isnan(values), np.isnan(times))
    for name in result:  # same seed, same bytes
        np.testing.assert_array_equal(results[1][name].data, result[name].data)


@pytest.mark.parametrize("estimator", [Filter(1), InvariantImbedding()])
def test_filters_are_refused(estimator):
    with pytest.raises(UsageError, match="a channel has a clock of its own") as refused:
        identify(model(unknown("drift")), measured(Simulation(0.05)), estimator)
    assert "estimator.method" in refused.value.names


@pytest.mark.thorough
def test_samples_at_unknown_inputs_are_left_out_channel_by_channel():
    clock = ChannelClock(1 / 1024, 1024, 0.4, DRIFT)  # up to 1.4 s, and the force is known up to 1.299 s
    channels = (CHANNELS[0], CHANNELS[1]._replace(clock=clock))
    unknowns = model(unknown("drift", 1e-4))
    likelihood = Problem.of(unknowns, measured(Simulation(0.05), channels)).likelihood
    record = likelihood.covering(
        coordinates(unknowns.unknowns, truths(unknowns.unknowns)), narrowed=True
    ).records[0]
    beyond = 0.4 + np.arange(1024) / 1024 * (1 + 1e-4) > 1.299 + 1e-9
    np.testing.assert_array_equal(np.isnan(record.data.values[:, 1]), beyond)
    assert np.isnan(record.data.values[:, 0]).sum() == 24
    assert record.left_out.total == beyond.sum()
    late = measured(Simulation(0.05), (CHANNELS[0], channels[1]._replace(clock=clock._replace(start=2.0))))
    with pytest.raises(UsageError, match="leave 0 of 1024 samples at which every input is known"):
        Problem.of(unknowns, late)


@pytest.mark.thorough
def test_filters_of_instruments_act_before_the_clock():
    low = InstrumentFilter("low_pass", 900.0, 2, "butterworth")
    channels = (CHANNELS[0], CHANNELS[1]._replace(filters=(low,)))
    unknowns = model(unknown("drift", 3e-4))
    experiment = measured(Simulation(), channels)
    record = Problem.of(unknowns, experiment).likelihood.records[0]
    fit = record.fit(coordinates(unknowns.unknowns, truths(unknowns.unknowns)), record.data.values)
    assert (fit.size / record.data.rms).max() < 1e-9


def test_a_model_too_fast_for_the_step_is_refused():
    stiff = lumped([1.0, 1e-9], [Link((1, 2), 1e9, 0.0)], [Joint("g", (1,), JointParameter(start=1e4), 10.0)])
    channels = (Channel(1, "velocity"), Channel(1, "acceleration", clock=ChannelClock(1 / 1024, 90)))
    source = np.random.default_rng(1).standard_normal((100, 2))
    record = Experiment([Load(1, Sampled(force(101), STEP))], Measurement(STEP, 100, channels, source))
    with pytest.raises(UsageError, match="too fast for channels with clocks of their own"):
        identify(stiff, record)
