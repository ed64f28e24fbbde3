"""Gains, offsets and delays of instruments: exact derivatives, simulated records, estimates."""

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.errors import UsageError
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.frf_system import FrfSystem
from dynid.identification.systems.instruments import RecordSampling
from dynid.identification.systems.parametric_model import parametric_model
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.identification.systems.record_values import simulated
from dynid.lti.signals import Chirp, Impulse, Multisine, Sampled, Shifted, Step
from dynid.parameters import Parameter, coordinates, expected
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.sample import sample

pytestmark = pytest.mark.thorough

STEP = 0.002
PARAMETERS = (
    Parameter("kb", 1e4, 2e4),
    Parameter("gain", 1.0, 1.3),
    Parameter("offset", 0.0, 0.02, scale="linear"),
    Parameter("delay", 0.0, 0.0031, scale="linear"),
    Parameter("late", 0.0, 0.0013, scale="linear"),
)
NUMBERS = {one.name: Dependent.parameter(one.name, one.expected) for one in PARAMETERS}
CHANNELS = (
    Channel(2, "velocity", gain=NUMBERS["gain"], offset=NUMBERS["offset"]),
    Channel(3, "acceleration", delay=NUMBERS["delay"]),
    Channel(3, "displacement"),
)
IDEAL = tuple(Channel(one.dof, one.quantity) for one in CHANNELS)
SIGNALS = {
    "multisine": Multisine([100.0, 100.0], [70.0, 110.0]),
    "step": Step(100.0, 0.25),
    "chirp": Chirp(100.0, 20.0, 300.0, 1.6, 0.0),
    "samples": Sampled(100 * np.sin(0.1 * np.arange(300.0) ** 1.2), STEP),
}


def model(parameters=PARAMETERS):
    links = [Link((1,), 2e4, 20), Link((1, 2), 3e4, 30), Link((2, 3), NUMBERS["kb"], 20)]
    return lumped((2, 2, 1.5), links, parameters=parameters)


def loads(kind):
    return [Load(3, SIGNALS[kind], delay=NUMBERS["late"])]


def measurement(channels=CHANNELS, noise=0.0, seed=1):
    return Measurement(STEP, 300, channels, Simulation(noise, seed))


@pytest.mark.parametrize("kind", ["multisine", "chirp"])
def test_records_are_the_delayed_multiples_of_ideal_ones(kind):
    recorded = simulated(model(), loads(kind), measurement()).outputs
    times = np.arange(300) * STEP
    late = 0.0013
    shifted = [Load(3, SIGNALS[kind])]
    for column, extra, gain, offset in ((0, 0.0, 1.3, 0.02), (1, 0.0031, 1.0, 0.0), (2, 0.0, 1.0, 0.0)):
        at = times - late - extra
        ideal = Measurement(1e-4, 6001, IDEAL, Simulation())
        fine = simulated(model(), shifted, ideal).outputs[:, column]
        exact = np.where(at >= 0, np.interp(at, np.arange(6001) * 1e-4, fine), 0.0)
        # Linear interpolation between samples a tenth of a millisecond apart.
        np.testing.assert_allclose(
            recorded[:, column], gain * exact + offset, atol=1e-3 * np.abs(exact).max()
        )


@pytest.mark.parametrize("kind", SIGNALS)
def test_derivatives_are_those_of_the_prediction_but_for_free_motions(kind):
    made = parametric_model(model(), loads(kind), CHANNELS, np.arange(150) * STEP)
    eta = coordinates(made.unknowns, np.array(list(expected(made.unknowns).values()))) + 1e-3 * np.arange(5)
    x0 = 0.1 * np.random.default_rng(0).standard_normal(made.states)

    def predicted(at):
        free, steps = free_prediction(made, at)
        return prediction(made, at, x0, free, steps)

    found = predicted(eta)
    by_state = found.by_state.reshape(-1, made.states)
    for column, unit in enumerate((0.3, 1.0, 1.0, 0.02, 0.02)):  # of delays a hundredth of the fastest period
        shift = np.zeros(5)
        shift[column] = 1e-3 * unit
        difference = sum(
            weight * predicted(eta + steps * shift).outputs
            for steps, weight in ((2, -1 / 12), (1, 2 / 3), (-1, -2 / 3), (-2, 1 / 12))
        ) / (1e-3 * unit)
        off = (difference - found.by_parameter[..., column]).ravel()
        # The first state is that at the first time of a delayed channel: it moves with the delay.
        off -= by_state @ np.linalg.lstsq(by_state, off, rcond=1e-12)[0]
        # Five points: 1e-12 / 30 of the fifth derivative. Steps and splines have none by a delay.
        rough = kind in ("step", "samples") and column > 2
        np.testing.assert_allclose(off, 0, atol=(1e-4 if rough else 1e-9) * np.abs(difference).max())


