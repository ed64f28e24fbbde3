"""Reduction methods: what each reproduces exactly, and what is refused."""

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.linalg import eigvalsh
from scipy.linalg import eigh

from dynid.errors import Singular, UsageError
from dynid.structure.frame import Member, beam, frame
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.model import StructuralModel
from dynid.structure.modes import modes
from dynid.structure.reduction.masters import Masters, chosen
from dynid.structure.reduction.methods import METHODS, reduce
from dynid.structure.reduction.mode_selection import Interest, ModeRange
from tests.structure.systems import FE, harwell_boeing, random_structure, yang_beam


def squares(model, values=None):
    """The finite eigenvalues, ascending, by an oracle: those of the inverted problem."""
    M, _, K = model.with_joints(values)
    inverse = eigh(M, K, eigvals_only=True)[::-1]
    return 1 / inverse[inverse > 1e-10 * inverse.max()]


seeds = st.integers(0, 10**6)
few = settings(max_examples=10, deadline=None)


# --- what each method reproduces exactly ---------------------------------------------------------


@few
@given(seeds, st.integers(0, 3), st.sets(st.integers(1, 6), min_size=1))
def test_serep_has_the_modes_it_was_made_of(seed, massless, numbers):
    model = random_structure(seed, massless=massless)
    made = METHODS["serep"](modes=sorted(numbers)).reduce(model)
    exact = squares(model)[np.array(sorted(numbers)) - 1]
    np.testing.assert_allclose(squares(made.model), exact, rtol=1e-10)
    M, _, K = made.model.with_joints()
    _, shapes = eigh(K, M)
    full = made.model.expand(shapes)
    # As many modes as masters: the residual of the full problem is rounding.
    residual = model.K @ full - model.M @ full * exact
    assert np.abs(residual).max() < 1e-10 * np.abs(model.K).max() * np.abs(full).max()


@few
@given(seeds, st.integers(0, 3))
def test_serep_with_more_masters_than_modes_spans_the_same(seed, massless):
    model = random_structure(seed, massless=massless, joints=(Joint("j", (1, 4), 0.7, 0.1),))
    square = METHODS["serep"](masters=[1, 3, 5], modes=[1, 2, 3]).reduce(model)
    tall = METHODS["serep"](masters=[1, 3, 5, 6, 8], modes=[1, 2, 3]).reduce(model)
    assert tall.model.size == 3  # eq 9 would have a mass of size 5 and rank 3
    assert tall.model.dofs == ("mode_1", "mode_2", "mode_3")
    # Mass and stiffness on the masters hold the inverse of the masters' mode shapes twice.
    lost = np.finfo(float).eps * max(square.condition, tall.condition) ** 2
    np.testing.assert_allclose(squares(tall.model), squares(square.model), rtol=1e-11 + 10 * lost)


def test_the_square_case_is_equation_8():
    model = yang_beam(joints=False)
    U = eigh(model.K, model.M)[1]
    keep = [0, 5, 9]
    expected = U[:, 1:4] @ np.linalg.inv(U[keep, 1:4])
    made = METHODS["serep"](masters=[1, 6, 10], modes=[2, 3, 4]).reduce(model)
    np.testing.assert_allclose(made.T, expected, rtol=1e-9, atol=1e-11)
    np.testing.assert_array_equal(made.T[keep], np.eye(3))
    np.testing.assert_allclose(made.model.M, expected.T @ model.M @ expected, rtol=1e-9)
    np.testing.assert_allclose(made.model.K, expected.T @ model.K @ expected, rtol=1e-8)
    np.testing.assert_allclose(made.model.C, 0.1 * made.model.M, rtol=1e-9)
    assert made.condition == pytest.approx(np.linalg.cond(U[keep, 1:4]), rel=1e-9)


@few
@given(seeds, st.integers(0, 3))
def test_static_condensation_is_exact_at_rest_for_loads_on_masters(seed, massless):
    model = random_structure(seed, massless=massless)
    reduced = reduce(model, "guyan", masters=[2, 3, 7])
    force = np.random.default_rng(seed).standard_normal(3)
    full = np.zeros(model.size)
    full[[1, 2, 6]] = force
    motion = reduced.expand(np.linalg.solve(reduced.K, force))
    np.testing.assert_allclose(motion, np.linalg.solve(model.K, full), rtol=1e-10)


