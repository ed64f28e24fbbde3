"""Joints with nonlinear laws: motion and sensitivities, against integrators of SciPy and differences."""

# ruff: noqa: ARG005 - forces are functions of d, v, z
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm

from dynid.arithmetic.expression import parse
from dynid.errors import NumericalError, UsageError
from dynid.lti.generator import RecordTimes
from dynid.lti.signals import signal
from dynid.lti.time_response import timeline
from dynid.native import compiled
from dynid.structure.assembly import Support
from dynid.structure.damping import ProportionalDamping
from dynid.structure.expression_law import ExpressionLaw
from dynid.structure.frame import beam
from dynid.structure.hysteretic_laws import BoucWen, Iwan, Jenkins
from dynid.structure.joint_laws import Coulomb, Cubic, Gap, Power, QuadraticDamping
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.law import BoundLaw
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.nonlinear.march import march
from dynid.structure.nonlinear.tables import Columns, LinearRest, Steps
from dynid.structure.ports import Channel, Load
from dynid.structure.response import time_response

MASS = np.diag([1.0, 1.2])
STIFFNESS = np.array([[2000.0, -1000.0], [-1000.0, 1500.0]])
DAMPING = np.array([[4.0, -2.0], [-2.0, 3.0]])
ROW = np.array([1.0, -1.0])
STEP, SAMPLES = 1 / 400, 120
SINES = signal(
    "multisine",
    {"amplitude": [20.0, 15, 10], "frequency": [30.0, 45, 61], "phase": [0.0, 1, 2]},
    RecordTimes(STEP, SAMPLES),
)


def rest(further=0):
    """Return the two masses for the march; the further direction is that of the joint."""
    A = np.block(
        [
            [np.zeros((2, 2)), np.eye(2)],
            [-np.linalg.solve(MASS, STIFFNESS), -np.linalg.solve(MASS, DAMPING)],
        ]
    )
    E, B = np.r_[0, 0, -np.linalg.solve(MASS, ROW)], np.r_[0, 0, np.linalg.solve(MASS, [1.0, 0])]
    rows = np.array([np.r_[ROW, 0, 0], np.r_[0, 0, ROW], np.r_[ROW, 0, 0]])
    return LinearRest(A, np.stack([E, B, E][: 2 + further], axis=1), rows[: 2 + further], 1, 1)


def steps(parts=1):
    return Steps.of(timeline([SINES], np.arange(SAMPLES) * STEP, 0.0), parts)


def oracle(force, x0, z0=0.0, method="DOP853"):
    """Integrate the same motion by SciPy, without events; `force` returns force and rate of z."""

    def rates(t, y):
        x, v = y[:2], y[2:4]
        f, rate = force(ROW @ x, ROW @ v, y[4])
        load = np.array([SINES.value(t), 0.0])
        return np.r_[v, np.linalg.solve(MASS, load - STIFFNESS @ x - DAMPING @ v - ROW * f), rate]

    times = np.arange(SAMPLES) * STEP
    solution = solve_ivp(
        rates, (0, times[-1]), np.r_[x0, z0], method, times, rtol=1e-9, atol=1e-12, max_step=STEP / 2
    )
    return solution.y[:4].T


def jenkins(d, v, z):
    force = 800 * (d - z)
    return force, v if abs(force) >= 2 and force * v > 0 else 0.0


