"""Identification of loops with delays: predictions, derivatives, estimates, and what is refused."""

from fractions import Fraction

import numpy as np
import pytest

from dynid.arithmetic.dependent import Dependent
from dynid.bondgraph.controller_circuits import Loop
from dynid.bondgraph.graph import Bond, BondGraph, Node, Port
from dynid.errors import UsageError
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.delayed_loops import cut_graph, delayed_pole_slopes
from dynid.identification.systems.graph_system import IdentifiedGraph
from dynid.identification.systems.parametric_model import parametric_model
from dynid.identification.systems.prediction import free_prediction, prediction
from dynid.lti.signals import Multisine, Sampled, Step
from dynid.lti.state_space import StateSpace
from dynid.lti.time_response import propagate
from dynid.parameters import Parameter, starts
from tests.identification.delayed_loops import force_loop, servo

POSITION, SPEED, INERTIA = Port("k", "q"), Port("m", "f"), Port("m", "e")
SINES = Multisine((1.0, 1.0, 1.0, 1.0), (0.5, 1.5, 3.0, 5.0))


def graph(values, starts_at=None, kp=2, ki=1, measured=POSITION):
    """Return a mass with damper, spring (where it has one) and a delayed loop, all values unknown."""
    at = starts_at or values
    number = {name: Dependent.parameter(name, Fraction(at[name])) for name in values}
    nodes, bonds = [Node("F", "Se"), Node("v", "1")], [Bond("F", "v"), Bond("v", "m"), Bond("v", "b")]
    nodes += [Node("m", "I", Fraction(at["m"]), dependent=number["m"])]
    nodes += [Node("b", "R", Fraction(at["b"]), dependent=number["b"])]
    if "k" in values:
        nodes.append(Node("k", "C", 1 / Fraction(at["k"]), dependent=1 / number["k"]))
        bonds.append(Bond("v", "k"))
    above, below = ([kp, ki], [1, 0]) if ki else ([kp], [1])
    quotient = [[Fraction(entry) for entry in part] for part in (above, below)]
    loop = Loop(measured, "F", *quotient, "d", number["tau"], setpoint="r")
    cut, delayed = cut_graph(BondGraph(nodes, bonds), [loop])
    parameters = [Parameter(name, float(at[name]), true=float(value)) for name, value in values.items()]
    return IdentifiedGraph(cut, parameters, delayed=delayed)


def predicted(model, signal, times, x0=None, outputs=(POSITION, SPEED)):
    """Return the prediction from a first state (in SI units) at the starts, and the model of the record."""
    channels = tuple(model.channel(port) for port in outputs)
    record = parametric_model(model, [model.load("r", signal)], channels, times)
    eta = starts(record.unknowns)
    free, steps = free_prediction(record, eta)
    start = np.zeros(record.states) if x0 is None else x0 / record.scale
    return prediction(record, eta, start, free, steps), record


def by_hand(function):
    """Return an input that is zero before t = 0, given the middle of the interval of a time."""
    return lambda t, middle: np.array([function(t) if middle >= 0 else 0.0])


