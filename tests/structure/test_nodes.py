"""Nodes, and the names by which DOFs are found."""

from itertools import product

import numpy as np
import pytest
from scipy.sparse import csc_array

from dynid.errors import UsageError
from dynid.structure import labels
from dynid.structure.assembly import Support
from dynid.structure.frame import Member, beam, frame
from dynid.structure.joints import Joint
from dynid.structure.labels import Nodes
from dynid.structure.lumped import Link, lumped
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel

EPS = np.finfo(float).eps
PORTAL = [(0.0, 0.0), (0.5, 3.0), (4.0, 3.0), (5.0, -1.0)]
MEMBERS = [Member((at, at + 1), 1e7, 2e4, 5.0, elements=2) for at in (1, 2, 3)]

PORTAL_LENGTH = np.hypot(0.5, 3) + 3.5 + np.hypot(1, 4)


@pytest.mark.parametrize(
    ("label", "place"),
    [
        ("20:z", (20, "z")),
        ("20:rx", (20, "rx")),
        ("w_4", (4, "y")),
        ("u_4", (4, "x")),
        ("theta_4", (4, "rz")),
        ("12:UX", (12, "x")),
        ("12:4", (12, "rx")),
        ("12:ROTY", (12, "ry")),
        ("12:T3", (12, "z")),
        ("arm.20:z", ("arm.20", "z")),
        ("arm.w_4", ("arm.4", "y")),
        ("tip:x", ("tip", "x")),
        (4, None),
        ("mode_3", None),
        ("12:0", None),
        ("w_tip", None),
        (":x", None),
    ],
)
def test_a_label_says_node_and_direction(label, place):
    assert labels.node_direction(label) == place


def turned(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("free", "mass"),
    [
        (beam(4, [1.0, 0.3, 2.0, 0.7], 3e3, 2.0), 8.0),
        (frame(PORTAL, MEMBERS), 5 * PORTAL_LENGTH),
        (
            frame(PORTAL, [*MEMBERS, Member((1, 4), 1e6, 1e3, 1.0, hinges=(1, 2))]),
            5 * PORTAL_LENGTH + np.hypot(5, 1),
        ),
    ],
)
def test_rigid_body_motions_strain_nothing_and_have_the_inertia_of_the_whole(free, mass):
    R = free.nodes.rigid(free.dofs)
    assert np.abs(free.K @ R).max() <= 64 * EPS * (np.abs(free.K) @ np.abs(R)).max()
    plane = R[:, [0, 1, 5]]
    inertia = plane.T @ free.M @ plane
    if free.dofs[0] == "w_1":  # u is no DOF of a beam
        assert np.linalg.matrix_rank(plane) == 2
        np.testing.assert_allclose(inertia[1:, 1:], [[8, 16], [16, 2 * 4**3 / 3]], rtol=1e-13)
    else:
        assert np.linalg.matrix_rank(plane) == 3
        np.testing.assert_allclose(inertia[:2, :2], mass * np.eye(2), rtol=1e-13, atol=1e-12)
    assert not R[:, 2:5].any()


def test_rigid_body_motions_of_a_solid_in_axes_of_its_nodes():
    xyz = np.array([[1.0, 2, 3], [-1, 0, 2]])
    nodes = Nodes((7, "a.2"), xyz, axes={7: turned(0.3)})
    directions = ["x", "y", "z", "rx", "ry", "rz"]
    names = [f"{node}:{along}" for node, along in product((7, "a.2"), directions)]
    R = nodes.rigid([*names, "8:x", 3])
    assert not R[12:].any()
    rng = np.random.default_rng(1)
    shift, turn = rng.normal(size=3), rng.normal(size=3)
    for first, place, axes in ((0, 0, turned(0.3)), (6, 1, np.eye(3))):
        moved = R[first : first + 6] @ [*shift, *turn]
        np.testing.assert_allclose(moved[:3], axes @ (shift + np.cross(turn, xyz[place])), atol=1e-14)
        np.testing.assert_allclose(moved[3:], axes @ turn, atol=1e-15)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"numbers": (1, 1)}, "two nodes have the number 1"),
        ({"xyz": np.zeros((2, 2))}, "2 x 3"),
        ({"xyz": np.full((2, 3), np.nan)}, "finite"),
        ({"sets": {"a": (3,)}}, "no node 3"),
        ({"lines": ((1, 4),)}, "no node 4"),
        ({"axes": {1: np.ones((3, 3))}}, "orthonormal"),
        ({"axes": {9: np.eye(3)}}, "no node 9"),
    ],
)
def test_nonsense_nodes_are_refused(change, said):
    with pytest.raises(UsageError, match=said):
        Nodes(**({"numbers": (1, 2), "xyz": np.zeros((2, 3))} | change))


