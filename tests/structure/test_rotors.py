"""Rotors against closed forms in the complex coordinate x + iy of isotropic shafts."""

import numpy as np
import pytest
from mpmath import mp, mpf, polyroots

from dynid.errors import UsageError
from dynid.identification.systems.structure_system import StructureSystem
from dynid.lti.signals import Impulse
from dynid.result import Result
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.labels import Label
from dynid.structure.modal_analysis import modal_analysis
from dynid.structure.model import Rotor, StructuralModel
from dynid.structure.poles import pole_sensitivities
from dynid.structure.ports import Channel, Load
from dynid.structure.response import frequency_response, time_response
from dynid.structure.rotors import add_campbell, whirl, whirl_modes

pytestmark = pytest.mark.thorough

DISC: tuple[Label, ...] = ("1:x", "1:y", "1:rx", "1:ry")


def gyroscopic(*polar):
    """Return the gyroscopic matrix of discs with four DOFs each."""
    G = np.zeros((4 * len(polar), 4 * len(polar)))
    for k, J in enumerate(polar):
        G[4 * k + 2, 4 * k + 3], G[4 * k + 3, 4 * k + 2] = J, -J
    return G


def jeffcott(speed, m=10.0, k=4e5, J=0.2, polar=0.35, tilting=9e3):
    """Return a disc on a shaft, whose translations and rotations are not coupled."""
    M, K = np.diag([m, m, J, J]), np.diag([k, k, tilting, tilting])
    model = StructuralModel(M, np.zeros((4, 4)), K, dofs=DISC)
    return model.rotating(Rotor(gyroscopic(polar), np.zeros((4, 4)), speed))


@pytest.mark.parametrize("speed", [0.0, 40.0, 300.0, 2500.0])
def test_a_jeffcott_rotor_with_a_tilting_disc(speed):
    poles, shapes = whirl_modes(jeffcott(speed))
    shift, root = 0.35 * speed / 0.4, np.sqrt((0.35 * speed / 0.4) ** 2 + 9e3 / 0.2)
    exact = np.sort([200.0, 200.0, root - shift, root + shift])
    assert np.sort(poles.imag) == pytest.approx(exact, rel=1e-12)
    assert np.abs(poles.real).max() <= 1e-10 * exact[-1]
    if speed:
        forward, backward = (int(np.argmin(np.abs(poles.imag - w))) for w in (root + shift, root - shift))
        turns = whirl(DISC, shapes)
        assert turns[[forward, backward]] == pytest.approx([1, -1], abs=1e-12)


@pytest.mark.parametrize("speed", [100.0, 599.0, 601.0])
def test_damping_that_rotates_is_unstable_above_its_speed(speed):
    """Of m z'' + (ce + ci) z' + (k - i speed ci) z = 0 unstable above sqrt(k/m) (1 + ce/ci) = 600 rad/s."""
    m, k, external, internal = 10.0, 4e5, 40.0, 20.0
    N = speed * internal * np.array([[0.0, 1.0], [-1.0, 0.0]])
    damping = (external + internal) * np.eye(2)
    model = StructuralModel(m * np.eye(2), damping, k * np.eye(2), dofs=("1:x", "1:y"))
    model = model.rotating(Rotor(np.zeros((2, 2)), N, speed))
    poles, shapes = whirl_modes(model)
    roots = np.roots([m, external + internal, k - 1j * speed * internal])
    forward = roots[np.argmax(roots.imag)]
    at = int(np.argmin(np.abs(poles - forward)))
    assert poles[at] == pytest.approx(forward, rel=1e-12)
    assert poles[1 - at] == pytest.approx(roots[np.argmin(roots.imag)].conj(), rel=1e-12)
    assert whirl(model.dofs, shapes)[[at, 1 - at]] == pytest.approx([1, -1], abs=1e-9)
    assert (poles.real.max() > 0) == (speed > 600)


EI, A, B, MASS, TRANSVERSE, POLAR = 2e4, 0.25, 0.4, 12.0, 0.06, 0.11


def two_discs(speed):
    """Return two equal discs on a massless shaft on rigid bearings, A beside them and B between them."""
    left = 3 * EI / A**3 * np.array([[1, -A], [-A, A**2]])
    right = left * [[1, -1], [-1, 1]]
    middle = EI / B**3 * np.array(
        [[12, 6 * B, -12, 6 * B], [6 * B, 4 * B**2, -6 * B, 2 * B**2], [-12, -6 * B, 12, -6 * B],
         [6 * B, 2 * B**2, -6 * B, 4 * B**2]]
    )  # fmt: skip
    plane = middle.copy()
    plane[:2, :2] += left
    plane[2:, 2:] += right
    K = np.zeros((8, 8))
    for places, sign in (([0, 3, 4, 7], 1), ([1, 2, 5, 6], -1)):  # dx/dz = ry, dy/dz = -rx
        signs = np.array([1, sign, 1, sign])
        K[np.ix_(places, places)] = plane * np.outer(signs, signs)
    M = np.diag([MASS, MASS, TRANSVERSE, TRANSVERSE] * 2)
    dofs: tuple[Label, ...] = tuple(f"{node}:{along}" for node in (1, 2) for along in ("x", "y", "rx", "ry"))
    model = StructuralModel(M, np.zeros((8, 8)), K, dofs=dofs)
    return model.rotating(Rotor(gyroscopic(POLAR, POLAR), np.zeros((8, 8)), speed))