LAWS = {
    "cubic": (Cubic(), (3e7,), lambda d, v, z: (3e7 * d**3, 0.0)),
    "signed square": (Power(2, 0, ["d"]), (1e5,), lambda d, v, z: (1e5 * d * abs(d), 0.0)),
    "half power": (Power(1.5, 0, ["d"]), (2e4,), lambda d, v, z: (2e4 * np.sign(d) * abs(d) ** 1.5, 0.0)),
    "microslip": (Power(1, 1, ["v"]), (1e3,), lambda d, v, z: (1e3 * abs(d) * v, 0.0)),
    "quadratic damping": (QuadraticDamping(), (6.0,), lambda d, v, z: (6 * abs(v) * v, 0.0)),
    "coulomb": (Coulomb(), (1.5, 0.05), lambda d, v, z: (1.5 * np.tanh(v / 0.05), 0.0)),
    "iwan": (Iwan(), (800.0, 2.0, -0.5, 0.5), None),
    "jenkins": (Jenkins(), (800.0, 2.0), jenkins),
    "bouc-wen": (
        BoucWen(),
        (800.0, 300.0, 100.0),
        lambda d, v, z: (800 * z, v * (1 - 300 * abs(z)) if v * z > 0 else v * (1 + 100 * abs(z))),
    ),
    "gap": (
        Gap(),
        (3e3, 2e-3, 5.0),
        lambda d, v, z: (3e3 * (d - np.clip(d, -2e-3, 2e-3)) + 5 * v * (abs(d) > 2e-3), 0.0),
    ),
    "stop": (Gap("positive"), (3e3, 2e-3, 1.0), lambda d, v, z: ((d > 2e-3) * (3e3 * (d - 2e-3) + v), 0.0)),
    "expression": (
        ExpressionLaw(parse("a*d*abs(d) + b*max(d, 0)*v*abs(v) + c*sin(40*d)"), ("a", "b", "c")),
        (1e5, 300.0, 5.0),
        lambda d, v, z: (1e5 * d * abs(d) + 300 * max(d, 0) * v * abs(v) + 5 * np.sin(40 * d), 0.0),
    ),
}  # fmt: skip


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name in LAWS if LAWS[name][2]])
def test_a_motion_is_that_of_an_integrator_without_events(name):
    law, values, force = LAWS[name]
    motion = march(rest(), [BoundLaw(law, values)], steps(), np.zeros(4), np.zeros(1))
    expected = oracle(force, np.zeros(4))
    tolerance = 1e-6 if name == "half power" else 1e-7  # its slope has an infinite derivative at 0
    assert np.abs(motion.states - expected).max(axis=0) == pytest.approx(
        0, abs=tolerance * np.abs(expected).max()
    )
    assert (motion.events == 0) == (name in ("cubic", "coulomb"))


def density(phi, kt, fs, chi, beta):
    """Return stiffness a unit of slip deflection, phi at most, and of the sliders that slip last."""
    highest = fs * (1 + beta) / (kt * (beta + (chi + 1) / (chi + 2)))
    spread = kt / (1 + beta) * (chi + 1) / highest ** (chi + 1)
    return spread * phi**chi, kt * beta / (1 + beta), highest


def sliders(count, kt, fs, chi, beta):
    """Return stiffnesses and slip forces of sliders side by side, of equal ranges of their deflections."""
    spread, last, highest = density(1.0, kt, fs, chi, beta)
    edges = np.linspace(0, highest, count)
    k, f = (spread * np.diff(edges ** (chi + power)) / (chi + power) for power in (1, 2))
    return np.r_[k, last], np.r_[f, last * highest]


@pytest.mark.thorough
@pytest.mark.parametrize("values", [(800.0, 2.0, -0.5, 0.5), (800.0, 9.0, -0.7, 0.2)])
def test_an_iwan_joint_is_a_thousand_sliders(values):
    """Their positions are kept within reach after each of 12 steps of Runge and Kutta a sample."""
    samples, h, inverse = 70, STEP / 12, np.linalg.inv(MASS)
    k, f = sliders(1000, *values)
    z, reach = np.zeros(1000), f / k

    def rates(t, y):
        d = ROW @ y[:2]
        force = np.sum(k * (d - np.clip(z, d - reach, d + reach)))
        load = np.array([SINES.value(t), 0.0])
        return np.r_[y[2:], inverse @ (load - STIFFNESS @ y[:2] - DAMPING @ y[2:] - ROW * force)]

    y, expected = np.zeros(4), [np.zeros(4)]
    for step in range(12 * (samples - 1)):
        t = step * h
        first = rates(t, y)
        second = rates(t + h / 2, y + h / 2 * first)
        third = rates(t + h / 2, y + h / 2 * second)
        y = y + h / 6 * (first + 2 * second + 2 * third + rates(t + h, y + h * third))
        d = ROW @ y[:2]
        z = np.clip(z, d - reach, d + reach)
        if step % 12 == 11:
            expected.append(y)
    used = steps()._replace(samples=np.arange(samples))
    motion = march(rest(), [BoundLaw(Iwan(), values)], used, np.zeros(4), np.zeros(1))
    assert motion.events > 3
    error = np.abs(motion.states - expected).max(axis=0)
    assert error == pytest.approx(0, abs=1e-4 * np.abs(expected).max())


