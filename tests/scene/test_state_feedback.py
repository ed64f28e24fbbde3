"""Feedback of states: gains against python-control on equations by hand, loops, messages."""

import control
import numpy as np
import pytest
from scipy.linalg import expm

import dynid
from dynid.cli.screen import summary
from dynid.errors import NumericalError, SceneError, UsageError
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

_HZ = 2j * np.pi
GROUP = "bond_graph/state_feedback"

# Two carts between springs to the wall, with a force on each: x1, v1, x2, v2.
CARTS = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    push: {type: Se, domain: mechanical}
    pull: Se
    one: 1
    two: 1
    m1: {type: I, value: 2}
    m2: {type: I, value: 3}
    left: {type: C, value: 1/50}
    c: {type: R, value: 0.7}
    between: 0
    relative: 1
    spring: {type: C, value: 1/20}
  bonds:
    - push -> one -> m1
    - one -> left
    - one -> c
    - one -> between -> two -> m2
    - pull -> two
    - between -> relative -> spring
control:
  CONTROL
analysis:
  outputs: [two.q]
  results: [properties, poles]
"""
A = np.array([[0, 1, 0, 0], [-70 / 2, -0.7 / 2, 20 / 2, 0], [0, 0, 0, 1], [20 / 3, 0, -20 / 3, 0]])
B = np.array([[0, 0], [1 / 2, 0], [0, 0], [0, 1 / 3]])
# The state of the spring between them is x1 - x2, so that of the second cart needs no integral of its own.
STATES = "states: [left.q, one.f, spring.q, two.f]"
T = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [1, 0, -1, 0], [0, 0, 0, 1]])


def carts(control_text, **replaced):
    text = CARTS.replace("CONTROL", control_text)
    for old, new in replaced.items():
        text = text.replace(f"{old}:", f"{new}:") if isinstance(new, str) else text
    return check_source(parse_source(text.lstrip("\n"), "scene.yaml"))


def test_gains_of_least_cost_are_those_of_python_control():
    weights = "weights: {left.q: 300, two.f: 7, m2.f: 1, c.e: 2, push: 0.1, pull: 0.02}"
    result = dynid.run(carts(f"lqr: {{{STATES}, {weights}, references: {{pull: r}}}}"))
    F, G = T @ A @ np.linalg.inv(T), T @ B
    Q = np.diag([300, 0.7**2 * 2, 0, 8.0])
    expected, _, poles = control.lqr(F, G, Q, np.diag([0.1, 0.02]))
    assert result[f"{GROUP}/gain"].data == pytest.approx(expected, rel=1e-9)
    assert result[f"{GROUP}/gain"].dims == ("source", "state")
    assert np.sort_complex(result[f"{GROUP}/poles"].data) == pytest.approx(np.sort_complex(poles), rel=1e-9)
    closed = result["bond_graph/transfer_function/two.q/r/poles"].data
    assert np.sort_complex(closed) == pytest.approx(np.sort_complex(poles), rel=1e-9)
    assert result.value("bond_graph/system/stable")
    assert list(result["bond_graph/margins/loop"].data) == ["states -> push", "states -> pull"]
    assert result["bond_graph/margins/Ms"].data == pytest.approx([1, 1], rel=1e-12)


def test_a_weighted_variable_may_follow_the_source_that_is_driven():
    # e of the left cart's inertia is the force that accelerates it: c x + u
    weights = "weights: {m1.e: 4, left.q: 100, push: 0.5}"
    result = dynid.run(carts(f"lqr: {{{STATES}, {weights}}}"))
    C, D = (np.vstack([2 * M[1], 0 * M[0]]) for M in (A @ np.linalg.inv(T), B[:, :1]))
    C[1, 0] = 1
    W = np.diag([4, 100])
    F, G = T @ A @ np.linalg.inv(T), T @ B[:, :1]
    expected, *_ = control.lqr(F, G, C.T @ W @ C, 0.5 + D.T @ W @ D, C.T @ W @ D)
    assert result[f"{GROUP}/gain"].data == pytest.approx(expected, rel=1e-9)


def test_the_margins_of_least_cost_with_one_source_are_guaranteed():
    result = dynid.run(carts(f"lqr: {{{STATES}, weights: {{left.q: 300, two.f: 7, pull: 0.02}}}}"))
    gains = result[f"{GROUP}/gain"].data
    F, G = T @ A @ np.linalg.inv(T), T @ B[:, 1:]
    loop = control.ss(F, G, gains, 0)
    _, phase, _, crossover = control.margin(loop)
    assert result["bond_graph/margins/phase"].data == pytest.approx([phase], rel=1e-6)
    assert result["bond_graph/margins/gain_crossover"].data == pytest.approx([crossover], rel=1e-6)
    assert result["bond_graph/margins/phase"].data[0] > 60
    assert result["bond_graph/margins/Ms"].data == pytest.approx([1], rel=1e-12)


@pytest.mark.parametrize(
    ("to", "columns", "poles", "expected"),
    [
        ("[pull]", [1], "[-2, {frequency: 5, damping: 0.6}, -8]", [-2, -3 + 4j, -3 - 4j, -8]),
        ("[push, pull]", [0, 1], "[-3, -3, {frequency: 1, damping: 0, unit: Hz}]", [-3, -3, _HZ, -_HZ]),
    ],
)
def test_poles_are_placed_as_by_python_control(to, columns, poles, expected):
    result = dynid.run(carts(f"placement: {{to: {to}, {STATES}, poles: {poles}}}"))
    F, G = T @ A @ np.linalg.inv(T), T @ B[:, columns]
    gains = result[f"{GROUP}/gain"].data
    reached = np.sort_complex(np.linalg.eigvals(F - G @ gains))
    assert reached == pytest.approx(np.sort_complex(expected), rel=1e-6, abs=1e-6)
    if len(columns) == 1:  # of several sources gains are not unique
        assert gains == pytest.approx(control.place(F, G, np.array(expected)), rel=1e-9)
    assert "state feedback" in summary(result, "")
    assert "pole" in summary(result, "")


def test_setpoints_and_references_are_inputs_of_the_closed_loop():
    keys = "setpoints: {spring.q: gap, left.q: wall}, references: {pull: extra}"
    scene = carts(f"lqr: {{{STATES}, weights: {{left.q: 300, two.f: 7, pull: 0.02}}, {keys}}}")
    text = scene.source.text.replace("results: [properties, poles]", "results: [time_response, state_space]")
    keys = "inputs: [gap, wall, extra]\n  outputs: [two.f, spring.q]\n  time: {stop: 3, step: 0.5}"
    text = text.replace("outputs: [two.q]", keys)
    result = dynid.run(check_source(parse_source(text, "scene.yaml")))
    gains = result[f"{GROUP}/gain"].data[0]
    F, G = T @ A @ np.linalg.inv(T), T @ B[:, 1]
    closed = F - np.outer(G, gains)
    response = result["bond_graph/time_response/response"].data
    for column, drive in enumerate((gains[2], gains[0], 1.0)):
        rest = np.linalg.solve(closed, G * drive)
        states = np.array([expm(closed * t) @ rest - rest for t in np.arange(0, 3.1, 0.5)])
        assert response[:, :, column] == pytest.approx(states[:, [3, 2]], rel=1e-9, abs=1e-12)


def test_an_integral_is_a_state_of_its_own():
    # a mass that a force moves, x'' = u: gains of least cost sqrt(q), sqrt(2 sqrt(q))
    text = """
