"""Unknown parameters of scenes, and those known with uncertainty: what depends on them, what is refused."""

import math
import re
from fractions import Fraction

import pytest

import dynid
from dynid.errors import SceneError
from dynid.parameters import ParameterPrior
from dynid.scene.batch import run_alone, run_batch, why_alone
from dynid.scene.kinds.parameters import all_parameters, unknown_parameters
from dynid.scene.load import load_scene
from dynid.scene.yaml.source import parse_source
from dynid.scene.yaml.writer import dump
from tests.scene.example_scenes import ISOLATOR, check, faults_of
from tests.scene.test_scene_faults import NOT_A_SENTENCE, WRONG, paths_in, replaced

CHAIN = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [m, 1], links: [{dofs: [1], k: 2*kb, c: 1}]}
joints:
  j: {dofs: [1, 2], k: kb, c: {start: 1, true: 2}}
excitation: {dof: 2, kind: sine, frequency: 3, gain: s, delay: t}
measurement:
  step: 0.01
  samples: 100
  channels: [{dof: 2, quantity: velocity, gain: -1, offset: b, unit: m/s}]
  simulate: {noise_ratio: 0.05, seed: 1}
parameters:
  n: 2
  m: {value: n, std: n/100}
  kb: {start: 10, true: 5*n, min: 1, max: 1.0e3, prior: {value: 12, relative_deviation: 0.2}}
  s: {start: 1, true: 1, scale: linear, prior: {value: 1, std: 0.1}}
  b: {start: 0, true: 0.5}
  t: {start: -0.1, true: 0, min: -1, max: 1}
"""

GRAPH = """\
dynid: 1
kind: identification
graph:
  nodes:
    v: Sf
    zero: 0
    one: 1
    spring: {type: C, value: 1/k}
    damper: {type: R, value: 3}
    mass: {type: I, value: m}
    side: 1
  bonds: [v -> zero, zero -> side, side -> spring, side -> damper, zero -> one, one -> mass]
excitation: [{source: v, kind: sine, amplitude: 1, frequency: 3, delay: t}]
measurement:
  step: 0.01
  samples: 100
  channels: [{output: mass.f, gain: g}, {output: spring.q}]
  simulate: {noise_ratio: 0.05}
initial: {mass: {f: 0.1}, spring: {e: 1}}
parameters:
  k: 100
  m: {start: 1, true: 2}
  g: {start: 1, true: 1}
  t: {start: 0, true: 0.1}
