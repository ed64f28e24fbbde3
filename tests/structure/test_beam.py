"""Beams: exact frequencies of the continuous beam, published structures, damping."""

import numpy as np
import pytest
from scipy.linalg import eigh

from dynid.errors import UsageError
from dynid.structure.assembly import PointMass, Spring, Support
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.joints import Joint
from dynid.structure.modes import modes

YANG = {"elements": 7, "length": 7.0, "EI": 1723.3, "rhoA": 0.1, "supports": [Support(1, ("w",))]}
CLAMPED = Support(1, ("w", "theta"))


def frequencies(model):
    M, _, K = model.dense(model.true_values())
    return np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0.0))


# beta L of the continuous beam: roots of the characteristic equations (Blevins 1979, table 8-1).
@pytest.mark.parametrize(
    ("supports", "rigid", "roots"),
    [
        ([CLAMPED], 0, [1.875104068711961, 4.694091132974174, 7.854757438237613]),
        ([Support(1, ("w",)), Support(-1, ("w",))], 0, [np.pi, 2 * np.pi, 3 * np.pi]),
        ([], 2, [4.730040744862704, 7.853204624095838, 10.99560783800167]),
        ([CLAMPED, Support(-1, ("w", "theta"))], 0, [4.730040744862704, 7.853204624095838]),
        ([CLAMPED, Support(-1, ("w",))], 0, [3.926602312047919, 7.068582745628732]),
        ([Support(1, ("w",))], 1, [3.926602312047919, 7.068582745628732]),
    ],
)
def test_frequencies_converge_to_the_continuous_beam_as_h4(supports, rigid, roots):
    length, EI, rhoA = 2.5, 40.0, 0.3
    exact = np.array(roots) ** 2 * np.sqrt(EI / rhoA) / length**2

    def error(elements):
        held = [Support(item.node % (elements + 2), item.fix) for item in supports]
        found = frequencies(beam(elements, length, EI, rhoA, supports=held))
        assert np.all(found[:rigid] < 1e-5 * exact[0])
        return found[rigid : rigid + len(exact)] / exact - 1

    coarse, fine = error(12), error(24)
    assert np.all(fine > 0)  # a consistent mass bounds from above
    np.testing.assert_allclose(coarse / fine, 16, rtol=0.1)
    assert fine[0] < 1e-5


def test_the_beam_of_yang_with_and_without_its_joints():
    model = beam(**YANG)
    assert model.size == 15
    assert [model.label(dof) for dof in (1, 2, 6, 10)] == ["theta_1", "w_2", "w_4", "w_6"]
    np.testing.assert_allclose(frequencies(model)[1:4], [41.3, 134.0, 280.1], atol=0.07)
    joints = [Joint("turn", ("theta_1",), 5e3), Joint("link", ("w_6",), 1e4, 20.0)]
    np.testing.assert_allclose(frequencies(beam(**YANG, joints=joints))[:3], [50.35, 96.15, 220.7], atol=0.02)


def test_elements_may_differ():
    """A stepped beam is the same whether its steps are elements of their own or several."""
    coarse = beam(2, [1.0, 2.0], [5.0, 3.0], [0.2, 0.1], supports=[CLAMPED])
    fine = beam(6, [0.5] * 6, [5.0, 5.0, 3, 3, 3, 3], [0.2, 0.2, 0.1, 0.1, 0.1, 0.1], supports=[CLAMPED])
    # Deflection under a static tip force is exact with any number of elements.
    tip = [np.linalg.solve(model.K, model.row(dof)) for model, dof in ((coarse, "w_3"), (fine, "w_7"))]
    exact = (3**3 - 2**3) / (3 * 5.0) + 2**3 / (3 * 3.0)
    np.testing.assert_allclose([tip[0] @ coarse.row("w_3"), tip[1] @ fine.row("w_7")], exact, rtol=1e-12)


def test_a_massless_cantilever_with_a_mass_at_its_tip():
    model = beam(3, 2.0, 7.0, 0.0, supports=[CLAMPED], masses=[PointMass(4, m=0.6)])
    assert np.count_nonzero(model.M) == 1
    flexibility = np.linalg.solve(model.K, model.M)
    assert 1 / np.sqrt(np.trace(flexibility)) == pytest.approx(np.sqrt(3 * 7.0 / (0.6 * 2.0**3)), rel=1e-12)


