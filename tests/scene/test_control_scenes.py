"""Feedback in scenes: controllers, references, identification in closed loop, faults."""

import re

import control
import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import dynid
from dynid.checks import check_expectations
from dynid.cli.screen import summary
from dynid.errors import SceneError, UsageError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough

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
    text = SERVO.replace("CONTROLLER", controller) + "  results: [transfer_function]\n"
    found_top, found_bottom, _ = polynomials(text)
    plant = np.polyadd(np.polymul([0.01, 5], [0.001, 0.0001]), [0.01])
    closed = np.polyadd(0.1 * np.asarray(top), np.polymul(np.polymul(plant, [1, 0]), bottom))
    own = 0.1 * np.asarray(bottom, dtype=float)
    np.testing.assert_allclose(found_bottom, closed / closed[0], rtol=1e-13)
    np.testing.assert_allclose(np.trim_zeros(found_top, "f"), own / closed[0], rtol=1e-13)


SETPOINT = SERVO.replace("reference: target", "setpoint: target")


@pytest.mark.parametrize(
    ("controller", "top", "bottom"),
    [
        ("{gain: 4}", [4], [1]),
        ("{pid: {kp: 20, ki: 5, kd: 1, tf: 0.001}}", [1.02, 20.005, 5], [0.001, 1, 0]),
        ("{pid: {kp: 20, kd: 2}}", [2, 20], [1]),
        ("{numerator: [2, 3], denominator: [1, 4, 5]}", [2, 3], [1, 4, 5]),
    ],
)
def test_a_setpoint_is_ahead_of_the_controller(controller, top, bottom):
    """u = C (target - q): the closed loop of python-control, of lowest order, with the same margins."""
    text = SETPOINT.replace("CONTROLLER", controller)
    _, _, result = polynomials(text + "  results: [transfer_function, properties, hidden_modes]\n")
    electric, mechanic = control.tf([1], [0.01, 5]), control.tf([1], [0.001, 0.0001])
    speed = control.feedback(0.1 * electric * mechanic, 0.1)
    loop = control.tf(top, bottom) * speed * control.tf([1], [1, 0])
    expected = control.minreal(control.feedback(loop, 1), verbose=False)
    root = "bond_graph/transfer_function/shaft.q/target"
    own = result[f"{root}/numerator"].data, result[f"{root}/denominator"].data
    assert len(own[1]) == len(expected.den[0][0])
    s = 1j * np.geomspace(0.1, 1e4, 9)
    np.testing.assert_allclose(np.polyval(own[0], s) / np.polyval(own[1], s), expected(s), rtol=1e-9)
    properties = "bond_graph/properties/shaft.q/target"
    assert result.value(f"{properties}/dc_gain") == 1  # the plant integrates
    assert not len(result[f"{properties}/hidden_modes"].data)
    plain = dynid.run(scene(SERVO.replace("CONTROLLER", controller)))
    for path in plain:
        if path.startswith(("bond_graph/margins/", "bond_graph/sensitivity_functions/")):
            np.testing.assert_array_equal(result[path].data, plain[path].data)


def test_a_setpoint_beside_a_reference():
    """u = r + C e^(-s τ) (w - i): integral action makes the current follow w, and reject r."""
    text = """
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, j: 1, L: {type: I, value: 0.01}, R: {type: R, value: 2}}
  bonds: [u -> j, j -> L, j -> R]
control: {loops: [{from: R.e, to: u, controller: {pid: {kp: 3, ki: 50}}, reference: r, setpoint: w}]}
analysis:
  outputs: [L.f, u.e, w.e]
  frequency: {start: 1, stop: 1000, points: 20}
  time: {stop: 1, step: 0.001, input: {kind: step, source: w, amplitude: 6}}
"""
    result = dynid.run(scene(text))
    gains = {(output, source): result.value(f"bond_graph/properties/{output}/{source}/dc_gain")
             for output in ("L.f", "u.e", "w.e") for source in "rw"}  # fmt: skip
    assert gains == {
        ("L.f", "w"): 0.5, ("L.f", "r"): 0, ("u.e", "w"): 1, ("u.e", "r"): 0, ("w.e", "w"): 1, ("w.e", "r"): 0
    }  # fmt: skip
    assert result["bond_graph/time_response/response"].data[-1, :2] == pytest.approx([3, 6], rel=1e-6)
    powered = dynid.run(scene(text + "  results: [source_performance, energy]\n"))
    assert "bond_graph/source_performance/r/active_power" in powered
    assert not any(path.startswith("bond_graph/source_performance/w") for path in powered)
    late = text.replace("ki: 50}", "ki: 50}, delay: 0.001").replace("  time:", "#")
    late = dynid.run(scene(late))
    s = 1j * late["bond_graph/frequency_response/omega"].data
    controller, plant = (3 + 50 / s) * np.exp(-0.001 * s), 1 / (0.01 * s + 2)
    expected = np.stack([plant / (1 + 2 * controller * plant)] * 2, axis=-1)
    expected[:, 1] *= controller
    inputs = [str(name) for name in late["bond_graph/frequency_response/input"].data]
    assert inputs == ["r", "w"]
    np.testing.assert_allclose(late["bond_graph/frequency_response/response"].data[:, 0], expected, rtol=1e-9)


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


