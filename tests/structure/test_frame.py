"""Plane frames: exact frequencies, invariance, hinges."""

import numpy as np
import pytest
from scipy.linalg import eigh

from dynid.errors import UsageError
from dynid.structure.assembly import PointMass, Spring, Support
from dynid.structure.frame import Member, frame

PORTAL = [(0.0, 0.0), (0.0, 3.0), (4.0, 3.0), (4.0, 0.0)]
BENT = {"EA": 5e6, "EI": 2e3, "rhoA": 4.0}
ALL = ("u", "w", "theta")


def members(*pairs, elements=4, **more):
    return [Member(pair, **BENT, elements=elements, **more) for pair in pairs]


def frequencies(model):
    M, _, K = model.dense()
    return np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0.0))


def test_an_inclined_cantilever_bends_and_stretches_as_the_continuous_one():
    tip = 2.0 * np.array([np.cos(0.7), np.sin(0.7)])
    model = frame([(0, 0), tuple(tip)], members((1, 2), elements=16), supports=[Support(1, ALL)])
    assert model.size == 48
    bending = np.array([1.875104068711961, 4.694091132974174, 7.854757438237613]) ** 2 * np.sqrt(2e3 / 4) / 4
    stretching = np.pi / 2 / 2.0 * np.sqrt(5e6 / 4)
    found = frequencies(model)
    np.testing.assert_allclose(found[:3], bending, rtol=1e-4)
    assert np.min(np.abs(found / stretching - 1)) < 1e-3  # bars converge as h^2


def test_turning_a_frame_changes_nothing_and_a_free_one_has_three_rigid_modes():
    turn = np.array([[np.cos(1.1), -np.sin(1.1)], [np.sin(1.1), np.cos(1.1)]])
    turned = [tuple(turn @ point) for point in PORTAL]
    parts = members((1, 2), (2, 3), (3, 4))
    one, other = frequencies(frame(PORTAL, parts)), frequencies(frame(turned, parts))
    assert np.all(one[:3] < 1e-3 * one[3])
    np.testing.assert_allclose(other[3:], one[3:], rtol=1e-9)
    motion = frame(PORTAL, parts)
    assert motion.dofs[:3] == ("u_1", "w_1", "theta_1")
    rotation = np.zeros(motion.size)
    corners = [motion.index(f"{direction}_{node}") for node in range(1, 5) for direction in ALL]
    rotation[corners] = np.array([(-y, x, 1.0) for x, y in PORTAL]).ravel()
    inner = [place for place in range(motion.size) if place not in corners]
    rotation[inner] = np.linalg.solve(motion.K[np.ix_(inner, inner)], -motion.K[inner] @ rotation)
    assert np.abs(motion.K @ rotation).max() < 1e-12 * np.abs(motion.K).max()


def test_hinges_at_both_ends_make_a_pinned_beam():
    both = frame([(0, 0), (2.0, 0)], members((1, 2), elements=12, hinges=(1, 2)), supports=[
        Support(1, ("u", "w")), Support(2, ("u", "w"))
    ])  # fmt: skip
    assert "theta_1" not in both.dofs  # nothing carries it
    exact = (np.arange(1, 4) * np.pi / 2) ** 2 * np.sqrt(2e3 / 4)
    found = frequencies(both)
    np.testing.assert_allclose(found[:3], exact, rtol=6e-4)
    pinned = frame([(0, 0), (2.0, 0)], members((1, 2), elements=12), supports=[
        Support(1, ("u", "w")), Support(2, ("u", "w"))
    ])  # fmt: skip
    np.testing.assert_allclose(found[:3], frequencies(pinned)[:3], rtol=6e-4)


def test_a_hinge_passes_force_but_no_moment():
    """A two-span beam, clamped left, hinged in the middle: the tip hangs on the hinge."""
    model = frame(
        [(0, 0), (1, 0), (2, 0)],
        [Member((1, 2), **BENT), Member((2, 3), **BENT, hinges=(1,))],
        supports=[Support(1, ALL), Support(3, ("w", "theta"))],
    )
    deflection = np.linalg.solve(model.K, model.row("w_2")) @ model.row("w_2")
    assert deflection == pytest.approx(1 / (2 * 3 * 2e3), rel=1e-12)  # two cantilevers in parallel


def test_masses_and_springs_at_nodes():
    parts = members((1, 2), elements=1)
    points = [(0.0, 0.0), (1.0, 0.0)]
    bare = frame(points, parts)
    model = frame(points, parts, masses=[PointMass(2, 3.0, 0.5)], springs=[Spring(1, "u", 9.0, 0.2)])
    np.testing.assert_allclose(np.diag(model.M - bare.M), [0, 0, 0, 3, 3, 0.5], atol=1e-12)
    np.testing.assert_allclose(np.diag(model.K - bare.K), [9, 0, 0, 0, 0, 0], atol=1e-8)
    np.testing.assert_array_equal(np.diag(model.C), [0.2, 0, 0, 0, 0, 0])


@pytest.mark.parametrize(
    ("nodes", "parts", "said"),
    [
        (PORTAL, members((1, 2), (2, 3)), "node 4 belongs to no member"),
        (PORTAL[:2], members((1, 3)), "a member names node 3"),
        (PORTAL[:2], members((1, 1)), "has no length"),
        (PORTAL[:2], [Member((1, 2), 0.0, 1.0, 1.0)], "must be positive"),
        (PORTAL[:2], [Member((1, 2), 1.0, 1.0, -1.0)], "rhoA of a member"),
        (PORTAL[:2], members((1, 2), elements=0), "at least one element"),
        (PORTAL[:2], members((1, 2), hinges=(3,)), "ends 1 and 2"),
    ],
)
def test_nonsense_frames_are_refused(nodes, parts, said):
    with pytest.raises(UsageError, match=said):
        frame(nodes, parts)