def test_first_loading_of_an_iwan_joint_is_that_of_its_density():
    """Against the integral of all sliders; a heavy mass is pulled, so that the deflection only grows."""
    values = (800.0, 2.0, -0.6, 0.3)
    mass = lumped([50.0], [Link((1,), 10.0, 1.0)]).joined(
        [Joint("bolt", (1,), laws=(known(Iwan(), *values),))]
    )
    load = Load(1, signal("step", {"amplitude": 5.0}, RecordTimes(STEP, 200)))
    result = time_response(mass, [load], [Channel(1, "velocity")], np.arange(200) * STEP)
    d, force = (result[f"structure/joints/{name}"].data[:, 0] for name in ("deflection", "force"))
    _, last, highest = density(1.0, *values)
    assert d[-1] > 1.2 * highest

    def expected(u):
        slid, _ = quad(lambda phi: density(phi, *values)[0] * phi, 0, min(u, highest))
        stuck, _ = quad(lambda phi: density(phi, *values)[0], min(u, highest), highest)
        return slid + stuck * u + last * min(u, highest)

    assert force[1::20] == pytest.approx([expected(u) for u in d[1::20]], rel=1e-6)


def test_closed_loops_of_an_iwan_joint_leave_no_trace():
    """Loops in a loop, on the way to a deflection: the force there is that of the way without them."""
    law = BoundLaw(Iwan(), (800.0, 2.0, -0.5, 0.5))
    # The deflection is that of a mass without forces but the loads, integrated twice: d'' = u.
    free = LinearRest(
        np.array([[0.0, 1], [0, 0]]), np.array([[0.0, 0], [0, 1]]), np.eye(2), 1, 1
    )  # fmt: skip
    d = {"direct": [0, 2.0, -2.2, 1.0], "loops": [0, 2.0, 0.5, 1.2, 0.9, 1.0, 0.7, 1.7, -2.2, -1, -1.4, 1.0]}
    forces = {}
    for way, turns in d.items():
        at = 1e-3 * np.array(turns)
        # From rest to rest in unit time: constant acceleration one way, then the other.
        load = np.repeat(4 * np.diff(at), 2) * np.tile([1.0, -1.0], len(at) - 1)
        coefficients = np.zeros((len(load), 9, 1))
        coefficients[:, 0, 0] = load
        used = Steps(np.full(len(load), 0.5), coefficients, np.array([len(load)]))
        forces[way] = march(free, [law], used, np.zeros(2), np.zeros(1)).forces[-1, 0]
    assert forces["loops"] == pytest.approx(forces["direct"], rel=1e-12)


@pytest.mark.skipif(not compiled("dynid_march"), reason="by NumPy it takes ten seconds")
def test_an_iwan_joint_remembers_all_reversals_of_a_free_decay():
    model = rest()
    free = model._replace(D=model.D[:, :1], loads=0)
    used = Steps.of(timeline([], np.arange(900) * STEP, 0.0), 1)
    values = (800.0, 2.0, -0.2, 0.5)
    columns = columns_of(4)._replace(by_loads=np.zeros((6, 0, 0)))
    motion = march(free, [BoundLaw(Iwan(), values)], used, np.r_[2e-3, 0, 0, 0], np.zeros(1), columns)
    assert motion.events > 40
    fine = march(
        free, [BoundLaw(Iwan(), values)], Steps.of(timeline([], np.arange(900) * STEP, 0.0), 4),
        np.r_[2e-3, 0, 0, 0], np.zeros(1), columns,
    )  # fmt: skip
    assert motion.states == pytest.approx(fine.states, abs=1e-8 * np.abs(fine.states).max())
    assert motion.slopes == pytest.approx(fine.slopes, abs=1e-6 * np.abs(fine.slopes).max())


