"""The score test of the joints: size, power, the joint and parity it names, and what does not fire it."""

import numpy as np
import pytest

from dynid.identification.estimators.maximum_likelihood import OutputError
from dynid.identification.identify import identify
from dynid.identification.likelihood import joint_responses as responses
from dynid.identification.records.measurement import Experiment, Measurement, Simulation
from dynid.identification.systems.record_values import simulated
from dynid.lti.signals import Multisine, Sampled, Sine
from dynid.result import Result
from dynid.structure.hysteretic_laws import Jenkins
from dynid.structure.joints import Joint, JointParameter
from dynid.structure.lumped import Link, lumped
from dynid.structure.model_laws import joint_law
from dynid.structure.ports import Channel, Load
from tests.sample import sample

pytestmark = pytest.mark.thorough

MASSES, GROUND, STEP, SAMPLES = np.array([1.0, 0.7, 0.9]), (1.5e4, 5.0), 1 / 400, 1200
JOINTS = {"a": (1e4, 4.0), "b": (8e3, 3.0)}
ENDS = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
VELOCITIES = (Channel(1, "velocity"), Channel(3, "velocity"))
# Forces f(d, v) beside the linear ones, sized to leave 0.2 to 1 % of the response.
LAWS = {
    "cubic": (lambda d, _: 3e5 * d**3, "odd", {"d|d|", "d3"}),
    "square": (lambda d, _: 3e3 * d * d, "even", {"d2"}),
    "drag": (lambda _, v: 0.8 * abs(v) * v, "odd", {"|v|v"}),
}


def chain(masses=MASSES, ground=GROUND, true=1.0):
    joints = [
        Joint(name, (k + 1, k + 2), *(JointParameter(start=0.9 * x, true=true * x) for x in JOINTS[name]))
        for k, name in enumerate(JOINTS)
    ]
    return lumped(tuple(masses), (Link((1,), *ground),), joints)


def drive(seed, kind="random"):
    """Return a force: filtered noise, or the odd lines of a period of 2 s."""
    rng = np.random.default_rng(seed)
    if kind == "random":
        window = np.hanning(9) / np.hanning(9).sum()
        return Sampled(60 * np.convolve(rng.standard_normal(SAMPLES), window, "same"), STEP)
    lines = np.pi * np.arange(9, 121, 4)
    return Multisine([5.0] * len(lines), lines.tolist(), rng.uniform(0, 6.28, len(lines)).tolist())


def motion(signal, force, joint, *, response=False):
    """Integrate the chain with a force of a joint beside the linear ones (times x displacements, velocities).

    `response`: with that force at the motion of the linear chain instead, its response alone.
    """
    K, C = np.diag([GROUND[0], 0, 0]), np.diag([GROUND[1], 0, 0])
    for row, (k, c) in zip(ENDS, JOINTS.values(), strict=True):
        K, C = K + k * np.outer(row, row), C + c * np.outer(row, row)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K / MASSES[:, None], -C / MASSES[:, None]]])
    row, push = ENDS[joint], np.concatenate([np.zeros(3), ENDS[joint] / MASSES])
    substeps = 4
    step = STEP / substeps
    drive = signal.value(step / 2 * np.arange(2 * substeps * (SAMPLES - 1) + 1)) / MASSES[2]

    def rate(x, u):
        linear = A @ x[:6]
        linear[5] += u
        acting = push * force(row @ x[:3], row @ x[3:6])
        return np.concatenate([linear, A @ x[6:] - acting]) if response else linear - acting

    x = np.zeros(12 if response else 6)
    states = [x]
    for k in range(substeps * (SAMPLES - 1)):  # Runge-Kutta of order 4
        k1 = rate(x, drive[2 * k])
        k2 = rate(x + step / 2 * k1, drive[2 * k + 1])
        k3 = rate(x + step / 2 * k2, drive[2 * k + 1])
        k4 = rate(x + step * k3, drive[2 * k + 2])
        x = x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        if (k + 1) % substeps == 0:
            states.append(x)
    return np.array(states)[:, -6:]


