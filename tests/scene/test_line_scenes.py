"""Lossless lines in scenes, against chain matrices, reflections and incomplete gamma functions."""

import mpmath as mp
import numpy as np
import pytest

import dynid
from dynid.bondgraph.cut_loops import CutLoops
from dynid.errors import SceneError, UsageError
from dynid.model_scope import scope_parts
from dynid.report.drawing.bond_graph import drawn_graph
from dynid.scene.kinds.bond_graph import question
from dynid.scene.kinds.explain_graph import explain
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

LINE = """\
dynid: 1
kind: bond-graph
graph:
  nodes:
    u: Se
    a: 1
    Rs: {type: R, value: 0.2}
    cable: {type: TL, impedance: 2, delay: 0.5}
    b: 0
    RL: {type: R, value: 50}
  bonds: [u -> a, a -> Rs, a -> cable -> b, b -> RL]
analysis: {outputs: [RL.e, Rs.f]}
"""
LOADED = LINE.replace("bonds: [", "  C: {type: C, value: 0.05}\n  bonds: [b -> C, ")


def scene(text):
    return check_source(parse_source(text, "scene.yaml"))


def asked(text, more):
    return text.replace("outputs: [RL.e, Rs.f]", f"outputs: [RL.e, Rs.f], {more}")


def chained(s, lines, shunts, Rs, load):
    """Return the load's effort and the source's flow for a unit effort, by chain matrices."""
    M = mp.matrix([[1, Rs], [0, 1]])
    for (Z, T), Y in zip(lines, shunts, strict=True):
        M *= mp.matrix([[mp.cosh(s * T), Z * mp.sinh(s * T)], [mp.sinh(s * T) / Z, mp.cosh(s * T)]])
        M *= mp.matrix([[1, 0], [Y(s), 1]])
    end = M * mp.matrix([1, 1 / load])
    return 1 / end[0], end[1] / end[0]


def test_the_frequency_response_is_that_of_chain_matrices():
    requested = "results: [frequency_response], frequency: {start: 0.1, stop: 40, points: 60}"
    result = dynid.run(scene(asked(LOADED, requested)))
    group = "bond_graph/frequency_response"
    response = result[f"{group}/response"].data[:, :, 0]
    with mp.workdps(40):
        for omega, values in zip(result[f"{group}/omega"].data.tolist(), response, strict=True):
            s = mp.mpc(0, omega)
            effort, flow = chained(s, [(2, mp.mpf("0.5"))], [lambda s: s * mp.mpf("0.05")], mp.mpf("0.2"), 50)
            assert abs(values[0] - complex(effort)) < 2e-14 * abs(complex(effort)) + 1e-15
            assert abs(values[1] - complex(flow)) < 2e-14 * abs(complex(flow)) + 1e-15


def test_the_poles_are_those_of_the_reflections():
    result = dynid.run(scene(LINE))
    product = (0.2 - 2) / (0.2 + 2) * (50 - 2) / (50 + 2)
    poles = result["bond_graph/margins/poles"].data
    expected = (np.log(complex(product)) + 2j * np.pi * np.arange(-40, 40)) / 1.0
    distance = np.abs(poles[:, None] - expected).min(axis=1)
    assert distance.max() < 1e-14 * np.abs(poles).max()
    assert result.value("bond_graph/system/stable")
    note = result["bond_graph/margins/poles"].attrs["note"]
    assert f"all poles lie on the line Re s = {np.log(abs(product)):.6g} rad/s" in note
    assert "bond_graph/margins/loop" not in result


def test_a_step_over_twenty_round_trips():
    """R - line - R || C: each round trip adds a pole of higher order, an incomplete gamma function."""
    text = asked(LOADED, "results: [time_response], time: {stop: 20, step: 0.97, input: {kind: step}}")
    result = dynid.run(scene(text))
    times, response = (result[f"bond_graph/time_response/{name}"].data for name in ("time", "response"))
    with mp.workdps(40):
        Z, Rs, RL, C, T = (mp.mpf(x) for x in ("2", "0.2", "50", "0.05", "0.5"))
        a, k, g = (1 / Z + 1 / RL) / C, 1 / (Z * C), 1 / (Rs + Z)

        def end(t):
            total, trip = mp.mpf(0), 0
            while (2 * trip + 1) * T < t:
                rest, wave = t - (2 * trip + 1) * T, mp.mpf(0)
                for i in range(trip + 1):
                    part = mp.gammainc(i + 1, 0, a * rest, regularized=True) / a ** (i + 1)
                    wave += mp.binomial(trip, i) * (2 * k) ** i * (-1) ** (trip - i) * k * part
                total += 2 * Z * g * (1 - 2 * Z * g) ** trip * wave
                trip += 1
            return float(total)

        expected = [end(mp.mpf(time)) for time in times.tolist()]
    assert response[:, 0] == pytest.approx(expected, abs=1e-13)


