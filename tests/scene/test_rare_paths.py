"""Rare forms of scenes of identifications: what they do, and faults at their places."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from dynid.errors import DynidError, UsageError
from dynid.scene.explanation import explain
from dynid.scene.kinds.identification import preparation_steps
from dynid.scene.kinds.modes import modal_measurement
from dynid.scene.kinds.parts import structure_of
from dynid.scene.kinds.planning import run_plan
from dynid.scene.load import load_scene
from dynid.scene.run import run_scene
from tests.files.universal_files import function, written

pytestmark = pytest.mark.usefixtures("untried")

DATA = Path(__file__).parents[1] / "data" / "fe"
HEAD = """\
dynid: 1
kind: identification
structure: {lumped: {masses: [1, 2, 1], links: [{dofs: [1], k: 300, c: 2}, {dofs: [2, 3], k: 500}]}}
joints: {link: {dofs: [1, 2], k: {start: 100, true: 200}}}
"""
BEAM = """\
dynid: 1
kind: identification
structure:
  beam: {elements: 4, length: 2, EI: 1723.3, rhoA: 0.1, supports: [{node: 1, fix: [w, theta]}]}
joints: {tip: {dofs: [w_5], k: {start: 1.0e3}}}
"""
FRAME = """\
dynid: 1
kind: identification
structure:
  space_frame: {nodes: [[0, 0, 0], [1, 0, 0]],
                members: [{nodes: [1, 2], EA: 1, EIy: 1, EIz: 1, GJ: 1, rhoA: 1}]}