def noisy(clean, seed, ratio=0.01):
    rng = np.random.default_rng(seed)
    return clean + ratio * np.sqrt(np.mean(clean**2, axis=0)) * rng.standard_normal(clean.shape)


def linear(signal, model=None, channels=VELOCITIES):
    source = Measurement(STEP, SAMPLES, channels, Simulation())
    return simulated(model or chain(), (Load(3, signal),), source).outputs


def fitted(signal, values, model=None, gain=1.0, channels=VELOCITIES, **options):
    measured = Measurement(STEP, SAMPLES, channels, values, **options)
    return identify(model or chain(), Experiment((Load(3, signal, gain=gain),), measured), OutputError())


def p_of(result):
    return result.value("identification/nonlinearity/nonlinear_p")


def verdict(result):
    return result.group_attrs["identification/nonlinearity"]["verdict"]


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["random", "lines"])
def test_p_values_of_linear_records_are_uniform(kind):
    values = [p_of(fitted(signal := drive(seed, kind), noisy(linear(signal), seed))) for seed in range(12)]
    # Of 12 uniform numbers the least is below 1e-4 with a probability of 0.1 %, or above 0.45 with 0.08 %.
    assert 1e-4 < min(values) < 0.45
    assert max(values) > 0.55


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["random", "lines"])
def test_the_size_of_the_test_is_nominal(kind):
    values = [p_of(fitted(signal := drive(seed, kind), noisy(linear(signal), seed))) for seed in range(250)]
    assert 0.02 <= np.mean(np.array(values) < 0.05) <= 0.08


@pytest.mark.parametrize(("law", "joint"), sample([(law, j) for law in LAWS for j in (0, 1)], 3))
def test_a_nonlinear_joint_is_named_with_its_parity_and_size(law, joint):
    force, parity, terms = LAWS[law]
    signal = drive(3)
    moved = motion(signal, force, joint)[:, [3, 5]]
    result = fitted(signal, noisy(moved, 1))
    group = "identification/nonlinearity"
    assert p_of(result) < 1e-6
    name = "ab"[joint]
    assert verdict(result).startswith(f"nonlinear: joint {name}, ")
    assert f"{parity} in the motion" in verdict(result)
    p = result[f"{group}/p"].data[joint]
    names = result[f"{group}/term"].data.tolist()
    assert names == ["d|d|", "d2", "|d|v", "dv", "d3", "|v|v"]
    assert names[int(np.argmin(p))] in terms
    # What a linear chain leaves of the record without noise is the nonlinear part; a linear structure with
    # free amplitudes leaves less.
    part = 100 * fitted(signal, moved)["identification/diagnostics/residual_ratio"].data
    size = result[f"{group}/size"].data[joint, int(np.argmin(p))]
    assert 0.5 < size / np.sqrt(np.mean(part**2)) < 1.1


def slipping(joint):
    """Return the chain with a slider in a joint; what linear joints leave of the response is 0.3 %."""
    slider = joint_law(Jenkins(), [JointParameter(x, signed=True) for x in (52.0, 0.275)])
    joints = [
        Joint(name, (k + 1, k + 2), *JOINTS[name], laws=(slider,) * (k == joint))
        for k, name in enumerate(JOINTS)
    ]
    return lumped(tuple(MASSES), (Link((1,), *GROUND),), joints)


def test_sliders_show_friction_that_functions_of_the_motion_do_not():
    signal = drive(0, "lines")
    result = fitted(signal, noisy(linear(signal, slipping(0)), 1, 0.003))
    p, joint_p = (result[f"identification/nonlinearity/{name}"].data for name in ("p", "joint_p"))
    assert joint_p[0] < 1e-6 * p.min()
    assert verdict(result).startswith("nonlinear: joint a, odd in the motion (|d|v)")


