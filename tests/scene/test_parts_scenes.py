"""Scenes with several parts, points, and joints between points."""

from __future__ import annotations

import numpy as np
import pytest

import dynid
from dynid.errors import DynidError, SceneError
from dynid.scene.identified import identified_scene
from dynid.scene.kinds.identification import preparation_steps, reductor_of
from dynid.scene.kinds.parts import structure_of
from dynid.scene.load import check_source
from dynid.scene.yaml.source import parse_source

SCENE = """\
dynid: 1
kind: identification
structures:
  arm:
    frame:
      nodes: [[1, 0], [2, 0]]
      members: [{nodes: [1, 2], EA: 1.0e7, EI: 1.0e3, rhoA: 1, elements: 3}]
      damping: {alpha: 0.5}
    reduction: {modes: {count: 4}}
  base:
    beam: {elements: 3, length: 1, EI: 2.0e3, rhoA: 2, supports: [{node: 1, fix: [w, theta]}]}
  post: {lumped: {masses: [2, 1], links: [{dofs: [1, 2], k: 1.0e4, c: 1}, {dofs: [1], k: 3.0e4}]}}
points:
  p: {part: arm, node: 1}
  q: {part: base, node: 4}
joints:
  bolt: {points: [p, q], k: {y: {start: 2.0e4, true: 5.0e4}, rz: {start: 100, true: 300}}, c: {y: 5}}
  strut: {dofs: ["arm.2:x", post.2], k: {start: 1.0e4, true: 2.0e4}, c: 3}
  ground: {points: [p], k: {x: 1.0e5}}
excitation: [{dof: "arm.2:-y", kind: multisine, amplitude: [9, 9, 9, 9], frequency: [3, 9, 20, 40], unit: Hz},
             {dof: post.2, kind: multisine, amplitude: [5, 5], frequency: [5, 15], unit: Hz}]
measurement:
  step: 0.002
  samples: 300
  channels: [{dof: "arm.2:y", quantity: acceleration}, {dof: base.w_3, quantity: acceleration},
             {dof: "p:y", quantity: velocity}, {dofs: [post.1, post.2], quantity: displacement}]
  simulate: {noise_ratio: 0, seed: 1, model: reduced}
"""


def scene(text=SCENE):
    return check_source(parse_source(text, "s.yaml"))


def identified(text):
    return dynid.run(scene(f"{text}derived: []\n"))


def built(text=SCENE):
    return structure_of(scene(text))


def faults_of(text):
    """Return the faults of a scene as `dynid check` reports them."""
    try:
        made = scene(text)
        for step in preparation_steps(made):
            step()
    except SceneError as error:
        return [str(fault).partition(":")[2] for fault in error.faults]
    except DynidError as error:
        return [str(made.locate(error)).partition(":")[2]]
    return []


def test_parts_stand_in_one_structure_under_their_names():
    model = built()
    assert model.size == 12 + 6 + 2
    assert model.dofs[:3] == ("arm.u_1", "arm.w_1", "arm.theta_1")
    assert model.dofs[-2:] == ("post.1", "post.2")
    assert [one.name for one in model.unknowns] == ["bolt.k.y", "bolt.k.rz", "strut.k"]
    assert [one.unit for one in model.unknowns] == ["N/m", "N.m/rad", "N/m"]
    K = model.with_joints(model.true_values())[2] - model.K
    at = {label: place for place, label in enumerate(model.dofs)}
    expected = np.zeros((20, 20))
    for k, ends in (
        (5.0e4, ("arm.w_1", "base.w_4")),
        (300, ("arm.theta_1", "base.theta_4")),
        (2.0e4, ("arm.u_2", "post.2")),
        (1.0e5, ("arm.u_1",)),
    ):
        row = np.zeros(20)
        row[[at[end] for end in ends]] = [1, -1][: len(ends)]
        expected += k * np.outer(row, row)
    np.testing.assert_allclose(K, expected)


@pytest.fixture(scope="module")
def with_modes():
    """The scene, identified, and its modes."""
    text = SCENE.replace("measurement:", "analysis: {modes: {count: 3}}\nmeasurement:")
    result = identified(text)
    result.attrs["scene"] = text
    return result


def test_each_part_is_reduced_by_itself_and_identified(with_modes):
    text = scene()
    made = reductor_of(text).reduce(structure_of(text))
    assert {*made.masters} == {"arm.u_1", "arm.w_1", "arm.theta_1", "arm.u_2", "arm.w_2"}
    assert made.model.size == 5 + 4 + 6 + 2
    np.testing.assert_allclose(with_modes["identification/parameters/error_percent"].data, 0, atol=1e-3)
    assert with_modes.value("identification/diagnostics/converged")


