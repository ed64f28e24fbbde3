"""Stated filters and masses of sensors: exact in time and frequency; undeclared ones are named."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from scipy.integrate import solve_ivp

from dynid.arithmetic.dependent import Dependent
from dynid.errors import DynidError, UsageError
from dynid.identification.diagnosis.instrument_mistakes import instrument_mistakes
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.problem import Problem
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.frf_system import FrfSystem
from dynid.identification.systems.parametric_model import system_of
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.identification.systems.record_values import simulated
from dynid.lti.filters import Filter
from dynid.lti.signals import Multisine
from dynid.parameters import Parameter, starts
from dynid.structure.frame import beam
from dynid.structure.joint_laws import Cubic
from dynid.structure.joints import JointParameter
from dynid.structure.model_laws import joint_law
from dynid.structure.ports import Channel, Load
from dynid.structure.sensor_masses import with_sensor_masses
from tests.identification.cases import diagnostic, parameter
from tests.identification.structures import suspension

LINES = np.array([9.0, 25, 44, 70, 110, 150, 190, 230, 260])
PHASES = np.random.default_rng(100).uniform(0, 2 * np.pi, len(LINES))
LOADS = [Load(5, Multisine([10.0] * len(LINES), [*LINES], [*PHASES]))]
CHANNELS = tuple(Channel(dof, "acceleration") for dof in (2, 3, 5))
FILTERS = {
    "AC-coupled": (Filter("high_pass", 8.0, 1),),
    "anti-aliased": (Filter("low_pass", 350.0, 4),),
    "Bessel": (Filter("low_pass", 250.0, 4, "bessel"),),
    "both": (Filter("high_pass", 15.0, 2), Filter("low_pass", 400.0, 6)),
    "integrator": (Filter("integrator", 3.0, 2),),
    "ideal integrator": (Filter("integrator", 0.0),),
}


def behind(filters, channels=CHANNELS):
    return tuple(channel._replace(filters=filters) for channel in channels)


def measurement(channels, source, samples=800, step=0.005):
    return Measurement(step, samples, tuple(channels), source)


def record(stated, acting, seed=1, noise=0.03, truth=None, samples=800):
    """A record behind filters that act, as a scene states them."""
    clean = simulated(truth or suspension(), LOADS, measurement(acting, Simulation(0.0, 0), samples)).outputs
    drawn = np.random.default_rng(seed).standard_normal(clean.shape)
    values = clean + noise * np.sqrt(np.mean(clean**2, axis=0)) * drawn
    return Experiment(LOADS, measurement(stated, values, samples))


# Filters


@pytest.mark.parametrize("kind", ["high_pass", "low_pass"])
@pytest.mark.parametrize("shape", ["butterworth", "bessel"])
@pytest.mark.parametrize("order", range(1, 11))
def test_filters_are_those_of_scipy(kind, shape, order):
    stated, omega = Filter(kind, 7.0, order, shape), np.linspace(0.0, 50, 40)
    of_kind = {"N": order, "Wn": 7.0, "btype": kind.removesuffix("_pass"), "analog": True, "output": "zpk"}
    z, p, k = (
        scipy.signal.butter(**of_kind)
        if shape == "butterworth"
        else scipy.signal.bessel(**of_kind, norm="mag")
    )
    wanted = scipy.signal.freqs_zpk(z, p, k, omega)[1]
    np.testing.assert_allclose(stated.response(omega, 7.0)[0], wanted, atol=1e-12)
    A, b, c, d, *_ = stated.matrices(7.0)
    states = [c @ np.linalg.solve(1j * w * np.eye(order) - A, b) + d for w in omega]
    np.testing.assert_allclose(states, wanted, atol=1e-11)
    moved = [stated.response(omega, 7.0 + h)[0] for h in (1e-4, -1e-4)]
    np.testing.assert_allclose(stated.response(omega, 7.0)[1], (moved[0] - moved[1]) / 2e-4, atol=1e-8)


@pytest.mark.parametrize("name", list(FILTERS))
def test_a_record_is_an_independent_simulation_of_structure_and_filter(name):
    model, filters = suspension(), FILTERS[name]
    at = {item.name: item.true for item in model.unknowns}
    M, C, K = model.dense(at)
    system = np.block([[np.zeros((5, 5)), np.eye(5)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    into = np.concatenate([np.zeros(5), np.linalg.solve(M, np.eye(5)[4])])
    sections = []
    for item in filters:
        if item.kind == "integrator":
            sections.append(scipy.signal.zpk2ss([], [-item.frequency] * item.order, 1.0))
            continue
        design = scipy.signal.butter if item.shape == "butterworth" else scipy.signal.bessel
        more = {} if item.shape == "butterworth" else {"norm": "mag"}
        btype = item.kind.removesuffix("_pass")
        zpk = design(item.order, item.frequency, btype=btype, analog=True, output="zpk", **more)
        sections.append(scipy.signal.zpk2ss(*zpk))

    def force(t):
        return 10.0 * np.sum(np.sin(LINES * t + PHASES))

    def rate(t, state):
        moved, at = system @ state[:10] + into * force(t), 10
        y, rates = moved[6], [moved]  # the acceleration of DOF 2
        for A, B, Cf, D in sections:
            z = state[at : at + len(A)]
            rates.append(A @ z + B[:, 0] * y)
            y, at = float(Cf[0] @ z + D[0, 0] * y), at + len(A)
        return np.concatenate(rates)

    def output(t, state):
        y, at = (system @ state[:10] + into * force(t))[6], 10
        for A, _, Cf, D in sections:
            y, at = float(Cf[0] @ state[at : at + len(A)] + D[0, 0] * y), at + len(A)
        return y

    found = simulated(model, LOADS, measurement(behind(filters)[:1], Simulation(0.0, 0), 120)).outputs[:, 0]
    times = 0.005 * np.arange(120)
    size = 10 + sum(len(section[0]) for section in sections)
    solved = solve_ivp(rate, (0, times[-1]), np.zeros(size), "DOP853", times, rtol=1e-11, atol=1e-13)
    wanted = [output(t, state) for t, state in zip(times, solved.y.T, strict=True)]
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-8 * np.abs(wanted).max())


def free(start=6.0):
    """The suspension and filters with an unknown corner, and their channels."""
    parameters = (
        Parameter("corner", start, true=8.0),
        Parameter("edge", 300.0, true=350.0),
        Parameter("leak", 5.0, true=4.0),
    )
    high, low, leak = (Dependent.parameter(item.name, item.start) for item in parameters)
    filters = (Filter("integrator", leak, 2), Filter("high_pass", high, 2), Filter("low_pass", low, 3))
    return suspension().with_parameters(parameters), behind(filters)


def differences(predict, eta):
    slopes = []
    for k in range(len(eta)):
        step = np.eye(len(eta))[k]
        table = [(predict(eta + h * step) - predict(eta - h * step)) / (2 * h) for h in (2e-3, 1e-3)]
        slopes.append((4 * table[1] - table[0]) / 3)
    return np.stack(slopes, axis=-1)


def test_derivatives_of_records_and_responses_are_exact():
    model, channels = free()
    eta = np.log([item.true for item in model.unknowns])
    experiment = Experiment(LOADS, measurement(channels, Simulation(0.0, 0), 200))
    in_time = Problem.of(model, experiment).likelihood.records[0].model
    x0 = np.random.default_rng(3).standard_normal(in_time.states)

    def predicted(at):
        return prediction(in_time, at, x0, *free_prediction(in_time, at))

    wanted = differences(lambda at: predicted(at).outputs, eta)
    size = np.abs(wanted).max(axis=(0, 1))
    np.testing.assert_allclose(predicted(eta).by_parameter / size, wanted / size, rtol=0, atol=1e-7)
    system = FrfSystem.of(model, tuple(Frf(channel, 5) for channel in channels))
    omega = np.linspace(1, 300, 50)
    found = system.response(omega, eta).slopes
    wanted = differences(lambda at: system.response(omega, at).values, eta)
    for k in range(len(eta)):
        np.testing.assert_allclose(
            found[..., k], wanted[..., k], rtol=0, atol=1e-7 * np.abs(wanted[..., k]).max()
        )


@pytest.mark.parametrize("name", list(FILTERS))
def test_joints_behind_stated_filters_are_found_exactly(name):
    channels = behind(FILTERS[name])
    clean = identify(suspension(), Experiment(LOADS, measurement(channels, Simulation(0.0, 0), 300)))
    assert parameter(clean, "error_percent").max() < 1e-3
    states = clean["identification/states/component"].data
    assert [*states[10:11]] == [f"2.acceleration {FILTERS[name][0].kind.replace('_', '-')} 1"]
    true = clean["identification/states/true"].data
    assert true.shape[1] == len(states)
    functions = tuple(Frf(channel, 5) for channel in channels)
    responses = identify(
        suspension(), FrfMeasurement(np.linspace(5, 300, 100), functions, Simulation(0.0, 1))
    )
    assert parameter(responses, "error_percent").max() < 1e-6


def test_unknown_corners_are_estimated():
    model, channels = free()
    acting = (Filter("integrator", 4.0, 2), Filter("high_pass", 8.0, 2), Filter("low_pass", 350.0, 3))
    found = identify(model, record(channels, behind(acting)), OutputError())
    assert diagnostic(found, "converged")
    z = (parameter(found, "estimate") - parameter(found, "true")) / parameter(found, "standard_error")
    assert np.abs(z).max() < 4


def errors(name, seeds, samples=800):
    """Estimates of joints less their true values over standard errors (seeds x 4)."""
    channels = behind(FILTERS[name])
    found = [identify(suspension(), record(channels, channels, seed, samples=samples)) for seed in seeds]
    return np.array(
        [
            (parameter(one, "estimate") - parameter(one, "true")) / parameter(one, "standard_error")
            for one in found
        ]
    )


def test_joints_are_unbiased():
    z = errors("both", range(2), 400)
    assert np.abs(z).max() < 4.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["AC-coupled", "anti-aliased"])
def test_joints_are_unbiased_in_many_records(name):
    z = errors(name, range(200))
    assert np.abs(z.mean(axis=0)).max() < 4 / np.sqrt(200)
    assert 0.92 <= np.mean(np.abs(z) < 1.96) <= 0.98


# Masses of sensors


def test_a_sensor_loads_all_translations_of_its_node():
    model = beam(2, 1.0, 100.0, 1.0)
    loaded = with_sensor_masses(model, {"w_2": 0.5, "2:y": 0.5})  # one node
    np.testing.assert_allclose(loaded.M - model.M, 0.5 * np.outer(model.row("w_2"), model.row("w_2")))
    parameters = (Parameter("m", 0.3, prior=None),)
    free_mass = with_sensor_masses(model.with_parameters(parameters), {"w_1": Dependent.parameter("m", 0.3)})
    (slopes,) = free_mass.slopes({"m": 0.7})
    np.testing.assert_allclose(slopes["M"], np.outer(model.row("w_1"), model.row("w_1")))
    np.testing.assert_allclose(free_mass.M - model.M, 0.3 * slopes["M"])
    with pytest.raises(UsageError, match="a rotation, has no inertia"):
        with_sensor_masses(model, {"theta_1": 0.1})
    with pytest.raises(UsageError, match="have different masses"):
        with_sensor_masses(model, {"w_2": 0.5, "2:y": 0.4})


def test_nonlinear_joints_behind_filters_are_refused():
    first, second = suspension().joints
    bent = replace(first, laws=(joint_law(Cubic(), [JointParameter(value=1e6)]),))
    model = suspension().joined([bent, second])
    with pytest.raises(UsageError, match="not described behind nonlinear laws"):
        identify(model, Experiment(LOADS, measurement(behind(FILTERS["AC-coupled"]), Simulation(0.0, 0), 50)))
    with pytest.raises(UsageError, match="not described behind nonlinear laws"):
        system_of(model, LOADS, behind(FILTERS["AC-coupled"]))


# What is not stated

ALL = "all channels pass a"
UNDECLARED = {
    "AC-coupled": ((Filter("high_pass", 8.0, 1),), f"{ALL} high-pass filter of order 1 at"),
    "AC-coupled twice": ((Filter("high_pass", 15.0, 2),), f"{ALL} high-pass filter of order 2 at"),
    "order 2": ((Filter("low_pass", 300.0, 2),), f"{ALL} low-pass filter of order 2 at"),
    "order 3": ((Filter("low_pass", 300.0, 3),), f"{ALL} low-pass filter of order 3 at"),
    "order 4": ((Filter("low_pass", 350.0, 4),), f"{ALL} low-pass filter of order 4 at"),
    "Bessel": ((Filter("low_pass", 250.0, 4, "bessel"),), "order: 4, type: bessel, unit: Hz"),
    "integrator": ((Filter("integrator", 3.0),), f"{ALL}n integrator of order 1 at"),
    "one channel": ((Filter("low_pass", 300.0, 2),), "3.acceleration passes a low-pass filter of order 2 at"),
    "mass": ((), "kg moves with DOF 3: that of the sensor 3.acceleration"),
}


def undeclared(name, seed, samples):
    """A record of an instrument that the scene does not state."""
    filters = UNDECLARED[name][0]
    acting = [channel._replace(filters=filters) for channel in CHANNELS]
    if name == "one channel":
        acting = [CHANNELS[0], acting[1], CHANNELS[2]]
    truth = with_sensor_masses(suspension(), {3: 0.1}) if name == "mass" else None
    return record(CHANNELS, acting, seed, truth=truth, samples=samples)


def searched(name, seed, samples=400):
    """What the search from the start suggests, as after a fit that has failed."""
    likelihood = Problem.of(suspension(), undeclared(name, seed, samples)).likelihood
    return instrument_mistakes(likelihood, [starts(likelihood.unknowns)])


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["order 4", "integrator"])
def test_what_is_not_stated_is_named_from_the_start(name):
    (said,) = searched(name, 1, 300)
    assert UNDECLARED[name][1] in said


def suggested(measured):
    """What an identification suggests, whose fit may be rejected."""
    try:
        found = identify(suspension(), measured)
    except DynidError as error:
        return [error.remedy] if "explained where" in error.remedy else []
    return [str(text) for text in diagnostic(found, "warnings") if "explained where" in str(text)]


@pytest.mark.slow
@pytest.mark.usefixtures("complete", "few_starts")
@pytest.mark.parametrize("name", list(UNDECLARED))
def test_what_is_not_stated_is_named_in_many_records(name):
    said = [suggested(undeclared(name, seed, 500)) for seed in range(10)]
    assert sum(any(UNDECLARED[name][1] in text for text in texts) for texts in said) >= 8


@pytest.mark.slow
@pytest.mark.usefixtures("complete")
def test_nothing_is_named_in_clean_records():
    said = [suggested(record(CHANNELS, CHANNELS, seed, samples=500)) for seed in range(200)]
    assert sum(map(bool, said)) <= 6


@pytest.mark.thorough
@pytest.mark.usefixtures("complete")
def test_what_is_not_stated_is_named_from_responses():
    model, omega = suspension(), np.linspace(5, 300, 60)
    functions = tuple(Frf(channel, 5) for channel in CHANNELS)
    filtered = tuple(replace_channel(function) for function in functions)
    clean = FrfSystem.of(model, filtered).response(omega).values
    drawn = np.random.default_rng(1).standard_normal((2, *clean.shape))
    size = 0.02 * np.sqrt(np.mean(np.abs(clean) ** 2, axis=0)) / np.sqrt(2)
    values = clean + size * (drawn[0] + 1j * drawn[1])
    found = identify(model, FrfMeasurement(omega, functions, values))
    said = [str(text) for text in diagnostic(found, "warnings") if "explained where" in str(text)]
    assert len(said) == 1
    assert "all channels pass a high-pass filter of order 1 at 8" in said[0] or "at 7.9" in said[0]


def replace_channel(function):
    return function._replace(channel=function.channel._replace(filters=FILTERS["AC-coupled"]))
