"""Steady states of structures with nonlinear joints: harmonic balance, stability.

The oracles share no code with it: SciPy's DOP853 over a period, linear frequency responses, and matrix
exponentials. Long time responses of the march from rest, whose integrator is another one, stand beside.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, expm
from scipy.special import ellipk

from dynid.errors import UsageError
from dynid.lti.signals import Multisine
from dynid.structure.assembly import Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.frame import beam
from dynid.structure.hysteretic_laws import BoucWen, Iwan, Jenkins
from dynid.structure.joint_laws import Coulomb, Cubic, Gap, Power, QuadraticDamping
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.law import BoundLaw
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.nonlinear.cycle import cycle_force
from dynid.structure.nonlinear.floquet import Stability
from dynid.structure.nonlinear.fourier import basis
from dynid.structure.nonlinear.steady_states import GROUP, harmonic_balance
from dynid.structure.ports import Channel, Load
from dynid.structure.response import frequency_response, time_response

pytestmark = pytest.mark.thorough

LAWS = {
    "cubic": BoundLaw(Cubic(), (2.0,)),
    "jenkins": BoundLaw(Jenkins(), (3.0, 1.0)),
    "jenkins that never slips": BoundLaw(Jenkins(), (3.0, 9.0)),
    "bouc_wen, n = 2": BoundLaw(BoucWen(2.0), (2.0, 1.5, -0.5)),
    "gap": BoundLaw(Gap(), (5.0, 0.4, 0.0)),
    "damped gap with an offset": BoundLaw(Gap("positive"), (5.0, 0.4, 0.7), 0, 0.1),
    "iwan": BoundLaw(Iwan(), (3.0, 1.0, -0.3, 0.5)),
    "iwan, not slipping as a whole": BoundLaw(Iwan(), (3.0, 5.0, 0.2, 0.5)),
    "coulomb": BoundLaw(Coulomb(), (2.0, 0.5)),
    "power": BoundLaw(Power(1, 1, ("v",)), (2.0,)),
    "quadratic_damping": BoundLaw(QuadraticDamping(), (2.0,)),
}
MOTION = np.array([0.05, 1.0, 0.3, 0.08, -0.05, 0.1, 0.04])


def settled(law, q, omega, hidden=None):
    """Return the force of a closed cycle: each evaluation continues from the last one."""
    for _ in range(3):
        cycle = cycle_force(law, q, omega, hidden, parameters=True)
        hidden = cycle.hidden
    return cycle


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_of_the_force_over_a_cycle_are_differences(name):
    law, omega, step, n = LAWS[name], 1.3, 1e-6, len(MOTION)
    cycle = settled(law, MOTION, omega)

    def difference(change):
        high, low = (settled(*change(sign * step), cycle.hidden).coefficients[:n] for sign in (1, -1))
        return (high - low) / (2 * step)

    for direction in np.random.default_rng(0).normal(size=(2, n)):
        by_motion = difference(lambda s, along=direction: (law, MOTION + s * along, omega))
        assert cycle.by_motion @ direction == pytest.approx(by_motion, abs=1e-8)
    assert cycle.by_omega == pytest.approx(difference(lambda s: (law, MOTION, omega + s)), abs=3e-9)
    # The sums of a regime's force are in closed form, or at nodes where derivatives by parameters are asked.
    plain = cycle_force(law, MOTION, omega, cycle.hidden)
    assert plain.coefficients == pytest.approx(cycle.coefficients, abs=1e-11)
    assert plain.by_motion == pytest.approx(cycle.by_motion, abs=1e-11)
    for k in range(len(law.values)):

        def changed(s, k=k):
            values = tuple(value + s * (place == k) for place, value in enumerate(law.values))
            return BoundLaw(law.law, values, 0, law.offset), MOTION, omega

        assert cycle.by_parameters[:, k] == pytest.approx(difference(changed), abs=3e-9)


def test_the_force_of_a_slider_is_that_of_small_steps():
    law, omega, n = LAWS["jenkins"], 1.3, 50_000
    theta = 2 * np.pi * np.arange(2 * n) / n
    d = basis(theta[:n], 3)[0] @ MOTION
    force, z = np.empty(2 * n), 0.0
    for index, value in enumerate(np.concatenate([d, d]).tolist()):
        z = min(max(z, value - 1 / 3), value + 1 / 3)
        force[index] = 3.0 * (value - z)
    coefficients = settled(law, MOTION, omega).coefficients
    expected = 2 / n * basis(theta[:n], 5)[0].T @ force[n:]
    expected[0] /= 2
    assert coefficients[:11] == pytest.approx(expected, abs=1e-8)


def test_the_force_of_an_iwan_joint_is_that_of_many_sliders():
    (kt, fs, chi, beta), sliders, steps = (3.0, 1.0, -0.3, 0.5), 4000, 4000
    a = chi + 1
    phi = fs * (1 + beta) / (kt * (beta + a / (a + 1)))
    limit = np.append(phi * ((np.arange(sliders) + 0.5) / sliders) ** (1 / a), phi)
    stiffness = np.append(np.full(sliders, kt / (1 + beta) / sliders), kt * beta / (1 + beta))
    theta = 2 * np.pi * np.arange(steps) / steps
    motion = np.array([0.0, 0.25, 0.0, 0.0, 0.0, 0.3, -0.2])  # with minor loops
    force, z = np.empty(2 * steps), np.zeros(sliders + 1)
    for index, value in enumerate(np.tile(basis(theta, 3)[0] @ motion, 2).tolist()):
        z = np.clip(z, value - limit, value + limit)
        force[index] = stiffness @ (value - z)
    expected = 2 / steps * basis(theta, 9)[0].T @ force[steps:]
    expected[0] /= 2
    law = BoundLaw(Iwan(), (kt, fs, chi, beta))
    assert cycle_force(law, motion, 1.0).coefficients == pytest.approx(expected, abs=2e-4)


def known(parameters):
    return [JointParameter(value, signed=value < 0) for value in parameters]


def masses(law, *parameters, dofs=(1, 2), links=None):
    """Return two masses with a law between them, or at one of them."""
    if links is None:
        links = [Link((1,), 1000.0, 2.0), Link((2,), 500.0, 1.0)]
    joint = Joint("j", dofs, laws=(joint_law(law, known(parameters)),))
    return lumped([1.0, 1.2], links).joined([joint])


def cantilever(law, *parameters):
    """Return a beam with a law at its tip, and the tip."""
    bare = beam(
        6, 1.0, 500.0, 3.0, supports=[Support(1, ("w", "theta"))], damping=ProportionalDamping(1.0, 1e-5)
    )
    tip = bare.dofs[-2]
    joint = Joint("j", (tip,), laws=(joint_law(law, known(parameters)),))
    return bare.joined([joint]), tip


def curve(result):
    names = ("omega", "amplitude", "response", "stable", "multiplier")
    return tuple(result[f"{GROUP}/{name}"].data for name in names if f"{GROUP}/{name}" in result)


def motion_at(response, theta):
    return (response * np.exp(1j * np.outer(theta, np.arange(len(response))))).real.sum(axis=1)


def after_a_long_time(model, dof, amplitude, omega, periods=300, samples=64):
    """Return a period of the displacement of a DOF after many periods from rest."""
    times = np.arange(samples * periods + 1) * 2 * np.pi / omega / samples
    load = Load(dof, Multisine((amplitude,), (omega,), (np.pi / 2,)))
    result = time_response(model, [load], [Channel(dof, "displacement")], times)
    return result["structure/time_response/response"].data[-samples - 1 : -1, 0]


@pytest.mark.parametrize(
    ("law", "parameters", "amplitude", "stop", "error"),
    [
        (Cubic(), (1e6,), 1.0, 47.0, 1e-8),
        (Jenkins(), (300.0, 0.3), 0.5, 42.7, 1e-5),
        (Gap(), (3e3, 0.005, 0.0), 0.5, 44.5, 1e-5),
        (Iwan(), (300.0, 0.3, -0.3, 0.5), 1.5, 44.0, 1e-5),
    ],
)
def test_a_steady_state_is_a_long_time_response(law, parameters, amplitude, stop, error):
    model, tip = cantilever(law, *parameters)
    omega, _, response = curve(
        harmonic_balance(model, tip, amplitude, 42.0, stop, stability=False, backbone=False)
    )
    expected = after_a_long_time(model, tip, amplitude, omega[-1])
    motion = motion_at(response[-1], 2 * np.pi * np.arange(64) / 64)
    assert omega[-1] == pytest.approx(stop)
    assert motion == pytest.approx(expected, abs=error * np.abs(expected).max())


def test_several_joints_with_several_laws():
    joints = [
        Joint("stop", (1,), laws=(joint_law(Cubic(), [JointParameter(1e5)]),)),
        Joint(
            "bolt",
            (1, 2),
            laws=(
                joint_law(Jenkins(), [JointParameter(300.0), JointParameter(0.3)]),
                joint_law(QuadraticDamping(), [JointParameter(2.0)]),
            ),
        ),
    ]
    model = lumped([1.0, 1.2], [Link((1,), 1000.0, 4.0), Link((2,), 500.0, 3.0)]).joined(joints)
    omega, _, response, stable, _ = curve(harmonic_balance(model, 2, 2.0, 20.5, 22.0, backbone=False))
    expected = after_a_long_time(model, 2, 2.0, omega[-1], periods=150)
    motion = motion_at(response[-1], 2 * np.pi * np.arange(64) / 64)
    assert motion == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())
    assert stable.all()


def test_too_few_harmonics_are_noted():
    model = masses(Coulomb(), 0.3, 0.02, dofs=(2,))
    result = harmonic_balance(model, 2, 2.0, 17.0, 17.5, harmonics=5, stability=False, backbone=False)
    assert "harmonics beyond 5 would deflect a joint by" in result.group_attrs[GROUP]["note"]
    assert result[f"{GROUP}/response"].shape[1] == 6


def test_unstable_states_are_periodic_and_stability_changes_at_folds():
    model = masses(Cubic(), 4e5)
    result = harmonic_balance(model, 1, 2.0, 28.0, 55.0, output=2, backbone=False)
    omega, amplitude, response, stable, multiplier = curve(result)
    other = curve(harmonic_balance(model, 1, 2.0, 28.0, 55.0, stability=False, backbone=False))
    folds = np.flatnonzero(np.diff(np.sign(np.diff(omega)))) + 1
    changes = np.flatnonzero(np.diff(stable.astype(int)))
    assert len(folds) >= 2
    assert result.group_attrs[GROUP]["folds"] == len(folds)
    assert len(changes) == len(folds)
    assert np.abs(folds - changes).max() <= 1
    assert np.all((multiplier > 1) == ~stable)
    # An unstable state and a stable one against SciPy over a period, from where harmonic balance begins.
    for index in (int(multiplier.argmax()), int(amplitude.argmax())):
        w = omega[index]
        x = [motion_at(r[index], np.zeros(1))[0] for r in (other[2], response)]
        v = [(1j * w * np.arange(r.shape[1]) * r[index]).sum().real for r in (other[2], response)]

        def rate(t, y, w=w):
            f = 4e5 * (y[0] - y[1]) ** 3
            return [
                y[2],
                y[3],
                2 * np.cos(w * t) - 1000 * y[0] - 2 * y[2] - f,
                (f - 500 * y[1] - y[3]) / 1.2,
            ]

        over = solve_ivp(
            rate, (0, 2 * np.pi / w), [*x, *v], method="DOP853", rtol=1e-12, atol=1e-14, dense_output=True
        )
        theta = 2 * np.pi * np.arange(65) / 64
        motion = motion_at(response[index], theta)
        assert motion == pytest.approx(over.sol(theta / w)[1], abs=1e-8 * amplitude[index])


@pytest.mark.parametrize(
    ("multipliers", "name"),
    [
        ([0.9, -0.99], ""),
        ([1.2, -0.5], "fold"),
        ([-1.3, 1.1], "period doubling"),
        ([0.8 + 0.7j, 0.8 - 0.7j], "Neimark-Sacker"),
    ],
)
def test_instabilities_are_named_by_the_largest_multiplier(multipliers, name):
    verdict = Stability(np.array(multipliers, dtype=complex), 0.0)
    assert (verdict.instability, verdict.stable) == (name, not name)


def test_small_motions_are_linear():
    model = masses(Cubic(), 1.0)
    omega, amplitude, response, stable, multiplier = curve(
        harmonic_balance(model, 2, 1e-6, 40.0, 25.0, backbone=False)
    )
    linear = frequency_response(model, [2], [Channel(2, "displacement")], omega[::-1])
    expected = linear["structure/frequency_response/response"].data[::-1, 0, 0]
    assert response[:, 1] == pytest.approx(1e-6 * expected, rel=1e-9)
    assert amplitude == pytest.approx(1e-6 * np.abs(expected), rel=1e-9)
    assert stable.all()
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2], A[2:, 2:] = np.diag([-1000, -500 / 1.2]), np.diag([-2, -1 / 1.2])
    for w, size in zip(omega[::9], multiplier[::9], strict=True):
        assert size == pytest.approx(np.abs(np.linalg.eigvals(expm(A * 2 * np.pi / w))).max(), rel=1e-8)


def test_a_structure_that_its_law_alone_holds():
    links = [Link((1, 2), 1000.0, 2.0), Link((2,), 0.0, 1.0)]
    model = masses(Cubic(), 4e5, dofs=(1,), links=links)
    omega, amplitude, response, stable = curve(harmonic_balance(model, 2, 3.0, 32.0, 30.0, backbone=False))[
        :4
    ]
    assert stable[-1]
    w = omega[-1]
    first = curve(harmonic_balance(model, 2, 3.0, 32.0, 30.0, output=1, stability=False, backbone=False))[2]
    x = [motion_at(r[-1], np.zeros(1))[0] for r in (first, response)]
    v = [(1j * w * np.arange(r.shape[1]) * r[-1]).sum().real for r in (first, response)]

    def rate(t, y):
        link = 1000 * (y[0] - y[1]) + 2 * (y[2] - y[3])
        return [y[2], y[3], -link - 4e5 * y[0] ** 3, (link + 3 * np.cos(w * t) - y[3]) / 1.2]

    end = solve_ivp(rate, (0, 2 * np.pi / w), [*x, *v], method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert end[:2] == pytest.approx(x, abs=1e-8 * amplitude[-1])


def test_a_slider_that_sticks_is_a_spring():
    model = masses(Jenkins(), 300.0, 1e3)
    linear = masses(
        Cubic(), 0.0, links=[Link((1,), 1000.0, 2.0), Link((2,), 500.0, 1.0), Link((1, 2), 300.0)]
    )
    omega, _, response, stable, _ = curve(harmonic_balance(model, 2, 1.0, 27.0, 22.0, backbone=False))
    expected = frequency_response(linear, [2], [Channel(2, "displacement")], omega[::-1])
    expected = expected["structure/frequency_response/response"].data[::-1, 0, 0]
    assert response[:, 1] == pytest.approx(expected, rel=1e-9)
    assert stable.all()


def test_hysteresis_and_damped_impacts_agree_with_the_march():
    # The march over a period confirms every state; here its multipliers are below 1.
    hysteretic, stopped = (
        masses(BoucWen(), 300.0, 60.0, 20.0),
        masses(Gap("positive"), 2e3, 2e-3, 5.0, dofs=(2,)),
    )
    for model in (hysteretic, stopped):
        stable = curve(harmonic_balance(model, 2, 1.0, 18.0, 18.6, backbone=False))[3]
        assert stable.all()


def test_the_backbone_of_a_duffing_oscillator_is_an_elliptic_integral():
    k, k3, c = 1000.0, 4e5, 2.0
    joint = Joint("j", (1,), laws=(joint_law(Cubic(), [JointParameter(k3)]),))
    model = lumped([1.0], [Link((1,), k, c)]).joined([joint])
    result = harmonic_balance(model, 1, 3.0, 28.0, 60.0, stability=False)
    amplitude, omega, damping = (
        result[f"response/backbone/{name}"].data for name in ("amplitude", "omega", "damping")
    )
    stiffness = k + k3 * amplitude**2
    expected = np.pi / 2 * np.sqrt(stiffness) / ellipk(k3 * amplitude**2 / (2 * stiffness))
    assert amplitude[-1] > 0.03
    assert omega == pytest.approx(expected, rel=1e-9)
    assert damping == pytest.approx(c / (2 * omega), rel=1e-9)


def test_the_backbone_of_a_slider_begins_where_it_sticks():
    model = masses(Jenkins(), 300.0, 0.5)
    result = harmonic_balance(model, 2, 1.5, 15.0, 30.0, stability=False)
    omega, damping = (result[f"response/backbone/{name}"].data for name in ("omega", "damping"))
    K = np.array([[1300.0, -300.0], [-300.0, 800.0]])
    stuck = np.sqrt(eigh(K, np.diag([1.0, 1.2]), eigvals_only=True)[0])
    assert omega[0] == pytest.approx(stuck, rel=1e-4)
    assert omega[-1] < 0.99 * stuck
    assert damping.max() > 2 * damping[0]


def test_dampers_that_couple_modes_change_the_backbone_little():
    # A damper at one mass couples the modes: the mode's equation takes the others' motion along.
    law = JointParameter(1e5)
    joints = [
        Joint("j", (1,), laws=(joint_law(Cubic(), [law]),)),
        Joint("d", (2,), c=JointParameter(3.0)),
    ]
    model = lumped([1.0, 1.2], [Link((1,), 1000.0), Link((1, 2), 500.0)]).joined(joints)
    result = harmonic_balance(model, 1, 0.01, 14.0, 18.0, stability=False)
    omega, damping = (result[f"response/backbone/{name}"].data for name in ("omega", "damping"))
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, :2] = -np.array([[1500.0, -500.0], [-500 / 1.2, 500 / 1.2]])
    A[3, 3] = -3 / 1.2
    poles = np.linalg.eigvals(A)
    pole = poles[np.abs(poles).argmin()]
    assert omega[0] == pytest.approx(abs(pole), rel=3e-3)
    assert damping[0] == pytest.approx(-pole.real / abs(pole), rel=3e-2)


def test_a_curve_that_ends_early_keeps_its_states_and_says_so():
    model = masses(Cubic(), 4e5)
    result = harmonic_balance(model, 1, 2.0, 28.0, 55.0, points=4, stability=False)
    about = result.group_attrs[GROUP]
    assert len(curve(result)[0]) == 4
    assert not about["complete"]
    assert "the curve ends at" in about["note"]
    assert "not left its interval after 4 points" in about["note"]


def test_a_finer_curve_is_accurate_between_its_points():
    model = masses(Cubic(), 4e5)

    def interpolated(step):
        result = harmonic_balance(model, 1, 0.3, 24.0, 30.0, stability=False, backbone=False, max_step=step)
        omega, amplitude = curve(result)[:2]
        return np.interp(np.linspace(24.0, 30.0, 400), omega, amplitude)

    coarse, fine, finest = map(interpolated, (0.1, 0.02, 0.005))
    assert np.abs(fine - finest).max() < 0.1 * np.abs(coarse - finest).max()


def test_refusals():
    model = masses(Cubic(), 4e5)
    massless = lumped([1.0, 0.0], [Link((1,), 1000.0), Link((1, 2), 500.0)]).joined(model.joints)
    with pytest.raises(UsageError, match="needs mass everywhere"):
        harmonic_balance(massless, 1, 5.0, 25.0, 50.0)
    hysteretic = lumped([1.0, 1.2], [Link((1,), 1000.0, eta=0.1), Link((2,), 500.0)]).joined(model.joints)
    with pytest.raises(UsageError, match="steady state by harmonic balance"):
        harmonic_balance(hysteretic, 1, 5.0, 25.0, 50.0)