def test_the_identified_scene_of_a_joint_between_points_runs(with_modes):
    again = dynid.run(scene(identified_scene(with_modes)))
    np.testing.assert_allclose(
        again["structure/modes/omega"].data, with_modes["structure/modes/omega"].data, rtol=1e-9
    )


def test_unknown_parameters_stand_in_parts_and_are_shared_by_joints():
    text = SCENE.replace(
        "structures:",
        "parameters: {ei: {start: 900, true: 1000}, s: {start: 1.0e4, true: 5.0e4}}\nstructures:",
    )
    text = text.replace("EI: 1.0e3", "EI: ei").replace("y: {start: 2.0e4, true: 5.0e4}", "y: s")
    text = text.replace("k: {start: 1.0e4, true: 2.0e4}", "k: s*0.4")
    model = built(text)
    assert [one.name for one in model.unknowns] == ["bolt.k.rz", "ei", "s"]
    assert {one.name: one.unit for one in model.unknowns}["s"] == "N/m"
    result = identified(
        text.replace("model: reduced", "model: full").replace("    reduction: {modes: {count: 4}}\n", "")
    )
    np.testing.assert_allclose(result["identification/parameters/error_percent"].data, 0, atol=1e-3)


def test_a_single_structure_has_points_without_part():
    text = """\
dynid: 1
kind: identification
structure:
  space_frame:
    nodes: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]]
    members:
      - {nodes: [1, 2], EA: 1.0e7, EIy: 1.0e3, EIz: 1.0e3, GJ: 1.0e3, rhoA: 1}
      - {nodes: [2, 3], EA: 1.0e7, EIy: 1.0e3, EIz: 1.0e3, GJ: 1.0e3, rhoA: 1}
      - {nodes: [3, 4], EA: 1.0e7, EIy: 1.0e3, EIz: 1.0e3, GJ: 1.0e3, rhoA: 1}
points:
  p: {nodes: [1, 2, 3], weights: [1, 2, 1]}
  q: {node: 4}
joints:
  mount: {points: [p], k: {x: 1.0e4, y: 1.0e4, z: 1.0e4, rx: 100, ry: 100, rz: 100}, c: {x: 1},
          axes: {x: [1, 1, 0], y: [0, 1, 0]}}
  block: {points: [q], k: {value: 2, matrix: [[2, 1, 0], [1, 2, 0], [0, 0, 3]]}, m: 2}
analysis: {modes: {count: 6}, outputs: [{dof: "p:rz"}, {dof: "4:-x"}], inputs: ["q:z"],
           frequency: {start: 1, stop: 10, points: 3}}
"""
    model = built(text)
    rows = np.array([model.row(f"p:{along}") for along in ("x", "y", "z", "rx", "ry", "rz")])
    turned = np.kron(np.eye(2), np.array([[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2))
    K = rows.T @ turned.T @ np.diag([1e4] * 3 + [100] * 3) @ turned @ rows
    q = np.array([model.row(f"4:{along}") for along in "xyz"])
    K += 2 * q.T @ np.array([[2, 1, 0], [1, 2, 0], [0, 0, 3]]) @ q
    M, _, made = model.with_joints()
    np.testing.assert_allclose(made - model.K, K, atol=1e-9)
    np.testing.assert_allclose(M - model.M, 2 * q.T @ q, atol=1e-12)
    result = dynid.run(scene(text))
    assert result["structure/frequency_response/response"].data.shape == (3, 2, 1)
    np.testing.assert_allclose(rows @ model.nodes.rigid(model.dofs)[:, :3], np.eye(6)[:, :3], atol=1e-12)


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("part: arm, node: 1", "part: arn, node: 1", "14:7: the point 'p' is of a part 'arn' that does not"),
        ("part: arm, node: 1", "node: 1", "14:3: the point 'p' needs the 'part' that it is of"),
        ("part: arm, node: 1", "part: arm, node: 9", "14:3: the point 'p' names node arm.9, which does not"),
        ("part: arm, node: 1", "part: arm, set: top", "14:18: the point 'p' names a set 'top' that does not"),
        ("part: arm, node: 1", "part: arm", "14:6: a point is one 'node', several 'nodes', or a 'set'"),
        ("node: 1}\n", "nodes: [1, 2], spread: stiff}\n", "14:41: 'spread' cannot be 'stiff'; it is one of"),
        ("part: arm, node: 1", "part: post, node: 1", "14:3: the point 'p' names node post.1, which"),
        ("points: [p, q]", "points: [p, r]", "17:3: joint bolt names a point 'r' that does not exist"),
        ("points: [p, q]", "points: [p, p]", "17:9: both ends are the point 'p'"),
        ("points: [p, q]", "points: [p, q], dofs: [post.1]", "17:9: a joint is between 'dofs', or between"),
        ("k: {y: {start", "k: {z: {start", "17:3: joint bolt along z: the nodes of the point 'p' do not"),
        ("k: {y: {start", "k: {yy: {start", "17:30: 'yy' cannot be 'yy'; it is one of x, y, z, rx, ry, rz"),
        ("c: {y: 5}", "c: 5", "17:9: a joint between points has its 'c' by direction: c: {x: …, rz: …}"),
        ("c: {y: 5}", "c: {y: 5}, axes: {x: [1, 0, 0], y: [2, 0, 0]}", "17:103: the axes x and y of joint"),
        ("c: {y: 5}", "c: {y: 5}, axes: [[1, 0, 0], [0, 2, 0], [0, 0, 1]]", "17:3: joint bolt has axes that"),
        ("c: {y: 5}", "c: {y: 5}, axes: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "17:3: joint bolt has left"),
        ("c: {y: 5}", "c: [[1, 0], [0, 1]]", "17:9: 'c' is 2 x 2; between points it is 3 x 3 or 6 x 6"),
        ('dof: "arm.2:y"', 'dof: "arm.7:y"', "25:20: there is no DOF 'arm.7:y'; there are DOFs at"),
        ("post.2], k", "pst.2], k", "18:29: there is no DOF 'pst.2'; did you mean 'post.2'"),
        ("reduction: {modes", "reduction: {mdoes", "9:17: 'mdoes' is not a key of structures.arm.reduction"),
        ("{modes: {count: 4}}", "{method: joint-aware}", "5:5: 'joint-aware' is of a whole assembly"),
        ("  base:\n", "  ba.se:\n", "10:3: 'ba.se'"),
        ("node: 1, fix", "node: 9, fix", "11:74: there is no node 9; there are 4"),
        (", true: 300", "", "17:62: a simulated measurement needs the 'true' value of this parameter"),
        ("excitation:", "structure: {lumped: {masses: [1]}}\nexcitation:", "1:1: a scene of this kind has"),
    ],
)  # fmt: skip
def test_one_mistake_is_one_sentence_at_its_place(right, wrong, fault):
    assert right in SCENE
    found = faults_of(SCENE.replace(right, wrong, 1))
    assert len(found) == 1, found
    assert found[0].startswith(fault), found


def test_the_axis_that_nodes_on_a_line_leave_open_is_named():
    found = faults_of(SCENE.replace("node: 4}", "nodes: [1, 4], spread: rigid}"))
    assert (
        found[0].startswith("15:3: the point 'q' has node 4 without DOF base.4:") or "without DOF" in found[0]
    )
    text = """\
dynid: 1
kind: identification
structure:
  space_frame:
    nodes: [[0, 0, 0], [1, 1, 0], [2, 2, 0]]
    members: [{nodes: [1, 3], EA: 1, EIy: 1, EIz: 1, GJ: 1, rhoA: 1, elements: 2},
              {nodes: [1, 2], EA: 1, EIy: 1, EIz: 1, GJ: 1, rhoA: 1}]
points: {p: {nodes: [1, 2, 3]}}
joints: {b: {points: [p], k: {x: 1}}}
analysis: {modes: {}}
"""
    assert faults_of(text) == [
        "8:10: the point 'p' has nodes that do not determine its motion rx: a rotation about "
        "(0.707, 0.707, 0) through (1, 1, 0) moves none of their DOFs. Add a node beside this line, or join "
        "single nodes."
    ]


def test_a_whole_assembly_is_reduced_with_points_as_masters():
    text = SCENE.replace("    reduction: {modes: {count: 4}}\n", "").replace(
        "    beam: {elements: 3", "    beam: {elements: 3"
    )
    text = text.replace("joints:", "reduction: {method: craig-bampton, modes: {count: 8}}\njoints:", 1)
    made = scene(text)
    small = reductor_of(made).reduce(structure_of(made))
    assert small.model.size == 10 + 8
    result = identified(text)
    np.testing.assert_allclose(result["identification/parameters/error_percent"].data, 0, atol=1e-3)


@pytest.mark.thorough
def test_reduced_parts_are_reduced_further_with_the_basis_that_follows_the_joints():
    text = SCENE.replace(
        "joints:", "reduction: {method: joint-aware, modes: {count: 9}, residuals: none}\njoints:", 1
    )
    made = scene(text)
    method = reductor_of(made)
    assert method.follows_joints
    structure = structure_of(made)
    small = method.reduce(structure)
    assert small.model.basis.parent.size == 17  # 5 masters and 4 modes of the arm, 8 DOFs of full parts
    assert small.model.size == 9
    assert method.reduce(structure).model.basis.parent is small.model.basis.parent
    exact = np.linalg.eigvals(np.linalg.solve(*small.model.basis.parent.dense(structure.true_values())[::2]))
    at = method.at(structure.true_values()).reduce(structure).model
    M, _, K = at.dense(structure.true_values())
    found = np.linalg.eigvals(np.linalg.solve(M, K)).real
    np.testing.assert_allclose(np.sort(found), np.sort(exact.real)[:9], rtol=1e-8)
    result = identified(text)
    np.testing.assert_allclose(result["identification/parameters/error_percent"].data, 0, atol=0.5)


def test_an_assembly_and_its_modes_are_drawn():
    from dynid.report.figure import figures

    text = SCENE[: SCENE.index("excitation:")].replace("reduction: {modes: {count: 4}}", "reduction: {}")
    text += "analysis: {modes: {count: 3}, outputs: [{dof: p:y}], inputs: [p:y], "
    text += "frequency: {start: 1, stop: 9}}\n"  # no mode with the interface held is in that band
    result = dynid.run(scene(text))
    result.attrs["scene"] = text
    drawn = {figure.name: figure.picture.svg for figure in figures(result)}
    assert {"structure", "modes"} <= drawn.keys()


@pytest.mark.parametrize(
    ("motions", "fault"),
    [
        ('"4:y": {w_3: 1}', "4:11: '4:y' is a DOF or motion already"),
        ('"4:-y": {w_3: 1}', "4:11: '4:-y' is a DOF or motion already"),
        ('w_3: {w_4: 1}', "4:11: 'w_3' is a DOF or motion already"),
        ('"p:y": {w_4: 1}', "4:11: 'p:y' is a DOF or motion already"),
        ('s: {5: 1, w_4: 1}', "4:11: the motion 's' names the DOF w_4 twice"),
        ('s: {w_3: 0, w_4: 0}', "4:11: the motion 's' has no weight but zero"),
        ('s: {w_3: 0, w_4: 1}', ""),
    ],
)  # fmt: skip
def test_a_motion_has_a_name_of_its_own_and_names_each_dof_once(motions, fault):
    text = (
        "dynid: 1\nkind: identification\n"
        "structure: {beam: {elements: 3, length: 0.5, EI: 100, rhoA: 1, supports: "
        f"[{{node: 1, fix: [w, theta]}}]}}}}\nmotions: {{{motions}}}\n"
        "points: {p: {node: 3}}\nanalysis: {modes: {count: 1}}\n"
    )
    found = faults_of(text)
    assert len(found) == bool(fault)
    assert not fault or found[0].startswith(fault), found


@pytest.mark.parametrize("node", [1, 2])
@pytest.mark.parametrize("joint", ["k: {x: 1}", "k: {y: 1}", "k: {y: 1}, axes: {x: [1, 1, 0], y: [0, 1, 1]}",
                                   "k: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]"])  # fmt: skip
def test_points_that_move_alike_are_not_joined(node, joint):
    text = f"""\
dynid: 1
kind: identification
structure:
  space_frame:
    nodes: [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    members: [{{nodes: [1, 3], EA: 1, EIy: 1, EIz: 1, GJ: 1, rhoA: 1}},
              {{nodes: [1, 2], EA: 1, EIy: 1, EIz: 1, GJ: 1, rhoA: 1}}]
points: {{p: {{nodes: [1, 2, 3], spread: rigid}}, q: {{node: {node}}}}}
joints: {{j: {{points: [p, q], {joint}}}}}
analysis: {{modes: {{}}}}
"""
    along = "y" if "y:" in joint else "x"
    said = f"9:10: joint j does nothing: the points p and q move alike along {along}."
    assert [fault.partition(" Join")[0] for fault in faults_of(text)] == [said]
