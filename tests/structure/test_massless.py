"""Lumped masses of 0: DOFs that follow the others without inertia, as those of matrices out of files do."""

import numpy as np
import pytest
from scipy.linalg import eig

import dynid
from dynid.errors import Singular, UsageError
from dynid.lti.signals import Sine
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.modes import modes
from dynid.structure.ports import Channel, Load
from dynid.structure.reduction.condensation import Guyan
from dynid.structure.response import frequency_response, time_response
from dynid.structure.state_space import massless_directions, massless_motion
from tests.structure.oracle import built, exact, frequencies


def chain_with_massless(seed):
    """Return a random chain with links between random DOFs too, at least one mass 0 and one not."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 9))
    masses = [float(mass) for mass in rng.uniform(1, 5, n).round(3)]
    for dof in rng.choice(n, int(rng.integers(1, n)), replace=False):
        masses[dof] = 0.0
    links = [((i, i + 1), float(rng.uniform(1e3, 1e5).__round__(1))) for i in range(1, n)]
    links.append(((int(rng.integers(1, n + 1)),), 2.5e3))
    for _ in range(int(rng.integers(0, 3))):
        a, b = rng.choice(np.arange(1, n + 1), 2, replace=False).tolist()
        links.append(((a, b), 700.0))
    return masses, links


@pytest.mark.parametrize("seed", range(12))
def test_the_modes_are_those_of_the_condensed_chain(seed):
    masses, links = chain_with_massless(seed)
    true = frequencies(*exact(masses, links))
    model = built(masses, links)
    found = modes(*model.with_joints())
    assert found.massless == masses.count(0.0)
    np.testing.assert_allclose(found.omega, true, rtol=1e-9)
    np.testing.assert_allclose(modes(*model.with_joints(), count=1).omega, true[:1], rtol=1e-9)
    heavy = [dof for dof, mass in enumerate(masses, 1) if mass]
    reduced = Guyan(heavy).reduce(model).model  # exact: what is condensed has no inertia
    np.testing.assert_allclose(modes(*reduced.with_joints()).omega, true, rtol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_a_massless_dof_at_a_joint_responds_to_forces_as_the_equations_say(seed):
    masses, links = chain_with_massless(seed)
    dof = masses.index(0.0) + 1
    other = dof - 1 or 2
    model = lumped(
        masses,
        [Link(dofs, k, 1e-3 * k) for dofs, k in links],
        [Joint("j", (dof, other), JointParameter(value=4e3), JointParameter(value=7.0))],
    )
    omega = np.array([3.0, 40.0, 170.0])
    result = frequency_response(model, [dof], [Channel(other, "displacement")], omega)
    M, C, K = (np.asarray(matrix) for matrix in model.with_joints())
    force = np.eye(len(masses))[dof - 1]
    want = [np.linalg.solve(K - w**2 * M + 1j * w * C, force)[other - 1] for w in omega]
    np.testing.assert_allclose(
        result["structure/frequency_response/response"].data[:, 0, 0], want, rtol=1e-10
    )


@pytest.mark.parametrize(
    ("masses", "links", "error", "said"),
    [
        ([0, 0], [((1,), 10), ((1, 2), 5)], UsageError, "all 0"),
        ([2, 0, 1], [((1,), 10), ((1, 3), 5)], Singular, "DOF 2 has neither mass nor stiffness"),
        ([2, 0, 0, 1], [((1,), 10), ((2, 3), 5), ((1, 4), 5)], Singular, "neither inertia nor"),
        ([2, 0, 0, 0, 1], [((2, 3), 10), ((3, 4), 5), ((1, 5), 5)], Singular, "neither inertia nor"),
        ([1, -1], [((1,), 10), ((1, 2), 5)], UsageError, "not negative"),
    ],
)
def test_massless_dofs_that_nothing_holds_are_refused(masses, links, error, said):
    with pytest.raises(error, match=said):
        modes(*built(masses, links).with_joints())


# --- motion in time --------------------------------------------------------------------------------


def damped_chain(seed):
    """Return a random chain with massless DOFs and dampers on most links, and its matrices."""
    rng = np.random.default_rng(seed)
    masses, links = chain_with_massless(seed)
    damping = [float(rng.uniform(0.05, 0.4) * k**0.5) * bool(rng.random() < 0.6) for _, k in links]
    damping[links.index(next(link for link in links if len(link[0]) == 1))] = 30.0
    for place, (dofs, _) in enumerate(links):  # every mass is damped, massless DOFs may be free of dampers
        if any(masses[dof - 1] for dof in dofs) and rng.random() < 0.5:
            damping[place] = 20.0
    model = lumped(masses, [Link(dofs, k / 100, c) for (dofs, k), c in zip(links, damping, strict=True)])
    return model, *(np.asarray(matrix) for matrix in model.with_joints())


def pencil_motions(M, C, K):
    """Return the finite eigenvalues and displacements of the first-order pencil, of all DOFs."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-K, -C]])
    E = np.block([[np.eye(n), np.zeros((n, n))], [np.zeros((n, n)), M]])
    (alpha, beta), vectors = eig(A, E, homogeneous_eigvals=True)
    finite = np.abs(beta) > 1e-9 * np.abs(alpha)
    return alpha[finite] / beta[finite], vectors[:n, finite]