def many(count):
    """Return a scene of lines of different delays with a compliance between each two."""
    nodes, bonds, end = ["u: Se, a: 1, Rs: {type: R, value: 0.2}"], ["u -> a, a -> Rs"], "a"
    for k in range(count):
        load = f"C{k}: {{type: C, value: {(k + 1) / 10}}}" if k < count - 1 else "RL: {type: R, value: 5}"
        nodes.append(f"l{k}: {{type: TL, impedance: {1 + k / 10}, delay: {1 + k / 4}}}, n{k}: 0, {load}")
        bonds.append(f"{end} -> l{k} -> n{k}, n{k} -> {load.partition(':')[0]}")
        end = f"n{k}"
    return (
        f"dynid: 1\nkind: bond-graph\ngraph: {{nodes: {{{', '.join(nodes)}}}, bonds: [{', '.join(bonds)}]}}\n"
        "analysis: {outputs: [RL.e], results: [properties]}\n"
    )


@pytest.mark.parametrize("count", [1, 3, 8])
def test_the_characteristic_function_of_many_lines(count):
    """At any s it is the input impedance's denominator, times what does not depend on the delays."""
    _, analysis = question(scene(many(count)))
    function = CutLoops(analysis.opened, analysis.loops).closed
    with mp.workdps(40):
        lines = [(1 + mp.mpf(k) / 10, 1 + mp.mpf(k) / 4) for k in range(count)]
        shunts = [lambda s, k=k: s * (k + 1) / 10 for k in range(count - 1)] + [lambda s: 0 * s]
        ratios = []
        for s in (mp.mpc("0.3", "0.7"), mp.mpc("-0.1", "1.1"), mp.mpc("0.2", "2.3")):
            value = sum(
                mp.polyval([int(c) for c in reversed(p.coeffs())], s)
                * mp.exp(-s * mp.mpf(tau.numerator) / tau.denominator)
                for tau, p in function.terms.items()
            )
            effort, _ = chained(s, lines, shunts, mp.mpf("0.2"), mp.mpf(5))
            travel = sum(T for _, T in lines)
            ratios.append(value * effort * mp.exp(s * travel))
        # both are the same polynomial in s and the delays, times a constant
        assert abs(ratios[1] / ratios[0] - 1) < 1e-25
        assert abs(ratios[2] / ratios[0] - 1) < 1e-25


def test_one_determinant_is_the_sum_of_minors():
    _, analysis = question(scene(many(2)))
    cut = CutLoops(analysis.opened, analysis.loops)
    for kept in ([0, 1, 2, 3], [0, 1], [1, 2, 3], []):
        minors, determinant = cut.function(kept), cut._determinant_in_delays(frozenset(kept))
        assert set(minors.products) == set(determinant.products)
        pairs = [(minors.products[key], determinant.products[key]) for key in minors.products]
        first = pairs[0]
        for a, b in pairs:
            assert a * first[1] == b * first[0]


@pytest.mark.parametrize(
    ("old", "new", "kind", "poles"),
    [
        ("value: 50", "value: 2", "stable", 0),  # matched
        ("value: 0.2", "value: 1.0e-9", "stable", 0),
        ("value: 50", "value: -2.2", "unstable", -1),
    ],
)
def test_verdicts_of_one_line(old, new, kind, poles):
    result = dynid.run(scene(LINE.replace(old, new)))
    assert result.value("bond_graph/system/stability") == kind
    assert result.value("bond_graph/system/unstable_poles") == poles


def test_passive_lines_have_no_pole_in_the_right_half_plane():
    result = dynid.run(scene(many(4)))  # compliances reflect high frequencies: chains approach the axis
    assert result.value("bond_graph/system/stability") == "at the limit"
    assert "the system is passive" in result.value("bond_graph/system/reason")
    assert result.value("bond_graph/system/unstable_poles") == 0
    assert not result.value("bond_graph/system/stable")


def test_a_line_is_drawn_as_one_element():
    drawn = drawn_graph(dynid.run(scene(LINE)))
    assert drawn.boxes == {"cable": "line: 2, 0.5 s"}
    assert len(drawn.graph.nodes) == 6