def test_springs_and_masses_stand_at_their_nodes():
    bare = beam(4, 1.0, 1.0, 1.0)
    dressed = beam(
        4, 1.0, 1.0, 1.0,
        masses=[PointMass(2, 3.0, 0.5)], springs=[Spring(5, "w", 7.0, 0.1), Spring(1, "theta", 2.0)],
    )  # fmt: skip
    at = dressed.index
    M, C, K = (np.zeros((10, 10)) for _ in range(3))
    M[at("w_2"), at("w_2")], M[at("theta_2"), at("theta_2")] = 3.0, 0.5
    K[at("w_5"), at("w_5")], K[at("theta_1"), at("theta_1")] = 7.0, 2.0
    C[at("w_5"), at("w_5")] = 0.1
    np.testing.assert_allclose(dressed.M - bare.M, M, atol=1e-12)
    np.testing.assert_allclose(dressed.K - bare.K, K, atol=1e-9)
    np.testing.assert_array_equal(dressed.C, C)


def test_a_long_beam_is_sparse_and_the_same():
    short, long = beam(199, 1.0, 1.0, 1.0), beam(200, 1.0, 1.0, 1.0)
    assert [short.is_sparse, long.is_sparse] == [False, True]
    M, _, K = long.dense()
    exact = 4.730040744862704**2
    assert np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=[2, 2])) == pytest.approx(exact, rel=1e-6)


# --- damping ---------------------------------------------------------------------------------------


def test_proportional_damping():
    model = beam(**YANG, damping=ProportionalDamping(0.1, 2e-4))
    np.testing.assert_allclose(model.C, 0.1 * model.M + 2e-4 * model.K)
    long = beam(300, 1.0, 1.0, 1.0, damping=ProportionalDamping(0.1, 2e-4))
    assert abs(long.C - 0.1 * long.M - 2e-4 * long.K).max() == 0


@pytest.mark.parametrize("ratio", [0.03, [0.5, 0.01, 0.02, 0.03]])
def test_modal_damping_gives_each_mode_its_ratio(ratio):
    model = beam(**YANG, damping=ModalDamping(ratio))
    found = modes(*model.dense()).damping
    wanted = np.full(15, ratio) if isinstance(ratio, float) else np.array(ratio + [0.0] * 11)
    wanted[0] = 0.0  # the rigid-body mode
    np.testing.assert_allclose(found, wanted, atol=1e-8)


def test_modal_damping_beside_massless_dofs():
    model = beam(
        3, 2.0, 7.0, 0.0, supports=[CLAMPED], masses=[PointMass(4, 0.6), PointMass(3, 0.2)],
        damping=ModalDamping([0.02, 0.05]),
    )  # fmt: skip
    mu, shapes = eigh(model.M, model.K)
    omega, shapes = 1 / np.sqrt(mu[:-3:-1]), shapes[:, :-3:-1] / np.sqrt(mu[:-3:-1])
    modal = shapes.T @ model.C @ shapes
    np.testing.assert_allclose(modal, np.diag(2 * np.array([0.02, 0.05]) * omega), atol=1e-9)
    with pytest.raises(UsageError, match="3 damping ratios for 2 modes"):
        ModalDamping([0.1, 0.1, 0.1]).matrix(model.M, model.K)


@pytest.mark.parametrize(
    "change",
    [
        {"elements": 0},
        {"length": 0.0},
        {"length": [1.0, 2.0]},
        {"EI": -1.0},
        {"rhoA": np.nan},
        {"supports": [Support(9, ("w",))]},
        {"supports": [Support(1, ("u",))]},
        {"masses": [PointMass(0, 1.0)]},
        {"masses": [PointMass(1, -1.0)]},
        {"springs": [Spring(1, "x", 1.0)]},
        {"supports": [Support(node, ("w", "theta")) for node in range(1, 9)]},
    ],
)
def test_nonsense_beams_are_refused(change):
    with pytest.raises(UsageError):
        beam(**{**YANG, **change})


@pytest.mark.parametrize(
    "damping", [(ProportionalDamping, -0.1), (ProportionalDamping, 0, np.inf), (ModalDamping, [0.1, -0.1])]
)
def test_nonsense_damping_is_refused(damping):
    kind, *values = damping
    with pytest.raises(UsageError):
        kind(*values)
