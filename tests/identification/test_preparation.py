"""Preparation of measured records: what stays true of the linear relation, what changes, what is refused."""

import numpy as np
import pytest

from dynid.errors import Diverged, UsageError
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.records.preparation import BandPass, Decimate, Detrend, prepare
from dynid.identification.systems.record_values import simulated
from dynid.lti.signals import Chirp, Impact, Impulse, Multisine, Random, Sampled, Sine, Step
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load

pytestmark = pytest.mark.thorough

STEP, SAMPLES = 0.01, 2000
CHANNELS = (Channel(2, "displacement"), Channel(1, "acceleration"))
K, C = 300.0, 1.5


def structure(k=200.0, c=3.0):
    joint = Joint("j", (1, 2), JointParameter(start=k, true=K), JointParameter(start=c, true=C))
    return lumped((2, 1), (Link((1,), 800.0, 2.0),), [joint])


def motion(signal, x0=(0, 0, 0, 0)):
    """Integrate the two masses under a force on the second: displacement 2, acceleration 1.

    The four stages of Runge and Kutta are one step: they are linear in the state and in the force.
    """
    fine, h = 5, STEP / 5
    force = signal.value(h / 2 * np.arange(2 * fine * (SAMPLES - 1) + 1))
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = [[-(800 + K) / 2, K / 2], [K, -K]]
    A[2:, 2:] = [[-(2 + C) / 2, C / 2], [C, -C]]
    b, one, Z = np.array([0, 0, 0, 1.0]), np.eye(4), h * A
    step = one + Z @ (one + Z @ (one + Z @ (one + Z / 4) / 3) / 2)
    start = (one + Z @ (one + Z @ (one + Z / 2) / 2)) @ b
    middle = (4 * one + Z @ (2 * one + Z / 2)) @ b
    pushed = (
        h / 6 * (np.outer(force[:-1:2], start) + np.outer(force[1::2], middle) + np.outer(force[2::2], b))
    )
    states = [np.asarray(x0, dtype=float)]
    for push in pushed:
        states.append(step @ states[-1] + push)
    found = np.array(states[::fine])
    return np.column_stack([found[:, 1], found @ A[2]])


def recorded(signal, values=None, **options):
    values = motion(signal) if values is None else values
    return Experiment((Load(2, signal),), Measurement(STEP, SAMPLES, CHANNELS, values, **options))


def errors(experiment):
    """Relative errors of the estimates."""
    result = identify(structure(), experiment, estimator=OutputError())
    estimate = result["identification/parameters/estimate"].data
    return np.abs(estimate / [K, C] - 1)


FORCE = Random(10.0, 3, STEP, SAMPLES, band=(2.0, 60.0)).sampled(
    recorded(Sine(), np.ones((SAMPLES, 2))).measurement.record
)
TIMES = STEP * np.arange(SAMPLES)[:, None]
DRIFT = np.hstack([0.04 + 0.004 * TIMES, 2 - 0.4 * TIMES])


@pytest.fixture(scope="module")
def shaken():
    return motion(FORCE)


@pytest.mark.parametrize(
    "steps",
    [
        [BandPass(3.0, 50.0)],
        [Decimate(3)],
        [BandPass(0.0, 60.0), Decimate(2)],
        [Decimate(2), BandPass(4.0, 40.0, 2)],
    ],
    ids=lambda steps: "+".join(step.description for step in steps),
)
def test_filters_leave_the_relation_between_input_and_output_true(shaken, steps):
    # Limited by the tail of the filters' responses (1e-5) where the record is cut.
    assert errors(prepare(recorded(FORCE, shaken), steps)).max() < 1e-4


def test_a_drift_spoils_the_estimate_and_preparation_mends_it(shaken):
    drifting = recorded(FORCE, shaken + DRIFT)
    assert errors(drifting).max() > 3e-3
    assert errors(prepare(drifting, [Detrend(1), BandPass(3.0, 50.0)])).max() < 1e-4
    assert errors(prepare(drifting, [BandPass(3.0, 50.0), Decimate(2)])).max() < 1e-4
    # The line of least squares takes some of the motion with it.
    assert errors(prepare(drifting, [Detrend(1)])).max() < 3e-4


@pytest.mark.parametrize("hold", ["spline", "linear", "zero"])
def test_decimation_keeps_the_samples_of_inputs_so_that_every_hold_stays_what_it_is(hold):
    generator = np.random.default_rng(5)
    force = Sampled(10 * generator.standard_normal(SAMPLES), STEP, hold)
    truth = structure(K, C)
    loads, made = (Load(2, force),), Measurement(STEP, SAMPLES, CHANNELS, Simulation())
    clean = simulated(truth, loads, made).outputs
    assert errors(prepare(recorded(force, clean), [Decimate(4)])).max() < 1e-4


