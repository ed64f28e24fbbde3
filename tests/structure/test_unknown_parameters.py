"""Structures whose quantities are unknown: matrices and derivatives against complex steps of other code."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from dynid.errors import NumericalError, UsageError
from dynid.files.read_matrix import MatrixFile
from dynid.files.read_structure import MatrixPart, imported
from dynid.structure.assembly import PointMass, Spring, Support, assembled_parts, damped_structure
from dynid.structure.damping import ModalDamping, ProportionalDamping
from dynid.structure.excitation import base_slopes, drive
from dynid.structure.frame import Member, beam, frame
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.matrices import DependentMatrix
from dynid.structure.poles import pole_sensitivities
from dynid.structure.ports import Channel, Load
from dynid.structure.reduction.methods import reduce
from dynid.structure.reduction.serep import JointAware
from dynid.structure.state_space import without_massless
from tests.sample import sample
from tests.structure.dependent import assert_as_built, bent, chain, dense, plane, unknowns

# --- builders -----------------------------------------------------------------------------------------------


def test_masses_and_links():
    p, parameters = unknowns(m=2.0, k=30.0, c=0.4)

    def oracle(m, k, c):
        return chain([m, 3.0, m / 2], [(0, None, k, c), (0, 1, 7.0, c**2), (1, 2, 2 * k + m, 0.1)])

    links = [
        Link((1,), p["k"], p["c"]),
        Link((1, 2), 7.0, p["c"] ** 2),
        Link((2, 3), 2 * p["k"] + p["m"], 0.1),
    ]
    model = lumped([p["m"], 3.0, p["m"] / 2], links, parameters=parameters)
    assert_as_built(model, oracle, {"m": 1.3, "k": 90.0, "c": 0.7})
    np.testing.assert_array_equal(model.M, np.diag([2.0, 3.0, 1.0]))


def _beam(elements, L, EI, rhoA, m, J, k, c, alpha, beta):
    n = 2 * (elements + 1)
    M, C, K = (np.zeros((n, n), complex) for _ in range(3))
    for at in range(elements):
        here = slice(2 * at, 2 * at + 4)
        stiffness, mass = bent(EI[at], rhoA[at], L[at])
        K[here, here] += stiffness
        M[here, here] += mass
    M[4, 4] += m
    M[5, 5] += J
    K[2, 2] += k
    C[2, 2] += c
    C += alpha * M + beta * K
    return M[1:, 1:], C[1:, 1:], K[1:, 1:]


def test_a_beam():
    start = {
        "L": 7.0, "EI": 1700.0, "rhoA": 0.1, "m": 0.3, "J": 0.02, "k": 50.0, "c": 0.6, "al": 0.3, "be": 1e-3
    }  # fmt: skip
    p, parameters = unknowns(**start)

    def oracle(L, EI, rhoA, m, J, k, c, al, be):
        return _beam(4, [L / 4] * 4, [EI] * 4, [rhoA] * 4, m, J, k, c, al, be)

    model = beam(
        4, p["L"], p["EI"], p["rhoA"], supports=[Support(1, ("w",))], masses=[PointMass(3, p["m"], p["J"])],
        springs=[Spring(2, "w", p["k"], p["c"])], damping=ProportionalDamping(p["al"], p["be"]),
        parameters=parameters,
    )  # fmt: skip
    assert_as_built(model, oracle, {name: 1.3 * value for name, value in start.items()})
    assert_as_built(model, oracle, {name: 0.7 * value for name, value in start.items()})


def test_a_beam_by_elements():
    p, parameters = unknowns(a=1.5, b=900.0, r=0.2)

    def oracle(a, b, r):
        return _beam(3, [a, 2.0, 2 * a], [b, 500.0, b / a], [r, r, 0.3], 0, 0, 0, 0, 0.1, 0)

    model = beam(
        3, [p["a"], 2.0, 2 * p["a"]], [p["b"], 500.0, p["b"] / p["a"]], [p["r"], p["r"], 0.3],
        supports=[Support(1, ("w",))], damping=ProportionalDamping(0.1), parameters=parameters,
    )  # fmt: skip
    assert_as_built(model, oracle, {"a": 1.1, "b": 1200.0, "r": 0.5})


@pytest.mark.parametrize("hinges", [(), (1,), (2,), (1, 2)])
def test_a_frame(hinges):
    start = {"EA": 5e3, "EI": 2e3, "rhoA": 4.0, "x": 4.0, "y": 3.0, "m": 2.0, "k": 30.0, "al": 0.2}
    p, parameters = unknowns(**start)

    def oracle(EA, EI, rhoA, x, y, m, k, al):
        points = [(0, 0), (0, y), (x, 3.5), (x / 2, (y + 3.5) / 2)]
        members = [
            (0, 1, EA, EI, rhoA, ()), (1, 3, EA, EI, 2.0, [h for h in hinges if h == 1]),
            (3, 2, EA, EI, 2.0, [h for h in hinges if h == 2]), (0, 2, 2 * EA, 1e3, rhoA, ()),
        ]  # fmt: skip
        M, K = plane(points, members, {0, 1}, 4)
        for at in (1, 2):  # u and w of node 2
            M[at, at] += m
        K[6 - 2, 6 - 2] += k  # u of node 3
        return M, al * M, K

    members = [
        Member((1, 2), p["EA"], p["EI"], p["rhoA"]),
        Member((2, 3), p["EA"], p["EI"], 2.0, elements=2, hinges=hinges),
        Member((1, 3), 2 * p["EA"], 1e3, p["rhoA"]),
    ]
    model = frame(
        [(0.0, 0.0), (0.0, p["y"]), (p["x"], 3.5)], members, supports=[Support(1, ("u", "w"))],
        masses=[PointMass(2, p["m"])], springs=[Spring(3, "u", p["k"])],
        damping=ProportionalDamping(p["al"]), parameters=parameters,
    )  # fmt: skip
    assert model.dofs[:6] == ("theta_1", "u_2", "w_2", "theta_2", "u_3", "w_3")
    assert_as_built(model, oracle, {name: 1.2 * value for name, value in start.items()}, rtol=1e-11)


def test_one_coefficient_has_one_term():
    p, parameters = unknowns(EI=3.0, L=100.0, r=1.0)
    long = beam(300, p["L"], p["EI"], p["r"], parameters=parameters)
    assert long.is_sparse
    assert [term.letter for term in long.terms] == ["M"] * 3 + ["K"] * 3
    stiff = beam(300, list(np.linspace(1, 2, 300)), 2 * p["EI"], 1.0, parameters=parameters)
    assert len(stiff.terms) == 1
    K = stiff.with_joints({"EI": 6.0})[2]
    twice = beam(300, list(np.linspace(1, 2, 300)), 12.0, 1.0)
    np.testing.assert_allclose(dense(K), dense(twice.K), rtol=0, atol=1e-14 * abs(twice.K).max())
    assert stiff.names == {"EI"}  # the others act on nothing
    assert abs(stiff.slopes({})[0]["K"] - twice.K / 6).max() <= 1e-14 * abs(twice.K).max()


positive = st.floats(0.2, 5.0)


@settings(max_examples=20, deadline=None)
@given(
    st.lists(positive, min_size=8, max_size=8),
    st.lists(positive, min_size=8, max_size=8),
    st.sampled_from("lbf"),
)
def test_matrices_at_values_are_those_of_these_numbers(first, second, kind):
    def built(v, parameters=()):
        if kind == "l":
            links = [Link((1,), v[3], v[4]), Link((1, 2), v[5] * v[6], v[7]), Link((2, 3), v[3] + v[5], 0.1)]
            joints = [Joint("j", (1, 3), v[7], v[6] / v[5], v[4])]
            return lumped([v[0], v[1] * v[2], v[2]], links, joints, parameters=parameters)
        if kind == "b":
            return beam(
                3, v[0] * 3, [v[1], v[2], v[1]], v[3], supports=[Support(1, ("w",))],
                masses=[PointMass(2, v[4], v[5])], springs=[Spring(4, "theta", v[6], v[7])],
                damping=ProportionalDamping(v[4], v[5]), parameters=parameters,
            )  # fmt: skip
        return frame(
            [(0.0, 0.0), (v[0], 0.1), (v[0], v[1] + 0.2)],
            [Member((1, 2), v[2], v[3], v[4], 2, (2,)), Member((2, 3), v[5], v[6], v[7], 1, (1, 2)),
             Member((1, 3), v[5], v[3], v[7])],
            damping=ProportionalDamping(v[6], v[7]), parameters=parameters,
        )  # fmt: skip

    p, parameters = unknowns(**{f"p{k}": value for k, value in enumerate(first)})
    model = built(list(p.values()), parameters)
    values = {f"p{k}": value for k, value in enumerate(second)}
    used = {name: value for name, value in values.items() if name in model.names}
    for found, wanted in zip(model.with_joints(used), built(second).with_joints(), strict=True):
        # The reference is subtracted again: what is left of it is its rounding.
        size = np.abs(wanted).max() + np.abs(built(first).with_joints()[2]).max()
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * size)


# --- joints -------------------------------------------------------------------------------------------------


def test_joints_share_a_stiffness():
    p, parameters = unknowns(kb=20.0, m=0.5)

    def oracle(kb, m, **own):
        links = [(0, None, 5, 0.1), (0, 1, kb, own["a.c"]), (1, 2, kb, 0), (2, None, kb**2, 0)]
        M, C, K = chain([1.0, 2.0 + m / 2, 3.0 + m / 2], links)
        return M, C, K + np.pad(np.array([[kb, -1], [-1, 2 * kb]]), ((0, 1), (0, 1)))

    model = lumped([1.0, 2.0, 3.0], [Link((1,), 5.0, 0.1)], [
        Joint("a", (1, 2), p["kb"], JointParameter(start=0.3)),
        Joint("b", (2, 3), p["kb"], m=p["m"]),
        Joint("g", (3,), p["kb"] ** 2),
        Joint("block", (1, 2), [[p["kb"], -1.0], [-1.0, 2 * p["kb"]]]),
    ], parameters=parameters)  # fmt: skip
    assert [one.name for one in model.unknowns] == ["a.c", "kb", "m"]
    assert_as_built(model, oracle, {"a.c": 0.7, "kb": 33.0, "m": 0.9})
    with pytest.raises(UsageError, match=r"a\.c has no value"):
        model.with_joints({"kb": 3.0})


def test_a_known_parameter_is_no_unknown_but_has_a_slope():
    p, _ = unknowns(mx=2.0)
    model = lumped([p["mx"], 1.0], [Link((1,), 3.0), Link((1, 2), 4.0)])
    assert model.unknowns == ()
    np.testing.assert_array_equal(model.with_joints()[0], np.diag([2.0, 1.0]))
    (slope,) = model.slopes({}, ["mx"])
    np.testing.assert_array_equal(slope["M"], np.diag([1.0, 0.0]))
    assert set(slope) == {"M"}


def test_an_unknown_factor_multiplies_a_known_block():
    p, _ = unknowns(kb=20.0)
    with pytest.raises(UsageError, match="must be known"):
        JointParameter(start=1.0, matrix=[[p["kb"], 0.0], [0.0, 1.0]])


# --- parts of matrices --------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [5, 450])
def test_matrices_are_sums_of_parts(tmp_path, n):
    from scipy.io import mmwrite
    from scipy.sparse import coo_array, diags_array, eye_array

    spring = diags_array(
        [-np.ones(n - 1), np.r_[1.0, 2 * np.ones(n - 2), 1.0], -np.ones(n - 1)], offsets=[-1, 0, 1]
    )
    ground = coo_array(([3.0], ([0], [0])), shape=(n, n))
    parts = {"M0": 2 * eye_array(n), "M1": ground / 3, "K0": ground, "K1": spring}
    for name, matrix in parts.items():
        mmwrite(tmp_path / f"{name}.mtx", coo_array(matrix))
    files = {name: MatrixFile(tmp_path / f"{name}.mtx") for name in parts}
    p, parameters = unknowns(a=0.5, b=30.0, m=0.7, c=0.1)
    model = imported(
        [MatrixPart(files["M0"]), MatrixPart(files["M1"], p["m"])],
        [
            MatrixPart(files["K0"], p["b"] / 3),
            MatrixPart(files["K1"], p["b"] * p["a"]),
            MatrixPart(files["K1"], 2.0),
        ],
        [MatrixPart(files["K1"], p["c"])],
        parameters=parameters,
    )
    assert model.is_sparse is (n > 400)
    assert len(model.terms) == 4
    full = {name: matrix.toarray() for name, matrix in parts.items()}

    def oracle(a, b, m, c):
        return full["M0"] + m * full["M1"], c * full["K1"], b / 3 * full["K0"] + (a * b + 2) * full["K1"]

    assert_as_built(model, oracle, {"a": 0.8, "b": 20.0, "m": 0.2, "c": 0.4})
    damped = imported(
        [MatrixPart(files["M0"])], [MatrixPart(files["K1"], p["b"])], ProportionalDamping(p["a"], p["c"]),
        parameters=parameters,
    )  # fmt: skip

    def rayleigh(a, b, c):
        return full["M0"], a * full["M0"] + c * b * full["K1"], b * full["K1"]

    assert_as_built(damped, rayleigh, {"a": 0.8, "b": 20.0, "c": 0.4})


# --- reduced models -----------------------------------------------------------------------------------------


def _jointed():
    p, parameters = unknowns(EI=1700.0, r=0.1, m=0.3, al=0.2, kb=900.0)
    return beam(
        8, 7.0, p["EI"], p["r"], supports=[Support(1, ("w",))], masses=[PointMass(4, p["m"])],
        damping=ProportionalDamping(p["al"], 1e-5), parameters=parameters,
        joints=[Joint("a", (1,), p["kb"]), Joint("b", ("w_6",), JointParameter(start=800.0), p["m"] * 3)],
    )  # fmt: skip


@pytest.mark.parametrize(
    "method", ["serep", "guyan", "dynamic", "irs", "craig-bampton", "modal", "joint-aware"]
)
def test_a_reduced_model_has_the_projected_slopes(method):
    model = _jointed()
    values = {"EI": 2100.0, "r": 0.12, "m": 0.2, "al": 0.3, "kb": 700.0, "b.k": 500.0}
    options = {"modes": {"modes": range(1, 6)}, "masters": {"masters": [1, "w_4", "w_6", "w_8"]}}
    chosen = options["modes" if method == "modal" else "masters"]
    if method == "dynamic":
        chosen = {**chosen, "frequency": 20.0}
    if method == "craig-bampton":
        chosen = {**chosen, "modes": [1, 2]}
    reduced = reduce(model, method, **chosen)
    T = reduced.basis.T
    assert reduced.unknowns == model.unknowns
    for found, wanted in zip(reduced.with_joints(values), model.with_joints(values), strict=True):
        part = T.T @ wanted @ T
        np.testing.assert_allclose(found, part, rtol=0, atol=2e-10 * np.abs(part).max())
    for found, wanted in zip(reduced.slopes(values), model.slopes(values), strict=True):
        assert set(found) == set(wanted)
        for letter, matrix in wanted.items():
            part = T.T @ matrix @ T
            np.testing.assert_allclose(found[letter], part, rtol=0, atol=1e-12 * np.abs(part).max())


def test_a_basis_that_follows_the_joints_follows_all_parameters():
    model = _jointed()
    values = {"EI": 2100.0, "r": 0.12, "m": 0.2, "al": 0.3, "kb": 700.0, "b.k": 500.0}
    reduced = (
        JointAware(masters=[1, "w_4", "w_6", "w_8"], modes=[1, 2, 3, 4], values=values).reduce(model).model
    )
    full = pole_sensitivities(model, values).omega[:4]
    undamped = np.sqrt(
        np.linalg.eigvals(np.linalg.solve(*(reduced.with_joints(values)[at] for at in (0, 2))))
    )
    exact = np.sqrt(np.linalg.eigvals(np.linalg.solve(*(model.with_joints(values)[at] for at in (0, 2)))))
    np.testing.assert_allclose(np.sort(undamped.real), np.sort(exact.real)[:4], rtol=1e-8)
    np.testing.assert_allclose(full, np.sort(exact.real)[:4], rtol=1e-2)


def test_rigid_motions_stay_rigid_in_a_modal_model():
    p, parameters = unknowns(EI=1700.0)
    model = beam(6, 7.0, p["EI"], 0.1, parameters=parameters)
    reduced = reduce(model, "modal", modes=range(1, 6), residuals=())
    K = reduced.with_joints({"EI": 3e6})[2]
    assert not K[:2].any()
    assert not K[:, :2].any()
    assert np.all(np.diag(K)[2:] > 0)


def test_unknowns_on_massless_dofs_are_refused():
    p, parameters = unknowns(EI=1700.0, m=0.3, k=2.0)
    masses = [PointMass(2, p["m"]), PointMass(3, 1.0)]
    model = beam(
        2, 2.0, p["EI"], 0.0, supports=[Support(1, ("w", "theta"))], masses=masses, parameters=parameters
    )
    with pytest.raises(UsageError, match="DOF theta_2 has no mass, and the unknown EI acts on it"):
        without_massless(model, ["w_2"])
    known = beam(
        2, 2.0, 1700.0, 0.0, supports=[Support(1, ("w", "theta"))], masses=masses, parameters=parameters,
        springs=[Spring(2, "w", p["k"])],
    )  # fmt: skip
    slim = without_massless(known, ["w_2"])
    assert slim.dofs == ("w_2", "w_3")
    values = {"m": 0.7, "k": 900.0}
    _, _, K = known.with_joints(values)
    keep, out = [0, 2], [1, 3]
    condensed = K[np.ix_(keep, keep)] - K[np.ix_(keep, out)] @ np.linalg.solve(
        K[np.ix_(out, out)], K[np.ix_(out, keep)]
    )
    found = slim.with_joints(values)
    np.testing.assert_allclose(found[2], condensed, rtol=1e-12)
    np.testing.assert_allclose(found[0], np.diag([0.7, 1.0]), rtol=1e-14)


def test_the_ground_shakes_unknown_masses():
    p, parameters = unknowns(r=0.2, m=0.3)
    model = beam(
        4, 2.0, 100.0, p["r"], supports=[Support(1, ("w", "theta"))], masses=[PointMass(5, p["m"])],
        parameters=parameters, joints=[Joint("j", ("w_3",), 9.0, m=p["m"])],
    )  # fmt: skip
    load = Load(None, None, "acceleration")
    values = {"r": 0.5, "m": 0.7}
    moving = np.array([float(str(dof).startswith("w")) for dof in model.dofs])
    for one in (model, reduce(model, "guyan", masters=["w_3", "w_5"])):
        T = np.eye(model.size) if one.basis is None else one.basis.T
        driven = drive(one, [load], [Channel("w_5", "acceleration")], values)
        M = model.with_joints(values)[0]
        np.testing.assert_allclose(driven.directions[:, 0], -T.T @ M @ moving, rtol=1e-13)
        slopes = base_slopes(one, [load], values)
        for k, change in enumerate(model.slopes(values)):
            np.testing.assert_allclose(slopes[k, :, 0], -T.T @ change["M"] @ moving, rtol=1e-12, atol=1e-15)


# --- poles --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sample(["EI", "r", "m", "al", "kb", "b.k"], 2, "al"))
def test_poles_move_as_the_exact_ones(name):
    from mpmath import mp

    model = _jointed()
    values = {"EI": 2100.0, "r": 0.12, "m": 0.2, "al": 0.3, "kb": 700.0, "b.k": 500.0}

    def exact(values):
        """M, C, K from their definition in 40 digits, without the model's terms."""
        whole = {key: mp.mpf(value) for key, value in values.items()}
        L, n = mp.mpf(7) / 8, 18
        M, K, C = mp.zeros(n), mp.zeros(n), mp.zeros(n)
        k = [[12, 6 * L, -12, 6 * L], [6 * L, 4 * L**2, -6 * L, 2 * L**2], [-12, -6 * L, 12, -6 * L],
             [6 * L, 2 * L**2, -6 * L, 4 * L**2]]  # fmt: skip
        m = [[156, 22 * L, 54, -13 * L], [22 * L, 4 * L**2, 13 * L, -3 * L**2], [54, 13 * L, 156, -22 * L],
             [-13 * L, -3 * L**2, -22 * L, 4 * L**2]]  # fmt: skip
        for e in range(8):
            for i in range(4):
                for j in range(4):
                    K[2 * e + i, 2 * e + j] += whole["EI"] / L**3 * k[i][j]
                    M[2 * e + i, 2 * e + j] += whole["r"] * L / 420 * m[i][j]
        M[6, 6] += whole["m"]
        C = whole["al"] * M + mp.mpf("1e-5") * K
        K[1, 1] += whole["kb"]
        K[10, 10] += whole["b.k"]
        C[10, 10] += 3 * whole["m"]
        return M[1:, 1:], C[1:, 1:], K[1:, 1:]

    def refined(pole, values):
        """The pole near a float one, by Newton's method on the smallest eigenvector."""
        M, C, K = exact(values)
        s = mp.mpc(complex(pole))
        n = M.rows
        u = mp.lu_solve(s**2 * M + s * C + K, mp.ones(n, 1))
        for _ in range(3):  # 12, 24, 40 digits
            u /= mp.norm(u)
            Z, dZ = s**2 * M + s * C + K, 2 * s * M + C
            s -= (u.T * Z * u)[0] / (u.T * dZ * u)[0]
            u = mp.lu_solve(s**2 * M + s * C + K, dZ * u)
        return s

    found = pole_sensitivities(model, values)
    at = [one.name for one in model.unknowns].index(name)
    with mp.workdps(40):
        for place in (0, 2):
            h = mp.mpf(values[name]) * mp.mpf("1e-12")
            up, down = (
                refined(found.poles[place], {**values, name: mp.mpf(values[name]) + sign * h})
                for sign in (1, -1)
            )
            slope = float((abs(up) - abs(down)) / (2 * h))
            assert found.omega_slopes[place, at] == pytest.approx(slope, rel=1e-9, abs=1e-12 / values[name])
            damping = float((-up.real / abs(up) + down.real / abs(down)) / (2 * h))
            assert found.zeta_slopes[place, at] == pytest.approx(damping, rel=1e-7, abs=1e-10 / values[name])


