"""Controllers with limits and anti-windup: time responses against independent integrators."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import dynid
from dynid.cli.screen import summary
from dynid.errors import SceneError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

TIME = "bond_graph/time_response"
STOP, STEP = 0.6, 0.05

MOTOR = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    voltage: Se
    circuit: 1
    R: {type: R, value: 1}
    L: {type: I, value: 0.5}
    motor: {type: GY, value: 0.3}
    rotor: 1
    J: {type: I, value: 0.01}
    d: FRICTION
  bonds: [voltage -> circuit -> motor -> rotor -> J, circuit -> R, circuit -> L, rotor -> d]
POINT
control:
  loops:
    - {from: MEASURED, to: voltage, controller: CONTROLLER, setpoint: speed}
analysis:
  inputs: [speed]
  outputs: [J.f, L.f]
  results: [time_response]
  time: {stop: 0.6, step: 0.05, input: {kind: step, amplitude: 1.3}}
"""

FRICTION, POINT = '{type: R, law: {e: "0.1*f + 0.05*f*abs(f)"}}', "operating_point: {inputs: {voltage: 2}}"


def scene(controller, friction="{type: R, value: 0.1}", point="", measured="J.f"):
    text = MOTOR.lstrip("\n").replace("CONTROLLER", controller).replace("FRICTION", friction)
    text = text.replace("POINT", point).replace("MEASURED", measured)
    return check_source(parse_source(text, "scene.yaml"))


def integrated(rates, order, corners, x0=None):
    """Return states by Dormand and Prince's method of order 8, stopped where the answer meets a limit."""
    times = np.arange(0, STOP + STEP / 2, STEP)
    x, at = np.zeros(order) if x0 is None else np.array(x0, float), 0.0
    states = np.zeros((len(times), order))
    for event in corners:
        event.terminal = True
    while at < STOP:
        options = {"dense_output": True, "events": corners, "rtol": 1e-13, "atol": 1e-14}
        run = solve_ivp(rates, (at, STOP), x, "DOP853", **options)
        inside = (times >= at - 1e-15) & (times <= run.t[-1] + 1e-12)
        states[inside] = run.sol(times[inside]).T
        at, x = run.t[-1], run.y[:, -1]
        if run.status == 1:  # step over the corner
            further = solve_ivp(rates, (at, at + 1e-7), x, "DOP853", rtol=1e-13, atol=1e-14)
            at, x = further.t[-1], further.y[:, -1]
    return states


def assert_responses(result, states, columns):
    nonlinear, size = result[f"{TIME}/nonlinear"].data, np.abs(states).max(axis=0)[columns]
    assert (np.abs(nonlinear - states[:, columns]).max(axis=0) / size).max() < 1e-8


@pytest.mark.parametrize("tracking", [None, 0.04])
def test_a_limited_pi_controller_tracks_what_it_can_give(tracking):
    keys = "min: -0.4, max: 1" + (f", tracking: {tracking}" if tracking else "")
    result = dynid.run(scene(f"{{pid: {{kp: 3, ki: 20}}, limits: {{{keys}}}}}"))
    time = tracking or 3 / 20

    def answer(x):
        return 3 * (1.3 - x[1]) + x[2]

    def rates(_, x):
        i, w, _ = x
        given = np.clip(answer(x), -0.4, 1)
        wind = 20 * (1.3 - w) + (given - answer(x)) / time
        return [(given - i - 0.3 * w) / 0.5, (0.3 * i - 0.1 * w) / 0.01, wind]

    corners = [lambda _, x: answer(x) - 1, lambda _, x: answer(x) + 0.4]
    assert_responses(result, integrated(rates, 3, corners), [1, 0])
    assert result[f"{TIME}/nonlinear_deviation"].data.max() > 0.3
    assert result[f"{TIME}/response"].data[:, 0].max() > result[f"{TIME}/nonlinear"].data[:, 0].max()


def test_limits_that_are_not_reached_change_nothing():
    result = dynid.run(scene("{pid: {kp: 3, ki: 20, kd: 0.1, tf: 0.01}, limits: {min: -99, max: 99}}"))
    linear, nonlinear = (result[f"{TIME}/{name}"].data for name in ("response", "nonlinear"))
    assert nonlinear == pytest.approx(linear, rel=1e-8, abs=1e-9)