@pytest.mark.parametrize("kind", sample(SIGNALS, 1))
def test_gains_offsets_and_delays_are_estimated_within_their_bounds(kind):
    result = identify(model(), Experiment(loads(kind), measurement(noise=0.02)))
    group = "identification/parameters"
    estimate, true, bound = (result[f"{group}/{name}"].data for name in ("estimate", "true", "cramer_rao"))
    assert np.all(np.abs(estimate - true) < 4.5 * bound)
    assert result.value("identification/diagnostics/converged")
    np.testing.assert_allclose(result[f"{group}/standard_error"].data, bound, rtol=0.2)


def test_compiled_kernels_take_gains_and_offsets(monkeypatch):
    parameters = PARAMETERS[:3]
    channels = (*CHANNELS[:1], Channel(3, "acceleration"))
    found = []
    for wish in "01":
        monkeypatch.setenv("DYNID_COMPILED", wish)
        record = Measurement(STEP, 300, channels, Simulation(0.02, 1))
        result = identify(model(parameters), Experiment([Load(3, SIGNALS["multisine"])], record))
        found.append(result["identification/parameters/estimate"].data)
    np.testing.assert_allclose(*found, rtol=1e-7)


@pytest.mark.usefixtures("complete")
def test_frequency_responses_turn_by_the_delay_and_grow_by_the_gain():
    omega = np.linspace(5.0, 200.0, 80)
    ideal = FrfSystem.of(model(()), [Frf(Channel(2, "velocity"), 3)]).response(omega).values
    parameters = PARAMETERS[:2] + PARAMETERS[3:4]
    channel = Channel(2, "velocity", gain=NUMBERS["gain"], delay=NUMBERS["delay"])
    system = FrfSystem.of(model(parameters), [Frf(channel, 3)])
    np.testing.assert_allclose(
        system.response(omega).values[:, 0], 1.3 * np.exp(-0.0031j * omega) * ideal[:, 0], rtol=1e-12
    )
    eta = coordinates(parameters, np.array([2e4, 1.3, 0.0031]))
    slopes = system.response(omega, eta).slopes
    for column in range(3):
        shift = np.zeros(3)
        shift[column] = 1e-6
        change = system.response(omega, eta + shift).values - system.response(omega, eta - shift).values
        np.testing.assert_allclose(
            slopes[..., column], change / 2e-6, atol=1e-6 * np.abs(change / 2e-6).max()
        )
    record = FrfMeasurement(omega, (Frf(channel, 3),), Simulation(0.02, 1))
    result = identify(model(parameters), record)
    estimate, true, bound = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "true", "cramer_rao")
    )
    assert np.all(np.abs(estimate - true) < 4.5 * bound)


def test_times_of_delayed_channels_that_are_sampling_times_are_one():
    times = np.arange(5) * 0.1
    assert RecordSampling.of(times, np.zeros(2)) is None
    found = RecordSampling.of(times, np.array([0.0, 0.2, 0.05]))
    np.testing.assert_allclose(found.times[found.rows[:, 1]], times - 0.2, atol=1e-12)
    np.testing.assert_allclose(found.times[found.rows[:, 2]], times - 0.05, atol=1e-12)
    np.testing.assert_array_equal(found.rows[:, 0], found.own)
    assert len(found.times) == 5 + 2 + 5


def test_shifted_signals_keep_their_ends():
    late = Shifted(Sampled([1.0, 2.0, 4.0, 3.0], 0.1), 0.2)
    np.testing.assert_allclose(late.value(np.array([0.0, 0.19, 0.2, 0.3, 0.5])), [1, 1, 1, 2, 3], atol=1e-12)
    early = Shifted(Sampled([1.0, 2.0, 4.0, 3.0], 0.1), -0.2, gain=2.0)
    np.testing.assert_allclose(early.value(np.array([0.0, 0.1, 0.3])), [8, 6, 6], atol=1e-12)
    assert float(Shifted(Step(1.0), 0.5).value(0.49)) == 0
    assert float(Shifted(Step(1.0), 0.5).value(0.51)) == 1


def test_what_cannot_be_delayed_is_refused():
    with pytest.raises(UsageError, match="impulse cannot be delayed"):
        Shifted(Impulse(1.0), 0.1)
    with pytest.raises(UsageError, match="imbedding takes no delays that are unknown"):
        identify(model(), Experiment(loads("multisine"), measurement(noise=0.02)), InvariantImbedding())