def columns_of(count):
    """Return what the joint's stiffness, the parameters of a law and the offset act on."""
    p = count + 2
    by_rows, by_law = np.zeros((p, 1, 1)), np.zeros((count + 1, p))
    by_rows[0], by_law[:, 1:] = 1.0, np.eye(count + 1)
    return Columns(by_rows, np.zeros((p, 1, 1)), np.zeros((p, 1, 1)), (by_law,))


@pytest.mark.skipif(not compiled("dynid_march"), reason="dynid was installed without its library of C")
@pytest.mark.parametrize("name", [name for name in LAWS if name != "expression"])
def test_the_march_in_c_is_that_in_numpy(name, monkeypatch):
    law, values, _ = LAWS[name]
    used, motions = steps()._replace(samples=np.arange(40)), []
    for wish in ("0", "1"):
        monkeypatch.setenv("DYNID_COMPILED", wish)
        laws = [BoundLaw(law, values, 0, 3e-4), BoundLaw(Cubic(), (1e5,), 0)]
        by = columns_of(len(values))
        by = by._replace(laws=(*by.laws, np.zeros((2, len(values) + 2))))
        x0, z0 = np.array([1e-3, 0, -0.2, 0.1]), np.array([1e-4, 0.0])
        motions.append(march(rest(1), laws, used, x0, z0, by, first=True, impulse=(3, np.r_[0, 0, 0, 0.1])))
    estimates = [motion.local_error for motion in motions]
    assert estimates[1] == pytest.approx(estimates[0], rel=1e-4)  # of differences: digits cancel
    for numpy, c in zip(*(motion[:-1] for motion in motions), strict=True):
        assert c == pytest.approx(numpy, rel=1e-9, abs=1e-11 * np.abs(numpy).max())


@pytest.mark.parametrize("name", LAWS)
def test_sensitivities_are_differences(name):
    law, values, _ = LAWS[name]
    count = len(values)
    columns = columns_of(count)
    at = np.r_[0.0, values, 3e-4 * law.preloaded, 1e-3, -1e-3, 0.1, 0.05, 2e-4 * law.hidden]
    sizes = np.r_[1000.0, values, 1e-2, np.full(2, 1e-2), np.ones(2), 1e-2]
    used = steps()._replace(samples=np.arange(20 if name == "expression" else SAMPLES))

    def moved(point, *, sensitive=False):
        model = rest(1)
        model.A[:] += np.outer(model.D[:, 0], model.rows[0]) * point[0]
        bound = BoundLaw(law, tuple(point[1 : 1 + count]), 0, float(point[1 + count]))
        return march(
            model, [bound], used, point[-5:-1], point[-1:], columns if sensitive else None, first=sensitive
        )

    slopes = moved(at, sensitive=True).slopes
    for k, size in enumerate(sizes):
        if (k == count + 1 and not law.preloaded) or (k == len(sizes) - 1 and not law.hidden):
            assert not slopes[..., k].any()
            continue
        change = 1e-7 * size * np.eye(len(sizes))[k]
        difference = (moved(at + change).states - moved(at - change).states) / (2e-7 * size)
        tolerance = 1e-3 if name == "half power" else 4e-6
        assert np.abs(slopes[..., k] - difference).max() <= tolerance * np.abs(difference).max(), k


def structure(*laws, offset=None, k=1000.0):
    joint = Joint("bolt", (1, 2), k, laws=laws, offset=offset)
    return lumped([1.0, 1.2], [Link((1,), 1000.0, 2.0), Link((2,), 500.0, 1.0)]).joined([joint])


