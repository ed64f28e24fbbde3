"""Nonlinear responses of laws in loops with delays, against Dormand and Prince step by step."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dynid
from dynid.bondgraph.operating_point.answer_history import History, delayed_borders
from dynid.errors import NumericalError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

TIME, STOP = "bond_graph/time_response", 3

DUFFING = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    F: Se
    mass: 1
    m: {type: I, value: 1}
    c: {type: R, value: 0.3}
    k: {type: C, law: {e: "q + 0.5*q**3"}}
  bonds: [F -> mass -> m, mass -> c, mass -> k]
control: {loops: [LOOPS]}
analysis:
  inputs: [INPUT]
  outputs: [k.q, m.f]
  results: [time_response]
  time: {stop: 3, step: 0.25, input: {kind: step, amplitude: 1.3}}
"""


def response(loops, source="w"):
    text = DUFFING.replace("LOOPS", loops).replace("INPUT", source).lstrip("\n")
    return dynid.run(check_source(parse_source(text, "scene.yaml")))


def stepped(rates, answers, order, delays):
    """Return states every 0.25 s; `rates` has the answers a delay ago, which `answers` gives by t and x."""
    borders = {0.0, float(STOP)}
    for k in range(int(STOP / min(delays)) + 1):
        for m in range(int(STOP / min(delays)) + 1):
            borders.add(round(k * delays[0] + m * delays[-1], 12))
    runs, x, states = [], np.zeros(order), []

    def late(t, inside):
        values = []
        for k, delay in enumerate(delays):
            at, side = t - delay, inside - delay
            if side < 0:
                values.append(0.0)
                continue
            start, _, run = next(item for item in runs if item[0] <= side < item[1])
            values.append(answers(at, run(max(at, start)), lambda at=at, side=side: late(at, side))[k])
        return values

    times = np.arange(0, STOP + 0.1, 0.25)
    for start, stop in pairwise(sorted(at for at in borders if at <= STOP)):
        middle = 0.5 * (start + stop)
        run = solve_ivp(
            lambda t, x, middle=middle: rates(t, x, late(t, middle)),
            *((start, stop), x, "DOP853"),
            **{"rtol": 1e-12, "atol": 1e-13, "dense_output": True, "max_step": 0.05},
        )
        inside = (times > start) & (times <= stop) if start else times <= stop
        states += run.sol(times[inside]).T.tolist() if inside.any() else []
        runs.append((start, stop, run.sol))
        x = run.y[:, -1]
    return np.array(states)


def assert_response(result, states):
    nonlinear, size = result[f"{TIME}/nonlinear"].data, np.abs(states).max(axis=0)[:2]
    assert nonlinear.shape == (len(states), 2)
    assert (np.abs(nonlinear - states[:, :2]).max(axis=0) / size).max() < 1e-8


def test_delayed_controllers_around_a_spring_with_a_law():
    result = response(
        "{from: m.f, to: F, controller: {gain: 0.8, delay: 0.7}, setpoint: w}, "
        "{from: k.q, to: F, controller: {pid: {kp: 0.4, ki: 0.5}, delay: 0.5}}"
    )

    def rates(_, x, late):
        q, v, _ = x
        return [v, sum(late) - 0.3 * v - q - 0.5 * q**3, -q]

    def answers(_, x, late):  # noqa: ARG001
        return [0.8 * (1.3 - x[1]), 0.4 * -x[0] + 0.5 * x[2]]

    assert_response(result, stepped(rates, answers, 3, [0.7, 0.5]))
    assert result[f"{TIME}/nonlinear_deviation"].data.max() > 0.01


def test_jumps_that_never_fade_arrive_again_and_again():
    # what is measured follows the source at once: the loop is neutral
    result = response("{from: m.e, to: F, controller: {gain: 0.6, delay: 1.1}, reference: r}", "r")

    def force(x, late):
        return 1.3 + late[0] - 0.3 * x[1] - x[0] - 0.5 * x[0] ** 3

    def rates(_, x, late):
        return [x[1], force(x, late)]

    def answers(_, x, late):
        return [-0.6 * force(x, late())]

    assert_response(result, stepped(rates, answers, 2, [1.1]))


def test_a_limited_controller_beside_a_delayed_one():
    result = response(
        "{from: m.f, to: F, controller: {gain: 0.8, delay: 0.7}}, "
        "{from: k.q, to: F, controller: {gain: 1.5, limits: {min: -1, max: 0.9}}, setpoint: w}"
    )

    def rates(_, x, late):
        q, v = x
        return [v, late[0] + np.clip(1.5 * (1.3 - q), -1, 0.9) - 0.3 * v - q - 0.5 * q**3]

    def answers(_, x, late):  # noqa: ARG001
        return [-0.8 * x[1]]

    assert_response(result, stepped(rates, answers, 2, [0.7]))


def test_borders_are_where_jumps_arrive_and_a_delay_apart():
    assert delayed_borders([0.0, 1.0], [0.3], 1.0) == pytest.approx([0, 0.3, 0.6, 0.9, 1], abs=1e-12)
    assert delayed_borders([0.0, 0.5, 2.0], [0.8], 2.0) == pytest.approx(
        [0, 0.5, 0.8, 1.3, 1.6, 2], abs=1e-12
    )
    with pytest.raises(NumericalError, match="more than 5,000 instants of jumps"):
        delayed_borders([0.0, 1.0], [1e-4], 1.0)


def test_polynomials_follow_what_they_are_given():
    history = History(1)
    history.add(0.0, 2.0, lambda t: np.array([np.sin(9 * t)]), 1e-12)
    history.add(2.0, 3.0, lambda t: np.array([5 + t]), 1e-12)
    times = np.linspace(0, 2, 41)
    values = [history.at(0, t, 1.0) for t in times]
    assert values == pytest.approx(np.sin(9 * times), abs=1e-11)
    assert [history.at(0, 2.0, side) for side in (1.0, 2.5)] == pytest.approx([np.sin(18), 7], abs=1e-11)
    assert history.at(0, -0.1, -0.05) == 0