def held(signal, step, hold):
    """Return an input by hand: values and slopes of samples, in the interval of a time."""
    samples = np.asarray(signal)

    def u(t, middle):
        k = int(middle // step)
        if k < 0:
            return np.zeros(1)
        slope = 0.0 if hold == "zero" else (samples[min(k + 1, len(samples) - 1)] - samples[k]) / step
        return np.array([samples[k] + slope * (t - k * step)])

    return u


VALUES = {"m": 1.0, "b": 0.6, "k": 4.0}
CASES = {
    # tau, input, levels of delays at which corners are still borders
    "sines": (0.31, "sines", 8),
    "step": (0.31, "step", 8),
    "held": (0.17, "zero", 4),
    "lines": (0.17, "linear", 4),
    "multiple of the step": (0.2, "linear", 4),
    "shorter than the step": (0.03, "linear", 3),
}


def oracle(case, values, start, count=40):
    tau, kind, levels = CASES[case]
    equations = servo(**({"tau": tau} | values))
    step = 0.1
    times = step * np.arange(count)
    samples = np.random.default_rng(5).standard_normal(count)
    if kind == "sines":
        u, breaks, signal = by_hand(lambda t: float(SINES.value(t))), (), SINES
    elif kind == "step":
        u, breaks, signal = by_hand(lambda _: 1.0), (), Step(1.0)
    else:
        u, breaks, signal = held(samples, step, kind), times[1:], Sampled(samples, step, hold=kind)
    return equations.response(u, breaks, start, times, levels), signal, times


@pytest.mark.parametrize(
    "case", ["step", *(pytest.param(case, marks=pytest.mark.thorough) for case in CASES if case != "step")]
)
def test_predictions_agree_with_an_integrator_from_break_to_break(case):
    start = np.array([0.3, -0.2, 0.1])
    (states, _), signal, times = oracle(case, VALUES, start)
    # States of the graph: speed, position, and the integral of what is measured less the setpoint.
    first = start[[1, 0, 2]] * [1, 1, -1]
    outputs = predicted(graph(VALUES | {"tau": CASES[case][0]}), signal, times, first)[0].outputs
    assert np.abs(outputs - states[:, :2]).max() < 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize("case", ["sines", pytest.param("lines", marks=pytest.mark.slow)])
def test_derivatives_agree_with_extrapolated_differences_of_the_integrator(case):
    start, tau = np.array([0.3, -0.2, 0.1]), CASES[case][0] + 0.0123
    values = VALUES | {"tau": tau}
    signal, times = oracle(case, values, start, 18)[1:]
    slopes = predicted(graph(values), signal, times, start[[1, 0, 2]] * [1, 1, -1])[0].by_parameter
    for k, (name, value) in enumerate(values.items()):

        def difference(step, name=name, value=value):
            (high, _), (low, _) = (
                oracle(case, values | {name: value * np.exp(side * step)}, start, 18)[0] for side in (1, -1)
            )
            return (high - low)[:, :2] / (2 * step)

        expected = (4 * difference(1e-3) - difference(2e-3)) / 3
        assert np.abs(slopes[..., k] - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.thorough
def test_jumps_that_go_round_a_loop_for_ever_are_derived_by_the_delay():
    values, step, count = {"m": 1.0, "b": 0.5, "tau": 0.3731}, 0.1, 24
    times, at_rest = step * np.arange(count), np.zeros(1)

    def oracle(values):
        return force_loop(**values).response(by_hand(lambda _: 1.0), (), at_rest, times, 12)

    result, _ = predicted(
        graph(values, kp=0.6, ki=0, measured=INERTIA), Step(1.0), times, at_rest, (SPEED, INERTIA)
    )
    states, answers = oracle(values)
    assert np.abs(result.outputs[:, 0] - states[:, 0]).max() < 1e-10
    assert np.abs(result.outputs[:, 1] - answers[:, 0] + values["b"] * states[:, 0]).max() < 1e-10
    for k, (name, value) in enumerate(values.items()):

        def difference(step, name=name, value=value):
            (high, _), (low, _) = (oracle(values | {name: value * np.exp(side * step)}) for side in (1, -1))
            return (high - low)[:, 0] / (2 * step)

        expected = (4 * difference(1e-3) - difference(2e-3)) / 3
        assert np.abs(result.by_parameter[:, 0, k] - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.thorough
def test_a_vanishing_delay_is_no_delay_and_one_beyond_the_record_no_loop():
    times = 0.1 * np.arange(60)
    samples = Sampled(np.random.default_rng(2).standard_normal(60), 0.1, hold="linear")
    outputs = {}
    for tau in (1e-13, 1e-7, 7.0):
        outputs[tau] = predicted(graph(VALUES | {"tau": tau}), samples, times)[0].outputs
    A, B = servo(**VALUES, tau=1.0).A, np.array([[0.0], [2.0], [1.0]])
    A = A + np.outer([0, 1, 0], [-2.0, 0, 1.0])  # the loop closed by hand
    prompt = propagate(
        StateSpace(A, B, np.eye(3)[:2], np.zeros((2, 1))), [samples], times, np.zeros(3)
    ).outputs
    assert np.abs(outputs[1e-13] - prompt).max() < 1e-11
    assert 1e-9 < np.abs(outputs[1e-7] - prompt).max() < 1e-5
    assert np.abs(outputs[7.0]).max() == 0.0


def test_frequency_responses_have_delays_and_their_derivatives_by_complex_steps():
    values, omega = VALUES | {"tau": 0.31}, np.array([0.0, 0.3, 2.0, 17.0])
    model = graph(values)
    system = model.system([model.load("r", SINES)], [model.channel(POSITION), model.channel(SPEED)])

    def by_hand(m, b, k, tau):
        s = 1j * omega
        controller = np.append(0.0, 2 + 1 / s[1:])
        plant = np.exp(-s * tau) / (m * s**2 + b * s + k)
        position = controller * plant / (1 + controller * plant)
        position[0] = 1.0  # the controller integrates
        return np.stack([position, s * position], axis=1)

    H, slopes = system.response(values, omega)
    np.testing.assert_allclose(H[..., 0], by_hand(**values), rtol=1e-13, atol=1e-15)
    for k, (name, value) in enumerate(values.items()):
        moved = [by_hand(**(values | {name: value * (1 + side * 1e-4)})) for side in (-2, -1, 1, 2)]
        expected = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12e-4 * value)
        np.testing.assert_allclose(slopes[..., 0, k], expected, rtol=1e-9, atol=1e-10)


def test_poles_are_roots_of_the_characteristic_function():
    model = graph(VALUES | {"tau": 0.31})
    poles = model.system([model.load("r", SINES)], [model.channel(SPEED)]).poles({})
    scale = np.abs(poles) ** 3 + 4
    residual = poles * (poles**2 + 0.6 * poles + 4) + (2 * poles + 1) * np.exp(-0.31 * poles)
    assert np.abs(residual / (scale + np.abs(np.exp(-0.31 * poles)))).max() < 1e-11
    assert len(poles) > 10
    assert np.count_nonzero(poles.real > 0) == 2


def test_derivatives_of_poles_agree_with_differences():
    values = VALUES | {"tau": 0.31}
    system = graph(values).system([], [graph(values).channel(SPEED)])

    def sensitivities(values):
        return delayed_pole_slopes(system.lft(values), system.loop_delays(values))

    poles, slopes = sensitivities(values)
    for k, (name, value) in enumerate(values.items()):
        moved = [sensitivities(values | {name: value * (1 + side * 1e-4)})[0] for side in (-2, -1, 1, 2)]
        near = [other[np.abs(other[:, None] - poles).argmin(axis=0)] for other in moved]
        expected = (near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12e-4 * value)
        np.testing.assert_allclose(slopes[:, k], expected, rtol=1e-7, atol=1e-7)


STEP, SAMPLES = 0.1, 200
TRUE = VALUES | {"tau": 0.3171}


def identified(seed, factors=(1.5, 0.6, 1.4, 0.7), estimator=None, values=TRUE, noise=0.05, samples=SAMPLES):
    """Identify all values from one simulated record, from starts wrong by these factors."""
    begun = {name: value * factor for (name, value), factor in zip(values.items(), factors, strict=True)}
    model = graph(values, begun, kp=1, ki=0)
    channels = tuple(model.channel(port) for port in (POSITION, SPEED))
    measurement = Measurement(STEP, samples, channels, Simulation(noise, seed))
    result = identify(model, Experiment([model.load("r", SINES)], measurement), estimator)
    group = "identification/parameters"
    return result, *(result[f"{group}/{name}"].data for name in ("estimate", "standard_error", "cramer_rao"))


@pytest.mark.parametrize(
    "seeds", [pytest.param(3, marks=pytest.mark.thorough), pytest.param(200, marks=pytest.mark.slow)]
)
def test_plant_and_delay_together_are_estimated_at_their_bounds(seeds):
    true, misses, covered = np.array(list(TRUE.values())), [], []
    for seed in range(seeds):
        result, estimate, error, bound = identified(seed, estimator=OutputError())
        assert result.value("identification/diagnostics/converged")
        misses.append((estimate - true) / bound)
        covered.append(np.abs(np.log(estimate / true)) < 1.96 * error / estimate)
    ratios, coverage = np.sqrt(np.mean(np.square(misses), axis=0)), np.mean(covered)
    print(f"{seeds} seeds: RMS error / bound {ratios}, coverage {np.mean(covered, axis=0)}")
    assert ratios.max() < (1.1 if seeds == 200 else 2.0)
    assert coverage > (0.92 if seeds == 200 else 0.8)


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_a_delay_that_starts_far_off_is_found_by_either_estimator(factor):
    true = np.array(list(TRUE.values()))
    for estimator in (None, OutputError()):
        result, estimate, _, bound = identified(7, (1.2, 0.8, 0.9, factor), estimator)
        assert result.value("identification/diagnostics/converged")
        assert np.abs((estimate - true) / bound).max() < 4


@pytest.mark.thorough
def test_a_delay_beyond_the_record_is_not_identifiable():
    values = TRUE | {"tau": 4.0}
    loop = graph(values, kp=1, ki=0)
    force = Sampled(np.random.default_rng(3).standard_normal(30), STEP, hold="linear")
    channels = (loop.channel(POSITION), loop.channel(SPEED))
    # The setpoint acts through the loop alone; a disturbance reaches the plant at once.
    measurement = Measurement(STEP, 30, channels, Simulation(0.01, 1))
    result = identify(loop, Experiment([loop.load("d", force)], measurement))
    identifiable = dict(zip(values, result["identification/parameters/identifiable"].data, strict=True))
    assert identifiable == {"m": True, "b": True, "k": True, "tau": False}
    assert not result.value("identification/diagnostics/converged")


@pytest.mark.thorough
def test_frequency_responses_identify_a_delay_in_a_loop():
    begun = {name: 0.7 * value for name, value in TRUE.items()}
    model = graph(TRUE, begun, kp=1, ki=0)
    functions = [Frf(model.channel(port), "r") for port in (POSITION, SPEED)]
    measurement = FrfMeasurement(np.linspace(0.2, 8, 60), tuple(functions), Simulation(0.02, 3))
    result = identify(model, measurement)
    estimate, bound = (
        result[f"identification/parameters/{name}"].data for name in ("estimate", "cramer_rao")
    )
    assert result.value("identification/diagnostics/converged")
    assert np.abs((estimate - np.array(list(TRUE.values()))) / bound).max() < 4


@pytest.mark.parametrize("estimator", [Filter(1), InvariantImbedding()])
def test_estimators_of_a_finite_state_are_refused(estimator):
    with pytest.raises(UsageError, match="a loop with a delay has what is under way in it"):
        identified(0, estimator=estimator, samples=20)


def test_records_that_do_not_begin_at_rest_are_refused():
    model = graph(TRUE, kp=1, ki=0)
    position = model.channel(POSITION)
    for channel, source, start, match in (
        (position, Simulation(0.1, 1, settle=2.0), 2.0, "before which nothing was under way"),
        (position, np.ones((20, 1)), 2.0, "an input acts before its first sample"),
        (position._replace(delay=0.1), np.ones((20, 1)), 0.0, "no delays or clocks of their own"),
    ):
        measurement = Measurement(STEP, 20, (channel,), source, start=start)
        with pytest.raises(UsageError, match=match):
            identify(model, Experiment([model.load("r", SINES)], measurement))