def two_disc_frequencies(speed):
    """Return the frequencies of forward (+) and backward (-) whirl, roots of two quartics with 50 digits."""
    with mp.workdps(50):
        frequencies = []
        a, b, ei = mpf(A), mpf(B), mpf(EI)
        shaft = 3 * ei / a**3
        for k11, k12, k22 in (
            (shaft, -shaft * a, shaft * a**2 + 2 * ei / b),  # equal deflections, opposite slopes
            (shaft + 24 * ei / b**3, -shaft * a + 12 * ei / b**2, shaft * a**2 + 6 * ei / b),
        ):
            m, J, gyro = mpf(MASS), mpf(TRANSVERSE), mpf(POLAR) * mpf(speed)
            # (k11 - m w^2) (k22 + gyro w - J w^2) = k12^2
            quartic = [m * J, -m * gyro, -m * k22 - J * k11, k11 * gyro, k11 * k22 - k12**2]
            frequencies += [float(root.real) for root in polyroots(quartic, maxsteps=500, extraprec=300)]
        return np.array(frequencies)


@pytest.mark.parametrize("speed", [1.0, 250.0, 3000.0])
def test_a_rotor_with_two_discs(speed):
    model, exact = two_discs(speed), two_disc_frequencies(speed)
    poles, shapes = whirl_modes(model)
    order = np.argsort(np.abs(exact))
    assert np.sort(poles.imag) == pytest.approx(np.abs(exact)[order], rel=1e-10)
    if speed > 1:
        turns = whirl(model.dofs, shapes)[np.argsort(poles.imag)]
        assert np.sign(turns) == pytest.approx(np.sign(exact)[order])
        assert np.abs(turns) == pytest.approx(1, abs=1e-6)


def test_responses_are_those_of_the_complex_coordinate():
    """By a force at x, z = x + iy has the two-sided response of 1/(k + gyro w - J w^2) in the rotations."""
    speed, omega = 400.0, np.array([50.0, 130.0, 420.0])
    outputs = [Channel("1:rx", "displacement"), Channel("1:ry", "displacement")]
    result = frequency_response(jeffcott(speed), ["1:ry"], outputs, omega)
    H = result["structure/frequency_response/response"].data[:, :, 0]
    forward, backward = (1 / (9e3 + sign * 0.35 * speed * omega - 0.2 * omega**2) for sign in (1, -1))
    # s = ry - i rx; a moment 1 about y is e^(iwt)/2 + e^(-iwt)/2 of s.
    assert H[:, 1] == pytest.approx((forward + backward) / 2, rel=1e-10)
    assert H[:, 0] == pytest.approx(1j * (forward - backward) / 2, rel=1e-10)
    assert result.group_attrs["structure/frequency_response"]["method"] == "direct"


def test_derivatives_of_responses_know_that_the_matrices_are_unsymmetric():
    def bearing(name, dof, k):
        return Joint(name, (dof,), k=JointParameter(start=k), c=JointParameter(start=20.0))

    rotor = two_discs(700.0)
    model = rotor.joined([bearing("a", "1:x", 3e5), bearing("b", "2:y", 5e5)])
    channels = [Channel("1:x", "displacement"), Channel("2:ry", "acceleration"), Channel("1:y", "velocity")]
    system = StructureSystem(model, [Load("1:x", Impulse(1.0)), Load("2:rx", Impulse(1.0))], channels)
    omega, pairs = np.array([30.0, 210.0, 800.0]), [(0, 0), (1, 0), (2, 1)]
    values = {"a.k": 3e5, "a.c": 25.0, "b.k": 4e5, "b.c": 40.0}
    H, slopes = system.paired_response(values, omega, pairs)
    M, C, K = model.dense(values, rotating=True)
    for line, w in enumerate(omega):
        Z = np.linalg.inv(K + 1j * w * C - w**2 * M)
        exact = [Z[0, 0], -(w**2) * Z[7, 0], 1j * w * Z[1, 6]]
        assert H[line] == pytest.approx(exact, rel=1e-10)
    for k, name in enumerate(values):
        step = 1e-4 * values[name]
        up, down = (
            system.paired_response(values | {name: values[name] + sign * step}, omega, pairs, slopes=False)[0]
            for sign in (1, -1)
        )
        scale = np.abs(slopes[..., k]).max()
        assert slopes[..., k] == pytest.approx((up - down) / (2 * step), rel=1e-5, abs=1e-6 * scale)
    poles = system.poles(values)
    assert np.sort_complex(poles[poles.imag > 1])[:2] == pytest.approx(
        np.sort_complex(whirl_modes(model, values).poles)[:2], rel=1e-9
    )