def known(law, *values):
    return joint_law(law, [JointParameter(value, signed=True) for value in values])


@pytest.mark.parametrize(
    ("law", "stiffness"),
    [
        (known(Cubic(), 0.0), 0.0),
        (known(Jenkins(), 800.0, 1e9), 800.0),
        (known(BoucWen(), 800.0, 0.0, 0.0), 800.0),
        (known(Gap(), 800.0, 1e3, 0.0), 0.0),
    ],
    ids=lambda value: value.law.kind if hasattr(value, "law") else "",
)
def test_laws_that_stay_in_one_regime_are_linear_joints(law, stiffness):
    times, loads = np.arange(60) * STEP, [Load(1, SINES)]
    channels = [Channel(1, "displacement"), Channel(2, "acceleration")]
    got = time_response(structure(law), loads, channels, times)["structure/time_response/response"].data
    linear = structure(k=1000.0 + stiffness)
    expected = time_response(linear, loads, channels, times)["structure/time_response/response"].data
    assert got == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("law", "stiffness"),
    [(known(Cubic(), 0.0), 0.0), (known(Jenkins(), 2e4, 1e9), 2e4), (known(BoucWen(), 2e4, 0.0, 0.0), 2e4)],
    ids=lambda value: value.law.kind if hasattr(value, "law") else "",
)
def test_on_a_stiff_beam_linear_laws_are_linear_joints_to_round_off(law, stiffness):
    """Its fastest mode turns by 235 rad a sample: accelerations show what is not exact of the loads."""
    clamped = [Support(1, ("w", "theta"))]
    fine = beam(10, 0.1, 500.0, 3.0, supports=clamped, damping=ProportionalDamping(0.5, 1e-7))
    tip, times = fine.dofs[-2], np.arange(100) * 3.04e-5
    sines = {"amplitude": [20.0, 15, 10], "frequency": [3631.0, 5901, 25602], "phase": [0.0, 1, 2]}
    loads = [Load(tip, signal("multisine", sines, RecordTimes(3.04e-5, 100)))]
    channels = [Channel(tip, quantity) for quantity in ("displacement", "velocity", "acceleration")]

    def response(*joints):
        result = time_response(fine.joined(joints), loads, channels, times)
        return result["structure/time_response/response"].data

    got = response(Joint("bolt", (tip,), 5e3, laws=(law,)))
    expected = response(Joint("bolt", (tip,), 5e3 + stiffness))
    assert np.all(np.abs(got - expected).max(axis=0) <= 1e-9 * np.abs(expected).max(axis=0))


def test_linear_analyses_use_the_tangent_at_rest():
    cubic = known(Cubic(), 3e7)
    preloaded = structure(cubic, offset=JointParameter(1e-3, signed=True))
    tangent = 3 * 3e7 * 1e-3**2
    assert preloaded.with_joints()[2] == pytest.approx(structure(k=1000 + tangent).with_joints()[2])
    unknown = structure(
        joint_law(Jenkins(), [JointParameter(start=800.0), JointParameter(start=2.0)]), cubic, cubic
    )
    assert [parameter.name for parameter in unknown.unknowns] == ["bolt.kt", "bolt.fs"]
    assert [name for law in unknown.joints[0].law_parameters for name, _ in law] == [
        "bolt.kt", "bolt.fs", "bolt.k3", "bolt.cubic_2.k3",
    ]  # fmt: skip
    slopes = unknown.slopes({"bolt.kt": 800.0, "bolt.fs": 2.0})
    assert slopes[0]["K"] == pytest.approx(np.outer(ROW, ROW))
    assert slopes[1] == {}


@pytest.mark.parametrize(
    ("law", "values"),
    [
        (QuadraticDamping(), (-1.0,)),
        (Power(0, 3, ["v"]), (-1.0,)),
        (BoucWen(), (1.0, 2.0, -1.0)),
        (Gap(), (1.0, -1.0, 0.0)),
    ],
)
def test_laws_that_create_energy_or_overlap_are_refused(law, values):
    with pytest.raises(UsageError, match="negative"):
        known(law, *values)