CHANNELS = [(0, "displacement"), (1, "velocity"), (2, "acceleration")]


@pytest.mark.parametrize("seed", range(12))
def test_a_forced_motion_tends_to_the_frequency_response_at_every_dof(seed):
    model, M, C, K = damped_chain(seed)
    slowest = -pencil_motions(M, C, K)[0].real.max()
    if slowest < 1e-2:
        pytest.skip("hardly damped: no steady state in any short time")
    t = 40 / slowest + np.array([0.0, 0.01, 0.37])
    dof, w = int(np.argmin(np.diag(M))) + 1, 7.3  # a massless one
    H = np.linalg.solve(K - w**2 * M + 1j * w * C, np.eye(len(M))[dof - 1])
    for power, quantity in CHANNELS:
        outputs = [Channel(k, quantity) for k in range(1, len(M) + 1)]
        found = time_response(model, [Load(dof, Sine(3.0, w, 0.4))], outputs, t)
        want = np.imag(3 * (1j * w) ** power * H[None, :] * np.exp(1j * (w * t[:, None] + 0.4)))
        np.testing.assert_allclose(
            found.value("structure/time_response/response"), want, atol=1e-8 * np.abs(want).max()
        )


@pytest.mark.parametrize("seed", range(12))
def test_a_free_motion_is_that_of_the_finite_eigenvalues(seed):
    model, M, C, K = damped_chain(seed)
    values, vectors = pencil_motions(M, C, K)
    massive, t = np.flatnonzero(np.diag(M)), np.linspace(0, 2, 9)
    damped = [k for k in np.flatnonzero(np.diag(M) == 0) if C[k, k]]
    rng = np.random.default_rng(seed)
    start, speed = rng.standard_normal(len(massive)), rng.standard_normal(len(massive))
    motion = np.concatenate([vectors[massive], vectors[damped], vectors[massive] * values])
    # A lonely group of dampers may move one state less than it has DOFs: then the first state is not free.
    if len(motion) != len(values):
        pytest.skip("dampers between massless DOFs alone")
    parts = np.linalg.solve(motion, np.concatenate([start, np.zeros(len(damped)), speed]))
    for power, quantity in CHANNELS:
        outputs = [Channel(k, quantity) for k in range(1, len(M) + 1)]
        found = time_response(
            model, [], outputs, t,
            displacement={int(k) + 1: x for k, x in zip(massive, start, strict=True)},
            velocity={int(k) + 1: v for k, v in zip(massive, speed, strict=True)},
        )  # fmt: skip
        want = np.real(np.exp(np.outer(t, values)) * values**power * parts @ vectors.T)
        np.testing.assert_allclose(
            found.value("structure/time_response/response"), want, atol=1e-8 * np.abs(want).max()
        )


def test_a_motion_without_inertia_stiffness_or_damping_has_no_response():
    model = lumped([1.0, 0.0], [Link((1,), 4.0)])
    with pytest.raises(Singular, match="neither inertia, damping nor stiffness"):
        time_response(model, [], [Channel(1, "displacement")], [0.0, 1.0])


def test_initial_values_of_massless_dofs_that_are_no_states_are_refused():
    model = lumped(
        [1.0, 0.0, 0.0], [Link((1,), 4.0), Link((1, 2), 3.0), Link((2, 3), 3.0), Link((3,), 1.0, 2.0)]
    )
    ask = {"loads": [], "outputs": [Channel(1, "displacement")], "times": [0.0, 1.0]}
    assert time_response(model, **ask, displacement={1: 1.0, 2: 0.0, 3: 0.5})
    with pytest.raises(UsageError, match=r"initial displacement of DOF 2 .* neither mass nor damping"):
        time_response(model, **ask, displacement={2: 1.0})
    with pytest.raises(UsageError, match=r"initial velocity of DOF 3 .* no mass"):
        time_response(model, **ask, velocity={3: 1.0})


SCENE = """
dynid: 1
kind: reduction
structure:
  lumped:
    masses: [2, 0, 1.5, 0, 3]
    links: [{dofs: [1], k: 2.0e4, c: 2}, {dofs: [1, 2], k: 3.0e4, c: 3}, {dofs: [2, 3], k: 1.0e4}, {dofs: [3, 4], k: 2.0e4}, {dofs: [4, 5], k: 5.0e3, c: 2}]
joints: {j: {dofs: [2, 4], k: 1.0e3, c: 5}}
reduction: [{method: guyan, masters: [1, 3, 5]}, {method: craig-bampton, masters: [1, 3, 5], modes: {count: 0}}, {method: modal, modes: {count: 3}}, {method: joint-aware, masters: [1, 3, 5], modes: {count: 3}}]
"""  # noqa: E501