@pytest.mark.parametrize("text", [SERVO, SETPOINT])
def test_a_controller_is_identified_in_closed_loop(text):
    text = text.replace("CONTROLLER", "{pid: {kp: kp, kd: 1, tf: 0.01}}").replace(
        "bond-graph", "identification"
    )
    text = text[: text.index("analysis:")].replace("b: 0.0001", "b: 0.0001, k: kt").replace("k: 0.1, ", "")
    text += """
parameters: {kp: {start: 10, true: 20}, kt: {start: 0.05, true: 0.1}}
excitation: [{source: target, kind: multisine, amplitude: [5, 5, 5], frequency: [5, 20, 60]}]
measurement: {step: 0.002, samples: 800, channels: [{output: shaft.q}, {output: m.L.f}],
  simulate: {noise_ratio: 0.01, seed: 2}}
derived: []
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
        ("reference: target", "setpoint: torque", "'torque' is a node; use another name"),
        ("reference: target", "setpoint: a b", "'a b' cannot name a setpoint"),
        ("reference: target", "reference: a, setpoint: a", "'a' is the reference of another loop"),
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


def assert_pole_slopes(result, group, poles, base):
    """The sensitivities of poles are difference quotients of `poles`, a function of the values in `base`."""
    names = [str(name) for name in result[f"{group}/parameter"].data]
    own = result[f"{group}/poles"].data
    for name, value in base.items():
        step = 1e-5 * value
        near = [poles(*(dict(base) | {name: value + sign * step}).values()) for sign in (1, -1)]
        up, down = (each[np.abs(own[:, None] - each).argmin(axis=1)] for each in near)
        slopes = result[f"{group}/pole_sensitivity"].data[:, names.index(name)]
        np.testing.assert_allclose(slopes, (up - down) / (2 * step), rtol=1e-5, atol=1e-7)


def test_sensitivities_are_by_the_gains_of_controllers():
    """Poles at a slightly different gain: of the polynomial by hand."""
    text = SERVO.replace("CONTROLLER", "{pid: {kp: 2*kp, ki: 5, kd: 1, tf: 0.01}}")
    text += "  results: [sensitivities]\nparameters: {kp: 10, unused: 3}\n"
    result = dynid.run(scene(text))
    group = "bond_graph/sensitivities/shaft.q/target"
    names = [str(name) for name in result[f"{group}/parameter"].data]
    base = {"kp": 10, "control.loops.1.controller.pid.ki": 5, "control.loops.1.controller.pid.kd": 1}
    base |= {"control.loops.1.controller.pid.tf": 0.01, "control.loops.0.controller.gain": 3}
    assert set(base) <= set(names)

    def poles(kp, ki, kd, tf, gain):
        top = [2 * kp * tf + kd, 2 * kp + ki * tf, ki]
        plant = np.polyadd(np.polymul([0.01, 2 + gain], [0.001, 0.0001]), [0.01])
        return np.roots(np.polyadd(0.1 * np.array(top), np.polymul(np.polymul(plant, [1, 0]), [tf, 1, 0])))

    assert_pole_slopes(result, group, poles, base)


def test_sensitivities_are_by_the_coefficients_of_controllers():
    """Numerator and denominator by their places in the scene; a coefficient of zero is none."""
    text = SERVO.replace("CONTROLLER", "{numerator: [b1, 3], denominator: [0.5, 4, 0]}")
    text += "  results: [sensitivities]\nparameters: {b1: 2}\n"
    result = dynid.run(scene(text))
    group = "bond_graph/sensitivities/shaft.q/target"
    names = [str(name) for name in result[f"{group}/parameter"].data]
    path = "control.loops.1.controller"
    base = {"b1": 2, f"{path}.numerator.1": 3, f"{path}.denominator.0": 0.5, f"{path}.denominator.1": 4}
    assert {name for name in names if name.startswith(path)} == base.keys() - {"b1"}

    def poles(b1, b0, a2, a1):
        plant = np.polyadd(np.polymul([0.01, 5], [0.001, 0.0001]), [0.01])
        bottom = np.polymul(np.polymul(plant, [1, 0]), [a2, a1, 0])
        return np.roots(np.polyadd(0.1 * np.array([b1, b0]), bottom))

    assert_pole_slopes(result, group, poles, base)


def test_loops_of_a_graph_without_a_solution_are_not_judged():
    """Two efforts meet at one junction: the fault of the graph is reported, and no fault of its loop."""
    from dynid.scene.run import preparation_errors

    text = SERVO.replace("CONTROLLER", "{gain: 4}").replace(
        "shaft: 1", "shaft: 1\n    node: 0\n    other: Se"
    )
    text = text.replace("[voltage -> m.supply", "[voltage -> node, other -> node, node -> m.supply")
    (error,) = preparation_errors(scene(text))
    assert "other" in str(error)
    assert "voltage" in str(error)


LATE = SERVO.replace("CONTROLLER", "{gain: 20, delay: tau}") + "parameters: {tau: 0.02}\n"


def late_loop(s, tau=0.02):
    """Return the plant from the voltage with the current loop closed, and the open loop."""
    plant = 0.1 / (1e-5 * s**3 + 0.005001 * s**2 + 0.0105 * s)
    return plant, 20 * plant * np.exp(-s * tau)


def test_frequency_responses_have_the_delay_as_it_is():
    text = LATE.replace("[shaft.q]", "[shaft.q, m.L.f]")
    frequencies = "  frequency: {start: 0.5, stop: 50, points: 30}\nparameters:"
    result = dynid.run(scene(text.replace("parameters:", frequencies)))
    omega = result["bond_graph/frequency_response/omega"].data
    plant, loop = late_loop(1j * omega)
    inputs = [str(name) for name in result["bond_graph/frequency_response/input"].data]
    found = result["bond_graph/frequency_response/response"].data[:, 0, inputs.index("target")]
    np.testing.assert_allclose(found, plant / (1 + loop), rtol=1e-9)
    group = "bond_graph/sensitivity_functions"
    np.testing.assert_array_equal(result[f"{group}/omega"].data, omega)
    np.testing.assert_allclose(result[f"{group}/L"].data[:, 1], loop, rtol=1e-12)
    np.testing.assert_allclose(result[f"{group}/S"].data[:, 1], 1 / (1 + loop), rtol=1e-12)
    np.testing.assert_allclose(result[f"{group}/T"].data[:, 1], loop / (1 + loop), rtol=1e-12)


def test_what_is_approximate_is_marked_and_verdicts_are_true():
    result = dynid.run(scene(LATE))
    root = "bond_graph/transfer_function/shaft.q/target"
    for name in ("numerator", "denominator"):
        assert "Padé" in result[f"{root}/{name}"].attrs["approximate"]
    assert "approximate" not in result[f"{root}/poles"].attrs
    assert not len(result[f"{root}/zeros"].data)
    properties = "bond_graph/properties/shaft.q/target"
    assert "approximate" not in result[f"{properties}/stable"].attrs
    assert result.value(f"{properties}/relative_degree") == 3
    assert "approximate" not in result["bond_graph/margins/poles"].attrs
    for pole in result["bond_graph/margins/poles"].data[:4]:
        assert abs(1 + late_loop(pole)[1]) < 1e-9
    for pole in result["bond_graph/margins/poles"].data[:2]:
        assert np.abs(result[f"{root}/poles"].data - pole).min() < 1e-9
    locus = "bond_graph/root_locus/loop_2"
    assert "as they are" in result.group_attrs[locus]["note"]
    gains, poles = (result[f"{locus}/{name}"].data for name in ("gain", "poles"))
    present = poles[np.abs(gains - 1).argmin()]
    for pole in present[np.isfinite(present)]:
        assert abs(1 + late_loop(pole)[1]) < 1e-9
    for pole in result["bond_graph/margins/poles"].data[:4]:
        assert np.abs(present - pole).min() < 1e-9 * abs(pole)


@pytest.fixture(scope="module")
def limit():
    """The delay margin of the loop without delay."""
    return dynid.run(scene(LATE.replace("0.02", "0")))["bond_graph/margins/delay"].data[1]


@pytest.mark.parametrize(("tau", "stable"), [(0.002, True), (0.02, False)])
def test_verdicts_with_delays(limit, tau, stable):
    """The delay margin of the loop without delay is where it turns unstable."""
    assert (tau < limit) == stable
    result = dynid.run(scene(LATE.replace("0.02", str(tau))))
    assert bool(result["bond_graph/margins/stable"].data[1]) == stable
    assert result.value("bond_graph/properties/shaft.q/target/stable") == stable
    assert result["bond_graph/margins/unstable_poles"].data[1] == (0 if stable else 2)
    if stable:
        assert result["bond_graph/margins/delay"].data[1] == pytest.approx(limit - tau, rel=1e-9)


FEED_FORWARD = """
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, r: Sf, load: {type: R, value: 1}, axis: 1, J: {type: I, value: 0.5}, b: {type: R, value: 2}}
  bonds: [r -> load, u -> axis -> J, axis -> b]
