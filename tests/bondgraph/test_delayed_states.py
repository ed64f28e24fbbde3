"""Graphs whose loops have delays as linear fractional forms: responses, zeros and samples."""

import math

import numpy as np
import pytest

import dynid
from dynid.bondgraph.delayed_response import delayed_response
from dynid.bondgraph.delayed_states import delay_system
from dynid.errors import NumericalError, Singular, UsageError
from dynid.scene.batch import run_batch
from dynid.scene.kinds.bond_graph import question
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

pytestmark = pytest.mark.thorough


def scene(text):
    return check_source(parse_source(f"dynid: 1\nkind: bond-graph\n{text}", "late.yaml"))


TWO = """
graph:
  nodes: {u: Se, j: 1, m: {type: I, value: 1}, b: {type: R, value: 0.4}, t: {type: TF, value: 2}, p: 0,
          k: {type: C, value: 1}, s: Sf, g: {type: GY, value: 3}, q: 1, i: {type: I, value: 2}, act: Se}
  bonds: [u -> j, act -> j, j -> m, j -> b, j -> t -> p, p -> k, s -> p, p -> g -> q, q -> i]
analysis: {inputs: [u, w, r], outputs: [k.q, j.f, act.e, q.f], results: [properties]}
control:
  loops:
  - {from: k.q, to: act, controller: {pid: {kp: 1, ki: 0.3, kd: 0.4, tf: 0.05}, delay: 0.3}, setpoint: w}
  - {from: i.p, to: s, controller: {numerator: [1, 2], denominator: [1, 3, 1], delay: 0.7}, reference: r}
  - {from: b.e, to: act, controller: {gain: 0.2}}
"""


def test_the_form_has_the_frequency_response_of_the_graph():
    _, analysis = question(scene(TWO))
    arguments = analysis.opened, analysis.loops, analysis.inputs, analysis.outputs
    system, _ = delay_system(*arguments)
    assert [float(delay) for delay in system.delays] == [0.3, 0.7]
    omega, lft = np.geomspace(0.05, 50, 15), system.lft
    expected = delayed_response(*arguments)(omega)
    for frequency, response in zip(omega, expected, strict=True):
        s = 1j * frequency
        G = lft.C @ np.linalg.solve(s * np.eye(len(lft.A)) - lft.A, lft.B) + lft.D
        late = np.diag(np.exp(-s * np.array([0.3, 0.7])))
        y, u = slice(system.outputs), slice(system.inputs)
        z, v = slice(system.outputs, None), slice(system.inputs, None)
        closed = G[y, u] + G[y, v] @ late @ np.linalg.solve(np.eye(2) - G[z, v] @ late, G[z, u])
        np.testing.assert_allclose(closed, response, rtol=1e-11, atol=1e-14)


MASS = """
graph: {nodes: {u: Se, F: Se, j: 1, m: {type: I, value: 1}}, bonds: [u -> j, F -> j, j -> m]}
control: {loops: [{from: m.f, to: u, controller: {gain: 0.8, delay: DELAY}, reference: r}]}
analysis: {outputs: [m.f], inputs: [F, r], results: [time_response], time: {stop: 8, step: 0.5INPUT}}
"""


def polynomials(time):
    """The step response of x' = 1 - 0.8 x(t - 1)."""
    terms = range(int(time) + 1)
    return sum((-0.8) ** k * (time - k) ** (k + 1) / math.factorial(k + 1) for k in terms)


def test_an_integrator_responds_to_steps_of_each_source_and_to_its_initial_flow():
    times = np.arange(17) / 2
    expected = [polynomials(time) for time in times]
    result = dynid.run(scene(MASS.replace("DELAY", "1").replace("INPUT", "")))
    response = result["bond_graph/time_response/response"].data  # each source alone
    for source in (0, 1):
        assert response[:, 0, source] == pytest.approx(expected, abs=1e-13)
    assert result["bond_graph/time_response/error_estimate"].data.max() < 1e-12
    text = MASS.replace("DELAY", "1").replace("INPUT", "") + "initial: {m: {f: 2}}\n"
    free = dynid.run(scene(text))["bond_graph/time_response/response"].data[:, 0]
    steps = [
        sum((-0.8) ** k * (time - k) ** k / math.factorial(k) for k in range(int(time) + 1)) for time in times
    ]
    assert free == pytest.approx(2 * np.array(steps), abs=1e-13)


def test_what_is_too_long_or_advanced_is_refused():
    with pytest.raises(UsageError, match="8,000,000 segments or more, one in every delay of 1e-06 s"):
        dynid.run(scene(MASS.replace("DELAY", "1.0e-6").replace("INPUT", "")))
    advanced = MASS.replace("gain: 0.8", "numerator: [1, 0, 0], denominator: [0.1, 1]").replace(
        "type: I", "type: R"
    )
    with pytest.raises(NumericalError, match="advanced"):
        dynid.run(scene(advanced.replace("DELAY", "1").replace("INPUT", "")))


