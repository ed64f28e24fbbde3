"""Modes that rounding of the stiffness leaves open: computed as well as the matrices tell, and told."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.sparse import csc_array

from dynid.structure.assembly import Support
from dynid.structure.frame import beam
from dynid.structure.lumped import Link, lumped
from dynid.structure.modal_analysis import modal_analysis
from dynid.structure.modes import modes
from dynid.structure.modes.pencil import StrainEnergy
from dynid.structure.reduction.serep import Serep
from dynid.structure.reduction_comparison import compare

# Roots of cos x cosh x = -1, and of cos x cosh x = 1.
CANTILEVER = np.array([1.875104068711961, 4.694091132974175]) ** 2
FREE = np.array([4.730040744862704, 7.853204624095838]) ** 2


@pytest.fixture(scope="module")
def cantilever():
    """So many elements that the first strain energy is below the rounding of its parts."""
    return beam(3000, 1.0, 1.0, 1.0, supports=[Support(1, ("w", "theta"))])


@pytest.mark.parametrize("library", ["auto", "0"])
@pytest.mark.parametrize("sparse", [False, True])
def test_strain_energies_are_those_of_exact_arithmetic(sparse, library, monkeypatch):
    monkeypatch.setenv("DYNID_COMPILED", library)
    rng = np.random.default_rng(5)
    # Differences of neighbours, of random stiffness, and one row that has them all.
    n, springs = 30, rng.uniform(1e6, 1e9, 40)
    K = np.zeros((n, n))
    for k, (i, j) in enumerate([*((i, i + 1) for i in range(n - 1)), *((0, j) for j in range(2, 13))]):
        K[np.ix_([i, j], [i, j])] += springs[k] * np.array([[1, -1], [-1, 1]])
    shape = 1 + 1e-7 * rng.normal(size=n)
    exact = [[Fraction(value) for value in row] for row in K]
    x = [Fraction(value) for value in shape]
    energy = float(sum(x[i] * exact[i][j] * x[j] for i in range(n) for j in range(n)))
    strain = StrainEnergy(csc_array(K) if sparse else K)
    assert strain.energy(shape) == pytest.approx(energy, rel=1e-13, abs=0)
    left, right = np.stack([np.ones(n), shape], axis=1), np.stack([shape, -shape, np.zeros(n)], axis=1)
    work = float(sum(exact[i][j] * x[j] for i in range(n) for j in range(n)))
    gram = [[work, -work, 0.0], [energy, -energy, 0.0]]
    np.testing.assert_allclose(strain.gram(left, right), gram, rtol=1e-13, atol=1e-14 * abs(energy))
    assert shape @ K @ shape != pytest.approx(energy, rel=1e-5)  # which is why


def test_a_mode_below_rounding_is_no_silent_rigid_body(cantilever):
    found = modes(*cantilever.with_joints(), 2)
    assert found.rigid == 0
    np.testing.assert_array_equal(found.undecided, [True, False])
    assert found.uncertainty[0] > 0.1 * found.omega[0]
    assert found.doubt.startswith("nothing tells mode 1 from rigid-body motion")
    # What the entries do tell: those of equal elements are rounded alike.
    np.testing.assert_allclose(found.omega, CANTILEVER, rtol=1e-7)


def test_rigid_bodies_of_many_elements_are_told_from_slow_modes():
    found = modes(*beam(3000, 1.0, 1.0, 1.0).with_joints(), 4)
    assert found.rigid == 2
    assert not found.undecided.any()
    np.testing.assert_array_equal(found.omega[:2], 0)
    np.testing.assert_allclose(found.omega[2:], FREE, rtol=1e-7)


def test_modes_asked_for_alone_are_judged_by_the_next(cantilever):
    found = modes(*cantilever.with_joints(), 1)
    assert (len(found.omega), found.rigid, bool(found.undecided[0])) == (1, 0, True)


@pytest.mark.parametrize(("ground", "doubt"), [(1.0, True), (1e3, False)])
def test_a_frequency_with_few_digits_is_told(ground, doubt):
    found = modes(*lumped([1.0, 1.0], [Link((1,), ground), Link((1, 2), 1e13)]).with_joints())
    np.testing.assert_allclose(found.omega[0], np.sqrt(ground / 2), atol=found.uncertainty[0])
    assert not found.undecided.any()
    assert found.doubt.startswith("rounding of the stiffness leaves the frequency of mode 1 open") is doubt
    assert bool(found.doubt) is doubt


def test_results_carry_the_doubt():
    stiff = lumped([1.0, 1.0, 1.0], [Link((1,), 1.0), Link((1, 2), 1e13), Link((2, 3), 1e13)])
    what = "rounding of the stiffness leaves the frequency of mode 1 open"
    result = modal_analysis(stiff, 2)
    assert result.group_attrs["structure/modes"]["doubt"].startswith(what)
    np.testing.assert_array_equal(result.value("structure/modes/undecided"), [False, False])
    method = Serep(masters=(1, 2), modes=(1, 2))
    assert method.reduce(stiff).doubt.startswith(what)
    assert compare(stiff, {"serep": method}).group_attrs["reduction"]["doubt"].startswith(what)
    sound = modal_analysis(beam(10, 1.0, 1.0, 1.0), 4)
    assert "doubt" not in sound.group_attrs.get("structure/modes", {})