@few
@given(seeds)
def test_static_condensation_keeps_the_mass_of_a_rigid_body(seed):
    grounded = random_structure(seed)
    K = grounded.K - np.diag(grounded.K.sum(axis=1))  # off the ground: rows sum to zero
    reduced = reduce(StructuralModel(grounded.M, grounded.C, K), "guyan", masters=[1, 5])
    assert np.ones(2) @ reduced.M @ np.ones(2) == pytest.approx(np.trace(grounded.M), rel=1e-12)
    np.testing.assert_allclose(reduced.K @ np.ones(2), 0, atol=1e-12 * np.abs(K).max())


@few
@given(seeds, st.integers(0, 3), st.floats(0.1, 3))
def test_dynamic_condensation_is_exact_at_its_frequency(seed, massless, omega):
    model = random_structure(seed, massless=massless)
    reduced = reduce(model, "dynamic", masters=[2, 3, 7], frequency=omega)
    full = model.K - omega**2 * model.M
    keep, rest = [1, 2, 6], [0, 3, 4, 5, 7, 8]
    inner = full[np.ix_(rest, rest)]
    schur = full[np.ix_(keep, keep)] - full[np.ix_(keep, rest)] @ np.linalg.solve(
        inner, full[np.ix_(rest, keep)]
    )
    # Loses digits where the slaves are near a resonance of their own.
    assert (
        np.abs(reduced.K - omega**2 * reduced.M - schur).max()
        < 1e-13 * np.linalg.cond(inner) ** 2 * np.abs(full).max()
    )


@pytest.mark.parametrize("method", ["guyan", "irs", "craig-bampton", "serep"])
def test_a_free_structure_stays_free(method):
    from dynid.structure.modes import modes

    K = 1e9 * (np.diag([1.0, 2, 2, 2, 1]) - np.eye(5, k=1) - np.eye(5, k=-1)) / 3
    model = StructuralModel(np.eye(5), np.zeros((5, 5)), K)
    options = {} if method in ("guyan", "irs") else {"modes": [1]}
    assert modes(*reduce(model, method, masters=[4], **options).with_joints()).rigid == 1


def test_dynamic_condensation_has_the_frequency_it_is_made_at():
    model = yang_beam(joints=False)
    exact = np.sqrt(squares_of_free(model)[2])
    reduced = reduce(model, "dynamic", masters=[1, 6, 10], frequency=exact)
    found = np.sqrt(np.abs(eigh(reduced.K, reduced.M, eigvals_only=True)))
    assert np.abs(found / exact - 1).min() < 1e-10


def squares_of_free(model):
    return eigh(model.K, model.M, eigvals_only=True)


@settings(max_examples=3, deadline=None)
@given(seeds, st.integers(0, 2))
def test_iterated_irs_converges_to_serep_on_the_lowest_modes(seed, massless):
    model = random_structure(seed, massless=massless)
    masters = METHODS["serep"](masters=Masters(3)).reduce(model).masters
    exact = squares(model)[:3]
    once = squares(reduce(model, "irs", masters=masters))
    static = squares(reduce(model, "guyan", masters=masters))
    often = METHODS["irs"](masters=masters, iterations=400).reduce(model)
    assert once[0] - exact[0] <= (static[0] - exact[0]) * (1 + 1e-6) + 1e-12
    if squares(model)[3] > 1.2 * exact[-1]:  # it converges like the ratio of these
        np.testing.assert_allclose(squares(often.model), exact, rtol=1e-8)
        serep = METHODS["serep"](masters=masters).reduce(model)
        np.testing.assert_allclose(often.T, serep.T, atol=1e-6 * np.abs(serep.T).max())


@few
@given(seeds, st.integers(0, 3))
def test_craig_bampton_with_all_modes_is_exact_and_with_none_is_static(seed, massless):
    joints = (Joint("a", (2, 3), 0.4), Joint("b", (7,), 1.3))
    model = random_structure(seed, massless=massless, joints=joints)
    inner = model.size - 3 - min(massless, 2)  # DOF 7, a master, is the third without mass
    everything = reduce(model, "craig-bampton", masters=[2, 3, 7], modes=ModeRange(count=inner))
    np.testing.assert_allclose(squares(everything), squares(model), rtol=1e-9)
    nothing = reduce(model, "craig-bampton", masters=[2, 3, 7], modes=ModeRange(count=0))
    np.testing.assert_array_equal(nothing.K, reduce(model, "guyan", masters=[2, 3, 7]).K)
    some = [
        squares(reduce(model, "craig-bampton", masters=[2, 3, 7], modes=ModeRange(count=count)))[:3]
        for count in range(inner + 1)
    ]
    # Ritz values from above, and a larger basis is no worse.
    assert all(np.all(b <= a * (1 + 1e-10)) for a, b in pairwise(some))


