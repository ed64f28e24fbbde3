"""Points, joints between them, assemblies of parts, and reductions by parts, against hand assembly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import UsageError
from dynid.structure.assembly import assembled_parts
from dynid.structure.joints import JointParameter
from dynid.structure.labels import DIRECTIONS, Nodes
from dynid.structure.model import StructuralModel
from dynid.structure.point_joints import PointJoint, components
from dynid.structure.points import Point, with_points
from dynid.structure.reduction.methods import PartReduction, ReductionByParts
from dynid.structure.reduction.mode_selection import Interest, ModeRange
from dynid.structure.space_frame import SpaceMember, space_frame


def rotation(rng):
    """Return random orthonormal rows."""
    Q = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))


def rigid_rows(xyz, axes, along):
    """Return displacements, or rotations, along own axes in the six rigid motions about the origin."""
    R = np.zeros((6, 6))
    for k in range(3):
        R[:3, k] = np.eye(3)[k]
        R[:3, 3 + k] = np.cross(np.eye(3)[k], xyz)
        R[3:, 3 + k] = np.eye(3)[k]
    return np.kron(np.eye(2), axes) @ R if along is None else (np.kron(np.eye(2), axes) @ R)[along]


def random_part(rng, nodes=6, *, rotations=False, sparse=False, skew=True):
    """Return a free part of random stiffness that rigid motions do not strain, and these (n x 6)."""
    xyz = rng.standard_normal((nodes, 3))
    axes = {n: rotation(rng) for n in range(1, nodes + 1, 2)} if skew else {}
    count = 6 if rotations else 3
    R = np.concatenate(
        [rigid_rows(xyz[n], axes.get(n + 1, np.eye(3)), slice(0, count)) for n in range(nodes)]
    )
    n = len(R)
    A = rng.standard_normal((n, n))
    free = np.eye(n) - R @ np.linalg.pinv(R)
    K, M = free @ (A @ A.T) @ free, np.eye(n) * (1 + rng.random(n))
    if sparse:
        from scipy.sparse import csc_array

        K, M = csc_array(K), csc_array(M)
    labels = [f"{node}:{along}" for node in range(1, nodes + 1) for along in DIRECTIONS[:count]]
    where = Nodes(tuple(range(1, nodes + 1)), xyz, axes, {"face": tuple(range(1, nodes))})
    model = StructuralModel(M, np.zeros((n, n)), K, dofs=tuple(labels), nodes=where)
    return model, R


def dense(model, values=None):
    return [np.asarray(m if isinstance(m, np.ndarray) else m.toarray()) for m in model.with_joints(values)]


def joined(model, points, *joints, size=10.0):
    """Return a structure with points and joints between them."""
    model, placed = with_points(model, points)
    made, motions = [], {}
    for joint in joints:
        own, parts = components(joint, placed, size)
        made += parts
        motions |= own
    return model.with_motions(motions).joined(made), placed


@pytest.mark.parametrize("sparse", [False, True])
def test_an_assembly_is_block_diagonal_with_the_parts_names(sparse):
    rng = np.random.default_rng(1)
    arm, _ = random_part(rng)
    base, _ = random_part(rng, 4, sparse=sparse)
    whole = assembled_parts({"arm": arm, "base": base})
    K = dense(whole)[2]
    np.testing.assert_array_equal(K[:18, :18], arm.K)
    np.testing.assert_array_equal(K[18:, 18:], dense(base)[2])
    assert not K[:18, 18:].any()
    assert whole.is_sparse == sparse
    assert whole.dofs[18] == "base.1:x"
    assert whole.nodes.sets["arm.face"] == tuple(f"arm.{n}" for n in range(1, 6))
    np.testing.assert_allclose(whole.nodes.axes["base.3"], base.nodes.axes[3])
    np.testing.assert_array_equal(
        whole.nodes.rigid(whole.dofs),
        np.concatenate([arm.nodes.rigid(arm.dofs), base.nodes.rigid(base.dofs)]),
    )


@pytest.mark.parametrize("weighted", [False, True])
def test_a_distributed_point_is_the_weighted_least_squares_motion_of_its_nodes(weighted):
    rng = np.random.default_rng(2)
    part, R = random_part(rng, rotations=True)
    nodes, weights = (1, 2, 4, 5), tuple(rng.random(4) + 0.1) if weighted else ()
    model, _ = with_points(part, [Point("p", nodes, weights=weights)])
    rows = np.array([model.row(f"p:{along}") for along in DIRECTIONS])
    W = np.diag(np.repeat(weights or np.ones(4), 3))
    at = np.concatenate([6 * (n - 1) + np.arange(3) for n in nodes])
    centre = np.average(part.nodes.xyz[[n - 1 for n in nodes]], axis=0, weights=weights or None)
    about = np.eye(6)
    for k in range(3):
        about[:3, 3 + k] = -np.cross(np.eye(3)[k], centre)
    S = (R @ about)[at]
    expected = np.zeros((6, model.size))
    expected[:, at] = np.linalg.solve(S.T @ W @ S, S.T @ W)
    np.testing.assert_allclose(rows, expected, atol=1e-13)
    # A force on it has the same resultant and moment as the forces that it is on the nodes.
    np.testing.assert_allclose(rows @ R @ about, np.eye(6), atol=1e-12)


def test_rigid_nodes_move_as_one_body_and_keep_their_names():
    rng = np.random.default_rng(3)
    part, R = random_part(rng, 7, rotations=True)
    model, placed = with_points(part, [Point("p", (2, 3, 5), "rigid"), Point("q", (1, 3, 4, 7))])
    centre = part.nodes.xyz[[1, 2, 4]].mean(axis=0)
    held = np.concatenate([6 * (n - 1) + np.arange(6) for n in (2, 3, 5)])
    about = np.eye(6)
    for k in range(3):
        about[:3, 3 + k] = -np.cross(np.eye(3)[k], centre)
    others = np.setdiff1d(np.arange(42), held)
    T = np.zeros((42, len(others) + 6))
    T[others, np.arange(len(others))] = 1
    T[held, len(others) :] = (R @ about)[held]
    order = [model.dofs.index(part.dofs[k]) for k in others] + [
        model.dofs.index(f"p:{along}") for along in DIRECTIONS
    ]
    for mine, whole in zip(dense(model), dense(part), strict=True):
        np.testing.assert_allclose(mine[np.ix_(order, order)], T.T @ whole @ T, atol=1e-11)
    # Names of DOFs that are none any more read what they are now; so does a point that shares a node.
    x = rng.standard_normal(model.size)
    full = T @ x[order]
    np.testing.assert_allclose(model.row("3:y") @ x, full[13])
    free, _ = with_points(part, [Point("q", (1, 3, 4, 7))])
    for along in DIRECTIONS:
        np.testing.assert_allclose(model.row(f"q:{along}") @ x, free.row(f"q:{along}") @ full, atol=1e-12)
    assert placed["p"].dofs == tuple(f"p:{along}" for along in DIRECTIONS)


def two_parts(rng, *, rotations=True, at_one_place=True):
    """Return an assembly of two random parts whose nodes 6 and 1 are at one place."""
    arm, _ = random_part(rng, rotations=rotations)
    base, _ = random_part(rng, rotations=rotations)
    if at_one_place:
        moved = base.nodes.xyz - base.nodes.xyz[0] + arm.nodes.xyz[5]
        base = replace(base, nodes=replace(base.nodes, xyz=moved))
    return assembled_parts({"arm": arm, "base": base})


@pytest.mark.parametrize("turned", [False, True])
def test_six_components_are_those_of_an_assembly_by_hand(turned):
    rng = np.random.default_rng(4)
    whole = two_parts(rng)
    axes = rotation(rng) if turned else np.eye(3)
    k, c = rng.random(6) + 1, rng.random(6) + 1
    joint = PointJoint(
        "bolt", ("p", "q"), dict(zip(DIRECTIONS, k, strict=True)), dict(zip(DIRECTIONS, c, strict=True)), 3.0,
        axes=axes if turned else None,
    )  # fmt: skip
    model, _ = joined(whole, [Point("p", ("arm.6",)), Point("q", ("base.1",))], joint)
    D = np.kron(np.eye(2), axes)
    own = [np.kron(np.eye(2), whole.nodes.axes.get(node, np.eye(3))) for node in ("arm.6", "base.1")]
    B = np.zeros((6, 72))
    B[:, 30:36], B[:, 36:42] = D @ own[0].T, -D @ own[1].T
    M, C, K = dense(model)
    M0, C0, K0 = dense(whole)
    np.testing.assert_allclose(K - K0, B.T @ np.diag(k) @ B, atol=1e-12)
    np.testing.assert_allclose(C - C0, B.T @ np.diag(c) @ B, atol=1e-12)
    extra = np.zeros((72, 72))
    for first in (30, 36):
        extra[first : first + 3, first : first + 3] = 1.5 * np.eye(3)
    np.testing.assert_allclose(M - M0, extra, atol=1e-12)


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("spread", ["node", "distributed", "rigid"])
def test_a_rigid_motion_of_all_strains_no_joint(apart, spread):
    rng = np.random.default_rng(5)
    whole = two_parts(rng, at_one_place=not apart)
    nodes = {"node": (("arm.6",), ("base.1",))}.get(
        spread, (tuple(f"arm.{n}" for n in (2, 4, 5, 6)), tuple(f"base.{n}" for n in (1, 2, 5)))
    )
    kind = "distributed" if spread == "node" else spread
    k = dict.fromkeys(DIRECTIONS, 1.0)
    model, _ = joined(
        whole, [Point("p", nodes[0], kind), Point("q", nodes[1], kind)],
        PointJoint("bolt", ("p", "q"), k, axes=rotation(rng)),
    )  # fmt: skip
    K = dense(model)[2]
    R = model.nodes.rigid(model.dofs)
    assert np.abs(K @ R).max() < 1e-11 * np.abs(K).max()
    assert np.linalg.matrix_rank(K - dense(model.joined(()))[2], tol=1e-9) == 6


def test_points_at_one_place_act_without_a_moment_on_solids():
    rng = np.random.default_rng(6)
    whole = two_parts(rng, rotations=False)
    springs = PointJoint("bolt", ("p", "q"), {"x": 2.0, "y": 3.0, "z": 4.0}, axes=rotation(rng))
    model, _ = joined(whole, [Point("p", ("arm.6",)), Point("q", ("base.1",))], springs)
    K, R = dense(model)[2], model.nodes.rigid(model.dofs)
    assert np.abs(K @ R).max() < 1e-11 * np.abs(K).max()
    with pytest.raises(UsageError, match=r"bolt along rx: .*'p' do not determine its motion along"):
        joined(
            whole,
            [Point("p", ("arm.6",)), Point("q", ("base.1",))],
            PointJoint("bolt", ("p", "q"), {"rx": 1.0}),
        )


def test_a_block_couples_components_and_unknown_ones_keep_their_names():
    rng = np.random.default_rng(7)
    whole = two_parts(rng)
    A = rng.standard_normal((6, 6))
    block = (A @ A.T + np.diag(np.ones(6))).tolist()
    unknown = {"x": JointParameter(start=2.0, true=3.0), "rz": JointParameter(start=1.0, true=5.0)}
    points = [Point("p", ("arm.6",)), Point("q", ("base.1",))]
    coupled, _ = joined(whole, points, PointJoint("bolt", ("p", "q"), block, unknown))
    assert [one.name for one in coupled.unknowns] == ["bolt.c.x", "bolt.c.rz"]
    assert [one.unit for one in coupled.unknowns] == ["N.s/m", "N.m.s/rad"]
    separate, _ = joined(whole, points, PointJoint("one", ("p", "q"), dict.fromkeys(DIRECTIONS, 1.0)))
    rows = np.array([separate.row(j.dofs[0]) - separate.row(j.dofs[1]) for j in separate.joints])
    K = dense(coupled.joined(coupled.joints), coupled.true_values())[2] - dense(whole)[2]
    np.testing.assert_allclose(K, rows.T @ np.array(block) @ rows, atol=1e-10)
    both = np.kron([[1, -1], [-1, 1]], block)
    again, _ = joined(whole, points, PointJoint("bolt", ("p", "q"), both))
    np.testing.assert_allclose(dense(again)[2] - dense(whole)[2], K, atol=1e-10)


@pytest.mark.parametrize(
    ("point", "said"),
    [
        (Point("p", (1, 2, 3)), r"motion rx: a rotation about \(1, 0, 0\) through \(1, 0, 0\)"),
        (Point("p", (1, 2)), "motion rx: a rotation about"),
        (Point("p", (1, 2, 3), "rigid"), "motion rx: a rotation about"),
        (Point("p", (1, 9)), "names node 9, which does not exist"),
        (Point("p", (1, 4)), "has node 4 without DOF 4:z"),
        (Point("p", ()), "needs nodes"),
        (Point("p", (1, 2, 5), weights=(1.0, -1.0, 2.0)), "needs a positive weight for each"),
        (Point(2, (1,)), "has the name of a node"),
    ],
)
def test_node_sets_that_are_no_point_are_refused_with_the_reason(point, said):
    xyz = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1.0]]
    labels = [f"{n}:{along}" for n in range(1, 6) for along in "xyz" if (n, along) != (4, "z")]
    n = len(labels)
    model = StructuralModel(
        np.eye(n), np.zeros((n, n)), np.eye(n), dofs=labels, nodes=Nodes((1, 2, 3, 4, 5), xyz)
    )
    with pytest.raises(UsageError, match=said) as error:
        with_points(model, [point])
    assert error.value.names == (f"points.{point.name}",)


def test_two_rigid_points_cannot_hold_one_node():
    part, _ = random_part(np.random.default_rng(8), rotations=True)
    points = [Point("p", (1, 2, 3), "rigid"), Point("q", (3, 4, 5), "rigid")]
    with pytest.raises(UsageError, match="'q' and the point 'p' both hold node 3 rigidly"):
        with_points(part, points)


def half_beams():
    """Return a cantilever of 8 elements in a skew direction, and its two halves."""
    ends = [np.zeros(3), np.array([0.6, 0.9, 0.4]), np.array([1.2, 1.8, 0.8])]
    properties = (2e8, 3e4, 5e4, 4e4, 6.0)

    def beam(first, last, elements, fixed):
        from dynid.structure.assembly import Support

        supports = [Support(1, DIRECTIONS)] if fixed else []
        member = SpaceMember((1, 2), *properties, elements=elements)
        return space_frame([tuple(first), tuple(last)], [member], supports=supports)

    return beam(ends[0], ends[2], 8, True), beam(ends[0], ends[1], 4, True), beam(ends[1], ends[2], 4, False)


def frequencies(model, count=8):
    from scipy.linalg import eigh

    M, _, K = dense(model)
    return np.sqrt(eigh(K, M, eigvals_only=True)[:count])


def test_two_halves_of_a_beam_joined_ever_stiffer_become_the_whole():
    whole, root, tip = half_beams()
    parts = assembled_parts({"root": root, "tip": tip})
    points = [Point("p", ("root.2",)), Point("q", ("tip.1",))]
    errors = []
    for stiffness in (1e9, 1e10, 1e11):
        k = dict.fromkeys(DIRECTIONS, stiffness)
        model, _ = joined(parts, points, PointJoint("weld", ("p", "q"), k))
        errors.append(np.abs(frequencies(model) / frequencies(whole) - 1).max())
    assert errors[0] < 1e-3
    np.testing.assert_allclose(np.array(errors[:2]) / errors[1:], 10, rtol=0.05)


def reduced(model, parts, interest=(), band=None):
    return ReductionByParts(parts, Interest(interest, band)).reduce(model)


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("method", ["craig-bampton", "modal"])
def test_parts_reduced_on_all_their_modes_are_exact_at_distributed_points(sparse, method):
    rng = np.random.default_rng(9)
    arm, _ = random_part(rng, 6, sparse=sparse)
    base, _ = random_part(rng, 5, sparse=sparse)
    whole = assembled_parts({"arm": arm, "base": base})
    nodes = [tuple(f"arm.{n}" for n in (1, 2, 3, 5)), tuple(f"base.{n}" for n in (1, 2, 4))]
    k = {along: JointParameter(start=1.0, true=5.0 + place) for place, along in enumerate(DIRECTIONS)}
    model, _ = joined(whole, [Point("p", nodes[0]), Point("q", nodes[1])], PointJoint("bolt", ("p", "q"), k))
    sensors = ("arm.6:x", "base.3:-y", "p:x")
    wanted = {"craig-bampton": [11, 8], "modal": [18, 15]}[method]
    each = [PartReduction(method, {"modes": ModeRange(count=count)}) for count in wanted]
    made = reduced(model, dict(zip(("arm", "base"), each, strict=True)), sensors)
    assert made.model.size == model.size
    values = model.true_values()
    for kept in (model.joined(()), model):
        small = made.model.joined(kept.joints)
        given = values if kept.joints else None
        np.testing.assert_allclose(
            np.linalg.eigvals(np.linalg.solve(dense(small, given)[0], dense(small, given)[2])).real.max(),
            np.linalg.eigvals(np.linalg.solve(dense(kept, given)[0], dense(kept, given)[2])).real.max(),
            rtol=1e-8,
        )
    w = 1.3
    Z, z = (dense(one, values)[2] - w**2 * dense(one, values)[0] for one in (model, made.model))
    for read in (*sensors, "q:rz", "base.5:z"):
        for force in ("arm.4:z", "q:ry"):
            np.testing.assert_allclose(
                made.model.row(read) @ np.linalg.solve(z, made.model.row(force)),
                model.row(read) @ np.linalg.solve(Z, model.row(force)),
                rtol=1e-6, atol=1e-9,
            )  # fmt: skip


def test_craig_bampton_by_parts_converges_and_keeps_rigid_bodies():
    _, root, tip = half_beams()
    parts = assembled_parts({"root": root, "tip": tip})
    k = {along: JointParameter(start=1e6, true=3e6) for along in DIRECTIONS}
    model, _ = joined(
        parts, [Point("p", ("root.2",)), Point("q", ("tip.1",))], PointJoint("bolt", ("p", "q"), k)
    )
    values = model.true_values()
    exact = frequencies(StructuralModel(*model.with_joints(values)), 6)
    errors = []
    for count in (2, 6, 12):
        part = PartReduction("craig-bampton", {"modes": ModeRange(count=count)})
        made = reduced(model, {"root": part, "tip": part})
        assert made.model.size == 12 + 2 * count
        assert [one.name for one in made.model.unknowns] == [f"bolt.k.{along}" for along in DIRECTIONS]
        errors.append(
            np.abs(frequencies(StructuralModel(*made.model.with_joints(values)), 6) / exact - 1).max()
        )
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 1e-4
    held = made.model.joined(()).K
    free = np.linalg.eigvalsh(held)[:6]
    assert np.abs(free).max() < 1e-9 * np.abs(held).max()


def test_a_full_part_keeps_its_dofs_beside_a_reduced_one():
    _, root, tip = half_beams()
    parts = assembled_parts({"root": root, "tip": tip})
    k = dict.fromkeys(DIRECTIONS, 1e6)
    model, _ = joined(
        parts, [Point("p", ("root.2",)), Point("q", ("tip.1",))], PointJoint("bolt", ("p", "q"), k)
    )
    part = PartReduction("craig-bampton", {"modes": ModeRange(count=10)})
    made = reduced(model, {"root": None, "tip": part}, ("tip.2:z",))
    assert made.model.dofs[:24] == model.dofs[:24]
    assert made.masters == (*(f"tip.1:{along}" for along in DIRECTIONS), "tip.2:z")
    np.testing.assert_allclose(frequencies(made.model, 5), frequencies(model, 5), rtol=1e-4)


def test_what_does_not_hold_a_part_is_refused_with_the_part():
    from dynid.errors import Singular

    _, root, tip = half_beams()
    parts = assembled_parts({"root": root, "tip": tip})
    part = PartReduction("craig-bampton", {"modes": ModeRange(count=4)})
    with pytest.raises(Singular) as error:
        reduced(parts, {"root": None, "tip": part}, ("tip.2:z",))
    assert error.value.names[0] == "tip.masters"


def test_a_part_whose_interface_is_all_of_it_has_no_modes_of_its_own():
    _, root, tip = half_beams()
    parts = assembled_parts({"root": root, "tip": tip})
    every = tuple(label for label in parts.dofs if label.startswith("tip."))
    made = reduced(parts, {"root": None, "tip": PartReduction("craig-bampton")}, every, band=1.0)
    assert made.model.size == parts.size
    order = [made.model.dofs.index(label) for label in parts.dofs]
    for one, other in zip(dense(made.model), dense(parts), strict=True):
        np.testing.assert_allclose(one[np.ix_(order, order)], other, atol=1e-9 * np.abs(other).max())


def test_a_rigid_point_moves_with_the_part_that_is_reduced():
    _, root, tip = half_beams()
    parts = assembled_parts({"root": root, "tip": tip})
    nodes = tuple(node for node in parts.nodes.numbers if node.startswith("tip."))
    points = [Point("p", ("root.2",)), Point("q", nodes[:2], "rigid")]
    k = dict.fromkeys(DIRECTIONS, 1e6)
    model, _ = joined(parts, points, PointJoint("tip", ("p", "q"), k), PointJoint("root", ("q",), k))
    whole = PartReduction("craig-bampton", {"modes": ModeRange(count=18)})
    made = reduced(model, {"root": None, "tip": whole})
    assert made.model.size == model.size
    np.testing.assert_allclose(frequencies(made.model, 10), frequencies(model, 10), rtol=1e-9)
    with pytest.raises(UsageError, match=r"the DOF 'root\.\S+' is of no part"):
        reduced(model, {"tip": whole})


def test_node_0_is_held_rigidly_once():
    part, _ = random_part(np.random.default_rng(8), rotations=True)
    dofs = tuple(label.replace("3:", "0:") for label in part.dofs)
    numbers = tuple(0 if number == 3 else number for number in part.nodes.numbers)
    axes = {0 if number == 3 else number: own for number, own in part.nodes.axes.items()}
    part = replace(part, dofs=dofs, nodes=replace(part.nodes, numbers=numbers, axes=axes, sets={}))
    points = [Point("p", (1, 2, 0), "rigid"), Point("q", (0, 4, 5), "rigid")]
    with pytest.raises(UsageError, match="'q' and the point 'p' both hold node 0 rigidly"):
        with_points(part, points)
