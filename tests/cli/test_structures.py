"""Structures of scenes through the command line: every kind runs, bad matrices are one located sentence."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from dynid.store import read_result

pytestmark = pytest.mark.usefixtures("untried")

FE = Path(__file__).parents[3] / "shared" / "data" / "fe"
needs_data = pytest.mark.skipif(not FE.is_dir(), reason="the shared data are not here")

SCENE = """\
dynid: 1
kind: identification
structure:
  {structure}
joints:
  {joints}
analysis:
  modes: {{}}
"""


def written(folder, structure, joints="{}"):
    (folder / "s.yaml").write_text(SCENE.format(structure=structure, joints=joints))
    return "s.yaml"


BEAM = "beam: {elements: 7, length: 7, EI: 1723.3, rhoA: 0.1, supports: [{node: 1, fix: [w]}]}"
FRAME = (
    "frame: {nodes: [[0, 0], [0, 2], [1, 2]], supports: [{node: 1, fix: [u, w]}], "
    "members: [{nodes: [1, 2], EA: 1e6, EI: 1e3, rhoA: 2}, {nodes: [2, 3], EA: 1e6, EI: 1e3, rhoA: 2}]}"
)


def test_the_beam_of_yang_by_label_and_by_number(dynid, folder):
    for dofs in ("[1]", "[theta_1]"):
        joints = f"{{turn: {{dofs: {dofs}, k: 5.0e3}}, link: {{dofs: [w_6], k: 1.0e4}}}}"
        code, out, err = dynid("run", written(folder, BEAM, joints))
        assert (code, err) == (0, "")
        omega = read_result("s.h5")["structure/modes/omega"].data
        np.testing.assert_allclose(omega[:3], [50.35, 96.15, 220.7], atol=0.02)
        assert "no rigid-body modes" in out


def test_a_frame_says_how_it_swings(dynid, folder):
    code, out, _ = dynid("run", written(folder, FRAME))
    assert code == 0
    assert "1 rigid-body mode, no massless DOFs" in out
    assert "rotation" in out


def test_a_joint_may_be_a_matrix_with_mass(dynid, folder):
    joints = "{block: {dofs: [u_3, w_3], k: [[2e3, 5], [5, 1e3]], m: 0.5}}"
    code, _, err = dynid("run", written(folder, FRAME, joints))
    assert (code, err) == (0, "")


@needs_data
def test_the_block_and_the_building(dynid, folder):
    files = f"matrices: {{mass: {FE}/blockC3D8_MASS1.mtx, stiffness: {FE}/blockC3D8_STIF1.mtx}}"
    code, out, _ = dynid("run", written(folder, files), "--set", "analysis.modes.count=8")
    assert code == 0
    assert "6 rigid-body modes" in out
    assert "rotation 3" in out
    code, _, _ = dynid("run", written(folder, f"matrices: {{state_space: {FE}/official_building.mat}}"))
    assert code == 0
    assert read_result("s.h5")["structure/modes/omega"].data[0] == pytest.approx(5.2364, rel=1e-4)


MARKET = "%%MatrixMarket matrix coordinate real symmetric\n"
GOOD = MARKET + "2 2 2\n1 1 4\n2 2 3\n"


@pytest.mark.parametrize(
    ("mass", "stiffness", "code", "said"),
    [
        (GOOD, "1 1 2\n1 2 5\n2 1 2\n2 2 9\n", 2, "4:27: stiffness is not symmetric: entry (1, 2) is 5"),
        (GOOD, MARKET + "3 3 1\n1 1 1\n", 2, "4:27: the stiffness matrix is 3 x 3, but must be 2 x 2"),
        (MARKET + "2 2 2\n1 1 4\n2 2 -3\n", GOOD, 2, "4:14: mass is negative: entry (2, 2) is -3"),
        (GOOD, MARKET + "2 2 2\n1 1 4\n2 2 nan\n", 2, "4:27: stiffness has no number at entry (2, 2)"),
        (GOOD, MARKET + "2 2 2\n1 1 4\n2 2 -3\n", 2, "4:27: stiffness is negative"),
        (GOOD, MARKET + "2 2 900000000000\n1 1 4\n", 4, "it is truncated, or its header is wrong"),
        (GOOD, "1 1 two\n", 4, "cannot be read as triplets"),
    ],
)  # fmt: skip
def test_bad_matrices_are_one_sentence_at_their_place(dynid, folder, mass, stiffness, code, said):
    (folder / "m.mtx").write_text(mass)
    (folder / "k.mtx").write_text(stiffness)
    left, out, err = dynid("run", written(folder, "matrices: {mass: m.mtx, stiffness: k.mtx}"))
    assert (left, out) == (code, "")
    assert said in err
    assert err.count("\n") == 1
    assert not (folder / "s.h5").exists()


def test_labels_may_stand_in_a_file(dynid, folder):
    savemat(folder / "model.mat", {"M": np.eye(2), "K": np.diag([1.0, 9.0])})
    (folder / "names.txt").write_text("left\n\n  right\n")
    files = "matrices: {mass: model.mat, stiffness: model.mat, labels: names.txt}"
    code, _, err = dynid("run", written(folder, files, "{j: {dofs: [right], k: 7.0}}"))
    assert (code, err) == (0, "")
    np.testing.assert_allclose(read_result("s.h5")["structure/modes/omega"].data, [1, 4])
    code, _, err = dynid("run", written(folder, files.replace("names", "nams")))
    assert code == 4
    assert err.startswith("s.yaml:4:")
    assert "nams.txt" in err


def test_dofs_that_a_file_does_not_have_are_all_found(dynid, folder):
    savemat(folder / "model.mat", {"M": np.eye(2), "K": np.eye(2)})
    joints = "{a: {dofs: [3], k: 1}, b: {dofs: [left, rihgt], k: 1}}"
    scene = written(
        folder, "matrices: {mass: model.mat, stiffness: model.mat, labels: [left, right]}", joints
    )
    code, _, err = dynid("run", scene)
    assert code == 2
    assert "s.yaml:6:15: there is no DOF 3; the structure has 2 (left … right)" in err
    assert "s.yaml:6:43: there is no DOF 'rihgt'; did you mean 'right'?" in err


@pytest.mark.parametrize(
    ("structure", "joints", "said"),
    [
        (BEAM, "{j: {dofs: [w_9], k: 1}}", "6:15: there is no DOF 'w_9'; did you mean"),
        (BEAM, "{j: {dofs: [16], k: 1}}", "there is no DOF 16; the structure has 15 (theta_1 … theta_8)"),
        (BEAM, "{j: {dofs: [1, 2, 3], k: 1}}", "'k' is a number, and 'dofs' names 3"),
        (BEAM, "{j: {dofs: [1, 2], k: [[1, 2], [3, 4]]}}", "a joint's matrix is symmetric; entry (2, 1)"),
        (BEAM, "{j: {dofs: [1, 2], k: [[1]]}}", "'k' is 1 x 1, but 'dofs' names 2"),
        (BEAM.replace("node: 1", "node: 9"), "{}", "there is no node 9; there are 8"),
        (BEAM.replace("EI: 1723.3", "EI: [1, 2]"), "{}", "'EI' has 2 entries for 7 elements"),
        (BEAM.replace("[w]", "[u]"), "{}", "cannot be 'u'; it is one of w, theta"),
        (FRAME.replace("[2, 3]", "[2, 4]"), "{}", "there is no node 4; there are 3"),
        (FRAME.replace("[2, 3]", "[2, 2]"), "{}", "both ends are node 2"),
        (FRAME.replace("members: [{nodes: [1, 2], EA: 1e6, EI: 1e3, rhoA: 2}, ", "members: ["), "{}",
         "node 1 belongs to no member"),
        ("matrices: {mass: m.mtx}", "{}", "the matrices are 'mass' and 'stiffness'"),
        ("matrices: {mass: m.mtx, state_space: s.mat}", "{}", "a 'state_space' holds mass"),
        (BEAM + "\n  lumped: {masses: [1]}", "{}", "is one of lumped, beam, frame, space_frame, solid"),
    ],
)  # fmt: skip
def test_checking_finds_what_a_structure_lacks(dynid, folder, structure, joints, said):
    code, _, err = dynid("check", written(folder, structure, joints))
    assert code == 2
    assert said in err


def test_what_rounding_leaves_open_is_said_on_screen_and_page(dynid, folder):
    scene = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [1, 1], links: [{dofs: [1], k: 1}, {dofs: [1, 2], k: 1.0e13}]}
analysis: {modes: {count: 2}}
"""
    (folder / "stiff.yaml").write_text(scene)
    code, out, _ = dynid("run", "stiff.yaml", "--report", "stiff.html")
    assert code == 0
    assert "  warning: rounding of the stiffness leaves the frequency of mode 1 open by" in out
    assert "Warning: rounding of the stiffness" in (folder / "stiff.html").read_text()
    (folder / "soft.yaml").write_text(scene.replace("1.0e13", "1.0e6"))
    assert "warning" not in dynid("run", "soft.yaml")[1]


def test_a_free_response_beside_an_excitation_is_called_so(dynid, folder):
    scene = """\
dynid: 1
kind: identification
structure: {lumped: {masses: [1], links: [{dofs: [1], k: 4}]}}
excitation: {dof: 1, kind: step, amplitude: 8}
initial: {1: {x: 1}}
analysis:
  outputs: [{dof: 1}]
  time: {stop: 1, step: 0.5}
"""
    note = "note: the free response to the initial motion"
    (folder / "a.yaml").write_text(scene)
    said = dynid("run", "a.yaml")[1]
    assert note in said
    assert "-0.4161\n" in said  # cos 2: of the motion at the start alone
    driven = "{dof: 1, kind: step, amplitude: 8}"
    (folder / "a.yaml").write_text(scene.replace("step: 0.5", f"step: 0.5, input: {driven}"))
    said = dynid("run", "a.yaml")[1]
    assert note not in said
    assert "2.416\n" in said  # 2 - cos 2
