"""Unknown factors of matrix joints: K = factor x matrix, over any number of DOFs."""

from dataclasses import replace
from functools import partial

import mpmath as mp
import numpy as np
import pytest
from scipy.linalg import expm

import dynid
from dynid.identification.estimators.auto import Auto
from dynid.identification.estimators.filter_passes import Filter
from dynid.identification.estimators.imbedding import InvariantImbedding
from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.records.frf_measurement import Frf, FrfMeasurement
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.frf_system import FrfSystem
from dynid.identification.systems.parametric_model import parametric_model
from dynid.lti.signals import Multisine
from dynid.native import VARIABLE
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.ports import Channel, Load
from dynid.structure.reduction.methods import reduce
from tests.identification.cases import LINKS, LOADS, MASSES, VELOCITIES, in_bounds, parameter, simulated
from tests.sample import sample
from tests.scene.example_scenes import faults_of

SPRING = np.array([[1.0, -1.0], [-1.0, 1.0]])


def block(size, seed, largest):
    """A random symmetric positive definite matrix, none of whose entries is zero."""
    root = np.random.default_rng(seed).standard_normal((size, size + 1))
    matrix = root @ root.T
    return largest * matrix / np.abs(matrix).max()


def factor(matrix, start=0.5, true=1.3):
    return JointParameter(start=start, true=true, matrix=matrix)


def bolted(k, c, dofs=(2, 3)):
    links = [*LINKS, Link((3, 4), 2e4, 20)]
    return lumped(MASSES, links, [Joint("upper", dofs, k, c)])


def dense(seed=5):
    """Five masses, of which four are joined by full matrices, both unknown."""
    joint = Joint("mount", (5, 2, 3, 1), factor(block(4, seed, 3e4)), factor(block(4, seed + 1, 25.0)))
    return lumped(MASSES, LINKS, [joint])


def scalar():
    return bolted(JointParameter(start=1e4, true=2e4), JointParameter(start=10.0, true=20.0))


def as_blocks():
    """The joint of `scalar`, its stiffness as a factor of a matrix in N/m, its damping of one in 10 N.s/m."""
    return bolted(factor(2e4 * SPRING, 0.5, 1.0), factor(10.0 * SPRING, 1.0, 2.0))


@pytest.mark.thorough
@pytest.mark.parametrize("kernels", ["0", "1"])
@pytest.mark.parametrize(
    ("estimator", "samples"),
    [
        (Auto(), 300),
        (Filter(), 300),
        pytest.param(OutputError(), 300, marks=pytest.mark.slow),  # is part of `auto`
        (InvariantImbedding(), 30),
    ],
)
def test_a_factor_of_the_spring_pattern_is_the_scalar_joint(monkeypatch, kernels, estimator, samples):
    monkeypatch.setenv(VARIABLE, kernels)
    one, other = (
        identify(model, Experiment(LOADS, simulated(0.05, samples=samples)), estimator)
        for model in (scalar(), as_blocks())
    )
    # The logarithms differ by a constant, that is by rounding, which the integration of eqs 19 and 20
    # magnifies up to its tolerance.
    rel = 1e-3 if samples == 30 else 1e-7
    unit = np.array([2e4, 10.0])
    for name in ("estimate", "standard_error", "cramer_rao"):
        assert unit * parameter(other, name) == pytest.approx(parameter(one, name), rel=rel)
    assert list(parameter(other, "unit")) == ["", ""]


def test_the_scalar_joint_is_found_from_responses_too():
    measured = FrfMeasurement(
        np.linspace(20, 300, 60), (Frf(Channel(2, "velocity"), 5),), Simulation(0.03, 2)
    )
    one, other = (identify(model, measured) for model in (scalar(), as_blocks()))
    for name in ("estimate", "standard_error", "cramer_rao"):
        assert np.array([2e4, 10.0]) * parameter(other, name) == pytest.approx(parameter(one, name), rel=1e-9)