@few
@given(seeds, st.integers(0, 3), st.floats(0.01, 100), st.floats(0.01, 100))
def test_joint_aware_is_exact_where_it_is_made_and_right_to_first_order(seed, massless, k, other):
    joints = (Joint("a", (2, 9), JointParameter(start=1.0)), Joint("b", (7,), other, 0.1))
    model = random_structure(seed, massless=massless, joints=joints)
    values = {"a.k": k}
    made = METHODS["joint-aware"](modes=[1, 2, 3, 4], values=values).reduce(model)
    assert [unknown.name for unknown in made.model.unknowns] == ["a.k"]
    np.testing.assert_allclose(squares(made.model, values), squares(model, values)[:4], rtol=1e-9)
    moved = [squares(one, {"a.k": k * 1.0001})[:4] for one in (made.model, model)]
    change = np.abs(moved[1] / squares(model, values)[:4] - 1).max()
    # The error is of second order in the change, which is at most 1e-4 here.
    np.testing.assert_allclose(moved[0], moved[1], rtol=1e-2 * change + 1e-9)
    again = METHODS["joint-aware"](modes=[1, 2, 3, 4], values=values).at({"a.k": 3 * k}).reduce(model)
    np.testing.assert_allclose(
        squares(again.model, {"a.k": 3 * k}), squares(model, {"a.k": 3 * k})[:4], rtol=1e-9
    )


@few
@given(seeds, st.integers(0, 3), st.sampled_from([[1, 2], [5], [3, 6]]))
def test_residual_vectors_make_the_modal_model_exact_at_rest(seed, massless, modes):
    model = random_structure(seed, massless=massless, joints=(Joint("j", (2, 9), JointParameter(start=3.0)),))
    values = {"j.k": 3.0}
    reduced = reduce(model, "modal", modes=modes, interest=Interest((4,)))
    assert reduced.size == len(modes) + 3  # the modes, and what loads at 2, 9 and 4 do besides
    truth, found = np.linalg.inv(model.with_joints(values)[2]), np.linalg.inv(reduced.with_joints(values)[2])
    for a in (2, 9, 4):
        for b in (2, 9, 4):
            compliance = reduced.row(a) @ found @ reduced.row(b)
            assert compliance == pytest.approx(truth[a - 1, b - 1], rel=1e-9)


def test_residual_vectors_hold_a_free_structure_too():
    beam = yang_beam(joints=False)  # pinned: it turns freely
    joints = (Joint("root", (1,), JointParameter(start=5e3)), Joint("tip", (10,), JointParameter(start=1e4)))
    model = StructuralModel(beam.M, beam.C, beam.K, joints)
    values = {"root.k": 5e3, "tip.k": 1e4}
    reduced = reduce(model, "modal", modes=[1, 2, 3, 4])
    exact, found = np.sqrt(squares(model, values)[:3]), np.sqrt(squares(reduced, values)[:3])
    np.testing.assert_allclose(found, exact, rtol=1e-3)
    bare = reduce(model, "modal", modes=[1, 2, 3, 4], residuals=())
    assert np.abs(np.sqrt(squares(bare, values)[:3]) / exact - 1).min() > 0.05


