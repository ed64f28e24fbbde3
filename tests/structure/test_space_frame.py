"""Frames in three dimensions: closed forms, invariance, offsets, releases, unknown parameters."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from dynid.errors import UsageError
from dynid.structure.assembly import Spring, Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import Member, frame
from dynid.structure.space_frame import RigidMass, SpaceMember, space_frame
from tests.structure.dependent import assert_as_built, bent, unknowns

ALL = ("x", "y", "z", "rx", "ry", "rz")
BAR = {"EA": 5e6, "EIy": 2e3, "EIz": 7e3, "GJ": 1.5e3, "rhoA": 4.0, "rhoJ": 3e-3}
STRAIGHT = np.eye(3)
CLAMPED = [Support(1, ALL)]
LEG = np.array([1.9, 1.6, -0.2])  # the third leg's end off its node
TRIPOD = [(0.0, 0, 0), (2.0, 0, 0.3), (1.9, 1.7, -0.2), (0.5, 0.4, 2.1), (0.5, 0.4, 3.0)]


def tripod(turn=STRAIGHT, **more):
    """Three legs and a vertical mast with an offset; everything turned."""
    parts = [
        SpaceMember(ends, **BAR, elements=2, orientation=tuple(turn @ beside), offsets=(
            tuple(turn @ np.array(offset)), (0.0, 0.0, 0.0)
        ))
        for ends, beside, offset in (
            ((1, 4), [0.0, 1, 0], [0.1, 0.2, 0.05]),
            ((2, 4), [1.0, 1, 0], [0.0, 0, 0]),
            ((3, 4), [0.0, 0, 1], [0.0, -0.1, 0]),
            ((4, 5), [1.0, 2, 0], [0.0, 0, 0]),
        )
    ]  # fmt: skip
    return space_frame([tuple(turn @ np.array(point)) for point in TRIPOD], parts, **more)


def rigid(nodes):
    """Motions (6 a node x 6) of nodes with a rigid body: three displacements, three rotations."""
    rows = []
    for x, y, z in nodes:
        lever = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        rows.append(np.block([[np.eye(3), lever], [np.zeros((3, 3)), np.eye(3)]]))
    return np.vstack(rows)


def response(model, dof):
    """Deflection under a unit force."""
    force = np.zeros(model.size)
    force[model.index(dof)] = 1.0
    return dict(zip(model.dofs, np.linalg.solve(model.K, force), strict=True))


def frequencies(model):
    return np.sqrt(np.maximum(eigh(model.K, model.M, eigvals_only=True), 0.0))


@pytest.mark.parametrize("elements", [1, 3])
def test_a_cantilever_along_x_deflects_as_in_the_textbook(elements):
    L = 1.6
    model = space_frame([(0.0, 0, 0), (L, 0, 0)], [SpaceMember((1, 2), **BAR, elements=elements)],
                        supports=CLAMPED)  # fmt: skip
    exact = {
        "2:x": {"2:x": L / 5e6},
        "2:rx": {"2:rx": L / 1.5e3},
        "2:y": {"2:y": L**3 / 3 / 7e3, "2:rz": L**2 / 2 / 7e3},
        "2:z": {"2:z": L**3 / 3 / 2e3, "2:ry": -(L**2) / 2 / 2e3},
        "2:ry": {"2:ry": L / 2e3, "2:z": -(L**2) / 2 / 2e3},
        "2:rz": {"2:rz": L / 7e3, "2:y": L**2 / 2 / 7e3},
    }
    for dof, wanted in exact.items():
        found = response(model, dof)
        for other in exact:
            assert found[other] == pytest.approx(wanted.get(other, 0.0), rel=1e-10, abs=1e-18), (dof, other)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_a_turned_frame_has_turned_matrices(seed):
    turn = Rotation.random(random_state=seed).as_matrix()
    one, other = tripod(), tripod(turn)
    T = np.kron(np.eye(2 * (one.size // 6)), turn)
    for letter in "MK":
        straight, turned = getattr(one, letter), getattr(other, letter)
        np.testing.assert_allclose(turned, T @ straight @ T.T, rtol=0, atol=1e-12 * np.abs(straight).max())


def test_a_free_frame_has_six_rigid_body_modes_and_the_mass_of_its_members():
    model = tripod()
    start = np.array([0.1, 0.2, 0.05])
    inner = [
        (start + TRIPOD[3]) / 2, (np.array(TRIPOD[1]) + TRIPOD[3]) / 2,
        (LEG + TRIPOD[3]) / 2, (np.array(TRIPOD[3]) + TRIPOD[4]) / 2,
    ]  # fmt: skip
    R = rigid([*TRIPOD, *inner])
    assert np.abs(model.K @ R).max() < 1e-12 * np.abs(model.K).max()
    assert np.sum(np.linalg.eigvalsh(model.K) < 1e-10 * np.abs(model.K).max()) == 6
    ends = [(start, TRIPOD[3]), (TRIPOD[1], TRIPOD[3]), (LEG, TRIPOD[3]),
            (TRIPOD[3], TRIPOD[4])]  # fmt: skip
    lengths = [np.linalg.norm(np.array(b) - a) for a, b in ends]
    mass = 4.0 * sum(lengths)
    first = sum(4.0 * L * (np.array(a) + b) / 2 for (a, b), L in zip(ends, lengths, strict=True))
    second = np.zeros((3, 3))
    for (a, b), L in zip(ends, lengths, strict=True):
        along = (np.array(b) - a) / L
        for at in (0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)):  # Gauss: exact for squares
            r = np.array(a) + at * L * along
            weight = 4 / 9 if at == 0.5 else 5 / 18
            second += weight * 4.0 * L * (r @ r * np.eye(3) - np.outer(r, r))
        second += 3e-3 * L * np.outer(along, along)
    total = R.T @ model.M @ R
    x, y, z = first
    lever = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    exact = np.block([[mass * np.eye(3), lever], [lever.T, second]])
    np.testing.assert_allclose(total, exact, rtol=0, atol=1e-12 * np.abs(exact).max())


def test_in_its_plane_it_is_the_plane_frame():
    points = [(0.0, 0.0), (0.2, 3.0), (4.0, 3.5)]
    flat = frame(points, [
        Member((1, 2), 5e6, 7e3, 4.0, elements=2, hinges=(2,)), Member((2, 3), 5e6, 7e3, 4.0, elements=3)
    ])  # fmt: skip
    space = space_frame([(x, y, 0.0) for x, y in points], [
        SpaceMember((1, 2), **BAR, elements=2, releases=((), ("rz",))),
        SpaceMember((2, 3), **BAR, elements=3),
    ])  # fmt: skip
    names = {"u": "x", "w": "y", "theta": "rz"}
    rows = [space.index(f"{label.split('_')[1]}:{names[label.split('_')[0]]}") for label in flat.dofs]
    for letter in "MK":
        one, other = getattr(flat, letter), getattr(space, letter)
        np.testing.assert_allclose(other[np.ix_(rows, rows)], one, rtol=0, atol=1e-14 * np.abs(one).max())
        rest = np.delete(other[rows], rows, axis=1)
        assert np.abs(rest).max() < 1e-14 * np.abs(other).max()


def test_without_an_orientation_z_points_up_and_y_of_a_vertical_member_is_the_basic_y():
    level = space_frame([(0.0, 0, 0), (3.0, 4.0, 0)], [SpaceMember((1, 2), **BAR)], supports=CLAMPED)
    assert response(level, "2:z")["2:z"] == pytest.approx(125 / 3 / 2e3, rel=1e-10)  # about y
    upright = space_frame([(0.0, 0, 0), (0, 0, 2.0)], [SpaceMember((1, 2), **BAR)], supports=CLAMPED)
    assert response(upright, "2:y")["2:y"] == pytest.approx(8 / 3 / 7e3, rel=1e-10)  # about z
    assert response(upright, "2:x")["2:x"] == pytest.approx(8 / 3 / 2e3, rel=1e-10)
    turned = space_frame([(0.0, 0, 0), (0, 0, 2.0)], [SpaceMember((1, 2), **BAR, orientation=(3.0, 0, 1.0))],
                         supports=CLAMPED)  # fmt: skip
    assert response(turned, "2:x")["2:x"] == pytest.approx(8 / 3 / 7e3, rel=1e-10)


def test_a_force_on_an_offset_end_bends_the_member():
    L, e = 1.5, 0.2
    member = SpaceMember((1, 2), **BAR, offsets=((0.0, 0.0, e), (0.0, 0.0, e)), elements=2)
    model = space_frame([(0.0, 0, 0), (L, 0, 0)], [member], supports=CLAMPED)
    pulled = response(model, "2:x")
    assert pulled["2:x"] == pytest.approx(L / 5e6 + e**2 * L / 2e3, rel=1e-10)
    assert pulled["2:ry"] == pytest.approx(-e * L / 2e3, rel=1e-10)
    pushed = response(model, "2:y")
    assert pushed["2:rx"] == pytest.approx(e * L / 1.5e3, rel=1e-10)
    assert pushed["2:y"] == pytest.approx(L**3 / 3 / 7e3 + e**2 * L / 1.5e3, rel=1e-10)


def test_unequal_offsets_are_a_member_between_displaced_nodes():
    offsets = ((0.1, -0.3, 0.2), (-0.2, 0.1, 0.4))
    nodes = [(0.0, 0, 0), (2.0, 0.5, 0.3)]
    ends = [tuple(np.add(point, by)) for point, by in zip(nodes, offsets, strict=True)]
    found = space_frame(nodes, [SpaceMember((1, 2), **BAR, offsets=offsets)])
    moved = space_frame(ends, [SpaceMember((1, 2), **BAR)])
    T = np.zeros((12, 12))
    for at, (x, y, z) in enumerate(offsets):
        lever = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        T[6 * at : 6 * at + 6, 6 * at : 6 * at + 6] = np.block([
            [np.eye(3), lever], [np.zeros((3, 3)), np.eye(3)]
        ])  # fmt: skip
    for letter in "MK":
        wanted = T.T @ getattr(moved, letter) @ T
        np.testing.assert_allclose(getattr(found, letter), wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("released", "dof", "exact"),
    [
        ("ry", "2:z", 1 / (2 * 3 * 2e3)),  # two cantilevers side by side
        ("rz", "2:y", 1 / (2 * 3 * 7e3)),
        ("rx", "2:rx", 1 / 1.5e3),  # one of the two alone
        ("x", "2:x", 1 / 5e6),
        ("z", "2:z", (1 / 3 - 1 / 8) / 2e3),  # the second resists the rotation alone, with EI / L
    ],
)
def test_a_release_passes_nothing_in_its_direction(released, dof, exact):
    """Two bars of 1 m, clamped at their far ends, joined in the middle, where the second is released."""
    model = space_frame(
        [(0.0, 0, 0), (1.0, 0, 0), (2.0, 0, 0)],
        [SpaceMember((1, 2), **BAR), SpaceMember((2, 3), **BAR, releases=((released,), ()))],
        supports=[Support(1, ALL), Support(3, ALL)],
    )
    assert response(model, dof)[dof] == pytest.approx(exact, rel=1e-10)


def test_a_truss_has_no_rotations_where_all_members_are_released():
    free = ("ry", "rz")
    points = [(0.0, 0, 0), (1.0, 0, 0), (0.3, 0.9, 0)]
    bars = [SpaceMember(pair, **BAR, releases=(free, free)) for pair in ((1, 2), (2, 3), (1, 3))]
    tilted = [tuple(Rotation.from_rotvec([0.2, 0.3, 0.0]).apply(point)) for point in points]
    with pytest.raises(UsageError, match=r"node 1 rotates freely about \(0.294, -0.196, 0.936\)"):
        space_frame(tilted, bars)
    flat = space_frame(points, bars)
    assert "1:rz" not in flat.dofs
    assert {"1:rx", "1:ry", "1:z"} <= set(flat.dofs)
    stiffness = flat.K[[flat.index(dof) for dof in ("2:x", "2:y")]][
        :, [flat.index(d) for d in ("2:x", "2:y")]
    ]
    lengths = [1.0, np.hypot(0.7, 0.9)]
    along = [np.array([1.0, 0]), np.array([-0.7, 0.9]) / lengths[1]]
    exact = sum(5e6 / L * np.outer(n, n) for n, L in zip(along, lengths, strict=True))
    np.testing.assert_allclose(stiffness, exact, rtol=1e-10)


def test_rotations_that_a_mass_a_spring_or_a_support_carries():
    free = ("ry", "rz")
    members = [SpaceMember((1, 2), **BAR, releases=(("rx", *free), free))]
    held = [Support(1, ("x", "y", "z"))]
    points = [(0.0, 0, 0), (1.0, 0, 0)]
    assert "1:rz" not in space_frame(points, members, supports=held).dofs
    turning = space_frame(points, members, supports=held, springs=[Spring(1, "rz", 9.0, 0.5)])
    assert "1:rz" in turning.dofs
    assert turning.K[turning.index("1:rz"), turning.index("1:rz")] == 9.0
    assert turning.C[turning.index("1:rz"), turning.index("1:rz")] == 0.5
    heavy = space_frame(points, members, supports=held, masses=[RigidMass(1, 0.0, (0.0, 2.0, 0.0))])
    assert "1:ry" in heavy.dofs
    assert "1:rz" not in heavy.dofs


def test_a_rigid_body_off_its_node():
    m, J, offset = 3.0, (0.2, 0.5, 0.9), (0.3, -0.4, 0.7)
    bare = space_frame([(0.0, 0, 0), (1.0, 0, 0)], [SpaceMember((1, 2), **BAR)])
    model = space_frame([(0.0, 0, 0), (1.0, 0, 0)], [SpaceMember((1, 2), **BAR)],
                        masses=[RigidMass(2, m, J, offset)])  # fmt: skip
    r = np.array(offset)
    x, y, z = r
    lever = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    steiner = np.diag(J) + m * (r @ r * np.eye(3) - np.outer(r, r))
    exact = np.block([[m * np.eye(3), m * lever], [m * lever.T, steiner]])
    np.testing.assert_allclose((model.M - bare.M)[6:, 6:], exact, rtol=1e-12, atol=1e-14)
    assert not np.any((model.M - bare.M)[:6])


def test_a_free_beam_vibrates_as_the_continuous_one():
    L = 2.0
    ends = [(0.0, 0, 0), tuple(Rotation.from_rotvec([0.3, -1.1, 0.4]).apply([L, 0, 0]))]
    model = space_frame(ends, [SpaceMember((1, 2), **BAR, elements=40)])
    found = frequencies(model)
    assert np.all(found[:6] < 1e-3 * found[6])
    bending = np.array([4.730040744862704, 7.853204624095838, 10.995607838001671]) ** 2 / L**2
    exact = [
        *(bending * np.sqrt(2e3 / 4)),
        *(bending[:2] * np.sqrt(7e3 / 4)),
        np.pi / L * np.sqrt(1.5e3 / 3e-3),
    ]
    for omega in exact:
        assert np.min(np.abs(found / omega - 1)) < 3e-4, omega


def test_the_default_polar_inertia_is_that_of_a_homogeneous_section():
    rho, E, b, h = 7850.0, 2.1e11, 0.02, 0.03
    A, Iy, Iz = b * h, b * h**3 / 12, h * b**3 / 12
    values = {"EA": E * A, "EIy": E * Iy, "EIz": E * Iz, "GJ": 1e3, "rhoA": rho * A}
    model = space_frame([(0.0, 0, 0), (1.0, 0, 0)], [SpaceMember((1, 2), **values)])
    assert model.M[3, 3] == pytest.approx(rho * (Iy + Iz) / 3, rel=1e-14)


def _spatial(points, members, fixed):
    """M and K of elements (from, to, EA, EIy, EIz, GJ, rhoA, rhoJ, orientation, offsets): complex numbers."""
    n = 6 * len(points)
    M, K = np.zeros((n, n), complex), np.zeros((n, n), complex)
    for a, b, EA, EIy, EIz, GJ, rhoA, rhoJ, v, offsets in members:
        ends = [points[a] + offsets[0], points[b] + offsets[1]]
        d = ends[1] - ends[0]
        L = np.sqrt(d @ d)
        x = d / L
        z = np.cross(x, v)
        z = z / np.sqrt(z @ z)
        R = np.array([x, np.cross(z, x), z])
        k, m = np.zeros((12, 12), complex), np.zeros((12, 12), complex)
        for at, stiff, mass in ((0, EA, rhoA), (3, GJ, rhoJ)):
            ix = np.ix_([at, at + 6], [at, at + 6])
            k[ix] = stiff / L * np.array([[1, -1], [-1, 1]])
            m[ix] = mass * L / 6 * np.array([[2, 1], [1, 2]])
        for places, EI, sign in (([1, 5, 7, 11], EIz, 1), ([2, 4, 8, 10], EIy, -1)):
            kk, mm = bent(EI, rhoA, L)
            flip = np.array([1, sign, 1, sign])
            k[np.ix_(places, places)] = kk * np.outer(flip, flip)
            m[np.ix_(places, places)] = mm * np.outer(flip, flip)
        T = np.zeros((12, 12), complex)
        for at in range(4):
            T[3 * at : 3 * at + 3, 3 * at : 3 * at + 3] = R
        for at, offset in enumerate(offsets):
            rigid = np.eye(12, dtype=complex)
            rigid[6 * at : 6 * at + 3, 6 * at + 3 : 6 * at + 6] = np.cross(np.eye(3), offset).T
            T = T @ rigid
        places = [6 * node + at for node in (a, b) for at in range(6)]
        K[np.ix_(places, places)] += T.T @ k @ T
        M[np.ix_(places, places)] += T.T @ m @ T
    kept = [at for at in range(n) if at not in fixed]
    return M[np.ix_(kept, kept)], K[np.ix_(kept, kept)]


@pytest.mark.thorough
def test_everything_may_be_unknown():
    p, parameters = unknowns(E=3.0, h=1.1, r=0.7, e=0.1, m=2.0, k=30.0)

    def oracle(E, h, r, e, m, k):
        points = [np.array(row) for row in ([0j, 0, 0], [h, 0.2, 0], [h, 0.3, 2 * h])]
        v = np.array([0, 1.0, 0.5])
        none = np.zeros(3, complex)
        members = [
            (0, 1, 5 * E, 2 * E, 3 * E, E, r, r**2, v, (none, np.array([0, e, 2 * e]))),
            (1, 2, 5 * E, 2.0, 3.0, 1.5, 4 * r, 0.3, np.array([1.0, 0, 0]), (none, none)),
        ]
        M, K = _spatial(points, members, range(6))
        r0 = np.array([e, 0, 0.2])
        lever = np.cross(np.eye(3), r0).T
        M[6:9, 6:9] += m * np.eye(3)
        M[6:9, 9:12] += m * lever
        M[9:12, 6:9] += m * lever.T
        M[9:12, 9:12] += m * lever.T @ lever + np.diag([0, 0, h])
        K[2, 2] += k
        C = 0.1 * M + r * K
        C[2, 2] += 2.0
        return M, C, K

    E, r = p["E"], p["r"]
    model = space_frame(
        [(0.0, 0, 0), (p["h"], 0.2, 0), (p["h"], 0.3, 2 * p["h"])],
        [
            SpaceMember((1, 2), 5 * E, 2 * E, 3 * E, E, r, r**2, (0.0, 1.0, 0.5),
                        ((0.0, 0.0, 0.0), (0.0, p["e"], 2 * p["e"]))),
            SpaceMember((2, 3), 5 * E, 2.0, 3.0, 1.5, 4 * r, 0.3, (1.0, 0.0, 0.0)),
        ],
        supports=CLAMPED,
        masses=[RigidMass(3, p["m"], (0.0, 0.0, p["h"]), (p["e"], 0.0, 0.2))],
        springs=[Spring(2, "z", p["k"], 2.0)],
        damping=ProportionalDamping(0.1, r),
        parameters=parameters,
    )  # fmt: skip
    assert_as_built(model, oracle, {"E": 2.2, "h": 1.3, "r": 0.9, "e": -0.2, "m": 1.0, "k": 50.0}, 1e-11)


def test_nodes_are_where_the_rigid_body_modes_say():
    model = tripod()
    assert model.nodes is not None
    motions = model.nodes.rigid(model.dofs)
    assert np.abs(model.K @ motions).max() < 1e-13 * np.abs(model.K).max() * np.abs(motions).max()
    assert len(model.nodes.lines) == 8


def test_one_modulus_is_one_term():
    p, parameters = unknowns(E=3.0)
    E = p["E"]
    members = [
        SpaceMember(ends, 5 * E, 2 * E, 3 * E, E, 1.0, 0.1, elements=3) for ends in ((1, 2), (2, 3), (3, 1))
    ]
    model = space_frame([(0.0, 0, 0), (1.0, 0, 0), (0, 1.0, 1.0)], members, parameters=parameters)
    assert [term.letter for term in model.terms] == ["K"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"nodes": (1, 5)}, "member 1: there is no node 5"),
        ({"nodes": (1, 1)}, "member 1: it has no length"),
        ({"EA": 0.0}, "member 1: EA must be positive"),
        ({"GJ": np.inf}, "member 1: GJ"),
        ({"rhoA": -1.0}, "member 1: rhoA"),
        ({"elements": 0}, "member 1: it needs at least one element"),
        ({"releases": (("w",), ())}, "releases along x, y"),
        ({"releases": (("rx",), ("rx",))}, "member 1: releases leave a member loose"),
        ({"releases": (("y", "rz"), ("y",))}, "member 1: releases leave a member loose"),
        ({"orientation": (2.0, 0.0, 0.0)}, "member 1: its orientation lies along it"),
        ({"offsets": ((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))}, "member 1: it has no length"),
        ({"releases": (("rx", "ry", "rz"), ()), "EA": 1.0}, None),
    ],
)
def test_nonsense_is_refused(change, said):
    member = SpaceMember(**{"nodes": (1, 2), **BAR, **change})
    points = [(0.0, 0, 0), (1.0, 0, 0)]
    if said is None:
        assert "1:rx" not in space_frame(points, [member]).dofs
        return
    with pytest.raises(UsageError, match=said):
        space_frame(points, [member])


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"nodes": [(0.0, 0, 0), (1.0, 0, 0), (2.0, 0, 0)]}, "node 3 belongs to no member"),
        ({"supports": [Support(3, ("x",))]}, "no node 3 for a support"),
        ({"supports": [Support(1, ("w",))]}, "no direction 'w'"),
        ({"masses": [RigidMass(1, -1.0)]}, "the mass or inertia at node 1"),
        ({"springs": [Spring(1, "x", -1.0)]}, "the stiffness at node 1"),
        ({"supports": [Support(1, ALL), Support(2, ALL)]}, "leave nothing to move"),
    ],
)
def test_nonsense_at_nodes_is_refused(more, said):
    given = {"nodes": [(0.0, 0, 0), (1.0, 0, 0)], **more}
    with pytest.raises(UsageError, match=said):
        space_frame(given.pop("nodes"), [SpaceMember((1, 2), **BAR)], **given)