@pytest.mark.parametrize(
    "signal", [Sine(20.0, 13.0, 0.3), Multisine([9, 5, 7], [8, 21, 35]), Chirp(20.0, 3.0, 50.0, 20.0)]
)
def test_sines_are_scaled_and_sweeps_filtered(signal):
    steps = [BandPass(6.0, 30.0), Decimate(2)]
    assert errors(prepare(recorded(signal), steps)).max() < 1e-4


def test_free_vibration_stays_free_vibration():
    values = motion(Sine(0.0), (0.01, -0.02, 0.3, 0.1))[:1200] + DRIFT[:1200]
    experiment = Experiment((), Measurement(STEP, 1200, CHANNELS, values))
    assert errors(prepare(experiment, [Detrend(1), BandPass(4.0, 60.0)])).max() < 1e-3
    with pytest.raises(Diverged, match="unexplained"):
        errors(experiment)


def test_the_record_tells_what_was_done_to_it(shaken):
    prepared = prepare(recorded(FORCE, shaken, noise=[0.2, 0.4]), [Detrend(0), Decimate(4)])
    measurement = prepared.measurement
    assert measurement.step == 4 * STEP
    assert measurement.prepared == ("detrend constant", "decimate 4")
    np.testing.assert_allclose(measurement.noise, [0.1, 0.2])
    cut = round(measurement.start / STEP)
    assert cut * STEP == pytest.approx(measurement.start)
    assert measurement.samples == -(-(SAMPLES - 2 * cut) // 4)
    assert len(prepared.loads[0].signal.values) == SAMPLES - 2 * cut
    result = identify(structure(), prepared, estimator=OutputError())
    attrs = result.group_attrs["identification/measurement"]
    assert attrs["prepared"] == "detrend constant; decimate 4"
    assert attrs["start"] == measurement.start


def test_detrending_passes_over_missing_samples_and_leaves_a_dead_sensor_dead():
    values = np.column_stack([3 + 2 * TIMES[:, 0], np.full(SAMPLES, 0.1)])
    values[100:200] = np.nan
    found = prepare(recorded(Sine(), values), [Detrend(1)]).measurement.source
    assert np.array_equal(np.isnan(found), np.isnan(values))
    assert not np.nan_to_num(found).any()


@pytest.mark.parametrize(
    ("signal", "step", "problem"),
    [
        (
            Sine(),
            BandPass(3.0, 400.0),
            "the band ends at 400 rad/s, but at this sampling nothing is known from 314",
        ),
        (Sine(), BandPass(1e-4, 50.0), "nothing is left of it"),
        (Sine(), BandPass(1e-290, 50.0), "poles at z = 1"),
        (Sine(), Decimate(500), "nothing is left of it"),
        (Step(), Detrend(0), "a signal of kind step does not stay one"),
        (Impulse(), BandPass(3.0, 50.0), "a signal of kind impulse does not stay one"),
        (Impact(1.0, 0.1), Decimate(2), "a signal of kind impact does not stay one"),
    ],
)
def test_what_cannot_be_prepared_is_refused_at_its_step(signal, step, problem):
    values = np.ones((SAMPLES, 2))
    with pytest.raises(UsageError) as caught:
        prepare(
            recorded(signal, values),
            [Detrend(0)] * (step.name != "detrend") * (signal.kind != "step") + [step],
        )
    assert problem in str(caught.value)
    assert caught.value.remedy
    assert caught.value.names[0].endswith(step.name)


def test_gaps_are_not_filtered_nor_simulations_prepared():
    values = np.ones((SAMPLES, 2))
    values[7, 1] = np.nan
    with pytest.raises(UsageError, match=r"1\.acceleration has 1 missing samples"):
        prepare(recorded(Sine(), values), [Decimate(2)])
    made = Experiment((), Measurement(STEP, 10, CHANNELS, Simulation()))
    with pytest.raises(UsageError, match="simulated"):
        prepare(made, [Detrend(0)])


@pytest.mark.parametrize(
    "steps", [[BandPass(3.0, 50.0)], [Decimate(3)]], ids=lambda steps: steps[0].description
)
@pytest.mark.parametrize(
    ("known", "records", "off"),
    [
        (True, 6, 0.5),
        (False, 6, 0.5),
        *(pytest.param(known, 20, 0.3, marks=pytest.mark.slow) for known in (True, False)),
    ],
)
def test_error_bars_are_those_of_the_band_that_is_left(shaken, steps, known, records, off):
    noise = np.array([0.01, 1.0])
    generator = np.random.default_rng(8)
    scores = []
    for _ in range(records):
        noisy = shaken + noise * generator.standard_normal(shaken.shape)
        experiment = prepare(recorded(FORCE, noisy, noise=list(noise) if known else None), steps)
        result = identify(structure(), experiment, estimator=OutputError())
        get = {
            name: result[f"identification/parameters/{name}"].data for name in ("estimate", "standard_error")
        }
        scores.append((get["estimate"] - [K, C]) / get["standard_error"])
    # The RMS of 2 n scores scatters by 1 / 2 sqrt(n): 20 %, or 11 %.
    assert 1 - off < np.sqrt(np.mean(np.square(scores))) < 1 + off