# --- modal damping ------------------------------------------------------------------------------------------


def _modal_oracle(M, K, ratios):
    """M Phi diag(2 zeta omega) Phi^T M in mpmath; ratios one a mode."""
    from mpmath import mp

    L = mp.cholesky(M)
    inverse = L**-1
    square, Q = mp.eigsy(inverse * K * inverse.T)
    momentum = L * Q
    G = mp.diag([2 * ratio * mp.sqrt(mp.fabs(value)) for ratio, value in zip(ratios, square, strict=True)])
    return momentum * G * momentum.T


@pytest.mark.parametrize("kind", ["one ratio", "several", "free"])
def test_modal_damping_of_unknown_modes(kind):
    from mpmath import mp

    p, parameters = unknowns(m=1.4, k=30.0, z=0.02, y=0.05)
    held = 0.0 if kind == "free" else 3.0
    links = [Link((1,), held), Link((1, 2), p["k"]), Link((2, 3), p["k"] ** 2 / 20), Link((3, 4), 25.0)]
    ratio = p["z"] if kind != "several" else [p["z"], 0.01, p["y"]]
    masses = [p["m"], 2.0, 3.0 + p["m"], 1.0]
    whole = lumped(masses, links, [Joint("j", (4,), 100.0, 0.5)], parameters=parameters)

    def matrix(letter):
        terms = tuple((term.coefficient, term.matrix) for term in whole.terms if term.letter == letter)
        constant = getattr(whole, letter) - sum(float(c) * P for c, P in terms)
        return DependentMatrix(constant, terms)

    nothing = DependentMatrix(np.zeros((4, 4)))
    model = damped_structure(
        matrix("M"), nothing, matrix("K"), ModalDamping(ratio), whole.joints, (), parameters
    )
    values = {"m": 1.1, "k": 41.0, "z": 0.03, "y": 0.08}

    def exact(m, k, z, y):
        M = mp.diag([m, 2, 3 + m, 1])
        K = mp.zeros(4)
        for a, b, stiffness in ((0, None, mp.mpf(held)), (0, 1, k), (1, 2, k**2 / 20), (2, 3, mp.mpf(25))):
            K[a, a] += stiffness
            if b is not None:
                K[b, b] += stiffness
                K[a, b] -= stiffness
                K[b, a] -= stiffness
        ratios = [z] * 4 if kind != "several" else [z, mp.mpf("0.01"), y, 0]
        return _modal_oracle(M, K, ratios)

    with mp.workdps(50):
        big = {name: mp.mpf(value) for name, value in values.items()}
        used = {name: value for name, value in values.items() if name in model.names}
        assert set(used) == ({"m", "k", "z"} if kind != "several" else set(values))
        C = np.array(exact(**big).tolist(), dtype=float)
        damper = np.zeros((4, 4))
        damper[3, 3] = 0.5
        # A free structure's modes are found with a little mass as stiffness, which costs digits.
        atol = (1e-8 if kind == "free" else 1e-12) * np.abs(C).max()
        np.testing.assert_allclose(model.with_joints(used)[1] - damper, C, rtol=0, atol=atol)
        h = mp.mpf("1e-15")
        for name, slopes in zip(used, model.slopes(used, used), strict=True):
            up, down = (exact(**{**big, name: big[name] + sign * h}) for sign in (1, -1))
            wanted = np.array(((up - down) / (2 * h)).tolist(), dtype=float)
            np.testing.assert_allclose(slopes["C"], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())
    T = np.random.default_rng(1).standard_normal((4, 2))
    small = model.projected(T, ["a", "b"])
    for found, wanted in zip(small.slopes(used, used), model.slopes(used, used), strict=True):
        np.testing.assert_allclose(found["C"], T.T @ wanted["C"] @ T, rtol=0, atol=1e-12)
    np.testing.assert_allclose(small.with_joints(used)[1], T.T @ model.with_joints(used)[1] @ T, atol=1e-12)