@pytest.mark.parametrize("equal", [False, True])
def test_sensitivities_of_poles_are_those_of_differences(equal):
    """Equal bearings at rest leave poles in pairs, of which a bearing in x moves one."""

    def bearing(name, dof, k):
        return Joint(name, (dof,), k=JointParameter(start=k), c=JointParameter(start=20.0))

    model = two_discs(0.0 if equal else 500.0).joined([bearing("a", "1:x", 3e5), bearing("b", "1:y", 5e5)])
    values = {"a.k": 3e5, "a.c": 25.0, "b.k": 3e5 if equal else 4e5, "b.c": 25.0 if equal else 40.0}
    exact = pole_sensitivities(model, values)
    for k, name in enumerate(values):
        step = 1e-3 * values[name]
        up, down = (
            np.sort(np.abs(whirl_modes(model, values | {name: values[name] + sign * step}).poles))
            for sign in (1, -1)
        )
        slopes = exact.omega_slopes[:, k]
        difference = (up - down) / (2 * step)
        if equal:  # pairs in any order
            difference, slopes = (pairs.reshape(-1, 2).sum(axis=1) for pairs in (difference, slopes))
        assert slopes == pytest.approx(difference, rel=1e-4, abs=1e-5 * np.abs(slopes).max())


def test_a_campbell_diagram_follows_modes_through_crossings():
    result, speeds = Result("structure"), np.linspace(0.0, 1000.0, 41)
    add_campbell(result, jeffcott(0.0), speeds, None, 4)
    omega = result["structure/campbell/omega"].data
    shift = 0.35 * speeds / 0.4
    backward, forward = (np.sqrt(shift**2 + 9e3 / 0.2) + sign * shift for sign in (-1, 1))
    steady = [k for k in range(4) if np.ptp(omega[:, k]) < 1e-9]
    assert omega[:, steady] == pytest.approx(np.full((41, 2), 200.0), rel=1e-10)
    moving = np.setdiff1d(range(4), steady)
    tilting = omega[:, moving][:, np.argsort(omega[-1, moving])]
    assert tilting[1:] == pytest.approx(np.column_stack([backward, forward])[1:], rel=1e-10)  # crosses 200
    assert result["structure/campbell/whirl"].data.shape == (41, 4)


def test_modes_of_a_rotor_are_complex_ones_alone(monkeypatch):
    result = modal_analysis(jeffcott(300.0), below=300.0)
    assert "structure/modes/omega" not in result
    assert result["structure/complex_modes/omega"].data == pytest.approx([75.0, 200.0, 200.0])
    assert len(modal_analysis(jeffcott(300.0), count=1)["structure/complex_modes/mode"].data) == 1
    with pytest.raises(UsageError, match="mass in every direction"):
        modal_analysis(jeffcott(300.0, J=0.0))
    monkeypatch.setattr("dynid.structure.rotors._MAX_DOFS", 3)
    with pytest.raises(UsageError, match="4 DOFs, more than the 3 of which"):
        modal_analysis(jeffcott(300.0))


def test_whirl_needs_two_directions_in_a_plane():
    shapes = np.array([[1.0], [1j], [0.0]])
    assert np.isnan(whirl((1, 2, 3), shapes)).all()
    assert np.isnan(whirl(("1:x", "1:y", "1:z"), shapes)).all()
    assert whirl(("1:z", "1:x"), shapes[:2]) == pytest.approx([-1])
    assert whirl(("1:y", "1:z"), np.array([[1.0], [0.0]])) == pytest.approx([0])


def test_what_needs_symmetric_matrices_refuses_a_rotor():
    model = jeffcott(300.0)
    channel = Channel("1:x", "displacement")
    for refused in (
        model.with_joints,
        lambda: model.projected(np.eye(4)[:, :2], (1, 2)),
        model.stored_sparse,
        lambda: time_response(model, [Load("1:x", Impulse(1.0))], [channel], np.array([0.0, 0.1])),
        lambda: StructureSystem(model, [Load("1:x", Impulse(1.0))], [channel]).check(),
    ):
        with pytest.raises(UsageError, match="gyroscopic and circulatory matrices are for modes"):
            refused()
