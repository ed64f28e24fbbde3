"""Scenes of kind identification: what is refused, where, and in which words."""

import pytest

from tests.scene.example_scenes import check, faults_of

SCENE = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [2, 1], links: [{dofs: [1], k: 100, c: 1}]}
joints:
  j: {dofs: [1, 2], k: {start: 10, true: 20}, c: {start: 1, true: 2}}
excitation: {dof: 2, kind: sine, frequency: 3}
measurement:
  step: 0.01
  samples: 100
  channels: [{dof: 2, quantity: velocity}]
  simulate: {noise_ratio: 0.05, seed: 1}
"""


def test_the_scene_of_these_tests_is_valid():
    assert faults_of(SCENE) == []


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        # structure
        ("masses: [2, 1]", "masses: [2, -1]", "4:24: -1 is negative"),
        ("masses: [2, 1]", "masses: [2, yes]", "4:24: no parameter 'yes'"),
        ("k: 100", "k: -1", "4:51: -1 is negative"),
        ("k: 100", "kk: 100", "4:48: 'kk' is not a key of structure.lumped.links.0"),
        ("dofs: [1],", "dofs: [3],", "4:44: there is no DOF 3; the structure has 2"),
        ("dofs: [1],", "dofs: [0],", "4:44: this entry must be at least 1, not 0"),
        ("dofs: [1],", "dofs: [1, 1],", "4:43: both ends are DOF 1"),
        ("dofs: [1],", "dofs: [],", "4:43: 'dofs' is empty"),
        ("dofs: [1],", "dofs: [1, 2, 2],", "4:43: 'dofs' has 3 entries; it takes at most 2"),
        ("dofs: [1],", "dofs: 1,", "4:43: 'dofs' must be a list, not 1"),
        ("lumped:", "lumpd:", "4:3: 'lumpd' is not a key of structure; did you mean 'lumped'?"),
        # joints
        ("dofs: [1, 2]", "dofs: [1, 5]", "6:17: there is no DOF 5; the structure has 2"),
        ("dofs: [1, 2]", "dof: [1, 2]", "6:7: 'dof' is not a key of joints.j; did you mean 'dofs'?"),
        ("start: 10, ", "start: 10, value: 3, ", "6:24: a joint parameter has either a 'start' (to be"),
        ("start: 10, true: 20", "true: 20", "6:24: a joint parameter has either a 'start' (to be"),
        ("start: 10, true: 20", "value: 3, true: 20", "6:24: a known parameter has its 'value'; 'true'"),
        ("start: 10", "start: 0", "6:32: 0 is not positive"),
        (", true: 20", "", "6:21: a simulated measurement needs the 'true' value of this parameter"),
        (", true: 20", ", ture: 20", "6:36: 'ture' is not a key of joints.j.k; did you mean 'true'?"),
        ("joints:", "joints:\n  i: {dofs: [1]}", "6:6: a joint has a stiffness 'k', a damping 'c', or both"),
        # excitation
        ("{dof: 2, kind: sine", "{dof: 3, kind: sine", "7:19: there is no DOF 3; the structure has 2"),
        ("{dof: 2, kind: sine", "{kind: sine", "7:1: this signal needs the 'dof' that it drives"),
        ("{dof: 2, kind: sine", "{dof: 2, source: F, kind: sine", "7:22: a structure has DOFs, not sources"),
        (", frequency: 3", "", "7:1: excitation needs the key 'frequency'"),
        # measurement
        ("step: 0.01", "step: 0", "9:9: 0 is not positive"),
        ("samples: 100", "samples: 1e2", "10:12: 'samples' must be a whole number, not 100.0"),
        ("samples: 100", "samples: 0", "10:12: 'samples' must be at least 1, not 0"),
        ("samples: 100", f"samples: 1{'0' * 12}", "10:12: 'samples' must be at most 100,000,000, not"),
        ("[{dof: 2, quantity: velocity}]", "[]", "11:13: 'channels' is empty"),
        ("velocity}]", "velocity}, {quantity: velocity, dof: 2}]", "11:44: this channel is listed twice"),
        ("quantity: velocity", "quantity: speed", "11:33: 'quantity' cannot be 'speed'; it is one of"),
        (
            "quantity: velocity",
            "quantiy: velocity",
            "11:23: 'quantiy' is not a key of measurement.channels.0",
        ),
        ("{dof: 2, quantity", "{dof: two, quantity", "11:20: there is no DOF 'two'; the structure has 2"),
        (
            "{dof: 2, quantity",
            "{dof: 2.0, quantity",
            "11:20: 'dof' must be a whole number or a text, not 2.0",
        ),
        ("{dof: 2, quantity", "{dof: 9, quantity", "11:20: there is no DOF 9; the structure has 2"),
        ("noise_ratio: 0.05", "noise_ratio: -1", "12:27: -1 is negative"),
        ("noise_ratio: 0.05", "noise_ratio: .inf", "12:27: inf is not a finite number"),
        (
            "noise_ratio: 0.05",
            "noise_ration: 0.05",
            "12:14: 'noise_ration' is not a key of measurement.simul",
        ),
        ("seed: 1", "seed: -1", "12:39: 'seed' must be at least 0, not -1"),
        ("simulate:", "file: {path: a.csv}\n  simulate:", "9:3: a measurement is either 'simulate'd or read"),
        (
            "  simulate: {noise_ratio: 0.05, seed: 1}\n",
            "",
            "9:3: a measurement is either 'simulate'd or read",
        ),
        (
            "simulate: {noise_ratio: 0.05, seed: 1}",
            "file: {path: a.csv, columns: [1, 2]}",
            "9:3: 'columns' names 2, but 'channels' has 1",
        ),
        (
            "simulate: {noise_ratio: 0.05, seed: 1}",
            "file: {path: a.csv, columns: [0]}",
            "12:33: this entry must be at least 1, not 0",
        ),
        # the whole
        (
            "k: {start: 10, true: 20}, c: {start: 1, true: 2}",
            "k: 20",
            "8:1: there is nothing to identify: no parameter has a 'start'",
        ),
        (
            "measurement:",
            "estimator: {method: fitler}\nmeasurement:",
            "8:21: 'method' cannot be 'fitler'; it",
        ),
        (
            "measurement:",
            "estimator: {method: output-error, passes: 3}\nmeasurement:",
            "8:12: 'passes' belongs to the methods 'filter' and 'sigma-point', not to 'output-error'",
        ),
        (
            "measurement:",
            "estimator: {method: filter, loss: huber}\nmeasurement:",
            "8:12: the loss 'huber' belongs to the methods auto and output-error; the method",
        ),
        (
            "measurement:",
            "estimator: {loss: huber}\nposterior_check: true\nmeasurement:",
            "1:1: 'posterior_check' needs the likelihood; the loss 'huber' has none",
        ),
        ("measurement:", "analysis: {inputs: [1]}\nmeasurement:", "8:11: an analysis needs a 'frequency', a"),
        (
            "measurement:",
            "plan: {candidates: [{dof: 1, quantity: velocity}], quantities: [velocity]}\nmeasurement:",
            "8:7: 'candidates' name their quantities; 'quantities' are for every DOF without them",
        ),
        (
            "quantity: velocity",
            "quantity: velocity, frame: absolute",
            "11:14: only the acceleration of one DOF is measured absolutely",
        ),
        (
            "measurement:",
            "accuracy: {alternatives: {hold: all}}\nmeasurement:",
            "8:27: nothing in this scene is held: no force is known by samples alone",
        ),
        (
            "measurement:",
            "analysis: {time: {stop: 1, step: 0.1}}\ninitial: {3: {v: 1}}\nmeasurement:",
            "9:11: there is no DOF 3; the structure has 2",
        ),
    ],
)
def test_one_mistake_is_one_sentence_at_its_place(right, wrong, fault):
    assert right in SCENE
    found = faults_of(SCENE.replace(right, wrong, 1))
    assert len(found) == 1, found
    assert found[0].startswith(fault), found


def test_a_scene_without_a_question_is_told_so():
    text = SCENE[: SCENE.index("measurement:")]
    assert faults_of(text) == [
        "1:1: a scene needs a 'measurement' to identify from, an 'analysis', or 'responses'"
    ]


@pytest.mark.parametrize("analysis", ["", "analysis: {frequency: {start: 1, stop: 2}}\n"])
def test_an_initial_motion_that_nothing_shows_is_a_fault(analysis):
    measured = SCENE.replace("simulate: {noise_ratio: 0.05, seed: 1}", "file: {path: record.csv}")
    found = faults_of(measured + analysis + "initial: {1: {x: 1}}\n")
    line = 13 + bool(analysis)
    assert found == [
        f"{line}:1: the initial state shows in a time response or a simulated record only; "
        "it needs the block 'analysis.time'"
    ]
    assert faults_of(measured + "analysis: {time: {stop: 1, step: 0.1}}\ninitial: {1: {x: 1}}\n") == []


RESPONDS = SCENE[: SCENE.index("excitation:")]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (
            "identifiability: true\nanalysis: {modes: {count: 1}}\n",
            "1:1: 'identifiability' is that of a record; there is no 'measurement'",
        ),
        (
            "derived: [poles]\nanalysis: {modes: {count: 1}}\n",
            "1:1: 'derived' follows from an estimate; there is no 'measurement'",
        ),
        (
            "analysis: {frequency: {start: 1, stop: 2}, inputs: [1]}\n",
            "1:1: the analysis needs its 'outputs'; there are no channels to take them from",
        ),
        (
            "analysis: {frequency: {start: 1, stop: 2}, outputs: [{dof: 1}]}\n",
            "1:1: the analysis needs its 'inputs'; there is no excitation to take them from",
        ),
    ],
)
def test_what_an_analysis_takes_from_nowhere_is_asked_for(text, fault):
    assert faults_of(RESPONDS + text) == [fault]


def test_records_of_one_identification_are_of_one_model():
    records = "  records: [{simulate: {model: full}}, {simulate: {model: reduced}}]\n"
    text = SCENE.replace("  step: 0.01\n", f"  step: 0.01\n{records}")
    reduced = "reduction: {method: serep, modes: [1]}\n"
    assert faults_of(text + reduced) == ["1:1: all records are simulated with one 'model': full or reduced"]


@pytest.mark.parametrize(("signal", "propagated"), [("step", True), ("impulse", False)])
def test_the_excitation_of_an_analysis_without_inputs_is_what_is_propagated(signal, propagated):
    further = f"""\
