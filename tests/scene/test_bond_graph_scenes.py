"""Scenes of kind bond-graph: what is refused, where, and in which words."""

from itertools import pairwise

import numpy as np
import pytest
from pydantic import ValidationError

from dynid.errors import NumericalError, UsageError
from dynid.scene.kinds.bond_graph import built_graph
from dynid.scene.kinds.signals import angular_frequencies
from dynid.scene.load import check_source
from dynid.scene.run import run_scene
from dynid.scene.schema.bond_graph import GraphModel
from dynid.scene.schema.quantities import SceneNames
from dynid.scene.yaml.source import parse_source
from tests.scene.example_scenes import check, faults_of
from tests.work import at_most

SCENE = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {F: Se, m: {type: I, value: 2}, k: {type: C, value: 0.1}, n: {type: TF, value: 3}, one: 1, z: 0}
  bonds: [F -> one -> m, one -> n -> z, z -> k]
analysis:
  outputs: [m.f]
  frequency: {start: 1, stop: 10}
  time: {stop: 1, step: 0.1, input: {kind: step}}
"""


def test_the_scene_of_these_tests_is_valid():
    assert faults_of(SCENE) == []


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        # nodes
        ("type: TF", "type: TR", "4:78: unknown node type 'TR'; did you mean 'TF'?"),
        (
            "type: TF",
            "type: L",
            "4:78: unknown node type 'L'; it is one of Se, Sf, I, C, R, TF, GY, 0, 1, TL, structure",
        ),
        ("type: TF", "type: 1.5", "4:78: a node type is one of Se, Sf, I, C, R, TF, GY, 0, 1, TL, structure"),
        (", value: 3", "", "4:71: TF needs its modulus n: write {type: TF, value: …}"),
        ("value: 3", "value: 0", "4:71: the modulus of a TF cannot be zero"),
        (", value: 2", "", "4:21: I needs its value: write {type: I, value: …}"),
        ("value: 2", "value: on", "4:38: no parameter 'on'"),
        ("value: 2", "value: .nan", "4:38: nan is not a finite number"),
        ("value: 2", "value: -.inf", "4:38: -inf is not a finite number"),
        ("F: Se", "F: {type: Se, value: 3}", "4:14: Se takes no value"),
        ("one: 1", "one: {type: 1, value: 3}", "4:98: a junction takes no value"),
        ("value: 3", "valeu: 3", "4:82: 'valeu' is not a key of graph.nodes.n; did you mean 'value'?"),
        ("F: Se", "F: Se, F: Sf", "4:18: the key 'F' is given twice, first on line 4"),
        ("one: 1", "one: 1, 7: 0, '7': 1", "4:107: the key '7' is given twice, first on line 4"),
        ("value: 3", "value: 3, domain: thermal", "4:71: a TF joins two domains; give 'domain' to the nodes"),
        ("F: Se", "F: {type: Se, domain: hydraulics}", "4:33: 'domain' cannot be 'hydraulics'; it is one of"),
        # what drives
        ("{kind: step}", "{kind: step, motion: velocity}", "9:50: 'motion' belongs to structures; a flow"),
        ("{kind: step}", "{kind: step, base: velocity}", "9:50: 'base' belongs to structures; a flow"),
        # bonds
        ("z -> k", "z -> K", "5:41: bond 'z -> K': no node 'K'; did you mean 'k'?"),
        (
            "z -> k",
            "'z -> k, z -> q'",
            "5:41: bond 'z -> k, z -> q': an entry holds one chain; write an entry for each: "
            "- z -> k and - z -> q",
        ),
        (
            "z -> k",
            "'n -> z -> k; q'",
            "5:41: bond 'n -> z -> k; q': an entry holds one chain; write an entry for each: "
            "- n -> z -> k and - z -> q",
        ),
        ("z -> k", "z > k", "5:41: 'z > k' is not a bond; write 'a -> b', or a chain 'a -> b -> c'"),
        ("z -> k", "z -> k ->", "5:41: 'z -> k ->' is not a bond; write 'a -> b', or a chain"),
        ("z -> k", "[z, k]", "5:41: a bond is a text such as 'a -> b'"),
        ("z -> k", "z -> k, k -> one", "4:42: C 'k' has 2 bonds but only one port; put a junction"),
        ("z -> k", "z -> k, z -> z", "5:49: the bond 'z -> z' ends where it starts"),
        ("n -> z", "n, z -> n", "4:68: TF 'n' needs one bond in and one bond out; it has 2 in and 0 out"),
        (", z -> k", "", "4:42: C 'k' has no bond; connect it or drop it"),
        # analysis
        ("m.f", "n.f", "7:13: 'n.f': TF 'n' has two ports; name the junction or element beside it"),
        ("m.f", "one.e", "7:13: 'one.e': a 1-junction has one flow only; ask for 'one.f' or an element's"),
        ("m.f", "z.q", "7:13: 'z.q': a 0-junction has one effort only; ask for 'z.e' or an element's"),
        ("m.f", "m.v", "7:13: 'm.v': 'v' is not one of e, f, q, p"),
        ("m.f", "m", "7:13: an output is NODE.e, NODE.f, NODE.q or NODE.p, not 'm'"),
        ("m.f", "mm.f", "7:13: 'mm.f': no node 'mm'; did you mean 'm'?"),
        ("m.f", "m.f, m.f", "7:12: 'm.f' is listed twice"),
        ("[m.f]", "[]", "7:12: 'outputs' is empty"),
        (
            "analysis:",
            "analysis:\n  inputs: [m]",
            "7:12: 'm' is no source (Se, Sf); only sources can be inputs",
        ),
        ("analysis:", "analysis:\n  inputs: [f]", "7:12: no node 'f'; did you mean 'F'?"),
        ("analysis:", "analysis:\n  inputs: F", "7:11: 'inputs' must be a list, not 'F'"),
        ("analysis:", "analysis:\n  results: [zero]", "7:13: this entry cannot be 'zero'; it is one of"),
        # grids
        ("start: 1", "start: 0", "8:14: a logarithmic scale cannot start at 0; start above it, or set"),
        ("start: 1", "start: -1", "8:22: -1 is negative"),
        ("stop: 10", "stop: 0.5", "8:14: 'stop' is below 'start'"),
        ("stop: 10", "stop: 10, points: 1e12", "8:43: 'points' must be a whole number, not 1000000000000.0"),
        ("stop: 10", f"stop: 10, points: 1{'0' * 12}", "8:43: 'points' must be at most 10,000,000, not"),
        ("stop: 10", "stop: 10, points: 0", "8:43: 'points' must be at least 1, not 0"),
        ("stop: 10", "stop: 10, unit: hz", "8:41: 'unit' cannot be 'hz'; it is one of rad/s, Hz; did you"),
        ("step: 0.1", "step: 2", "9:9: 'step' is longer than 'stop'"),
        ("step: 0.1", "step: 1e-12", "9:9: 1e+12 time steps are too many; 'step' is too short, or"),
        ("step: 0.1", "step: 0", "9:25: 0 is not positive"),
        # signals
        ("kind: step", "kind: stp", "9:44: 'kind' cannot be 'stp'; it is one of step, impulse, sine,"),
        (
            "kind: step",
            "knid: step",
            "9:38: 'knid' is not a key of analysis.time.input; did you mean 'kind'?",
        ),
        ("kind: step", "amplitude: 1", "9:30: analysis.time.input needs the key 'kind'"),
        ("kind: step", "kind: sine", "9:30: analysis.time.input needs the key 'frequency'"),
        ("kind: step", "kind: impact", "9:30: analysis.time.input needs the key 'duration'"),
        ("kind: step", "kind: chirp, start: 0", "9:30: analysis.time.input needs the key 'stop'"),
        ("kind: step", "kind: file", "9:30: analysis.time.input needs the key 'path'"),
        ("kind: step", "kind: file, path: f.csv, column: 0", "9:71: 'column' must be at least 1, not 0"),
        ("kind: step", "kind: step, unit: Hz", "9:50: 'unit' is not a key of analysis.time.input"),
        ("kind: step", "kind: impulse, unit: Hz", "9:53: 'unit' is not a key of analysis.time.input"),
        ("kind: step", "kind: impact, duration: 1, unit: Hz", "9:65: 'unit' is not a key of analysis.time"),
        ("kind: step", "kind: file, path: f.csv, unit: hZ", "9:69: 'hZ' is no unit; did you mean Hz?"),
        ("kind: step", "kind: step, frequency: 1", "9:50: 'frequency' is not a key of analysis.time.input"),
        ("kind: step", "kind: step, source: G", "9:58: 'G' is not an input"),
        ("kind: step", "kind: step, source: m", "9:58: 'm' is not an input"),
        ("kind: step", "kind: step, dof: 1", "9:50: a bond graph has sources, not DOFs"),
        (
            "kind: step",
            "kind: random, band: [2, 1]",
            "9:58: a band is [low, high], and low is not below high",
        ),
        ("kind: step", "kind: random, band: [2]", "9:58: 'band' has 1 entries; it takes at least 2"),
        (
            "kind: step",
            "kind: multisine, amplitude: [1, 2], frequency: [3]",
            "9:37: 'amplitude', 'frequency' and 'phase' of a multisine differ in length",
        ),
        # what is expected
        (
            "analysis:",
            "expect: [{path: a, value: 1, atol: true}]\nanalysis:",
            "6:36: 'atol' must be a number, not true",
        ),
        # stored energy
        (
            "analysis:",
            "initial: {F: {f: 1}}\nanalysis:",
            "6:11: 'F' is Se and stores no energy; only I and C do",
        ),
        ("analysis:", "initial: {M: {f: 1}}\nanalysis:", "6:11: no node 'M'; did you mean 'm'?"),
        ("analysis:", "initial: {m: {e: 1}}\nanalysis:", "6:14: the energy of I 'm' is given by its flow f"),
        (
            "analysis:",
            "initial: {k: {f: 1}}\nanalysis:",
            "6:14: the energy of C 'k' is given by its effort e",
        ),
        ("analysis:", "initial: {k: {e: }}\nanalysis:", "6:14: the energy of C 'k' is given by its effort e"),
        ("analysis:", "initial: {m: 3}\nanalysis:", "6:14: 'm' must be a mapping, not 3"),
    ],
)
def test_one_mistake_is_one_sentence_at_its_place(right, wrong, fault):
    assert right in SCENE
    found = faults_of(SCENE.replace(right, wrong, 1))
    assert len(found) == 1, found
    assert found[0].startswith(fault), found


def test_two_domains_need_a_two_port_between_them():
    def domains(m, k):
        scene = SCENE.replace("value: 2", f"value: 2, domain: {m}")
        return scene.replace("value: 0.1", f"value: 0.1, domain: {k}")

    assert faults_of(domains("mechanical", "electrical")) == []
    scene = domains("mechanical", "electrical").replace("F: Se", "F: {type: Se, domain: thermal}")
    (fault,) = faults_of(scene)
    assert "'F' is thermal and 'm' mechanical, but no TF or GY stands between them" in fault


def test_domains_are_checked_along_a_long_graph_with_work_that_grows_with_its_length():
    names = [f"j{place}" for place in range(1000)]
    nodes = {name: {"type": place % 2} for place, name in enumerate(names)}
    nodes[names[0]]["domain"], nodes[names[-1]]["domain"] = "thermal", "electrical"
    graph = {"nodes": nodes, "bonds": [f"{one} -> {other}" for one, other in pairwise(names)]}
    types = {name: str(node["type"]) for name, node in nodes.items()}
    message = f"'{names[0]}' is thermal and '{names[-1]}' electrical"
    with pytest.raises(ValidationError, match=message), at_most(calls=120 * len(names)):
        GraphModel.model_validate(graph, context=SceneNames(nodes=types))


def test_a_response_that_is_asked_for_needs_its_block():
    text = SCENE.replace("  frequency: {start: 1, stop: 10}\n", "  results: [frequency_response]\n")
    assert faults_of(text) == ["7:3: 'frequency_response' needs the block 'frequency'"]


@pytest.mark.parametrize(
    ("results", "shown"),
    [
        ("[zeros]", False),
        ("[]", False),
        ("[transfer_function]", True),
        ("[time_response]", True),
        ("[zeros]\n  port: one -> m", True),
    ],
)
def test_stored_energy_that_no_result_shows_is_a_fault(results, shown):
    text = SCENE.replace("analysis:", "initial: {m: {f: 1}}\nanalysis:")
    assert faults_of(text) == []
    assert faults_of(text.replace("  time: {stop: 1, step: 0.1, input: {kind: step}}\n", "")) == []
    fault = "6:1: the initial state shows in a time response, a transfer function or at a port only; "
    fault += "'results' lists neither 'time_response' nor 'transfer_function'"
    found = faults_of(text.replace("outputs:", f"results: {results}\n  outputs:", 1))
    assert found == ([] if shown else [fault])


def test_a_misspelt_time_block_is_the_only_fault_of_stored_energy():
    text = SCENE.replace("analysis:", "initial: {m: {f: 1}}\nanalysis:").replace("  time:", "  tiem:")
    assert faults_of(text) == ["10:3: 'tiem' is not a key of analysis; did you mean 'time'?"]


def test_a_name_that_no_bond_could_write_is_refused():
    found = faults_of(SCENE.replace("F: Se", "a b: Se, F: Se"))
    assert found[0] == (
        "4:11: 'a b' cannot name a node; use letters, digits, _ and -, starting with a letter"
    )


def test_an_unreadable_bond_hides_no_other_mistake():
    text = SCENE.replace("z -> k", "z -> q, k -> z, k -> one")
    assert [fault.split(": ", 1)[0] for fault in faults_of(text)] == ["4:42", "5:41"]


def test_hertz_are_converted():
    model = check(SCENE.replace("stop: 10}", "stop: 10, points: 3, unit: Hz}")).model
    assert np.allclose(angular_frequencies(model.analysis.frequency), 2 * np.pi * np.array([1, 10**0.5, 10]))
    plain = check(SCENE.replace("stop: 10}", "stop: 10, points: 2, scale: linear}")).model
    assert angular_frequencies(plain.analysis.frequency).tolist() == [1, 10]


def test_the_frequencies_of_signals_are_converted_too():
    def parameters(signal):
        return (
            check(SCENE.replace("{kind: step}", f"{{{signal}, unit: Hz}}"))
            .model.analysis.time.input[0]
            .parameters()
        )

    assert parameters("kind: sine, frequency: 1, amplitude: 3") == {
        "amplitude": 3,
        "frequency": 2 * np.pi,
        "phase": 0,
    }
    assert parameters("kind: multisine, amplitude: [1, 1], frequency: [1, 2]")["frequency"] == (
        2 * np.pi,
        4 * np.pi,
    )
    assert parameters("kind: chirp, start: 1, stop: 2") == {
        "amplitude": 1,
        "start": 2 * np.pi,
        "stop": 4 * np.pi,
    }
    assert parameters("kind: random, band: [1, 2]")["band"] == (2 * np.pi, 4 * np.pi)


def test_nodes_may_be_called_like_types_or_numbers():
    text = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {Se: Se, 1: '1', 0: {type: 0}, I: {type: I, value: 2}, on: {type: R, value: 1}}
  bonds: [Se -> 1 -> I, 1 -> 0, 0 -> on]
analysis: {inputs: [Se], outputs: [1.f, 0.e, I.p, on.q], time: {stop: 1, step: 0.1}}
initial: {I: {f: 1}}
"""
    scene = check(text)
    graph = built_graph(scene).graph
    assert [node.type for node in graph.nodes.values()] == ["Se", "1", "0", "I", "R"]
    assert list(map(str, scene.model.analysis.outputs)) == ["1.f", "0.e", "I.p", "on.q"]