control:
  loops:
    - {from: axis.f, to: u, controller: {gain: GAIN, delay: BACK}}
    - {from: r.f, to: u, controller: {gain: -4, delay: FORTH}}
analysis: {inputs: [r], outputs: [axis.f], frequency: {start: 0.1, stop: 50, points: 20}}
"""


@pytest.mark.parametrize(
    ("gain", "back", "forth"), [(4, 0.02, 0), (4, 0.02, 0.02), (4, 0, 0.3), (4, 0, 0), (-4, 0.02, 0)]
)
def test_a_feed_forward_limits_nothing_and_moves_no_pole(gain, back, forth):
    """J s w = u - b w with u = 4 e^(-s τ2) r - k e^(-s τ1) w: the second loop has L = 0."""
    values = {"GAIN": gain, "BACK": back, "FORTH": forth}
    text = FEED_FORWARD
    for name, value in values.items():
        text = text.replace(name, str(value))
    result = dynid.run(scene(text))
    margins = {
        name: result[f"bond_graph/margins/{name}"].data
        for name in ("gain", "gain_reduction", "phase", "delay", "Ms", "Mt", "stable", "stability")
    }
    expected = {"gain": np.inf, "gain_reduction": 0, "phase": np.inf, "delay": np.inf, "Ms": 1, "Mt": 0}
    assert {name: margins[name][1] for name in expected} == expected
    assert margins["stability"][1].startswith("stable: L = 0")
    assert margins["stable"].tolist() == [gain > 0, True]
    alone = dynid.run(scene("\n".join(line for line in text.splitlines() if "from: r.f" not in line)))
    for name, values in margins.items():
        np.testing.assert_array_equal(values[:1], alone[f"bond_graph/margins/{name}"].data)
    group = "bond_graph/sensitivity_functions"
    s = 1j * result[f"{group}/omega"].data
    loop = gain * np.exp(-s * back) / (0.5 * s + 2)
    np.testing.assert_allclose(result[f"{group}/L"].data[:, 0], loop, rtol=1e-12)
    for name, value in (("L", 0), ("S", 1), ("T", 0)):
        assert np.all(result[f"{group}/{name}"].data[:, 1] == value)
    channel = 4 * np.exp(-s * forth) / (0.5 * s + 2) / (1 + loop)
    np.testing.assert_allclose(
        result["bond_graph/frequency_response/response"].data[:, 0, 0], channel, rtol=1e-9
    )
    assert not any(path.startswith("bond_graph/root_locus/loop_2") for path in result)
    properties = "bond_graph/properties/axis.f/r"
    assert result.value(f"{properties}/stable") == (gain > 0)
    assert result.value(f"{properties}/relative_degree") == (np.inf if forth else 1)
    assert ("bond_graph/margins/poles" in result) == bool(back)
    for pole in result["bond_graph/margins/poles"].data if back else ():
        assert abs(0.5 * pole + 2 + gain * np.exp(-pole * back)) < 1e-9


@pytest.mark.parametrize(
    ("gain", "tau", "stable"), [(0.01, 18, True), (-0.01, 17, False), (-0.01, 5, False), (-0.01, 20, True)]
)
def test_verdicts_are_those_of_the_delay_where_its_approximant_has_another(gain, tau, stable):
    """The root near the natural frequency turns with the phase of a delay too long for its approximant."""
    result = dynid.run(
        scene(f"""