def test_residual_vectors_make_a_joint_aware_basis_right_far_from_where_it_is_made():
    joints = (Joint("root", (1,), JointParameter(start=5e3)), Joint("tip", (10,), JointParameter(start=1e4)))
    model = yang_beam(joints=False).joined(joints)
    here, there = {"root.k": 2.5e3, "tip.k": 5e3}, {"root.k": 5e3, "tip.k": 1e4}
    with_residuals = {"modes": [1, 2, 3, 4, 5], "residuals": "auto", "interest": Interest((6,))}
    made = METHODS["joint-aware"](**with_residuals, values=here).reduce(model)
    assert made.model.dofs[5:] == ("residual_1", "residual_2", "residual_3")
    assert made.masters == ()
    np.testing.assert_allclose(squares(made.model, here)[:5], squares(model, here)[:5], rtol=1e-9)
    bare = METHODS["joint-aware"](modes=ModeRange(count=8), values=here).reduce(model)
    exact = np.sqrt(squares(model, there)[:3])
    error, plain = (np.abs(np.sqrt(squares(one.model, there)[:3]) / exact - 1).max() for one in (made, bare))
    assert error < 1e-5
    assert plain > 20 * error  # as many coordinates
    with pytest.raises(UsageError, match="there are no masters") as caught:
        METHODS["joint-aware"](masters=[1, 2], residuals=[1])
    assert caught.value.names == ("residuals",)


def test_residual_vectors_that_move_no_mass_are_massless():
    K = np.diag([2.0, 2, 2, 1]) - np.eye(4, k=1) - np.eye(4, k=-1)
    joints = (Joint("j", (2, 3), 1.0, m=[[0, 0], [0, 2.0]]),)
    model = StructuralModel(np.diag([1.0, 0, 0, 0]), np.zeros((4, 4)), K, joints)
    from dynid.structure.modes import modes

    reduced = reduce(model, "modal", modes=[1, 2], interest=Interest((4,)))  # two modes are all it has
    assert reduced.size > 2
    found = modes(*reduced.with_joints())
    np.testing.assert_allclose(found.omega**2, squares(model), rtol=1e-9)
    assert found.massless == reduced.size - 2


@pytest.mark.parametrize("method", METHODS)
def test_joints_stay_unknown_and_every_dof_stays_readable(method):
    joints = (Joint("a", (1, 4), JointParameter(start=1.0, true=2.0), JointParameter(start=0.1)),)
    model = random_structure(3, joints=joints)
    options = {"frequency": 0.5} if method == "dynamic" else {}
    options |= {"modes": [1, 2, 3]} if method in ("serep", "modal", "joint-aware", "craig-bampton") else {}
    made = METHODS[method](**options).reduce(model)
    reduced, T = made.model, made.T
    assert [unknown.name for unknown in reduced.unknowns] == ["a.k", "a.c"]
    direction = T[0] - T[3]
    np.testing.assert_allclose(reduced.joint_terms[0].matrix, np.outer(direction, direction), atol=1e-14)
    for dof in range(1, 10):
        np.testing.assert_allclose(reduced.row(dof), T[dof - 1], atol=1e-14)
    values = {"a.k": 2.0, "a.c": 0.3}
    for small, large in zip(reduced.with_joints(values), model.with_joints(values), strict=True):
        np.testing.assert_allclose(small, T.T @ large @ T, atol=1e-12)
    q = np.random.default_rng(0).standard_normal(reduced.size)
    np.testing.assert_array_equal(reduced.expand(q), T @ q)


@pytest.mark.parametrize(
    "method", ["serep", "guyan", "irs", "craig-bampton", "modal", "joint-aware", "dynamic"]
)
def test_sparse_and_dense_structures_reduce_alike(method):
    from scipy.sparse import csc_array

    dense = random_structure(8, n=40, joints=(Joint("j", (1, 30), 2.0),))
    sparse = StructuralModel(csc_array(dense.M), csc_array(dense.C), csc_array(dense.K), dense.joints)
    options = {"modes": [1, 2, 3]} if method in ("serep", "modal", "joint-aware", "craig-bampton") else {}
    options |= {"frequency": 0.4} if method == "dynamic" else {}
    a, b = (squares(reduce(model, method, **options)) for model in (dense, sparse))
    np.testing.assert_allclose(a, b, rtol=1e-9)


# --- published figures ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "options", "frequencies"),
    [
        ("serep", {"modes": [2, 3, 4]}, [64.4, 231.9, 360.0]),
        ("guyan", {}, [58.0, 149.8, 442.3]),
        ("craig-bampton", {"modes": ModeRange(count=2)}, [50.38, 96.61, 223.77]),
        ("joint-aware", {}, [50.35, 96.15, 220.69]),
    ],
)
def test_the_beam_with_joints_has_the_published_frequencies(method, options, frequencies):
    reduced = reduce(yang_beam(), method, masters=[1, 6, 10], **options)
    digits = 0.05 if method in ("serep", "guyan") else 0.005
    np.testing.assert_allclose(np.sqrt(squares(reduced)[:3]), frequencies, atol=digits * 1.01)


