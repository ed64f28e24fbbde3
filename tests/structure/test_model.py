"""Structures, joints and lumped models."""

import numpy as np
import pytest
from scipy.sparse import csc_array

from dynid.errors import UsageError
from dynid.identification.systems.parametric_model import parametric_model
from dynid.lti.signals import Step
from dynid.structure.damping import ModalDamping
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model import StructuralModel
from dynid.structure.ports import Channel, Load
from dynid.structure.response import time_response


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
    assert [(u.start, u.true) for u in model.unknowns] == [(1, 2), (3, None), (5, 6)]
    assert [term.letter for term in model.joint_terms] == ["K", "C", "C"]
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


# --- massless, free, indefinite --------------------------------------------------------------------


def test_massless_dofs_and_rigid_bodies_make_a_structure():
    model = StructuralModel(np.diag([1.0, 0.0]), np.zeros((2, 2)), np.array([[5.0, -5], [-5, 5]]))
    assert model.size == 2


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize(
    ("M", "K", "said"),
    [
        (np.diag([1.0, -2.0]), np.eye(2), r"mass is negative: entry \(2, 2\) is -2"),
        (np.array([[1.0, 0.5], [0.5, 0.0]]), np.eye(2), r"mass is indefinite: entry \(.*\) is 0\.5"),
        (np.eye(2), np.array([[1.0, 3.0], [3.0, 1.0]]), r"stiffness is indefinite: entry \(.*\) is 3"),
        (
            np.eye(3),
            np.full((3, 3), -0.9) + 1.9 * np.eye(3),
            r"stiffness is indefinite: .*eigenvalue is -0\.8",
        ),
        (np.eye(2), np.array([[1.0, 0.5], [0.25, 1.0]]), r"entry \(1, 2\) is 0\.5, \(2, 1\) is 0\.25"),
        (np.eye(2), np.array([[1.0, np.nan], [0.0, 1.0]]), r"stiffness has no number at entry \(1, 2\): nan"),
        (np.eye(2), np.eye(3), r"the stiffness matrix is 3 x 3, but must be 2 x 2"),
    ],
)
def test_a_refused_matrix_says_which_entry(M, K, said, sparse):
    kind = csc_array if sparse else np.array
    with pytest.raises(UsageError, match=said):
        StructuralModel(kind(M), kind(np.zeros(M.shape)), kind(K))


@pytest.mark.parametrize("sparse", [False, True])
def test_two_triangles_that_differ_by_rounding_become_one_matrix(sparse):
    K = np.array([[2.0, -1.0], [-1.0 - 1e-15, 2.0]])
    kind = csc_array if sparse else np.array
    model = StructuralModel(kind(np.eye(2)), kind(np.zeros((2, 2))), kind(K))
    K = model.dense()[2]
    assert K[0, 1] == K[1, 0] == pytest.approx(-1, abs=1e-15)


def test_a_negative_entry_among_small_ones_is_seen_beside_large_ones():
    """The tolerance of symmetry is that of the entry's own row and column, not of the largest entry."""
    K = np.diag([1e12, 1.0, 1.0])
    K[1, 2], K[2, 1] = 0.5, 0.4
    with pytest.raises(UsageError, match=r"\(2, 3\)"):
        StructuralModel(np.eye(3), np.zeros((3, 3)), K)


# --- sparse ----------------------------------------------------------------------------------------


def test_sparse_models_stay_sparse_and_say_the_same():
    rng = np.random.default_rng(3)
    root = rng.standard_normal((6, 6))
    M, K = np.diag(rng.uniform(1, 2, 6)), root @ root.T
    block = [[3.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]]
    joints = (
        Joint("a", (1, 4), JointParameter(start=7.0), 2.0, 0.5),
        Joint("b", (6, 2, 3), JointParameter(start=2.0, matrix=block), m=block),
    )
    full = StructuralModel(M, 0.1 * K, K, joints)
    slim = StructuralModel(csc_array(M), 0.1 * K, K, joints)
    assert slim.is_sparse
    assert not full.is_sparse
    values = {"a.k": 11.0, "b.k": 0.25}
    for dense, sparse in zip(full.with_joints(values), slim.with_joints(values), strict=True):
        assert isinstance(sparse, csc_array)
        np.testing.assert_allclose(sparse.toarray(), dense, rtol=1e-15)
    for dense, sparse in zip(full.joint_terms, slim.joint_terms, strict=True):
        np.testing.assert_array_equal(sparse.matrix.toarray(), dense.matrix)


