"""Priors, limits, robust loss, several records and frequency responses with unknowns that are no joints'."""

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.maximum_likelihood import Huber
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.lti.signals import Chirp
from dynid.parameters import Parameter, ParameterPrior
from dynid.structure.assembly import PointMass, Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.ports import Channel, Load
from tests.identification.cases import diagnostic, parameter

pytestmark = pytest.mark.thorough

TRUE = {"EI": 200.0, "m": 3.0, "g": 1.2}
START = {"EI": 170.0, "m": 3.4, "g": 1.0}
DAMPING = ProportionalDamping(0.4, 1e-3)
NUMBERS = {name: Dependent.parameter(name, value) for name, value in TRUE.items()}
TIP = Channel("w_2", "velocity")


def cantilever(*names, **more):
    """A light cantilever under a mass; these of its numbers unknown, with more options each."""
    parameters = [Parameter(name, START[name], TRUE[name], **more.get(name, {})) for name in names]
    value = {name: NUMBERS[name] if name in names else TRUE[name] for name in TRUE}
    return beam(
        1, 2.0, value["EI"], 0.1, supports=[Support(1, ("w", "theta"))],
        masses=[PointMass(2, value["m"], 0.1)], damping=DAMPING, parameters=parameters,
    )  # fmt: skip


def record(*channels, seed=1, values=None):
    return Measurement(0.05, 200, channels, Simulation(0.02, seed) if values is None else values)


LOADS = [Load("w_2", Chirp(10.0, 2.0, 12.0, 10.0))]


def assert_within_bounds(result):
    off = np.abs(parameter(result, "estimate") - parameter(result, "true"))
    assert np.all(off < 4.5 * parameter(result, "cramer_rao"))
    assert diagnostic(result, "converged")


def test_a_prior_counts_as_one_more_measurement():
    """Of one unknown: information adds up, and the estimate is the mean weighted by it."""
    prior = {"EI": {"prior": ParameterPrior(200.2, 0.001)}}
    alone, both = (identify(cantilever("EI", **more), Experiment(LOADS, record(TIP))) for more in ({}, prior))
    assert_within_bounds(alone)
    log, error = (
        [float(np.log(parameter(one, "estimate")[0])) for one in (alone, both)],
        [float((parameter(one, "standard_error") / parameter(one, "estimate"))[0]) for one in (alone, both)],
    )
    own, given = error[0] ** -2, 1 / np.log1p(0.001**2)
    assert error[1] ** -2 == pytest.approx(own + given, rel=0.01)  # the noise is estimated anew
    assert log[1] == pytest.approx(
        (own * log[0] + given * np.log(200.2)) / (own + given), abs=0.05 * error[1]
    )


def test_an_estimate_stops_at_a_limit_and_says_so():
    result = identify(cantilever("EI", "m", EI={"high": 190.0}), Experiment(LOADS, record(TIP)))
    assert parameter(result, "at_bound").tolist() == [True, False]
    assert parameter(result, "estimate")[0] == pytest.approx(190, rel=1e-12)


def test_a_gain_unknown_in_one_of_two_records():
    measured = Channel("w_2", "velocity", gain=NUMBERS["g"])
    records = [Experiment(LOADS, record(measured, seed=2)), Experiment(LOADS, record(TIP, seed=3))]
    assert_within_bounds(identify(cantilever("EI", "m", "g"), records))


def test_a_robust_loss_with_unknown_stiffness_and_mass():
    clean = identify(cantilever("EI", "m"), Experiment(LOADS, record(TIP)))
    values = clean.value("identification/measurement/measured").copy()
    values[[30, 90, 150]] += values.std()  # 50 deviations of the noise
    spoilt = record(TIP, values=values)
    plain, robust = (
        identify(cantilever("EI", "m"), Experiment(LOADS, spoilt), one) for one in (None, Huber(Auto()))
    )
    wanted, error = parameter(clean, "estimate"), parameter(clean, "standard_error")
    off = [np.abs((parameter(one, "estimate") - wanted) / error).max() for one in (plain, robust)]
    assert off[1] < 1 < off[0]


def test_frequency_responses_with_unknown_stiffness_and_mass():
    measurement = FrfMeasurement(np.linspace(1.0, 14.0, 80), (Frf(TIP, "w_2"),), Simulation(0.02, 1))
    assert_within_bounds(identify(cantilever("EI", "m"), measurement))