@pytest.mark.parametrize("number", ["01", "03", "08"])
@pytest.mark.parametrize("count", [4, 12])
def test_serep_reproduces_the_modes_of_real_matrices(number, count):
    model = harwell_boeing(number)
    exact = json.loads((FE / "eigenvalues.json").read_text())[f"bcsstk{number}/bcsstm{number}"][
        "lowest_lambda"
    ]
    for choose in ("qr", "effective-independence"):
        made = METHODS["serep"](masters=Masters(choose=choose), modes=ModeRange(count=count)).reduce(model)
        assert made.condition < 100
        np.testing.assert_allclose(
            eigh(made.model.K, made.model.M, eigvals_only=True), exact[:count], rtol=1e-10
        )
        assert len(made.masters) == count


def test_the_largest_masses_see_the_modes_badly():
    by_mass = {"masters": Masters(choose="mass"), "modes": ModeRange(count=8)}
    assert METHODS["serep"](**by_mass).reduce(harwell_boeing("01")).condition > 1e5
    assert METHODS["serep"](**by_mass).reduce(harwell_boeing("03")).condition > 1e4
    with pytest.raises(Singular, match=r"invisible at the 8 masters .* \(condition"):
        METHODS["serep"](**by_mass).reduce(harwell_boeing("08"))


# --- choice and refusal --------------------------------------------------------------------------


def test_masters_come_from_joints_sensors_and_loads_and_are_completed():
    model = yang_beam()
    assert METHODS["guyan"](interest=Interest((6,))).reduce(model).masters == (1, 10, 6)
    made = METHODS["serep"](modes=ModeRange(count=5), interest=Interest((6,))).reduce(model)
    assert {1, 6, 10} <= set(made.masters)
    assert len(made.masters) == 5
    assert made.condition < 100
    assert METHODS["serep"]().reduce(model).masters == (1, 10)  # one mode a joint's end
    with pytest.raises(UsageError, match="nothing says which modes to keep"):
        METHODS["serep"]().reduce(yang_beam(joints=False))
    assert METHODS["serep"](interest=Interest(band=50.0)).reduce(model).modes == (1, 2, 3)  # below 250 rad/s


def test_more_masters_are_chosen_than_there_are_modes():
    model = random_structure(1)
    for choose in ("qr", "effective-independence"):
        made = METHODS["serep"](masters=Masters(6, choose), modes=[1, 2, 3]).reduce(model)
        assert len(set(made.masters)) == 6
        assert made.condition < 3


def test_effective_independence_drops_what_adds_least():
    # Two modes on five DOFs; DOF 3 repeats a small part of DOF 1, DOF 5 sees nothing.
    shapes = np.array([[2.0, 0.0], [0.0, 1.0], [0.5, 0.0], [1.0, 1.0], [0.0, 0.0]])
    from dynid.structure.reduction.masters import chosen

    mass = np.array([1.0, 5.0, 3.0, 2.0, 9.0])
    assert set(chosen("effective-independence", 3, shapes, mass)) == {0, 1, 3}
    assert chosen("mass", 2, shapes, mass).tolist() == [1, 4]
    rng = np.random.default_rng(5)
    large = rng.standard_normal((2500, 4))
    kept = chosen("effective-independence", 6, large, np.ones(2500))
    # Of these rows six random ones have a determinant this good once in a thousand times.
    trials = [
        np.linalg.slogdet(large[rows].T @ large[rows])[1]
        for rows in (rng.choice(2500, 6) for _ in range(1000))
    ]
    assert np.linalg.slogdet(large[kept].T @ large[kept])[1] > max(trials)


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"masters": [1, 6, 6]}, UsageError, r"DOF 6 stands twice among the masters"),
        ({"masters": [1, 99]}, UsageError, r"there is no DOF 99"),
        ({"masters": []}, UsageError, r"the masters name no DOF"),
        (
            {"masters": [1, 6], "modes": [1, 2, 3]},
            UsageError,
            r"3 modes are more than 2 masters can tell apart",
        ),
        ({"masters": [1], "modes": [16]}, UsageError, r"16 modes are asked for, but the structure has 15"),
        ({"masters": [1, 2], "modes": [2, 2]}, UsageError, r"the mode 2 is named twice"),
        ({"masters": [1, 2], "modes": [0, 2]}, UsageError, r"there is no mode 0"),
        ({"masters": [1, 2], "modes": []}, UsageError, r"no modes are given"),
        (
            {"masters": Masters(choose="mass", count=20)},
            UsageError,
            r"20 modes are asked for",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(options, error, said):
    with pytest.raises(error, match=said) as caught:
        reduce(yang_beam(), "serep", **options)
    assert caught.value.names[0] in ("masters", "modes")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Masters(0), "at least one master is needed"),
        (lambda: Masters(2, "luck"), "masters cannot be chosen by 'luck'. Use one of qr,"),
        (ModeRange, "by their 'count' or as those 'below' a frequency"),
        (lambda: ModeRange(2, 3.0), "by their 'count' or as those 'below' a frequency"),
        (lambda: ModeRange(-1), "a number of modes is not negative"),
        (lambda: ModeRange(below=0.0), "the frequency below which modes are kept must be positive"),
        (lambda: ModeRange(below=np.inf), "the frequency below which modes are kept must be positive"),
        (lambda: METHODS["irs"](iterations=0), "IRS takes at least one iteration"),
        (
            lambda: chosen("effective-independence", 1, np.eye(4)[:, :2], np.ones(4)),
            "1 master cannot tell 2 modes apart",
        ),
        (lambda: reduce(unjoined(), "guyan"), "nothing says which DOFs are masters"),
    ],
)
def test_masters_and_modes_that_say_nothing_are_refused(make, said):
    with pytest.raises(UsageError, match=said):
        make()


