"""Sampled controllers as C functions: bit for bit the simulation, compiled by the system's compiler."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import pytest

import dynid as package
from dynid.lti.sampled_system import SampledController

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
CONFIGS = Path(__file__).parents[2] / "configs"

_SAMPLES = 51
SCENE = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    voltage: Se
    brake.1: Se
    circuit: 1
    R: {type: R, value: 1}
    L: {type: I, value: 0.5}
    motor: {type: GY, value: 0.3}
    rotor: 1
    J: {type: I, value: 0.01}
    d: {type: R, value: 0.1}
  bonds: [voltage -> circuit -> motor -> rotor -> J, circuit -> R, circuit -> L, rotor -> d, brake.1 -> rotor]
control:
  loops:
    - {from: J.f, to: voltage, controller: {CONTROLLER, sample: 0.01, computation: 0.004}, setpoint: speed}
    - {from: L.f, to: voltage, controller: {gain: 0.3, sample: 0.01}}
    - {from: J.f, to: brake.1, controller: {pid: {kp: 0.1, ki: 0.7}, sample: 0.01, method: backward}}
analysis:
  inputs: [speed]
  outputs: [J.f]
  results: [time_response]
  time: {stop: 0.5, step: 0.01, input: {kind: sine, amplitude: 3, frequency: 7.1}}
"""


def compiled(folder, code):
    (folder / "controller.c").write_bytes(code)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O2", "-ffp-contract=off"]
    command = [COMPILER, *flags, "-shared", "-fPIC", "-o", "controller.so", "controller.c"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)
    return ctypes.CDLL(str(folder / "controller.so"))


def simulated(monkeypatch, path):
    """Return of every controller the samples and answers of a simulation, in the order of the loops.

    A second run estimates the error of the first.
    """
    records = {}
    step = SampledController.step

    def recorded(controller, state, measured):
        answer, following = step(controller, state, measured)
        records.setdefault(id(controller), []).append((measured, answer))
        return answer, following

    monkeypatch.setattr(SampledController, "step", recorded)
    package.run(path)
    return [record[:_SAMPLES] for record in list(records.values())[-3:]]  # the last run has the limits


@pytest.mark.skipif(COMPILER is None, reason="the system has no C compiler (cc, gcc, clang)")
@pytest.mark.parametrize(
    "controller",
    [
        "pid: {kp: 2.3, ki: 11, kd: 0.017, tf: 0.003}",
        "numerator: [1.7, 0.1, 3], denominator: [1, 31, 4.1, 2], method: zoh",
        "numerator: [0.7, -0.3], denominator: [1, -0.9, 0.1], method: z",
        "pid: {kp: 2.3, ki: 11, kd: 0.017, tf: 0.003}, limits: {min: -2, max: 2.5}",
        "numerator: [2, 9], denominator: [0.01, 1, 0], method: zoh, limits: {min: -2, max: 2.5, tracking: 1}",
    ],
)
def test_c_functions_are_the_simulation_bit_for_bit(dynid, folder, monkeypatch, controller):
    (folder / "servo.yaml").write_text(SCENE.replace("CONTROLLER", controller))
    assert dynid("export", "servo.yaml", "--c") == (0, "wrote servo.c\n", "")
    library = compiled(folder, (folder / "servo.c").read_bytes())
    runs = simulated(monkeypatch, "servo.yaml")
    names = ["voltage", "voltage_2", "brake_1"]
    for name, samples in zip(names, runs, strict=True):
        function, state = getattr(library, f"{name}_step"), (ctypes.c_double * 4)()
        function.restype, function.argtypes = ctypes.c_double, [ctypes.c_void_p, *[ctypes.c_double] * 2]
        answers = [function(ctypes.byref(state), measured, 0.0) for measured, _ in samples]
        assert len(answers) == _SAMPLES
        assert answers == [answer for _, answer in samples]
        assert len(set(answers)) > 10
        if "limits" in controller and name == "voltage":
            assert max(answers) == 2.5
            assert min(answers) >= -2
            continue
        setpoint = function(ctypes.byref((ctypes.c_double * 4)()), 0.0, 2.0)
        assert setpoint == -function(ctypes.byref((ctypes.c_double * 4)()), 2.0, 0.0)


def test_what_has_no_sampled_controllers_is_refused(dynid, folder):
    designed = SCENE.replace("CONTROLLER", "gain: g") + "parameters: {g: 1}\n"
    designed += "design: {free: {g: 1}, targets: [{phase_margin: 60}]}\n"
    (folder / "designed.yaml").write_text(designed.replace("[time_response]", "[properties]"))
    continuous = SCENE.replace("CONTROLLER", "gain: 2").replace(", sample: 0.01", "")
    continuous = continuous.replace(", computation: 0.004", "").replace(", method: backward", "")
    (folder / "continuous.yaml").write_text(continuous)
    for name, message in (
        ("continuous.yaml", "no controller of the scene is sampled"),
        ("designed.yaml", "the scene has a 'design'"),
        (str(CONFIGS / "servo_lqr.yaml"), "bond_graph/state_feedback/gain"),
        (str(CONFIGS / "beam_reduction.yaml"), "kind reduction"),
        ("servo.h5", "is no scene"),
    ):
        status, _, error = dynid("export", name, "--c")
        assert status
        assert message in error
