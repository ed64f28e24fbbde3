"""Nodes of a test matched to a model, and directions between DOFs, against rotations written down by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dynid.errors import UsageError
from dynid.structure.labels import Nodes
from dynid.structure.matching import Matching, matched_dofs
from dynid.structure.model import StructuralModel
from dynid.structure.points import Point, with_points

XYZ = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0.25, 0.5, 2)])
NUMBERS = (10, 20, 30, 40)
TRANSLATIONS = tuple(f"{node}:{along}" for node in NUMBERS for along in "xyz")


def model(labels=TRANSLATIONS, nodes=None):
    n = len(labels)
    return StructuralModel(np.eye(n), np.zeros((n, n)), np.eye(n), dofs=labels, nodes=nodes)


def placed(axes=None, numbers=NUMBERS, xyz=XYZ):
    return model(nodes=Nodes(numbers, xyz, axes or {}))


def refusal(*args):
    with pytest.raises(UsageError) as caught:
        matched_dofs(*args)
    return str(caught.value)


def test_numbers_and_directions_without_geometry():
    found = matched_dofs(model(), [(20, "z"), (10, "-x")], Matching())
    assert found == [{"20:z": 1.0}, {"10:x": -1.0}]


def test_labels_of_any_form_have_nodes_and_directions():
    names = ("w_2", "theta_2", "3:UX")
    found = matched_dofs(model(names), [(2, "-y"), (2, "rz"), (3, "x")], Matching())
    assert found == [{"w_2": -1.0}, {"theta_2": 1.0}, {"3:UX": 1.0}]


def test_a_numbered_dof_is_at_the_node_of_its_number():
    assert matched_dofs(model((1, 2, 3)), [(2, "z"), (3, "-x")], Matching()) == [{2: 1.0}, {3: -1.0}]


def test_pairs_go_before_numbers():
    found = matched_dofs(model(), [(1, "z"), (20, "z")], Matching(pairs={1: 30}))
    assert found == [{"30:z": 1.0}, {"20:z": 1.0}]
    assert "no nodes with DOFs for nodes of the test: 1 (31)" in refusal(
        model(), [(1, "z")], Matching(pairs={1: 31})
    )


@given(st.integers(0, 2**32 - 1))
def test_positions_and_axes_undo_a_rigid_motion(seed):
    """Test and model in turned coordinates: a sensor's direction is the same vector in space."""
    rng = np.random.default_rng(seed)
    axes, own, moving = (Rotation.random(random_state=rng).as_matrix() for _ in range(3))
    origin = rng.normal(size=3)
    shuffled = rng.permutation(4)
    measured = (XYZ[shuffled] - origin) @ axes.T  # coordinates along the axes of the test
    test = Nodes((1, 2, 3, 4), measured + 1e-4 * rng.normal(size=(4, 3)), {2: own})
    node = NUMBERS[shuffled[1]]
    found = matched_dofs(
        placed({node: moving}),
        [(1, "x"), (2, "-z")],
        Matching("position", 1e-2, origin, axes),
        test,
    )
    vector = np.array([found[0].get(f"{NUMBERS[shuffled[0]]}:{along}", 0.0) for along in "xyz"])
    np.testing.assert_allclose(vector, axes[0], atol=2e-4)
    local = np.array([found[1].get(f"{node}:{along}", 0.0) for along in "xyz"])
    space = sum(weight * row for weight, row in zip(local, moving, strict=True))
    np.testing.assert_allclose(space, -sum(c * row for c, row in zip(own[2], axes, strict=True)), atol=2e-4)


def test_turned_axes_are_exact_where_they_lie_along_those_of_the_model():
    """Test z is model y, test y is model -z; rounded to six digits in the file."""
    axes = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=float)
    test = Nodes((10, 20), XYZ[:2], {20: Rotation.from_rotvec([0, 0, 1e-5]).as_matrix()})
    found = matched_dofs(placed(), [(10, "z"), (20, "-y"), (20, "x")], Matching(axes=axes), test)
    assert found == [{"10:y": 1.0}, {"20:z": 1.0}, {"20:x": 1.0}]


def test_rotations_are_turned_like_translations():
    labels = tuple(f"1:{along}" for along in ("rx", "ry", "rz"))
    axes = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], dtype=float)
    assert matched_dofs(model(labels), [(1, "rx"), (1, "-rz")], Matching(axes=axes)) == [
        {"1:ry": 1.0},
        {"1:rx": -1.0},
    ]


def test_nodes_beyond_the_tolerance_are_listed_with_their_distances():
    test = Nodes((1, 2, 3), XYZ[:3] + np.array([[0, 0, 0.001], [0, 0, 0.5], [0, 0, 0.02]]))
    said = refusal(placed(), [(k, "z") for k in (1, 2, 3)], Matching("position", 0.01), test)
    assert "2 of 3 nodes of the test lie more than 0.01 m from the nodes of the model: " in said
    assert "2: 0.5 m from 20; 3: 0.02 m from 30" in said
    assert "origin: …, axes: …" in said


