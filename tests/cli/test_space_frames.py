"""Scenes with frames in three dimensions: what they build, and where their faults are."""

import numpy as np
import pytest

import dynid as package
from dynid.scene.kinds.structures import build_structure
from dynid.scene.load import load_scene
from dynid.structure.assembly import Spring, Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.space_frame import RigidMass, SpaceMember, space_frame

SCENE = """\
dynid: 1
kind: identification
parameters: {E: {start: 2.0e11, true: 2.1e11}, h: 1.5, I: 8.0e-8}
structure:
  space_frame:
    nodes: [[0, 0, 0], [0, 0, h], [1, 0.2, h]]
    members:
      - {nodes: [1, 2], EA: E*3e-4, EIy: E*I, EIz: 2*E*I, GJ: E*I, rhoA: 2.4,
         elements: 2, orientation: [1, 1, 0]}
      - {nodes: [2, 3], EA: E*3e-4, EIy: E*I, EIz: 2*E*I, GJ: E*I, rhoA: 2.4, rhoJ: 1.0e-3,
         offsets: [[0, 0, 0.1], [0, 0, 0.1]], releases: [[], [ry]]}
    supports: [{node: 1, fix: [x, y, z, rx, ry]}, {node: 3, fix: [z]}]
    masses: [{node: 3, m: 2, J: [0.1, 0.2, 0.3], offset: [0.05, 0, 0]}]
    springs: [{node: 3, direction: rz, k: 50, c: 0.1}]
    damping: {alpha: 0.1, beta: 1.0e-5}
joints:
  foot: {dofs: ["1:rz"], k: 1.0e4, c: 2}
analysis:
  modes: {count: 3}
  inputs: ["3:x"]
  outputs: [{dof: "2:y", quantity: displacement}]
  frequency: {start: 1, stop: 50, points: 5, unit: Hz}
"""


def test_a_scene_builds_what_python_builds(folder):
    (folder / "s.yaml").write_text(SCENE)
    scene = load_scene("s.yaml")
    found = build_structure(scene, scene.model.structure, scene.model.joints)
    E, second = 2.1e11, 8e-8
    stiff = {"EA": E * 3e-4, "EIy": E * second, "EIz": 2 * E * second, "GJ": E * second, "rhoA": 2.4}
    up = (0.0, 0.0, 0.1)
    made = space_frame(
        [(0.0, 0.0, 0.0), (0.0, 0.0, 1.5), (1.0, 0.2, 1.5)],
        [
            SpaceMember((1, 2), **stiff, elements=2, orientation=(1.0, 1.0, 0.0)),
            SpaceMember((2, 3), **stiff, rhoJ=1e-3, offsets=(up, up), releases=((), ("ry",))),
        ],
        supports=[Support(1, ("x", "y", "z", "rx", "ry")), Support(3, ("z",))],
        masses=[RigidMass(3, 2.0, (0.1, 0.2, 0.3), (0.05, 0.0, 0.0))],
        springs=[Spring(3, "rz", 50.0, 0.1)],
        damping=ProportionalDamping(0.1, 1e-5),
    )
    assert found.dofs == made.dofs
    for letter in "MCK":
        one, other = getattr(found, letter), getattr(made, letter)
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-14 * np.abs(other).max())
    assert [one.name for one in found.parameters] == ["E"]
    assert found.nodes.lines == ((1, 4), (4, 2), (2, 3))


def test_modes_and_responses_of_a_frame_in_a_scene(folder):
    (folder / "s.yaml").write_text(SCENE)
    result = package.run("s.yaml")
    assert result["structure/modes/omega"].data.shape == (3,)
    assert np.abs(result["structure/frequency_response/response"].data).min() > 0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("nodes: [2, 3]", "nodes: [2, 4]", "s.yaml:10:21: there is no node 4; there are 3"),
        ("nodes: [2, 3]", "nodes: [2, 2]", "10:9: member 2: it has no length"),
        ("[1, 1, 0]}", "[0, 0, 1]}", "8:9: member 1: its orientation lies along it"),
        ("[ry]", "[w]", "cannot be 'w'; it is one of x, y, z, rx, ry, rz"),
        ("[[], [ry]]", "[[rx], [rx]]", "10:9: member 2: releases leave a member loose"),
        ("node: 3, fix", "node: 5, fix", "there is no node 5"),
        ("rhoJ: 1.0e-3", "rhoJ: -1", "-1 is negative"),
        ('["3:x"]', '["3:q"]', "there is no DOF '3:q'"),
        ('["3:x"]', '["3:z"]', "there is no DOF '3:z'"),
        ("elements: 2", "elements: 200000", "must be at most 100,000"),
        ("m: 2, J: [0.1, 0.2, 0.3], ", "", "a mass has its 'm', its moments of inertia 'J', or both"),
        ("nodes: [[0, 0, 0], ", "nodes: [[9, 9, 9], [0, 0, 0], ", "6:13: node 1 belongs to no member"),
    ],
)
def test_faults_are_located(dynid, folder, old, new, said):
    assert old in SCENE
    text = SCENE.replace(old, new)
    if "belongs" in said:
        text = text.replace("[2, 3]", "[3, 4]").replace("[1, 2]", "[2, 3]").replace("node: 1", "node: 2")
    (folder / "s.yaml").write_text(text)
    code, _, err = dynid("check", "s.yaml")
    assert code == 2
    assert said in err