dynid: 1
kind: bond-graph
graph:
  nodes: {{F: Se, x: 1, m: {{type: I, value: 1}}, c: {{type: R, value: 0.002}}, k: {{type: C, value: 1}}}}
  bonds: [F -> x, x -> m, x -> c, x -> k]
control: {{loops: [{{from: k.q, to: F, controller: {{gain: {gain}, delay: {tau}}}, reference: r}}]}}
analysis: {{outputs: [k.q]}}
""")
    )
    # the loop gain exceeds 1 near the natural frequency alone
    root = mpmath.findroot(lambda s: s**2 + 0.002 * s + 1 + gain * mpmath.exp(-s * tau), 1j)
    assert (root.real < 0) == stable
    assert result.value("bond_graph/properties/k.q/r/stable") == stable
    assert result.value("bond_graph/properties/k.q/r/stability").startswith(
        "stable" if stable else "unstable"
    )
    assert result["bond_graph/margins/stable"].data.tolist() == [stable]
    poles = result["bond_graph/transfer_function/k.q/r/poles"]
    assert poles.data[0] == pytest.approx(complex(root.real, abs(root.imag)), rel=1e-12)
    assert "real part above" in poles.attrs["note"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("delay: tau", "delay: -1", "-1 is negative"),
        ("delay: tau", "late: 1", "'late' is not a key"),
        (
            "from: shaft.q",
            "delay: tau, from: shaft.q",
            "'delay' is not a key of control.loops.1; write it under 'controller'",
        ),
        (
            "from: shaft.q",
            "xyz: 1, from: shaft.q",
            "of control.loops.1; its keys are from, to, controller, reference, setpoint",
        ),
    ],
)
def test_faults_of_delays_are_located(old, new, message):
    text = LATE.replace("analysis:\n  outputs: [shaft.q]", "analysis: {outputs: [shaft.q]}")
    assert old in text
    with pytest.raises(SceneError) as raised:
        scene(text.replace(old, new))
    assert message in str(raised.value)


NONLINEAR = LATE.replace("analysis:", "operating_point: {}\nanalysis:")


def test_a_graph_without_laws_has_its_linear_response_with_a_delay():
    more = "time: {stop: 1, step: 0.1}, results: [time_response]"
    text = NONLINEAR.replace("analysis:\n  outputs: [shaft.q]", f"analysis: {{outputs: [shaft.q], {more}}}")
    result = dynid.run(scene(text))
    linear, nonlinear = (
        result[f"bond_graph/time_response/{name}"].data for name in ("response", "nonlinear")
    )
    assert np.abs(nonlinear - linear).max() < 5e-8 * np.abs(linear).max()


SAMPLED = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, G: Se, j: 1, m: {type: I, value: 1}, b: {type: R, value: 0.5}}
  bonds: [F -> j -> m, G -> j, j -> b]
control:
  loops:
    - {from: m.q, to: F, controller: {pid: {kp: 1, ki: 0.3, kd: 0.4, tf: 0.2}, sample: 0.1}, setpoint: w}
    - {from: m.f, to: G, controller: {gain: 1, sample: 0.1, computation: 0.25}}
analysis: {outputs: [m.q], inputs: [w]}
"""