def test_a_line_is_reduced_as_a_two_port():
    """The admittance that the load sees, as the steps write it, is that of the line from the source's end."""
    result = dynid.run(scene(asked(LINE, "results: [reduction]")))
    steps = result["bond_graph/reduction/steps"].data
    assert steps[0]["rule"] == "line"
    assert steps[0]["equation"] == ("cable.arm1 = cable.arm2 = 2*tanh(0.5*s/2); cable.across = 2/sinh(0.5*s)")
    formula = result["bond_graph/reduction/system_a"].data[0]
    assert formula == "Y_A = 1/(cable.arm2 + 1/(1/cable.across + 1/(Rs + cable.arm1)))"
    s = mp.mpc("0.3", "1.7")
    arm, across = 2 * mp.tanh(0.5 * s / 2), 2 / mp.sinh(0.5 * s)
    seen = 1 / (arm + 1 / (1 / across + 1 / (mp.mpf("0.2") + arm)))
    sinh, cosh = mp.sinh(0.5 * s), mp.cosh(0.5 * s)
    assert mp.almosteq(seen, (cosh + sinh / 10) / (2 * sinh + cosh / 5))
    assert not any(
        "approximate" in result[f"bond_graph/reduction/{name}"].attrs for name in ("steps", "system_a")
    )


def test_the_state_equations_of_a_line_are_a_linear_fractional_form():
    result = dynid.run(scene(asked(LOADED, "results: [state_space]")))
    A, B, C, D = (result[f"bond_graph/state_space/{name}"].data for name in "ABCD")
    delays = result["bond_graph/state_space/delay"].data
    assert (A.shape, B.shape, C.shape, delays.tolist()) == ((1, 1), (1, 3), (4, 1), [0.5, 0.5])
    s = 1.3j
    G = C @ np.linalg.solve(s * np.eye(1) - A, B) + D
    late = np.diag(np.exp(-s * delays))
    closed = G[:2, :1] + G[:2, 1:] @ late @ np.linalg.solve(np.eye(2) - G[2:, 1:] @ late, G[2:, :1])
    expected = chained(s, [(2, 0.5)], [lambda s: 0.05 * s], 0.2, 50)
    np.testing.assert_allclose(closed[:, 0], [complex(value) for value in expected], rtol=1e-13)


LATE_LOOP = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, v: 1, m: {type: I, value: 1}, b: {type: R, value: 2}, k: {type: C, value: 1}}
  bonds: [F -> v, v -> m, v -> b, v -> k]
