"""What keys allow one by one and not together: loops, laws, steady states that nothing answers."""

import pytest

import dynid
from dynid.result import Selection
from dynid.scene.kinds.identification import estimates_alone, interest_of
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source
from tests.scene.example_scenes import faults_of

GRAPH = """dynid: 1
kind: KIND
graph:
  nodes: {F: Se, v: 1, m: {type: I, value: 1}, b: {type: R, value: 1}, k: {type: C, value: 0.1}LINE}
  bonds: [F -> v -> m, v -> b, v -> kENDS]
CONTROL
"""
LIMITED = "{from: k.q, to: F, controller: {gain: 2, limits: {min: -1, max: 1}}, setpoint: r}"
FAST = "{from: m.f, to: F, controller: {gain: 1, sample: 0.1}}"
SLOW = "{from: k.q, to: F, controller: {gain: 1, sample: 0.2}, setpoint: r}"
ASKED = "analysis: {inputs: [r], outputs: [m.f], results: [time_response], time: {stop: 1, step: 0.1}}"
MEASURED = "measurement: {step: 0.1, samples: 20, channels: [{output: m.f}], simulate: {seed: 1}}"
STRUCTURE = """dynid: 1
kind: identification
structure: {lumped: {masses: [1, 0.5], links: [{dofs: [1], k: 2.0e4, c: 4}]}}
joints: {bolt: {dofs: [1, 2], k: {start: 8.0e3}, c: 1LAWS}}
"""
STEADY = "responses: {harmonic_balance: {dof: 2, amplitude: 4, start: START, stop: STOP, unit: Hz}}\n"
PORT = "analysis: {inputs: [r], outputs: [m.f], results: [properties], port: v -> m}"
LATE = "{from: k.q, to: F, controller: {gain: 1, delay: 0.1}, setpoint: r}"
LATER = "samples: 20, channels: [{output: m.f}], simulate: {seed: 2}"
HELD_OUT = f"seed: 1}}, held_out: [{{{LATER}}}]"
FUNCTIONS = """measurement:
  channels: [{dof: 2, quantity: acceleration, reference: {dof: 2}}]
  frf: {simulate: {lines: {start: 1, stop: 40, points: 40, unit: Hz}}}
"""
STEADY_HZ = STEADY.replace("START", "1").replace("STOP", "2")


def graph(control, kind="bond-graph", line="", ends="", more=""):
    text = GRAPH.replace("KIND", kind).replace("LINE", line).replace("ENDS", ends)
    return text.replace("CONTROL", control) + more + "\n"


def run(text):
    return dynid.run(check_source(parse_source(text, "s.yaml")))


def steady(start, stop, laws=""):
    return STRUCTURE.replace("LAWS", laws) + STEADY.replace("START", str(start)).replace("STOP", str(stop))


IDENTIFIED = "excitation: [{source: F, kind: sine, amplitude: 1, frequency: 1}]\n" + MEASURED


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (graph(f"control: {{loops: [{LIMITED}]}}", "identification", more=IDENTIFIED), "is not identified"),
        (
            graph(
                "control: {lqr: {states: [m.f, k.q], weights: {m.f: 1, F: 1}}}", "identification",
                more=IDENTIFIED,
            ),
            "gains are designed for a graph of fixed values",
        ),
        (
            graph(f"control: {{loops: [{LIMITED}, {FAST}]}}", more=ASKED),
            "beside sampled ones has no 'limits'",
        ),
        (
            graph(
                f"control: {{loops: [{FAST}, {SLOW}]}}",
                line=", line: {type: TL, impedance: 1, delay: 0.1}, e: {type: R, value: 1}",
                ends=", v -> line -> e",
                more=ASKED,
            ),
            "there are no lines (TL) with several sample times",
        ),
        (
            graph(
                f"control: {{loops: [{LIMITED}]}}",
                line=", line: {type: TL, impedance: 1, delay: 0.1}, e: {type: R, value: 1}",
                ends=", v -> line -> e",
                more=ASKED,
            ),
            "the response of controllers with 'limits' is not computed with a line",
        ),
        (
            graph("estimator: {laws: [linear, cubic]}", "identification", more=IDENTIFIED),
            "the 'laws' of an estimator are of joints",
        ),
        (
            graph("", "identification", more=f"{IDENTIFIED}\n{STEADY_HZ}"),
            "'responses' are of a structure, not of a graph",
        ),
        (
            graph("", "identification", more=IDENTIFIED.replace("seed: 1}", HELD_OUT)),
            "records are 'held_out' of a structure",
        ),
        (
            STRUCTURE.replace("LAWS", "") + "estimator: {laws: [linear, cubic]}\n" + FUNCTIONS,
            "frequency responses and modes are linear",
        ),
        (
            STRUCTURE.replace("LAWS", "") + STEADY_HZ,
            "no joint has nonlinear 'laws': the steady state under a sine is the frequency response",
        ),
        (
            graph(f"control: {{loops: [{LATE}]}}", more=PORT),
            "there is no 'port' where a loop has a delay",
        ),
    ],
)  # fmt: skip
def test_what_nothing_answers_is_refused_where_it_stands(text, message):
    faults = faults_of(text)
    assert any(message in fault for fault in faults), faults


def test_a_curve_without_its_peak_has_no_backbone_and_says_so():
    result = run(steady(30, 26, ", laws: [{kind: cubic, k3: 6.0e8}]"))
    assert "response/backbone/omega" not in result
    assert "no backbone" in result.group_attrs["response/harmonic_balance"]["note"]