def test_free_masses_keep_their_momentum_through_events():
    """Rigid-body motion has no basis of eigenvectors: parts of steps are exponentials of matrices."""
    free = lumped([1.0, 1.2], [Link((1, 2), 300.0, 0.5)]).joined(
        [Joint("bolt", (1, 2), laws=(known(Jenkins(), 800.0, 2.0),))]
    )
    times, force = np.arange(60) * STEP, 20.0
    load = Load(1, signal("sine", {"amplitude": force, "frequency": 40.0}, RecordTimes(STEP, 60)))
    result = time_response(free, [load], [Channel(dof, "velocity") for dof in (1, 2)], times)
    momentum = result["structure/time_response/response"].data @ [1.0, 1.2]
    expected = force / 40 * (1 - np.cos(40 * times))
    assert momentum == pytest.approx(expected, rel=1e-9, abs=1e-9 * expected.max())
    assert result.group_attrs["structure/joints"]["events"] > 2


def test_a_structure_without_mass_somewhere_is_refused():
    massless = lumped([1.0, 0.0], [Link((1,), 900.0), Link((1, 2), 900.0)])
    bolted = massless.joined([Joint("bolt", (2,), laws=(known(Cubic(), 1.0),))])
    with pytest.raises(UsageError, match="needs mass everywhere"):
        time_response(bolted, [Load(1, SINES)], [Channel(1, "velocity")], np.arange(4) * STEP)


def test_a_motion_that_needs_too_short_steps_is_refused(monkeypatch):
    for tolerance in ("_COARSE_TOL", "_ERROR_TOL"):
        monkeypatch.setattr(f"dynid.structure.nonlinear.accuracy.{tolerance}", 0.0)
    monkeypatch.setattr("dynid.structure.nonlinear.accuracy._MAX_PARTS", 2)
    with pytest.raises(NumericalError, match="still changes"):
        time_response(
            structure(known(Cubic(), 3e7)), [Load(1, SINES)], [Channel(1, "velocity")], np.arange(9) * STEP
        )


def test_a_random_load_and_an_impulse_act_on_nonlinear_joints():
    times, channels = np.arange(40) * STEP, [Channel(1, "displacement")]
    record = RecordTimes(STEP, 40)
    band = {"amplitude": 3.0, "seed": 1, "band": (10.0, 300.0)}
    loads = [Load(1, signal("random", band, record)), Load(2, signal("impulse", {"amplitude": 0.05}, record))]
    got = time_response(structure(known(Jenkins(), 500.0, 1e9)), loads, channels, times)
    expected = time_response(structure(k=1500.0), loads, channels, times)
    path = "structure/time_response/response"
    assert got[path].data == pytest.approx(
        expected[path].data, rel=1e-7, abs=1e-8 * np.abs(expected[path].data).max()
    )


def joints_of(result):
    return result.group_attrs["structure/joints"]


@pytest.mark.parametrize("name", [name for name in LAWS if name != "expression"])
def test_the_energy_that_loads_supply_is_stored_or_dissipated(name):
    law, values, _ = LAWS[name]
    result = time_response(
        structure(known(law, *values)), [Load(1, SINES)], [Channel(2, "velocity")], np.arange(SAMPLES) * STEP
    )
    # The slope of |d|^1.5 has no derivative at 0: there quadrature is less accurate.
    assert joints_of(result)["energy_residual"] < (1e-6 if name == "half power" else 1e-9)
    assert "note" not in joints_of(result)


def test_an_impulse_supplies_half_the_momentum_times_the_change_of_velocity():
    masses = lumped([2.0], [Link((1,), 800.0, 3.0)]).joined(
        [Joint("bolt", (1,), laws=(known(Cubic(), 1e5),))]
    )
    load = Load(1, signal("impulse", {"amplitude": 0.5}, RecordTimes(STEP, 40)))
    result = time_response(masses, [load], [Channel(1, "velocity")], np.arange(40) * STEP)
    assert joints_of(result)["energy_residual"] < 1e-9
    deflection = result["structure/joints/deflection"].data[:, 0]
    assert result["structure/joints/work"].data[:, 0] == pytest.approx(1e5 * deflection**4 / 4, abs=1e-12)