excitation: {{dof: 2, kind: {signal}}}
analysis: {{time: {{stop: 1, step: 0.1}}, outputs: [{{dof: 1}}]}}
accuracy: {{alternatives: {{propagation: all}}}}
"""
    found = faults_of(RESPONDS + further)
    assert len(found) == (not propagated)
    assert all(fault.startswith("9:27: nothing in this scene is propagated") for fault in found)


def test_nothing_is_held_where_nothing_is_measured():
    further = """\
excitation: {dof: 2, kind: random, seed: 1}
analysis: {time: {stop: 1, step: 0.1}, outputs: [{dof: 1}]}
accuracy: {alternatives: {hold: all}}
"""
    assert faults_of(RESPONDS + further) == [
        "9:27: nothing in this scene is held: no force is known by samples alone"
    ]


def test_known_and_unknown_parameters_stand_side_by_side():
    scene = check(SCENE.replace("c: {start: 1, true: 2}", "c: 2"))
    joint = scene.model.joints["j"]
    assert float(joint.k.start) == 10
    assert float(joint.c.value) == 2


def test_quantities_may_be_parameters_everywhere():
    text = SCENE.replace("kind: identification\n", "kind: identification\nparameters: {k: 1e2, h: 1/k}\n")
    scene = check(text.replace("k: 100", "k: k").replace("step: 0.01", "step: h"))
    assert float(scene.model.measurement.step) == 0.01
    assert float(scene.model.structure.lumped.links[0].k) == 100