@pytest.mark.parametrize("reduced", [False, True])
def test_node_and_direction_name_the_dofs_of_every_model(reduced):
    model = beam(3, 3.0, 1e3, 1.0, supports=[Support(1, ("w",))])
    assert model.dofs == ("theta_1", "w_2", "theta_2", "w_3", "theta_3", "w_4", "theta_4")
    if reduced:
        T = np.random.default_rng(0).normal(size=(7, 3))
        T[3] = [1, 0, 0]
        model = model.projected(T, ("w_3", "a", "b"))
        assert model.nodes.numbers == (1, 2, 3, 4)
    assert [model.label(f"{node}:{along}") for node, along in ((1, "rz"), (3, "y"))] == ["theta_1", "w_3"]
    for label, own in (("1:rz", "theta_1"), ("3:y", "w_3"), ("4:rz", "theta_4"), (4, "w_3")):
        np.testing.assert_array_equal(model.row(label), model.row(own))
    for label, own in (("3:-y", "w_3"), ("4:-rz", "theta_4")):
        np.testing.assert_array_equal(model.row(label), -model.row(own))
    np.testing.assert_array_equal(model.row("3:+y"), model.row("w_3"))
    assert model.index("3:y") == (0 if reduced else 3)
    with pytest.raises(
        UsageError, match="which only channels, loads and reference DOFs can have; write '3:y'"
    ):
        model.label("3:-y")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("2:w", "did you mean '2:y'"),
        ("2:-w", "did you mean '2:y'"),
        ("2:UY", "did you mean '2:y'"),
        ("1:y", r"node 1 has theta_1 \(rz\) only"),
        ("2:z", r"node 2 has w_2 \(y\), theta_2 \(rz\) only"),
        ("9:y", "no DOF '9:y'; there are DOFs at the nodes 1, 2, 3, 4"),
        ("w-2", "did you mean 'w_2'"),
    ],
)
@pytest.mark.parametrize("ask", ["row", "label", "index"])
def test_what_names_no_dof_is_refused_with_what_it_may_mean(name, said, ask):
    model = beam(3, 3.0, 1e3, 1.0, supports=[Support(1, ("w",))])
    with pytest.raises(UsageError, match=said):
        getattr(model, ask)(name)


def test_two_dofs_with_one_direction_are_named_by_their_labels_only():
    model = StructuralModel(np.eye(2), np.zeros((2, 2)), np.eye(2), dofs=("12:UX", "12:1"))
    with pytest.raises(UsageError, match="12:UX, 12:1 have node 12 and direction x in common"):
        model.row("12:x")
    np.testing.assert_array_equal(model.row("12:1"), [0, 1])


def test_a_reversed_sensor_has_the_unit_of_its_dof():
    for dof, unit in (("4:-rz", "rad/s"), ("4:-y", "m/s"), ("theta_4", "rad/s"), ("arm.20:-rx", "rad/s")):
        assert Channel(dof, "velocity").unit == unit


def test_one_dof_under_two_names_is_one():
    model = beam(2, 2.0, 1e3, 1.0)
    with pytest.raises(UsageError, match="names a DOF in two ways"):
        model.joined([Joint("a", ("w_2", "2:y"), 3.0)])


def test_a_motion_is_named_like_a_dof_and_takes_joints():
    motions = {"p:x": {1: 0.25, 3: 0.75}}
    links = [Link((1, 2), 3.0), Link((2, 3), 5.0), Link((3,), 2.0)]
    bare = lumped([1, 2, 3], links)
    joint = Joint("p", ("p:x", 2), 7.0)
    every = {name: getattr(bare, name) for name in "MCK"}
    model = StructuralModel(**every, joints=(joint,), motions=motions)
    sparse = StructuralModel(
        **{name: csc_array(one) for name, one in every.items()}, joints=(joint,), motions=motions
    )
    row = np.array([0.25, 0, 0.75])
    for one in (model, sparse, model.joined(model.joints)):
        np.testing.assert_array_equal(one.row("p:x"), row)
        np.testing.assert_array_equal(one.row("p:-x"), -row)
    spring = row - [0, 1, 0]
    np.testing.assert_allclose(model.dense()[2], bare.K + 7 * np.outer(spring, spring), rtol=1e-15)
    np.testing.assert_array_equal(sparse.dense()[2], model.dense()[2])
    T = np.random.default_rng(2).normal(size=(3, 2))
    small = model.projected(T, ("a", "b"))
    np.testing.assert_allclose(small.row("p:x"), row @ T, rtol=1e-15)
    np.testing.assert_allclose(small.row("p:-x"), -row @ T, rtol=1e-15)
    assert small.label("p:x") == "p:x"
    for one in (model, small):
        with pytest.raises(UsageError, match="a weighted sum of DOFs"):
            one.index("p:x")
    twice = small.projected(np.eye(2)[:, :1], ("c",))
    np.testing.assert_allclose(twice.row("p:x"), row @ T[:, :1], rtol=1e-15)


@pytest.mark.parametrize(
    ("motions", "said"),
    [({"w_1": {"w_2": 1.0}}, "'w_1' is a DOF"), ({"p:x": {"w_9": 1.0}}, "no DOF: w_9"),
     ({"p:x": {"w_2": np.inf}}, "no numbers")],
)  # fmt: skip
def test_nonsense_motions_are_refused(motions, said):
    model = beam(2, 2.0, 1e3, 1.0)
    with pytest.raises(UsageError, match=said):
        StructuralModel(model.M, model.C, model.K, dofs=model.dofs, motions=motions)