def test_modal_damping_at_a_double_frequency():
    """Equal masses on equal springs: C = 2 zeta sqrt(k m), whatever the modes."""
    p, parameters = unknowns(k=9.0)
    model = frame(
        [(0.0, 0.0), (1.0, 0.0)], [Member((1, 2), 1.0, 1.0, 0.0)], supports=[Support(1, ("u", "w", "theta"))],
        masses=[PointMass(2, 4.0, 1.0)], damping=ModalDamping(0.05),
    )  # fmt: skip
    assert model.unknowns == ()
    square = beam(
        1, 1.0, 1e-12, 0.0, masses=[PointMass(1, 4.0, 4.0), PointMass(2, 4.0, 4.0)],
        springs=[Spring(node, direction, p["k"]) for node in (1, 2) for direction in ("w", "theta")],
        damping=ModalDamping(0.05), parameters=parameters,
    )  # fmt: skip
    (slope,) = square.slopes({"k": 16.0})
    np.testing.assert_allclose(slope["C"], 0.05 * np.sqrt(4.0 / 16.0) * np.eye(4), atol=1e-11)


def test_modal_damping_beside_massless_dofs_follows_the_condensed_stiffness():
    p, parameters = unknowns(EI=7.0, m=0.6)

    def built(EI, m, parameters=()):
        return beam(
            3, 2.0, EI, 0.0, supports=[Support(1, ("w", "theta"))],
            masses=[PointMass(4, m), PointMass(3, 0.2)], damping=ModalDamping([0.02, 0.05]),
            parameters=parameters,
        )  # fmt: skip

    model = built(p["EI"], p["m"], parameters)
    values = {"EI": 9.0, "m": 0.5}
    np.testing.assert_allclose(model.with_joints(values)[1], built(9.0, 0.5).C, rtol=0, atol=1e-12)
    for one, slopes in zip(model.unknowns, model.slopes(values), strict=True):
        h = 1e-3 * values[one.name]
        moved = [built(**{**values, one.name: values[one.name] + s * h}).C for s in (-2, -1, 1, 2)]
        wanted = (moved[0] - 8 * moved[1] + 8 * moved[2] - moved[3]) / (12 * h)
        np.testing.assert_allclose(slopes["C"], wanted, rtol=0, atol=1e-9 * np.abs(wanted).max())