def test_the_step_of_a_dense_joint_and_its_derivatives_are_those_of_complex_steps():
    model = dense()
    measured = simulated(samples=5)
    joint = parametric_model(model, LOADS, VELOCITIES, measured.record.times)
    eta, h, n = np.log([0.7, 1.9]), float(joint.line.lengths[0]), 5
    found = joint.transition(eta, h)
    M = np.diag(MASSES).astype(float)
    places = np.ix_([4, 1, 2, 0], [4, 1, 2, 0])

    def step(at):
        K, C = (matrix.astype(complex) for matrix in (_links("k"), _links("c")))
        K[places] += np.exp(at[0]) * block(4, 5, 3e4)
        C[places] += np.exp(at[1]) * block(4, 6, 25.0)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
        scaled = A / joint.scale[:, None] * joint.scale
        return expm(scaled * h)

    assert found.step[:, : 2 * n] == pytest.approx(step(eta).real, abs=1e-13)
    for k in range(2):
        slope = step(eta + 1e-30j * np.eye(2)[k]).imag / 1e-30
        size = np.abs(slope).max()
        assert found.derivatives[k][:, : 2 * n] == pytest.approx(slope, abs=1e-11 * size)


def _links(letter):
    """Stiffness or damping of the links alone, term by term."""
    matrix = np.zeros((5, 5))
    for link in LINKS:
        value = link.k if letter == "k" else link.c
        ends = [dof - 1 for dof in link.dofs]
        for a in ends:
            for b in ends:
                matrix[a, b] += value if a == b else -value
    return matrix


def test_response_slopes_of_a_dense_joint_are_exact():
    """Against the receptance in 40 digits, differentiated by a step of 1e-12."""
    eta, omega = np.log([0.7, 1.9]), 63.0
    found = FrfSystem.of(dense(), [Frf(Channel(3, "acceleration"), 5)]).response(np.array([omega]), eta)
    K0, C0 = _links("k"), _links("c")

    def response(at):
        Z = mp.zeros(5)
        joint_k, joint_c = block(4, 5, 3e4), block(4, 6, 25.0)
        for i in range(5):
            for j in range(5):
                mass = MASSES[i] if i == j else 0
                Z[i, j] = mp.mpf(K0[i, j]) + 1j * omega * mp.mpf(C0[i, j]) - mp.mpf(omega) ** 2 * mass
        for a, i in enumerate((4, 1, 2, 0)):
            for b, j in enumerate((4, 1, 2, 0)):
                Z[i, j] += mp.exp(at[0]) * joint_k[a, b] + 1j * omega * mp.exp(at[1]) * joint_c[a, b]
        return -(mp.mpf(omega) ** 2) * mp.lu_solve(Z, mp.matrix([0, 0, 0, 0, 1]))[2]

    with mp.workdps(40):
        centre = [mp.mpf(float(value)) for value in eta]
        assert found.values[0, 0] == pytest.approx(complex(response(centre)), rel=1e-12)
        for k in range(2):
            ahead, behind = (
                response([value + sign * (place == k) for place, value in enumerate(centre)])
                for sign in (mp.mpf("1e-12"), -mp.mpf("1e-12"))
            )
            slope = complex((ahead - behind) / mp.mpf("2e-12"))
            assert found.slopes[0, 0, k] == pytest.approx(slope, rel=1e-11)


def bushing(rank):
    """Six masses in the plane's three directions, two and two; a bushing couples the middle pairs."""
    matrix = np.diag([3e4, 5e4, 2e4]).astype(float)
    turn = np.linalg.qr(np.random.default_rng(rank).standard_normal((3, 3)))[0]
    matrix = turn[:, :rank] * np.diag(matrix)[:rank] @ turn[:, :rank].T
    links = [Link((dof,), 2e4 + 3e3 * dof, 15) for dof in (1, 2, 3)]
    return partial(lumped, (2.0, 1.5, 1.0), links), matrix