"""


def test_unknown_parameters_are_read_in_the_order_of_the_scene():
    kb, s, b, t = unknown_parameters(check(CHAIN).model)
    assert (kb.name, kb.start, kb.true, kb.low, kb.high) == ("kb", 10.0, 10.0, 1.0, 1e3)
    assert kb.prior == ParameterPrior(12.0, 0.2)
    assert (s.prior.absolute, s.prior.relative) == (0.1, 0.1)
    assert [one.scale for one in (kb, s, b, t)] == ["log", "linear", "linear", "linear"]


def test_considered_parameters_have_a_value_and_a_deviation():
    mass = all_parameters(check(CHAIN).model)[-1]
    assert (mass.name, mass.start, mass.true, mass.std) == ("m", 2.0, 2.0, 0.02)


def test_a_quantity_is_a_function_of_the_parameters_that_it_names():
    model = check(CHAIN).model
    stiffness = model.structure.lumped.links[0].k
    assert float(stiffness) == 20.0
    assert stiffness.value == Fraction(20)
    assert stiffness.real.at({"kb": 7.0}) == (14.0, {"kb": 2.0})
    assert model.structure.lumped.masses[0].real.names == {"m"}
    assert model.structure.lumped.masses[1].real == 1.0


def test_parameters_that_depend_on_unknown_ones_are_followed_to_these():
    text = CHAIN.replace("  n: 2\n", "  n: 2\n  half: kb/n\n  root: sqrt(half)*m\n").replace(
        "k: kb", "k: root"
    )
    real = check(text).model.joints["j"].k.value.real
    kb, m = 8.0, 3.0
    value, slopes = real.at({"kb": kb, "m": m})
    assert value == pytest.approx(m * math.sqrt(kb / 2), rel=1e-15)
    assert slopes["m"] == pytest.approx(math.sqrt(kb / 2), rel=1e-15)
    assert slopes["kb"] == pytest.approx(m / 4 / math.sqrt(kb / 2), rel=1e-15)


@pytest.mark.parametrize(
    ("entry", "value"), [("{start: 3, true: 4}", 4), ("{start: 3}", 3), ("{value: 5, std: 1}", 5)]
)
def test_elsewhere_than_in_an_identification_a_parameter_has_its_value(entry, value):
    scene = check(ISOLATOR.replace("b: 50", f"b: {entry}"))
    damper = scene.model.graph.nodes["b"].value
    assert (damper.value, damper.real) == (value, value)


def test_results_of_a_graph_are_those_at_the_value(tmp_path):
    found = []
    for name, entry in (("plain", "50"), ("unknown", "{start: 1, true: 50, scale: log}")):
        path = tmp_path / f"{name}.yaml"
        path.write_text(ISOLATOR.replace("b: 50", f"b: {entry}"), encoding="utf-8")
        result = dynid.run(load_scene(path))
        found.append({key: result[key].data.tolist() for key in result if "/zeros" in key or "/poles" in key})
    assert found[0]
    assert found[0] == found[1]


def test_an_unknown_parameter_is_an_independent_one_of_the_sensitivities(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(ISOLATOR.replace("b: 50", "b: {start: 5*m_s}"), encoding="utf-8")
    result = dynid.run(load_scene(path, ["analysis.results=[sensitivities]", "expect=[]", "initial={}"]))
    names = result["bond_graph/sensitivities/m_s.f/v_in/parameter"].data
    assert list(names) == ["m_s", "b", "A_p", "I_f", "C_a"]


def test_samples_of_a_graph_that_differ_in_starts_are_run_together():
    text = ISOLATOR.replace("b: 50", "b: {start: 50}").replace("A_p: 0.01", "A_p: {value: 0.01, std: 0.001}")
    scene = check(text)
    paths = ["parameters.b.start", "parameters.A_p.value"]
    overrides = [dict(zip(paths, row, strict=True)) for row in [(50.0, 0.01), (20.0, 0.02), (0.0, 0.01)]]
    collect = ("bond_graph/transfer_function/m_s.f/v_in/zeros",)
    assert why_alone(scene, paths, collect) == ""
    for override, outcome in zip(overrides, run_batch(scene, overrides, collect), strict=True):
        alone = run_alone(scene, override, collect)
        assert (outcome.error, outcome.exit_code) == (alone.error, alone.exit_code)
        assert outcome.values.keys() == alone.values.keys()
        assert all(outcome.values[name].equals(alone.values[name]) for name in alone.values)
    bounded = check(text.replace("{start: 50}", "{start: 50, max: 60}"))
    assert why_alone(bounded, paths[:1], collect) != ""  # a value beyond the bound is a fault of its own


def test_values_of_unknown_parameters_can_be_set_and_misspelt_ones_are_refused(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(CHAIN, encoding="utf-8")
    assert unknown_parameters(load_scene(path, ["parameters.kb.start=20"]).model)[0].start == 20.0
    for override, message in [
        ("parameters.kbb.start=20", "the scene has no parameter 'kbb'; did you mean 'kb'?"),
        ("parameters.kb.strat=20", "'strat' is not a key of parameters.kb; did you mean 'start'?"),
        ("parameters.n.start=20", "parameters.n is a number, not a mapping; it has no 'start'"),
        ("parameters.kb.start=2000", "'start' does not lie between 'min' and 'max'"),
    ]:
        with pytest.raises(SceneError, match=re.escape(message)):
            load_scene(path, [override])


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        # mappings
        (
            "start: 10, true",
            "strat: 10, true",
            "16:8: 'strat' is not a key of parameters.kb; did you mean 'start'",
        ),
        (
            "start: 10, true",
            "start: 10, value: 3, true",
            "16:7: a parameter is a number, an expression, unknown",
        ),
        ("{value: n, std: n/100}", "{value: n}", "15:6: the 'std' of this 'value' is missing"),
        ("{value: n, std: n/100}", "{value: n, std: 0}", "15:22: 0 is not positive"),
        (
            "{value: n, std: n/100}",
            "{value: n, std: 1, min: 1}",
            "15:6: 'min' belongs to an unknown parameter",
        ),
        ("{value: n, std: n/100}", "[1, 2]", "15:6: a parameter is a number or an expression"),
        ("{value: n, std: n/100}", "yes", "15:6: no parameter 'yes'"),
        ("start: 10", "start: [10]", "16:15: a list where a number, a parameter or an expression belongs"),
        ("true: 5*n", "true: true", "16:25: true is not a number"),
        ("true: 5*n", "true: 5*nn", "16:25: no parameter 'nn'; did you mean 'n'?"),
        ("max: 1.0e3", "max: 9", "16:7: 'start' does not lie between 'min' and 'max'"),
        ("min: 1,", "min: 0, scale: log,", "16:7: 'min' is 0; with 'scale: log' the logarithm is estimated"),
        (
            "min: 1,",
            "min: -1,",
            "16:3: the parameter kb is estimated by its logarithm, and has a number that",
        ),
        ("std: 0.1}", "std: 0.1, relative_deviation: 1}", "17:48: a prior has either a 'relative_deviation'"),
        ("value: 12,", "value: 0,", "16:57: the prior's 'value' is 0, of which no deviation is a part"),
        (
            "start: 10, true",
            "start: 10, std: 1, true",
            "16:7: 'std' belongs beside 'value'; of an unknown parameter write prior: {value: …, std: …}",
        ),
        ("scale: linear", "scale: lin", "17:33: 'scale' cannot be 'lin'; it is one of log, linear"),
        # numbers of parameters that are not known themselves
        (
            "min: 1,",
            "min: s,",
            "16:35: 'min' of 'kb' depends on 's', which is not known itself; write a number",
        ),
        ("min: 1,", "min: kb,", "16:35: 'min' of 'kb' depends on 'kb' itself; write a number"),
        ("start: 10", "start: m", "16:15: 'start' of 'kb' depends on 'm', which is not known itself"),
        ("value: 12", "value: s", "16:65: 'value' of 'kb' depends on 's', which is not known itself"),
        # what nothing depends on
        ("offset: b, ", "", "18:3: nothing depends on this unknown parameter"),
        # places without unknowns
        ("frequency: 3", "frequency: s", "7:45: this depends on 's', unknown or known with uncertainty"),
        ("step: 0.01", "step: s/100", "9:9: this depends on 's', unknown or known with uncertainty"),
        ("noise_ratio: 0.05", "noise_ratio: m", "12:27: this depends on 'm', unknown or known with"),
        ("{start: 1, true: 2}", "{start: kb, true: 2}", "6:39: this depends on 'kb', unknown or known"),
        ("{start: 1, true: 2}", "{start: 1, true: 2, max: 9*s}", "6:56: this depends on 's', unknown"),
        (
            "k: kb,",
            "k: {start: 1, true: 1, matrix: [[kb, 0], [0, 1]]},",
            "6:24: the 'matrix' beside 'start' is",
        ),
        ("k: kb,", "k: [[kb, -kb], [-10, kb]],", "6:24: a joint's matrix is symmetric for all values"),
        # channels and signals
        ("gain: -1", "gain: 0", "11:14: the 'gain' is 0, and the channel would show nothing"),
        ("gain: s", "gain: 0", "7:54: the 'gain' is 0, and the signal would drive nothing"),
        (
            "unit: m/s",
            "unit: kg",
            "11:14: the unit kg does not fit: the velocity of this channel is in m/s or rad/s. Units",
        ),
        ("quantity: velocity, ", "", "11:14: a sensor needs its 'quantity': displacement, velocity or"),
        (
            "dof: 2, quantity: velocity, gain: -1, offset: b, unit: m/s",
            "output: j.f, offset: b",
            "11:15: a structure has DOFs, not outputs of nodes",
        ),
        # records
        ("true: 0.5", "min: -1", "18:3: a simulated measurement needs the 'true' value of this parameter"),
    ],
)
def test_one_mistake_is_one_sentence_at_its_place(right, wrong, fault):
    assert right in CHAIN
    found = faults_of(CHAIN.replace(right, wrong, 1))
    assert found, "no fault"
    assert found[0].startswith(fault), found


def test_unknown_parameters_alone_are_something_to_identify():
    known = CHAIN.replace("c: {start: 1, true: 2}", "c: 2")
    assert faults_of(known) == []
    for name in ("kb", "s", "b", "t"):
        known = re.sub(rf"\n  {name}: .*", f"\n  {name}: 1", known)
    assert faults_of(known) == ["8:1: there is nothing to identify: no parameter has a 'start'"]


@pytest.mark.thorough
def test_definitions_that_form_a_cycle_through_mappings_are_refused_in_short_messages():
    names = [f"p{k}" for k in range(1000)]
    entries = "".join(
        f"  {one}: {{start: {other}, true: {other}}}\n"
        for one, other in zip(names, [*names[1:], "p0"], strict=True)
    )
    found = faults_of(CHAIN + entries)
    assert len(found) == len(names)
    assert all("is defined by itself: " in fault and len(fault) < 200 for fault in found)


def test_what_depends_on_a_faulty_parameter_is_not_reported_as_well():
    text = CHAIN.replace("  n: 2\n", "  n: 1/0\n")
    assert [fault.split(":", 2)[:2] for fault in faults_of(text)] == [["14", "6"]]


def test_a_graph_stands_in_the_place_of_a_structure():
    model = check(GRAPH).model
    assert model.graph.nodes["mass"].value.real.names == {"m"}
    assert [str(channel.output) for channel in model.measurement.channels] == ["mass.f", "spring.q"]
    assert model.initial["mass"].f.value == Fraction(1, 10)
    assert [one.scale for one in unknown_parameters(model)] == ["log", "log", "linear"]


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("source: v", "source: w", "13:23: no node 'w'"),
        ("source: v", "source: mass", "13:23: 'mass' is no source (Se, Sf)"),
        ("source: v, ", "", "13:14: this signal needs the 'source' that it drives"),
        ("source: v", "dof: 1", "13:15: 'dof' belongs to structures; a graph has sources"),
        ("output: mass.f", "output: mess.f", "17:23: 'mess.f': no node 'mess'; did you mean 'mass'?"),
        ("output: mass.f", "output: mass.x", "17:23: 'mass.x': 'x' is not one of e, f, q, p"),
        ("output: mass.f", "dof: 1, quantity: velocity", "17:15: 'dof' belongs to structures; a graph has"),
        (
            "output: mass.f",
            "output: mass.f, quantity: velocity",
            "17:14: an 'output' of a graph stands alone",
        ),
        ("{output: spring.q}", "{output: spring.q, unit: foo}", "17:66: 'foo' is no unit"),
        (
            "parameters:",
            "analysis: {modes: {count: 1}}\nparameters:",
            "1:1: this analysis is that of a structure; of a graph it has 'outputs' such as J.f",
        ),
        ("zero -> one, one -> mass", "side -> one", "10:5: I 'mass' has no bond; connect it or drop it"),
        ("value: m}", "value: mm}", "10:28: no parameter 'mm'; did you mean 'm'?"),
        ("mass: {f: 0.1}", "mass: {e: 0.1}", "19:17: the energy of I 'mass' is given by its flow f"),
        ("mass: {f: 0.1}", "damper: {f: 0.1}", "19:11: 'damper' is R and stores no energy"),
        ("graph:", "joints: {a: {dofs: [1], k: 1}}\ngraph:", "3:1: a graph has no joints"),
        ("graph:", "reduction: {method: guyan, masters: [1]}\ngraph:", "3:1: a graph is not reduced"),
        ("true: 2}", "min: 0.1}", "22:3: a simulated measurement needs the 'true' value"),
    ],
)
def test_faults_of_graphs_are_located(right, wrong, fault):
    assert right in GRAPH
    found = faults_of(GRAPH.replace(right, wrong, 1))
    assert found, "no fault"
    assert found[0].startswith(fault), found


def test_a_scene_has_a_structure_or_a_graph():
    neither = GRAPH[: GRAPH.index("graph:")] + GRAPH[GRAPH.index("excitation:") :]
    assert any("either a 'structure', or 'structures', or a 'graph'" in fault for fault in faults_of(neither))
    both = GRAPH.replace("graph:", "structure: {lumped: {masses: [1]}}\ngraph:")
    assert any("either a 'structure', or 'structures', or a 'graph'" in fault for fault in faults_of(both))


@pytest.mark.parametrize("every", [8, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("text", [CHAIN, GRAPH], ids=["chain", "graph"])
def test_any_wrong_value_is_a_located_sentence_or_harmless(text, every):
    data = parse_source(text).data
    for number, path in enumerate(paths_in(data)):
        if path[:1] not in [("parameters",), ("excitation",), ("initial",)] and "channels" not in path:
            continue
        values = [*WRONG[::2], {"start": "m"}, {"start": 1}, {"value": 1, "std": "m"}, "m"]
        for wrong in values[number % every :: every]:
            written = dump(replaced(data, path, wrong))
            for fault in faults_of(written):
                line, column, message = fault.split(":", 2)
                assert 1 <= int(line) <= written.count("\n") + 1
                assert int(column) >= 1
                assert not NOT_A_SENTENCE.search(message), fault