def test_sampled_loops_fill_what_continuous_ones_do():
    """Sampled fast, the margins are those of the continuous loops."""
    slow = re.sub("computation: 0.25", "computation: 0", SAMPLED)
    fast = dynid.run(scene(slow.replace("sample: 0.1", "sample: 1.0e-5")))
    continuous = dynid.run(scene(re.sub(", (sample|computation): [0-9.]+", "", SAMPLED)))
    for name in ("gain_reduction", "phase", "delay", "Ms", "Mt", "gain_crossover", "modulus_at"):
        path = f"bond_graph/margins/{name}"
        assert fast[path].data == pytest.approx(continuous[path].data, rel=1e-3, abs=1e-3), name
    assert fast.value("bond_graph/system/stable")
    assert fast.value("bond_graph/system/unstable_poles") == 0
    s = np.log(fast["bond_graph/sampled/poles"].data) / 1e-5
    expected = continuous["bond_graph/transfer_function/m.q/w/poles"].data
    assert np.sort_complex(s) == pytest.approx(np.sort_complex(expected), rel=1e-3)


@pytest.mark.parametrize(
    "controller",
    [
        "{numerator: [1], denominator: [1, -0.5], method: z, sample: 0.1}",
        "{gain: 1, method: zoh, sample: 0.1}",
    ],
)
def test_a_sampled_controller_of_either_method_is_valid(controller):
    assert scene(
        SAMPLED.replace("{gain: 1, sample: 0.1, computation: 0.25}", controller)
    ).model.control.sampled


def test_results_of_sampled_loops():
    result = dynid.run(
        scene(SAMPLED.replace("inputs: [w]", "inputs: [w], frequency: {start: 1, stop: 9, points: 3}"))
    )
    # x, v, filter and integral of the PID, three answers under way of the second loop
    assert len(result["bond_graph/sampled/poles"].data) == 7
    assert result.value("bond_graph/system/largest_sample_time") > 0.1
    L, S = (result[f"bond_graph/sensitivity_functions/{name}"].data for name in "LS")
    assert pytest.approx(1 / (1 + L), rel=1e-12) == S
    assert "bond_graph/transfer_function/m.q/w/poles" not in result
    locus = "bond_graph/root_locus/loop_1"  # in the plane of z, as the poles
    assert result.group_attrs[locus]["plane"] == "z"
    present = result[f"{locus}/poles"].data[np.abs(result[f"{locus}/gain"].data - 1).argmin()]
    poles = result["bond_graph/sampled/poles"].data
    assert np.abs(present[np.isfinite(present)][:, None] - poles).min(axis=1).max() < 1e-9
    unstable = dynid.run(scene(SAMPLED.replace("gain: 1", "gain: 30")))
    assert unstable.value("bond_graph/system/stability") == "unstable"
    assert "outside the unit circle" in unstable.value("bond_graph/system/reason")
    assert unstable.value("bond_graph/system/unstable_poles") > 0
    assert np.isnan(unstable["bond_graph/margins/gain"].data).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("sample: 0.1, computation", "delay: 1, computation", "'computation' is of a sampled controller"),
        ("tf: 0.2}, sample: 0.1", "tf: 0.2}, method: zoh", "'method' is of a sampled controller"),
        ("sample: 0.1, computation", "sample: 0.1, delay", "a sampled controller has no 'delay'"),
        (
            "gain: 1, sample: 0.1",
            "gain: 1, sample: 0.10001",
            "sample together again after 20,001 samples only",
        ),
        ("tf: 0.2}, sample: 0.1", "tf: 0.2}, sample: 0.1, method: z", "'z' reads coefficients in z"),
        ("kd: 0.4, tf: 0.2}, sample: 0.1", "kd: 0.4}, sample: 0.1, method: zoh", "'zoh' needs a controller"),
        (
            "{gain: 1, sample: 0.1",
            "{numerator: [1, 2], denominator: [1], method: z, sample: 0.1",
            "it answers to samples not yet measured",
        ),
        ("computation: 0.25", "computation: 11", "an answer takes at most 100 periods"),
        ("inputs: [w]", "inputs: [w], results: [zeros]", "there is no 'zeros' with sampled loops"),
        ("inputs: [w]", "inputs: [w], port: j -> b", "there is no 'port' with sampled loops"),
        (
            "analysis:",
            "design: {free: {x: }, targets: [{pole: 1}]}\nparameters: {x: 1}\nanalysis:",
            "are designed with sampled loops",
        ),
    ],
)
def test_faults_of_sampled_loops_are_located(old, new, message):
    assert old in SAMPLED
    with pytest.raises(SceneError) as raised:
        scene(SAMPLED.replace(old, new))
    assert message in str(raised.value)