def unjoined():
    return StructuralModel(
        np.diag([3.0, 1, 2]), np.zeros((3, 3)), 2 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1)
    )


def test_the_largest_masses_need_no_modes_and_all_masters_leave_nothing_out():
    made = METHODS["guyan"](masters=Masters(2, "mass")).reduce(unjoined())
    assert list(made.masters) == [1, 3]
    whole = reduce(unjoined(), "guyan", masters=[1, 2, 3])
    np.testing.assert_array_equal(whole.K, unjoined().K)


def test_the_middle_of_the_band_is_where_dynamic_condensation_is_exact():
    band = METHODS["dynamic"](masters=[1, 3], interest=Interest(band=0.6)).reduce(unjoined())
    given = METHODS["dynamic"](frequency=0.3, masters=[1, 3]).reduce(unjoined())
    np.testing.assert_array_equal(band.model.K, given.model.K)


def test_a_mode_invisible_at_the_masters_is_named():
    # Two chains that share nothing: the modes of one cannot be seen in the other.
    K = np.kron(np.eye(2), [[2.0, -1.0], [-1.0, 1.0]]) * np.repeat([1.0, 3.0], 2)[:, None]
    model = StructuralModel(np.eye(4), np.zeros((4, 4)), K)
    with pytest.raises(Singular, match=r"mode 2 is invisible at the 2 masters 1, 2 \(condition") as caught:
        reduce(model, "serep", masters=[1, 2], modes=[1, 2])
    assert "choose: qr" in caught.value.remedy
    assert eigvalsh(reduce(model, "serep", masters=[1, 3], modes=[1, 2]).K).min() > 0


def test_slaves_that_move_freely_or_resonate_are_refused():
    K = np.kron(np.eye(2), [[1.0, -1.0], [-1.0, 1.0]])
    model = StructuralModel(np.eye(4), np.zeros((4, 4)), K)
    for method in ("guyan", "irs", "craig-bampton"):
        with pytest.raises(Singular, match="the slaves move freely while the masters are held"):
            METHODS[method](masters=[1, 2], interest=Interest(band=1.0)).reduce(model)
    with pytest.raises(Singular, match=r"the slaves resonate at 1 rad/s"):
        reduce(model, "dynamic", masters=[1, 3], frequency=1.0)
    with pytest.raises(UsageError, match="needs the frequency"):
        reduce(model, "dynamic", masters=[1, 3])
    light = StructuralModel(np.diag([1.0, 0, 0, 0]), np.zeros((4, 4)), K + np.eye(4))
    with pytest.raises(Singular, match="masters can move without inertia"):
        reduce(light, "irs", masters=[1, 3])