dynid: 1
kind: bond-graph
graph:
  nodes: {force: Se, cart: 1, m: {type: I, value: 1}}
  bonds: [force -> cart -> m]
control:
  lqr: {states: [cart.q, cart.f], weights: {cart.q: 16, force: 1}, setpoints: {cart.q: target}}
analysis: {inputs: [target], outputs: [cart.q], results: [properties, transfer_function, poles]}
"""
    result = dynid.run(check_source(parse_source(text.lstrip(), "scene.yaml")))
    assert result[f"{GROUP}/gain"].data == pytest.approx(np.array([[4, np.sqrt(8)]]), rel=1e-12)
    root = "bond_graph/transfer_function/cart.q/target"
    numerator, denominator = result[f"{root}/numerator"].data, result[f"{root}/denominator"].data
    assert numerator / denominator[0] == pytest.approx([4], rel=1e-12)
    assert denominator / denominator[0] == pytest.approx([1, np.sqrt(8), 4], rel=1e-12)
    assert result.value("bond_graph/system/stable")


def test_gains_are_those_of_the_linearisation():
    # a pendulum held upright: J q'' = m g l sin(q) + u about q = 0
    text = """
dynid: 1
kind: bond-graph
graph:
  nodes:
    torque: Se
    rod: 1
    J: {type: I, value: 2}
    weight: {type: C, law: {e: "-30*sin(q)"}}
  bonds: [torque -> rod -> J, rod -> weight]
operating_point: {inputs: {torque: 0}, values: {weight.q: 0}}
control:
  lqr: {states: [weight.q, J.f], weights: {weight.q: 50, J.f: 1, torque: 0.01}}