def test_a_delayed_controller_that_answers_nothing_reaches_nothing():
    """Its setpoint is a channel of numerator 0."""
    text = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, F: Se, a: 1, m: {type: I, value: 1}, r: {type: R, value: 1}}
  bonds: [u -> a, F -> a, a -> m, a -> r]
control: {loops: [{from: m.f, to: u, controller: {gain: 0, delay: 0.2}, setpoint: w}]}
analysis: {outputs: [m.f], results: [zeros, poles, properties, step_info, bandwidth]}
"""
    result = dynid.run(scene(text))
    properties = "bond_graph/properties/m.f/w"
    assert result.value(f"{properties}/step_status") == "undefined: the input does not reach the output"
    assert result.value(f"{properties}/bandwidth_status") == "undefined: the input does not reach the output"


def test_at_most_eight_loops_have_a_delay():
    loop = "    - {from: shaft.q, to: voltage, controller: {gain: 1, delay: 1}}\n"
    with pytest.raises(SceneError, match="at most 8 loops may have a delay"):
        scene(LATE.replace("analysis:", f"{8 * loop}analysis:"))


def test_identification_takes_delays_but_no_samples():
    text = LATE[: LATE.index("analysis:")].replace("bond-graph", "identification")
    text += """
parameters: {tau: {start: 0.05, true: 0.1}}
excitation: [{source: target, kind: step}]
measurement: {step: 0.002, samples: 10, channels: [{output: shaft.q}], simulate: {noise_ratio: 0.01}}
"""
    assert scene(text).model.control.delays
    with pytest.raises(SceneError, match="'derived' is of finitely many poles and zeros"):
        scene(text + "derived: [poles]\n")
    with pytest.raises(SceneError, match="a sampled loop is not identified"):
        scene(text.replace("delay: tau", "sample: tau"))


def test_a_study_over_a_gain_of_a_controller_is_run_alone():
    """Samples run together differ in the values of nodes; a controller is none of them."""
    from dynid.scene.batch import why_alone

    template = scene(SERVO.replace("CONTROLLER", "{gain: kp}") + "parameters: {kp: 20}\n")
    path = "bond_graph/properties/shaft.q/target/dc_gain"
    assert why_alone(template, ["parameters.kp"], (path,))


UNSTABLE = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, axis: 1, m: {type: I, value: 1}, k: {type: C, value: 1}, b: {type: R, value: 1}}
  bonds: [u -> axis -> m, axis -> k, axis -> b]
control:
  loops: [{from: k.q, to: u, controller: {numerator: [KI], denominator: [1, 0], delay: DELAY}, setpoint: w}]
analysis: {inputs: [w], outputs: [k.q], results: [properties]}
expect:
  - {path: bond_graph/margins/gain, min: 0}
  - {path: bond_graph/margins/gain_reduction, max: 1}
  - {path: bond_graph/margins/phase, min: 0}
  - {path: bond_graph/margins/delay, min: 0}
  - {path: bond_graph/margins/gain_crossover, min: 0}
  - {path: bond_graph/margins/phase_crossover, min: 0}
"""


@pytest.mark.parametrize(
    ("ki", "delay", "stable"), [(0.5, 0, True), (2, 0, False), (0.5, 0.05, True), (0.5, 9, False)]
)
def test_margins_of_a_loop_that_is_not_stable_are_not_defined_and_meet_no_bound(ki, delay, stable):
    """s (s^2 + s + 1) + KI exp(-s τ): Routh has it stable for 0 < KI < 1 without delay."""
    loaded = scene(UNSTABLE.replace("KI", str(ki)).replace("DELAY", str(delay)))
    result = dynid.run(loaded)
    outcomes = check_expectations(result, [one.model_dump(exclude_none=True) for one in loaded.model.expect])
    assert [one.passed for one in outcomes] == [stable] * 6
    below, above = (result[f"bond_graph/margins/crossing_gain_{side}"].data[0] for side in ("below", "above"))
    s = 1j * np.array([0.5, 1.0, 2.0])
    loop = ki * np.exp(-s * delay) / (s * (s * s + s + 1))
    assert (result["bond_graph/margins/Ms"].data[0] >= abs(1 / (1 + loop))).all()
    if not delay:
        assert (below, above) == pytest.approx((0, 1 / ki) if stable else (1 / ki, np.inf))
    if not stable:
        assert outcomes[0].message == (
            "gain is not defined (the closed loop is not stable) at loop 'k.q -> u', expected at least 0"
        )