control: {loops: [{from: k.q, to: F, controller: {pid: {kp: 1, ki: 0.5}, TIMING}, setpoint: w}]}
analysis: {inputs: [w], outputs: [k.q]}
"""


@pytest.mark.parametrize(
    ("text", "size", "order"),
    [
        (LOADED, (7, 6), "1 state, 1 storage element, 2 delays (two of each line: cable)"),
        (LATE_LOOP.replace("TIMING", "delay: 0.3"), (5, 4), "3 states, 3 storage elements, 1 delay"),
        (LATE_LOOP.replace("TIMING", "sample: 0.1"), (5, 4), "2 states, 2 storage elements"),
    ],
)
def test_graphs_are_counted_as_they_are_drawn(text, size, order):
    """Neither approximants of delays nor what lines and controllers consist of are counted."""
    facts = {fact.topic: fact.text for fact in explain(scene(text)).facts}
    assert facts["graph"] == "{} nodes, {} bonds, all affect an output".format(*size)
    assert facts["order"] == order
    assert "warning" not in facts
    result = dynid.run(scene(text))
    about = result.group_attrs["bond_graph"]
    assert (about["nodes"], about["bonds"]) == size
    parts = {part.name: part for part in scope_parts(result, "bond_graph")}
    assert len(parts["elements"].kept) == size[0]
    assert not parts["elements"].left_out
    assert not parts["storages"].left_out


def test_a_dirac_impulse_is_not_sampled():
    text = LATE_LOOP.replace("TIMING", "sample: 0.1")
    time = "time: {stop: 1, step: 0.1, input: {kind: KIND, amplitude: 1}}"
    with pytest.raises(UsageError, match="measures has a Dirac impulse, of which no sample has a value"):
        dynid.run(scene(text.replace("outputs: [k.q]", f"outputs: [k.q], {time.replace('KIND', 'impulse')}")))
    dynid.run(scene(text.replace("outputs: [k.q]", f"outputs: [k.q], {time.replace('KIND', 'step')}")))


def test_states_and_causality_of_a_late_loop_have_no_approximants():
    text = LATE_LOOP.replace("TIMING", "delay: 0.3")
    requested = "outputs: [k.q], results: [state_space, causality, reduction]"
    result = dynid.run(scene(text.replace("outputs: [k.q]", requested)))
    assert result.value("bond_graph/causality/order") == 3
    assert len(result["bond_graph/state_space/state"].data) == 3
    parts = {part.name: part for part in scope_parts(result, "bond_graph")}
    assert parts["states"].left_out == 0
    steps = result["bond_graph/reduction/steps"].data
    assert steps[0]["equation"] == "F.delay = -exp(-0.3*s)"
    assert not any("x2" in node for step in steps for node in step["nodes"].split(", "))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("impedance: 2, ", "", "a line is written {type: TL, impedance: …, delay: …}"),
        ("impedance: 2", "value: 1, impedance: 2", "a line is written"),
        ("impedance: 2", "impedance: -2", "-2"),
        ("value: 50", "value: 50, delay: 1", "'delay' belongs to a node of type TL, not R"),
        ("a -> cable -> b", "cable -> b", "TL 'cable' needs one bond in and one bond out"),
        ("outputs: [RL.e, Rs.f]", "outputs: [cable.e]", "TL 'cable' has two ports"),
        ("outputs: [RL.e, Rs.f]", "outputs: [RL.e], results: [energy]", "there is no 'energy' with a line"),
        ("outputs: [RL.e, Rs.f]", "outputs: [RL.e], port: a -> cable", "there is no 'port' with a line"),
    ],
)
def test_faults_of_lines_are_located(old, new, message):
    assert old in LINE
    with pytest.raises(SceneError) as raised:
        scene(LINE.replace(old, new))
    assert message in str(raised.value)


def test_a_graph_with_a_line_is_not_identified():
    text = LINE.replace("bond-graph", "identification").partition("analysis:")[0]
    with pytest.raises(SceneError, match="a graph with a line is not identified"):
        scene(text + "measurement: {step: 0.01, samples: 9, channels: [{output: RL.e}], simulate: {}}\n")


def test_more_lines_than_their_common_roots_allow_are_refused():
    names = [f"L{k}" for k in range(9)]
    lines = "\n".join(f"    {name}: {{type: TL, impedance: 2, delay: 0.5}}" for name in names)
    text = LINE.replace("    cable: {type: TL, impedance: 2, delay: 0.5}", lines)
    with pytest.raises(SceneError, match=r"at most 8 lines \(TL\), not 9"):
        scene(text.replace("a -> cable -> b", f"a -> {' -> '.join(names)} -> b"))


def test_a_sampled_controller_behind_a_matched_line():
    """The wave is the held input, late: steps of a lag by its exponential."""
    text = LINE.replace("Rs: {type: R, value: 0.2}", "Rs: {type: R, value: 2}").replace(
        "a -> Rs,", "a -> Rs, b -> C,"
    )
    text = text.replace("RL: {type: R, value: 50}", "RL: {type: R, value: 5}\n    C: {type: C, value: 0.5}")
    pid = "{pid: {kp: 0.2, ki: 0.5}, sample: 0.1, computation: 0.04}"
    loop = f"{{from: C.e, to: u, controller: {pid}, setpoint: w}}"
    text = text.replace("analysis:", f"control: {{loops: [{loop}]}}\nanalysis:")
    text = text.replace(
        "outputs: [RL.e, Rs.f]", "outputs: [C.e], time: {stop: 20, step: 0.05, input: {kind: step}}"
    )
    result = dynid.run(scene(text))
    step, rate = 0.01, (1 / 2 + 1 / 5) / 0.5
    decay = np.exp(-rate * step)
    gain = (1 - decay) / (2 * 0.5 * rate)
    x, integral, held, values, answers = 0.0, 0.0, np.zeros(2100), [], {}
    for k in range(2001):
        values.append(x)
        if k % 10 == 0:
            answers[k + 4] = 0.2 * (1 - x) + integral + 0.5 * 0.05 * (1 - x)
            integral += 0.5 * 0.1 * (1 - x)
        held[k] = answers.get(k, held[k - 1] if k else 0.0)
        x = decay * x + gain * (held[k - 50] if k >= 50 else 0.0)
    response = result["bond_graph/time_response/response"].data[:, 0]
    assert response == pytest.approx(values[::5], abs=1e-13)
    assert result.value("bond_graph/system/stability") == "stable"
    with pytest.raises(SceneError, match="there is no 'causality' with sampled loops with a line"):
        scene(text.replace("outputs: [C.e]", "outputs: [C.e], results: [causality]"))