analysis: {outputs: [weight.q], results: [properties, poles]}
"""
    result = dynid.run(check_source(parse_source(text.lstrip(), "scene.yaml")))
    expected, *_ = control.lqr([[0, 1], [15, 0]], [[0], [0.5]], np.diag([50, 1]), [[0.01]])
    assert result[f"{GROUP}/gain"].data == pytest.approx(expected, rel=1e-9)
    assert result.value("bond_graph/system/stable")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lqr: {states: [left.q], weights: {left.q: 1}}", "no source has a weight"),
        ("lqr: {states: [left.q], weights: {left.q: 1, push: 0}}", "weight of the driven source 'push'"),
        ("lqr: {states: [left.q], weights: {left.q: 0, push: 1}}", "no variable has a positive weight"),
        ("lqr: {states: [left.q], weights: {lift.q: 1, push: 1}}", "no node 'lift'; did you mean"),
        ("lqr: {states: [left.q], weights: {left.x: 1, push: 1}}", "'x' is not one of e, f, q, p"),
        ("lqr: {states: [left.q], weights: {left.q: 1, m1: 1}}", "'m1' is no source"),
        ("lqr: {states: [left.q, left.q], weights: {left.q: 1, push: 1}}", "listed twice"),
        (
            "lqr: {states: [left.q], weights: {left.q: 1, push: 1}, references: {pull: r}}",
            "'pull' is not driven; there are: push",
        ),
        (
            "lqr: {states: [left.q], weights: {left.q: 1, push: 1}, setpoints: {two.f: w}}",
            "'two.f' is not fed back; there are: left.q",
        ),
        (
            "lqr: {states: [left.q], weights: {left.q: 1, push: 1}, setpoints: {left.q: a b}}",
            "'a b' cannot name an input",
        ),
        (
            "lqr: {states: [left.q], weights: {left.q: 1, push: 1}, setpoints: {left.q: m1}}",
            "'m1' is a node; use another name",
        ),
        ("placement: {to: [push], states: [left.q], poles: [-1, -2]}", "2 poles of 1 state: give as many"),
        (
            "placement: {to: [push], states: [left.q, one.f], poles: [{frequency: 3}]}",
            "a pole is a real number, or {frequency: …, damping: …}",
        ),
        (
            "placement: {to: [push], states: [left.q, one.f], poles: [{frequency: 3, damping: 1}]}",
            "the damping ratio of a pair lies between -1 and 1",
        ),
        ("{}", "feedback is one of 'loops', 'lqr' and 'placement'"),
    ],
)
def test_faults_have_their_place(text, message):
    with pytest.raises(SceneError) as raised:
        carts(text)
    (fault,) = [fault for fault in raised.value.faults if message in str(fault)]
    assert str(fault).startswith("scene.yaml:24:")


@pytest.mark.parametrize(
    ("text", "message", "names"),
    [
        (
            "lqr: {states: [left.q], weights: {left.q: 1, push: 1}}",
            "1 state of a graph with 4",
            "control.lqr.states",
        ),
        (
            "lqr: {states: [left.q, one.f, m1.p, two.f], weights: {left.q: 1, push: 1}}",
            "the states depend on each other",
            "control.lqr.states",
        ),
        (
            "lqr: {states: [left.q, one.f, m1.e, two.f], weights: {left.q: 1, push: 1}}",
            "'m1.e' follows a source that is driven at once",
            "control.lqr.states",
        ),
    ],
)
def test_states_are_a_full_set(text, message, names):
    with pytest.raises(UsageError, match=message) as raised:
        dynid.run(carts(text))
    assert names in raised.value.names


def test_modes_that_no_source_moves_are_refused():
    apart = CARTS.replace("    - one -> between -> two -> m2\n", "    - two -> m2\n    - two -> rail\n")
    apart = apart.replace("    - between -> relative -> spring\n", "")
    between = "    between: 0\n    relative: 1\n    spring: {type: C, value: 1/20}\n"
    apart = apart.replace(between, "    rail: {type: C, value: 0.1}\n")
    states = "states: [left.q, one.f, rail.q, two.f]"
    for text, message in (
        (f"placement: {{to: [push], {states}, poles: [-1, -2, -3, -4]}}", "poles are not"),
        (f"lqr: {{{states}, weights: {{left.q: 1, push: 1}}}}", "no gain of least cost|undamped"),
    ):
        with pytest.raises((NumericalError, UsageError), match=message):
            dynid.run(check_source(parse_source(apart.replace("CONTROL", text).lstrip(), "scene.yaml")))


def test_repeated_poles_of_one_source_are_refused():
    with pytest.raises(NumericalError, match="poles are not placed") as raised:
        dynid.run(carts(f"placement: {{to: [push], {STATES}, poles: [-1, -1, -2, -3]}}"))
    assert raised.value.names == ("control.placement.poles",)


def test_gains_are_neither_designed_nor_identified_further():
    feedback = f"lqr: {{{STATES}, weights: {{left.q: 1, push: 1}}}}\nparameters: {{a: 1}}"
    text = CARTS.replace("CONTROL", feedback).replace("value: 0.7", "value: a").lstrip()
    text += "design: {free: {a: 1}, targets: [{phase_margin: 40}]}\n"
    with pytest.raises(SceneError, match="gains of states are designed for a graph of fixed values"):
        check_source(parse_source(text, "scene.yaml"))