MEASURED = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, axis: 1, m: {type: I, value: 1}, BESIDE, b: {type: R, value: 1}}
  bonds: [u -> axis -> m, axis -> k, axis -> b]
control:
  loops: [{from: FROM, to: u, controller: {gain: 2}, setpoint: w}]
analysis: {inputs: [w], outputs: [axis.f], results: [RESULT]}
"""


@pytest.mark.parametrize("result_name", ["properties", "hidden_modes"])
@pytest.mark.parametrize(
    ("measured", "beside", "hidden"),
    [
        ("axis.q", "k: {type: C, value: 1}", 1),  # its integral and that of the spring differ by a constant
        ("k.q", "k: {type: C, value: 1}", 0),
        ("axis.q", "k: {type: R, value: 3}", 0),  # nothing else has the position
    ],
)
def test_a_hidden_mode_of_an_integral_that_measures_is_named(measured, beside, hidden, result_name):
    text = MEASURED.replace("FROM", measured).replace("BESIDE", beside).replace("RESULT", result_name)
    result = dynid.run(scene(text))
    group = "bond_graph/properties/axis.f/w"
    assert result[f"{group}/hidden_modes"].data.tolist() == [0] * hidden
    note = result.group_attrs.get(group, {}).get("hidden_mode_note", "")
    assert ("the integral that measures axis.q" in note) == bool(hidden)
    said = " ".join(summary(result, "").split())
    assert ("the integral that measures axis.q for a loop differs by a constant" in said) == bool(hidden)


def test_the_state_equations_are_solved_once_for_the_notes_of_all_outputs(monkeypatch):
    """Whether a sum of states is constant depends on the input and the part of the graph alone."""
    from dynid.bondgraph import hidden_modes

    calls, solve = [], hidden_modes._modular
    monkeypatch.setattr(hidden_modes, "_modular", lambda *given: calls.append(given) or solve(*given))
    text = MEASURED.replace("FROM", "axis.q").replace("BESIDE", "k: {type: C, value: 1}")
    outputs = ["axis.f", "m.f", "m.e", "b.e", "b.f", "k.f"]
    text = text.replace("RESULT", "properties").replace("[axis.f]", f"[{', '.join(outputs)}]")
    result = dynid.run(scene(text))
    for output in outputs:
        note = result.group_attrs[f"bond_graph/properties/{output}/w"]["hidden_mode_note"]
        assert "the integral that measures axis.q" in note
    assert len(calls) == 1


def test_terms_that_add_up_at_equal_delays_are_divided_exactly():
    """A lossless line between 0.5 and 3, as four loops: 1 + Γ_S Γ_L e^(-2 s T) is left with its delays."""
    result = dynid.run(
        scene("""
dynid: 1
kind: bond-graph
graph:
  nodes:
    {u: Se, a: 1, rs: {type: R, value: 0.5}, z1: {type: R, value: 1}, e1: Se, p1: 0, b1: 1, b: 1, p2: 0,
     rl: {type: R, value: 3}, z2: {type: R, value: 1}, e2: Se}
  bonds: [u -> a, a -> rs, a -> p1, p1 -> b1, b1 -> z1, b1 -> e1, p2 -> rl, p2 -> b, b -> z2, b -> e2]
analysis: {inputs: [u], outputs: [p2.e]}
control:
  loops:
  - {from: p2.e, to: e1, controller: {gain: -1, delay: 1}}
  - {from: z2.f, to: e1, controller: {gain: -1, delay: 1}}
  - {from: p1.e, to: e2, controller: {gain: -1, delay: 1}}
  - {from: z1.f, to: e2, controller: {gain: -1, delay: 1}}
