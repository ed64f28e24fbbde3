"""Inputs between their samples: the likelier hold is named, and none of good records."""

import numpy as np
import pytest
import scipy.signal

from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.record_values import data
from dynid.lti.signals import Sampled
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, parameter

pytestmark = [pytest.mark.thorough, pytest.mark.usefixtures("complete")]

STEP, SAMPLES, K, C = 0.02, 1000, 400.0, 0.8
CHANNELS = (Channel(1, "acceleration"), Channel(2, "acceleration"))


def model():
    joint = Joint("j", (1, 2), JointParameter(start=300, true=K), JointParameter(start=0.5, true=C))
    return lumped((2, 1), (Link((1,), 800, 1.5),), [joint])


def record(hold, noise, seed=1):
    """Force and accelerations: by `scipy.signal.lsim` where it knows the hold."""
    rng = np.random.default_rng(seed)
    force = rng.standard_normal(SAMPLES)
    if hold == "spline":
        measurement = Measurement(STEP, SAMPLES, CHANNELS, Simulation(noise, seed))
        return force, data(model(), [Load(1, Sampled(force, STEP))], measurement).values
    M, stiffness, damping = np.diag([2.0, 1]), [[800 + K, -K], [-K, K]], [[1.5 + C, -C], [-C, C]]
    lower = -np.linalg.solve(M, np.hstack([stiffness, damping]))
    A, B = np.vstack([np.eye(4)[2:], lower]), np.array([[0], [0], [0.5], [0]])
    times = np.arange(SAMPLES) * STEP
    y = scipy.signal.lsim((A, B, lower, B[2:]), force, times, interp=hold == "linear")[1]
    return force, y + noise * y.std(axis=0) * rng.standard_normal(y.shape)


def identified(acting, stated, noise, seed=1):
    force, values = record(acting, noise, seed)
    measurement = Measurement(STEP, SAMPLES, CHANNELS, values)
    return identify(model(), Experiment([Load(1, Sampled(force, STEP, stated))], measurement), OutputError())


def said(result):
    return [text for text in diagnostic(result, "warnings") if "its excitation is" in text]


@pytest.mark.parametrize(
    ("acting", "stated", "noise"),
    [("linear", "spline", 0.1), ("zero", "spline", 1.0), ("zero", "linear", 0.3), ("spline", "zero", 0.3)],
)
def test_the_hold_that_acts_is_named_with_the_shift_of_the_estimates(acting, stated, noise):
    result, right = identified(acting, stated, noise), identified(acting, acting, noise)
    assert said(right) == []
    (text,) = said(result)
    assert text.startswith("the record is far likelier where its excitation is ")
    assert text.endswith(f": state hold: {acting} in its excitation")
    name, _, _, shift = text.partition("; with it ")[2].split()[:4]
    k = ["j.k", "j.c"].index(name)
    before, after = (parameter(estimated, "estimate")[k] for estimated in (result, right))
    deviation = parameter(result, "standard_error")[k] / before  # of the logarithm
    assert float(shift) == pytest.approx(np.log(after / before) / deviation, rel=0.02)


def test_a_hold_that_the_record_does_not_exclude_is_named_where_it_moves_the_estimate():
    (text,) = said(identified("linear", "spline", 0.3))
    assert text.startswith(
        "the record does not decide whether its excitation is linear between its samples (hold: linear, "
    )
    assert float(text.partition("j.c moves by ")[2].split()[0]) <= -2
    assert said(identified("linear", "linear", 0.05)) == []


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_said_where_the_force_lies_far_below_half_the_sampling_rate(seed):
    """A force without content near half the sampling rate is the same with any hold that is no staircase."""
    rng = np.random.default_rng(seed)
    b, a = scipy.signal.butter(6, 0.15)
    force = scipy.signal.lfilter(b, a, rng.standard_normal(SAMPLES))
    measurement = Measurement(STEP, SAMPLES, CHANNELS, Simulation(0.1, seed))
    values = data(model(), [Load(1, Sampled(force, STEP))], measurement).values
    given = Measurement(STEP, SAMPLES, CHANNELS, values)
    assert said(identify(model(), Experiment([Load(1, Sampled(force, STEP))], given), OutputError())) == []