def test_a_limited_loop_around_laws_acts_on_deviations_from_their_point():
    FRICTION, POINT = (
        '{type: R, law: {e: "0.1*f + 0.05*f*abs(f)"}}',
        "operating_point: {inputs: {voltage: 2}}",
    )
    controller = "{numerator: [2, 30], denominator: [0.02, 1, 0], limits: {min: -1, max: 1, tracking: 0.1}}"
    result = dynid.run(scene(controller, FRICTION, POINT))

    def torque(w):
        return 0.1 * w + 0.05 * w * abs(w)

    # at rest 2 = i + 0.3 w, 0.3 i = torque(w)
    w0 = np.roots([0.05, 0.1 + 0.09, -0.6]).max()
    i0 = 2 - 0.3 * w0

    def answer(x):  # (2 s + 30)/(s (0.02 s + 1)) = 30/s + 1.4/(0.02 s + 1)
        return x[3] + x[4] + 70 * x[2]

    def rates(_, x):
        i, w, lag, _, _ = x
        error, given = 1.3 - (w - w0), np.clip(answer(x), -1, 1)
        return [
            (2 + given - i - 0.3 * w) / 0.5,
            (0.3 * i - torque(w)) / 0.01,
            error - 50 * lag,
            30 * error,
            (given - answer(x)) / 0.1,
        ]

    corners = [lambda _, x: answer(x) - 1, lambda _, x: answer(x) + 1]
    states = integrated(rates, 5, corners, [i0, w0, 0, 0, 0]) - [i0, w0, 0, 0, 0]
    states[:, 2] = 70 * states[:, 2]
    assert_responses(result, states, [1, 0])
    assert result[f"{TIME}/operating_value"].data == pytest.approx([w0, i0], rel=1e-9)


def test_loops_without_limits_are_closed_around_laws():
    result = dynid.run(scene("{pid: {kp: 1, ki: 5}}", FRICTION, measured="rotor.q"))

    def rates(_, x):
        i, w, q, sums = x
        torque = 0.1 * w + 0.05 * w * abs(w)
        return [((1.3 - q) + 5 * sums - i - 0.3 * w) / 0.5, (0.3 * i - torque) / 0.01, w, 1.3 - q]

    assert_responses(result, integrated(rates, 4, []), [1, 0])


def test_a_controller_does_not_measure_what_moves_at_the_operating_point():
    FRICTION, POINT = (
        '{type: R, law: {e: "0.1*f + 0.05*f*abs(f)"}}',
        "operating_point: {inputs: {voltage: 2}}",
    )
    result = dynid.run(scene("{pid: {kp: 1, ki: 5}}", FRICTION, POINT, measured="rotor.q"))
    left_out = result.group_attrs[TIME]["nonlinear"]
    assert left_out == "left out: a controller measures 'rotor.q', which moves at the operating point"


@pytest.mark.parametrize("method", ["tustin", "backward", "zoh", "z"])
def test_sampled_controllers_hold_what_their_limits_let_through(method):
    kp, ki, T, tracking, low, high = 3, 20, 0.02, 0.1, -0.3, 1
    sampling = f"sample: {T}, method: {method}, limits: {{min: {low}, max: {high}, tracking: {tracking}}}"
    law = f"numerator: [{kp}, {ki}], denominator: [1, 0]"
    gain = {"tustin": kp + ki * T / 2, "backward": kp + ki * T, "zoh": kp, "z": kp}[method]
    if method == "z":
        law = f"numerator: [{kp}, {ki * T - kp}], denominator: [1, -1]"
    result = dynid.run(scene(f"{{{law}, {sampling}}}"))
    E = expm(T / 4 * np.array([[-2, -0.6, 2], [30, -10, 0], [0, 0, 0]]))
    x, integral, states = np.zeros(2), 0.0, []
    for _ in range(round(STOP / T) + 1):
        error = 1.3 - x[1]
        answer = gain * error + integral
        given = min(max(answer, low), high)
        integral += ki * T * error + T / tracking * (given - answer)
        for _ in range(4):  # quarters of a period, between the samples, too
            states.append(x)
            x = E[:2, :2] @ x + E[:2, 2] * given
    at = np.arange(0, round(STOP / T) * 4 + 1, 10)
    assert_responses(result, np.array(states)[at], [1, 0])
    assert result[f"{TIME}/nonlinear_deviation"].data.max() > 0.3
    assert "exact from sample to sample" in summary(result, "")


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        ("{gain: 2, limits: {min: 1, max: 2}}", "0, what a controller gives at rest, is within them"),
        ("{gain: 2, limits: {min: 0, max: 0}}", "'min' is below 'max'"),
        ("{gain: 2, limits: {min: -1, max: 1, tracking: 1}}", "nothing to track"),
        ("{gain: 2, delay: 0.1, limits: {min: -1, max: 1}}", "a controller with a 'delay' has no 'limits'"),
        ("{pid: {ki: 2}, limits: {min: -1, max: 1}}", "state 'tracking'"),
        ("{pid: {kp: -1, ki: 2}, limits: {min: -1, max: 1}}", "state 'tracking'"),
        ("{numerator: [1], denominator: [1, 0], limits: {min: -1, max: 1}}", "state 'tracking'"),
        ("{numerator: [1, 1], denominator: [1, 0, 0], limits: {min: -1, max: 1}}", "more than once"),
        (
            "{numerator: [1, 1], denominator: [1, -2, 1], method: z, sample: 1, limits: {min: -1, max: 1}}",
            "more than once",
        ),
    ],
)
def test_faults_of_limits(controller, message):
    with pytest.raises(SceneError) as raised:
        scene(controller)
    (fault,) = [fault for fault in raised.value.faults if message in str(fault)]
    assert str(fault).startswith("scene.yaml:17:")