def test_a_feed_forward_with_a_delay_has_zeros_of_its_own():
    """(1 + 0.5 e^(-s)) d drives the mass: zeros at ln 0.5 ± jπ, no dead time."""
    result = dynid.run(
        scene("""
graph:
  nodes: {d: Se, u: Se, j: 1, m: {type: I, value: 1}, b: {type: R, value: 1}}
  bonds: [d -> j, u -> j, j -> m, j -> b]
control: {loops: [{from: d.e, to: u, controller: {gain: -0.5, delay: 1}}]}
analysis: {inputs: [d], outputs: [m.f], results: [zeros, poles, properties]}
""")
    )
    group = "bond_graph/transfer_function/m.f/d"
    zeros = result[f"{group}/zeros"]
    assert zeros.data[:2] == pytest.approx(
        [complex(math.log(0.5), sign * math.pi) for sign in (1, -1)], rel=1e-12
    )
    assert result[f"{group}/poles"].data.tolist() == [-1]
    properties = "bond_graph/properties/m.f/d"
    assert result.value(f"{properties}/minimum_phase") is True
    assert result.value(f"{properties}/order") == 1
    assert f"{properties}/hidden_modes" not in result


def test_samples_of_a_study_have_the_delay_as_it_is():
    plain = scene(MASS.replace("DELAY", "1").replace("INPUT", ""))
    path = "bond_graph/time_response/response"
    outcomes = run_batch(plain, [{"graph.nodes.m.value": 2}], (path,))
    (block,) = outcomes.blocks
    assert block.values[path].data[0, 2, 0, 0] == pytest.approx(0.5, abs=1e-13)


APART = """
graph:
  nodes: {u: Se, j: 1, m: {type: I, value: 1}, d: {type: R, value: 1}, act: Se,
          v: Se, k: 1, n: {type: I, value: 1}, act2: Se}
  bonds: [u -> j, act -> j, j -> m, j -> d, v -> k, act2 -> k, k -> n]
analysis: {inputs: [u, w], outputs: [m.f, n.f, w.e], results: [properties, poles, step_info]}
control:
  loops:
  - {from: m.f, to: act, controller: {gain: 0.5, delay: 1}}
  - {from: n.f, to: act2, controller: {gain: 3, delay: 1}, setpoint: w}
"""


@pytest.mark.thorough
def test_channels_that_are_unstable_or_vanish_say_so():
    """x' = -x - 0.5 x(t - 1) + u is stable, x' = 3 (w - x)(t - 1) is not, and neither acts on the other."""
    result = dynid.run(scene(APART))
    values = {
        (output, source): {
            name: result.value(f"bond_graph/properties/{output}/{source}/{name}")
            for name in ("step_status", "stability", "stable")
        }
        for output in ("m.f", "n.f", "w.e")
        for source in "uw"
    }
    assert values["m.f", "u"] == {"step_status": "defined", "stability": "stable", "stable": True}
    assert values["m.f", "w"]["step_status"] == "undefined: the input does not reach the output"
    unstable = values["n.f", "w"]
    assert unstable["step_status"].startswith("undefined: there is no steady state; unstable: poles at")
    assert not unstable["stable"]
    pole = result["bond_graph/transfer_function/n.f/w/poles"].data[0]
    assert abs(pole + 3 * np.exp(-pole)) < 1e-13
    assert f"{pole.real:.4g} ± {pole.imag:.4g}j lie in the right half-plane" in unstable["stability"]
    assert values["w.e", "w"]["step_status"].startswith("not computed")
    assert result.value("bond_graph/properties/m.f/u/rise_time") > 0


@pytest.mark.thorough
def test_a_graph_that_is_open_without_its_loops_keeps_approximants(monkeypatch):
    def singular(*_):
        raise Singular("no unique solution")

    monkeypatch.setattr("dynid.bondgraph.results.delayed_channels.DelayedChannels.__init__", singular)
    result = dynid.run(scene(APART))
    assert "Padé" in result["bond_graph/transfer_function/m.f/u/poles"].attrs["approximate"]
    status = result.value("bond_graph/properties/m.f/u/step_status")
    assert status == "not computed: no unique solution"


@pytest.mark.thorough
def test_the_phase_is_left_out_where_it_takes_too_many_frequencies():
    more = "[properties, frequency_response], frequency: {start: 1, stop: 1.0e6, points: 3}"
    result = dynid.run(scene(APART.replace("[properties, poles, step_info]", more)))
    assert "bond_graph/frequency_response/phase" not in result
    assert "too often" in result.group_attrs["bond_graph/frequency_response"]["phase_left_out"]


def test_the_engine_that_estimates_roots_has_the_bounds_of_true_ones():
    text = APART.replace("results: [properties, poles, step_info]", "results: [zeros, poles], engine: float")
    result = dynid.run(scene(text))
    group = "bond_graph/transfer_function/n.f/w"
    assert result[f"{group}/pole_error_bound"].data.max() < 1e-10
    assert not any("error_estimate" in path for path in result if path.startswith(group))
    timed = APART.replace(
        "[properties, poles, step_info]", "[time_response, poles], time: {stop: 1, step: 0.1}"
    )
    assert scene(timed).model.aspects == set()  # there is one way alone