points: {p: {node: 2}}
joints: {j: {points: [p], k: {x: 1}}}
analysis: {modes: {}}
"""
MEMBER = "{nodes: [1, 2], EA: 1, EIy: 1, EIz: 1, GJ: 1, rhoA: 1, elements: 60000}"


def loaded(tmp_path, text):
    (tmp_path / "x.yaml").write_text(text)
    return load_scene(tmp_path / "x.yaml")


def prepare(scene):
    for step in preparation_steps(scene):
        step()


def fault(tmp_path, text, act=prepare):
    """Return the fault that loading a scene and then preparing it raises, as `line:column: message`."""
    try:
        scene = loaded(tmp_path, text)
    except DynidError as error:
        said = error
    else:
        with pytest.raises(DynidError) as caught:
            act(scene)
        said = scene.locate(caught.value)
    return str(said).replace(f"{tmp_path}/", "").removeprefix("x.yaml:")


def undamped():
    """Return the modes of the scene above with its true joint: frequencies (rad/s), shapes at 1 and 3."""
    K = np.array([[500.0, -200, 0], [-200, 700, -500], [0, -500, 500]])
    root = np.diag(1 / np.sqrt([1.0, 2, 1]))
    values, vectors = np.linalg.eigh(root @ K @ root)
    return np.sqrt(values), (root @ vectors)[[0, 2]]


def listed(*, shape_std=0.02):
    """Return measured modes as a scene lists them."""
    modes = [
        f"{{frequency: {omega}, shape: {{1: {one}, 3: {three}}}, shape_std: {shape_std}}}"
        for omega, (one, three) in zip(undamped()[0], undamped()[1].T, strict=True)
    ]
    return f"measurement: {{modes: {{values: [{', '.join(modes)}]}}}}\n"


@pytest.mark.parametrize("reduction", ["", "reduction: {method: craig-bampton, modes: {count: 1}}\n"])
def test_modes_are_explained_as_the_run_finds_them(tmp_path, reduction):
    scene = loaded(tmp_path, HEAD + listed() + reduction + "identifiability: true\n")
    told = explain(scene)
    assert told.obstacle is None
    assert {fact.topic: fact.text for fact in told.facts}["record"] == "measured modes: 9 values"
    done = run_scene(scene)
    bound = done["identification/identifiability/bound"].data
    np.testing.assert_allclose(told.result["identification/identifiability/bound"].data, bound, rtol=1e-9)
    np.testing.assert_allclose(done["identification/parameters/estimate"].data, [200], rtol=1e-4)
    assert 0 < bound[0] < 20


def test_modes_beside_a_record_are_explained(tmp_path):
    record = (
        "  step: 0.02\n  samples: 100\n  channels: [{dof: 1, quantity: velocity}]\n"
        "  simulate: {noise_ratio: 0.02, seed: 3}\nexcitation: {dof: 1, kind: step}\n"
    )
    modes = "measurement:\n  modes: {values: [{frequency: 9}]}\n"
    told = {fact.topic: fact.text for fact in explain(loaded(tmp_path, HEAD + modes + record)).facts}
    assert told["record"].startswith("measured modes: ")
    assert told["record"].endswith(" with others")


def test_the_scatter_of_a_shape_is_named_by_dof(tmp_path):
    scene = loaded(tmp_path, HEAD + listed(shape_std="{3: 0.5}"))
    std = modal_measurement(scene, scene.model.measurement.modes).shape_std
    np.testing.assert_array_equal(std, [[np.nan] * 3, [0.5] * 3])


def test_numbers_of_dofs_stand_in_a_file_of_their_own(tmp_path):
    omega, shapes = undamped()
    savemat(tmp_path / "survey.mat", {"frequency": omega, "shape": shapes})
    savemat(tmp_path / "place.mat", {"at": [1.0, 3.0]})
    modes = "{file: survey.mat, sensors: {path: place.mat, name: at}}"
    scene = loaded(tmp_path, f"{HEAD}measurement: {{modes: {modes}}}\n")
    assert modal_measurement(scene, scene.model.measurement.modes).dofs == (1, 3)


@pytest.mark.parametrize(
    ("modes", "said"),
    [
        ("{file: s.mat}", "6:11: s.mat does not name the DOFs of its 2 sensors. Name one DOF for each row"),
        ("{file: s.mat, sensors: [1]}", "6:24: s.mat has shapes at 2 sensors, and 1 DOFs are named. Name"),
        (
            "{file: {path: s.mat, modes: [1, 4]}, sensors: [1, 3]}",
            "6:31: s.mat has 3 modes, but mode 4 is asked for",
        ),
        ("{file: zero.csv}", "6:3: measured modes need positive frequencies"),
    ],
)
def test_modes_in_a_file_that_do_not_fit_are_located(tmp_path, modes, said):
    omega, shapes = undamped()
    savemat(tmp_path / "s.mat", {"frequency": omega, "shape": shapes})
    (tmp_path / "zero.csv").write_text("frequency [Hz],1\n0,1\n3,1\n")
    assert fault(tmp_path, f"{HEAD}measurement:\n  modes: {modes}\n").startswith(said)


@pytest.mark.parametrize(
    ("mode", "said"),
    [
        ("{frequency: 3, shape_std: 0.1}", "6:20: 'shape_std' is the scatter of a 'shape'"),
        (
            "{frequency: 3, shape: {1: 1, 3: 1}, shape_std: {1: 0.1, 2: 0.1}}",
            "6:20: 'shape_std' names 2, which the shape does not",
        ),
    ],
)
def test_scatter_of_nothing_is_refused(tmp_path, mode, said):
    text = f"{HEAD}measurement:\n  modes: {{values: [{mode}]}}\n"
    assert fault(tmp_path, text) == said


def test_a_graph_has_no_measured_modes(tmp_path):
    text = (
        "dynid: 1\nkind: identification\nparameters: {k: {start: 3}}\n"
        "graph: {nodes: {F: Se, J: 1, m: {type: I, value: 2}, s: {type: C, value: 1/k}},\n"
        "        bonds: [F -> J, J -> m, J -> s]}\nmeasurement: {modes: {values: [{frequency: 3}]}}\n"
    )
    assert fault(tmp_path, text) == "1:1: measured 'modes' are of a structure, not of a graph"


def test_a_plan_refuses_measured_modes(tmp_path):
    with pytest.raises(UsageError, match="this measurement has modes") as caught:
        run_plan(loaded(tmp_path, HEAD + listed()))
    assert caught.value.names == ("measurement.modes",)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "{node: 2}",
            "{part: arm, node: 2}",
            "6:14: the point 'p' is of the part 'arm', but the scene has a",
        ),
        ("{node: 2}", "{node: 2, weights: [1]}", "6:13: 'weights' are of the 'nodes' of a distributed point"),
        ("{node: 2}", "{nodes: [1, 2], weights: [1]}", "6:13: 'weights' has 1 entry for 2 nodes"),
        (
            "{x: 1}",
            "[[1, 0, 0], [0, -1, 0], [0, 0, 1]]",
            "7:10: a joint's matrix must not be indefinite: its lowest",
        ),
        (
            "{x: 1}",
            "{x: 1}, axes: {x: [1, 0, 0], y: [0, 1, 0], z: [0, 1, 1]}",
            "7:38: the axis z of joint j is not orthogonal to x and y, or points the other way. Leave it out",
        ),
        (
            "{x: 1}",
            "{x: 1}, axes: {x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, -1]}",
            "7:38: the axis z of joint j is not orthogonal to x and y, or points the other way. Leave it out",
        ),
        (
            "points: [p], k: {x: 1}",
            'dofs: ["2:x"], k: {x: 1}',
            "7:13: 'k' has directions, which a joint between 'points' has",
        ),
        (
            "points: [p], k: {x: 1}",
            'dofs: ["2:x"], k: 1, at: [0, 0, 0]',
            "7:13: 'axes' and 'at' are of joints between 'points'",
        ),
        (
            "rhoA: 1}",
            f"rhoA: 1, elements: 60000}}, {MEMBER}",
            "5:26: the members have more than 100,000 elements together",
        ),
    ],
)
def test_points_and_their_joints_are_refused(tmp_path, old, new, said):
    assert old in FRAME
    assert fault(tmp_path, FRAME.replace(old, new)).startswith(said)


@pytest.mark.parametrize(
    "axes",
    ["x: [1, 1, 0], y: [0, 1, 0], z: [0, 0, 7]", "x: [1e90, 1e90, 0], y: [0, 1e-200, 0], z: [0, 0, 1e-200]"],
)
def test_axes_are_directions_of_any_length_and_a_third_that_agrees_changes_nothing(tmp_path, axes):
    two, three = (
        structure_of(loaded(tmp_path, FRAME.replace("{x: 1}", f"{{x: 1}}, axes: {{{each}}}"))).with_joints()[
            2
        ]
        for each in ("x: [1, 1, 0], y: [0, 1, 0]", axes)
    )
    np.testing.assert_array_equal(two, three)


def test_a_reduction_has_no_joints_between_points(tmp_path):
    text = (
        "dynid: 1\nkind: reduction\nstructure: {lumped: {masses: [1, 2], links: [{dofs: [1], k: 3}]}}\n"
        "joints: {j: {points: [p, q], k: {x: 1}}}\nreduction: [{method: guyan, masters: [1]}]\n"
    )
    said = "4:10: joint j is between points, which a structure has in an identification only. Name DOFs."
    assert fault(tmp_path, text, run_scene) == said


def test_labels_beside_a_model_in_a_file_are_at_fault_themselves(tmp_path):
    text = (
        "dynid: 1\nkind: reduction\nstructure:\n"
        f"  matrices:\n    model: {DATA}/bracket.inp\n    labels: [a]\n"
        "reduction: [{method: guyan, masters: [a]}]\n"
    )
    assert fault(tmp_path, text, run_scene) == "6:5: 1 DOF label for 33 DOFs"


def test_lines_in_a_unit_that_contradicts_the_file_are_refused(tmp_path):
    (tmp_path / "h.csv").write_text("frequency [m],a re,a im\n1,1,0\n2,1,0\n")
    text = (
        "measurement:\n  channels: [{dof: 1, quantity: acceleration, reference: {dof: 2}}]\n"
        "  frf: {file: {path: h.csv}, unit: Hz}\n"
    )
    said = fault(tmp_path, HEAD + text)
    assert (
        said
        == "7:30: 'unit' is Hz, but the file has 'frequency' in m. Leave 'unit' out, or correct the heading."
    )


def test_match_is_not_of_a_record_that_lists_its_channels(tmp_path):
    written(tmp_path / "a.uff", function(np.zeros(8), response=(3, 2)))
    own = "{channels: [{dof: w_5, quantity: velocity}], match: {}, file: {path: b.csv}, step: 1, samples: 8}"
    text = f"{BEAM}measurement:\n  channels: all\n  records: [{{file: {{path: a.uff}}}}, {own}]\n"
    said = "7:3: 'match' goes with 'channels: all'; these channels name their DOFs"
    assert fault(tmp_path, text) == said


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("file: {path: a.uff, columns: [b]}", "8:23: a.uff has no time history 'b', of 2. Give its"),
        ("file: {path: a.uff, columns: [a]}", "8:23: a.uff has 2 time histories 'a', of 2. Give its"),
        (
            "file: {path: a.uff, columns: [1]}\n  match: {by: position, tolerance: 1, geometry: nodes.csv}",
            "9:39: nodes.csv:1: the columns are node, x.",
        ),
        ("file: {path: uneven.uff}", "8:10: uneven.uff: row 4: the time goes on by 2.4 s here, 1 s a row"),
    ],
)
def test_what_a_universal_file_lacks_is_located(tmp_path, more, said):
    even = [function(np.zeros(8), response=(node, 2), id1="a") for node in (3, 4)]
    written(tmp_path / "a.uff", *even)
    times = np.array([0.0, 1, 2, 4.4, 5, 6, 7, 8])
    written(tmp_path / "uneven.uff", {**even[0], "x": times, "abscissa_spacing": 0})
    (tmp_path / "nodes.csv").write_text("node,x\n1,1\n")
    assert fault(tmp_path, f"{BEAM}measurement:\n  channels: all\n  {more}\n").startswith(said)


def test_step_and_samples_of_the_scene_come_before_those_of_a_file(tmp_path):
    written(tmp_path / "a.uff", function(np.zeros(8), response=(3, 2)))
    own = "measurement: {file: {path: a.uff}, channels: all, step: 0.02, samples: 5}\n"
    measurement = loaded(tmp_path, BEAM + own).source.data["measurement"]
    assert (measurement["step"], measurement["samples"]) == (0.02, 5)