@pytest.mark.thorough
@pytest.mark.parametrize("rank", sample([1, 2, 3], 1))
def test_a_bushing_of_three_dofs_is_found_within_its_bars(rank):
    made, matrix = bushing(rank)
    model = made([Joint("bush", (1, 2, 3), factor(matrix, 0.4, 1.0), factor(1e-3 * matrix, 2.0, 1.0))])
    loads = (Load(2, Multisine([40.0] * 3, [90.0, 150.0, 210.0])),)
    channels = (Channel(1, "acceleration"), Channel(3, "velocity"))
    errors = np.array(
        [
            in_bounds(
                identify(
                    model, Experiment(loads, Measurement(0.003, 250, channels, Simulation(0.05, seed, 1.0)))
                )
            )
            for seed in range(16)
        ]
    )
    assert np.abs(errors).max() < 4  # of 32 normal errors, one in 500 such tests
    assert 0.65 < np.sqrt(np.mean(errors**2)) < 1.4  # chi-squared of 32 degrees: one in 1,000 outside


@pytest.mark.parametrize("seed", [5, 11])
def test_a_dense_joint_is_found_full_and_reduced(seed):
    model = dense(seed)
    channels = tuple(Channel(dof, "acceleration") for dof in (1, 3, 4))
    measured = simulated(0.02, seed, samples=400, channels=channels)
    assert np.abs(in_bounds(identify(model, Experiment(LOADS, measured)))).max() < 4
    # With all modes kept a reduction is another choice of coordinates.
    small = reduce(model, "craig-bampton", masters=[1, 2, 3, 5], modes=[1])
    full, other = (
        identify(each, Experiment(LOADS, replace(measured, source=Simulation(0.02, seed, 10.0))), truth=model)
        for each in (model, small)
    )
    assert parameter(other, "estimate") == pytest.approx(parameter(full, "estimate"), rel=1e-7)


SCENE = """\
dynid: 1
kind: identification
structure:
  lumped: {masses: [2, 1, 1], links: [{dofs: [1], k: 2.0e4, c: 8}, {dofs: [3], k: 1.0e4, c: 4}]}
joints:
  bush:
    dofs: [1, 2, 3]
    k: {start: 0.5, true: 1, matrix: [[3.0e4, -1.0e4, 2.0e3], [-1.0e4, 2.0e4, 0], [2.0e3, 0, 1.0e4]]}
    c: {start: 2, true: 1, min: 0.1, matrix: [[6, -2, 0], [-2, 6, -1], [0, -1, 3]]}
excitation: [{dof: 2, kind: multisine, amplitude: [10, 10, 10], frequency: [60, 110, 180]}]
measurement:
  step: 0.002
  samples: 400
  channels: [{dof: 1, quantity: acceleration}, {dof: 2, quantity: acceleration}]
  simulate: {noise_ratio: 0.05, seed: 1, settle: 2}
"""


def test_the_scene_gives_factors(tmp_path):
    (tmp_path / "s.yaml").write_text(SCENE)
    result = dynid.run(dynid.load_scene(tmp_path / "s.yaml"))
    assert list(parameter(result, "name")) == ["bush.k", "bush.c"]
    assert list(parameter(result, "true")) == [1, 1]
    assert np.abs(in_bounds(result)).max() < 4


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("[-1.0e4, 2.0e4, 0]", "[-2.0e4, 2.0e4, 0]", "8:38: a joint's matrix is symmetric; entry (2, 1)"),
        ("[-2, 6, -1]", "[-2, 6]", "9:46: a joint's matrix is square; row 2 has 2 entries"),
        ("dofs: [1, 2, 3]", "dofs: [1, 2]", "7:5: 'k' is 3 x 3, but 'dofs' names 2"),
        ("start: 0.5, ", "start: 0.5, value: 1, ", "8:8: a joint parameter has either a 'start'"),
        (", true: 1, matrix: [[3", ", matrix: [[3", "8:5: a simulated measurement needs the 'true' value"),
        ("start: 0.5, true: 1, ", "", ""),
        (
            "[[6, -2, 0], [-2, 6, -1], [0, -1, 3]]",
            "[[0, 0, 0], [0, 0, 0], [0, 0, 0]]",
            "9:8: the 'matrix' beside 'start' is zero",
        ),
    ],
)
def test_faults_of_the_matrix_are_located(right, wrong, fault):
    assert right in SCENE
    found = faults_of(SCENE.replace(right, wrong))
    assert len(found) == bool(fault)
    assert all(text.startswith(fault) for text in found)