def test_an_unknown_method_is_told_the_names():
    with pytest.raises(UsageError, match="did you mean 'guyan'"):
        reduce(yang_beam(), "guyen")


@pytest.mark.parametrize("EI", [1e2, 1e4, 1e6])
@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("modal", {"modes": ModeRange(count=8), "residuals": ()}),
        ("modal", {"modes": ModeRange(count=8)}),
        ("joint-aware", {"modes": ModeRange(count=4), "masters": ["w_1", "w_2", "w_3", "w_4", "w_5"]}),
        ("joint-aware", {"modes": ModeRange(count=6), "residuals": "auto"}),
    ],
)
def test_a_body_that_turns_about_its_joint_does_so_freely_on_its_modes_too(EI, method, options):
    # The joint's rounding in the rigid mode is no stiffness, beside which all others would be infinite.
    model = beam(4, 4.0, EI, 0.5, joints=[Joint("pivot", ("w_3",), 313.2, 9.0)])
    M, _, K = model.with_joints()
    exact = np.sqrt(np.maximum(eigh(K, M, eigvals_only=True), 0))
    reduced = reduce(model, method, **options)
    found = modes(*reduced.with_joints())
    assert (found.rigid, found.omega[0], len(found.omega)) == (1, 0.0, reduced.size)
    count = options["modes"].count
    np.testing.assert_allclose(found.omega[1:count], exact[1:count], rtol=1e-8)


@pytest.mark.parametrize("seed", range(16))
def test_bodies_that_turn_freely_about_a_joint_have_the_modes_of_the_structure(seed):
    """The strain energy of a rigid-body motion is rounding, and so is its coupling to the other modes."""
    rng = np.random.default_rng(seed)
    count, EI = int(rng.integers(3, 8)), float(10 ** rng.uniform(0, 8))
    k = float(10 ** rng.uniform(1, 5))
    joints = [Joint("pivot", (f"w_{rng.integers(1, count + 2)}",), k, 0.01 * k)]
    model = beam(count, float(rng.uniform(0.5, 8)), EI, float(rng.uniform(0.1, 5)), joints=joints)
    full = modes(*model.with_joints())
    kept = int(rng.integers(2, 2 * count))
    methods = [("modal", {"residuals": ()}), ("modal", {}), ("joint-aware", {"residuals": "auto"})]
    for method, options in methods:
        found = modes(*reduce(model, method, modes=ModeRange(count=kept), **options).with_joints())
        assert (found.rigid, found.omega[0]) == (1, 0.0)
        wrong = np.abs(found.omega[:kept] - full.omega[:kept])
        assert np.all(wrong <= 1e-9 * full.omega[:kept] + 3 * full.uncertainty[:kept])


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("guyan", {}),
        ("irs", {"iterations": 1}),
        ("irs", {"iterations": 2}),
        ("craig-bampton", {"modes": ModeRange(count=3)}),
        ("joint-aware", {"modes": ModeRange(count=7)}),
    ],
)
def test_a_master_that_moves_all_as_a_rigid_body_strains_no_joint(method, options):
    # Of the frame, free to slide: u of all follows u_6, and the joint's own DOFs do so by rounding alone.
    heights = [0.35280827892659583, 0.3383978762520954, 0.12967617953061406]
    members = [
        Member((1, 2), 1e5, 52.9059727299273, 0.7, elements=2),
        Member((2, 3), 1e5, 15.956684536035205, 0.7, elements=3),
    ]
    joints = [
        Joint("ground", ("theta_5",), 286.81454422996336, None, 0.2),
        Joint("link", ("theta_3", "w_2"), 2166.869580888279, 10.5, 0.8),
    ]
    model = frame([(float(x), y) for x, y in enumerate(heights)], members, joints=joints)
    masters = [model.dofs[k - 1] for k in (3, 6, 9, 15, 16, 17, 18)]
    reduction = reduce(model, method, masters=masters, **options)
    M, _, K = model.dense()
    T = reduction.basis.T
    exact = np.sqrt(eigh(T.T @ K @ T, T.T @ M @ T, eigvals_only=True)[1:])
    found = modes(*reduction.with_joints())
    assert (found.rigid, found.omega[0], len(found.omega)) == (1, 0.0, reduction.size)
    np.testing.assert_allclose(found.omega[1:], exact, rtol=1e-8)