""")
    )
    assert not result.value("bond_graph/system/stable")
    assert result.value("bond_graph/system/stability") == "at the limit"
    pole = result["bond_graph/transfer_function/p2.e/u/poles"].data[0]
    reflection = (0.5 - 1) / (0.5 + 1) * (3 - 1) / (3 + 1)
    assert np.exp(-2 * pole) == pytest.approx(1 / reflection, rel=1e-12)


def test_the_response_between_samples_is_that_of_an_integrator():
    """A PI on a mass, half a period of computation, against DOP853 from hold to hold."""
    pid, second = "{pid: {kp: 1, ki: 0.3, kd: 0.4, tf: 0.2}, sample: 0.1}", SAMPLED.splitlines()[8]
    text = SAMPLED.replace(f"{second}\n", "").replace(
        pid, "{pid: {kp: 0.3, ki: 0.02}, sample: 0.2, computation: 0.1}"
    )
    requested = "results: [time_response, step_info], time: {stop: 59.95, step: 0.05, input: {kind: step}}"
    text = text.replace("outputs: [m.q], inputs: [w]", f"outputs: [m.q, F.e], inputs: [w], {requested}")
    result = dynid.run(scene(text))
    values, held, before, integral, expected = np.zeros(2), 0.0, 0.0, 0.0, []
    for _ in range(300):
        error = 1 - values[1]
        before, held = held, 0.3 * error + integral + 0.02 * 0.1 * error
        integral += 0.02 * 0.2 * error
        for k in range(4):
            force = before if k < 2 else held
            expected.append((values[1], force))

            def rate(_, x, force=force):
                return [force - 0.5 * x[0], x[0]]

            values = solve_ivp(rate, (0, 0.05), values, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    response = result["bond_graph/time_response/response"].data
    assert response == pytest.approx(np.array(expected), abs=1e-12)
    overshoot = 100 * (np.array(expected)[:, 0].max() - 1)
    assert result.value("bond_graph/properties/m.q/w/overshoot") == pytest.approx(overshoot, rel=1e-2)
    assert result.value("bond_graph/properties/m.q/w/final_value") == pytest.approx(1, abs=1e-12)


def test_stored_energy_and_signals_add_up_between_samples():
    text = SAMPLED.replace("analysis:", "initial: {m: {f: 2}}\nanalysis:").replace(
        "inputs: [w]",
        "inputs: [w], results: [time_response], time: {stop: 3, step: 0.01, input: {kind: step}}",
    )
    result = dynid.run(scene(text))
    group = "bond_graph/time_response"
    parts = [result[f"{group}/{name}"].data for name in ("zero_state", "zero_input")]
    assert sum(parts) == pytest.approx(result[f"{group}/response"].data, abs=1e-14)
    assert parts[1][1, 0] == pytest.approx(0.02, rel=1e-2)
    assert result[f"{group}/error_estimate"].data.max() < 1e-12


def test_responses_of_more_than_a_million_samples_are_refused():
    text = SAMPLED.replace("sample: 0.1", "sample: 1.0e-6").replace(", computation: 0.25", "")
    text = text.replace("inputs: [w]", "inputs: [w], results: [time_response], time: {stop: 3, step: 0.01}")
    with pytest.raises(UsageError, match=r"takes 3e\+06 samples; at most 1,000,000"):
        dynid.run(scene(text))


@pytest.mark.parametrize(("stiffness", "stable"), [(1e300, True), (-1e300, False), (-1e155, False)])
def test_a_late_loop_around_a_spring_beyond_all_measure_has_its_verdict(stiffness, stable):
    """The loop is weak beside the spring, whose sign decides; natural frequencies are up to 1e150 rad/s."""
    scene = check_source(
        parse_source(f"""\
dynid: 1
kind: bond-graph
graph:
  nodes:
    drive: Se
    x: 1
    m: {{type: I, value: 1}}
    b: {{type: R, value: 1}}
    k: {{type: C, value: 1/({stiffness!r})}}
  bonds: [drive -> x, x -> m, x -> b, x -> k]
control:
  loops:
    - from: k.q
      to: drive
      controller: {{pid: {{kp: 1, kd: 0.4, tf: 0.05}}, delay: 0.3}}
      setpoint: wanted
analysis: {{inputs: [wanted], outputs: [k.q], results: [properties]}}
""")
    )
    assert dynid.run(scene).value("bond_graph/system/stable") is stable


def test_poles_of_loops_with_delays_include_modes_that_cancel_in_them():
    """The zero of a PI controller cancels the pole of the plant at -2, which no loop moves."""
    text = """
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, j: 1, J: {type: I, value: 0.5}, b: {type: R, value: 1}}
  bonds: [u -> j, j -> J, j -> b]
control:
  loops: [{from: J.f, to: u, controller: {pid: {kp: 2, ki: 4}, delay: 0.1}, reference: r}]
analysis: {outputs: [J.f], results: [properties]}
"""
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    poles = result["bond_graph/margins/poles"]
    assert poles.data[0] == -2
    assert "which do not move them: -2" in poles.attrs["note"]
    assert np.all(np.diff(poles.data.real) <= 0)
    for s in poles.data[1:]:  # the others are roots of 1 + 4 exp(-0.1 s) / s
        assert abs(s + 4 * np.exp(-0.1 * s)) < 1e-10 * abs(s)
    gains, locus = (result[f"bond_graph/root_locus/loop_1/{name}"].data for name in ("gain", "poles"))
    (row,) = np.flatnonzero(gains == 1)  # just beyond the gain at which two branches meet
    for s in poles.data[1:3]:
        assert np.abs(locus[row] - s).min() < 1e-9