# --- joints ----------------------------------------------------------------------------------------


def test_a_measured_block_and_a_mass_are_added_where_they_belong():
    block = np.array([[4.0, 1.0], [1.0, 2.0]])
    joints = (
        Joint("bolt", (3, 1), k=block, c=JointParameter(value=0.5, matrix=block), m=6.0),
        Joint("point", (2,), m=5.0),
    )
    M, C, K = lumped([1, 1, 1], [], joints).with_joints()
    np.testing.assert_array_equal(M, np.diag([4.0, 6.0, 4.0]))
    np.testing.assert_array_equal(K, [[2, 0, 1], [0, 0, 0], [1, 0, 4]])
    np.testing.assert_array_equal(C, K / 2)


@pytest.mark.parametrize(
    ("dofs", "parts", "said"),
    [
        ((1, 2), {"k": [[1, 2], [2, 1]]}, "indefinite: its lowest eigenvalue is -1"),
        ((1, 2), {"k": [[1, 2], [1, 5]]}, r"symmetric: entry \(1, 2\) is 2, \(2, 1\) is 1"),
        ((1, 2), {"k": [[1, 2], [1]]}, "differ in length"),
        ((1, 2), {"k": [[1, 2]]}, "must be square, not 1 x 2"),
        ((1, 2), {"k": [[1.0, np.nan], [np.nan, 1.0]]}, "not finite"),
        ((1, 2, 3), {"k": np.eye(2)}, "names 3 DOFs, but its k is 2 x 2"),
        ((1, 2, 3), {"k": np.eye(3), "c": 1.0}, "one DOF .to ground. or two"),
        ((1,), {"m": JointParameter(start=1.0)}, "not mass"),
    ],
)
def test_nonsense_blocks_are_refused(dofs, parts, said):
    with pytest.raises(UsageError, match=said) as caught:
        Joint("plate", dofs, **parts)
    assert caught.value.names == ("plate",)


# --- labels ----------------------------------------------------------------------------------------


def test_labels_that_are_texts_leave_numbers_for_the_places():
    model = StructuralModel(np.eye(3), np.zeros((3, 3)), np.eye(3), (), ("theta_1", "w_2", "12:UX"))
    assert [model.index(dof) for dof in ("w_2", 2, "12:UX", 1)] == [1, 1, 2, 0]
    assert model.kinds == ("rotation", "translation", "translation")
    with pytest.raises(UsageError, match=r"there is no DOF w_3; did you mean 'w_2'"):
        model.row("w_3")
    with pytest.raises(UsageError, match="there is no DOF 4"):
        model.row(4)


def test_the_labels_there_are_are_told_as_far_as_they_are_few():
    def said(labels):
        n = len(labels)
        with pytest.raises(UsageError) as caught:
            StructuralModel(np.eye(n), np.zeros((n, n)), np.eye(n), (), labels).row("zz")
        return caught.value.remedy

    assert said(("tip",)) == "The structure has DOF tip only."
    assert said(("a", "b")) == "The structure has the DOFs a, b."
    many = tuple(f"w_{k}" for k in range(1, 31))
    assert said(many) == f"The structure has the DOFs {', '.join(many[:10])}, … w_30."


def test_a_joint_names_a_dof_in_one_way():
    with pytest.raises(UsageError, match="joint j names a DOF in two ways"):
        StructuralModel(
            np.eye(2), np.zeros((2, 2)), np.eye(2), (Joint("j", ("left", 1), 1.0),), ("left", "right")
        )


@pytest.mark.parametrize("M", [np.diag([1.0, 0.0]), np.array([[1.0, 1.0], [1.0, 1.0]])])
def test_a_motion_in_time_of_a_singular_mass_is_that_of_its_limit(M):
    t, loads, outputs = 0.1 * np.arange(1, 9), [Load(2, Step(1.0))], [Channel(1, "displacement")]
    found, limit = (
        time_response(StructuralModel(mass, np.eye(2), 5 * np.eye(2)), loads, outputs, t)
        for mass in (M, M + 1e-9 * np.eye(2))
    )
    path = "structure/time_response/response"
    np.testing.assert_allclose(found.value(path), limit.value(path), atol=1e-8)