def test_modal_damping_without_a_derivative_is_refused():
    p, parameters = unknowns(k=0.0, m=4.0)
    links = {"springs": [Spring(1, "w", p["k"])], "parameters": parameters}
    free = beam(1, 1.0, 1.0, 1.0, damping=ModalDamping(0.05), **links)
    with pytest.raises(UsageError, match="a rigid-body mode gets stiffness"):
        free.slopes({})
    springs = [Spring(node, direction, 9.0) for node in (1, 2) for direction in ("w", "theta")]
    masses = [PointMass(1, p["m"], 4.0), PointMass(2, 4.0, 4.0)]
    double = beam(
        1, 1.0, 1e-12, 0.0, masses=masses, springs=springs, parameters=parameters,
        damping=ModalDamping([0.05, 0.1]),
    )  # fmt: skip
    with pytest.raises(NumericalError, match="modes of one frequency have different damping ratios"):
        double.slopes({})


def test_parts_of_an_assembly_have_modal_damping_of_their_own():
    """Each block is that of the part alone, and so is its derivative by the parameter of both."""
    p, parameters = unknowns(EI=7.0)
    supports = [Support(1, ("w", "theta"))]

    def built(EI, ratio, parameters=()):
        return beam(2, 2.0, EI, 3.0, supports=supports, damping=ModalDamping(ratio), parameters=parameters)

    ratios = (0.02, [0.05, 0.01])
    parts = [built(p["EI"], ratio, parameters) for ratio in ratios]
    whole = assembled_parts(dict(zip("ab", parts, strict=True)), parts[0].unknowns)
    values = {"EI": 9.0}
    alone = [built(9.0, ratio).C for ratio in ratios]
    np.testing.assert_allclose(whole.with_joints(values)[1], block_diag(*alone), rtol=0, atol=1e-12)
    (slope,), owns = whole.slopes(values), [part.slopes(values)[0]["C"] for part in parts]
    np.testing.assert_allclose(slope["C"], block_diag(*owns), rtol=0, atol=1e-12)
    assert np.abs(owns[0]).max() > 1e-3


def test_an_unknown_damping_ratio_of_known_modes_is_a_factor():
    """The damping of the modes with the ratio z is proportional to it; that of the others stays."""
    p, parameters = unknowns(z=0.02)
    built = [
        beam(
            2,
            2.0,
            7.0,
            3.0,
            supports=[Support(1, ("w", "theta"))],
            damping=ModalDamping(ratio),
            parameters=more,
        )
        for ratio, more in (([p["z"], 0.01], parameters), ([0.05, 0.01], ()), ([1.0], ()))
    ]
    model, at, unit = built
    np.testing.assert_allclose(model.with_joints({"z": 0.05})[1], at.C, rtol=0, atol=1e-12)
    (slope,) = model.slopes({"z": 0.05})
    np.testing.assert_allclose(slope["C"], unit.C, rtol=0, atol=1e-12)


@pytest.mark.parametrize("ratio", [-0.01, np.nan, [0.01, np.inf]])
def test_damping_ratios_that_make_no_sense_are_refused(ratio):
    with pytest.raises(UsageError, match=r"^damping ratios must be finite and not negative$"):
        ModalDamping(ratio)