def test_a_balance_that_steps_do_not_resolve_is_noted():
    """An impact excites modes of a stiff beam that vibrate many times within a step."""
    stiff = lumped([1.0, 1.0], [Link((1,), 1e3, 1.0), Link((1, 2), 4e8, 50.0)]).joined(
        [Joint("bolt", (1,), laws=(known(Cubic(), 1e7),))]
    )
    load = Load(2, signal("impulse", {"amplitude": 0.1}, RecordTimes(STEP, 40)))
    result = time_response(stiff, [load], [Channel(1, "velocity")], np.arange(40) * STEP)
    assert joints_of(result)["energy_residual"] > 1e-4
    assert "shorten the time between samples" in joints_of(result)["note"]


@pytest.mark.parametrize("wish", ["0", "1" if compiled("dynid_march") else "0"])
@pytest.mark.parametrize("stiff", [False, True])
def test_free_decays_have_no_loads(wish, stiff, monkeypatch):
    monkeypatch.setenv("DYNID_COMPILED", wish)
    model = rest()
    A = model.A.copy()
    A[2:, :2] *= 1e4 if stiff else 1.0
    free = model._replace(A=A, D=model.D[:, :1], loads=0)
    x0, times = np.array([1e-3, 0, 0, 0.1]), np.arange(30) * STEP
    used = Steps.of(timeline([], times, 0.0), 1)
    states = march(free, [BoundLaw(Jenkins(), (800.0, 1e9))], used, x0, np.zeros(1)).states
    A = A + 800.0 * np.outer(free.D[:, 0], free.rows[0])
    expected = np.array([expm(A * t) @ x0 for t in times])
    assert np.all(np.abs(states - expected).max(axis=0) <= 1e-9 * np.abs(expected).max(axis=0))


@pytest.mark.skipif(not compiled("dynid_march"), reason="by NumPy it takes ten seconds")
@pytest.mark.parametrize("slip", [0.5, 5.0, 15.0])
def test_a_stiff_slider_that_sticks_does_not_slip_by_errors_of_polynomials(slip):
    """While it sticks it vibrates within a step, where degree 4 does not follow; nodes are exact."""
    laws = [BoundLaw(Jenkins(), (133352.1432163324, slip))]
    loads = timeline([SINES], np.arange(400) * STEP, 0.0)
    coarse, fine = (
        march(rest(), laws, Steps.of(loads, parts), np.zeros(4), np.zeros(1)).states for parts in (1, 8)
    )
    assert np.all(np.abs(coarse - fine).max(axis=0) <= 1e-10 * np.abs(fine).max(axis=0))


def test_sensitivities_pass_jumps_of_a_damped_contact():
    """Four-point differences; with larger steps events come and go, with smaller ones round-off is seen."""
    law, values = Gap(), (3e3, 6e-4, 100.0)
    used = Steps.of(timeline([SINES], np.arange(1200) * STEP, 0.0), 2)
    exact = march(rest(1), [BoundLaw(law, values)], used, np.zeros(4), np.zeros(1), columns_of(3))
    assert exact.events > 50
    for k, value in enumerate(values):
        h = 1e-6 * value
        moved = [
            march(
                rest(1), [BoundLaw(law, tuple(np.where(np.arange(3) == k, value + s * h, values)))], used,
                np.zeros(4), np.zeros(1),
            ).states
            for s in (1, -1, 2, -2)
        ]  # fmt: skip
        difference = (8 * (moved[0] - moved[1]) - (moved[2] - moved[3])) / (12 * h)
        assert np.abs(exact.slopes[..., k + 1] - difference).max() <= 1e-6 * np.abs(difference).max(), k