def test_a_slider_is_elastic_up_to_its_slip():
    motions = np.array([[0.1, -0.2], [0.2, -0.2], [0.6, 0.0], [0.4, 0.4], [0.1, 0.1], [-0.2, 0.2]])
    elastic = [[0.1, -0.2], [0.2, -0.2], [0.3, 0.0], [0.1, 0.3], [-0.2, 0.0], [-0.3, 0.1]]
    assert responses._slider(motions, 0.3) == pytest.approx(np.array(elastic))


WRONG = {
    "mass": {"masses": MASSES * [1, 1.1, 1]},
    "boundary": {"ground": (1.2e4, 5.0)},
}


@pytest.mark.parametrize("kind", ["random", "lines"])
@pytest.mark.parametrize("error", [*WRONG, "gain"])
def test_a_linear_error_is_not_a_nonlinear_joint(error, kind):
    signal = drive(7, kind)
    values = noisy(linear(signal), 2)
    model = chain(**WRONG.get(error, {}))
    result = fitted(signal, values, model, gain=1.1 if error == "gain" else 1.0)
    assert result.value("identification/diagnostics/lacks_fit")
    assert p_of(result) > 1e-3


@pytest.mark.parametrize("times", [1, 2, 3, 300])
def test_a_slider_clips_step_by_step(times):
    d = np.cumsum(np.random.default_rng(times).standard_normal((times, 2)), axis=0)
    elastic, expected = np.zeros(2), []
    for step in np.diff(d, axis=0, prepend=0.0):
        elastic = np.clip(elastic + step, -0.5, 0.5)
        expected.append(elastic)
    assert responses._slider(d, 0.5) == pytest.approx(np.array(expected), abs=1e-13)


def test_responses_are_derivatives_by_the_forces_at_zero():
    signal = drive(5)
    model = chain()
    record = _record(model, signal, np.ones((SAMPLES, 4)))
    fit = record.fit(_truth(record), linear(signal, channels=_FOUR))
    ports = record.model.system.joint_ports(
        {f"{n}.{x}": JOINTS[n][i] for n in JOINTS for i, x in enumerate("kc")}
    )
    unit = np.ones((2, 1, 2))
    forces = responses.forces_of(responses.motions_of(record.model, fit, ports) / unit)
    columns = responses._responses(record, fit, ports, forces, slice(None))
    for joint, (term, law) in enumerate([(4, lambda d, _: d**3), (5, lambda _, v: abs(v) * v)]):
        slope = motion(signal, law, joint, response=True)
        column = columns[:, :, joint, term]
        # Forces are linear between samples here: 1 % of them at the highest frequencies.
        for c, row in enumerate([slope[:, 0], slope[:, 3], slope[:, 5]]):
            assert np.linalg.norm(column[c] - row) < 1e-2 * np.linalg.norm(row)


_FOUR = (
    *(Channel(1, q) for q in ("displacement", "velocity")),
    Channel(3, "velocity"),
    Channel(2, "acceleration"),
)


def _truth(record):
    return np.array([unknown.coordinate(unknown.true) for unknown in record.unknowns])


def _record(model, signal, values):
    from dynid.identification.problem import Problem

    measured = Measurement(STEP, SAMPLES, _FOUR, values)
    return Problem.of(model, Experiment((Load(3, signal),), measured)).likelihood.records[0]


@pytest.mark.thorough
def test_gaps_delays_and_accelerations_keep_the_answer():
    signal = drive(3)
    moved = motion(signal, LAWS["cubic"][0], 1)
    q, v = moved[:, :3], moved[:, 3:]
    f = 3e5 * (q[:, 1] - q[:, 2]) ** 3 + 8e3 * (q[:, 1] - q[:, 2]) + 3 * (v[:, 1] - v[:, 2])
    acceleration = (f + signal.value(STEP * np.arange(SAMPLES))) / MASSES[2]
    late = np.interp(STEP * np.arange(SAMPLES) - 0.4 * STEP, STEP * np.arange(SAMPLES), v[:, 0])
    channels = (Channel(1, "velocity", delay=0.4 * STEP), Channel(3, "acceleration"))
    values = noisy(np.column_stack([late, acceleration]), 4)
    values[100:160, 0] = np.nan
    result = fitted(signal, values, channels=channels)
    assert p_of(result) < 1e-6
    assert "joint b" in verdict(result)


