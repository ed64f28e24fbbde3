"""Loops with several sample times: verdict, discrete poles and time responses against matrix exponentials."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm

import dynid
from dynid.cli.screen import summary
from dynid.errors import SceneError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

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
    d: {type: R, value: 0.1}
  bonds: [voltage -> circuit -> motor -> rotor -> J, circuit -> R, circuit -> L, rotor -> d]
control:
  loops:
    - {from: L.f, to: voltage, controller: {gain: GAIN, sample: FAST, computation: LATE}}
    - from: J.f
      to: voltage
      controller: {pid: {kp: 3, ki: 10}, sample: SLOW, computation: 0.04}
      setpoint: w
analysis:
  inputs: [w]
  outputs: [J.f, L.f]
  results: [properties, time_response]
  time: {stop: 1, step: 0.05, input: {kind: step}}
"""
DELAYED = "{from: J.f, to: voltage, controller: {gain: 1, delay: 1}}"
A = np.array([[-2, -0.6, 2], [30, -10, 0], [0, 0, 0]])


def scene(gain=2, fast="0.02", late="0.013", slow="0.03", text=MOTOR):
    for name, value in (("GAIN", gain), ("FAST", fast), ("LATE", late), ("SLOW", slow)):
        text = text.replace(name, str(value))
    return check_source(parse_source(text.lstrip("\n"), "scene.yaml"))


class Machine:
    """The motor with both controllers, which sample, compute and hold."""

    def __init__(self, gain, fast, late, slow):
        self.gain, self.times = gain, (Fraction(fast), Fraction(slow))
        self.lates = (Fraction(late), Fraction("0.04"))
        under_way = [int(late // time) for late, time in zip(self.lates, self.times, strict=True)]
        self.sizes = [2, 1, 2, *under_way]
        self.x, self.sum, self.held = np.zeros(2), 0.0, [0.0, 0.0]
        self.queues = [[0.0] * count for count in under_way]

    @property
    def state(self):
        return np.concatenate([self.x, [self.sum], self.held, *self.queues])

    @state.setter
    def state(self, values):
        self.x, rest, held, *queues = np.split(values, np.cumsum(self.sizes)[:-1])
        self.sum, self.held, self.queues = rest[0], list(held), [list(queue) for queue in queues]

    def run(self, stop, target, shown=()):
        """Move to a time from 0; return x at the shown times."""
        stop, outputs = Fraction(stop), []
        events = {k * time + late - (k * time + late) // stop * stop * (late > 0)
                  for time, last in zip(self.times, self.lates, strict=True)
                  for k in range(int(stop / time) + 1) for late in (0, last)}  # fmt: skip
        instants = sorted({*(at for at in events if at < stop), *shown, Fraction(0)})
        for now, following in zip(instants, [*instants[1:], stop], strict=True):
            if now in shown:
                outputs.append(self.x)
            slow = float(self.times[1])
            if not now % self.times[0]:
                self.queues[0].append(-self.gain * self.x[0])
            if not now % self.times[1]:  # trapezoidal rule
                error = target - self.x[1]
                self.queues[1].append((3 + 5 * slow) * error + self.sum)
                self.sum += 10 * slow * error
            for index, (late, time) in enumerate(zip(self.lates, self.times, strict=True)):
                if not (now - late) % time and self.queues[index]:
                    due = len(self.queues[index]) > self.sizes[3 + index] or now >= late
                    self.held[index] = self.queues[index].pop(0) if due else self.held[index]
            moved = expm(A * float(following - now))
            self.x = moved[:2, :2] @ self.x + moved[:2, 2] * sum(self.held)
        return np.array(outputs)


@pytest.mark.parametrize(
    ("fast", "late", "slow"), [("0.02", "0.013", "0.03"), ("0.01", "0", "0.05"), ("0.05", "0.06", "0.02")]
)
def test_poles_and_responses_are_those_of_the_events(fast, late, slow):
    result = dynid.run(scene(2, fast, late, slow))
    common = Fraction(np.lcm(int(Fraction(fast) * 100), int(Fraction(slow) * 100)), 100)
    machine = Machine(2, fast, late, slow)
    size = len(machine.state)
    columns = []
    for unit in np.eye(size):
        machine.state = unit
        machine.run(common, 0)
        columns.append(machine.state)
    values = np.linalg.eigvals(np.array(columns).T)
    poles = result["bond_graph/sampled/poles"].data
    large = np.sort_complex(values[np.abs(values) > 1e-3])
    assert np.sort_complex(poles[np.abs(poles) > 1e-3]) == pytest.approx(large, rel=1e-9)
    assert result.value("bond_graph/system/stable") == (np.abs(values).max() < 1)
    shown = [Fraction(k, 20) for k in range(20)]
    outputs = Machine(2, fast, late, slow).run("1.2", 1.0, shown)
    response = result["bond_graph/time_response/response"].data[:20]
    assert response == pytest.approx(outputs[:, ::-1], rel=1e-9, abs=1e-12)


def radius(gain):
    machine, columns = Machine(gain, "0.02", "0.013", "0.03"), []
    for unit in np.eye(len(machine.state)):
        machine.state = unit
        machine.run("0.06", 0)
        columns.append(machine.state)
    return np.abs(np.linalg.eigvals(np.array(columns).T)).max()


def test_the_verdict_changes_at_the_critical_gain():
    low, high = 2.0, 60.0
    assert radius(low) < 1 < radius(high)
    while high - low > 1e-9:
        middle = (low + high) / 2
        low, high = (middle, high) if radius(middle) < 1 else (low, middle)
    text = MOTOR.replace("results: [properties, time_response]", "results: [properties]")
    text = "\n".join(line for line in text.splitlines() if "kind: step" not in line)
    for gain, stable in ((low * (1 - 1e-6), True), (low * (1 + 1e-6), False)):
        result = dynid.run(scene(repr(float(gain)), text=text))
        assert result.value("bond_graph/system/stable") == stable
    assert "after which all sample together again" in summary(result, "")
    assert "bond_graph/margins/loop" not in result


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"slow": "0.010007", "fast": "0.01"}, "together again after 20,007 samples only"),
        ({"text": MOTOR.replace("[properties, ", "[step_info, ")}, "no 'step_info' with several sample"),
        (
            {"text": MOTOR + "parameters: {a: 1}\ndesign: {free: {a: 1}, targets: [{phase_margin: 60}]}\n"},
            "there is no design with several sample times",
        ),
        (
            {"text": MOTOR.replace("  loops:", "  loops:\n    - " + DELAYED)},
            "beside loops with delays sampled loops have one period; write the period of the first, 0.02",
        ),
    ],
)  # fmt: skip
def test_what_several_sample_times_do_not_have(changes, message):
    with pytest.raises(SceneError, match=message):
        scene(**changes)