def test_values_are_exact_decimals():
    graph = built_graph(check(SCENE.replace("value: 0.1", "value: 1/3 + 0.1"))).graph
    assert graph.value("k") * 30 == 13


def test_sensitivities_by_a_parameter_inside_a_structure_are_refused():
    text = """\
dynid: 1
kind: bond-graph
parameters: {m: 2}
graph:
  nodes:
    s: {type: structure, structure: {lumped: {masses: [m]}}, ports: {a: 1}}
    F: Se
    one: 1
    r: {type: R, value: 1}
  bonds: [F -> one -> s.a, one -> r]
analysis: {outputs: [r.f], results: [sensitivities]}
"""
    with pytest.raises(UsageError, match="by single values, but 's' depends on m"):
        run_scene(check(text))


RUNAWAY = """\
dynid: 1
kind: bond-graph
graph:
  nodes: {u: Se, j: 1, m: {type: I, value: 1}, b: {type: R, value: -800}}
  bonds: [u -> j -> m, j -> b]
analysis:
  inputs: [u]
  outputs: [m.f]
  results: [time_response]
  time: {stop: 2, step: 0.1, input: {kind: step}}
"""


def test_a_response_that_grows_beyond_double_precision_is_refused_at_its_time():
    loaded = check_source(parse_source(RUNAWAY, "scene.yaml"))
    with pytest.raises(NumericalError) as caught:
        run_scene(loaded)
    fault = loaded.locate(caught.value)
    assert (fault.line, fault.column) == (10, 3)
    assert "natural mode at 800 rad/s grows by e^1600 in 2 s: shorten the time" in fault.message