def test_numbers_are_compared_with_positions_if_a_tolerance_is_given():
    test = Nodes(NUMBERS, XYZ[[1, 0, 2, 3]])
    assert matched_dofs(placed(), [(10, "z")], Matching(), test) == [{"10:z": 1.0}]
    said = refusal(placed(), [(10, "z"), (30, "z")], Matching(tolerance=0.1), test)
    assert (
        "1 of 2 nodes of the test lie more than 0.1 m from the node of the model with their number: 10: 1 m"
        in said
    )


def test_long_lists_are_cut():
    said = refusal(model(), [(k, "z") for k in range(100, 130)], Matching())
    assert "no DOFs at 30 of the 30 nodes of the test: 100; 101; " in said
    assert "; 111; and 18 more; it has some at 10; 20; 30; 40" in said


def test_double_matches_are_refused_from_both_sides():
    close = Nodes((1, 2), XYZ[:1] + np.array([[0, 0, 0.001], [0, 0, -0.002]]))
    assert "nodes of the test lie at one node of the model: 1 and 2 at 10" in refusal(
        placed(), [(1, "z"), (2, "z")], Matching("position", 0.01), close
    )
    faces = placed(xyz=XYZ[[0, 1, 2, 1]])  # nodes 20 and 40 at one place: two sides of a joint
    test = Nodes((1, 2), XYZ[:2])
    assert "several nodes of the model are at the place of one of the test: 2 at 20, 40" in refusal(
        faces, [(1, "z"), (2, "z")], Matching("position", 0.01), test
    )
    found = matched_dofs(faces, [(1, "z"), (2, "z")], Matching("position", 0.01, pairs={2: 40}), test)
    assert found == [{"10:z": 1.0}, {"40:z": 1.0}]


def test_nodes_without_dofs_are_no_candidates():
    there = model(TRANSLATIONS[:6], Nodes(NUMBERS, XYZ))
    assert "1: 1 m from 20" in refusal(there, [(1, "z")], Matching("position", 0.1), Nodes((1,), XYZ[2:3]))


@pytest.mark.parametrize("how", [Matching(), Matching("position", 0.5)])
def test_nodes_of_a_rigid_set_move_about_its_point(how):
    """A sensor beside the centre of a flange has its lever arm; the centre itself is no node."""
    flange, _ = with_points(placed(), [Point("flange", (10, 20, 30), "rigid", at=(0.9, 0.1, 0))])
    test = Nodes((10, 20, 30), XYZ[:3] + 0.01, {20: Rotation.from_rotvec([0.3, 0, 0]).as_matrix()})
    pure = matched_dofs(flange, [(30, "-z")], how, test)
    assert pure == [{"30:z": -1.0}]
    (slanting,) = matched_dofs(flange, [(20, "z")], how, test)
    y, z = np.sin(0.3), np.cos(0.3)  # the direction; the node lies at (0.1, -0.1, 0) from the point
    expected = {"flange:y": y, "flange:z": z, "flange:rx": -0.1 * z, "flange:ry": -0.1 * z}
    assert slanting == pytest.approx(expected | {"flange:rz": 0.1 * y})
    own = matched_dofs(flange, [(7, "ry")], Matching(pairs={7: "flange"}))
    assert own == [{"flange:ry": 1.0}]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((model(), [(10, "rx")], Matching()), "10:rx of the test: node 10 of the model has x, y, z"),
        (
            (model(("10:x",)), [(10, "x")], Matching(axes=Rotation.from_rotvec([0, 0, 0.3]).as_matrix())),
            "10:x of the test, which is +0.955 x -0.296 y of the model: node 10 of the model has x",
        ),
        ((model(), [(10, "x")], Matching("position", 0.1)), "the nodes of the model have no positions"),
        ((placed(), [(10, "x")], Matching("position", 0.1)), "the nodes of the test have no positions"),
        (
            (placed(), [(10, "x"), (7, "x")], Matching("position", 0.1), Nodes((10,), XYZ[:1])),
            "the geometry of the test lacks 1 of its nodes: 7",
        ),
        ((model(("4:y", "w_4")), [(4, "y")], Matching()), "the DOFs 4:y and w_4 have one node and direction"),
    ],
)
def test_what_cannot_be_matched_is_refused(arguments, said):
    assert said in refusal(*arguments)


def test_axes_are_orthonormal_and_positions_have_a_tolerance():
    with pytest.raises(UsageError, match="not orthonormal and right-handed"):
        Matching(axes=np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(UsageError, match="need a 'tolerance'"):
        Matching("position")