@pytest.mark.parametrize(
    ("M", "said"),
    [
        (np.diag([1.0, 0.0]), r"1 of its 2 DOFs have no mass"),
        (np.array([[1.0, 1.0], [1.0, 1.0]]), "some motion moves no mass"),
    ],
)
def test_an_estimate_in_time_needs_mass_everywhere(M, said):
    joint = Joint("j", (1,), JointParameter(start=1.0))
    model = StructuralModel(M, np.eye(2), 5 * np.eye(2), (joint,))
    with pytest.raises(UsageError, match=said):
        parametric_model(model, [Load(1, Step(1.0))], [Channel(1, "displacement")], 0.1 * np.arange(5))


def test_what_takes_dense_matrices_says_how_many_dofs_are_too_many(monkeypatch):
    monkeypatch.setattr("dynid.structure.damping._MOST_MODAL", 1)
    with pytest.raises(UsageError, match="modal damping takes all modes, which 2 DOFs are too many for"):
        ModalDamping(0.01).matrix(np.eye(2), np.eye(2))


@pytest.mark.parametrize("labels", [("a",), ("a", "a"), ("a", "7"), ("a", "")])
def test_labels_must_name(labels):
    with pytest.raises(UsageError):
        StructuralModel(np.eye(2), np.zeros((2, 2)), np.eye(2), (), labels)


# --- reduced models --------------------------------------------------------------------------------


def test_a_reduced_model_names_all_dofs_and_expands_back():
    rng = np.random.default_rng(5)
    joint = Joint("j", ("w_1", "w_3"), JointParameter(start=2.0))
    names = ("w_1", "w_2", "w_3", "w_4")
    full = StructuralModel(np.diag([1.0, 2, 3, 4]), np.eye(4), 9 * np.eye(4), (joint,), names)
    T = rng.standard_normal((4, 3))
    T[1] = [1, 0, 0]
    T[3] = [0, 1, 0]
    reduced = full.projected(T, ("w_2", "w_4", "q_1"))
    np.testing.assert_array_equal(reduced.row("w_2"), [1, 0, 0])
    np.testing.assert_array_equal(reduced.row(4), [0, 1, 0])
    np.testing.assert_array_equal(reduced.row(3), T[2])
    q = rng.standard_normal((3, 2))
    np.testing.assert_allclose(reduced.expand(q), T @ q)
    for small, large in zip(reduced.with_joints({"j.k": 5.0}), full.with_joints({"j.k": 5.0}), strict=True):
        np.testing.assert_allclose(small, T.T @ large @ T, rtol=1e-12, atol=1e-12)
    again = reduced.projected(rng.standard_normal((3, 2)), ("p_1", "p_2"))
    np.testing.assert_allclose(again.row("w_1"), full.row("w_1") @ T @ again.basis.T)
    np.testing.assert_allclose(again.expand(np.eye(2)), T @ again.basis.T)
    with pytest.raises(UsageError, match="no coordinate of the reduced model"):
        reduced.index("w_1")
    with pytest.raises(UsageError, match="there is no DOF 5"):
        reduced.row(5)


def test_units_follow_what_a_joint_holds():
    unknown = JointParameter(start=1.0)
    joints = (
        Joint("turn", ("theta_1",), unknown, unknown),
        Joint("push", ("w_2",), unknown, unknown),
        Joint("both", ("w_2", "theta_1"), JointParameter(start=1.0, matrix=np.eye(2))),
    )
    model = StructuralModel(np.eye(2), np.zeros((2, 2)), np.eye(2), joints, ("theta_1", "w_2"))
    assert [u.unit for u in model.unknowns] == ["N.m/rad", "N.m.s/rad", "N/m", "N.s/m", ""]
    numbered = StructuralModel(np.eye(2), np.zeros((2, 2)), np.eye(2), [Joint("j", (1,), unknown)])
    assert [u.unit for u in numbered.unknowns] == [""]  # a displacement or a rotation
    masses = lumped([1.0, 1.0], [], [Joint("j", (1, 2), unknown)])
    assert [u.unit for u in masses.unknowns] == ["N/m"]
    assert [u.unit for u in masses.projected(np.eye(2), ("q_1", "q_2")).unknowns] == ["N/m"]
    assert [Channel(dof, "velocity").unit for dof in ("theta_1", "w_2", 1)] == ["rad/s", "m/s", "m/s"]
