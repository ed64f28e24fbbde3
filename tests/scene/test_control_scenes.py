"""Feedback in scenes: controllers, references, identification in closed loop, faults."""

import numpy as np
import pytest

import dynid
from dynid.errors import SceneError, UsageError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

SERVO = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    voltage: Se
    torque: Se
    m: {model: dc_motor, R: 2, L: 0.01, k: 0.1, J: 0.001, b: 0.0001}
    shaft: 1
  bonds: [voltage -> m.supply, m.shaft -> shaft, torque -> shaft]
control:
  loops:
    - {from: m.L.f, to: voltage, controller: {gain: 3}}
    - {from: shaft.q, to: voltage, controller: CONTROLLER, reference: target}
analysis:
  outputs: [shaft.q]
"""


def scene(text):
    return check_source(parse_source(text.lstrip("\n"), "scene.yaml"))


def polynomials(text, source="target"):
    result = dynid.run(scene(text))
    root = f"bond_graph/transfer_function/shaft.q/{source}"
    return result[f"{root}/numerator"].data, result[f"{root}/denominator"].data, result


@pytest.mark.parametrize(
    ("controller", "top", "bottom"),
    [
        ("{gain: 4}", [4], [1]),
        ("{pid: {kp: 20}}", [20], [1]),
        ("{pid: {kp: 20, ki: 5}}", [20, 5], [1, 0]),
        ("{pid: {kp: 20, kd: 2}}", [2, 20], [1]),
        ("{pid: {kp: 20, ki: 5, kd: 1, tf: 0.001}}", [1.02, 20.005, 5], [0.001, 1, 0]),
        ("{pid: {ki: 5, kd: 1}}", [1, 0, 5], [1, 0]),
        ("{numerator: [2, 3], denominator: [1, 4, 5]}", [2, 3], [1, 4, 5]),
        ("{numerator: [0, 3], denominator: [0, 4, 5]}", [3], [4, 5]),
    ],
)
def test_a_controller_is_its_quotient(controller, top, bottom):
    """(L s + R + k_i) i = u - k w, J s w = k i - b w, q = w/s, u = target - C q."""
    found_top, found_bottom, _ = polynomials(SERVO.replace("CONTROLLER", controller))
    plant = np.polyadd(np.polymul([0.01, 5], [0.001, 0.0001]), [0.01])
    closed = np.polyadd(0.1 * np.asarray(top), np.polymul(np.polymul(plant, [1, 0]), bottom))
    own = 0.1 * np.asarray(bottom, dtype=float)
    np.testing.assert_allclose(found_bottom, closed / closed[0], rtol=1e-13)
    np.testing.assert_allclose(np.trim_zeros(found_top, "f"), own / closed[0], rtol=1e-13)


def test_margins_are_of_one_loop_with_the_others_closed():
    result = polynomials(SERVO.replace("CONTROLLER", "{gain: 20}"))[2]
    assert list(result["bond_graph/margins/loop"].data) == ["m.L.f -> voltage", "shaft.q -> voltage"]
    # q over voltage with the current loop closed is 0.1/(1e-5 s^3 + 0.005001 s^2 + 0.0105 s): Im L = 0 at
    # w^2 = 0.0105/1e-5, where L = -20 * 0.1/(0.005001 w^2).
    gain = 0.005001 * 0.0105 / 1e-5 / 2
    assert result["bond_graph/margins/gain"].data[1] == pytest.approx(gain, rel=1e-12)


def test_a_driven_source_keeps_its_variables():
    text = SERVO.replace("CONTROLLER", "{gain: 20}").replace("[shaft.q]", "[voltage.e, voltage.f, m.L.f]")
    result = dynid.run(scene(text))
    root = "bond_graph/transfer_function"
    np.testing.assert_array_equal(
        result[f"{root}/voltage.f/target/numerator"].data, result[f"{root}/m.L.f/target/numerator"].data
    )
    assert result.value("bond_graph/properties/voltage.e/target/high_frequency_gain") == 1


def test_a_controller_is_identified_in_closed_loop():
    text = SERVO.replace("CONTROLLER", "{pid: {kp: kp, kd: 1, tf: 0.01}}").replace(
        "bond-graph", "identification"
    )
    text = text[: text.index("analysis:")].replace("b: 0.0001", "b: 0.0001, k: kt").replace("k: 0.1, ", "")
    text += """
parameters: {kp: {start: 10, true: 20}, kt: {start: 0.05, true: 0.1}}
excitation: [{source: target, kind: multisine, amplitude: [5, 5, 5], frequency: [5, 20, 60]}]
measurement: {step: 0.002, samples: 800, channels: [{output: shaft.q}, {output: m.L.f}],
  simulate: {noise_ratio: 0.01, seed: 2}}
"""
    result = dynid.run(scene(text))
    estimate = result["identification/parameters/estimate"].data
    error = result["identification/parameters/standard_error"].data
    names = [str(name) for name in result["identification/parameters/name"].data]
    for name, true in (("kp", 20), ("kt", 0.1)):
        place = names.index(name)
        assert abs(estimate[place] - true) < 4.5 * error[place]
        assert error[place] < 0.05 * true


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("to: voltage, controller: {gain: 3}", "to: shaft, controller: {gain: 3}", "'shaft' is no source"),
        ("to: voltage, controller: {gain: 3}", "to: volt, controller: {gain: 3}", "no node 'volt'"),
        ("from: m.L.f", "from: m.L", "no node 'm'"),
        ("CONTROLLER", "{gain: 3, pid: {kp: 1}}", "a controller is one of"),
        ("CONTROLLER", "{numerator: [1]}", "'numerator' and 'denominator' belong together"),
        ("CONTROLLER", "{numerator: [1], denominator: [0, 0]}", "the denominator is zero"),
        ("CONTROLLER", "{pid: {}}", "a PID controller has a gain"),
        ("CONTROLLER", "{pid: {kp: 1, tf: 0.1}}", "'tf' filters the derivative"),
        ("reference: target", "reference: torque", "'torque' is a node; use another name"),
        ("reference: target", "reference: a b", "'a b' cannot name a reference"),
        (
            "controller: {gain: 3}}",
            "controller: {gain: 3}, reference: target}",
            "is the reference of another loop",
        ),
        (
            "outputs: [shaft.q]",
            "inputs: [voltage], outputs: [shaft.q]",
            "is driven by a loop; the input is its",
        ),
        ("loops:", "loop:", "'loop' is not a key"),
    ],
)
def test_faults_are_located(old, new, message):
    text = (
        SERVO.replace("outputs: [shaft.q]", "outputs: [shaft.q]")
        .replace("analysis:\n  outputs", "analysis: {outputs")
        .replace("[shaft.q]\n", "[shaft.q]}\n")
    )
    assert old in text
    with pytest.raises(SceneError) as raised:
        scene(text.replace(old, new).replace("CONTROLLER", "{gain: 1}"))
    assert message in str(raised.value)


def test_sensitivities_by_gains_of_controllers_are_refused():
    text = SERVO.replace("CONTROLLER", "{gain: kp}") + "  results: [sensitivities]\nparameters: {kp: 3}\n"
    with pytest.raises(UsageError, match="controllers depend on kp"):
        dynid.run(scene(text))