def test_a_scene_with_masses_of_0_runs_and_its_reductions_keep_all_modes(tmp_path):
    (tmp_path / "s.yaml").write_text(SCENE)
    result = dynid.run(tmp_path / "s.yaml")
    for method in ("guyan", "craig-bampton", "modal", "joint-aware"):
        error = result[f"reduction/{method}/frequency_error"].data[:3]
        np.testing.assert_allclose(error, 0, atol=1e-9)


IDENTIFICATION = """
dynid: 1
kind: identification
structure:
  lumped:
    masses: [2, 0, 1.5, 0, 3]
    links: [{dofs: [1], k: 2.0e4, c: 20}, {dofs: [1, 2], k: 3.0e4}, {dofs: [2, 3], k: 1.0e4}, {dofs: [3, 4], k: 2.0e4}, {dofs: [4, 5], k: 5.0e3}]
joints: {j: {dofs: [3, 5], k: {start: 1.0e3, true: 2.0e3}, c: 5}}
excitation: [{dof: 5, kind: multisine, amplitude: [10, 10, 10], frequency: [20, 35, 110]}]
measurement: {step: 0.004, samples: 500, channels: [{dof: 1, quantity: velocity}, {dof: 5, quantity: velocity}], simulate: {noise: 0.01, seed: 1}}
"""  # noqa: E501


@pytest.mark.parametrize(
    "reduction",
    ["", "reduction: {method: guyan, masters: [1, 3, 5]}", "reduction: {method: modal, modes: {count: 2}}"],
)
def test_an_identification_condenses_massless_dofs_between_springs(tmp_path, reduction):
    (tmp_path / "s.yaml").write_text(IDENTIFICATION + reduction)
    result = dynid.run(tmp_path / "s.yaml")
    estimate = float(result["identification/parameters/estimate"].data[0])
    assert abs(estimate / 2e3 - 1) < (0.01 if "modal" not in reduction else 0.2)


def test_the_record_of_massless_dofs_is_that_of_the_condensed_structure(tmp_path):
    """Springs in series: 2 between 3e4 and 1e4, 4 between 2e4 and 5e3."""
    (tmp_path / "s.yaml").write_text(IDENTIFICATION)
    condensed = (
        IDENTIFICATION.replace("[2, 0, 1.5, 0, 3]", "[2, 1.5, 3]")
        .replace("{dofs: [1, 2], k: 3.0e4}, {dofs: [2, 3], k: 1.0e4}", "{dofs: [1, 2], k: 7.5e3}")
        .replace("{dofs: [3, 4], k: 2.0e4}, {dofs: [4, 5], k: 5.0e3}", "{dofs: [2, 3], k: 4.0e3}")
        .replace("[3, 5]", "[2, 3]")
        .replace("dof: 5", "dof: 3")
    )
    (tmp_path / "c.yaml").write_text(condensed)
    path = "identification/parameters/estimate"
    estimates = [dynid.run(tmp_path / name)[path].data for name in ("s.yaml", "c.yaml")]
    np.testing.assert_allclose(*estimates, rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[3, 5], k", "[2, 5], k", "DOF 2 has no mass, and the unknown joint j acts on it"),
        ("k: 5.0e3}", "k: 5.0e3, c: 1}", "DOF 4 has no mass, and a damper acts on it"),
        ("[{dof: 5, kind", "[{dof: 4, kind", "DOF 4 has no mass, and a force or a sensor is there"),
        ("[{dof: 1, q", "[{dof: 2, q", "DOF 2 has no mass, and a force or a sensor is there"),
    ],
)
def test_an_identification_says_which_massless_dof_it_cannot_condense(tmp_path, old, new, said):
    assert IDENTIFICATION.count(old) == 1
    (tmp_path / "s.yaml").write_text(IDENTIFICATION.replace(old, new))
    with pytest.raises(UsageError, match=said) as caught:
        dynid.run(tmp_path / "s.yaml")
    assert "frequency response functions" in caught.value.remedy


@pytest.mark.parametrize(
    ("M", "C", "said"),
    [
        ([[1, 0], [0, -1]], [[0, 0], [0, 0]], "the mass matrix is indefinite, which shows in a massless"),
        ([[1, 2], [2, 1]], [[0, 0], [0, 0]], "the mass matrix is indefinite, which shows in a massless"),
        ([[1, 0], [0, 0]], [[0, 0], [0, -3]], "the damping matrix is indefinite, which shows in a massless"),
        (
            [[1, 0], [0, 0]],
            [[0, 2], [2, 0]],
            "the damping is indefinite: it couples a massless motion that it",
        ),
    ],
)
def test_matrices_that_are_indefinite_in_a_massless_direction_are_refused(M, C, said):
    with pytest.raises(UsageError) as caught:
        massless_directions(np.array(M, dtype=float), np.array(C, dtype=float))
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize(
    ("M", "said"),
    [
        ([[2, 1], [1, 1]], ""),
        ([[1, 1], [1, 1]], "some motion moves no mass"),
        ([[1, 0], [0, 0]], "1 of its 2 DOFs have no mass"),
    ],
)
def test_a_massless_motion_is_said_in_words(M, said):
    assert massless_motion(np.array(M, dtype=float)) == said