def test_coloured_noise_does_not_fire():
    signal = drive(11)
    clean = linear(signal)
    rng = np.random.default_rng(3)
    e = rng.standard_normal(clean.shape)
    for k in range(1, len(e)):
        e[k] += 0.9 * e[k - 1]
    result = fitted(signal, clean + 0.01 * e / e.std() * np.sqrt(np.mean(clean**2, axis=0)))
    assert p_of(result) > 1e-3


def test_a_record_without_noise_has_no_nonlinear_residual():
    signal = drive(1)
    result = fitted(signal, linear(signal))
    assert p_of(result) == 1.0
    assert verdict(result).startswith("no sign of a nonlinear joint")


@pytest.mark.thorough
def test_records_share_the_forces_of_a_joint():
    experiments = []
    for seed in (1, 2):
        signal = drive(seed)
        moved = motion(signal, LAWS["cubic"][0], 0)[:, [3, 5]]
        experiments.append(
            Experiment((Load(3, signal),), Measurement(STEP, SAMPLES, VELOCITIES, noisy(moved, seed)))
        )
    both = identify(chain(), experiments, OutputError())
    single = identify(chain(), experiments[0], OutputError())
    assert p_of(both) < p_of(single) < 1e-6
    assert "joint a" in verdict(both)


def test_a_joint_of_a_still_structure_has_no_p_value():
    # A free chain without its second joint moving: DOF 3 hangs on a joint that carries no force.
    model = lumped(
        (1.0, 1.0, 1.0),
        (Link((1,), 1e4, 5.0), Link((3,), 1e4, 5.0)),
        [
            Joint("moving", (1,), JointParameter(start=900.0), JointParameter(start=1.0)),
            Joint("still", (3,), 100.0, 1.0),
        ],
    )
    signal = Sine(10.0, 40.0)
    measured = Measurement(STEP, 400, (Channel(1, "velocity"),), Simulation())
    truth = lumped((1.0, 1.0, 1.0), (Link((1,), 1.1e4, 6.0), Link((3,), 1e4, 5.0)))
    values = noisy(simulated(truth, (Load(1, signal),), measured).outputs, 1)
    result = identify(
        model, Experiment((Load(1, signal),), Measurement(STEP, 400, (Channel(1, "velocity"),), values))
    )
    p = result["identification/nonlinearity/p"].data
    assert result["identification/nonlinearity/joint"].data.tolist() == ["moving", "still"]
    assert np.isnan(p[1]).all()
    assert p_of(result) > 1e-3


def test_a_lack_of_fit_quotes_the_test():
    signal = drive(3)
    moved = motion(signal, lambda d, _: 3e6 * d**3, 1)[:, [3, 5]]
    result = fitted(signal, noisy(moved, 1, 0.001))
    warnings = " ".join(result["identification/diagnostics/warnings"].data)
    assert "; nonlinear: joint b, odd in the motion (d|d|, d3), " in warnings


def test_nothing_is_tested_where_nothing_of_it_is_wanted(monkeypatch):
    signal = drive(1)
    values = noisy(linear(signal), 1)
    monkeypatch.setattr(responses, "_response_blocks", lambda *_: pytest.fail("computed"))

    class Estimates(Result):
        def wants(self, path):
            return path.startswith("identification/parameters")

        def wants_below(self, group):
            return group == "identification/parameters"

    measured = Measurement(STEP, SAMPLES, VELOCITIES, values)
    into = Estimates("identification")
    identify(chain(), Experiment((Load(3, signal),), measured), OutputError(), into=into)
    assert "identification/parameters/estimate" in into
