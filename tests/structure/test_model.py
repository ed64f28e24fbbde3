"""Structures, joints and lumped models."""

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.structure.lumped import Link, lumped
from dynid.structure.model import Joint, JointParameter, StructuralModel


def test_joint_pattern_between_dofs_and_to_ground():
    joints = (Joint("a", (1, 3), k=5.0, c=JointParameter(value=2.0)), Joint("g", (2,), k=7.0))
    M, C, K = lumped([1, 1, 1], [], joints).with_joints()
    np.testing.assert_array_equal(M, np.eye(3))
    np.testing.assert_array_equal(C, [[2, 0, -2], [0, 0, 0], [-2, 0, 2]])
    np.testing.assert_array_equal(K, [[5, 0, -5], [0, 7, 0], [-5, 0, 5]])


def test_links_assemble_a_chain():
    M, C, K = lumped([2, 3], [Link((1,), 10, 1), Link((1, 2), 20, 2)]).with_joints()
    np.testing.assert_array_equal(M, np.diag([2.0, 3.0]))
    np.testing.assert_array_equal(C, [[3, -2], [-2, 2]])
    np.testing.assert_array_equal(K, [[30, -20], [-20, 20]])


def test_unknowns_come_joint_by_joint_and_take_their_values_by_name():
    joints = (
        Joint("upper", (1, 2), JointParameter(start=1.0, true=2.0), JointParameter(start=3.0)),
        Joint("known", (2,), 4.0),
        Joint("lower", (2,), c=JointParameter(start=5.0, true=6.0)),
    )
    model = lumped([1, 1], [], joints)
    assert [u.name for u in model.unknowns] == ["upper.k", "upper.c", "lower.c"]
    assert [(u.letter, u.start, u.true) for u in model.unknowns] == [("k", 1, 2), ("c", 3, None), ("c", 5, 6)]
    _, C, K = model.with_joints({"upper.k": 10, "upper.c": 0.1, "lower.c": 1})
    np.testing.assert_allclose(K, [[10, -10], [-10, 14]])
    np.testing.assert_allclose(C, [[0.1, -0.1], [-0.1, 1.1]])
    with pytest.raises(UsageError, match=r"no true value is known of upper\.c"):
        model.true_values()
    with pytest.raises(UsageError, match=r"upper\.k has no value"):
        model.with_joints({"upper.c": 1, "lower.c": 1})
    with pytest.raises(UsageError, match=r"left\.k"):
        model.with_joints({"upper.k": 1, "upper.c": 1, "lower.c": 1, "left.k": 1})


def test_labels_name_the_dofs():
    model = StructuralModel(np.eye(2), np.zeros((2, 2)), np.eye(2), (Joint("a", (10,), 3.0),), (6, 10))
    np.testing.assert_array_equal(model.row(10), [0, 1])
    np.testing.assert_array_equal(model.with_joints()[2], np.diag([1.0, 4.0]))


@pytest.mark.parametrize(
    "arguments",
    [
        {"value": 1, "start": 2},
        {},
        {"value": 1, "true": 2},
        {"value": -1},
        {"start": 0},
        {"start": 1, "true": np.nan},
    ],
)
def test_joint_parameters_must_make_sense(arguments):
    with pytest.raises(UsageError):
        JointParameter(**arguments)


@pytest.mark.parametrize("dofs", [(), (1, 1), (1, 2, 3)])
def test_joints_take_one_or_two_dofs(dofs):
    with pytest.raises(UsageError) as caught:
        Joint("hinge", dofs, 1.0)
    assert caught.value.names == ("hinge",)


@pytest.mark.parametrize(
    ("masses", "links", "joints"),
    [
        ([], [], ()),
        ([1, -1], [], ()),
        ([1, np.inf], [], ()),
        ([1, 1], [Link((3,), 1)], ()),
        ([1, 1], [Link((0, 1), 1)], ()),
        ([1, 1], [Link((1, 1), 1)], ()),
        ([1, 1], [Link((1, 2), -1)], ()),
        ([1, 1], [], (Joint("a", (3,), 1.0),)),
        ([1, 1], [], (Joint("a", (1,), 1.0), Joint("a", (2,), 1.0))),
    ],
)
def test_nonsense_structures_are_refused(masses, links, joints):
    with pytest.raises(UsageError):
        lumped(masses, links, joints)


@pytest.mark.parametrize(
    ("M", "K"),
    [
        (np.diag([1.0, 0.0]), np.eye(2)),
        (np.array([[1.0, 2.0], [2.0, 1.0]]), np.eye(2)),
        (np.eye(2), np.eye(3)),
        (np.eye(2), np.array([[1.0, 0.5], [0.0, 1.0]])),
        (np.eye(2), np.full((2, 2), np.nan)),
    ],
)
def test_matrices_must_be_those_of_a_structure(M, K):
    with pytest.raises(UsageError):
        StructuralModel(M, np.zeros((2, 2)), K)


def test_an_unknown_dof_is_named_with_what_exists():
    with pytest.raises(UsageError, match=r"there is no DOF 7\. The structure has the DOFs 1 to 2") as caught:
        lumped([1, 1], []).row(7)
    assert caught.value.names == ("7",)