def test_what_a_basis_has_to_show_is_also_the_response_that_is_asked():
    asked = "analysis: {inputs: [1], outputs: [{dof: 1}], frequency: {start: 1, stop: 900, points: 9}}\n"
    recorded = RECORDED.replace("LAWS", "").replace("NOISE", "")
    alone, both = (check_source(parse_source(text, "s.yaml")) for text in (recorded, recorded + asked))
    assert interest_of(alone).dofs == (2,)
    assert interest_of(both).dofs == (2, 1)
    assert interest_of(both).band == interest_of(alone).band  # that of the record
    sample = Selection("identification", ["identification/parameters/estimate"])
    assert estimates_alone(alone.model, sample)
    assert not estimates_alone(both.model, sample)


def test_steady_states_of_a_reduced_structure_keep_their_band():
    beam = """dynid: 1
kind: identification
structure: {beam: {elements: 6, length: 1, EI: 500, rhoA: 3, supports: [{node: 1, fix: [w, theta]}], damping: {alpha: 1}}}
joints: {tip: {dofs: [w_7], laws: [{kind: cubic, k3: 1.0e6}]}}
reduction: {method: joint-aware}
responses: {harmonic_balance: {dof: w_7, amplitude: 1, start: 6, stop: 10, unit: Hz, stability: false}}
"""  # noqa: E501
    whole = "".join(line for line in beam.splitlines(keepends=True) if not line.startswith("reduction"))
    reduced, full = (run(text)["response/harmonic_balance/amplitude"].data.max() for text in (beam, whole))
    assert reduced == pytest.approx(full, rel=1e-3)


RECORD = """measurement:
  step: 0.1
  samples: 60
  channels: [{dof: 2, quantity: velocity}]
  NOISE
  simulate: {seed: 1}
"""
RECORDED = STRUCTURE.replace("start: 8.0e3", "start: 8.0e3, true: 8.0e3") + RECORD
NO_PORT = ASKED.replace("results: [time_response]", "results: [properties], port: PORT").replace(
    ", time: {stop: 1, step: 0.1}", ""
)


@pytest.mark.parametrize(
    ("text", "old", "new", "message"),
    [
        (
            RECORDED,
            "NOISE",
            "noise: {kind: coloured, order: 0}",
            "'order' is a whole number from 1 to 200, or auto",
        ),
        (RECORDED, "NOISE", "noise: {kind: coloured, ratio: 0.1}", "'ratio' is that of proportional noise"),
        (RECORDED, "NOISE", "noise: {kind: proportional, ratio: 0.1}", "has no lines to be proportional to"),
        (RECORDED, "NOISE", "noise: {kind: coloured, order: 30}", "coloured noise of order 30 needs"),
        (RECORDED, "{seed: 1}", "{seed: 1, noise_colour: [0.5, 1.2]}", "is not stationary"),
        (RECORDED, "{seed: 1}", "{seed: 1, model: reduced}", "but there is no 'reduction'"),
        (RECORDED, "c: 1LAWS", "c: {matrix: [[1, 0]]}", "a joint's matrix is square; row 1 has 2 entries"),
        (
            RECORDED,
            "k: {start: 8.0e3, true: 8.0e3}",
            "k: {start: 1, matrix: [[0, 0], [0, 0]]}",
            "there is nothing to identify",
        ),
        (RECORDED + "estimator: {laws: [linear]}\n", "", "", "name two or more"),
        (RECORDED + "estimator: {laws: [cubic, cubic]}\n", "", "", "'laws' names a law twice"),
        (
            RECORDED + "estimator: {laws: [linear, cubic], loss: huber}\n",
            "",
            "",
            "which the loss 'huber' has not",
        ),
        (RECORDED + "estimator: {laws: [linear, power]}\n", "", "", "'power' needs more than its kind"),
        (
            RECORDED + "accuracy: {alternatives: {engine: [float]}}\n",
            "",
            "",
            "'engine' is no choice of a run",
        ),
        (RECORDED + "accuracy: {alternatives: {modes: [magic]}}\n", "", "", "'magic'"),
        (STRUCTURE + FUNCTIONS + "  held_out: [{samples: 20}]\n", "", "", "'held_out' are records of time"),
        (graph("", more=NO_PORT), "PORT", "v", "a port is one bond of the graph"),
        (graph("", more=NO_PORT), "PORT", "v -> x", "x"),
        (
            graph(
                f"control: {{loops: [{LIMITED}]}}",
                line=", line: {type: TL, impedance: 1, delay: 0.1}, e: {type: R, value: 1}",
                ends=", v -> line -> e",
                more=ASKED.replace("[time_response]", "[poles, time_response]"),
            ),
            "",
            "",
            "the response of controllers with 'limits' is not computed with a line",
        ),
        (
            graph(
                "control: {lqr: {states: [m.f, k.q], weights: {m.f: 1, F: 1}, setpoints: {k.q: [1]}}}",
                more=ASKED.replace("[r]", "[F]"),
            ),
            "",
            "",
            "",
        ),
    ],
)
def test_what_makes_no_sense_in_its_place_is_refused(text, old, new, message):
    assert old in text
    text = text.replace(old, new) if old else text
    faults = faults_of(text.replace("LAWS", "").replace("  NOISE\n", ""))
    assert any(message in fault for fault in faults), faults
